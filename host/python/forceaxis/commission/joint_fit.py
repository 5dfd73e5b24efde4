"""Fits the parameters of a model to all frequency responses of one axis, together with prior
knowledge.

    found = joint(model, priors(model, over), [free, at_30_N, at_150_N], over)
    # for a rejected fit instead: found.rejected, found.text
    found.values, found.intervals, found.over

Responses in contact determine only ratios of masses, stiffnesses and the force constant of the
drive. The absolute values are determined by the response out of contact and by the priors, and are
only as accurate as these. The remaining uncertainty does not change the force loop of the measured
plant, because the measured responses contain the complete path from the DAC code to the measured
force. But it changes the loops of plants with tolerances. For example, if one stiffness is fitted
too large and another one too small, the mode of a workpiece with another mass has a wrong
frequency. Therefore the set of plants for which a force law is designed includes this uncertainty
in addition to the tolerances.
"""

import itertools
import math
from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from forceaxis import linear
from forceaxis._core import InputError
from forceaxis.commission import known
from forceaxis.commission.known import Prior
from forceaxis.design import sets
from forceaxis.identify.distributions import chi_square_bound, chi_square_tail, normal_bound
from forceaxis.identify.fit import REJECTED_BELOW
from forceaxis.identify.measurement import CONFIDENCE, Measurement
from forceaxis.linear import loops, plant_set
from forceaxis.linear.over import LOAD_ANGLE
from forceaxis.words import option_words

Values = dict[str, float]  # {parameter: SI value}
States = dict[str, str]  # {element: state}
# Parameters of one response alone: {parameter of the model: (name in the priors, factor)}.
# The value of such a parameter is the factor times the value of that name.
Own = dict[str, tuple[str, float]]
Samples = NDArray[np.float64]
Response = NDArray[np.complex128]

# The following distances of a parameter from its prior are in prior standard deviations.
# PRIOR_DISTANCE_MAX: distance of a parameter beyond which a fit is rejected.
# SEARCH_RANGE: largest distance of a parameter that is searched.
# FAR: distance of a parameter beyond which a second search begins at the prior.
PRIOR_DISTANCE_MAX, SEARCH_RANGE, FAR = 3.0, 6.0, 1.5
# Share of SEARCH_RANGE beyond which a parameter is regarded as at the end of the search.
SEARCHED_SHARE = 0.95
# Factor of the measured response that is used as the prediction for values that the model refuses.
FORBIDDEN = 1e3
MODEL_ERROR = 0.01  # relative error of a model, which no change of its parameters can remove
# If a model does not explain the responses, its relative error is computed at each frequency.
# ERROR_WIDTH_LOG: width of the mean over residuals, as a difference of logarithms of frequencies.
# ERROR_ROUNDS: number of repetitions of the fit with the computed relative errors of the model.
# ERROR_REACH: largest distance of a parameter from its prior in repeated fits, in prior deviations.
ERROR_WIDTH_LOG, ERROR_ROUNDS, ERROR_REACH = 0.1, 6, 2.0
# Width of a band in which a model has to explain a response: difference of logarithms in Hz.
LOCAL_WIDTH_LOG = 0.2
# GRID_POINTS: number of start values of each nearly unknown parameter.
# ANTIRESONANCES: number of start frequencies of the antiresonance.
# SEARCHES_MAX: number of best points of the grid from which a search begins.
GRID_POINTS, ANTIRESONANCES = 7, 28
SEARCHES_MAX = 2
# A frequency is near the limiting mode if their logarithms differ by less than this value.
LIMITING_MODE_WIDTH_LOG = 0.15
# A limiting mode is at half the rate of the force sensor up to this relative difference.
HALF_RATE_WIDTH = 0.02
# Largest relative standard error of a response near the limiting mode.
LIMITING_MODE_ERROR_MAX = 0.2
# Largest standard error of the logarithm of a damping that the responses determine.
DAMPING_UNIT, DAMPING_ERROR_MAX = "N s/m", 0.1
GIVEN_PERCENT = 10  # accuracy of a number that a text prints as a prior
STEP_LOG = 1e-5  # step of the logarithm of a parameter for a numerical derivative
PREDICTIONS_MAX = 200  # largest number of predictions that are stored for reuse
COMBINATIONS_MAX = 9  # largest number of tried combinations of modes, one mode for each response
# LEVEL_ constants are differences of the logarithm of a parameter between two forces.
# LEVEL_DISTANCE_MAX_LOG: largest difference between two forces that one plant can explain.
# LEVEL_CHANGE_LOG: smallest difference between two forces that is regarded as a change.
LEVEL_DISTANCE_MAX_LOG, LEVEL_CHANGE_LOG = 0.3, 0.02


@dataclass(frozen=True)
class ResponseScore:
    """The test whether a model explains one measured response.

    `name`: "apart" or "in contact". `points`: number of frequencies. `modes`: {element: state} in
    which the model is linearised. `p`: probability that chi-square is at least as large for a
    correct model, over all frequencies or in a narrow band.
    """

    name: str
    points: int
    modes: dict[str, str]
    chi2: float
    dof: int
    p: float


@dataclass(frozen=True, kw_only=True)
class JointSummary:
    """The result of joint() in the form for JSON.

    Most fields are None for a rejected fit. `order`: names of the parameters, in the order of the
    rows of the correlation matrix. `why`: reason for the rejection as text. `set`: the values as
    options of the command line.
    """

    model: str = ""
    values: Values | None = None
    best: Values
    intervals: dict[str, tuple[float, float]] | None = None
    ratios: dict[str, tuple[float, float, float]] | None = None
    correlation: tuple[tuple[float, ...], ...] | None = None
    order: tuple[str, ...] = ()
    chi_square: float | None = None
    dof: int | None = None
    p_value: float | None = None
    responses: tuple[ResponseScore, ...] = ()
    levels_differ: bool = False
    rejected: str | None = None
    why: str = ""
    limiting_hz: float | None = None
    over: tuple[str, ...] | None = None
    set: str | None = None


@dataclass
class JointFit:
    """The result of joint(). For a rejected fit, only `rejected`, `text`, `best`, `levels` and the
    chi-square are defined."""

    model: str
    best: Values
    chi2: float
    dof: int
    levels: list[ResponseScore]  #: for each response: test whether the model explains it
    #: the fitted responses; `at` contains the logarithms of the values `best`
    problem: "Responses"
    at: Samples
    rejected: str | None = None  #: reason for the rejection in one word: prior, chi2 or coherence
    text: str = ""  #: text about the reason for the rejection of the fit
    remedy: str = ""  #: text about what to do if the rejected value is right
    #: for a fit that is rejected as prior: the parameter that is too far from its prior value
    beyond: str | None = None
    values: Values | None = None  #: the values `best` if the fit is not rejected, otherwise None
    intervals: dict[str, tuple[float, float]] | None = None  #: {parameter: its 95 % interval}
    #: {"a/b" or "a*b": (value, low, high)} for accurate quotients and products of two parameters
    ratios: dict[str, tuple[float, float, float]] | None = None
    #: correlation matrix; rows and columns in the order of the names in `best`
    correlation: Samples | None = None
    plants: plant_set.PlantSet | None = None  #: the plants for which a force law is designed
    limiting_hz: float | None = None
    #: relative standard error of the least known response there, if it is too large, and the number
    #: of its averages
    least_known: tuple[float, int] = (0.0, 0)
    #: for each response: {parameter: value} of the parameters that belong only to this response
    own: list[Values] = field(default_factory=list)
    #: parameters whose fitted value is far from a prior that is only surmised
    far: tuple[str, ...] = ()
    #: for a fit that is rejected as prior: True if this prior is only surmised
    surmised: bool = False
    #: True if the parameters differ between the forces.
    #: `values` are then mean values, and the ranges contain the values of all forces.
    levels_differ: bool = False

    @property
    def p(self) -> float:
        """Returns the probability that chi-square is at least as large for a correct model."""
        return chi_square_tail(self.chi2, self.dof)

    @property
    def over(self) -> tuple[str, ...]:
        """Returns the ranges of the parameters in `plants` as texts NAME=LOW..HIGH."""
        ranges = self.plants.ranges if self.plants else {}
        return tuple(f"{n}={r[1]:.9g}..{r[2]:.9g}" for n, r in ranges.items())

    def summary(self) -> JointSummary:
        """Returns the result in the form for JSON."""
        summary = JointSummary(
            model=self.model, best=self.best, order=tuple(self.best), chi_square=self.chi2,
            dof=self.dof, p_value=self.p, responses=tuple(self.levels),
            levels_differ=self.levels_differ, rejected=self.rejected, why=self.text,
            limiting_hz=self.limiting_hz, intervals=self.intervals, ratios=self.ratios,
        )  # fmt: skip
        if self.values is None or self.correlation is None:
            return summary
        return replace(
            summary, values=self.values, over=self.over,
            correlation=tuple(map(tuple, self.correlation.tolist())),
            set=" ".join(option_words(set=[f"{n}={v:.6g}" for n, v in self.values.items()])),
        )  # fmt: skip


@dataclass(frozen=True)
class Minimum:
    """The result of a search: logarithms of the best parameters, and half of the sum of squares of
    the residuals."""

    x: Samples
    cost: float


@dataclass
class Responses:
    """The measured responses of one axis, and the model that is fitted to them. Computes residuals
    for given logarithms of the parameters."""

    model: str
    priors: dict[str, Prior]
    measured: list[Measurement]
    # for each response: {element: state} in which the model is linearised
    modes: list[States] = field(default_factory=list)
    # for each response: the parameters that belong only to it
    own: list[Own] = field(default_factory=list)
    # for each response: relative error of the model, for all frequencies or for each of them
    errors: Sequence[float | Samples] = ()
    # {element: state} in which the model is linearised for all responses in contact
    states: States = field(default_factory=dict)
    # largest distance of a parameter from its prior, in standard deviations
    reach: float = SEARCH_RANGE

    def __post_init__(self) -> None:
        self.names = tuple(self.priors)
        self.own = self.own or [{}] * len(self.measured)
        self.errors = self.errors or [MODEL_ERROR] * len(self.measured)
        self.centre: Samples = np.log([p.value for p in self.priors.values()])
        self.spread: Samples = np.array([p.spread for p in self.priors.values()])
        self.modes = self.modes or [{}] * len(self.measured)
        # Predictions of the model that are stored for reuse.
        # The key of a prediction contains the response and the values of its parameters.
        self.known: dict[Hashable, Response] = {}
        self.acting: dict[Hashable, NDArray[np.bool_]] = {}
        self.variance = [
            m.variance + (error * abs(m.response)) ** 2
            for m, error in zip(self.measured, self.errors, strict=True)
        ]

    def all_values(self, x: Samples) -> Values:
        """Returns {name of a parameter in the priors: value} for the logarithms x."""
        return dict(zip(self.names, np.exp(x).tolist(), strict=True))

    def values(self, x: Samples, own: Own | None = None) -> Values:
        """Returns {parameter of the model: value} for one response. `own`: parameters that belong
        only to this response."""
        every = self.all_values(x)
        shared = {name: value for name, value in every.items() if "@" not in name}
        mine = (own or {}).items()
        return shared | {name: factor * every[key] for name, (key, factor) in mine}

    def predictions(self, x: Samples) -> list[Response]:
        """Returns for each measured response the prediction of the model. A prediction is computed
        again only if a parameter has changed on which it depends."""
        found = []
        for m, modes, own in zip(self.measured, self.modes, self.own, strict=True):
            one = (
                m.output,
                m.free,
                m.scale,
                tuple(sorted(modes.items())),
                tuple(own.items()),
                m.frequency_hz.tobytes(),
            )
            if one not in self.acting:
                self.acting[one] = self._acting(replace(m, modes=modes), own)
            key = (one, x[self.acting[one]].tobytes())
            if key not in self.known:
                if len(self.known) > PREDICTIONS_MAX:
                    self.known.clear()
                self.known[key] = self._predicted(m, modes, self.values(x, own))
            found.append(self.known[key])
        return found

    @staticmethod
    def _predicted(measured: Measurement, modes: dict[str, str], values: Values) -> Response:
        """Returns the predicted response. Values that the model refuses together, such as a
        velocity loop that is too fast for the current loop, have a response that a search leaves
        again."""
        try:
            return replace(measured, modes=modes).predict(values)
        except InputError:
            return FORBIDDEN * measured.response

    def _acting(self, measured: Measurement, own: Own) -> NDArray[np.bool_]:
        """Returns for each parameter True if a response depends on it."""
        exact = measured.predict(self.values(self.centre, own))
        moved = [
            measured.predict(self.values(self.centre + d, own)) for d in np.diag(self.spread / 10)
        ]
        return np.array([bool(np.any(abs(h / exact - 1) > 1e-9)) for h in moved])

    def coarse(self, x: Samples) -> Samples:
        """Returns the residuals of the first search. They are the logarithms of the ratio of
        measured and predicted response. With these residuals, the search also converges from
        distant start values."""
        parts = []
        for m, v, h in zip(self.measured, self.variance, self.predictions(x), strict=True):
            relative = np.sqrt(v) / np.maximum(abs(m.response), 1e-300)
            ratio: Response = np.log(m.response / h)
            parts.append(_real(ratio / np.hypot(relative, 0.1)))
        return np.concatenate([*parts, (x - self.centre) / self.spread])

    def scores(self, x: Samples) -> list[Samples]:
        """Returns the residuals of each response as real numbers. The sum of their squares is a
        chi-square with two degrees of freedom for each spectral line; see
        forceaxis.identify.fit."""
        found = []
        for m, v, h in zip(self.measured, self.variance, self.predictions(x), strict=True):
            error = (m.response - h) / np.sqrt(v)
            square = np.maximum(abs(error) ** 2, 1e-30)
            found.append(_real(error * np.sqrt(2 * m.dof * np.log1p(square / m.dof) / square)))
        return found

    def fine(self, x: Samples) -> Samples:
        """Returns the residuals of the likelihood. The residuals of all responses come first, then
        the residuals of the priors."""
        # The factor (dof + 1) / dof of the likelihood is set to 1 here and in the chi-square test.
        return np.concatenate([*self.scores(x), (x - self.centre) / self.spread])

    def information(self, x: Samples, scales: Sequence[float]) -> tuple[Samples, Samples]:
        """Returns two information matrices for the logarithms of the parameters: the first from the
        spectral lines alone, the second from the spectral lines and the priors.

        `scales`: for each response, the factor by which its variance is multiplied.
        """
        shifted = [
            [self.predictions(x + s * STEP_LOG * d) for s in (1, -1)]
            for d in np.eye(len(self.names))
        ]
        known, lines = self.predictions(x), np.zeros((len(x), len(x)))
        for i, (m, v) in enumerate(zip(self.measured, self.variance, strict=True)):
            J = np.stack([(a[i] - b[i]) / (2 * STEP_LOG) for a, b in shifted], 1)
            T = m.dof * v + abs(m.response - known[i]) ** 2
            lines += 2 * m.dof**2 / (m.dof + 1) * (J.conj().T @ (J / T[:, None])).real / scales[i]
        return lines, lines + np.diag(self.spread**-2.0)

    def starts(self) -> list[Samples]:
        """Returns a list of start points for a search. They are the best points of a grid of the
        nearly unknown parameters. All other parameters begin at their prior values.

        The mass of a workpiece is computed from its antiresonance. Frequencies of spectral lines
        are tried as the antiresonance, because a grid of stiffness and mass would miss a narrow
        antiresonance. The damping begins at a large value, with which the antiresonance is wide.
        """
        units = {n: unit for n, (_, unit) in linear.facts(self.model).parameters.items()}
        wide = {
            i: units[name] for i, (name, p) in enumerate(self.priors.items())
            if p.wide and name in units
        }  # fmt: skip
        grids = {i: [1.0] if unit == "N s/m" else np.linspace(-2, 2, GRID_POINTS)
                 for i, unit in wide.items()}  # fmt: skip
        (k, *ks), (m, *ms) = (
            [i for i, unit in wide.items() if unit == wanted] or [-1] for wanted in ("N/m", "kg")
        )
        paired = -1 not in (k, m) and not ks and not ms
        if paired:
            hz = np.concatenate([one.frequency_hz for one in self.measured if not one.free])
            grids[m] = np.log(2 * math.pi * np.geomspace(hz.min(), hz.max(), ANTIRESONANCES))
        found = []
        for chosen in itertools.product(*grids.values()):
            x = self.centre.copy()
            for i, shift in zip(grids, chosen, strict=True):
                x[i] += shift * self.spread[i]
            if paired:
                x[m] = x[k] - 2 * chosen[list(grids).index(m)]
            if np.all(abs(x - self.centre) < 0.9 * self.reach * self.spread):
                size = np.sum(2 * (np.sqrt(1 + self.coarse(x) ** 2) - 1))
                found.append((float(size), x))
        best = [x for _, x in sorted(found, key=lambda pair: pair[0])[:SEARCHES_MAX]]
        # The antiresonance of a light workpiece on a stiff spring is far above all spectral lines.
        return best or [self.centre.copy()]

    def bounds(self, inside: float = 0.0) -> tuple[Samples, Samples]:
        """Returns the lowest and the highest logarithms within which parameters are searched.
        `inside`: margin, in standard deviations, by which this range is reduced."""
        reach = (self.reach - inside) * self.spread
        return self.centre - reach, self.centre + reach

    def near(self, begin: Samples, evaluations: int) -> Minimum:
        """Searches the minimum of the residuals coarse(), beginning at `begin`, or at the end of
        the range that is nearest to it."""
        found = optimize.least_squares(
            self.coarse, np.clip(begin, *self.bounds(1e-3)), loss="soft_l1", bounds=self.bounds(),
            x_scale=self.spread, max_nfev=evaluations,
        )  # fmt: skip
        return Minimum(found.x, float(found.cost))

    def search(self, begin: Samples) -> Minimum:
        """Searches first the minimum of the residuals coarse(). From there, searches the maximum of
        the likelihood."""
        near = np.clip(self.near(begin, 20).x, *self.bounds(1e-3))
        found = optimize.least_squares(
            self.fine, near, bounds=self.bounds(), x_scale=self.spread, max_nfev=25, xtol=1e-7,
            ftol=1e-7,
        )  # fmt: skip
        return Minimum(found.x, float(found.cost))


def _real(values: Response) -> Samples:
    """Returns the real parts of complex values, followed by their imaginary parts."""
    return np.concatenate([values.real, values.imag])


def joint(
    model: str | Path, priors: Mapping[str, Prior], measurements: Sequence[Measurement],
    over: Sequence[str] = (), own: Sequence[Mapping[str, Prior]] = (),
    errors: Sequence[float] = (), states: States | None = None,
) -> JointFit:  # fmt: skip
    """Fits all responses of one axis simultaneously, and returns a JointFit.

    model: path of the model, or its file name without suffix. priors: {parameter: Prior} of the
    parameters to fit. measurements: responses of the axis, out of contact or in contact at some
    force. For responses in contact, the linear range of the amplifier that explains them best is
    used. over: tolerances of the fitted values, as texts NAME=PERCENT% or NAME=LOW..HIGH. own: for
    each response, {parameter: Prior} of the parameters that belong only to this response. An
    example is the damping that represents dry friction at its amplitude. errors: relative model
    error of each response, by default MODEL_ERROR. states: {element: state} in which all responses
    were measured. States of contacts apply only to the responses in contact. A fitted value that is
    far from a surmised prior does not reject the fit; JointFit.far names it. Raises InputError.
    """
    model = str(linear.find_model(model))
    measured = [replace(m, model=model) for m in measurements]
    if not priors or not any(not m.free for m in measured):
        raise InputError("fit: expected at least one parameter to fit and one response in contact")
    mine: list[Own] = [{name: (f"{name}@{i}", 1.0) for name in one} for i, one in enumerate(own)]
    every = dict(priors)
    every |= {mine[i][name][0]: p for i, one in enumerate(own) for name, p in one.items()}
    states = dict(states or {})
    without = known.states_apart(model, states)
    begin = [without if m.free else states for m in measured]
    problem = _in_modes(Responses(model, every, measured, begin, mine, list(errors), states))
    best = searched(problem)
    found = _evaluated(problem, best, over)
    if found.rejected == "chi2":
        apart = _by_level(problem, best)
        if apart is not None:
            return _evaluated(problem, apart.mean(0), over, apart)
    return found


def with_model_error(rejected: JointFit, over: Sequence[str]) -> JointFit:
    """Fits the model again with the relative errors that its residuals show, each at its frequency.
    Responses then count where the model explains them. Returns a JointFit with the errors in
    problem.errors. The JointFit has the parameters of the model that is nearest to the responses,
    with wider intervals. `rejected`: a fit that is rejected as chi2 or prior. `over`: as for
    joint()."""
    problem, x = replace(rejected.problem, reach=ERROR_REACH), rejected.at
    x = np.clip(x, *problem.bounds(1e-3))
    for _ in range(ERROR_ROUNDS):
        errors = []
        for m, h in zip(problem.measured, problem.predictions(x), strict=True):
            near = abs(np.log(m.frequency_hz[:, None] / m.frequency_hz)) < ERROR_WIDTH_LOG
            square = near @ (abs(m.response - h) ** 2) / (near @ (abs(m.response) ** 2))
            errors.append(np.maximum(MODEL_ERROR, np.sqrt(square)))
        problem = replace(problem, errors=errors)
        x = problem.search(x).x
    return _evaluated(problem, x, over)


def with_levels(
    found: JointFit, name: str, values: Mapping[str, float], over: Sequence[str]
) -> JointFit:
    """Returns a fit in which the parameter `name` differs between the forces. The fitted value is
    the geometric mean, and the set of plants contains the values at all forces. `values`: first
    values as {"name@i": value at response i}, beside the other parameters of `found`."""
    own: list[Own] = [
        one | ({name: (f"{name}@{i}", 1.0)} if f"{name}@{i}" in values else {})
        for i, one in enumerate(found.problem.own)
    ]
    priors = found.problem.priors | {key: Prior(value, 0.7) for key, value in values.items()}
    wider = replace(found.problem, priors=priors, own=own)
    best = wider.search(np.append(found.at, np.log(list(values.values()))))
    x = best.x[: len(found.at)]
    rows = np.array([x] * len(values))
    at = found.problem.names.index(name)
    rows[:, at] = best.x[len(found.at) :]
    # The prior of the parameter `name` belongs to one value for all forces.
    mean = replace(priors[name], value=math.exp(rows[:, at].mean()))
    problem = replace(found.problem, priors=found.problem.priors | {name: mean})
    return _evaluated(problem, rows.mean(0), over, rows)


def _in_modes(problem: Responses) -> Responses:
    """Selects the linear range of the amplifier for each response, so that the model explains the
    responses best. Returns the changed problem. States that the caller has given do not change. The
    load angle of a stepper stays in its first segment, because known.linear_codes() limits the
    excitation accordingly."""
    states = problem.states
    ranges = [m for m in sets.slopes(problem.model, fixed=states) if LOAD_ANGLE not in m]
    slopes = [states, *(modes for modes in ranges if modes != states)]
    pressed = sum(not m.free for m in problem.measured)
    if len(slopes) == 1:
        return problem
    every = list(itertools.product(slopes, repeat=pressed))
    if len(every) > COMBINATIONS_MAX:
        every = [(modes,) * pressed for modes in slopes]
    tried = []
    for chosen in every:
        left = iter(chosen)
        pairs = zip(problem.measured, problem.modes, strict=True)
        one = replace(problem, modes=[was if m.free else next(left) for m, was in pairs])
        tried.append((one.near(one.starts()[0], 8).cost, one))
    return min(tried, key=lambda pair: pair[0])[1]


def searched(problem: Responses) -> Samples:
    """Searches from all start points. Returns the logarithms of the best parameters.

    A result far from its priors may be a local minimum, such as a heavy workpiece on a stiff spring
    in place of a light one on a soft spring. Then another search begins with the prior values of
    the parameters that are far.
    """
    enough = chi_square_bound(0.05, 2 * sum(len(m.frequency_hz) for m in problem.measured))
    first, *others = problem.starts()
    best = problem.search(first)
    for start in others:
        if 2 * best.cost < enough:
            break
        best = min(best, problem.search(start), key=lambda found: found.cost)
    far = abs(best.x - problem.centre) > FAR * problem.spread
    if far.any():
        again = problem.search(np.where(far, problem.centre, best.x))
        best = min(best, again, key=lambda found: found.cost)
    return best.x


def _by_level(problem: Responses, best: Samples) -> Samples | None:
    """Fits the responses of each force in contact separately. Returns the logarithms of the best
    parameters, with one row for each force.

    Returns None if such a fit does not explain its response. Also returns None if the parameters of
    the forces differ too much for a single plant.
    """
    pressed = [i for i, m in enumerate(problem.measured) if not m.free]
    found = []
    for level in pressed:
        kept = [i for i, m in enumerate(problem.measured) if m.free or i == level]
        one = replace(problem, measured=[problem.measured[i] for i in kept],
                      modes=[problem.modes[i] for i in kept],
                      own=[problem.own[i] for i in kept],
                      errors=[problem.errors[i] for i in kept])  # fmt: skip
        x = one.search(best).x
        scores = zip(one.scores(x), one.measured, strict=True)
        if any(_score(s, m)[2] < REJECTED_BELOW / len(kept) for s, m in scores):
            return None
        found.append(x)
    apart = np.array(found)
    return apart if len(apart) > 1 and np.ptp(apart, 0).max() < LEVEL_DISTANCE_MAX_LOG else None


def _score(residuals: Samples, measured: Measurement) -> tuple[float, int, float]:
    """Returns three numbers: chi-square, degrees of freedom, and the probability that a correct
    model has a chi-square at least as large, of all frequencies or of the frequencies in a narrow
    band.

    A mode that the model lacks shows in a narrow band. If the response has many lines, or a large
    error, its chi-square hides such a mode. Therefore each band of the width LOCAL_WIDTH_LOG is
    judged, too. Their smallest probability is multiplied by their number (Bonferroni). A response
    out of contact is judged as a whole, because the force law does not act on it.
    """
    chi2, dof = float(np.sum(residuals**2)), len(residuals)
    if measured.free:
        return chi2, dof, chi_square_tail(chi2, dof)
    lines = np.sum(residuals.reshape(2, -1) ** 2, 0)
    at = np.log(measured.frequency_hz)
    near = abs(at[:, None] - at) <= LOCAL_WIDTH_LOG / 2
    sums, counts = near @ lines, 2 * near.sum(1)
    local = min(map(chi_square_tail, sums.tolist(), counts.tolist()), default=1.0)
    return chi2, dof, min(chi_square_tail(chi2, dof), len(at) * local)


def _evaluated(
    problem: Responses, x: Samples, over: Sequence[str], apart: Samples | None = None
) -> JointFit:
    """Returns the result of a fit. `x`: logarithms of the best parameters. `apart`: logarithms with
    one row for each force, if the forces need different parameters, otherwise None."""
    levels = []
    scores = problem.scores(x)
    if apart is not None:
        pressed = [i for i, m in enumerate(problem.measured) if not m.free]
        for i, row in zip(pressed, apart, strict=True):
            scores[i] = problem.scores(row)[i]
    for m, modes, score in zip(problem.measured, problem.modes, scores, strict=True):
        name = "apart" if m.free else "in contact"
        levels.append(ResponseScore(name, len(m.frequency_hz), modes, *_score(score, m)))
    away = (x - problem.centre) / problem.spread
    best = problem.values(x)
    chi2 = sum(level.chi2 for level in levels) + float(np.sum(away**2))
    dof = sum(level.dof for level in levels)
    found = JointFit(problem.model, best, chi2, dof, levels, problem, x)
    found.own = [problem.values(x, own) for own in problem.own]
    found.levels_differ = apart is not None
    loop = loops.force_loop(problem.model, "p", "zoh", best, problem.states or None)
    found.limiting_hz = loop.limit().frequency_hz
    _reject(found, problem, away)
    if found.rejected:
        return found
    found.values = best
    scales = [max(1.0, level.chi2 / level.dof) for level in levels]
    lines, information = problem.information(x, scales)
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    ranges = plant_set.ranges_of(problem.model, over, best)
    shown = _shown(problem, lines, ranges)
    # The covariance excludes changes of a parameter between the forces.
    # These changes of parameters widen the ranges below separately.
    left_open = _left_open(problem, x, covariance, ranges)
    shift, changed = np.zeros((1, len(x))), np.zeros(len(x), bool)
    if apart is not None:
        shift = apart - x
        covariance = covariance + shift.T @ shift / max(1, len(apart) - 1)
        changed = abs(shift).max(0) > np.maximum(3 * shown, LEVEL_CHANGE_LOG)
    spread = np.sqrt(np.diag(covariance))
    size = normal_bound((1 + CONFIDENCE) / 2)
    found.intervals = {
        name: (value * math.exp(-size * h), value * math.exp(size * h))
        # The parameters that all responses have in common come first.
        for (name, value), h in zip(best.items(), spread, strict=False)
    }
    found.correlation = (covariance / np.outer(spread, spread))[: len(best), : len(best)]
    found.ratios = _ratios(best, covariance, size)
    for i, name in enumerate(problem.names):
        if "@" in name:
            continue
        wider = size * max(min(shown[i], spread[i]), left_open[i])
        wider += float(abs(shift[:, i]).max()) if changed[i] else 0.0
        if name in ranges or (changed[i] and len(ranges) < plant_set.RANGES_MAX):
            value, low, high = ranges.get(name, (best[name],) * 3)
            ranges[name] = (value, low * math.exp(-wider), high * math.exp(wider))
    visited = [
        modes for m, modes in zip(problem.measured, problem.modes, strict=True) if not m.free
    ]
    modes_seen = tuple({tuple(sorted(one.items())): one for one in visited}.values())
    together = _lightly_damped(problem, best, spread, ranges)
    found.plants = plant_set.PlantSet(problem.model, best, ranges, modes_seen, together)
    return found


def _lightly_damped(
    problem: Responses, best: Values, spread: Samples, ranges: Collection[str]
) -> tuple[Values, ...]:
    """Returns the choices of dampings for the design: the fitted ones, and if the responses do not
    determine some of them, these lower by their standard error. `spread`: standard errors of the
    logarithms of the parameters."""
    parameters = linear.facts(problem.model).parameters
    low = {
        name: best[name] * math.exp(-error)
        for name, error in zip(problem.names, spread, strict=True)
        if name in parameters and parameters[name].unit == DAMPING_UNIT
        and name not in ranges and error > DAMPING_ERROR_MAX
    }  # fmt: skip
    return ({}, low) if low else ({},)


def _shown(problem: Responses, lines: Samples, ranges: Collection[str]) -> Samples:
    """Returns the standard error of the logarithm of each parameter, from the spectral lines alone
    and with all other parameters fixed. If a parameter differs between two forces by more than this
    error, it has changed."""
    shown: Samples = 1 / np.sqrt(np.maximum(np.diag(lines), 1e-12))
    varied = [i for i, name in enumerate(problem.names) if name in ranges]
    if varied:
        block = lines[np.ix_(varied, varied)] + np.diag(problem.spread[varied] ** -2.0)
        shown[varied] = np.sqrt(np.diag(np.linalg.inv(block)))
    return shown


def _left_open(
    problem: Responses, x: Samples, covariance: Samples, ranges: Mapping[str, plant_set.Range]
) -> Samples:
    """Returns standard errors of the logarithms of the parameters, for plants at the ends of
    `ranges`.

    The fit does not determine some combinations of parameters. These have no effect on the response
    of the measured plant, but they have an effect on a plant at the end of a tolerance. For
    example, if one stiffness is fitted too large and another one too small, the mode of a workpiece
    with another mass has a wrong frequency. If a combination changes the responses of these plants
    by less than MODEL_ERROR, its error is reduced in proportion. An example is a common factor of
    all masses and stiffnesses.
    """
    ends = []
    for i, name in enumerate(problem.names):
        value, *limits = ranges.get(name, (1.0,))
        ends += [(i, math.log(limit / value)) for limit in limits]
    if not ends:
        return np.zeros(len(x))

    def responses(logarithms: Samples) -> Response:
        found = []
        for i, shift in ends:
            at = logarithms.copy()
            at[i] += shift
            known = zip(problem.predictions(at), problem.measured, strict=True)
            found += [h for h, m in known if not m.free]
        return np.concatenate(found)

    def slope(step: Samples) -> Samples:
        ratio: Response = np.log(responses(x + step) / responses(x - step))
        return _real(ratio) / (2 * STEP_LOG)

    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    changes = np.array([slope(step) for step in STEP_LOG * np.eye(len(x))]).T @ root
    _, sizes, directions = np.linalg.svd(changes, full_matrices=False)
    least = MODEL_ERROR * math.sqrt(len(changes) / 2)
    moved = (root @ directions.T) ** 2 @ (sizes**2 / (sizes**2 + least**2))
    result: Samples = np.sqrt(moved)
    return result


def _reject(found: JointFit, problem: Responses, away: Samples) -> None:
    """Checks if a fit has to be rejected, and writes the reason for the rejection to the result.
    `away`: distance of each parameter from its prior, in standard deviations."""
    distances = abs(away[: len(found.best)])
    most = SEARCHED_SHARE * SEARCH_RANGE
    found.far = tuple(
        name
        for name, distance in zip(found.best, distances, strict=True)
        if problem.priors[name].surmised and PRIOR_DISTANCE_MAX < distance < most
    )
    distances[[name in found.far for name in found.best]] = 0.0
    worst = int(distances.argmax())
    misfits = [level for level in found.levels if level.p < REJECTED_BELOW / len(found.levels)]
    if (found.p < REJECTED_BELOW or misfits) and not found.levels_differ:
        p = min([found.p, *(level.p for level in misfits)])
        found.rejected = "chi2"
        found.text = (
            f"expected a model that explains the responses, p = {p:.2g}: another parameter is "
            "wrong, or the model lacks a part of the axis"
        )
    elif distances[worst] > PRIOR_DISTANCE_MAX:
        name = problem.names[worst]
        found.rejected, found.surmised = "prior", problem.priors[name].surmised
        found.beyond = name
        value = f"{name}={found.best[name]:.4g}+-{GIVEN_PERCENT}%"
        found.remedy = f"if this value is right, give `priors` {value}"
        found.text = (
            f"expected {name} within {PRIOR_DISTANCE_MAX:g} standard deviations of "
            f"{problem.priors[name].value:.5g}, got {found.best[name]:.5g}"
        )
    elif found.limiting_hz is not None:
        pressed = [m for m in problem.measured if not m.free]
        errors = [_error_near(m, found.limiting_hz) for m in pressed]
        error = max(errors, default=0.0)
        if error > LIMITING_MODE_ERROR_MAX:
            found.rejected = "coherence"
            found.least_known = error, pressed[errors.index(error)].averages
            found.text = (
                f"expected a response that is known to {100 * LIMITING_MODE_ERROR_MAX:g} % at "
                f"the limiting mode of {found.limiting_hz:.3g} Hz, got {100 * error:.3g} %: "
                "measure with larger `forces`, more `averages` or a wider `band_hz`"
            )


def _error_near(measured: Measurement, hz: float) -> float:
    """Returns the relative standard error of a response in a narrow band around a frequency. The
    band includes the neighbouring spectral lines, and the lowest one for a frequency below it. At
    half the rate of the force sensor, which no response reaches, the band includes the highest
    line. The error is infinite if the response has no spectral line in the band."""
    at, width = measured.frequency_hz, measured.resolution_hz
    near = (abs(np.log(at / hz)) < LIMITING_MODE_WIDTH_LOG) | (abs(at - hz) <= width)
    if hz < at[0]:
        near[0] = True
    period_s = measured.ages[1] * measured.dt
    if period_s and abs(2 * hz * period_s - 1) < HALF_RATE_WIDTH:
        near[-1] = True
    if not near.any():
        return math.inf
    power = np.sum(abs(measured.response[near]) ** 2)
    return float(math.sqrt(np.sum(measured.variance[near]) / near.sum() / power))


def _ratios(
    best: Values, covariance: Samples, size: float
) -> dict[str, tuple[float, float, float]]:
    """Finds pairs of parameters whose quotient or product is known with at most half the
    uncertainty of each parameter alone. Returns {"a/b" or "a*b": (value, low, high)}."""
    found = {}
    names = list(best)
    for i, j in itertools.combinations(range(len(names)), 2):
        for sign, text in ((-1, "/"), (1, "*")):
            variance = covariance[i, i] + covariance[j, j] + 2 * sign * covariance[i, j]
            if variance < min(covariance[i, i], covariance[j, j]) / 4:
                value = best[names[i]] * best[names[j]] ** sign
                half = math.exp(size * math.sqrt(max(variance, 0.0)))
                found[f"{names[i]}{text}{names[j]}"] = (value, value / half, value * half)
    return found
