"""Plots of the statistics of pressed parts. They show a run chart and a histogram for each
evaluation element, and the curves of the last parts."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from forceaxis.cycles.capability import ElementStatistics, PartStatistics, histogram
from forceaxis.cycles.outcome import GOOD
from forceaxis.cycles.part import short
from forceaxis.cycles.plots import BAD_COLOUR, GOOD_COLOUR, MM
from forceaxis.cycles.record import CurvePoint
from forceaxis.drawing import FAINT, INK, style
from forceaxis.words import plain

# Sizes in inches: height of a row of charts, height of the plot of the curves, and total width.
ROW_IN, CURVES_IN, WIDTH_IN = 1.9, 3.4, 7.6
MARKED_MOST = 500  # largest number of values in a run chart up to which a line connects them
# pairs of the verdict on a part and the curve of this part
Curves = Sequence[tuple[str, Sequence[CurvePoint]]]


def shown_elements(found: PartStatistics) -> list[ElementStatistics]:
    """Returns the evaluation elements for which a plot is drawn. Such an element has at least one
    value, and either a bound or two different values."""
    return [
        e
        for e in found.elements
        if e.n and (e.least is not None or e.most is not None or e.smallest != e.largest)
    ]


def statistics(found: PartStatistics, curves: Curves) -> Figure:
    """Returns one plot with the run charts and the histograms of all elements. If there are curves
    of parts, the plot also shows them, drawn over each other."""
    elements = shown_elements(found)
    heights = [ROW_IN] * len(elements) + [CURVES_IN] * bool(curves)
    figure = plt.figure(figsize=(WIDTH_IN, 0.4 + sum(heights or [1.0])), layout="constrained")
    grid = figure.add_gridspec(len(heights) or 1, 2, width_ratios=(3, 1), height_ratios=heights)
    for i, element in enumerate(elements):
        run_chart = figure.add_subplot(grid[i, 0])
        _draw_element(run_chart, figure.add_subplot(grid[i, 1], sharey=run_chart), element)
    if curves:
        draw_curves(figure.add_subplot(grid[-1, :]), curves)
    figure.suptitle(
        f"{found.title or found.source}: {found.good} of {found.parts} parts good",
        fontsize=10, x=0.02, ha="left", color=INK, parse_math=False,
    )  # fmt: skip
    plt.close(figure)
    return figure


def element(one: ElementStatistics) -> Figure:
    """Returns a plot with the run chart and the histogram of one evaluation element."""
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(WIDTH_IN, ROW_IN), width_ratios=(3, 1), sharey=True, layout="constrained"
    )
    _draw_element(left, right, one)
    plt.close(figure)
    return figure


def overlay(curves: Curves) -> Figure:
    """Returns a plot of the curves of the last parts, drawn over each other."""
    figure, ax = plt.subplots(figsize=(WIDTH_IN, CURVES_IN), layout="constrained")
    draw_curves(ax, curves)
    plt.close(figure)
    return figure


def _draw_element(run_chart: Axes, bars: Axes, one: ElementStatistics) -> None:
    """Draws the run chart of an evaluation element, which shows its values in the order of the
    parts. Draws the histogram of the values to the right of the run chart."""
    scale, unit = (MM, "mm") if one.unit == "m" else (1.0, one.unit)
    values = np.array([np.nan if v is None else v * scale for v in one.values])
    least, most = ((np.nan if b is None else b * scale) for b in (one.least, one.most))
    number = np.arange(1, len(values) + 1)
    beyond = (values < least) | (values > most)
    few = len(values) <= MARKED_MOST
    size = 3.0 if few else 1.2
    run_chart.plot(
        number, values, color=INK, linewidth=0.5 if few else 0.0, marker="o", markersize=size,
        markeredgewidth=0,
    )  # fmt: skip
    run_chart.plot(
        number[beyond], values[beyond], color=BAD_COLOUR, linewidth=0.0, marker="o",
        markersize=size + 1, markeredgewidth=0,
    )  # fmt: skip
    counts, edges = histogram([None if np.isnan(v) else float(v) for v in values])
    bars.barh(
        edges[:-1],
        counts,
        np.diff(edges),
        align="edge",
        color=FAINT,
        edgecolor=FAINT,
        linewidth=1.0,
    )
    for ax in (run_chart, bars):
        style(ax)
        for bound in (least, most):
            if not np.isnan(bound):
                ax.axhline(bound, color=BAD_COLOUR, linewidth=0.9, linestyle="--")
        if one.mean is not None:
            ax.axhline(one.mean * scale, color=GOOD_COLOUR, linewidth=0.9)
        ax.margins(y=0.12)
    run_chart.set_xlim(0.5, len(values) + 0.5)
    run_chart.set_xlabel("part")
    run_chart.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
    run_chart.set_ylabel(unit or "1")
    bars.set_xlabel("number of parts")
    bars.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    bars.tick_params(labelleft=False)
    cpk = "" if one.cpk is None else f", Cpk {plain(one.cpk.value)}"
    run_chart.set_title(
        f"{short(one.name)}{cpk}", fontsize=8, loc="left", color=INK, parse_math=False
    )


def draw_curves(ax: Axes, curves: Curves) -> None:
    """Draws the curves of parts, with the force over the travel. Curves of bad and aborted parts
    have another colour and are drawn over the others."""
    style(ax)
    for state, curve in sorted(curves, key=lambda one: one[0] != GOOD):
        travel, force = (np.array([point[i] for point in curve]) for i in (1, 2))
        colour = GOOD_COLOUR if state == GOOD else BAD_COLOUR
        ax.plot(travel * MM, force, color=colour, linewidth=0.8, alpha=0.6)
    last = max(max(point[1] for point in curve) for _, curve in curves) * MM
    # The range of the axis is the same as in the plot of a single part.
    ax.set_xlim(-0.15 * max(last, 1e-3), 1.08 * max(last, 1e-3))
    ax.set_xlabel("travel, mm")
    ax.set_ylabel("force, N")
    ax.set_title(f"The last {len(curves)} curves", fontsize=8, loc="left", color=INK)
