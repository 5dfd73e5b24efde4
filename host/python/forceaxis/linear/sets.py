"""A force loop over a set of plants: ranges of parameters, several modes, several delays."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from forceaxis import toml
from forceaxis.errors import ParameterError
from forceaxis.linear import curves, limits, over, plant_set, settings
from forceaxis.linear.limits import Summary
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import Member
from forceaxis.linear.request import LoopRequest, one_gain
from forceaxis.linear.settings import ModelSettings
from forceaxis.linear.stability import Loop
from forceaxis.linear.system import System

BOTH = ("zoh", "zoh+1")


def wanted(request: LoopRequest, over: Sequence[str], modes: str | None) -> bool:
    """Whether ranges, modes and timing specify more than one loop."""
    return bool(over or modes or request.timing == "both")


@dataclass(frozen=True)
class LoopSet:
    """A set of loops: that of `spec` around each of `plants` with each of `timings`."""

    plants: plant_set.PlantSet
    timings: tuple[str, ...]
    spec: LoopSpec
    gain: float | None  # k; None: force_gain is given, or no gain
    force_gain: float | None

    def loop(self, member: Member, timing: str) -> Loop:
        """The loop around one member."""
        return self.plants.loop(member, timing, self.spec)

    def nominal(self) -> Loop:
        """The loop around the nominal plant in its first mode."""
        return self.loop(self.plants.nominal()[0], self.timings[0])

    def drawn_gain(self) -> tuple[float | None, float | None]:
        """(k, force_gain) of the loops to draw: the given gain, otherwise half of the largest gain
        at which all loops are stable, or k = 1."""
        if self.gain is not None or self.force_gain is not None:
            return self.gain, self.force_gain
        largest = over.largest_gain(self.plants, self.timings, self.spec).gain
        return (largest or 2.0) / 2, None


def loop_set(request: LoopRequest, ranges: Sequence[str] = (), modes: str | None = None) -> LoopSet:
    """The LoopSet of a request over ranges, texts NAME=RANGE as in `plant_set.ranges_of`.

    modes: "visited" (the modes of a run of the experiment), "all", "nominal" (that of the request).
    None: nominal if the request has states, otherwise visited for an experiment and all for a
    model. Raises InputError.
    """
    own = request.settings()
    spec = request.spec(own)
    spans = plant_set.ranges_of(own.model, ranges, own.overrides)
    states = _modes_of(request, own, modes)
    gain, force_gain = request.gain, request.firmware_gain
    if not request.has_gain:
        force_gain = spec.bank.force_gain if spec.bank else own.force_gain
    timings = BOTH if request.timing == "both" else (spec.timing,)
    plants = plant_set.PlantSet(own.model, own.overrides, spans, states)
    found = LoopSet(plants, timings, spec, gain, force_gain)
    one_gain(found.nominal(), gain, force_gain)  # raises ParameterError for a gain out of range
    return found


def _modes_of(
    request: LoopRequest, own: ModelSettings, modes: str | None
) -> tuple[dict[str, str], ...]:
    """The modes of a set, as described in `loop_set`."""
    fixed = dict(request.states)
    if fixed and modes:
        raise ParameterError("modes", "expected without `states`, which names one of them")
    modes = modes or ("nominal" if fixed else "visited" if own.experiment else "all")
    if modes == "visited" and own.experiment is None:
        raise ParameterError("modes", "visited: expected an experiment; give all, or nominal")
    if request.free and modes != "nominal":
        raise ParameterError("modes", "expected nominal with `free`, modes are those in contact")
    if modes == "visited":
        assert own.experiment is not None
        return over.modes_visited(own.experiment, own.texts, request.output)
    if modes == "all":
        return over.modes_all(own.model, own.overrides, request.output)
    return (fixed,)


def _one(member: Member, timing: str) -> Summary:
    """A member for JSON."""
    return {"values": member.values, "modes": member.modes, "timing": timing}


def described(found: LoopSet) -> Summary:
    """The entry about the analysed set in the summary of a verb."""
    ranges = {n: dict(zip(("nominal", "low", "high"), r, strict=True))
              for n, r in found.plants.ranges.items()}  # fmt: skip
    modes = [dict(m) for m in found.plants.modes]
    return limits.describe_loop(found.nominal()) | {
        "timing": " and ".join(found.timings),
        "over": {"ranges": ranges, "modes": modes, "timings": list(found.timings)},
    }


def worst_summary(found: LoopSet, gain: float | None, force_gain: float | None) -> Summary:
    """The worst of each figure at a gain, and the member that has this worst figure."""
    nominal = found.nominal()
    k = over.gain_at(nominal, gain, force_gain)
    worst = over.worst(found.plants, found.timings, found.spec, gain, force_gain)
    return {
        "gain": k,
        "firmware_gain": nominal.firmware_gain(k) if nominal.codes_per_gain is not None else None,
        "stable": worst.stable,
        **{name: getattr(worst, name) for name in (*over.FIGURES, "known_to")},
        "sag": worst.sag,
        "members": worst.members,
        "member": {name: _one(*who) for name, who in worst.member.items()},
    }


def limit_summary(found: LoopSet) -> Summary:
    """The content of `forceaxis limit --over --json`."""
    largest = over.largest_gain(found.plants, found.timings, found.spec)
    gain, loop = largest.gain, found.loop(largest.member, largest.timing)
    own = found.nominal().limit()
    reading = loop.codes_per_gain is not None
    summary = {
        "critical_gain": gain,
        "unit": loop.unit,
        "frequency_hz": largest.frequency_hz,
        "known_to": largest.known_to,
        "firmware_gain": loop.firmware_gain(gain) if reading and gain else None,
        "largest_firmware_gain": limits.largest_firmware_gain(loop, loop.limit()),
        "member": _one(largest.member, largest.timing),
        "nominal": {"critical_gain": own.gain, "known_to": own.known_to},
        **described(found),
    }
    if found.gain is not None or found.force_gain is not None:
        summary["at"] = worst_summary(found, found.gain, found.force_gain)
    return summary


def _members(found: LoopSet) -> Iterator[tuple[Member, str, Loop]]:
    """(member, timing, loop) of the loops to draw; the nominal members of all modes are the
    first."""
    for member in over.sample(found.plants):
        for timing in found.timings:
            yield member, timing, found.loop(member, timing)


def _curves_over(
    found: LoopSet,
    response: Callable[[Loop, float], System],
    span_hz: tuple[float, float],
    points: int,
) -> tuple[list[curves.Curve], Summary]:
    """(curves, summary) of response(loop, k), a System with one input and output, over the set.

    The first curve is nominal; the summary contains the worst of each figure.
    """
    gain, force_gain = found.drawn_gain()
    drawn, rows = [], []
    for member, timing, loop in _members(found):
        k = over.gain_at(loop, gain, force_gain)
        system = response(loop, k)
        one = curves.curve(system, f"{member.label()}, {timing}", span_hz, points=points)
        drawn.append(one)
        rows.append(_one(member, timing) | {"gain": k} | one.summary())
    summary = described(found) | {
        "unit": found.nominal().unit,
        "at": worst_summary(found, gain, force_gain),
        "curves": rows,
    }
    return drawn, summary


def nyquist_of(found: LoopSet) -> tuple[list[curves.Curve], Summary]:
    """(curves, summary) of `forceaxis nyquist` over a set: loop gains."""
    return _curves_over(found, curves.PARTS["loop"], curves.NYQUIST_HZ, 300)


def bode(
    request: LoopRequest,
    view: curves.BodeView,
    ranges: Sequence[str] = (),
    modes: str | None = None,
) -> tuple[list[curves.Curve], Summary]:
    """(curves, summary) of `forceaxis bode`, for a plant, for a loop, or for a set of loops.

    ranges, modes: as in `loop_set`.
    """
    several = wanted(request, ranges, modes)
    part = view.part or ("loop" if request.has_law or several else None)
    if part is None:
        table = toml.read(settings.find(request.model))
        part = "loop" if settings.is_experiment(table) else "plant"
    if part == "plant":
        if several or request.has_law:
            raise ParameterError(
                "of", "expected loop, closed or sensitivity with a law or a set, got plant"
            )
        return curves.bode_of(request, view)
    if view.input != "drive.command" or len(view.outputs) > 1:
        raise ParameterError("of", f"{part}: expected no `input` and one `output`")
    request = replace(request, output=view.outputs[0])
    if not several:
        return curves.loop_bode_of(request, view, part)
    if view.vary:
        raise ParameterError("vary", "expected without `over`, `modes` and `timing` both")
    found = loop_set(request, ranges, modes)
    curves.check_span(view.span_hz, found.timings[0])
    drawn, summary = _curves_over(found, curves.PARTS[part], view.span_hz, 250)
    return drawn, summary | {"of": part}


def step_of(found: LoopSet, duration_s: float) -> Summary:
    """The result of `forceaxis step` over a set: the nominal response and those of other
    members."""
    given = found.drawn_gain()
    rows = []
    for member, timing, loop in _members(found):
        gain = over.gain_at(loop, *given)
        one = limits.step_summary(loop, gain, duration_s)
        rows.append(_one(member, timing) | {
            name: one[name] for name in ("stable", "rise_s", "settle_s", "overshoot", "final",
                                         "time_s", "value")
        })  # fmt: skip
    worst = {}
    stable = [row for row in rows if row["stable"]]
    for name in ("overshoot", "settle_s"):
        has = [row for row in stable if row[name] is not None]
        if has:
            row = max(has, key=lambda row: row[name])
            worst[name] = {"value": row[name]} | {n: row[n] for n in ("values", "modes", "timing")}
    loop = found.nominal()
    gain = over.gain_at(loop, *given)
    return described(found) | {
        "gain": gain,
        "unit": loop.unit,
        "firmware_gain": loop.firmware_gain(gain) if loop.codes_per_gain is not None else None,
        "stable": len(stable) == len(rows),
        "worst": worst,
        "members": rows,
    }
