"""Structures of the firmware's force law: the numbers that a search varies, and how a filter bank
follows from these numbers.

A second-order section is (s^2 + 2 z_z w_z s + w_z^2) / (s^2 + 2 z_p w_p s + w_p^2). It is
transformed bilinearly so that its zeros and poles keep their frequencies, and has the gain 1 at
frequency 0. The numbers are logarithms. The first is that of the integral rate in rad/s. Each
section then has the zero frequency in Hz, zero damping, pole frequency in Hz, and pole damping.
"""

import math
from collections.abc import Iterable

import numpy as np

from forceaxis import _core
from forceaxis.design.grid import Samples
from forceaxis.linear.bank import COEFFICIENT_MAX, TICK_S, Bank

# Range of the integral rate of a control law.
# With a smaller integral rate, the force does not settle within the 10 s of a simulated contact.
INTEGRAL_RAD_PER_S = (0.6, 100.0)
HIGHEST_HZ = 600.0  # highest frequency in Hz of the zeros and poles of a second-order section
ZERO_DAMPING = (0.02, 2.0)  # range of the damping ratio of zeros
# Range of the damping ratio of poles.
# A pole with less damping amplifies the quantisation of the force at one frequency.
POLE_DAMPING = (0.4, 2.0)
# {structure: number of second-order sections}. None means neither integral action nor sections.
STRUCTURES: dict[str, int | None] = {
    "P": None,
    "PI": 0,
    "PI and one biquad": 1,
    "PI and two biquads": 2,
}


def bounds(name: str, lowest_hz: float) -> Samples:
    """Returns the limits of the numbers of a structure. The result is an array of logarithms with
    one row (lowest, highest) for each number. `lowest_hz`: lowest frequency of zeros and poles."""
    frequency = (lowest_hz, HIGHEST_HZ)
    section = (frequency, ZERO_DAMPING, frequency, POLE_DAMPING)
    sections = STRUCTURES[name]
    ranges = [] if sections is None else [INTEGRAL_RAD_PER_S, *(section * sections)]
    return np.array([logarithms(ends) for ends in ranges]).reshape(-1, 2)


def logarithms(values: Iterable[float]) -> Samples:
    """Returns natural logarithms, rounded. The last digit of a logarithm depends on the
    processor."""
    return np.array([round(math.log(value), 12) for value in values])


def bank(numbers: Samples, gain: float) -> Bank:
    """Returns the filter bank of a structure. `numbers`: logarithms of the parameters of the
    structure. `gain`: gain in codes per count."""
    rate, sections = _core.law_coefficients(numbers, TICK_S)
    return Bank(gain, rate, 0.0, tuple(sections))


def is_legal(sections: Iterable[Iterable[float]]) -> bool:
    """Returns True if the firmware can store all coefficients of the second-order sections."""
    return all(abs(c) <= COEFFICIENT_MAX for values in sections for c in values)
