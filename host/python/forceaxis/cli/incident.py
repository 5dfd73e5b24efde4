"""`forceaxis axis incident`: read and explain the recording of an error that an axis has stored."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.axis import axis
from forceaxis.cli.common import (
    Folder,
    Positive,
    Slow,
    Subject,
    aligned,
    as_json,
    done_waiting,
    print_result,
)
from forceaxis.cli.live_options import RECORDED, AxisConnection, connected, options
from forceaxis.words import plain

if TYPE_CHECKING:
    from forceaxis.commission.incident import Incident
    from forceaxis.commission.incident_explain import CauseChange, Explanation


@axis.command(
    cls=Slow,
    epilog="""forceaxis axis incident --on lcm:1 --out out/incident
    forceaxis axis incident --on can0:3 --clear
    forceaxis axis incident --on sim:contact --set firmware.mode=force \\
        --set firmware.force_gain=5 --set firmware.force_max=30 --wait 5
    forceaxis axis incident --file out/incident/incident.json --explain press/model.toml \\
        --posterior out/press/posterior.json --out out/why""",
)
@options(RECORDED)
@click.option("--out", type=Folder(), help="Folder for incident.json and incident.png.")
@click.option(
    "--clear", is_flag=True, help="Delete the incident, so that the black box records again."
)
@click.option(
    "--wait", "wait_s", type=Positive(0, 1e6), help="Longest time to wait for an incident, s."
)
@click.option(
    "--counts-per-mm",
    type=Positive(1e-6, 1e9),
    help="Encoder counts per mm, to print lengths in mm.",
)
@click.option(
    "--file", type=click.Path(dir_okay=False, path_type=Path), metavar="INCIDENT.json",
    help="Incident that was stored with --out, in place of an axis.",
)  # fmt: skip
@click.option(
    "--explain", "model", type=Subject(paths.MODELS), metavar="MODEL",
    help="Model of the released machine: find the change of plant, sensor or command that "
    "reproduces the recorded second. Beside --file, --set gives its parameters.",
)  # fmt: skip
@click.option(
    "--posterior", type=click.Path(dir_okay=False, path_type=Path),
    help="posterior.json of `forceaxis identify contact` for the released machine. Default: each "
    "parameter of MODEL within at most 5 %.",
)  # fmt: skip
@as_json
def incident(
    connection: AxisConnection,
    out: Path | None,
    clear: bool,
    wait_s: float | None,
    counts_per_mm: float | None,
    file: Path | None,
    model: str | None,
    posterior: Path | None,
    as_json: bool,
) -> None:
    """Explain why an axis has stopped with a fault: read the signals that the axis has recorded in
    the last second before the fault, and describe in words what happened.

    The axis keeps the first incident, even over a reset, until the incident is cleared or a
    recording is started. The first incident since power-up is also kept over a power cut, but at
    most one in 24 hours. The exit status is 1 if there is no incident. The command owns the axis
    while it reads. So the axis has to be disabled, as it is after a fault.

    With --explain, the plant of MODEL is fed with the recorded codes, and possible causes are
    tried: a changed gain, zero or lag of the force sensor; another stiffness or position of the
    workpiece; friction; backlash; another gain of the drive; another scale or a slip of the
    encoder; or the command alone. The causes are ranked by their fit to force and position. The
    folder of --out then has explanation.json, a plot, and experiment.toml, which repeats the fault.
    The exit status is 1 if no cause explains the recorded second.
    """
    if posterior and not model:
        raise InputError(
            "--posterior: expected --explain MODEL together with --posterior FILE, "
            "got no --explain; add --explain MODEL"
        )
    connection = connection if file else connection.one()
    done = _read(connection, clear, wait_s, file)
    if model:
        _explain(done, model, posterior, connection, out, as_json)
        return
    from forceaxis.commission import incident as incidents
    from forceaxis.commission import incident_text

    lines = incident_text.tell(done, counts_per_mm)
    if out:
        incidents.write(done, out, incidents.figure(done, counts_per_mm))
    story = incident_text.IncidentStory.of(done, tuple(lines[1:]))
    print_result(story, as_json, lambda: f"{done.where}: " + "\n  ".join(lines), out)


def _read(
    connection: AxisConnection, clear: bool, wait_s: float | None, file: Path | None
) -> Incident:
    """Return the incident from the file `file`, or from the axis if `file` is None."""
    from forceaxis.commission import incident as incidents

    if file:
        if clear or wait_s or connection.addresses:
            raise InputError(
                "--file: expected --file without --on, --wait and --clear, because those options "
                "are for a live axis; remove them, or remove --file"
            )
        return incidents.load(file)
    with connected(connection) as axis:
        if wait_s:
            incidents.wait(axis, wait_s)
        axis.acquire()
        done = incidents.fetch(axis)
        if clear:
            incidents.clear(axis)
    return done


def _explain(
    done: Incident, model: str, posterior: Path | None, connection: AxisConnection,
    out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Explain an incident, and write the files of the explanation."""
    from forceaxis import linear
    from forceaxis.commission import incident_explain

    # --set changes the simulated axis. The plant of the explanation keeps the values of MODEL.
    held = {} if connection.is_simulated else linear.overrides(connection.overrides)
    found = incident_explain.explain(done, incident_explain.ExplainOrder(model, posterior, held))
    if out:
        incident_explain.write(found, out)
    done_waiting()
    print_result(found.result, as_json, lambda: "\n".join(rows_of(found.result)), out)
    if not found.result.explained:
        sys.exit(1)


def rows_of(found: Explanation) -> list[str]:
    """Return the text lines that explain an incident: what happened, and the table of possible
    causes."""
    touch = f"touch {-1e3 * found.touch_s:.4g} ms before it" if found.touch_s else "no touch"
    best = found.causes[0]
    lines = [
        f"incident     {found.where}: {found.fault.replace('_', ' ')}, {touch}, at "
        f"{1e3 * found.speed_m_per_s:.3g} mm/s, up to {found.peak_N:.4g} N",
        f"compared     {found.ticks} ticks with {found.model}"
        + (f" and {found.posterior}" if found.posterior else ""),
    ]
    if found.explained:
        lines.append(f"cause        {best.name}: {best.text}")
    else:
        lines.append(
            f"cause        none of those tried explains the recorded second; the nearest is "
            f"{best.name}: {best.text}"
        )
    table = [("cause", "change", "95 %", "below best", "p", "verdict")]
    for one in found.causes:
        changes = [_change(change) for change in one.changes] or [("", "")]
        shown = f"{one.below:.1f}" if one.below < 1e4 else f"{one.below:.2g}"
        table.append((one.name, *changes[0], shown, f"{one.p:.2g}", one.verdict))
        table += [("", *more, "", "", "") for more in changes[1:]]
    lines += aligned(table, (0, 1, 2, 5))
    repeats = {
        True: "experiment.toml of --out repeats the fault",
        False: "experiment.toml of --out does not have the same fault",
        None: "none: the incident does not tell the command of this mode of operation",
    }
    return [*lines, f"experiment   {repeats[found.repeats]}"]


def _change(change: CauseChange) -> tuple[str, str]:
    unit = f" {change.unit}" if change.unit and change.unit != "1" else ""
    released = "" if not change.released else f", released {plain(change.released, 4)}"
    low, high = (plain(value, 4) for value in change.interval)
    return f"{change.name} = {plain(change.value, 4)}{unit}{released}", f"{low} to {high}"
