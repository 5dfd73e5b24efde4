"""A machine that touches a workpiece, simulated by a program of its own: a Runge-Kutta method with
a fixed step in plain Python, which shares no code with the simulator of the project. A force law of
its own presses, and the DAC codes that the law has put out are recorded with force and position."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

TICK_S = 1 / 1500
GAP_M = 0.002  # distance of the workpiece at the start
POWER_M = 1e-4  # overlap in m at which the force does not depend on the exponent of the contact
PARTS = 16  # steps of the method in a tick
DAC_VOLTS_PER_CODE = 20 / 4096


@dataclass(frozen=True)
class Machine:
    """Constants in SI units. The elements with the value 0 are not there."""

    m_r: float = 20.0
    b_r: float = 400.0
    k_act: float = 8000.0
    a_act: float = 600.0
    speed_per_volt: float = 0.02
    k_s: float = 2e5
    b_s: float = 60.0
    m_w: float = 3.0
    k_w: float = 4e5
    b_w: float = 150.0
    f_c: float = 0.0  # dry friction of the guide in N
    # Friction law of Stribeck: f_c (1 + stribeck exp(-(v / slow)^2)), with `slow` in m/s.
    stribeck: float = 0.0
    slow: float = 0.01
    lag_rad_s: float = 0.0  # corner of the sensor's filter
    # Exponent of the force of the contact over its overlap; the force at 0.1 mm stays the same.
    power: float = 1.0
    k_core: float = 0.0  # stiffness that a stiffening contact adds behind `core_gap`
    core_gap: float = 0.0
    slip_stiffness: float = 0.0  # spring of a dry slider beside the contact
    slip_force: float = 0.0
    rotor: float = 0.0  # part of m_r in front of a backlash
    play: float = 0.0
    k_play: float = 5e6

    def but(self, **changed):
        return replace(self, **changed)


@dataclass(frozen=True)
class Sensors:
    """Converters of force and position, and rms noise of the force in N."""

    per_count: float = 0.05
    bits: int = 12
    noise: float = 0.05
    scale: float = 1e6  # counts of the encoder per metre
    offset: float = 0.0  # N


@dataclass(frozen=True)
class Touch:
    """Codes, force in N and position in m at the ticks of one touch-down, and its true force."""

    codes: np.ndarray
    force_N: np.ndarray
    position_m: np.ndarray
    true_N: np.ndarray

    @property
    def time_s(self):
        return np.arange(len(self.codes)) * TICK_S


class _State:
    """Motion of stage, workpiece, drive and sensor. `slip` is the deflection of the dry slider."""

    def __init__(self, machine, gap_m):
        self.y = [-gap_m, 0.0, 0.0, 0.0, 0.0, 0.0, -gap_m, 0.0]
        self.slip = 0.0
        self.was = 0.0  # overlap of the contact a step before
        self.sticks, self.slides = False, 1.0
        self.machine = machine

    def contact(self, y):
        m = self.machine
        overlap, rate = y[0] - y[2], y[1] - y[3]
        spring, damping = 0.0, 0.0
        if overlap > 0:
            pushed = m.k_s * overlap
            if m.power != 1.0:
                pushed *= (overlap / POWER_M) ** (m.power - 1)
            if pushed + m.b_s * rate > 0:
                spring, damping = pushed, m.b_s * rate
        if m.slip_stiffness and overlap > 0:
            bound = m.slip_force / m.slip_stiffness
            e = min(max(self.slip + overlap - self.was, -bound), bound)
            spring = max(0.0, m.k_s * overlap + m.slip_stiffness * e)
            damping = 0.0
        if m.k_core and overlap > m.core_gap:
            spring += m.k_core * (overlap - m.core_gap)
        return spring, damping

    def play_force(self, y):
        m = self.machine
        d = y[6] - y[0]
        half = m.play / 2
        return m.k_play * (d - half) if d > half else m.k_play * (d + half) if d < -half else 0.0

    def sliding(self, speed):
        """Returns the size of the dry friction at a speed."""
        m = self.machine
        return m.f_c * (1 + m.stribeck * math.exp(-((speed / m.slow) ** 2)) if m.stribeck else 1.0)

    def rates(self, y, volts):
        m = self.machine
        spring, damping = self.contact(y)
        force = spring + damping
        drive = y[4]
        motor_speed = y[7] if m.rotor else y[1]
        pushed = self.play_force(y) if m.rotor else drive
        slide = pushed - m.b_r * y[1] - force
        friction = 0.0
        if m.f_c:
            friction = slide if self.sticks else self.sliding(y[1]) * self.slides
        mass = m.m_r - m.rotor
        read = y[5]
        return [
            y[1],
            (slide - friction) / mass,
            y[3],
            (force - m.k_w * y[2] - m.b_w * y[3]) / m.m_w,
            m.a_act * (m.k_act * (m.speed_per_volt * volts - motor_speed) - drive),
            m.lag_rad_s * (spring - read) if m.lag_rad_s else 0.0,
            y[7],
            (drive - pushed) / m.rotor if m.rotor else 0.0,
        ]

    def step(self, volts, h):
        m, y = self.machine, self.y
        if m.f_c:
            spring, damping = self.contact(y)
            pushed = self.play_force(y) if m.rotor else y[4]
            wanted = pushed - m.b_r * y[1] - spring - damping
            self.sticks = y[1] == 0.0 and abs(wanted) <= self.sliding(0.0)
            self.slides = math.copysign(1.0, y[1] or wanted)
        k1 = self.rates(y, volts)
        k2 = self.rates([a + h / 2 * b for a, b in zip(y, k1, strict=True)], volts)
        k3 = self.rates([a + h / 2 * b for a, b in zip(y, k2, strict=True)], volts)
        k4 = self.rates([a + h * b for a, b in zip(y, k3, strict=True)], volts)
        new = [
            a + h / 6 * (p + 2 * q + 2 * r + s)
            for a, p, q, r, s in zip(y, k1, k2, k3, k4, strict=True)
        ]
        if m.f_c and not self.sticks and y[1] * new[1] < 0 and h > 1e-9:
            # The velocity passes 0, where friction can hold the stage: the step ends there.
            share = y[1] / (y[1] - new[1])
            self.step(volts, share * h)
            self.y[1] = 0.0
            self.step(volts, (1 - share) * h)
            return
        overlap = new[0] - new[2]
        if m.slip_stiffness:
            if overlap > 0:
                bound = m.slip_force / m.slip_stiffness
                self.slip = min(max(self.slip + overlap - self.was, -bound), bound)
                self.was = overlap
            elif self.was > 0:
                self.slip, self.was = 0.0, 0.0
        self.y = new


def touch(machine, sensors, seed, *, speed=0.03, force=40.0, gain=0.02, ticks=400):
    """Simulates one touch-down: approach at `speed` in m/s, then a law that presses with `force` in
    N by a speed proportional to the error, `gain` in V/N."""
    return phases(machine, sensors, seed, gain, [(speed, force, ticks)])


def phases(machine, sensors, seed, gain, each):
    """Simulates phases of the law one after the other: (speed, force, ticks) of each."""
    rng = np.random.default_rng(seed)
    state = _State(machine, GAP_M)
    codes, read, place, true = [], [], [], []
    home = rng.uniform(-0.5, 0.5) / sensors.scale
    laws = [[(speed / machine.speed_per_volt, force)] * ticks for speed, force, ticks in each]
    for limit, force in itertools.chain(*laws):
        y = state.y
        spring, damping = state.contact(y)
        reading = (y[5] if machine.lag_rad_s else spring) + sensors.offset
        reading += sensors.noise * rng.standard_normal()
        count = math.floor(reading / sensors.per_count + 0.5)
        top = 1 << (sensors.bits - 1)
        count = min(max(count, -top), top - 1)
        measured = count * sensors.per_count
        volts = min(max(gain * (force - measured), -limit), limit)
        code = round(volts / DAC_VOLTS_PER_CODE)
        codes.append(code)
        read.append(measured)
        motor = y[6] if machine.rotor else y[0]
        place.append(math.floor((motor + home) * sensors.scale + 0.5) / sensors.scale)
        true.append(spring + damping)
        for _ in range(PARTS):
            state.step(code * DAC_VOLTS_PER_CODE, TICK_S / PARTS)
    return Touch(np.array(codes), np.array(read), np.array(place), np.array(true))
