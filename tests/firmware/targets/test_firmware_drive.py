"""The drive profile on an emulated Cortex-M4 and RV32 beside the host: the same outputs and signals
under random masters, on the Cortex-M4 within its share of the interrupt.

Run with `pytest -s` to see the instruction counts by mode.
"""

import random

import draws
import pytest
from forceaxis.objects import BY_NAME
from test_firmware_targets import (  # noqa: F401 (built is a fixture)
    CORTEX_M4,
    RV32,
    Emulator,
    Host,
    Inputs,
    Outputs,
    built,
    ctypes,
    run,
)

pytestmark = pytest.mark.beside

INSTRUCTIONS_MAX = 850  # of cia402_before() and cia402_after() together
TICK_MAX = 1340  # of fw_tick() with the drive, without buses
TICKS = 4_000
SEED = 402
COMMANDS = [0x00, 0x02, 0x06, 0x07, 0x0F, 0x0F, 0x0F, 0x1F, 0x3F, 0x5F, 0x10F, 0x80, 0x20F, 0x21F]
MODES = [1, 3, 4, 6, 8, 9, 10, 0, -1, -2, -4, -5, -6, -7, -8, -9]
RANGES = {
    "target_position": [0, 100, -3000, 50000, 2147483647, -2147483648],
    "target_velocity": [0, 1, -3000, 15000, 3072000, -3072000],
    "target_force": [0, 100, 750, -500, 32767, -32768],
    "trajectory_velocity": [1, 3000, 30000, 3072000],
    "trajectory_acceleration": [35, 225000, 575000000],
    "trajectory_deceleration": [2250, 225000, 575000000],
    "quick_stop_deceleration": [225000, 2250000, 575000000],
    "velocity_max": [15000, 300000, 3072000, 3072000],
    "quick_stop_option": [0, 1, 2, 5, 6],
    "fault_reaction_option": [0, 1, 2],
    "halt_option": [1, 2],
    "position_limit_min": [-2147483648, -2147483648, -4000],
    "position_limit_max": [2147483647, 2147483647, 6000],
    "following_error_window": [0xFFFFFFFF, 0xFFFFFFFF, 2000],
    "interpolation_period": [0, 2, 20],
    "stiffness": [0, 32768, 2147483647],
    "damping": [0, 1280, 2147483647],
    "force_scale": [1, 2500000, 2147483647],
    "rated_force": [1, 100000, 2147483647],
    "force_slope": [1, 10000, 2147483647],
    "approach_velocity_max": [1, 3000, 3072000],
    "home_offset": [0, 1234, -2147483648],
    "polarity": [0, 0, 64, 128, 192],
}
# Of a master that presses, and what it wants of the force modes.
PRESSING = {
    "controlword": [0x00],
    "polarity": [0],
    "force_scale": [2500000],
    "rated_force": [100000],
    "force_slope": [10000],
    "approach_velocity_max": [3000],
    "position_limit_min": [-2147483648],
    "position_limit_max": [2147483647],
    "following_error_window": [0xFFFFFFFF],
    "stiffness": [64, 512],
    "damping": [64, 512],
    "contact_loss_dwell": [0, 20, 300],
    "contact_loss_cap": [0, 40, 2048],
    "modes_of_operation": [4, 10, -1, -6, -7, -8],
}
PHASE_TICKS = 250
FORCE = BY_NAME["active_mode"].enum.index("force")
ONES_OF = ("drive_",)


class CountingEmulator(Emulator):
    """Counts what lies in the drive's own files, and all of it, apart."""

    def __init__(self, image, target, ranges):
        self.ranges, self.drive = ranges, 0
        super().__init__(image, target)

    def on_block(self, uc, address, size, data):
        before = self.count
        super().on_block(uc, address, size, data)
        if any(first <= address < end for first, end in self.ranges):
            self.drive += self.count - before

    def tick(self, inputs):
        self.drive = 0
        self.uc.mem_write(self.INPUTS, bytes(inputs))
        self.call("fw_tick", self.FW, self.INPUTS, self.OUTPUTS)
        return bytes(self.uc.mem_read(self.OUTPUTS, ctypes.sizeof(Outputs)))

    def read(self, number):
        assert self.call("fw_object_read", self.FW, number, self.OUTPUTS + 16) == 0
        return int.from_bytes(self.uc.mem_read(self.OUTPUTS + 16, 4), "little", signed=True)


def drive_ranges(objects, image, target):
    """Address ranges of the functions in the drive's object files, and of what only it calls."""
    names = {"axis_parameter_written"}
    for path in objects:
        if path.name.startswith(ONES_OF):
            for line in run(target.prefix + "nm", path).splitlines():
                *_, kind, name = line.split()
                if kind in "tT":
                    names.add(name)
    ranges = []
    for line in run(target.prefix + "nm", "-S", image).splitlines():
        words = line.split()
        if len(words) == 4 and words[2] in "tT" and words[3] in names:
            ranges.append((int(words[0], 16), int(words[0], 16) + int(words[1], 16)))
    return ranges


class Master:
    """Writes that a master might do in any tick; the same ones to both."""

    def __init__(self, *sides):
        self.sides = sides

    def write(self, name, value):
        results = {side.write(BY_NAME[name].number, value) for side in self.sides}
        assert len(results) == 1, f"{name} {value}: {results}"


def press(master, rng, tick, is_on, position):
    """What a master that presses writes before a tick: all in the first one of its phase, then what
    it wants, and the way there where the axis is off."""
    if tick % PHASE_TICKS == 0:
        for name, values in PRESSING.items():
            master.write(name, rng.choice(values))
    if tick % 16 != PHASE_TICKS % 16:
        return
    for command in () if is_on else (0x80, 0x00, 0x06, 0x0F):
        master.write("controlword", command)
    force = rng.choice([600] * 12 + [200, 0, -100])
    master.write("target_force", force)
    master.write("force_setpoint", force // 40 * 256)
    master.write("target_position", int(position) + force // 10)
    master.write("target_velocity", 5 * force)


# With --all one of them, drawn by the commit, runs three times as long.
LONGER = draws.some("targets", [CORTEX_M4, RV32], 1)


@pytest.mark.parametrize(
    ("target", "ticks"),
    [
        pytest.param(CORTEX_M4, TICKS, id="Cortex-M4"),
        *(
            pytest.param(t, 3 * TICKS, marks=pytest.mark.long, id=f"longer {t.name}")
            for t in LONGER
        ),
    ],
)
def test_targets_run_the_drive_as_the_host_does(built, target, ticks, tmp_path):  # noqa: F811
    compiled, image = built(target)
    host = Host(tmp_path)
    chip = CountingEmulator(image, target, drive_ranges(compiled, image, target))
    master = Master(host, chip)
    signals = [o for o in BY_NAME.values() if o.part == "drive" and o.kind == "signal"]
    rng = random.Random(SEED)
    master.write("position_gain", 1280)
    master.write("force_gain", 640)
    worst = {}
    whole = 0
    inputs = Inputs(0, (0, 0), 1, 1)
    position, speed, wall, law = 0.0, 0.0, 3000.0, 0
    for tick in range(ticks):
        # In every second phase the master presses, and the rest is rare.
        presses = tick // PHASE_TICKS % 2 == 1
        often = 0.02 if presses else 1.0
        if presses:
            press(master, rng, tick, host.read(BY_NAME["active_mode"].number) != 0, position)
        if rng.random() < 0.03 * often:
            master.write("modes_of_operation", rng.choice(MODES))
        if rng.random() < 0.2 * often:
            master.write("controlword", rng.choice(COMMANDS))
        if rng.random() < 0.03 * often:
            for command in (0x00, 0x80, 0x06, 0x0F):
                master.write("controlword", command)
        if rng.random() < 0.2 * often:
            name = rng.choice(list(RANGES))
            master.write(name, rng.choice(RANGES[name]))
        if rng.random() < 0.01:
            wall = position + (rng.choice([-40, -10, 10]) if presses else rng.randint(-50, 2000))
        code = int.from_bytes(bytes(host.outputs)[:2], "little", signed=True)
        speed += 0.2 * (code / 50.0 - speed)
        position += speed
        if abs(position) > 2e9:
            position = 0.0
        inputs.encoder_cnt = int(position)
        inputs.adc_code[0] = max(0, min(255, int((position - wall) / 2)))
        inputs.din = 1 if rng.random() > 0.002 else rng.choice([0, 3, 5, 9])
        inputs.sensor_valid = int(rng.random() >= 0.001)

        host.lib.fw_tick(host.fw, ctypes.byref(inputs), ctypes.byref(host.outputs))
        got = chip.tick(inputs)
        replay = f"seed {SEED}, tick {tick}"
        assert got == bytes(host.outputs), replay
        counted, total = chip.drive, chip.count
        state = host.read(BY_NAME["drive_state"].number)
        mode = host.read(BY_NAME["modes_of_operation_display"].number) if state == 4 else None
        worst[mode] = max(worst.get(mode, 0), counted)
        whole = max(whole, total)
        law += host.read(BY_NAME["active_mode"].number) == FORCE
        if tick % 16 == 0:
            for signal in signals:
                assert chip.read(signal.number) == host.read(signal.number), (replay, signal.name)
    print(f"\ncia402 on {target.name}, {ticks} ticks under a random master, instructions at most:")
    for mode in sorted(worst, key=str):
        print(f"  {'not enabled' if mode is None else f'mode {mode}':12} {worst[mode]}")
    print(f"  fw_tick without buses {whole}")
    assert set(MODES) <= set(worst)
    assert law > ticks / 3, "the force law is on in a third of the ticks"
    if target == CORTEX_M4:
        assert max(worst.values()) <= INSTRUCTIONS_MAX
        assert whole <= TICK_MAX
