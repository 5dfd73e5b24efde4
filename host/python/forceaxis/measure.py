"""A virtual signal analyzer: frequency responses measured on the simulated axis (thesis 3.1.1, 3.2).

An excitation goes into the drive as volts on a fine clock, or comes as DAC codes from the
firmware's excitation mode; any two signals are recorded and their response estimated (H1).
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Measurement:
    """A measured frequency response, output over input, as both were sampled every `dt` seconds.

    What excites the plant is held from sample to sample. A simulated signal at sample k is that of
    the instant just after the new excitation acts; the firmware's codes (adc0, adc1, encoder) are
    converted just before it. So y[k] = C x[k] + D u[k], or C x[k] + D u[k-1] for codes: the exact
    model of the measured response is the plant sampled with zero-order hold, `predict()`.

    The n points may be taken as independent; the error of `response` at each is circular complex
    normal with the unknown variance that `variance` estimates from `dof` complex residuals, so that
    |response - true|^2 / variance follows F(2, 2 dof).
    """

    frequency_hz: np.ndarray  #: (n,) rising, > 0, below 1 / (2 dt)
    response: np.ndarray  #: (n,) complex, in units
    coherence: np.ndarray  #: (n,) 0..1, ordinary coherence of input and output
    variance: np.ndarray  #: (n,) of the complex response: E |response - true|^2, units squared
    dof: float  #: degrees of freedom of `variance` (complex): averages - 1
    averages: int
    input: str  #: a signal of the model ("drive.command": V), or "dac_code"
    output: str  #: a signal of the model, "adc0", "adc1" (codes) or "encoder" (counts)
    unit: str  #: of the response
    dt: float  #: s from sample to sample, 1 / (1500 parts)
    inject: str  #: "volts" (plant alone) or "codes" (through the firmware, dt = 1/1500 s)
    model: str  #: path of the model file that was measured
    scale: float = 1.0  #: what the output was multiplied by
