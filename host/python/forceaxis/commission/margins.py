"""What an axis' force laws bear: that of before and the one that it gets, on the fitted plant and
as measured."""

from dataclasses import asdict

import numpy as np

from forceaxis.linear import loops, over
from forceaxis.linear.bank import Bank, of_settings

COEFFICIENTS = 15  # of a bank
PART, SURE = 0.04, 0.1  # of the frequency, over which |S| is averaged; its relative error


def law_in_force(axis):
    """The Bank that the axis' force modes act by, P as well. Raises Refused, NoAnswer."""
    found = axis.get("force_bank", "force_gain")
    number = found["force_bank"]
    if not number:
        return Bank(found["force_gain"])
    parts = ("sections", "gain", "integral", "velocity_gain")
    first = COEFFICIENTS * (number - 1) + 1
    names = [f"bank_{part}_{number}" for part in parts]
    names += [f"bank_coefficient_{i}" for i in range(first, first + COEFFICIENTS)]
    return of_settings(found | axis.get(*names))


def on_fitted(tuning, banks, late):
    """{name: figures of linear.over with "law": its keys} of {name: Bank} on the fitted plant;
    None for a law without a gain. late: ticks of latency."""
    found = {}
    for name, bank in banks.items():
        found[name] = None
        if bank.force_gain:
            found[name] = asdict(over.figures(*_loop(tuning, bank, late))) | {"law": bank.keys()}
    return found


def _loop(tuning, bank, late, modes=None):
    """(loop of a Bank on the fitted plant, its gain)."""
    spec = loops.LoopSpec("bank", ("zoh", "zoh+1")[late], bank=bank)
    states = tuning.states if modes is None else modes
    loop = spec.around(str(tuning.model), tuning.result("fit")["values"], states)
    return loop, over.gain_at(loop, None, None)


def peaks(tuning, bank, late, level):
    """Ms as measured, and as the fitted model has it at the same lines; None where no line is
    sure."""
    measured = level.measured
    # What rubs sticks at some amplitudes and slides at others, so the larger of both is taken.
    every = tuning.result("design").get("modes") or [None]
    if not tuning.result("fit").get("friction"):
        every = [None]
    hz = measured.frequency_hz
    # Over a few percent of the frequency: the peak of many noisy lines is too high.
    near = (abs(np.log(hz[:, None] / hz)) < PART).astype(float)
    near /= near.sum(1, keepdims=True)
    error = np.sqrt(near**2 @ (near @ level.sensitivity_error**2))
    found = abs(near @ level.sensitivity)
    pairs = [_loop(tuning, bank, late, modes) for modes in every]
    expected = np.max(
        [abs(near @ loop.sensitivity(gain).response(hz).ravel()) for loop, gain in pairs], 0
    )
    sure = error < SURE * found
    if not sure.any():
        return None
    peak = np.flatnonzero(sure)[found[sure].argmax()]
    return {
        "Ms": float(found[peak]),
        "Ms_error": float(error[peak]),
        "Ms_hz": float(hz[peak]),
        "Ms_predicted": float(expected[sure].max()),
        "lines": int(sure.sum()),
    }
