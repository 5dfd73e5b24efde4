"""`forceaxis flash`: write a firmware image to the chip."""

import json
import sys
from pathlib import Path

import click

from forceaxis._core import InputError
from forceaxis.chip import flash
from forceaxis.cli.common import Verb, as_json


class Address(click.ParamType):
    """An address of 32 bits, hexadecimal (0x08000000) or decimal."""

    name = "address"

    def convert(self, value, param, ctx):
        if isinstance(value, int):
            return value
        try:
            number = int(value, 0)
        except ValueError:
            number = -1
        if not 0 <= number < 1 << 32:
            self.fail(f"expected an address of 32 bits, 0x08000000, got {value}", param, ctx)
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
def flash_(file, address, erase_parameters, serial, yes, dry_run, as_json):
    """Write a firmware image (.elf, .hex, .bin) to its board with openocd and a debug probe.

    The verb prints the contents of the file and the flash sectors that they occupy, asks for
    consent, writes, verifies and resets the chip. The stored parameters are kept. Switch the power
    of the drive off first: the chip controls no output while it is written. The exit status is 1 if
    there is no probe, if the chip is a different one, or if writing or verifying fails. It is 2 if
    the file is not an image of this firmware for a known board.
    """
    plan = flash.plan(file, address, erase_parameters, serial)
    if dry_run:
        show(plan, as_json)
        if not as_json:
            click.echo(flash.quoted(flash.command(plan)))
        return
    flash.expect_openocd()
    if not yes and (as_json or not sys.stdin.isatty()):
        raise InputError("flash: expected --yes where there is no terminal to ask at")
    show(plan, as_json, quiet=as_json)
    probe, chip = flash.find_probe(plan)
    if not as_json:
        click.echo(f"probe        {probe}\nchip         {chip}")
    if not yes and not click.confirm("Write it? The drive's power should be off."):
        raise flash.FlashError("nothing was written")
    flash.write(plan)
    if as_json:
        click.echo(json.dumps(flash.summary(plan) | {"probe": probe, "chip": chip}))
    else:
        click.echo("written      verified; the chip was reset and runs it, the axis disabled")


def show(plan, as_json, quiet=False):
    """Print the plan of the write on standard output and its warning on standard error."""
    if plan.warning:
        click.echo(f"forceaxis: warning: {plan.warning}", err=True)
    if not quiet:
        click.echo(json.dumps(flash.summary(plan)) if as_json else flash.describe(plan))


VERBS = (flash_,)
