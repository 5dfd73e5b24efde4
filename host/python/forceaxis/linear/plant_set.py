"""A set of plants. Ranges of the parameters of a model and states of its elements define the set.
Texts such as k_w=30% or m_w=200..500 define the ranges. One plant of the set (class Member) has one
value of each parameter and one state of each element. Margins are computed for the force loops
around all plants, with one or several delays of the loop."""

import itertools
import math
import random
from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from forceaxis.errors import ParameterError
from forceaxis.linear import posterior
from forceaxis.linear import system as linear
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.stability import Loop
from forceaxis.words import plain, suggestion

# largest number of parameters with a range; a set with 8 ranges has 256 corner plants
RANGES_MAX = 8
Range = tuple[float, float, float]  # nominal, low and high value of a parameter in SI units


@dataclass(frozen=True)
class Member:
    """One plant of a set of plants. `values`: {parameter: SI value} of the parameters with a range.
    `modes`: {element: state}."""

    values: dict[str, float] = field(default_factory=dict)
    modes: dict[str, str] = field(default_factory=dict)

    @cached_property
    def key(self) -> Hashable:
        """Key of the plant for a dict. Equal plants have equal keys."""
        return tuple(sorted(self.values.items())), tuple(sorted(self.modes.items()))

    def label(self) -> str:
        """Name of the plant for a user: "nominal", or a text such as "k_w = 288,900,
        drive.amplifier = high outer"."""
        parts = [f"{n} = {plain(v, 4)}" for n, v in self.values.items()]
        parts += [f"{n} = {state}" for n, state in self.modes.items()]
        return ", ".join(parts) or "nominal"


@dataclass(frozen=True)
class PlantSet:
    """A set of plants: one model with parameters in ranges, and several combinations of element
    states. `model`: a path, or the file name without suffix. `overrides`: {parameter: value} of all
    plants. `ranges`: {parameter: (nominal, low, high)} in SI units. `modes`: combinations {element:
    state}. `together`: choices {parameter: SI value} of parameters that change together. All
    combinations occur."""

    model: str
    overrides: Overrides = field(default_factory=dict)
    ranges: dict[str, Range] = field(default_factory=dict)
    modes: tuple[dict[str, str], ...] = ({},)
    together: tuple[dict[str, float], ...] = ({},)

    def nominal(self) -> list[Member]:
        """Returns the plants with nominal parameter values, one plant for each combination of
        element states."""
        return self._in_modes({name: r[0] for name, r in self.ranges.items()})

    def corners(self) -> list[Member]:
        """Returns the corner plants: all combinations of the ends of the parameter ranges, for each
        combination of element states. The list is empty without ranges."""
        ends = [[(name, end) for end in r[1:]] for name, r in self.ranges.items()]
        if not ends:
            return []
        return [m for c in itertools.product(*ends) for m in self._in_modes(dict(c))]

    def random(self, count: int, seed: int = 1988) -> list[Member]:
        """Returns random plants: `count` choices of parameter values, each in every combination of
        element states. The values are uniformly distributed within the ranges."""
        rng = random.Random(seed)
        chosen = [
            {name: rng.uniform(r[1], r[2]) for name, r in self.ranges.items()} for _ in range(count)
        ]
        return [member for values in chosen for member in self._in_modes(values)]

    def _in_modes(self, values: dict[str, float]) -> list[Member]:
        return [
            Member(values | other, dict(modes)) for other in self.together for modes in self.modes
        ]

    def loop(self, member: Member, timing: str = "zoh", spec: LoopSpec | None = None) -> Loop:
        """Returns the force loop around a plant of the set, with the delay `timing`. `spec`: the
        force loop, or None for law p."""
        overrides = {**self.overrides, **member.values}
        own = replace(spec or LoopSpec(), timing=timing)
        return own.around(self.model, overrides, member.modes or None)


def ranges_of(
    model: str | Path, over: Iterable[str], overrides: Overrides | None = None
) -> dict[str, Range]:
    """Returns {parameter: (nominal, low, high)} in SI units from texts NAME=PERCENT% or
    NAME=LOW..HIGH. A text may contain several ranges, separated by commas. Instead, a text may name
    the file of a posterior, whose most likely values and 95 % intervals are then used. Raises
    ParameterError for an unknown parameter or a wrong range, and InputError for a wrong file."""
    known = linear.facts(model, overrides).parameters
    ranges: dict[str, Range] = {}
    for name, span in _spans(over, known):
        if name not in known:
            raise ParameterError(
                "over",
                f"{span if isinstance(span, str) else name}: expected a parameter of the model, "
                f"one of {', '.join(sorted(known))}{suggestion(name, known)}",
            )
        if name in ranges:
            raise ParameterError(
                "over",
                f"{name}: expected each parameter once, got this parameter twice; remove one",
            )
        nominal = known[name].value
        if isinstance(span, str):
            span = (nominal, *_span(span, span.partition("=")[2], nominal))
        ranges[name] = span
    if len(ranges) > RANGES_MAX:
        raise ParameterError("over", f"expected at most {RANGES_MAX} parameters, got {len(ranges)}")
    return ranges


def _spans(over: Iterable[str], known: Iterable[str]) -> Iterator[tuple[str, str | Range]]:
    """Yields pairs (parameter, range). A range is a text, or the three values (most likely, low,
    high) from a posterior."""
    for text in (part for given in over for part in given.split(",")):
        if not posterior.is_posterior(text):
            yield text.partition("=")[0], text
            continue
        found = posterior.read(text)
        for name, best in zip(found.names, found.best, strict=True):
            yield name, (best, *found.interval(name))


def ranges_beside(
    model: str | Path, over: Iterable[str], overrides: Overrides | None = None
) -> tuple[dict[str, Range], posterior.Posterior | None]:
    """Returns (ranges, posterior). The ranges come from ranges_of(), except the ranges that the
    posterior gives. Raises ParameterError or InputError."""
    texts = [part for given in over for part in given.split(",")]
    files = [text for text in texts if posterior.is_posterior(text)]
    ranges = ranges_of(model, texts, overrides)
    if len(files) > 1:
        raise ParameterError("over", f"expected at most one posterior, got {len(files)}")
    if not files:
        return ranges, None
    found = posterior.read(files[0])
    return {n: r for n, r in ranges.items() if n not in found.names}, found


def set_of(
    model: str | Path, over: Iterable[str], overrides: Overrides | None = None
) -> tuple[dict[str, Range], tuple[dict[str, float], ...]]:
    """Returns (ranges, plants). The ranges come from ranges_beside(). Each plant is {parameter: SI
    value}, and together the plants stand for 95 % of the posterior. Without a posterior, they are
    ({},). Raises ParameterError or InputError."""
    ranges, found = ranges_beside(model, over, overrides)
    return ranges, found.plants() if found else ({},)


def _span(text: str, span: str, nominal: float) -> tuple[float, float]:
    low, dots, high = span.partition("..")
    try:
        if span.endswith("%"):
            share = float(span[:-1]) / 100
            ends = sorted((nominal * (1 - share), nominal * (1 + share)))
            fits = 0 < share < 1 and nominal != 0
        else:
            ends = [float(low), float(high)]
            fits = bool(dots) and ends[0] < ends[1]
    except ValueError:
        fits = False
    if not (fits and all(map(math.isfinite, ends))):
        raise ParameterError(
            "over",
            f"{text}: expected NAME=LOW..HIGH, or NAME=PERCENT% with PERCENT above 0 and below 100",
        )
    return ends[0], ends[1]
