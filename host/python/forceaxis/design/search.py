"""The force law with the most bandwidth that a set of plants bears at stated margins.

For each structure the shape that lets the worst member's |S| stay below -3 dB longest is sought by
differential evolution on a thin grid and a simplex on that of the result; the gain follows from the
shape (`grid`). The corners of a set are not always its worst, so members drawn at random that the
law would break join the set.
"""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from forceaxis._core import InputError
from forceaxis.design import certificate, structures
from forceaxis.design.contact import Ramp
from forceaxis.design.grid import DELAYS, THIN, Bounds, Grid, blocks, hf_most
from forceaxis.linear.bank import GAIN_STEP, Bank

PAYS = 1.1  # a larger structure is taken for this much more bandwidth
RANDOM = 1000  # choices of values that the result is checked on
PROBE = 60  # of them in the rounds of the search
ROUNDS = 4
CORNERS_MAX = 8  # of values, in the set that a search starts with; others join as they break a law
SEED = 1988
RAMP = 0.2  # of the period of a PI law's bandwidth
RAMP_MIN_S = 0.1
# The bandwidth is judged at this share of the gain, so that it does not hang on a touch of -3 dB.
SAFE = 0.97
GENERATIONS = 90  # half as many often end in a lesser optimum, more restarts or not
RESTARTS = (1, 2, 2)  # of the search, with no, one, two sections
# Where zeros and poles may begin, in bandwidths of a PI law: each restart has its own, and what
# reaches furthest is taken. Whether they ring when contact is made is judged by the ramp.
BEGINS = (1.5, 0.5)
STATIC_ERROR_MAX = 0.01  # of the set-point, that a law without an integral may leave
# Codes per 8-bit count: the reading's noise, in N, does not shrink with the ADC's code.
HF_DEFAULT = 80.0
HF_SHARE = 0.99  # of a bound, for the rounding of the coefficients


@dataclass(frozen=True)
class Goal:
    """ms, ms_late: peak of |S| without and with a tick of delay; mt: peak of |T|, None: free;
    gain_margin: factor; phase_margin_deg: None: as ms gives; adc_bits: of the reading; hf_gain: DAC
    codes per 8-bit count at most, None: chosen; timings: of loops.TIMINGS; ramp_s: the set-point's
    rise in which the force has to follow, None: chosen."""

    ms: float = 2.0
    ms_late: float = 2.2
    mt: float | None = None
    gain_margin: float = 2.3
    phase_margin_deg: float | None = None
    adc_bits: int = 8
    hf_gain: float | None = None
    timings: tuple = ("zoh", "zoh+1")
    ramp_s: float | None = None

    def ms_of(self, timing):
        """The peak of |S| that a timing of loops.TIMINGS may have."""
        return self.ms if timing == "zoh" else self.ms_late

    def bounds(self):
        """The same for a Grid."""
        most = hf_most(self.adc_bits)
        return Bounds(
            tuple(self.ms_of(timing) for timing in self.timings),
            self.mt,
            self.gain_margin,
            self.phase_margin_deg,
            HF_SHARE * min(most, self.hf_gain or max(HF_DEFAULT, hf_most(8))),
        )

    def hf_cure(self):
        """What would widen the bound of the gain at high frequency."""
        if self.bounds().hf_gain >= HF_SHARE * hf_most(self.adc_bits):
            return "an ADC of more bits would let it rise"
        if self.hf_gain:
            return "a higher bound, which a reading with less noise permits, would let it rise"
        return "`design --hf-gain` lets it rise where the reading is quiet"


@dataclass(frozen=True)
class Found:
    """bank: quantised; worst: fS_Hz, fT_Hz, Ms, Ms_late, gain_margin, phase_margin_deg, member;
    p: the same for P, with force_gain; structures: [{name, bank, worst}] in order of size;
    limited_by: one sentence; chosen: a structure's name; instead(name): the Found with another one
    chosen."""

    bank: Bank
    worst: dict
    p: dict
    structures: list
    limited_by: str
    chosen: str
    instead: Callable


class Problem:
    """One set of members, and how good a law is for it."""

    def __init__(self, plants, members, goal, ramp, density=1.0):
        self.bounds = goal.bounds()
        self.grid = Grid(plants, members, goal.timings, density)
        self.ramp = ramp

    def law(self, numbers):
        """(law, its HF gain) for the gain 1, or None where no firmware could hold it."""
        bank = structures.bank(numbers, 1.0)
        if not structures.is_legal(bank.sections):
            return None
        law = structures.response(numbers, self.grid)
        return law, max(bank.hf_gain(), _noise(law, numbers, self.grid))

    def judge(self, numbers):
        """(bandwidth in Hz less what the bounds take, gain)."""
        found = self.law(numbers)
        if found is None:
            return 0.0, 0.0
        law, steep = found
        gain = self.grid.largest_gain(law, steep, self.bounds)[0]
        first, falls = self.grid.bandwidths(law, SAFE * gain)
        value = float(first.min())
        if len(numbers):
            value = min(value, float(falls.min()))
            if self.ramp:
                excess = self.ramp.excess(gain * structures.response(numbers, self.ramp))
                value /= 1 + 30 * excess
        return value, gain


def _noise(law, numbers, grid):
    """The law's largest gain, its integral aside."""
    if not len(numbers):
        return 1.0
    return float(np.abs(law / (1 + math.exp(numbers[0]) * grid.integral)).max())


def _starts(name, limits, plants_zeros, best, rng, count):
    """The first population: zeros on the plant's antiresonances with a pole above, the smaller
    structure's result with a section that does nothing, and the whole space."""
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
    return np.clip(rows, low, high)


def _cost(problem, low, high):
    return lambda numbers: -problem.judge(np.clip(numbers, low, high))[0]


def _search(problem, thin, name, fS, zeros, best, seed):
    """The numbers of a structure's best law of a Problem, searched for on its thin grid; fS: the
    bandwidth of a PI law, Hz."""
    rng = np.random.default_rng(seed)
    results = []
    for begin in BEGINS[: RESTARTS[structures.STRUCTURES[name]]]:
        limits = structures.bounds(name, begin * fS)
        low, high = limits.T
        cost, rough = _cost(problem, low, high), _cost(thin, low, high)
        found = optimize.differential_evolution(
            rough,
            limits,
            init=_starts(name, limits, zeros, best, rng, max(8 * len(limits), 12)),
            seed=int(rng.integers(2**31)),
            maxiter=GENERATIONS,
            tol=1e-4,
            polish=False,
        )
        results.append(_polished(cost, found.x, low, high))
    return max(results, key=lambda numbers: problem.judge(numbers)[0])


def _polished(cost, numbers, low, high):
    for _ in range(2):  # a simplex that has collapsed goes on from a new one
        found = optimize.minimize(
            cost, numbers, method="Nelder-Mead",
            options={"maxfev": 80 * len(low), "xatol": 1e-4, "fatol": 1e-4},
        )  # fmt: skip
        numbers = np.clip(found.x, low, high)
    return numbers


def first_members(plants):
    """Nominal first, then corners, of many a sample."""
    corners, most = plants.corners(), CORNERS_MAX * len(plants.modes)
    if len(corners) > most:
        corners = random.Random(SEED).sample(corners, most)
    return plants.nominal() + corners


def _random(plants, count, seed):
    return plants.random(count, seed) if plants.ranges else []


def search(plants, goal=None, progress=None):
    """The design for a PlantSet: Found. Raises InputError, in one line, where there is none."""
    goal = goal or Goal()
    say = progress or (lambda text: None)
    _check(goal)
    members = first_members(plants)
    problem, thin = (Problem(plants, members, goal, None, density) for density in (1.0, THIN))
    check_plants(problem)
    zeros = antiresonances(problem.grid)
    own = _search(problem, thin, "PI", 1.0, zeros, None, SEED)
    best = {"P": np.zeros(0), "PI": own}
    fS = problem.judge(own)[0]
    if not fS:
        raise _no_gain()
    limits = {name: structures.bounds(name, min(BEGINS) * fS) for name in structures.STRUCTURES}
    ramp_s = goal.ramp_s or max(RAMP_MIN_S, RAMP / fS)
    nominal = [problem.grid.open_loops[i] for i in nominal_of(problem.grid, plants)]
    ramp = Ramp(nominal, [DELAYS[t] for t in goal.timings], ramp_s)
    problem.ramp = thin.ramp = ramp
    before = own
    richer = list(structures.STRUCTURES)[1:]
    for done, name in enumerate(richer):
        say(f"{name}: searching, {done}/{len(richer)} structures")
        best[name] = before = _search(problem, thin, name, fS, zeros, before, SEED)
        say(f"{name}: {problem.judge(before)[0]:.2f} Hz")
    say("random members")
    others = plants.nominal() + plants.corners() + _random(plants, PROBE, SEED)
    probe = Grid(plants, others, goal.timings)
    for _ in range(ROUNDS):
        found = {name: _violator(problem, probe, numbers) for name, numbers in best.items()}
        joined = {m.label(): m for m in found.values() if m is not None and m not in members}
        if not joined:
            break
        members = members + list(joined.values())
        problem = Problem(plants, members, goal, ramp)
        for name in [n for n, m in found.items() if m is not None and len(best[n])]:
            low, high = limits[name].T
            best[name] = _polished(_cost(problem, low, high), best[name], low, high)
    return _result(plants, goal, problem, best, say)


def nominal_of(grid, plants):
    nominal = plants.nominal()
    return [i for i, m in enumerate(grid.members) if m in nominal] or [0]


def antiresonances(grid):
    """Hz of the plants' lightly damped zeros, each once."""
    found = []
    for loop in grid.open_loops:
        zeros = loop.open.zeros_s()
        zeros = zeros[np.isfinite(zeros) & (zeros.imag > 0)]
        light = zeros[np.abs(zeros.real) < 0.2 * np.abs(zeros)]
        hz = light.imag / (2 * math.pi)
        for value in hz[(hz > 2) & (hz < 250)]:
            if all(abs(math.log(value / old)) > 0.1 for old in found):
                found.append(float(value))
    return sorted(found)[:8]


def _violator(problem, probe, numbers):
    """The member of a Grid for which the law's gain would have to be lowest, or None."""
    gain = problem.judge(numbers)[1]
    law = structures.response(numbers, probe)
    limit = probe.largest_gain(law, 1e-9, problem.bounds)
    return probe.members[limit[2]] if limit[0] < 0.999 * gain else None


def _check(goal):
    for timing in goal.timings:
        if timing not in DELAYS:
            raise InputError(
                f"timing: expected zoh or zoh+1, a bank's law is designed for a delay of 0 or 1 "
                f"tick, got {timing}"
            )
    for name in ("ms", "ms_late", "gain_margin"):
        if not getattr(goal, name) > 1:
            raise InputError(f"--{name.replace('_', '-')}: expected a number above 1")


def check_plants(problem):
    for loop, member in zip(problem.grid.open_loops, problem.grid.members, strict=True):
        if loop.limit().gain == 0:
            raise InputError(
                f"{loop.model}: {member.label()}: expected a plant that a small gain keeps stable, "
                f"it is {loop.limit().reason}; add damping or narrow the set"
            )


def _result(plants, goal, problem, best, say):
    """Found, of the numbers of each structure's law."""
    bounds = problem.bounds
    members = {m.label(): m for m in problem.grid.members + plants.corners()}
    members = list(members.values()) + _random(plants, RANDOM, SEED + 1)
    grids = blocks(plants, members, goal.timings)
    rows, steep = [], {}
    for name, numbers in best.items():
        unit = structures.bank(numbers, 1.0).quantised()
        steep[name] = problem.law(numbers)[1]
        gain = min(_largest_gain(grid, unit, steep[name], bounds) for grid in grids)
        bank = certificate.lowered(unit, gain)
        if bank.force_gain:
            rows.append({"name": name, "bank": bank, "worst": certificate.on_grids(grids, bank)})
            say(f"{name}: {rows[-1]['worst']['fS_Hz']:.2f} Hz over {len(members)} members")
    chosen = None
    for row in rows:
        if chosen is None or _pays(row["worst"], chosen):
            chosen = row
    p = next((row for row in rows if row["name"] == "P" and row["worst"]), None)

    def taken(row):
        # The others are only compared with it.
        bank, worst = certificate.exact(plants, grids, row["bank"], goal)
        if not worst or not worst["fS_Hz"]:
            return None
        row |= {"bank": bank, "worst": worst}
        limiting = steep[row["name"]]
        tightest = min(grids, key=lambda grid: _largest_gain(grid, bank, limiting, bounds))
        return Found(
            bank,
            worst,
            (p["worst"] | {"force_gain": p["bank"].force_gain}) if p else {"force_gain": 0.0},
            rows,
            certificate.sentence(tightest, bank, limiting, bounds, goal.hf_cure()),
            row["name"],
            lambda name: taken(next(row for row in rows if row["name"] == name)),
        )

    found = taken(chosen) if chosen else None
    if found is None:
        raise _no_gain()
    return found


def _largest_gain(grid, bank, steep, bounds):
    return grid.largest_gain(bank.response(grid.z), steep, bounds)[0]


def _no_gain():
    return InputError(
        f"--ms: expected margins that some law keeps over the set and still follows, no gain from "
        f"{GAIN_STEP:.4f} codes per 8-bit count on does; narrow --over or accept smaller margins"
    )


def _pays(worst, smaller):
    """Whether a larger structure is worth it."""
    before = smaller["worst"]
    return worst["fS_Hz"] >= PAYS * before["fS_Hz"] or (
        smaller["name"] == "P" and before["static_error"] > STATIC_ERROR_MAX
    )
