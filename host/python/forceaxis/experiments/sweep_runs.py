"""The runs of a sweep: on threads or a cluster, without those in its journal."""

import fcntl
import hashlib
import json
import math
import re

import numpy as np
from rich.console import Console
from rich.progress import Progress

from forceaxis import _core
from forceaxis._core import InputError, SimulationError
from forceaxis.experiments.points import tidy
from forceaxis.experiments.verdicts import STABLE

METRICS = (
    "peak_force_N",
    "final_force_N",
    "force_ripple_count",
    "position_ripple_count",
    "contact_losses",
    "contact_losses_run",
    "first_contact_s",
    "in_contact",
    "reading_range_ticks",
    "saturated_ticks",
    "setpoint_beyond_N",
    "last_adc_change_tick",
)


def identity_of(experiment, overrides):
    """Hashes of the inputs of all points: experiment, model, firmware and simulator."""
    return {
        "inputs_hash": _core.inputs(str(experiment), list(overrides))["inputs_hash"],
        "firmware_hash": _core.FIRMWARE_HASH,
        "simulator_hash": _core.SIMULATOR_HASH,
    }


class Journal:
    """Outcomes of finished runs by key; a file that only grows, one JSON object a line.

    The first line is the identity of what was run. Lines cut off by a kill are dropped; a file that
    is no journal of this identity stays as it is.
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
        lines = [read_line(line) for line in whole.splitlines()]
        if not lines and self._line(identity).startswith(data):  # new, or killed in line 1
            self.file.truncate(0)
            self._write(identity)
            self.file.flush()
            return
        if not lines or lines[0] is None or not set(identity) <= set(lines[0]):
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
        self.file.truncate(len(whole))
        for line in lines[1:]:
            if line is not None and "key" in line and "outcome" in line:
                self.known[line["key"]] = line["outcome"]

    @staticmethod
    def _line(entry):
        return json.dumps(entry, allow_nan=False).encode() + b"\n"

    def _write(self, entry):
        self.file.write(self._line(entry))

    def add(self, key, values, outcome):
        """Record one finished run."""
        self.known[key] = outcome
        if self.file:
            self._write({"key": key, "parameters": values, "outcome": outcome})

    def flush(self):
        """Flush to the operating system, where a kill loses nothing."""
        if self.file:
            self.file.flush()

    def close(self):
        """Flush and release the folder."""
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
    """The recorded part of run_many()'s result: an error, or verdict, metrics and identity."""
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
    """Returns the outcomes of points and runs those that are not in the journal."""

    def __init__(self, journal, identity, place):
        self.journal = journal
        self.salt = ":".join(identity.values())
        self.place = place
        self.asked = 0
        self.ran = 0
        self.seen = []  # (values, outcome) of every point asked for

    def key(self, values):
        """Identity of a run: hash of its inputs, and its values in the order of their names."""
        text = "".join([f"\n{name}={values[name]!r}" for name in sorted(values)])
        return hashlib.sha256((self.salt + text).encode()).hexdigest()

    def __call__(self, rows):
        """Outcomes of {name: value} rows, in order."""
        keys = [self.key(row) for row in rows]
        missing = {k: row for k, row in zip(keys, rows, strict=True) if k not in self.journal.known}
        # Sorted by model, so that the modes of each are computed once.
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

    The chunks of a lost worker are run again elsewhere.
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
    """A worker whose forceaxis or files differ from those here."""


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
        "beyond": [""] * count,
        "note": [""] * count,
        "error": [""] * count,
        "runs": np.zeros(count),
    }
    brackets = {}  # row -> [last stable value, first value that is not]

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
        if (pair[0] == STABLE) == (pair[1] == STABLE):
            found["note"][i] = (
                f"no change: {pair[0]} from {search.low:g} to {search.high:g}"
                if pair[0] == pair[1]
                else f"no change: {pair[0]} at {search.low:g}, {pair[1]} at {search.high:g}"
            )
        else:
            up = pair[0] == STABLE
            brackets[i] = [search.low, search.high] if up else [search.high, search.low]
            found["beyond"][i] = pair[up]
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
                brackets[i][verdict != STABLE] = middle[i]
                if verdict != STABLE:
                    found["beyond"][i] = verdict
        active = [i for i in active if i in brackets]
    for i, bracket in brackets.items():
        found["boundary"][i], found["unstable_at"][i] = bracket
    texts = ("beyond", "note", "error")
    return found | {name: np.array(found[name], dtype=str) for name in texts}
