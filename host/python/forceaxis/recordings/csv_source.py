"""CSV files of any dialect as sources of recordings.

The dialect is found from the numbers in the file. It consists of the character between the columns,
the decimal sign, the lines before the first row of numbers, and the units in these lines. An export
of TwinCAT Scope has lines `SymbolName`, `Unit` and so on. Each of its groups of columns begins with
a column of times in ms.
"""

import datetime
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.recordings.signal_recording import Floats
from forceaxis.recordings.source import Source, SourceColumn, expect_finite
from forceaxis.recordings.units import is_unit, split_name

SEPARATORS = ("\t", ";", ",", "|", " ")
SEPARATOR_NAMES = {"\t": "tab", " ": "blank"}
# Forms of a number: with a decimal point (POINT), and with a decimal comma (COMMA).
POINT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?$")
COMMA = re.compile(r"[-+]?(\d+,?\d*|,\d+)([eEdD][-+]?\d+)?$")
PLAIN = re.compile(r"[-+.0-9eE]*")
MISSING = ("", "nan", "-nan", "null", "none", "na", "n/a", "-", "---", "#n/a")
PROBED_LINES = 400  # number of lines at the start of a file from which the dialect is determined
SCOPE_ROWS = ("SymbolName", "Name", "Unit", "SampleTime[ms]", "Data-Type")
SCOPE_END = "EOF"
SHOWN = 40  # largest number of characters that a message shows of a text that is not a number


@dataclass(frozen=True)
class CsvDialect:
    """The dialect of a CSV file: separator, decimal sign, and number of columns of its rows."""

    separator: str
    decimal: str  # decimal sign: "." or ","
    first: int  # index of the first line of the file that is a row of numbers
    width: int  # number of columns of a row

    def cells(self, line: str) -> list[str]:
        """Returns the texts of the fields of a line, which is split by the rules of this
        dialect."""
        return _without_end(split(line, self.separator), self.width)


def split(line: str, separator: str) -> list[str]:
    """Returns the fields of a line of a CSV file, without blanks and quotes around them."""
    if separator == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    pattern = rf'(?:^|{re.escape(separator)})\s*("(?:[^"]|"")*"|[^{re.escape(separator)}]*)'
    return [cell.strip().strip('"').replace('""', '"') for cell in re.findall(pattern, line)]


def is_number(text: str, decimal: str) -> bool:
    """Returns True if a text is a number with the decimal sign `decimal`, or is a date and time."""
    return bool((POINT if decimal == "." else COMMA).match(text)) or instant(text) is not None


def instant(text: str) -> float | None:
    """Converts a date with a time, or a time of the day, to seconds. Returns None for another
    text."""
    if ":" not in text:
        return None
    try:
        if len(text) > 15 and text[4] == "-":
            at = datetime.datetime.fromisoformat(text.replace("Z", "+00:00"))
            zone = at.tzinfo or datetime.UTC
            return at.replace(tzinfo=zone).timestamp()
        clock = datetime.time.fromisoformat(text)
    except ValueError:
        return None
    return 3600.0 * clock.hour + 60 * clock.minute + clock.second + clock.microsecond * 1e-6


def _value(text: str, decimal: str) -> float | None:
    """Returns the number that a field contains, NaN for an empty field, or None for another
    text."""
    if text.casefold() in MISSING:
        return float("nan")
    if (POINT if decimal == "." else COMMA).match(text):
        return float(text.replace(",", ".").replace("d", "e").replace("D", "e"))
    return instant(text)


def _without_end(cells: list[str], width: int) -> list[str]:
    """Returns the fields of a line, without the empty fields that a separator at the end of the
    line causes."""
    while len(cells) > max(width, 1) and not cells[-1]:
        cells.pop()
    return cells


def _numbers_in(cells: list[str], decimal: str) -> int:
    """Returns how many fields of a line are numbers. Returns 0 if any field contains another
    text."""
    good = sum(is_number(cell, decimal) for cell in cells)
    missing = sum(cell.casefold() in MISSING for cell in cells)
    return good if good + missing == len(cells) else 0


def _run(lines: list[str], separator: str, decimal: str) -> tuple[int, int]:
    """Searches for the longest block of lines with the same number of fields, in which all fields
    are numbers or empty. Returns (number of numbers, number of columns) of this block."""
    best = (0, 0)
    width, numbers = 0, 0
    for line in lines:
        cells = _without_end(split(line, separator), width)
        found = _numbers_in(cells, decimal)
        if not found or len(cells) != width:
            width, numbers = len(cells), 0
        numbers += found
        best = max(best, (numbers, width))
    return best


def dialect_of(lines: list[str], where: str, separator: str | None = None) -> CsvDialect:
    """Returns the dialect of a CSV file from its lines. Raises InputError."""
    probed = lines[:PROBED_LINES]
    found = [
        (*_run(probed, mark, decimal), mark, decimal)
        for mark in ([separator] if separator else SEPARATORS)
        for decimal in (".", ",")
        if mark != decimal
    ]
    # The dialect that gives most numbers is selected; among equals, that with most columns.
    numbers, width, mark, decimal = max(found, key=lambda one: one[:2])
    if numbers < 2:
        raise InputError(
            f"{where}: expected rows of numbers within the first {PROBED_LINES} lines, got none; "
            "export the data as CSV"
        )
    # The first row of numbers may be above the longest block of rows.
    # A wrong row between them is then reported as an error.
    first = next(
        index
        for index, line in enumerate(probed)
        if len(cells := _without_end(split(line, mark), width)) == width
        and _numbers_in(cells, decimal)
    )
    header = split(lines[first - 1], mark) if first else []
    if mark == "," and decimal == "." and header and width == 2 * len(header) > 2:
        raise InputError(
            f"{where}: line {first + 1}: expected {len(header)} columns as in the line above, got "
            f"{width}; if the numbers have decimal commas, export the file with semicolons "
            "between the columns"
        )
    return CsvDialect(mark, decimal, first, width)


@dataclass(frozen=True)
class _Header:
    """The header of a CSV file: names and units of the columns, and for each column the index of
    the time column that belongs to it."""

    names: list[str]
    units: list[str | None]
    times: list[int | None]
    kind: str
    ends: tuple[str, ...] = field(default=())


def _scope_header(rows: dict[str, list[str]]) -> _Header:
    """Returns the header of a file that TwinCAT Scope has exported. `rows`: {key: fields} of the
    first lines of the file."""
    texts = rows.get("SymbolName") or rows["Name"]
    key = "SymbolName" if "SymbolName" in rows else "Name"
    units = rows.get("Unit", [])
    found = _Header([], [], [], "TwinCAT Scope", (SCOPE_END,))
    time = 0
    for place, text in enumerate(texts):
        is_time = text == key or place == 0
        time = place if is_time else time
        group = "" if time == 0 else f" of {texts[time + 1] if time + 1 < len(texts) else place}"
        unit = units[place].strip("()[] ") if place < len(units) else ""
        found.names.append(f"time{group}" if is_time else text)
        found.units.append("ms" if is_time else (unit if unit not in ("", "None") else None))
        found.times.append(None if is_time else time)
    return found


def _header(lines: list[str], dialect: CsvDialect) -> _Header:
    """Returns the header of a CSV file from the lines above the first row of numbers."""
    above = [dialect.cells(line.lstrip("#% ")) for line in lines[: dialect.first]]
    rows: dict[str, list[str]] = {}
    for cells in above:
        if cells and cells[0] in SCOPE_ROWS and len(cells) == dialect.width:
            # the export has two rows `Name`; the first one contains the name of the file
            rows[cells[0]] = cells
    if {"Name", "SymbolName"} & set(rows):
        return _scope_header(rows)
    wide = [cells for cells in above if len(cells) == dialect.width and any(cells)]
    while wide and all(_value(cell, dialect.decimal) is not None for cell in wide[-1]):
        wide.pop()
    if not wide:
        return _Header(
            [f"column {place + 1}" for place in range(dialect.width)],
            [None] * dialect.width, [None] * dialect.width, "CSV",
        )  # fmt: skip
    texts, units = wide[-1], None
    if len(wide) > 1 and all(is_unit(text.strip("[]()")) for text in texts):
        texts, units = wide[-2], [text.strip("[]() ") for text in wide[-1]]
    names, given = [], []
    for place, text in enumerate(texts):
        name, unit = split_name(text)
        names.append(name or f"column {place + 1}")
        given.append(units[place] if units else unit)
    # If a column name occurs twice in the header, the number of the column is added to it.
    names = [f"{n} {i + 1}" if names.count(n) > 1 else n for i, n in enumerate(names)]
    return _Header(names, given, [None] * dialect.width, "CSV")


class CsvSource(Source):
    """A CSV file as a source of recordings. The fields of a column are converted to numbers only
    when the column is requested. Columns that are not requested may therefore contain texts."""

    def __init__(self, path: Path, separator: str | None = None) -> None:
        self.where = paths.display(path)
        self._lines = _text(path, self.where).splitlines()
        self._dialect = dialect_of(self._lines, self.where, separator)
        self._header = _header(self._lines, self._dialect)
        decimal = " with decimal commas" if self._dialect.decimal == "," else ""
        self.kind = self._header.kind + decimal
        self._rows, self._numbers = self._split_rows()

    def _split_rows(self) -> tuple[list[list[str]], list[int]]:
        """Splits the lines of a file into fields. Returns (fields of each row, line number of each
        row). Raises InputError for a row with another number of fields."""
        rows, numbers = [], []
        first, width = self._dialect.first, self._dialect.width
        for number, line in enumerate(self._lines[first:], first + 1):
            cells = self._dialect.cells(line)
            if not any(cells):
                continue
            if cells[0] in self._header.ends:
                break
            # Columns with a lower sampling rate have ended before this row.
            if self._header.ends and len(cells) < width:
                cells += [""] * (width - len(cells))
            if len(cells) != width:
                mark = SEPARATOR_NAMES.get(self._dialect.separator, self._dialect.separator)
                cut = ", perhaps because the file was cut off" * (number == len(self._lines))
                raise InputError(
                    f"{self.where}: line {number}: expected {width} fields as in line {first + 1}, "
                    f"separated by {mark!r}, got {len(cells)}{cut}; correct or remove this line"
                )
            rows.append(cells)
            numbers.append(number)
        return rows, numbers

    def names(self) -> list[str]:
        return self._header.names

    def time_name(self) -> str | None:
        return super().time_name() if self._header.kind == "CSV" else self._header.names[0]

    def _number(self, name: str, index: int, text: str) -> float:
        """Returns the number that a field contains, or NaN for an empty field. Raises InputError
        for another text."""
        decimal = self._dialect.decimal
        value = _value(text, decimal)
        if value is not None:
            return value
        hint = "a decimal point" if decimal == "." else "a decimal comma"
        shown = text if len(text) <= SHOWN else text[:SHOWN] + "..."
        raise InputError(
            f"{self.where}: line {self._numbers[index]}, {name}: expected a number with {hint} as "
            f"in line {self._dialect.first + 1}, got {shown!r}; correct this field, or leave it "
            "empty for a missing sample"
        )

    def column(self, name: str) -> SourceColumn:
        place = self._header.names.index(name)
        texts = [row[place] for row in self._rows]
        values = _quick(texts)
        if values is None:
            values = np.array([self._number(name, i, text) for i, text in enumerate(texts)])
        time = self._header.times[place]
        return expect_finite(
            self.where,
            SourceColumn(
                name, self._header.units[place], values, self._numbers,
                None if time is None else self._header.names[time],
            ),
        )  # fmt: skip


def _quick(texts: list[str]) -> Floats | None:
    """Converts fields to numbers quickly, if they contain only digits, signs, points and exponents.
    Returns None if a field contains another character."""
    if PLAIN.fullmatch("".join(texts)) is None:
        return None
    try:
        return np.array(texts, dtype=np.float64)
    except ValueError:
        return None


def _text(path: Path, where: str) -> str:
    """Returns the text of a file that is encoded in UTF-8, in UTF-16 with a byte order mark, or in
    Windows-1252. Raises InputError."""
    data = path.read_bytes()
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        if encoding == "utf-16":
            raise InputError(
                f"{where}: expected text in UTF-16, as the first bytes of the file announce, got "
                "bytes that are no UTF-16; the file may be cut off; export it again"
            ) from None
        text = data.decode("cp1252", errors="replace")
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise InputError(
            f"{where}: line {line}: expected text, got a byte with the value 0; the file is "
            "damaged or is no CSV file"
        )
    return text
