"""Design advice: what limits the bandwidth of a force loop, and the benefit of each change.

For the explicit force law (p) around a model, its present design and one change at a time:

* critical gain, V/N and DAC codes per 8-bit count: `loops.Loop.limit`.
* loop gain: critical gain times the loop's gain at 0 Hz, without unit. The steady-state error at
  the limit is 1 / (1 + loop gain) of the step.
* loop gain at the present crossover: the same at the frequency that the present design crosses
  over at. A softer sensor, pad or workpiece raises the critical gain because it lowers the gain of
  the plant (5.1.3). At 0 Hz that does not show in these models, where a voltage stalls the drive at
  a force however soft the contact is; here it does.
* crossover: the lowest frequency at which |L| is 1 with the gain at the critical gain over
  GAIN_MARGIN, what a designer would set. It stands for the closed loop's bandwidth, and rows are
  ranked by it. None if that gain leaves |L| below 1 at 0 Hz.

The limiting mode is the one whose poles cross: the branch of the root locus that is on the
boundary at the critical gain, followed back to gain 0. If that branch starts at the rigid body or
the drive, it is the lowest noncolocated mode below LAG times the crossing, whose lag turns it
(6.1.3); if there is none, the lag of drive and sampling alone limits.

What is linear here is simulated by `simulated_limit`: firmware, quantisation, loss of contact.

Over a set of plants the rows are ranked by the bandwidth fS that the worst member has with the
largest gain at the margins of `search.Goal`, P's or that of a row's own law. A bank designed for
the set (`reduced`) is a row there.
"""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

import numpy as np

from forceaxis import _core, paths, progress
from forceaxis._core import InputError
from forceaxis.design import for_set, reduced, sets, simulate
from forceaxis.design.cases import ContactRun
from forceaxis.design.certificate import WorstFigures
from forceaxis.design.changes import FACTOR, NO_CHANGE, Change, Design, banked, changes, converter
from forceaxis.design.grid import Goal
from forceaxis.design.outcome import DesignOrder
from forceaxis.design.reduced import ShortSearch
from forceaxis.errors import ParameterError
from forceaxis.linear import loops, modes
from forceaxis.linear import system as linear
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.plant_set import PlantSet, ranges_of
from forceaxis.linear.stability import Limit, Loop
from forceaxis.results import json_field

GAIN_MARGIN = 2.0
# ratio to the crossing frequency up to which a noncolocated mode may limit the gain by its phase
# lag
LAG = 3.0


HIGHEST_GAIN = loops.FIRMWARE_HIGHEST


class NotAsked(Enum):
    """Stands for a value that was not requested; JSON has no key for it."""

    NOT_ASKED = "not asked"


NOT_ASKED = NotAsked.NOT_ASKED


@dataclass(frozen=True, kw_only=True)
class Performance:
    """Figures of a loop at its critical gain, defined in the docstring of the module.

    Gains in the unit of the loop, firmware_gain in DAC codes per 8-bit count. critical_gain None:
    the loop is stable at every gain, or at every gain up to known_to, above which rounding decides.
    The other figures are then None, or those of known_to.
    """

    critical_gain: float | None
    known_to: float | None
    frequency_hz: float | None
    firmware_gain: float | None = None
    loop_gain: float | None = None
    loop_gain_at: float | None = None
    crossover_hz: float | None = None


@dataclass(frozen=True, kw_only=True)
class FiguresOverSet(WorstFigures):
    """Worst figures over a set of plants at the margins, and the gain in codes per count."""

    firmware_gain: float


@dataclass(frozen=True)
class SimulatedLimit:
    """The largest firmware gain with a stable verdict (None: no run is stable), the next simulated
    gain, which is not stable (None: all larger gains are stable), its ratio to the linear limit,
    the number of runs, and the force ripple in 8-bit counts at a smaller gain."""

    stable_gain: float | None
    unstable_gain: float | None
    of_limit: float | None
    runs: int
    ripple_count: float | None


@dataclass(frozen=True)
class Ratios:
    """Ratio of each figure with a change to the figure without it; None if one of the two does not
    exist."""

    critical_gain: float | None
    loop_gain: float | None
    loop_gain_at: float | None
    crossover_hz: float | None


@dataclass(frozen=True, kw_only=True)
class PresentDesign(Performance):
    """The present design; over: None if no gain keeps all members stable."""

    over: FiguresOverSet | NotAsked | None = json_field(default=NOT_ASKED, omit_none=True)
    simulated: SimulatedLimit | NotAsked = json_field(default=NOT_ASKED, omit_none=True)


@dataclass(frozen=True, kw_only=True)
class AdviceRow(Performance):
    """One change of the design: name, kind, section of the thesis, whether the firmware supports
    it, and its factors. simulated: None if a run is not possible or was not requested."""

    change: str
    kind: str
    thesis: str | None
    in_firmware: bool
    ratio: Ratios
    over: FiguresOverSet | NotAsked | None = json_field(default=NOT_ASKED, omit_none=True)
    simulated: SimulatedLimit | NotAsked | None = json_field(default=NOT_ASKED, omit_none=True)


@dataclass(frozen=True)
class LimitingMode:
    """The mode of vibration that limits the gain: the element with most of its elastic energy, the
    body with its largest motion, undamped frequency, label, shape {body: amplitude}, and text about
    its effect."""

    name: str
    element: str | None
    body: str
    frequency_hz: float
    damping_ratio: float | None
    label: str
    against_below: str | None
    shape: dict[str, float]
    how: str


@dataclass(frozen=True)
class NoLimitingMode:
    """No mode of vibration limits the gain; how: text about the limiting effect."""

    how: str
    name: str = "none"


@dataclass(frozen=True)
class NextCrossing:
    """The gain and the frequency at which the next pole becomes unstable above the limit."""

    gain: float
    frequency_hz: float | None


@dataclass(frozen=True, kw_only=True)
class Advice:
    """The content of `forceaxis advise --json`; unit: of gains; reference_hz: frequency of
    loop_gain_at; present_gain: force_gain of the experiment; over, modes: the set of plants."""

    model: str
    experiment: str | None
    title: str
    timing: str
    unit: str
    gain_margin: float
    factor: float
    limiting_mode: LimitingMode | NoLimitingMode | None
    present: PresentDesign
    next_crossing: NextCrossing | None
    reference_hz: float | None
    present_gain: float | None
    over: list[str]
    modes: list[dict[str, str]] | None
    rows: list[AdviceRow]
    mode: dict[str, str] | None = json_field(omit_none=True)
    mode_text: str | None = json_field(omit_none=True)


@dataclass(frozen=True)
class AdviceOrder:
    """The options of `advise`, a field for each option of the verb.

    timing: one of loops.TIMINGS, None: that of the experiment's firmware, else zoh. runs: what is
    simulated with the firmware: "none", "present" (the present design and the finer ADC, which
    linear analysis does not see) or "all" that the firmware can run. over: texts NAME=PERCENT% or
    NAME=LOW..HIGH, the set; empty: none; modes: "visited", "all" or "nominal", of the set; states:
    {element: state} of all plants.
    """

    text: str | Path  # MODEL or EXPERIMENT
    overrides: Mapping[str, float | str] | None = None
    timing: str | None = None
    factor: float = FACTOR
    runs: str = "present"
    threads: int | None = None
    over: Sequence[str] = ()
    modes: str = "visited"
    states: Mapping[str, str] | None = None


def performance(loop: Loop, reference_hz: float | None = None) -> Performance:
    """The figures of a loop at its critical gain; loop_gain_at is the loop gain at reference_hz, by
    default the loop's own crossover frequency."""
    limit = loop.limit()
    zero = abs(loop.open.at(0.0 if loop.dt is None else 1.0))
    found = Performance(
        critical_gain=limit.gain, known_to=limit.known_to, frequency_hz=limit.frequency_hz
    )
    if not limit.stable_to:
        return found
    gain = limit.stable_to / GAIN_MARGIN
    crossover_hz = None
    if not np.isfinite(zero) or zero * gain > 1:
        crossovers = loop.margins(gain).crossovers
        crossover_hz = crossovers[0].frequency_hz if crossovers else None
    at_hz = reference_hz or crossover_hz
    has_reading = loop.codes_per_gain is not None
    return replace(
        found,
        firmware_gain=loop.firmware_gain(limit.stable_to) if has_reading else None,
        loop_gain=float(zero * limit.stable_to) if np.isfinite(zero) else None,
        crossover_hz=crossover_hz,
        loop_gain_at=float(abs(loop.open.response(at_hz)) * limit.stable_to) if at_hz else None,
    )


def ratios(new: Performance, old: Performance) -> Ratios:
    """Ratio of each figure with a change to the figure without it."""

    def factor(one: float | None, other: float | None) -> float | None:
        return one / other if one and other else None

    return Ratios(
        factor(new.critical_gain, old.critical_gain),
        factor(new.loop_gain, old.loop_gain),
        factor(new.loop_gain_at, old.loop_gain_at),
        factor(new.crossover_hz, old.crossover_hz),
    )


def strain(model: Path, overrides: Overrides, shape: Mapping[str, float]) -> str | None:
    """The element with most of the elastic energy of a mode, or None."""
    signals = linear.facts(model, overrides).signals
    elements = [n.removesuffix(".deflection") for n in signals if n.endswith(".deflection")]
    if not elements:
        return None
    outputs = [f"{e}.{q}" for e in elements for q in ("spring_force", "deflection")]
    body = next(iter(shape))
    system = linear.linearise(
        model, (f"{body}.force",), tuple(outputs), overrides=overrides, drive=False
    )
    x = np.array([shape.get(s.removesuffix(".position"), 0.0) if s.endswith(".position") else 0.0
                  for s in system.states])  # fmt: skip
    values = (system.C @ x).reshape(-1, 2)
    return elements[int(np.argmax(values[:, 0] * values[:, 1]))]


def limiting_mode(design: Design, loop: Loop) -> LimitingMode | NoLimitingMode | None:
    """The mode that limits the gain, by the definition in the docstring of the module; None if
    nothing limits it."""
    limit = loop.limit()
    if not limit.gain or limit.frequency_hz is None:
        return None
    known = modes.modes(design.model, overrides=design.overrides, states=design.states)
    start = branch_start(loop, limit)
    crossing = flexible = None
    for mode in known.modes:
        pole = mode.driven
        if pole is None or mode.reference:
            continue
        here = complex(pole.real_per_s, pole.imag_per_s)
        if abs(start - here) < 0.02 * abs(here):
            crossing = mode
    if crossing is None:
        high = LAG * limit.frequency_hz
        flexible = next(
            (m for m in known.modes if m.label == "noncolocated" and m.frequency_hz < high), None
        )  # fmt: skip
    limiting = crossing or flexible
    if limiting is None:
        return NoLimitingMode("no mode: the lag of drive and sampling turns the rigid body")
    body = limiting.largest_body
    element = strain(design.model, design.overrides, limiting.shape)
    return LimitingMode(
        name=f"{element} ({body})" if element else body,
        element=element,
        body=body,
        how="its poles cross" if crossing else "its lag turns the rigid body's poles",
        frequency_hz=limiting.frequency_hz,
        damping_ratio=limiting.damping_ratio,
        label=limiting.label,
        against_below=limiting.against_below,
        shape=limiting.shape,
    )


def next_crossing(loop: Loop) -> NextCrossing | None:
    """The next pole that becomes unstable above the limit, or None. Its gain would be the limit if
    the first pole were removed."""
    limit = loop.limit()
    above = [c for c in limit.crossings if limit.gain and c.gain > limit.gain and c.direction > 0]
    return NextCrossing(above[0].gain, above[0].frequency_hz) if above else None


@np.errstate(divide="ignore", invalid="ignore")  # a branch from z = 0 starts at -infinity
def branch_start(loop: Loop, limit: Limit) -> complex:
    """The open-loop pole in 1/s at which the branch begins that is on the stability boundary at the
    limit."""
    if limit.gain is None or limit.frequency_hz is None:
        raise InputError("gain: expected a loop with a critical gain, it is stable at every gain")
    gains = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 40) * limit.gain])
    branches = loop.locus(gains)
    target = 2j * math.pi * limit.frequency_hz
    return complex(branches[0, int(np.nanargmin(np.abs(branches[-1] - target)))])


def rank(
    figures: Performance, in_firmware: bool, over: FiguresOverSet | NotAsked | None = NOT_ASKED
) -> tuple[float, float]:
    """Sorting key: over a set by bandwidth. Without a set, changes without a limit come first, then
    by crossover frequency, then by loop gain. A change that the firmware does not support comes
    last."""
    if not in_firmware:
        return (math.inf, 0.0)
    if not isinstance(over, NotAsked):
        return (-(over.bandwidth_Hz if over else 0.0), 0.0)
    if figures.critical_gain is None and figures.known_to is None:
        return (-math.inf, 0.0)
    return (-(figures.crossover_hz or 0.0), -(figures.loop_gain or 0.0))


class _Over:
    """Computes the figures of each row over a set of plants."""

    def __init__(self, design: Design, over: Sequence[str], modes_: str) -> None:
        if design.timing == "continuous":
            raise ParameterError(
                "timing", "expected zoh or zoh+1 with `over`, because the firmware samples"
            )
        self.design, self.over = design, tuple(over)
        self.modes: tuple[dict[str, str], ...]
        if modes_ == "nominal":
            self.modes = (design.states,)
        elif modes_ == "all":
            self.modes = sets.slopes(design.model, design.overrides, design.states)
        else:
            bench = simulate.ContactBench(design, design.facts.required_reading.bits)
            self.modes = for_set.plant_set(bench, DesignOrder("", self.over)).modes
        self.goal = Goal(timings=(design.timing,), adc_bits=design.facts.required_reading.bits)

    def problem(
        self, change: Change = NO_CHANGE, goal: Goal | None = None, random: int = reduced.RANDOM
    ) -> ShortSearch:
        """The search for the plant set of a change."""
        model = str(self.design.changed_model(change))
        overrides = self.design.overrides | dict(change.overrides)
        ranges = ranges_of(model, self.over, overrides)
        plants = PlantSet(model, overrides, ranges, self.modes)
        return ShortSearch(plants, goal or self.goal, random)

    def figures(self, change: Change = NO_CHANGE) -> FiguresOverSet | None:
        """The worst figures of a change at the margins; None if no gain keeps them."""
        spec = change.spec or LoopSpec(timing=self.design.timing)
        bits = change.firmware.get("adc_bits", self.goal.adc_bits)
        goal = replace(self.goal, timings=(spec.timing,), adc_bits=bits)
        try:
            found = self.problem(change, goal, random=0).worst(spec.bank or Bank(1.0))
        except InputError:  # no gain keeps all members stable
            return None
        if found.worst is None:
            return None
        return FiguresOverSet(**vars(found.worst), firmware_gain=found.bank.force_gain)

    def designed(self) -> list[Change]:
        """Changes from the present law to the bank designed over the set, with the present ADC and
        with one of more bits."""
        made = []
        finer = [c.firmware["adc_bits"] for c in converter(self.design)]
        for bits in (self.goal.adc_bits, *finer):
            problem = self.problem(goal=replace(self.goal, adc_bits=bits))
            text = f"designed bank, {reduced.NAME}" + (f", ADC of {bits} bits" if finer else "")
            found = problem.designed()
            if found.worst:
                change = banked(self.design, text, found.bank)
                made.append(replace(change, firmware={"adc_bits": bits}))
        return made


def advise(order: AdviceOrder) -> Advice:
    """The present design and the effect of each change. Raises InputError."""
    if not (math.isfinite(order.factor) and order.factor > 1):
        raise ParameterError("factor", f"expected a number above 1, got {order.factor:g}")
    with Design(order.text, order.overrides, order.timing, order.states) as design:
        design.require_force_sensor()
        loop = design.loop()
        base = performance(loop)
        group = _Over(design, order.over, order.modes) if order.over else None
        present = PresentDesign(**vars(base), over=group.figures() if group else NOT_ASKED)
        rows = _rows(design, base, order.factor, group)
        if order.runs != "none" and design.timing != "continuous":
            present, rows = _simulated(design, present, rows, order)
        mode = design.working()
        return Advice(
            model=paths.display(design.model),
            experiment=paths.display(design.experiment) if design.experiment else None,
            title=design.facts.title,
            timing=design.timing,
            unit=loop.unit,
            gain_margin=GAIN_MARGIN,
            factor=order.factor,
            limiting_mode=limiting_mode(design, loop),
            present=present,
            next_crossing=next_crossing(loop),
            reference_hz=base.crossover_hz,
            present_gain=design.present_gain,
            over=list(order.over),
            modes=list(group.modes) if group else None,
            rows=[row for row, _ in rows],
            mode=dict(mode.modes) if mode.text else None,
            mode_text=mode.text or None,
        )


Rows = list[tuple[AdviceRow, Change]]


def _simulated(
    design: Design, present: PresentDesign, rows: Rows, order: AdviceOrder
) -> tuple[PresentDesign, Rows]:
    """(present design, rows) with the limits that runs with the firmware have found."""
    own = simulated_limit(design, NO_CHANGE, present, order.threads)
    quiet = (own.stable_gain or 0) / GAIN_MARGIN
    done: Rows = []
    for row, change in progress.each(rows, "changes simulated"):
        wanted = change.simulated and (order.runs == "all" or change.kind == "converter")
        limit = None
        if wanted and change.in_firmware:
            limit = simulated_limit(design, change, row, order.threads, quiet)
        done.append((replace(row, simulated=limit), change))
    return replace(present, simulated=own), done


def _rows(design: Design, base: Performance, factor: float, group: _Over | None) -> Rows:
    """Each change with its figures, in order of rank."""
    made = changes(design, base.frequency_hz, factor)
    if group:
        made = [c for c in made if c.kind != "amplifier"] + group.designed()
    rows: Rows = []
    for change in progress.each(made, "changes"):
        new = performance(design.loop(change), base.crossover_hz)
        over: FiguresOverSet | NotAsked | None = NOT_ASKED
        if group:
            over = group.figures(change) if change.in_firmware else None
        row = AdviceRow(
            **vars(new),
            change=change.name,
            kind=change.kind,
            thesis=change.thesis or None,
            in_firmware=change.in_firmware,
            ratio=ratios(new, base),
            over=over,
        )
        rows.append((row, change))
    rows.sort(key=lambda r: rank(r[0], r[0].in_firmware, r[0].over))
    return rows


def simulated_limit(
    design: Design, change: Change, linear_figures: Performance,
    threads: int | None = None, quiet_gain: float | None = None,
) -> SimulatedLimit:  # fmt: skip
    """Largest firmware gain up to which all runs have a stable verdict.

    Of a row of gains up to 1.3 times the linear limit, the smallest stable one and the next that is
    not (smaller ones are ignored: so slow an approach does not settle in time); two finer rows
    between narrow it to a percent. Contact and limit cycle exist side by side below the linear
    limit, so the result is valid for the approach of the experiment. The ripple is that at
    quiet_gain, or at half the stable gain.
    """
    limit = linear_figures.firmware_gain
    top = min(1.3 * limit if limit else HIGHEST_GAIN, HIGHEST_GAIN)
    shared = _core.Experiments()
    runs = 0

    def run(gains: Sequence[float]) -> list[ContactRun]:
        nonlocal runs
        runs += len(gains)
        jobs = [design.job(change, force_gain=float(g)) for g in gains]
        return simulate.run(jobs, threads or os.cpu_count() or 1, shared)

    def stable(gains: Sequence[float]) -> list[bool]:
        return [one.verdict == "stable" for one in run(gains)]

    gains = [float(gain) for gain in top * np.geomspace(0.01, 1.0, 20)]
    verdicts = stable(gains)
    if True not in verdicts:
        return SimulatedLimit(None, None, None, runs, None)
    start = verdicts.index(True)
    high: float | None = None
    if False not in verdicts[start:]:
        low = gains[-1]
    else:
        first = verdicts.index(False, start)
        low, high = gains[first - 1], gains[first]
        for _ in range(2):
            edges = [float(gain) for gain in np.linspace(low, high, 8)]
            first = [*stable(edges[1:-1]), False].index(False)
            low, high = edges[first], edges[first + 1]
    (quiet,) = run([quiet_gain or low / GAIN_MARGIN])
    return SimulatedLimit(
        stable_gain=low,
        unstable_gain=high,
        of_limit=low / limit if limit and linear_figures.critical_gain else None,
        runs=runs,
        ripple_count=quiet.metrics.force_ripple_count,
    )
