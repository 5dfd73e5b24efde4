"""Sources of recordings. A source is a file of another program, which is read as columns of numbers
with times."""

import abc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.recordings.clock import NO_TIME_NS, NS_PER_S, Clock
from forceaxis.recordings.signal_recording import Floats
from forceaxis.recordings.units import split_name
from forceaxis.words import suggestion

Table: TypeAlias = Mapping[str, NDArray[np.generic]]

# Largest magnitude of a number in a source. A larger number shows that the file is damaged.
LARGEST_NUMBER = 1e100
# Usual names, in lower case, of a column with times, in the order in which they are tried.
TIME_NAMES = (
    *("time_s", "t_s", "time", "t", "zeit", "timestamp", "tick", "time_ms", "t_ms", "time stamp"),
    *("zeitstempel", "uhrzeit", "date time", "datetime", "date/time", "elapsed time", "run time"),
    *("test time", "prüfzeit", "versuchszeit", "temps", "tempo", "tiempo", "x_value", "time_us"),
    *("t_us", "time_ns", "t_ns", "__time", "elapsed", "seconds"),
)


@dataclass(frozen=True)
class Grid:
    """Equally spaced times that a source states by numbers instead of a column: begin and step."""

    begin_s: float
    step_s: float
    text: str  # where the source states them, such as "Increment 0.001 of line 2"
    # place of a column that counts the steps; None: each row is one step
    counter: int | None = None
    doubt: str = ""  # number of `text` that may have a separator of thousands


@dataclass(frozen=True)
class Head:
    """What a source says about one of its columns. The column itself is known by its place, from 0.
    No two columns of a source have the same name."""

    name: str
    unit: str | None = None  # unit that the source states
    labels: tuple[str, ...] = ()  # other names that the source displays for the column
    time: int | None = None  # place of the column with its times; None: that of the source
    grid: Grid | None = None


@dataclass(frozen=True)
class SourceColumn:
    """One column of a source. `lines`: line numbers of its values in the file, for messages."""

    name: str
    unit: str | None  # unit that the source states
    # values of the column; NaN means that the column has no value there
    values: Floats = field(repr=False)
    lines: Sequence[int] = field(repr=False, default=())

    def place(self, sample: int) -> str:
        """Returns the place of a sample in its file as text for messages, such as "line 7, Fz"."""
        if len(self.lines):
            return f"line {self.lines[sample]}, {self.name}"
        return f"{self.name}, sample {sample}"

    def stretch(self, part: slice) -> str:
        """Returns the place of successive samples as text for messages, such as "lines 2 to 21"."""
        if len(self.lines):
            return f"lines {self.lines[part.start]} to {self.lines[part.stop - 1]}"
        return f"{self.name}, samples {part.start} to {part.stop - 1}"


class Source(abc.ABC):
    """A file, or a section of a file, that is read as a source of recordings. `where`: name of the
    file in messages. `kind`: text that describes the kind of file. `notes`: what a user has to know
    about the reading."""

    where: str
    kind: str
    heads: Sequence[Head]
    notes: list[str]
    count: int | None = None  # number of samples of a recording that the source states
    unread: str = ""  # why the columns have no names, or ""
    # True if the times of the source begin only once, whatever numbers its columns have
    is_whole = False

    @abc.abstractmethod
    def column(self, place: int) -> SourceColumn:
        """Returns the column at a place. Raises InputError."""

    @abc.abstractmethod
    def clock(self, place: int) -> Clock:
        """Returns the times in the column at a place. Raises InputError."""

    def names(self) -> list[str]:
        """Returns the names of the columns of the source, without units."""
        return [head.name for head in self.heads]

    def find(self, text: str, parameter: str, near: int | None = None) -> int:
        """Returns the place of the column that a user means. The user writes one of its names, the
        end of a name after "/" or ".", or the number of the column from 1, also as #1. `near`:
        place of a column whose group, the name before "/", comes first, or None. Raises
        InputError."""
        number = int(text.lstrip("#")) if text.lstrip("#").isdecimal() else 0
        number = number if 1 <= number <= len(self.heads) else 0
        if text.startswith("#") and number:
            return number - 1
        named = self._named(text)
        if near is not None and len(named) > 1:
            group = self.heads[near].name.rpartition("/")[0]
            inside = [k for k in named if self.heads[k].name.rpartition("/")[0] == group]
            named = inside if len(inside) == 1 else named
        if len(named) > 1:
            several = ", ".join(f"#{place + 1} {self.heads[place].name}" for place in named)
            raise ParameterError(
                parameter, f"expected the name of one column of {self.where}, got {text}, which is "
                f"{several}; write one of these names, or the number with #"
            )  # fmt: skip
        if named and number and named != [number - 1]:
            raise ParameterError(
                parameter, f"expected one column of {self.where}, got {text}, which is the number "
                f"of column {number} and the name of column {named[0] + 1}; write #{number} or "
                f"#{named[0] + 1}"
            )  # fmt: skip
        if named or number:
            return named[0] if named else number - 1
        known = self.names()
        few = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
        hint = self.unread or "write one of these names"
        if len(known) > 12:
            hint += f"; `list_columns` lists all {len(known)}"
        raise ParameterError(
            parameter,
            f"expected a column of {self.where} ({few or 'none'}), got {text}"
            f"{suggestion(text, known) or f'; {hint}'}",
        )

    def _named(self, text: str) -> list[int]:
        """Returns the places of the columns that a text names, by the strictest rule that any of
        them meets."""
        small = text.casefold()
        rules: tuple[Callable[[Head], bool], ...] = (
            lambda head: head.name == text,
            lambda head: text in head.labels,
            lambda head: small in {n.casefold() for n in (head.name, *head.labels)},
            lambda head: split_name(head.name)[0].casefold() == small,
            lambda head: head.name.casefold().endswith(("/" + small, "." + small)),
        )
        found = ([k for k, head in enumerate(self.heads) if rule(head)] for rule in rules)
        return next((places for places in found if places), [])

    def time_place(self) -> int | None:
        """Returns the place of the column with the times, or None if no column has such a name."""
        return time_by_name(self.names())

    def has_sure_times(self, place: int) -> bool:
        """Returns True if a column of times was not found by its unit or its texts alone."""
        return True


def time_by_name(names: Sequence[str]) -> int | None:
    """Returns the place of the name of a column with times, or None if no name is such a name."""
    known: dict[str, int] = {}
    for place, name in enumerate(names):
        known.setdefault(name.casefold(), place)
        known.setdefault(split_name(name)[0].casefold(), place)
    return next((known[name] for name in TIME_NAMES if name in known), None)


class ArraySource(Source):
    """A source of recordings that consists of arrays. `arrays`: a function for each of the heads,
    which reads the array of the column from the file. It may raise InputError."""

    def __init__(
        self, path: Path, kind: str, heads: Sequence[Head],
        arrays: Sequence[Callable[[], NDArray[np.generic]]],
    ) -> None:  # fmt: skip
        self.where, self.kind, self.heads, self.notes = paths.display(path), kind, heads, []
        self._arrays = arrays

    def _array(self, place: int) -> NDArray[np.generic]:
        given, name = np.asarray(self._arrays[place]()), self.heads[place].name
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
        return given

    def column(self, place: int) -> SourceColumn:
        given = self._array(place)
        if given.dtype.kind == "M":
            raise InputError(
                f"{self.where}: {self.heads[place].name}: expected numbers, got times of a "
                "calendar; choose another column"
            )
        with np.errstate(invalid="ignore"):  # a damaged file may contain a signalling NaN
            values = given.astype(np.float64)
        head = self.heads[place]
        return expect_finite(self.where, SourceColumn(head.name, head.unit, values))

    def clock(self, place: int) -> Clock:
        given, head = self._array(place), self.heads[place]
        if given.dtype.kind == "M":
            ns = given.astype("datetime64[ns]").astype(np.int64)
            known = ns != NO_TIME_NS
            begin = int(ns[known][0]) if known.any() else 0
            times = np.where(known, (ns - begin) * 1e-9, np.nan)
            return Clock(head.name, "s", times, Fraction(begin, NS_PER_S), (), True)
        if given.dtype.kind in "iu" and abs(int(given.max())) < 1 << 62:
            ticks = given.astype(np.int64)  # differences of unsigned integers may be negative
            steps = (ticks - ticks[0]).astype(np.float64)
            return Clock(head.name, head.unit, steps, Fraction(int(ticks[0])))
        return Clock(head.name, head.unit, self.column(place).values)


def array_source(
    path: Path, kind: str, table: Table, times: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> ArraySource:  # fmt: skip
    """Returns arrays in the memory as a source. `times`: {column: column with its times}. `units`:
    {column: unit}; other units are at the ends of the names."""
    places = {name: place for place, name in enumerate(table)}
    heads = [
        Head(
            name, (units or {}).get(name) or split_name(name.rpartition("/")[2])[1], (),
            places.get((times or {}).get(name, "")),
        )
        for name in table
    ]  # fmt: skip
    return ArraySource(path, kind, heads, [partial(np.asarray, array) for array in table.values()])


def expect_finite(
    where: str, column: SourceColumn, largest: float = LARGEST_NUMBER
) -> SourceColumn:
    """Returns a column unchanged. Raises InputError if one of its numbers is infinite or larger
    than `largest`."""
    # The ends are found without a copy of all values.
    ends = [float(end.reduce(column.values, initial=0.0)) for end in (np.fmax, np.fmin)]
    if max(map(abs, ends)) > largest:
        at = int(np.flatnonzero(np.abs(column.values) > largest)[0])
        raise InputError(
            f"{where}: {column.place(at)}: expected a number below {largest:g}, got "
            f"{column.values[at]:g}; correct or remove this sample"
        )
    return column


def read_npz(path: Path) -> Source:
    """Returns the arrays of an NPZ file as a source. Raises InputError."""
    expected = "an NPZ file with arrays of numbers"
    table = files.read_arrays(path, expected, "write the arrays with numpy.savez")
    return array_source(path, "NPZ", table)


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
    return array_source(path, "Parquet", table, units=units)
