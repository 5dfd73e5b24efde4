"""Frequency responses of a set of plants on a grid of frequencies, on which control laws are
evaluated quickly.

All operations are vectorised over members and frequencies, so the evaluation of a law takes less
than a millisecond. Each member has its own grid of frequencies, which is dense near its poles and
zeros, because a resonance is narrower than the steps of a common grid.

The conditions |1 + g L| above a bound and |T| below a bound are quadratic in the gain g at each
frequency. The largest gain that keeps the margins is therefore computed without iteration. A loop
that is stable at small gains is stable up to this gain, because the curve of g L does not pass
through -1 at a smaller gain.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core
from forceaxis.linear.bank import HF_CODES_MAX, TICK_S
from forceaxis.linear.plant_set import Member, PlantSet
from forceaxis.linear.stability import Loop

Samples = NDArray[np.float64]
Response = NDArray[np.complex128]

LOWEST_HZ = 0.02  # lowest frequency of a grid
HALF_RATE_HZ = 0.5 / TICK_S  # highest frequency of a grid
SLOW_HZ = 1.0  # frequency below which a grid of frequencies has fewer points per decade
POINTS_PER_DECADE = (60, 270)  # below and above SLOW_HZ
# Number of grid points on each side of a resonance, and distance of the farthest point.
# The unit of the distance is the half-width of the resonance.
POINTS_PER_SIDE, FARTHEST_HALF_WIDTHS = 42, 25.0
THIN = 1 / 3  # density of a thin grid
DELAYS = {"zoh": 0, "zoh+1": 1}  # {timing: delay in ticks}
HALF_POWER = 0.5  # |S|^2 at -3 dB
BLOCK_MEMBERS = 16  # number of plants in each Grid that blocks() returns
# Largest gain at high frequency in DAC codes per 8-bit count, for every resolution of the ADC.
# The noise of the measured force in N does not decrease with a finer ADC.
HF_DEFAULT = 80.0
# share of the bound of `hf_gain` that a design uses, because the firmware rounds coefficients
HF_SHARE = 0.99


@dataclass(frozen=True)
class Bounds:
    """Bounds that a loop has to keep.

    `ms`: largest |S| for each delay of the loop. `mt`: largest |T|. `gain_margin`: factor.
    `phase_margin_deg`: in degrees. `hf_gain`: largest gain at high frequency in DAC codes per 8-bit
    count. None means no bound.
    """

    ms: tuple[float, ...]
    mt: float | None
    gain_margin: float
    phase_margin_deg: float | None
    hf_gain: float


@dataclass(frozen=True)
class Goal:
    """The margins that a design has to keep over a set of plants.

    ms, ms_late: largest |S| without and with a tick of delay; mt: largest |T|, None: no bound;
    gain_margin: factor; phase_margin_deg: None: no bound besides ms; adc_bits: of the force ADC;
    hf_gain: largest gain at high frequency in DAC codes per 8-bit count, None: HF_DEFAULT; timings:
    of loops.TIMINGS; ramp_s: rise time in s of the set-point that the force has to follow, None:
    follows from the bandwidth.
    """

    ms: float = 2.0
    ms_late: float = 2.2
    mt: float | None = None
    gain_margin: float = 2.3
    phase_margin_deg: float | None = None
    adc_bits: int = 8
    hf_gain: float | None = None
    timings: tuple[str, ...] = ("zoh", "zoh+1")
    ramp_s: float | None = None

    def ms_of(self, timing: str) -> float:
        """Returns the largest permitted |S| with a delay of the loop: "zoh" or "zoh+1"."""
        return self.ms if timing == "zoh" else self.ms_late

    def bounds(self) -> Bounds:
        """Returns the margins of the goal as bounds of a loop."""
        most = hf_most(self.adc_bits)
        return Bounds(
            tuple(self.ms_of(timing) for timing in self.timings),
            self.mt,
            self.gain_margin,
            self.phase_margin_deg,
            HF_SHARE * min(most, self.hf_gain or max(HF_DEFAULT, hf_most(8))),
        )

    def hf_cure(self) -> str:
        """Returns a text about a change of the axis or of the goal that permits a larger gain at
        high frequency."""
        if self.bounds().hf_gain >= HF_SHARE * hf_most(self.adc_bits):
            return "an ADC of more bits permits a larger gain"
        if self.hf_gain:
            return "a force measurement with less noise permits a larger bound"
        return "with little measurement noise, a larger hf_gain of the design is possible"


class GridPlace(NamedTuple):
    """One point of a Grid: index of the plant, index of the delay of the loop, and frequency
    in Hz."""

    member: int
    timing: int
    frequency_hz: float


class GainLimit(NamedTuple):
    """The largest gain that the bounds permit. `name`: bound that limits the gain ("hf", "ms",
    "mt", "gm" or "pm"). `place`: point of the grid at which the loop reaches this bound, None for
    "hf"."""

    gain: float
    name: str
    place: GridPlace | None


Index = tuple[int, int]  # index (plant, frequency) of an element of an array of a Grid


def hf_most(adc_bits: int) -> float:
    """Returns the largest gain at high frequency that the firmware accepts with an ADC of
    `adc_bits` bits, in DAC codes per 8-bit count."""
    return HF_CODES_MAX * 2.0 ** (adc_bits - 8)


def _frequencies(loop: Loop, density: float) -> Samples:
    """Returns the grid frequencies of one plant in Hz, ascending, up to half the tick rate.
    `density` is the ratio of the number of points to the number of points of a full grid."""
    ends = (LOWEST_HZ, SLOW_HZ, HALF_RATE_HZ)
    parts = [
        np.geomspace(low, high, round(density * dense * math.log10(high / low)))
        for low, high, dense in zip(ends[:-1], ends[1:], POINTS_PER_DECADE, strict=True)
    ]
    roots = np.concatenate([loop.open.poles_s(), loop.open.zeros_s()])
    roots = roots[np.isfinite(roots) & (roots.imag > 0)] / (2 * math.pi)
    side = round(density * POINTS_PER_SIDE)
    around = np.sinh(np.linspace(-1, 1, 2 * side + 1) * math.asinh(2 * FARTHEST_HALF_WIDTHS)) / 2
    for root in roots[np.abs(_damping(roots)) < 0.3]:
        width = max(abs(root.real), 1e-5 * root.imag)
        parts.append(root.imag + width * around)
    grid = np.unique(np.concatenate(parts))
    return grid[(grid >= LOWEST_HZ) & (grid <= HALF_RATE_HZ)]


def _damping(roots: Response) -> Samples:
    return -roots.real / np.abs(roots)


class Grid:
    """Frequency responses of all plants of a set of plants on a grid of frequencies.

    Members without a path from the drive command to the measured force are left out. plant (m, n):
    measured force in 8-bit counts per DAC code at frequency_hz (m, n), for m members without a
    delay; timings: names of loops.TIMINGS. Figures have a relative error of about 0.001, and of one
    or two per cent at the density THIN, because a peak may lie between two points of the grid.
    """

    def __init__(
        self, plants: PlantSet, members: Sequence[Member], timings: Sequence[str],
        density: float = 1.0,
    ) -> None:  # fmt: skip
        self.timings = tuple(timings)
        self.members: list[Member] = []
        self.open_loops: list[Loop] = []
        grids: list[Samples] = []
        refused: _core.InputError | None = None
        for member in members:
            try:
                loop = plants.loop(member, "zoh")
            except _core.InputError as error:
                if "expected a path" not in str(error):
                    raise
                refused = error  # every law is stable without a signal path from drive to sensor
                continue
            if loop.codes_per_gain is None:
                raise _core.InputError(
                    f"{loop.model}: adc: expected a model with a force sensor on ADC channel 0, "
                    "got none"
                )
            self.members.append(member)
            self.open_loops.append(loop)
            grids.append(_frequencies(loop, density))
        if not self.members:
            raise refused or _core.InputError("members: expected at least one plant, got none")
        longest = max(map(len, grids))
        # A row with fewer frequencies is extended by copies of the last frequency.
        self.frequency_hz = np.array([np.pad(g, (0, longest - len(g)), "edge") for g in grids])
        self.plant = np.array(
            [
                loop.open.response(f) / loop.codes_per_gain
                for loop, f in zip(self.open_loops, self.frequency_hz, strict=True)
            ]
        )
        angle = 2 * np.pi * self.frequency_hz * TICK_S
        self.z = np.exp(1j * angle)
        with np.errstate(over="ignore"):
            self.warped = 2 / TICK_S * np.tan(np.minimum(angle / 2, np.pi / 2 - 1e-9))
        self.warped_squared = self.warped**2
        self.integral = TICK_S / (1 - 1 / self.z)  # of 1 rad/s
        self.lag = [self.z ** -DELAYS[t] for t in self.timings]
        self.log_f = np.log(self.frequency_hz)

    def loops(self, law: Response) -> list[tuple[Response, Samples]]:
        """Returns (L, |L|^2) for each delay of the loop with the gain 1. `law` (m, n) is the
        frequency response of the control law with the gain 1."""
        whole = self.plant * law
        squared = whole.real**2 + whole.imag**2
        return [((whole * lag), squared) for lag in self.lag]

    def largest_gain(self, law: Response, hf_gain: float, bounds: Bounds) -> GainLimit:
        """Returns the largest gain at which the loops of all plants keep the bounds, and the bound
        that limits this gain. `hf_gain` is the gain of the law at high frequency if the gain of the
        law is 1."""
        best = GainLimit(bounds.hf_gain / hf_gain, "hf", None)
        for t, (L, q) in enumerate(self.loops(law)):
            for name, found in self._ends(L, q, bounds, t):
                gain, at = found
                if gain < best.gain:
                    place = GridPlace(at[0], t, float(self.frequency_hz[at]))
                    best = GainLimit(gain, name, place)
        return best

    def _ends(
        self, L: Response, q: Samples, bounds: Bounds, t: int
    ) -> Iterator[tuple[str, tuple[float, Index]]]:
        a = L.real
        ahead = np.maximum(-a, 0.0)
        share = 1 - 1 / bounds.ms[t] ** 2
        yield "ms", _first_root(ahead, share * q, share)
        if bounds.mt is not None:
            share = 1 - 1 / bounds.mt**2
            yield "mt", _first_root(ahead, share * q, 1.0)
        # Crossings of the negative real axis; the real part at each crossing is interpolated.
        im = L.imag
        left, right = im[:, :-1], im[:, 1:]
        rows, columns = np.nonzero((left * right < 0) & (a[:, :-1] < 0) & (a[:, 1:] < 0))
        if len(rows):
            i, j = im[rows, columns], im[rows, columns + 1]
            real = a[rows, columns] + (a[rows, columns + 1] - a[rows, columns]) * i / (i - j)
            k = int(np.argmin(real))
            yield "gm", (1 / (-real[k] * bounds.gain_margin), (int(rows[k]), int(columns[k])))
        k = int(np.argmax(ahead[:, -1]))
        if ahead[k, -1] > 0:
            yield "gm", (1 / (ahead[k, -1] * bounds.gain_margin), (k, -1))
        if bounds.phase_margin_deg:
            size = np.sqrt(q)
            close = np.where(
                ahead > math.cos(math.radians(bounds.phase_margin_deg)) * size, size, 0.0
            )
            at = _highest(close)
            if close[at] > 0:
                yield "pm", (1 / close[at], at)

    def bandwidths(self, law: Response, gain: float) -> tuple[Samples, Samples]:
        """Returns the bandwidths (fS, fT) in Hz, each as an array with one row per delay of the
        loop and one column per plant.

        These are the first frequencies at which |S| rises above -3 dB and |T| falls below -3 dB. A
        frequency is 0 if |S| or |T| is beyond -3 dB at the lowest frequency of the grid.
        """
        first, falls = [], []
        for L, q in self.loops(law):
            apart = 1 + 2 * gain * L.real + gain**2 * q  # |1 + g L|^2
            first.append(self._where(1 / (HALF_POWER * apart)))
            falls.append(self._where(HALF_POWER * apart / (gain**2 * q)))
        return np.array(first), np.array(falls)

    def last_falls(self, law: Response, gain: float) -> Samples:
        """Returns the highest frequencies in Hz at which |T| falls below -3 dB, as an array with
        one row per delay of the loop and one column per plant."""
        found = []
        for L, q in self.loops(law):
            level = gain**2 * q / (HALF_POWER * (1 + 2 * gain * L.real + gain**2 * q))
            above = level[:, ::-1] >= 1
            i = level.shape[1] - 1 - np.argmax(above, axis=1)
            j = np.minimum(i + 1, level.shape[1] - 1)
            found.append(np.where(above.any(axis=1), self._between(level, i, j), 0.0))
        return np.array(found)

    def _where(self, level: Samples) -> Samples:
        """Returns the first frequency of each row at which `level` exceeds 1."""
        past = level >= 1
        j = np.where(past.any(axis=1), np.argmax(past, axis=1), level.shape[1] - 1)
        return np.where(j == 0, 0.0, self._between(level, np.maximum(j - 1, 0), j))

    def _between(self, level: Samples, i: NDArray[np.intp], j: NDArray[np.intp]) -> Samples:
        rows = np.arange(len(level))
        low, high = np.log(level[rows, i]), np.log(level[rows, j])
        span = np.where(high == low, 1.0, high - low)
        share = np.clip(-low / span, 0, 1)
        step = self.log_f[rows, j] - self.log_f[rows, i]
        return np.asarray(np.exp(self.log_f[rows, i] + share * step))

    def peaks(self, law: Response, gain: float) -> tuple[Samples, Samples]:
        """Returns (largest |S|, largest |T|) on the grid, each as an array with one row per delay
        of the loop and one column per plant."""
        s, t = [], []
        for L, q in self.loops(law):
            apart = 1 + 2 * gain * L.real + gain**2 * q
            s.append(1 / np.sqrt(apart.min(axis=1)))
            t.append(np.sqrt((gain**2 * q / apart).max(axis=1)))
        return np.array(s), np.array(t)

    def margins(self, law: Response, gain: float) -> tuple[float | None, float | None]:
        """Returns (gain margin, phase margin in degrees), each as the smallest value over all
        plants and all delays of the loop. A margin is None if no plant has this margin."""
        factor, phase = math.inf, math.inf
        for L, q in self.loops(law):
            value = gain * L
            im, re = value.imag, value.real
            rows, columns = np.nonzero((im[:, :-1] * im[:, 1:] < 0) & (re[:, :-1] < 0))
            i, j = im[rows, columns], im[rows, columns + 1]
            at = re[rows, columns] + (re[rows, columns + 1] - re[rows, columns]) * i / (i - j)
            at = np.concatenate([at, re[:, -1]])
            at = at[(at < 0) & (at > -1)]
            factor = min(factor, np.min(-1 / at, initial=math.inf))
            size = np.log(gain**2 * q)
            rows, columns = np.nonzero(size[:, :-1] * size[:, 1:] < 0)
            i, j = size[rows, columns], size[rows, columns + 1]
            share = i / (i - j)
            turned = -value  # the angle of -value is the phase margin
            near = turned[rows, columns] * (1 - share) + turned[rows, columns + 1] * share
            phase = min(phase, np.min(np.abs(np.angle(near)), initial=math.inf))
        return (
            float(factor) if math.isfinite(factor) else None,
            math.degrees(phase) if math.isfinite(phase) else None,
        )


def blocks(plants: PlantSet, members: Sequence[Member], timings: Sequence[str]) -> list[Grid]:
    """Returns several grids with a few plants each, so that the arrays of a grid are smaller than
    the processor's cache."""
    found: list[Grid] = []
    refused: _core.InputError | None = None
    for i in range(0, len(members), BLOCK_MEMBERS):
        try:
            found.append(Grid(plants, members[i : i + BLOCK_MEMBERS], timings))
        except _core.InputError as error:
            if "expected a path" not in str(error):
                raise
            refused = error
    if not found:
        raise refused or _core.InputError("members: expected at least one plant, got none")
    return found


def _highest(values: Samples) -> Index:
    row, column = np.unravel_index(int(np.argmax(values)), values.shape)
    return int(row), int(column)


def _first_root(ahead: Samples, share_q: Samples, constant: float) -> tuple[float, Index]:
    """Returns (gain, index of the grid point) for the smallest gain g > 0 that fulfils the equation
    constant - 2 g ahead + g^2 q' = 0 at a point of the grid. `share_q` is q' times `constant`."""
    root = ahead**2 - share_q
    real = (root >= 0) & (ahead > 0)
    if not real.any():
        return math.inf, (0, 0)
    value = np.where(real, ahead + np.sqrt(np.maximum(root, 0)), 0.0)
    at = _highest(value)
    return constant / value[at], at
