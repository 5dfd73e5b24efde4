"""`forceaxis tune`: identify a live axis, design the force law, verify the force law and store the
force law."""

from pathlib import Path

import click

from forceaxis import _core, paths
from forceaxis._core import InputError
from forceaxis.cli import live_options
from forceaxis.cli.common import (
    Folder,
    Parameter,
    Positive,
    Subject,
    Verb,
    as_json,
    fitted,
    given,
    mode_option,
    options_in,
    print_json,
)
from forceaxis.cli.live_options import AxisConnection
from forceaxis.cli.measure import band, newtons


def speed(context: click.Context, option: click.Parameter, text: str | None) -> float | None:
    """Return the speed in mm/s from the text of an option such as "4 mm/s". Raises InputError for
    another text, or if the speed is not above 0."""
    if text is None:
        return None
    value = _core.quantity_in(text, "m/s")
    if value is None or not 0 < value < 10:
        raise InputError(
            f'--approach: {text}: expected a speed above 0 with its unit, such as "4 mm/s"'
        )
    return 1e3 * value


@click.command(
    cls=Verb,
    epilog="""forceaxis tune --on sim:press/contact.toml --model press/model.toml \\
    --force 30,150 --over k_w=30%,m_w=30% --force-max 250 --out out/tuned
    forceaxis tune --on can0 --model press/model.toml --force 30,150 --over k_w=30% \\
    --force-max 250 --mode seals=forward --out out/tuned""",
)
@live_options.live_over(live_options.RECORDED)
@click.option(
    "--model",
    type=Subject(paths.MODELS),
    required=True,
    help="Model of the axis, as written by `forceaxis new`.",
)
@click.option(
    "--force",
    "forces",
    required=True,
    callback=newtons,
    metavar="N,N",
    help="Two or more contact forces to measure at, N.",
)
@click.option(
    "--over", multiple=True, required=True, type=Parameter(), metavar="NAME=PERCENT%",
    help="Tolerance about the identified value; several with commas between them. Repeatable.",
)  # fmt: skip
@click.option(
    "--prior", "priors", multiple=True, type=Parameter(), metavar="NAME=VALUE[+-PERCENT%]",
    help="Known value and error of a parameter in SI units, if the default error of its kind is "
    "wrong: m_w=2.35 has the error of a weighed mass. Repeatable.",
)  # fmt: skip
@mode_option("states")
@click.option(
    "--force-max",
    "force_max_N",
    type=Positive(),
    required=True,
    help="Force above which the axis stops, N.",
)
@click.option("--ms", type=float, default=2.0, show_default=True, help="Largest permitted Ms.")
@click.option(
    "--band",
    "band_hz",
    metavar="LOW:HIGH",
    callback=band,
    help="Frequency band in Hz. Default: 1:100.",
)
@click.option(
    "--averages", type=click.IntRange(4, 64), help="Averages per frequency response. Default: 8."
)
@click.option(
    "--approach", "approach_mm_per_s", metavar="SPEED", callback=speed,
    help='Speed of the approach, "4 mm/s". Default: that of the axis, at most such that the '
    "impact is a third of the least force.",
)  # fmt: skip
@click.option(
    "--travel-mm", type=Positive(),
    help="Travel bound out of contact, mm. Default: from encoder, drive and backlash of MODEL, and "
    "if the axis needs it up to 0.4 of the distance to the workpiece.",
)  # fmt: skip
@click.option(
    "--squeeze-mm", type=Positive(),
    help="Travel bound in contact, mm. Default: three times the deflection of MODEL, and if the "
    "contact is softer up to the distance to the workpiece.",
)  # fmt: skip
@click.option("--only", help="Run this step only, even if it is done.")
@click.option(
    "--out",
    type=Folder(),
    required=True,
    help="Folder for the results; an earlier run in it is continued.",
)
@as_json
def tune(
    connection: AxisConnection,
    model: str,
    forces: tuple[float, ...],
    over: tuple[str, ...],
    priors: tuple[str, ...],
    states: tuple[str, ...],
    force_max_N: float,
    ms: float,
    band_hz: tuple[float, float] | None,
    averages: int | None,
    approach_mm_per_s: float | None,
    travel_mm: float | None,
    squeeze_mm: float | None,
    only: str | None,
    out: Path,
    as_json: bool,
) -> None:
    """Tune the force control of a live axis: measure the axis, design the force law with the
    largest bandwidth, verify the force law on the axis and store the force law.

    The steps are: check (sensors at rest, tare; an axis with a weight is moved as by `axis check`),
    free (response out of contact), measure (response in contact at each force), fit (parameters of
    MODEL), design (law for the set of plants), simulate (first contacts, impacts and plants of the
    set with the firmware), write (bank with its certificate), verify (first contacts and responses
    with the bank, Ms compared with its prediction), store.

    The folder --out keeps the results of each step. After an interruption, the same command
    continues. After a kill, it first resets the fault of the axis and restores the parameters. A
    step that refuses prints its reason. The exit status is then 1, and the axis is disabled with
    its earlier parameters. After a wrong option it is 2. Objects that were never set on the axis
    (position_gain, force_scale, approach_velocity_max, contact_force) are taken from MODEL and
    written with the bank. The approach is made slower if its impact would exceed a third of the
    least force. Nothing else changes.

    \b
    --json: {"parameters": {name: {"value", "interval", "unit"}},
     "bank": {...}, "worst": {...} as `forceaxis design` has them,
     "on_fitted": {"before", "designed": margins on the fitted plant},
     "Ms_predicted": over the set, "Ms_verified": the largest,
     "levels": {name: {"Ms": measured, "Ms_predicted": at the same lines,
      "peak_N": of the first contact, ...}},
     "stored": true, "seconds": {step: ...},
     "refused": null | {"step", "name", "text", "lines"}}
    """
    from forceaxis.commission import tune as tuning
    from forceaxis.commission.tune_folder import TuningOrder
    from forceaxis.pages import tuning as page

    if only is not None and only not in tuning.STEPS:
        raise click.UsageError(f"--only: expected one of {', '.join(tuning.STEPS)}, got {only}")
    order = TuningOrder(
        model, forces, over, priors, states, ms, force_max_N,
        band_hz=given(band_hz, TuningOrder.band_hz),
        averages=given(averages, TuningOrder.averages),
        travel_mm=travel_mm, squeeze_mm=squeeze_mm, approach_mm_per_s=approach_mm_per_s,
    )  # fmt: skip
    command = click.get_current_context().command
    with live_options.owned(connection) as axis:
        steps = tuning.Tuning(
            axis,
            order,
            out,
            lambda text: click.echo(fitted(options_in(command, text), 2), err=as_json),
        )
        try:
            steps.run(only)
            live_options.warn_of_power_up(axis)
        finally:
            summary = steps.summary()
            page.write(steps, summary)
            if as_json:
                print_json(summary)
    if not as_json:
        click.echo(f"page         {paths.quoted(out / page.FILE)}")


VERBS = (tune,)
