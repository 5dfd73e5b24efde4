"""Evaluates parts from recorded curves of force over travel, which any press may have recorded. The
evaluation elements are computed by the code of the firmware, in counts, with one tick for each
sample.

    press = JudgePress(Path("press_fit"))                            # an experiment, or
    press = JudgePress(Path("program.toml"), Counts(1e-6, 0.01))     # a program alone
    part = judge(press, recording, "part 1")

A verdict rests on valid samples alone. An element is invalid, with a note that says why, if a
sample in one of its phases is not valid. If it evaluates the travel, it is also invalid if a sample
before travel 0 is not valid. A part with an invalid element is bad.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from forceaxis import _core, paths, toml
from forceaxis._core import InputError
from forceaxis.cycles import curve_samples, propose
from forceaxis.cycles.curve_samples import MISSING, VALID, CurveCounts, Flags, Integers, Ranges
from forceaxis.cycles.outcome import ABORTED, BAD, BY_PROGRAM, GOOD
from forceaxis.cycles.part import ElementFigure, PhaseSpan, figure_of
from forceaxis.cycles.program import Element, Program
from forceaxis.cycles.record import PartRecord
from forceaxis.cycles.teach import outcome_of
from forceaxis.errors import ParameterError
from forceaxis.experiments.run_result import CycleReport
from forceaxis.experiments.summary import quantity
from forceaxis.recordings.findings import runs, spike_notes
from forceaxis.recordings.importing import Imported
from forceaxis.recordings.signal_recording import SignalRecording
from forceaxis.words import counted

INVALID = "invalid"  # verdict of an evaluation element with a sample that is not valid
SAMPLES_INVALID = "samples_invalid"
# largest relative difference between the size of a count of a recording and of the experiment
SCALE_TOLERANCE = 0.01
# Objects that the firmware subtracts from the codes of the force sensor.
OFFSETS = ("force_zero_code", "force_tare")
OPEN = (-math.inf, math.inf)
AFTER_END = 255  # phase of the samples after the end of the cycle
# A curve presses again after its cycle if its force first falls below LOW_SHARE of the peak.
# The force of such a curve then rises above HIGH_SHARE of the peak.
LOW_SHARE, HIGH_SHARE = 0.1, 0.5
# Conditions for the end of a phase that do not depend on force, travel and time alone.
NOT_IN_A_CURVE = ("reached", "input_on", "input_off")
OF_CONTACT = ("contact", "lost")


@dataclass(frozen=True)
class Counts:
    """The sizes of one count of travel and one count of force, with which a cycle program without
    an experiment is evaluated.
    """

    travel_m: float  # one count of travel
    # force in N of one count; the range of forces is 131,071 counts in each direction
    force_N: float
    contact_N: float | None = None  # force above which the tool is in contact; None: unknown


@dataclass(frozen=True)
class JudgePress:
    """The cycle program with which curves are evaluated, and the sizes of its counts. `file`: an
    experiment, whose axis defines the counts, or the file of a cycle program, which needs `counts`.
    """

    file: Path
    counts: Counts | None = None
    overrides: Sequence[str] = ()
    ranges: Ranges = field(default_factory=Ranges)  # of the sensors of the curves
    _judges: dict[float, "_core.CurveJudge"] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        is_alone = isinstance(toml.read(self.file).get("phase"), list)
        where = paths.display(self.file)
        if is_alone and self.counts is None:
            raise ParameterError(
                "travel_count", f"expected the size of a count of travel and of a count of force, "
                f"because {where} is a program alone; give `travel_count` 1um and `force_count` "
                "5mN, or an experiment that names the program",
            )  # fmt: skip
        if not is_alone and self.counts is not None:
            raise ParameterError(
                "travel_count", f"expected no size of a count, because the experiment {where} "
                "states it; remove the option",
            )  # fmt: skip

    def at(self, rate_hz: float) -> "_core.CurveJudge":
        """Returns the program for curves with this number of samples per second. Raises
        InputError."""
        if rate_hz not in self._judges:
            self._judges[rate_hz] = self.read(self.file, rate_hz)
        return self._judges[rate_hz]

    def read(self, file: Path, rate_hz: float) -> "_core.CurveJudge":
        """Reads another experiment or cycle program in place of `file`, with the same sizes of
        counts. Raises InputError.
        """
        if self.counts is None:
            return _core.CurveJudge.of_experiment(file, list(self.overrides), rate_hz)
        own = self.counts
        return _core.CurveJudge.of_program(
            file, own.travel_m, own.force_N, rate_hz, own.contact_N
        )  # fmt: skip

    @property
    def own(self) -> "_core.CurveJudge":
        """The compiled cycle program, whose CRC identifies it in records. Its sampling rate is the
        tick rate of the axis for an experiment, and the rate of the first evaluated curve for a
        cycle program without an experiment."""
        if self.counts is None:
            return self.at(_core.TICKS_PER_SECOND)
        return next(iter(self._judges.values()))

    def expect_scales(self, recording: SignalRecording, where: str) -> None:
        """Raises InputError for a recording of the axis itself in which a count has another size
        than in the experiment, or in which the force is given as ADC codes with an offset."""
        if self.counts is not None or not curve_samples.is_traced(recording):
            return
        known = _core.inputs(self.file, list(self.overrides))
        for signal in recording:
            converter = known["converters"].get(signal.column)
            if signal.name not in curve_samples.UNITS or converter is None:
                continue
            wanted = abs(converter["per_code"])
            if abs(signal.factor / wanted - 1) > SCALE_TOLERANCE:
                raise InputError(
                    f"{where}: {signal.name}: expected {quantity(wanted, signal.unit)} for a count "
                    f"of {signal.column}, as in the experiment, got "
                    f"{quantity(signal.factor, signal.unit)}; import this signal with the size of "
                    "the experiment, or give the experiment of this axis"
                )
            offsets = [name for name in OFFSETS if known["firmware"].get(name)]
            if signal.name == "force" and offsets:
                raise InputError(
                    f"{where}: force: expected the measured force, got the codes of "
                    f"{signal.column}, from which {' and '.join(offsets)} of the experiment are "
                    "not subtracted; import a column with the measured force"
                )

    def ranges_of(self, recording: SignalRecording) -> Ranges:
        """Returns the ranges of the sensors of a recording. A recording of the axis itself needs
        only the range of its force sensor, which the experiment describes."""
        if self.counts is None and curve_samples.is_traced(recording):
            return replace(self.ranges, force_N=self.ranges.force_N or OPEN,
                           position_m=self.ranges.position_m or OPEN)  # fmt: skip
        return self.ranges

    def check_program(self, file: Path) -> None:
        """Reads the file of a changed program as a check. Raises InputError."""
        if self.counts is None:
            propose.checked_by(self.file, self.overrides)(file)
        for rate_hz in self._judges:
            self.read(file, rate_hz)


@dataclass(frozen=True)
class JudgedPart:
    """A part that was evaluated from a recorded curve."""

    file: str
    rate_hz: float
    # True if the conditions of the cycle program decided where phases begin and end
    by_program: bool
    is_interpolated: bool  # True if the position was interpolated at the times of the force
    phases: list[PhaseSpan]  # phases of the part, with times of the recording
    record: PartRecord
    # notes about the import of the curve from a file of another program, and about its spikes
    import_notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Judged:
    """The result of the evaluation of several curves."""

    program: str
    title: str
    travel_count_m: float
    force_count_N: float
    parts: list[JudgedPart]

    @property
    def records(self) -> list[PartRecord]:
        """The records of all parts."""
        return [part.record for part in self.parts]


def phase_number(program: Program, name: str) -> int:
    """Returns the number of a phase of a program. Raises ParameterError."""
    names = [phase.name for phase in program.phases]
    if name not in names:
        raise ParameterError("phase", f"expected one of the phases {', '.join(names)}, got {name}")
    return names.index(name)


def leading_phases(program: Program) -> set[int]:
    """Returns the numbers of the phases that any evaluation element uses, and of all phases that
    can come before such a phase."""
    names = [phase.name for phase in program.phases]
    used = {names.index(name) for element in program.elements for name in element.phases}
    return _with_leading(_followers(program), used)


def repeated_phases(program: Program) -> set[int]:
    """Returns the numbers of the phases to which a cycle can come back."""
    after = _followers(program)
    return {k for k in range(len(after)) if after[k] & _with_leading(after, {k})}


def _followers(program: Program) -> list[set[int]]:
    """Returns, for each phase, the numbers of the phases that can come next."""
    names = {phase.name: k for k, phase in enumerate(program.phases)}
    targets = [[*(end.next for end in phase.ends), phase.on_limit] for phase in program.phases]
    return [{names[name] for name in found if name in names} for found in targets]


def _with_leading(after: list[set[int]], found: set[int]) -> set[int]:
    """Returns the phases `found` and all that can come before them. `after`: as of _followers()."""
    while more := {k for k, nexts in enumerate(after) if k not in found and nexts & found}:
        found = found | more
    return found


def expect_followable(judge: "_core.CurveJudge", where: str) -> int:
    """Returns the result of leading_phases() as an integer with one bit for each phase. Raises
    InputError or ParameterError if a curve of force and travel does not show when these phases end.
    """
    program = judge.program()
    leading = leading_phases(program)
    phases = [program.phases[k] for k in sorted(leading)]
    ends = [(phase.name, end.when) for phase in phases for end in phase.ends]
    for name, when in ends:
        if when in NOT_IN_A_CURVE:
            raise InputError(
                f"{where}: expected a signal phase with the number of the phase of each sample, "
                f"because the phase {name} of {paths.display(program.file)} ends on {when}, which "
                "a curve does not show; import this signal, or name the phase of all samples in "
                "`phase`"
            )
        if when in OF_CONTACT:
            _expect_contact(judge, f"the phase {name} ends on {when}")
    return sum(1 << k for k in leading)


def _expect_contact(judge: "_core.CurveJudge", why: str) -> None:
    if not judge.knows_contact:
        raise ParameterError(
            "contact_force",
            f"expected the force above which the tool is in contact, because {why}; give "
            "`contact_force` 4N",
        )  # fmt: skip


def judge(
    press: JudgePress, recording: SignalRecording, where: str, phase: str | None = None
) -> JudgedPart:
    """Evaluates the only part of a recorded curve, as judge_parts() does. Raises InputError,
    ParameterError."""
    parts = judge_parts(press, recording, where, phase)
    if len(parts) > 1:
        raise InputError(f"{where}: expected the curve of one part, got {len(parts)}")
    return parts[0]


def judge_parts(
    press: JudgePress, recording: SignalRecording, where: str, phase: str | None = None
) -> list[JudgedPart]:
    """Evaluates the parts of a recorded curve. The curve has several parts if its phases begin
    again. `where`: name of the recording in messages. `phase`: name of the phase of all samples if
    the recording names no phases, or None for the phases of the program. Raises InputError,
    ParameterError."""
    times = curve_samples.times_of(recording, where)
    press.expect_scales(recording, where)
    judge = _judge_of(press, times.rate_hz, where)
    program = judge.program()
    if program.zero == "touch":
        _expect_contact(judge, "travel 0 of the program is the first contact")
    curve = curve_samples.curve_of(
        recording, where, times, judge, None if phase is None else phase_number(program, phase),
        press.ranges_of(recording),
    )  # fmt: skip
    leading = expect_followable(judge, where) if curve.phase is None else None
    parts: list[JudgedPart] = []
    for rows, begin in curve_samples.cuts(
        curve, where, len(program.phases), repeated_phases(program)
    ):
        report, phases, zeroed_at = judge.judge(rows, leading)
        defect = curve.defect[begin : begin + len(phases)]
        ran = int(np.count_nonzero(phases != AFTER_END))
        ticks = Ticks(curve, begin, phases[:ran].astype(np.int64), defect[:ran], zeroed_at)
        notes = [] if parts else spike_notes([recording["force"], recording["position"]])
        parts.append(
            JudgedPart(
                file=where,
                rate_hz=curve.rate_hz,
                by_program=curve.phase is None,
                is_interpolated=curve.is_interpolated,
                phases=_spans(ticks, program),
                record=_record(press, program, report, ticks, Path(where).stem, len(parts) + 1),
                import_notes=[*notes, *_later_stroke(ticks, rows[1:, 1], ran)],
            )
        )
    return parts


def _later_stroke(ticks: "Ticks", force: Integers, ran: int) -> list[str]:
    """Returns a note if a curve presses once more after the end of its cycle. `force` (n,): force
    of its samples. `ran`: number of the samples of the cycle."""
    peak = int(force[:ran].max(initial=0))
    low = ran + np.flatnonzero(force[ran:] < LOW_SHARE * peak)
    if not len(low) or force[low[0] :].max() < HIGH_SHARE * peak:
        return []
    again = int(low[0]) + int(np.argmax(force[low[0] :] >= HIGH_SHARE * peak))
    return [
        f"the curve presses once more at {ticks.time_s(again):.6g} s, after the end of the cycle, "
        "which is not evaluated; record the phases, or cut the recording into one for each part"
    ]


def _judge_of(press: JudgePress, rate_hz: float, where: str) -> "_core.CurveJudge":
    """Returns the cycle program, compiled for the sampling rate of a curve. Raises InputError. The
    error is about the curve if the program can be compiled for the tick rate of an axis."""
    try:
        return press.at(rate_hz)
    except InputError as error:
        press.read(press.file, _core.TICKS_PER_SECOND)
        raise InputError(
            f"{where}: expected a curve whose sampling rate is permitted for the program, got "
            f"{rate_hz:g} samples per second; check the unit of its times ({error})"
        ) from None


@dataclass(frozen=True)
class Ticks:
    """The samples of a curve from the first to the last one of its cycle."""

    curve: CurveCounts
    begin: int  # number of the first sample in the curve
    phases: Integers
    defect: Integers
    zeroed_at: int  # index of the sample at which travel 0 was found

    def time_s(self, sample: int) -> float:
        """Returns the time of a sample in the recording."""
        return round(self.curve.begin_s + (self.begin + sample) / self.curve.rate_hz, 9) + 0.0

    def invalid_in(self, numbers: Sequence[int], uses_travel: bool) -> Flags:
        """Returns, for each sample, True if the sample is not valid and affects an evaluation
        element that uses the phases `numbers`. Missing samples may belong to the phase of the
        samples after them."""
        is_invalid = self.defect != VALID
        phases = np.isin(self.phases, numbers)
        is_missing = self.defect == MISSING
        after = phases.copy()
        for a, b in runs(is_missing).tolist():
            after[a:b] = b < len(phases) and phases[b]
        found = is_invalid & (phases | (is_missing & after))
        if uses_travel:
            found[: self.zeroed_at] |= is_invalid[: self.zeroed_at]
        return np.asarray(found)


def _spans(ticks: Ticks, program: Program) -> list[PhaseSpan]:
    starts = [0, *(np.flatnonzero(np.diff(ticks.phases)) + 1).tolist(), len(ticks.phases)]
    return [
        PhaseSpan(
            program.phases[int(ticks.phases[a])].name,
            ticks.time_s(a), ticks.time_s(b - 1), "",
        )
        for a, b in pairwise(starts)
    ]  # fmt: skip


def _record(
    press: JudgePress, program: Program, report: CycleReport, ticks: Ticks, serial: str, number: int
) -> PartRecord:
    """Returns the record of an evaluated part."""
    elements, notes = [], []
    for element, figure in zip(program.elements, report.figures, strict=True):
        found = figure_of(element, figure.verdict, figure.value)
        why = _why_invalid(element, program, ticks)
        if why:
            notes.append(f"{element.name} is invalid: {why}")
            found = replace(found, verdict=INVALID, value=None)
        elements.append(found)
    state, outcome = report.state, report.outcome
    if report.invalid_ticks and not notes:
        notes.append(
            f"the cycle is invalid: {_where_invalid(ticks.defect != VALID, program, ticks)}"
        )
    if notes and state != ABORTED:
        state, outcome = BAD, SAMPLES_INVALID if outcome == BY_PROGRAM else outcome
    return PartRecord(
        number=number,
        serial=serial,
        program=paths.display(program.file),
        title=program.title,
        program_number=program.number,
        program_crc=f"{press.own.program().crc:08X}",
        duration_s=len(ticks.phases) / ticks.curve.rate_hz,
        state=state,
        outcome=outcome,
        phase=report.failed_phase,
        invalid_ticks=report.invalid_ticks,
        notes=notes,
        elements=elements,
    )


def _why_invalid(element: Element, program: Program, ticks: Ticks) -> str:
    """Returns the reason why an evaluation element is not valid, or an empty text."""
    numbers = [k for k, phase in enumerate(program.phases) if phase.name in element.phases]
    found = ticks.invalid_in(numbers, element.over == "travel")
    return _where_invalid(found, program, ticks) if found.any() else ""


def _where_invalid(found: Flags, program: Program, ticks: Ticks) -> str:
    """Returns a text about the samples of a curve that are not valid. `found` is True for these
    samples."""
    first = int(np.flatnonzero(found)[0])
    reasons = [
        f"{counted(int(count), 'sample')} {text}"
        for reason, text in curve_samples.REASONS.items()
        if (count := np.count_nonzero(ticks.defect[found] == reason))
    ]
    phase = program.phases[int(ticks.phases[first])].name
    return f"{', '.join(reasons)}, from {ticks.time_s(first):.6g} s on, in phase {phase}"


def judge_all(
    press: JudgePress, files: Iterable[tuple[str, Sequence[Imported]]], phase: str | None = None
) -> Judged:
    """Evaluates the parts of several files. `files`: (name in messages, recordings) of each file
    in the order in which the parts were pressed; at least one. `phase`: as for judge_parts().
    Raises InputError, ParameterError."""
    parts: list[JudgedPart] = []
    for where, recordings in files:
        own: list[JudgedPart] = []
        for imported in recordings:
            found = judge_parts(press, imported.recording, where, phase)
            notes = [*imported.notes, *found[0].import_notes]
            own += [replace(found[0], import_notes=notes), *found[1:]]
        if len(own) > 1:  # the parts of a file have numbers
            own = [
                replace(one, file=f"{where}, part {k}",
                        record=replace(one.record, serial=f"{one.record.serial}_{k}"))
                for k, one in enumerate(own, 1)
            ]  # fmt: skip
        parts += own
    parts = [
        replace(one, record=replace(one.record, number=number))
        for number, one in enumerate(parts, 1)
    ]
    program = press.own.program()
    return Judged(
        program=paths.display(program.file),
        title=program.title,
        travel_count_m=1 / press.own.counts_per_m,
        force_count_N=1 / press.own.counts_per_N,
        parts=parts,
    )


def teach(press: JudgePress, judged: Judged, rate: float, file: Path) -> propose.Proposal:
    """Writes the program with proposed bounds to `file`, as teach.teach() does from recorded parts.
    All parts that are not aborted are assumed to be good. Raises ParameterError, InputError."""
    outcomes = [outcome_of(record) for record in judged.records]
    return propose.propose_from(
        press.own.program(), outcomes, rate, propose.Target(file, press.check_program)
    )


def counts_text(judged: Judged) -> str:
    """Returns the sizes of one count of travel and one count of force as text."""
    travel, force = (quantity(v, u) for v, u in ((judged.travel_count_m, "m"),
                                                 (judged.force_count_N, "N")))  # fmt: skip
    return f"{travel} of travel, {force} of force"


def not_good(record: PartRecord) -> list[ElementFigure]:
    """Returns the evaluation elements of a part that are not good."""
    return [element for element in record.elements if element.verdict != GOOD]
