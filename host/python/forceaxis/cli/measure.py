"""`forceaxis measure`: measure the frequency response of a simulated plant or of a live axis."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

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
    given,
    options_in,
    print_json,
    print_result,
    show,
    waiting,
)
from forceaxis.words import number

if TYPE_CHECKING:
    from forceaxis.commission.level import MeasuringOrder
    from forceaxis.identify.result import MeasurementSummary
    from forceaxis.linear.plant_facts import Overrides

    OptionValue = str | float | tuple[float, float] | None


def band(
    context: click.Context, option: click.Parameter, text: str | None
) -> tuple[float, float] | None:
    """Return two frequencies in Hz from the text "LOW:HIGH" of the option --band. Raises InputError
    for other texts."""
    if text is None:
        return None
    try:
        low, high = (number(part) for part in text.split(":"))
    except ValueError:
        raise InputError(
            f"--band: {text}: expected two frequencies in Hz as LOW:HIGH, with LOW below HIGH"
        ) from None
    return low, high


def newtons(context: click.Context, option: click.Parameter, text: str | None) -> tuple[float, ...]:
    """Return the forces in N from a text such as "30,75", in which commas separate the forces.
    Raises InputError for another text, or if a force is not above 0."""
    if text is None:
        return ()
    try:
        forces = tuple(number(part) for part in text.split(","))
    except ValueError:
        forces = (0.0,)
    if not all(0 < force < 1e6 for force in forces):
        raise InputError(
            f"--force: {text}: expected one or more forces in N, above 0 and separated by commas, "
            "such as 30,75"
        )
    return forces


def measure_axis(
    connection: live_options.AxisConnection,
    out: Path | None,
    as_json: bool,
    order: MeasuringOrder,
    forces: tuple[float, ...],
    free: bool,
    model: str,
) -> None:
    """Run the command `measure` for a live axis: measure the frequency response of the axis, write
    the files to the folder `out` and print the result."""
    from forceaxis import linear
    from forceaxis.cli.response_text import describe_response
    from forceaxis.commission import as_found, measuring
    from forceaxis.commission.refusal import Refusal
    from forceaxis.identify import result

    if not forces and not free:
        raise InputError(
            "measure: expected --free (measure out of contact), --force (measure in contact) or "
            "both options"
        )
    model = str(linear.find_model(model)) if model else ""
    own = [text for text in connection.overrides if not text.startswith("firmware.")]
    values = linear.overrides(own) if model else {}

    command = click.get_current_context().command

    def say(text: str) -> None:
        click.echo(fitted(options_in(command, text), 2), err=True)

    with live_options.owned(connection) as axis:
        live_options.warn_of_newtons(axis, connection)
        kept: contextlib.AbstractContextManager[None] = contextlib.nullcontext()
        if out:
            kept = as_found.restoring(as_found.AxisFolder(axis, out, say))
        try:
            with kept:
                done = measuring.measure(axis, order, forces, free, model, values, say)
        except Refusal as refusal:
            for line in ("to be added to the model:", *refusal.lines.splitlines()):
                if refusal.lines:
                    say(line)
            raise
    for name, one in done.items():
        if out:
            result.write(one, out / name)
        if not as_json:
            described = describe_response(one.summary)
            rows = [("measurement", name), *((k, options_in(command, v)) for k, v in described)]
            rows += [("files", paths.quoted(out / name))] if out else []
            show(rows)
    if as_json:
        print_json({name: one.summary for name, one in done.items()})


@click.command(
    cls=Verb,
    epilog="""forceaxis measure fig3_9 --out out/fig3_9
    forceaxis measure fig3_12 --inject codes --output adc0 --level 60
    forceaxis measure fig4_19 --output sensor.force --clamped --band 1:100 --plant-set m_r=146
    forceaxis measure --on sim:press/contact.toml --free --force 30,75 --force-max 120 --out out/m
    forceaxis measure --on can0 --free --force 30,75 --force-max 120 --model press/model.toml""",
)
@click.argument("target", required=False)
@click.option("--output", help="Output signal; with --inject codes adc0, adc1, encoder.")
@click.option("--input", help="Input signal. Default: the excitation.")
@click.option(
    "--inject",
    type=click.Choice(["volts", "codes"]),
    help="Unit of the excitation. Default: volts.",
)
@click.option(
    "--excitation",
    type=click.Choice(["noise", "sine", "chirp"]),
    help="Kind of excitation. Default: noise.",
)
@click.option(
    "--band",
    "band_hz",
    metavar="LOW:HIGH",
    callback=band,
    help="Frequency band in Hz. Default: 1:200.",
)
@click.option(
    "--resolution",
    "resolution_hz",
    type=float,
    help="Spacing of the spectral lines, Hz. Default: the lowest frequency.",
)
@click.option("--level", type=float, help="Level of the excitation: V rms (noise), V or DAC codes.")
@click.option("--bias", type=float, help="Mean of the excitation, V or DAC codes.")
@click.option("--averages", type=int, help="Number of averages. Default: 16.")
@click.option(
    "--window",
    type=click.Choice(["none", "hann"]),
    help="Window of the spectrum. Default: none, with periodic excitation. With hann the results "
    "begin at the third spectral line.",
)
@click.option(
    "--clamped", is_flag=True, default=None, help="Contacts transmit tension too (thesis 3.2.2)."
)
@click.option(
    "--free", is_flag=True, default=None,
    help="Contacts of the model are open; make sure that those of the plant are open too (--set "
    "approach=0.5). For an axis: the response from commands to the encoder, out of contact.",
)  # fmt: skip
@click.option(
    "--force",
    "forces",
    callback=newtons,
    metavar="N[,N]",
    help="For an axis: forces in contact, N.",
)
@click.option("--force-max", "force_max_N", type=Positive(), help="For an axis: force bound, N.")
@click.option(
    "--travel", type=click.IntRange(1), help="For an axis: travel bound, counts. Default: 500."
)
@click.option(
    "--settle",
    "settle_s",
    type=Positive(),
    help="For an axis: settling time before each measurement, s. Default: 1.",
)
@click.option("--model", type=Subject(paths.MODELS), help="For an axis: compare with this model.")
@click.option("--seed", type=int, help="Seed of all noise. Default: 0.")
@click.option(
    "--plant-set", multiple=True, type=Parameter(), metavar="NAME=VALUE",
    help="Parameter of the plant only; the model for the comparison keeps its value.",
)  # fmt: skip
@click.option(
    "--out", type=Folder(), help="Folder for response.csv, .npz, plot.png and result.json."
)
@live_options.options(live_options.RECORDED)
@as_json
def measure(
    connection: live_options.AxisConnection,
    target: str | None,
    plant_set: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    forces: tuple[float, ...],
    force_max_N: float | None,
    travel: int | None,
    settle_s: float | None,
    model: str | None,
    output: str | None,
    input: str | None,
    inject: str | None,
    excitation: str | None,
    band_hz: tuple[float, float] | None,
    resolution_hz: float | None,
    level: float | None,
    bias: float | None,
    averages: int | None,
    window: str | None,
    clamped: bool | None,
    free: bool | None,
    seed: int | None,
) -> None:
    """Measure the frequency response of a simulated plant or of a live axis by an excitation, and
    compare the measured response with the response that a model predicts.

    TARGET is a measurement file (a path, or one of fig3_6 to fig3_12 in sim/measurements), or a
    model (a path, or a name in sim/models) together with --output. Options replace keys of the
    file. The excitation is a voltage at the drive, or codes from the excitation mode of the
    firmware. The command prints the gain at the lowest frequency, the corner frequency if the first
    octave is flat, phase crossings, time in contact, coherence and error. It also prints the share
    of points whose 95 % band contains the model, and whether the whole model matches. The exit
    status is 0 even if it does not match.

    For an axis, --free measures the response from codes to the encoder, out of contact, around the
    present position. --force measures the response from codes to the measured force, in contact in
    mode 4 with the force law of the axis. Without --level the command increases the amplitude from
    one code. The axis ends the excitation if the measured force falls to 0.6 of the set-point or
    comes near --force-max, if contact is lost, or if the travel exceeds --travel. The command then
    tries half the amplitude.

    The command measures dry friction first, within the same bounds: out of contact by constant
    codes in both directions, in contact by a slow change of the force up and down. If there is
    friction, it increases the amplitude until the axis slides. The line `friction` gives the
    friction of guide and gear in codes (with --model in N), the friction of the workpiece, and the
    table [[friction]] that the model lacks. --json and result.json have these values as "friction".
    If the axis does not slide within the bounds, the measurement is refused as `friction`.

    --out gets one folder for each response. At the end the axis is disabled and has its earlier
    parameters. After a kill, the same command with --out restores them.
    """
    from forceaxis import linear
    from forceaxis.commission.level import MeasuringOrder
    from forceaxis.identify import result as analyzer

    if target is None:
        order = MeasuringOrder(
            band_hz=given(band_hz, MeasuringOrder.band_hz),
            resolution_hz=given(resolution_hz, MeasuringOrder.resolution_hz),
            averages=given(averages, MeasuringOrder.averages),
            settle_s=given(settle_s, MeasuringOrder.settle_s),
            force_max_N=given(force_max_N, MeasuringOrder.force_max_N),
            travel=given(travel, MeasuringOrder.travel),
            squeeze=given(travel, MeasuringOrder.squeeze),
            amplitude=MeasuringOrder.amplitude if level is None else int(level),
            seed=given(seed, MeasuringOrder.seed),
        )
        measure_axis(connection.one(), out, as_json, order, forces, bool(free), model or "")
        return
    if connection.addresses:
        raise InputError(
            f"measure: {target}: expected either TARGET (a simulation) or --on ADDRESS (an "
            "axis), got both; remove one"
        )

    options: dict[str, OptionValue] = {
        "output": output, "input": input, "inject": inject, "excitation": excitation,
        "band_hz": band_hz, "resolution_hz": resolution_hz, "level": level, "bias": bias,
        "averages": averages, "window": window, "clamped": clamped, "free": free, "seed": seed,
    }  # fmt: skip
    with waiting("measure"):
        own, plant = linear.overrides(connection.overrides), linear.overrides(plant_set)
        command = command_line(target, options, own, plant)
        done = analyzer.run(target, {**options, "set": own or None}, plant, command)
        if out:
            analyzer.write(done, out)
    print_result(done.summary, as_json, lambda: in_words(done.summary), out)


def command_line(
    target: str, options: Mapping[str, OptionValue], overrides: Overrides, plant_set: Overrides
) -> str:
    """Return the command line of `forceaxis measure` with which the user can repeat this
    measurement."""
    from forceaxis import linear

    names = {"band_hz": "band", "resolution_hz": "resolution"}
    words = ["forceaxis", "measure", target]
    for key, value in options.items():
        if value is None or value is False:
            continue
        option = f"--{names.get(key, key)}"
        text = ":".join(map(repr, value)) if isinstance(value, tuple) else str(value)
        words += [option] if value is True else [option, text]
    for option, values in (("--set", overrides), ("--plant-set", plant_set)):
        for text in linear.override_texts(values):
            words += [option, text]
    return shlex.join(words)


def in_words(summary: MeasurementSummary) -> str:
    """Return the text about the measurement of a simulated plant: excitation, bandwidth, other
    values of the response, coherence, and comparison with the model."""
    from forceaxis.identify.measurement import COHERENT

    compared, readings = summary.comparison, summary.readings
    inside, corner = compared.inside, readings.corner_hz
    low, high = summary.band_hz
    title = summary.title + (f" (Fig {summary.figure})" if summary.figure else "")
    crossings = ", ".join(
        f"{c.frequency_hz:.3g} Hz ({c.phase_deg})" for c in readings.phase_crossings
    )
    no_corner = "none in the band" if readings.plateau else "none: the first octave is not flat"
    lines = [
        ("measurement", title or summary.measurement),
        ("response", f"{summary.input} to {summary.output}, {summary.unit}"),
        (
            "excitation",
            f"{summary.excitation} as {summary.inject}, {low:.4g} to {high:.4g} Hz, "
            f"{summary.averages} averages, sampled at {summary.sampling_hz:g} Hz",
        ),
        ("low gain", f"{readings.low_gain:.4g} at {readings.low_hz:.4g} Hz, the lowest line"),
        ("corner", no_corner if corner is None else f"{corner:.4g} Hz, 3 dB lower"),
        ("phase", f"passes 0 or 180 degrees at {crossings}" if crossings else "passes no axis"),
        (
            "coherence",
            f"median {summary.coherence_median:.5g}, above {COHERENT} at "
            f"{compared.coherent} of {compared.points} points",
        ),
        (
            "error",
            f"{100 * summary.random_error_median:.2g} % random error, median; quantisation "
            f"alone {summary.floor_median:.2g} {summary.unit}",
        ),
        (
            "inside",
            "no coherent point"
            if inside is None
            else f"{100 * inside:.1f} % of the coherent points within the 95 % band",
        ),
        ("verdict", f"{summary.verdict} (p = {compared.p_value:.3g})"),
        *(("hint", text) for text in summary.hints),
        ("again", summary.command),
    ]
    if summary.contact:
        shares = summary.contact.items()
        text = ", ".join(f"{name} pressed {100 * s:.4g} % of the time" for name, s in shares)
        lines.insert(3, ("contact", text))
    if summary.saturated:
        share = f"{100 * summary.saturated:.3g} % of the samples at an end of the ADC"
        lines.insert(6, ("saturated", f"{share}: lower the level, or move it by a bias"))
    return "\n".join(f"{key:12} {value}" for key, value in lines)


VERBS = (measure,)
