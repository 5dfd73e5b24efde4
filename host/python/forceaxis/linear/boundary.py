"""Computes the response of a linear system along the stability boundary, and the frequencies at
which the response has to be known. The system has one input and one output. Only minimal() accepts
more, with as many inputs as outputs.

Frequencies belong to a plane in which the imaginary axis is the stability boundary. This is the s
plane, or the plane of w = (2/T) (z - 1)/(z + 1) for a sampled system.
"""

from dataclasses import replace

import numpy as np

from forceaxis import _core
from forceaxis.linear.equations import Matrix, StateSpace
from forceaxis.linear.system import System

# The search for controllable states builds orthogonal directions from vectors.
# Size of the new part of a vector, divided by the vector, below which it is a rounding error.
DIRECTION_SHARE_MIN = 1e-15


def _reachable(A: Matrix, B: Matrix) -> Matrix:
    """Returns an orthonormal basis of the controllable states. Each column is one basis vector."""
    basis: Matrix = np.zeros((len(A), 0))
    images = [B[:, i : i + 1] for i in range(B.shape[1])]
    while images and basis.shape[1] < len(A):
        image = images.pop(0)
        new = image - basis @ (basis.T @ image)
        new -= basis @ (basis.T @ new)
        if np.linalg.norm(new) > DIRECTION_SHARE_MIN * np.linalg.norm(image):
            basis = np.hstack([basis, new / np.linalg.norm(new)])
            images.append(A @ basis[:, -1:])
    return basis


def minimal(system: System) -> System:
    """Returns the system without the states that are not controllable or not observable.

    The poles of these states do not depend on the gain, even if they are on the stability boundary.
    An example is a position that drifts.
    """
    # Input and output are balanced together with the states.
    # With balanced states alone, a delay may appear unobservable.
    n = len(system.A)
    corner = np.zeros((len(system.C), system.B.shape[1]))
    scale = _core.balance(np.block([[system.A, system.B], [system.C, corner]]))
    scale = scale[:n] / scale[n]
    A: Matrix = system.A.astype(np.longdouble)
    B: Matrix = system.B.astype(np.longdouble)
    C: Matrix = system.C.astype(np.longdouble)
    A, B, C = A * scale / scale[:, None], B / scale[:, None], C * scale
    if not (B.any() and C.any()):
        A, B, C = np.zeros((0, 0)), np.zeros((0, B.shape[1])), np.zeros((len(C), 0))
    else:
        V = _reachable(A, B)
        A, B, C = V.T @ A @ V, V.T @ B, C @ V
        V = _reachable(A.T, C.T)
        A, B, C = V.T @ A @ V, V.T @ B, C @ V
    if len(A) == len(system.A):
        return system
    return replace(system, A=A, B=B, C=C, states=tuple(f"state {i}" for i in range(len(A))))


def plane(system: System) -> StateSpace:
    """Returns the balanced matrices (A, B, C, D) of a System with one input and one output as
    np.longdouble. The stability boundary is the imaginary axis. A sampled system is transformed to
    the variable w = (2/T) (z - 1)/(z + 1)."""
    A, B, C = (matrix.astype(np.longdouble) for matrix in system.balanced)
    D = system.D
    if system.dt is not None and len(A):
        one, rate = np.eye(len(A)), 2 / system.dt
        solved = _core.solve(A + one, np.hstack([A - one, B]))
        A, B, D = rate * solved[:, :-1], 2 * rate * solved[:, -1:], D - C @ solved[:, -1:]
        C = C @ _core.solve(one + system.balanced[0], one)
        A, B, C = System(A, B, C, D, (), ("",), ("",)).balanced
    return A, B, C, D


def response(system: System) -> _core.BoundaryResponse:
    """Returns a function that computes the response of a System at frequencies along the stability
    boundary. The System has one input and one output."""
    return _core.BoundaryResponse(
        system.A, system.B, system.C, float(system.D[0, 0]), system.dt or 0.0
    )


def marks(roots: Matrix, fastest: float) -> Matrix:
    """Returns positive frequencies in rad/s, on both sides of and between the given `roots`, which
    are frequencies of poles and zeros. `fastest`: largest magnitude of a pole in 1/s."""
    found = np.unique(roots[np.isfinite(roots) & (roots > 1e-15 * fastest)])
    # Of two equal roots, only one is used, because no frequency lies between them.
    found = found[np.diff(found, prepend=0.0) > 1e-9 * found]
    if not len(found):
        found = np.array([fastest or 1.0])
    middle = np.sqrt(found[:-1] * found[1:])
    # Rounding errors hide the response at a root, so frequencies near each root are added.
    around = [found * ratio for ratio in (0.3, 0.9, 1.1, 3)]
    return np.unique(np.concatenate([middle, *around]))
