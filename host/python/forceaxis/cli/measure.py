"""The verb that measures frequency responses, of models and of live axes."""

import contextlib
import json

import click

from forceaxis import paths
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
    show,
    waiting,
)


def band(context, option, text):
    """LOW:HIGH in Hz."""
    if text is None:
        return None
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise InputError(f"--band: {text}: expected LOW:HIGH, two frequencies in Hz") from None
    return [low, high]


def newtons(context, option, text):
    """N,N: forces above 0."""
    if text is None:
        return ()
    try:
        forces = tuple(float(part) for part in text.split(","))
    except ValueError:
        forces = (0.0,)
    if not all(0 < force < 1e6 for force in forces):
        raise InputError(f"--force: {text}: expected forces in N with commas between, above 0")
    return forces


def measure_axis(way, out, as_json, live, options):
    """`measure` on a live axis."""
    from forceaxis import linear
    from forceaxis.commission import analyzer, as_found, measuring
    from forceaxis.commission.refusal import Refusal
    from forceaxis.identify import result

    known = ("band_hz", "resolution_hz", "averages", "seed")
    given = {n: options[n] for n in known} | {n: live[n] for n in ("force_max_N", "travel")}
    given |= {"settle_s": live["settle_s"], "amplitude": options["level"] and int(options["level"])}
    order = analyzer.Order(**{n: value for n, value in given.items() if value is not None})
    if not live["forces"] and not options["free"]:
        raise InputError("measure: expected --free, --force or both: what is to be measured")
    model = str(linear.find_model(live["model"])) if live["model"] else ""
    own = [text for text in way.overrides if not text.startswith("firmware.")]
    values = linear.overrides(own) if model else {}

    def say(text):
        click.echo(fitted(text, 2), err=True)

    with live_options.owned(way) as axis:
        live_options.warn_of_newtons(axis, way)
        kept = as_found.kept(as_found.Folder(axis, out, say)) if out else contextlib.nullcontext()
        try:
            with kept:
                done = measuring.measure(
                    axis, order, live["forces"], bool(options["free"]), model, values, say
                )
        except Refusal as refusal:
            for line in ("to be added to the model:", *refusal.lines.splitlines()):
                if refusal.lines:
                    say(line)
            raise
    for name, one in done.items():
        if out:
            result.write(one, out / name)
        if not as_json:
            rows = [("measurement", name), *measuring.describe(one.summary)]
            rows += [("files", paths.quoted(out / name))] if out else []
            show(rows)
    if as_json:
        click.echo(json.dumps({name: one.summary for name, one in done.items()}, allow_nan=False))


@click.command(
    cls=Verb,
    epilog="""forceaxis measure fig3_9 --out out/fig3_9
    forceaxis measure fig3_12 --inject codes --output adc0 --level 60
    forceaxis measure fig4_19 --output sensor.force --clamped --band 1:100 --plant-set m_r=146
    forceaxis measure --sim press/contact.toml --free --force 30,75 --force-max 120 --out out/m
    forceaxis measure --can can0 --free --force 30,75 --force-max 120 --model press/model.toml""",
)
@click.argument("target", required=False)
@click.option("--output", help="Signal, or adc0, adc1, encoder with --inject codes.")
@click.option("--input", help="Signal, or dac_code. Default: what is injected.")
@click.option("--inject", type=click.Choice(["volts", "codes"]), help="Default: volts.")
@click.option("--excitation", type=click.Choice(["noise", "sine", "chirp"]), help="Default: noise.")
@click.option("--band", "band_hz", metavar="LOW:HIGH", callback=band, help="Hz. Default: 1:200.")
@click.option("--resolution", "resolution_hz", type=float, help="Hz. Default: the lowest.")
@click.option("--level", type=float, help="V rms (noise), V amplitude, or codes of amplitude.")
@click.option("--bias", type=float, help="V or code about which it swings.")
@click.option("--averages", type=int, help="Default: 16.")
@click.option(
    "--window",
    type=click.Choice(["none", "hann"]),
    help="Default: none, periodic excitation. hann begins at the third line.",
)
@click.option(
    "--clamped", is_flag=True, default=None, help="Contacts pull as well as they push (3.2.2)."
)
@click.option(
    "--free", is_flag=True, default=None,
    help="The model has its contacts apart; see that the plant has, too (--set approach=0.5). Of "
    "an axis: the response apart, commands to the encoder.",
)  # fmt: skip
@click.option(
    "--force", "forces", callback=newtons, metavar="N[,N]", help="Of an axis: forces in contact."
)
@click.option("--force-max", "force_max_N", type=Positive(), help="N. Of an axis: never more.")
@click.option(
    "--travel", type=click.IntRange(1), help="Counts. Of an axis: never further. Default: 500."
)
@click.option("--settle", "settle_s", type=Positive(), help="s. Of an axis. Default: 1.")
@click.option(
    "--model", type=Subject(paths.MODELS), help="Of an axis: compare with this model, under --set."
)
@click.option("--seed", type=int, help="Of excitation and converters. Default: 0.")
@click.option(
    "--plant-set", multiple=True, type=Parameter(), metavar="NAME=VALUE",
    help="Parameter of the plant alone, behind the analyzer's back.",
)  # fmt: skip
@click.option(
    "--out", type=Folder(), help="Folder for response.csv, .npz, plot.png and result.json."
)
@live_options.options
@as_json
def measure(target, way, plant_set, out, as_json, **options):
    """Measure a frequency response: of a model with a virtual signal analyzer, or of a live axis.

    TARGET is a measurement file (or the stem of one in sim/measurements: fig3_6 to fig3_12), or a
    model (path, or stem in sim/models) with at least --output. Options replace keys of the file.
    The excitation goes into the drive as volts, or runs through the firmware's excitation mode as
    codes. Prints the gain at the lowest line, the corner if the first octave is flat, phase
    crossings, how long contacts were pressed, coherence and error, how many points have the model
    inside their 95 % band, and whether the model as a whole fits; it not fitting is a result.

    Of an axis --free and --force say what is measured: codes to the encoder, apart, from where it
    stands; codes to the reading in contact, inside the force law that the axis has, in mode 4. The
    amplitude is searched from one code on unless --level gives it. The axis itself ends the
    excitation where the reading falls to 0.6 of the force or comes near --force-max, where the
    contact is lost or the position is further than --travel; half the amplitude is tried then.

    Dry friction is looked for first: apart by constant codes both ways, in contact by a slow change
    of the force there and back, within the same bounds. Where it shows, the amplitude is raised
    until the axis slides, and the line `friction` says what guide and gear take in codes, and in
    newtons with --model, what is under the workpiece, and the [[friction]] that the model lacks;
    --json and the file have all of it as "friction". Noise that does not slide within the bounds is
    refused as `friction`.

    --out has a folder for each response. At the end the axis is as it was, disabled; after a kill
    the same command with --out puts back what was changed.
    """
    from forceaxis import linear
    from forceaxis.identify import result as analyzer

    live = {n: options.pop(n) for n in ("forces", "force_max_N", "travel", "settle_s", "model")}
    if target is None:
        way.expect_one()
        measure_axis(way, out, as_json, live, options)
        return
    if way != live_options.Way(overrides=way.overrides):
        raise InputError(f"measure: {target}: expected either TARGET or an axis")

    if way.overrides:
        options["set"] = linear.overrides(way.overrides)
    with waiting("measure"):
        done = analyzer.run(target, options, linear.overrides(plant_set))
        if out:
            analyzer.write(done, out)
    if as_json:
        click.echo(json.dumps(done.summary, allow_nan=False))
    else:
        click.echo(analyzer.describe(done.summary))
        if out:
            click.echo(f"files        {paths.quoted(out)}")


VERBS = (measure,)
