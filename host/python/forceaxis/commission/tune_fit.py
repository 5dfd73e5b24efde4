"""The step `fit` of a tuning. It fits the parameters of the model and the dry friction."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forceaxis import linear
from forceaxis.axis.link import TICKS_PER_S
from forceaxis.commission import (
    analyzer,
    friction,
    friction_models,
    joint_fit,
    known,
    missing_parts,
    sine_excitation,
    tune_measure,
    unexplained,
)
from forceaxis.commission.as_found import FolderFile
from forceaxis.commission.known import Prior
from forceaxis.commission.refusal import MeasureAgain, Refusal
from forceaxis.commission.tune_folder import (
    COMPLETED_MODELS,
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
from forceaxis.design.model_file import Given
from forceaxis.identify import fit as fit_response
from forceaxis.identify.distributions import chi_square_tail
from forceaxis.identify.measurement import Measurement
from forceaxis.linear import plant_set
from forceaxis.linear.plant_set import PlantSet
from forceaxis.words import plain

Frictions = tuple[friction_models.FrictionElement, ...]

# Prior standard deviation of the logarithm of the damping that replaces friction.
# SLIDING_SPREAD applies to an axis that slides.
# STICKING_SPREAD applies to an axis that sometimes sticks.
# HIDDEN_SPREAD applies to friction that the motion out of contact does not show.
SLIDING_SPREAD, STICKING_SPREAD, HIDDEN_SPREAD = 0.9, 2.0, 2.0
# First value of a hidden friction, divided by the smallest force of the responses.
HIDDEN_SHARE = 0.05
# Damping in N s/m that replaces the friction of a workpiece that does not slide.
STUCK_DAMPING = 1e6
# Relative error of a response that is fitted with a damper in place of friction.
# SLIDING_ERROR applies to an axis that slides.
# STICKING_ERROR applies to an axis that sometimes sticks.
SLIDING_ERROR, STICKING_ERROR = 0.03, 0.15
# Dry friction of guide and gear causes a relative error of a response.
# The error is RUBBING_ERROR x (1 + (x / RUBBING_RATIO)^2), at most RUBBING_ERROR_MAX.
# In this formula, x is the friction force divided by the rms force of the excitation.
RUBBING_ERROR, RUBBING_RATIO, RUBBING_ERROR_MAX = 0.3, 0.4, 2.0
# Frequency in Hz and relative error of the response that _speed_response() returns.
SPEED_RESPONSE_HZ, SPEED_ERROR = 0.2, 0.015
# relative error of a stiffness that is computed from the travel between two forces
TRAVEL_STIFFNESS_ERROR = 0.1
# STUCK_MORE: largest ratio of the fitted compliance of the sensor to the measured compliance.
# If the ratio is larger, the fit is repeated.
# STUCK_SHARE_MIN: smallest measurable compliance of the sensor, divided by that of the workpiece.
STUCK_MORE, STUCK_SHARE_MIN = 1.25, 0.1
# The test with sines determines the mass if its relative standard error is below this value.
SINE_MASS_ERROR_MAX = 0.2
SINE_ERROR_MIN = 0.04  # smallest relative error of stiffness and mass from the test with sines
# the fit is repeated if the values from the test with sines change by more than this fraction
REFIT_CHANGE = 0.02
# The design for an axis with dry friction uses dampings within this range around the prior.
# The range of the dampings is in standard deviations of the prior, to both sides.
DAMPING_DEVIATIONS = 1.0
# A fit with friction may move a number of the drive by more prior standard deviations than this.
# The set of plants of the design then contains both values of this number.
DOUBTED_SPREADS = 1.5
# The unknown mass of a workpiece is assumed to be between prior / factor and prior * factor.
UNKNOWN_MASS_FACTOR = 3.0
# Ratio of the ends of an interval above which the responses do not determine a parameter.
UNTOLD_RATIO = 9.0
# Two responses differ if the probability of the difference from noise alone is below this value.
DIFFERENCE_PROBABILITY = 1e-4

# A number of the model that is wrong by at most this factor is corrected without a question.
NUMBER_CHANGE_MAX = 1.6
# Shortest relaxation time of a workpiece, in s, that the slow change of the force shows accurately.
# The responses show relaxation times of the workpiece below CREEP_MIN_S.
CREEP_MIN_S = 0.15
# Least compliance of a workpiece that relaxes, divided by that of the axis.
RELAXING_COMPLIANCE_MIN = 0.05
CAUSES_MAX = 3  # largest number of causes that are added to a model one after another
# If the error of a response is too large, the response is measured again with more averages.
# AVERAGES_MARGIN: margin by which the computed number of averages is multiplied.
# AVERAGES_FACTOR_MAX: largest ratio of the number of averages to that of the request.
AVERAGES_MARGIN, AVERAGES_FACTOR_MAX = 1.3, 16.0
EXPLAINED = ("chi2", "prior")  # rejections of a fit for which causes are searched

TRIED = FolderFile("residual.json", list[missing_parts.Tried])


@dataclass(frozen=True)
class _Attempt:
    """A fit with assumed dry friction, and what it was fitted to. `names`: names of the fitted
    responses. `dampers`: the dampers that replace the friction elements."""

    found: joint_fit.JointFit
    frictions: Frictions
    dampers: Frictions
    names: list[str]
    sheet: dict[str, Prior]


def fit(tuning: TuningFolder, free: FreeResponse, measured: MeasuredResponses) -> Fitted:
    """Fits the parameters of the model to all responses and to their prior values."""
    for path in (tuning.folder / FITTED_MODEL, *_completed(tuning)):
        path.unlink(missing_ok=True)
    moving_N = tune_measure.moving_N(tuning, free)
    tuning, lacks = _with_creep(tuning, measured)
    done = _attempt(tuning, free, measured, moving_N, SLIDING_SPREAD)
    tried = list[missing_parts.Tried]()
    for causes in range(CAUSES_MAX + 1):
        if done.found.rejected not in EXPLAINED:
            break
        tried = _tried(tuning, done, free, measured)
        if causes == CAUSES_MAX:
            break
        with_cause = _with_cause(tuning, done, tried, free, measured)
        if with_cause is None:
            break
        done, tuning, more = with_cause
        lacks = "\n\n".join(filter(None, (lacks, more)))
    found, frictions, why_not = done.found, done.frictions, ""
    if found.rejected in EXPLAINED and _is_linear(tuning, done, measured):
        found, why_not = _with_model_error(tuning, found, tried, lacks)
    if found.rejected:
        raise _explained(tuning, found, tried, lacks)
    # A fit that was accepted always has plants and intervals.
    assert found.plants is not None and found.intervals is not None
    for name in found.far:
        tuning.say(
            f"{name} is {found.best[name]:.5g}, far from its prior value "
            f"{found.problem.priors[name].value:.5g}; the law is designed for the fitted value"
        )
    changes: list[str] = []
    if frictions:
        found.plants, changes = _with_tolerances(
            tuning, found.plants, found.best, done.sheet, frictions, measured
        )
        found.values = found.best | found.plants.together[0]
    parameters, intervals = linear.facts(found.model).parameters, found.intervals
    rows = {n: ParameterRow(v, intervals[n], parameters[n].unit) for n, v in found.best.items()}
    for line in untold(rows, tuple(plant_set.ranges_of(found.model, tuning.order.over))):
        tuning.say(line)
    return Fitted(
        **vars(found.summary()), parameters=rows, friction=frictions,
        lines=_model_lines(tuning, frictions, lacks),
        left_out=tuple(name for name in _every(tuning) if name not in done.names),
        relied=tuple(changes), together=tuple(found.plants.together),
        own=dict(zip(done.names, found.own, strict=False)) if frictions else {},
        unexplained=unexplained.of_fit(found, done.names) if why_not else {}, why_not=why_not,
    )  # fmt: skip


def _with_creep(tuning: TuningFolder, measured: MeasuredResponses) -> tuple[TuningFolder, str]:
    """Returns the tuning with a model in which the workpiece relaxes, if it did so between the
    forces, and the TOML text that the model lacks, otherwise ""."""
    between = measured.between
    if not between.creep or not between.creep_s or between.creep_s < CREEP_MIN_S:
        return tuning, ""
    # compliance of the workpiece alone, before it relaxes
    at_once = between.compliance - known.contact_counts(tuning.given)
    share = between.creep / max(at_once, RELAXING_COMPLIANCE_MIN * between.compliance)
    lines = missing_parts.relaxing(tuning.given, share, between.creep_s / (1 + share))
    if not lines:
        return tuning, ""
    tuning.say("the workpiece relaxes, the model does not; the tuning continues with it")
    return tuning.with_part(_with_lines(tuning, lines), ()), lines


def _completed(tuning: TuningFolder) -> list[Path]:
    """Returns the paths of the models with added parts that the fit has written so far."""
    return sorted(tuning.folder.glob(COMPLETED_MODELS.format("*")))


def _with_lines(tuning: TuningFolder, lines: str) -> Path:
    """Writes the model with the TOML text of a further part, and returns its path."""
    path = tuning.folder / COMPLETED_MODELS.format(len(_completed(tuning)) + 1)
    path.write_text(missing_parts.with_lines(tuning.given, lines), encoding="utf-8")
    return path


def _with_cause(
    tuning: TuningFolder, done: _Attempt, tried: list[missing_parts.Tried], free: FreeResponse,
    measured: MeasuredResponses,
) -> tuple[_Attempt, TuningFolder, str] | None:  # fmt: skip
    """Fits again with the cause of a rejection, or with one of several causes, as the user would
    add it to the model or to the command. Friction that the motion out of contact does not show is
    tried first, where it is possible. Returns None if no candidate is a cause by evidence, or if it
    is not linear, or if the fit with it is hardly better. Returns three values: the fit, the tuning
    with the completed model, and the TOML text that the model lacks."""
    if missing_parts.possible(tried, "guide_friction"):
        rubs = _with_hidden_friction(tuning, free, measured)
        if rubs:
            return rubs, tuning, ""
    cause = missing_parts.leader(tried) or missing_parts.delay(tried)
    if cause is None or _is_given(tuning, cause):
        return None
    completed, lines = tuning, cause.toml
    if cause.name == "stiffening":
        (name,) = {key.partition("@")[0] for key in cause.values}
        apart = joint_fit.with_levels(done.found, name, cause.values, tuning.order.over)
        again = replace(done, found=apart)
    elif not cause.linear or _far_from_model(tuning, cause):
        return None
    else:
        path = _with_lines(tuning, lines) if lines else tuning.given
        completed = tuning.with_part(path, cause.priors)
        moving_N = tune_measure.moving_N(completed, free)
        again = _attempt(completed, free, measured, moving_N, SLIDING_SPREAD)
    better = done.found.chi2 - again.found.chi2 > missing_parts.EVIDENCE_MIN
    if again.found.rejected and not better:
        return None
    which = "it" if missing_parts.leader(tried) else cause.text
    tuning.say(f"{missing_parts.text_of(tried)}; the tuning continues with {which}")
    return again, completed, lines


def _is_given(tuning: TuningFolder, cause: missing_parts.Tried) -> bool:
    """Returns True if a cause is a number whose value the user gave."""
    return bool(cause.option) and not _given_priors(tuning).isdisjoint(cause.values)


def _far_from_model(tuning: TuningFolder, cause: missing_parts.Tried) -> bool:
    """Returns True if a cause is a number that differs so much from the model that a user should
    decide whether it is right."""
    given = linear.facts(tuning.given).parameters
    changes = [value / given[name].value for name, value in cause.values.items() if name in given]
    return bool(cause.option) and any(
        abs(math.log(change)) > math.log(NUMBER_CHANGE_MAX) for change in changes
    )


def _every(tuning: TuningFolder) -> list[str]:
    """Returns the names of the responses out of contact and at each force."""
    return ["free", *(f"{force:g}N" for force in tuning.order.forces)]


def _attempt(
    tuning: TuningFolder, free: FreeResponse, measured: MeasuredResponses, moving_N: float,
    spread: float,
) -> _Attempt:  # fmt: skip
    """Fits the model with the friction `moving_N` in guide and gear, and the measured friction
    under the workpiece. `spread`: prior standard deviation of the logarithm of each damping that
    replaces the friction of guide and gear."""
    order, given = tuning.order, tuning.given
    every = _every(tuning)
    frictions = friction_models.frictions_of(given, moving_N, measured.between.friction_N)
    closed = _closed(tuning, every, frictions, measured)
    path = tuning.folder / RESPONSES_MODEL
    path.unlink(missing_ok=True)
    # for each response: priors of the parameters that belong only to it
    own: list[dict[str, Prior]] = []
    errors: list[float] = []
    dampers: Frictions = ()
    if frictions:
        dampers = friction_models.at_both_ends(given, frictions)
        path.write_text(friction_models.damped(given, dampers), encoding="utf-8")
        model, names = str(path), closed
        own = [_dampers(tuning, name, dampers, free, measured, spread) for name in names]
        errors = [_error(name, frictions, free, measured) for name in names]
    else:
        model = str(given)
        names = closed + _differing(tuning, measured, every[1:], model)
    responses = [_response(tuning.folder / name, model) for name in names]
    sheet = known.priors(model, order.over, order.priors)
    before = sheet | _workpiece(tuning, frictions, measured)
    if len(_under_workpiece(tuning, frictions)) < len(frictions):
        apart = fit_response.read_response(tuning.folder / "free", model)
        responses.append(_speed_response(free, apart))
        own.append({})
        errors.append(joint_fit.MODEL_ERROR)
    states = known.states_of(model, tuning.states)

    def fitted(priors: dict[str, Prior]) -> joint_fit.JointFit:
        return joint_fit.joint(
            model, priors, responses, order.over, own=own, errors=errors, states=states
        )

    found = fitted(before)
    again = _workpiece(tuning, frictions, measured, found.best)
    if any(abs(p.value / before[n].value - 1) > REFIT_CHANGE for n, p in again.items()):
        # The fitted stiffness of the sensor makes the results of the sine test more accurate.
        found = fitted(before | again)
    if found.beyond is not None:
        used, name = before | again, found.beyond
        is_stiffness = name in (workpiece_names(given)[0], sensor_names(given)[0])
        is_measured = is_stiffness and used.get(name) != sheet.get(name)
        if is_measured and measured.between.bends == (1.0, 1.0):
            found.text += ", although its value was measured while the force changed slowly"
            found.remedy = ""  # which frees a value that is given, not one that is measured
        elif used != sheet:
            # A possible cause: the responses contradict the mass that was measured with sines.
            # Another cause: the stiffness depends on the force, so it differs in a slow change.
            found = fitted(sheet)
    return _Attempt(found, frictions, dampers, names, sheet)


def _with_hidden_friction(
    tuning: TuningFolder, free: FreeResponse, measured: MeasuredResponses
) -> _Attempt | None:
    """Fits the friction of guide and gear that the motion out of contact does not show. Each
    response has a damper of its own, and each damping shows a friction at the speed of its
    response. Returns None if no friction explains the responses."""
    guess_N = HIDDEN_SHARE * min(tuning.order.forces)
    wide = _attempt(tuning, free, measured, guess_N, HIDDEN_SPREAD)
    sizes = [
        math.log(values[one.damping] / prior[one.damping].value)
        for name, values in zip(wide.names, wide.found.own, strict=False)
        for prior in [_dampers(tuning, name, wide.dampers, free, measured, HIDDEN_SPREAD)]
        for one in wide.dampers
        if one.damping in prior and one not in _under_workpiece(tuning, wide.dampers)
    ]
    if not sizes:
        return None
    newton = guess_N * math.exp(float(np.median(sizes)))
    done = _attempt(tuning, free, measured, newton, SLIDING_SPREAD)
    return None if done.found.rejected else done


def untold(rows: Mapping[str, ParameterRow], named: Collection[str]) -> list[str]:
    """Returns a text line for each of the parameters `named` whose value the responses hardly
    determine. The law is designed for its whole interval, so it is slower than it could be."""
    return [
        f"the responses tell {name} only as {plain(low, 4)} to {plain(high, 4)} {rows[name].unit}, "
        "and the law is as slow as all of that needs: measure with larger `forces` or more "
        f"`averages`, or give `priors` {name}=VALUE+-PERCENT%"
        for name, (low, high) in ((name, rows[name].interval) for name in named if name in rows)
        if high > UNTOLD_RATIO * low
    ]


def fit_line(tuning: TuningFolder, done: Fitted) -> str:
    """Returns the text about the result of the step `fit`. It states the parameters that vary in
    the design."""
    named = plant_set.ranges_of(done.model, tuning.order.over)
    rows = done.parameters
    text = ", ".join(f"{n} = {done.values[n]:.5g} {rows[n].unit}" for n in named)
    spans = (
        f"{name} = {plain(low, 4)} to {plain(high, 4)} {rows[name].unit}"
        for name, low, high in _spans(done)
    )
    return f"{text}, p = {done.p_value:.2g}; designed for {', '.join(spans)}"


def _spans(done: Fitted) -> list[tuple[str, float, float]]:
    """Returns for each parameter its name, and its lowest and highest value in the set of plants
    for the design. The intervals of the fit are included."""
    ranges = plant_set.ranges_of(done.model, done.over or (), done.values)
    return [(name, low, high) for name, (_, low, high) in ranges.items()]


def _tried(
    tuning: TuningFolder, done: _Attempt, free: FreeResponse, measured: MeasuredResponses
) -> list[missing_parts.Tried]:
    """Fits the candidates for the reason of a rejected fit."""
    tuning.say("the model does not explain the responses: possible causes are fitted")
    speeds = (
        ()
        if done.frictions or free.glide.rubs
        else tuple(_speed_m_per_s(tuning, name, free, measured) for name in done.names)
    )
    tried = missing_parts.of(done.found, tuning.folder, speeds, _given_priors(tuning))
    TRIED.write(tuning.folder, tried)
    return tried


def _explained(
    tuning: TuningFolder, found: joint_fit.JointFit, tried: list[missing_parts.Tried], lacks: str
) -> Refusal:
    """Returns the reason for the rejection of a fit with its cause. `lacks`: TOML text of parts
    that were added to the model before."""
    error, averages = found.least_known
    if found.rejected == "coherence" and (again := _averages(tuning, error, averages)):
        why = (
            f"at the limiting mode of {found.limiting_hz:.3g} Hz, the responses are known to "
            f"{100 * error:.3g} %: they are measured again with {again} averages in place of "
            f"{averages}"
        )
        return MeasureAgain("coherence", found.text, why, averages=again)
    if found.rejected not in EXPLAINED:
        return Refusal(str(found.rejected), found.text, *proposed(tuning, [], lacks))
    cause = missing_parts.leader(tried)
    remedy = f"; {found.remedy}" if found.remedy and not cause else ""
    text = f"{found.text}; {missing_parts.text_of(tried)}{remedy}"
    return Refusal(str(found.rejected), text, *proposed(tuning, tried, lacks))


def _averages(tuning: TuningFolder, error: float, averages: int) -> int:
    """Returns the number of averages with which the relative standard error of a response at the
    limiting mode falls from `error`, with `averages`, to what is permitted, or 0 if that takes too
    many."""
    wanted = AVERAGES_MARGIN * averages * (error / joint_fit.LIMITING_MODE_ERROR_MAX) ** 2
    return math.ceil(wanted) if wanted <= AVERAGES_FACTOR_MAX * tuning.order.averages else 0


def proposed(tuning: TuningFolder, tried: list[missing_parts.Tried], lacks: str) -> tuple[str, str]:
    """Returns the TOML text of all parts that the model lacks by evidence, and the text of the
    model with these parts. `lacks`: TOML text of those parts that `tuning.given` has already.
    Both are "" if nothing is missing. The second is also "" if the user has to decide where a part
    belongs."""
    cause = missing_parts.leader(tried)
    more = cause.toml if cause else ""
    if cause and more and not cause.linear:
        return "\n\n".join(filter(None, (lacks, more))), ""
    if not lacks and not more:
        return "", ""
    whole = missing_parts.with_lines(tuning.given, more) if more else ""
    return (
        "\n\n".join(filter(None, (lacks, more))),
        whole or tuning.given.read_text(encoding="utf-8"),
    )


def _is_linear(tuning: TuningFolder, done: _Attempt, measured: MeasuredResponses) -> bool:
    """Returns True if the responses do not depend on the amplitude, apart from dry friction, which
    has a damper of its own for each of them. Only then do they show what the axis does at every
    amplitude."""
    smaller = not set(done.names) <= set(_every(tuning))
    distorted = not done.frictions and any(
        (one.distorted or 0.0) > analyzer.FORCE.distortion_max for one in measured.levels.values()
    )
    return not (smaller or distorted or known.play_counts(tuning.given))


def _with_model_error(
    tuning: TuningFolder, rejected: joint_fit.JointFit, tried: list[missing_parts.Tried],
    lacks: str,
) -> tuple[joint_fit.JointFit, str]:  # fmt: skip
    """Returns the fit with a model error that explains the responses, and a text about what the
    model may lack. Raises Refusal if the fit contradicts a prior that the user gave, or if the
    response near the limiting mode is not known."""
    why = _explained(tuning, rejected, tried, lacks)
    cause = missing_parts.leader(tried)
    given = rejected.rejected == "prior" and not rejected.surmised
    if rejected.rejected and (given or (cause and _is_given(tuning, cause))):
        raise why
    found = joint_fit.with_model_error(rejected, tuning.order.over)
    if found.rejected:
        raise Refusal(found.rejected, found.text, why.lines, why.model)
    tuning.say(f"{why.text}; the tuning continues with what the responses show beside the model")
    return found, why.text


def _under_workpiece(tuning: TuningFolder, frictions: Frictions) -> Frictions:
    """Returns those friction elements that are between the workpiece and its table. All others are
    in guide and gear."""
    return tuple(one for one in frictions if friction_models.of_workpiece(tuning.given, one))


def _model_lines(tuning: TuningFolder, frictions: Frictions, lacks: str) -> str:
    """Shows what has to be added to the model, and writes the completed model. Returns this as TOML
    text. `lacks`: TOML text of a part that the model lacks beside the friction."""
    if lacks:
        tuning.say("add to the model:")
        for line in lacks.splitlines():
            tuning.say(line)
    if not frictions:
        if tuning.given in _completed(tuning):
            (tuning.folder / FITTED_MODEL).write_bytes(tuning.given.read_bytes())
        return lacks
    text = friction_models.with_friction(tuning.given, frictions)
    (tuning.folder / FITTED_MODEL).write_text(text, encoding="utf-8")
    lines = friction_models.toml_lines(frictions)
    for one in frictions:
        tuning.say(f"dry friction of {plain(one.newton)} N between {' and '.join(one.between)}")
    if lines:
        tuning.say("the model lacks this friction; the tuning continues with it; add to the model:")
        for line in lines.splitlines():
            tuning.say(line)
    return "\n\n".join(text for text in (lacks, lines) if text)


def _response(folder: Path, model: str) -> Measurement:
    """Reads a measured response. The model defines the ages of the forces. Its latency may differ
    from the latency of the measurement."""
    found = fit_response.read_response(folder, model)
    sampling = linear.facts(model).required_reading.sampling
    if found.free or not sampling:
        return found
    mean_s, width_s = sampling.ages_s()
    ages = mean_s * TICKS_PER_S, width_s * TICKS_PER_S
    return replace(found, ages=ages, sinc_order=sampling.sinc_order)


def _closed(
    tuning: TuningFolder, names: list[str], frictions: Frictions, measured: MeasuredResponses
) -> list[str]:
    """Returns the names of the responses during which the backlash of the gear stays closed.

    If the force that pushes the load back is smaller than the friction of the load, the motor moves
    within the backlash. No linear model describes such a response. Out of contact, no force pushes
    the load back. Raises Refusal if no response in contact remains.
    """
    if not known.play_counts(tuning.given):
        return names
    on_table = _under_workpiece(tuning, frictions)
    newton = sum(one.newton for one in frictions if one not in on_table)
    kept = [n for n, level in measured.levels.items() if level.bias_N - level.swing / 2 > newton]
    if not kept:
        raise Refusal(
            "play", "expected a force at which the backlash of the gear stays closed, but at each "
            f"given force the excitation together with the dry friction of {plain(newton)} N opens "
            "the backlash: "
            f"give a force of {plain(1.5 * (newton or max(tuning.order.forces)))} N or more"
        )  # fmt: skip
    gone = [n for n in names if n not in kept]
    if gone:
        tuning.say(f"left out, because the backlash of the gear opens: {', '.join(gone)}")
    return kept


def _dampers(
    tuning: TuningFolder, name: str, frictions: Frictions, free: FreeResponse,
    measured: MeasuredResponses, spread: float,
) -> dict[str, Prior]:  # fmt: skip
    """Returns {parameter: Prior} of the dampers that replace the friction elements in a response.
    `spread`: as for _attempt()."""
    response = _figures(name, free, measured)
    speed_m_per_s = _speed_m_per_s(tuning, name, free, measured)
    on_table = _under_workpiece(tuning, frictions)
    found = {}
    for one in frictions:
        if one in on_table and name == "free":
            continue
        if one in on_table and response.swing / 2 < friction.SLIDE_FACTOR * one.newton:
            found[one.damping] = Prior(STUCK_DAMPING, SLIDING_SPREAD)
        elif one.newton > 0:
            damping = friction.damping(one.newton, max(speed_m_per_s, 1e-7))
            own = STICKING_SPREAD if one in on_table else spread
            found[one.damping] = Prior(damping, own)
    return found


def _figures(name: str, free: FreeResponse, measured: MeasuredResponses) -> ResponseFigures:
    """Returns the numbers of the response with the name `name`. Those of a response with the
    smaller amplitude are the ones that its force has for it."""
    if name == "free":
        return free
    level = measured.levels.get(name)
    if level:
        return level
    of_force = next(force for force in measured.levels if small_of(force) == name)
    return measured.levels[of_force].small or measured.levels[of_force]


def _speed_m_per_s(
    tuning: TuningFolder, name: str, free: FreeResponse, measured: MeasuredResponses
) -> float:
    """Returns the rms speed of the axis in m/s while a response was measured."""
    scale = abs(linear.facts(tuning.given).required_encoder.scale)
    speed = _figures(name, free, measured).speed_rms / scale
    if name == "free":
        return speed
    # In contact, speed_rms is the rms rate of change of the force.
    # The compliances of `between` are in counts/N.
    return speed * (measured.between.compliance + measured.between.sliding)


def _error(
    name: str, frictions: Frictions, free: FreeResponse, measured: MeasuredResponses
) -> float:
    """Returns the relative error of a response, which no change of the parameters can remove.

    The error grows with the ratio of the friction of guide and gear to the rms force of the
    excitation. An axis that sticks for most of the time has errors that are similar at neighbouring
    frequencies, so its response must have little weight in the fit.
    """
    response = _figures(name, free, measured)
    # rms value of noise whose values are equally frequent
    rms_codes = response.amplitude / math.sqrt(3)
    ratio = free.glide.dead_zone / rms_codes if free.glide.rubs else 0.0
    held = RUBBING_ERROR * ratio * (1 + (ratio / RUBBING_RATIO) ** 2)
    on_table = any(one.name == friction_models.TABLE for one in frictions) and name != "free"
    return math.hypot(STICKING_ERROR if on_table else SLIDING_ERROR, min(held, RUBBING_ERROR_MAX))


def _speed_response(free: FreeResponse, apart: Measurement) -> Measurement:
    """Returns the speed per DAC code of the sliding axis, in the form of a response with a single
    frequency. Friction does not change this speed, because the axis slides in one direction."""
    exact = complex(free.glide.rate / (2j * np.pi * SPEED_RESPONSE_HZ))
    one = np.ones(1)
    return replace(
        apart, frequency_hz=SPEED_RESPONSE_HZ * one, response=np.full(1, exact), coherence=one,
        floor=0 * one, variance=(SPEED_ERROR * abs(exact)) ** 2 * one,
    )  # fmt: skip


def _given_priors(tuning: TuningFolder) -> set[str]:
    """Returns the names of the parameters for which the user gave a prior."""
    return {text.partition("=")[0] for text in tuning.order.priors}


def _workpiece(
    tuning: TuningFolder, frictions: Frictions, measured: MeasuredResponses,
    best: Values | None = None,
) -> dict[str, Prior]:  # fmt: skip
    """Returns the priors of stiffness and mass of a workpiece with dry friction. They are computed
    from the travel between the forces and from the test with sines. `best`: {parameter: value} of
    an earlier fit, or None before the first fit."""
    on_table = _under_workpiece(tuning, frictions)
    if not any(one.newton > 0 for one in on_table):
        return {}
    sliding, shaken = measured.between.sliding, measured.shaken
    stiffness, mass = workpiece_names(tuning.given)
    sensor, damping = sensor_names(tuning.given)
    if shaken and best and sensor in best:
        shaken = sine_excitation.of_sines(shaken.rows, best[sensor], best.get(damping or "", 0.0))
    facts, given = linear.facts(tuning.given), _given_priors(tuning)
    scale = abs(facts.required_encoder.scale)
    found: dict[str, Prior] = {}
    # While the workpiece sticks, the sensor's compliance is at most the measured compliance.
    # The measured compliance also contains the compliance of all elements that the model lacks.
    stuck = measured.between.compliance
    is_soft = sensor and best and sensor in best and scale / best[sensor] > STUCK_MORE * stuck
    if sensor and is_soft and stuck > STUCK_SHARE_MIN * sliding:
        found[sensor] = Prior(scale / stuck, TRAVEL_STIFFNESS_ERROR, False)
    if stiffness and sliding:
        value = scale / sliding
        found[stiffness] = Prior(value, TRAVEL_STIFFNESS_ERROR, False)
        # mean of both stiffnesses (from travel and from sines), weighted by their errors
        if shaken and shaken.stiffness > 0:
            error = max(SINE_ERROR_MIN, shaken.stiffness_error)
            weights = np.array([TRAVEL_STIFFNESS_ERROR**-2, error**-2])
            mean = np.exp(weights @ np.log([value, shaken.stiffness]) / weights.sum())
            found[stiffness] = Prior(float(mean), float(weights.sum() ** -0.5), False)
    if mass and shaken and _determine_mass(shaken):
        found[mass] = Prior(shaken.mass, max(SINE_ERROR_MIN, shaken.mass_error), True)
    # for the mass of a workpiece that did not slide, see _with_tolerances()
    elif mass and mass not in given:
        if not all(one.declared for one in on_table):
            raise Refusal(
                "friction", "expected a workpiece that slides on its table, but dry friction of "
                f"{plain(on_table[0].newton)} N holds the workpiece at all forces within the "
                "bounds, so that its mass cannot be measured. Add the friction to the model, weigh "
                f"the workpiece, and give its mass as a prior, {mass}=KG. Without this prior, the "
                f"law is designed for masses from 1/{UNKNOWN_MASS_FACTOR:g} to "
                f"{UNKNOWN_MASS_FACTOR:g} times the mass in the model",
                friction_models.toml_lines(frictions),
                friction_models.with_friction(tuning.given, frictions),
            )  # fmt: skip
        found[mass] = Prior(facts.parameters[mass].value, known.MASS_SPREAD, True)
    return {name: prior for name, prior in found.items() if name not in given}


def _determine_mass(shaken: sine_excitation.SineTestResult | None) -> bool:
    """Returns True if the workpiece slid so far in the test with sines that its mass was measured
    accurately enough."""
    return shaken is not None and shaken.mass > 0 and shaken.mass_error < SINE_MASS_ERROR_MAX


def _with_tolerances(
    tuning: TuningFolder,
    plants: PlantSet,
    values: Values,
    sheet: dict[str, Prior],
    frictions: Frictions,
    measured: MeasuredResponses,
) -> tuple[PlantSet, list[str]]:
    """Returns the set of plants for a design with dry friction. Also returns a text for each
    parameter whose value in the design differs from the fit. `plants`: set of plants around the
    fitted values `values`. `sheet`: the prior values.

    In the fit, dampers represent the dry friction of each response. The plant of the design has no
    such dampers, because it slides. The fit cannot distinguish friction from damping. Therefore all
    dampings of the design are together either at the low end or at the high end of a range around
    the prior, DAMPING_DEVIATIONS from its value. If a fitted value is below the low end, it
    replaces the low end.
    """
    parameters = linear.facts(plants.model).parameters
    ranges, lines = dict(plants.ranges), []
    low: Values = {}
    high: Values = {}
    for name, prior in sheet.items():
        if name in values and parameters[name].unit == "N s/m" and name not in ranges:
            width = DAMPING_DEVIATIONS * prior.spread
            low[name] = min(prior.value * math.exp(-width), values[name])
            high[name] = prior.value * math.exp(width)
            lines.append(
                f"{name} from {low[name]:.4g} to {high[name]:.4g} N s/m, the fitted value is "
                f"{values[name]:.4g}: the responses do not distinguish damping from dry friction"
            )
    stiffness, mass = workpiece_names(tuning.given)
    softest, stiffest = measured.between.bends
    if stiffness in ranges and stiffest > 1:
        value, least, most = ranges[stiffness]
        # The stiffness belongs to the mean force of the slow change.
        # The responses at different forces may already show a part of the change of the stiffness.
        sliding = measured.between.sliding
        scale = abs(linear.facts(tuning.given).required_encoder.scale)
        mean = scale / sliding if sliding else value
        asked = plant_set.ranges_of(plants.model, tuning.order.over, values).get(stiffness)
        low_share, high_share = (end / asked[0] for end in asked[1:]) if asked else (1.0, 1.0)
        least = min(least, low_share * mean / stiffest)
        most = max(most, high_share * mean / softest)
        ranges[stiffness] = value, least, most
        lines.append(
            f"{stiffness} from {least:.4g} to {most:.4g} N/m: while the force changed slowly, the "
            f"workpiece was {stiffest:.2g} times as soft at one force as in the mean"
        )
    on_table = _under_workpiece(tuning, frictions)
    unseen = any(one.newton > 0 for one in on_table) and not _determine_mass(measured.shaken)
    if unseen and mass in ranges and mass not in _given_priors(tuning):
        value, least, most = ranges[mass]
        least, most = least / UNKNOWN_MASS_FACTOR, most * UNKNOWN_MASS_FACTOR
        ranges[mass] = (value, least, most)
        lines.append(
            f"{mass} from {least:.4g} to {most:.4g} kg: the workpiece does not slide, so the "
            f"responses do not show its mass; a prior {mass}=KG makes the range smaller"
        )
    together: tuple[Values, ...] = (low, high) if low else ({},)
    doubted = _doubted(plants.model, {*ranges, *low}, values, sheet)
    if doubted:
        together = tuple(one | other for one in together for other in (
            {name: values[name] for name in doubted}, doubted))  # fmt: skip
        lines += [
            f"{name} of {values[name]:.4g} and {value:.4g}: beside dry friction, the responses do "
            "not tell the fitted value from the given one"
            for name, value in doubted.items()
        ]
    for line in lines:
        tuning.say(f"designed for {line}")
    return replace(plants, overrides=values | low, ranges=ranges, together=together), lines


def _doubted(model: str, varied: set[str], values: Values, sheet: dict[str, Prior]) -> Values:
    """Returns {number of the drive: its prior value} of those that the fit moved far from their
    prior. Dry friction can be the reason, because dampers represent it in the fit. `varied`: names
    of parameters that the set of plants varies already."""
    return {
        name: sheet[name].value
        for name in known.drive_parameters(model)
        if name in sheet and name in values and name not in varied
        and abs(math.log(values[name] / sheet[name].value)) > DOUBTED_SPREADS * sheet[name].spread
    }  # fmt: skip


def _name(given: Given | None) -> str | None:
    """Returns the name of the parameter that a model file gives as a value, or None if the value is
    a number."""
    return given if isinstance(given, str) else None


def sensor_names(model: str | Path) -> tuple[str | None, str | None]:
    """Returns the names of two parameters: stiffness and damping of the contact. A name is None if
    the model has a number instead of a parameter."""
    contact = model_file.read(model).contact
    return (_name(contact.stiffness), _name(contact.damping)) if contact else (None, None)


def workpiece_names(model: str | Path) -> tuple[str | None, str | None]:
    """Returns the names of two parameters: stiffness between workpiece and ground, and mass of the
    workpiece. A name is None if the model has a number instead of a parameter."""
    tables = model_file.read(model)
    support, body = tables.support, tables.body(tables.workpiece)
    return _name(support.stiffness) if support else None, _name(body.mass) if body else None


def _differing(
    tuning: TuningFolder, measured: MeasuredResponses, names: list[str], model: str
) -> list[str]:
    """Compares the two responses at each force. One has a larger amplitude, the other a smaller
    one.

    Returns the folders of those responses with the smaller amplitude that differ from the other
    one. Also writes these differences to the result of the step `measure`.
    """
    found, levels = [], dict(measured.levels)
    for name in names:
        small = small_of(name)
        if not (tuning.folder / small).exists():
            continue
        one, other = (fit_response.read_response(tuning.folder / n, model) for n in (name, small))
        if _probability(one, other) < DIFFERENCE_PROBABILITY:
            tuning.say(f"{name}: the response with the smaller amplitude differs")
            levels[name] = replace(levels[name], differs=True)
            found.append(small)
    if found:
        held = LEVELS.required(tuning.folder)
        LEVELS.write(tuning.folder, replace(held, result=levels))
    return found


def _probability(one: Measurement, other: Measurement) -> float:
    """Returns the probability that noise alone causes a difference as large as that between two
    responses. Both responses have the same spectral lines."""
    variance = one.variance + other.variance + (joint_fit.MODEL_ERROR * abs(one.response)) ** 2
    dof = min(one.dof, other.dof)
    ratio = abs(one.response - other.response) ** 2 / variance
    size = float(np.sum(2 * dof * np.log1p(ratio / dof)))
    return chi_square_tail(size, 2 * len(ratio))


def validity_lines(measured: MeasuredResponses, fitted: Fitted | None) -> list[str]:
    """Returns text lines about the forces and amplitudes for which the predictions are valid, and
    about forces that were not measured. `fitted`: result of the step `fit`, or None before this
    step."""
    between, frictions = measured.between, fitted.friction if fitted else ()
    lines = [
        f"the axis was moved slowly between {between.low_N:.3g} and {plain(between.high_N)} N: "
        "forces outside this range were not measured"
    ]
    lines += [f"designed for {line}" for line in (fitted.relied if fitted else ())]
    if fitted and fitted.unexplained:
        lines.append(
            "the model lacks a part of the axis, so the law is designed with the measured "
            f"responses beside the model: {fitted.why_not}"
        )
    if fitted and fitted.left_out:
        lines.append(
            f"the backlash of the gear opens at {', '.join(fitted.left_out)}: these responses were "
            "left out, and the predictions are valid while the backlash stays closed"
        )
    for level in measured.levels.values():
        text = f"with {plain(level.bias_N)} N: noise of {level.amplitude} codes, "
        text += f"{plain(level.swing)} N from peak to peak"
        if level.small:
            text += f", and {level.small.amplitude} codes, {plain(level.small.swing)} N"
            same = "a different response" if level.differs else "the same response"
            text += "" if frictions else f", {same}"
        lines.append(text)
    shaken = measured.shaken
    if frictions and shaken:
        lines.append(
            f"sines of {min(shaken.hz):.3g} to {max(shaken.hz):.3g} Hz with "
            f"{plain(min(shaken.newton))} to {plain(max(shaken.newton))} N made the workpiece slide"
        )
    if frictions:
        lines.append(
            "the axis has dry friction: the predictions are valid while the axis slides, and while "
            "the workpiece slides or sticks; smaller amplitudes have more damping"
        )
    lines.append("larger amplitudes were not measured")
    return lines
