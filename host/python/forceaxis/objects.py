"""The firmware's objects as _core was compiled with them, and the bits of its Modbus map."""

from typing import NamedTuple

from forceaxis import _core


class AxisObject(NamedTuple):
    """One parameter, signal or command; engineering value = raw * scale."""

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
    index: int  # CANopen
    sub: int
    modbus: int  # first register, holding if rw, input if ro; -1: none
    stored: bool  # saved by the parameter store
    title: str  # CANopen's name
    node_id: bool  # a COB-ID to whose default the node id is added
    mappable: int  # 0: no PDO carries it, 1: any, as its access allows, 2: a TPDO alone
    quantity: str  # of what a count of the unit is a step: "force", "encoder"; "" where unit tells
    values: tuple[tuple[int, str], ...]  # names of single raw values of an object that is no enum


class AxisBit(NamedTuple):
    """A coil or a discrete input of Modbus."""

    address: int
    name: str
    meaning: str


OBJECTS_HASH = _core.OBJECTS_HASH
OBJECTS = tuple(AxisObject(**o) for o in _core.objects())
BY_NAME = {o.name: o for o in OBJECTS}
COILS = tuple(AxisBit(**bit) for bit in _core.coils())
DISCRETES = tuple(AxisBit(**bit) for bit in _core.discretes())


def certificate(bank_crc: int, adc_bits: int, force_scale: float) -> dict[str, int]:
    """{object: raw value} of the certificate of a bank with this CRC, made for an ADC of so many
    bits and a force_scale in uN; an object's name goes on with _ and the bank's number."""
    return _core.certificate(bank_crc, adc_bits, force_scale)


def default(name: str) -> float:
    """Engineering value of an object as it is delivered."""
    known = BY_NAME[name]
    return known.default * known.scale


def unit_in_words(known: AxisObject) -> str:
    """The unit of an object for a reader: of what its counts and codes are. A count of force is one
    of an 8-bit ADC."""
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
