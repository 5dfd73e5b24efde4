"""`forceaxis monitor`: watch axes live in the terminal. It never writes to an axis."""

import contextlib
import math
import time
from pathlib import Path

import numpy as np
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Grid, Vertical
from textual.css.query import NoMatches
from textual.widgets import Footer, Static

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.bus import charts, drive_words
from forceaxis.bus.captures import unit_of
from forceaxis.bus.watch import STALE_S, clock_word, known

SMALLEST = (60, 16)
FULL, COMPACT, SLIM = 8, 4, 3  # heights of a panel, with its border
PANEL_WIDTH = 38
SPANS_S = (2, 5, 10, 20, 40, 80)
REFRESH_S = 0.2

GOOD, WARN, BAD, QUIET = "#5fd7a7", "#e5c07b", "#ff5f5f", "#8a8a8a"
IS, WANTED = "#5fafff", "#d78700"
VALUE = "bold #e4e4e4"

STATE_COLOURS = {
    "operation enabled": GOOD,
    "fault": BAD,
    "fault reaction active": BAD,
    "quick stop active": WARN,
}


def signed(value, unit="", digits=None):
    """A number with thin groups of three, "-" where there is none."""
    if value is None:
        return "-"
    text = f"{value:,.{digits}f}" if digits is not None else f"{value:,}"
    return f"{text.replace(',', ' ')} {unit}".rstrip()


def spread(width, left, right):
    """One line with `left` at the left and `right` at the right, cut to `width`."""
    room = width - left.cell_len - right.cell_len
    if room < 1:
        left = left.copy()
        left.truncate(max(0, width - right.cell_len - 1), overflow="ellipsis")
        room = max(1, width - left.cell_len - right.cell_len)
    return Text.assemble(left, " " * room, right)


class AxisPanel(Static):
    """One axis: state, mode and fault in words, its values, what limits it."""

    def __init__(self, number):
        super().__init__(classes="panel", id=f"axis-{number}")
        self.number = number

    def on_click(self):
        self.app.choose(self.number)

    def show(self, words, heard_age_s, height, chosen):
        """Draws `words` (AxisWatch.words, None: only other messages were heard)."""
        width = max(10, self.content_size.width)
        silent = words is None or heard_age_s > STALE_S
        state = (words or {}).get("drive_state") or "no state yet"
        colour = QUIET if silent else STATE_COLOURS.get(state, WARN)
        if words and words["objects_mismatch"]:
            colour = BAD
        self.styles.border = ("heavy" if chosen else "round", colour)
        head = f"axis {self.number} · {state}"
        if words and words["node"] == "silent":
            head = f"axis {self.number} · NODE SILENT"
        elif words and silent:
            head = f"axis {self.number} · SILENT, was {state}"
        self.border_title = head
        if words is None:
            self.border_subtitle = ""
            self.update(Text("no state heard yet", style=QUIET))
            return
        lost = f" · [bold {BAD}]lost {words['lost']}[/]" if words["lost"] else ""
        self.border_subtitle = f"{age(words['age_s'])} · {words['rate_per_s']:.0f}/s{lost}"
        lines = {FULL: full, COMPACT: compact, SLIM: slim}[height](words, width)
        if words["objects_mismatch"]:
            lines[-1] = Text(words["objects_mismatch"], style=f"bold {BAD}")
            if len(words["objects_mismatch"]) > width:
                theirs, ours = (words["objects_mismatch"].split()[i] for i in (2, 6))
                lines[-1] = Text(f"table {theirs}, here {ours}", style=f"bold {BAD}")
        for line in lines:
            line.truncate(width, overflow="ellipsis")
        self.update(Text("\n").join(lines))


def age(seconds):
    if seconds is None:
        return "-"
    if seconds < 1:
        return f"{seconds * 1e3:.0f} ms"
    return f"{seconds:.1f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def mode_text(words):
    mode, native = words["mode"], words["native_mode"]
    text = Text(mode or "mode -", style=VALUE)
    if native:
        text.append(" · no law" if native == "disabled" else f" · {native} law", style=QUIET)
    return text


def fault_text(words):
    fault, code = words["fault"], words["error_code"]
    if fault in (None, "none") and not code:
        return Text("fault -" if fault is None else "no fault", style=QUIET)
    if fault in (None, "none"):  # what only the drive profile or a bus calls an error
        return Text(f"FAULT {drive_words.emergency(code)}", f"bold {BAD}")
    return Text(f"FAULT {fault}" + (f" {code:04X}h" if code else ""), f"bold {BAD}")


def limit_text(words):
    limit = words["limit_reason"]
    if limit in (None, "none"):
        return Text("limit -" if limit is None else "no limit", style=QUIET)
    return Text(f"limit {limit}", style=WARN)


def contact_text(words):
    text = Text()
    if words["contact"] is not None:
        text.append(
            "in contact" if words["contact"] else "apart", GOOD if words["contact"] else QUIET
        )
    if words["limit_cycle"]:
        text.append(" · " if text else "")
        text.append("LIMIT CYCLE", f"bold {BAD}")
    return text


def force_value(words):
    if words["force_N"] is not None:
        return signed(words["force_N"], "N", 2)
    if words["force_cnt"] is not None:
        return signed(words["force_cnt"], "count", 2)
    if words["force_permille"] is not None:
        return signed(words["force_permille"] / 10, "%", 1)
    return "-"


def row(name, value, note=""):
    return Text.assemble((f"{name:9}", QUIET), (f"{value:>13}", VALUE), (f" {note}", QUIET))


def full(words, width):
    owner = words["command_source"]
    count = "" if words["force_cnt"] is None else f"{words['force_cnt']:.2f} count"
    if words["target_force_N"] is not None:
        count = f"target {words['target_force_N']:.1f}"
    speed = signed(words["velocity_cnt_per_s"])
    flags = contact_text(words)
    for bit in words["status"] or ():
        flags.append(" · " if flags else "")
        flags.append(bit, WARN if bit in ("warning", "following error", "homing error") else QUIET)
    return [
        spread(width, mode_text(words), Text(owner or "", style=QUIET)),
        row("force", force_value(words), count if words["force_N"] is not None else ""),
        row("position", signed(words["position_cnt"], "cnt"), f"{speed} cnt/s"),
        row("command", signed(words["command_code"], "code"), f"out {signed(words['dac_code'])}"),
        flags,
        spread(width, fault_text(words), limit_text(words)),
    ]


def trouble_text(words):
    """The worst of fault, limit cycle and limit; contact where all is well."""
    if words["fault"] not in (None, "none") or words["error_code"]:
        return fault_text(words)
    if words["limit_reason"] not in (None, "none") and not words["limit_cycle"]:
        return limit_text(words)
    return contact_text(words)


def compact(words, width):
    values = Text.assemble(
        (force_value(words), VALUE),
        (f"  {signed(words['position_cnt'], 'cnt')}", VALUE),
        (f"  {signed(words['dac_code'])} code", QUIET),
    )
    return [
        spread(width, Text(words["mode"] or "mode -", style=VALUE), trouble_text(words)),
        values,
    ]


def slim(words, width):
    values = Text.assemble(
        (force_value(words), VALUE),
        (f" {signed(words['position_cnt'])}", VALUE),
        (f" {signed(words['dac_code'])}", QUIET),
    )
    trouble = trouble_text(words)
    if words["limit_cycle"]:
        trouble = Text("LIMIT CYCLE", style=f"bold {BAD}")
    trouble.truncate(16, overflow="ellipsis")
    return [spread(width, values, trouble)]


class Monitor(App):
    """Axes of one source (sources.Live or Replay): panels above, charts of the chosen one below."""

    TITLE = "forceaxis monitor"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    Screen { background: #121212; }
    #head { height: 1; background: #262626; color: #d0d0d0; padding: 0 1; }
    #panels { height: auto; grid-gutter: 0 1; overflow-y: auto; }
    .panel { padding: 0 1; border-title-style: bold; border-subtitle-color: #8a8a8a; }
    #chart { height: 1fr; padding: 0 1; }
    #events { padding: 0 1; border-top: solid #3a3a3a; }
    #small { width: 100%; height: 100%; content-align: center middle; display: none; }
    Footer { background: #262626; }
    """
    BINDINGS = (
        Binding("f", "freeze", "Freeze"),
        Binding("r", "record", "Record"),
        Binding("c", "capture", "Capture"),
        Binding("left,shift+tab", "previous", "Axis", key_display="← →"),
        Binding("right,tab", "next", "Axis", show=False),
        Binding("plus,equals_sign", "span(1)", "Span", key_display="+ -"),
        Binding("minus", "span(-1)", "Span", show=False),
        Binding("q,ctrl+c", "quit", "Quit", key_display="q"),
        *(Binding(str(n), f"axis({n})", show=False) for n in range(1, 10)),
    )

    def __init__(self, source, watch, axis=None, folder=None):
        super().__init__()
        self.source, self.watch, self.only, self.chosen = source, watch, axis, axis
        self.folder = Path(folder or ".")
        self.frozen, self.span_s, self.capture_shown = None, 20, False
        self._captures_seen = {}
        self._started, self.panel_height = time.monotonic(), FULL

    def compose(self) -> ComposeResult:
        with Vertical(id="body"):
            yield Static(id="head")
            yield Grid(id="panels")
            yield Static(id="chart")
            yield Static(id="events")
            yield Footer()
        yield Static(id="small")

    def on_mount(self):
        if self.only is not None:
            self.watch.axis(self.only)
        if self.source.replayed:
            self.source.start()
        self.set_interval(REFRESH_S, self.refresh_view)
        self.refresh_view()

    def on_resize(self):
        self.call_after_refresh(self.draw)

    # --- keys ----------------------------------------------------------------------------------

    def action_freeze(self):
        self.frozen = None if self.frozen else time.strftime("%H:%M:%S")
        if self.source.replayed:
            self.source.pause(bool(self.frozen))
        self.draw_head()

    def action_record(self):
        if self.source.replayed:
            self.notify("a replay is a log already", severity="warning")
            return
        if self.source.writer:
            writer = self.source.stop_recording()
            self.notify(f"{paths.display(writer.path)}: {writer.count} messages")
        else:
            path = self.folder / time.strftime("forceaxis-%Y%m%d-%H%M%S.log")
            try:
                self.source.record(path)
            except (InputError, OSError) as error:
                self.notify(str(error), severity="error")
        self.draw_head()

    def action_capture(self):
        self.capture_shown = not self.capture_shown
        self.draw()

    def action_span(self, step):
        at = SPANS_S.index(self.span_s) + step
        self.span_s = SPANS_S[max(0, min(at, len(SPANS_S) - 1))]
        self.draw()

    def action_previous(self):
        self._step(-1)

    def action_next(self):
        self._step(1)

    def _step(self, by):
        numbers = sorted(self.watch.axes)
        if numbers:
            at = numbers.index(self.chosen) if self.chosen in numbers else 0
            self.choose(numbers[(at + by) % len(numbers)])

    def action_axis(self, number):
        if number in self.watch.axes:
            self.choose(number)
        else:
            self.notify(f"axis {number}: nothing heard of it", severity="warning")

    def choose(self, number):
        self.chosen, self.capture_shown = number, False
        self.draw()
        for panel in self.query(f"#axis-{number}"):
            panel.scroll_visible(animate=False)

    # --- drawing -------------------------------------------------------------------------------

    def refresh_view(self):
        if not self.frozen:
            self.draw()

    def draw(self):
        # A timer may still fire while the screen is taken down.
        with contextlib.suppress(NoMatches):
            self._draw()

    def _draw(self):
        width, height = self.size
        small = width < SMALLEST[0] or height < SMALLEST[1]
        self.query_one("#body").display = not small
        notice = self.query_one("#small", Static)
        notice.display = small
        if small:
            notice.update(
                f"expected at least {SMALLEST[0]} x {SMALLEST[1]} characters, "
                f"this terminal has {width} x {height}"
            )
            return
        with self.watch.lock:
            now = self.source.now_us()
            axes = [(n, self.watch.axes[n]) for n in sorted(self.watch.axes)]
            shown = [
                (n, a.words(now), 0 if a.heard_us is None else (now - a.heard_us) / 1e6)
                for n, a in axes
            ]
        if self.chosen is None and axes:
            self.chosen = axes[0][0]
        events = 6 if height >= 36 else 4 if height >= 28 else 3
        self.arrange(shown, width, height - 2 - events)
        self.draw_head()
        for number, words, heard_age in shown:
            panel = self.query(f"#axis-{number}")
            if panel:
                panel.first(AxisPanel).show(
                    words, heard_age, self.panel_height, number == self.chosen and len(shown) > 1
                )
        self.draw_events(events, width)
        self.draw_chart(now)

    def arrange(self, shown, width, room):
        """As many columns as fit; the tallest panels that leave the charts their lines."""
        grid = self.query_one("#panels", Grid)
        there = {p.number for p in self.query(AxisPanel)}
        for number, _, _ in shown:
            if number not in there:
                below = [n for n in there if n > number]
                grid.mount(AxisPanel(number), before=f"#axis-{min(below)}" if below else None)
                there.add(number)
        count = max(1, len(shown))
        columns = max(1, min(count, width // PANEL_WIDTH))
        rows = math.ceil(count / columns)
        columns = math.ceil(count / rows)
        least = 13 if room >= 30 else 9
        heights = [h for h in (FULL, COMPACT, SLIM) if rows * h <= room - least]
        self.panel_height = heights[0] if heights else SLIM
        grid.styles.grid_size_columns = columns
        grid.styles.grid_size_rows = rows
        grid.styles.grid_rows = str(self.panel_height)
        grid.styles.height = min(rows * self.panel_height, max(SLIM, room - 6))
        grid.display = bool(shown)

    def draw_head(self):
        with self.watch.lock:
            axes = self.watch.axes.values()
            lost = sum(a.lost() for a in axes)
            rivals = [a.number for a in axes if a.rivals()]
            clock, received = self.watch.clock, self.watch.received
        text = Text("forceaxis", style="bold")
        if rivals:
            named = ", ".join(map(str, rivals))
            text.append(f" · TWO PUBLISHERS on axis {named}", style=f"bold {BAD}")
        if self.source.trouble:
            text.append(f" · {self.source.trouble}", style=f"bold {BAD}")
        text.append(f" · lost {lost}", style=f"bold {BAD}" if lost else QUIET)
        if self.source.replayed:
            text.append(f" · at {self.source.position_s():.1f} s", style=QUIET)
            if self.source.ended:
                text.append(" · END", style=f"bold {WARN}")
        if clock is not None:
            speed = (
                ""
                if known(clock.speed_permille) is None
                else f" x {clock.speed_permille / 1e3:.2f}"
            )
            text.append(f" · simulator {clock_word(clock)}{speed}", style=QUIET)
        text.append(f" · {received} messages · {self.source.name}", style=QUIET)
        right = Text()
        if self.frozen:
            right.append(f" FROZEN {self.frozen} ", style=f"bold #121212 on {IS}")
        if self.source.writer:
            writer = self.source.writer
            right.append(f" ● {writer.path.name} {writer.count} ", style=f"bold {BAD}")
        self.query_one("#head", Static).update(spread(max(10, self.size.width - 2), text, right))

    def draw_events(self, lines, width):
        with self.watch.lock:
            latest = list(self.watch.events)[-(lines - 1) :]
        text = Text()
        for wall_us, number, alarm, said in latest:
            moment = time.strftime("%H:%M:%S", time.localtime(wall_us / 1e6))
            line = Text.assemble(
                (f"{moment}.{int(wall_us // 100000 % 10)} ", QUIET),
                ("" if number is None else f"axis {number}  ", QUIET),
                (" ".join(said.split()), f"bold {BAD}" if alarm else ""),
            )
            line.truncate(width - 2, overflow="ellipsis")
            text.append("\n" if text else "")
            text.append_text(line)
        if not latest:
            text = Text("no events yet", style=QUIET)
        events = self.query_one("#events", Static)
        events.styles.height = lines
        events.update(text)

    def draw_chart(self, now):
        chart = self.query_one("#chart", Static)
        width, height = chart.size.width - 2, chart.size.height
        if width < 20 or height < 3:
            return
        with self.watch.lock:
            axis = self.watch.axes.get(self.chosen)
            if axis is None or (axis.state is None and axis.capture is None):
                waited = time.monotonic() - self._started
                chart.update(
                    Text(
                        f"listening to {self.source.name}: no state heard for {waited:.0f} s\n"
                        "is the gateway running, on this URL?",
                        style=QUIET,
                    )
                )
                return
            seen = self._captures_seen.get(self.chosen, 0)
            if axis.captures != seen:
                self._captures_seen[self.chosen] = axis.captures
                self.capture_shown = True
            if self.capture_shown and axis.capture:
                drawn = capture_chart(axis, width, height)
            else:
                drawn = strip_charts(axis, width, height, now, self.span_s)
        chart.update(drawn)


def strip_charts(axis, width, height, now_us, span_s):
    """Force, position and codes over the last span_s, as many of them as fit."""
    now = now_us / 1e6
    data = axis.trace.since(now - span_s)
    time_s = data["time"] - now
    unit = axis.forces()[2] if axis.state else ""
    plots = [
        ("force", unit, data["force"], data["force_target"], ("is", "target"), 1.0),
        ("position", "cnt", data["position"], data["position_target"], ("is", "target"), 10.0),
        ("code", "", data["code"], data["command"], ("out", "before limits"), 10.0),
    ]
    room = height - 1
    count = 3 if room >= 9 else 2 if room >= 6 else 1
    heights = [room // count + (1 if i < room % count else 0) for i in range(count)]
    parts = []
    for (name, measure, is_, wanted, legend, least), rows in zip(plots, heights, strict=False):
        title = Text.assemble((f"axis {axis.number} " if not parts else "", QUIET), (name, "bold"))
        lines = []
        for values, colour, word in ((is_, IS, legend[0]), (wanted, WANTED, legend[1])):
            finite = np.flatnonzero(np.isfinite(values))
            if finite.size:
                last = charts.number(values[finite[-1]])
                title.append(f"   ━ {word} {last} {measure}".rstrip(), style=colour)
                lines.append((*broken(time_s, values), colour))
        parts.append(charts.panel(width, rows, title, lines, (-span_s, 0), least=least))
    parts.append(charts.time_axis(width, span_s))
    return Text("\n").join(parts)


def broken(time_s, values):
    """The line, interrupted where messages are missing for longer than a few of them take."""
    if len(time_s) < 3:
        return time_s, values
    steps = np.diff(time_s)
    holes = np.flatnonzero(steps > max(0.25, 5 * float(np.median(steps)))) + 1
    return np.insert(time_s, holes, np.nan), np.insert(values, holes, np.nan)


def capture_chart(axis, width, height):
    """The latest capture: each signal a strip over ms from the trigger, as many as fit."""
    (_, number), held = axis.capture
    if not held.signals:
        return Text("capture: no samples yet", style=QUIET)
    names = held.signals[: max(1, (height - 2) // 3)]
    ms = (np.arange(held.total) - held.trigger_sample) * held.decimation / 1.5
    span = (float(ms[0]), float(ms[-1]) if len(ms) > 1 else float(ms[0]) + 1)
    missing = f", {held.missing} not here" if held.missing else ""
    hidden = len(held.signals) - len(names)
    more = f", {hidden} more signals in the log" if hidden else ""
    seconds = held.total * held.decimation / 1500
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
        parts.append(charts.panel(width, rows, title, [(ms, values, IS)], span, least=1e-6))
    ends = f"{span[0]:.1f} ms", f"{span[1]:.1f} ms"
    gap = max(1, width - charts.GUTTER - sum(map(len, ends)))
    parts.append(Text(" " * charts.GUTTER + ends[0] + " " * gap + ends[1], style="dim"))
    return Text("\n").join(parts)
