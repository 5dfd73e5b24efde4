"""Traces as figures, in the form of the thesis: one signal below the other over time."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

INK = "#1b3a5b"
WANTED, GOT = "#3f7f5f", "#c0562b"
THIN = {"linewidth": 0.9}

# What the last word of a column's name is measured in, and the factor to show it by.
UNITS = {
    "position": ("mm", 1e3),
    "deflection": ("mm", 1e3),
    "velocity": ("mm/s", 1e3),
    "force": ("N", 1),
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
            ax.legend(loc="upper right", fontsize=7, frameon=False)
    axes[-1, 0].set_xlabel("time, s")
    axes[0, 0].set_title(done.title, fontsize=9, loc="left", color=INK)
    figure.tight_layout()
    plt.close(figure)
    return figure


def comparison(examined):
    """What [expect] wants of peak, final value and settling (green) over the trace, all below."""
    from forceaxis import usertests

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
    response.set_title(examined.run.title, fontsize=9, loc="left", color=INK, pad=14)
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
    ax.tick_params(labelsize=8)
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
