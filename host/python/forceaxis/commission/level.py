"""Order and results of an Analyzer: MeasuringOrder, Rest, Level."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forceaxis.identify.measurement import Measurement

MOST_CODES = 1024

Samples = NDArray[np.float64]
Response = NDArray[np.complex128]


@dataclass(frozen=True)
class MeasuringOrder:
    """Settings of the measurement of an Analyzer. Frequencies are in Hz, forces in N, times in s,
    the travel in encoder counts."""

    band_hz: tuple[float, float] = (1.0, 100.0)
    resolution_hz: float = 1.0
    averages: int = 8
    #: number of averages that is enough if the error is below CERTAIN; 0: all averages are needed
    fewest: int = 0
    settle_s: float = 1.0
    force_max_N: float = math.inf
    travel: int = 500  #: distance from the start position of a measurement
    amplitude: int = 0  #: codes; 0: the amplitude is searched, beginning at `first`
    first: int = 1
    most: int = MOST_CODES  #: largest code of the search
    seed: int = 1
    #: searches for dry friction; with friction, the amplitude is large enough to slide
    finds_friction: bool = True
    rubs: bool = False  #: the axis has dry friction, whose effect grows at smaller amplitudes
    swing: float = 0.4  #: range of the force peak to peak, as a share of the bias force
    #: relative distance from the force set-point at which the force counts as settled
    within: float = 0.05


@dataclass(frozen=True)
class Rest:
    """State of the axis at rest: mean measured force in counts; noise in codes of the ADC (see
    noise_of), None at an end of the converter's range, where half of the noise is cut off; position
    in counts."""

    reading: float
    noise_lsb: float | None
    position: int


@dataclass(frozen=True)
class Abort:
    """An excitation that the axis has ended: amplitude in codes and name of excitation_state."""

    amplitude: int
    why: str


@dataclass
class Level:
    """A measured response and the conditions of the measurement; the fields are set in the course
    of the measurement. Forces in N: smallest and largest value of all recordings."""

    amplitude: int
    bias_N: float | None = None
    noise_lsb: float | None = None
    measured_or_none: Measurement | None = None  #: once it is measured
    #: (n,) complex, sensitivity function of the loop during the measurement; its standard error
    sensitivity: Response = field(default_factory=lambda: np.zeros(0, complex))
    sensitivity_error: Samples = field(default_factory=lambda: np.zeros(0))
    force_min_N: float | None = None
    force_max_N: float | None = None
    swing: float = 0.0  #: peak to peak, N in contact, counts out of contact
    #: rms of the output's rate, from the waveform alone: N/s in contact, counts/s out of contact
    speed_rms: float = 0.0
    distorted: float = 1.0  #: ratio of the difference between the first realisations to their noise
    aborts: list[Abort] = field(default_factory=list)
    of_loop: bool = False

    @property
    def measured(self) -> Measurement:
        """The measured response. Raises ValueError if the response is not yet measured."""
        if self.measured_or_none is None:
            raise ValueError("expected a response that is measured")
        return self.measured_or_none


def noise_of(raw: NDArray[Any]) -> float:
    """Rms noise of a signal at standstill, in the unit of the signal. The noise is computed from
    differences of successive samples, which exclude a slow limit cycle between two codes."""
    return float(np.std(np.diff(raw)) / math.sqrt(2))
