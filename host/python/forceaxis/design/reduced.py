"""The search in short, for maps and tables of many plants: one integral and one section, a few
starts, and P beside it. Some percent below what `search` finds, in about a second each."""

import math
from dataclasses import replace

import numpy as np
from scipy import optimize

from forceaxis.design import search, structures
from forceaxis.design.contact import Ramp
from forceaxis.design.grid import DELAYS
from forceaxis.linear.bank import GAIN_STEP

NAME = "PI and one biquad"
RANDOM = 40  # choices of values that the result bears besides the corners
INTEGRALS = np.geomspace(0.3, 100, 25)  # rad/s, for PI
LEAST_HZ = 0.05
INTEGRAL_MIN = 0.15  # of PI's bandwidth: a slower one leaves a tail of what P does not hold
EVALUATIONS = 200  # of each start
RESTARTS = 2
ZEROS = 3  # antiresonances that are tried


class Problem:
    """A set at the margins of a goal, what P does there, and what a given shape does."""

    def __init__(self, plants, goal, random=RANDOM):
        self.plants, self.goal = plants, goal
        members = search._members(plants) + plants.random(random if plants.ranges else 0)
        self.inner = search._Problem(plants, members, goal, None)
        self.grid = self.inner.grid
        search._check_plants(self.inner)

    def worst(self, shape):
        """The largest bank of a shape (a Bank; its gain does not matter) that keeps the margins:
        {"bank", "worst", "end"}, worst None where there is none."""
        unit = replace(shape, force_gain=1.0).quantised()
        law = unit.response(self.grid.z)
        steep = max(unit.hf_gain(), float(np.abs(law[:, -1]).max()))
        end = self.grid.largest_gain(law, steep, self.inner.bounds)
        bank = replace(unit, force_gain=math.floor(end[0] / GAIN_STEP) * GAIN_STEP)
        worst = search._worst(self.grid, bank, self.goal) if bank.force_gain else None
        return {"bank": bank, "worst": worst, "end": end}

    def designed(self):
        """The same of the best shape found."""
        fS = max(max(self.inner.judge([math.log(w)])[0] for w in INTEGRALS), LEAST_HZ)  # of PI
        nominal = [self.grid.open_loops[i] for i in search._nominal(self.grid, self.plants)]
        delays = [DELAYS[timing] for timing in self.goal.timings]
        ramp_s = self.goal.ramp_s or max(search.RAMP_MIN_S, search.RAMP / fS)
        self.inner.ramp = Ramp(nominal, delays, ramp_s)
        low, high = structures.bounds(NAME, search.SECTIONS_ABOVE * fS).T
        low[0] = max(low[0], math.log(INTEGRAL_MIN * 2 * math.pi * fS))
        limits = low, np.maximum(high, low)
        numbers = max(self._polished(start, *limits) for start in self._starts(fS, *limits))[1]
        for _ in range(RESTARTS):  # a simplex that has collapsed goes on from a new one
            numbers = self._polished(numbers, *limits)[1]
        return self.worst(structures.bank(np.array(numbers), 1.0))

    def at(self, bank):
        """The worst figures of a bank, gain and all."""
        return search._worst(self.grid, bank, self.goal)

    def limited_by(self, found):
        """The sentence of a design."""
        return search._sentence(self.grid, found, self.inner.bounds)

    def _starts(self, fS, low, high):
        """Zeros on the antiresonances with a pole above; a lead; a lag."""
        zeros = search._antiresonances(self.grid)[:ZEROS]
        shapes = [(z, 0.06, z * pole, 0.5) for z in zeros for pole in (1.25, 2.6)]
        shapes += [(4 * fS, 1.0, 16 * fS, 0.8), (20 * fS, 0.8, 5 * fS, 0.8)]
        return [np.clip(np.log([3 * fS, *shape]), low, high) for shape in shapes]

    def _polished(self, start, low, high):
        def cost(numbers):
            return -self.inner.judge(np.clip(numbers, low, high))[0]

        found = optimize.minimize(
            cost, start, method="Nelder-Mead",
            options={"maxfev": EVALUATIONS, "xatol": 1e-3, "fatol": 1e-3},
        )  # fmt: skip
        return -found.fun, tuple(np.clip(found.x, low, high))
