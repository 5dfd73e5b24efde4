"""Plots of a sweep: verdicts or peak forces over the swept parameters, or stability boundaries."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from forceaxis import objects
from forceaxis.drawing import AREA, INK, VERDICT, legend, plain_ticks, style
from forceaxis.experiments.points import SweepParameter
from forceaxis.experiments.run_result import Array
from forceaxis.experiments.sweep_result import PointOutcome, Sweep
from forceaxis.experiments.verdicts import VERDICTS, WORDS
from forceaxis.words import plain

# Key of AREA for a point whose run failed, and for a cell of the grid without a result.
FAILED = "failed"
# Verdicts of the cells of a grid, in the order of their numbers in the colour map.
KINDS = ("unstable", "stable", "not_met", "never_in_contact")
ISOLATED = "stands alone"  # label of an isolated point in the legend
MARKERS = (
    ("stable", "o", "stable"),
    ("unstable", "x", "unstable"),
    ("not_met", "s", "not met"),
    ("never_in_contact", "^", "never in contact"),
    ("", "v", "failed"),
)


def sweep(done: Sweep) -> Figure:
    """Returns the plot of a sweep over the first two swept parameters."""
    figure, ax = plt.subplots(figsize=(5.6, 4.2))
    style(ax)
    draw: Callable[[Figure, Axes, Sweep], str] = boundary_plot if done.plan.search else run_plot
    title = draw(figure, ax, done)
    if len(done.plan.axes) > 2:
        title += f"; all values of {', '.join(a.name for a in done.plan.axes[2:])} together"
    title += f"\n{Path(done.result.experiment).name}, {done.result.counts.runs} runs"
    in_newton(ax, done)
    for axis in (ax.xaxis, ax.yaxis):
        if axis.get_scale() == "log":
            plain_ticks(axis)
        else:
            axis.set_major_formatter(lambda value, _: plain(value, 6))
    figure.suptitle(title, fontsize=9, x=0.02, ha="left", color=INK, parse_math=False)
    figure.tight_layout(rect=(0, 0.05, 1, 1))
    plt.close(figure)
    return figure


def run_plot(figure: Figure, ax: Axes, done: Sweep) -> str:
    """Draws the verdicts over one or two parameters. Draws the peak forces instead if the
    experiment has no [verdict]. Returns the title."""
    if len(done.plan.axes) == 1:
        over_one(ax, done, done.columns[done.plan.axes[0].name], done.outcomes)
        return "Peak contact force"
    verdict, peak_N = verdicts_of(done.outcomes), peaks_of(done.outcomes)
    has_verdict = np.isin(verdict, VERDICTS)
    share = np.where(has_verdict, verdict == "stable", np.nan)
    two = done.plan.axes[:2]
    for axis, which in zip(two, "xy", strict=True):
        along(ax, which, axis, done)
    x, y = (done.columns[a.name] for a in two)
    if not all(a.values for a in two):
        if has_verdict.any():
            scatter_verdicts(ax, x, y, verdict)
            key_below(ax)
            return "Stability of random points"
        coloured(figure, ax, "peak force, N", ax.scatter(x, y, c=peak_N, s=14))
        return "Peak contact force of random points"
    edges = [cell_edges(a) for a in two]
    if not has_verdict.any():
        cells = averaged(done, peak_N)
        coloured(figure, ax, "peak force, N", ax.pcolormesh(*edges, cells, cmap="viridis"))
        return "Peak contact force"
    cells = averaged(done, share)
    if len(done.plan.axes) > 2:
        mesh = ax.pcolormesh(*edges, cells, cmap="RdYlGn", vmin=0, vmax=1)
        coloured(figure, ax, "share of stable runs", mesh)
        return "Share of stable runs"
    number = np.full(len(verdict), np.nan)
    for k, kind in enumerate(KINDS):
        number[verdict == kind] = k
    kinds = averaged(done, number)
    ax.set_facecolor(AREA[FAILED])
    colours = ListedColormap([AREA[kind] for kind in KINDS])
    # The edge of a cell has the colour of the cell, so that vector graphics show no gaps.
    ax.pcolormesh(
        *edges, kinds, cmap=colours, vmin=-0.5, vmax=3.5, edgecolors="face", linewidth=0.4
    )
    ax.add_collection(LineCollection(boundary_edges(cells, *edges), colors=INK, linewidths=1.4))
    single = mark_isolated(ax, done)
    shown = [kind for k, kind in enumerate(KINDS) if (kinds == k).any()]
    kinds_key(ax, [*shown, *[FAILED] * bool(np.isnan(kinds).any())], single)
    return "Stability map"


def verdicts_of(outcomes: Sequence[PointOutcome]) -> Array:
    """Returns the verdicts of the outcomes as an array (n,), with "" for a failed run."""
    return np.array([outcome.verdict for outcome in outcomes], dtype=str)


def peaks_of(outcomes: Sequence[PointOutcome]) -> Array:
    """Returns the peak contact forces of the outcomes in N as an array (n,), with nan for a failed
    run."""
    return np.array([outcome.peak_force_N for outcome in outcomes], dtype=float)


def mark_isolated(ax: Axes, done: Sweep) -> list[Artist]:
    """Draws a ring around each isolated point, and the verdicts of the further points around it.
    Returns the handles for the legend."""
    single = [np.array(list(point.values.values())) for point in done.result.alone]
    if not single:
        return []
    ax.plot(*np.transpose(single), "o", markersize=13, markerfacecolor="none", color=INK)
    label = ISOLATED + ("" if done.closer else ", `refine` looks closer")
    ring = plt.Line2D([], [], linestyle="", marker="o", markersize=8, markerfacecolor="none",
                      color=INK, label=label)  # fmt: skip
    if done.closer:
        x, y = np.array(list(done.closer)).T
        scatter_verdicts(ax, x, y, verdicts_of(list(done.closer.values())), size=12)
    return [ring]


def boundary_plot(figure: Figure, ax: Axes, done: Sweep) -> str:
    """Draws the stability boundary over one or two parameters. If the search has no other
    parameters, draws the runs of the search. Returns the title."""
    search = done.plan.search
    assert search is not None
    if not done.plan.axes:
        values = np.array([value for value, _ in done.search_runs])
        over_one(ax, done, values, [outcome for _, outcome in done.search_runs], search)
        if math.isfinite(last_stable := done.boundaries[0].stable):
            ax.axvline(last_stable, color=INK, linewidth=0.8, linestyle="--")
        return f"Search for the boundary in {search.name}"
    boundary = np.array([one.stable for one in done.boundaries])
    if len(done.plan.axes) > 1:
        two = done.plan.axes[:2]
        for axis, which in zip(two, "xy", strict=True):
            along(ax, which, axis, done)
        x, y = (done.columns[a.name] for a in two)
        if all(a.values for a in two):
            ax.set_facecolor(AREA[FAILED])
            drawn: Collection = ax.pcolormesh(
                *(cell_edges(a) for a in two), averaged(done, boundary)
            )
        else:
            drawn = ax.scatter(x, y, c=boundary, s=14)
        coloured(figure, ax, label_of(search.name, done), drawn)
        return f"Last stable {search.name}"
    along(ax, "x", done.plan.axes[0], done)
    along(ax, "y", search, done)
    x = done.columns[done.plan.axes[0].name]
    order = np.argsort(x)
    x, boundary = x[order], boundary[order]
    # True if the runs are stable below the boundary
    up = np.nansum([np.sign(b.unstable - b.stable) for b in done.boundaries]) >= 0
    edge = boundary.copy()
    for i, note in enumerate(done.boundaries[k].note for k in order):
        if note:  # Without a change of the verdict, one colour covers the whole range.
            edge[i] = search.high if note.startswith("no change: stable") == up else search.low
    below, above = (AREA[kind] for kind in (("stable", "unstable")[:: 1 if up else -1]))
    ax.set_facecolor(AREA[FAILED])
    ax.fill_between(x, search.low, edge, color=below, linewidth=0)
    ax.fill_between(x, edge, search.high, color=above, linewidth=0)
    ax.plot(x, boundary, color=INK, marker="o", markersize=3, linewidth=1.4)
    ax.set(xlim=(x[0], x[-1]), ylim=(search.low, search.high))
    kinds_key(ax, ["stable", "unstable", *[FAILED] * bool(np.isnan(edge).any())])
    return f"Last stable {search.name}"


def over_one(
    ax: Axes,
    done: Sweep,
    x: Array,
    outcomes: Sequence[PointOutcome],
    axis: SweepParameter | None = None,
) -> None:
    """Draws the peak force over one parameter, with a mark for each verdict. Failed runs are drawn
    at the force 0. `x`: values of the parameter. `axis`: the parameter, by default the first one of
    the sweep."""
    along(ax, "x", axis or done.plan.axes[0], done)
    order = np.argsort(x)
    verdict, peak_N = verdicts_of(outcomes), peaks_of(outcomes)
    ax.plot(x[order], peak_N[order], color=INK, linewidth=0.6, zorder=1)
    shown = np.where(np.isfinite(peak_N), peak_N, 0)
    failed = ~np.isfinite(peak_N)
    # True for each point without a verdict, if the experiment has no table [verdict]
    plain = ~np.isin(verdict, VERDICTS) & ~failed
    ax.scatter(x[plain], shown[plain], c=INK, marker=".", s=22)
    scatter_verdicts(ax, x[~plain], shown[~plain], np.where(failed, "", verdict)[~plain], size=22)
    ax.set_ylabel("peak contact force, N")
    ax.set_ylim(bottom=0)
    if not done.plan.search:
        for point in done.result.alone:
            at = x == point.values[done.plan.axes[0].name]
            ax.plot(x[at], peak_N[at], "o", markersize=12, markerfacecolor="none", color=INK,
                    label=ISOLATED)  # fmt: skip
    if ax.get_legend_handles_labels()[1]:
        key_below(ax)


def scatter_verdicts(ax: Axes, x: Array, y: Array, verdict: Array, size: int = 14) -> None:
    """Draws points with a mark for each verdict. The verdict of a failed run is an empty text."""
    for kind, marker, label in MARKERS:
        at = verdict == kind
        if at.any():
            ax.scatter(x[at], y[at], c=VERDICT[kind], marker=marker, s=size, label=label, zorder=3)


def along(ax: Axes, which: str, axis: SweepParameter, done: Sweep) -> None:
    """Sets the label and the scale of the plot axis `which` ("x" or "y") for a parameter."""
    getattr(ax, f"set_{which}label")(label_of(axis.name, done))
    if axis.log:
        getattr(ax, f"set_{which}scale")("log")


def label_of(name: str, done: Sweep) -> str:
    """Returns the label of a parameter: its name and its unit."""
    room, _, key = name.partition(".")
    unit = done.result.parameters[name]
    if room == "firmware":
        unit = str(objects.unit_in_words(objects.BY_NAME[key]))
    elif room == "verdict" and unit == "count":
        unit = "count of force" if key.startswith("force") else "encoder count"
    return f"{name}, {unit}" if unit else name


def in_newton(ax: Axes, done: Sweep) -> None:
    """Adds a scale in N if one axis of the plot is a force set-point in counts."""
    shown = [a.name for a in done.plan.axes[:2]]
    if len(shown) < 2 and done.plan.search:
        shown.append(done.plan.search.name)
    reading = done.converters.get("adc0")
    if "firmware.force_setpoint" not in shown or not reading or reading.unit != "N":
        return
    newton = reading.per_8_bit_count

    def to_newton(count: ArrayLike) -> ArrayLike:
        return np.asarray(count) * newton

    def to_count(force_N: ArrayLike) -> ArrayLike:
        return np.asarray(force_N) / newton

    if shown[0] == "firmware.force_setpoint":
        top = ax.secondary_xaxis("top", functions=(to_newton, to_count))
        top.set_xlabel("set-point, N", fontsize=8)
        top.tick_params(which="both", labelsize=8)
    else:
        right = ax.secondary_yaxis("right", functions=(to_newton, to_count))
        right.set_ylabel("set-point, N", fontsize=8)
        right.tick_params(which="both", labelsize=8)


def coloured(figure: Figure, ax: Axes, label: str, drawn: Collection) -> None:
    """Adds a colour bar with a label for the drawn values."""
    bar = figure.colorbar(drawn, ax=ax)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=8)


def key_below(ax: Axes, handles: Sequence[Artist] | None = None) -> None:
    """Draws the legend below the axes. `handles`: entries of the legend, by default all entries of
    the axes."""
    handles = handles or ax.get_legend_handles_labels()[0]
    figure = ax.figure
    assert isinstance(figure, Figure)
    legend(figure, handles=handles, loc="lower left", ncols=len(handles), columnspacing=1.2,
           handletextpad=0.5, bbox_to_anchor=(0.01, 0))  # fmt: skip


def kinds_key(ax: Axes, shown: Sequence[str], more: Sequence[Artist] = ()) -> None:
    """Draws a legend of the verdicts `shown` and of the further handles `more`."""
    order = (*VERDICTS, FAILED)
    handles = [
        Patch(color=AREA[kind], label=WORDS.get(kind, kind))
        for kind in sorted(shown, key=order.index)
    ]
    key_below(ax, [*handles, *more])


def cell_edges(axis: SweepParameter) -> Array:
    """Returns the n + 1 edges of the cells of a grid along one parameter. They are half-way between
    neighbouring values, on the scale of the parameter."""
    values = np.unique(axis.values)
    if axis.log:
        values = np.log(values)
    half = np.diff(values) / 2 if len(values) > 1 else np.array([0.5])
    edges = np.concatenate(([values[0] - half[0]], values[:-1] + half, [values[-1] + half[-1]]))
    if len(values) == 1:
        edges = np.array([values[0] - 0.5, values[0] + 0.5])
    return np.exp(edges) if axis.log else edges


def averaged(done: Sweep, values: Array) -> Array:
    """Returns the mean of the finite values of the points in each cell of a grid. Rows belong to
    values of the second parameter, and columns to values of the first."""
    places = [
        np.unique(done.columns[a.name], return_inverse=True)[1].ravel() for a in done.plan.axes[:2]
    ]
    shape = [int(p.max()) + 1 for p in places[::-1]]
    total, count = np.zeros(shape), np.zeros(shape)
    there = np.isfinite(values)
    at = places[1][there], places[0][there]
    np.add.at(total, at, values[there])
    np.add.at(count, at, 1)
    mean = np.full(shape, np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    return mean


def boundary_edges(cells: Array, x: Array, y: Array) -> list[list[tuple[float, float]]]:
    """Returns the sides between stable and unstable cells of a grid as line segments. `x` and `y`
    are the edges of the cells."""
    segments = []
    for i, j in np.argwhere(np.abs(np.diff(cells, axis=1)) == 1):
        segments.append([(x[j + 1], y[i]), (x[j + 1], y[i + 1])])
    for i, j in np.argwhere(np.abs(np.diff(cells, axis=0)) == 1):
        segments.append([(x[j], y[i + 1]), (x[j + 1], y[i + 1])])
    return segments
