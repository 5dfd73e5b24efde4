"""Evaluates the first contact in a force signal. The module finds the time of the contact and the
sample at which the force begins to rise, and computes figures such as the peak force.

The same functions evaluate measured and predicted signals, so both have the same definitions.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from forceaxis._core import InputError
from forceaxis.recordings.findings import quantum_of
from forceaxis.recordings.robust import DISTURBED_FACTOR, RETURN_S, quiet_of
from forceaxis.recordings.signal_recording import Floats

LEAST_BEFORE = 8  # smallest number of samples before the first contact
# A single sample above all of three levels is a contact.
# Noise alone exceeds the first level in a whole recording with the probability FALSE_ALARM.
# The first level is a multiple of the standard deviation of the noise.
# The second level is a share of the largest force. The third level is a number of smallest steps.
FALSE_ALARM, PEAK_SHARE, QUANTA = 1e-3, 0.005, 1.5
COARSE_SHARE = 0.5  # largest level from the smallest step, as a share of the largest force
# The force begins to rise at the last sample below this multiple of the noise before a contact.
QUIET_FACTOR = 3.0
DEVIATION = (0.1587, 0.8413)  # shares of normal values below one deviation under and over the mean
RISEN_SHARE = 0.1  # share of the largest force above which a contact is a touch-down of its own
RISING_SAMPLES = 5  # number of successive samples above this share that are no noise
# A force is flat before a rise if REST_SAMPLES of its samples there, as a share, are within
# REST_SHARE of the largest force around their median.
REST_SHARE, REST_SAMPLES = 0.025, 0.8
LOST_SHARE = 0.5  # force below which a contact is lost, divided by the level of contact
# the held force is the mean of this share of the signal, at its end
HELD_SHARE, HELD_LEAST = 0.2, 10
# Half width of the settling band, as a share of the held force and as a multiple of the noise.
# Noise alone leaves a narrower band in one of many samples, which would then be the settling time.
SETTLED_SHARE, SETTLED_NOISES = 0.05, 5.0
IMPULSE_S = 0.025
CONTACTS = 3  # number of contacts whose start and end times are evaluated


@dataclass(frozen=True)
class ForceLevel:
    """Zero and noise of a force before the first contact, and the force that counts as contact. All
    three are in the unit of the force."""

    zero: float
    noise: float  # standard deviation of the noise
    contact: float  # smallest force above the zero at which the axis is in contact
    noises: float = 0.0  # largest force above the zero that noise alone may have


@dataclass(frozen=True)
class ContactFigures:
    """Figures of a contact. Times are in s after the first contact. Forces are differences from the
    zero of the force. None means that the contact has no such value."""

    peak_N: float
    impulse_N_s: float  # impulse of the first 25 ms
    bounces: int  # number of contact losses
    starts_s: tuple[float, ...]  # times in s after the first contact at which contact is made again
    ends_s: tuple[float, ...]  # times in s after the first contact at which contact is lost
    settling_s: float | None
    held_N: float


@dataclass(frozen=True)
class Touch:
    """The first contact of a force. `time_s`: time at which the force rises through the level of
    contact. `open_s`: time of the sample before it, which is the last one without contact. So the
    contact is made between `open_s` and the next sample. `deviations`: first force in contact, in
    standard deviations of the noise. `is_single`: True if the contact has one sample.
    `doubtful_s`: time of an earlier sample that is above the noise but below the level of contact,
    or None. It cannot be told whether the contact is made there already."""

    time_s: float
    open_s: float
    deviations: float
    is_single: bool
    doubtful_s: float | None


def level_of(time_s: Floats, force: Floats, where: str) -> ForceLevel:
    """Returns the zero, the noise and the level of contact of a force (n,) at the times `time_s`.
    Raises InputError if there is no contact, or too few samples before the contact."""
    if _rises_at_once(force):
        raise InputError(
            f"{where}: expected at least {LEAST_BEFORE} samples before the first contact, but the "
            "force rises within them; begin the recording earlier"
        )
    head = force[:LEAST_BEFORE]
    largest = largest_of(force - float(np.median(head)))
    # A first contact with a small force hardly changes medians of all samples before a large one.
    risen = int(np.argmax(force - float(np.median(head)) > RISEN_SHARE * largest))
    head = force[: max(LEAST_BEFORE, risen)]
    zero = float(np.median(head))
    largest = largest_of(force - zero)
    # The levels of a converter with few bits may be far apart, and most values may be the same.
    quantum = quantum_of(force)
    steps = min(QUANTA * quantum, COARSE_SHARE * largest)
    noise = float(np.ptp(np.quantile(head, DEVIATION))) / 2
    noise += min(quantum / 2, PEAK_SHARE * largest)
    # The noise is known roughly from a few samples, and well from all samples before the contact.
    count = len(head)
    for _ in range(3):
        noises = _factor(len(force), count) * noise
        contact = max(noises, PEAK_SHARE * largest, steps)
        first = _first_contact(time_s, force - zero, contact)
        if first is None:
            raise InputError(
                f"{where}: expected a force that is positive in compression and rises at a "
                f"contact, but the recorded force exceeds its value without contact, {zero:.4g} N, "
                f"by at most {largest:.4g} N; import the force with the opposite sign, or record a "
                "contact"
            )
        before = force[: max(0, first - 2)]
        if len(before) < LEAST_BEFORE:
            raise InputError(
                f"{where}: expected at least {LEAST_BEFORE} samples before the first contact, got "
                f"{len(before)}; begin the recording earlier"
            )
        # A disturbance of the sensor is no noise.
        quiet = quiet_of(before[np.abs(before - zero) <= contact], quantum)
        zero, noise, count = quiet.zero, quiet.noise, quiet.count
    return ForceLevel(zero, noise, contact, noises)


def _rises_at_once(force: Floats) -> bool:
    """Returns True if the contact is made within the first samples, which then tell no zero."""
    low = np.sort(force[:LEAST_BEFORE])[: LEAST_BEFORE // 2]
    above = force - float(np.median(low))
    largest = largest_of(above)
    if largest < np.ptp(force) / 2:  # the force falls, or a sample is a disturbance
        return False
    risen = above > RISEN_SHARE * largest
    first = int(np.argmax(risen))
    if not risen[first : first + RISING_SAMPLES].all():
        return False
    before = force[:first]
    if len(before) >= LEAST_BEFORE:
        # The first samples may be a transient, such as that of a filter which begins at 0.
        rest = np.abs(before - np.median(before)) <= REST_SHARE * largest
        if np.mean(rest) >= REST_SAMPLES:
            return False
    quiet = np.flatnonzero(before <= low[-1])
    return len(quiet) == 0 or int(quiet[-1]) < LEAST_BEFORE


def largest_of(above: Floats) -> float:
    """Returns the largest value that is no disturbance of the sensor."""
    pairs = float(np.max(np.minimum(above[1:], above[:-1]), initial=0.0))
    return float(np.max(above[above <= DISTURBED_FACTOR * pairs], initial=0.0))


def _factor(samples: int, before: int) -> float:
    """Returns the level of contact in standard deviations of the noise, which is computed from
    `before` samples. None of `samples` values of normal noise exceeds it with the probability
    1 - FALSE_ALARM."""
    degrees = max(before, 2) - 1
    return float(special.stdtrit(degrees, 1 - FALSE_ALARM / samples)) * math.sqrt(1 + 1 / before)


def first_touch(time_s: Floats, force: Floats, level: ForceLevel) -> Touch | None:
    """Returns the first contact of a force (n,) at the times `time_s`, or None."""
    above = force - level.zero
    first = _first_contact(time_s, above, level.contact)
    if first is None:
        return None
    deviations = math.inf if level.noise == 0 else float(above[first]) / level.noise
    single = first + 1 == len(above) or bool(above[first + 1] <= level.contact)
    early = np.flatnonzero((above[:first] > level.noises) & (level.noises > 0))
    quiet = np.flatnonzero(above[:first] <= QUIET_FACTOR * level.noise)
    # Without a quiet sample in between, an earlier sample is in the same rise of the force.
    early = early[(early < quiet.max(initial=-1)) & (time_s[first] - time_s[early] < RETURN_S)]
    return Touch(
        _crossing(time_s, above, first, level.contact), float(time_s[max(first - 1, 0)]),
        deviations, single, float(time_s[early[0]]) if len(early) else None,
    )  # fmt: skip


def touch_of(time_s: Floats, force: Floats, level: ForceLevel) -> float | None:
    """Returns the time in s at which a force (n,) rises through the level of contact for the first
    time. Returns None if there is no such time."""
    found = first_touch(time_s, force, level)
    return found.time_s if found else None


def onset_of(time_s: Floats, force: Floats, level: ForceLevel) -> int:
    """Returns the index of the last sample before a force (n,) begins to rise for the first time.
    This is before touch_of(), at which the force has already risen to the level of contact."""
    above = force - level.zero
    first = _first_contact(time_s, above, level.contact) or 0
    quiet = np.flatnonzero(above[:first] <= QUIET_FACTOR * level.noise + 1e-12 * above.max())
    return int(quiet[-1]) if len(quiet) else first


def _first_contact(time_s: Floats, above: Floats, level: float) -> int | None:
    """Returns the index of the first value above `level` that is no disturbance of the sensor, or
    None."""
    places = np.flatnonzero(above > level)
    if not len(places):
        return None
    later_s = np.append(np.diff(time_s[places]), math.inf)
    is_single = np.append(np.diff(places) > 1, True)
    is_single[1:] &= np.diff(places) > 1
    pairs = float(np.max(np.minimum(above[1:], above[:-1]), initial=0.0))
    is_disturbed = is_single & ((later_s > RETURN_S) | (above[places] > DISTURBED_FACTOR * pairs))
    found = places[~is_disturbed]
    return int(found[0]) if len(found) else None


def _crossing(time_s: Floats, values: Floats, index: int, level: float) -> float:
    """Returns the time at which the straight line between the values at `index` - 1 and `index`
    crosses `level`."""
    if index == 0:
        return float(time_s[0])
    low, high = float(values[index - 1]), float(values[index])
    share = (level - low) / (high - low) if high != low else 1.0
    return float(time_s[index - 1] + min(max(share, 0.0), 1.0) * np.diff(time_s)[index - 1])


def figures_of(time_s: Floats, force: Floats, level: ForceLevel) -> ContactFigures:
    """Returns the figures of a contact. `force` (n,): force at the times `time_s` (n,) in s after
    the first contact. Values at negative times are not evaluated."""
    inside = time_s >= 0
    time_s, above = time_s[inside], force[inside] - level.zero
    starts, ends = contacts_of(time_s, above, level)
    begin = time_s <= IMPULSE_S
    held_from = max(0, min(len(above) - HELD_LEAST, math.floor((1 - HELD_SHARE) * len(above))))
    held = float(above[held_from:].mean())
    width = max(SETTLED_SHARE * abs(held), SETTLED_NOISES * level.noise)
    outside = np.flatnonzero(np.abs(above - held) > width)
    last = int(outside[-1]) if len(outside) else -1
    settled = last < held_from
    return ContactFigures(
        peak_N=float(above.max()),
        impulse_N_s=float(np.trapezoid(above[begin], time_s[begin])),
        bounces=len(ends),
        starts_s=starts,
        ends_s=ends,
        settling_s=(float(time_s[last + 1]) if last >= 0 else 0.0) if settled else None,
        held_N=held,
    )


def contacts_of(
    time_s: Floats, above: Floats, level: ForceLevel
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Returns the times at which contact is made again, and the times at which contact is lost.
    `above`: force minus its zero, an array (n,) that begins in contact."""
    starts: list[float] = []
    ends: list[float] = []
    pressed = True
    low, high = LOST_SHARE * level.contact, level.contact
    for index in range(1, len(above)):
        if pressed and above[index] < low:
            ends.append(_crossing(time_s, above, index, low))
            pressed = False
        elif not pressed and above[index] > high:
            starts.append(_crossing(time_s, above, index, high))
            pressed = True
    return tuple(starts), tuple(ends)
