"""Experiments and their results for scripts and notebooks.

from forceaxis import Experiment

contact = Experiment.load("press/contact.toml")
result = contact.run(force_gain=7, force_setpoint="75 N")
print(result)                     # prints verdict, controlled force and settling time
result["force"], result.time_s    # NumPy arrays
result.plot("contact.png")
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn, TypeAlias

import numpy as np

from forceaxis import objects, paths, toml
from forceaxis._core import InputError
from forceaxis.experiments import run as runs
from forceaxis.experiments import summary as words
from forceaxis.experiments.inputs import numeric_keys, read_inputs
from forceaxis.experiments.run_result import Array, Converter, HeldForce
from forceaxis.linear.plant_facts import ParameterFacts
from forceaxis.results import JsonObject

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Event", "Experiment", "Result"]

# Tables of an experiment file as {key: value}.
TomlTables: TypeAlias = Mapping[str, "toml.Writable"]
# A value of a parameter or object: a number, a text with a unit, or a NumPy scalar.
Value: TypeAlias = float | str | np.generic | np.ndarray[tuple[int, ...], np.dtype[np.generic]]

IN_MEMORY = "(in memory)"
# {quantity of a Result: column of the trace with the codes of this quantity}
QUANTITIES = {"position": "encoder", "force": "adc0", "command": "dac"}


class Event(NamedTuple):
    """A change of state of one element of the model, such as first contact, contact loss or
    sliding. The simulator locates the time of the change between two ticks."""

    time_s: float  #: time since the start of the run in s
    element: str  #: name of the element in the model
    before: str  #: state of the element before the change
    after: str  #: state of the element after the change


class Experiment:
    """An experiment: a plant, values of firmware objects, events in time, and the conditions of a
    verdict.

    docs/guide/reference/experiment.md describes the file of an experiment. The method run()
    simulates the experiment.
    """

    def __init__(self, source: str | TomlTables, folder: str | Path = ".") -> None:
        """Creates an experiment from TOML text, or from a dict with the same tables.

        The path of the model in these tables is relative to `folder`. Values of the dict may be
        NumPy scalars and arrays. Raises InputError with the key and the expected value.
        """
        text = source if isinstance(source, str) else _toml_of(source)
        self._set(Path(folder) / IN_MEMORY, text)

    @classmethod
    def load(cls, path: str | Path) -> Experiment:
        """Reads an experiment from the path of a file, or by the name of an installed experiment,
        such as "contact".

        Raises InputError with the file, the key and the expected value.
        """
        file = Path(path)
        if isinstance(path, str) and not file.suffix and file.parent == Path():
            file = paths.EXPERIMENTS / f"{path}.toml"
        experiment = cls.__new__(cls)
        experiment._set(file, None)
        return experiment

    def _set(self, file: Path, text: str | None) -> None:
        self._file, self._text = file, text
        found = read_inputs(file, text=text)
        self.title: str = found.title
        self.model = found.model
        #: {parameter of the model: (value in SI units, name of this unit)}.
        #: The table [set] of an experiment takes precedence over the values of its model.
        self.parameters: dict[str, ParameterFacts] = found.parameters
        #: Values of the firmware objects that the experiment writes before the first tick.
        #: The value of a firmware object is in the unit of the object.
        self.firmware: dict[str, float] = found.firmware

    def run(self, overrides: Mapping[str, Value] | None = None, /, **values: Value) -> Result:
        """Simulates the experiment with changed values, and returns a Result.

        A keyword is the name of a firmware object, the name of a parameter of the model,
        `duration_s` (in s) or `seed`. The keys of `overrides` are full names: "m_r",
        "firmware.force_gain", "experiment.duration_s", "verdict.window_s". A value is a number in
        the unit of its parameter or object, a NumPy scalar, True or False, or a text with a unit
        such as "75 N". Raises InputError for an unknown name, and for a value outside of the range
        of its parameter or object. Raises SimulationError if the plant cannot be simulated.
        """
        given = {str(name): value for name, value in (overrides or {}).items()}
        for name, value in self._full_names(values).items():
            if name in given:
                raise InputError(
                    f"{name}: expected one value of this parameter, got one as a keyword and one "
                    "in the overrides; remove one of the two"
                )
            given[name] = value
        texts = [f"{name}={_text_of(name, value)}" for name, value in given.items()]
        return Result(runs.run(self._file, texts, text=self._text))

    def _full_names(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Returns {full name of a parameter or object: value}. If names are unknown, raises
        InputError with all of them."""
        keys = numeric_keys()["experiment"]
        known = (*objects.BY_NAME, *self.parameters, *keys)

        def fail(name: str, message: str) -> NoReturn:
            raise InputError(f"{self._name}: {name}: {message}")

        toml.expect_keys(values, known, fail, f"an object, a parameter, {' or '.join(keys)}")
        full = {}
        for name, value in values.items():
            if name in objects.BY_NAME and name in self.parameters:
                fail(
                    name,
                    "expected a name with one meaning, got the name of an object of the firmware "
                    f'and of a parameter; write run({{"firmware.{name}": ...}}) or '
                    f'run({{"{name}": ...}})',
                )
            prefix = "experiment." if name in keys else ""
            full[("firmware." if name in objects.BY_NAME else prefix) + name] = value
        return full

    @property
    def _name(self) -> str:
        return IN_MEMORY if self._text is not None else str(self._file)

    def __repr__(self) -> str:
        """Returns the title and the source of the experiment."""
        return f"<Experiment {self.title!r}, {self._name}>"


class Result:
    """A finished run: verdict, results, and the trace. The trace consists of arrays (n,) with one
    value for each of the n ticks.

    result["force"] (N), result["position"] (m) and result["command"] (V) are the measured force,
    the measured position and the output voltage. Other names are those of the columns of the trace,
    such as "sensor.force" (N) or "adc0" (ADC code). `units` contains the unit of each name.
    """

    def __init__(self, run: runs.Run) -> None:
        """Stores the results of a finished run."""
        self._run = run
        #: Result in the form that the command `forceaxis run` prints in JSON.
        self.summary: JsonObject = run.summary
        #: Time of each tick since the start of the run in s, as an array (n,).
        self.time_s: Array = run.time_s
        #: {name: unit} of everything that result[name] accepts.
        self.units: dict[str, str] = self._units()

    def _units(self) -> dict[str, str]:
        units = {"time_s": "s"}
        for name in self._run.columns:
            units.setdefault(name, self._run.signal_units.get(name, ""))
        for name in self._run.units:
            units[name] = objects.unit_in_words(objects.BY_NAME[name])
        for name, column in QUANTITIES.items():
            converter = self._converter(column)
            # The ADC may measure a quantity that is not a force.
            if converter and (name != "force" or converter.unit == "N"):
                units[name] = converter.unit
        return units

    def _converter(self, column: str) -> Converter | None:
        return self._run.result.converters.get(column)

    @property
    def title(self) -> str:
        """Title of the experiment, with the figure number in the thesis."""
        return self._run.title

    @property
    def verdict(self) -> str | None:
        """Verdict of the run: "stable", "unstable", "not_met" (a limit of [verdict] is exceeded) or
        "never_in_contact". None means that the experiment has no [verdict]."""
        return self._run.result.verdict

    @property
    def stable(self) -> bool:
        """True if the verdict is "stable"."""
        return self.verdict == "stable"

    @property
    def because(self) -> list[str]:
        """Reasons for a verdict other than "stable", as texts. Empty for a stable run."""
        return list(self._run.result.because)

    @property
    def missed(self) -> list[dict[str, str | float | None]]:
        """The exceeded limits of [verdict]. Each limit is a dict with the keys limit, verdict,
        value, bound and unit."""
        return [asdict(limit) for limit in self._run.result.missed]

    @property
    def fault(self) -> str:
        """The first fault that the firmware latched, or "none"."""
        return self._run.result.fault

    @property
    def _held(self) -> HeldForce | None:
        return self._run.result.metrics.held_force

    @property
    def setpoint_N(self) -> float | None:
        """Force set-point at the end of the run in N. None means that the experiment controls no
        force."""
        return self._held.setpoint_N if self._held else None

    @property
    def held_force_N(self) -> float | None:
        """Mean of the measured force in the window of the verdict in N. None means that the
        experiment controls no force."""
        return self._held.held_N if self._held else None

    @property
    def overshoot_percent(self) -> float | None:
        """Largest excess of the measured force over the set-point, in per cent of the set-point, at
        least 0. None means that the experiment controls no force."""
        return self._held.overshoot_percent if self._held else None

    @property
    def settling_s(self) -> float | None:
        """Settling time in s. It starts at the last change of the set-point, or at a later first
        contact. It ends when the force stays within 5 % of held_force_N.

        None means that the force does not settle, or that the experiment controls no force.
        """
        return self._held.settle_s if self._held else None

    @property
    def events(self) -> list[Event]:
        """All changes of state of elements, such as contacts and contact losses, in order of
        time."""
        return [Event(*event) for event in self._run.events]

    @property
    def trace_hash(self) -> str:
        """SHA-256 of all codes in all ticks, as 64 hexadecimal digits. Runs with equal codes have
        equal hashes."""
        return self._run.result.trace_hash

    def __getitem__(self, name: str) -> Array:
        """Returns the values of a column of the trace, or of "force" (N), "position" (m) or
        "command" (V), as an array (n,). Raises KeyError for an unknown name."""
        columns = self._run.columns
        if name in columns:
            return columns[name]
        if name not in self.units:
            raise KeyError(f"{name}: expected one of {', '.join(self)}")
        column = QUANTITIES[name]
        converter = self._converter(column)
        assert converter is not None  # A quantity that no converter measures has no unit.
        codes = columns[column].astype(float)
        return np.asarray((codes - converter.zero) * converter.per_code)

    def __iter__(self) -> Iterator[str]:
        """Iterates over the names that result[name] accepts."""
        return iter(self.units)

    def __contains__(self, name: str) -> bool:
        """Returns True if result[name] accepts this name."""
        return name in self.units

    def plot(self, path: str | Path | None = None, *, codes: bool = False) -> Figure:
        """Draws the run as a Matplotlib figure. If a path is given, also writes the figure to this
        path (.png, .svg, .pdf).

        codes: True to show the codes of the converters instead of N, mm and V. Raises OSError if
        the file cannot be written.
        """
        from forceaxis import drawing
        from forceaxis.experiments import trace

        drawn = trace.figure(self._run, codes)
        if path is not None:
            drawing.save(drawn, Path(path), Path(path).suffix.lstrip(".") or "png")
        return drawn

    def __str__(self) -> str:
        """The summary of the run in words."""
        return words.describe(self._run.result, self._run.overrides)

    def __repr__(self) -> str:
        """Returns verdict, controlled force and settling time."""
        parts = [", ".join([self.verdict or "no verdict", *self.because])]
        if self.fault != "none" and not self.because:
            parts.append(f"fault {self.fault}")
        if self._held:
            settling = self.settling_s
            parts.append(f"held {self._held.held_N:.4g} N of {self._held.setpoint_N:.4g} N")
            parts.append("not settled" if settling is None else f"settled in {settling:.3g} s")
        return f"<Result of {self.title!r}: {'; '.join(parts)}>"


def _toml_of(tables: TomlTables) -> str:
    try:
        return str(toml.write_text(tables))
    except (AttributeError, TypeError) as error:
        raise InputError(
            f"{IN_MEMORY}: expected only tables, texts and numbers in the experiment, {error}"
        ) from None


def _text_of(name: str, value: Value) -> str:
    """Returns the value of an override as text. Raises InputError."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return value
    raise InputError(f"{name}: expected a number or a text with a unit, got {value!r}")
