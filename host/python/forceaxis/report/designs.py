"""The section of the report on design: the plants of the thesis, each with P and with a bank
designed over a set."""

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from forceaxis import drawing
from forceaxis.design import reduced, sets
from forceaxis.design.grid import Goal
from forceaxis.linear.bank import Bank

# Plants with a force loop, and the number of bits of their ADC.
PLANTS = (
    *(("fig4_15", 12), ("fig4_19", 12), ("fig4_25", 12), ("fig5_2", 12), ("fig5_5", 12)),
    *(("laboratory", 8), ("laboratory", 12), ("full_axis", 12)),
)


def row(model: str, bits: int) -> dict[str, Any]:
    """{"model", "bits", "over", "modes", "p", "design", "limited_by"} of one of PLANTS; p and
    design in the form of reduced.ShortSearch."""
    plants = sets.plant_set(model)
    problem = reduced.ShortSearch(plants, Goal(adc_bits=bits), random=0)
    found = problem.designed()
    return {
        "model": model,
        "bits": bits,
        "over": ", ".join(plants.ranges),
        "modes": len(plants.modes),
        "p": problem.worst(Bank(1.0)),
        "design": found,
        "limited_by": problem.limited_by(found),
    }


def figure(made: Sequence[dict[str, Any]]) -> Figure:
    """Figure of the bandwidth over the set, for P and for the designed bank."""
    drawn, ax = plt.subplots(figsize=(6.4, 0.7 + 0.3 * len(made)))
    drawing.style(ax)
    for y, row in enumerate(made):
        ends = [row[law].bandwidth_Hz for law in ("p", "design")]
        ax.plot(ends, [y, y], color="#d8dee4", zorder=1)
        ax.plot(ends[0], y, "D", color=drawing.GOT, markersize=4, label="P" if y == 0 else None)
        ax.plot(ends[1], y, "o", color=drawing.INK, label="designed bank" if y == 0 else None)
    ax.set_yticks(range(len(made)), [f"{r['model']}, {r['bits']} bits" for r in made], fontsize=7)
    ax.invert_yaxis()
    ax.set_xlim(left=0)
    ax.set_xlabel("bandwidth fS over the set, Hz", fontsize=8)
    ax.legend(fontsize=7, frameon=False, loc="lower right")
    drawing.finish(drawn, ax, "P and a designed bank at the same margins")
    return drawn
