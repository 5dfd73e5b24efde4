"""Fits parameters of a model to a measured frequency response, with confidence intervals."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from forceaxis import files, linear, paths, progress
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.identify.columns import header_of, read_columns
from forceaxis.identify.distributions import chi_square_bound, chi_square_tail, f_bound, t_bound
from forceaxis.identify.measurement import CONFIDENCE, Complexes, Measurement, Reals
from forceaxis.identify.setup import is_number
from forceaxis.results import to_json

WARNED_CORRELATION = 0.95  # smallest correlation of two parameter estimates that causes a warning
# Smallest half width of the 95 % interval of a parameter's logarithm that causes a warning.
WARNED_HALF_WIDTH = math.log(2)
# Below this ratio of the singular values of the Jacobian, parameters are not distinguishable.
LEAST_SINGULAR_RATIO = 1e-7
# Smallest relative change of the response that counts as an effect of a parameter.
LEAST_EFFECT = 1e-9
# If the chi-square of a fit has a smaller probability, other start values are tried.
# If the probability of the chi-square of a fit stays smaller, the fit is rejected.
REJECTED_BELOW = 1e-3
OTHER_STARTS = 24  # number of further start values that a search tries after a bad fit
# Fields of a Measurement that are arrays. The arrays have the same names in response.npz.
ARRAYS = ("frequency_hz", "response", "coherence", "variance", "floor")
# Half width of the search range of a parameter's logarithm: a factor of about 20 up and down.
SEARCH_RANGE = 3.0


@dataclass(frozen=True)
class ParameterFit:
    """Result of the fit of p parameters to a measured response with n frequencies.

    `starts`, `values` (p,): start values and fitted values in SI units. `covariance` (p, p):
    covariance of the logarithms of the parameters. `single`, `joint` (p,): half widths of 95 %
    intervals of the logarithms.

    The true value of one parameter is between value exp(-single) and value exp(single) with a
    probability of 0.95. The true values of all parameters are within value exp(+-joint) at the same
    time with at least this probability.
    """

    names: tuple[str, ...]
    starts: Reals
    values: Reals
    single: Reals
    joint: Reals
    covariance: Reals
    #: sum of the fit; for a correct model, its chi-square distribution has `dof` degrees of freedom
    chi_square: float
    dof: int  #: degrees of freedom of chi-square, 2 n - p
    points: int  #: number n of frequencies
    converged: bool  #: False if the search has ended before it found the smallest chi-square
    warnings: tuple[str, ...] = ()

    @property
    def p_value(self) -> float:
        """Returns the probability that the chi-square of a correct model is at least the chi-square
        of this fit."""
        return chi_square_tail(self.chi_square, self.dof)

    @property
    def rejected(self) -> bool:
        """True if no values of the parameters explain the measured response. `values` then give the
        best fit, but they are not the parameters of the plant, and their intervals are not
        valid."""
        return self.p_value < REJECTED_BELOW

    @property
    def correlation(self) -> Reals:
        """Returns the correlation matrix of the estimates, an array (p, p)."""
        spread = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(spread, spread))

    def distance(self, values: ArrayLike) -> float:
        """Returns the distance of the parameter values `values` (p,) from the fitted values,
        relative to the joint 95 % confidence region. It is below 1 inside this region, and 1 at its
        edge."""
        step = np.log(values) - np.log(self.values)
        size = step @ np.linalg.solve(self.covariance, step)
        p = len(step)
        return float(size / (p * f_bound(CONFIDENCE, p, self.dof)))


class FitProblem:
    """The least-squares problem of a fit. Its residuals are functions of the logarithms of the
    parameters.

    There are p parameters and n frequencies. `start` (p,): logarithms of the start values.
    """

    def __init__(self, measured: Measurement, starts: Mapping[str, float]) -> None:
        self.measured = measured
        self.names = tuple(starts)
        self.start: Reals = np.log(np.array(list(starts.values()), float))
        relative = np.sqrt(measured.variance) / np.maximum(abs(measured.response), 1e-300)
        # A point of the response has at most the weight of a point with a relative error of 0.1.
        self.weights: Reals = 1 / np.hypot(relative, 0.1)

    def model(self, logarithms: Reals) -> Complexes:
        """Returns the frequency response of the model for the present parameters, an array (n,)."""
        values = np.exp(logarithms).tolist()
        return self.measured.predict(dict(zip(self.names, values, strict=True)))

    def jacobian(self, logarithms: Reals, step: float = 1e-5) -> Complexes:
        """Returns the derivatives of the frequency response with respect to the logarithms of the
        parameters, an array (n, p). They are central differences."""
        steps = step * np.eye(len(self.names))
        return np.stack(
            [(self.model(logarithms + d) - self.model(logarithms - d)) / (2 * step) for d in steps],
            1,
        )

    def coarse(self, logarithms: Reals) -> Reals:
        """Returns 2 n residuals for the first search. They are the weighted real and imaginary
        parts of the logarithm of the measured response divided by the predicted one.

        A search with these residuals converges even if the resonances of model and measurement do
        not overlap yet.
        """
        ratio = np.log(self.measured.response / self.model(logarithms))
        return as_real(np.asarray(ratio * self.weights, complex))

    def likelihood(self, logarithms: Reals) -> Reals:
        """Returns 2 n residuals for the second search. The sum of their squares is the chi-square
        of fit()."""
        measured = self.measured
        error = (measured.response - self.model(logarithms)) / np.sqrt(measured.variance)
        square = np.maximum(abs(error) ** 2, 1e-30)
        size = np.sqrt(2 * measured.dof * np.log1p(square / measured.dof) / square)
        return as_real(np.asarray(error * size, complex))

    def search(self, begin: Reals) -> optimize.OptimizeResult:
        """Searches for the logarithms of the parameters with the best fit. The first search uses
        the residuals of coarse(), which converge from distant start values. The second search uses
        the residuals of likelihood()."""
        low, high = self.start - SEARCH_RANGE, self.start + SEARCH_RANGE
        options = {"bounds": (low, high), "x_scale": "jac", "max_nfev": 60}
        near = optimize.least_squares(self.coarse, begin, loss="soft_l1", **options).x
        near = np.clip(near, low + 0.01, high - 0.01)
        return optimize.least_squares(self.likelihood, near, xtol=1e-10, ftol=1e-10, **options)

    def best(self, degrees: int, tries: int) -> optimize.OptimizeResult:
        """Returns the best result of several searches. The first search begins at the start values.
        If its result does not explain the data, up to `tries` further searches begin at other start
        values."""
        best = self.search(self.start)
        enough = chi_square_bound(REJECTED_BELOW, degrees)
        scatter = np.random.default_rng(0).uniform(-1, 1, (tries, len(self.start)))
        for shift in progress.each(scatter, "starts"):
            if 2 * best.cost <= enough:
                break
            other = self.search(self.start + shift)
            if other.cost < best.cost:
                best = other
        return best

    def expect_effects(self, where: str) -> None:
        """Raises InputError for a parameter that does not change the response. Also raises it for
        parameters of which only a combination changes the response."""
        J, measured = self.jacobian(self.start), self.measured
        influence = abs(J).max(0) / abs(self.model(self.start)).max()
        for name, size in zip(self.names, influence, strict=True):
            if size < LEAST_EFFECT:
                raise InputError(
                    f"{where}: {name}: expected a parameter that changes the response from "
                    f"{measured.input} to {measured.output}; fit another parameter, or measure "
                    "another signal"
                )
        check_separate(self.names, as_real(J), where)


def as_real(values: NDArray[np.complex128]) -> Reals:
    """Returns an array with the real parts, followed by the imaginary parts."""
    return np.concatenate([values.real, values.imag])


def fit(
    measured: Measurement,
    starts: Mapping[str, float],
    where: str = "fit",
    tries: int = OTHER_STARTS,
) -> ParameterFit:
    """Fits parameters of a model to a measured frequency response.

    measured: a `Measurement`, whose method `predict` is the model. starts: {parameter: start value
    > 0}. The search varies the logarithms of these parameters. All other parameters have the values
    of `measured.overrides`. tries: number of further searches, with other start values, if the fit
    does not explain the data. where: name of the measurement in errors.

    With z = |response - model|^2 / variance, minus twice the log likelihood is (dof + 1) / dof
    times the sum of 2 dof ln(1 + z / dof). This is so because the variance is itself estimated,
    from dof complex residuals. The sum has a chi-square distribution with 2 degrees of freedom for
    each point. The fit minimises the sum by least squares (trust region), and the minimum is also
    the test of the fit.

    The information matrix is the sum of 2 dof^2 / (dof + 1) Re(J* J) / T, with T = dof variance +
    |response - model|^2. Its mean over T is correct. If the model does not explain the data, the
    covariance grows with the chi-square.

    Raises InputError for too few points, and for a parameter that does not change the response.
    Also raises it for parameters of which only a combination changes the response.
    """
    for name, value in starts.items():
        if not (math.isfinite(value) and value > 0):
            raise InputError(
                f"{where}: {name}: expected a start value above 0, got {value:g}; give another "
                "start value"
            )
    p, n, dof = len(starts), len(measured.frequency_hz), measured.dof
    if n < p + 2:
        raise InputError(
            f"{where}: expected a response with at least {p + 2} frequencies for {p} parameters, "
            f"got {n}; measure a wider frequency band, or use a smaller resolution_hz"
        )
    problem = FitProblem(measured, starts)
    problem.expect_effects(where)
    degrees = 2 * n - p
    best = problem.best(degrees, tries)
    J = problem.jacobian(best.x)
    check_separate(problem.names, as_real(J), where)
    T = dof * measured.variance + abs(measured.response - problem.model(best.x)) ** 2
    information = 2 * dof**2 / (dof + 1) * (J.conj().T @ (J / T[:, None])).real
    chi_square = 2 * best.cost
    covariance = np.linalg.inv(information) * max(1.0, chi_square / degrees)
    spread = np.sqrt(np.diag(covariance))
    found = ParameterFit(
        names=problem.names,
        starts=np.array(list(starts.values()), float),
        values=np.exp(best.x),
        single=t_bound((1 + CONFIDENCE) / 2, degrees) * spread,
        joint=math.sqrt(p * f_bound(CONFIDENCE, p, degrees)) * spread,
        covariance=covariance,
        chi_square=float(chi_square),
        dof=degrees,
        points=n,
        converged=best.status > 0,
    )
    return replace(found, warnings=tuple(warnings_of(found)))


def warnings_of(found: ParameterFit) -> list[str]:
    """Returns the texts of all warnings about a fit."""
    warnings = []
    if found.p_value < 1 - CONFIDENCE:
        warnings.append(
            f"the model does not explain the data: chi-square {found.chi_square:.4g}, {found.dof} "
            f"degrees of freedom, p = {found.p_value:.1g}; fit another parameter too, or check the "
            "parameters that are not fitted"
        )
    if not found.converged:
        warnings.append("the search has not converged; give start values that are nearer")
    names, correlation = found.names, found.correlation
    for i, j in zip(*np.nonzero(abs(np.triu(correlation, 1)) > WARNED_CORRELATION), strict=True):
        warnings.append(
            f"{names[i]} and {names[j]} are nearly indistinguishable: "
            f"correlation {correlation[i, j]:.3f}"
        )
    for name, half in zip(names, found.single, strict=True):
        if half > WARNED_HALF_WIDTH:
            warnings.append(f"{name} is poorly determined")
    for name, moved in zip(names, abs(np.log(found.values / found.starts)), strict=True):
        if moved > SEARCH_RANGE - 0.02:
            warnings.append(
                f"{name} is at the edge of the search range, which extends by a factor of "
                f"{math.exp(SEARCH_RANGE):.0f} from the start value: the interval of {name} is "
                "invalid; give another start value"
            )
    return warnings


def check_separate(names: Sequence[str], J: Reals, where: str) -> None:
    """Raises InputError if only a combination of some parameters changes the response. The error
    names these parameters."""
    _, size, directions = np.linalg.svd(J / np.linalg.norm(J, axis=0), full_matrices=False)
    if size[-1] < LEAST_SINGULAR_RATIO * size[0]:
        together = [n for n, part in zip(names, directions[-1], strict=True) if abs(part) > 0.1]
        raise InputError(
            f"{where}: expected parameters with different effects on the response, but the "
            f"response shows only a combination of {', '.join(together)}, and not each of these "
            "parameters; remove one of these parameters from the fit"
        )


@dataclass(frozen=True)
class ResponseSettings:
    """Values that replace the recorded values of a Measurement. None means that the recorded value
    is kept. For a CSV file, `output`, `averages` and `dt` are required, because the file does not
    contain them."""

    input: str | None = None
    output: str | None = None
    averages: int | None = None
    dt: float | None = None  #: sampling period in s
    modes: dict[str, str] | None = None

    def replaced(self) -> dict[str, str | float | dict[str, str]]:
        """Returns {field: value} of those settings that are not None."""
        return {key: value for key, value in vars(self).items() if value is not None}


def read_response(
    path: Path | str,
    model: Path | str,
    overrides: linear.Overrides | None = None,
    settings: ResponseSettings | None = None,
) -> Measurement:
    """Reads a Measurement from the folder of a measurement (or its response.npz), or from a CSV
    file.

    A CSV file has the columns frequency_hz and coherence. It also has the columns magnitude and
    phase_deg, or real and imag. `overrides`: {parameter: value}, added to the recorded parameters.
    Raises InputError.
    """
    path, settings = Path(path), settings or ResponseSettings()
    file = path / "response.npz" if path.is_dir() else path
    model = str(linear.find_model(model))
    if file.suffix == ".csv":
        return checked(response_of_csv(file, model, overrides or {}, settings), file)
    expected = "a CSV file or a file response.npz of a measurement"
    if not file.is_file():
        files.refuse(file, expected, "neither", "measure first")
    saved = files.read_arrays(file, expected)
    with files.parsing(file, expected):
        recorded = files.json_of(str(saved["about"]), has_constants=True)
        known = {field.name for field in dataclasses.fields(Measurement)} - set(ARRAYS)
        if not isinstance(recorded, dict) or not set(recorded) <= known:
            raise ValueError("another description of the response")
        values: dict[str, Any] = recorded | settings.replaced() | {"model": model}
        if not isinstance(values["overrides"], dict):
            raise ValueError("overrides that are no table")
        values["overrides"] = values["overrides"] | dict(overrides or {})
        values |= {name: saved[name] for name in ARRAYS}
        measured = Measurement(**values)
    return checked(measured, file)


def checked(measured: Measurement, file: Path) -> Measurement:
    """Checks all fields of a Measurement, and returns it. Raises InputError for a wrong field."""

    def expect(good: bool | np.bool_, key: str, text: str) -> None:
        if not good:
            raise InputError(f"{file}: {key}: expected {text}")

    texts = {"input": measured.input, "output": measured.output, "unit": measured.unit}
    for key, text in texts.items():
        expect(isinstance(text, str), key, "a text")
    expect(measured.inject in ("volts", "codes"), "inject", "volts or codes")
    expect(measured.window in ("none", "hann"), "window", "none or hann")
    expect(isinstance(measured.free, bool), "free", "true or false")
    table = measured.overrides
    good = isinstance(table, dict) and all(map(is_number, table.values()))
    expect(good, "overrides", "a table of numbers")
    for key, value, low, high in (
        ("dt", measured.dt, 1e-7, 1.0),
        ("dof", measured.dof, 1e-3, 1e9),
        ("averages", measured.averages, 2, 1e9),
        ("resolution_hz", measured.resolution_hz, 0, 1e6),
        ("scale", measured.scale, -1e12, 1e12),
    ):
        good = is_number(value) and low <= value <= high
        expect(good, key, f"a number {low:g} to {high:g}, got {value!r}")
    expect(measured.scale != 0, "scale", "a number other than 0, got 0")
    band = measured.band_hz
    good = isinstance(band, list | tuple) and len(band) == 2
    good = good and all(isinstance(end, int | float) and end >= 0 for end in band)
    expect(good, "band_hz", "two frequencies")

    frequency = measured.frequency_hz
    for key in ARRAYS:
        values = getattr(measured, key)
        good = values.ndim == 1 and len(values) == len(frequency) and values.dtype.kind in "fc"
        good = good and (key == "response" or values.dtype.kind == "f")
        expect(good and np.all(np.isfinite(values)), key, "one finite number for each frequency")
    highest = 1 / (2 * measured.dt)
    good = len(frequency) > 0 and bool(frequency[0] > 0 and np.all(np.diff(frequency) > 0))
    expect(
        good and frequency[-1] < highest,
        "frequency_hz",
        f"rising frequencies above 0 and below {highest:g} Hz, half of the sampling rate 1 / dt",
    )
    expect(np.all(measured.variance > 0), "variance", "values above 0")
    expect(np.all(measured.response != 0), "response", "values other than 0")
    return measured


T = TypeVar("T")


def response_of_csv(
    file: Path, model: str, overrides: linear.Overrides, settings: ResponseSettings
) -> Measurement:
    """Returns the Measurement of a CSV file. With the coherence c, the variance of the response is
    (1 - c) |H|^2 / (c (averages - 1)). Raises InputError."""

    def required(value: T | None, key: str) -> T:
        if value is None:
            raise ParameterError(key, f"expected a value, because {file} does not contain it")
        return value

    output = required(settings.output, "output")
    averages = required(settings.averages, "averages")
    dt = required(settings.dt, "dt")
    polar = "magnitude" in header_of(file)
    parts = ["magnitude", "phase_deg"] if polar else ["real", "imag"]
    f, a, b, coherence = read_columns(file, ["frequency_hz", *parts, "coherence"])
    response: Complexes = np.asarray(a * np.exp(1j * np.radians(b)) if polar else a + 1j * b)
    if not np.all((coherence > 0) & (coherence < 1)):
        raise InputError(f"{file}: coherence: expected values above 0 and below 1")
    if polar and not np.all(a > 0):
        raise InputError(f"{file}: magnitude: expected values above 0")
    if not np.all((abs(a) < 1e30) & (abs(b) < 1e30)):
        raise InputError(f"{file}: {parts[0]}, {parts[1]}: expected values below 1e30")
    return Measurement(
        frequency_hz=f,
        response=response,
        coherence=coherence,
        variance=(1 - coherence) / coherence * abs(response) ** 2 / (averages - 1),
        floor=np.zeros(len(f)),
        dof=averages - 1,
        averages=averages,
        input="drive.command" if settings.input is None else settings.input,
        output=output,
        unit="",
        dt=dt,
        inject="volts",
        model=model,
        overrides=dict(overrides),
        scale=1.0,
        modes=settings.modes or {},
    )


def starts_of(
    texts: Sequence[str], measured: Measurement
) -> tuple[dict[str, float], dict[str, str]]:
    """Returns ({parameter: start value}, {parameter: unit}) from texts NAME or NAME=START. Without
    START, the value of the model is the start value. Raises ParameterError."""
    known = linear.facts(measured.model, measured.overrides).parameters
    starts: dict[str, float] = {}
    for text in texts:
        name, given, value = text.partition("=")
        if name not in known:
            raise ParameterError(
                "names",
                f"{name}: expected a parameter that the model uses, one of "
                + ", ".join(sorted(known)),
            )
        if name in starts:
            raise ParameterError("names", f"{name}: expected each name once")
        try:
            starts[name] = float(value) if given else known[name][0]
        except ValueError:
            raise ParameterError(
                "names", f"{text}: expected NAME=START with a number as START"
            ) from None
    return starts, {name: known[name][1] for name in starts}


@dataclass(frozen=True)
class FittedParameter:
    """A fitted parameter in `unit`, with two 95 % intervals (low, high).

    `interval` is valid for this parameter alone, and `joint_interval` for all parameters together.
    Both intervals are None if the model is rejected.
    """

    value: float
    unit: str
    start: float
    interval: tuple[float, float] | None
    joint_interval: tuple[float, float] | None


@dataclass(frozen=True)
class FitSummary:
    """A ParameterFit for JSON. `set`: fitted values as overrides for a command line. It is None if
    the model is rejected, or if the search has not converged."""

    model: str
    input: str
    output: str
    points: int
    parameters: dict[str, FittedParameter]
    correlation: list[list[float]]
    chi_square: float
    dof: int
    p_value: float
    rejected: bool
    warnings: tuple[str, ...]
    set: str | None = None


def summarise(found: ParameterFit, measured: Measurement, units: Mapping[str, str]) -> FitSummary:
    """Returns the summary of a fit. `units`: {parameter: unit}."""

    def interval(value: float, half: float) -> tuple[float, float] | None:
        if found.rejected:
            return None
        return float(value * math.exp(-half)), float(value * math.exp(half))

    rows = {
        name: FittedParameter(
            float(value), units[name], float(start), interval(value, single), interval(value, joint)
        )
        for name, start, value, single, joint in zip(
            *(found.names, found.starts, found.values, found.single, found.joint), strict=True
        )
    }
    return FitSummary(
        model=paths.display(measured.model),
        input=measured.input,
        output=measured.output,
        points=found.points,
        parameters=rows,
        correlation=found.correlation.tolist(),
        chi_square=found.chi_square,
        dof=found.dof,
        p_value=found.p_value,
        rejected=found.rejected,
        warnings=found.warnings,
    )


def write(found: ParameterFit, measured: Measurement, summary: FitSummary, out: Path) -> None:
    """Writes result.json and plot.png to the folder `out`. The plot shows the measured response,
    and the response of the model before and after the fit."""
    from forceaxis.identify import plots

    start, fitted = (
        measured.predict(dict(zip(found.names, values.tolist(), strict=True)))
        for values in (found.starts, found.values)
    )
    figure = plots.fitted(measured, start, fitted)
    with paths.replacing(out, "plot.png", "result.json") as (picture, result):
        figure.savefig(picture, dpi=120, format="png")
        result.write_text(json.dumps(to_json(summary), indent=2) + "\n")
