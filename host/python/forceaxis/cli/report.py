"""`forceaxis report`: write a page about a folder of experiments."""

import sys
from pathlib import Path

import click

from forceaxis import paths
from forceaxis.cli.common import Folder, Slow, as_json, print_result, threads


@click.command(
    cls=Slow,
    epilog="""forceaxis report --out report && xdg-open report/index.html
    forceaxis report press --out press/report""",
)
@click.argument("folder", required=False, type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=Folder(),
    default="report",
    show_default=True,
    help="Folder for index.html.",
)
@threads
@as_json
def report(folder: Path | None, out: Path, threads: int | None, as_json: bool) -> None:
    """Run every experiment in FOLDER, and write one HTML page about the axis with gains, margins,
    verdicts and plots of the signals.

    For each model, the page shows the recommended P gain and the margins of each designed bank. For
    each experiment, it shows the verdict, the controlled force and the traces. Without FOLDER the
    command runs the experiments and tables of the thesis. The exit status is 1 if an experiment
    could not be run. The page then shows the others.
    """
    from forceaxis.pages import report as page

    summary = page.write(folder, out, threads)
    lines = [
        f"report       {paths.quoted(out / 'index.html')}",
        f"experiments  {summary.experiments} run",
    ]
    if summary.total is not None:
        lines.append(f"tables       {summary.matched} of {summary.total} cells match the thesis")
    print_result(summary, as_json, lambda: "\n".join(lines))
    for error in summary.errors:
        click.echo(f"forceaxis: {error}", err=True)
    if summary.errors:
        sys.exit(1)


VERBS = (report,)
