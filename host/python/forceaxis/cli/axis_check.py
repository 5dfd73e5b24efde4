"""`forceaxis axis check`: guide the first motion of an axis."""

from __future__ import annotations

import sys

import click

from forceaxis import paths
from forceaxis.cli.axis import axis
from forceaxis.cli.common import Subject, as_json, fitted, print_json
from forceaxis.cli.live_options import AxisConnection, live, owned, warn_of_power_up


@axis.command(
    epilog="""forceaxis axis check --on can0:1
    forceaxis axis check --on lcm:1 --yes --travel 200 --output 150 --json"""
)
@click.option("--yes", is_flag=True, help="Move the axis without asking for consent.")
@click.option(
    "--travel", type=click.IntRange(50, 20_000), default=400, show_default=True,
    help="Travel of the move out and back, in counts.",
)  # fmt: skip
@click.option(
    "--output", type=click.IntRange(1, 2047), default=250, show_default=True,
    help="Largest DAC code of the move out and back.",
)  # fmt: skip
@click.option(
    "--model", type=Subject(paths.MODELS),
    help="Model of the axis: output_bias holds its weight from the first motion on, and its brake "
    "gives brake_engage_ticks.",
)  # fmt: skip
@live
@as_json
def check(
    connection: AxisConnection, yes: bool, travel: int, output: int, model: str | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Check a new axis in steps before it is used: sensors at standstill, signs of encoder and
    drive at low output, then one small move out and back.

    At rest the command checks connection, object table, faults, enable chain, limit switches,
    position gain, force sensor (code, noise, zero), current, encoder and travel to the limits. Then
    it asks for your consent. The firmware tests encoder and signs in open loop, the axis moves out
    and back within bounds, and the tare is taken. If a step fails, the axis does not move again.

    An axis with a weight, by its model or by an output_bias other than 0, gets the output_bias that
    was measured at standstill; --output counts from it. The brake of the model gives
    brake_engage_ticks, and a weight may need a larger first_motion_counts and first_motion_speed.
    At the end the axis is disabled, and all parameters but these and force_tare have their earlier
    values.

    The exit status is 1 if a step fails. Without --yes and without a terminal the axis stays still.
    --json: {"axis", "passed", "steps": [{"step", "verdict": "passed" | "noted" | "skipped" |
    "failed", "text", "value", "limit"}]}.
    """
    from forceaxis.commission import known
    from forceaxis.commission.check import CheckStep, MotionCheck

    def show(step: CheckStep) -> None:
        if not as_json:
            click.echo(fitted(f"{step.verdict:<8}{step.step:<17}{step.text}", 25))

    def consent(text: str) -> bool:
        if yes or not sys.stdin.isatty():
            return yes
        return click.confirm(fitted(f"{text} Nothing stands in its way?"), err=True)

    weight = known.weight(model) if model else None
    with owned(connection) as found:
        run = MotionCheck(found, travel, output, show, weight)
        run.run(consent)
        warn_of_power_up(found)
    if as_json:
        print_json(run.result())
    sys.exit(0 if run.passed else 1)
