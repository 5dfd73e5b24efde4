"""Writes, reads and summarises log files of LCM messages, in the format of lcm-logger or as MCAP.

The reader of liblcm stops at the first damaged byte without a message. This reader continues at the
next entry and reports the number of skipped bytes.
"""

import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol

import numpy as np

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.bus.lcm import Gaps, Undecodable, channel_of, decode, type_of
from forceaxis.errors import ParameterError, expect_package

SYNC_MARK = 0xEDA1DA01
SYNC_BYTES = struct.pack(">I", SYNC_MARK)
# Header of a log entry: sync mark, number of the entry, time in us since 1970,
# size in bytes of the channel's name, size in bytes of the data
HEADER = struct.Struct(">IqqII")
LONGEST_CHANNEL, LONGEST_DATA = 255, 1 << 28
LOG, MCAP = ".log", ".mcap"  # suffixes of the two formats
MCAP_MAGIC = b"\x89MCAP0\r\n"


class LogEntry(NamedTuple):
    """One message in a log: time of reception, channel and data."""

    wall_us: int
    channel: str
    data: bytes


class RecordingReader(Protocol):
    """Iterates over the messages of a recording. After the iteration, `count` is the number of
    messages, and `damage` describes in one text line what was skipped, or is None."""

    path: Path
    count: int

    def __iter__(self) -> Iterator[LogEntry]: ...

    @property
    def damage(self) -> str | None: ...


class RecordingWriter(Protocol):
    """Writes messages to a new recording."""

    path: Path
    count: int

    def write(self, channel: str, data: bytes, wall_us: int) -> None: ...

    def close(self) -> None: ...


def reader_of(path: Path) -> RecordingReader:
    """Returns a reader of a recording, in the format that the begin of the file has. Raises
    InputError, also if MCAP needs a package that is not installed."""
    try:
        with path.open("rb") as file:
            is_mcap = file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
    except OSError:
        return LogReader(path)  # which says why it cannot read the file
    if not is_mcap:
        return LogReader(path)
    expect_package(paths.display(path), "mcap", "mcap", "mcap")
    from forceaxis.bus.mcap_file import McapReader

    return McapReader(path)


def writer_of(path: Path, stream: BinaryIO | None = None) -> RecordingWriter:
    """Returns a writer of a new recording, in the format of the suffix of `path`: MCAP for .mcap,
    else the format of lcm-logger. With a `stream`, the writer writes there. Raises InputError."""
    if path.suffix != MCAP:
        return LogWriter(path, stream)
    expect_package(paths.display(path), "mcap", "mcap", "mcap")
    from forceaxis.bus.mcap_file import McapWriter

    return McapWriter(path, stream)


def expect_suffix(path: Path, parameter: str) -> None:
    """Raises ParameterError if the suffix of `path` is that of no recording."""
    if path.suffix not in (LOG, MCAP):
        raise ParameterError(parameter, f"{path}: expected a file ending in {MCAP} or {LOG}")


@dataclass(frozen=True)
class ChannelSummary:
    """Counts and message rate of one channel of a log. The numbers of lost and repeated messages
    are None for a channel of a different program."""

    type: str | None
    count: int
    bytes: int
    span_s: float
    rate_per_s: float | None
    lost: int | None
    doubled: int | None
    runs: int | None
    undecodable: int


@dataclass(frozen=True)
class LogSummary:
    """Summary of a log, the result of `forceaxis log info --json`."""

    file: Path
    messages: int
    span_s: float
    start_wall_us: int
    damage: str | None
    channels: dict[str, ChannelSummary]  # channels sorted by axis and name


@dataclass
class _ChannelCount:
    """Message counts of one channel, updated while a log is read."""

    first_us: int
    last_us: int = 0
    type: str | None = None
    count: int = 0
    bytes: int = 0
    undecodable: int = 0
    gaps: Gaps = field(default_factory=Gaps)

    def summary(self) -> ChannelSummary:
        """Returns the message counts as a result."""
        span_s = (self.last_us - self.first_us) / 1e6
        ours = self.type is not None
        return ChannelSummary(
            type=self.type,
            count=self.count,
            bytes=self.bytes,
            span_s=span_s,
            rate_per_s=(self.count - 1) / span_s if span_s > 0 else None,
            lost=self.gaps.lost if ours else None,
            doubled=self.gaps.doubled if ours else None,
            runs=self.gaps.restarts + 1 if ours else None,
            undecodable=self.undecodable,
        )


def new_file(path: Path) -> BinaryIO:
    """Creates a file, and opens it for writing. Raises InputError if the file exists, OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        return path.open("xb")
    except FileExistsError:
        raise InputError(
            f"{paths.display(path)}: expected the name of a new file, but this file already "
            "exists; choose another name"
        ) from None


class LogWriter:
    """Writes a log that lcm-logplayer and other LCM tools can read. The writer flushes the file
    twice a second, so that few messages are lost if the process is killed. Without a `stream`, the
    writer creates the file. Raises InputError if the file exists."""

    def __init__(self, path: Path, stream: BinaryIO | None = None) -> None:
        self.path, self.count = path, 0
        self._file = new_file(path) if stream is None else stream
        self._flushed = time.monotonic()

    def write(self, channel: str, data: bytes, wall_us: int) -> None:
        name = channel.encode()
        self._file.write(
            HEADER.pack(SYNC_MARK, self.count, wall_us, len(name), len(data)) + name + data
        )
        self.count += 1
        if (now := time.monotonic()) > self._flushed + 0.5:
            self._file.flush()
            self._flushed = now

    def close(self) -> None:
        self._file.close()


class LogReader:
    """Iterates over the entries of a log. After the iteration, `damage` describes skipped bytes in
    one text line, or is None without skipped bytes."""

    def __init__(self, path: Path) -> None:
        self.path, self.count, self.skipped, self.cut = path, 0, 0, False
        try:
            empty = path.stat().st_size == 0
            self._data = memoryview(b"" if empty else np.memmap(path, np.uint8, "r").data)
        except (OSError, ValueError) as error:
            raise InputError(
                f"{paths.display(path)}: expected an LCM log that can be read, got: {_why(error)}"
            ) from None

    def __iter__(self) -> Iterator[LogEntry]:
        data, size, at = self._data, len(self._data), 0
        self.count, self.skipped, self.cut = 0, 0, False
        while at < size:
            if at + HEADER.size <= size:
                mark, _, wall_us, name_size, data_size = HEADER.unpack_from(data, at)
                start = at + HEADER.size
                stop = start + name_size + data_size
                sane = (
                    mark == SYNC_MARK and name_size <= LONGEST_CHANNEL and data_size <= LONGEST_DATA
                )
                # A corrupted length would skip correct entries that follow.
                if sane and stop <= size and self._whole(data, start, stop):
                    self.count += 1
                    at, middle = stop, start + name_size
                    name = bytes(data[start:middle]).decode(errors="replace")
                    yield LogEntry(wall_us, name, bytes(data[middle:stop]))
                    continue
            found = _find(data, at + 1, size)
            end = size if found < 0 else found
            self.skipped += end - at
            self.cut = found < 0
            at = end

    @staticmethod
    def _whole(data: memoryview, start: int, stop: int) -> bool:
        """Returns True if an entry ends at `stop`. An entry ends at `stop` if the next entry or
        the end of the file follows at `stop`, or if no other entry begins between `start` and
        `stop`."""
        follows = bytes(data[stop : stop + 4])
        return SYNC_BYTES.startswith(follows) or _find(data, start, stop) < 0

    @property
    def damage(self) -> str | None:
        """Returns one text line with the number of skipped bytes, or None if no byte was
        skipped."""
        if not self.skipped:
            return None
        what = "is cut off" if self.cut else "is damaged"
        return (
            f"{paths.display(self.path)}: {what}, {self.skipped} bytes passed over, "
            f"{self.count} messages saved"
        )


def _find(data: memoryview, start: int, stop: int) -> int:
    """Returns the position of the next entry between `start` and `stop`, or -1 without an entry.
    The function searches the data in blocks, because a log may be large."""
    piece = 1 << 20
    while start < stop:
        found = bytes(data[start : min(stop, start + piece + 3)]).find(SYNC_BYTES)
        if found >= 0:
            return start + found
        start += piece
    return -1


def _why(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def expect_messages(reader: RecordingReader) -> None:
    """Raises InputError if a log contains no message."""
    if not reader.count:
        raise no_messages(reader)


def no_messages(reader: RecordingReader) -> InputError:
    """Returns the error for a log that contains no message."""
    return InputError(
        f"{paths.display(reader.path)}: expected an LCM log with at least one message, got a log "
        "without messages; choose another file"
    )


def info(path: Path) -> LogSummary:
    """Returns the summary of a log: channels, counts, time span and lost messages."""
    reader, counts = reader_of(path), dict[str, _ChannelCount]()
    for entry in reader:
        seen = counts.setdefault(entry.channel, _ChannelCount(entry.wall_us))
        seen.count += 1
        seen.bytes += len(entry.data)
        seen.last_us = entry.wall_us
        if carried := type_of(entry.channel, entry.data):
            seen.type = carried.__name__
            try:
                message = decode(entry.channel, entry.data)
            except Undecodable:
                seen.undecodable += 1
            else:
                seen.gaps.take(message.run_id, message.seq)
    expect_messages(reader)
    first_us = min(seen.first_us for seen in counts.values())
    last_us = max(seen.last_us for seen in counts.values())
    return LogSummary(
        file=path,
        messages=reader.count,
        span_s=(last_us - first_us) / 1e6,
        start_wall_us=first_us,
        damage=reader.damage,
        channels={name: counts[name].summary() for name in sorted(counts, key=_order)},
    )


@dataclass(frozen=True)
class Conversion:
    """Result of the conversion of a recording to another format."""

    file: Path
    target: Path
    messages: int
    damage: str | None  # what was not read of a damaged recording


def convert(path: Path, target: Path) -> Conversion:
    """Writes a recording in the format of the suffix of `target`, complete or not at all. Raises
    InputError, OSError."""
    expect_suffix(target, "target")
    reader = reader_of(path)
    with paths.replacing(target.parent, target.name) as (file,), file.open("wb") as stream:
        writer = writer_of(target, stream)
        for entry in reader:
            writer.write(entry.channel, entry.data, entry.wall_us)
        expect_messages(reader)
        writer.close()
    return Conversion(path, target, reader.count, reader.damage)


def _order(channel: str) -> tuple[bool, int, str]:
    axis, kind = channel_of(channel)
    return (kind is None, axis or 99, channel)
