"""The command line. Exit status: 0 done, 1 the run or check failed, 2 wrong usage or input."""

import json
import os
import sys
from pathlib import Path

# Matrices here are small: threads of a BLAS would only wait for each other. Read when NumPy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click

# Before NumPy is imported: its matrices here are small, and threads that wait for each other cost
# fifty times the work where the cores are busy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from forceaxis import experiments, new, objects, paths, sweeps, tables
from forceaxis._core import InputError, SimulationError


class Verb(click.Command):
    """A verb whose help keeps the example's line breaks."""

    def format_epilog(self, ctx, formatter):
        if self.epilog:
            formatter.write_paragraph()
            formatter.write("Example:\n")
            for line in self.epilog.strip().splitlines():
                formatter.write(f"  {line.strip()}\n")


class Verbs(click.Group):
    """A verb that has verbs of its own."""

    command_class = Verb
    format_epilog = Verb.format_epilog


class Known(click.ParamType):
    """VALUE or VALUE+-ERROR, above 0: what was measured before, ERROR half of its 95 % interval."""

    name = "VALUE[+-ERROR]"

    def convert(self, value, param, ctx):
        from forceaxis import identify

        number, _, error = str(value).replace("±", "+-").partition("+-")
        try:
            known = identify.Estimate(float(number), float(error or 0.0))
        except ValueError:
            known = identify.Estimate(0.0, 0.0)
        if not (0 < known.value < 1e30 and 0 <= known.half < known.value):
            self.fail(f"expected VALUE or VALUE+-ERROR, above 0, got {value}", param, ctx)
        return known


class Folder(click.Path):
    """A folder to write to; whoever writes makes it."""

    def __init__(self):
        super().__init__(file_okay=False, path_type=Path)

    def convert(self, value, param, ctx):
        if value == "":
            self.fail("expected the name of a folder", param, ctx)
        return super().convert(value, param, ctx)


class File(click.Path):
    """A file to write."""

    def __init__(self):
        super().__init__(dir_okay=False, path_type=Path)


as_json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object, only that.")
threads = click.option(
    "--threads", type=click.IntRange(1, 256), default=None, help="Default: one per core."
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="forceaxis")
def cli():
    """Firmware for force-controlled axes around an exact plant: run it before you flash it."""


@cli.command(
    cls=Verb,
    epilog="""forceaxis run sim/experiments/contact.toml --set firmware.force_gain=7 --out out/g7
    forceaxis run sim/experiments/contact.toml --set b_w=363 --json""",
)
@click.argument("experiment", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="NAME=VALUE",
    help="A model parameter (m_r=140), firmware object (firmware.force_gain=7, engineering units), "
    "experiment.duration_s or a key of the verdict (verdict.window_s=2). Repeatable.",
)
@click.option(
    "--out",
    type=Folder(),
    help="Folder for trace.csv, trace.npz, events.csv, plot.png and result.json.",
)
@as_json
def run(experiment, overrides, out, as_json):
    """Run one experiment in process: the firmware's fw_tick around the plant, 1500 times a second.

    Prints the verdict, the trace hash, the closest approach to a code edge, the events and the
    energy audit. An unstable verdict is a result: the exit status is 0 whenever the run was done.
    """
    done = experiments.run(experiment, overrides)
    if out:
        experiments.write(done, out)
    if as_json:
        click.echo(json.dumps(done.summary, allow_nan=False))
    else:
        click.echo(experiments.describe(done.summary))
        if out:
            click.echo(f"files        {paths.display(out)}")


@cli.command(
    name="new",
    cls=Verb,
    epilog="""forceaxis new press
    forceaxis new press --yes --moving-mass-kg 25 --lead-mm-per-rev 5 --force""",
)
@click.argument("name", type=Folder())
@new.options
@click.option("--yes", is_flag=True, help="Ask nothing: defaults for what is not given.")
@click.option("--force", is_flag=True, help="Replace the three files if they are there.")
@as_json
def new_(name, yes, force, as_json, **given):
    """Write a model and experiments of your own axis into folder NAME.

    Asks for what the data sheets of motor, amplifier, transmission, sensor and workpiece say, or
    takes it as options: plain numbers in the unit of the option's name. What nobody gives gets a
    default that is marked in the model. Asks nothing without a terminal.
    """
    new.refuse_existing(name, force)
    talk = not (yes or as_json) and sys.stdin.isatty()
    done = new.write(name, *new.collect(given, new.prompt if talk else None), force)
    click.echo(json.dumps(done) if as_json else new.describe(done))


def named(context, option, texts):
    """NAME=VALUE options as a dict."""
    given = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise InputError(f"{option.opts[0]}: {text}: expected {option.metavar}")
        if name in given:
            raise InputError(f"{option.opts[0]}: {name}: expected each name once")
        given[name] = value
    return given


@cli.command(
    cls=Verb,
    epilog="""# the stability map of the thesis robot over gain and set-point, 1280 runs
    forceaxis sweep sim/experiments/contact.toml \\
    --grid firmware.force_gain=0.5:20:40 --grid firmware.force_setpoint=2:64:32 --out out/map
    # its boundary, found by halving
    forceaxis sweep sim/experiments/contact.toml \\
    --grid firmware.force_setpoint=4:64:16 --bisect firmware.force_gain=3:20:0.05 --out out/edge
    # how it spreads with sensor and workpiece
    forceaxis sweep sim/experiments/contact.toml \\
    --random k_s=5e4:2e5:log --random k_w=2e5:8e5 --count 500 --seed 1 --out out/spread""",
)
@click.argument("experiment", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--grid",
    multiple=True,
    metavar="NAME=FROM:TO:COUNT[:log]",
    callback=named,
    help="COUNT values from FROM to TO, both included, or NAME=VALUE,VALUE,...; all combinations "
    "when repeated.",
)
@click.option(
    "--random",
    multiple=True,
    metavar="NAME=FROM:TO[:log]",
    callback=named,
    help="Draw --count points, uniform in the value or in its logarithm.",
)
@click.option("--count", type=int, help="How many random points.")
@click.option(
    "--seed", type=int, default=0, show_default=True, help="Another seed, other random points."
)
@click.option(
    "--bisect",
    multiple=True,
    metavar="NAME=FROM:TO:TOLERANCE",
    callback=named,
    help="Halve FROM..TO down to TOLERANCE to where the verdict changes; alone, or for every "
    "point of --grid or --random.",
)
@click.option(
    "--set", "overrides", multiple=True, metavar="NAME=VALUE", help="As for run, for all points."
)
@click.option(
    "--out",
    type=Folder(),
    required=True,
    help="Folder for results.csv, .npz and .parquet, plot.png, sweep.json and journal.jsonl.",
)
@threads
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Run on the workers of this Dask scheduler, tcp://HOST:PORT, instead of on threads. They "
    "need this forceaxis and the experiment's files at the same path.",
)
@as_json
def sweep(
    experiment, grid, random, count, seed, bisect, overrides, out, threads, scheduler, as_json
):
    """Run one experiment at many points of any parameters, NAME as in `run --set`.

    Every finished run is kept in the folder's journal: after an interruption, or with more points,
    the same command runs only what is missing. A run that fails is a row with its error; the exit
    status is 1 only if all fail. A boundary is the last stable value on the way to the first
    unstable one, one change of verdict between FROM and TO; where both ends have the same verdict
    the row says so.
    """
    done = sweeps.sweep(
        experiment, grid, random, count, seed, bisect, overrides, out, threads, scheduler
    )
    if as_json:
        click.echo(json.dumps(done.summary, allow_nan=False))
    else:
        click.echo(sweeps.describe(done))
        click.echo(f"files        {paths.display(out)}")
    if done.summary["counts"]["failed"] == done.summary["counts"]["points"]:
        sys.exit(1)


@cli.command(name="tables", cls=Verb, epilog="forceaxis tables --json")
@click.option("--fit", is_flag=True, help="Find the fitted constants again instead of using them.")
@threads
@as_json
def tables_(fit, threads, as_json):
    """Run the 55 cells of the thesis's stability tables and set ours beside the measurement.

    Exit status 1 if fewer cells match than the parameter file is known for.
    """
    if fit:
        click.echo(json.dumps(tables.fit(threads), indent=None if as_json else 2))
        return
    result = tables.run(threads)
    if as_json:
        click.echo(json.dumps(result))
    else:
        click.echo(tables.describe(result))
    if result["matched"] < tables.load().matched_at_least:
        sys.exit(1)


@cli.command(
    name="check-thesis", cls=Verb, epilog="forceaxis check-thesis\nforceaxis check-thesis --json"
)
@as_json
def check_thesis(as_json):
    """Set the numbers that the thesis quotes beside what its models give.

    Frequencies, crossovers, damping ratios, improvements; where ours differ, a line says why. Exit
    status 1 if one differs without a reason.
    """
    from forceaxis import thesis

    result = thesis.check()
    click.echo(json.dumps(result, allow_nan=False) if as_json else thesis.describe(result))
    if result["unexplained"]:
        sys.exit(1)


@cli.command(cls=Verb, epilog="forceaxis report --out report && xdg-open report/index.html")
@click.option(
    "--out",
    type=Folder(),
    default="report",
    show_default=True,
    help="Folder for index.html.",
)
@threads
@as_json
def report(out, threads, as_json):
    """Run every experiment and the tables and write one self-contained page."""
    from forceaxis import report as page

    summary = page.write(out, threads)
    if as_json:
        click.echo(json.dumps(summary))
    else:
        click.echo(f"report       {paths.display(out / 'index.html')}")
        click.echo(f"experiments  {summary['experiments']} run")
        click.echo(
            f"tables       {summary['matched']} of {summary['total']} cells match the thesis"
        )


@cli.command(
    name="bench",
    cls=Verb,
    epilog="""forceaxis bench --case A --tool forceaxis --tool odeint
    forceaxis bench --check""",
)
@click.option(
    "--case", "cases", multiple=True, type=click.Choice(["A", "B", "full"]), help="Default: all."
)
@click.option(
    "--tool",
    "tools",
    multiple=True,
    type=click.Choice(["forceaxis", "forceaxis+firmware", "odeint", "mujoco", "scipy"]),
    help="Default: all that are installed. Repeatable, as --case.",
)
@click.option("--repeat", type=click.IntRange(1, 1000), default=10, show_default=True)
@click.option("--sweeps", is_flag=True, help="Also runs/s of sweeps, and cost against events.")
@click.option("--linear", is_flag=True, help="Also frequency responses, critical gains, advice.")
@click.option(
    "--check", is_flag=True, help="Everything; exit status 1 unless every ratio promised holds."
)
@as_json
def bench_(cases, tools, repeat, sweeps, linear, check, as_json):
    """Time the simulator on its benchmark, beside odeint, MuJoCo and SciPy where installed.

    Prints how many times faster than real time one thread runs 2 s of a force loop, and how far
    the contact force is from an independent extended-precision integration. Run it on an idle
    machine.
    """
    from forceaxis import bench

    if check and (cases or tools):
        raise click.UsageError("expected --check without --case and --tool; it runs everything")
    result = bench.run(
        cases or bench.CASES, tools or bench.TOOLS, repeat, sweeps or check, linear or check
    )
    if check:
        checks = bench.check(result)
        result["checks"] = [{"check": text, "held": held} for text, held in checks]
    if as_json:
        click.echo(json.dumps(result, allow_nan=False))
    else:
        click.echo(bench.describe(result))
        for text, held in checks if check else ():
            click.echo(f"{'held' if held else 'NOT HELD':12} {text}")
    if check and not all(held for _, held in checks):
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


@cli.command(
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
    "--window", type=click.Choice(["none", "hann"]), help="Default: none, periodic excitation."
)
@click.option(
    "--clamped", is_flag=True, default=None, help="Contacts pull as well as they push (3.2.2)."
)
@click.option("--free", is_flag=True, default=None, help="The contacts are apart.")
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
    codes. Prints gain, corner and phase crossings, coherence and error, how many points have the
    model inside their 95 % band, and whether the model as a whole fits; it not fitting is a result.
    """
    from forceaxis import linear
    from forceaxis import measure as analyzer

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


@cli.command(
    name="modes",
    cls=Verb,
    epilog="""forceaxis modes fig4_19 --set b_w=363
    forceaxis modes fig4_15 --free --json""",
)
@click.argument("model")
@click.option("--set", "overrides", multiple=True, metavar="NAME=VALUE", help="A model parameter.")
@click.option("--free", is_flag=True, help="Contacts apart. Default: pressed.")
@click.option(
    "--mode",
    "states",
    multiple=True,
    metavar="ELEMENT=STATE",
    help="State of an element that switches (slide=forward), as in events.csv.",
)
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
@click.option("--out", type=File(), help="Draw it: FILE.png, .svg or .pdf.")
@as_json
def modes_(model, overrides, states, free, input_, output, out, as_json):
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
    from forceaxis import linear, modes

    check_drawing(out)
    result = modes.modes(
        model, input_, output, linear.overrides(overrides), linear.states(states), free
    )
    draw(out, lambda plots: plots.mode_shapes(result, result["title"]))
    present(result, as_json, modes.describe, out)


@cli.command(
    name="test",
    cls=Verb,
    epilog="""forceaxis test axes/ --junit results.xml --out differences
    forceaxis test axes/contact.toml --update""",
)
@click.argument("targets", metavar="DIR|FILE...", nargs=-1, required=True)
@click.option("--update", is_flag=True, help="Write what came out into the [expect] tables.")
@click.option("--junit", type=File(), help="Write the results as JUnit XML.")
@click.option("--out", type=Folder(), help="Folder for a plot and a table of each failed test.")
@click.option(
    "-k", "pattern", metavar="PATTERN", help="Only files with PATTERN in their name (*, ? allowed)."
)
@threads
@as_json
def test(targets, update, junit, out, pattern, threads, as_json):
    """Run every experiment with an [expect] table at or below DIR and compare.

    \b
    [expect]
    verdict = "stable"        # needs [verdict]
    fault = "none"
    peak_force_N = 69.7       # largest contact force of the run
    final_value = 30.2        # mean of `signal` over its last final_s
    settle_s = 0.81           # until it stays within +-band; or "never"
    overshoot = 0.12          # beyond final_value, fraction of the step
    trace_hash = "08b6..."    # every code of every tick
    signal = "sensor.force"   # default: the first contact's force, or encoder
    from_s = 0.0              # look at `signal` from here on
    final_s = 0.3             # default: a tenth of what follows from_s
    band = 0.05               # of the step, or { absolute = 1.5 }

    A number is met within 1 % (settle_s: 10 ms, overshoot: 0.01), or as
    { value = 69.7, tolerance = 0.5 }, { value = 69.7, relative = 0.001 } or { min = 60, max = 80 }
    say. --update rewrites what
    differs, fills an empty [expect], and leaves limits and the rest of the file as they are.

    Exit status 1 if a test fails, 2 if a file is wrong; all others run all the same.
    """
    from forceaxis import usertests

    def tell(outcome):
        if outcome.status == "error":
            click.echo(f"forceaxis: {outcome.message}", err=True)
        if not as_json:
            click.echo(usertests.describe(outcome))

    outcomes = usertests.run(targets, update, out, threads, pattern, tell)
    if junit:
        usertests.write_junit(outcomes, junit)
    number = usertests.counts(outcomes)
    if as_json:
        click.echo(json.dumps(number | {"tests": [o.summary() for o in outcomes]}))
    else:
        skipped = [o.name for o in outcomes if o.status == "skipped"]
        if skipped:
            click.echo(f"without [expect]: {', '.join(skipped)}")
        click.echo(", ".join(f"{n} {kind}" for kind, n in number.items() if n or kind == "failed"))
    sys.exit(usertests.status(outcomes))


def check_drawing(out):
    """Refuse a file name that no figure can have, before the work."""
    if out:
        from forceaxis import frequency_plots

        frequency_plots.check_name(out)


def draw(out, make):
    """Write the figure that make(frequency_plots) gives to `out`, if one is wanted."""
    if out:
        from forceaxis import frequency_plots

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


@cli.command(
    cls=Verb,
    epilog="""forceaxis limit fig4_19 --set b_m=0.02 --json
    forceaxis limit fig4_19 --law lead --lead-zero-hz 40 --lead-pole-hz 400 --timing zoh+1
    forceaxis limit laboratory --firmware-gain 10""",
)
@model_options
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
    from forceaxis import loops

    loop = loops.from_options(model, **given)
    summary = loops.limit_summary(loop, loops.one_gain(loop, gain, firmware_gain))
    click.echo(json.dumps(summary, allow_nan=False) if as_json else loops.describe_limit(summary))


@cli.command(
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
@click.option("--free", is_flag=True, help="Contacts are apart.")
@click.option("--input", "input_", help="drive.command, drive.force or BODY.force.")
@click.option("--output", help="A signal of the model. Default: reading, what ADC 0 converts.")
@click.option("--span-hz", type=float, help="Half-width of the frame of --out, Hz.")
@click.option("--out", type=File(), help="Draw it: FILE.png, .svg or .pdf.")
@as_json
def poles(model, as_json, gain, firmware_gain, input_, out, span_hz, **given):
    """Poles, zeros and transfer function of MODEL, or of a loop closed around it with a gain.

    Without a gain: from --input (default drive.command, V) to --output. With one: from the law's
    set-point to the signal that it controls. Zeros include those that cancel poles.
    """
    from forceaxis import loops

    check_drawing(out)
    summary = loops.poles_of(model, gain, firmware_gain, input_, **given)
    draw(out, lambda plots: plots.poles_figure(summary, span_hz))
    present(summary, as_json, loops.describe_poles, out)


vary = click.option(
    "--vary",
    multiple=True,
    metavar="NAME=VALUE,VALUE",
    help="One curve for each value of a model parameter. Repeatable, all combinations.",
)
free = click.option("--free", is_flag=True, help="Contacts are apart.")
drawn = click.option("--out", type=File(), help="Draw it: FILE.png, .svg or .pdf.")
loop_timing = click.option("--timing", type=TIMINGS, default="zoh", show_default=True)
loop_output = click.option(
    "--output", default="reading", show_default=True, help="The signal that is fed back."
)


@cli.command(
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
@click.option(
    "--output",
    "outputs",
    multiple=True,
    default=["reading"],
    show_default=True,
    help="A signal of the model, or reading: what ADC 0 converts. Repeatable.",
)
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
    from forceaxis import frequency_plots

    check_drawing(out)
    figure, summary = frequency_plots.bode_verb(
        model, overrides, vary, modes, free, input_, outputs, timing, from_hz, to_hz, gain,
        firmware_gain,
    )  # fmt: skip
    draw(out, lambda plots: figure)
    present(summary, as_json, frequency_plots.describe_bode, out)


@cli.command(
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
    type=float,
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
    from forceaxis import frequency_plots

    check_drawing(out)
    figure, summary = frequency_plots.rlocus_verb(model, **given)
    draw(out, lambda plots: figure)
    present(summary, as_json, frequency_plots.describe_rlocus, out)


@cli.command(cls=Verb, epilog="forceaxis nyquist fig4_19 --firmware-gain 5 --out nyquist.png")
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
    from forceaxis import frequency_plots, loops

    check_drawing(out)
    figure, summary = frequency_plots.nyquist_verb(model, **given)
    draw(out, lambda plots: figure)
    present(summary, as_json, loops.describe_limit, out)


@cli.command(
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
    from forceaxis import advise as design
    from forceaxis import linear as models

    check_drawing(out)
    if simulate and linear:
        raise click.UsageError("expected --simulate or --linear, got both")
    runs = "all" if simulate else "none" if linear else "present"
    result = design.advise(model, models.overrides(overrides), timing, factor, runs, threads)
    draw(out, lambda plots: plots.advice(result))
    present(result, as_json, design.describe, out)


@cli.group(
    cls=Verbs,
    epilog="""forceaxis identify decrement workpiece.csv --mass 6.6
    forceaxis identify fit fig4_19 out/measured --fit m_r --fit k_w""",
)
def identify():
    """Identify parameters from recordings and measured responses, with 95 % intervals.

    decrement, split, tach and motor are the procedures of the thesis (4.1.2, 4.4, 5.2.1); fit fits
    any parameters of a model to a response that `forceaxis measure` has measured.
    """


def show(result, as_json, rows):
    """Print a procedure's result, or its `rows` of (name, text)."""
    if as_json:
        click.echo(json.dumps(result, allow_nan=False))
    else:
        for name, text in rows:
            click.echo(f"{name:12} {text}")


csv_file = click.argument("data", type=click.Path(dir_okay=False), metavar="DATA.csv")


@identify.command(
    epilog="""forceaxis identify decrement workpiece.csv --mass 6.6
    forceaxis identify decrement base.csv --signal base.position --from-s 0.1 --mass 500+-20"""
)
@csv_file
@click.option("--signal", "column", help="Column of the vibration. Default: the one beside time_s.")
@click.option("--from-s", type=float, default=float("-inf"), help="Use it from this time on.")
@click.option("--to-s", type=float, default=float("inf"), help="Use it up to this time.")
@click.option(
    "--floor",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.05,
    show_default=True,
    help="Fraction of the largest amplitude down to which cycles count.",
)
@click.option("--mass", type=Known(), help="kg; gives stiffness and damping.")
@click.option("--stiffness", type=Known(), help="N/m; gives mass and damping.")
@as_json
def decrement(data, column, from_s, to_s, floor, mass, stiffness, as_json):
    """Frequency and damping of a recorded ring-down, by its logarithmic decrement.

    DATA.csv has a column time_s and a signal of any unit and offset. At least 3 cycles.
    """
    from forceaxis import identify

    if mass and stiffness:
        raise click.UsageError("expected --mass or --stiffness, not both; the other one follows")
    found, derived = identify.decrement(
        data, column, (from_s, to_s), floor, mass=mass, stiffness=stiffness
    )
    estimates = {k: v for k, v in vars(found).items() if k != "cycles"} | derived
    show(
        {"cycles": found.cycles} | {name: e.json() for name, e in estimates.items()},
        as_json,
        [
            ("cycles", found.cycles),
            ("frequency", f"{found.natural_frequency}, damped {found.damped_frequency}"),
            ("decrement", found.decrement),
            ("ratio", f"{found.damping_ratio} of damping, exact {found.damping_ratio_exact}"),
            *derived.items(),
        ],
    )


@identify.command(
    epilog="forceaxis identify split --total-mass 132.4 --stiffness 665000 --frequency-hz 33+-0.1"
)
@click.option("--total-mass", type=Known(), required=True, help="kg, of both masses.")
@click.option("--stiffness", type=Known(), required=True, help="N/m, of the spring between them.")
@click.option(
    "--frequency-hz", type=Known(), required=True, help="Of the mode in free space, undamped."
)
@as_json
def split(total_mass, stiffness, frequency_hz, as_json):
    """Two masses on either side of a spring, from their sum and their frequency (4.4.2).

    Both solutions; chosen is the one whose actuator side m_r1 has more than half of the mass. The
    equations are those of both masses free. With the motor's shaft locked, as the thesis describes
    its measurement, the frequency would be that of m_r2 alone: what follows then is said, too.
    """
    from forceaxis import identify

    found = identify.split(total_mass, stiffness, frequency_hz)
    result = {
        "solutions": [{"m_r1": m_r1.json(), "m_r2": m_r2.json()} for m_r1, m_r2 in found.solutions],
        "rule": "m_r1 > m_r2",
        "locked_frequency_hz": found.locked_frequency_hz,
        "if_locked": {"m_r1": found.locked[0].json(), "m_r2": found.locked[1].json()},
    }
    words = [f"m_r1 {m_r1}, m_r2 {m_r2}" for m_r1, m_r2 in found.solutions]
    show(
        result,
        as_json,
        [
            ("chosen", f"{words[0]} (the actuator has more than half)"),
            ("other", words[1]),
            ("locked shaft", f"the chosen m_r2 would be at {found.locked_frequency_hz:.5g} Hz"),
            ("", "if {:.5g} Hz was measured so: m_r1 {}, m_r2 {}".format(
                frequency_hz.value, *found.locked)),
        ],
    )  # fmt: skip


def with_offset(verb):
    """The option of both regressions."""
    return click.option("--offset", is_flag=True, help="A line with an offset, not through 0.")(
        verb
    )


@identify.command(epilog="forceaxis identify tach speeds.csv --offset")
@csv_file
@click.option("--speed", default="speed_rad_per_s", show_default=True, help="Column, rad/s.")
@click.option("--tach", default="tach_V", show_default=True, help="Column, V.")
@with_offset
@as_json
def tach(data, speed, tach, offset, as_json):
    """Tachometer constant: slope of its voltage over the measured speed (4.1.2)."""
    from forceaxis import identify

    found = identify.regression_of(data, speed, tach, offset, ("V s/rad", "V"))
    names = ("k_tach", "offset") if offset else ("k_tach",)
    rows = list(zip(names, found, strict=True))
    show({name: e.json() for name, e in rows}, as_json, rows)


@identify.command(
    epilog="""forceaxis identify motor steady.csv \\
    --k-torque 0.5 --k-back-emf 0.5 --k-tach 0.039+-0.0002 --resistance 4.5+-0.05"""
)
@csv_file
@click.option("--motor", default="motor_V", show_default=True, help="Column, V at the terminals.")
@click.option("--tach", default="tach_V", show_default=True, help="Column, V.")
@click.option("--k-torque", type=Known(), required=True, help="N m/A.")
@click.option("--k-back-emf", type=Known(), required=True, help="V s/rad.")
@click.option("--k-tach", type=Known(), required=True, help="V s/rad.")
@click.option("--resistance", type=Known(), required=True, help="ohm, of motor and leads.")
@with_offset
@as_json
def motor(data, motor, tach, k_torque, k_back_emf, k_tach, resistance, offset, as_json):
    """Motor damping b_m from steady voltages of motor and tachometer, shaft uncoupled (4.1.2).

    V_tach / V_motor = k_t k_tach / (R b_m + k_b k_t) at DC. Errors of the constants count.
    """
    from forceaxis import identify

    ratio = identify.regression_of(data, motor, tach, offset, ("V/V", "V"))[0]
    damping = identify.motor_damping(ratio, k_torque, k_tach, k_back_emf, resistance, data)
    rows = [("ratio", ratio), ("b_m", damping)]
    show({name: e.json() for name, e in rows}, as_json, rows)


@identify.command(
    epilog="""forceaxis measure fig4_19 --output sensor.force --bias 1 --set b_w=100 \\
    --plant-set m_r=110 --out out/m
    forceaxis identify fit fig4_19 out/m --fit m_r --fit k_w=5e5 --out out/fitted"""
)
@click.argument("model")
@click.argument("response", type=click.Path())
@click.option(
    "--fit", "names", multiple=True, required=True, metavar="NAME[=START]",
    help="Parameter to fit, and where to start if not from the model's value. Repeatable.",
)  # fmt: skip
@click.option(
    "--set", "overrides", multiple=True, metavar="NAME=VALUE", help="Parameter that is held."
)
@click.option("--input", help="Signal. Default: as recorded; of a CSV file drive.command.")
@click.option("--output", help="Signal. Default: as recorded.")
@click.option("--averages", type=click.IntRange(2), help="Of a CSV file.")
@click.option(
    "--dt",
    type=click.FloatRange(0, min_open=True),
    help="s a sample. Default: as recorded.",
)
@click.option(
    "--scale", type=float, help="What the output was multiplied by. Default: as recorded."
)
@click.option("--out", type=Folder(), help="Folder for result.json and plot.png.")
@as_json
def fit(model, response, names, overrides, out, as_json, **given):
    """Fit parameters of MODEL to a measured frequency response.

    RESPONSE is what `forceaxis measure --out` wrote, or a CSV file with columns frequency_hz,
    coherence and magnitude, phase_deg (or real, imag). Prints for each parameter its 95 % interval
    and a wider one that holds for all at once, whether the model explains the data (chi-square),
    and what is poorly determined or hard to tell apart.
    """
    from forceaxis import identify, linear

    held = linear.overrides(overrides)
    measured = identify.read_response(response, model, held, **given)
    starts, units = identify.starts_of(names, measured)
    found = identify.fit(measured, starts)
    summary = identify.summarise(found, measured, units)
    if out:
        identify.write(found, measured, summary, out)
    if as_json:
        click.echo(json.dumps(summary, allow_nan=False))
    else:
        click.echo(identify.describe(summary))
        if out:
            click.echo(f"files        {paths.display(out)}")


@cli.command(name="objects", cls=Verb, epilog="forceaxis objects force")
@click.argument("pattern", default="")
@as_json
def objects_(pattern, as_json):
    """List the firmware's objects: what `--set firmware.NAME` and [firmware] accept."""
    rows = [o for o in objects.OBJECTS if pattern in o.name]
    if as_json:
        click.echo(json.dumps([o._asdict() for o in rows]))
        return
    for o in rows:
        span = ", ".join(o.enum) or f"{o.min * o.scale:g} to {o.max * o.scale:g} {o.unit}"
        when = {"any": "", "disabled": "; written only while disabled"}.get(
            o.writable, "; written only while the recorder is idle"
        )
        click.echo(f"{o.name:26} {o.access:3} {o.meaning} [{span}{when}]")


def main():
    """Entry point: every mistake of the user is one line on standard error and exit status 2."""
    try:
        cli(standalone_mode=False)
    except InputError as error:
        fail(str(error))
    except SimulationError as error:
        fail(str(error), status=1)
    except click.exceptions.Abort:
        sys.exit(130)
    except click.ClickException as error:
        fail(error.format_message())
    except tables.StaleFit as error:
        fail(str(error), status=1)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        fail(f"{where}expected to be able to read and write here, {error.strerror}")
    except UnicodeError:
        fail("expected UTF-8 in file names and files")


def fail(message, status=2):
    """Print one line on standard error and leave."""
    click.echo("forceaxis: " + " ".join(message.split()), err=True)
    sys.exit(status)
