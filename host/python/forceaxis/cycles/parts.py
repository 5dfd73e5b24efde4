"""Reads a parts file and draws random parts from it. The file describes several kinds of parts by
probability distributions of their parameters.

A part consists of the values of its parameters and the seed of its measurement noise. The values of
part number i of a group depend only on the seed, the name of the group and i. The part is therefore
the same for any number of drawn parts and for any order.
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from scipy import special

from forceaxis import _core, toml
from forceaxis._core import InputError
from forceaxis.experiments.expect import FormatKey, FormatTable
from forceaxis.experiments.inputs import Inputs, read_inputs
from forceaxis.experiments.points import SweepParameter, check_names, tidy, unit_of
from forceaxis.experiments.sweep_result import Row
from forceaxis.words import suggestion

# override that sets the seed of the measurement noise; each part has its own seed
NOISE_SEED = "experiment.seed"
NOISE_SEED_MOST = 2**31 - 1

UNIFORM = {"least", "most"}
NORMAL = {"mean", "deviation", "least", "most"}
SHAPES = "a value, { least, most } (uniform) or { mean, deviation, least, most } (normal)"
# A normal distribution must have at least this probability between its limits.
LEFT_LEAST = 1e-6

_SET = FormatKey(
    "set", "table", "none", "Distributions of parameters, by name: as [set] of the file."
)
FORMAT = (
    FormatTable(
        path="",
        header="",
        meaning="A file of parts: kinds of parts whose parameters have distributions.",
        keys=(
            FormatKey("title", "text", "name of the file", "Title of the file."),
            FormatKey("set", "table", "none", "Distributions of parameters of all kinds."),
            FormatKey("kind", "list of tables", "", "A kind of parts.", required=True),
        ),
    ),
    FormatTable(
        path="set",
        header="[set]",
        meaning="Distributions of parameters, by name: a parameter of the model (`k_bore`), or an "
        "object of the firmware (`firmware.force_gain`). A number or a quantity is a fixed value. "
        "An action at a time depends on the part where `[[at]]` of the experiment has the name of "
        "a parameter in place of a number.",
        keys=(
            FormatKey("least", "number or quantity", "", "Smallest value.", required=True),
            FormatKey("most", "number or quantity", "", "Largest value.", required=True),
            FormatKey(
                "mean",
                "number or quantity",
                "uniform from least to most",
                "Mean of a normal distribution, of which only values from least to most occur.",
            ),
            FormatKey(
                "deviation",
                "number or quantity",
                "uniform from least to most",
                "Standard deviation of the normal distribution, beside `mean`.",
            ),
        ),
    ),
    FormatTable(
        path="kind",
        header="[[kind]]",
        meaning="A kind of parts. The kinds of a file of good parts are mixed by their weights. Of "
        "bad parts each kind is simulated and counted by itself.",
        keys=(
            FormatKey("name", "identifier", "", "Name of the kind.", required=True),
            FormatKey("weight", "number", "1", "How often the kind occurs, relative to the others.",
                      range="> 0"),
            _SET,
        ),
    ),
)  # fmt: skip
FILE_KEYS, _, KIND_KEYS = ([key.key for key in table.keys] for table in FORMAT)


@dataclass(frozen=True)
class Distribution:
    """The probability distribution of one parameter, in the unit of the parameter. It is a fixed
    value (`least` equals `most`), a uniform distribution, or a normal distribution within
    limits."""

    least: float
    most: float
    mean: float = 0.0
    # standard deviation of a normal distribution; None for another distribution
    deviation: float | None = None

    def at(self, u: float) -> float:
        """Returns the value of the distribution that belongs to the probability `u` (quantile). It
        is rounded to 12 digits, so that its text is exact."""
        if self.deviation is None:
            return tidy(self.least + (self.most - self.least) * u)
        low, high = (
            special.ndtr((x - self.mean) / self.deviation) for x in (self.least, self.most)
        )
        value = self.mean + self.deviation * special.ndtri(low + (high - low) * u)
        return tidy(float(np.clip(value, self.least, self.most)))


@dataclass(frozen=True)
class Kind:
    """A kind of parts: all parts whose parameters have the same probability distributions."""

    name: str
    weight: float
    values: dict[str, Distribution]  # {name of the parameter: its distribution}


@dataclass(frozen=True)
class Parts:
    """The content of a parts file."""

    file: Path
    title: str
    kinds: list[Kind]
    # names of all parameters with a distribution, in the order of the parts file
    names: list[str] = field(default_factory=list)


def read_parts(file: Path, experiment: Path, overrides: Sequence[str] = ()) -> Parts:
    """Reads a parts file, and checks its parameters with the experiment to which they belong.
    Raises InputError with file, key and the expected value."""
    table = toml.read(file)

    def fail(key: str, message: str) -> NoReturn:
        raise InputError(f"{file}: {key}: {message}")

    toml.expect_keys(table, FILE_KEYS, fail)
    title = table.get("title", file.stem)
    if not isinstance(title, str):
        fail("title", "expected a text in quotes")
    if not isinstance(table.get("kind"), list) or not table["kind"]:
        fail("kind", "expected at least one [[kind]] of parts; add it")
    inputs = read_inputs(experiment, overrides)
    common = _values(table.get("set", {}), "set", inputs, fail)
    kinds: list[Kind] = []
    for i, given in enumerate(table["kind"]):
        kinds.append(_kind(given, f"kind[{i}]", inputs, common, fail))
        if kinds[-1].name in [kind.name for kind in kinds[:-1]]:
            fail(f"kind[{i}].name", f"expected a name that no other kind has, got {kinds[-1].name}")
    names = list(dict.fromkeys(name for kind in kinds for name in kind.values))
    try:
        check_names(experiment, inputs, overrides, [SweepParameter(n, 0.0, 0.0) for n in names])
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    return Parts(file, title, kinds, names)


Fail = Callable[[str, str], NoReturn]


def _kind(
    given: Any, where: str, inputs: Inputs, common: Mapping[str, Distribution], fail: Fail
) -> Kind:
    """Returns the kind of parts of one table [[kind]] in a parts file."""
    if not isinstance(given, dict):
        fail(where, "expected a table; write [[kind]]")
    toml.expect_keys(given, KIND_KEYS, lambda key, text: fail(f"{where}.{key}", text))
    name, weight = given.get("name"), given.get("weight", 1.0)
    if not isinstance(name, str) or not name.isidentifier():
        fail(f"{where}.name", "expected a name of letters, digits and _ in quotes; add it")
    if not _is_number(weight) or not 0 < weight < 1e9:
        fail(f"{where}.weight", f"expected a number above 0, got {weight!r}")
    own = _values(given.get("set", {}), f"{where}.set", inputs, fail)
    return Kind(name, float(weight), {**common, **own})


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _values(given: Any, where: str, inputs: Inputs, fail: Fail) -> dict[str, Distribution]:
    """Returns {parameter: distribution} for one table [set] of a parts file."""
    if not isinstance(given, dict):
        fail(where, f"expected a table of parameters, each {SHAPES}")
    flat: dict[str, Any] = {}
    for name, value in given.items():
        # In TOML, the line firmware.force_gain = 5 is a table `firmware` with the key `force_gain`.
        inner = name in ("firmware", "experiment", "verdict") and isinstance(value, dict)
        flat |= {f"{name}.{key}": v for key, v in value.items()} if inner else {name: value}
    return {name: _distribution(name, v, where, inputs, fail) for name, v in flat.items()}


def _distribution(name: str, given: Any, where: str, inputs: Inputs, fail: Fail) -> Distribution:
    """Returns the distribution of one parameter from the value that the parts file has for it."""
    key = f"{where}.{name}"
    if name == NOISE_SEED:
        fail(key, "expected no seed, because each part has its own; remove it and give `seed`")
    known = [*inputs.parameters]
    if "." not in name and name not in known:
        fail(key, f"expected a parameter of the model or firmware.OBJECT{suggestion(name, known)}")
    try:
        unit = unit_of(name, inputs)
    except StopIteration:
        fail(key, "expected an object of the firmware; `list_objects` lists them")

    def value(of: str, entry: Any) -> float:
        found = float(entry) if _is_number(entry) else None
        if isinstance(entry, str):
            found = _core.quantity_in(entry, unit)
        if found is None or not math.isfinite(found):
            fail(of, f"expected a number or a quantity in {unit or 'no unit'}, got {entry!r}")
        return found

    if not isinstance(given, dict):
        fixed = tidy(value(key, given))
        return Distribution(fixed, fixed)
    keys = set(given)
    if keys not in (UNIFORM, NORMAL):
        fail(key, f"expected {SHAPES}, got the keys {', '.join(given) or 'none'}")
    numbers = {of: value(f"{key}.{of}", entry) for of, entry in given.items()}
    drawn = Distribution(**numbers)
    if not drawn.least < drawn.most:
        fail(f"{key}.most", "expected more than least; exchange the two or give one value")
    if drawn.deviation is not None:
        _check_normal(drawn, key, fail)
    return drawn


def _check_normal(drawn: Distribution, key: str, fail: Fail) -> None:
    """Raises InputError for a standard deviation that is not above 0. Also raises it for limits
    between which the normal distribution has nearly no probability."""
    assert drawn.deviation is not None
    if drawn.deviation <= 0:
        fail(f"{key}.deviation", "expected more than 0; give one value for a fixed parameter")
    low, high = (
        special.ndtr((x - drawn.mean) / drawn.deviation) for x in (drawn.least, drawn.most)
    )
    if high - low < LEFT_LEAST:
        fail(f"{key}.mean", "expected limits that contain a millionth of the distribution or more")


@dataclass(frozen=True)
class Part:
    """A simulated part: its kind, and the overrides with which it is simulated."""

    kind: str
    values: Row


def stream(seed: int, group: str, number: int) -> np.random.Generator:
    """Returns the random number generator of one part. `number`: number of the part in its
    group."""
    digest = hashlib.sha256(group.encode()).digest()
    key = (int.from_bytes(digest[:4], "little"), number)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def draw(kinds: Sequence[Kind], group: str, seed: int, number: int) -> Part:
    """Draws one part at random. `number`: number of the part in its group. The probability of each
    kind of parts is proportional to its weight."""
    random = stream(seed, group, number)
    noise, choice = int(random.integers(NOISE_SEED_MOST)), random.random()
    weights = np.cumsum([kind.weight for kind in kinds])
    index = int(np.searchsorted(weights, choice * weights[-1], side="right"))
    kind = kinds[min(index, len(kinds) - 1)]
    values = {name: drawn.at(random.random()) for name, drawn in kind.values.items()}
    return Part(kind.name, {**values, NOISE_SEED: float(noise)})
