"""Logs of STM32CubeMonitor (NAME.stcm) as a source of recordings.

Each line is an object of JSON with successive values of one variable:

    {"groupname": G, "variablename": V, "variabledata": [{"x": MS}, {"x": MS, "y": VALUE}, ...]}

x is the time in ms since 1970. Each variable has times of its own.
"""

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forceaxis import files
from forceaxis.recordings.source import ArraySource, Head

KIND = "STM32CubeMonitor"
EXPECTED, REMEDY = "a log of STM32CubeMonitor", "record the variables again, or log them as CSV"
KEYS = (b'"groupname"', b'"variabledata"', b'"variablename"')
PER_MS = 1000  # times are kept as whole us


def is_log(start: bytes) -> bool:
    """Returns True if a file with these first bytes is a log of STM32CubeMonitor."""
    return start.lstrip()[:1] == b"{" and any(key in start for key in KEYS)


def read(path: Path) -> ArraySource:
    """Returns the variables of a log as a source. Raises InputError."""
    samples: dict[tuple[str, str], list[tuple[int, float]]] = {}
    with path.open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            if line.strip():
                with files.parsing(path, f"{EXPECTED} in line {number}", REMEDY):
                    key, own = _samples(files.json_of(line))
                samples.setdefault(key, []).extend(own)
    heads: list[Head] = []
    arrays: list[Callable[[], NDArray[np.generic]]] = []
    several = len({group for group, _ in samples}) > 1
    for (group, variable), own in samples.items():
        name = f"{group}/{variable}" if several else variable
        heads += [Head(name, time=len(heads) + 1), Head(f"{name} time", "us")]
        columns = np.array([value for _, value in own]), np.array([at for at, _ in own], np.int64)
        arrays += [functools.partial(np.asarray, column) for column in columns]
    return ArraySource(path, KIND, heads, arrays)


def _samples(line: object) -> tuple[tuple[str, str], list[tuple[int, float]]]:
    """Returns ((group, variable), [(time in us, value)]) of the object in a line. Raises
    ValueError."""
    data = line.get("variabledata") if isinstance(line, dict) else None
    if not isinstance(line, dict) or not isinstance(data, list):
        raise ValueError("no variabledata")
    found = []
    for one in data:
        time = one.get("x") if isinstance(one, dict) else None
        if time is None:
            raise ValueError("a sample without the time x")
        if "y" in one:  # the begin of the measurement has no value
            found.append((round(_number(time) * PER_MS), _number(one["y"])))
    return (str(line.get("groupname", "")), str(line.get("variablename", "variable"))), found


def _number(value: object) -> float:
    """Returns a number of JSON, NaN for null. Raises ValueError."""
    if value is None:
        return float("nan")
    if not isinstance(value, bool | int | float):
        raise ValueError(f"{str(value)[:20]!r} in place of a number")
    return float(value)
