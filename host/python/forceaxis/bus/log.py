"""LCM logs: write while receiving, read past damage, summarise.

The format is that of lcm-logger. liblcm's reader stops silently at the first damaged byte; this one
continues at the next event and reports what it skipped.
"""

import struct
import time
from collections import namedtuple

import numpy as np

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.bus.lcm import Gaps, Undecodable, channel_of, decode, type_of

SYNC = 0xEDA1DA01
SYNC_BYTES = struct.pack(">I", SYNC)
HEADER = struct.Struct(">IqqII")  # sync, number, wall us, lengths of channel and data
LONGEST_CHANNEL, LONGEST_DATA = 255, 1 << 28

Entry = namedtuple("Entry", "wall_us channel data")


class LogWriter:
    """Writes a log that lcm-logplayer and every LCM tool reads. Flushed twice a second, so that
    a killed process loses little."""

    def __init__(self, path):
        self.path, self.count = path, 0
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._file = path.open("xb")
        except FileExistsError:
            raise InputError(f"{paths.display(path)}: expected a new file, it exists") from None
        self._flushed = time.monotonic()

    def write(self, channel, data, wall_us):
        name = channel.encode()
        self._file.write(HEADER.pack(SYNC, self.count, wall_us, len(name), len(data)) + name + data)
        self.count += 1
        if (now := time.monotonic()) > self._flushed + 0.5:
            self._file.flush()
            self._flushed = now

    def close(self):
        self._file.close()


class LogReader:
    """Iterates over the entries of a log; afterwards `damage` is None or one line."""

    def __init__(self, path):
        self.path, self.count, self.skipped, self.cut = path, 0, 0, False
        try:
            self._bytes = np.memmap(path, np.uint8, "r") if path.stat().st_size else b""
        except (OSError, ValueError) as error:
            raise InputError(
                f"{paths.display(path)}: expected a log to read, {_why(error)}"
            ) from None

    def __iter__(self):
        data, size, at = memoryview(self._bytes), len(self._bytes), 0
        self.count, self.skipped, self.cut = 0, 0, False
        while at < size:
            if at + HEADER.size <= size:
                mark, _, wall_us, name_size, data_size = HEADER.unpack_from(data, at)
                start = at + HEADER.size
                stop = start + name_size + data_size
                sane = mark == SYNC and name_size <= LONGEST_CHANNEL and data_size <= LONGEST_DATA
                # A corrupted length would swallow the events that follow.
                if sane and stop <= size and self._whole(data, start, stop):
                    self.count += 1
                    at, middle = stop, start + name_size
                    name = bytes(data[start:middle]).decode(errors="replace")
                    yield Entry(wall_us, name, bytes(data[middle:stop]))
                    continue
            found = _find(data, at + 1, size)
            end = size if found < 0 else found
            self.skipped += end - at
            self.cut = found < 0
            at = end

    @staticmethod
    def _whole(data, start, stop):
        """Another event or the end follows, or at least none begins inside."""
        follows = bytes(data[stop : stop + 4])
        return SYNC_BYTES.startswith(follows) or _find(data, start, stop) < 0

    @property
    def damage(self):
        """What was skipped, in one line; None if nothing was."""
        if not self.skipped:
            return None
        what = "is cut off" if self.cut else "is damaged"
        return (
            f"{paths.display(self.path)}: {what}, {self.skipped} bytes passed over, "
            f"{self.count} messages saved"
        )


def _find(data, start, stop):
    """Where an event begins at or after `start`, or -1; read in pieces, as a log may be large."""
    piece = 1 << 20
    while start < stop:
        found = bytes(data[start : min(stop, start + piece + 3)]).find(SYNC_BYTES)
        if found >= 0:
            return start + found
        start += piece
    return -1


def _why(error):
    return getattr(error, "strerror", None) or str(error)


def expect_messages(reader):
    """Refuses a log without a single message."""
    if not reader.count:
        raise InputError(f"{paths.display(reader.path)}: expected an LCM log with messages")


def info(path):
    """Channels, counts, span and gaps of a log, as a JSON object."""
    reader, channels = LogReader(path), {}
    for entry in reader:
        row = channels.setdefault(
            entry.channel,
            {
                "type": None,
                "count": 0,
                "bytes": 0,
                "first": entry.wall_us,
                "gaps": Gaps(),
                "bad": 0,
            },
        )
        row["count"] += 1
        row["bytes"] += len(entry.data)
        row["last"] = entry.wall_us
        if carried := type_of(entry.channel, entry.data):
            row["type"] = carried.__name__
            try:
                message = decode(entry.channel, entry.data)
            except Undecodable:
                row["bad"] += 1
            else:
                row["gaps"].take(message.run_id, message.seq)
    expect_messages(reader)
    first = min(row["first"] for row in channels.values())
    last = max(row["last"] for row in channels.values())
    return {
        "file": str(path),
        "messages": reader.count,
        "span_s": (last - first) / 1e6,
        "start_wall_us": first,
        "damage": reader.damage,
        "channels": {name: _row(row) for name, row in sorted(channels.items(), key=_order)},
    }


def _row(row):
    span = (row["last"] - row["first"]) / 1e6
    carried, gaps = row["type"], row["gaps"]
    return {
        "type": carried,
        "count": row["count"],
        "bytes": row["bytes"],
        "span_s": span,
        "rate_per_s": (row["count"] - 1) / span if span > 0 else None,
        "lost": gaps.lost if carried else None,
        "doubled": gaps.doubled if carried else None,
        "runs": gaps.restarts + 1 if carried else None,
        "undecodable": row["bad"],
    }


def _order(item):
    axis, kind = channel_of(item[0])
    return (kind is None, axis or 99, item[0])


def describe(summary):
    """A log's contents for a reader."""
    rows = [("channel", "type", "messages", "per s", "lost", "doubled", "")]
    for name, row in summary["channels"].items():
        rate = "" if row["rate_per_s"] is None else f"{row['rate_per_s']:.1f}"
        bad = f"{row['undecodable']} of another type" if row["undecodable"] else ""
        more = f"{row['runs']} runs" if (row["runs"] or 0) > 1 else ""
        counts = ["" if row[k] is None else str(row[k]) for k in ("lost", "doubled")]
        notes = ", ".join(t for t in (bad, more) if t)
        rows.append((name, row["type"] or "?", str(row["count"]), rate, *counts, notes))
    widths = [max(len(r[i]) for r in rows) for i in range(6)]
    lines = [
        f"{r[0]:{widths[0]}}  {r[1]:{widths[1]}}"
        + "".join(f"  {r[i]:>{widths[i]}}" for i in range(2, 6))
        + (f"  {r[6]}" if r[6] else "")
        for r in rows
    ]
    start = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(summary["start_wall_us"] / 1e6))
    lines.append(f"{summary['messages']} messages, {summary['span_s']:.3f} s from {start}")
    return "\n".join(line.rstrip() for line in lines)
