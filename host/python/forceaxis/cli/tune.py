"""The verb that gives a live axis its force law."""

import json

import click

from forceaxis import paths
from forceaxis.cli import live_options
from forceaxis.cli.common import (
    Folder,
    Parameter,
    Positive,
    Subject,
    Verb,
    as_json,
    fitted,
    mode_option,
)
from forceaxis.cli.measure import band, newtons


@click.command(
    cls=Verb,
    epilog="""forceaxis tune --sim press/contact.toml --model press/model.toml \\
    --force 30,150 --over k_w=30%,m_w=30% --force-max 250 --out out/tuned
    forceaxis tune --can can0 --model press/model.toml --force 30,150 --over k_w=30% \\
    --force-max 250 --mode seals=forward --out out/tuned""",
)
@live_options.live
@click.option(
    "--model",
    type=Subject(paths.MODELS),
    required=True,
    help="What is known of it, as of `forceaxis new`.",
)
@click.option(
    "--force", "forces", required=True, callback=newtons, metavar="N,N", help="Two or more, N."
)
@click.option(
    "--over", multiple=True, required=True, type=Parameter(), metavar="NAME=PERCENT%",
    help="How far a parameter may be off what is identified; several with commas. Repeatable.",
)  # fmt: skip
@click.option(
    "--prior", "priors", multiple=True, type=Parameter(), metavar="NAME=VALUE[+-PERCENT%]",
    help="What is known better, or worse, than by the part it plays: m_w=2.35 as exact as a mass "
    "that was weighed. SI. Repeatable.",
)  # fmt: skip
@mode_option("states")
@click.option("--force-max", "force_max_N", type=Positive(), required=True, help="N: never more.")
@click.option("--ms", type=float, default=2.0, show_default=True, help="Largest peak of |S|.")
@click.option("--band", "band_hz", metavar="LOW:HIGH", callback=band, help="Hz. Default: 1:100.")
@click.option("--averages", type=click.IntRange(4, 64), help="Of each response. Default: 8.")
@click.option("--travel-mm", type=Positive(), help="While it is excited. Default: 1.")
@click.option("--only", help="This step alone, done before or not.")
@click.option("--out", type=Folder(), required=True, help="Folder; with one of before it goes on.")
@as_json
def tune(way, only, out, as_json, **options):
    """Give a live axis the force law with most bandwidth: measured, designed, verified, stored.

    Steps: check (at rest, tare), free (response apart), measure (responses in contact at each
    force), fit (what MODEL leaves open), design (over the set about it), simulate (contact, strikes
    and members of the set with the firmware), write (the bank with its certificate), verify
    (touch-downs and responses with it, Ms beside what is predicted), store. What is done is kept in
    --out: the same command goes on after a break; after a kill it first resets the fault that the
    kill has left and puts back what was changed. A step that refuses names why, with exit status 1;
    the axis is disabled then and has what it had before. What has never been set on the axis
    (position_gain, force_scale, approach_velocity_max, contact_force) is taken from MODEL and
    written with the bank, so is a slower approach than one that would strike; all else stays.

    \b
    --json: {"parameters": {name: {"value", "interval", "unit"}},
     "bank": {...}, "worst": {...} as `forceaxis design` has them,
     "on_fitted": {"before", "designed": margins on the fitted plant},
     "Ms_predicted": over the set, "Ms_verified": the largest,
     "levels": {name: {"Ms": measured, "Ms_predicted": at the same lines,
      "peak_N": of the touch-down, ...}},
     "stored": true, "seconds": {step: ...},
     "refused": null | {"step", "name", "text", "lines"}}
    """
    from forceaxis.commission import tune as tuning
    from forceaxis.commission import tune_page

    if only is not None and only not in tuning.STEPS:
        raise click.UsageError(f"--only: expected one of {', '.join(tuning.STEPS)}, got {only}")
    given = {name: value for name, value in options.items() if value is not None}
    if "band_hz" in given:
        given["band_hz"] = tuple(given["band_hz"])
    order = tuning.Order(**given)
    with live_options.owned(way) as axis:
        steps = tuning.Tuning(
            axis, order, out, lambda text: click.echo(fitted(text, 2), err=as_json)
        )
        try:
            steps.run(only)
        finally:
            summary = steps.summary()
            tune_page.write(steps, summary)
            if as_json:
                click.echo(json.dumps(summary, allow_nan=False))
    if not as_json:
        click.echo(f"page         {paths.quoted(out / tune_page.FILE)}")


VERBS = (tune,)
