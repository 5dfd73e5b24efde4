"""The 55 measured cells: ours beside the thesis, the fit of the free constants and its sensitivity.

A cell is one experiment file with a gain, a set-point and a workpiece. What the thesis does not
state (the fitted constants) stands in sim/models/thesis.toml like every other parameter;
tables.toml names those constants and the grid on which they were found.
"""

import functools
import hashlib
import itertools
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from forceaxis import _core, paths, toml
from forceaxis.experiments import link
from forceaxis.experiments.verdicts import stability

FILE = paths.EXPERIMENTS / "tables.toml"
EVIDENCE = paths.EXPERIMENTS / "tables_fit.json"


Cell = dict[str, Any]  # a cell of the file that tables.toml names
Job = tuple[str, list[str]]  # experiment file, overrides
Point = tuple[int, ...]  # a number in the grid of each constant


@dataclass(frozen=True)
class Sensitivity:
    """What another value of a threshold of the verdict changes."""

    threshold: str
    factor: float
    value: float
    score: int
    changed: list[str]  # key_of the cells


class StaleFit(Exception):
    """The fit on record does not belong to the present models, experiments or grid."""


@dataclass(frozen=True)
class Constant:
    """A fitted constant: its parameter, the cells that depend on it, and the grid of the search."""

    name: str
    how: str
    groups: tuple[str, ...]  # the groups of cells that depend on it; empty: all
    grid: tuple[float, ...]


@dataclass(frozen=True)
class Tables:
    """tables.toml and the measured cells it names."""

    cells: list[Cell]
    experiments: dict[str, str]  # "test/grip" -> file
    workpieces: dict[str, list[str]]  # name -> overrides
    unstated_setpoint: str  # the parameter that replaces a set-point of null
    constants: list[Constant]
    fit_on: tuple[
        str, ...
    ]  # the groups that the constants are fitted to; all others are predictions
    readings: list[
        dict[str, Any]
    ]  # declared choices, with the alternatives that are reported beside them
    reasons: dict[str, str]  # key_of(cell) -> why this cell is not reproduced
    matched_at_least: int

    def group(self, cell: Cell) -> str:
        """The cells that are omitted together: a figure, contact and disturbance separately.

        The original half of Fig 5.10 is Fig 3.16, so it goes by that name.
        """
        if cell["figure"] != "5.10":
            return str(cell["figure"])
        figure = "3.16" if cell["workpiece"] == "original" else "5.10"
        return f"{figure} {cell['test']}"

    def groups(self) -> list[str]:
        """All groups, in the order of the cells."""
        return list(dict.fromkeys(self.group(c) for c in self.cells))

    def job(self, cell: Cell, constants: dict[str, float] | None = None) -> Job:
        """The (experiment, overrides) pair of a cell; constants: {parameter: value} to try."""
        experiment = self.experiments[f"{cell['test']}/{cell['grip']}"]
        setpoint = cell["force_setpoint"]
        sets = [
            f"firmware.force_gain={cell['force_gain']}",
            f"firmware.force_setpoint={self.unstated_setpoint if setpoint is None else setpoint}",
            *self.workpieces[cell["workpiece"]],
            *sets_of(constants or {}),
        ]
        return str(paths.EXPERIMENTS / experiment), latest(sets)


@functools.cache
def load() -> Tables:
    """Read tables.toml."""
    data = toml.read(FILE)
    cells = json.loads((FILE.parent / data["cells"]).read_text())["cells"]
    return Tables(
        cells=cells,
        experiments=data["experiments"],
        workpieces={
            name: [f"{k}={v}" for k, v in values.items()]
            for name, values in data["workpieces"].items()
        },
        unstated_setpoint=data["unstated_setpoint"],
        constants=[
            Constant(c["name"], c["how"], tuple(c.get("groups", ())), tuple(c["grid"]))
            for c in data["constant"]
        ],
        fit_on=tuple(data["fit_on"]),
        readings=data.get("reading", []),
        reasons=data.get("reasons", {}),
        matched_at_least=data["matched_at_least"],
    )


def parameters() -> dict[str, dict[str, Any]]:
    """The shared parameter file: name -> {value, unit, source}."""
    table: dict[str, dict[str, Any]] = toml.read(paths.MODELS / "thesis.toml")["parameters"]
    return table


def fitted() -> dict[str, float]:
    """The fitted constants' values as the parameter file has them."""
    values = parameters()
    return {c.name: values[c.name]["value"] for c in load().constants}


def run_jobs(
    jobs: Sequence[Job], threads: int | None, title: str, over: link.LinkOptions | None = None
) -> list[dict[str, Any]]:
    """Run (experiment, overrides) pairs, with a progress bar when standard error is a terminal.

    over: a link.LinkOptions; then the firmware is another process and the runs follow each other.
    """
    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task(title, total=len(jobs))

        def progress(done: int, _: int) -> None:
            bar.update(task, completed=done)

        if over and over.kind != "inproc":
            return link.run_many(over, jobs, progress)
        return _core.run_many(jobs, threads or os.cpu_count() or 1, progress)


def key_of(cell: Cell) -> str:
    """A cell in words, also the key of `reasons`."""
    setpoint = cell["force_setpoint"]
    words = [cell["figure"], cell["test"], cell["workpiece"], cell["grip"].replace("_", " ")]
    return f"{', '.join(words)}, gain {cell['force_gain']}, set-point {setpoint or 'not stated'}"


def run(threads: int | None = None, over: link.LinkOptions | None = None) -> dict[str, Any]:
    """Run the cells with the parameter file's constants, over a link.LinkOptions if one is given.

    Returns {"cells": [the measured cell with "ours", "metrics", "fault", "trace_hash"], "matched",
    "total", "fitted": {constant: value}, "overridden": [printed parameters that were changed]}.
    """
    tables = load()
    outcomes = run_jobs([tables.job(c) for c in tables.cells], threads, "tables", over)
    cells = []
    for cell, outcome in zip(tables.cells, outcomes, strict=True):
        keep = ("metrics", "criterion", "fault", "trace_hash")
        ours = stability(outcome["verdict"])  # the thesis knows two words
        cells.append(cell | {"ours": ours} | {k: outcome[k] for k in keep})
        if cell["thesis"] != ours:
            cells[-1]["reason"] = tables.reasons.get(key_of(cell), "not explained")
    # What a cell may set without moving a printed value: the damper and the pad that it names.
    named = {"b_w", "k_g"}
    overridden = {name for o in outcomes for name in o["overridden"]} - named
    return {
        "cells": cells,
        "matched": sum(c["ours"] == c["thesis"] for c in cells),
        "total": len(cells),
        "fitted": fitted(),
        "overridden": sorted(overridden),
    }


def describe(result: dict[str, Any]) -> str:
    """The result for a terminal: one line a row of cells, misses spelled out."""
    lines = []
    for cell in result["cells"]:
        if cell["ours"] == cell["thesis"]:
            continue
        count = cell["force_setpoint"]
        newton = count and count * result["fitted"]["force_per_count"]
        setpoint = f" counts of force ({newton:g} N)" if count else ""
        lines.append(
            f"differs      Fig {key_of(cell)}{setpoint}: thesis {cell['thesis']}, "
            f"ours {cell['ours']}; {cell['reason']}"
        )
    constants = ", ".join(f"{k} = {v:g}" for k, v in result["fitted"].items())
    lines.append(f"fitted       {constants}")
    lines.append(f"score        {result['matched']} of {result['total']} cells match the thesis")
    return "\n".join(lines)


def matches(cells: Sequence[Cell], outcomes: Sequence[dict[str, Any]]) -> NDArray[np.bool_]:
    """Per cell: 1 where ours is the thesis's verdict."""
    pairs = zip(cells, outcomes, strict=True)
    return np.array([stability(o["verdict"]) == c["thesis"] for c, o in pairs])


def score_with(variants: Sequence[Sequence[str]], threads: int | None, title: str) -> list[int]:
    """Score of the tables under each list of extra overrides; one pool of jobs for all."""
    tables = load()
    jobs = [
        (path, latest([*sets, *extra]))
        for extra in variants
        for path, sets in (tables.job(c) for c in tables.cells)
    ]
    outcomes = run_jobs(jobs, threads, title)
    n = len(tables.cells)
    return [
        int(matches(tables.cells, outcomes[i * n : (i + 1) * n]).sum())
        for i in range(len(variants))
    ]


def plateau(
    values: dict[str, float],
    threads: int | None = None,
    steps: Sequence[float] = (0.9, 0.95, 0.975, 1.0, 1.025, 1.05, 1.1),
) -> dict[str, list[list[float]]]:
    """{constant: [[ratio to its value, score], ...]}: one constant moved at a time."""
    pairs = [(name, ratio) for name in values for ratio in steps]
    variants = [sets_of(values | {name: values[name] * ratio}) for name, ratio in pairs]
    scores = score_with(variants, threads, "plateau")
    return {
        name: [[r, s] for (n, r), s in zip(pairs, scores, strict=True) if n == name]
        for name in values
    }


def readings(values: dict[str, float], threads: int | None = None) -> list[list[Any]]:
    """The declared readings' alternatives, each alone: [[reading, alternative, score], ...]."""
    rows = [(r["name"], a["what"], a["set"]) for r in load().readings for a in r["alternatives"]]
    scores = score_with([sets_of(values) + sets for _, _, sets in rows], threads, "readings")
    return [[name, what, s] for (name, what, _), s in zip(rows, scores, strict=True)]


def latest(sets: Sequence[str]) -> list[str]:
    """Overrides with the last value of each name."""
    return list({text.partition("=")[0]: text for text in sets}.values())


def sets_of(values: dict[str, float]) -> list[str]:
    """{parameter: value} as overrides."""
    return [f"{k}={v!r}" for k, v in values.items()]


def criterion_sensitivity(cells: Sequence[Cell], threads: int | None = None) -> list[Sensitivity]:
    """The effect of +-20 % on each threshold: [(threshold, factor, value, score, cells changed)].

    cells: those of run(). The window is varied by running again; ripple thresholds only re-judge.
    """
    rows = []
    base = [c["ours"] for c in cells]
    for factor in (0.8, 1.2):
        verdicts = []
        for c in cells:
            varied = dict(c["criterion"])
            varied["force_ripple_max_count"] *= factor
            verdict, _ = _core.judge(varied, c["metrics"], c["fault"])
            verdicts.append(stability(verdict))
        value = cells[0]["criterion"]["force_ripple_max_count"] * factor
        rows.append(_sensitivity("force_ripple_max_count", factor, value, cells, base, verdicts))
    window = cells[0]["criterion"]["window_s"]
    tables = load()
    for factor in (0.8, 1.2):
        extra = [f"verdict.window_s={window * factor!r}"]
        jobs = [(p, s + extra) for p, s in (tables.job(c) for c in tables.cells)]
        verdicts = [stability(o["verdict"]) for o in run_jobs(jobs, threads, "criterion")]
        rows.append(_sensitivity("window_s", factor, window * factor, cells, base, verdicts))
    return rows


def _sensitivity(
    name: str,
    factor: float,
    value: float,
    cells: Sequence[Cell],
    base: Sequence[str],
    verdicts: Sequence[str],
) -> Sensitivity:
    score = sum(v == c["thesis"] for v, c in zip(verdicts, cells, strict=True))
    changed = [key_of(c) for c, a, b in zip(cells, base, verdicts, strict=True) if a != b]
    return Sensitivity(name, factor, value, score, changed)


def evidence_hash() -> str:
    """Hash of the inputs of the fit: grid, cells, models, experiments; no fitted value."""
    tables = load()
    free = {c.name for c in tables.constants}
    fixed = {k: v["value"] for k, v in parameters().items() if k not in free}
    grid = [(c.name, c.groups, c.grid) for c in tables.constants]
    digest = hashlib.sha256()
    asked = (tables.fit_on, grid, tables.cells, tables.workpieces, tables.readings, fixed)
    digest.update(repr(asked).encode())
    for name in sorted(set(tables.experiments.values())):
        experiment = toml.read(paths.EXPERIMENTS / name)
        model = toml.read(paths.EXPERIMENTS / experiment["model"])
        for table in (experiment, model):  # descriptions do not count
            texts = ("title", "figure", "shows", "plot", "expect")
            digest.update(repr({k: v for k, v in table.items() if k not in texts}).encode())
    return digest.hexdigest()


def fit(threads: int | None = None) -> dict[str, Any]:
    """Search the grid of tables.toml on the cells of `fit_on` and write tables_fit.json beside it.

    Contact cells run on every grid point that they depend on; strikes run where the contact cells,
    all or without one figure, are at their best. Then each figure is omitted in turn, the others
    are fitted again and predict it. Returns the evidence.
    """
    tables = load()
    grids = [c.grid for c in tables.constants]
    names = [c.name for c in tables.constants]
    members = {g: [c for c in tables.cells if tables.group(c) == g] for g in tables.groups()}
    feels = {
        group: [i for i, c in enumerate(tables.constants) if not c.groups or group in c.groups]
        for group in tables.fit_on
    }

    def evaluate(group: str, points: Iterable[Point]) -> dict[Point, int]:
        """{grid coordinates that the group depends on: matches of its cells} for those points."""
        wanted = sorted({tuple(p[i] for i in feels[group]) for p in points})
        jobs = [
            tables.job(cell, {names[i]: grids[i][j] for i, j in zip(feels[group], at, strict=True)})
            for at in wanted
            for cell in members[group]
        ]
        outcomes = run_jobs(jobs, threads, f"fit on Fig {group}")
        n = len(members[group])
        return {
            at: int(matches(members[group], outcomes[k * n : (k + 1) * n]).sum())
            for k, at in enumerate(wanted)
        }

    everywhere = list(itertools.product(*(range(len(g)) for g in grids)))
    late = [g for g in tables.fit_on if g.endswith("disturbance")]
    scores = {g: evaluate(g, everywhere) for g in tables.fit_on if g not in late}

    def total(point: Point, groups: Iterable[str]) -> int:
        return sum(scores[g][tuple(point[i] for i in feels[g])] for g in groups)

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
        """The centre of the best plateau: highest score, then highest mean over its neighbours."""
        score = {p: total(p, groups) for p in points}
        best = max(score.values())

        def around(p: Point) -> float:
            near = [score.get(q, 0) for q in neighbours(p, grids)]
            return sum(near) / len(near)

        return max((p for p in points if score[p] == best), key=lambda p: (around(p), p))

    def values(point: Point) -> dict[str, float]:
        return {n: grids[i][j] for i, (n, j) in enumerate(zip(names, point, strict=True))}

    chosen = choose(tables.fit_on)
    omitted = []
    for figure in figures:
        point = choose(without(figure, tables.fit_on))
        jobs = [tables.job(c, values(point)) for c in tables.cells]
        right = matches(tables.cells, run_jobs(jobs, threads, f"without Fig {figure}"))
        own = [g for g in tables.fit_on if g.split()[0] == figure]
        omitted.append(
            {
                "figure": figure,
                "cells": sum(len(members[g]) for g in own),
                "fitted": values(point),
                "predicted_right": total(point, own),
                "score_on_all": int(right.sum()),
            }
        )
    best = total(chosen, tables.fit_on)
    evidence = {
        "inputs_hash": evidence_hash(),
        "grid": {c.name: list(c.grid) for c in tables.constants},
        "points": len(everywhere),
        "points_with_strikes": len(points),
        "fitted": values(chosen),
        "score": best,
        "cells": sum(len(members[g]) for g in tables.fit_on),
        "points_at_best": sum(total(p, tables.fit_on) == best for p in points),
        "left_out": omitted,
        "plateau": plateau(values(chosen), threads),
        "readings": readings(values(chosen), threads),
    }
    EVIDENCE.write_text(json.dumps(evidence, indent=1) + "\n")
    return evidence


def neighbours(point: Point, grids: Sequence[Sequence[float]]) -> list[Point]:
    """Grid points at most one step away in every constant, those outside the grid included."""
    steps = [(-1, 0, 1) if len(g) > 1 else (0,) for g in grids]
    return [
        tuple(a + b for a, b in zip(point, step, strict=True)) for step in itertools.product(*steps)
    ]


def evidence() -> dict[str, Any]:
    """The fit on record. Raises StaleFit where it does not belong to the present files."""
    again = "run `forceaxis tables --fit`, some minutes, and commit what it writes"
    if not EVIDENCE.exists():
        raise StaleFit(f"{paths.display(EVIDENCE)}: expected the record of a fit; {again}")
    found: dict[str, Any] = json.loads(EVIDENCE.read_text())
    if found["inputs_hash"] != evidence_hash():
        raise StaleFit(
            f"{paths.display(EVIDENCE)}: expected a fit of the present models, experiments and "
            f"grid, this one is stale; {again}"
        )
    return found
