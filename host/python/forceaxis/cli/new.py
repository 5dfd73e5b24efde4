"""`forceaxis new`: write a model and experiments of an axis from the values of data sheets."""

import sys
from pathlib import Path

import click

from forceaxis._core import InputError
from forceaxis.cli.common import (
    Callback,
    Folder,
    Verb,
    as_json,
    fitted,
    print_json,
    show,
    waiting,
    with_options,
)
from forceaxis.design import data_sheet, new
from forceaxis.design.data_sheet import default_of


def option_of(field: data_sheet.SheetField) -> str:
    """Return the name of the option by which the user sets one value from the data sheets."""
    return "--" + field.name.lower().replace("_", "-")


def options(command: Callback) -> Callback:
    """Add options to the command `new`, one option for each value from the data sheets."""
    for field in reversed(data_sheet.FIELDS):
        default = field.why if callable(field.default) else field.shown(default_of(field, {}))
        help_text = f"{field.part}: {field.ask} [default: {default}]"
        metavar = "|".join(field.choices) or field.unit
        command = click.option(option_of(field), field.name, metavar=metavar, help=help_text)(
            command
        )
    return command


def prompt(field: data_sheet.SheetField, proposed: str, number: int) -> str:
    """Ask the user for one value from the data sheets until the answer is valid, and return the
    answer. If the user wants to return to the previous question, the answer is data_sheet.BACK."""
    count = len(data_sheet.FIELDS)
    if number == 1:
        click.echo(
            fitted(f"Enter takes what is in brackets, {data_sheet.BACK} goes back, Ctrl-C ends.")
        )
    click.echo("\n" + fitted(f"{number} of {count}  {field.part}: {field.ask}", 2))
    unit = "" if field.unit == "1" else f", {field.unit}"
    while True:
        text = click.prompt(f"  {option_of(field)[2:]}{unit}", default=proposed).strip()
        if text == data_sheet.BACK:
            return text
        try:
            field.parse(text)
            return text
        except InputError as error:
            command = click.get_current_context().command
            click.echo(fitted(f"  {with_options(command, error)}", 2))


@click.command(
    name="new",
    cls=Verb,
    epilog="""forceaxis new press
    forceaxis new press --yes --moving-mass-kg 25 --lead-mm-per-rev 5 --force
    forceaxis new slide --yes --drive torque --motor linear --bus-cycle-ms 2""",
)
@click.argument("name", type=Folder())
@options
@click.option(
    "--from",
    "sheet",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="A TOML file with values of the data sheets. Its keys are the names of the options "
    "without the hyphens in front and with underscores. An option has precedence.",
)
@click.option("--yes", is_flag=True, help="Do not ask; use defaults for missing values.")
@click.option("--force", is_flag=True, help="Replace existing files.")
@click.option("--no-design", is_flag=True, help="Leave out the bank and held.toml.")
@as_json
def new_(
    name: Path,
    sheet: Path | None,
    yes: bool,
    force: bool,
    no_design: bool,
    as_json: bool,
    **given: str | None,
) -> None:
    """Write a model and experiments of your axis into the folder NAME, from values of data sheets.

    The command asks for the kind of drive, and for values from the data sheets of motor, amplifier
    or drive, transmission, sensor and workpiece. Options or a file (--from) give them instead:
    plain numbers in the unit that the name of the option ends with. A missing value gets a default,
    which the model marks. Without a terminal the command does not ask.

    At the end the command designs a bank for the workpiece with a tolerance of 30 %, simulates
    it with the firmware, and writes held.toml, an experiment with this bank. JSON: design has the
    bandwidth fS in Hz over that set of plants, for the bank and for the P law.
    """
    new.refuse_existing(name, force)
    if sheet is not None:
        given = {**data_sheet.read(sheet), **{k: v for k, v in given.items() if v is not None}}
    talk = not (yes or as_json) and sys.stdin.isatty()
    values, sources = data_sheet.collect(given, prompt if talk else None)
    design = None
    if not no_design:
        from forceaxis.design import own_axis

        design = own_axis.design
    with waiting("new"):
        done = new.write(name, values, sources, force, design)
    if as_json:
        print_json(done)
    else:
        from forceaxis.cli import new_text

        show(new_text.describe(done))


VERBS = (new_,)
