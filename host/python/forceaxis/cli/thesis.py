"""The commands `tables`, `check-thesis` and `session`, which repeat results of the thesis, and
the command `report`, which writes a page about a folder of experiments."""

import json
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis.cli.common import (
    Folder,
    Slow,
    Verb,
    as_json,
    link_of,
    linked,
    print_result,
    threads,
)
from forceaxis.experiments import link
from forceaxis.results import to_json
from forceaxis.thesis import tables

if TYPE_CHECKING:
    from forceaxis.thesis import claims
    from forceaxis.thesis.session import SessionResult


@click.command(name="tables", cls=Verb, epilog="forceaxis tables --json")
@click.option("--fit", is_flag=True, help="Fit the constants again instead of using stored ones.")
@threads
@linked
@as_json
def tables_(
    fit: bool,
    threads: int | None,
    kind: str | None,
    lcm_url: str,
    link_can: str,
    inject: str,
    as_json: bool,
) -> None:
    """Simulate the 55 cells of the stability tables of the thesis, and compare the simulated
    verdicts with the tables.

    The exit status is 1 if fewer cells match than the parameter file records. With --link the
    firmware is one separate process for all cells.
    """
    if fit and kind:
        raise click.UsageError(
            "expected --fit without --link, because a fit needs thousands of runs"
        )
    if fit:
        click.echo(json.dumps(to_json(tables.fit(threads)), indent=None if as_json else 2))
        return
    result = tables.run(threads, link_of(kind, lcm_url, link_can, inject))
    print_result(result, as_json, lambda: tables_text(result))
    if result.matched < tables.load().matched_at_least:
        sys.exit(1)


def tables_text(result: tables.TablesResult) -> str:
    """Return the text lines about the stability tables of the thesis: each cell whose simulated
    verdict differs, with the reason; the fitted constants; the number of cells with equal
    verdicts."""
    lines = []
    for cell in result.cells:
        if cell.agrees:
            continue
        count = cell.force_setpoint
        newton = count and count * result.fitted["force_per_count"]
        setpoint = f" counts of force ({newton:g} N)" if count else ""
        lines.append(
            f"differs      Fig {tables.key_of(cell)}{setpoint}: thesis {cell.thesis}, "
            f"ours {cell.ours}; {cell.reason}"
        )
    constants = ", ".join(f"{name} = {value:g}" for name, value in result.fitted.items())
    lines.append(f"fitted       {constants}")
    lines.append(f"score        {result.matched} of {result.total} cells match the thesis")
    return "\n".join(lines)


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

    For each model the page shows the recommended P gain and the margins of each designed bank, for
    each experiment the verdict, the controlled force and the traces. Without FOLDER the command
    runs the experiments and tables of the thesis. The exit status is 1 if an experiment could not
    be run; the page then shows the others.
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


@click.command(
    cls=Verb,
    epilog="""forceaxis session --out out/session
    forceaxis replay out/session/axis.journal""",
)
@click.option(
    "--out", type=Folder(), default="out/session", show_default=True, help="Folder of the results."
)
@as_json
def session(out: Path, as_json: bool) -> None:
    """Repeat a laboratory session of the thesis in real time, with a simulated robot that is
    operated through the gateway over a virtual CAN bus.

    The session boots the axis, sets the gains, moves 36,000 counts, makes contact at k_f = 5 and
    f_d = 30, applies an impact, reads the recorder and draws a plot. Plant, firmware and gateway
    are separate processes. The command writes session.png, session.svg and axis.journal;
    `forceaxis replay` of the journal gives the same trace hash. If the kernel has no CAN, the
    session runs in a guest kernel (tools/vcan).
    """
    link.under_vcan(link.LinkOptions("socketcan"))
    from forceaxis.thesis import session as thesis_session

    # The signal SIGTERM acts as an interrupt, so that the programs end and the journal is complete.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))

    def report(step: str) -> None:
        if sys.stderr.isatty() and not as_json:
            click.echo(f"session      {step}", err=True)

    found = thesis_session.run_with_programs(out, report)
    print_result(found, as_json, lambda: session_text(found))
    if {found.trace_hash.plant_node, found.trace_hash.axis_node} != {found.replayed_hash}:
        click.echo(
            "forceaxis: session: expected one trace hash of plant, firmware and replay", err=True
        )
        sys.exit(1)


def session_text(found: "SessionResult") -> str:
    """Return the values that were observed in a laboratory session as text lines with units."""
    from forceaxis.thesis import session as thesis_session

    scales = thesis_session.scales()

    def force(count: float) -> str:
        return f"{count * scales.N_per_count:.4g} N ({count:.2f} counts of force)"

    travel = found.position_after_move_cnt
    return "\n".join(
        (
            f"moved to     {travel * scales.mm_per_count:.5g} mm ({travel} encoder counts)",
            f"contact      held {force(found.force_held_cnt)}",
            f"strike       peak {force(found.peak_force_cnt)}, then {force(found.force_after_cnt)} "
            "again",
            f"recorded     {found.samples} samples, {found.samples_missing} missing",
            f"watched      {found.states} states, {found.messages_lost} messages lost",
            f"trace hash   {found.replayed_hash}, of plant, firmware and replay",
            f"files        {found.folder}",
        )
    )


@click.command(
    name="check-thesis", cls=Slow, epilog="forceaxis check-thesis\nforceaxis check-thesis --json"
)
@as_json
def check_thesis(as_json: bool) -> None:
    """Compare the numbers in the text of the thesis with the numbers that the models of the thesis
    give in this program.

    The numbers are frequencies, crossovers, damping ratios and improvements. Each difference has a
    line with its reason. The exit status is 1 if a difference has no known reason.
    """
    from forceaxis.thesis import claims

    result = claims.check()
    print_result(result, as_json, lambda: claims_text(result))
    if result.unexplained:
        sys.exit(1)


def claims_text(result: "claims.CheckedClaims") -> str:
    """Return two text lines for each number of the thesis. The text lines state if the number
    agrees, the value in the thesis, and the value that the model gives."""
    from forceaxis.thesis import claims

    lines = []
    for c in result.claims:
        mark = "agrees " if c.agrees else "differs"
        lines.append(f"{mark}  {c.where:16} {c.what}")
        thesis, ours = claims.value(c.thesis, c.unit), claims.value(c.ours, c.unit)
        why = f": {c.why}" if c.why else ""
        within = f" (within {100 * c.within:g} %)" if c.within else ""
        lines.append(f"           thesis {thesis}, ours {ours}{within}{why}")
    lines.append(f"{result.agree} agree, {result.differ} differ")
    return "\n".join(lines)


VERBS = (tables_, check_thesis, report, session)
