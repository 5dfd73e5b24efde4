"""Tests the health of an axis. A measurement of today is compared with the measurement when the
axis was released. The result names the parameter that has changed.

found = health(HealthOrder("press/model.toml", [Path("today.npz")], Path("posterior.json")))
found.healthy, found.p_value, found.moved

A score test is made for the change of each parameter alone. One more test finds changes of any
other kind. The p values of all tests are corrected for their number (Holm, Scandinavian Journal of
Statistics 6, 1979). An unchanged machine is therefore rejected at most with the probability
`level`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from forceaxis import linear, paths
from forceaxis._core import InputError
from forceaxis.commission import contact_check, contact_data, contact_error, known
from forceaxis.commission import contact_search as searching
from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_likelihood import ContactProblem
from forceaxis.commission.incident_causes import log_covariance
from forceaxis.commission.joint_fit import Responses, searched
from forceaxis.commission.known import WORKPIECE_SPREAD, Prior
from forceaxis.identify.fit import read_response
from forceaxis.identify.measurement import Measurement
from forceaxis.linear import posterior
from forceaxis.linear.plant_facts import Overrides
from forceaxis.recordings import signal_recording

LEVEL = 0.05
# A parameter is determined if a change of its logarithm by this value can be detected.
TOLD_CHANGE = 0.5
# Two parameters explain a change equally well if their chi-square differs by less than this value.
# Another such limit is SHARE_MIN times the decrease of chi-square by the better parameter.
ALIKE_BELOW = 6.0
CHANGE_MAX_LOG = math.log(5)  # largest change of the logarithm of a parameter that is searched
ITERATIONS = 12  # largest number of evaluations in a fit
# Changes of a parameter from which a fit may begin.
# The distances of these start values are smaller than the width of a resonance.
# With larger distances, a fit may end in a local optimum between two start values.
STARTS_LOG = np.linspace(-CHANGE_MAX_LOG, CHANGE_MAX_LOG, 33)
# MOVED_MAX: largest number of parameters that the result names as changed.
# SHARE_MIN: smallest decrease of chi-square by a further parameter, divided by the first decrease.
MOVED_MAX, SHARE_MIN = 3, 0.02
# Smallest fraction of the information on a parameter that other parameters do not explain.
LEAST_SHARE = 1e-6
STEP_LOG = 1e-4
# The window "hann" increases the variance of a sum over frequencies by this factor.
# The window correlates neighbouring frequencies by 2/3 and 1/6: 1 + 2 (2/3 + 1/6) = 8/3.
HANN_FACTOR = 8 / 3


@dataclass(frozen=True)
class HealthOrder:
    """The request for a health test. It has the model of the machine, the measurements of today,
    and the measurements when the machine was released.

    `today`: recordings of touch-downs, or the folder of one measured response. `released`: file of
    a posterior, or the folder of a measured response. `level`: largest probability with which an
    unchanged machine is rejected.
    """

    model: str
    today: Sequence[Path]
    released: Path
    held: Overrides = field(default_factory=dict)
    level: float = LEVEL


@dataclass(frozen=True)
class ParameterHealth:
    """The test of one parameter. `change`: factor by which the parameter has changed, if no other
    parameter has changed. `interval`: 95 % interval of this factor. `p`: probability that an
    unchanged machine shows such a change, corrected for the number of tests. `told`: False if the
    measurement of today does not determine the parameter."""

    change: float
    interval: tuple[float, float]
    p: float
    told: bool


@dataclass(frozen=True)
class Health:
    """The health of an axis. `kind`: "contact" or "response". `p_value`: probability that an
    unchanged machine shows a change that is at least as large. `moved`: parameters that have
    changed, beginning with the clearest change. `alike`: other parameters whose change explains the
    measurement nearly as well as the change of the first parameter in `moved`. `other_p`: corrected
    p value of the difference that remains after the changes in `moved`."""

    kind: str
    model: str
    today: tuple[str, ...]
    released: str
    level: float
    healthy: bool
    p_value: float
    moved: tuple[str, ...]
    alike: tuple[str, ...]
    other_p: float
    parameters: dict[str, ParameterHealth]


@dataclass(frozen=True)
class _Tests:
    """Tests of all parameters. Each array has one element for each parameter. `size`: change of the
    logarithm of the parameter, if it changes alone. `deviation`: standard deviation of `size`. It
    has a smallest value, because a machine changes a little from day to day. `gain`: decrease of
    chi-square by the change."""

    size: Floats
    deviation: Floats
    gain: Floats

    @property
    def p(self) -> Floats:
        """Returns for each parameter the probability that an unchanged machine shows a change that
        is at least as large."""
        score = np.minimum(self.gain, (self.size / self.deviation) ** 2)
        return np.asarray(special.chdtrc(1, np.maximum(score, 0.0)))

    @property
    def told(self) -> NDArray[np.bool_]:
        """Returns for each parameter True if the measurement of today determines it."""
        return np.asarray(TOLD_CHANGE / self.deviation > special.ndtri(0.975))


class _Change(Protocol):
    """Interface of a comparison of the measurement of today with the release: the likelihood of the
    measurement of today depends on changes of the parameters."""

    @property
    def names(self) -> tuple[str, ...]:
        """Returns the names of the parameters."""

    def tests(self, chosen: Sequence[int]) -> _Tests:
        """Returns the test of each parameter. In these tests, the parameters with the indices
        `chosen` may change too."""

    def other_p(self, chosen: Sequence[int]) -> float:
        """Returns the p value of the difference that remains after the best changes of the
        parameters with the indices `chosen`."""


def health(order: HealthOrder) -> Health:
    """Compares the measurements of today with the release. Raises InputError."""
    is_posterior = order.released.suffix == posterior.SUFFIX
    change: _Change = _of_touch_downs(order) if is_posterior else _of_responses(order)
    alone = change.tests(())
    tests = int(np.count_nonzero(alone.told)) + 1
    chosen = _moved(change, order.level / tests)
    raw = alone.p
    adjusted = _holm([*raw[alone.told], change.other_p(chosen)])
    corrected = np.ones(len(raw))
    corrected[alone.told] = adjusted[:-1]
    parameters = {}
    for i, name in enumerate(change.names):
        half = 1.96 * alone.deviation[i]
        low, high = (math.exp(min(alone.size[i] + side, 700.0)) for side in (-half, half))
        parameters[name] = ParameterHealth(
            math.exp(alone.size[i]), (low, high), float(corrected[i]), bool(alone.told[i])
        )
    p_value = float(min(adjusted))
    best = float(alone.gain[chosen[0]]) if chosen else 0.0
    return Health(
        "contact" if is_posterior else "response",
        paths.display(linear.find_model(order.model)),
        tuple(paths.display(path) for path in order.today), paths.display(order.released),
        order.level, p_value >= order.level, p_value, tuple(change.names[i] for i in chosen),
        tuple(
            name for i, name in enumerate(change.names)
            if chosen and i not in chosen and alone.told[i]
            and alone.gain[i] > best - max(ALIKE_BELOW, SHARE_MIN * best)
        ),
        float(adjusted[-1]), parameters,
    )  # fmt: skip


def _holm(values: Sequence[float]) -> Floats:
    """Corrects p values for their number by the method of Holm. Returns them in the same order."""
    order = np.argsort(values)
    steps = np.array([(len(values) - i) * values[at] for i, at in enumerate(order)])
    found = np.empty(len(values))
    found[order] = np.minimum(1.0, np.maximum.accumulate(steps))
    return found


def _moved(change: _Change, level: float) -> list[int]:
    """Returns the indices of the parameters that have changed. They are found one after another:
    the next parameter is the one whose change explains most of the remaining difference. The search
    ends if it explains only a small fraction (SHARE_MIN)."""
    chosen: list[int] = []
    first = 0.0
    while len(chosen) < MOVED_MAX:
        tests = change.tests(chosen)
        gain = np.where(tests.told, tests.gain, 0.0)
        gain[chosen] = 0.0
        best = int(np.argmax(gain))
        first = first or float(gain[best])
        if tests.p[best] > level or gain[best] < SHARE_MIN * first:
            break
        chosen.append(best)
    return chosen


@dataclass(frozen=True)
class _LinearChange:
    """A comparison whose likelihood is a normal distribution of the changes. `slope`: first
    derivatives of the log likelihood at no change, one for each parameter. `information`: matrix of
    the negative second derivatives. `p`: p value of the measurement of today alone."""

    names: tuple[str, ...]
    slope: Floats
    information: Floats
    p: float

    def tests(self, chosen: Sequence[int]) -> _Tests:
        slope, own = self.slope, np.diag(self.information)
        if chosen:
            rows = self.information[:, chosen]
            inner = np.linalg.inv(self.information[np.ix_(chosen, chosen)])
            slope = slope - rows @ inner @ slope[chosen]
            own = own - np.einsum("ij,jk,ik->i", rows, inner, rows)
        own = np.maximum(own, LEAST_SHARE * np.diag(self.information) + 1e-300)
        return _Tests(slope / own, 1 / np.sqrt(own), slope**2 / own)

    def other_p(self, chosen: Sequence[int]) -> float:
        return self.p


class _ResponseChange:
    """A comparison of two frequency responses. The effect of changed parameters is computed as the
    ratio of two responses of the model, by which the released response is multiplied. A model error
    that is the same on both days therefore has no effect. The model is that of the released
    machine: it is fitted to the released response, because a large change of a resonance is only
    right from the frequency at which it was."""

    def __init__(self, today: Measurement, released: Measurement, priors: dict[str, Prior]) -> None:
        self.today, self.released = today, released
        self.responses = Responses(released.model, priors, [released])
        self.centre = searched(self.responses)
        self.exact = self.responses.predictions(self.centre)[0]
        self.variances = _variance(today), _variance(released)
        self.names = tuple(priors)
        self.known: dict[tuple[int, ...], tuple[Floats, float]] = {}

    def residuals(self, chosen: Sequence[int], logs: Floats) -> Floats:
        """Returns residuals in standard deviations: first of the real parts, then of the imaginary
        parts. Then follow the increases of the standard deviations: the ratio multiplies the noise
        of the released response too. The sum of squares of all is -2 times the log likelihood, up
        to a constant. `logs`: changes of the logarithms of the parameters with the indices
        `chosen`."""
        at = self.centre.copy()
        at[list(chosen)] += logs
        ratio = self.responses.predictions(at)[0] / self.exact
        today, released = self.variances
        wider = np.abs(ratio) ** 2 * released / today
        left = (self.today.response - self.released.response * ratio) / np.sqrt(
            today * (1 + wider) / 2
        )
        return np.concatenate([left.real, left.imag, np.sqrt(2 * np.log1p(wider))])

    def fitted(self, chosen: Sequence[int]) -> tuple[Floats, float]:
        """Returns the most likely changes of the logarithms of the parameters with the indices
        `chosen`, and their chi-square."""
        key = tuple(chosen)
        if key not in self.known:
            before = self.fitted(key[:-1])[0] if key else np.zeros(0)
            starts = [np.append(before, start) for start in STARTS_LOG] if key else [before]
            start = min(starts, key=lambda logs: float(np.sum(self.residuals(key, logs) ** 2)))
            if key:
                found = optimize.least_squares(
                    lambda logs: self.residuals(key, logs),
                    start,
                    bounds=(-CHANGE_MAX_LOG, CHANGE_MAX_LOG),
                    max_nfev=ITERATIONS,
                )
                start = found.x
            self.known[key] = start, float(np.sum(self.residuals(key, start) ** 2))
        return self.known[key]

    def tests(self, chosen: Sequence[int]) -> _Tests:
        before = self.fitted(chosen)[1]
        size, deviation = np.zeros(len(self.names)), np.full(len(self.names), np.inf)
        gain = np.zeros(len(self.names))
        for i in range(len(self.names)):
            if i in chosen:
                continue
            logs, after = self.fitted([*chosen, i])
            moved = logs + STEP_LOG * (np.arange(len(logs)) == len(logs) - 1)
            slope = self.residuals([*chosen, i], moved) - self.residuals([*chosen, i], logs)
            information = float(np.sum((slope[: 2 * len(self.exact)] / STEP_LOG) ** 2))
            if information < 1e-12:
                continue
            size[i] = logs[-1]
            deviation[i] = math.hypot(information**-0.5, known.POSTERIOR_SPREAD_MIN)
            gain[i] = before - after
        return _Tests(size, deviation, gain)

    def other_p(self, chosen: Sequence[int]) -> float:
        degrees = 2 * len(self.today.response)
        left = self.residuals(chosen, self.fitted(chosen)[0])[:degrees]
        return float(special.chdtrc(degrees, np.sum(left**2)))


def _of_touch_downs(order: HealthOrder) -> _LinearChange:
    """Compares the touch-downs of today with a released posterior. Both are approximated by normal
    distributions."""
    model = str(linear.find_model(order.model))
    read = posterior.read(order.released)
    facts = linear.facts(model, order.held)
    if unknown := [name for name in read.names if name not in facts.parameters]:
        raise InputError(
            f"{paths.display(order.released)}: expected parameters of {order.model}, got "
            f"{', '.join(unknown)}; give the model that was identified"
        )
    logs = np.log(read.table)
    centre = logs.mean(axis=0)
    recordings = [(path.stem, signal_recording.read(path)) for path in order.today]
    spreads = known.priors(model, (), (), order.held)
    priors = {
        name: Prior(math.exp(value), spreads.get(name, Prior(1.0, WORKPIECE_SPREAD)).spread)
        for name, value in zip(read.names, centre.tolist(), strict=True)
    }
    held = {name: value for name, value in order.held.items() if name not in priors}
    data = contact_data.touch_downs(model, recordings, {**held, **_values(priors)})
    problem = ContactProblem(model, data, priors, held)
    point, _ = searching.lengthened(problem, problem.centre)
    checked = problem
    # A model that was nearly right at the release is nearly right today.
    # The error of the model is in the comparison of both days, and in the test of today alone.
    if shares := {kind: error.share for kind, error in read.model_error.items()}:
        nearly = contact_error.searched(problem, point, False, 0, shares)
        problem, checked, point = nearly.same, nearly.own, nearly.point
    _, matrix = searching.derivatives(problem, point)
    size = len(priors)
    square = matrix.T @ matrix - np.diag(
        np.concatenate([problem.spread[:size] ** -2, np.zeros(problem.size - size)])
    )
    across = square[:size, size:]
    today = square[:size, :size] - across @ np.linalg.solve(square[size:, size:], across.T)
    off = point[:size] - centre
    # At the maximum of the posterior, the slope of the prior is not 0.
    # The maximum of the likelihood of today is elsewhere.
    pulled = today @ off + off / problem.spread[:size] ** 2
    joint = np.eye(size) + today @ log_covariance(read.table)
    information = np.linalg.solve(joint, today)
    return _LinearChange(
        read.names, np.linalg.solve(joint, pulled), (information + information.T) / 2,
        contact_check.check(checked, point).p,
    )  # fmt: skip


def _values(priors: dict[str, Prior]) -> dict[str, float]:
    return {name: prior.value for name, prior in priors.items()}


def _of_responses(order: HealthOrder) -> _ResponseChange:
    """Compares the frequency response of today with the released frequency response."""
    model = str(linear.find_model(order.model))
    if len(order.today) != 1:
        raise InputError(
            "expected exactly one frequency response that was measured today, to compare it with "
            f"{paths.display(order.released)}, got {len(order.today)} frequency responses"
        )
    today = read_response(order.today[0], model, order.held)
    released = read_response(order.released, model, order.held)
    _expect_same(today, released, order)
    priors = known.priors(model, (), (), order.held)
    exact = {*order.held, *known.exact_parameters(model)}
    own = {name: prior for name, prior in priors.items() if name not in exact}
    return _ResponseChange(today, released, own)


def _variance(measured: Measurement) -> Floats:
    """Returns the variance of a response, increased for tests with sums over frequencies. There are
    two reasons: the variance was estimated from few residuals, and the window correlates
    neighbouring frequencies."""
    factor = HANN_FACTOR if measured.window == "hann" else 1.0
    return np.asarray(measured.variance * factor * measured.dof / max(measured.dof - 2, 0.5))


def _expect_same(today: Measurement, released: Measurement, order: HealthOrder) -> None:
    """Raises InputError if two responses cannot be compared."""
    same = len(today.frequency_hz) == len(released.frequency_hz) and np.allclose(
        today.frequency_hz, released.frequency_hz
    )
    signals = [(m.input, m.output, m.free) for m in (today, released)]
    if not same or signals[0] != signals[1]:
        raise InputError(
            f"{paths.display(order.today[0])}: expected a response with the same signals and "
            f"frequencies as {paths.display(order.released)}; measure again with the same options"
        )
