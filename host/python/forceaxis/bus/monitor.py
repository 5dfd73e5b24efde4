"""The monitor, a terminal program that shows the state of axes live. The program sends
nothing to an axis."""

import contextlib
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Grid, Vertical
from textual.css.query import NoMatches
from textual.widgets import Footer, Static

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.bus.monitor_state import Watch, clock_word, known
from forceaxis.bus.monitor_view import (
    ACTUAL,
    BAD,
    COMPACT,
    FULL,
    QUIET,
    SLIM,
    WARN,
    AxisPanel,
    capture_chart,
    spread,
    strip_charts,
)
from forceaxis.bus.sources import ReplaySource, Source

SMALLEST_TERMINAL = (60, 16)
PANEL_WIDTH = 38
SPANS_S = (2, 5, 10, 20, 40, 80)
REFRESH_PERIOD_S = 0.2


class Monitor(App[None]):
    """The screen of the monitor, for the axes of one source of messages. It has a panel for each
    axis at the top, and charts of the selected axis below the panels."""

    TITLE = "Monitor of forceaxis"
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
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("f", "freeze", "Freeze"),
        Binding("r", "record", "Record"),
        Binding("c", "capture", "Capture"),
        Binding("u", "units", "Codes"),
        Binding("left,shift+tab", "previous", "Axis", key_display="← →"),
        Binding("right,tab", "next", "Axis", show=False),
        Binding("plus,equals_sign", "span(1)", "Span", key_display="+ -"),
        Binding("minus", "span(-1)", "Span", show=False),
        Binding("q,ctrl+c", "quit", "Quit", key_display="q"),
        *(Binding(str(n), f"axis({n})", show=False) for n in range(1, 10)),
    ]

    def __init__(
        self,
        source: Source,
        watch: Watch,
        axis: int | None = None,
        folder: Path | None = None,
        may_record: bool = True,
    ) -> None:
        super().__init__()
        self.source, self.watched, self.only, self.chosen = source, watch, axis, axis
        self.folder = Path(folder or ".")
        self.codes, self.may_record = False, may_record
        self.frozen: str | None = None  # time of day at which the user paused the display, or None
        self.span_s, self.capture_shown = 20, False
        self._captures_seen: dict[int, int] = {}
        self._started, self.panel_height = time.monotonic(), FULL

    def compose(self) -> ComposeResult:
        with Vertical(id="body"):
            yield Static(id="head")
            yield Grid(id="panels")
            yield Static(id="chart")
            yield Static(id="events")
            yield Footer(compact=True)
        yield Static(id="small")

    def on_mount(self) -> None:
        if self.only is not None:
            self.watched.axis(self.only)
        if isinstance(self.source, ReplaySource):
            self.source.start()
        self.set_interval(REFRESH_PERIOD_S, self.refresh_view)
        self.refresh_view()

    def on_resize(self) -> None:
        self.call_after_refresh(self.draw)

    def action_freeze(self) -> None:
        self.frozen = None if self.frozen else time.strftime("%H:%M:%S")
        if isinstance(self.source, ReplaySource):
            self.source.pause(bool(self.frozen))
        self.draw_head()

    def watch_app_focus(self, focused: bool) -> None:
        # A page in a browser must show the available keys before the user has clicked it.
        if not focused:
            self.app_focus = True
            self.refresh_bindings()

    def check_action(self, action: str, _: tuple[object, ...]) -> bool:
        return action != "record" or self.may_record

    def action_units(self) -> None:
        self.codes = not self.codes
        self.draw()

    def action_record(self) -> None:
        if isinstance(self.source, ReplaySource):
            self.notify("a replay is a log already", severity="warning")
            return
        if writer := self.source.stop_recording():
            self.notify(f"{paths.display(writer.path)}: {writer.count} messages")
        else:
            path = self.folder / time.strftime("forceaxis-%Y%m%d-%H%M%S.log")
            try:
                self.source.record(path)
            except (InputError, OSError) as error:
                self.notify(str(error), severity="error")
        self.draw_head()

    def action_capture(self) -> None:
        self.capture_shown = not self.capture_shown
        self.draw()

    def action_span(self, step: int) -> None:
        at = SPANS_S.index(self.span_s) + step
        self.span_s = SPANS_S[max(0, min(at, len(SPANS_S) - 1))]
        self.draw()

    def action_previous(self) -> None:
        self._step(-1)

    def action_next(self) -> None:
        self._step(1)

    def _step(self, by: int) -> None:
        numbers = sorted(self.watched.axes)
        if numbers:
            at = numbers.index(self.chosen) if self.chosen in numbers else 0
            self.choose(numbers[(at + by) % len(numbers)])

    def action_axis(self, number: int) -> None:
        if number in self.watched.axes:
            self.choose(number)
        else:
            self.notify(f"axis {number}: nothing heard of it", severity="warning")

    def choose(self, number: int) -> None:
        self.chosen, self.capture_shown = number, False
        self.draw()
        for panel in self.query(f"#axis-{number}"):
            panel.scroll_visible(animate=False)

    def on_axis_panel_chosen(self, event: AxisPanel.Chosen) -> None:
        self.choose(event.number)

    def refresh_view(self) -> None:
        if not self.frozen:
            self.draw()

    def draw(self) -> None:
        # The timer may call this function while the screen closes.
        with contextlib.suppress(NoMatches):
            self._draw()

    def _draw(self) -> None:
        width, height = self.size
        small = width < SMALLEST_TERMINAL[0] or height < SMALLEST_TERMINAL[1]
        self.query_one("#body").display = not small
        notice = self.query_one("#small", Static)
        notice.display = small
        if small:
            notice.update(
                f"expected at least {SMALLEST_TERMINAL[0]} x {SMALLEST_TERMINAL[1]} characters, "
                f"this terminal has {width} x {height}"
            )
            return
        with self.watched.lock:
            now = self.source.now_us()
            axes = [(n, self.watched.axes[n]) for n in sorted(self.watched.axes)]
            shown = [(n, a.words(now)) for n, a in axes]
        if self.chosen is None and axes:
            self.chosen = axes[0][0]
        events = 6 if height >= 36 else 4 if height >= 28 else 3
        self.arrange([number for number, _ in shown], width, height - 2 - events)
        self.draw_head()
        for number, words in shown:
            panel = self.query(f"#axis-{number}")
            if panel:
                panel.first(AxisPanel).show(
                    words,
                    self.panel_height,
                    number == self.chosen and len(shown) > 1,
                    self.codes,
                )
        self.draw_events(events, width)
        self.draw_chart(now)

    def arrange(self, shown: Sequence[int], width: int, room: int) -> None:
        """Arranges the panels. Sets their number of columns and their largest height so that enough
        text lines remain for the charts."""
        grid = self.query_one("#panels", Grid)
        there = {p.number for p in self.query(AxisPanel)}
        for number in shown:
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

    def draw_head(self) -> None:
        with self.watched.lock:
            axes = self.watched.axes.values()
            lost = sum(a.lost() for a in axes)
            rivals = [a.number for a in axes if a.rivals()]
            clock, received = self.watched.clock, self.watched.received
        text = Text("forceaxis", style="bold")
        if rivals:
            named = ", ".join(map(str, rivals))
            text.append(f" · TWO PUBLISHERS on axis {named}", style=f"bold {BAD}")
        if self.source.trouble:
            text.append(f" · {self.source.trouble}", style=f"bold {BAD}")
        text.append(f" · lost {lost}", style=f"bold {BAD}" if lost else QUIET)
        if isinstance(self.source, ReplaySource):
            text.append(f" · at {self.source.position_s():.1f} s", style=QUIET)
            if self.source.ended:
                text.append(" · END", style=f"bold {WARN}")
        if clock is not None:
            permille = known(clock.speed_permille)
            speed = "" if permille is None else f" x {permille / 1e3:.2f}"
            text.append(f" · simulator {clock_word(clock)}{speed}", style=QUIET)
        text.append(f" · {received} messages · {self.source.name}", style=QUIET)
        right = Text()
        if self.frozen:
            right.append(f" FROZEN {self.frozen} ", style=f"bold #121212 on {ACTUAL}")
        if self.source.writer:
            writer = self.source.writer
            right.append(f" ● {writer.path.name} {writer.count} ", style=f"bold {BAD}")
        self.query_one("#head", Static).update(spread(max(10, self.size.width - 2), text, right))

    def draw_events(self, lines: int, width: int) -> None:
        with self.watched.lock:
            latest = list(self.watched.events)[-(lines - 1) :]
        drawn = Text()
        for event in latest:
            moment = time.strftime("%H:%M:%S", time.localtime(event.wall_us / 1e6))
            line = Text.assemble(
                (f"{moment}.{event.wall_us // 100000 % 10} ", QUIET),
                ("" if event.axis is None else f"axis {event.axis}  ", QUIET),
                (" ".join(event.text.split()), f"bold {BAD}" if event.alarm else ""),
            )
            line.truncate(width - 2, overflow="ellipsis")
            drawn.append("\n" if drawn else "")
            drawn.append_text(line)
        if not latest:
            drawn = Text("no events yet", style=QUIET)
        events = self.query_one("#events", Static)
        events.styles.height = lines
        events.update(drawn)

    def draw_chart(self, now: float) -> None:
        chart = self.query_one("#chart", Static)
        width, height = chart.size.width - 2, chart.size.height
        if width < 20 or height < 3:
            return
        with self.watched.lock:
            axis = None if self.chosen is None else self.watched.axes.get(self.chosen)
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
            seen = self._captures_seen.get(axis.number, 0)
            if axis.captures != seen:
                self._captures_seen[axis.number] = axis.captures
                self.capture_shown = True
            if self.capture_shown and axis.capture:
                drawn = capture_chart(axis, width, height)
            else:
                drawn = strip_charts(axis, width, height, now, self.span_s, self.codes)
        chart.update(drawn)
