"""Bode, Nyquist and root-locus plots, pole-zero arrays and mode shapes in the style of the thesis.

The arguments are curves, root loci, arrays of poles and zeros, or results of other modules of this
folder.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from forceaxis.drawing import (
    COLORS,
    DASHES,
    FAINT,
    GOT,
    INK,
    WANTED,
    LineStyle,
    decibels,
    finish,
    legend,
    name_of,
    plain_ticks,
    style,
)
from forceaxis.linear.curves import Curve, LoopBode, NyquistResult, PlantBode
from forceaxis.linear.equations import Numbers, Roots
from forceaxis.linear.limits import (
    AnalysedLoop,
    LimitResult,
    LoopAtGain,
    PolesResult,
    Root,
    StepResult,
)
from forceaxis.linear.locus import Array, Locus, LocusResult
from forceaxis.linear.modes import ModeAnalysis
from forceaxis.linear.sets import CurvesOfSet, StepOfSet, WorstAtGain
from forceaxis.linear.system import facts

# Line style of the curve of a corner plant or random plant of a set of plants.
MEMBER_LINE: LineStyle = {"color": "#9db4c8", "linewidth": 0.5, "zorder": 1}


def bode(
    curves: Sequence[Curve],
    title: str = "",
    ylabel: str = "amplitude",
    phase_only: bool = False,
    size: tuple[float, float] = (5.6, 4.4),
    others: Sequence[Curve] = (),
    margins: LimitResult | None = None,
) -> Figure:
    """Returns a plot of magnitude and phase over the frequency. With `phase_only`, the plot has no
    magnitude.

    others: curves of the other plants of a set, drawn thin. margins: critical gain of the loop, and
    its margins at the gain of the curves. The margins are marked at the first curve.
    """
    rows = 1 if phase_only else 2
    figure, axes = plt.subplots(rows, 1, sharex=True, figsize=size, squeeze=False)
    for c in others:
        axes[0, 0].loglog(c.frequency_hz, c.magnitude, **MEMBER_LINE)
        axes[-1, 0].semilogx(c.frequency_hz, c.phase_deg, **MEMBER_LINE)
    for i, c in enumerate(curves):
        color, dashes = COLORS[i % 6], DASHES[i % 6]
        look: LineStyle = {"color": color, "linewidth": 1.1, "label": c.label}
        if not phase_only:
            axes[0, 0].loglog(c.frequency_hz, c.magnitude, linestyle=dashes, **look)
        axes[-1, 0].semilogx(c.frequency_hz, c.phase_deg, linestyle=dashes, **look)
    for ax in axes[:, 0]:
        style(ax)
        ax.margins(x=0)
    phase = axes[-1, 0]
    low, high = phase.get_ylim()
    middle, reach = (low + high) / 2, max(high - low, 60.0) / 2
    low, high = middle - reach, middle + reach
    step = next(s for s in (15, 30, 45, 90, 180, 360, 720) if 2 * reach / s <= 7 or s == 720)
    ticks = np.arange(np.floor(low / step), np.ceil(high / step) + 1) * step
    phase.set_yticks(ticks)
    phase.set_ylim(ticks[0], ticks[-1])
    if ticks[0] < -180 < ticks[-1]:
        phase.axhline(-180, color=FAINT, linewidth=0.8, linestyle=":", zorder=1)
    phase.set_ylabel("phase, degrees")
    phase.set_xlabel("frequency, Hz")
    plain_ticks(phase.xaxis)
    if not phase_only:
        low, high = axes[0, 0].get_ylim()
        # The axis has at least one decade, so that a nearly constant curve looks nearly constant.
        if high < 10 * low:
            wider = np.sqrt(10 * low / high)
            axes[0, 0].set_ylim(low / wider, high * wider)
        plain_ticks(axes[0, 0].yaxis)
        units = dict.fromkeys(c.unit for c in curves)
        axes[0, 0].set_ylabel(f"{ylabel}, {' or '.join(units)}".rstrip(", "))
        if margins and margins.at:
            mark_margins(axes[0, 0], phase, curves[0], margins, margins.at)
        decibels(axes[0, 0], " or ".join(units))
    if len(curves) > 1:
        legend(axes[0, 0], loc="best")
    elif others:
        members_key(axes[0, 0])
    axes[0, 0].set_title(title, fontsize=9, loc="left", color=INK, parse_math=False)
    tall = size[1]
    figure.subplots_adjust(0.125, 0.46 / tall, 0.9, 1 - 0.3 / tall, hspace=0.12)
    plt.close(figure)
    return figure


def members_key(ax: Axes) -> None:
    """Adds a legend that names the curve of the nominal plant and the curves of the other plants of
    a set."""
    thin = Line2D([], [], label="corners and random members", **MEMBER_LINE)
    legend(ax, handles=[Line2D([], [], color=INK, label="nominal"), thin], loc="best")


def mark_margins(size: Axes, phase: Axes, curve: Curve, limit: LimitResult, at: LoopAtGain) -> None:
    """Marks the gain margin and phase margin of a loop gain in a Bode plot. The gain margin is
    drawn as the distance from |L| = 1, the phase margin as the distance from -180 degrees."""
    size.axhline(1, color=FAINT, linewidth=0.8, linestyle=":", zorder=1)
    gain_line: LineStyle = {
        "color": WANTED, "linewidth": 1.4, "zorder": 4, "marker": "_", "markersize": 5,
    }  # fmt: skip
    phase_line: LineStyle = {**gain_line, "color": GOT}
    notes = []
    crossover, margin = at.margins.crossover_hz, at.margins.phase_margin_deg
    if crossover and margin is not None:
        angle = np.interp(np.log(crossover), np.log(curve.frequency_hz), curve.phase_deg)
        for ax in (size, phase):
            ax.axvline(crossover, color=GOT, linewidth=0.6, linestyle=":", zorder=1)
        phase.plot([crossover] * 2, [angle - margin, angle], **phase_line)
        notes.append(f"phase margin {margin:.3g} degrees at {crossover:.3g} Hz")
    factor = at.margins.gain_margin
    turns = [c.frequency_hz for c in limit.crossings if c.gain > at.gain]
    if factor and turns and turns[0]:
        turn = turns[0]
        for ax in (size, phase):
            ax.axvline(turn, color=WANTED, linewidth=0.6, linestyle=":", zorder=1)
        size.plot([turn] * 2, [1 / factor, 1], **gain_line)
        notes.append(
            f"gain margin {20 * np.log10(factor):.3g} dB (factor {factor:.3g}) at {turn:.3g} Hz"
        )
    for row, (note, colour) in enumerate(
        (n, GOT if n.startswith("phase") else WANTED) for n in notes
    ):
        size.text(
            0.015, 0.05 + 0.11 * row, note, transform=size.transAxes, fontsize=7, color=colour,
            bbox={"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 0.5}, zorder=6,
        )  # fmt: skip


def nyquist(
    frequency_hz: Numbers,
    values: Roots,
    title: str = "",
    size: tuple[float, float] = (4.8, 4.6),
    others: Sequence[Curve] = (),
) -> Figure:
    """Returns a Nyquist plot of the loop gain `values` around the point -1, for positive and
    negative frequencies.

    The plot contains the unit circle, and the curve within a distance of 2.5 from the origin.
    others: curves of the other plants of a set, drawn thin.
    """
    figure, ax = plt.subplots(figsize=size)
    style(ax)
    turn = np.linspace(0, 2 * np.pi, 200)
    ax.plot(np.cos(turn), np.sin(turn), color=FAINT, linewidth=0.7, linestyle=":")
    for c in others:
        ax.plot(c.response.real, c.response.imag, **MEMBER_LINE)
    whose = "nominal, " if others else ""
    ax.plot(values.real, values.imag, color=INK, linewidth=1.1, label=f"{whose}f > 0")
    ax.plot(
        values.real, -values.imag, color=INK, linewidth=0.7, linestyle="--", label=f"{whose}f < 0"
    )
    ax.plot([-1], [0], marker="+", color=GOT, markersize=10, markeredgewidth=1.6)
    ax.annotate(
        "-1", (-1, 0), (-4, 5), textcoords="offset points", fontsize=8, color=GOT, ha="right"
    )
    span = min(max(1.6, 1.1 * np.abs(values).max()), 2.5)
    for hz in decades(frequency_hz, values, span):
        at = int(np.argmin(np.abs(frequency_hz - hz)))
        point = values[at]
        ax.plot(point.real, point.imag, "o", color=INK, markersize=2.5)
        # The label of a frequency is beside the curve, on the side that is away from the origin.
        along = values[min(at + 1, len(values) - 1)] - values[max(at - 1, 0)]
        out = along * 1j / abs(along)
        out *= 14 if (out * point.conjugate()).real > 0 else -14
        ax.annotate(
            f"{hz:g} Hz", (point.real, point.imag), (out.real, out.imag),
            textcoords="offset points", fontsize=7, color=INK, ha="center", va="center",
        )  # fmt: skip
    ax.set_xlim(-span, span)
    ax.set_ylim(-span, span)
    ax.set_aspect("equal")
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    if others:
        ax.plot([], [], label="corners and random members", **MEMBER_LINE)
    legend(ax, loc="upper left")
    finish(figure, ax, title)
    return figure


def decades(frequency_hz: Numbers, values: Roots, span: float) -> list[float]:
    """Returns round frequencies for labels at the curve of a Nyquist plot. The labels are inside
    the plot and do not overlap."""
    shown: list[tuple[float, complex]] = []
    for hz in (1, 2, 5, 10, 20, 30, 50, 70, 100, 200, 500):
        if not frequency_hz[0] < hz < frequency_hz[-1]:
            continue
        value = np.interp(hz, frequency_hz, values.real) + 1j * np.interp(
            hz, frequency_hz, values.imag
        )
        far = all(abs(value - other) > 0.16 * span for _, other in shown)
        if 0.08 * span < abs(value) and max(abs(value.real), abs(value.imag)) < 0.92 * span and far:
            shown.append((hz, value))
    return [hz for hz, _ in shown]


def hz(roots: ArrayLike) -> tuple[Numbers, Numbers]:
    """Returns the real and imaginary parts of roots, converted from 1/s to Hz (divided by 2 pi)."""
    roots = np.asarray(roots) / (2 * np.pi)
    return roots.real, roots.imag


def mark(ax: Axes, ends: Array, size: float = 5.5) -> None:
    """Marks poles with x and zeros with o in a plot of the s-plane."""
    ax.plot(*hz(ends.poles), "x", color=INK, markersize=size, markeredgewidth=1.3, zorder=4)
    ax.plot(
        *hz(ends.zeros), "o", color=GOT, markersize=size, markerfacecolor="none",
        markeredgewidth=1.2, zorder=4,
    )  # fmt: skip


def panels(labels: Sequence[str], wide: float, tall: float) -> tuple[Figure, list[Axes]]:
    """Returns a Matplotlib figure with one panel for each of the labels, side by side. Each panel
    is `wide` x `tall` inches."""
    left, right, gap, low = 0.74, 0.15, 0.4, 0.48
    high = 0.55 if any(labels) else 0.32
    count = len(labels)
    size = left + count * wide + (count - 1) * gap + right, low + tall + high
    figure = plt.figure(figsize=size)
    axes = [
        figure.add_axes(
            ((left + i * (wide + gap)) / size[0], low / size[1], wide / size[0], tall / size[1])
        )
        for i in range(count)
    ]
    for ax, label in zip(axes, labels, strict=True):
        style(ax)
        ax.axvline(0, color=FAINT, linewidth=0.8)
        ax.axhline(0, color=FAINT, linewidth=0.8)
        ax.set_title(label, fontsize=8, color=INK, parse_math=False)
    axes[0].set_ylabel("imaginary part / 2\u03c0, Hz")
    return figure, axes


def headline(figure: Figure, title: str) -> None:
    """Writes the title above the panels of a figure. Also removes the figure from the list of
    pyplot."""
    figure.suptitle(
        title, fontsize=9, color=INK, parse_math=False, x=0.02, ha="left", va="top", y=0.985
    )
    plt.close(figure)


def rlocus(loci: Sequence[Locus], title: str = "", wide: float = 2.7) -> Figure:
    """Returns a plot of root loci side by side. The plot shows the upper half-planes in Hz and
    marks the critical gain."""
    span = max(one.span_hz for one in loci)
    figure, axes = panels(
        [one.label for one in loci], wide, 1.05 * wide
    )  # both axes of a panel have the same scale
    for ax, one in zip(axes, loci, strict=True):
        x, y = hz(np.where(one.branches.imag >= 0, one.branches, np.nan))
        ax.plot(x, y, color=WANTED, linewidth=1.1)
        upper = [
            roots[roots.imag > -1e-6 * 2 * np.pi * span]
            for roots in (one.ends.poles, one.ends.zeros)
        ]
        mark(ax, Array("", *upper))
        if len(one.at_gain):
            closed = one.at_gain[one.at_gain.imag > -1e-6]
            ax.plot(*hz(closed), "s", color=INK, markersize=3.5, zorder=5)
        # Poles farther to the left than the edge of the plot are not drawn.
        ax.set_xlim(-0.57 * span, 0.43 * span)
        ax.set_ylim(-0.05 * span, span)
        ax.set_xlabel("real part / 2\u03c0, Hz")
        label_crossings(ax, one, span)
    keys = [
        Line2D([], [], label="open-loop pole", marker="x", color=INK, linestyle=""),
        Line2D([], [], label="zero", marker="o", color=GOT, markerfacecolor="none", linestyle=""),
        Line2D([], [], label="crossing", marker="D", color=GOT, linestyle="", markersize=4.5),
    ]
    if any(len(one.at_gain) for one in loci):
        keys.append(Line2D([], [], label="at the gain", marker="s", color=INK, linestyle=""))
    legend(axes[0], handles=keys, loc="upper left", handletextpad=0.3, markerscale=0.8)
    headline(figure, title)
    return figure


def gain_text(gain: float, one: Locus) -> str:
    """Returns a text with a gain and its unit. If the `force_gain` of the firmware is known, the
    text also contains this gain."""
    text = f"k = {gain:.3g} {one.unit}".rstrip()
    return text + (f"\n(force_gain {gain * one.codes:.3g})" if one.codes else "")


def label_crossings(ax: Axes, one: Locus, span: float) -> None:
    """Marks the crossings of the stability boundary in a root locus. The mark of the critical gain
    has a label with its frequency and its value of `force_gain`."""
    limit = one.limit
    if not limit.gain:
        note = limit.reason.replace(" at ", "\nat ").replace(", above", ",\nabove")
    elif limit.frequency_hz is None or limit.frequency_hz > span:
        where = "infinite" if limit.frequency_hz is None else f"{limit.frequency_hz:.3g}"
        note = f"{gain_text(limit.gain, one)}\nat {where} Hz, beyond"
    else:
        note = ""
    ax.text(
        0.97, 0.97, note, transform=ax.transAxes, fontsize=7, ha="right", va="top",
        color=WANTED if limit.gain is None else GOT,
    )  # fmt: skip
    # (centre, half of the height) in Hz of each label that is already drawn
    taken: list[tuple[float, float]] = []
    own = one.limit.frequency_hz or 0.0
    inside = [
        (c.frequency_hz, c)
        for c in one.crossings
        if c.frequency_hz is not None and c.frequency_hz < span
    ]
    for height, crossing in sorted(inside, key=lambda pair: abs(pair[0] - own)):
        first = crossing.gain == one.limit.gain
        face = GOT if first else "white"
        ax.plot(0, height, "D", color=GOT, markerfacecolor=face, markersize=4.5, zorder=5)
        text = f"{gain_text(crossing.gain, one)}\n{height:.3g} Hz"
        if not first:
            text = f"{'back ' * (crossing.direction < 0)}{crossing.gain:.3g}, {height:.3g} Hz"
        half = (0.09 if first else 0.03) * span
        up = 1 if height >= own else -1
        at = height
        while any(abs(at - other) < half + room for other, room in taken):
            at += up * 0.01 * span
        if not 0 < at < span:
            continue
        taken.append((at, half))
        ax.annotate(
            text, (0, height), (0.05 * span, at), fontsize=7, color=GOT, va="center",
            bbox={"facecolor": "white", "alpha": 0.5, "linewidth": 0, "pad": 0.2}, zorder=6,
            arrowprops={"arrowstyle": "-", "color": GOT, "linewidth": 0.6, "shrinkB": 3},
        )  # fmt: skip


def pole_zero(
    arrays: Sequence[Array], title: str = "", span_hz: float | None = None, wide: float = 2.9
) -> Figure:
    """Returns a plot of pole-zero arrays side by side, in Hz, with x for poles and o for zeros.

    span_hz: half-width of the plot. By default, the plot shows the structural dynamics, as in
    4.3.1. The number of poles and zeros outside of the plot is printed below.
    """
    figure, axes = panels([one.label for one in arrays], wide, wide)
    for ax, one in zip(axes, arrays, strict=True):
        roots = np.concatenate([one.poles, one.zeros])
        # The plot shows lightly damped roots, and roots in the right half-plane.
        # Most real roots in the left half-plane are electrical poles of the drive.
        light = np.abs(roots.real) < 0.3 * np.abs(roots)
        structural = roots[light | (roots.real > np.abs(roots.imag))]
        span = span_hz or frame(np.abs(structural if structural.any() else roots)) / (2 * np.pi)
        mark(ax, one)
        ax.set_xlim(-span, span)
        ax.set_ylim(-span, span)
        beyond = [
            f"{count} {name}" + "s" * (count > 1)
            for name, some in (("pole", one.poles), ("zero", one.zeros))
            if (count := int((np.max(np.abs(hz(some)), axis=0) > span).sum()))
        ]
        note = f"; beyond: {', '.join(beyond)}" if beyond else ""
        ax.set_xlabel(f"real part / 2\u03c0, Hz{note}")
    headline(figure, title)
    return figure


def frame(sizes: Numbers) -> float:
    """Returns the half-width in 1/s of a plot of roots with the magnitudes `sizes`. Roots beyond a
    gap are outside the plot. A gap means that a magnitude is more than six times the next smaller
    magnitude."""
    # Magnitudes that differ from 0 only by rounding errors are left out.
    ordered = np.sort(sizes[sizes > 1e-6 * sizes.max(initial=0)])
    if not len(ordered):
        return 2 * np.pi
    gaps = np.flatnonzero(ordered[1:] > 6 * ordered[:-1])
    gaps = gaps[gaps >= len(ordered) // 3]
    return 1.18 * float(ordered[gaps[0]] if len(gaps) else ordered[-1])


def mode_shapes(result: ModeAnalysis, title: str = "") -> Figure:
    """Returns a plot of the modes of vibration in a ModeAnalysis. The plot has one row for each
    mode, and shows each body at rest (dashed) and displaced.

    The bodies are side by side, in the order of the model. Displacements are drawn along the axis.
    The largest displacement has the same length in each mode.
    """
    rows = result.modes
    bodies = list(rows[0].shape) if rows else []
    figure, ax = plt.subplots(figsize=(2.6 + 1.15 * len(bodies), 0.8 + 0.72 * len(rows)))
    ax.set_axis_off()
    wide, tall, reach = 0.3, 0.4, 0.33
    for row, mode in enumerate(rows):
        y = -row
        ax.plot([-0.5, len(bodies) - 0.5], [y, y], color="#d8dee4", linewidth=0.8, zorder=0)
        for x, body in enumerate(bodies):
            value = mode.shape[body]
            moved = x + reach * value
            ax.add_patch(
                plt.Rectangle((x - wide / 2, y - tall / 2), wide, tall, linewidth=0.9, fill=False,
                              edgecolor=FAINT, linestyle=":")
            )  # fmt: skip
            ax.add_patch(
                plt.Rectangle((moved - wide / 2, y - tall / 2), wide, tall, linewidth=0.9,
                              facecolor="#c9d6e3", edgecolor=INK, alpha=0.85)
            )  # fmt: skip
            ax.annotate(
                f"{value:+.2f}" if abs(value) >= 0.005 else "0", (moved, y), fontsize=6,
                color=INK, ha="center", va="center",
            )  # fmt: skip
        zeta = mode.damping_ratio
        head = f"{mode.frequency_hz:.3g} Hz" + ("" if zeta is None else f", \u03b6 {zeta:.2g}")
        label = mode.label + (", the reference" if mode.reference else "")
        ax.text(-0.65, y + 0.13, head, fontsize=8, color=INK, ha="right", va="center")
        colour = GOT if mode.label == "noncolocated" else WANTED
        ax.text(-0.65, y - 0.17, label, fontsize=7, color=colour, ha="right", va="center")
    for x, body in enumerate(bodies):
        ax.text(x, 0.5, body.replace("_", " "), fontsize=8, color=INK, ha="center", va="bottom")
    ax.set_xlim(-2.35, len(bodies) - 0.4)
    ax.set_ylim(-len(rows) + 0.5, 0.85)
    finish(figure, ax, title)
    return figure


def step_response(result: StepResult) -> Figure:
    """Returns a plot of a step response."""
    figure, ax = plt.subplots(figsize=(5.6, 3.0))
    style(ax)
    ax.plot(result.response.time_s, result.response.value, color=INK, linewidth=1.2)
    if result.response.final is not None:
        ax.axhline(result.response.final, color=GOT, linewidth=0.8, linestyle=":")
    ax.set_xlabel("time, s")
    ax.set_ylabel(f"{result.loop.output}\nper unit step")
    finish(figure, ax, f"{loop_title(result.loop)}, {result.gain:.4g} {result.unit}")
    return figure


def with_units(label: str, model: str | Path) -> str:
    """Adds the units of the parameters to the label of a curve, such as "b_w = 8.25, m_w = 5"."""
    known = facts(model).parameters
    parts = (part.partition(" = ") for part in label.split(", "))
    return ", ".join(f"{n} = {v} {known[n][1]}" if n in known else n for n, _, v in parts)


LAW_NAMES = {"p": "P", "pi": "PI", "pd": "PD", "bank": "designed bank"}
TIMING_NAMES = {"continuous": "continuous", "zoh": "sampled", "zoh+1": "sampled, a tick late",
           "zoh and zoh+1": "sampled, on time and a tick late"}  # fmt: skip


PART_NAMES = {"loop": "loop gain", "closed": "closed loop", "sensitivity": "sensitivity"}


def loop_title(loop: AnalysedLoop) -> str:
    """Returns the title of a plot that shows a force loop."""
    law, timing = LAW_NAMES.get(loop.law, loop.law), TIMING_NAMES.get(loop.timing, loop.timing)
    return f"{name_of(loop.model)}: {law}, {timing}"


def bode_figure(curves: Sequence[Curve], result: LoopBode | PlantBode | CurvesOfSet) -> Figure:
    """Returns a Bode plot of the given curves. For a set of plants, the first curve is nominal."""
    if isinstance(result, CurvesOfSet):
        label = PART_NAMES[result.of or "loop"]
        title = f"{loop_title(result.analysed.loop)}, {label}"
        return bode([replace(curves[0], label="")], title, label, others=curves[1:])
    if isinstance(result, LoopBode):
        label = PART_NAMES[result.of]
        margins = result.curves[0].loop if result.of == "loop" else None
        named = _with_units(curves, result.loop.model)
        return bode(named, f"{loop_title(result.loop)}, {label}", label, margins=margins)
    names = list(dict.fromkeys(c.output for c in result.curves))
    label = names[0] if len(names) == 1 else "amplitude"
    title = f"{name_of(result.model)}: {result.input} to {', '.join(names)}, {result.timing}"
    return bode(_with_units(curves, result.model), title, label)


def _with_units(curves: Sequence[Curve], model: str) -> list[Curve]:
    """Returns the curves of a model with new labels, which contain the units of the parameters."""
    return [replace(c, label=with_units(c.label, model)) for c in curves]


def rlocus_figure(loci: Sequence[Locus], result: LocusResult) -> Figure:
    """Returns a plot of root loci."""
    named = [replace(one, label=with_units(one.label, result.loop.model)) for one in loci]
    return rlocus(named, loop_title(result.loop))


def nyquist_figure(result: NyquistResult) -> Figure:
    """Returns a Nyquist plot of one force loop."""
    limit = result.limit
    title = _title_with_gain(limit.loop, result.at, limit.unit)
    return nyquist(result.frequency_hz, result.real + 1j * result.imag, title)


def nyquist_set_figure(curves: Sequence[Curve], result: CurvesOfSet) -> Figure:
    """Returns a Nyquist plot of the force loops of a set of plants. The first curve is nominal."""
    title = _title_with_gain(result.analysed.loop, result.at, result.unit)
    return nyquist(curves[0].frequency_hz, curves[0].response, title, others=curves[1:])


def _title_with_gain(loop: AnalysedLoop, at: LoopAtGain | WorstAtGain, unit: str) -> str:
    """Returns the title of a plot that shows a force loop at a gain."""
    own = f" (force_gain {at.firmware_gain:.3g})" if at.firmware_gain else ""
    return f"{loop_title(loop)}\nk = {at.gain:.3g} {unit}{own}"


def step_set_figure(result: StepOfSet) -> Figure:
    """Returns a plot of the step responses of a set of plants. The first step response is
    nominal."""
    figure, ax = plt.subplots(figsize=(5.6, 3.0))
    style(ax)
    responses = [member.response for member in result.members]
    first, *others = responses
    for one in others:
        ax.plot(one.time_s, one.value, **MEMBER_LINE)
    ax.plot(first.time_s, first.value, color=INK, linewidth=1.2)
    if not result.stable:  # An unstable response would grow and hide the responses of stable loops.
        shown = [one for one in responses if one.stable] or [first]
        reach = 1.5 * max(np.abs(one.value).max() for one in shown)
        ax.set_ylim(-reach, reach)
    loop = result.analysed.loop
    ax.set_xlabel("time, s")
    ax.set_ylabel(f"{loop.output}\nper unit step")
    finish(figure, ax, f"{loop_title(loop)}, {result.gain:.4g} {result.unit}")
    return figure


def poles_figure(result: PolesResult, span_hz: float | None = None) -> Figure:
    """Returns a plot of poles and zeros. Roots at infinity are left out."""

    def finite(roots: Sequence[Root]) -> Roots:
        return np.array(
            [complex(r.re_per_s, r.im_per_s or 0.0) for r in roots if r.re_per_s is not None],
            complex,
        )

    about = result.subject
    title = f"{name_of(about.model)}: {result.input} to {result.output}, {about.timing}"
    return pole_zero([Array("", finite(result.poles), finite(result.zeros))], title, span_hz)
