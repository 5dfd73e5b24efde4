"""A capture of the recorder, assembled from the received blocks."""

import numpy as np

from forceaxis.bus.messages import axis_capture_t
from forceaxis.bus.state_names import BY_NAME

# Samples; a limit above any recorder's, so that a corrupted number allocates nothing.
LARGEST = 1_000_000


class Assembly:
    """One capture: rows of raw values by sample, and which of them were received."""

    def __init__(self):
        self.signals, self.raw, self.have = (), np.zeros((0, 0), np.int64), np.zeros(0, bool)
        self.decimation = self.trigger_sample = 0
        self.first_tick = None  # of sample 0
        self.newest_us = 0

    def take(self, block):
        """Adds an axis_capture_t; False if it does not fit what came before."""
        shape = (block.total_samples, block.num_signals)
        if not self.signals:
            if not (0 < shape[0] <= LARGEST and 0 < shape[1] <= 64):
                return False
            self.signals, self.raw = tuple(block.signal), np.zeros(shape, np.int64)
            self.have = np.zeros(shape[0], bool)
            self.decimation = max(1, block.decimation)
        stop = block.first_sample + block.num_samples
        if tuple(block.signal) != self.signals or not 0 <= block.first_sample <= stop <= shape[0]:
            return False
        if shape != self.raw.shape:
            return False
        if block.num_samples:
            self.raw[block.first_sample : stop] = block.value
            self.have[block.first_sample : stop] = True
        self.trigger_sample, self.newest_us = block.trigger_sample, block.wall_utime
        if block.first_tick != axis_capture_t.NOT_AVAILABLE:
            self.first_tick = block.first_tick - block.first_sample * self.decimation
        return True

    @property
    def total(self):
        return len(self.have)

    @property
    def complete(self):
        return bool(self.signals) and bool(self.have.all())

    @property
    def missing(self):
        return int((~self.have).sum())

    def ticks(self):
        """Tick of every sample; counted from the trigger where the gateway reported no tick."""
        first = self.first_tick
        if first is None:
            first = -self.trigger_sample * self.decimation
        return first + np.arange(self.total, dtype=np.int64) * self.decimation

    def values(self, name):
        """A signal in engineering units, NaN where samples were lost; exact where the scale is 1
        and nothing was."""
        column = self.raw[:, self.signals.index(name)]
        known = BY_NAME.get(name)
        if known and known.scale != 1:
            column = column * known.scale
        return column if self.complete else np.where(self.have, column, np.nan)


def unit_of(name):
    """Unit of an object, "" without a dimension."""
    known = BY_NAME.get(name)
    return known.unit if known and known.unit != "1" else ""
