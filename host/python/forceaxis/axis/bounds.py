"""Targets beyond what an axis takes. The firmware clips them, so they are refused before they are
written: what was asked, the bound, the object that sets it, and what to do.

expect(axis, {"target_force": 5000})      # InputError where 6072h and rated_force permit less

Axis.set() does this for every target. A bound that is lowered while the axis moves is seen by the
statusword's bit "internal limit", and expect() says then which one it is.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from forceaxis._core import InputError
from forceaxis.axis import quantity
from forceaxis.axis.link import Live
from forceaxis.bus.client import from_raw, object_named, to_raw
from forceaxis.bus.state_names import BY_NAME
from forceaxis.errors import ParameterError

INTERNAL_LIMIT = 1 << 11  # bit of the statusword: the axis limits a target or the output
RELATIVE = 1 << 6  # bit of the controlword: a target position is relative to the present position
REVERSED = 0x80  # bit of polarity that reverses the direction of positions
NO_LIMIT = 2**31 - 1  # a position limit of this magnitude means no limit
CODE_MOST = 2047  # of the DAC
WHOLE = 1000  # per mille of 1
WAVE = "excitation"  # the mode of operation


@dataclass(frozen=True)
class Bound:
    """Range of a target that one object permits, in the unit of the target."""

    least: float
    most: float
    by: str  #: the object, and other values from which the bound follows
    remedy: str


class Present:
    """Values of an axis, with those of `values` as they will be after writing."""

    def __init__(self, axis: Live, values: Mapping[str, Any]) -> None:
        self.axis, self.given = axis, frozenset(values)
        self._found = {n: _engineering(n, v) for n, v in values.items()}

    def __call__(self, *names: str) -> tuple[Any, ...]:
        """Engineering values of objects; None for an object that the connection cannot access."""
        missing = [n for n in names if n not in self._found]
        reached = [n for n in missing if self.axis.link.reaches(n)]
        self._found |= dict.fromkeys(missing) | (self.axis.get(*reached) if reached else {})
        return tuple(self._found[name] for name in names)


def _engineering(name: str, value: Any) -> Any:
    known = object_named(name)
    return value if known is None else from_raw(name, to_raw(name, value))


def _object(name: str) -> str:
    known = BY_NAME[name]
    sub = f":{known.sub}" if known.sub else ""
    return f"{name} ({known.index:04X}h{sub})"


def expect(axis: Live, values: Mapping[str, Any]) -> None:
    """Checks engineering values that are to be written in this order. Raises InputError, in one
    line, if the axis would limit one of them. Only the objects of the relevant bounds are read."""
    targets = [name for name in values if name in BOUNDS]
    if not targets:
        return
    present = Present(axis, values)
    for name in targets:
        (value,) = present(name)
        for bound in BOUNDS[name](present):
            if not bound.least <= value <= bound.most:
                raise InputError(_refusal(axis, name, value, bound))


def clipped(axis: Live, values: Mapping[str, Any]) -> str:
    """The text of the error that expect() would raise for the values now; "" if none would be
    limited."""
    try:
        expect(axis, values)
    except InputError as error:
        return str(error)
    return ""


def most_force(axis: Live) -> float:
    """The largest target_force that the axis does not limit, in per mille of rated_force, an
    integer."""
    return math.floor(min(b.most for b in BOUNDS["target_force"](Present(axis, {}))))


def expect_force(axis: Live, force_N: float, swing: float) -> None:
    """Checks a force in N that is to be pressed with an excitation. Raises InputError if the axis
    would limit it, or if expect_readable() does."""
    force_scale, rated_force = axis.get("force_scale", "rated_force").values()
    expect_readable(axis, force_N, swing, force_scale * 1e-6)
    expect(axis, {"target_force": 1e6 * force_N / rated_force})


def expect_readable(axis: Live, force_N: float, swing: float, newton_per_count: float) -> None:
    """Checks that a force stays within the range of the measured force and below force_max.
    `swing`: range of the force peak to peak, relative to the force. Raises InputError."""
    present = Present(axis, {})
    reading, (own,) = of_reading(present), present("force_max")
    for counts, by in (
        (reading.most if reading else math.inf, "the end of the reading's range"),
        (own or math.inf, _object("force_max")),
    ):
        most = counts * newton_per_count / (1 + swing / 2)
        if force_N > most:
            raise ParameterError(
                "force",
                f"expected at most {most:.6g} N, whose swing while it is excited stays "
                f"within {counts * newton_per_count:.6g} N, {by}, got {force_N:g} N; ask for less, "
                "raise that bound or fit a sensor of a larger range",
            )


def _refusal(axis: Live, name: str, value: float, bound: Bound) -> str:
    above = value > bound.most
    limit = bound.most if above else bound.least
    wanted = f"at {'most' if above else 'least'} {quantity.shown(axis, name, limit)}"
    return (
        f"{name}: expected {wanted} by {bound.by}, got {quantity.shown(axis, name, value)}; "
        f"{bound.remedy}"
    )


def of_reading(present: Present) -> Bound | None:
    """Range of the measured force in counts by its ADC, without the end codes. An end at which the
    measured force is zero is not a bound: there the axis presses against the end or is out of
    contact."""
    bits, zero, sign, tare = present("adc_bits", "force_zero_code", "force_sign", "force_tare")
    if None in (bits, zero, sign, tare):
        return None
    code, top = 2.0 ** (8 - bits), 2**bits - 1
    ends = {end: sign * (end - zero) * code - tare for end in (0, top)}
    low, high = sorted(ends, key=lambda end: ends[end])
    return Bound(
        -math.inf if low == zero else ends[low] + code,
        math.inf if high == zero else ends[high] - code,
        f"the end of the reading's range (adc_bits {bits}, force_zero_code {zero}, force_tare "
        f"{tare:g} count)",
        "ask for less, or fit a sensor of a larger range and set force_scale",
    )


def _force_setpoint(present: Present) -> Iterator[Bound]:
    reading = of_reading(present)
    if reading:
        yield reading


def _without_certificate(present: Present) -> bool:
    (bank,) = present("force_bank")
    if not bank:
        return bool(present("certificate_required")[0] == "yes")
    return present(f"certificate_state_{bank}")[0] not in ("fits", None)


def _target_force(other: str) -> Callable[[Present], Iterator[Bound]]:
    """Bounds of one of the two summands of the demanded force, in per mille of rated_force."""

    def bounds(present: Present) -> Iterator[Bound]:
        (added,) = present(other)
        added = added or 0
        limit, positive, negative, rated = present(
            "force_limit", "force_limit_positive", "force_limit_negative", "rated_force"
        )
        rated_N = rated * 1e-3
        beside = f", beside {other} {added:g} per mille" if added else ""

        def bound(most: float, least: float, by: str, remedy: str) -> Bound:
            return Bound(least - added, most - added, by + beside, remedy)

        of_rated = f"per mille of rated_force {rated_N:.6g} N"
        more = "ask for less, or raise it or rated_force"
        yield bound(limit, -limit, f"{_object('force_limit')}, {limit:g} {of_rated}", more)
        if positive is not None:
            by = f"{_object('force_limit_positive')}, {positive:g} {of_rated}"
            yield bound(positive, -math.inf, by, more)
        if negative is not None:
            by = f"{_object('force_limit_negative')}, {negative:g} {of_rated}"
            yield bound(math.inf, -negative, by, more)
        if _without_certificate(present):
            share, (bank,) = present("uncertified_force")[0], present("force_bank")
            most = limit * share // WHOLE
            state = present(f"certificate_state_{bank}")[0] if bank else "none"
            law = f"bank {bank}" if bank else "force_gain alone"
            yield bound(
                most, -most, f"{_object('uncertified_force')}, {share:g} per mille of force_limit, "
                f"while the certificate of {law} is {str(state).replace('_', ' ')}",
                "ask for less, give the bank a certificate (`forceaxis design`) or raise it",
            )  # fmt: skip
        reading = of_reading(present)
        if reading:
            per_count = present("force_scale")[0] / rated  # uN divided by mN gives per mille
            yield bound(
                reading.most * per_count, reading.least * per_count, reading.by, reading.remedy
            )

    return bounds


def _position(present: Present) -> Iterator[Bound]:
    """Bounds of a target in user units of the axis."""
    (word,) = present("controlword")
    if word & RELATIVE:
        return
    low, high = present("position_limit_min", "position_limit_max")
    more = "ask for a place inside, or move the limit"
    yield Bound(_end(low), math.inf, _object("position_limit_min"), more)
    yield Bound(-math.inf, _end(high), _object("position_limit_max"), more)
    low, high, polarity, here, user = present(
        "position_min", "position_max", "polarity", "position", "position_actual"
    )
    if _end(low) == -math.inf and _end(high) == math.inf:
        return
    ratio = quantity.user_per_count(present.axis)
    if ratio is None or user is None:
        return
    way = -ratio if (polarity or 0) & REVERSED else ratio
    named = [(name, user + way * (_end(count) - here), count)
             for name, count in (("position_min", low), ("position_max", high))]  # fmt: skip
    for (name, place, count), low_end in zip(sorted(named, key=lambda n: n[1]), (True, False),
                                             strict=True):  # fmt: skip
        by = f"{_object(name)}, {count} encoder counts"
        if low_end:
            yield Bound(place, math.inf, by, more)
        else:
            yield Bound(-math.inf, place, by, more)


def _end(position: float) -> float:
    """A position limit; infinite if there is no limit."""
    return math.copysign(math.inf, position) if abs(position) >= NO_LIMIT else position


def _native_position(present: Present) -> Iterator[Bound]:
    low, high = present("position_min", "position_max")
    more = "ask for a place inside, or move the limit"
    yield Bound(_end(low), math.inf, _object("position_min"), more)
    yield Bound(-math.inf, _end(high), _object("position_max"), more)


def _velocity(other: str = "") -> Callable[[Present], Iterator[Bound]]:
    """Bounds of a speed in user units per second; other: object that is added to it in cyclic
    velocity mode."""

    def bounds(present: Present) -> Iterator[Bound]:
        most, mode = present("velocity_max", "modes_of_operation")
        if most is None:
            return
        added = (present(other)[0] or 0) if other and mode == "cyclic_velocity" else 0
        by = _object("velocity_max") + (f", beside {other} {added:g}" if added else "")
        yield Bound(-most - added, most - added, by, "ask for less, or raise it")

    return bounds


def _approach(present: Present) -> Iterator[Bound]:
    """Bounds of a speed in encoder counts per second."""
    (most,), ratio = present("velocity_max"), quantity.user_per_count(present.axis)
    if most is not None and ratio is not None:
        yield Bound(
            -math.inf, most / ratio, f"{_object('velocity_max')}, {most:g} of the axis' units/s",
            "ask for less, or raise it",
        )  # fmt: skip


def _code(beside: str = "", always: bool = False) -> Callable[[Present], Iterator[Bound]]:
    """Bounds of DAC codes. beside: code that the excitation mode adds; it counts in this mode only,
    unless `always`."""

    def bounds(present: Present) -> Iterator[Bound]:
        (limit,) = present("output_limit")
        most = min(limit, CODE_MOST)
        counts = always or beside in present.given
        if beside and not counts:
            counts = present("modes_of_operation")[0] == WAVE
        added = abs(present(beside)[0] or 0) if counts else 0
        by = _object("output_limit") if limit <= CODE_MOST else "the range of the DAC"
        by += f", beside {beside} {added:g}" if added else ""
        yield Bound(added - most, most - added, by, "ask for less, or raise output_limit")

    return bounds


# {target: its bounds}.
BOUNDS: dict[str, Callable[[Present], Iterator[Bound]]] = {
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
