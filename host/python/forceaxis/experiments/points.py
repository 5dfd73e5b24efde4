"""Points of a sweep: the points of a grid, random points, or the range in which a stability
boundary is searched."""

import hashlib
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn, TypeAlias

from forceaxis import objects
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.experiments.inputs import Inputs, numeric_keys, read_inputs
from forceaxis.linear import posterior
from forceaxis.words import suggestion

MOST_POINTS = 1_000_000
Point: TypeAlias = tuple[float, ...]  # a point of a sweep: one value for each swept parameter
# Values of a grid parameter: "FROM:TO:COUNT[:log]", "VALUE,VALUE,...", or a list of values.
GridValues: TypeAlias = str | Iterable[float]


def meant(name: str, parameters: Iterable[str] = ()) -> str:
    """Returns the end of a message about an unknown name of an override: "; did you mean NAME?", or
    an empty text. `parameters`: names of the model's parameters."""
    full = {key: f"{room}.{key}" for room, keys in numeric_keys().items() for key in keys}
    full |= {o.name: f"firmware.{o.name}" for o in objects.OBJECTS if "w" in o.access}
    if name in full:
        return f"; did you mean {full[name]}?"
    room = name.partition(".")[0] + "."
    near = [text for text in full.values() if text.startswith(room)] if "." in name else []
    return suggestion(name, near or [*parameters, *full.values()])


@dataclass(frozen=True)
class SweepParameter:
    """A parameter that a sweep changes, and its range of values in the unit of the parameter."""

    name: str
    low: float
    high: float
    log: bool = False  # True if the range is divided on a logarithmic scale
    values: Point = ()  # values of a parameter of a grid
    # largest distance between the last stable and the first unstable value of a bisection
    tolerance: float = 0.0

    def at(self, u: float) -> float:
        """Returns the value at the fraction u, from 0 to 1, of the range. The value is rounded to
        12 digits, so that its text is exact."""
        if self.log:
            return tidy(self.low * (self.high / self.low) ** u)
        return tidy(self.low + (self.high - self.low) * u)


def tidy(value: float) -> float:
    """Returns the value rounded to 12 significant digits."""
    return float(f"{value:.12g}")


def parse(
    parameter: str, name: str, text: str, more: Sequence[str], may_log: bool
) -> SweepParameter:
    """Returns the swept parameter `name` from a text FROM:TO.

    `more`: names of further numbers in the text, after FROM:TO. `may_log`: True if ":log" may
    follow them. `parameter`: field of the SweepRequest with the text, for error messages. Raises
    ParameterError.
    """
    shape = ":".join(("FROM", "TO", *more))
    parts = str(text).split(":")
    log = may_log and parts[-1] == "log"
    numbers = parts[:-1] if log else parts

    def fail(message: str) -> NoReturn:
        raise ParameterError(parameter, f"{name}={text}: expected {message}")

    try:
        values = [float(part) for part in numbers]
    except ValueError:
        values = []
    if len(values) != 2 + len(more) or not all(map(math.isfinite, values)):
        fail(f"NAME={shape}" + ("[:log]" if may_log else "") + ", with finite numbers")
    low, high = values[:2]
    if not low < high:
        fail("FROM below TO")
    if log and low <= 0:
        fail("FROM above 0, because :log spaces the values logarithmically")
    swept = SweepParameter(name, low, high, log)
    if "TOLERANCE" in more:
        if not 0 < values[2] < high - low:
            fail("TOLERANCE above 0 and below TO - FROM")
        return replace(swept, tolerance=values[2])
    if "COUNT" in more:
        count = int(values[2])
        if values[2] != count or not 2 <= count <= MOST_POINTS:
            fail(f"COUNT to be a whole number from 2 to {MOST_POINTS}; `overrides` sets one value")
        return replace(swept, values=tuple(swept.at(i / (count - 1)) for i in range(count)))
    return swept


def grid_axes(grid: Mapping[str, GridValues]) -> list[SweepParameter]:
    """Returns the swept parameters of a grid. Raises ParameterError."""
    axes = []
    for name, given in grid.items():
        if isinstance(given, str) and ":" in given:
            axes.append(parse("grid", name, given, ("COUNT",), True))
            continue
        try:
            values = tuple(
                float(v) for v in (given.split(",") if isinstance(given, str) else given)
            )
        except ValueError:
            values = ()
        if not values or not all(map(math.isfinite, values)):
            raise ParameterError(
                "grid",
                f"{name}={given}: expected NAME=FROM:TO:COUNT[:log] or NAME=VALUE,VALUE,..., with "
                "finite numbers",
            )
        axes.append(SweepParameter(name, min(values), max(values), values=values))
    points = math.prod(len(a.values) for a in axes)
    if points > MOST_POINTS:
        raise ParameterError("grid", f"expected at most {MOST_POINTS} points, got {points}")
    return axes


def grid_points(axes: Sequence[SweepParameter]) -> list[Point]:
    """Returns all combinations of the values. The value of the last parameter changes fastest."""
    return list(itertools.product(*(a.values for a in axes)))


def random_axes(random: Mapping[str, str]) -> list[SweepParameter]:
    """Returns the swept parameters from {name: "FROM:TO[:log]"}. Raises ParameterError."""
    return [parse("random", name, text, (), True) for name, text in random.items()]


def random_points(axes: Sequence[SweepParameter], count: int | None, seed: int) -> list[Point]:
    """Returns random points. The value of a parameter at point i depends only on the seed, its name
    and i. The fraction of the range is the first 53 bits of SHA-256("SEED:NAME:INDEX") / 2^53.
    Raises ParameterError.
    """
    if not count or not 1 <= count <= MOST_POINTS:
        raise ParameterError("count", f"expected a number of random points, 1 to {MOST_POINTS}")

    def draw(axis: SweepParameter, i: int) -> float:
        digest = hashlib.sha256(f"{seed}:{axis.name}:{i}".encode()).digest()
        return axis.at((int.from_bytes(digest[:8], "big") >> 11) / 2**53)

    return [tuple(draw(a, i) for a in axes) for i in range(count)]


def posterior_points(
    file: str, count: int | None, seed: int
) -> tuple[list[SweepParameter], list[Point]]:
    """Returns (swept parameters, points) from the file of a posterior. The range of a parameter is
    its 95 % interval. The points are drawn from the posterior. Raises ParameterError or
    InputError."""
    if not count or not 1 <= count <= MOST_POINTS:
        raise ParameterError("count", f"expected a number of points of `over`, 1 to {MOST_POINTS}")
    found = posterior.read(file)
    axes = [SweepParameter(name, *found.interval(name)) for name in found.names]
    drawn = found.draws(count, seed)
    return axes, [tuple(tidy(values[axis.name]) for axis in axes) for values in drawn]


def check_names(
    experiment: Path,
    inputs: Inputs,
    overrides: Sequence[str],
    axes: Sequence[SweepParameter],
) -> None:
    """Raises InputError for a name that is given twice or is unknown, and for a parameter that has
    no effect on the model."""
    taken = {text.partition("=")[0] for text in overrides}
    for axis in axes:
        if axis.name in taken:
            permitted = "each name once among the swept parameters and the overrides"
        else:
            permitted = _problem_of(axis.name, experiment, inputs, overrides)
        if permitted:
            raise InputError(f"{experiment}: {axis.name}: expected {permitted}")
        taken.add(axis.name)


def _problem_of(name: str, experiment: Path, inputs: Inputs, overrides: Sequence[str]) -> str:
    """Returns a text that states which names are expected instead of `name`. The text is empty if a
    sweep can change `name`."""
    room, dot, key = name.partition(".")
    if not dot:
        if name not in inputs.parameters:
            return (
                "a parameter of the model, firmware.OBJECT, experiment.KEY or verdict.KEY"
                f"{meant(name, inputs.parameters)}"
            )
        value = inputs.parameters[name].value
        if name in read_inputs(experiment, [*overrides, f"{name}={value!r}"]).unused:
            return "a parameter that changes the model"
    elif room == "firmware":
        if not any(o.name == key and "w" in o.access for o in objects.OBJECTS):
            return f"a firmware object that can be written{meant(name)}; `list_objects` lists them"
    elif key not in numeric_keys().get(room, ()):
        known = [f"{r}.{k}" for r, keys in numeric_keys().items() for k in keys]
        return f"a model parameter, firmware.OBJECT or one of {', '.join(known)}{meant(name)}"
    return ""


def unit_of(name: str, inputs: Inputs) -> str:
    """Returns the unit of a swept parameter, or an empty text if the parameter has no unit."""
    room, _, key = name.partition(".")
    if room == "firmware":
        unit = next(o.unit for o in objects.OBJECTS if o.name == key)
    elif key:
        unit = numeric_keys()[room][key]
    else:
        unit = inputs.parameters[name].unit
    return "" if unit == "1" else unit
