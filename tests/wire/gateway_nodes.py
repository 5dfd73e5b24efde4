"""Scenarios of gateway_bench.py with nodes of their own: another object table, and two axes."""

import struct
import subprocess
import threading
import time

from forceaxis import objects
from forceaxis.axis import session as sessions
from forceaxis.bus.client import AxisClient, Refused
from forceaxis.bus.lcm import TABLE_HASH
from forceaxis.bus.messages import axis_state_t
from forceaxis.experiments import link
from forceaxis.objects import BY_NAME
from forceaxis.thesis import session as thesis_session
from gateway_clients import PORT, Can, Tcp, gateway, operational, registers, until
from pymodbus.client import ModbusTcpClient


class OtherTable(threading.Thread):
    """Node 2: heartbeats, and SDO answers of a firmware with another object table. The first
    request for each object in LOST gets no answer, as if its frame were lost."""

    LOST = (0x1018, 1), (0x2300, 0)

    def __init__(self):
        super().__init__(daemon=True)
        self.can, self.stop, self.downloads, self.starts = Can(), threading.Event(), [], 0
        self.lost = []

    def run(self):
        beat = 0.0
        while not self.stop.is_set():
            if time.monotonic() >= beat:
                self.can.send(0x702, b"\x7f")
                beat = time.monotonic() + 0.1
            frame = self.can.receive(0.05)
            if frame and frame[0] == 0 and frame[1][1] in (0, 2):
                self.starts += 1
            if not frame or frame[0] not in (0x602, *range(0x680, 0x6E0, 2)) or len(frame[1]) != 8:
                continue
            index, sub = struct.unpack("<HB", frame[1][1:4])
            if frame[1][0] == 0x80:  # an abort
                continue
            if frame[1][0] >> 5 != 2:
                self.downloads.append([index, *struct.unpack("<I", frame[1][4:])])
                confirmed = struct.pack("<BHBI", 0x60, index, sub, 0)
                self.can.send(0x582 if frame[0] == 0x602 else frame[0] + 1, confirmed)
                continue
            request = (frame[0], index, sub)
            if (index, sub) in self.LOST and request not in self.lost:
                self.lost.append(request)
                continue
            value = {(0x1018, 2): 1178687537, (0x2300, 0): 0x12345678}.get((index, sub), 7)
            answer = struct.pack("<BHBI", 0x43, index, sub, value)
            self.can.send(0x582 if frame[0] == 0x602 else frame[0] + 1, answer)


def other_table():
    node = OtherTable()
    node.start()
    process = gateway("--axes", "2", sdo_ms=800)
    found = {}
    with AxisClient(2, timeout_s=3) as axis:
        until(lambda: process.errors())
        state = until(lambda: s if (s := axis.state(3)).objects_hash > 0 else None)
        found["said"] = process.errors()
        found["hash"] = state.objects_hash
        try:
            axis.take()
        except Refused as error:
            found["write"] = str(error)
        found["stopped"] = list(axis.write_raw({"controlword": 2}).object)
        found["by_address"] = axis.read("0x1018:2")
        found["asked_again"] = [axis.read("0x1018:1"), len(node.lost)]
        found["modbus"] = Tcp().ask(2, struct.pack(">BHH", 6, 0x0114, 1)).hex()
    found["downloads"], found["starts"] = node.downloads, node.starts
    process.terminate()
    found["status"] = process.wait(5)
    node.stop.set()
    node.join()
    return found


class Driven(threading.Thread):
    """A node with this object table that is in operation. By quick stop it stops when every one of
    `together` has received its command; never, if `stops` is false."""

    def __init__(self, node, stops=True):
        super().__init__(daemon=True)
        self.node, self.stops, self.together = node, stops, [self]
        self.can, self.end = Can(), threading.Event()
        self.commanded, self.started = threading.Event(), threading.Event()
        self.unwatched = False
        self.values = {(o.index, o.sub): o.default for o in objects.OBJECTS}
        state = BY_NAME["drive_state"]
        self.state, self.states = (state.index, state.sub), state.enum
        self.values[0x2300, 0] = TABLE_HASH
        self.sizes = {(o.index, o.sub): int(o.type[1:]) // 8 for o in objects.OBJECTS}

    def value(self, where):
        if where != self.state:
            return self.values.get(where, 0)
        stopped = self.stops and all(other.commanded.is_set() for other in self.together)
        return self.states.index("switch_on_disabled" if stopped else "operation_enabled")

    def run(self):
        beat = 0.0
        while not self.end.is_set():
            if time.monotonic() >= beat:
                self.can.send(0x700 + self.node, b"\x05")
                beat = time.monotonic() + 0.05
            frame = self.can.receive(0.05)
            if frame and frame[0] == 0 and frame[1] == bytes([1, self.node]):
                self.started.set()
            if frame and frame[0] == 0x600 + self.node and frame[1][0] != 0x80:
                self.answer(frame[1])

    def answer(self, request):
        where = struct.unpack("<HB", request[1:4])
        if request[0] >> 5 == 2:
            size = self.sizes.get(where, 1)
            value = self.value(where) % (1 << 8 * size)
            answer = struct.pack("<BHBI", 0x43 | (4 - size) << 2, *where, value)
        else:
            self.values[where] = struct.unpack("<I", request[4:])[0]
            answer = struct.pack("<BHBI", 0x60, *where, 0)
            if where == (0x6040, 0) and self.values[where] == 2:
                self.commanded.set()
            if where[0] == 0x1016 and self.values[where] == 0:
                self.unwatched = True
        self.can.send(0x580 + self.node, answer)


def two_axes_end():
    """Two axes are stopped together; a second signal ends the gateway immediately."""
    found = {}
    for name, stops in (("together", True), ("at_once", False)):
        nodes = [Driven(2, stops), Driven(3, stops)]
        for node in nodes:
            node.together = nodes
            node.start()
        process = gateway("--axes", "2,3")
        assert all(node.started.wait(10) for node in nodes), process.errors()
        time.sleep(0.3)  # the set-up ends with the NMT start
        process.terminate()
        commanded = [node.commanded.wait(5) for node in nodes]
        if not stops:
            process.terminate()
        status = process.wait(10)
        found[name] = [commanded, [node.unwatched for node in nodes], status]
        for node in nodes:
            node.end.set()
            node.join()
    return found


def start_node(name, *args):
    words = [link.program(name), thesis_session.EXPERIMENT, "--axes", "2", "--link", "socketcan"]
    words += ["--start-timeout", "20", "--set", "experiment.duration_s=60", *args]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert "ready" in process.stdout.readline(), name
    return process


def standing(clients):
    """Of each axis: position, CiA 402 state and number, as published; a slow axis may have none."""

    def whole(client):
        s = client.state()
        return s if axis_state_t.NOT_AVAILABLE not in (s.position_cnt, s.statusword) else None

    states = [until(lambda client=client: whole(client), 10) for client in clients]
    return [[s.position_cnt, s.statusword & 0x6F, s.axis] for s in states]


def two_axes():
    """One gateway, two axes: each is moved over one bus while the other must not move."""
    nodes = [start_node("axis_node", "--can", "vcan0"), start_node("plant_node", "--pace", "real")]
    sets = ["--set", "force_gain=3", "--set", "2:force_gain=7"]
    # A busy guest may not run two axes in real time; times are counted in ticks.
    process = gateway("--axes", "1,2", *sets, heartbeat_ms=1000)
    modbus = ModbusTcpClient("127.0.0.1", port=PORT, timeout=3)
    assert modbus.connect()
    try:
        with AxisClient(2, timeout_s=4) as second, sessions.Session(1, timeout_s=4) as first:
            until(lambda: operational(second), 10)
            return move_each(first, second, modbus) | {"said": process.errors()}
    finally:
        modbus.close()
        process.terminate()
        process.wait(5)
        for node in nodes:
            node.kill()
            node.communicate()


def move_each(first, second, modbus):
    def write(unit, name, *words):
        """None or the exception."""
        where = BY_NAME[name].modbus
        answer = modbus.write_registers(where, list(words), device_id=unit)
        return answer.exception_code if answer.isError() else None

    def position(unit):
        high, low = registers(modbus, BY_NAME["position_actual"].modbus, 2, "input", unit)
        return (high << 16 | low) - (high >> 15 << 32)

    both = first, second
    gain = BY_NAME["force_gain"].modbus
    found = {
        "gains": [
            [axis.read("force_gain") for axis in both],
            [registers(modbus, gain, 1, unit=unit) for unit in (1, 2)],
        ],
        "node_ids": [registers(modbus, BY_NAME["node_id"].modbus, 1, "input", u) for u in (1, 2)],
        "owners": [axis.read("command_source") for axis in both],
        "taken": write(1, "command_source", 1),
        "owners_then": [axis.read("command_source") for axis in both],
    }
    first.take()
    # Axis 1 by LCM.
    first.write_all({"position_gain": 4.0, "velocity_gain": 20.0})
    first.home()
    before = standing(both)
    first.enable("profile position", trajectory_velocity=60_000)
    first.move(2000)
    found["by_lcm"] = [before, standing(both)]
    # Axis 2 by Modbus.
    assert write(2, "command_source", 1, 60_000) is None  # and its watchdog
    found["refused"] = [write(unit, "force_gain", 512) for unit in (1, 2)]
    before = standing(both)
    target = before[1][0] + 1500
    for name, *words in (
        ("position_gain", 1024),
        ("velocity_gain", 5120),
        ("modes_of_operation", 1),
        ("target_position", target >> 16 & 0xFFFF, target & 0xFFFF),
        *(("controlword", word) for word in (6, 7, 15, 0x1F)),
    ):
        assert write(2, name, *words) is None, name
    until(lambda: second.state().statusword & 1 << 10 and abs(position(2) - target) < 10, 20)
    found["by_modbus"] = [before, standing(both)]
    found["modbus_sees"] = [position(1), position(2)]
    found["gains_after"] = [axis.read("force_gain") for axis in both]
    found["owners_after"] = [axis.read("command_source") for axis in both]
    # One is disabled while the other remains enabled.
    write(2, "controlword", 0)
    until(lambda: second.state().statusword & 0x6F == 0x40)
    found["off"] = standing(both)
    found["lost"] = sum(g.lost for axis in both for g in axis.gaps.values())
    return found
