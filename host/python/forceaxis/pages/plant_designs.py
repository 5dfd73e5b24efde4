"""The section of the report about the design of force laws. It compares law P with the designed
filter bank, for plants of the thesis."""

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from forceaxis import drawing
from forceaxis.design import reduced, sets
from forceaxis.design.grid import Goal
from forceaxis.linear.bank import Bank

# (name of a model with a force loop, number of bits of its ADC)
PLANTS = (
    *(("fig4_15", 12), ("fig4_19", 12), ("fig4_25", 12), ("fig5_2", 12), ("fig5_5", 12)),
    *(("laboratory", 8), ("laboratory", 12), ("full_axis", 12)),
)


@dataclass(frozen=True)
class PlantDesign:
    """The P gain and a designed filter bank for one of the models in PLANTS."""

    model: str
    bits: int  # resolution of the ADC in bits
    over: str  # names of the parameters that have a tolerance in the set of plants
    modes: int  # number of combinations of element states in the set of plants
    p: reduced.ShortDesign
    design: reduced.ShapedDesign
    limited_by: str  # sentence about the requirement that limits the bandwidth, such as a margin


def plant_design(model: str, bits: int) -> PlantDesign:
    """Computes the P gain and a filter bank for a plant with tolerances. `bits`: bits of the
    ADC."""
    plants = sets.plant_set(model)
    problem = reduced.ShortSearch(plants, Goal(adc_bits=bits), random=0)
    found = problem.designed()
    return PlantDesign(
        model=model,
        bits=bits,
        over=", ".join(plants.ranges),
        modes=len(plants.modes),
        p=problem.worst(Bank(1.0)),
        design=found,
        limited_by=problem.limited_by(found),
    )


def figure(rows: Sequence[PlantDesign]) -> Figure:
    """Returns a plot of the bandwidth over the set of plants, for law P and for the designed filter
    bank."""
    drawn, ax = plt.subplots(figsize=(6.4, 0.7 + 0.3 * len(rows)))
    drawing.style(ax)
    for y, row in enumerate(rows):
        ends = [row.p.bandwidth_Hz, row.design.bandwidth_Hz]
        ax.plot(ends, [y, y], color="#d8dee4", zorder=1)
        ax.plot(ends[0], y, "D", color=drawing.GOT, markersize=4, label="P" if y == 0 else None)
        ax.plot(ends[1], y, "o", color=drawing.INK, label="designed bank" if y == 0 else None)
    ax.set_yticks(range(len(rows)), [f"{r.model}, {r.bits} bits" for r in rows], fontsize=7)
    ax.invert_yaxis()
    ax.set_xlim(left=0)
    ax.set_xlabel("bandwidth fS over the set, Hz", fontsize=8)
    ax.legend(fontsize=7, frameon=False, loc="lower right")
    drawing.finish(drawn, ax, "P and a designed bank at the same margins")
    return drawn
