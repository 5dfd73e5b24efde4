"""The program of a cycle as its file describes it: phases, what ends them, bounds of elements.

The compiled module reads and checks the file and gives these values. The functions here name what
a result shows.
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

KEY = "experiment.cycle"  # override that replaces the program of an experiment
# Relative difference up to which a value is equal to a bound that is written in decimals.
SAME = 1e-10


def end_text(end: End) -> str:
    """Returns a condition as text, such as "force_above 250 N"."""
    return end.when if end.value is None else f"{end.when} {quantity(end.value, end.unit)}"


def is_within(element: Element, value: float) -> bool:
    """Returns True if a value is within the bounds of an element."""
    return not (
        (element.least is not None and value < element.least - SAME * abs(element.least))
        or (element.most is not None and value > element.most + SAME * abs(element.most))
    )


def with_program(overrides: Sequence[str], program: Path | None) -> list[str]:
    """Returns the overrides of a run with another program than that of the experiment."""
    return [*overrides, *([] if program is None else [f"{KEY}={program.resolve()}"])]


def read_program(experiment: Path, overrides: Sequence[str] = ()) -> Program:
    """Returns the program that an experiment runs. Raises InputError, also for a mistake in the
    program or if the experiment has none."""
    return _core.cycle_program(experiment, list(overrides))


def number(value: Any, unit: str) -> float | None:
    """Returns a number or a quantity of a file in `unit`, or None if there is no such quantity."""
    if isinstance(value, bool) or value is None:
        return None
    if isinstance(value, int | float):
        return float(value)
    return _core.quantity_in(value, unit)


def unit_of_text(value: Any) -> str:
    """Returns the unit of a quantity as its file spells it, empty for a number."""
    found = re.fullmatch(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*(.*?)\s*", str(value))
    return found[1] if found else ""
