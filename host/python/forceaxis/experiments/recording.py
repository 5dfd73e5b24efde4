"""Writes the trace of a run as a recording of LCM messages. The channel SIM_TRUTH has all signals.
The channel AXIS_1_STATE has what the gateway of this axis would publish, as far as the trace has
it, so that a monitor can replay the run."""

import heapq
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from forceaxis import paths
from forceaxis.bus.lcm import blank
from forceaxis.bus.log import LogEntry
from forceaxis.bus.messages import axis_state_t, sim_truth_t
from forceaxis.bus.recordings import writer_of
from forceaxis.experiments.run import Run
from forceaxis.objects import BY_NAME

TRUTH, STATE = "SIM_TRUTH", "AXIS_1_STATE"
BLOCK_SAMPLES = 150  # number of samples in one message, which are 0.1 s
STATE_TICKS = 50  # ticks from one state to the next: 30 per second, as a gateway publishes them
CODE_UNITS = {"encoder": "count", "adc0": "code", "adc1": "code", "dac": "code"}
NOT_SIGNALS = ("tick", "time_s")  # columns of the trace that are the time of a message


def unit_of(done: Run, column: str) -> str:
    """Returns the unit of a column of the trace of a run. It is "1" for a number without a unit."""
    if column in done.units:
        return BY_NAME[column].unit
    return CODE_UNITS.get(column) or done.signal_units.get(column, "1")


def entries(done: Run) -> Iterator[LogEntry]:
    """Yields the trace of a run as messages of the simulator and of a gateway. The times of the
    messages are counted from the start of the run, so that equal runs give equal messages."""
    yield from heapq.merge(_truths(done), _states(done), key=lambda entry: entry.wall_us)


def _published_us(tick: int) -> int:
    """Returns the time in us at which a message is published: when its last tick has ended."""
    return (tick + 1) * 2000 // 3


def _run_id(done: Run) -> int:
    return int(done.result.trace_hash[:15], 16) + 1


def _states(done: Run) -> Iterator[LogEntry]:
    """Yields the states of the axis. What the trace does not have is not available."""
    columns, converters = done.columns, done.result.converters
    force, encoder, dac = (converters.get(name) for name in ("adc0", "encoder", "dac"))
    # A gateway publishes whole codes of 12 bits, whatever the resolution of the DAC is.
    step = 2.0 ** (12 - dac.bits) if dac else 1.0
    ticks = columns["tick"]
    for number, row in enumerate(range(0, len(ticks), STATE_TICKS)):
        state = blank(axis_state_t)
        state.tick = int(ticks[row])
        state.utime, state.wall_utime = state.tick * 2000 // 3, _published_us(state.tick)
        state.seq, state.run_id = number, _run_id(done)
        state.axis, state.nmt_state, state.age_us = 1, axis_state_t.NMT_OPERATIONAL, 0
        if encoder is not None:
            state.position_cnt = int(columns["encoder"][row])
        if force is not None:
            counts = (int(columns["adc0"][row]) - force.zero) / 2 ** (force.bits - 8)
            state.force_raw = int(columns["adc0"][row])
            state.force_cnt_q8 = round(256 * counts)
            if force.unit == "N":
                state.force_scale_uN = round(1e6 * force.per_code * 2 ** (force.bits - 8))
        state.dac_code = math.floor(int(columns["dac"][row]) * step + 0.5)
        state.fault = int(columns["fault"][row])
        state.limit_reason = int(columns["limit_reason"][row])
        yield LogEntry(state.wall_utime, STATE, state.encode())


def _truths(done: Run) -> Iterator[LogEntry]:
    signals = [name for name in done.columns if name not in NOT_SIGNALS]
    units = [unit_of(done, name) for name in signals]
    table = np.column_stack([done.columns[name].astype(float) for name in signals])
    ticks = done.columns["tick"]
    for number, start in enumerate(range(0, len(ticks), BLOCK_SAMPLES)):
        rows = table[start : start + BLOCK_SAMPLES].tolist()
        block = sim_truth_t()
        first, last = int(ticks[start]), int(ticks[start + len(rows) - 1])
        block.utime = first * 2000 // 3
        block.wall_utime = _published_us(last)
        block.seq, block.run_id = number, _run_id(done)
        block.axis, block.first_tick, block.decimation = 1, first, 1
        block.num_signals, block.signal, block.unit = len(signals), signals, units
        block.num_samples, block.value = len(rows), rows
        yield LogEntry(block.wall_utime, TRUTH, block.encode())


def write(done: Run, path: Path) -> None:
    """Writes the trace of a run to the file `path`: as MCAP for the suffix .mcap, otherwise as an
    LCM log. An existing file is replaced. Raises InputError, OSError."""
    with paths.replacing(path.parent, path.name) as (file,), file.open("wb") as stream:
        writer = writer_of(path, stream)
        for entry in entries(done):
            writer.write(entry.channel, entry.data, entry.wall_us)
        writer.close()
