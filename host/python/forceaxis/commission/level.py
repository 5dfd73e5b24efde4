"""What an Analyzer is asked for and what it gives: Order, Rest, Level."""

import math
from dataclasses import dataclass, field

import numpy as np

from forceaxis.identify.measurement import Measurement

MOST_CODES = 1024


@dataclass(frozen=True)
class Order:
    """What to measure; frequencies in Hz, forces in N, times in s, travel in counts."""

    band_hz: tuple = (1.0, 100.0)
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


@dataclass
class Level:
    """A measured response and how it was come by. Forces in N, the least and largest of every
    recorded reading; aborts: [{"amplitude", "why"}]."""

    measured: Measurement
    amplitude: int
    #: (n,) complex, of the loop that was measured in, and its standard error
    sensitivity: np.ndarray | None = None
    sensitivity_error: np.ndarray | None = None
    bias_N: float | None = None
    force_min_N: float | None = None
    force_max_N: float | None = None
    swing: float = 0.0  #: from peak to peak, N in contact, counts apart
    noise_lsb: float | None = None
    speed_rms: float = 0.0  #: of the output by the waveform alone: N/s in contact, counts/s apart
    distorted: float = 1.0  #: how many times more the first realisations differ than noise does
    aborts: list = field(default_factory=list)
    of_loop: bool = False

    def about(self):
        """For JSON."""
        return {k: v for k, v in vars(self).items() if not isinstance(v, ARRAYS)}


def noise_of(raw):
    """Noise of readings that stand, rms in their unit: from sample to sample, so that a slow limit
    cycle between two codes is none."""
    return float(np.std(np.diff(raw)) / math.sqrt(2))


ARRAYS = (Measurement, np.ndarray)
