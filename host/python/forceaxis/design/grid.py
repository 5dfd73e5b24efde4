"""Frequency responses of a set of plants on grids of frequencies, with which force laws are
evaluated fast.

The evaluation is in C++ (sim/linear/law_grid.hpp) and takes some microseconds for each plant. Each
plant has its own grid of frequencies. The grid is dense near the poles and zeros of this plant,
because a resonance is narrower than the steps of a common grid.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core
from forceaxis.linear.bank import COEFFICIENT_MAX, HF_CODES_MAX, Bank
from forceaxis.linear.plant_set import Member, PlantSet
from forceaxis.linear.precise import law_grid, law_shape
from forceaxis.linear.system import find_model

Samples = NDArray[np.float64]
Response = NDArray[np.complex128]

POLE_ROUNDING_PER_S = 1e-7  # rounding error of a pole at frequency 0, in 1/s
LOWEST_HZ = 0.02  # lowest frequency of a grid in Hz
RAMP_MIN_S = 0.1  # shortest rise time of the set-point ramp
THIN = 1 / 3  # density of a thin grid relative to a full grid
# Default of the largest gain at high frequency, in DAC codes per 8-bit count, for every ADC.
# A finer ADC does not reduce the noise of the measured force in N.
HF_DEFAULT = 80.0
# Share of the bound of `hf_gain` that a design uses, because the firmware rounds coefficients.
HF_SHARE = 0.99


@dataclass(frozen=True)
class Bounds:
    """Bounds that a force loop has to keep.

    `ms`: largest |S| for each delay of the loop. `gain_margin`: smallest gain margin as a factor.
    `phase_margin_deg`: smallest phase margin in degrees, None means no bound. `hf_gain`: largest
    gain at high frequency in DAC codes per 8-bit count.
    """

    ms: tuple[float, ...]
    gain_margin: float
    phase_margin_deg: float | None
    hf_gain: float

    @property
    def core(self) -> _core.LawBounds:
        """Returns the bounds for the evaluation in C++."""
        return _core.LawBounds(
            ms=list(self.ms),
            gain_margin=self.gain_margin,
            phase_margin_deg=self.phase_margin_deg or 0.0,
            hf_gain=self.hf_gain,
        )


@dataclass(frozen=True)
class Goal:
    """The margins that a design has to keep over a set of plants.

    ms, ms_late: largest |S| without and with a tick of delay. gain_margin: smallest gain margin as
    a factor. phase_margin_deg: smallest phase margin in degrees, None means no bound besides ms.
    adc_bits: bits of the force ADC. hf_gain: largest gain at high frequency in DAC codes per 8-bit
    count, None selects HF_DEFAULT. timings: delays of the loop, from loops.TIMINGS. ramp_s: rise
    time in s of a set-point ramp that the force has to follow, None means that it follows from the
    bandwidth and is at least ramp_min_s. static_error_max: largest static error of the law as a
    share of the set-point.
    """

    ms: float = 2.0
    ms_late: float = 2.2
    gain_margin: float = 2.3
    phase_margin_deg: float | None = None
    adc_bits: int = 8
    hf_gain: float | None = None
    timings: tuple[str, ...] = ("zoh", "zoh+1")
    ramp_s: float | None = None
    ramp_min_s: float = RAMP_MIN_S
    static_error_max: float = 1.0

    def ms_of(self, timing: str) -> float:
        """Returns the largest permitted |S| with the delay `timing` of the loop: "zoh" or
        "zoh+1"."""
        return self.ms if timing == "zoh" else self.ms_late

    def bounds(self) -> Bounds:
        """Returns the margins that the design has to keep, as bounds of a force loop."""
        most = hf_most(self.adc_bits)
        return Bounds(
            tuple(self.ms_of(timing) for timing in self.timings),
            self.gain_margin,
            self.phase_margin_deg,
            HF_SHARE * min(most, self.hf_gain or max(HF_DEFAULT, hf_most(8))),
        )

    def hf_cure(self) -> str:
        """Returns a text about what would permit a larger gain at high frequency: a change of the
        axis, or of the required margins."""
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
    "gm" or "pm"). `place`: point of the grid at which the loop reaches this bound, or None for
    "hf".
    """

    gain: float
    name: str
    place: GridPlace | None


class GridFigures(NamedTuple):
    """Bandwidths and margins of stable loops at one gain, as arrays (plants, delays). fS_Hz: first
    frequency at which |S| rises above -3 dB. fT_Hz: last frequency at which |T| falls below -3 dB.
    Both are 0 if the frequency is below the grid, and half the tick rate if it is above the grid.
    Ms: largest |S|. gain_margin, phase_margin_rad: infinity if a loop has no such margin."""

    fS_Hz: Samples
    fT_Hz: Samples
    Ms: Samples
    gain_margin: Samples
    phase_margin_rad: Samples


def hf_most(adc_bits: int) -> float:
    """Returns the largest gain at high frequency that the firmware accepts with an ADC of
    `adc_bits` bits, in DAC codes per 8-bit count."""
    return HF_CODES_MAX * 2.0 ** (adc_bits - 8)


def hf_of_noise(adc_bits: int, noise_codes: float) -> float:
    """Returns the largest gain at high frequency that a design uses by default, in DAC codes per
    8-bit count, for a noise of the measured force in ADC codes, rms.

    The bound of the firmware assumes a noise of one ADC code. With another noise, the bound is such
    that the noise of the command is the same. It is at least HF_DEFAULT, as without a known noise.
    """
    most = hf_most(adc_bits)
    return min(most, max(HF_DEFAULT, most / max(1.0, noise_codes)))


def goal_of_noise(adc_bits: int, noise_codes: float | None) -> Goal:
    """Returns the usual margins with the bound at high frequency that follows from the noise of the
    measured force in ADC codes, rms. None means that the noise is not known."""
    hf_gain = None if noise_codes is None else hf_of_noise(adc_bits, noise_codes)
    return Goal(adc_bits=adc_bits, hf_gain=hf_gain)


@dataclass
class Grid:
    """Frequency responses of a set of plants on a grid of frequencies.

    Plants without a path from the drive command to the measured force are left out of `members`.
    timings: names of precise.DELAYS. density: ratio of the number of grid points to that of a full
    grid. Bandwidths and margins have a relative error of about 0.001. At the density THIN, the
    error is one or two per cent, because a peak may lie between two points of the grid. threads:
    number of threads. It does not change a result. Raises InputError if no plant has a path.
    """

    plants: PlantSet
    members: list[Member]
    timings: Sequence[str]
    density: float = 1.0
    threads: int = 1
    core: _core.LawGrid = field(init=False, repr=False)

    def __post_init__(self) -> None:
        model = _core.ModelFile(find_model(self.plants.model))
        self.core = law_grid(
            model, self.plants, self.members, self.timings, self.density, self.threads
        )
        if not self.core.kept:
            for member in self.members:
                # this call raises an InputError that names the missing path
                self.plants.loop(member, "zoh")
            raise _core.InputError("members: expected at least one plant in the set, got none")
        self.members = [self.members[i] for i in self.core.kept]

    def evaluate(
        self, numbers: Samples, bounds: Bounds, ramp: _core.LawRamp | None = None,
        floors_Hz: Sequence[float] = (),
    ) -> Samples:  # fmt: skip
        """Returns (bandwidth in Hz, largest gain) of each control law, as an array (laws, 2).

        numbers: one row for each law, in the form of `structures`. The bandwidth is that of the
        worst plant at 0.97 times the largest gain. With `ramp`, the bandwidth of a law is reduced
        if the force does not follow this ramp. floors_Hz: one bandwidth for each law. If the
        bandwidth of a law is below it, the evaluation may end early, with values that are too
        large. Both values are 0 for a law that the firmware cannot store.
        """
        return self.core.evaluate(
            numbers, bounds.core, ramp, floors_Hz, COEFFICIENT_MAX, self.threads
        )

    def largest_gain(self, bank: Bank, hf_gain: float, bounds: Bounds) -> GainLimit:
        """Returns the largest gain at which the loops of all plants keep the bounds, and the bound
        that limits this gain. The gain of `bank` is ignored. `hf_gain` is the gain of `bank` at
        high frequency if its gain is 1."""
        gain, name, plant, delay, hz = self.core.largest_gain(law_shape(bank), hf_gain, bounds.core)
        return GainLimit(gain, name, None if name == "hf" else GridPlace(plant, delay, hz))

    def gains(self, bank: Bank, hf_gain: float, bounds: Bounds) -> Samples:
        """Returns the largest gain of each plant alone, as largest_gain() does for all plants."""
        return self.core.gains(law_shape(bank), hf_gain, bounds.core)

    def noise_gain(self, bank: Bank) -> float:
        """Returns the largest magnitude of a filter bank at the frequencies of the grid. The bank
        has the gain 1 and no integral for this."""
        return self.core.noise_gain(law_shape(bank))

    def figures(self, bank: Bank) -> GridFigures:
        """Returns the bandwidths and margins of all loops with a filter bank. The gain of the bank
        must be at most the gain of largest_gain(), because the stability of the loops is not
        checked."""
        values = self.core.figures(law_shape(bank), bank.force_gain)
        return GridFigures(*np.moveaxis(values, 2, 0))

    def ramp(self, members: Sequence[Member], ramp_s: float) -> _core.LawRamp:
        """Returns the loops that have to follow a ramp of the set-point of `ramp_s` seconds. These
        are the loops around `members`, or around the first plant if the grid has none of
        `members`."""
        indices = [i for i, member in enumerate(self.members) if member in members]
        return self.core.ramp(indices or [0], ramp_s)
