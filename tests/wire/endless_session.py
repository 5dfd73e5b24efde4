"""The sessions of test_endless.py, real processes on real CAN, in one guest: each node is stopped
for two seconds and goes on. Stores its steps in a folder.
"""

import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fault_session import EXPERIMENT, NODES, Bus, end
from steps import Steps

STOPPED_S = 2
SENSOR_INVALID = 0x7305
CONTROLWORD, STATUSWORD, MODE, POSITION, TARGET_VELOCITY = 0x6040, 0x6041, 0x6060, 0x6064, 0x60FF
PROFILE_VELOCITY = 3
SETTINGS = "firmware.mode=disabled", "firmware.position_gain=4", "firmware.velocity_gain=20"
OPERATION_ENABLED = 0x27


def start(name, *args, pace="real", wait_s=20):
    words = [str(NODES / name), str(EXPERIMENT), "--endless", "--pace", pace]
    words += ["--start-timeout", str(wait_s), *map(str, args)]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if "ready" not in process.stdout.readline():
        raise SystemExit(f"{name}: {process.communicate()}")
    return process


def state(bus):
    return bus.read(STATUSWORD) & 0x6F


def moves(bus):
    """Resets, enables and moves for half a second; the state reached and the way, counts."""
    for word in (0, 0x80, 6, 7, 15):
        bus.write(CONTROLWORD, 0, word, 2)
        bus.listen(0.05)
    reached = state(bus)
    bus.write(TARGET_VELOCITY, 0, -2000 & 0xFFFFFFFF, 4)
    before = bus.read(POSITION)
    bus.listen(0.5)
    way = (bus.read(POSITION) - before + 2**31) % 2**32 - 2**31
    return {"state": reached, "way": way}


def session(link, ended_first, steps):
    with tempfile.TemporaryDirectory() as folder:
        journal = Path(folder) / "journal"
        common = ["--link", link, *(w for s in SETTINGS for w in ("--set", s))]
        axis = start("axis_node", *common, "--can", "vcan0", "--journal", str(journal))
        bus = Bus()
        plant = start("plant_node", *common)
        bus.listen(0.3)
        bus.write(MODE, 0, PROFILE_VELOCITY, 1)
        steps["before"] = moves(bus)
        for name, process in (("plant", plant), ("axis", axis)):
            del bus.emergencies[:]
            process.send_signal(signal.SIGSTOP)
            # A stopped axis answers no SDO: the state is read when both go on.
            time.sleep(STOPPED_S)
            process.send_signal(signal.SIGCONT)
            bus.listen(5, lambda: SENSOR_INVALID in bus.emergencies)
            bus.listen(0.3)
            stopped = {"emergencies": bus.emergencies[:], "fault": bus.read(0x2021)}
            bus.write(CONTROLWORD, 0, 15, 2)  # does not enable an axis with a fault
            bus.listen(0.2)
            stopped |= {"error_code": bus.read(0x603F), "code": bus.read(0x2029)}
            stopped["state"] = state(bus)
            steps[name] = stopped | {"after": moves(bus)}
        first, second = (axis, plant) if ended_first == "axis" else (plant, axis)
        first.terminate()
        reports = {ended_first: end(first)}
        reports["plant" if ended_first == "axis" else "axis"] = end(second)
        steps["reports"], steps["journal"] = reports, journal.read_text()


def stop_of_an_axis_not_heard(steps):
    """By Modbus TCP, while the gateway misses the heartbeat of a moving axis that then goes on."""
    common = ["--link", "socketcan", *(w for s in SETTINGS for w in ("--set", s))]
    axis, plant = start("axis_node", *common, "--can", "vcan0"), start("plant_node", *common)
    words = [NODES / "gateway", "--modbus-port", "1503"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    gateway, bus = subprocess.Popen(words, **pipes), Bus()
    gateway.stdout.readline()
    bus.listen(2)
    bus.write(MODE, 0, PROFILE_VELOCITY, 1)
    steps["before"] = moves(bus)
    with socket.create_connection(("127.0.0.1", 1503), timeout=10) as client:
        axis.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        client.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 6, 0, 0))  # controlword 0
        time.sleep(0.1)
        axis.send_signal(signal.SIGCONT)
        steps["answer"] = client.recv(64)[7:].hex()
    steps["state"], steps["fault"] = state(bus), bus.read(0x2021)
    steps["stopped_by"] = bus.read(0x2217)
    gateway.terminate()
    steps["said"] = gateway.communicate(timeout=20)[1]
    plant.terminate()
    end(plant), end(axis)


if __name__ == "__main__":
    with Steps(sys.argv[1]) as steps:
        if sys.argv[2] == "not_heard":
            stop_of_an_axis_not_heard(steps)
        else:
            session(sys.argv[2], {"lcm": "axis", "socketcan": "plant"}[sys.argv[2]], steps)
