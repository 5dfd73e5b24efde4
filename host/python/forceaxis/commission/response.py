"""Estimates the frequency response from the DAC codes to a sensor, by means of recordings with a
known waveform of the excitation.

In a closed loop, the force law transmits the noise of the measured force to the input u. The
quotient of cross spectrum and input spectrum is therefore biased. But the added waveform r is known
exactly and is independent of the noise. It gives an estimate without bias (Pintelon and Schoukens,
System Identification, 2.7):

    H = sum R* Y / sum R* U,    E = Y - H U,
    variance = sum |R|^2 sum |E|^2 / ((K - 1) |sum R* U|^2),    K realisations

In open loop, r is equal to u, and the result is the H1 estimate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]
Response = NDArray[np.complex128]
Lines = NDArray[np.int64]  # numbers of spectral lines
# Quantisation steps of the input and of the output, each in the unit of its signal.
Steps = tuple[float, float]
Still = tuple[Samples, Samples]  # (inputs, outputs) of recordings without excitation

POWER_MIN = 1e-300  # this value replaces a power of 0 before a division
CANDIDATE_SEEDS = 400  # number of seeds among which calm_seeds() chooses


@dataclass(frozen=True)
class ResponseEstimate:
    """An estimated frequency response, and the sensitivity function of the loop. Each array has one
    value for each spectral line.

    `variance`: variance of the complex response. `floor`: standard deviation of the response that
    rounding alone causes. `sensitivity`: complex ratio of input to waveform. `sensitivity_error`:
    standard error of `sensitivity`.
    """

    response: Response
    variance: Samples
    coherence: Samples
    floor: Samples
    sensitivity: Response
    sensitivity_error: Samples

    def relative_error(self) -> float:
        """Returns the median relative standard error of the response."""
        return float(np.median(np.sqrt(self.variance) / abs(self.response)))

    def relative_sensitivity_error(self) -> float:
        """Returns the median relative standard error of the sensitivity function."""
        return float(np.median(self.sensitivity_error / abs(self.sensitivity)))


def lines_of(samples: int, band_hz: tuple[float, float], rate_hz: float) -> Lines:
    """Returns the numbers of the spectral lines within the frequency band, for a recording of
    `samples` samples."""
    low, high = band_hz
    first = max(1, int(np.ceil(low * samples / rate_hz - 1e-9)))
    return np.arange(first, int(np.floor(high * samples / rate_hz + 1e-9)) + 1)


def estimate(
    waveform: Samples, inputs: Samples, outputs: Samples, lines: Lines, steps: Steps
) -> ResponseEstimate:
    """Estimates the frequency response from input to output at the spectral lines `lines`.

    waveform, inputs, outputs: signals of at least two realisations, with one row for each. A row is
    one whole period, and the rows of the three signals have the same ticks. steps: quantisation
    steps of input and output. They determine the variance that rounding alone causes. The coherence
    is the smaller one of two values: between waveform and input, and between waveform and output.
    """
    count, samples = waveform.shape
    R, U, Y = (_spectrum(values, lines) for values in (waveform, inputs, outputs))
    power = (abs(R) ** 2).sum(0)
    RU, RY = (R.conj() * U).sum(0), (R.conj() * Y).sum(0)
    H = RY / np.where(RU == 0, POWER_MIN, RU)
    rounding = _rounding_power(H, samples, steps)
    gain = power / np.maximum(abs(RU) ** 2, POWER_MIN)
    spread = (abs(Y - H * U) ** 2).sum(0) / (count - 1)
    shown = [abs(a) ** 2 / np.maximum(power * (abs(b) ** 2).sum(0), POWER_MIN)
             for a, b in ((RU, U), (RY, Y))]  # fmt: skip
    S = RU / power
    return ResponseEstimate(
        response=H,
        # Recordings with equal codes contain no information about the rounding error.
        variance=np.maximum(spread, 1e-3 * rounding) * gain,
        coherence=np.minimum(np.minimum(*shown), 1.0),
        floor=np.sqrt(rounding * gain),
        sensitivity=S,
        sensitivity_error=np.sqrt((abs(U - S * R) ** 2).sum(0) / ((count - 1) * power)),
    )


def deviation(
    inputs: Samples, outputs: Samples, still: Still, lines: Lines, steps: Steps, averages: int
) -> tuple[float, float]:
    """Predicts the error of a measurement with `averages` realisations from the noise of one
    realisation. Returns the median relative standard deviations of the response and of the
    sensitivity function.

    inputs, outputs: signals of a recording with the excitation. still: (inputs, outputs) of a
    recording without excitation.
    """
    U, Y = _spectrum(inputs, lines), _spectrum(outputs, lines)
    H = Y / np.where(U == 0, POWER_MIN, U)
    noise, _ = (_spectrum(values - np.mean(values), lines) for values in still)
    errors = (
        _noise_power(H, still, lines) + _rounding_power(H, len(inputs), steps),
        _smooth(np.asarray(abs(noise) ** 2)) + len(inputs) / 12 * steps[0] ** 2,
    )
    of_response, of_loop = (
        float(np.median(np.sqrt(power / averages) / np.maximum(abs(signal), POWER_MIN)))
        for power, signal in zip(errors, (Y, U), strict=True)
    )
    return of_response, of_loop


def excess(
    waveform: Samples, inputs: Samples, outputs: Samples, still: Still, lines: Lines, steps: Steps
) -> float:
    """Returns the difference between the realisations divided by their noise, as the mean over the
    spectral lines.

    A value above 1 indicates distortion, for example by a saturated drive. The arguments are those
    of estimate() and deviation().
    """
    R, U, Y = (_spectrum(values, lines) for values in (waveform, inputs, outputs))
    H = (R.conj() * Y).sum(0) / (R.conj() * U).sum(0)
    found = (abs(Y - H * U) ** 2).sum(0) / (len(R) - 1)
    expected = _noise_power(H, still, lines) + _rounding_power(H, waveform.shape[1], steps)
    return float(np.mean(found / expected))


def _spectrum(values: Samples, lines: Lines) -> Response:
    """Returns the spectrum of signals at the spectral lines `lines`. The last dimension of `values`
    is the time."""
    return np.asarray(np.fft.rfft(values)[..., lines])


def _rounding_power(H: Response, samples: int, steps: Steps) -> Samples:
    """Returns the power at the output that is caused by the rounding of input and output to codes.
    `H`: frequency response from input to output."""
    return np.asarray(samples / 12 * (steps[1] ** 2 + abs(H * steps[0]) ** 2))


def _noise_power(H: Response, still: Still, lines: Lines) -> Samples:
    """Returns the power of the noise at the output, computed from recordings without excitation.
    `H`: frequency response from input to output."""
    U, Y = (_spectrum(values - np.mean(values), lines) for values in still)
    return _smooth(np.asarray(abs(Y - H * U) ** 2))


def _smooth(power: Samples, lines: int = 11) -> Samples:
    """Returns the moving average of a power spectrum over `lines` spectral lines."""
    width = min(lines, len(power))
    return np.convolve(power, np.ones(width) / width, "same")


def calm_seeds(count: int, samples: int, hold: int, first: int) -> list[int]:
    """Selects seeds for the noise generator of the firmware. The integral of the selected noises
    stays nearest to 0 during a period, so that an integrating axis stays near its start position.

    Another number `first` gives other seeds.
    """
    seeds = (np.arange(CANDIDATE_SEEDS) + CANDIDATE_SEEDS * first) % 65536
    # This random number generator is the same as in firmware/core/excitation.c.
    random = (seeds * 2654435769 % 2**32).astype(np.uint32)
    integral = np.zeros(CANDIDATE_SEEDS)
    furthest = np.zeros(CANDIDATE_SEEDS)
    for start in range(0, samples, hold):
        random = random * np.uint32(1664525) + np.uint32(1013904223)
        integral += random.view(np.int32) * float(min(hold, samples - start))
        furthest = np.maximum(furthest, abs(integral))
    # The integral at the end of a period is its start value in the next period.
    chosen: list[int] = seeds[np.argsort(furthest + 4 * abs(integral))[:count]].tolist()
    return chosen
