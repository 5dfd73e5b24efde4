"""An axis on Linux with a drive of python-canopen and its load cell on vcan1 and a supervisor on
vcan0, in real time. Run under tools/vcan with a folder; writes its steps there."""

import contextlib
import fcntl
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

import can
from forceaxis.axis.axis import Axis
from forceaxis.axis.can import CanLink
from forceaxis.experiments import link
from foreign_drive import TICK_S, ForeignDrive
from gateway_clients import until
from steps import Steps

# Counts until the contact, ADC codes of 16 bits per count of deflection, frame of the load cell.
GAP, STIFFNESS, LOAD_CELL = 400, 64, 0x301
# Ticks by which the process may be late before its axis has a fault, on a machine that others use.
LATE_TICKS_MAX = 600
SIOCSIFFLAGS, IFF_UP = 0x8914, 1  # of linux/sockios.h and linux/if.h
PAGE = Path(__file__).resolve().parents[2] / "docs/guide/your_drive.md"
# Where the settings of the page have to be others here. A guest kernel has ticks of several ms.
OTHER = {
    '"can0"': '"vcan0"', '"can1"': '"vcan1"', "priority = 80": "priority = 0",
    "cpu = 1": "cpu = -1", "late_ticks_max = 3": "late_ticks_max = LATE", '"axis.bin"': '"STORE"',
    # This drive stays in quick stop active until its voltage is disabled.
    "node_id = 9":
        "node_id = 9\nmaster_node_id = 1\nheartbeat_timeout_ms = 200\nquick_stop_ms = 100",
}  # fmt: skip
FIRMWARE = {
    "adc_bits": 16, "force_gain": 2.0, "approach_velocity_max": 2000, "force_tare": 128.0,
    "position_gain": 1.0, "position_age_max": 120, "force_age_max": 120,
    "drive_on_ticks_max": 9000, "cycle_age_max": 29,
}  # fmt: skip
# A converter in place of the load cell, and its value without a load in codes of 16 bits.
IIO = {
    "scan_elements/in_voltage0_en": "1", "scan_elements/in_voltage0_index": "0",
    "scan_elements/in_voltage0_type": "be:s24/32>>8", "buffer/enable": "1",
}  # fmt: skip
REST = 100


class Machine(ForeignDrive):
    """The drive with a load cell that is deflected by its motion."""

    def __init__(self, bus):
        super().__init__(bus)
        self.before = time.monotonic()
        self.cell_alive = True
        self.converter = None  # the buffer of an IIO device

    def on_sync(self, *arguments):
        super().on_sync(*arguments)
        if self.converter is not None:
            value = (round(STIFFNESS * max(0.0, self.position - GAP)) + REST) * 256
            os.write(self.converter, (value << 8).to_bytes(4, "big", signed=True))
        elif self.cell_alive:
            codes = round(STIFFNESS * max(0.0, self.position - GAP)) * 256
            data = codes.to_bytes(4, "little", signed=True)
            self.bus.send(can.Message(arbitration_id=LOAD_CELL, data=data, is_extended_id=False))

    def run(self):
        while True:
            with contextlib.suppress(can.CanOperationError):  # the interface went down
                self.receive(0.001)
            now = time.monotonic()
            ticks = (now - self.before) / TICK_S
            if ticks >= 1:
                self.before = now
                self.step(ticks)


def iio_device(folder):
    """Makes the files of an IIO device, and returns its table of the settings."""
    device, buffer = folder / "iio:device0", folder / "buffer"
    for name, text in IIO.items():
        (device / name).parent.mkdir(parents=True, exist_ok=True)
        (device / name).write_text(f"{text}\n")
    os.mkfifo(buffer)
    return f'[iio]\ndevice = "{device}"\nbuffer = "{buffer}"\nchannel = "voltage0"\n\n'


def settings(folder, late_ticks_max, iio=""):
    """Writes the settings of the page, with the interfaces and the kernel of this session. `iio`:
    the table in place of that of the load cell."""
    text = PAGE.read_text().partition("```toml\n")[2].partition("```")[0]
    for of_page, own in OTHER.items():
        assert of_page in text, of_page
        text = text.replace(of_page, own)
    if iio:
        before, _, after = text.partition("[load_cell]")
        text = before + iio + after[after.index("[real_time]") :]
    file = folder / "axis.toml"
    file.write_text(
        text.replace("STORE", str(folder / "axis.bin")).replace("LATE", str(late_ticks_max))
    )
    return file


class Process:
    """axis_linux, which ends with the block."""

    def __init__(self, folder, late_ticks_max=LATE_TICKS_MAX, iio="", started=lambda: None):
        words = [link.program("axis_linux"), settings(folder, late_ticks_max, iio)]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        watched = os.environ | {"LD_PRELOAD": str(folder / "lock_watch.so")}
        self.process = subprocess.Popen(words, env=watched, **pipes)
        assert self.process.stdout.readline() == "ready\n"
        started()
        time.sleep(1.5)  # drive and load cell answer

    def end(self):
        self.process.terminate()
        out, err = self.process.communicate(timeout=20)
        return {"status": self.process.returncode, "stderr": err, "report": out}


def supervised():
    return Axis(CanLink("vcan0", 3, timeout_s=5.0))


def set_up(interface, up):
    """As `ip link set`, without a process, whose start would stall the axis in a guest kernel."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as control:
        name, flags = interface.encode(), IFF_UP if up else 0
        fcntl.ioctl(control, SIOCSIFFLAGS, struct.pack("16sh22x", name, flags))


def comes_on(machine):
    """Waits until the drive is on, and for what may come in the 300 ms after it."""
    until(lambda: machine.state == "operation enabled")
    time.sleep(0.3)


def faulty(axis, machine, fail):
    """What becomes of an enabled axis when `fail` has been called: {object: value}, and the state
    of the drive."""
    axis.enable("profile position")
    comes_on(machine)
    before = {"before": axis.get("drive_state")["drive_state"], "drive_before": machine.state}
    fail()
    time.sleep(0.5)
    return before | axis.get("fault", "drive_state") | {"drive": machine.state}


def recovered(axis, machine):
    """Resets the fault, and enables the axis once more."""
    axis.reset_fault()
    axis.enable("profile position")
    comes_on(machine)
    found = axis.get("fault", "drive_state") | {"drive": machine.state}
    axis.disable()
    return found


def main(folder, steps):
    machine = Machine(can.Bus(interface="socketcan", channel="vcan1"))
    threading.Thread(target=machine.run, daemon=True).start()
    process = Process(folder)
    pid = process.process.pid

    def stall():
        os.kill(pid, signal.SIGSTOP)
        time.sleep(1.5 * LATE_TICKS_MAX * TICK_S)
        os.kill(pid, signal.SIGCONT)

    with supervised() as axis:
        steps["first"] = axis.get("fault", "drive_state", "position")
        axis.set(**FIRMWARE)
        steps["pressed"] = vars(axis.press(20, 1.0))
        time.sleep(0.2)
        steps["disabled"] = axis.get("fault", "drive_state") | {"drive": machine.state}
        axis.set(store_parameters=1)
        assert until(lambda: axis.read("store_state") == "saved", 20)

        def power_off():
            machine.alive = False

        steps("killed_drive", faulty, axis, machine, power_off)
        machine.alive = True
        machine.power_up()
        steps("new_drive", recovered, axis, machine)
        steps("drive_fault", faulty, axis, machine, lambda: machine.fail(0x2310))
        steps("reset_drive", recovered, axis, machine)

        def be_silent():
            machine.cell_alive = False

        steps("silent_cell", faulty, axis, machine, be_silent)
        machine.cell_alive = True
        time.sleep(0.2)
        steps("speaking_cell", recovered, axis, machine)

        steps("bus_down", faulty, axis, machine, lambda: set_up("vcan1", False))
        set_up("vcan1", True)
        time.sleep(0.5)
        steps("bus_up", recovered, axis, machine)

        steps("stalled", faulty, axis, machine, stall)
        axis.reset_fault()
        time.sleep(0.5)
        steps["reset_stalled"] = axis.get("fault", "overruns")
        stall()
        time.sleep(0.5)
        steps["stalled_disabled"] = axis.get("fault", "overruns")
    steps["end"] = process.end() | {"drive": machine.state}

    process = Process(folder)
    with supervised() as axis:
        steps["stored"] = axis.get("adc_bits", "position_gain")
        axis.enable("profile position")
        comes_on(machine)
        before = machine.state
        process.process.kill()
        time.sleep(0.5)
        steps["killed"] = {"before": before, "drive": machine.state}

    def converts():
        machine.converter = os.open(folder / "buffer", os.O_WRONLY)

    def ends():
        buffer, machine.converter, machine.cell_alive = machine.converter, None, False
        time.sleep(0.05)  # a value that is being written
        os.close(buffer)

    process = Process(folder, iio=iio_device(folder), started=converts)
    with supervised() as axis:
        steps["converter"] = axis.get("force_raw", "position")
        steps("converter_ends", faulty, axis, machine, ends)
    steps["converter_stderr"] = process.end()["stderr"]


if __name__ == "__main__":
    with Steps(sys.argv[1]) as steps:
        main(Path(sys.argv[1]), steps)
