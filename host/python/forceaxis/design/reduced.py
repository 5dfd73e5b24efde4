"""The search in short, for maps and tables of many plants: one integral and one section, a few
starts, and P beside it. Some percent below what `search` finds, in about a second each."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from forceaxis.design import certificate, search, structures
from forceaxis.design.certificate import WorstFigures
from forceaxis.design.contact import Ramp
from forceaxis.design.grid import DELAYS, Goal, Samples
from forceaxis.linear.bank import Bank
from forceaxis.linear.plant_set import PlantSet

NAME = "PI and one biquad"
RANDOM = 40  # choices of values that the result bears besides the corners
INTEGRALS = np.geomspace(0.1, 100, 31)  # rad/s, for PI
LEAST_HZ = 0.05
WIDER, NOTICED = 1.3, 1.02  # a bound for limited_by, and the bandwidth that shows it
INTEGRAL_MIN = 0.15  # of PI's bandwidth: a slower one leaves a tail of what P does not hold
EVALUATIONS = 200  # of each start
RESTARTS = 2
ZEROS = 3  # antiresonances that are tried
BEGIN = 4.0  # bandwidths of a PI law from which the section may begin; a lower one adds nothing


@dataclass(frozen=True)
class ShortDesign:
    """A bank and its worst figures over a set; worst is None where no gain keeps the margins."""

    bank: Bank
    worst: WorstFigures | None

    @property
    def bandwidth_Hz(self) -> float:
        """fS over the set in Hz; 0 where no gain keeps the margins."""
        return self.worst.bandwidth_Hz if self.worst else 0.0


@dataclass(frozen=True)
class ShapedDesign(ShortDesign):
    """A bank that a search found; numbers: logarithms as in `structures`."""

    numbers: Samples


class ShortSearch:
    """A set of plants at the margins of a goal: its best bank, and the largest gain of a given
    shape."""

    def __init__(self, plants: PlantSet, goal: Goal, random: int = RANDOM) -> None:
        self.plants, self.goal = plants, goal
        members = search.first_members(plants) + plants.random(random if plants.ranges else 0)
        self.inner = search.SearchProblem(plants, members, goal, None)
        self.grid = self.inner.grid
        search.check_plants(self.inner)

    def worst(self, shape: Bank) -> ShortDesign:
        """The bank of a shape, whose own gain does not matter, with the largest gain that keeps the
        margins."""
        unit = replace(shape, force_gain=1.0).quantised()
        law = unit.response(self.grid.z)
        steep = max(unit.hf_gain(), float(np.abs(law[:, -1]).max()))
        gain = self.grid.largest_gain(law, steep, self.inner.bounds).gain
        bank = certificate.lowered(unit, gain)
        return ShortDesign(bank, certificate.on_grid(self.grid, bank) if bank.force_gain else None)

    def _shaped(self, shape: Bank, numbers: Samples) -> ShapedDesign:
        found = self.worst(shape)
        return ShapedDesign(found.bank, found.worst, numbers)

    def designed(self) -> ShapedDesign:
        """The best bank that the search finds."""
        fS, rate = max(
            (self.inner.evaluate(np.array([math.log(w)]))[0], w) for w in INTEGRALS
        )  # of PI
        fS = max(fS, LEAST_HZ)
        nominal = [self.grid.open_loops[i] for i in search.nominal_of(self.grid, self.plants)]
        delays = [DELAYS[timing] for timing in self.goal.timings]
        ramp_s = self.goal.ramp_s or max(search.RAMP_MIN_S, search.RAMP_PERIODS / fS)
        self.inner.ramp = Ramp(nominal, delays, ramp_s)
        low, high = structures.bounds(NAME, BEGIN * fS).T
        low[0] = max(low[0], math.log(INTEGRAL_MIN * 2 * math.pi * fS))
        self._limits = limits = low, np.maximum(high, low)
        starts = self._starts(fS, rate, *limits)
        numbers = max((self._polished(start, *limits) for start in starts), key=_order)[1]
        for _ in range(RESTARTS):  # a simplex that has collapsed goes on from a new one
            numbers = self._polished(numbers, *limits)[1]
        found = self._shaped(structures.bank(numbers, 1.0), numbers)
        # Where no law follows the ramp, on a soft contact, the shape that leaves it least is slow.
        plain = self._shaped(Bank(1.0, rate), starts[-1])
        return max(plain, found, key=lambda f: f.bandwidth_Hz)

    def best_of(self, candidates: Iterable[Samples]) -> ShapedDesign:
        """The best bank of the numbers of other designs of the set."""
        numbers = max(candidates, key=lambda n: self.inner.evaluate(n)[0])
        return self._shaped(structures.bank(numbers, 1.0), numbers)

    def at(self, bank: Bank) -> WorstFigures:
        """The worst figures of a bank with its own gain."""
        return certificate.on_grid(self.grid, bank)

    def exact(self, bank: Bank) -> tuple[Bank, WorstFigures | None]:
        """(bank, figures) with the gain at which the exact worst of the set keeps the margins: some
        hundredths below that of the grid, in seconds instead of milliseconds."""
        return certificate.exact(self.plants, [self.grid], bank, self.goal)

    def limited_by(self, found: ShapedDesign) -> str:
        """A sentence on the bound that, widened alone, lets the bandwidth rise most."""
        own = self.inner.bounds
        wider = {
            "hf": replace(own, hf_gain=2 * own.hf_gain),
            "ms": replace(own, ms=tuple(WIDER * ms for ms in own.ms)),
            "gm": replace(own, gain_margin=own.gain_margin / WIDER),
        }
        reached = {}
        for name, self.inner.bounds in wider.items():
            reached[name] = self._polished(found.numbers, *self._limits)[0]
        self.inner.bounds = own
        name = max(reached, key=reached.__getitem__)
        if reached[name] < NOTICED * self.inner.evaluate(found.numbers)[0]:
            return (
                "No margin limits alone: the plant's resonance and lag, and a contact that is to "
                "settle without overshoot; a stiffer drive or more damping would move it."
            )
        if name == "hf":
            return (
                f"The gain at high frequency ({own.hf_gain:.3g} codes per 8-bit count) is the "
                f"limit: {self.goal.hf_cure()}."
            )
        loose = replace(own, hf_gain=math.inf, ms=(1e3,) * len(own.ms), gain_margin=1e-3)
        only = (
            replace(loose, ms=own.ms) if name == "ms"
            else replace(loose, gain_margin=own.gain_margin)
        )  # fmt: skip
        return certificate.sentence(self.grid, found.bank, 1.0, only, self.goal.hf_cure())

    def _starts(self, fS: float, rate: float, low: Samples, high: Samples) -> list[Samples]:
        """Zeros on antiresonances with a pole above, a lead, a lag, PI with its best rate."""
        zeros = search.antiresonances(self.grid)[:ZEROS]
        shapes = [(z, 0.06, z * pole, 0.5) for z in zeros for pole in (1.25, 2.6)]
        shapes += [(4 * fS, 1.0, 16 * fS, 0.8), (20 * fS, 0.8, 5 * fS, 0.8)]
        starts = [(3 * fS, *shape) for shape in shapes] + [(rate, 8 * fS, 0.8, 8 * fS, 0.8)]
        return [np.clip(np.log(start), low, high) for start in starts]

    def _polished(self, start: Samples, low: Samples, high: Samples) -> tuple[float, Samples]:
        def cost(numbers: Samples) -> float:
            return -self.inner.evaluate(np.clip(numbers, low, high))[0]

        found = optimize.minimize(
            cost, start, method="Nelder-Mead",
            options={"maxfev": EVALUATIONS, "xatol": 1e-3, "fatol": 1e-3},
        )  # fmt: skip
        return -found.fun, np.clip(found.x, low, high)


def _order(polished: tuple[float, Samples]) -> tuple[float, tuple[float, ...]]:
    return polished[0], tuple(polished[1])
