"""`forceaxis thesis`, the group of commands that repeat results of the thesis."""

import json
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis.cli.common import (
    Folder,
    Slow,
    Verbs,
    as_json,
    fitted_lines,
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


@click.group(
    cls=Verbs,
    epilog="""forceaxis thesis tables
    forceaxis thesis check""",
)
def thesis() -> None:
    """Repeat results of the thesis: its stability tables, the numbers in its text, a session in the
    laboratory."""


@thesis.command(name="tables", epilog="forceaxis thesis tables --json")
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
    verdict differs from the thesis, with the reason, then the fitted constants, and then the number
    of cells with equal verdicts."""
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


@thesis.command(
    epilog="""forceaxis thesis session --out out/session
    forceaxis recording replay out/session/axis.journal""",
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
    are separate processes. The command writes session.png, session.svg and axis.journal. `forceaxis
    recording replay` of the journal gives the same trace hash. If the kernel has no CAN, the
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
    """Return the values that were measured in a laboratory session, as text lines with units."""
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


@thesis.command(cls=Slow, epilog="forceaxis thesis check\nforceaxis thesis check --json")
@as_json
def check(as_json: bool) -> None:
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
    """Return two text lines for each number of the thesis: whether this number agrees with the
    model, the value in the thesis, and the value that the model gives."""
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


@thesis.command(
    cls=Slow,
    epilog="""forceaxis thesis beam
    forceaxis thesis beam --modes 4 --json""",
)
@click.option(
    "--bending-stiffness-nm2",
    type=float,
    default=1.0,
    show_default=True,
    help="Bending stiffness E I.",
)
@click.option("--mass-per-length-kg-per-m", type=float, default=1.0, show_default=True)
@click.option("--length-m", type=float, default=1.0, show_default=True)
@click.option("--modes", type=click.IntRange(1, 200), default=4, show_default=True)
@as_json
def beam(modes: int, as_json: bool, **given: float) -> None:
    """Compute the exact poles and zeros of the elastic beam of thesis section 2.4.4, and the error
    if a few modes of vibration approximate the beam.

    The beam slides at the actuator, and its tip is free. The command prints the undamped poles and
    zeros of the first --modes modes. It also prints the error of an approximation by the first n
    modes, up to the fourth mode. JSON: modes, each with b l, pole_rad_per_s,
    actuator_zero_rad_per_s (imaginary pairs) and tip_zero_per_s (a real pair); approximation_errors
    for n = 4 to 40.
    """
    from forceaxis.cli import text_models
    from forceaxis.linear import beam as bending

    result = bending.analyse(
        bending.Beam(
            given["bending_stiffness_nm2"], given["mass_per_length_kg_per_m"], given["length_m"]
        ),
        modes,
    )
    print_result(result, as_json, lambda: fitted_lines(text_models.describe_beam(result)))


VERBS = (thesis,)
