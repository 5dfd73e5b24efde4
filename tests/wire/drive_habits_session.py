"""axis_linux with kinds of drives of drive_habits.py on vcan1 and a supervisor on vcan0, in real
time. Run under tools/vcan with a folder; stores its steps there."""

import contextlib
import json
import subprocess
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

import can
from axis_linux_session import FIRMWARE, LATE_TICKS_MAX, LOAD_CELL, settings, supervised
from drive_habits import BY_NAME
from fake_drive import FakeDrive
from forceaxis.bus.client import NoAnswer
from forceaxis.experiments import link
from steps import Steps

TICK_S, TICKS_AT_ONCE, TICKS_OF_CELL = 1 / 1500, 30, 15
# Where the settings of the page are others: the guest kernel of the tests has ticks of several ms.
OTHER = {
    "cycle_ms = 10": "cycle_ms = 20", "heartbeat_timeout_ms = 200": "heartbeat_timeout_ms = 1000",
}  # fmt: skip
# Kinds that need no frames closer than the ticks of a guest kernel, each without and with its cure.
KINDS = [
    ("segmented uploads", False),
    ("a stored SYNC counter and period", False),
    ("fault at power-up, needs 10 ms of bit 7", False),
    ("lacks 1006h", False),
    ("lacks 1006h", True),
    ("1400h:2 keeps 254", True),
    ("no bit 12", False),
    ("no bit 12", True),
    ("two nodes of one id", False),
]


class Machine:
    """A fake drive with a load cell without a load, in real time until `end`."""

    def __init__(self, habits):
        self.drive = FakeDrive(master=1, **habits)
        self.bus = can.Bus(interface="socketcan", channel="vcan1")
        self.ends = False
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def send(self, can_id, data):
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def run(self):
        before, left = time.monotonic(), 0.0
        while not self.ends:
            message = self.bus.recv(timeout=0.001)
            while message is not None:
                self.drive.receive(message.arbitration_id, bytes(message.data))
                message = self.bus.recv(timeout=0)
            now = time.monotonic()
            # While this process is kept from running, the time of the drive stands still.
            left += min((now - before) / TICK_S, TICKS_AT_ONCE)
            before = now
            for _ in range(int(left)):
                for can_id, data in self.drive.tick():
                    self.send(can_id, data)
                if self.drive.now % TICKS_OF_CELL == 0:
                    self.send(LOAD_CELL, bytes(4))
            left -= int(left)

    def end(self):
        self.ends = True
        self.thread.join()
        self.bus.shutdown()


def file_of(folder, keys):
    """The settings of the page with the keys of a kind."""
    file = settings(folder, LATE_TICKS_MAX)
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
    text = file.read_text()
    for of_page, own in OTHER.items():
        assert of_page in text and "[drive]\n" in text
        text = text.replace(of_page, own)
    file.write_text(text.replace("[drive]\n", f"[drive]\n{lines}"))
    return file


def attempt(folder, kind, keys):
    """Starts the axis on this drive, enables it, ends it: what it and the drive say."""
    machine = Machine(kind.habits)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    words = [link.program("axis_linux"), file_of(folder, keys)]
    process = subprocess.Popen(words, **pipes)
    assert process.stdout.readline() == "ready\n"
    found = {}
    time.sleep(1.5)  # drive and load cell answer, or the drive has failed
    with supervised() as axis:
        axis.set(**FIRMWARE)
        with contextlib.suppress(NoAnswer):  # a drive that is refused
            axis.enable("profile position")
        time.sleep(1.5)
        found["axis"] = axis.get("fault", "drive_state")
        found["drive"] = machine.drive.state
        with contextlib.suppress(NoAnswer):
            axis.disable()
    process.terminate()
    _, found["stderr"] = process.communicate(timeout=20)
    machine.end()
    return found


def main(folder, steps):
    for name, cured in KINDS:
        kind = BY_NAME[name]
        keys = kind.settings | {"wait_ms": 1200} | (kind.cure if cured else {})
        steps(f"{name}{', cured' if cured else ''}", attempt, folder, kind, keys)


if __name__ == "__main__":
    with Steps(sys.argv[1]) as steps:
        main(Path(sys.argv[1]), steps)
