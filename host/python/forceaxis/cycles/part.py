"""One simulated part: verdict, values of the elements, and when and why each phase ended."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core, paths, toml
from forceaxis._core import InputError
from forceaxis.cycles.program import (
    END,
    SHAPES,
    Element,
    End,
    Phase,
    Program,
    program_file,
    read_program,
    with_program,
)
from forceaxis.experiments import run as runs
from forceaxis.experiments.run_result import Array, CycleReport
from forceaxis.experiments.summary import CYCLE_OUTCOMES

# Objects of the firmware that the timeline needs in the trace.
TRACED = ("cycle_state", "cycle_phase", "contact", "position_actual")
RUNNING = 1  # value of cycle_state while a cycle runs
SLACK = 1e-9  # N or m, for decimals of a level


@dataclass(frozen=True)
class ElementFigure:
    """What an element found, with its bounds in `unit`. A window and an envelope have no bounds
    that are one number."""

    name: str
    kind: str
    verdict: str
    value: float | None  # None: nothing was found
    unit: str
    least: float | None
    most: float | None


@dataclass(frozen=True)
class PhaseSpan:
    """One phase of the cycle."""

    name: str
    begin_s: float
    end_s: float
    why: str  # it ended: the condition, the exceeded limit, or "stopped"


@dataclass(frozen=True)
class PartResult:
    """The cycle of one part."""

    experiment: str
    program: str
    title: str
    state: str  # "good", "bad", "aborted", or why there is no verdict
    outcome: str  # how the cycle ended
    failed_phase: str  # empty if the cycle ended as its program intends
    elements: list[ElementFigure]
    phases: list[PhaseSpan]
    fault: str
    trace_hash: str


@dataclass(frozen=True)
class Curve:
    """The measured curve of the last cycle, with one value for each of its n ticks."""

    time_s: Array  # since the start of the run
    travel_m: Array  # from travel 0 of the program
    force_N: Array
    phase: NDArray[np.int64]  # number of the phase to which the sample belongs


@dataclass(frozen=True)
class PartPicture:
    """What the plot of a part shows."""

    title: str
    state: str
    program: Program
    elements: Sequence[ElementFigure]
    phases: Sequence[PhaseSpan]
    curve: Curve


@dataclass(frozen=True)
class PartRun:
    """A simulated part with its curve, which is None if no cycle was started."""

    result: PartResult
    report: CycleReport
    program: Program
    curve: Curve | None


def run(experiment: Path, overrides: Sequence[str] = (), program: Path | None = None) -> PartRun:
    """Simulates one part. `program` replaces the program of the experiment. Raises InputError."""
    given = with_program(overrides, program)
    file = program_file(experiment, given)
    done = runs.run(experiment, given, text=_traced(experiment))
    report = done.result.cycle
    assert report is not None
    known = read_program(file)
    curve = _curve(done, known)
    result = PartResult(
        experiment=paths.display(experiment),
        program=paths.display(file),
        title=report.title,
        state=report.state,
        outcome=report.outcome,
        failed_phase=report.failed_phase,
        elements=_figures(report, known),
        phases=[] if curve is None else timeline(curve, known, report, _contact(done, curve)),
        fault=done.result.fault,
        trace_hash=done.result.trace_hash,
    )
    return PartRun(result, report, known, curve)


def _traced(experiment: Path) -> str:
    """Returns the text of an experiment that also traces the objects of the timeline."""
    import tomlkit

    table = toml.read(experiment)
    text = experiment.read_text(encoding="utf-8")
    wanted = list(dict.fromkeys([*table.get("trace", {}).get("objects", []), *TRACED]))
    try:
        document = tomlkit.parse(text)
    # tomlkit may refuse a text that the TOML reader of the experiments accepts
    except tomlkit.exceptions.ParseError as error:
        raise InputError(
            f"{experiment}: file: expected TOML that can be edited, got: {error}"
        ) from None
    if "trace" not in document:
        document["trace"] = tomlkit.table()
    trace = document["trace"]
    if not isinstance(trace, dict):
        raise InputError(f"{experiment}: trace: expected a table; write [trace]")
    trace["objects"] = wanted
    return tomlkit.dumps(document)


def _figures(report: CycleReport, program: Program) -> list[ElementFigure]:
    return [
        ElementFigure(
            name=figure.name,
            kind=figure.kind,
            verdict=figure.verdict,
            value=None if figure.verdict in ("not reached", "aborted") else figure.value,
            unit=figure.unit,
            least=None if element.kind in SHAPES else element.least,
            most=None if element.kind in SHAPES else element.most,
        )
        for figure, element in zip(report.figures, program.elements, strict=False)
    ]


def _last_cycle(done: runs.Run) -> tuple[int, int] | None:
    """Returns the first and the last tick of the last cycle. The sample of the tick in which a
    cycle ends belongs to it."""
    running = np.flatnonzero(done.columns["cycle_state"] == RUNNING)
    if not running.size:
        return None
    breaks = np.flatnonzero(np.diff(running) > 1)
    begin = int(running[breaks[-1] + 1] if breaks.size else running[0])
    return begin, min(int(running[-1]) + 1, len(done.columns["cycle_state"]) - 1)


def _curve(done: runs.Run, program: Program) -> Curve | None:
    """Returns the curve of the last cycle of a program."""
    begin, end = _last_cycle(done) or (0, 0)
    if begin == end:
        return None
    inside = slice(begin + 1, end + 1)  # the state of a tick is that after the tick
    converters = done.result.converters
    force = _physical(done, "adc0")[inside]
    per_count = abs(converters["encoder"].per_code)
    position = done.columns["encoder"].astype(float) * per_count
    if program.zero == "position":
        homed = done.columns["position_actual"].astype(float) * per_count
        zero = (program.zero_at or 0.0) + position[begin] - homed[begin]
    else:
        at_zero = np.flatnonzero(_is_at_zero(program, force, done.columns["contact"][inside]))
        zero = position[inside][at_zero[0]] if at_zero.size else position[begin]
    # A trace has the values after a tick, so the sample of a tick belongs to the phase before it.
    phase = done.columns["cycle_phase"][begin:end].astype(np.int64)
    return Curve(done.time_s[inside], position[inside] - zero, force, phase)


def _is_at_zero(program: Program, force: Array, contact: Array) -> NDArray[np.bool_]:
    """Returns which samples are at or beyond what makes travel 0: a contact, or a force."""
    if program.zero == "touch" or program.zero_at is None:
        return np.asarray(contact != 0)
    sign = 1.0 if program.zero_at > 0 else -1.0
    return np.asarray(sign * force >= sign * program.zero_at - SLACK)


def _physical(done: runs.Run, column: str) -> Array:
    converter = done.result.converters[column]
    return np.asarray((done.columns[column].astype(float) - converter.zero) * converter.per_code)


def _contact(done: runs.Run, curve: Curve) -> Array:
    """Returns whether the axis is in contact, for each tick of a curve."""
    begin = int(np.searchsorted(done.time_s, curve.time_s[0]))
    return np.asarray(done.columns["contact"][begin : begin + len(curve.time_s)] != 0)


def timeline(
    curve: Curve, program: Program, report: CycleReport, contact: Array
) -> list[PhaseSpan]:
    """Returns the phases of a cycle in the order in which they ran.

    The firmware does not record the condition that ended a phase. It is the only one that leads to
    the phase that followed, or of several the first one that the curve meets.
    """
    starts = [0, *(np.flatnonzero(np.diff(curve.phase)) + 1).tolist()]
    ends = [*starts[1:], len(curve.phase)]
    failing = _failing(curve, starts, program, report)
    step = 1 / _core.TICKS_PER_SECOND
    spans = []
    for i, (start, end) in enumerate(zip(starts, ends, strict=True)):
        phase = program.phases[int(curve.phase[start])]
        following = END if i + 1 == len(starts) else program.phases[int(curve.phase[end])].name
        if i == failing:
            why = CYCLE_OUTCOMES.get(report.outcome, report.outcome)
        elif following == END and report.state == "running":
            why = "the run ended"
        else:
            inside = slice(start, end)
            piece = Curve(
                curve.time_s[inside], curve.travel_m[inside], curve.force_N[inside],
                curve.phase[inside],
            )  # fmt: skip
            why = why_ended(phase, following, piece, contact[inside], report)
        begin_s, end_s = float(curve.time_s[start]) - step, float(curve.time_s[end - 1])
        spans.append(PhaseSpan(phase.name, round(begin_s, 9), round(end_s, 9), why))
    return spans


def _failing(
    curve: Curve, starts: Sequence[int], program: Program, report: CycleReport
) -> int | None:
    """Returns the index of the piece of the curve in which the cycle failed, or None."""
    if not report.failed_phase:
        return None
    names = [program.phases[int(curve.phase[start])].name for start in starts]
    if report.outcome == "stopped":
        return len(names) - 1
    where = [i for i, name in enumerate(names) if name == report.failed_phase]
    on_limit = next(p.on_limit for p in program.phases if p.name == report.failed_phase)
    fits = [i for i in where if (*names, END)[i + 1] == on_limit]
    found = fits or where
    return found[-1] if found else None


def why_ended(
    phase: Phase, following: str, piece: Curve, contact: Array, report: CycleReport
) -> str:
    """Returns why a phase ended and the phase `following` began, as text."""
    candidates = [end for end in phase.ends if end.next == following]
    if not candidates:
        return "limit" if report.failed_phase else report.outcome
    if len(candidates) == 1:
        return candidates[0].text
    met = [end for end in candidates if _is_met(end, piece, contact)]
    return (met or candidates)[0].text


def _is_met(end: End, piece: Curve, contact: Array) -> bool:
    """Returns True if the last sample of a phase meets a condition, as far as a trace shows it."""
    force, travel = float(piece.force_N[-1]), float(piece.travel_m[-1])
    value = 0.0 if end.value is None else end.value
    match end.when:
        case "time":
            return bool(len(piece.time_s) >= value * _core.TICKS_PER_SECOND - 1)
        case "force_above":
            return force >= value - SLACK
        case "force_below":
            return force <= value + SLACK
        case "travel_above":
            return abs(travel - float(piece.travel_m[0])) >= value - SLACK
        case "touch_above":
            return travel >= value - SLACK
        case "touch_below":
            return travel <= value + SLACK
        case "contact":
            return bool(contact[-1])
        case "lost":
            return not contact[-1]
    return False


def short(name: str) -> str:
    """Returns the name of a phase or element as a label."""
    return name.replace("_", " ")


def phase_samples(element: Element, program: Program, curve: Curve) -> NDArray[np.bool_]:
    """Returns which samples of a curve an element evaluates."""
    numbers = [i for i, phase in enumerate(program.phases) if phase.name in element.phases]
    return np.isin(curve.phase, numbers)
