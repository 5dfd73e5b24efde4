"""Data sheet of a new axis: the fields, the default of each field, and derived values."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from forceaxis import paths, toml
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.results import from_json

GRAVITY_M_PER_S2 = 9.81
LATENCY_MAX_MS = 60.0  # with a sample of 100 ms, the firmware measures the age of a reading
# default speed of a stepper axis; a stepper's torque falls with the speed
STEPPER_SPEED_M_PER_S = 0.05

# An answer of the user: a number, the name of a choice, or None.
# None stands for the text `word` of a field, and for a field that has no effect.
Answer = float | str | None
# Function that computes the default of a field from the values of the earlier fields.
DefaultValue = Callable[["SheetValues"], float]
# {name of a field: choices of this field}.
# Another field with this condition has an effect only if the named field has one of the choices.
Only = Mapping[str, tuple[str, ...]]
ANY: Only = {}


@dataclass(frozen=True)
class SheetField:
    """One field of a data sheet: the question to the user, the check of the answer, and the default
    value."""

    part: str  # component of the axis to which the field belongs, such as "motor"
    unit: str
    low: float  # smallest accepted number
    high: float  # largest accepted number
    default: float | DefaultValue | None  # default value; None means the text `word`
    why: str  # reason for the default value
    # question to the user: the quantity, and the section of data sheets that states the quantity
    ask: str
    word: str | None = None  # text that the user may enter in place of a number, such as "none"
    # name of another field; this field has an effect only if the other field has a number
    needs: str | None = None
    # name of another field; this field has an effect only if the other field has its `word`
    instead_of: str | None = None
    # {name of another field: choices}; this field has an effect only with one of these choices
    only: Only = dataclasses.field(default_factory=dict)
    # the possible answers, if the answer is not a number; the first one is the default
    choices: tuple[str, ...] = ()
    name: str = ""  # name of the field in SheetValues, which ends with the unit

    def parse(self, text: str) -> Answer:
        """Returns the choice or number in a text of the user, or None if the text is the `word` of
        the field. Raises InputError."""
        if self.choices:
            if text.strip() in self.choices:
                return text.strip()
            raise ParameterError(self.name, f"expected {' or '.join(self.choices)}, got {text!r}")
        if self.word and text.strip() == self.word:
            return None
        span = f"a plain number from {self.low:g} to {self.high:g} {self.unit}"
        span += f' or "{self.word}"' if self.word else ""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not self.low <= value <= self.high or (self.name.endswith("_bits") and value % 1):
            raise ParameterError(
                self.name, f"expected {span}, got {text!r}; the unit is the last part of the key"
            )
        return value

    def shown(self, default: Answer) -> str:
        """Returns a default value of this field in the form in which a user types it."""
        if isinstance(default, str):
            return default
        return self.word or "" if default is None else f"{default:.6g}"


def number(field: SheetField) -> float:
    """Creates a field of SheetValues whose value is always a number. The number is 0 if the field
    has no effect on the axis."""
    return dataclasses.field(default=0.0, metadata={"field": field})


def number_or_word(field: SheetField) -> float | None:
    """Creates a field of SheetValues whose value is None if the user enters the `word` of the field
    in place of a number."""
    return dataclasses.field(default=None, metadata={"field": field})


def choice(
    part: str, choices: tuple[str, ...], why: str, ask: str, only: Only = ANY,
    needs: str | None = None, word: str | None = None,
) -> str:  # fmt: skip
    """Creates a field of SheetValues whose value is one of `choices`. The first choice is the
    default, and also the value of a field without effect."""
    field = SheetField(part, "1", 0, 0, None, why, ask, word, needs, only=only, choices=choices)
    return dataclasses.field(default=choices[0], metadata={"field": field})


AMPLIFIER: Only = {"drive": ("amplifier",)}
WITH_CURRENT_LOOP: Only = {"drive": ("velocity", "torque")}
WITH_VELOCITY_LOOP: Only = {"drive": ("amplifier", "velocity")}
WITH_CURRENT: Only = {"drive": ("amplifier", "velocity", "torque")}
WITH_SPEED: Only = {"drive": ("amplifier", "velocity", "stepper")}
STEPPER: Only = {"drive": ("stepper",)}
ROTARY: Only = {"motor": ("rotary",)}


@dataclass(frozen=True)
class SheetValues:
    """The values of a data sheet. The name of each field ends with the unit of the value. The
    fields are in the order of the questions to the user, because the default of a field depends on
    values of earlier fields."""

    drive: str = choice(
        "drive", ("amplifier", "velocity", "torque", "stepper"), "a velocity amplifier for +-10 V",
        'kind of drive: "amplifier" is a velocity amplifier for +-10 V that is described by its '
        'circuit, "velocity" a drive with a velocity loop that is described by its bandwidth, '
        '"torque" a drive that follows a command of current, "stepper" a stepper motor whose '
        "driver follows a command of speed",
    )  # fmt: skip
    bus_cycle_ms: float | None = number_or_word(SheetField(
        "drive", "ms", 2, 20, None, "a command of +-10 V",
        'cycle of the CAN bus between axis and drive, a multiple of 2 ms; or "none" for a command '
        "of +-10 V", word="none", only=WITH_CURRENT_LOOP,
    ))  # fmt: skip
    output_bits: float = number(SheetField(
        "drive", "bit", 12, 16, 12.0, "12 bits of a DAC",
        "resolution of the command: of the DAC, data sheet of the board; up to 16 on a bus",
    ))  # fmt: skip
    motor: str = choice(
        "motor", ("rotary", "linear"), "a rotary motor", "kind of motor: rotary or linear",
        WITH_CURRENT_LOOP,
    )  # fmt: skip
    force_constant_n_per_a: float = number(SheetField(
        "motor", "N/A", 1e-3, 1e5, 30.0, "a small linear motor",
        'force constant of the linear motor: motor data sheet, "Kf"', only={"motor": ("linear",)},
    ))  # fmt: skip
    cogging_n: float = number(SheetField(
        "motor", "N", 0, 1e5, 0.0, "none, as of a motor without iron",
        "cogging force of the linear motor, amplitude", only={"motor": ("linear",)},
    ))  # fmt: skip
    magnet_period_mm: float = number(SheetField(
        "motor", "mm", 1, 1e3, 30.0, "a common magnet track",
        "distance after which the cogging force repeats", only={"motor": ("linear",)},
    ))  # fmt: skip
    torque_constant_n_m_per_a: float = number(SheetField(
        "motor", "N m/A", 1e-5, 1e3, 0.1, "a small servo motor",
        'torque constant: motor data sheet, "Kt"',
        only={**ROTARY, **WITH_CURRENT},
    ))  # fmt: skip
    holding_torque_n_m: float = number(SheetField(
        "motor", "N m", 1e-3, 1e3, 2.0, "a common stepper motor",
        "holding torque at the current of the driver: motor data sheet", only=STEPPER,
    ))  # fmt: skip
    full_steps_per_rev: float = number(SheetField(
        "motor", "1/rev", 4, 2000, 200, "1.8 degrees",
        "full steps per revolution of the motor", only=STEPPER,
    ))  # fmt: skip
    load_angle_damping_ratio: float = number(SheetField(
        "motor", "1", 0, 2, 0.2, "a driver that damps resonance",
        "damping ratio of the moving mass against the load angle at standstill", only=STEPPER,
    ))  # fmt: skip
    back_emf_v_s_per_rad: float = number(SheetField(
        "motor", "V s/rad", 0, 1e3, lambda v: v.torque_constant_n_m_per_a,
        "equal to the torque constant",
        'back-EMF constant: "Ke"; V per 1000 rpm times 0.00955',
        only=AMPLIFIER,
    ))  # fmt: skip
    resistance_ohm: float = number(SheetField(
        "motor", "ohm", 1e-4, 1e4, 1.0, "a small servo motor",
        "winding resistance, terminal to terminal",
        only=AMPLIFIER,
    ))  # fmt: skip
    inductance_h: float = number(SheetField(
        "motor", "H", 1e-7, 10, 0.002, "a small servo motor",
        "winding inductance, terminal to terminal; 1 mH is 0.001",
        only=AMPLIFIER,
    ))  # fmt: skip
    rotor_inertia_kg_m2: float = number(SheetField(
        "motor", "kg m^2", 1e-9, 100, 5e-5, "a small servo motor",
        "inertia of rotor, coupling and screw or pulley; 1 g cm^2 is 1e-7",
        only=ROTARY,
    ))  # fmt: skip
    motor_damping_n_m_s_per_rad: float = number(SheetField(
        "motor", "N m s/rad", 0, 100, 0.0, "seldom stated",
        "viscous damping of the motor",
        only=ROTARY,
    ))  # fmt: skip
    motor_peak_current_a: float = number(SheetField(
        "motor", "A", 1e-3, 1e4, 20.0, "a small servo motor",
        'peak current: "Imax", below the demagnetisation limit', only=WITH_CURRENT,
    ))  # fmt: skip
    lead_mm_per_rev: float | None = number_or_word(SheetField(
        "transmission", "mm/rev", 1e-3, 1e4, 10.0, "a common ball screw",
        'travel per motor revolution, gear included; "none" for a belt or pinion', word="none",
        only=ROTARY,
    ))  # fmt: skip
    pulley_radius_mm: float = number(SheetField(
        "transmission", "mm", 1e-2, 1e4, 10.0, "a small pulley",
        "pitch radius of pulley or pinion, divided by the gear ratio", instead_of="lead_mm_per_rev",
        only=ROTARY,
    ))  # fmt: skip
    efficiency: float = number(SheetField(
        "transmission", "1", 0.05, 1, 0.9, "a ball screw or belt",
        "efficiency from motor to axis: screw or gear data sheet",
        only=ROTARY,
    ))  # fmt: skip
    transmission_stiffness_n_per_m: float | None = number_or_word(SheetField(
        "transmission", "N/m", 1, 1e12, None, "no resonance below some 500 Hz",
        'stiffness of screw, nut and coupling, or of the belt, along the axis; or "rigid"',
        word="rigid",
        only=ROTARY,
    ))  # fmt: skip
    transmission_damping_ratio: float = number(SheetField(
        "transmission", "1", 0, 2, 0.05, "bolted steel",
        "damping ratio of motor against load on that stiffness",
        needs="transmission_stiffness_n_per_m",
    ))  # fmt: skip
    backlash_mm: float = number(SheetField(
        "transmission", "mm", 0, 100, 0.0, "preloaded",
        "total play of nut, gear or belt", needs="transmission_stiffness_n_per_m",
    ))  # fmt: skip
    moving_mass_kg: float = number(SheetField(
        "axis", "kg", 1e-3, 1e6, 10.0, "a guess",
        "all that moves along the axis, tool and sensor included, rotor excluded: weigh it",
    ))  # fmt: skip
    guide_damping_n_s_per_m: float = number(SheetField(
        "axis", "N s/m", 0, 1e7, lambda v: 4.0 * v.moving_mass_kg, "4 N s/m per kg",
        "viscous friction of the guide: pull at constant speed, force over speed",
    ))  # fmt: skip
    guide_coulomb_n: float = number(SheetField(
        "axis", "N", 0, 1e6, 0.0, "none",
        "dry friction of guide and seals: guide data sheet, or a spring balance",
    ))  # fmt: skip
    inclination_deg: float | None = number_or_word(SheetField(
        "axis", "deg", -90, 90, None, "gravity does not act along it",
        'angle of the motion to the workpiece: 90 presses vertically up, -90 vertically '
        'down; or "horizontal"', word="horizontal",
    ))  # fmt: skip
    counterbalance_n: float = number(SheetField(
        "axis", "N", 0, 1e7, 0.0, "none",
        "force of a spring or cylinder that carries the weight or a part of it; for a "
        "counterweight of a vertical axis add its mass to the moving mass, and give twice its "
        "weight",
        needs="inclination_deg",
    ))  # fmt: skip
    brake_holding_n: float | None = number_or_word(SheetField(
        "axis", "N", 1e-3, 1e7, lambda v: default_brake_n(v), "twice the weight",
        "force of the holding brake along the axis: torque over travel per radian; or "
        '"none": without one it falls while it is off', word="none", needs="inclination_deg",
    ))  # fmt: skip
    brake_release_ms: float = number(SheetField(
        "axis", "ms", 0, 1e4, 50.0, "a common spring-applied brake",
        'time until the brake releases: data sheet, "release" or "pull-in"',
        needs="brake_holding_n",
    ))  # fmt: skip
    brake_engage_ms: float = number(SheetField(
        "axis", "ms", 0, 1e4, 30.0, "a common spring-applied brake",
        'time until the brake holds: data sheet, "engage" or "drop-out"', needs="brake_holding_n",
    ))  # fmt: skip
    supply_v: float = number(SheetField(
        "amplifier", "V", 0.1, 1e4, 48.0, "a common bus voltage",
        "supply (bus) voltage",
        only=AMPLIFIER,
    ))  # fmt: skip
    amplifier_current_limit_a: float = number(SheetField(
        "amplifier", "A", 1e-3, 1e4, lambda v: v.motor_peak_current_a, "the motor's peak current",
        "current at which the amplifier limits", only=WITH_CURRENT,
    ))  # fmt: skip
    command_full_scale_v: float = number(SheetField(
        "amplifier", "V", 0.1, 1e3, 10.0, "+-10 V is common",
        "analogue command at full speed, also the range of the DAC",
    ))  # fmt: skip
    full_scale_speed_m_per_s: float = number(SheetField(
        "amplifier", "m/s", 1e-5, 100, lambda v: default_speed_m_per_s(v),
        "80 % of the speed at which back EMF takes the supply, at most 0.25 m/s, or 0.05 m/s of a "
        "stepper",
        "speed of the axis at full-scale command, as set up in the amplifier",
        only=WITH_SPEED,
    ))  # fmt: skip
    velocity_loop_hz: float = number(SheetField(
        "amplifier", "Hz", 0.1, 2000, 40.0, "an ordinary drive",
        "bandwidth of the velocity loop, from the amplifier's set-up or auto-tuning",
        only=WITH_VELOCITY_LOOP,
    ))  # fmt: skip
    velocity_filter_hz: float = number(SheetField(
        "amplifier", "Hz", 0.1, 1e5, lambda v: default_filter_hz(v),
        "six times the velocity loop, more if the rotor is light against the load",
        "low pass on the measured velocity, in the amplifier's set-up",
        only=AMPLIFIER,
    ))  # fmt: skip
    current_loop_hz: float = number(SheetField(
        "amplifier", "Hz", 1, 2e4, lambda v: default_current_loop_hz(v),
        "1 kHz, or more to leave the velocity loop in charge",
        "bandwidth of the current loop: amplifier data sheet", only=WITH_CURRENT,
    ))  # fmt: skip
    tachometer_v_s_per_rad: float | None = number_or_word(SheetField(
        "amplifier", "V s/rad", 1e-6, 1e3, None,
        "velocity from the encoder, scaled to full-scale command at full speed",
        'tachometer constant, or "none": the amplifier takes the speed from the encoder',
        word="none",
        only=AMPLIFIER,
    ))  # fmt: skip
    torque_damping_n_s_per_m: float = number(SheetField(
        "amplifier", "N s/m", 0, 1e9, lambda v: 2 * math.pi * 20.0 * v.total_mass_kg,
        "20 Hz times 2 pi and the moving mass, rotor included",
        "velocity damping along the axis that the drive adds to its command of current",
        only={"drive": ("torque",)},
    ))  # fmt: skip
    sensor_full_scale_n: float = number(SheetField(
        "sensor", "N", 1e-3, 1e7, 500.0, "a common load cell",
        "force at full scale, both signs: load cell data sheet",
    ))  # fmt: skip
    sensor_stiffness_n_per_m: float = number(SheetField(
        "sensor", "N/m", 1, 1e12, lambda v: v.sensor_full_scale_n / 0.5e-3, "full scale at 0.5 mm",
        "full scale over deflection at full scale, tool and pad in series",
    ))  # fmt: skip
    sensor_damping_n_s_per_m: float = number(SheetField(
        "sensor", "N s/m", 0, 1e9, lambda v: 1.5e-4 * v.sensor_stiffness_n_per_m,
        "1.5e-4 s times the stiffness",
        "damping of sensor and tool",
    ))  # fmt: skip
    sensor_bits: float = number(SheetField(
        "sensor", "bit", 8, 24, 12, "a common converter",
        "resolution of the converter of the force, 8 to 24; the current has at most 16",
    ))  # fmt: skip
    sensor_rate_hz: float | None = number_or_word(SheetField(
        "sensor", "Hz", 10, 3e4, None, "a converter that the tick starts",
        'samples per second of a converter with a clock of its own; or "tick" for a sample at each '
        "tick of 1/1500 s", word="tick",
    ))  # fmt: skip
    sensor_filter: str = choice(
        "sensor", ("none", "sinc3", "sinc4", "sinc5"), "a converter that measures an instant",
        "filter of a sigma-delta converter, as its data sheet names it at this rate",
        needs="sensor_rate_hz", word="none",
    )  # fmt: skip
    sensor_latency_ms: float = number(SheetField(
        "sensor", "ms", 0, LATENCY_MAX_MS, lambda v: default_latency_ms(v),
        "one sample, at most 60 ms, or 0.1 ms after a sensor filter",
        "time from a sample to its arrival: its transfer, and without a sensor filter the settling "
        "of the converter", needs="sensor_rate_hz",
    ))  # fmt: skip
    sensor_noise_n: float = number(SheetField(
        "sensor", "N", 0, 1e6, 0.0, "none",
        "noise of the measured force, rms",
    ))  # fmt: skip
    encoder_counts_per_rev: float | None = number_or_word(SheetField(
        "encoder", "count/rev", 1, 1e9, 4000, "1000 lines, quadrature",
        'counts per motor revolution after quadrature; "none" for a linear scale', word="none",
        only=ROTARY,
    ))  # fmt: skip
    encoder_counts_per_mm: float = number(SheetField(
        "encoder", "count/mm", 1e-3, 1e7, 1000.0, "1 um a count",
        "counts per millimetre of travel", instead_of="encoder_counts_per_rev",
    ))  # fmt: skip
    workpiece_stiffness_n_per_m: float | None = number_or_word(SheetField(
        "workpiece", "N/m", 1, 1e12, None, "much stiffer than the sensor",
        'stiffness of workpiece and fixture, or "rigid"', word="rigid",
    ))  # fmt: skip
    workpiece_mass_kg: float = number(SheetField(
        "workpiece", "kg", 1e-4, 1e6, 2.0, "a guess",
        "mass that moves when the workpiece deflects", needs="workpiece_stiffness_n_per_m",
    ))  # fmt: skip
    workpiece_damping_ratio: float | None = number_or_word(SheetField(
        "workpiece", "1", 0, 2, 0.02, "steel in a fixture",
        'damping ratio of the workpiece on its fixture; "none" to give N s/m', word="none",
        needs="workpiece_stiffness_n_per_m",
    ))  # fmt: skip
    workpiece_damping_n_s_per_m: float = number(SheetField(
        "workpiece", "N s/m", 0, 1e9, 10.0, "a guess",
        "damping of the workpiece on its fixture", needs="workpiece_stiffness_n_per_m",
        instead_of="workpiece_damping_ratio",
    ))  # fmt: skip
    approach_mm: float = number(SheetField(
        "experiment", "mm", 0, 1e3, 5.0, "a usual stand-off",
        "gap between tool and workpiece when force mode starts",
    ))  # fmt: skip

    @property
    def force_per_amp(self) -> float:
        """Returns the force along the axis in N for a current of 1 A."""
        if self.motor == "linear":
            return self.force_constant_n_per_a
        return self.efficiency * self.torque_constant_n_m_per_a / self.radius_m

    @property
    def current_limit_a(self) -> float:
        """Returns the largest current in A that motor and drive permit."""
        return min(self.motor_peak_current_a, self.amplifier_current_limit_a)

    @property
    def code_bits(self) -> int:
        """Returns the resolution in bits of the ADC codes that the firmware receives."""
        return int(min(self.sensor_bits, 16))

    @property
    def peak_force_n(self) -> float:
        """Returns the largest force along the axis in N. If the data sheet states supply voltage
        and resistance, their ratio also limits the current."""
        if self.drive == "stepper":
            return self.efficiency * self.holding_torque_n_m / self.radius_m
        current_a = self.current_limit_a
        if self.drive == "amplifier":
            current_a = min(current_a, self.supply_v / self.resistance_ohm)
        return self.force_per_amp * current_a

    @property
    def command_speed_m_per_s(self) -> float:
        """Returns the speed in m/s at full-scale command in free motion."""
        if self.drive != "torque":
            return self.full_scale_speed_m_per_s
        damping = self.torque_damping_n_s_per_m + self.guide_damping_n_s_per_m
        if self.motor == "rotary":
            damping += self.motor_damping_n_m_s_per_rad / self.radius_m**2
        return self.peak_force_n / max(damping, 1e-9)

    @property
    def full_step_m(self) -> float:
        """Returns the travel of the axis in m for a full step of a stepper motor."""
        return 2 * math.pi * self.radius_m / self.full_steps_per_rev

    @property
    def load_angle_damping_n_s_per_m(self) -> float:
        """Returns the damping of the load angle of a stepper motor along the axis, in N s/m. At
        standstill the load angle acts like a spring: the force repeats after 4 full steps."""
        spring = self.peak_force_n * math.pi / 2 / self.full_step_m
        return 2 * self.load_angle_damping_ratio * math.sqrt(spring * self.total_mass_kg)

    @property
    def radius_m(self) -> float:
        """Returns the travel of the axis in m for one radian of the motor."""
        if self.lead_mm_per_rev is None:
            return self.pulley_radius_mm / 1e3
        return self.lead_mm_per_rev / 1e3 / (2 * math.pi)

    @property
    def rotor_mass_kg(self) -> float:
        """Returns the inertia of the rotor as an equivalent mass at the axis, in kg."""
        if self.motor == "linear":
            return 0.0
        return self.rotor_inertia_kg_m2 / self.radius_m**2

    @property
    def total_mass_kg(self) -> float:
        """Returns the moving mass plus the inertia of the rotor as a mass at the axis, in kg."""
        return self.rotor_mass_kg + self.moving_mass_kg

    @property
    def motor_side_mass_kg(self) -> float:
        """Returns the mass in kg that the drive moves directly. If the transmission is elastic,
        this is the rotor alone."""
        return self.rotor_mass_kg if self.transmission_stiffness_n_per_m else self.total_mass_kg

    @property
    def back_emf_speed_m_per_s(self) -> float:
        """Returns the speed in m/s at which the back EMF equals the supply voltage."""
        return self.supply_v * self.radius_m / max(self.back_emf_v_s_per_rad, 1e-12)

    @property
    def sensor_delay_s(self) -> float:
        """Returns the largest time in s from a change of the force to its use in the firmware: the
        filter of the converter, its latency, one sample and one tick."""
        tick_s = 1 / 1500.0
        if not self.sensor_rate_hz:
            return tick_s
        sinc_order = 0 if self.sensor_filter == "none" else int(self.sensor_filter[-1])
        samples = 1 + sinc_order / 2
        return samples / self.sensor_rate_hz + self.sensor_latency_ms / 1e3 + tick_s

    @property
    def gravity_n(self) -> float:
        """Returns the component of the weight along the axis in N, positive toward the
        workpiece, without a counterbalance."""
        rise = math.radians(self.inclination_deg or 0.0)
        return -GRAVITY_M_PER_S2 * self.moving_mass_kg * math.sin(rise)

    @property
    def weight_n(self) -> float:
        """Returns the rest of the weight that the drive holds, along the axis in N, positive toward
        the workpiece. It has the other sign if the counterbalance is stronger than the weight."""
        gravity = self.gravity_n
        return gravity - math.copysign(self.counterbalance_n, gravity) if gravity else 0.0


def default_speed_m_per_s(v: SheetValues) -> float:
    """Returns the default of the speed at full-scale command in m/s."""
    if v.drive == "stepper":
        return STEPPER_SPEED_M_PER_S
    return 0.25 if v.drive != "amplifier" else min(0.25, 0.8 * v.back_emf_speed_m_per_s)


def default_filter_hz(v: SheetValues) -> float:
    """Returns the default bandwidth of the velocity filter in Hz. It is at least six times the
    bandwidth of the velocity loop, and more if the rotor is light compared with the load."""
    return max(6.0, 4.0 * v.total_mass_kg / v.motor_side_mass_kg) * v.velocity_loop_hz


def default_current_loop_hz(v: SheetValues) -> float:
    """Returns the default bandwidth of the current loop in Hz.

    The bandwidth is above the motor's electrical pole and above that of the velocity filter. It is
    so large that the back EMF adds at most a third of the damping of the velocity loop.
    """
    if v.drive != "amplifier":
        return max(1000.0, 10.0 * v.velocity_loop_hz)
    pole = v.resistance_ohm / (2 * math.pi * v.inductance_h)
    emf = v.torque_constant_n_m_per_a * v.back_emf_v_s_per_rad / v.inductance_h
    emf /= v.total_mass_kg * v.radius_m**2 * (2 * math.pi) ** 2 * v.velocity_loop_hz
    return max(1000.0, 4.0 * pole, 3.0 * v.velocity_filter_hz, 3.0 * emf)


def default_latency_ms(v: SheetValues) -> float:
    """Returns the default time in ms from a sample to the arrival of its value. Without a filter,
    this time is the settling time of the converter."""
    if v.sensor_filter != "none":
        return 0.1
    return min(1e3 / (v.sensor_rate_hz or 1500.0), LATENCY_MAX_MS)


def default_brake_n(v: SheetValues) -> float:
    """Returns the default holding force of the brake in N: twice the component of the weight along
    the axis, without a counterbalance, which may fail, and at least 1 N."""
    return max(1.0, 2.0 * abs(v.gravity_n), 2.0 * abs(v.weight_n))


FIELDS = tuple(
    replace(field.metadata["field"], name=field.name) for field in dataclasses.fields(SheetValues)
)
BY_NAME = {field.name: field for field in FIELDS}


def read(path: Path) -> dict[str, str]:
    """Returns {field: text} from a TOML file. The keys of the file are names of fields. The values
    are numbers or words. Raises InputError."""
    table = toml.read(path)

    def fail(key: str, message: str) -> NoReturn:
        raise InputError(f"{paths.display(path)}: {key}: {message}")

    toml.expect_keys(table, list(BY_NAME), fail, "names of values of the data sheet")
    texts = {}
    for key, value in table.items():
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            fail(key, f"expected a number or a word in quotation marks, got {value!r}")
        texts[key] = value if isinstance(value, str) else repr(value)
        try:
            BY_NAME[key].parse(texts[key])
        except ParameterError as error:
            fail(key, error.text)
    return texts


BACK = "<"  # answer with which the user returns to the previous question


def sheet_of(values: Mapping[str, Answer]) -> SheetValues:
    """Returns the data sheet from {name of a field: value}. A value None means the `word` of the
    field, or that the field has no effect."""
    return from_json(SheetValues, {n: v for n, v in values.items() if v is not None})


def collect(
    given: Mapping[str, str | None], ask: Callable[[SheetField, str, int], str] | None = None
) -> tuple[SheetValues, dict[str, str]]:
    """Collects the values of a data sheet and the origin of each value.

    given: {field: text of the user}. ask(field, proposed, number): function that asks the user for
    a missing value, and returns a valid text or BACK. `number` counts the fields from 1. Returns
    (values, {field: origin of its value}). Raises InputError for a value that is out of range or
    has no effect.
    """
    texts = {name: text for name, text in given.items() if text is not None}
    # If one of two alternative fields is given, the other field becomes "none".
    for field in FIELDS:
        if field.instead_of and field.name in texts:
            texts.setdefault(field.instead_of, "none")
    values: dict[str, Answer] = {}
    sources: dict[str, str] = {}
    answers: dict[str, str] = {}
    asked: list[int] = []
    i = 0
    while i < len(FIELDS):
        field = FIELDS[i]
        text = texts.get(field.name)
        if refusal := without_effect(field, values):
            if text not in (None, field.word):
                raise ParameterError(field.name, refusal)
            values[field.name] = field.choices[0] if field.choices else None
            # The user may have answered this question before, so a previous origin is removed.
            sources.pop(field.name, None)
            i += 1
            continue
        default = default_of(field, values)
        if text is None and ask is not None:
            proposed = field.shown(default)
            text = ask(field, answers.get(field.name, proposed), i + 1)
            if text == BACK:
                i = asked.pop() if asked else i
                continue
            asked.append(i)
            if text == proposed:
                text = None
                answers.pop(field.name, None)
            else:
                answers[field.name] = text
        if text is None:
            values[field.name], sources[field.name] = default, f"default, check: {field.why}"
        else:
            values[field.name], sources[field.name] = field.parse(text), "given"
        i += 1
    return sheet_of(values), sources


def default_of(field: SheetField, values: Mapping[str, Answer]) -> Answer:
    """Returns the default of a field for the values of the earlier fields."""
    if field.choices:
        return field.choices[0]
    return field.default(sheet_of(values)) if callable(field.default) else field.default


def without_effect(field: SheetField, values: Mapping[str, Answer]) -> str | None:
    """Returns the reason why a field of the data sheet has no effect, from the values of the
    earlier fields. Returns None if the field has an effect."""
    for name, choices in field.only.items():
        if values[name] not in choices:
            return f"expected no value while `{name}` is {values[name]}; leave it out"
    if field.needs and values[field.needs] is None:
        word = BY_NAME[field.needs].word
        return f"expected no value while `{field.needs}` is {word}; give `{field.needs}` too"
    if field.instead_of and values[field.instead_of] is not None:
        return f"expected no value beside `{field.instead_of}`; give one of the two"
    return None
