"""`forceaxis recording`: import files of other programs as recordings, and show recorded files."""

import functools
import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import click

from forceaxis import paths
from forceaxis.cli.common import (
    Verbs,
    aligned,
    as_json,
    options_in,
    print_json,
    print_result,
)
from forceaxis.recordings import signal_recording
from forceaxis.recordings.can_names import Names
from forceaxis.recordings.importing import Imported, ImportRequest, import_sources, maps_of
from forceaxis.recordings.reading import read_sources
from forceaxis.recordings.signal_recording import RecordedSignal, SignalRecording
from forceaxis.recordings.source import Source
from forceaxis.results import JsonObject, to_json
from forceaxis.words import counted

SHOWN_FINDINGS = 8  # largest number of observations of one kind that are shown for one signal

readable = click.Path(dir_okay=False, path_type=Path)


dbc_option = click.option(
    "--dbc", multiple=True, metavar="FILE",
    help="Names and scales of the frames of a CAN log. Repeatable.",
)  # fmt: skip
eds_option = click.option(
    "--eds", multiple=True, metavar="[NODE=]FILE",
    help="EDS or DCF of a node, whose PDOs name the frames of a CAN log. Repeatable.",
)  # fmt: skip


@click.group(
    cls=Verbs,
    epilog="""forceaxis recording import scope.csv --map force=Fz:N,code=dac --out touch
    forceaxis recording info touch.npz
    forceaxis recording export out/axis2.log --out out/axis2""",
)
def recording() -> None:
    """Import recordings of a machine from files of other programs, and read, export, convert and
    replay recorded files.

    A recording of signals (.npz) is imported for `forceaxis compare` and `forceaxis identify
    contact`. A log has LCM messages, and may have further channels. It is an LCM log or an MCAP
    file from `forceaxis monitor --record`, `forceaxis run --record` or lcm-logger. A journal has
    every input of a run of axis_node.
    """


def sources_of(file: Path, separator: str | None, names: Names | None = None) -> list[Source]:
    """Return a reader for each section of a file with recorded data. The file may be of any
    supported kind. `names`: names and scales of the frames of a CAN log.
    """
    from forceaxis.commission import incident

    if incident.is_incident(file):
        return [incident.source_of(incident.load(file), file)]
    return read_sources(file, separator, names)


@recording.command(
    name="import",
    epilog="""forceaxis recording import scope.csv --map force=Fz:N,position=pos:mm --out touch
    forceaxis recording import robot.csv --map force=-F_N --delay force=2ms --out robot
    forceaxis recording import out/incident/incident.json \\
    --map force=force_N,code=dac_code,enabled=enabled --out fault
    forceaxis recording import bus.log --dbc bus.dbc --map force=Press.Force --out bus""",
)
@click.argument("file", type=readable)
@click.option(
    "--map", "maps", multiple=True, required=True, metavar="SIGNAL=[-]COLUMN[:UNIT],...",
    help="Signals to import. COLUMN is a name in FILE or the number of a column from 1; - changes "
    "the sign. UNIT is a unit, or the size of a count such as 0.5um; N-250 subtracts 250 N from "
    "the column. Default: the unit in FILE. Repeatable.",
)  # fmt: skip
@click.option("--time", metavar="COLUMN[:UNIT]", help="Column of the times. Default: by its name.")
@click.option("--rate", type=float, help="Rate of the samples in Hz, for a FILE without times.")
@click.option(
    "--delay", "delays", multiple=True, metavar="SIGNAL=TIME",
    help="Time by which a filter or a bus makes a signal late, such as force=2ms. Repeatable.",
)  # fmt: skip
@click.option(
    "--zero", "zeros", multiple=True, metavar="SIGNAL=FROM:TO",
    help="Stretch of time in s in which a signal is 0, such as force=0:0.2. Its median there is "
    "subtracted. Repeatable.",
)  # fmt: skip
@click.option(
    "--section", type=int, help="Number of the only recording to import from FILE. Default: all."
)
@click.option(
    "--without-spikes", is_flag=True,
    help="Leave out samples that leave a signal and come back at once, which are named anyway.",
)  # fmt: skip
@click.option("--separator", help="Character between the columns of CSV. Default: found.")
@dbc_option
@eds_option
@click.option("--title", default="", help="Title of the recording. Default: the name of FILE.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    help="File of the recording, NAME or NAME.npz.",
)
@as_json
def import_(
    file: Path,
    maps: tuple[str, ...],
    time: str | None,
    rate: float | None,
    delays: tuple[str, ...],
    zeros: tuple[str, ...],
    section: int | None,
    without_spikes: bool,
    separator: str | None,
    dbc: tuple[str, ...],
    eds: tuple[str, ...],
    title: str,
    out: Path,
    as_json: bool,
) -> None:
    """Import the signals of a recording from FILE: text tables of any dialect (CSV, also of
    oscilloscopes, TwinCAT Scope, LabVIEW and STM Studio), xlsx, NPZ, Parquet, TDMS, MDF, MCAP with
    JSON or ROS 2, logs of STM32CubeMonitor or of a CAN bus (candump, asc, blf, trc), an LCM log, a
    recording of the axis' own recorder, or an incident. `forceaxis recording info FILE` lists its
    columns.

    SIGNAL is a name of small letters. These names have a meaning for other commands: force,
    position, speed, current, torque, code (DAC code of the firmware), enabled, voltage_command,
    speed_command, force_command, force_setpoint, position_setpoint. The result has SI units and
    keeps source, unit, sign, rate and delay of each signal. The command reports gaps, spikes,
    jumps, saturation and constant stretches, and the lines of FILE that are no rows. If FILE has
    several recordings, they become NAME_1.npz, NAME_2.npz and so on. One line names those that
    another import of a file of the same name has left.
    """
    pairs, stretches = (
        dict(text.partition("=")[::2] for text in texts) for texts in (delays, zeros)
    )
    texts = [text for given in maps for text in maps_of(given)]
    request = ImportRequest(texts, time, rate, pairs, title, stretches, section, without_spikes)
    found = import_sources(sources_of(file, separator, Names(dbc, eds)), file, request)
    name, facts = signal_recording.with_suffix(out), list[JsonObject]()
    written = [name.with_stem(f"{name.stem}_{k}") for k in range(1, len(found) + 1)]
    written = written if len(found) > 1 else [name]
    command = click.get_current_context().command
    all_done = [
        replace(imported, notes=tuple(options_in(command, n) for n in imported.notes))
        for imported in found
    ]
    for done, one in zip(all_done, written, strict=True):
        signal_recording.write(done.recording, one)
        facts.append({**summary(done.recording), "notes": list(done.notes), "file": str(one)})
    # All files are written before a reader of the output, such as `head`, can end the command.
    if section is None and (others := other_recordings(name, file.name, written)):
        click.echo(
            f"forceaxis: {', '.join(map(paths.display, others))}: of another import of a file "
            f"{file.name}, kept; remove what you no longer need",
            err=True,
        )
    for done, one in zip(all_done, written, strict=True) if not as_json else ():
        print_result(done.recording, False, functools.partial(text_of, done), one)
    if as_json:
        print_json(facts[0] if len(facts) == 1 else {"recordings": facts})


def other_recordings(name: Path, source: str, written: list[Path]) -> list[Path]:
    """Return the recordings NAME.npz and NAME_1.npz, NAME_2.npz and so on that are of a file with
    the name `source`, but not of this import. Nothing shows whether it was this file."""
    numbered = itertools.takewhile(
        Path.exists, (name.with_stem(f"{name.stem}_{k}") for k in itertools.count(1))
    )
    return [
        path
        for path in (name, *numbered)
        if path not in written and signal_recording.source_file(path) == source
    ]


@recording.command(
    epilog="""forceaxis recording info touch.npz
    forceaxis recording info out/axis2.log
    forceaxis recording info bus.asc --dbc bus.dbc"""
)
@click.argument("file", type=readable)
@dbc_option
@eds_option
@as_json
def info(file: Path, dbc: tuple[str, ...], eds: tuple[str, ...], as_json: bool) -> None:
    """Show what a recorded file contains.

    For a file of another program: its columns or channels with their units, and where their times
    come from, as `forceaxis recording import` sees them.

    For a recording of signals: where they come from, and their gaps, spikes, jumps, saturation
    and constant stretches. For a log of LCM messages: the time span, and for each channel the type
    of the messages, their number, their rate per second and the number of lost messages. A log that
    is damaged or incomplete is read as far as possible. One line names what was skipped.
    """
    if signal_recording.is_recording(file):
        found = signal_recording.read(file)
        if as_json:
            print_json(summary(found))
        else:
            print_result(found, False, lambda: text_of(Imported(found, ())))
        return
    from forceaxis.bus import recordings
    from forceaxis.cli.buses_text import log_text
    from forceaxis.recordings import reading

    if reading.is_foreign(file):
        contents = [SourceContent.of(one) for one in sources_of(file, None, Names(dbc, eds))]
        if as_json:
            print_json({"sources": [to_json(one) for one in contents]})
        else:
            click.echo("\n\n".join(one.text for one in contents))
        return
    log = recordings.info(file)
    print_result(log, as_json, lambda: log_text(log))
    report_damage(log.damage)


@dataclass(frozen=True)
class SourceColumnContent:
    """A column of a file of another program."""

    number: int  #: number from 1, by which the column can be chosen
    name: str
    unit: str  #: unit that the file states, or ""
    times: str  #: column or key of the file with its times, or ""


@dataclass(frozen=True)
class SourceContent:
    """What a file of another program, or one of its sections, contains."""

    where: str
    kind: str
    notes: tuple[str, ...]
    columns: tuple[SourceColumnContent, ...]

    @classmethod
    def of(cls, source: Source) -> "SourceContent":
        """Return the content of a source."""
        common = source.time_place()

        def times(place: int) -> str:
            head = source.heads[place]
            time = head.time if head.time is not None else None if head.grid else common
            if time is not None and time != place:
                return source.heads[time].name
            return head.grid.text if head.grid is not None and time is None else ""

        columns = tuple(
            SourceColumnContent(place + 1, head.name, head.unit or "", times(place))
            for place, head in enumerate(source.heads)
        )
        return cls(source.where, source.kind, tuple(source.notes), columns)

    @property
    def text(self) -> str:
        """The content as text."""
        head = ("#", "column", "unit", "times")
        rows = [head, *((str(c.number), c.name, c.unit, c.times) for c in self.columns)]
        lines = [f"source       {self.where}, {self.kind}", *aligned(rows, (1, 2, 3))]
        return "\n".join([*lines, *(f"note         {note}" for note in self.notes)])


def report_damage(damage: str | None) -> None:
    """If a log is damaged, print on standard error which part of the log was skipped."""
    if damage:
        click.echo(f"forceaxis: {damage}", err=True)


def summary(found: SignalRecording) -> JsonObject:
    """Return the header of a recording, and the number and range of the samples of each signal."""
    signals: list[JsonObject] = [
        {
            **to_json(signal.header),
            "samples": len(signal.values),
            "from_s": float(signal.time_s[0]),
            "to_s": float(signal.time_s[-1]),
            "min": float(signal.values.min()),
            "max": float(signal.values.max()),
        }
        for signal in found
    ]
    return {"title": found.title, "source": to_json(found.source), "signals": signals}


def text_of(done: Imported) -> str:
    """Return a table of the imported signals, and one text line for each gap, jump or other
    irregularity that was found in a signal."""
    found = done.recording
    head = ("signal", "unit", "samples", "rate Hz", "from s", "to s", "min", "max", "delay s", "of")
    rows = [head, *(_row(signal) for signal in found)]
    lines = [
        f"recording    {found.title}",
        f"source       {found.source.file}, {found.source.kind}"
        + (
            f"; 0 s is {found.source.origin_s:.0f} s of the source" if found.source.origin_s else ""
        ),
        *aligned(rows, (0, 1, 9)),
    ]
    lines += [f"note         {note}" for note in done.notes]
    for signal in found:
        lines += findings_of(signal)
    if rest := found.source.not_imported:
        few = ", ".join(rest[:8]) + (f" and {len(rest) - 8} more" if len(rest) > 8 else "")
        lines.append(f"not imported {few}")
    return "\n".join(lines)


def _row(signal: RecordedSignal) -> tuple[str, ...]:
    sign = "-" if signal.sign < 0 else ""
    return (
        signal.name,
        signal.unit,
        str(len(signal.values)),
        f"{signal.rate_hz:.6g}",
        f"{signal.time_s[0]:.6g}",
        f"{signal.time_s[-1]:.6g}",
        f"{signal.values.min():.5g}",
        f"{signal.values.max():.5g}",
        f"{signal.delay_s:g}",
        f"{sign}{signal.column}, {signal.source_unit}"
        + (f", {signal.offset:+.6g} {signal.unit}" if signal.offset else ""),
    )


def findings_of(signal: RecordedSignal) -> list[str]:
    """Return one text line for each gap, jump or other irregularity in a signal. If there are too
    many, the last text line states how many are not shown."""
    lines, left = [], dict[str, int]()
    for finding in signal.findings:
        count = left[finding.kind] = left.get(finding.kind, 0) + 1
        if count <= SHOWN_FINDINGS:
            lines.append(
                f"{finding.kind:12} {signal.name}, {finding.from_s:.6g} to {finding.to_s:.6g} s: "
                f"{finding.text}"
            )
    more = {kind: count - SHOWN_FINDINGS for kind, count in left.items() if count > SHOWN_FINDINGS}
    return lines + [
        f"{kind:12} {signal.name}: {counted(count, 'more finding')}" for kind, count in more.items()
    ]


VERBS = (recording,)
