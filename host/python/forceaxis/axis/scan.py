"""Searches for the axes that are connected to a bus. Each function returns one ScannedAxis for each
axis that it has found."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from forceaxis.axis import actions
from forceaxis.axis.address import (
    Address,
    CanAddress,
    LcmAddress,
    SerialAddress,
    TcpAddress,
)
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import DEVICE_NAME_INDEX, VERSION_INDEX, Link, NoAnswer, Refused
from forceaxis.bus.state_names import node_state

if TYPE_CHECKING:
    import can

NMT_STOPPED, NMT_SILENT = 4, -1  # NMT states of a node
HEARTBEAT_ID = 0x700
# Texts for the user about a node that does not answer requests.
STOPPED_STATE = "stopped by NMT"
NODE_STOPPED = "start the node {address} with `axis.start()`; this enables no drive"
GATEWAY_STARTS = "the gateway starts the node by itself; this enables no drive"
GATEWAY_HEARS_NOTHING = "no message from the node; check power and bus of the axis"
NODE_ANSWERS_S = 0.5  # time in s in which the nodes of a CAN bus must answer
UNIT_TIMEOUT_S = 0.15  # time in s in which one Modbus unit must answer


@dataclass(frozen=True)
class ScannedAxis:
    """One axis that was found on a bus. A field is None if its value could not be read from the
    axis; `note` then states the reason. `table` is the hash of the object table as 8 hexadecimal
    digits. `owner` is the name of the command source that owns the axis."""

    id: int | None
    name: str | None = None
    version: str | None = None
    table: str | None = None
    state: str | None = None
    mode: str | None = None
    fault: str | None = None
    owner: str | None = None
    note: str | None = None


def scanned(link: Link, number: int | None = None) -> ScannedAxis:
    """Reads the data of one axis over its connection, and then closes the connection. `number` is
    the number of the axis on the bus, by default its node id."""
    axis, found = Axis(link), ScannedAxis(number)
    try:
        if number is None:
            found = replace(found, id=axis.integer("node_id"))
        found = replace(found, table=f"{axis.integer('object_table_hash'):08x}")
        now = actions.state(axis)
        found = replace(
            found, state=now.state, mode=now.mode, fault=now.fault, owner=now.command_source
        )
        return replace(found, name=link.text(DEVICE_NAME_INDEX), version=link.text(VERSION_INDEX))
    except (Refused, NoAnswer) as error:
        return replace(found, note=str(error))
    finally:
        axis.close()


def on_bus(address: Address) -> Iterator[ScannedAxis]:
    """Yields each axis of the bus at an address. Raises InputError, NoAnswer."""
    from forceaxis.axis.modbus import BAUD_RATE

    if isinstance(address, CanAddress):
        yield from on_can(address.interface)
    elif isinstance(address, TcpAddress):
        yield from on_modbus(address.url)
    elif isinstance(address, SerialAddress):
        yield from on_modbus(address.device, address.bit_rate or BAUD_RATE)
    elif isinstance(address, LcmAddress):
        yield from at_gateway(address.url)
    else:
        yield scanned(address.link())


def at_gateway(url: str | None = None, seconds: float = 1.0) -> Iterator[ScannedAxis]:
    """Yields each axis of the gateway of an LCM bus. An axis is found if the gateway publishes its
    state within `seconds`."""
    from forceaxis.axis.gateway import GatewayLink
    from forceaxis.bus.monitor_state import Watch
    from forceaxis.bus.sources import LiveSource

    watch = Watch()
    source = LiveSource(watch, url, None)
    try:
        time.sleep(seconds)
        states = {n: a.state.nmt_state for n, a in watch.axes.items() if a.state is not None}
    finally:
        source.close()
    for number, state in sorted(states.items()):
        if state == NMT_STOPPED:
            yield ScannedAxis(number, state=STOPPED_STATE, note=GATEWAY_STARTS)
        elif state == NMT_SILENT:
            yield ScannedAxis(number, state=node_state(state), note=GATEWAY_HEARS_NOTHING)
        else:
            yield scanned(GatewayLink(number, url), number)


def on_can(
    interface: str, bus: "can.BusABC | None" = None, seconds: float = NODE_ANSWERS_S
) -> Iterator[ScannedAxis]:
    """Yields each CANopen node, with a number from 1 to 127, on a CAN bus. A node is found if it
    answers a request to read object 1000h, or sends any CANopen message, within `seconds`."""
    from forceaxis.axis.can import CanLink, network

    stopped: set[int] = set()

    def beat(can_id: int, data: bytearray, _timestamp: float) -> None:
        if data and data[0] & 0x7F == NMT_STOPPED:
            stopped.add(can_id - HEARTBEAT_ID)

    with network(interface, bus) as opened:
        for number in range(1, 128):
            opened.subscribe(HEARTBEAT_ID + number, beat)
        opened.scanner.search()
        time.sleep(seconds)
        numbers = sorted(set(opened.scanner.nodes) | stopped)
    for number in numbers:
        if number in stopped:
            note = NODE_STOPPED.format(address=f"{interface}:{number}")
            yield ScannedAxis(number, state=STOPPED_STATE, note=note)
            continue
        found = scanned(CanLink(interface, number, number % 127 + 1, bus, timeout_s=0.3), number)
        if found.table is None:
            note = "heard, but it has none of these objects: a master, or a gateway"
            found = replace(found, note=note)
        yield found


def on_modbus(url: str, bit_rate: int | None = None) -> Iterator[ScannedAxis]:
    """Yields each Modbus unit, with a number from 1 to 127, that answers a request. `url`: URL of
    a Modbus TCP server, or path of a serial device. `bit_rate`: bit rate of the serial device in
    bit/s, or None."""
    from forceaxis.axis.modbus import ModbusLink, client

    answering = client(url, UNIT_TIMEOUT_S, bit_rate)
    try:
        from pymodbus.exceptions import ModbusException

        numbers = []
        for unit in range(1, 128):
            try:
                answer = answering.read_input_registers(0, count=1, device_id=unit)
            except ModbusException:
                answering.connect()
                continue
            if not answer.isError() or answer.exception_code not in (10, 11):
                numbers.append(unit)
    finally:
        answering.close()
    for unit in numbers:
        yield scanned(ModbusLink(url, unit, bit_rate=bit_rate), unit)
