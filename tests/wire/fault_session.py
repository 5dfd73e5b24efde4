"""The faults of test_faults.py, injected into real processes on real CAN, in one guest.

Prints one JSON object. With an argument it is one of the masters that get killed.

Only the standard library, so that the guest does not spend its time on imports.
"""

import contextlib
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import tty
from pathlib import Path

from pymodbus.framer import FramerRTU
from steps import Steps

ROOT = Path(__file__).resolve().parents[2]
NODES = ROOT / "build" / "release" / "host"
EXPERIMENT = ROOT / "sim" / "experiments" / "contact.toml"
SECONDS = 60  # longer than any scenario, each of which ends the processes itself
FRAME = struct.Struct("<IB3x8s")
# Longer than a busy machine stalls a guest.
HEARTBEAT_MS = 600
WATCHDOG_MS = 600


class Bus:
    """A client's socket on vcan0."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.bind(("vcan0",))
        self.emergencies = []
        self.frames = []
        self.beats = 0

    def send(self, can_id, data):
        self.socket.send(FRAME.pack(can_id, len(data), data.ljust(8, b"\0")))

    def receive(self, seconds):
        """(id, data) of the next frame, or None."""
        if not select.select([self.socket], [], [], max(0, seconds))[0]:
            return None
        try:
            can_id, length, data = FRAME.unpack(self.socket.recv(FRAME.size))
        except OSError:  # the interface went down: reported once
            return None
        if can_id == 0x81:
            self.emergencies.append(int.from_bytes(data[:2], "little"))
        self.beats += can_id == 0x77F
        self.frames.append((can_id, data[:length]))
        return can_id, data[:length]

    def listen(self, seconds, until=lambda: False):
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self.receive(min(0.05, end - time.monotonic()))
        return until()

    def ask(self, request):
        """The response of the first SDO server."""
        self.send(0x601, request)
        end = time.monotonic() + 1
        while (remaining := end - time.monotonic()) > 0:
            frame = self.receive(remaining)
            # A gateway asks over the same channel while it sets up the axis.
            if frame and frame[0] == 0x581 and frame[1][1:4] == request[1:4]:
                return frame[1]
        raise SystemExit(f"no answer to {request.hex()}")

    def write(self, index, sub, value, size):
        """0 or the abort code."""
        command = 0x23 | (4 - size) << 2
        request = struct.pack("<BHB", command, index, sub) + value.to_bytes(4, "little")
        answer = self.ask(request)
        return 0 if answer[0] == 0x60 else int.from_bytes(answer[4:], "little")

    def read(self, index, sub=0):
        answer = self.ask(struct.pack("<BHB4x", 0x40, index, sub))
        return int.from_bytes(answer[4:], "little") if answer[0] != 0x80 else None


def crc(frame):
    """The frame and its CRC."""
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


def registers(fd, function, first, value):
    """A request of one register to unit 1; the response without CRC, or b""."""
    while select.select([fd], [], [], 0)[0]:  # a response to a client that was killed
        os.read(fd, 64)
    os.write(fd, crc(struct.pack(">BBHH", 1, function, first, value)))
    answer = b""
    length = 8 if function == 6 else 7
    while len(answer) < length and select.select([fd], [], [], 0.5)[0]:
        answer += os.read(fd, 64)
        if len(answer) > 1 and answer[1] >= 0x80:  # an exception
            length = 5
    return answer[:-2]


# The masters to be killed.


def heartbeat_master():
    bus = Bus()
    while True:
        bus.send(0x77F, b"\x05")
        time.sleep(0.03)


def modbus_master(fd):
    registers(fd, 6, 8, WATCHDOG_MS)
    print("ready", flush=True)
    while True:
        registers(fd, 6, 8, WATCHDOG_MS)  # reading would not feed it
        time.sleep(0.03)


# The faults.


def start(name, *args):
    words = [str(NODES / name), str(EXPERIMENT), "--link", "socketcan"]
    words += ["--set", f"experiment.duration_s={SECONDS}", *args]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    ready = process.stdout.readline()
    if "ready" not in ready:
        raise SystemExit(f"{name}: {process.communicate()}")
    return process


def end(process):
    out, error = process.communicate(timeout=60)
    lines = [line for line in out.splitlines() if line.startswith("{")]
    return {
        "status": process.returncode,
        "stderr": error,
        **(json.loads(lines[-1]) if lines else {}),
    }


def master(*args, **options):
    return subprocess.Popen([sys.executable, __file__, *args], **options)


def outputs_of(log):
    """{tick: (code, amplifier and brake, fault)} of the link's frames as candump recorded them."""
    outputs = {}
    for line in log.splitlines():
        if not line.startswith("("):
            continue
        can_id, data = line.split()[2].split("#")
        if int(can_id, 16) >> 28 & 1:
            code, out, tick, fault, _ = struct.unpack("<hBHBB", bytes.fromhex(data))
            outputs[tick] = code, out, fault
    return outputs


def entries(journal, kind):
    """Of the journal: [tick, ...] of this kind, as lists of words."""
    words = [line.split() for line in journal.splitlines()]
    return [[int(w[1]), *w[2:]] for w in words if w and w[0] == kind]


@contextlib.contextmanager
def bench(*axis_args):
    """An axis on its buses, its plant, and the observations, filled in at the end."""
    seen = {}
    client, device = os.openpty()
    tty.setraw(client)
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+") as log:
        journal = Path(folder) / "journal"
        dump = subprocess.Popen(["candump", "-L", "-r", "8000000", "vcan1"], stdout=log, stderr=log)
        axis = start(
            "axis_node", "--can", "vcan0", "--modbus", os.ttyname(device), "--modbus-baud", "9600",
            "--journal", str(journal), *axis_args,
        )  # fmt: skip
        seen["bus"] = Bus()
        plant = start("plant_node", "--pace", "real")
        seen |= {"line": client, "plant": plant}
        yield seen
        if plant.poll() is None:  # else the axis ends by itself
            axis.terminate()
            seen["axis"] = end(axis)
            plant.kill()
        else:
            seen["axis"] = end(axis)
        seen["plant"] = end(plant)
        time.sleep(0.1)
        dump.terminate()
        dump.wait(10)
        log.seek(0)
        outputs = outputs_of(log.read())
        seen["journal"] = journal.read_text()
    os.close(client)
    os.close(device)
    seen["emergencies"] = seen.pop("bus").emergencies
    del seen["line"]
    on = [tick for tick, (_, out, _) in outputs.items() if out == 3]
    seen["on"] = [min(on), max(on)]
    after = [outputs[tick] for tick in sorted(outputs) if tick > max(on)]
    seen["after"] = sorted(set(after))


def killed_supervisor():
    with bench() as seen:
        bus = seen["bus"]
        assert bus.write(0x1016, 1, 0x7F0000 | HEARTBEAT_MS, 4) == 0
        supervisor = master("heartbeat")
        bus.listen(10, lambda: bus.beats > 20)
        seen["alive"] = bus.read(0x2021)
        supervisor.kill()
        supervisor.wait()
        bus.listen(5, lambda: 0x8130 in bus.emergencies)
        seen["fault"], seen["error_code"] = bus.read(0x2021), bus.read(0x603F)
        seen["register"] = registers(seen["line"], 4, 2, 1).hex()
    beats = [t for t, can_id, *_ in entries(seen["journal"], "can") if can_id == "77f"]
    return seen | {"last": beats[-1], "journal": len(seen["journal"])}


def killed_plant():
    with bench("--timeout", "0.5", "--hold", "2") as seen:
        bus = seen["bus"]
        bus.listen(0.5)
        seen["plant"].kill()
        bus.listen(5, lambda: 0x7305 in bus.emergencies)
        seen["fault"], seen["error_code"] = bus.read(0x2021), bus.read(0x603F)
        seen["register"] = registers(seen["line"], 4, 2, 1).hex()
    return seen | {"journal": len(seen["journal"])}


def late_ticks(*axis_args):
    """The plant is suspended for a moment: nothing is lost, but ticks are late."""
    with bench("--timeout", "5", *axis_args) as seen:
        bus = seen["bus"]
        bus.listen(0.5)
        seen["plant"].send_signal(signal.SIGSTOP)
        bus.listen(0.2)
        seen["plant"].send_signal(signal.SIGCONT)
        bus.listen(0.5)
        seen["overruns"] = bus.read(0x2307)
        seen["register"] = registers(seen["line"], 4, 0x0C, 1).hex()
    late = [tick for tick, *_ in entries(seen["journal"], "overrun")]
    return seen | {"late": late, "journal": len(seen["journal"])}


def late_in_real_time():
    return late_ticks("--pace", "real")


def lost_bus():
    with bench() as seen:
        bus = seen["bus"]
        bus.listen(0.5)
        subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
        time.sleep(0.5)
        seen["register"] = registers(seen["line"], 4, 2, 1).hex()
        subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
        bus.listen(5, lambda: 0x8140 in bus.emergencies)
        seen["fault"], seen["error_code"] = bus.read(0x2021), bus.read(0x603F)
    states = entries(seen["journal"], "bus")
    return seen | {"told": states, "journal": len(seen["journal"])}


# Error frames of linux/can/error.h: bus off, and the controller was restarted.
BUS_OFF, RESTARTED = 0x20000040, 0x20000100


def bus_off():
    """The controller is bus off while the interface stays up, until its driver restarts it. vcan
    takes the error frames of the driver from a socket."""
    with bench() as seen:
        bus = seen["bus"]
        bus.listen(0.5)
        assert bus.write(0x1017, 0, 20, 2) == 0
        bus.send(0, b"\x01\x01")  # operational
        bus.listen(0.2)
        bus.send(BUS_OFF, bytes(8))
        bus.listen(0.1)
        bus.frames.clear()
        bus.listen(1.0)
        bus.send(0x601, bytes.fromhex("4021200000000000"))  # an answer would be a frame too
        bus.listen(0.5)
        seen["while_off"] = [
            frame for frame in bus.frames if frame[0] & 0x7F == 1 and frame[0] != 0x601
        ]
        seen["register"] = registers(seen["line"], 4, 2, 1).hex()
        before = len(bus.emergencies)
        bus.send(RESTARTED, bytes(8))
        bus.listen(5, lambda: 0x8140 in bus.emergencies)
        bus.listen(0.2)
        seen["after_return"] = bus.emergencies[before:]
        seen["nmt"] = sorted({data[0] for can_id, data in bus.frames if can_id == 0x701})
        seen["fault"], seen["error_code"] = bus.read(0x2021), bus.read(0x603F)
        # A second time, so short that both error frames come in one tick.
        bus.send(BUS_OFF, bytes(8))
        bus.send(RESTARTED, bytes(8))
        bus.listen(5, lambda: bus.emergencies.count(0x8140) > 1)
    states = entries(seen["journal"], "bus")
    return seen | {"told": states, "journal": len(seen["journal"])}


def removed_interface():
    """The adapter is unplugged and plugged in again."""
    with bench() as seen:
        bus = seen["bus"]
        bus.listen(0.5)
        subprocess.run(["ip", "link", "del", "vcan0"], check=True)
        time.sleep(0.5)
        subprocess.run(["ip", "link", "add", "vcan0", "type", "vcan"], check=True)
        time.sleep(0.3)
        subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
        seen["bus"] = bus = Bus()
        bus.listen(5, lambda: 0x8140 in bus.emergencies)
        seen["fault"], seen["error_code"] = bus.read(0x2021), bus.read(0x603F)
    states = entries(seen["journal"], "bus")
    return seen | {"told": states, "journal": len(seen["journal"])}


def two_masters():
    with bench() as seen:
        bus = seen["bus"]
        line = seen["line"]
        rival = master("modbus", str(line), pass_fds=[line], stdout=subprocess.PIPE)
        rival.stdout.readline()
        bus.write(0x2301, 0, 1, 1)  # an axis that is enabled is given, not acquired
        seen["owner"] = bus.read(0x2301)
        bus.listen(0.3)
        seen["refused"] = bus.write(0x6040, 0, 0x0F, 2)  # a stop would be accepted
        seen["alive"] = bus.read(0x2021)
        rival.kill()
        rival.wait()
        bus.listen(5, lambda: 0x6010 in bus.emergencies)
        seen["owner_after"] = bus.read(0x2301)
        seen["fault"], seen["error_code"] = bus.read(0x2021), bus.read(0x603F)
        seen["rival_after"] = registers(line, 6, 0, 15).hex()
    # Frames of the rival before this client's next request.
    requests = [t for t, *_ in entries(seen["journal"], "modbus") if t <= seen["on"][1]]
    return seen | {"last": requests[-1], "journal": len(seen["journal"])}


if __name__ == "__main__":
    if sys.argv[1:2] == ["heartbeat"]:
        heartbeat_master()
    elif sys.argv[1:2] == ["modbus"]:
        modbus_master(int(sys.argv[2]))
    else:
        scenarios = (
            killed_supervisor, killed_plant, lost_bus, bus_off, removed_interface, two_masters,
            late_ticks, late_in_real_time,
        )  # fmt: skip
        with Steps(sys.argv[1]) as steps:
            for scenario in scenarios:
                if sys.argv[2:] in ([], [scenario.__name__]):
                    steps(scenario.__name__, scenario)
