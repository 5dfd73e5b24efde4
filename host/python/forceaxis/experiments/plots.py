"""Traces as figures, in the form of the thesis: one signal below the other over time."""

import matplotlib.pyplot as plt
import numpy as np

from forceaxis.drawing import GOT, INK, THIN, WANTED, finish, style

# Unit and factor of a column, by the last part of its name.
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


def unit_of(name, units=None):
    """(unit, factor) that a column is shown in; units: those of traced objects."""
    if units and name in units:
        return units[name], 1
    return UNITS.get(name.rpartition(".")[2], ("", 1))


def trace(time_s, rows, title, width=7.2, units=None, names=None, setpoint_N=None):
    """Figure of rows of signals over time; rows: [{name: values}], in the units of the trace.

    units: of columns that are objects; names: of their values, for a row of its own. setpoint_N: a
    line in each row of forces of the model.
    """
    figure, axes = plt.subplots(
        len(rows), 1, sharex=True, figsize=(width, 0.55 + 1.45 * len(rows)), squeeze=False
    )
    for ax, row in zip(axes[:, 0], rows, strict=True):
        style(ax)
        for name, values in row.items():
            unit, factor = unit_of(name, units)
            if len(row) == 1 and (known := (names or {}).get(name)):
                met, values = np.unique(values, return_inverse=True)
                ax.set_yticks(range(len(met)), [known.get(int(v), str(v)) for v in met])
            stepped = {"drawstyle": "steps-post"} if (values * factor).dtype.kind in "iu" else {}
            ax.plot(time_s, values * factor, label=name, **THIN, **stepped)
        if setpoint_N is not None and unit == "N":
            ax.axhline(setpoint_N, color=WANTED, linestyle="--", linewidth=0.8, zorder=1)
            ax.annotate(
                "set-point", (1, setpoint_N), (2, 0), xycoords=("axes fraction", "data"),
                textcoords="offset points", fontsize=6, color=WANTED, va="center",
            )  # fmt: skip
        ax.set_ylabel(unit if len(row) > 1 else f"{next(iter(row))}\n{unit}", fontsize=8)
        if len(row) > 1:
            where = {"loc": "lower right", "bbox_to_anchor": (1, 0.95), "ncols": len(row)}
            ax.legend(**where, fontsize=7, frameon=False)
    axes[-1, 0].set_xlabel("time, s")
    finish(figure, axes[0, 0], title)
    return figure


def comparison(time_s, rows, levels, settling, table, title):
    """Figure of the expected values (green) over the obtained ones, with a table of both below.

    rows: [{name: values}], the response first. levels: (row, name, from_s, low, high, obtained) of
    each height that is expected, in the units of the trace. settling: None, or (from_s, the two
    edges of the band, the expected times or None, the obtained time or None), times from from_s on.
    """
    heights = [2.4] * len(rows) + [0.1 + 0.145 * len(table.splitlines())]
    figure, axes = plt.subplots(
        len(heights),
        1,
        figsize=(8.4, 0.6 + sum(heights)),
        height_ratios=heights,
        layout="constrained",
    )
    for ax, row in zip(axes, rows, strict=False):
        style(ax)
        for name, values in row.items():
            unit, factor = unit_of(name)
            ax.plot(time_s, values * factor, label=name, alpha=0.75, **THIN)
        ax.set_ylabel(f"{name}\n{unit}" if len(row) == 1 else unit, fontsize=8)
        ax.set_xlim(time_s[0], time_s[-1])
        if len(row) > 1:
            ax.legend(fontsize=7, frameon=False, loc="lower right")
    axes[len(rows) - 1].set_xlabel("time, s", fontsize=8)
    for row, *level in levels:
        mark_level(axes[row], unit_of(next(iter(rows[row])))[1], time_s[-1], *level)
    if settling:
        mark_settling(axes[0], unit_of(next(iter(rows[0])))[1], time_s[-1], *settling)
    axes[0].set_title(title, fontsize=9, loc="left", color=INK, parse_math=False, pad=14)
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


def mark_level(ax, factor, end, name, start, low, high, obtained):
    """The range expected of a height, from `start` to the end, and the obtained one."""
    view = ax.get_ylim()
    low = low * factor if low > -np.inf else view[0]
    high = high * factor if high < np.inf else view[1]
    ax.fill_between((start, end), low, high, color=WANTED, alpha=0.3, linewidth=0, zorder=3)
    edges = [e for e in (low, high) if e not in view]
    ax.hlines(edges, start, end, color=WANTED, linewidth=0.8, zorder=3)
    ax.hlines(obtained * factor, start, end, color=GOT, linestyle="--", linewidth=1.3, zorder=4)
    ax.annotate(
        name, (1, (low + high) / 2), (4, 0), xycoords=("axes fraction", "data"),
        va="bottom" if name == "peak_force_N" else "top",  # the two are often close
        textcoords="offset points", fontsize=7, color=WANTED, annotation_clip=False,
    )  # fmt: skip


def mark_settling(ax, factor, end, begin, band, expected, obtained):
    """The settling band, the expected times and the obtained one."""
    edges = [edge * factor for edge in band]
    ax.hlines(edges, begin, end, color="#5d6874", linestyle=":", linewidth=1, zorder=3)
    if expected is not None:
        low, high = (min(begin + time, end) for time in (max(expected[0], 0), expected[1]))
        ax.axvspan(low, high, color=WANTED, alpha=0.3, linewidth=0.8, zorder=3)
        ax.annotate(
            "settle_s", ((low + high) / 2, 1), (0, 2), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=7, color=WANTED, ha="center",
        )  # fmt: skip
    if obtained is not None:
        ax.axvline(begin + obtained, color=GOT, linestyle="--", linewidth=1.3, zorder=4)
