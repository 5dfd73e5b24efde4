"""The 55 measured cells of the stability tables of the thesis: simulated and measured verdicts, the
fit of the free constants, and the sensitivity of the result.

A cell is a run of one experiment file with a gain, a set-point and a workpiece. The constants that
the thesis does not state are fitted; sim/models/thesis.toml contains them like every other
parameter, and tables.toml contains their names and the grid on which they were searched.
"""

import functools
import hashlib
import itertools
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core, paths, progress, toml
from forceaxis._core import InputError
from forceaxis.experiments import link
from forceaxis.experiments.run_result import Criterion, Metrics, read_metrics
from forceaxis.experiments.verdicts import stability
from forceaxis.results import from_json, json_field, to_json

FILE = paths.EXPERIMENTS / "tables.toml"
EVIDENCE = paths.EXPERIMENTS / "tables_fit.json"

Job = tuple[str, list[str]]  # one run: (experiment file, overrides)
Point = tuple[int, ...]  # a point of the search grid: for each constant, the index of its value


class StaleFit(Exception):
    """Error: the stored fit was made with other models, other experiments or another grid."""


@dataclass(frozen=True)
class Cell:
    """A cell of a stability table of the thesis: the settings of a run and the measured verdict."""

    figure: str
    test: str  # test of the cell: "contact" or "disturbance"
    workpiece: str  # workpiece of the cell: "original" or "damped"
    grip: str  # grip of the workpiece: "none", "hard_pad" or "soft_pad"
    force_gain: int  # gain in DAC codes per 8-bit count of force
    # force set-point in 8-bit counts; None if the thesis does not state it
    force_setpoint: int | None
    thesis: str  # the measured verdict: "stable" or "unstable"


@dataclass(frozen=True)
class CellRun:
    """The simulated run of one cell."""

    verdict: str
    metrics: Metrics
    criterion: Criterion
    fault: str
    trace_hash: str
    overridden: list[str]  # names of the parameters that the run changed


@dataclass(frozen=True)
class CellResult(Cell):
    """A cell with the verdict of its simulated run, and the reason for this verdict."""

    ours: str  # the simulated verdict: "stable" or "unstable"
    metrics: Metrics
    criterion: Criterion
    fault: str
    trace_hash: str
    # reason why simulated and measured verdict differ; None if they agree
    reason: str | None = json_field(omit_none=True)

    @property
    def agrees(self) -> bool:
        """True if the simulated verdict is equal to the measured verdict."""
        return self.ours == self.thesis

    @property
    def ripple_limit_count(self) -> float:
        """Returns the largest force ripple of a stable run in 8-bit counts. Raises InputError if
        the experiment does not limit the ripple."""
        limit_count = self.criterion.force_ripple_max_count
        if limit_count is None:
            raise InputError(
                f"Fig {key_of(self)}: expected a table [verdict] with the key "
                "force_ripple_max_count"
            )
        return limit_count


@dataclass(frozen=True)
class TablesResult:
    """All cells of the stability tables with their simulated verdicts."""

    cells: list[CellResult]
    matched: int  # number of cells whose simulated verdict is the measured verdict
    total: int
    fitted: dict[str, float]  # {fitted constant: value}
    overridden: list[str]  # printed parameters that a run changed


@dataclass(frozen=True)
class Sensitivity:
    """Effect of a changed threshold of the verdict on the result of the tables."""

    threshold: str
    factor: float
    value: float
    score: int  # number of cells whose simulated verdict is the measured verdict
    changed: list[str]  # keys (key_of) of the cells whose simulated verdict changes


@dataclass(frozen=True)
class Constant:
    """A constant that is fitted: its parameter, the cells that depend on the constant, and the grid
    of the search."""

    name: str
    how: str  # text that names the measurement which determines the constant
    grid: tuple[float, ...]
    # groups of cells that depend on the constant; empty if all groups depend on it
    groups: tuple[str, ...] = ()


@dataclass(frozen=True)
class Alternative:
    """Another interpretation of a sentence of the thesis, described by changed parameters."""

    what: str
    set: list[str]  # texts "parameter=value" that change parameters


@dataclass(frozen=True)
class Reading:
    """A choice that the thesis leaves open: the interpretation that is used, its reason, and other
    interpretations, whose scores the report shows."""

    name: str
    taken: str
    why: str
    alternatives: list[Alternative]


@dataclass(frozen=True)
class SourcedParameter:
    """A parameter of sim/models/thesis.toml with the source of its value."""

    value: int | float
    unit: str
    source: str


@dataclass(frozen=True)
class OmittedFigure:
    """Result of a fit to all figures except one, and of the prediction of the cells of this
    figure."""

    figure: str
    cells: int  # number of cells of the omitted figure
    fitted: dict[str, float]  # {fitted constant: value}
    predicted_right: int  # number of cells of the omitted figure with the measured verdict
    score_on_all: int  # number of cells of all figures with the measured verdict


@dataclass(frozen=True)
class FitRecord:
    """The stored result of the fit of the constants."""

    inputs_hash: str  # evidence_hash() of the files from which the fit was made
    grid: dict[str, list[float]]  # {constant: searched values}
    points: int  # number of points of the grid
    # number of points at which the cells of test "disturbance" were also run
    points_with_strikes: int
    fitted: dict[str, float]  # {constant: fitted value}
    score: int  # number of fitted cells with the measured verdict
    cells: int  # number of cells to which the constants are fitted
    points_at_best: int  # number of points with the highest score
    left_out: list[OmittedFigure]
    plateau: dict[str, list[tuple[float, int]]]  # {constant: [(ratio to the fitted value, score)]}
    # (name of the open choice, alternative interpretation, score)
    readings: list[tuple[str, str, int]]


@dataclass(frozen=True)
class Tables:
    """The content of tables.toml and of the file with the measured cells."""

    cells: list[Cell]
    experiments: dict[str, str]  # {"test/grip": experiment file}
    workpieces: dict[str, dict[str, float]]  # {workpiece: {parameter: value}}
    # name of the parameter with the set-point for cells without a stated set-point
    unstated_setpoint: str
    # groups of cells to which the constants are fitted; all other cells are predicted
    fit_on: tuple[str, ...]
    matched_at_least: int
    constants: list[Constant] = json_field(key="constant")
    readings: list[Reading] = json_field(key="reading", default_factory=list)
    # {key_of(cell): reason why the simulated verdict differs}
    reasons: dict[str, str] = field(default_factory=dict)

    def group(self, cell: Cell) -> str:
        """Returns the name of the group of a cell. A group is a figure, with the tests contact and
        disturbance separate. The fit omits whole groups.

        The original half of Fig 5.10 is Fig 3.16 and has this name.
        """
        if cell.figure != "5.10":
            return cell.figure
        figure = "3.16" if cell.workpiece == "original" else "5.10"
        return f"{figure} {cell.test}"

    def groups(self) -> list[str]:
        """Returns the names of all groups of cells, in the order of the cells."""
        return list(dict.fromkeys(self.group(c) for c in self.cells))

    def job(self, cell: Cell, constants: Mapping[str, float] | None = None) -> Job:
        """Returns (experiment, overrides) for the run of a cell. constants: {parameter: value} to
        try."""
        setpoint = self.unstated_setpoint if cell.force_setpoint is None else cell.force_setpoint
        sets = [
            f"firmware.force_gain={cell.force_gain}",
            f"firmware.force_setpoint={setpoint}",
            *sets_of(self.workpieces[cell.workpiece]),
            *sets_of(constants or {}),
        ]
        return str(paths.EXPERIMENTS / self.experiments[f"{cell.test}/{cell.grip}"]), latest(sets)


@functools.cache
def load() -> Tables:
    """Reads tables.toml and the file with the measured cells. Raises InputError."""
    data = toml.read(FILE)
    cells = json.loads((FILE.parent / data["cells"]).read_text())["cells"]
    return from_json(Tables, data | {"cells": cells}, paths.display(FILE))


def parameters() -> dict[str, SourcedParameter]:
    """Returns the parameters of sim/models/thesis.toml by name."""
    file = paths.MODELS / "thesis.toml"
    table = toml.read(file)["parameters"]
    return {name: from_json(SourcedParameter, p, f"{file}: {name}") for name, p in table.items()}


def fitted() -> dict[str, float]:
    """Returns the present values of the fitted constants in sim/models/thesis.toml."""
    values = parameters()
    return {c.name: values[c.name].value for c in load().constants}


def run_jobs(
    jobs: Sequence[Job], threads: int | None, title: str, over: link.LinkOptions | None = None
) -> list[CellRun]:
    """Runs pairs (experiment, overrides) and shows a progress bar on a terminal.

    over: options of a run with the firmware in another process; the runs then follow each other.
    """
    with progress.bar(title, len(jobs)) as advance:
        if over and over.kind != "inproc":
            outcomes = link.run_many(over, jobs, advance)
        else:
            outcomes = _core.run_many(jobs, threads or os.cpu_count() or 1, advance)
    return [
        CellRun(
            verdict=outcome["verdict"],
            metrics=read_metrics(outcome["metrics"]),
            criterion=Criterion(**outcome["criterion"]),
            fault=outcome["fault"],
            trace_hash=outcome["trace_hash"],
            overridden=outcome["overridden"],
        )
        for outcome in outcomes
    ]


def key_of(cell: Cell) -> str:
    """Returns a cell as text: figure, test, workpiece, grip, gain and set-point. The text is also
    the key of the cell in tables.toml."""
    words = [cell.figure, cell.test, cell.workpiece, cell.grip.replace("_", " ")]
    setpoint = cell.force_setpoint or "not stated"
    return f"{', '.join(words)}, gain {cell.force_gain}, set-point {setpoint}"


def run(threads: int | None = None, over: link.LinkOptions | None = None) -> TablesResult:
    """Runs all cells with the constants of the parameter file. over: as in run_jobs."""
    tables = load()
    runs = run_jobs([tables.job(c) for c in tables.cells], threads, "tables", over)
    cells = []
    for cell, done in zip(tables.cells, runs, strict=True):
        # the verdicts of the thesis are only "stable" and "unstable"
        ours = stability(done.verdict)
        reason = tables.reasons.get(key_of(cell), "not explained") if ours != cell.thesis else None
        cells.append(
            CellResult(
                **vars(cell),
                ours=ours,
                metrics=done.metrics,
                criterion=done.criterion,
                fault=done.fault,
                trace_hash=done.trace_hash,
                reason=reason,
            )
        )
    # Damper and pad of a cell are not among the printed parameters.
    named = {"b_w", "k_g"}
    return TablesResult(
        cells=cells,
        matched=sum(c.agrees for c in cells),
        total=len(cells),
        fitted=fitted(),
        overridden=sorted({name for r in runs for name in r.overridden} - named),
    )


def matches(cells: Sequence[Cell], runs: Sequence[CellRun]) -> NDArray[np.bool_]:
    """Returns for each cell True if the verdict of its run is the measured verdict."""
    pairs = zip(cells, runs, strict=True)
    return np.array([stability(r.verdict) == c.thesis for c, r in pairs])


def score_with(variants: Sequence[Sequence[str]], threads: int | None, title: str) -> list[int]:
    """Returns for each list of further overrides the number of cells with the measured verdict. All
    runs share one pool of threads."""
    tables = load()
    jobs = [
        (path, latest([*sets, *extra]))
        for extra in variants
        for path, sets in (tables.job(c) for c in tables.cells)
    ]
    runs = run_jobs(jobs, threads, title)
    n = len(tables.cells)
    return [
        int(matches(tables.cells, runs[i * n : (i + 1) * n]).sum()) for i in range(len(variants))
    ]


def plateau(
    values: Mapping[str, float],
    threads: int | None = None,
    steps: Sequence[float] = (0.9, 0.95, 0.975, 1.0, 1.025, 1.05, 1.1),
) -> dict[str, list[tuple[float, int]]]:
    """Returns the scores when one constant at a time is changed: {constant: [(ratio to its value,
    score)]}."""
    variants = [sets_of({**values, n: value * r}) for n, value in values.items() for r in steps]
    scores = iter(score_with(variants, threads, "plateau"))
    return {name: [(ratio, next(scores)) for ratio in steps] for name in values}


def readings(values: Mapping[str, float], threads: int | None = None) -> list[tuple[str, str, int]]:
    """Returns the score of each alternative interpretation when only this alternative is used:
    (open choice, alternative, score)."""
    rows = [(r.name, a) for r in load().readings for a in r.alternatives]
    scores = score_with([sets_of(values) + a.set for _, a in rows], threads, "readings")
    return [(name, a.what, score) for (name, a), score in zip(rows, scores, strict=True)]


def latest(sets: Sequence[str]) -> list[str]:
    """Returns the overrides. If a name occurs several times, only the last override of this name is
    kept."""
    return list({text.partition("=")[0]: text for text in sets}.values())


def sets_of(values: Mapping[str, float]) -> list[str]:
    """Returns parameter values as overrides "parameter=value"."""
    return [f"{k}={v!r}" for k, v in values.items()]


def criterion_sensitivity(
    cells: Sequence[CellResult], threads: int | None = None
) -> list[Sensitivity]:
    """Returns the effect of a change of +-20 % on each threshold of the verdict. cells: results of
    run().

    For another window the cells are run again; for another limit of the ripple, verdicts follow
    from the metrics of the runs.
    """
    tables = load()

    def sensitivity(
        threshold: str, factor: float, value: float, verdicts: Iterable[str]
    ) -> Sensitivity:
        pairs = [(c, stability(v)) for c, v in zip(cells, verdicts, strict=True)]
        score = sum(ours == c.thesis for c, ours in pairs)
        changed = [key_of(c) for c, ours in pairs if ours != c.ours]
        return Sensitivity(threshold, factor, value, score, changed)

    def verdict_with(cell: CellResult, ripple_limit_count: float) -> str:
        criterion = replace(cell.criterion, force_ripple_max_count=ripple_limit_count)
        return _core.evaluate(to_json(criterion), to_json(cell.metrics), cell.fault)[0]

    rows = []
    for factor in (0.8, 1.2):
        verdicts = [verdict_with(c, factor * c.ripple_limit_count) for c in cells]
        value = cells[0].ripple_limit_count * factor
        rows.append(sensitivity("force_ripple_max_count", factor, value, verdicts))
    for factor in (0.8, 1.2):
        window_s = cells[0].criterion.window_s * factor
        jobs = [tables.job(c, {"verdict.window_s": window_s}) for c in tables.cells]
        verdicts = [r.verdict for r in run_jobs(jobs, threads, "criterion")]
        rows.append(sensitivity("window_s", factor, window_s, verdicts))
    return rows


def evidence_hash() -> str:
    """Returns a hash of the inputs of the fit: grid, cells, models and experiments, without fitted
    values."""
    tables = load()
    free = {c.name for c in tables.constants}
    fixed = {name: p.value for name, p in parameters().items() if name not in free}
    grid = [(c.name, c.groups, c.grid) for c in tables.constants]
    workpieces = {name: sets_of(values) for name, values in tables.workpieces.items()}
    digest = hashlib.sha256()
    cells, choices = to_json(tables.cells), to_json(tables.readings)
    digest.update(repr((tables.fit_on, grid, cells, workpieces, choices, fixed)).encode())
    for name in sorted(set(tables.experiments.values())):
        experiment = toml.read(paths.EXPERIMENTS / name)
        model = toml.read(paths.EXPERIMENTS / experiment["model"])
        for table in (experiment, model):  # descriptions do not affect a run
            texts = ("title", "figure", "shows", "plot", "expect")
            digest.update(repr({k: v for k, v in table.items() if k not in texts}).encode())
    return digest.hexdigest()


def fit(threads: int | None = None) -> FitRecord:
    """Searches the grid of tables.toml for the constants with which most cells of `fit_on` have the
    measured verdict. Writes the result to tables_fit.json beside tables.toml.

    Cells of test "contact" are run on every grid point on which they depend. Cells of test
    "disturbance" are run only at the points at which the contact cells have their best score, all
    of them or all without one figure. Then each figure is omitted in turn: the constants are fitted
    to the other figures and predict its cells.
    """
    tables = load()
    grids = [c.grid for c in tables.constants]
    members = {g: [c for c in tables.cells if tables.group(c) == g] for g in tables.groups()}
    # For each group, the indices of the constants on which the cells of the group depend.
    needed = {
        group: [i for i, c in enumerate(tables.constants) if not c.groups or group in c.groups]
        for group in tables.fit_on
    }

    def evaluate(group: str, points: Iterable[Point]) -> dict[Point, int]:
        """Returns {point: score} for the cells of a group. A point has only the coordinates of the
        constants on which the group depends."""
        wanted = sorted({tuple(p[i] for i in needed[group]) for p in points})
        own = [tables.constants[i] for i in needed[group]]
        jobs = [
            tables.job(cell, {c.name: c.grid[j] for c, j in zip(own, at, strict=True)})
            for at in wanted
            for cell in members[group]
        ]
        runs = run_jobs(jobs, threads, f"fit on Fig {group}")
        n = len(members[group])
        return {
            at: int(matches(members[group], runs[k * n : (k + 1) * n]).sum())
            for k, at in enumerate(wanted)
        }

    everywhere = list(itertools.product(*(range(len(g)) for g in grids)))
    late = [g for g in tables.fit_on if g.endswith("disturbance")]
    scores = {g: evaluate(g, everywhere) for g in tables.fit_on if g not in late}

    def total(point: Point, groups: Iterable[str]) -> int:
        return sum(scores[g][tuple(point[i] for i in needed[g])] for g in groups)

    figures = list(dict.fromkeys(g.split()[0] for g in tables.fit_on))

    def without(figure: str | None, groups: Iterable[str]) -> list[str]:
        return [g for g in groups if g.split()[0] != figure]

    promising = set()
    for figure in [None, *figures]:
        groups = without(figure, scores)
        best = max(total(p, groups) for p in everywhere)
        promising |= {p for p in everywhere if total(p, groups) == best}
    points = sorted(promising)
    for group in late:
        scores[group] = evaluate(group, points)

    def choose(groups: Sequence[str]) -> Point:
        """Returns the point with the highest score. Of several such points, returns the point whose
        neighbours have the highest mean score."""
        score = {p: total(p, groups) for p in points}
        best = max(score.values())

        def around(p: Point) -> float:
            near = [score.get(q, 0) for q in neighbours(p, grids)]
            return sum(near) / len(near)

        return max((p for p in points if score[p] == best), key=lambda p: (around(p), p))

    def values(point: Point) -> dict[str, float]:
        return {c.name: c.grid[j] for c, j in zip(tables.constants, point, strict=True)}

    chosen = choose(tables.fit_on)
    omitted = []
    for figure in figures:
        point = choose(without(figure, tables.fit_on))
        jobs = [tables.job(c, values(point)) for c in tables.cells]
        right = matches(tables.cells, run_jobs(jobs, threads, f"without Fig {figure}"))
        own = [g for g in tables.fit_on if g.split()[0] == figure]
        omitted.append(
            OmittedFigure(
                figure=figure,
                cells=sum(len(members[g]) for g in own),
                fitted=values(point),
                predicted_right=total(point, own),
                score_on_all=int(right.sum()),
            )
        )
    best = total(chosen, tables.fit_on)
    record = FitRecord(
        inputs_hash=evidence_hash(),
        grid={c.name: list(c.grid) for c in tables.constants},
        points=len(everywhere),
        points_with_strikes=len(points),
        fitted=values(chosen),
        score=best,
        cells=sum(len(members[g]) for g in tables.fit_on),
        points_at_best=sum(total(p, tables.fit_on) == best for p in points),
        left_out=omitted,
        plateau=plateau(values(chosen), threads),
        readings=readings(values(chosen), threads),
    )
    EVIDENCE.write_text(json.dumps(to_json(record), indent=1) + "\n")
    return record


def neighbours(point: Point, grids: Sequence[Sequence[float]]) -> list[Point]:
    """Returns the points that are at most one step away from a point in each constant. Some of them
    may be outside the grid."""
    steps = [(-1, 0, 1) if len(g) > 1 else (0,) for g in grids]
    return [
        tuple(a + b for a, b in zip(point, step, strict=True)) for step in itertools.product(*steps)
    ]


def evidence() -> FitRecord:
    """Returns the stored fit. Raises StaleFit if there is no stored fit, or if the fit was made
    with other files."""
    again = "repeat the fit of `forceaxis tables`, which takes some minutes, and commit the file"
    if not EVIDENCE.exists():
        raise StaleFit(f"{paths.display(EVIDENCE)}: expected the record of a fit; {again}")
    record = json.loads(EVIDENCE.read_text())
    if record["inputs_hash"] != evidence_hash():
        raise StaleFit(
            f"{paths.display(EVIDENCE)}: expected a fit with the present models, experiments and "
            f"grid, the stored fit is stale; {again}"
        )
    return from_json(FitRecord, record, paths.display(EVIDENCE))
