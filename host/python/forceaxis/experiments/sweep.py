"""Runs one experiment at many points: a grid, random points, or a bisection to a stability
boundary.

Each finished run is a line of FOLDER/journal.jsonl. The key of the line is a hash of the
parameters, the input files, the firmware and the simulator. A run with a line in the journal is not
repeated. Points run on threads of this process or, in groups, on a Dask cluster; the order and the
place of the runs have no effect on a result.
"""

import contextlib
import csv
import fcntl
import hashlib
import json
import math
import os
import re
import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO, Any, NoReturn, Protocol, Self, TypeAlias

import numpy as np

from forceaxis import _core, objects, paths, progress
from forceaxis._core import InputError, SimulationError
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
    random_axes,
    random_points,
    unit_of,
)
from forceaxis.experiments.run_result import Columns
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
)
from forceaxis.experiments.verdicts import VERDICTS, stability
from forceaxis.results import to_json
from forceaxis.words import counted, option_words

FILES = ("results.csv", "results.npz", "results.parquet", "plot.png", "plot.svg", "sweep.json")
SHOWN_FAILURES = 10

Identity: TypeAlias = dict[str, str]  # name of a hash -> the hash
Jobs: TypeAlias = Sequence[list[str]]  # the overrides of each run
JournalLine: TypeAlias = dict[str, Any]  # a JSON object of the journal
# function that receives (number of a job, result of _core.run_many)
Finished: TypeAlias = Callable[[int, "_core.RunOutcome"], None]
# function that receives (number of finished jobs, number of all jobs)
Progressed: TypeAlias = Callable[[int, int], None]


@dataclass(frozen=True)
class SweepRequest:
    """An experiment, and the parameters that a sweep changes."""

    experiment: str | Path
    # {name: "FROM:TO:COUNT", "FROM:TO:COUNT:log", "VALUE,VALUE,..." or a list of values}
    grid: Mapping[str, GridValues] = field(default_factory=dict)
    # {name: "FROM:TO" or "FROM:TO:log"}
    random: Mapping[str, str] = field(default_factory=dict)
    count: int | None = None  # number of random points
    seed: int = 0  # of the random points
    bisect: Mapping[str, str] = field(default_factory=dict)  # name -> "FROM:TO:TOLERANCE"
    overrides: Sequence[str] = ()  # texts NAME=VALUE that apply to all points of the sweep
    refine: bool = False  # True if the points around each isolated point are run too

    def command(self, out: Path | None, scheduler: str | None) -> str:
        """Returns the command line that repeats the sweep. `out` is the folder of the sweep,
        `scheduler` is the address of a Dask scheduler."""
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


def plan(request: SweepRequest) -> SweepPlan:
    """Returns the points of a request. Raises ParameterError."""
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
        raise ParameterError(
            "bisect", "expected exactly one parameter to bisect; use `grid` for further parameters"
        )
    if not axes and not searches:
        raise ParameterError(
            "grid", "expected at least one parameter to vary, in `grid`, `random` or `bisect`"
        )
    if request.refine and (searches or request.random or len(axes) > 2):
        raise ParameterError(
            "refine", "expected a `grid` of one or two parameters, without `bisect`"
        )
    return SweepPlan(axes, points, searches[0] if searches else None)


def checked_inputs(request: SweepRequest, planned: SweepPlan) -> Inputs:
    """Returns the inputs of the experiment. Raises InputError if a planned parameter cannot be
    changed."""
    experiment, overrides = Path(request.experiment), list(request.overrides)
    inputs = read_inputs(experiment, overrides)
    check_names(experiment, inputs, overrides, planned.swept)
    if inputs.not_evaluable:
        raise InputError(inputs.not_evaluable)
    if planned.search and inputs.criterion is None:
        raise InputError(
            f"{experiment}: verdict: expected a table [verdict], because `bisect` searches for a "
            "change of the verdict; add the table"
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

    threads: number of threads, by default one for each core. scheduler: address of a Dask scheduler
    whose workers run the points instead of threads. Raises ParameterError or InputError for an
    error in the request. A run that fails gives a row with the error.
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
    single: list[int] = []  # indices of isolated points
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
        if search:
            found = boundaries(runner, rows, search)
        else:
            outcomes = runner(rows)
        if not (search or request.random):
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
    """Returns the isolated point with this index. `closer` are the outcomes of the points around
    isolated points, or empty if these points were not run."""
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
    """Writes FILES to the folder `out`, and closer.csv if points around isolated points were run.
    Writes either all of these files or none."""
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


def identity_of(experiment: str | Path, overrides: Sequence[str]) -> Identity:
    """Returns hashes of the common inputs of all points: experiment, model, firmware and
    simulator."""
    return {
        "inputs_hash": read_inputs(experiment, overrides).inputs_hash,
        "firmware_hash": _core.FIRMWARE_HASH,
        "simulator_hash": _core.SIMULATOR_HASH,
    }


@dataclass(frozen=True)
class JournalEntry:
    """One entry of the journal: the run of one point. `outcome` contains either `error` alone or
    all fields of a PointOutcome except `error`."""

    key: str
    parameters: Row
    outcome: dict[str, str | float | None]


class Journal:
    """File with the results of finished runs, one JSON object per text line. The program only
    appends text lines.

    The first line identifies the inputs. Incomplete lines of a killed process are ignored. A file
    that is not a journal of these inputs is not changed. Without a path nothing is written.
    """

    def __init__(self, path: Path | None, identity: Identity) -> None:
        self.known: dict[str, PointOutcome] = {}
        self.file: IO[bytes] | None = None
        if path is None:
            return
        self.file = path.open("a+b")
        try:
            self._read(path, self.file, identity)
        except BaseException:
            self.file.close()
            raise

    def _read(self, path: Path, file: IO[bytes], identity: Identity) -> None:
        """Reads the runs of a journal with this identity, or writes the first text line of a new
        journal. Raises InputError."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{path}: expected a folder without a running sweep, but another sweep uses this "
                "folder; give another folder"
            ) from None
        file.seek(0)
        data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        lines = [read_line(line) for line in whole.splitlines()]
        # The file is new, or a process was killed while writing the first text line.
        if not lines and self._line(identity).startswith(data):
            file.truncate(0)
            file.write(self._line(identity))
            file.flush()
            return
        if not lines or not set(identity) <= set(lines[0]):
            raise InputError(
                f"{path}: line 1: expected the journal of a sweep, got another file; give another "
                "folder"
            )
        for name in identity:
            if lines[0][name] != identity[name]:
                what = {"inputs_hash": "experiment, model and overrides"}.get(name, name[:-5])
                raise InputError(
                    f"{path}: {name}: expected the {what} of the runs in this folder, "
                    f"{lines[0][name][:12]}, got {identity[name][:12]}; give another folder"
                )
        file.truncate(len(whole))
        for line in lines[1:]:
            if "key" in line and "outcome" in line:
                self.known[line["key"]] = PointOutcome(**line["outcome"])

    @staticmethod
    def _line(entry: Identity | JournalEntry) -> bytes:
        return json.dumps(to_json(entry), allow_nan=False).encode() + b"\n"

    def add(self, key: str, values: Row, outcome: PointOutcome) -> None:
        """Adds a finished run. `values` are the values of the swept parameters."""
        self.known[key] = outcome
        if self.file:
            entry = asdict(outcome)
            error = entry.pop("error")
            self.file.write(
                self._line(JournalEntry(key, values, {"error": error} if error else entry))
            )

    def flush(self) -> None:
        """Writes buffered text lines to the operating system, so that the text lines are kept if
        the process is killed."""
        if self.file:
            self.file.flush()

    def close(self) -> None:
        """Writes buffered text lines, and releases the folder."""
        if self.file:
            self.file.close()


def read_line(line: bytes) -> JournalLine:
    """Returns the JSON object of a text line, or an empty object if the text line contains no JSON
    object."""
    try:
        entry = json.loads(line)
    except ValueError:
        return {}
    return entry if isinstance(entry, dict) else {}


def outcome_of(result: "_core.RunOutcome") -> PointOutcome:
    """Returns the outcome of a point from a result of _core.run_many."""
    if "error" in result:
        return PointOutcome(error=result["error"])
    metrics, margin = result["metrics"], result["edge_margin"]
    return PointOutcome(
        verdict=result["verdict"],
        fault=result["fault"],
        **{name: metrics[name] for name in METRICS},
        edge_margin=margin if math.isfinite(margin) else None,
        trace_hash=result["trace_hash"],
    )


class Place(Protocol):
    """Executes the runs of a sweep, either on threads of this process or on a cluster."""

    def __call__(self, jobs: Jobs, finished: Finished, progressed: Progressed) -> None:
        """Executes the jobs. Calls finished() after each job, and progressed() repeatedly."""


class Runner:
    """Determines the outcomes of points, either from the journal or by runs."""

    def __init__(self, journal: Journal, identity: Identity, place: Place) -> None:
        self.journal = journal
        self.salt = ":".join(identity.values())
        self.place = place
        self.asked = 0  # number of outcomes that the Runner has returned
        self.ran = 0  # number of runs that the journal did not contain
        # (values, outcome) of all points
        self.seen: list[tuple[tuple[float, ...], PointOutcome]] = []

    def key(self, values: Row) -> str:
        """Returns the key of a run in the journal: hash of the inputs and of the values, sorted by
        name."""
        text = "".join([f"\n{name}={values[name]!r}" for name in sorted(values)])
        return hashlib.sha256((self.salt + text).encode()).hexdigest()

    def __call__(self, rows: Sequence[Row]) -> list[PointOutcome]:
        """Returns the outcomes of the rows, in the order of the rows."""
        keys = [self.key(row) for row in rows]
        missing = {k: row for k, row in zip(keys, rows, strict=True) if k not in self.journal.known}
        # The runs are sorted by model, so that the modes of each model are computed once.
        of_model = [name for name in (rows[0] if rows else ()) if "." not in name]
        todo = sorted(missing.items(), key=lambda item: [item[1][name] for name in of_model])

        def finished(i: int, result: "_core.RunOutcome") -> None:
            key, values = todo[i]
            self.journal.add(key, values, outcome_of(result))

        def progressed(done: int, total: int) -> None:
            self.journal.flush()
            progress.shown = f"{done}/{total} runs"

        if todo:
            jobs = [[f"{n}={v!r}" for n, v in values.items()] for _, values in todo]
            try:
                self.place(jobs, finished, progressed)
            finally:
                progress.shown = ""
        outcomes = [self.journal.known[k] for k in keys]
        self.asked += len(rows)
        self.ran += len(todo)
        self.seen += [(tuple(r.values()), o) for r, o in zip(rows, outcomes, strict=True)]
        return outcomes


class Here:
    """Executes runs on threads of this process."""

    def __init__(self, experiment: str | Path, overrides: list[str], threads: int) -> None:
        self.experiment = str(experiment)
        self.overrides = overrides
        self.threads = threads
        self.experiments = _core.Experiments()

    def __call__(self, jobs: Jobs, finished: Finished, progressed: Progressed) -> None:
        every = [(self.experiment, self.overrides + sets) for sets in jobs]
        _core.run_many(every, self.threads, progressed, True, finished, self.experiments)


class Cluster:
    """Executes runs on the workers of a Dask scheduler. The workers read the files of the
    experiment by the same paths as this process. The runs of a lost worker are repeated on a
    different worker.
    """

    def __init__(
        self, address: str, experiment: Path, overrides: list[str], identity: Identity
    ) -> None:
        try:
            import distributed
        except ImportError:
            raise ParameterError(
                "scheduler",
                "expected the package distributed; install distributed with `pip install "
                "'forceaxis[cluster]'`",
            ) from None

        def fail(error: str | Exception) -> NoReturn:
            raise ParameterError(
                "scheduler",
                f"{address}: expected the address tcp://HOST:PORT of a running Dask scheduler; "
                f"{error}",
            ) from None

        if not re.fullmatch(r"(tcp|tls|ws|wss)://.+:\d+", address):
            fail("start one with `dask scheduler`")
        self.distributed = distributed
        self.address = address
        self.work = (str(experiment.resolve()), overrides, identity)
        try:
            self.client = distributed.Client(address, timeout=10, set_as_default=False)
        except (OSError, ValueError) as error:
            fail(error)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.client.close()

    def __call__(self, jobs: Jobs, finished: Finished, progressed: Progressed) -> None:
        cores = sum(self.client.nthreads().values())
        if cores == 0:
            raise ParameterError(
                "scheduler",
                f"{self.address}: expected a Dask scheduler with at least one worker, got "
                "none; start workers with `dask worker`",
            )
        size = max(1, min(64, len(jobs) // (4 * cores)))
        futures = {
            self.client.submit(run_chunk, *self.work, jobs[i : i + size], pure=False): i
            for i in range(0, len(jobs), size)
        }
        done = 0
        try:
            for future in self.distributed.as_completed(futures, loop=self.client.loop):
                start = futures[future]
                for i, result in enumerate(future.result()):
                    finished(start + i, result)
                    done += 1
                progressed(done, len(jobs))
        except WorkerDiffers as error:
            raise ParameterError("scheduler", f"{self.address}: {error}") from None
        except (InputError, KeyboardInterrupt):
            raise
        except Exception as error:
            raise SimulationError(
                f"{self.address}: expected a result for each group of points, got: {error}; "
                "repeat the command, which runs only the missing points"
            ) from error
        finally:
            self.client.cancel(list(futures))


class WorkerDiffers(Exception):
    """Error: a worker has a different version of forceaxis, or different files, than this
    process."""


def run_chunk(
    experiment: str, overrides: list[str], identity: Identity, jobs: Jobs
) -> "list[_core.RunOutcome]":
    """Executes jobs on a worker, and returns the results. Raises WorkerDiffers if the worker has
    different inputs than the process that has started the sweep."""
    import socket

    where = f"worker on {socket.gethostname()}"
    try:
        mine = identity_of(experiment, overrides)
    except InputError as error:
        raise WorkerDiffers(f"{where}: {error}") from None
    for name, value in mine.items():
        if value != identity[name]:
            raise WorkerDiffers(
                f"{where}: {name}: expected {identity[name][:12]}, got {value[:12]}; give the "
                "workers the same files and the same forceaxis"
            )
    return list(_core.run_many([(experiment, overrides + sets) for sets in jobs], 1, None, True))


def boundaries(runner: Runner, rows: Sequence[Row], search: SweepParameter) -> list[Boundary]:
    """Returns the stability boundary along the parameter of `search` for each row of values. The
    function halves the range of `search` until the tolerance of `search` is reached."""
    found = [Boundary(row) for row in rows]

    def verdicts(wanted: Sequence[tuple[Boundary, float]]) -> list[str | None]:
        """Returns the verdict at each value, with None for a failed run."""
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
