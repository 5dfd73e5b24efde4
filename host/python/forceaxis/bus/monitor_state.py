"""Received data of each axis that the monitor shows: latest state, history for the charts, events,
captures, and numbers of lost messages.

The thread of a connection, or of a replayed log, adds the messages. The thread of the monitor reads
the data. One lock protects all data.
"""

import dataclasses
import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from forceaxis.bus import state_names
from forceaxis.bus.capture_assembly import Assembly, Samples
from forceaxis.bus.lcm import NOT_AVAILABLE, TABLE_HASH, Gaps, Undecodable, channel_of, decode
from forceaxis.bus.messages import (
    axis_capture_t,
    axis_command_t,
    axis_event_t,
    axis_state_t,
    sim_clock_t,
)
from forceaxis.results import json_field

# Largest number of states that are stored for the charts: two minutes at 100 states per second.
HISTORY_STATES = 12_000
RATE_WINDOW_S = 3.0  # time span in s over which the message rate is computed

COMMAND_KINDS = {
    axis_command_t.KIND_WRITE: "write",
    axis_command_t.KIND_READ: "read",
    axis_command_t.KIND_CAPTURE: "capture",
    axis_command_t.KIND_TAKE: "take the axis",
    axis_command_t.KIND_RELEASE: "release the axis",
    axis_command_t.KIND_REPEAT: "send again",
}
VOLT_PER_CODE = 20 / 4096  # output voltage in V of one DAC code
T = TypeVar("T")
# {code of a unit in CiA 303-2: (displayed unit, number of displayed units in one such unit)}.
# CiA 303-2 defines these three codes for the units metre, radian and degree.
POSITION_UNITS = {0x01: ("mm", 1e3), 0x10: ("deg", 180 / math.pi), 0x41: ("deg", 1.0)}
# text before the number of repetitions of an event in the list of events
REPETITION_MARK = " x"
# Kinds of events that the monitor shows as alarms.
ALARM_EVENTS = {
    axis_event_t.EVENT_REFUSED,
    axis_event_t.EVENT_EMCY,
    axis_event_t.EVENT_FAULT,
    axis_event_t.EVENT_HEARTBEAT_LOST,
    axis_event_t.EVENT_TABLE_MISMATCH,
    axis_event_t.EVENT_BUS,
}


def known(value: T) -> T | None:
    """Returns the value of a field of a message, or None if the field is NOT_AVAILABLE."""
    return None if value == NOT_AVAILABLE else value


@dataclass(frozen=True)
class AxisSnapshot:
    """The state of an axis as texts and numbers. None means that a value is not available.

    position, target_position and velocity_per_s are in position_unit (mm, deg, user unit or count).
    silent: True if the axis no longer sends, so that the values are its last ones. age_s: age of
    the values in s.
    """

    drive_state: str | None
    status: list[str] | None
    statusword: int | None
    mode: str | None
    native_mode: str | None
    node: str | None
    fault: str | None
    error_code: int | None
    limit_reason: str | None
    command_source: str | None
    contact: bool | None
    limit_cycle: bool | None
    position_cnt: int | None
    target_position_cnt: int | None
    following_error_cnt: int | None
    velocity_cnt_per_s: int | None
    position: float | None
    target_position: float | None
    velocity_per_s: float | None
    position_unit: str
    force_cnt: float | None
    force_N: float | None
    target_force_N: float | None
    force_permille: int | None
    target_force_permille: int | None
    dac_code: int | None
    command_code: int | None
    output_V: float | None
    command_V: float | None
    tick: int | None
    age_s: float | None
    silent: bool
    rate_per_s: float
    lost: int
    received: int
    two_publishers: bool
    objects_mismatch: str | None
    more: dict[str, int]


@dataclass(frozen=True)
class ClockSnapshot:
    """The clock of the simulator. `speed` is the ratio of simulated time to real time."""

    tick: int | None
    state: str
    speed: float | None
    text: str


@dataclass(frozen=True)
class WatchedEvent:
    """One entry in the list of events that the monitor shows. `axis` is None if the event belongs
    to no axis."""

    wall_us: int
    axis: int | None
    alarm: bool
    text: str


@dataclass(frozen=True)
class Snapshot:
    """State of all axes at one moment, and the latest events."""

    axes: dict[str, AxisSnapshot]
    clock: ClockSnapshot | None
    received: int
    undecodable: int
    events: list[WatchedEvent]  # the latest events of all axes
    source: str
    trouble: str | None = json_field(omit_none=True)


def text(value: int, words: Callable[[int], T]) -> T | None:
    """Returns the result of words(value), usually a text. Returns None if the value is not
    available."""
    return None if known(value) is None else words(value)


def volt(code: int) -> float:
    """Returns the voltage in V of a DAC code."""
    return code * VOLT_PER_CODE


@dataclass(frozen=True)
class TraceColumns:
    """History of one axis. Each field is an array with one value for each state, and NaN for a
    value that is not available. Times are in s since 1970, forces in the unit of
    AxisWatch.forces(), positions in encoder counts."""

    time_s: Samples
    force: Samples
    force_target: Samples
    position_cnt: Samples
    position_target_cnt: Samples
    dac_code: Samples
    command_code: Samples
    force_cnt: Samples


class Trace:
    """Buffer for the last HISTORY_STATES states of an axis. A row has the values of one state, in
    the order of the fields of TraceColumns."""

    def __init__(self) -> None:
        columns = len(dataclasses.fields(TraceColumns))
        self._rows, self._end = np.full((2 * HISTORY_STATES, columns), np.nan), 0

    def add(self, row: Sequence[float]) -> None:
        if self._end == len(self._rows):
            self._rows[:HISTORY_STATES] = self._rows[HISTORY_STATES:]
            self._end = HISTORY_STATES
        self._rows[self._end] = row
        self._end += 1

    def since(self, time_s: float) -> TraceColumns:
        """Returns a copy of the stored states from the time `time_s` on."""
        rows = self._rows[max(0, self._end - HISTORY_STATES) : self._end]
        rows = rows[np.searchsorted(rows[:, 0], time_s) :].copy()
        return TraceColumns(*rows.T)


class AxisWatch:
    """Received data of one axis. `state` is the latest axis_state_t, or None before the first
    message."""

    def __init__(self, number: int, mm_per_count: float | None = None) -> None:
        self.number, self.mm_per_count = number, mm_per_count
        self.state: axis_state_t | None = None
        self.received_us: int | None = None
        self.trace = Trace()
        self.gaps: dict[str, Gaps] = {}
        self.arrivals: deque[int] = deque(maxlen=1000)
        # ((run_id of the publisher, number of the capture), samples) of the latest capture
        self.capture: tuple[tuple[int, int], Assembly] | None = None
        self.captures = 0

    def take_state(self, state: axis_state_t, wall_us: int) -> None:
        self.state, self.received_us = state, wall_us
        self.arrivals.append(wall_us)
        force, target, _ = self.forces()
        self.trace.add(
            [
                np.nan if v is None else v
                for v in (
                    wall_us / 1e6,
                    force,
                    target,
                    known(state.position_cnt),
                    self.position_target(),
                    known(state.dac_code),
                    known(state.command_code),
                    None if known(state.force_cnt_q8) is None else state.force_cnt_q8 / 256,
                )
            ]
        )

    def _heard(self) -> axis_state_t:
        """Returns the latest state of the axis. Raises LookupError before the first state."""
        if self.state is None:
            raise LookupError(f"axis {self.number}: no state was received")
        return self.state

    def forces(self) -> tuple[float | None, float | None, str]:
        """Returns (force, target force, unit). The unit is N if `force_scale` or the rated force is
        known, otherwise the count. A force is None if the value is not available."""
        state = self._heard()
        count, share = known(state.force_cnt_q8), known(state.force_permille)
        wanted, rated = self.force_wanted(), known(state.rated_force_mN)
        scale = known(state.force_scale_uN)
        force, unit = (None if count is None else count / 256), "count"
        if force is not None and scale:
            force, unit = force * scale * 1e-6, "N"
        elif share is not None and rated:
            force, unit = share * rated * 1e-6, "N"
        in_newtons = unit == "N" or force is None
        target = wanted * rated * 1e-6 if wanted is not None and rated and in_newtons else None
        return force, target, "N" if in_newtons else unit

    def more(self) -> dict[str, int]:
        """Returns {name: raw value} of the additional objects that the latest state contains."""
        state = self._heard()
        return dict(zip(state.more_name, state.more_value, strict=True))

    def length(self) -> tuple[str, float]:
        """Returns the unit in which the monitor shows lengths, and the number of these units in one
        position unit of the axis.

        Object 60A8h selects the unit. Without 60A8h, the unit is mm if the encoder of a model is
        known, otherwise the encoder count.
        """
        more = self.more() if self.state else {}
        if more.get("feed"):
            exponent, unit = divmod(more.get("position_unit", 0) >> 16, 256)
            name, factor = POSITION_UNITS.get(unit, ("user unit", None))
            exponent -= 256 if exponent > 127 else 0
            return (name, factor * 10.0**exponent) if factor else (name, 1)
        return ("mm", self.mm_per_count) if self.mm_per_count else ("count", 1)

    def force_wanted(self) -> int | None:
        """Returns the demanded force in per mille of the rated force, or None in a mode of
        operation that does not control the force."""
        state = self._heard()
        if known(state.mode_display) not in (None, *state_names.FORCE_MODES):
            return None
        demand = self.more().get("force_demand")
        if demand is None and state.mode_display != -1:
            demand = known(state.target_force_permille)
        return demand

    def position_target(self) -> int | None:
        """Returns the demanded position in the position unit of the axis, or None in a mode of
        operation that controls the force."""
        state = self._heard()
        mode = known(state.mode_display)
        if mode in state_names.PROFILE_MODES:
            return known(state.demand_position_cnt)
        in_position = mode is None or mode in state_names.TARGET_MODES
        return known(state.target_position_cnt) if in_position else None

    def age_s(self, now_us: float) -> float | None:
        """Returns the age in s of the values that the drive has sent. It is the time since the
        message was received, plus the age that the message states."""
        if self.received_us is None:
            return None
        return max(0, now_us - self.received_us + (known(self._heard().age_us) or 0)) / 1e6

    def rate(self, now_us: float) -> float:
        """Returns the number of received states per second over the last RATE_WINDOW_S."""
        recent = [t for t in self.arrivals if t > now_us - RATE_WINDOW_S * 1e6]
        if len(recent) < 2 or recent[-1] == recent[0]:
            return 0.0
        return (len(recent) - 1) / ((recent[-1] - recent[0]) / 1e6)

    def lost(self) -> int:
        """Returns the number of lost messages that the gateway has sent about this axis. Lost
        commands of clients are not counted."""
        return sum(g.lost for kind, g in self.gaps.items() if kind != "COMMAND")

    def rivals(self) -> bool:
        return any(g.rivals for kind, g in self.gaps.items() if kind != "COMMAND")

    def mismatch(self) -> str | None:
        """If the firmware has another object table than this program, returns a text with the
        hashes of both object tables. Otherwise returns None."""
        theirs = self.state and known(self.state.objects_hash)
        # If the hash of the object table is 0, the gateway has not read it yet.
        if not theirs or theirs == TABLE_HASH:
            return None
        return f"object table {theirs:08x} in the firmware, {TABLE_HASH:08x} here"

    def words(self, now_us: float) -> AxisSnapshot | None:
        """Returns the latest state as texts and numbers, or None before the first state."""
        state = self.state
        if state is None:
            return None
        count, mode = known(state.force_cnt_q8), known(state.mode_display)
        force, target, unit = self.forces()
        length, size = self.length()

        def length_of(count: int | None) -> float | None:
            return None if count is None else count * size

        def enum(name: str, value: int) -> str | None:
            return text(value, lambda raw: state_names.enum(name, raw))

        return AxisSnapshot(
            drive_state=text(state.statusword, state_names.drive_state),
            status=text(state.statusword, lambda w: state_names.status_bits(w, mode)),
            statusword=known(state.statusword),
            mode=text(state.mode_display, state_names.mode),
            native_mode=enum("active_mode", state.native_mode),
            node=text(state.nmt_state, state_names.node_state),
            fault=enum("fault", state.fault),
            error_code=known(state.error_code),
            limit_reason=enum("limit_reason", state.limit_reason),
            command_source=enum("command_source", state.command_source),
            contact=text(state.contact, bool),
            limit_cycle=text(state.limit_cycle, bool),
            position_cnt=known(state.position_cnt),
            target_position_cnt=self.position_target(),
            following_error_cnt=known(state.following_error_cnt),
            velocity_cnt_per_s=known(state.velocity_cnt_per_s),
            position=length_of(known(state.position_cnt)),
            target_position=length_of(self.position_target()),
            velocity_per_s=length_of(known(state.velocity_cnt_per_s)),
            position_unit=length,
            force_cnt=None if count is None else count / 256,
            force_N=force if unit == "N" else None,
            target_force_N=target,
            force_permille=known(state.force_permille),
            target_force_permille=self.force_wanted(),
            dac_code=known(state.dac_code),
            command_code=known(state.command_code),
            output_V=text(state.dac_code, volt),
            command_V=text(state.command_code, volt),
            tick=known(state.tick),
            age_s=self.age_s(now_us),
            silent=state_names.is_silent(state.nmt_state, self.age_s(now_us) or 0.0),
            rate_per_s=self.rate(now_us),
            lost=self.lost(),
            received=sum(g.received for g in self.gaps.values()),
            two_publishers=self.rivals(),
            objects_mismatch=self.mismatch(),
            more=self.more(),
        )


class Watch:
    """Received data of all axes. `now_us` is the time in us since 1970 from which ages are
    computed. It is the present time, or the time within a replayed log.

    `mm_per_count` is the size of an encoder count for axes without user units.
    """

    def __init__(self, mm_per_count: float | None = None) -> None:
        self.mm_per_count = mm_per_count
        self.lock = threading.RLock()
        self.axes: dict[int, AxisWatch] = {}
        self.clock: sim_clock_t | None = None
        self.events: deque[WatchedEvent] = deque(maxlen=500)
        self.received = self.undecodable = 0
        self.gaps: dict[str, Gaps] = {}  # number of lost messages for each channel of the simulator

    def axis(self, number: int) -> AxisWatch:
        if number not in self.axes:
            self.axes[number] = AxisWatch(number, self.mm_per_count)
        return self.axes[number]

    def take(self, channel: str, data: bytes, wall_us: int) -> None:
        """Processes one LCM message."""
        number, kind = channel_of(channel)
        if kind is None or kind == "TRUTH":
            return
        try:
            message = decode(channel, data)
        except Undecodable as error:
            with self.lock:
                self.undecodable += 1
                if self.undecodable in (1, 10, 100, 1000):
                    self.events.append(
                        WatchedEvent(wall_us, number, True, f"{error} ({self.undecodable}x)")
                    )
            return
        with self.lock:
            self.received += 1
            gaps = self.gaps if number is None else self.axis(number).gaps
            if not gaps.setdefault(kind, Gaps()).take(message.run_id, message.seq):
                return
            if isinstance(message, sim_clock_t):
                self.clock = message
            elif number is None:
                return
            elif isinstance(message, axis_state_t):
                self.axis(number).take_state(message, wall_us)
            elif isinstance(message, axis_event_t):
                alarm = message.kind in ALARM_EVENTS and not (
                    message.kind in (axis_event_t.EVENT_FAULT, axis_event_t.EVENT_EMCY)
                    and message.code == 0
                )
                text = message.text or f"kind {message.kind}"
                if message.kind == axis_event_t.EVENT_DONE:
                    self._routine(wall_us, number, text)
                else:
                    self.events.append(WatchedEvent(wall_us, number, alarm, text))
            elif isinstance(message, axis_command_t):
                self._routine(wall_us, number, command_text(message))
            elif isinstance(message, axis_capture_t):
                self._take_capture(self.axis(number), message, wall_us)

    def _routine(self, wall_us: int, number: int | None, text: str) -> None:
        """Adds an entry to the list of events, for a command of a client or for the answer to a
        command.

        A command that a client repeats, such as the write to `watchdog`, has only one entry with
        the number of repetitions. Other events therefore remain visible.
        """
        for i, event in enumerate(self.events):
            base, _, count = event.text.rpartition(REPETITION_MARK)
            if event.alarm or event.axis != number or text not in (base, event.text):
                continue
            del self.events[i]
            text = f"{text}{REPETITION_MARK}{2 if text == event.text else int(count) + 1}"
            break
        self.events.append(WatchedEvent(wall_us, number, False, text))

    def _take_capture(self, axis: AxisWatch, block: axis_capture_t, wall_us: int) -> None:
        key = (block.run_id, block.capture_id)
        if axis.capture is None or axis.capture[0] != key:
            axis.capture = (key, Assembly())
            axis.captures += 1
        if not axis.capture[1].take(block):
            text = f"capture {block.capture_id}: a block that does not fit the others"
            self.events.append(WatchedEvent(wall_us, axis.number, True, text))

    def snapshot(
        self, source: str, now_us: float, axis: int | None = None, trouble: str | None = None
    ) -> Snapshot:
        """Returns the state of all axes, or of one axis. `source` is the name of the source of the
        messages. `trouble` is the text of the error that ended the source."""
        with self.lock:
            return Snapshot(
                axes={
                    str(number): state
                    for number, watched in sorted(self.axes.items())
                    if axis in (None, number) and (state := watched.words(now_us)) is not None
                },
                clock=self._clock(),
                received=self.received,
                undecodable=self.undecodable,
                events=[event for event in list(self.events)[-20:] if axis in (None, event.axis)],
                source=source,
                trouble=trouble or None,
            )

    def _clock(self) -> ClockSnapshot | None:
        if self.clock is None:
            return None
        permille = known(self.clock.speed_permille)
        return ClockSnapshot(
            tick=known(self.clock.tick),
            state=clock_word(self.clock),
            speed=None if permille is None else permille / 1000,
            text=self.clock.text,
        )


def clock_word(clock: sim_clock_t) -> str:
    return {1: "running", 2: "paused", 3: "ended"}.get(clock.clock_state, str(clock.clock_state))


def command_text(command: axis_command_t) -> str:
    """Returns a command as one text line, such as "write force_gain=1792"."""
    words = [COMMAND_KINDS.get(command.kind, f"command kind {command.kind}")]
    if command.kind == axis_command_t.KIND_READ:
        words += command.object
    else:
        words += [f"{n}={v}" for n, v in zip(command.object, command.value, strict=True)]
    words += command.signal
    return " ".join(words)
