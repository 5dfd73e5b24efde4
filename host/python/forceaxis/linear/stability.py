"""Stability of a force loop: critical gain, margins, root locus and step response.

A `Loop` is a control law around a plant, as `loops.force_loop` makes it. Critical gain and margins
are computed from the response of the loop along the stability boundary (`_core.BoundaryResponse`).
The error of this response is only that of rounding each entry of the matrices. Eigenvalues only
tell at which frequencies to compute the response.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, optimize

from forceaxis import _core
from forceaxis.linear.bank import Bank
from forceaxis.linear.boundary import marks, minimal, plane, response
from forceaxis.linear.equations import Matrix, StateSpace
from forceaxis.linear.system import TICK_S, System
from forceaxis.linear.working import Working
from forceaxis.words import plain

# Largest relative change of a crossing's gain that rounding of the matrix entries may cause.
# Crossings of the stability boundary with a larger change of the gain are not reported.
GAIN_CHANGE_MAX = 1e-7
GAIN_MAX = 1e15  # largest gain k of a force loop that is analysed
# Gain, divided by the loop's typical gain, below which a gain is too small for every useful law.
# At very small gains, rounding decides whether a loop with two integrators is stable.
NEGLIGIBLE_GAIN = 1e-9
# Magnitude in 1/s below which a pole is an integrator, apart from rounding errors.
SLOWEST_POLE_RAD_PER_S = 1e-3
# Gains, relative to the typical gain, at which the result "no limit" is checked.
CHECKED_GAINS = 10.0 ** np.arange(-10, 7)
# Factor from one gain to the next gain of a search.
# A search does not detect two changes between stable and unstable within one step of the gain.
GAIN_STEP_FACTOR = 1.1
GAINS_AT_ONCE = 24  # number of gains that a search evaluates together
ROUNDED_AGAIN = 3  # number of additional roundings of a matrix that show the effect of rounding
# At this relative distance from a gain limit, the loop must clearly be stable or unstable.
EDGE_SHARE = 1e-7


def known_text(known_to: float, unit: str) -> str:
    """Returns a text with the gain `known_to` in `unit`. Up to this gain, no closed-loop pole
    crosses the stability boundary. Above it, rounding errors are too large for a statement."""
    return f"{plain(known_to)} {unit}".rstrip() + ", above which rounding decides"


@dataclass(frozen=True)
class Crossing:
    """A crossing of the stability boundary: the gain at which a closed-loop pole is on it."""

    gain: float
    # Frequency of the crossing in Hz.
    # The frequency is None for a pole at infinity (continuous loop with a negative direct path).
    frequency_hz: float | None
    # Direction in which the pole moves as the gain rises.
    # 1: the pole becomes unstable. -1: the pole becomes stable. 0: it only touches the boundary.
    direction: int


@dataclass(frozen=True)
class Limit:
    """The gain limit of a force loop: the gain at which the loop becomes unstable as the gain rises
    from 0. `gain` is None if the loop is stable at every gain, or at every gain up to
    `known_to`."""

    gain: float | None
    frequency_hz: float | None
    crossings: list[Crossing]
    # Ranges of stable gains as (from, to). `to` is None if the range has no upper end.
    stable_ranges: list[tuple[float, float | None]]
    reason: str
    # Gain above which rounding errors hide crossings of the stability boundary, or None.
    known_to: float | None = None

    @property
    def stable_to(self) -> float | None:
        """The gain up to which the force loop is known to be stable. None if the loop is stable at
        every gain."""
        return self.known_to if self.gain is None else self.gain


@dataclass(frozen=True)
class Crossover:
    """A frequency at which the magnitude of the loop gain is 1, and the phase margin at this
    frequency."""

    frequency_hz: float
    phase_margin_deg: float


@dataclass(frozen=True)
class Margins:
    """Gain margins and phase margins of a force loop at one gain.

    gain_margin: gain factor up to the next crossing above the gain, or None if there is none. If
    known_to is given, there is none up to this factor. gain_reduction: gain factor (< 1) down to
    the next crossing below the gain, or None. phase_margin_deg: the phase margin with the smallest
    magnitude, at crossover_hz. It is None if |L| is nowhere 1. crossovers: all frequencies at which
    |L| is 1. known_to: gain factor above which rounding errors hide crossings, or None.
    """

    gain_margin: float | None = None
    gain_reduction: float | None = None
    phase_margin_deg: float | None = None
    crossover_hz: float | None = None
    crossovers: list[Crossover] = field(default_factory=list)
    known_to: float | None = None


@dataclass
class Loop:
    """A force loop without its gain k: a control law around a plant.

    whole: system whose input is the error multiplied by k. Its outputs are the feedback of the law
    and the controlled signal. unit: unit of k, V/N for a force. codes_per_gain: firmware gain in
    DAC codes per 8-bit count for k = 1. working: states of the elements of the plant.
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
    own_gain: float | None = None  # gain k of the loop's experiment
    working: Working = field(default_factory=lambda: Working({}))
    # Effects of a constant set-point on the states and on the feedback of a loop over a bus.
    # The set-point effects are None if the set-point acts on the loop as the error does.
    entry: tuple[Matrix, Matrix] | None = None

    @cached_property
    def open(self) -> System:
        """The loop gain divided by k, as a System with one input and one output."""
        return self.whole.select(outputs=("feedback",))

    @property
    def dt(self) -> float | None:
        """Sampling period of the force loop in s; None for a continuous loop."""
        return self.whole.dt

    def firmware_gain(self, gain: float) -> float:
        """Returns the `force_gain` of the firmware, in DAC codes per 8-bit count, for a gain k of
        the loop. Raises InputError if the loop does not feed back the signal of ADC 0."""
        if self.codes_per_gain is None:
            raise _core.InputError(
                "firmware gain: expected a loop that controls the signal of ADC channel 0, got a "
                "loop of another signal; use the gain k of this loop instead"
            )
        return gain * self.codes_per_gain

    def optional_firmware_gain(self, gain: float | None) -> float | None:
        """Returns firmware_gain(gain). Returns None if the gain is None or 0, or if the loop does
        not feed back the signal of ADC 0."""
        return self.firmware_gain(gain) if gain and self.codes_per_gain is not None else None

    def gain_of(self, firmware_gain: float) -> float:
        """Returns the gain k of the loop for a `force_gain` of the firmware, in DAC codes per 8-bit
        count. Raises InputError if the loop does not feed back the signal of ADC 0."""
        return firmware_gain / self.firmware_gain(1.0)

    def closed(self, gain: float) -> System:
        """Returns the closed loop at a gain k, as a System from the set-point to the controlled
        signal. The set-point has the unit of the feedback (N for a force)."""
        A, B, C, D = self.whole.A, self.whole.B, self.whole.C, self.whole.D
        # The input of the plant with the set-point r is u = gain (r - C x - D u) = share (r - C x).
        share = gain / (1 + gain * D[0, 0])
        return replace(
            self.whole,
            A=A - share * B @ C[:1],
            B=share * B if self.entry is None else self.entry[0] - share * B @ self.entry[1],
            C=C[1:] - share * D[1:] @ C[:1],
            D=share * D[1:],
            inputs=("set-point",),
            outputs=self.whole.outputs[1:],
        )

    def sensitivity(self, gain: float) -> System:
        """Returns the sensitivity function S = 1 / (1 + k L) at a gain k, as a System from the
        set-point to the error."""
        A, B, C, D = self.open.A, self.open.B, self.open.C, 1 + gain * self.open.D
        share = gain / D[0, 0]
        return replace(self.open, A=A - share * B @ C, B=share * B, C=-C / D, D=1 / D)

    def sensitivity_at(self, gain: float, hz: ArrayLike) -> Matrix:
        """Returns S at a gain k and at frequencies in Hz, in the shape of `hz`."""
        result: Matrix = self.sensitivity(gain).response(hz).ravel()
        return result

    def closed_poles(self, gain: float) -> Matrix:
        """Returns the closed-loop poles in 1/s. For a sampled loop, the poles are log(z) / T."""
        return self.closed(gain).poles_s()

    # At a critical gain, L / k is real and negative at a frequency on the stability boundary.
    # A sampled loop is transformed to w = (2/T) (z - 1)/(z + 1).
    # The transformation to w moves the unit circle to the imaginary axis.

    @cached_property
    def _minimal(self) -> System:
        return minimal(self.open)

    @cached_property
    def _plane(self) -> StateSpace:
        """The balanced matrices (A, B, C, D) of the force loop, with the imaginary axis as the
        stability boundary."""
        return plane(self._minimal)

    def hz(self, w: float) -> float:
        """Returns the frequency in Hz that corresponds to a frequency w in rad/s along the
        stability boundary."""
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
        """Returns three arrays in the shape of w: the response G of the loop at frequencies w along
        the stability boundary, the derivative dG/dw, and the largest change of G by rounding of the
        matrix entries."""
        at = np.asarray(w, float)
        # Poles at 0 without effect matter only at w = 0. Only there is the minimal system used.
        whole = self._boundary if np.all(at) else self._boundary_minimal
        G, slope, rounding = (values.reshape(at.shape) for values in whole(at.ravel()))
        return G, slope, rounding

    def _at(self, w: ArrayLike) -> Matrix:
        return self._known(w)[0]

    def _static_rounding(self, static: float) -> float:
        """Returns the value that |G(0)|, the static gain of the loop, must exceed so that its
        rounding error is below 1 %. Returns infinity for an integrator.

        G(0) is computed again with states in other units, which changes the rounding. The
        difference also contains errors that `_known` does not include. They come from a pole and a
        zero at 0 Hz that were removed.
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
        """Returns a grid of frequencies along the stability boundary. None of them is a pole.
        Between two adjacent frequencies, a real function of w changes its sign at most once.
        `zeros`: estimates of the zeros of this function in s."""
        found = np.concatenate([np.abs(zeros.imag), np.abs(self._poles.imag), np.abs(self._poles)])
        return marks(found, np.abs(self._poles).max())

    @cached_property
    def _poles(self) -> Matrix:
        result: Matrix = _core.eigenvalues(self._plane[0])
        return result

    @cached_property
    def _typical_gain(self) -> float:
        """A gain at which the loop gain is about 1 at the frequency of a pole."""
        poles = np.abs(self._poles)
        at = poles[poles > SLOWEST_POLE_RAD_PER_S]
        return self._gain_of_1(np.abs(self._at(at if len(at) else np.ones(1))))

    @staticmethod
    def _gain_of_1(sizes: Matrix) -> float:
        """Returns the gain at which the loop gain is about 1. `sizes`: magnitudes of the loop gain
        divided by k."""
        sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
        return 1 / float(np.median(sizes)) if len(sizes) else 1.0

    @cached_property
    def _boundary_poles(self) -> list[tuple[float, complex | None]]:
        """Returns the poles that are on the stability boundary at gain 0, apart from rounding
        errors. Each is (frequency along the boundary, change of the pole per gain). The change is
        None for a multiple pole."""
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
            # Product of left and right eigenvector of a pole. It is 0 if two poles are equal.
            turn = left[i] @ right[:, i]
            move = -(left[i] @ B @ C @ right[:, i]) / turn if abs(turn) > 1e-6 else None
            found.append((float(w), None if move is None else complex(move)))
        return found

    @property
    def _at_gain_0(self) -> list[Crossing]:
        """Crossings of the stability boundary at gain 0. They are the undamped simple poles of the
        plant."""
        found = [(w, move) for w, move in self._boundary_poles if move is not None]
        sideways = [abs(move.real) < 1e-9 * abs(move) for _, move in found]
        return [
            Crossing(0.0, self.hz(w), 0 if along else int(np.sign(move.real)))
            for (w, move), along in zip(found, sideways, strict=True)
        ]

    def _phase(self, w: float) -> float:
        """Returns the sine of the phase of the response G at a frequency w in rad/s. Returns 0 at a
        pole, and where G is real or 0."""
        G = self._at(w)
        return float(G.imag / np.abs(G)) if np.isfinite(G) and G else 0.0

    def _turn(self, w: float) -> float:
        """Returns the derivative of the imaginary part of the response G with respect to the
        frequency w."""
        return float(self._known(w)[1].imag)

    @cached_property
    def _real_points(self) -> Matrix:
        """Complex points s at which G(s) = G(-s), where G is the response of the loop. If such a
        point is on the imaginary axis, G is real there."""
        A, B, C, _ = self._plane
        zero = np.zeros((len(A), len(A)))
        both = System(
            np.block([[A, zero], [zero, -A]]), np.vstack([B, B]), np.hstack([C, C]),
            np.zeros((1, 1)), (), ("",), ("",),
        )  # fmt: skip
        return both.zeros() if both.has_path() else np.zeros(0, complex)

    def crossings(self) -> list[Crossing]:
        """Returns all gains > 0 at which a closed-loop pole is on the stability boundary, in
        ascending order.

        At such a point of the boundary, G is real and negative, and k = -1 / G. The points at which
        G is real are the solution of an eigenvalue problem, so no point is missed. Each point is
        then refined with G itself. If G is real on the whole axis (a plant without damping), there
        are no crossings.
        """
        return [crossing for crossing in self.limit().crossings if crossing.gain]

    @cached_property
    def _crossed(self) -> tuple[list[Crossing], float | None]:
        """Returns (crossings, gain). The crossings of the stability boundary are all those below
        this gain. Above it, rounding errors hide crossings. The gain is None if rounding errors
        hide no crossing."""
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
        negligible = NEGLIGIBLE_GAIN * self._typical_gain
        for w, direction in dict.fromkeys(found):
            if any(abs(w - pole) < 1e-9 * w for pole, _ in self._boundary_poles):
                # At a pole, the phase of the loop gain changes, but no gain k has a crossing there.
                continue
            G, slope, rounding = self._known(w)
            value = G.real
            # The value of G is corrected for the rounding error of the frequency w.
            if abs(G.imag) < 1e-12 * w * abs(slope.imag):
                value -= slope.real * G.imag / slope.imag
            # The phase of G also changes at a zero of G, but there the gain -1 / G is infinite.
            if value >= 0 or abs(w * slope) > 1e9 * abs(value):
                continue
            if rounding < GAIN_CHANGE_MAX * abs(value):
                crossings.append(Crossing(float(-1 / value), self.hz(w), direction))
            elif negligible * abs(value) < 1:
                doubts.append(float(1 / (abs(value) + rounding)))
        doubt = float(min(doubts))
        crossings = [c for c in crossings if negligible < c.gain < doubt]
        return sorted(crossings, key=lambda c: c.gain), doubt if doubt < GAIN_MAX else None

    def _drowned(self, grid: Matrix, G: Matrix, rounding: Matrix, known: Matrix) -> float:
        """Returns the smallest gain at which rounding errors could hide a crossing of the stability
        boundary. At such a gain, the rounding error of G between two frequencies of the grid
        exceeds both Im G and GAIN_CHANGE_MAX |G|. Negligible gains are ignored."""
        hidden = rounding > GAIN_CHANGE_MAX * np.abs(G)
        negligible = NEGLIGIBLE_GAIN * self._typical_gain
        least = math.inf
        for i in np.flatnonzero(hidden & ~known):
            sizes = [(abs(G[i]), rounding[i])]
            for j in (i - 1, i + 1):
                if not (0 <= j < len(grid) and known[j]):
                    continue
                clear, drowned = grid[j], grid[i]
                for _ in range(0 if hidden[j] else 40):
                    middle = math.sqrt(clear * drowned)
                    value, _, moved = self._known(middle)
                    if moved > GAIN_CHANGE_MAX * abs(value):
                        drowned = middle
                    else:
                        clear = middle
                value, _, moved = self._known(clear)
                sizes.append((abs(value), moved))
            if any(negligible * size < 1 for size, _ in sizes):
                least = min(least, *(1 / (size + moved) for size, moved in sizes))
        return float(least)

    def _root(self, of: Callable[[float], float], low: float, high: float) -> float:
        return float(optimize.brentq(of, low, high, xtol=1e-300, rtol=1e-15))

    def _touches(self, zeros: Matrix, grid: Matrix, values: Matrix) -> list[tuple[float, int]]:
        """Returns [(w, 0)] for all frequencies w at which a closed-loop pole touches the stability
        boundary without crossing it. They are the double zeros of Im G. `zeros`: all zeros of Im G
        in the complex plane. `values`: Im G on the grid."""
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
        """Returns the crossings at the two ends of the stability boundary. One end is frequency 0,
        unless the plant integrates. The other end is infinity or z = -1. `values`: Im G on the
        grid. `least`: the largest negative direct path that rounding errors can cause."""
        crossings = []
        static = float(self._at(0.0).real)
        if -math.inf < static < 0 and static < -self._static_rounding(static):
            crossings.append(Crossing(-1 / static, 0.0, int(np.sign(values[0]))))
        direct = float(self._plane[3][0, 0])
        if direct < least:
            end = None if self.dt is None else 0.5 / self.dt
            crossings.append(Crossing(-1 / direct, end, -int(np.sign(values[-1]))))
        return crossings

    def stable(self, gain: float) -> bool:
        """Returns True if the closed loop is stable at a gain k. States of the loop that are not
        controllable or not observable are ignored."""
        A = self._closed_minimal(gain)
        poles = _core.eigenvalues(A)
        rounding = 1e-18 * len(A) * max(float(np.linalg.norm(A)), 1.0)
        return bool(np.all((poles.real if self.dt is None else np.abs(poles) - 1) < -rounding))

    def decay(self, gain: float) -> float:
        """Returns the decay rate in 1/s of the slowest closed-loop pole at a gain k. It is negative
        for an unstable loop."""
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

    def _growths(self, gains: Matrix) -> Matrix:
        """Returns, for each gain, how far the outermost closed-loop pole is outside of the
        stability boundary. This is the largest real part, or the largest magnitude minus 1."""
        found: Matrix = np.array([self._growth(self._closed_minimal(gain)) for gain in gains])
        return found

    def _growth(self, A: Matrix) -> float:
        poles = _core.eigenvalues(A)
        return float(poles.real.max() if self.dt is None else np.abs(poles).max() - 1)

    def _settled(self, gain: float) -> bool | None:
        """Returns True if the closed loop is stable at a gain k, and False if it is unstable.
        Returns None if this depends on rounding of the matrix entries, which are known only to
        double precision."""
        A = self._closed_minimal(gain)
        rng = np.random.default_rng(len(A))
        growths = [self._growth(A)]
        for _ in range(ROUNDED_AGAIN):
            growths.append(self._growth(A * (1 + 2.0**-53 * rng.choice([-1, 1], A.shape))))
        # An equal change of the matrix with the opposite effect must give the same answer.
        size = 1.0 if self.dt is not None else float(np.abs(self._poles).max())
        least = max(growths) - min(growths) + 2.0**-50 * size
        return None if min(growths) - least < 0 < max(growths) + least else growths[0] < 0

    def _smallest_stable(self) -> float | None:
        """Returns the smallest of the CHECKED_GAINS at which rounding does not decide about
        stability. Returns None if there is no such gain, or if the loop is unstable at this
        gain."""
        for gain in self._typical_gain * CHECKED_GAINS:
            settled = self._settled(gain)
            if settled is not None:
                return float(gain) if settled else None
        return None

    def _edge_above(self, gain: float) -> float | None:
        """Returns the lowest gain above `gain` at which a closed-loop pole reaches the stability
        boundary. At `gain`, the loop is stable. Returns None if there is no such gain up to the
        largest of the CHECKED_GAINS."""

        def growth(k: float) -> float:
            return self._growth(self._closed_minimal(k))

        most = min(self._typical_gain * CHECKED_GAINS[-1], GAIN_MAX)
        least, inside = gain, gain
        while gain < most:
            gains = gain * GAIN_STEP_FACTOR ** np.arange(GAINS_AT_ONCE)
            for at, outside in zip(gains.tolist(), self._growths(gains), strict=True):
                if outside < 0:
                    inside = at
                elif at > inside and self._settled(at) is False:
                    # The growth at the gain `inside` may have been computed less exactly before.
                    while growth(inside) >= 0:
                        inside = max(inside / GAIN_STEP_FACTOR, least)
                    return self._root(growth, inside, at)
            gain = float(gains[-1])
        return None

    def _frequency(self, gain: float) -> float:
        """Returns the frequency in Hz of the outermost closed-loop pole at a gain k."""
        poles = _core.eigenvalues(self._closed_minimal(gain))
        if self.dt is None:
            return float(abs(poles[np.argmax(poles.real)].imag) / (2 * math.pi))
        return float(abs(np.angle(poles[np.argmax(np.abs(poles))])) / (2 * math.pi * self.dt))

    def _of_poles(self) -> Limit:
        """Returns the gain limit that follows from the closed-loop poles. The result has no
        crossings above this limit."""
        start = self._smallest_stable()
        if start is None:
            return Limit(0.0, None, [], [], "unstable at any small gain")
        edge = self._edge_above(start)
        if edge is None:
            known_to = float(self._typical_gain * CHECKED_GAINS[-1])
            reason = f"stable up to {known_to:.4g} {self.unit}, the largest gain that was analysed"
            return Limit(None, None, [], [(0.0, known_to)], reason, known_to)
        hz = self._frequency(edge)
        return Limit(edge, hz, [Crossing(edge, hz, 1)], [(0.0, edge)], "")

    def _checked(self, found: Limit) -> Limit:
        """Checks the result `found` with the closed-loop poles. `found` states that there is no
        gain limit, or that the loop is stable at no small gain. Returns `found`, or the limit from
        the closed-loop poles if these contradict it."""
        if not len(self._minimal.A):
            return found
        start = self._smallest_stable()
        if found.gain == 0:
            contradicted = start is not None
        else:
            gains = self._typical_gain * CHECKED_GAINS
            contradicted = any(self._settled(gain) is False for gain in gains)
        if not contradicted:
            return found
        own = self._of_poles()
        if not own.gain or start is None:
            return own
        if self._settled(own.gain * (1 - EDGE_SHARE)) and (
            self._settled(own.gain * (1 + EDGE_SHARE)) is False
        ):
            return own
        if found.gain is None:
            return found
        reason = f"stable up to {known_text(start, self.unit)}"
        return Limit(None, None, [], [(0.0, start)], reason, start)

    @cached_property
    def _ranges_by_response(self) -> list[tuple[float, float | None]]:
        """Ranges of stable gains between crossings of the stability boundary."""
        if not len(self._minimal.A):
            return [(0.0, None)]
        crossings, known_to = self._crossed
        edges = [0.0, *(c.gain for c in crossings)]
        if len(edges) == 1:
            return [(0.0, known_to)] if self.stable(self._typical_gain) else []
        ranges = []
        for low, high in zip(edges, [*edges[1:], known_to], strict=True):
            if high is not None and high <= low:
                continue
            # Between two crossings, the loop is stable either everywhere or nowhere.
            # Small gains are checked too, because rounding may hide stability at high gains.
            if high is None:
                inside = [2 * low, 10 * low]
            else:
                inside = [low + share * (high - low) for share in (0.5, 0.01, 1e-4, 1e-6)]
            if any(self.stable(gain) for gain in inside):
                ranges.append((low, high))
        return ranges

    def _by_response(self) -> Limit:
        """Returns the gain limit that follows from the frequency response along the stability
        boundary."""
        (crossings, known_to), ranges = self._crossed, self._ranges_by_response
        if not ranges or ranges[0][0] > 0:
            reason = "unstable at any small gain" if ranges else "stable at no gain"
            return Limit(0.0, None, self._at_gain_0 + crossings, ranges, reason)
        if ranges[0][1] == known_to:
            reason = "stable at every gain"
            if known_to is not None:
                reason = f"stable up to {known_text(known_to, self.unit)}"
            return Limit(None, None, crossings, ranges, reason, known_to)
        first = next(c for c in crossings if c.gain == ranges[0][1])
        return Limit(first.gain, first.frequency_hz, crossings, ranges, "")

    @cached_property
    def _limit(self) -> Limit:
        found = self._by_response()
        return found if found.gain else self._checked(found)

    def limit(self) -> Limit:
        """Returns the smallest gain at which the force loop becomes unstable as the gain rises from
        0, with all crossings of the stability boundary. If this gain is 0, the crossings also
        contain the poles of the plant that are on the stability boundary. The result is "no limit"
        only if the closed-loop poles confirm it."""
        return self._limit

    @property
    def stable_ranges(self) -> list[tuple[float, float | None]]:
        """Returns the ranges (from, to) of gains in which the force loop is stable. `to` is None if
        the range has no upper end."""
        return self.limit().stable_ranges

    def gain_margins(self, gain: float) -> Margins:
        """Returns the gain margins of the force loop at a gain k, without the phase margins. The
        loop must be stable at k."""
        if not len(self._minimal.A):
            return Margins()
        crossings, known_to = self._crossed
        if not any(c.gain > gain for c in crossings):
            crossings, known_to = self.crossings(), self.limit().known_to
        gains = [c.gain for c in crossings]
        above = min((g for g in gains if g > gain), default=None)
        below = max((g for g in gains if g < gain), default=None)
        return Margins(
            gain_margin=above and above / gain,
            gain_reduction=below and below / gain,
            known_to=None if above or known_to is None else known_to / gain,
        )

    def margins(self, gain: float) -> Margins:
        """Returns the gain margins and phase margins of the force loop at a gain k. The loop must
        be stable at k."""
        if not len(self._minimal.A):
            return Margins()
        A, B, C, D = self._plane
        # |k G| is 1 at the zeros of 1 - k^2 G(s) G(-s).
        # The zeros of 1 - k^2 G(s) G(-s) are the poles of k^2 G(s) G(-s) with positive feedback.
        share = gain**2 / (1 - gain**2 * D[0, 0] ** 2)
        product = np.block(
            [
                [A + share * D * B @ C, -share * B @ C],
                [B @ C + share * D**2 * B @ C, -A - share * D * B @ C],
            ]
        )
        grid = self._marks(_core.eigenvalues(product))

        def size(w: ArrayLike) -> Matrix:
            return np.log(gain * np.abs(self._at(w)))

        values = size(grid)
        crossovers = []
        for i in np.flatnonzero(values[:-1] * values[1:] < 0):
            w = self._root(lambda w: float(size(w)), grid[i], grid[i + 1])
            phase = float(np.degrees(np.angle(-self._at(w))))
            crossovers.append(Crossover(self.hz(w), phase))
        least = min(crossovers, key=lambda c: abs(c.phase_margin_deg), default=None)
        return replace(
            self.gain_margins(gain),
            phase_margin_deg=least.phase_margin_deg if least else None,
            crossover_hz=least.frequency_hz if least else None,
            crossovers=crossovers,
        )

    def step(self, gain: float, duration_s: float) -> tuple[Matrix, Matrix]:
        """Returns (times in s, response) of the closed loop to a unit step of the set-point. The
        loop is at rest before. There is a value at every tick (for a continuous loop, every
        1/1500 s).

        The set-point is f_d. For law stiffness it is K_fs x_d, and for law damping K_fd v_d. The
        values at these times are exact.
        """
        closed = self.closed(gain)
        if self.dt is None:
            closed = closed.sampled()
        period_s = closed.dt or TICK_S
        time_s = np.arange(math.floor(duration_s / period_s) + 1) * period_s
        A, B, C, D = (getattr(closed, name).astype(float) for name in "ABCD")
        x, y = np.zeros(len(A)), np.empty(len(time_s))
        # The response of an unstable loop may exceed the range of double precision.
        with np.errstate(over="ignore", invalid="ignore"):
            for i in range(len(time_s)):
                y[i] = C[0] @ x + D[0, 0]
                x = A @ x + B[:, 0]
        return time_s, y

    def locus(self, gains: Matrix, plane: str = "s") -> Matrix:
        """Returns the closed-loop poles at ascending gains, in the shape (len(gains), poles). Each
        column is one branch of the root locus.

        The poles are in 1/s, or in z for a sampled loop with the plane "z". In 1/s, a branch from
        z = 0 starts at -infinity.
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
