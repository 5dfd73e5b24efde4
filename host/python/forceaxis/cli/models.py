"""The commands `modes`, `poles`, `bode`, `linearise` and `beam`, which analyse linear models,
and options that the commands for force loops also use."""

import functools
import inspect
import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

import click

from forceaxis import paths
from forceaxis.cli.common import (
    Callback,
    File,
    Parameter,
    Positive,
    Slow,
    Subject,
    as_json,
    done_waiting,
    fitted_lines,
    mode_option,
    set_option,
)
from forceaxis.results import to_json

Result = TypeVar("Result", bound="Convertible")

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from forceaxis.linear.request import LoopRequest
    from forceaxis.results import Convertible


def check_drawing(out: Path | None) -> None:
    """Raise InputError if the suffix of `out` is not that of an image file. A command calls this
    function before a long computation."""
    if out:
        from forceaxis import drawing

        drawing.check_name(out)


def draw(out: Path | None, make: Callable[[ModuleType], "Figure"]) -> None:
    """Write the plot that make(plots) draws to the file `out`. If `out` is None, draw nothing.
    `plots` is the module linear.plots, which is loaded only for a plot."""
    if out:
        from forceaxis import drawing
        from forceaxis.linear import plots

        drawing.save(make(plots), out)


def present(
    result: Result, as_json: bool, describe: Callable[[Result], str], out: Path | None = None
) -> None:
    """Print the result of a command as a JSON object, or as the text of `describe` and the path
    of the image file `out`."""
    done_waiting()
    if as_json:
        click.echo(json.dumps(to_json(result), allow_nan=False))
        return
    click.echo(fitted_lines(describe(result)))
    if out:
        click.echo(f"figure       {paths.quoted(out)}")


def _model_options(subject: str, *folders: Path) -> Callable[[Callback], Callback]:
    def add(verb: Callback) -> Callback:
        for decorate in (
            mode_option("modes"),
            set_option("A parameter of the model in its unit (b_m=0.02). Repeatable."),
            click.argument("model", metavar=subject, type=Subject(*folders)),
        ):
            verb = decorate(verb)
        return verb

    return add


# Decorators that add the argument MODEL (or MODEL|EXPERIMENT) and the options --set and --mode to a
# command.
model_options = _model_options("MODEL", paths.MODELS)
subject_options = _model_options("MODEL|EXPERIMENT", paths.MODELS, paths.EXPERIMENTS)


LAWS = click.Choice(
    ["p", "pi", "pd", "lead", "derivative", "stiffness", "damping", "impedance", "bank"]
)


TIMINGS = click.Choice(["continuous", "zoh", "zoh+1"])


def law_options(verb: Callback) -> Callback:
    """Add the options of a control law to a command: --law, the parameters of each law, and the
    gain in two units."""
    for name, text in reversed(
        {
            "--integral-rad-per-s": "w_i of law pi: k (1 + w_i / s).",
            "--derivative-s": "T_d of laws pd and derivative: k (f_d - f - T_d f'). pd "
            "differentiates the measured force; derivative has a sensor of its rate "
            "(LINK.spring_force_rate).",
            "--lead-zero-hz": "w_z of law lead: k (1 + s / w_z) / (1 + s / w_p).",
            "--lead-pole-hz": "w_p of law lead.",
            "--stiffness-n-per-m": "K_fs of laws stiffness and impedance; x from the encoder.",
            "--damping-ns-per-m": "K_fd of laws damping and impedance.",
            "--velocity-gain-vs-per-m": "Velocity gain K_v of the force laws and of stiffness.",
            "--gain": "Gain k of the law, V/N.",
            "--firmware-gain": "Gain as firmware.force_gain, DAC codes per force count.",
        }.items()
    ):
        verb = click.option(name, type=float, help=text)(verb)
    return click.option(
        "--law",
        type=LAWS,
        help="Control law of force, or of force and motion (thesis 1.1.3, 6.2.1). bank: the bank "
        "that an experiment selects. Default: that of the experiment, else p.",
    )(verb)


# Parameter of the control law for each parameter of the command's function. The names of the
# function's parameters are in lower case, as the library click writes them.
LAW_PARAMETERS = {
    name.lower(): name
    for name in (
        "integral_rad_per_s",
        "derivative_s",
        "lead_zero_hz",
        "lead_pole_hz",
        "stiffness_N_per_m",
        "damping_Ns_per_m",
        "velocity_gain_Vs_per_m",
    )
}


def requests_loop(verb: Callable[..., None]) -> Callable[..., None]:
    """Give a command the parameter `request`, a LoopRequest. The LoopRequest is made from all
    options that are not parameters of the command's own function."""
    own = inspect.signature(verb).parameters

    @functools.wraps(verb)
    def with_request(
        *arguments: Any, overrides: tuple[str, ...], modes: tuple[str, ...], **given: Any
    ) -> None:
        from forceaxis import linear
        from forceaxis.linear.request import LoopRequest

        values = {name: given.pop(option) for option, name in LAW_PARAMETERS.items()}
        request = LoopRequest(
            overrides=linear.overrides(overrides),
            states=linear.states(modes),
            parameters={name: value for name, value in values.items() if value is not None},
            **{name: given.pop(name) for name in [*given] if name not in own},
        )
        verb(*arguments, request=request, **given)

    return with_request


vary = click.option(
    "--vary",
    multiple=True,
    type=Parameter(),
    metavar="NAME=VALUE,VALUE",
    help="Draw one curve for each value of a model parameter. Repeatable: all combinations.",
)


free = click.option("--free", is_flag=True, help="Contacts are open.")


outputs_option = click.option(
    "--output",
    "outputs",
    multiple=True,
    default=["reading"],
    show_default=True,
    help="A signal of the model, reading (the input of ADC 0), adc0, adc1, encoder. Repeatable.",
)


drawn = click.option("--out", type=File(), help="Draw a figure: FILE.png, .svg or .pdf.")


loop_timing = click.option(
    "--timing", type=TIMINGS, help="Default: latency_ticks of the experiment, else zoh."
)


def over_options(verb: Callback) -> Callback:
    """Add the options for a set of plants to a command: --over, --modes and --timing, which also
    accepts "both"."""
    for decorate in (
        click.option(
            "--modes",
            "visit",
            type=click.Choice(["visited", "all", "nominal"]),
            help="States of amplifier, contact and friction that belong to the set. visited: those "
            "that occur in a run of EXPERIMENT; nominal: that of --mode. visited and all have "
            "frictions stuck and sliding, without saturation. Default: visited; all for a MODEL.",
        ),
        click.option(
            "--over",
            "ranges",
            multiple=True,
            type=Parameter(),
            metavar="NAME=RANGE",
            help="Tolerance of a parameter, k_w=30% or m_w=4..9. The set has its corners, random "
            "plants and the result of a search for the worst. Repeatable, or several with commas.",
        ),
        click.option(
            "--timing",
            type=click.Choice([*TIMINGS.choices, "both"]),
            help="zoh: sampled at 1500 Hz with zero-order hold, as the axis; zoh+1: with a latency "
            "of one tick; both: a set of the two. Default: latency_ticks of the experiment, else "
            "zoh.",
        ),
    ):
        verb = decorate(verb)
    return verb


loop_output = click.option(
    "--output", default="reading", show_default=True, help="Signal that is fed back."
)


@click.command(
    name="modes",
    cls=Slow,
    epilog="""forceaxis modes fig4_19 --set b_w=363
    forceaxis modes fig4_15 --free --json""",
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
    """Compute the modes of vibration of MODEL: frequency, damping ratio, shape, and if actuator and
    sensor are colocated in the mode of vibration (thesis 6.1.4).

    MODEL is a path or a name in sim/models. The modes are those of the mechanics without damping
    and without drive. The label compares the sign of the residue of a mode, from input to output,
    with that of the lowest mode; a different result for the next lower mode is printed too. A mode
    with residue 0 is colocated if dampers couple it (its poles and zeros lie close together), else
    neither. The command also prints the corresponding pole of the complete system with damping
    and drive.

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


@click.command(
    cls=Slow,
    epilog="""forceaxis poles fig4_19
    forceaxis poles fig4_19 --free --output drive.tach
    forceaxis poles fig4_19 --firmware-gain 10 --timing zoh+1
    forceaxis poles strike_biquad""",
)
@subject_options
@law_options
@click.option(
    "--timing",
    type=TIMINGS,
    help="Default: continuous for the plant; with a gain that of the experiment, else zoh.",
)
@free
@click.option("--input", "input_", help="drive.command, drive.force or BODY.force.")
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


@click.command(
    cls=Slow,
    epilog="""forceaxis bode fig4_19 --vary b_w=8.25,363 --out bode.png
    forceaxis bode fig2_11 --input drive.force --output robot.position --output tip.position
    forceaxis bode strike_biquad --of sensitivity --over k_w=30%,m_w=30% --out s.png
    forceaxis bode press/model.toml --measured out/m/30N --set k_w=4.1e5 --out both.png""",
)
@subject_options
@law_options
@vary
@free
@over_options
@click.option(
    "--of",
    "part",
    type=click.Choice(["plant", "loop", "closed", "sensitivity"]),
    help="plant: from --input to --output; loop: loop gain L; closed: T from set-point to signal; "
    "sensitivity: S = 1 / (1 + L). Default: plant for a MODEL, loop for an EXPERIMENT or --law.",
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

    The phase is unwrapped from 0 at the lowest frequency. The default --timing is continuous for
    the plant; for the others it is that of the experiment, else zoh. JSON: curves, each with
    output, unit, frequency_hz, magnitude, phase_deg; if the input is drive.command, also loop, as
    `forceaxis limit`, with the margins at the gain under "at". For a set of plants: the worst
    values under "at", the nominal curve first. With --measured: "measured", each with the points,
    their 95 % radius, coherence, and whether MODEL matches.
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
    """Draw measured points over the response of the model. The model has the same input, output,
    element states and delay as the measurement."""
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


@click.command(
    cls=Slow,
    epilog="""forceaxis linearise fig4_19 --out fig4_19.mat
    forceaxis linearise laboratory --mode "drive.amplifier=high outer" --timing zoh --json
    forceaxis linearise fig4_15 --free --input tip.force --output tip.position""",
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


@click.command(
    cls=Slow,
    epilog="""forceaxis beam
    forceaxis beam --modes 4 --json""",
)
@click.option("--bending-stiffness-nm2", type=float, default=1.0, show_default=True, help="E I.")
@click.option("--mass-per-length-kg-per-m", type=float, default=1.0, show_default=True)
@click.option("--length-m", type=float, default=1.0, show_default=True)
@click.option("--modes", type=click.IntRange(1, 200), default=4, show_default=True)
@as_json
def beam(modes: int, as_json: bool, **given: float) -> None:
    """Compute the exact poles and zeros of the elastic beam of thesis section 2.4.4, and the error
    if a few modes of vibration approximate the beam.

    The beam slides at the actuator; its tip is free. The command prints the undamped poles and
    zeros and the error of an approximation by the first n modes, for the first four modes. JSON:
    modes, each with b l, pole_rad_per_s, actuator_zero_rad_per_s (imaginary pairs) and
    tip_zero_per_s (a real pair); approximation_errors for n = 4 to 40.
    """
    from forceaxis.cli import text_models
    from forceaxis.linear import beam as bending

    result = bending.analyse(
        bending.Beam(
            given["bending_stiffness_nm2"], given["mass_per_length_kg_per_m"], given["length_m"]
        ),
        modes,
    )
    present(result, as_json, text_models.describe_beam)


VERBS = (linearise, poles, modes_, bode, beam)
