"""`forceaxis axis check`: the guided first motion."""

import json
import sys

import click

from forceaxis.cli.axis import axis
from forceaxis.cli.common import as_json, fitted
from forceaxis.cli.live_options import live, owned


@axis.command(
    epilog="""forceaxis axis check --can can0 --node 1
    forceaxis axis check --axis 1 --yes --travel 200 --output 150 --json"""
)
@click.option("--yes", is_flag=True, help="Let the axis move without asking.")
@click.option(
    "--travel", type=click.IntRange(50, 20_000), default=400, show_default=True,
    help="Counts of the move out and back.",
)  # fmt: skip
@click.option(
    "--output", type=click.IntRange(1, 2047), default=250, show_default=True,
    help="Largest DAC code of that move.",
)  # fmt: skip
@live
@as_json
def check(yes, travel, output, way, as_json):
    """Guide a first motion at low output: what is seen at rest, then a test, then a small move.

    At rest: connection, object table, faults, enable chain and limit switches, gain, force sensor
    (code, noise, zero), current, encoder, room between the limits. Then, with your consent, the
    firmware's own test of encoder and signs in open loop, a move out and back with bounds of its
    own, and the tare. Where something fails the axis does not move any further. Afterwards it is
    disabled, its parameters as before but for force_tare.

    Exit status 1 where a step fails. Without --yes and without a terminal the axis does not move.
    --json: {"axis", "passed", "steps": [{"step", "verdict": "passed" | "noted" | "skipped" |
    "failed", "text", "value", "limit"}]}.
    """
    from forceaxis.commission.check import Check

    def show(step):
        if not as_json:
            click.echo(fitted(f"{step.verdict:<8}{step.step:<17}{step.text}", 25))

    def consent(text):
        if yes or not sys.stdin.isatty():
            return yes
        return click.confirm(fitted(f"{text} Nothing stands in its way?"), err=True)

    with owned(way) as found:
        run = Check(found, travel, output, show)
        run.run(consent)
    if as_json:
        click.echo(json.dumps(run.result()))
    sys.exit(0 if run.passed else 1)
