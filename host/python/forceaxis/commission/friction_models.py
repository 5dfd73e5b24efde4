"""Models of an axis with the dry friction that was measured on the axis.

In a model file, friction is a [[friction]] element. Frequency responses are linear, so a damper
replaces the friction, and its size is fitted for each response (see friction): `damped`. `lines`
are the elements to add to a model.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomlkit

from forceaxis import linear, toml
from forceaxis.design import model_file
from forceaxis.linear import working

MOVING, TABLE = "guide_friction", "table_friction"
WORDS = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True)
class FrictionElement:
    """Dry friction of `newton` N between two bodies. name: of its [[friction]] element; declared:
    whether the model contains this element."""

    name: str
    between: tuple[str, str]
    newton: float
    declared: bool = False

    @property
    def damping(self) -> str:
        """Name of the damper's parameter in a `damped` model."""
        return f"b_{self.name}"


def frictions_of(
    model: str | Path, moving_N: float, workpiece_N: float
) -> tuple[FrictionElement, ...]:
    """The frictions of a model: in all `moving_N` between the drive's body and its counterpart, and
    `workpiece_N` between workpiece and ground. Frictions of the model keep their places and share
    the measured newtons in proportion to their declared values."""
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
        elif newton > 0 and (not of_work or work in facts.masses_kg):
            found.append(FrictionElement(name, (str(place[0]), str(place[1])), newton))
    return tuple(found)


def of_workpiece(model: str | Path, rub: FrictionElement) -> bool:
    """Whether a friction acts under the workpiece."""
    return model_file.read(model).workpiece in rub.between


def at_both_ends(
    model: str | Path, found: tuple[FrictionElement, ...]
) -> tuple[FrictionElement, ...]:
    """The frictions for `damped`. With a transmission between the drive's body and the body in
    contact, the measurement cannot assign the friction to one side. Each side then receives one
    half, unless the model has friction on both sides."""
    contact = model_file.read(model).contact
    near = contact.between[0] if contact else None
    drive = linear.facts(model).required_drive
    moving = [rub for rub in found if not of_workpiece(model, rub)]
    if near in (None, drive.body) or any(near in rub.between for rub in moving):
        return found
    split = []
    for rub in found:
        if rub in moving:
            rub = replace(rub, newton=rub.newton / 2)
            place = (near, str(drive.reaction))
            split.append(replace(rub, name=f"{rub.name}_{near}", between=place))
        split.append(rub)
    return tuple(split)


def toml_lines(found: tuple[FrictionElement, ...]) -> str:
    """The [[friction]] elements that the model lacks as TOML; "" if it has all of them."""
    return "\n".join(
        f'[[friction]]\nname = "{rub.name}"\nbetween = ["{rub.between[0]}", "{rub.between[1]}"]\n'
        f"coulomb = {rub.newton:.4g}\n"
        for rub in found
        if not rub.declared
    )


def with_friction(model: str | Path, found: tuple[FrictionElement, ...]) -> str:
    """The text of the model with the measured friction; its paths are valid from any folder."""
    document = _document(model)
    for rub in found:
        if rub.declared:
            own = next(f for f in document["friction"] if f["name"] == rub.name)
            own["coulomb"] = own["stiction"] = float(f"{rub.newton:.4g}")
        else:
            values: dict[str, Any] = {"name": rub.name, "between": list(rub.between)}
            values["coulomb"] = float(f"{rub.newton:.4g}")
            _add(document, "friction", values)
    _drop_unused(document, model)
    return tomlkit.dumps(document)


def damped(model: str | Path, found: tuple[FrictionElement, ...]) -> str:
    """The text of the model with a damper in the place of each friction; the damping is 0, as for a
    sliding axis."""
    document = _document(model)
    document.pop("friction", None)
    for rub in found:
        document["parameters"][rub.damping] = {
            "value": 0.0, "unit": "N s/m", "source": "what dry friction takes of a response"
        }  # fmt: skip
        values = {"name": rub.name, "between": list(rub.between), "damping": rub.damping}
        _add(document, "damper", values)
    _drop_unused(document, model)
    return tomlkit.dumps(document)


def _drop_unused(document: tomlkit.TOMLDocument, model: str | Path) -> None:
    """Removes the parameters that only the frictions of `model` used, because a model with an
    unused parameter is invalid."""
    own = document["parameters"]
    before = toml.read(linear.find_model(model)).get("friction", ())
    texts = [value for f in before for key, value in f.items() if key not in ("name", "between")]
    names = {word for text in texts if isinstance(text, str) for word in WORDS.findall(text)}
    rest = _texts({key: part for key, part in document.unwrap().items() if key != "parameters"})
    while names:
        values = [one.get("value") if isinstance(one, dict) else one for one in own.values()]
        used = {word for text in rest for word in WORDS.findall(text)}
        used |= {*WORDS.findall(" ".join(map(str, values)))}
        gone = {name for name in names & own.keys() if name not in used}
        names = set()
        for name in gone:
            value = own[name].get("value") if isinstance(own[name], dict) else own[name]
            names |= set(WORDS.findall(str(value)))
            del own[name]


def _texts(part: object) -> list[str]:
    """The texts in a part of a model that can be names of parameters."""
    if isinstance(part, dict):
        kept = [value for key, value in part.items() if key not in ("name", "between", "title")]
        return [text for value in kept for text in _texts(value)]
    if isinstance(part, list):
        return [text for value in part for text in _texts(value)]
    return [part] if isinstance(part, str) else []


def _document(model: str | Path) -> tomlkit.TOMLDocument:
    """The model file as a document with a table of parameters."""
    document = model_file.document(model)
    document.setdefault("parameters", tomlkit.table())
    return document


def _add(document: tomlkit.TOMLDocument, kind: str, values: dict[str, Any]) -> None:
    if kind not in document:
        document[kind] = tomlkit.aot()
    table = tomlkit.table()
    table.update(values)
    document[kind].append(table)
