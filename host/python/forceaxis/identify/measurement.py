"""A measured frequency response: its error, characteristic values, comparison with a model."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from forceaxis import linear
from forceaxis.identify.setup import CODES

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]

BAND = 0.95
COHERENT = 0.9
FLAT = 0.1  # spread of an octave's amplitudes over their size that is a plateau


@dataclass(frozen=True)
class Points:
    """A measured response at its frequencies, Hz."""

    label: str
    frequency_hz: Reals
    magnitude: Reals  #: in the unit of the model's curve
    phase_deg: Reals  #: in the turn of the model's curve
    radius: Reals  #: the true response is this near with 95 %


@dataclass(frozen=True)
class Comparison:
    """A test of whether a response is the measured one. `coherent` is the number of points whose
    coherence is above 0.9, `inside` the share of these within the 95 % band (None without such
    points). The response fits where p_value is at least 0.05."""

    points: int
    coherent: int
    inside: float | None
    statistic: float
    p_value: float
    fits: bool


@dataclass(frozen=True)
class PhaseCrossing:
    """A frequency at which the phase passes through 0 or 180 degrees."""

    frequency_hz: float
    phase_deg: int


@dataclass(frozen=True)
class Readings:
    """Characteristic values of a measured response; see Measurement.readings()."""

    low_gain: float  #: at the lowest frequency, in the unit of the response
    low_hz: float  #: the lowest frequency
    plateau: bool  #: whether the first octave is flat
    corner_hz: float | None
    phase_crossings: list[PhaseCrossing]


@dataclass(frozen=True)
class Measurement:
    """A measured frequency response, output over input, as both were sampled every `dt` seconds.

    What excites the plant is held from sample to sample. A simulated signal at sample k is that of
    the instant just after the new excitation acts; the firmware's codes (adc0, adc1, encoder) are
    converted just before it. So y[k] = C x[k] + D u[k], or C x[k] + D u[k-1] for codes: the exact
    model of the measured response is the plant sampled with zero-order hold, `predict()`.

    The n points may be taken as independent; the error of `response` at each is circular complex
    normal with the unknown variance that `variance` estimates from `dof` complex residuals, so that
    |response - true|^2 / variance follows F(2, 2 dof). Under a window neighbouring points share
    noise and leakage counts as noise, so that bands and tests err on the safe side.
    """

    frequency_hz: Reals  #: (n,) rising, > 0, below 1 / (2 dt)
    response: Complexes  #: (n,) complex, in units
    coherence: Reals  #: (n,) 0..1, ordinary coherence of input and output
    variance: Reals  #: (n,) of the complex response: E |response - true|^2, units squared
    floor: Reals  #: (n,) standard deviation by quantisation alone, units
    dof: float  #: degrees of freedom of `variance` (complex): averages - 1, fewer with overlap
    averages: int
    input: str  #: a signal of the model ("drive.command": V), or "dac_code"
    output: str  #: a signal of the model, "adc0", "adc1" (8-bit counts) or "encoder" (counts)
    unit: str  #: of the response
    dt: float  #: s from sample to sample, 1 / (1500 parts)
    inject: str  #: "volts" (plant alone) or "codes" (through the firmware, dt = 1/1500 s)
    model: str  #: path of the model file that was measured
    overrides: linear.Overrides  #: nominal parameters, those of `predict()` without arguments
    free: bool = False  #: contacts apart
    scale: float = 1.0  #: factor of the output
    window: str = "none"  #: or "hann", under which neighbouring frequencies mix
    resolution_hz: float = 0.0  #: distance of the lines, 1 / length of a record
    band_hz: tuple[float, float] = (0.0, math.inf)  #: that was excited
    saturated: float = 0.0  #: share of the samples in which an ADC stood at one of its ends
    #: {element: {state: share of the measured time}} of what switches: contacts, the drive's limits
    states: dict[str, dict[str, float]] = field(default_factory=dict)
    #: {element: state} that `predict()` takes, besides contacts: the slope of an amplifier
    modes: dict[str, str] = field(default_factory=dict)
    input_bias: float = 0.0  #: share by which the converter's noise in the input makes H1 too small

    def predict(
        self, overrides: linear.Overrides | None = None, frequency_hz: ArrayLike | None = None
    ) -> Complexes:
        """The linear model's response between the same two signals, sampled alike: (n,) complex.

        overrides: {parameter: value} on top of the nominal ones. Raises InputError.
        """
        frequency = self.frequency_hz if frequency_hz is None else np.asarray(frequency_hz, float)
        system = sampled(self, {**self.overrides, **(overrides or {})})
        if self.window == "none":
            x, y = self._signals(system, frequency)
            return np.asarray(self.scale * y / x)
        # What H1 tends to under a window W, exactly: sum |W|^2 X* Y / sum |W|^2 |X|^2 about a line.
        offset = np.arange(-48, 49) / 8 + 1e-9  # lines; 1e-9: not 0 / 0
        near = frequency[:, None] + offset * self.resolution_hz
        weight = (np.sinc(offset) / (1 - offset**2)) ** 2
        weight = weight * ((near >= self.band_hz[0]) & (near <= self.band_hz[1]))
        x, y = self._signals(system, abs(near).ravel())
        x, y = x.reshape(near.shape), y.reshape(near.shape)
        mean = (weight * x.conj() * y).sum(1) / (weight * abs(x) ** 2).sum(1)
        return np.asarray(self.scale * mean)

    def _signals(self, system: linear.System, frequency: Reals) -> Complexes:
        """Input and output over what drives the plant."""
        values: Complexes = system.response(frequency).reshape(len(frequency), 2).T
        late = np.exp(-2j * np.pi * frequency * self.dt) - 1
        for row, name in enumerate((self.input, self.output)):
            if name in CODES[:3]:  # converted before the new excitation acts
                values[row] += system.D[row, 0] * late
            elif name == "dac_code":
                values[row] = 1.0
        return values

    def radius(self, share: float = BAND) -> Reals:
        """(n,) The true response is within this distance with probability `share`."""
        from scipy import stats

        return np.asarray(np.sqrt(self.variance * stats.f.ppf(share, 2, 2 * self.dof)))

    def random_error(self) -> Reals:
        """(n,) Relative standard deviation of |response| by its coherence:
        sqrt((1 - coherence) / (2 averages coherence)) (Bendat and Piersol)."""
        shown = np.maximum(self.coherence, 1e-12)
        return np.asarray(np.sqrt((1 - self.coherence) / (2 * (self.dof + 1) * shown)))

    def compare(self, model: Complexes | None = None) -> Comparison:
        """Whether a response (default: predict()) is the one measured.

        The test is of all points at once: with
        F = |response - model|^2 / variance, the sum of 2 dof log(1 + F / dof) is chi-square with 2
        degrees of freedom a point if the model is true (Fisher's sum of the points' log p-values,
        which here is the likelihood ratio).
        """
        from scipy import stats

        model = self.predict() if model is None else model
        ratio = abs(self.response - model) ** 2 / self.variance
        statistic = float(np.sum(2 * self.dof * np.log1p(ratio / self.dof)))
        p_value = float(stats.chi2.sf(statistic, 2 * len(ratio)))
        coherent = self.coherence > COHERENT
        inside = ratio <= stats.f.ppf(BAND, 2, 2 * self.dof)
        return Comparison(
            points=len(ratio),
            coherent=int(coherent.sum()),
            inside=float(inside[coherent].mean()) if coherent.any() else None,
            statistic=statistic,
            p_value=p_value,
            fits=p_value >= 1 - BAND,
        )

    def readings(self) -> Readings:
        """Characteristic values: gain at the lowest frequency; the frequency, Hz, where it is 3 dB
        below that, if the first octave is flat (no corner otherwise: the curve's plateau, if
        it has one, is not in the band); where the phase passes through 0 (or 180) degrees, Hz."""
        size, frequency = abs(self.response), self.frequency_hz
        octave = size[frequency <= 2 * frequency[0] * (1 + 1e-9)]
        flat = len(octave) > 1 and np.ptp(octave) <= FLAT * octave[0]
        low = float(size[0])
        plateau = float(np.median(octave))
        below = np.flatnonzero(size < plateau / math.sqrt(2)) if flat else np.zeros(0, int)
        corner = None
        if len(below) and below[0] > 0:
            i = below[0]
            span = np.log(size[i - 1 : i + 1])
            part = (span[0] - math.log(plateau / math.sqrt(2))) / (span[0] - span[1])
            corner = float(frequency[i - 1] + part * (frequency[i] - frequency[i - 1]))
        # Noise about the axis is no crossing: only points clearly on one side count.
        clear = np.flatnonzero(abs(self.response.imag) > 2 * self.radius())
        a, f = self.response.imag[clear], frequency[clear]
        crossings: list[PhaseCrossing] = []
        for i in np.flatnonzero(np.diff(np.signbit(a))):
            at = float(f[i] + a[i] / (a[i] - a[i + 1]) * (f[i + 1] - f[i]))
            degrees = 0 if self.response.real[clear[i]] > 0 else 180
            crossings.append(PhaseCrossing(at, degrees))
        return Readings(low, float(frequency[0]), bool(flat), corner, crossings[:20])


def sampled(measured: Measurement, overrides: linear.Overrides) -> linear.System:
    """The two signals over the drive's command (or the DAC's code) as a sampled System."""
    plain = [
        "drive.command" if name == "dac_code" else name
        for name in (measured.input, measured.output)
    ]
    system = linear.linearise(
        measured.model, ("drive.command",), plain, overrides, measured.modes, measured.free
    )
    if measured.inject == "codes":
        factor = linear.facts(measured.model, overrides).volts_per_code
        system = replace(system, B=system.B * factor, D=system.D * factor)
    result: linear.System = system.sampled(dt=measured.dt)
    return result
