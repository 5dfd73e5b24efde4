"""Simulates the press cycle of one part. The result has the verdict on the part, the values of the
evaluation elements, and the start, the end and the reason for the end of each phase."""

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

# Objects of the firmware that a simulation must trace, because timeline() needs their values.
TRACED = ("cycle_state", "cycle_phase", "cycle_ended_by", "contact", "position_actual")
RUNNING = 1  # value of the object cycle_state while a cycle runs
# rounding error, in N or m, that is permitted when a value is compared with a level of the file
SLACK = 1e-9
# verdicts of an evaluation element that has found no value
NOTHING_FOUND = ("none", "not reached", "aborted")


@dataclass(frozen=True)
class ElementFigure:
    """The result of an evaluation element, with its bounds in `unit`. Windows and envelopes have
    bounds that are not single numbers, and these bounds are not included."""

    name: str
    kind: str
    verdict: str
    value: float | None  # value in `unit`; None if the evaluation element has found no value
    unit: str
    least: float | None
    most: float | None


@dataclass(frozen=True)
class PhaseSpan:
    """One phase of a press cycle: when the phase began and ended, and why it ended."""

    name: str
    begin_s: float
    end_s: float
    # reason for the end of the phase: a fulfilled condition, an exceeded limit, or "stopped"
    why: str


@dataclass(frozen=True)
class PartResult:
    """The result of the press cycle of one part."""

    experiment: str
    program: str
    title: str
    state: str  # verdict "good", "bad" or "aborted", or the reason why there is no verdict
    outcome: str  # text that says how the press cycle ended
    # name of the phase that failed; empty if the cycle ended as its program intends
    failed_phase: str
    # number of ticks in evaluated phases that have no valid sample of force and travel
    invalid_ticks: int
    elements: list[ElementFigure]
    phases: list[PhaseSpan]
    fault: str
    trace_hash: str


@dataclass(frozen=True)
class Curve:
    """The curve of a press cycle: time, travel, force and phase, as the evaluation elements use
    them. Each array has one value for each sample."""

    # time in s since the start of the simulation; on a real axis, since the start of the cycle
    time_s: Array
    # travel in m from the origin that the cycle program defines, minus the deflection of the press
    travel_m: Array
    force_N: Array  # measured force in N, minus the offset that a tare in the cycle has measured
    phase: NDArray[np.int64]  # number of the phase of the cycle to which the sample belongs


@dataclass(frozen=True)
class TickCurve(Curve):
    """The curve of the last press cycle of a simulation, with a sample for every tick."""

    # number, from 1, of the condition that ended a phase in this tick; 0 if no phase ended
    ended_by: NDArray[np.int64]


@dataclass(frozen=True)
class PartPicture:
    """The data from which the plot of a pressed part is drawn."""

    title: str
    state: str
    program: Program
    elements: Sequence[ElementFigure]
    phases: Sequence[PhaseSpan]
    curve: Curve


@dataclass(frozen=True)
class PartRun:
    """The simulation of one part: result, curve and cycle program. The curve is None if no cycle
    was started."""

    result: PartResult
    report: CycleReport
    program: Program
    curve: TickCurve | None


def run(experiment: Path, overrides: Sequence[str] = (), program: Path | None = None) -> PartRun:
    """Simulates the press cycle of one part. `program`: file of a cycle program that replaces the
    cycle program of the experiment, or None. Raises InputError."""
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
    """Returns the text of an experiment file, extended so that the objects TRACED are also
    traced."""
    import tomlkit

    table = toml.read(experiment)
    text = experiment.read_text(encoding="utf-8")
    wanted = list(dict.fromkeys([*table.get("trace", {}).get("objects", []), *TRACED]))
    try:
        document = tomlkit.parse(text)
    # tomlkit may refuse a text that the usual TOML reader of experiments accepts.
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
    """Returns the result of an evaluation element of a cycle, with its bounds. The value is None if
    the element has found no value."""
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
    """Returns the numbers of the first and of the last tick of the last cycle. In the last tick the
    cycle ends."""
    running = np.flatnonzero(done.columns["cycle_state"] == RUNNING)
    if not running.size:
        return None
    breaks = np.flatnonzero(np.diff(running) > 1)
    begin = int(running[breaks[-1] + 1] if breaks.size else running[0])
    return begin, min(int(running[-1]) + 1, len(done.columns["cycle_state"]) - 1)


def _curve(done: runs.Run, program: Program) -> TickCurve | None:
    """Returns the curve of the last press cycle in a simulation."""
    begin, end = _last_cycle(done) or (0, 0)
    if begin == end:
        return None
    # In its first tick, the cycle begins and has its first sample.
    inside = slice(begin, end + 1)
    converters = done.result.converters
    # The trace contains the phase after each tick.
    # A sample therefore belongs to the phase that was traced one tick before.
    # The first sample belongs to the first phase.
    phase = np.append(0, done.columns["cycle_phase"][begin:end].astype(np.int64))
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
    """Returns the force of each sample minus the offset that the last tare before the sample has
    measured."""
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
    """Returns the deflection of the press in m for each force in `force`."""
    if not program.compliance:
        return np.zeros_like(force)
    forces, deflections = np.array(program.compliance).T
    return np.asarray(np.interp(force, forces, deflections))


def _pieces(phase: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Returns the sample range of each phase that ran, as a pair: index of its first sample, and
    index after its last sample."""
    starts = [0, *(np.flatnonzero(np.diff(phase)) + 1).tolist()]
    return list(zip(starts, [*starts[1:], len(phase)], strict=True))


def _is_at_zero(program: Program, force: Array, contact: Array) -> NDArray[np.bool_]:
    """Returns, for each sample, True if it fulfils the condition that defines travel 0. The
    condition is a contact or a force."""
    if program.zero == "touch" or program.zero_at is None:
        return np.asarray(contact != 0)
    sign = 1.0 if program.zero_at > 0 else -1.0
    return np.asarray(sign * force >= sign * program.zero_at - SLACK)


def _physical(done: runs.Run, column: str) -> Array:
    converter = done.result.converters[column]
    return np.asarray((done.columns[column].astype(float) - converter.zero) * converter.per_code)


def timeline(curve: TickCurve, program: Program, report: CycleReport) -> list[PhaseSpan]:
    """Returns the phases of a press cycle in the order in which they ran."""
    pieces = _pieces(curve.phase)
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
        begin_s, end_s = float(curve.time_s[max(start - 1, 0)]), float(curve.time_s[end - 1])
        spans.append(PhaseSpan(phase.name, round(begin_s, 9), round(end_s, 9), why))
    return spans


def short(name: str) -> str:
    """Returns the name of a phase or of an evaluation element as a short label."""
    return name.replace("_", " ")


def phase_samples(element: Element, program: Program, curve: Curve) -> NDArray[np.bool_]:
    """Returns, for each sample of a curve, True if an evaluation element uses this sample."""
    numbers = [i for i, phase in enumerate(program.phases) if phase.name in element.phases]
    return np.isin(curve.phase, numbers)
