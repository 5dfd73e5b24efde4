"""Reads, writes, summarises and converts recordings of LCM messages. A recording is a log in the
format of lcm-logger, or an MCAP file."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Protocol

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.bus.lcm import Gaps, Undecodable, channel_of, decode, type_of
from forceaxis.bus.log import LogEntry, LogReader, LogWriter
from forceaxis.errors import ParameterError, expect_package

LOG, MCAP = ".log", ".mcap"  # file name suffixes of the two formats of a recording
MCAP_MAGIC = b"\x89MCAP0\r\n"


class RecordingReader(Protocol):
    """Iterates over the messages of a recording. After the iteration, `count` is the number of
    messages. `damage` is one text line about data that were skipped, or None."""

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
    """Returns a reader of a recording. The first bytes of the file determine the format. Raises
    InputError. An MCAP file also raises InputError if a package for MCAP is not installed."""
    try:
        with path.open("rb") as file:
            is_mcap = file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
    except OSError:
        return LogReader(path)  # LogReader raises an error that states why the file cannot be read
    if not is_mcap:
        return LogReader(path)
    expect_package(paths.display(path), "mcap", "mcap", "mcap")
    from forceaxis.bus.mcap_file import McapReader

    return McapReader(path)


def writer_of(path: Path, stream: BinaryIO | None = None) -> RecordingWriter:
    """Returns a writer of a new recording. The suffix of `path` selects the format: MCAP for .mcap,
    otherwise the format of lcm-logger. `stream`: an open file to write to instead of `path`. Raises
    InputError."""
    if path.suffix != MCAP:
        return LogWriter(path, stream)
    expect_package(paths.display(path), "mcap", "mcap", "mcap")
    from forceaxis.bus.mcap_file import McapWriter

    return McapWriter(path, stream)


def expect_suffix(path: Path, parameter: str) -> None:
    """Raises ParameterError if the suffix of `path` is not .log or .mcap, the suffixes of
    recordings."""
    if path.suffix not in (LOG, MCAP):
        raise ParameterError(parameter, f"{path}: expected a file ending in {MCAP} or {LOG}")


@dataclass(frozen=True)
class ChannelSummary:
    """Numbers of messages and message rate of one channel of a log. The numbers of lost and
    repeated messages are None for a channel of another program."""

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
    """Summary of a log."""

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
        """Returns the message counts of the channel as a result."""
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


def expect_messages(reader: RecordingReader) -> None:
    """Raises InputError if a log contains no message."""
    if not reader.count:
        raise no_messages(reader)


def no_messages(reader: RecordingReader) -> InputError:
    """Returns the error for a log that contains no LCM message."""
    if others := getattr(reader, "others", {}):
        kinds = ", ".join(encoding or "no encoding" for encoding in others)
        return InputError(
            f"{paths.display(reader.path)}: expected messages of LCM, got "
            f"{sum(others.values())} of another program ({kinds}); `import_recording` reads them"
        )
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
    damage: str | None  # text about data of a damaged recording that could not be read, or None


def convert(path: Path, target: Path) -> Conversion:
    """Converts a recording to the format that the suffix of `target` selects. Writes either the
    complete file or no file. Raises InputError, OSError."""
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
