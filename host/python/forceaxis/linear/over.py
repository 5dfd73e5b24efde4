"""Bandwidths and margins of a force loop, and their worst values over a set of plants. The set may
contain several combinations of element states and several delays of the loop.

The frequencies belong to the loop from set-point to measured force, with S = 1 / (1 + k L). The
bandwidth fS is the lowest frequency at which |S| reaches -3 dB (half the power). fT is the
frequency at which |T| last falls through -3 dB. The frequencies at which |S| or |T| has a given
value are the solution of an eigenvalue problem, as in stability.Loop.margins. So no such frequency
is missed between the points of a grid.
"""

import itertools
import math
import operator
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

from forceaxis import _core
from forceaxis.errors import ParameterError
from forceaxis.linear import boundary, loops, settings, working
from forceaxis.linear import system as linear
from forceaxis.linear.equations import Matrix, StateSpace
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.periodic import FreeLoop, PeriodicLoop
from forceaxis.linear.plant_facts import Overrides, PlantFacts
from forceaxis.linear.plant_set import Member, PlantSet
from forceaxis.linear.precise import FIGURES, Figures, PreciseLoops, Responses
from forceaxis.linear.stability import Limit, Loop
from forceaxis.linear.system import System
from forceaxis.linear.working import States

T = TypeVar("T")
# (plant of the set, name of the delay of the loop, result of the analysis of this loop)
Entry = tuple[Member, str, T]
# Combination of element states as pairs (element, state), in alphabetical order.
Mode = tuple[tuple[str, str], ...]

HALF_POWER = math.sqrt(0.5)
# Number of random plants that are analysed in addition to nominal plants and corner plants.
RANDOM_MEMBERS = 24
SEARCH_STARTS = 2  # number of plants from which the search for the worst plant starts
# First and last step of the search for the worst plant, as fractions of half a parameter's range.
COARSE_STEP, FINE_STEP = 1 / 16, 1 / 2048
COMBINATIONS_MAX = 20000
# Name of the element of a stepper motor whose states are the segments of its force.
LOAD_ANGLE = "drive.load_angle"
# number of periods of the motor force that are analysed on each side of load angle 0
STEPPER_PERIODS = 8


class _Response:
    """Magnitude |H| of the frequency response of a stable System H along the stability boundary."""

    def __init__(self, system: System) -> None:
        system = boundary.minimal(system)
        self.A, self.B, self.C, D = boundary.plane(system)
        self.D = D[0, 0]
        self.response = boundary.response(system)
        self.poles = _core.eigenvalues(self.A)
        self.widest = max(np.abs(self.poles).max(initial=0.0), 1e-9)

    def size(self, w: ArrayLike) -> Matrix:
        """Returns |H| at frequencies w in rad/s along the stability boundary, in the shape of w."""
        at = np.asarray(w, float)
        result: Matrix = np.abs(self.response(at.ravel())[0]).reshape(at.shape)
        return result

    def ends(self) -> tuple[float, float]:
        """Returns |H| at both ends of the stability boundary. One end is frequency 0. The other is
        z = -1 (sampled system) or infinity (continuous system)."""
        return float(self.size(0.0)), float(abs(self.D))

    def _level_roots(self, level: float) -> Matrix:
        """Returns complex points s near the frequencies at which |H| equals `level`. These points
        are the zeros of level^2 - H(s) H(-s)."""
        A, B, C, D = self.A, self.B, self.C, self.D
        rest = level**2 - D**2
        if abs(rest) < 1e-9 * level**2:
            # |H| equals the level at the end of the stability boundary, so one root is very large.
            rest = 1e-9 * level**2
        matrix = np.block(
            [
                [A + B @ C * (D / rest), B @ B.T / rest],
                [-C.T @ C * (1 + D * D / rest), -(A + B @ C * (D / rest)).T],
            ]
        )
        result: Matrix = _core.eigenvalues(matrix)
        return result

    def marks(self, level: float) -> Matrix:
        """Returns frequencies along the stability boundary, beginning with 0. Between two adjacent
        frequencies, |H| crosses `level` at most once."""
        roots = np.concatenate([self._level_roots(level), self.poles])
        return np.concatenate([[0.0], boundary.marks(np.abs(roots.imag), self.widest)])

    def crossings(self, level: float) -> list[tuple[float, bool]]:
        """Returns all frequencies w at which |H| equals `level`, in ascending order, as (w, True if
        |H| rises at w)."""
        grid = self.marks(level)
        apart = self.size(grid) - level
        found = []
        for i in np.flatnonzero(apart[:-1] * apart[1:] < 0):
            w = optimize.brentq(
                lambda w: float(self.size(w)) - level, grid[i], grid[i + 1], xtol=1e-300, rtol=1e-13
            )
            found.append((w, bool(apart[i] < 0)))
        return found

    def peak(self, least: float = 0.0) -> float:
        """Returns the largest |H| over all frequencies, or `least` if that is larger. The search
        starts with the highest |H| on a grid as its level. Then it raises the level until |H| is
        nowhere above it."""
        best = max(*self.ends(), least)
        grid = self.marks(max(best, 1e-300) * (1 + 1e-6))
        if least and not np.any(self.size(grid) > best):
            return float(best)
        for _ in range(20):
            sizes = self.size(grid)
            for i in np.argsort(sizes)[:-4:-1]:
                best = max(best, self._hill(grid, sizes, i))
            grid = self.marks(best * (1 + 1e-8))
            if not np.any(self.size(grid) > best * (1 + 1e-8)):
                break
        return float(best)

    def _hill(self, grid: Matrix, sizes: Matrix, i: int) -> float:
        """Returns the largest |H| between the frequencies on both sides of point `i` of a frequency
        grid."""
        high = grid[min(i + 1, len(grid) - 1)]
        low = max(grid[max(i - 1, 0)], 1e-6 * high)
        top = optimize.minimize_scalar(
            lambda x: -float(self.size(math.exp(x))), bounds=(math.log(low), math.log(high)),
            method="bounded", options={"xatol": 1e-9},
        )  # fmt: skip
        w = math.exp(top.x)
        best = max(float(sizes[i]), -top.fun)
        # The search for the maximum gives only half of the digits of the frequency w.
        # The zero of the slope of |H| gives all digits of the frequency w of the maximum.
        for share in (1e-7, 1e-6, 1e-5, 1e-4):
            ends = w * (1 - share), w * (1 + share)
            if self._rise(ends[0]) > 0 > self._rise(ends[1]):
                summit = optimize.brentq(self._rise, *ends, xtol=1e-300, rtol=1e-15)
                return float(max(best, float(self.size(summit))))
        return float(best)

    def _rise(self, w: float) -> float:
        """Returns the derivative of ln |H| with respect to the frequency w."""
        value, slope, _ = self.response([w])
        return float((slope[0] / value[0]).real)


def figures(loop: Loop, gain: float, names: Collection[str] = tuple(FIGURES)) -> Figures:
    """Returns the bandwidths and margins of a force loop at a gain k in V/N. `names`: those of
    FIGURES that are needed. The others may be None, because each takes its own time."""
    if not loop.stable(gain):
        return Figures(False)
    margins = loop.margins(gain) if "phase_margin_deg" in names else loop.gain_margins(gain)
    if isinstance(loop, FreeLoop):
        own = [name for name in names if name not in ("gain_margin", "phase_margin_deg")]
        phases: list[Figures] = []
        for phase in loop.each:
            least = max((one.Ms or 0.0 for one in phases), default=0.0)
            phases.append(_of_one_phase(phase, gain, own, least))
        found = _worst_figures(phases)
    else:
        found = _of_one_phase(loop, gain, names)
    return replace(
        found, gain_margin=margins.gain_margin, phase_margin_deg=margins.phase_margin_deg,
        known_to=margins.known_to,
    )  # fmt: skip


def _of_one_phase(
    loop: Loop, gain: float, names: Collection[str], least_Ms: float = 0.0
) -> Figures:
    """Returns the bandwidths and Ms of a stable force loop at a gain k in V/N, for one phase of the
    samples. `names`: as in figures(). least_Ms: Ms of another phase, which is returned if it is
    larger."""
    has_bandwidths = not {"fS_Hz", "fT_Hz"}.isdisjoint(names)
    Ms = fS = None
    if isinstance(loop, PeriodicLoop):
        fS = loop.bandwidth(gain, HALF_POWER) if has_bandwidths else None
        Ms = loop.peak(gain, least_Ms) if "Ms" in names else None
    elif has_bandwidths or "Ms" in names:
        S = _Response(loop.sensitivity(gain))
        if has_bandwidths:
            rises = [loop.hz(w) for w, up in S.crossings(HALF_POWER) if up]
            fS = 0.0 if S.ends()[0] >= HALF_POWER else min(rises, default=None)
        Ms = S.peak(least_Ms) if "Ms" in names else None
    if "fT_Hz" not in names:
        return Figures(True, fS, Ms=Ms)
    T = _Response(loop.closed(gain))
    falls = [loop.hz(w) for w, up in T.crossings(HALF_POWER) if not up]
    fT = None if T.ends()[1] >= HALF_POWER else max(falls, default=0.0)
    sag = T.ends()[0] < HALF_POWER or min(falls, default=math.inf) < (fS or math.inf)
    return Figures(True, fS, fT, Ms, sag=sag)


def _worst_figures(found: Sequence[Figures]) -> Figures:
    """Returns the worst value of each bandwidth and of Ms among several stable loops."""
    worst = {
        name: getattr(max(found, key=operator.methodcaller("badness", name)), name)
        for name in ("fS_Hz", "fT_Hz", "Ms")
    }
    return Figures(True, **worst, sag=any(one.sag for one in found))


@dataclass(frozen=True)
class Worst:
    """The worst bandwidth and margins over a set of plants. A value is None if no plant has this
    bandwidth or margin, or if one plant is unstable. `known_to`: gain factor up to which all plants
    are known to be stable. It is given if rounding errors hide the gain margin above this
    factor."""

    stable: bool
    fS_Hz: float | None = None
    fT_Hz: float | None = None
    Ms: float | None = None
    gain_margin: float | None = None
    phase_margin_deg: float | None = None
    sag: bool = False
    member: dict[str, tuple[Member, str]] = field(
        default_factory=dict
    )  # {name of a bandwidth or margin: plant and delay of the loop with the worst value}
    members: int = 0  # number of analysed loops
    known_to: float | None = None


# Function that analyses the force loops around some plants, with the given delays of the loop.
# The result is {delay: analysis of the loop} for each plant, with at least the given delays.
Analyse = Callable[[Sequence[Member], Sequence[str]], list[dict[str, T]]]


class _Set(Generic[T]):
    """The force loops of a set of plants. Each force loop is analysed only once. The class also
    searches for the loop with the worst value."""

    def __init__(self, plants: PlantSet, timings: Sequence[str], analyse: Analyse[T]) -> None:
        self.plants, self.timings, self.analyse = plants, timings, analyse
        self.found: dict[tuple[Hashable, str], Entry[T]] = {}

    def at(self, member: Member, timing: str) -> Entry[T]:
        """Returns the analysis of the force loop of one plant of the set with the delay
        `timing`."""
        if (member.key, timing) not in self.found:
            self.cover([member], (timing,))
        return self.found[member.key, timing]

    def cover(self, members: Sequence[Member], timings: Sequence[str] | None = None) -> None:
        """Analyses the force loops of the plants in `members` with the delays `timings`. None means
        every delay of the set."""
        found = self.analyse(members, timings or self.timings)
        for member, results in zip(members, found, strict=True):
            for timing, result in results.items():
                self.found.setdefault((member.key, timing), (member, timing, result))

    def worst(self, badness: Callable[[T], float]) -> Entry[T]:
        """Searches for the worst force loop, which has the largest value of the function `badness`.
        The search starts at the worst loops that are already analysed."""
        for member, timing, _ in self._starts(badness):
            self._climb(member, timing, badness, (0.5, COARSE_STEP))
        member, timing, _ = self.first(badness)
        self._climb(member, timing, badness, (COARSE_STEP, FINE_STEP))
        return self.first(badness)

    def first(self, badness: Callable[[T], float]) -> Entry[T]:
        """Returns the worst of the force loops that are already analysed. It has the largest value
        of the function `badness`."""
        return max(self.found.values(), key=lambda entry: badness(entry[2]))

    def _starts(self, badness: Callable[[T], float]) -> list[Entry[T]]:
        """Returns the force loops at which the search starts. The worst loop of each combination of
        element states and delay comes first, then the worst of all loops."""
        ordered = sorted(self.found.values(), key=lambda entry: -badness(entry[2]))
        first: dict[tuple[Mode, str], Entry[T]] = {}
        for member, timing, result in ordered:
            mode = tuple(sorted(member.modes.items()))
            first.setdefault((mode, timing), (member, timing, result))
        leaders = sorted(first.values(), key=lambda entry: -badness(entry[2]))[:SEARCH_STARTS]
        return leaders + [entry for entry in ordered[:SEARCH_STARTS] if entry not in leaders]

    def _climb(
        self,
        member: Member,
        timing: str,
        badness: Callable[[T], float],
        steps: tuple[float, float],
    ) -> None:
        """Searches for a plant with a larger value of the function `badness` within the ranges of
        the parameters. The pattern search starts at the plant `member`. `steps`: first and last
        step, relative to half the width of a range. If the first step is COARSE_STEP, a parameter
        at the end of its range does not change."""
        ranges = self.plants.ranges
        best, (step, last) = badness(self.at(member, timing)[2]), steps
        if step == COARSE_STEP:
            ranges = {n: r for n, r in ranges.items() if r[1] < member.values[n] < r[2]}
        moves = [
            dict(zip(names, signs, strict=True))
            for count in (1, 2)
            for names in itertools.combinations(ranges, count)
            for signs in itertools.product((1, -1), repeat=count)
        ]
        while moves and step >= last and best < math.inf:
            before = best
            for move in moves:
                values = dict(member.values)
                for name, sign in move.items():
                    _, low, high = ranges[name]
                    value = values[name] + sign * step * (high - low) / 2
                    values[name] = min(max(value, low), high)
                other = Member(values, member.modes)
                size = badness(self.at(other, timing)[2])
                if size > best:
                    best, member = size, other
            step = step if best > before else step / 2


def sample(plants: PlantSet) -> list[Member]:
    """Returns the plants of a set that are analysed before the search: nominal plants, corner
    plants, and random plants."""
    return plants.nominal() + (
        plants.corners() + plants.random(RANDOM_MEMBERS) if plants.ranges else []
    )


def _by_loop(analyse: Callable[[Member, str], T]) -> Analyse[T]:
    """Returns a function that analyses each force loop of a set of plants separately, with the
    function `analyse` of a plant and a delay."""
    return lambda members, timings: [
        {timing: analyse(member, timing) for timing in timings} for member in members
    ]


def gain_at(loop: Loop, gain: float | None, force_gain: float | None) -> float:
    """Returns the gain k of a force loop: `gain` if it is given, else `force_gain`, else the gain
    of the loop's filter bank. Raises ParameterError if none of these is given."""
    if gain is not None:
        return gain
    if force_gain is not None:
        return loop.gain_of(force_gain)
    if loop.bank is None:
        raise ParameterError("gain", "expected `gain` or `firmware_gain`, got neither")
    return loop.gain_of(loop.bank.force_gain)


class WorstSearch:
    """Search for the worst bandwidth and margins over a set of plants; see worst(). responses:
    frequency responses of the plants, with all delays in `timings`. For the other arguments, see
    worst()."""

    def __init__(
        self,
        responses: Responses,
        timings: Sequence[str],
        spec: LoopSpec,
        gain: float | None = None,
        force_gain: float | None = None,
    ) -> None:
        self._plants, self._timings = responses.plants, timings
        own = spec.bank.force_gain if spec.bank and force_gain is None else force_gain

        def by_loop(names: Collection[str]) -> Analyse[Figures]:
            def exact(member: Member, timing: str) -> Figures:
                loop = responses.loop(member, timing, spec)
                return figures(loop, gain_at(loop, gain, own), names)

            return _by_loop(exact)

        self.has_quick = responses.is_exact  # quick() takes less time than exact()
        self._by_loop = by_loop
        loops = PreciseLoops.of(responses, timings, spec, gain, force_gain)
        every = by_loop(tuple(FIGURES))
        self._group = _Set(self._plants, timings, _fast(loops, every) if loops else every)
        self._found = _worst_of_each(self._group)
        self._is_exact = loops is None or self._found is None
        self._loops = loops

    def quick(self, names: Collection[str] = tuple(FIGURES)) -> Worst:
        """Returns the worst bandwidth and margins. For a loop with one code in the period after
        which its ticks repeat, their relative error is about 1e-8. For a loop with several codes in
        this period, returns the result of exact(). `names`: as in exact()."""
        if self._loops is None or self._found is None:
            return _worst(self._group, self._group)
        if not self._loops.responses.is_exact:
            return self.exact(names)
        if not self._loops.responses.is_free:
            return _worst(self._group, self._group)
        whole = replace(self._loops, responses=self._loops.responses.in_all_phases)
        return self._again(_fast(whole, self._by_loop(names)))

    def mean_age(self) -> Worst:
        """Returns the worst bandwidth and margins with the mean age of the readings, for a loop
        with several codes in the period after which its ticks repeat. For other loops, returns the
        result of quick()."""
        if self._loops is None or self._found is None or self._loops.responses.is_exact:
            return self.quick()
        return _worst(self._group, self._group)

    def exact(self, names: Collection[str] = tuple(FIGURES)) -> Worst:
        """Returns the worst bandwidth and margins. The values of the worst loops and of the loops
        around nominal plants are computed as eigenvalue problems. `names`: those of FIGURES that
        are needed. The others may be None, because each takes its own time."""
        if self._is_exact:
            return _worst(self._group, self._group)
        return self._again(self._by_loop(names))

    def _again(self, analyse: Analyse[Figures]) -> Worst:
        """Returns the worst bandwidth and margins after the function `analyse` has analysed the
        worst loops and the loops around nominal plants again."""
        assert self._found is not None
        again = _Set(self._plants, self._timings, analyse)
        again.cover([*self._plants.nominal(), *(entry[0] for entry in self._found.values())])
        return _worst(again, self._group)


def worst(
    plants: PlantSet,
    timings: Sequence[str] = ("zoh",),
    spec: LoopSpec | None = None,
    gain: float | None = None,
    force_gain: float | None = None,
) -> Worst:
    """Returns the worst bandwidth and margins over a set of plants, with all delays in `timings`.
    `spec`: the force loop, or None for law p.

    gain: k in V/N. force_gain: gain in DAC codes per 8-bit count. Without both, the gain of the
    filter bank is used. The nominal plants, corner plants and random plants (with a fixed seed) are
    analysed first. For the bandwidths and for each margin, a pattern search then begins at the
    worst plant. The search uses `precise` where it can. The values of the worst plants are computed
    by figures().
    """
    responses = Responses(plants, timings)
    return WorstSearch(responses, timings, spec or LoopSpec(), gain, force_gain).exact()


def _fast(loops: PreciseLoops, by_loop: Analyse[Figures]) -> Analyse[Figures]:
    """Returns a function that computes bandwidths and margins of the force loops of a set of plants
    in C++. It computes all delays of the loop together, because the plant takes most of the time.
    If C++ cannot decide whether a loop is stable, `by_loop` analyses this loop."""

    def analyse(members: Sequence[Member], timings: Sequence[str]) -> list[dict[str, Figures]]:
        found: list[dict[str, Figures]] = []
        for member, rows in zip(members, loops.figures(members), strict=True):
            known = {t: row for t, row in zip(loops.timings, rows, strict=True) if row is not None}
            missing = [timing for timing in loops.timings if timing not in known]
            found.append(known | (by_loop([member], missing)[0] if missing else {}))
        return found

    return analyse


def _worst_of_each(group: _Set[Figures]) -> dict[str, Entry[Figures]] | None:
    """Searches for the worst force loop with respect to each bandwidth and margin in FIGURES.
    Returns None as soon as one loop is unstable."""
    group.cover(sample(group.plants))
    found: dict[str, Entry[Figures]] = {}
    for name in FIGURES:
        found[name] = group.worst(operator.methodcaller("badness", name))
        if not all(entry[2].stable for entry in group.found.values()):
            return None
    return found


def _worst(exact: _Set[Figures], group: _Set[Figures]) -> Worst:
    """Returns the worst bandwidth and margins of the loops that the object `exact` has analysed.
    `group`: all loops that the search has analysed."""
    members = len(group.found)
    unstable = [
        entry for one in (exact, group) for entry in one.found.values() if not entry[2].stable
    ]
    if unstable:
        return Worst(False, member={"stable": unstable[0][:2]}, members=members)
    found = {name: exact.first(operator.methodcaller("badness", name)) for name in FIGURES}
    values = {name: getattr(entry[2], name) for name, entry in found.items()}
    # A loop without a known crossing of the stability boundary gets the gain margin known_to.
    doubt = min(exact.found.values(), key=lambda entry: entry[2].known_to or math.inf)
    known_to = doubt[2].known_to
    if known_to is not None and known_to > (values["gain_margin"] or math.inf):
        known_to = None
    if known_to is not None:
        values["gain_margin"], found["gain_margin"] = None, doubt
    member = {n: entry[:2] for n, entry in found.items() if values[n] is not None}
    sagging = [entry for entry in group.found.values() if entry[2].sag]
    if sagging:
        member["sag"] = sagging[0][:2]
    return Worst(True, **values, sag=bool(sagging), member=member, members=members,
                 known_to=known_to)  # fmt: skip


@dataclass(frozen=True)
class Largest:
    """The largest gain k up to which all plants of a set are stable, and the plant that becomes
    unstable at this gain. `gain` is None if all plants are stable at every gain, or at every gain
    up to `known_to`. Above `known_to`, rounding errors hide crossings. `gain` is 0 if one plant is
    stable at no gain."""

    gain: float | None
    member: Member
    timing: str
    frequency_hz: float | None
    known_to: float | None = None


def largest_gain(
    plants: PlantSet, timings: Sequence[str] = ("zoh",), spec: LoopSpec | None = None
) -> Largest:
    """Returns the largest gain at which all plants of a set are stable. `spec`: the force loop, or
    None for law p."""

    def analyse(member: Member, timing: str) -> tuple[float, Limit]:
        limit = plants.loop(member, timing, spec).limit()
        to = limit.stable_to
        return (math.inf if to is None else to), limit

    group = _Set(plants, timings, _by_loop(analyse))
    group.cover(sample(plants))
    member, timing, (_, limit) = group.worst(lambda result: -result[0])
    return Largest(limit.gain, member, timing, limit.frequency_hz, limit.known_to)


def _equations(
    model: str | Path, overrides: Overrides | None, modes: States, output: str
) -> StateSpace | None:
    """Returns the matrices (A, B, C, D) of a model from the command to the output. `modes`: states
    of the elements. Returns None if the command does not act on the output."""
    plant = linear.linearise(model, outputs=(output,), overrides=overrides, modes=modes)
    return (plant.A, plant.B, plant.C, plant.D) if plant.has_path() else None


def distinct(
    model: str | Path,
    overrides: Overrides | None,
    output: str,
    candidates: Iterable[dict[str, str]],
) -> tuple[dict[str, str], ...]:
    """Returns combinations of element states without repetition. Of all combinations with equal
    equations, only one is returned. Combinations in which the command does not act on the output
    are left out. So are those in which a backlash is open, although the command then still acts
    through the machine bed that carries motor and axis: no law controls a force across an open
    backlash. Each combination names as few states as possible."""
    plays = working.backlashes(model)

    def opens(modes: States) -> bool:
        flanks = ([modes.get(name + end) for end in working.FLANKS] for name in plays)
        return any(None not in both and working.CLOSED not in both for both in flanks)

    def same(modes: States, equations: StateSpace) -> bool:
        own = _equations(model, overrides, modes, output)
        return own is not None and all(map(np.array_equal, own, equations))

    found: list[dict[str, str]] = []
    seen: list[StateSpace] = []
    for modes in candidates:
        equations = None if opens(modes) else _equations(model, overrides, modes, output)
        if equations is None or any(all(map(np.array_equal, equations, o)) for o in seen):
            continue
        seen.append(equations)
        for name in list(modes):
            fewer = {n: state for n, state in modes.items() if n != name}
            modes = fewer if same(fewer, equations) else modes
        found.append(modes)
    return tuple(sorted(found, key=len))


def _holds(known: PlantFacts, state: str | None) -> bool:
    """Returns True if the force of a stepper motor rises with its load angle in the state `state`
    (None: not given). The load angle then stays in this state. In states with a falling force, the
    motor slips."""
    if state is None:
        return True
    states = known.switches[LOAD_ANGLE]
    middle = len(states) // 2
    return abs(states.index(state) - middle) < middle // STEPPER_PERIODS // 4


def _lasts(known: PlantFacts, modes: States) -> bool:
    """Returns True if a force law can control the force permanently with the element states
    `modes`. All contacts of the model must be pressed, and no element may be saturated. A loop with
    a saturated feedback inside the drive is stable at no gain."""
    if any(state.endswith(" limit") for state in modes.values()):
        return False
    if not _holds(known, modes.get(LOAD_ANGLE)):
        return False
    names = [contact.name for contact in known.contacts]
    return not names or any(modes.get(name, "pressed") == "pressed" for name in names)


def modes_visited(
    experiment: str | Path,
    overrides: Sequence[str] = (),
    output: str = "reading",
    fixed: Mapping[str, str] | None = None,
) -> tuple[dict[str, str], ...]:
    """Returns the combinations {element: state} that a run of an experiment visits. Only those
    count in which the axis is in contact, nothing is saturated, and the command acts on the force.
    All combinations contain the states `fixed`, and there is at least one combination.
    `experiment`: a path. `overrides`: texts NAME=VALUE.

    For each friction, both states are included: stuck and sliding. The run may visit only one of
    them. But a friction that always sticks slides after a larger step, and one that always slides
    sticks at the set-point.
    """
    path, texts = str(experiment), list(overrides)
    events = _core.run(path, texts).events
    own = settings.read_inputs(path, texts)
    known = linear.facts(own.model)
    values = {n: value for n, value in own.parameters.items() if n in known.parameters}
    state: dict[str, str] = {}
    for _, element, before, _ in events:
        state.setdefault(element, before)
    visited = [dict(state)]
    for _, element, _, after in events:
        state[element] = after
        visited.append(dict(state))
    rubbing = working.friction_states(own.model, values)
    fixed = dict(fixed or {})
    unique = {
        tuple(sorted(modes.items())): modes
        for one in visited
        for chosen in itertools.product(*rubbing)
        for modes in [one | dict(chosen) | fixed]
    }
    inside = [modes for modes in unique.values() if _lasts(known, modes)]
    return distinct(own.model, values, output, inside) or (fixed,)


def modes_all(
    model: str | Path,
    overrides: Overrides | None = None,
    output: str = "reading",
    fixed: Mapping[str, str] | None = None,
) -> tuple[dict[str, str], ...]:
    """Returns all combinations of the states of all elements that switch, under the conditions of
    modes_visited(). Raises InputError if no combination is left."""
    known = linear.facts(model, overrides)
    where = linear.find_model(model)
    if output == "reading" and known.reading is None:
        raise loops.no_reading(str(where))
    choices = working.choices(where, known.switches, overrides)
    if math.prod(map(len, choices)) > COMBINATIONS_MAX:
        raise ParameterError(
            "modes",
            f"expected at most {COMBINATIONS_MAX} combinations of states for the value all, got "
            "more; use the value visited",
        )
    fixed = dict(fixed or {})
    every = (
        {name: state for chosen in combination for name, state in chosen.items()} | fixed
        for combination in itertools.product(*choices)
    )
    lasting = [fixed, *(modes for modes in every if _lasts(known, modes))]
    found = distinct(model, overrides, output, lasting)
    if not found:
        own = working.working(where, overrides, fixed)

        def has_path(modes: dict[str, str]) -> bool:
            return linear.linearise(
                model, ("drive.command",), (output,), overrides, modes
            ).has_path()

        cut = working.cut_by(where, overrides, own.modes, has_path)
        raise _core.InputError(
            f"{where}: expected a signal path from drive.command to {output} in at least one "
            f"mode, got none{cut}"
        )
    return found
