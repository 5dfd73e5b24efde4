"""LCM as forceaxis speaks it (host/lcm/axis.lcm): receive and count gaps, command and be answered.

    from forceaxis.live import AxisClient

    with AxisClient(1) as axis:
        axis.write("force_gain", 7.0)          # engineering units, enum texts as text
        axis.read("force_gain")                # 7.0
        held = axis.capture(["force", "dac_code"], samples=1500)
        axis.wait_event(kind=axis_event_t.EVENT_FAULT, timeout_s=60)

A write that the firmware refuses raises Refused with its reason; no answer raises NoAnswer.
"""

import contextlib
import os
import re
import secrets
import socket
import tempfile
import threading
import time

import lcm

from forceaxis import objects
from forceaxis._core import InputError
from forceaxis.captures import Assembly
from forceaxis.drive_words import BY_NAME
from forceaxis.messages import (
    axis_capture_t,
    axis_command_t,
    axis_event_t,
    axis_state_t,
    sim_clock_t,
    sim_truth_t,
)

NOT_AVAILABLE = axis_state_t.NOT_AVAILABLE
TABLE_HASH = int(objects.OBJECTS_HASH[:8], 16)
DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"
AXES = range(1, 32)
CHANNELS = "(AXIS_[0-9]+_(STATE|EVENT|CAPTURE|COMMAND)|SIM_(CLOCK|TRUTH))"

# Messages that liblcm keeps while the thread is busy; its own 30 are lost in the first burst.
QUEUE = 20_000

_TYPES = {
    "STATE": axis_state_t,
    "COMMAND": axis_command_t,
    "EVENT": axis_event_t,
    "CAPTURE": axis_capture_t,
    "CLOCK": sim_clock_t,
    "TRUTH": sim_truth_t,
}
_CHANNEL = re.compile(r"AXIS_([1-9][0-9]?)_(STATE|COMMAND|EVENT|CAPTURE)|SIM_()(CLOCK|TRUTH)")


class Refused(Exception):
    """A command that the gateway or the firmware refused: the text says why."""

    def __init__(self, event):
        super().__init__(event.text)
        self.event = event
        self.code = event.code


class NoAnswer(TimeoutError):
    """Nobody answered a command in time, or an awaited event did not come."""


class Undecodable(Exception):
    """Data that is not the type that the channel carries."""


def channel_of(name):
    """(axis or None, kind) of a channel's name; (None, None) where it is not one of ours."""
    match = _CHANNEL.fullmatch(name)
    if not match:
        return None, None
    return (int(match[1]), match[2]) if match[1] else (None, match[4])


def type_of(channel):
    """The message type that a channel carries, or None."""
    return _TYPES.get(channel_of(channel)[1])


def decode(channel, data):
    """The message, or Undecodable."""
    carried = type_of(channel)
    try:
        return carried.decode(data)
    except Exception as error:  # generated code fails in any way on bytes that are not its type
        raise Undecodable(f"{channel}: expected {carried.__name__}, got another type") from error


def blank(message_type):
    """A message whose integers all say NOT_AVAILABLE; wall_utime is now."""
    message = message_type()
    for name, kind in zip(message_type.__slots__, message_type.__typenames__, strict=True):
        if kind == "int64_t" and not isinstance(getattr(message, name), list):
            setattr(message, name, NOT_AVAILABLE)
    message.wall_utime = now_us()
    return message


def now_us():
    return time.time_ns() // 1000


def new_run_id():
    return secrets.randbelow(2**63 - 1) + 1


def default_url():
    return os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL


def connect(url=None):
    """An LCM instance, or InputError in one line with what to do."""
    url = url or default_url()
    _expect_route(url)
    if "\0" in url:
        raise InputError("--url: expected an LCM URL such as " + DEFAULT_URL)
    # liblcm explains itself on file descriptor 2, in up to a dozen lines.
    with tempfile.TemporaryFile() as said:
        saved = os.dup(2)
        try:
            os.dup2(said.fileno(), 2)
            made = lcm.LCM(url)
        except (RuntimeError, ValueError) as error:
            said.seek(0)
            text = " ".join(said.read(300).decode(errors="replace").split()) or str(error)
            raise InputError(f"{url}: expected an LCM URL such as {DEFAULT_URL}: {text}") from None
        finally:
            os.dup2(saved, 2)
            os.close(saved)
    return made


def _expect_route(url):
    """Refuses a multicast URL where the machine has no route to its group."""
    match = re.match(r"udpm://([0-9.]+)(?::([0-9]+))?", url)
    if not match or not 0 < int(match[2] or 7667) < 65536:
        return  # liblcm says what is wrong with it
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((match[1], int(match[2] or 7667)))
        except OSError as error:
            raise InputError(
                f"{url}: expected a multicast route, {error.strerror}; give this machine one with "
                "`ip link set lo up; ip route add 224.0.0.0/4 dev lo` (as root)"
            ) from None


class Gaps:
    """Counts what is lost, doubled or late among messages with (run_id, seq)."""

    KEPT = 4096  # lost numbers remembered, to notice one that comes late

    def __init__(self):
        self.received = self.lost = self.doubled = self.late = self.restarts = 0
        self.rivals = False  # two publishers at once
        self._runs = {}  # run_id -> [next seq, set of missing numbers]
        self._latest = None

    def take(self, run_id, seq):
        """Counts one message; False if it is a doubled one."""
        run = self._runs.get(run_id)
        if run is None:
            self.restarts += bool(self._runs)
            if len(self._runs) >= 64:
                self._runs.pop(next(iter(self._runs)))
            self._runs[run_id], self._latest = [seq + 1, set()], run_id
            self.received += 1
            return True
        if run_id != self._latest:
            # One that was thought replaced still sends.
            self.rivals, self._latest = True, run_id
        expected, missing = run
        if seq >= expected:
            self.lost += seq - expected
            missing.update(range(max(expected, seq - self.KEPT), seq))
            while len(missing) > self.KEPT:
                missing.remove(min(missing))
            run[0] = seq + 1
        elif seq in missing:
            missing.remove(seq)
            self.lost -= 1
            self.late += 1
        else:
            self.doubled += 1
            return False
        self.received += 1
        return True


class Bus:
    """A connection with its own thread, which calls handle(channel, data, wall_us)."""

    def __init__(self, url, handle, channels=CHANNELS):
        self.url = url or default_url()
        self.trouble = None  # what ended the thread
        self._lcm, self._handle, self._run = connect(self.url), handle, True
        self._seq, self._run_id, self._lock = {}, new_run_id(), threading.Lock()
        subscription = self._lcm.subscribe(channels, self._take)
        subscription.set_queue_capacity(QUEUE)
        self._thread = threading.Thread(target=self._loop, daemon=True, name="lcm")
        self._thread.start()

    @property
    def run_id(self):
        return self._run_id

    def publish(self, channel, message):
        """Sends with this connection's run_id, the channel's next seq and the present time."""
        with self._lock:
            message.run_id = self._run_id
            message.seq = self._seq.get(channel, 0)
            message.wall_utime = now_us()
            self._seq[channel] = message.seq + 1
            self._lcm.publish(channel, message.encode())

    def close(self):
        self._run = False
        self._thread.join(2)

    def _take(self, channel, data):
        self._handle(channel, data, now_us())

    def _loop(self):
        while self._run:
            try:
                self._lcm.handle_timeout(100)
            except Exception as error:  # told by whoever shows this connection
                self.trouble = f"{self.url}: {error}"
                return

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


ADDRESS = re.compile(r"0x[0-9a-fA-F]{1,4}(:[0-9]{1,3})?")


def object_named(name):
    """The object of the table, or InputError; None for a CANopen address."""
    if ADDRESS.fullmatch(name):
        return None
    if name not in BY_NAME:
        raise InputError(f"{name}: expected an object of `forceaxis objects`, or 0xINDEX[:SUB]")
    return BY_NAME[name]


def to_raw(name, value):
    """Raw value of an engineering value or enum text; InputError where the table does not allow
    it. Of a CANopen address the value is raw already."""
    known = object_named(name)
    if isinstance(value, str) and known and value in known.enum:
        return known.enum.index(value)
    wanted = "a number"
    if known:
        span = f"{known.min * known.scale:g} to {known.max * known.scale:g} {known.unit}"
        wanted = f"one of {', '.join(known.enum)}" if known.enum else span.removesuffix(" 1")
    try:
        raw = int(value, 0) if known is None and isinstance(value, str) else value
        raw = round(float(raw) / known.scale) if known else int(raw)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name}: expected {wanted}, got {value}") from None
    if known and not known.min <= raw <= known.max:
        raise InputError(f"{name}: expected {wanted}, got {value}")
    if not -(2**31) <= raw < 2**32:
        raise InputError(f"{name}: expected a value of at most 32 bits, got {value}")
    return raw


def from_raw(name, raw):
    """Engineering value (int where the scale is 1), or the enum's text."""
    known = BY_NAME.get(name)
    if known is None:
        return raw
    if known.enum and 0 <= raw < len(known.enum):
        return known.enum[raw]
    return raw if known.scale == 1 else raw * known.scale


class AxisClient:
    """Commands one axis through its gateway and waits for what comes of it."""

    def __init__(self, axis, url=None, timeout_s=2.0, retry_s=0.25):
        if axis not in AXES:
            raise InputError(f"axis: expected {AXES.start} to {AXES.stop - 1}, got {axis}")
        self.axis, self.timeout_s, self.retry_s = axis, timeout_s, retry_s
        self.gaps = {}  # channel -> Gaps
        self.undecodable = 0
        self._state, self._events, self._since = None, [], 0
        self._captures, self._command_id = {}, 0
        self._news = threading.Condition()
        channels = f"AXIS_{axis}_(STATE|EVENT|CAPTURE)"
        self._bus = Bus(url, self._take, channels)

    def close(self):
        self._bus.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    # What arrives ------------------------------------------------------------------------------

    def _take(self, channel, data, _wall_us):
        try:
            message = decode(channel, data)
        except Undecodable:
            self.undecodable += 1
            return
        with self._news:
            if not self.gaps.setdefault(channel, Gaps()).take(message.run_id, message.seq):
                return
            if isinstance(message, axis_state_t):
                self._state = message
            elif isinstance(message, axis_event_t):
                self._events.append(message)
                del self._events[:-10_000]
            elif message.command_run_id == self._bus.run_id:
                held = self._captures.setdefault(message.command_id, Assembly())
                held.take(message)
            self._news.notify_all()

    def _await(self, ready, timeout_s):
        """What `ready()` gives once it is not None; None after timeout_s."""
        end = time.monotonic() + timeout_s
        while True:
            found = ready()
            left = end - time.monotonic()
            if found is not None or left <= 0:
                return found
            self._news.wait(min(left, 0.5))

    def state(self, timeout_s=None):
        """The next axis_state_t; NoAnswer where none comes."""
        with self._news:
            before = self._state
            found = self._await(
                lambda: self._state if self._state is not before else None,
                timeout_s or self.timeout_s,
            )
        if found is None:
            raise NoAnswer(f"axis {self.axis}: expected a state on {self._bus.url}, heard nothing")
        return found

    def wait_event(self, kind=None, where=None, timeout_s=None):
        """The first event of that kind for which where(event) holds, among those since the latest
        command was sent (so that what it causes is not missed); NoAnswer where none comes."""

        def ready():
            return next(
                (
                    e
                    for e in self._events
                    if e.seq_here >= self._since
                    and (kind is None or e.kind == kind)
                    and (where is None or where(e))
                ),
                None,
            )

        with self._news:
            found = self._await(ready, timeout_s or self.timeout_s)
        if found is None:
            raise NoAnswer(f"axis {self.axis}: expected an event, none came")
        return found
