"""Who is on a bus: one row for each axis found, {name: value}, None where it is not known."""

import time

from forceaxis._core import InputError
from forceaxis.axis import actions
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NAME, SOFTWARE, NoAnswer, Refused

COLUMNS = ("id", "name", "version", "table", "state", "mode", "fault", "owner", "note")
SCAN_S = 0.5
UNIT_S = 0.15  # what a unit of Modbus may take


def row(link, number=None):
    """The row of the axis of a link, which is closed; what it does not answer is in `note`. number:
    of the axis on its bus, by default its node id."""
    axis, found = Axis(link), {"id": number}
    try:
        found["id"] = axis.read("node_id") if number is None else number
        found["table"] = f"{axis.read('object_table_hash'):08x}"
        now = actions.state(axis)
        found |= {key: now[key] for key in ("state", "mode", "fault")}
        found["owner"] = now["command_source"]
        found["name"], found["version"] = link.text(NAME), link.text(SOFTWARE)
    except (Refused, NoAnswer) as error:
        found["note"] = str(error)
    finally:
        axis.close()
    return {key: found.get(key) for key in COLUMNS}


def at_gateway(url=None, seconds=1.0):
    """Every axis whose gateway publishes states within so many seconds."""
    from forceaxis.axis.gateway import GatewayLink
    from forceaxis.bus.monitor_state import Watch
    from forceaxis.bus.sources import Live

    watch = Watch()
    source = Live(watch, url, None)
    try:
        time.sleep(seconds)
        numbers = sorted(n for n, a in watch.axes.items() if a.state is not None)
    finally:
        source.close()
    for number in numbers:
        yield row(GatewayLink(number, url), number)


def on_can(interface, bus=None, seconds=SCAN_S):
    """Every node 1 to 127 that answers a read of 1000h, or is heard meanwhile."""
    from forceaxis.axis.can import CanLink, network

    with network(interface, bus) as found:
        found.scanner.search()
        time.sleep(seconds)
        numbers = sorted(set(found.scanner.nodes))
    for number in numbers:
        found = row(CanLink(interface, number, number % 127 + 1, bus, timeout_s=0.3), number)
        if found["table"] is None:
            found["note"] = "heard, but it has none of these objects: a master, or a gateway"
        yield found


def on_modbus(url):
    """Every unit 1 to 127 that answers."""
    from forceaxis.axis.modbus import ModbusLink, client

    answering = client(url, UNIT_S)
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
        yield row(ModbusLink(url, unit), unit)


def found(way):
    """The rows of one bus. Raises InputError where it names more than one."""
    given = [w for w in (way.can, way.modbus, way.sim) if w is not None]
    if len(given) > 1 or way.axis is not None:
        raise InputError("expected one bus: --lcm-url URL, --can, --modbus or --sim")
    if way.can is not None:
        return list(on_can(way.can))
    if way.modbus is not None:
        return list(on_modbus(way.modbus))
    if way.sim is not None:
        return [row(way.link())]
    return list(at_gateway(way.lcm_url))
