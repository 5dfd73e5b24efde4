"""The commands of `forceaxis recording` for logs of LCM messages and for journals of axis_node."""

from pathlib import Path

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.common import (
    File,
    Folder,
    as_json,
    codes_option,
    fail,
    print_json,
    print_result,
    show,
    waiting,
)
from forceaxis.cli.recording import recording, report_damage

log_file = click.argument(
    "log_path", metavar="FILE", type=click.Path(dir_okay=False, path_type=Path)
)


@recording.command(
    epilog="""forceaxis recording export out/axis2.log --out out/axis2
    forceaxis recording export out/axis2.log --out out/axis2 --npz --json"""
)
@log_file
@click.option("--out", type=Folder(), required=True, help="Folder for the tables.")
@click.option("--csv", is_flag=True, help="Write CSV only, unless --npz is given too.")
@click.option("--npz", is_flag=True, help="Write NPZ only, unless --csv is given too.")
@as_json
def export(log_path: Path, out: Path, csv: bool, npz: bool, as_json: bool) -> None:
    """Write the LCM messages of a log (states, events, commands, captures, clock, plant signals) as
    tables in CSV and NPZ files.

    Each channel becomes one table with the name of the channel. Each capture becomes a table too,
    such as AXIS_1_CAPTURE_1. The unit is part of a column's name: force_cnt_q8 is in 1/256 count,
    force_count in counts, time_s in s. A missing value is an empty field in CSV and nan in NPZ.
    """
    from forceaxis.bus import log_tables
    from forceaxis.cli.buses_text import export_text

    kinds = tuple(k for k, wanted in (("csv", csv), ("npz", npz)) if wanted) or ("csv", "npz")
    summary = log_tables.export(log_path, out, kinds)
    if not summary.tables:
        raise InputError(
            f"{paths.display(log_path)}: expected a log with messages of forceaxis, got a log "
            "without such messages; choose another file"
        )
    print_result(summary, as_json, lambda: export_text(summary), out)
    report_damage(summary.damage)


@recording.command(
    epilog="""forceaxis recording convert out/axis2.log out/axis2.mcap
    forceaxis recording convert out/axis2.mcap out/axis2.log"""
)
@log_file
@click.argument("target", type=File())
@as_json
def convert(log_path: Path, target: Path, as_json: bool) -> None:
    """Convert a log of LCM messages: TARGET is an MCAP file if its name ends in .mcap, an LCM log
    if it ends in .log. An existing file is replaced.

    An MCAP file has two topics for each channel. /lcm/AXIS_1_STATE has the bytes of the messages,
    so a log that is converted back has the same messages at the same times. /axis_1/state has the
    same messages as JSON for viewers, with the unit of each number in the schema. Each sample of a
    block becomes a message of its own, with tick and time_s.
    """
    from forceaxis.bus import recordings

    done = recordings.convert(log_path, target)
    print_result(done, as_json, lambda: f"{paths.quoted(target)}: {done.messages} messages")
    report_damage(done.damage)


@recording.command(
    epilog="""axis_node sim/experiments/contact.toml --can vcan0 --journal axis.journal &
    plant_node sim/experiments/contact.toml --pace real
    forceaxis recording replay axis.journal""",
)
@click.argument("journal", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--out", type=Folder(), help="Folder of the results, as for run.")
@codes_option
@as_json
def replay(journal: Path, out: Path | None, codes: bool, as_json: bool) -> None:
    """Repeat an earlier run of the program axis_node (the firmware on this computer) from the
    journal of the run, and check that all DAC codes are the same.

    The replay has to give the trace hash of the journal. Otherwise the exit status is 1. If the
    node was killed, its journal has no hash. The recorded part is then replayed, and the exit
    status is 1. An incident of `forceaxis axis incident` does not contain all inputs; the command
    names those that are missing.
    """
    from forceaxis.commission import incident

    if incident.is_incident(journal):
        missing = ", ".join(incident.missing(incident.load(journal)))
        fail(
            f"{journal}: expected a journal with all inputs of the axis, got an incident without "
            f"{missing}",
            status=1,
        )
    from forceaxis.experiments import run as runs
    from forceaxis.experiments import summary as summaries
    from forceaxis.experiments import trace

    with waiting(f"replaying {paths.display(journal)}"):
        done = runs.replay(journal)
    replayed = done.result.replay
    assert replayed is not None
    if out and not replayed.traced:
        fail(
            f"--out: expected a journal of at most 600 s, got a longer one, {journal}; replay "
            "this journal without --out"
        )
    if out:
        trace.write(done, out, codes)
    if as_json:
        print_json(done.summary)
    else:
        known = replayed.trace_hash or "none, it is broken off"
        text = f"{replayed.entries} entries, trace hash {known}"
        show([*summaries.rows(done.result, done.overrides), ("journal", text)])
    if replayed.ticks is None:
        fail(
            f"{journal}: expected a line `end`, got none, because the node was killed; only the "
            f"{done.result.ticks} ticks in the journal were replayed",
            status=1,
        )
    if not replayed.same:
        fail(
            f"{journal}: expected the trace hash {replayed.trace_hash} of the journal, got "
            "another hash from the replay",
            status=1,
        )
