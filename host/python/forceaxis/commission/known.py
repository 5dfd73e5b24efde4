"""Prior knowledge from the model of an axis: priors of the parameters, and the largest codes for
which the drive stays linear."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from forceaxis import linear, toml
from forceaxis.design.changes import Design
from forceaxis.errors import ParameterError
from forceaxis.linear import plant_set

# Standard deviations of the logarithms of values that are known before the measurement.
MASS, DRIVE, STIFFNESS, DAMPING, WORKPIECE = 0.05, 0.05, 0.2, math.log(2), math.log(5)
DRIVEN = ("k_torque", "k_preamp_cmd", "k_preamp_fdbk", "a_preamp_fdbk", "k_amp")
LIMITED = (("drive.voltage", "supply_limit"), ("drive.current_command", "preamp_limit"))
# step and number of steps: a step response reaches its peak within a few time constants
FINE_S, FINE_STEPS = 1e-5, 300
STEADY_HZ = 0.02
# ratio of the codes of a noise to those that keep its peak linear; noise reaches its peak rarely
PEAKY = 2
# share of the drive's limit, because a step of the noise is up to twice its amplitude
UNSATURATED = 0.7


@dataclass(frozen=True)
class Prior:
    """Prior knowledge of a parameter: its value > 0 and the standard deviation of its logarithm."""

    value: float
    spread: float

    @property
    def wide(self) -> bool:
        """Whether the standard deviation is so large that the value is nearly unknown."""
        return self.spread > 1.0


def priors(
    model: str | Path, over: Sequence[str] = (), given: Sequence[str] = (),
    overrides: linear.Overrides | None = None,
) -> dict[str, Prior]:  # fmt: skip
    """{parameter: Prior} of a model. Masses and constants of the drive and of the contact have the
    accuracy of a data sheet; the workpiece and the parameters in `over` are nearly unknown.

    given: texts NAME=VALUE (as accurate as a mass) or NAME=VALUE+-PERCENT%. Raises InputError.
    """
    known = linear.facts(model, overrides).parameters
    table = toml.read(linear.find_model(model))
    work = _workpiece(table)
    spreads: dict[str, float] = {}

    def add(name: Any, spread: float) -> None:
        if isinstance(name, str) and name in known and known[name][0] > 0:
            spreads[name] = max(spread, spreads.get(name, 0.0))

    for body in table.get("body", ()):
        add(body.get("mass"), WORKPIECE if body["name"] == work else MASS)
    for kind in ("spring", "damper", "contact", "backlash"):
        for part in table.get(kind, ()):
            on_it = kind != "contact" and work in part["between"]
            add(part.get("stiffness"), WORKPIECE if on_it else STIFFNESS)
            add(part.get("damping"), WORKPIECE if on_it else DAMPING)
    for key in DRIVEN:
        add(table.get("drive", {}).get(key), DRIVE)
    for name in plant_set.ranges_of(model, over, overrides):
        add(name, WORKPIECE)
    found = {name: Prior(known[name][0], spread) for name, spread in spreads.items()}
    for text in given:
        name, _, value = text.partition("=")
        value, _, percent = value.partition("+-")
        try:
            share = float(percent.removesuffix("%")) / 100 if percent else MASS
            prior = Prior(float(value), share)
        except ValueError:
            prior = Prior(0.0, 0.0)
        if name not in known or not (0 < prior.value < math.inf and 0 < prior.spread < math.inf):
            raise ParameterError(
                "priors",
                f"{text}: expected NAME=VALUE or NAME=VALUE+-PERCENT%, above 0, of a "
                f"parameter of the model: {', '.join(sorted(known))}",
            )
        found[name] = prior
    return found


def linear_codes(model: str | Path, overrides: linear.Overrides | None = None) -> int | None:
    """Largest codes of a noise that keep voltage and current of the model's drive within their
    limits; None without limits. Above these codes the gain of the amplifier decreases."""
    path = linear.find_model(model)
    known, table = linear.facts(path, overrides), toml.read(path).get("drive", {})
    found = []
    for signal, key in LIMITED:
        limit = table.get(key)
        limit = known.parameters.get(limit, (limit,))[0]
        if signal not in known.signals or not isinstance(limit, int | float):
            continue
        step = linear.linearise(path, outputs=(signal,), overrides=overrides).sampled(dt=FINE_S)
        x, peak = np.zeros(len(step.A)), abs(step.D[0, 0])
        for _ in range(FINE_STEPS):
            x = step.A @ x + step.B[:, 0]
            peak = max(peak, abs((step.C @ x)[0] + step.D[0, 0]))
        found.append(UNSATURATED * limit / (peak * known.volts_per_code))
    return max(1, int(min(found))) if found else None


def newton_per_code(model: str | Path, overrides: linear.Overrides | None = None) -> float:
    """N per code of the drive at standstill; inf if the drive integrates."""
    facts = linear.facts(model, overrides)
    plant = linear.linearise(
        str(model), outputs=(facts.required_reading.signal,), overrides=overrides
    )
    static = abs(plant.at(0.0).item()) if np.linalg.cond(plant.A) < 1e15 else math.inf
    return static * facts.volts_per_code


def code_rate(model: str | Path, overrides: linear.Overrides | None = None) -> float:
    """Speed of the encoder in counts/s per code, out of contact after the acceleration."""
    s = 2j * math.pi * STEADY_HZ
    plant = linear.linearise(str(model), outputs=("encoder",), overrides=overrides, free=True)
    return (s * plant.at(s).item()).real * linear.facts(model, overrides).volts_per_code


def rigid_counts(model: str | Path, overrides: linear.Overrides | None = None) -> float:
    """Counts/N of the spring of the contact itself; 0 without such a spring."""
    with Design(str(model), overrides) as plant:
        contact = plant.tables.contact
        stiffness = plant.value(contact.stiffness) if contact else None
        scale = abs(plant.facts.required_encoder.scale)
    return scale / stiffness if stiffness else 0.0


def behind_counts(model: str | Path, overrides: linear.Overrides | None = None) -> float:
    """Counts/N of the single spring between the body behind the contact and the ground; 0 without
    one."""
    with Design(str(model), overrides) as plant:
        support = plant.tables.support
        stiffness = plant.value(support.stiffness) if support else None
        scale = abs(plant.facts.required_encoder.scale)
    return scale / stiffness if stiffness else 0.0


def states_of(model: str | Path, states: dict[str, str]) -> dict[str, str]:
    """`states`, {element: state}, restricted to the elements of the model: a model in which dampers
    replace dry friction has no states of friction."""
    switches = linear.facts(model).switches
    return {name: state for name, state in states.items() if name in switches}


def states_apart(model: str | Path, states: dict[str, str]) -> dict[str, str]:
    """The entries of `states`, {element: state}, without those of the model's contacts, because the
    contacts are open."""
    contacts = {contact.name for contact in linear.facts(model).contacts}
    return {name: state for name, state in states.items() if name not in contacts}


def play_counts(model: str | Path, overrides: linear.Overrides | None = None) -> int:
    """Total backlash of a model in encoder counts; 0 without backlash or encoder."""
    path = linear.find_model(model)
    facts = linear.facts(path, overrides)
    if facts.encoder is None:
        return 0
    widths = [part.get("width", 0.0) for part in toml.read(path).get("backlash", ())]
    play_m = sum(float(facts.parameters.get(width, (width,))[0]) for width in widths)
    return math.ceil(play_m * abs(facts.required_encoder.scale))


def _workpiece(table: dict[str, Any]) -> str | None:
    """Name of the body on which the contact presses."""
    contacts = table.get("contact", ())
    return contacts[0]["between"][1] if len(contacts) == 1 else None


class SineBounds:
    """Largest codes of a sine that keep the model's drive within its limits."""

    def __init__(self, model: str | Path) -> None:
        path = linear.find_model(model)
        facts, table = linear.facts(path), toml.read(path).get("drive", {})
        self._limits = []
        for signal, key in LIMITED:
            limit = facts.parameters.get(table.get(key), (table.get(key),))[0]
            if signal in facts.signals and isinstance(limit, int | float):
                plant = linear.linearise(path, outputs=(signal,))
                self._limits.append((plant, UNSATURATED * limit / facts.volts_per_code))

    def codes(self, hz: float) -> int:
        """Largest amplitude in codes at a frequency in Hz, at least 1."""
        found = [limit / abs(plant.response([hz])[0]) for plant, limit in self._limits]
        return max(1, int(min([*found, 2047.0])))
