"""`forceaxis axis bringup`: brings a new board into operation, step by step."""

import json
import sys
from pathlib import Path

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.axis import axis
from forceaxis.cli.common import File, coloured
from forceaxis.cli.live_options import AxisConnection, live, owned
from forceaxis.commission import bringup as steps
from forceaxis.results import to_json
from forceaxis.words import number


class Terminal:
    """Asks the person at the terminal for the actions and the numbers that the bring-up of a board
    needs."""

    def act(self, text: str) -> bool:
        """Prints the action that the person has to do at the board. Returns False if the person
        answers "s" to skip the step."""
        answer = click.prompt(
            f"  {text}\n  Enter when it is done, s to skip the step",
            default="",
            show_default=False,
            err=True,
        )
        return str(answer).strip().lower() != "s"

    def number(self, text: str, unit: str) -> float | None:
        """Asks for a number until the answer is a number or empty. Returns None for an empty
        answer."""
        while True:
            answer = click.prompt(
                f"  {text}, in {unit} (Enter if it is not known)",
                default="",
                show_default=False,
                err=True,
            )
            if not str(answer).strip():
                return None
            try:
                return number(answer)
            except ValueError:
                click.echo(f"  expected a number in {unit}, got {answer}", err=True)


@axis.command(
    epilog="""forceaxis axis bringup --on serial:/dev/ttyACM0 --out protocol.json
    forceaxis axis bringup --on serial:/dev/ttyACM0 --step encoder --step can""",
)
@live
@click.option(
    "--step",
    "names",
    multiple=True,
    type=click.Choice(list(steps.STEPS)),
    metavar="STEP",
    help=f"Do only this step, one of {', '.join(steps.STEPS)}. The option can be given several "
    "times.",
)
@click.option("--out", type=File(), help="Test report as a JSON file, written after each step.")
def bringup(connection: AxisConnection, names: tuple[str, ...], out: Path | None) -> None:
    """Bring a new board into operation without a motor. The command asks for an action at the
    board, reads the objects of the axis, checks each step, and writes a test report.

    The steps are: identity of the firmware, cause of the last reset, errors that the board finds in
    itself, time of the tick, contacts, encoder, inputs of force and motor current, outputs, CAN,
    CAN after a short circuit, parameters after a power cut, watchdog. The steps need a voltmeter.
    The step "outputs" enables the axis and outputs DAC codes from -2000 to 2000, so motor and
    amplifier have to be disconnected. Ctrl-C disables the axis.

    The exit status is 0 if every step was done and passed, and 1 otherwise.
    """
    if not sys.stdin.isatty():
        raise InputError(
            "bringup: expected a terminal, because the command asks for actions at the board"
        )
    with owned(connection) as axis:
        for protocol in steps.bring_up(axis, Terminal(), steps.BringupRequest(names)):
            last = protocol.steps[-1]
            click.echo(f"{coloured(last.verdict):8} {last.name}: {last.text}")
            if out is not None:
                paths.replace_text(out, json.dumps(to_json(protocol), indent=2) + "\n")
    if not protocol.passed:
        sys.exit(1)
