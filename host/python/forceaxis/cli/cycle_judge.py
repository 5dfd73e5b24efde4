"""`forceaxis cycle judge`: evaluate parts from recorded curves of any press."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import _core, paths
from forceaxis._core import InputError
from forceaxis.cli.common import (
    File,
    Folder,
    Slow,
    Subject,
    as_json,
    options_in,
    print_json,
    show,
)
from forceaxis.cli.cycle import cycle, drift_options, program_option, rate
from forceaxis.errors import ParameterError
from forceaxis.results import to_json
from forceaxis.words import counted

if TYPE_CHECKING:
    from forceaxis.cycles.judge import Counts
    from forceaxis.recordings.importing import Imported


def size(name: str, text: str | None, unit: str) -> float | None:
    """Convert the text of an option, such as "1um" or "5mN", to a number in the SI unit `unit`.
    Raises ParameterError if the text is no quantity above 0 with such a unit.
    """
    if text is None:
        return None
    value = _core.quantity_in(text, unit)
    if value is None or not 1e-15 < value < 1e9:
        example = "1um" if unit == "m" else "5mN"
        raise ParameterError(
            name, f"{text}: expected a quantity above 0 with a unit of {unit}, such as {example}"
        )
    return value


def range_of(name: str, text: str | None, unit: str) -> tuple[float, float] | None:
    """Return the ends of the range LOW..HIGH of a sensor in the SI unit `unit`. Raises
    ParameterError."""
    if text is None:
        return None
    low, high = (_core.quantity_in(part, unit) for part in (text.partition("..")[::2]))
    if low is None or high is None or not low < high:
        raise ParameterError(
            name, f"{text}: expected LOW..HIGH with the unit of both, such as 0{unit}..5{unit}"
        )
    return low, high


def counts_of(travel: str | None, force: str | None, contact: str | None) -> Counts | None:
    """Return the sizes of one count of travel and one count of force that the user has given by
    options. Return None if the user has given none of these options.
    """
    from forceaxis.cycles.judge import Counts

    travel_m, force_N = size("travel_count", travel, "m"), size("force_count", force, "N")
    contact_N = size("contact_force", contact, "N")
    if travel_m is None and force_N is None and contact_N is None:
        return None
    if travel_m is None or force_N is None:
        raise ParameterError(
            "travel_count" if travel_m is None else "force_count",
            "expected the size of a count of travel and of a count of force; give both",
        )
    return Counts(travel_m, force_N, contact_N)


def read_curves(
    file: Path, maps: tuple[str, ...], time: str | None, rate_hz: float | None
) -> list[Imported]:
    """Return the recordings in a file. With `maps`, the file is one of another program, which is
    imported as `recording import` does it, a recording for each section. Raises InputError."""
    from forceaxis.cli.recording import sources_of
    from forceaxis.recordings import signal_recording
    from forceaxis.recordings.importing import Imported, ImportRequest, import_sources, maps_of

    if not maps or signal_recording.is_recording(file):
        return [Imported(signal_recording.read(file), ())]
    texts = [text for given in maps for text in maps_of(given)]
    found = import_sources(sources_of(file, None), file, ImportRequest(texts, time, rate_hz))
    command = click.get_current_context().command
    return [
        replace(one, notes=tuple(options_in(command, note) for note in one.notes)) for one in found
    ]


@cycle.command(
    cls=Slow,
    epilog="""forceaxis cycle judge press_fit part.npz
    # the cycle program without an experiment, for the curves of another press, all of one stroke
    forceaxis cycle judge bush.toml curves/*.csv --map force=Fz:N,position=s:mm \\
    --travel-count 1um --force-count 5mN --phase press
    # bounds from good parts, and wear over a series
    forceaxis cycle judge press_fit good/*.npz --propose 1% -o new.toml
    forceaxis cycle judge press_fit day/*.npz --false-alarms 0.1% --out records""",
)
@click.argument("press", metavar="PROGRAM", type=Subject(paths.EXPERIMENTS, as_path=True))
@click.argument(
    "curves", nargs=-1, required=True, metavar="CURVE...",
    type=click.Path(dir_okay=False, path_type=Path),
)  # fmt: skip
@program_option
@click.option(
    "--travel-count", metavar="SIZE", help="Size of a count of travel, without an experiment."
)
@click.option(
    "--force-count", metavar="SIZE",
    help="Size of a count of force, without an experiment. The range has 131,071 counts.",
)  # fmt: skip
@click.option(
    "--contact-force", metavar="FORCE",
    help="Force above which the tool is in contact, without an experiment.",
)  # fmt: skip
@click.option(
    "--force-range", metavar="LOW..HIGH",
    help="Range of the force sensor. Default: what the recording names as saturated, and a force "
    "that is cut off at an end of the curve.",
)  # fmt: skip
@click.option(
    "--travel-range", metavar="LOW..HIGH", help="Range of the position sensor, in the same way."
)
@click.option(
    "--phase", metavar="NAME", help="Phase of all samples, of curves without a signal phase."
)
@click.option(
    "--map", "maps", multiple=True, metavar="SIGNAL=[-]COLUMN[:UNIT],...",
    help="CURVE is a file of another program: its columns, as for `recording import`. Repeatable.",
)  # fmt: skip
@click.option("--time", metavar="COLUMN[:UNIT]", help="With --map: column of the times.")
@click.option("--rate", "rate_hz", type=float, help="With --map: rate of the samples in Hz.")
@drift_options(default="1%")
@click.option(
    "--propose", metavar="RATE", callback=rate,
    help="All curves are good parts: propose bounds that refuse this share of them. Needs -o.",
)  # fmt: skip
@click.option(
    "--write", "-o", type=File(), help="File for the program with the bounds of --propose."
)
@click.option(
    "--out", type=Folder(),
    help="Folder for the records: parts/*.json and parts.csv, as for `cycle statistics`.",
)  # fmt: skip
@as_json
def judge(
    press: Path,
    curves: tuple[Path, ...],
    program: Path | None,
    travel_count: str | None,
    force_count: str | None,
    contact_force: str | None,
    force_range: str | None,
    travel_range: str | None,
    phase: str | None,
    maps: tuple[str, ...],
    time: str | None,
    rate_hz: float | None,
    false_alarms: float,
    reference: int,
    propose: float | None,
    write: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Evaluate recorded curves of force over travel, of any press, by the evaluation elements of a
    cycle program. Each curve is converted to counts, and the code of the firmware computes the
    verdict.

    PROGRAM is an experiment, whose axis defines the sizes of the counts, or the file of a cycle
    program, which needs --travel-count and --force-count. CURVE is the recording of a part, with
    the signals force and position, positive towards the workpiece and sampled at a constant rate: a
    file of `recording import`, or any file with --map. Each section of a file is a part, and so is
    each pass through the phases that a recording names. Give the curves in the order in which the
    parts were pressed.

    The phases are those of the signals cycle_phase and cycle_state (objects of the firmware, of
    each tick) or of the signal phase (a number from 0 for each sample; negative: no phase), else
    the one of --phase, else the conditions and limits of the program decide.

    An element is invalid if a sample in one of its phases is missing, in a spike, saturated or
    beyond the range of force, and the part is then bad. Each element of a series is tested for wear
    and drift, by a CUSUM of sequential ranks. The stated share of false alarms is an upper bound
    for the whole series, for any distribution of the values. The exit status is 0 for every
    verdict.
    """
    from forceaxis.cli import judge_text
    from forceaxis.cycles import capability, drift, judge, records
    from forceaxis.cycles.curve_samples import Ranges
    from forceaxis.cycles.program import with_program

    if (propose is None) != (write is None):
        raise InputError(
            "--propose: expected both --propose RATE and -o FILE, or neither of these options; "
            "add the missing option"
        )
    drift.check(false_alarms, reference)
    counts = counts_of(travel_count, force_count, contact_force)
    if counts is not None and program is not None:
        raise ParameterError(
            "program", f"expected no second program beside the sizes of counts; give {program} as "
            "PROGRAM",
        )  # fmt: skip
    ranges = Ranges(
        range_of("force_range", force_range, "N"), range_of("travel_range", travel_range, "m")
    )
    known = judge.JudgePress(press, counts, tuple(with_program((), program)), ranges)
    files = ((paths.display(file), read_curves(file, maps, time, rate_hz)) for file in curves)
    judged = judge.judge_all(known, files, phase)
    proposal = None
    if propose is not None and write is not None:
        proposal = judge.teach(known, judged, propose, write)
    parts = records.RecordedParts(counted(len(curves), "curve"), judged.records)
    found = capability.statistics(parts)
    series = drift.drift(drift.series_of(judged.records), false_alarms, reference)
    if out is not None:
        with records.RecordFolder(out) as folder:
            for record in judged.records:
                folder.add(record)
    if as_json:
        print_json(
            {
                **to_json(judged),
                "statistics": to_json(found),
                "drift": to_json(series),
                "proposal": None if proposal is None else to_json(proposal),
            }
        )
        return
    show(judge_text.rows(judged, found, series, proposal))
    if out is not None:
        show([("files", paths.quoted(out))])
