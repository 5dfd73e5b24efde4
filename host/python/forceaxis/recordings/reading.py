"""Reads a file of another program as a source of recordings. The function that reads the file is
selected by its content."""

import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.bus.recordings import MCAP_MAGIC, reader_of
from forceaxis.errors import ParameterError
from forceaxis.recordings import can_log, cube_monitor
from forceaxis.recordings.can_names import Names, source_of
from forceaxis.recordings.dialect import is_text
from forceaxis.recordings.mdf import UNFINISHED, read_mdf
from forceaxis.recordings.messages import read_messages
from forceaxis.recordings.signal_recording import is_recording
from forceaxis.recordings.source import Source, read_npz, read_parquet
from forceaxis.recordings.table import read_tables
from forceaxis.recordings.tdms import read_tdms
from forceaxis.recordings.workbook import read_workbook

LCM_MARK = b"\xed\xa1\xda\x01"  # first bytes of an LCM log


def _read_archive(path: Path) -> list[Source]:
    """Reads a ZIP archive, if it is a workbook or one of arrays. Raises InputError."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            size = sum(info.file_size for info in archive.infolist())
    except (OSError, zipfile.BadZipFile, NotImplementedError):
        names, size = [], 0  # the reader of arrays says what is wrong
    if "[Content_Types].xml" in names and any(name.startswith("xl/") for name in names):
        files.expect_unpacked(path, size)
        return read_workbook(path)
    if "[Content_Types].xml" in names or "content.xml" in names:
        raise InputError(
            f"{paths.display(path)}: expected a text table, arrays or a workbook (xlsx), got "
            "another document; save the sheet with the data as xlsx or CSV"
        )
    if names and not any(name.endswith(".npy") for name in names):
        raise InputError(
            f"{paths.display(path)}: expected a text table or arrays, got a ZIP archive with "
            f"{names[0]}; unpack it, and import the file inside"
        )
    return [read_npz(path)]


# (first bytes of a file, function that reads such a file)
READERS: tuple[tuple[bytes, Callable[[Path], Sequence[Source]]], ...] = (
    (b"PK", _read_archive),
    (b"PAR1", lambda path: [read_parquet(path)]),
    (MCAP_MAGIC, lambda path: [read_messages(path)]),
    (LCM_MARK, lambda path: [read_messages(path)]),
    (b"TDSm", lambda path: [read_tdms(path)]),
    (b"MDF     ", lambda path: [read_mdf(path)]),
    (UNFINISHED, lambda path: [read_mdf(path)]),
)
KINDS = "a file of the kind CSV, xlsx, NPZ, Parquet, TDMS, MDF, MCAP, LCM log, CAN log or incident"
# (first bytes of a file, kind of the file, what a user can do with it)
FOREIGN = (
    (b"TDSh", "the index of a TDMS file of LabVIEW", "import the TDMS file beside it"),
    (b"\xd0\xcf\x11\xe0", "a workbook of Excel 97", "save it as xlsx or CSV"),
    (
        b"MATLAB ",
        "a MAT file of MATLAB",
        "write its signals as CSV or Parquet, such as by writetable",
    ),
)


def is_foreign(path: Path) -> bool:
    """Returns True if a file is of another program and has to be imported before it can be used as
    a recording. A log with LCM messages can be used."""
    if not path.is_file() or is_recording(path):  # A missing file is reported by its reader.
        return False
    with path.open("rb") as file:
        start = file.read(can_log.HEAD_BYTES)
    if start.startswith(MCAP_MAGIC):
        reader = reader_of(path)
        return not any(True for _ in reader) and bool(getattr(reader, "others", {}))
    return bool(start) and not start.startswith(LCM_MARK)


def read_sources(
    path: Path, separator: str | None = None, names: Names | None = None
) -> list[Source]:
    """Reads a file as sources of recordings, one for each section of a text table. The content of
    the file selects the kind of source. `separator`: character between the columns of a CSV file,
    or None to find it. `names`: names and scales of the frames of a CAN log. Raises InputError,
    OSError."""
    where = paths.display(path)
    with path.open("rb") as file:
        start = file.read(can_log.HEAD_BYTES)
    if not start:
        raise InputError(f"{where}: expected a file with data, got an empty file; record again")
    if is_recording(path):
        raise InputError(
            f"{where}: expected a file of another program, got a recording that was already "
            "imported; use this file without importing it"
        )
    if read_log := can_log.reader_of(start):
        can_log.expect_readers(path)
        return [source_of(read_log(path), names or Names())]
    if names:
        raise ParameterError(
            names.parameter, f"expected a log of candump, Vector or PEAK for it, got {where}; "
            "remove it, or give such a log"
        )  # fmt: skip
    for mark, read in READERS:
        if start.startswith(mark):
            return [*read(path)]
    if cube_monitor.is_log(start):
        return [cube_monitor.read(path)]
    for mark, kind, remedy in FOREIGN:
        if start.startswith(mark):
            raise InputError(f"{where}: expected {KINDS}, got {kind}; {remedy}")
    if not is_text(start[:64]):
        raise InputError(
            f"{where}: expected {KINDS}, got other binary data; export the data as one of these "
            "kinds"
        )
    return read_tables(path, separator)


def read_source(path: Path, separator: str | None = None) -> Source:
    """Reads a file with one section as a source of recordings. Raises InputError, OSError."""
    sources = read_sources(path, separator)
    if len(sources) > 1:
        raise InputError(
            f"{paths.display(path)}: expected one section of rows, got {len(sources)}; use "
            "`import_recording`, which imports each of them"
        )
    return sources[0]
