"""Verbs of a model's linear equations: state space, poles, modes, frequency response; the beam."""

import json

import click

from forceaxis import paths
from forceaxis.cli.common import (
    File,
    Parameter,
    Positive,
    Slow,
    Subject,
    as_json,
    done_waiting,
    fitted_lines,
    set_option,
)


def check_drawing(out):
    """Refuse a file name that no figure can have, before the work."""
    if out:
        from forceaxis import drawing

        drawing.check_name(out)


def draw(out, make):
    """Write the figure that make(linear.plots) gives to `out`, if one is wanted."""
    if out:
        from forceaxis import drawing
        from forceaxis.linear import plots

        drawing.save(make(plots), out)


def present(summary, as_json, describe, out=None):
    """Print a verb's result: one JSON object, or its description and the file that was drawn."""
    done_waiting()
    if as_json:
        click.echo(json.dumps(summary, allow_nan=False))
        return
    click.echo(fitted_lines(describe(summary)))
    if out:
        click.echo(f"figure       {paths.quoted(out)}")


def _model_options(subject, *folders):
    def add(verb):
        for decorate in (
            click.option(
                "--mode",
                "modes",
                multiple=True,
                metavar="ELEMENT=STATE",
                help="An element's state as in events.csv (sensor=apart, rail=forward, "
                "drive.amplifier=high outer). Default: contacts pressed, everything else in the "
                "middle of its range. Repeatable.",
            ),
            set_option("A model parameter (b_m=0.02), in its own unit. Repeatable."),
            click.argument("model", metavar=subject, type=Subject(*folders)),
        ):
            verb = decorate(verb)
        return verb

    return add


# --set, --mode, and MODEL or either of MODEL and EXPERIMENT (then --set also takes firmware.NAME).
model_options = _model_options("MODEL", paths.MODELS)
subject_options = _model_options("MODEL|EXPERIMENT", paths.MODELS, paths.EXPERIMENTS)


LAWS = click.Choice(
    ["p", "pi", "pd", "lead", "derivative", "stiffness", "damping", "impedance", "bank"]
)


TIMINGS = click.Choice(["continuous", "zoh", "zoh+1"])


def law_options(verb):
    """--law, its parameters, and a gain."""
    for name, text in reversed(
        {
            "--integral-rad-per-s": "pi: k (1 + w_i / s); w_i.",
            "--derivative-s": "pd and derivative: k (f_d - f - T_d f'); T_d. pd differentiates the "
            "reading, derivative has a sensor of f' (LINK.spring_force_rate).",
            "--lead-zero-hz": "lead: k (1 + s / w_z) / (1 + s / w_p).",
            "--lead-pole-hz": "lead.",
            "--stiffness-n-per-m": "stiffness and impedance: K_fs; x from the encoder.",
            "--damping-ns-per-m": "damping and impedance: K_fd.",
            "--velocity-gain-vs-per-m": "Inner damping K_v of the force laws and stiffness, V s/m.",
            "--gain": "A gain k (V/N).",
            "--firmware-gain": "The same as firmware.force_gain, DAC codes per 8-bit count.",
        }.items()
    ):
        verb = click.option(name, type=float, help=text)(verb)
    return click.option(
        "--law",
        type=LAWS,
        help="Feedback of force, or of force and motion (thesis 1.1.3, 6.2.1); bank: the bank that "
        "an experiment selects. Default: the experiment's, else p.",
    )(verb)


vary = click.option(
    "--vary",
    multiple=True,
    type=Parameter(),
    metavar="NAME=VALUE,VALUE",
    help="One curve for each value of a model parameter. Repeatable, all combinations.",
)


free = click.option("--free", is_flag=True, help="Contacts are apart.")


outputs_option = click.option(
    "--output",
    "outputs",
    multiple=True,
    default=["reading"],
    show_default=True,
    help="A signal of the model; reading, what ADC 0 converts; adc0, adc1, encoder. Repeatable.",
)


drawn = click.option("--out", type=File(), help="Draw it: FILE.png, .svg or .pdf.")


loop_timing = click.option(
    "--timing", type=TIMINGS, help="Default: the experiment's latency_ticks, else zoh."
)


def over_options(verb):
    """--over and --modes, and --timing with both delays."""
    for decorate in (
        click.option(
            "--modes",
            "visit",
            type=click.Choice(["visited", "all", "nominal"]),
            help="Modes of amplifier and contact in which all must hold: those that a run of the "
            "EXPERIMENT visits, all, or the one of --mode; saturated ones left out. Default: "
            "visited, of a MODEL all.",
        ),
        click.option(
            "--over",
            "ranges",
            multiple=True,
            type=Parameter(),
            metavar="NAME=RANGE",
            help="A parameter's range, k_w=30% or m_w=4..9: corners, random members, and a search "
            "for the worst. Repeatable, or several with commas between.",
        ),
        click.option(
            "--timing",
            type=click.Choice([*TIMINGS.choices, "both"]),
            help="zoh: sampled and held at 1500 Hz, as the axis runs; zoh+1: codes act one tick "
            "later; both: a set of the two. Default: the experiment's latency_ticks, else zoh.",
        ),
    ):
        verb = decorate(verb)
    return verb


loop_output = click.option(
    "--output", default="reading", show_default=True, help="The signal that is fed back."
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
    help="drive.force, the drive's pair of forces, or BODY.force.",
)
@click.option(
    "--output",
    help="A signal (tip.acceleration). Default: what the force reading shows; apart, the position "
    "of the body that would touch.",
)
@drawn
@as_json
def modes_(model, overrides, modes, free, input_, output, out, as_json):
    """Modes of vibration of MODEL, and which are dynamically colocated (thesis 6.1.4).

    MODEL is a file or the stem of one in sim/models. Modes are those of the undamped mechanics with
    the drive removed. The label compares the sign of a mode's residue, from input to output, with
    that of the lowest mode; the comparison with the mode below is printed where it differs. A mode
    of residue 0 is colocated if dampers couple it (its poles and zeros lie side by side), else
    neither. Beside each mode stands the pole of the whole damped system, drive included, that it
    becomes.

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
    from forceaxis.linear import modes as vibration

    check_drawing(out)
    result = vibration.modes(
        model, input_, output, linear.overrides(overrides), linear.states(modes), free
    )
    draw(out, lambda plots: plots.mode_shapes(result, result["title"]))
    present(result, as_json, vibration.describe, out)


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
    help="Default: continuous for the plant, with a gain the experiment's, else zoh.",
)
@free
@click.option("--input", "input_", help="drive.command, drive.force or BODY.force.")
@click.option("--output", help="A signal of the model. Default: reading, what ADC 0 converts.")
@click.option("--span-hz", type=Positive(), help="Half-width of the frame of --out, Hz.")
@drawn
@as_json
def poles(model, as_json, gain, firmware_gain, input_, out, span_hz, **given):
    """Poles, zeros and transfer function of MODEL, or of a loop closed around it with a gain.

    Without a gain: from --input (default drive.command, V) to --output. With one: from the law's
    set-point to the signal that it controls. Of an EXPERIMENT the loop is closed with its law and
    gain unless --input is given. Zeros include those that cancel poles.
    """
    from forceaxis.linear import limits

    check_drawing(out)
    summary = limits.poles_of(model, gain, firmware_gain, input_, **given)
    draw(out, lambda plots: plots.poles_figure(summary, span_hz))
    present(summary, as_json, limits.describe_poles, out)


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
    help="The plant from --input to --output, the loop gain L, T from set-point to signal, or "
    "S = 1 / (1 + L). Default: plant of a MODEL, loop of an EXPERIMENT or with --law.",
)
@click.option(
    "--input",
    "input_",
    default="drive.command",
    show_default=True,
    help="Of the plant: drive.command (V), drive.force (N) or BODY.force (N).",
)
@outputs_option
@click.option(
    "--measured", multiple=True, metavar="FOLDER",
    help="Of `forceaxis measure --out`: points over MODEL between the same signals. Repeatable.",
)  # fmt: skip
@click.option("--from-hz", type=float, default=0.5, show_default=True)
@click.option("--to-hz", type=float, default=500.0, show_default=True)
@drawn
@as_json
@click.pass_context
def bode(context, model, out, as_json, measured, **given):
    """Frequency response around MODEL|EXPERIMENT: amplitude and phase, curves over each other.

    The phase is unwrapped from 0 at the lowest frequency. The default --timing is continuous for
    the plant, and the experiment's, else zoh, for the others. JSON: curves, each with output, unit,
    frequency_hz, magnitude, phase_deg and, from drive.command, loop: as `forceaxis limit`, with
    the margins at the gain under "at". Over a set: the worst under "at", the nominal curve first.
    With --measured: "measured", each with the points, their 95 % radius, coherence, and whether
    MODEL fits.
    """
    from forceaxis.linear import curves, sets

    check_drawing(out)
    if measured:
        _overlay(context, model, out, as_json, measured)
        return
    found, summary = sets.bode(model, **given)
    draw(out, lambda plots: plots.bode_figure(found, summary))
    present(summary, as_json, sets.describe if "over" in summary else curves.describe_bode, out)


OVERLAY = ("model", "out", "as_json", "measured", "overrides", "from_hz", "to_hz")


def _overlay(context, model, out, as_json, measured):
    """bode with --measured: signals, states and timing are those of the measurement."""
    from forceaxis import linear
    from forceaxis.identify import overlay

    for name, value in context.params.items():
        source = context.get_parameter_source(name)
        if source is click.core.ParameterSource.COMMANDLINE and name not in OVERLAY:
            option = next(p.opts[0] for p in context.command.params if p.name == name)
            raise click.UsageError(
                f"{option}: expected without --measured, which has signals and states of its own, "
                f"got {value!r}"
            )
    span_hz = context.params["from_hz"], context.params["to_hz"]
    overrides = linear.overrides(context.params["overrides"])
    found, points, summary = overlay.overlay(model, measured, overrides, span_hz)
    if out:
        from forceaxis import drawing
        from forceaxis.identify import plots

        drawing.save(plots.overlay(found, points, summary), out)
    present(summary, as_json, overlay.describe, out)


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
@click.option("--load", is_flag=True, help="Without the drive: the load of 2.3.2.")
@click.option("--timing", type=TIMINGS, default="continuous", show_default=True)
@click.option("--out", type=File(), help="Write the matrices: FILE.npz or FILE.mat.")
@as_json
def linearise(model, overrides, modes, free, inputs, outputs, load, timing, out, as_json):
    """State space of MODEL in one mode: x' = A x + B u, y = C x + D u, in SI units.

    Sampled timings give x(k+1) = A x(k) + B u(k). JSON, .npz and .mat hold A, B, C, D, dt (null
    or 0: continuous) and the names of states, inputs and outputs.
    """
    from forceaxis.linear import system as linear
    from forceaxis.linear import working

    linear.check_export(out)
    linear.once("--input", ["drive.force" if load and i == "drive.command" else i for i in inputs])
    linear.once("--output", outputs)
    values, states = linear.overrides(overrides), linear.states(modes)
    mode = working.working(linear.find_model(model), values, states, free)
    system = linear.linearise(model, inputs, outputs, values, mode.modes, free, not load)
    if timing != "continuous":
        system = system.sampled(delay_ticks=int(timing == "zoh+1"))
    if out:
        linear.export(system, out)
    if as_json:
        click.echo(json.dumps(linear.summary(system, mode), allow_nan=False))
        return
    click.echo(linear.describe(system, mode))
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
def beam(modes, as_json, **given):
    """The distributed beam of 2.4.4, sliding at the actuator and free at the tip.

    Its poles and zeros (undamped) and the error of its polynomial approximation by the first n
    modes, through the fourth. JSON: modes, each with b l, pole_rad_per_s, actuator_zero_rad_per_s
    (imaginary pairs) and tip_zero_per_s (a real pair); approximation_errors for n = 4 to 40.
    """
    from forceaxis.linear import beam as bending

    result = bending.summary(
        bending.Beam(
            given["bending_stiffness_nm2"], given["mass_per_length_kg_per_m"], given["length_m"]
        ),
        modes,
    )
    present(result, as_json, bending.describe)


VERBS = (linearise, poles, modes_, bode, beam)
