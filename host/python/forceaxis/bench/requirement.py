"""Requirements on the measured values of the benchmarks."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Requirement:
    """A requirement of a benchmark, and whether a measured value meets it."""

    check: str  # text about the requirement: quantity, bound and measured value
    held: bool


def _requirement(text: str, figure: float | None, is_reached: bool) -> Requirement:
    return Requirement(f"{text}: {'missing' if figure is None else f'{figure:.3g}'}", is_reached)


def at_least(quantity: str, figure: float | None, least: float) -> Requirement:
    """Returns the requirement that a measured value is at least `least`. A missing value does not
    meet the requirement."""
    return _requirement(f"{quantity} >= {least}", figure, figure is not None and figure >= least)


def at_most(quantity: str, figure: float | None, most: float) -> Requirement:
    """Returns the requirement that a measured value is at most `most`. A missing value does not
    meet the requirement."""
    return _requirement(f"{quantity} <= {most}", figure, figure is not None and figure <= most)
