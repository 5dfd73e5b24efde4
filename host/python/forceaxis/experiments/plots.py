"""Plots of traces: rows of signals over time, with force set-points, contacts and events."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forceaxis.drawing import AREA, GOT, INK, THIN, WANTED, legend, style
from forceaxis.experiments import verdicts
from forceaxis.experiments.run_result import Array, Columns

Values: TypeAlias = Array | Sequence[float]
Note: TypeAlias = tuple[str, str]  # text line below the title: (text, colour)

# {last component of the name of a signal of the model: (unit, factor)}
UNITS: dict[str, tuple[str, float]] = {
    "position": ("mm", 1e3),
    "deflection": ("mm", 1e3),
    "velocity": ("mm/s", 1e3),
    "acceleration": ("m/s\u00b2", 1),
    "force": ("N", 1),
    "spring_force_rate": ("N/s", 1),
    "spring_force": ("N", 1),
    "current": ("A", 1),
    "tach": ("V", 1),
    "voltage": ("V", 1),
    "command": ("V", 1),
    "encoder": ("encoder count", 1),
    "adc0": ("ADC code", 1),
    "adc1": ("ADC code", 1),
    "dac": ("DAC code", 1),
}


def unit_of(name: str) -> tuple[str, float]:
    """Returns (unit, factor) for a column of a trace. A plot shows the values times the factor, in
    this unit."""
    return UNITS.get(name.rpartition(".")[2], ("", 1))


@dataclass
class Line:
    """One signal in a row of a plot of signals over time."""

    label: str
    unit: str
    values: Array  # values of the signal at the times of the plot, (n,)
    # {value: name} of an enumeration; the names are shown if the row has no other signal
    names: dict[int, str] = field(default_factory=dict)
    # True for the controlled force in N, to which the force set-points refer
    controlled: bool = False


@dataclass
class Marks:
    """Everything that a plot shows in addition to signals. Times are in s. Marks outside of the
    plotted time range are not shown."""

    # (time of the change in s, force set-point in N)
    setpoints: list[tuple[float, float]] = field(default_factory=list)
    # (first time, last time) of each contact
    contacts: list[tuple[float, float]] = field(default_factory=list)
    # window of the verdict: (first time in s, last time in s, RunResult.mark)
    window: tuple[float, float, str] | None = None
    # (time in s, key of EVENTS, text)
    events: list[tuple[float, str, str]] = field(default_factory=list)
    # (times in s, forces in N) of a force demand that is not a step
    demand: tuple[Values, Values] | None = None


# Marker and colour for each kind of event.
EVENTS = {
    "touch": ("v", INK),
    "lost": ("^", GOT),
    "impulse": ("D", "#8a5fa8"),
    "fault": ("X", "#b3261e"),
}
OVERLAP_SHARE = 0.015  # marks that are closer than this fraction of the plot's width overlap
MOST_MARKS = 3  # largest number of overlapping marks that are drawn separately
LINE_WIDTH = THIN["linewidth"]
CONTACT_COLOUR = "#dbe6f1"
KEYS_PER_LINE = 5  # largest number of entries in a line of a legend


def trace(
    time_s: Array,
    rows: Sequence[Sequence[Line]],
    title: str,
    notes: Sequence[Note] = (),
    marks: Marks | None = None,
    width: float = 5.6,
) -> Figure:
    """Returns a plot of signals over time. `rows`: the signals of each row. `notes`: (text, colour)
    of each text line below the title. `width`: width of the plot in inches."""
    marks = marks or Marks()
    chars = round(18.5 * width)
    notes = [(line, colour) for text, colour in notes for line in textwrap.wrap(text, chars)]
    handles = keys(marks, time_s, rows)
    lines = -(-len(handles) // KEYS_PER_LINE)  # number of lines of the legend
    head, foot, tall = 0.3 + 0.14 * len(notes), 0.5 + 0.18 * lines, 1.2
    height = head + tall * len(rows) + foot
    figure, axes = plt.subplots(len(rows), 1, sharex=True, figsize=(width, height), squeeze=False)
    for ax, row in zip(axes[:, 0], rows, strict=True):
        style(ax)
        draw_row(ax, time_s, row)
        if any(line.controlled for line in row):
            draw_setpoints(ax, time_s, marks)
    for ax in axes[:, 0]:
        ax.margins(x=0)
        shade(ax, marks, time_s)
    mark_events(axes[0, 0], marks.events, time_s)
    axes[-1, 0].set_xlabel("time, s")
    longest = max(
        (len(n) for r in rows for line in r for n in line.names.values() if len(r) == 1), default=0
    )
    left = max(0.75, 0.4 + 0.062 * longest)
    figure.subplots_adjust(
        left / width, foot / height, 1 - 0.15 / width, 1 - (head + 0.1) / height, hspace=0.22
    )
    figure.suptitle(
        title, fontsize=9, color=INK, parse_math=False, x=0.02, ha="left", va="top",
        y=1 - 0.06 / height,
    )  # fmt: skip
    for i, (line, colour) in enumerate(notes):
        figure.text(
            0.02, 1 - (0.25 + 0.14 * i) / height, line, fontsize=7, color=colour, va="top",
            parse_math=False,
        )  # fmt: skip
    if handles:
        ncols = min(len(handles), KEYS_PER_LINE)
        legend(figure, handles=handles, loc="lower left", ncols=ncols, columnspacing=1.2,
               handletextpad=0.5, bbox_to_anchor=(0.01, 0))  # fmt: skip
    plt.close(figure)
    return figure


def draw_row(ax: Axes, time_s: Array, row: Sequence[Line]) -> None:
    """Draws the signals of one row, and labels the axis."""
    for line in row:
        values = line.values
        if len(row) == 1 and line.names:
            met, values = np.unique(values, return_inverse=True)
            ax.set_yticks(range(len(met)), [line.names.get(int(v), str(v)) for v in met])
        (drawn,) = ax.plot(time_s, values, label=line.label, linewidth=LINE_WIDTH)
        if values.dtype.kind in "iu":
            drawn.set_drawstyle("steps-post")
    units = ", ".join(dict.fromkeys(line.unit for line in row if line.unit))
    label = row[0].label.replace("_", "_\n", len(row[0].label) // 20)
    ax.set_ylabel(units if len(row) > 1 else f"{label}\n{units}", parse_math=False)
    if len(row) > 1:
        legend(ax, loc="lower right", bbox_to_anchor=(1, 0.93), ncols=len(row))


def draw_setpoints(ax: Axes, time_s: Array, marks: Marks) -> None:
    """Draws the force demand: as steps of the set-points, or as ramps if the demand has a slope."""
    setpoints = marks.setpoints
    if not setpoints or len(time_s) < 2 or time_s[-1] < setpoints[0][0]:
        return
    if marks.demand is not None:
        times_s, force_N = (np.asarray(v, float) for v in marks.demand)
        none = force_N == 0  # segments whose two ends are 0 N are not drawn
        none = none & np.append(True, none[:-1]) & np.append(none[1:], True)
        drawstyle = "default"
    else:
        times_s, force_N = np.array([*setpoints, (time_s[-1], setpoints[-1][1])]).T
        none, drawstyle = force_N == 0, "steps-post"
    force_N = np.where(none, np.nan, force_N)
    ax.plot(times_s, force_N, color=WANTED, linestyle="--", linewidth=0.8, drawstyle=drawstyle)
    ax.set_xlim(time_s[0], time_s[-1])


def ramps(
    setpoints: Sequence[tuple[float, float]],
    slope: float,
    contacts: Sequence[tuple[float, float]],
    end: float,
) -> tuple[list[float], list[float]]:
    """Returns (times, forces in N) of the corner points of a force demand. From the first contact
    until the time `end`, the demand follows the set-points with the slope `slope` in N/s.
    `setpoints`: (time of the change, force in N)."""
    touch = min((a for a, _ in contacts), default=np.inf)
    if touch >= end:
        return [], []
    times, newton, now = [touch], [0.0], 0.0
    steps = [(max(t, touch), n) for t, n in setpoints]
    for (begin, wanted), after in zip(steps, [*(t for t, _ in steps[1:]), end], strict=True):
        if after <= begin:
            continue
        reached = begin + abs(wanted - now) / slope
        if reached < after:
            times, newton, now = [*times, reached], [*newton, wanted], wanted
        else:
            now += np.sign(wanted - now) * slope * (after - begin)
        times, newton = [*times, after], [*newton, now]
    return times, newton


def shade(ax: Axes, marks: Marks, time_s: Array) -> None:
    """Shades the times of contact and the window of the verdict."""
    low, high = time_s[0], time_s[-1]
    inside = [(max(a, low), min(b, high)) for a, b in marks.contacts if b > low and a < high]
    across = ax.get_xaxis_transform()
    if inside:
        ax.broken_barh(
            [(a, b - a) for a, b in inside], (0, 1), transform=across, color=CONTACT_COLOUR,
            alpha=0.7, linewidth=0, zorder=0,
        )  # fmt: skip
    if marks.window and marks.window[1] > low and marks.window[0] < high:
        a, b, verdict = marks.window
        a, b = max(a, low), min(b, high)
        ax.broken_barh(
            [(a, b - a)], (0, 1), transform=across, color=area_of(verdict), alpha=0.55,
            linewidth=0, zorder=0.5,
        )  # fmt: skip


def area_of(verdict: str) -> str:
    """Returns the colour of an area for a verdict."""
    return AREA.get(verdict, AREA["failed"])


def mark_events(ax: Axes, events: Sequence[tuple[float, str, str]], time_s: Array) -> None:
    """Draws a mark above the rows for each event. If events are too close together for separate
    marks, they get one line from the first to the last of them."""
    across = ax.get_xaxis_transform()
    for level, (kind, (marker, colour)) in enumerate(EVENTS.items()):
        times = [t for t, k, _ in events if k == kind and time_s[0] <= t <= time_s[-1]]
        for cluster in clusters(times, OVERLAP_SHARE * (time_s[-1] - time_s[0])):
            ends = sorted({cluster[0], cluster[-1]})
            if len(cluster) > MOST_MARKS:
                # Each kind of event has its line at a different height.
                height = 1.03 + 0.012 * level
                ax.plot(ends, [height] * len(ends), color=colour, linewidth=1, transform=across,
                        clip_on=False)  # fmt: skip
            else:
                ends = cluster
            ax.plot(ends, [1.03] * len(ends), marker, color=colour, markersize=4, linestyle="",
                    transform=across, clip_on=False)  # fmt: skip


def clusters(times: Sequence[float], close: float) -> list[list[float]]:
    """Returns the times in groups, in ascending order. In a group, two consecutive times differ by
    at most `close`."""
    found: list[list[float]] = []
    for time in sorted(times):
        if found and time - found[-1][-1] <= close:
            found[-1].append(time)
        else:
            found.append([time])
    return found


def keys(marks: Marks, time_s: Array, rows: Sequence[Sequence[Line]]) -> list[Artist]:
    """Returns the entries of the legend for the demand, contacts, window of the verdict and events
    of a plot."""
    low, high = time_s[0], time_s[-1]
    found: list[Artist] = []
    if any(newton for _, newton in marks.setpoints) and any(
        line.controlled for row in rows for line in row
    ):
        label = "set-point" if marks.demand is None else "demand"
        found.append(plt.Line2D([], [], label=label, color=WANTED, linestyle="--", linewidth=0.8))
    if any(b > low and a < high for a, b in marks.contacts):
        found.append(plt.Rectangle((0, 0), 1, 1, color=CONTACT_COLOUR, label="contact"))
    if marks.window and marks.window[1] > low and marks.window[0] < high:
        verdict = marks.window[2]
        label = f"verdict: {verdicts.MARK_WORDS[verdict]}"
        found.append(plt.Rectangle((0, 0), 1, 1, color=area_of(verdict), label=label))
    for kind, (marker, colour) in EVENTS.items():
        texts = [text for t, k, text in marks.events if k == kind and low <= t <= high]
        if texts:
            label = ", ".join(dict.fromkeys(texts)) + (f" ({len(texts)})" if texts[1:] else "")
            found.append(plt.Line2D([], [], label=label, marker=marker, linestyle="", markersize=4,
                                    color=colour))  # fmt: skip
    return found


@dataclass(frozen=True)
class ExpectedLevel:
    """An expected range of a value, and the value of the run. Both are in the unit of the trace."""

    row: int  # number of the row in the plot
    name: str  # key of [expect] with the expected value
    from_s: float  # time in s from which the value is evaluated
    low: float  # lower end of the expected range
    high: float  # upper end of the expected range
    obtained: float  # obtained value of the run


@dataclass(frozen=True)
class Settling:
    """The expected settling time and the settling time of the run, both in s after `from_s`."""

    from_s: float
    band: list[float]  # lower and upper edge of the settling band, in the unit of the trace
    # expected range of the settling time in s; None means that the signal must not settle
    expected_s: tuple[float, float] | None
    # settling time of the run in s; None means that the signal does not settle
    obtained_s: float | None


def comparison(
    time_s: Array,
    rows: Sequence[Columns],
    levels: Sequence[ExpectedLevel],
    settling: Settling | None,
    table: str,
    title: str,
) -> Figure:
    """Returns a plot that compares expected with obtained values. The expected values are green.
    The text `table`, a table of these values, is below the plot.

    rows: the signals of each row. The first row has the response whose settling is shown.
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
            ax.plot(time_s, values * factor, label=name, alpha=0.75, linewidth=LINE_WIDTH)
        ax.set_ylabel(f"{name}\n{unit}" if len(row) == 1 else unit, fontsize=8)
        ax.set_xlim(time_s[0], time_s[-1])
        if len(row) > 1:
            legend(ax, loc="lower right")
    axes[len(rows) - 1].set_xlabel("time, s", fontsize=8)
    for level in levels:
        mark_level(axes[level.row], unit_of(next(iter(rows[level.row])))[1], time_s[-1], level)
    if settling:
        mark_settling(axes[0], unit_of(next(iter(rows[0])))[1], time_s[-1], settling)
    axes[0].set_title(title, fontsize=9, loc="left", color=INK, parse_math=False, pad=14)
    legend(
        figure,
        handles=[
            plt.Rectangle((0, 0), 1, 1, color=WANTED, alpha=0.4, label="expected"),
            plt.Line2D([], [], color=GOT, linestyle="--", linewidth=1.3, label="obtained"),
            plt.Line2D([], [], color="#5d6874", linestyle=":", linewidth=1, label="settling band"),
        ],
        ncols=3,
        loc="upper right",
    )
    axes[-1].axis("off")
    text = axes[-1].text(
        0, 1, table, family="monospace", fontsize=7.5, va="top", transform=axes[-1].transAxes
    )
    text.set_in_layout(False)  # A wide table must not change the size of the plots.
    plt.close(figure)
    return figure


def mark_level(ax: Axes, factor: float, end: float, level: ExpectedLevel) -> None:
    """Draws the obtained value and the expected range of this value. They extend from the start of
    the evaluation to the end of the run."""
    view, start = ax.get_ylim(), level.from_s
    low = level.low * factor if level.low > -np.inf else view[0]
    high = level.high * factor if level.high < np.inf else view[1]
    ax.fill_between((start, end), low, high, color=WANTED, alpha=0.3, linewidth=0, zorder=3)
    edges = [e for e in (low, high) if e not in view]
    ax.hlines(edges, start, end, color=WANTED, linewidth=0.8, zorder=3)
    obtained = level.obtained * factor
    ax.hlines(obtained, start, end, color=GOT, linestyle="--", linewidth=1.3, zorder=4)
    ax.annotate(
        level.name, (1, (low + high) / 2), (4, 0), xycoords=("axes fraction", "data"),
        # The labels of peak and final value are on different sides, so that they do not overlap.
        va="bottom" if level.name == "peak_force_N" else "top",
        textcoords="offset points", fontsize=7, color=WANTED, annotation_clip=False,
    )  # fmt: skip


def mark_settling(ax: Axes, factor: float, end: float, settling: Settling) -> None:
    """Draws the settling band, the expected settling times, and the obtained settling time."""
    begin, edges = settling.from_s, [edge * factor for edge in settling.band]
    ax.hlines(edges, begin, end, color="#5d6874", linestyle=":", linewidth=1, zorder=3)
    if expected := settling.expected_s:
        low, high = (min(begin + time, end) for time in (max(expected[0], 0), expected[1]))
        ax.axvspan(low, high, color=WANTED, alpha=0.3, linewidth=0.8, zorder=3)
        ax.annotate(
            "settle_s", ((low + high) / 2, 1), (0, 2), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=7, color=WANTED, ha="center",
        )  # fmt: skip
    if settling.obtained_s is not None:
        ax.axvline(begin + settling.obtained_s, color=GOT, linestyle="--", linewidth=1.3, zorder=4)
