"""Figures of a sweep: verdicts or peak forces over its parameters, and boundaries."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from forceaxis import objects
from forceaxis.drawing import AREA, INK, VERDICT, legend, plain_ticks, style
from forceaxis.experiments.points import SweepParameter
from forceaxis.experiments.run_result import Array
from forceaxis.experiments.sweep_result import Sweep
from forceaxis.experiments.verdicts import VERDICTS, WORDS
from forceaxis.words import plain

FAILED = AREA["failed"]
# Kinds of cells, in the order of their numbers in a map.
KINDS = ("unstable", "stable", "not_met", "never_in_contact")
MARKERS = (
    ("stable", "o", "stable"),
    ("unstable", "x", "unstable"),
    ("not_met", "s", "not met"),
    ("never_in_contact", "^", "never in contact"),
    ("", "v", "failed"),
)


def sweep(done: Sweep) -> Figure:
    """Figure of a sweep over its first two parameters."""
    figure, ax = plt.subplots(figsize=(5.6, 4.2))
    style(ax)
    draw: Callable[[Figure, Axes, Sweep], str] = boundary_plot if done.search else run_plot
    title = draw(figure, ax, done)
    if len(done.axes) > 2:
        title += f"; all values of {', '.join(a.name for a in done.axes[2:])} together"
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
    """Draws verdicts (or peak forces if there are none) over one or two parameters. Returns a text
    about the content."""
    verdict, peak = done.columns["verdict"], done.columns["peak_force_N"]
    judged = np.isin(verdict, VERDICTS)
    share = np.where(judged, verdict == "stable", np.nan)
    if len(done.axes) == 1:
        x = done.columns[done.axes[0].name]
        over_one(ax, done, x, verdict, peak)
        return "Peak contact force"
    two = done.axes[:2]
    for axis, which in zip(two, "xy", strict=True):
        along(ax, which, axis, done)
    x, y = (done.columns[a.name] for a in two)
    if not all(a.values for a in two):
        if judged.any():
            scatter_verdicts(ax, x, y, verdict)
            key_below(ax)
            return "Stability of random points"
        coloured(figure, ax, "peak force, N", ax.scatter(x, y, c=peak, s=14))
        return "Peak contact force of random points"
    edges = [cell_edges(a) for a in two]
    if not judged.any():
        cells = averaged(done, peak)
        coloured(figure, ax, "peak force, N", ax.pcolormesh(*edges, cells, cmap="viridis"))
        return "Peak contact force"
    cells = averaged(done, share)
    if len(done.axes) > 2:
        mesh = ax.pcolormesh(*edges, cells, cmap="RdYlGn", vmin=0, vmax=1)
        coloured(figure, ax, "share of stable runs", mesh)
        return "Share of stable runs"
    number = np.full(len(verdict), np.nan)
    for k, kind in enumerate(KINDS):
        number[verdict == kind] = k
    kinds = averaged(done, number)
    ax.set_facecolor(FAILED)
    colours = ListedColormap([AREA[kind] for kind in KINDS])
    # The edge of a cell has the colour of the cell, so that vector graphics show no gaps.
    ax.pcolormesh(
        *edges, kinds, cmap=colours, vmin=-0.5, vmax=3.5, edgecolors="face", linewidth=0.4
    )
    ax.add_collection(LineCollection(boundary_edges(cells, *edges), colors=INK, linewidths=1.4))
    single = mark_alone(ax, done)
    shown = [kind for k, kind in enumerate(KINDS) if (kinds == k).any()]
    kinds_key(ax, [*shown, *["failed"] * bool(np.isnan(kinds).any())], single)
    return "Stability map"


def mark_alone(ax: Axes, done: Sweep) -> list[Artist]:
    """Draws a ring around each isolated cell, and the points around it that were also run. Returns
    the handles for the legend."""
    single = [np.array(list(point.values.values())) for point in done.result.alone]
    if not single:
        return []
    ring: dict[str, Any] = {"marker": "o", "markerfacecolor": "none", "color": INK, "linestyle": ""}
    ax.plot(*np.transpose(single), markersize=13, **ring)
    label = "stands alone" + ("" if done.closer else ", `refine` looks closer")
    handles: list[Artist] = [plt.Line2D([], [], label=label, **ring, markersize=8)]
    if done.closer:
        x, y = (done.closer[a.name] for a in done.axes)
        scatter_verdicts(ax, x, y, done.closer["verdict"], size=12)
    return handles


def boundary_plot(figure: Figure, ax: Axes, done: Sweep) -> str:
    """Draws the boundary over the first parameters, or the runs of a search without further
    parameters."""
    search = done.search
    assert search is not None
    if not done.axes:
        values = np.array([v for v, _ in done.runs])
        verdict = np.array([o.get("verdict", "") for _, o in done.runs])
        peak = np.array([o.get("peak_force_N", np.nan) for _, o in done.runs])
        over_one(ax, done, values, verdict, peak, search)
        if np.isfinite(done.columns["boundary"][0]):
            ax.axvline(done.columns["boundary"][0], color=INK, linewidth=0.8, linestyle="--")
        return f"Search for the boundary in {search.name}"
    boundary, beyond = done.columns["boundary"], done.columns["unstable_at"]
    if len(done.axes) > 1:
        two = done.axes[:2]
        for axis, which in zip(two, "xy", strict=True):
            along(ax, which, axis, done)
        x, y = (done.columns[a.name] for a in two)
        if all(a.values for a in two):
            ax.set_facecolor(FAILED)
            drawn: Any = ax.pcolormesh(*(cell_edges(a) for a in two), averaged(done, boundary))
        else:
            drawn = ax.scatter(x, y, c=boundary, s=14)
        coloured(figure, ax, label_of(search.name, done), drawn)
        return f"Last stable {search.name}"
    along(ax, "x", done.axes[0], done)
    along(ax, "y", search, done)
    x = done.columns[done.axes[0].name]
    order = np.argsort(x)
    x, boundary, beyond = x[order], boundary[order], beyond[order]
    note = done.columns["note"][order]
    # Without a change of verdict, the column has one colour.
    edge = np.where(np.isfinite(boundary), boundary, np.nan)
    up = np.nansum(np.sign(beyond - boundary)) >= 0  # stable below
    for i, text in enumerate(note):
        if text:
            edge[i] = search.high if text.startswith("no change: stable") == up else search.low
    below, above = (AREA[kind] for kind in (("stable", "unstable")[:: 1 if up else -1]))
    ax.set_facecolor(FAILED)
    ax.fill_between(x, search.low, edge, color=below, linewidth=0)
    ax.fill_between(x, edge, search.high, color=above, linewidth=0)
    ax.plot(x, boundary, color=INK, marker="o", markersize=3, linewidth=1.4)
    ax.set(xlim=(x[0], x[-1]), ylim=(search.low, search.high))
    kinds_key(ax, ["stable", "unstable", *["failed"] * bool(np.isnan(edge).any())])
    return f"Last stable {search.name}"


def over_one(
    ax: Axes,
    done: Sweep,
    x: Array,
    verdict: Array,
    peak: Array,
    axis: SweepParameter | None = None,
) -> None:
    """Draws the peak force over one parameter, with a mark for each verdict; failed runs are at the
    lower edge."""
    along(ax, "x", axis or done.axes[0], done)
    order = np.argsort(x)
    ax.plot(x[order], peak[order], color=INK, linewidth=0.6, zorder=1)
    shown = np.where(np.isfinite(peak), peak, 0)
    judged = np.isin(verdict, VERDICTS)
    failed = ~np.isfinite(peak)
    plain = ~judged & ~failed  # no [verdict]
    ax.scatter(x[plain], shown[plain], c=INK, marker=".", s=22)
    scatter_verdicts(ax, x[~plain], shown[~plain], np.where(failed, "", verdict)[~plain], size=22)
    ax.set_ylabel("peak contact force, N")
    ax.set_ylim(bottom=0)
    if not done.search:
        for point in done.result.alone:
            at = x == point.values[done.axes[0].name]
            ax.plot(x[at], peak[at], "o", markersize=12, markerfacecolor="none", color=INK,
                    label="stands alone")  # fmt: skip
    if ax.get_legend_handles_labels()[1]:
        key_below(ax)


def scatter_verdicts(ax: Axes, x: Array, y: Array, verdict: Array, size: int = 14) -> None:
    """Draws points with a mark for each verdict; "" stands for a failed run."""
    for kind, marker, label in MARKERS:
        at = verdict == kind
        if at.any():
            ax.scatter(x[at], y[at], c=VERDICT[kind], marker=marker, s=size, label=label, zorder=3)


def along(ax: Axes, which: str, axis: SweepParameter, done: Sweep) -> None:
    """Sets label and scale of one axis of the figure."""
    getattr(ax, f"set_{which}label")(label_of(axis.name, done))
    if axis.log:
        getattr(ax, f"set_{which}scale")("log")


def label_of(name: str, done: Sweep) -> str:
    """A parameter with its unit; for a count also the counted quantity."""
    room, _, key = name.partition(".")
    unit = done.result.parameters[name]
    if room == "firmware":
        unit = str(objects.unit_in_words(objects.BY_NAME[key]))
    elif room == "verdict" and unit == "count":
        unit = "count of force" if key.startswith("force") else "encoder count"
    return f"{name}, {unit}" if unit else name


def in_newton(ax: Axes, done: Sweep) -> None:
    """Adds a second scale with the force set-point in N."""
    shown = [a.name for a in done.axes[:2]]
    if len(shown) < 2 and done.search:
        shown.append(done.search.name)
    reading = done.converters.get("adc0")
    if "firmware.force_setpoint" not in shown or not reading or reading.unit != "N":
        return
    newton = reading.per_8_bit_count
    scale: dict[str, Any] = {
        "functions": (lambda count: count * newton, lambda force: force / newton)
    }
    if shown[0] == "firmware.force_setpoint":
        other = ax.secondary_xaxis("top", **scale)
        other.set_xlabel("set-point, N", fontsize=8)
    else:
        other = ax.secondary_yaxis("right", **scale)
        other.set_ylabel("set-point, N", fontsize=8)
    other.tick_params(which="both", labelsize=8)


def coloured(figure: Figure, ax: Axes, label: str, drawn: Any) -> None:
    """Adds a colour bar."""
    bar = figure.colorbar(drawn, ax=ax)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=8)


def key_below(ax: Axes, handles: Sequence[Artist] | None = None) -> None:
    """Draws the legend below the axes, as in a figure of a trace."""
    handles = handles or ax.get_legend_handles_labels()[0]
    figure = ax.figure
    assert isinstance(figure, Figure)
    legend(figure, handles=handles, loc="lower left", ncols=len(handles), columnspacing=1.2,
           handletextpad=0.5, bbox_to_anchor=(0.01, 0))  # fmt: skip


def kinds_key(ax: Axes, shown: Sequence[str], more: Sequence[Artist] = ()) -> None:
    """A legend of the visible kinds of cells, followed by further handles."""
    order = (*VERDICTS, "failed")
    handles = [
        Patch(color=AREA[kind], label=WORDS.get(kind, kind))
        for kind in sorted(shown, key=order.index)
    ]
    key_below(ax, [*handles, *more])


def cell_edges(axis: SweepParameter) -> Array:
    """The edges of the cells of a grid: half-way between its values, in the scale of the
    parameter."""
    values = np.unique(axis.values)
    if axis.log:
        values = np.log(values)
    half = np.diff(values) / 2 if len(values) > 1 else np.array([0.5])
    edges = np.concatenate(([values[0] - half[0]], values[:-1] + half, [values[-1] + half[-1]]))
    if len(values) == 1:
        edges = np.array([values[0] - 0.5, values[0] + 0.5])
    return np.exp(edges) if axis.log else edges


def averaged(done: Sweep, values: Array) -> Array:
    """Means of the available values; rows by the second parameter, columns by the first."""
    places = [
        np.unique(done.columns[a.name], return_inverse=True)[1].ravel() for a in done.axes[:2]
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
    """The sides between stable and unstable cells, as segments."""
    segments = []
    for i, j in np.argwhere(np.abs(np.diff(cells, axis=1)) == 1):
        segments.append([(x[j + 1], y[i]), (x[j + 1], y[i + 1])])
    for i, j in np.argwhere(np.abs(np.diff(cells, axis=0)) == 1):
        segments.append([(x[j], y[i + 1]), (x[j + 1], y[i + 1])])
    return segments
