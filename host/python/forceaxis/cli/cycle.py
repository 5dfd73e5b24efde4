"""`forceaxis cycle`: simulate the program of a cycle with one part or with many."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.common import (
    Callback,
    File,
    Folder,
    Slow,
    Subject,
    Verbs,
    as_json,
    print_json,
    set_option,
    show,
    threads,
)
from forceaxis.cli.live_options import AxisConnection, live, owned
from forceaxis.errors import ParameterError
from forceaxis.results import to_json
from forceaxis.words import number

EXPERIMENT = click.argument("experiment", type=Subject(paths.EXPERIMENTS, as_path=True))
program_option = click.option(
    "--program",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Program of the cycle. Default: the one that the experiment names.",
)
PARTS_FILE = click.Path(dir_okay=False, path_type=Path)


@click.group(
    cls=Verbs,
    epilog="""forceaxis cycle run press_fit --plot part.png
    forceaxis cycle rates press_fit --good sim/parts/press_fit_good.toml \\
    --bad sim/parts/press_fit_bad.toml --parts 1000
    forceaxis cycle load press_fit --on can0
    forceaxis cycle start press_fit --on can0 --out records
    forceaxis cycle statistics records""",
)
def cycle() -> None:
    """Try the program of a press cycle before a press exists: with one simulated part, or with
    thousands of good and bad parts. Then load the program into an axis, press parts, record the
    results, and see how good the process is.

    All commands but `statistics` need an experiment, without which a cycle program cannot run.
    The command for recorded curves also accepts the file of a cycle program, as it moves nothing.
    The experiment names the model of press and part, the program, the parameters of the axis, and
    the time at which the cycle starts. `--program` tries another program with the same press.
    """


@cycle.command(
    cls=Slow,
    epilog="""forceaxis cycle run press_fit --plot part.png
    forceaxis cycle run press_fit --set k_bore="80 kN/m"
    forceaxis cycle run press_fit --program out/tighter.toml --json""",
)
@EXPERIMENT
@program_option
@set_option("As for run: a parameter of the part or the press, or an object of the firmware.")
@click.option(
    "--plot",
    type=File(),
    help="Plot of the curve with windows, envelopes and bounds: FILE.png, .svg or .pdf.",
)
@as_json
def run(
    experiment: Path,
    program: Path | None,
    overrides: tuple[str, ...],
    plot: Path | None,
    as_json: bool,
) -> None:
    """Press one simulated part with the firmware, and print the verdict of the part.

    The command also prints the value of each evaluation element with its bounds, and when and why
    each phase ended. The exit status is 0 for every verdict. The value of a window is the number of
    entries into the window. The value of an envelope is the smallest distance from its curves.
    """
    from forceaxis import drawing
    from forceaxis.cli import cycle_text
    from forceaxis.cycles import part

    expect_picture(plot)
    done = part.run(experiment, overrides, program)
    if plot is not None:
        from forceaxis.cycles import plots

        if done.curve is None:
            raise ParameterError("plot", "expected a run in which a cycle starts, got none to plot")
        with paths.replacing(plot.parent, plot.name) as (file,):
            drawing.save(plots.part(done), file, plot.suffix[1:])
    if as_json:
        print_json(done.result)
    else:
        show(
            [*cycle_text.part_rows(done.result), *([("files", paths.quoted(plot))] if plot else [])]
        )


def expect_picture(plot: Path | None) -> None:
    """Raise ParameterError if the suffix of the --plot file is not that of an image."""
    from forceaxis import drawing

    if plot is not None and plot.suffix not in drawing.SUFFIXES:
        raise ParameterError("plot", f"{plot}: expected a file ending in .png, .svg or .pdf")


def fraction(text: str) -> float | None:
    """Return a fraction between 0 and 1 as a number, from a text such as "1%" or "0.01". Return
    None for other texts."""
    digits, percent = text.strip().removesuffix("%"), text.strip().endswith("%")
    try:
        value = number(digits) / (100 if percent else 1)
    except ValueError:
        return None
    return value if 0 < value < 1 else None


def rate(context: click.Context, option: click.Parameter, text: str | None) -> float | None:
    """Return the value of the option --propose, the fraction of good parts to refuse, as a number.
    Raises InputError.
    """
    if text is None:
        return None
    value = fraction(text)
    if value is None:
        raise InputError(
            f"--propose: {text}: expected the fraction of good parts to refuse, such as 1% or 0.01"
        )
    return value


def _false_alarms(
    context: click.Context, option: click.Parameter, text: str | None
) -> float | None:
    """Return the value of the option --false-alarms, a share of series of parts, as a number.
    Raises InputError.
    """
    found = None if text is None else fraction(text)
    if text is not None and found is None:
        raise InputError(f"--false-alarms: {text}: expected a share of series, such as 1% or 0.01")
    return found


def drift_options(default: str | None) -> Callable[[Callback], Callback]:
    """Return a decorator that adds the options of the test for wear and drift to a command.
    `default`: default of --false-alarms, or None if the test needs this option."""

    def add(verb: Callback) -> Callback:
        verb = click.option(
            "--reference", type=int, default=30, show_default=True,
            help="Number of first parts with which later ones are compared for wear and drift.",
        )(verb)  # fmt: skip
        return click.option(
            "--false-alarms", metavar="SHARE", default=default, show_default=default is not None,
            callback=_false_alarms,
            help="Test for wear and drift: the largest share of unchanged series in which the test "
            "reports a change.",
        )(verb)  # fmt: skip

    return add


@cycle.command(
    cls=Slow,
    epilog="""# prints how often good parts are refused and bad parts pass
    forceaxis cycle rates press_fit --good sim/parts/press_fit_good.toml \\
    --bad sim/parts/press_fit_bad.toml --parts 1000 --seed 1 --out out/rates
    # bounds that refuse one good part of a hundred
    forceaxis cycle rates press_fit --good sim/parts/press_fit_good.toml \\
    --bad sim/parts/press_fit_bad.toml --parts 9000 --bad-parts 1000 --propose 1% -o out/new.toml
    # checked with other parts
    forceaxis cycle rates press_fit --program out/new.toml --seed 2 --parts 30000 \\
    --good sim/parts/press_fit_good.toml""",
)
@EXPERIMENT
@click.option("--good", type=PARTS_FILE, required=True, help="File with kinds of good parts.")
@click.option(
    "--bad", type=PARTS_FILE, multiple=True, help="File with kinds of bad parts. Repeatable."
)
@click.option(
    "--parts", type=int, default=1000, show_default=True, help="Number of good parts, by weight."
)
@click.option(
    "--bad-parts", type=int, help="Number of parts of each bad kind. Default: that of --parts."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of parts and noise.")
@program_option
@set_option("As for run; the same value for all parts.")
@click.option(
    "--over",
    metavar="POSTERIOR.json",
    help="Draw the press of each part from a posterior of `forceaxis identify contact`.",
)
@click.option(
    "--propose",
    metavar="RATE",
    callback=rate,
    help="Propose bounds of the evaluation elements so that this share of good parts is refused, "
    "such as 1%. Needs -o.",
)
@click.option(
    "--write", "-o", type=File(), help="File for the program with the bounds of --propose."
)
@click.option(
    "--out",
    type=Folder(),
    help="Folder for rates.json, parts.csv and journal.jsonl. The journal keeps finished parts.",
)
@threads
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Run on the workers of this Dask scheduler, as for sweep.",
)
@as_json
def rates(
    experiment: Path,
    good: Path,
    bad: tuple[Path, ...],
    parts: int,
    bad_parts: int | None,
    seed: int,
    program: Path | None,
    overrides: tuple[str, ...],
    over: str | None,
    propose: float | None,
    write: Path | None,
    out: Path | None,
    threads: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Press many simulated parts, and print how often a good part is refused and how often a bad
    part of each kind passes.

    A file of parts has kinds of parts, whose parameters have distributions. Each probability has an
    exact interval (Clopper and Pearson) of 95 %. Aborted parts are counted apart and are in no
    share. Part number i is the same for every number of parts, threads and workers. With --out, the
    same command, also with more parts, runs only what is missing.

    --propose sets the bounds least and most of the elements. The given share of good parts is then
    refused by the whole program, not by each element. Windows and envelopes stay as they are. The
    share of later parts that is refused varies from one proposal to the next. The command prints
    its range. Check the new program with another seed. With b bounds and a share s, at least b / s
    - 1 good parts are needed, and never fewer than 299. The file of -o is the program with new
    bounds and all its comments.
    """
    from forceaxis.cli import cycle_text
    from forceaxis.cycles import propose as proposing
    from forceaxis.cycles import rates as computing

    if (propose is None) != (write is None):
        raise InputError(
            "--propose: expected both --propose RATE and -o FILE, or neither of these options; "
            "add the missing option"
        )
    request = computing.RatesRequest(
        experiment, good, bad, parts, bad_parts, seed, program, overrides, over
    )
    if propose is not None:
        proposing.check(request.read_program(), parts, propose)
    done = computing.rates(request, out, threads, scheduler)
    proposal = None
    if propose is not None and write is not None:
        proposal = proposing.propose(done, propose, write, experiment, overrides)
    if as_json:
        table = to_json(done.result)
        print_json({**table, "proposal": to_json(proposal)} if proposal else table)
        return
    show(cycle_text.rates_rows(done.result, proposal))
    if out is not None:
        show([("files", paths.quoted(out))])


@cycle.command(
    epilog="""forceaxis cycle load press_fit --on can0:3
    forceaxis cycle load press_fit --program out/new.toml --on lcm:1
    forceaxis cycle load press_fit --on sim:press_fit""",
)
@EXPERIMENT
@program_option
@live
@as_json
def load(connection: AxisConnection, experiment: Path, program: Path | None, as_json: bool) -> None:
    """Load the press program of an experiment into an axis, and select this program for the next
    cycle.

    The axis has to be disabled, and it has to have the scales of the experiment: adc_bits,
    force_sign, rated_force, and force_scale within 1 %. The axis checks the whole program before it
    accepts the program. A refused program changes nothing. A program with the same number is
    replaced. The axis stores its programs, so they survive a power cut. A board without memory for
    programs keeps them until its next power-up.
    """
    from forceaxis.cli import cycle_text
    from forceaxis.cycles import live as cycles

    wanted = cycles.live_program(experiment, (), program)
    with owned(connection) as axis:
        loaded = cycles.load(axis, wanted)
    if as_json:
        print_json(loaded)
        return
    show(
        [
            ("program", f"{loaded.program}: {loaded.title}"),
            ("number", f"{loaded.number}, one of {loaded.programs} programs of the axis"),
            ("crc", f"{loaded.crc}, {loaded.size_bytes} bytes"),
            ("store", cycle_text.STORE_STATES.get(loaded.store, loaded.store)),
        ]
    )


VERBS = (cycle,)
