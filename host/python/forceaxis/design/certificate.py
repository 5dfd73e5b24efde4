"""Computes the worst bandwidth and margins of a control law over a set of plants, without an error
from a grid of frequencies. Also names the bound that limits the gain.

The search evaluates a law on a grid of frequencies and on a sample of the set. The functions of
this module lower the gain until the exact figures of the worst members keep the margins.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from forceaxis.design.grid import POLE_ROUNDING_PER_S, Bounds, Goal, Grid, Response
from forceaxis.linear import over, precise
from forceaxis.linear.bank import GAIN_MAX, GAIN_STEP, Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import Member, PlantSet
from forceaxis.linear.precise import DELAYS, Responses

ATTEMPTS = 12  # largest number of gains for which the exact bandwidth and margins are computed
# Ratio of the first gain in the exact check to the gain that the grid of frequencies permits.
# This ratio of two gains is below 1, because the grid seldom contains the worst plant.
FIRST_GAIN_FACTOR = 0.995
# The search for the largest gain ends when the ratio of a kept gain to a failed gain is this large.
GAIN_NEAR = 0.98
# Ratio of the gain that is tried next to the gain at which a bound is expected to be reached.
EDGE_FACTOR = 0.997
Accuracy = Literal["exact", "quick", "mean age"]
Searches = dict[str, over.WorstSearch]  # {delay of the loop: search for the worst plants}
# largest relative error of quickly computed bandwidths and margins, with a reserve
QUICK_ERROR = 1e-6
REACHED_SHARE = 0.97  # share of a bound above which a sentence says that the bound is reached
# Two frequencies belong to the same mode of vibration if their ratio is below this factor.
MODE_FACTOR = 1.35

# {name of a bound in GainLimit: text about the bound for a sentence}
CONSTRAINTS = {
    "ms": "peak of |S|",
    "gm": "gain margin",
    "pm": "phase margin",
}


FIGURES = ("fS, Hz", "fT, Hz", "Ms", "Ms at latency 1", "gain margin", "phase margin, degrees")
Row = tuple[float | None, ...]


@dataclass(frozen=True)
class WorstFigures:
    """The worst bandwidth and the worst margins of a law over a set of plants. None means that a
    value does not exist."""

    fS_Hz: float | None  # lowest frequency at which |S| reaches -3 dB
    fT_Hz: float | None  # highest frequency at which |T| falls below -3 dB
    Ms: float | None  # largest |S| without latency
    Ms_late: float | None  # largest |S| with one tick of latency
    gain_margin: float | None
    phase_margin_deg: float | None
    static_error: float  # largest static error as a share of the set-point
    # plant with the lowest fS: {parameter: value in SI units}, states, and delay of the loop
    member: dict[str, float | str]

    @property
    def bandwidth_Hz(self) -> float:
        """The bandwidth fS in Hz, or 0 if fS does not exist."""
        return self.fS_Hz or 0.0

    @property
    def row(self) -> Row:
        """Returns the values of one table row, in the order of FIGURES."""
        return (
            self.fS_Hz, self.fT_Hz, self.Ms, self.Ms_late, self.gain_margin, self.phase_margin_deg
        )  # fmt: skip

    @property
    def largest_ms(self) -> float:
        """The larger value of Ms and Ms_late; 0 if neither Ms nor Ms_late exists."""
        return max((ms for ms in (self.Ms, self.Ms_late) if ms is not None), default=0.0)


@dataclass(frozen=True)
class PFigures(WorstFigures):
    """Worst bandwidth and margins of the P law with the largest gain that keeps the margins."""

    force_gain: float  # gain of the P law in DAC codes per 8-bit count


@dataclass(frozen=True)
class NoPFigures:
    """Marks the result that no gain of the P law keeps the margins."""

    force_gain: float = 0.0

    @property
    def row(self) -> Row:
        """Returns a table row without values, with one cell for each value in FIGURES."""
        return (None,) * len(FIGURES)


P = PFigures | NoPFigures


def p_figures(worst: WorstFigures, bank: Bank) -> PFigures:
    """Returns the worst bandwidth and margins of the P law with the same gain as the filter bank
    `bank`."""
    return PFigures(**vars(worst), force_gain=bank.force_gain)


def lowered(bank: Bank, factor: float) -> Bank:
    """Returns a filter bank with the largest gain that the firmware can store and that is at most
    `factor` times the gain of `bank`."""
    gain = math.floor(bank.force_gain * factor / GAIN_STEP) * GAIN_STEP
    return replace(bank, force_gain=min(gain, GAIN_MAX))


def on_grid(grid: Grid, bank: Bank) -> WorstFigures:
    """Returns the worst bandwidth and margins of a filter bank over the plants of a grid. The gain
    of the bank must be at most the largest gain that keeps the margins on this grid. All loops are
    then stable."""
    found = grid.figures(bank)
    peaks = dict(zip(grid.timings, found.Ms.max(axis=0).tolist(), strict=True))
    slowest, _ = np.unravel_index(int(np.argmin(found.fS_Hz)), found.fS_Hz.shape)
    member = grid.members[int(slowest)]
    return WorstFigures(
        fS_Hz=float(found.fS_Hz.min()),
        fT_Hz=float(found.fT_Hz.min()),
        Ms=peaks.get("zoh"),
        Ms_late=peaks.get("zoh+1"),
        gain_margin=_finite(found.gain_margin.min()),
        phase_margin_deg=_finite(np.degrees(found.phase_margin_rad.min())),
        static_error=_static_error(grid, bank),
        member=member.values | member.modes,
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _least(values: Sequence[float | None]) -> float | None:
    return min((value for value in values if value is not None), default=None)


def exact(
    responses: Responses, grid: Grid, bank: Bank, goal: Goal,
    accuracy: Accuracy = "exact", first: float = FIRST_GAIN_FACTOR, least_Hz: float = 0.0,
) -> tuple[Bank, WorstFigures | None]:  # fmt: skip
    """Returns (filter bank, worst values) with a gain at which the exact bandwidth and margins keep
    the bounds of the goal on all plants. If no gain keeps the bounds, the gain is 0 and the worst
    values are None. `responses`: frequency responses of the plants, with the delays of the goal.
    `accuracy`: "quick" permits a relative error of up to QUICK_ERROR, and takes a fraction of the
    time; "mean age" is also quick for a loop with several codes in a period, with the mean age of
    the readings (WorstSearch.mean_age). `first`: ratio of the first gain that is tried to the gain
    of `bank`. `least_Hz`: bandwidth fS in Hz that the law must exceed. The result is that of no
    gain as soon as a gain that is too large has no more bandwidth: smaller gains have less."""
    bank = lowered(bank, first)
    kept: tuple[Bank, Searches] | None = None
    limits = _Limits(goal)
    margins = ["Ms", "gain_margin"] + ["phase_margin_deg"] * bool(goal.phase_margin_deg)
    for attempt in range(ATTEMPTS):
        if not bank.force_gain:
            break
        searches = _searches(responses, bank)
        found = _worst_of(searches, goal, accuracy, margins)
        factor = min(_factor(w, goal, t, accuracy != "exact") for t, w in found.items())
        limits.add(bank.force_gain, found, factor >= 1)
        if factor >= 1:
            kept = bank, searches
            if limits.is_near:
                break
        elif not kept and least_Hz and _is_slower(searches.values(), accuracy, least_Hz):
            break
        if kept:
            # The last step may have lowered the gain too far, so a larger gain is tried.
            between = lowered(bank, limits.between() / bank.force_gain)
            if between.force_gain <= kept[0].force_gain:
                break
            bank = between
        else:
            # Each attempt lowers the gain by a larger factor, because some peaks decrease slowly.
            bank = lowered(bank, (0.999 * factor) ** (1 + attempt))
    if not kept:
        return replace(bank, force_gain=0.0), None
    bank, searches = kept
    return bank, _figures(_worst_of(searches, goal, accuracy), grid, bank)


@dataclass
class _Limits:
    """What the tried gains of a law tell about the largest gain that keeps the bounds of a goal.
    Each of `kept` and `failed` is (gain, distance of |1 + L| from its bound, below 0 if it does not
    keep the bound). `kept`: largest gain that keeps the bounds. `failed`: smallest gain that is
    tried and does not. `most`: gain above which the gain margin is not kept."""

    goal: Goal
    kept: tuple[float, float] = (0.0, 0.0)
    failed: tuple[float, float] = (math.inf, 0.0)
    most: float = math.inf

    def add(self, gain: float, found: Mapping[str, over.Worst], is_kept: bool) -> None:
        """Adds a gain. `found`: worst margins with each delay of the loop."""
        distances = [
            1 / worst.Ms - 1 / self.goal.ms_of(timing) if worst.Ms else -math.inf
            for timing, worst in found.items()
        ]
        if is_kept:
            self.kept = gain, min(distances)
        else:
            self.failed = gain, min(distances)
        # The product of gain and gain margin does not depend on the gain.
        margins = [worst.gain_margin for worst in found.values() if worst.gain_margin is not None]
        self.most = min([self.most, *(gain * one / self.goal.gain_margin for one in margins)])

    def _edge(self) -> float:
        """Returns the gain at which a bound is expected to be reached, or infinity. The smallest
        |1 + L| depends on the gain nearly as a straight line."""
        (low, above), (high, below) = self.kept, self.failed
        if not 0 <= above < math.inf or not -math.inf < below < 0:
            return math.inf
        return low + (high - low) * above / (above - below)

    @property
    def is_near(self) -> bool:
        """True if no larger gain has to be tried after a gain that keeps the bounds: it is the
        first one, or is near to the smallest gain that does not keep the bounds."""
        gain, failed = self.kept[0], self.failed[0]
        return failed == math.inf or gain >= GAIN_NEAR * min(failed, self.most, self._edge())

    def between(self) -> float:
        """Returns the gain that is tried next, between one that keeps the bounds and one that does
        not."""
        middle = math.sqrt(self.kept[0] * min(self.failed[0], self.most))
        edge = EDGE_FACTOR * min(self.failed[0], self.most, self._edge())
        return edge if self.kept[0] < edge < self.failed[0] else middle


def _is_slower(searches: Iterable[over.WorstSearch], accuracy: Accuracy, least_Hz: float) -> bool:
    """Returns True if all loops are stable, and fS of one of them does not exceed `least_Hz`."""
    every = [_quick(search, accuracy, ("fS_Hz",)) for search in searches]
    if not all(worst.stable for worst in every):
        return False
    return min(math.inf if w.fS_Hz is None else w.fS_Hz for w in every) <= least_Hz


def _worst_of(
    searches: Searches,
    goal: Goal,
    accuracy: Accuracy,
    names: Collection[str] = tuple(precise.FIGURES),
) -> dict[str, over.Worst]:
    """Returns the worst bandwidth and margins for each delay of the loop. Quickly computed values
    are returned if they do not keep the bounds. Exact values would not keep the bounds either.
    `names`: as in WorstSearch.exact()."""
    if accuracy != "exact" or all(search.has_quick for search in searches.values()):
        found = {t: _quick(search, accuracy, names) for t, search in searches.items()}
        if accuracy != "exact" or min(_factor(w, goal, t) for t, w in found.items()) < 1:
            return found
    return {t: search.exact(names) for t, search in searches.items()}


def _quick(search: over.WorstSearch, accuracy: Accuracy, names: Collection[str]) -> over.Worst:
    return search.mean_age() if accuracy == "mean age" else search.quick(names)


def _searches(responses: Responses, bank: Bank) -> Searches:
    spec = LoopSpec("bank", bank=bank)
    return {t: over.WorstSearch(responses, (t,), spec) for t in responses.timings}


def of_any(plants: PlantSet, grid: Grid, bank: Bank, timings: Sequence[str]) -> WorstFigures | None:
    """Returns the exact worst bandwidth and margins of any filter bank over a set of plants. The
    result is None if a plant of the set is unstable with this bank."""
    searches = _searches(Responses(plants, timings), bank)
    found = {t: search.exact() for t, search in searches.items()}
    stable = all(worst.stable for worst in found.values())
    return _figures(found, grid, bank) if stable else None


def _factor(worst: over.Worst, goal: Goal, timing: str, quick: bool = False) -> float:
    """Returns the factor by which the gain has to be multiplied so that the loop keeps the margins
    with the delay `timing` ("zoh" or "zoh+1"). Returns 1 if the loop already keeps the margins.
    `quick`: True if the values in `worst` have an error of up to QUICK_ERROR. The margins must be
    kept even with this error."""
    if not worst.stable:
        return 0.8
    factor = 1.0
    slack = 1 - QUICK_ERROR if quick else 1.0
    most = goal.ms_of(timing) * slack
    if worst.Ms is not None and worst.Ms > most:
        factor = min(factor, max(1 - (worst.Ms - most) / most, 0.8))
    if worst.gain_margin is not None and worst.gain_margin * slack < goal.gain_margin:
        factor = min(factor, worst.gain_margin / goal.gain_margin)
    if goal.phase_margin_deg and abs(worst.phase_margin_deg or 180) < goal.phase_margin_deg:
        factor = min(factor, 0.97)
    return factor


def _figures(found: Mapping[str, over.Worst], grid: Grid, bank: Bank) -> WorstFigures:
    every = list(found.values())
    slowest = min(every, key=lambda w: math.inf if w.fS_Hz is None else w.fS_Hz)
    member, _ = slowest.member.get("fS_Hz", (None, ""))
    ms = {timing: worst.Ms for timing, worst in found.items()}
    return WorstFigures(
        fS_Hz=_least([_size(w.fS_Hz) for w in every]),
        fT_Hz=_least([_size(w.fT_Hz) for w in every]),
        Ms=ms.get("zoh"),
        Ms_late=ms.get("zoh+1"),
        gain_margin=_least([_size(w.gain_margin) for w in every]),
        phase_margin_deg=_least([_size(w.phase_margin_deg) for w in every]),
        static_error=_static_error(grid, bank),
        member=member.values | member.modes if member else {},
    )


def _size(value: float | None) -> float | None:
    return None if value is None else abs(value)


def _static_error(grid: Grid, bank: Bank) -> float:
    """Returns the largest static error of a filter bank over the plants of a grid, as a share of
    the set-point. A plant with a pole at 0, such as a velocity loop with an integral, has no static
    error."""
    if bank.integral_rad_per_s:
        return 0.0
    static = [
        grid.core.response(i)[0]
        for i in range(len(grid.members))
        if np.abs(grid.core.poles(i)).min(initial=np.inf) > POLE_ROUNDING_PER_S
    ]
    return float(np.abs(1 / (1 + bank.force_gain * np.array(static))).max(initial=0.0))


def sentence(grid: Grid, bank: Bank, steep: float, bounds: Bounds, finer: str) -> str:
    """Returns a sentence about the bound that limits the gain of a filter bank.

    `steep` is the gain of the law at high frequency with a `force_gain` of 1. `finer` is the text
    of Goal.hf_cure() about a remedy.
    """
    if bank.force_gain >= GAIN_MAX:
        return (
            f"The gain of {GAIN_MAX:.0f} DAC codes per 8-bit count is the limit, because the "
            "firmware stores no larger gain: a sensor with a smaller range, or a larger speed or "
            "current at full command, permits more bandwidth."
        )
    free = replace(bounds, hf_gain=math.inf)
    limit = grid.largest_gain(bank, steep, free)
    reached = bank.force_gain * steep >= REACHED_SHARE * bounds.hf_gain
    high = f"the gain at high frequency ({bounds.hf_gain:.3g} codes per 8-bit count)"
    if limit.place is None or (reached and _margin_left(grid, bank, free, steep)):
        return f"{high[0].upper()}{high[1:]} is the limit: {finer}."
    member, timing, hz = limit.place
    mode = _mode_near(grid.core.poles(member), hz)
    where = f"at {hz:.1f} Hz" + (f", over the plant's mode at {mode:.1f} Hz," if mode else "")
    late = ", with one tick of latency," if DELAYS[grid.timings[timing]] else ""
    text = f"The {CONSTRAINTS[limit.name]} {where} {_with(grid.members[member])}{late} is the limit"
    cure = "more damping of that mode" if mode else "a looser margin"
    text += f": {cure} or a narrower set permits more gain"
    return text + (f"; so is {high}: {finer}." if reached else ".")


def _with(member: Member) -> str:
    label = member.label()
    return "on the nominal plant" if label == "nominal" else f"with {label}"


def _margin_left(grid: Grid, bank: Bank, bounds: Bounds, steep: float) -> bool:
    return grid.largest_gain(bank, steep, bounds).gain > bank.force_gain / REACHED_SHARE


def _mode_near(poles: Response, hz: float) -> float | None:
    """Returns the frequency in Hz of the lightly damped pole next to the frequency `hz`, or None.
    `poles`: poles of the plant in 1/s."""
    poles = poles[np.isfinite(poles) & (poles.imag > 0)]
    light = poles[np.abs(poles.real) < 0.2 * np.abs(poles)].imag / (2 * math.pi)
    near = [p for p in light if max(p / hz, hz / p) < MODE_FACTOR]
    return min(near, key=lambda p: abs(math.log(p / hz)), default=None)
