"""Text tables of any dialect as sources of recordings, a source for each section of rows.

A file is read several times: to find its dialect and its sections, and once for each column that
is asked for. No more than a block of its lines is in the memory at a time.
"""

import itertools
from collections.abc import Iterator, Sequence
from decimal import Context, Decimal
from fractions import Fraction
from pathlib import Path
from typing import overload

import numpy as np

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.recordings import clock, heads, side_header
from forceaxis.recordings.clock import NO_TIME_NS, NS_PER_S, Clock, ClockError, ClockReader
from forceaxis.recordings.columns import (
    CLOCK,
    NUMBER,
    TEXT,
    Section,
    differences,
    floats_of,
    numbers_of,
    sections_of,
    text_of,
)
from forceaxis.recordings.dialect import (
    GROUPED,
    NUMBERS,
    OVER_RANGE,
    Dialect,
    dialect_of,
    is_missing,
)
from forceaxis.recordings.signal_recording import Floats
from forceaxis.recordings.source import (
    Head,
    Source,
    SourceColumn,
    expect_finite,
    time_by_name,
)
from forceaxis.words import counted

SHOWN = 40  # largest number of characters that a message shows of a text that is not a number
SHOWN_LINES = 4  # largest number of skipped lines that are shown with their text
# Numbers by which programs say that a value was outside the range of a converter.
OVER_RANGE_NUMBERS = (9.9e37, 9.91e37, -9.9e37, -9.91e37)
# Names, in lower case, of a column that states for each row to which signal the row belongs.
# A column with one of the first names is certainly such a column.
# A column with one of the other names may also contain states.
SURE_NAMES = ("varname", "variable", "variable name", "tag", "tagname", "tag name")
SIGNAL_NAMES = (*SURE_NAMES, "signal", "signal name", "channel", "channel name", "item", "name",
                "parameter", "topic", "sensor", "id")  # fmt: skip
# Names, in lower case, of a column with the milliseconds of the clock times in front of it.
MILLISECONDS = ("ms", "msec", "msecs", "millis", "milli", "millisecond", "milliseconds",
                "millisekunde", "millisekunden")  # fmt: skip
# Times are read exactly if their rounding error in the memory exceeds this share of their step.
EXACT_SHARE = 1e-3
EXACT = Context(prec=200)  # digits of the difference of two times
LARGEST_TIME = 1e22  # largest magnitude of a time in any unit
# Two sections with the same columns are one recording if the second continues the first in time.
# CONTINUED_PERIODS: largest number of missing samples between two sections of one recording.
CONTINUED_PERIODS = 10.0


class _Lines(Sequence[int]):
    """The line numbers of the rows of a section."""

    def __init__(self, section: Section) -> None:
        self._section = section

    def __len__(self) -> int:
        return self._section.rows

    @overload
    def __getitem__(self, row: int) -> int: ...
    @overload
    def __getitem__(self, row: slice) -> Sequence[int]: ...
    def __getitem__(self, row: int | slice) -> int | Sequence[int]:
        if isinstance(row, slice):
            return [self._section.line_of(k) for k in range(*row.indices(len(self)))]
        return self._section.line_of(row)


class TableSource(Source):
    """A section of a text table as a source of recordings. The fields of a column are converted to
    numbers only when the column is requested. Columns that are not requested may therefore contain
    texts. `file`: temporary file with the table, which exists as long as its sources, or None."""

    file: object = None

    def __init__(self, path: Path, where: str, section: Section, found: heads.Heads) -> None:
        self.where, self.heads, self._path, self._section = where, found.heads, path, section
        decimal = " with decimal commas" if section.dialect.decimal == "," else ""
        self.kind = found.kind + decimal
        self.unread = found.unread
        self.notes = [*found.notes, *_notes(section, found)]
        self.count = found.count[0] if found.count is not None else None

    def __len__(self) -> int:
        return self._section.rows

    @property
    def lines(self) -> str:
        """The lines of the section as text."""
        return f"lines {self._section.first_line} to {self._section.last_line}"

    def time_place(self) -> int | None:
        return heads.time_place_of(self._section, self.heads)

    def has_sure_times(self, place: int) -> bool:
        return time_by_name([self.heads[place].name]) is not None

    def column(self, place: int) -> SourceColumn:
        self._expect_columns()
        values = self._values(place)
        self._expect_sure_decimals(place, values)
        head = self.heads[place]
        self._note_missing(head, values)
        return expect_finite(
            self.where, SourceColumn(head.name, head.unit, values, _Lines(self._section))
        )

    def _values(self, place: int) -> Floats:
        """Returns the numbers of a column. Raises InputError."""
        values = np.empty(self._section.rows)
        over: list[int] = []
        for row, count, text in self._section.texts(self._path):
            found = numbers_of(text, self._section.dialect, self._section.width, [place])
            part = (
                self._numbers(place, row, text, over) if found is None
                else floats_of(found[0])
            )  # fmt: skip
            wrong = np.flatnonzero(np.isin(part, OVER_RANGE_NUMBERS) | np.isinf(part))
            if len(wrong):
                part = np.where(np.isin(part, OVER_RANGE_NUMBERS) | np.isinf(part), np.nan, part)
                over += [row + int(k) for k in wrong]
            values[row : row + count] = part
        if over:
            self._note(
                f"{self.heads[place].name}: {counted(len(over), 'value')} outside the range of the "
                f"converter, in line {self._section.line_of(over[0])} first, left out"
            )
        return values

    def _expect_columns(self) -> None:
        """Raises InputError if a column names the signal of each row, so that a column of numbers
        has the values of several signals."""
        for place, head in enumerate(self.heads):
            if self._section.kinds[place] != TEXT or head.name.casefold() not in SIGNAL_NAMES:
                continue
            names = [row[place] for row in self._section.samples if place < len(row)]
            changes = sum(a != b for a, b in itertools.pairwise(names))
            if 4 * changes > len(names) or (changes and head.name.casefold() in SURE_NAMES):
                several = ", ".join(list(dict.fromkeys(names))[:4])
                raise InputError(
                    f"{self.where}: {head.name}: expected a column for each signal, got rows of "
                    f"several signals ({several}); export each signal as a column or as a file"
                )

    def _expect_sure_decimals(self, place: int, values: Floats) -> None:
        """Raises InputError if the decimal sign of a column may be a separator of thousands: the
        file shows nowhere that it is a decimal sign."""
        rows = self._section.samples
        if any(self._section.dialect.has_sure_decimals(cell) for row in rows for cell in row):
            return
        broken = np.flatnonzero(values % 1 > 0)  # the values also belong to rows that are not kept
        at = int(broken[0]) if len(broken) else None
        found = (at, self._cell(place, at)) if at is not None else self._grouped(place)
        if found is None or not GROUPED.match(found[1]):
            return
        (row, cell), name = found, self.heads[place].name
        other = cell.replace(".", "").replace(",", "")
        cells = [one[place] for one in rows if place < len(one) and not is_missing(one[place])]
        if len(broken) and all(self._section.dialect.decimal in one for one in cells):
            self._note(f"{name}: {cell} was read with three decimals, and not as {other}")
            return
        raise InputError(
            f"{self.where}: line {self._section.line_of(row)}, {name}: expected a sure "
            f"decimal sign, got {cell!r}, which may be {other}; export the numbers "
            "without separators of thousands, or with four decimals"
        )

    def _grouped(self, place: int) -> tuple[int, str] | None:
        """Returns (row, field) of the first number of a column that may have a separator of
        thousands instead of its decimal sign."""
        decimal = self._section.dialect.decimal
        for first, _, text in self._section.texts(self._path):
            if decimal not in text:
                continue
            for row, cell in enumerate(self._cells(place, text), first):
                if decimal in cell and GROUPED.match(cell):
                    return row, cell
        return None

    def _cell(self, place: int, row: int) -> str:
        """Returns the field of a row."""
        for first, count, text in self._section.texts(self._path):
            if row < first + count:
                return list(self._cells(place, text))[row - first]
        return ""

    def _note_missing(self, head: Head, values: Floats) -> None:
        """Notes that rows have no value. A column of a group may end before the others."""
        known = ~np.isnan(values)
        end = int(np.flatnonzero(known)[-1]) + 1 if known.any() else 0
        missing = int((~known[: end if head.time is not None else len(known)]).sum())
        if 0 < missing < len(values):
            self._note(f"{head.name}: {missing} of {len(values)} rows have no value")

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)

    def _cells(self, place: int, text: str) -> Iterator[str]:
        """Yields the fields of a column in a text of rows."""
        for line in text.removesuffix("\n").split("\n"):
            cells = self._section.dialect.cells(line)
            yield cells[place] if place < len(cells) else ""

    def _numbers(self, place: int, row: int, text: str, over: list[int]) -> Floats:
        """Returns the numbers of a column in a text of rows. Raises InputError for another text."""
        dialect, values = self._section.dialect, []
        for at, cell in enumerate(self._cells(place, text), row):
            value = dialect.value(cell)
            if value is None:
                raise self._no_number(place, at, cell)
            if cell.casefold() in OVER_RANGE:
                over.append(at)
            values.append(value)
        return np.array(values)

    def _no_number(self, place: int, row: int, text: str) -> InputError:
        dialect, name = self._section.dialect, self.heads[place].name
        hint = "a decimal point" if dialect.decimal == "." else "a decimal comma"
        shown = text if len(text) <= SHOWN else text[:SHOWN] + "..."
        shown = repr(shown) + ", with a separator of thousands" * bool(GROUPED.match(text))
        line = self._section.line_of(row)
        if self._section.kinds[place] in (TEXT, CLOCK):
            return InputError(
                f"{self.where}: line {line}, {name}: expected numbers with {hint}, got {shown}; "
                "this column has texts, so choose another column or replace its texts by numbers"
            )
        return InputError(
            f"{self.where}: line {line}, {name}: expected a number with {hint} as "
            f"in line {self._section.first_line}, got {shown}; correct this field, or leave it "
            "empty for a missing sample"
        )

    def clock(self, place: int) -> Clock:
        head = self.heads[place]
        if self._section.kinds[place] == CLOCK:
            return self._text_clock(place)
        if self._section.kinds[place] == TEXT:
            self._expect_times(place)
        values = self._values(place)
        expect_finite(
            self.where, SourceColumn(head.name, None, values, _Lines(self._section)), LARGEST_TIME
        )
        if not _is_exact(values):
            return self._exact_clock(place)
        return Clock(head.name, head.unit, values, Fraction(0), _Lines(self._section))

    def _expect_times(self, place: int) -> None:
        """Raises InputError if the fields of a column are texts in no known form of a time."""
        cells = [row[place] if place < len(row) else "" for row in self._section.samples]
        for row, cell in enumerate(cells):
            if self._section.dialect.value(cell) is None:
                reader = ClockReader(cells)
                try:
                    reader.read([cell])
                except ClockError as error:
                    raise self._no_time(place, row, error) from None

    def _no_time(self, place: int, row: int, error: ClockError) -> InputError:
        line, name = self._section.line_of(row), self.heads[place].name
        return InputError(f"{self.where}: line {line}, {name}: {error}; export times in s")

    def _text_clock(self, place: int) -> Clock:
        date, part = self._date_place(place), self._part_place(place)

        def joined(rows: Sequence[Sequence[str]]) -> list[str]:
            columns = [[] if k is None else _texts(rows, k) for k in (place, date, part)]
            return clock.joined(*columns)

        reader, base_ns = ClockReader(joined(self._section.samples)), NO_TIME_NS
        times_s = np.empty(self._section.rows)
        for row, count, text in self._section.texts(self._path):
            lines = text.removesuffix("\n").split("\n")
            try:
                times_ns = reader.read(joined([*map(self._section.dialect.cells, lines)]))
            except ClockError as error:
                raise self._no_time(place, row + error.row, error) from None
            known = times_ns != NO_TIME_NS
            if base_ns == NO_TIME_NS and known.any():
                base_ns = int(times_ns[known][0])
            times_s[row : row + count] = np.where(known, (times_ns - base_ns) / NS_PER_S, np.nan)
        head = self.heads[place]
        for also in (k for k in (date, part) if k is not None):
            self._note(f"{head.name}: with {self.heads[also].name}, column {also + 1}")
        for note in reader.notes:
            self._note(f"{head.name}: {note}")
        base = Fraction(base_ns, NS_PER_S) if base_ns != NO_TIME_NS else Fraction(0)
        return Clock(head.name, "s", times_s, base, _Lines(self._section), True)

    def _date_place(self, place: int) -> int | None:
        """Returns the place of the column with the dates of clock times beside it, or None."""
        rows = self._section.samples
        if not all(map(clock.is_time_of_day, filter(None, _texts(rows, place)))):
            return None
        for beside in (place - 1, place + 1):
            if 0 <= beside < len(self.heads) and self._section.kinds[beside] == TEXT:
                dates = list(filter(None, _texts(rows, beside)))
                if dates and all(map(clock.is_date, dates)):
                    return beside
        return None

    def _part_place(self, place: int) -> int | None:
        """Returns the place of the column with the milliseconds of clock times in front of it, or
        None."""
        rows, behind = self._section.samples, place + 1
        if behind >= len(self.heads) or self._section.kinds[behind] != NUMBER:
            return None
        times = _texts(rows, place)
        is_named = self.heads[behind].name.casefold() in MILLISECONDS
        has_none = all(map(clock.is_whole_second, filter(None, times)))
        is_fit = is_named and has_none and clock.are_milliseconds(times, _texts(rows, behind))
        return behind if is_fit else None

    def _exact_clock(self, place: int) -> Clock:
        """Returns times with more digits than a number in the memory. The first one is subtracted
        before the others become numbers."""
        base: Decimal | None = None
        values = np.empty(self._section.rows)
        for row, count, text in self._section.texts(self._path):
            found = numbers_of(text, self._section.dialect, self._section.width, [place], "exact")
            times = self._decimals(place, text) if found is None else found[0].to_pylist()
            if base is None:
                base = next((time for time in times if time is not None), None)
            values[row : row + count] = (
                [np.nan if time is None else float(EXACT.subtract(time, base or Decimal(0)))
                 for time in times]
                if found is None else differences(found[0], base or Decimal(0))
            )  # fmt: skip
        head = self.heads[place]
        return Clock(head.name, head.unit, values, Fraction(base or 0), _Lines(self._section))

    def _decimals(self, place: int, text: str) -> list[Decimal | None]:
        """Returns the numbers of a column in a text of rows, with all of their digits."""
        dialect = self._section.dialect
        return [
            Decimal(cell.replace(",", ".").replace("d", "e").replace("D", "e"))
            if NUMBERS[dialect.decimal].match(cell) and abs(dialect.value(cell) or 0) < LARGEST_TIME
            else None
            for cell in self._cells(place, text)
        ]  # fmt: skip


def _texts(rows: Sequence[Sequence[str]], place: int) -> list[str]:
    """Returns the fields of a column, empty where it has no value."""
    return ["" if place >= len(row) or is_missing(row[place]) else row[place] for row in rows]


def _is_exact(values: Floats) -> bool:
    """Returns True if the rounding of floating-point numbers is small against their median step."""
    known = values[:10_000][np.isfinite(values[:10_000])]
    if len(known) < 2:
        return True
    steps = np.abs(np.diff(known))
    step = float(np.median(steps[steps > 0])) if steps.any() else 0.0
    return float(np.spacing(np.abs(known).max())) <= EXACT_SHARE * step


def _notes(section: Section, found: heads.Heads) -> list[str]:
    """Returns which lines of a file a section consists of."""
    names = f"names of line {found.names.number}" if found.names else "no names above them"
    units = f", units of line {found.units.number}" if found.units else ""
    notes = [
        f"{counted(section.rows, 'row')} in lines {section.first_line} to {section.last_line}, "
        f"{names}{units}"
    ]
    if found.count is not None and found.count[0] != section.rows:
        notes.append(
            f"{found.count[1]} states {counted(found.count[0], 'sample')}, and not {section.rows}"
        )
    used = {line.number for line in (found.names, found.units) if line is not None}
    for last in section.header[-1:]:
        is_next = last.number == section.first_line - 1  # a blank line ends a header
        if is_next and last.number not in used and section.has_numbers(last):
            text = last.text.strip()[:SHOWN]
            notes.append(f"skipped line {last.number} above the rows, which is no row: {text}")
    if section.doubt:
        notes.append(section.doubt)
    if (empty := _empty_lines(section)) and len(empty) < section.rows / 2:
        notes.append(f"{counted(len(empty), 'empty line')} between the rows, first line {empty[0]}")
    shown = [(line.number, line.text.strip()[:SHOWN]) for line in section.skipped[:SHOWN_LINES]]
    if len(section.skipped) == 1:
        notes.append(f"skipped line {shown[0][0]}, which is no row: {shown[0][1]}")
    elif shown:
        few = "; ".join(f"line {number}: {text}" for number, text in shown)
        left = len(section.skipped) - len(shown)
        more = f"; and {left} more" if left else ""
        notes.append(f"skipped {text_of(section.skipped)}, which are no rows: {few}{more}")
    return notes


def _empty_lines(section: Section) -> list[int]:
    """Returns the numbers of the empty lines between the rows of a section."""
    skipped = {line.number for line in section.skipped}
    return [
        number
        for _, (begin, line) in itertools.pairwise(section.starts)
        for number in range(section.line_of(begin - 1) + 1, line)
        if number not in skipped
    ]


def read_tables(path: Path, separator: str | None = None) -> list[Source]:
    """Returns the sections of a text table as sources. `separator`: character between the columns,
    or None to find it. Raises InputError."""
    side_header.expect_samples(path)
    return [*tables_in(path, dialect_of(path, separator), paths.display(path))]


def tables_in(path: Path, dialect: Dialect, where: str) -> list[TableSource]:
    """Returns the sections of a text table in a known dialect as sources. `where`: name of the
    table in messages. Raises InputError."""
    tables: list[tuple[Section, heads.Heads]] = []
    for section in sections_of(path, dialect, where):
        try:
            found = heads.heads_of(section, tables[-1][1] if tables else None)
            found = side_header.with_header(path, section, found)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        if tables and found.heads == tables[-1][1].heads and _continues(*tables[-1], section):
            tables[-1][0].append(section)
        else:
            tables.append((section, found))
    # In a text, such as a manual, single lines look like rows of numbers.
    if len(tables) > 1 and all(section.rows < 2 for section, _ in tables):
        raise InputError(
            f"{where}: expected two or more rows of numbers below each other, got single rows; "
            "export the data as CSV"
        )
    return [TableSource(path, where, section, found) for section, found in tables]


def _continues(section: Section, found: heads.Heads, other: Section) -> bool:
    """Returns True if the times of another section continue the times of a section."""
    place = heads.time_place_of(section, found.heads)
    if place is None:
        return False
    cells = [row[place] for row in section.samples if place < len(row)]
    ends = [section.last[place : place + 1], other.samples[0][place : place + 1]]
    texts = [*cells, *(cell for end in ends for cell in end)]
    if section.kinds[place] == CLOCK:
        try:
            times = ClockReader(texts).read(["" if is_missing(text) else text for text in texts])
        except ClockError:
            return False
        values = times / NS_PER_S
    else:
        numbers = [section.dialect.value(text) for text in texts]
        values = np.array([np.nan if number is None else number for number in numbers])
    if len(values) < 4 or not np.isfinite(values).all():
        return False
    period = float(np.median(np.diff(values[:-2])))
    return bool(0 < values[-1] - values[-2] <= CONTINUED_PERIODS * period)
