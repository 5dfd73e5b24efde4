"""State space of a model with given states of its elements, such as contacts that are open or
pressed. It is computed from the same equations as the simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core

Numbers = NDArray[np.float64]
Roots = NDArray[np.complex128]
Matrix = NDArray[Any]  # matrix of float, np.longdouble or complex numbers
StateSpace = tuple[Matrix, Matrix, Matrix, Matrix]  # matrices (A, B, C, D) of a linear system


@dataclass(frozen=True)
class Equations:
    """A linear system x' = A x + B u, y = C x + D u in SI units. `states` are the names of the rows
    of A. `volts_per_code`: command of the drive in V per DAC code."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    states: list[str]
    volts_per_code: float


def read(
    path: str,
    inputs: Sequence[str],
    outputs: Sequence[str],
    overrides: Mapping[str, float | str],
    modes: Mapping[str, str],
    free: bool = False,
    drive: bool = True,
) -> Equations:
    """Returns the linear equations of the model file at `path`. For the other arguments and the
    exceptions, see `system.linearise`."""
    return Equations(
        **_core.linear(path, list(inputs), list(outputs), dict(overrides), dict(modes), free, drive)
    )
