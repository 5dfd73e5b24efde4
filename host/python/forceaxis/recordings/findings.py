"""Finds unusual intervals in a recorded signal: gaps, jumps, saturation and constant intervals."""

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from forceaxis.recordings.signal_recording import Floats, SignalFinding
from forceaxis.words import counted

# A distance between two samples that is above this multiple of the sampling period is a gap.
GAP_PERIODS = 1.6
# A jump is a step between two samples that is this many times as large as each step around it.
# A step is a jump only if it is also at least JUMP_SHARE of the range of all values.
JUMP_FACTOR, JUMP_SHARE, JUMP_NEIGHBOURS = 12.0, 0.05, 4
# smallest number of successive samples at an end of the range that count as saturation
SATURATED_SAMPLES = 3
# A signal that reaches its largest value with a step of this many quanta is cut off there.
SATURATED_QUANTA = 3.0
# Smallest length in samples of a constant interval that is reported as unusual.
# CONSTANT_FACTOR: smallest ratio of this length to the usual length of constant intervals.
CONSTANT_SAMPLES, CONSTANT_FACTOR = 25, 12
STATE_ENDINGS = (
    "_setpoint",
    "_command",
    "code",
    "enabled",
)  # endings of the names of signals that are constant between steps


def find(name: str, time_s: Floats, values: Floats) -> tuple[SignalFinding, ...]:
    """Returns the unusual intervals of a signal: gaps, jumps, saturation and constant intervals.
    `values` (n,): samples at the times `time_s` (n,) in s. For a set-point or a command, jumps and
    constant intervals are usual."""
    found = list(gaps(time_s))
    if len(values) > 2 * JUMP_NEIGHBOURS and not name.endswith(STATE_ENDINGS):
        found += saturations(time_s, values)
        found += jumps(time_s, values)
        found += constants(time_s, values)
    return tuple(sorted(found, key=lambda one: one.from_s))


def gaps(time_s: Floats) -> Iterator[SignalFinding]:
    """Yields a finding for each gap in which samples are missing."""
    if len(time_s) < 3:
        return
    steps = np.diff(time_s)
    period = float(np.median(steps))
    for i in np.flatnonzero(steps > GAP_PERIODS * period):
        missing = max(1, round(float(steps[i]) / period) - 1)
        yield SignalFinding(
            "gap", float(time_s[i]), float(time_s[i + 1]), missing,
            f"no sample for {steps[i]:.4g} s, {counted(missing, 'sample')} missing",
        )  # fmt: skip


def jumps(time_s: Floats, values: Floats) -> Iterator[SignalFinding]:
    """Yields a finding for each step that is much larger than the steps before and after it. A lost
    count or a changed zero causes such a single step. While a contact force rises, in contrast, the
    neighbouring steps are large too."""
    steps = np.abs(np.diff(values))
    wide = JUMP_NEIGHBOURS
    around = np.pad(steps, wide, mode="edge")
    near = [around[k : k + len(steps)] for k in range(2 * wide + 1) if k != wide]
    largest = np.max(near, axis=0)
    quantum = quantum_of(values)
    is_jump = steps > np.maximum(JUMP_FACTOR * np.maximum(largest, quantum), 1e-300)
    is_jump &= steps > JUMP_SHARE * np.ptp(values)
    for i in np.flatnonzero(is_jump):
        yield SignalFinding(
            "jump", float(time_s[i]), float(time_s[i + 1]), 2,
            f"one step from {values[i]:.6g} to {values[i + 1]:.6g}",
        )  # fmt: skip


def saturations(time_s: Floats, values: Floats) -> Iterator[SignalFinding]:
    """Yields a finding for each interval at the largest or smallest value, if the signal both
    enters and leaves it with a steep step. A converter at an end of its range causes such an
    interval."""
    quantum = quantum_of(values)
    steps = np.abs(np.diff(values, prepend=values[0], append=values[-1]))
    for end in (float(values.max()), float(values.min())):
        for a, b in _runs(values == end):
            steep = max(steps[a], steps[b]) >= SATURATED_QUANTA * quantum
            # An interval is saturation only if the signal both enters and leaves it with a step.
            # A signal that was at rest at an end of its range only leaves the interval.
            inside = a > 0 and b < len(values) and min(steps[a], steps[b]) > 1.5 * quantum
            if b - a >= SATURATED_SAMPLES and steep and inside:
                yield SignalFinding(
                    "saturation", float(time_s[a]), float(time_s[b - 1]), b - a,
                    f"{b - a} samples at {end:.6g}, an end of the range",
                )  # fmt: skip


def constants(time_s: Floats, values: Floats) -> Iterator[SignalFinding]:
    """Yields a finding for each long constant interval of a signal that otherwise changes. A failed
    sensor causes such intervals."""
    lengths = _equal_runs(values)
    # Half of the samples are in intervals of equal values that are at most this long.
    # A position at rest is often constant, so the usual length of a constant interval is needed.
    usual = float(np.median(np.repeat([b - a for a, b in lengths], [b - a for a, b in lengths])))
    least = max(CONSTANT_SAMPLES, CONSTANT_FACTOR * usual)
    for a, b in lengths:
        if b - a >= least:
            yield SignalFinding(
                "constant", float(time_s[a]), float(time_s[b - 1]), b - a,
                f"{b - a} samples of {values[a]:.6g}",
            )  # fmt: skip


def quantum_of(values: Floats) -> float:
    """Returns the smallest difference other than 0 between two values of a signal, or 0."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-9 * max(float(np.abs(values).max()), 1e-300)]
    return float(steps.min()) if len(steps) else 0.0


def _runs(inside: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Returns the index ranges [(begin, end)] in which an array is True."""
    turns = np.flatnonzero(np.diff(inside.astype(np.int8), prepend=0, append=0))
    return [(int(a), int(b)) for a, b in turns.reshape(-1, 2)]


def _equal_runs(values: Floats) -> list[tuple[int, int]]:
    """Returns the index ranges [(begin, end)] of successive equal values in an array."""
    turns = np.flatnonzero(np.diff(values)) + 1
    bounds = [0, *turns.tolist(), len(values)]
    return list(itertools.pairwise(bounds))
