"""Plot of the effect of each change of an axis on the force loop."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from forceaxis import paths
from forceaxis.design.advise import Advice, LimitingMode
from forceaxis.drawing import FAINT, GOT, INK, legend, name_of, style
from forceaxis.linear.plots import TIMING_NAMES, headline
from forceaxis.linear.system import find_model


def figure(result: Advice) -> Figure:
    """Returns the plot of critical gain and crossover frequency with each change of the axis."""
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
