"""Writes the files of a run: trace (CSV, NPZ), events, plot and result. Also draws the plot of a
run."""

import contextlib
import csv
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec

import numpy as np

from forceaxis import _core, objects, paths, toml
from forceaxis.experiments import summary, verdicts
from forceaxis.experiments.inputs import read_inputs
from forceaxis.experiments.run import Run
from forceaxis.experiments.run_result import Array, Converters

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from forceaxis.experiments import plots

P = ParamSpec("P")
FILES = ("trace.csv", "trace.npz", "events.csv", "plot.png", "plot.svg", "result.json")
WHAT_OF_COLUMN = {"encoder": "position", "dac": "command"}
PROFILE_FORCE = 4  # mode of operation "profile force"


def figure(done: Run, codes: bool = False) -> "Figure":
    """Returns the plot of a run. The table [plot] defines the rows and the time range.

    Without this table, the plot shows position, measured force and output voltage of the whole run.
    Objects are omitted if a run over a connection does not trace them. `codes`: True to show codes
    instead of N, mm and V.
    """
    from forceaxis.drawing import GOT, VERDICT
    from forceaxis.experiments import plots

    time_s, inside = done.time_s, done.in_plot
    rows = [
        [line(done, name, inside, codes) for name in names if name in done.columns]
        for names in done.plot.rows
    ]
    notes = [(f"with {', '.join(done.overrides)}", GOT)] if done.overrides else []
    marks = marks_of(done)
    if marks.window:
        text, (begin, end, verdict) = summary.verdict_text(done.result), marks.window
        if not time_s[inside][0] < end or not begin < time_s[inside][-1]:
            text += f", {begin:.4g} to {end:.4g} s, not in this plot"
        held = done.result.metrics.held_force
        if verdict == verdicts.NOT_HELD and held:
            text += f"; {summary.force_text(held)}"
        notes.append((text, VERDICT[verdict]))
    return plots.trace(time_s[inside], [row for row in rows if row], done.title, notes, marks)


def line(done: Run, name: str, inside: Array, codes: bool) -> "plots.Line":
    """Returns the column `name` as a signal of a plot, for the ticks at which `inside` is True.
    `codes`: True to show codes instead of N, mm and V."""
    from forceaxis.experiments import plots

    values = done.columns[name][inside]
    converters, reading = done.result.converters, done.result.force_reading
    sensor = reading.signal.partition(".")[0] if reading else ""
    controlled = name == "adc0" or name.partition(".")[::2] == (sensor, "force")
    if name in done.units:
        known = objects.BY_NAME[name]
        names = dict(enumerate(known.enum)) or dict(known.values)
        unit, factor = objects.unit_in_words(known), 1.0
        if not codes:
            unit, factor = physical(unit, converters)
        return plots.Line(name, unit, values * factor, names)
    converter = converters.get(name)
    if codes or not converter:
        unit, factor = plots.unit_of(name)
        return plots.Line(name, unit, values * factor, controlled=controlled and unit == "N")
    unit, factor = ("mm", 1e3) if converter.unit == "m" else (converter.unit, 1.0)
    shown = (values.astype(float) - converter.zero) * (converter.per_code * factor)
    what = WHAT_OF_COLUMN.get(name, "force" if unit == "N" else converter.signal)
    return plots.Line(f"{what} ({name})", unit, shown, controlled=controlled and unit == "N")


def physical(unit: str, converters: Converters) -> tuple[str, float]:
    """Returns (physical unit, factor) for an object in counts or codes. Returns (unit, 1) if the
    model has no converter for these counts or codes."""
    kind, _, per = unit.partition("/")
    encoder, reading, dac = (converters.get(name) for name in ("encoder", "adc0", "dac"))
    if encoder and kind == "encoder count" and per in ("", "s"):
        return f"mm/{per}".rstrip("/"), encoder.per_code * 1e3
    if reading and unit == "count of force":
        return reading.unit, reading.per_8_bit_count
    if dac and unit == "DAC code":
        return "V", dac.per_12_bit_code
    return unit, 1.0


def marks_of(done: Run) -> "plots.Marks":
    """Returns what a plot of a run marks: set-points, times of contact, window of the verdict, and
    events."""
    from forceaxis.experiments import plots

    time_s, columns = done.time_s, done.columns
    forces = [columns[f"{name}.force"] for name in done.contacts]
    touching = np.any([f > 0 for f in forces], axis=0) if forces else np.zeros(len(time_s), bool)
    turns = np.flatnonzero(np.diff(touching, prepend=False, append=False))
    ends = np.append(time_s, time_s[-1])[turns].reshape(-1, 2)
    events: list[tuple[float, str, str]] = []
    for at, element, before, after in done.events:
        if element in done.contacts and "pressed" in (before, after):
            kind = "touch" if after == "pressed" else "lost"
            events.append((at, kind, {"touch": "touch", "lost": "contact lost"}[kind]))
    events += [(at, "impulse", f"impulse {size:g} N s") for at, _, size in done.impulses]
    faulty = np.flatnonzero(columns["fault"])
    if len(faulty):
        events.append((time_s[faulty[0]], "fault", f"fault {done.result.fault}"))
    window = None
    if (criterion := done.result.criterion) and done.result.verdict:
        last = time_s[-1]
        window = (max(0.0, last - criterion.window_s), last, done.result.mark)
    contacts: list[tuple[float, float]] = [(a, b) for a, b in ends.tolist()]
    return plots.Marks(done.setpoints, contacts, window, events, demand_of(done, contacts))


def demand_of(
    done: Run, contacts: list[tuple[float, float]]
) -> "tuple[plots.Values, plots.Values] | None":
    """Returns (times in s, forces in N) of the force demand in mode of operation 4. In this mode,
    the demand follows the set-points with the slope `force_slope`.

    The demand is read from the trace. If the trace has no demand, it is computed from the first
    contact on.

    Returns None in another mode, if the slope changes during the run, or if the run has no file.
    """
    from forceaxis.experiments import plots

    try:
        given = read_inputs(done.experiment, done.overrides).firmware
    except _core.InputError:
        return None
    if given.get("modes_of_operation") != PROFILE_FORCE:
        return None
    slope, rated_mN = (given.get(n, objects.default(n)) for n in ("force_slope", "rated_force"))
    if "force_demand" in done.units:
        return done.time_s, done.columns["force_demand"] * rated_mN * 1e-6
    later = toml.read(done.experiment).get("at", [])
    if any("force_slope" in entry.get("firmware", {}) for entry in later):
        return None
    return plots.ramps(done.setpoints, slope * rated_mN * 1e-6, contacts, done.time_s[-1])


def write(done: Run, out: Path, codes: bool = False) -> None:
    """Writes all FILES to the folder `out`, or no file. `codes`: True if the plot shows codes
    instead of N, mm and V. Raises OSError."""
    with (
        paths.replacing(out, *FILES) as (trace_csv, trace_npz, events_csv, png, svg, result),
        beside(write_tables, done, trace_csv, trace_npz, events_csv),
    ):
        from forceaxis import drawing

        drawn = figure(done, codes)
        drawing.save(drawn, png, "png")
        drawing.save(drawn, svg, "svg")
        result.write_text(json.dumps(done.summary, indent=2) + "\n")


def write_tables(done: Run, trace_csv: Path, trace_npz: Path, events_csv: Path) -> None:
    """Writes the trace as CSV and NPZ, and the events as CSV. Raises OSError."""
    columns = [[repr(value) for value in column.tolist()] for column in done.columns.values()]
    with trace_csv.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(done.columns)
        file.writelines(f"{','.join(row)}\n" for row in zip(*columns, strict=True))
    with trace_npz.open("wb") as packed:
        np.savez_compressed(packed, **done.columns)  # type: ignore[arg-type]
    with events_csv.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time_s", "element", "from", "to"])
        writer.writerows(done.events)


@contextlib.contextmanager
def beside(work: Callable[P, None], *arguments: P.args, **options: P.kwargs) -> Iterator[None]:
    """Context in which a child process calls work(...). When the context ends, the files of `work`
    are complete. Raises OSError if the child process could not write them."""
    child = os.fork()
    if child == 0:
        status = 255
        try:
            work(*arguments, **options)
            status = 0
        except OSError as error:
            status = min(error.errno or 255, 255)
        finally:
            os._exit(status)
    try:
        yield
    finally:
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status:
        text = os.strerror(status) if 0 < status < 255 else f"a child process ended with {status}"
        raise OSError(max(status, 1), text)
