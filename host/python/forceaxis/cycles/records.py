"""Reads and writes folders with records of pressed parts. A folder has one JSON file for each part,
and a table of all parts.

    records/
      parts/00003_0000000017.json    power-up 3 of the axis, part 17
      parts.csv                      one row for each part
      parts.parquet                  the same table in Parquet; only on request
      parts.jsonl                    all records with their curves, one per line; only on request

The JSON files are the original records. A file is either complete or not written. When add()
returns, the file is on the disk, so that the result may then be acknowledged on the axis. The
tables are made from the JSON files. If a killed program has left an incomplete table, the table is
written again.
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
# name of a column that only the table of `cycle rates` has, and its value for good parts
GROUP, GOOD_PARTS = "group", "good parts"
Key = tuple[int, int]


def file_name(key: Key) -> str:
    """Returns the name of the JSON file of a part. Sorted file names have the order in which the
    parts were pressed."""
    return f"{key[0]:05d}_{key[1]:010d}.json"


def read_record(file: Path) -> PartRecord:
    """Reads the record of one pressed part from a JSON file. Raises InputError."""
    table = files.read_json(
        file, "the record of a part as JSON",
        "restore it from a copy, or move it out of the folder",
    )  # fmt: skip
    return from_json(PartRecord, table, paths.display(file))


def files_of(folder: Path) -> dict[Key, Path]:
    """Returns the JSON files of all parts in a folder, in the order in which the parts were
    pressed."""
    named = ((NAME.fullmatch(f.name), f) for f in (folder / PARTS).glob("*.json"))
    found = {(int(name[1]), int(name[2])): file for name, file in named if name}
    return dict(sorted(found.items()))


def _synced(path: Path) -> None:
    """Waits until the disk has stored a file or a folder, so that a power cut cannot delete it."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class RecordFolder:
    """A folder to which a command adds the records of the parts of one axis. Only one command at a
    time may use the folder. Raises InputError."""

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
        """Deletes incomplete files that an ended command has left in the folder, and repairs the
        table."""
        # An incomplete file remains if the command that wrote it was killed.
        for rest in (self.folder / PARTS).glob("*.new"):
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
        """Ends the use of the folder by this command, so that another command may use it."""
        os.close(self._lock)

    def __contains__(self, key: Key) -> bool:
        return key in self._files

    @property
    def keys(self) -> list[Key]:
        """The numbers that identify each part: number of the power-up, and number of the part. They
        are in the order in which the parts were pressed."""
        return list(self._files)

    def record(self, key: Key) -> PartRecord:
        """Reads the record of one pressed part from its file. Raises InputError."""
        return read_record(self._files[key])

    def records(self) -> Iterator[PartRecord]:
        """Reads the records of all parts, and yields them one by one. Raises InputError."""
        return map(read_record, self._files.values())

    def add(self, record: PartRecord) -> bool:
        """Writes a record to the disk and returns True. Returns False if the folder already has the
        record of this part. Raises InputError if the folder has the record of another part with the
        same numbers of power-up and part."""
        if record.key in self:
            if not self.record(record.key).is_same_part(record):
                raise InputError(
                    f"{paths.display(self.folder)}: expected a folder with the records of this "
                    f"axis alone, but it has a different part with the number {record.number} of "
                    f"power-up {record.power_up}; give another folder"
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
        """Writes the table of all parts as a Parquet file, and returns the path of the file."""
        import pyarrow
        import pyarrow.parquet

        rows = [row_of(record) for record in self.records()]
        columns = _columns_of(rows)
        # An empty cell becomes null. The other cells of a column determine its type.
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
        """Returns the column names of the table of parts. Returns None if the table does not have
        exactly one complete row for each JSON file."""
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
        """Adds the row of a part to the table. The whole table is written again if it does not have
        all columns of the row, or if the part is not the last one (`is_last`)."""
        if self._columns is None or not is_last or not set(row) <= set(self._columns):
            self._write_table()
            return
        with (self.folder / TABLE).open("a", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow([row.get(name) for name in self._columns])

    def _write_table(self) -> None:
        """Writes the whole table of all parts again."""
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
    """Returns the names of all columns that occur in the rows, in the order of their first
    occurrence."""
    return list(dict.fromkeys(name for row in rows for name in row))


@dataclass(frozen=True)
class RecordedParts:
    """Parts that were read from a folder or a table. They are in the order in which they were
    pressed."""

    source: str
    records: list[PartRecord]
    # number of simulated bad parts in the table of `cycle rates`; their records were not read
    left_out: int = 0


def read_parts(source: Path, last: int | None = None) -> RecordedParts:
    """Reads the parts from `source`. This is a folder with records, its file parts.jsonl, a folder
    of `cycle rates`, or the table in one of these folders. `last`: number of parts to return,
    counted from the end, or None for all parts. Raises InputError."""
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
    """Reads the records in a file of JSON lines, and yields them one by one. Raises InputError."""
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
    """Reads the parts in a CSV table. Of a table of `cycle rates`, only the good parts are
    returned."""
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
    """Context manager that opens a folder for records of parts and yields it. If `folder` is None,
    yields None."""
    if folder is None:
        yield None
        return
    with RecordFolder(folder) as found:
        yield found
