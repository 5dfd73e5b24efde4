"""One simulated part: its verdict, the values of the evaluation elements, and when and why each
phase ended."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core, paths, toml
from forceaxis._core import InputError
from forceaxis.cycles.program import (
    Element,
    Program,
    end_text,
    read_program,
    with_program,
)
from forceaxis.experiments import run as runs
from forceaxis.experiments.run_result import Array, CycleReport
from forceaxis.experiments.summary import CYCLE_OUTCOMES

# Objects of the firmware that the timeline needs in the trace.
TRACED = ("cycle_state", "cycle_phase", "cycle_ended_by", "contact", "position_actual")
RUNNING = 1  # value of cycle_state while a cycle runs
SLACK = 1e-9  # N or m, for decimals of a level
NOTHING_FOUND = ("none", "not reached", "aborted")  # verdicts of an element without a value


@dataclass(frozen=True)
class ElementFigure:
    """The result of an evaluation element, with its bounds in `unit`. The bounds of a window or an
    envelope are not single numbers, so they are missing here."""

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
    why: str  # reason why the phase ended: the condition, the exceeded limit, or "stopped"


@dataclass(frozen=True)
class PartResult:
    """The cycle of one part."""

    experiment: str
    program: str
    title: str
    state: str  # "good", "bad", "aborted", or why there is no verdict
    outcome: str  # how the cycle ended
    failed_phase: str  # empty if the cycle ended as its program intends
    invalid_ticks: int  # ticks in evaluated phases whose sample is not valid
    elements: list[ElementFigure]
    phases: list[PhaseSpan]
    fault: str
    trace_hash: str


@dataclass(frozen=True)
class Curve:
    """The curve of a cycle as its elements see it, with one value for each of its n samples."""

    time_s: Array  # time since the start of the run; on a live axis, since the start of the cycle
    travel_m: Array  # depth: travel from travel 0, less the deflection of the press
    force_N: Array  # measured force less the offset of a tare
    phase: NDArray[np.int64]  # number of the phase to which the sample belongs


@dataclass(frozen=True)
class TickCurve(Curve):
    """The curve of the last cycle of a run, with the sample of every tick."""

    # number, from 1, of the condition that ended a phase in this tick; 0: a limit or a stop
    ended_by: NDArray[np.int64]


@dataclass(frozen=True)
class PartPicture:
    """The contents of the plot of a part."""

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
    curve: TickCurve | None


def run(experiment: Path, overrides: Sequence[str] = (), program: Path | None = None) -> PartRun:
    """Simulates one part. `program` replaces the program of the experiment. Raises InputError."""
    given = with_program(overrides, program)
    known = read_program(experiment, given)
    done = runs.run(experiment, given, text=_traced(experiment))
    report = done.result.cycle
    assert report is not None
    curve = _curve(done, known)
    result = PartResult(
        experiment=paths.display(experiment),
        program=paths.display(known.file),
        title=report.title,
        state=report.state,
        outcome=report.outcome,
        failed_phase=report.failed_phase,
        invalid_ticks=report.invalid_ticks,
        elements=_figures(report, known),
        phases=[] if curve is None else timeline(curve, known, report),
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


def figure_of(element: Element, verdict: str, value: float | None) -> ElementFigure:
    """Returns what an element found, with its bounds. It has no value if nothing was
    found."""
    return ElementFigure(
        name=element.name,
        kind=element.kind,
        verdict=verdict,
        value=None if verdict in NOTHING_FOUND else value,
        unit=element.unit,
        least=None if element.is_shape else element.least,
        most=None if element.is_shape else element.most,
    )


def _figures(report: CycleReport, program: Program) -> list[ElementFigure]:
    return [
        figure_of(element, figure.verdict, figure.value)
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


def _curve(done: runs.Run, program: Program) -> TickCurve | None:
    """Returns the curve of the last cycle of a program."""
    begin, end = _last_cycle(done) or (0, 0)
    if begin == end:
        return None
    inside = slice(begin + 1, end + 1)  # the state of a tick is that after the tick
    converters = done.result.converters
    # A trace has the values after a tick, so the sample of a tick belongs to the phase before it.
    phase = done.columns["cycle_phase"][begin:end].astype(np.int64)
    ended_by = done.columns["cycle_ended_by"][inside].astype(np.int64)
    measured = _physical(done, "adc0")
    force = _without_offset(program, measured[inside], phase, ended_by)
    per_count = abs(converters["encoder"].per_code)
    position = done.columns["encoder"].astype(float) * per_count
    place = position[inside] - _deflection(program, force)
    if program.zero == "position":
        homed = done.columns["position_actual"].astype(float) * per_count
        zero = (program.zero_at or 0.0) + position[begin] - homed[begin]
    else:
        at_zero = np.flatnonzero(_is_at_zero(program, force, done.columns["contact"][inside]))
        start = position[begin] - _deflection(program, measured[begin : begin + 1])[0]
        zero = place[at_zero[0]] if at_zero.size else start
    return TickCurve(done.time_s[inside], place - zero, force, phase, ended_by)


def _without_offset(
    program: Program, force: Array, phase: NDArray[np.int64], ended_by: NDArray[np.int64]
) -> Array:
    """Returns the force less the offset that the last tare before each sample has measured."""
    found = force.copy()
    for start, end in _pieces(phase):
        tared = program.phases[int(phase[start])]
        if tared.tare_s is None or not ended_by[end - 1]:
            continue
        if tared.ends[int(ended_by[end - 1]) - 1].when == "reached":
            ticks = max(1, int(np.ceil(tared.tare_s * _core.TICKS_PER_SECOND - 1e-6)))
            found[end:] = force[end:] - force[max(start, end - ticks) : end].mean()
    return found


def _deflection(program: Program, force: Array) -> Array:
    """Returns the deflection of the press at each force."""
    if not program.compliance:
        return np.zeros_like(force)
    forces, deflections = np.array(program.compliance).T
    return np.asarray(np.interp(force, forces, deflections))


def _pieces(phase: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Returns the first sample of each phase that ran, and the sample after its last one."""
    starts = [0, *(np.flatnonzero(np.diff(phase)) + 1).tolist()]
    return list(zip(starts, [*starts[1:], len(phase)], strict=True))


def _is_at_zero(program: Program, force: Array, contact: Array) -> NDArray[np.bool_]:
    """Returns which samples are at or beyond what makes travel 0: a contact, or a force."""
    if program.zero == "touch" or program.zero_at is None:
        return np.asarray(contact != 0)
    sign = 1.0 if program.zero_at > 0 else -1.0
    return np.asarray(sign * force >= sign * program.zero_at - SLACK)


def _physical(done: runs.Run, column: str) -> Array:
    converter = done.result.converters[column]
    return np.asarray((done.columns[column].astype(float) - converter.zero) * converter.per_code)


def timeline(curve: TickCurve, program: Program, report: CycleReport) -> list[PhaseSpan]:
    """Returns the phases of a cycle in the order in which they ran."""
    pieces = _pieces(curve.phase)
    step = 1 / _core.TICKS_PER_SECOND
    spans = []
    has_failed = False
    for i, (start, end) in enumerate(pieces):
        phase = program.phases[int(curve.phase[start])]
        is_last = i + 1 == len(pieces)
        by = int(curve.ended_by[end - 1])
        if is_last and report.state == "running":
            why = "the run ended"
        elif by:
            why = end_text(phase.ends[by - 1])
        elif is_last if report.outcome == "stopped" else not has_failed:
            why = CYCLE_OUTCOMES.get(report.outcome, report.outcome)
            has_failed = True
        else:
            why = "limit"
        begin_s, end_s = float(curve.time_s[start]) - step, float(curve.time_s[end - 1])
        spans.append(PhaseSpan(phase.name, round(begin_s, 9), round(end_s, 9), why))
    return spans


def short(name: str) -> str:
    """Returns the name of a phase or element as a label."""
    return name.replace("_", " ")


def phase_samples(element: Element, program: Program, curve: Curve) -> NDArray[np.bool_]:
    """Returns which samples of a curve an element evaluates."""
    numbers = [i for i, phase in enumerate(program.phases) if phase.name in element.phases]
    return np.isin(curve.phase, numbers)
