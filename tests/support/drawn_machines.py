"""Hidden machines of all kinds of drive. A seed and a kind draw a data sheet, and a true machine
that differs from it by tolerances and by disturbances; machine_ranges.toml has the ranges.

Run as a process of its own, `drawn_machines.py KIND SEED FOLDER [exact] [without=NAME,...]` writes
the model of the data sheet into FOLDER/known, the true model into FOLDER/true, prints the address
at which the machine answers, and judges a law of it when it is asked to (drawn_axes.answer).
"""

import itertools
import json
import math
import shutil
import sys
import time
import tomllib
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import drawn_axes
import numpy as np
import tomlkit
from forceaxis import _core, linear
from forceaxis._core import InputError
from forceaxis.design import model_file, search
from forceaxis.design.grid import Goal
from forceaxis.linear import over as margins
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import PlantSet, ranges_of

RANGES = tomllib.loads(Path(__file__).with_name("machine_ranges.toml").read_text())
SIMPLE = tuple(kind for kind in RANGES["full_scale_n"] if kind != "bus")
KINDS = (*SIMPLE, "vertical", "bus")
OVER = drawn_axes.OVER
Sheet = dict[str, float | str]


class Dice:
    """Random numbers of one topic of one machine, which no other topic changes."""

    def __init__(self, *topic: object) -> None:
        self.rng = np.random.default_rng([1989, zlib.crc32(repr(topic).encode())])

    def between(self, span: list[float]) -> float:
        low, high = map(math.log, span)
        return float(f"{math.exp(self.rng.uniform(low, high)):.4g}")

    def of(self, choices: Any) -> Any:
        return choices[int(self.rng.integers(len(choices)))]

    def chance(self, probability: float) -> bool:
        return bool(self.rng.uniform() < probability)

    def sign(self) -> int:
        return 1 if self.chance(0.5) else -1


@dataclass
class Machine:
    """sheet: {field of the data sheet: value}. truth: {parameter of the known model: true value
    over that of the model}. elements: {disturbance: what was drawn of it}."""

    kind: str
    drive: str  # the kind that a vertical machine stands upright
    seed: int
    peak_N: float  # of the motor, along the axis
    sheet: Sheet
    truth: dict[str, float] = field(default_factory=dict)
    elements: dict[str, dict[str, Any]] = field(default_factory=dict)
    possible: tuple[str, ...] = ()  # disturbances that a machine of this data sheet can have

    def number(self, name: str) -> float:
        return float(self.sheet[name])

    @property
    def elastic(self) -> bool:
        return "transmission_stiffness_n_per_m" in self.sheet

    @property
    def tip(self) -> str:
        return "load" if self.elastic else "axis"

    @property
    def driven(self) -> str:
        return "motor" if self.elastic else "axis"

    @property
    def moving(self) -> str:
        return "m_load" if self.elastic else "m_axis"

    @property
    def full_N(self) -> float:
        return self.number("sensor_full_scale_n")

    def asked(self) -> tuple[tuple[float, ...], float]:
        """(forces, force_max) in N of the command, rounded as a user types them."""
        asked = RANGES["asked"]
        forces = tuple(rounded(share * self.full_N, 2) for share in asked["force_share"])
        return forces, rounded(asked["force_max_share"] * self.full_N, 2)


def rounded(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")


def draw(kind: str, seed: int, exact: bool = False, without: tuple[str, ...] = ()) -> Machine:
    """exact: the machine is as its data sheet says. without: disturbances that it does not have;
    nothing else of it changes."""
    dice = Dice(seed, kind, "machine")
    inner = dice.of({"vertical": SIMPLE, "bus": ("velocity", "torque")}.get(kind, (kind,)))
    sheet = _sheet(dice, inner, RANGES["full_scale_n"].get(kind, RANGES["full_scale_n"][inner]))
    if kind == "bus":
        sheet |= {"bus_cycle_ms": dice.of(RANGES["machine"]["bus_cycle_ms"]), "output_bits": 16}
    if kind == "vertical":
        _stand(dice, sheet)
    machine = Machine(kind, inner, seed, drawn_axes.values(sheet).peak_force_n, sheet)
    _sensor(Dice(seed, kind, "sensor"), machine)
    _workpiece(Dice(seed, kind, "workpiece"), machine)
    if not exact:
        _tolerate(Dice(seed, kind, "tolerance"), machine)
        _disturb(machine, without)
    return machine


def _sheet(dice: Dice, kind: str, full_scale: list[float]) -> Sheet:
    """Drive, motor, transmission and axis of a data sheet."""
    of, between = RANGES["machine"], dice.between
    full = between(full_scale)
    size = full / 300
    peak, current = between(of["peak_over_full_scale"]) * full, between(of["peak_current_a"])
    moving = between(of["moving_mass_kg"]) * size**0.7
    speed = between(of["speed_m_per_s"]) * size**-0.25
    sheet: Sheet = {"sensor_full_scale_n": full, "approach_mm": between(of["approach_mm"])}
    if kind == "voice_coil":
        moving *= between(of["voice_coil_mass_share"])
    sheet["moving_mass_kg"] = rounded(moving)
    sheet["guide_damping_n_s_per_m"] = rounded(between(of["guide_damping_1_per_s"]) * moving)
    total = moving
    if kind in ("linear", "voice_coil"):
        drive = "torque" if kind == "voice_coil" else dice.of(("velocity", "torque"))
        sheet |= {
            "drive": drive, "motor": "linear", "motor_peak_current_a": current,
            "force_constant_n_per_a": rounded(peak / current),
            "encoder_counts_per_mm": between(of["encoder_counts_per_mm"]),
        }  # fmt: skip
    else:
        drive = kind
        radius = between(of["lead_mm_per_rev"]) * size**-0.25 / 2e3 / math.pi
        belt = kind in ("velocity", "torque") and dice.chance(of["belt"])
        rotor = between(of["rotor_over_moving"]) * moving
        total += rotor
        way = {"pulley_radius_mm": rounded(1e3 * radius)} if belt else {
            "lead_mm_per_rev": rounded(2e3 * math.pi * radius)}  # fmt: skip
        torque = peak * radius / 0.9
        sheet |= way | {
            "drive": drive, "rotor_inertia_kg_m2": rounded(rotor * radius**2), "efficiency": 0.9,
            "encoder_counts_per_rev": round(between(of["encoder_counts_per_rev"])),
        }  # fmt: skip
        if kind == "stepper":
            sheet |= {
                "holding_torque_n_m": rounded(torque),
                "full_steps_per_rev": dice.of(of["full_steps_per_rev"]),
                "load_angle_damping_ratio": between(of["load_angle_damping_ratio"]),
            }
        else:
            sheet |= {
                "torque_constant_n_m_per_a": rounded(torque / current),
                "motor_peak_current_a": current,
            }
        if dice.chance(of["elastic"]):
            sheet["transmission_stiffness_n_per_m"] = between(
                of["belt_over_sensor" if belt else "transmission_over_sensor"]
            )  # times the stiffness of the sensor, which is not drawn yet
            sheet["transmission_damping_ratio"] = between(of["transmission_damping_ratio"])
    if kind == "amplifier":
        _circuit(dice, sheet, speed / radius)
    if drive in ("amplifier", "velocity"):
        sheet["velocity_loop_hz"] = between(of["velocity_loop_hz"])
        sheet["full_scale_speed_m_per_s"] = rounded(speed)
    elif drive == "stepper":
        sheet["full_scale_speed_m_per_s"] = between(of["stepper_speed_m_per_s"])
    else:
        damping = 2 * math.pi * between(of["torque_loop_hz"]) * total
        sheet["torque_damping_n_s_per_m"] = rounded(damping)
    if drive in ("velocity", "torque"):
        sheet["current_loop_hz"] = between(of["current_loop_hz"])
    return sheet


def _circuit(dice: Dice, sheet: Sheet, rad_per_s: float) -> None:
    """Winding and supply of an amplifier that is described by its circuit. The supply has the back
    EMF at the full speed and the resistance at the peak current to spare."""
    of = RANGES["machine"]
    current = float(sheet["motor_peak_current_a"])
    emf = float(sheet["torque_constant_n_m_per_a"]) * rad_per_s
    supply = max(24.0, 2 * emf)
    ohm = dice.between(of["resistive_share"]) * supply / current
    sheet |= {
        "supply_v": rounded(supply, 3),
        "resistance_ohm": rounded(ohm),
        "inductance_h": rounded(dice.between(of["electrical_time_s"]) * ohm),
    }


def _stand(dice: Dice, sheet: Sheet) -> None:
    """A vertical axis with a brake, whose weight the motor holds with a share of its force."""
    of = RANGES["machine"]
    most = of["weight_share_max"] * drawn_axes.values(sheet).peak_force_n / 9.81
    scale = min(1.0, most / float(sheet["moving_mass_kg"]))
    for name in ("moving_mass_kg", "rotor_inertia_kg_m2", "torque_damping_n_s_per_m",
                 "guide_damping_n_s_per_m"):  # fmt: skip
        if name in sheet:
            sheet[name] = rounded(scale * float(sheet[name]))
    weight = 9.81 * float(sheet["moving_mass_kg"])
    sheet |= {
        "inclination_deg": 90 * dice.sign(),
        "brake_holding_n": rounded(dice.between(of["brake_over_weight"]) * weight),
        "brake_release_ms": dice.between(of["brake_ms"]),
        "brake_engage_ms": dice.between(of["brake_ms"]),
    }


def _sensor(dice: Dice, machine: Machine) -> None:
    of, sheet, full = RANGES["sensor"], machine.sheet, machine.full_N
    stiffness = rounded(full / (1e-3 * dice.between(of["deflection_mm"])))
    bits = dice.of(of["bits"])
    code = full / 2 ** (min(bits, 16) - 1)
    noise = max(dice.between(of["noise_share"]) * full, dice.between(of["noise_codes"]) * code)
    sheet |= {
        "sensor_stiffness_n_per_m": stiffness,
        "sensor_damping_n_s_per_m": rounded(dice.between(of["damping_s"]) * stiffness),
        "sensor_bits": bits,
        "sensor_noise_n": rounded(noise),
    }
    if "transmission_stiffness_n_per_m" in sheet:
        sheet["transmission_stiffness_n_per_m"] = rounded(
            machine.number("transmission_stiffness_n_per_m") * stiffness
        )
    rate, found, late = (dice.of(of["rate_hz"]), dice.of(of["filter"]),
                         dice.between(of["latency_over_period"]))  # fmt: skip
    if not dice.chance(of["at_the_tick"]):
        sheet |= {"sensor_rate_hz": rate, "sensor_filter": found}
        if found == "none":
            sheet["sensor_latency_ms"] = rounded(min(20.0, 1e3 * late / rate))


def _workpiece(dice: Dice, machine: Machine) -> None:
    of, sheet = RANGES["workpiece"], machine.sheet
    moving = machine.number("moving_mass_kg")
    sheet |= {
        "workpiece_stiffness_n_per_m": rounded(
            dice.between(of["stiffness_over_sensor"]) * machine.number("sensor_stiffness_n_per_m")
        ),
        "workpiece_mass_kg": rounded(dice.between(of["mass_over_moving"]) * moving),
        "workpiece_damping_ratio": dice.between(of["damping_ratio"]),
    }


def _tolerate(dice: Dice, machine: Machine) -> None:
    for name, span in RANGES["tolerance"].items():
        machine.truth[machine.moving if name == "moving" else name] = dice.between(span)


# {disturbance: function that draws it. It changes data sheet and truth, and returns what the true
# model needs, or None if a machine of this data sheet cannot have it, before it draws anything.}
Draw = Callable[[Dice, dict[str, Any], Machine], dict[str, Any] | None]
DRAWS: dict[str, Draw] = {}


def disturbance(function: Draw) -> Draw:
    DRAWS[function.__name__.removeprefix("_")] = function
    return function


def _disturb(machine: Machine, without: tuple[str, ...]) -> None:
    possible = []
    for name, function in DRAWS.items():
        dice = Dice(machine.seed, machine.kind, name)
        # A part cannot be both soft and stiff: one draw decides, each has its probability.
        drawn = Dice(machine.seed, machine.kind, "part" if name in PARTS else name).rng.uniform()
        chance = RANGES["probability"]
        drawn = drawn > 1 - chance if name == "stiff" else drawn < chance
        trial = replace(machine, sheet=dict(machine.sheet), truth=dict(machine.truth))
        found = function(dice, RANGES["disturbance"][name], trial)
        if found is None:
            continue
        possible.append(name)
        if drawn and name not in without:
            machine.sheet, machine.truth = trial.sheet, trial.truth
            machine.elements[name] = found
    machine.possible = tuple(possible)


PARTS = ("soft", "stiff")


def _told(dice: Dice, of: dict[str, Any], machine: Machine, name: str, true: float) -> bool:
    """Whether the data sheet tells a value, which it then tells wrong."""
    factor, told = dice.between(of["told_factor"]), dice.chance(RANGES["told"])
    if told:
        machine.sheet[name] = rounded(true * factor)
    return told


@disturbance
def _guide_friction(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    newton = rounded(dice.between(of["share"]) * machine.peak_N)
    return {"N": newton, "told": _told(dice, of, machine, "guide_coulomb_n", newton)}


@disturbance
def _gear_friction(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any] | None:
    if not machine.elastic:
        return None
    return {"N": rounded(dice.between(of["share"]) * machine.peak_N)}


@disturbance
def _table_friction(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    return {"N": rounded(dice.between(of["share"]) * machine.full_N)}


@disturbance
def _play(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any] | None:
    if not machine.elastic:
        return None
    width = dice.between(of["width_mm"])
    return {"mm": width, "told": _told(dice, of, machine, "backlash_mm", width)}


DRIVE_NUMBERS = {
    "amplifier": ("k_torque", "k_preamp_cmd", "k_preamp_fdbk", "a_preamp_fdbk"),
    "velocity": ("velocity_loop", "peak_current", "k_motor"),
    "torque": ("drive_damping", "peak_current", "k_motor"),
    "stepper": ("holding_force", "load_angle_damping"),
}


@disturbance
def _drive_numbers(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    numbers = DRIVE_NUMBERS[str(machine.sheet["drive"])]
    wrong = [name for name in numbers if dice.chance(0.5)] or [dice.of(numbers)]
    motor = "k_force" if machine.sheet.get("motor") == "linear" else "k_torque"
    found = {}
    for name in wrong:
        error = dice.sign() * dice.between(of["error"])
        # a current limit that is higher than the data sheet says harms nothing
        found[name.replace("k_motor", motor)] = 1 - abs(error) if "current" in name else 1 + error
    machine.truth |= found
    return found


@disturbance
def _cogging(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any] | None:
    if machine.drive != "linear":
        return None
    newton = rounded(dice.between(of["share"]) * machine.peak_N)
    period = dice.between(RANGES["machine"]["magnet_period_mm"])
    told = _told(dice, of, machine, "cogging_n", newton)
    if told:
        machine.sheet["magnet_period_mm"] = period
    return {"N": newton, "period_mm": period, "told": told}


@disturbance
def _latency(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    return {"s": dice.between(of["time_s"]), "as": dice.of(("delay", "low pass"))}


def _part(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    stiffness = dice.between(of["stiffness_over_sensor"]) * machine.number(
        "sensor_stiffness_n_per_m"
    )
    machine.sheet["workpiece_stiffness_n_per_m"] = rounded(stiffness)
    return {"N/m": rounded(stiffness)}


@disturbance
def _soft(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    return _part(dice, of, machine)


@disturbance
def _stiff(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    return _part(dice, of, machine)


@disturbance
def _stiffening(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    """Of the stiffness: softer below the smallest force, stiffer above the middle of the forces."""
    (low, high), _ = machine.asked()
    factors = [dice.between(of["softer"]), 1.0, dice.between(of["stiffer"])]
    return {"factors": factors, "loads_N": [rounded(0.7 * low), rounded((low + high) / 2)]}


@disturbance
def _relaxing(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    return {"share": dice.between(of["stiffness_share"]), "s": dice.between(of["time_s"])}


@disturbance
def _hidden_mass(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    """So light a workpiece that its resonance is above every band, and the data sheet knows it."""
    share = dice.between(of["share"])
    machine.sheet["workpiece_mass_kg"] = rounded(share * machine.number("workpiece_mass_kg"))
    return {"share": share}


@disturbance
def _moving_mass(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    factor = 1 + dice.sign() * dice.between(of["error"])
    machine.truth[machine.moving] = factor
    return {"factor": factor}


@disturbance
def _frame(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any]:
    """A machine bed that stands on springs and carries motor and scale, or a tool that swings on
    the moving mass."""
    where = dice.of(("bed", "tool"))
    mass = dice.between(of[f"{where}_over_moving"]) * machine.number("moving_mass_kg")
    hz, zeta = dice.between(of[f"{where}_hz"]), dice.between(of["damping_ratio"])
    stiffness = mass * (2 * math.pi * hz) ** 2
    return {
        "where": where, "hz": hz, "mass": rounded(mass), "stiffness": rounded(stiffness),
        "damping": rounded(2 * zeta * math.sqrt(stiffness * mass)),
    }  # fmt: skip


@disturbance
def _weight(dice: Dice, of: dict[str, Any], machine: Machine) -> dict[str, Any] | None:
    if machine.kind != "vertical":
        return None
    machine.truth["g_axis"] = 1 + dice.sign() * dice.between(of["error"])
    return {"factor": machine.truth["g_axis"]}


def true_model(known: Path, machine: Machine, folder: Path) -> Path:
    """Copies the known experiments and writes the true model into a folder, and beside it
    linear.toml, of which linear figures are: without cogging, whose slope is that of a spring of
    2 pi N over the period."""
    shutil.copytree(known.parent, folder)
    document = model_file.document(known)
    for name, factor in machine.truth.items():
        parameter = document["parameters"][name]
        parameter["value"] = float(parameter["value"]) * factor
    for name, found in machine.elements.items():
        if add := ELEMENTS.get(name):
            add(document, machine, found)
    model = folder / "model.toml"
    model.write_text(tomlkit.dumps(document))
    if "cogging" in document:
        del document["cogging"], document["parameters"]["cogging"]
        del document["parameters"]["magnet_period"]
    (folder / "linear.toml").write_text(tomlkit.dumps(document))
    return model


def _named(document: Any, kind: str, name: str) -> Any:
    return next(table for table in document[kind] if table["name"] == name)


def _add(document: Any, kind: str, **values: Any) -> None:
    document.setdefault(kind, tomlkit.aot()).append(tomlkit.item(values))


def _parameter(document: Any, name: str, value: Any, unit: str) -> str:
    document["parameters"][name] = {"value": value, "unit": unit}
    return name


def _rubs(document: Any, name: str, body: str, newton: float) -> None:
    _add(document, "friction", name=name, between=[body, "ground"], coulomb=newton)


def _add_guide(document: Any, machine: Machine, found: dict[str, Any]) -> None:
    if found["told"]:
        document["parameters"]["coulomb"]["value"] = found["N"]
    else:
        _rubs(document, "seals", machine.tip, found["N"])


def _add_play(document: Any, machine: Machine, found: dict[str, Any]) -> None:
    if found["told"]:
        document["parameters"]["play"]["value"] = found["mm"] / 1e3
        return
    springs = document["spring"]
    index = next(i for i, spring in enumerate(springs) if spring["name"] == "transmission")
    taken = dict(springs[index]) | {"width": found["mm"] / 1e3}
    del springs[index]
    if not len(springs):
        del document["spring"]
    _add(document, "backlash", **taken)


def _add_cogging(document: Any, machine: Machine, found: dict[str, Any]) -> None:
    if found["told"]:
        document["parameters"]["cogging"]["value"] = found["N"]
        return
    _parameter(document, "cogging", found["N"], "N")
    _parameter(document, "magnet_period", found["period_mm"] / 1e3, "m")
    approach = machine.number("approach_mm") / 1e3
    _add(
        document, "cogging", name="magnets", between=[machine.driven, "ground"], force="cogging",
        period="magnet_period", position="-approach", **{"from": -approach - 0.1, "to": 0.02},
    )  # fmt: skip


def _add_latency(document: Any, machine: Machine, found: dict[str, Any]) -> None:
    adc = next(table for table in document["adc"] if table["channel"] == 0)
    if found["as"] == "low pass":
        adc["filter"] = 1 / found["s"]
    elif "latency" in adc:
        document["parameters"]["force_latency"]["value"] += found["s"]
    else:
        adc["latency"] = found["s"]


def _add_stiffening(document: Any, machine: Machine, found: dict[str, Any]) -> None:
    soft, _, stiff = found["factors"]
    fixture = _named(document, "spring", "fixture")
    below = _parameter(document, "k_below", f"{soft} * k_w", "N/m")
    above = _parameter(document, "k_above", f"{stiff} * k_w", "N/m")
    fixture["stiffness"] = [below, "k_w", above]
    fixture["loads"] = found["loads_N"]


def _add_relaxing(document: Any, machine: Machine, found: dict[str, Any]) -> None:
    relaxes = _parameter(document, "k_relaxes", f"{found['share']} * k_w", "N/m")
    _add(
        document, "spring", name="rubber", between=["workpiece", "ground"], stiffness=0.0,
        maxwell_stiffness=relaxes, maxwell_time=found["s"],
    )  # fmt: skip


def _add_frame(document: Any, machine: Machine, found: dict[str, Any]) -> None:
    values = {"stiffness": found["stiffness"], "damping": found["damping"]}
    if found["where"] == "tool":
        _add(document, "body", name="tool", mass=found["mass"], position="-approach")
        _add(document, "spring", name="holder", between=["tool", machine.tip], **values)
        contact = _named(document, "contact", "sensor")
        contact["between"] = ["tool", contact["between"][1]]
        return
    carried = {machine.tip, machine.driven}
    for kind in ("damper", "friction", "brake", "cogging"):
        for link in document.get(kind, ()):
            if link["between"][0] in carried and link["between"][1] == "ground":
                link["between"] = [link["between"][0], "bed"]
    _add(document, "body", name="bed", mass=found["mass"])
    _add(document, "spring", name="feet", between=["bed", "ground"], **values)
    document["drive"]["reaction"] = "bed"
    document["encoder"]["reference"] = "bed"


# In this order: a bed carries what was added before.
ELEMENTS: dict[str, Callable[[Any, Machine, dict[str, Any]], None]] = {
    "guide_friction": _add_guide,
    "gear_friction": lambda d, m, found: _rubs(d, "gear", m.driven, found["N"]),
    "table_friction": lambda d, m, found: _rubs(d, "table", "workpiece", found["N"]),
    "play": _add_play,
    "cogging": _add_cogging,
    "latency": _add_latency,
    "stiffening": _add_stiffening,
    "relaxing": _add_relaxing,
    "frame": _add_frame,
}


def modes(model: Path, machine: Machine, designed: list[dict[str, str]]) -> tuple[Any, ...]:
    """States in which linear figures of the true machine are taken: those of the design, each with
    the workpiece that slides or sticks, and with each segment of a stiffness at the forces of the
    command. What else rubs slides, and a play is closed."""
    switches = linear.facts(model).switches
    more: list[list[dict[str, str]]] = []
    if "table_friction" in machine.elements:
        more.append([{}, {"table": "stuck"}])
    if "stiffening" in machine.elements:
        more.append([{"fixture": state} for state in switches["fixture"][1:]])
    found = []
    for mode, *others in itertools.product(designed, *more):
        one = {name: state for name, state in mode.items() if name in switches}
        for other in others:
            one |= other
        if one not in found:
            found.append(one)
    return tuple(found)


def judged(
    machine: Machine, axis: _core.LiveAxis, model: Path, out: Path, forces: list[float],
    goal: dict[str, Any] | None,
) -> dict[str, Any]:  # fmt: skip
    """What the law that a tuning in `out` designed does on the true machine. goal: of the search
    for the bandwidth of the true machine (slow), or None."""
    if not (out / "design.json").exists():
        return {}
    designed = json.loads((out / "design.json").read_text())["result"]
    held = designed["bank"]
    sections = tuple(map(tuple, held["sections"]))
    bank = Bank(held["force_gain"], held["integral_rad_per_s"], held["velocity_gain"], sections)
    straight = str(model.with_name("linear.toml"))
    states = modes(Path(straight), machine, designed["modes"])
    wide = PlantSet(straight, {}, ranges_of(straight, OVER), states)
    worst = margins.worst(wide, ("zoh",), LoopSpec("bank", bank=bank))
    row = {"Ms": worst.Ms, "fS_true_Hz": worst.fS_Hz, "stable_linear": worst.stable}
    rows = drawn_axes.contacts(model, {}, forces, bank, designed, axis)
    # A first contact that is lost too often, and then holds its force without a fault, counts as
    # stable.
    bounced = [
        one.fault == "none" and {m.limit for m in one.missed} == {"contact_losses_max"}
        for one in rows
    ]
    holds = [one.is_stable or bounce for one, bounce in zip(rows, bounced, strict=True)]
    row |= {
        "stable": worst.stable and all(holds),
        "bounced": any(bounced),
        "static_error_percent": [one.static_error_percent for one in rows],
    }
    if goal is not None:
        row |= _bandwidths(straight, out, states, goal)
    return row


def _bandwidths(
    model: str, out: Path, states: tuple[Any, ...], goal: dict[str, Any]
) -> dict[str, float | None]:
    """fS that the same search finds for the true machine, over the widths of the design and over
    those of the command."""
    fitted = json.loads((out / "fit.json").read_text())["result"]
    known, true = linear.facts(fitted["model"]).parameters, linear.facts(model).parameters
    fit = {name: known[name].value for name in known} | fitted["values"]
    widths = {
        name: (true[name].value, *(end / fit[name] * true[name].value for end in span[1:]))
        for name, span in ranges_of(fitted["model"], fitted["over"], fitted["values"]).items()
        if name in true
    }
    found = {}
    for name, ranges in (("designed", widths), ("named", ranges_of(model, OVER))):
        plants = PlantSet(model, {}, ranges, states)
        worst = search.search(plants, Goal(**goal)).worst
        found[f"fS_{name}_Hz"] = worst.fS_Hz
    return found


def serve(machine: Machine, folder: Path) -> None:
    try:
        known = drawn_axes.written(folder / "known", machine.sheet) / "model.toml"
    except InputError as error:
        print(json.dumps({"new": str(error)}), flush=True)
        return
    contact = known.with_name("contact.toml")
    contact.write_text(f"seed = {machine.seed}\n{contact.read_text()}")
    model = true_model(known, machine, folder / "true")
    axis = _core.LiveAxis(
        str(model.with_name("contact.toml")), list(drawn_axes.DELIVERED),
        str(folder / "store.bin"),
    )  # fmt: skip

    def judge(out: str, forces: list[float], goal: dict[str, Any] | None = None) -> dict[str, Any]:
        began = time.process_time()
        row = {"axis_s": axis.ticks / 1500} | drawn_axes.bounds(model, axis.extremes)
        row |= judged(machine, axis, model, Path(out), forces, goal)
        return row | {"judge_s": time.process_time() - began}

    drawn_axes.answer(axis, folder, {"asked": machine.asked()}, judge)


if __name__ == "__main__":
    words = sys.argv[4:]
    left_out = next((w.partition("=")[2] for w in words if w.startswith("without=")), "")
    serve(
        draw(sys.argv[1], int(sys.argv[2]), "exact" in words, tuple(left_out.split(","))),
        Path(sys.argv[3]),
    )
