"""Reads the tables of a model file into dataclasses, and changes a model file without loss of
comments.

The compiled module computes with a model, but it does not tell which parameter name or text of the
file gives a value. This module reads these names and texts.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import tomlkit

from forceaxis import toml
from forceaxis.linear import system as linear
from forceaxis.results import JsonObject, from_json

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")

CURRENT_SIGNAL = "drive.current"  # signal of the model that the ADC of the current measures
# Value of a key in a model file: a number, a quantity with a unit, or the name of a parameter.
Given = float | str


@dataclass(frozen=True)
class ModelBody:
    """One element [[body]] of a model file. A field is None if the file does not have the key."""

    name: str
    mass: Given | None = None
    position: Given | None = None
    velocity: Given | None = None


@dataclass(frozen=True)
class ModelLink:
    """One element [[spring]], [[damper]], [[contact]] or [[backlash]] between two bodies, or
    between a body and "ground". `width` belongs to a backlash, `maxwell_stiffness` to a part that
    relaxes. A field is None if the file does not have the key, or if the key has a list of several
    values."""

    name: str
    between: tuple[str, str]
    stiffness: Given | None = None
    damping: Given | None = None
    width: Given | None = None
    maxwell_stiffness: Given | None = None


@dataclass(frozen=True)
class ModelFriction:
    """One element [[friction]] between two bodies, or between a body and "ground", with sliding
    force and breakaway force. A field is None if the file does not have the key."""

    name: str
    between: tuple[str, str]
    coulomb: Given
    stiction: Given | None = None


@dataclass(frozen=True)
class ModelAdc:
    """One element [[adc]] of a model file. A key that the file does not have has its default."""

    channel: int
    signal: str = ""
    bits: int = 8
    per_count: Given = 0
    zero_code: Given = 0
    noise: Given | None = None


@dataclass(frozen=True)
class ModelDrive:
    """The table [drive] of a model file, with those keys that a design reads or changes."""

    type: str = ""
    b_m: Given | None = None
    k_amp: Given | None = None
    k_amp_outer: Given | None = None
    k_torque: Given | None = None
    k_preamp_cmd: Given | None = None
    k_preamp_fdbk: Given | None = None
    a_preamp_fdbk: Given | None = None
    preamp_limit: Given | None = None
    supply_limit: Given | None = None
    R: Given | None = None
    L: Given | None = None
    a_act: Given | None = None
    k_act: Given | None = None
    k_force: Given | None = None
    current_bandwidth: Given | None = None
    current_per_volt: Given | None = None
    velocity_per_volt: Given | None = None
    force_per_volt: Given | None = None
    damping: Given | None = None
    k_velocity: Given | None = None
    integral_time: Given | None = None
    bandwidth: Given | None = None
    damping_ratio: Given | None = None
    tuned_mass: Given | None = None
    tuned_inertia: Given | None = None
    holding_force: Given | None = None
    peak_current: Given | None = None
    rated_current: Given | None = None
    full_step: Given | None = None
    segments: int = 16


@dataclass(frozen=True)
class ModelFile:
    """The tables of a model file: elements, converters and drive."""

    bodies: tuple[ModelBody, ...]
    springs: tuple[ModelLink, ...]
    dampers: tuple[ModelLink, ...]
    contacts: tuple[ModelLink, ...]
    backlashes: tuple[ModelLink, ...]
    frictions: tuple[ModelFriction, ...]
    adcs: tuple[ModelAdc, ...]
    drive: ModelDrive

    @property
    def contact(self) -> ModelLink | None:
        """Returns the contact at which the axis presses on the workpiece, or None if the model does
        not have exactly one contact."""
        return self.contacts[0] if len(self.contacts) == 1 else None

    @property
    def workpiece(self) -> str | None:
        """Returns the name of the body on which the axis presses, or "ground". Returns None if the
        model does not have exactly one contact."""
        return self.contact.between[1] if self.contact else None

    @property
    def support(self) -> ModelLink | None:
        """Returns the spring that supports the workpiece, or None if the workpiece does not have
        exactly one spring. A spring that only relaxes supports nothing."""
        found = [
            spring
            for spring in self.springs
            if self.workpiece in spring.between and spring.stiffness != 0
        ]
        return found[0] if len(found) == 1 else None

    @property
    def force_adc(self) -> ModelAdc:
        """Returns the element [[adc]] on channel 0, which belongs to the force sensor."""
        return next(adc for adc in self.adcs if adc.channel == 0)

    @property
    def current_adc(self) -> ModelAdc | None:
        """Returns the element [[adc]] that measures the current of the drive, or None if there is
        none."""
        return next((adc for adc in self.adcs if adc.signal == CURRENT_SIGNAL), None)

    def body(self, name: str | None) -> ModelBody | None:
        """Returns the body with the name `name`, or None if the model has no such body."""
        return next((body for body in self.bodies if body.name == name), None)


def read(model: str | Path) -> ModelFile:
    """Returns the tables of a model file. The model is a path or a file name without suffix. Raises
    InputError."""
    path = linear.find_model(model)
    table = toml.read(path)

    def every(kind: type[T], name: str) -> tuple[T, ...]:
        return tuple(_of_table(kind, row, f"{path}: {name}") for row in table.get(name, ()))

    return ModelFile(
        bodies=every(ModelBody, "body"),
        springs=every(ModelLink, "spring"),
        dampers=every(ModelLink, "damper"),
        contacts=every(ModelLink, "contact"),
        backlashes=every(ModelLink, "backlash"),
        frictions=every(ModelFriction, "friction"),
        adcs=every(ModelAdc, "adc"),
        drive=_of_table(ModelDrive, table.get("drive", {}), f"{path}: drive"),
    )


def force_adc_table(model: str | Path) -> JsonObject:
    """Returns all keys of the element [[adc]] on channel 0. The model is a path or a file name
    without suffix. Raises InputError."""
    adcs = toml.read(linear.find_model(model)).get("adc", ())
    return next((dict(adc) for adc in adcs if adc.get("channel") == 0), {})


def _of_table(kind: type[T], table: JsonObject, where: str) -> T:
    """Returns an object of the dataclass `kind`. Each field gets the value of the table's key with
    the same name."""
    known = {field.name for field in dataclasses.fields(kind)}
    found = {key: table[key] for key in known & table.keys()}
    if kind is ModelLink:
        found |= {key: None for key, v in found.items() if key != "between" and isinstance(v, list)}
    return from_json(kind, found, where)


@dataclass(frozen=True)
class TableEdit:
    """New values for one element of a model file. If the file does not have the element, the edit
    adds it.

    kind: name of the array of tables, such as "spring". key: name of the element, or channel of an
    ADC. values: {key of the table: new value}.
    """

    kind: str
    key: str | int
    values: Mapping[str, Given | list[str]]


def document(model: str | Path) -> tomlkit.TOMLDocument:
    """Returns a model file as an editable document that keeps the comments of the file.

    tomlkit.dumps gives the text of the document. This text is valid in any folder, because it
    contains the absolute path of the parameters file.
    """
    path = linear.find_model(model)
    found = tomlkit.parse(path.read_text(encoding="utf-8-sig"))
    if parameters := found.get("parameters_file"):
        found["parameters_file"] = str((path.parent / parameters).resolve())
    return found


def edited(model: str | Path, edits: Iterable[TableEdit]) -> str:
    """Returns the text of a model file after `edits`. The text is valid in any folder."""
    found = document(model)
    for edit in edits:
        tables = found.setdefault(edit.kind, tomlkit.aot())
        of_name = "channel" if edit.kind == "adc" else "name"
        own = [table for table in tables if table[of_name] == edit.key]
        if own:
            own[0].update(edit.values)
        else:
            tables.append({of_name: edit.key, **edit.values})
    return tomlkit.dumps(found)
