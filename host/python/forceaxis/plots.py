"""Traces as figures, in the form of the thesis: one signal below the other over time."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

INK = "#1b3a5b"
THIN = {"linewidth": 0.9}

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
            ax.legend(loc="upper right", fontsize=7, frameon=False)
    axes[-1, 0].set_xlabel("time, s")
    axes[0, 0].set_title(done.title, fontsize=9, loc="left", color=INK)
    figure.tight_layout()
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
