"""Sends commands to an axis through its gateway over LCM, and waits until the axis acknowledges the
commands.

    from forceaxis.bus.client import AxisClient

    with AxisClient(1) as axis:
        axis.take() # acquires the axis, which then refuses commands from other buses
        axis.write("force_gain", 7.0)          # engineering value, or text of an enumeration
        axis.read("force_gain")                # 7.0
        held = axis.capture(["force", "dac_code"], samples=1500)
        axis.wait_event(axis_event_t.EVENT_FAULT, timeout_s=60)
        axis.release()

A command that the axis refuses raises Refused with the reason. A command without an acknowledgement
raises NoAnswer. A name or value that the object table does not permit raises InputError before
anything is sent.
"""

import math
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from forceaxis._core import InputError
from forceaxis.bus.capture_assembly import SAMPLES_MAX, Assembly
from forceaxis.bus.lcm import (
    AXES,
    NOT_AVAILABLE,
    TABLE_HASH,
    Bus,
    Closable,
    Gaps,
    Undecodable,
    decode,
)
from forceaxis.bus.messages import axis_capture_t, axis_command_t, axis_event_t, axis_state_t
from forceaxis.bus.state_names import texts
from forceaxis.objects import BY_NAME, AxisObject, state_needed
from forceaxis.words import number, suggestion

# Number of times that a command without an answer is sent within its time-out.
# If a network loses half of all datagrams, only one of 100,000 commands stays without an answer.
COMMAND_TRIES = 40
# If no block of a capture arrives for this time in s, the client asks the gateway for samples.
# PROGRESS_WAIT_S applies while the gateway may still read the samples from the axis.
# LATE_BLOCKS_WAIT_S applies after the gateway has read all samples.
PROGRESS_WAIT_S, LATE_BLOCKS_WAIT_S = 1.0, 0.25
# TRANSFER_MAX_S: longest time in s from the trigger of a capture until all samples have arrived.
# FRUITLESS_MAX: largest number of consecutive requests for lost samples without a new sample.
# If a network loses half of all datagrams, only one of a million captures needs more requests.
TRANSFER_MAX_S, FRUITLESS_MAX = 120.0, 20
RANGES_MAX = 100  # largest number of ranges of lost samples in one request
WAKE_S = 0.25  # longest time in s between two checks of the received messages
SILENCE_S = 1.0  # longest time in s between two state messages of an axis while the gateway runs

T = TypeVar("T")
Value = float | str  # engineering value, or the text of an enumeration
# SDO abort codes of CiA 301: time-out of the SDO protocol, and wrong state of the device.
SDO_TIMEOUT, NOT_NOW = 0x05040000, 0x08000022
ADDRESS = re.compile(r"0x[0-9a-fA-F]{1,4}(:[0-9]{1,3})?")


class Refused(Exception):
    """Error: the axis or the connection refused a command or an access.

    The error text states the reason. `code` is the SDO abort code, or 0 if there is none. `event`
    is the answer of the gateway, or None if the connection has no gateway.
    """

    def __init__(self, text: str, code: int = 0, event: axis_event_t | None = None) -> None:
        super().__init__(text)
        self.code, self.event = code, event


class NoAnswer(TimeoutError):
    """Error: the axis did not answer, or an expected state or event did not occur within the time
    limit."""


def object_named(name: str) -> AxisObject | None:
    """Returns the object with the name `name`. Returns None if `name` is a CANopen address such as
    0x6040:0. Raises InputError for an unknown name."""
    if ADDRESS.fullmatch(name):
        return None
    if name not in BY_NAME:
        raise InputError(
            f"{name}: expected the name of an object, or 0xINDEX[:SUB], got an unknown name; "
            f"`list_objects` lists the names{suggestion(name, BY_NAME)}"
        )
    return BY_NAME[name]


def to_raw(name: str, value: Value) -> int:
    """Converts an engineering value or the text of an enumeration to the raw value of an object.

    If `name` is a CANopen address, `value` must already be a raw value. Raises InputError for a
    value outside the range of the object.
    """
    known = object_named(name)
    if known and isinstance(value, str) and value in texts(known):
        return texts(known)[value]
    if known is None:
        permitted, low, high = "an integer of at most 32 bits", -(2**31), 2**32 - 1
    else:
        low, high = known.min, known.max
        span = " to ".join(f"{n * known.scale:g}" for n in dict.fromkeys((low, high)))
        unit = "" if known.unit == "1" else known.unit
        permitted = (
            f"one of {', '.join(texts(known))}" if texts(known) else f"{span} {unit}".rstrip()
        )
    try:
        if known is None:
            raw = int(value, 0) if isinstance(value, str) else int(value)
        else:
            raw = round(number(value) / known.scale)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name}: expected {permitted}, got {value}") from None
    if not low <= raw <= high:
        raise InputError(f"{name}: expected {permitted}, got {value}")
    return raw


def from_raw(name: str, raw: int) -> Value:
    """Converts the raw value of an object to an engineering value or to the text of an enumeration.
    If the scale is 1, the engineering value is an integer."""
    known = BY_NAME.get(name)
    if known is None:
        return raw
    for text, value in texts(known).items():
        if value == raw:
            return text
    return raw if known.scale == 1 else raw * known.scale


class AxisClient(Closable):
    """Sends commands to one axis through its gateway, and waits until the axis acknowledges the
    commands."""

    def __init__(self, axis: int, url: str | None = None, timeout_s: float = 2.0) -> None:
        if axis not in AXES:
            raise InputError(
                f"axis: expected an axis number from {AXES.start} to {AXES.stop - 1}, got {axis}"
            )
        self.axis, self.timeout_s = axis, timeout_s
        self.gaps: dict[str, Gaps] = {}
        self.undecodable = self._command_id = self._heard = self._since = 0
        self._state: axis_state_t | None = None
        self._captures: dict[int, Assembly] = {}
        self._events: deque[tuple[int, axis_event_t]] = deque(maxlen=10_000)
        self._news, self._received_s = threading.Condition(), -math.inf
        # Time at which a block of the capture of this client last arrived or was last requested.
        self._block_s = -math.inf
        self._bus = Bus(url, self._take, f"AXIS_{axis}_(STATE|EVENT|CAPTURE)")

    def close(self) -> None:
        self._bus.close()

    def write(self, name: str, value: Value) -> axis_event_t:
        """Writes one object. `value` is an engineering value or the text of an enumeration. For a
        CANopen address, `value` is a raw value. Returns the event that acknowledges the command."""
        return self.write_all({name: value})

    def write_all(self, values: Mapping[str, Value]) -> axis_event_t:
        """Writes {object: value} in order. If a value is refused, the earlier values stay written
        and the later values are not written. Returns the event that acknowledges the command."""
        return self.write_raw({name: to_raw(name, value) for name, value in values.items()})

    def write_raw(self, values: Mapping[str, int]) -> axis_event_t:
        """Writes {object: raw value} in order, in the same way as write_all()."""
        return self._command(axis_command_t.KIND_WRITE, list(values.items()))

    def read(self, name: str) -> Value:
        """Reads one object, and returns an engineering value or the text of an enumeration. For a
        CANopen address, returns the raw value."""
        return self.read_all([name])[name]

    def read_all(self, names: Sequence[str]) -> dict[str, Value]:
        """Reads several objects, and returns {object: value}. All values belong to the same tick if
        the gateway can read these objects together."""
        return {name: from_raw(name, raw) for name, raw in self.read_raw(names).items()}

    def read_raw(self, names: Sequence[str]) -> dict[str, int]:
        """Reads several objects, and returns {object: raw value}. All values belong to the same
        tick if the gateway can read these objects together."""
        for name in names:
            object_named(name)
        answer = self._command(axis_command_t.KIND_READ, [(name, 0) for name in names])
        return dict(zip(answer.object, answer.value, strict=True))

    def take(self) -> axis_event_t:
        """Acquires the axis: LCM becomes the command source of the axis. This program stays the
        owner as long as the time between two of its writes is shorter than the time in the object
        `watchdog`."""
        return self._command(axis_command_t.KIND_TAKE)

    def release(self) -> axis_event_t:
        """Releases the axis. CANopen then becomes the command source of the axis."""
        return self._command(axis_command_t.KIND_RELEASE)

    def capture(
        self, signals: Sequence[str], samples: int = 0, timeout_s: float = 30.0, **settings: Value
    ) -> Assembly:
        """Records `signals` in each tick, and returns the recording as an Assembly. Calls arm() and
        then captured().

        `samples`: number of samples; 0 means as many as the recorder can store. `settings`: values
        of further objects of the recorder, named without the prefix `recorder_`, such as
        decimation=3, pretrigger=100, trigger_edge="rising" or trigger_level=5120.
        """
        return self.captured(self.arm(signals, samples, **settings), timeout_s)

    def arm(self, signals: Sequence[str], samples: int = 0, **settings: Value) -> int:
        """Starts a recording with the arguments of capture(). Returns the number of the recording,
        which captured() needs."""
        if not 1 <= len(signals) <= 8:
            raise InputError(f"capture: expected 1 to 8 signals, got {len(signals)}")
        for name in signals:
            if object_named(name) is None:
                raise InputError(
                    f"{name}: expected the name of an object that can be recorded; choose another "
                    "object"
                )
        wanted = {"length": samples, **settings}
        items = [(f"recorder_{n}", to_raw(f"recorder_{n}", v)) for n, v in wanted.items()]
        self._command(axis_command_t.KIND_CAPTURE, items, signals)
        self._block_s = time.monotonic()
        return self._command_id

    def fetch(self, signals: Sequence[str]) -> int:
        """Loads the incident that the black box of the axis has stored into the recorder.
        `signals`: names of the signals that the black box has recorded. Returns the number of this
        recording, which captured() needs."""
        self._command(axis_command_t.KIND_CAPTURE, [("incident_command", 1)], signals)
        self._block_s = time.monotonic()
        return self._command_id

    def captured(self, number: int, timeout_s: float = 30.0) -> Assembly:
        """Waits for the end of a recording, for at most `timeout_s`, and then for its samples.
        Requests lost samples from the gateway again. Returns the recording as a
        capture_assembly.Assembly, whose `missing` is the number of samples that could not be
        received."""
        end = time.monotonic() + timeout_s
        is_read, have, fruitless = False, 0, 0  # is_read: True if the gateway has read the recorder
        while not self._whole(number):
            self._await_blocks(number, is_read, max(end - time.monotonic(), 0.0) or math.inf)
            before, have = have, self._have(number)
            fruitless = fruitless + 1 if is_read and have == before else 0
            late_s = time.monotonic() - end
            if self._whole(number) or fruitless >= FRUITLESS_MAX or late_s > TRANSFER_MAX_S:
                break
            ended = self._ended(number)
            if ended and ended.code < 0:
                raise _refusal(ended)
            try:
                is_read = self._repeat(number)
            except NoAnswer:
                if late_s > 0:
                    raise
            if not is_read and late_s > 0:
                self._expect_end(timeout_s)
            self._block_s = time.monotonic()
        with self._news:
            held = self._captures.pop(number, None)
        if held is None:
            raise NoAnswer(
                f"axis {self.axis}: expected the samples of a capture, but none were received on "
                f"{self._bus.url}; record again"
            )
        return held

    def _whole(self, number: int) -> Assembly | None:
        held = self._captures.get(number)
        return held if held and held.complete else None

    def _have(self, number: int) -> int:
        held = self._captures.get(number)
        return held.total - held.missing if held else 0

    def _await_blocks(self, number: int, is_read: bool, timeout_s: float) -> None:
        """Waits until all samples of a capture have arrived or until its transfer has stalled, for
        at most `timeout_s`."""
        with self._news:
            self._await(lambda: self._whole(number) or self._stalled(number, is_read), timeout_s)

    def _stalled(self, number: int, is_read: bool) -> bool | None:
        """Returns True if a capture has failed. Also returns True if no block has arrived for so
        long that the client has to request samples. Otherwise returns None. `is_read`: True if the
        gateway has read all samples from the axis."""
        ended = self._ended(number)
        if ended and ended.code < 0:
            return True
        wait_s = LATE_BLOCKS_WAIT_S if is_read or ended else PROGRESS_WAIT_S
        return True if time.monotonic() - self._block_s > wait_s else None

    def _repeat(self, number: int) -> bool:
        """Asks the gateway to send the missing samples of a capture again. Returns False if the
        gateway has not read these samples from the axis yet. Raises Refused, NoAnswer."""
        with self._news:
            held = self._captures.get(number)
            ranges = held.gaps()[:RANGES_MAX] if held else [(0, SAMPLES_MAX)]
        items = [("command_id", number)]
        for first, end in ranges:
            items += [("first_sample", first), ("end_sample", end)]
        answer = self._command(axis_command_t.KIND_REPEAT, items)
        total: int = answer.value[answer.object.index("total_samples")]
        return total > 0

    def _expect_end(self, timeout_s: float) -> None:
        """Raises NoAnswer if the recorder still waits for its trigger or still records."""
        state = self.read("recorder_state")
        if state not in ("armed", "recording"):
            return  # At this point, the gateway is still reading the samples from the axis.
        why = "the recording has not ended; wait longer"
        if state == "armed":
            why = (
                "the trigger condition has not occurred; wait longer, or check trigger_source, "
                "trigger_level and trigger_edge"
            )
        raise NoAnswer(f"axis {self.axis}: expected a capture within {timeout_s:g} s, {why}")

    def _event_of(self, command_id: int, *kinds: int) -> axis_event_t | None:
        """Returns the latest event that has one of the given kinds and answers a command of this
        client."""
        own = (self._bus.run_id, command_id)
        for _, event in reversed(self._events):
            if event.kind in kinds and (event.command_run_id, event.command_id) == own:
                return event
        return None

    def _ended(self, command_id: int) -> axis_event_t | None:
        """Returns the event that reports the end of a capture of this client, or None if it has not
        arrived."""
        return self._event_of(command_id, axis_event_t.EVENT_CAPTURE)

    def _command(
        self, kind: int, items: Sequence[tuple[str, int]] = (), signals: Sequence[str] = ()
    ) -> axis_event_t:
        """Sends a command repeatedly until an event acknowledges the command. Returns this event.
        Raises Refused, NoAnswer."""
        self._command_id += 1
        command = axis_command_t()
        command.utime = NOT_AVAILABLE
        command.command_id, command.axis, command.kind = self._command_id, self.axis, kind
        command.objects_hash = TABLE_HASH
        command.num_items = len(items)
        command.object = [name for name, _ in items]
        command.value = [raw for _, raw in items]
        command.num_signals, command.signal = len(signals), list(signals)
        end = time.monotonic() + self.timeout_s
        with self._news:
            self._since = self._heard
        while (remaining := end - time.monotonic()) > 0:
            command.timeout_us = round(remaining * 1e6)
            self._bus.publish(f"AXIS_{self.axis}_COMMAND", command)
            with self._news:
                answer = self._await(self._answer, min(remaining, self.timeout_s / COMMAND_TRIES))
            if answer and answer.kind == axis_event_t.EVENT_REFUSED:
                raise _refusal(answer)
            if answer:
                return answer
        raise self._silence(f"an answer to command {self._command_id} within {self.timeout_s:g} s")

    def _answer(self) -> axis_event_t | None:
        answers = axis_event_t.EVENT_DONE, axis_event_t.EVENT_REFUSED
        return self._event_of(self._command_id, *answers)

    def state(self, timeout_s: float | None = None) -> axis_state_t:
        """Waits for the next state of the axis, and returns the state. Raises NoAnswer."""
        with self._news:
            before = self._state
            found = self._await(
                lambda: self._state if self._state is not before else None,
                self.timeout_s if timeout_s is None else timeout_s,
            )
        if found is None:
            raise self._silence("a state")
        return found

    def wait_event(
        self,
        kind: int | None = None,
        where: Callable[[axis_event_t], bool] = lambda event: True,
        timeout_s: float | None = None,
    ) -> axis_event_t:
        """Waits for an event of `kind` (None means any kind) for which where(event) is True, and
        returns the event.

        An event that arrived after the latest command is also returned, because the command may
        have caused it. Raises NoAnswer.
        """

        def ready() -> axis_event_t | None:
            for received, event in self._events:
                if received >= self._since and kind in (None, event.kind) and where(event):
                    return event
            return None

        with self._news:
            found = self._await(ready, self.timeout_s if timeout_s is None else timeout_s)
        if found is None:
            raise self._silence("an event of the kind awaited")
        return found

    def _take(self, channel: str, data: bytes, _wall_us: int) -> None:
        try:
            message = decode(channel, data)
        except Undecodable:
            self.undecodable += 1
            return
        with self._news:
            self._received_s = time.monotonic()
            if not self.gaps.setdefault(channel, Gaps()).take(message.run_id, message.seq):
                return
            if isinstance(message, axis_state_t):
                self._state = message
            elif isinstance(message, axis_event_t):
                self._events.append((self._heard, message))
                self._heard += 1
            elif isinstance(message, axis_capture_t) and message.command_run_id == self._bus.run_id:
                self._captures.setdefault(message.command_id, Assembly()).take(message)
                self._block_s = time.monotonic()
                # the oldest capture is deleted, because no caller waits for it any longer
                if len(self._captures) > 16:
                    del self._captures[min(self._captures)]
            self._news.notify_all()

    def _await(self, ready: Callable[[], T | None], timeout_s: float) -> T | None:
        """Returns the first result of ready() that is not None, or None after `timeout_s`. The
        caller must hold the lock `_news`."""
        end = time.monotonic() + timeout_s
        while (found := ready()) is None and (remaining := end - time.monotonic()) > 0:
            self._news.wait(min(remaining, WAKE_S))
        return found

    def _silence(self, wanted: str) -> NoAnswer:
        if self._bus.trouble:
            return NoAnswer(self._bus.trouble)
        if time.monotonic() - self._received_s < SILENCE_S:
            return NoAnswer(
                f"axis {self.axis}: expected {wanted}, but only other messages were received"
            )
        return NoAnswer(
            f"axis {self.axis}: expected {wanted}, but no message was received on "
            f"{self._bus.url}; check that the gateway is running"
        )


def _refusal(event: axis_event_t) -> Refused | NoAnswer:
    """Returns the error for a failed command. The error is NoAnswer if the axis did not answer the
    gateway, otherwise Refused."""
    if event.code == SDO_TIMEOUT:
        return NoAnswer(f"axis {event.axis} at the gateway: {event.text}")
    named, _, _ = event.text.partition(":")
    cure = state_needed(named) if event.code == NOT_NOW else ""
    return Refused(event.text + cure, event.code, event)
