"""Run one experiment at many points: a grid, random draws, or bisection to a stability boundary.

Every finished run is a line of FOLDER/journal.jsonl, keyed by a hash of its parameters, the input
files, firmware and simulator; a run with an entry there is not repeated. Points run on threads in
this process or, in chunks, on a Dask cluster; neither order nor place changes a result.
"""

import contextlib
import csv
import json
import math
import os
import shlex
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from forceaxis import _core, objects, paths
from forceaxis._core import InputError
from forceaxis.experiments import alone
from forceaxis.experiments.points import (
    Axis,
    check_names,
    grid_axes,
    grid_points,
    parse,
    random_axes,
    random_points,
    unit_of,
)
from forceaxis.experiments.sweep_runs import (
    Cluster,
    Here,
    Journal,
    Runner,
    boundaries,
    identity_of,
    run_columns,
)
from forceaxis.experiments.verdicts import VERDICTS, WORDS, stability
from forceaxis.words import counted

FILES = ("results.csv", "results.npz", "results.parquet", "plot.png", "plot.svg", "sweep.json")


@dataclass
class Sweep:
    """A finished sweep: the summary that `--json` prints, and one row a point as columns.

    Columns: index, the parameters, then of a run: verdict, fault, error, METRICS, edge_margin,
    trace_hash; of a boundary search: boundary (the last stable value), unstable_at (the first
    one beyond it that is not stable), beyond (its verdict), note (why there is none), error, runs.
    NaN and "" stand for nothing.
    """

    summary: dict
    columns: dict
    axes: list  # of the points
    search: Axis | None
    runs: list = field(default_factory=list)  # of a lone boundary search: (value, outcome)
    converters: dict = field(default_factory=dict)  # of the model, {} if the sweep changes it
    closer: dict = field(
        default_factory=dict
    )  # columns of the points around those that stand alone


def sweep(
    experiment,
    grid=None,
    random=None,
    count=None,
    seed=0,
    bisect=None,
    overrides=(),
    out=None,
    threads=None,
    scheduler=None,
    refine=False,
):
    """Run the experiment at every point and write the results into folder `out`, if given.

    grid: {name: values, "VALUE,VALUE,..." or "FROM:TO:COUNT[:log]"}; random: {name:
    "FROM:TO[:log]"} with count and seed; bisect: {name: "FROM:TO:TOLERANCE"}, alone or for every
    point. refine: also half-way to the neighbours of each point of the grid that stands alone, see
    alone.find(). Raises InputError for a mistake in what was asked; a run that fails is a row with
    its error.
    """
    if grid and random:
        raise InputError("--random: expected either --grid or --random, got both")
    if random:
        axes = random_axes(random)
        points = random_points(axes, count, seed)
    else:
        axes = grid_axes(grid or {})
        points = grid_points(axes)
    searches = [parse("--bisect", n, v, ("TOLERANCE",), False) for n, v in (bisect or {}).items()]
    if len(searches) > 1:
        raise InputError("--bisect: expected one parameter; use --grid for the others")
    search = searches[0] if searches else None
    if not axes and not search:
        raise InputError("--grid: expected what to vary: --grid, --random or --bisect")

    if refine and (search or random or len(axes) > 2):
        raise InputError("--refine: expected a --grid of one or two parameters, without --bisect")

    experiment, overrides = Path(experiment), list(overrides)
    inputs = _core.inputs(str(experiment), overrides)
    check_names(experiment, inputs, overrides, [*axes, *searches])
    if inputs["unjudged"]:
        raise InputError(inputs["unjudged"])
    if search and inputs["criterion"] is None:
        raise InputError(f"{experiment}: verdict: expected a [verdict] to bisect by; add one")
    identity = identity_of(experiment, overrides)
    threads = threads or os.cpu_count() or 1
    started = time.monotonic()
    with contextlib.ExitStack() as stack:
        if scheduler:
            place = stack.enter_context(Cluster(scheduler, experiment, overrides, identity))
        else:
            place = Here(experiment, overrides, threads)
        if out is not None:
            Path(out).mkdir(parents=True, exist_ok=True)
        journal = Journal(Path(out) / "journal.jsonl" if out is not None else None, identity)
        stack.callback(journal.close)
        runner = Runner(journal, identity, place)
        names = [a.name for a in axes]
        rows = [dict(zip(names, point, strict=True)) for point in points]
        found = boundaries(runner, rows, search) if search else run_columns(runner(rows))
        single = alone.find(axes, stabilities(found)) if not (search or random) else []
        near = [p for i in single for p in alone.around(axes, points[i])] if refine else []
        near = [dict(zip(names, point, strict=True)) for point in dict.fromkeys(near)]
        closer = columns_of(names, near) | run_columns(runner(near)) if near else {}
    seconds = time.monotonic() - started

    columns = {"index": np.arange(len(rows))} | columns_of(names, rows) | found
    failed = [i for i, e in enumerate(columns["error"]) if e]
    summary = {
        "experiment": paths.display(experiment),
        "title": inputs["title"],
        "parameters": {a.name: unit_of(a.name, inputs) for a in [*axes, *searches]},
        "counts": counts_of(columns, runner, search) | {"failed": len(failed)},
        "failures": [
            {"index": i, **rows[i], "error": str(columns["error"][i])} for i in failed[:10]
        ],
        "warnings": warnings(columns, rows),
        "refined": refine,
        "alone": [alone_row(rows[i], columns["verdict"][i], axes, closer) for i in single],
        "seed": seed if random else None,
        **identity,
        "objects_hash": objects.OBJECTS_HASH,
        "where": scheduler or counted(threads, "thread"),
        "seconds": round(seconds, 3),
        "command": command_of(
            experiment, grid, random, count, seed, bisect, overrides, out, scheduler, refine
        ),
    }
    fixed = all(a.name.startswith(("firmware.", "verdict.")) for a in [*axes, *searches])
    converters = inputs["converters"] if fixed else {}
    done = Sweep(summary, columns, axes, search, converters=converters, closer=closer)
    if search and not axes:
        done.runs = [(v, o) for (v,), o in runner.seen]
    if out is not None:
        write(done, Path(out))
    return done


def columns_of(names, rows):
    """The parameters of some points as columns."""
    return {name: np.array([row[name] for row in rows], dtype=float) for name in names}


def stabilities(columns):
    """Of each point "stable", "unstable" or "": what a point that stands alone differs in."""
    return [stability(str(verdict)) for verdict in columns["verdict"]]


def alone_row(row, verdict, axes, closer):
    """A point that stands alone: its parameters and verdict; where one looked closer also how many
    of the points around it were judged alike."""
    found = row | {"verdict": str(verdict), "around": None, "alike": None}
    if closer:
        near = alone.around(axes, [row[a.name] for a in axes])
        points = list(zip(*(closer[a.name].tolist() for a in axes), strict=True))
        verdicts = [closer["verdict"][points.index(p)] for p in near]
        alike = sum(stability(v) == stability(verdict) for v in verdicts)
        found |= {"around": len(near), "alike": int(alike)}
    return found


def warnings(columns, rows):
    """Points whose set-point ADC 0 cannot read, in one line; [] without any."""
    beyond = np.flatnonzero(np.isfinite(columns.get("setpoint_beyond_N", np.array([]))))
    if not len(beyond):
        return []
    first, N = int(beyond[0]), columns["setpoint_beyond_N"][beyond[0]]
    return [
        f"{len(beyond)} of {counted(len(rows), 'point')}: expected a set-point within the force "
        f"reading, got {N:.4g} N at the first, index {first}; they are never stable"
    ]


def counts_of(columns, runner, search):
    """The numbers of points and runs, and of their outcomes."""
    points = len(columns["index"])
    counts = {"points": points, "runs": runner.asked, "resumed": runner.asked - runner.ran}
    if search:
        counts["boundaries"] = int(np.isfinite(columns["boundary"]).sum())
    else:
        for verdict in VERDICTS:
            counts[verdict] = int((columns["verdict"] == verdict).sum())
    return counts


def command_of(experiment, grid, random, count, seed, bisect, overrides, out, scheduler, refine):
    """The command line of the same sweep."""
    command = ["forceaxis", "sweep", paths.display(experiment)]
    for option, given in (("--grid", grid), ("--random", random), ("--bisect", bisect)):
        for name, value in (given or {}).items():
            text = value if isinstance(value, str) else ",".join(repr(float(v)) for v in value)
            command += [option, f"{name}={text}"]
    if random:
        command += ["--count", str(count), "--seed", str(seed)]
    for text in overrides:
        command += ["--set", text]
    if out is not None:
        command += ["--out", paths.display(out)]
    if refine:
        command.append("--refine")
    if scheduler:
        command += ["--scheduler", scheduler]
    return shlex.join(command)


def describe(done):
    """The summary for a terminal: rows of (key, text)."""
    summary, counts = done.summary, done.summary["counts"]
    ran = counts["runs"] - counts["resumed"]
    speed = f", {ran / summary['seconds']:.0f} a second" if ran and summary["seconds"] else ""
    lines = [
        ("experiment", summary["experiment"]),
        (
            "runs",
            f"{counts['runs']}: {counts['resumed']} from the journal, {ran} now on "
            f"{summary['where']}{speed}",
        ),
    ]
    if done.search:
        lines.append(("boundaries", f"{counts['boundaries']} of {counts['points']}"))
        lines += [("", boundary_line(done, i)) for i in range(min(10, counts["points"]))]
    elif any(counts[verdict] for verdict in VERDICTS):
        shown = [v for v in VERDICTS if counts[v] or v in VERDICTS[:2]]
        lines.append(("verdict", ", ".join(f"{counts[v]} {WORDS[v]}" for v in shown)))
    lines += [("warning", text) for text in summary["warnings"]]
    lines += [("alone", alone_line(one, done)) for one in summary["alone"][:10]]
    if summary["refined"] and not summary["alone"]:
        lines.append(("alone", "no point: nothing to look closer at"))
    if counts["failed"]:
        first = summary["failures"][0]
        lines.append(
            (
                "failed",
                f"{counts['failed']} of {counts['points']}; the first, "
                f"index {first['index']}: {first['error']}",
            )
        )
    lines.append(("again", summary["command"]))
    return lines


def alone_line(one, done):
    """A point that stands alone, in words."""
    at = ", ".join(f"{a.name} = {one[a.name]:g}" for a in done.axes)
    if one["around"]:
        return f"{at}: {one['verdict']}, as are {one['alike']} of {one['around']} points around it"
    return f"{at}: {one['verdict']}, its neighbours are not; --refine looks closer"


def boundary_line(done, i):
    """One boundary in words."""
    at = ", ".join(f"{a.name} = {done.columns[a.name][i]:g}" for a in done.axes)
    stable, unstable = done.columns["boundary"][i], done.columns["unstable_at"][i]
    what = (
        f"{done.search.name}: stable at {stable:.6g}, "
        f"{WORDS[str(done.columns['beyond'][i])]} at {unstable:.6g}"
        if math.isfinite(stable)
        else str(done.columns["note"][i] or done.columns["error"][i])
    )
    return f"{at}: {what}" if at else what


def write(done, out):
    """Write FILES, and closer.csv where one looked closer: all of them or none."""
    import pyarrow
    import pyarrow.parquet

    from forceaxis import drawing
    from forceaxis.experiments import sweep_plots

    drawn = sweep_plots.sweep(done)
    if not done.closer:
        (out / "closer.csv").unlink(missing_ok=True)  # of an earlier --refine
    names = [*FILES, "closer.csv"] if done.closer else FILES
    with paths.replacing(out, *names) as (table, npz, parquet, png, svg, summary, *closer):
        write_table(table, done.columns)
        for file in closer:
            write_table(file, done.closer)
        with npz.open("wb") as stream:
            np.savez_compressed(stream, **done.columns)
        pyarrow.parquet.write_table(pyarrow.table(done.columns), parquet)
        drawing.save(drawn, png, "png")
        drawing.save(drawn, svg, "svg")
        summary.write_text(json.dumps(done.summary, indent=2) + "\n")


def write_table(file, columns):
    """Columns as CSV, nothing for NaN."""
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*(c.tolist() for c in columns.values()), strict=True):
            writer.writerow(["" if v != v else v for v in row])
