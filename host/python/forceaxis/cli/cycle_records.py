"""Commands of `forceaxis cycle` about pressed parts: their records and their statistics."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import sys
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.common import Callback, File, Folder, Positive, as_json, print_json, show
from forceaxis.cli.cycle import (
    EXPERIMENT,
    cycle,
    drift_options,
    expect_picture,
    program_option,
    rate,
)
from forceaxis.cli.live_options import (
    AxisConnection,
    connected,
    errors,
    live,
    options,
    owned,
)
from forceaxis.errors import ParameterError, expect_package
from forceaxis.results import to_json
from forceaxis.words import counted

if TYPE_CHECKING:
    from forceaxis.cycles.curve import CurvePoints
    from forceaxis.cycles.live import LiveProgram
    from forceaxis.cycles.record import PartRecord
    from forceaxis.cycles.records import RecordFolder
    from forceaxis.cycles.results import Silence

RUNNING_PARTS = 1000  # largest number of recent parts over which `watch` computes statistics
SOURCE = click.argument("source", type=click.Path(path_type=Path))
recorded = click.option(
    "--out", type=Folder(), help="Folder for the records: parts/*.json and parts.csv."
)


def tables(verb: Callback) -> Callback:
    """Add the options --jsonl and --parquet to a command. Each option writes one more file with the
    records of all parts."""
    verb = click.option(
        "--jsonl",
        is_flag=True,
        help="Write parts.jsonl too, at the end of the command: one line for each record with its "
        "curve.",
    )(verb)
    return click.option(
        "--parquet", is_flag=True, help="Write parts.parquet too, at the end of the command."
    )(verb)


@cycle.command(
    epilog="""forceaxis cycle start press_fit --on can0:3
    forceaxis cycle start press_fit --on can0 --serial 4711 --out records
    forceaxis cycle start press_fit --on lcm:1 --json
    forceaxis cycle start press_fit --on can0 --curve part.csv --plot part.png""",
)
@EXPERIMENT
@program_option
@click.option(
    "--curve",
    type=File(),
    help="Table of the curve that the axis has recorded: FILE.csv.",
)
@click.option(
    "--plot",
    type=File(),
    help="Plot of this curve with windows, envelopes and bounds: FILE.png, .svg or .pdf.",
)
@click.option("--serial", default="", metavar="TEXT", help="Serial number of the part, 16 bytes.")
@recorded
@tables
@live
@as_json
def start(
    connection: AxisConnection,
    experiment: Path,
    program: Path | None,
    curve: Path | None,
    plot: Path | None,
    serial: str,
    out: Path | None,
    parquet: bool,
    jsonl: bool,
    as_json: bool,
) -> None:
    """Press one part: start a cycle with the program that `cycle load` has loaded, wait for its
    end, and print the verdict of the part. The axis moves.

    All bounds of the axis hold: position limits, velocity_max, force_limit, the contact guard. The
    command owns the axis while the cycle runs and disables it at the end. Ctrl-C, a stop from any
    bus, a fault and a killed command end the cycle, and the part is aborted, never good. The exit
    status is 0 for every verdict.

    The axis records a curve of at most 1000 points, which stays until its next cycle starts.

    With --out, the record of the part, with its curve, is added to a folder. When it is on the
    disk, or printed without --out, the command acknowledges the result, and the axis no longer
    keeps it. The results of other parts that wait stay.
    """
    from forceaxis.cli import cycle_text
    from forceaxis.cycles import curve as curves
    from forceaxis.cycles import live as cycles
    from forceaxis.cycles import records, results

    expect_picture(plot)
    if curve is not None and curve.suffix != ".csv":
        raise ParameterError("curve", f"{curve}: expected a file ending in .csv")
    _expect_out(parquet, jsonl, out)
    results.serial_words(serial)
    wanted = cycles.live_program(experiment, (), program)
    with records.folder_or_none(out) as folder, owned(connection) as axis:
        if folder is not None or curve is not None or plot is not None:
            cycles.expect_readable(axis)
        record = results.press(axis, wanted, serial)
        if folder is not None:
            record = results.with_curve(axis, record, wanted)
            folder.add(record)
        points = None
        if curve is not None or plot is not None:
            points = curves.read(axis, wanted)
            write_curve(points, record, wanted, curve, plot)
        if as_json:
            print_json(record)
        else:
            files = [file for file in (curve, plot) if file is not None]
            show([*cycle_text.record_rows(record), *cycle_text.curve_rows(points, files)])
        results.acknowledge(axis, record.number)
        _finish(folder, parquet, jsonl, as_json)


def write_curve(
    points: CurvePoints,
    part: PartRecord,
    wanted: LiveProgram,
    table: Path | None,
    plot: Path | None,
) -> None:
    """Write the curve that was recorded for a part to the files of --curve and --plot. Each file is
    written completely or not at all."""
    from forceaxis import drawing
    from forceaxis.cycles import curve as curves

    if table is not None:
        with paths.replacing(table.parent, table.name) as (file,):
            curves.write_table(points, wanted, file)
    if plot is not None:
        from forceaxis.cycles import plots

        with paths.replacing(plot.parent, plot.name) as (file,):
            drawn = plots.draw(curves.picture(points, part, wanted))
            drawing.save(drawn, file, plot.suffix[1:])


@cycle.command(
    epilog="""forceaxis cycle result press_fit --on can0 --out records
    forceaxis cycle result press_fit --on lcm:1 --json""",
)
@EXPERIMENT
@program_option
@recorded
@tables
@click.option(
    "--acknowledge", is_flag=True, help="Acknowledge the printed results. --out always does."
)
@live
@as_json
def result(
    connection: AxisConnection,
    experiment: Path,
    program: Path | None,
    out: Path | None,
    parquet: bool,
    jsonl: bool,
    acknowledge: bool,
    as_json: bool,
) -> None:
    """Read the results of pressed parts that an axis still stores, because no client has
    acknowledged them.

    With --out, each result is written to the folder and then acknowledged: the axis keeps it until
    its file is on the disk. A part that the folder has already is not written twice. Without --out,
    the results are printed, and acknowledged only with --acknowledge. The command does not take the
    axis from its owner. Results that a power cut of the axis has lost are named by their numbers.
    """
    from forceaxis.cli import cycle_text
    from forceaxis.cycles import live as cycles
    from forceaxis.cycles import records, results

    _expect_out(parquet, jsonl, out)
    wanted = cycles.live_program(experiment, (), program)
    with records.folder_or_none(out) as folder, connected(connection) as axis:
        collector = results.Collector(axis, wanted, folder)
        found = [*collector.collect(), *collector.lost()]
        if as_json:
            print_json([to_json(record) for record in found])
        else:
            rows = [row for record in found for row in cycle_text.record_rows(record)]
            show([*rows, ("results", counted(len(found), "result"))])
        if acknowledge and folder is None:
            for record in found:
                results.acknowledge(axis, record.number)
        _finish(folder, parquet, jsonl, as_json)


@cycle.command(
    epilog="""forceaxis cycle watch press_fit --on can0 --out records
    forceaxis cycle watch press_fit --on lcm:1 --out records --parts 100 --parquet
    forceaxis cycle watch press_fit --on can0 --out records --master-every 8 --master-serial M1 \\
    --calibration-due 2027-03-01""",
)
@EXPERIMENT
@program_option
@click.option(
    "--out", type=Folder(), required=True, help="Folder for the records: parts/*.json, parts.csv."
)
@tables
@click.option("--parts", type=click.IntRange(1), help="End after this number of parts.")
@click.option(
    "--master-every",
    type=Positive(),
    metavar="HOURS",
    help="A good master part is due after this time. Needs --master-serial.",
)
@click.option("--master-serial", metavar="TEXT", help="Serial number of the master part.")
@click.option(
    "--calibration-due",
    type=click.DateTime(["%Y-%m-%d"]),
    metavar="DATE",
    help="Last day on which the calibration is valid, such as 2027-03-01.",
)
@live
@as_json
def watch(
    connection: AxisConnection,
    experiment: Path,
    program: Path | None,
    out: Path,
    parquet: bool,
    jsonl: bool,
    parts: int | None,
    master_every: float | None,
    master_serial: str | None,
    calibration_due: datetime.datetime | None,
    as_json: bool,
) -> None:
    """Record the result of every part that an axis presses while a PLC or another master commands
    it. Ctrl-C ends the command.

    The command prints a line for each part, with the number of good parts and the smallest Cpk of
    the elements over the parts of this command, at most the last 1000. It does not take the axis
    from its owner and moves nothing. Each result is written to the folder and then acknowledged. If
    the axis has no power or the connection fails, the command waits and connects again. Results
    that the axis has lost in a power cut are named by their numbers, and recorded as lost. If the
    folder already has parts, the new ones are added.

    The master part has the serial number --master-serial. It has to be pressed and found good
    within each --master-every hours. Otherwise the line and the record of every part have the note
    "master due". The note "calibration due" appears after --calibration-due, and if the calibration
    of the axis has expired. The notes do not stop the axis. The exit status is 0 after Ctrl-C.
    """
    from forceaxis.cli import cycle_text
    from forceaxis.cycles import capability, records, results
    from forceaxis.cycles import live as cycles

    if (master_every is None) != (master_serial is None):
        raise InputError(
            "--master-every: expected both --master-every HOURS and --master-serial TEXT, or "
            "neither of these options; add the missing option"
        )
    wanted = cycles.live_program(experiment, (), program)
    due = None if calibration_due is None else calibration_due.date()
    reminders = results.Reminders(master_every, master_serial or "", due)
    with records.RecordFolder(out) as folder, errors(connection):
        reminders.resume(folder)
        seen: deque[PartRecord] = deque(maxlen=RUNNING_PARTS)
        count = 0
        with contextlib.suppress(KeyboardInterrupt):
            for event in results.watch(connection.link, wanted, folder, reminders):
                if isinstance(event, results.Silence):
                    _say(event)
                    continue
                seen.append(dataclasses.replace(event, curve=None))
                found = capability.statistics(records.RecordedParts(str(out), list(seen)))
                count += 1
                if as_json:
                    print_json(event)
                else:
                    running = cycle_text.running_text(found)
                    click.echo(f"{cycle_text.record_line(event)}; {running}")
                if count == parts:
                    break
        _finish(folder, parquet, jsonl, as_json)


@cycle.command(
    epilog="""forceaxis cycle teach press_fit records --propose 1% -o new.toml
    # records parts until there are 600, and then sets the bounds
    forceaxis cycle teach press_fit records --on can0 --parts 600 --propose 1% -o new.toml""",
)
@EXPERIMENT
@click.argument("folder", type=click.Path(path_type=Path))
@program_option
@click.option(
    "--parts",
    type=click.IntRange(1),
    help="With an axis: record parts until the folder has this number of them.",
)
@click.option(
    "--propose",
    metavar="RATE",
    required=True,
    callback=rate,
    help="Share of good parts that the new bounds refuse, such as 1%.",
)
@click.option(
    "--write", "-o", type=File(), required=True, help="File for the program with the new bounds."
)
@options()
@as_json
def teach(
    connection: AxisConnection,
    experiment: Path,
    folder: Path,
    program: Path | None,
    parts: int | None,
    propose: float,
    write: Path,
    as_json: bool,
) -> None:
    """Propose bounds for the evaluation elements from recorded good parts. The new bounds refuse
    the share RATE of such parts.

    FOLDER has records of parts that are known to be good, pressed with this program. All of them
    that are not aborted count as good, whatever the old bounds said of them, so give a folder of
    its own. With a connection and --parts, the command first records parts into FOLDER as `cycle
    watch` does. The bounds are computed as by `cycle rates --propose`. The share of refused parts
    is that of the whole program, for any distribution of the values. With b bounds and a share s,
    at least b / s - 1 parts are needed, and never fewer than 299. Windows and envelopes stay as
    they are. The file of -o is the program with new bounds and all its comments.
    """
    from forceaxis.cli import cycle_text
    from forceaxis.cycles import live as cycles
    from forceaxis.cycles import propose as proposing
    from forceaxis.cycles import records, results, teach

    if connection.addresses and parts is None:
        raise InputError(
            "--on: expected the option --parts N together with --on; add --parts N, the number of "
            "parts"
        )
    connection = connection if parts is None else connection.one()
    wanted = cycles.live_program(experiment, (), program)
    if parts is not None:
        proposing.check(wanted.program, parts, propose)
        with records.RecordFolder(folder) as into, errors(connection):
            missing = parts - len(teach.own_parts(into.records(), wanted))
            events = results.watch(connection.link, wanted, into, results.Reminders())
            while missing > 0:
                event = next(events)
                if isinstance(event, results.Silence):
                    _say(event)
                    continue
                click.echo(cycle_text.record_line(event), err=True)
                missing -= len(teach.own_parts([event], wanted))
    found = teach.teach(records.read_parts(folder), wanted, propose, write)
    if as_json:
        print_json(found)
        return
    show(cycle_text.proposal_rows(found))


def _say(event: Silence) -> None:
    """Print a text line when the axis stops answering, and another text line when the axis answers
    again."""
    said = f"{event.reason}; waiting" if event.reason else "the axis answers again"
    click.echo(f"forceaxis: warning: {said}", err=True)


def _expect_out(parquet: bool, jsonl: bool, out: Path | None) -> None:
    """Raise InputError for --parquet or --jsonl without --out."""
    if (parquet or jsonl) and out is None:
        option = "--parquet" if parquet else "--jsonl"
        raise InputError(f"{option}: expected --out FOLDER together with this option; add --out")


def _finish(folder: RecordFolder | None, parquet: bool, jsonl: bool, as_json: bool) -> None:
    """Write the files of --jsonl and --parquet with the records of all parts in `folder`. Then
    print the name of `folder`."""
    if folder is None:
        return
    if parquet:
        folder.write_parquet()
    if jsonl:
        folder.write_lines()
    if not as_json:
        show([("files", paths.quoted(folder.folder))])


@cycle.command(
    epilog="""forceaxis cycle statistics records
    forceaxis cycle statistics records --last 100 --page statistics.html --plot statistics.png
    forceaxis cycle statistics records --false-alarms 1%
    forceaxis cycle statistics out/rates --json""",
)
@SOURCE
@click.option("--last", type=click.IntRange(1), help="Only the last parts. Default: all parts.")
@drift_options(default=None)
@click.option("--plot", type=File(), help="Run charts and histograms: FILE.png, .svg or .pdf.")
@click.option("--page", type=File(), help="Page with figures and plots: FILE.html.")
@as_json
def statistics(
    source: Path,
    last: int | None,
    false_alarms: float | None,
    reference: int,
    plot: Path | None,
    page: Path | None,
    as_json: bool,
) -> None:
    """Print statistics of pressed parts: the share of good parts, and for each evaluation element
    the mean, standard deviation, Cp, Cpk and a run chart.

    SOURCE is a folder with records, as `cycle start`, `cycle result` and `cycle watch` write it
    with --out, its file parts.jsonl, the folder of `cycle rates`, or a table parts.csv of either.
    Of simulated parts only the good ones count.

    s is the standard deviation (n - 1) of all values. Cp is (most - least) / 6 s, and Cpk is the
    distance of the mean to the nearer bound / 3 s. An element with one bound has no Cp. Other texts
    call the two Pp and Ppk, because s includes a drift from part to part. The 95 % intervals hold
    for values with a normal distribution. That of Cp is exact, and that of Cpk is by Bissell. With
    fewer than 30 values there is neither Cp nor Cpk. The share of good parts has an exact interval
    for every distribution. The values of elements are those of all good and bad parts that have the
    program of the last part.

    --false-alarms tests the values of each element for wear and drift, by a CUSUM of sequential
    ranks. The share is an upper bound for all elements together and for every distribution.
    """
    from forceaxis.cli import cycle_text, judge_text
    from forceaxis.cycles import capability, drift, records

    if plot is not None:
        expect_picture(plot)
    if page is not None and page.suffix != ".html":
        raise ParameterError("page", f"{page}: expected a file ending in .html")
    parts = records.read_parts(source, last)
    found = capability.statistics(parts)
    drawn = capability.last_curves(parts)
    own = capability.own_parts(parts.records)
    tested = None
    if false_alarms is not None:
        tested = drift.drift(drift.series_of(own), false_alarms, reference)
    if plot is not None:
        from forceaxis import drawing
        from forceaxis.cycles import statistics_plots

        with paths.replacing(plot.parent, plot.name) as (file,):
            drawing.save(statistics_plots.statistics(found, drawn), file, plot.suffix[1:])
    if page is not None:
        from forceaxis.pages import parts as pages

        pages.write(page, found, cycle_text.element_table(found), drawn)
    if as_json:
        print_json({**to_json(found), **({} if tested is None else {"drift": to_json(tested)})})
        return
    show(cycle_text.statistics_rows(found))
    if tested is not None:
        names = [f"part {r.number}{f' ({r.serial})' if r.serial else ''}" for r in own]
        show([*judge_text.drift_rows(tested), *judge_text.change_rows(tested, names)])
    show([("files", paths.quoted(file)) for file in (plot, page) if file is not None])


@cycle.command(
    epilog="""forceaxis cycle serve records
    forceaxis cycle serve records --host 0.0.0.0 --port 4840""",
)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--host", default="127.0.0.1", show_default=True, help="Address of this machine.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=4840,
    show_default=True,
    help="TCP port; 0: any free port.",
)
@click.option(
    "--nodesets",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the nodesets of the npm package node-opcua-nodesets. Default: the one of this "
    "Python environment.",
)
def serve(folder: Path, host: str, port: int, nodesets: Path | None) -> None:
    """Make the results of pressed parts in a folder available to OPC UA clients, which can only
    read them (OPC 40450-1, joining results).

    FOLDER has records, as `cycle start`, `cycle result` and `cycle watch` write it with --out. Each
    of the last 200 parts is a result below ResultManagement/Results. A result has the elements of
    the part with value, bounds, unit and verdict, and its curve as a trace. Serial number, program
    and times are meta data. A record that is added later becomes a result at once, and the server
    sends the event that a result is ready. The command reads only the folder, and has no connection
    to the axis. Clients need no password. So use --host only in a network whose members may see the
    results. SIGINT or SIGTERM ends it.
    """
    from forceaxis.bus.sources import AddressError

    expect_package("cycle serve", "asyncua", "asyncua", "opcua")
    from forceaxis.cycles import joining_server

    def ready(url: str) -> None:
        show([("server", url)])

    chosen = nodesets or joining_server.NODESETS
    try:
        sys.exit(128 + joining_server.serve(folder, chosen, host, port, ready))
    except AddressError as error:
        raise InputError(f"--host {host} --port {port}: {error}") from None
