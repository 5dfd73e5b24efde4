"""Converts results to JSON and JSON to results. Every result is a frozen dataclass.

    @dataclass(frozen=True)
    class Margins:
        fS_Hz: float | None
        gain_margin: float = json_field(key="gain margin")
        note: str | None = json_field(default=None, omit_none=True)

The keys are the names of the fields in their order, or the `key` of a field. A field with
`omit_none` has no key while its value is None, and is written after the other fields. NumPy arrays
and scalars become lists and numbers, paths become texts, tuples become lists. nan and infinities
remain floats. A result should contain None instead, because json.dumps(allow_nan=False) raises an
error for them.

A field with `inline` contains another result or None. Instead of the field, JSON has the keys of
the contained result. If two fields have the same key, JSON has the value of the later field.
from_json() cannot read a result with such a field.
"""

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, Union, get_args, get_origin, overload

import cattrs
import numpy as np
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override

from forceaxis._core import InputError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    # Convertible: type of the values that the function to_json() can convert.
    Convertible = (
        DataclassInstance | str | float | bool | Path | None
        | Mapping[str, "Convertible"] | Sequence["Convertible"]
    )  # fmt: skip

T = TypeVar("T")
D = TypeVar("D", bound="DataclassInstance")
Json = None | bool | int | float | str | Sequence["Json"] | Mapping[str, "Json"]
JsonObject: TypeAlias = dict[str, Json]
KEY, OMIT_NONE, INLINE = "json_key", "json_omit_none", "json_inline"
TYPE_WORDS: dict[type, str] = {
    float: "a number", int: "an integer", str: "a text", bool: "true or false", NoneType: "null",
}  # fmt: skip
SHOWN_CHARACTERS = 40  # largest number of characters that a message shows of an unexpected value


def json_field(
    *, key: str | None = None, omit_none: bool = False, inline: bool = False, **given: Any
) -> Any:
    """Returns a dataclass field for a result, with options for the form of the field in JSON.

    `key`: name of the field in JSON, if it differs from the name in Python. `omit_none`: True if
    JSON has no key for the value None; the default value of the field is then None. `inline`: True
    if the value is a result or None, whose keys replace the field in JSON. `given`: arguments of
    dataclasses.field.
    """
    if omit_none:
        given.setdefault("default", None)
    return dataclasses.field(metadata={KEY: key, OMIT_NONE: omit_none, INLINE: inline}, **given)


def json_key(field: "dataclasses.Field[Any]") -> str:
    """Returns the key in JSON of a field of a result."""
    return field.metadata.get(KEY) or field.name


class _UnexpectedValue(ValueError):
    """Error: a value in JSON has another type than the field of its key. The error text states the
    expected type and the value."""


def _is_scalar_union(kind: type) -> bool:
    """Returns True if a type is a union of texts, numbers and bools, whose values JSON can
    distinguish."""
    kinds = set(get_args(kind)) - {NoneType}
    is_union = get_origin(kind) in (Union, UnionType)
    return is_union and len(kinds) > 1 and kinds <= {bool, int, float, str}


def _read_scalar(value: Json, kind: type) -> bool | int | float | str | None:
    """Returns `value` if its type is `kind`, or is one of the types in a union `kind`. An integer
    is also accepted for a float."""
    kinds = get_args(kind) or (kind,)
    if kind is float and type(value) is int:
        return float(value)
    if isinstance(value, bool | int | float | str | None) and (
        type(value) in kinds or (type(value) is int and float in kinds)
    ):
        return value
    text = json.dumps(value)
    if len(text) > SHOWN_CHARACTERS:
        text = f"{text[:SHOWN_CHARACTERS]}..."
    words = " or ".join(TYPE_WORDS[one] for one in kinds)
    raise _UnexpectedValue(f"expected {words}, got {text}")


def _reason(error: BaseException, _: type | None) -> str:
    """Returns a text for the user about an error that the package cattrs has found at one key in
    JSON."""
    if isinstance(error, _UnexpectedValue):
        return str(error)
    if isinstance(error, KeyError):
        return "expected that key, it is missing"
    if isinstance(error, cattrs.ForbiddenExtraKeysError):
        return f"expected no key {', '.join(sorted(error.extra_fields))}"
    return "expected a JSON value of another form"


def _overrides(kind: type[D]) -> dict[str, Any]:
    """Returns the rules by which cattrs converts the fields of a result. The values have the type
    Any, because mypy would compare a more precise type with all arguments of the cattrs
    functions."""
    return {
        field.name: override(
            rename=field.metadata.get(KEY),
            omit_if_default=True if field.metadata.get(OMIT_NONE) else None,
        )
        for field in dataclasses.fields(kind)
    }


def _to_dict(kind: type[D]) -> Callable[[D], JsonObject]:
    # cattrs converts a field whose type is a string or `Any` by the type of its value.
    with_all_fields = make_dict_unstructure_fn(kind, _converter, **_overrides(kind))
    inline = {json_key(f) for f in dataclasses.fields(kind) if f.metadata.get(INLINE)}

    def with_inline_keys(result: D) -> JsonObject:
        table: JsonObject = {}
        for key, value in with_all_fields(result).items():
            table.update((value or {}) if key in inline else {key: value})
        return table

    return with_inline_keys if inline else with_all_fields


def _from_dict(kind: type[D]) -> Callable[[JsonObject, type[D]], D]:
    return make_dict_structure_fn(
        kind, _converter, _cattrs_forbid_extra_keys=True, **_overrides(kind)
    )  # fmt: skip


_converter = cattrs.Converter()
_converter.register_unstructure_hook_factory(dataclasses.is_dataclass, _to_dict)
_converter.register_structure_hook_factory(dataclasses.is_dataclass, _from_dict)
_converter.register_unstructure_hook_func(
    lambda kind: getattr(kind, "__origin__", kind) is np.ndarray, lambda array: array.tolist()
)
_converter.register_unstructure_hook(np.generic, lambda scalar: scalar.item())
_converter.register_unstructure_hook(Path, str)
_converter.register_unstructure_hook_func(
    lambda kind: getattr(kind, "__origin__", kind) is tuple,
    lambda values: [_converter.unstructure(value) for value in values],
)
_converter.register_structure_hook_func(_is_scalar_union, _read_scalar)
for scalar in (bool, int, float, str):
    _converter.register_structure_hook(scalar, _read_scalar)
_converter.register_structure_hook(Path, lambda value, _: Path(value))


@overload
def to_json(result: "DataclassInstance") -> JsonObject: ...
@overload
def to_json(result: "Convertible") -> Json: ...
def to_json(result: "Convertible") -> Json:
    """Returns the result as an argument for json.dumps: dicts, lists, texts, numbers, bools and
    None."""
    made: Json = _converter.unstructure(result)
    return made


def from_json(kind: type[T], table: Json, where: str = "") -> T:
    """Returns a result of the type `kind` from the JSON table `table`, as to_json() makes it.
    Raises InputError for a missing or unknown key, and for a value of a wrong type. Its text begins
    with `where`."""
    try:
        return _converter.structure(table, kind)
    except (cattrs.BaseValidationError, ValueError, TypeError, AttributeError) as error:
        reason, _, key = cattrs.transform_error(error, "", _reason)[0].rpartition(" @ ")
        place = [where or kind.__name__, key.removeprefix(".")]
        raise InputError(": ".join([part for part in place if part] + [reason])) from None
