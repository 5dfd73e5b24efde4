"""Readers of files that users and other programs wrote. They refuse a damaged or hostile file with
an error text of one line. Each reader of the package therefore uses a function of this module, or
runs its parser in the context parsing().

    with parsing(file, "a table of parts", "export it again"):
        rows = ...
    table = read_json(file, "the record of a part", "restore it from a copy")
    arrays = read_arrays(file, "an NPZ file")
"""

import contextlib
import csv
import io
import json
import logging
import lzma
import math
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.results import Json, JsonObject

PACKAGE = str(Path(__file__).parent)
# Exceptions that the content of a file can cause in a parser.
# An exception such as TypeError is an error of this package if its own code raises it.
DAMAGE = (
    *(ValueError, LookupError, EOFError, ArithmeticError, RuntimeError, MemoryError),
    *(struct.error, zlib.error, lzma.LZMAError, zipfile.BadZipFile, csv.Error),
)
UNPACKED_MOST_BYTES = 1 << 30  # largest total size in bytes of all arrays in a file
# for a large file: largest total size of all arrays, divided by the size of the file
UNPACKED_MOST_TIMES = 16
INTEGER_MOST = 1 << 64  # largest magnitude of an integer in JSON, plus 1
# largest number of characters of another package's error text that a message shows
TEXT_MOST = 200


def first_line(error: BaseException) -> str:
    """Returns the first line of the text of an exception, or the type of an exception without a
    text."""
    lines = str(error).split("\n")
    text = lines[0].strip()[:TEXT_MOST]
    if isinstance(error, KeyError) or not text:
        return f"{type(error).__name__} {text}".strip()
    return text


def _is_of_file(error: Exception) -> bool:
    """Returns True if an exception in a parser may be caused by the content of a file. This is so
    if its type is in DAMAGE, or if the code of another package has raised it."""
    if isinstance(error, DAMAGE):
        return True
    frames = error.__traceback__
    while frames is not None and frames.tb_next is not None:
        frames = frames.tb_next
    return frames is None or not frames.tb_frame.f_code.co_filename.startswith(PACKAGE)


@contextlib.contextmanager
def parsing(file: Path | str, expected: str, remedy: str = "give another file") -> Iterator[None]:
    """Context in which the content of a file is parsed. Replaces an exception that a damaged file
    causes by an InputError with the text "FILE: expected EXPECTED, got: ...; REMEDY". Does not
    change an InputError or OSError that names the file, or an exception from a programming error of
    this package."""
    try:
        yield
    except InputError as error:
        if paths.display(Path(file)) in str(error):
            raise
        refuse(file, expected, str(error), remedy)
    except OSError as error:
        if error.filename is not None:
            raise
        refuse(file, expected, error.strerror or first_line(error), remedy)
    except Exception as error:
        if not _is_of_file(error):
            raise
        refuse(file, expected, first_line(error), remedy)


class _Remarks(logging.Handler):
    def __init__(self, texts: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._texts = texts

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage().split("\n")[0][:TEXT_MOST]
        if text not in self._texts:
            self._texts.append(text)


@contextlib.contextmanager
def remarks(package: str) -> Iterator[list[str]]:
    """Context in which a package parses a file. Collects its warnings, which it would print."""
    texts: list[str] = []
    logger = logging.getLogger(package)
    before = logger.propagate, logger.handlers
    logger.propagate, logger.handlers = False, [_Remarks(texts)]
    try:
        yield texts
    finally:
        logger.propagate, logger.handlers = before


def refuse(file: Path | str, expected: str, got: str, remedy: str) -> NoReturn:
    """Raises InputError. Its text is one line, which consists of the arguments."""
    where = paths.display(Path(file))
    raise InputError(f"{where}: expected {expected}, got: {got}; {remedy}") from None


def _float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:20]}, which is too large")
    return value


def _int(text: str) -> int:
    value = int(text) if len(text) < 21 else INTEGER_MOST
    if abs(value) >= INTEGER_MOST:
        raise ValueError(f"the number {text[:20]}..., which is too large")
    return value


def json_of(text: str | bytes, has_constants: bool = False) -> Json:
    """Returns the value of a JSON text. `has_constants`: True if the text may contain NaN and
    Infinity, which standard JSON does not have. Raises ValueError or RecursionError for a damaged
    text. Also raises ValueError for a number that is too large for a float, or an integer of more
    than 64 bits."""

    def constant(name: str) -> float:
        if has_constants:
            return float(name)
        raise ValueError(f"{name}, which is no number of JSON")

    made: Json = json.loads(text, parse_constant=constant, parse_float=_float, parse_int=_int)
    return made


def read_json(
    file: Path, expected: str, remedy: str = "give another file", has_constants: bool = False
) -> JsonObject:
    """Returns the object that a JSON file contains. `has_constants`: see json_of(). Raises
    InputError, OSError."""
    with parsing(file, expected, remedy):
        table = json_of(file.read_text(encoding="utf-8"), has_constants)
    if not isinstance(table, dict):
        refuse(file, expected, f"a JSON value of another kind, {json.dumps(table)[:20]}", remedy)
    return table


def read_arrays(
    file: Path | str, expected: str, remedy: str = "give another file"
) -> dict[str, NDArray[np.generic]]:
    """Returns the arrays of an NPZ file by their names. Raises InputError, OSError."""
    with parsing(file, expected, remedy), zipfile.ZipFile(file) as archive:
        expect_unpacked(file, sum(info.file_size for info in archive.infolist()))
        return {
            name.removesuffix(".npy"): array_of(archive, name)
            for name in archive.namelist()
            if name.endswith(".npy")
        }


def array_of(archive: zipfile.ZipFile, name: str) -> NDArray[np.generic]:
    """Returns an array of an NPZ file. Raises an exception whose type is in DAMAGE if the size of
    the array differs from the size in its header."""
    data = io.BytesIO(archive.read(name))
    head = np.lib.format
    version = head.read_magic(data)
    read = {(1, 0): head.read_array_header_1_0, (2, 0): head.read_array_header_2_0}.get(version)
    if read is None:
        raise ValueError(f"{name}: an array of the version {version}")
    shape, _, dtype = read(data)
    stated, left = math.prod(shape) * dtype.itemsize, data.getbuffer().nbytes - data.tell()
    if dtype.hasobject or stated != left or min(shape, default=0) < 0:
        raise ValueError(f"{name}: {left} bytes for {dtype} in the shape {shape}")
    data.seek(0)
    return np.asarray(np.load(data, allow_pickle=False))


def expect_unpacked(file: Path | str, size: int) -> None:
    """Raises InputError for a compressed file whose content is too large after decompression. A
    long recording is large too, but its samples hardly become smaller by compression."""
    most = max(UNPACKED_MOST_BYTES, UNPACKED_MOST_TIMES * Path(file).stat().st_size)
    if size > most:
        refuse(
            file, f"a content of at most {most >> 20} MiB",
            f"{size >> 20} MiB when it is unpacked", "export a part of it",
        )  # fmt: skip
