"""Downloads a cycle program to an axis over a connection, and runs one press cycle.

An experiment describes the axis for which the program was made. Its model defines the size of a
count in m and N, and its table [firmware] contains the parameters. The scales of the real axis must
agree with these, because the program contains forces and travels in counts.
"""

import contextlib
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forceaxis import _core, paths
from forceaxis._core import InputError
from forceaxis.axis.drive import ENABLE, NEW_SETPOINT, Drive, StatusObjects
from forceaxis.axis.link import POLL_PERIOD_S, Refused
from forceaxis.cycles.program import Program, read_program
from forceaxis.cycles.program import with_program as overrides_of
from forceaxis.experiments.summary import NOT_STARTED
from forceaxis.objects import BY_NAME

MODE = "cycle"
PART_WORDS = BY_NAME["cycle_data_16"].number - BY_NAME["cycle_data_1"].number + 1
WORD_BYTES = 4
# Objects on which the meaning of the numbers in a cycle program depends.
# The numbers in a cycle program also depend on force_scale, which is compared with a tolerance.
SCALING = ("adc_bits", "force_sign", "rated_force", "feed", "polarity")
SCALE = "force_scale"
# largest relative difference between force_scale of the axis and force_scale of the model
FORCE_SCALE_TOLERANCE = 0.01
ENDED = ("good", "bad", "aborted")
# longest time in s for storing cycle programs, including the time to erase a flash sector
STORE_MAX_S = 15.0
PART_TIMEOUT_S = 3600.0  # longest time in s to wait for the end of a press cycle


@dataclass(frozen=True)
class LiveProgram:
    """A cycle program, and the experiment that describes the axis for which the program was
    made."""

    experiment: Path
    overrides: Sequence[str]
    program: Program


@dataclass(frozen=True)
class LoadedProgram:
    """A cycle program that an axis has accepted and selected."""

    program: str  # path of the program file
    title: str
    number: int
    crc: str  # CRC of the cycle program as 8 hexadecimal digits
    size_bytes: int
    programs: int  # number of cycle programs that the axis now contains
    store: str  # "stored"; "no_memory" or "failed" if a power cut would delete the cycle program


@dataclass(frozen=True)
class StoreObjects:
    """The object that shows whether the axis has stored its cycle programs and its counts of
    parts."""

    cycle_store_state: str
    fault: str


@dataclass(frozen=True)
class PartObjects(StatusObjects):
    """Objects of the axis about the running cycle in which a part is pressed."""

    cycle_state: str
    cycle_number: int  # number that the axis gave to the part that was pressed last
    fault: str


def live_program(
    experiment: Path, overrides: Sequence[str] = (), program: Path | None = None
) -> LiveProgram:
    """Returns the cycle program of an experiment. `program`: file of another cycle program for the
    same axis, or None. Raises InputError, also for a program with the number 0, because an axis
    cannot store it."""
    given = overrides_of(overrides, program)
    compiled = read_program(experiment, given)
    if compiled.number == 0:
        raise InputError(
            f"{compiled.file}: number: expected the number of the program, at least 1, because an "
            "axis selects a program by its number; add this key"
        )
    return LiveProgram(experiment, given, compiled)


def expect_same_axis(axis: Drive, wanted: LiveProgram) -> None:
    """Raises Refused if the axis and the experiment differ in an object on which the meaning of the
    numbers in the cycle program depends."""
    given = _core.inputs(wanted.experiment, list(wanted.overrides))["firmware"]
    own = {n: given.get(n, BY_NAME[n].default * BY_NAME[n].scale) for n in (*SCALING, SCALE)}
    for name in SCALING:
        found = axis.number(name)
        if found != own[name]:
            raise Refused(
                f"{axis.link.where}: expected {name} {own[name]:g} as in "
                f"{paths.display(wanted.experiment)}, got {found:g}; set {name}, or change the "
                "experiment"
            )
    found = axis.number(SCALE)
    if abs(found / own[SCALE] - 1) > FORCE_SCALE_TOLERANCE:
        raise Refused(
            f"{axis.link.where}: expected force_scale within {FORCE_SCALE_TOLERANCE:.0%} of "
            f"{own[SCALE]:g} uN/count, that of the experiment, got {found:g}; give the "
            "sensor of the model this scale"
        )


def load(axis: Drive, wanted: LiveProgram) -> LoadedProgram:
    """Downloads a cycle program to an axis that is disabled and that this client owns, and selects
    it. It replaces an earlier program with the same number. Raises Refused with the reason; the
    axis then has the same programs as before. Also raises NoAnswer."""
    expect_same_axis(axis, wanted)
    record = wanted.program.record
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
    axis.link.write({"cycle_program": wanted.program.number})
    crc = axis.integer("cycle_program_crc")
    if crc != wanted.program.crc:
        raise Refused(
            f"{axis.link.where}: expected the CRC {wanted.program.crc:08X} of the program, got "
            f"{crc:08X}; "
            "load it again"
        )
    return LoadedProgram(
        program=paths.display(wanted.program.file),
        title=wanted.program.title,
        number=wanted.program.number,
        crc=f"{wanted.program.crc:08X}",
        size_bytes=len(record),
        programs=axis.integer("cycle_program_count"),
        store=wait_stored(axis),
    )


def expect_readable(axis: Drive) -> None:
    """Raises Refused if the axis would not permit to read the curve after a cycle. Call this
    function before the cycle."""
    disturbance = axis.link.disturbance()
    if disturbance:
        raise Refused(disturbance)


def wait_stored(axis: Drive) -> str:
    """Waits until a disabled axis has stored its cycle programs and its counts of parts. Returns
    the value of the object `cycle_store_state`. Raises Refused, NoAnswer."""
    # The axis needs some ticks until it detects that data have to be stored.
    axis.link.wait(POLL_PERIOD_S)
    return axis.wait_for(
        StoreObjects,
        lambda now: now.cycle_store_state != "waiting",
        "programs and counts to be stored",
        STORE_MAX_S,
    ).cycle_store_state


def select(axis: Drive, wanted: LiveProgram) -> None:
    """Selects the cycle program `wanted` in an axis that this client owns, unless it is already
    selected. No program is selected after a power-up. Raises Refused if the axis does not contain
    the program `wanted`. In this case, the selection does not change."""
    crc = axis.integer("cycle_program_crc")
    if crc != wanted.program.crc:
        before = axis.integer("cycle_program")
        with contextlib.suppress(Refused):  # the axis contains no cycle program with this number
            axis.link.write({"cycle_program": wanted.program.number})
            if axis.integer("cycle_program_crc") == wanted.program.crc:
                return
            axis.link.write({"cycle_program": before})
    if crc != wanted.program.crc:
        has = "none" if crc == 0 else f"the CRC {crc:08X}"
        raise Refused(
            f"{axis.link.where}: expected the program {paths.display(wanted.program.file)} with "
            f"the CRC {wanted.program.crc:08X}, got {has}; use `load_program`"
        )


def start(axis: Drive, wanted: LiveProgram, timeout_s: float = PART_TIMEOUT_S) -> str | None:
    """Runs one cycle with the cycle program `wanted`. The axis must contain this program, and this
    client must own the axis. All limits of the axis apply, and the axis is disabled at the end.
    Returns the fault that has ended the cycle, or None. Raises Refused if no cycle starts, and
    NoAnswer if the cycle does not end within `timeout_s`."""
    expect_same_axis(axis, wanted)
    select(axis, wanted)
    wait_stored(axis)
    before = axis.integer("cycle_number")
    axis.enable(MODE)
    try:
        axis.link.write({"controlword": ENABLE})
        axis.link.write({"controlword": NEW_SETPOINT})
        found = axis.wait_for(
            PartObjects,
            lambda now: (
                now.cycle_state in NOT_STARTED
                or (now.cycle_state in ENDED and now.cycle_number != before)
            ),
            "the end of the cycle",
            timeout_s,
        )
        if found.cycle_state in NOT_STARTED:
            raise Refused(f"{axis.link.where}: no cycle started: {NOT_STARTED[found.cycle_state]}")
        return None if found.fault == "none" else found.fault
    finally:
        axis.off()
