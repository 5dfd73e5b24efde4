"""Runs of a sweep: on threads or a cluster, without those that the journal contains."""

import fcntl
import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NoReturn, Protocol, Self, TypeAlias

import numpy as np
from rich.console import Console
from rich.progress import Progress

from forceaxis import _core
from forceaxis._core import InputError, SimulationError
from forceaxis.errors import ParameterError
from forceaxis.experiments.points import SweepParameter, tidy
from forceaxis.experiments.run_result import Columns
from forceaxis.experiments.verdicts import STABLE

Row: TypeAlias = dict[str, float]  # name of a swept parameter -> its value
# A finished run as a line of the journal contains it: the error, or verdict, fault and METRICS.
Outcome: TypeAlias = dict[str, Any]
Identity: TypeAlias = dict[str, str]  # name of a hash -> the hash
Jobs: TypeAlias = Sequence[list[str]]  # the overrides of each run
Finished: TypeAlias = Callable[[int, dict[str, Any]], None]  # (number of the job, its result)
Progressed: TypeAlias = Callable[[int, int], None]  # (number of finished jobs, all)

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


def identity_of(experiment: str | Path, overrides: Sequence[str]) -> Identity:
    """Hashes of the common inputs of all points: experiment, model, firmware and simulator."""
    return {
        "inputs_hash": _core.inputs(str(experiment), list(overrides))["inputs_hash"],
        "firmware_hash": _core.FIRMWARE_HASH,
        "simulator_hash": _core.SIMULATOR_HASH,
    }


class Journal:
    """Results of finished runs by key, in a file to which lines are only added, one JSON object per
    line.

    The first line identifies the inputs. Incomplete lines of a killed process are ignored. A file
    that is not a journal of these inputs is not changed.
    """

    def __init__(self, path: Path | None, identity: Identity) -> None:
        self.known: dict[str, Outcome] = {}
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
        """Reads a journal of this identity, or begins a new one. Raises InputError."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{path}: expected no other sweep at work in this folder; give another folder"
            ) from None
        file.seek(0)
        data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        lines = [read_line(line) for line in whole.splitlines()]
        # a new file, or a process killed during its first line
        if not lines and self._line(identity).startswith(data):
            file.truncate(0)
            file.write(self._line(identity))
            file.flush()
            return
        if not lines or lines[0] is None or not set(identity) <= set(lines[0]):
            raise InputError(
                f"{path}: line 1: expected a journal of forceaxis sweep; give another folder"
            )
        for name in identity:
            if lines[0][name] != identity[name]:
                what = {"inputs_hash": "experiment, model and overrides"}.get(name, name[:-5])
                raise InputError(
                    f"{path}: {name}: expected the same {what} as the runs in this folder, "
                    f"{lines[0][name][:12]}, got {identity[name][:12]}; give another folder"
                )
        file.truncate(len(whole))
        for line in lines[1:]:
            if line is not None and "key" in line and "outcome" in line:
                self.known[line["key"]] = line["outcome"]

    @staticmethod
    def _line(entry: Mapping[str, Any]) -> bytes:
        return json.dumps(entry, allow_nan=False).encode() + b"\n"

    def add(self, key: str, values: Row, outcome: Outcome) -> None:
        """Record one finished run."""
        self.known[key] = outcome
        if self.file:
            entry = {"key": key, "parameters": values, "outcome": outcome}
            self.file.write(self._line(entry))

    def flush(self) -> None:
        """Writes buffered lines to the operating system, so that they survive the end of the
        process."""
        if self.file:
            self.file.flush()

    def close(self) -> None:
        """Writes buffered lines and releases the folder."""
        if self.file:
            self.file.close()


def read_line(line: bytes) -> dict[str, Any] | None:
    """The JSON object of a line; None if the line contains no JSON object."""
    try:
        entry = json.loads(line)
    except ValueError:
        return None
    return entry if isinstance(entry, dict) else None


def outcome_of(result: Mapping[str, Any]) -> Outcome:
    """The part of a result of run_many() that is recorded: an error, or verdict, metrics and
    identity."""
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


def run_columns(outcomes: Sequence[Outcome]) -> Columns:
    """The outcomes as columns of the results."""
    kinds: dict[str, type] = {"verdict": str, "fault": str, "error": str}
    kinds |= dict.fromkeys((*METRICS, "edge_margin"), float) | {"trace_hash": str}
    return {
        name: np.array([o.get(name, "" if kind is str else None) for o in outcomes], dtype=kind)
        for name, kind in kinds.items()
    }


class Place(Protocol):
    """The place at which the runs of a sweep are executed."""

    def __call__(self, jobs: Jobs, finished: Finished, progress: Progressed) -> None:
        """Executes the jobs. Calls finished() for each, and progress() from time to time."""


class Runner:
    """Returns the outcomes of points; runs the points that the journal does not contain."""

    def __init__(self, journal: Journal, identity: Identity, place: Place) -> None:
        self.journal = journal
        self.salt = ":".join(identity.values())
        self.place = place
        self.asked = 0
        self.ran = 0
        self.seen: list[tuple[tuple[float, ...], Outcome]] = []  # (values, outcome) of every point

    def key(self, values: Row) -> str:
        """Key of a run: hash of its inputs, and its values in the order of their names."""
        text = "".join([f"\n{name}={values[name]!r}" for name in sorted(values)])
        return hashlib.sha256((self.salt + text).encode()).hexdigest()

    def __call__(self, rows: Sequence[Row]) -> list[Outcome]:
        """The outcomes of the rows, in their order."""
        keys = [self.key(row) for row in rows]
        missing = {k: row for k, row in zip(keys, rows, strict=True) if k not in self.journal.known}
        # Sorted by model, so that the modes of each model are computed once.
        of_model = [name for name in (rows[0] if rows else ()) if "." not in name]
        todo = sorted(missing.items(), key=lambda item: [item[1][name] for name in of_model])

        def finished(i: int, result: Mapping[str, Any]) -> None:
            key, values = todo[i]
            self.journal.add(key, values, outcome_of(result))

        console = Console(stderr=True)
        if todo:
            with Progress(console=console, disable=not console.is_terminal, transient=True) as bar:
                task = bar.add_task("sweep", total=len(todo))

                def progress(done: int, _total: int) -> None:
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
    """Runs on threads of this process."""

    def __init__(self, experiment: str | Path, overrides: list[str], threads: int) -> None:
        self.experiment = str(experiment)
        self.overrides = overrides
        self.threads = threads
        self.experiments = _core.Experiments()

    def __call__(self, jobs: Jobs, finished: Finished, progress: Progressed) -> None:
        every = [(self.experiment, self.overrides + sets) for sets in jobs]
        _core.run_many(every, self.threads, progress, True, finished, self.experiments)


class Cluster:
    """Runs on the workers of a Dask scheduler, which read the experiment by the same path as this
    process.

    The groups of a lost worker are run again on another worker.
    """

    def __init__(
        self, address: str, experiment: Path, overrides: list[str], identity: Identity
    ) -> None:
        try:
            import distributed
        except ImportError:
            raise ParameterError(
                "scheduler", "expected the package distributed; pip install forceaxis[cluster]"
            ) from None

        def fail(error: object) -> NoReturn:
            raise ParameterError(
                "scheduler",
                f"{address}: expected the address of a running Dask scheduler, "
                f"tcp://HOST:PORT; {error}",
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

    def __exit__(self, *_: object) -> None:
        self.client.close()

    def __call__(self, jobs: Jobs, finished: Finished, progress: Progressed) -> None:
        cores = sum(self.client.nthreads().values())
        if cores == 0:
            raise ParameterError(
                "scheduler", f"{self.address}: expected workers; start some with `dask worker`"
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
        except WorkerDiffers as error:
            raise ParameterError("scheduler", f"{self.address}: {error}") from None
        except (InputError, KeyboardInterrupt):
            raise
        except Exception as error:
            raise SimulationError(
                f"{self.address}: expected every chunk to be run, {error}; the same command resumes"
            ) from error
        finally:
            self.client.cancel(list(futures))


class WorkerDiffers(Exception):
    """The forceaxis version or the files of a worker differ from those of this process."""


def run_chunk(
    experiment: str, overrides: list[str], identity: Identity, jobs: Jobs
) -> list[dict[str, Any]]:
    """On a worker: results of some points, after a check that its inputs are identical."""
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
    return _core.run_many([(experiment, overrides + sets) for sets in jobs], 1, None, True)


@dataclass
class Boundary:
    """The change of verdict of one row of values along the searched parameter."""

    row: Row
    stable: float = math.nan  # last stable value
    unstable: float = math.nan  # first value beyond the boundary that is not stable
    beyond: str = ""  # its verdict
    note: str = ""  # reason for a missing boundary
    error: str = ""  # of the last run that failed
    runs: int = 0
    searching: bool = False  # whether the verdict changes from `stable` to `unstable`

    def begin(self, search: SweepParameter, low: str | None, high: str | None) -> None:
        """Sets the verdicts at both ends of the range; None: the run failed."""
        if low is None or high is None:
            return
        if (low == STABLE) == (high == STABLE):
            self.note = (
                f"no change: {low} from {search.low:g} to {search.high:g}"
                if low == high
                else f"no change: {low} at {search.low:g}, {high} at {search.high:g}"
            )
            return
        self.searching = True
        up = low == STABLE
        self.stable, self.unstable = (search.low, search.high)[:: 1 if up else -1]
        self.beyond = high if up else low

    @property
    def middle(self) -> float:
        """The value at which the range is halved."""
        return tidy((self.stable + self.unstable) / 2)

    def is_open(self, tolerance: float) -> bool:
        """Whether the range is still wider than the tolerance and can be halved."""
        return (
            self.searching
            and abs(self.unstable - self.stable) > tolerance
            and self.middle not in (self.stable, self.unstable)
        )

    def halve(self, verdict: str | None) -> None:
        """Sets the verdict in the middle; None: the run failed, so there is no boundary."""
        if verdict is None:
            self.searching, self.stable, self.unstable = False, math.nan, math.nan
        elif verdict == STABLE:
            self.stable = self.middle
        else:
            self.unstable, self.beyond = self.middle, verdict


def boundaries(runner: Runner, rows: Sequence[Row], search: SweepParameter) -> Columns:
    """For each row of values, the change of verdict along `search`, by halving down to its
    tolerance."""
    found = [Boundary(row) for row in rows]

    def verdicts(wanted: Sequence[tuple[Boundary, float]]) -> list[str | None]:
        """The verdict at each value; None: the run failed."""
        outcomes = runner([one.row | {search.name: value} for one, value in wanted])
        for (one, value), outcome in zip(wanted, outcomes, strict=True):
            one.runs += 1
            if "error" in outcome:
                one.error = f"at {search.name} = {value:g}: {outcome['error']}"
        return [outcome.get("verdict") for outcome in outcomes]

    ends = verdicts([(one, value) for one in found for value in (search.low, search.high)])
    for one, low, high in zip(found, ends[::2], ends[1::2], strict=True):
        one.begin(search, low, high)
    while active := [one for one in found if one.is_open(search.tolerance)]:
        middles = verdicts([(one, one.middle) for one in active])
        for one, verdict in zip(active, middles, strict=True):
            one.halve(verdict)
    return {
        "boundary": np.array([one.stable for one in found]),
        "unstable_at": np.array([one.unstable for one in found]),
        "beyond": np.array([one.beyond for one in found], dtype=str),
        "note": np.array([one.note for one in found], dtype=str),
        "error": np.array([one.error for one in found], dtype=str),
        "runs": np.array([one.runs for one in found], dtype=float),
    }
