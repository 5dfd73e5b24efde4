"""Short search for a control law, for plots and tables with many sets of plants.

The law has integral action and one second-order section, and the search begins at a few start
values. The bandwidth is some per cent below that from `search`. A set of plants takes about 1 s.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from forceaxis.design import certificate, search, structures
from forceaxis.design.certificate import WorstFigures
from forceaxis.design.grid import THIN, Bounds, Goal, Samples
from forceaxis.linear.bank import Bank
from forceaxis.linear.plant_set import PlantSet
from forceaxis.linear.precise import Responses

NAME = "PI and one biquad"
RANDOM = 40  # number of random plants in the final check, in addition to the corner plants
# Logarithms of the integral rates of the PI laws: 0.1 to 100 rad/s.
PI_RATES = structures.logarithms([0.1 * 10 ** (0.1 * step) for step in range(31)])
PI_BANDWIDTH_MIN_HZ = 0.05  # smallest bandwidth in Hz that the search assumes for a PI law
# limited_by() multiplies or divides a bound by BOUND_FACTOR.
# The bound limits the bandwidth if this changes the bandwidth by more than BANDWIDTH_RATIO_MIN.
BOUND_FACTOR, BANDWIDTH_RATIO_MIN = 1.3, 1.02
# A bound that alone would permit NEAR_FACTOR times the gain does not limit the bandwidth.
NEAR_FACTOR = 1.1
# Smallest integral rate of a law as a share of the bandwidth of the PI law.
# With a smaller integral rate, a static error disappears too slowly.
INTEGRAL_MIN = 0.15
# size and number of generations of the differential evolution on a thin grid
POPULATION, GENERATIONS = 30, 40
EVALUATIONS = 200  # largest number of control laws that the simplex search evaluates
ZEROS_MAX = 3  # largest number of antiresonances at which a search starts
# Lowest frequency of the second-order section, as a multiple of the bandwidth of the PI law.
SECTION_START_FACTOR = 4.0


@dataclass(frozen=True)
class ShortDesign:
    """A filter bank, and its worst bandwidth and margins over a set of plants. The fields are None
    if no gain keeps the margins."""

    bank: Bank
    worst: WorstFigures | None

    @property
    def bandwidth_Hz(self) -> float:
        """Returns the bandwidth fS over the set of plants in Hz, or 0 if no gain keeps
        the margins."""
        return self.worst.bandwidth_Hz if self.worst else 0.0


@dataclass(frozen=True)
class ShapedDesign(ShortDesign):
    """A filter bank that a search has found. `numbers`: the logarithms from which `structures`
    computes this bank."""

    numbers: Samples


class ShortSearch:
    """Search for the filter bank with the best bandwidth over a set of plants that keeps the
    required margins. It can also find the largest gain of a bank with given filters."""

    def __init__(self, plants: PlantSet, goal: Goal, random: int = RANDOM) -> None:
        self.plants, self.goal = plants, goal
        members = search.first_members(plants) + plants.random(random if plants.ranges else 0)
        self.inner = search.SearchProblem(plants, members, goal)
        self.grid = self.inner.grid
        self._thin = search.SearchProblem(plants, search.first_members(plants), goal, THIN)
        search.check_plants(plants, self.grid)

    def worst(self, shape: Bank) -> ShortDesign:
        """Returns a filter bank with the largest gain that keeps the margins, and its worst
        bandwidth and margins. The bank has the integral rate and sections of `shape`. The gain of
        `shape` is ignored."""
        unit = replace(shape, force_gain=1.0).quantised()
        gain = self.grid.largest_gain(unit, self.inner.hf_gain(unit), self.inner.bounds).gain
        bank = certificate.lowered(unit, gain)
        return ShortDesign(bank, certificate.on_grid(self.grid, bank) if bank.force_gain else None)

    def _shaped(self, shape: Bank, numbers: Samples) -> ShapedDesign:
        found = self.worst(shape)
        return ShapedDesign(found.bank, found.worst, numbers)

    def designed(self) -> ShapedDesign:
        """Returns the best filter bank that the search finds."""
        bandwidths = self.inner.evaluate_all(PI_RATES[:, None])[:, 0]
        # bandwidth and integral rate of the best PI law
        fS, rate = max(zip(bandwidths.tolist(), PI_RATES.tolist(), strict=True))
        fS = max(fS, PI_BANDWIDTH_MIN_HZ)
        self.inner.follow_ramp(self.plants, self.goal, fS)
        self._limits = limits = structures.bounds(NAME, SECTION_START_FACTOR * fS)
        limits[0, 0] = max(limits[0, 0], *structures.logarithms([INTEGRAL_MIN * 2 * math.pi * fS]))
        limits[:, 1] = limits.max(axis=1)
        self._thin.bounds, self._thin.ramp = self.inner.bounds, self.inner.ramp
        starts = self._starts(fS, rate)
        laws = search.evolved(self._thin, limits, np.array(starts), POPULATION, GENERATIONS)
        numbers = self._polished(self.inner.best_of(laws))
        found = self._shaped(structures.bank(numbers, 1.0), numbers)
        # On a soft contact, possibly no law follows the ramp, and the found law is then too slow.
        plain = self._shaped(structures.bank(np.array([rate]), 1.0), starts[-1])
        return max(plain, found, key=lambda f: f.bandwidth_Hz)

    def best_of(self, candidates: Iterable[Samples]) -> ShapedDesign:
        """Returns the best filter bank for this set of plants among `candidates`, which are results
        of other searches. A candidate is an array of logarithms as in ShapedDesign."""
        numbers = max(candidates, key=lambda n: self.inner.evaluate(n)[0])
        return self._shaped(structures.bank(numbers, 1.0), numbers)

    def at(self, bank: Bank) -> WorstFigures | None:
        """Returns the exact worst bandwidth and margins of any filter bank, without a change of the
        gain. The result is None if a plant of the set is unstable with this bank."""
        return certificate.of_any(self.plants, self.grid, bank, self.goal.timings)

    def exact(self, bank: Bank) -> tuple[Bank, WorstFigures | None]:
        """Returns (filter bank, worst values) with the largest gain at which the exact bandwidth
        and margins keep the bounds.

        The gain is some per cent below the gain that the grid of frequencies permits. The
        computation takes seconds instead of milliseconds.
        """
        return certificate.exact(
            Responses(self.plants, self.goal.timings), self.grid, bank, self.goal
        )

    def limited_by(self, found: ShapedDesign) -> str:
        """Returns a sentence about the bound that limits the bandwidth of a design. The sentence
        names the bound whose change increases the bandwidth most."""
        own = self.inner.bounds
        wider = {
            "hf": replace(own, hf_gain=2 * own.hf_gain),
            "ms": replace(own, ms=tuple(BOUND_FACTOR * ms for ms in own.ms)),
            "gm": replace(own, gain_margin=own.gain_margin / BOUND_FACTOR),
        }
        loose = replace(own, hf_gain=math.inf, ms=(1e3,) * len(own.ms), gain_margin=1e-3)
        alone = {
            "hf": replace(loose, hf_gain=own.hf_gain),
            "ms": replace(loose, ms=own.ms),
            "gm": replace(loose, gain_margin=own.gain_margin),
        }
        reached = dict.fromkeys(wider, 0.0)
        for name in self._near(found.numbers, alone):
            self.inner.bounds = wider[name]
            reached[name] = self.inner.evaluate(self._polished(found.numbers))[0]
        self.inner.bounds = own
        name = max(reached, key=reached.__getitem__)
        if reached[name] < BANDWIDTH_RATIO_MIN * self.inner.evaluate(found.numbers)[0]:
            return (
                "No single margin limits the bandwidth: the limit is the plant's resonance and "
                "lag, and a contact that has to settle without overshoot; a stiffer drive or more "
                "damping raises it."
            )
        if name == "hf":
            return (
                f"The gain at high frequency ({own.hf_gain:.3g} codes per 8-bit count) is the "
                f"limit: {self.goal.hf_cure()}."
            )
        return certificate.sentence(self.grid, found.bank, 1.0, alone[name], self.goal.hf_cure())

    def _near(self, numbers: Samples, alone: Mapping[str, Bounds]) -> list[str]:
        """Returns the names of those bounds that permit nearly the smallest gain of all bounds.
        `numbers`: the numbers of the law. `alone`: {name: bounds of which only one is finite}."""
        unit = structures.bank(numbers, 1.0)
        steep = self.inner.hf_gain(unit)
        gains = {n: self.grid.largest_gain(unit, steep, one).gain for n, one in alone.items()}
        return [n for n, gain in gains.items() if gain <= NEAR_FACTOR * min(gains.values())]

    def _starts(self, fS: float, rate: float) -> list[Samples]:
        """Returns start values of the search as logarithms. Some laws have zeros at antiresonances
        and a pole at a higher frequency. The other laws are a lead, a lag and the best PI law.

        `fS`: bandwidth of the PI law in Hz. `rate`: logarithm of the integral rate of the PI law in
        rad/s.
        """
        zeros = search.antiresonances(self.grid)[:ZEROS_MAX]
        shapes = [(z, 0.06, z * pole, 0.5) for z in zeros for pole in (1.25, 2.6)]
        shapes += [(4 * fS, 1.0, 16 * fS, 0.8), (20 * fS, 0.8, 5 * fS, 0.8)]
        starts = [structures.logarithms((3 * fS, *shape)) for shape in shapes]
        starts += [np.append(rate, structures.logarithms((8 * fS, 0.8, 8 * fS, 0.8)))]
        low, high = self._limits.T
        return [np.clip(start, low, high) for start in starts]

    def _polished(self, start: Samples) -> Samples:
        return self.inner.polished(start, self._limits, EVALUATIONS, 1e-3)
