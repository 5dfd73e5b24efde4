"""Force loops that compute several DAC codes in the period after which their ticks repeat. Also
force loops whose force sensor samples with its own clock.

A loop with several codes in a period has no single curve of the loop gain. Its limits and margins
follow from the eigenvalues of the lifted loop. The gain margin is the factor of all codes together
at which a pole reaches the stability boundary. The phase margin is the phase shift of all codes
together at which this happens. Ms is the largest gain of S for a disturbance of the codes with any
mix of frequencies. fS is computed from the component of the response at the frequency of the
disturbance.
"""

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, optimize

from forceaxis import _core
from forceaxis.linear.boundary import minimal
from forceaxis.linear.equations import Matrix, StateSpace
from forceaxis.linear.stability import (
    GAIN_STEP_FACTOR,
    SLOWEST_POLE_RAD_PER_S,
    Crossover,
    Limit,
    Loop,
    Margins,
)
from forceaxis.linear.system import System

# Step of the phase in degrees in the search for a phase margin.
# The search does not detect two changes between stable and unstable within one step.
TURN_STEP_DEG = 3.0
TURNS_AT_ONCE = 8  # number of phases that this search evaluates together
GAIN_SPAN = 1e4  # largest gain factor in the search for a gain margin
POINTS_PER_DECADE = 60  # number of points in each decade of a grid of frequencies
LOWEST_SHARE = 1e-6  # ratio of the lowest frequency to the highest frequency of a grid
STABLE_BELOW = 1 - 1e-11  # largest magnitude of the poles of a loop that counts as stable
# LEVEL_SHARE: largest error of the computed maximum of |S|, as a fraction of the maximum.
# ON_AXIS_SHARE: largest ratio of real part to magnitude of an eigenvalue that gives a frequency.
# At such a frequency, |S| equals a level.
LEVEL_SHARE, ON_AXIS_SHARE, LEVELS_MAX = 1e-8, 1e-3, 30
# Smallest relative distance of a combination of codes from all combinations of earlier directions.
# A combination with a smaller distance is no new direction.
DIRECTION_SHARE_MIN = 1e-13
FREQUENCIES_AT_ONCE = 150  # number of frequencies at which a search evaluates |S| together
PHASES = 3  # number of phases for each order of samples and ticks; see Samples.phases()
# A lower gain limit at other phases is searched only if it can be lower by more than this ratio.
# For each order of samples and ticks, the search uses at most PARABOLAS_MAX parabolas.
PHASE_SHARE, PARABOLAS_MAX = 1e-5, 4


def _turned(gain: float, degrees: float) -> complex:
    """Returns a complex gain with the magnitude `gain` that delays a sinusoid by `degrees`."""
    return cmath.rect(gain, -math.radians(degrees))


def _size_deg(margins: Margins) -> float:
    return math.inf if margins.phase_margin_deg is None else abs(margins.phase_margin_deg)


def _stable_to(limit: Limit) -> float:
    return math.inf if limit.stable_to is None else limit.stable_to


def _vertex(points: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Returns the lowest point (x, y) of the parabola through three points (x, y). The value y is
    infinite if the lowest point is not between the outer two points."""
    (a, fa), (b, fb), (c, fc) = points
    if not math.isfinite(fa + fb + fc):
        return b, math.inf
    left, right = (fb - fa) / (b - a), (fc - fb) / (c - b)
    bend = (right - left) / (c - a)
    if bend <= 0:
        return b, math.inf
    at = (a + b) / 2 - left / (2 * bend)
    return at, fa + left * (at - a) + bend * (at - a) * (at - b) if a < at < c else math.inf


@dataclass
class PeriodicLoop(Loop):
    """A force loop that computes several codes in the period after which its ticks repeat. `whole`:
    the loop as a System. It has one input for each code, and one output for each output of the law
    that becomes a code. Its last output is the controlled signal."""

    @property
    def codes(self) -> int:
        """Number of codes in a period."""
        return int(self.whole.B.shape[1])

    @cached_property
    def directions(self) -> Matrix:
        """Orthonormal columns, in the shape (codes, directions). All outputs of the law are
        combinations of these columns, and a combination of codes at right angles to them does not
        act on the loop. The sensor has few samples in a period, so there are fewer directions than
        codes."""
        assert self.entry is not None
        B, C, D = self.whole.B, self.whole.C[: self.codes], self.whole.D[: self.codes]
        found = np.hstack([C, D, B.T, D.T, self.entry[1]]).astype(float)
        sizes = np.linalg.norm(found, axis=0)
        Q, R, _ = linalg.qr(found[:, sizes > 0] / sizes[sizes > 0], mode="economic", pivoting=True)
        directions: Matrix = Q[:, np.abs(np.diag(R)) > DIRECTION_SHARE_MIN]
        return directions

    @cached_property
    def _few(self) -> System:
        """The loop `whole` with directions in the place of codes."""
        whole, codes, W = self.whole, self.codes, self.directions
        names = tuple(f"direction {i}" for i in range(W.shape[1]))
        return replace(
            whole,
            B=whole.B @ W,
            C=np.vstack([W.T @ whole.C[:codes], whole.C[codes:]]),
            D=np.vstack([W.T @ whole.D[:codes], whole.D[codes:]]) @ W,
            inputs=names,
            outputs=(*names, *whole.outputs[codes:]),
        )

    def closed(self, gain: float) -> System:
        """Returns the closed loop; see Loop.closed(). The set-point is constant over a period of
        the ticks."""
        few, count = self._few, self.directions.shape[1]
        B, C, D = few.B, few.C[:count], few.D[:count]
        assert self.entry is not None
        share = gain * np.linalg.inv((np.eye(count) + gain * D).astype(float))
        entry = self.directions.T @ self.entry[1]
        last, direct = few.C[count:], few.D[count:]
        return replace(
            few,
            A=few.A - B @ share @ C,
            B=self.entry[0] - B @ share @ entry,
            C=last - direct @ share @ C,
            D=-direct @ share @ entry,
            inputs=("set-point",),
            outputs=few.outputs[count:],
        )

    @cached_property
    def open(self) -> System:
        """Raises InputError, because no single loop gain exists for a loop with several DAC codes
        in a period."""
        raise _core.InputError(
            f"{self.model}: adc.sample_rate: expected a loop with one DAC code in each sampling "
            f"period of the ADC, got {self.codes} DAC codes, with which only the "
            "critical gain can be computed; remove the keys sample_rate and sample_phase for this "
            "computation"
        )

    @cached_property
    def _minimal(self) -> System:
        few, count = self._few, self.directions.shape[1]
        names = few.outputs[:count]
        return minimal(replace(few, C=few.C[:count], D=few.D[:count], outputs=names))

    @cached_property
    def _rounded(self) -> StateSpace:
        """The matrices (A, B, C, D) of _minimal in double precision."""
        A, B, C, D = (getattr(self._minimal, name).astype(float) for name in "ABCD")
        return A, B, C, D

    def _poles_at(self, gains: ArrayLike) -> Matrix:
        """Returns the closed-loop poles at each of some gains, which may be complex, in the shape
        (gains, poles). Double precision is used here, which is faster than in
        Loop.closed_poles()."""
        A, B, C, D = self._rounded
        k = np.asarray(gains)[:, None, None]
        poles: Matrix = np.linalg.eigvals(A - k * B @ np.linalg.solve(np.eye(len(D)) + k * D, C))
        return poles

    def _outermost(self, gain: complex) -> complex:
        """Returns the closed-loop pole with the largest magnitude at the gain `gain`, which may be
        complex."""
        poles = self._poles_at([gain])[0]
        return complex(poles[np.argmax(np.abs(poles))]) if len(poles) else 0j

    def _hz_at(self, gain: complex) -> float:
        """Returns the frequency in Hz of the closed-loop pole with the largest magnitude."""
        assert self.dt is not None
        return abs(cmath.phase(self._outermost(gain))) / (2 * math.pi * self.dt)

    def _radius(self, gain: complex) -> float:
        return abs(self._outermost(gain))

    def stable(self, gain: float) -> bool:
        """Returns True if the closed loop is stable; see Loop.stable()."""
        return self._radius(gain) < STABLE_BELOW

    def decay(self, gain: float) -> float:
        """Returns the decay rate of the slowest closed-loop pole; see Loop.decay()."""
        assert self.dt is not None
        return -math.log(max(self._radius(gain), 1e-300)) / self.dt

    def _edge(self, gain_at: Callable[[float], complex], good: float, bad: float) -> float:
        """Returns the value between `good` (stable) and `bad` (unstable) at which a closed-loop
        pole reaches the stability boundary. `gain_at`: function that returns the gain for such a
        value."""
        return float(
            optimize.brentq(
                lambda at: self._radius(gain_at(at)) - 1, good, bad, xtol=1e-14 * bad, rtol=1e-13
            )
        )

    @cached_property
    def _typical_gain(self) -> float:
        rates = np.abs(self._minimal.poles_s())
        at = rates[(rates > SLOWEST_POLE_RAD_PER_S) & (rates < 2 * math.pi * self._grid[-1])]
        hz = at / (2 * math.pi) if len(at) else self._grid[-1:]
        return self._gain_of_1(np.linalg.norm(self._lifted(hz), 2, axis=(1, 2)))

    def _closed_minimal(self, gain: float) -> Matrix:
        A, B, C, D = (getattr(self._minimal, name).astype(np.longdouble) for name in "ABCD")
        result: Matrix = A - gain * B @ _core.solve(np.eye(len(D)) + gain * D, C)
        return result

    def _growths(self, gains: ArrayLike) -> Matrix:
        """Returns, for each gain, how far the outermost closed-loop pole is outside of the
        stability boundary."""
        found: Matrix = np.abs(self._poles_at(gains)).max(axis=1, initial=0.0) - 1
        return found

    @cached_property
    def _limit(self) -> Limit:
        return self._of_poles()

    def gain_margins(self, gain: float) -> Margins:
        """Returns the gain margins; see Loop.gain_margins()."""
        limit = self.limit()
        above, below, known_to = limit.gain, None, limit.stable_to
        if known_to is None or gain >= known_to:
            above = self._toward(gain, GAIN_STEP_FACTOR)
            below = self._toward(gain, 1 / GAIN_STEP_FACTOR)
            known_to = GAIN_SPAN * gain
        return Margins(
            gain_margin=above and above / gain,
            gain_reduction=below and below / gain,
            known_to=None if above else known_to / gain,
        )

    def margins(self, gain: float) -> Margins:
        """Returns the gain margins and phase margins; see Loop.margins()."""
        turn = self._phase_margin(gain)
        if turn is None:
            return self.gain_margins(gain)
        crossover = self._hz_at(_turned(gain, turn))
        return replace(
            self.gain_margins(gain),
            phase_margin_deg=turn,
            crossover_hz=crossover,
            crossovers=[Crossover(crossover, turn)],
        )

    def _toward(self, gain: float, factor: float) -> float | None:
        """Returns the nearest gain above or below `gain` at which the loop becomes unstable."""
        good = gain
        for _ in range(int(math.log(GAIN_SPAN) / math.log(GAIN_STEP_FACTOR))):
            bad = good * factor
            if self._radius(bad) >= 1:
                return self._edge(lambda at: at, good, bad)
            good = bad
        return None

    def _phase_margin(self, gain: float) -> float | None:
        """Returns the phase margin in degrees."""
        turn, steps = partial(_turned, gain), np.arange(TURN_STEP_DEG, 180.1, TURN_STEP_DEG)
        for first in range(0, len(steps), TURNS_AT_ONCE):
            some = steps[first : first + TURNS_AT_ONCE]
            unstable = np.flatnonzero(self._growths([turn(degrees) for degrees in some]) >= 0)
            if len(unstable):
                degrees = float(some[unstable[0]])
                return self._edge(turn, degrees - TURN_STEP_DEG, degrees)
        return None

    @cached_property
    def _grid(self) -> Matrix:
        """Returns frequencies in Hz, up to half the rate at which the sequence of ticks repeats.
        They are dense near a pole."""
        assert self.dt is not None
        top = 0.5 / self.dt
        found = [np.geomspace(LOWEST_SHARE * top, top, int(6 * POINTS_PER_DECADE))]
        for pole in self.whole.poles_s():
            hz, width = abs(pole.imag) / (2 * math.pi), abs(pole.real) / (2 * math.pi)
            if 0 < hz < top and width < hz:
                found.append(hz + width * np.sinh(np.linspace(-5, 5, 41)))
        grid = np.unique(np.concatenate(found))
        return grid[(grid > 0) & (grid <= top)]

    def _lifted(self, hz: ArrayLike) -> Matrix:
        """Returns the loop gain divided by k at frequencies in Hz, in the shape (frequencies,
        directions, directions)."""
        assert self.dt is not None
        A, B, C, D = self._rounded
        z = np.exp(2j * math.pi * np.atleast_1d(np.asarray(hz, float)) * self.dt)
        states = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B)
        result: Matrix = C @ states + D
        return result

    def _sensitivity(self, gain: float) -> "_Sensitivity":
        assert self.dt is not None
        return _Sensitivity(*self._rounded, self.directions, gain, self.dt)

    def peak(self, gain: float, least: float = 0.0) -> float:
        """Returns Ms, the largest |S|, at a gain k at which the loop is stable, or `least` if that
        is larger."""
        return self._sensitivity(gain).peak(least)

    def sensitivity_at(self, gain: float, hz: ArrayLike) -> Matrix:
        """Returns the component of the sensitivity function S at the frequency of the disturbance.
        `hz`: frequencies in Hz up to half the rate of the codes."""
        return self._sensitivity(gain).component(hz)

    def bandwidth(self, gain: float, level: float) -> float | None:
        """Returns the lowest frequency in Hz at which |S| rises through `level`. Returns None if
        |S| stays below `level`, and 0 if |S| is above it at the lowest frequency of the grid."""
        component = self._sensitivity(gain).component

        def apart(hz: ArrayLike) -> Matrix:
            return np.abs(component(hz)) - level

        assert self.dt is not None
        top = 0.5 * self.codes / self.dt
        spread = np.geomspace(LOWEST_SHARE * top, top, 6 * POINTS_PER_DECADE)
        grid = np.unique(np.concatenate([self._grid, spread]))
        for first in range(0, len(grid), FREQUENCIES_AT_ONCE):
            above = np.flatnonzero(apart(grid[first : first + FREQUENCIES_AT_ONCE]) >= 0)
            if len(above):
                i = first + int(above[0])
                if i == 0:
                    return 0.0
                return float(optimize.brentq(lambda hz: float(apart(hz)[0]), grid[i - 1], grid[i]))
        return None


class _Sensitivity:
    """The sensitivity function S of a loop with several codes in a period, at one gain.

    A, B, C, D: the loop gain divided by k, between the directions of the codes. directions:
    PeriodicLoop.directions. gain: k in V/N. dt: period in s. S is computed from the closed loop,
    because the loop gain of an integrator has no value at frequency 0. The matrix of the closed
    loop is triangular (Schur form), so a frequency needs no elimination. S does not change a
    combination of codes at right angles to the directions.
    """

    def __init__(
        self, A: Matrix, B: Matrix, C: Matrix, D: Matrix, directions: Matrix, gain: float, dt: float
    ) -> None:
        self.dt, self.directions = dt, directions
        # S(z) = D + C (z - A)^-1 B with these matrices
        self.D = np.linalg.inv(np.eye(len(D)) + gain * D)
        self.A, self.B, self.C = A - gain * B @ self.D @ C, B @ self.D, -gain * self.D @ C
        self._triangle, basis = linalg.schur(self.A, output="complex")
        self._enters, self._leaves = basis.conj().T @ self.B, self.C @ basis

    def _states(self, z: Matrix, enters: Matrix) -> Matrix:
        """Returns (z - A)^-1 B for each z, in the basis of the Schur form. `enters`: B in this
        basis, in the shape (1 or number of z, states, columns)."""
        T = self._triangle
        if len(z) == 1:
            x = linalg.solve_triangular(z[0] * np.eye(len(T)) - T, enters[0])
            return np.asarray(x[None])
        x = np.zeros((len(z), len(T), enters.shape[2]), complex)
        for i in range(len(T))[::-1]:
            known = enters[:, i] + np.einsum("j,fjk->fk", T[i, i + 1 :], x[:, i + 1 :])
            x[:, i] = known / (z - T[i, i])[:, None]
        return x

    def at(self, hz: ArrayLike) -> Matrix:
        """Returns S at frequencies in Hz, in the shape (frequencies, directions, directions)."""
        z = np.exp(2j * math.pi * np.asarray(hz, float) * self.dt)
        result: Matrix = self.D + self._leaves @ self._states(z, self._enters[None])
        return result

    def component(self, hz: ArrayLike) -> Matrix:
        """Returns the component of S at the frequency of the disturbance; see
        PeriodicLoop.sensitivity_at()."""
        at, codes = np.atleast_1d(np.asarray(hz, float)), len(self.directions)
        turned = np.exp(2j * math.pi * at[:, None] * self.dt / codes * np.arange(codes))
        turned = turned @ self.directions
        z = np.exp(2j * math.pi * at * self.dt)
        states = self._states(z, (turned @ self._enters.T)[:, :, None])[:, :, 0]
        back = turned.conj()
        result: Matrix = np.sum((back @ (self.D - np.eye(len(self.D)))) * turned, 1)
        result = 1 + (result + np.sum((back @ self._leaves) * states, 1)) / codes
        return result

    def peak(self, least: float = 0.0) -> float:
        """Returns the largest |S| over all frequencies, or `least` if that is larger. As in
        over._Response.peak(), a level is raised until |S| is nowhere above it. The frequencies at
        which |S| equals the level are eigenvalues of a matrix (Bruinsma and Steinbuch)."""
        one = np.eye(len(self.A))
        # w = (z - 1) / (z + 1), see `boundary`
        inverse = np.linalg.inv(self.A + one)
        A, B, C = inverse @ (self.A - one), 2 * inverse @ self.B, self.C @ inverse
        D = self.D - self.C @ inverse @ self.B
        marks = np.zeros(0)
        if not least:
            poles = np.linalg.eigvals(A)
            marks = np.concatenate([np.abs(poles.imag), np.abs(poles)])
        best = max(least, self._largest(marks))
        for _ in range(LEVELS_MAX):
            level = best * (1 + LEVEL_SHARE)
            inner = np.linalg.inv(level**2 * np.eye(len(D)) - D.T @ D)
            shifted = A + B @ inner @ D.T @ C
            roots = np.linalg.eigvals(
                np.block([
                    [shifted, B @ inner @ B.T],
                    [-C.T @ C - C.T @ D @ inner @ D.T @ C, -shifted.T],
                ])
            )  # fmt: skip
            marks = np.abs(roots.imag[np.abs(roots.real) <= ON_AXIS_SHARE * np.abs(roots)])
            top = self._largest(marks)
            if top <= level:
                return max(top, best)
            best = top
        return best

    def _largest(self, marks: Matrix) -> float:
        """Returns the largest |S| at the frequencies `marks` along the stability boundary and
        between each two of them, both ends of the boundary included."""
        angles = np.unique(np.concatenate([[0.0], np.arctan(marks), [math.pi / 2]]))
        angles = np.concatenate([angles, (angles[1:] + angles[:-1]) / 2])
        S = self.at(angles / (math.pi * self.dt))
        return float(np.linalg.norm(S, 2, axis=(1, 2)).max())


@dataclass
class FreeLoop(Loop):
    """The force loop of a sensor that samples with its own clock. `each`: loops with different
    phases between the samples and the ticks, in the order of Samples.phases(). Limits and margins
    are the worst of these loops. All other results are those of the first loop of `each`, which has
    the oldest readings. `between`: function that returns the loop with another phase, with the
    arguments of Samples.within()."""

    each: tuple[Loop, ...] = ()
    between: Callable[[int, float], Loop] | None = None

    @property
    def _oldest(self) -> Loop:
        return self.each[0]

    @cached_property
    def open(self) -> System:
        """The loop gain divided by k for the phase of the samples with the oldest readings; see
        Loop.open."""
        return self._oldest.open

    def closed(self, gain: float) -> System:
        """Returns the closed loop for the phase of the samples with the oldest readings."""
        return self._oldest.closed(gain)

    def sensitivity(self, gain: float) -> System:
        """Returns the sensitivity function S for the phase of the samples with the oldest
        readings."""
        return self._oldest.sensitivity(gain)

    def sensitivity_at(self, gain: float, hz: ArrayLike) -> Matrix:
        """Returns the mean of the sensitivity function S over all phases of the samples, at a gain
        k. The mean applies because the clock of the sensor drifts through all phases."""
        result: Matrix = np.mean([loop.sensitivity_at(gain, hz) for loop in self.each], 0)
        return result

    def stable(self, gain: float) -> bool:
        """Returns True if the loop is stable with every phase of the samples."""
        edge = self.limit().gain
        return not (edge and gain >= edge) and all(loop.stable(gain) for loop in self.each)

    def decay(self, gain: float) -> float:
        """Returns the smallest decay rate over all phases of the samples."""
        return min(loop.decay(gain) for loop in self.each)

    @cached_property
    def _limit(self) -> Limit:
        """The lowest gain limit over all phases of the samples. Within one order of samples and
        ticks, the limit is a smooth function of the phase. Its minimum is searched with
        parabolas."""
        limits = [loop.limit() for loop in self.each]
        best = min(limits, key=_stable_to)
        if self.between is None or not best.gain:
            return best
        orders = len(limits) // PHASES
        for order in range(orders):
            # The next order of samples has the newest readings of this order as its third entry.
            newest = limits[PHASES * ((order + 1) % orders) + 2]
            three = limits[PHASES * order], limits[PHASES * order + 1], newest
            points = [(at, _stable_to(one)) for at, one in zip((0, 0.5, 1), three, strict=True)]
            for _ in range(PARABOLAS_MAX):
                at, lowest = _vertex(points)
                if not lowest < _stable_to(best) * (1 - PHASE_SHARE):
                    break
                found = self.between(order, at).limit()
                best = min(best, found, key=_stable_to)
                points = sorted([*points, (at, _stable_to(found))])
                middle = min(range(1, len(points) - 1), key=lambda i: points[i][1])
                points = points[middle - 1 : middle + 2]
        return best

    def gain_margins(self, gain: float) -> Margins:
        """Returns the smallest gain margins over all phases of the samples, also over those between
        the phases of `each`."""
        found = [loop.gain_margins(gain) for loop in self.each]
        edge = self.limit().gain
        above = [one.gain_margin for one in found if one.gain_margin is not None]
        if edge and gain < edge:
            above.append(edge / gain)
        below = [one.gain_reduction for one in found if one.gain_reduction is not None]
        known = [one.known_to for one in found if one.known_to is not None]
        return Margins(
            gain_margin=min(above, default=None),
            gain_reduction=max(below, default=None),
            known_to=min(known, default=None),
        )

    def margins(self, gain: float) -> Margins:
        """Returns the smallest gain margins and phase margins over all phases of the samples."""
        turned = min((loop.margins(gain) for loop in self.each), key=_size_deg)
        return replace(
            self.gain_margins(gain),
            phase_margin_deg=turned.phase_margin_deg,
            crossover_hz=turned.crossover_hz,
            crossovers=turned.crossovers,
        )
