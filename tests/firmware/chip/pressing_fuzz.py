"""The random master of tick_fuzz.py, on an axis that presses, bounces and is struck."""

import random
import struct

from tick_fuzz import Fuzz, signed

MODES = (4, 4, 10, 10, -1, -6, -7, -8)
TICKS = 400
LAW = {
    "position_gain": [1280],
    "adc_bits": [8],
    "force_zero_code": [0],
    "force_sign": [1],
    "contact_force": [512],
    "force_gain": [256, 1280, 3840],
    "force_slope": [10000, 1000000],
    "rated_force": [100000],
    "force_scale": [2500000],
    "force_limit": [1000, 400],
    "force_max": [0, 0, 51200],
    "bump_decay_shift": [0, 6, 12],
    "latency_ticks": [0, 1],
    "contact_loss_dwell": [0, 20, 300],
    "contact_loss_cap": [0, 40, 2048],
    "approach_velocity_max": [3000, 15000],
    "touch_velocity_max": [0, 600, 3000],
    "stiffness": [64, 512],
    "damping": [64, 512],
    "limit_cycle_losses": [0],
}


class PressingFuzz(Fuzz):
    """The same, but in most scenarios the master presses on a wall that gives way and comes back,
    in every force mode, and the rest happens now and then."""

    def __init__(self, objects, seed):
        super().__init__(objects, seed)
        self.press_rng = random.Random(seed + 5)
        self.presses = False

    def start_scenario(self, side):
        super().start_scenario(side)
        self.presses = not self.calm and self.press_rng.random() < 0.9
        if not self.presses:
            return
        self.scenario_end = self.tick_number + TICKS
        self.wall = self.position + 30
        self.set(side, "controlword", 0)
        for name, values in LAW.items():
            self.set(side, name, self.press_rng.choice(values))
        self.mode = self.press_rng.choice(MODES)
        self.set(side, "modes_of_operation", self.mode)
        self.press(side)

    def press(self, side):
        """What the master wants of the force modes, and the way there."""
        if side.outputs[2] == 0:
            for word in (0x80, 0x00, 0x06, 0x0F):
                self.set(side, "controlword", word)
        force = self.press_rng.choice([600] * 12 + [200, 0, -100])
        self.set(side, "target_force", force)
        self.set(side, "force_setpoint", force // 40 * 256)
        self.set(side, "target_position", int(self.position) + force // 10)
        self.set(side, "target_velocity", 5 * force)

    def step(self, side, inputs):
        if not self.presses or self.tick_number == self.scenario_end:
            super().step(side, inputs)
            return
        self.tick_number += 1
        if self.tick_number % 16 == 0:
            self.press(side)
        if self.press_rng.random() < 0.02:
            self.command(side)
            self.frames(side)
            self.accidents(side)
        code = struct.unpack("<h", side.outputs[:2])[0]
        self.speed += 0.2 * (code / 50.0 - self.speed)
        # The wall stops what runs into it, and is struck.
        self.speed -= max(0.0, self.position - self.wall) * 0.05
        self.position += self.speed
        if self.press_rng.random() < 0.01:
            self.wall = self.position + self.press_rng.choice([-40, -10, 10, 40])
        inputs.encoder_cnt = signed(int(self.position))
        inputs.adc_code[0] = max(0, min(255, int(self.position - self.wall)))
        inputs.adc_code[1] = 100
        inputs.din = 1
        inputs.sensor_valid = int(self.press_rng.random() >= 0.001)
        self.report_drive(side.outputs, inputs)
