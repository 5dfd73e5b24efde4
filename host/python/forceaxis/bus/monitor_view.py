"""Draws the contents of the monitor as coloured text: panels of the axes, charts, and captures."""

from typing import NamedTuple

import numpy as np
from rich.text import Text
from textual.message import Message
from textual.widgets import Static

from forceaxis._core import TICKS_PER_SECOND
from forceaxis.bus import charts, state_names
from forceaxis.bus.capture_assembly import Samples, unit_of
from forceaxis.bus.monitor_state import (
    VOLT_PER_CODE,
    AxisSnapshot,
    AxisWatch,
    TraceColumns,
)

# Height of the panel of one axis in text lines, including the border, for three sizes of panels.
FULL, COMPACT, SLIM = 8, 4, 3

GOOD, WARN, BAD, QUIET = "#5fd7a7", "#e5c07b", "#ff5f5f", "#8a8a8a"
ACTUAL, WANTED = "#5fafff", "#d78700"
VALUE = "bold #e4e4e4"

STATE_COLOURS = {
    "operation enabled": GOOD,
    "fault": BAD,
    "fault reaction active": BAD,
    "quick stop active": WARN,
}


def signed(value: float | None, unit: str = "", digits: int | None = None) -> str:
    """Returns a number as text with thin spaces between groups of three digits, or "-" for None."""
    if value is None:
        return "-"
    text = f"{value:,.{digits}f}" if digits is not None else f"{value:,}"
    return f"{text.replace(',', ' ')} {unit}".rstrip()


def spread(width: int, left: Text, right: Text) -> Text:
    """Returns a text line of `width` characters with the text `left` at the beginning and the text
    `right` at the end. If the text line is too short for both, `left` is shortened."""
    room = width - left.cell_len - right.cell_len
    if room < 1:
        left = left.copy()
        left.truncate(max(0, width - right.cell_len - 1), overflow="ellipsis")
        room = max(1, width - left.cell_len - right.cell_len)
    return Text.assemble(left, " " * room, right)


class AxisPanel(Static):
    """The panel of one axis. It shows drive state, mode of operation, fault, values and active
    limit of the axis."""

    class Chosen(Message):
        """Event: the user has clicked the panel."""

        def __init__(self, number: int) -> None:
            super().__init__()
            self.number = number

    def __init__(self, number: int) -> None:
        super().__init__(classes="panel", id=f"axis-{number}")
        self.number = number

    def on_click(self) -> None:
        self.post_message(self.Chosen(self.number))

    def show(self, words: AxisSnapshot | None, height: int, chosen: bool, codes: bool) -> None:
        """Draws the state of the axis in the panel. `words` is None before the first state."""
        width = max(10, self.content_size.width)
        silent = words is None or words.silent
        state = (words and words.drive_state) or "no state yet"
        colour = QUIET if silent else STATE_COLOURS.get(state, WARN)
        if words and words.objects_mismatch:
            colour = BAD
        self.styles.border = ("heavy" if chosen else "round", colour)
        head = f"axis {self.number} · {state}"
        if words and words.node in ("silent", "stopped"):
            head = f"axis {self.number} · NODE {words.node.upper()}, was {state}"
        elif words and silent:
            head = f"axis {self.number} · SILENT, was {state}"
        self.border_title = head
        if words is None:
            self.border_subtitle = ""
            self.update(Text("no state heard yet", style=QUIET))
            return
        lost = f" · [bold {BAD}]lost {words.lost}[/]" if words.lost else ""
        self.border_subtitle = f"{age(words.age_s)} · {words.rate_per_s:.0f}/s{lost}"
        lines = {FULL: full, COMPACT: compact, SLIM: slim}[height](words, width, codes)
        if words.objects_mismatch:
            lines[-1] = Text(words.objects_mismatch, style=f"bold {BAD}")
            if len(words.objects_mismatch) > width:
                theirs, ours = (words.objects_mismatch.split()[i] for i in (2, 6))
                lines[-1] = Text(f"table {theirs}, here {ours}", style=f"bold {BAD}")
        for line in lines:
            line.truncate(width, overflow="ellipsis")
        self.update(Text("\n").join(lines))


def age(seconds: float | None) -> str:
    if seconds is None:
        return "-"
    if seconds < 1:
        return f"{seconds * 1e3:.0f} ms"
    return f"{seconds:.1f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def mode_text(words: AxisSnapshot) -> Text:
    mode, native = words.mode, words.native_mode
    text = Text(mode or "mode -", style=VALUE)
    if native:
        text.append(" · no law" if native == "disabled" else f" · {native} law", style=QUIET)
    return text


def fault_text(words: AxisSnapshot) -> Text:
    fault, code = words.fault, words.error_code
    if fault in (None, "none"):
        if not code:
            return Text("fault -" if fault is None else "no fault", style=QUIET)
        # An error of the drive profile or of a bus does not cause a fault of the axis.
        return Text(f"FAULT {state_names.emergency(code)}", f"bold {BAD}")
    return Text(f"FAULT {fault}" + (f" {code:04X}h" if code else ""), f"bold {BAD}")


def limit_text(words: AxisSnapshot) -> Text:
    limit = words.limit_reason
    if limit in (None, "none"):
        return Text("limit -" if limit is None else "no limit", style=QUIET)
    return Text(f"limit {limit}", style=WARN)


def contact_text(words: AxisSnapshot) -> Text:
    text = Text()
    if words.contact is not None:
        text.append("in contact" if words.contact else "apart", GOOD if words.contact else QUIET)
    if words.limit_cycle:
        text.append(" · " if text else "")
        text.append("LIMIT CYCLE", f"bold {BAD}")
    return text


def force_value(words: AxisSnapshot, codes: bool) -> str:
    if words.force_N is not None and not codes:
        return signed(words.force_N, "N", 2)
    if words.force_cnt is not None:
        return signed(words.force_cnt, "force count", 2)
    if words.force_permille is not None:
        return signed(words.force_permille / 10, "% of rated", 1)
    return "-"


def position_values(words: AxisSnapshot, codes: bool) -> tuple[str, str, str]:
    """Returns three texts: name of the quantity, position, and speed. The values are in the
    position unit of the axis, or in encoder counts if `codes` is True."""
    unit = words.position_unit
    if codes or unit == "count":
        speed = signed(words.velocity_cnt_per_s, "count/s")
        return "encoder", signed(words.position_cnt, "count"), speed
    digits = 0 if unit == "user unit" else 3
    speed = signed(words.velocity_per_s, f"{unit}/s", min(digits, 2))
    return "position", signed(words.position, unit, digits), speed


def command_values(words: AxisSnapshot, codes: bool) -> tuple[str, str]:
    """Returns two texts: command of the control law, and output of the DAC. The values are
    voltages, or DAC codes if `codes` is True."""
    if codes:
        return signed(words.command_code, "code"), signed(words.dac_code, "code")
    return signed(words.command_V, "V", 3), signed(words.output_V, "V", 3)


def row(name: str, value: str, note: str = "") -> Text:
    return Text.assemble((f"{name:9}", QUIET), (f"{value:>13}", VALUE), (f" {note}", QUIET))


def full(words: AxisSnapshot, width: int, codes: bool) -> list[Text]:
    owner = words.command_source
    target = ""
    if codes and words.target_force_permille is not None:
        target = f"target {words.target_force_permille / 10:.1f} %"
    elif not codes and words.target_force_N is not None:
        target = f"target {words.target_force_N:.1f} N"
    command, output = command_values(words, codes)
    flags = contact_text(words)
    for bit in words.status or ():
        flags.append(" · " if flags else "")
        flags.append(bit, WARN if bit in ("warning", "following error", "homing error") else QUIET)
    return [
        spread(width, mode_text(words), Text(owner or "", style=QUIET)),
        row("force", force_value(words, codes), target),
        row(*position_values(words, codes)),
        row("command", command, f"out {output}"),
        flags,
        spread(width, fault_text(words), limit_text(words)),
    ]


def trouble_text(words: AxisSnapshot) -> Text:
    """Returns a text about the most important condition of an axis. The order of importance is
    fault, limit cycle, active limit, contact."""
    if words.fault not in (None, "none") or words.error_code:
        return fault_text(words)
    if words.limit_cycle:
        return Text("LIMIT CYCLE", style=f"bold {BAD}")
    if words.limit_reason not in (None, "none"):
        return limit_text(words)
    return contact_text(words)


def numbers(words: AxisSnapshot, codes: bool) -> Text:
    """Returns force, position and output in one text line. `codes`: True if values are shown as
    counts and codes instead of physical units."""
    if codes:
        force = "-" if words.force_cnt is None else f"{words.force_cnt:.2f}"
        return Text.assemble(
            ("force ", QUIET), (force, VALUE),
            (" enc ", QUIET), (signed(words.position_cnt), VALUE),
            (" DAC ", QUIET), (signed(words.dac_code), VALUE),
        )  # fmt: skip
    return Text.assemble(
        (force_value(words, codes), VALUE),
        (f"  {position_values(words, codes)[1]}", VALUE),
        (f"  {command_values(words, codes)[1]}", QUIET),
    )


def compact(words: AxisSnapshot, width: int, codes: bool) -> list[Text]:
    values = numbers(words, codes)
    return [
        spread(width, Text(words.mode or "mode -", style=VALUE), trouble_text(words)),
        values,
    ]


def slim(words: AxisSnapshot, width: int, codes: bool) -> list[Text]:
    values = numbers(words, codes)
    trouble = trouble_text(words)
    trouble.truncate(16, overflow="ellipsis")
    return [spread(width, values, trouble)]


class StripChart(NamedTuple):
    """A chart of the monitor over time. Its two curves have the same scale."""

    name: str
    unit: str
    actual: Samples
    target: Samples
    legend: tuple[str, str]
    least_span: float  # smallest range of the scale of the chart, in the unit of its values


def strip_charts(
    axis: AxisWatch, width: int, height: int, now_us: float, span_s: float, codes: bool = False
) -> Text:
    """Returns charts of force, position and command of the control law over the last `span_s`
    seconds. If `height` is small, returns fewer charts."""
    now = now_us / 1e6
    data = axis.trace.since(now - span_s)
    time_s = data.time_s - now
    plots = plots_of(axis, data, codes)
    room = height - 1
    count = 3 if room >= 9 else 2 if room >= 6 else 1
    heights = [room // count + (1 if i < room % count else 0) for i in range(count)]
    parts: list[Text] = []
    for plot, rows in zip(plots, heights, strict=False):
        title = Text.assemble(
            (f"axis {axis.number} " if not parts else "", QUIET), (plot.name, "bold")
        )
        lines: list[charts.Line] = []
        for values, colour, word in (
            (plot.actual, ACTUAL, plot.legend[0]),
            (plot.target, WANTED, plot.legend[1]),
        ):
            finite = np.flatnonzero(np.isfinite(values))
            if finite.size:
                last = charts.number(values[finite[-1]], 3)
                title.append(f"   ━ {word} {last} {plot.unit}".rstrip(), style=colour)
                lines.append((*broken(time_s, values), colour))
        parts.append(charts.panel(width, rows, title, lines, (-span_s, 0), least=plot.least_span))
    parts.append(charts.time_axis(width, span_s))
    return Text("\n").join(parts)


def plots_of(axis: AxisWatch, data: TraceColumns, codes: bool) -> list[StripChart]:
    """Returns the charts of force, position and command."""
    force = axis.forces()[2] if axis.state else ""
    forces = data.force, data.force_target
    if codes:
        force, forces = "count", (data.force_cnt, np.full_like(data.force, np.nan))
    length, size = ("count", 1) if codes else axis.length()
    of, volt = ("DAC code", 1) if codes else ("V", VOLT_PER_CODE)
    code, command = data.dac_code * volt, data.command_code * volt
    positions = data.position_cnt * size, data.position_target_cnt * size
    name = "encoder" if length == "count" else "position"
    return [
        StripChart("force", force, *forces, ("is", "target"), 1.0),
        StripChart(name, length, *positions, ("is", "target"), 10.0 * size),
        StripChart("command", of, code, command, ("out", "before limits"), 10.0 * volt),
    ]


def broken(time_s: Samples, values: Samples) -> tuple[Samples, Samples]:
    """Interrupts the curve of a chart wherever several consecutive messages are missing."""
    if len(time_s) < 3:
        return time_s, values
    steps = np.diff(time_s)
    holes = np.flatnonzero(steps > max(0.25, 5 * float(np.median(steps)))) + 1
    return np.insert(time_s, holes, np.nan), np.insert(values, holes, np.nan)


def capture_chart(axis: AxisWatch, width: int, height: int) -> Text:
    """Returns charts of the signals of the latest capture, over the time in ms from the trigger. If
    `height` is small, shows fewer signals."""
    if axis.capture is None:
        return Text("capture: none yet", style=QUIET)
    (_, number), held = axis.capture
    if not held.signals:
        return Text("capture: no samples yet", style=QUIET)
    names = held.signals[: max(1, (height - 2) // 3)]
    ms = (np.arange(held.total) - held.trigger_sample) * held.decimation / 1.5
    span = (float(ms[0]), float(ms[-1]) if len(ms) > 1 else float(ms[0]) + 1)
    missing = f", {held.missing} not here" if held.missing else ""
    hidden = len(held.signals) - len(names)
    more = f", {hidden} more signals in the log" if hidden else ""
    seconds = held.total * held.decimation / TICKS_PER_SECOND
    head = Text.assemble(
        (f"axis {axis.number} capture {number}", "bold"),
        (f"   {held.total} samples, {seconds:.3f} s{missing}{more}   c: back", QUIET),
    )
    room = height - 2
    parts = [head]
    for i, name in enumerate(names):
        rows = room // len(names) + (1 if i < room % len(names) else 0)
        values = held.values(name).astype(float)
        title = Text.assemble((name, "bold"), (f" {unit_of(name)}", QUIET))
        parts.append(charts.panel(width, rows, title, [(ms, values, ACTUAL)], span, least=1e-6))
    ends = f"{span[0]:.1f} ms", f"{span[1]:.1f} ms"
    gap = max(1, width - charts.SCALE_WIDTH - sum(map(len, ends)))
    parts.append(Text(" " * charts.SCALE_WIDTH + ends[0] + " " * gap + ends[1], style="dim"))
    return Text("\n").join(parts)
