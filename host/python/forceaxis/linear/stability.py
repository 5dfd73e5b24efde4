"""Stability of a force loop: its critical gains, margins, root locus and step response.

A `Loop` is a law around a plant, as `loops.force_loop` makes it. Every figure is read from the
response along the boundary, each value of which is right to the rounding of single entries of the
matrices (`_core.BoundaryResponse`); eigenvalues only tell where to look.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, optimize

from forceaxis import _core
from forceaxis.linear.bank import Bank, StateSpace
from forceaxis.linear.boundary import marks, minimal, plane, response
from forceaxis.linear.system import TICK_S, Matrix, System
from forceaxis.linear.working import Working
from forceaxis.words import plain

# A crossing counts where rounding of the matrices' entries, in double, moves its gain by less: then
# the gain of these matrices is known a thousand times better.
KNOWN = 1e-7
GAIN_MAX = 1e15  # of a loop


def known_text(known_to: float, unit: str) -> str:
    """The gain up to which nothing happens to a loop as far as is known, and why no further."""
    return f"{plain(known_to)} {unit}".rstrip() + ", above which rounding decides"


@dataclass(frozen=True)
class Crossing:
    """A gain at which a closed-loop pole is on the stability boundary."""

    gain: float
    frequency_hz: float | None  # None: at infinity (continuous, direct path with negative sign)
    direction: int  # sign of Re ds/dk: 1 out of the stable region, -1 into it, 0 touches


@dataclass(frozen=True)
class Limit:
    """The largest stable gain from 0 on. `gain` None: stable at every gain, or up to `known_to`."""

    gain: float | None
    frequency_hz: float | None
    crossings: list[Crossing]
    stable_ranges: list[tuple[float, float | None]]  # (from, to), to None: no upper end
    reason: str
    known_to: float | None = None  # gain above which rounding decides; None: it decides nowhere

    @property
    def stable_to(self) -> float | None:
        """The gain up to which the loop is known to be stable; None: it is at every gain."""
        return self.known_to if self.gain is None else self.gain


@dataclass(frozen=True)
class Margins:
    """Margins at one gain. `gain_margin` None: no crossing above, or none up to `known_to`."""

    gain_margin: float | None  # factor up to the next crossing above
    gain_reduction: float | None  # factor (< 1) down to the next crossing below; None: none
    phase_margin_deg: float | None  # smallest in size; None: |L| is nowhere 1
    crossover_hz: float | None  # where that is
    crossovers: list[tuple[float, float]]  # all (frequency_hz, phase_margin_deg)
    known_to: float | None = None  # factor above which rounding decides; None: it decides nowhere


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
    parameters: dict[str, float] = field(default_factory=dict)
    bank: Bank | None = None
    own_gain: float | None = None  # k of the experiment that the loop is of
    working: Working = field(default_factory=lambda: Working({}))

    @cached_property
    def open(self) -> System:
        """L / k, one input and one output."""
        return self.whole.select(outputs=("feedback",))

    @property
    def dt(self) -> float | None:
        """Sampling period, s; None: continuous."""
        return self.whole.dt

    def firmware_gain(self, gain: float) -> float:
        """The firmware's force_gain, DAC codes per 8-bit count, of k = `gain`."""
        if self.codes_per_gain is None:
            raise _core.InputError("firmware gain: expected the loop of ADC 0's reading")
        return gain * self.codes_per_gain

    def gain_of(self, firmware_gain: float) -> float:
        """k of a firmware force_gain."""
        return firmware_gain / self.firmware_gain(1.0)

    def closed(self, gain: float) -> System:
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

    def sensitivity(self, gain: float) -> System:
        """S = 1 / (1 + k L), from the set-point to the error, of a loop closed at a gain."""
        A, B, C, D = self.open.A, self.open.B, self.open.C, 1 + gain * self.open.D
        share = gain / D[0, 0]
        return replace(self.open, A=A - share * B @ C, B=share * B, C=-C / D, D=1 / D)

    def closed_poles(self, gain: float) -> Matrix:
        """Closed-loop poles, 1/s (of a sampled loop log(z) / T)."""
        return self.closed(gain).poles_s()

    # Critical gains are where L / k, on the boundary, is real and negative. A sampled loop is
    # mapped onto w = (2/T) (z - 1)/(z + 1), which takes the unit circle to the imaginary axis.

    @cached_property
    def _minimal(self) -> System:
        return minimal(self.open)

    @cached_property
    def _plane(self) -> StateSpace:
        """(A, B, C, D) with the imaginary axis as boundary, balanced."""
        return plane(self._minimal)

    def hz(self, w: float) -> float:
        """The frequency, Hz, of a frequency w of the plane, rad/s."""
        if self.dt is None:
            return w / (2 * math.pi)
        return math.atan(w * self.dt / 2) / (math.pi * self.dt)

    @cached_property
    def _boundary(self) -> _core.BoundaryResponse:
        return response(self.open)

    @cached_property
    def _boundary_minimal(self) -> _core.BoundaryResponse:
        return response(self._minimal)

    def _known(self, w: ArrayLike) -> tuple[Matrix, Matrix, Matrix]:
        """(G, dG/dw, by how much rounding of the matrices' entries moves G) at frequencies w of the
        plane, each like w in shape."""
        at = np.asarray(w, float)
        # Only at rest a pole that nothing sees is in the way.
        whole = self._boundary if np.all(at) else self._boundary_minimal
        G, slope, rounding = (values.reshape(at.shape) for values in whole(at.ravel()))
        return G, slope, rounding

    def _at(self, w: ArrayLike) -> Matrix:
        return self._known(w)[0]

    def _static_rounding(self, static: float) -> float:
        """What G(0) = `static` must exceed to be known to 1 %; infinite of an integrator.

        G(0) is computed again with states in other units, which rounds everything differently: more
        than `_known` knows of where a pole and a zero at 0 Hz were removed.
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
            apart = max(apart, abs(response(minimal(system))([0.0])[0].item().real - static))
        return float(100 * max(apart, self._known(0.0)[2].item()))

    def _marks(self, zeros: Matrix) -> Matrix:
        """Frequencies of the plane between which the sign of a real function of w changes at most
        once, from estimates of its zeros in s; poles lie on none of the intervals' ends."""
        found = np.concatenate([np.abs(zeros.imag), np.abs(self._poles.imag), np.abs(self._poles)])
        return marks(found, np.abs(self._poles).max())

    @cached_property
    def _poles(self) -> Matrix:
        result: Matrix = _core.eigenvalues(self._plane[0])
        return result

    @cached_property
    def _boundary_poles(self) -> list[tuple[float, complex | None]]:
        """(frequency of the plane, how a small gain moves it or None) of each pole that is on the
        boundary without a gain, to rounding. None: a multiple pole."""
        A, B, C, _ = self._plane
        size = np.linalg.norm(A)
        there = np.abs(self._poles.real) <= np.maximum(1e-12 * np.abs(self._poles), 1e-17 * size)
        there = np.sort(self._poles[there & (self._poles.imag >= 0)].imag)
        if not len(there):
            return []
        poles, left, right = linalg.eig(A.astype(float), left=True)
        left = left.conj().T
        found = []
        for w in there:
            i = np.argmin(np.abs(poles - 1j * w))
            turn = left[i] @ right[:, i]  # of the eigenvectors, 0 where two poles are one
            move = -(left[i] @ B @ C @ right[:, i]) / turn if abs(turn) > 1e-6 else None
            found.append((float(w), None if move is None else complex(move)))
        return found

    @property
    def _at_gain_0(self) -> list[Crossing]:
        """Crossings at gain 0: simple poles of the plant that nothing damps."""
        found = [(w, move) for w, move in self._boundary_poles if move is not None]
        sideways = [abs(move.real) < 1e-9 * abs(move) for _, move in found]
        return [
            Crossing(0.0, self.hz(w), 0 if along else int(np.sign(move.real)))
            for (w, move), along in zip(found, sideways, strict=True)
        ]

    def _phase(self, w: float) -> float:
        """Sine of the phase of G: 0 where G is real or 0, and on a pole."""
        G = self._at(w)
        return float(G.imag / np.abs(G)) if np.isfinite(G) and G else 0.0

    def _turn(self, w: float) -> float:
        """d Im G / dw."""
        return float(self._known(w)[1].imag)

    @cached_property
    def _real_points(self) -> Matrix:
        """Zeros of G(s) - G(-s), which on the axis are where G is real."""
        A, B, C, _ = self._plane
        zero = np.zeros((len(A), len(A)))
        both = System(
            np.block([[A, zero], [zero, -A]]), np.vstack([B, B]), np.hstack([C, C]),
            np.zeros((1, 1)), (), ("",), ("",),
        )  # fmt: skip
        return both.zeros() if both.has_path() else np.zeros(0, complex)

    def crossings(self) -> list[Crossing]:
        """All gains > 0 at which a closed-loop pole is on the boundary, smallest first.

        There G is real and negative, k = -1 / G. Where it is real is an eigenvalue problem, which
        misses nothing; each point is then refined on G itself. An axis that G never leaves
        (nothing is damped) has no crossings.
        """
        return list(self._crossings)

    @property
    def _crossings(self) -> list[Crossing]:
        return self._crossed[0]

    @cached_property
    def _crossed(self) -> tuple[list[Crossing], float | None]:
        """(all crossings up to the gain above which rounding decides, that gain or None)."""
        if not len(self._minimal.A):
            return [], None
        zeros = self._real_points
        grid = self._marks(zeros)
        G, _, rounding = self._known(grid)
        known = np.abs(G.imag) > rounding
        doubts = [self._drowned(grid, G, rounding, known)]
        grid, values = grid[known], G.imag[known]
        if not len(grid):
            return [], None
        found = [
            (self._root(self._phase, grid[i], grid[i + 1]), int(np.sign(values[i + 1])))
            for i in np.flatnonzero(values[:-1] * values[1:] < 0)
        ] + self._touches(zeros, grid, values)
        crossings = self._ends(values, -1e-11 * np.median(np.abs(G[known])))
        for w, direction in dict.fromkeys(found):
            if any(abs(w - pole) < 1e-9 * w for pole, _ in self._boundary_poles):
                continue  # the pole turns the phase, at no gain
            G, slope, rounding = self._known(w)
            value = G.real
            if abs(G.imag) < 1e-12 * w * abs(slope.imag):  # w has the digits of a double only
                value -= slope.real * G.imag / slope.imag
            # A zero on the axis turns the phase too, at an infinite gain.
            if value >= 0 or abs(w * slope) > 1e9 * abs(value):
                continue
            if rounding < KNOWN * abs(value):
                crossings.append(Crossing(float(-1 / value), self.hz(w), direction))
            else:
                doubts.append(float(1 / (abs(value) + rounding)))
        doubt = float(min(doubts))
        crossings = sorted((c for c in crossings if c.gain < doubt), key=lambda c: c.gain)
        return crossings, doubt if doubt < GAIN_MAX else None

    def _drowned(self, grid: Matrix, G: Matrix, rounding: Matrix, known: Matrix) -> float:
        """The least gain of a crossing that would not be seen: where rounding hides the sign of
        Im G and more of G than KNOWN, from where it begins to."""
        hidden = rounding > KNOWN * np.abs(G)
        gains = 1 / (np.abs(G) + rounding)
        least = math.inf
        for i in np.flatnonzero(hidden & ~known):
            least = min(least, gains[i])
            for j in (i - 1, i + 1):
                if not (0 <= j < len(grid) and known[j]):
                    continue
                clear, drowned = grid[j], grid[i]
                for _ in range(0 if hidden[j] else 40):
                    middle = math.sqrt(clear * drowned)
                    value, _, moved = self._known(middle)
                    if moved > KNOWN * abs(value):
                        drowned = middle
                    else:
                        clear = middle
                value, _, moved = self._known(clear)
                least = min(least, 1 / (abs(value) + moved))
        return least

    def _root(self, of: Callable[[float], float], low: float, high: float) -> float:
        return float(optimize.brentq(of, low, high, xtol=1e-300, rtol=1e-15))

    def _touches(self, zeros: Matrix, grid: Matrix, values: Matrix) -> list[tuple[float, int]]:
        """Pairs of zeros of Im G on the axis: [(w, 0)]. values: Im G of the grid."""
        found = []
        for zero in zeros:
            w = abs(zero.imag)
            if abs(zero.real) < 1e-5 * w and grid[0] < w < grid[-1]:
                i = np.searchsorted(grid, w) - 1
                ends = [self._turn(grid[j]) for j in (i, i + 1)]
                if values[i] * values[i + 1] > 0 and ends[0] * ends[1] < 0:
                    w = self._root(self._turn, grid[i], grid[i + 1])
                    if abs(self._phase(w)) < 1e-11:
                        found.append((w, 0))
        return found

    def _ends(self, values: Matrix, least: float) -> list[Crossing]:
        """Crossings at the ends of the axis: s = 0 unless there is an integrator; infinity, z = -1.
        values: Im G of the grid; least: a direct path that is more than rounding."""
        crossings = []
        static = float(self._at(0.0).real)
        if -math.inf < static < 0 and static < -self._static_rounding(static):  # less is a zero
            crossings.append(Crossing(-1 / static, 0.0, int(np.sign(values[0]))))
        direct = float(self._plane[3][0, 0])
        if direct < least:
            end = None if self.dt is None else 0.5 / self.dt
            crossings.append(Crossing(-1 / direct, end, -int(np.sign(values[-1]))))
        return crossings

    def stable(self, gain: float) -> bool:
        """Whether the closed loop is stable, apart from states that are not in the loop."""
        A = self._closed_minimal(gain)
        poles = _core.eigenvalues(A)
        rounding = 1e-18 * len(A) * max(float(np.linalg.norm(A)), 1.0)
        return bool(np.all((poles.real if self.dt is None else np.abs(poles) - 1) < -rounding))

    def decay(self, gain: float) -> float:
        """1/s: decay rate of the slowest pole in the loop; < 0 if it grows."""
        poles = _core.eigenvalues(self._closed_minimal(gain))
        if self.dt is None:
            return float(-poles.real.max())
        return float(-math.log(np.abs(poles).max()) / self.dt)

    def _closed_minimal(self, gain: float) -> Matrix:
        system = self._minimal
        A = system.A.astype(np.longdouble)
        A = A - gain / (1 + gain * system.D[0, 0]) * system.B @ system.C
        scale = _core.balance(A)
        result: Matrix = A * scale / scale[:, None]
        return result

    @cached_property
    def stable_ranges(self) -> list[tuple[float, float | None]]:
        """Gains (from, to) between which the loop is stable; to None: no upper end."""
        if not len(self._minimal.A):
            return [(0.0, None)]
        crossings, known_to = self._crossed
        edges = [0.0, *(c.gain for c in crossings)]
        if len(edges) == 1:
            typical = np.median(np.abs(self._at(np.abs(self._poles) + 1e-3)))
            return [(0.0, known_to)] if self.stable(1 / typical) else []
        ranges = []
        for low, high in zip(edges, [*edges[1:], known_to], strict=True):
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

    def limit(self) -> Limit:
        """The smallest gain at which stability is lost on the way from 0, with all crossings; where
        that is 0 also the plant's own poles on the boundary, as crossings at gain 0."""
        crossings, ranges = self.crossings(), self.stable_ranges
        if not ranges or ranges[0][0] > 0:
            reason = "unstable at any small gain" if ranges else "stable at no gain"
            return Limit(0.0, None, self._at_gain_0 + crossings, ranges, reason)
        known_to = self._crossed[1]
        if ranges[0][1] == known_to:
            reason = "stable at every gain"
            if known_to is not None:
                reason = f"stable up to {known_text(known_to, self.unit)}"
            return Limit(None, None, crossings, ranges, reason, known_to)
        first = next(c for c in crossings if c.gain == ranges[0][1])
        return Limit(first.gain, first.frequency_hz, crossings, ranges, "")

    def margins(self, gain: float) -> Margins:
        """Margins of the loop at a gain that it is stable at."""
        if not len(self._minimal.A):
            return Margins(None, None, None, None, [])
        crossings, known_to = self._crossed
        gains = [c.gain for c in crossings]
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
        grid = self._marks(_core.eigenvalues(product))

        def size(w: ArrayLike) -> Any:
            return np.log(gain * np.abs(self._at(w)))

        values = size(grid)
        crossovers = []
        for i in np.flatnonzero(values[:-1] * values[1:] < 0):
            w = self._root(size, grid[i], grid[i + 1])
            phase = float(np.degrees(np.angle(-self._at(w))))
            crossovers.append((self.hz(w), phase))
        none: tuple[float | None, float | None] = None, None
        crossover, margin_deg = min(crossovers, key=lambda c: abs(c[1])) if crossovers else none
        known = None if above or known_to is None else known_to / gain
        return Margins(
            above and above / gain, below and below / gain, margin_deg, crossover, crossovers, known
        )

    def step(self, gain: float, duration_s: float) -> tuple[Matrix, Matrix]:
        """(time_s, signal): from rest, after a unit step of the set-point, every 1/1500 s or tick.

        The set-point is f_d; of stiffness K_fs x_d, of damping K_fd v_d. Exact at these times."""
        closed = self.closed(gain)
        if self.dt is None:
            closed = closed.sampled()
        period_s = closed.dt or TICK_S
        time_s = np.arange(math.floor(duration_s / period_s) + 1) * period_s
        A, B, C, D = (getattr(closed, name).astype(float) for name in "ABCD")
        x, y = np.zeros(len(A)), np.empty(len(time_s))
        with np.errstate(over="ignore", invalid="ignore"):  # an unstable one may leave the range
            for i in range(len(time_s)):
                y[i] = C[0] @ x + D[0, 0]
                x = A @ x + B[:, 0]
        return time_s, y

    def locus(self, gains: Matrix, plane: str = "s") -> Matrix:
        """Closed-loop poles at rising gains, (len(gains), poles), each column one branch.

        1/s, or z of a sampled loop with plane "z". A branch that leaves z = 0 starts at -inf in s.
        """

        def poles(gain: float) -> Matrix:
            return self.closed(gain).poles().astype(complex)

        def follow(before: Matrix, low: float, high: float, depth: int) -> Matrix:
            unordered = poles(high)
            move = np.abs(before[:, None] - unordered)
            after: Matrix = unordered[optimize.linear_sum_assignment(move)[1]]
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
        branches: Matrix = np.array(rows)
        if self.dt is not None and plane != "z":
            with np.errstate(divide="ignore"):
                branches = np.log(branches) / self.dt
        return branches
