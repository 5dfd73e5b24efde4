"""Reads columns of numbers from a CSV file."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from forceaxis import files
from forceaxis._core import InputError
from forceaxis.identify.measurement import Reals

# Largest permitted number in a CSV file, so that no sum of squares overflows.
LARGEST_NUMBER = 1e100


def rows_of(path: Path | str) -> list[tuple[int, list[str]]]:
    """Returns the lines of a CSV file that are not empty, as [(line number, texts of the fields)].
    Raises InputError."""
    with (
        files.parsing(path, "a CSV file in UTF-8", "export it again"),
        open(path, newline="", encoding="utf-8-sig") as file,
    ):
        rows = csv.reader(file)
        return [(rows.line_num, row) for row in rows if row]


def header_of(path: Path | str) -> list[str]:
    """Returns the names of the columns of a CSV file."""
    return [name.strip() for _, row in rows_of(path)[:1] for name in row]


def read_columns(path: Path | str, names: Sequence[str]) -> list[Reals]:
    """Returns the columns with the names `names` from a CSV file, each as an array (n,). Raises
    InputError with file, line and column."""
    rows = rows_of(path)
    header = [name.strip() for name in rows[0][1]] if rows else []
    for name in names:
        if header.count(name) != 1:
            raise InputError(
                f"{path}: expected exactly one column with the name {name} in the first line, got "
                f"the columns {', '.join(header) or '(none)'}; correct the names in the first line"
            )
    places = [header.index(name) for name in names]
    columns: list[list[float]] = [[] for _ in names]
    for line, row in rows[1:]:
        for column, name, place in zip(columns, names, places, strict=True):
            text = row[place] if place < len(row) else ""
            try:
                column.append(float(text))
            except ValueError:
                column.append(math.nan)
            if not abs(column[-1]) < LARGEST_NUMBER:
                raise InputError(
                    f"{path}: line {line}, {name}: expected a number below {LARGEST_NUMBER:g}, "
                    f"got {text!r}"
                )
    return [np.array(column) for column in columns]
