"""`forceaxis flash`: write an image of the firmware to the flash memory of a board, through a debug
probe or over the bus of the axis."""

import contextlib
import functools
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis._core import InputError
from forceaxis.axis.address import Address, examples
from forceaxis.chip import flash, update_file
from forceaxis.cli.common import Verb, as_json, fail, print_result
from forceaxis.cli.live_options import ENVIRONMENT, AxisConnection, Kinds, errors, on_option

if TYPE_CHECKING:
    from forceaxis.axis.update import UpdateResult

# The axis does not answer while it erases a firmware slot, which takes up to 2 s.
ANSWER_MAX_S = 5.0
UPDATED = Kinds(("can", "tcp", "serial"), "because an update is written over CAN or Modbus")


UPDATE_SUFFIX = ".update"


@dataclass(frozen=True)
class UpdateSummary:
    """The content of an update file, as `forceaxis flash --dry-run --json` prints it."""

    file: Path
    version: str
    table_hash: str
    board: str
    addresses: list[str]  # start addresses of the firmware slots, one for each image
    sizes: list[int]  # sizes of the images in bytes


@dataclass(frozen=True)
class FleetSummary:
    """The result that `forceaxis flash --json` prints for axes on a bus."""

    axes: list["UpdateResult"]


class MemoryAddress(click.ParamType[int]):
    """Type of an option for a 32-bit memory address, hexadecimal (0x08000000) or decimal."""

    name = "address"

    def convert(
        self, value: int | str, param: click.Parameter | None, ctx: click.Context | None
    ) -> int:
        if isinstance(value, int):
            return value
        try:
            number = int(value, 0)
        except ValueError:
            number = -1
        if not 0 <= number < 1 << 32:
            self.fail(f"expected an address of 32 bits such as 0x08000000, got {value}", param, ctx)
        return number


@click.command(
    name="flash",
    cls=Verb,
    epilog="""forceaxis flash build/image/forceaxis-stm32f446.hex
    forceaxis flash build/image/forceaxis-stm32f446.elf --dry-run
    forceaxis flash --on can0:1 --on can0:2 build/image/forceaxis-stm32f446.update
    forceaxis flash --on serial:/dev/ttyUSB0:1 build/image/forceaxis-stm32f446.update""",
)
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--address",
    type=MemoryAddress(),
    help="Start address of a .bin file. Default: that of the flash.",
)
@click.option(
    "--erase-parameters",
    is_flag=True,
    help="Erase the stored parameters too; the axis then has its default values.",
)
@click.option(
    "--serial", default="", help="Serial number of the debug probe, if there are several."
)
@click.option("--yes", is_flag=True, help="Do not ask for consent.")
@click.option(
    "--dry-run",
    is_flag=True,
    help="Write nothing; print the command of openocd, or what an update contains.",
)
@on_option(
    UPDATED,
    f"Address of an axis to update over its bus: {examples(UPDATED.kinds)}. Repeatable: the axes "
    f"are updated one after the other. Default, for a FILE ending in .update: {ENVIRONMENT}.",
    is_repeatable=True,
)
@click.option(
    "--new-table",
    is_flag=True,
    help="Permit an update with another object table than that of the axis.",
)
@as_json
def flash_(
    file: Path,
    address: int | None,
    erase_parameters: bool,
    serial: str,
    yes: bool,
    dry_run: bool,
    on: tuple[Address, ...],
    new_table: bool,
    as_json: bool,
) -> None:
    """Write a firmware image (.elf, .hex, .bin) to the flash memory of a board through a debug
    probe, or update the firmware of axes over their bus (.update).

    Over CAN or Modbus the command writes the slot that does not run, restarts the axis, and
    confirms the new image after ten seconds. An axis that is enabled or owned by another client,
    and an update for another board, object table or slot, is refused before anything is erased,
    with exit status 2. An image that hangs, or is not confirmed, is taken back: after at most four
    restarts the axis runs its previous image, and the exit status is 1. Parameters and incidents
    are kept. Several axes are updated one after the other. The command stops at the first one that
    fails.

    With a debug probe the program openocd writes the image. The command prints the contents of the
    file and the flash sectors that they occupy, asks for consent, writes, verifies and resets the
    chip. The stored parameters are kept. Switch the power of the drive off first: the chip controls
    no output while it is written. The exit status is 1 if there is no probe, if the chip is a
    different one, or if writing or verifying fails. It is 2 if the file is not an image of this
    firmware for a known board.
    """
    if on or file.suffix == UPDATE_SUFFIX:
        expect_only_bus_options(address, erase_parameters, serial)
        records = update_records(file)
        if dry_run:
            show_update(file, records, as_json)
            return
        chosen = AxisConnection(on, accepted=UPDATED).chosen()
        if not chosen.addresses:
            raise InputError(
                f"{file}: expected --on ADDRESS, such as {examples(UPDATED.kinds)}, because an "
                "update file is written over a bus; to write with a debug probe, give the .hex file"
            )
        update_fleet(records, chosen.addresses, new_table, as_json)
        return
    if new_table:
        raise InputError(
            "--new-table: expected --on ADDRESS together with --new-table; add --on ADDRESS"
        )
    plan = flash.plan(file, address, erase_parameters, serial)
    if dry_run:
        show(plan, as_json)
        if not as_json:
            click.echo(shlex.join(flash.command(plan)))
        return
    flash.expect_openocd()
    if not yes and (as_json or not sys.stdin.isatty()):
        raise InputError(
            "flash: expected the option --yes, because the command cannot ask for consent without "
            "a terminal"
        )
    show(plan, as_json, quiet=as_json)
    probe, chip = flash.find_probe(plan)
    if not as_json:
        click.echo(f"probe        {probe}\nchip         {chip}")
    if not yes and not click.confirm("Write it? The drive's power should be off."):
        raise flash.FlashError("nothing was written")
    flash.write(plan)
    text = "written      verified; the chip was reset and runs the image, the axis is disabled"
    print_result(flash.summary(plan, probe, chip), as_json, lambda: text)


def expect_only_bus_options(
    address: int | None,
    erase_parameters: bool,
    serial: str,
) -> None:
    """Raise InputError if the user gave an option that is only for writing by a debug probe."""
    if address is not None or erase_parameters or serial:
        raise InputError(
            "--address, --erase-parameters, --serial: expected none of these options for an "
            "update over a bus, because only a debug probe uses these options; remove them"
        )


def update_records(file: Path) -> list[update_file.UpdateRecord]:
    """Return the images of an update file. Raise InputError if the file is not an update file."""
    try:
        return update_file.read(file)
    except update_file.UpdateFileError as error:
        raise InputError(str(error)) from None


def show_update(file: Path, records: list[update_file.UpdateRecord], as_json: bool) -> None:
    """Print what an update file contains."""
    first = records[0]
    found = UpdateSummary(
        file, first.version, f"{first.table:08x}", first.board,
        [f"{one.address:#010x}" for one in records], [len(one.image) for one in records],
    )  # fmt: skip
    rows = (
        ("file", f"{found.file}"),
        ("version", found.version),
        ("objects", found.table_hash),
        ("board", found.board),
        *(
            ("image", f"{size} bytes for the slot at {address}")
            for address, size in zip(found.addresses, found.sizes, strict=True)
        ),
    )
    print_result(found, as_json, lambda: "\n".join(f"{name:12} {value}" for name, value in rows))


def update_fleet(
    records: list[update_file.UpdateRecord],
    axes: tuple[Address, ...],
    new_table: bool,
    as_json: bool,
) -> None:
    """Update axes over their bus, one after the other, and print the result of each axis. The
    command ends with exit status 1 after the first axis that fails."""
    from forceaxis.axis.link import NoAnswer, Refused
    from forceaxis.axis.update import UpdateFailedError, update

    if len(axes) > 1:
        for axis in axes:  # a wrong address is refused before the first axis is updated
            with contextlib.suppress(NoAnswer, Refused):
                axis.link(ANSWER_MAX_S).close()
    done: list[UpdateResult] = []
    for axis in axes:
        with errors(AxisConnection((axis,))):
            try:
                found = update(functools.partial(axis.link, ANSWER_MAX_S), records, new_table)
            except UpdateFailedError as error:
                fail(str(error), status=1)
            done.append(found)
            if not as_json:
                click.echo(result_text(found))
    if as_json:
        print_result(FleetSummary(done), as_json, lambda: "")


def result_text(found: "UpdateResult") -> str:
    """Return one text line about the update of one axis."""
    if found.outcome == "unchanged":
        return f"{found.axis}: unchanged, it runs version {found.version} in slot {found.slot}"
    return (
        f"{found.axis}: updated to version {found.version}, object table {found.table}, in slot "
        f"{found.slot}; confirmed, the axis is disabled"
    )


def show(plan: flash.Plan, as_json: bool, quiet: bool = False) -> None:
    """Print on standard output what will be written to the chip. Print on standard error a warning
    about the firmware image. With `quiet`, print only the warning."""
    if plan.warning:
        click.echo(f"forceaxis: warning: {plan.warning}", err=True)
    if not quiet:
        print_result(flash.summary(plan), as_json, lambda: plan_text(plan))


def plan_text(plan: flash.Plan) -> str:
    """Return a text about a firmware image: its version, the flash sectors that it overwrites, and
    whether the stored parameters are kept."""
    who, image, parameters = plan.identity, plan.image, plan.board.memory.parameters
    options = plan.probe.options
    starts = [sector.start for sector in flash.sectors_of(plan.board)]
    sectors = ", ".join(
        f"{n} ({'parameters, ' if starts[n] in parameters else ''}{starts[n]:#010x})"
        for n in plan.sectors
    )
    rows = (
        ("file", f"{image.path}"),
        ("size", f"{image.size} bytes"),
        ("sectors", sectors),
        ("version", who.version),
        ("git", who.git),
        ("objects", who.table_hash),
        ("board", who.board),
        (
            "parameters",
            "erased: the axis starts with defaults" if plan.erase_parameters else "kept",
        ),
        *([("options", options.title)] if options else []),
    )
    return "\n".join(f"{name:12} {value}" for name, value in rows)


VERBS = (flash_,)
