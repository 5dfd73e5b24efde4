"""Run one experiment at many points: a grid, random draws, or bisection to a stability boundary.

Every finished run is a line of FOLDER/journal.jsonl, keyed by a hash of its parameters, the input
files, firmware and simulator; what stands there is not run again. Points run on threads in this
process or, in chunks, on a Dask cluster; neither order nor place changes a result.
"""

import contextlib
import csv
import fcntl
import hashlib
import itertools
import json
import math
import os
import re
import shlex
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from forceaxis import _core, objects, paths
from forceaxis._core import InputError, SimulationError

MOST_POINTS = 1_000_000

# Keys of an experiment's tables that are numbers and so can be swept.
KEYS = {
    "experiment": ("duration_s", "seed"),
    "verdict": ("window_s", "force_ripple_max_count", "position_ripple_max_count"),
}
METRICS = (
    "peak_force_N",
    "final_force_N",
    "force_ripple_count",
    "position_ripple_count",
    "contact_losses",
    "in_contact",
    "saturated_ticks",
    "last_adc_change_tick",
)


@dataclass(frozen=True)
class Axis:
    """A swept parameter."""

    name: str
    low: float
    high: float
    log: bool = False
    values: tuple = ()  # of a grid
    tolerance: float = 0.0  # of a bisection

    def at(self, u):
        """The value at u = 0..1 of the range; 12 digits, so that it is what it looks like."""
        if self.log:
            return tidy(self.low * (self.high / self.low) ** u)
        return tidy(self.low + (self.high - self.low) * u)


@dataclass
class Sweep:
    """A finished sweep: the summary that `--json` prints, and one row a point as columns.

    Columns: index, the parameters, then of a run: verdict, fault, error, METRICS, edge_margin,
    trace_hash; of a boundary search: boundary (the last stable value), unstable_at (the first
    unstable one beyond it), note (why there is none), error, runs. NaN and "" stand for nothing.
    """

    summary: dict
    columns: dict
    axes: list  # of the points
    search: Axis | None
    runs: list = field(default_factory=list)  # of a lone boundary search: (value, outcome)


def tidy(value):
    """The value rounded to 12 digits."""
    return float(f"{value:.12g}")


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
):
    """Run the experiment at every point and write the results into folder `out`, if given.

    grid: {name: values, "VALUE,VALUE,..." or "FROM:TO:COUNT[:log]"}; random: {name:
    "FROM:TO[:log]"} with count and seed; bisect: {name: "FROM:TO:TOLERANCE"}, alone or for every
    point. Raises InputError for a mistake in what was asked; a run that fails is a row with its
    error.
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

    experiment, overrides = Path(experiment), list(overrides)
    inputs = _core.inputs(str(experiment), overrides)
    check_names(experiment, inputs, overrides, [*axes, *searches])
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
    seconds = time.monotonic() - started

    columns = {"index": np.arange(len(rows))}
    for name in names:
        columns[name] = np.array([row[name] for row in rows], dtype=float)
    columns |= found

    failed = [i for i, e in enumerate(columns["error"]) if e]
    counts = {"points": len(rows), "runs": runner.asked, "resumed": runner.asked - runner.ran}
    if search:
        counts["boundaries"] = int(np.isfinite(columns["boundary"]).sum())
    else:
        for verdict in ("stable", "unstable"):
            counts[verdict] = int((columns["verdict"] == verdict).sum())
    counts["failed"] = len(failed)
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
    if scheduler:
        command += ["--scheduler", scheduler]
    summary = {
        "experiment": paths.display(experiment),
        "title": inputs["title"],
        "parameters": {a.name: unit_of(a.name, inputs) for a in [*axes, *searches]},
        "counts": counts,
        "failures": [
            {"index": i, **rows[i], "error": str(columns["error"][i])} for i in failed[:10]
        ],
        "seed": seed if random else None,
        **identity,
        "objects_hash": objects.OBJECTS_HASH,
        "where": scheduler or f"{threads} thread{'s' * (threads > 1)}",
        "seconds": round(seconds, 3),
        "command": shlex.join(command),
    }
    done = Sweep(summary, columns, axes, search)
    if search and not axes:
        done.runs = [(v, o) for (v,), o in runner.seen]
    if out is not None:
        write(done, Path(out))
    return done


# --- what is asked -------------------------------------------------------------------------------


def parse(option, name, text, more, may_log):
    """An axis from FROM:TO and the numbers named in `more`, with :log where it may be."""
    shape = ":".join(("FROM", "TO", *more))
    parts = str(text).split(":")
    log = may_log and parts[-1] == "log"
    numbers = parts[:-1] if log else parts

    def fail(message):
        raise InputError(f"{option}: {name}={text}: expected {message}")

    try:
        values = [float(part) for part in numbers]
    except ValueError:
        values = []
    if len(values) != 2 + len(more) or not all(map(math.isfinite, values)):
        fail(f"NAME={shape}" + ("[:log]" if may_log else "") + ", with finite numbers")
    low, high = values[:2]
    if not low < high:
        fail("FROM below TO")
    if log and low <= 0:
        fail("FROM above 0 for :log")
    if "TOLERANCE" in more:
        if not 0 < values[2] < high - low:
            fail("TOLERANCE above 0 and below TO - FROM")
        return Axis(name, low, high, tolerance=values[2])
    if "COUNT" in more:
        if values[2] != int(values[2]) or not 2 <= values[2] <= MOST_POINTS:
            fail("COUNT to be a whole number from 2; --set gives one value")
        axis = Axis(name, low, high, log)
        n = int(values[2])
        return Axis(name, low, high, log, tuple(axis.at(i / (n - 1)) for i in range(n)))
    return Axis(name, low, high, log)


def grid_axes(grid):
    """Axes from {name: text or values}."""
    axes = []
    for name, given in grid.items():
        if isinstance(given, str) and ":" in given:
            axes.append(parse("--grid", name, given, ("COUNT",), True))
            continue
        try:
            values = tuple(
                float(v) for v in (given.split(",") if isinstance(given, str) else given)
            )
        except ValueError:
            values = ()
        if not values or not all(map(math.isfinite, values)):
            raise InputError(
                f"--grid: {name}={given}: expected NAME=FROM:TO:COUNT[:log] or "
                "NAME=VALUE,VALUE,..., with finite numbers"
            )
        axes.append(Axis(name, min(values), max(values), values=values))
    if math.prod(len(a.values) for a in axes) > MOST_POINTS:
        raise InputError(f"--grid: expected at most {MOST_POINTS} points")
    return axes


def grid_points(axes):
    """All combinations, the last axis fastest."""
    return list(itertools.product(*(a.values for a in axes)))


def random_axes(random):
    """Axes from {name: "FROM:TO[:log]"}."""
    return [parse("--random", name, text, (), True) for name, text in random.items()]


def random_points(axes, count, seed):
    """Point i of a parameter depends on seed, name and i alone.

    u = the first 53 bits of SHA-256("SEED:NAME:INDEX") / 2^53.
    """
    if not count or not 1 <= count <= MOST_POINTS:
        raise InputError(f"--count: expected a number of random points, 1 to {MOST_POINTS}")

    def draw(axis, i):
        digest = hashlib.sha256(f"{seed}:{axis.name}:{i}".encode()).digest()
        return axis.at((int.from_bytes(digest[:8], "big") >> 11) / 2**53)

    return [tuple(draw(a, i) for a in axes) for i in range(count)]


def check_names(experiment, inputs, overrides, axes):
    """Refuse what `--set` would refuse by its name alone, and what changes nothing."""
    taken = {text.partition("=")[0] for text in overrides}
    for axis in axes:
        name = axis.name

        def fail(message, name=name):
            raise InputError(f"{experiment}: {name}: expected {message}")

        if name in taken:
            fail("each name once among --grid, --random, --bisect and --set")
        taken.add(name)
        room, dot, key = name.partition(".")
        if not dot:
            if name not in inputs["parameters"]:
                fail("a parameter of the model, firmware.OBJECT, experiment.KEY or verdict.KEY")
            value = inputs["parameters"][name]["value"]
            if name in _core.inputs(str(experiment), [*overrides, f"{name}={value!r}"])["unused"]:
                fail("a parameter that the model uses, this one changes nothing here")
        elif room == "firmware":
            if not any(o.name == key and "w" in o.access for o in objects.OBJECTS):
                fail("a firmware object that can be written; see `forceaxis objects`")
        elif key not in KEYS.get(room, ()):
            known = [f"{r}.{k}" for r, keys in KEYS.items() for k in keys]
            fail(f"a model parameter, firmware.OBJECT or one of {', '.join(known)}")


def unit_of(name, inputs):
    """The unit of a swept parameter, "" for none."""
    room, _, key = name.partition(".")
    if room == "firmware":
        unit = next(o.unit for o in objects.OBJECTS if o.name == key)
    elif key:
        unit = {"s": "s", "t": "count"}.get(key[-1], "") if key != "seed" else ""
    else:
        unit = inputs["parameters"][name]["unit"]
    return "" if unit == "1" else unit


def identity_of(experiment, overrides):
    """Hashes of what a point runs, its own values apart."""
    return {
        "inputs_hash": _core.inputs(str(experiment), list(overrides))["inputs_hash"],
        "firmware_hash": _core.FIRMWARE_HASH,
        "simulator_hash": _core.SIMULATOR_HASH,
    }


# --- running -------------------------------------------------------------------------------------


class Journal:
    """Outcomes of finished runs by key; a file that only grows, one JSON object a line.

    The first line is the identity of what was run. Lines that a kill has torn are dropped.
    """

    def __init__(self, path, identity):
        self.known = {}
        self.file = None
        if path is None:
            return
        self.file = path.open("a+b")
        try:
            self._read(path, identity)
        except BaseException:
            self.file.close()
            raise

    def _read(self, path, identity):
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{path}: expected no other sweep at work in this folder; give another --out"
            ) from None
        self.file.seek(0)
        data = self.file.read()
        whole = data[: data.rfind(b"\n") + 1]
        self.file.truncate(len(whole))
        lines = [read_line(line) for line in whole.splitlines()]
        if not lines:
            self._write(identity)
            self.file.flush()
            return
        if lines[0] is None or not set(identity) <= set(lines[0]):
            raise InputError(
                f"{path}: line 1: expected a journal of forceaxis sweep; give another --out"
            )
        for name in identity:
            if lines[0][name] != identity[name]:
                what = {"inputs_hash": "experiment, model and --set"}.get(name, name[:-5])
                raise InputError(
                    f"{path}: {name}: expected the same {what} as the runs in this folder, "
                    f"{lines[0][name][:12]}, got {identity[name][:12]}; give another --out"
                )
        for line in lines[1:]:
            if line is not None and "key" in line and "outcome" in line:
                self.known[line["key"]] = line["outcome"]

    def _write(self, entry):
        self.file.write(json.dumps(entry, allow_nan=False).encode() + b"\n")

    def add(self, key, values, outcome):
        """Keep one finished run."""
        self.known[key] = outcome
        if self.file:
            self._write({"key": key, "parameters": values, "outcome": outcome})

    def flush(self):
        """Hand what was added to the operating system, where a kill cannot undo it."""
        if self.file:
            self.file.flush()

    def close(self):
        """Flush and let go of the folder."""
        if self.file:
            self.file.close()


def read_line(line):
    """The JSON object of a line, None if it holds none."""
    try:
        entry = json.loads(line)
    except ValueError:
        return None
    return entry if isinstance(entry, dict) else None


def outcome_of(result):
    """What is kept of run_many()'s result: an error, or verdict, metrics and identity."""
    if "error" in result:
        return {"error": result["error"]}
    margin = result["edge_margin"]
    return {
        "verdict": result["verdict"],
        "fault": result["fault"],
        **{name: result["metrics"][name] for name in METRICS},
        "edge_margin": margin if math.isfinite(margin) else None,
        "trace_hash": result["trace_hash"],
    }


def run_columns(outcomes):
    """Outcomes as columns of the results."""
    kinds = {"verdict": str, "fault": str, "error": str}
    kinds |= dict.fromkeys((*METRICS, "edge_margin"), float) | {"trace_hash": str}
    return {
        name: np.array([o.get(name, "" if kind is str else None) for o in outcomes], dtype=kind)
        for name, kind in kinds.items()
    }


class Runner:
    """Gives the outcomes of points, running those that the journal does not know."""

    def __init__(self, journal, identity, place):
        self.journal = journal
        self.salt = ":".join(identity.values())
        self.place = place
        self.asked = 0
        self.ran = 0
        self.seen = []  # (values, outcome) of every point asked for

    def key(self, values):
        """Identity of a run: what is run, and the values in the order of their names."""
        text = "".join([f"\n{name}={values[name]!r}" for name in sorted(values)])
        return hashlib.sha256((self.salt + text).encode()).hexdigest()

    def __call__(self, rows):
        """Outcomes of {name: value} rows, in order."""
        keys = [self.key(row) for row in rows]
        missing = {k: row for k, row in zip(keys, rows, strict=True) if k not in self.journal.known}
        # One model after the other, so that its modes are made once.
        of_model = [name for name in (rows[0] if rows else ()) if "." not in name]
        todo = sorted(missing.items(), key=lambda item: [item[1][name] for name in of_model])

        def finished(i, result):
            key, values = todo[i]
            self.journal.add(key, values, outcome_of(result))

        console = Console(stderr=True)
        if todo:
            with Progress(console=console, disable=not console.is_terminal, transient=True) as bar:
                task = bar.add_task("sweep", total=len(todo))

                def progress(done, _total):
                    self.journal.flush()
                    bar.update(task, completed=done)

                jobs = [[f"{n}={v!r}" for n, v in values.items()] for _, values in todo]
                self.place(jobs, finished, progress)
        outcomes = [self.journal.known[k] for k in keys]
        self.asked += len(rows)
        self.ran += len(todo)
        self.seen += [(tuple(r.values()), o) for r, o in zip(rows, outcomes, strict=True)]
        return outcomes


class Here:
    """Threads of this process."""

    def __init__(self, experiment, overrides, threads):
        self.experiment = str(experiment)
        self.overrides = overrides
        self.threads = threads
        self.experiments = _core.Experiments()

    def __call__(self, jobs, finished, progress):
        jobs = [(self.experiment, self.overrides + sets) for sets in jobs]
        _core.run_many(jobs, self.threads, progress, True, finished, self.experiments)


class Cluster:
    """The workers of a Dask scheduler. They read the experiment by its path, as it is here.

    The loss of a worker costs its chunks another run elsewhere, nothing else.
    """

    def __init__(self, address, experiment, overrides, identity):
        try:
            import distributed
        except ImportError:
            raise InputError(
                "--scheduler: expected the package distributed; pip install forceaxis[cluster]"
            ) from None

        def fail(error):
            raise InputError(
                f"--scheduler: {address}: expected the address of a running Dask scheduler, "
                f"tcp://HOST:PORT; {error}"
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

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.client.close()

    def __call__(self, jobs, finished, progress):
        cores = sum(self.client.nthreads().values())
        if cores == 0:
            raise InputError(
                f"--scheduler: {self.address}: expected workers; start some with `dask worker`"
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
                progress(done, len(jobs))
        except Refused as error:
            raise InputError(f"--scheduler: {self.address}: {error}") from None
        except (InputError, KeyboardInterrupt):
            raise
        except Exception as error:
            raise SimulationError(
                f"{self.address}: expected every chunk to be run, {error}; the same command resumes"
            ) from error
        finally:
            self.client.cancel(list(futures))


class Refused(Exception):
    """A worker that cannot do this work."""


def run_chunk(experiment, overrides, identity, jobs):
    """On a worker: results of some points, after a check that it would run the same thing."""
    import socket

    where = f"worker on {socket.gethostname()}"
    try:
        mine = identity_of(experiment, overrides)
    except InputError as error:
        raise Refused(f"{where}: {error}") from None
    for name, value in mine.items():
        if value != identity[name]:
            raise Refused(
                f"{where}: {name}: expected {identity[name][:12]}, got {value[:12]}; give the "
                "workers the same files and the same forceaxis"
            )
    return _core.run_many([(experiment, overrides + sets) for sets in jobs], 1, None, True)


def boundaries(runner, rows, search):
    """For every row of values, the change of verdict along `search`, halved to its tolerance."""
    count = len(rows)
    found = {
        "boundary": np.full(count, math.nan),
        "unstable_at": np.full(count, math.nan),
        "note": [""] * count,
        "error": [""] * count,
        "runs": np.zeros(count),
    }
    brackets = {}  # row -> [last stable value, first unstable value]

    def verdicts(wanted):
        """Verdicts at (row, value), None for one that failed."""
        outcomes = runner([rows[i] | {search.name: v} for i, v in wanted])
        for (i, value), outcome in zip(wanted, outcomes, strict=True):
            found["runs"][i] += 1
            if "error" in outcome:
                found["error"][i] = f"at {search.name} = {value:g}: {outcome['error']}"
        return [o.get("verdict") for o in outcomes]

    ends = verdicts([(i, v) for i in range(len(rows)) for v in (search.low, search.high)])
    for i, pair in enumerate(zip(ends[::2], ends[1::2], strict=True)):
        if None in pair:
            continue
        if pair[0] == pair[1]:
            found["note"][i] = f"no change: {pair[0]} from {search.low:g} to {search.high:g}"
        else:
            up = pair[0] == "stable"
            brackets[i] = [search.low, search.high] if up else [search.high, search.low]
    active = list(brackets)
    while active:
        middle = {i: tidy(sum(brackets[i]) / 2) for i in active}
        active = [
            i
            for i in active
            if abs(brackets[i][1] - brackets[i][0]) > search.tolerance
            and middle[i] not in brackets[i]
        ]
        for i, verdict in zip(active, verdicts([(i, middle[i]) for i in active]), strict=True):
            if verdict is None:
                del brackets[i]
            else:
                brackets[i][verdict != "stable"] = middle[i]
        active = [i for i in active if i in brackets]
    for i, bracket in brackets.items():
        found["boundary"][i], found["unstable_at"][i] = bracket
    return found | {name: np.array(found[name], dtype=str) for name in ("note", "error")}


# --- what comes of it ----------------------------------------------------------------------------


def describe(done):
    """The summary for a terminal."""
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
    elif counts["stable"] + counts["unstable"]:
        lines.append(("verdict", f"{counts['stable']} stable, {counts['unstable']} unstable"))
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
    return "\n".join(f"{key:12} {value}" for key, value in lines)


def boundary_line(done, i):
    """One boundary in words."""
    at = ", ".join(f"{a.name} = {done.columns[a.name][i]:g}" for a in done.axes)
    stable, unstable = done.columns["boundary"][i], done.columns["unstable_at"][i]
    what = (
        f"{done.search.name}: stable at {stable:.6g}, unstable at {unstable:.6g}"
        if math.isfinite(stable)
        else str(done.columns["note"][i] or done.columns["error"][i])
    )
    return f"{at}: {what}" if at else what


def write(done, out):
    """Write results.csv, .npz and .parquet, plot.png and sweep.json, each whole or not at all."""
    import pyarrow
    import pyarrow.parquet

    from forceaxis.experiments import plots

    with replacing(out / "results.csv") as file, open(file, "w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(done.columns)
        columns = (c.tolist() for c in done.columns.values())
        for row in zip(*columns, strict=True):
            writer.writerow(["" if v != v else v for v in row])  # NaN: nothing
    with replacing(out / "results.npz") as file, open(file, "wb") as stream:
        np.savez_compressed(stream, **done.columns)
    with replacing(out / "results.parquet") as file:
        pyarrow.parquet.write_table(pyarrow.table(done.columns), file)
    with replacing(out / "plot.png") as file:
        plots.sweep(done).savefig(file, dpi=120, format="png")
    with replacing(out / "sweep.json") as file:
        file.write_text(json.dumps(done.summary, indent=2) + "\n")


@contextlib.contextmanager
def replacing(path):
    """A name to write to that becomes `path` when the block ends well."""
    new = path.with_name(path.name + ".new")
    try:
        yield new
        os.replace(new, path)
    finally:
        new.unlink(missing_ok=True)
