"""Proposes bounds for the evaluation elements of a cycle program from recorded parts. The module
forceaxis.cycles.propose describes the method."""

from collections.abc import Iterable
from pathlib import Path

from forceaxis._core import InputError
from forceaxis.cycles import propose
from forceaxis.cycles.live import LiveProgram
from forceaxis.cycles.outcome import BAD, GOOD, PartOutcome
from forceaxis.cycles.record import PartRecord
from forceaxis.cycles.records import RecordedParts


def own_parts(records: Iterable[PartRecord], wanted: LiveProgram) -> list[PartRecord]:
    """Returns those parts that were pressed with the cycle program `wanted` and have the verdict
    good or bad."""
    crc = f"{wanted.program.crc:08X}"
    return [r for r in records if r.program_crc == crc and r.state in (GOOD, BAD)]


def outcome_of(record: PartRecord) -> PartOutcome:
    """Converts the record of a pressed part to an outcome, as the simulation of a part gives it."""
    return PartOutcome(
        state=record.state,
        outcome=record.outcome,
        failed_phase=record.phase,
        verdicts=[element.verdict for element in record.elements],
        values=[0.0 if e.value is None else e.value for e in record.elements],
    )


def teach(
    parts: RecordedParts,
    wanted: LiveProgram,
    rate: float,
    file: Path,
) -> propose.Proposal:
    """Writes the cycle program `wanted` with proposed bounds to `file`. All recorded parts are
    assumed to be good. The bounds refuse the fraction `rate` of later parts of the same kind.
    Raises ParameterError, InputError."""
    records = own_parts(parts.records, wanted)
    if not records:
        raise InputError(
            f"{parts.source}: expected parts that were pressed with the program "
            f"{wanted.program.file} (CRC {wanted.program.crc:08X}), got {len(parts.records)} "
            "parts that were pressed with other programs; name the program of these parts in "
            "`program`"
        )
    target = propose.Target(file, propose.checked_by(wanted.experiment, wanted.overrides))
    outcomes = [outcome_of(record) for record in records]
    return propose.propose_from(wanted.program, outcomes, rate, target)
