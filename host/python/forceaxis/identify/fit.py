"""Fits parameters of a model to a measured frequency response, with confidence intervals (`identify
fit`)."""

import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, stats

from forceaxis import linear, paths, progress
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.identify.measurement import Complexes, Measurement, Reals
from forceaxis.identify.procedures import SHARE, header_of, read_columns
from forceaxis.identify.setup import is_number
from forceaxis.results import to_json

CORRELATED = 0.95  # correlation of two estimates from which a warning is given
VAGUE = math.log(2)  # half width of an interval of the logarithm from which a warning is given
ALONE = 1e-7  # smallest singular value of the normalised Jacobian for separate parameters
BLIND = 1e-9  # smallest relative change of a response that counts as an effect
# probability of the chi-square below which other start values are tried and the fit is rejected
MISFIT = 1e-3
STARTS = 24
ARRAYS = ("frequency_hz", "response", "coherence", "variance", "floor")  # of a Measurement
REACH = 3.0  # search range about the logarithm of the start value: a factor of 20 up and down


@dataclass(frozen=True)
class ParameterFit:
    """Parameters fitted to a measured response. p parameters, n points.

    `covariance` (p, p) is that of the parameters' logarithms. `single` and `joint` are half widths
    of 95 % intervals of the logarithms: the truth of one parameter lies within value exp(+-single)
    with probability 0.95, all of them at once within value exp(+-joint) with at least that.
    """

    names: tuple[str, ...]
    starts: Reals
    values: Reals
    single: Reals
    joint: Reals
    covariance: Reals
    chi_square: float  #: has 2 n - p degrees of freedom if the model is correct
    dof: int
    points: int
    warnings: tuple[str, ...]

    @property
    def p_value(self) -> float:
        """Probability of a chi-square at least as large if the model is correct."""
        return float(stats.chi2.sf(self.chi_square, self.dof))

    @property
    def rejected(self) -> bool:
        """Whether no values of the parameters explain the data. `values` are then the best fit, but
        not those of the plant, and the intervals are invalid."""
        return self.p_value < MISFIT

    @property
    def correlation(self) -> Reals:
        """Correlation matrix of the estimates, (p, p)."""
        spread = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(spread, spread))

    def distance(self, values: ArrayLike) -> float:
        """Position of `values` (p,) relative to the joint 95 % region: below 1 inside, 1 at its
        edge."""
        step = np.log(values) - np.log(self.values)
        size = step @ np.linalg.solve(self.covariance, step)
        p = len(step)
        return float(size / (p * stats.f.ppf(SHARE, p, self.dof)))


def fit(
    measured: Measurement,
    starts: Mapping[str, float],
    where: str = "fit",
    tries: int | None = None,
) -> ParameterFit:
    """Fits parameters of a model to a measured frequency response.

    measured: a `Measurement`, whose `predict` is the model. starts: {parameter: start value > 0};
    the search varies the logarithms of these parameters. Other parameters have the values of
    `measured.overrides`. tries: number of other start values for a fit that does not explain the
    data, by default STARTS.

    With z = |response - model|^2 / variance, where the variance is itself estimated from dof
    complex residuals, minus twice the log likelihood is (dof + 1) / dof times the sum of
    2 dof ln(1 + z / dof), which has a chi-square distribution with 2 degrees of freedom a point:
    minimised by least squares (trust region), it is also the test of the fit. Information matrix:
    with T = dof variance + |response - model|^2, the sum of 2 dof^2 / (dof + 1) Re(J* J) / T, right
    in the mean over T; the covariance grows with the chi-square where the model is not the plant.

    Raises InputError for too few points, for a parameter that the response does not depend on and
    for parameters that only act together.
    """
    names = tuple(starts)
    first = np.array([starts[name] for name in names], float)
    for name, value in starts.items():
        if not (math.isfinite(value) and value > 0):
            raise InputError(
                f"{where}: {name}: expected a start above 0, got {value:g}; give a start value"
            )
    p, n, dof = len(names), len(measured.frequency_hz), measured.dof
    if n < p + 2:
        raise InputError(
            f"{where}: expected at least {p + 2} frequencies for {p} parameters, got {n}; measure "
            "a wider band, or with more lines"
        )

    def model(logarithms: Reals) -> Complexes:
        return measured.predict(dict(zip(names, np.exp(logarithms).tolist(), strict=True)))

    def jacobian(logarithms: Reals, step: float = 1e-5) -> Complexes:
        steps = step * np.eye(p)
        return np.stack(
            [(model(logarithms + d) - model(logarithms - d)) / (2 * step) for d in steps], 1
        )

    def as_real(values: NDArray[Any]) -> Reals:
        return np.concatenate([values.real, values.imag])

    def coarse(logarithms: Reals) -> Reals:
        """Residuals of the logarithm of the ratio; they also converge if resonances do not overlap
        yet."""
        return as_real(np.log(measured.response / model(logarithms)) * trust)

    def fine(logarithms: Reals) -> Reals:
        error = (measured.response - model(logarithms)) / np.sqrt(measured.variance)
        square = np.maximum(abs(error) ** 2, 1e-30)
        return as_real(error * np.sqrt(2 * dof * np.log1p(square / dof) / square))

    start = np.log(first)

    def search(begin: Reals) -> optimize.OptimizeResult:
        """Search with the coarse residuals, which converge from distant start values, then with the
        likelihood."""
        options = {"bounds": (start - REACH, start + REACH), "x_scale": "jac", "max_nfev": 60}
        near = optimize.least_squares(coarse, begin, loss="soft_l1", **options).x
        near = np.clip(near, start - REACH + 0.01, start + REACH - 0.01)
        return optimize.least_squares(fine, near, xtol=1e-10, ftol=1e-10, **options)

    influence = abs(jacobian(start)).max(0) / abs(model(start)).max()
    for name, size in zip(names, influence, strict=True):
        if size < BLIND:
            raise InputError(
                f"{where}: {name}: expected a parameter that the response from {measured.input} to "
                f"{measured.output} depends on; fit another one, or measure another signal"
            )
    check_separate(names, as_real(jacobian(start)), where)

    relative = np.sqrt(measured.variance) / np.maximum(abs(measured.response), 1e-300)
    # limits the weight of a point to that of a relative error of a tenth
    trust = 1 / np.hypot(relative, 0.1)
    best = search(start)
    degrees = 2 * n - p
    enough = stats.chi2.isf(MISFIT, degrees)
    scatter = np.random.default_rng(0).uniform(-1, 1, (STARTS if tries is None else tries, p))
    for shift in progress.each(scatter, "starts"):
        if 2 * best.cost <= enough:
            break
        other = search(start + shift)
        if other.cost < best.cost:
            best = other

    J = jacobian(best.x)
    check_separate(names, as_real(J), where)
    T = dof * measured.variance + abs(measured.response - model(best.x)) ** 2
    information = 2 * dof**2 / (dof + 1) * (J.conj().T @ (J / T[:, None])).real
    chi_square = 2 * best.cost
    covariance = np.linalg.inv(information) * max(1.0, chi_square / degrees)
    spread = np.sqrt(np.diag(covariance))
    single = stats.t.ppf((1 + SHARE) / 2, degrees) * spread
    joint = math.sqrt(p * stats.f.ppf(SHARE, p, degrees)) * spread

    warnings = warnings_of(
        names, chi_square, degrees, covariance / np.outer(spread, spread), single, best.x - start
    )
    return ParameterFit(
        *(names, first, np.exp(best.x), single, joint, covariance, float(chi_square), degrees, n),
        tuple(warnings),
    )


def warnings_of(
    names: Sequence[str],
    chi_square: float,
    degrees: int,
    correlation: Reals,
    single: Reals,
    moved: Reals,
) -> list[str]:
    """Texts of warnings about a fit. moved: change of the logarithms from the start values."""
    warnings = []
    p_value = stats.chi2.sf(chi_square, degrees)
    if p_value < 1 - SHARE:
        warnings.append(
            f"the model does not explain the data: chi-square {chi_square:.4g}, {degrees} degrees "
            f"of freedom, p = {p_value:.1g}; free another parameter or check what is held"
        )
    for i, j in zip(*np.nonzero(abs(np.triu(correlation, 1)) > CORRELATED), strict=True):
        warnings.append(
            f"{names[i]} and {names[j]} are nearly indistinguishable: "
            f"correlation {correlation[i, j]:.3f}"
        )
    warnings += [
        f"{name} is poorly determined" for name, h in zip(names, single, strict=True) if h > VAGUE
    ]
    for name, distance in zip(names, abs(moved), strict=True):
        if distance > REACH - 0.02:
            warnings.append(
                f"{name} stands at the edge of what was searched, {math.exp(REACH):.0f} times its "
                "start or that part of it: its interval means nothing; give another start"
            )
    return warnings


def check_separate(names: Sequence[str], J: Reals, where: str) -> None:
    """Raises InputError, with the names, for parameters of which only a combination changes the
    response."""
    _, size, directions = np.linalg.svd(J / np.linalg.norm(J, axis=0), full_matrices=False)
    if size[-1] < ALONE * size[0]:
        together = [n for n, part in zip(names, directions[-1], strict=True) if abs(part) > 0.1]
        raise InputError(
            f"{where}: expected parameters that act on the response each in its own way, got "
            f"{', '.join(together)}, which do so only together; hold one of them"
        )


def read_response(
    path: Path | str, model: Path | str, held: linear.Overrides | None = None, **given: Any
) -> Measurement:
    """Reads the Measurement in a folder (or response.npz) of `forceaxis measure --out`, or in a CSV
    file.

    A CSV file has the columns frequency_hz, magnitude and phase_deg or real and imag, and
    coherence. `given` contains the other keys: input, output, averages, dt (s), scale; they replace
    recorded values. `held`, {parameter: value}, is added to the recorded parameters. Raises
    InputError.
    """
    path = Path(path)
    file = path / "response.npz" if path.is_dir() else path
    given = {key: value for key, value in given.items() if value is not None}
    model = str(linear.find_model(model))
    if file.suffix == ".csv":
        for key in ("output", "averages", "dt"):
            if key not in given:
                raise ParameterError(key, f"expected with a CSV file, {file} does not have it")
        measured = response_of_csv(file, given["averages"])
        measured = replace(measured, **given, model=model, overrides=dict(held or {}))
        return checked(measured, file)
    try:
        with np.load(file) as saved:
            about = json.loads(str(saved["about"]))
            arrays = {name: saved[name] for name in ARRAYS}
            about["overrides"] = about["overrides"] | (held or {})
            measured = Measurement(**(about | given | {"model": model}), **arrays)
    except (
        AttributeError, EOFError, FileNotFoundError, KeyError, TypeError, ValueError,
        zipfile.BadZipFile,
    ):  # fmt: skip
        raise InputError(
            f"{file}: expected response.npz as forceaxis measure writes it, or a CSV file"
        ) from None
    return checked(measured, file)


def checked(measured: Measurement, file: Path) -> Measurement:
    """Returns the Measurement if a model can be fitted to it. Raises InputError otherwise."""

    def expect(good: object, key: str, text: str) -> None:
        if not good:
            raise InputError(f"{file}: {key}: expected {text}")

    def between(key: str, low: float, high: float) -> None:
        value = getattr(measured, key)
        good = is_number(value) and low <= value <= high
        expect(good, key, f"a number {low:g} to {high:g}, got {value!r}")

    for key in ("input", "output", "unit"):
        expect(isinstance(getattr(measured, key), str), key, "a text")
    expect(measured.inject in ("volts", "codes"), "inject", "volts or codes")
    expect(measured.window in ("none", "hann"), "window", "none or hann")
    expect(isinstance(measured.free, bool), "free", "true or false")
    table = measured.overrides
    good = isinstance(table, dict) and all(map(is_number, table.values()))
    expect(good, "overrides", "a table of numbers")
    between("dt", 1e-7, 1.0)
    between("dof", 1e-3, 1e9)
    between("averages", 2, 1e9)
    between("resolution_hz", 0, 1e6)
    between("scale", -1e12, 1e12)
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
        f"rising frequencies above 0 and below {highest:g} Hz, half of the samples' 1 / dt",
    )
    expect(np.all(measured.variance > 0), "variance", "values above 0")
    expect(np.all(measured.response != 0), "response", "values other than 0")
    return measured


def response_of_csv(file: Path, averages: int) -> Measurement:
    """Measurement from a CSV file; its variance is (1 - c) |H|^2 / (c (averages - 1)) with the
    coherence c."""

    polar = "magnitude" in header_of(file)
    parts = ["magnitude", "phase_deg"] if polar else ["real", "imag"]
    f, a, b, coherence = read_columns(file, ["frequency_hz", *parts, "coherence"])
    response: Complexes = np.asarray(a * np.exp(1j * np.radians(b)) if polar else a + 1j * b)
    if not np.all((coherence > 0) & (coherence < 1)):
        raise InputError(f"{file}: coherence: expected 0 < coherence < 1")
    if polar and not np.all(a > 0):
        raise InputError(f"{file}: magnitude: expected values above 0")
    if not np.all((abs(a) < 1e30) & (abs(b) < 1e30)):
        raise InputError(f"{file}: {parts[0]}, {parts[1]}: expected values below 1e30")
    variance = (1 - coherence) / coherence * abs(response) ** 2 / (averages - 1)
    return Measurement(
        *(f, response, coherence, variance, np.zeros(len(f))),
        dof=averages - 1,
        averages=averages,
        input="drive.command",
        output="",
        unit="",
        dt=linear.TICK_S,
        inject="volts",
        model="",
        overrides={},
    )


def starts_of(
    texts: Sequence[str], measured: Measurement
) -> tuple[dict[str, float], dict[str, str]]:
    """({name: start value}, {name: unit}) from texts NAME or NAME=START; the default is the model's
    value."""
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
            raise ParameterError("names", f"{text}: expected NAME=START, a number") from None
    return starts, {name: known[name][1] for name in starts}


@dataclass(frozen=True)
class FittedParameter:
    """A fitted parameter in `unit`. Both 95 % intervals, (low, high), are None if the model is
    rejected: `interval` is that of this parameter alone, `joint_interval` that of all parameters
    together."""

    value: float
    unit: str
    start: float
    interval: tuple[float, float] | None
    joint_interval: tuple[float, float] | None


@dataclass(frozen=True)
class FitSummary:
    """A ParameterFit in the form of `identify fit --json`. The command line puts the fitted values
    into `set` as its options; `set` is None if the model is rejected."""

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
    """The summary of a fit; units: {parameter: unit}."""

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
    """Writes result.json and plot.png, which shows the measured response and the model before and
    after the fit."""
    from forceaxis.identify import plots

    start, fitted = (
        measured.predict(dict(zip(found.names, values.tolist(), strict=True)))
        for values in (found.starts, found.values)
    )
    figure = plots.fitted(measured, start, fitted)
    with paths.replacing(out, "plot.png", "result.json") as (picture, result):
        figure.savefig(picture, dpi=120, format="png")
        result.write_text(json.dumps(to_json(summary), indent=2) + "\n")
