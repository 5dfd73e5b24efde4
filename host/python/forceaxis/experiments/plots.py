"""Traces as figures, in the form of the thesis: one signal below the other over time."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

INK = "#1b3a5b"
WANTED, GOT = "#3f7f5f", "#c0562b"
THIN = {"linewidth": 0.9}
STABLE, UNSTABLE, UNTOUCHED, FAILED = "#b9d8cf", "#f0c3a8", "#f6e6c9", "#c9c9c9"

# What the last word of a column's name is measured in, and the factor to show it by.
UNITS = {
    "position": ("mm", 1e3),
    "deflection": ("mm", 1e3),
    "velocity": ("mm/s", 1e3),
    "acceleration": ("m/s$^2$", 1),
    "force": ("N", 1),
    "spring_force_rate": ("N/s", 1),
    "spring_force": ("N", 1),
    "current": ("A", 1),
    "tach": ("V", 1),
    "voltage": ("V", 1),
    "command": ("V", 1),
    "encoder": ("count", 1),
    "adc0": ("count", 1),
    "adc1": ("count", 1),
    "dac": ("code", 1),
}


def rows_of(done):
    """The rows of [plot], or position and force where the experiment names none."""
    if "rows" in done.plot:
        return done.plot["rows"]
    return [["encoder"], ["adc0"], ["dac"]]


def trace(done, width=7.2):
    """Figure of a run's rows over [plot] from_s .. to_s, within the run."""
    rows = rows_of(done)
    time = done.columns["time_s"]
    start, stop = done.plot.get("from_s", time[0]), done.plot.get("to_s", time[-1])
    shown = (time >= start) & (time <= stop)
    if not shown.any():  # an override made the run shorter than the plot
        shown[:] = True
    figure, axes = plt.subplots(
        len(rows), 1, sharex=True, figsize=(width, 0.55 + 1.45 * len(rows)), squeeze=False
    )
    for ax, names in zip(axes[:, 0], rows, strict=True):
        style(ax)
        for name in names:
            unit, factor = UNITS.get(name.rpartition(".")[2], ("", 1))
            values = done.columns[name][shown] * factor
            stepped = {"drawstyle": "steps-post"} if values.dtype.kind in "iu" else {}
            ax.plot(time[shown], values, label=name, **THIN, **stepped)
        ax.set_ylabel(unit if len(names) > 1 else f"{names[0]}\n{unit}", fontsize=8)
        if len(names) > 1:
            where = {"loc": "lower right", "bbox_to_anchor": (1, 0.95), "ncols": len(names)}
            ax.legend(**where, fontsize=7, frameon=False)
    axes[-1, 0].set_xlabel("time, s")
    axes[0, 0].set_title(done.title, fontsize=9, loc="left", color=INK, parse_math=False)
    figure.tight_layout()
    plt.close(figure)
    return figure


def comparison(examined):
    """What [expect] wants of peak, final value and settling (green) over the trace, all below."""
    from forceaxis.experiments import regression as usertests

    measured, wanted, got = examined.measured, examined.expect.wanted, examined.measured.values
    columns = examined.run.columns
    time = columns["time_s"]
    forces = [f"{name}.force" for name in measured.contacts]
    rows = [[measured.signal]]
    if "peak_force_N" in wanted and forces != rows[0]:
        rows.append(forces)
    table = usertests.comparison(examined.checks)
    heights = [2.4] * len(rows) + [0.1 + 0.145 * len(table.splitlines())]
    figure, axes = plt.subplots(
        len(heights),
        1,
        figsize=(8.4, 0.6 + sum(heights)),
        height_ratios=heights,
        layout="constrained",
    )
    for ax, names in zip(axes, rows, strict=False):
        style(ax)
        unit, factor = UNITS.get(names[0].rpartition(".")[2], ("", 1))
        for name in names:
            ax.plot(time, columns[name] * factor, label=name, alpha=0.75, **THIN)
        ax.set_ylabel(f"{names[0]}\n{unit}" if len(names) == 1 else unit, fontsize=8)
        ax.set_xlim(time[0], time[-1])
        if len(names) > 1:
            ax.legend(fontsize=7, frameon=False, loc="lower right")
    response, contact = axes[0], axes[len(rows) - 1]
    contact.set_xlabel("time, s", fontsize=8)
    begin, end = measured.from_s, time[-1]
    factor = UNITS.get(measured.signal.rpartition(".")[2], ("", 1))[1]

    def level(ax, key, start, factor):
        """The range wanted of a height, from `start` to the end, and the height that came out."""
        expected = wanted.get(key)
        if expected is None:
            return
        view = ax.get_ylim()
        low = expected.low * factor if expected.low > -np.inf else view[0]
        high = expected.high * factor if expected.high < np.inf else view[1]
        ax.fill_between((start, end), low, high, color=WANTED, alpha=0.3, linewidth=0, zorder=3)
        edges = [e for e in (low, high) if e not in view]
        ax.hlines(edges, start, end, color=WANTED, linewidth=0.8, zorder=3)
        ax.hlines(got[key] * factor, start, end, color=GOT, linestyle="--", linewidth=1.3, zorder=4)
        ax.annotate(
            key, (1, (low + high) / 2), (4, 0), xycoords=("axes fraction", "data"),
            va="bottom" if key == "peak_force_N" else "top",  # the two are often close
            textcoords="offset points", fontsize=7, color=WANTED, annotation_clip=False,
        )  # fmt: skip

    level(response, "final_value", end - measured.final_s, factor)
    level(contact, "peak_force_N", time[0], 1)
    if "settle_s" in wanted:
        edges = [(measured.final + side * measured.width) * factor for side in (-1, 1)]
        response.hlines(edges, begin, end, color="#5d6874", linestyle=":", linewidth=1, zorder=3)
        if isinstance(wanted["settle_s"], usertests.Number):
            low, high = begin + max(wanted["settle_s"].low, 0), begin + wanted["settle_s"].high
            low, high = min(low, end), min(high, end)
            response.axvspan(low, high, color=WANTED, alpha=0.3, linewidth=0.8, zorder=3)
            response.annotate(
                "settle_s", ((low + high) / 2, 1), (0, 2), xycoords=("data", "axes fraction"),
                textcoords="offset points", fontsize=7, color=WANTED, ha="center",
            )  # fmt: skip
        if isinstance(got["settle_s"], float):
            response.axvline(
                begin + got["settle_s"], color=GOT, linestyle="--", linewidth=1.3, zorder=4
            )
    response.set_title(
        examined.run.title, fontsize=9, loc="left", color=INK, parse_math=False, pad=14
    )
    figure.legend(
        handles=[
            plt.Rectangle((0, 0), 1, 1, color=WANTED, alpha=0.4, label="expected"),
            plt.Line2D([], [], color=GOT, linestyle="--", linewidth=1.3, label="obtained"),
            plt.Line2D([], [], color="#5d6874", linestyle=":", linewidth=1, label="settling band"),
        ],
        fontsize=7, frameon=False, ncols=3, loc="upper right",
    )  # fmt: skip
    axes[-1].axis("off")
    text = axes[-1].text(
        0, 1, table, family="monospace", fontsize=7.5, va="top", transform=axes[-1].transAxes
    )
    text.set_in_layout(False)  # a wide table must not squeeze the curves
    plt.close(figure)
    return figure


def style(ax):
    """Light grid, no box."""
    ax.grid(True, linewidth=0.3, color="#c8d0d8")
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(which="both", labelsize=8)
    ax.set_prop_cycle(color=[INK, "#c0562b", "#3f7f5f", "#8a5fa8"])


def plateau(curves, wanted, label):
    """Score over each constant, scaled to its fitted value.

    curves: {name: [[ratio, score], ...]}; wanted: the fitted score.
    """
    figure, ax = plt.subplots(figsize=(6.4, 2.8))
    style(ax)
    for name, pairs in curves.items():
        ratio, score = np.transpose(pairs)
        ax.plot(ratio * 100, score, marker="o", markersize=3, label=name, **THIN)
    ax.axhline(wanted, color="#999999", linewidth=0.6)
    ax.set_xlabel("constant, % of its fitted value")
    ax.set_ylabel(label)
    ax.legend(fontsize=7, frameon=False)
    figure.tight_layout()
    plt.close(figure)
    return figure


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
    # What never touched is not held, so it is unstable by the word; the map tells it apart.
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
    # Without a change the whole column is of one kind; it is drawn as such.
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


def contact_maps(maps, gains, gaps):
    """Which runs cycle, over the initial gap and the gain as a part of the linear limit."""
    figure, axes = plt.subplots(1, len(maps), sharey=True, figsize=(9.4, 3.6))
    columns, rows = np.meshgrid(np.arange(len(gaps)), gains)
    for ax, m in zip(axes, maps, strict=True):
        style(ax)
        ax.scatter(columns[m.cycles], rows[m.cycles], s=16, color="#c0562b", label="cycles")
        ax.scatter(
            columns[~m.cycles], rows[~m.cycles], s=16, facecolor="none", edgecolor=INK,
            linewidth=0.8, label="settles",
        )  # fmt: skip
        ax.axhline(1, color="#555555", linewidth=0.9, linestyle="--")
        ax.set_title(m.title, fontsize=8, loc="left", color=INK, parse_math=False)
        ax.set_xticks(range(0, len(gaps), 2), [f"{gap * 1e3:g}" for gap in gaps[::2]])
        ax.set_xlabel("initial gap, mm", fontsize=8)
    axes[0].set_ylabel("force gain / linear limit", fontsize=8)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="lower left", ncols=2, fontsize=7, frameon=False
    )
    figure.tight_layout(rect=(0, 0.04, 1, 1))
    plt.close(figure)
    return figure
