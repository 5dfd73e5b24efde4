"""The set-up of a measurement of a simulated plant: reads and checks the keys of the set-up
file."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NoReturn, TypeAlias, TypeGuard

from forceaxis import paths, toml
from forceaxis._core import InputError
from forceaxis.toml import TomlValue

CODES = ("adc0", "adc1", "encoder", "dac_code")  # names of the converter codes of the firmware

SetupTable: TypeAlias = Mapping[
    str, Any
]  # keys of a measurement file; an option with the same name replaces a key
Check: TypeAlias = Callable[[TomlValue], bool]


@dataclass(frozen=True)
class Setup:
    """Set-up of a measurement of a simulated plant: the keys of a TOML file.

    The table [set] contains parameters of the model. An example is sim/measurements/fig3_6.toml.
    """

    #: model: a path (in a file, relative to the file), or the name of a file in sim/models
    model: str
    title: str = ""
    figure: str = ""
    shows: str = ""
    #: input: a signal or dac_code. The default is the excited input (drive.command or dac_code).
    input: str = ""
    #: output: a signal of the model, adc0, adc1 (8-bit counts) or encoder (counts)
    output: str = ""
    #: excited input: "volts" at the drive, or "codes" from the firmware's excitation mode
    inject: str = "volts"
    excitation: str = "noise"  #: waveform: noise, sine (one spectral line after another) or chirp
    band_hz: tuple[float, float] = (1.0, 200.0)  #: lowest and highest frequency of the response
    resolution_hz: float = 0.0  #: distance between spectral lines; 0 selects the lowest frequency
    #: Level of the excitation. With "volts", it is the rms in V for noise, else the amplitude in V.
    #: With "codes", the level is in DAC codes. A sine then has a random amplitude from half of it.
    #: The level 0 of the excitation selects 0.1 V or 20 codes.
    level: float = 0.0
    bias: float = 0.0  #: mean of the excitation in V or in DAC codes
    averages: int = 16  #: number of realisations, or of segments that overlap by half
    #: window function: none (periodic excitation), or hann (noise that is not periodic)
    window: str = "none"
    points: int = 40  #: number of spectral lines for a sine, logarithmically spaced
    #: resolution in bits of the analyzer's converters, whose ranges are 1, 2 or 5 times 10^n
    bits: int = 12
    scale: float = 1.0  #: factor of the output, for a sensor that is not in the model
    unit: str = ""  #: unit of the response; the default follows from the signals
    clamped: bool = False  #: True if contacts also pull, as with a clamped workpiece (3.2.2)
    free: bool = False  #: True if contacts are open, otherwise they are closed
    seed: int = 0
    set: dict[str, float | str] = field(default_factory=dict)


def read_setup(target: str | Path, options: SetupTable | None = None) -> tuple[Setup, str]:
    """Reads the set-up of a measurement from a measurement file or a model. Returns (Setup, name of
    the set-up in error messages).

    `target`: a path, or the name of an installed file. `options`: keys that replace those of the
    file. Raises InputError.
    """
    options = {key: value for key, value in (options or {}).items() if value is not None}
    if not str(target).strip():
        raise InputError("measure: TARGET: expected a measurement or a model, got an empty text")
    path = Path(target)
    given, where = {"model": str(target)}, str(target)
    known = paths.MEASUREMENTS / f"{target}.toml"
    if path.suffix != ".toml" and path.parent == Path() and known.exists():
        path, where = Path(paths.display(known)), paths.display(known)
    if path.suffix == ".toml":
        table = toml.read(path)
        if "duration_s" in table:
            raise InputError(
                f"{where}: duration_s: expected the file of a measurement or a model, got an "
                "experiment; use `run_experiment` for an experiment"
            )
        if isinstance(table.get("model"), str):
            given = table | {"model": os.path.normpath(path.parent / table["model"])}
        elif not any(key in table for key in ("body", "drive", "parameters_file")):
            raise InputError(
                f"{where}: model: expected the path of a model, relative to the file of the "
                "measurement"
            )
    if "set" in options and isinstance(given.get("set", {}), dict):
        options["set"] = given.get("set", {}) | options["set"]
    # The title in the file describes only the signals of the file, so it is dropped for others.
    for key in ("input", "output"):
        if options.get(key, given.get(key)) != given.get(key):
            given = {k: v for k, v in given.items() if k not in ("title", "figure", "shows")}
    given = given | options
    return check(given, where), where


def is_number(value: TomlValue) -> TypeGuard[float]:
    """Returns True if a value in a file is a finite number."""
    return not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value)


def _number(low: float, high: float) -> Check:
    """Returns a function that checks a number: it must be at least `low` and below `high`."""
    return lambda value: is_number(value) and low <= value < high


def _whole(low: int, high: int) -> Check:
    """Returns a function that checks an integer: it must be from `low` to `high`."""
    return lambda value: is_number(value) and isinstance(value, int) and low <= value <= high


def _magnitude(low: float, high: float) -> Check:
    """Returns a function that checks a number: its magnitude must be above `low` and below
    `high`."""
    return lambda value: is_number(value) and low < abs(value) < high


def _is_band(value: TomlValue) -> bool:
    if not isinstance(value, list | tuple) or len(value) != 2:
        return False
    low, high = value
    return is_number(low) and is_number(high) and 0 < low < high < 1e6


def _is_table(value: TomlValue) -> bool:
    return isinstance(value, Mapping) and all(
        is_number(item) or isinstance(item, str) for item in value.values()
    )


def _is_line(value: TomlValue) -> bool:
    return isinstance(value, str) and bool(value) and value.isprintable()


# {key of a measurement file: (text about the permitted values, function that checks a value)}
KEYS: dict[str, tuple[str, Check]] = {
    "input": ("a signal's name", lambda value: isinstance(value, str) and bool(value)),
    "output": ("a signal's name", lambda value: isinstance(value, str) and bool(value)),
    "inject": ("volts or codes", ("volts", "codes").__contains__),
    "excitation": ("noise, sine or chirp", ("noise", "sine", "chirp").__contains__),
    "window": ("none or hann", ("none", "hann").__contains__),
    "band_hz": ("two rising frequencies below 1e6, [1, 200]", _is_band),
    "resolution_hz": ("a frequency of 0.001 Hz or more", _number(1e-3, 1e6)),
    "level": (
        "a number > 0, below 1e6",
        lambda value: is_number(value) and 0 < value < 1e6,
    ),
    "bias": ("a number between -1e6 and 1e6", _magnitude(-1, 1e6)),
    "averages": ("a whole number 4..4096", _whole(4, 4096)),
    "points": ("a whole number 2..1000", _whole(2, 1000)),
    "bits": ("a whole number 8..16", _whole(8, 16)),
    "scale": ("a number other than 0, below 1e12", _magnitude(0, 1e12)),
    "clamped": ("true or false", lambda value: isinstance(value, bool)),
    "free": ("true or false", lambda value: isinstance(value, bool)),
    "seed": ("a whole number 0..2^31 - 1", _whole(0, 2**31 - 1)),
    "set": ("a table of numbers or quantities", _is_table),
}


def check(given: SetupTable, where: str) -> Setup:
    """Returns a Setup from the keys of a measurement file, after a check of each key. Raises
    InputError."""

    def fail(key: str, text: str) -> NoReturn:
        raise InputError(f"{where}: {key}: {text}")

    toml.expect_keys(given, [f.name for f in fields(Setup)], fail)
    for key, value in given.items():
        text, accepts = KEYS.get(key, ("a text of one line", _is_line))
        if not accepts(value):
            fail(key, f"expected {text}, got {value!r}")
    setup = Setup(**given)
    codes = setup.inject == "codes"
    if not setup.output:
        fail("output", "expected the name of the measured signal; add the key")
    low, high = setup.band_hz
    setup = replace(
        setup,
        input=setup.input or ("dac_code" if codes else "drive.command"),
        level=setup.level or (20 if codes else 0.1),
        resolution_hz=setup.resolution_hz or low,
        band_hz=(float(low), float(high)),
    )
    if setup.window == "hann" and setup.excitation != "noise":
        fail(
            "window",
            f"expected no window with the excitation {setup.excitation}, because the measurement "
            "covers complete periods; remove this key",
        )
    if setup.free and setup.clamped:
        fail(
            "clamped",
            "expected either `clamped` or `free` contacts, got both; remove one of the two",
        )
    if codes:
        _check_codes(setup, fail)
    else:
        for key, signal in (("input", setup.input), ("output", setup.output)):
            if signal in CODES:
                fail(
                    key, f"expected a signal of the plant, got {signal}, which needs inject = codes"
                )
    return setup


def _check_codes(setup: Setup, fail: Callable[[str, str], NoReturn]) -> None:
    """Raises InputError for an amplitude or a bias in DAC codes that the firmware cannot output."""
    level, bias = setup.level, setup.bias
    if not (level <= 2048 and level == int(level)):
        fail("level", f"expected a whole number of DAC codes from 1 to 2048, got {level:g}")
    if not (-2048 <= bias <= 2047 and bias == int(bias)):
        fail("bias", f"expected a whole DAC code from -2048 to 2047, got {bias:g}")
    if level + abs(bias) > 2048:
        fail(
            "level",
            "expected a sum of level and bias of at most 2048 codes, the end of the range of the "
            f"DAC, got level {level:g} and bias {bias:g}",
        )
