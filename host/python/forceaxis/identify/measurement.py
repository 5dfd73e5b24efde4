"""A measured frequency response: its error, its characteristic values, and its comparison with a
model."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from forceaxis import linear
from forceaxis.identify.distributions import chi_square_tail, f_bound
from forceaxis.identify.setup import CODES
from forceaxis.linear.equations import Numbers
from forceaxis.results import json_field

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]

# Probability with which each confidence interval or band contains the true value.
CONFIDENCE = 0.95
COHERENT = 0.9  # coherence above which a point of the response counts as coherent
# The magnitude counts as constant in an octave up to this relative spread of its values.
FLAT_SPREAD = 0.1


@dataclass(frozen=True)
class Comparison:
    """Result of the test whether the response of a model agrees with a measured response."""

    points: int  # number of compared frequencies
    coherent: int  # number of points with a coherence above 0.9 (coherent points)
    # fraction of the coherent points that are in the 95 % band; None if no point is coherent
    inside: float | None
    # chi-square statistic of the difference, with 2 degrees of freedom for each point
    statistic: float
    p_value: float  # probability that the chi-square of a correct model is at least as large
    # True if `p_value` is at least 0.05: the model agrees with the measured response
    fits: bool


@dataclass(frozen=True, kw_only=True)
class MeasuredCurve:
    """A measured response from one folder, and its comparison with the model.

    The fields magnitude, phase, radius and coherence are arrays (n,) over `frequency_hz`. `radius`
    is that of the 95 % band, in the unit of the magnitude. The phase is within 180 degrees of the
    phase of the model.
    """

    folder: str
    frequency_hz: Numbers
    magnitude: Numbers
    phase_deg: Numbers
    radius: Numbers
    coherence: Numbers
    comparison: Comparison = json_field(inline=True)


@dataclass(frozen=True)
class PhaseCrossing:
    """A frequency at which the phase of a response crosses 0 or 180 degrees. `phase_deg`: 0 or
    180."""

    frequency_hz: float
    phase_deg: int


@dataclass(frozen=True)
class Readings:
    """Characteristic values of a measured response, from Measurement.readings()."""

    low_gain: float  #: magnitude at the lowest frequency, in the unit of the response
    low_hz: float  #: the lowest frequency in Hz
    plateau: bool  #: True if the magnitude is constant in the first octave
    #: frequency at which the magnitude is 3 dB below `low_gain`; None if `plateau` is False
    corner_hz: float | None
    phase_crossings: list[PhaseCrossing]


@dataclass(frozen=True)
class Measurement:
    """A measured frequency response, output divided by input. Output and input are sampled every
    `dt` seconds.

    The excitation is constant between samples. A simulated signal at sample k is the value just
    after the new excitation acts. The codes of the firmware (adc0, adc1, encoder) are converted
    just before that. Therefore y[k] = C x[k] + D u[k], but y[k] = C x[k] + D u[k-1] for codes. The
    exact model of the measured response is the plant sampled with a zero-order hold, as in
    `predict()`.

    The errors of the n points are independent. The error of `response` at each point has a circular
    complex normal distribution. `variance` is an estimate of the variance of this error from `dof`
    complex residuals. So |response - true|^2 / variance follows F(2, 2 dof). With a window
    function, neighbouring points have common noise, and the noise includes leakage. Confidence
    bands and tests are then conservative.
    """

    frequency_hz: Reals  #: (n,) ascending frequencies, > 0, below 1 / (2 dt)
    response: Complexes  #: (n,) complex response, in `units`
    coherence: Reals  #: (n,) ordinary coherence of input and output, 0..1
    #: (n,) variance of the complex response, E |response - true|^2, in the square of the unit
    variance: Reals
    #: (n,) standard deviation due to quantisation alone, in the unit of the response
    floor: Reals
    #: complex degrees of freedom of `variance`: averages - 1, or fewer if segments overlap
    dof: float
    averages: int
    input: str  #: name of the input: a signal of the model ("drive.command": V), or "dac_code"
    #: name of the output: a signal of the model, "adc0", "adc1" (8-bit counts), "encoder" (counts)
    output: str
    unit: str  #: unit of the response
    dt: float  #: sampling period in s, 1 / (1500 n) with an integer n
    #: excited input: "volts" (plant alone) or "codes" (through the firmware, dt = 1/1500 s)
    inject: str
    model: str  #: path of the model file that was measured
    overrides: linear.Overrides  #: nominal parameters; `predict()` uses them by default
    free: bool = False  #: True if contacts are open
    scale: float = 1.0  #: factor by which the output is multiplied
    #: window function: "none" or "hann"; with "hann", neighbouring frequencies mix
    window: str = "none"
    resolution_hz: float = 0.0  #: distance between spectral lines in Hz, 1 / length of a recording
    band_hz: tuple[float, float] = (0.0, math.inf)  #: lowest and highest excited frequency in Hz
    saturated: float = 0.0  #: share of the samples with an ADC code at an end of the range
    #: {element: {state: share of the measured time}} of elements that switch, such as contacts
    states: dict[str, dict[str, float]] = field(default_factory=dict)
    #: {element: state} for `predict()` except contacts, such as the linear range of an amplifier
    modes: dict[str, str] = field(default_factory=dict)
    #: relative decrease of H1 due to the converter's noise in the input
    input_bias: float = 0.0
    #: period and delay of the encoder's positions in samples, if a bus transmits them.
    #: If a bus transmits them, the input is the command that the drive applies.
    positions: tuple[int, int] = (1, 0)
    #: delay of the commands in samples, if a bus transmits them
    command_delay: int = 0
    #: mean age of a force reading in samples, and width of the range of ages.
    #: The age of readings matters for a sensor with a clock of its own.
    ages: tuple[float, float] = (0.0, 0.0)
    #: order of the sinc filter of that sensor's converter, 0 without a filter.
    #: The period of the samples of this sensor is the width of the range of ages.
    sinc_order: int = 0

    def predict(
        self, overrides: linear.Overrides | None = None, frequency_hz: ArrayLike | None = None
    ) -> Complexes:
        """Returns the complex response (n,) of the linear model between the same two signals, with
        the same sampling.

        overrides: {parameter: value} that replace nominal values. Raises InputError.
        """
        frequency = self.frequency_hz if frequency_hz is None else np.asarray(frequency_hz, float)
        system = sampled(self, {**self.overrides, **(overrides or {})})
        if self.window == "none":
            x, y = self._signals(system, frequency)
            return np.asarray(self.scale * y / x)
        # With a window W, the mean of H1 near a frequency is sum |W|^2 X* Y / sum |W|^2 |X|^2.
        # distance in spectral lines; 1e-9 avoids a division of 0 by 0
        offset = np.arange(-48, 49) / 8 + 1e-9
        near = frequency[:, None] + offset * self.resolution_hz
        weight = (np.sinc(offset) / (1 - offset**2)) ** 2
        weight = weight * ((near >= self.band_hz[0]) & (near <= self.band_hz[1]))
        x, y = self._signals(system, abs(near).ravel())
        x, y = x.reshape(near.shape), y.reshape(near.shape)
        mean = (weight * x.conj() * y).sum(1) / (weight * abs(x) ** 2).sum(1)
        return np.asarray(self.scale * mean)

    def _signals(self, system: linear.System, frequency: Reals) -> Complexes:
        """Returns the linear responses from the excitation to the two measured signals of the
        plant."""
        values: Complexes = system.response(frequency).reshape(len(frequency), 2).T
        late = np.exp(-2j * np.pi * frequency * self.dt) - 1
        for row, name in enumerate((self.input, self.output)):
            # The ADC converts a code before the new excitation of the same tick acts.
            if name in CODES[:3]:
                values[row] += system.D[row, 0] * late
            elif name == "dac_code":
                values[row] = 1.0
        if self.output == "encoder":
            values[1] = (values[1] + self._aliases(system, frequency)) * self._held(frequency)
        if self.output == "adc0" and self.inject == "codes":
            mean, width = self.ages
            mean += self.sinc_order * width / 2
            late = np.exp(-2j * np.pi * frequency * self.dt * mean)
            values[1] *= late * np.sinc(frequency * self.dt * width) ** (1 + self.sinc_order)
        return values

    def _held(self, frequency: Reals) -> Complexes:
        """Returns the response of a position that arrives late, and only once in a period of the
        bus."""
        period, late = self.positions
        back = np.exp(-2j * np.pi * frequency * self.dt)  # shift by one sample, 1/z
        return np.asarray((back[:, None] ** (late + np.arange(period))).mean(1))

    def _aliases(self, system: linear.System, frequency: Reals) -> Complexes:
        """Returns the sum of the aliases in the response of a position that a bus transmits. The
        command is constant for a period, so that it also has lines at the distance k / period,
        whose ratio to that at `frequency` is known. Sampled once in a period, the motion at these
        lines appears at `frequency`."""
        period, _ = self.positions
        step = 1 - np.exp(-2j * np.pi * frequency * self.dt)
        found = np.zeros(len(frequency), complex)
        for k in range(1, period):
            other = frequency + k / (period * self.dt)
            ratio = step / (1 - np.exp(-2j * np.pi * other * self.dt))
            shift = np.exp(-2j * np.pi * k * self.command_delay / period)
            found += ratio * shift * system.response(other)[:, 1, 0]
        return found

    def radius(self, share: float = CONFIDENCE) -> Reals:
        """Returns the radius of the confidence band as an array (n,), in the unit of the response.
        The true response is within this distance with the probability `share`."""
        return np.asarray(np.sqrt(self.variance * f_bound(share, 2, 2 * self.dof)))

    def random_error(self) -> Reals:
        """Returns the relative standard deviation of the magnitude as an array (n,). It follows
        from the coherence: sqrt((1 - coherence) / (2 averages coherence)) (Bendat and Piersol)."""
        shown = np.maximum(self.coherence, 1e-12)
        return np.asarray(np.sqrt((1 - self.coherence) / (2 * (self.dof + 1) * shown)))

    def compare(self, model: Complexes | None = None) -> Comparison:
        """Tests whether the response of a model agrees with the measured response. `model`:
        response (n,) of the model, by default predict().

        The test uses all points together. With F = |response - model|^2 / variance, the sum of
        2 dof log(1 + F / dof) has a chi-square distribution if the model is correct. There are 2
        degrees of freedom for each point. This is Fisher's sum of the logarithms of the p-values of
        the points, and here also the likelihood ratio.
        """
        model = self.predict() if model is None else model
        ratio = abs(self.response - model) ** 2 / self.variance
        statistic = float(np.sum(2 * self.dof * np.log1p(ratio / self.dof)))
        p_value = chi_square_tail(statistic, 2 * len(ratio))
        coherent = self.coherence > COHERENT
        inside = ratio <= f_bound(CONFIDENCE, 2, 2 * self.dof)
        return Comparison(
            points=len(ratio),
            coherent=int(coherent.sum()),
            inside=float(inside[coherent].mean()) if coherent.any() else None,
            statistic=statistic,
            p_value=p_value,
            fits=p_value >= 1 - CONFIDENCE,
        )

    def readings(self) -> Readings:
        """Returns the characteristic values of the response: the gain at the lowest frequency, the
        corner frequency, and the frequencies at which the phase crosses 0 or 180 degrees.

        There is a corner frequency only if the magnitude is constant in the first octave.
        """
        size, frequency = abs(self.response), self.frequency_hz
        octave = size[frequency <= 2 * frequency[0] * (1 + 1e-9)]
        flat = len(octave) > 1 and np.ptp(octave) <= FLAT_SPREAD * octave[0]
        low = float(size[0])
        plateau = float(np.median(octave))
        below = np.flatnonzero(size < plateau / math.sqrt(2)) if flat else np.zeros(0, int)
        corner = None
        if len(below) and below[0] > 0:
            i = below[0]
            span = np.log(size[i - 1 : i + 1])
            part = (span[0] - math.log(plateau / math.sqrt(2))) / (span[0] - span[1])
            corner = float(frequency[i - 1] + part * (frequency[i] - frequency[i - 1]))
        # If noise moves the phase around 0 or 180 degrees, this is not a crossing.
        # A phase crossing needs points on both sides at a clear distance from 0 or 180 degrees.
        clear = np.flatnonzero(abs(self.response.imag) > 2 * self.radius())
        a, f = self.response.imag[clear], frequency[clear]
        crossings: list[PhaseCrossing] = []
        for i in np.flatnonzero(np.diff(np.signbit(a))):
            at = float(f[i] + a[i] / (a[i] - a[i + 1]) * (f[i + 1] - f[i]))
            degrees = 0 if self.response.real[clear[i]] > 0 else 180
            crossings.append(PhaseCrossing(at, degrees))
        return Readings(low, float(frequency[0]), bool(flat), corner, crossings[:20])


def sampled(measured: Measurement, overrides: linear.Overrides) -> linear.System:
    """Returns the linear model of a measurement, sampled with the period of the measurement. The
    input is the command of the drive or the DAC code. The outputs are the two measured signals."""
    plain = [
        "drive.command" if name == "dac_code" else name
        for name in (measured.input, measured.output)
    ]
    command = "drive.code" if measured.inject == "codes" else "drive.command"
    system = linear.linearise(
        measured.model, (command,), plain, overrides, measured.modes, measured.free
    )
    result: linear.System = system.sampled(dt=measured.dt)
    return result
