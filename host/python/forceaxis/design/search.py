"""Searches the force law with the largest bandwidth over a set of plants at given margins.

The search varies the zeros, poles and integral rate of each structure of the law. It maximises the
frequency up to which |S| of the worst plant stays below -3 dB. It uses differential evolution on a
thin grid of frequencies, then a simplex on the full grid. The gain is the largest one that keeps
the margins (`grid`). The corners of a set are not always its worst plants. The search therefore
checks random plants, and adds those on which the law violates the margins.
"""

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.design import certificate, structures
from forceaxis.design.banks import BankFigures, bank_figures
from forceaxis.design.certificate import P, Row, WorstFigures
from forceaxis.design.grid import (
    LOWEST_HZ,
    POLE_ROUNDING_PER_S,
    THIN,
    Goal,
    Grid,
    Response,
    Samples,
)
from forceaxis.errors import ParameterError
from forceaxis.linear.bank import GAIN_STEP, Bank
from forceaxis.linear.plant_set import Member, PlantSet
from forceaxis.linear.precise import DELAYS, Responses
from forceaxis.linear.stability import Loop

# Smallest ratio of bandwidths at which the search selects the larger structure of the law.
LARGER_STRUCTURE_MIN = 1.1
# The result explains why a law has less than this share of the bandwidth of a smaller structure.
SMALLER_SHARE = 0.99
# RAMP_COST_MIN: ratio of the bandwidths without and with the ramp of the set-point.
# Above this ratio, the result states the loss of bandwidth by the ramp.
RAMP_COST_MIN = 1.1
# Number of random plants with which the designed law is checked before its certificate is computed.
RANDOM = 250
SLOWEST_HZ = 1.5 * LOWEST_HZ  # smallest bandwidth of a law on the plants of a grid
# ratio of two bandwidths on a grid, below which the first bandwidth is surely smaller
GRID_SLOWER = 0.99
PROBE_RANDOM = 60  # number of random plants in each round of the search
ROUNDS_MAX = 4  # largest number of rounds in which plants are added to the search
# Largest number of corner plants of the set of plants at the start of the search.
CORNERS_MAX = 8
SEED = 1988
# Rise time of the set-point ramp, as a multiple of 1 / (bandwidth of a PI law).
RAMP_PERIODS = 0.2
# Settings of the differential evolution: strategy, share of mutated numbers, generations.
# Decision 48 (docs/decisions) compares other settings of the differential evolution.
STRATEGY, RECOMBINATION, GENERATIONS = "randtobest1bin", 0.9, 100
POPULATION_PER_NUMBER = 6
# Each restart has FIRST_GENERATIONS generations. The KEPT restarts with the best laws then go on.
FIRST_GENERATIONS, KEPT = 60, 2
# An evolution ends when all bandwidths of its population differ by less than this share.
# A simplex search then finds the maximum of the bandwidth.
SPREAD = 1e-3
# Number of restarts of the search for a law with no, with one and with two second-order sections.
RESTARTS = (1, 2, 3)
# Lowest frequency of zeros and poles for each restart, relative to the bandwidth of a PI law.
# The best result of all restarts of a search is used.
# The ramp of the set-point excludes laws that oscillate after a first contact.
LOWEST_FACTORS = (1.5, 0.5, 1.0)
# Damping ratio above which a pole is stable without an exact analysis.
SURELY_STABLE = 1e-6
# A loop is stable at the smallest gain of the firmware if its poles decay faster than this.
SLOWEST_DECAY_PER_S = 1e-6
# Smallest ratio of the frequencies of other poles to LOWEST_HZ, at which an integral alone acts.
SLOW_FACTOR = 3.0
# Ratio of a plant's gain limit to the lowest gain limit, below which the plant gets a full grid.
CLOSE_TO_WORST = 1.05
CLOSE_MAX = 16  # for each law, largest number of random plants that are evaluated on a full grid
# Number of the worst random plants that get a full grid, for each bandwidth, margin and delay.
WORST_EACH = 2
# Largest static error of a law without integral action, as a share of the force set-point.
STATIC_ERROR_MAX = 0.01


@dataclass(frozen=True)
class StructureDesign:
    """The best control law of one structure, with a gain that keeps the margins. `worst` contains
    the worst bandwidth and margins over the set of plants; None if no gain keeps the margins."""

    name: str
    bank: BankFigures
    worst: WorstFigures | None

    @property
    def bandwidth_Hz(self) -> float:
        """Returns the bandwidth fS over the set of plants in Hz, or 0 if the law has
        no bandwidth."""
        return self.worst.bandwidth_Hz if self.worst else 0.0

    @property
    def leaves_error(self) -> bool:
        """True if the law leaves a static error above STATIC_ERROR_MAX."""
        return self.worst is not None and self.worst.static_error > STATIC_ERROR_MAX

    @property
    def row(self) -> Row:
        """Returns fS in Hz, Ms and gain margin for a table. The values are None if no gain keeps
        the margins."""
        w = self.worst
        return (w.fS_Hz, w.Ms, w.gain_margin) if w else (None, None, None)


@dataclass(frozen=True)
class SearchResult:
    """Result of a search: the filter bank as the firmware stores it, and its worst bandwidth and
    margins over the set of plants.

    p: bandwidth and margins of the P law that keeps the same margins. structures: results for each
    structure of the law, from the smallest to the largest. limited_by: sentence about the bound
    that limits the bandwidth. chosen: name of the chosen structure. instead(name): the result with
    another structure, or None if no gain keeps the margins with this structure.
    """

    bank: Bank
    worst: WorstFigures
    p: P
    structures: list[StructureDesign]
    limited_by: str
    chosen: str
    instead: Callable[[str], "SearchResult | None"]


class SearchProblem:
    """Evaluates control laws on all plants of a set of plants: the largest gain within the bounds
    of a goal, and the bandwidth with this gain. `ramp`: ramp of the set-point that the force has to
    follow, or None.

    `numbers` are the logarithms of the law's parameters, as `structures` defines them.
    """

    def __init__(
        self, plants: PlantSet, members: list[Member], goal: Goal, density: float = 1.0,
        threads: int = 1,
    ) -> None:  # fmt: skip
        self.bounds = goal.bounds()
        self.grid = Grid(plants, members, goal.timings, density, threads)
        self.ramp: _core.LawRamp | None = None
        self.ramp_s = 0.0

    def evaluate(self, numbers: Samples) -> tuple[float, float]:
        """Returns (bandwidth in Hz, largest gain) of a control law. The bandwidth is reduced if the
        force does not follow the ramp."""
        hz, gain = self.evaluate_all(numbers[None])[0].tolist()
        return hz, gain

    def evaluate_all(self, rows: Samples, floors_Hz: Sequence[float] = ()) -> Samples:
        """Returns (bandwidth in Hz, largest gain) of each control law, as an array (laws, 2).
        `rows`: array with the numbers of one law in each row. floors_Hz: as in Grid.evaluate."""
        ramp = self.ramp if rows.shape[1] else None
        return self.grid.evaluate(rows, self.bounds, ramp, floors_Hz)

    def best_of(self, rows: Samples) -> Samples:
        """Returns the numbers of the law with the largest bandwidth. `rows`: one law in each
        row."""
        best: Samples = rows[int(np.argmax(self.evaluate_all(rows)[:, 0]))]
        return best

    def hf_gain(self, bank: Bank) -> float:
        """Returns the gain at high frequency of a filter bank with the gain 1. This is the gain as
        the firmware computes it, or, if larger, the largest magnitude of the bank without its
        integral."""
        return max(replace(bank, force_gain=1.0).hf_gain(), self.grid.noise_gain(bank))

    def follow_ramp(self, plants: PlantSet, goal: Goal, bandwidth_Hz: float) -> None:
        """Makes evaluate() reduce the bandwidth of control laws with which the force of the nominal
        plants does not follow a ramp of the set-point.

        The rise time of the ramp follows from the bandwidth of a PI law.
        """
        self.ramp_s = goal.ramp_s or max(goal.ramp_min_s, RAMP_PERIODS / bandwidth_Hz)
        self.ramp = self.grid.ramp(plants.nominal(), self.ramp_s)

    def free_bandwidth(self, numbers: Samples) -> float:
        """Returns the bandwidth of a law in Hz, even if the force does not follow the ramp."""
        kept, self.ramp = self.ramp, None
        try:
            return self.evaluate(numbers)[0]
        finally:
            self.ramp = kept

    def without_ramp(self, numbers: Samples, limits: Samples) -> Samples:
        """Returns the numbers of the best law that a simplex search finds without the ramp. Its
        arguments have the same meaning as the arguments of polished()."""
        kept, self.ramp = self.ramp, None
        try:
            return _polished(self, np.clip(numbers, *limits.T), limits)
        finally:
            self.ramp = kept

    def polished(
        self, numbers: Samples, limits: Samples, evaluations: int, tolerance: float
    ) -> Samples:
        """Returns the numbers of the best law that a simplex search finds. The search starts at
        `numbers`, and stays within `limits`, an array with rows (lowest, highest)."""
        low, high = limits.T
        found = optimize.minimize(
            self.cost(limits), numbers, method="Nelder-Mead",
            options={"maxfev": evaluations, "xatol": tolerance, "fatol": tolerance},
        )  # fmt: skip
        best: Samples = np.clip(found.x, low, high)
        return best

    def cost(self, limits: Samples) -> Callable[[Samples], float]:
        """Returns a function that a simplex search minimises. Its result is the negative bandwidth
        of the law, whose numbers are first limited to the permitted range."""
        low, high = limits.T
        return lambda numbers: -self.evaluate(np.clip(numbers, low, high))[0]


def _starts(
    name: str, limits: Samples, plants_zeros: list[float], best: Samples, count: int
) -> Samples:
    """Returns laws for the first population of `count` laws, at most two thirds of this number.

    Some of these laws have a zero at an antiresonance of the plant and a pole above this zero. The
    others are the law of the next smaller structure with an additional section without effect.
    """
    sections = structures.STRUCTURES[name]
    if not sections:
        return np.zeros((0, len(limits)))
    rng = np.random.default_rng(SEED)
    low, high = limits.T
    shapes = [(zero, pole) for zero in plants_zeros for pole in (1.3, 2.5)][: count // 3]
    rows = rng.uniform(low, high, (len(shapes) + count // 4, len(limits)))
    for row, (zero, pole) in zip(rows, shapes, strict=False):
        row[1:5] = structures.logarithms([zero, 0.07, zero * pole, 0.6])
        row[0] = best[0]
    if len(best) == 1 + 4 * (sections - 1):
        rest = rows[len(shapes) :]
        rest[:, : len(best)] = best
        rest[:, len(best) + 2 :] = rest[:, len(best) : len(best) + 2]
    return rows


def _search(
    problem: SearchProblem, thin: SearchProblem, name: str, fS: float, zeros: list[float],
    best: Samples,
) -> Samples:  # fmt: skip
    """Returns the numbers of the best law of one structure.

    `thin`: the same problem on a grid with fewer points. `fS`: bandwidth of a PI law in Hz.
    `zeros`: antiresonances in Hz. `best`: numbers of the best law of the next smaller structure.
    """
    restarts = []
    for i, begin in enumerate(LOWEST_FACTORS[: RESTARTS[structures.STRUCTURES[name] or 0]]):
        limits = structures.bounds(name, begin * fS)
        count = max(POPULATION_PER_NUMBER * len(limits), 12)
        starts = _starts(name, limits, zeros, best, count)
        laws = evolved(thin, limits, starts, count, FIRST_GENERATIONS, SEED + i)
        restarts.append((problem.evaluate(problem.best_of(laws))[0], laws, limits))
    restarts.sort(key=lambda restart: -restart[0])
    kept = []
    for _, laws, limits in restarts[:KEPT]:
        best = problem.best_of(evolved(thin, limits, laws, len(laws), GENERATIONS))
        kept.append((problem.evaluate(best)[0], best, limits))
    _, best, limits = max(kept, key=lambda restart: restart[0])
    return _polished(problem, best, limits)


def evolved(
    problem: SearchProblem, limits: Samples, starts: Samples, count: int, generations: int,
    seed: int = SEED,
) -> Samples:  # fmt: skip
    """Returns the laws of the last generation of a differential evolution, one law in each row. The
    best law comes first.

    The first generation has `count` laws: the rows of `starts`, and random laws within `limits`, an
    array with rows (lowest, highest). A peak of |S| may lie between two points of a thin grid. The
    best law of a thin grid may therefore be bad on a full grid. Other laws of the last generation
    are then better.
    """
    low, high = limits.T
    rng = np.random.default_rng(seed)
    first = rng.uniform(low, high, (count, len(limits)))
    first[: len(starts)] = np.clip(starts[:count], low, high)
    # A law with less bandwidth is never accepted, so its evaluation may end early.
    floors_Hz: list[float] = []

    def cost(columns: Samples) -> Samples:
        floors = floors_Hz if len(floors_Hz) == columns.shape[1] else ()
        return -problem.evaluate_all(columns.T, floors)[:, 0]

    def remember(intermediate_result: optimize.OptimizeResult) -> None:
        floors_Hz[:] = (-intermediate_result.population_energies).tolist()

    found = optimize.differential_evolution(
        cost,
        limits,
        init=first,
        rng=rng,
        maxiter=generations,
        tol=SPREAD,
        polish=False,
        strategy=STRATEGY,
        recombination=RECOMBINATION,
        updating="deferred",
        vectorized=True,
        callback=remember,
    )
    laws: Samples = found.population[np.argsort(found.population_energies, kind="stable")]
    return laws


def _polished(problem: SearchProblem, numbers: Samples, limits: Samples) -> Samples:
    return problem.polished(numbers, limits, 80 * len(limits), 1e-4)


def first_members(plants: PlantSet) -> list[Member]:
    """Returns the plants with which a search begins: the nominal plants and the corner plants. If
    there are many corner plants, they are a random sample."""
    corners, most = plants.corners(), CORNERS_MAX * len(plants.modes)
    if len(corners) > most:
        corners = random.Random(SEED).sample(corners, most)
    return plants.nominal() + corners


def _random(plants: PlantSet, count: int, seed: int) -> list[Member]:
    return plants.random(count, seed) if plants.ranges else []


def search(
    plants: PlantSet,
    goal: Goal | None = None,
    progress: Callable[[str], None] | None = None,
    threads: int = 1,
) -> SearchResult:
    """Returns the best control law for a set of plants. Raises InputError if no law keeps the
    margins. The function calls progress(text) at every step. The result does not depend on the
    number of threads."""
    goal = goal or Goal()
    say = progress or (lambda text: None)
    _check(goal)
    members = first_members(plants)
    problem, thin = (
        SearchProblem(plants, members, goal, density, threads) for density in (1.0, THIN)
    )
    check_plants(plants, problem.grid)
    zeros = antiresonances(problem.grid)
    own = _search(problem, thin, "PI", 1.0, zeros, np.zeros(0))
    best = {"P": np.zeros(0), "PI": own}
    fS = problem.evaluate(own)[0] or _attenuated(problem, thin, zeros, own)
    if not fS:
        raise _no_gain()
    limits = {
        name: structures.bounds(name, min(LOWEST_FACTORS) * fS) for name in structures.STRUCTURES
    }
    problem.follow_ramp(plants, goal, fS)
    thin.ramp, ramp_s = problem.ramp, problem.ramp_s
    before = own
    richer = list(structures.STRUCTURES)[1:]
    for done, name in enumerate(richer):
        say(f"{name}: searching, {done}/{len(richer)} structures")
        best[name] = before = _search(problem, thin, name, fS, zeros, before)
        say(f"{name}: {problem.evaluate(before)[0]:.2f} Hz")
    say("random members")
    others = plants.nominal() + plants.corners() + _random(plants, PROBE_RANDOM, SEED)
    probe = SearchProblem(plants, others, goal, 1.0, threads)
    for _ in range(ROUNDS_MAX):
        found = {name: _violator(problem, probe, numbers) for name, numbers in best.items()}
        joined = {m.label(): m for m in found.values() if m is not None and m not in members}
        if not joined:
            break
        members = members + list(joined.values())
        problem = SearchProblem(plants, members, goal, 1.0, threads)
        problem.ramp, problem.ramp_s = thin.ramp, ramp_s
        for name in [n for n, m in found.items() if m is not None and len(best[n])]:
            best[name] = _polished(problem, best[name], limits[name])
    return _result(plants, goal, problem, best, say, threads)


def _attenuated(
    problem: SearchProblem, thin: SearchProblem, zeros: list[float], own: Samples
) -> float:
    """Returns the bandwidth in Hz of the best law with one section, or 0. A section can attenuate
    a lightly damped resonance that leaves a PI law no bandwidth. `own`: numbers of a PI law."""
    name = next(name for name, sections in structures.STRUCTURES.items() if sections)
    return problem.evaluate(_search(problem, thin, name, LOWEST_HZ, zeros, own))[0]


def antiresonances(grid: Grid) -> list[float]:
    """Returns the frequencies in Hz of the lightly damped zeros of the plants of a grid, at most
    eight. Of several nearly equal frequencies, only one is returned."""
    found: list[float] = []
    for plant in range(len(grid.members)):
        zeros = grid.core.zeros(plant)
        zeros = zeros[np.isfinite(zeros) & (zeros.imag > 0)]
        light = zeros[np.abs(zeros.real) < 0.2 * np.abs(zeros)]
        hz = light.imag / (2 * math.pi)
        for value in hz[(hz > 2) & (hz < 250)]:
            if all(abs(math.log(value / old)) > 0.1 for old in found):
                found.append(float(value))
    return sorted(found)[:8]


def _violator(problem: SearchProblem, probe: SearchProblem, numbers: Samples) -> Member | None:
    """Returns the plant of `probe` that limits the gain of a law most, or None if the law keeps the
    margins on all plants of `probe`."""
    gain = problem.evaluate(numbers)[1]
    limit = probe.grid.largest_gain(structures.bank(numbers, 1.0), 1e-9, problem.bounds)
    if limit.place is None or limit.gain >= 0.999 * gain:
        return None
    return probe.grid.members[limit.place.member]


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


def check_plants(plants: PlantSet, grid: Grid) -> None:
    """Raises InputError if a plant of a grid is unstable at every gain."""
    for i, member in enumerate(grid.members):
        poles = grid.core.poles(i)
        doubtful = poles.real >= -SURELY_STABLE * np.abs(poles) - POLE_ROUNDING_PER_S
        if not np.any(doubtful) or _integrates(poles, doubtful, grid.core.response(i)):
            continue
        loop = plants.loop(member)
        if not is_stable_at_small_gain(loop):
            raise InputError(
                f"{loop.model}: {member.label()}: expected a plant whose force loop is stable "
                f"with a small gain, but this plant is {loop.limit().reason}; add damping to "
                "the model, or give smaller tolerances"
            )


def is_stable_at_small_gain(loop: Loop) -> bool:
    """Returns False if a force loop is stable at no gain. The limit of a loop with a slow sensor
    takes seconds, its poles at one gain do not."""
    gain = GAIN_STEP / loop.codes_per_gain if loop.codes_per_gain else 0.0
    return bool(gain and loop.decay(gain) > SLOWEST_DECAY_PER_S) or loop.limit().gain != 0


def _integrates(poles: Response, doubtful: NDArray[np.bool_], response: Response) -> bool:
    """Returns True if the only doubtful pole of a plant is an integral that reduces the force
    error. At a small gain, this pole alone moves, by the gain times -w Im L at a frequency w far
    below all other poles. The delay of the loop does not change this. `response`: response of the
    plant, which begins at LOWEST_HZ."""
    lowest = 2 * math.pi * LOWEST_HZ
    others = np.abs(poles[~doubtful])
    return (
        np.count_nonzero(doubtful) == 1
        and float(np.abs(poles[doubtful]).max()) <= POLE_ROUNDING_PER_S
        and float(others.min(initial=math.inf)) > SLOW_FACTOR * lowest
        and float(-response[0].imag) * lowest * GAIN_STEP > SLOWEST_DECAY_PER_S
    )


def _final_grid(
    plants: PlantSet, goal: Goal, problem: SearchProblem, laws: Sequence[tuple[Bank, float]],
    threads: int,
) -> tuple[Grid, int]:  # fmt: skip
    """Returns (full grid, number of all plants). The full grid contains the plants that may be the
    worst ones of a law.

    All plants are the corner plants, the plants of the search, and random plants. The random plants
    are evaluated on a thin grid first. The full grid gets those whose largest gain, bandwidth or
    margin is close to the worst one. `laws`: (filter bank, gain at high frequency) of each law.
    """
    others = _random(plants, max(RANDOM // len(plants.modes), 1), SEED + 1)
    close: dict[int, Member] = {}
    if others:
        thin = Grid(plants, others, goal.timings, THIN, threads)
        for bank, steep in laws:
            near = _close_to_worst(thin, problem, bank, steep)
            close |= {i: thin.members[i] for i in near}
    sure = {m.label(): m for m in problem.grid.members + plants.corners()}
    members = [*sure.values(), *close.values()]
    return Grid(plants, members, goal.timings, 1.0, threads), len(sure) + len(others)


def _close_to_worst(thin: Grid, problem: SearchProblem, bank: Bank, steep: float) -> set[int]:
    """Returns the indices of those plants of a grid that may be the worst ones with a filter bank
    at its largest gain. Such a plant has nearly the smallest largest gain, or the worst bandwidth
    or margin. `steep`: gain of the bank at high frequency if its gain is 1."""
    # The bound at high frequency is left out, because it would hide other bounds.
    gains = thin.gains(bank, steep, replace(problem.bounds, hf_gain=math.inf))
    near = np.flatnonzero(gains <= CLOSE_TO_WORST * gains.min())
    found = set(near[np.argsort(gains[near], kind="stable")][:CLOSE_MAX].tolist())
    own = problem.grid.largest_gain(bank, steep, problem.bounds).gain
    figures = thin.figures(replace(bank, force_gain=min(own, float(gains.min()))))
    for values, sign in zip(figures, (1, 1, -1, 1, 1), strict=True):
        for column in (sign * values).T:
            found |= set(np.argsort(column, kind="stable")[:WORST_EACH].tolist())
    return found


def _result(
    plants: PlantSet, goal: Goal, problem: SearchProblem, best: dict[str, Samples],
    say: Callable[[str], None], threads: int,
) -> SearchResult:  # fmt: skip
    """Returns the result of a search. `best`: {structure: numbers of the best law with this
    structure}. All laws of the result have the gain and coefficients that the firmware stores, and
    keep the margins on their worst plants."""
    units = {name: structures.bank(numbers, 1.0) for name, numbers in best.items()}
    units = {n: unit.quantised() for n, unit in units.items() if structures.is_legal(unit.sections)}
    laws = [(unit, problem.hf_gain(unit)) for unit in units.values()]
    grid, count = _final_grid(plants, goal, problem, laws, threads)
    responses = Responses(plants, goal.timings)

    def certified(name: str, unit: Bank, least_Hz: float) -> StructureDesign:
        gain = grid.largest_gain(unit, problem.hf_gain(unit), problem.bounds).gain
        bank = certificate.lowered(unit, gain)
        # The worst plants of the grid alone show whether the law is slower than another one.
        # The worst plants of the grid also show whether the law is too slow to be evaluated.
        if grid.figures(bank).fS_Hz.min() < max(GRID_SLOWER * least_Hz, SLOWEST_HZ):
            return StructureDesign(name, bank_figures(bank), None)
        accuracy: certificate.Accuracy = "quick" if unit.sections else "mean age"
        bank, worst = certificate.exact(responses, grid, bank, goal, accuracy, least_Hz=least_Hz)
        return StructureDesign(name, bank_figures(bank), worst)

    rows: list[StructureDesign] = []
    for name, unit in units.items():
        # A structure with sections has to have more bandwidth than each smaller one except P.
        least_Hz = _fastest([r for r in rows if r.name != "P"]) if unit.sections else 0.0
        row = certified(name, unit, least_Hz)
        if name == "PI" and row.bandwidth_Hz < SMALLER_SHARE * _fastest(rows):
            numbers = problem.without_ramp(best[name], structures.bounds(name, 1.0))
            other = certified(name, structures.bank(numbers, 1.0).quantised(), 0.0)
            row = max(row, other, key=lambda r: r.bandwidth_Hz)
        if not row.worst and not least_Hz:
            continue
        if structures.STRUCTURES[name] and row.bandwidth_Hz <= least_Hz:
            say(f"{name}: no more bandwidth than a smaller structure")
            continue
        rows.append(row)
        say(f"{name}: {row.bandwidth_Hz:.2f} Hz over {count} members")
    chosen = _chosen(rows, goal)

    def taken(name: str) -> SearchResult | None:
        at = next(i for i, row in enumerate(rows) if row.name == name)
        bank, worst = rows[at].bank.bank, rows[at].worst
        # With several codes in a period, the values of a law with sections are exact already.
        if responses.is_exact or not bank.sections:
            bank, worst = certificate.exact(responses, grid, bank, goal, first=1.0)
        if not worst or not worst.fS_Hz:
            return None
        rows[at] = StructureDesign(name, bank_figures(bank), worst)
        limits = certificate.sentence(
            grid, bank, problem.hf_gain(units[name]), problem.bounds, goal.hf_cure()
        )
        limits += _costs(problem, rows, rows[at], best[name])
        return SearchResult(bank, worst, _p_of(rows), rows, limits, name, taken)

    found = taken(chosen.name) if chosen else None
    if found is None:
        raise _no_gain(rows)
    return found


def _chosen(rows: Sequence[StructureDesign], goal: Goal) -> StructureDesign | None:
    """Returns the law of the smallest structure that no larger one is worth its parameters, among
    those whose static error the goal permits."""
    chosen = None
    for row in rows:
        if row.worst and row.worst.static_error > goal.static_error_max:
            continue
        if chosen is None or _is_worth_it(row, chosen):
            chosen = row
    return chosen


def _fastest(rows: Sequence[StructureDesign]) -> float:
    """Returns the largest bandwidth in Hz among several laws, or 0 without a law."""
    return max((row.bandwidth_Hz for row in rows), default=0.0)


def _costs(
    problem: SearchProblem, rows: Sequence[StructureDesign], row: StructureDesign, numbers: Samples
) -> str:
    """Returns sentences about properties that cost bandwidth: the static error of a P law, and the
    ramp of the set-point. `numbers`: numbers of the law without its gain."""
    text, p = "", rows[0]
    if p.name == "P" and p.worst and row.bandwidth_Hz < SMALLER_SHARE * p.bandwidth_Hz:
        error = p.worst.static_error
        left = (
            f"but leaves a static error of {100 * error:.2g} %"
            if error
            else "without a static error too"
        )
        text += f" P reaches {p.bandwidth_Hz:.3g} Hz, {left}."
    if not len(numbers) or problem.ramp is None:
        return text
    limits = structures.bounds(row.name, row.bandwidth_Hz * min(LOWEST_FACTORS))
    free = problem.without_ramp(numbers, limits)
    share = problem.free_bandwidth(free) / max(problem.free_bandwidth(numbers), LOWEST_HZ)
    if share >= RAMP_COST_MIN:
        text += (
            f" The set-point has to be followed as a ramp of {problem.ramp_s:.2g} s: without this, "
            f"{row.name} would reach {share * row.bandwidth_Hz:.3g} Hz; a longer ramp permits more."
        )
    return text


def _p_of(rows: list[StructureDesign]) -> P:
    """Returns the bandwidth and margins of the P law. `rows`: results of all structures."""
    for row in rows:
        if row.name == "P" and row.worst:
            return certificate.p_figures(row.worst, row.bank.bank)
    return certificate.NoPFigures()


def _no_gain(rows: Sequence[StructureDesign] = ()) -> ParameterError:
    """Returns the error of a search without a result. `rows`: laws that keep the margins, but leave
    too large a static error."""
    errors = [row.worst.static_error for row in rows if row.worst]
    if errors and min(errors) > 0:
        return ParameterError(
            "ms", "expected margins that a force law with integral action can keep for the whole "
            "set of plants, but only P keeps them, and it leaves a static error of "
            f"{100 * min(errors):.2g} %; give smaller tolerances in `over` or smaller margins",
        )  # fmt: skip
    return ParameterError(
        "ms", "expected margins that a force law can keep for the whole set of plants, but no "
        f"gain of {GAIN_STEP:.4f} DAC codes per 8-bit count or more keeps these margins with a "
        f"bandwidth of {SLOWEST_HZ:g} Hz or more; give smaller tolerances in `over` or smaller "
        "margins",
    )  # fmt: skip


def _is_worth_it(row: StructureDesign, smaller: StructureDesign) -> bool:
    """Returns True if a larger structure of the law is worth its additional parameters. The larger
    structure then has 10 % more bandwidth, or the smaller one is P with a large static error."""
    return row.bandwidth_Hz >= LARGER_STRUCTURE_MIN * smaller.bandwidth_Hz or (
        smaller.name == "P" and smaller.leaves_error
    )
