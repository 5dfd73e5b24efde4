"""Order and results of an Analyzer: classes MeasuringOrder, Rest and Level."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from forceaxis.identify.measurement import Measurement

MOST_CODES = 1024

Samples = NDArray[np.float64]
Response = NDArray[np.complex128]


@dataclass(frozen=True)
class MeasuringOrder:
    """Settings of an Analyzer's measurement. Frequencies are in Hz, forces in N, times in s, the
    travel in encoder counts."""

    band_hz: tuple[float, float] = (1.0, 100.0)
    resolution_hz: float = 1.0
    averages: int = 8
    #: number of averages that suffices if the error is below CERTAIN; 0: all averages are needed
    fewest: int = 0
    settle_s: float = 1.0
    force_max_N: float = math.inf
    travel: int = 500  #: largest distance from the start position of a measurement
    #: Amplitude in DAC codes. With 0, the Analyzer searches the amplitude, beginning at `first`.
    amplitude: int = 0
    first: int = 1
    most: int = MOST_CODES  #: largest code of the search
    seed: int = 1
    #: True: searches for dry friction; with friction, the amplitude is large enough for sliding
    finds_friction: bool = True
    rubs: bool = False  #: True: the axis has dry friction, whose effect grows at smaller amplitudes
    swing: float = 0.4  #: range of the force from peak to peak as a share of the bias force
    #: relative difference from the force set-point below which the force has settled
    within: float = 0.05


@dataclass(frozen=True)
class Rest:
    """State of the axis at rest: mean measured force in counts, position in counts, and noise in
    ADC codes (see noise_of).

    The noise is None at an end of the converter's range, because the range then hides half of the
    noise.
    """

    reading: float
    noise_lsb: float | None
    position: int


@dataclass(frozen=True)
class Abort:
    """An excitation that the axis has ended early: amplitude in DAC codes and name of
    `excitation_state`."""

    amplitude: int
    why: str


@dataclass
class Level:
    """A measured response and the conditions of the measurement. The fields are set in the course
    of the measurement. Forces are in N: smallest and largest value of all recordings."""

    amplitude: int
    bias_N: float | None = None
    noise_lsb: float | None = None
    measured_or_none: Measurement | None = None  #: once it is measured
    #: (n,) complex sensitivity function of the loop during the measurement, and its standard error
    sensitivity: Response = field(default_factory=lambda: np.zeros(0, complex))
    sensitivity_error: Samples = field(default_factory=lambda: np.zeros(0))
    force_min_N: float | None = None
    force_max_N: float | None = None
    #: range of the output from peak to peak, in N in contact and in counts out of contact
    swing: float = 0.0
    #: Rms rate of change of the output that the waveform alone causes:
    #: N/s in contact, counts/s out of contact.
    speed_rms: float = 0.0
    #: ratio of the difference between the first realisations to the noise of the realisations
    distorted: float = 1.0
    aborts: list[Abort] = field(default_factory=list)
    of_loop: bool = False

    @property
    def measured(self) -> Measurement:
        """Returns the measured response. Raises ValueError if the response is not yet measured."""
        if self.measured_or_none is None:
            raise ValueError("expected a response that is measured")
        return self.measured_or_none


def noise_of(raw: NDArray[np.int64 | np.float64]) -> float:
    """Returns the rms noise of a signal at standstill, in the unit of the signal. The noise is
    computed from differences of successive samples, which exclude a slow limit cycle between two
    codes."""
    return float(np.std(np.diff(raw)) / math.sqrt(2))
