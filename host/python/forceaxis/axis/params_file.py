"""Parameters of an axis as a TOML file.

    [about]                         # object table, firmware, node and date; see `others` below
    [axis], [law], [drive], ...     # a table for each part of the object table
    force_gain = 7.5                # code/count
    bank_gain = [4.37, 0.0, 0.0, 0.0]
    [measured]                      # of this axis' own sensor: tare, points of the calibration
    [objects]                       # type, scale, unit and range of what stands above
    force_gain = { type = "u16", ... }

A value is in the unit of the object table, with as many digits as give its raw value back; an enum
is its text, an array a list, a COB-ID that follows the node id "$NODEID+0x180", as in an EDS.

A parameter is what the axis stores, with two exceptions. Identity (IDENTITY: node id, bit rate, the
time stamp of 1020h) is in no file, because two axes must not have the same. Measurements (MEASURED:
tare, calibration) belong to one sensor; they are in [measured], which is loaded and compared only
where that is asked for. force_scale, what a calibration is for, is a parameter: the law and its
certificate depend on it.

others = "defaults": the file holds what differs from the defaults; all else is a default, but for
what `without` names, which could not be read or belonged to a gateway. Without `others`, as in the
bank.toml of `forceaxis design`, a file concerns what it names and nothing else.
"""

import datetime
import itertools
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from forceaxis import objects, toml
from forceaxis._core import InputError
from forceaxis.bus.client import to_raw
from forceaxis.bus.state_names import texts
from forceaxis.errors import ParameterError
from forceaxis.objects import AxisObject

IDENTITY = {"stored_node_id", "stored_bit_rate", "configuration_date", "configuration_time"}
MEASURED = {
    "force_tare",
    "calibration_points",
    "calibration_date",
    *(f"calibration_{what}_{i}" for what in ("reading", "force") for i in range(1, 9)),
}
PARAMETERS = tuple(o for o in objects.OBJECTS if o.stored and o.name not in IDENTITY)
BY_NAME = {o.name: o for o in PARAMETERS}
FORMAT = 1
NODE = re.compile(r"\$NODEID\+0x([0-9a-fA-F]{1,8})")
COB_ID, COB_FLAGS = 0x7FF, 0xC0000000
HEXADECIMAL = ("bank_crc", "certificate_hash", "certificate_parts")


def _arrays() -> dict[str, tuple[AxisObject, ...]]:
    """{stem: its objects} of the table's arrays: similar objects, numbered from 1, adjacent in the
    table."""
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
STEM = {o.name: stem for stem, elements in ARRAYS.items() for o in elements}


@dataclass(frozen=True)
class About:
    """The table [about] of a file: the axis from which dump() wrote it. A field that is None is
    omitted."""

    object_table: str  #: hash, as 0x and 8 digits
    firmware: str | None
    axis: str
    name: str | None
    serial_number: str | None  #: as 0x and 8 digits
    node_id: int


@dataclass(frozen=True)
class ParameterFile:
    """Content of a file: {object: raw value} of parameters and of [measured], in the order of the
    file, and the names of the objects that have default values."""

    values: dict[str, int]
    defaults: tuple[str, ...]
    measured: dict[str, int]


def default(known: AxisObject, node_id: int) -> int:
    """Raw default value of an object on a node."""
    return known.default + (node_id if known.node_id else 0)


def engineering(known: AxisObject, raw: int) -> float:
    """The engineering value with the fewest digits that convert back to `raw`."""
    if known.scale == 1:
        return raw
    for digits in range(1, 17):
        value = float(f"{raw * known.scale:.{digits}g}")
        if round(value / known.scale) == raw:
            return value
    return raw * known.scale


def text(known: AxisObject, raw: int, node_id: int = 0) -> str:
    """A raw value in the form that a file contains."""
    for name, value in texts(known).items():
        if value == raw:
            return f'"{name}"'
    if known.node_id and (raw ^ default(known, node_id)) & ~COB_FLAGS == 0:
        return f'"$NODEID+{raw - node_id:#x}"'
    stem = STEM.get(known.name, known.name)
    if known.type == "u32" and known.unit == "1" and (
        known.part == "canopen" or stem in HEXADECIMAL
    ):  # fmt: skip
        return f"{raw:#x}"
    return repr(engineering(known, raw))


def signature(known: AxisObject) -> dict[str, Any]:
    """Type, scale, unit, range and enumeration of an object: {type, scale, unit, min, max},
    enum."""
    facts = {key: getattr(known, key) for key in ("type", "scale", "unit", "min", "max")}
    return facts | ({"enum": list(texts(known))} if texts(known) else {})


def dump(values: Mapping[str, int], about: About, everything: bool = False) -> str:
    """Text of a file with the parameters {object: raw value}; everything: includes default values.
    `without` in the file names the parameters that are not among the values."""
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
    lines = [f"# Parameters of {about.axis}", "", "[about]", f"format = {FORMAT}"]
    given = {f.name: getattr(about, f.name) for f in fields(About) if f.name != "node_id"}
    given |= {"written": f"{datetime.date.today()}", "node_id": node_id}
    lines += [f"{key} = {_toml(value)}" for key, value in given.items() if value is not None]
    lines.append('others = "defaults"  # of what is not named below')
    if without:
        lines.append(f"without = {_toml(without)}")
    for group in (*dict.fromkeys(o.part for o in PARAMETERS), "measured"):
        if group in groups:
            lines += ["", f"[{group}]", *groups[group]]
    lines += ["", "# What the values above mean; checked when the file is loaded.", "[objects]"]
    lines += [f"{name} = {_inline(signature(known))}" for name, known in named]
    return "\n".join(lines) + "\n"


def _entries() -> Iterator[tuple[str, tuple[AxisObject, ...]]]:
    """(name, objects) of each line of a file: an array or a single object."""
    for name, elements in itertools.groupby(PARAMETERS, lambda o: STEM.get(o.name) or o.name):
        yield name, tuple(elements)


def _line(name: str, elements: Sequence[AxisObject], raw: Sequence[int], node_id: int) -> str:
    """An assignment with its unit; a list continues in a new line for each further index."""
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


def _inline(facts: Mapping[str, Any]) -> str:
    return "{ " + ", ".join(f"{key} = {_toml(value)}" for key, value in facts.items()) + " }"


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return _quoted(value) if isinstance(value, str) else repr(value)


def _quoted(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def read(path: Path | str, node_id: int, skip: Collection[str] = ()) -> ParameterFile:
    """Reads a ParameterFile. skip: names of objects or arrays to leave out. Raises InputError with
    all entries that disagree with the object table."""
    tables = toml.read(path)
    about = tables.pop("about", {})
    described = tables.pop("objects", {})
    problems: list[str] = []
    parameters: dict[str, int] = {}
    measured: dict[str, int] = {}
    for name, table in (("about", about), ("objects", described)):
        if not isinstance(table, dict):
            raise InputError(f"{path}: {name}: expected a table, [{name}]")
    if about.get("format", FORMAT) != FORMAT:
        raise InputError(f"{path}: about.format: expected {FORMAT}, take a newer forceaxis")
    others = about.get("others")
    if others not in (None, "defaults"):
        raise InputError(f'{path}: about.others: expected "defaults" or no such key, got {others}')
    without = about.get("without", [])
    if not isinstance(without, list) or not all(isinstance(name, str) for name in without):
        raise InputError(f"{path}: about.without: expected a list of names, got {without}")
    unused = set(skip)
    for group, table in tables.items():
        if not isinstance(table, dict):
            raise InputError(
                f"{path}: {group}: expected it in a table such as [axis], with other objects"
            )
        for key, given in table.items():
            if key in skip:
                unused.discard(key)
                continue
            try:
                for known, value in _elements(key, given):
                    if known.name in skip:
                        unused.discard(known.name)
                        continue
                    _expect_same(known, described.get(key))
                    into = measured if known.name in MEASURED else parameters
                    if known.name in into:
                        raise InputError(f"{known.name}: expected it once, it is named twice")
                    into[known.name] = raw_value(known, value, node_id)
            except InputError as error:
                problems.append(str(error))
    if unused:
        raise ParameterError("skip", f"{', '.join(sorted(unused))}: expected names of {path}")
    if problems:
        theirs = str(about.get("object_table", ""))
        other = theirs and theirs != table_hash()
        where = f", which is of object table {theirs}, this one is {table_hash()}" if other else ""
        hint = "; correct it or skip it"
        raise InputError(f"{path}{where}: {'; '.join(problems)}{hint}")
    left_out = {*without, *skip}
    defaults = [
        o.name
        for o in PARAMETERS
        if others and not {o.name, STEM.get(o.name)} & left_out and o.name not in parameters
        and o.name not in measured
    ]  # fmt: skip
    return ParameterFile(parameters, tuple(defaults), measured)


def table_hash() -> str:
    """Hash of this program's object table, in the form of object_table_hash."""
    return f"0x{objects.OBJECTS_HASH[:8]}"


def raw_value(known: AxisObject, value: Any, node_id: int) -> int:
    """Raw value of an entry of a file. Raises InputError."""
    if isinstance(value, str) and (match := NODE.fullmatch(value)):
        if not known.node_id:
            raise InputError(f"{known.name}: expected a number, only COB-IDs follow the node id")
        return int(to_raw(known.name, int(match[1], 16) + node_id))
    whole = known.scale == 1 and isinstance(value, float) and not value.is_integer()
    listed = value not in texts(known) if isinstance(value, str) else bool(texts(known))
    if isinstance(value, bool | dict | list) or whole or listed:
        wanted = "one of " + ", ".join(texts(known)) if texts(known) else "a number"
        whole_number = " without decimals" if whole else ""
        raise InputError(f"{known.name}: expected {wanted}{whole_number}, got {value}")
    return int(to_raw(known.name, value))


def _elements(key: str, given: Any) -> list[tuple[AxisObject, Any]]:
    """(object, value) of each value in a line of a file. Raises InputError."""
    if key in BY_NAME:
        return [(BY_NAME[key], given)]
    if key in ARRAYS:
        elements = ARRAYS[key]
        if not isinstance(given, list) or len(given) != len(elements):
            raise InputError(f"{key}: expected a list of {len(elements)} values, got {given}")
        return list(zip(elements, given, strict=True))
    if key in IDENTITY:
        raise InputError(f"{key}: expected no identity of an axis in a file; set it on its own")
    if key in objects.BY_NAME:
        raise InputError(f"{key}: expected a parameter that an axis stores")
    raise InputError(f"{key}: expected an object of this table, it has none of this name")


def _expect_same(known: AxisObject, described: Any) -> None:
    """Checks that type, scale, unit and texts of an object are unchanged, so that its value keeps
    its meaning. The range may have become larger, as for stored values. Raises InputError."""
    if described is None:
        return
    if not isinstance(described, dict):
        raise InputError(f"{known.name}: expected a table of what it means in [objects]")
    ours = signature(known)
    theirs = {"min": ours["min"], "max": ours["max"]} | described
    for bound in ("min", "max"):
        if isinstance(theirs[bound], bool) or not isinstance(theirs[bound], int | float):
            raise InputError(
                f"{known.name}: expected a number as {bound} in [objects], got {theirs[bound]}"
            )
    same = all(theirs.get(k) == ours.get(k) for k in ("type", "scale", "unit", "enum"))
    if not (same and ours["min"] <= theirs["min"] and theirs["max"] <= ours["max"]):
        differing = [k for k in {**ours, **described} if described.get(k) != ours.get(k)]
        there = ", ".join(f"{k} {described.get(k)}" for k in differing)
        here = ", ".join(f"{k} {ours.get(k)}" for k in differing)
        raise InputError(f"{known.name}: expected {here} as in this table, the file has {there}")
