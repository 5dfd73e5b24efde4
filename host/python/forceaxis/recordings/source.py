"""Sources of recordings. A source is a file of another program, which is read as columns of numbers
with times."""

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.bus import log_tables
from forceaxis.bus.message_rows import Row
from forceaxis.bus.recordings import MCAP_MAGIC, reader_of
from forceaxis.errors import ParameterError
from forceaxis.recordings.signal_recording import Floats
from forceaxis.recordings.units import split_name
from forceaxis.words import suggestion

Table: TypeAlias = Mapping[str, NDArray[np.generic]]

# Largest magnitude of a number in a source. A larger number shows that the file is damaged.
LARGEST_NUMBER = 1e100
# Usual names, in lower case, of a column with times, in the order in which they are tried.
TIME_NAMES = ("time_s", "t_s", "time", "t", "zeit", "timestamp", "tick", "time_ms", "t_ms")


@dataclass(frozen=True)
class SourceColumn:
    """One column of a source. `lines`: line numbers of its values in the file, for messages."""

    name: str
    unit: str | None  # unit that the source states
    # values of the column; NaN means that the column has no value there
    values: Floats = field(repr=False)
    lines: Sequence[int] = field(repr=False, default=())
    # name of the column that has the times of these values; None: that of the whole source
    time_column: str | None = None

    def place(self, sample: int) -> str:
        """Returns the place of a sample in its file as text for messages, such as "line 7, Fz"."""
        if len(self.lines):
            return f"line {self.lines[sample]}, {self.name}"
        return f"{self.name}, sample {sample}"


class Source(abc.ABC):
    """A file that is read as a source of recordings. `where`: name of the file in messages. `kind`:
    text that describes the kind of file."""

    where: str
    kind: str

    @abc.abstractmethod
    def names(self) -> list[str]:
        """Returns the names of the columns of the source, without units."""

    @abc.abstractmethod
    def column(self, name: str) -> SourceColumn:
        """Returns the column with a name that names() contains. Raises InputError."""

    def find(self, text: str, parameter: str) -> str:
        """Returns the full name of the column that a user means. The user writes the name, the end
        of a name after "/" or ".", or the number of the column from 1. Raises InputError."""
        known = self.names()
        if text in known:
            return text
        small = text.casefold()
        alike = [n for n in known if n.casefold() == small or split_name(n)[0].casefold() == small]
        ends = [n for n in known if n.casefold().endswith(("/" + small, "." + small))]
        for found in (alike, ends):
            if len(found) == 1:
                return found[0]
            if found:
                raise ParameterError(
                    parameter,
                    f"expected the name of one column of {self.where}, got {text}, which is "
                    f"{', '.join(found)}; write one of these names",
                )
        if text.isdigit() and 1 <= int(text) <= len(known):
            return known[int(text) - 1]
        few = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
        raise ParameterError(
            parameter,
            f"expected a column of {self.where} ({few or 'none'}), got {text}"
            f"{suggestion(text, known) or '; write one of these names'}",
        )

    def time_name(self) -> str | None:
        """Returns the name of the column with the times, or None if no column has such a name."""
        known = {split_name(name)[0].casefold(): name for name in reversed(self.names())}
        known |= {name.casefold(): name for name in reversed(self.names())}
        return next((known[name] for name in TIME_NAMES if name in known), None)


class ArraySource(Source):
    """A source of recordings that consists of arrays, from an NPZ file, a Parquet file or messages.
    `times`: {column: column with its times}."""

    def __init__(
        self, path: Path, kind: str, table: Table, times: Mapping[str, str] | None = None,
        units: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        self.where, self.kind = paths.display(path), kind
        self._table, self._times, self._units = table, times or {}, units or {}

    def names(self) -> list[str]:
        return list(self._table)

    def column(self, name: str) -> SourceColumn:
        given = np.asarray(self._table[name])
        if given.ndim != 1 or given.dtype.kind not in "iufbM":
            raise InputError(
                f"{self.where}: {name}: expected an array of numbers in one dimension, got "
                f"{given.dtype} in the shape {given.shape}; choose another column"
            )
        if len(given) == 0:
            raise InputError(
                f"{self.where}: {name}: expected samples, got none; choose another column or "
                "record again"
            )
        if given.dtype.kind == "M":
            given = (given - given[0]) / np.timedelta64(1, "ns") * 1e-9
        values = given.astype(np.float64)
        unit = self._units.get(name) or split_name(name.rpartition("/")[2])[1]
        found = SourceColumn(name, unit, values, (), self._times.get(name))
        return expect_finite(self.where, found)


def expect_finite(where: str, column: SourceColumn) -> SourceColumn:
    """Returns a column unchanged. Raises InputError if one of its numbers is infinite or too
    large."""
    wrong = np.flatnonzero(np.abs(column.values) > LARGEST_NUMBER)
    if len(wrong):
        at = int(wrong[0])
        raise InputError(
            f"{where}: {column.place(at)}: expected a number below {LARGEST_NUMBER:g}, got "
            f"{column.values[at]:g}; correct or remove this sample"
        )
    return column


def read_npz(path: Path) -> Source:
    """Returns the arrays of an NPZ file as a source. Raises InputError."""
    expected = "an NPZ file with arrays of numbers"
    table = files.read_arrays(path, expected, "write the arrays with numpy.savez")
    return ArraySource(path, "NPZ", table)


def read_parquet(path: Path) -> Source:
    """Returns the columns of a Parquet file as a source. Raises InputError."""
    from pyarrow import parquet

    with files.parsing(path, "a Parquet file", "export the data again"):
        with parquet.ParquetFile(path) as file:
            about = file.metadata
            files.expect_unpacked(path, 8 * about.num_rows * about.num_columns)
            found = file.read()
        table = {
            name: found.column(name).to_numpy()
            for name in dict.fromkeys(found.column_names)
            if found.column_names.count(name) == 1
        }
        units = {
            field.name: field.metadata[b"unit"].decode()
            for field in found.schema
            if field.metadata and b"unit" in field.metadata
        }
    return ArraySource(path, "Parquet", table, units=units)


def read_messages(path: Path) -> Source:
    """Returns the messages in an LCM log or an MCAP file as a source of recordings, with columns
    CHANNEL/field. The messages in an MCAP file are messages of forceaxis or JSON. Raises
    InputError."""
    with path.open("rb") as file:
        is_mcap = file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
    kind = "MCAP" if is_mcap else "LCM log"
    tables, others, damage = log_tables.tables_of(reader_of(path))
    if not tables and is_mcap:
        tables, others, damage = _json_tables(path)
    where = paths.display(path)
    if damage:
        raise InputError(
            f"{damage}; expected a complete file; `convert_log` writes the complete messages to a "
            "new file"
        )
    if not tables:
        raise InputError(
            f"{where}: expected messages of forceaxis{' or in JSON' * is_mcap}, got "
            + (f"only those of {', '.join(others)}" if others else "no message")
            + "; export the data as CSV or Parquet"
        )
    found, times = {}, {}
    for channel, columns in tables.items():
        time = next((n for n in (*TIME_NAMES, "utime_us", "received_wall_us") if n in columns), "")
        for name, values in columns.items():
            if values.dtype.kind in "iufb":
                found[f"{channel}/{name}"] = values
                times[f"{channel}/{name}"] = f"{channel}/{time}"
    return ArraySource(path, kind, found, times)


def _json_tables(path: Path) -> tuple[dict[str, log_tables.Table], list[str], str | None]:
    """Reads the JSON messages of an MCAP file. Returns (tables, topics, damage). `tables`: {topic:
    {field: values}} with all numbers. `topics`: topics with messages in other encodings. `damage`:
    one text line about damage of the file, or None."""
    from forceaxis.bus.mcap_file import McapReader

    rows: dict[str, list[Row]] = {}
    others: dict[str, None] = {}
    reader = McapReader(path)
    for channel, message in reader.messages():
        if channel.message_encoding != "json":
            others[f"{channel.topic} ({channel.message_encoding or 'no encoding'})"] = None
            continue
        with files.parsing(path, f"messages in JSON on {channel.topic}", "export the data as CSV"):
            row: Row = dict(_numbers("", files.json_of(message.data, has_constants=True)))
        row["time_s"] = message.log_time * 1e-9
        rows.setdefault(channel.topic, []).append(row)
    tables: dict[str, log_tables.Table] = {}
    for topic, own in rows.items():
        columns = log_tables.Columns()
        for row in sorted(own, key=lambda row: float(row["time_s"] or 0.0)):
            columns.add(row)
        tables[topic] = columns.arrays()
    return tables, list(others), reader.damage


def _numbers(prefix: str, value: object) -> list[tuple[str, float]]:
    """Returns the numbers in a JSON value as [(name, number)], such as ("wrench.force.z", 1.5)."""
    if isinstance(value, bool | int | float):
        return [(prefix or "value", float(value))]
    items: Sequence[tuple[object, object]] = []
    if isinstance(value, dict):
        items = list(value.items())
    elif isinstance(value, list):
        items = list(enumerate(value))
    return [
        pair
        for key, inner in items
        for pair in _numbers(f"{prefix}.{key}" if prefix else str(key), inner)
    ]
