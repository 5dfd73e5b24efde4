"""Independent clients at the emulated chip, in real time: python-canopen and libmodbus.

Frames of CAN go over USART3 (tunnel.py); Modbus RTU over USART2, as on the board.
"""

import contextlib
import re
import subprocess
import time

import canopen
import pytest
import tunnel
from canopen.profiles.p402 import BaseNode402
from chip import ROOT
from forceaxis import objects
from forceaxis.axis.axis import Axis
from forceaxis.axis.can import OWN_NODE, CanLink
from forceaxis.axis.drive import FaultObjects
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.axis.modbus import ModbusLink

EDS = ROOT / "firmware/objects/generated/forceaxis.eds"
CLIENT = ROOT / "build/release/tests/wire/modbus_client"
NODE = 1
REQUESTS = 1000
pytestmark = pytest.mark.alone  # in real time
BY_NAME = {o.name: o for o in objects.OBJECTS}


@pytest.fixture
def frames(tmp_path):
    """The socket of the chip's frames."""
    with tunnel.frames(tmp_path) as path:
        yield path


@pytest.fixture
def line():
    """libmodbus at the chip's serial line; a call is a request, its answer a list of numbers."""
    assert CLIENT.is_file(), "expected the build's target modbus_client"
    process = tunnel.emulator(modbus="pty")
    line = process.stdout.readline()
    tty = re.search(r"redirected to (\S+)", line)
    assert tty, line
    client = subprocess.Popen(
        [CLIENT, tty[1], "115200", str(NODE)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
    )  # fmt: skip

    def ask(*request):
        client.stdin.write(" ".join(map(str, request)) + "\n")
        answer = client.stdout.readline().split()
        return [int(word) for word in answer[1:]] if answer[0] == "ok" else " ".join(answer)

    yield ask
    for p in (client, process):
        p.kill()
        p.wait()


def test_libmodbus_reads_and_writes_a_thousand_times(line):
    """At 115,200 baud, whose silences the firmware keeps; QEMU passes bytes at once. Every
    request is answered at its first try, and what was written is read back."""
    gain, ticks = BY_NAME["force_gain"].modbus, BY_NAME["tick_count"].modbus
    table = min(o.modbus for o in objects.OBJECTS if o.access == "ro" and o.modbus >= 0x100)
    # The emulator opens its end within a second.
    assert any(isinstance(line(4, ticks, 2), list) for _ in range(3))
    source = BY_NAME["command_source"]
    assert line(6, source.modbus, source.enum.index("modbus")) == []
    begin, first = time.monotonic(), line(4, ticks, 2)
    bad = []
    for i in range(REQUESTS // 4):
        value = i * 37 % 30000
        answers = line(6, gain, value), line(3, gain, 1), line(4, table, 2), line(4, ticks, 2)
        if answers[1] != [value] or not all(isinstance(a, list) for a in answers):
            bad.append((i, answers))
    took_s = time.monotonic() - begin
    last = line(4, ticks, 2)
    ran = ((last[0] - first[0] << 16) + last[1] - first[1]) / 1500
    print(f"\n{REQUESTS} requests in {took_s:.1f} s, {ran:.1f} s of the chip; failed: {bad}")
    assert bad == []
    assert 0.1 < ran / took_s < 1.5  # real time, on a machine with more to do


def test_python_canopen_drives_the_chip_through_its_states(frames):
    network = canopen.Network()
    network.bus = tunnel.SerialBus(frames)
    network.connect()
    try:
        drive = BaseNode402(NODE, str(EDS))
        network.add_node(drive)
        drive.sdo.RESPONSE_TIMEOUT = 2.0
        version = drive.sdo[0x100A].raw
        assert version.split()[:2] == [objects_version(), objects.OBJECTS_HASH[:8]]
        assert len(version.split()) == 3  # and of which commit
        drive.nmt.state = "PRE-OPERATIONAL"
        drive.sdo[0x1017].raw = 50
        drive.nmt.wait_for_heartbeat(5)
        drive.setup_402_state_machine()
        drive.nmt.state = "OPERATIONAL"
        drive.sdo[0x605A].raw = 6  # a quick stop that stays
        seen = []
        for state in (
            "SWITCH ON DISABLED", "READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED",
            "QUICK STOP ACTIVE", "OPERATION ENABLED", "SWITCHED ON", "READY TO SWITCH ON",
            "SWITCH ON DISABLED",
        ):  # fmt: skip
            drive.state = state
            seen.append(drive.state)
        assert seen[3:6] == ["OPERATION ENABLED", "QUICK STOP ACTIVE", "OPERATION ENABLED"]
        before = drive.sdo[0x2021].raw, drive.sdo[BY_NAME["tick_count"].index].raw
        drive.state = "OPERATION ENABLED"
        drive.op_mode = "PROFILED POSITION"
        assert drive.op_mode == "PROFILED POSITION"
        drive.state = "SWITCH ON DISABLED"
        assert before[0] == 0
        assert drive.sdo[BY_NAME["tick_count"].index].raw > before[1]
    finally:
        network.disconnect()


def test_an_axis_on_the_chip_is_one_as_any_other(frames):
    """What the axis verbs use: objects, a recording by block transfer, the watched heartbeat."""
    link = CanLink("tunnel", NODE, bus=tunnel.SerialBus(frames), timeout_s=2.0)
    with Axis(link) as axis:
        axis.set(force_gain=6.5, watchdog=700)
        assert axis.get("force_gain", "watchdog") == {"force_gain": 6.5, "watchdog": 700}
        with pytest.raises(Refused, match="force_bank: "):
            axis.set(force_bank=1)
        held = axis.capture(["tick_count", "force"], samples=300, decimation=2)
        ticks = held.values("tick_count").tolist()
        assert ticks == list(range(ticks[0], ticks[0] + 600, 2))
        axis.enable("open loop", first_motion_test=0, open_loop_code=0)
        assert axis.read("consumer_heartbeat_1") >> 16 == OWN_NODE
        link._keeper.close()  # as if it were killed
        found = axis.wait_for(FaultObjects, lambda s: s.fault != "none", "a fault", 10.0)
        assert found.fault == "heartbeat_lost"
        assert axis.read("drive_state") == "fault"


def test_an_axis_on_the_chip_by_modbus():
    """Registers of 16 and 32 bits, ownership kept by the watchdog's writes."""
    process = tunnel.emulator(modbus="pty")
    try:
        tty = re.search(r"redirected to (\S+)", process.stdout.readline())[1]
        axis = Axis(ModbusLink(tty, NODE, timeout_s=2.0))
        for _ in range(3):  # the emulator opens its end within a second
            with contextlib.suppress(NoAnswer):
                axis.read("fault")
                break
        with axis:
            axis.set(force_gain=6.5, target_position=-70_000, watchdog=300)
            axis.link.wait(1.0)
            found = axis.get("force_gain", "target_position", "watchdog", "command_source")
        assert found == {
            "force_gain": 6.5, "target_position": -70_000, "watchdog": 300,
            "command_source": "modbus",
        }  # fmt: skip
    finally:
        process.kill()
        process.wait()


def objects_version():
    header = (ROOT / "firmware/app/fw.h").read_text()
    return re.search(r'FW_VERSION "([^"]+)"', header).group(1)
