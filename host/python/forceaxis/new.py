"""A model and two experiments of a user's own axis, from data-sheet values (`forceaxis new`)."""

import math
import os
import shlex
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import jinja2
import numpy as np

from forceaxis import _core, objects, paths
from forceaxis._core import InputError

TICK_S = 1.0 / _core.TICKS_PER_SECOND
DAC_CODES = 2048  # from 0 V to full scale
SHARE = 1 / 6  # of the linear limit, for the first gains: loss of contact destabilises earlier
FILES = ("model.toml", "contact.toml", "step.toml")


@dataclass(frozen=True)
class Field:
    """One value of a data sheet."""

    part: str
    name: str  # ends in its unit
    unit: str
    low: float
    high: float
    default: float | Callable | None  # None: the word
    why: str  # the origin of the default
    ask: str  # the question: the quantity and its place in data sheets
    word: str | None = None  # accepted instead of a number
    needs: str | None = None  # asked for only if this field is a number ...
    instead_of: str | None = None  # ... or is not

    @property
    def option(self):
        return "--" + self.name.lower().replace("_", "-")

    def parse(self, text):
        """The number, or None for the field's word."""
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


def radius_m(v):
    """Travel per radian of the motor."""
    if v["lead_mm_per_rev"] is None:
        return v["pulley_radius_mm"] / 1e3
    return v["lead_mm_per_rev"] / 1e3 / (2 * math.pi)


def back_emf_speed(v):
    """Speed at which the back EMF equals the supply, m/s."""
    return v["supply_v"] * radius_m(v) / max(v["back_emf_v_s_per_rad"], 1e-12)


def motor_side_mass(v):
    """Mass that the drive moves directly, kg: the rotor alone if the transmission is elastic."""
    rotor = v["rotor_inertia_kg_m2"] / radius_m(v) ** 2
    return rotor if v["transmission_stiffness_n_per_m"] else rotor + v["moving_mass_kg"]


def total_mass(v):
    """Moving mass and reflected rotor, kg."""
    return v["moving_mass_kg"] + v["rotor_inertia_kg_m2"] / radius_m(v) ** 2


def default_filter(v):
    """Velocity filter: well above what the loop reaches with the motor-side mass, Hz."""
    return max(6.0, 4.0 * total_mass(v) / motor_side_mass(v)) * v["velocity_loop_hz"]


def default_current_loop(v):
    """Current loop: above the motor's electrical pole and the velocity filter, and high enough for
    the back EMF to damp the axis by a third of the velocity loop at most, Hz."""
    pole = v["resistance_ohm"] / (2 * math.pi * v["inductance_h"])
    emf = v["torque_constant_n_m_per_a"] * v["back_emf_v_s_per_rad"] / v["inductance_h"]
    emf /= total_mass(v) * radius_m(v) ** 2 * (2 * math.pi) ** 2 * v["velocity_loop_hz"]
    return max(1000.0, 4.0 * pole, 3.0 * v["velocity_filter_hz"], 3.0 * emf)


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
          'peak current: "Imax", before the magnets suffer'),
    Field("transmission", "lead_mm_per_rev", "mm/rev", 1e-3, 1e4, 10.0, "a common ball screw",
          'travel per motor revolution, gear included; "none" for a belt or pinion', word="none"),
    Field("transmission", "pulley_radius_mm", "mm", 1e-2, 1e4, 10.0, "a small pulley",
          "pitch radius of pulley or pinion, divided by the gear ratio",
          instead_of="lead_mm_per_rev"),
    Field("transmission", "efficiency", "1", 0.05, 1, 0.9, "a ball screw or belt",
          "share of the motor's force that arrives: screw or gear data sheet"),
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
          "noise of the reading, rms"),
    Field("encoder", "encoder_counts_per_rev", "count/rev", 1, 1e9, 4000, "1000 lines, quadrature",
          'counts per motor revolution after quadrature; "none" for a linear scale', word="none"),
    Field("encoder", "encoder_counts_per_mm", "count/mm", 1e-3, 1e7, 1000.0, "1 um a count",
          "counts per millimetre of travel", instead_of="encoder_counts_per_rev"),
    Field("workpiece", "workpiece_stiffness_n_per_m", "N/m", 1, 1e12, None,
          "much stiffer than the sensor",
          'stiffness of workpiece and fixture, or "rigid"', word="rigid"),
    Field("workpiece", "workpiece_mass_kg", "kg", 1e-4, 1e6, 2.0, "a guess",
          "what moves when the workpiece yields", needs="workpiece_stiffness_n_per_m"),
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


def collect(given, ask=None):
    """Every value and its origin. `given`: texts by name; `ask(field, default)` -> text.

    Returns (values, sources). Raises InputError for a value that is out of range or without effect.
    """
    values, sources = {}, {}
    texts = {name: text for name, text in given.items() if text is not None}
    for field in FIELDS:  # giving the one alternative answers "none" to the other
        if field.instead_of and field.name in texts:
            texts.setdefault(field.instead_of, "none")
    for field in FIELDS:
        text = texts.get(field.name)
        needs, other = BY_NAME.get(field.needs), BY_NAME.get(field.instead_of)
        refusal = None
        if needs and values[needs.name] is None:
            refusal = f"expected no value while {needs.option} is {needs.word}; give that one too"
        elif other and values[other.name] is not None:
            refusal = f"expected no value beside {other.option}; give one of the two"
        if refusal:
            if text not in (None, field.word):
                raise InputError(f"{field.option}: {refusal}")
            values[field.name] = None
            continue
        default = field.default(values) if callable(field.default) else field.default
        if text is None and ask is not None:
            text = ask(field, default)
        if text is None:
            values[field.name], sources[field.name] = default, f"default, check: {field.why}"
        else:
            values[field.name], sources[field.name] = field.parse(text), "given"
    return values, sources


def shown(field, default):
    """A default in the form in which it is typed."""
    return field.word if default is None else f"{default:.6g}"


@dataclass
class Axis:
    """Constants derived from the data sheet."""

    v: dict  # data-sheet values by name
    r_trans: float
    rotor_mass: float
    mass: float
    k_torque: float
    b_axis: float
    current_limit: float
    k_current: float
    k_amp: float
    k_tach: float
    k_preamp_fdbk: float
    k_preamp_cmd: float
    a_preamp_fdbk: float
    b_transmission: float
    b_workpiece: float
    encoder_scale: float
    force_per_count: float
    current_per_count: float


def derive(v):
    """The amplifier's gains and the model's constants. Raises InputError where none exist."""
    r, rotor = radius_m(v), v["rotor_inertia_kg_m2"] / radius_m(v) ** 2
    mass, full_V = rotor + v["moving_mass_kg"], v["command_full_scale_v"]
    speed = v["full_scale_speed_m_per_s"]
    current = min(v["motor_peak_current_a"], v["amplifier_current_limit_a"])
    k_torque = v["efficiency"] * v["torque_constant_n_m_per_a"]
    k_current = full_V / current
    L, R = v["inductance_h"], v["resistance_ohm"]
    k_amp = (2 * math.pi * v["current_loop_hz"] * L - R) / k_current
    if k_amp <= 0:
        fail("current_loop_hz", f"more than R/(2 pi L) = {R / (2 * math.pi * L):.4g} Hz, "
             f"got {v['current_loop_hz']:g}", "raise it or check R and L")  # fmt: skip
    k_tach = v["tachometer_v_s_per_rad"] or full_V * r / speed
    # Without filter and inductance (R + k_amp k_current) i = k_amp (k_preamp_cmd u - k_preamp_fdbk
    # k_tach v/r) - k_back_emf v/r; k_torque/r i - b v is to be D (speed/full_V u - v).
    D = 2 * math.pi * v["velocity_loop_hz"] * mass
    b = v["guide_damping_n_s_per_m"] + v["motor_damping_n_m_s_per_rad"] / r**2
    Z = R + k_amp * k_current
    back = v["back_emf_v_s_per_rad"]
    k_fdbk = ((D - b) * Z * r**2 / k_torque - back) / (k_amp * k_tach)
    if k_fdbk < 0:
        natural = (b + k_torque * back / (Z * r**2)) / (2 * math.pi * mass)
        fail("velocity_loop_hz", f"more than the {natural:.4g} Hz of friction and back EMF alone, "
             f"got {v['velocity_loop_hz']:g}", "raise it or the current loop")  # fmt: skip
    k_cmd = speed / full_V * D * Z * r / (k_torque * k_amp)
    b_transmission = 0.0
    if k := v["transmission_stiffness_n_per_m"]:
        pair = rotor * v["moving_mass_kg"] / mass
        b_transmission = 2 * v["transmission_damping_ratio"] * math.sqrt(k * pair)
    b_workpiece = v["workpiece_damping_n_s_per_m"] or 0.0
    if k := v["workpiece_stiffness_n_per_m"]:
        zeta = v["workpiece_damping_ratio"]
        if zeta is not None:
            b_workpiece = 2 * zeta * math.sqrt(k * v["workpiece_mass_kg"])
    per_rev = v["encoder_counts_per_rev"]
    half = 2.0 ** (v["sensor_bits"] - 1)
    return Axis(
        v, r, rotor, mass, k_torque, v["guide_damping_n_s_per_m"], current, k_current, k_amp,
        k_tach, k_fdbk, k_cmd, 2 * math.pi * v["velocity_filter_hz"], b_transmission, b_workpiece,
        1e3 * v["encoder_counts_per_mm"] if per_rev is None else per_rev / (2 * math.pi * r),
        v["sensor_full_scale_n"] / half, 1.25 * current / half,
    )  # fmt: skip


def within(name, value):
    """A value of a firmware object, limited to the object's range."""
    taken = next(o for o in objects.OBJECTS if o.name == name)
    return min(max(value, taken.min * taken.scale), taken.max * taken.scale)


def fail(name, expected, remedy):
    raise InputError(f"{BY_NAME[name].option}: expected {expected}; {remedy}")


@dataclass
class First:
    """The first gains and the performance to expect of them."""

    limit: float
    gain: float
    setpoint: float
    held: float  # share of the set-point that the law without integral holds
    reach_s: float
    contact_s: float
    position_limit: float
    position_gain: float
    distance_m: float
    speed_m_per_s: float
    acceleration_m_per_s2: float
    step_s: float


def highest_gain(loop, volts_per_code):
    """The limit of a loop in DAC codes per unit of its signal, at most the firmware's 256."""
    gain = loop.limit().gain
    return min(256.0, math.inf if gain is None else gain / volts_per_code)


def first_gains(axis, model):
    """A share of the linear limits; a quarter of the smaller of sensor range and peak force."""
    from forceaxis import linear
    from forceaxis.linear import loops

    v = axis.v
    sliding = {"seals": "forward"} if v["guide_coulomb_n"] else {}
    if v["transmission_stiffness_n_per_m"] and v["backlash_mm"]:
        sliding["transmission.high"] = "pressed"  # the backlash closed
    plant = linear.linearise(model, outputs=("adc0",), modes=sliding)
    free = linear.linearise(model, outputs=("encoder",), modes=sliding, free=True)
    poles = np.concatenate([plant.poles().real, free.poles().real])
    if poles.max() > 1e-6 * np.abs(poles).max():
        fail("velocity_loop_hz", "a drive that is stable by itself with this current loop, filter "
             f"and transmission, got {v['velocity_loop_hz']:g}",
             f"lower it or raise {BY_NAME['velocity_filter_hz'].option} and "
             f"{BY_NAME['current_loop_hz'].option}")  # fmt: skip
    volts = v["command_full_scale_v"] / DAC_CODES
    force = loops.force_loop(model, modes=sliding, output="adc0")
    limit = highest_gain(force, volts)
    gain = max(1, math.floor(limit * SHARE * 256)) / 256
    newton_per_count = v["sensor_full_scale_n"] / 128
    current = min(axis.current_limit, v["supply_v"] / v["resistance_ohm"])
    peak = axis.k_torque * current / axis.r_trans
    setpoint = math.floor(min(32.0, peak / 4 / newton_per_count) * 256) / 256
    code = v["full_scale_speed_m_per_s"] / DAC_CODES
    if gain * setpoint < 2 or limit * SHARE < 1 / 256:
        fail("full_scale_speed_m_per_s", "a speed at which the safe approach takes at least two "
             f"DAC codes, got {v['full_scale_speed_m_per_s']:g} ({gain * setpoint:.2g} codes)",
             "lower it, or check sensor and amplifier")  # fmt: skip
    static = gain * volts * plant.at(0.0).real
    rate = force.decay(gain * volts)
    reach = v["approach_mm"] / 1e3 / (min(gain * setpoint, DAC_CODES) * code)
    # Room for lower gains and set-points: a tenth of the approach speed, if that is not too long.
    contact = min(
        600.0, math.ceil(2 * (min(10 * reach, 1.3 * reach + 3) + min(10 / rate, 30) + 1.5)) / 2
    )

    position = loops.force_loop(model, modes=sliding, output="encoder", free=True)
    position_limit = highest_gain(position, volts)
    position_gain = max(1, math.floor(position_limit * SHARE * 256)) / 256
    distance, acceleration = 0.02, 0.25 * peak / axis.mass
    speed = v["full_scale_speed_m_per_s"] / 4
    settle = 10 / max(position.decay(position_gain * volts), 0.5)
    step = math.ceil(2 * (distance / speed + speed / acceleration + settle + 0.5)) / 2
    return First(limit, gain, setpoint, static / (1 + static), reach, contact, position_limit,
                 position_gain, distance, speed, acceleration, min(step, 600.0))  # fmt: skip


def render(name, title, axis, sources, first=None):
    """The text of one of FILES; the model's needs no first gains."""
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda x: f"{x:.6g}" if isinstance(x, float) else x,
    )
    v = axis.v

    def entry(key, value, unit, source="derived"):
        return f'{key} = {{ value = {float(value)!r}, unit = "{unit}", source = "{source}" }}'

    def given(key, name, unit, scale=1.0):
        return f"# {BY_NAME[name].ask}\n{entry(key, v[name] * scale, unit, sources[name])}"

    context = dict(
        title=title, a=axis, v=v, src=sources, entry=entry, given=given, exact=repr,
        bits=int(v["sensor_bits"]), half=1 << (int(v["sensor_bits"]) - 1),
        back_emf_speed=back_emf_speed(v), count_N=v["sensor_full_scale_n"] / 128,
    )  # fmt: skip
    if first:
        count = axis.encoder_scale
        target = round((-v["approach_mm"] / 1e3 - first.distance_m) * count)
        if abs(target) >= 2**31:
            key = (
                "encoder_counts_per_rev" if v["encoder_counts_per_rev"] else "encoder_counts_per_mm"
            )
            fail(key, "a move of less than 2^31 counts", "give a coarser encoder")
        context |= dict(
            f=first, target=target,
            speed=within("profile_velocity_max", first.speed_m_per_s * count * TICK_S),
            acceleration=within("profile_acceleration_max",
                                first.acceleration_m_per_s2 * count * TICK_S**2),
            ripple=max(10.0, math.ceil(2e-5 * count)),
        )  # fmt: skip
    text = resources.files("forceaxis").joinpath(f"new_{name}.jinja").read_text()
    return environment.from_string(text).render(context)


def write(folder, values, sources, force=False):
    """Write model and experiments into `folder`; all of them or none. Returns what was written."""
    folder = Path(folder)
    title = folder.name
    if not title or any(c in title for c in '"\\') or not title.isprintable():
        raise InputError(f"NAME: expected the name of a folder without quotes, got {str(folder)!r}")
    axis = derive(values)
    model, *others = FILES
    written = {model: render(model, title, axis, sources)}
    with tempfile.TemporaryDirectory() as scratch:
        trial = Path(scratch) / model
        trial.write_text(written[model], encoding="utf-8")
        first = first_gains(axis, trial)
    written |= {name: render(name, title, axis, sources, first) for name in others}
    refuse_existing(folder, force)
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{title}.", dir=folder.parent))
    try:
        for name, text in written.items():
            (part / name).write_text(text, encoding="utf-8")
        if folder.exists():
            for name in FILES:
                os.replace(part / name, folder / name)
        else:
            part.chmod(0o777 & ~umask())
            os.replace(part, folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return {
        "folder": paths.display(folder),
        "files": list(FILES),
        "total_mass_kg": axis.mass,
        "force_limit_gain": first.limit,
        "force_gain": first.gain,
        "force_setpoint": first.setpoint,
        "setpoint_N": first.setpoint * values["sensor_full_scale_n"] / 128,
        "held_share": first.held,
        "position_gain": first.position_gain,
        "defaults": [n for n, s in sources.items() if s != "given"],
    }


def umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


def refuse_existing(folder, force):
    """Files are replaced only with --force, and only those that `new` writes."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: expected a folder or nothing, got a file; take another name")
    there = [name for name in FILES if (folder / name).exists()]
    if there and not force:
        raise InputError(
            f"{folder}: expected no {', '.join(there)} there; take another name or give --force"
        )


def describe(done):
    """The summary for a terminal."""
    rows = [
        ("written", ", ".join(shlex.quote(f"{done['folder']}/{name}") for name in done["files"])),
        ("total mass", f"{done['total_mass_kg']:.4g} kg, reflected rotor included"),
        ("force gain", f"{done['force_gain']:.4g}, a sixth of the linear limit "
         f"{done['force_limit_gain']:.4g}"),
        ("set-point", f"{done['force_setpoint']:.4g} counts, {done['setpoint_N']:.4g} N, of which "
         f"this gain holds {100 * done['held_share']:.3g} %"),
        ("not given", f'{len(done["defaults"])} values: look for "default, check" in model.toml'),
        ("next", f"forceaxis run {shlex.quote(done['folder'] + '/contact.toml')}"),
    ]  # fmt: skip
    return "\n".join(f"{key:12} {value}" for key, value in rows)
