"""The files of a tuning's folder, and what is in them: one that is damaged is refused in one line.

A shape says what a JSON value has to be: a type; `[shape]` a list of it; `{key: shape}` an object
with at least these keys; Each(shape) an object with any; Maybe(shape) it or null. A key whose shape
is Newer(shape) may be missing, as it is in the folders of earlier versions.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from forceaxis._core import InputError

# Files that a step writes and a later one reads: each has to be there where the step is done.
WITH = {"measure": ("between.json",), "write": ("before.json",)}
TOUCH_DOWN = ("time_s", "force_N", "predicted_N")  # columns of its file


@dataclass(frozen=True)
class Each:
    """An object of any keys, whose values have a shape."""

    of: Any


@dataclass(frozen=True)
class Newer:
    """Of a key that earlier versions did not write: a shape, where it is there."""

    of: Any


@dataclass(frozen=True)
class Maybe:
    """A value of a shape, or null."""

    of: Any


NUMBER, RANGE = float, [float]
LAW = {"gain": NUMBER}
FIGURES = {"Ms": NUMBER}
LEVEL = {"amplitude": int, "swing": NUMBER, "speed_rms": NUMBER}
VERIFIED = {
    "Ms": NUMBER, "Ms_error": NUMBER, "Ms_predicted": NUMBER, "Ms_hz": NUMBER, "bias_N": NUMBER,
}  # fmt: skip
RUB = {"name": str, "between": [str], "newton": NUMBER, "declared": bool}
# A simulated contact, and a gain that was cut for one.
CASE = {
    "case": str, "law": str, "verdict": str, "peak_N": Maybe(NUMBER),
    **dict.fromkeys(("static_error_percent", "settle_ms", "overshoot_percent"), Maybe(NUMBER)),
    "losses": Newer(int), "losses_max": Newer(Maybe(int)), "saturated_ms": Newer(NUMBER),
}  # fmt: skip
CUT = {"force_gain": NUMBER, "failed": int, "simulated": int, "case": str, "why": str}
RESULTS: dict[str, Any] = {
    "check": {
        "rest": {"reading": NUMBER, "noise_lsb": Maybe(NUMBER), "position": int},
        "settings": Each((int, float, str)), "law": LAW | {"integral_rad_per_s": NUMBER},
        "band_hz": RANGE, "before": LAW, "latency_ticks": int,
    },
    "free": LEVEL | {"glide": {"dead_zone": NUMBER, "rate": NUMBER, "codes": int, "rubs": bool}},
    "measure": Each(LEVEL | {"bias_N": NUMBER}),
    "fit": {
        "values": Each(NUMBER), "best": Each(NUMBER), "over": [str], "friction": [RUB],
        "parameters": Each({"value": NUMBER, "interval": RANGE, "unit": str}),
        "lines": str, "own": Each(Each(NUMBER)),
    },
    "design": {
        "bank": {
            "force_gain": NUMBER, "integral_rad_per_s": NUMBER, "velocity_gain": NUMBER,
            "sections": [RANGE],
        },
        "worst": FIGURES | {"fS_Hz": Maybe(NUMBER), "fT_Hz": Maybe(NUMBER)},
        "p": dict, "objects": Each((int, float, str)), "contact_loss": Maybe(dict),
        "on_fitted": Each(Maybe(dict)), "modes": [dict], "adc_bits": int, "cut": str,
        "times_p": Maybe(NUMBER), "simulated": Newer([CASE]), "gain_cuts": Newer([CUT]),
    },
    "simulate": {"contacts": [CASE]},
    "write": {"certificate_state": str, "objects": int},
    "verify": {"levels": Each(VERIFIED)},
    "store": {"stored": bool},
}  # fmt: skip
SHAKEN = {
    "stiffness": NUMBER, "mass": NUMBER, "stiffness_error": NUMBER, "mass_error": NUMBER,
    "hz": RANGE, "newton": RANGE, "rows": [RANGE],
}  # fmt: skip
SHAPES: dict[str, Any] = {
    "tune.json": {"order": {"forces": RANGE, "over": [str], "model": str}, "model_sha256": str},
    "found.json": {"axis": Each(int), "values": Each(int)},
    "before.json": Each(int),
    "between.json": {
        "friction_N": NUMBER, "sticks": bool, "compliance": NUMBER, "sliding": NUMBER,
        "low_N": NUMBER, "high_N": NUMBER,
    },
    "shaken.json": Maybe(SHAKEN),
    **{
        f"{step}.json": {"seconds": NUMBER, "axis_seconds": NUMBER, "result": shape}
        for step, shape in RESULTS.items()
    },
}  # fmt: skip
NEW_FOLDER = "delete the folder or give another --out"
TO_DO = {
    "tune.json": NEW_FOLDER,
    "found.json": "switch the axis off and on, which puts back what a killed run had set, then "
    "delete that file",
    "before.json": f"switch the axis off and on, then {NEW_FOLDER}",
    "between.json": "delete measure.json, the step is done again",
    "shaken.json": "delete that file and measure.json, the step is done again",
}


def read(file: Path) -> Any:
    """The value of a JSON file of a tuning's folder, None where there is none. Raises InputError
    for one that is damaged: it names what was expected where, and what to do."""
    if not file.exists():
        return None
    todo = TO_DO.get(file.name, "delete that file, the step is done again")
    try:
        value = json.loads(file.read_text(encoding="utf-8"), parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise InputError(f"{file}: expected JSON as a tuning writes it; {todo}") from None
    if file.name in SHAPES:
        wrong = _wrong(value, SHAPES[file.name], "")
        if wrong:
            raise InputError(f"{file}: {wrong}; {todo}")
    return value


def check(folder: Path, read_response: Any) -> None:
    """Reads every file of a folder that later steps read. read_response(path): of a response's
    folder, raises InputError. Raises InputError for the first that is damaged or missing."""
    held = {name: read(folder / name) for name in SHAPES}
    for step, files in WITH.items():
        for name in files:
            if held[f"{step}.json"] is not None and held[name] is None:
                raise InputError(
                    f"{folder / name}: expected that file beside {step}.json, it is missing; "
                    f"{TO_DO[name]}"
                )
    responses = [("free", "free")] if held["free.json"] is not None else []
    for name, level in (held["measure.json"] or {}).get("result", {}).items():
        responses += [("measure", name)] + [("measure", f"{name}-small")] * ("small" in level)
    for name in (held["verify.json"] or {}).get("result", {}).get("levels", {}):
        responses.append(("verify", name))
    for step, name in responses:
        try:
            read_response(folder / name)
        except InputError as error:
            raise InputError(f"{error}; delete {step}.json, the step is done again") from None
    for file in sorted(folder.glob("touch-down-*.csv")):
        _check_touch_down(file)


def _check_touch_down(file: Path) -> None:
    try:
        table = np.genfromtxt(file, delimiter=",", names=True)
        good = table.dtype.names == TOUCH_DOWN and table.ndim == 1 and len(table) > 1
        good = good and bool(np.isfinite(table["time_s"]).all())
    except (ValueError, UnicodeDecodeError, IndexError, TypeError):
        good = False
    if not good:
        raise InputError(
            f"{file}: expected numbers below {', '.join(TOUCH_DOWN)} as a tuning writes them; "
            "delete that file and verify.json, the step is done again"
        )


def _no_number(text: str) -> None:
    raise ValueError(text)


def _wrong(value: Any, shape: Any, where: str) -> str:
    """What is wrong with a value, "" for nothing. where: its keys, with dots."""
    if isinstance(shape, Newer):
        return _wrong(value, shape.of, where)
    if isinstance(shape, Maybe):
        return "" if value is None else _wrong(value, shape.of, where)
    if isinstance(shape, list):
        if not isinstance(value, list):
            return _expected(where, "a list", value)
        parts = [(f"{where}[{i}]", one, shape[0]) for i, one in enumerate(value)]
    elif isinstance(shape, dict | Each):
        if not isinstance(value, dict):
            return _expected(where, "an object", value)
        keys = shape if isinstance(shape, dict) else value
        parts = []
        for key in keys:
            name = f"{where}.{key}" if where else key
            if key not in value:
                if isinstance(shape, dict) and isinstance(shape[key], Newer):
                    continue
                return f"{name}: expected that key, it is missing"
            parts.append((name, value[key], shape[key] if isinstance(shape, dict) else shape.of))
    else:
        kinds = shape if isinstance(shape, tuple) else (shape,)
        return "" if any(_is(value, kind) for kind in kinds) else _expected(
            where, " or ".join(NAMES[kind] for kind in kinds), value
        )  # fmt: skip
    return next((text for name, one, of in parts if (text := _wrong(one, of, name))), "")


NAMES = {float: "a number", int: "an integer", str: "a text", bool: "true or false",
         dict: "an object"}  # fmt: skip


def _is(value: Any, kind: type) -> bool:
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and (
            math.isfinite(value)
        )  # fmt: skip
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def _expected(where: str, what: str, value: Any) -> str:
    text = json.dumps(value)
    got = text if len(text) <= 40 else f"{text[:40]}..."
    return f"{where + ': ' if where else ''}expected {what}, got {got}"
