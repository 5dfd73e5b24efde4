"""Exports the messages of a recording of LCM messages as tables in CSV and NPZ files."""

import csv
from array import array
from collections.abc import Iterator, MutableSequence, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from forceaxis import paths
from forceaxis._core import TICKS_PER_SECOND
from forceaxis.bus.capture_assembly import Assembly, fits
from forceaxis.bus.lcm import NOT_AVAILABLE, Gaps, Undecodable, channel_of, decode, type_of
from forceaxis.bus.log import LogEntry
from forceaxis.bus.message_rows import Row, column_name, message_row, with_unit
from forceaxis.bus.messages import (
    axis_capture_t,
    sim_truth_t,
)
from forceaxis.bus.recordings import RecordingReader, expect_messages, reader_of

Table = dict[str, NDArray[Any]]
# Values of a column of a table: an array of integers or doubles, or a list of texts.
Column = MutableSequence[Any]


@dataclass(frozen=True)
class WrittenTable:
    """One exported table: files, number of rows and names of the columns."""

    files: list[str]
    rows: int
    columns: list[str]


@dataclass(frozen=True)
class ExportSummary:
    """Result of the export of the LCM messages in a log."""

    file: Path
    out: Path
    messages: int
    damage: str | None
    undecodable: int
    not_exported: list[str]  # names of channels of other programs
    tables: list[WrittenTable]


class Columns:
    """A table that is built from rows. Each row is {name of the column: value}. A missing value
    becomes an empty field."""

    def __init__(self) -> None:
        self.rows = 0
        self._columns: dict[str, Column] = {}

    def add(self, row: Row) -> None:
        for name, value in row.items():
            # A column without values is also created.
            # If this is done, all tables of one message type have the same columns.
            if value is None:
                self._columns.setdefault(name, array("q"))
                continue
            column = self._columns.get(name)
            wanted = {int: "q", float: "d"}.get(type(value))
            if column is None or _WIDER[_kind(column)] < _WIDER[wanted]:
                column = self._columns[name] = _changed(column, wanted)
            wanted = _kind(column)
            missing = self.rows - len(column)
            if missing:
                column.extend([_EMPTY[wanted]] * missing)
            column.append(str(value) if wanted is None else value)
        self.rows += 1

    def arrays(self) -> Table:
        """Returns {name of the column: array}. A column of integers becomes an array of integers if
        no value is missing, otherwise an array of doubles with NaN for each missing value."""
        made: Table = {}
        for name, column in self._columns.items():
            kind = _kind(column)
            column.extend([_EMPTY[kind]] * (self.rows - len(column)))
            values = np.array(column)
            if kind == "q" and (values == NOT_AVAILABLE).any():
                values = np.where(values == NOT_AVAILABLE, np.nan, values)
            made[name] = values
        return made


_WIDER = {"q": 0, "d": 1, None: 2}
_EMPTY = {"q": NOT_AVAILABLE, "d": float("nan"), None: ""}


def _kind(column: Column | None) -> str | None:
    return column.typecode if isinstance(column, array) else None


def _changed(column: Column | None, wanted: str | None) -> Column:
    """Converts a column if a new value has another type. A column of integers becomes a column of
    doubles, and a column of numbers becomes a column of texts."""
    if column is None:
        return [] if wanted is None else array(wanted)
    if wanted == "d":
        return array("d", [float("nan") if v == NOT_AVAILABLE else v for v in column])
    return [str(v) for v in column]


class _Exporter:
    """Collects the messages of a log in tables while the log is read."""

    def __init__(self) -> None:
        self.tables: dict[str, Columns] = {}
        self.captures: dict[tuple[str, int, int], Assembly] = {}
        self.gaps: dict[str, Gaps] = {}
        self.others: set[str] = set()
        self.undecodable = 0

    def take(self, entry: LogEntry) -> None:
        """Adds the message in a log entry to the table for the channel of this message."""
        if type_of(entry.channel, entry.data) is None:
            self.others.add(entry.channel)
            return
        try:
            message = decode(entry.channel, entry.data)
        except Undecodable:
            self.undecodable += 1
            return
        if not self.gaps.setdefault(entry.channel, Gaps()).take(message.run_id, message.seq):
            return  # the network has delivered the same message twice
        _, kind = channel_of(entry.channel)
        if kind == "CAPTURE" and isinstance(message, axis_capture_t):
            key = (entry.channel, message.run_id, message.capture_id)
            self.undecodable += not self.captures.setdefault(key, Assembly()).take(message)
        elif kind == "TRUTH" and isinstance(message, sim_truth_t):
            if fits(message.first_tick, message.num_samples, message.decimation):
                self._add(entry.channel, *truth_rows(message))
            else:
                self.undecodable += 1
        else:
            self._add(entry.channel, message_row(message, entry.wall_us))

    def _add(self, channel: str, *rows: Row) -> None:
        for row in rows:
            self.tables.setdefault(channel, Columns()).add(row)

    def named(self) -> dict[str, Table]:
        """Returns {name of the table: table}. If a channel has several captures, the names of their
        tables are numbered."""
        numbers: dict[str, int] = {}
        named = {channel: table.arrays() for channel, table in self.tables.items()}
        for (channel, _, _), held in self.captures.items():
            if held.signals:
                numbers[channel] = numbers.get(channel, 0) + 1
                named[f"{channel}_{numbers[channel]}"] = capture_columns(held)
        return named


def _read(reader: RecordingReader) -> _Exporter:
    exporter = _Exporter()
    for entry in reader:
        exporter.take(entry)
    return exporter


def tables_of(reader: RecordingReader) -> tuple[dict[str, Table], list[str], str | None]:
    """Returns all tables of a log as {name: table}, the names of channels of other programs, and
    one text line about the damage of the log. The last element is None for an undamaged log."""
    exporter = _read(reader)
    return exporter.named(), sorted(exporter.others), reader.damage


def export(path: Path, out: Path, kinds: Sequence[str] = ("csv", "npz")) -> ExportSummary:
    """Writes all tables of a log to files in the folder `out`."""
    reader = reader_of(path)
    exporter = _read(reader)
    expect_messages(reader)
    written = []
    for name, columns in sorted(exporter.named().items()):
        # the name of a channel may contain "/"
        files = [f"{quote(name, safe=' ')}.{kind}" for kind in kinds]
        with paths.replacing(out, *files) as places:
            for kind, place in zip(kinds, places, strict=True):
                (write_csv if kind == "csv" else write_npz)(place, columns)
        rows = len(next(iter(columns.values()), ()))
        written.append(WrittenTable(files, rows, list(columns)))
    return ExportSummary(
        file=path,
        out=out,
        messages=reader.count,
        damage=reader.damage,
        undecodable=exporter.undecodable,
        not_exported=sorted(exporter.others),
        tables=written,
    )


def truth_rows(message: sim_truth_t) -> Iterator[Row]:
    """Yields one row of a table, with values in SI units, for each sample of a sim_truth_t
    message."""
    names = [with_unit(n, u) for n, u in zip(message.signal, message.unit, strict=True)]
    for i, values in enumerate(message.value):
        tick = message.first_tick + i * message.decimation
        row: Row = {"tick": tick, "time_s": tick / TICKS_PER_SECOND}
        row.update(zip(names, map(float, values), strict=True))
        yield row


def capture_columns(held: Assembly) -> Table:
    """Returns the columns of a capture: tick, time in s, and each signal in engineering units with
    the unit in its name. Samples that the network lost are NaN."""
    ticks = held.ticks()
    columns = {"tick": ticks, "time_s": ticks / TICKS_PER_SECOND}
    for name in held.signals:
        columns[column_name(name)] = held.values(name)
    return columns


def write_csv(path: Path, columns: Table) -> None:
    """Writes a table as a CSV file. A NaN becomes an empty field, and doubles are written with all
    digits."""

    def texts(values: NDArray[np.generic]) -> list[str]:
        exact = values.dtype.kind == "f"
        return [("" if v != v else repr(v)) if exact else str(v) for v in values.tolist()]

    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*map(texts, columns.values()), strict=True))


def write_npz(path: Path, columns: Table) -> None:
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **columns)
