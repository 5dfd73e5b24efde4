"""The session of test_axis_ways.py on real CAN, in one guest: run under tools/vcan with a folder to
write to. One axis is moved, pressed and recorded by each way to it, and owners are killed.
"""

import contextlib
import ctypes
import os
import signal
import sys
import time
from dataclasses import asdict
from pathlib import Path

from forceaxis.axis import actions, parameter_set, scan
from forceaxis.axis.axis import Axis, trigger_on
from forceaxis.axis.can import CanLink
from forceaxis.axis.drive import FaultObjects
from forceaxis.axis.gateway import GatewayLink
from forceaxis.axis.link import Refused
from forceaxis.axis.modbus import ModbusLink
from forceaxis.bus.keeper import HeartbeatKeeper
from forceaxis.commission import incident, incident_text
from forceaxis.objects import OBJECTS
from forceaxis.results import to_json
from forceaxis.thesis import session as thesis_session
from gateway_clients import PORT, Can, gateway, operational, until
from steps import Steps

URL = f"tcp://127.0.0.1:{PORT}"
WAYS = {
    "can": lambda: CanLink("vcan0", 1),
    "gateway": lambda: GatewayLink(1),
    "modbus": lambda: ModbusLink(URL, 1, timeout_s=3.0),
}
GAINS = {"position_gain": 4.0, "velocity_gain": 20.0, "force_gain": 5.0}
PARAMETERS = [
    o.name for o in OBJECTS if o.kind == "parameter" and o.access == "rw" and o.modbus >= 0
]


def use(way):
    """What one way finds and does: everything but what Modbus cannot carry."""
    found = {}
    with Axis(WAYS[way]()) as axis:
        found["parameters"] = axis.get(*PARAMETERS)
        axis.set(**GAINS, trajectory_velocity=100_000)
        found["gains"] = axis.get(*GAINS)
        try:
            axis.set(force_gain=6.0, adc_bits=8, watchdog=5)
        except Exception as error:
            found["nothing_written"] = [str(error), axis.read("force_gain")]
        axis.enable("profile position")
        try:
            axis.set(adc_bits=10)  # only while disabled
        except Refused as error:
            found["refused"] = str(error)
        found["reached"] = axis.move(-2000).position
        axis.off()
        found["pressed"] = asdict(axis.press(30.0, 1.5, speed=20_000, approach_s=5.0))
        try:
            held = axis.capture(["tick_count", "force", "position"], samples=300, pretrigger=20)
            ticks = held.values("tick_count").tolist()
            found["capture"] = [
                len(ticks), ticks[-1] - ticks[0], held.values("force").tolist()[:3], held.decimation
            ]  # fmt: skip
        except Refused as error:
            found["capture"] = str(error)
        found["owner"] = axis.read("command_source")
    return found | {"after": leftovers(way)}


def leftovers(way):
    """What the axis is when an owner has closed it."""
    axis = Axis(WAYS[way]())
    try:
        now = actions.state(axis)
        found = {key: getattr(now, key) for key in ("state", "fault", "command_source")}
        if way == "can":
            found["watched"] = axis.read("consumer_heartbeat_1")
        return found
    finally:
        axis.close()


def stall():
    """A library's call in which no other thread of this program runs, longer than the axis waits
    for a heartbeat."""
    ctypes.PyDLL(None).usleep(1_400_000)


def bridged():
    """Frames of a heartbeat after which a program did nothing more, though it lives."""

    class Short(HeartbeatKeeper):
        BRIDGED_S = 0.4

    bus = Can()
    keeper = Short("vcan0", 0x77D, b"\x05", 0.1, None)
    keeper._stop.set()
    found = [frame for frame in bus.frames(1.2) if frame[1] == 0x77D]
    keeper.close()
    return {"frames": len(found), "last": found[-1][0] - found[0][0]}


def killed(way):
    """A process that has enabled the axis, and stalled, is killed: the time until it is disabled,
    and why."""
    ready, said = os.pipe()
    child = os.fork()
    if child == 0:
        axis = Axis(WAYS[way]())
        axis.acquire()
        axis.enable("profile velocity")
        if way == "can":
            stall()
        axis.arm(["force"], 100, **trigger_on("force", 250.0))  # which never comes
        os.write(said, b"enabled")
        time.sleep(60)
        os._exit(0)
    os.close(said)
    assert os.read(ready, 7) == b"enabled"
    axis = Axis(WAYS[way]())
    try:
        found = {"before": axis.read("drive_state"), "shared": share(axis)}
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        # In the axis' own time: a busy machine stalls it.
        since, end = axis.read("tick_count"), time.monotonic() + 20
        while axis.read("drive_state") == "operation_enabled" and time.monotonic() < end:
            time.sleep(0.01)
        found["seconds"] = (axis.read("tick_count") - since) / 1500
        found["fault"] = axis.read("fault")
        found["owner"] = axis.read("command_source")
    finally:
        axis.close()
    with Axis(WAYS[way]()) as axis:  # the next one finds it usable
        axis.reset_fault()
        axis.enable("profile velocity")
        found["again"] = axis.read("drive_state")
        found["recorded"] = len(axis.capture(["force"], samples=50).raw)
    return found | {"after": leftovers(way)}


def share(axis):
    """What a second client of the same bus may do: write, not own."""
    try:
        axis.acquire()
        return "owned"
    except Refused as error:
        axis.acquire(shared=True)
        axis.set(velocity_window=300)
        return [str(error), axis.read("velocity_window"), axis.read("drive_state")]


def provoked():
    """An axis that fails, without a gateway, whose polling breaks longer transfers over CAN."""
    with Axis(WAYS["can"]()) as axis:
        if incident.has_one(axis):
            incident.clear(axis)
        axis.set(**GAINS, trajectory_velocity=100_000, speed_max=5)
        axis.enable("profile position")
        axis.set(target_position=axis.read("position") - 4000, controlword=0x1F)
        axis.wait_for(FaultObjects, lambda s: s.fault != "none", "a fault", 5.0)
    return fetched("can")


def fetched(way):
    with Axis(WAYS[way]()) as axis:
        held = incident.fetch(axis)
        return [held.fault, held.tick, held.recording.raw.tolist(), incident_text.tell(held)]


def cleared():
    found = fetched("gateway")
    with Axis(WAYS["gateway"]()) as axis:
        incident.clear(axis)
        axis.reset_fault()
        axis.set(speed_max=0)
    return found


def beside():
    """What a client over CAN reads while a gateway polls the same node."""
    axis = Axis(WAYS["can"]())
    try:
        return [axis.get(*PARAMETERS[::2]) for _ in range(2)]
    finally:
        axis.close()


def loaded(way, folder):
    """A file with another entry of a PDO is loaded over CAN, and what was before through the
    gateway."""
    before, new = folder / "before.toml", folder / "new.toml"
    with Axis(WAYS[way]()) as axis:
        if way == "can":
            before.write_text(parameter_set.dump(axis))
            more = "[more]\nhoming_travel = 4321\nrpdo_mapping_25 = 0x607a0020\nrpdo_mapped_4 = 1\n"
            new.write_text(before.read_text().replace("[objects]", f"{more}[objects]"))
        file = new if way == "can" else before
        found = {"changed": [d.name for d in parameter_set.load(axis, file).changed]}
        found["homing_travel"] = axis.read("homing_travel")
        try:
            parameter_set.store(axis)
        except Refused as error:
            found["store"] = str(error)
    return found


def stopped_by_another():
    """A stop over CAN of an axis that a client of the gateway has enabled."""
    with Axis(WAYS["gateway"]()) as axis:
        axis.enable("profile velocity")
        other = Axis(WAYS["modbus"]())
        try:
            after = actions.stop(other)
        finally:
            other.close()
        found = {"state": after.state, "stopped_by": axis.read("stopped_by")}
        axis.enable("profile velocity")
        found["again"] = axis.read("drive_state")
    return found


def main():
    folder = Path(sys.argv[1])
    with Steps(folder) as step, contextlib.ExitStack() as stack:
        programs = ("axis_node", "plant_node")
        stack.enter_context(thesis_session.machine(folder, programs=programs, endless=True))
        step("list can", lambda: to_json(list(scan.on_can("vcan0", seconds=0.2))))
        step("use can", use, "can")
        step("killed can", killed, "can")
        step("bridged", bridged)
        step("load can", loaded, "can", folder)
        step("incident can", provoked)
        supervisor = gateway("--axes", "1", "--watch-ms", "3000")
        stack.callback(supervisor.kill)
        with GatewayLink(1).client as client:
            until(lambda: operational(client), 10)
        step("incident gateway", cleared)
        step("can beside gateway", beside)
        step("list gateway", lambda: to_json(list(scan.at_gateway(seconds=0.3))))
        step("use gateway", use, "gateway")
        step("killed gateway", killed, "gateway")
        step("load gateway", loaded, "gateway", folder)
        step("list modbus", lambda: to_json(list(scan.on_modbus(URL))))
        step("use modbus", use, "modbus")
        step("stopped", stopped_by_another)


if __name__ == "__main__":
    main()
