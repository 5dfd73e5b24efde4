"""`forceaxis flash`: write an image of the firmware to the flash memory of a board."""

import shlex
import sys
from pathlib import Path

import click

from forceaxis._core import InputError
from forceaxis.chip import flash
from forceaxis.cli.common import Verb, as_json, print_result


class Address(click.ParamType[int]):
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
    forceaxis flash build/image/forceaxis-stm32f446.elf --dry-run""",
)
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "--address",
    type=Address(),
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
@click.option("--dry-run", is_flag=True, help="Write nothing; print the command of openocd.")
@as_json
def flash_(
    file: Path,
    address: int | None,
    erase_parameters: bool,
    serial: str,
    yes: bool,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Write a firmware image (.elf, .hex, .bin) to the flash memory of a board. The program openocd
    writes the image through a debug probe.

    The command prints the contents of the file and the flash sectors that they occupy, asks for
    consent, writes, verifies and resets the chip. The stored parameters are kept. Switch the power
    of the drive off first: the chip controls no output while it is written. The exit status is 1 if
    there is no probe, if the chip is a different one, or if writing or verifying fails. It is 2 if
    the file is not an image of this firmware for a known board.
    """
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


def show(plan: flash.Plan, as_json: bool, quiet: bool = False) -> None:
    """Print on standard output what will be written to the chip, and on standard error a warning
    about the firmware image. With `quiet`, print only the warning."""
    if plan.warning:
        click.echo(f"forceaxis: warning: {plan.warning}", err=True)
    if not quiet:
        print_result(flash.summary(plan), as_json, lambda: plan_text(plan))


def plan_text(plan: flash.Plan) -> str:
    """Return a text about the firmware image, the flash sectors that are overwritten, the version
    of the image, and if the stored parameters are kept."""
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
