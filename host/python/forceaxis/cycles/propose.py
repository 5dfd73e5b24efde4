"""Proposes bounds for the evaluation elements of a cycle program from the values of good parts.
With these bounds, the program refuses a given fraction of later good parts.

The bounds are computed by statistically equivalent blocks (Tukey 1947). The parts are removed one
by one. The bounds take turns: each removes the part that is then the most extreme on its side,
until k of the n parts are removed. Each bound is the value of the last part that it has removed.
The fraction of later parts beyond any of the bounds then has the distribution Beta(k, n + 1 - k)
with the mean k / (n + 1). This holds for any distribution and any dependence of the values, as long
as no two values are equal. The given fraction therefore applies to the whole program, not to one
evaluation element. If values are equal, the bounds refuse fewer parts.

Some good parts are refused for any bounds, because of a limit of a phase, a window, an envelope,
or a missing value. These parts are the first of the k removed parts.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cycles.outcome import GOOD, MEASURED, PartOutcome
from forceaxis.cycles.program import KEY, Element, Program, number, unit_of_text, with_program
from forceaxis.cycles.rates import Group, Rates, weighted
from forceaxis.cycles.statistics import Share, parts_needed, refused_range, share
from forceaxis.errors import ParameterError
from forceaxis.experiments.inputs import read_inputs
from forceaxis.experiments.points import tidy

RATE_LEAST, RATE_MOST = 1e-5, 0.5
# Reasons why a proposal does not change the bounds of an evaluation element.
LEFT_SHAPE = "its bounds are a shape and no number"
LEFT_OPEN = "the program gives it no bound"


@dataclass(frozen=True)
class Side:
    """One bound that a proposal changes. `key`: "least" or "most", the lower or the upper bound of
    the evaluation element."""

    element: int  # index of the evaluation element in the cycle program
    key: str


@dataclass(frozen=True)
class MovedBounds:
    """The bounds of one evaluation element before and after they were changed by a proposal, in
    `unit`."""

    name: str
    unit: str
    least_before: float | None
    most_before: float | None
    least: float | None
    most: float | None


@dataclass(frozen=True)
class LeftElement:
    """An evaluation element whose bounds the proposal does not change, with the reason."""

    name: str
    kind: str
    why: str


@dataclass(frozen=True)
class ProposedPasses:
    """The fraction of bad parts of one kind that the proposed bounds accept."""

    name: str
    passed: Share


@dataclass(frozen=True)
class Proposal:
    """Proposed bounds for the evaluation elements of a cycle program, and the expected fraction of
    refused good parts."""

    program: str  # path of the file to which the changed cycle program was written
    rate: float  # requested fraction of good parts that the changed program refuses
    parts: int  # number of good parts from which the bounds were computed
    # number of good parts that are refused for any bounds, because of other elements or limits
    refused_anyway: int
    expected: float  # expected fraction of later good parts that the changed program refuses
    # lower end of the 95 % range of the fraction of refused later good parts
    low: float
    high: float  # upper end of the 95 % range of the fraction of refused later good parts
    bounds: list[MovedBounds]
    left: list[LeftElement]
    bad: list[ProposedPasses]
    # fraction of all bad parts that the changed program accepts; each kind weighted by frequency
    bad_passed: float | None


@dataclass(frozen=True)
class Target:
    """The file to which a changed cycle program is written, and the function that reads a changed
    file as a check. This function raises InputError."""

    file: Path
    check: Callable[[Path], object]


def checked_by(experiment: Path, overrides: Sequence[str]) -> Callable[[Path], object]:
    """Returns a function that checks the file of a cycle program with the axis of an
    experiment."""
    kept = [text for text in overrides if not text.startswith(f"{KEY}=")]
    return lambda file: read_inputs(experiment, with_program(kept, file))


def sides_of(program: Program) -> list[Side]:
    """Returns the bounds that a proposal changes, in the order of the file of the cycle program."""
    return [
        Side(i, key)
        for i, element in enumerate(program.elements)
        if not element.is_shape
        for key in ("least", "most")
        if getattr(element, key) is not None
    ]


def left_of(program: Program) -> list[LeftElement]:
    """Returns the evaluation elements whose bounds a proposal does not change."""
    moved = {side.element for side in sides_of(program)}
    return [
        LeftElement(e.name, e.kind, LEFT_SHAPE if e.is_shape else LEFT_OPEN)
        for i, e in enumerate(program.elements)
        if i not in moved
    ]


def refused_anyway(outcome: PartOutcome, moved: Sequence[int]) -> bool:
    """Returns True if a part is refused for any bounds of the evaluation elements with the indices
    `moved`."""
    return not outcome.is_within_limits or any(
        verdict not in MEASURED if i in moved else verdict != GOOD
        for i, verdict in enumerate(outcome.verdicts)
    )


def bounds_by_blocks(
    values: NDArray[np.float64], sides: Sequence[tuple[int, int]], take: int
) -> list[float]:
    """Returns the bound for each side of the evaluation elements: the value of the last part that
    was removed on this side.

    values: values of the parts, with one row for each part and one column for each evaluation
    element. sides: pairs of the column and 1 for a lower bound or -1 for an upper bound. take:
    number of parts to remove, at least one for each side. The sides take turns. A part whose value
    equals a bound is good. Therefore only the parts beyond a bound, and one part for each bound,
    are counted as removed.
    """
    parts = len(values)
    keyed = [sign * values[:, column] for column, sign in sides]
    orders = [np.argsort(key, kind="stable") for key in keyed]
    # for each side: position of the next part in the list of parts that is sorted by their values
    places = [0] * len(sides)
    last = [-1] * len(sides)  # for each side: index of the part whose value is the bound
    taken = np.zeros(parts, dtype=bool)
    beyond = np.zeros(parts, dtype=bool)

    def advance(side: int) -> None:
        order, key = orders[side], keyed[side]
        while taken[order[places[side]]]:
            places[side] += 1
        part = int(order[places[side]])
        before, last[side] = last[side], part
        taken[part] = True
        if before < 0 or key[part] > key[before]:
            # On each side, all parts whose values are more extreme than the bound are refused.
            begin = 0 if before < 0 else int(np.searchsorted(key[order], key[before]))
            end = int(np.searchsorted(key[order], key[part]))
            beyond[order[begin:end]] = True

    def count() -> int:
        at_bounds = {part for part in last if part >= 0 and not beyond[part]}
        return int(beyond.sum()) + len(at_bounds)

    turn = 0
    while turn < parts and (turn < len(sides) or count() < take):
        advance(turn % len(sides))
        turn += 1
    return [float(values[part, column]) for part, (column, _) in zip(last, sides, strict=True)]


def check(program: Program, parts: int, rate: float) -> None:
    """Raises ParameterError or InputError if no bounds can be proposed, because there are too few
    good parts."""
    if not RATE_LEAST <= rate <= RATE_MOST:
        raise ParameterError(
            "propose", f"expected a share from {RATE_LEAST:g} to {RATE_MOST:g}, got {rate:g}"
        )
    sides = sides_of(program)
    if not sides:
        raise InputError(
            f"{program.file}: element: expected at least one evaluation element that is not a "
            "`window` and has a bound `least` or `most`, got none; add such a bound with any value"
        )
    needed = parts_needed(rate, len(sides))
    if parts < needed:
        raise ParameterError(
            "parts",
            f"expected at least {needed} good parts for {len(sides)} bounds and a share of "
            f"{rate:g}, got {parts}; take more parts",
        )


def proposed(program: Program, outcomes: Sequence[PartOutcome], rate: float) -> tuple[Program, int]:
    """Returns the cycle program with proposed bounds, which refuse the fraction `rate` of good
    parts. Also returns the number of parts that are refused whatever these bounds are. Raises
    ParameterError or InputError."""
    judged = [outcome for outcome in outcomes if outcome.is_judged]
    check(program, len(judged), rate)
    sides = sides_of(program)
    moved = sorted({side.element for side in sides})
    rest = [outcome for outcome in judged if not refused_anyway(outcome, moved)]
    anyway = len(judged) - len(rest)
    take = math.floor(rate * (len(judged) + 1) + 1e-9) - anyway
    if take < len(sides):
        left = rate - anyway / len(judged)
        more = f" or take some {math.ceil((len(sides) - rate) / left)} parts" if left > 0 else ""
        raise ParameterError(
            "propose",
            f"expected windows, envelopes and limits that leave room for a share of {rate:g}, but "
            f"they refuse {anyway} of {len(judged)} good parts whatever the bounds; widen them, "
            f"give a larger share{more}",
        )
    # A measured value is a number of counts times a factor.
    # Values of equal counts are equal after they have been rounded to 12 digits.
    values = np.array([[tidy(outcome.values[i]) for i in moved] for outcome in rest])
    columns = [(moved.index(side.element), 1 if side.key == "least" else -1) for side in sides]
    found = bounds_by_blocks(values, columns, take)
    elements = list(program.elements)
    for side, bound in zip(sides, found, strict=True):
        element = elements[side.element]
        is_least = side.key == "least"
        elements[side.element] = (
            replace(element, least=bound) if is_least else replace(element, most=bound)
        )
    for element in elements:
        if element.least is not None and element.most is not None and element.least > element.most:
            raise ParameterError(
                "propose",
                f"expected a share that leaves good parts, got {rate:g}, with which {element.name} "
                "would refuse all; give a smaller share",
            )
    return replace(program, elements=elements), anyway


def propose(
    done: Rates, rate: float, file: Path, experiment: Path, overrides: Sequence[str]
) -> Proposal:
    """Writes the cycle program of `done` with proposed bounds to `file`. The bounds refuse the
    fraction `rate` of good parts. The file is written completely or not at all. Raises
    ParameterError or InputError."""
    target = Target(file, checked_by(experiment, overrides))
    return propose_from(done.program, done.good.outcomes, rate, target, done.bad)


def propose_from(
    old: Program,
    outcomes: Sequence[PartOutcome],
    rate: float,
    target: Target,
    bad_groups: Sequence[Group] = (),
) -> Proposal:
    """Writes the cycle program `old` with proposed bounds to the file of `target`. The bounds
    refuse the fraction `rate` of good parts. `outcomes`: outcomes of good parts. The file is
    written completely or not at all. Raises ParameterError or InputError."""
    program, anyway = proposed(old, outcomes, rate)
    moved = sorted({side.element for side in sides_of(program)})
    parts = sum(outcome.is_judged for outcome in outcomes)
    blocks = math.floor(rate * (parts + 1) + 1e-9)
    low, high = refused_range(blocks, parts)
    _write(old, program, target)
    before, new = old.elements, program.elements
    bad = [
        ProposedPasses(
            g.name, share(sum(o.is_good_by(new, moved) for o in g.judged), len(g.judged))
        )
        for g in bad_groups
    ]
    return Proposal(
        program=paths.display(target.file),
        rate=rate,
        parts=parts,
        refused_anyway=anyway,
        expected=blocks / (parts + 1),
        low=low,
        high=high,
        bounds=[
            MovedBounds(
                new[i].name, new[i].unit, before[i].least, before[i].most, new[i].least, new[i].most
            )
            for i in moved
        ],
        left=left_of(program),
        bad=bad,
        bad_passed=weighted([(g.weight, b.passed) for g, b in zip(bad_groups, bad, strict=True)]),
    )


def edited(text: str, program: Program) -> str:
    """Returns the text of a file with a cycle program, in which the bounds of `program` replace the
    original bounds. Comments and all other keys do not change. Each bound keeps its unit. Raises
    InputError."""
    import tomlkit

    crlf = text.count("\r\n") == text.count("\n") > 0
    try:
        document: Any = tomlkit.parse(text.replace("\r\n", "\n") if crlf else text)
    # tomlkit may refuse a text that the usual TOML reader of cycle programs accepts.
    except tomlkit.exceptions.ParseError as error:
        raise InputError(
            f"{program.file}: file: expected TOML that can be edited, got: {error}"
        ) from None
    for side in sides_of(program):
        element = program.elements[side.element]
        table = document["element"][side.element]
        table[side.key] = _written(getattr(element, side.key), element, table[side.key])
    dumped = str(tomlkit.dumps(document))
    return dumped.replace("\n", "\r\n") if crlf else dumped


def _written(bound: float, element: Element, before: Any) -> float | str:
    """Returns a new bound in the form of the old one: a number, or a quantity in the same unit. It
    has as many digits as the value needs."""
    unit = unit_of_text(before) if isinstance(before, str) else ""
    if not unit:
        return tidy(bound)
    size = number(f"1 {unit}", element.unit) or 1.0
    for digits in range(3, 18):
        text = f"{bound / size:.{digits}g} {unit}"
        found = number(text, element.unit)
        if found is not None and abs(found - bound) <= 1e-12 * abs(bound):
            return text
    return f"{bound / size!r} {unit}"


def _write(old: Program, new: Program, target: Target) -> None:
    """Writes a file with a cycle program whose bounds have changed. The compiled module _core reads
    the new file as a check before it replaces the old file."""
    with old.file.open(encoding="utf-8", newline="") as stream:
        text = edited(stream.read(), new)
    with paths.replacing(target.file.parent, target.file.name) as (fresh,):
        fresh.write_text(text, encoding="utf-8", newline="")
        target.check(fresh)
