"""The address of an axis: a text that names the bus and the axis on this bus.

    can0:5                          CANopen node 5 on the CAN interface can0
    tcp://192.168.1.5/3             Modbus TCP: unit 3 at this host; with a port: tcp://HOST:PORT/3
    serial:/dev/ttyUSB0:3           Modbus RTU: unit 3; with a bit rate: serial:/dev/ttyUSB0@19200:3
    lcm:2                           axis 2 of a gateway; with the URL of an LCM bus: lcm:2@URL
    sim:contact                     simulated axis of the experiment `contact` (a name or a path);
                                    sim:contact@FILE stores its parameters in FILE,
                                    and begins with those that FILE has

An address without the number of an axis names a bus. A command for one axis then uses number 1 on
CAN and Modbus. With `can0:5@125`, this program has the node id 125 on the bus, for example because
another program already has the default node id.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Container
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypeAlias, TypedDict

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.bus import OWN_NODE

if TYPE_CHECKING:
    from forceaxis.axis.link import Link

NUMBERS = range(1, 128)  # valid numbers of CANopen nodes, Modbus units and axes
DEFAULT_NUMBER = 1
PORTS = range(1, 65536)
BIT_RATES = range(300, 4_000_001)  # bit rates of a serial line in bit/s
INTERFACE_LENGTH = 15  # longest name of a network interface in Linux

CAN = re.compile(r"([A-Za-z][\w.-]*)(?::(?!//)([^@]*))?(?:@(.*))?", re.ASCII)
TCP = re.compile(r"tcp://(\[[\w:.%]+\]|[^:/@?#\[\]\s]+)(?::([^/]*))?(?:/(.*))?")
SERIAL = re.compile(r"serial:(/[^@]+?)(?:@([^:]*))?(?::([^:./]*))?")
LCM = re.compile(r"lcm(?::([^@]*))?(?:@(.+))?")
SIM = re.compile(r"sim:(.+?\.toml|[^@/]+)(?:@(.+))?")
NAMED_SIM = re.compile(r"sim:([^@/]+)@(.+)")
# Pattern of texts such as lcm or tcp0, which are not the name of a CAN interface.
NOT_CAN = re.compile(
    r"((lcm|tcp|serial|sim)(\d*))(?:[:@].*)?", re.ASCII | re.IGNORECASE | re.DOTALL
)
NETWORK_INTERFACES = Path("/sys/class/net")
# Form of an address of each kind, for error messages.
FORMS = {
    "tcp": "tcp://HOST/UNIT or tcp://HOST:PORT/UNIT, such as tcp://192.168.1.5/3",
    "serial": "serial:DEVICE:UNIT or serial:DEVICE@BITRATE:UNIT, such as serial:/dev/ttyUSB0:3",
    "lcm": "lcm:AXIS or lcm:AXIS@URL, such as lcm:2",
    "sim": "sim:EXPERIMENT, a name or a path ending in .toml, such as sim:press/contact.toml",
}


@dataclass(frozen=True)
class CanAddress:
    """Address of a node on a CAN interface. `own_node`: node id of this program, by default
    OWN_NODE."""

    kind: ClassVar[str] = "can"
    example: ClassVar[str] = "can0:5"
    interface: str
    number: int | None = None
    own_node: int | None = None

    def __str__(self) -> str:
        return f"{self.interface}{_part(':', self.number)}{_part('@', self.own_node)}"

    def link(self, timeout_s: float | None = None) -> Link:
        """Connects to the axis, and returns the open connection. `timeout_s`: longest time in s to
        wait for an answer; None: the default time of this kind of connection. Raises InputError. A
        Modbus connection may also raise NoAnswer."""
        from forceaxis.axis.can import CanLink

        node = self.number or DEFAULT_NUMBER
        return CanLink(self.interface, node, self.own_node or OWN_NODE, **_within(timeout_s))


@dataclass(frozen=True)
class TcpAddress:
    """Address of a Modbus unit at a Modbus TCP server, such as the server of a gateway."""

    kind: ClassVar[str] = "tcp"
    example: ClassVar[str] = "tcp://192.168.1.5/3"
    host: str
    port: int | None = None
    number: int | None = None

    def __str__(self) -> str:
        return f"{self.url}{_part('/', self.number)}"

    @property
    def url(self) -> str:
        return f"tcp://{self.host}{_part(':', self.port)}"

    def link(self, timeout_s: float | None = None) -> Link:
        from forceaxis.axis.modbus import ModbusLink

        return ModbusLink(self.url, self.number or DEFAULT_NUMBER, **_within(timeout_s))


@dataclass(frozen=True)
class SerialAddress:
    """Address of a Modbus unit on a serial line. `bit_rate`: bit rate in bit/s, by default the
    default bit rate of the firmware."""

    kind: ClassVar[str] = "serial"
    example: ClassVar[str] = "serial:/dev/ttyUSB0:3"
    device: str
    bit_rate: int | None = None
    number: int | None = None

    def __str__(self) -> str:
        return f"serial:{self.device}{_part('@', self.bit_rate)}{_part(':', self.number)}"

    def link(self, timeout_s: float | None = None) -> Link:
        from forceaxis.axis.modbus import ModbusLink

        unit = self.number or DEFAULT_NUMBER
        return ModbusLink(self.device, unit, bit_rate=bit_rate(self), **_within(timeout_s))


@dataclass(frozen=True)
class LcmAddress:
    """Address of an axis at the gateway of an LCM bus. `url`: URL of the LCM bus, by default the
    value of the environment variable LCM_DEFAULT_URL, or the default URL of liblcm."""

    kind: ClassVar[str] = "lcm"
    example: ClassVar[str] = "lcm:2"
    number: int | None = None
    url: str | None = None

    def __str__(self) -> str:
        return f"lcm{_part(':', self.number)}{_part('@', self.url)}"

    def link(self, timeout_s: float | None = None) -> Link:
        from forceaxis.axis.gateway import GatewayLink

        if self.number is None:
            raise InputError(
                f"{self}: expected an address with the number of an axis, such as {self.example}"
            )
        return GatewayLink(self.number, self.url, **_within(timeout_s))


@dataclass(frozen=True)
class SimAddress:
    """Address of the simulated axis of an experiment, which is given by its path or name. `store`:
    file of the parameter store of the axis. `overrides`: as in Axis.sim()."""

    kind: ClassVar[str] = "sim"
    example: ClassVar[str] = "sim:contact"
    number: ClassVar[None] = None
    experiment: str
    store: str = ""
    overrides: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"sim:{self.experiment}{_part('@', self.store)}"

    def link(self, timeout_s: float | None = None) -> Link:
        """Connects to the axis. `timeout_s` has no meaning here, because a simulated axis answers
        at once."""
        from forceaxis.axis.sim import SimLink

        path = Path(self.experiment)
        if path.suffix != ".toml":
            path = paths.EXPERIMENTS / f"{path.name}.toml"
        link = SimLink(path, self.overrides, self.store)
        # messages name the experiment as the user wrote it
        link.where = f"the simulated axis of {self.experiment}"
        return link


Address: TypeAlias = CanAddress | TcpAddress | SerialAddress | LcmAddress | SimAddress
# For each kind of address, an example for error messages.
EXAMPLES = {
    one.kind: one.example for one in (CanAddress, TcpAddress, SerialAddress, LcmAddress, SimAddress)
}


def _part(separator: str, value: str | int | None) -> str:
    return f"{separator}{value}" if value else ""


def examples(kinds: Container[str] = EXAMPLES) -> str:
    """Returns a text with an example of each kind of address, such as "can0:5, lcm:2 or
    sim:contact"."""
    shown = [example for kind, example in EXAMPLES.items() if kind in kinds]
    return " or ".join(filter(None, (", ".join(shown[:-1]), shown[-1])))


def parse(text: str) -> Address:
    """Returns the address that `text` names. Does not connect to the axis. Raises InputError."""
    for start, read in READERS.items():
        if text.startswith(start):
            return read(text)
    if text == "lcm" or text.startswith("lcm@"):
        return _lcm(text)
    return _can(text)


class _Within(TypedDict, total=False):
    timeout_s: float


def _within(timeout_s: float | None) -> _Within:
    return {} if timeout_s is None else {"timeout_s": timeout_s}


def bus(address: Address) -> Address:
    """Returns the address of the bus to which an axis is connected."""
    return address if isinstance(address, SimAddress) else replace(address, number=None)


def shared(address: Address) -> tuple[object, ...]:
    """Returns a key that is equal for addresses that use the same serial device, the same Modbus
    TCP server or the same SDO channel of a CAN node. A program should have only one connection at a
    time for each key. For other addresses, the key is the address itself."""
    if isinstance(address, SerialAddress):
        return "serial", os.path.realpath(address.device)
    if isinstance(address, TcpAddress):
        from forceaxis.axis.modbus import PORT

        return "tcp", address.host.lower(), address.port or PORT
    if isinstance(address, CanAddress):
        return "can", address.interface, address.number or DEFAULT_NUMBER
    return (address,)


def bit_rate(address: SerialAddress) -> int:
    """Returns the bit rate of a serial line in bit/s, by default the bit rate of the firmware."""
    from forceaxis.axis.modbus import BAUD_RATE

    return address.bit_rate or BAUD_RATE


def numbered(address: Address) -> Address:
    """Returns the address with the number of the axis. On CAN and Modbus, the default number is
    added if the address has no number."""
    if isinstance(address, CanAddress | TcpAddress | SerialAddress):
        return replace(address, number=address.number or DEFAULT_NUMBER)
    return address


def _can(text: str) -> CanAddress:
    if text.startswith("/dev/"):
        raise _wrong(text, "serial: before a serial device, such as serial:/dev/ttyUSB0:3")
    if text.endswith(".toml"):
        raise _wrong(text, f"sim: before an experiment, such as sim:{text}")
    if text.isdigit():
        raise _wrong(
            text, f"a bus before the number of the axis, such as can0:{text} or lcm:{text}"
        )
    other = NOT_CAN.fullmatch(text)
    if other and not (other[3] and (NETWORK_INTERFACES / other[1]).exists()):
        raise _wrong(text, FORMS[other[2].lower()])
    found = CAN.fullmatch(text)
    if found is None or len(found[1]) > INTERFACE_LENGTH:
        raise _wrong(text, f"the address of an axis, such as {examples()}")
    node = _integer(text, found[2], NUMBERS, "a node id", "after the colon", "can0:5")
    own = _integer(
        text, found[3], NUMBERS, "a node id of this program", "after the @", "can0:5@125"
    )
    if (node or DEFAULT_NUMBER) == (own or OWN_NODE):
        number = node or DEFAULT_NUMBER
        free = OWN_NODE if number != OWN_NODE else OWN_NODE - 1
        raise _wrong(
            text,
            f"two different node ids, got {number} for the axis and for this program; give this "
            f"program another one after the @, such as {found[1]}:{number}@{free}",
        )
    return CanAddress(found[1], node, own)


def _tcp(text: str) -> TcpAddress:
    found = TCP.fullmatch(text)
    if found is None:
        raise _wrong(text, FORMS["tcp"])
    return TcpAddress(
        found[1],
        _integer(text, found[2], PORTS, "a port", "after the colon", "tcp://192.168.1.5:1502/3"),
        _integer(text, found[3] or None, NUMBERS, "a unit", "after the /", TcpAddress.example),
    )


def _serial(text: str) -> SerialAddress:
    found = SERIAL.fullmatch(text)
    if found is None:
        raise _wrong(text, FORMS["serial"])
    example = "serial:/dev/ttyUSB0@19200:3"
    return SerialAddress(
        found[1],
        _integer(text, found[2], BIT_RATES, "a bit rate", "after the @", example),
        _integer(text, found[3], NUMBERS, "a unit", "after the last colon", example),
    )


def _lcm(text: str) -> LcmAddress:
    found = LCM.fullmatch(text)
    if found is None:
        raise _wrong(text, FORMS["lcm"])
    number = _integer(text, found[1], NUMBERS, "an axis number", "after the colon", "lcm:2")
    return LcmAddress(number, found[2])


def _sim(text: str) -> SimAddress:
    found = SIM.fullmatch(text)
    if found is None:
        raise _wrong(text, FORMS["sim"])
    # The name of a store file may end in .toml. A folder with experiments may have @ in its name.
    named = NAMED_SIM.fullmatch(text)
    if named and ("/" not in named[2] or (paths.EXPERIMENTS / f"{named[1]}.toml").is_file()):
        found = named
    return SimAddress(found[1], found[2] or "")


READERS: dict[str, Callable[[str], Address]] = {
    "tcp:": _tcp, "serial:": _serial, "lcm:": _lcm, "sim:": _sim
}  # fmt: skip


def _wrong(text: str, expected: str) -> InputError:
    return InputError(f"{text or 'an empty address'}: expected {expected}")


def _integer(
    text: str, digits: str | None, known: range, what: str, where: str, example: str
) -> int | None:
    """Converts the digits of one number in an address to an integer. `digits` is None if the
    address does not contain this number. The result is then also None. Raises InputError if the
    number is outside the range `known`."""
    if digits is None:
        return None
    if not (digits.isascii() and digits.isdecimal() and len(digits) < 9 and int(digits) in known):
        raise _wrong(text, f"{what} from {known[0]} to {known[-1]} {where}, such as {example}")
    return int(digits)
