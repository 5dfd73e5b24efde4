"""Required figures of the benchmarks."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Requirement:
    """A required figure, and whether the benchmark has reached it."""

    check: str  # quantity, bound and figure as text
    held: bool


def _requirement(text: str, figure: float | None, is_reached: bool) -> Requirement:
    return Requirement(f"{text}: {'missing' if figure is None else f'{figure:.3g}'}", is_reached)


def at_least(quantity: str, figure: float | None, least: float) -> Requirement:
    """The requirement that a figure is at least `least`; a missing figure does not reach it."""
    return _requirement(f"{quantity} >= {least}", figure, figure is not None and figure >= least)


def at_most(quantity: str, figure: float | None, most: float) -> Requirement:
    """The requirement that a figure is at most `most`; a missing figure does not reach it."""
    return _requirement(f"{quantity} <= {most}", figure, figure is not None and figure <= most)
