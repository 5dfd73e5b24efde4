"""Workbooks (xlsx) as sources of recordings. Each sheet is written as a text table whose dialect is
known, and is read by the rules of text tables: a row of the sheet is the line with its number."""

import datetime
import tempfile
import warnings
from pathlib import Path
from typing import IO, Any

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.errors import expect_package
from forceaxis.recordings.dialect import Dialect
from forceaxis.recordings.source import Source
from forceaxis.recordings.table import TableSource, tables_in

DIALECT = Dialect("utf-8", "\t", ".")
MOST_ROWS, MOST_COLUMNS = 1 << 20, 1 << 14  # of a sheet, by the format
# Cells with a clock time of 24 hours and more are dates to openpyxl.
ELAPSED_BEGIN, ELAPSED_END = datetime.datetime(1899, 12, 31), datetime.datetime(1900, 3, 1)
# Characters that would end a field or a line of the text table
FIELD_ENDS = str.maketrans(
    {**dict.fromkeys("\t\n\r\v\f\0\x1c\x1d\x1e\x85\u2028\u2029", " "), '"': "'"}
)


def read_workbook(path: Path) -> list[Source]:
    """Returns the sections of rows in all sheets of a workbook. Raises InputError."""
    expect_package(paths.display(path), "openpyxl", "openpyxl", "xlsx")
    import openpyxl

    sources: list[TableSource] = []
    errors: list[InputError] = []
    with (
        files.parsing(path, "a workbook (xlsx)", "save it again, or save the sheet as CSV"),
        path.open("rb") as stream,
        # ignores warnings about names and styles, which are not read
        warnings.catch_warnings(action="ignore"),
    ):
        book = openpyxl.load_workbook(stream, read_only=True, data_only=True)
        for sheet in book.worksheets:
            try:
                sources += _sheet(sheet, f"{paths.display(path)}: sheet {sheet.title}")
            except InputError as error:
                errors.append(error)
    if not sources:
        where = paths.display(path)
        raise errors[0] if errors else InputError(f"{where}: expected a sheet, got none")
    for source in sources:
        source.notes += [f"not imported: {error}" for error in errors]
        source.unread = "; ".join([*filter(None, [source.unread]), *map(str, errors)])
    return [*sources]


def _sheet(sheet: Any, where: str) -> list[TableSource]:
    """Returns the sections of rows in a sheet of openpyxl. `where`: its name in messages. Raises
    InputError."""
    text: IO[str] = tempfile.NamedTemporaryFile("w+", encoding="utf-8", newline="\n", suffix=".tsv")  # noqa: SIM115
    has_times, widths = False, set[int]()
    sheet.reset_dimensions()  # some programs state wrong dimensions of a sheet
    for number, cells in enumerate(sheet.iter_rows(min_row=1, min_col=1, values_only=True), 1):
        if number > MOST_ROWS or len(cells) > MOST_COLUMNS:
            raise ValueError(f"more than {MOST_ROWS} rows or {MOST_COLUMNS} columns")
        has_times |= any(isinstance(cell, datetime.time | datetime.datetime) for cell in cells)
        widths.add(len(cells))
        text.write("\t".join(map(_field, cells)) + "\n")
    if len(widths) > 1:  # a row ends at its last cell with a value
        text = _filled(text, max(widths))
    text.flush()
    found = tables_in(Path(text.name), DIALECT, where)
    for source in found:
        source.file, source.kind = text, "xlsx"
        source.notes[0] = f"sheet {sheet.title}: {source.notes[0]}"
        if has_times:
            source.notes.append("clock times and dates of cells are those of the sheet to 1 ms")
    return found


def _filled(text: IO[str], width: int) -> IO[str]:
    """Returns a text table in which each row has `width` fields."""
    filled = tempfile.NamedTemporaryFile("w+", encoding="utf-8", newline="\n", suffix=".tsv")  # noqa: SIM115
    text.seek(0)
    for line in text:
        filled.write(line[:-1] + "\t" * (width - 1 - line.count("\t")) + "\n")
    return filled


def _field(cell: object) -> str:
    """Returns the field of a text table for a cell. A number has all of its digits, and an exponent
    by which its point is a decimal sign for sure."""
    if cell is None:
        return ""
    if isinstance(cell, float):
        text = repr(cell)
        return text if "e" in text or not text[-1].isdecimal() else f"{text}e0"
    if isinstance(cell, datetime.datetime) and cell < ELAPSED_END:  # a clock time of 24 h and more
        cell -= ELAPSED_BEGIN
    if isinstance(cell, datetime.timedelta):
        seconds, part_us = divmod(round(cell / datetime.timedelta(microseconds=1)), 10**6)
        return f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}.{part_us:06}"
    if isinstance(cell, datetime.datetime | datetime.time):
        text = cell.isoformat(timespec="microseconds")
        return text.replace("T", " ")
    return str(cell).translate(FIELD_ENDS).strip()
