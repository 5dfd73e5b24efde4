"""Linear analysis of a plant model: state space, force loops, modes of vibration, beams, and the
mode of vibration that limits the bandwidth."""

from forceaxis.linear.plant_facts import Overrides, PlantFacts
from forceaxis.linear.system import (
    TICK_S,
    System,
    facts,
    find_model,
    linearise,
    override_texts,
    overrides,
    shown,
    states,
)

__all__ = [
    "TICK_S",
    "Overrides",
    "PlantFacts",
    "System",
    "facts",
    "find_model",
    "linearise",
    "override_texts",
    "overrides",
    "shown",
    "states",
]
