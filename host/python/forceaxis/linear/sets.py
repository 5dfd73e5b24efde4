"""Force loops over a set of plants: ranges of parameters, several combinations of element states,
and several delays of the loop."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from forceaxis import toml
from forceaxis.errors import ParameterError
from forceaxis.linear import curves, limits, over, plant_set, settings
from forceaxis.linear.curves import Curve, CurveTable, LoopBode, PlantBode
from forceaxis.linear.limits import AnalysedLoop, StepResponse
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import Member
from forceaxis.linear.request import LoopRequest, one_gain
from forceaxis.linear.settings import ModelSettings
from forceaxis.linear.stability import Loop
from forceaxis.linear.system import System
from forceaxis.results import json_field

BOTH_TIMINGS = ("zoh", "zoh+1")


@dataclass(frozen=True)
class SetMember:
    """One force loop of a set: its plant, as {parameter: SI value} and {element: state}, and the
    delay of the loop."""

    values: dict[str, float]
    modes: dict[str, str]
    timing: str

    @classmethod
    def of(cls, member: Member, timing: str) -> "SetMember":
        """Returns the SetMember for the force loop around the plant `member` with the delay
        `timing`."""
        return cls(member.values, member.modes, timing)

    def label(self) -> str:
        """Text for a user that names the force loop. It has parameter values, states and delay,
        such as "k_w = 288,900, drive.amplifier = high outer, zoh"."""
        return f"{Member(self.values, self.modes).label()}, {self.timing}"


@dataclass(frozen=True)
class RangeEntry:
    """The range of one parameter in a set of plants, in SI units."""

    nominal: float
    low: float
    high: float


@dataclass(frozen=True)
class SetEntry:
    """Description of a set of plants for the JSON output: ranges of parameters, combinations
    {element: state}, and delays of the loops. `plants`: number of plants that stand for 95 % of a
    posterior, or None without a posterior."""

    ranges: dict[str, RangeEntry]
    modes: list[dict[str, str]]
    timings: tuple[str, ...]
    plants: int | None = json_field(omit_none=True)


@dataclass(frozen=True, kw_only=True)
class AnalysedSet:
    """The analysed set of force loops, for the JSON output. `loop`: the nominal loop."""

    loop: AnalysedLoop = json_field(inline=True)
    over: SetEntry


@dataclass(frozen=True, kw_only=True)
class WorstAtGain:
    """The worst bandwidth and margins over a set of force loops at one gain k, in the unit of the
    loop.

    firmware_gain: k in DAC codes per 8-bit count, or None if the loops do not feed back ADC 0.
    Bandwidths and margins are those of over.Worst. member: {name: loop with the worst value}. A
    name is that of a bandwidth or margin, "stable" or "sag". members: number of analysed loops.
    dead_law: value of limits.LoopAtGain for the nominal loop.
    """

    gain: float
    firmware_gain: float | None
    stable: bool
    fS_Hz: float | None
    fT_Hz: float | None
    Ms: float | None
    gain_margin: float | None
    phase_margin_deg: float | None
    known_to: float | None
    sag: bool
    members: int
    member: dict[str, SetMember]
    dead_law: str | None = json_field(omit_none=True)


@dataclass(frozen=True)
class NominalLimit:
    """Critical gain of the nominal force loop, and the gain above which rounding errors hide
    crossings of the stability boundary; see stability.Limit."""

    critical_gain: float | None
    known_to: float | None


@dataclass(frozen=True, kw_only=True)
class LimitOfSet:
    """The largest gain at which all force loops of a set are stable, and the loop that becomes
    unstable first.

    critical_gain: k in `unit`. None if all loops are stable at every gain, or at every gain up to
    known_to. at: worst bandwidth and margins at the gain of the request. The other fields are as in
    limits.LimitResult.
    """

    critical_gain: float | None
    unit: str
    frequency_hz: float | None
    known_to: float | None
    firmware_gain: float | None
    largest_firmware_gain: float | None
    member: SetMember
    nominal: NominalLimit
    analysed: AnalysedSet = json_field(inline=True)
    at: WorstAtGain | None = json_field(omit_none=True)


@dataclass(frozen=True, kw_only=True)
class MemberCurve(SetMember):
    """The frequency response of one force loop of a set, and the gain k of this loop."""

    gain: float
    table: CurveTable = json_field(inline=True)


@dataclass(frozen=True, kw_only=True)
class CurvesOfSet:
    """Frequency responses of the force loops of a set, and the worst bandwidth and margins. The
    nominal loops come first. `of`: transfer function of the loop in a Bode plot, or None in a
    Nyquist plot."""

    analysed: AnalysedSet = json_field(inline=True)
    unit: str
    at: WorstAtGain
    curves: list[MemberCurve]
    of: str | None = json_field(omit_none=True)


@dataclass(frozen=True, kw_only=True)
class MemberStep(SetMember):
    """The step response of one force loop of a set."""

    response: StepResponse = json_field(inline=True)


@dataclass(frozen=True, kw_only=True)
class WorstStep:
    """The largest overshoot or settling time in a set of step responses, and the force loop that
    has this value."""

    value: float
    member: SetMember = json_field(inline=True)


@dataclass(frozen=True, kw_only=True)
class StepOfSet:
    """The step responses of the force loops of a set. The nominal loops come first.

    gain: k of the nominal loop in `unit`. firmware_gain: k in DAC codes per 8-bit count, or None if
    the loops do not feed back ADC 0. stable: True if all loops are stable. worst: the loops with
    the largest overshoot ("overshoot") and the largest settling time ("settle_s").
    """

    analysed: AnalysedSet = json_field(inline=True)
    gain: float
    unit: str
    firmware_gain: float | None
    stable: bool
    worst: dict[str, WorstStep]
    members: list[MemberStep]


def wanted(request: LoopRequest, over: Sequence[str], modes: str | None) -> bool:
    """Returns True if the parameter ranges, element states and delays of a request specify more
    than one force loop."""
    return bool(over or modes or request.timing == "both")


@dataclass(frozen=True)
class LoopSet:
    """A set of force loops: the loop `spec` around each plant of `plants`, with each delay in
    `timings`."""

    plants: plant_set.PlantSet
    timings: tuple[str, ...]
    spec: LoopSpec
    gain: float | None  # gain k of all loops; None if a `force_gain` or no gain at all is given
    force_gain: float | None

    def loop(self, member: Member, timing: str) -> Loop:
        """Returns the force loop around one plant of the set, with the delay `timing`."""
        return self.plants.loop(member, timing, self.spec)

    def nominal(self) -> Loop:
        """Returns the force loop around the nominal plant with the first combination of element
        states."""
        return self.loop(self.plants.nominal()[0], self.timings[0])

    def drawn_gain(self) -> tuple[float | None, float | None]:
        """Returns the gain at which the force loops of the set are drawn, as (k, `force_gain`).
        Without a given gain, k is half the largest gain at which all loops are stable, or 1."""
        if self.gain is not None or self.force_gain is not None:
            return self.gain, self.force_gain
        largest = over.largest_gain(self.plants, self.timings, self.spec).gain
        return (largest or 2.0) / 2, None


def loop_set(request: LoopRequest, ranges: Sequence[str] = (), modes: str | None = None) -> LoopSet:
    """Returns the set of force loops that a request specifies. `ranges`: texts NAME=RANGE, or the
    file of a posterior, as in `plant_set.set_of`.

    modes: selects the combinations of element states. "visited": those that a run of the experiment
    visits. "all": all of them. "nominal": only that of the request. None: "nominal" if the request
    has states, otherwise "visited" for an experiment and "all" for a model. Raises InputError.
    """
    own = request.settings()
    spec = request.spec(own)
    spans, together = plant_set.set_of(own.model, ranges, own.overrides)
    states = _modes_of(request, own, modes)
    gain, force_gain = request.gain, request.firmware_gain
    if not request.has_gain:
        force_gain = spec.bank.force_gain if spec.bank else request.law_of(own).force_gain
    timings = BOTH_TIMINGS if request.timing == "both" else (spec.timing,)
    plants = plant_set.PlantSet(own.model, own.overrides, spans, states, together)
    found = LoopSet(plants, timings, spec, gain, force_gain)
    # This call raises ParameterError if a gain is out of range.
    one_gain(found.nominal(), gain, force_gain)
    return found


def _modes_of(
    request: LoopRequest, own: ModelSettings, modes: str | None
) -> tuple[dict[str, str], ...]:
    """Returns the combinations of element states of a set of plants. `modes`: as in loop_set()."""
    fixed = dict(request.states)
    if fixed and modes:
        raise ParameterError("modes", "expected either `modes` or `states`, got both")
    modes = modes or ("nominal" if fixed else "visited" if own.experiment else "all")
    if modes == "visited" and own.experiment is None:
        raise ParameterError(
            "modes", "visited: expected an experiment, got a model; use the value all or nominal"
        )
    if request.free and modes != "nominal":
        raise ParameterError(
            "modes",
            "expected nominal together with `free`, because the other values need a contact",
        )
    if modes == "visited":
        assert own.experiment is not None
        return over.modes_visited(own.experiment, own.texts, request.output)
    if modes == "all":
        return over.modes_all(own.model, own.overrides, request.output)
    return (fixed,)


def _analysed(found: LoopSet) -> AnalysedSet:
    """Returns the description of the set of force loops for the JSON output."""
    nominal = AnalysedLoop.of(found.nominal())
    _, comma, label = nominal.timing.partition(", ")
    bus = comma + label  # "" for a model without a bus
    return AnalysedSet(
        loop=replace(nominal, timing=" and ".join(found.timings) + bus),
        over=SetEntry(
            {name: RangeEntry(*span) for name, span in found.plants.ranges.items()},
            list(found.plants.modes),
            found.timings,
            len(found.plants.together) if found.plants.together != ({},) else None,
        ),
    )


def worst_at(found: LoopSet, gain: float | None, force_gain: float | None) -> WorstAtGain:
    """Returns the worst bandwidth and margins of a set of force loops, at a gain k or at a
    `force_gain` in DAC codes per 8-bit count."""
    nominal = found.nominal()
    k = over.gain_at(nominal, gain, force_gain)
    worst = over.worst(found.plants, found.timings, found.spec, gain, force_gain)
    return WorstAtGain(
        gain=k,
        firmware_gain=nominal.optional_firmware_gain(k),
        stable=worst.stable,
        fS_Hz=worst.fS_Hz,
        fT_Hz=worst.fT_Hz,
        Ms=worst.Ms,
        gain_margin=worst.gain_margin,
        phase_margin_deg=worst.phase_margin_deg,
        known_to=worst.known_to,
        sag=worst.sag,
        members=worst.members,
        member={name: SetMember.of(*who) for name, who in worst.member.items()},
        dead_law=limits.dead_law(nominal, k),
    )


def limit_of(found: LoopSet) -> LimitOfSet:
    """Returns the largest gain at which all force loops of a set are stable, and the worst
    bandwidth and margins at the gain of the set."""
    largest = over.largest_gain(found.plants, found.timings, found.spec)
    loop = found.loop(largest.member, largest.timing)
    own = found.nominal().limit()
    has_gain = found.gain is not None or found.force_gain is not None
    return LimitOfSet(
        critical_gain=largest.gain,
        unit=loop.unit,
        frequency_hz=largest.frequency_hz,
        known_to=largest.known_to,
        firmware_gain=loop.optional_firmware_gain(largest.gain),
        largest_firmware_gain=limits.largest_firmware_gain(loop, loop.limit()),
        member=SetMember.of(largest.member, largest.timing),
        nominal=NominalLimit(own.gain, own.known_to),
        analysed=_analysed(found),
        at=worst_at(found, found.gain, found.force_gain) if has_gain else None,
    )


def _members(found: LoopSet) -> Iterator[tuple[Member, str, Loop]]:
    """Yields (plant, delay, force loop) for each loop in a plot. The nominal plants of all
    combinations of element states come first."""
    for member in over.sample(found.plants):
        for timing in found.timings:
            yield member, timing, found.loop(member, timing)


def _curves_over(
    found: LoopSet,
    response: Callable[[Loop, float], System],
    span_hz: tuple[float, float],
    points: int,
    of: str | None = None,
) -> tuple[list[Curve], CurvesOfSet]:
    """Returns (curves, result) for the frequency responses of a set of force loops.
    `response(loop, k)`: function that returns a System with one input and one output.

    The first curve is nominal. The result contains the worst bandwidth and margins. `of`: as in
    CurvesOfSet.
    """
    gain, force_gain = found.drawn_gain()
    drawn, rows = [], []
    for member, timing, loop in _members(found):
        k = over.gain_at(loop, gain, force_gain)
        system = response(loop, k)
        one = curves.curve(system, f"{member.label()}, {timing}", span_hz, points=points)
        drawn.append(one)
        rows.append(MemberCurve(member.values, member.modes, timing, gain=k, table=one.table()))
    return drawn, CurvesOfSet(
        analysed=_analysed(found),
        unit=found.nominal().unit,
        at=worst_at(found, gain, force_gain),
        curves=rows,
        of=of,
    )


def nyquist_of(found: LoopSet) -> tuple[list[Curve], CurvesOfSet]:
    """Returns (curves, result) for a Nyquist plot of the loop gains of a set of force loops."""
    return _curves_over(found, curves.PARTS["loop"], curves.NYQUIST_HZ, 300)


def bode(
    request: LoopRequest,
    view: curves.BodeView,
    ranges: Sequence[str] = (),
    modes: str | None = None,
) -> tuple[list[Curve], LoopBode | PlantBode | CurvesOfSet]:
    """Returns (curves, result) for a Bode plot of a plant, of a force loop, or of a set of force
    loops.

    ranges, modes: as in loop_set().
    """
    several = wanted(request, ranges, modes)
    part = view.part or ("loop" if request.has_law or several else None)
    if part is None:
        table = toml.read(settings.find(request.model))
        part = "loop" if settings.is_experiment(table) else "plant"
    if part == "plant":
        if several or request.has_law:
            raise ParameterError(
                "of",
                "expected loop, closed or sensitivity together with a law or a set of plants, "
                "got plant",
            )
        return curves.bode_of(request, view)
    if view.input != "drive.command" or len(view.outputs) > 1:
        raise ParameterError("of", f"{part}: expected exactly one `output` and no `input`")
    request = replace(request, output=view.outputs[0])
    if not several:
        return curves.loop_bode_of(request, view, part)
    if view.vary:
        raise ParameterError(
            "vary",
            "expected `vary` without a set of plants (`over`, `modes`, or `timing` both); remove "
            "`vary` or the set",
        )
    found = loop_set(request, ranges, modes)
    curves.check_span(view.span_hz, found.timings[0])
    return _curves_over(found, curves.PARTS[part], view.span_hz, 250, of=part)


def step_of(found: LoopSet, duration_s: float) -> StepOfSet:
    """Returns the step responses of the force loops of a set. The nominal loops come first.
    `duration_s`: as in limits.step_response."""
    given = found.drawn_gain()
    rows = []
    for member, timing, loop in _members(found):
        response = limits.step_response(loop, over.gain_at(loop, *given), duration_s)
        rows.append(MemberStep(member.values, member.modes, timing, response=response))
    loop = found.nominal()
    gain = over.gain_at(loop, *given)
    worst = {
        "overshoot": _worst_step(rows, lambda response: response.overshoot),
        "settle_s": _worst_step(rows, lambda response: response.settle_s),
    }
    return StepOfSet(
        analysed=_analysed(found),
        gain=gain,
        unit=loop.unit,
        firmware_gain=loop.optional_firmware_gain(gain),
        stable=all(row.response.stable for row in rows),
        worst={name: step for name, step in worst.items() if step is not None},
        members=rows,
    )


def _worst_step(
    rows: Sequence[MemberStep], figure: Callable[[StepResponse], float | None]
) -> WorstStep | None:
    """Returns the step response with the largest overshoot or settling time. `figure`: function
    that returns one of these two values. Returns None if no step response has this value."""
    found: WorstStep | None = None
    for row in rows:
        value = figure(row.response)
        if value is not None and (found is None or value > found.value):
            member = SetMember(row.values, row.modes, row.timing)
            found = WorstStep(value=value, member=member)
    return found
