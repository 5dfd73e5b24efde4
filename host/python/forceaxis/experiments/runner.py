"""Runs one experiment with many sets of values. Finished runs are stored in a journal. Threads of
this process or a cluster execute the runs.

Each finished run is a text line of a journal. The key of the line is a hash of the values, the
input files, the firmware and the simulator. A run with a line in the journal is not repeated. Runs
are executed on threads of this process or, in groups, on a Dask cluster. The order and the place of
the runs have no effect on a result.
"""

import contextlib
import fcntl
import hashlib
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any, ClassVar, Generic, Protocol, TypeAlias, TypeVar

from forceaxis import _core, files, progress
from forceaxis._core import InputError
from forceaxis.experiments.inputs import read_inputs
from forceaxis.experiments.sweep_result import Row
from forceaxis.experiments.workers import WorkerDiffers, Workers
from forceaxis.results import to_json

Identity: TypeAlias = dict[str, str]  # {name of a hash: hash}
Jobs: TypeAlias = Sequence[list[str]]  # overrides of each run, as texts NAME=VALUE
JournalLine: TypeAlias = dict[str, Any]  # JSON object in a line of the journal
# Function that receives (number of a finished run, result of _core.run_many).
Finished: TypeAlias = Callable[[int, "_core.RunOutcome"], None]
# Function that receives (number of finished runs, number of all runs).
Progressed: TypeAlias = Callable[[int, int], None]


class Outcome(Protocol):
    """The outcome of a run that a journal stores: a dataclass. If the run failed, the outcome has
    only the field `error`."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def error(self) -> str:
        """Text of the error of a failed run, otherwise empty."""


T = TypeVar("T", bound=Outcome)


def identity_of(experiment: str | Path, overrides: Sequence[str]) -> Identity:
    """Returns hashes of the inputs that all points have in common: experiment, model, firmware and
    simulator."""
    return {
        "inputs_hash": read_inputs(experiment, overrides).inputs_hash,
        "firmware_hash": _core.FIRMWARE_HASH,
        "simulator_hash": _core.SIMULATOR_HASH,
    }


@dataclass(frozen=True)
class JournalEntry:
    """One run as an entry of the journal. `outcome` contains either only `error`, or all fields of
    the outcome except `error`."""

    key: str
    parameters: Row
    outcome: dict[str, Any]


class Journal(Generic[T]):
    """File with the results of finished runs, as one JSON object per text line. Text lines are only
    appended.

    The first text line identifies the inputs. An incomplete text line of a killed process is
    ignored. If a file is not a journal of these inputs, it is not changed. Without a path, nothing
    is written.
    """

    def __init__(
        self, path: Path | None, identity: Identity, kind: Callable[..., T], what: str = "sweep"
    ) -> None:
        """`kind`: dataclass of the outcomes that the journal stores. `what`: name of the command in
        messages."""
        self.known: dict[str, T] = {}
        self.kind, self.what = kind, what
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
        """Reads the runs of a journal with this identity. If the journal is new, writes its first
        text line. Raises InputError."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{path}: expected a folder without a running {self.what}, but another {self.what} "
                "uses this folder; give another folder"
            ) from None
        file.seek(0)
        data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        lines = [read_line(line) for line in whole.splitlines()]
        # The file is new, or a process was killed while it wrote the first text line.
        if not lines and self._line(identity).startswith(data):
            file.truncate(0)
            file.write(self._line(identity))
            file.flush()
            return
        if not lines or not set(identity) <= set(lines[0]):
            raise InputError(
                f"{path}: line 1: expected the journal of a {self.what}, got another file; give "
                "another folder"
            )
        for name in identity:
            if lines[0][name] != identity[name]:
                what = {"inputs_hash": "experiment, model and overrides"}.get(name, name[:-5])
                raise InputError(
                    f"{path}: {name}: expected the same {what} as for the runs in this folder "
                    f"(hash {lines[0][name][:12]}), got a different hash, {identity[name][:12]}; "
                    "give another folder"
                )
        file.truncate(len(whole))
        for line in lines[1:]:
            if "key" in line and "outcome" in line:
                self.known[line["key"]] = self.kind(**line["outcome"])

    @staticmethod
    def _line(entry: Identity | JournalEntry) -> bytes:
        return json.dumps(to_json(entry), allow_nan=False).encode() + b"\n"

    def add(self, key: str, values: Row, outcome: T) -> None:
        """Adds a finished run. `values`: values of the parameters of this run."""
        self.known[key] = outcome
        if self.file:
            entry = asdict(outcome)
            error = entry.pop("error")
            self.file.write(
                self._line(JournalEntry(key, values, {"error": error} if error else entry))
            )

    def flush(self) -> None:
        """Writes the buffered lines to the file, so that they are kept if the process is killed."""
        if self.file:
            self.file.flush()

    def close(self) -> None:
        """Writes the buffered text lines, and releases the folder for other commands."""
        if self.file:
            self.file.close()


def read_line(line: bytes) -> JournalLine:
    """Returns the JSON object in a text line. Returns an empty dict if the line contains none."""
    try:
        entry = files.json_of(line)
    except (ValueError, RecursionError):
        return {}
    return entry if isinstance(entry, dict) else {}


class Place(Protocol):
    """Function that executes runs, on threads of this process or on a cluster."""

    def __call__(self, jobs: Jobs, finished: Finished, progressed: Progressed) -> None:
        """Executes the runs `jobs`. Calls finished() after each run, and progressed()
        repeatedly."""


class Runner(Generic[T]):
    """Returns the outcomes of runs. They come from the journal, or from new runs."""

    def __init__(
        self,
        journal: Journal[T],
        identity: Identity,
        place: Place,
        outcome_of: Callable[["_core.RunOutcome"], T],
    ) -> None:
        """`outcome_of`: function that converts a result of _core.run_many to an outcome."""
        self.outcome_of = outcome_of
        self.journal = journal
        self.salt = ":".join(identity.values())
        self.place = place
        self.asked = 0  # number of outcomes that this object has returned
        self.ran = 0  # number of runs that were not in the journal
        # (values, outcome) of all runs
        self.seen: list[tuple[tuple[float, ...], T]] = []

    def key(self, values: Row) -> str:
        """Returns the key of a run in the journal. It is a hash of the inputs and of the values,
        which are sorted by name."""
        text = "".join([f"\n{name}={values[name]!r}" for name in sorted(values)])
        return hashlib.sha256((self.salt + text).encode()).hexdigest()

    def __call__(self, rows: Sequence[Row]) -> list[T]:
        """Returns the outcome of a run for each of `rows`, in the same order."""
        keys = [self.key(row) for row in rows]
        missing = {k: row for k, row in zip(keys, rows, strict=True) if k not in self.journal.known}
        # The runs are sorted by model, so that the modes of each model are computed only once.
        of_model = list(dict.fromkeys(name for row in rows for name in row if "." not in name))
        todo = sorted(
            missing.items(), key=lambda item: [item[1].get(n, -math.inf) for n in of_model]
        )

        def finished(i: int, result: "_core.RunOutcome") -> None:
            key, values = todo[i]
            self.journal.add(key, values, self.outcome_of(result))

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


class Cluster(Workers):
    """Executes runs on the workers of a Dask scheduler. The workers read the files of the
    experiment by the same paths as this process."""

    def __init__(
        self, address: str, experiment: Path, overrides: list[str], identity: Identity
    ) -> None:
        super().__init__(address)
        self.work = (str(experiment.resolve()), overrides, identity)

    def __call__(self, jobs: Jobs, finished: Finished, progressed: Progressed) -> None:
        size = max(1, min(64, len(jobs) // (4 * self.cores())))
        calls = [(*self.work, jobs[i : i + size]) for i in range(0, len(jobs), size)]
        done = 0
        for number, results in self.results(run_chunk, calls):
            for i, result in enumerate(results):
                finished(number * size + i, result)
            done += len(results)
            progressed(done, len(jobs))


def run_chunk(
    experiment: str, overrides: list[str], identity: Identity, jobs: Jobs
) -> "list[_core.RunOutcome]":
    """Executes runs on a worker, and returns their results. Raises WorkerDiffers if the worker and
    the process that has started the sweep have different inputs."""
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


@dataclass(frozen=True)
class RunSite:
    """The choice of where runs are executed, and of the folder for their results."""

    out: Path | None  # folder for the results; None: nothing is written
    threads: int  # number of threads of this process
    scheduler: str | None  # address of a Dask scheduler, whose workers execute the runs


@contextlib.contextmanager
def runner_at(
    site: RunSite,
    experiment: Path,
    overrides: list[str],
    identity: Identity,
    kind: Callable[..., T],
    outcome_of: Callable[["_core.RunOutcome"], T],
    what: str = "sweep",
) -> Iterator[Runner[T]]:
    """Context manager that returns the runner for `site`. Journal and Runner define the other
    arguments. Raises InputError if the folder contains other runs, and ParameterError for a wrong
    scheduler."""
    with contextlib.ExitStack() as stack:
        place: Place = (
            stack.enter_context(Cluster(site.scheduler, experiment, overrides, identity))
            if site.scheduler
            else Here(experiment, overrides, site.threads)
        )
        if site.out is not None:
            site.out.mkdir(parents=True, exist_ok=True)
        file = None if site.out is None else site.out / "journal.jsonl"
        journal = Journal(file, identity, kind, what)
        stack.callback(journal.close)
        yield Runner(journal, identity, place, outcome_of)
