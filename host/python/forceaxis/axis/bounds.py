"""Checks targets against the bounds of an axis before the targets are written. The firmware would
reduce a target beyond a bound to this bound, so the program refuses such a target. The error text
states the target, the bound, the object that sets the bound, and the remedy.

expect(axis, {"target_force": 5000})      # InputError if the axis permits less

Axis.set() checks every target in this way. If a bound is lowered while the axis moves, the axis
sets the bit "internal limit" of the statusword, and a call of expect() then finds the bound.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from forceaxis._core import InputError
from forceaxis.axis import quantity
from forceaxis.axis.values import AxisValues, PlannedValues
from forceaxis.bus.client import Value, to_raw
from forceaxis.errors import ParameterError
from forceaxis.objects import BY_NAME, mask

INTERNAL_LIMIT = mask("statusword", "limit")
RELATIVE_TARGET = mask("controlword", "relative")
REVERSED_POSITIONS = mask("polarity", "position")
NO_LIMIT = 2**31 - 1  # a position limit of at least this magnitude means "no limit"
DAC_CODE_MAX = 2047


@dataclass(frozen=True)
class Bound:
    """Range that one object of the axis permits for a target, in the unit of the target."""

    least: float
    most: float
    # text that names the object that sets the bound, and the values from which it is computed
    by: str
    remedy: str


# Each of the following classes names objects from which bounds of targets are computed.
# The value of an object is None if the connection cannot access the object.


@dataclass(frozen=True)
class SensorObjects:
    """Objects that define how an ADC code is converted to the measured force. `force_tare` is in
    8-bit counts."""

    adc_bits: int | None
    force_zero_code: int | None
    force_sign: int | None
    force_tare: float | None


@dataclass(frozen=True)
class ForceLimits:
    """Limits of the demanded force. The limits are in per mille of `rated_force`, and `rated_force`
    is in mN."""

    force_limit: float
    force_limit_positive: float | None
    force_limit_negative: float | None
    rated_force: float
    uncertified_force: float  # force limit without a certificate, in per mille of `force_limit`
    certificate_required: str | None
    force_bank: int | None


@dataclass(frozen=True)
class EncoderLimits:
    """Limits of the axis position in encoder counts."""

    position_min: int
    position_max: int


@dataclass(frozen=True)
class PositionLimits(EncoderLimits):
    """Limits of a target position in user units, and the present position in user units and in
    encoder counts."""

    controlword: int
    position_limit_min: int
    position_limit_max: int
    polarity: int | None
    position: int
    position_actual: float | None


def _object(name: str) -> str:
    known = BY_NAME[name]
    sub = f":{known.sub}" if known.sub else ""
    return f"{name} ({known.index:04X}h{sub})"


def expect_raw(axis: AxisValues, raw: Mapping[str, int]) -> None:
    """Raises InputError if the axis would limit one of the raw values `raw`, which are to be
    written in their order. Reads only the objects from which the bounds of these values are
    computed."""
    targets = [name for name in raw if name in BOUNDS]
    planned = PlannedValues(axis, raw)
    for name in targets:
        value = planned.number(name)
        for bound in BOUNDS[name](planned):
            if not bound.least <= value <= bound.most:
                raise InputError(_refusal(axis, name, value, bound))


def expect(axis: AxisValues, values: Mapping[str, Value]) -> None:
    """Checks engineering values against the bounds of the axis before the values are written.
    Raises the errors of expect_raw()."""
    expect_raw(axis, {name: to_raw(name, value) for name, value in values.items()})


def most_force(axis: AxisValues) -> float:
    """Returns the largest `target_force` that the axis does not limit, an integer in per mille of
    `rated_force`."""
    return math.floor(min(b.most for b in BOUNDS["target_force"](PlannedValues(axis, {}))))


def expect_force(axis: AxisValues, force_N: float, swing: float) -> None:
    """Checks a target force in N to which an excitation is added. Raises InputError if the axis
    would limit the target force, or if the sum of target force and excitation is outside the range
    that expect_readable() permits."""
    expect_readable(axis, force_N, swing, quantity.force_per_count(axis))
    expect(axis, {"target_force": 1e6 * force_N / axis.number("rated_force")})


def expect_readable(
    axis: AxisValues, force_N: float, swing: float, newton_per_count: float
) -> None:
    """Raises InputError if a force with an excitation leaves the range that the sensor can measure,
    or exceeds `force_max`. `swing`: peak-to-peak amplitude of the excitation divided by the
    force."""
    reading, force_max = of_reading(PlannedValues(axis, {})), axis.number("force_max")
    for counts, by in (
        (reading.most if reading else math.inf, "the end of the range of the measured force"),
        (force_max or math.inf, _object("force_max")),
    ):
        most = counts * newton_per_count / (1 + swing / 2)
        if force_N > most:
            raise ParameterError(
                "force",
                f"expected a force of at most {most:.6g} N, so that force and excitation together "
                f"stay below {counts * newton_per_count:.6g} N, {by}, got {force_N:g} N; give a "
                "smaller force, raise force_max or use a sensor with a larger range",
            )


def _refusal(axis: AxisValues, name: str, value: float, bound: Bound) -> str:
    above = value > bound.most
    limit = bound.most if above else bound.least
    wanted = f"at {'most' if above else 'least'} {quantity.shown(axis, name, limit)}"
    return (
        f"{name}: expected {wanted} by {bound.by}, got {quantity.shown(axis, name, value)}; "
        f"{bound.remedy}"
    )


def of_reading(planned: PlannedValues) -> Bound | None:
    """Returns the range of force in 8-bit counts that the sensor can measure, computed from the ADC
    codes without the two end codes. If the force at one end of the range is 0, this end does not
    bound a target force."""
    sensor = planned.record(SensorObjects)
    bits, zero, tare = sensor.adc_bits, sensor.force_zero_code, sensor.force_tare
    sign = sensor.force_sign
    if bits is None or zero is None or sign is None or tare is None:
        return None
    code, top = 2.0 ** (8 - bits), 2**bits - 1
    ends = {end: sign * (end - zero) * code - tare for end in (0, top)}
    low, high = sorted(ends, key=lambda end: ends[end])
    return Bound(
        -math.inf if low == zero else ends[low] + code,
        math.inf if high == zero else ends[high] - code,
        f"the end of the range of the measured force (adc_bits {bits}, force_zero_code {zero}, "
        f"force_tare {tare:g} count)",
        "ask for less, or fit a sensor of a larger range and set force_scale",
    )


def _force_setpoint(planned: PlannedValues) -> Iterator[Bound]:
    reading = of_reading(planned)
    if reading:
        yield reading


def _target_force(other: str) -> Callable[[PlannedValues], Iterator[Bound]]:
    """Returns a function that yields the bounds of a target force, in per mille of `rated_force`.
    The demanded force is the sum of two objects. `other` is the name of the object that is added to
    the target."""

    def bounds(planned: PlannedValues) -> Iterator[Bound]:
        added = planned.number(other)
        limits = planned.record(ForceLimits)
        rated_N = limits.rated_force * 1e-3
        beside = f", beside {other} {added:g} per mille" if added else ""

        def bound(most: float, least: float, by: str, remedy: str) -> Bound:
            return Bound(least - added, most - added, by + beside, remedy)

        of_rated = f"per mille of rated_force {rated_N:.6g} N"
        more = "ask for less, or raise it or rated_force"
        limit, positive = limits.force_limit, limits.force_limit_positive
        negative = limits.force_limit_negative
        yield bound(limit, -limit, f"{_object('force_limit')}, {limit:g} {of_rated}", more)
        if positive is not None:
            by = f"{_object('force_limit_positive')}, {positive:g} {of_rated}"
            yield bound(positive, -math.inf, by, more)
        if negative is not None:
            by = f"{_object('force_limit_negative')}, {negative:g} {of_rated}"
            yield bound(math.inf, -negative, by, more)
        yield from _uncertified(planned, limits, bound)
        reading = of_reading(planned)
        if reading:
            # `force_scale` is in uN and `rated_force` in mN, so their quotient is in per mille.
            per_count = planned.number("force_scale") / limits.rated_force
            yield bound(
                reading.most * per_count, reading.least * per_count, reading.by, reading.remedy
            )

    return bounds


def _uncertified(
    planned: PlannedValues, limits: ForceLimits, bound: Callable[[float, float, str, str], Bound]
) -> Iterator[Bound]:
    """Yields the bound of a target force while the force law has no valid certificate."""
    bank, share = limits.force_bank, limits.uncertified_force
    if not bank and limits.certificate_required != "yes":
        return
    # The state of the certificate is None if the connection cannot access the object.
    name = f"certificate_state_{bank}"
    state = planned.get(name).get(name) if bank else "none"
    if state in ("fits", None):
        return
    most = limits.force_limit * share // 1000
    law = f"bank {bank}" if bank else "force_gain alone"
    yield bound(
        most, -most, f"{_object('uncertified_force')}, {share:g} per mille of force_limit, "
        f"while the certificate of {law} is {str(state).replace('_', ' ')}",
        "ask for less, give the bank a certificate (`design_law`) or raise it",
    )  # fmt: skip


def _position(planned: PlannedValues) -> Iterator[Bound]:
    """Yields the bounds of a target position in user units of the axis."""
    limits = planned.record(PositionLimits)
    if limits.controlword & RELATIVE_TARGET:
        return
    more = "ask for a place inside, or move the limit"
    yield Bound(_end(limits.position_limit_min), math.inf, _object("position_limit_min"), more)
    yield Bound(-math.inf, _end(limits.position_limit_max), _object("position_limit_max"), more)
    low, high, here = limits.position_min, limits.position_max, limits.position
    user = limits.position_actual
    if _end(low) == -math.inf and _end(high) == math.inf:
        return
    ratio = quantity.user_per_count(planned.axis)
    if ratio is None or user is None:
        return
    per_count = -ratio if (limits.polarity or 0) & REVERSED_POSITIONS else ratio
    named = [(name, user + per_count * (_end(count) - here), count)
             for name, count in (("position_min", low), ("position_max", high))]  # fmt: skip
    for (name, place, count), low_end in zip(sorted(named, key=lambda n: n[1]), (True, False),
                                             strict=True):  # fmt: skip
        by = f"{_object(name)}, {count} encoder counts"
        if low_end:
            yield Bound(place, math.inf, by, more)
        else:
            yield Bound(-math.inf, place, by, more)


def _end(position: float) -> float:
    """Returns a position limit of the axis. If the value means "no limit", returns an infinity with
    the sign of the value."""
    return math.copysign(math.inf, position) if abs(position) >= NO_LIMIT else position


def _native_position(planned: PlannedValues) -> Iterator[Bound]:
    limits = planned.record(EncoderLimits)
    more = "ask for a place inside, or move the limit"
    yield Bound(_end(limits.position_min), math.inf, _object("position_min"), more)
    yield Bound(-math.inf, _end(limits.position_max), _object("position_max"), more)


def _velocity(other: str = "") -> Callable[[PlannedValues], Iterator[Bound]]:
    """Returns a function that yields the bounds of a target speed in user units per second.
    `other`: name of the object whose value is added to the target speed in cyclic velocity mode."""

    def bounds(planned: PlannedValues) -> Iterator[Bound]:
        most = planned.number("velocity_max")
        is_summed = other and planned.read("modes_of_operation") == "cyclic_velocity"
        added = planned.number(other) if is_summed else 0
        by = _object("velocity_max") + (f", beside {other} {added:g}" if added else "")
        yield Bound(-most - added, most - added, by, "ask for less, or raise it")

    return bounds


def _approach(planned: PlannedValues) -> Iterator[Bound]:
    """Yields the bounds of an approach speed in encoder counts per second."""
    most, ratio = planned.number("velocity_max"), quantity.user_per_count(planned.axis)
    if ratio is not None:
        yield Bound(
            -math.inf, most / ratio, f"{_object('velocity_max')}, {most:g} of the axis' units/s",
            "ask for less, or raise it",
        )  # fmt: skip


def _code(beside: str = "", always: bool = False) -> Callable[[PlannedValues], Iterator[Bound]]:
    """Returns a function that yields the bounds of an object that sets a DAC code. `beside`: name
    of another object whose DAC code is added. If `always` is True, the other DAC code is added in
    every mode of operation, otherwise only in excitation mode."""

    def bounds(planned: PlannedValues) -> Iterator[Bound]:
        limit = planned.number("output_limit")
        most = min(limit, DAC_CODE_MAX)
        is_summed = always or beside in planned.planned
        if beside and not is_summed:
            is_summed = planned.read("modes_of_operation") == "excitation"
        added = abs(planned.number(beside)) if is_summed else 0
        bias = planned.number("output_bias")
        by = _object("output_limit") if limit <= DAC_CODE_MAX else "the range of the DAC"
        by += f", beside {beside} {added:g}" if added else ""
        by += f", beside output_bias {bias:g}" if bias else ""
        yield Bound(
            added - most - bias, most - added - bias, by, "ask for less, or raise output_limit"
        )

    return bounds


# {name of a target object: function that yields the bounds of the target}
BOUNDS: dict[str, Callable[[PlannedValues], Iterator[Bound]]] = {
    "target_force": _target_force("force_offset"),
    "force_offset": _target_force("target_force"),
    "force_setpoint": _force_setpoint,
    "target_position": _position,
    "interpolation_setpoint": _position,
    "position_setpoint": _native_position,
    "target_velocity": _velocity("velocity_offset"),
    "velocity_offset": _velocity("target_velocity"),
    "trajectory_velocity": _velocity(),
    "homing_speed_1": _velocity(),
    "homing_speed_2": _velocity(),
    "approach_velocity_max": _approach,
    "open_loop_code": _code("excitation_amplitude"),
    "excitation_amplitude": _code("open_loop_code", always=True),
    "excitation_code": _code(),
}
