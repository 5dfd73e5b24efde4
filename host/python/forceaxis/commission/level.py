"""What an Analyzer is asked for and what it gives: MeasuringOrder, Rest, Level."""

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
    """What to measure; frequencies in Hz, forces in N, times in s, travel in counts."""

    band_hz: tuple[float, float] = (1.0, 100.0)
    resolution_hz: float = 1.0
    averages: int = 8
    fewest: int = 0  #: averages that are enough once the response is CERTAIN; 0: all
    settle_s: float = 1.0
    force_max_N: float = math.inf
    travel: int = 500  #: from where a level or the free response begins
    amplitude: int = 0  #: codes; 0: searched, from `first` on
    first: int = 1
    most: int = MOST_CODES  #: codes that are searched up to
    seed: int = 1
    finds_friction: bool = True  #: dry friction, whose response is that of a noise that slides
    rubs: bool = False  #: with dry friction, of which less amplitude shows more
    swing: float = 0.4  #: of the bias force, from peak to peak
    within: float = 0.05  #: of the force asked for, in which the reading stands


@dataclass(frozen=True)
class Rest:
    """The axis at rest: mean reading in counts, noise in codes of the ADC (see noise_of; None: a
    reading at the converter's end shows half of it), position in counts."""

    reading: float
    noise_lsb: float | None
    position: int


@dataclass(frozen=True)
class Abort:
    """An excitation that the axis ended: its amplitude in codes, and the name of
    excitation_state."""

    amplitude: int
    why: str


@dataclass
class Level:
    """A response and the conditions of its measurement, which fills the fields one by one. Forces
    in N: the least and the largest of every recorded reading."""

    amplitude: int
    bias_N: float | None = None
    noise_lsb: float | None = None
    measured_or_none: Measurement | None = None  #: once it is measured
    #: (n,) complex, of the loop that was measured in, and its standard error
    sensitivity: Response = field(default_factory=lambda: np.zeros(0, complex))
    sensitivity_error: Samples = field(default_factory=lambda: np.zeros(0))
    force_min_N: float | None = None
    force_max_N: float | None = None
    swing: float = 0.0  #: from peak to peak, N in contact, counts apart
    speed_rms: float = 0.0  #: of the output by the waveform alone: N/s in contact, counts/s apart
    distorted: float = 1.0  #: how many times more the first realisations differ than noise does
    aborts: list[Abort] = field(default_factory=list)
    of_loop: bool = False

    @property
    def measured(self) -> Measurement:
        """The response. Raises ValueError before it is measured."""
        if self.measured_or_none is None:
            raise ValueError("expected a response that is measured")
        return self.measured_or_none


def noise_of(raw: NDArray[Any]) -> float:
    """Noise of readings at standstill, rms in their unit: from sample to sample, so that a slow
    limit cycle between two codes is not counted."""
    return float(np.std(np.diff(raw)) / math.sqrt(2))
