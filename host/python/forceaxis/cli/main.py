"""The command line. Exit status: 0 done, 1 the run or check failed, 2 wrong usage or input."""

import json
import os
import subprocess
import sys
from pathlib import Path

# Matrices here are small: threads of a BLAS that wait for each other cost fifty times the work
# where the cores are busy. Read when NumPy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click

from forceaxis import new, paths
from forceaxis._core import InputError, SimulationError
from forceaxis.chip import flash
from forceaxis.cli import flash as cli_flash
from forceaxis.cli import frequency as cli_frequency
from forceaxis.cli import gateway as cli_gateway
from forceaxis.cli import identify as cli_identify
from forceaxis.cli import live as cli_live
from forceaxis.cli import objects as cli_objects
from forceaxis.cli.common import File, Folder, Verb, as_json, threads
from forceaxis.experiments import files as experiments
from forceaxis.experiments import link
from forceaxis.experiments import sweep as sweeps
from forceaxis.thesis import tables


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="forceaxis")
def cli():
    """Firmware for force-controlled axes around an exact plant: run it before you flash it."""


def linked(command):
    """The options of a verb that can run the firmware as another process."""
    for option in (
        click.option("--inject", default="", hidden=True, help="For tests: faults of the link."),
        click.option("--link-can", default="vcan1", show_default=True, help="CAN interface."),
        click.option("--lcm-url", default="", help="Default: a port of the run's own."),
        click.option(
            "--link",
            "kind",
            type=click.Choice(link.KINDS),
            help="Run the firmware as a process of its own, in lock-step over this; inproc: as "
            "usual, but both sides hash the trace; pil-stm32: the image on an emulated chip. Where "
            "the kernel has no CAN, socketcan runs in a guest (tools/vcan).",
        ),
    ):
        command = option(command)
    return command


def link_of(kind, lcm_url, link_can, inject):
    """The link asked for, or None; may go on in a guest that has CAN."""
    if kind is None:
        return None
    over = link.Link(kind, lcm_url, link_can, inject)
    link.under_vcan(over)
    return over


@cli.command(
    cls=Verb,
    epilog="""forceaxis run sim/experiments/contact.toml --set firmware.force_gain=7 --out out/g7
    forceaxis run sim/experiments/contact.toml --set b_w=363 --json
    forceaxis run sim/experiments/contact.toml --link lcm""",
)
@click.argument("experiment", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="NAME=VALUE",
    help="A model parameter (m_r=140), firmware object (firmware.force_gain=7, engineering units), "
    "experiment.duration_s or a key of the verdict (verdict.window_s=2); a number or a quantity "
    '("75 N"). Repeatable, once for each name.',
)
@click.option(
    "--out",
    type=Folder(),
    help="Folder for trace.csv, trace.npz, events.csv, plot.png and result.json.",
)
@linked
@as_json
def run(experiment, overrides, out, kind, lcm_url, link_can, inject, as_json):
    """Run one experiment in process: the firmware's fw_tick around the plant, 1500 times a second.

    Prints the verdict, the trace hash, the closest approach to a code edge, the events and the
    energy audit. An unstable verdict is a result: the exit status is 0 whenever the run was done.
    With --link the firmware is a process of its own, and the status is 1 if the two sides' hashes
    of the trace differ or one falls silent.
    """
    done = experiments.run(experiment, overrides, link_of(kind, lcm_url, link_can, inject))
    if out:
        experiments.write(done, out)
    if as_json:
        click.echo(json.dumps(done.summary, allow_nan=False))
    else:
        click.echo(experiments.describe(done.summary))
        if out:
            click.echo(f"files        {paths.display(out)}")
    if "link" in done.summary:
        link.expect_same(done.summary["link"])


@cli.command(
    cls=Verb,
    epilog="""axis_node sim/experiments/contact.toml --can vcan0 --journal axis.journal &
    plant_node sim/experiments/contact.toml --pace real && forceaxis replay axis.journal""",
)
@click.argument("journal", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--out", type=Folder(), help="Folder, as for run.")
@as_json
def replay(journal, out, as_json):
    """Run again, in process, what a firmware on buses did: from the journal of its axis_node.

    The same trace hash comes out; the exit status is 1 if it does not, or if the journal breaks off
    without one, because the node was killed: then what is there is replayed.
    """
    done, told = experiments.replay(journal)
    same = done.summary["trace_hash"] == told["trace_hash"]
    done.summary["replay"] = told | {"same": same}
    if out:
        experiments.write(done, out)
    if as_json:
        click.echo(json.dumps(done.summary, allow_nan=False))
    else:
        click.echo(experiments.describe(done.summary))
        known = told["trace_hash"] or "none, it is broken off"
        click.echo(f"journal      {told['entries']} entries, trace hash {known}")
    if told["ticks"] is None:
        fail(
            f"{journal}: expected a line `end`; the node was killed, and replayed is what it had "
            f"written down, {done.summary['ticks']} ticks",
            status=1,
        )
    if not same:
        fail(f"{journal}: expected the trace hash {told['trace_hash']} again", status=1)


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
@linked
@as_json
def tables_(fit, threads, kind, lcm_url, link_can, inject, as_json):
    """Run the 55 cells of the thesis's stability tables and set ours beside the measurement.

    Exit status 1 if fewer cells match than the parameter file is known for. With --link the
    firmware is one process of its own for all cells.
    """
    if fit and kind:
        raise click.UsageError("expected --fit without --link; a fit is thousands of runs")
    if fit:
        click.echo(json.dumps(tables.fit(threads), indent=None if as_json else 2))
        return
    result = tables.run(threads, link_of(kind, lcm_url, link_can, inject))
    if as_json:
        click.echo(json.dumps(result))
    else:
        click.echo(tables.describe(result))
    if result["matched"] < tables.load().matched_at_least:
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
    from forceaxis.report import report as page

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
    forceaxis bench --check
    forceaxis bench --link""",
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
    "--link",
    "links",
    is_flag=True,
    help="Only the lock-step's rate over LCM and SocketCAN, as a share of a ping-pong between two "
    "bare programs; exit status 1 unless what is promised holds.",
)
@click.option(
    "--check", is_flag=True, help="Everything; exit status 1 unless every ratio promised holds."
)
@as_json
def bench_(cases, tools, repeat, sweeps, linear, links, check, as_json):
    """Time the simulator on its benchmark, beside odeint, MuJoCo and SciPy where installed.

    Prints how many times faster than real time one thread runs 2 s of a force loop, and how far
    the contact force is from an independent extended-precision integration. Run it on an idle
    machine.
    """
    from forceaxis.bench import bench
    from forceaxis.bench import link as bench_link

    if links:
        rows = bench_link.run(min(repeat, 10))
        checks = bench_link.check(rows)
        if as_json:
            told = [{"check": text, "held": held} for text, held in checks]
            click.echo(json.dumps({"link": rows, "checks": told}))
        else:
            click.echo("\n".join(bench_link.describe(rows)))
            for text, held in checks:
                click.echo(f"{'held' if held else 'NOT HELD':12} {text}")
        sys.exit(not all(held for _, held in checks))
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
    from forceaxis.experiments import regression as usertests

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


for verb in (
    *cli_frequency.VERBS,
    cli_flash.flash_,
    cli_identify.identify,
    *cli_gateway.VERBS,
    *cli_live.VERBS,
    cli_objects.objects_,
):
    cli.add_command(verb)


def main():
    """Entry point: every mistake of the user is one line on standard error and exit status 2."""
    try:
        for text in sys.argv:
            text.encode()  # what is not UTF-8 is refused before anything sees it
        cli(standalone_mode=False)
    except InputError as error:
        fail(str(error))
    except (SimulationError, link.LinkError, flash.FlashError) as error:
        fail(str(error), status=1)
    except subprocess.TimeoutExpired as error:
        program = error.cmd if isinstance(error.cmd, str) else error.cmd[0]
        fail(f"{Path(program).name}: expected it to end within {error.timeout:g} s", status=1)
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
