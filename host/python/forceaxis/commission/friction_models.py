"""Adds the dry friction that was measured on an axis to a model of the axis.

In a model file, dry friction is a [[friction]] element. Frequency responses are linear. Therefore
damped() replaces each friction by a damper, whose damping is fitted for each response (see
forceaxis.commission.friction). toml_lines() returns the [[friction]] elements to add to a model.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tomlkit

from forceaxis import linear
from forceaxis.design import model_file
from forceaxis.design.model_file import Given, TableEdit
from forceaxis.linear import working

MOVING, TABLE = "guide_friction", "table_friction"
NAME = re.compile(r"[A-Za-z_]\w*")
# Keys of a model file whose text values are not names of parameters.
TEXT_KEYS = ("name", "between", "title", "unit", "source")
# Part is the type of a value in a model file.
Part = Mapping[str, "Part"] | Sequence["Part"] | Given | None


@dataclass(frozen=True)
class FrictionElement:
    """Dry friction of `newton` N between two bodies. `name` is the name of the [[friction]]
    element. `declared` is True if the model contains this element."""

    name: str
    between: tuple[str, str]
    newton: float
    declared: bool = False

    @property
    def damping(self) -> str:
        """Returns the name of the parameter of the damper that replaces this friction in a model
        from damped()."""
        return f"b_{self.name}"


def frictions_of(
    model: str | Path, moving_N: float, workpiece_N: float
) -> tuple[FrictionElement, ...]:
    """Returns the friction elements of a model. Their total force is `moving_N` between the body of
    the drive and its counterpart, and `workpiece_N` between workpiece and ground.

    Friction elements that the model already has stay where they are. The measured force is divided
    among them in proportion to their forces in the model.
    """
    tables, facts = model_file.read(model), linear.facts(model)
    work = tables.workpiece
    drive = facts.required_drive
    found = []
    for of_work, newton, name, place in (
        (False, moving_N, MOVING, (drive.body, drive.reaction)),
        (True, workpiece_N, TABLE, (work, "ground")),
    ):
        own = [f for f in tables.frictions if (work in f.between) is of_work]
        sizes = [working.number(f.coulomb, facts.parameters) or 0.0 for f in own]
        if own and sum(sizes) > 0:
            found += [
                FrictionElement(f.name, f.between, newton * size / sum(sizes), True)
                for f, size in zip(own, sizes, strict=True)
            ]
        elif newton > 0 and (not of_work or work in facts.points):
            found.append(FrictionElement(name, (str(place[0]), str(place[1])), newton))
    return tuple(found)


def of_workpiece(model: str | Path, one: FrictionElement) -> bool:
    """Returns True if a friction element is between workpiece and ground."""
    return model_file.read(model).workpiece in one.between


def at_both_ends(
    model: str | Path, found: tuple[FrictionElement, ...]
) -> tuple[FrictionElement, ...]:
    """Returns the friction elements for damped().

    If there is a transmission between the body of the drive and the body in contact, the
    measurement cannot show on which side of the transmission the friction acts. Each side then gets
    half of the friction, unless the model has friction on both sides.
    """
    contact, drive = model_file.read(model).contact, linear.facts(model).required_drive
    if contact is None or contact.between[0] == drive.body:
        return found
    tool, workpiece = contact.between
    moving = [one for one in found if workpiece not in one.between]
    if any(tool in one.between for one in moving):
        return found
    split = []
    for one in found:
        if one in moving:
            one = replace(one, newton=one.newton / 2)
            place = (tool, str(drive.reaction))
            split.append(replace(one, name=f"{one.name}_{tool}", between=place))
        split.append(one)
    return tuple(split)


def toml_lines(found: tuple[FrictionElement, ...]) -> str:
    """Returns the [[friction]] elements that have to be added to the model, as TOML text. Returns
    "" if the model already has all of them."""
    return "\n".join(
        f'[[friction]]\nname = "{rub.name}"\nbetween = ["{rub.between[0]}", "{rub.between[1]}"]\n'
        f"coulomb = {rub.newton:.4g}\n"
        for rub in found
        if not rub.declared
    )


def with_friction(model: str | Path, found: tuple[FrictionElement, ...]) -> str:
    """Returns the text of the model with the measured friction. File paths in the text are valid in
    any folder."""
    edits = []
    for one in found:
        newton = float(f"{one.newton:.4g}")
        values: dict[str, Given | list[str]] = {"coulomb": newton, "stiction": newton}
        if not one.declared:
            values = {"between": list(one.between), "coulomb": newton}
        edits.append(TableEdit("friction", one.name, values))
    document = tomlkit.parse(model_file.edited(model, edits))
    return _without_unused_parameters(document, model)


def damped(model: str | Path, found: tuple[FrictionElement, ...]) -> str:
    """Returns the text of the model with a damper in place of each friction element. Each damping
    is 0, which means an axis without friction."""
    document = model_file.document(model)
    document.pop("friction", None)
    parameters = document.setdefault("parameters", tomlkit.table())
    dampers = document.setdefault("damper", tomlkit.aot())
    for one in found:
        parameters[one.damping] = {
            "value": 0.0, "unit": "N s/m", "source": "what dry friction takes of a response"
        }  # fmt: skip
        dampers.append(
            {"name": one.name, "between": list(one.between), "damping": one.damping}
        )  # fmt: skip
    return _without_unused_parameters(document, model)


def _without_unused_parameters(document: tomlkit.TOMLDocument, model: str | Path) -> str:
    """Returns the text of a changed model without unused parameters, because a model with an unused
    parameter is invalid. These are parameters that only the friction elements of the earlier
    `model` used."""
    candidates = _names_in([[f.coulomb, f.stiction] for f in model_file.read(model).frictions])
    parameters = document.setdefault("parameters", tomlkit.table())
    others = _names_in({key: part for key, part in document.items() if key != "parameters"})
    while candidates:
        used = others | _names_in(list(parameters.values()))
        unused = (candidates & parameters.keys()) - used
        candidates = _names_in([parameters.pop(name) for name in unused])
    return tomlkit.dumps(document)


def _names_in(part: Part) -> set[str]:
    """Returns all text values in a table of a model that can be names of parameters."""
    if isinstance(part, Mapping):
        return _names_in([v for key, v in part.items() if key not in TEXT_KEYS])
    if isinstance(part, str):
        return set(NAME.findall(part))
    return set().union(*map(_names_in, part)) if isinstance(part, Sequence) else set()
