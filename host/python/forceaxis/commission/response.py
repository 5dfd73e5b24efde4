"""Estimates the frequency response from the output codes to a sensor, from records with a known
waveform.

In a closed loop the input u contains the noise of the measured force through the force law. The
quotient of cross spectrum and input spectrum is therefore biased. The added waveform r is known
exactly and is independent of the noise (Pintelon and Schoukens, System Identification, 2.7):

    H = sum R* Y / sum R* U,    E = Y - H U,
    variance = sum |R|^2 sum |E|^2 / ((K - 1) |sum R* U|^2),    K realisations

In open loop r equals u, and the estimate is H1.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float64]
Response = NDArray[np.complex128]
Lines = NDArray[np.int64]  # line numbers of a spectrum
Steps = tuple[float, float]  # size of one code in units of (input, output)
Still = tuple[Samples, Samples]  # (inputs, outputs) of records without a waveform

LEAST = 1e-300
CANDIDATES = 400


def lines_of(samples: int, band_hz: tuple[float, float], rate_hz: float) -> Lines:
    """Line numbers of the spectrum within the band, for a record of `samples` samples."""
    low, high = band_hz
    first = max(1, int(np.ceil(low * samples / rate_hz - 1e-9)))
    return np.arange(first, int(np.floor(high * samples / rate_hz + 1e-9)) + 1)


def estimate(
    waveform: Samples, inputs: Samples, outputs: Samples, lines: Lines, steps: Steps
) -> tuple[dict[str, Any], Response, Samples]:
    """({response, variance, coherence, floor}, S, standard error of S) at `lines`.

    waveform, inputs, outputs: (K, n), one whole period of each of K >= 2 realisations in the same
    ticks. steps: size of one code in units of (input, output), for the lowest variance that
    rounding alone causes. The coherence is the smaller of that of waveform and input and that of
    waveform and output. S is input divided by waveform: the complex sensitivity function of the
    loop in which the waveform acts.
    """
    count, samples = waveform.shape
    R, U, Y = (np.fft.rfft(values, axis=1)[:, lines] for values in (waveform, inputs, outputs))
    power = (abs(R) ** 2).sum(0)
    RU, RY = (R.conj() * U).sum(0), (R.conj() * Y).sum(0)
    H = RY / np.where(RU == 0, LEAST, RU)
    rounding = samples / 12 * (steps[1] ** 2 + abs(H * steps[0]) ** 2)
    gain = power / np.maximum(abs(RU) ** 2, LEAST)
    spread = (abs(Y - H * U) ** 2).sum(0) / (count - 1)
    shown = [abs(a) ** 2 / np.maximum(power * (abs(b) ** 2).sum(0), LEAST)
             for a, b in ((RU, U), (RY, Y))]  # fmt: skip
    found = {
        "response": H,
        # Records that are equal in every code contain no information about their common rounding
        # error.
        "variance": np.maximum(spread, 1e-3 * rounding) * gain,
        "coherence": np.minimum(np.minimum(*shown), 1.0),
        "floor": np.sqrt(rounding * gain),
    }
    S = RU / power
    return found, S, np.sqrt((abs(U - S * R) ** 2).sum(0) / ((count - 1) * power))


def error(
    waveform: Samples, inputs: Samples, outputs: Samples, lines: Lines, steps: Steps, of_loop: bool
) -> float:
    """Median relative standard error of the response, or with of_loop of the sensitivity function;
    arguments as in estimate()."""
    found, S, sensitivity = estimate(waveform, inputs, outputs, lines, steps)
    if of_loop:
        return float(np.median(sensitivity / abs(S)))
    return float(np.median(np.sqrt(found["variance"]) / abs(found["response"])))


def deviation(
    inputs: Samples, outputs: Samples, still: Still, lines: Lines, steps: Steps, averages: int
) -> tuple[float, float]:
    """Expected median relative standard deviations of the response and of the sensitivity function,
    from `averages` realisations like this one.

    inputs, outputs: (n,) while the waveform acts; still: (inputs, outputs) without it.
    """
    U, Y = (np.fft.rfft(values)[lines] for values in (inputs, outputs))
    H = Y / np.where(U == 0, LEAST, U)
    noise = [np.fft.rfft(values - np.mean(values))[lines] for values in still]
    rounding = [len(inputs) / 12 * step**2 for step in steps]
    errors = (
        _smooth(abs(noise[1] - H * noise[0]) ** 2) + rounding[1] + abs(H) ** 2 * rounding[0],
        _smooth(abs(noise[0]) ** 2) + rounding[0],
    )
    of_response, of_loop = (
        float(np.median(np.sqrt(power / averages) / np.maximum(abs(signal), LEAST)))
        for power, signal in zip(errors, (Y, U), strict=True)
    )
    return of_response, of_loop


def excess(
    waveform: Samples, inputs: Samples, outputs: Samples, still: Still, lines: Lines, steps: Steps
) -> float:
    """Ratio of the difference of the realisations to their noise, mean over the lines. A value
    above 1 indicates distortion, for example by a saturated drive. Arguments as in estimate() and
    deviation()."""
    R, U, Y = (np.fft.rfft(values, axis=1)[:, lines] for values in (waveform, inputs, outputs))
    H = (R.conj() * Y).sum(0) / (R.conj() * U).sum(0)
    found = (abs(Y - H * U) ** 2).sum(0) / (len(R) - 1)
    noise = [np.fft.rfft(values - np.mean(values))[lines] for values in still]
    expected = _smooth(abs(noise[1] - H * noise[0]) ** 2)
    expected += waveform.shape[1] / 12 * (steps[1] ** 2 + abs(H * steps[0]) ** 2)
    return float(np.mean(found / expected))


def _smooth(power: NDArray[Any], lines: int = 11) -> Samples:
    width = min(lines, len(power))
    return np.convolve(power, np.ones(width) / width, "same")


def calm_seeds(count: int, samples: int, hold: int, first: int) -> list[int]:
    """Seeds of the firmware's noise whose integral over a period stays nearest to 0. An integrating
    axis then stays near its start position. first: another number gives other seeds."""
    seeds = (np.arange(CANDIDATES) + CANDIDATES * first) % 65536
    random = (seeds * 2654435769 % 2**32).astype(np.uint32)  # as in firmware/core/excitation.c
    integral = np.zeros(CANDIDATES)
    furthest = np.zeros(CANDIDATES)
    for start in range(0, samples, hold):
        random = random * np.uint32(1664525) + np.uint32(1013904223)
        integral += random.view(np.int32) * float(min(hold, samples - start))
        furthest = np.maximum(furthest, abs(integral))
    # The integral at the end of a period is the start of the next period.
    return seeds[np.argsort(furthest + 4 * abs(integral))[:count]].tolist()
