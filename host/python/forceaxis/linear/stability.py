"""Stability of a force loop: its critical gains, margins, root locus and step response.

A `Loop` is a law around a plant, as `loops.force_loop` makes it.
"""

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import linalg, optimize

from forceaxis import _core
from forceaxis.linear.bank import Bank
from forceaxis.linear.system import System
from forceaxis.linear.working import Working


@dataclass(frozen=True)
class Crossing:
    """A gain at which a closed-loop pole is on the stability boundary."""

    gain: float
    frequency_hz: float | None  # None: at infinity (continuous, direct path with negative sign)
    direction: int  # sign of Re ds/dk: 1 out of the stable region, -1 into it, 0 touches


@dataclass(frozen=True)
class Limit:
    """The largest stable gain from 0 on. `gain` None: stable at every gain."""

    gain: float | None
    frequency_hz: float | None
    crossings: list[Crossing]
    stable_ranges: list[tuple[float, float | None]]  # (from, to), to None: no upper end
    reason: str


@dataclass(frozen=True)
class Margins:
    """Margins at one gain."""

    gain_margin: float | None  # factor up to the next crossing above; None: none
    gain_reduction: float | None  # factor (< 1) down to the next crossing below; None: none
    phase_margin_deg: float | None  # smallest in size; None: |L| is nowhere 1
    crossover_hz: float | None  # where that is
    crossovers: list[tuple[float, float]]  # all (frequency_hz, phase_margin_deg)


def _reachable(A, B):
    """Orthonormal basis of the controllable states."""
    basis = B / np.linalg.norm(B)
    while basis.shape[1] < len(A):
        image = A @ basis[:, -1:]
        new = image - basis @ (basis.T @ image)
        new -= basis @ (basis.T @ new)
        if np.linalg.norm(new) <= 1e-11 * np.linalg.norm(image):
            break
        basis = np.hstack([basis, new / np.linalg.norm(new)])
    return basis


def _minimal(system):
    """Without the states that are not controllable or not observable.

    Their poles do not move with the gain, even on the boundary (a position that drifts).
    """
    # Balanced together with input and output; otherwise the state of a delay can look unobservable.
    n = len(system.A)
    whole = np.block([[system.A, system.B], [system.C, np.zeros((1, 1))]])
    scale = linalg.matrix_balance(whole, permute=False, separate=True)[1][0]
    scale = scale[:n] / scale[n]
    A, B, C = system.A * scale / scale[:, None], system.B / scale[:, None], system.C * scale
    if not (B.any() and C.any()):
        A, B, C = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    else:
        V = _reachable(A, B)
        A, B, C = V.T @ A @ V, V.T @ B, C @ V
        V = _reachable(A.T, C.T)
        A, B, C = V.T @ A @ V, V.T @ B, C @ V
    if len(A) == len(system.A):
        return system
    return replace(system, A=A, B=B, C=C, states=tuple(f"state {i}" for i in range(len(A))))


@dataclass
class Loop:
    """A law around a plant, without its gain k.

    whole: from the error, times k, to the feedback of the law and to the signal itself.
    unit: of k, V/N for a force. codes_per_gain: firmware gain (DAC codes per 8-bit count) per k.
    working: the mode that the plant is in.
    """

    model: str
    law: str
    timing: str
    whole: System
    signal: str
    unit: str
    codes_per_gain: float | None
    parameters: dict = field(default_factory=dict)
    bank: Bank | None = None
    own_gain: float | None = None  # k of the experiment that the loop is of
    working: Working = field(default_factory=lambda: Working({}))

    @cached_property
    def open(self):
        """L / k, one input and one output."""
        return self.whole.select(outputs=("feedback",))

    @property
    def dt(self):
        return self.whole.dt

    def firmware_gain(self, gain):
        """The firmware's force_gain, DAC codes per 8-bit count, of k = `gain`."""
        if self.codes_per_gain is None:
            raise _core.InputError("firmware gain: expected the loop of ADC 0's reading")
        return gain * self.codes_per_gain

    def gain_of(self, firmware_gain):
        """k of a firmware force_gain."""
        return firmware_gain / self.firmware_gain(1.0)

    def closed(self, gain):
        """From the set-point (in what is fed back: N) to the signal, with the loop closed."""
        A, B, C, D = self.whole.A, self.whole.B, self.whole.C, self.whole.D
        share = gain / (1 + gain * D[0, 0])  # of the set-point less C x in gain (r - C x - D u)
        return replace(
            self.whole,
            A=A - share * B @ C[:1],
            B=share * B,
            C=C[1:] - share * D[1:] @ C[:1],
            D=share * D[1:],
            inputs=("set-point",),
            outputs=self.whole.outputs[1:],
        )

    def sensitivity(self, gain):
        """S = 1 / (1 + k L), from the set-point to the error, of a loop closed at a gain."""
        A, B, C, D = self.open.A, self.open.B, self.open.C, 1 + gain * self.open.D
        share = gain / D[0, 0]
        return replace(self.open, A=A - share * B @ C, B=share * B, C=-C / D, D=1 / D)

    def closed_poles(self, gain):
        """Closed-loop poles, 1/s (of a sampled loop log(z) / T)."""
        return self.closed(gain).poles_s()

    # Critical gains are where L / k, on the boundary, is real and negative. A sampled loop is
    # mapped onto w = (2/T) (z - 1)/(z + 1), which takes the unit circle to the imaginary axis.

    @cached_property
    def _minimal(self):
        return _minimal(self.open)

    @cached_property
    def _plane(self):
        """(A, B, C, D) with the imaginary axis as boundary, balanced."""
        system = self._minimal
        A, B, C = system.balanced
        D = system.D
        if self.dt is not None:
            inverse = np.linalg.inv(A + np.eye(len(A)))
            A, D = (2 / self.dt) * inverse @ (A - np.eye(len(A))), D - C @ inverse @ B
            B, C = (4 / self.dt) * inverse @ B, C @ inverse
            plane = System(A, B, C, D, system.states, system.inputs, system.outputs)
            A, B, C = plane.balanced
        return A, B, C, D

    def _hz(self, w):
        if self.dt is None:
            return w / (2 * math.pi)
        return math.atan(w * self.dt / 2) / (math.pi * self.dt)

    def _point(self, w):
        """s or z at the frequency w of the plane."""
        w = np.asarray(w, float)
        if self.dt is None:
            return 1j * w
        half = 0.5j * w * self.dt
        return (1 + half) / (1 - half)

    def _at(self, w):
        return self._minimal.at(self._point(w))

    def _slope(self, w):
        """dG/ds at s = j w of the plane."""
        A, B, C, _ = self._plane
        matrix = 1j * w * np.eye(len(A)) - A
        return -(C @ np.linalg.solve(matrix, np.linalg.solve(matrix, B + 0j))).item()

    def _rounding(self, w):
        """The error of G by rounding of the matrices, at frequencies w (m,) of the plane."""
        A, B, C, D = self._plane
        size = np.linalg.norm(A)
        points = 1j * np.asarray(w, float) + 1e-16 * size  # not exactly on a pole
        matrices = points[:, None, None] * np.eye(len(A)) - A
        states = np.linalg.norm(np.linalg.solve(matrices, B + 0j), axis=(1, 2))
        rows = np.linalg.norm(np.linalg.solve(matrices.transpose(0, 2, 1), C.T + 0j), axis=(1, 2))
        return 1e-16 * (size * rows * states + abs(D[0, 0]))

    def _static_rounding(self, static):
        """What G(0) = `static` must exceed to be known to 1 %.

        G(0) is computed again with states in other units, which rounds everything differently: more
        than `_rounding` knows of where a pole and a zero at 0 Hz were removed.
        """
        n = len(self.open.A)
        apart = 0.0
        for turn in (0.618, 0.414, 0.732):
            scale = 1 + turn * np.arange(1, n + 1) % 1
            system = replace(
                self.open,
                A=self.open.A * scale / scale[:, None],
                B=self.open.B / scale[:, None],
                C=self.open.C * scale,
            )
            apart = max(apart, abs(_minimal(system).at(self._point(0.0)).real - static))
        return 100 * max(apart, self._rounding([0.0])[0])

    def _marks(self, zeros):
        """Frequencies of the plane between which the sign of a real function of w changes at most
        once, from estimates of its zeros in s; poles lie on none of the intervals' ends."""
        found = np.concatenate([np.abs(zeros.imag), np.abs(self._poles.imag)])
        found = np.unique(found[np.isfinite(found) & (found > 1e-9 * np.abs(self._poles).max())])
        if not len(found):
            found = np.array([np.abs(self._poles).max() or 1.0])
        middle = np.sqrt(found[:-1] * found[1:])
        around = [found * ratio for ratio in (0.3, 0.9, 1.1, 3)]  # where rounding hides the middle
        return np.unique(np.concatenate([middle, *around]))

    @cached_property
    def _poles(self):
        return linalg.eigvals(self._plane[0])

    @cached_property
    def _boundary_poles(self):
        """(frequency of the plane, how a small gain moves it or None) of each pole that is on the
        boundary without a gain, to rounding. None: a multiple pole."""
        A, B, C, _ = self._plane
        poles, left, right = linalg.eig(A, left=True)
        left = left.conj().T
        found = []
        for i in np.argsort(poles.imag):
            if abs(poles[i].real) <= 1e-12 * np.linalg.norm(A) and poles[i].imag >= 0:
                turn = left[i] @ right[:, i]  # of the eigenvectors, 0 where two poles are one
                move = -(left[i] @ B @ C @ right[:, i]) / turn if abs(turn) > 1e-6 else None
                found.append((float(poles[i].imag), move))
        return found

    @property
    def _at_gain_0(self):
        """Crossings at gain 0: simple poles of the plant that nothing damps."""
        found = [(w, move) for w, move in self._boundary_poles if move is not None]
        sideways = [abs(move.real) < 1e-9 * abs(move) for _, move in found]
        return [
            Crossing(0.0, self._hz(w), 0 if along else int(np.sign(move.real)))
            for (w, move), along in zip(found, sideways, strict=True)
        ]

    def _phase(self, w):
        """Sine of the phase of G: 0 where G is real, and on a pole."""
        G = self._at(w)
        return G.imag / np.abs(G) if np.isfinite(G) else 0.0

    @cached_property
    def _real_points(self):
        """Zeros of G(s) - G(-s), which on the axis are where G is real."""
        A, B, C, _ = self._plane
        n = len(A)
        B, C = (m * (np.linalg.norm(A) / np.linalg.norm(m)) for m in (B, C))
        zero = np.zeros((n, n))
        pencil = np.block([[A, zero, B], [zero, -A, B], [C, C, np.zeros((1, 1))]])
        weight = np.diag([1.0] * (2 * n) + [0.0])
        values = linalg.eigvals(pencil, weight)
        # What is at infinity comes out as large: as many as the relative degree says, which is odd.
        degree = System(A, B, C, np.zeros((1, 1)), (), ("",), ("",))._markov()[0]
        finite = 2 * n - degree - (degree + 1) % 2
        values = values[np.isfinite(values)]
        return values[np.argsort(np.abs(values))][: max(finite, 0)]

    def crossings(self):
        """All gains > 0 at which a closed-loop pole is on the boundary, smallest first.

        There G is real and negative, k = -1 / G. Where it is real is an eigenvalue problem, which
        misses nothing; each point is then refined on G itself. An axis that G never leaves
        (nothing is damped) has no crossings.
        """
        return list(self._crossings)

    @cached_property
    def _crossings(self):
        if not len(self._minimal.A):
            return []
        zeros = self._real_points
        grid = self._marks(zeros)
        G, rounding = self._at(grid), self._rounding(grid)
        values = G.imag
        known = np.abs(values) > rounding
        grid, values = grid[known], values[known]
        if not len(grid):
            return []
        found = []
        for i in np.flatnonzero(values[:-1] * values[1:] < 0):
            w = optimize.brentq(self._phase, grid[i], grid[i + 1], xtol=1e-300, rtol=1e-15)
            found.append((w, int(np.sign(values[i + 1]))))
        for zero in zeros:  # pairs that touch the axis
            w = abs(zero.imag)
            if abs(zero.real) < 1e-5 * w and grid[0] < w < grid[-1]:
                i = np.searchsorted(grid, w) - 1
                ends = [self._slope(grid[j]).real for j in (i, i + 1)]
                if values[i] * values[i + 1] > 0 and ends[0] * ends[1] < 0:
                    w = optimize.brentq(
                        lambda w: self._slope(w).real, grid[i], grid[i + 1], xtol=1e-300, rtol=1e-15
                    )
                    if abs(self._phase(w)) < 1e-11:
                        found.append((w, 0))
        crossings = []
        for w, direction in dict.fromkeys(found):
            if any(abs(w - pole) < 1e-9 * w for pole, _ in self._boundary_poles):
                continue  # the pole turns the phase, at no gain
            w, value = self._polished(w)
            # A zero on the axis turns the phase too, at an infinite gain; a gain that rounding
            # decides is left out.
            sharp = abs(w * self._slope(w)) > 1e9 * abs(value)
            if value < 0 and not sharp and self._rounding([w])[0] < 0.1 * abs(value):
                crossings.append(Crossing(float(-1 / value), self._hz(w), direction))
        # The ends of the axis: s = 0 unless there is an integrator; infinity, z = -1.
        A, _, _, D = self._plane
        least = -1e-11 * np.median(np.abs(G[known]))
        if np.abs(self._poles).min() > 1e-13 * len(A) * np.linalg.norm(A):
            static = self._at(0.0).real
            if static < -self._static_rounding(static):  # less is a zero there
                crossings.append(Crossing(float(-1 / static), 0.0, int(np.sign(values[0]))))
        if D[0, 0] < least:
            end = None if self.dt is None else 0.5 / self.dt
            crossings.append(Crossing(float(-1 / D[0, 0]), end, -int(np.sign(values[-1]))))
        return sorted(crossings, key=lambda c: c.gain)

    def _polished(self, w):
        """(w, Re G) of a real point, by steps on a dense solve: more digits than the kernel's where
        G is far below its largest."""
        A, B, C = self._minimal.balanced
        value = 0.0
        for _ in range(3):
            point = complex(self._point(w))
            G = (
                self._minimal.D[0, 0]
                + (C @ np.linalg.solve(point * np.eye(len(A)) - A, B.astype(complex))).item()
            )
            value = G.real
            slope = (1j * self._slope(w)).imag  # dIm G / dw
            if not slope or not abs(G.imag / slope) < 1e-4 * w:
                break  # touches, or too flat to step
            w -= G.imag / slope
        return w, value

    def stable(self, gain):
        """Whether the closed loop is stable, apart from states that are not in the loop."""
        A = self._closed_minimal(gain)
        poles = linalg.eigvals(A)
        rounding = 1e-15 * len(A) * max(np.linalg.norm(A), 1.0)
        return bool(np.all((poles.real if self.dt is None else np.abs(poles) - 1) < -rounding))

    def decay(self, gain):
        """1/s: decay rate of the slowest pole in the loop; < 0 if it grows."""
        poles = linalg.eigvals(self._closed_minimal(gain)).astype(complex)
        if self.dt is None:
            return float(-poles.real.max())
        return float(-math.log(np.abs(poles).max()) / self.dt)

    def _closed_minimal(self, gain):
        A, B, C = self._minimal.balanced
        return A - gain / (1 + gain * self._minimal.D[0, 0]) * B @ C

    @cached_property
    def stable_ranges(self):
        """Gains (from, to) between which the loop is stable; to None: no upper end."""
        if not len(self._minimal.A):
            return [(0.0, None)]
        edges = [0.0, *(c.gain for c in self._crossings)]
        if len(edges) == 1:
            typical = np.median(np.abs(self._at(np.abs(self._poles) + 1e-3)))
            return [(0.0, None)] if self.stable(1 / typical) else []
        ranges = []
        for low, high in zip(edges, [*edges[1:], None], strict=True):
            if high is not None and high <= low:
                continue
            # Anywhere within: all or none of it is stable, but rounding may hide it at high gains.
            if high is None:
                inside = [2 * low, 10 * low]
            else:
                inside = [low + share * (high - low) for share in (0.5, 0.01, 1e-4, 1e-6)]
            if any(self.stable(gain) for gain in inside):
                ranges.append((low, high))
        return ranges

    def limit(self):
        """The smallest gain at which stability is lost on the way from 0, with all crossings; where
        that is 0 also the plant's own poles on the boundary, as crossings at gain 0."""
        crossings, ranges = self.crossings(), self.stable_ranges
        if not ranges or ranges[0][0] > 0:
            reason = "unstable at any small gain" if ranges else "stable at no gain"
            return Limit(0.0, None, self._at_gain_0 + crossings, ranges, reason)
        if ranges[0][1] is None:
            return Limit(None, None, crossings, ranges, "stable at every gain")
        first = next(c for c in crossings if c.gain == ranges[0][1])
        return Limit(first.gain, first.frequency_hz, crossings, ranges, "")

    def margins(self, gain):
        """Margins of the loop at a gain that it is stable at."""
        if not len(self._minimal.A):
            return Margins(None, None, None, None, [])
        gains = [c.gain for c in self._crossings]
        above = min((g for g in gains if g > gain), default=None)
        below = max((g for g in gains if g < gain), default=None)
        A, B, C, D = self._plane
        # Zeros of 1 - k^2 G(s) G(-s): poles of that product with its output fed back.
        share = gain**2 / (1 - gain**2 * D[0, 0] ** 2)
        product = np.block(
            [
                [A + share * D * B @ C, -share * B @ C],
                [B @ C + share * D**2 * B @ C, -A - share * D * B @ C],
            ]
        )
        grid = self._marks(linalg.eigvals(product))

        def size(w):
            return np.log(gain * np.abs(self._at(w)))

        values = size(grid)
        crossovers = []
        for i in np.flatnonzero(values[:-1] * values[1:] < 0):
            w = optimize.brentq(size, grid[i], grid[i + 1], xtol=1e-300, rtol=1e-15)
            phase = float(np.degrees(np.angle(-self._at(w))))
            crossovers.append((self._hz(w), phase))
        crossover, phase = min(crossovers, key=lambda c: abs(c[1]), default=(None, None))
        return Margins(above and above / gain, below and below / gain, phase, crossover, crossovers)

    def step(self, gain, duration_s):
        """(time_s, signal): from rest, after a unit step of the set-point, every 1/1500 s or tick.

        The set-point is f_d; of stiffness K_fs x_d, of damping K_fd v_d. Exact at these times."""
        closed = self.closed(gain)
        if self.dt is None:
            closed = closed.sampled()
        time_s = np.arange(math.floor(duration_s / closed.dt) + 1) * closed.dt
        x, y = np.zeros(len(closed.A)), np.empty(len(time_s))
        with np.errstate(over="ignore", invalid="ignore"):  # an unstable one may leave the range
            for i in range(len(time_s)):
                y[i] = closed.C[0] @ x + closed.D[0, 0]
                x = closed.A @ x + closed.B[:, 0]
        return time_s, y

    def locus(self, gains, plane="s"):
        """Closed-loop poles at rising gains, (len(gains), poles), each column one branch.

        1/s, or z of a sampled loop with plane "z". A branch that leaves z = 0 starts at -inf in s.
        """

        def poles(gain):
            return self.closed(gain).poles().astype(complex)

        def follow(before, low, high, depth):
            after = poles(high)
            move = np.abs(before[:, None] - after)
            after = after[optimize.linear_sum_assignment(move)[1]]
            apart = np.abs(before[:, None] - before) + np.diag(np.full(len(before), np.inf))
            if not depth or np.all(
                np.abs(after - before) < 0.3 * apart.min(axis=1, initial=np.inf)
            ):
                return after
            middle = (low + high) / 2
            return follow(follow(before, low, middle, depth - 1), middle, high, depth - 1)

        rows = [poles(gains[0])]
        for low, high in itertools.pairwise(gains):
            rows.append(follow(rows[-1], low, high, 8))
        rows = np.array(rows)
        if self.dt is None or plane == "z":
            return rows
        with np.errstate(divide="ignore"):
            return np.log(rows) / self.dt
