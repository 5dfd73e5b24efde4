"""Reads a file of another program as a source of recordings. The function that reads the file is
selected by its content."""

from collections.abc import Callable
from pathlib import Path

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.bus.recordings import MCAP_MAGIC
from forceaxis.recordings.csv_source import CsvSource
from forceaxis.recordings.signal_recording import is_recording
from forceaxis.recordings.source import Source, read_messages, read_npz, read_parquet

# suffixes of files that contain a table of numbers, such as CSV
TABLES = (".csv", ".tsv", ".txt", ".parquet")
LCM_MARK = b"\xed\xa1\xda\x01"  # first bytes of an LCM log

# (first bytes of a file, function that reads such a file)
READERS: tuple[tuple[bytes, Callable[[Path], Source]], ...] = (
    (b"PK", read_npz),
    (b"PAR1", read_parquet),
    (MCAP_MAGIC, read_messages),
    (LCM_MARK, read_messages),
)


def expect_log(path: Path) -> None:
    """Raises InputError if a file is a table of another program, because such a file has to be
    imported before it can be used as a recording."""
    if not path.is_file():  # A missing file is reported by the function that reads the log.
        return
    with path.open("rb") as file:
        start = file.read(64)
    if path.suffix.lower() in TABLES or start.startswith((b"PK", b"PAR1")):
        raise InputError(
            f"{paths.display(path)}: expected a recording or a log, got a file of another program; "
            "`import_recording` makes a recording of it"
        )


def read_source(path: Path, separator: str | None = None) -> Source:
    """Reads a file as a source of recordings. The content of the file selects the kind of source.
    `separator`: character between the columns of a CSV file, or None to find it. Raises InputError,
    OSError."""
    where = paths.display(path)
    with path.open("rb") as file:
        start = file.read(64)
    if not start:
        raise InputError(f"{where}: expected a file with data, got an empty file; record again")
    if is_recording(path):
        raise InputError(
            f"{where}: expected a file of another program, got a recording that was already "
            "imported; use this file without importing it"
        )
    for mark, read in READERS:
        if start.startswith(mark):
            return read(path)
    if b"\0" in start and not start.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(
            f"{where}: expected a file of the kind CSV, NPZ, Parquet, MCAP, LCM log or incident, "
            "got other binary data; export the data as one of these kinds"
        )
    return CsvSource(path, separator)
