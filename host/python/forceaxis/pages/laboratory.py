"""The sections of the report about the thesis: stability tables, fit, models by figure, and
frequency domain. Templates use the names of the dataclass fields."""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.pool import AsyncResult, Pool
from pathlib import Path

from markupsafe import Markup

from forceaxis import _core, paths, toml
from forceaxis.design import advise
from forceaxis.experiments import sweep as sweeps
from forceaxis.experiments import sweep_plots
from forceaxis.experiments.run_result import Criterion
from forceaxis.identify import result as measure_result
from forceaxis.linear import beam, modes
from forceaxis.pages import axes, design_plots, folder, pictures, plant_designs, plots
from forceaxis.pages.folder import Entry, figure_order
from forceaxis.thesis import claims as thesis
from forceaxis.thesis import figures as thesis_figures
from forceaxis.thesis import nonlinear, tables, trials
from forceaxis.thesis.tables import CellResult

WIDE_IN = 6.0  # A plot that is wider than this, in inches, has its own row on the page.


@dataclass(frozen=True)
class ModelRow:
    """A model of the thesis with its critical gains and its experiments."""

    name: str
    title: str
    shows: str
    # critical values of `force_gain` as texts; None if the model has no force loop
    limits: list[str] | None
    runs: list[Entry]


def models(entries: Sequence[Entry]) -> list[ModelRow]:
    """Returns one row for each model of the experiments, in the order of the figure numbers of the
    thesis."""
    rows = {}
    for path, runs in axes.by_model(entries).items():
        text = toml.read(path)
        title = text.get("title", path.stem)
        figure = re.search(r"Figs? (\S+)", title)
        order = (figure_order(figure[1] if figure else ""), path.stem)
        rows[order] = ModelRow(path.stem, title, text.get("shows", ""), axes.limits(path), runs)
    return [rows[order] for order in sorted(rows)]


@dataclass(frozen=True)
class CellGrid:
    """A stability table of the thesis, as rows {title of a row: cells of the row}."""

    title: str
    columns: list[str]
    rows: dict[str, list[CellResult]]


def grid_3_15(cells: Sequence[CellResult]) -> CellGrid:
    """Returns the stability table of Fig 3.15. Rows are gains, and columns are set-points."""
    at = {(c.force_gain, c.force_setpoint): c for c in cells if c.figure == "3.15"}
    gains = sorted({gain for gain, _ in at})
    setpoints = sorted({setpoint for _, setpoint in at if setpoint is not None})
    return CellGrid(
        title="Figure 3.15: contact",
        columns=[f"set-point {s}" for s in setpoints],
        rows={f"gain {g}": [at[g, s] for s in setpoints] for g in gains},
    )


def grid_5_10(cells: Sequence[CellResult]) -> CellGrid:
    """Returns the stability table of Fig 5.10. Its rows are gains. Its first and third columns are
    also Fig 3.16."""
    at = {(c.force_gain, c.test, c.workpiece): c for c in cells if c.figure == "5.10"}
    columns = list(dict.fromkeys((test, workpiece) for _, test, workpiece in at))
    return CellGrid(
        title="Figures 3.16 and 5.10: contact and disturbance",
        columns=[f"{test}, {workpiece}" for test, workpiece in columns],
        rows={
            f"gain {g}": [at[g, test, workpiece] for test, workpiece in columns]
            for g in sorted({gain for gain, _, _ in at})
        },
    )


def grid_rest(cells: Sequence[CellResult]) -> CellGrid:
    """Returns the stability tables of Figs 5.2, 5.3, 5.8 and 5.9. Each of these figures has only
    one cell."""
    rows = {
        f"Fig {c.figure}, {c.workpiece}, {c.grip.replace('_', ' ')}, "
        f"gain {c.force_gain}, set-point {c.force_setpoint}": [c]
        for c in cells
        if c.figure not in ("3.15", "5.10")
    }
    return CellGrid("Figures 5.2, 5.3, 5.8, 5.9: single cells", ["contact"], rows)


def mode_rows() -> list[tuple[str, str, list[str]]]:
    """Returns one row for each model whose drive acts on the force: the model, its lowest mode of
    vibration, and its other modes of vibration with their labels."""
    rows = []
    for path in sorted(paths.MODELS.glob("*.toml"), key=lambda p: p.stem):
        try:
            found = modes.modes(path)
        # The file contains only parameters, or its model has no drive.
        except _core.InputError:
            continue
        if not found.has_path or found.contact == "apart":
            continue
        lowest, *others = found.modes
        texts = []
        for mode in others:
            label = mode.label
            if mode.against_below != label:
                label += f", {mode.against_below} against the mode below"
            texts.append(f"{mode.largest_body} {mode.frequency_hz:.3g} Hz: {label}")
        rows.append((path.stem, f"{lowest.frequency_hz:.3g} Hz", texts))
    return rows


@dataclass(frozen=True)
class MeasuredFigure:
    """A measurement of the thesis, repeated with the simulated plant."""

    name: str
    shows: str
    summary: measure_result.MeasurementSummary
    image: Markup


@dataclass(frozen=True)
class DrawnFigure:
    """A plot of the thesis that is drawn from a model."""

    figure: str
    see: str
    wide: bool  # True if the plot has its own row on the page of the report
    image: Markup


@dataclass(frozen=True)
class FrequencySection:
    """The section of the report about the frequency domain. It has bandwidths, modes of vibration
    and frequency responses."""

    designs: list[plant_designs.PlantDesign]
    designs_image: Markup
    advice: advise.Advice
    advice_image: Markup
    claims: thesis.CheckedClaims
    # function that returns, as text, the value of a claim about the thesis
    value: Callable[[float | str, str], str]
    modes: list[tuple[str, str, list[str]]]
    measurements: list[MeasuredFigure]
    figures: list[DrawnFigure]
    beam: list[beam.ApproximationError]


@dataclass(frozen=True)
class FrequencyJobs:
    """Computations for the section on the frequency domain, which run in the worker processes of a
    pool."""

    designs: list[AsyncResult[plant_designs.PlantDesign]]
    advice: AsyncResult[tuple[advise.Advice, Markup]]
    claims: AsyncResult[thesis.CheckedClaims]
    modes: AsyncResult[list[tuple[str, str, list[str]]]]
    measurements: list[AsyncResult[MeasuredFigure]]
    figures: list[AsyncResult[DrawnFigure]]

    @classmethod
    def start(cls, pool: Pool) -> "FrequencyJobs":
        """Starts all computations for the section on the frequency domain."""
        measurements = sorted(
            paths.MEASUREMENTS.glob("*.toml"),
            key=lambda p: figure_order(p.stem[3:].replace("_", ".")),
        )
        figures = range(len(thesis_figures.thesis_figures()))
        return cls(
            designs=[
                pool.apply_async(plant_designs.plant_design, plant)
                for plant in plant_designs.PLANTS
            ],
            advice=pool.apply_async(advised),
            claims=pool.apply_async(thesis.check),
            modes=pool.apply_async(mode_rows),
            measurements=[pool.apply_async(measured, [path]) for path in measurements],
            figures=[pool.apply_async(thesis_figure, [number]) for number in figures],
        )

    def section(self) -> FrequencySection:
        """Waits for the results of all computations, and returns the section on the frequency
        domain."""
        rows = folder.results(self.designs, "designs")
        advice, advice_image = self.advice.get()
        errors = beam.Beam(1.0, 1.0, 1.0).approximation_errors()
        return FrequencySection(
            designs=rows,
            designs_image=pictures.figure(plant_designs.figure(rows)),
            advice=advice,
            advice_image=advice_image,
            claims=self.claims.get(),
            value=thesis.value,
            modes=self.modes.get(),
            measurements=folder.results(self.measurements, "measurements"),
            figures=folder.results(self.figures, "figures"),
            beam=[e for e in errors if e.modes % 4 == 0],
        )


def measured(path: Path) -> MeasuredFigure:
    """Repeats a measurement of the thesis with the simulated plant, and draws the measured
    response."""
    done = measure_result.run(path)
    assert done.setup is not None
    image = pictures.figure(measure_result.figure(done))
    return MeasuredFigure(path.stem, done.setup.shows, done.summary, image)


def thesis_figure(number: int) -> DrawnFigure:
    """Draws the plot of the thesis with the index `number`."""
    found = thesis_figures.thesis_figures()[number]
    drawn = found.draw()
    wide = drawn.get_figwidth() > WIDE_IN
    return DrawnFigure(found.figure, found.see, wide, pictures.figure(drawn))


def advised() -> tuple[advise.Advice, Markup]:
    """Returns the advice for the laboratory's axis, and a plot of it. The advice states how much
    each change improves the axis."""
    advice = advise.advise(advise.AdviceOrder("laboratory", threads=1))
    return advice, pictures.figure(design_plots.advice(advice))


# (experiment, heading, reason) of each step in the design of the example axis
STORY = (
    ("contact_unstable", "1. Force gain 10: it bounces for ever",
     "The arm bends, the sensor rings, and the contact is lost again and again."),
    ("contact", "2. Force gain 5: it settles, short of the set-point",
     "Half the gain ends the bouncing; a law of gain alone cannot hold the force asked for."),
    ("hold_biquad", "3. A designed law: the force is held",
     "An integral and one filter section, designed for a set of workpieces."),
)  # fmt: skip


@dataclass(frozen=True)
class ModelsSection:
    """The sections of the report about the example axis and about all models of the thesis."""

    # (experiment, heading, reason) of each step in the design of the example axis
    story: list[tuple[Entry, str, str]]
    models: list[ModelRow]  # models of the machines in the thesis
    element_models: list[ModelRow]  # models of single elements


def models_section(entries: Sequence[Entry]) -> ModelsSection:
    """Returns the sections of the report about the models that the experiments use."""
    done = [e for e in entries if e.done]
    elements = [e for e in done if e.run.model.stem.startswith("nl_")]
    by_name = {e.name: e for e in done}
    return ModelsSection(
        story=[(by_name[name], heading, reason) for name, heading, reason in STORY],
        models=models([e for e in done if e not in elements]),
        element_models=models(elements),
    )


@dataclass(frozen=True)
class FittedConstant:
    """A constant of the model that is fitted to the stability tables, and the result of its fit."""

    constant: tables.Constant
    parameter: tables.SourcedParameter
    found: float  # value of the constant in the stored fit
    # {ratio to the fitted value: number of table cells with equal verdicts}
    plateau: dict[float, int]


@dataclass(frozen=True)
class TablesSection:
    """The sections of the report about the stability tables, about the fit of the constants, about
    contact, and about friction."""

    result: tables.TablesResult
    grids: list[CellGrid]
    # table cells whose simulated verdict differs from the measured verdict of the thesis
    misses: list[tuple[str, CellResult]]
    # trials that could explain the different verdicts of these table cells
    trials: trials.TrialsResult
    constants: list[FittedConstant]
    assumed: list[tuple[str, tables.SourcedParameter]]
    found: tables.FitRecord
    # (figure, number of cells in it, number of correct predictions) for each fit without one figure
    predicted: list[tuple[str, int, int]]
    plateau: Markup
    criterion: Criterion
    sensitivity: list[tables.Sensitivity]
    declared: list[tables.Reading]
    stability_map: Markup
    maps: list[nonlinear.ContactMap]
    maps_image: Markup
    # (Coulomb force in N, gain) for each force; see nonlinear.friction_limits()
    friction: list[tuple[float, float]]


def tables_section(threads: int | None = None) -> TablesSection:
    """Simulates the stability tables, the tables of limit cycles over gain and gap, and the sweep
    of the laboratory's axis. Returns their sections of the report."""
    found, known = tables.evidence(), tables.load()
    result = tables.run(threads)
    maps = nonlinear.contact_maps(threads or os.cpu_count() or 1)
    friction = nonlinear.friction_limits(threads or os.cpu_count() or 1)
    grid = {"firmware.force_gain": "1:20:20", "firmware.force_setpoint": "4:64:16"}
    request = sweeps.SweepRequest(paths.EXPERIMENTS / "contact.toml", grid)
    stability_map = sweeps.sweep(request, threads=threads)
    parameters = tables.parameters()
    predicted = []
    for figure in dict.fromkeys(c.figure for c in result.cells):
        own = [c for c in result.cells if c.figure == figure]
        if not any(known.group(c) in known.fit_on for c in own):
            predicted.append((figure, len(own), sum(c.agrees for c in own)))
    score_curves = plots.plateau(found.plateau, result.matched, "cells matched")
    return TablesSection(
        result=result,
        grids=[grid_3_15(result.cells), grid_5_10(result.cells), grid_rest(result.cells)],
        misses=[(tables.key_of(c), c) for c in result.cells if not c.agrees],
        trials=trials.run(result.cells, threads),
        constants=[
            FittedConstant(c, parameters[c.name], found.fitted[c.name], dict(found.plateau[c.name]))
            for c in known.constants
        ],
        assumed=[
            (name, p)
            for name, p in parameters.items()
            if not (p.source.startswith("Fig") or name in result.fitted)
        ],
        found=found,
        predicted=predicted,
        plateau=pictures.figure(score_curves),
        criterion=result.cells[0].criterion,
        sensitivity=tables.criterion_sensitivity(result.cells, threads),
        declared=known.readings,
        stability_map=pictures.figure(sweep_plots.sweep(stability_map)),
        maps=maps,
        maps_image=pictures.figure(plots.contact_maps(maps, nonlinear.GAINS, nonlinear.GAPS)),
        friction=friction,
    )
