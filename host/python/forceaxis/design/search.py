"""Searches the force law with the largest bandwidth over a set of plants at given margins.

The search varies the zeros, poles and integral rate of each structure of the law, and maximises the
frequency up to which |S| of the worst member stays below -3 dB. It uses differential evolution on a
thin grid of frequencies, then a simplex on the full grid. The gain is the largest one that keeps
the margins (`grid`). The corners of a set are not always its worst members. The search therefore
checks random members, and adds those on which the law violates the margins.
"""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from forceaxis._core import InputError
from forceaxis.design import certificate, structures
from forceaxis.design.banks import BankFigures, bank_figures
from forceaxis.design.certificate import P, Row, WorstFigures
from forceaxis.design.contact import Ramp
from forceaxis.design.grid import DELAYS, THIN, Goal, Grid, Response, Samples, blocks
from forceaxis.errors import ParameterError
from forceaxis.linear.bank import GAIN_STEP, Bank
from forceaxis.linear.plant_set import Member, PlantSet

# smallest ratio of bandwidths at which the search selects the larger structure of the law
LARGER_STRUCTURE_MIN = 1.1
RANDOM = 1000  # number of random plants on which the result is checked
PROBE_RANDOM = 60  # number of random plants in each round of the search
ROUNDS_MAX = 4  # largest number of rounds in which plants are added to the search
# Largest number of corner plants at the start of the search, from the set of plants.
CORNERS_MAX = 8
SEED = 1988
# rise time of the set-point ramp as a multiple of 1 / (bandwidth of a PI law)
RAMP_PERIODS = 0.2
RAMP_MIN_S = 0.1  # shortest rise time
# The bandwidth is evaluated at this share of the largest gain.
# Without this share, the bandwidth would jump if a peak of |S| is close to -3 dB.
GAIN_SHARE = 0.97
# Number of generations of the differential evolution.
# With half of this number, a search often ends in a local optimum, even with restarts.
GENERATIONS = 90
# number of searches for a law with no, with one and with two second-order sections
RESTARTS = (1, 2, 2)
# Lowest frequency of zeros and poles for each restart, as a multiple of the bandwidth of a PI law.
# The best result is used, because the ramp excludes laws that oscillate after a first contact.
LOWEST_FACTORS = (1.5, 0.5)
# largest static error of a law without integral action, as a share of the force set-point
STATIC_ERROR_MAX = 0.01


@dataclass(frozen=True)
class StructureDesign:
    """The best control law of one structure. `worst` contains the worst bandwidth and margins over
    the set of plants; None if no gain keeps the margins."""

    name: str
    bank: BankFigures
    worst: WorstFigures | None

    @property
    def bandwidth_Hz(self) -> float:
        """Returns the bandwidth fS over the set of plants in Hz, or 0 if the law has
        no bandwidth."""
        return self.worst.bandwidth_Hz if self.worst else 0.0

    @property
    def row(self) -> Row:
        """Returns fS in Hz, Ms and gain margin for a table. The values are None if no gain keeps
        the margins."""
        w = self.worst
        return (w.fS_Hz, w.Ms, w.gain_margin) if w else (None, None, None)


@dataclass(frozen=True)
class SearchResult:
    """Result of a search: the filter bank with the values that the firmware stores, and the worst
    bandwidth and margins of this bank over the set of plants.

    p: figures of the P law at the same margins; structures: from the smallest to the largest;
    limited_by: a sentence; chosen: name of a structure; instead(name): the result with another
    structure, None if no gain keeps the margins with this structure.
    """

    bank: Bank
    worst: WorstFigures
    p: P
    structures: list[StructureDesign]
    limited_by: str
    chosen: str
    instead: Callable[[str], "SearchResult | None"]


class SearchProblem:
    """Evaluates control laws on all plants of a set of plants: largest gain within the bounds of a
    goal, and bandwidth with this gain.

    `numbers` are the logarithms of the law's parameters, as `structures` defines them.
    """

    def __init__(
        self, plants: PlantSet, members: list[Member], goal: Goal, ramp: Ramp | None,
        density: float = 1.0,
    ) -> None:  # fmt: skip
        self.bounds = goal.bounds()
        self.grid = Grid(plants, members, goal.timings, density)
        self.ramp = ramp

    def law(self, numbers: Samples) -> tuple[Response, float] | None:
        """Returns (frequency response, gain at high frequency) of a control law with the gain 1.
        Returns None if the firmware cannot store the coefficients of the law."""
        bank = structures.bank(numbers, 1.0)
        if not structures.is_legal(bank.sections):
            return None
        law = structures.response(numbers, self.grid)
        return law, max(bank.hf_gain(), _noise(law, numbers, self.grid))

    def evaluate(self, numbers: Samples) -> tuple[float, float]:
        """Returns (bandwidth in Hz, largest gain) of a control law. The function reduces the
        bandwidth if the force does not follow the ramp."""
        found = self.law(numbers)
        if found is None:
            return 0.0, 0.0
        law, steep = found
        gain = self.grid.largest_gain(law, steep, self.bounds).gain
        first, falls = self.grid.bandwidths(law, GAIN_SHARE * gain)
        value = float(first.min())
        if len(numbers):
            value = min(value, float(falls.min()))
            if self.ramp:
                excess = self.ramp.excess(gain * structures.response(numbers, self.ramp))
                value /= 1 + 30 * excess
        return value, gain

    def follow_ramp(self, plants: PlantSet, goal: Goal, bandwidth_Hz: float) -> None:
        """Makes evaluate() reduce the bandwidth of control laws with which the force of the nominal
        plants does not follow a ramp of the set-point.

        The rise time of the ramp follows from the bandwidth of a PI law.
        """
        rise_s = goal.ramp_s or max(RAMP_MIN_S, RAMP_PERIODS / bandwidth_Hz)
        nominal = plants.nominal()
        loops = [
            loop
            for member, loop in zip(self.grid.members, self.grid.open_loops, strict=True)
            if member in nominal
        ]
        delays = [DELAYS[timing] for timing in goal.timings]
        self.ramp = Ramp(loops or self.grid.open_loops[:1], delays, rise_s)

    def polished(
        self, numbers: Samples, limits: Samples, evaluations: int, tolerance: float
    ) -> Samples:
        """Returns the numbers of the best law that a simplex search finds. The search starts at
        `numbers` and stays within `limits`, an array of (lowest, highest)."""
        low, high = limits.T
        found = optimize.minimize(
            self.cost(limits), numbers, method="Nelder-Mead",
            options={"maxfev": evaluations, "xatol": tolerance, "fatol": tolerance},
        )  # fmt: skip
        best: Samples = np.clip(found.x, low, high)
        return best

    def cost(self, limits: Samples) -> Callable[[Samples], float]:
        """Returns the negative bandwidth of the law with these numbers, after a limitation of the
        numbers to the permitted range."""
        low, high = limits.T
        return lambda numbers: -self.evaluate(np.clip(numbers, low, high))[0]


def _noise(law: Response, numbers: Samples, grid: Grid) -> float:
    """Returns the largest magnitude of a control law over the frequency, computed without integral
    action."""
    if not len(numbers):
        return 1.0
    return float(np.abs(law / (1 + math.exp(numbers[0]) * grid.integral)).max())


def _starts(
    name: str, limits: Samples, plants_zeros: list[float], best: Samples, rng: np.random.Generator,
    count: int,
) -> Samples:  # fmt: skip
    """Returns the first population of a search.

    It contains laws with zeros at antiresonances of the plant and a pole above each zero, the law
    of the next smaller structure with a section without effect, and laws with random numbers.
    """
    low, high = limits.T
    rows = low + (high - low) * rng.random((count, len(limits)))
    sections = structures.STRUCTURES[name]
    row = 0
    for zero in plants_zeros:
        for pole in (1.3, 2.5):
            if sections and row < count // 3:
                rows[row, 1:5] = np.log([zero, 0.07, zero * pole, 0.6])
                rows[row, 0] = best[0]
                row += 1
    if sections and len(best) == 1 + 4 * (sections - 1):
        for extra in range(count // 4):
            rows[row + extra, : len(best)] = best
            rows[row + extra, len(best) + 2 :] = rows[row + extra, len(best) : len(best) + 2]
    return np.asarray(np.clip(rows, low, high))


def _search(
    problem: SearchProblem, thin: SearchProblem, name: str, fS: float, zeros: list[float],
    best: Samples,
) -> Samples:  # fmt: skip
    """Returns the numbers of the best law of a structure.

    `thin`: the same problem on a grid with fewer points. `fS`: bandwidth of a PI law in Hz.
    `zeros`: antiresonances in Hz. `best`: numbers of the best law of the next smaller structure.
    """
    rng = np.random.default_rng(SEED)
    results = []
    for begin in LOWEST_FACTORS[: RESTARTS[structures.STRUCTURES[name] or 0]]:
        limits = structures.bounds(name, begin * fS)
        found = optimize.differential_evolution(
            thin.cost(limits),
            limits,
            init=_starts(name, limits, zeros, best, rng, max(8 * len(limits), 12)),
            seed=int(rng.integers(2**31)),
            maxiter=GENERATIONS,
            tol=1e-4,
            polish=False,
        )
        results.append(_polished(problem, found.x, limits))
    return max(results, key=lambda numbers: problem.evaluate(numbers)[0])


def _polished(problem: SearchProblem, numbers: Samples, limits: Samples) -> Samples:
    # A second simplex search, because the first simplex may have collapsed before the optimum.
    for _ in range(2):
        numbers = problem.polished(numbers, limits, 80 * len(limits), 1e-4)
    return numbers


def first_members(plants: PlantSet) -> list[Member]:
    """Returns the plants with which a search begins: the nominal plants and the corner plants, or a
    random sample of the corner plants if there are many."""
    corners, most = plants.corners(), CORNERS_MAX * len(plants.modes)
    if len(corners) > most:
        corners = random.Random(SEED).sample(corners, most)
    return plants.nominal() + corners


def _random(plants: PlantSet, count: int, seed: int) -> list[Member]:
    return plants.random(count, seed) if plants.ranges else []


def search(
    plants: PlantSet, goal: Goal | None = None, progress: Callable[[str], None] | None = None
) -> SearchResult:
    """Returns the best control law for a set of plants. Raises InputError if no law keeps the
    margins. The function calls progress(text) at every step."""
    goal = goal or Goal()
    say = progress or (lambda text: None)
    _check(goal)
    members = first_members(plants)
    problem, thin = (SearchProblem(plants, members, goal, None, density) for density in (1.0, THIN))
    check_plants(problem)
    zeros = antiresonances(problem.grid)
    own = _search(problem, thin, "PI", 1.0, zeros, np.zeros(0))
    best = {"P": np.zeros(0), "PI": own}
    fS = problem.evaluate(own)[0]
    if not fS:
        raise _no_gain()
    limits = {
        name: structures.bounds(name, min(LOWEST_FACTORS) * fS) for name in structures.STRUCTURES
    }
    problem.follow_ramp(plants, goal, fS)
    ramp = thin.ramp = problem.ramp
    before = own
    richer = list(structures.STRUCTURES)[1:]
    for done, name in enumerate(richer):
        say(f"{name}: searching, {done}/{len(richer)} structures")
        best[name] = before = _search(problem, thin, name, fS, zeros, before)
        say(f"{name}: {problem.evaluate(before)[0]:.2f} Hz")
    say("random members")
    others = plants.nominal() + plants.corners() + _random(plants, PROBE_RANDOM, SEED)
    probe = Grid(plants, others, goal.timings)
    for _ in range(ROUNDS_MAX):
        found = {name: _violator(problem, probe, numbers) for name, numbers in best.items()}
        joined = {m.label(): m for m in found.values() if m is not None and m not in members}
        if not joined:
            break
        members = members + list(joined.values())
        problem = SearchProblem(plants, members, goal, ramp)
        for name in [n for n, m in found.items() if m is not None and len(best[n])]:
            best[name] = _polished(problem, best[name], limits[name])
    return _result(plants, goal, problem, best, say)


def antiresonances(grid: Grid) -> list[float]:
    """Returns the frequencies in Hz of the lightly damped zeros of the plants of a grid, at most
    eight. Of nearly equal frequencies, the result contains only one."""
    found: list[float] = []
    for loop in grid.open_loops:
        zeros = loop.open.zeros_s()
        zeros = zeros[np.isfinite(zeros) & (zeros.imag > 0)]
        light = zeros[np.abs(zeros.real) < 0.2 * np.abs(zeros)]
        hz = light.imag / (2 * math.pi)
        for value in hz[(hz > 2) & (hz < 250)]:
            if all(abs(math.log(value / old)) > 0.1 for old in found):
                found.append(float(value))
    return sorted(found)[:8]


def _violator(problem: SearchProblem, probe: Grid, numbers: Samples) -> Member | None:
    """Returns the plant of a grid that limits the gain of a law most, or None if the law keeps the
    margins on all plants of the grid."""
    gain = problem.evaluate(numbers)[1]
    law = structures.response(numbers, probe)
    limit = probe.largest_gain(law, 1e-9, problem.bounds)
    return probe.members[limit.place.member] if limit.place and limit.gain < 0.999 * gain else None


def _check(goal: Goal) -> None:
    for timing in goal.timings:
        if timing not in DELAYS:
            raise InputError(
                "timing: expected zoh or zoh+1, because a bank is designed for a delay of 0 or 1 "
                f"tick, got {timing}"
            )
    for name in ("ms", "ms_late", "gain_margin"):
        if not getattr(goal, name) > 1:
            raise ParameterError(name, "expected a number above 1")


def check_plants(problem: SearchProblem) -> None:
    """Raises InputError if a plant of the set of plants is unstable at every gain."""
    for loop, member in zip(problem.grid.open_loops, problem.grid.members, strict=True):
        if loop.limit().gain == 0:
            raise InputError(
                f"{loop.model}: {member.label()}: expected a plant that is stable with a small "
                f"gain, but this plant is {loop.limit().reason}; add damping, or give smaller "
                "tolerances"
            )


def _result(
    plants: PlantSet, goal: Goal, problem: SearchProblem, best: dict[str, Samples],
    say: Callable[[str], None],
) -> SearchResult:  # fmt: skip
    """Returns the result of a search. `best` is {structure: numbers of the best law with this
    structure}."""
    bounds = problem.bounds
    joined = {m.label(): m for m in problem.grid.members + plants.corners()}
    members = list(joined.values()) + _random(plants, RANDOM, SEED + 1)
    grids = blocks(plants, members, goal.timings)
    rows: list[StructureDesign] = []
    steep: dict[str, float] = {}

    def largest_gain(grid: Grid, bank: Bank, name: str) -> float:
        return grid.largest_gain(bank.response(grid.z), steep[name], bounds).gain

    for name, numbers in best.items():
        law = problem.law(numbers)
        if law is None:
            continue
        unit, steep[name] = structures.bank(numbers, 1.0).quantised(), law[1]
        gain = min(largest_gain(grid, unit, name) for grid in grids)
        bank = certificate.lowered(unit, gain)
        if bank.force_gain:
            worst = certificate.on_grids(grids, bank)
            rows.append(StructureDesign(name, bank_figures(bank), worst))
            say(f"{name}: {worst.bandwidth_Hz:.2f} Hz over {len(members)} members")
    chosen = None
    for row in rows:
        if chosen is None or _is_worth_it(row, chosen):
            chosen = row

    def taken(name: str) -> SearchResult | None:
        # The exact gain is computed only for the chosen structure.
        # Other structures keep the gain from the grid of frequencies.
        at = next(i for i, row in enumerate(rows) if row.name == name)
        bank, worst = certificate.exact(plants, grids, rows[at].bank.bank, goal)
        if not worst or not worst.fS_Hz:
            return None
        rows[at] = StructureDesign(name, bank_figures(bank), worst)
        tightest = min(grids, key=lambda grid: largest_gain(grid, bank, name))
        return SearchResult(
            bank,
            worst,
            _p_of(rows),
            rows,
            certificate.sentence(tightest, bank, steep[name], bounds, goal.hf_cure()),
            name,
            taken,
        )

    found = taken(chosen.name) if chosen else None
    if found is None:
        raise _no_gain()
    return found


def _p_of(rows: list[StructureDesign]) -> P:
    """Returns the bandwidth and margins of the P law from the rows of all structures."""
    for row in rows:
        if row.name == "P" and row.worst:
            return certificate.p_figures(row.worst, row.bank.bank)
    return certificate.NoPFigures()


def _no_gain() -> ParameterError:
    return ParameterError(
        "ms", "expected margins that a force law can keep for the whole set of plants, but no "
        f"gain of {GAIN_STEP:.4f} DAC codes per 8-bit count or more keeps these margins; give "
        "smaller tolerances in `over` or smaller margins",
    )  # fmt: skip


def _is_worth_it(row: StructureDesign, smaller: StructureDesign) -> bool:
    """Returns True if the larger structure of the law is worth its additional parameters. The
    reason is either 10 % more bandwidth, or a large static error if the smaller structure is P."""
    before = smaller.worst
    return row.bandwidth_Hz >= LARGER_STRUCTURE_MIN * smaller.bandwidth_Hz or (
        smaller.name == "P" and before is not None and before.static_error > STATIC_ERROR_MAX
    )
