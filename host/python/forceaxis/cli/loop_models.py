"""The commands `modes`, `poles`, `bode` and `linearise` of `forceaxis loop`, which analyse linear
models."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis.cli.common import File, Positive, Slow, as_json
from forceaxis.cli.loop import (
    TIMINGS,
    check_drawing,
    draw,
    drawn,
    free,
    law_option,
    loop,
    model_options,
    outputs_option,
    over_options,
    present,
    requests_loop,
    subject_options,
    vary,
)
from forceaxis.results import to_json

if TYPE_CHECKING:
    from forceaxis.linear.request import LoopRequest


@loop.command(
    name="modes",
    cls=Slow,
    short_help="Modes of vibration: frequency, damping, shape, colocated or not.",
    epilog="""forceaxis loop modes fig4_19 --set b_w=363
    forceaxis loop modes fig4_15 --free --json""",
)
@model_options
@free
@click.option(
    "--input",
    "input_",
    default="drive.force",
    show_default=True,
    help="drive.force (between the two sides of the drive) or BODY.force.",
)
@click.option(
    "--output",
    help="A signal (tip.acceleration). Default: the measured force; with --free the position of "
    "the body that makes contact.",
)
@drawn
@as_json
def modes_(
    model: str,
    overrides: tuple[str, ...],
    modes: tuple[str, ...],
    free: bool,
    input_: str,
    output: str | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Compute the modes of vibration of MODEL: frequency, damping ratio, shape, and whether
    actuator and sensor are colocated in the mode of vibration (thesis 6.1.4).

    MODEL is a path or a name in sim/models. The modes are those of the mechanics without damping
    and without drive. The label of a mode compares the sign of its residue, from input to output,
    with that of the lowest mode. If the comparison with the next lower mode has another result,
    this is printed too. A mode with the residue 0 is colocated if dampers couple it, because its
    poles and zeros are then close together. Otherwise its label is "neither". The command also
    prints the corresponding pole of the complete system with damping and drive.

    \b
    --json: {"model": "fig4_19", "title": ...,
     "contact": "pressed" | "apart" | null (has none), "input": "drive.force",
     "output": "sensor.spring_force", "path": true, "criterion": ...,
     "modes": [                          ascending
       {"frequency_hz": 44.84, "damping_ratio": 0.0067,        null at 0 Hz
        "shape": {"robot": -0.0106, "workpiece": 1.0},         largest is 1
        "residue": 178.1,                unit of the output / (N s^2)
        "label": "colocated",            or "noncolocated", "neither"
        "against_lowest": "colocated", "against_below": "colocated",
        "reference": false,              true: others are compared with it
        "driven": {"frequency_hz": 44.85, "damping_ratio": 0.007,
                   "real": -1.97, "imag": 281.8}}],            1/s, or null
     "other_poles": [{...}]}             matched by no mode, as "driven"
    """
    from forceaxis import linear
    from forceaxis.cli import text_models
    from forceaxis.linear import modes as vibration

    check_drawing(out)
    result = vibration.modes(
        model, input_, output, linear.overrides(overrides), linear.states(modes), free
    )
    draw(out, lambda plots: plots.mode_shapes(result, result.title))
    present(result, as_json, text_models.describe_modes, out)


@loop.command(
    cls=Slow,
    short_help="Poles and zeros of the plant or the closed loop.",
    epilog="""forceaxis loop poles fig4_19
    forceaxis loop poles fig4_19 --free --output drive.tach
    forceaxis loop poles fig4_19 --law force_gain=10 --timing zoh+1
    forceaxis loop poles strike_biquad""",
)
@subject_options
@law_option
@click.option(
    "--timing",
    type=TIMINGS,
    help="Sampling. Default: continuous for the plant; with a gain as in the experiment, else zoh.",
)
@free
@click.option(
    "--input", "input_", help="Input of the plant: drive.command, drive.force or BODY.force."
)
@click.option("--output", help="A signal of the model. Default: the input of ADC 0.")
@click.option("--span-hz", type=Positive(), help="Half-width of the figure, Hz.")
@drawn
@as_json
@requests_loop
def poles(
    request: "LoopRequest",
    as_json: bool,
    input_: str | None,
    output: str | None,
    out: Path | None,
    span_hz: float | None,
) -> None:
    """Compute the poles and zeros of MODEL, or of the closed force loop of MODEL|EXPERIMENT.

    Without a gain the transfer function is from --input (default drive.command, V) to --output.
    With a gain it is from the set-point of the law to the controlled signal. With an EXPERIMENT the
    loop is closed with its law and gain unless --input is given. Zeros that cancel poles are
    printed too.
    """
    from forceaxis.cli import text_models
    from forceaxis.linear import limits

    check_drawing(out)
    result = limits.poles_of(request, input_, output)
    draw(out, lambda plots: plots.poles_figure(result, span_hz))
    present(result, as_json, text_models.describe_poles, out)


@loop.command(
    cls=Slow,
    short_help="Frequency response of plant or loop, also beside measured points.",
    epilog="""forceaxis loop bode fig4_19 --vary b_w=8.25,363 --out bode.png
    forceaxis loop bode fig2_11 --input drive.force --output robot.position --output tip.position
    forceaxis loop bode strike_biquad --of sensitivity --over k_w=30%,m_w=30% --out s.png
    forceaxis loop bode press/model.toml --measured out/m/30N --set k_w=4.1e5 --out both.png""",
)
@subject_options
@law_option
@vary
@free
@over_options
@click.option(
    "--of",
    "part",
    type=click.Choice(["plant", "loop", "closed", "sensitivity"]),
    help="plant: from --input to --output; loop: loop gain L; closed: T from set-point to signal; "
    "sensitivity: S = 1 / (1 + L). Default: plant for a MODEL, loop for an EXPERIMENT or a law.",
)
@click.option(
    "--input",
    "input_",
    default="drive.command",
    show_default=True,
    help="Input of the plant: drive.command (V), drive.force (N) or BODY.force (N).",
)
@outputs_option
@click.option(
    "--measured", multiple=True, metavar="FOLDER",
    help="Folder of `forceaxis measure --out`; its points are drawn over MODEL. Repeatable.",
)  # fmt: skip
@click.option("--from-hz", type=float, default=0.5, show_default=True)
@click.option("--to-hz", type=float, default=500.0, show_default=True)
@drawn
@as_json
@click.pass_context
@requests_loop
def bode(
    context: click.Context,
    request: "LoopRequest",
    out: Path | None,
    as_json: bool,
    measured: tuple[str, ...],
    vary: tuple[str, ...],
    ranges: tuple[str, ...],
    visit: str | None,
    part: str | None,
    input_: str,
    outputs: tuple[str, ...],
    from_hz: float,
    to_hz: float,
) -> None:
    """Draw the frequency response (Bode plot) of MODEL|EXPERIMENT or of the force loop of
    MODEL|EXPERIMENT.

    The phase is unwrapped from 0 at the lowest frequency. The default of --timing is continuous for
    the plant. For the force loop, it is that of the experiment, or else zoh. JSON: curves, each
    with output, unit, frequency_hz, magnitude, phase_deg; if the input is drive.command, also loop,
    as `forceaxis loop limit`, with the margins at the gain under "at". For a set of plants: the
    worst values under "at", the nominal curve first. With --measured: "measured", each with the
    points, their 95 % radius, coherence, and whether MODEL matches.
    """
    from forceaxis.cli import text_models
    from forceaxis.cli.text_loops import describe_curves_of_set
    from forceaxis.linear import curves, sets

    check_drawing(out)
    if measured:
        _overlay(context, request.model, out, as_json, measured)
        return
    view = curves.BodeView(part, input_, outputs, (from_hz, to_hz), vary)
    found, result = sets.bode(request, view, ranges, visit)
    draw(out, lambda plots: plots.bode_figure(found, result))
    if isinstance(result, sets.CurvesOfSet):
        present(result, as_json, describe_curves_of_set, out)
    else:
        present(result, as_json, text_models.describe_bode, out)


OVERLAY = ("model", "out", "as_json", "measured", "overrides", "from_hz", "to_hz")


def _overlay(
    context: click.Context,
    model: str,
    out: Path | None,
    as_json: bool,
    measured: tuple[str, ...],
) -> None:
    """Draw measured points over the response of the model. Input, output, delay and states of the
    model's elements are those of the measurement."""
    from forceaxis import linear
    from forceaxis.cli import text_models
    from forceaxis.identify import overlay

    for name, value in context.params.items():
        source = context.get_parameter_source(name)
        if source is click.core.ParameterSource.COMMANDLINE and name not in OVERLAY:
            option = next(p.opts[0] for p in context.command.params if p.name == name)
            raise click.UsageError(
                f"{option}: expected only without --measured, because the measured response "
                f"states its signals and states, got {value!r}"
            )
    span_hz = context.params["from_hz"], context.params["to_hz"]
    overrides = linear.overrides(context.params["overrides"])
    found, result = overlay.overlay(model, measured, overrides, span_hz)
    if out:
        from forceaxis import drawing
        from forceaxis.identify import plots

        drawing.save(plots.overlay(found, result.measured, result), out)
    present(result, as_json, text_models.describe_measured, out)


@loop.command(
    cls=Slow,
    short_help="State space matrices, as text, .npz or .mat.",
    epilog="""forceaxis loop linearise fig4_19 --out fig4_19.mat
    forceaxis loop linearise laboratory --mode "drive.amplifier=high outer" --timing zoh --json
    forceaxis loop linearise fig4_15 --free --input tip.force --output tip.position""",
)
@model_options
@free
@click.option(
    "--input",
    "inputs",
    multiple=True,
    default=["drive.command"],
    show_default=True,
    help="drive.command (V), drive.tach (V), drive.force (N) or BODY.force (N). Repeatable.",
)
@outputs_option
@click.option("--load", is_flag=True, help="Leave out the drive (thesis 2.3.2).")
@click.option("--timing", type=TIMINGS, default="continuous", show_default=True)
@click.option("--out", type=File(), help="Write the matrices: FILE.npz or FILE.mat.")
@as_json
def linearise(
    model: str,
    overrides: tuple[str, ...],
    modes: tuple[str, ...],
    free: bool,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    load: bool,
    timing: str,
    out: Path | None,
    as_json: bool,
) -> None:
    """Compute the linear state space model of MODEL for one combination of states of its elements:
    the matrices of x' = A x + B u and y = C x + D u in SI units.

    With a sampled timing the equation is x(k+1) = A x(k) + B u(k). JSON, .npz and .mat contain A,
    B, C, D, dt in s (null or 0: continuous) and the names of states, inputs and outputs.
    """
    from forceaxis.cli import text_models
    from forceaxis.linear import system as linear
    from forceaxis.linear import working

    linear.check_export(out)
    linear.once("input", ["drive.force" if load and i == "drive.command" else i for i in inputs])
    linear.once("output", outputs)
    values, states = linear.overrides(overrides), linear.states(modes)
    mode = working.working(linear.find_model(model), values, states, free)
    if {"reading", "adc0"} & set(outputs):
        linear.facts(model, values).expect_fresh_reading("equations of the reading")
    system = linear.linearise(model, inputs, outputs, values, mode.modes, free, not load)
    if timing != "continuous":
        linear.facts(model, values).expect_no_bus("equations of a sampled plant")
        system = system.sampled(delay_ticks=int(timing == "zoh+1"))
    if out:
        linear.export(system, out)
    if as_json:
        click.echo(json.dumps(to_json(linear.system_result(system, mode)), allow_nan=False))
        return
    click.echo(text_models.describe_system(system, mode.shown, linear.facts(model, values).drive))
    if out:
        click.echo(f"file         {paths.quoted(out)}")
