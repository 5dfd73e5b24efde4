"""The trace of a run as files: CSV, NPZ, a figure, and the run's summary beside them."""

import contextlib
import csv
import json
import os

import numpy as np

from forceaxis import _core, objects, paths, toml
from forceaxis.experiments import summary

FILES = ("trace.csv", "trace.npz", "events.csv", "plot.png", "plot.svg", "result.json")


def figure(done, codes=False):
    """Figure of a run's rows over its [plot] from_s .. to_s, within the run; position, force
    reading and command where the experiment names no rows. Objects that a link did not trace are
    omitted. codes: what the converters gave, not what it stands for."""
    from forceaxis.drawing import GOT, VERDICT
    from forceaxis.experiments import plots

    time_s = done.columns["time_s"]
    start, stop = done.plot.get("from_s", time_s[0]), done.plot.get("to_s", time_s[-1])
    inside = (time_s >= start) & (time_s <= stop)
    if not inside.any():  # an override made the run shorter than the plot
        inside[:] = True
    rows = [
        [line(done, name, inside, codes) for name in names if name in done.columns]
        for names in done.plot.get("rows", [["encoder"], ["adc0"], ["dac"]])
    ]
    notes = [(f"with {', '.join(done.overrides)}", GOT)] if done.overrides else []
    marks = marks_of(done)
    if verdict := done.summary["verdict"]:
        text, judged = summary.verdict_text(done.summary), marks.window
        if not time_s[inside][0] < judged[1] or not judged[0] < time_s[inside][-1]:
            text += f", {judged[0]:.4g} to {judged[1]:.4g} s, not in this plot"
        notes.append((text, VERDICT[verdict]))
    return plots.trace(time_s[inside], [row for row in rows if row], done.title, notes, marks)


def line(done, name, inside, codes):
    """The plots.Line of a column, where `inside` is true."""
    from forceaxis.experiments import plots

    values = done.columns[name][inside]
    converters = done.summary["converters"]
    converter = converters.get(name)
    signal = converters.get("adc0", {}).get("signal", "")
    held = name == "adc0" or name.partition(".")[::2] == (signal.partition(".")[0], "force")
    if name in done.units:
        known = objects.BY_NAME[name]
        names = dict(enumerate(known.enum)) or dict(known.values)
        unit, factor = objects.unit_in_words(known), 1
        if not codes:
            unit, factor = physical(unit, converters)
        return plots.Line(name, unit, values * factor, names)
    if codes or not converter:
        unit, factor = plots.unit_of(name)
        return plots.Line(name, unit, values * factor, controlled=held and unit == "N")
    unit, factor = ("mm", 1e3) if converter["unit"] == "m" else (converter["unit"], 1)
    shown = (values.astype(float) - converter["zero"]) * (converter["per_code"] * factor)
    what = {"encoder": "position", "dac": "command"}.get(name, "force" if unit == "N" else "")
    label = f"{what or converter['signal']} ({name})"
    return plots.Line(label, unit, shown, controlled=held and unit == "N")


def physical(unit, converters):
    """(unit, factor) of an object of counts or codes, as far as the model has its converter."""
    kind, _, per = unit.partition("/")
    if kind == "encoder count" and per in ("", "s") and "encoder" in converters:
        return f"mm/{per}".rstrip("/"), converters["encoder"]["per_code"] * 1e3
    if unit == "count of force" and "adc0" in converters:
        reading = converters["adc0"]
        return reading["unit"], abs(reading["per_code"]) * 2 ** (reading["bits"] - 8)
    if unit == "DAC code" and "dac" in converters:
        return "V", converters["dac"]["per_code"]
    return unit, 1


def marks_of(done):
    """Set-points, contact, judged window and events of a run, as plots.Marks."""
    from forceaxis.experiments import plots

    time_s, columns = done.columns["time_s"], done.columns
    forces = [columns[f"{name}.force"] for name in done.contacts]
    touching = np.any([f > 0 for f in forces], axis=0) if forces else np.zeros(len(time_s), bool)
    turns = np.flatnonzero(np.diff(touching, prepend=False, append=False))
    ends = np.append(time_s, time_s[-1])[turns].reshape(-1, 2)
    events = []
    for at, element, before, after in done.events:
        if element in done.contacts and "pressed" in (before, after):
            kind = "touch" if after == "pressed" else "lost"
            events.append((at, kind, {"touch": "touch", "lost": "contact lost"}[kind]))
    events += [(at, "impulse", f"impulse {size:g} N s") for at, _, size in done.impulses]
    faulty = np.flatnonzero(columns["fault"])
    if len(faulty):
        name = objects.BY_NAME["fault"].enum[columns["fault"][faulty[0]]]
        events.append((time_s[faulty[0]], "fault", f"fault {name}"))
    window = None
    if criterion := done.summary["criterion"]:
        last = time_s[-1]
        window = (max(0.0, last - criterion["window_s"]), last, done.summary["verdict"])
    contacts = ends.tolist()
    return plots.Marks(done.setpoints, contacts, window, events, demand_of(done, contacts))


def demand_of(done, contacts):
    """(times, N) of what was demanded in mode of operation 4, whose demand follows the set-points
    by force_slope: as traced, else by the slope from the first contact on. None where it steps,
    where the slope changes, or where the run is not of a file."""
    from forceaxis.experiments import plots

    try:
        given = _core.inputs(str(done.experiment), list(done.overrides))["firmware"]
    except _core.InputError:
        return None
    if given.get("modes_of_operation") != PROFILE_FORCE:
        return None
    known = {n: given.get(n, objects.default(n)) for n in ("force_slope", "rated_force")}
    rated = known["rated_force"]  # mN
    if "force_demand" in done.units:
        return done.columns["time_s"], done.columns["force_demand"] * rated * 1e-6
    later = toml.read(done.experiment).get("at", [])
    if any("force_slope" in entry.get("firmware", {}) for entry in later):
        return None
    slope = known["force_slope"] * rated * 1e-6
    return plots.ramps(done.setpoints, slope, contacts, done.columns["time_s"][-1])


PROFILE_FORCE = 4


def write(done, out, codes=False):
    """Write FILES into folder `out`, all or none of them."""
    with (
        paths.replacing(out, *FILES) as (trace_csv, trace_npz, events_csv, png, svg, result),
        beside(write_tables, done, trace_csv, trace_npz, events_csv),
    ):
        from forceaxis import drawing

        drawn = figure(done, codes)
        drawing.save(drawn, png, "png")
        drawing.save(drawn, svg, "svg")
        result.write_text(json.dumps(done.summary, indent=2) + "\n")


def write_tables(done, trace_csv, trace_npz, events_csv):
    """The trace as CSV and NPZ, the events as CSV."""
    columns = [[repr(value) for value in column.tolist()] for column in done.columns.values()]
    with trace_csv.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(done.columns)
        file.writelines(f"{','.join(row)}\n" for row in zip(*columns, strict=True))
    with trace_npz.open("wb") as packed:
        np.savez_compressed(packed, **done.columns)
    with events_csv.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time_s", "element", "from", "to"])
        writer.writerows(done.events)


@contextlib.contextmanager
def beside(work, *arguments):
    """Do `work` in a child process while the context lasts; what it wrote is there at its end.
    Raises OSError where the child could not write."""
    child = os.fork()
    if child == 0:
        status = 255
        try:
            work(*arguments)
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
