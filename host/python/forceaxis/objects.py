"""The objects of the firmware for which the module _core was compiled, and the Modbus coils and
discrete inputs of the firmware."""

from dataclasses import dataclass
from typing import NamedTuple

from forceaxis import _core


class ObjectBit(NamedTuple):
    """One bit of an object whose value is a set of bits. `modes`: modes of operation in which the
    bit has this meaning; empty for all."""

    bit: int
    key: str
    text: str
    modes: tuple[int, ...]


class StatusState(NamedTuple):
    """A state of CiA 402: a statusword shows it if its bits in `mask` are `value`."""

    mask: int
    value: int
    text: str


class Refusal(NamedTuple):
    """A result of a refused access: its number in the firmware, its text for the user, and the SDO
    abort codes that report it."""

    error: int
    name: str
    text: str
    aborts: tuple[int, ...]


@dataclass(frozen=True)
class AxisObject:
    """One parameter, signal or command of the firmware. The engineering value is the raw value
    times `scale`."""

    number: int
    name: str
    kind: str
    part: str
    meaning: str
    type: str
    unit: str
    scale: float
    min: int
    max: int
    default: int
    access: str
    writable: str
    enum: tuple[str, ...]
    index: int  # CANopen index
    sub: int
    # first register: holding register for rw, input register for ro; -1 without a register
    modbus: int
    stored: bool  # True if the parameter store contains the object
    title: str  # name of the object in CANopen
    node_id: bool  # True for a COB-ID whose default value is a number plus the node id
    mappable: int  # 0: in no PDO, 1: in all PDOs that its access permits, 2: in TPDOs only
    quantity: str  # quantity of a count: "force" or "encoder"; "" if the unit defines the quantity
    # effect of a write while a cycle runs: "free" (none), "ends" (ends the cycle), "refused"
    in_cycle: str
    # names of special raw values, for an object that is not an enumeration
    values: tuple[tuple[int, str], ...]
    # a sentence for each named value, such as the cause of a fault; "" without a sentence
    sentences: tuple[str, ...]
    bits: tuple[ObjectBit, ...]  # bits of a value that is, or contains, a set of bits

    def bits_in(self, value: int, mode: int | None = None) -> list[ObjectBit]:
        """Returns the known bits that are 1 in a raw value, in a mode of operation."""
        return [
            bit for bit in self.bits
            if value >> bit.bit & 1 and (not bit.modes or mode in bit.modes)
        ]  # fmt: skip


class AxisBit(NamedTuple):
    """One coil or discrete input of the Modbus server."""

    address: int
    name: str
    meaning: str


OBJECTS_HASH = _core.OBJECTS_HASH
OBJECTS = tuple(
    AxisObject(**{**o, "bits": tuple(ObjectBit(*bit) for bit in o["bits"])})  # type: ignore[arg-type]
    for o in _core.objects()
)
BY_NAME = {o.name: o for o in OBJECTS}
COILS = tuple(AxisBit(**bit) for bit in _core.coils())
DISCRETES = tuple(AxisBit(**bit) for bit in _core.discretes())
# A valid statusword shows exactly one of these states.
STATUS_STATES = tuple(StatusState(*state) for state in _core.status_states())
REFUSALS = {refusal[1]: Refusal(*refusal) for refusal in _core.refusals()}


def certificate(bank_crc: int, adc_bits: int, force_scale: float) -> dict[str, int]:
    """Returns {object: raw value} of the certificate of a filter bank with the checksum `bank_crc`,
    for an ADC of `adc_bits` bits and a `force_scale` in uN.

    The caller appends the number of the bank to these names.
    """
    return _core.certificate(bank_crc, adc_bits, force_scale)


def mask(name: str, *keys: str) -> int:
    """Returns the bits of an object with these keys, such as mask("reset_cause", "pin"). Raises
    KeyError for an unknown key."""
    known = {bit.key: 1 << bit.bit for bit in BY_NAME[name].bits}
    return sum({known[key] for key in keys})


def sentence(fault: str) -> str | None:
    """Returns what a fault or an emergency message means, or None for another name."""
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
    """Returns the unit of an object as text for a user, with the quantity of its counts or codes. A
    force count is a count of an 8-bit ADC."""
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
    """Returns in which states of the axis an object can be written, as the end of a sentence about
    a refusal; "" if every state permits a write, or for another name."""
    known = BY_NAME.get(name)
    if known is not None and known.writable == "disabled":
        return "; it can be written only while the axis is disabled"
    if known is not None and known.in_cycle == "refused":
        return "; while a cycle runs it cannot be changed"
    return ""
