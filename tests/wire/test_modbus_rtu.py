"""Modbus RTU over a pty pair: the firmware in real time, with libmodbus and pymodbus as masters.

The firmware is served by tests/wire/modbus_bench.cpp; socat is the line. Both clients read and
write every register of the map; frames that must not be answered are sent as raw bytes."""

import os
import random
import select
import signal
import struct
import subprocess
import time
from pathlib import Path

import pytest
from forceaxis._core import cycle_program
from forceaxis.cycles.program import with_program
from forceaxis.objects import OBJECTS
from pymodbus.client import ModbusSerialClient
from pymodbus.framer import FramerRTU

ROOT = Path(__file__).resolve().parents[2]
WAITS = """
title = "Waits"
number = 7

[[phase]]
name = "one"
do = "wait"
force_max = "100 N"
travel_max = "10 mm"
time_max = "2 s"

[[phase.end]]
when = "time"
value = "0.3 s"
next = "end"
"""
BIN = ROOT / "build/release/tests/wire"
UNIT = 5
# Sets the silent interval to 7 ticks, which a pty under load does not exceed within a frame.
BAUD = 9600
SILENCE_S = 0.02
SEED = 4

BY_NAME = {o.name: o for o in OBJECTS}
HOLDING = [o for o in OBJECTS if o.modbus >= 0 and o.access == "rw"]
INPUT = [o for o in OBJECTS if o.modbus >= 0 and o.access == "ro"]


def width(o):
    return 2 if o.type in ("u32", "i32") else 1


def to_words(o, raw):
    bits = raw & 0xFFFFFFFF
    return [bits >> 16, bits & 0xFFFF] if width(o) == 2 else [bits & 0xFFFF]


def from_words(o, words):
    value = 0
    for word in words:
        value = value << 16 | word
    top = 16 * width(o)
    return value - (1 << top) if o.type.startswith("i") and value >> (top - 1) else value


def wait_for(what, condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{what} did not come within {seconds} s"
        time.sleep(0.01)


class Line:
    """Two ptys joined by socat; the firmware on one of them."""

    def __init__(self, folder):
        self.ends = folder / "axis", folder / "client"
        self.store = folder / "axis.store"
        self.socat = subprocess.Popen(
            ["socat", *(f"pty,raw,echo=0,link={end}" for end in self.ends)]
        )
        wait_for("socat's ptys", lambda: all(end.exists() for end in self.ends))
        self.bench = None
        self.power_up()
        self.client = subprocess.Popen(
            [BIN / "modbus_client", self.ends[1], str(BAUD), str(UNIT)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )

    def power_up(self):
        self.bench = subprocess.Popen(
            [BIN / "modbus_bench", self.ends[0], str(UNIT), str(BAUD), self.store],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.bench.stdout.readline() == "ready\n"

    def kill(self):
        self.bench.send_signal(signal.SIGKILL)
        self.bench.wait()

    def close(self):
        for process in (self.client, self.bench, self.socat):
            process.kill()
            process.wait()

    def libmodbus(self, *request):
        """The response that libmodbus reports: a list of numbers, or a text."""
        self.client.stdin.write(" ".join(str(r) for r in request) + "\n")
        self.client.stdin.flush()
        answer = self.client.stdout.readline().split()
        return [int(w) for w in answer[1:]] if answer[0] == "ok" else " ".join(answer)


@pytest.fixture(scope="module")
def line(tmp_path_factory):
    built = [BIN / name for name in ("modbus_bench", "modbus_client")]
    assert all(b.exists() for b in built), "tools/setup --tests builds both"
    made = Line(tmp_path_factory.mktemp("modbus"))
    yield made
    made.close()


@pytest.fixture
def pymodbus(line):
    client = ModbusSerialClient(str(line.ends[1]), baudrate=BAUD, timeout=3, retries=0)
    assert client.connect()
    yield client
    client.close()


@pytest.fixture(autouse=True)
def owned(line):
    """Modbus owns the axis, long enough for a test."""
    assert line.libmodbus(16, 7, 1, 60000) == []


# Every register.


def test_both_clients_read_every_register_alike(line, pymodbus):
    steady = 0
    for objects, function, read in (
        (HOLDING, 3, pymodbus.read_holding_registers),
        (INPUT, 4, pymodbus.read_input_registers),
    ):
        for o in objects:
            first = line.libmodbus(function, o.modbus, width(o))
            answer = read(o.modbus, count=width(o), device_id=UNIT)
            assert not answer.isError(), o.name
            assert len(first) == len(answer.registers) == width(o), o.name
            if answer.registers == first:
                steady += 1
            else:
                assert o.access == "ro", f"{o.name}: {first} and {answer.registers}"
            value = from_words(o, answer.registers)
            in_range = o.min <= value <= o.max or o.type == "u32"
            assert in_range or o.kind == "command", o.name
    print(f"\n{len(HOLDING)} holding and {len(INPUT)} input objects, {steady} of them at rest")
    assert steady > len(HOLDING) + len(INPUT) // 2


# Values that the rules beyond a range allow.
VALUES = {
    "controlword": [6, 0],
    "force_bank": [0, 0],  # all banks are empty
    "cycle_program": [0, 0],  # there is no program
    "cycle_acknowledge": [0, 0],  # and no part
    "modes_of_operation": [-2, 8],
    "mode": [0, 0],
    "force_sign": [-1, 1],
    "position_min": [-2000, -1000],
    "position_max": [3000, 1000],
    "position_limit_min": [-2000, -(1 << 31)],
    "position_limit_max": [3000, (1 << 31) - 1],
    "quick_stop_option": [5, 2],
    "homing_method": [35, 37],
    "polarity": [0xC0, 0],
    "recorder_trigger_source": [0x202300, 0x202500],
    "watchdog": [50000, 60000],
    "modbus_word_order": [0, 0],
    **{f"recorder_signal_{i}": [0x202300 + 256 * i, 0x202500] for i in range(1, 9)},
}
COMMANDS = {
    "command_source",
    "cycle_unlock",
    "store_parameters",
    "restore_defaults",
    "excitation_run",
    "tare",
    "calibrate",
    "cycle_program_remove",
    "cycle_data_end",
    "program_control",
}


def test_what_one_client_writes_the_other_reads(line, pymodbus):
    written = 0
    for o in HOLDING:
        if o.name in COMMANDS:
            continue
        first, second = VALUES.get(o.name, [o.max, o.min])
        words = to_words(o, first)
        assert line.libmodbus(16, o.modbus, *words) == [], o.name
        answer = pymodbus.read_holding_registers(o.modbus, count=width(o), device_id=UNIT)
        assert answer.registers == words, o.name
        words = to_words(o, second)
        assert not pymodbus.write_registers(o.modbus, words, device_id=UNIT).isError(), o.name
        assert line.libmodbus(3, o.modbus, width(o)) == words, o.name
        if width(o) == 1:
            assert line.libmodbus(6, o.modbus, to_words(o, first)[0]) == [], o.name
            assert not pymodbus.write_register(o.modbus, words[0], device_id=UNIT).isError()
        written += 1
    assert written == len(HOLDING) - len(COMMANDS)


def test_every_range_is_enforced(line):
    refused = 0
    for o in HOLDING:
        bits = 16 * width(o)
        low, high = (
            (-(1 << bits - 1), (1 << bits - 1) - 1) if o.type[0] == "i" else (0, 2**bits - 1)
        )
        before = line.libmodbus(3, o.modbus, width(o))
        for value in (o.min - 1, o.max + 1):
            if low <= value <= high:
                answer = line.libmodbus(16, o.modbus, *to_words(o, value))
                assert answer == "exception 3", f"{o.name} = {value}"
                refused += 1
        assert line.libmodbus(3, o.modbus, width(o)) == before, o.name
    assert refused > 60


def test_word_order(line, pymodbus):
    target = BY_NAME["target_position"].modbus
    line.libmodbus(16, target, 0x1234, 0x5678)
    line.libmodbus(6, 0x01FF, 1)
    assert line.libmodbus(3, target, 2) == [0x5678, 0x1234]
    assert not pymodbus.write_registers(target, [7, 0], device_id=UNIT).isError()
    line.libmodbus(6, 0x01FF, 0)
    assert line.libmodbus(3, target, 2) == [0, 7]


def test_one_request_is_one_snapshot(line):
    """The bench moves the encoder one count a tick: their difference never changes."""
    seen, differences = set(), set()
    for _ in range(100):
        words = line.libmodbus(4, 0, 14)
        position, ticks = words[3] << 16 | words[4], words[10] << 16 | words[11]
        seen.add(ticks)
        differences.add((position - ticks) % 2**32)
    assert len(differences) == 1
    assert len(seen) > 50


# Exceptions.


def test_exceptions_as_documented(line, pymodbus):
    ask = line.libmodbus
    assert ask(3, 9, 1) == "exception 2"
    assert ask(4, 0x10, 1) == "exception 2"
    assert ask(3, 7, 3) == "exception 2"
    assert ask(6, 9, 0) == "exception 2"
    assert ask(1, 5, 1) == "exception 2"
    assert ask(2, 19, 1) == "exception 2"
    assert ask(6, 2, 1) == "exception 3"  # half of 32 bits
    assert ask(16, 1, 0, 0) == "exception 3"
    assert ask(6, 0x01F0, 0) == "exception 3"
    # One of several is out of range: none is written.
    gain = ask(3, 0x010C, 1)
    assert ask(16, 0x010C, 77, 0, 0, 0, 1, 0, 0, 7) == "exception 3"
    assert ask(3, 0x010C, 1) == gain
    # Locked: CANopen owns.
    assert ask(6, 7, 0) == []
    assert ask(6, 0x010C, 1) == "exception 4"
    assert ask(5, 0, 1) == "exception 4"
    assert pymodbus.write_register(7, 2, device_id=UNIT).exception_code == 4
    assert ask(6, 7, 1) == []
    # An unknown function code.
    assert pymodbus.read_fifo_queue(address=0, device_id=UNIT).exception_code == 1


def test_the_other_functions(line, pymodbus):
    assert line.libmodbus(6, 0x010C, 0x1234) == []
    assert line.libmodbus(22, 0x010C, 0xFF00, 0x0056) == []
    assert line.libmodbus(23, 0x010C, 1, 0x0114, 11, 22) == [0x1256]
    answer = pymodbus.readwrite_registers(
        read_address=0x0114, read_count=2, write_address=0x010C, values=[99], device_id=UNIT
    )
    assert answer.registers == [11, 22]
    assert not pymodbus.mask_write_register(
        address=0x010C, and_mask=0xFFF0, or_mask=5, device_id=UNIT
    ).isError()
    assert line.libmodbus(3, 0x010C, 1) == [0x65]
    assert bytes(line.libmodbus(17))[2:] == b"forceaxis"
    identity = pymodbus.read_device_information(read_code=3, object_id=0, device_id=UNIT)
    assert identity.information[0] == b"forceaxis"
    assert identity.information[2].startswith(b"0.")
    assert len(identity.information[0x80]) == 8
    assert pymodbus.diag_query_data(b"\x12\x34", device_id=UNIT).message == b"\x12\x34"
    assert not pymodbus.diag_read_bus_message_count(device_id=UNIT).isError()


# Coils and discrete inputs.


def test_coils_and_discrete_inputs(line, pymodbus):
    line.kill()  # limits set by other tests would stop the axis in motion
    line.power_up()
    assert line.libmodbus(16, 7, 1, 60000) == []
    assert line.libmodbus(6, BY_NAME["first_motion_test"].modbus, 0) == []  # nothing moves here
    assert line.libmodbus(6, 1, 8) == []
    assert line.libmodbus(5, 0, 1) == []
    time.sleep(0.05)
    status = line.libmodbus(4, 0, 1)[0]
    assert status & 0x6F == 0x27
    bits = line.libmodbus(2, 0, 19)
    assert bits[:16] == [status >> i & 1 for i in range(16)]
    assert pymodbus.read_discrete_inputs(0, count=19, device_id=UNIT).bits[:19] == [
        bool(b) for b in bits
    ]
    assert line.libmodbus(1, 0, 5) == [1, 0, 0, 0, 0]
    assert line.libmodbus(6, 0x010F, 1) == "exception 4"  # only while disabled
    assert line.libmodbus(5, 3, 1) == "exception 4"  # so is the store
    assert not pymodbus.write_coils(0, [False, False, True], device_id=UNIT).isError()
    time.sleep(0.05)
    assert pymodbus.read_coils(0, count=5, device_id=UNIT).bits[:5] == [0, 0, 1, 0, 0]
    assert line.libmodbus(15, 0, 0, 0, 0) == []
    time.sleep(0.05)
    assert line.libmodbus(4, 0, 1)[0] & 0x6F == 0x21


def test_the_curve_of_a_cycle_is_read_in_parts(line, tmp_path):
    """The encoder moves one count a tick, so the travel of each point is its time."""

    def write(name, raw):
        o = BY_NAME[name]
        return line.libmodbus(16, o.modbus, *to_words(o, raw))

    line.kill()
    line.power_up()
    assert write("command_source", 1) == [] and write("watchdog", 60000) == []
    assert write("first_motion_test", 0) == [] and write("cycle_curve_step_travel", 10) == []
    program = tmp_path / "waits.toml"
    program.write_text(WAITS)
    record = cycle_program(
        ROOT / "sim/experiments/press_fit.toml", with_program((), program)
    ).record
    for at in range(0, len(record), 64):
        piece = record[at : at + 64]
        words = [w for (v,) in struct.iter_unpack("<I", piece) for w in (v >> 16, v & 0xFFFF)]
        assert line.libmodbus(16, 0x040F, at, *words) == []
    assert write("cycle_data_end", len(record)) == [] and write("cycle_program", 7) == []
    stored = BY_NAME["cycle_store_state"].modbus
    wait_for("the store", lambda: line.libmodbus(4, stored, 1) == [1])
    assert write("modes_of_operation", -9) == []
    for word in (6, 7, 15, 31):
        assert write("controlword", word) == []
        time.sleep(0.02)
    assert line.libmodbus(23, 0x0410, 30, 0x0445, 0) == "exception 4"  # it runs
    state = BY_NAME["cycle_state"].modbus
    wait_for("the end of the cycle", lambda: line.libmodbus(4, state, 1) == [3])
    (count,) = line.libmodbus(4, BY_NAME["cycle_curve_points"].modbus, 1)
    points = []
    for first in range(0, count + 1, 5):
        words = line.libmodbus(23, 0x0410, 30, 0x0445, first)
        values = [high << 16 | low for high, low in zip(words[::2], words[1::2], strict=True)]
        points += zip(values[::3], values[1::3], values[2::3], strict=True)
    assert points[:count] == [(t, t, 0) for t in (*range(1, 451, 10), 450)]
    assert set(points[count:]) == {(0, 0, 0)}
    assert write("controlword", 0) == []
    mode = BY_NAME["active_mode"].modbus
    wait_for("the end of the power", lambda: line.libmodbus(4, mode, 1) == [0])


def test_what_is_stored_survives_a_kill(line):
    # A save in progress, some 60 ms on this bench: a machine that stalls requests too late.
    for _ in range(20):
        assert line.libmodbus(6, 0x010C, 4321) == []
        assert line.libmodbus(5, 3, 1) == []
        while_busy = line.libmodbus(6, 0x010C, 1)
        wait_for("the end of the save", lambda: line.libmodbus(1, 3, 1) == [0])
        if while_busy != []:
            break
    assert while_busy == "exception 6"
    assert line.libmodbus(3, 0x010C, 1) == [4321]
    assert line.libmodbus(4, BY_NAME["store_state"].modbus, 1) == [4]
    line.kill()
    line.power_up()
    assert line.libmodbus(4, BY_NAME["store_state"].modbus, 1) == [1]
    assert line.libmodbus(3, 0x010C, 1) == [4321]
    assert line.libmodbus(3, 7, 1) == [0], "the lock is not kept"
    assert line.libmodbus(16, 7, 1, 60000) == []
    assert line.libmodbus(6, 0x01F1, 1) == []
    wait_for("the end of it", lambda: line.libmodbus(4, 0x0152, 1) == [5])
    line.kill()
    line.power_up()
    assert line.libmodbus(3, 0x010C, 1) == [0]


# Silence.


def closed(*frame):
    """The frame and its CRC."""
    return bytes(frame) + FramerRTU.compute_CRC(bytes(frame)).to_bytes(2, "big")


REQUEST = closed(UNIT, 4, 0, 0, 0, 1)


class Raw:
    def __init__(self, path):
        self.file = os.open(path, os.O_RDWR | os.O_NOCTTY)

    def send(self, frame):
        os.write(self.file, frame)

    def received(self, seconds):
        """The bytes received until a silence of this length."""
        found = b""
        while select.select([self.file], [], [], seconds)[0]:
            found += os.read(self.file, 512)
        return found

    def answers(self):
        """Whether a valid request is answered within a second."""
        self.send(REQUEST)
        found = b""
        end = time.monotonic() + 1
        while len(found) < 7 and select.select([self.file], [], [], end - time.monotonic())[0]:
            found += os.read(self.file, 512)
        return len(found) == 7 and found[:3] == bytes([UNIT, 4, 2])


@pytest.fixture
def raw(line):
    made = Raw(line.ends[1])
    yield made
    os.close(made.file)


def test_foreign_units_get_no_answer(line, raw):
    gain = line.libmodbus(3, 0x010C, 1)
    for unit in range(1, 248):
        if unit == UNIT:
            continue
        raw.send(closed(unit, 4, 0, 0, 0, 1))
        raw.send(closed(unit, 6, 0x01, 0x0C, 0x0B, unit))
        time.sleep(0.001)
    assert raw.received(0.3) == b""
    assert raw.answers()
    assert line.libmodbus(3, 0x010C, 1) == gain
    assert line.libmodbus("unit", UNIT + 1) == []
    assert line.libmodbus(3, 0, 1).startswith("error")
    assert line.libmodbus("unit", UNIT) == []


def test_a_broadcast_is_carried_out_without_an_answer(line, raw):
    raw.send(closed(0, 6, 0x01, 0x0C, 0x11, 0x22))
    assert raw.received(0.2) == b""
    assert line.libmodbus(3, 0x010C, 1) == [0x1122]


def test_corrupted_and_truncated_frames_get_no_answer(line, raw):
    write = closed(UNIT, 6, 0x01, 0x0C, 0x33, 0x44)
    gain = line.libmodbus(3, 0x010C, 1)
    bad = []
    for bit in range(8 * len(write)):
        frame = bytearray(write)
        frame[bit // 8] ^= 1 << bit % 8
        bad.append(bytes(frame))
    bad += [write[:n] for n in range(1, len(write))]
    bad += [write[:-2] + bytes(n) for n in (3, 100, 300)]
    rng = random.Random(SEED)
    bad += [rng.randbytes(rng.randint(1, 300)) for _ in range(50)]
    for frame in bad:
        raw.send(frame)
        time.sleep(SILENCE_S)
    assert raw.received(0.2) == b""
    assert raw.answers()
    assert line.libmodbus(3, 0x010C, 1) == gain
    print(f"\n{len(bad)} broken frames, no answer")
