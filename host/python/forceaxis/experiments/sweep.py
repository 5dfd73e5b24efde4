"""Runs one experiment at many points. The points are a grid, random points, or the points of a
bisection to a stability boundary.

Each finished run is a line of FOLDER/journal.jsonl (see runner.py). A run with a line in the
journal is not repeated. Runs are executed on threads of this process or, in groups, on a Dask
cluster.
"""

import csv
import json
import math
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
from forceaxis.experiments import isolated
from forceaxis.experiments.inputs import Inputs, read_inputs
from forceaxis.experiments.points import (
    GridValues,
    Point,
    SweepParameter,
    check_names,
    grid_axes,
    grid_points,
    parse,
    posterior_points,
    random_axes,
    random_points,
    unit_of,
)
from forceaxis.experiments.run_result import Columns
from forceaxis.experiments.runner import Runner, RunSite, identity_of, runner_at
from forceaxis.experiments.sweep_result import (
    METRICS,
    Boundary,
    FailedPoint,
    IsolatedPoint,
    PointOutcome,
    Row,
    Sweep,
    SweepCounts,
    SweepPlan,
    SweepResult,
    bounces,
)
from forceaxis.experiments.verdicts import VERDICTS, stability
from forceaxis.words import counted, option_words

FILES = ("results.csv", "results.npz", "results.parquet", "plot.png", "plot.svg", "sweep.json")
SHOWN_FAILURES = 10


@dataclass(frozen=True)
class SweepRequest:
    """An experiment, and the parameters that a sweep changes."""

    experiment: str | Path
    # {name: "FROM:TO:COUNT", "FROM:TO:COUNT:log", "VALUE,VALUE,..." or a list of values} of a grid
    grid: Mapping[str, GridValues] = field(default_factory=dict)
    # {name: "FROM:TO" or "FROM:TO:log"} of random points
    random: Mapping[str, str] = field(default_factory=dict)
    count: int | None = None  # number of random points
    seed: int = 0  # seed of the random points
    # {name: "FROM:TO:TOLERANCE"} of a bisection
    bisect: Mapping[str, str] = field(default_factory=dict)
    overrides: Sequence[str] = ()  # texts NAME=VALUE that apply to all points of the sweep
    # file of a posterior from which `count` points are drawn instead of `random`
    over: str | None = None
    refine: bool = False  # True to run also the points around each isolated point

    def command(self, out: Path | None, scheduler: str | None) -> str:
        """Returns the command line that repeats the sweep. `out`: folder of the sweep. `scheduler`:
        address of a Dask scheduler."""
        grid = [
            f"{name}={v if isinstance(v, str) else ','.join(repr(float(x)) for x in v)}"
            for name, v in self.grid.items()
        ]
        words = option_words(
            grid=grid,
            random=[f"{name}={text}" for name, text in self.random.items()],
            bisect=[f"{name}={text}" for name, text in self.bisect.items()],
            over=self.over,
            count=self.count if self.random or self.over else None,
            seed=self.seed if self.random or self.over else None,
            set=list(self.overrides),
            out=None if out is None else paths.display(out),
            refine=self.refine,
            scheduler=scheduler,
        )
        return shlex.join(["forceaxis", "sweep", paths.display(self.experiment), *words])


def plan(request: SweepRequest) -> SweepPlan:
    """Returns the points of a request. Raises ParameterError."""
    if request.grid and request.random:
        raise ParameterError("random", "expected either `grid` or `random`, got both")
    if request.over and (request.grid or request.random):
        raise ParameterError("over", "expected either a posterior or `grid` or `random`, got both")
    if request.over:
        axes, points = posterior_points(request.over, request.count, request.seed)
    elif request.random:
        axes = random_axes(request.random)
        points = random_points(axes, request.count, request.seed)
    else:
        axes = grid_axes(request.grid)
        points = grid_points(axes)
    searches = [
        parse("bisect", name, text, ("TOLERANCE",), False) for name, text in request.bisect.items()
    ]
    if len(searches) > 1:
        raise ParameterError(
            "bisect", "expected exactly one parameter to bisect; use `grid` for further parameters"
        )
    if not axes and not searches:
        raise ParameterError(
            "grid",
            "expected at least one parameter to vary, in `grid`, `random`, `over` or `bisect`",
        )
    drawn = request.random or request.over
    if request.refine and (searches or drawn or len(axes) > 2):
        raise ParameterError(
            "refine", "expected a `grid` of one or two parameters, without `bisect`"
        )
    return SweepPlan(axes, points, searches[0] if searches else None)


def checked_inputs(request: SweepRequest, planned: SweepPlan) -> Inputs:
    """Returns the inputs of the experiment. Raises InputError if a sweep cannot change one of the
    planned parameters."""
    experiment, overrides = Path(request.experiment), list(request.overrides)
    inputs = read_inputs(experiment, overrides)
    check_names(experiment, inputs, overrides, planned.swept)
    if inputs.not_evaluable:
        raise InputError(inputs.not_evaluable)
    if planned.search and inputs.criterion is None:
        raise InputError(
            f"{experiment}: verdict: expected a table [verdict], because `bisect` searches for "
            "the parameter value at which the verdict changes; add this table"
        )
    return inputs


def sweep(
    request: SweepRequest,
    out: Path | None = None,
    threads: int | None = None,
    scheduler: str | None = None,
) -> Sweep:
    """Runs the experiment at every point, and writes the results to the folder `out` unless `out`
    is None.

    threads: number of threads, by default one for each core. scheduler: address of a Dask
    scheduler. Its workers then run the points instead of threads. Raises ParameterError or
    InputError for an error in the request. A run that fails gives a row with the error.
    """
    planned = plan(request)
    inputs = checked_inputs(request, planned)
    experiment, overrides = Path(request.experiment), list(request.overrides)
    identity = identity_of(experiment, overrides)
    threads = threads or os.cpu_count() or 1
    axes, search = planned.axes, planned.search
    rows = [planned.row(point) for point in planned.points]
    outcomes: list[PointOutcome] = []
    found: list[Boundary] = []
    closer: dict[Point, PointOutcome] = {}
    single: list[int] = []  # indices of isolated points of the grid
    started = time.monotonic()
    site = RunSite(out, threads, scheduler)
    with runner_at(site, experiment, overrides, identity, PointOutcome, outcome_of) as runner:
        if search:
            found = boundaries(runner, rows, search)
        else:
            outcomes = runner(rows)
        if not (search or request.random or request.over):
            single = isolated.find(axes, [stability(outcome.verdict) for outcome in outcomes])
        if request.refine and single:
            near = [p for i in single for p in isolated.around(axes, planned.points[i])]
            points = list(dict.fromkeys(near))
            closer = dict(zip(points, runner([planned.row(p) for p in points]), strict=True))
    seconds = time.monotonic() - started

    errors = [point.error for point in (found if search else outcomes)]
    failures = [FailedPoint(i, rows[i], error) for i, error in enumerate(errors) if error]
    result = SweepResult(
        experiment=paths.display(experiment),
        title=inputs.title,
        parameters={a.name: unit_of(a.name, inputs) for a in planned.swept},
        counts=SweepCounts(
            points=len(rows),
            runs=runner.asked,
            resumed=runner.asked - runner.ran,
            failed=len(failures),
            **(
                {"boundaries": sum(math.isfinite(one.stable) for one in found)}
                if search
                else {v: sum(outcome.verdict == v for outcome in outcomes) for v in VERDICTS}
            ),
        ),
        failures=failures[:SHOWN_FAILURES],
        warnings=warnings(outcomes),
        refined=request.refine,
        alone=[isolated_point(planned, i, outcomes[i].verdict, closer) for i in single],
        seed=request.seed if request.random or request.over else None,
        bounces=bounces(outcomes) if request.over and not search else None,
        **identity,
        objects_hash=objects.OBJECTS_HASH,
        where=scheduler or counted(threads, "thread"),
        seconds=round(seconds, 3),
        command=request.command(out, scheduler),
    )
    fixed = all(a.name.startswith(("firmware.", "verdict.")) for a in planned.swept)
    done = Sweep(
        result,
        planned,
        outcomes,
        found,
        search_runs=[(v, o) for (v,), o in runner.seen] if search and not axes else [],
        converters=inputs.converters if fixed else {},
        closer=closer,
    )
    if out is not None:
        write(done, out)
    return done


def isolated_point(
    planned: SweepPlan, index: int, verdict: str, closer: Mapping[Point, PointOutcome]
) -> IsolatedPoint:
    """Returns the isolated point with the index `index`. `closer`: outcomes of the points around
    isolated points. It is empty if these points were not run."""
    point = planned.points[index]
    if not closer:
        return IsolatedPoint(planned.row(point), verdict)
    near = [closer[p].verdict for p in isolated.around(planned.axes, point)]
    alike = sum(stability(v) == stability(verdict) for v in near)
    return IsolatedPoint(planned.row(point), verdict, len(near), alike)


def warnings(outcomes: Sequence[PointOutcome]) -> list[str]:
    """Returns warnings about points whose force set-point is outside the range of ADC 0."""
    beyond = [i for i, outcome in enumerate(outcomes) if outcome.setpoint_beyond_N is not None]
    if not beyond:
        return []
    force_N = outcomes[beyond[0]].setpoint_beyond_N
    return [
        f"{len(beyond)} of {counted(len(outcomes), 'point')}: expected a set-point within the "
        f"force reading, got {force_N:.4g} N at the first, index {beyond[0]}; they are never stable"
    ]


def write(done: Sweep, out: Path) -> None:
    """Writes FILES to the folder `out`. If points around isolated points were run, also writes
    closer.csv. Writes either all of these files or none."""
    import pyarrow
    import pyarrow.parquet

    from forceaxis import drawing
    from forceaxis.experiments import sweep_plots

    drawn = sweep_plots.sweep(done)
    if not done.closer:
        (out / "closer.csv").unlink(missing_ok=True)  # closer.csv of an earlier sweep
    names = [*FILES, "closer.csv"] if done.closer else FILES
    with paths.replacing(out, *names) as (table, npz, parquet, png, svg, summary, *closer):
        write_table(table, done.columns)
        for file in closer:
            write_table(file, done.closer_columns)
        with npz.open("wb") as stream:
            np.savez_compressed(stream, **done.columns)  # type: ignore[arg-type]
        pyarrow.parquet.write_table(pyarrow.table(done.columns), parquet)
        drawing.save(drawn, png, "png")
        drawing.save(drawn, svg, "svg")
        summary.write_text(json.dumps(done.summary, indent=2) + "\n")


def write_table(file: Path, columns: Columns) -> None:
    """Writes columns as CSV. A nan becomes an empty field."""
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*(c.tolist() for c in columns.values()), strict=True):
            writer.writerow(["" if v != v else v for v in row])


def outcome_of(result: "_core.RunOutcome") -> PointOutcome:
    """Returns the outcome of a point from a result of _core.run_many."""
    if "error" in result:
        return PointOutcome(error=result["error"])
    metrics, margin = result["metrics"], result["edge_margin"]
    return PointOutcome(
        verdict=result["verdict"],
        fault=result["fault"],
        **{name: getattr(metrics, name) for name in METRICS},
        edge_margin=margin if math.isfinite(margin) else None,
        trace_hash=result["trace_hash"],
    )


def boundaries(
    runner: Runner[PointOutcome], rows: Sequence[Row], search: SweepParameter
) -> list[Boundary]:
    """Returns the stability boundary for each row of values. The boundary is a value of the
    parameter `search`. The function halves the range of this parameter until its tolerance is
    reached."""
    found = [Boundary(row) for row in rows]

    def verdicts(wanted: Sequence[tuple[Boundary, float]]) -> list[str | None]:
        """Returns the verdict at each wanted value, or None for a failed run."""
        outcomes = runner([one.row | {search.name: value} for one, value in wanted])
        for (one, value), outcome in zip(wanted, outcomes, strict=True):
            one.runs += 1
            if outcome.error:
                one.error = f"at {search.name} = {value:g}: {outcome.error}"
        return [None if outcome.error else outcome.verdict for outcome in outcomes]

    ends = verdicts([(one, value) for one in found for value in (search.low, search.high)])
    for one, low, high in zip(found, ends[::2], ends[1::2], strict=True):
        one.begin(search, low, high)
    while active := [one for one in found if one.is_open(search.tolerance)]:
        middles = verdicts([(one, one.middle) for one in active])
        for one, verdict in zip(active, middles, strict=True):
            one.halve(verdict)
    return found
