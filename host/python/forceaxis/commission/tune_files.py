"""Reads and writes the files of a tuning's folder as typed results; reports a damaged file in one
line.

The dataclasses define the content of each file. A field with a default may be absent, as in the
folders of earlier versions; keys without a field are ignored.
"""

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.commission.sine_test import SineTestResult
from forceaxis.commission.tune_results import SlowChange, Verified
from forceaxis.results import from_json, json_key, to_json

T = TypeVar("T")

FOUND, BEFORE, TUNE = "found.json", "before.json", "tune.json"
BETWEEN, SHAKEN = "between.json", "shaken.json"
# Files that one step writes and a later step reads; they have to exist if the step is done.
FILES_OF_STEP = {"measure": (BETWEEN,), "write": (BEFORE,)}
TOUCH_DOWN_COLUMNS = ("time_s", "force_N", "predicted_N")
NEW_FOLDER = "delete the folder or give another one"
REMEDIES = {
    TUNE: NEW_FOLDER,
    FOUND: "switch the axis off and on, which puts back what a killed run had set, then "
    "delete that file",
    BEFORE: f"switch the axis off and on, then {NEW_FOLDER}",
    BETWEEN: "delete measure.json, the step is done again",
    SHAKEN: "delete that file and measure.json, the step is done again",
}
TYPE_WORDS = {
    float: "a number", int: "an integer", str: "a text", bool: "true or false", dict: "an object",
    list: "a list",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class AxisState:
    """State of an axis before a run. axis: raw identity; values: raw values of the objects."""

    axis: dict[str, int]
    values: dict[str, int]


@dataclasses.dataclass(frozen=True)
class StepTimes:
    """Duration of a step in s, as wall time and as time of the axis."""

    seconds: float
    axis_seconds: float


class StepFile(NamedTuple):
    """The file of a step that is done; result: an instance of the step's result type."""

    times: StepTimes
    result: Any


@dataclasses.dataclass(frozen=True)
class TuningOrder:
    """The options of `tune`. model: path or stem of the axis' model, which gives the prior values;
    forces: N; over: texts NAME=PERCENT% or NAME=LOW..HIGH; priors: NAME=VALUE or
    NAME=VALUE+-PERCENT%, which replace prior values of the model; states: ELEMENT=STATE, in which
    the model is linearised; ms: largest permitted Ms; averages: number per response; travel_mm:
    limit of the motion by the excitation; seed: of the noise."""

    model: str
    forces: tuple[float, ...]
    over: tuple[str, ...]
    priors: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    ms: float = 2.0
    force_max_N: float = math.inf
    band_hz: tuple[float, ...] = (1.0, 100.0)
    averages: int = 8
    travel_mm: float = 1.0
    seed: int = 1


@dataclasses.dataclass(frozen=True)
class TuningIdentity:
    """Identity of the tuning in a folder: the order, the content of the model, the axis."""

    order: TuningOrder
    model_sha256: str
    object_table_hash: int | None = None
    serial_number: int | None = None


def write(folder: Path, name: str, value: Any) -> None:
    """Replaces a complete JSON file of a folder. value: a result or a value that JSON can
    represent."""
    with paths.replacing(folder, name) as (file,):
        text = json.dumps(to_json(value), indent=2, allow_nan=False)
        file.write_text(text + "\n", encoding="utf-8")


def write_step(folder: Path, step: str, done: StepFile) -> None:
    """Replaces the file of a step."""
    write(folder, f"{step}.json", to_json(done.times) | {"result": to_json(done.result)})


def read(file: Path, kind: type[T]) -> T | None:
    """Reads a JSON file as an instance of `kind`; returns None if the file does not exist. Raises
    InputError for a damaged file; the text states the place, the expected value and the remedy."""
    value = _json(file)
    return None if value is None else _typed(value, kind, file)


def read_step(file: Path, kind: Any) -> StepFile | None:
    """Reads the file of a step, whose result is an instance of `kind`; otherwise as read()."""
    value = _json(file)
    if value is None:
        return None
    times = _typed(value, StepTimes, file)
    if "result" not in value:
        raise _damaged(file, "result: expected that key, it is missing")
    return StepFile(times, _typed(value["result"], kind, file, "result"))


def _json(file: Path) -> Any:
    if not file.exists():
        return None
    try:
        return json.loads(file.read_text(encoding="utf-8"), parse_constant=_not_a_number)
    except (ValueError, RecursionError):
        raise _damaged(file, "expected JSON as a tuning writes it") from None


def _damaged(file: Path, what: str) -> InputError:
    remedy = REMEDIES.get(file.name, "delete that file, the step is done again")
    return InputError(f"{file}: {what}; {remedy}")


def _not_a_number(text: str) -> None:
    raise ValueError(text)


def _typed(value: Any, kind: Any, file: Path, where: str = "") -> Any:
    try:
        return from_json(kind, _pruned(value, kind, where))
    except _UnexpectedValue as wrong:
        raise _damaged(file, str(wrong)) from None


def check(
    folder: Path, results: Mapping[str, Any], read_response: Callable[[Path], object]
) -> None:
    """Reads all files of a folder that later steps need. results: {step: type of its result};
    read_response: reads the folder of a response and raises InputError. Raises InputError for the
    first damaged or missing file."""
    done = {step: read_step(folder / f"{step}.json", kind) for step, kind in results.items()}
    kinds: dict[str, Any] = {
        TUNE: TuningIdentity, FOUND: AxisState, BEFORE: dict[str, int], BETWEEN: SlowChange,
        SHAKEN: SineTestResult,
    }  # fmt: skip
    for name, kind in kinds.items():
        read(folder / name, kind)
    for step, files in FILES_OF_STEP.items():
        for name in files:
            if done[step] is not None and not (folder / name).exists():
                raise InputError(
                    f"{folder / name}: expected that file beside {step}.json, it is missing; "
                    f"{REMEDIES[name]}"
                )
    for step, name in _responses(done):
        try:
            read_response(folder / name)
        except InputError as error:
            raise InputError(f"{error}; delete {step}.json, the step is done again") from None
    for file in sorted(folder.glob("touch-down-*.csv")):
        _check_touch_down(file)


def _responses(done: Mapping[str, StepFile | None]) -> list[tuple[str, str]]:
    """(step, folder) of each measured response of a step."""
    found = [("free", "free")] if done["free"] else []
    if measured := done["measure"]:
        for name, level in measured.result.items():
            found += [("measure", name)] + [("measure", small_of(name))] * bool(level.small)
    verified: Verified | None = done["verify"].result if done["verify"] else None
    return found + [("verify", name) for name in (verified.levels if verified else ())]


def small_of(name: str) -> str:
    """Folder of the response with the smaller amplitude that belongs to the response `name`."""
    return f"{name}-small"


def _check_touch_down(file: Path) -> None:
    try:
        table = np.genfromtxt(file, delimiter=",", names=True)
        good = table.dtype.names == TOUCH_DOWN_COLUMNS and table.ndim == 1 and len(table) > 1
        good = good and bool(np.isfinite(table["time_s"]).all())
    except (ValueError, UnicodeDecodeError, IndexError, TypeError):
        good = False
    if not good:
        raise InputError(
            f"{file}: expected numbers below {', '.join(TOUCH_DOWN_COLUMNS)} as a tuning writes "
            "them; delete that file and verify.json, the step is done again"
        )


class _UnexpectedValue(Exception):
    """A value does not have the expected type; the text states the place."""

    def __init__(self, where: str, expected: str, value: Any) -> None:
        text = json.dumps(value)
        got = text if len(text) <= 40 else f"{text[:40]}..."
        super().__init__(f"{where + ': ' if where else ''}expected {expected}, got {got}")


def _pruned(value: Any, kind: Any, where: str) -> Any:
    """A JSON value without the keys that the dataclasses in `kind` do not define. where: the path
    of keys to the value, with dots. Raises _UnexpectedValue."""
    origin, arguments = get_origin(kind), get_args(kind)
    if dataclasses.is_dataclass(kind):
        return _pruned_object(value, kind, where)
    if origin in (Union, UnionType):
        return _pruned_union(value, arguments, where)
    if origin is dict:
        items = _instance(value, dict, where).items()
        return {key: _pruned(one, arguments[1], _below(where, key)) for key, one in items}
    if origin is tuple:
        values = _instance(value, list, where)
        count = len(values) if arguments[-1] is Ellipsis else len(arguments)
        if len(values) != count:
            raise _UnexpectedValue(where, f"a list of {count}", value)
        kinds = arguments[:1] * count if arguments[-1] is Ellipsis else arguments
        pairs = enumerate(zip(values, kinds, strict=True))
        return [_pruned(one, of, f"{where}[{i}]") for i, (one, of) in pairs]
    return value if kind is Any else _instance(value, kind, where)


def _below(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def _pruned_object(value: Any, kind: Any, where: str) -> dict[str, Any]:
    table, hints, found = _instance(value, dict, where), get_type_hints(kind), {}
    for field in dataclasses.fields(kind):
        key = json_key(field)
        if key in table:
            found[key] = _pruned(table[key], hints[field.name], _below(where, key))
        elif field.default is field.default_factory is dataclasses.MISSING:
            raise _MissingKey(_below(where, key))
    return found


class _MissingKey(_UnexpectedValue):
    def __init__(self, where: str) -> None:
        Exception.__init__(self, f"{where}: expected that key, it is missing")


def _pruned_union(value: Any, kinds: tuple[Any, ...], where: str) -> Any:
    if value is None and NoneType in kinds:
        return None
    kinds = tuple(kind for kind in kinds if kind is not NoneType)
    for kind in kinds[:-1]:
        try:
            return _pruned(value, kind, where)
        except _UnexpectedValue:
            continue
    if all(kind in TYPE_WORDS for kind in kinds) and not _is(value, kinds[-1]):
        words = " or ".join(TYPE_WORDS[kind] for kind in kinds)
        raise _UnexpectedValue(where, words, value)
    return _pruned(value, kinds[-1], where)


def _instance(value: Any, kind: Any, where: str) -> Any:
    if not _is(value, kind):
        raise _UnexpectedValue(where, TYPE_WORDS[kind], value)
    return value


def _is(value: Any, kind: type) -> bool:
    """Whether a JSON value has a type. A number has to be finite; an integer counts as a number."""
    if kind is float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and math.isfinite(value)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
