"""An axis on Linux whose drive is another axis of this project on vcan1, in real time, with
python-canopen as the supervisor on vcan0. Run under tools/vcan with a folder; stores its steps
there. tests/loop/axis_on_axis_test.cpp has the same in lock-step."""

import json
import subprocess
import sys
import time
from pathlib import Path

import can
import canopen
from canopen.profiles.p402 import BaseNode402
from forceaxis.experiments import link
from steps import Steps

ROOT = Path(__file__).resolve().parents[2]
EDS = ROOT / "firmware/objects/generated/forceaxis.eds"
EXPERIMENT = ROOT / "sim/experiments/session.toml"
AXIS_DRIVE = ROOT / "build/release/tests/wire/axis_drive"
AXIS, DRIVE = 3, 9
LOAD_CELL, DRIVE_STATUS = 0x380 + DRIVE, 0x180 + DRIVE
# The plant of the drive has 8 bits and sends its fault, 0, before them: the upper byte of 16 bits.
SETTINGS = f"""
supervisor = "vcan0"
node_id = {AXIS}

[drive]
interface = "vcan1"
node_id = {DRIVE}
master_node_id = 1
target_num = 64
target_max = 130000
cycle_ms = 20
heartbeat_timeout_ms = 500
sdo_timeout_ms = 1000
lacks_1006h = true

[load_cell]
identifier = {LOAD_CELL}
bytes = 2
signed = false

[real_time]
priority = 0
late_ticks_max = 150
"""
OBJECTS = [
    (0x2301, 0, 1, 0),  # command_source: canopen
    (0x2010, 0, 2, 4 * 256),
    (0x2011, 0, 2, 20 * 256),
    (0x1802, 1, 4, LOAD_CELL - 0x40000000),  # bits 31 and 30
    (0x1802, 2, 1, 1),
    (0x1A02, 0, 1, 0),
    (0x1A02, 1, 4, 0x20210008),
    (0x1A02, 2, 4, 0x20260010),
    (0x1A02, 0, 1, 2),
    (0x1802, 1, 4, LOAD_CELL + 0x40000000),
]
# {object: raw value} of the experiment, but 16 bits, and limits for a kernel without real time:
# drive_on_ticks_max, position_age_max and force_age_max.
FIRMWARE = {
    0x200F: 16, 0x2010: 64, 0x200A: 192, 0x2203: 787, 0x6087: 7500,
    0x203A: 4500, 0x203B: 200, 0x203C: 200,
}  # fmt: skip


def start(*words, **pipes):
    words = list(map(str, words))
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, **pipes)
    assert process.stdout.readline() == "ready\n", words
    return process


class Forces(can.Listener):
    """Codes of the load cell and the states of the drive, in the cycles of the bus."""

    def __init__(self):
        self.codes, self.states = [], []

    def on_message_received(self, msg):
        if msg.arbitration_id == LOAD_CELL:
            self.codes.append(msg.data[1])
        elif msg.arbitration_id == DRIVE_STATUS:
            self.states.append(msg.data[0] & 0x6F)


def until(what, condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, what
        time.sleep(0.01)


def main(folder, steps):
    file = folder / "axis.toml"
    tables = (
        f"[[drive.object]]\nindex = {i}\nsub = {s}\nbytes = {b}\nvalue = {v}\n"
        for i, s, b, v in OBJECTS
    )
    before, cell = SETTINGS.split("[load_cell]")
    file.write_text(before + "".join(tables) + "[load_cell]" + cell)
    drive = start(AXIS_DRIVE, EXPERIMENT, "vcan1", DRIVE, "approach=0.004", stdin=subprocess.PIPE)
    axis = start(link.program("axis_linux"), file)
    forces = Forces()
    bus = can.Bus(interface="socketcan", channel="vcan1")
    listener = can.Notifier(bus, [forces], 0.1)
    until("no load cell", lambda: len(forces.codes) > 50)

    network = canopen.Network()
    network.connect(interface="socketcan", channel="vcan0")
    master = BaseNode402(AXIS, str(EDS))
    network.add_node(master)
    master.sdo.RESPONSE_TIMEOUT = 3.0
    for index, value in FIRMWARE.items():
        master.sdo[index].raw = value
    master.nmt.state = "OPERATIONAL"
    master.setup_402_state_machine()
    steps["first"] = master.state
    master.op_mode = "PROFILED TORQUE"
    master.sdo[0x6071].raw = 750
    begin = len(forces.codes)
    master.state = "OPERATION ENABLED"
    steps["enabled"] = master.state
    until("no contact", lambda: any(forces.codes[begin:]))
    touch = next(n for n in range(begin, len(forces.codes)) if forces.codes[n])
    until("too few cycles", lambda: len(forces.codes) > touch + 150)
    steps["codes"] = forces.codes[touch : touch + 150]
    steps["fault"] = master.sdo[0x2021].raw
    steps["read"] = {"force": master.sdo[0x6077].raw, "position": master.sdo[0x6064].raw}
    steps["drive_on"] = forces.states[-1]
    master.state = "READY TO SWITCH ON"
    time.sleep(0.5)
    steps["stopped"] = master.state
    steps["drive_off"] = forces.states[-1]
    axis.terminate()
    steps["lateness"] = json.loads(axis.communicate(timeout=20)[0])
    listener.stop()
    bus.shutdown()
    network.disconnect()
    drive.communicate(timeout=20)


if __name__ == "__main__":
    with Steps(sys.argv[1]) as steps:
        main(Path(sys.argv[1]), steps)
