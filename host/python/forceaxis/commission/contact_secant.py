"""Secant stiffness of contacts whose force is a nonlinear curve over the overlap. It is the largest
recorded force divided by the overlap at this force. The recordings determine the secant stiffness
more accurately than the stiffness of each segment of the curve, which depends on the limits of the
segment."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from forceaxis import linear, toml
from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_likelihood import ContactProblem
from forceaxis.linear import posterior, working


@dataclass(frozen=True)
class SecantStiffness:
    """The secant stiffness in N/m of a contact between 0 and `force_N`, the largest recorded force.
    `value`: stiffness of the most likely plant. `interval`: 95 % interval of the stiffness."""

    contact: str
    force_N: float
    value: float
    interval: tuple[float, float]


def overlap_of(force_N: float, stiffness: Floats, breaks: Floats, *, are_loads: bool) -> Floats:
    """Returns the overlap in m at which a contact has a force, for n contacts. `stiffness`:
    stiffness of each segment in N/m, with one row for each segment and one column for each contact.
    `breaks`: limits between the segments, with one row less. They are overlaps in m, or forces in N
    if `are_loads` is True."""
    if not are_loads:
        breaks = np.cumsum(stiffness[:-1] * np.diff(breaks, axis=0, prepend=0), axis=0)
    each = np.diff(np.minimum(breaks, force_N), axis=0, prepend=0, append=force_N)
    return np.asarray(np.sum(each / stiffness, axis=0))


def secants_of(
    problem: ContactProblem, best: Floats, points: Floats
) -> tuple[SecantStiffness, ...]:
    """Returns the secant stiffness of each contact that has a nonlinear curve. `best`: the most
    likely point. `points`: samples of the posterior, with one row for each point."""
    every = np.concatenate([best[None], points])
    values = dict(zip(problem.names, problem.values(every).T, strict=True))
    parameters = linear.facts(str(problem.model), problem.held).parameters
    zero = float(problem.number("zero", -1, best[None])[0])
    force_N = max(float(touch.force.values.max()) for touch in problem.data.touches) - zero

    def rows(given: Any) -> Floats:
        """Returns the values of a key in the model, which is a number or a list. The result has one
        row for each value and one column for each point."""
        each = given if isinstance(given, list) else [given]
        found = [values.get(one, working.number(one, parameters)) for one in each]
        return np.array([np.broadcast_to(np.asarray(one, float), len(every)) for one in found])

    secants = []
    for table in toml.read(problem.model).get("contact", ()):
        stiffness = rows(table["stiffness"])
        if len(stiffness) > 1:
            key = "loads" if "loads" in table else "breaks"
            overlap = overlap_of(force_N, stiffness, rows(table[key]), are_loads=key == "loads")
            secant = force_N / overlap
            low, high = np.quantile(secant[1:], (posterior.LOW, posterior.HIGH))
            secants.append(
                SecantStiffness(table["name"], force_N, float(secant[0]), (float(low), float(high)))
            )
    return tuple(secants)
