"""Makes an experiment that repeats an incident. It consists of the released model with a cause of
the incident, and of the parameters and the command of the axis."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from forceaxis import _core
from forceaxis._core import TICKS_PER_SECOND
from forceaxis.bus.client import from_raw
from forceaxis.commission import contact_elements
from forceaxis.commission.contact_likelihood import moved_bodies
from forceaxis.commission.incident import Incident
from forceaxis.commission.incident_causes import FittedCause, Released
from forceaxis.design import model_file
from forceaxis.linear import working
from forceaxis.objects import BY_NAME
from forceaxis.results import JsonObject

MODEL, EXPERIMENT = "model.toml", "experiment.toml"
LONGER = 1.5  # duration of the experiment divided by the recorded time before the fault
# ENABLE_S: pairs (time in s, controlword) of the commands that enable the axis.
# START_S: time in s and controlword of the command that starts a move in profile position mode.
ENABLE_S = ((0.0, 6), (0.002, 7), (0.004, 15))
START_S = (0.006, 31)
# Mass and damping of the scale (tape) of an encoder that slips.
# With this mass and damping, the scale of the encoder moves within a tick.
SCALE_KG, SCALE_N_S_PER_M = 1e-3, 10.0


def files(incident: Incident, released: Released, fit: FittedCause) -> dict[str, str]:
    """Returns {file name: text} of the model and the experiment. Returns no files if the recorded
    signals of the incident do not show the command of the axis, which depends on the mode of
    operation."""
    command = _command(incident)
    if not command:
        return {}
    document = model_file.document(released.path)
    if fit.model_text:
        document = tomlkit.parse(fit.model_text)
        for name, value in fit.values().items():
            document["parameters"][name]["value"] = value
            document["parameters"][name]["source"] = "explains the incident"
    _start(document, fit)
    events = _sensors(document, released, fit)
    known = released.parameters(fit)
    drops = fit.cause.element.drops if fit.cause.element else ()
    table: dict[str, Any] = {
        "title": f"{incident.fault.replace('_', ' ')}: {fit.cause.text}",
        "model": MODEL,
        "duration_s": round(LONGER * incident.recording.trigger_sample / TICKS_PER_SECOND, 3),
        "set": {name: value for name, value in known.items() if name not in drops},
        "firmware": _parameters(incident) | command,
    }
    if "modes_of_operation" in command:
        words = (*ENABLE_S, START_S) if "target_position" in command else ENABLE_S
        enable = [{"time_s": t, "firmware": {"controlword": w}} for t, w in words]
        events = [*enable, *events]
    if events:
        table["at"] = events
    table["expect"] = {"fault": incident.fault}
    with tempfile.TemporaryDirectory() as folder:
        model = contact_elements.without_unused(tomlkit.dumps(document), Path(folder) / MODEL)
    return {MODEL: model, EXPERIMENT: tomlkit.dumps(table)}


def repeats(incident: Incident, texts: Mapping[str, str]) -> bool:
    """Runs the experiment. Returns True if it ends with the same fault as the incident."""
    from forceaxis.experiments.experiment import Experiment

    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            (Path(folder) / name).write_text(text)
        try:
            return Experiment.load(Path(folder) / EXPERIMENT).run().fault == incident.fault
        except _core.SimulationError:
            return False


def _parameters(incident: Incident) -> JsonObject:
    """Returns the parameters of the axis that differ from their defaults."""
    return {
        name: raw if BY_NAME[name].values else from_raw(name, raw)
        for name, raw in incident.parameters.items()
        if name == "force_scale"
        or (BY_NAME[name].stored and raw != BY_NAME[name].default and not BY_NAME[name].node_id)
    }


def _command(incident: Incident) -> JsonObject:
    """Returns the table [firmware] of the experiment, with which the axis gets the same commands as
    before the fault."""
    number = incident.parameters["modes_of_operation"]
    mode = from_raw("modes_of_operation", number)
    used = slice(0, incident.recording.trigger_sample)
    if mode == "force_counts":
        setpoint = from_raw("force_setpoint", incident.parameters["force_setpoint"])
        return {"mode": "force", "force_setpoint": setpoint}
    if mode == "force":
        target = int(np.max(incident.column("force_demand")[used], initial=0))
        return {"modes_of_operation": number, "target_force": target}
    if mode == "profile_position":
        end = int(incident.column("profile_position")[used][-1])
        return {"modes_of_operation": number, "target_position": end}
    return {}


def _start(document: Any, fit: FittedCause) -> None:
    """Sets all bodies that move with the drive to their positions at the beginning of the recorded
    second."""
    problem = fit.problem
    place = float(problem.number("place", 0, fit.point[None])[0])
    own = dict(zip(problem.names, np.exp(fit.point).tolist(), strict=False))
    plant = _core.Plant(str(problem.model), {**problem.held, **own})
    for body in document["body"]:
        if body["name"] in moved_bodies(problem.model):
            body["position"] = float(plant.signal(f"{body['name']}.position")) + place


def _sensors(document: Any, released: Released, fit: FittedCause) -> list[dict[str, Any]]:
    """Changes the sensors of a model according to the cause. Returns the events that the experiment
    needs for this change."""
    values = fit.values()
    changed = {unknown.kind: values[unknown.kind] for unknown in fit.cause.unknowns}
    known = released.facts.parameters
    adc = next(table for table in document["adc"] if table["channel"] == 0)
    per_count = working.number(adc["per_count"], known) or 1.0
    if "gain" in changed:
        adc["per_count"] = per_count / changed["gain"]
    if "offset" in changed:
        zero = working.number(adc.get("zero_code", 0), known) or 0.0
        adc["zero_code"] = max(0, round(zero + changed["offset"] / per_count))
    encoder = document.get("encoder", {})
    if "scale" in changed:
        encoder["scale"] = released.facts.required_encoder.scale * changed["scale"]
    if "slip" not in changed:
        return []
    # The encoder measures relative to its scale, so the scale moves in the opposite direction.
    encoder["reference"] = "encoder_tape"
    body = {"name": "encoder_tape", "mass": SCALE_KG}
    held = {"name": "encoder_glue", "between": ["encoder_tape", "ground"],
            "damping": SCALE_N_S_PER_M}  # fmt: skip
    document["body"].append(tomlkit.item(body))
    document.setdefault("damper", tomlkit.aot()).append(tomlkit.item(held))
    impulse = {"body": "encoder_tape", "N_s": -changed["slip"] * SCALE_N_S_PER_M}
    return [{"time_s": fit.cause.slip_at / fit.problem.data.rate_hz, "impulse": impulse}]
