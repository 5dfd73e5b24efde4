"""`forceaxis gateway` and `forceaxis session`: the supervisor, a session of the thesis over it."""

import json
import os
import signal
import sys

import click

from forceaxis import paths
from forceaxis.cli.common import Folder, Verb, as_json
from forceaxis.experiments import link


@click.command(
    cls=Verb,
    context_settings={"ignore_unknown_options": True, "help_option_names": []},
    epilog="""forceaxis gateway --can vcan0 --axes 1,2 --set force_gain=5
    forceaxis gateway --help""",
)
@click.argument("args", nargs=-1, type=click.UNPROCESSED)
def gateway(args):
    """Supervise axes on a CAN bus: CANopen master, LCM, Modbus TCP. Ends on SIGTERM or SIGINT.

    `forceaxis gateway --help` lists its options.
    """
    program = link.program("gateway")
    sys.stdout.flush()
    os.execv(program, [program, *args])


@click.command(
    cls=Verb,
    epilog="""forceaxis session --out out/session
    forceaxis replay out/session/axis.journal""",
)
@click.option(
    "--out", type=Folder(), default="out/session", show_default=True, help="Folder of the results."
)
@as_json
def session(out, as_json):
    """Hold a whole session of the thesis through the gateway alone, on virtual CAN in real time.

    Boot, gains, a move of 36,000 counts, contact at k_f = 5 and f_d = 30, a strike, the recorder's
    upload, a plot; plant, firmware and gateway are processes of their own. Files: session.png, and
    axis.journal, which `forceaxis replay` runs again to the same trace hash. Where the kernel has
    no CAN it runs in a guest (tools/vcan).
    """
    link.under_vcan(link.Link("socketcan"))
    from forceaxis.thesis import session as thesis_session

    # As an interrupt does: the programs are ended, half a journal is not left behind.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    found = thesis_session.whole(out)
    found["folder"] = paths.display(out)
    hashes = {*found["trace_hash"].values(), found["replayed_hash"]}
    if as_json:
        click.echo(json.dumps(found, allow_nan=False))
    else:
        for line in describe(found):
            click.echo(line)
    if len(hashes) != 1:
        click.echo(
            "forceaxis: session: expected one trace hash of plant, firmware and replay", err=True
        )
        sys.exit(1)


def describe(found):
    """What was seen, for a reader."""
    return (
        f"moved to     {found['position_after_move_cnt']} count",
        f"contact      held {found['force_held_cnt']:.2f} count",
        f"strike       peak {found['peak_force_cnt']:.2f} count, then "
        f"{found['force_after_cnt']:.2f} count again",
        f"recorded     {found['samples']} samples, {found['samples_missing']} missing",
        f"watched      {found['states']} states, {found['messages_lost']} messages lost",
        f"trace hash   {found['replayed_hash']}, of plant, firmware and replay",
        f"files        {found['folder']}",
    )


VERBS = (gateway, session)
