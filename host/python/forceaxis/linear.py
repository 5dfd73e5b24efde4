"""The force loop of a model as a linear one: matrices, sampled with hold, and the gain limit."""

from dataclasses import dataclass

import numpy as np

from forceaxis import _core


@dataclass
class ForceLoop:
    """x' = A x + B code, reading = C x in 8-bit counts; `tick` and `held` are its sampled A and B.

    The law is code = -k_f reading, computed in the tick of the reading.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    tick: np.ndarray
    held: np.ndarray

    def poles(self, gain=0.0):
        """Poles in 1/s with the loop closed in continuous time (0: open loop)."""
        return np.linalg.eigvals(self.A - gain * self.B @ self.C)

    def sampled_poles(self, gain):
        """Poles in 1/s of the sampled loop with hold."""
        z = np.linalg.eigvals(self.tick - gain * self.held @ self.C)
        return np.log(z.astype(complex)) * _core.TICKS_PER_SECOND


def force_loop(model, overrides=None, modes=None):
    """The loop from code to force reading while the contacts touch (or in the modes named)."""
    m = _core.linear(str(model), overrides or {}, modes or {})
    A, B = m["A"], m["B"] * m["volts_per_code"]
    n = len(A)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n:] = A, B
    step = exponential(whole / _core.TICKS_PER_SECOND)
    return ForceLoop(A, B, m["reading"], step[:n, :n], step[:n, n:])


def exponential(matrix):
    """e^matrix by its series on a small enough part, squared."""
    halvings = max(0, int(np.ceil(np.log2(np.linalg.norm(matrix, 1) + 1e-300))) + 1)
    part = matrix / 2.0**halvings
    term = total = np.eye(len(matrix))
    for k in range(1, 20):
        term = term @ part / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


def gain_limit(loop, sampled=True, highest=1e4):
    """(gain, Hz) where the first pole leaves the stable region; (inf, nan): not up to `highest`."""
    poles = loop.sampled_poles if sampled else loop.poles

    def growth(gain):
        return poles(gain).real.max()

    gains = np.geomspace(1e-2, highest, 400)
    unstable = next((i for i, g in enumerate(gains) if growth(g) > 0), None)
    if unstable is None:
        return np.inf, np.nan
    low, high = (gains[unstable - 1] if unstable else 0.0), gains[unstable]
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (low, middle) if growth(middle) > 0 else (middle, high)
    last = poles(high)
    return float(high), float(abs(last[last.real.argmax()].imag) / (2 * np.pi))
