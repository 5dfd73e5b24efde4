"""A connection to an LCM bus. host/lcm/axis.lcm defines the message types. The module also counts
lost messages."""

import abc
import ctypes
import os
import re
import secrets
import socket
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self, TypeVar

from forceaxis import objects, paths
from forceaxis._core import InputError
from forceaxis.bus import messages
from forceaxis.bus.messages import (
    axis_capture_t,
    axis_command_t,
    axis_event_t,
    axis_state_t,
    sim_clock_t,
    sim_truth_t,
)
from forceaxis.bus.wire import Message, expect_whole
from forceaxis.errors import ParameterError
from forceaxis.words import printable

try:
    import lcm
except ImportError:
    # The package lcm needs the library GLib of the system. A wheel of forceaxis contains GLib.
    glib = paths.LIBRARIES / "libglib-2.0.so.0"
    if not glib.is_file():
        raise
    ctypes.CDLL(str(glib))
    import lcm

NOT_AVAILABLE = axis_state_t.NOT_AVAILABLE
TABLE_HASH = int(objects.OBJECTS_HASH[:8], 16)
DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"
AXES = range(1, 128)
CHANNELS = "(AXIS_[0-9]+_(STATE|EVENT|CAPTURE|COMMAND)|SIM_(CLOCK|TRUTH))"

# Number of messages that liblcm stores while the receiving thread is busy.
# The default of liblcm is 30 messages, and a burst of messages can be larger.
QUEUE_MESSAGES = 20_000

M = TypeVar("M", bound=Message)

_TYPES: dict[str | None, type[Message]] = {
    "STATE": axis_state_t,
    "COMMAND": axis_command_t,
    "EVENT": axis_event_t,
    "CAPTURE": axis_capture_t,
    "CLOCK": sim_clock_t,
    "TRUTH": sim_truth_t,
}
# {fingerprint: message type}.
# The message types of the lock-step are included, because logs may contain such messages.
_BY_FINGERPRINT: dict[bytes, type[Message]] = {
    t._get_packed_fingerprint(): t
    for t in vars(messages).values()
    if hasattr(t, "_get_packed_fingerprint")
}
_CHANNEL = re.compile(r"AXIS_([1-9][0-9]{0,2})_(STATE|COMMAND|EVENT|CAPTURE)|SIM_()(CLOCK|TRUTH)")


class Undecodable(Exception):
    """Error: the bytes of a message do not have the message type of its channel."""


def channel_of(name: str) -> tuple[int | None, str | None]:
    """Reads the name of a channel. Returns the number of the axis, or None for a channel without an
    axis, and the kind of the messages. Returns (None, None) for a channel of another program."""
    match = _CHANNEL.fullmatch(name)
    if not match or int(match[1] or 1) not in AXES:
        return None, None
    return (int(match[1]), match[2]) if match[1] else (None, match[4])


def type_of(channel: str, data: bytes = b"") -> type[Message] | None:
    """Returns the message type of a channel. The name of the channel selects the type. If the name
    is unknown, the fingerprint at the beginning of the data selects it. Returns None for a message
    type of another program."""
    return _TYPES.get(channel_of(channel)[1]) or _BY_FINGERPRINT.get(bytes(data[:8]))


def decode(channel: str, data: bytes) -> Message:
    """Decodes a message. Raises Undecodable if the data have an unknown or a wrong type.

    Control characters in texts of the message are replaced, because a terminal would execute them.
    Any program on the bus could send such characters.
    """
    carried = type_of(channel, data)
    if carried is None:
        raise Undecodable(f"{channel}: expected a channel of forceaxis")
    try:
        expect_whole(carried, data)
        message = carried.decode(data)
        for name, kind in zip(carried.__slots__, carried.__typenames__, strict=True):
            if kind == "string":
                value = getattr(message, name)
                several = isinstance(value, list)
                setattr(message, name, list(map(printable, value)) if several else printable(value))
        return message
    except Exception as error:  # The generated code can raise any exception for wrong data.
        raise Undecodable(f"{channel}: expected {carried.__name__}, got another type") from error


def blank(message_type: type[M]) -> M:
    """Returns a new message. The field `wall_utime` is the present time, and all other integers
    have the value NOT_AVAILABLE."""
    message = message_type()
    for name, kind in zip(message_type.__slots__, message_type.__typenames__, strict=True):
        if kind == "int64_t" and not isinstance(getattr(message, name), list):
            setattr(message, name, NOT_AVAILABLE)
    message.wall_utime = now_us()
    return message


def now_us() -> int:
    return time.time_ns() // 1000


def new_run_id() -> int:
    return secrets.randbelow(2**63 - 1) + 1


def default_url() -> str:
    return os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL


def connect(url: str | None = None) -> lcm.LCM:
    """Connects to an LCM bus. If this fails, raises InputError, whose text states the remedy in one
    line."""
    url = url or default_url()
    _expect_route(url)
    if "\0" in url:
        raise ParameterError("url", f"expected an LCM URL such as {DEFAULT_URL}")
    # liblcm prints up to a dozen text lines about an error to file descriptor 2.
    with tempfile.TemporaryFile() as errors:
        saved = os.dup(2)
        try:
            os.dup2(errors.fileno(), 2)
            made = lcm.LCM(url)
        except (RuntimeError, ValueError) as error:
            errors.seek(0)
            text = " ".join(errors.read(300).decode(errors="replace").split()) or str(error)
            raise InputError(
                f"{url}: expected an LCM URL such as {DEFAULT_URL}, got: {text}"
            ) from None
        finally:
            os.dup2(saved, 2)
            os.close(saved)
    return made


def _expect_route(url: str) -> None:
    """Raises InputError for a multicast URL if the machine has no route to the multicast group."""
    match = re.match(r"udpm://([0-9.]+)(?::([0-9]+))?", url)
    if not match or not 0 < int(match[2] or 7667) < 65536:
        return  # liblcm itself reports an error in the URL
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((match[1], int(match[2] or 7667)))
        except OSError as error:
            raise InputError(
                f"{url}: expected a multicast route on this machine, got: {error.strerror}; add a "
                "multicast route with `ip link set lo up; ip route add 224.0.0.0/4 dev lo` (as "
                "root)"
            ) from None


@dataclass
class _Run:
    """Received messages of one publisher: the sequence number that is expected next, and the
    sequence numbers that are missing."""

    next_seq: int
    missing: set[int] = field(default_factory=set)


class Gaps:
    """Counts lost, duplicated and late messages of one channel, by their run_id and sequence
    number."""

    # Largest number of missing sequence numbers that are stored.
    # A stored sequence number is needed to recognise a late message.
    MISSING_KEPT = 4096

    def __init__(self) -> None:
        self.received = self.lost = self.doubled = self.late = self.restarts = 0
        self.rivals = False  # True if two programs publish messages on this channel
        self._runs: dict[int, _Run] = {}
        self._latest: int | None = None

    def take(self, run_id: int, seq: int) -> bool:
        """Counts one message. Returns False if the message is a duplicate."""
        run = self._runs.get(run_id)
        if run is None:
            self.restarts += bool(self._runs)
            if len(self._runs) >= 64:
                self._runs.pop(next(iter(self._runs)))
            self._runs[run_id], self._latest = _Run(seq + 1), run_id
            self.received += 1
            return True
        if run_id != self._latest:
            # An earlier publisher of the same channel is still sending.
            self.rivals, self._latest = True, run_id
        missing = run.missing
        if seq >= run.next_seq:
            self.lost += seq - run.next_seq
            missing.update(range(max(run.next_seq, seq - self.MISSING_KEPT), seq))
            if len(missing) > self.MISSING_KEPT:
                missing.intersection_update(sorted(missing)[-self.MISSING_KEPT :])
            run.next_seq = seq + 1
        elif seq in missing:
            missing.remove(seq)
            self.lost -= 1
            self.late += 1
        else:
            self.doubled += 1
            return False
        self.received += 1
        return True


class Closable(abc.ABC):
    """A connection to an LCM bus that a `with` block closes."""

    @abc.abstractmethod
    def close(self) -> None:
        """Closes the connection to the LCM bus."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Bus(Closable):
    """A connection to an LCM bus. Its own thread calls handle(channel, data, wall_us) for each
    received message. `data` are the bytes of the message. `wall_us` is the time of reception in us
    since 1970."""

    def __init__(
        self, url: str | None, handle: Callable[[str, bytes, int], None], channels: str = CHANNELS
    ) -> None:
        self.url = url or default_url()
        self.trouble: str | None = None  # text of the error that has ended the thread, or None
        self._handle, self._run = handle, True
        self._lcm: lcm.LCM | None = connect(self.url)  # connection of liblcm; None after close()
        self._seq: dict[str, int] = {}
        self._run_id, self._lock = new_run_id(), threading.Lock()
        subscription = self._lcm.subscribe(channels, self._take)
        subscription.set_queue_capacity(QUEUE_MESSAGES)
        arguments = self._lcm, subscription
        self._thread = threading.Thread(target=self._loop, args=arguments, daemon=True, name="lcm")
        self._thread.start()

    @property
    def run_id(self) -> int:
        return self._run_id

    def publish(self, channel: str, message: Message) -> None:
        """Publishes a message on a channel. The message gets the run_id of this connection, the
        next sequence number of the channel and the present time."""
        with self._lock:
            message.run_id = self._run_id
            message.seq = self._seq.get(channel, 0)
            message.wall_utime = now_us()
            self._seq[channel] = message.seq + 1
            if self._lcm is None:
                raise RuntimeError(f"{self.url}: expected an open connection")
            self._lcm.publish(channel, message.encode())

    def close(self) -> None:
        self._run = False
        self._thread.join(2)
        with self._lock:
            self._lcm = None

    def _take(self, channel: str, data: bytes) -> None:
        self._handle(channel, data, now_us())

    def _loop(self, receiver: lcm.LCM, subscription: lcm.LCMSubscription) -> None:
        try:
            while self._run:
                receiver.handle_timeout(100)
        except Exception as error:  # the user of this connection reports the error
            self.trouble = f"{self.url}: {error}"
        finally:
            # The subscription keeps the LCM object alive, and the sockets of this object open.
            # The library lcm fails if the process has more than 1024 sockets.
            receiver.unsubscribe(subscription)
