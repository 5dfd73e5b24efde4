"""Access to an axis over Modbus. The axis is reached over Modbus RTU or over the Modbus TCP server
of a gateway. The object table defines the registers."""

import contextlib
import logging
import re
import struct
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, NoReturn

from forceaxis.axis.link import (
    COMMAND_SOURCES,
    DEVICE_NAME_INDEX,
    HARDWARE_INDEX,
    VERSION_INDEX,
    Link,
    NoAnswer,
    Refused,
)
from forceaxis.bus.keeper import WatchdogKeeper
from forceaxis.errors import ParameterError
from forceaxis.objects import BY_NAME, REFUSALS, AxisObject, mask, state_needed

if TYPE_CHECKING:
    from pymodbus.client.base import ModbusBaseSyncClient
    from pymodbus.pdu import ModbusPDU

TCP_URL = re.compile(r"tcp://([^:/]+|\[[^]]+\])(?::([0-9]{1,5}))?/?")
SERIAL_URL = re.compile(r"(/.+?)(?::([0-9]{3,7}))?")  # a path may contain colons
PORT = 502  # port of a Modbus server on TCP
BAUD_RATE = 115_200  # baud rate, the default of the firmware, for 8 data bits and even parity
PARITIES = "EN"
# size in bytes of the objects cycle_data_1 to cycle_data_16, and of the head of an update
PART_BYTES = 64
FLASH_BUSY = mask("program_flash_status", "busy")
# Number of attempts to send a request whose answer is lost. The axis ignores repeated bytes.
PART_TRIES = 3
MOST_REGISTERS = 125  # largest number of registers in one Modbus request
# {CANopen index of a text: number of the same text in Modbus function 43 / 14}
IDENTIFICATION_OBJECTS = {DEVICE_NAME_INDEX: 4, HARDWARE_INDEX: 5, VERSION_INDEX: 2}
NOT_NOW = 4  # Modbus exception code "server device failure"
TARGET_NO_ANSWER = 11  # Modbus exception code "gateway target device failed to respond"
EXCEPTIONS = {
    2: "there is no such register",
    3: REFUSALS["range"].text,
    4: "not in this state of the axis, or another source owns it",
    6: REFUSALS["busy"].text,
    10: "the gateway has no axis of this unit",
    TARGET_NO_ANSWER: "the axis does not answer its gateway",
}


def client(url: str, timeout_s: float = 1.0, bit_rate: int | None = None) -> "ModbusBaseSyncClient":
    """Returns a connected client of the library pymodbus. `bit_rate`: bit rate of a serial line in
    bit/s, or None. If it is given, `url` is the path of the serial device. Raises InputError,
    NoAnswer."""
    tcp, serial = TCP_URL.fullmatch(url), SERIAL_URL.fullmatch(url)
    if tcp is None and serial is None:
        raise ParameterError(
            "modbus",
            f"{url}: expected tcp://HOST[:PORT], or a serial device such as /dev/ttyUSB0[:BAUD]",
        )
    try:
        from pymodbus.client import ModbusSerialClient, ModbusTcpClient
    except ImportError:
        raise ParameterError(
            "modbus",
            "expected the package pymodbus; install pymodbus with `pip install "
            "'forceaxis[modbus]'`",
        ) from None
    logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL + 1)
    made: list[ModbusBaseSyncClient] = []
    if tcp is not None:
        port = int(tcp[2] or PORT)
        made = [ModbusTcpClient(tcp[1].strip("[]"), port=port, timeout=timeout_s, retries=0)]
    elif serial is not None:
        device, baud = (url, bit_rate) if bit_rate else (serial[1], int(serial[2] or BAUD_RATE))
        # A pseudo-terminal cannot be opened with parity.
        # Therefore a client with parity is tried first, and then a client without parity.
        made = [
            ModbusSerialClient(device, baudrate=baud, parity=p, timeout=timeout_s, retries=0)
            for p in PARITIES
        ]
    for one in made:
        try:
            if one.connect():
                return one
        except (OSError, ValueError) as error:
            raise ParameterError(
                "modbus", f"{url}: expected a connection that can be opened, got: {error}"
            ) from None
    what = "a Modbus server here, none answered" if tcp else "a serial device that can be opened"
    raise NoAnswer(f"{url}: expected {what}")


def _width(known: AxisObject) -> int:
    """Returns the number of registers of an object."""
    return 2 if known.type.endswith("32") else 1


def _adjacent(names: Iterable[str]) -> Iterator[list[str]]:
    """Splits names of objects, in their order, into lists. One request can read all objects of a
    list, because their registers are adjacent."""
    adjacent: list[str] = []
    registers = 0
    for name in names:
        known = BY_NAME[name]
        last = BY_NAME[adjacent[-1]] if adjacent else None
        follows = (
            last is not None
            and (last.access == "rw") == (known.access == "rw")
            and last.modbus + _width(last) == known.modbus
            and registers + _width(known) <= MOST_REGISTERS
        )
        if not follows and adjacent:
            yield adjacent
            adjacent, registers = [], 0
        adjacent.append(name)
        registers += _width(known)
    if adjacent:
        yield adjacent


class ModbusLink(Link):
    """Connection to a Modbus unit at "tcp://HOST[:PORT]" or "/dev/ttyX[:BAUD]". `bit_rate`: bit
    rate in bit/s, or None; if it is given, `url` is the path of a serial device. The connection
    refuses recordings and objects without a register, without sending a request. While it owns the
    axis, a thread repeatedly writes the watchdog. Raises InputError, NoAnswer."""

    source = COMMAND_SOURCES.index("modbus")

    def __init__(
        self, url: str, unit: int = 1, timeout_s: float = 1.0, bit_rate: int | None = None
    ) -> None:
        self.client = client(url, timeout_s, bit_rate)
        self.where = f"unit {unit} at {url}"
        self._unit, self._lock = unit, threading.Lock()
        self._low_first: bool | None = None

    def _ask(self, what: str, ask: "Callable[[], ModbusPDU]") -> "ModbusPDU":
        """Sends a request by calling ask(), and returns the answer. Raises Refused, NoAnswer."""
        from pymodbus.exceptions import ModbusException

        try:
            with self._lock:
                answer = ask()
        except (ModbusException, OSError) as error:
            raise NoAnswer(f"{self.where}: expected an answer about {what}, {error}") from None
        if answer.isError():
            code = answer.exception_code
            if code == TARGET_NO_ANSWER:
                raise NoAnswer(f"{self.where}: {what}: {EXCEPTIONS[code]}")
            text = EXCEPTIONS.get(code, f"Modbus exception {code}")
            raise Refused(f"{what}: {text}{state_needed(what) if code == NOT_NOW else ''}")
        return answer

    def _ask_again(self, what: str, ask: "Callable[[], ModbusPDU]") -> None:
        """Sends a request by calling ask(). If the answer is lost, sends the request again, up to
        PART_TRIES times in total. Raises Refused, NoAnswer."""
        for _ in range(PART_TRIES - 1):
            with contextlib.suppress(NoAnswer):
                self._ask(what, ask)
                return
        self._ask(what, ask)

    def reaches(self, name: str) -> bool:
        return BY_NAME[name].modbus >= 0

    def text(self, index: int) -> str | None:
        """Returns one text of the device identification. Modbus function 43 / 14 reads this
        text."""
        if index not in IDENTIFICATION_OBJECTS:
            return None
        from pymodbus.pdu.mei_message import ReadDeviceInformationResponse

        number = IDENTIFICATION_OBJECTS[index]
        ask = self.client.read_device_information
        try:
            found = self._ask(
                "its identification",
                lambda: ask(read_code=4, object_id=number, device_id=self._unit),
            )
        except Refused:
            return None
        if not isinstance(found, ReadDeviceInformationResponse):
            return None
        return str(found.information.get(number, b""), errors="replace") or None

    def _expect_registers(self, names: Iterable[str]) -> None:
        for name in names:
            if not self.reaches(name):
                raise Refused(
                    f"{name}: this object has no Modbus register; connect over CAN or through a "
                    "gateway"
                )

    def _read(self, name: str) -> int:
        return self._read_adjacent([name])[name]

    def _read_adjacent(self, names: Sequence[str]) -> dict[str, int]:
        """Reads objects with adjacent registers by one request, and returns their raw values."""
        known = [BY_NAME[name] for name in names]
        count = sum(map(_width, known))
        client = self.client
        holding = known[0].access == "rw"
        ask = client.read_holding_registers if holding else client.read_input_registers
        what = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
        answer = self._ask(what, lambda: ask(known[0].modbus, count=count, device_id=self._unit))
        if len(answer.registers) != count:
            raise NoAnswer(
                f"{self.where}: expected {count} registers about {what}, got "
                f"{len(answer.registers)}; another device answers with this unit, or a gateway "
                "between is at fault"
            )
        found, at = {}, 0
        for one in known:
            words = answer.registers[at : at + _width(one)]
            at += len(words)
            if len(words) == 2 and self._word_order():
                words = words[::-1]
            raw = int.from_bytes(b"".join(word.to_bytes(2, "big") for word in words), "big")
            bits = 16 * len(words)
            is_negative = one.type[0] == "i" and raw >> (bits - 1)
            found[one.name] = raw - (1 << bits) if is_negative else raw
        return found

    def _write(self, name: str, raw: int) -> None:
        known = BY_NAME[name]
        if not known.type.endswith("32"):
            write, word = self.client.write_register, raw & 0xFFFF
            self._ask(name, lambda: write(known.modbus, word, device_id=self._unit))
            return
        words = [raw >> 16 & 0xFFFF, raw & 0xFFFF]
        if self._word_order():
            words.reverse()
        write_both = self.client.write_registers
        self._ask(name, lambda: write_both(known.modbus, words, device_id=self._unit))

    def _word_order(self) -> bool:
        """Returns True if the first register of a 32-bit value contains its lower half."""
        if self._low_first is None:
            self._low_first = bool(self._read("modbus_word_order"))
        return self._low_first

    def read(self, names: Iterable[str]) -> dict[str, int]:
        names = list(names)
        self._expect_registers(names)
        found: dict[str, int] = {}
        for adjacent in _adjacent(names):
            found |= self._read_adjacent(adjacent)
        return found

    def write(self, values: Mapping[str, int]) -> None:
        self._expect_registers(values)
        with self.unfed(values):
            for name, raw in values.items():
                self._write(name, raw)
                if name == "modbus_word_order":
                    self._low_first = bool(raw)

    def download_update(self, data: bytes, written: Callable[[int], None]) -> None:
        """Writes an update of the firmware in pieces. Each request writes one piece to the objects
        cycle_data, and its offset to cycle_data_offset. The axis erases its memory for the new
        image during the first request, which contains the head of the update."""
        first = BY_NAME["cycle_data_offset"].modbus
        write = self.client.write_registers
        for at in range(0, len(data), PART_BYTES):
            registers = [at & 0xFFFF]
            for low, high in struct.iter_unpack("<HH", data[at : at + PART_BYTES]):
                registers += [low, high] if self._word_order() else [high, low]
            self._ask_again("the update", partial(write, first, registers, device_id=self._unit))
            if at == 0 and not self._read("program_flash_status") & FLASH_BUSY:
                raise Refused("the update was refused")
            written(at)

    def acquire(self) -> None:
        self._write("command_source", self.source)
        self._keeper = WatchdogKeeper(
            lambda: self._read("watchdog"), lambda value: self._write("watchdog", value)
        )

    def release(self) -> None:
        self._end_keeper()
        self._write("command_source", 0)

    def arm(self, signals: Sequence[str], settings: Mapping[str, int]) -> NoReturn:
        raise Refused(
            f"{self.where}: a recording cannot be read over Modbus; connect over CAN or through a "
            "gateway"
        )

    def fetch(self, signals: Sequence[str]) -> NoReturn:
        self.arm(signals, {})

    def recording(self, timeout_s: float) -> NoReturn:
        self.arm((), {})

    def close(self) -> None:
        self._end_keeper()
        self.client.close()
