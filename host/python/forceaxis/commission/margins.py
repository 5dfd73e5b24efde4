"""What an axis' force law of before, and the one that it gets, bear on the fitted plant."""

from dataclasses import asdict

from forceaxis.linear import loops, over
from forceaxis.linear.bank import Bank, of_settings

COEFFICIENTS = 15  # of a bank


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
            loop = loops.force_loop(
                str(tuning.model), "bank", ("zoh", "zoh+1")[late],
                tuning.result("fit")["values"], bank=bank,
            )  # fmt: skip
            gain = over.gain_at(loop, None, None, {"bank": bank})
            found[name] = asdict(over.figures(loop, gain)) | {"law": bank.keys()}
    return found
