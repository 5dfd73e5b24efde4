"""Plots about the design of a force law: effects of changes of an axis, effects of a soft contact
or of a low gain, and the trade-off between bandwidth and a second property of the force loop."""

import json
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatter

from forceaxis import paths
from forceaxis.design import files
from forceaxis.design.advise import Advice, LimitingMode
from forceaxis.design.compliance import Compliance, CompliancePoint
from forceaxis.design.tradeoff import Tradeoff
from forceaxis.drawing import FAINT, GOT, INK, WANTED, finish, legend, name_of, save, style
from forceaxis.linear.plots import TIMING_NAMES, headline
from forceaxis.linear.system import find_model
from forceaxis.results import to_json

Column = Callable[[CompliancePoint], float | None]
Curve = tuple[str, Column, str]  # (name, values, colour)


def advice(result: Advice) -> Figure:
    """Returns a plot of the critical gain and of the crossover frequency for each proposed change
    of the axis."""
    known = [(row, row.ratio.critical_gain) for row in result.rows]
    gains = [(row, gain) for row, gain in known if gain]
    drawn, ax = plt.subplots(figsize=(6.6, 0.9 + 0.21 * len(gains)))
    style(ax)
    ax.axvline(1, color=FAINT, linewidth=0.9)
    for y, (row, gain) in enumerate(gains):
        crossover = row.ratio.crossover_hz
        if crossover:
            ax.plot([gain, crossover], [y, y], color="#d8dee4", linewidth=1.2, zorder=1)
            ax.plot(crossover, y, "o", color=INK, markersize=4.5)
        ax.plot(gain, y, "D", color=GOT, markersize=4, markerfacecolor="none")
    is_ours = find_model(result.model).parent == paths.MODELS
    names = [r.change + (f" [{r.thesis}]" if is_ours and r.thesis else "") for r, _ in gains]
    ax.set_yticks(range(len(gains)), names, fontsize=7)
    ax.set_ylim(len(gains) - 0.4, -0.6)
    ax.set_xscale("log")
    ticks = [0.1, 0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20, 50]
    low, high = ax.get_xlim()
    ax.set_xticks([x for x in ticks if low <= x <= high])
    ax.minorticks_off()
    ax.xaxis.set_major_formatter(lambda value, _: f"x {value:g}")
    ax.set_xlabel("against the present design")
    shown = [
        Line2D([], [], color=INK, marker="o", linestyle="", markersize=4.5,
               label=f"crossover at limit / {result.gain_margin:g}"),
        Line2D([], [], color=GOT, marker="D", linestyle="", markersize=4, markerfacecolor="none",
               label="critical gain"),
    ]  # fmt: skip
    legend(ax, handles=shown, loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    mode = result.limiting_mode
    note = f": limited by {mode.name}, {mode.label}" if isinstance(mode, LimitingMode) else ""
    drawn.tight_layout(rect=(0, 0, 1, 1 - 0.3 / drawn.get_figheight()))
    timing = TIMING_NAMES.get(result.timing, result.timing)
    headline(drawn, f"{name_of(result.model)}, {timing}{note}")
    return drawn


def compliance(result: Compliance) -> Figure:
    """Returns a plot of bandwidth, static error, travel and tolerated impact over the stiffness of
    one element of the model, such as a pad."""
    rows = result.rows
    k = [r.stiffness for r in rows]
    drawn, axes = plt.subplots(3, 1, sharex=True, figsize=(5.8, 6.2))

    def scaled(value: float | None, scale: float) -> float | None:
        return None if value is None else scale * value

    panels: tuple[tuple[str, Curve, Curve], ...] = (
        ("bandwidth over the set, Hz", ("P", lambda r: r.p_fS_Hz, GOT),
         ("bank", lambda r: r.fS_Hz, INK)),
        ("error of P, %; motion, mm",
         ("error of P", lambda r: scaled(r.p_static_error, 100.0), GOT),
         ("motion", lambda r: scaled(r.motion_m, 1e3), WANTED)),
        ("tolerated impact, N s", ("P", lambda r: r.p_strike_N_s, GOT),
         ("bank", lambda r: r.strike_N_s, INK)),
    )  # fmt: skip
    strikes = [value for r in rows for value in (r.p_strike_N_s, r.strike_N_s)]
    for ax, (label, *curves) in zip(axes, panels, strict=True):
        style(ax)
        ax.set_xscale("log")
        # The plot also shows the value 0: the axis does not tolerate even the smallest impact.
        struck = ax is axes[-1]
        if not struck:
            ax.set_yscale("log")
        for name, column, colour in curves:
            y = [np.nan if value is None else value for value in map(column, rows)]
            y = [np.nan if value <= 0 and not struck else value for value in y]
            ax.plot(k, y, "o-", color=colour, markersize=3, linewidth=1.1, label=name)
        ax.axvline(result.present, color=FAINT, linewidth=0.8, linestyle=":")
        ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        if not struck:
            ax.yaxis.set_minor_formatter(LogFormatter(minor_thresholds=(1, 0.4)))
        elif not any(strikes):
            ax.set_ylim(-0.05, 1)
            known = any(value is not None for value in strikes)
            text = "no simulated impact is tolerated" if known else "no gain at the margins"
            ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", color=FAINT, fontsize=8)
        else:
            ax.set_ylim(bottom=0)
        ax.set_ylabel(label)
        legend(ax)
    axes[-1].set_xlabel(f"{result.element}, N/m (dotted: present)")
    name, over = name_of(result.model), ", ".join(result.over)
    finish(drawn, axes[0], f"{name}: soft contact or low gain, over {over}")
    return drawn


def tradeoff(result: Tradeoff) -> Figure:
    """Returns a plot of the bandwidth over the second property of a trade-off, for the designed
    filter bank and for the P law."""
    drawn, ax = plt.subplots(figsize=(5.6, 3.4))
    style(ax)
    for name, curve, colour in (
        ("designed bank", [(row.value, row.bandwidth_Hz) for row in result.rows], INK),
        ("P", [(row.value, row.p_bandwidth_Hz) for row in result.rows], GOT),
    ):
        points = [point for point in curve if point[1]]
        ax.plot(*zip(*points, strict=True), "o-", color=colour, markersize=3.5, label=name)
    if result.against == "hf":
        ax.set_xscale("log")
    ax.set_ylim(bottom=0)
    ax.set_xlabel(result.what)
    ax.set_ylabel("bandwidth fS over the set, Hz")
    legend(ax)
    name, over = name_of(result.model), ", ".join(result.over)
    finish(drawn, ax, f"{name}: bandwidth and its price, over {over}")
    return drawn


def write_tradeoff(out: Path, result: Tradeoff) -> None:
    """Writes tradeoff.json and tradeoff.png into a new folder."""
    with files.NewFolder(out) as folder:
        folder.write("tradeoff.json", json.dumps(to_json(result), allow_nan=False, indent=1) + "\n")
        save(tradeoff(result), folder.path / "tradeoff.png")
