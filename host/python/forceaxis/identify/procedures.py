"""Identifies parameters of an axis from recordings. Each parameter has a 95 % confidence interval.

These are the procedures of the thesis (sections 4.1.2, 4.4, 5.2.1) for the values in its Figures
4.4 and 4.26. The module `fit` instead fits parameters of a model to a frequency response.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal

from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.identify.columns import header_of, read_columns
from forceaxis.identify.distributions import t_bound
from forceaxis.identify.measurement import CONFIDENCE, Reals

LEAST_CYCLES = 3  # smallest number of periods of a ring-down (a decaying free vibration)
# Smallest number of samples of a ring-down. With fewer samples, noise may resemble a ring-down.
LEAST_SAMPLES = 30
# Start values, in the fit of a ring-down, of the ratio of decay rate to angular frequency.
START_RATIOS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
# Amplitude at which the evaluation of a ring-down begins, relative to its largest amplitude.
START_SHARE = 0.9
# Smallest fraction of the variance of a recording that the fitted ring-down has to explain.
LEAST_EXPLAINED = 0.5
# Ratio of noise density near the vibration to density of white noise that causes a warning.
WARNED_NOISE_RATIO = 4


@dataclass(frozen=True)
class Estimate:
    """An estimated value and the half width of its 95 % confidence interval, both in `unit`."""

    value: float
    half: float
    unit: str = ""

    def with_interval(self) -> "EstimateWithInterval":
        """Returns the estimate in the form of the JSON output, which has the ends of the
        interval."""
        low, high = finite(self.value - self.half), finite(self.value + self.half)
        return EstimateWithInterval(finite(self.value), (low, high), self.unit)

    def __str__(self) -> str:
        return f"{self.value:.5g} +-{self.half:.2g} {self.unit}".rstrip()


@dataclass(frozen=True)
class EstimateWithInterval:
    """A value in `unit`, and the two ends of its 95 % confidence interval. None stands for a number
    that is not finite."""

    value: float | None
    interval: tuple[float | None, float | None]
    unit: str


def finite(number: float) -> float | None:
    """Returns `number`, or None if it is not finite, because JSON has no infinite numbers."""
    return float(number) if math.isfinite(number) else None


def propagate(function: Callable[..., float], *estimates: Estimate, unit: str = "") -> Estimate:
    """Returns the estimate of a function of several independent estimates. The square of its half
    width is the sum of the squared contributions of these estimates. `unit`: unit of the
    function."""
    values = [e.value for e in estimates]
    square = 0.0
    for i, e in enumerate(estimates):
        ends = [function(*values[:i], e.value + d, *values[i + 1 :]) for d in (-e.half, e.half)]
        square += ((ends[1] - ends[0]) / 2) ** 2
    return Estimate(function(*values), math.sqrt(square), unit)


def regression(
    columns: Reals, values: Reals, weights: Reals | None = None
) -> list[tuple[float, float]]:
    """Linear least-squares fit of `values` (n,) by the columns of `columns` (n, p). `weights` (n,):
    1 / standard deviation of each value.

    Returns [(coefficient, half width of its 95 % interval)]. The half widths follow from the
    residuals, by Student's distribution with n - p degrees of freedom.
    """
    weights = np.ones(len(values)) if weights is None else weights
    A, y = columns * weights[:, None], values * weights
    coefficients = np.linalg.lstsq(A, y)[0]
    dof = len(y) - A.shape[1]
    variance = np.sum((y - A @ coefficients) ** 2) / dof
    spread = np.sqrt(variance * np.diag(np.linalg.inv(A.T @ A)))
    return list(zip(coefficients, t_bound((1 + CONFIDENCE) / 2, dof) * spread, strict=True))


@dataclass(frozen=True)
class RingDown:
    """Parameters of a mode of vibration from a recorded free vibration."""

    cycles: int  #: number of periods of the vibration that were evaluated
    damped_frequency: Estimate  #: frequency 1 / period of the vibration, in Hz
    natural_frequency: Estimate  #: frequency of the mode without damping, in Hz
    decrement: Estimate  #: logarithm of the ratio of two amplitudes one period apart
    damping_ratio: Estimate  #: damping ratio by the formula of the thesis, decrement / (2 pi)
    #: exact damping ratio: decrement / sqrt(4 pi^2 + decrement^2)
    damping_ratio_exact: Estimate
    #: ln(first amplitude / last amplitude), divided by the number of periods between them
    decrement_of_ratio: float
    explained: float  #: share of the variance of the recording that the fit explains, 0..1
    noise: float  #: standard deviation of the residual, in the unit of the signal
    warnings: tuple[str, ...]


def damped_sine(time_s: Reals, rate: float, omega: float) -> Reals:
    """Returns the columns (n, 4) of a regression: cosine and sine with the envelope e^(-rate t), an
    offset, and a drift. `rate`: in 1/s. `omega`: in rad/s."""
    envelope, ones = np.exp(-rate * time_s), np.ones(len(time_s))
    return np.stack(
        [envelope * np.cos(omega * time_s), envelope * np.sin(omega * time_s), ones, time_s], 1
    )


def fit_damped_sine(
    time: Reals, values: Reals, starts: Sequence[tuple[float, float]]
) -> optimize.OptimizeResult:
    """Fits a damped sine to `values` (n,) at the times `time` (n,), which begin at 0, by least
    squares. Returns the result of SciPy, whose x contains rate (1/s), omega (rad/s) and 4
    coefficients.

    starts: start values (rate, omega). The best of them is used.
    """

    def linear_part(start: tuple[float, float]) -> tuple[float, list[float]]:
        columns = damped_sine(time, *start)
        found = np.linalg.lstsq(columns, values)[0]
        return float(np.sum((columns @ found - values) ** 2)), [*start, *found]

    def residual(x: Reals) -> Reals:
        return damped_sine(time, x[0], x[1]) @ x[2:] - values

    def jacobian(x: Reals) -> Reals:
        columns = damped_sine(time, x[0], x[1])
        cosine, sine = columns[:, 0], columns[:, 1]
        along = -time * (x[2] * cosine + x[3] * sine)
        across = time * (x[3] * cosine - x[2] * sine)
        return np.column_stack([along, across, columns])

    start = min(map(linear_part, starts), key=lambda pair: pair[0])[1]
    return optimize.least_squares(
        residual, start, jacobian, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12
    )


def cycle_amplitudes(time: Reals, values: Reals, omega: float, starts: Reals) -> Reals:
    """Returns the amplitudes of the periods that begin at the times `starts` in s. An amplitude is
    the magnitude of the Fourier coefficient at `omega` (in rad/s) over one period."""
    turning = values * np.exp(-1j * omega * time)
    steps = np.diff(time) * (turning[1:] + turning[:-1]) / 2
    total = np.concatenate([[0], np.cumsum(steps)])
    period = 2 * math.pi / omega
    ends = [np.interp(starts + d, time, total) for d in (0.0, period)]
    return np.asarray(abs(ends[1] - ends[0]) * 2 / period)


def likely_frequencies(time: Reals, values: Reals) -> Reals:
    """Returns the angular frequencies in rad/s of the three highest peaks of the spectrum. The
    times need not be equally spaced."""
    even = np.linspace(time[0], time[-1], len(time))
    bent = signal.detrend(np.interp(even, time, values))
    size = abs(np.fft.rfft(bent, 2 * len(even)))
    peaks, _ = signal.find_peaks(size)
    highest = peaks[np.argsort(size[peaks])[::-1][:3]]
    return np.asarray(np.pi * highest / len(even) / (even[1] - even[0]))


def ring_down(
    time_s: Reals, values: Reals, floor: float = 0.05, where: Path | str = "ring-down"
) -> RingDown:
    """Returns the frequency and the logarithmic decrement of a free vibration. The recording may
    have any offset and a slow drift.

    time_s (n,): rising times. values (n,): values in any unit. where: name of the recording in
    errors. A damped sine is fitted to the recording, from the largest amplitude down to the
    fraction `floor` (0 to 1) of this amplitude.

    The confidence intervals are those of least squares with white noise. If the noise density near
    the frequency of the vibration is larger, for example because of another mode, the intervals
    follow from this density. They include at least twice the variance of the rounding by a
    converter. The result also contains the decrement from the amplitudes of the first and the last
    period, as one reads it from a plot. Raises InputError for fewer than 3 periods, and for a
    recording that one damped sine does not explain.
    """
    _expect_samples(time_s, where)
    frequencies, unit = likely_frequencies(time_s, values), float(np.std(values))
    if unit == 0 or not len(frequencies):
        raise too_short(where, 0, floor)

    def fitted(
        inside: NDArray[np.bool_], omegas: Sequence[float] | Reals, rates: Sequence[float]
    ) -> tuple[Reals, optimize.OptimizeResult]:
        time = time_s[inside] - time_s[inside][0]
        starts = [(rate * omega, omega) for omega in omegas for rate in rates]
        return time, fit_damped_sine(time, (values[inside] - values.mean()) / unit, starts)

    first = _start_of_decay(time_s, values, frequencies[0])
    inside = time_s >= first
    if inside.sum() < LEAST_SAMPLES:
        raise too_short(where, (time_s[-1] - first) * frequencies[0] / (2 * math.pi), floor)
    time, found = fitted(inside, frequencies, START_RATIOS)
    rate, omega = found.x[:2]
    if rate * time[-1] > -math.log(floor):
        inside &= time_s <= first - math.log(floor) / rate
        if inside.sum() < LEAST_SAMPLES:
            raise too_short(where, -math.log(floor) / rate * omega / (2 * math.pi), floor)
        time, found = fitted(inside, [omega], [rate / omega])
        rate, omega = found.x[:2]

    residuals, n, p = found.fun, inside.sum(), len(found.x)
    spread = np.sum((values[inside] - values[inside].mean()) ** 2) / unit**2
    explained = 1 - (np.sum(residuals**2) / (n - p)) / (spread / (n - 1))
    if not explained >= LEAST_EXPLAINED or not 0 < omega < math.pi * (n - 1) / time[-1]:
        raise InputError(
            f"{where}: expected a record of one decaying vibration, but the best fit explains "
            f"only {100 * max(explained, 0):.3g} % of the record; select a section of the record "
            "by `from_s` and `to_s`, filter the record, or strike the structure harder"
        )
    cycles = int(time[-1] * omega / (2 * math.pi) + 0.01)
    if cycles < LEAST_CYCLES:
        raise too_short(where, cycles, floor)

    white, local, rounding, coloured = noise_of(
        residuals, n - p, omega * time[-1], values[inside], unit
    )
    covariance = np.linalg.inv(found.jac.T @ found.jac)[:2, :2] * max(white, local, rounding)
    t = t_bound((1 + CONFIDENCE) / 2, n - p)

    def estimate(value: float, gradient: Reals, unit: str = "") -> Estimate:
        return Estimate(float(value), float(t * math.sqrt(gradient @ covariance @ gradient)), unit)

    turn, size = 2 * math.pi, math.hypot(rate, omega)
    by_cycle = np.array([1 / omega, -rate / omega**2])  # gradient of rate / omega
    decrement = estimate(turn * rate / omega, turn * by_cycle)
    if decrement.value + 3 * decrement.half < -1e-6:
        raise InputError(
            f"{where}: expected a decaying vibration, got a growing vibration with the decrement "
            f"{decrement}; select a part of the record by `from_s` and `to_s`"
        )
    offset = damped_sine(time, rate, omega)[:, 2:] @ found.x[4:] * unit + values.mean()
    ends = np.array([0.0, (cycles - 1) * turn / omega])
    ratio = cycle_amplitudes(time, values[inside] - offset, omega, ends)
    warnings = []
    if coloured and explained < 1 - 1e-12:
        warnings.append(
            "the residual of the fit is not white noise, because of another mode or a "
            "nonlinearity; the intervals treat the residual as noise"
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


def _expect_samples(time_s: Reals, where: Path | str) -> None:
    """Raises InputError if the times do not rise, or if there are too few samples."""
    if len(time_s) < 2 or np.any(np.diff(time_s) <= 0):
        raise InputError(
            f"{where}: time_s: expected at least two times in s, each larger than the time before"
        )
    if len(time_s) < LEAST_SAMPLES:
        raise InputError(
            f"{where}: expected at least {LEAST_SAMPLES} samples, got {len(time_s)}; record longer"
        )


def _start_of_decay(time_s: Reals, values: Reals, omega: float) -> float:
    """Returns the time in s at which the evaluation of a free vibration begins: the time of its
    largest amplitude.

    If the recording begins before the largest amplitude, the result is a quarter of a period later,
    because the excitation may last half a period.
    """
    period = 2 * math.pi / omega
    begins = time_s[time_s <= max(time_s[-1] - period, time_s[0])]
    amplitude = cycle_amplitudes(time_s, signal.detrend(values), omega, begins)
    first = begins[np.flatnonzero(amplitude >= START_SHARE * amplitude.max())[0]]
    return float(min(first + period / 4, time_s[-1] - period) if first > time_s[0] else first)


def noise_of(
    residuals: Reals, freedom: float, turned: float, values: Reals, unit: float
) -> tuple[float, float, float, bool]:
    """Returns three variances of a sample of a free vibration, and a flag. The variances belong to
    white noise, to noise near the frequency of the vibration, and to rounding.

    The flag is True if the second variance is clearly larger than the first.

    residuals (n,): residuals of the fit, without unit. freedom: degrees of freedom of the
    residuals. turned: phase in rad by which the vibration advances over the recording. values: the
    recording. unit: divisor that made the values dimensionless.
    """
    n = len(residuals)
    white = float(np.sum(residuals**2) / freedom)
    lines = abs(np.fft.rfft(residuals)) ** 2 / n
    here = turned / (2 * math.pi)
    near = lines[max(1, round(here / 2)) : round(2 * here) + 1]
    # The four parameters of the vibration that were fitted reduce the degrees of freedom.
    local = float(near.sum() / max(len(near) - 2, 1))
    # Rounding without noise causes errors of the amplitude that do not appear in the residuals.
    # Twice the variance of rounding, step^2 / 12, covers these errors of the amplitude.
    levels = np.unique(values)
    rounding = (np.diff(levels).min() / unit) ** 2 / 6 if len(levels) < n / 4 else 0.0
    return white, local, rounding, local > WARNED_NOISE_RATIO * white and len(near) > 4


def too_short(where: Path | str, cycles: float, floor: float) -> InputError:
    """Returns the InputError for a recording of a free vibration with too few periods."""
    return InputError(
        f"{where}: expected a decaying vibration of at least {LEAST_CYCLES} cycles, got "
        f"{int(cycles)}; record longer, strike harder, or set `floor` below {floor:g}"
    )


@dataclass(frozen=True)
class ModeParameters:
    """Mass, stiffness and damping of one mode."""

    mass: Estimate  #: mass of the mode in kg
    stiffness: Estimate  #: stiffness of the mode in N/m
    damping: Estimate  #: damping of the mode in N s/m


def mode_parameters(
    frequency_hz: Estimate,
    damping_ratio: Estimate,
    mass: Estimate | None = None,
    stiffness: Estimate | None = None,
) -> ModeParameters:
    """Returns mass (kg), stiffness (N/m) and damping (N s/m) of a mode of vibration. They follow
    from the frequency and damping ratio of the mode, and from either its mass or its stiffness.

    `frequency_hz`: natural frequency. `damping_ratio`: exact damping ratio. k = m w^2, b = 2 zeta
    sqrt(k m) (4.4.3 to 4.4.6).
    """
    if mass is not None and stiffness is None:
        stiffness = propagate(
            lambda f, m: m * (2 * math.pi * f) ** 2, frequency_hz, mass, unit="N/m"
        )
        damping = propagate(
            lambda f, z, m: 4 * math.pi * f * z * m,
            *(frequency_hz, damping_ratio, mass),
            unit="N s/m",
        )
    elif stiffness is not None and mass is None:
        mass = propagate(
            lambda f, k: k / (2 * math.pi * f) ** 2, frequency_hz, stiffness, unit="kg"
        )
        damping = propagate(
            lambda f, z, k: z * k / (math.pi * f),
            *(frequency_hz, damping_ratio, stiffness),
            unit="N s/m",
        )
    else:
        raise ValueError("expected either mass or stiffness")
    return ModeParameters(replace(mass, unit="kg"), replace(stiffness, unit="N/m"), damping)


@dataclass(frozen=True)
class Split:
    """Masses in kg of the two bodies that a spring connects."""

    #: both solutions ((m_r1, m_r2), (m_r1, m_r2)); the chosen solution is the first
    solutions: tuple[tuple[Estimate, Estimate], tuple[Estimate, Estimate]]
    locked: tuple[
        Estimate, Estimate
    ]  #: (m_r1, m_r2) if the frequency was measured with m_r1 locked to ground
    locked_frequency_hz: float  #: frequency at which the chosen m_r2 vibrates while m_r1 is locked


def split(total_mass: Estimate, stiffness: Estimate, frequency_hz: Estimate) -> Split:
    """Returns the two masses m_r1 and m_r2 at the ends of a spring, from m_r1 + m_r2 = m and w^2 =
    k m / (m_r1 m_r2). m: sum of both masses in kg. k: stiffness in N/m. w / (2 pi): frequency in Hz
    at which both masses vibrate freely.

    As in the thesis, the actuator has more than half of the mass (m_r1 > m_r2) in the first
    solution. Raises InputError if no real masses solve the equations.
    """

    def larger(m: float, k: float, f: float) -> float:
        return (m + math.sqrt(max(m * m - 4 * m * locked(k, f), 0))) / 2

    def smaller(
        m: float,
        k: float,
        f: float,
        # The product of the masses is used: it needs no difference of nearly equal numbers.
    ) -> float:
        return m * locked(k, f) / larger(m, k, f)

    def locked(k: float, f: float) -> float:
        return k / (2 * math.pi * f) ** 2

    m, k, f = total_mass.value, stiffness.value, frequency_hz.value
    lowest = math.sqrt(4 * k / m) / (2 * math.pi)
    if f < lowest:
        raise InputError(
            f"split: frequency: expected at least {lowest:.5g} Hz, which is the frequency of two "
            f"equal masses of {m:g} kg in total on a spring of {k:g} N/m, got {f:g} Hz; check "
            "total mass, stiffness and frequency"
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


def regression_of(
    path: Path | str, x: str, y: str, offset: bool = False, units: tuple[str, str] = ("", "")
) -> list[Estimate]:
    """Fits a straight line to two columns x and y of a CSV file. Returns its estimates: [slope], or
    [slope, offset] with `offset`.

    Raises InputError for fewer than 3 rows (4 with offset), or if x is equal in all rows.
    """
    at, values = read_columns(path, [x, y])
    fewest = 4 if offset else 3
    if len(at) < fewest:
        raise InputError(
            f"{path}: expected a file with at least {fewest} rows, got {len(at)}; measure more "
            "points"
        )
    if not at.any() or (offset and np.ptp(at) == 0):
        contents = "different values" if offset else "values other than 0"
        raise InputError(
            f"{path}: {x}: expected a column with {contents}, got only the value {at[0]:g}; "
            "measure at several speeds"
        )
    columns = np.stack([at, np.ones(len(at))], 1) if offset else at[:, None]
    found = regression(columns, values)
    return [Estimate(*pair, unit) for pair, unit in zip(found, units, strict=False)]


def motor_damping(
    ratio: Estimate,
    k_torque: Estimate,
    k_tach: Estimate,
    k_back_emf: Estimate,
    resistance: Estimate,
    where: Path | str = "motor",
) -> Estimate:
    """Returns the damping b_m of a motor in N m s/rad from the ratio V_tach / V_motor at constant
    speed, which is k_t k_tach / (R b_m + k_b k_t).

    The arguments are Estimates: ratio in V/V, k_torque in N m/A, k_tach and k_back_emf in V s/rad,
    resistance in ohm.
    """
    if ratio.value <= 0:
        raise InputError(
            f"{where}: expected a tachometer voltage that rises with the motor voltage, got a "
            f"slope of {ratio.value:.4g} V/V; check the signs and the names of the columns"
        )
    return propagate(
        lambda r, t, tach, b, R: (t * tach / r - b * t) / R,
        *(ratio, k_torque, k_tach, k_back_emf, resistance),
        unit="N m s/rad",
    )


def decrement(
    path: Path | str,
    column: str | None = None,
    from_s: float = -math.inf,
    to_s: float = math.inf,
    floor: float = 0.05,
    *,
    mass: Estimate | None = None,
    stiffness: Estimate | None = None,
) -> tuple[RingDown, ModeParameters | None]:
    """Evaluates a free vibration in a CSV file with ring_down(), from `from_s` to `to_s` in s. The
    file has the column time_s. For a known mass (kg) or stiffness (N/m), also evaluates
    mode_parameters().

    `column`: column of the signal. It is optional if the file has only one column besides time_s.
    """
    if column is None:
        header = header_of(path)
        others = [name for name in header if name != "time_s"]
        if len(others) != 1 and "time_s" in header:
            raise ParameterError(
                "column", f"expected the name of a column of {path}, one of {', '.join(others)}"
            )
        column = (others or [""])[0]
    time, values = read_columns(path, ["time_s", column])
    inside = (time >= from_s) & (time <= to_s)
    found = ring_down(time[inside], values[inside], floor, path)
    if mass is None and stiffness is None:
        return found, None
    frequency_hz, ratio = found.natural_frequency, found.damping_ratio_exact
    return found, mode_parameters(frequency_hz, ratio, mass, stiffness)
