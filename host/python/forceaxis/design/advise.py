"""Design advice: finds what limits the bandwidth of a force loop, and the benefit of each change of
the axis.

The advice compares the present design with designs that have one change. The law is the explicit
force law (p). The figures are:

* critical gain in V/N, and in DAC codes per 8-bit count: `loops.Loop.limit`.
* loop gain: critical gain times the gain of the plant at 0 Hz, without unit. At the critical gain,
  the static error is 1 / (1 + loop gain) of the set-point.
* loop gain at the present crossover: the same product at the crossover frequency of the present
  design. A softer sensor, pad or workpiece raises the critical gain because it lowers the gain of
  the plant (5.1.3). The gain of the plant at 0 Hz does not show this, because in these models the
  static force of the drive at a voltage does not depend on the stiffness of the contact.
* crossover: the lowest frequency at which the loop gain |L| is 1, at the critical gain divided by
  GAIN_MARGIN. This frequency approximates the bandwidth of the closed loop, and the rows are ranked
  by it. It is None if |L| is below 1 at 0 Hz.

The limiting mode is the mode of vibration whose poles reach the stability boundary. The branch of
the root locus that is on the boundary at the critical gain is followed back to gain 0, where it
begins at the poles of a mode. If the branch begins at a pole of the rigid body or of the drive, the
limiting mode is the lowest noncolocated mode below LAG times the critical frequency, because its
phase lag limits the gain (6.1.3). If there is no such mode, the lag of drive and sampling limits.

`simulated_limit` simulates what the linear analysis does not contain: the firmware, quantisation
and contact loss.

Over a set of plants, the rows are ranked by the bandwidth fS of the worst member, with the largest
gain that keeps the margins of `grid.Goal`. One row is then a bank that was designed for the set
(`reduced`).
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
from forceaxis.design.grid import Goal, goal_of_noise
from forceaxis.design.outcome import DesignOrder
from forceaxis.design.reduced import ShortSearch
from forceaxis.errors import ParameterError
from forceaxis.linear import loops, modes
from forceaxis.linear import system as linear
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.plant_set import PlantSet, set_of
from forceaxis.linear.stability import Limit, Loop
from forceaxis.results import json_field

GAIN_MARGIN = 2.0
# Highest ratio of a mode's frequency to the critical frequency at which its lag can limit the gain.
LAG = 3.0


HIGHEST_GAIN = loops.FIRMWARE_HIGHEST


class NotAsked(Enum):
    """Type of the value NOT_ASKED of a result that was not requested. JSON has no key for
    NOT_ASKED."""

    NOT_ASKED = "not asked"


NOT_ASKED = NotAsked.NOT_ASKED


@dataclass(frozen=True, kw_only=True)
class Performance:
    """Gains and frequencies of a loop at the critical gain. The docstring of this module defines
    each value.

    Gains are in the unit of the loop. Only firmware_gain is in DAC codes per 8-bit count. Without a
    critical gain, critical_gain is None. If known_to is then None, the loop is stable at every
    gain. Otherwise the loop is stable up to the gain known_to, and above it rounding errors hide a
    limit. The other fields are then None, or the values at the gain known_to.
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
    """Worst bandwidth and margins over a set of plants, with the largest gain that keeps the
    margins. `firmware_gain` is this largest gain in DAC codes per 8-bit count."""

    firmware_gain: float


@dataclass(frozen=True)
class SimulatedLimit:
    """The largest `force_gain`, in DAC codes per 8-bit count, at which all simulated contacts are
    stable."""

    stable_gain: float | None  # None: the simulated contacts are unstable at every gain
    # smallest unstable gain above `stable_gain`; None if all larger gains are stable
    unstable_gain: float | None
    of_limit: float | None  # ratio of `stable_gain` to the critical gain of the linear loop
    runs: int  # number of simulated runs
    ripple_count: float | None  # force ripple in 8-bit counts at about half of `stable_gain`


@dataclass(frozen=True)
class Ratios:
    """For each value of Performance, the ratio of the changed design to the present design. A ratio
    is None if one of the two designs has no value."""

    critical_gain: float | None
    loop_gain: float | None
    loop_gain_at: float | None
    crossover_hz: float | None


@dataclass(frozen=True, kw_only=True)
class PresentDesign(Performance):
    """The performance of the present design. `over`: worst values over a set of plants, or None if
    no gain keeps the margins. `simulated`: largest stable gain in simulated runs."""

    over: FiguresOverSet | NotAsked | None = json_field(default=NOT_ASKED, omit_none=True)
    simulated: SimulatedLimit | NotAsked = json_field(default=NOT_ASKED, omit_none=True)


@dataclass(frozen=True, kw_only=True)
class AdviceRow(Performance):
    """The performance of the design with one change.

    `change`: name of the change. `thesis`: section of the thesis that proposes the change.
    `in_firmware`: True if the firmware supports the change. `simulated`: None if no run is possible
    or requested.
    """

    change: str
    kind: str
    thesis: str | None
    in_firmware: bool
    ratio: Ratios
    over: FiguresOverSet | NotAsked | None = json_field(default=NOT_ASKED, omit_none=True)
    simulated: SimulatedLimit | NotAsked | None = json_field(default=NOT_ASKED, omit_none=True)


@dataclass(frozen=True)
class LimitingMode:
    """The mode of vibration that limits the gain of the force loop.

    `element`: spring or contact with most of the elastic energy. `body`: body with the largest
    motion. `frequency_hz`: frequency of the mode without damping. `shape`: {body: amplitude}.
    `how`: text about the effect of the mode on the loop.
    """

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
    """Result if no mode of vibration limits the gain. `how` is a text about the effect that limits
    the gain instead."""

    how: str
    name: str = "none"


@dataclass(frozen=True)
class NextCrossing:
    """The next gain above the critical gain at which another pole becomes unstable. The frequency
    belongs to this pole."""

    gain: float
    frequency_hz: float | None


@dataclass(frozen=True, kw_only=True)
class Advice:
    """What limits the bandwidth of an axis, and the effect of each possible change of the axis.

    `unit`: unit of the gains. `reference_hz`: crossover frequency of the present design, at which
    `loop_gain_at` is computed. `present_gain`: `force_gain` of the experiment. `over` and `modes`:
    tolerances and modes of the set of plants.
    """

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
    """The request for an advice.

    text: model or experiment, as a path or a name. timing: one of loops.TIMINGS. None selects the
    timing of the experiment, or zoh without an experiment. factor: factor by which a parameter is
    multiplied and divided.

    runs: which designs are simulated with the firmware. "none": no design. "present": the present
    design and the change to a finer ADC, whose effect the linear analysis does not contain. "all":
    all designs that the firmware can run.

    over: tolerances of the set of plants as texts NAME=PERCENT% or NAME=LOW..HIGH. Without a
    tolerance, there is no set of plants. modes: modes of the set of plants: "visited", "all" or
    "nominal". states: {element: state} of all plants.
    """

    text: str | Path
    overrides: Mapping[str, float | str] | None = None
    timing: str | None = None
    factor: float = FACTOR
    runs: str = "present"
    threads: int | None = None
    over: Sequence[str] = ()
    modes: str = "visited"
    states: Mapping[str, str] | None = None


def performance(loop: Loop, reference_hz: float | None = None) -> Performance:
    """Returns the performance of a loop at its critical gain. `reference_hz` is the frequency in Hz
    of the field `loop_gain_at`; if None, the crossover frequency of this loop is used."""
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
    """Returns each performance value of a changed design, divided by the value of the present
    design."""

    def factor(one: float | None, other: float | None) -> float | None:
        return one / other if one and other else None

    return Ratios(
        factor(new.critical_gain, old.critical_gain),
        factor(new.loop_gain, old.loop_gain),
        factor(new.loop_gain_at, old.loop_gain_at),
        factor(new.crossover_hz, old.crossover_hz),
    )


def strain(model: Path, overrides: Overrides, shape: Mapping[str, float]) -> str | None:
    """Returns the name of the spring or contact that stores most of the elastic energy in a mode of
    vibration, or None if the model has no spring and no contact. `shape` is {body: amplitude} of
    the mode."""
    facts = linear.facts(model, overrides)
    signals = facts.signals
    elements = [n.removesuffix(".deflection") for n in signals if n.endswith(".deflection")]
    if not elements:
        return None
    outputs = [f"{e}.{q}" for e in elements for q in ("spring_force", "deflection")]
    body = next(iter(shape))
    system = linear.linearise(
        model, (f"{body}.force",), tuple(outputs), overrides=overrides, drive=False
    )
    # Generalised coordinates with which the bodies are displaced as in the mode of vibration.
    moved = np.array([shape.get(point, 0.0) for point in facts.points])
    coordinates = np.linalg.lstsq(facts.displacements(), moved)[0]
    amplitude = dict(zip(facts.coordinates_kg, coordinates, strict=True))
    x = np.array([amplitude.get(s.removesuffix(".position"), 0.0)
                  if s.endswith(".position") else 0.0 for s in system.states])  # fmt: skip
    values = (system.C @ x).reshape(-1, 2)
    return elements[int(np.argmax(values[:, 0] * values[:, 1]))]


def limiting_mode(design: Design, loop: Loop) -> LimitingMode | NoLimitingMode | None:
    """Returns the mode of vibration that limits the gain of a loop, or None if the loop is stable
    at every gain. The docstring of the module defines the limiting mode."""
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
    """Returns the next pole that becomes unstable above the critical gain, or None. The gain at
    which this happens would be the critical gain if the first unstable pole stayed stable."""
    limit = loop.limit()
    above = [c for c in limit.crossings if limit.gain and c.gain > limit.gain and c.direction > 0]
    return NextCrossing(above[0].gain, above[0].frequency_hz) if above else None


# The root locus of a sampled loop starts at z = 0, whose logarithm is -infinity.
@np.errstate(divide="ignore", invalid="ignore")
def branch_start(loop: Loop, limit: Limit) -> complex:
    """Returns the open-loop pole in 1/s at which a branch of the root locus begins. This branch
    reaches the stability boundary at the critical gain."""
    if limit.gain is None or limit.frequency_hz is None:
        raise InputError(
            "gain: expected a loop with a critical gain, got a loop that is stable at every gain; "
            "no gain limits this loop, so there is nothing to compare"
        )
    gains = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 40) * limit.gain])
    branches = loop.locus(gains)
    target = 2j * math.pi * limit.frequency_hz
    return complex(branches[0, int(np.nanargmin(np.abs(branches[-1] - target)))])


def rank(
    figures: Performance, in_firmware: bool, over: FiguresOverSet | NotAsked | None = NOT_ASKED
) -> tuple[float, float]:
    """Returns the sorting key of a row of the advice.

    With a set of plants, the rows are sorted by bandwidth. Without a set of plants, changes without
    a critical gain come first; all other rows are sorted by crossover frequency, then by loop gain.
    Changes that the firmware does not support come last.
    """
    if not in_firmware:
        return (math.inf, 0.0)
    if not isinstance(over, NotAsked):
        return (-(over.bandwidth_Hz if over else 0.0), 0.0)
    if figures.critical_gain is None and figures.known_to is None:
        return (-math.inf, 0.0)
    return (-(figures.crossover_hz or 0.0), -(figures.loop_gain or 0.0))


class _Over:
    """Computes the worst performance of each row of the advice over a set of plants."""

    def __init__(self, design: Design, over: Sequence[str], modes_: str) -> None:
        if design.timing == "continuous":
            raise ParameterError(
                "timing",
                "expected zoh or zoh+1 together with `over`, because the firmware samples the "
                "measured force",
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
        self.goal = self.goal_of(design.facts.required_reading.bits)

    def goal_of(self, bits: int) -> Goal:
        """Returns the margins to keep with an ADC of `bits` bits, with the noise of the model."""
        goal = goal_of_noise(bits, self.design.noise_codes(bits))
        return replace(goal, timings=(self.design.timing,))

    def problem(
        self, change: Change = NO_CHANGE, goal: Goal | None = None, random: int = reduced.RANDOM
    ) -> ShortSearch:
        """Returns the search for control laws over the set of plants of a changed design."""
        model = str(self.design.changed_model(change))
        overrides = self.design.overrides | dict(change.overrides)
        ranges, together = set_of(model, self.over, overrides)
        plants = PlantSet(model, overrides, ranges, self.modes, together)
        return ShortSearch(plants, goal or self.goal, random)

    def figures(self, change: Change = NO_CHANGE) -> FiguresOverSet | None:
        """Returns the worst values over the set of plants of a changed design. The gain is the
        largest one that keeps the margins. Returns None if no gain keeps the margins."""
        spec = change.spec or LoopSpec(timing=self.design.timing)
        bits = change.firmware.get("adc_bits", self.goal.adc_bits)
        goal = replace(self.goal_of(bits), timings=(spec.timing,))
        try:
            found = self.problem(change, goal, random=0).worst(spec.bank or Bank(1.0))
        except InputError:  # A plant of the set is unstable at every gain.
            return None
        if found.worst is None:
            return None
        return FiguresOverSet(**vars(found.worst), firmware_gain=found.bank.force_gain)

    def designed(self) -> list[Change]:
        """Returns the two changes from the present control law to a filter bank that is designed
        for the set of plants. The first change keeps the present ADC. The second change also has an
        ADC of more bits."""
        made = []
        finer = [c.firmware["adc_bits"] for c in converter(self.design)]
        for bits in (self.goal.adc_bits, *finer):
            problem = self.problem(goal=self.goal_of(bits))
            text = f"designed bank, {reduced.NAME}" + (f", ADC of {bits} bits" if finer else "")
            found = problem.designed()
            if found.worst:
                change = banked(self.design, text, found.bank)
                made.append(replace(change, firmware={"adc_bits": bits}))
        return made


def advise(order: AdviceOrder) -> Advice:
    """Returns the advice for a model or an experiment: the performance of the present design and of
    each change. Raises InputError."""
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
    """Returns (present design, rows of the advice), with the gain limits from simulated runs of the
    firmware."""
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
    """Returns the rows of the advice with their changes, sorted by rank. `group` computes the worst
    values over a set of plants; None means that the advice has no set of plants."""
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
    """Returns the largest gain of the firmware up to which all simulated contacts are stable.

    The function simulates a series of gains up to 1.3 times the linear limit. It looks for the
    smallest stable gain, and for the next gain that is not stable. Two finer series between these
    gains give the result with an error of one per cent. Gains below the smallest stable one are
    ignored, because the approach is then so slow that the force does not settle in time. Below the
    linear limit, the axis may either settle in contact or have a limit cycle. The result is
    therefore valid only for the approach of the experiment. The force ripple is that at quiet_gain,
    or at half of the result without quiet_gain.
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
