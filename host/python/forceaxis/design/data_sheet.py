"""Data sheet of `forceaxis new`: its fields, their defaults and derived values."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from forceaxis._core import InputError

GRAVITY = 9.81  # m/s^2

# Data-sheet values by the name of the field; None where the user gave the word of the field.
SheetValues = Mapping[str, Any]


@dataclass(frozen=True)
class Field:
    """One value of a data sheet."""

    part: str
    name: str  # ends in its unit
    unit: str
    low: float
    high: float
    default: float | Callable[[SheetValues], float] | None  # None: the word
    why: str  # the origin of the default
    ask: str  # the question: name of the quantity and its place in data sheets
    word: str | None = None  # accepted instead of a number
    # name of another field; this field is asked for only if the other one is a number ...
    needs: str | None = None
    instead_of: str | None = None  # ... or is not

    @property
    def option(self) -> str:
        return "--" + self.name.lower().replace("_", "-")

    def parse(self, text: str) -> float | None:
        """The number in a text; None for the field's word."""
        if self.word and text.strip() == self.word:
            return None
        span = f"a plain number from {self.low:g} to {self.high:g} {self.unit}"
        span += f' or "{self.word}"' if self.word else ""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not self.low <= value <= self.high or (self.name.endswith("_bits") and value % 1):
            raise InputError(
                f"{self.option}: expected {span}, got {text!r}; the unit is part of the name"
            )
        return value


def radius_m(v: SheetValues) -> float:
    """Travel per radian of the motor."""
    if v["lead_mm_per_rev"] is None:
        return v["pulley_radius_mm"] / 1e3
    return v["lead_mm_per_rev"] / 1e3 / (2 * math.pi)


def back_emf_speed(v: SheetValues) -> float:
    """Speed at which the back EMF equals the supply, m/s."""
    return v["supply_v"] * radius_m(v) / max(v["back_emf_v_s_per_rad"], 1e-12)


def motor_side_mass(v: SheetValues) -> float:
    """Mass that the drive moves directly, kg: the rotor alone if the transmission is elastic."""
    rotor = v["rotor_inertia_kg_m2"] / radius_m(v) ** 2
    return rotor if v["transmission_stiffness_n_per_m"] else rotor + v["moving_mass_kg"]


def total_mass(v: SheetValues) -> float:
    """Moving mass and reflected rotor, kg."""
    return v["moving_mass_kg"] + v["rotor_inertia_kg_m2"] / radius_m(v) ** 2


def default_filter(v: SheetValues) -> float:
    """Velocity filter in Hz, well above the bandwidth that the velocity loop reaches with the
    motor-side mass."""
    return max(6.0, 4.0 * total_mass(v) / motor_side_mass(v)) * v["velocity_loop_hz"]


def default_current_loop(v: SheetValues) -> float:
    """Current loop in Hz: above the motor's electrical pole and the velocity filter, and so fast
    that the back EMF adds at most a third of the velocity loop's damping."""
    pole = v["resistance_ohm"] / (2 * math.pi * v["inductance_h"])
    emf = v["torque_constant_n_m_per_a"] * v["back_emf_v_s_per_rad"] / v["inductance_h"]
    emf /= total_mass(v) * radius_m(v) ** 2 * (2 * math.pi) ** 2 * v["velocity_loop_hz"]
    return max(1000.0, 4.0 * pole, 3.0 * v["velocity_filter_hz"], 3.0 * emf)


def weight_n(v: SheetValues) -> float:
    """Component of the weight along the axis in N, positive toward the workpiece."""
    rise = math.radians(v["inclination_deg"] or 0.0)
    return -GRAVITY * v["moving_mass_kg"] * math.sin(rise)


def default_brake(v: SheetValues) -> float:
    """Twice the component of the weight along the axis, and at least 1 N."""
    return max(1.0, 2.0 * abs(weight_n(v)))


FIELDS = (
    Field("motor", "torque_constant_n_m_per_a", "N m/A", 1e-5, 1e3, 0.1, "a small servo motor",
          'torque constant: motor data sheet, "Kt"'),
    Field("motor", "back_emf_v_s_per_rad", "V s/rad", 0, 1e3,
          lambda v: v["torque_constant_n_m_per_a"], "equal to the torque constant",
          'back-EMF constant: "Ke"; V per 1000 rpm times 0.00955'),
    Field("motor", "resistance_ohm", "ohm", 1e-4, 1e4, 1.0, "a small servo motor",
          "winding resistance, terminal to terminal"),
    Field("motor", "inductance_h", "H", 1e-7, 10, 0.002, "a small servo motor",
          "winding inductance, terminal to terminal; 1 mH is 0.001"),
    Field("motor", "rotor_inertia_kg_m2", "kg m^2", 1e-9, 100, 5e-5, "a small servo motor",
          "inertia of rotor, coupling and screw or pulley; 1 g cm^2 is 1e-7"),
    Field("motor", "motor_damping_n_m_s_per_rad", "N m s/rad", 0, 100, 0.0, "seldom stated",
          "viscous damping of the motor"),
    Field("motor", "motor_peak_current_a", "A", 1e-3, 1e4, 20.0, "a small servo motor",
          'peak current: "Imax", below the demagnetisation limit'),
    Field("transmission", "lead_mm_per_rev", "mm/rev", 1e-3, 1e4, 10.0, "a common ball screw",
          'travel per motor revolution, gear included; "none" for a belt or pinion', word="none"),
    Field("transmission", "pulley_radius_mm", "mm", 1e-2, 1e4, 10.0, "a small pulley",
          "pitch radius of pulley or pinion, divided by the gear ratio",
          instead_of="lead_mm_per_rev"),
    Field("transmission", "efficiency", "1", 0.05, 1, 0.9, "a ball screw or belt",
          "efficiency from motor to axis: screw or gear data sheet"),
    Field("transmission", "transmission_stiffness_n_per_m", "N/m", 1, 1e12, None,
          "no resonance below some 500 Hz",
          'stiffness of screw, nut and coupling, or of the belt, along the axis; or "rigid"',
          word="rigid"),
    Field("transmission", "transmission_damping_ratio", "1", 0, 2, 0.05, "bolted steel",
          "damping ratio of motor against load on that stiffness",
          needs="transmission_stiffness_n_per_m"),
    Field("transmission", "backlash_mm", "mm", 0, 100, 0.0, "preloaded",
          "total play of nut, gear or belt", needs="transmission_stiffness_n_per_m"),
    Field("axis", "moving_mass_kg", "kg", 1e-3, 1e6, 10.0, "a guess",
          "all that moves along the axis, tool and sensor included, rotor excluded: weigh it"),
    Field("axis", "guide_damping_n_s_per_m", "N s/m", 0, 1e7,
          lambda v: 4.0 * v["moving_mass_kg"], "4 N s/m per kg",
          "viscous friction of the guide: pull at constant speed, force over speed"),
    Field("axis", "guide_coulomb_n", "N", 0, 1e6, 0.0, "none",
          "dry friction of guide and seals: guide data sheet, or a spring balance"),
    Field("axis", "inclination_deg", "deg", -90, 90, None, "gravity does not act along it",
          'angle of the motion to the workpiece: 90 presses vertically up, -90 vertically '
          'down; or "horizontal"', word="horizontal"),
    Field("axis", "brake_holding_n", "N", 1e-3, 1e7, default_brake, "twice the weight",
          "force of the holding brake along the axis: torque over travel per radian; or "
          '"none": without one it falls while it is off', word="none", needs="inclination_deg"),
    Field("axis", "brake_release_ms", "ms", 0, 1e4, 50.0, "a common spring-applied brake",
          'time until the brake releases: data sheet, "release" or "pull-in"',
          needs="brake_holding_n"),
    Field("axis", "brake_engage_ms", "ms", 0, 1e4, 30.0, "a common spring-applied brake",
          'time until the brake holds: data sheet, "engage" or "drop-out"',
          needs="brake_holding_n"),
    Field("amplifier", "supply_v", "V", 0.1, 1e4, 48.0, "a common bus voltage",
          "supply (bus) voltage"),
    Field("amplifier", "amplifier_current_limit_a", "A", 1e-3, 1e4,
          lambda v: v["motor_peak_current_a"], "the motor's peak current",
          "current at which the amplifier limits"),
    Field("amplifier", "command_full_scale_v", "V", 0.1, 1e3, 10.0, "+-10 V is common",
          "analogue command at full speed, also the range of the DAC"),
    Field("amplifier", "full_scale_speed_m_per_s", "m/s", 1e-5, 100,
          lambda v: min(0.25, 0.8 * back_emf_speed(v)),
          "80 % of the speed at which back EMF takes the supply, at most 0.25 m/s",
          "speed of the axis at full-scale command, as set up in the amplifier"),
    Field("amplifier", "velocity_loop_hz", "Hz", 0.1, 2000, 40.0, "an ordinary drive",
          "bandwidth of the velocity loop, from the amplifier's set-up or auto-tuning"),
    Field("amplifier", "velocity_filter_hz", "Hz", 0.1, 1e5, default_filter,
          "six times the velocity loop, more if the rotor is light against the load",
          "low pass on the measured velocity, in the amplifier's set-up"),
    Field("amplifier", "current_loop_hz", "Hz", 1, 2e4, default_current_loop,
          "1 kHz, or more to leave the velocity loop in charge",
          "bandwidth of the current loop: amplifier data sheet"),
    Field("amplifier", "tachometer_v_s_per_rad", "V s/rad", 1e-6, 1e3, None,
          "velocity from the encoder, scaled to full-scale command at full speed",
          'tachometer constant, or "none": the amplifier takes the speed from the encoder',
          word="none"),
    Field("sensor", "sensor_full_scale_n", "N", 1e-3, 1e7, 500.0, "a common load cell",
          "force at full scale, both signs: load cell data sheet"),
    Field("sensor", "sensor_stiffness_n_per_m", "N/m", 1, 1e12,
          lambda v: v["sensor_full_scale_n"] / 0.5e-3, "full scale at 0.5 mm",
          "full scale over deflection at full scale, tool and pad in series"),
    Field("sensor", "sensor_damping_n_s_per_m", "N s/m", 0, 1e9,
          lambda v: 1.5e-4 * v["sensor_stiffness_n_per_m"], "1.5e-4 s times the stiffness",
          "damping of sensor and tool"),
    Field("sensor", "sensor_bits", "bit", 8, 16, 12, "a common converter",
          "resolution of the converters of force and current, 8 to 16"),
    Field("sensor", "sensor_noise_n", "N", 0, 1e6, 0.0, "none",
          "noise of the measured force, rms"),
    Field("encoder", "encoder_counts_per_rev", "count/rev", 1, 1e9, 4000, "1000 lines, quadrature",
          'counts per motor revolution after quadrature; "none" for a linear scale', word="none"),
    Field("encoder", "encoder_counts_per_mm", "count/mm", 1e-3, 1e7, 1000.0, "1 um a count",
          "counts per millimetre of travel", instead_of="encoder_counts_per_rev"),
    Field("workpiece", "workpiece_stiffness_n_per_m", "N/m", 1, 1e12, None,
          "much stiffer than the sensor",
          'stiffness of workpiece and fixture, or "rigid"', word="rigid"),
    Field("workpiece", "workpiece_mass_kg", "kg", 1e-4, 1e6, 2.0, "a guess",
          "mass that moves when the workpiece deflects", needs="workpiece_stiffness_n_per_m"),
    Field("workpiece", "workpiece_damping_ratio", "1", 0, 2, 0.02, "steel in a fixture",
          'damping ratio of the workpiece on its fixture; "none" to give N s/m', word="none",
          needs="workpiece_stiffness_n_per_m"),
    Field("workpiece", "workpiece_damping_n_s_per_m", "N s/m", 0, 1e9, 10.0, "a guess",
          "damping of the workpiece on its fixture", needs="workpiece_stiffness_n_per_m",
          instead_of="workpiece_damping_ratio"),
    Field("experiment", "approach_mm", "mm", 0, 1e3, 5.0, "a usual stand-off",
          "gap between tool and workpiece when force mode starts"),
)  # fmt: skip
BY_NAME = {f.name: f for f in FIELDS}


BACK = "<"  # answer that returns to the previous question


def collect(
    given: Mapping[str, str | None], ask: Callable[[Field, str, int], str] | None = None
) -> tuple[dict[str, float | None], dict[str, str]]:
    """Collects every value and its origin. given: texts by name; ask(field, proposed, number)
    returns a text that can be parsed, or BACK; number: of the field, from 1.

    Returns (values, sources). Raises InputError for a value that is out of range or without effect.
    """
    texts = {name: text for name, text in given.items() if text is not None}
    for field in FIELDS:  # a given alternative answers the other field with "none"
        if field.instead_of and field.name in texts:
            texts.setdefault(field.instead_of, "none")
    values: dict[str, float | None] = {}
    sources: dict[str, str] = {}
    answers: dict[str, str] = {}
    asked: list[int] = []
    i = 0
    while i < len(FIELDS):
        field = FIELDS[i]
        text = texts.get(field.name)
        if refusal := without_effect(field, values):
            if text not in (None, field.word):
                raise InputError(f"{field.option}: {refusal}")
            values[field.name] = None
            # the stored origin belongs to an answer before the user returned to this question
            sources.pop(field.name, None)
            i += 1
            continue
        default = field.default(values) if callable(field.default) else field.default
        if text is None and ask is not None:
            proposed = shown(field, default)
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
    return values, sources


def without_effect(field: Field, values: SheetValues) -> str | None:
    """Reason why a field has no effect beside the fields before it; None if the field has an
    effect."""
    needs, other = BY_NAME.get(field.needs or ""), BY_NAME.get(field.instead_of or "")
    if needs and values[needs.name] is None:
        return f"expected no value while {needs.option} is {needs.word}; give that one too"
    if other and values[other.name] is not None:
        return f"expected no value beside {other.option}; give one of the two"
    return None


def shown(field: Field, default: float | None) -> str:
    """A default in the form in which a user types it."""
    return field.word or "" if default is None else f"{default:.6g}"
