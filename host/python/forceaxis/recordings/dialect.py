"""Dialects of text tables: encoding, line ends, separator, quotes and decimal sign.

A dialect is found from lines of the whole file, because a table may begin anywhere in it. The lines
are read in blocks, so that a long file never is in the memory as a whole.
"""

import codecs
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.recordings import clock

SEPARATORS = ("\t", ";", ",", "|", " ", ":")
SEPARATOR_NAMES = {"\t": "tab", " ": "blank"}
# Forms of a number: with a decimal point, and with a decimal comma.
NUMBERS = {
    ".": re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?$"),
    ",": re.compile(r"[-+]?(\d+,?\d*|,\d+)([eEdD][-+]?\d+)?$"),
}
HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]{1,12}$")
SWITCHES = {"true": 1.0, "false": 0.0}
MISSING = ("", "nan", "-nan", "null", "none", "na", "n/a", "-", "--", "---", "#n/a")
# Words with which a program states that a converter was outside its range. The field has no number.
OVER_RANGE = ("∞", "+∞", "-∞", "inf", "+inf", "-inf", "infinity", "-infinity", "ovld", "overflow")
# A number beside another number in one field: the field was split by the wrong character.
JOINED = re.compile(r"\d\"?\s*[;,|\t :]\s*\"?[-+.\d]")
# Digits in groups of three: a number with separators of thousands, or one with three decimals.
GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}(?:[.,' ]\d{3})+(?:[.,]\d+)?$")
MINUS = "\u2212"  # the sign of typesetting, which some programs write
# Names of encodings that a file announces by its first bytes.
MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
BLOCK_BYTES = 1 << 22  # size of the blocks in which a file is read
HEAD_LINES, WINDOWS, WINDOW_LINES = 1500, 24, 40  # lines from which the dialect is found


@dataclass(frozen=True)
class Dialect:
    """The rules by which the lines of a text table are read. `decimal`: "." or ","."""

    encoding: str
    separator: str
    decimal: str
    line_end: str = "\n"

    def cells(self, line: str) -> list[str]:
        """Returns the texts of the fields of a line, without blanks and quotes around them."""
        if self.separator == " ":
            return [cell for cell in line.split(" ") if cell.strip()]
        if '"' not in line:
            return [cell.strip() for cell in line.split(self.separator)]
        return _quoted_cells(line, self.separator)

    def value(self, text: str) -> float | None:
        """Returns the number that a field contains, NaN for a field without a number, or None for
        another text. TRUE and FALSE are 1 and 0, and 0x0637 is a number too."""
        if NUMBERS[self.decimal].match(text):
            return float(text.replace(",", ".").replace("d", "e").replace("D", "e"))
        small = text.casefold()
        if small in MISSING or small in OVER_RANGE:
            return float("nan")
        if HEXADECIMAL.match(text):
            return float(int(text, 16))
        return SWITCHES.get(small)

    def has_sure_decimals(self, text: str) -> bool:
        """Returns True if a number has decimals for sure, and no separator of thousands instead of
        a decimal sign."""
        is_number = self.decimal in text and bool(NUMBERS[self.decimal].match(text))
        return is_number and not GROUPED.match(text)

    def separator_name(self) -> str:
        """Returns the separator as text for messages."""
        return repr(SEPARATOR_NAMES.get(self.separator, self.separator))

    def blocks(self, path: Path) -> Iterator[tuple[int, str]]:
        """Yields (number of the first line, text) of blocks of whole lines. Each line of a text
        ends with a line feed, except perhaps the last one of the file. Raises InputError, if the
        file contains a byte 0 in its text."""
        first = 1
        for text in _decoded(path, self.encoding, self.line_end):
            if "\0" in text:
                line = first + text.count("\n", 0, text.index("\0"))
                raise InputError(
                    f"{paths.display(path)}: line {line}: expected text, got a byte with the value "
                    "0; the file is damaged or is no CSV file"
                )
            yield first, text
            first += text.count("\n")


def is_missing(text: str) -> bool:
    """Returns True if a field says that it has no number."""
    return text.casefold() in MISSING or text.casefold() in OVER_RANGE


def _quoted_cells(line: str, separator: str) -> list[str]:
    """Returns the fields of a line with quotes. A quote inside quotes is written twice."""
    cells, at, mark = [], 0, re.escape(separator)
    quoted = re.compile(rf'[^\S{mark}]*"((?:[^"]|"")*)"[^\S{mark}]*(?={mark}|$)')
    plain = re.compile(rf"[^{mark}]*")
    while at <= len(line):
        found = quoted.match(line, at)
        if found:
            cells.append(found[1].replace('""', '"').strip())
        else:
            found = plain.match(line, at)
            assert found is not None  # the pattern also matches an empty text
            cells.append(found[0].strip().strip('"'))
        at = found.end() + 1
    return cells


def _decoded(path: Path, encoding: str, line_end: str) -> Iterator[str]:
    """Yields the text of a file in blocks of whole lines, which end with line feeds."""
    decoder = codecs.getincrementaldecoder(encoding)("replace")
    rest = ""
    with path.open("rb") as file:
        while data := file.read(BLOCK_BYTES):
            rest += decoder.decode(data)
            end = rest.rfind(line_end) + 1
            if end:
                yield _with_line_feeds(rest[:end], line_end)
                rest = rest[end:]
    rest += decoder.decode(b"", True)
    if rest:
        yield _with_line_feeds(rest, line_end)


def _with_line_feeds(text: str, line_end: str) -> str:
    if MINUS in text:
        text = text.replace(MINUS, "-")
    if "\r" not in text:
        return text
    if line_end == "\r":
        return text.replace("\r", "\n")
    # Some programs write two carriage returns, where a line was translated twice.
    return text.replace("\r\r\n", "\n").replace("\r\n", "\n")


def _encoding_of(path: Path, where: str) -> str:
    """Returns the encoding of a file: UTF-8, UTF-16, UTF-32, or otherwise Windows-1252. Raises
    InputError."""
    with path.open("rb") as file:
        start = file.read(256)
        file.seek(0)
        encoding = next((name for mark, name in MARKS if start.startswith(mark)), None)
        if encoding is None:
            encoding = _without_mark(start)
        decoder = codecs.getincrementaldecoder(encoding)()
        try:
            while data := file.read(BLOCK_BYTES):
                decoder.decode(data)
            decoder.decode(b"", True)
        except UnicodeDecodeError:
            if encoding.startswith("utf-8"):
                return "cp1252"
            name = encoding.upper()[:6]
            raise InputError(
                f"{where}: expected text in {name}, as the first bytes of the file announce, got "
                f"bytes that are no {name}; the file may be cut off; export it again"
            ) from None
    return encoding


def _without_mark(start: bytes) -> str:
    """Returns the encoding of a file without a mark, from its first bytes."""
    even, odd = start[0::2], start[1::2]
    if len(start) > 8 and odd.count(0) > 0.8 * len(odd) and not even.count(0):
        return "utf-16-le"
    if len(start) > 8 and even.count(0) > 0.8 * len(even) and not odd.count(0):
        return "utf-16-be"
    return "utf-8"


def is_text(start: bytes) -> bool:
    """Returns True if a file with these first bytes may be a text."""
    marked = any(start.startswith(mark) for mark, _ in MARKS)
    return marked or b"\0" not in start or _without_mark(start) != "utf-8"


def _samples(path: Path, encoding: str, line_end: str) -> list[list[str]]:
    """Returns groups of successive lines of a file: its begin, and windows from all of it."""
    size = max(path.stat().st_size, 1)
    groups: list[list[str]] = []
    step, read, due = size / WINDOWS, 0.0, 0.0
    width = 4 if encoding.startswith("utf-32") else 2 if encoding.startswith("utf-16") else 1
    for text in _decoded(path, encoding, line_end):
        lines = text.split("\n")
        if not groups:
            groups.append(lines[:HEAD_LINES])
            lines = lines[HEAD_LINES:]
        share = len(text) * width / max(len(lines), 1)
        for at in range(0, len(lines), WINDOW_LINES):
            if read + at * share >= due:
                groups.append(lines[at : at + WINDOW_LINES])
                due += step
        read += len(text) * width
    return groups


def _score(groups: Sequence[Sequence[str]], dialect: Dialect) -> tuple[float, int]:
    """Returns (score, number of columns) of a dialect. The score is the number of fields that are
    numbers, in successive lines with equally many fields. Fields in which several numbers are
    joined count against the dialect."""
    total, widest = 0.0, (0, 0)
    for lines in groups:
        cells = [dialect.cells(line) for line in lines if line.strip()]
        for _, run in itertools.groupby(map(_without_end, cells), len):
            some = list(run)
            good = sum(_value_of_cells(one, dialect) for one in some)
            firsts = {one[0] for one in some if one and not _is_value(one[0], dialect)}
            # A single line says little, and a list of parameters is no table.
            total += good if len(some) > 1 and len(firsts) < len(some) else 0.1 * good
            if good > 0:
                widest = max(widest, (len(some), len(some[0])))
    return total, widest[1]


def _without_end(cells: list[str]) -> list[str]:
    """Returns the fields of a line, without the empty fields at its end."""
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _is_value(cell: str, dialect: Dialect) -> bool:
    return bool(NUMBERS[dialect.decimal].match(cell)) or clock.is_clock(cell) or not cell


def _value_of_cells(cells: Sequence[str], dialect: Dialect) -> float:
    number, good = NUMBERS[dialect.decimal], 0.0
    for cell in cells:
        if number.match(cell) or clock.is_clock(cell) or GROUPED.match(cell):
            good += 1
        elif JOINED.search(cell):
            good -= 1
    return good


def dialect_of(path: Path, separator: str | None = None) -> Dialect:
    """Returns the dialect of a text table. `separator`: character between the columns, or None to
    find it. Raises InputError."""
    where = paths.display(path)
    if separator is not None and len(separator) != 1:
        raise ParameterError(
            "separator", f"expected one character such as ; between the columns, got {separator!r}"
        )
    encoding = _encoding_of(path, where)
    with path.open("rb") as file:
        head = codecs.getincrementaldecoder(encoding)("replace").decode(file.read(1 << 16))
    line_end = "\n" if "\n" in head or "\r" not in head else "\r"
    groups = _samples(path, encoding, line_end)
    found = [
        (_score(groups, one), -place, one)
        for place, one in enumerate(
            Dialect(encoding, mark, decimal, line_end)
            for mark in ([separator] if separator else SEPARATORS)
            for decimal in (".", ",")  # with commas between the columns, numbers may have quotes
        )
    ]
    # The dialect with most numbers is selected. If two have equally many, more columns decide.
    (score, _), _, best = max(found, key=lambda one: one[:2])
    if score <= 0:
        raise InputError(
            f"{where}: expected rows of numbers separated by tabs, semicolons, commas, bars or "
            "blanks, got none; export the data as CSV"
        )
    return best
