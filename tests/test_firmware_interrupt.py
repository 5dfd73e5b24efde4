"""What the whole interrupt costs on an emulated Cortex-M4: drive, axis, recorder, CANopen, Modbus.

A plain axis in front of a wall, profile position and torque, default PDOs with SYNC every 15 ticks
and an RPDO now and then, six recorder channels, Modbus requests. Run with `pytest -s` for figures.
"""

import random
import struct

import pytest
from test_firmware_targets import (  # noqa: F401 (fixtures)
    LOCAL,
    Emulator,
    Inputs,
    built,
    cortex_m4,
    load_objects,
)

TICK_MAX = 1300  # fw_tick() as a whole; tests/chip/test_budget.py has its two halves apart
NODE = 5
TICKS = 6000
CHANNELS = [0x202000, 0x202300, 0x202400, 0x202500, 0x606400, 0x607700]


class Chip(Emulator):
    FRAME, BYTES = Emulator.INPUTS + 0x200, Emulator.INPUTS + 0x300

    def start(self):
        config = struct.pack("<IIIIIIBB2x", 0x20008000, 12288, 0, 0, 0, 0, NODE, 1)
        self.uc.mem_write(self.CONFIG, config)
        self.call("fw_init", self.FW, self.CONFIG)

    def receive(self, can_id, data):
        self.uc.mem_write(
            self.FRAME, struct.pack("<HBB", can_id, len(data), 0) + data.ljust(8, b"\0")
        )
        self.call("fw_can_receive", self.FW, self.FRAME)
        return self.count

    def drain(self):
        frames = 0
        while self.call("fw_can_transmit", self.FW, self.FRAME) & 0xFF:
            frames += 1
        return frames

    def modbus(self, data):
        self.uc.mem_write(self.BYTES, data)
        self.call("fw_modbus_receive", self.FW, self.BYTES, len(data))
        count = self.count
        self.call("fw_modbus_transmit", self.FW, self.BYTES, 256)
        return count

    def set(self, number, value):
        assert self.call("fw_object_write", self.FW, LOCAL, number, value) == 0

    def tick(self, inputs):
        self.uc.mem_write(self.INPUTS, bytes(inputs))
        self.call("fw_tick", self.FW, self.INPUTS, self.OUTPUTS)
        return self.count


def crc(frame):
    value = 0xFFFF
    for byte in frame:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return frame + value.to_bytes(2, "little")


@pytest.mark.parametrize("mode", [1, 4])
def test_the_whole_tick_fits_into_the_interrupt(cortex_m4, mode):  # noqa: F811
    objects = load_objects()
    chip = Chip(cortex_m4[1])
    chip.start()
    rng = random.Random(5)

    def set_(name, value):
        chip.set(objects[name].number, value)

    set_("position_gain", 1280)
    set_("force_gain", 640)
    for i, address in enumerate(CHANNELS):
        set_(f"recorder_signal_{i + 1}", address)
    chip.receive(0, bytes([1, NODE]))
    set_("modes_of_operation", mode)
    for word in (0x06, 0x07, 0x0F):
        set_("controlword", word)
    position, speed, wall = 0.0, 0.0, 2000.0
    inputs = Inputs(0, (0, 0), 1, 1)
    ticks, others = [], {"sync": 0, "rpdo": 0, "sdo": 0, "modbus": 0}
    read = crc(bytes([NODE, 4, 0, 0, 0, 14]))
    for tick in range(TICKS):
        if tick % 15 == 0:
            others["sync"] = max(others["sync"], chip.receive(0x80, b""))
        if tick % 50 == 7:
            word = 0x0F | (0x10 if tick % 100 == 7 else 0)
            target = rng.randint(0, 2500)
            rpdo, value = (0x305, target) if mode == 1 else (0x505, rng.randint(-200, 600))
            data = struct.pack("<Hi", word, value) if mode == 1 else struct.pack("<Hh", word, value)
            others["rpdo"] = max(others["rpdo"], chip.receive(rpdo, data))
        if tick % 60 == 11:
            cost = chip.receive(0x600 + NODE, bytes.fromhex("4041600000000000"))
            others["sdo"] = max(others["sdo"], cost)
        if tick % 70 == 13:
            others["modbus"] = max(others["modbus"], chip.modbus(read))
        if tick % 1500 == 20:
            chip.write(objects["recorder_arm"].number, 1)
        ticks.append(chip.tick(inputs))
        code = struct.unpack("<h", bytes(chip.uc.mem_read(chip.OUTPUTS, 2)))[0]
        chip.drain()
        speed += 0.2 * (code / 50.0 - speed)
        position += speed
        inputs.encoder_cnt = int(position)
        inputs.adc_code[0] = max(0, min(255, int((position - wall) / 2)))
    ordered = sorted(ticks)
    worst = ", ".join(f"{name} {count}" for name, count in others.items())
    print(
        f"\nmode {mode}: fw_tick at most {ordered[-1]}, 99 % {ordered[len(ordered) * 99 // 100]}, "
        f"median {ordered[len(ordered) // 2]} instructions; between ticks at most: {worst}"
    )
    assert ordered[-1] <= TICK_MAX
