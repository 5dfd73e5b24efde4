"""Resonance model of thesis section 4.2: the response of a rigid body, multiplied by resonances.

    R_i(s) = (w_p / w_z)^2 (s^2 + 2 zeta_z w_z s + w_z^2) / (s^2 + 2 zeta_p w_p s + w_p^2)

The thesis fits this model to data by eye in five steps, beginning with the lowest resonance. The
function `fit` performs these steps numerically.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, signal

from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.identify.measurement import Complexes, Reals
from forceaxis.linear.beam import Factored
from forceaxis.linear.plant_facts import Overrides

# Range of damping ratios of peaks and troughs in the fit of resonances.
# With a smaller damping ratio, a peak is narrower than the spacing of the measured frequencies.
# With a larger damping ratio, the response has no peak.
DAMPING_RATIOS = (1e-5, 1.0)
# Largest ratio of the fitted frequency of a resonance to the frequency of its peak in the data.
FREQUENCY_RATIO = 1.3


@dataclass(frozen=True)
class Resonance:
    """One resonance R_i, a factor of the resonance model. It has a peak, and possibly a trough. R_i
    is 1 at low frequency."""

    peak_hz: float  #: frequency of the poles in Hz, > 0
    peak_damping: float  #: damping ratio of the poles
    trough_hz: float | None = None  #: frequency of the zeros in Hz; None if there is no trough
    trough_damping: float | None = None  #: damping ratio of the zeros

    @property
    def trough(self) -> tuple[float, float] | None:
        """Frequency in Hz and damping ratio of the trough. None if the resonance has no trough."""
        if self.trough_hz is None or self.trough_damping is None:
            return None
        return self.trough_hz, self.trough_damping

    def at(self, s: ArrayLike) -> Complexes:
        """Returns the values of the resonance R_i at complex s in 1/s, in the shape of s."""
        s = np.asarray(s, complex)
        value: Complexes = 1 / _pair(s, self.peak_hz, self.peak_damping)
        return value * _pair(s, *self.trough) if self.trough else value


def _pair(s: ArrayLike, hz: Reals | float, zeta: Reals | float) -> Complexes:
    x = np.asarray(s, complex) / (2 * np.pi * hz)
    return np.asarray(x * x + 2 * zeta * x + 1)


@dataclass(frozen=True)
class Fit:
    """Result of the fit of a resonance model to data: the resonances, and the errors of the model
    at the frequencies of the data."""

    resonances: tuple[Resonance, ...]  #: resonances, the lowest first
    rms_db: float  #: rms error of the magnitude in dB
    max_db: float  #: largest error of the magnitude in dB
    #: rms error of the phase in degrees, or None if the responses are not complex.
    #: The error of the phase is small if the data belong to a minimum-phase system.
    phase_error_deg: float | None

    def cascade(self) -> Factored:
        """The product of all resonances R_i as an object of the class Factored, with zeros and
        poles in 1/s and a gain."""
        poles = [(r.peak_hz, r.peak_damping) for r in self.resonances]
        zeros = [r.trough for r in self.resonances if r.trough]
        return Factored(_roots(zeros), _roots(poles), 1.0)

    def response(self, frequency_hz: ArrayLike, rigid_response: ArrayLike) -> Complexes:
        """Returns the response of the model as complex values (n,), in the unit of
        `rigid_response`. It is the rigid-body response (n,) multiplied by all R_i at the
        frequencies (n,) in Hz."""
        return np.asarray(np.asarray(rigid_response) * self.cascade().response(frequency_hz))


def _roots(pairs: list[tuple[float, float]]) -> Complexes:
    """Returns the two roots in 1/s of each pair (frequency in Hz, damping ratio) of a second-order
    factor."""
    roots = []
    for hz, zeta in pairs:
        offset = np.sqrt(complex(zeta * zeta - 1))
        roots += [2 * np.pi * hz * (-zeta + offset), 2 * np.pi * hz * (-zeta - offset)]
    return np.array(roots, complex)


def fit(
    frequency_hz: ArrayLike,
    response: ArrayLike,
    rigid_response: ArrayLike,
    modes: int = 5,
    prominence_db: float = 1.0,
    refine: bool = False,
) -> Fit:
    """Fits a product of at most `modes` resonances to a measured or simulated response.

    frequency_hz (n,): at least 10 rising frequencies > 0. response, rigid_response (n,): complex
    values or magnitudes that are not 0, both in one unit. Only the magnitudes are fitted. The five
    steps are:

    1. The quotient |response| / |rigid_response| in dB is computed. It is not smoothed. Average
       noisy data before the call.
    2. The peaks of the quotient with a prominence of at least `prominence_db` are found. The
       `modes` most prominent peaks are used.
    3. Each peak is assigned the nearest trough on a logarithmic scale. The peak of a mode that is
       not collocated may have no trough.
    4. The damping ratios are adjusted until the model has the height of each peak and the depth of
       each trough.
    5. The frequencies are adjusted until the peaks and troughs of the model are at the frequencies
       of the data. Steps 4 and 5 are repeated 60 times, and the best result is returned.

    With `refine`, the squared error in dB over all frequencies and damping ratios is then minimised
    at once. This finds the exact parameters of data that have the form of the model. With a wrong
    rigid-body response, however, it distorts the resonances, and the five steps alone are better. A
    resonance that only changes the slope of the quotient is not found.

    Raises InputError for data that cannot be fitted, and if there is no peak.
    """
    f, data, rigid = _checked(frequency_hz, response, rigid_response)
    target = 20 * np.log10(np.abs(data) / np.abs(rigid))
    peaks, troughs = _extremes(f, target, modes, prominence_db)
    if not peaks:
        raise InputError(
            f"response: expected at least one peak with a prominence of {prominence_db} dB or "
            "more, got none; lower `prominence_db` or give more frequencies"
        )
    found = _match(f, target, peaks, troughs)
    if refine:
        found = _least_squares(f, target, found)
    model = np.ones(len(f), complex)
    for r in found:
        model = model * r.at(2j * np.pi * f)
    error = 20 * np.log10(np.abs(model)) - target
    phase = None
    if np.iscomplexobj(response) and np.iscomplexobj(rigid_response):
        turn = np.angle(rigid * model / data, deg=True)
        phase = float(np.sqrt(np.mean(turn**2)))
    return Fit(
        tuple(found),
        float(np.sqrt(np.mean(error**2))),
        float(np.abs(error).max()),
        phase,
    )


def _checked(
    frequency_hz: ArrayLike, response: ArrayLike, rigid_response: ArrayLike
) -> tuple[Reals, Complexes, Complexes]:
    """Checks the arguments of fit() and returns them as arrays. Raises InputError for data that
    cannot be fitted."""
    f = np.asarray(frequency_hz, float)
    data, rigid = (np.asarray(x, complex) for x in (response, rigid_response))
    if f.ndim != 1 or data.shape != f.shape or rigid.shape != f.shape:
        raise InputError(
            "response: expected arrays of equal length for response, rigid-body response and "
            f"frequency, got the lengths {data.size}, {rigid.size} and {f.size}"
        )
    if len(f) < 10:
        raise InputError(f"frequency_hz: expected at least 10 frequencies, got {len(f)}")
    if not (np.all(f > 0) and np.all(np.diff(f) > 0)):
        raise InputError(
            "frequency_hz: expected frequencies above 0, each larger than the frequency before"
        )
    for name, values in (("response", data), ("rigid_response", rigid)):
        if not (np.isfinite(values).all() and np.all(np.abs(values) > 0)):
            raise InputError(f"{name}: expected an array of finite values that are not 0")
    return f, data, rigid


def _extremes(
    f: Reals, target: Reals, modes: int, prominence_db: float
) -> tuple[list[float], list[float | None]]:
    """Returns (peaks, troughs): the frequencies of the most prominent peaks, and for each peak the
    frequency of its trough, or None."""

    def at_top(i: int, values: Reals) -> float:
        # The extreme value of the data is at the vertex of the parabola through three points.
        # The parabola is a function of the logarithm of the frequency.
        x, y = np.log(f[i - 1 : i + 2]), values[i - 1 : i + 2]
        second, slope, _ = np.polyfit(x - x[1], y - y[1], 2)
        return float(np.exp(np.clip(x[1] - slope / (2 * second), x[0], x[2]))) if second else f[i]

    found, _ = signal.find_peaks(target, prominence=prominence_db)
    troughs, _ = signal.find_peaks(-target, prominence=prominence_db)
    peaks = [at_top(i, target) for i in found]
    # Troughs are assigned to all peaks first. Weaker peaks are then removed with their troughs.
    pairs = _pair_up(peaks, [at_top(i, -target) for i in troughs])
    strongest = np.sort(np.argsort(signal.peak_prominences(target, found)[0])[::-1][:modes])
    return [peaks[i] for i in strongest], [pairs[i] for i in strongest]


def _pair_up(peaks: list[float], troughs: list[float]) -> list[float | None]:
    """Assigns the troughs to the peaks. Returns the frequency of the trough of each peak, or None.
    The sum of the distances from peaks to troughs is the smallest one. No peak is between another
    peak and its trough."""
    if not troughs:
        return [None] * len(peaks)
    distance = np.abs(np.log(np.array(peaks)[:, None] / np.array(troughs)))
    between = np.array(
        [[any(min(p, t) < q < max(p, t) for q in peaks) for t in troughs] for p in peaks]
    )
    rows, columns = optimize.linear_sum_assignment(np.where(between, 1e3, distance))
    pairs: list[float | None] = [None] * len(peaks)
    for row, column in zip(rows, columns, strict=True):
        if not between[row, column]:
            pairs[row] = troughs[column]
    return pairs


def _match(
    f: Reals, target: Reals, peaks: list[float], troughs: list[float | None]
) -> list[Resonance]:
    """Adjusts the frequency and damping ratio of each peak and trough in turn, until the peaks and
    troughs of the model agree with the data. These are steps 4 and 5 of fit().

    Each adjustment shifts the neighbouring peaks and troughs, so all adjustments are repeated.
    """
    marks = [(hz, 1) for hz in peaks] + [(hz, -1) for hz in troughs if hz is not None]
    hz = np.array([mark[0] for mark in marks])
    sign = np.array([mark[1] for mark in marks])
    level = np.interp(np.log(hz), np.log(f), target)
    pairs = np.column_stack(
        [hz, np.full(len(hz), 0.05)]
    )  # start value of the damping ratio of a peak, which is typical in the thesis
    around = np.geomspace(0.8, 1.25, 181)

    def model_db(at: Reals) -> Reals:
        values = np.array([_pair(2j * np.pi * at, *pair) for pair in pairs])
        return np.asarray(20 * np.log10(np.abs(values)).T @ -sign)

    best, best_error = pairs, np.inf
    for _ in range(60):
        error = float(np.mean((model_db(f) - target) ** 2))
        if error < best_error:
            best, best_error = pairs.copy(), error
        for i, (mark, s) in enumerate(zip(hz, sign, strict=True)):
            near = model_db(mark * around) * s
            tops = signal.find_peaks(near)[0]
            if len(tops):
                top = around[tops[np.argmin(np.abs(np.log(around[tops])))]]
                moved = pairs[i, 0] / np.sqrt(top)
                pairs[i, 0] = np.clip(moved, mark / FREQUENCY_RATIO, mark * FREQUENCY_RATIO)
            # The size of a peak or trough in dB depends on its damping ratio.
            over = (model_db(np.array([mark]))[0] - level[i]) * s
            pairs[i, 1] = np.clip(pairs[i, 1] * 10 ** (over / 40), *DAMPING_RATIOS)
    return _resonances(best, troughs)


def _resonances(pairs: Reals, troughs: Sequence[float | None]) -> list[Resonance]:
    """Returns the resonances of the model. The rows of `pairs` are (frequency in Hz, damping
    ratio): first for all peaks, and then for all troughs that are not None."""
    present = iter(pairs[len(troughs) :])
    return [
        Resonance(*map(float, peak), *(map(float, next(present)) if trough is not None else ()))
        for peak, trough in zip(pairs, troughs, strict=False)
    ]


def _least_squares(f: Reals, target: Reals, start: list[Resonance]) -> list[Resonance]:
    """Returns the resonances with the smallest sum of squared errors in dB. The search is over the
    logarithms of all frequencies and damping ratios."""
    pairs = [(r.peak_hz, r.peak_damping) for r in start]
    pairs += [r.trough for r in start if r.trough]
    signs = np.array([-1] * len(start) + [1] * (len(pairs) - len(start)))
    x = 2j * np.pi * f[:, None]

    def error(logarithms: Reals) -> Reals:
        hz, zeta = np.exp(logarithms.reshape(-1, 2)).T
        found = (20 * np.log10(np.abs(_pair(x, hz, zeta))) * signs).sum(axis=1)
        return np.asarray(found - target)

    guess = np.log(np.array(pairs))
    low, high = guess.copy(), guess.copy()
    low[:, 0] -= np.log(FREQUENCY_RATIO)
    high[:, 0] += np.log(FREQUENCY_RATIO)
    low[:, 1], high[:, 1] = np.log(DAMPING_RATIOS)
    guess[:, 1] = np.clip(guess[:, 1], low[:, 1] + 1e-6, high[:, 1] - 1e-6)
    done = optimize.least_squares(error, guess.ravel(), bounds=(low.ravel(), high.ravel()))
    return _resonances(np.exp(done.x.reshape(-1, 2)), [r.trough_hz for r in start])


@dataclass(frozen=True)
class ResonanceResult(Fit):
    """The result of a fit of resonances to a measured response. It also has the zeros and poles in
    1/s of the product of all resonances, each as (real part, imaginary part)."""

    zeros: tuple[tuple[float, float], ...]
    poles: tuple[tuple[float, float], ...]


def of_measurement(
    model: str,
    response: str,
    rigid: str,
    overrides: Overrides,
    modes: int,
    prominence_db: float,
    refine: bool,
) -> ResonanceResult:
    """Fits resonances to a measured response.

    model: path or name of a model of the rigid body. response: folder of a measurement. rigid:
    signal of the model for the response of the rigid structure. overrides: {parameter of the model:
    value}. modes, prominence_db, refine: see fit(). Raises InputError.
    """
    from forceaxis.identify import fit as fit_response

    if not 0 < prominence_db < 200:
        raise ParameterError("prominence_db", f"expected 0 to 200 dB, got {prominence_db:g} dB")
    data = fit_response.read_response(response, model)
    body = replace(data, output=rigid, free=True, overrides=overrides)
    found = fit(data.frequency_hz, data.response, body.predict(), modes, prominence_db, refine)
    zeros, poles, _ = found.cascade().zpk()
    return ResonanceResult(
        **vars(found),
        zeros=tuple((z.real, z.imag) for z in zeros),
        poles=tuple((p.real, p.imag) for p in poles),
    )
