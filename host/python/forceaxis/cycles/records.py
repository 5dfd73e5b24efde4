"""Folders with records of parts: one JSON file for each part, and a table of all parts.

    records/
      parts/00003_0000000017.json    power-up 3 of the axis, part 17
      parts.csv                      one row for each part
      parts.parquet                  the same, if it was asked for
      parts.jsonl                    all records with their curves, a line each, if asked for

The JSON files are the records. A file is written completely or not at all, and it is on the disk
when add() returns, so that the axis may then forget the result. The tables follow from the files: a
table that a killed program has left incomplete is written again.
"""

import contextlib
import csv
import fcntl
import io
import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.cycles.record import (
    Cell,
    PartRecord,
    elements_of,
    from_row,
    row_of,
)
from forceaxis.results import from_json, to_json

PARTS, TABLE, PARQUET, LINES = "parts", "parts.csv", "parts.parquet", "parts.jsonl"
NAME = re.compile(r"(\d+)_(\d+)\.json")
GROUP, GOOD_PARTS = "group", "good parts"  # column and value of the table of `cycle rates`
Key = tuple[int, int]


def file_name(key: Key) -> str:
    """Returns the name of the file of a part. Sorted names have the order in which the parts were
    pressed."""
    return f"{key[0]:05d}_{key[1]:010d}.json"


def read_record(file: Path) -> PartRecord:
    """Returns the record in a JSON file. Raises InputError."""
    table = files.read_json(
        file, "the record of a part as JSON",
        "restore it from a copy, or move it out of the folder",
    )  # fmt: skip
    return from_json(PartRecord, table, paths.display(file))


def files_of(folder: Path) -> dict[Key, Path]:
    """Returns the files of all parts of a folder, in the order in which the parts were pressed."""
    named = ((NAME.fullmatch(f.name), f) for f in (folder / PARTS).glob("*.json"))
    found = {(int(name[1]), int(name[2])): file for name, file in named if name}
    return dict(sorted(found.items()))


def _synced(path: Path) -> None:
    """Waits until a file or folder is written to the disk, so that a power cut does not lose it."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class RecordFolder:
    """A folder to which a command adds records of one axis. Only one command at a time may use it.
    Raises InputError."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            (folder / PARTS).mkdir(parents=True, exist_ok=True)
            self._lock = os.open(folder, os.O_RDONLY)
        except OSError as error:
            raise InputError(
                f"{paths.display(folder)}: expected a folder for the records of parts, got: "
                f"{error.strerror}"
            ) from None
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock)
            raise InputError(
                f"{paths.display(folder)}: expected a folder that no other command writes to; end "
                "the other command, or give another folder"
            ) from None
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        """Removes the unfinished files of an earlier command that was killed, and repairs the
        table."""
        for rest in (self.folder / PARTS).glob("*.new"):  # unfinished file of a killed command
            rest.unlink()
        for path in (self.folder.parent, self.folder):
            _synced(path)
        self._files = files_of(self.folder)
        self._columns = self._read_columns()
        if self._columns is None:
            self._write_table()

    def __enter__(self) -> "RecordFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the use of the folder."""
        os.close(self._lock)

    def __contains__(self, key: Key) -> bool:
        return key in self._files

    @property
    def keys(self) -> list[Key]:
        """Number of the power-up and number of the part, for each part in their order."""
        return list(self._files)

    def record(self, key: Key) -> PartRecord:
        """Returns the record of one part. Raises InputError."""
        return read_record(self._files[key])

    def records(self) -> Iterator[PartRecord]:
        """Yields the records of all parts. Raises InputError."""
        return map(read_record, self._files.values())

    def add(self, record: PartRecord) -> bool:
        """Writes a record to the disk and returns True. Returns False if the folder already has the
        record of this part. Raises InputError if the folder has another part with the same power-up
        and number."""
        if record.key in self:
            if not self.record(record.key).is_same_part(record):
                raise InputError(
                    f"{paths.display(self.folder)}: expected a folder with the records of one "
                    f"axis, but part {record.number} of power-up {record.power_up} is another "
                    "part in this folder; give another folder"
                )
            return False
        name = file_name(record.key)
        text = json.dumps(to_json(record), allow_nan=False)
        with paths.replacing(self.folder / PARTS, name) as (file,):
            file.write_text(text + "\n", encoding="utf-8")
            _synced(file)
        _synced(self.folder / PARTS)
        is_last = not self._files or record.key > next(reversed(self._files))
        self._files[record.key] = self.folder / PARTS / name
        self._files = self._files if is_last else dict(sorted(self._files.items()))
        self._add_row(row_of(record), is_last)
        return True

    def write_parquet(self) -> Path:
        """Writes the table of all parts as Parquet, and returns its path."""
        import pyarrow
        import pyarrow.parquet

        rows = [row_of(record) for record in self.records()]
        columns = _columns_of(rows)
        # A cell without a value is null. The other cells determine the type of a column.
        table = pyarrow.table({name: [row.get(name) for row in rows] for name in columns})
        with paths.replacing(self.folder, PARQUET) as (file,):
            pyarrow.parquet.write_table(table, file)
        return self.folder / PARQUET

    def write_lines(self) -> Path:
        """Writes the records of all parts as JSON lines, and returns the path of the file."""
        with (
            paths.replacing(self.folder, LINES) as (file,),
            file.open("w", encoding="utf-8") as stream,
        ):
            for record in self.records():
                stream.write(json.dumps(to_json(record), allow_nan=False) + "\n")
        return self.folder / LINES

    def _read_columns(self) -> list[str] | None:
        """Returns the columns of the table, or None if the table has not exactly one complete row
        for each file."""
        try:
            data = (self.folder / TABLE).read_bytes()
        except FileNotFoundError:
            return None
        rows = list(csv.reader(io.StringIO(data.decode("utf-8", "replace"), newline="")))
        if not data.endswith(b"\n") or {len(row) for row in rows} != {len(rows[0])}:
            return None
        try:
            number, power_up = rows[0].index("number"), rows[0].index("power_up")
            keys = [(int(row[power_up]), int(row[number])) for row in rows[1:]]
        except ValueError:
            return None
        return rows[0] if keys == list(self._files) else None

    def _add_row(self, row: dict[str, Cell], is_last: bool) -> None:
        """Adds the row of the last part to the table. The table is written again if it does not
        have all columns of the row, or if the part is not the last one."""
        if self._columns is None or not is_last or not set(row) <= set(self._columns):
            self._write_table()
            return
        with (self.folder / TABLE).open("a", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow([row.get(name) for name in self._columns])

    def _write_table(self) -> None:
        """Writes the table of all parts again."""
        rows = [row_of(record) for record in self.records()]
        self._columns = _columns_of(rows) or list(row_of(PartRecord(0)))
        with (
            paths.replacing(self.folder, TABLE) as (file,),
            file.open("w", encoding="utf-8", newline="") as stream,
        ):
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(self._columns)
            writer.writerows([row.get(name) for name in self._columns] for row in rows)


def _columns_of(rows: Sequence[dict[str, Cell]]) -> list[str]:
    """Returns the names of all columns in some rows, in the order of their first occurrence."""
    return list(dict.fromkeys(name for row in rows for name in row))


@dataclass(frozen=True)
class RecordedParts:
    """Parts that were read from a folder or a table, in the order in which they were pressed."""

    source: str
    records: list[PartRecord]
    left_out: int = 0  # simulated bad parts in the table of `cycle rates`


def read_parts(source: Path, last: int | None = None) -> RecordedParts:
    """Returns the parts in a folder with records, in its file parts.jsonl, in a folder of `cycle
    rates`, or in the table of one of these folders; with `last`, only the last parts. Raises
    InputError."""
    if (source / PARTS).is_dir():
        files = list(files_of(source).values())
        records = [read_record(file) for file in files[-last if last else 0 :]]
        return _expect_parts(RecordedParts(paths.display(source), records))
    if source.suffix == ".jsonl":
        records = list(_read_lines(source))[-last if last else 0 :]
        return _expect_parts(RecordedParts(paths.display(source), records))
    table = source / TABLE if source.is_dir() else source
    found = _read_table(table)
    return _expect_parts(
        RecordedParts(found.source, found.records[-last if last else 0 :], found.left_out)
    )


def _read_lines(file: Path) -> Iterator[PartRecord]:
    """Yields the records of a file of JSON lines. Raises InputError."""
    with files.parsing(file, "records as JSON lines"):
        lines = file.read_text(encoding="utf-8").splitlines()
    for i, line in enumerate(lines, 1):
        where = f"{paths.display(file)}: line {i}"
        with files.parsing(where, "the record of a part as JSON"):
            table = files.json_of(line)
        yield from_json(PartRecord, table, where)


def _expect_parts(found: RecordedParts) -> RecordedParts:
    if not found.records:
        raise InputError(
            f"{found.source}: expected the record of at least one pressed part, got "
            "none; press a part first"
        )
    return found


def _read_table(file: Path) -> RecordedParts:
    """Returns the parts of a CSV table. Only good parts are returned from a table of `cycle
    rates`."""
    where = paths.display(file)
    expected = "a folder with records of parts, or a table parts.csv"
    remedy = "`start_cycle` writes records"
    if not file.is_file():
        files.refuse(file, expected, "neither", remedy)
    with files.parsing(file, expected, remedy), file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    columns = rows[0] if rows else []
    names = elements_of(columns)
    if "state" not in columns or not names:
        raise InputError(
            f"{where}: expected a table of parts with a column `state` and a column for each "
            "evaluation element, got another table; give a file parts.csv"
        )
    records, left_out = [], 0
    for i, cells in enumerate(rows[1:], 2):
        if len(cells) != len(columns):
            raise InputError(
                f"{where}: line {i}: expected {len(columns)} cells, got {len(cells)}; remove this "
                "line"
            )
        row = dict(zip(columns, cells, strict=True))
        if row.get(GROUP, GOOD_PARTS) != GOOD_PARTS:
            left_out += 1
        elif not row.get("error"):
            records.append(from_row(row, names, f"{where}: line {i}"))
    return RecordedParts(where, records, left_out)


@contextlib.contextmanager
def folder_or_none(folder: Path | None) -> Iterator[RecordFolder | None]:
    """Context manager with the folder for records, or with None if there is no folder."""
    if folder is None:
        yield None
        return
    with RecordFolder(folder) as found:
        yield found
