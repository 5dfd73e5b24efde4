"""Finds isolated points of a grid. The verdict of an isolated point differs from the verdicts of
all its neighbours."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from forceaxis.experiments.points import Point, SweepParameter, tidy


def find(axes: Sequence[SweepParameter], verdict: Sequence[str]) -> list[int]:
    """Returns the indices of the isolated points of a grid of one or two parameters.

    The verdict of an isolated point differs from the verdict of each neighbour, including diagonal
    neighbours. At least two neighbours must have a verdict.
    """
    shape = tuple(len(a.values) for a in axes)
    if not axes or len(axes) > 2 or any(len(set(a.values)) != len(a.values) for a in axes):
        return []
    order = np.ix_(*(np.argsort(a.values) for a in axes))
    cells = np.asarray(verdict).reshape(shape)[order]
    numbers = np.arange(len(verdict)).reshape(shape)[order]
    found = []
    for place in np.ndindex(shape):
        near = tuple(slice(max(0, i - 1), i + 2) for i in place)
        # verdicts of the point and of its neighbours, as far as they are known
        known = [v for v in cells[near].ravel() if v]
        if cells[place] and len(known) > 2 and known.count(cells[place]) == 1:
            found.append(int(numbers[place]))
    return sorted(found)


def around(axes: Sequence[SweepParameter], point: Sequence[float]) -> list[Point]:
    """Returns the points half-way between a point of the grid and each of its neighbours, including
    diagonal neighbours."""
    choices = []
    for axis, value in zip(axes, point, strict=True):
        values = sorted(axis.values)
        at = values.index(value)
        near = values[max(0, at - 1)], values[min(len(values) - 1, at + 1)]
        choices.append(dict.fromkeys([value, *(half_way(axis, value, v) for v in near)]))
    return [p for p in itertools.product(*choices) if p != tuple(point)]


def half_way(axis: SweepParameter, a: float, b: float) -> float:
    """Returns the value half-way between two values, on the scale of the parameter."""
    return tidy(math.sqrt(a * b) if axis.log else (a + b) / 2)
