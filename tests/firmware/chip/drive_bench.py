"""An axis on a CiA 402 drive for tests: the released image with the drive at its second CAN, the
same firmware and master in process, and a drive of another program (python-canopen) in step."""

import contextlib
import ctypes
import hashlib
import struct

import can
import pytest
from can.interfaces.virtual import VirtualBus
from chip import Chip, release
from cortex_m4 import ROOT, Inputs, build_library
from forceaxis.objects import BY_NAME
from foreign_drive import DRIVE, ForeignDrive, StepBus
from unicorn import UC_HOOK_CODE, arm_const

MASTER = 127
BITS = 12
SUPPLY_V = 3.3
# Count at which the drive is in contact, and codes of force per count of position.
GAP, STIFFNESS = 60, 8
SETTINGS = {
    "drive_node_id": DRIVE, "drive_target_num": 20, "drive_target_max": 20000, "drive_cycle": 1,
}  # fmt: skip
LAW = {
    "adc_bits": BITS, "force_tare": 128 * 256, "force_gain": 512, "force_setpoint": 40 * 256,
    "bump_decay_shift": 0, "approach_velocity_max": 2000, "drive_on_ticks_max": 9000,
}  # fmt: skip
FORCE = BY_NAME["mode"].enum.index("force")


def stored(settings):
    """The flash of a chip that has saved these parameters."""
    chip = release(Chip())
    for name, value in settings.items():
        assert chip.write(name, value) == 0, name
    assert chip.write("store_parameters", 1) == 0
    saving, saved = map(BY_NAME["store_state"].enum.index, ("saving", "saved"))
    while chip.read("store_state") == saving:
        chip.tick()
    assert chip.read("store_state") == saved
    return chip.board.flash.bytes


class Record(ctypes.Structure):
    _fields_ = [
        ("code", ctypes.c_int16),
        ("amplifier", ctypes.c_uint8),
        ("brake", ctypes.c_uint8),
        ("fine", ctypes.c_int16),
    ]


class Frame(ctypes.Structure):
    _fields_ = [
        ("id", ctypes.c_uint16),
        ("length", ctypes.c_uint8),
        ("remote", ctypes.c_uint8),
        ("data", ctypes.c_uint8 * 8),
    ]


class Drive(ForeignDrive):
    """The drive with what it presses on: the force is a code of 12 bits."""

    master = MASTER

    def force_code(self):
        return min(2048 + round(STIFFNESS * max(0.0, self.position - GAP)), 4095)


class Trace:
    """The hash of a run, as docs/design has it, and its columns."""

    def __init__(self):
        self.digest, self.ticks = hashlib.sha256(), []

    def add(self, inputs, outputs):
        tick = len(self.ticks)
        out = outputs.amplifier | outputs.brake << 1
        self.digest.update(
            struct.pack(
                "<IiHHBhB",
                tick,
                inputs.encoder_cnt,
                *inputs.adc_code,
                inputs.din,
                outputs.code,
                out,
            )
        )
        self.ticks.append((inputs.encoder_cnt, inputs.adc_code[0], inputs.drive, outputs.code, out))

    def hash(self):
        return self.digest.hexdigest()


class Process:
    """Firmware and master, compiled for this machine."""

    def __init__(self, settings, joins_after):
        """`joins_after`: ticks until the controller has joined the bus."""
        self.joins_after = joins_after
        drive402 = sorted((ROOT / "firmware/drive402").glob("*.c"))
        own = [ROOT / "firmware/port/bus_drive.c", ROOT / "tests/firmware/chip/drive_axis.c"]
        self.lib = build_library("driveaxis", *drive402, *own)
        numbers = [BY_NAME[name].number for name in settings]
        many = ctypes.c_int32 * len(settings)
        self.lib.begin(many(*numbers), many(*settings.values()), len(settings))
        self.trace, self.frame = Trace(), Frame()

    def write(self, name, value):
        return self.lib.object_write(BY_NAME[name].number, value)

    def read(self, name):
        return self.lib.object_read(BY_NAME[name].number)

    def receive(self, can_id, data):
        full = (ctypes.c_uint8 * 8)(*data.ljust(8, b"\0"))
        self.lib.receive(ctypes.byref(Frame(can_id, len(data), 0, full)))

    def take(self, force_code):
        return self.tick(force_code, 0)

    def tick(self, force_code, force_age):
        inputs, outputs = Inputs(0, (force_code, 0), 1, 1, 0, 0, force_age), Record()
        has_joined = len(self.trace.ticks) >= self.joins_after
        self.lib.tick(ctypes.byref(inputs), ctypes.byref(outputs), BITS, has_joined)
        self.trace.add(inputs, outputs)
        sent = []
        while self.lib.transmit(ctypes.byref(self.frame)) & 0xFF:
            data = bytes(self.frame.data)[: self.frame.length]
            sent.append((self.frame.id, data))
        return sent


def frames_of(chip, interrupts):
    """What the chip sends on its second CAN until no frame waits."""
    second = chip.board.can2
    interrupts()
    while second.requests and second.connected() and not second[0x18] & 4:
        second.transmit()
        interrupts()
    sent = [(can_id, data) for can_id, data, _ in second.sent]
    second.sent.clear()
    return sent


class Board:
    """The released image with stored settings, in front of the models of its peripherals."""

    def __init__(self, settings, converter=None):
        """`converter`: model of the one at SPI2 (converters.py)."""
        self.chip = Chip(stored(settings))
        self.chip.board.converter = converter
        self.ages = set()  # of the force
        self.trace = Trace()
        self.chip.close_contacts()
        self.chip.boot()
        for name, what in (("fw_control", self._control), ("port_act", self._act)):
            at = self.chip.symbols[name]
            self.chip.uc.hook_add(UC_HOOK_CODE, what, None, at, at)

    def _control(self, uc, *_):
        at = uc.reg_read(arm_const.UC_ARM_REG_R1)
        self.inputs = Inputs.from_buffer_copy(uc.mem_read(at, ctypes.sizeof(Inputs)))

        self.ages.add(self.inputs.force_age)

    def _act(self, uc, *_):
        at = uc.reg_read(arm_const.UC_ARM_REG_R0)
        self.trace.add(self.inputs, Record.from_buffer_copy(uc.mem_read(at, ctypes.sizeof(Record))))

    def write(self, name, value):
        return self.chip.write(name, value)

    def read(self, name):
        return self.chip.read(name)

    def receive(self, can_id, data):
        self.chip.board.can2.receive(can_id, data)
        self.chip.interrupts()

    def take(self, force_code):
        self.chip.board.adc.volts[6] = (force_code + 0.5) / 4096 * SUPPLY_V
        self.chip.tick()
        return frames_of(self.chip, self.chip.interrupts)


class Bench:
    """An axis, its drive and the bus between them, in step."""

    def __init__(self, axis, channel):
        self.axis, self.bus = axis, VirtualBus(channel)
        self.drive = Drive(StepBus(channel))
        self.ticks = 0
        self.deaf = False  # what the drive sends is lost
        self.commands, self.first = [], None  # RPDOs; number of the tick with the first frame

    def tick(self, ticks=1):
        for _ in range(ticks):
            self.ticks += 1
            while (message := self.bus.recv(timeout=0)) is not None:
                if not self.deaf:
                    self.axis.receive(message.arbitration_id, bytes(message.data))
            for can_id, data in self.axis.take(self.drive.force_code()):
                self.first = self.first or self.ticks
                if can_id == 0x200 + DRIVE:
                    self.commands.append(struct.unpack("<Hi", data))
                self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
            self.drive.tick()

    def until(self, done, most):
        for ticks in range(most):
            if done():
                return ticks
            self.tick()
        pytest.fail(f"not in {most} ticks")

    def fault(self):
        return BY_NAME["fault"].enum[self.axis.read("fault")]

    def close(self):
        self.drive.bus.shutdown()
        self.bus.shutdown()


@contextlib.contextmanager
def bench(axis, channel):
    made = Bench(axis, channel)
    try:
        yield made
    finally:
        made.close()
