"""`forceaxis incident`: read and explain the recording of an error that an axis has stored."""

from pathlib import Path

import click

from forceaxis.cli.common import Folder, Positive, Verb, as_json, print_result
from forceaxis.cli.live_options import AxisConnection, connected, live


@click.command(
    cls=Verb,
    epilog="""forceaxis incident --axis 1 --out out/incident
    forceaxis incident --can can0 --node 3 --clear
    forceaxis incident --sim sim/experiments/contact.toml --set firmware.mode=force \\
        --set firmware.force_gain=5 --set firmware.force_max=30 --wait 5""",
)
@live
@click.option("--out", type=Folder(), help="Folder for incident.json and incident.png.")
@click.option(
    "--clear", is_flag=True, help="Delete the incident, so that the black box records again."
)
@click.option(
    "--wait", "wait_s", type=Positive(0, 1e6), help="Longest time to wait for an incident, s."
)
@click.option(
    "--counts-per-mm", type=Positive(1e-6, 1e9), help="Encoder counts per mm; the text then has mm."
)
@as_json
def incident(
    connection: AxisConnection,
    out: Path | None,
    clear: bool,
    wait_s: float | None,
    counts_per_mm: float | None,
    as_json: bool,
) -> None:
    """Explain why an axis has stopped with a fault: read the signals of the last second before the
    error, which the axis has recorded, and describe in words what happened.

    The black box of an axis keeps the first incident, also over a reset, until it is cleared or a
    recording is started. The first incident since power-up is also kept over a power cut, at most
    one in 24 hours. The exit status is 1 if there is no incident. The command owns the axis
    while it reads, so the axis has to be disabled, as it is after a fault.
    """
    from forceaxis.commission import incident as incidents
    from forceaxis.commission import incident_text

    with connected(connection) as axis:
        if wait_s:
            incidents.wait(axis, wait_s)
        axis.acquire()
        done = incidents.fetch(axis)
        if clear:
            incidents.clear(axis)
    lines = incident_text.tell(done, counts_per_mm)
    if out:
        incidents.write(done, out, incidents.figure(done, counts_per_mm))
    story = incident_text.IncidentStory.of(done, tuple(lines[1:]))
    print_result(story, as_json, lambda: f"{done.where}: " + "\n  ".join(lines), out)


VERBS = (incident,)
