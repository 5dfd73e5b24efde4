"""Evaluates the first contact in a force signal. The module finds the time of the contact and the
sample at which the force begins to rise, and computes figures such as the peak force.

The same functions evaluate measured and predicted signals, so both have the same definitions.
"""

import math
from dataclasses import dataclass

import numpy as np

from forceaxis._core import InputError
from forceaxis.recordings.findings import quantum_of
from forceaxis.recordings.signal_recording import Floats

LEAST_BEFORE = 8  # smallest number of samples that a recording needs before the first contact
# A force counts as contact if it is larger than each of three levels.
# The three levels are multiples of the noise, the largest force, and the smallest step.
NOISE_FACTOR, PEAK_SHARE, QUANTA = 6.0, 0.02, 1.5
# largest value of the level from the smallest step, relative to the largest force
COARSE_SHARE = 0.5
# Two thresholds of the force define the sample at which the force begins to rise.
# The first threshold for the rise of the force is a multiple of the noise of the force.
# The second threshold for the rise of the force is a fraction of the largest force.
# The rise begins after the last sample below the first, before the force exceeds the second.
QUIET_FACTOR, RISEN_SHARE = 3.0, 0.1
LOST_SHARE = 0.5  # A contact is lost when the force is below this fraction of the level of contact.
# The held force is the mean over the end of the signal: this fraction of its samples.
HELD_SHARE, HELD_LEAST = 0.2, 10
SETTLED_SHARE = 0.05  # half width of the settling band, relative to the held force
IMPULSE_S = 0.025
CONTACTS = 3  # number of contacts whose start and end times are evaluated


@dataclass(frozen=True)
class ForceLevel:
    """Zero and noise of a force before the first contact, and the force that counts as contact. All
    three are in the unit of the force."""

    zero: float
    noise: float  # standard deviation of the noise of the force
    contact: float  # The axis is in contact if the force exceeds the zero by at least this value.


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


def level_of(force: Floats, where: str) -> ForceLevel:
    """Returns the zero, the noise and the level of contact of a force (n,). Raises InputError if
    there is no contact, or too few samples before the contact."""
    head = force[: max(LEAST_BEFORE, len(force) // 50)]
    zero = float(np.median(head))
    largest = float(np.max(force - zero, initial=0.0))
    # The steps of a converter with few bits may be large in comparison with the force.
    steps = min(QUANTA * quantum_of(force), COARSE_SHARE * largest)
    rough = 1.4826 * float(np.median(np.abs(head - zero)))
    level = max(NOISE_FACTOR * rough, PEAK_SHARE * largest, steps)
    first = _first_above(force - zero, level)
    if first is None:
        raise InputError(
            f"{where}: expected a force that is positive in compression and rises at a contact, "
            f"but the recorded force exceeds its value without contact, {zero:.4g} N, by at most "
            f"{largest:.4g} N; import the force with the opposite sign, or record a contact"
        )
    before = force[: max(0, first - 2)]
    if len(before) < LEAST_BEFORE:
        raise InputError(
            f"{where}: expected at least {LEAST_BEFORE} samples before the first contact, got "
            f"{len(before)}; begin the recording earlier"
        )
    zero, noise = float(before.mean()), float(before.std())
    contact = max(NOISE_FACTOR * noise, PEAK_SHARE * largest, steps)
    return ForceLevel(zero, noise, contact)


def touch_of(time_s: Floats, force: Floats, level: ForceLevel) -> float | None:
    """Returns the time in s at which a force (n,) first rises through the level of contact. Returns
    None if it never does."""
    above = force - level.zero
    first = _first_above(above, level.contact)
    return None if first is None else _crossing(time_s, above, first, level.contact)


def onset_of(force: Floats, level: ForceLevel) -> int:
    """Returns the index of the last sample before a force (n,) first begins to rise. This sample is
    earlier than touch_of(), the time at which the force reaches the level of contact."""
    above = force - level.zero
    largest = float(above.max())
    first = int(np.argmax(above > RISEN_SHARE * largest))
    quiet = np.flatnonzero(above[:first] <= QUIET_FACTOR * level.noise + 1e-12 * largest)
    return int(quiet[-1]) if len(quiet) else first


def _first_above(above: Floats, level: float) -> int | None:
    """Returns the index of the first value above `level` that is followed by another one above it.
    Returns None if there is none."""
    is_above = above > level
    places = np.flatnonzero(is_above[:-1] & is_above[1:])
    return int(places[0]) if len(places) else None


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
    width = max(SETTLED_SHARE * abs(held), 3 * level.noise)
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
    for index in range(1, len(above) - 1):
        if pressed and above[index] < low and above[index + 1] < low:
            ends.append(_crossing(time_s, above, index, low))
            pressed = False
        elif not pressed and above[index] > high and above[index + 1] > high:
            starts.append(_crossing(time_s, above, index, high))
            pressed = True
    return tuple(starts), tuple(ends)
