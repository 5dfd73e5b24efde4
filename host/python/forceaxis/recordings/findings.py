"""Finds unusual intervals in a recorded signal: gaps, spikes, jumps, saturation and constant
intervals."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from forceaxis.recordings import robust
from forceaxis.recordings.robust import BLOCK_SAMPLES, blocks
from forceaxis.recordings.signal_recording import Floats, SignalFinding, SignalHeader
from forceaxis.words import counted

# Distance of two samples, in sampling periods, above which a gap is between the samples.
GAP_PERIODS = 1.6
# Smallest size of a jump between two samples, divided by the largest step around the jump.
# A step is a jump only if it is also at least JUMP_SHARE of the range of all values.
JUMP_FACTOR, JUMP_SHARE, JUMP_NEIGHBOURS = 12.0, 0.05, 4
# smallest number of successive samples at an end of the range that count as saturation
SATURATED_SAMPLES = 3
# Smallest step, in quanta, with which a signal that is cut off reaches its largest value.
SATURATED_QUANTA = 3.0
# A contact is lost within several samples. A failed sensor, such as one with a loose cable, comes
# to the value without contact in one step that is this many times as large as each step before it.
LOST_FACTOR = 3.0
# Smallest length in samples of a constant interval that is reported as unusual.
# CONSTANT_FACTOR: smallest ratio of this length to the usual length of constant intervals.
CONSTANT_SAMPLES, CONSTANT_FACTOR = 25, 12
STATE_ENDINGS = (
    "_setpoint",
    "_command",
    "code",
    "enabled",
)  # endings of the names of signals that are constant between steps
# endings of the names of signals that a drive may change for a single sample
DRIVEN_ENDINGS = ("current", "torque", "voltage", "acceleration")


def find(name: str, time_s: Floats, values: Floats) -> tuple[SignalFinding, ...]:
    """Returns the unusual intervals of a signal: gaps, spikes, jumps, saturation and constant
    intervals. `values` (n,): samples at the times `time_s` (n,) in s. For a set-point or a command,
    everything but gaps is usual."""
    found = list(gaps(time_s))
    if moves(name) and len(values) > 2 * JUMP_NEIGHBOURS:
        single = spikes(name, time_s, values)
        found += [spike(time_s, values, *one) for one in single]
        rest = robust.without(values, single)
        quantum = quantum_of(rest)
        found += saturations(name, time_s, rest, quantum)
        found += jumps(time_s, rest, quantum)
        found += constants(time_s, rest)
    return tuple(sorted(found, key=lambda one: one.from_s))


def moves(name: str) -> bool:
    """Returns True if a signal with this name changes as a machine does, and not in steps."""
    return not name.endswith(STATE_ENDINGS)


def spikes(name: str, time_s: Floats, values: Floats) -> list[tuple[int, int]]:
    """Returns the index ranges (begin, end) of the spikes of a signal. A spike of a force that may
    be a contact is none. A controller reacts to a contact with a single large sample, so a current
    has no spikes."""
    if name.endswith(DRIVEN_ENDINGS):
        return []
    return [
        (begin, end) for begin, end in robust.spikes_of(values, quantum_of(values))
        if name != "force" or not robust.is_contact(time_s, values, begin, end)
    ]  # fmt: skip


def spike(time_s: Floats, values: Floats, begin: int, end: int) -> SignalFinding:
    """Returns the finding of a spike."""
    before, after = values[begin - 1], values[end]
    return SignalFinding(
        "spike", float(time_s[begin]), float(time_s[end - 1]), end - begin,
        f"{counted(end - begin, 'sample')} of {values[begin]:.6g} between {before:.6g} and "
        f"{after:.6g}",
    )  # fmt: skip


def gaps(time_s: Floats) -> Iterator[SignalFinding]:
    """Yields a finding for each gap in which samples are missing."""
    if len(time_s) < 3:
        return
    period = float(np.median(np.diff(time_s[:BLOCK_SAMPLES])))
    for begin, end in blocks(len(time_s) - 1):
        steps = np.diff(time_s[begin : end + 1])
        for k in np.flatnonzero(steps > GAP_PERIODS * period):
            i, step_s = begin + int(k), float(steps[k])
            missing = max(1, round(step_s / period) - 1)
            yield SignalFinding(
                "gap", float(time_s[i]), float(time_s[i + 1]), missing,
                f"no sample for {step_s:.4g} s, {counted(missing, 'sample')} missing",
            )  # fmt: skip


def spike_notes(signals: Iterable[SignalHeader]) -> list[str]:
    """Returns a note about the spikes of each signal that has some."""
    notes = []
    for signal in signals:
        found = [one for one in signal.findings if one.kind == "spike"]
        if found:
            notes.append(
                f"{signal.name}: {counted(len(found), 'spike')}, at {found[0].from_s:.6g} s first: "
                f"{found[0].text}"
            )
    return notes


def jumps(time_s: Floats, values: Floats, quantum: float) -> Iterator[SignalFinding]:
    """Yields a finding for each step that is much larger than the steps before and after it. A lost
    count or a changed zero causes such a single step. While a contact force rises, in contrast, the
    neighbouring steps are large too."""
    wide, count = JUMP_NEIGHBOURS, len(values) - 1
    least = JUMP_SHARE * float(values.max() - values.min())
    for begin, end in blocks(count):
        low, high = max(begin - wide, 0), min(end + wide, count)
        steps = np.abs(np.diff(values[low : high + 1]))
        around = np.pad(steps, wide, mode="edge")
        largest = np.full(len(steps), quantum)
        for k in range(2 * wide + 1):
            if k != wide:
                np.maximum(largest, around[k : k + len(steps)], out=largest)
        is_jump = (steps > np.maximum(JUMP_FACTOR * largest, 1e-300)) & (steps > least)
        for at in np.flatnonzero(is_jump[begin - low : end - low]):
            i = begin + int(at)
            yield SignalFinding(
                "jump", float(time_s[i]), float(time_s[i + 1]), 2,
                f"one step from {values[i]:.6g} to {values[i + 1]:.6g}",
            )  # fmt: skip


def saturations(
    name: str, time_s: Floats, values: Floats, quantum: float
) -> Iterator[SignalFinding]:
    """Yields a finding for each interval at the largest or smallest value, if the signal both
    enters and leaves it with a steep step. A converter at an end of its range causes such an
    interval. The value with which the signal begins is that of a machine at rest, and a force of 0
    is that without contact, unless the signal jumps to it in the middle of a stroke."""
    rests = [0.0] if name == "force" else []
    if np.all(values[:SATURATED_SAMPLES] == values[0]):
        rests.append(float(values[0]))
    for end in {float(values.max()), float(values.min())}:
        found = runs(values == end)
        found = found[found[:, 1] - found[:, 0] >= SATURATED_SAMPLES]
        for a, b in _lost(values, found, quantum) if end in rests else found.tolist():
            # An interval is saturation only if the signal both enters and leaves it with a step.
            # A signal that was at rest at an end of its range only leaves the interval.
            if a == 0 or b == len(values):
                continue
            steps = sorted((abs(values[a] - values[a - 1]), abs(values[b] - values[b - 1])))
            if steps[1] >= SATURATED_QUANTA * quantum and steps[0] > 1.5 * quantum:
                yield SignalFinding(
                    "saturation", float(time_s[a]), float(time_s[b - 1]), b - a,
                    f"{b - a} samples at {end:.6g}, an end of the range",
                )  # fmt: skip


def _lost(values: Floats, rests: NDArray[np.int64], quantum: float) -> Iterator[tuple[int, int]]:
    """Yields those of the index ranges `rests` (n, 2) at one value of rest in which the signal was
    lost: between the first and the last sample away from this value, and entered with a jump."""
    if not len(rests):
        return
    away = np.abs(values - values[rests[0, 0]]) >= JUMP_SHARE * float(np.ptp(values))
    first, last = int(np.argmax(away)), len(away) - int(np.argmax(away[::-1]))
    for a, b in rests[(rests[:, 0] > first) & (rests[:, 1] < last)].tolist():
        steps = np.abs(np.diff(values[max(a - 1 - JUMP_NEIGHBOURS, 0) : a + 1]))
        if steps[-1] > LOST_FACTOR * max(quantum, float(steps[:-1].max(initial=0.0))):
            yield a, b


def constants(time_s: Floats, values: Floats) -> Iterator[SignalFinding]:
    """Yields a finding for each long constant interval of a signal that otherwise changes. A failed
    sensor causes such intervals."""
    equal = runs(values[1:] == values[:-1])  # pairs of equal neighbours
    lengths = equal[:, 1] - equal[:, 0] + 1
    # Half of the samples are in intervals of equal values that are at most this long.
    # A position at rest is often constant, so the usual length of a constant interval is needed.
    usual = _median_length(lengths, len(values))
    least = max(CONSTANT_SAMPLES, CONSTANT_FACTOR * usual)
    for a, last in equal[lengths >= least].tolist():
        yield SignalFinding(
            "constant", float(time_s[a]), float(time_s[last]), last - a + 1,
            f"{last - a + 1} samples of {values[a]:.6g}",
        )  # fmt: skip


def _median_length(lengths: NDArray[np.int64], count: int) -> float:
    """Returns the median, over `count` samples, of the length of the interval of equal values in
    which a sample is. `lengths`: lengths of the intervals of two samples or more."""
    known, times = np.unique(lengths, return_counts=True)
    ends = count - int(lengths.sum()) + np.cumsum(known * times)  # samples in intervals so long
    known, ends = np.append(1, known), np.append(count - int(lengths.sum()), ends)
    middle = [known[np.searchsorted(ends, k, side="right")] for k in ((count - 1) // 2, count // 2)]
    return float(np.mean(middle))


def quantum_of(values: Floats) -> float:
    """Returns the smallest difference other than 0 between two values of a signal, or 0."""
    ordered = np.sort(values)
    noise = 1e-9 * max(abs(float(ordered[0])), abs(float(ordered[-1])), 1e-300)
    smallest = np.inf
    for begin, end in blocks(len(ordered) - 1):
        steps = np.diff(ordered[begin : end + 1])
        smallest = min(smallest, float(np.min(steps, where=steps > noise, initial=np.inf)))
    return smallest if np.isfinite(smallest) else 0.0


def runs(inside: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Returns the index ranges [(begin, end)] in which an array is True, as an array (n, 2)."""
    if not len(inside):
        return np.empty((0, 2), dtype=np.int64)
    turns = np.flatnonzero(inside[1:] != inside[:-1]) + 1
    if inside[0]:
        turns = np.insert(turns, 0, 0)
    if inside[-1]:
        turns = np.append(turns, len(inside))
    return turns.reshape(-1, 2)
