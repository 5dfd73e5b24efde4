"""`forceaxis new`."""

import json
import sys

import click

from forceaxis._core import InputError
from forceaxis.cli.common import Folder, Verb, as_json, fitted, show, waiting
from forceaxis.design import data_sheet, new


def options(command):
    """One command-line option per field."""
    for field in reversed(data_sheet.FIELDS):
        default = field.why if callable(field.default) else data_sheet.shown(field, field.default)
        help_text = f"{field.part}: {field.ask} [default: {default}]"
        command = click.option(field.option, field.name, metavar=field.unit, help=help_text)(
            command
        )
    return command


def prompt(field, proposed, number):
    """Ask for one value on the terminal until it is one, or the question before is wanted."""
    count = len(data_sheet.FIELDS)
    if number == 1:
        click.echo(
            fitted(f"Enter takes what is in brackets, {data_sheet.BACK} goes back, Ctrl-C ends.")
        )
    click.echo("\n" + fitted(f"{number} of {count}  {field.part}: {field.ask}", 2))
    unit = "" if field.unit == "1" else f", {field.unit}"
    while True:
        text = click.prompt(f"  {field.option[2:]}{unit}", default=proposed).strip()
        if text == data_sheet.BACK:
            return text
        try:
            field.parse(text)
            return text
        except InputError as error:
            click.echo(fitted(f"  {error}", 2))


@click.command(
    name="new",
    cls=Verb,
    epilog="""forceaxis new press
    forceaxis new press --yes --moving-mass-kg 25 --lead-mm-per-rev 5 --force""",
)
@click.argument("name", type=Folder())
@options
@click.option("--yes", is_flag=True, help="Ask nothing: defaults for what is not given.")
@click.option("--force", is_flag=True, help="Replace the files if they are there.")
@click.option("--no-design", is_flag=True, help="Leave out the bank and held.toml.")
@as_json
def new_(name, yes, force, no_design, as_json, **given):
    """Write a model and experiments of your own axis into folder NAME.

    Asks for what the data sheets of motor, amplifier, transmission, sensor and workpiece say, or
    takes it as options: plain numbers in the unit of the option's name. What nobody gives gets a
    default that is marked in the model. Asks nothing without a terminal.

    At the end a bank of the force law is designed for what it presses on, +-30 %, and simulated
    with the firmware; held.toml runs with it. JSON: design, with the bandwidth fS in Hz over that
    set for the bank and for P.
    """
    new.refuse_existing(name, force)
    talk = not (yes or as_json) and sys.stdin.isatty()
    values = data_sheet.collect(given, prompt if talk else None)
    design = None
    if not no_design:
        from forceaxis.design import own_axis

        design = own_axis.design
    with waiting("new"):
        done = new.write(name, *values, force, design)
    if as_json:
        click.echo(json.dumps(done))
    else:
        show(new.described(done))


VERBS = (new_,)
