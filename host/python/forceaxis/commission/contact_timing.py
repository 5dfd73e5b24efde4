"""Instants at which recorded values were true, for a force sensor with a clock of its own and for a
drive on a bus.

A program that records at the ticks of the axis gets the newest sample of the sensor in each tick.
So the same sample is often recorded twice, and each sample is some time old. Which values repeat
shows the phase of the sensor's clock. The bus has a clock too: a command waits for the next frame,
and a position for the next cycle.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate

from forceaxis._core import TICKS_PER_SECOND
from forceaxis.linear.plant_facts import BusFacts, PlantFacts, SamplingFacts
from forceaxis.recordings.signal_recording import RecordedSignal, SignalRecording

PHASES = 96  # number of phases of a sensor's clock that are tried
# Largest share of changed values that may contradict the phase of a clock.
CONFLICTS = 0.05
# A recording has the sensor's own times if the periods of recording and sensor nearly agree.
# OWN_CLOCK is the tolerance. A recording that was made at the ticks of the axis is an exception.
OWN_CLOCK = 0.01
SAME_S = 1e-6  # tolerance for equal instants in s
QUADRATURE = 200  # number of values of the filter's weight in one time step

Floats = NDArray[np.float64]


def at_instants(recording: SignalRecording, facts: PlantFacts) -> tuple[SignalRecording, float]:
    """Returns a recording whose samples of force and position have the times at which they were
    taken, and whose codes have the times at which the drive applies them. A sample that was
    recorded twice is kept once. Also returns the largest error in s of the times of the force.
    Signals with a stated delay and signals of the drive's own clock remain as they are."""
    found = {signal.name: signal for signal in recording}
    late_s = 0.0
    sampling = facts.reading.sampling if facts.reading else None
    if sampling and "force" in found:
        found["force"], late_s = _force_at_samples(found["force"], sampling)
    if not facts.bus.is_immediate:
        found |= _over_bus(found, facts.bus) if "position" in found else _sent(found, facts.bus)
    return replace(recording, signals=tuple(found.values())), late_s


def _force_at_samples(
    force: RecordedSignal, sampling: SamplingFacts
) -> tuple[RecordedSignal, float]:
    period, times = sampling.period_s, force.time_s
    if force.delay_s or len(times) < 3:
        return force, 0.0
    if _has_period(times, period) and not _has_period(times, 1 / TICKS_PER_SECOND):
        return force, 0.0
    phases = period * (np.arange(PHASES) + 0.5) / PHASES
    allowed = _allowed(force, phases, period, sampling.latency_s)
    if not allowed.any():
        return force, 0.0
    if allowed.all():
        # The age of the first sample is the mean of all ages.
        phase, half = float(times[0]) - sampling.latency_s - period / 2, period / 2
    else:
        first, count = _longest_run(allowed)
        phase = phases[0] + (first + (count - 1) / 2) * period / PHASES
        half = count * period / PHASES / 2
    return _at_phase(force, phase, period, sampling.latency_s), half


def _over_bus(found: dict[str, RecordedSignal], bus: BusFacts) -> dict[str, RecordedSignal]:
    """Returns position and code with the times that they have at a drive on a bus."""
    position = found["position"]
    period = bus.cycle_ticks / TICKS_PER_SECOND
    if position.delay_s or not _has_period(position.time_s, 1 / TICKS_PER_SECOND):
        return {}
    phases = float(position.time_s[0]) + np.arange(bus.cycle_ticks) / TICKS_PER_SECOND
    delay = bus.delay_ticks_in / TICKS_PER_SECOND
    allowed = _allowed(position, phases, period, delay)
    if not allowed.any():
        return {}
    phase = float(phases[int(allowed.argmax())])
    changed = {"position": _at_phase(position, phase, period, delay)}
    if (code := found.get("code")) and not code.delay_s:
        sent = np.arange(math.ceil((code.time_s[0] - phase) / period - SAME_S),
                         math.floor((code.time_s[-1] - phase) / period + SAME_S) + 1)  # fmt: skip
        leaves = phase + period * sent
        held = np.searchsorted(code.time_s, leaves + SAME_S, side="right") - 1
        at = np.concatenate([code.time_s[:1], leaves + bus.delay_ticks_out / TICKS_PER_SECOND])
        values = np.concatenate([code.values[:1], code.values[held]])
        changed["code"] = replace(code, time_s=at, values=values)
    return changed


def _sent(found: dict[str, RecordedSignal], bus: BusFacts) -> dict[str, RecordedSignal]:
    """Returns the code of a recording without a position, which would show the phase of the bus: a
    command waits for the next frame, on average for half of the other ticks of a cycle."""
    code = found.get("code")
    if code is None or code.delay_s or not _has_period(code.time_s, 1 / TICKS_PER_SECOND):
        return {}
    late_s = (bus.delay_ticks_out + (bus.cycle_ticks - 1) / 2) / TICKS_PER_SECOND
    at = np.concatenate([code.time_s[:1], code.time_s + late_s])
    return {"code": replace(code, time_s=at, values=np.concatenate([code.values[:1], code.values]))}


def _has_period(times: Floats, period: float) -> bool:
    return abs(float(np.median(np.diff(times))) / period - 1) < OWN_CLOCK


def _numbers(times: Floats, phase: float, period: float, delay: float) -> Floats:
    """Returns the number of the newest sample that has arrived at each time."""
    return np.asarray(np.floor((times - delay - phase + SAME_S) / period))


def _allowed(
    signal: RecordedSignal, phases: Floats, period: float, delay: float
) -> NDArray[np.bool_]:
    """Returns for each phase of a clock whether the recorded values agree with it: a value changes
    only where a new sample has arrived."""
    changed = np.diff(signal.values) != 0
    conflicts = np.array([
        np.count_nonzero(changed & (np.diff(_numbers(signal.time_s, p, period, delay)) == 0))
        for p in phases
    ])  # fmt: skip
    least = int(conflicts.min())
    if least > CONFLICTS * int(np.count_nonzero(changed)):
        return np.zeros(len(phases), dtype=bool)
    return np.asarray(conflicts == least)


def _longest_run(allowed: NDArray[np.bool_]) -> tuple[int, int]:
    """Returns first index and length of the longest run of allowed phases, whose last index is
    followed by the first one."""
    twice = np.concatenate([allowed, allowed])
    best, first = (0, 0), 0
    for i, is_allowed in enumerate(twice):
        if not is_allowed:
            first = i + 1
        elif i + 1 - first > best[1]:
            best = (first, i + 1 - first)
    return best[0], min(best[1], len(allowed))


def _at_phase(signal: RecordedSignal, phase: float, period: float, delay: float) -> RecordedSignal:
    """Returns a signal whose samples have the times of a clock with this phase."""
    numbers = _numbers(signal.time_s, phase, period, delay)
    new = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1) > 0)
    return replace(signal, time_s=phase + period * numbers[new], values=signal.values[new])


def sinc_weights(order: int, period: float) -> Floats:
    """Returns the weights with which a sinc filter adds the latest values of a signal, the newest
    value first. The signal is linear between its values. `period`: sampling period, in steps
    between two values."""
    width = order * period
    spline = interpolate.BSpline.basis_element(np.linspace(0.0, width, order + 1), False)
    fine = (np.arange(math.ceil(width * QUADRATURE)) + 0.5) / QUADRATURE
    share = np.nan_to_num(spline(fine))
    step = np.floor(fine).astype(int)
    weights = np.zeros(int(step[-1]) + 2)
    np.add.at(weights, step, share * (1 - (fine - step)))
    np.add.at(weights, step + 1, share * (fine - step))
    return np.asarray(weights / weights.sum())
