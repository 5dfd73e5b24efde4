"""The set-up of a measurement: keys of its file, options of `forceaxis measure`."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NoReturn, TypeGuard

from forceaxis import paths, toml
from forceaxis._core import InputError

CODES = ("adc0", "adc1", "encoder", "dac_code")


@dataclass(frozen=True)
class Setup:
    """Set-up of a measurement: the keys of its file and the options of the verb.

    Files are TOML; [set] contains parameters of the model. See sim/measurements/fig3_6.toml.
    """

    model: str  #: path, or stem of a file in sim/models; in a file: relative to the file
    title: str = ""
    figure: str = ""
    shows: str = ""
    input: str = ""  #: a signal or dac_code; default: the excited input (drive.command, dac_code)
    output: str = ""  #: a signal of the model, or adc0, adc1 (8-bit counts), encoder (counts)
    inject: str = "volts"  #: "volts" at the drive, or "codes" from the firmware's excitation mode
    excitation: str = "noise"  #: noise | sine (one line after another) | chirp
    band_hz: tuple[float, float] = (1.0, 200.0)  #: lowest and highest frequency
    resolution_hz: float = 0.0  #: distance between lines; 0: the lowest frequency
    #: noise V rms, else amplitude V; amplitude in codes (a sine's is drawn from half of it on).
    #: 0: 0.1 V, 20 codes
    level: float = 0.0
    bias: float = 0.0  #: mean of the excitation in V or code
    averages: int = 16  #: number of realisations, or of segments that overlap by half
    window: str = "none"  #: none (periodic), or hann for noise that is not periodic
    points: int = 40  #: lines of a sine measurement, logarithmically spaced
    #: resolution of the analyzer's converters, whose ranges are 1, 2 or 5 times 10^n
    bits: int = 12
    scale: float = 1.0  #: factor of the output, for a sensor that the model does not contain
    unit: str = ""  #: unit of the response; default: from the signals
    clamped: bool = False  #: contacts also pull, like a clamped workpiece (3.2.2)
    free: bool = False  #: contacts are open; otherwise they are closed
    seed: int = 0
    set: dict[str, float | str] = field(default_factory=dict)


def read_setup(target: str | Path, options: Mapping[str, Any] | None = None) -> tuple[Setup, str]:
    """(Setup, where) of a measurement file, or of a model; `options` replace keys. InputError."""
    options = {k: v for k, v in (options or {}).items() if v is not None}
    if not str(target).strip():
        raise InputError("measure: TARGET: expected a measurement or a model, got nothing")
    path = Path(target)
    given, where = {"model": str(target)}, str(target)
    known = paths.MEASUREMENTS / f"{target}.toml"
    if path.suffix != ".toml" and path.parent == Path() and known.exists():
        path, where = Path(paths.display(known)), paths.display(known)
    if path.suffix == ".toml":
        table = toml.read(path)
        if "duration_s" in table:
            raise InputError(
                f"{where}: duration_s: expected a measurement or a model, got an experiment; use "
                "`forceaxis run`"
            )
        if isinstance(table.get("model"), str):
            given = table | {"model": os.path.normpath(path.parent / table["model"])}
        elif not any(key in table for key in ("body", "drive", "parameters_file")):
            raise InputError(f"{where}: model: expected the path of a model beside the measurement")
    if "set" in options and isinstance(given.get("set", {}), dict):
        options["set"] = given.get("set", {}) | options["set"]
    # with another signal the title of the file is no longer correct
    for key in ("input", "output"):
        if options.get(key, given.get(key)) != given.get(key):
            given = {k: v for k, v in given.items() if k not in ("title", "figure", "shows")}
    given = given | options
    return check(given, where), where


# {key: (text about its values, function that checks a value)}.
KEYS: dict[str, tuple[str, Callable[[Any], object]]] = {
    "input": ("a signal's name", lambda v: isinstance(v, str) and v),
    "output": ("a signal's name", lambda v: isinstance(v, str) and v),
    "inject": ("volts or codes", ("volts", "codes").__contains__),
    "excitation": ("noise, sine or chirp", ("noise", "sine", "chirp").__contains__),
    "window": ("none or hann", ("none", "hann").__contains__),
    "band_hz": (
        "two rising frequencies below 1e6, [1, 200]",
        lambda v: len(v) == 2 and all(is_number(x) for x in v) and 0 < v[0] < v[1] < 1e6,
    ),
    "resolution_hz": (
        "a frequency of 0.001 Hz or more",
        lambda v: is_number(v) and 1e-3 <= v < 1e6,
    ),
    "level": ("a number > 0, below 1e6", lambda v: is_number(v) and 0 < v < 1e6),
    "bias": ("a number between -1e6 and 1e6", lambda v: is_number(v) and abs(v) < 1e6),
    "averages": ("a whole number 4..4096", lambda v: is_whole(v) and 4 <= v <= 4096),
    "points": ("a whole number 2..1000", lambda v: is_whole(v) and 2 <= v <= 1000),
    "bits": ("a whole number 8..16", lambda v: is_whole(v) and 8 <= v <= 16),
    "scale": (
        "a number other than 0, below 1e12",
        lambda v: is_number(v) and v != 0 and abs(v) < 1e12,
    ),
    "clamped": ("true or false", lambda v: isinstance(v, bool)),
    "free": ("true or false", lambda v: isinstance(v, bool)),
    "seed": ("a whole number 0..2^31 - 1", lambda v: is_whole(v) and 0 <= v < 2**31),
    "set": (
        "a table of numbers or quantities",
        lambda v: (
            isinstance(v, dict) and all(is_number(x) or isinstance(x, str) for x in v.values())
        ),
    ),
}


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value of a file is a finite number."""
    return not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value)


def is_whole(value: object) -> TypeGuard[int]:
    """Whether a value of a file is a whole number."""
    return not isinstance(value, bool) and isinstance(value, int)


def check(given: Mapping[str, Any], where: str) -> Setup:
    """A Setup from the keys of a file, after a check of each key. Raises InputError."""

    def fail(key: str, text: str) -> NoReturn:
        raise InputError(f"{where}: {key}: {text}")

    names = [f.name for f in fields(Setup)]
    toml.expect_keys(given, names, fail)
    for key, value in given.items():
        text, holds = KEYS.get(
            key, ("a text of one line", lambda v: isinstance(v, str) and v.isprintable())
        )
        try:
            good = holds(value)
        except TypeError:
            good = False
        if not good:
            fail(key, f"expected {text}, got {value!r}")
    setup = Setup(**given)
    codes = setup.inject == "codes"
    if not setup.output:
        fail("output", "expected the name of a signal; name what is measured")
    low, high = setup.band_hz
    setup = replace(
        setup,
        input=setup.input or ("dac_code" if codes else "drive.command"),
        level=setup.level or (20 if codes else 0.1),
        resolution_hz=setup.resolution_hz or low,
        band_hz=(float(low), float(high)),
    )
    if setup.window == "hann" and setup.excitation != "noise":
        fail("window", f"expected none with {setup.excitation}, which is measured over a period")
    if setup.free and setup.clamped:
        fail("clamped", "expected either clamped or free contacts")
    if codes and not (setup.level <= 2048 and setup.level == int(setup.level)):
        fail("level", f"expected whole codes 1..2048, got {setup.level:g}")
    if codes and not (-2048 <= setup.bias <= 2047 and setup.bias == int(setup.bias)):
        fail("bias", f"expected a whole code -2048..2047, got {setup.bias:g}")
    if codes and setup.level + abs(setup.bias) > 2048:
        fail(
            "level",
            f"expected level and bias of 2048 codes together at most, where the DAC ends, got "
            f"{setup.level:g} and {setup.bias:g}",
        )
    for key in ("input", "output"):
        if not codes and getattr(setup, key) in CODES:
            fail(key, f"expected a simulated signal, {getattr(setup, key)} needs inject = codes")
    return setup
