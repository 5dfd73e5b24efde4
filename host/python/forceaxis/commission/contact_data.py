"""Converts recordings of touch-downs of a machine to the form to which a model is fitted. The
simulated plant has a fixed time step. The command has one value for each of these time steps.
Samples of force and position have times that are counted in these time steps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from forceaxis import linear
from forceaxis._core import TICKS_PER_SECOND, InputError
from forceaxis.commission import contact_timing, known
from forceaxis.linear.plant_facts import Overrides, PlantFacts
from forceaxis.recordings.robust import quiet_of
from forceaxis.recordings.signal_recording import RecordedSignal, SignalRecording
from forceaxis.recordings.touch import RISEN_SHARE, contacts_of, largest_of, level_of, onset_of

Floats: TypeAlias = NDArray[np.float64]

# Least number of time steps of the plant in a tick, for a force that is measured between ticks.
BETWEEN_TICKS = 4
# Least number of time steps of the plant in one period of a sensor with a sinc filter.
FILTER_STEPS = 4
PARTS_MAX = 8  # largest number of time steps of the simulated plant in one tick
# Assumed noise of a signal without visible noise, divided by the step between two of its values.
LEAST_NOISE_STEPS = 0.12
LONG_STRETCH = 20  # smallest number of samples of a long stretch with almost constant codes
HELD_SAMPLES = 100  # largest number of samples that are used of a constant force
PERIODS = 4  # longest period, in samples, with which rounding errors are assumed to repeat
GRID_TOLERANCE = 1e-2  # largest distance of a value from its rounding grid, in steps of the grid
GRID_ERROR = 1e-7  # largest rounding error of a value in a file, divided by the range of all values
# BEFORE_S, AFTER_S and RUN_UP_S are times in s for a contact without a recorded command.
# The comparison begins BEFORE_S before the first contact.
# The comparison ends at the first maximum of the force, at most AFTER_S after the contact.
# After this maximum, the unknown command would change with the force.
# The simulation begins RUN_UP_S before the comparison.
BEFORE_S, AFTER_S, RUN_UP_S = 0.01, 0.1, 0.05
# Two contacts are simulated separately if there is no contact for at least OPEN_S between them.
# The workpiece comes to rest if there is no contact for OPEN_S.
# The simulation of a contact begins at least AHEAD_S before the contact.
OPEN_S, AHEAD_S = 0.5, 0.1
SPEED_SHARE = 0.3  # assumed relative standard deviation of an unknown speed or command
# an axis above this speed, in encoder steps per tick, is assumed to move at the start
MOVING_STEPS = 1.0
COMMANDS = ("code", "voltage_command", "speed_command", "force_command")


@dataclass(frozen=True)
class Samples:
    """Samples of one signal in one touch-down. `at`: times of the samples, in time steps of the
    plant. `values`: values of the samples in SI units. `step`: difference between two adjacent
    values of the converter, or 0 for values without rounding. `noise`: rms noise in SI units before
    rounding. `free`: number of samples from which the noise was computed, or 0 if the noise was
    assumed. `seen`: rms deviation of these samples, including rounding. If their mean is near the
    edge of a code, `seen` is larger than for a moving signal."""

    at: Floats
    values: Floats
    step: float
    noise: float
    free: int
    seen: float = 0.0

    @property
    def spread(self) -> float:
        """Returns the standard deviation of the sum of noise and rounding errors of the signal."""
        return max(math.hypot(self.noise, self.step / math.sqrt(12)), self.seen)

    @property
    def deviations(self) -> Floats:
        """Returns the standard deviation of each sample, from which its weight in a fit is
        computed.

        If a signal is constant, or moves by a simple fraction of a step from sample to sample, its
        rounding errors repeat, unless noise moves the signal between codes. The mean of m such
        errors has the variance r + rest / m. Here r = step^2 / (2 pi^2) exp(-4 pi^2 noise^2 /
        step^2) is the first harmonic of the rounding error (Wannamaker et al., IEEE Trans. Signal
        Processing 48, 2000). Therefore each of the m samples has m times the variance r.
        """
        every = self.spread**2
        if self.step == 0.0:
            return np.full(len(self.values), math.sqrt(every))
        repeated = (
            self.step**2
            / (2 * math.pi**2)
            * math.exp(-((2 * math.pi * self.noise / self.step) ** 2))
        )
        return np.asarray(np.sqrt(every - repeated + repeated * self._dwell()))

    def _dwell(self) -> Floats:
        """Returns for each sample the number of neighbouring samples that have the same rounding
        error. In such a stretch, the changes of the code repeat after `period` samples. The
        rounding errors within a period partly cancel each other, so a smaller number is returned. A
        long stretch with only two codes, such as a constant force, is also regarded as one rounding
        error, because a small motion hardly changes its position relative to the codes.
        """
        codes = np.round(self.values / self.step)
        changes = np.diff(codes)
        dwell = np.ones(len(codes))
        for first, last in _stretches(codes):
            if last - first >= LONG_STRETCH:
                dwell[first:last] = last - first
        for period in range(1, min(PERIODS, len(changes) - 1) + 1):
            equal = changes[period:] == changes[:-period]
            ends = np.flatnonzero(np.diff(np.concatenate([[False], equal, [False]])))
            for first, last in ends.reshape(-1, 2):
                stretch = slice(first, last + period + 1)
                length = (last - first + period) / period**2
                dwell[stretch] = np.maximum(dwell[stretch], length)
        return dwell


def _stretches(codes: Floats) -> list[tuple[int, int]]:
    """Finds stretches of samples in which all codes differ by at most 1. Returns for each stretch
    the index of its first sample and the index after its last sample."""
    found, first, low, high = [], 0, codes[0], codes[0]
    for i, code in enumerate(codes.tolist()):
        low, high = min(low, code), max(high, code)
        if high - low > 1:
            found.append((first, i))
            first, low, high = i, code, code
    return [*found, (first, len(codes))]


@dataclass(frozen=True)
class TouchDown:
    """One touch-down. `volts`: command of the drive in V for each time step of the plant. `onset`:
    time step at which the force begins. `position`: samples of the position, or None if it was not
    recorded. `travel`: distance in m from the start to the onset. `speed`: speed in m/s at the
    start, and its standard deviation; both are 0 for an axis at rest. `held`: constant command in V
    of a touch-down without a recorded command, and its standard deviation. `recording`: number of
    the recording that contains the touch-down. `late`: largest error, in time steps, that all times
    of the force have in common, because the phase of the sensor's clock is not known exactly."""

    name: str
    volts: Floats
    onset: float
    force: Samples
    position: Samples | None
    travel: float = 0.0
    speed: tuple[float, float] = (0.0, 0.0)
    held: tuple[float, float] = (0.0, 0.0)
    recording: int = 0
    late: float = 0.0

    @property
    def zero_N(self) -> float:
        """Returns the mean force before the onset, which is the zero of the sensor."""
        before = self.force.values[self.force.at < self.onset]
        return quiet_of(before, self.force.step).zero if len(before) else 0.0

    def until(self, steps: int, begin: int = 0) -> "TouchDown":
        """Returns the touch-down shortened to its first `steps` time steps. Samples before the time
        step `begin` are left out."""

        def part(samples: Samples) -> Samples:
            kept = (samples.at >= begin) & (samples.at <= steps - 1)
            return replace(samples, at=samples.at[kept], values=samples.values[kept])

        return replace(
            self, volts=self.volts[:steps], force=part(self.force),
            position=None if self.position is None else part(self.position),
        )  # fmt: skip


def _without_rest(touch: TouchDown) -> TouchDown:
    """If the force stays within two codes at the end of a touch-down, removes most of this end.
    Many such samples contain no more information than a few."""
    if touch.force.step == 0.0:
        return touch
    first, end = _stretches(np.round(touch.force.values / touch.force.step))[-1]
    if end - first <= HELD_SAMPLES:
        return touch
    return touch.until(int(touch.force.at[first + HELD_SAMPLES]) + 1)


@dataclass(frozen=True)
class ContactData:
    """All touch-downs of the recordings. `parts`: number of time steps of the plant in one tick.
    `commanded`: False if no command was recorded. Speed and command of each contact are then
    unknown."""

    touches: tuple[TouchDown, ...]
    parts: int = 1
    commanded: bool = True

    @property
    def rate_hz(self) -> float:
        """Returns the number of time steps of the plant in one second."""
        return float(TICKS_PER_SECOND * self.parts)


def grid_of(values: Floats) -> float:
    """Returns the step between adjacent values of a converter. Returns 0 if the differences of the
    values are not multiples of one step."""
    different = np.unique(values)
    if len(different) < 2:
        return 0.0
    span = float(np.ptp(different))
    step = 0.0
    # this loop computes the greatest common divisor (Euclidean algorithm)
    for gap in np.diff(different).tolist():
        rest = gap
        while rest > GRID_ERROR * span:
            step, rest = rest, math.fmod(step, rest) if step else 0.0
            rest = min(rest, abs(step - rest))
    if step < 100 * GRID_ERROR * span:
        return 0.0
    # The step is computed from the whole range, because this reduces its relative rounding error.
    step = span / round(span / step)
    off = (different - different[0]) / step
    return step if np.all(np.abs(off - np.round(off)) < GRID_TOLERANCE) else 0.0


def noise_of(values: Floats, step: float) -> tuple[float, int]:
    """Computes the noise of a constant signal from its rounded values, without its outliers.
    Returns the rms noise before rounding, and the number of values from which it was computed. If
    all values are equal, the noise is unknown and the number is 0."""
    values = values[quiet_of(values, step).usual]
    if step == 0.0:
        return float(np.std(values, ddof=1)), len(values) - 1
    variance = float(np.var(values, ddof=1))
    if variance == 0.0:
        return LEAST_NOISE_STEPS * step, 0
    mean = float(np.mean(values))

    def cost(x: Floats) -> float:
        low = (values - step / 2 - mean - x[1] * step) / (step * math.exp(x[0]))
        share = special.ndtr(low + math.exp(-x[0])) - special.ndtr(low)
        return -float(np.sum(np.log(np.maximum(share, 1e-300))))

    start = math.log(max(math.sqrt(variance) / step, 0.3))
    found = optimize.minimize(cost, [start, 0.0], method="Nelder-Mead")
    noise = step * math.exp(float(found.x[0]))
    return max(noise, LEAST_NOISE_STEPS * step), len(values) - 1


def cuts_of(name: str, recording: SignalRecording) -> list[float]:
    """Returns the times in s at which a recording is divided into its touch-downs. Each is the time
    at which the axis is farthest from the workpiece. If no position was recorded, it is the middle
    of the time without contact. A contact that follows within OPEN_S belongs to the previous
    touch-down. Raises InputError."""
    force = _signal(name, recording, "force")
    level = level_of(force.true_time_s, force.values, f"{name}: force")
    above = force.values - level.zero
    level = replace(level, contact=max(level.contact, RISEN_SHARE * largest_of(above)))
    first = int(np.argmax(above > level.contact))
    starts, ends = contacts_of(force.true_time_s[first:], above[first:], level)
    cuts = []
    for end, start in zip(ends, starts, strict=False):
        if start - end < OPEN_S:
            continue
        cut = (end + start) / 2
        if "position" in recording:
            position = recording["position"]
            inside = (position.true_time_s >= end) & (position.true_time_s <= start)
            times, moved = position.true_time_s[inside], position.values[inside]
            toward = math.copysign(1.0, moved[-1] - moved[0])
            farthest = toward * moved
            cut = times[np.flatnonzero(farthest == farthest.min())[-1]]
        cuts.append(float(min(cut, start - AHEAD_S)))
    return cuts


def _cut(recording: SignalRecording, begin_s: float, end_s: float) -> SignalRecording:
    """Returns the samples of a recording from begin_s to end_s. Of a command signal, earlier
    samples are also kept, because the last command before begin_s may still be active."""

    def part(signal: RecordedSignal) -> RecordedSignal:
        if signal.name not in ("force", "position"):
            return signal
        kept = (signal.true_time_s >= begin_s) & (signal.true_time_s < end_s)
        return replace(signal, time_s=signal.time_s[kept], values=signal.values[kept])

    return replace(recording, signals=tuple(part(signal) for signal in recording))


def touch_downs(
    model: str, recordings: Sequence[tuple[str, SignalRecording]], held: Overrides
) -> ContactData:
    """Divides recordings into touch-downs and returns the touch-downs. `recordings`: pairs (name,
    recording). Each recording must begin out of contact. Of a recording without any of the signals
    COMMANDS, only the time around each first contact is used. Raises InputError."""
    commanded = [any(c in recording for c in COMMANDS) for _, recording in recordings]
    rate = max(_signal(name, recording, "force").rate_hz for name, recording in recordings)
    parts = next(
        (p for p in (1, 2, 4, PARTS_MAX) if rate <= p * TICKS_PER_SECOND * 1.01), PARTS_MAX
    )
    if not all(commanded):
        # The samples of the force are not at ticks, and the force rises quickly between ticks.
        parts = max(parts, BETWEEN_TICKS)
    facts = linear.facts(model, held)
    parts = max(parts, parts_of(facts))
    reader = _Reader(facts, model, held, parts)
    touches = []
    for number, (name, given) in enumerate(recordings):
        recording = given.even(1 / reader.rate)
        ends = [-math.inf, *cuts_of(name, recording), math.inf]
        for i, (begin_s, end_s) in enumerate(pairwise(ends), 1):
            own = name if len(ends) == 2 else f"{name}, contact {i}"
            part, late_s = contact_timing.at_instants(_cut(recording, begin_s, end_s), facts)
            if all(commanded):
                touch = _without_rest(reader.read(own, part))
                # The drive already moves here, so the simulation begins with the earlier command.
                if i > 1:
                    touch = touch.until(len(touch.volts), round(RUN_UP_S * reader.rate))
            else:
                touch = reader.shot(own, part)
            touches.append(replace(touch, recording=number, late=late_s * reader.rate))
    return ContactData(tuple(touches), parts, all(commanded))


def mean_speed(position: Samples, begin: float, end: float) -> float:
    """Returns the mean speed of the axis in m per time step, between two time steps of the plant,
    or 0 if there are no two positions."""
    used = (position.at >= begin) & (position.at <= end)
    if np.count_nonzero(used) < 2:
        return 0.0
    return float(np.polyfit(position.at[used], position.values[used], 1)[0])


def parts_of(facts: PlantFacts) -> int:
    """Returns the number of time steps of the plant in one tick that the force sensor needs: the
    force changes between ticks, where a sensor with its own clock measures it, and a sinc filter
    adds its values within a period."""
    sampling = facts.reading.sampling if facts.reading else None
    if sampling is None:
        return 1
    steps = math.ceil(FILTER_STEPS * sampling.rate_hz / TICKS_PER_SECOND)
    return min(PARTS_MAX, max(BETWEEN_TICKS, steps if sampling.sinc_order else 1))


def _signal(name: str, recording: SignalRecording, signal: str) -> RecordedSignal:
    try:
        return recording[signal]
    except KeyError:
        raise InputError(
            f"{name}: expected a recording with the signal {signal}, got a recording of "
            f"{', '.join(recording.names)}; assign a column to this signal with `import_recording`"
        ) from None


class _Reader:
    """Builds touch-downs for one model from recordings."""

    def __init__(self, facts: PlantFacts, model: str, held: Overrides, parts: int) -> None:
        self.facts = facts
        self.parts, self.rate = parts, float(TICKS_PER_SECOND * parts)
        encoder = self.facts.required_encoder
        #: speed of the axis out of contact, divided by the command, in m/s per V
        self.speed_per_volt = (
            known.code_rate(model, held) / self.facts.volts_per_code / encoder.scale
        )
        drive = self.facts.required_drive.values
        self.volts_per = {
            "code": self.facts.volts_per_step,
            "voltage_command": 1.0,
            "speed_command": 1 / drive.get("velocity_per_volt", self.speed_per_volt),
            "force_command": 1 / drive.get("force_per_volt", math.nan),
        }

    def samples(self, signal: RecordedSignal, begin_s: float, end_s: float, free: int) -> Samples:
        """Returns the samples of a signal from begin_s to end_s. `free`: number of samples before
        the touch from which the noise is computed, or 0 for a signal without noise."""
        inside = (signal.true_time_s >= begin_s - 1e-9) & (signal.true_time_s <= end_s + 1e-9)
        values = signal.values[inside]
        step = grid_of(signal.values)
        noise, count, seen = LEAST_NOISE_STEPS * step, 0, 0.0
        if step == 0.0 and len(values) > 2:
            # The second differences of a smooth signal contain only its noise.
            noise = float(np.std(np.diff(values, 2))) / math.sqrt(6) + 1e-9 * float(np.ptp(values))
        if free > 1:
            noise, count = noise_of(values[:free], step)
            seen = quiet_of(values[:free], step).noise
        at = (signal.true_time_s[inside] - begin_s) * self.rate
        near = np.round(at)
        at = np.where(np.abs(at - near) < 1e-3, near, at)
        return Samples(at, values, step, noise, count, seen)

    def read(self, name: str, recording: SignalRecording) -> TouchDown:
        """Returns the touch-down in a recording that contains a command."""
        force = _signal(name, recording, "force")
        command = next(c for c in COMMANDS if c in recording)
        first = max(s.true_time_s[0] for s in recording if s.name in ("force", "position", command))
        last = min(s.true_time_s[-1] for s in recording if s.name in ("force", "position"))
        steps = int((last - first) * self.rate + 1e-6) + 1
        times = first + np.arange(steps) / self.rate
        volts = recording.held(command, times) * self.volts_per[command]
        if not np.isfinite(volts).all():
            raise InputError(
                f"{name}: {command}: expected a command signal of the kind that the drive of the "
                "model has as its input; import the command of the drive as voltage_command"
            )
        onset, free = self._onset(name, force, first)
        begun = self.samples(force, first, last, free)
        if "position" not in recording:
            travel = float(np.sum(volts[: int(onset)])) / self.rate * self.speed_per_volt
            return TouchDown(name, volts, onset, begun, None, travel)
        position = self.samples(recording["position"], first, last, 0)
        touched = np.interp(onset, position.at, position.values)
        # Over a bus a position is new once a cycle.
        ticks = 2 * self.facts.required_drive.bus.cycle_ticks
        speed = mean_speed(position, 0.0, float(ticks * self.parts)) * self.rate
        moves = abs(speed) > MOVING_STEPS * position.step * TICKS_PER_SECOND
        return TouchDown(
            name, volts, onset, begun, position, float(touched - position.values[0]),
            (speed, SPEED_SHARE * abs(speed)) if moves else (0.0, 0.0),
        )  # fmt: skip

    def shot(self, name: str, recording: SignalRecording) -> TouchDown:
        """Returns the touch-down in a recording without a command. It contains only the time around
        the first contact."""
        force = _signal(name, recording, "force")
        onset, free = self._onset(name, force, force.true_time_s[0])
        touch_s = force.true_time_s[0] + onset / self.rate
        begin = max(touch_s - BEFORE_S, force.true_time_s[0])
        after = (force.true_time_s > touch_s) & (force.true_time_s < touch_s + AFTER_S)
        values = force.values[after]
        falls = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:]))
        high = [i + 1 for i in falls if values[i + 1] > 0.3 * values.max()]
        end = float(force.true_time_s[after][high[0] if high else -1])
        quiet = self.samples(force, force.true_time_s[0], end, free)
        begun = replace(
            self.samples(force, begin, end, 0), noise=quiet.noise, free=quiet.free, seen=quiet.seen
        )
        # The simulation begins earlier, so that the drive has settled at `begin`.
        ahead = round(RUN_UP_S * self.rate)
        begun = replace(begun, at=begun.at + ahead)
        steps = int((end - begin) * self.rate + 1e-6) + 2 + ahead
        if "position" in recording:
            position = self.samples(recording["position"], begin, end, 0)
            speed = mean_speed(position, 0.0, (touch_s - begin) * self.rate) * self.rate
            position = replace(position, at=position.at + ahead)
        elif "speed" in recording:
            position, speed = None, float(recording.sampled("speed", np.array([begin]))[0])
        else:
            raise InputError(
                f"{name}: expected a recording of the force and of a command, a position or a "
                f"speed, got a recording of {', '.join(recording.names)} alone; record one of "
                "these signals too"
            )
        held = speed / self.speed_per_volt if math.isfinite(self.speed_per_volt) else 0.0
        onset = (touch_s - begin) * self.rate + ahead
        return TouchDown(
            name, np.zeros(steps), onset, begun, position, speed * onset / self.rate, (speed, 0.0),
            (held, SPEED_SHARE * abs(held)),
        )  # fmt: skip

    def _onset(self, name: str, force: RecordedSignal, first: float) -> tuple[float, int]:
        """Returns the time step of the plant at which the force begins, and the number of force
        samples before it."""
        used = force.true_time_s >= first - 1e-9
        times, values = force.true_time_s[used], force.values[used]
        free = onset_of(times, values, level_of(times, values, f"{name}: force"))
        return float((times[free] - first) * self.rate), free
