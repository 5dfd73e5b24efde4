"""Run one experiment at many points: a grid, random points, or bisection to a stability boundary.

Each finished run is a line of FOLDER/journal.jsonl; its key is a hash of its parameters, the input
files, firmware and simulator. A run with a line in the journal is not repeated. Points run on
threads of this process or, in groups, on a Dask cluster; order and place have no effect on a
result.
"""

import contextlib
import csv
import json
import os
import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from forceaxis import _core, objects, paths
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.experiments import alone
from forceaxis.experiments.points import (
    GridValues,
    Point,
    SweepParameter,
    check_names,
    grid_axes,
    grid_points,
    parse,
    random_axes,
    random_points,
    unit_of,
)
from forceaxis.experiments.run_result import Columns, read_converters
from forceaxis.experiments.sweep_result import (
    FailedPoint,
    LonePoint,
    Sweep,
    SweepCounts,
    SweepResult,
)
from forceaxis.experiments.sweep_runs import (
    Cluster,
    Here,
    Journal,
    Row,
    Runner,
    boundaries,
    identity_of,
    run_columns,
)
from forceaxis.experiments.verdicts import VERDICTS, stability
from forceaxis.words import counted, option_words

FILES = ("results.csv", "results.npz", "results.parquet", "plot.png", "plot.svg", "sweep.json")
SHOWN_FAILURES = 10


@dataclass(frozen=True)
class SweepRequest:
    """The specification of a sweep. sweep() raises ParameterError or InputError for an error in
    it."""

    experiment: str | Path
    grid: Mapping[str, GridValues] = field(default_factory=dict)
    random: Mapping[str, str] = field(default_factory=dict)  # name -> "FROM:TO[:log]"
    count: int | None = None  # of random points
    seed: int = 0  # of the random points
    bisect: Mapping[str, str] = field(default_factory=dict)  # name -> "FROM:TO:TOLERANCE"
    overrides: Sequence[str] = ()
    refine: bool = False  # also runs the points around each isolated point, see alone.find()

    def command(self, out: Path | None, scheduler: str | None) -> str:
        """The command line that repeats the sweep."""
        grid = [
            f"{name}={v if isinstance(v, str) else ','.join(repr(float(x)) for x in v)}"
            for name, v in self.grid.items()
        ]
        words = option_words(
            grid=grid,
            random=[f"{name}={text}" for name, text in self.random.items()],
            bisect=[f"{name}={text}" for name, text in self.bisect.items()],
            count=self.count if self.random else None,
            seed=self.seed if self.random else None,
            set=list(self.overrides),
            out=None if out is None else paths.display(out),
            refine=self.refine,
            scheduler=scheduler,
        )
        return shlex.join(["forceaxis", "sweep", paths.display(self.experiment), *words])


@dataclass(frozen=True)
class SweepPlan:
    """The points of a request: `axes`, a value of each for every point, and the searched
    parameter."""

    axes: list[SweepParameter]
    points: list[Point]
    search: SweepParameter | None

    @property
    def swept(self) -> list[SweepParameter]:
        """Every parameter that changes between runs."""
        return [*self.axes, *([self.search] if self.search else [])]

    @property
    def names(self) -> list[str]:
        """The names of the axes."""
        return [axis.name for axis in self.axes]

    def rows(self, points: Sequence[Point]) -> list[Row]:
        """Points as {name: value}."""
        return [dict(zip(self.names, point, strict=True)) for point in points]


def plan(request: SweepRequest) -> SweepPlan:
    """The points of a request. Raises ParameterError."""
    if request.grid and request.random:
        raise ParameterError("random", "expected either `grid` or `random`, got both")
    if request.random:
        axes = random_axes(request.random)
        points = random_points(axes, request.count, request.seed)
    else:
        axes = grid_axes(request.grid)
        points = grid_points(axes)
    searches = [
        parse("bisect", name, text, ("TOLERANCE",), False) for name, text in request.bisect.items()
    ]
    if len(searches) > 1:
        raise ParameterError("bisect", "expected one parameter; use `grid` for the others")
    if not axes and not searches:
        raise ParameterError("grid", "expected what to vary: `grid`, `random` or `bisect`")
    if request.refine and (searches or request.random or len(axes) > 2):
        raise ParameterError(
            "refine", "expected a `grid` of one or two parameters, without `bisect`"
        )
    return SweepPlan(axes, points, searches[0] if searches else None)


def checked_inputs(request: SweepRequest, planned: SweepPlan) -> "_core.Inputs":
    """The inputs of the experiment. Raises InputError if the planned parameters cannot be swept."""
    experiment, overrides = Path(request.experiment), list(request.overrides)
    inputs = _core.inputs(str(experiment), overrides)
    check_names(experiment, inputs, overrides, planned.swept)
    if inputs["unjudged"]:
        raise InputError(inputs["unjudged"])
    if planned.search and inputs["criterion"] is None:
        raise InputError(f"{experiment}: verdict: expected a [verdict] to bisect by; add one")
    return inputs


def sweep(
    request: SweepRequest,
    out: Path | None = None,
    threads: int | None = None,
    scheduler: str | None = None,
) -> Sweep:
    """Runs the experiment at every point and writes the results to folder `out`, if given.

    scheduler: address of a Dask scheduler whose workers run the points. Raises InputError for an
    error in the request; a run that fails gives a row with its error.
    """
    planned = plan(request)
    inputs = checked_inputs(request, planned)
    experiment, overrides = Path(request.experiment), list(request.overrides)
    identity = identity_of(experiment, overrides)
    threads = threads or os.cpu_count() or 1
    axes, search, rows = planned.axes, planned.search, planned.rows(planned.points)
    single, closer = [], {}
    started = time.monotonic()
    with contextlib.ExitStack() as stack:
        place = (
            stack.enter_context(Cluster(scheduler, experiment, overrides, identity))
            if scheduler
            else Here(experiment, overrides, threads)
        )
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
        journal = Journal(None if out is None else out / "journal.jsonl", identity)
        stack.callback(journal.close)
        runner = Runner(journal, identity, place)
        found = boundaries(runner, rows, search) if search else run_columns(runner(rows))
        if not (search or request.random):
            single = alone.find(axes, stabilities(found))
        if request.refine and single:
            near = [p for i in single for p in alone.around(axes, planned.points[i])]
            near_rows = planned.rows(list(dict.fromkeys(near)))
            closer = columns_of(planned.names, near_rows) | run_columns(runner(near_rows))
    seconds = time.monotonic() - started

    columns = {"index": np.arange(len(rows))} | columns_of(planned.names, rows) | found
    failed = [i for i, error in enumerate(columns["error"]) if error]
    result = SweepResult(
        experiment=paths.display(experiment),
        title=inputs["title"],
        parameters={a.name: unit_of(a.name, inputs) for a in planned.swept},
        counts=counts_of(columns, runner, search, len(failed)),
        failures=[
            FailedPoint(i, rows[i], str(columns["error"][i])) for i in failed[:SHOWN_FAILURES]
        ],
        warnings=warnings(columns),
        refined=request.refine,
        alone=[lone_point(rows[i], str(columns["verdict"][i]), axes, closer) for i in single],
        seed=request.seed if request.random else None,
        **identity,
        objects_hash=objects.OBJECTS_HASH,
        where=scheduler or counted(threads, "thread"),
        seconds=round(seconds, 3),
        command=request.command(out, scheduler),
    )
    fixed = all(a.name.startswith(("firmware.", "verdict.")) for a in planned.swept)
    done = Sweep(
        result,
        columns,
        axes,
        search,
        runs=[(v, o) for (v,), o in runner.seen] if search and not axes else [],
        converters=read_converters(inputs["converters"]) if fixed else {},
        closer=closer,
    )
    if out is not None:
        write(done, out)
    return done


def columns_of(names: Sequence[str], rows: Sequence[Row]) -> Columns:
    """The parameters of some points as columns."""
    return {name: np.array([row[name] for row in rows], dtype=float) for name in names}


def stabilities(columns: Columns) -> list[str]:
    """For each point "stable", "unstable" or "": the values that are compared to find isolated
    points."""
    return [stability(str(verdict)) for verdict in columns["verdict"]]


def lone_point(
    row: Row, verdict: str, axes: Sequence[SweepParameter], closer: Columns
) -> LonePoint:
    """An isolated point. closer: the points around it, {} if they were not run."""
    if not closer:
        return LonePoint(row, verdict)
    near = alone.around(axes, [row[a.name] for a in axes])
    points = list(zip(*(closer[a.name].tolist() for a in axes), strict=True))
    verdicts = [closer["verdict"][points.index(p)] for p in near]
    alike = sum(stability(v) == stability(verdict) for v in verdicts)
    return LonePoint(row, verdict, len(near), int(alike))


def warnings(columns: Columns) -> list[str]:
    """A warning about points whose set-point is outside the range of ADC 0."""
    beyond = np.flatnonzero(np.isfinite(columns.get("setpoint_beyond_N", np.array([]))))
    if not len(beyond):
        return []
    first, N = int(beyond[0]), columns["setpoint_beyond_N"][beyond[0]]
    points = counted(len(columns["index"]), "point")
    return [
        f"{len(beyond)} of {points}: expected a set-point within the force "
        f"reading, got {N:.4g} N at the first, index {first}; they are never stable"
    ]


def counts_of(
    columns: Columns, runner: Runner, search: SweepParameter | None, failed: int
) -> SweepCounts:
    """The numbers of points and runs, and of their results."""
    if search:
        results = {"boundaries": int(np.isfinite(columns["boundary"]).sum())}
    else:
        results = {v: int((columns["verdict"] == v).sum()) for v in VERDICTS}
    resumed = runner.asked - runner.ran
    return SweepCounts(len(columns["index"]), runner.asked, resumed, failed, **results)


def write(done: Sweep, out: Path) -> None:
    """Writes FILES, and closer.csv if points around isolated points were run: all files or none."""
    import pyarrow
    import pyarrow.parquet

    from forceaxis import drawing
    from forceaxis.experiments import sweep_plots

    drawn = sweep_plots.sweep(done)
    if not done.closer:
        (out / "closer.csv").unlink(missing_ok=True)  # of an earlier sweep
    names = [*FILES, "closer.csv"] if done.closer else FILES
    with paths.replacing(out, *names) as (table, npz, parquet, png, svg, summary, *closer):
        write_table(table, done.columns)
        for file in closer:
            write_table(file, done.closer)
        with npz.open("wb") as stream:
            np.savez_compressed(stream, **done.columns)  # type: ignore[arg-type]
        pyarrow.parquet.write_table(pyarrow.table(done.columns), parquet)
        drawing.save(drawn, png, "png")
        drawing.save(drawn, svg, "svg")
        summary.write_text(json.dumps(done.summary, indent=2) + "\n")


def write_table(file: Path, columns: Columns) -> None:
    """Writes columns as CSV; NaN becomes an empty field."""
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*(c.tolist() for c in columns.values()), strict=True):
            writer.writerow(["" if v != v else v for v in row])
