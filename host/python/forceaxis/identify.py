"""Identification: a model's parameters from what was measured, each with its interval.

The procedures by which the thesis found the values of Figures 4.4 and 4.26 (4.1.2, 4.4, 5.2.1),
and a fit of any parameters of a model to a measured frequency response.
"""

import csv
import json
import math
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import optimize, signal, stats

from forceaxis import linear, paths
from forceaxis._core import InputError

SHARE = 0.95  # of all intervals
LARGEST = 1e100  # number of a CSV file, so that no sum of squares overflows
FEWEST_CYCLES = 3
FEWEST_SAMPLES = 30  # of a ring-down: below, noise alone may look like one
RATES = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)  # of decay over omega, where the fit starts
NEARLY = 0.9  # of the largest amplitude: a ring-down has begun
EXPLAINED = 0.5  # share of a record's variance below which it is not one ring-down
COLOURED = 4  # residual density around the mode over that of white noise: a warning


@dataclass(frozen=True)
class Estimate:
    """A value and the half width of its 95 % interval, both in `unit`."""

    value: float
    half: float
    unit: str = ""

    def json(self):
        """{"value", "interval": [low, high], "unit"}; null for what is not finite."""
        ends = [self.value - self.half, self.value + self.half]
        return {
            "value": finite(self.value),
            "interval": [finite(end) for end in ends],
            "unit": self.unit,
        }

    def __str__(self):
        return f"{self.value:.5g} +-{self.half:.2g} {self.unit}".rstrip()


def finite(number):
    """The number, or None where JSON has none."""
    return float(number) if math.isfinite(number) else None


def propagate(function, *estimates, unit=""):
    """Estimate of function(values): the half widths of independent estimates add in quadrature."""
    values = [e.value for e in estimates]
    square = 0.0
    for i, e in enumerate(estimates):
        ends = [function(*values[:i], e.value + d, *values[i + 1 :]) for d in (-e.half, e.half)]
        square += ((ends[1] - ends[0]) / 2) ** 2
    return Estimate(function(*values), math.sqrt(square), unit)


def regression(columns, values, weights=None):
    """Least squares of values (n,) on columns (n, p), weights (n,) as 1 / standard deviation.

    Returns [(coefficient, half width of its 95 % interval)], scaled by the residuals (t, n - p).
    """
    weights = np.ones(len(values)) if weights is None else weights
    A, y = columns * weights[:, None], values * weights
    coefficients = np.linalg.lstsq(A, y)[0]
    dof = len(y) - A.shape[1]
    variance = np.sum((y - A @ coefficients) ** 2) / dof
    spread = np.sqrt(variance * np.diag(np.linalg.inv(A.T @ A)))
    return list(zip(coefficients, stats.t.ppf((1 + SHARE) / 2, dof) * spread, strict=True))


def rows_of(path):
    """[(number of the line, [texts])] of a CSV file's lines that are not empty. InputError."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            return [(rows.line_num, row) for row in rows if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: expected a CSV file in UTF-8, {error}") from None


def header_of(path):
    """Names of the columns of a CSV file."""
    return [name.strip() for _, row in rows_of(path)[:1] for name in row]


def read_columns(path, names):
    """Named columns of a CSV file as float arrays. Raises InputError with file, line and column."""
    rows = rows_of(path)
    header = [name.strip() for name in rows[0][1]] if rows else []
    for name in names:
        if header.count(name) != 1:
            raise InputError(
                f"{path}: expected {'a' if name not in header else 'one'} column {name}, it has "
                f"{', '.join(header) or 'none'}; name the columns in the first line"
            )
    places = [header.index(name) for name in names]
    columns = [[] for _ in names]
    for line, row in rows[1:]:
        for column, name, place in zip(columns, names, places, strict=True):
            text = row[place] if place < len(row) else ""
            try:
                column.append(float(text))
            except ValueError:
                column.append(math.nan)
            if not abs(column[-1]) < LARGEST:
                raise InputError(
                    f"{path}: line {line}, {name}: expected a number, got {text!r}"
                    + (f"; the largest is {LARGEST:g}" if abs(column[-1]) >= LARGEST else "")
                )
    return [np.array(column) for column in columns]


# --- ring-down (4.4.2 to 4.4.6, 5.2.1) ---------------------------------------------------------


@dataclass(frozen=True)
class RingDown:
    """What a recorded free vibration says about its mode."""

    cycles: int  #: that were used
    damped_frequency: Estimate  #: Hz, one over the period
    natural_frequency: Estimate  #: Hz, that without damping
    decrement: Estimate  #: ln of the ratio of amplitudes one cycle apart
    damping_ratio: Estimate  #: by the thesis's formula, decrement / (2 pi)
    damping_ratio_exact: Estimate  #: decrement / sqrt(4 pi^2 + decrement^2), its limit beside 1
    decrement_of_ratio: float  #: ln(first cycle's amplitude / last one's) / cycles between them
    explained: float  #: share of the record's variance, 0..1
    noise: float  #: standard deviation of what is left, in the signal's unit
    warnings: tuple


def damped_sine(time_s, rate, omega):
    """Columns (n, 4) of a vibration e^(-rate t) with an offset and a drift."""
    envelope, ones = np.exp(-rate * time_s), np.ones(len(time_s))
    return np.stack(
        [envelope * np.cos(omega * time_s), envelope * np.sin(omega * time_s), ones, time_s], 1
    )


def fit_damped_sine(time, values, starts):
    """Least squares of a damped sine: the result of SciPy, its x: rate, omega and 4 coefficients.

    time (n,) from 0, starts [(rate, omega)] in 1/s and rad/s, of which the best one is taken.
    """

    def linear_part(start):
        columns = damped_sine(time, *start)
        found = np.linalg.lstsq(columns, values)[0]
        return float(np.sum((columns @ found - values) ** 2)), [*start, *found]

    def residual(x):
        return damped_sine(time, x[0], x[1]) @ x[2:] - values

    def jacobian(x):
        columns = damped_sine(time, x[0], x[1])
        cosine, sine = columns[:, 0], columns[:, 1]
        along = -time * (x[2] * cosine + x[3] * sine)
        across = time * (x[3] * cosine - x[2] * sine)
        return np.column_stack([along, across, columns])

    start = min(map(linear_part, starts), key=lambda pair: pair[0])[1]
    return optimize.least_squares(
        residual, start, jacobian, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12
    )


def cycle_amplitudes(time, values, omega, starts):
    """Amplitudes of the cycles that begin at `starts`, s: each from its Fourier coefficient."""
    turning = values * np.exp(-1j * omega * time)
    steps = np.diff(time) * (turning[1:] + turning[:-1]) / 2
    total = np.concatenate([[0], np.cumsum(steps)])
    period = 2 * math.pi / omega
    ends = [np.interp(starts + d, time, total) for d in (0.0, period)]
    return abs(ends[1] - ends[0]) * 2 / period


def likely_frequencies(time, values):
    """The three highest peaks of the spectrum, rad/s; of times that may be unequally spaced."""
    even = np.linspace(time[0], time[-1], len(time))
    bent = signal.detrend(np.interp(even, time, values))
    size = abs(np.fft.rfft(bent, 2 * len(even)))
    peaks, about = signal.find_peaks(size, height=0)
    highest = peaks[np.argsort(about["peak_heights"])[::-1][:3]]
    return np.pi * highest / len(even) / (even[1] - even[0])


def ring_down(time_s, values, floor=0.05, where="ring-down"):
    """Frequency and logarithmic decrement of a free vibration about any offset and slow drift.

    time_s (n,) rising, values (n,) in any unit. A damped sine is fitted to the record from the
    largest amplitude on, down to `floor` (0..1) of that. Intervals are those of least squares for
    white noise, or for the noise's density around the vibration's frequency if that is more (as of
    another mode nearby), and for at least twice the variance of a converter's rounding. Beside it
    stands the ratio of the amplitudes of the first and the last cycle, as one reads them off a
    plot. Raises InputError for fewer than 3 cycles and for a record that one damped sine does not
    explain.
    """
    if len(time_s) < 2 or np.any(np.diff(time_s) <= 0):
        raise InputError(f"{where}: time_s: expected at least two rising times, in s")
    if len(time_s) < FEWEST_SAMPLES:
        raise InputError(
            f"{where}: expected at least {FEWEST_SAMPLES} samples, got {len(time_s)}; record longer"
        )
    frequencies, unit = likely_frequencies(time_s, values), float(np.std(values))
    if unit == 0 or not len(frequencies):
        raise too_short(where, 0, floor)

    def fitted(inside, omegas, rates):
        time = time_s[inside] - time_s[inside][0]
        starts = [(rate * omega, omega) for omega in omegas for rate in rates]
        return time, fit_damped_sine(time, (values[inside] - values.mean()) / unit, starts)

    # What came before the largest amplitude is not part of it; half of a period may be the strike.
    period = 2 * math.pi / frequencies[0]
    begins = time_s[time_s <= max(time_s[-1] - period, time_s[0])]
    level = signal.detrend(values)
    amplitude = cycle_amplitudes(time_s, level, frequencies[0], begins)
    first = begins[np.flatnonzero(amplitude >= NEARLY * amplitude.max())[0]]
    if first > time_s[0]:
        first = min(first + period / 4, time_s[-1] - period)
    inside = time_s >= first
    if inside.sum() < FEWEST_SAMPLES:
        raise too_short(where, (time_s[-1] - first) / period, floor)
    time, found = fitted(inside, frequencies, RATES)
    rate, omega = found.x[:2]
    if rate * time[-1] > -math.log(floor):
        inside &= time_s <= first - math.log(floor) / rate
        if inside.sum() < FEWEST_SAMPLES:
            raise too_short(where, -math.log(floor) / rate * omega / (2 * math.pi), floor)
        time, found = fitted(inside, [omega], [rate / omega])
        rate, omega = found.x[:2]

    left, n, p = found.fun, inside.sum(), len(found.x)
    spread = np.sum((values[inside] - values[inside].mean()) ** 2) / unit**2
    explained = 1 - (np.sum(left**2) / (n - p)) / (spread / (n - 1))
    if not explained >= EXPLAINED or not 0 < omega < math.pi * (n - 1) / time[-1]:
        raise InputError(
            f"{where}: expected one vibration that dies out, the best fit explains "
            f"{100 * max(explained, 0):.3g} % of the record; cut it with --from-s and --to-s, "
            "filter it, or strike harder"
        )
    cycles = int(time[-1] * omega / (2 * math.pi) + 0.01)
    if cycles < FEWEST_CYCLES:
        raise too_short(where, cycles, floor)

    white = float(np.sum(left**2) / (n - p))
    lines = abs(np.fft.rfft(left)) ** 2 / n
    here = omega * time[-1] / (2 * math.pi)
    near = lines[max(1, round(here / 2)) : round(2 * here) + 1]
    local = float(near.sum() / max(len(near) - 2, 1))  # 4 of the real parameters are taken from it
    # Rounding without noise depends on the vibration: errors of its amplitude that the residual
    # does not show; twice the variance of rounding, step^2 / 12, covers them.
    levels = np.unique(values[inside])
    rounding = (np.diff(levels).min() / unit) ** 2 / 6 if len(levels) < n / 4 else 0.0
    covariance = np.linalg.inv(found.jac.T @ found.jac)[:2, :2] * max(white, local, rounding)
    t = stats.t.ppf((1 + SHARE) / 2, n - p)

    def estimate(value, gradient, unit=""):
        return Estimate(float(value), float(t * math.sqrt(gradient @ covariance @ gradient)), unit)

    turn, size = 2 * math.pi, math.hypot(rate, omega)
    by_cycle = np.array([1 / omega, -rate / omega**2])  # gradient of rate / omega
    decrement = estimate(turn * rate / omega, turn * by_cycle)
    if decrement.value + 3 * decrement.half < -1e-6:
        raise InputError(
            f"{where}: expected a vibration that dies out, it grows: decrement {decrement}; cut "
            "the record with --from-s and --to-s"
        )
    offset = damped_sine(time, rate, omega)[:, 2:] @ found.x[4:] * unit + values.mean()
    ends = np.array([0.0, (cycles - 1) * turn / omega])
    ratio = cycle_amplitudes(time, values[inside] - offset, omega, ends)
    warnings = []
    if local > COLOURED * white and len(near) > 4 and explained < 1 - 1e-12:
        warnings.append(
            "what the fit leaves is not white noise: another mode or a nonlinearity; the "
            "intervals count it as noise"
        )
    return RingDown(
        cycles,
        estimate(omega / turn, np.array([0, 1 / turn]), "Hz"),
        estimate(size / turn, np.array([rate, omega]) / (size * turn), "Hz"),
        decrement,
        estimate(rate / omega, by_cycle),
        estimate(rate / size, np.array([omega, -rate]) * omega / size**3),
        float(np.log(ratio[0] / ratio[1]) / (cycles - 1)),
        float(explained),
        math.sqrt(white) * unit,
        tuple(warnings),
    )


def too_short(where, cycles, floor):
    return InputError(
        f"{where}: expected a ring-down of at least {FEWEST_CYCLES} cycles, found {int(cycles)}; "
        f"record longer, strike harder or lower the floor of {floor:g}"
    )


def mode_parameters(frequency_hz, damping_ratio, mass=None, stiffness=None):
    """Mass (kg), stiffness (N/m) and damping (N s/m) of a mode of which one of the first is known.

    All Estimates; frequency is the natural one, damping_ratio the exact one: k = m w^2,
    b = 2 zeta sqrt(k m) (4.4.3 to 4.4.6). Returns {"mass", "stiffness", "damping"}.
    """
    if (mass is None) == (stiffness is None):
        raise ValueError("expected mass or stiffness, one of them")
    if mass is not None:
        stiffness = propagate(
            lambda f, m: m * (2 * math.pi * f) ** 2, frequency_hz, mass, unit="N/m"
        )
        damping = propagate(
            lambda f, z, m: 4 * math.pi * f * z * m,
            *(frequency_hz, damping_ratio, mass),
            unit="N s/m",
        )
    else:
        mass = propagate(
            lambda f, k: k / (2 * math.pi * f) ** 2, frequency_hz, stiffness, unit="kg"
        )
        damping = propagate(
            lambda f, z, k: z * k / (math.pi * f),
            *(frequency_hz, damping_ratio, stiffness),
            unit="N s/m",
        )
    return {
        "mass": replace(mass, unit="kg"),
        "stiffness": replace(stiffness, unit="N/m"),
        "damping": damping,
    }


# --- two masses (4.4.2) -------------------------------------------------------------------------


@dataclass(frozen=True)
class Split:
    """Two masses on either side of a spring, kg."""

    solutions: tuple  #: ((m_r1, m_r2), (m_r1, m_r2)), the chosen one first
    locked: tuple  #: (m_r1, m_r2) if the frequency was that with m_r1 locked to ground
    locked_frequency_hz: float  #: at which the chosen m_r2 vibrates with m_r1 locked


def split(total_mass, stiffness, frequency_hz):
    """m_r1 + m_r2 = m, w^2 = k m / (m_r1 m_r2): Estimates of m (kg), k (N/m) and w / (2 pi) (Hz).

    That is the mode of both masses in free space. The choice is the thesis's: the actuator has more
    than half of the inertia, m_r1 > m_r2. Raises InputError without a real solution.
    """

    def larger(m, k, f):
        return (m + math.sqrt(max(m * m - 4 * m * locked(k, f), 0))) / 2

    def smaller(m, k, f):  # by the product of both: no difference of what is nearly equal
        return m * locked(k, f) / larger(m, k, f)

    def locked(k, f):
        return k / (2 * math.pi * f) ** 2

    m, k, f = total_mass.value, stiffness.value, frequency_hz.value
    lowest = math.sqrt(4 * k / m) / (2 * math.pi)
    if f < lowest:
        raise InputError(
            f"split: frequency: expected at least {lowest:.5g} Hz, the lowest that two masses of "
            f"{m:g} kg together have on {k:g} N/m (half each), got {f:g} Hz; check the three"
        )
    large, small = (
        propagate(part, total_mass, stiffness, frequency_hz, unit="kg")
        for part in (larger, smaller)
    )
    return Split(
        ((large, small), (small, large)),
        (
            propagate(
                lambda m, k, f: m - locked(k, f), total_mass, stiffness, frequency_hz, unit="kg"
            ),
            propagate(locked, stiffness, frequency_hz, unit="kg"),
        ),
        math.sqrt(k / small.value) / (2 * math.pi),
    )


# --- motor (4.1.2) ------------------------------------------------------------------------------


def regression_of(path, x, y, offset=False, units=("", "")):
    """[slope] or, with `offset`, [slope, offset] of column y over x of a CSV file, Estimates.

    Raises InputError for fewer than 3 rows (4 with offset) or rows that all have one x.
    """
    at, values = read_columns(path, [x, y])
    fewest = 4 if offset else 3
    if len(at) < fewest:
        raise InputError(f"{path}: expected at least {fewest} rows, got {len(at)}; measure more")
    if not at.any() or (offset and np.ptp(at) == 0):
        what = "different values" if offset else "values other than 0"
        raise InputError(f"{path}: {x}: expected {what}; repeat it at many speeds")
    columns = np.stack([at, np.ones(len(at))], 1) if offset else at[:, None]
    found = regression(columns, values)
    return [Estimate(*pair, unit) for pair, unit in zip(found, units, strict=False)]


def motor_damping(ratio, k_torque, k_tach, k_back_emf, resistance, where="motor"):
    """b_m (N m s/rad) from V_tach / V_motor = k_t k_tach / (R b_m + k_b k_t) at steady speed.

    ratio in V/V, k_torque in N m/A, k_tach and k_back_emf in V s/rad, resistance in ohm, Estimates.
    """
    if ratio.value <= 0:
        raise InputError(
            f"{where}: expected a tachometer voltage that rises with the motor's, got "
            f"{ratio.value:.4g} V/V; check signs and columns"
        )
    return propagate(
        lambda r, t, tach, b, R: (t * tach / r - b * t) / R,
        *(ratio, k_torque, k_tach, k_back_emf, resistance),
        unit="N m s/rad",
    )


# --- fit to a measured response -----------------------------------------------------------------

CORRELATED = 0.95  # two parameters whose estimates are: a warning
VAGUE = math.log(2)  # half width of an interval in the logarithm, from which on it is a warning
ALONE = 1e-7  # singular value of the normalised Jacobian below which parameters act only together
BLIND = 1e-9  # relative change of a response that is none
MISFIT = 1e-3  # probability of the chi-square below which other starts are tried
STARTS = 24
ARRAYS = ("frequency_hz", "response", "coherence", "variance", "floor")  # of a Measurement
REACH = 3.0  # to either side of the logarithm of the start: 20 times, or a twentieth


@dataclass(frozen=True)
class Fit:
    """Parameters fitted to a measured response. p parameters, n points.

    `covariance` (p, p) is that of the parameters' logarithms. `single` and `joint` are half widths
    of 95 % intervals of the logarithms: the truth of one parameter lies within value exp(+-single)
    with probability 0.95, all of them at once within value exp(+-joint) with at least that.
    """

    names: tuple
    starts: np.ndarray
    values: np.ndarray
    single: np.ndarray
    joint: np.ndarray
    covariance: np.ndarray
    chi_square: float  #: 2 n - p degrees of freedom if the model is right
    dof: int
    points: int
    warnings: tuple

    @property
    def p_value(self):
        """Probability of a chi-square as large, were the model right."""
        return float(stats.chi2.sf(self.chi_square, self.dof))

    @property
    def correlation(self):
        """(p, p) of the estimates."""
        spread = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(spread, spread)

    def distance(self, values):
        """Whether `values` (p,) lie in the joint 95 % region: below 1 inside, 1 on its edge."""
        step = np.log(values) - np.log(self.values)
        size = step @ np.linalg.solve(self.covariance, step)
        p = len(step)
        return float(size / (p * stats.f.ppf(SHARE, p, self.dof)))


def fit(measured, starts, where="fit"):
    """Fit parameters of a model to a measured frequency response.

    measured: a `measure.Measurement`, whose `predict` is the model. starts: {parameter: value to
    start from, > 0}: what is searched is their logarithm. Others keep the values of
    `measured.overrides`.

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
                f"{where}: {name}: expected a start above 0, got {value:g}; give one: --fit "
                f"{name}=VALUE"
            )
    p, n, dof = len(names), len(measured.frequency_hz), measured.dof
    if n < p + 2:
        raise InputError(
            f"{where}: expected at least {p + 2} frequencies for {p} parameters, got {n}; measure "
            "a wider band, or with more lines"
        )

    def model(logarithms):
        return measured.predict(dict(zip(names, np.exp(logarithms).tolist(), strict=True)))

    def jacobian(logarithms, step=1e-5):
        steps = step * np.eye(p)
        return np.stack(
            [(model(logarithms + d) - model(logarithms - d)) / (2 * step) for d in steps], 1
        )

    def as_real(values):
        return np.concatenate([values.real, values.imag])

    def coarse(logarithms):
        """Logarithm of the ratio: what finds resonances that do not overlap yet."""
        return as_real(np.log(measured.response / model(logarithms)) * trust)

    def fine(logarithms):
        error = (measured.response - model(logarithms)) / np.sqrt(measured.variance)
        square = np.maximum(abs(error) ** 2, 1e-30)
        return as_real(error * np.sqrt(2 * dof * np.log1p(square / dof) / square))

    start = np.log(first)

    def search(begin):
        """From far away in the logarithm, then as the errors are."""
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
    trust = 1 / np.hypot(relative, 0.1)  # no point counts as known better than a tenth
    best = search(start)
    degrees = 2 * n - p
    enough = stats.chi2.isf(MISFIT, degrees)
    scatter = np.random.default_rng(0).uniform(-1, 1, (STARTS, p))
    for shift in scatter:
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

    warnings = []
    p_value = stats.chi2.sf(chi_square, degrees)
    if p_value < 1 - SHARE:
        warnings.append(
            f"the model does not explain the data: chi-square {chi_square:.4g}, {degrees} degrees "
            f"of freedom, p = {p_value:.1g}; free another parameter or check what is held"
        )
    together = covariance / np.outer(spread, spread)
    for i, j in zip(*np.nonzero(abs(np.triu(together, 1)) > CORRELATED), strict=True):
        warnings.append(
            f"{names[i]} and {names[j]} are hard to tell apart: correlation {together[i, j]:.3f}"
        )
    warnings += [
        f"{name} is poorly determined" for name, h in zip(names, single, strict=True) if h > VAGUE
    ]
    for name, moved in zip(names, abs(best.x - start), strict=True):
        if moved > REACH - 0.02:
            warnings.append(
                f"{name} stands at the edge of what was searched, {math.exp(REACH):.0f} times its "
                "start or that part of it: its interval means nothing; give another start"
            )
    return Fit(
        *(names, first, np.exp(best.x), single, joint, covariance, float(chi_square), degrees, n),
        tuple(warnings),
    )


def check_separate(names, J, where):
    """Refuse parameters of which only a combination changes the response, naming them."""
    _, size, directions = np.linalg.svd(J / np.linalg.norm(J, axis=0), full_matrices=False)
    if size[-1] < ALONE * size[0]:
        together = [n for n, part in zip(names, directions[-1], strict=True) if abs(part) > 0.1]
        raise InputError(
            f"{where}: expected parameters that act on the response each in its own way, got "
            f"{', '.join(together)}, which do so only together; hold one of them"
        )


# --- the verb -----------------------------------------------------------------------------------


def decrement(path, column=None, window_s=(-math.inf, math.inf), floor=0.05, **known):
    """ring_down() of a CSV file with column time_s, and mode_parameters() for a known Estimate of
    mass or stiffness. `column`: that of the signal; may be left out if it is the only other one.
    Returns (RingDown, {"mass", "stiffness", "damping"} or {}).
    """
    if column is None:
        header = header_of(path)
        others = [name for name in header if name != "time_s"]
        if len(others) != 1 and "time_s" in header:
            raise InputError(
                f"{path}: --signal: expected the name of a column, one of {', '.join(others)}"
            )
        column = (others or [""])[0]
    time, values = read_columns(path, ["time_s", column])
    inside = (time >= window_s[0]) & (time <= window_s[1])
    found = ring_down(time[inside], values[inside], floor, path)
    if any(known.values()):
        return found, mode_parameters(found.natural_frequency, found.damping_ratio_exact, **known)
    return found, {}


def read_response(path, model, held=None, **given):
    """The Measurement of a folder (or response.npz) of `forceaxis measure --out`, or of a CSV file.

    A CSV file has columns frequency_hz, magnitude and phase_deg or real and imag, and coherence;
    `given` tells the rest: input, output, averages, dt (s), scale; it replaces what was recorded,
    and `held`, {parameter: value}, adds to it. Raises InputError.
    """
    from forceaxis import measure

    path = Path(path)
    file = path / "response.npz" if path.is_dir() else path
    given = {key: value for key, value in given.items() if value is not None}
    model = str(linear.find_model(model))
    if file.suffix == ".csv":
        for key in ("output", "averages", "dt"):
            if key not in given:
                raise InputError(f"{file}: --{key}: expected with a CSV file, which cannot tell it")
        measured = response_of_csv(file, given["averages"])
        measured = replace(measured, **given, model=model, overrides=dict(held or {}))
        return checked(measured, file)
    try:
        with np.load(file) as saved:
            about = json.loads(str(saved["about"]))
            arrays = {name: saved[name] for name in ARRAYS}
            about["overrides"] = about["overrides"] | (held or {})
            measured = measure.Measurement(**(about | given | {"model": model}), **arrays)
    except (AttributeError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        raise InputError(
            f"{file}: expected response.npz as forceaxis measure --out writes it, or a CSV file"
        ) from None
    return checked(measured, file)


def checked(measured, file):
    """The Measurement, if it is one that a model can be fitted to. Raises InputError."""
    from forceaxis import measure

    def expect(good, key, text):
        if not good:
            raise InputError(f"{file}: {key}: expected {text}")

    def between(key, low, high):
        value = getattr(measured, key)
        good = measure.is_number(value) and low <= value <= high
        expect(good, key, f"a number {low:g} to {high:g}, got {value!r}")

    for key in ("input", "output", "unit"):
        expect(isinstance(getattr(measured, key), str), key, "a text")
    expect(measured.inject in ("volts", "codes"), "inject", "volts or codes")
    expect(measured.window in ("none", "hann"), "window", "none or hann")
    expect(isinstance(measured.free, bool), "free", "true or false")
    table = measured.overrides
    good = isinstance(table, dict) and all(map(measure.is_number, table.values()))
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
    good = len(frequency) and frequency[0] > 0 and np.all(np.diff(frequency) > 0)
    expect(
        good and frequency[-1] < highest,
        "frequency_hz",
        f"rising frequencies above 0 and below {highest:g} Hz, half of the samples' 1 / dt",
    )
    expect(np.all(measured.variance > 0), "variance", "values above 0")
    expect(np.all(measured.response != 0), "response", "values other than 0")
    return measured


def response_of_csv(file, averages):
    """Measurement of a CSV file; variance (1 - c) |H|^2 / (c (averages - 1)) from coherence c."""
    from forceaxis import measure

    polar = "magnitude" in header_of(file)
    parts = ["magnitude", "phase_deg"] if polar else ["real", "imag"]
    f, a, b, coherence = read_columns(file, ["frequency_hz", *parts, "coherence"])
    response = a * np.exp(1j * np.radians(b)) if polar else a + 1j * b
    if not np.all((coherence > 0) & (coherence < 1)):
        raise InputError(f"{file}: coherence: expected 0 < coherence < 1")
    if polar and not np.all(a > 0):
        raise InputError(f"{file}: magnitude: expected values above 0")
    if not np.all((abs(a) < 1e30) & (abs(b) < 1e30)):
        raise InputError(f"{file}: {parts[0]}, {parts[1]}: expected values below 1e30")
    variance = (1 - coherence) / coherence * abs(response) ** 2 / (averages - 1)
    return measure.Measurement(
        *(f, response, coherence, variance, np.zeros(len(f)), averages - 1, averages),
        input="drive.command",
        output="",
        unit="",
        dt=linear.TICK_S,
        inject="volts",
        model="",
        overrides={},
    )


def starts_of(texts, measured):
    """NAME or NAME=START texts as {name: start}, by default what the model says; {name: unit}."""
    known = linear.facts(measured.model, measured.overrides)["parameters"]
    starts = {}
    for text in texts:
        name, given, value = text.partition("=")
        if name not in known:
            raise InputError(
                f"--fit: {name}: expected a parameter that the model uses, one of "
                + ", ".join(sorted(known))
            )
        if name in starts:
            raise InputError(f"--fit: {name}: expected each name once")
        try:
            starts[name] = float(value) if given else known[name][0]
        except ValueError:
            raise InputError(f"--fit: {text}: expected NAME or NAME=START, a number") from None
    return starts, {name: known[name][1] for name in starts}


def summarise(found, measured, units):
    """What `--json` prints of a Fit."""
    rows = {}
    for name, start, value, *halves in zip(
        *(found.names, found.starts, found.values, found.single, found.joint), strict=True
    ):
        ends = [[float(value * math.exp(s * half)) for s in (-1, 1)] for half in halves]
        rows[name] = {
            "value": float(value),
            "unit": units[name],
            "start": float(start),
            "interval": ends[0],
            "joint_interval": ends[1],
        }
    return {
        "model": paths.display(measured.model),
        "input": measured.input,
        "output": measured.output,
        "points": found.points,
        "parameters": rows,
        "correlation": found.correlation.tolist(),
        "chi_square": found.chi_square,
        "dof": found.dof,
        "p_value": found.p_value,
        "warnings": list(found.warnings),
        "set": " ".join(
            f"--set {name}={value:.6g}"
            for name, value in zip(found.names, found.values, strict=True)
        ),
    }


def describe(summary):
    """The summary of a fit for a terminal."""
    lines = [
        f"model        {summary['model']}, {summary['input']} to {summary['output']}",
        f"fit          chi-square {summary['chi_square']:.4g}, {summary['dof']} degrees of "
        f"freedom, p = {summary['p_value']:.2g}, {summary['points']} frequencies",
        f"{'':12} {'value':>11} {'95 % interval':>25} {'all at once':>25} {'start':>11}",
    ]
    for name, row in summary["parameters"].items():
        spans = [
            " .. ".join(f"{end:.5g}" for end in row[k]) for k in ("interval", "joint_interval")
        ]
        lines.append(
            f"{name:12} {row['value']:>11.5g} {spans[0]:>25} {spans[1]:>25} {row['start']:>11.5g} "
            f"{row['unit']}".rstrip()
        )
    lines += [f"warning      {text}" for text in summary["warnings"]]
    lines.append(f"use          {summary['set']}")
    return "\n".join(lines)


def write(found, measured, summary, out):
    """Write result.json and plot.png, the measured response beside the model before and after."""
    from forceaxis import plots

    figure = plot(found, measured, plots.plt)
    with paths.replacing(out, "plot.png", "result.json") as (picture, result):
        figure.savefig(picture, dpi=120, format="png")
        result.write_text(json.dumps(summary, indent=2) + "\n")


def plot(found, measured, plt):
    """Figure: amplitude and phase, measured with 95 % band, from the start and fitted."""
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7.2, 5.2), height_ratios=(3, 2))
    f, size = measured.frequency_hz, abs(measured.response)
    band = measured.radius()
    # A point of which nothing is known shall not stretch the axis.
    low, high = np.maximum(size - band, size.min() / 2), np.minimum(size + band, size.max() * 2)
    axes[0].fill_between(f, low, high, color="0.8", label="95 % band")
    rows = [(measured.response, {"color": "black", "marker": ".", "linestyle": ""}, "measured")]
    for values, style, label in (
        (found.starts, {"color": "C1", "linestyle": "--"}, "start"),
        (found.values, {"color": "C0", "linestyle": "-"}, "fitted"),
    ):
        fitted = dict(zip(found.names, values.tolist(), strict=True))
        rows.append((measured.predict(fitted), style, label))
    for response, style, label in rows:
        axes[0].loglog(f, abs(response), **style, label=label)
        degrees = np.degrees(np.angle(response))
        if style.get("linestyle"):  # a gap where it turns from -180 to 180 degrees
            degrees = np.where(abs(np.diff(degrees, prepend=degrees[0])) > 180, np.nan, degrees)
        axes[1].semilogx(f, degrees, **style)
    axes[0].set_ylabel(
        f"{measured.output} / {measured.input}" + (f", {measured.unit}" if measured.unit else ""),
        parse_math=False,
    )
    axes[0].legend()
    axes[1].set(ylim=(-190, 190), yticks=range(-180, 181, 90))
    axes[1].set_ylabel("phase, degrees")
    axes[1].set_xlabel("frequency, Hz")
    for axis in axes:
        axis.grid(alpha=0.3, which="both")
    figure.tight_layout()
    return figure
