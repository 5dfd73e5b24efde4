"""The program of a press cycle in the form of its file: phases, conditions that end them, and
bounds of evaluation elements.

The compiled module _core reads and checks the file. The functions of this module convert values of
the program to the texts and numbers of results.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from forceaxis import _core
from forceaxis._results import CycleElement as Element
from forceaxis._results import CycleEnd as End
from forceaxis._results import CyclePhase as Phase
from forceaxis._results import CycleProgram as Program
from forceaxis.experiments.summary import quantity

__all__ = ["Element", "End", "Phase", "Program"]

KEY = "experiment.cycle"  # name of the override that replaces the cycle program of an experiment
# A value and a bound count as equal up to this relative difference.
SAME = 1e-10


def end_text(end: End) -> str:
    """Returns a condition that ends a phase as text, such as "force_above 250 N"."""
    return end.when if end.value is None else f"{end.when} {quantity(end.value, end.unit)}"


def is_within(element: Element, value: float) -> bool:
    """Returns True if a value is within the bounds of an evaluation element."""
    return not (
        (element.least is not None and value < element.least - SAME * abs(element.least))
        or (element.most is not None and value > element.most + SAME * abs(element.most))
    )


def with_program(overrides: Sequence[str], program: Path | None) -> list[str]:
    """Returns `overrides` with one more override, which replaces the cycle program of an
    experiment. `program`: file of the new program, or None for no change."""
    return [*overrides, *([] if program is None else [f"{KEY}={program.resolve()}"])]


def read_program(experiment: Path, overrides: Sequence[str] = ()) -> Program:
    """Returns the cycle program of an experiment. Raises InputError if the experiment has no cycle
    program or if the program has an error."""
    return _core.cycle_program(experiment, list(overrides))


def number(value: Any, unit: str) -> float | None:
    """Converts a number or a quantity in a file to a number in `unit`. Returns None for a value
    that cannot be converted."""
    if isinstance(value, bool) or value is None:
        return None
    if isinstance(value, int | float):
        return float(value)
    return _core.quantity_in(value, unit)


def unit_of_text(value: Any) -> str:
    """Returns the unit of a quantity as the file writes it. Returns an empty text for a number
    without unit."""
    found = re.fullmatch(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*(.*?)\s*", str(value))
    return found[1] if found else ""
