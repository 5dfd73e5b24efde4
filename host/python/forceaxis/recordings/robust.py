"""Zero, noise and spikes of a signal. A few wrong samples change none of them.

Everything that has a signal at rest takes its zero and its noise from quiet_of(). A sample of a
converter that was disturbed is an outlier there, and a spike where the signal moves.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forceaxis.recordings.signal_recording import Floats

# standard deviation of normally distributed values, divided by their median deviation
NORMAL_SCALE = 1.4826
# An outlier is farther from the median than OUTLIER_DEVIATIONS standard deviations of the noise.
# An outlier is also farther from the median than OUTLIER_DEVIATIONS of the smallest steps.
# If more than OUTLIER_SHARE of the values are outliers, the signal is not at rest.
OUTLIER_DEVIATIONS, OUTLIER_SHARE = 8.0, 0.125
# A spike leaves the signal and comes back to it. It has at most SPIKE_SAMPLES samples.
# The samples of a spike are equal, because some programs repeat a sample.
# Both steps of a spike are SPIKE_FACTOR times as large as each of the four steps on either side.
# Both are also SPIKE_FACTOR times as large as the difference of the samples before and after it.
# Both steps are at least SPIKE_SHARE of the range of all other values.
SPIKE_SAMPLES, SPIKE_FACTOR, SPIKE_NEIGHBOURS, SPIKE_SHARE = 3, 12.0, 4, 0.01
# A contact of one sample is followed by another contact within RETURN_S, because the axis presses.
# A single sample without another contact within RETURN_S is a disturbance of the sensor.
# A single sample above DISTURBED_FACTOR times the largest other force is also a disturbance.
# For the largest other force, only forces that two successive samples reach are counted.
RETURN_S, DISTURBED_FACTOR = 0.5, 10.0
BLOCK_SAMPLES = 1 << 20  # number of samples that are searched at once


@dataclass(frozen=True)
class Quiet:
    """A signal at rest, without its outliers."""

    zero: float  # mean of the values
    noise: float  # standard deviation of the values
    count: int  # number of the values
    usual: NDArray[np.bool_]  # (n,): False for an outlier


def quiet_of(values: NDArray[np.int64 | np.float64], step: float = 0.0) -> Quiet:
    """Returns zero and noise of a signal (n,), n > 0, at rest. `step`: smallest step of the
    values, or 0. Without outliers, they are the mean and the standard deviation of all values."""
    off = np.abs(values - np.median(values))
    least = max(NORMAL_SCALE * float(np.median(off)), step)
    usual = off <= OUTLIER_DEVIATIONS * least
    if least == 0.0 or np.count_nonzero(~usual) > OUTLIER_SHARE * len(values):
        usual[:] = True
    kept = values if usual.all() else values[usual]
    return Quiet(float(kept.mean()), float(kept.std()), len(kept), usual)


def blocks(count: int) -> Iterator[tuple[int, int]]:
    """Yields (begin, end) of blocks of indices. A long recording is searched in blocks, so that the
    search takes little memory."""
    for begin in range(0, count, BLOCK_SAMPLES):
        yield begin, min(begin + BLOCK_SAMPLES, count)


def spikes_of(values: Floats, step: float) -> list[tuple[int, int]]:
    """Returns the index ranges (begin, end) of the spikes of a signal (n,). `step`: smallest step
    of the values, or 0."""
    found = [
        (begin, begin + width)
        for width in range(1, SPIKE_SAMPLES + 1)
        for begin in _candidates(values, step, width)
    ]
    if not found:
        return []
    others = np.ones(len(values), dtype=bool)
    for begin, end in found:
        others[begin:end] = False
    least = SPIKE_SHARE * float(
        np.max(values, where=others, initial=-np.inf) - np.min(values, where=others, initial=np.inf)
    )
    return sorted((a, b) for a, b in found if abs(values[a] - values[a - 1]) >= least)


def _candidates(values: Floats, step: float, width: int) -> Iterator[int]:
    """Yields the begin of each spike of `width` samples, whatever the range of the signal is."""
    near, count = SPIKE_NEIGHBOURS, len(values) - 1
    for begin, end in blocks(count):
        low, high = max(begin - near, 0), min(end + near + width, count)
        steps = np.diff(values[low : high + 1])
        if len(steps) <= width + 1:
            return
        sizes = np.pad(np.abs(steps), near, mode="edge")
        up, down = steps[:-width], steps[width:]
        largest = np.maximum(np.abs(up + down), step)
        for k in range(1, near + 1):
            np.maximum(largest, sizes[near - k : near - k + len(up)], out=largest)
            np.maximum(largest, sizes[near + width + k :][: len(up)], out=largest)
        is_spike = np.minimum(np.abs(up), np.abs(down)) > np.maximum(SPIKE_FACTOR * largest, 1e-300)
        for k in range(1, width):
            is_spike &= steps[k : k + len(up)] == 0
        for at in np.flatnonzero(is_spike[begin - low : end - low]):
            yield begin + int(at) + 1


def is_contact(time_s: Floats, values: Floats, begin: int, end: int) -> bool:
    """Returns True if a spike of a force (n,) from `begin` to `end` may be a contact, because
    another contact follows."""
    level, height = values[begin - 1], values[begin] - values[begin - 1]
    last = int(np.searchsorted(time_s, time_s[end - 1] + RETURN_S, side="right"))
    above = np.sign(height) * (values[end:last] - level)
    pairs = float(np.max(np.minimum(above[1:], above[:-1]), initial=0.0))
    return bool(height > 0 and abs(height) <= DISTURBED_FACTOR * pairs)


def without(values: Floats, spikes: list[tuple[int, int]]) -> Floats:
    """Returns a signal (n,) in which each spike has the value before it."""
    if not spikes:
        return values
    found = values.copy()
    for begin, end in spikes:
        found[begin:end] = found[begin - 1]
    return found
