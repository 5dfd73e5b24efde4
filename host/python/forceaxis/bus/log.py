"""Writes and reads log files of LCM messages in the format of lcm-logger.

At a damaged byte, the reader of liblcm stops and reports no error. The reader of this module
continues at the next log entry and reports the number of skipped bytes.
"""

import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from forceaxis import paths
from forceaxis._core import InputError

SYNC_MARK = 0xEDA1DA01
SYNC_BYTES = struct.pack(">I", SYNC_MARK)
# Header of a log entry: synchronisation mark, number of the entry, time in us since 1970.
# The header ends with the sizes of channel name and data in bytes.
HEADER = struct.Struct(">IqqII")
LONGEST_CHANNEL, LONGEST_DATA = 255, 1 << 28
# Largest time in us, which is in the year 2262. MCAP and NumPy count nanoseconds in 64 bits.
LATEST_US = (1 << 63) // 1000


class LogEntry(NamedTuple):
    """One message in a log: time of reception, channel and data."""

    wall_us: int
    channel: str
    data: bytes


def new_file(path: Path) -> BinaryIO:
    """Creates a file, and opens it for writing. Raises InputError if the file already exists, and
    OSError."""
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
    twice a second, so that few messages are lost if the process is killed. `stream`: an open file
    to write to, or None. If it is None, the writer creates the file `path`, and raises InputError
    if the file already exists."""

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
    """Iterates over the entries of a log. After the iteration, `damage` is one text line about the
    skipped bytes, or None if no byte was skipped."""

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
                    mark == SYNC_MARK and name_size <= LONGEST_CHANNEL
                    and data_size <= LONGEST_DATA and 0 <= wall_us < LATEST_US
                )  # fmt: skip
                # If the length of an entry is corrupted, the next correct entries would be skipped.
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
        """Returns True if the log entry that begins at `start` probably ends at `stop`. This is so
        if the next entry or the end of the file is at `stop`, or if no other entry begins between
        `start` and `stop`."""
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
    """Returns the position of the first log entry between `start` and `stop`, or -1 if there is
    none. Searches the data in blocks, because a log may be large."""
    piece = 1 << 20
    while start < stop:
        found = bytes(data[start : min(stop, start + piece + 3)]).find(SYNC_BYTES)
        if found >= 0:
            return start + found
        start += piece
    return -1


def _why(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)
