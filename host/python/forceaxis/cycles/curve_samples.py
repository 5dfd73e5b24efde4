"""Prepares the curve of a pressed part in a recording for the evaluation by the firmware: force and
position in counts, one sample for each period, with the samples that are not valid and the phase of
each sample.

A recording has the signals `force` in N and `position` in m, positive towards the workpiece. Its
phases come from one of these sources, in this order:

    cycle_phase, cycle_state  the objects of the firmware with these names, traced in each tick
    phase                     number of the phase of each sample, from 0; negative: no phase
    a phase for all samples   if the caller names one
    the program               its conditions and limits decide, as in the firmware

A sample is not valid if it is missing, if force or position has a spike there, if it is saturated,
or if its force is at an end of the range of the axis or of its counts. The curve is as long as its
signals: a force is missing before its first and after its last sample if the position or the phase
is known there. Saturated are the samples that the recording names so, and a force that begins or
ends with equal samples at its extreme, unless the range of the sensor is known: the caller states
it, or the axis itself was recorded.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.recordings.findings import GAP_PERIODS, SATURATED_SAMPLES, runs
from forceaxis.recordings.signal_recording import (
    EVEN_SHARE,
    Floats,
    RecordedSignal,
    SignalRecording,
    numbers_of,
)

Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

UNITS = {"force": "N", "position": "m"}
# largest relative difference between the sample rate of a trace and the tick rate
RATE_TOLERANCE = 1e-3
# signals of the firmware from which the phase of a tick follows; recorded at the end of the tick
TRACED_PHASE, TRACED_STATE, RUNNING = "cycle_phase", "cycle_state", 1
PHASE = "phase"
# the curve of a part begins with the first sample of these signals and ends with the last one
OF_CURVE = ("position", PHASE, TRACED_PHASE, TRACED_STATE)
NO_PHASE = -1
PAUSE_LEAST = 8  # smallest number of samples without a phase between two parts
SAMPLES_MOST = 20_000_000  # largest number of sampling periods of a curve
POSITION_MOST = 2**31 - 1
# Reasons why a sample is not valid, in the order of their importance.
VALID, MISSING, SPIKE, SATURATED, BEYOND = range(5)
REASONS = {
    MISSING: "missing",
    SPIKE: "in a spike",
    SATURATED: "saturated",
    BEYOND: "at or beyond the end of the range of force",
}


@dataclass(frozen=True)
class Ranges:
    """The ranges of the sensors in SI units. A value at an end of the range of its sensor, or
    beyond, is saturated. None: the recording itself states which values are saturated."""

    force_N: tuple[float, float] | None = None
    position_m: tuple[float, float] | None = None

    def of(self, name: str) -> tuple[float, float] | None:
        """Returns the range of the sensor that measures a signal."""
        return self.force_N if name == "force" else self.position_m


@dataclass(frozen=True)
class CurveTimes:
    """The times of a curve: one sample for each period, from the first to the last sample of any of
    its signals."""

    number: Integers  # number of the period of each sample of the force
    periods: int  # number of all periods
    begin_s: float  # true time of the first period, whose number is 0
    rate_hz: float

    def all_s(self, known_s: Floats) -> Floats:
        """Returns the true time of each sampling period. `known_s`: true times of the samples of
        the force.
        """
        every = np.arange(self.periods)
        inside = np.clip(every, self.number[0], self.number[-1])
        return np.interp(inside, self.number, known_s) + (every - inside) / self.rate_hz


@dataclass(frozen=True)
class CurveCounts:
    """A curve of force and position in the counts of a cycle program, with one sample for each
    sampling period.
    """

    begin_s: float  # true time of the first sample in the recording
    rate_hz: float
    position: Integers
    force: Integers  # in 1/256 count
    defect: Integers  # for each sample: VALID, or the reason why the sample is not valid
    # number of the phase of each sample; None: the conditions of the cycle program decide
    phase: Integers | None
    is_interpolated: bool  # True if the position was interpolated at the times of the force

    @property
    def rows(self) -> Integers:
        """The samples of the curve in the form that _core.CurveJudge needs."""
        phase = np.zeros_like(self.force) if self.phase is None else self.phase
        valid = (self.defect == VALID).astype(np.int64)
        return np.column_stack([self.position, self.force, valid, phase])


def _signal(recording: SignalRecording, name: str, where: str) -> RecordedSignal:
    unit = UNITS[name]
    if name not in recording:
        raise InputError(
            f"{where}: expected a signal {name} in {unit}, got {', '.join(recording.names)}; "
            "import the file again, with a signal of this name"
        )
    signal = recording[name]
    if signal.unit != unit:
        raise InputError(
            f"{where}: {name}: expected the unit {unit}, got {signal.unit!r}; import the file "
            "again, and state the unit of its column"
        )
    return signal


def times_of(recording: SignalRecording, where: str) -> CurveTimes:
    """Returns the times of the curve in a recording. Raises InputError if the force was not sampled
    at a constant rate."""
    force = _signal(recording, "force", where)
    time_s = force.true_time_s
    found = numbers_of(time_s)
    if found is not None:
        number, period = found
        off = time_s - period * number
        if float(np.ptp(off)) > 2 * EVEN_SHARE * period:
            found = None
    if found is None:
        raise InputError(
            f"{where}: force: expected samples at a constant rate, got times whose distances "
            "differ by more than half a period; export every sample of the recording"
        )
    number, period = found
    before, after = _without_force(recording, force, period)
    periods = before + int(number[-1]) + 1 + after
    if periods > SAMPLES_MOST:
        raise InputError(
            f"{where}: force: expected the curve of one part with at most {SAMPLES_MOST} sampling "
            f"periods, got {periods}; cut the recording"
        )
    # Digits of the rate that are only rounding errors are removed.
    rate_hz = float(f"{1 / period:.6g}")
    begin_s = float(np.median(off)) - before * period
    return CurveTimes(number.astype(np.int64) + before, periods, begin_s, rate_hz)


def _without_force(
    recording: SignalRecording, force: RecordedSignal, period_s: float
) -> tuple[int, int]:
    """Returns the numbers of sampling periods (before the first, after the last) sample of the
    force in which another signal of the curve has samples. An import leaves out values that are no
    forces, such as OVLD. A delay moves the ends of a signal, but no sample is lost by it."""
    before, after = 0, 0
    for signal in recording:
        if signal.name not in OF_CURVE:
            continue
        of_delay_s = signal.delay_s - force.delay_s
        begin_s = force.time_s[0] - signal.time_s[0] + min(of_delay_s, 0.0)
        end_s = signal.time_s[-1] - force.time_s[-1] - max(of_delay_s, 0.0)
        before = max(before, int(begin_s / period_s + EVEN_SHARE))
        after = max(after, int(end_s / period_s + EVEN_SHARE))
    return before, after


def _saturated(
    signal: RecordedSignal, at_s: Floats, values: Floats, ends: tuple[float, float] | None
) -> Flags:
    """Returns, for each true time, True if the signal is saturated at this time. `values`: values
    of the signal at these times. `ends`: range of the signal, or None if the recording itself
    states which values are saturated."""
    if ends is not None:
        return np.asarray((values <= ends[0]) | (values >= ends[1]))
    found = _named(signal, at_s, "saturation")
    return found | _cut_off(values) if signal.name == "force" else found


def _named(signal: RecordedSignal, at_s: Floats, kind: str) -> Flags:
    """Returns, for each true time, True if the value there rests on a sample that is in a finding
    of this kind."""
    found = np.zeros(len(at_s), dtype=bool)
    named = [one for one in signal.findings if one.kind == kind]
    if not named:
        return found
    # A value between two samples is interpolated, so it rests on both.
    is_own = bool(np.isin(at_s, signal.true_time_s).all())
    slack_s = (EVEN_SHARE if is_own else 1.0) / signal.rate_hz
    for one in named:
        begin_s, end_s = one.from_s - signal.delay_s, one.to_s - signal.delay_s
        found |= (at_s >= begin_s - slack_s) & (at_s <= end_s + slack_s)
    return found


def _cut_off(force_N: Floats) -> Flags:
    """Returns True for each sample of a force that begins or ends with several equal samples at its
    value of the largest magnitude, as at the end of the range of a sensor. Nothing shows that the
    force there was not larger. The force before the contact is small, so it is not meant."""
    found = np.zeros(len(force_N), dtype=bool)
    known = np.flatnonzero(np.isfinite(force_N))
    size = np.abs(force_N[known])
    if not size.any():
        return found
    for end in {float(force_N[known[0]]), float(force_N[known[-1]])}:
        if abs(end) < size.max():
            continue
        for a, b in runs(force_N[known] == end).tolist():
            if b - a >= SATURATED_SAMPLES and (a == 0 or b == len(known)):
                found[known[a:b]] = True
    return found


def _at(signal: RecordedSignal, at_s: Floats) -> tuple[Floats, Flags, bool]:
    """Returns the values of a signal at true times, for each time whether a value is missing there,
    and whether the values were interpolated between two samples."""
    own_s = signal.true_time_s
    has_sample = np.isin(at_s, own_s)
    if has_sample.all():
        return signal.values[np.searchsorted(own_s, at_s)], ~has_sample, False
    after = np.clip(np.searchsorted(own_s, at_s), 1, len(own_s) - 1)
    gap_s = GAP_PERIODS * float(np.median(np.diff(own_s)))
    near = EVEN_SHARE / signal.rate_hz
    missing = (own_s[after] - own_s[after - 1] > gap_s) | (
        (at_s < own_s[0] - near) | (at_s > own_s[-1] + near)
    )
    return np.interp(at_s, own_s, signal.values), missing & ~has_sample, True


def counts(values: Floats, per_unit: float) -> Floats:
    """Converts values to counts, rounded to the nearest integer."""
    return np.asarray(np.floor(values * per_unit + 0.5))


def curve_of(
    recording: SignalRecording, where: str, times: CurveTimes, judge: "_core.CurveJudge",
    phase: int | None, ranges: Ranges,
) -> CurveCounts:  # fmt: skip
    """Returns the curve of force and position that a recording contains, in counts. `phase`:
    number of the phase of all samples if the recording does not contain phases, or None. Raises
    InputError."""
    force = _signal(recording, "force", where)
    position = _signal(recording, "position", where)
    at_s = force.true_time_s
    place, missing, is_interpolated = _at(position, at_s)
    missing = missing | ~np.isfinite(force.values) | ~np.isfinite(place)
    load = np.where(missing, 0.0, force.values)
    force_counts = counts(load, judge.counts_per_N)
    defect = np.where(missing, MISSING, VALID)
    for signal in (force, position):
        defect[_named(signal, at_s, "spike") & ~missing] = SPIKE
    for signal, values in ((force, force.values), (position, place)):
        defect[_saturated(signal, at_s, values, ranges.of(signal.name)) & ~missing] = SATURATED
    least, most = judge.force_ends
    low = -_core.CYCLE_FORCE_MAX_Q8 - 1 if least is None else least
    high = _core.CYCLE_FORCE_MAX_Q8 + 1 if most is None else most
    defect[(force_counts <= low) | (force_counts >= high)] = BEYOND
    force_counts = np.clip(force_counts, -_core.CYCLE_FORCE_MAX_Q8, _core.CYCLE_FORCE_MAX_Q8)
    position_counts = counts(np.where(missing, 0.0, place), judge.counts_per_m)
    if judge.program().zero != "position":
        position_counts = position_counts - position_counts[0]
    if np.abs(position_counts).max() > POSITION_MOST:
        raise InputError(
            f"{where}: position: expected a motion of at most {POSITION_MOST} counts, which are "
            f"{POSITION_MOST / judge.counts_per_m:g} m, got more; check the unit of the position, "
            "or give a larger length of one count of travel"
        )
    # A sampling period without a sample gets the values of the sample before, as in the axis.
    # The phase numbers are sampled separately from force and position.
    last = np.searchsorted(times.number, np.arange(times.periods), side="right") - 1
    last = np.clip(last, 0, None)
    is_there = np.zeros(times.periods, dtype=bool)
    is_there[times.number] = True
    labels = _labels(recording, where, times.all_s(at_s), times, phase)
    return CurveCounts(
        begin_s=times.begin_s,
        rate_hz=times.rate_hz,
        position=position_counts.astype(np.int64)[last],
        force=force_counts.astype(np.int64)[last],
        defect=np.where(is_there, defect[last], MISSING),
        phase=labels,
        is_interpolated=is_interpolated,
    )


def is_traced(recording: SignalRecording) -> bool:
    """Returns True if a recording has the phases that the firmware of an axis ran."""
    return TRACED_PHASE in recording and TRACED_STATE in recording


def _labels(
    recording: SignalRecording, where: str, at_s: Floats, times: CurveTimes, phase: int | None
) -> Integers | None:
    """Returns the number of the phase at each of the times `at_s`, and NO_PHASE for a time outside
    of the cycle. Returns None if the conditions of the cycle program decide about the phases.
    Raises InputError."""
    if is_traced(recording):
        if abs(times.rate_hz / _core.TICKS_PER_SECOND - 1) > RATE_TOLERANCE:
            raise InputError(
                f"{where}: {TRACED_PHASE}: expected {_core.TICKS_PER_SECOND} samples per second, "
                f"one for each tick of the axis, got {times.rate_hz:g}; record every tick, or "
                "import the phases as a signal phase"
            )
        return _traced_labels(recording, where, at_s, 1 / times.rate_hz)
    if PHASE in recording:
        found = _whole(recording, where, PHASE, at_s)
        return np.where(found < 0, NO_PHASE, found)
    return None if phase is None else np.full(len(at_s), phase)


def _traced_labels(
    recording: SignalRecording, where: str, at_s: Floats, period_s: float
) -> Integers:
    """Returns the number of the phase at each time, from recorded objects of the firmware."""
    is_running = recording.held(TRACED_STATE, at_s) == RUNNING
    if is_running[0]:
        raise InputError(
            f"{where}: {TRACED_STATE}: expected a recording that begins before the cycle, but the "
            "cycle runs in its first sample; record earlier"
        )
    # The trace contains the phase at the end of each tick.
    # A sample therefore belongs to the phase that was traced one tick before.
    # The first sample of a cycle belongs to the first phase of the cycle.
    before_s = at_s - period_s
    ran_before = recording.held(TRACED_STATE, before_s) == RUNNING
    labels = np.where(ran_before, _whole(recording, where, TRACED_PHASE, before_s), NO_PHASE)
    return np.where(is_running & ~ran_before, 0, labels)


def _whole(recording: SignalRecording, where: str, name: str, at_s: Floats) -> Integers:
    values = recording.held(name, at_s)
    wrong = np.flatnonzero((values != np.round(values)) | (np.abs(values) > 255))
    if len(wrong):
        raise InputError(
            f"{where}: {name}: expected the number of a phase, an integer, got "
            f"{values[wrong[0]]:g} at {at_s[wrong[0]]:.6g} s; map the column with the numbers of "
            "the phases"
        )
    return np.asarray(values.astype(np.int64))


def cuts(
    curve: CurveCounts, where: str, phases: int, repeated: set[int]
) -> list[tuple[Integers, int]]:
    """Returns, for each part of a curve, the samples of its cycle, preceded by the sample before
    them, and the number of the first one. Several parts follow each other only in a curve that
    names its phases: there a part ends before samples without a phase, and where the first phase
    begins again. `phases`: number of phases of the program. `repeated`: numbers of the phases to
    which the program itself comes back. Raises InputError."""
    rows = curve.rows
    if curve.phase is None:
        return [(np.vstack([rows[:1], rows]), 0)]
    inside = runs(curve.phase != NO_PHASE).tolist()
    if not inside:
        raise InputError(
            f"{where}: expected samples in a phase of the program, got none; check the signal of "
            "the phases"
        )
    for (_, end), (begin, _) in pairwise(inside):
        is_part = curve.phase[begin] == curve.phase[inside[0][0]]
        if not is_part or begin - end < PAUSE_LEAST:
            raise InputError(
                f"{where}: expected the curve of one part, or several ones that begin with the "
                f"same phase, got samples without a phase from "
                f"{curve.begin_s + end / curve.rate_hz:.6g} s on, and later samples with a phase; "
                "correct the phases, or cut the recording into one file for each part"
            )
    largest = int(curve.phase.max())
    if largest >= phases:
        raise InputError(
            f"{where}: expected phases from 0 to {phases - 1}, those of the program, got "
            f"{largest}; give the program with which the part was pressed"
        )
    first = int(curve.phase[inside[0][0]])
    if first not in repeated:
        begins = runs(curve.phase == first)[:, 0].tolist()
        edges = [[begin, *(b for b in begins if begin < b < end), end] for begin, end in inside]
        inside = [pair for one in edges for pair in pairwise(one)]
    _expect_complete(curve, where, inside)
    found = []
    for begin, end in inside:
        before = rows[max(begin - 1, 0)].copy()
        before[3] = 0
        found.append((np.vstack([before[np.newaxis], rows[begin:end]]), begin))
    return found


def _expect_complete(curve: CurveCounts, where: str, inside: list[tuple[int, int]]) -> None:
    """Raises InputError for a part of several ones that ends in another phase than the last one of
    the recording. Samples without a phase may also be in the middle of a stroke."""
    assert curve.phase is not None
    last = max(int(curve.phase[end - 1]) for _, end in inside)
    for _, end in inside:
        if curve.phase[end - 1] != last:
            raise InputError(
                f"{where}: expected parts that end in the same phase of the program, got one that "
                f"ends in phase {curve.phase[end - 1]} at "
                f"{curve.begin_s + (end - 1) / curve.rate_hz:.6g} s, and one that ends in phase "
                f"{last}; correct the phases, or cut the recording into one file for each part"
            )
