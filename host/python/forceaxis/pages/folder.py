"""Runs the experiments of a folder for the report."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from multiprocessing.pool import AsyncResult, Pool
from pathlib import Path
from typing import TypeVar

from markupsafe import Markup

from forceaxis import progress
from forceaxis._core import InputError, SimulationError
from forceaxis.experiments import expect, regression, trace, verdicts
from forceaxis.experiments.run import Run
from forceaxis.pages import pictures

T = TypeVar("T")

# {status of an experiment: text for the page}, in the order in which the page counts them
STATUSES = {
    verdicts.STABLE: "stable",
    "part_good": "part good",
    verdicts.NOT_HELD: verdicts.MARK_WORDS[verdicts.NOT_HELD],
    **{verdict: verdicts.WORDS[verdict] for verdict in verdicts.NOT_STABLE},
    "part_bad": "part bad",
    "none": "no verdict",
    "differs": "not as expected",
    "error": "not run",
}


@dataclass
class Entry:
    """An experiment in the report. It has the finished run, or the error that prevented the run."""

    file: Path
    # path of the experiment file, relative to the folder of the report and without suffix
    name: str
    done: Run | None = None  # the finished run; None if an error prevented it
    # text lines, one for each difference between the result of the run and the table [expect]
    differs: tuple[str, ...] = ()
    error: str = ""

    @property
    def run(self) -> Run:
        """The finished run. This property exists only if the experiment ran without error."""
        assert self.done is not None
        return self.done

    @property
    def id(self) -> str:
        """Name of the HTML anchor of the experiment on the page of the report."""
        return re.sub(r"\W", "_", self.name)

    @property
    def outcome(self) -> str:
        """Verdict of the experiment as a key of STATUSES. For an experiment without a verdict, it
        is the outcome of the last press cycle."""
        if self.error:
            return "error"
        result = self.run.result
        if result.mark or not result.cycle:
            return result.mark or "none"
        return {"good": "part_good", "bad": "part_bad"}.get(result.cycle.state, "none")

    @property
    def status(self) -> str:
        """Status of the experiment, which selects a colour. It is "differs" if the result differs
        from the table [expect], and otherwise the outcome."""
        return "differs" if self.differs else self.outcome

    @property
    def order(self) -> tuple[bool, tuple[int | str, ...], str]:
        """Sort key of the experiment on the page. Cycles that press parts come first. The others
        are sorted by figure number and name."""
        result = self.done.result if self.done else None
        figure = result.figure if result else ""
        return not (result and result.cycle), figure_order(figure), self.name

    @property
    def title(self) -> str:
        """Title of the experiment. After an error, it is the name of the experiment."""
        return self.done.title if self.done else self.name

    @property
    def held(self) -> str:
        """Text with the controlled force and its static error. It is empty for an experiment
        without a force set-point."""
        held = self.done and self.done.result.metrics.held_force
        if not held:
            return ""
        force = f"{held.held_N:.4g} N of {held.setpoint_N:.4g} N"
        error = held.error_percent
        return f"{force}, error {f'{error:.2g}' if error >= 0.01 else 'below 0.01'} %"

    @cached_property
    def picture(self) -> Markup:
        """Plot of the signals of the run, as a data URI for the HTML page."""
        return pictures.figure(trace.figure(self.run))

    @cached_property
    def thumbnail(self) -> Markup:
        """Small plot of the main signal of the run, as inline SVG."""
        return pictures.thumbnail(self.run)


def figure_order(figure: str) -> tuple[int | str, ...]:
    """Returns a sort key for a text with figure numbers: "2.16a, 5.1" gives (2, 16, "a"). Texts
    without a number are sorted to the end."""
    found = re.match(r"(\d+)\.(\d+)(\w*)", figure)
    return (int(found[1]), int(found[2]), found[3]) if found else (99,)


def files(folder: Path) -> list[Path]:
    """Returns the paths of the experiments below a folder. Files that cannot be read as experiments
    are included. Raises InputError if the folder contains no experiment."""
    if not folder.is_dir():
        raise InputError(
            f"{folder}: expected a folder with experiments, got no such folder; `new_axis` "
            "writes a folder with experiments"
        )
    below = sorted(p for p in folder.rglob("*.toml") if p.is_file())
    found = [
        p
        for p in below
        if not any(part.startswith(".") for part in p.relative_to(folder).parts)
        and regression.is_test(p) is not None
    ]
    if not found:
        raise InputError(
            f"{folder}: expected at least one experiment (a .toml file with model and "
            f"duration_s), got {len(below)} other .toml files; `new_axis` writes two "
            "experiments"
        )
    return found


def begin(pool: Pool, folder: Path) -> list[AsyncResult[Entry]]:
    """Starts the runs of all experiments of a folder in the worker processes of `pool`."""
    return [pool.apply_async(_drawn, (path, folder)) for path in files(folder)]


def results(jobs: Sequence[AsyncResult[T]], what: str) -> list[T]:
    """Waits for all jobs in worker processes, and returns their results. `what`: plural name of the
    jobs in the progress line."""
    return [job.get() for job in progress.each(jobs, what)]


def entries(jobs: Sequence[AsyncResult[Entry]]) -> list[Entry]:
    """Waits until all experiments have finished. Returns one Entry for each experiment, in the
    order of the page."""
    return sorted(results(jobs, "experiments"), key=lambda entry: entry.order)


def _drawn(path: Path, folder: Path) -> Entry:
    """Runs an experiment in a worker process. Returns the experiment with its plots, but without
    its table of signals, because the result is sent to another process."""
    name = path.relative_to(folder).with_suffix("").as_posix()
    try:
        examined = expect.examine(path)
    except (InputError, SimulationError, OSError) as error:
        return Entry(path, name, error=" ".join(str(error).split()).removeprefix(f"{path}: "))
    differs = tuple(str(c) for c in examined.checks if not c.passed)
    entry = Entry(path, name, examined.run, differs)
    _ = entry.picture, entry.thumbnail
    entry.run.columns = {}
    return entry
