"""Plots of measured responses together with the response of the linear model. After a fit, a plot
shows the model before and after the fit."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from forceaxis.drawing import (
    COLORS,
    FAINT,
    GOT,
    INK,
    THIN,
    decibels,
    legend,
    name_of,
    plain_ticks,
    style,
)  # fmt: skip
from forceaxis.identify.measurement import Complexes, MeasuredCurve, Measurement
from forceaxis.linear import plots
from forceaxis.linear.curves import Curve, PlantBode


def response(
    measured: Measurement, model: Complexes | None, title: str, width: float = 5.6
) -> Figure:
    """Returns the plot of a measured response: magnitude with its 95 % band, phase, and coherence
    over the frequency. `model`: complex response of the linear model at the same frequencies, or
    None."""
    f = measured.frequency_hz
    figure, (size, phase, coherence) = plt.subplots(
        3, 1, sharex=True, figsize=(width, 6.4), height_ratios=(3, 2, 1)
    )
    radius, magnitude = measured.radius(), abs(measured.response)
    marker = "." if len(f) < 100 else ""
    if model is not None:
        size.loglog(f, abs(model), color=GOT, linewidth=2.4, alpha=0.5, label="linear model")
    size.loglog(f, magnitude, color=INK, linewidth=0.9, label="measured", marker=marker)
    low, high = size.get_ylim()
    # The axis has at least one decade, so that a nearly constant magnitude looks constant.
    if high < 10 * low:
        middle = math.sqrt(low * high)
        size.set_ylim(middle / math.sqrt(10), middle * math.sqrt(10))
    bottom = np.maximum(magnitude - radius, magnitude * 1e-3)
    size.fill_between(
        f, bottom, magnitude + radius, color=INK, alpha=0.2, linewidth=0, label="95 % band"
    )
    size.set_ylabel(f"amplitude\n{measured.unit}", fontsize=8, parse_math=False)
    legend(size, loc="best")
    degrees = np.degrees(np.angle(measured.response))
    spread = np.degrees(np.arcsin(np.minimum(radius / np.maximum(magnitude, 1e-300), 1)))
    if model is not None:
        phase.semilogx(f, np.degrees(np.angle(model)), ".", color=GOT, markersize=4, alpha=0.4)
    phase.semilogx(f, degrees, ".", color=INK, markersize=1.5)
    phase.vlines(f, degrees - spread, degrees + spread, color=INK, alpha=0.25, linewidth=0.8)
    phase.set(ylim=(-190, 190), yticks=range(-180, 181, 90))
    phase.set_ylabel("phase, degrees", fontsize=8)
    coherence.semilogx(f, measured.coherence, color=INK, linewidth=0.9)
    coherence.set(ylim=(0, 1.05))
    coherence.set_ylabel("coherence", fontsize=8)
    coherence.set_xlabel("frequency, Hz", fontsize=8)
    for ax in (size, phase, coherence):
        style(ax)
        ax.grid(True, which="both", linewidth=0.3, alpha=0.6)
    plain_ticks(size.yaxis)
    plain_ticks(coherence.xaxis)
    size.set_title(title, fontsize=9, loc="left", color=INK, parse_math=False)
    figure.tight_layout()
    plt.close(figure)
    return figure


def fitted(measured: Measurement, start: Complexes, fitted: Complexes) -> Figure:
    """Returns a plot of magnitude and phase. It shows a measured response with its 95 % band, and
    the model before and after a fit.

    `start`, `fitted`: complex responses of the model at the same frequencies.
    """
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(5.6, 5.0), height_ratios=(3, 2))
    for ax in axes:
        style(ax)
    f, size = measured.frequency_hz, abs(measured.response)
    band = measured.radius()
    # Points with a very large error do not change the range of the plot's axis.
    low, high = np.maximum(size - band, size.min() / 2), np.minimum(size + band, size.max() * 2)
    axes[0].fill_between(f, low, high, color=INK, alpha=0.2, linewidth=0, label="95 % band")
    axes[0].loglog(f, size, ".", color=INK, markersize=4, label="measured")
    axes[1].semilogx(f, np.degrees(np.angle(measured.response)), ".", color=INK, markersize=4)
    for values, linestyle, color, label in (
        (start, "--", FAINT, "start"),
        (fitted, "-", GOT, "fitted"),
    ):
        axes[0].loglog(f, abs(values), linestyle, color=color, label=label, **THIN)
        degrees = np.degrees(np.angle(values))
        # No line is drawn where the phase jumps between -180 and 180 degrees.
        degrees = np.where(abs(np.diff(degrees, prepend=degrees[0])) > 180, np.nan, degrees)
        axes[1].semilogx(f, degrees, linestyle, color=color, **THIN)
    axes[0].set_ylabel(
        f"{measured.output} / {measured.input}" + (f", {measured.unit}" if measured.unit else ""),
        parse_math=False,
    )
    legend(axes[0])
    axes[1].set(ylim=(-190, 190), yticks=range(-180, 181, 90))
    axes[1].set_ylabel("phase, degrees")
    axes[1].set_xlabel("frequency, Hz")
    for ax in axes:
        ax.grid(True, which="both", linewidth=0.3, alpha=0.6)
    plain_ticks(axes[0].yaxis)
    plain_ticks(axes[1].xaxis)
    figure.tight_layout()
    plt.close(figure)
    return figure


def overlay(
    curves: Sequence[Curve], measured: Sequence[MeasuredCurve], result: PlantBode
) -> Figure:
    """Returns the plot of measured responses, with their 95 % bands, over the curves of the
    model."""
    output = result.curves[0].output
    title = f"{name_of(result.model)}: {result.input} to {output}, measured and as modelled"
    figure: Figure = plots.bode([replace(c, label="model") for c in curves], title, output)
    size, phase, right = figure.axes
    right.remove()
    names = [Path(one.folder).name for one in measured]
    for i, (one, name) in enumerate(zip(measured, names, strict=True), len(curves)):
        magnitude, radius = np.asarray(one.magnitude), np.asarray(one.radius)
        label = name if len(set(names)) == len(names) else one.folder
        spread = np.degrees(np.arcsin(np.minimum(radius / magnitude, 1)))
        for ax, values, bars in (
            (size, magnitude, (np.minimum(radius, 0.9 * magnitude), radius)),
            (phase, one.phase_deg, spread),
        ):
            ax.errorbar(one.frequency_hz, values, yerr=bars, label=label, fmt=".", markersize=3.5,
                        elinewidth=0.6, color=COLORS[i % 6])  # fmt: skip
    legend(size, loc="best")
    decibels(size, curves[0].unit)
    return figure
