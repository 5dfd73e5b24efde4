"""Reads and writes the parameters of an axis as a TOML file.

    [about]                         # object table, firmware, node and date; see `others` below
    [axis], [law], [drive], ...     # a table for each group of objects in the object table
    force_gain = 7.5                # code/count
    bank_gain = [4.37, 0.0, 0.0, 0.0]
    # values that belong to the sensor of this axis: tare, calibration points
    [measured]
    [objects]                       # type, scale, unit and range of each object above
    force_gain = { type = "u16", ... }

A value is in the unit that the object table states, with so many digits that it is converted back
to the same raw value. The value of an enumeration is a text, and an array is a list. A COB-ID that
depends on the node id is a text such as "$NODEID+0x180", as in an EDS file.

A parameter is a value that the axis stores, with two exceptions. The objects of IDENTITY (node id,
bit rate, time stamp of object 1020h) are in no file, because two axes must not have the same
identity. The objects of MEASURED (tare, calibration points) belong to one sensor. They are in the
table [measured], which is loaded and compared only on request. force_scale, the result of a
calibration, is a parameter, because the force law and its certificate depend on it.

If [about] has others = "defaults", the file contains only values that differ from the default
values. All other parameters then have their default values, except those in the list `without`,
which could not be read or were set by a gateway. If [about] has no `others`, as in the file
bank.toml of a designed law, the file does not concern the parameters that it does not contain.
"""

import itertools
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from forceaxis import objects, toml
from forceaxis._core import InputError
from forceaxis.bus.client import to_raw
from forceaxis.bus.state_names import texts
from forceaxis.errors import ParameterError
from forceaxis.objects import AxisObject
from forceaxis.results import json_field, to_json

IDENTITY = {"stored_node_id", "stored_bit_rate", "configuration_date", "configuration_time"}
MEASURED = {
    "force_tare",
    "calibration_points",
    "calibration_date",
    *(f"calibration_{what}_{i}" for what in ("reading", "force") for i in range(1, 9)),
}
PARAMETERS = tuple(o for o in objects.OBJECTS if o.stored and o.name not in IDENTITY)
BY_NAME = {o.name: o for o in PARAMETERS}
FILE_FORMAT = 1
COB_ID_PATTERN = re.compile(r"\$NODEID\+0x([0-9a-fA-F]{1,8})")
COB_ID, COB_FLAGS = 0x7FF, 0xC0000000
HEXADECIMAL_NAMES = ("bank_crc", "certificate_hash", "certificate_parts")


def _arrays() -> dict[str, tuple[AxisObject, ...]]:
    """Finds the arrays in the object table. Returns {common name of the objects: objects of the
    array}. The objects of an array have the same properties, are adjacent in the table, and have
    numbered names, beginning with 1."""
    found: dict[str, list[AxisObject]] = {}
    for o in PARAMETERS:
        stem, _, number = o.name.rpartition("_")
        before = found.get(stem, [])
        if number == str(len(before) + 1) and all(
            (b.type, b.unit, b.scale, b.meaning) == (o.type, o.unit, o.scale, o.meaning)
            for b in before
        ):
            found[stem] = [*before, o]
    return {stem: tuple(all_) for stem, all_ in found.items() if len(all_) > 1}


ARRAYS = _arrays()
ARRAY_OF = {o.name: stem for stem, elements in ARRAYS.items() for o in elements}


@dataclass(frozen=True)
class About:
    """The table [about] of a parameter file. It describes the axis whose parameters dump() has
    written. A field whose value is None is not in the file."""

    object_table: str  # hash of the object table of the axis as 0x and 8 digits
    firmware: str | None
    axis: str
    name: str | None
    serial_number: str | None  # serial number of the axis as 0x and 8 digits
    written: str  # date on which the file was written, such as 2026-11-25
    node_id: int


@dataclass(frozen=True)
class ParameterFile:
    """Content of a parameter file: {object: raw value} of the parameters, {object: raw value} of
    the table [measured], and the names of the objects that have default values. The objects are in
    the order of the file."""

    values: dict[str, int]
    defaults: tuple[str, ...]
    measured: dict[str, int]


def default(known: AxisObject, node_id: int) -> int:
    """Returns the raw default value of an object, which may depend on the node id."""
    return known.default + (node_id if known.node_id else 0)


def engineering(known: AxisObject, raw: int) -> float:
    """Returns the engineering value of a raw value, with the fewest digits from which the same raw
    value is computed."""
    if known.scale == 1:
        return raw
    for digits in range(1, 17):
        value = float(f"{raw * known.scale:.{digits}g}")
        if round(value / known.scale) == raw:
            return value
    return raw * known.scale


def text(known: AxisObject, raw: int, node_id: int = 0) -> str:
    """Returns the text of a value in a parameter file. `raw` is the raw value of the object."""
    for name, value in texts(known).items():
        if value == raw:
            return f'"{name}"'
    if known.node_id and (raw ^ default(known, node_id)) & ~COB_FLAGS == 0:
        return f'"$NODEID+{raw - node_id:#x}"'
    stem = ARRAY_OF.get(known.name, known.name)
    if known.type == "u32" and known.unit == "1" and (
        known.part == "canopen" or stem in HEXADECIMAL_NAMES
    ):  # fmt: skip
        return f"{raw:#x}"
    return repr(engineering(known, raw))


@dataclass(frozen=True)
class Signature:
    """Properties of an object that define the meaning of its value in a parameter file: type,
    scale, unit, range of the raw value, and texts of an enumeration."""

    type: str
    scale: float
    unit: str
    min: int
    max: int
    enum: list[str] | None = json_field(omit_none=True)


def signature(known: AxisObject) -> Signature:
    """Returns the Signature of an object, as the object table of this program defines it."""
    names = list(texts(known)) or None
    return Signature(known.type, known.scale, known.unit, known.min, known.max, names)


def dump(values: Mapping[str, int], about: About, everything: bool = False) -> str:
    """Returns the text of a parameter file. `values`: {object: raw value}. `everything`: True if
    the file has to contain default values too. The list `without` of the file names all parameters
    that are not in `values`."""
    node_id = about.node_id
    groups: dict[str, list[str]] = {}
    named: list[tuple[str, AxisObject]] = []
    without: list[str] = []
    for name, elements in _entries():
        if any(o.name not in values for o in elements):
            without.append(name)
            continue
        raw = [values[o.name] for o in elements]
        if everything or any(r != default(o, node_id) for o, r in zip(elements, raw, strict=True)):
            first = elements[0]
            group = "measured" if first.name in MEASURED else first.part
            groups.setdefault(group, []).append(_line(name, elements, raw, node_id))
            named.append((name, first))
    lines = [f"# Parameters of {about.axis}", "", "[about]", f"format = {FILE_FORMAT}"]
    lines += [f"{k} = {toml.value_text(v)}" for k, v in asdict(about).items() if v is not None]
    lines.append('others = "defaults"  # of what is not named below')
    if without:
        lines.append(f"without = {toml.value_text(without)}")
    for group in (*dict.fromkeys(o.part for o in PARAMETERS), "measured"):
        if group in groups:
            lines += ["", f"[{group}]", *groups[group]]
    lines += ["", "# What the values above mean; checked when the file is loaded.", "[objects]"]
    for name, known in named:
        about_object = {k: v for k, v in asdict(signature(known)).items() if v is not None}
        facts = [f"{k} = {toml.value_text(v)}" for k, v in about_object.items()]
        lines.append(f"{name} = {{ {', '.join(facts)} }}")
    return "\n".join(lines) + "\n"


def _entries() -> Iterator[tuple[str, tuple[AxisObject, ...]]]:
    """Yields the name and the objects of each entry of a parameter file. An entry is an array or a
    single object."""
    for name, elements in itertools.groupby(PARAMETERS, lambda o: ARRAY_OF.get(o.name) or o.name):
        yield name, tuple(elements)


def _line(name: str, elements: Sequence[AxisObject], raw: Sequence[int], node_id: int) -> str:
    """Returns an entry NAME = VALUE of a parameter file, with the unit in a comment. An array whose
    objects have several CANopen indices has one text line for each index."""
    unit = "" if elements[0].unit == "1" else f"  # {elements[0].unit}"
    pairs = zip(elements, raw, strict=True)
    if name not in ARRAYS:
        return f"{name} = {text(elements[0], raw[0], node_id)}{unit}"
    rows = [
        ", ".join(text(o, r, node_id) for o, r in row)
        for _, row in itertools.groupby(pairs, lambda pair: pair[0].index)
    ]
    if len(rows) == 1 or len(rows) == len(elements):
        return f"{name} = [{', '.join(rows)}]{unit}"
    return "\n".join([f"{name} = [{unit}", *(f"    {row}," for row in rows), "]"])


@dataclass(frozen=True)
class Header:
    """The content of the tables [about] and [objects] of a parameter file."""

    #: Hash of the object table, as 0x and 8 digits, or "" if it is not in the parameter file.
    object_table: str
    #: True if all parameters that are not in the parameter file have their default values.
    has_defaults: bool
    without: list[str]  # names of objects or arrays without a value in the parameter file
    # {name of an object or array: table with its type, scale, unit and range; see Signature}
    objects: dict[str, toml.TomlValue]


def _pop_header(path: Path | str, tables: dict[str, toml.TomlValue]) -> Header:
    """Removes the tables [about] and [objects] from the tables of a parameter file, and returns
    their content. Raises InputError."""
    about, described = tables.pop("about", {}), tables.pop("objects", {})
    if not isinstance(about, dict):
        raise InputError(
            f"{path}: expected a file with a table [about]; `dump_parameters` writes such a file"
        )
    if not isinstance(described, dict):
        raise InputError(
            f"{path}: expected a file with a table [objects]; `dump_parameters` writes such a file"
        )
    if about.get("format", FILE_FORMAT) != FILE_FORMAT:
        raise InputError(
            f"{path}: about.format: expected the file format {FILE_FORMAT}, got another format; "
            "read this file with a newer version of forceaxis"
        )
    others, without = about.get("others"), about.get("without", [])
    if others not in (None, "defaults"):
        raise InputError(
            f'{path}: about.others: expected the text "defaults", got {others}; correct the text '
            "or remove this key"
        )
    names = [name for name in without if isinstance(name, str)] if isinstance(without, list) else []
    if names != without:
        raise InputError(
            f"{path}: about.without: expected a list of names of objects, got {without}"
        )
    return Header(str(about.get("object_table", "")), others is not None, names, described)


def _file_entries(
    path: Path | str, tables: Mapping[str, toml.TomlValue]
) -> Iterator[tuple[str, toml.TomlValue]]:
    """Yields key and value of each entry in the tables of a parameter file. Raises InputError."""
    for group, table in tables.items():
        if not isinstance(table, dict):
            raise InputError(
                f"{path}: {group}: expected the object {group} in a table such as [axis]; move "
                "this line into a table"
            )
        yield from table.items()


def read(path: Path | str, node_id: int, skip: Collection[str] | None = None) -> ParameterFile:
    """Reads a parameter file as a ParameterFile. `skip`: names of objects or arrays that are not
    read; None if the user cannot choose them. If entries do not agree with the object table, raises
    one InputError that states all of them."""
    tables = toml.read(path)
    header = _pop_header(path, tables)
    can_skip, skip = skip is not None, skip or ()
    problems: list[str] = []
    skipped: set[str] = set()
    values: dict[str, int] = {}
    for key, given in _file_entries(path, tables):
        if key in skip:
            skipped.add(key)
            continue
        try:
            pairs = _elements(key, given)
            skipped |= {known.name for known, _ in pairs if known.name in skip}
            for known, value in pairs:
                if known.name in skip:
                    continue
                _expect_same(known, header.objects.get(key))
                if known.name in values:
                    raise InputError(
                        f"{known.name}: expected each object once, but this object occurs twice; "
                        "remove one of the two lines"
                    )
                values[known.name] = raw_value(known, value, node_id)
        except InputError as error:
            problems.append(str(error))
    if unknown := set(skip) - skipped:
        raise ParameterError(
            "skip", f"{', '.join(sorted(unknown))}: expected names of objects that occur in {path}"
        )
    if problems:
        raise _disagreement(path, header, problems, can_skip)
    left_out = {*header.without, *skip, *values}
    defaults = [
        o.name for o in PARAMETERS
        if header.has_defaults and not {o.name, ARRAY_OF.get(o.name)} & left_out
    ]  # fmt: skip
    measured = {name: raw for name, raw in values.items() if name in MEASURED}
    parameters = {name: raw for name, raw in values.items() if name not in MEASURED}
    return ParameterFile(parameters, tuple(defaults), measured)


def _disagreement(
    path: Path | str, header: Header, problems: Sequence[str], can_skip: bool
) -> InputError:
    """Returns the error for a parameter file whose entries do not agree with the object table."""
    theirs, ours = header.object_table, table_hash()
    where = f", which is of object table {theirs}, this one is {ours}"
    other_table = where if theirs not in ("", ours) else ""
    remedy = "correct the values of these objects"
    if can_skip:
        remedy += ", or read the file without these objects: name them in `skip`"
    return InputError(f"{path}{other_table}: {'; '.join(problems)}; {remedy}")


def table_hash() -> str:
    """Returns the hash of this program's object table, in the form of the object
    object_table_hash."""
    return f"0x{objects.OBJECTS_HASH[:8]}"


def raw_value(known: AxisObject, value: toml.TomlValue, node_id: int) -> int:
    """Returns the raw value of one entry of a parameter file. Raises InputError."""
    if isinstance(value, str) and (match := COB_ID_PATTERN.fullmatch(value)):
        if not known.node_id:
            raise InputError(
                f"{known.name}: expected a number, got a value that depends on the node id; only "
                "the value of a COB-ID can depend on the node id"
            )
        return to_raw(known.name, int(match[1], 16) + node_id)
    names = texts(known)
    has_decimals = known.scale == 1 and isinstance(value, float) and not value.is_integer()
    is_unnamed = value not in names if isinstance(value, str) else bool(names)
    if (
        not isinstance(value, str | int | float)
        or isinstance(value, bool)
        or has_decimals
        or is_unnamed
    ):
        permitted = "one of " + ", ".join(names) if names else "a number"
        whole_number = " without decimals" if has_decimals else ""
        raise InputError(f"{known.name}: expected {permitted}{whole_number}, got {value}")
    return to_raw(known.name, value)


def _elements(key: str, given: toml.TomlValue) -> list[tuple[AxisObject, toml.TomlValue]]:
    """Returns a list of the objects and values in one entry of a parameter file. `key` is the name
    of an object or of an array. Raises InputError."""
    if key in BY_NAME:
        return [(BY_NAME[key], given)]
    if key in ARRAYS:
        elements = ARRAYS[key]
        if not isinstance(given, list) or len(given) != len(elements):
            raise InputError(
                f"{key}: expected a list of {len(elements)} values, one per sub-index, got {given}"
            )
        return list(zip(elements, given, strict=True))
    if key in IDENTITY:
        raise InputError(
            f"{key}: expected a file without node id and bit rate, because each axis has its own "
            "values of these two objects; remove this line and write these two objects with "
            "`write_objects`"
        )
    if key in objects.BY_NAME:
        raise InputError(
            f"{key}: expected a parameter that the axis can store, got an object that is not a "
            "parameter; remove this object from the file"
        )
    raise InputError(
        f"{key}: expected the name of an object of this firmware, got an unknown name; correct "
        "the name or remove this line"
    )


def _expect_same(known: AxisObject, described: toml.TomlValue | None) -> None:
    """Checks that type, scale, unit and texts of an object are the same in the parameter file and
    in this program. Only then does the value in the file have the same meaning. The range of the
    object may be larger in this program. Raises InputError."""
    if described is None:
        return
    if not isinstance(described, dict):
        raise InputError(
            f"{known.name}: expected a table in [objects] that describes this object, such as its "
            "type and unit, got another value"
        )
    ours = to_json(signature(known))
    least = _described_bound(known, described, "min", known.min)
    most = _described_bound(known, described, "max", known.max)
    is_same = all(described.get(k) == ours.get(k) for k in ("type", "scale", "unit", "enum"))
    if not (is_same and known.min <= least and most <= known.max):
        differing = [k for k in {**ours, **described} if described.get(k) != ours.get(k)]
        file_states = ", ".join(f"{k} {described.get(k)}" for k in differing)
        own_table = ", ".join(f"{k} {ours.get(k)}" for k in differing)
        raise InputError(
            f"{known.name}: expected the description {own_table} of this object in [objects], as "
            f"in this version of forceaxis, got {file_states}"
        )


def _described_bound(
    known: AxisObject, described: Mapping[str, toml.TomlValue], bound: str, ours: int
) -> float:
    """Returns the smallest or largest value that a parameter file permits for an object. If the
    parameter file states no such bound, returns `ours`. Raises InputError."""
    value = described.get(bound, ours)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(
            f"{known.name}: expected a number as the bound `{bound}` of this object in [objects], "
            f"got {value}"
        )
    return value
