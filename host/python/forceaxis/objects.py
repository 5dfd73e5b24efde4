"""The objects, Modbus coils and discrete inputs of the firmware for which the module _core was
compiled."""

from forceaxis import _core
from forceaxis._results import AxisBit as AxisBit
from forceaxis._results import AxisObject as AxisObject
from forceaxis._results import ObjectBit

OBJECTS_HASH = _core.OBJECTS_HASH
OBJECTS = tuple(_core.objects())
BY_NAME = {o.name: o for o in OBJECTS}
COILS = tuple(_core.coils())
DISCRETES = tuple(_core.discretes())
# Names of the drive states of CiA 402. A valid statusword shows exactly one of them.
STATUS_STATES = tuple(_core.status_states())
REFUSALS = {refusal.name: refusal for refusal in _core.refusals()}


def bits_in(name: str, value: int, mode: int | None = None) -> list[ObjectBit]:
    """Returns the descriptions of the bits that are 1 in a raw value of an object. Bits without a
    known meaning in the mode of operation are left out."""
    return [
        bit for bit in BY_NAME[name].bits
        if value >> bit.bit & 1 and (not bit.modes or mode in bit.modes)
    ]  # fmt: skip


def mask(name: str, *keys: str) -> int:
    """Returns a mask in which the named bits of an object are 1. For example, mask("reset_cause",
    "pin") has the bit `pin` of the object `reset_cause`. Raises KeyError for an unknown name of a
    bit."""
    known = {bit.key: 1 << bit.bit for bit in BY_NAME[name].bits}
    return sum({known[key] for key in keys})


def sentence(fault: str) -> str | None:
    """Returns a sentence that explains a fault or an emergency message. Returns None for an unknown
    name."""
    codes = BY_NAME["error_code"]
    for (_, text), meaning in zip(codes.values, codes.sentences, strict=True):
        if text == fault:
            return meaning or None
    return None


def default(name: str) -> float:
    """Returns the default value of an object as an engineering value."""
    known = BY_NAME[name]
    return known.default * known.scale


def unit_in_words(known: AxisObject) -> str:
    """Returns the unit of an object as text for a user, for example "encoder counts" instead of
    "count". A force count is a count of an 8-bit ADC."""
    unit = "" if known.unit == "1" else known.unit
    of_force = known.quantity == "force"
    force, encoder = "count of force", "encoder count"
    words = {
        "count": force if of_force else encoder,
        "code": "DAC code",
        "code/count": f"DAC code/{force if of_force else encoder}",
        "code tick/count": f"DAC code tick/{encoder}",
        "count/count": f"{force}/{encoder}",
        "count tick/count": f"{force} tick/{encoder}",
    }
    return words.get(unit, f"encoder {unit}" if unit.startswith("count/") else unit)


def state_needed(name: str) -> str:
    """Returns the states of the axis in which an object can be written, as text for the end of an
    error message. Returns "" if it can be written in every state, and for an unknown object."""
    known = BY_NAME.get(name)
    if known is not None and known.writable == "disabled":
        return "; it can be written only while the axis is disabled"
    if known is not None and known.in_cycle == "refused":
        return "; while a cycle runs it cannot be changed"
    return ""
