"""The state space of a model in one mode, as the simulator computes it from its equations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core

Numbers = NDArray[np.float64]
Roots = NDArray[np.complex128]
Matrix = NDArray[Any]  # of float, np.longdouble or complex
StateSpace = tuple[Matrix, Matrix, Matrix, Matrix]  # (A, B, C, D) of a linear system


@dataclass(frozen=True)
class Equations:
    """x' = A x + B u, y = C x + D u in SI units; `states` names the rows of A."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    states: list[str]


def read(
    path: str,
    inputs: Sequence[str],
    outputs: Sequence[str],
    overrides: Mapping[str, float | str],
    modes: Mapping[str, str],
    free: bool = False,
    drive: bool = True,
) -> Equations:
    """The equations of the model file at `path`; arguments and errors as in `system.linearise`."""
    return Equations(
        **_core.linear(path, list(inputs), list(outputs), dict(overrides), dict(modes), free, drive)
    )
