"""The trace of a run as files: CSV, NPZ, a figure, and the run's summary beside them."""

import csv
import json

import numpy as np

from forceaxis import objects


def figure(done):
    """Figure of a run's rows over its [plot] from_s .. to_s, within the run; position and force
    where the experiment names no rows. Objects that a link did not trace are left out."""
    from forceaxis.experiments import plots

    time_s = done.columns["time_s"]
    start, stop = done.plot.get("from_s", time_s[0]), done.plot.get("to_s", time_s[-1])
    shown = (time_s >= start) & (time_s <= stop)
    if not shown.any():  # an override made the run shorter than the plot
        shown[:] = True
    rows = [
        {name: done.columns[name][shown] for name in names if name in done.columns}
        for names in done.plot.get("rows", [["encoder"], ["adc0"], ["dac"]])
    ]
    held = done.summary["metrics"]["held_force"]
    return plots.trace(
        time_s[shown],
        [row for row in rows if row],
        done.title,
        units=done.units,
        names={name: value_names(name) for name in done.units},
        setpoint_N=held and held["setpoint_N"],
    )


def value_names(name):
    """The names of an object's values: those of an enum, or of single values."""
    known = objects.BY_NAME[name]
    return dict(enumerate(known.enum)) or dict(known.values)


def write(done, out):
    """Write trace.csv, trace.npz, events.csv, plot.png and result.json into folder `out`."""
    out.mkdir(parents=True, exist_ok=True)
    names = list(done.columns)
    np.savez_compressed(out / "trace.npz", **done.columns)
    with (out / "trace.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(zip(*(done.columns[n].tolist() for n in names), strict=True))
    with (out / "events.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time_s", "element", "from", "to"])
        writer.writerows(done.events)
    figure(done).savefig(out / "plot.png", dpi=120)
    (out / "result.json").write_text(json.dumps(done.summary, indent=2) + "\n")
