"""Updates the firmware of one axis over its bus. The flash memory has two slots for firmware
images. The update is written to the slot whose image does not run. Then the axis is restarted with
the new image, and the image is confirmed after ten seconds."""

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from forceaxis import progress
from forceaxis._core import InputError
from forceaxis.axis.axis import Axis, OwnerObjects
from forceaxis.axis.link import COMMAND_SOURCES, VERSION_INDEX, Link, NoAnswer, Refused
from forceaxis.bus.state_names import POWERED
from forceaxis.chip.update_file import UpdateRecord

# Values of the object program_control. START is defined by CiA 302-3, CONFIRM by forceaxis.
START, CONFIRM = 1, 128
# Longest time in s until a restarted axis answers.
# If the new image hangs, the watchdog resets the chip.
# After four resets of the new image by the watchdog, the axis starts the earlier image.
RESTART_MAX_S = 20.0
POLL_S = 0.25
# CONFIRM_S: time in s without an overrun after which an axis accepts a confirmation.
# CONFIRM_MAX_S: time in s for which this program repeats its request to confirm the image.
CONFIRM_S, CONFIRM_MAX_S = 10.0, 20.0
REFUSALS = {
    "no_update": "expected an update of forceaxis, got another file",
    "other_board": "expected an update for the board of the axis, got an update for another board",
    "other_table": "expected an update with the object table of the axis, got another table",
    "other_link": "expected an image that is linked for the slot that does not run, got another "
    "one",
    "wrong_length": "expected the number of bytes that the head of the update states, got another "
    "number; the file is not complete",
    "not_confirmed": "expected an axis whose running image is confirmed; restart it until the "
    "image before returns, or confirm the image",
    "wrong_crc": "expected the CRC that the head of the update states, got another one; write it "
    "again",
    "flash_failed": "expected the flash memory to keep what was programmed, got other bytes; the "
    "axis continues with its present image",
}


@dataclass(frozen=True)
class ProgramObjects:
    """State of the firmware images in the two slots of an axis. `program_crc_1` belongs to the
    image that runs, `program_crc_2` to the image in the other slot."""

    program_slot: str
    program_state: str
    program_crc_1: int
    program_crc_2: int


@dataclass(frozen=True)
class RefusalObjects:
    """The object that states why an axis has refused an update of its firmware."""

    program_refusal: str | int


@dataclass(frozen=True)
class HealthObjects:
    """Objects that show why an axis does not confirm a firmware image."""

    overruns: int
    core_fault_pc: int
    store_state: str


@dataclass(frozen=True)
class UpdateResult:
    """Result of an update. `outcome` is "updated", or "unchanged" if the axis already ran the new
    image. `version` and `table` are the firmware version and the hash of the object table of the
    new image. `previous` is the version that the axis reported before the update."""

    axis: str
    outcome: str
    slot: str
    version: str
    table: str
    previous: str | None


class UpdateFailedError(Exception):
    """Error: the axis does not run the new image. The exit status of the command is 1."""


def update(
    connect: Callable[[], Link], records: Sequence[UpdateRecord], new_table: bool = False
) -> UpdateResult:
    """Updates the firmware of one axis. `connect`: function that returns a new connection to the
    axis. `records`: the firmware images for both slots. `new_table`: True permits an image whose
    object table differs from the object table of the axis.

    Raises InputError if the axis may not be updated now or if the update is not for this axis. In
    this case, nothing was erased. Raises Refused or UpdateFailedError if the update fails. The axis
    then runs its previous image, or returns to it. Also raises NoAnswer.
    """
    with contextlib.ExitStack() as stack:
        axis = _axis_at(connect())
        stack.callback(axis.close)
        where, before = axis.link.where, axis.link.text(VERSION_INDEX)
        found = _expect_updatable(axis)
        running, record = _records(found, records)
        facts = record.version, f"{record.table:08x}", before
        if found.program_crc_1 == running.crc:
            return UpdateResult(where, "unchanged", found.program_slot, *facts)
        table = axis.integer("object_table_hash")
        if record.table != table and not new_table:
            raise InputError(
                f"{where}: expected a firmware image with the object table of the axis, "
                f"{table:08x}, got an image with the object table {record.table:08x}; read which "
                "objects change, then use `new_table`"
            )
        axis.acquire()
        _write(axis, record.download(table if new_table else record.table))
        axis.link.write({"program_control": START})
    return _confirmed(connect, record, UpdateResult(where, "updated", "", *facts))


def _expect_updatable(axis: Axis) -> ProgramObjects:
    """Checks that the axis is disabled, has no other owner, and runs a confirmed image. Returns the
    state of its firmware images. Raises InputError."""
    where, now = axis.link.where, axis.record(OwnerObjects)
    if now.state in POWERED:
        raise InputError(
            f"{where}: expected a disabled axis, got an axis in the state "
            f"{now.state}; disable the axis first"
        )
    if now.command_source not in (COMMAND_SOURCES[0], COMMAND_SOURCES[axis.link.source]):
        raise InputError(
            f"{where}: expected an axis that no other client controls, got an axis that a client "
            f"on the bus {now.command_source} controls; end that client first"
        )
    try:
        found = axis.record(ProgramObjects)
    except Refused:
        raise InputError(
            f"{where}: expected an axis whose firmware can be updated over a bus, got an axis "
            "without the object program_slot; use a debug probe"
        ) from None
    if found.program_state == "no_slots":
        raise InputError(
            f"{where}: expected a board with two slots for firmware images, got a board without "
            "slots; use a debug probe"
        )
    if found.program_state != "confirmed":
        raise InputError(f"{where}: {REFUSALS['not_confirmed']}")
    return found


def _records(
    found: ProgramObjects, records: Sequence[UpdateRecord]
) -> tuple[UpdateRecord, UpdateRecord]:
    """Returns the two `records` of an update in the order (image for the slot that runs, image for
    the other slot). Slot a has the lower address."""
    ordered = sorted(records, key=lambda one: one.address)
    return (ordered[0], ordered[1]) if found.program_slot == "a" else (ordered[1], ordered[0])


def _write(axis: Axis, data: bytes) -> None:
    where = axis.link.where
    try:
        with progress.bar(f"writing {where}", len(data)) as shown:
            axis.link.download_update(data, lambda count: shown(count, len(data)))
    except Refused as error:
        reason = axis.record(RefusalObjects).program_refusal
        raise InputError(f"{where}: {REFUSALS.get(str(reason), str(error))}") from None
    reason = axis.record(RefusalObjects).program_refusal
    if reason != "none":
        why = REFUSALS.get(str(reason), f"the axis refuses the update, reason {reason}")
        raise InputError(f"{where}: {why}")


def _confirmed(
    connect: Callable[[], Link], record: UpdateRecord, result: UpdateResult
) -> UpdateResult:
    """Waits until the restarted axis answers, and then confirms its new image."""
    with contextlib.ExitStack() as stack:
        axis, found = _restarted(connect, result.axis)
        stack.callback(axis.close)
        if found.program_crc_1 != record.crc:
            raise UpdateFailedError(
                f"{result.axis}: expected the new image to run, but the axis has returned to its "
                "previous image"
            )
        with progress.phase("confirming the image"):
            axis.acquire()
            axis.link.wait(CONFIRM_S)
            _confirm(axis)
        return UpdateResult(
            result.axis, result.outcome, found.program_slot, result.version, result.table,
            result.previous,
        )  # fmt: skip


def _axis_at(link: Link) -> Axis:
    """Returns the axis of a connection. If the axis does not answer, closes the connection, because
    an open connection locks a serial device."""
    try:
        return Axis(link)
    except BaseException:
        link.close()
        raise


def _restarted(connect: Callable[[], Link], where: str) -> tuple[Axis, ProgramObjects]:
    end = time.monotonic() + RESTART_MAX_S
    with progress.phase("restarting the axis"):
        # The axis answers until it restarts. Therefore this program waits before its first request.
        time.sleep(4 * POLL_S)
        while True:
            axis = None
            try:
                axis = _axis_at(connect())
                return axis, axis.record(ProgramObjects)
            except (NoAnswer, Refused):
                if axis is not None:
                    axis.close()
            if time.monotonic() > end:
                raise NoAnswer(
                    f"{where}: expected an answer within {RESTART_MAX_S:g} s after the restart; "
                    "the axis returns to its previous image at the next resets"
                )
            time.sleep(POLL_S)


def _confirm(axis: Axis) -> None:
    for passed in axis.link.polls(CONFIRM_MAX_S):
        try:
            axis.link.write({"program_control": CONFIRM})
            return
        except Refused:
            if passed > CONFIRM_MAX_S - 2 * POLL_S:
                break
            axis.link.wait(POLL_S)
    health = axis.record(HealthObjects)
    raise UpdateFailedError(
        f"{axis.link.where}: the axis does not take the confirmation of its new image "
        f"({health.overruns} overruns, fault of the core at {health.core_fault_pc:#x}, store "
        f"{health.store_state}); four restarts bring the previous image back"
    )
