"""`identify fit` for an axis with dry friction: dampers represent the friction in the fit.

If a model is rejected, it is fitted again with a damper in the place of each friction. These are
the frictions that the measurement has found, or all possible ones if it did not search for
friction. The size of a damper depends on the amplitude of the response. The friction in newtons
follows from the damper and the recorded speed.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from forceaxis import linear, paths
from forceaxis._core import InputError
from forceaxis.commission import friction, friction_models, joint_fit, known
from forceaxis.commission.refusal import Refusal
from forceaxis.commission.tune_fit import (
    DAMPED,
    SLIDING_ERROR,
    STICKING_ERROR,
    STUCK,
    workpiece_names,
)
from forceaxis.identify import fit as fit_response
from forceaxis.identify.measurement import Measurement
from forceaxis.results import to_json

TRIES = 2  # other starts
# damping at the start in N s/m, as a share of the moving mass times the middle frequency
BEGIN = 0.1


@dataclass(frozen=True)
class Record:
    """Friction as the file of a response records it. looked: the measurement searched for friction;
    dead_zone: DAC codes that guide and gear need; moving_N, table_N: friction of guide and gear and
    under the workpiece, None if not known; speed: rms of the axis, m/s, None if not recorded;
    slides: the workpiece slid; least: the friction of guide and gear is a lower bound."""

    looked: bool = False
    dead_zone: float = 0.0
    moving_N: float | None = None
    table_N: float = 0.0
    slides: bool = True
    least: bool = False
    speed: float | None = None

    @property
    def rubs(self) -> bool:
        return self.dead_zone > 0 or self.table_N > 0


def record(path: str | Path, model: str, overrides: linear.Overrides) -> Record:
    """The Record of a folder of `forceaxis measure --out`; the model converts codes to newtons if
    the record contains only codes."""
    try:
        about = json.loads((Path(path) / "result.json").read_text(encoding="utf-8"))
        found = about["friction"]
        dead_zone, moving = float(found["dead_zone_codes"]), found["moving_N"]
        table = float(found["workpiece_N"] or 0.0)
        slides = found["workpiece_slides"] is not False
        least = not found["glide"] and bool(found["directions"] and found["directions"]["least"])
        speed, slow = float(about["speed_rms"]), found["slow"]
        counts = speed if about["bias_N"] is None else (
            speed * (slow["compliance"] + slow["sliding"]) if slow else None
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError):
        return Record()
    if moving is None and dead_zone:
        newton = known.newton_per_code(model, overrides)
        moving = dead_zone * newton if math.isfinite(newton) else None
    encoder = linear.facts(model, overrides).encoder
    metres = None if counts is None or not encoder else counts / abs(encoder.scale)
    return Record(True, dead_zone, moving, table, slides, least, metres)


@dataclass(frozen=True)
class Freed:
    """A fit with dampers in the place of friction, for the Measurement with that model; newtons of
    each friction, None if the speed is not known."""

    found: fit_response.ParameterFit
    measured: Measurement
    rubs: tuple[friction_models.FrictionElement, ...]
    newtons: dict[str, float | None]


def fit(
    measured: Measurement, starts: dict[str, float], units: dict[str, str], path: str | Path,
    folder: Path,
) -> tuple[fit_response.ParameterFit, Measurement, dict[str, Any]]:  # fmt: skip
    """Fits the response at `path`: (fit, the Measurement with the fitted model, summary). folder:
    for the file of that model. Raises InputError, and Refusal `friction`."""
    model, held = measured.model, measured.overrides
    found = fit_response.fit(measured, starts)
    about = record(path, model, held)
    freed = _freed(measured, starts, about, folder) if found.rejected else None
    if found.rejected and freed is None and about.rubs:
        raise _refused(found.p_value, model, about)
    if freed is None:
        summary = to_json(fit_response.summarise(found, measured, units)) | {"friction": None}
        if about.rubs:
            summary["warnings"].append(f"the axis rubs, {_words(about)}: smaller amplitudes have "
                                       "another response")  # fmt: skip
        return found, measured, summary
    dampers = {rub.damping: "N s/m" for rub in freed.rubs}
    summary = to_json(fit_response.summarise(freed.found, freed.measured, units | dampers))
    rows, lines = summary["parameters"], []
    for rub in freed.rubs:
        row = rows.get(rub.damping)
        lines.append({
            "name": rub.name, "between": list(rub.between), "newton": freed.newtons[rub.name],
            "damping": row["value"] if row else None, "declared": rub.declared,
        })  # fmt: skip
    newtons = [
        replace(rub, newton=size) for rub in freed.rubs
        if (size := freed.newtons[rub.name]) is not None
    ]  # fmt: skip
    own = [text for text in summary["set"].split("--set ") if text.partition("=")[0] in starts]
    summary |= {
        "model": paths.display(model),
        "friction": {"freed": lines, "lines": friction_models.toml_lines(tuple(newtons))},
        "set": " ".join(f"--set {text.strip()}" for text in own),
    }
    return freed.found, freed.measured, summary


def _freed(
    measured: Measurement, starts: dict[str, float], about: Record, folder: Path
) -> Freed | None:
    """The fit with the smallest number of dampers that explains a response; None if no set of
    dampers does."""
    every = friction_models.frictions_of(measured.model, 1.0, 1.0)
    moving = tuple(rub for rub in every if not friction_models.of_workpiece(measured.model, rub))
    table = tuple(rub for rub in every if friction_models.of_workpiece(measured.model, rub))
    if about.looked:
        sets = [(moving if about.dead_zone else ()) + (table if about.table_N else ())]
    else:
        sets = [moving, *([] if measured.free else [table, moving + table])]
    best = None
    # If a workpiece slides only part of the time, a fitted mass is wrong by a factor.
    shown = about.slides and not starts.keys().isdisjoint(workpiece_names(measured.model))
    for rubs in filter(None, dict.fromkeys(sets)):
        sticks = any(rub in table for rub in rubs)
        if sticks and shown:
            continue
        error = STICKING_ERROR if sticks and not about.slides else SLIDING_ERROR
        tolerant = replace(
            measured, variance=measured.variance + (error * abs(measured.response)) ** 2
        )
        one = _with(tolerant, starts, rubs, table, about, folder)
        if one is None or one.found.rejected:
            continue
        # a damper has to improve the fit by more than the penalty for its parameter
        if not about.looked:
            plain = fit_response.fit(tolerant, starts, tries=TRIES)
            cost = (len(one.found.names) - len(starts)) * math.log(2 * one.found.points)
            if one.found.chi_square + cost > plain.chi_square:
                continue
        if best is None or one.found.p_value > best.found.p_value:
            best = one
    return best


def _with(
    measured: Measurement, starts: dict[str, float],
    rubs: tuple[friction_models.FrictionElement, ...],
    table: tuple[friction_models.FrictionElement, ...], about: Record, folder: Path,
) -> Freed | None:  # fmt: skip
    """A response fitted with the dampers of `rubs`; None if the response does not depend on a
    damper."""
    file = folder / f"{'_'.join(rub.name for rub in rubs)}.toml"
    file.write_text(friction_models.damped(measured.model, rubs), encoding="utf-8")
    free, stuck = {}, {}
    for rub in rubs:
        if rub in table and not about.slides:
            stuck[rub.damping] = STUCK
        else:
            whole = about.table_N if rub in table else about.moving_N
            free[rub.damping] = _begin(measured, rub.newton * (whole or 0.0), about.speed)
    model = str(file)
    # the parameters of a replaced friction do not exist in this model
    left = linear.facts(model).parameters
    held = {name: value for name, value in measured.overrides.items() if name in left}
    slides = replace(
        measured, model=model, overrides=held | stuck,
        modes=known.states_of(model, measured.modes),
    )  # fmt: skip
    try:
        found = fit_response.fit(slides, starts | free, tries=TRIES)
    except InputError:  # the damper has no effect, or only together with another parameter
        return None
    # the parameter has no effect while the workpiece sticks
    if found.single.max() > fit_response.REACH:
        return None
    values = dict(zip(found.names, found.values.tolist(), strict=True))
    newtons = {}
    for rub in rubs:
        whole = about.table_N if rub in table else (None if about.least else about.moving_N)
        # share of the measured friction, if the model has several frictions
        known_N = rub.newton * (whole or 0.0)
        if not known_N and about.speed and rub.damping in values:
            known_N = values[rub.damping] * about.speed / friction.damping(1.0, 1.0)
        newtons[rub.name] = known_N or None
    return Freed(found, slides, rubs, newtons)


def _begin(measured: Measurement, newton: float | None, speed: float | None) -> float:
    """Initial damping in N s/m."""
    if newton and speed:
        return friction.damping(newton, speed)
    masses = linear.facts(measured.model, measured.overrides).masses_kg
    middle = 2 * math.pi * float(np.median(measured.frequency_hz))
    return BEGIN * sum(masses.values()) * middle


def _words(about: Record) -> str:
    parts = []
    if about.dead_zone:
        newton = "" if about.moving_N is None else f" or {about.moving_N:.3g} N"
        least = "at least " if about.least else ""
        parts.append(f"guide and gear take {least}{about.dead_zone:.3g} codes{newton}")
    if about.table_N:
        parts.append(f"{about.table_N:.3g} N under the workpiece")
    return ", ".join(parts)


def _refused(p: float, model: str, about: Record) -> Refusal:
    rubs = friction_models.frictions_of(model, about.moving_N or 0.0, about.table_N)
    lines = friction_models.toml_lines(tuple(rub for rub in rubs if rub.newton > 0))
    if about.least and about.moving_N:
        lines = f"# of guide and gear at least so much\n{lines}"
    hidden = (
        "what holds a workpiece that rubs does not show in noise, `tune` shakes it with sines; "
    )
    return Refusal(
        "friction", f"expected a model that explains the response, p = {p:.2g}, and "
        f"friction that a damper stands for, got {_words(about)}: {hidden if about.table_N else ''}"
        "add the friction to the model, free what else may be wrong, or measure with a larger "
        "force or level", lines,
    )  # fmt: skip


def joint(
    model: str | Path, priors: dict[str, known.Prior], measured: list[Measurement],
    paths_of: Sequence[str | Path], over: tuple[str, ...], states: dict[str, str], folder: Path,
) -> joint_fit.JointFit:  # fmt: skip
    """commission.fit.joint of the responses at `paths_of`. If the model is rejected, it is fitted
    again with dampers for the measured friction of guide and gear. Raises Refusal `friction` if the
    friction is under the workpiece or if the dampers do not explain the responses either."""
    found = joint_fit.joint(model, priors, measured, over, states=states)
    about = [record(path, str(model), {}) for path in paths_of]
    worst = max(about, key=lambda one: (one.table_N, one.dead_zone))
    if not found.rejected or not worst.rubs:
        return found
    rubs = tuple(
        rub
        for rub in friction_models.frictions_of(
            model, max(one.moving_N or 0.0 for one in about), 0.0
        )
        if rub.newton > 0
    )  # fmt: skip
    rubs = friction_models.at_both_ends(model, rubs)
    if not worst.table_N and rubs:
        file = folder / "slides.toml"
        file.write_text(friction_models.damped(model, rubs), encoding="utf-8")
        own = [
            {
                rub.damping: known.Prior(_begin(one, rub.newton, held.speed), DAMPED)
                for rub in rubs if held.dead_zone
            }
            for one, held in zip(measured, about, strict=True)
        ]  # fmt: skip
        errors = [SLIDING_ERROR if one else joint_fit.MODEL_ERROR for one in own]
        slides = joint_fit.joint(
            str(file), priors, measured, over, own=own, errors=errors,
            states=known.states_of(str(file), states),
        )  # fmt: skip
        if not slides.rejected:
            return slides
    raise _refused(found.p, str(model), worst)
