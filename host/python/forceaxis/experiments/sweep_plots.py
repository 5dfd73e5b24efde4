"""Figures of a sweep: verdicts or peak forces over its parameters, and boundaries."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from forceaxis.drawing import INK

STABLE, UNSTABLE, UNTOUCHED, FAILED = "#b9d8cf", "#f0c3a8", "#f6e6c9", "#c9c9c9"


def sweep(done):
    """Figure of a sweep, by the first two of its parameters."""
    figure, ax = plt.subplots(figsize=(6.4, 4.4))
    draw = boundary_plot if done.search else run_plot
    title = draw(figure, ax, done)
    if len(done.axes) > 2:
        title += f"; all values of {', '.join(a.name for a in done.axes[2:])} together"
    title += f"\n{done.summary['experiment']}, {done.summary['counts']['runs']} runs"
    ax.set_title(title, fontsize=9, loc="left", color=INK, parse_math=False)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(which="both", labelsize=8)
    figure.tight_layout()
    plt.close(figure)
    return figure


def run_plot(figure, ax, done):
    """Verdicts (or peak forces without them) over one or two parameters. Returns what it shows."""
    verdict, peak = done.columns["verdict"], done.columns["peak_force_N"]
    judged = np.isin(verdict, ("stable", "unstable"))
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
    # A run without contact fails contact_held, so its verdict is unstable; the map marks it.
    untouched = (verdict == "unstable") & (peak == 0) & bool((peak > 0).any())
    kinds = averaged(done, np.where(untouched, 2, share))
    ax.set_facecolor(FAILED)
    colours = ListedColormap([UNSTABLE, STABLE, UNTOUCHED])
    ax.pcolormesh(*edges, kinds, cmap=colours, vmin=-0.5, vmax=2.5)
    ax.add_collection(LineCollection(boundary_edges(cells, *edges), colors=INK, linewidths=1.4))
    legend(ax, (kinds == 1).any(), (kinds == 0).any(), untouched.any(), np.isnan(kinds).any())
    return "Stability map"


def boundary_plot(figure, ax, done):
    """The boundary over the first parameters, or the runs of a lone search."""
    search = done.search
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
            drawn = ax.pcolormesh(*(cell_edges(a) for a in two), averaged(done, boundary))
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
    # Without a change of verdict the whole column has one colour.
    edge = np.where(np.isfinite(boundary), boundary, np.nan)
    up = np.nansum(np.sign(beyond - boundary)) >= 0  # stable below
    for i, text in enumerate(note):
        if text:
            edge[i] = search.high if ("unstable" not in text) == up else search.low
    below, above = (STABLE, UNSTABLE) if up else (UNSTABLE, STABLE)
    ax.set_facecolor(FAILED)
    ax.fill_between(x, search.low, edge, color=below, linewidth=0)
    ax.fill_between(x, edge, search.high, color=above, linewidth=0)
    ax.plot(x, boundary, color=INK, marker="o", markersize=3, linewidth=1.4)
    ax.set(xlim=(x[0], x[-1]), ylim=(search.low, search.high))
    legend(ax, True, True, False, np.isnan(edge).any())
    return f"Last stable {search.name}"


def over_one(ax, done, x, verdict, peak, axis=None):
    """Peak force over one parameter, marked by verdict; failed runs along the foot."""
    along(ax, "x", axis or done.axes[0], done)
    order = np.argsort(x)
    ax.plot(x[order], peak[order], color=INK, linewidth=0.6, zorder=1)
    kinds = (("stable", "#2f8f78", "o"), ("unstable", "#c0562b", "x"), ("", INK, "."))
    for kind, colour, marker in kinds:
        at = (verdict == kind) & np.isfinite(peak)
        if at.any():
            ax.scatter(x[at], peak[at], c=colour, marker=marker, s=22, label=kind or None)
    failed = ~np.isfinite(peak)
    if failed.any():
        foot = np.zeros(failed.sum())
        ax.scatter(x[failed], foot, c="#777777", marker="v", s=22, label="failed")
    ax.set_ylabel("peak contact force, N")
    ax.set_ylim(bottom=0)
    ax.grid(True, linewidth=0.3, color="#c8d0d8")
    if ax.get_legend_handles_labels()[1]:
        ax.legend(fontsize=7, frameon=False)


def scatter_verdicts(ax, x, y, verdict):
    """Points by verdict."""
    for kind, colour, marker in (("stable", "#2f8f78", "o"), ("unstable", "#c0562b", "x")):
        at = verdict == kind
        ax.scatter(x[at], y[at], c=colour, marker=marker, s=14, label=kind)
    failed = verdict == ""
    if failed.any():
        ax.scatter(x[failed], y[failed], c="#777777", marker="v", s=14, label="failed")
    ax.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1), frameon=False)


def along(ax, which, axis, done):
    """Label and scale of one side of the figure."""
    getattr(ax, f"set_{which}label")(label_of(axis.name, done))
    if axis.log:
        getattr(ax, f"set_{which}scale")("log")


def label_of(name, done):
    """A parameter with its unit."""
    unit = done.summary["parameters"][name]
    return f"{name}, {unit}" if unit else name


def coloured(figure, ax, label, drawn):
    """A colour bar."""
    figure.colorbar(drawn, ax=ax, label=label)


def legend(ax, *shown):
    """The kinds of cells that are shown, beside the map."""
    kinds = zip(
        shown,
        (STABLE, UNSTABLE, UNTOUCHED, FAILED),
        ("stable", "unstable", "no contact", "failed"),
        strict=True,
    )
    ax.legend(
        handles=[Patch(color=colour, label=label) for at, colour, label in kinds if at],
        fontsize=8, loc="upper left", bbox_to_anchor=(1, 1), frameon=False,
    )  # fmt: skip


def cell_edges(axis):
    """Where the cells of a grid's values meet: half-way, on the axis's own scale."""
    values = np.unique(axis.values)
    if axis.log:
        values = np.log(values)
    half = np.diff(values) / 2 if len(values) > 1 else np.array([0.5])
    edges = np.concatenate(([values[0] - half[0]], values[:-1] + half, [values[-1] + half[-1]]))
    if len(values) == 1:
        edges = np.array([values[0] - 0.5, values[0] + 0.5])
    return np.exp(edges) if axis.log else edges


def averaged(done, values):
    """Rows by the second parameter, columns by the first: the mean of what is there."""
    places = [
        np.unique(done.columns[a.name], return_inverse=True)[1].ravel() for a in done.axes[:2]
    ]
    shape = [int(p.max()) + 1 for p in places[::-1]]
    total, count = np.zeros(shape), np.zeros(shape)
    there = np.isfinite(values)
    at = places[1][there], places[0][there]
    np.add.at(total, at, values[there])
    np.add.at(count, at, 1)
    return np.divide(total, count, out=np.full(shape, np.nan), where=count > 0)


def boundary_edges(cells, x, y):
    """The sides at which a stable and an unstable cell meet, as segments."""
    segments = []
    for i, j in np.argwhere(np.abs(np.diff(cells, axis=1)) == 1):
        segments.append([(x[j + 1], y[i]), (x[j + 1], y[i + 1])])
    for i, j in np.argwhere(np.abs(np.diff(cells, axis=0)) == 1):
        segments.append([(x[j], y[i + 1]), (x[j + 1], y[i + 1])])
    return segments
