"""Reads engineering values of objects of one axis. The objects are given by their names, or as the
fields of a dataclass.

    @dataclass(frozen=True)
    class TareObjects:
        tare_state: str
        force_tare: float

    AxisValues(link).record(TareObjects)      # TareObjects(tare_state="idle", force_tare=0.0)

A value is a number in the unit of its object, or the text of an enumeration.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeVar

from forceaxis._core import InputError
from forceaxis.bus.client import Value, from_raw, object_named

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from forceaxis.axis.link import Link
    from forceaxis.objects import AxisObject

R = TypeVar("R", bound="DataclassInstance")


def known_object(name: str) -> AxisObject:
    """Returns the description of the object with a name. Raises InputError for an unknown name. A
    CANopen address is not permitted and also raises InputError."""
    known = object_named(name)
    if known is None:
        raise InputError(
            f"{name}: expected the name of an object, got an unknown name; `list_objects` "
            "lists the names"
        )
    return known


def object_names(kind: type[R]) -> list[str]:
    """Returns the field names of a dataclass. Each field name must be the name of an object."""
    return [field.name for field in dataclasses.fields(kind)]


class AxisValues:
    """Reads the objects of one axis over a connection."""

    def __init__(self, link: Link) -> None:
        self.link = link

    def get(self, *names: str) -> dict[str, Value]:
        """Reads objects in the order of `names`. Returns {name: engineering value or text of an
        enumeration}. Raises InputError for an unknown name; Refused; NoAnswer."""
        for name in names:
            known_object(name)
        raw = self.link.read(names)
        return {name: from_raw(name, raw[name]) for name in names}

    def read(self, name: str) -> Value:
        """Returns the engineering value of one object, or the text of an enumeration. Raises the
        errors of get()."""
        return self.get(name)[name]

    def number(self, name: str) -> float:
        """Returns the value of one object that is not an enumeration. Raises the errors of
        get()."""
        return self.numbers(name)[name]

    def numbers(self, *names: str) -> dict[str, float]:
        """Returns {name: value} of objects that are not enumerations. Raises the errors of
        get()."""
        found: dict[str, float] = {}
        for name, value in self.get(*names).items():
            if isinstance(value, str):
                raise InputError(f"{name}: expected an object that is a number, got {value}")
            found[name] = value
        return found

    def integer(self, name: str) -> int:
        """Returns the value of an object that is an integer. Raises the errors of get()."""
        value = self.read(name)
        if not isinstance(value, int):
            raise InputError(f"{name}: expected an object that is an integer, got {value}")
        return value

    def text(self, name: str) -> str:
        """Returns the value of an enumeration as text. A value without a text is returned as its
        number. Raises the errors of get()."""
        return str(self.read(name))

    def record(self, kind: type[R]) -> R:
        """Reads the objects of the axis whose names are the fields of the dataclass `kind`. Returns
        an instance of `kind`. Raises the errors of get()."""
        return kind(**self.get(*object_names(kind)))


class PlannedValues(AxisValues):
    """Values that the objects of an axis will have after a planned write. `planned`: {name: raw
    value} of the objects that will be written."""

    def __init__(self, axis: AxisValues, planned: Mapping[str, int]) -> None:
        super().__init__(axis.link)
        self.axis, self.planned = axis, planned
        # {name: value} of objects that were already read. Each object is read only once.
        self._present: dict[str, Value] = {}

    def get(self, *names: str) -> dict[str, Value]:
        """Returns the values that objects will have after the planned write, in the form of
        AxisValues.get(). Objects that the connection cannot access are left out."""
        reached = [n for n in names if n in self.planned or self.link.reaches(n)]
        missing = [n for n in reached if n not in self.planned and n not in self._present]
        if missing:
            self._present |= self.axis.get(*missing)
        return {
            name: from_raw(name, self.planned[name])
            if name in self.planned
            else self._present[name]
            for name in reached
        }

    def record(self, kind: type[R]) -> R:
        """Returns the values as an instance of `kind`, in the same way as AxisValues.record(). The
        field of an object that the connection cannot access is None."""
        names = object_names(kind)
        return kind(**{**dict.fromkeys(names), **self.get(*names)})
