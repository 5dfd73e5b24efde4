"""A measured response and its comparison with the linear model: summary, files and plot."""

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
from matplotlib.figure import Figure

from forceaxis import _core, files, linear, objects, paths
from forceaxis._core import InputError
from forceaxis.identify import measure
from forceaxis.identify.measurement import Comparison, Complexes, Measurement, Readings
from forceaxis.identify.setup import Setup, SetupTable, read_setup
from forceaxis.linear import working
from forceaxis.results import to_json

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

# endings of the names of the two contacts that together form a stop
STOP_CONTACTS = (".low", ".high")


@dataclass(frozen=True)
class MeasurementSummary:
    """A measurement and the linear model of the plant for JSON.

    `contact`: share of the time in which each contact was closed. `floor_median`: median standard
    deviation due to quantisation alone, in the unit of the response. `saturated`: share of the
    samples whose ADC code is at an end of the range.
    """

    measurement: str
    title: str
    figure: str
    model: str
    input: str
    output: str
    unit: str
    inject: str
    excitation: str
    window: str
    level: float
    averages: int
    sampling_hz: float
    band_hz: tuple[float, float]
    coherence_median: float
    random_error_median: float
    floor_median: float
    saturated: float
    contact: dict[str, float]
    hints: list[str]
    comparison: Comparison
    verdict: str
    readings: Readings
    plant_set: dict[str, float | str]
    seed: int
    firmware_hash: str
    simulator_hash: str
    objects_hash: str
    command: str


Summary = TypeVar("Summary", bound="DataclassInstance")


@dataclass(frozen=True)
class MeasurementResult(Generic[Summary]):
    """A measurement, the response of the linear model, and the summary. The summary is a
    MeasurementSummary for a simulated model, or a commission.measuring.AxisMeasurementSummary for a
    real axis."""

    # set-up of the simulated measurement; None for a measurement of a real axis
    setup: Setup | None
    measured: Measurement
    # response (n,) of the linear model with its nominal parameters; None if there is no model
    model: Complexes | None
    summary: Summary
    title: str  # title of the plot


def run(
    target: str | Path,
    options: SetupTable | None = None,
    plant_set: linear.Overrides | None = None,
    command: str = "",
) -> MeasurementResult[MeasurementSummary]:
    """Measures a response, and compares it with the linear model with nominal parameters.
    `command`: command line that repeats the measurement, for the summary. Raises InputError."""
    setup, where = read_setup(target, options)
    measured = measure.measure_setup(setup, where, plant_set)
    model = measured.predict()
    compared = measured.compare(model)
    contacts = {
        name: shares.get("pressed", 0.0)
        for name, shares in measured.states.items()
        if shares.keys() <= {"apart", "pressed", "overlap"} and not name.endswith(STOP_CONTACTS)
    }
    summary = MeasurementSummary(
        measurement=where,
        title=setup.title,
        figure=setup.figure,
        model=paths.display(measured.model),
        input=measured.input,
        output=measured.output,
        unit=measured.unit,
        inject=setup.inject,
        excitation=setup.excitation,
        window=setup.window,
        level=setup.level,
        averages=setup.averages,
        sampling_hz=1 / measured.dt,
        band_hz=(float(measured.frequency_hz[0]), float(measured.frequency_hz[-1])),
        coherence_median=float(np.median(measured.coherence)),
        random_error_median=float(np.median(measured.random_error())),
        floor_median=float(np.median(measured.floor)),
        saturated=measured.saturated,
        contact=contacts,
        hints=hints(setup, measured, contacts),
        comparison=compared,
        verdict="the model fits" if compared.fits else "the model is rejected at 5 %",
        readings=measured.readings(),
        plant_set=dict(plant_set or {}),
        seed=setup.seed,
        firmware_hash=_core.FIRMWARE_HASH,
        simulator_hash=_core.SIMULATOR_HASH,
        objects_hash=objects.OBJECTS_HASH,
        command=command,
    )
    title = setup.title or f"{measured.input} to {measured.output}"
    if setup.figure:
        title = f"Fig {setup.figure}: {title}"
    return MeasurementResult(setup, measured, model, summary, title)


# STUCK_SHARE: largest fraction of the time for which a body sticks and does not count as stuck.
# Every body sticks for a moment when the direction of its motion changes.
STUCK_SHARE = 0.01


def _stuck(setup: Setup, measured: Measurement) -> list[str]:
    """Returns texts about the frictions and backlashes that had another state in the measurement
    than they have in the linear model."""
    assumed = working.working(
        linear.find_model(setup.model), measured.overrides, measured.modes, setup.free
    )
    texts = []
    for name, shares in measured.states.items():
        stuck = shares.get(working.STUCK, 0.0)
        if stuck > STUCK_SHARE and assumed.modes.get(name) == working.SLIDING:
            texts.append(
                f"{name} was stuck {100 * stuck:.3g} % of the time, but the model assumes that it "
                "slides: raise the level until it slides, because a smaller level shows the "
                "friction instead of the plant"
            )
    for name in working.sliders(linear.find_model(setup.model)):
        slips = 1 - measured.states.get(name, {}).get(working.STUCK, 1.0)
        if slips > STUCK_SHARE and assumed.modes.get(name) == working.STUCK:
            texts.append(
                f"{name} slipped {100 * slips:.3g} % of the time, but the model assumes that it "
                "sticks: lower the level until it sticks"
            )
    for name in working.backlashes(linear.find_model(setup.model)):
        flanks = [measured.states.get(name + flank, {}) for flank in working.FLANKS]
        closed = sum(shares.get(working.CLOSED, 0.0) for shares in flanks)
        if closed < 1 - 1e-9 and all(flanks):
            texts.append(
                f"{name} was open {100 * (1 - closed):.3g} % of the time, but the model assumes "
                "that the backlash is closed: press harder by a bias, or lower the level"
            )
    return texts


def hints(setup: Setup, measured: Measurement, contacts: Mapping[str, float]) -> list[str]:
    """Returns texts about possible causes of a difference between the measured response and the
    linear model, except wrong parameters."""
    texts = []
    moves = "lower the level or change the bias"
    for name, share in contacts.items():
        if setup.free and share > 0:
            known = linear.facts(setup.model, measured.overrides).parameters
            apart = "start further apart (approach = 0.5, m), " if "approach" in known else ""
            texts.append(
                f"{name} was pressed {100 * share:.3g} % of the time, but the model assumes that "
                f"it is apart: {apart}{moves}"
            )
        if not setup.free and share < 1:
            texts.append(
                f"{name} was apart {100 * (1 - share):.3g} % of the time, but the model assumes "
                "that it is pressed: press harder by a bias, lower the level, or measure with "
                "clamped or free contacts"
            )
    texts += _stuck(setup, measured)
    for name, shares in measured.states.items():
        limit = sum(share for state, share in shares.items() if "limit" in state)
        if name.startswith("drive.") and limit > 0:
            texts.append(f"{name} was at its limit {100 * limit:.3g} % of the time: {moves}")
    if measured.input_bias > np.median(measured.random_error()) / 3:
        texts.append(
            f"rounding and noise of the input {measured.input} make the response up to "
            f"{100 * measured.input_bias:.2g} % too small, which the 95 % band does not contain: "
            "raise the level, or use the injected signal as input"
        )
    return texts


def figure(done: MeasurementResult[Summary]) -> Figure:
    """Returns a plot of the measured response and the response of the linear model."""
    from forceaxis.identify import plots

    return plots.response(done.measured, done.model, done.title)


def amplitude_of(folder: Path) -> float | None:
    """Returns the amplitude of the excitation in DAC codes with which a live axis was measured, or
    None if `folder` has no such measurement."""
    file = folder / "result.json"
    try:
        summary = files.read_json(file, "the summary of a measurement", has_constants=True)
    except (OSError, InputError):
        return None
    amplitude = summary.get("amplitude")
    return float(amplitude) if isinstance(amplitude, int | float) else None


def write(done: MeasurementResult[Summary], out: Path, draw: bool = True) -> None:
    """Writes response.csv, response.npz and result.json to the folder `out`. With `draw`, plot.png
    is also written."""
    measured = done.measured
    columns = {
        "frequency_hz": measured.frequency_hz,
        "magnitude": abs(measured.response),
        "phase_deg": np.degrees(np.angle(measured.response)),
        "coherence": measured.coherence,
        "band": measured.radius(),
        "random_error": measured.random_error(),
        "floor": measured.floor,
    }
    arrays_of_model: dict[str, Complexes] = {}
    if done.model is not None:
        degrees = np.degrees(np.angle(done.model))
        columns |= {"model_magnitude": abs(done.model), "model_phase_deg": degrees}
        arrays_of_model = {"model": done.model}
    # Fields of the Measurement that are not arrays. The function `fit.read_response` reads them.
    about = {k: v for k, v in vars(measured).items() if not isinstance(v, np.ndarray)}
    names = ["response.csv", "response.npz", "result.json", *["plot.png"] * draw]
    with paths.replacing(out, *names) as (table, arrays, result, *pictures):
        with table.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
        with arrays.open("wb") as file:
            np.savez_compressed(
                file,
                **columns,  # type: ignore[arg-type]
                response=measured.response,
                variance=measured.variance,
                **arrays_of_model,  # type: ignore[arg-type]
                about=json.dumps(about),
            )
        for picture in pictures:
            figure(done).savefig(picture, dpi=120, format="png")
        result.write_text(json.dumps(to_json(done.summary), indent=2) + "\n")
