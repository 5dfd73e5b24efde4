"""The 55 measured cells of the stability tables of the thesis. The module computes the simulated
verdicts, the fit of the free constants, and the effect of changed verdict thresholds on the number
of cells with equal verdicts.

A cell is a run of one experiment file with a gain, a set-point and a workpiece. The constants that
the thesis does not state are fitted. Their values are in sim/models/thesis.toml, like those of
every other parameter. The file tables.toml has their names and the grid on which they were
searched.
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
from forceaxis.experiments.run_result import Criterion, Metrics
from forceaxis.experiments.verdicts import stability
from forceaxis.results import from_json, json_field, to_json

FILE = paths.EXPERIMENTS / "tables.toml"
EVIDENCE = paths.EXPERIMENTS / "tables_fit.json"

# a simulated run, as (path of the experiment file, overrides of the run)
Job = tuple[str, list[str]]
# point of the search grid of the fit: one index for the value of each constant
Point = tuple[int, ...]


class StaleFit(Exception):
    """Error: the stored fit of the constants is too old. It was made with other models, other
    experiments or another grid."""


@dataclass(frozen=True)
class Cell:
    """One cell of a stability table of the thesis: the settings of a run, and the measured
    verdict."""

    figure: str
    test: str  # test that was made for this cell: "contact" or "disturbance"
    workpiece: str  # workpiece of this cell: "original" or "damped"
    grip: str  # pad between robot and workpiece: "none", "hard_pad" or "soft_pad"
    force_gain: int  # gain in DAC codes per 8-bit count of force
    # force set-point in 8-bit counts; None if the thesis does not state it
    force_setpoint: int | None
    thesis: str  # measured verdict of the thesis: "stable" or "unstable"


@dataclass(frozen=True)
class CellRun:
    """The simulated run of one cell of a stability table."""

    verdict: str
    metrics: Metrics
    criterion: Criterion
    fault: str
    trace_hash: str
    overridden: list[str]  # names of the parameters that this run has changed


@dataclass(frozen=True)
class CellResult(Cell):
    """A cell of a stability table with the verdict of its simulated run. If this differs from the
    measured verdict, the cell also has the reason."""

    ours: str  # verdict of the simulated run: "stable" or "unstable"
    metrics: Metrics
    criterion: Criterion
    fault: str
    trace_hash: str
    # reason why simulated and measured verdict of the cell differ; None if they agree
    reason: str | None = json_field(omit_none=True)

    @property
    def agrees(self) -> bool:
        """True if the simulated verdict is equal to the measured verdict."""
        return self.ours == self.thesis

    @property
    def ripple_limit_count(self) -> float:
        """Returns the largest force ripple, in 8-bit counts, at which a run is still stable. Raises
        InputError if the experiment does not limit the force ripple."""
        limit_count = self.criterion.force_ripple_max_count
        if limit_count is None:
            raise InputError(
                f"Fig {key_of(self)}: expected an experiment with the key force_ripple_max_count "
                "in its table [verdict]"
            )
        return limit_count


@dataclass(frozen=True)
class TablesResult:
    """All cells of the stability tables of the thesis. Each cell has the verdict of its simulated
    run."""

    cells: list[CellResult]
    matched: int  # number of cells whose simulated verdict equals the measured verdict
    total: int
    fitted: dict[str, float]  # values of the fitted constants, as {name of the constant: value}
    # names of those parameters printed in the thesis that the runs have changed
    overridden: list[str]


@dataclass(frozen=True)
class Sensitivity:
    """Effect of a changed threshold of the verdict on the stability tables: the number of cells
    with equal verdicts, and the cells whose simulated verdict changes."""

    threshold: str
    factor: float
    value: float
    score: int  # number of cells whose simulated verdict equals the measured verdict
    # keys of the cells whose simulated verdict changes; see the function key_of()
    changed: list[str]


@dataclass(frozen=True)
class Constant:
    """A constant of the model that is fitted to the stability tables. It has the name of its
    parameter, the cells that depend on it, and the grid of the search."""

    name: str
    how: str  # text that names the measurement by which the constant can be determined
    grid: tuple[float, ...]
    # names of the groups of table cells that depend on the constant; empty: all groups depend on it
    groups: tuple[str, ...] = ()


@dataclass(frozen=True)
class Alternative:
    """Another interpretation of a sentence of the thesis, described by changed parameter values."""

    what: str
    set: list[str]  # overrides "parameter=value" of the model for this interpretation


@dataclass(frozen=True)
class Reading:
    """A sentence of the thesis that has several interpretations: the used interpretation, the
    reason for it, and the other interpretations. For each of these, the report shows the number of
    cells with equal verdicts."""

    name: str
    taken: str
    why: str
    alternatives: list[Alternative]


@dataclass(frozen=True)
class Variation:
    """A parameter that a trial varies. Its values are texts with units."""

    name: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class Trial:
    """A change of the model that could explain a cell with different verdicts. One or two
    parameters are varied over a range."""

    cell: str  # key of the table cell that the trial could explain; see the function key_of()
    what: str
    # {field of Cell: value}: conditions for the cells whose run the trial changes
    of: dict[str, str]
    vary: tuple[Variation, ...]
    set: tuple[str, ...] = ()  # overrides that the trial sets in each of its runs
    # overrides of this trial in the joint run of all chosen trials; empty if it is not chosen
    taken: tuple[str, ...] = ()

    def changes(self, cell: Cell) -> bool:
        """Returns True if the trial changes the simulated run of a table cell."""
        return all(getattr(cell, name) == value for name, value in self.of.items())


@dataclass(frozen=True)
class SourcedParameter:
    """A parameter of the file sim/models/thesis.toml, with its value and the source of this
    value."""

    value: int | float
    unit: str
    source: str


@dataclass(frozen=True)
class OmittedFigure:
    """Result of a fit of the constants to all figures of the thesis except one. It lists the cells
    of the omitted figure that this fit predicts correctly."""

    figure: str
    cells: int  # number of cells of the omitted figure
    fitted: dict[str, float]  # {fitted constant: value}
    # number of cells of the omitted figure for which the fit predicts the measured verdict
    predicted_right: int
    # number of cells of all tables for which the fit predicts the measured verdict
    score_on_all: int


@dataclass(frozen=True)
class FitRecord:
    """The stored result of the fit of the constants to the stability tables."""

    inputs_hash: str  # hash by evidence_hash() of the files to which the constants were fitted
    grid: dict[str, list[float]]  # {constant: searched values}
    points: int  # number of points of the grid
    # number of grid points at which the cells of the "disturbance" test were also simulated
    points_with_strikes: int
    fitted: dict[str, float]  # {constant: fitted value}
    score: int  # number of fitted cells whose simulated verdict equals the measured verdict
    cells: int  # number of cells to which the constants are fitted
    points_at_best: int  # number of grid points with the highest score
    left_out: list[OmittedFigure]
    # {constant: [(ratio to the fitted value, number of table cells with equal verdicts)]}
    plateau: dict[str, list[tuple[float, int]]]
    # (name of the open choice, interpretation, score) of each interpretation that is not used
    readings: list[tuple[str, str, int]]


@dataclass(frozen=True)
class Tables:
    """The content of the file tables.toml and of the file with the measured cells of the thesis."""

    cells: list[Cell]
    experiments: dict[str, str]  # {"test/grip": experiment file}
    workpieces: dict[str, dict[str, float]]  # {workpiece: parameter values}
    # name of the parameter that gives the set-point of those cells for which the thesis states none
    unstated_setpoint: str
    # names of the groups of cells to which the constants are fitted; other cells are predicted
    fit_on: tuple[str, ...]
    matched_at_least: int
    constants: list[Constant] = json_field(key="constant")
    readings: list[Reading] = json_field(key="reading", default_factory=list)
    trials: list[Trial] = json_field(key="trial", default_factory=list)
    # {key_of(cell): reason} of each cell whose simulated verdict differs from the measured one
    reasons: dict[str, str] = field(default_factory=dict)

    def group(self, cell: Cell) -> str:
        """Returns the name of the group to which a cell of the tables belongs. All cells of one
        figure with the same test (contact or disturbance) are one group. A fit can leave out whole
        groups only.

        The half of Fig 5.10 with the original workpiece is Fig 3.16. Its group has that name.
        """
        if cell.figure != "5.10":
            return cell.figure
        figure = "3.16" if cell.workpiece == "original" else "5.10"
        return f"{figure} {cell.test}"

    def groups(self) -> list[str]:
        """Returns the names of all groups of table cells, in the order of the cells in the file."""
        return list(dict.fromkeys(self.group(c) for c in self.cells))

    def job(self, cell: Cell, constants: Mapping[str, float] | None = None) -> Job:
        """Returns (experiment, overrides) for the simulated run of a table cell. `constants`:
        {parameter: value} of constants whose effect is tried."""
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
    """Returns the content of tables.toml and of the file with the measured cells. Raises
    InputError."""
    data = toml.read(FILE)
    cells = json.loads((FILE.parent / data["cells"]).read_text())["cells"]
    return from_json(Tables, data | {"cells": cells}, paths.display(FILE))


def parameters() -> dict[str, SourcedParameter]:
    """Returns the parameters of sim/models/thesis.toml as {name: parameter}."""
    file = paths.MODELS / "thesis.toml"
    table = toml.read(file)["parameters"]
    return {name: from_json(SourcedParameter, p, f"{file}: {name}") for name, p in table.items()}


def fitted() -> dict[str, float]:
    """Returns the values that the fitted constants have in sim/models/thesis.toml."""
    values = parameters()
    return {c.name: values[c.name].value for c in load().constants}


def _criterion_of(outcome: "_core.RunOutcome") -> Criterion:
    """Returns the verdict criterion of a run. The experiment of the run must have a table
    [verdict]."""
    criterion = outcome["criterion"]
    assert criterion is not None
    return criterion


def run_jobs(
    jobs: Sequence[Job], threads: int | None, title: str, over: link.LinkOptions | None = None
) -> list[CellRun]:
    """Simulates the runs `jobs`, and shows a progress bar on a terminal.

    over: options for runs with the firmware in another process. These runs follow each other.
    """
    with progress.bar(title, len(jobs)) as advance:
        if over and over.kind != "inproc":
            outcomes = link.run_many(over, jobs, advance)
        else:
            outcomes = _core.run_many(jobs, threads or os.cpu_count() or 1, advance)
    return [
        CellRun(
            verdict=outcome["verdict"],
            metrics=outcome["metrics"],
            criterion=_criterion_of(outcome),
            fault=outcome["fault"],
            trace_hash=outcome["trace_hash"],
            overridden=outcome["overridden"],
        )
        for outcome in outcomes
    ]


def key_of(cell: Cell) -> str:
    """Returns the key of a table cell in tables.toml. It is a text of figure, test, workpiece,
    grip, gain and set-point."""
    words = [cell.figure, cell.test, cell.workpiece, cell.grip.replace("_", " ")]
    setpoint = cell.force_setpoint or "not stated"
    return f"{', '.join(words)}, gain {cell.force_gain}, set-point {setpoint}"


def run(threads: int | None = None, over: link.LinkOptions | None = None) -> TablesResult:
    """Simulates all cells of the stability tables with the constants of the parameter file. `over`:
    as in run_jobs()."""
    tables = load()
    runs = run_jobs([tables.job(c) for c in tables.cells], threads, "tables", over)
    cells = []
    for cell, done in zip(tables.cells, runs, strict=True):
        # The thesis has only the verdicts "stable" and "unstable".
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
    # The damper and the pad of a table cell are not among the parameters that the thesis prints.
    named = {"b_w", "k_g"}
    return TablesResult(
        cells=cells,
        matched=sum(c.agrees for c in cells),
        total=len(cells),
        fitted=fitted(),
        overridden=sorted({name for r in runs for name in r.overridden} - named),
    )


def matches(cells: Sequence[Cell], runs: Sequence[CellRun]) -> NDArray[np.bool_]:
    """Returns an array that is True for each table cell whose simulated verdict equals the measured
    verdict."""
    pairs = zip(cells, runs, strict=True)
    return np.array([stability(r.verdict) == c.thesis for c, r in pairs])


def score_with(variants: Sequence[Sequence[str]], threads: int | None, title: str) -> list[int]:
    """Returns one score for each entry of `variants`. The score is the number of table cells whose
    simulated verdict equals the measured verdict. An entry is a list of further overrides. All
    simulated runs share one pool of threads."""
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
    """Returns how the score of the fit changes if one constant is changed at a time, as {constant:
    [(ratio to the fitted value, score)]}. The score is the number of cells with equal verdicts."""
    variants = [sets_of({**values, n: value * r}) for n, value in values.items() for r in steps]
    scores = iter(score_with(variants, threads, "plateau"))
    return {name: [(ratio, next(scores)) for ratio in steps] for name in values}


def readings(values: Mapping[str, float], threads: int | None = None) -> list[tuple[str, str, int]]:
    """Returns (open choice, interpretation, score) for each interpretation of the thesis that is
    not used. The score belongs to a run with this interpretation and no other change."""
    rows = [(r.name, a) for r in load().readings for a in r.alternatives]
    scores = score_with([sets_of(values) + a.set for _, a in rows], threads, "readings")
    return [(name, a.what, score) for (name, a), score in zip(rows, scores, strict=True)]


def latest(sets: Sequence[str]) -> list[str]:
    """Returns the overrides without repeated names. If a name occurs several times, only its last
    override is kept."""
    return list({text.partition("=")[0]: text for text in sets}.values())


def sets_of(values: Mapping[str, float]) -> list[str]:
    """Returns parameter values as overrides, which are texts "parameter=value"."""
    return [f"{k}={v!r}" for k, v in values.items()]


def criterion_sensitivity(
    cells: Sequence[CellResult], threads: int | None = None
) -> list[Sensitivity]:
    """Returns the effect on the stability tables if a threshold of the verdict is changed by +-20
    %. `cells`: result of run().

    For another window, the cells are simulated again. For another limit of the ripple, the verdicts
    follow from the metrics of the runs in `cells`.
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
        return _core.evaluate(criterion, cell.metrics, cell.fault)[0]

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
    """Returns a hash of all inputs of the fit of the constants: grid, cells, models and
    experiments. The hash does not depend on the fitted values."""
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
        # Descriptions in a file do not affect a simulated run, so the hash leaves them out.
        for table in (experiment, model):
            texts = ("title", "figure", "shows", "plot", "expect")
            digest.update(repr({k: v for k, v in table.items() if k not in texts}).encode())
    return digest.hexdigest()


def fit(threads: int | None = None) -> FitRecord:
    """Searches the grid of tables.toml for the best constants. With these constants, most table
    cells of `fit_on` have the measured verdict. Writes them to tables_fit.json beside tables.toml.

    Cells of the test "contact" are run on every grid point on which they depend. Cells of the test
    "disturbance" are run only where the contact cells have their best score, with or without one
    figure. Then each figure is left out in turn. The constants are fitted to the other figures, and
    predict its cells.
    """
    tables = load()
    grids = [c.grid for c in tables.constants]
    members = {g: [c for c in tables.cells if tables.group(c) == g] for g in tables.groups()}
    # {group of table cells: indices of the constants that affect its verdicts}
    needed = {
        group: [i for i, c in enumerate(tables.constants) if not c.groups or group in c.groups]
        for group in tables.fit_on
    }

    def evaluate(group: str, points: Iterable[Point]) -> dict[Point, int]:
        """Returns the scores {grid point: number of cells with equal verdicts} of one group of
        table cells. A grid point has only the coordinates of those constants that affect the
        group."""
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
        """Returns the grid point with the highest score. If several points have this score, returns
        the point whose neighbours have the highest mean score."""
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
    """Returns the grid points that differ from `point` by at most one step in each constant. Some
    of them may be outside of the grid."""
    steps = [(-1, 0, 1) if len(g) > 1 else (0,) for g in grids]
    return [
        tuple(a + b for a, b in zip(point, step, strict=True)) for step in itertools.product(*steps)
    ]


def evidence() -> FitRecord:
    """Returns the stored fit of the constants. Raises StaleFit if there is none, or if it was made
    with other files."""
    again = "repeat the fit with `fit_tables`, which takes some minutes, and commit the file"
    if not EVIDENCE.exists():
        raise StaleFit(f"{paths.display(EVIDENCE)}: expected the record of a fit; {again}")
    record = json.loads(EVIDENCE.read_text())
    if record["inputs_hash"] != evidence_hash():
        raise StaleFit(
            f"{paths.display(EVIDENCE)}: expected a fit with the present models, experiments and "
            f"grid, the stored fit is stale; {again}"
        )
    return from_json(FitRecord, record, paths.display(EVIDENCE))
