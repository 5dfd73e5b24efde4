"""Logs of a CAN bus: text of candump, files of Vector (asc, blf) and of PEAK (trc)."""

import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TextIO, cast

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.errors import expect_package
from forceaxis.recordings.clock import NO_TIME_NS, NS_PER_S, ClockError, ClockReader
from forceaxis.words import counted

if TYPE_CHECKING:
    from can import Message

HEAD_BYTES, HEAD_LINES = 1 << 14, 40  # size of the part of a file from which its kind is found
# Lines of `candump -l`, and of candump on a screen
LOG_LINE = re.compile(
    r"\((?P<time>\d+\.\d+)\) +(?P<bus>\S+) +(?P<id>[0-9A-Fa-f]{8}|[0-9A-Fa-f]{3})"
    r"#(?P<data>R\d?|(#[0-9A-Fa-f])?([0-9A-Fa-f]{2}\.?)*)(_[0-9A-Fa-f])?( [RT])?$"
)
SCREEN_LINE = re.compile(
    r" *(\((?P<time>[^()]+)\) +)?(?P<bus>\S+) +([RT]X +[-B] +[-E] +)?"
    r"(?P<id>[0-9A-F]{8}|[0-9A-F]{3}) +\[(?P<length>\d+)\] *"
    r"(?P<data>remote request|([0-9A-F]{2} ?)*)( *(ERRORFRAME|'.*))?$"
)
ASC_START = re.compile(r"(date\s+\w+\.?\s+\w+\.?\s+\d|base\s+(hex|dec)\b)", re.IGNORECASE)
TRC_START = re.compile(r";\s*(\$FILEVERSION=|Start time:)")
# A frame in a line of asc, and one that was only requested
ASC_FRAME = re.compile(r"\s*\d+\.\d+\s+(\d+\s+[0-9A-Fa-f]+x?|CANFD\s+\d+)\s.*?\b(Rx|Tx|TxRq)\b")
IS_ERROR = 0x20000000  # bit of the identifier that candump shows for an error frame
LATEST_NS = 1 << 62
EXTENDED_DIGITS = 8
FALLS_SHARE = 0.1  # share of falling times above which the times are regarded as differences


class FrameKey(NamedTuple):
    """What tells the frames of a message from all others."""

    bus: str
    number: int  # identifier, 11 or 29 bits
    is_extended: bool

    @property
    def text(self) -> str:
        """The identifier as text, such as 0x181."""
        return f"0x{self.number:0{8 if self.is_extended else 3}X}"


@dataclass
class Frames:
    """Frames with the same identifier on one bus, in their order."""

    times_ns: "array[int]" = field(default_factory=lambda: array("q"))
    data: list[bytes] = field(default_factory=list)


@dataclass
class CanLog:
    """The data frames of a log. `has_times`: False if the log states no times."""

    path: Path
    kind: str
    frames: dict[FrameKey, Frames] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    has_times: bool = True

    @property
    def where(self) -> str:
        """Name of the file in messages."""
        return paths.display(self.path)

    def add(self, key: FrameKey, time_ns: int, data: bytes) -> None:
        """Adds a data frame."""
        frames = self.frames.setdefault(key, Frames())
        frames.times_ns.append(time_ns)
        frames.data.append(data)


def reader_of(start: bytes) -> Callable[[Path], CanLog] | None:
    """Returns the function that reads a log of CAN frames, or None for a file of another kind.
    `start`: the first bytes of the file."""
    if start.startswith(b"LOGG"):
        return _read_blf
    text = start.decode("utf-8", "replace")
    lines = [line for line in text.split("\n")[:HEAD_LINES] if line.strip()]
    if any(ASC_START.match(line.strip()) for line in lines[:5]):
        return _read_asc
    if any(TRC_START.match(line) for line in lines):
        return _read_trc
    first = next((line.rstrip() for line in lines), "")
    if LOG_LINE.match(first) or SCREEN_LINE.match(first):
        return _read_candump
    return None


def _lines(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", errors="replace") as file:
        yield from file


def _note_end(log: CanLog) -> None:
    """Notes that the last line of a text log has no end."""
    with log.path.open("rb") as file:
        file.seek(-1, 2)
        if file.read() != b"\n":
            log.notes.append("the last line has no line end; the file may be cut off")


def _read_candump(path: Path) -> CanLog:
    """Reads the text of candump. Raises InputError."""
    log = CanLog(path, "log of candump")
    left = Counter[str]()
    skipped: list[tuple[int, str]] = []
    clock = ClockReader(())
    previous, falls, count, timed = NO_TIME_NS, 0, 0, 0
    for number, line in enumerate(_lines(path), 1):
        found = LOG_LINE.match(line.rstrip()) or SCREEN_LINE.match(line.rstrip())
        data = _data(found) if found is not None else None
        if found is None or data is None:
            if line.strip():
                skipped.append((number, line.strip()))
            continue
        time_ns = _time_ns(found["time"], clock, f"{log.where}: line {number}")
        count, timed = count + 1, timed + (time_ns != NO_TIME_NS)
        falls, previous = falls + (time_ns < previous), time_ns
        key = FrameKey(found["bus"], int(found["id"], 16), len(found["id"]) == EXTENDED_DIGITS)
        if key.is_extended and key.number & IS_ERROR:
            left["error frame"] += 1
        elif found["data"][:1] in ("R", "r"):
            left["remote frame"] += 1
        else:
            log.add(key, time_ns, data)
    _note_end(log)
    log.has_times = timed > 0
    if 0 < timed < count or falls > FALLS_SHARE * count:
        raise InputError(
            f"{log.where}: expected a time since the begin for each frame, got differences or "
            "none; record with `candump -t a` or `candump -l`"
        )
    _note_left(log, left)
    if skipped:
        log.notes.append(
            f"{counted(len(skipped), 'line')} skipped, which "
            f"{'are no frames' if len(skipped) > 1 else 'is no frame'}, line {skipped[0][0]} "
            f"first: {skipped[0][1][:40]}"
        )
    return log


def _data(found: re.Match[str]) -> bytes | None:
    """Returns the data of a line of candump, or None if it has another number of bytes than it
    states."""
    text = found["data"]
    if text[:1] in ("R", "r"):
        return b""
    data = bytes.fromhex((text[2:] if text.startswith("#") else text).replace(".", ""))
    length = found.groupdict().get("length")
    return data if length is None or int(length) == len(data) else None


def _time_ns(text: str | None, clock: ClockReader, where: str) -> int:
    if text is None:
        return NO_TIME_NS
    try:
        time_ns = clock.time_ns(0, text) if ":" in text else int(Decimal(text) * NS_PER_S)
        if abs(time_ns) >= LATEST_NS:
            raise ArithmeticError
        return time_ns
    except (ClockError, ArithmeticError):
        raise InputError(f"{where}: expected a time of candump, got {text[:40]!r}") from None


def _note_left(log: CanLog, left: "Counter[str]") -> None:
    if left:
        several = ", ".join(counted(count, kind) for kind, count in left.items())
        log.notes.append(f"{several} left out")


class _Lines:
    """The lines of a text log, as the readers of python-can take them."""

    def __init__(self, path: Path, change: Callable[[str], Sequence[str]]) -> None:
        self._lines = (new for line in _lines(path) for new in change(line))

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        return next(self._lines)

    def read(self) -> str:
        """For python-can, a file has this method."""
        return "".join(self)

    def close(self) -> None:
        """Nothing is open."""


def _read_asc(path: Path) -> CanLog:
    """Reads a log of Vector in text. Raises InputError."""
    from can.io.asc import ASCReader

    log = CanLog(path, "log of Vector (asc)")
    wanted, requests = 0, 0

    def change(line: str) -> Sequence[str]:
        nonlocal wanted, requests
        header = ASC_START.match(line.strip())
        if header and "relative" in line.lower():
            raise InputError(
                f"{log.where}: expected absolute times, got differences ({line.strip()[:60]}); "
                "export the log with absolute times"
            )
        if header and header[2]:  # without this line, the reader loses the first frame
            return [line, "no internal events logged\n"]
        if found := ASC_FRAME.match(line):
            requests += found[2] == "TxRq"
            wanted += found[2] != "TxRq"
            return [] if found[2] == "TxRq" else [line]
        return [line]

    _note_end(log)
    taken = _take(log, ASCReader(cast(TextIO, _Lines(path, change))), 1)
    if requests:
        log.notes.append(f"{counted(requests, 'request')} to send (TxRq) left out")
    if taken < wanted:
        log.notes.append(f"{counted(wanted - taken, 'line')} of frames could not be read")
    return log


def _read_trc(path: Path) -> CanLog:
    """Reads a log of PEAK. Raises InputError."""
    from can.io.trc import TRCReader

    log = CanLog(path, "log of PEAK (trc)")

    def change(line: str) -> Sequence[str]:
        # Times after the start keep more digits than times since 1970.
        return [] if line.startswith(";$STARTTIME") else [line]

    _note_end(log)
    _take(log, TRCReader(cast(TextIO, _Lines(path, change))), 0)
    return log


def _read_blf(path: Path) -> CanLog:
    """Reads a binary log of Vector. Raises InputError."""
    from can.io.blf import BLFReader

    log = CanLog(path, "log of Vector (blf)")
    with files.parsing(path, log.kind, "record or export it again"):
        reader = BLFReader(path)
        reader.start_timestamp = 0.0  # times after the start keep more digits
    size = path.stat().st_size
    _take(log, reader, 1)
    if reader.file_size > size:
        log.notes.append(
            f"the file was cut off: it states {reader.file_size} bytes, and not {size}"
        )
    return log


def _take(log: CanLog, messages: "Iterable[Message]", first_bus: int) -> int:
    """Adds the frames of a reader of python-can to a log. `first_bus`: what the maker counts its
    buses from. Returns the number of frames. Raises InputError."""
    left, taken = Counter[str](), 0
    with (
        files.parsing(log.path, f"a {log.kind}", "record or export it again"),
        files.remarks("can") as remarks,
    ):
        for message in messages:
            taken += 1
            size = len(message.data)
            if message.is_error_frame:
                left["error frame"] += 1
            elif message.is_remote_frame:
                left["remote frame"] += 1
            elif not message.is_fd and size != message.dlc:
                left["frame with missing bytes"] += 1
            else:
                bus = message.channel
                number = bus + first_bus if isinstance(bus, int) else bus
                key = FrameKey(f"CAN{number}", message.arbitration_id, message.is_extended_id)
                log.add(key, round(message.timestamp * NS_PER_S), bytes(message.data))
    _note_left(log, left)
    log.notes += remarks
    return taken


def expect_readers(path: Path) -> None:
    """Raises InputError if the packages that read and name frames are missing."""
    expect_package(paths.display(path), "can", "python-can", "can")
    expect_package(paths.display(path), "cantools", "cantools", "can")
