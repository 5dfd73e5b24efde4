"""Trials of changed parameters that could explain why the simulated verdict of a cell differs from
the measured one. The file tables.toml defines the trials. The result of a trial has the number of
cells with equal verdicts at each point of its range."""

import itertools
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from forceaxis import paths
from forceaxis.experiments.verdicts import stability
from forceaxis.thesis.tables import CellResult, Trial, key_of, latest, load, run_jobs

T = TypeVar("T")


@dataclass(frozen=True)
class TrialScores:
    """The scores of one trial: the number of table cells with equal verdicts at each of its points.
    Rows are the values of the first parameter that the trial varies, and columns are the values of
    the second. With one parameter, there is only one column."""

    trial: Trial
    scores: list[list[int]]
    # for each point of the trial: True if the cell of the trial has the measured verdict there
    gives: list[list[bool]]
    command: str  # command line that repeats the run of the trial's cell

    @property
    def best(self) -> int:
        """The highest number of table cells with equal verdicts at any point of the trial."""
        return max(max(row) for row in self.scores)

    @property
    def best_count(self) -> int:
        """The number of points of the trial at which most table cells have equal verdicts."""
        return sum(row.count(self.best) for row in self.scores)

    @property
    def points(self) -> int:
        """The number of combinations of parameter values that the trial simulates."""
        return sum(len(row) for row in self.scores)


@dataclass(frozen=True)
class TrialsResult:
    """The scores of all trials, and the score with all chosen trials together. A score is a number
    of table cells with equal verdicts."""

    trials: list[TrialScores]
    together: int  # number of cells with equal verdicts when all chosen trials are applied together
    together_sets: list[str]  # overrides of the run in which all chosen trials are applied together


def run(cells: Sequence[CellResult], threads: int | None = None) -> TrialsResult:
    """Simulates the cells that the trials of tables.toml change, at each point of each trial.
    `cells`: result of tables.run(). Other cells keep their verdicts."""
    variants = [(trial, point) for trial in load().trials for point in points(trial)]
    taken = [(trial, trial.taken) for trial in load().trials if trial.taken]
    changed = [
        (cell, trial, point)
        for trial, point in [*variants, *taken]
        for cell in cells
        if trial.changes(cell)
    ]
    jobs = [job(cell, trial, point) for cell, trial, point in changed]
    right: dict[tuple[str, tuple[str, ...]], dict[str, bool]] = {}
    for (cell, trial, point), done in zip(changed, run_jobs(jobs, threads, "trials"), strict=True):
        verdicts = right.setdefault((trial.what, point), {})
        verdicts[key_of(cell)] = stability(done.verdict) == cell.thesis
    before = {key_of(cell): cell.agrees for cell in cells}

    def score(changes: dict[str, bool]) -> int:
        return sum((before | changes).values())

    found = []
    for trial in load().trials:
        at = [right[trial.what, point] for point in points(trial)]
        width = len(trial.vary[1].values) if len(trial.vary) > 1 else 1
        found.append(
            TrialScores(
                trial=trial,
                scores=in_rows([score(one) for one in at], width),
                gives=in_rows([one[trial.cell] for one in at], width),
                command=command(cells, trial),
            )
        )
    together: dict[str, bool] = {}
    for trial, point in taken:
        together |= right[trial.what, point]
    return TrialsResult(found, score(together), [text for _, point in taken for text in point])


def points(trial: Trial) -> list[tuple[str, ...]]:
    """Returns the points of a trial, each as overrides of a run. From one point to the next, the
    value of the last parameter changes first."""
    names = [[f"{one.name}={value}" for value in one.values] for one in trial.vary]
    return list(itertools.product(*names))


def job(cell: CellResult, trial: Trial, point: Sequence[str]) -> tuple[str, list[str]]:
    """Returns (experiment, overrides) for the run of a cell at one point of a trial."""
    path, sets = load().job(cell)
    return path, latest([*sets, *trial.set, *point])


def in_rows(values: Sequence[T], width: int) -> list[list[T]]:
    """Returns a list of values as a list of rows with `width` columns each."""
    return [list(values[i : i + width]) for i in range(0, len(values), width)]


def command(cells: Sequence[CellResult], trial: Trial) -> str:
    """Returns the command line of the run of a trial's cell. It has the overrides `taken` of the
    trial. If the trial is not chosen, it has the overrides of its first point."""
    cell = next(one for one in cells if key_of(one) == trial.cell)
    path, sets = job(cell, trial, trial.taken or points(trial)[0])
    words = [word for text in sets for word in ("--set", text)]
    return shlex.join(["forceaxis", "run", paths.display(path), *words])
