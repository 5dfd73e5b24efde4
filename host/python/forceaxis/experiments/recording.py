"""Writes the trace of a run as a recording of LCM messages. The channel SIM_TRUTH has all
signals."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from forceaxis import paths
from forceaxis.bus.log import LogEntry
from forceaxis.bus.messages import sim_truth_t
from forceaxis.bus.recordings import writer_of
from forceaxis.experiments.run import Run
from forceaxis.objects import BY_NAME

CHANNEL = "SIM_TRUTH"
BLOCK_SAMPLES = 150  # number of samples in one message, which are 0.1 s
CODE_UNITS = {"encoder": "count", "adc0": "code", "adc1": "code", "dac": "code"}
NOT_SIGNALS = ("tick", "time_s")  # columns of the trace that are the time of a message


def unit_of(done: Run, column: str) -> str:
    """Returns the unit of a column of the trace of a run. It is "1" for a number without a unit."""
    if column in done.units:
        return BY_NAME[column].unit
    return CODE_UNITS.get(column) or done.signal_units.get(column, "1")


def entries(done: Run) -> Iterator[LogEntry]:
    """Yields the trace of a run as messages of the simulator. The times of the messages are counted
    from the start of the run, so that equal runs give equal messages."""
    signals = [name for name in done.columns if name not in NOT_SIGNALS]
    units = [unit_of(done, name) for name in signals]
    table = np.column_stack([done.columns[name].astype(float) for name in signals])
    ticks = done.columns["tick"]
    for number, start in enumerate(range(0, len(ticks), BLOCK_SAMPLES)):
        rows = table[start : start + BLOCK_SAMPLES].tolist()
        block = sim_truth_t()
        first, last = int(ticks[start]), int(ticks[start + len(rows) - 1])
        block.utime = first * 2000 // 3
        # The message is published when its last tick has ended.
        block.wall_utime = (last + 1) * 2000 // 3
        block.seq, block.run_id = number, int(done.result.trace_hash[:15], 16) + 1
        block.axis, block.first_tick, block.decimation = 1, first, 1
        block.num_signals, block.signal, block.unit = len(signals), signals, units
        block.num_samples, block.value = len(rows), rows
        yield LogEntry(block.wall_utime, CHANNEL, block.encode())


def write(done: Run, path: Path) -> None:
    """Writes the trace of a run to the file `path`: as MCAP for the suffix .mcap, otherwise as an
    LCM log. An existing file is replaced. Raises InputError, OSError."""
    with paths.replacing(path.parent, path.name) as (file,), file.open("wb") as stream:
        writer = writer_of(path, stream)
        for entry in entries(done):
            writer.write(entry.channel, entry.data, entry.wall_us)
        writer.close()
