"""Cycles of an axis on a connection: download of a program, one part, its result.

An experiment describes the axis for which the program was made: its model gives counts and newtons,
its table [firmware] the parameters. The axis has to agree with it, because the program's record has
counts of force and travel.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forceaxis import _core, paths
from forceaxis._core import InputError
from forceaxis.axis.axis import Axis
from forceaxis.axis.drive import ENABLE, NEW_SETPOINT, Drive, StatusObjects
from forceaxis.axis.link import Refused
from forceaxis.cycles.part import ElementFigure
from forceaxis.cycles.program import SHAPES, Element, Program, program_file, read_program
from forceaxis.cycles.program import with_program as overrides_of
from forceaxis.objects import BY_NAME

MODE = "cycle"
PART_WORDS = BY_NAME["cycle_data_16"].number - BY_NAME["cycle_data_1"].number + 1
WORD_BYTES = 4
# Where the number of a program is in its record (firmware/cycle/program.h).
NUMBER_OFFSET = 16
# Objects that give the numbers of a program their meaning. `force_scale` is compared apart.
SCALING = ("adc_bits", "force_sign", "rated_force", "feed", "polarity")
FORCE_SCALE_TOLERANCE = 0.01  # of the force sensor against the model, relative
ENDED = ("good", "bad", "aborted")
NOT_STARTED = ("no_program", "other_bank", "not_homed")
PART_TIMEOUT_S = 3600.0  # the longest phase


@dataclass(frozen=True)
class LiveProgram:
    """The program of an experiment, as an axis takes it and as its file describes it."""

    experiment: Path
    overrides: Sequence[str]
    record: bytes
    scales: Sequence[float]  # SI units for one unit of the firmware, of each element
    program: Program

    @property
    def number(self) -> int:
        """The number by which the axis selects the program."""
        return int(struct.unpack_from("<I", self.record, NUMBER_OFFSET)[0])

    @property
    def crc(self) -> int:
        """The CRC of the record, in its last four bytes."""
        return int(struct.unpack_from("<I", self.record, len(self.record) - WORD_BYTES)[0])


@dataclass(frozen=True)
class LoadedProgram:
    """A program that an axis has taken and selected."""

    program: str  # file
    title: str
    number: int
    crc: str  # 8 hexadecimal digits
    size_bytes: int
    programs: int  # number of programs that the axis has now


@dataclass(frozen=True)
class PartObjects(StatusObjects):
    """State of the cycle while a part is pressed."""

    cycle_state: str
    cycle_phase: int
    fault: str


@dataclass(frozen=True)
class OutcomeObjects:
    """How the last cycle of an axis ended."""

    cycle_state: str
    cycle_outcome: str
    cycle_phase: int
    cycle_count: int
    cycle_program: int
    cycle_program_crc: int


@dataclass(frozen=True)
class ElementObjects:
    """Result of the element that cycle_result_element names."""

    cycle_result_value: int
    cycle_result_verdict: str


@dataclass(frozen=True)
class LivePart:
    """The last part of an axis."""

    program: str  # file
    title: str
    program_crc: str
    cycles: int  # number of cycles since power-up, this one included
    state: str  # "good", "bad", "aborted", or why there is no verdict
    outcome: str  # how the cycle ended
    phase: str  # the last phase
    elements: list[ElementFigure]


def live_program(
    experiment: Path, overrides: Sequence[str] = (), program: Path | None = None
) -> LiveProgram:
    """Returns the program of an experiment, or another one for the same axis. Raises InputError,
    also for a program with the number 0, which no axis keeps."""
    given = overrides_of(overrides, program)
    file = program_file(experiment, given)
    found = LiveProgram(
        experiment, given, _core.cycle_record(experiment, given),
        _core.cycle_scales(experiment, given), read_program(file),
    )  # fmt: skip
    if found.number == 0:
        raise InputError(
            f"{file}: number: expected a number other than 0, by which an axis keeps the program; "
            "add it"
        )
    return found


def expect_same_axis(axis: Drive, wanted: LiveProgram) -> None:
    """Raises Refused if the axis differs from that of the experiment in an object that gives the
    numbers of the program their meaning."""
    with Axis.sim(wanted.experiment, wanted.overrides) as simulated:
        own = {name: simulated.number(name) for name in (*SCALING, "force_scale")}
    for name in SCALING:
        found = axis.number(name)
        if found != own[name]:
            raise Refused(
                f"{axis.link.where}: expected {name} {own[name]:g} as in "
                f"{paths.display(wanted.experiment)}, got {found:g}; set {name}, or change the "
                "experiment"
            )
    found = axis.number("force_scale")
    if abs(found / own["force_scale"] - 1) > FORCE_SCALE_TOLERANCE:
        raise Refused(
            f"{axis.link.where}: expected force_scale within {FORCE_SCALE_TOLERANCE:.0%} of "
            f"{own['force_scale']:g} uN/count, that of the experiment, got {found:g}; give the "
            "sensor of the model this scale"
        )


def load(axis: Drive, wanted: LiveProgram) -> LoadedProgram:
    """Downloads a program to an axis that is owned and disabled, and selects it. A program with the
    same number is replaced. Raises Refused with the reason, and then the axis has the programs that
    it had before; NoAnswer."""
    expect_same_axis(axis, wanted)
    record = wanted.record
    for offset in range(0, len(record), PART_WORDS * WORD_BYTES):
        piece = record[offset : offset + PART_WORDS * WORD_BYTES]
        words = struct.unpack(f"<{len(piece) // WORD_BYTES}I", piece)
        parts = {f"cycle_data_{i}": word for i, word in enumerate(words, 1)}
        axis.link.write({"cycle_data_offset": offset, **parts})
    try:
        axis.link.write({"cycle_data_end": len(record)})
    except Refused:
        reason = axis.get("cycle_program_refusal", "cycle_program_refused_part")
        if reason["cycle_program_refusal"] == "none":
            raise
        why = str(reason["cycle_program_refusal"]).replace("_", " ")
        raise Refused(
            f"{axis.link.where}: the axis refuses the program: {why}, part "
            f"{reason['cycle_program_refused_part']}"
        ) from None
    axis.link.write({"cycle_program": wanted.number})
    found = axis.record(OutcomeObjects)
    if found.cycle_program_crc != wanted.crc:
        raise Refused(
            f"{axis.link.where}: expected the CRC {wanted.crc:08X} of the program, got "
            f"{found.cycle_program_crc:08X}; load it again"
        )
    return LoadedProgram(
        program=paths.display(wanted.program.file),
        title=wanted.program.title,
        number=wanted.number,
        crc=f"{wanted.crc:08X}",
        size_bytes=len(record),
        programs=axis.integer("cycle_program_count"),
    )


def expect_selected(axis: Drive, wanted: LiveProgram) -> None:
    """Raises Refused if the axis has another program selected."""
    crc = axis.integer("cycle_program_crc")
    if crc != wanted.crc:
        has = "none" if crc == 0 else f"the CRC {crc:08X}"
        raise Refused(
            f"{axis.link.where}: expected the program {paths.display(wanted.program.file)} with "
            f"the CRC {wanted.crc:08X}, got {has}; use `forceaxis cycle load`"
        )


def start(axis: Drive, wanted: LiveProgram, timeout_s: float = PART_TIMEOUT_S) -> LivePart:
    """Runs one cycle with the selected program on an axis that is owned, and returns its part. All
    bounds of the axis hold; the axis is disabled at the end. Raises Refused if no cycle starts,
    NoAnswer if it does not end in `timeout_s`."""
    expect_same_axis(axis, wanted)
    expect_selected(axis, wanted)
    axis.enable(MODE)
    try:
        axis.link.write({"controlword": ENABLE})
        axis.link.write({"controlword": NEW_SETPOINT})
        found = axis.wait_for(
            PartObjects,
            lambda now: now.cycle_state in (*ENDED, *NOT_STARTED),
            "the end of the cycle",
            timeout_s,
        )
        if found.cycle_state in NOT_STARTED:
            why = found.cycle_state.replace("_", " ")
            raise Refused(f"{axis.link.where}: no cycle started: {why}")
    finally:
        axis.off()
    return result(axis, wanted)


def result(axis: Drive, wanted: LiveProgram) -> LivePart:
    """Returns the last part of an axis that is owned. Raises Refused, NoAnswer."""
    expect_selected(axis, wanted)
    found = axis.record(OutcomeObjects)
    program = wanted.program
    elements = []
    for i, (element, scale) in enumerate(zip(program.elements, wanted.scales, strict=True)):
        axis.link.write({"cycle_result_element": i})
        axis.link.wait(0.0)
        elements.append(_figure(element, scale, axis.record(ElementObjects)))
    return LivePart(
        program=paths.display(program.file),
        title=program.title,
        program_crc=f"{found.cycle_program_crc:08X}",
        cycles=found.cycle_count,
        state=found.cycle_state,
        outcome=found.cycle_outcome,
        phase=program.phases[found.cycle_phase].name,
        elements=elements,
    )


def _figure(element: Element, scale: float, found: ElementObjects) -> ElementFigure:
    verdict = found.cycle_result_verdict.replace("_", " ")
    is_found = verdict not in ("none", "not reached", "aborted")
    is_shape = element.kind in SHAPES
    return ElementFigure(
        name=element.name,
        kind=element.kind,
        verdict=verdict,
        value=found.cycle_result_value * scale if is_found else None,
        unit="" if element.kind == "window" else element.unit,
        least=None if is_shape else element.least,
        most=None if is_shape else element.most,
    )
