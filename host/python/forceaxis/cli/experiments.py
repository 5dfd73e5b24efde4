"""The commands `run`, `sweep` and `test`, which run experiments with the simulator."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.common import (
    File,
    Folder,
    Override,
    Slow,
    Subject,
    Verb,
    as_json,
    codes_option,
    coloured,
    link_of,
    linked,
    options_in,
    print_json,
    set_option,
    show,
    threads,
    waiting,
)
from forceaxis.experiments import link, trace
from forceaxis.experiments import run as runs
from forceaxis.experiments import summary as summaries
from forceaxis.results import to_json

if TYPE_CHECKING:
    from forceaxis.experiments.regression import RegressionOutcome


@click.command(
    cls=Verb,
    epilog="""forceaxis run contact --set firmware.force_gain=7 --out out/g7
    forceaxis run contact --set b_w=363 --json
    forceaxis run contact --record out/contact.mcap
    forceaxis run contact --link lcm""",
)
@click.argument("experiment", type=Subject(paths.EXPERIMENTS, as_path=True))
@set_option(
    "A model parameter (m_r=140), firmware object (firmware.force_gain=7, engineering units), "
    "experiment.duration_s or a key of the verdict (verdict.window_s=2). VALUE is a number or a "
    'quantity ("75 N"). Repeatable, once for each name.'
)
@click.option(
    "--out",
    type=Folder(),
    help="Folder for trace.csv, trace.npz, events.csv, plot.png, plot.svg and result.json.",
)
@click.option(
    "--record",
    type=File(),
    help="Write the trace as a recording too: FILE.mcap for viewers, FILE.log of LCM messages.",
)
@codes_option
@linked
@as_json
def run(
    experiment: Path,
    overrides: tuple[str, ...],
    out: Path | None,
    record: Path | None,
    codes: bool,
    kind: str | None,
    lcm_url: str,
    link_can: str,
    inject: str,
    as_json: bool,
) -> None:
    """Run one experiment: the firmware controls a simulated plant, with 1500 ticks per simulated
    second. The result is a verdict, such as stable or unstable.

    The command prints the verdict with its reasons and window, the controlled force and its
    set-point, the events, the energy balance, the smallest distance of a value from a code edge,
    and the trace hash. The verdict is `stable`, `unstable`, `not_met` or `never_in_contact`.
    `unstable` means that the force oscillates, that contact is lost again and again, or that a
    fault is latched. `not_met` means that a limit of [verdict] is not kept, or that the measured
    force or the output is at an end of its range. The exit status is 0 for every verdict. With
    --link, the firmware is a separate process. The exit status is then 1 if the two processes
    compute different trace hashes, or if one of them does not answer.
    """
    over = link_of(kind, lcm_url, link_can, inject)
    if record:
        from forceaxis.bus import recordings

        recordings.expect_suffix(record, "record")
    with waiting(f"running {paths.display(experiment)}"):
        done = runs.run(experiment, overrides, over)
        if out:
            trace.write(done, out, codes)
        if record:
            from forceaxis.experiments import recording

            recording.write(done, record)
    if as_json:
        print_json(done.summary)
    else:
        files = [("files", paths.quoted(file)) for file in (out, record) if file]
        show([*summaries.rows(done.result, done.overrides), *files])
    if done.result.link:
        link.expect_same(done.result.link)


def named(
    context: click.Context, option: click.Parameter, texts: tuple[str, ...]
) -> dict[str, str]:
    """Return {NAME: VALUE} from the texts "NAME=VALUE" of an option. Raises InputError for a text
    that does not have this form, and for a NAME that occurs twice."""
    given: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise InputError(f"{option.opts[0]}: {text}: expected {option.metavar}")
        if name in given:
            raise InputError(
                f"{option.opts[0]}: {name}: expected each name once, got this name twice; remove "
                "one of the two"
            )
        given[name] = value
    return given


@click.command(
    cls=Slow,
    epilog="""# the stability map of the thesis robot over gain and set-point, 1280 runs
    forceaxis sweep contact \\
    --grid firmware.force_gain=0.5:20:40 --grid firmware.force_setpoint=2:64:32 --out out/map
    # its boundary, found by halving
    forceaxis sweep contact \\
    --grid firmware.force_setpoint=4:64:16 --bisect firmware.force_gain=3:20:0.05 --out out/edge
    # how it spreads with sensor and workpiece
    forceaxis sweep contact \\
    --random k_s=5e4:2e5:log --random k_w=2e5:8e5 --count 500 --seed 1 --out out/spread""",
)
@click.argument("experiment", type=Subject(paths.EXPERIMENTS, as_path=True))
@click.option(
    "--grid",
    multiple=True,
    type=Override(),
    metavar="NAME=FROM:TO:COUNT[:log]",
    callback=named,
    help="COUNT values from FROM to TO, both included, or NAME=VALUE,VALUE,...; all combinations "
    "when repeated.",
)
@click.option(
    "--random",
    multiple=True,
    type=Override(),
    metavar="NAME=FROM:TO[:log]",
    callback=named,
    help="Sample --count points, uniform in the value or in its logarithm.",
)
@click.option(
    "--over",
    metavar="POSTERIOR.json",
    help="Draw --count plants from a posterior of `forceaxis identify contact`, and print the "
    "probability that a contact bounces.",
)
@click.option("--count", type=int, help="Number of random points.")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the random points.")
@click.option(
    "--bisect",
    multiple=True,
    type=Override(),
    metavar="NAME=FROM:TO:TOLERANCE",
    callback=named,
    help="Find the value at which the verdict changes, by halving FROM..TO until TOLERANCE is "
    "reached; alone, or for every point of --grid or --random.",
)
@set_option("As for run; the same value for all points.")
@click.option(
    "--out",
    type=Folder(),
    required=True,
    help="Folder for results.csv, .npz and .parquet, plot.png and .svg, sweep.json and "
    "journal.jsonl; with --refine closer.csv.",
)
@click.option(
    "--refine",
    is_flag=True,
    help="If the verdict of a point differs from that of all its neighbours, also run the points "
    "half-way to them. Needs a --grid of one or two parameters.",
)
@threads
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Run on the workers of this Dask scheduler, tcp://HOST:PORT, instead of on threads. Each "
    "worker needs this version of forceaxis, and the files of EXPERIMENT at the same path.",
)
@as_json
def sweep(
    experiment: Path,
    grid: dict[str, str],
    random: dict[str, str],
    over: str | None,
    count: int | None,
    seed: int,
    bisect: dict[str, str],
    overrides: tuple[str, ...],
    out: Path,
    refine: bool,
    threads: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Run one experiment many times with different values of parameters, and show for which
    parameter values the run is stable.

    NAME is a parameter of the model or an object of the firmware, as in `forceaxis run --set`. The
    journal in the folder of --out keeps every finished run. After an interruption, or with more
    points, the same command runs only the missing points. A failed run becomes a row with its
    error. The exit status is 1 only if all runs fail. --bisect gives a stability boundary: the last
    stable and the first unstable value. It assumes one change of the verdict between FROM and TO.
    If both ends have the same verdict, the row says so. The plot marks a point whose verdict
    differs from that of all its neighbours.
    """
    from forceaxis.cli import sweep_text
    from forceaxis.experiments import sweep as sweeps

    request = sweeps.SweepRequest(
        experiment, grid, random, count, seed, bisect, overrides, over, refine
    )  # fmt: skip
    done = sweeps.sweep(request, out, threads, scheduler)
    if as_json:
        print_json(done.summary)
    else:
        show([*sweep_text.rows(done), ("files", paths.quoted(out))])
    if done.result.counts.failed == done.result.counts.points:
        sys.exit(1)


def outcome_text(outcome: "RegressionOutcome", coloured: Callable[[str], str] = str) -> str:
    """Return the text about one experiment that `forceaxis test` has tested. The text has a line
    with the status, a line for each value that differs, and a line with the path of the recorded
    signals. `coloured`: function that returns the text of the status in colour."""
    line = f"{coloured(f'{outcome.status:7}')}  {outcome.name}"
    line += "".join(f"\n           warning: {text}" for text in outcome.warnings)
    if outcome.status != "failed":
        return line
    rows = list(outcome.lines)
    if outcome.drawn:
        drawn = paths.quoted(outcome.drawn)
        rows.append(f"both curves: {drawn}; the trace is the file .npz beside it")
    elif outcome.checks:
        file = paths.quoted(outcome.file)
        rows.append(f"to draw both curves: forceaxis test {file} --out FOLDER")
    return line + "".join(f"\n           {text}" for text in rows)


@click.command(
    name="test",
    cls=Verb,
    epilog="""forceaxis test axes/ --junit results.xml --out differences
    forceaxis test axes/contact.toml --update""",
)
@click.argument("targets", metavar="DIR|FILE...", nargs=-1, required=True)
@click.option("--update", is_flag=True, help="Write the results of today into the [expect] tables.")
@click.option("--junit", type=File(), help="Write the results as JUnit XML.")
@click.option("--out", type=Folder(), help="Folder for plot, table and trace of each failed test.")
@click.option(
    "-k",
    "pattern",
    metavar="PATTERN",
    help="Run only files with PATTERN in their name (*, ? allowed).",
)
@threads
@as_json
def test(
    targets: tuple[str, ...],
    update: bool,
    junit: Path | None,
    out: Path | None,
    pattern: str | None,
    threads: int | None,
    as_json: bool,
) -> None:
    """Test experiments: run every experiment in DIR that has a table [expect], and compare the
    results with the values in this table.

    \b
    [expect]                  # a verdict needs [verdict]
    verdict = "stable"        # or unstable, not_met, never_in_contact
    fault = "none"
    peak_force_N = 69.7       # largest contact force of the run
    final_value = 30.2        # mean of `signal` over its last final_s
    held_force_N = 74.7       # mean over the window, and its error:
    held_force_error_percent = 0.4
    settle_s = 0.81           # from_s until within +-band; or "never"
    overshoot = 0.12          # beyond final_value, fraction of the step
    trace_hash = "08b6..."    # every code of every tick
    signal = "sensor.force"   # default: the first contact's force, or encoder
    from_s = 0.0              # evaluation of `signal` starts here
    final_s = 0.3             # default: a tenth of what follows from_s
    band = 0.05               # of the step, or { absolute = 1.5 }

    The tolerance of a number is 1 % (settle_s: 10 ms, overshoot: 0.01). These forms change it:
    { value = 69.7, tolerance = 0.5 }, { value = 69.7, relative = 0.001 }, { min = 60, max = 80 }.
    --update replaces values that differ and fills a table [expect] that is empty or has only the
    verdict. It changes neither limits nor the rest of the file.

    The exit status is 1 if a test fails, and 2 if a file is wrong. All other tests still run.
    """
    from forceaxis.experiments import regression

    command = click.get_current_context().command

    def report(outcome: "RegressionOutcome") -> None:
        if outcome.status == "error":
            click.echo(f"forceaxis: {options_in(command, outcome.message)}", err=True)
        if not as_json:
            click.echo(options_in(command, outcome_text(outcome, coloured)))

    outcomes = regression.run(targets, update, out, threads, pattern, report)
    if junit:
        regression.write_junit(outcomes, junit)
    number = regression.counts(outcomes)
    if as_json:
        print_json(to_json(number) | {"tests": [outcome.summary() for outcome in outcomes]})
    else:
        skipped = [o.name for o in outcomes if o.status == "skipped"]
        if skipped:
            click.echo(f"without [expect]: {', '.join(skipped)}")
        shown = {kind: n for kind, n in vars(number).items() if n or kind == "failed"}
        click.echo(", ".join(f"{n} {kind}" for kind, n in shown.items()))
    sys.exit(regression.status(outcomes))


VERBS = (run, sweep, test)
