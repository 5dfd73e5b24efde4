"""Computes bandwidth and margins of the previous and of the new force law with the fitted plant,
and compares the measured Ms with the predicted Ms."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from forceaxis.axis.axis import Axis
from forceaxis.commission.contact import FittedAxis
from forceaxis.commission.joint_fit import Response
from forceaxis.commission.level import Level
from forceaxis.commission.tune_folder import TuningFolder
from forceaxis.commission.tune_results import Fitted, FittedLoop, LoopPeak
from forceaxis.commission.unexplained import Unexplained
from forceaxis.linear import loops, over
from forceaxis.linear.bank import Bank, of_settings
from forceaxis.linear.stability import Loop

COEFFICIENTS_PER_BANK = 15
# Widths, as differences of logarithms of frequencies, over which |S| is averaged.
# The mean over the smaller width, which shows a narrow mode, needs at least LINES_MIN frequencies.
AVERAGING_WIDTHS, LINES_MIN = (0.04, 0.008), 4
ERROR_MAX = 0.1  # a value of |S| is regarded as certain if its relative error is at most this value


def active_law(axis: Axis) -> Bank:
    """Returns the force law that is active in the force modes, as a Bank. A P law is also returned
    as a Bank. Raises Refused, NoAnswer."""
    number, gain = axis.integer("force_bank"), axis.number("force_gain")
    if not number:
        return Bank(gain)
    parts = ("sections", "gain", "integral", "velocity_gain")
    first = COEFFICIENTS_PER_BANK * (number - 1) + 1
    names = [f"bank_{part}_{number}" for part in parts]
    names += [f"bank_coefficient_{i}" for i in range(first, first + COEFFICIENTS_PER_BANK)]
    bank = of_settings({"force_bank": number, "force_gain": gain} | axis.numbers(*names))
    # The filter bank is never None here, because the number of the active bank is not 0.
    assert bank is not None
    return bank


def on_fitted(
    tuning: TuningFolder, fitted: Fitted, banks: Mapping[str, Bank], late: int
) -> dict[str, FittedLoop | None]:
    """Computes bandwidth and margins of several force laws with the fitted plant. `banks`: {name:
    Bank}. The result has the same names, with None for a law with gain 0. `late`: latency in
    ticks."""
    found: dict[str, FittedLoop | None] = {}
    for name, bank in banks.items():
        found[name] = None
        if bank.force_gain:
            figures = over.figures(*_loop(tuning, fitted, bank, late, tuning.states))
            found[name] = FittedLoop(**vars(figures), law=bank.keys())
    return found


def _loop(
    tuning: TuningFolder, fitted: Fitted, bank: Bank, late: int, modes: Mapping[str, str]
) -> tuple[Loop, float]:
    """Returns the loop of a force law with the fitted plant, and the gain of this loop."""
    spec = loops.LoopSpec("bank", ("zoh", "zoh+1")[late], bank=bank)
    loop = spec.around(str(tuning.model), fitted.values, modes)
    return loop, over.gain_at(loop, None, None)


def peaks(
    fitted_axis: FittedAxis, level: Level, lacks: Unexplained | None = None
) -> LoopPeak | None:
    """Returns the measured Ms, and Ms of the fitted model at the same frequencies. `lacks`: what
    the model does not explain of the response at the same force. Returns None if |S| is certain at
    no frequency."""
    hz, tuning = level.measured.frequency_hz, fitted_axis.tuning
    fitted, designed = fitted_axis.fitted, fitted_axis.designed
    late = tuning.axis.integer("latency_ticks")
    # With dry friction, the axis sticks at some amplitudes and slides at others.
    # The predicted Ms is the larger one of the values for a sticking and a sliding axis.
    every = designed.modes if fitted.friction and designed.modes else (tuning.states,)
    pairs = [_loop(tuning, fitted, designed.bank.bank, late, modes) for modes in every]
    predicted = [loop.sensitivity_at(gain, hz) for loop, gain in pairs]
    if lacks is not None:
        predicted = [S / (1 + (1 - S) * (lacks.quotient(hz) - 1)) for S in predicted]
    found = [one for w in AVERAGING_WIDTHS if (one := _peak(level, predicted, w)) is not None]
    if not found:
        return None
    largest = max(found, key=lambda one: one.Ms - one.Ms_error)
    return replace(largest, Ms_predicted=max(one.Ms_predicted for one in found))


def _peak(level: Level, predicted: Sequence[Response], width: float) -> LoopPeak | None:
    """Returns the measured Ms and the predicted one, with means of |S| over frequencies whose
    logarithms differ by less than `width`. Without averaging, the maximum of many noisy values of
    |S| would be too large. Returns None if |S| is certain at no frequency. `predicted`: sensitivity
    functions of which the largest counts."""
    hz = level.measured.frequency_hz
    near = (abs(np.log(hz[:, None] / hz)) < width).astype(float)
    lines = near.sum(1, keepdims=True)
    near /= lines
    error = np.sqrt(near**2 @ (near @ level.sensitivity_error**2))
    found = abs(near @ level.sensitivity)
    expected = np.max([abs(near @ S) for S in predicted], 0)
    sure = error < ERROR_MAX * found
    if width < AVERAGING_WIDTHS[0]:
        sure &= lines[:, 0] >= LINES_MIN
    if not sure.any():
        return None
    peak = np.flatnonzero(sure)[found[sure].argmax()]
    return LoopPeak(
        Ms=float(found[peak]),
        Ms_error=float(error[peak]),
        Ms_hz=float(hz[peak]),
        Ms_predicted=float(expected[sure].max()),
        lines=int(sure.sum()),
    )
