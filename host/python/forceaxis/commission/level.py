"""The request for a measurement with an Analyzer (MeasuringOrder), and its results (Rest,
Level)."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from forceaxis.identify.measurement import Measurement
from forceaxis.recordings.robust import quiet_of

MOST_CODES = 1024
# Longest time in s until the first contact, if the distance to the workpiece is not known.
APPROACH_MAX_S = 60.0
# If the duration of an approach is known, the time limit is APPROACH_FACTOR times this duration.
# APPROACH_MORE_S, the time in s in which the axis starts, is added.
APPROACH_FACTOR, APPROACH_MORE_S = 3.0, 5.0

Samples = NDArray[np.float64]
Response = NDArray[np.complex128]


@dataclass(frozen=True)
class MeasuringOrder:
    """The request for a measurement with an Analyzer. Frequencies are in Hz, forces in N, times in
    s, and the travel in encoder counts."""

    band_hz: tuple[float, float] = (1.0, 100.0)
    resolution_hz: float = 1.0
    averages: int = 8
    #: smallest number of averages with which the measurement may end early; 0: uses all averages
    fewest: int = 0
    settle_s: float = 1.0
    force_max_N: float = math.inf
    #: largest distance from the start position out of contact, in encoder counts
    travel: int = 500
    #: largest distance in contact from the position at which the axis stands, in encoder counts
    squeeze: int = 500
    #: Encoder counts up to which a measurement widens `travel` and `squeeze` by itself, if the
    #: machine needs it. 0: it does not widen them.
    travel_most: int = 0
    squeeze_most: int = 0
    #: encoder counts per mm of the options that set `travel` and `squeeze`; 0: they are in counts
    counts_per_mm: float = 0.0
    gap: float = 0.0  #: distance to the workpiece in encoder counts; 0: it is not known
    #: Amplitude of the excitation in DAC codes.
    #: If the amplitude is 0, the Analyzer searches it, beginning at `first`.
    amplitude: int = 0
    first: int = 1
    most: int = MOST_CODES  #: largest amplitude in DAC codes that the search tries
    seed: int = 1
    #: True: searches for dry friction, and makes the axis slide if there is friction
    finds_friction: bool = True
    #: True: the axis has dry friction, whose effect is larger at smaller amplitudes
    rubs: bool = False
    #: force in N with which the axis makes its first contact, if it is less than that at which it
    #: is measured; 0: that at which it is measured
    touch_N: float = 0.0
    #: largest force in N to which the first contact of an axis with dry friction may be increased;
    #: 0: it is not increased
    touch_most_N: float = 0.0
    swing: float = 0.4  #: peak-to-peak range of the force, divided by the bias force
    #: a force has settled if its relative difference from the set-point is below this value
    within: float = 0.05

    def wider(self, bound: str, counts: float) -> str:
        """Returns a text that names the option for the bound `bound` ("travel" or "squeeze"), with
        the value for `counts` encoder counts, rounded up to two digits."""
        name, value = bound, counts
        if self.counts_per_mm:
            name, value = f"{bound}_mm", counts / self.counts_per_mm
        elif bound == "squeeze":
            # without a model, one value in counts sets both bounds of the travel
            name = "travel"
        step = 10.0 ** (math.floor(math.log10(max(value, 1e-9))) - 1)
        return f"give `{name}` {math.ceil(value / step - 1e-9) * step:.6g}"

    def approach_s(self, counts_per_s: float) -> float:
        """Returns the longest time in s until the first contact, at an approach speed in encoder
        counts/s. If the distance is not known, it is APPROACH_MAX_S."""
        if not self.gap:
            return APPROACH_MAX_S
        return APPROACH_FACTOR * self.gap / max(counts_per_s, 1.0) + APPROACH_MORE_S


@dataclass(frozen=True)
class Rest:
    """State of the axis at rest: mean measured force in 8-bit counts, position in encoder counts,
    and noise of the measured force in ADC codes (see noise_of).

    The noise is None if the signal is at an end of the range of the ADC, because half of the noise
    is then cut off.
    """

    reading: float
    noise_lsb: float | None
    position: int


@dataclass(frozen=True)
class Abort:
    """An excitation that has ended early: its amplitude in DAC codes, and the reason, usually a
    value of `excitation_state`."""

    amplitude: int
    why: str


@dataclass
class Level:
    """A measured response, and the conditions of its measurement. The fields are set during the
    measurement. Forces are in N. `force_min_N` and `force_max_N` are the smallest and the largest
    force in all recordings."""

    amplitude: int
    bias_N: float | None = None
    noise_lsb: float | None = None
    #: the measured response, or None before the measurement
    measured_or_none: Measurement | None = None
    #: complex sensitivity function of the loop during the measurement, and its standard error
    sensitivity: Response = field(default_factory=lambda: np.zeros(0, complex))
    sensitivity_error: Samples = field(default_factory=lambda: np.zeros(0))
    force_min_N: float | None = None
    force_max_N: float | None = None
    #: peak-to-peak range of the output, in N in contact, in encoder counts out of contact
    swing: float = 0.0
    #: Rms rate of change of the output that the excitation alone causes.
    #: The unit of the rate is N/s in contact and encoder counts/s out of contact.
    speed_rms: float = 0.0
    #: difference between the first realisations, divided by their noise
    distorted: float = 1.0
    aborts: list[Abort] = field(default_factory=list)
    of_loop: bool = False

    @property
    def measured(self) -> Measurement:
        """Returns the measured response. Raises ValueError if the response is not yet measured."""
        if self.measured_or_none is None:
            raise ValueError("expected a response that is measured")
        return self.measured_or_none


def noise_of(raw: NDArray[np.int64 | np.float64], held: int = 1) -> float:
    """Returns the rms noise of a signal at standstill, in the unit of the signal. The noise is
    computed from differences of successive samples, so that a slow limit cycle between two codes
    does not count as noise, and without outliers.

    `held`: number of ticks for which the signal keeps each sample, if a converter with a clock of
    its own is slower than the ticks. Differences are taken over this number of ticks.
    """
    steps: Samples = np.asarray(raw[held:] - raw[:-held], dtype=np.float64)
    return quiet_of(steps, 1.0).noise / math.sqrt(2)
