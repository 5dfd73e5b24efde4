"""Short search of a law, for maps and tables of many plants: an integral and one section, a few
starts, and P for comparison. The bandwidth is some per cent below that of `search`; a plant set
takes about a second."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from forceaxis.design import certificate, search, structures
from forceaxis.design.certificate import WorstFigures
from forceaxis.design.grid import Goal, Samples
from forceaxis.linear.bank import Bank
from forceaxis.linear.plant_set import PlantSet

NAME = "PI and one biquad"
RANDOM = 40  # random choices of values on which the result is checked, besides the corners
INTEGRALS = np.geomspace(0.1, 100, 31)  # rad/s, for PI
LEAST_HZ = 0.05
# factor of a bound for limited_by, and the increase of bandwidth that counts
WIDER, NOTICED = 1.3, 1.02
# smallest integral rate as a share of PI's rate; with a slower one a static error disappears too
# slowly
INTEGRAL_MIN = 0.15
EVALUATIONS = 200  # of each start
RESTARTS = 2
ZEROS = 3  # largest number of antiresonances at which the search begins
BEGIN = 4.0  # multiple of PI's bandwidth: lowest start of the section


@dataclass(frozen=True)
class ShortDesign:
    """A bank and its worst figures over a set; worst is None if no gain keeps the margins."""

    bank: Bank
    worst: WorstFigures | None

    @property
    def bandwidth_Hz(self) -> float:
        """fS over the set in Hz; 0 if no gain keeps the margins."""
        return self.worst.bandwidth_Hz if self.worst else 0.0


@dataclass(frozen=True)
class ShapedDesign(ShortDesign):
    """A bank that a search has found; numbers: logarithms as in `structures`."""

    numbers: Samples


class ShortSearch:
    """Search of the best bank for a set of plants at the margins of a goal; also the largest gain
    of a given shape."""

    def __init__(self, plants: PlantSet, goal: Goal, random: int = RANDOM) -> None:
        self.plants, self.goal = plants, goal
        members = search.first_members(plants) + plants.random(random if plants.ranges else 0)
        self.inner = search.SearchProblem(plants, members, goal, None)
        self.grid = self.inner.grid
        search.check_plants(self.inner)

    def worst(self, shape: Bank) -> ShortDesign:
        """The largest gain with which the shape of a bank keeps the margins, and the figures with
        it; the bank's own gain is ignored."""
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
        self.inner.follow_ramp(self.plants, self.goal, fS)
        self._limits = limits = structures.bounds(NAME, BEGIN * fS)
        limits[0, 0] = max(limits[0, 0], math.log(INTEGRAL_MIN * 2 * math.pi * fS))
        limits[:, 1] = limits.max(axis=1)
        starts = self._starts(fS, rate)
        numbers = max(map(self._polished, starts), key=self._order)
        # a second start, because the simplex of the first may have collapsed
        for _ in range(RESTARTS):
            numbers = self._polished(numbers)
        found = self._shaped(structures.bank(numbers, 1.0), numbers)
        # On a soft contact no law may follow the ramp; the best shape is then too slow.
        plain = self._shaped(Bank(1.0, rate), starts[-1])
        return max(plain, found, key=lambda f: f.bandwidth_Hz)

    def best_of(self, candidates: Iterable[Samples]) -> ShapedDesign:
        """The best bank among the numbers of other designs for this set."""
        numbers = max(candidates, key=lambda n: self.inner.evaluate(n)[0])
        return self._shaped(structures.bank(numbers, 1.0), numbers)

    def at(self, bank: Bank) -> WorstFigures:
        """The worst figures of a bank with its present gain."""
        return certificate.on_grid(self.grid, bank)

    def exact(self, bank: Bank) -> tuple[Bank, WorstFigures | None]:
        """(bank, figures) with the gain at which the exact worst figures of the set keep the
        margins. The gain is some per cent below that of the grid; the computation takes seconds
        instead of milliseconds."""
        return certificate.exact(self.plants, [self.grid], bank, self.goal)

    def limited_by(self, found: ShapedDesign) -> str:
        """A sentence about the bound whose increase raises the bandwidth most."""
        own = self.inner.bounds
        wider = {
            "hf": replace(own, hf_gain=2 * own.hf_gain),
            "ms": replace(own, ms=tuple(WIDER * ms for ms in own.ms)),
            "gm": replace(own, gain_margin=own.gain_margin / WIDER),
        }
        reached = {}
        for name, self.inner.bounds in wider.items():
            reached[name] = self.inner.evaluate(self._polished(found.numbers))[0]
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

    def _starts(self, fS: float, rate: float) -> list[Samples]:
        """Start values: zeros on antiresonances with a pole above, a lead, a lag, and PI with its
        best rate."""
        zeros = search.antiresonances(self.grid)[:ZEROS]
        shapes = [(z, 0.06, z * pole, 0.5) for z in zeros for pole in (1.25, 2.6)]
        shapes += [(4 * fS, 1.0, 16 * fS, 0.8), (20 * fS, 0.8, 5 * fS, 0.8)]
        starts = [(3 * fS, *shape) for shape in shapes] + [(rate, 8 * fS, 0.8, 8 * fS, 0.8)]
        low, high = self._limits.T
        return [np.clip(np.log(start), low, high) for start in starts]

    def _polished(self, start: Samples) -> Samples:
        return self.inner.polished(start, self._limits, EVALUATIONS, 1e-3)

    def _order(self, numbers: Samples) -> tuple[float, tuple[float, ...]]:
        """Sorting key of laws: the bandwidth, then the numbers."""
        return self.inner.evaluate(numbers)[0], tuple(numbers)
