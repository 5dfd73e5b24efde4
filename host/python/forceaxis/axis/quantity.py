"""Converts a text that the user has typed to the value of an object. The text is a number in the
unit of the object, a text of an enumeration, or a quantity such as "75 N", "10 mm" or "4mm/s".

Forces are converted with force_scale and rated_force of the axis. Times and codes are converted
with fixed factors. For lengths, the size of a position count must be known. It is known from the
user units of the axis (objects 6092h and 60A8h) or from the encoder in a model. A simulated axis
has a model, for a real axis the caller gives one. A length as a target position is measured from
position 0, in the positive direction of the axis.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.axis.link import TICKS_PER_S
from forceaxis.axis.values import AxisValues, PlannedValues, known_object, object_names
from forceaxis.bus import client
from forceaxis.bus.client import Value, object_named
from forceaxis.bus.state_names import texts
from forceaxis.errors import ParameterError
from forceaxis.objects import BY_NAME, AxisObject, default

CODES_PER_V = 4096 / 20  # number of DAC codes per volt at the output
METRE_UNIT = 0x01  # code of the unit metre in CiA 303-2
NUMBER_WITH_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
# Objects whose value is in per mille of the object rated_force.
PER_MILLE_OF_RATED_FORCE = {
    "target_force", "force_offset", "force_limit", "force_limit_positive", "force_limit_negative",
    "force_demand", "force_actual",
}  # fmt: skip
# Objects whose unit "code" means a DAC code. For all other objects, "code" means an ADC code.
DAC_CODE_OBJECTS = {
    "open_loop_code", "excitation_amplitude", "excitation_code", "output_limit",
    "uncertified_output", "contact_loss_cap", "first_motion_code", "dac_code", "dac_fine",
    "command_code", "output_bias",
}  # fmt: skip
# {unit of an object: (SI unit, number of these units in one SI unit)}
FIXED_UNITS = {
    "mN": ("N", 1e3), "uN": ("N", 1e6), "ms": ("s", 1e3), "us": ("s", 1e6),
    "tick": ("s", float(TICKS_PER_S)), "Hz": ("Hz", 1.0), "Hz/s": ("Hz/s", 1.0),
}  # fmt: skip
# {unit with encoder counts: (SI unit, exponent of the tick rate in the conversion)}
COUNT_UNITS = {
    "count": ("m", 0), "count/s": ("m/s", 0), "count/s^2": ("m/s^2", 0),
    "count/tick": ("m/s", 1), "count/tick^2": ("m/s^2", 2),
}  # fmt: skip
COUNTS_WITHOUT_LENGTH = {"encoder_increments"}
# Indices of CiA 402 objects whose unit is always the encoder count, even with user units.
COUNT_INDICES = (0x6063, 0x6069)
UNKNOWN_COUNT_SIZE = (
    "; what a count is in mm is not known: give a model, or the axis its units (6092h, 60A8h)"
)


@dataclass(frozen=True)
class GearObjects:
    """Objects from which the number of user units per encoder count is computed (CiA 402)."""

    feed: float
    encoder_revolutions: int
    gear_shaft_revolutions: int
    feed_shaft_revolutions: int
    encoder_increments: int
    gear_motor_revolutions: int


@dataclass(frozen=True)
class Force:
    """A force that the user has given, either in N or in 8-bit counts. `newton`: True for a value
    in N."""

    value: float
    newton: bool


def force_per_count(axis: AxisValues) -> float:
    """Returns the force in N of one 8-bit count, from `force_scale` of the axis."""
    return axis.number("force_scale") * 1e-6


def never_set(force_scale: float, calibration_date: int) -> bool:
    """Returns True if the axis was never calibrated, so that `force_scale`, in uN per count, still
    has its default value. This value does not belong to the sensor of the axis. `calibration_date`:
    value of the object, which is 0 before the first calibration."""
    return not calibration_date and force_scale == default("force_scale")


def is_reading(known: AxisObject | None) -> bool:
    """Returns True if the unit of an object is the 8-bit count of the measured force."""
    return known is not None and known.unit == "count" and known.quantity == "force"


def user_per_count(axis: AxisValues) -> float | None:
    """Returns the number of user units per encoder count. An axis without user units has 1. Returns
    None if the connection cannot access the objects of the user units."""
    if not axis.number("feed"):
        return 1.0
    if not all(axis.link.reaches(name) for name in object_names(GearObjects)):
        return None
    gear = axis.record(GearObjects)
    above = gear.feed * gear.encoder_revolutions * gear.gear_shaft_revolutions
    return (
        above / gear.feed_shaft_revolutions / gear.encoder_increments / gear.gear_motor_revolutions
    )


def _metres_of_user(axis: AxisValues) -> float | None:
    """Returns the length of a user unit in m from 60A8h, or None if the user unit is not a
    length."""
    if not axis.number("feed") or not axis.link.reaches("position_unit"):
        return None
    exponent, unit = divmod(axis.integer("position_unit") >> 16, 256)
    return 10.0 ** (exponent - 256 if exponent > 127 else exponent) if unit == METRE_UNIT else None


def per_metre(axis: AxisValues, known: AxisObject) -> float | None:
    """Returns how many position units of an object are one metre. The object is a position, a speed
    or an acceleration. Returns None if this number is not known."""
    of_user = known.index >= 0x6000 and known.index not in COUNT_INDICES
    metres, ratio = _metres_of_user(axis), user_per_count(axis)
    model = axis.link.counts_per_metre
    if of_user:
        if metres is not None:
            return 1 / metres
        return None if model is None or ratio is None else model * ratio
    if model is not None:
        return model
    return None if metres is None or ratio is None else 1 / (metres * ratio)


def _is_length(known: AxisObject) -> bool:
    return (
        known.unit in COUNT_UNITS
        and not is_reading(known)
        and known.name not in COUNTS_WITHOUT_LENGTH
    )


def scale_of(axis: AxisValues, known: AxisObject) -> tuple[str, float] | None:
    """Returns the SI unit of an object, and how many units of the object are one SI unit. Returns
    None if the object has no physical unit or if this number is not known."""
    if is_reading(known):
        return "N", 1 / force_per_count(axis)
    if known.name in PER_MILLE_OF_RATED_FORCE:
        return "N", 1e6 / axis.number("rated_force")
    if known.name in DAC_CODE_OBJECTS:
        return "V", CODES_PER_V
    if known.name == "force_gain":
        return "V/N", CODES_PER_V * force_per_count(axis)
    if _is_length(known):
        unit, powers = COUNT_UNITS[known.unit]
        scale = per_metre(axis, known)
        return None if scale is None else (unit, scale / TICKS_PER_S**powers)
    return FIXED_UNITS.get(known.unit)


def parse(axis: AxisValues, name: str, text: str) -> Value:
    """Converts a text that the user has typed to a value for Axis.set(). The text is a number, or
    the text of an enumeration, or a quantity with a unit that fits the object, such as "30 count",
    "75 N" or "10 mm". Raises InputError."""
    known = object_named(name)
    if known is None or text in texts(known):
        return text
    parts = NUMBER_WITH_UNIT.fullmatch(text)
    if parts is None:
        return text  # Axis.set() raises the error for a wrong text, and states the expected texts.
    number, unit = parts.groups()
    if not unit or unit == known.unit:
        return number
    scale, or_unit, note = scale_of(axis, known), "", ""
    if scale is not None:
        value = _core.quantity_in(f"{number} {unit}", scale[0])
        if value is not None:
            return value * scale[1]
        or_unit = f" or {scale[0]}"
    elif _is_length(known):
        note = UNKNOWN_COUNT_SIZE
    raise InputError(
        f"{name}: expected a value with the unit {known.unit}{or_unit}, got {text}{note}"
    )


def all_raw(axis: AxisValues, values: Mapping[str, Value]) -> dict[str, int]:
    """Converts values to raw values. `values`: {object: engineering value, text of an enumeration
    or quantity}, in the order in which they are written. If `rated_force` is one of them, a later
    `target_force` is converted with this new `rated_force`. Raises InputError."""
    raw: dict[str, int] = {}
    planned = PlannedValues(axis, raw)
    for name, value in values.items():
        raw[name] = to_raw(planned, name, value)
    return raw


def to_raw(axis: AxisValues, name: str, value: Value) -> int:
    """Converts an engineering value, the text of an enumeration or a quantity to a raw value.
    Raises InputError; the error states the permitted range also in N or mm if the scale of the
    object is known."""
    if not isinstance(value, str):
        return client.to_raw(name, value)
    given = parse(axis, name, value)
    if isinstance(given, str):
        return client.to_raw(name, given)
    known = BY_NAME[name]
    least, most = known.min * known.scale, known.max * known.scale
    if not least - known.scale / 2 < given < most + known.scale / 2:
        raise InputError(
            f"{name}: expected {shown(axis, name, least)} to {shown(axis, name, most)}, got {value}"
        )
    return client.to_raw(name, given)


def number(axis: AxisValues, name: str, text: str) -> float:
    """Returns the value of an object, which must be a number. Raises InputError."""
    try:
        return float(parse(axis, name, text))
    except ValueError:
        raise InputError(f"{name}: expected a number, got {text}") from None


def expect_written(option: str, text: str | None, example: str) -> None:
    """Raises InputError for the text of an option that is neither a number nor a quantity. This
    check needs no axis."""
    if text is not None and NUMBER_WITH_UNIT.fullmatch(text) is None:
        raise InputError(
            f'{option}: expected a number or a quantity such as "{example}", got {text}'
        )


def expect_speed(option: str, text: str | None, example: str) -> None:
    """Raises InputError for the text of an option that is not a speed with its unit. A number alone
    could be in mm/s or in encoder counts/s, which differ by orders of magnitude. This check needs
    no axis."""
    expect_written(option, text, example)
    if text is not None and "/" not in text:
        raise InputError(
            f'{option}: expected a speed with its unit, such as "{example}" or "{text.split()[0]} '
            f'count/s", got {text}'
        )


def force(text: str | float) -> Force:
    """Converts a text or a number to a force. "75 N" and "75N" are forces in N. "30", "30 count"
    and the number 30 are forces in 8-bit counts. Raises InputError."""
    parts = NUMBER_WITH_UNIT.fullmatch(str(text))
    if parts is not None:
        digits, unit = parts.groups()
        if unit in ("", "count"):
            return Force(float(digits), newton=False)
        value = _core.quantity_in(f"{digits} {unit}", "N")
        if value is not None:
            return Force(value, newton=True)
    raise InputError(
        f'{text}: expected a force such as "75 N", or a number of force counts such as 30'
    )


def shown(axis: AxisValues, name: str, value: float) -> str:
    """Returns a text with the value of an object in the unit of the object. If the value can be
    converted to N or mm, the text also has the converted value."""
    known = object_named(name)
    if known is None:
        return f"{value:g}"
    own = f"{value:.6g}{'' if known.unit == '1' else ' ' + known.unit}"
    scale = scale_of(axis, known)
    if scale is None or scale[0] not in ("N", "m", "m/s", "V"):
        return own
    unit, factor = (f"m{scale[0]}", 1e3) if scale[0].startswith("m") else (scale[0], 1.0)
    return f"{factor * value / scale[1]:.6g} {unit} ({own})"


def trigger_on(name: str, level: float, edge: str = "rising") -> dict[str, Value]:
    """Returns the trigger settings of a recording for Axis.capture(). The trigger is the moment at
    which the object `name` crosses the value `level`, in engineering units."""
    known = known_object(name)
    return {
        "trigger_source": known.index << 8 | known.sub,
        "trigger_level": round(level / known.scale),
        "trigger_edge": edge,
    }


def trigger(axis: AxisValues, text: str) -> dict[str, Value]:
    """Converts the text of a trigger to trigger settings for Axis.capture(). Examples of the text
    are "force rising 31", "force rising 75 N" and "fault either 0.5"."""
    words = text.split(None, 2)
    if text == "excitation_start":
        return {"trigger_edge": text}
    if len(words) != 3 or words[1] not in ("rising", "falling", "either"):
        raise ParameterError(
            "trigger",
            f'{text}: expected a trigger as "NAME rising|falling|either LEVEL", or '
            "excitation_start",
        )
    name, edge, level = words
    return trigger_on(name, number(axis, name, level), edge)
