"""Assembles a capture from the blocks that the gateway publishes as messages. A capture is a
recording that the recorder of the axis has made."""

import numpy as np
from numpy.typing import NDArray

from forceaxis.bus.messages import axis_capture_t
from forceaxis.objects import BY_NAME

Samples = NDArray[np.float64]

# Largest accepted number of samples of a capture. No recording of the firmware has more samples.
# A message with a larger number of samples is corrupted, and would allocate much memory.
SAMPLES_MAX = 1_000_000


class Assembly:
    """The samples of one capture. `raw` contains the raw values, with one row for each sample and
    one column for each signal. `have` has one element for each sample, which is True if the sample
    was received."""

    def __init__(self) -> None:
        self.signals: tuple[str, ...] = ()
        self.raw = np.zeros((0, 0), np.int64)
        self.have = np.zeros(0, np.bool_)
        self.decimation = self.trigger_sample = 0
        # tick of the firmware in which the first sample of the capture was recorded
        self.first_tick: int | None = None
        self.newest_us = 0

    def take(self, block: axis_capture_t) -> bool:
        """Adds a block of samples. Returns False if the block does not match the earlier blocks."""
        shape = (block.total_samples, block.num_signals)
        decimation = self.decimation or max(1, block.decimation)
        stop = block.first_sample + block.num_samples
        known = block.first_tick != axis_capture_t.NOT_AVAILABLE
        back = block.first_sample if known else block.trigger_sample
        first_tick = (block.first_tick if known else 0) - back * decimation
        if not (0 < shape[0] <= SAMPLES_MAX and 0 < shape[1] <= 64):
            return False
        if self.signals and (tuple(block.signal), shape) != (self.signals, self.raw.shape):
            return False
        if not fits(first_tick, shape[0], decimation):
            return False
        if not self.signals:
            self.signals, self.raw = tuple(block.signal), np.zeros(shape, np.int64)
            self.have, self.decimation = np.zeros(shape[0], np.bool_), decimation
        # The size of `raw` is set first, so that `missing` is correct even without samples.
        if not (0 <= block.first_sample <= stop <= shape[0]):
            return False
        if block.num_samples:
            self.raw[block.first_sample : stop] = block.value
            self.have[block.first_sample : stop] = True
        self.trigger_sample, self.newest_us = block.trigger_sample, block.wall_utime
        if known:
            self.first_tick = first_tick
        return True

    @property
    def total(self) -> int:
        return len(self.have)

    @property
    def complete(self) -> bool:
        return bool(self.signals) and bool(self.have.all())

    @property
    def missing(self) -> int:
        return int((~self.have).sum())

    def gaps(self) -> list[tuple[int, int]]:
        """Returns the ranges of missing samples. Each range is a pair: index of its first sample,
        and index of the first sample after the range."""
        edges = np.flatnonzero(np.diff(np.concatenate(([True], self.have, [True]))))
        return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]

    def ticks(self) -> NDArray[np.int64]:
        """Returns the tick of each sample. If the gateway reported no tick, the sample at the
        trigger has tick 0."""
        first = self.first_tick
        if first is None:
            first = -self.trigger_sample * self.decimation
        return first + np.arange(self.total, dtype=np.int64) * self.decimation

    def values(self, name: str) -> Samples | NDArray[np.int64]:
        """Returns one signal in engineering units, with one value for each sample and NaN for a
        lost sample. The values are integers if the scale of the object is 1 and no sample was
        lost."""
        column = self.raw[:, self.signals.index(name)]
        known = BY_NAME.get(name)
        if known is None or known.scale == 1:
            values: Samples | NDArray[np.int64] = column
        else:
            values = column.astype(np.float64) * known.scale
        return values if self.complete else np.where(self.have, values, np.nan)


def fits(first_tick: int, samples: int, decimation: int) -> bool:
    """Returns True if the ticks of all samples of a block fit into 64-bit integers. A corrupted
    message may state larger ticks."""
    ends = first_tick, first_tick + max(0, samples - 1) * decimation
    return all(-(2**63) <= tick < 2**63 for tick in ends)


def unit_of(name: str) -> str:
    """Returns the unit of an object, or "" if the object has no unit."""
    known = BY_NAME.get(name)
    return known.unit if known and known.unit != "1" else ""
