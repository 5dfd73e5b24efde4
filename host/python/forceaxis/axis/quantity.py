"""What a person writes for the value of an object: a number in its unit, a text, or a force."""

from forceaxis._core import InputError
from forceaxis.bus.client import object_named
from forceaxis.bus.state_names import texts
from forceaxis.objects import default

NEWTON = {"N": 1.0, "kN": 1e3, "mN": 1e-3}


def force_per_count(axis):
    """Force of one count of an 8-bit reading in N, as the axis has it."""
    return axis.read("force_scale") * 1e-6


def never_set(force_scale, calibration_date):
    """Whether an axis has the force_scale (uN a count) that it was delivered with, whatever its
    sensor is; calibration_date: 0 is none."""
    return not calibration_date and force_scale == default("force_scale")


def is_reading(known):
    """Whether an object is in counts of the force reading."""
    return known is not None and known.unit == "count" and known.scale != 1


def parse(axis, name, text):
    """Value for Axis.set() of a number, "30 count", "75 N" where the object is a force, or an
    enum's text. Raises InputError."""
    known = object_named(name)
    if known is None or text in texts(known):
        return text
    number, _, unit = text.strip().partition(" ")
    unit = unit.strip()
    if not unit or unit == known.unit:
        return number
    if unit in NEWTON and (known.unit in ("mN", "uN") or is_reading(known)):
        newton = _number(name, number) * NEWTON[unit]
        if is_reading(known):
            return newton / force_per_count(axis)
        return newton * (1e3 if known.unit == "mN" else 1e6)
    forces = " or N" if is_reading(known) else ""
    raise InputError(f"{name}: expected a value in {known.unit}{forces}, got {text}")


def trigger(axis, text):
    """Settings of Axis.capture() for "force rising 31", "fault either 0.5" or a force in N."""
    from forceaxis.axis.axis import trigger_on

    words = text.split(None, 2)
    if text == "excitation_start":
        return {"trigger_edge": text}
    if len(words) != 3 or words[1] not in ("rising", "falling", "either"):
        raise InputError(
            f'--trigger {text}: expected "NAME rising|falling|either LEVEL" or excitation_start'
        )
    name, edge, level = words
    return trigger_on(name, _number(name, parse(axis, name, level)), edge)


def _number(name, text):
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name}: expected a number, got {text}") from None
