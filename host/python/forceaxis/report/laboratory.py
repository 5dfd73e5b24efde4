"""Sections of the thesis's page only: its tables, fit, models by figure, frequency domain."""

import os
import re
from collections.abc import Mapping, Sequence
from multiprocessing.pool import AsyncResult, Pool
from pathlib import Path
from typing import Any

from markupsafe import Markup

from forceaxis import _core, paths, progress, toml
from forceaxis.design import advice_plot, advise
from forceaxis.experiments import sweep as sweeps
from forceaxis.experiments import sweep_plots
from forceaxis.identify import result as measure_result
from forceaxis.linear import beam, modes
from forceaxis.report import designs, pictures, plots
from forceaxis.report.axes import limits
from forceaxis.report.folder import Entry, figure_order
from forceaxis.results import to_json
from forceaxis.thesis import claims as thesis
from forceaxis.thesis import figures as thesis_figures
from forceaxis.thesis import nonlinear, tables
from forceaxis.thesis.tables import Cell

Values = dict[str, Any]  # {name in a template: value}
WIDE_IN = 6.0  # a wider figure has its own line


def models(entries: Sequence[Entry]) -> list[Values]:
    """Every model of the experiments, in the order of its figure."""
    users: dict[Path, list[Entry]] = {}
    for entry in entries:
        users.setdefault(entry.done.model, []).append(entry)
    rows = []
    for path, used_by in users.items():
        text = toml.read(path)
        figure = re.search(r"Figs? (\S+)", text.get("title", ""))
        row: Values = {
            "name": path.stem,
            "title": text.get("title", path.stem),
            "shows": text.get("shows", ""),
            "runs": used_by,
        }
        row["order"] = (figure_order(figure[1] if figure else ""), path.stem)
        row["limits"] = limits(path)
        rows.append(row)
    return sorted(rows, key=lambda r: r["order"])


def grid_3_15(cells: Sequence[Cell]) -> Values:
    """Fig 3.15: rows of gains, columns of set-points."""
    cells = [c for c in cells if c["figure"] == "3.15"]
    gains = sorted({c["force_gain"] for c in cells})
    setpoints = sorted({c["force_setpoint"] for c in cells})
    at = {(c["force_gain"], c["force_setpoint"]): c for c in cells}
    return {
        "title": "Figure 3.15: contact",
        "columns": [f"set-point {s}" for s in setpoints],
        "rows": [(f"gain {g}", [at[g, s] for s in setpoints]) for g in gains],
    }


def grid_5_10(cells: Sequence[Cell]) -> Values:
    """Fig 5.10 (its first and third columns are Fig 3.16): rows of gains."""
    cells = [c for c in cells if c["figure"] == "5.10"]
    columns = list(dict.fromkeys((c["test"], c["workpiece"]) for c in cells))
    at = {(c["force_gain"], c["test"], c["workpiece"]): c for c in cells}
    return {
        "title": "Figures 3.16 and 5.10: contact and disturbance",
        "columns": [f"{test}, {workpiece}" for test, workpiece in columns],
        "rows": [
            (f"gain {g}", [at[g, *column] for column in columns])
            for g in sorted({c["force_gain"] for c in cells})
        ],
    }


def grid_rest(cells: Sequence[Cell]) -> Values:
    """Figs 5.2, 5.3, 5.8, 5.9: one cell each."""
    cells = [c for c in cells if c["figure"] not in ("3.15", "5.10")]
    rows = [
        (
            f"Fig {c['figure']}, {c['workpiece']}, {c['grip'].replace('_', ' ')}, "
            f"gain {c['force_gain']}, set-point {c['force_setpoint']}",
            [c],
        )
        for c in cells
    ]
    return {
        "title": "Figures 5.2, 5.3, 5.8, 5.9: single cells",
        "columns": ["contact"],
        "rows": rows,
    }


def mode_rows() -> list[tuple[str, str, list[str]]]:
    """(model, its lowest mode, [other modes with their labels]) of each model with a force path."""
    rows = []
    for path in sorted(paths.MODELS.glob("*.toml"), key=lambda p: p.stem):
        try:
            found = modes.modes(path)
        except _core.InputError:  # the file has only parameters, or the model has no drive
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


def begin(pool: Pool) -> dict[str, list[AsyncResult[Any]] | AsyncResult[Any]]:
    """Submits the computations of the frequency domain to `pool`, for `ended`."""
    measurements = sorted(
        paths.MEASUREMENTS.glob("*.toml"), key=lambda p: figure_order(p.stem[3:].replace("_", "."))
    )
    figures = range(len(thesis_figures.thesis_figures()))
    return {
        "designs": [pool.apply_async(designs.row, plant) for plant in designs.PLANTS],
        "advice": pool.apply_async(advised),
        "claims": pool.apply_async(thesis.check),
        "modes": pool.apply_async(mode_rows),
        "measurements": [pool.apply_async(measured, [path]) for path in measurements],
        "figures": [pool.apply_async(thesis_figure, [number]) for number in figures],
    }


def ended(begun: Mapping[str, list[AsyncResult[Any]] | AsyncResult[Any]]) -> Values:
    """The values of the page frequency.html.jinja."""
    found = {
        name: [one.get() for one in progress.each(work, name)]
        if isinstance(work, list)
        else work.get()
        for name, work in begun.items()
    }
    advice, advice_image = found.pop("advice")
    return found | {
        "value": thesis.value,
        "beam": [e for e in beam.Beam(1.0, 1.0, 1.0).approximation_errors() if e.modes % 4 == 0],
        "designs_image": pictures.figure(designs.figure(found["designs"])),
        "advice": advice,
        "advice_image": advice_image,
    }


def measured(path: Path) -> Values:
    """Measures and draws a measurement of the thesis."""
    done: Any = measure_result.run(path)
    image = pictures.figure(measure_result.figure(done))
    summary = to_json(done.summary)
    return {"name": path.stem, "shows": done.setup.shows, "summary": summary, "image": image}


def thesis_figure(number: int) -> Values:
    """Draws a figure of the thesis."""
    drawn = thesis_figures.thesis_figures()[number]
    picture = drawn.draw()
    wide = picture.get_figwidth() > WIDE_IN
    image = pictures.figure(picture)
    return {"figure": drawn.figure, "see": drawn.see, "wide": wide, "image": image}


def advised() -> tuple[advise.Advice, Markup]:
    """(advice for the laboratory's axis, its picture)."""
    advice = advise.advise(advise.AdviceOrder("laboratory", threads=1))
    return advice, pictures.figure(advice_plot.figure(advice))


def check() -> None:
    """Raises InputError if the stored results of the fit cannot be read."""
    tables.evidence()


# For one axis: the fault and its remedy, as (experiment, heading, reason).
STORY = (
    ("contact_unstable", "1. Force gain 10: it bounces for ever",
     "The arm bends, the sensor rings, and the contact is lost again and again."),
    ("contact", "2. Force gain 5: it settles, short of the set-point",
     "Half the gain ends the bouncing; a law of gain alone cannot hold the force asked for."),
    ("hold_biquad", "3. A designed law: the force is held",
     "An integral and one filter section, designed for a set of workpieces."),
)  # fmt: skip


def story(entries: Sequence[Entry]) -> list[tuple[Entry, str, str]]:
    """[(Entry, heading, reason)] of STORY."""
    by_name = {e.name: e for e in entries}
    return [(by_name[name], what, why) for name, what, why in STORY]


def by_model(entries: Sequence[Entry]) -> Values:
    """The models of the experiments: those of the machines of the thesis, and those of single
    elements."""
    done = [e for e in entries if e.done]
    elements = [e for e in done if e.done.model.stem.startswith("nl_")]
    return {
        "story": story(done),
        "models": models([e for e in done if e not in elements]),
        "element_models": models(elements),
    }


def values(threads: int | None = None) -> Values:
    """Run tables, maps and sweeps: the values of laboratory.html.jinja."""
    found = tables.evidence()
    result = tables.run(threads)
    maps = nonlinear.contact_maps(threads or os.cpu_count() or 1)
    friction = nonlinear.friction_limits(threads or os.cpu_count() or 1)
    grid = {"firmware.force_gain": "1:20:20", "firmware.force_setpoint": "4:64:16"}
    request = sweeps.SweepRequest(paths.EXPERIMENTS / "contact.toml", grid)
    stability_map = sweeps.sweep(request, threads=threads)
    parameters = tables.parameters()
    constants = [
        {
            "name": c.name,
            "value": parameters[c.name]["value"],
            "unit": parameters[c.name]["unit"],
            "how": c.how,
            "groups": ", ".join(c.groups) or "all cells",
            "grid": c.grid,
            "found": found["fitted"][c.name],
            "plateau": dict(found["plateau"][c.name]),
        }
        for c in tables.load().constants
    ]
    assumed = [
        {"name": n, **v}
        for n, v in parameters.items()
        if not (v["source"].startswith("Fig") or n in result["fitted"])
    ]
    predicted = []
    for figure in dict.fromkeys(c["figure"] for c in result["cells"]):
        own = [c for c in result["cells"] if c["figure"] == figure]
        if not any(tables.load().group(c) in tables.load().fit_on for c in own):
            predicted.append((figure, len(own), sum(c["ours"] == c["thesis"] for c in own)))
    return dict(
        result=result,
        grids=[grid_3_15(result["cells"]), grid_5_10(result["cells"]), grid_rest(result["cells"])],
        misses=[(tables.key_of(c), c) for c in result["cells"] if c["ours"] != c["thesis"]],
        constants=constants,
        assumed=assumed,
        found=found,
        predicted=predicted,
        plateau=pictures.figure(
            plots.plateau(found["plateau"], result["matched"], "cells matched")
        ),
        criterion=result["cells"][0]["criterion"],
        sensitivity=tables.criterion_sensitivity(result["cells"], threads),
        readings=found["readings"],
        declared=tables.load().readings,
        stability_map=pictures.figure(sweep_plots.sweep(stability_map)),
        maps=maps,
        maps_image=pictures.figure(plots.contact_maps(maps, nonlinear.GAINS, nonlinear.GAPS)),
        friction=friction,
    )
