"""Verbs of the frequency domain."""

import json
import sys

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.common import File, Folder, Positive, Verb, as_json, threads


def check_drawing(out):
    """Refuse a file name that no figure can have, before the work."""
    if out:
        from forceaxis.linear import plots as frequency_plots

        frequency_plots.check_name(out)


def draw(out, make):
    """Write the figure that make(frequency_plots) gives to `out`, if one is wanted."""
    if out:
        from forceaxis.linear import plots as frequency_plots

        frequency_plots.save(make(frequency_plots), out)


def present(summary, as_json, describe, out=None):
    """Print a verb's result: one JSON object, or its description and the file that was drawn."""
    if as_json:
        click.echo(json.dumps(summary, allow_nan=False))
        return
    click.echo(describe(summary))
    if out:
        click.echo(f"figure       {paths.display(out)}")


def model_options(verb):
    """MODEL, --set and --mode."""
    for decorate in (
        click.option(
            "--mode",
            "modes",
            multiple=True,
            metavar="ELEMENT=STATE",
            help="An element's state as in events.csv (sensor=apart, rail=forward, "
            "drive.amplifier=high outer). Default: contacts pressed, everything else in the middle "
            "of its range. Repeatable.",
        ),
        click.option(
            "--set",
            "overrides",
            multiple=True,
            metavar="NAME=VALUE",
            help="A model parameter (b_m=0.02), in its own unit. Repeatable.",
        ),
        click.argument("model"),
    ):
        verb = decorate(verb)
    return verb


LAWS = click.Choice(["p", "pi", "pd", "lead", "derivative", "stiffness", "damping", "impedance"])
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
        default="p",
        show_default=True,
        help="Feedback of force, or of force and motion (thesis 1.1.3, 6.2.1).",
    )(verb)


vary = click.option(
    "--vary",
    multiple=True,
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
loop_timing = click.option("--timing", type=TIMINGS, default="zoh", show_default=True)
loop_output = click.option(
    "--output", default="reading", show_default=True, help="The signal that is fed back."
)


@click.command(
    name="check-thesis", cls=Verb, epilog="forceaxis check-thesis\nforceaxis check-thesis --json"
)
@as_json
def check_thesis(as_json):
    """Set the numbers that the thesis quotes beside what its models give.

    Frequencies, crossovers, damping ratios, improvements; where ours differ, a line says why. Exit
    status 1 if one differs without a reason.
    """
    from forceaxis.thesis import claims as thesis

    result = thesis.check()
    click.echo(json.dumps(result, allow_nan=False) if as_json else thesis.describe(result))
    if result["unexplained"]:
        sys.exit(1)


def band(context, option, text):
    """LOW:HIGH in Hz."""
    if text is None:
        return None
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise InputError(f"--band: {text}: expected LOW:HIGH, two frequencies in Hz") from None
    return [low, high]


@click.command(
    cls=Verb,
    epilog="""forceaxis measure fig3_9 --out out/fig3_9
    forceaxis measure fig3_12 --inject codes --output adc0 --level 60
    forceaxis measure fig4_19 --output sensor.force --clamped --band 1:100 --plant-set m_r=146""",
)
@click.argument("target")
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
    help="The model has its contacts apart; see that the plant has, too (--set approach=0.5).",
)  # fmt: skip
@click.option("--seed", type=int, help="Of excitation and converters. Default: 0.")
@click.option(
    "--set", "overrides", multiple=True, metavar="NAME=VALUE", help="Parameter of plant and model."
)
@click.option(
    "--plant-set", multiple=True, metavar="NAME=VALUE",
    help="Parameter of the plant alone, behind the analyzer's back.",
)  # fmt: skip
@click.option(
    "--out", type=Folder(), help="Folder for response.csv, .npz, plot.png and result.json."
)
@as_json
def measure(target, overrides, plant_set, out, as_json, **options):
    """Measure a frequency response with a virtual signal analyzer, beside the linear model.

    TARGET is a measurement file (or the stem of one in sim/measurements: fig3_6 to fig3_12), or a
    model (path, or stem in sim/models) with at least --output. Options replace keys of the file.
    The excitation goes into the drive as volts, or runs through the firmware's excitation mode as
    codes. Prints the gain at the lowest line, the corner if the first octave is flat, phase
    crossings, how long contacts were pressed, coherence and error, how many points have the model
    inside their 95 % band, and whether the model as a whole fits; it not fitting is a result.
    """
    from forceaxis.identify import result as analyzer
    from forceaxis.linear import system as linear

    if overrides:
        options["set"] = linear.overrides(overrides)
    done = analyzer.run(target, options, linear.overrides(plant_set))
    if out:
        analyzer.write(done, out)
    if as_json:
        click.echo(json.dumps(done.summary, allow_nan=False))
    else:
        click.echo(analyzer.describe(done.summary))
        if out:
            click.echo(f"files        {paths.display(out)}")


@click.command(
    name="modes",
    cls=Verb,
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
    --json: {"model": "fig4_19", "title": ..., "contact": "pressed" | "apart" | null (has none),
     "input": "drive.force", "output": "sensor.spring_force", "path": true, "criterion": ...,
     "modes": [                          ascending
       {"frequency_hz": 44.84, "damping_ratio": 0.0067,        null at 0 Hz
        "shape": {"robot": -0.0106, "workpiece": 1.0},         largest is 1
        "residue": 178.1,                unit of the output / (N s^2)
        "label": "colocated",            or "noncolocated", "neither"
        "against_lowest": "colocated", "against_below": "colocated",
        "reference": false,              true: the mode that the others are compared with
        "driven": {"frequency_hz": 44.85, "damping_ratio": 0.007,
                   "real": -1.97, "imag": 281.8}}],            1/s, or null
     "other_poles": [{...}]}             of the whole system, matched by no mode, as "driven"
    """
    from forceaxis.linear import modes as vibration
    from forceaxis.linear import system as linear

    check_drawing(out)
    result = vibration.modes(
        model, input_, output, linear.overrides(overrides), linear.states(modes), free
    )
    draw(out, lambda plots: plots.mode_shapes(result, result["title"]))
    present(result, as_json, vibration.describe, out)


@click.command(
    cls=Verb,
    epilog="""forceaxis limit fig4_19 --set b_m=0.02 --json
    forceaxis limit fig4_19 --law lead --lead-zero-hz 40 --lead-pole-hz 400 --timing zoh+1
    forceaxis limit laboratory --firmware-gain 10""",
)
@model_options
@free
@law_options
@click.option(
    "--timing",
    type=TIMINGS,
    default="zoh",
    show_default=True,
    help="zoh: sampled and held at 1500 Hz, as the axis runs; zoh+1: codes act one tick later.",
)
@click.option(
    "--output", default="reading", help="Feed back this signal. Default: what ADC 0 converts."
)
@as_json
def limit(model, as_json, gain, firmware_gain, **given):
    """The critical gain of a force loop around MODEL, a path or a stem of sim/models (fig4_19).

    The loop is linear: the model's equations in one mode, in contact. Prints every gain at which
    a closed-loop pole crosses the stability boundary, the largest setting of the firmware below
    the first, and with --gain or --firmware-gain the margins there. JSON: critical_gain in `unit`
    (null: stable for all gains; 0: unstable however small, see reason), frequency_hz, crossings.
    """
    from forceaxis.linear import limits as loop_verbs

    loop = loop_verbs.from_options(model, **given)
    summary = loop_verbs.limit_summary(loop, loop_verbs.one_gain(loop, gain, firmware_gain))
    present(summary, as_json, loop_verbs.describe_limit)


@click.command(
    cls=Verb,
    epilog="""forceaxis poles fig4_19
    forceaxis poles fig4_19 --free --output drive.tach
    forceaxis poles fig4_19 --firmware-gain 10 --timing zoh+1""",
)
@model_options
@law_options
@click.option(
    "--timing",
    type=TIMINGS,
    help="Default: continuous for the plant, zoh (as the axis runs) with a gain.",
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
    set-point to the signal that it controls. Zeros include those that cancel poles.
    """
    from forceaxis.linear import limits as loop_verbs

    check_drawing(out)
    summary = loop_verbs.poles_of(model, gain, firmware_gain, input_, **given)
    draw(out, lambda plots: plots.poles_figure(summary, span_hz))
    present(summary, as_json, loop_verbs.describe_poles, out)


@click.command(
    cls=Verb,
    epilog="""forceaxis bode fig4_19 --vary b_w=8.25,363 --out bode.png
    forceaxis bode fig2_11 --input drive.force --output robot.position --output tip.position""",
)
@model_options
@vary
@free
@click.option(
    "--input",
    "input_",
    default="drive.command",
    show_default=True,
    help="drive.command (V), drive.force (N) or BODY.force (N).",
)
@outputs_option
@click.option("--timing", type=TIMINGS, default="continuous", show_default=True)
@click.option("--from-hz", type=float, default=0.5, show_default=True)
@click.option("--to-hz", type=float, default=500.0, show_default=True)
@click.option("--gain", type=float, help="Margins of a force loop with this gain (V/N).")
@click.option("--firmware-gain", type=float, help="The same as firmware.force_gain.")
@drawn
@as_json
def bode(
    model, overrides, vary, modes, free, input_, outputs, timing, from_hz, to_hz, gain,
    firmware_gain, out, as_json,
):  # fmt: skip
    """Open-loop frequency response of MODEL: amplitude and phase, several curves over each other.

    The phase is unwrapped from 0 at the lowest frequency. JSON: curves, each with output, unit,
    frequency_hz, magnitude, phase_deg and, from drive.command, loop: as `forceaxis limit`, with
    the margins at --gain under "at".
    """
    from forceaxis.linear import plots as frequency_plots

    check_drawing(out)
    figure, summary = frequency_plots.bode_verb(
        model, overrides, vary, modes, free, input_, outputs, timing, from_hz, to_hz, gain,
        firmware_gain,
    )  # fmt: skip
    draw(out, lambda plots: figure)
    present(summary, as_json, frequency_plots.describe_bode, out)


@click.command(
    cls=Verb,
    epilog="""forceaxis rlocus fig4_19 --timing continuous --out locus.png
    forceaxis rlocus fig4_19 --vary b_w=8.25,363 --span-hz 70 --firmware-gain 5 --out b_w.png""",
)
@model_options
@law_options
@vary
@free
@loop_timing
@loop_output
@click.option(
    "--span-hz",
    type=Positive(),
    help="Height of the frame, Hz. Default: the structural dynamics around the crossing.",
)
@drawn
@as_json
def rlocus(model, out, as_json, **given):
    """Root locus of a force loop around MODEL, with its critical gain.

    x: open-loop poles, o: zeros; in Hz, the upper half-plane; of a sampled loop log(z) / T. A
    filled diamond is the critical gain, as `forceaxis limit` gives it; --gain or --firmware-gain
    mark the poles there. JSON: loci, each with gains, branches, poles, zeros in 1/s, crossings.
    """
    from forceaxis.linear import plots as frequency_plots

    check_drawing(out)
    figure, summary = frequency_plots.rlocus_verb(model, **given)
    draw(out, lambda plots: figure)
    present(summary, as_json, frequency_plots.describe_rlocus, out)


@click.command(cls=Verb, epilog="forceaxis nyquist fig4_19 --firmware-gain 5 --out nyquist.png")
@model_options
@law_options
@free
@loop_timing
@loop_output
@drawn
@as_json
def nyquist(model, out, as_json, **given):
    """Nyquist plot of a force loop around MODEL at a gain, by default half the critical one.

    JSON: as `forceaxis limit` with that gain (margins under "at"), and the curve:
    frequency_hz_of_curve, real, imag, magnitude, phase_deg of the loop gain.
    """
    from forceaxis.linear import limits as loop_verbs
    from forceaxis.linear import plots as frequency_plots

    check_drawing(out)
    figure, summary = frequency_plots.nyquist_verb(model, **given)
    draw(out, lambda plots: figure)
    present(summary, as_json, loop_verbs.describe_limit, out)


@click.command(
    cls=Verb,
    epilog="""forceaxis advise laboratory
    forceaxis advise sim/experiments/contact.toml --simulate --out advice.png""",
)
@click.argument("model", metavar="MODEL|EXPERIMENT")
@click.option("--set", "overrides", multiple=True, metavar="NAME=VALUE", help="A model parameter.")
@click.option("--timing", type=TIMINGS, help="Default: the experiment's latency_ticks, else zoh.")
@click.option(
    "--factor",
    type=float,
    default=2.0,
    show_default=True,
    help="By how much stiffnesses, masses and dampings are changed, up and down.",
)
@click.option(
    "--simulate",
    is_flag=True,
    help="Run the firmware for every row that it can run, not for the present design and "
    "the finer ADC alone.",
)
@click.option("--linear", is_flag=True, help="Run nothing.")
@threads
@drawn
@as_json
def advise(model, overrides, timing, factor, simulate, linear, threads, out, as_json):
    """What limits the bandwidth of a force loop, and what each change of the axis buys.

    Rows are ranked by the crossover at half the critical gain. Beside the linear limit stands the
    largest gain at which the firmware, with quantisation and loss of contact, is stable on the
    experiment given, on that of the model's name, or on a first contact made for it.
    """
    from forceaxis.linear import advise as design
    from forceaxis.linear import system as models

    check_drawing(out)
    if simulate and linear:
        raise click.UsageError("expected --simulate or --linear, got both")
    runs = "all" if simulate else "none" if linear else "present"
    result = design.advise(model, models.overrides(overrides), timing, factor, runs, threads)
    draw(out, lambda plots: plots.advice(result))
    present(result, as_json, design.describe, out)


@click.command(
    cls=Verb,
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

    linear.check_export(out)
    linear.once("--input", ["drive.force" if load and i == "drive.command" else i for i in inputs])
    linear.once("--output", outputs)
    system = linear.linearise(
        model, inputs, outputs, linear.overrides(overrides), linear.states(modes), free, not load
    )
    if timing != "continuous":
        system = system.sampled(delay_ticks=int(timing == "zoh+1"))
    if out:
        linear.export(system, out)
    if as_json:
        click.echo(json.dumps(linear.summary(system), allow_nan=False))
        return
    click.echo(linear.describe(system))
    if out:
        click.echo(f"file         {paths.display(out)}")


@click.command(
    cls=Verb,
    epilog="""forceaxis step fig4_19 --firmware-gain 5 --out step.png
    forceaxis step fig4_15 --law pd --derivative-s 0.004 --gain 0.01 --timing continuous""",
)
@model_options
@law_options
@loop_timing
@loop_output
@click.option("--duration-s", type=float, default=1.0, show_default=True)
@drawn
@as_json
def step(model, gain, firmware_gain, duration_s, out, as_json, **given):
    """Step response of the closed loop around MODEL, linear and in contact.

    The set-point steps by 1 (N, or what --output has) at 0. JSON: time_s, value, and rise_s (10 to
    90 %), settle_s (2 %), overshoot, final and stable; null where an unstable loop has none.
    """
    from forceaxis.linear import limits as loop_verbs

    check_drawing(out)
    loop = loop_verbs.from_options(model, **given)
    gain = loop_verbs.one_gain(loop, gain, firmware_gain)
    result = loop_verbs.step_summary(loop, gain, duration_s)
    draw(out, lambda plots: plots.step_response(result))
    present(result, as_json, loop_verbs.describe_step, out)


@click.command(
    cls=Verb,
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
    from forceaxis.thesis import beam as bending

    result = bending.summary(
        bending.Beam(
            given["bending_stiffness_nm2"], given["mass_per_length_kg_per_m"], given["length_m"]
        ),
        modes,
    )
    present(result, as_json, bending.describe)


VERBS = (
    linearise, poles, modes_, limit, step, bode, rlocus, nyquist, advise, measure, beam,
    check_thesis,
)  # fmt: skip
