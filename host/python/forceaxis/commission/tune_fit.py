"""The step `fit` of a tuning: parameters of the model and dry friction."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from forceaxis import linear
from forceaxis.commission import (
    friction,
    friction_models,
    joint_fit,
    known,
    missing_parts,
    sine_test,
    tune_measure,
)
from forceaxis.commission.as_found import FolderFile
from forceaxis.commission.known import Prior
from forceaxis.commission.refusal import Refusal
from forceaxis.commission.tune_folder import (
    FITTED_MODEL,
    LEVELS,
    RESPONSES_MODEL,
    TuningFolder,
    small_of,
)
from forceaxis.commission.tune_results import (
    Fitted,
    FreeResponse,
    MeasuredResponses,
    ParameterRow,
    ResponseFigures,
    Values,
)
from forceaxis.design import model_file
from forceaxis.identify import fit as fit_response
from forceaxis.identify.measurement import Measurement
from forceaxis.linear import plant_set
from forceaxis.linear.plant_set import PlantSet

Rubs = tuple[friction_models.FrictionElement, ...]

# Standard deviations of the logarithm of a damper in the place of friction, for a sliding axis and
# for an axis that alternates between sticking and sliding; N s/m of a sticking friction.
DAMPED, STICKS, STUCK = 0.9, 2.0, 1e6
# relative error of a response that is fitted with a damper in the place of friction
SLIDING_ERROR, STICKING_ERROR = 0.03, 0.15
RATE_HZ, RATE_ERROR = 0.2, 0.015
BETWEEN_ERROR = 0.1  # relative error of a stiffness from the travel between two forces
UNSURE = 0.2  # relative standard error of the mass from which the sines do not determine the mass
SHAKEN_ERROR = 0.04  # smallest relative error of a workpiece's values from sines
REFIT_CHANGE = 0.02  # relative change of the values from sines after which the fit is repeated
# Tolerances of a design for an axis with dry friction: standard deviations of the prior for the
# dampings; factor for the mass of a workpiece that does not slide, up and down.
RELIED, UNWEIGHED = 1.0, 3.0
DIFFER = 1e-4  # probability below which the responses of two amplitudes count as different

TRIED = FolderFile("residual.json", list[missing_parts.Tried])


def fit(tuning: TuningFolder, free: FreeResponse, measured: MeasuredResponses) -> Fitted:
    """Fits the model's parameters to all responses and to the prior values."""
    order, given = tuning.order, tuning.given
    every = ["free", *(f"{force:g}N" for force in order.forces)]
    rubs = _rubs(tuning, free, measured)
    path = tuning.folder / RESPONSES_MODEL
    path.unlink(missing_ok=True)
    (tuning.folder / FITTED_MODEL).unlink(missing_ok=True)
    if rubs:
        dampers = friction_models.at_both_ends(given, rubs)
        path.write_text(friction_models.damped(given, dampers), encoding="utf-8")
        model, names = str(path), _closed(tuning, every, rubs, measured)
    else:
        dampers, model = (), str(given)
        names = every + _differing(tuning, measured, every[1:], model)
    responses = [fit_response.read_response(tuning.folder / name, model) for name in names]
    own = [_own(tuning, name, dampers, free, measured) for name in names] if rubs else []
    errors = [_error(name, rubs) for name in names] if rubs else []
    sheet = known.priors(model, order.over, order.priors)
    before = sheet | _workpiece(tuning, rubs, measured)
    if any(not friction_models.of_workpiece(given, rub) for rub in rubs):
        apart = fit_response.read_response(tuning.folder / "free", model)
        responses.append(_rate(free, apart))
        own.append({})
        errors.append(joint_fit.MODEL_ERROR)
    asked: dict[str, Any] = {
        "own": own, "errors": errors, "states": known.states_of(model, tuning.states)
    }  # fmt: skip
    found = joint_fit.joint(model, before, responses, order.over, **asked)
    again = _workpiece(tuning, rubs, measured, found.best)
    if any(abs(p.value / before[n].value - 1) > REFIT_CHANGE for n, p in again.items()):
        # the values from sines become more accurate with the fitted stiffness of the sensor
        before |= again
        found = joint_fit.joint(model, before, responses, order.over, **asked)
    if found.rejected:
        raise Refusal(found.rejected, *_explained(tuning, found))
    assert found.plants is not None and found.intervals is not None  # of an accepted fit
    relied: list[str] = []
    if rubs:
        found.values, found.plants, relied = _relied(tuning, found.plants, sheet, rubs, measured)
    units = {n: unit for n, (_, unit) in linear.facts(model).parameters.items()}
    intervals = found.intervals
    rows = {n: ParameterRow(v, intervals[n], units[n]) for n, v in found.best.items()}
    return Fitted(
        **vars(found.summary()), parameters=rows, friction=rubs, lines=_model_lines(tuning, rubs),
        left_out=tuple(name for name in every if name not in names) if rubs else (),
        relied=tuple(relied), together=tuple(found.plants.together),
        own=dict(zip(names, found.own, strict=False)) if rubs else {},
    )  # fmt: skip


def fit_line(tuning: TuningFolder, done: Fitted) -> str:
    """What `fit` says when it ends: the varied parameters."""
    named = plant_set.ranges_of(done.model, tuning.order.over)
    rows = done.parameters
    text = ", ".join(f"{n} = {done.values[n]:.5g} {rows[n].unit}" for n in named)
    return f"{text}, p = {done.p_value:.2g}"


def _explained(tuning: TuningFolder, found: joint_fit.JointFit) -> tuple[str, str]:
    """(reason for rejecting a fit, TOML of the candidates that would explain the responses)."""
    if found.rejected != "chi2":
        return found.text, ""
    tuning.say("the model does not explain the responses: trying what it may lack")
    tried = missing_parts.of(found)
    TRIED.write(tuning.folder, tried)
    if not tried:
        return found.text, ""
    names = " or ".join(one.text for one in tried[: missing_parts.SHOWN])
    text = f"{found.text}; tried, the likeliest first: {names}; add the one that is there"
    return text, missing_parts.lines_of(tried)


def _rubs(tuning: TuningFolder, free: FreeResponse, measured: MeasuredResponses) -> Rubs:
    """The frictions of the model, with the newtons that were measured."""
    moving_N = tune_measure.moving_N(tuning, free)
    return friction_models.frictions_of(tuning.given, moving_N, measured.between.friction_N)


def _model_lines(tuning: TuningFolder, rubs: Rubs) -> str:
    """The friction elements that the model lacks, as TOML. Reports them and writes the completed
    model."""
    if not rubs:
        return ""
    text = friction_models.with_friction(tuning.given, rubs)
    (tuning.folder / FITTED_MODEL).write_text(text, encoding="utf-8")
    lines = friction_models.toml_lines(rubs)
    for rub in rubs:
        tuning.say(f"dry friction of {rub.newton:.3g} N between {' and '.join(rub.between)}")
    if lines:
        tuning.say("the model lacks it; this tuning goes on with it, add to your model:")
        for line in lines.splitlines():
            tuning.say(line)
    return lines


def _closed(
    tuning: TuningFolder, names: list[str], rubs: Rubs, measured: MeasuredResponses
) -> list[str]:
    """The responses during which the backlash of the gear stays closed. If the force that moves the
    load back is smaller than its friction, the motor moves within the backlash, and no linear model
    describes the response. Raises Refusal if no response in contact remains."""
    if not known.play_counts(tuning.given):
        return names
    newton = sum(rub.newton for rub in rubs if not friction_models.of_workpiece(tuning.given, rub))
    if not newton:
        return names
    kept = [n for n, level in measured.levels.items() if level.bias_N - level.swing / 2 > newton]
    if not kept:
        raise Refusal(
            "play", f"expected a force that keeps the play of the gear taken up, {newton:.3g} N of "
            f"dry friction open it at every one of these: give one of {1.5 * newton:.3g} N or more"
        )  # fmt: skip
    gone = [n for n in names if n not in kept]
    if gone:
        tuning.say(f"left out, since the play of the gear opens there: {', '.join(gone)}")
    return kept


def _own(
    tuning: TuningFolder, name: str, rubs: Rubs, free: FreeResponse, measured: MeasuredResponses
) -> dict[str, Prior]:
    """{parameter: Prior} of the dampers that replace the frictions in a response."""
    facts = linear.facts(tuning.given)
    scale = abs(facts.required_encoder.scale)
    about: ResponseFigures = free if name == "free" else measured.levels[name]
    compliance = measured.between.compliance + measured.between.sliding  # counts a newton
    speed = about.speed_rms / scale
    found = {}
    for rub in rubs:
        on_table = friction_models.of_workpiece(tuning.given, rub)
        if on_table and name == "free":
            continue
        if on_table and about.swing / 2 < 1.2 * rub.newton:
            found[rub.damping] = Prior(STUCK, DAMPED)
        elif rub.newton > 0:
            moves = speed if name == "free" else speed * compliance
            spread = STICKS if on_table else DAMPED
            found[rub.damping] = Prior(friction.damping(rub.newton, max(moves, 1e-7)), spread)
    return found


def _error(name: str, rubs: Rubs) -> float:
    """Relative error of a response that no parameter can explain."""
    sticks = any(rub.name == friction_models.TABLE for rub in rubs) and name != "free"
    return STICKING_ERROR if sticks else SLIDING_ERROR


def _rate(free: FreeResponse, apart: Measurement) -> Measurement:
    """The speed per code of the sliding axis, as a response with one line. Friction does not change
    it, because the axis slides in one direction."""
    exact = complex(free.glide.rate / (2j * np.pi * RATE_HZ))
    one = np.ones(1)
    return replace(
        apart, frequency_hz=RATE_HZ * one, response=np.full(1, exact), coherence=one, floor=0 * one,
        variance=(RATE_ERROR * abs(exact)) ** 2 * one,
    )  # fmt: skip


def _workpiece(
    tuning: TuningFolder, rubs: Rubs, measured: MeasuredResponses, best: Values | None = None
) -> dict[str, Prior]:
    """Priors of a workpiece with dry friction, from the travel between the forces and from sines.
    best: {parameter: value} of an earlier fit, or empty."""
    if not any(friction_models.of_workpiece(tuning.given, rub) and rub.newton > 0 for rub in rubs):
        return {}
    sliding, shaken = measured.between.sliding, measured.shaken
    stiffness, mass = workpiece_names(tuning.given)
    sensor, damping = sensor_names(tuning.given)
    if shaken and best and sensor in best:
        shaken = sine_test.of_sines(shaken.rows, best[sensor], best.get(damping or "", 0.0))
    scale = abs(linear.facts(tuning.given).required_encoder.scale)
    given = {text.partition("=")[0] for text in tuning.order.priors}
    found: dict[str, Prior] = {}
    if stiffness and sliding:
        found[stiffness] = Prior(scale / sliding, BETWEEN_ERROR)
        if shaken:
            sure = max(SHAKEN_ERROR, shaken.stiffness_error)
            weights = np.array([BETWEEN_ERROR**-2, sure**-2])
            values = np.log([found[stiffness].value, shaken.stiffness])
            found[stiffness] = Prior(
                float(np.exp(weights @ values / weights.sum())), float(weights.sum() ** -0.5)
            )
    if mass and shaken and _mass_shows(shaken):
        found[mass] = Prior(shaken.mass, max(SHAKEN_ERROR, shaken.mass_error))
    elif mass and mass not in given:  # see _relied()
        table = [rub for rub in rubs if friction_models.of_workpiece(tuning.given, rub)]
        if not all(rub.declared for rub in table):
            raise Refusal(
                "friction", "expected a workpiece that slides on its table, "
                f"{table[0].newton:.3g} N of dry friction hold it within the bounds: its mass does "
                f"not show; add to the model what was found, and give the prior {mass}=KG as it "
                f"weighs: without, {UNWEIGHED:g} times less and more than the model has are taken",
                friction_models.toml_lines(rubs),
            )  # fmt: skip
        found[mass] = Prior(linear.facts(tuning.given).parameters[mass][0], known.MASS_SPREAD)
    return {name: prior for name, prior in found.items() if name not in given}


def _mass_shows(shaken: sine_test.SineTestResult | None) -> bool:
    """Whether the workpiece slid so much under the sines that they determine its mass."""
    return shaken is not None and shaken.mass_error < UNSURE


def _relied(
    tuning: TuningFolder,
    plants: PlantSet,
    sheet: dict[str, Prior],
    rubs: Rubs,
    measured: MeasuredResponses,
) -> tuple[dict[str, float], PlantSet, list[str]]:
    """Values and tolerances of a design for an axis with dry friction: (values, PlantSet, a text
    for each parameter whose value differs from the fit). plants: about the fitted values; sheet:
    the prior values.

    The fit represents dry friction by dampers, one set for each response. The plant of the design
    has no such dampers, because it slides. The fit cannot distinguish friction from damping. All
    dampings of the design are therefore together at the low or at the high end of the prior, RELIED
    standard deviations from its value; a fitted value below the low end replaces the low end.
    """
    facts = linear.facts(plants.model).parameters
    values, ranges, lines = plants.overrides, dict(plants.ranges), []
    low: dict[str, float] = {}
    high: dict[str, float] = {}
    for name, prior in sheet.items():
        if name in values and facts[name][1] == "N s/m" and name not in ranges:
            ends = [prior.value * math.exp(s * RELIED * prior.spread) for s in (-1, 1)]
            low[name], high[name] = min(ends[0], values[name]), ends[1]
            lines.append(
                f"{name} from {low[name]:.4g} to {high[name]:.4g} N s/m, {values[name]:.4g} were "
                "fitted: damping cannot be told from dry friction"
            )
    _, mass = workpiece_names(tuning.given)
    given = {text.partition("=")[0] for text in tuning.order.priors}
    table = [rub for rub in rubs if friction_models.of_workpiece(tuning.given, rub)]
    unseen = any(rub.newton > 0 for rub in table) and not _mass_shows(measured.shaken)
    if unseen and mass in ranges and mass not in given:
        value, least, most = ranges[mass]
        ranges[mass] = (value, least / UNWEIGHED, most * UNWEIGHED)
        lines.append(
            f"{mass} from {ranges[mass][1]:.4g} to {ranges[mass][2]:.4g} kg: the workpiece "
            f"does not slide, so its mass does not show; the prior {mass}=KG narrows that"
        )
    for line in lines:
        tuning.say(f"designed for {line}")
    values, together = values | low, ((low, high) if low else ({},))
    return values, replace(plants, overrides=values, ranges=ranges, together=together), lines


def _name(value: Any) -> str | None:
    return value if isinstance(value, str) else None


def sensor_names(model: str | Path) -> tuple[str | None, str | None]:
    """(parameter of the contact's stiffness, parameter of its damping); None for a constant
    number."""
    contact = model_file.read(model).contact
    return (_name(contact.stiffness), _name(contact.damping)) if contact else (None, None)


def workpiece_names(model: str | Path) -> tuple[str | None, str | None]:
    """(parameter of the stiffness between workpiece and ground, parameter of its mass), or None."""
    tables = model_file.read(model)
    support, body = tables.support, tables.body(tables.workpiece)
    return _name(support.stiffness) if support else None, _name(body.mass) if body else None


def _differing(
    tuning: TuningFolder, measured: MeasuredResponses, names: list[str], model: str
) -> list[str]:
    """Folders of the smaller amplitude whose response differs from that of the larger amplitude;
    the result of `measure` is updated with this finding."""
    found, levels = [], dict(measured.levels)
    for name in names:
        small = small_of(name)
        if not (tuning.folder / small).exists():
            continue
        one, other = (fit_response.read_response(tuning.folder / n, model) for n in (name, small))
        if _probability(one, other) < DIFFER:
            tuning.say(f"{name}: the smaller amplitude has another response")
            levels[name] = replace(levels[name], differs=True)
            found.append(small)
    if found:
        held = LEVELS.required(tuning.folder)
        LEVELS.write(tuning.folder, replace(held, result=levels))
    return found


def _probability(one: Measurement, other: Measurement) -> float:
    """Probability that noise alone makes two responses at the same lines differ this much."""
    from scipy import stats

    variance = one.variance + other.variance + (joint_fit.MODEL_ERROR * abs(one.response)) ** 2
    dof = min(one.dof, other.dof)
    ratio = abs(one.response - other.response) ** 2 / variance
    size = float(np.sum(2 * dof * np.log1p(ratio / dof)))
    return float(stats.chi2.sf(size, 2 * len(ratio)))


def holds(measured: MeasuredResponses, fitted: Fitted | None) -> list[str]:
    """Lines of text: the forces and amplitudes for which the predictions were verified, and those
    that were not measured. fitted: None before the fit."""
    between, rubs = measured.between, fitted.friction if fitted else ()
    lines = [
        f"between {between.low_N:.3g} and {between.high_N:.3g} N the axis was moved slowly: "
        "forces outside were not visited"
    ]
    lines += [f"designed for {line}" for line in (fitted.relied if fitted else ())]
    if fitted and fitted.left_out:
        lines.append(
            f"the play of the gear opens at {', '.join(fitted.left_out)}: these responses were "
            "left out, what is promised holds where the play stays taken up"
        )
    for level in measured.levels.values():
        text = f"with {level.bias_N:.3g} N: noise of {level.amplitude} codes, "
        text += f"{level.swing:.3g} N from peak to peak"
        if level.small:
            text += f", and {level.small.amplitude} codes, {level.small.swing:.3g} N"
            same = "another response" if level.differs else "the same response"
            text += "" if rubs else f", {same}"
        lines.append(text)
    shaken = measured.shaken
    if rubs and shaken:
        lines.append(
            f"sines of {min(shaken.hz):.3g} to {max(shaken.hz):.3g} Hz with "
            f"{min(shaken.newton):.3g} to {max(shaken.newton):.3g} N made the workpiece slide"
        )
    if rubs:
        lines.append(
            "dry friction is in the axis: what is promised holds where it slides and, under the "
            "workpiece, where it sticks; smaller amplitudes see more damping"
        )
    lines.append("larger amplitudes than these were not visited")
    return lines
