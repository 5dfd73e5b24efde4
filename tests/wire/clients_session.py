"""The session of test_clients.py on real CAN, in one guest: run under tools/vcan with a folder to
write to. Third-party clients drive axis_node; each step stores its figures, or why it failed
(steps.py), and all frames of the session are in session.log, as candump writes them.
"""

import itertools
import json
import logging
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import can
import canopen
from canopen.profiles.p402 import BaseNode402
from clients_flood import flood, record, stop
from pymodbus.client import ModbusSerialClient
from steps import Steps

ROOT = Path(__file__).resolve().parents[2]
NODES = ROOT / "build" / "release" / "host"
CLIENT = ROOT / "build" / "release" / "tests" / "wire" / "modbus_client"
EXPERIMENT = ROOT / "sim" / "experiments" / "contact.toml"
EDS = ROOT / "firmware" / "objects" / "generated" / "forceaxis.eds"
# The plant is ended when the steps are done.
SETTINGS = ["--set", "experiment.duration_s=600", "--set", "firmware.mode=disabled"]
LINK = ["--link", "socketcan", "--timeout", "6", "--start-timeout", "20"]
NODE = 1
BAUD = 9600

MODES = {
    "PROFILED POSITION": 1,
    "PROFILED VELOCITY": 3,
    "PROFILED TORQUE": 4,
    "HOMING": 6,
    "CYCLIC SYNCHRONOUS POSITION": 8,
    "CYCLIC SYNCHRONOUS VELOCITY": 9,
    "CYCLIC SYNCHRONOUS TORQUE": 10,
}
# Each of CiA 402's transitions that a master can command, once.
WALK = [
    "SWITCH ON DISABLED", "READY TO SWITCH ON", "SWITCH ON DISABLED",  # T2 T7
    "READY TO SWITCH ON", "SWITCHED ON", "READY TO SWITCH ON",  # T3 T6
    "SWITCHED ON", "SWITCH ON DISABLED",  # T10
    "READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED", "SWITCHED ON",  # T4 T5
    "OPERATION ENABLED", "READY TO SWITCH ON",  # T8
    "SWITCHED ON", "OPERATION ENABLED", "SWITCH ON DISABLED",  # T9
    "READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED", "QUICK STOP ACTIVE",  # T11
    "OPERATION ENABLED", "QUICK STOP ACTIVE", "SWITCH ON DISABLED",  # T16, T12
]  # fmt: skip


class Nodes:
    """axis_node and plant_node, in real time."""

    def __init__(self, folder, name, *axis_args, model=()):
        self.model = [word for setting in model for word in ("--set", setting)]
        self.journal = folder / f"{name}.journal"
        self.errors = folder / f"{name}.errors"
        self.axis = self.start("axis_node", "--can", "vcan0", "--journal", self.journal, *axis_args)
        self.plant = self.start("plant_node", "--pace", "real")

    def start(self, name, *args):
        words = [NODES / name, EXPERIMENT, *SETTINGS, *self.model, *LINK, *args]
        with self.errors.open("a") as errors:
            process = subprocess.Popen(
                [str(w) for w in words], stdout=subprocess.PIPE, stderr=errors, text=True
            )
        assert "ready" in process.stdout.readline(), name
        return process

    def finish(self):
        """Ends the axis, which closes its journal, then the plant. Returns the axis' report."""
        self.axis.terminate()
        report, _ = self.axis.communicate(timeout=30)
        self.plant.kill()
        self.plant.communicate()
        return json.loads(report)

    def end(self):
        for process in (self.axis, self.plant):
            process.kill()
            process.communicate()


def wait_until(what, condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(
                f"{what() if callable(what) else what} did not come within {seconds} s"
            )
        time.sleep(0.002)


class Client:
    """python-canopen's drive, used as its manual describes."""

    def __init__(self):
        self.network = canopen.Network()
        self.network.connect(interface="socketcan", channel="vcan0")
        self.drive = BaseNode402(NODE, str(EDS))
        self.network.add_node(self.drive)
        # Its 0.3 s are too short on a busy machine; the timeouts of transitions are unchanged.
        self.drive.sdo.RESPONSE_TIMEOUT = 1.0

    def close(self):
        self.network.disconnect()

    def set_up(self):
        drive = self.drive
        drive.nmt.state = "PRE-OPERATIONAL"
        drive.sdo[0x1017].raw = 50
        state = self.settle("PRE-OPERATIONAL")
        drive.setup_402_state_machine()
        drive.nmt.state = "OPERATIONAL"
        return {"first_state": state, "state": self.settle("OPERATIONAL")}

    def settle(self, wanted):
        """The NMT state by heartbeats; the first may have been sent before the command."""
        for _ in range(10):
            state = self.drive.nmt.wait_for_heartbeat(5)
            if state == wanted:
                break
        return state

    def resets(self):
        found = {}
        for command in ("RESET", "RESET COMMUNICATION"):
            found[command] = self.reset(command)
            self.drive.sdo[0x1017].raw = 50
            found[command + " state"] = self.settle("PRE-OPERATIONAL")
        for command in ("OPERATIONAL", "STOPPED", "PRE-OPERATIONAL", "OPERATIONAL"):
            self.drive.nmt.state = command
            found.setdefault("states", []).append(self.settle(command))
        return found

    def reset(self, command):
        """Seconds until the boot-up message, which may arrive before a call could wait for it."""
        booted = []
        waiting = threading.Thread(target=lambda: booted.append(self.drive.nmt.wait_for_bootup(5)))
        waiting.start()
        time.sleep(0.05)
        since = time.monotonic()
        self.drive.nmt.state = command
        waiting.join()
        assert booted, f"no boot-up after {command}"
        return time.monotonic() - since

    def gains(self):
        for index, value in ((0x2010, 1024), (0x2011, 5120), (0x200A, 1280)):
            self.drive.sdo[index].raw = value
        self.drive.sdo[0x2203].raw = 20000

    def first_motion(self):
        """The first enabling of an axis whose store is empty, with a target already sent."""
        drive = self.drive
        emergencies = []
        drive.emcy.add_callback(emergencies.append)
        found = {"option": drive.sdo[0x231A].raw, "before": drive.sdo[0x231C].raw}
        drive.sdo[0x6060].raw = MODES["PROFILED POSITION"]
        found["place"] = self.position()
        drive.sdo[0x607A].raw = -20000
        for word in (0x06, 0x07, 0x1F):
            drive.controlword = word
        wait_until("the end of the test", lambda: drive.sdo[0x231C].raw != 1)
        found["result"] = drive.sdo[0x231C].raw
        found["state"] = drive.sdo[0x6041].raw & 0x6F
        found["fault"] = drive.sdo[0x2021].raw
        found["error_code"] = drive.sdo[0x603F].raw
        found["measured"] = [drive.sdo[0x231D][sub].raw for sub in (1, 2, 3)]
        time.sleep(0.3)
        found["moved"] = self.position() - found["place"]
        found["emergencies"] = [e.code for e in emergencies if e.code != 0xFF09]
        drive.controlword = 0
        return found

    # The state machine.

    def go(self, state):
        """One transition; returns its duration in seconds."""
        before = self.drive.state
        since = time.monotonic()
        self.drive.state = state
        return [before, state, time.monotonic() - since]

    def walk(self):
        if self.drive.state != "SWITCH ON DISABLED":
            self.drive.state = "SWITCH ON DISABLED"
        # Quick stop remains active, which T16 and T12 require.
        self.drive.sdo[0x605A].raw = 6
        done = [self.go(state) for state in WALK[1:]]
        self.drive.sdo[0x605A].raw = 2
        return done

    def modes(self):
        self.drive.state = "SWITCH ON DISABLED"
        found = {}
        for enabled in (False, True):
            if enabled:
                self.enable()
            for name, number in MODES.items():
                since = time.monotonic()
                self.drive.op_mode = name
                seconds = time.monotonic() - since
                shown = self.drive.sdo[0x6061].raw
                where = "enabled" if enabled else "disabled"
                found[f"{name}, {where}"] = [number, shown, self.drive.op_mode, seconds]
        found["state"] = self.drive.state
        return found

    def enable(self):
        self.drive.state = "OPERATION ENABLED"

    def status_bits(self, mask, value, seconds=5.0):
        wait_until(
            lambda: (
                f"statusword {value:#x} of {mask:#x} (is {self.drive.statusword:#x}, "
                f"position {self.position()})"
            ),
            lambda: self.drive.check_statusword() & mask == value,
            seconds,
        )

    def position(self):
        return self.drive.sdo[0x6064].raw

    def ticks(self):
        """tick_count: the time of the axis, which in a guest advances in bursts."""
        return self.drive.sdo[0x201F].raw

    # Motion.

    def homing(self):
        self.drive.sdo[0x6098].raw = 35
        self.drive.sdo[0x607C].raw = 1234
        attained = self.drive.homing(timeout=5)
        found = {"attained": attained, "position": self.position(), "home_offset": 1234}
        self.drive.controlword = 0x0F
        self.drive.sdo[0x607C].raw = 0
        found["again"] = self.drive.homing(timeout=5)
        found["at_zero"] = self.position()
        found["is_homed"] = self.drive.is_homed()
        self.drive.controlword = 0x0F
        return found

    def pp(self, target):
        self.drive.op_mode = "PROFILED POSITION"
        self.enable()
        self.drive.sdo[0x607A].raw = target
        since, first = time.monotonic(), self.ticks()
        self.drive.controlword = 0x1F
        self.status_bits(0x1000, 0x1000)
        acknowledged = time.monotonic() - since
        self.drive.controlword = 0x0F
        self.status_bits(0x1400, 0x0400, 10)
        return {
            "target": target,
            "acknowledged_s": acknowledged,
            "reached_ticks": self.ticks() - first,
            "reached_s": time.monotonic() - since,
            "position": self.position(),
        }

    def pv(self, velocity):
        self.drive.op_mode = "PROFILED VELOCITY"
        self.enable()
        self.drive.sdo[0x60FF].raw = velocity
        self.status_bits(0x0400, 0x0400, 5)
        time.sleep(0.1)
        first, at = self.position(), self.ticks()
        time.sleep(0.2)
        second, then = self.position(), self.ticks()
        self.drive.sdo[0x60FF].raw = 0
        self.status_bits(0x1000, 0x1000, 5)
        # Position and tick are read by two SDOs, some ticks apart.
        return {"target": velocity, "seen": (second - first) * 1500 / (then - at)}

    def cyclic(self):
        """csp, csv: set-points at SYNC, as a motion controller sends them."""
        drive, found = self.drive, {}
        drive.op_mode = "CYCLIC SYNCHRONOUS POSITION"
        self.enable()
        start = self.position()
        for k in range(1, 51):
            drive.rpdo[2][0].raw, drive.rpdo[2][1].raw = 0x0F, start - 40 * k
            drive.rpdo[2].transmit()
            self.network.sync.transmit()
            time.sleep(0.005)
        wait_until("csp target", lambda: abs(self.position() - (start - 2000)) < 20)
        found["csp"] = [start - 2000, self.position()]
        drive.op_mode = "CYCLIC SYNCHRONOUS VELOCITY"
        first, at = self.position(), self.ticks()
        drive.rpdo[3][0].raw, drive.rpdo[3][1].raw = 0x0F, 5000
        drive.rpdo[3].transmit()
        wait_until("300 ticks", lambda: self.ticks() - at >= 300, 10)
        drive.rpdo[3][1].raw = 0
        drive.rpdo[3].transmit()
        found["csv_moved"], found["csv_ticks"] = self.position() - first, self.ticks() - at
        return found

    def contact(self, mode, target):
        """tq or cst: approach, touch, hold."""
        self.drive.op_mode = mode
        self.enable()
        since = time.monotonic()
        self.drive.rpdo[4][0].raw, self.drive.rpdo[4][1].raw = 0x0F, target
        self.drive.rpdo[4].transmit()
        wait_until("contact", lambda: self.drive.sdo[0x2210].raw != 0, 15)
        touched = time.monotonic() - since
        forces = []

        def held():
            forces.append(self.drive.sdo[0x6077].raw)
            return len(forces) >= 100 and max(forces[-100:]) - min(forces[-100:]) <= 30

        wait_until("a calm force", held, 10)
        return {"target": target, "touched_s": touched, "force": forces[-1], "peak": max(forces)}

    def stops(self):
        drive, found = self.drive, {}
        drive.op_mode = "PROFILED VELOCITY"
        self.enable()
        drive.sdo[0x60FF].raw = -4000
        self.status_bits(0x1000, 0, 5)
        drive.controlword = 0x10F
        self.status_bits(0x1000, 0x1000, 5)
        first = self.position()
        time.sleep(0.1)
        found["halt"] = [drive.state, self.position() - first]
        drive.controlword = 0x0F
        self.status_bits(0x1000, 0, 5)
        # 605Ah = 2: slow down, then switch on disabled.
        since = time.monotonic()
        drive.controlword = 0x02
        wait_until("switch on disabled", lambda: drive.state == "SWITCH ON DISABLED", 5)
        found["quick_stop_s"] = time.monotonic() - since
        drive.sdo[0x605A].raw = 6
        self.enable()
        drive.sdo[0x60FF].raw = -4000
        self.status_bits(0x1000, 0, 5)
        found["quick_stop"] = self.go("QUICK STOP ACTIVE")
        self.status_bits(0x0400, 0x0400, 5)
        found["on_again"] = self.go("OPERATION ENABLED")
        drive.sdo[0x60FF].raw = 0
        drive.sdo[0x605A].raw = 2
        drive.state = "SWITCH ON DISABLED"
        return found

    def fault(self):
        """A following error, provoked by a window that every motion exceeds."""
        drive = self.drive
        drive.op_mode = "PROFILED POSITION"
        self.enable()
        emergencies = []
        drive.emcy.add_callback(emergencies.append)
        drive.sdo[0x6065].raw = 1
        drive.sdo[0x607A].raw = self.position() - 4000
        drive.controlword = 0x1F
        wait_until("a fault", lambda: drive.state == "FAULT", 5)
        found = {"error_code": drive.sdo[0x603F].raw, "fault": drive.sdo[0x2021].raw}
        wait_until("an emergency", lambda: len(emergencies) > 0)
        found["history"] = drive.sdo[0x1003][1].raw & 0xFFFF
        drive.sdo[0x6065].raw = 0xFFFFFFFF
        since = time.monotonic()
        drive.reset_from_fault()
        # python-canopen itself waits 0.4 s there before it sends the rising edge.
        found["reset_s"] = time.monotonic() - since - drive.TIMEOUT_RESET_FAULT
        found["state"] = drive.state
        wait_until("the emergency with error code 0", lambda: 0 in [e.code for e in emergencies])
        # The client enables the axis at once again, unsupervised: FF09h.
        found["emergencies"] = [e.code for e in emergencies if e.code != 0xFF09]
        drive.state = "SWITCH ON DISABLED"
        # The state alone, by the client's own setter: T15.
        drive.sdo[0x6065].raw = 1
        self.enable()
        drive.controlword = 0x1F
        wait_until("a second fault", lambda: drive.state == "FAULT", 5)
        drive.sdo[0x6065].raw = 0xFFFFFFFF
        drive.controlword = 0
        found["t15"] = self.go("SWITCH ON DISABLED")
        return found

    # Communication.

    def remap(self):
        """TPDO3, TPDO4 and RPDO3 mapped anew with pdo.save(); read back by another reading."""
        drive = self.drive
        drive.nmt.state = "PRE-OPERATIONAL"
        for pdo, objects in ((3, (0x6077, 0x201F)), (4, (0x6062, 0x60F4))):
            drive.tpdo[pdo].clear()
            for index in objects:
                drive.tpdo[pdo].add_variable(index)
            drive.tpdo[pdo].trans_type = 1
            drive.tpdo[pdo].enabled = True
        drive.rpdo[3].clear()
        drive.rpdo[3].add_variable(0x6071)
        drive.rpdo[3].add_variable(0x60FF)
        drive.rpdo[3].enabled = True
        drive.pdo.save()
        drive.nmt.state = "OPERATIONAL"
        drive.rpdo[3][0].raw, drive.rpdo[3][1].raw = -123, 4567
        drive.rpdo[3].transmit()
        found = {"written": [drive.sdo[0x6071].raw, drive.sdo[0x60FF].raw]}
        ticks = []
        drive.tpdo[3].add_callback(lambda pdo: ticks.append(pdo[1].raw))
        for _ in range(10):
            self.network.sync.transmit()
            time.sleep(0.01)
        wait_until("ten TPDO3", lambda: len(ticks) == 10, 2)
        found["ticks_grow"] = all(b > a for a, b in itertools.pairwise(ticks))
        drive.sdo[0x60FF].raw = drive.sdo[0x6071].raw = 0
        # A reset restores the defaults.
        self.reset("RESET COMMUNICATION")
        drive.pdo.read()
        found["defaults"] = [hex(v.index) for v in drive.tpdo[3]] + [
            hex(v.index) for v in drive.rpdo[3]
        ]
        drive.sdo[0x1017].raw = 50
        drive.nmt.state = "OPERATIONAL"
        return found

    def texts(self):
        return [self.drive.sdo[index].raw for index in (0x1008, 0x1009, 0x100A)]

    def recording(self):
        sdo = self.drive.sdo
        sdo[0x2100][1].raw = 0x201F00
        sdo[0x2106].raw = 700
        sdo[0x2107].raw = 1
        wait_until("the recording", lambda: sdo[0x2108].raw == 3, 10)
        since = time.monotonic()
        data = sdo.upload(0x2120, 0)
        ticks = [int.from_bytes(data[i : i + 4], "little") for i in range(0, len(data), 4)]
        by_segments = time.monotonic() - since
        since = time.monotonic()
        with sdo.open(0x2120, 0, "rb", block_transfer=True) as stream:
            blocks = stream.read()
        return {
            "values": len(ticks),
            "gapless": ticks == list(range(ticks[0], ticks[0] + len(ticks))),
            "bytes_per_s": len(data) / by_segments,
            "blocks_bytes_per_s": len(data) / (time.monotonic() - since),
            "blocks_same": blocks == data,
        }

    def store(self):
        drive = self.drive
        before = drive.sdo[0x200A].raw

        def settled():
            return drive.sdo[0x2305].raw not in (2, 3)

        drive.state = "SWITCH ON DISABLED"
        drive.sdo[0x200A].raw = 4321
        drive.store()
        wait_until("the end of the save", settled)
        drive.sdo[0x200A].raw = 1
        self.reset("RESET")
        found = {"after_save": drive.sdo[0x200A].raw}
        drive.restore()
        wait_until("the end of it", settled)
        self.reset("RESET")
        found["after_restore"] = drive.sdo[0x200A].raw
        drive.sdo[0x200A].raw = before
        return found

    # Reference for the session's frames.

    def default_pdos(self):
        """Windows in time in which each default PDO was sent while SDO read steady values."""
        drive = self.drive
        drive.nmt.state = "OPERATIONAL"
        drive.state = "SWITCH ON DISABLED"
        for pdo in (3, 4):  # invalid by default: only their COB-ID is written
            cob_id = drive.sdo[0x1800 + pdo - 1][1].raw & 0x7FFFFFFF
            drive.sdo[0x1800 + pdo - 1][1].raw = cob_id
            drive.sdo[0x1800 + pdo - 1][2].raw = 1
        seen = {
            "TPDO1": (0x6041, 0x6061),
            "TPDO2": (0x6064, 0x606C),
            "TPDO3": (0x6077, 0x6078),
            "TPDO4": (0x6062, 0x60F4),
        }
        windows = []
        for place in (0, -700, 900):
            if place:
                self.pp(self.position() + place)
                drive.state = "READY TO SWITCH ON"
                time.sleep(0.5)
            for _ in range(50):
                before = {i: drive.sdo[i].raw for pdo in seen.values() for i in pdo}
                since = time.time()
                self.network.sync.transmit()
                time.sleep(0.06)  # TPDO1 is sent every 20 ms
                until = time.time()
                after = {i: drive.sdo[i].raw for pdo in seen.values() for i in pdo}
                if before == after:
                    break
            else:
                raise TimeoutError(f"no steady state: {before} and {after}")
            for name, pdo in seen.items():
                windows.append([name, since, until, [before[i] for i in pdo]])
        writes = (
            ("RPDO1", 1, (0x06, 3)),
            ("RPDO2", 2, (0x06, -123456)),
            ("RPDO3", 3, (0x06, -7654)),
            ("RPDO4", 4, (0x06, -321)),
        )
        for name, number, values in writes:
            since = time.time()
            for variable, value in zip(drive.rpdo[number], values, strict=True):
                variable.raw = value
            drive.rpdo[number].transmit()
            time.sleep(0.02)
            until = time.time()
            read = [drive.sdo[v.index].raw for v in drive.rpdo[number]]
            windows.append([name, since, until, read])
        for index in (0x607A, 0x60FF, 0x6071):
            drive.sdo[index].raw = 0
        return windows


def brief(client):
    """A short session of the 402 client: all states, some modes, a move."""
    found = {"set_up": client.set_up()}
    client.gains()
    found["walk"] = client.walk()
    found["modes"] = client.modes()
    found["homing"] = client.homing()
    found["pp"] = client.pp(client.position() - 3000)
    client.drive.state = "SWITCH ON DISABLED"
    return found


class ModbusLine:
    """Two ptys joined by socat, axis_node at one of them."""

    def __init__(self, folder):
        self.axis, self.client = folder / "modbus_axis", folder / "modbus_client"
        self.socat = subprocess.Popen(
            ["socat", *(f"pty,raw,echo=0,link={end}" for end in (self.axis, self.client))]
        )
        wait_until("socat's ptys", lambda: self.axis.exists() and self.client.exists())

    def close(self):
        self.socat.kill()
        self.socat.wait()


def libmodbus(line, *requests):
    """Responses to libmodbus, as modbus_client prints them."""
    words = "".join(" ".join(map(str, r)) + "\n" for r in requests)
    done = subprocess.run(
        [CLIENT, line.client, str(BAUD), str(NODE)],
        input=words, capture_output=True, text=True, timeout=20, check=False,
    )  # fmt: skip
    return done.stdout.splitlines()


def modbus(line, client):
    """Both Modbus clients at the node itself, CANopen beside them."""
    found = {}
    sdo = client.drive.sdo
    found["libmodbus"] = libmodbus(
        line,
        (4, 0, 14),  # one snapshot
        (6, 0x010C, 77),  # locked: CANopen owns
        (3, 9, 1),  # no such register
        (16, 7, 1, 60000),  # acquires the lock, watchdog one minute
        (6, 0x010C, 77),
        (3, 0x010C, 1),
        (6, 2, 1),  # half of 32 bits
        (16, 2, 0xFFFF, 0xFF85),  # target position -123
    )
    found["canopen_reads"] = [sdo[0x2301].raw, sdo[0x200A].raw, sdo[0x607A].raw]
    try:
        sdo[0x200A].raw = 1280
    except canopen.SdoAbortedError as refusal:
        found["canopen_refused"] = refusal.code
    rtu = ModbusSerialClient(str(line.client), baudrate=BAUD, timeout=1, retries=0, name="pymodbus")
    assert rtu.connect()
    answer = rtu.read_holding_registers(2, count=2, device_id=NODE)
    found["pymodbus_reads"] = answer.registers
    found["pymodbus_writes"] = not rtu.write_register(0x010C, 1280, device_id=NODE).isError()
    found["exceptions"] = [
        rtu.read_holding_registers(9, count=1, device_id=NODE).exception_code,
        rtu.write_register(2, 1, device_id=NODE).exception_code,
        rtu.read_fifo_queue(address=0, device_id=NODE).exception_code,
    ]
    found["identity"] = (
        rtu.read_device_information(read_code=1, object_id=0, device_id=NODE)
        .information[0]
        .decode()
    )
    # The axis is enabled by its coil, its state read over CANopen.
    rtu.write_registers(1, [8], device_id=NODE)
    rtu.write_coil(0, True, device_id=NODE)
    found["enabled"] = sdo[0x6041].raw & 0x6F
    rtu.write_coil(0, False, device_id=NODE)
    found["released"] = not rtu.write_register(7, 0, device_id=NODE).isError()
    rtu.close()
    sdo[0x200A].raw = 1280
    found["owner"] = sdo[0x2301].raw
    return found


def session(folder, steps):
    line = ModbusLine(folder)
    dump = record(folder / "session.log")
    nodes = Nodes(
        folder, "session", "--modbus", line.axis, "--modbus-baud", BAUD, "--store", folder / "store"
    )
    client = Client()
    steps("set_up", client.set_up)
    steps("resets", client.resets)
    steps("gains", client.gains)
    steps("first_motion", client.first_motion)
    steps("walk", client.walk)
    steps("modes", client.modes)
    steps("homing", client.homing)
    steps("pp", client.pp, -6000)
    steps("pv", client.pv, -6000)
    steps("cyclic", client.cyclic)
    steps("stops", client.stops)
    steps("fault", client.fault)
    steps("default_pdos", client.default_pdos)
    steps("remap", client.remap)
    steps("set_up_again", client.set_up)
    steps("texts", client.texts)
    steps("recording", client.recording)
    steps("modbus", modbus, line, client)
    steps("tq", client.contact, "PROFILED TORQUE", 500)
    steps("cst", client.contact, "CYCLIC SYNCHRONOUS TORQUE", 600)
    steps("store", client.store)
    client.close()
    nodes.end()
    stop(dump, folder / "session.log")
    line.close()


def reversed_encoder(folder, steps):
    """The same axis as it would be with its encoder's wires crossed."""
    nodes = Nodes(
        folder, "reversed", "--store", folder / "reversed_store",
        model=["encoder_scale=-157480.31496062993"],
    )  # fmt: skip
    client = Client()
    steps("reversed_set_up", client.set_up)
    steps("reversed_gains", client.gains)
    steps("reversed_first_motion", client.first_motion)
    client.close()
    nodes.end()


def main():
    logging.disable(logging.INFO)
    can.rc = {}
    folder = Path(sys.argv[1])
    only = sys.argv[2:]
    with Steps(folder) as steps:
        if not only or "session" in only:
            session(folder, steps)
        if not only or "reversed" in only:
            reversed_encoder(folder, steps)
        if not only or "flood" in only:
            flood(folder, steps, Nodes, Client, brief)


if __name__ == "__main__":
    os.environ.pop("PYTEST_CURRENT_TEST", None)
    main()
