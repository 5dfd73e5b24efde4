"""Part of the command `identify fit` for an axis with dry friction. In the fit, dampers represent
the friction.

If a model is rejected, it is fitted again with a damper in place of each friction element. The
dampers replace the frictions that the measurement has found. If the measurement did not search for
friction, all possible friction elements are tried. The damping depends on the amplitude of the
response. The friction force in N is computed from the damping and the recorded speed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forceaxis import files, linear, paths
from forceaxis._core import InputError
from forceaxis.commission import friction, friction_models, joint_fit, known
from forceaxis.commission.friction_models import FrictionElement
from forceaxis.commission.level import MeasuringOrder
from forceaxis.commission.measuring import AxisMeasurementSummary
from forceaxis.commission.refusal import Refusal
from forceaxis.commission.tune_fit import (
    SLIDING_ERROR,
    SLIDING_SPREAD,
    STICKING_ERROR,
    STUCK_DAMPING,
    workpiece_names,
)
from forceaxis.identify import fit as fit_response
from forceaxis.identify.measurement import Measurement
from forceaxis.results import from_json

OTHER_STARTS = 2  # a fit with dampers is repeated from this number of additional start values
# Start value of a damping in N s/m, divided by (moving mass times middle angular frequency).
START_SHARE = 0.1


@dataclass(frozen=True)
class RecordedFriction:
    """Dry friction that the file of a measured response states.

    `dead_zone`: dead zone of guide and gear in DAC codes. `moving_N`: friction of guide and gear in
    N. `speed`: rms speed of the axis in m/s. None means an unknown value.
    """

    is_recorded: bool = False  #: True if the measurement searched for friction
    dead_zone: float = 0.0
    moving_N: float | None = None
    table_N: float = 0.0  #: friction in N between the workpiece and its table
    slides: bool = True  #: True if the workpiece slid while the response was measured
    is_least: bool = False  #: True if the friction of guide and gear is a lower bound
    speed: float | None = None

    @property
    def rubs(self) -> bool:
        """Returns True if dry friction was found."""
        return self.dead_zone > 0 or self.table_N > 0


def recorded_friction(
    path: str | Path, model: str, overrides: linear.Overrides
) -> RecordedFriction:
    """Reads the measured dry friction from the folder of a measurement.

    If the file states the friction only in DAC codes, the codes are converted to N with the model.
    If the folder has no friction file, the friction is unknown.
    """
    file = Path(path) / "result.json"
    try:
        table = files.read_json(file, "the summary of a measurement", has_constants=True)
        about = from_json(AxisMeasurementSummary, table, str(file))
    except (OSError, InputError):
        return RecordedFriction()
    found = about.friction
    if found is None:
        return RecordedFriction()
    moving_N, slow, directions = found.moving_N, found.slow, found.directions
    if moving_N is None and found.dead_zone_codes:
        newton = known.newton_per_code(model, overrides)
        # A code of a drive with an integral has no constant force.
        integral = known.has_integral(model, MeasuringOrder.band_hz, overrides)
        moving_N = None if integral else found.dead_zone_codes * newton
    counts: float | None = about.speed_rms  # rms speed in encoder counts/s or force counts/s
    if about.bias_N is not None:
        counts = about.speed_rms * (slow.compliance + slow.sliding) if slow else None
    encoder = linear.facts(model, overrides).encoder
    return RecordedFriction(
        is_recorded=True,
        dead_zone=found.dead_zone_codes,
        moving_N=moving_N,
        table_N=found.workpiece_N or 0.0,
        slides=found.workpiece_slides is not False,
        is_least=found.glide is None and directions is not None and directions.least,
        speed=None if counts is None or not encoder else counts / abs(encoder.scale),
    )


@dataclass(frozen=True)
class FittedDamper:
    """A damper that replaces dry friction in a fit.

    `newton`: friction in N, or None if it is unknown. `damping`: damping in N s/m, or None if the
    two bodies do not move against each other. `declared`: True if the model contains a [[friction]]
    element for this friction.
    """

    name: str
    between: tuple[str, str]
    newton: float | None
    damping: float | None
    declared: bool


@dataclass(frozen=True)
class FittedDampers:
    """All dampers of a fit, and the [[friction]] elements that have to be added to the model, as
    TOML text."""

    freed: tuple[FittedDamper, ...]
    lines: str


@dataclass(frozen=True)
class AxisFitSummary(fit_response.FitSummary):
    """The result of a fit. `friction` contains the dampers that replace dry friction. It is None if
    the model explains the response without dampers, or if the model is rejected."""

    friction: FittedDampers | None = None


@dataclass(frozen=True)
class DamperFit:
    """A fit in which dampers replace friction elements, and the Measurement whose model contains
    these dampers. `newtons` is {name of a friction: force in N, or None if the force is
    unknown}."""

    found: fit_response.ParameterFit
    measured: Measurement
    frictions: tuple[FrictionElement, ...]
    newtons: dict[str, float | None]

    def dampers(self) -> FittedDampers:
        """Returns the fitted dampers, and the friction elements that have to be added to the model,
        in the form of the JSON output."""
        values = dict(zip(self.found.names, self.found.values.tolist(), strict=True))
        rows = [
            FittedDamper(
                one.name, one.between, self.newtons[one.name], values.get(one.damping), one.declared
            )
            for one in self.frictions
        ]
        measured = [
            replace(one, newton=newton)
            for one in self.frictions if (newton := self.newtons[one.name]) is not None
        ]  # fmt: skip
        return FittedDampers(tuple(rows), friction_models.toml_lines(tuple(measured)))


def fit(
    measured: Measurement, starts: dict[str, float], units: dict[str, str], path: str | Path,
    folder: Path,
) -> tuple[fit_response.ParameterFit, Measurement, AxisFitSummary]:  # fmt: skip
    """Fits parameters of a model to the response in the folder `path`.

    Returns the fit, the Measurement with the fitted model, and a summary. `folder`: folder to which
    the file of a model with dampers is written. Raises InputError. Raises a Refusal with the name
    `friction` if dampers do not explain the response.
    """
    model = measured.model
    found = fit_response.fit(measured, starts)
    about = recorded_friction(path, model, measured.overrides)
    with_dampers = _with_fewest_dampers(measured, starts, about, folder) if found.rejected else None
    if with_dampers is not None:
        units = units | {one.damping: "N s/m" for one in with_dampers.frictions}
        found, measured = with_dampers.found, with_dampers.measured
    elif found.rejected and about.rubs:
        raise _refusal(found.p_value, model, about)
    summary = AxisFitSummary(**vars(fit_response.summarise(found, measured, units)))
    if with_dampers is not None:
        summary = replace(summary, model=paths.display(model), friction=with_dampers.dampers())
    elif about.rubs:
        warning = (
            f"the axis has dry friction, {_in_words(about)}: smaller amplitudes have another "
            "response"
        )
        summary = replace(summary, warnings=(*summary.warnings, warning))
    return found, measured, summary


def _with_fewest_dampers(
    measured: Measurement, starts: dict[str, float], about: RecordedFriction, folder: Path
) -> DamperFit | None:
    """Returns the fit with the smallest number of dampers among those that explain a response.
    Returns None if no dampers explain the response."""
    model = measured.model
    moving: list[FrictionElement] = []
    table: list[FrictionElement] = []
    for one in friction_models.frictions_of(model, 1.0, 1.0):
        (table if friction_models.of_workpiece(model, one) else moving).append(one)
    if about.is_recorded:
        sets = [(moving if about.dead_zone else []) + (table if about.table_N else [])]
    else:
        sets = [moving, *([] if measured.free else [table, moving + table])]
    best = None
    # A damper cannot represent the friction of a workpiece that slides only sometimes.
    # With a damper, the fitted mass of this workpiece would be far too large.
    fits_workpiece = not starts.keys().isdisjoint(workpiece_names(model))
    for frictions in filter(None, dict.fromkeys(map(tuple, sets))):
        has_table = any(one in table for one in frictions)
        if has_table and about.slides and fits_workpiece:
            continue
        error = STICKING_ERROR if has_table and not about.slides else SLIDING_ERROR
        tolerant = replace(
            measured, variance=measured.variance + (error * abs(measured.response)) ** 2
        )
        dampers = [_damper_of(one, one in table, about) for one in frictions]
        fitted = _with_dampers(tolerant, starts, dampers, about.speed, folder)
        if fitted is None or fitted.found.rejected:
            continue
        fitted = replace(fitted, found=_with_common_error(fitted, error))
        # A damper is accepted if the fit improves by more than the penalty of a parameter.
        if not about.is_recorded:
            plain = fit_response.fit(tolerant, starts, tries=OTHER_STARTS)
            count = len(fitted.found.names) - len(starts)
            penalty = count * math.log(2 * fitted.found.points)
            if fitted.found.chi_square + penalty > plain.chi_square:
                continue
        if best is None or fitted.found.p_value > best.found.p_value:
            best = fitted
    return best


def _with_common_error(fitted: DamperFit, error: float) -> fit_response.ParameterFit:
    """Returns a fit whose intervals include what the relative error of a damper does if it has the
    same sign at neighbouring frequencies: gain and phase of the response are changed, in all the
    band and in opposite directions at its ends, and each change is fitted."""
    found, measured = fitted.found, fitted.measured
    place = np.linspace(0.0, math.pi, len(measured.frequency_hz))
    starts = dict(zip(found.names, found.values.tolist(), strict=True))
    moves = []
    for change in (error * np.exp(0j * place), 1j * error * np.exp(0j * place),
                   error * np.cos(place), 1j * error * np.cos(place)):  # fmt: skip
        other = replace(measured, response=measured.response * np.exp(change))
        moves.append(np.log(fit_response.fit(other, starts, tries=0).values / found.values))
    common = np.array(moves).T @ np.array(moves)
    wider = np.sqrt(1 + np.diag(common) / np.diag(found.covariance))
    warning = (
        f"dry friction is fitted as a damper, whose error of {100 * error:.0f} % of the response "
        "is in the intervals; `tune` fits several responses at once"
    )
    return replace(
        found, covariance=found.covariance + common, single=found.single * wider,
        joint=found.joint * wider, warnings=(*found.warnings, warning),
    )  # fmt: skip


@dataclass(frozen=True)
class _Damper:
    """The damper that replaces one friction element in a fit.

    `start_N`: friction in N from which the initial damping is computed. `known_N`: measured
    friction in N, or 0 if it is unknown. `sticks`: True if the two bodies do not move against each
    other.
    """

    friction: FrictionElement
    start_N: float
    known_N: float
    sticks: bool


def _damper_of(one: FrictionElement, on_table: bool, about: RecordedFriction) -> _Damper:
    """Returns the damper for one friction element. Its friction force is a fraction of the measured
    friction."""
    total_N = (about.table_N if on_table else about.moving_N) or 0.0
    is_known = on_table or not about.is_least
    return _Damper(
        one, one.newton * total_N, one.newton * total_N if is_known else 0.0,
        sticks=on_table and not about.slides,
    )  # fmt: skip


def _with_dampers(
    measured: Measurement, starts: dict[str, float], dampers: Sequence[_Damper],
    speed: float | None, folder: Path,
) -> DamperFit | None:  # fmt: skip
    """Fits a response with dampers. Returns None if the response does not depend on one of the
    dampers. `speed`: rms speed of the axis in m/s, or None if it is unknown."""
    frictions = tuple(damper.friction for damper in dampers)
    file = folder / f"{'_'.join(one.name for one in frictions)}.toml"
    file.write_text(friction_models.damped(measured.model, frictions), encoding="utf-8")
    free, stuck = {}, {}
    for damper in dampers:
        if damper.sticks:
            stuck[damper.friction.damping] = STUCK_DAMPING
        else:
            start = _start_damping(measured, damper.start_N, speed)
            free[damper.friction.damping] = start
    model = str(file)
    # The parameters of the replaced friction elements do not exist in the model with dampers.
    left = linear.facts(model).parameters
    held = {name: value for name, value in measured.overrides.items() if name in left}
    slides = replace(
        measured, model=model, overrides=held | stuck,
        modes=known.states_of(model, measured.modes),
    )  # fmt: skip
    try:
        found = fit_response.fit(slides, starts | free, tries=OTHER_STARTS)
    # The response depends on the damper only together with another parameter, or not at all.
    except InputError:
        return None
    # A parameter of a workpiece that sticks does not change the response.
    if found.single.max() > fit_response.SEARCH_RANGE:
        return None
    values = dict(zip(found.names, found.values.tolist(), strict=True))
    newtons = {}
    for damper in dampers:
        newton, damping = damper.known_N, values.get(damper.friction.damping)
        if not newton and speed and damping is not None:
            newton = damping * speed / friction.damping(1.0, 1.0)
        newtons[damper.friction.name] = newton or None
    return DamperFit(found, slides, frictions, newtons)


def _start_damping(measured: Measurement, newton: float, speed: float | None) -> float:
    """Returns the damping in N s/m at which a fit begins. `newton`: friction force in N. `speed`:
    rms speed in m/s, or None."""
    if newton and speed:
        return friction.damping(newton, speed)
    moving = linear.facts(measured.model, measured.overrides).moving_kg()
    middle = 2 * math.pi * float(np.median(measured.frequency_hz))
    return START_SHARE * moving * middle


def _in_words(about: RecordedFriction) -> str:
    parts = []
    if about.dead_zone:
        newton = "" if about.moving_N is None else f" or {about.moving_N:.3g} N"
        least = "at least " if about.is_least else ""
        parts.append(f"guide and gear take {least}{about.dead_zone:.3g} codes{newton}")
    if about.table_N:
        parts.append(f"{about.table_N:.3g} N under the workpiece")
    return ", ".join(parts)


def _refusal(p: float, model: str, about: RecordedFriction) -> Refusal:
    frictions = friction_models.frictions_of(model, about.moving_N or 0.0, about.table_N)
    lines = friction_models.toml_lines(tuple(one for one in frictions if one.newton > 0))
    if about.is_least and about.moving_N:
        lines = f"# friction of guide and gear: a lower bound\n{lines}"
    hidden = (
        "noise does not show stiffness and mass of a workpiece with dry friction, the sines of "
        "`tune` do; "
        if about.table_N else ""
    )  # fmt: skip
    return Refusal(
        "friction", "expected a model that explains the measured response, but the response does "
        f"not fit (p = {p:.2g}), and a damper cannot represent the measured friction "
        f"({_in_words(about)}): {hidden}add the friction to the model, fit further parameters, or "
        "measure with a larger force or excitation level", lines,
    )  # fmt: skip


def joint(
    model: str | Path, priors: dict[str, known.Prior], measured: list[Measurement],
    paths_of: Sequence[str | Path], over: tuple[str, ...], states: dict[str, str], folder: Path,
) -> joint_fit.JointFit:  # fmt: skip
    """Fits all responses of an axis simultaneously by joint_fit.joint().

    If the model is rejected, repeats the fit with dampers for the measured friction of guide and
    gear. `paths_of`: folders of the responses. Raises a Refusal with the name `friction` if there
    is friction between the workpiece and its table, or if the model with dampers does not explain
    the responses.
    """
    found = joint_fit.joint(model, priors, measured, over, states=states)
    about = [recorded_friction(path, str(model), {}) for path in paths_of]
    worst = max(about, key=lambda one: (one.table_N, one.dead_zone))
    if not found.rejected or not worst.rubs:
        return found
    moving_N = max(one.moving_N or 0.0 for one in about)
    frictions = friction_models.frictions_of(model, moving_N, 0.0)
    frictions = tuple(one for one in frictions if one.newton > 0)
    frictions = friction_models.at_both_ends(model, frictions)
    if not worst.table_N and frictions:
        file = folder / "slides.toml"
        file.write_text(friction_models.damped(model, frictions), encoding="utf-8")
        own = [
            {
                one.damping: known.Prior(
                    _start_damping(response, one.newton, row.speed), SLIDING_SPREAD
                )
                for one in frictions if row.dead_zone
            }
            for response, row in zip(measured, about, strict=True)
        ]  # fmt: skip
        errors = [SLIDING_ERROR if one else joint_fit.MODEL_ERROR for one in own]
        slides = joint_fit.joint(
            str(file), priors, measured, over, own=own, errors=errors,
            states=known.states_of(str(file), states),
        )  # fmt: skip
        if not slides.rejected:
            return slides
    raise _refusal(found.p, str(model), worst)
