"""What an axis' force laws bear: that of before and the one that it gets, on the fitted plant and
as measured."""

from collections.abc import Mapping

import numpy as np

from forceaxis.axis.axis import Axis
from forceaxis.commission.contact import FittedAxis
from forceaxis.commission.level import Level
from forceaxis.commission.tune_folder import TuningFolder
from forceaxis.commission.tune_results import Fitted, FittedLoop, LawKeys, LoopPeak
from forceaxis.linear import loops, over
from forceaxis.linear.bank import Bank, of_settings
from forceaxis.linear.stability import Loop

COEFFICIENTS = 15  # of a bank
# Logarithm of the frequency over which |S| is averaged, and its relative error at most.
AVERAGED_LOG, ERROR_MAX = 0.04, 0.1


def law_in_force(axis: Axis) -> Bank:
    """The Bank that the axis' force modes act by, P as well. Raises Refused, NoAnswer."""
    number, gain = axis.get("force_bank", "force_gain").values()
    if not number:
        return Bank(gain)
    parts = ("sections", "gain", "integral", "velocity_gain")
    first = COEFFICIENTS * (number - 1) + 1
    names = [f"bank_{part}_{number}" for part in parts]
    names += [f"bank_coefficient_{i}" for i in range(first, first + COEFFICIENTS)]
    bank = of_settings({"force_bank": number, "force_gain": gain} | axis.get(*names))
    assert bank is not None  # of a number that is not 0
    return bank


def on_fitted(
    tuning: TuningFolder, fitted: Fitted, banks: Mapping[str, Bank], late: int
) -> dict[str, FittedLoop | None]:
    """{name: figures} of {name: Bank} on the fitted plant; None for a law without a gain. late:
    ticks of latency."""
    found: dict[str, FittedLoop | None] = {}
    for name, bank in banks.items():
        found[name] = None
        if bank.force_gain:
            figures = over.figures(*_loop(tuning, fitted, bank, late, tuning.states))
            found[name] = FittedLoop(**vars(figures), law=LawKeys.of(bank))
    return found


def _loop(
    tuning: TuningFolder, fitted: Fitted, bank: Bank, late: int, modes: Mapping[str, str]
) -> tuple[Loop, float]:
    """(loop of a Bank on the fitted plant, its gain)."""
    spec = loops.LoopSpec("bank", ("zoh", "zoh+1")[late], bank=bank)
    loop = spec.around(str(tuning.model), fitted.values, modes)
    return loop, over.gain_at(loop, None, None)


def peaks(fitted_axis: FittedAxis, level: Level) -> LoopPeak | None:
    """Ms as measured, and as the fitted model has it at the same lines; None where no line is
    sure."""
    measured, tuning = level.measured, fitted_axis.tuning
    fitted, designed = fitted_axis.fitted, fitted_axis.designed
    late = tuning.axis.read("latency_ticks")
    # What rubs sticks at some amplitudes and slides at others, so the larger of both is taken.
    every = designed.modes if fitted.friction and designed.modes else (tuning.states,)
    hz = measured.frequency_hz
    # Over a few percent of the frequency: the peak of many noisy lines is too high.
    near = (abs(np.log(hz[:, None] / hz)) < AVERAGED_LOG).astype(float)
    near /= near.sum(1, keepdims=True)
    error = np.sqrt(near**2 @ (near @ level.sensitivity_error**2))
    found = abs(near @ level.sensitivity)
    pairs = [_loop(tuning, fitted, designed.bank.bank, late, modes) for modes in every]
    expected = np.max(
        [abs(near @ loop.sensitivity(gain).response(hz).ravel()) for loop, gain in pairs], 0
    )
    sure = error < ERROR_MAX * found
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
