"""Access to an axis on a CAN bus. This program is the CANopen master of the axis: it uses SDO and
NMT, and sends a heartbeat that the axis monitors."""

import contextlib
import errno
import io
import logging
import math
import struct
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import BinaryIO

import numpy as np

from forceaxis._core import InputError
from forceaxis.axis.drive import COMMAND_BITS, ENABLE
from forceaxis.axis.link import (
    COMMAND_SOURCES,
    NoAnswer,
    RawSamples,
    RecorderLink,
    Refused,
    reason,
)
from forceaxis.bus import OWN_NODE
from forceaxis.bus.keeper import HeartbeatKeeper
from forceaxis.errors import ParameterError
from forceaxis.objects import BY_NAME, REFUSALS

try:
    import can
    import canopen
except ImportError:
    raise ParameterError(
        "can",
        "expected the packages python-canopen and python-can; install both packages with `pip "
        "install 'forceaxis[can]'`",
    ) from None
# A command prints an error on one line, so these libraries must not print log messages.
for library in ("can", "canopen"):
    logging.getLogger(library).addHandler(logging.NullHandler())

NMT_STOPPED, NMT_OPERATIONAL, NMT_START = 4, 5, 1
START_S = 2.0  # longest time in s until a node that was started answers
RIVAL_LISTEN_S = 0.5
REQUEST_ID, ANSWER_ID, HEARTBEAT_ID = 0x600, 0x580, 0x700
TEXT_INDICES = range(0x1008, 0x100B)
# Command specifiers in the answers of an SDO server (CiA 301, 7.2.4.3).
UPLOAD_ANSWER, DOWNLOAD_ANSWER, ABORT_ANSWER = 2, 3, 4
# Upper halves of the SDO abort codes of a disturbed transfer.
# Abort codes that begin with 0503h mean a toggle-bit error.
# Abort codes that begin with 0504h mean a time-out, a wrong command or a wrong block.
TRANSFER_ABORTS = (0x0503, 0x0504)
# Longest time in s to close a bus without traffic. The default of python-canopen is 1 s.
NOTIFIER_S = 0.05
# Time in ms after which the axis detects that the heartbeat of this program is missing.
# This program sends ten heartbeats within HEARTBEAT_MS.
HEARTBEAT_MS = 1000
HEARTBEAT_ENTRIES = tuple(f"consumer_heartbeat_{i}" for i in range(1, 5))
STORING = ("store_all", "store_parameters")
# CANopen addresses (index, sub-index) of the objects that are domains.
RECORDER_DATA, CYCLE_CURVE_DATA, PROGRAM_DATA = (0x2120, 0), (0x243B, 6), (0x1F50, 1)
SEGMENT_BYTES = 7  # largest number of bytes in a segment of an SDO transfer
# Largest sizes in bytes of a name, and of a domain such as a recording (30 KiB) or a curve (12 KB).
# If a node sends more bytes than these limits, the program aborts the transfer.
MOST_BYTES, MOST_DOMAIN_BYTES = 256, 1 << 20
READ_TRIES = 2
ABORT_TOO_LONG = 0x06070012  # SDO abort code: the object is longer than expected
STOPPED = (
    "the node is stopped by NMT and answers nothing; start it with `axis.start()`, which "
    "enables no drive"
)
STRUCT_FORMATS = {"u8": "<B", "i8": "<b", "u16": "<H", "i16": "<h", "u32": "<I", "i32": "<i"}
# {SDO abort code: error code of the firmware}
REASON_OF_ABORT = {abort: r.error for r in REFUSALS.values() for abort in r.aborts}


@contextlib.contextmanager
def network(interface: str, bus: can.BusABC | None = None) -> Iterator[canopen.Network]:
    """Context manager that yields the CANopen network of a CAN interface. `bus`: an open bus of
    python-can that is used instead of the CAN interface. Raises InputError."""
    made = canopen.Network()
    made.bus = bus
    made.NOTIFIER_CYCLE = NOTIFIER_S
    try:
        if bus is None:
            made.connect(interface="socketcan", channel=interface)
        else:
            made.connect()
    except (OSError, can.CanError) as error:
        why = str(error)
        if isinstance(error, OSError) and error.errno == errno.EAFNOSUPPORT:
            why = (
                "this kernel has no CAN; `modprobe can_raw vcan`, or `tools/vcan` for a virtual bus"
            )
        raise ParameterError(
            "can",
            f"{interface}: expected a CAN interface that is up (`ip link show {interface}`), {why}",
        ) from None
    try:
        yield made
    finally:
        made.disconnect()


class CanLink(RecorderLink):
    """A node on a CAN interface such as "can0". If a gateway polls the same node, it uses the same
    SDO channel. The reading of a recording is then interrupted and raises NoAnswer.

    From the first controlword that enables it, the axis monitors the heartbeat of this program. For
    this purpose, the program writes an entry of the object 1016h. The axis becomes disabled
    HEARTBEAT_MS after the last heartbeat. The earlier entry is restored at release and before
    parameters are stored. own_node: node id of the heartbeat, which no other node may have. bus: an
    open bus of python-can instead of the CAN interface. Raises InputError.
    """

    source = COMMAND_SOURCES.index("canopen")

    def __init__(
        self,
        interface: str = "can0",
        node: int = 1,
        own_node: int = OWN_NODE,
        bus: can.BusABC | None = None,
        timeout_s: float = 1.0,
    ) -> None:
        if node == own_node or not (1 <= node <= 127 and 1 <= own_node <= 127):
            raise InputError(
                f"node {node} of the axis, node {own_node} of this program: expected two "
                f"different node ids from 1 to 127, as in {interface}:{node}@125"
            )
        self.where = f"node {node} on {interface}"
        self._id, self._own, self._timeout_s = node, own_node, timeout_s
        self._open = contextlib.ExitStack()
        self._network = self._open.enter_context(network(interface, bus))
        self._sdo = canopen.sdo.SdoClient(
            REQUEST_ID + node, ANSWER_ID + node, canopen.ObjectDictionary()
        )
        self._sdo.network, self._sdo.RESPONSE_TIMEOUT = self._network, timeout_s
        self._network.subscribe(ANSWER_ID + node, self._answered)
        self._errors = canopen.SdoCommunicationError, canopen.SdoAbortedError
        self._lock, self._owns = threading.RLock(), False
        # Name of the sub-object of 1016h that this program has written, and its earlier raw value.
        # Name and value are None while the axis does not monitor the heartbeat of this program.
        self._watched: tuple[str, int] | None = None
        # Command specifier, index and sub-index of the expected SDO answer.
        # None means that any SDO answer is accepted.
        self._expected: tuple[int, int, int] | None = None
        self._interface = interface if bus is None else None
        # This event is set if another node sends heartbeats with the node id of this program.
        self._rival = threading.Event()
        # Time in s since 1970 until which this program itself has sent heartbeats.
        # If a heartbeat with the node id of this program comes later, another node has sent it.
        self._beaten_until = 0.0
        self._network.subscribe(HEARTBEAT_ID + own_node, self._heard)
        # NMT state in the latest heartbeat of the node. None before the first heartbeat.
        self._nmt_state: int | None = None
        self._network.subscribe(HEARTBEAT_ID + node, self._heard_node)
        # This event is set if another client sends a request over the SDO channel of this program.
        self._asked_by_another = threading.Event()
        self._network.subscribe(REQUEST_ID + node, self._heard_request)

    def _answered(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Passes an SDO answer to the library `canopen`, unless the answer belongs to another
        client. A gateway that polls the axis is such a client, because it uses the same SDO
        channel."""
        if self._expected is not None:
            command, *about = struct.unpack_from("<BHB", data) if len(data) == 8 else (0,)
            kind, *expected = self._expected
            if about != expected or command >> 5 not in (kind, ABORT_ANSWER):
                return
        self._sdo.on_response(can_id, data, timestamp)

    @contextlib.contextmanager
    def _asking(self, what: str, about: tuple[int, int, int] | None = None) -> Iterator[None]:
        """Context manager for an SDO access. Errors of the library `canopen` become Refused or
        NoAnswer with the text `what`. `about`: command specifier, index and sub-index of the
        expected answer, or None for a transfer of several messages."""
        silent, aborted = self._errors
        with self._lock:
            self._expected = about
            try:
                yield
            except aborted as error:
                if error.code >> 16 in TRANSFER_ABORTS:
                    raise NoAnswer(
                        f"{self.where}: {what} was interrupted, {error}; if another client or a "
                        "gateway uses this node, connect through the gateway"
                    ) from None
                text = reason(what, REASON_OF_ABORT.get(error.code, 0)) or f"{error}"
                raise Refused(f"{what}: {text}", error.code) from None
            except (silent, OSError, can.CanError) as error:
                if self._nmt_state == NMT_STOPPED:
                    raise NoAnswer(f"{self.where}: {STOPPED}") from None
                raise NoAnswer(
                    f"{self.where}: expected an answer about {what} within {self._timeout_s:g} s, "
                    f"{error}; check that the axis is switched on, has this node id and is not "
                    "stopped by NMT"
                ) from None

    def read(self, names: Iterable[str]) -> dict[str, int]:
        found: dict[str, int] = {}
        for name in names:
            known = BY_NAME[name]
            data = self._upload(name, known.index, known.sub)
            try:
                (found[name],) = struct.unpack(STRUCT_FORMATS[known.type], data)
            except struct.error:
                raise NoAnswer(
                    f"{self.where}: expected {name} as {known.type}, got {len(data)} bytes, "
                    "because the axis has another object table"
                ) from None
        return found

    def text(self, index: int) -> str:
        """Returns the text that the node has at a CANopen index, such as its device name at index
        1008h. `index` is one of TEXT_INDICES."""
        return self._upload(f"{index:04X}h", index, 0).decode(errors="replace")

    def _upload(self, name: str, index: int, sub: int) -> bytes:
        """Returns the bytes of an object. The SDO request is sent again if a frame may have been
        lost."""
        for remaining in range(READ_TRIES, 0, -1):
            try:
                with (
                    self._asking(
                        name, None if index in TEXT_INDICES else (UPLOAD_ANSWER, index, sub)
                    ),
                    self._sdo.open(index, sub, "rb", buffering=0) as stream,
                ):
                    return self._whole(stream, name, MOST_BYTES)
            except NoAnswer:
                if remaining == 1:
                    raise
        raise AssertionError("READS is at least 1")

    def _whole(self, stream: BinaryIO, name: str, most: int) -> bytes:
        """Reads an SDO stream to its end and returns its bytes. If the stream has more than `most`
        bytes, aborts the SDO transfer and raises NoAnswer."""
        data = bytearray()
        while piece := stream.read(7):
            data += piece
            if len(data) > most:
                self._sdo.abort(ABORT_TOO_LONG)
                raise NoAnswer(f"{self.where}: expected {name} of at most {most} bytes, got more")
        return bytes(data)

    def write(self, values: Mapping[str, int]) -> None:
        for name, raw in values.items():
            enables = name == "controlword" and raw & COMMAND_BITS == ENABLE
            if enables and self._owns and self._watched is None:
                self._be_watched()
            if name in STORING:
                # A stored parameter set must not contain the heartbeat entry of this program.
                self._be_unwatched()
            self._download(name, raw)

    def _download(self, name: str, raw: int) -> None:
        known = BY_NAME[name]
        with self._asking(name, (DOWNLOAD_ANSWER, known.index, known.sub)):
            self._sdo.download(known.index, known.sub, struct.pack(STRUCT_FORMATS[known.type], raw))

    def acquire(self) -> None:
        if self.read_one("command_source") != self.source:
            self._download("command_source", self.source)
        # A node that has missed a heartbeat is no longer operational.
        # An NMT command of this program makes such a node operational again.
        with self._asking("NMT start"):
            self._network.send_message(0, bytes([NMT_START, self._id]))
        place, raw = self._entry()
        # This entry in 1016h remains from an earlier program with the same node id that was killed.
        if place is not None and raw == self._ours:
            self._expect_alone()
            self._download(place, 0)
        self._owns = True

    def release(self) -> None:
        self._be_unwatched()
        self._owns = False

    @property
    def _ours(self) -> int:
        return self._own << 16 | HEARTBEAT_MS

    def _entry(self) -> tuple[str | None, int]:
        """Returns the name and the raw value of the entry of object 1016h for the node id of this
        program. Without such an entry, returns a free entry. If no entry is free, returns (None,
        0)."""
        entries = self.read(HEARTBEAT_ENTRIES).items()
        own = [entry for entry in entries if entry[1] >> 16 == self._own]
        free = [entry for entry in entries if not entry[1] & 0xFFFF]
        return next(iter([*own, *free]), (None, 0))

    def _expect_alone(self) -> None:
        """Raises Refused if another node sends heartbeats with the node id of this program."""
        if self._rival.wait(RIVAL_LISTEN_S):
            raise Refused(
                f"{self.where}: expected no other node with the node id {self._own}, but such a "
                f"node sends heartbeats; choose another id, as in {self._interface}:{self._id}@125"
            )

    def _heard(self, _can_id: int, _data: bytearray, timestamp: float) -> None:
        if timestamp > self._beaten_until:
            self._rival.set()

    def _heard_node(self, _can_id: int, data: bytearray, _timestamp: float) -> None:
        self._nmt_state = data[0] & 0x7F if data else None

    def _heard_request(self, _can_id: int, _data: bytearray, _timestamp: float) -> None:
        self._asked_by_another.set()

    def disturbance(self) -> str | None:
        if not self._asked_by_another.wait(RIVAL_LISTEN_S):
            return None
        return (
            f"{self.where}: another client, such as a gateway, sends requests over the SDO channel "
            "of this one and would interrupt the reading of a recording or a curve; use "
            f"lcm:{self._id} behind that gateway, or end it"
        )

    def start(self) -> None:
        for _ in self.polls(START_S):
            with self._asking("NMT start"):
                self._network.send_message(0, bytes([NMT_START, self._id]))
            with contextlib.suppress(NoAnswer):
                if self.read_one("nmt_state") == NMT_OPERATIONAL:
                    return
        raise NoAnswer(
            f"{self.where}: expected the NMT state operational within {START_S:g} s, got another; "
            "check that no other master stops the node"
        )

    def _send_beat(self, data: bytes) -> None:
        # A thread calls this function. An SDO transfer may last longer than the heartbeat time.
        try:
            self._network.send_message(HEARTBEAT_ID + self._own, data)
        except can.CanError as error:
            raise NoAnswer(f"{self.where}: expected to send a heartbeat, got: {error}") from None

    def _be_watched(self) -> None:
        place, before = self._entry()
        if place is None:
            raise Refused(
                f"{self.where}: expected a free heartbeat consumer in 1016h, but all consumers "
                "are set"
            )
        if before & 0xFFFF or self._rival.is_set():
            self._expect_alone()
        self._watched = place, before
        self._download(place, self._ours)
        self._beaten_until = math.inf
        # The program writes 1016h before it sends its first heartbeat.
        # The axis monitors heartbeats as soon as it has received the first one.
        self._keeper = HeartbeatKeeper(
            self._interface, HEARTBEAT_ID + self._own, bytes([NMT_OPERATIONAL]),
            HEARTBEAT_MS / 10_000, self._send_beat,
        )  # fmt: skip

    def _be_unwatched(self) -> None:
        if self._watched:
            (place, before), self._watched = self._watched, None
            self._download(place, before)
        self._end_keeper()

    def _samples(self, signals: Sequence[str]) -> RawSamples:
        data = self._domain("the recording", *RECORDER_DATA)
        row = np.dtype([(f"{i}", STRUCT_FORMATS[BY_NAME[n].type]) for i, n in enumerate(signals)])
        rows = np.frombuffer(data[: len(data) // row.itemsize * row.itemsize], row)
        return np.stack([rows[f"{i}"].astype(np.int64) for i in range(len(signals))], axis=1)

    def cycle_curve(self) -> bytes:
        return self._domain("the curve", *CYCLE_CURVE_DATA)

    def _domain(self, what: str, index: int, sub: int) -> bytes:
        """Returns the bytes of an object that is a domain. The bytes are transferred in blocks (SDO
        block upload)."""
        with (
            self._asking(what),
            self._sdo.open(index, sub, "rb", buffering=0, block_transfer=True) as stream,
        ):
            return self._whole(stream, what, MOST_DOMAIN_BYTES)

    def download_update(self, data: bytes, written: Callable[[int], None]) -> None:
        with self._asking("the update"):
            stream = self._sdo.open(
                *PROGRAM_DATA, "wb", buffering=0, size=len(data), block_transfer=True
            )
            try:
                for at in range(0, len(data), SEGMENT_BYTES):
                    stream.write(data[at : at + SEGMENT_BYTES])
                    if at % (100 * SEGMENT_BYTES) == 0:
                        written(at)
                stream.close()
            finally:
                # This call closes the stream without sending the end of the aborted transfer.
                io.RawIOBase.close(stream)

    def close(self) -> None:
        self._end_keeper()
        self._open.close()

    def _end_keeper(self) -> None:
        if self._keeper:
            super()._end_keeper()
            self._beaten_until = time.time()
