"""Columns of a text table: its sections of rows, and of what kind each column is.

Columns are judged, not rows: a line is a row of a section if the columns with numbers have numbers
there, whatever texts are in the other columns. A section begins wherever a few successive lines
have a column of numbers. Every other line inside or behind it is named to the user, and a line that
may be a damaged row is refused.
"""

import bisect
import re
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from forceaxis._core import InputError
from forceaxis.recordings import clock
from forceaxis.recordings.dialect import NUMBERS, Dialect, is_missing
from forceaxis.recordings.signal_recording import Floats

if TYPE_CHECKING:
    import pyarrow

# Number of successive rows with which a section begins: the first number that any section has.
LEAST_ROWS = (8, 2, 1)
KEPT_ROWS = 400  # number of first rows of a section that are kept for the judgement of its columns
KEPT_LINES = 20_000  # largest number of lines above a section that are kept
QUICK_LINES = 20_000  # number of lines that are read at once inside a section
SKIPPED_MOST = 2_000  # largest number of lines in a section that are not rows
# number of digits of an exact number: in total, and behind the decimal sign
EXACT_DIGITS = (36, 12)
NUMBER, CLOCK, TEXT, EMPTY = "number", "clock", "text", "empty"  # kinds of a column
# first fields of the lines above the numbers in an export of TwinCAT Scope
SCOPE_KEYS = ("Name", "SymbolName", "SymbolComment", "Unit", "SampleTime[ms]", "Data-Type")
SCOPE_NAMES = SCOPE_KEYS[:2]  # keys of the lines with names
SCOPE_END = "EOF"
STARTS_NUMBER = re.compile(r"[-+.,]?[\d.,]")
FORM = re.compile(r"[-+]?\d*([.,]\d*)?([eE][-+]?\d*)?$")


class Line(NamedTuple):
    """A line of a file with its fields."""

    number: int
    text: str
    cells: list[str]


@dataclass
class Section:
    """Rows of a table with the same columns, which follow each other in a file."""

    dialect: Dialect
    kinds: list[str]
    widths: tuple[int, int]  # number of fields of a row without and with remarks at its end
    header: list[Line]  # lines above the first row
    groups: frozenset[int]  # first columns of those groups that may end before other groups
    rows: int = 0
    width: int = 0  # number of fields of the last row
    widest: int = 0  # largest number of fields of a row, with remarks at its end
    first_line: int = 0
    last_line: int = 0
    last: list[str] = field(default_factory=list)  # fields of the last row
    samples: list[list[str]] = field(default_factory=list)  # fields of the first rows
    skipped: list[Line] = field(default_factory=list)  # lines inside the section that are no rows
    # (row, line number) of each row that does not stand below the row before it
    starts: list[tuple[int, int]] = field(default_factory=list)
    # numbers of the lines in the section that contain only separators
    blanks: set[int] = field(default_factory=set)
    doubt: str = ""  # what is wrong with the last row if the file was cut off

    def __post_init__(self) -> None:
        self.kinds += [EMPTY] * (self.widths[1] - len(self.kinds))
        #: places of the columns that decide whether a line is a row
        self.checked = [k for k, kind in enumerate(self.kinds) if kind in (NUMBER, CLOCK)]
        #: number of fields up to the last of these columns
        self.core = self.checked[-1] + 1 if self.checked else 0
        #: places of columns that are empty in the first rows
        self.empty = [k for k, kind in enumerate(self.kinds) if kind == EMPTY]
        named = {k for line in self.header[-4:] for k, cell in enumerate(line.cells) if cell}
        #: those of them that have no name
        self.unnamed = [k for k in self.empty if k not in named]
        last = self.header[-1].cells if self.header else []
        #: fields of the line of the names, if these are numbers
        self.counted = last if is_count(last) else None

    def is_row(self, cells: Sequence[str]) -> bool:
        """Returns True if a line with these fields is a row of the section."""
        least, most = self.widths
        if cells == self.counted:
            return False
        if len(cells) > most or (len(cells) < least and len(cells) not in self.groups):
            return False
        if any(STARTS_NUMBER.match(cell) for cell in cells[least:]) or "" in cells[least:]:
            return False  # only remarks may follow the last column
        if any(
            cells[k] and (k < self.checked[0] or STARTS_NUMBER.match(cells[k]))
            for k in (self.unnamed if len(cells) == least else self.empty) if k < len(cells)
        ):  # fmt: skip
            return False
        numbers = texts = 0
        for place in self.checked:
            cell = cells[place] if place < len(cells) else ""
            is_first = place == self.checked[0]
            if _is_number(cell, self.dialect) or clock.is_clock(cell):
                if is_first:
                    return True
                numbers += 1
            elif not is_missing(cell):
                if is_first:
                    return False
                texts += 1
        return numbers > texts

    def is_damaged_row(self, cells: Sequence[str]) -> bool:
        """Returns True if a line that is no row of the section may be one of its rows that was
        damaged: it begins with a number, or with a word for none."""
        first = next((cell for cell in cells if cell), "")
        is_none = is_missing(first) and first[:1].isalpha()
        return is_none or _is_number(first, self.dialect) or clock.is_clock(first)

    def has_numbers(self, line: Line) -> bool:
        """Returns True if a line has numbers where rows have them."""
        cells = [line.cells[place] for place in self.checked if place < len(line.cells)]
        return any(_is_number(cell, self.dialect) for cell in cells)

    def add(self, number: int, cells: list[str]) -> None:
        """Adds the line with a number in the file as the next row."""
        if not self.rows or number != self.last_line + 1:
            self.starts.append((self.rows, number))
        self.first_line = self.first_line or number
        self.last_line, self.width, self.last = number, len(cells), cells
        self.widest = max(self.widest, len(cells))
        self.rows += 1
        if len(self.samples) < KEPT_ROWS:
            self.samples.append(cells)

    def takes(self, first: int, text: str) -> bool:
        """Adds all lines of a text as rows, if they are without doubt rows. `first`: number of the
        first line. Returns False, and adds nothing, otherwise."""
        count = text.count("\n")
        dense = [k for k in self.checked if self.kinds[k] == NUMBER]
        places = [*(k for k in self.unnamed if k < self.width), *dense]
        found = numbers_of(text, self.dialect, self.width, places)
        if found is None or not count or not text.endswith("\n"):
            return False
        empty, first_numbers = found[: -len(dense)], found[-len(dense)]
        if first_numbers.null_count or any(column.null_count < count for column in empty):
            return False
        if first != self.last_line + 1:
            self.starts.append((self.rows, first))
        self.rows += count
        self.last_line = first + count - 1
        self.last = self.dialect.cells(text[text.rfind("\n", 0, -1) + 1 : -1])
        return True

    def remove_last(self, line: Line) -> None:
        """Takes the last row out of the section. `line`: its line."""
        self.rows -= 1
        self.skipped.append(line)

    def line_of(self, row: int) -> int:
        """Returns the number of the line of a row."""
        start, line = self.starts[bisect.bisect_right(self.starts, (row, 1 << 62)) - 1]
        return line + row - start

    def append(self, other: "Section") -> None:
        """Appends the rows of a section that continues this section."""
        self.starts += [(self.rows + row, line) for row, line in other.starts]
        self.skipped += [*other.header, *other.skipped]
        self.blanks |= other.blanks
        self.rows += other.rows
        self.last_line, self.last, self.doubt = other.last_line, other.last, other.doubt

    def texts(self, path: Path) -> Iterator[tuple[int, int, str]]:
        """Yields (index of the first row, number of rows, text) of blocks of rows, without all
        lines that are no rows."""
        skipped, row = {*(line.number for line in self.skipped), *self.blanks}, 0
        for first, text in self.dialect.blocks(path):
            end = first + text.count("\n") + (not text.endswith("\n"))
            if end <= self.first_line or row >= self.rows:
                continue
            inside = first >= self.first_line and end - 1 <= self.last_line
            if not (inside and "\n\n" not in f"\n{text}" and skipped.isdisjoint(range(first, end))):
                lines = [
                    line for number, line in enumerate(text.split("\n"), first)
                    if self.first_line <= number <= self.last_line and number not in skipped
                    and line.strip()
                ]  # fmt: skip
                text = "\n".join(lines) + "\n" if lines else ""
            count = text.count("\n") + (not text.endswith("\n") and bool(text))
            if count:
                yield row, count, text
                row += count


def _is_number(text: str, dialect: Dialect) -> bool:
    if NUMBERS[dialect.decimal].match(text):
        return True
    value = None if is_missing(text) else dialect.value(text)
    return value is not None


def is_count(cells: Sequence[str]) -> bool:
    """Returns True if the fields of a line are the numbers of the columns, which some programs
    write instead of names, and nothing above the first column."""
    numbers = [str(k) for k in range(len(cells))]
    return len(cells) > 1 and not cells[0] and list(cells[1:]) in (numbers[:-1], numbers[1:])


def _is_damaged(cells: Sequence[str], dialect: Dialect) -> bool:
    """Returns True if a line directly above the rows may be a row that was damaged."""
    known = [cell for cell in cells if cell]
    numbers = sum(_is_number(cell, dialect) for cell in known)
    return len(known) > 1 and _is_number(known[0], dialect) and 2 * numbers >= len(known)


def numbers_of(
    text: str, dialect: Dialect, width: int, places: Sequence[int], kind: str = "float64"
) -> "list[pyarrow.Array] | None":
    """Reads columns of a text of whole rows quickly, as numbers of `kind`. Returns None if any row
    needs a closer look: another number of fields, an empty line or a text in one of the columns."""
    import pyarrow
    from pyarrow import csv

    if "\n\n" in f"\n{text}":
        return None
    if dialect.separator == " ":
        text = "\n".join(" ".join(dialect.cells(line)) for line in text.split("\n"))
    data = text.encode()
    types = {"float64": pyarrow.float64(), "exact": pyarrow.decimal128(*EXACT_DIGITS)}
    wanted = [str(place) for place in places]
    try:
        table = csv.read_csv(
            pyarrow.BufferReader(data),
            csv.ReadOptions(
                use_threads=False, block_size=len(data) + 1,
                column_names=[str(place) for place in range(width)],
            ),
            csv.ParseOptions(delimiter=dialect.separator, ignore_empty_lines=False),
            csv.ConvertOptions(
                column_types=dict.fromkeys(wanted, types[kind]),
                include_columns=wanted, decimal_point=dialect.decimal, check_utf8=False,
                null_values=["", "nan", "NaN", "NAN", "-", "---", "null", "NULL", "n/a", "N/A"],
                strings_can_be_null=False,
            ),
        )  # fmt: skip
    except (pyarrow.ArrowInvalid, pyarrow.ArrowKeyError, pyarrow.ArrowNotImplementedError):
        return None
    count = text.count("\n") + (not text.endswith("\n"))
    if table.num_rows != count:
        return None
    return [table.column(name).combine_chunks() for name in wanted]


def differences(numbers: "pyarrow.Array", base: Decimal) -> Floats:
    """Returns decimals minus `base` as numbers, and NaN where there is none."""
    import pyarrow
    from pyarrow import compute

    steps = compute.subtract(numbers, pyarrow.scalar(base, pyarrow.decimal128(*EXACT_DIGITS)))
    return floats_of(compute.cast(steps, pyarrow.float64()))


def floats_of(numbers: "pyarrow.Array") -> Floats:
    """Returns numbers as an array, and NaN where there is none. `to_numpy` would load Pandas where
    it is installed, which takes a second and as much memory as a million samples."""
    from pyarrow import compute

    known = compute.fill_null(numbers, np.nan) if numbers.null_count else numbers
    return np.frombuffer(known.buffers()[1], np.float64, len(known), 8 * known.offset)


def kind_of(cells: Sequence[str], dialect: Dialect) -> str:
    """Returns the kind of a column with these fields. A column of numbers or clock times has them
    in at least half of its rows."""
    known = [cell for cell in cells if not is_missing(cell)]
    if not known:
        return EMPTY
    for kind, is_kind in (
        (NUMBER, lambda cell: _is_number(cell, dialect)),
        (CLOCK, clock.is_clock),
    ):
        if all(map(is_kind, known)):
            return kind if 2 * len(known) >= len(cells) else TEXT
    return TEXT


class _Scan:
    """The search for sections in the lines of a file. `least`: number of successive lines that are
    needed for a begin. `takes_keys`: whether the first column of a section may have another text in
    each of its rows, as lists of parameters have."""

    def __init__(self, where: str, dialect: Dialect, least: int, takes_keys: bool) -> None:
        self._where, self._dialect = where, dialect
        self._least, self._takes_keys = least, takes_keys
        self._between: deque[Line] = deque(maxlen=KEPT_LINES)  # lines below the last row
        self.sections: list[Section] = []
        self.line_end = True  # the last line has an end

    def read(self, path: Path) -> None:
        """Reads all lines of a file. Raises InputError."""
        for first, text in self._dialect.blocks(path):
            self.line_end = text.endswith("\n")
            if self._takes(first, text):
                continue
            lines = text.split("\n")
            for at in range(0, len(lines), QUICK_LINES):
                some = lines[at : at + QUICK_LINES]
                if not self._takes(first + at, "\n".join([*some, ""])):
                    for number, line in enumerate(some, first + at):
                        self._read(number, line)
        self._close()

    def _takes(self, first: int, text: str) -> bool:
        is_inside = bool(self.sections) and not self._between
        return is_inside and self.sections[-1].takes(first, text)

    def _read(self, number: int, text: str) -> None:
        cells = self._dialect.cells(text)
        section = self.sections[-1] if self.sections else None
        if not any(cells):
            if section is not None and text.strip():
                section.blanks.add(number)
            return
        if section is not None and section.is_row(cells):
            if self._between:
                self._resume(section)
            self.sections[-1].add(number, cells)
            return
        self._between.append(Line(number, text, cells))
        if len(self._between) >= self._least:
            self._begin()

    def _begin(self) -> None:
        """Begins a section, if the last lines are its first rows."""
        lines = [self._between[k] for k in range(-self._least, 0)]
        if not any(_is_number(cell, self._dialect) for cell in lines[-1].cells):
            return
        width = len(lines[-1].cells)
        if any(len(line.cells) != width for line in lines):
            return
        table = [line.cells for line in lines]
        if self._names_by_count(lines, 0):
            return
        kinds = [kind_of(column, self._dialect) for column in zip(*table, strict=True)]
        if NUMBER not in kinds or not (self._takes_keys or not _are_keys(table, kinds)):
            return
        section = self._section(list(self._between), kinds)
        if not all(section.is_row(line.cells) for line in lines):
            return
        rows = list(self._between)[len(section.header) :]
        if self.sections:
            self._expect_undamaged(self.sections[-1], section.header or rows)
        is_damaged = bool(section.header) and section.counted is None
        if is_damaged and _is_damaged(section.header[-1].cells, self._dialect):
            raise self._damage(section, section.header[-1])
        self.sections.append(section)
        self._between.clear()
        for line in rows:
            self._read(line.number, line.text)

    def _section(self, lines: Sequence[Line], kinds: Sequence[str]) -> Section:
        """Returns an empty section for lines of which the first ones are its header. The line of
        the names may have more fields than the rows, whose remarks may be missing."""
        groups, width, header = _groups_of(lines), len(kinds), list[Line]()
        most = width
        for _ in range(3):
            section = Section(self._dialect, list(kinds), (width, most), header, groups)
            first = next(
                (
                    k for k, line in enumerate(lines)
                    if section.is_row(line.cells) and not self._names_by_count(lines, k)
                ),
                None,
            )  # fmt: skip
            header = list(lines[:first])
            if self._dialect.separator == " ":  # the names may have blanks
                continue
            names = [line for line in header if not section.is_damaged_row(line.cells)]
            filled = [k + 1 for k, cell in enumerate(names[-1].cells) if cell] if names else []
            most = max([width, *filled])
        return Section(self._dialect, list(kinds), (width, most), header, groups)

    def _names_by_count(self, lines: Sequence[Line], place: int) -> bool:
        """Returns True if a line has the numbers of the columns above rows with a number in the
        first column."""
        below = lines[place + 1].cells if place + 1 < len(lines) else []
        return (
            bool(below)
            and is_count(lines[place].cells)
            and len(below) == len(lines[place].cells)
            and _is_number(below[0], self._dialect)
        )

    def _resume(self, section: Section) -> None:
        """Continues a section below lines that are no rows, or begins another one there, if these
        lines are a header."""
        lines = list(self._between)
        self._between.clear()
        others = [line for line in lines if line.cells != section.counted]
        for line in others:
            if section.is_damaged_row(line.cells):
                raise self._damage(section, line)
        if len(lines) == len(others) == 1:
            self._expect_remark(section, lines[0])
        known = {line.text.strip() for line in section.header}
        is_header = any(
            line.text.strip() in known or sum(map(bool, line.cells)) >= max(2, section.core)
            for line in lines
        )
        if section.core == 1 and not is_header:
            raise InputError(
                f"{self._where}: line {lines[0].number}: expected a number, got "
                f"{lines[0].text.strip()[:40]!r}; correct or remove this line"
            )
        if is_header or len(lines) > 1:
            widths, groups = section.widths, section.groups
            self.sections.append(Section(self._dialect, section.kinds[:], widths, lines, groups))
            return
        section.skipped += lines
        if len(section.skipped) > SKIPPED_MOST:
            raise InputError(
                f"{self._where}: line {lines[0].number}: expected a row as in line "
                f"{section.first_line}, as {SKIPPED_MOST} lines before were no rows either; export "
                "the data as a table"
            )

    def _expect_remark(self, section: Section, line: Line) -> None:
        """Raises InputError if a line between two rows has numbers where rows have them."""
        cells = [line.cells[place] for place in section.checked if place < len(line.cells)]
        numbers = sum(_is_number(cell, self._dialect) for cell in cells)
        if numbers and 2 * numbers >= len(cells) - 1:
            first = line.cells[section.checked[0]]
            raise InputError(
                f"{self._where}: line {line.number}: expected a number as in line "
                f"{section.first_line}, got {first[:40]!r}; correct or remove this line"
            )

    def _expect_undamaged(self, section: Section, lines: Sequence[Line]) -> None:
        """Raises InputError if the first of the lines below a section is a damaged row."""
        if lines and section.is_damaged_row(lines[0].cells):
            raise self._damage(section, lines[0])

    def _damage(self, section: Section, line: Line, is_last: bool = False) -> InputError:
        cut = ", perhaps because the file was cut off" * is_last
        return InputError(
            f"{self._where}: line {line.number}: expected {section.width} fields as in line "
            f"{section.first_line}, separated by {self._dialect.separator_name()}, got "
            f"{len(line.cells)}{cut}; correct or remove this line"
        )

    def _close(self) -> None:
        """Names the lines below the last section, and its last row if it was cut off."""
        if not self.sections:
            return
        section, lines = self.sections[-1], list(self._between)
        if lines and section.is_damaged_row(lines[0].cells):
            raise self._damage(section, lines[0], len(lines) == 1)
        if not lines and not self.line_end and (is_cut := _cut(section)) is not False:
            text = self._dialect.separator.join(section.last)
            if is_cut:
                section.remove_last(Line(section.last_line, f"{text} (cut off)", section.last))
            else:
                section.doubt = (
                    f"line {section.last_line}, the last one, has no line end; if the file was cut "
                    f"off there, its last field {section.last[-1]} is wrong"
                )
        section.skipped += [line for line in lines if line.cells[0] != SCOPE_END]


def _groups_of(lines: Sequence[Line]) -> frozenset[int]:
    """Returns the places at which groups of columns begin, in an export of TwinCAT Scope: each one
    repeats the key of the line."""
    named = [line.cells for line in lines if line.cells[0] in SCOPE_NAMES]
    cells = max(named, key=lambda cells: cells.count(cells[0]), default=[])
    return frozenset(k for k, cell in enumerate(cells) if k and cell == cells[0])


def _are_keys(table: Sequence[Sequence[str]], kinds: Sequence[str]) -> bool:
    """Returns True if lines look like a list of parameters: the first field of each is another
    text."""
    if kinds[0] != TEXT:
        return False
    texts = [row[0] for row in table if row[0]]
    return len(texts) == len(table) and len(set(texts)) == len(texts)


def _form_of(text: str) -> tuple[int, int] | None:
    """Returns (length of the decimals, length of the exponent) of a number, or None."""
    found = FORM.match(text)
    return (len(found[1] or ""), len(found[2] or "")) if found else None


def _cut(section: Section) -> bool | None:
    """Returns True if the last number of the last row has another form than all others in its
    column, so that it was cut off, False if it has the same form, and None if this says nothing."""
    place = len(section.last) - 1
    others = {_form_of(row[place]) for row in section.samples[:-1] if place < len(row)}
    form = _form_of(section.last[place])
    if section.kinds[place] != NUMBER or len(others) != 1 or others & {(0, 0), None}:
        return None
    return form not in others


def sections_of(path: Path, dialect: Dialect, where: str) -> list[Section]:
    """Returns the sections of a text table in their order. `where`: name of the table in messages.
    Raises InputError."""
    for least in LEAST_ROWS:
        for takes_keys in (False, True):
            scan = _Scan(where, dialect, least, takes_keys)
            scan.read(path)
            if scan.sections:
                return scan.sections
    raise InputError(f"{where}: expected rows of numbers, got none; export the data as CSV")


def text_of(lines: Sequence[Line]) -> str:
    """Returns lines as text for messages, such as "lines 3 to 5"."""
    numbers = [line.number for line in lines]
    if len(numbers) == 1:
        return f"line {numbers[0]}"
    return f"lines {numbers[0]} to {numbers[-1]}"
