"""Tries elements that a model may lack, by comparison with recorded touch-downs. The elements are:
a contact that becomes stiffer with the force, hysteresis of the contact, a lag of the force sensor,
backlash of the drive, and dry friction.

Each element is added to the model. Its constants are fitted together with all other parameters. The
elements are ranked by the decrease of chi-square minus ln n for each added constant, where n is the
number of samples (Schwarz, The Annals of Statistics 6, 1978).
"""

import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from forceaxis import linear, progress
from forceaxis._core import InputError
from forceaxis.commission import contact_check
from forceaxis.commission import contact_search as searching
from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_likelihood import ContactProblem
from forceaxis.commission.known import WORKPIECE_SPREAD, Prior
from forceaxis.design import model_file
from forceaxis.linear import working

# The closed backlash has PLAY_STIFFNESS times the stiffness of the contact.
# PLAY_DAMPING is the relative damping of the closed backlash.
# Stiffness and damping of the backlash are so large that their exact size has no effect.
PLAY_STIFFNESS, PLAY_DAMPING = 50.0, 0.5

Document = tomlkit.TOMLDocument


@dataclass(frozen=True)
class TriedElement:
    """An element that was added to a model. `gain`: decrease of chi-square minus the penalty for
    its constants. `p`: p value of the model with the element. `values`: the constants of the
    element in SI units. `toml`: text to add to the model file."""

    name: str
    text: str
    gain: float
    p: float
    values: dict[str, float]
    toml: str


@dataclass(frozen=True)
class Element:
    """An element to try. add(document) adds the element to the model; its constants become
    parameters of the model. `starts`: one or more sets of start values {constant: SI value}; a fit
    begins from each. `units`: units of the constants. `drops`: parameters of the model that the
    element replaces."""

    name: str
    text: str
    add: Callable[[Document], None]
    starts: tuple[dict[str, float], ...]
    units: dict[str, str]
    drops: tuple[str, ...] = ()


class Scales:
    """Values of a model and of its recordings, such as force and stiffness. The start values of
    fits are computed from these."""

    def __init__(self, problem: ContactProblem, best: Floats) -> None:
        values = dict(zip(problem.names, np.exp(best[: len(problem.names)]).tolist(), strict=True))
        facts = linear.facts(str(problem.model), {**problem.held, **values})
        tables = model_file.read(problem.model)
        self.contact = tables.contacts[0]
        self.stiffness = working.number(self.contact.stiffness, facts.parameters) or 1e5
        self.force_N = max(float(np.ptp(t.force.values)) for t in problem.data.touches)
        self.overlap_m = self.force_N / self.stiffness
        self.body = facts.required_drive.body
        self.body_kg = facts.masses_kg.get(self.body, 1.0)
        document = model_file.document(problem.model)
        self.contact_keys = set(_named(document, "contact", self.contact.name))
        self.has_lag = "filter" in _adc(document)
        self.has_backlash = bool(tables.backlashes)
        self.has_friction = any(
            working.number(force, facts.parameters)
            for declared in tables.frictions
            for force in (declared.coulomb, declared.stiction)
        )
        self.declared_friction = tables.frictions[0] if tables.frictions else None
        body = tables.body(self.body)
        self.body_mass = body.mass if body else None


def _adc(document: Document) -> Any:
    return next(table for table in document["adc"] if table["channel"] == 0)


def _named(document: Document, kind: str, name: str) -> Any:
    return next(table for table in document[kind] if table["name"] == name)


def _append(document: Document, kind: str, values: Mapping[str, Any]) -> None:
    document.setdefault(kind, tomlkit.aot()).append(tomlkit.item(dict(values)))


def _stiffening(scales: Scales) -> Element | None:
    contact = scales.contact
    # the force of this contact is already a nonlinear curve over the overlap
    if contact.stiffness is None:
        return None

    def add(document: Document) -> None:
        table = _named(document, "contact", contact.name)
        table["stiffness"] = [contact.stiffness, "core_stiffness"]
        table["breaks"] = ["core_overlap"]

    starts = tuple(
        {"core_stiffness": scales.stiffness * 2, "core_overlap": scales.overlap_m * share}
        for share in (0.6, 0.3, 0.15)
    )
    units = {"core_stiffness": "N/m", "core_overlap": "m"}
    text = "the contact is stiffer above an overlap"
    return Element("stiffening contact", text, add, starts, units)


def _hysteresis(scales: Scales) -> Element | None:
    contact = scales.contact
    if "hysteresis_stiffness" in scales.contact_keys or contact.stiffness is None:
        return None

    def add(document: Document) -> None:
        table = _named(document, "contact", contact.name)
        table.pop("damping", None)
        table["hysteresis_stiffness"] = "slip_stiffness"
        table["hysteresis_force"] = "slip_force"

    starts = tuple(
        {"slip_stiffness": scales.stiffness * k, "slip_force": scales.force_N * f}
        for k, f in ((0.2, 0.03), (0.5, 0.1))
    )
    units = {"slip_stiffness": "N/m", "slip_force": "N"}
    text = "the contact loses energy in each cycle, whatever its speed"
    drops = contact.damping if isinstance(contact.damping, str) else None
    return Element("hysteresis", text, add, starts, units, (drops,) if drops else ())


def lag(scales: Scales) -> Element | None:
    if scales.has_lag:
        return None

    def add(document: Document) -> None:
        _adc(document)["filter"] = "sensor_filter"

    starts = ({"sensor_filter": 5000.0}, {"sensor_filter": 1200.0})
    text = "the force sensor has a low pass"
    return Element("sensor lag", text, add, starts, {"sensor_filter": "rad/s"})


def backlash(scales: Scales) -> Element | None:
    if scales.has_backlash:
        return None

    def add(document: Document) -> None:
        body = _named(document, "body", scales.body)
        rotor = dict(body.unwrap()) | {"name": "drive_side", "mass": "drive_side_mass"}
        body["mass"] = "load_side_mass"
        _append(document, "body", rotor)
        stiffness = PLAY_STIFFNESS * scales.stiffness
        damping = PLAY_DAMPING * math.sqrt(scales.stiffness * scales.body_kg)
        _append(document, "backlash", {
            "name": "play", "between": ["drive_side", scales.body], "width": "play_width",
            "stiffness": stiffness, "damping": damping,
        })  # fmt: skip
        for table in ("drive", "encoder"):
            if document.get(table, {}).get("body") == scales.body:
                document[table]["body"] = "drive_side"

    starts = tuple(
        {"play_width": scales.overlap_m / 4 * width, "drive_side_mass": scales.body_kg * share,
         "load_side_mass": scales.body_kg * (1 - share)}
        for width, share in ((0.3, 0.3), (1.0, 0.3), (1.0, 0.6))
    )  # fmt: skip
    units = {"play_width": "m", "drive_side_mass": "kg", "load_side_mass": "kg"}
    drops = (scales.body_mass,) if isinstance(scales.body_mass, str) else ()
    return Element("backlash", "the drive has backlash", add, starts, units, drops)


def friction(scales: Scales) -> Element | None:
    if scales.has_friction:
        return None

    # The first friction element in the model whose force is 0 N, or None.
    declared = scales.declared_friction

    def add(document: Document) -> None:
        if declared:
            table = _named(document, "friction", declared.name)
            table["coulomb"] = "coulomb"
            table.pop("stiction", None)
            return
        _append(document, "friction", {
            "name": "guide_friction", "between": [scales.body, "ground"], "coulomb": "coulomb",
        })  # fmt: skip

    starts = tuple({"coulomb": scales.force_N * share} for share in (0.02, 0.1))
    named = str(declared.coulomb) if declared else ""
    drops = (named,) if named.isidentifier() else ()
    return Element("friction", "the guide has dry friction", add, starts, {"coulomb": "N"}, drops)


def _elements(scales: Scales) -> list[Element]:
    """Returns the elements to try, without those that the model already has."""
    makers = (_stiffening, _hysteresis, lag, backlash, friction)
    return [element for make in makers if (element := make(scales)) is not None]


def model_text(problem: ContactProblem, element: Element, start: Mapping[str, float]) -> str:
    """Returns the text of the model file after an element was added."""
    document = model_file.document(problem.model)
    element.add(document)
    table = document.setdefault("parameters", tomlkit.table())
    for name, value in start.items():
        table[name] = {"value": value, "unit": element.units[name], "source": "to be identified"}
    return tomlkit.dumps(document)


def without_unused(text: str, path: Path) -> str:
    """Returns the text of a model file. Parameters that no element uses any more are marked in it.
    Those that are a number alone are removed."""
    document = tomlkit.parse(text)
    parameters = document.get("parameters", {})
    for _ in range(len(parameters)):
        path.write_text(tomlkit.dumps(document))
        try:
            linear.facts(str(path))
            break
        except InputError as error:
            # If several parameters are unused, the error names only one of them.
            said = str(error)
        unused = [name for name in parameters if f" parameters.{name}: " in said]
        for name in unused:
            if isinstance(parameters[name], dict):
                parameters[name]["documentation"] = True
            else:
                del parameters[name]
    return tomlkit.dumps(document)


def tried(
    problem: ContactProblem, best: Floats, cost: float, seed: int
) -> tuple[TriedElement, ...]:
    """Adds each element to the model and fits all constants. Returns the elements whose decrease of
    chi-square exceeds their penalty, sorted with the best first. `best`, `cost`: most likely
    parameters of the model without these elements, and their cost."""
    found = []
    scales = Scales(problem, best)
    with tempfile.TemporaryDirectory() as folder:
        for element in progress.each(_elements(scales), "elements"):
            one = _fitted(problem, best, cost, element, Path(folder) / "model.toml")
            if one is not None and one.gain > 0:
                found.append(one)
    return tuple(sorted(found, key=lambda one: -one.gain))


def _fitted(
    problem: ContactProblem, best: Floats, cost: float, element: Element, path: Path
) -> TriedElement | None:
    """Fits the constants of an element together with the other parameters. Returns None if no set
    of start values gives a plant that can be simulated."""
    names = [name for name in problem.names if name not in element.drops]
    kept = [i for i, name in enumerate(problem.names) if name in names]
    results = []
    for start in element.starts:
        path.write_text(without_unused(model_text(problem, element, start), path))
        own = {name: Prior(value, WORKPIECE_SPREAD) for name, value in start.items()}
        parameters = linear.facts(str(path)).parameters.keys() - {*own, *element.drops}
        held = {name: value for name, value in problem.held.items() if name in parameters}
        wider = ContactProblem(
            path, problem.data, {n: problem.priors[n] for n in names} | own, held, problem.site
        )
        point = np.concatenate([
            best[kept], [math.log(p.value) for p in own.values()], best[len(problem.names) :],
        ])  # fmt: skip
        results.append((*searching.lengthened(wider, point), wider))
    point, least, wider = min(results, key=lambda one: one[1])
    size = len(problem.force.values) + len(problem.position.values)
    gain = 2 * (cost - least) - (wider.size - problem.size) * math.log(size)
    values = dict(zip(wider.names, np.exp(point[: len(wider.names)]).tolist(), strict=True))
    own_values = {name: values[name] for name in element.units}
    return TriedElement(
        element.name, element.text, float(gain), contact_check.check(wider, point).p, own_values,
        _lines(problem, element, own_values),
    )  # fmt: skip


def _lines(problem: ContactProblem, element: Element, values: Mapping[str, float]) -> str:
    """Returns the text lines that the element adds to the model file."""
    before = tomlkit.dumps(model_file.document(problem.model)).splitlines()
    rounded = {name: float(f"{value:.4g}") for name, value in values.items()}
    after = model_text(problem, element, rounded).splitlines()
    left = list(before)
    new = []
    for line in after:
        if line in left:
            left.remove(line)
        elif line.strip():
            new.append(line)
    return "\n".join(new)
