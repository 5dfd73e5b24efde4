"""The program of a cycle as its file describes it: phases, what ends them, bounds of elements.

The compiled module reads the same file and refuses mistakes in it. The functions here only name
what a result shows.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from forceaxis import _core, toml
from forceaxis._core import InputError
from forceaxis.experiments.summary import quantity

KEY = "experiment.cycle"  # override that replaces the program of an experiment
END = "end"
# Kinds of elements whose bounds are no interval of one number.
SHAPES = ("window", "envelope")
X_UNITS = {"travel": "m", "time": "s"}
CONDITION_UNITS = {
    "time": "s",
    "force_above": "N",
    "force_below": "N",
    "stiffness_above": "N/m",
    "stiffness_below": "N/m",
}  # of others: m
# How closely a value agrees with a bound that is written in decimals, relative to both.
SAME = 1e-10


@dataclass(frozen=True)
class End:
    """A condition that ends a phase."""

    when: str
    value: float | None  # s, N, N/m or m
    next: str  # name of the phase that follows, or "end"

    @property
    def text(self) -> str:
        """The condition as text, such as "force_above 250 N"."""
        unit = CONDITION_UNITS.get(self.when, "m")
        return self.when if self.value is None else f"{self.when} {quantity(self.value, unit)}"


@dataclass(frozen=True)
class Phase:
    """A phase, with the conditions that end it in the order of the file."""

    name: str
    ends: list[End]
    on_limit: str
    tare_s: float | None = None  # time over which the phase measures the offset of the force


@dataclass(frozen=True)
class Element:
    """An element, with bounds in SI units. None means that there is no such bound."""

    name: str
    kind: str
    phases: list[str]
    over: str  # "travel" or "time"
    of: str  # "x" or "force": what crosses the level of `at` and `difference`
    unit: str  # unit of the value, empty for a number
    x_from: float | None
    x_to: float | None
    least: float | None
    most: float | None
    level: float | None
    lower: list[tuple[float, float]]  # points (x, N) of the curves of an envelope
    upper: list[tuple[float, float]]

    def is_within(self, value: float) -> bool:
        """Returns True if a value is within the bounds of the element."""
        return not (
            (self.least is not None and value < self.least - SAME * abs(self.least))
            or (self.most is not None and value > self.most + SAME * abs(self.most))
        )


@dataclass(frozen=True)
class Program:
    """A program of a cycle."""

    file: Path
    title: str
    zero: str  # what defines travel 0: "touch", "force" or "position"
    zero_at: float | None  # the force in N, or the position in m
    phases: list[Phase]
    elements: list[Element]
    # points (N, m): deflection of the press over the force
    compliance: list[tuple[float, float]] = field(default_factory=list)


def program_file(experiment: Path, overrides: Sequence[str] = ()) -> Path:
    """Returns the path of the program that an experiment runs. Raises InputError if the experiment
    has none."""
    given = [text.partition("=")[2] for text in overrides if text.startswith(f"{KEY}=")]
    name = given[-1] if given else toml.read(experiment).get("cycle")
    if not isinstance(name, str):
        raise InputError(
            f"{experiment}: cycle: expected an experiment that names a program in this key; "
            "add it, or give another experiment"
        )
    return experiment.parent / name


def with_program(overrides: Sequence[str], program: Path | None) -> list[str]:
    """Returns the overrides of a run with another program than that of the experiment."""
    return [*overrides, *([] if program is None else [f"{KEY}={program.resolve()}"])]


def read_program(file: Path) -> Program:
    """Returns the program of a file that the compiled module has accepted. Raises InputError."""
    table = toml.read(file)
    zero = str(table.get("zero", "touch"))
    unit = "N" if zero == "force" else "m"
    return Program(
        file=file,
        title=str(table.get("title", "")),
        zero=zero,
        zero_at=number(table.get(f"zero_{zero}"), unit),
        phases=[_phase(phase) for phase in table.get("phase", [])],
        elements=[_element(element) for element in table.get("element", [])],
        compliance=_points(table, "compliance_force", "N", "compliance_deflection", "m"),
    )


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


def _phase(table: Mapping[str, Any]) -> Phase:
    ends = []
    for end in table.get("end", []):
        unit = CONDITION_UNITS.get(end["when"], "m")
        ends.append(End(end["when"], number(end.get("value"), unit), end["next"]))
    tare_s = number(table.get("tare_time"), "s")
    return Phase(table["name"], ends, table.get("on_limit", END), tare_s)


def _element(table: Mapping[str, Any]) -> Element:
    over, of, kind = table.get("over", "travel"), table.get("of", "x"), table["kind"]
    x_unit = X_UNITS[over]
    is_x = kind in ("at", "difference") and of == "force"
    unit = x_unit if is_x else {"work": "J" if over == "travel" else "N s"}.get(kind, "N")
    return Element(
        name=table["name"],
        kind=kind,
        phases=list(table["phases"]),
        over=over,
        of=of,
        unit=unit,
        x_from=number(table.get("from"), x_unit),
        x_to=number(table.get("to"), x_unit),
        least=number(table.get("least"), unit),
        most=number(table.get("most"), unit),
        level=number(table.get("level"), "N" if of == "force" else x_unit),
        lower=_points(table, "lower_x", x_unit, "lower_force", "N"),
        upper=_points(table, "upper_x", x_unit, "upper_force", "N"),
    )


def _points(
    table: Mapping[str, Any], x_key: str, x_unit: str, y_key: str, y_unit: str
) -> list[tuple[float, float]]:
    pairs = zip(table.get(x_key, []), table.get(y_key, []), strict=True)
    return [(number(x, x_unit) or 0.0, number(y, y_unit) or 0.0) for x, y in pairs]
