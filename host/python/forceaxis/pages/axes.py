"""The sections of the report about models: a description, critical gains, the P gain for a set of
plants, and the worst margins of the designed filter banks."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from forceaxis import _core, paths, toml
from forceaxis.design import reduced, sets
from forceaxis.design.certificate import WorstFigures
from forceaxis.design.changes import Design
from forceaxis.design.grid import goal_of_noise
from forceaxis.experiments import sweep, sweep_plots
from forceaxis.experiments.inputs import read_inputs
from forceaxis.linear import curves, loops, modes, plots, settings, stability, working
from forceaxis.linear import system as linear
from forceaxis.linear.bank import Bank
from forceaxis.linear.limits import hz_text
from forceaxis.linear.request import LoopRequest
from forceaxis.pages import pictures
from forceaxis.pages.folder import Entry
from forceaxis.words import plain

Picture = tuple[str, Markup]  # (caption, image)

# Largest number of experiments up to which the report shows all plots at once.
SHOWN_EXPERIMENTS_MAX = 6
# Factors of the gain and of the set-point in the plot of verdicts over gain and set-point.
# MAP_TICKS_MAX: length in ticks of the longest run for which this plot is drawn.
MAP_GAIN_FACTORS = (0.5, 0.8, 1.25, 2.0, 3.2, 5.0)
MAP_SETPOINT_FACTORS = (0.3, 0.6, 1.0, 1.5, 2.2)
MAP_TICKS_MAX = 12_000


@dataclass(frozen=True)
class ExperimentBank:
    """The designed filter bank of an experiment, with its worst bandwidth and margins over the set
    of plants. `worst` is None if a plant of the set is unstable with this filter bank."""

    entry: Entry
    bank: Bank
    worst: WorstFigures | None


@dataclass(frozen=True)
class ModelLaws:
    """The recommended P gain of a model, and the filter banks of all its experiments. Gain and
    filter banks are evaluated over a set of plants."""

    over: str  # text that states the ranges of the parameters in the set of plants
    p: reduced.ShortDesign
    banks: list[ExperimentBank]


@dataclass(frozen=True)
class ModelSection:
    """The section of the report about one model."""

    id: str  # HTML anchor of the section
    file: str
    title: str
    words: list[str]  # sentences about the model
    # critical values of `force_gain` as texts; None if the model has no force loop
    limits: list[str] | None
    laws: ModelLaws | None
    refused: str  # reason why `laws` is None
    pictures: list[Picture]


def limits(model: Path) -> list[str] | None:
    """Returns the critical values of `force_gain` as texts, one for each delay of the loop (zoh and
    zoh+1). Returns None if the model has no force loop."""
    try:
        found = [loops.force_loop(model, timing=timing) for timing in loops.TIMINGS]
    # A model has no force loop without a force sensor, or if the command does not act on the force.
    except _core.InputError:
        return None
    return [limit_text(loop) for loop in found]


def limit_text(loop: stability.Loop) -> str:
    """Returns the critical gain of a force loop as text, in DAC codes per 8-bit count of force."""
    limit = loop.limit()
    if limit.gain is not None:
        gain = plain(loop.firmware_gain(limit.gain))
        return gain if limit.gain == 0 else f"{gain} {hz_text(limit.frequency_hz, 3)}"
    if limit.known_to is None:
        return "none"
    return f"none up to {stability.known_text(loop.firmware_gain(limit.known_to), '')}"


def by_model(entries: Sequence[Entry]) -> dict[Path, list[Entry]]:
    """Returns {model file: its experiments}. Only experiments that ran without error are
    included."""
    found: dict[Path, list[Entry]] = {}
    for entry in entries:
        if entry.done:
            found.setdefault(entry.done.model, []).append(entry)
    return found


def sections(entries: Sequence[Entry]) -> list[ModelSection]:
    """Returns one section of the report for each model that the experiments use."""
    with_pictures = len(entries) <= SHOWN_EXPERIMENTS_MAX
    return [_section(model, own, with_pictures) for model, own in by_model(entries).items()]


def _section(model: Path, entries: Sequence[Entry], with_pictures: bool) -> ModelSection:
    refused, found = "", None
    try:
        found = laws(model, entries)
    except _core.InputError as error:
        refused = str(error)
    pictures_shown = []
    if with_pictures:
        pictures_shown = [*(_margins(model, found.p) if found else ()), *_map(entries)]
    return ModelSection(
        id="model_" + re.sub(r"\W", "_", paths.display(model)),
        file=paths.display(model),
        title=toml.read(model).get("title", model.stem),
        words=words(model),
        limits=limits(model),
        laws=found,
        refused=refused,
        pictures=pictures_shown,
    )


def _margins(model: Path, recommended: reduced.ShortDesign) -> list[Picture]:
    """Returns [(caption, image)] of the Nyquist plot with the recommended P gain. The list is empty
    if there is no recommended gain."""
    if not recommended.worst:
        return []
    gain = recommended.bank.force_gain
    try:
        found = curves.nyquist_of(
            LoopRequest(str(model), law="p", timing="zoh", firmware_gain=gain)
        )
    # The command does not act on the force in this combination of states of the model's elements.
    except _core.InputError:
        return []
    margins = found.at.margins
    phase = margins.phase_margin_deg
    margin = "" if phase is None else f", phase {phase:.3g}\u00b0"
    factor = "none" if margins.gain_margin is None else plain(margins.gain_margin)
    if margins.known_to is not None:
        factor += f" up to {stability.known_text(margins.known_to, '')}"
    caption = f"The model as it is, at this gain: gain margin {factor}{margin}."
    return [(caption, pictures.figure(plots.nyquist_figure(found)))]


def _map(entries: Sequence[Entry]) -> list[Picture]:
    """Returns [(caption, image)] of a plot of verdicts, as colours over gain and set-point. It is
    drawn for the first short experiment with a P law. The list is empty without such an
    experiment."""
    for entry in entries:
        given = read_inputs(entry.file).firmware
        gain, setpoint = given.get("force_gain"), given.get("force_setpoint")
        result = entry.run.result
        if not (gain and setpoint) or given.get("force_bank") or "mode" not in given:
            continue
        if result.ticks > MAP_TICKS_MAX or result.criterion is None:
            continue
        grid = {
            "firmware.force_gain": [round(256 * gain * f) / 256 for f in MAP_GAIN_FACTORS],
            "firmware.force_setpoint": [
                round(256 * setpoint * f) / 256 for f in MAP_SETPOINT_FACTORS
            ],
        }
        done = sweep.sweep(sweep.SweepRequest(entry.file, grid=grid), threads=1)
        caption = f"Stability of {entry.name} over gain and set-point; A sweep makes finer ones."
        return [(caption, pictures.figure(sweep_plots.sweep(done)))]
    return []


def words(model: Path) -> list[str]:
    """Returns sentences that describe a model: bodies, drive, contacts, sensor and modes of
    vibration."""
    facts, text = linear.facts(model), model.read_text(encoding="utf-8")
    masses = ", ".join(f"{name} {kg:.4g} kg" for name, kg in facts.masses_kg.items())
    lines = [f"Bodies: {masses}."] if masses else []
    lines += [
        f"Structure {s.name}: {len(s.shapes)} modes at the ports {', '.join(s.ports)}."
        for s in facts.structures
    ]
    if drive := facts.drive:
        lines.append(f"Drive {drive.type.replace('_', ' ')} on {drive.body}.")
        if drive.loop_text:
            lines.append(f"Velocity loop of the drive: {drive.loop_text}.")
    if mode := working.working(model).text:
        lines.append(f"Linear figures are for {mode}.")
    for contact in facts.contacts:
        lines.append(f"Contact {contact.name} between {' and '.join(contact.between)}.")
    if reading := facts.reading:
        unit = facts.signals.get(reading.signal, "")
        lines.append(
            f"The firmware reads {reading.signal} with {reading.bits} bits, "
            f"{abs(reading.per_count) * 2 ** (8 - reading.bits):.3g} {unit} a code."
        )
    try:
        found = modes.modes(model).modes
    except _core.InputError:
        found = []
    if found:
        lines.append(f"Modes at {', '.join(format(m.frequency_hz, '.3g') for m in found)} Hz.")
    if defaults := text.count("default, check"):
        lines.append(f'{defaults} values are defaults: look for "default, check" in the file.')
    return lines


def laws(model: Path, entries: Sequence[Entry]) -> ModelLaws:
    """Returns the P gain that keeps the usual margins over the set of plants, with the bound at
    high frequency that follows from the noise of the model, as for a new axis. Also returns the
    worst margins over this set for the filter bank of each experiment. Raises InputError, for
    example if the model has no sensor."""
    plants = sets.plant_set(str(model))
    facts = linear.facts(model)
    bits = facts.required_reading.bits
    with Design(str(model)) as plant:
        goal = goal_of_noise(bits, plant.noise_codes(bits))
    search = reduced.ShortSearch(plants, goal, random=0)
    recommended = search.worst(Bank(1.0))
    banks = []
    for entry in entries:
        try:
            own = settings.of(str(entry.file))
        except _core.InputError:  # An experiment without a force law has no filter bank.
            continue
        if own.bank and own.law == "bank":
            banks.append(ExperimentBank(entry, own.bank, search.at(own.bank)))
    units = {name: parameter.unit for name, parameter in facts.parameters.items()}
    over = ", ".join(
        f"{name} {plain(low, 4)} to {plain(high, 4)} {units.get(name, '')}".rstrip()
        for name, (_, low, high) in plants.ranges.items()
    )
    return ModelLaws(over, recommended, banks)
