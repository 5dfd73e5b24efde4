"""What a law is worth over a set, to the digit, and what keeps it from more.

The search judges on a grid and a sample of the set; here the gain is lowered until the exact
figures of the worst members (`linear.over`) keep the margins.
"""

import math
from dataclasses import replace

import numpy as np

from forceaxis.design.grid import DELAYS
from forceaxis.linear import over
from forceaxis.linear.bank import GAIN_STEP
from forceaxis.linear.loops import LoopSpec

ATTEMPTS = 12
FIRST = 0.995  # of the gain: the worst member is seldom among those of the grid
NEAR = 0.97  # of a bound, from which it counts as reached
MODE = 1.35  # frequencies within this factor of a mode are its own

CONSTRAINTS = {
    "ms": "peak of |S|",
    "mt": "peak of |T|",
    "gm": "gain margin",
    "pm": "phase margin",
}


def lowered(bank, factor):
    """The bank with a gain that the firmware holds, at most `factor` times its own."""
    return replace(bank, force_gain=math.floor(bank.force_gain * factor / GAIN_STEP) * GAIN_STEP)


def on_grid(grid, bank):
    law, gain = bank.response(grid.z), bank.force_gain
    first, _ = grid.bandwidths(law, gain)
    peaks = dict(zip(grid.timings, grid.peaks(law, gain)[0].max(axis=1), strict=True))
    _, j = np.unravel_index(int(np.argmin(first)), first.shape)
    member = grid.members[j]
    return {
        "fS_Hz": float(first.min()),
        "fT_Hz": float(grid.last_falls(law, gain).min()),
        "Ms": _float(peaks.get("zoh")),
        "Ms_late": _float(peaks.get("zoh+1")),
        **grid.margins(law, gain),
        "static_error": _static_error(grid, bank),
        "member": member.values | member.modes,
    }


def on_grids(grids, bank):
    """The same over the members of several Grids."""
    rows = [on_grid(grid, bank) for grid in grids]
    slowest = min(rows, key=lambda row: row["fS_Hz"])
    found = {}
    for name in slowest:
        known = [row[name] for row in rows if row[name] is not None]
        largest = name in ("Ms", "Ms_late", "static_error")
        found[name] = slowest["member"] if name == "member" else (
            (max if largest else min)(known, default=None)
        )  # fmt: skip
    return found


def exact(plants, grids, bank, goal):
    """(bank, figures): with the gain lowered as far as the exact worst of the set asks for; the
    bank's gain is 0 where none is left."""
    bank = lowered(bank, FIRST)
    for attempt in range(ATTEMPTS):
        if not bank.force_gain:
            break
        found = {t: over.worst(plants, (t,), LoopSpec("bank", bank=bank)) for t in goal.timings}
        factor = min(_factor(w, goal, t) for t, w in found.items())
        if factor >= 1:
            return bank, _figures(found, grids, bank)
        bank = lowered(bank, (0.999 * factor) ** (1 + attempt))  # a peak may hardly fall with it
    return replace(bank, force_gain=0.0), None


def _factor(worst, goal, timing):
    """What the gain is to be taken times, 1 where the margins are kept."""
    if not worst.stable:
        return 0.8
    factor = 1.0
    most = goal.ms_of(timing)
    if worst.Ms > most:
        factor = min(factor, max(1 - (worst.Ms - most) / most, 0.8))
    if worst.gain_margin is not None and worst.gain_margin < goal.gain_margin:
        factor = min(factor, worst.gain_margin / goal.gain_margin)
    if goal.phase_margin_deg and abs(worst.phase_margin_deg or 180) < goal.phase_margin_deg:
        factor = min(factor, 0.97)
    return factor


def _figures(found, grids, bank):
    def least(name):
        known = [abs(getattr(w, name)) for w in found.values() if getattr(w, name) is not None]
        return min(known, default=None)

    slowest = min(found.values(), key=lambda w: math.inf if w.fS_Hz is None else w.fS_Hz)
    member = slowest.member["fS_Hz"][0] if "fS_Hz" in slowest.member else None
    ms = {timing: worst.Ms for timing, worst in found.items()}
    return {
        "fS_Hz": least("fS_Hz"),
        "fT_Hz": least("fT_Hz"),
        "Ms": ms.get("zoh"),
        "Ms_late": ms.get("zoh+1"),
        "gain_margin": least("gain_margin"),
        "phase_margin_deg": least("phase_margin_deg"),
        "static_error": max(_static_error(grid, bank) for grid in grids),
        "member": member.values | member.modes if member else {},
    }


def _float(value):
    return None if value is None else float(value)


def _static_error(grid, bank):
    """Share of the set-point that is left."""
    if bank.integral_rad_per_s:
        return 0.0
    return float(np.abs(1 / (1 + bank.force_gain * grid.plant[:, 0])).max())


def sentence(grid, bank, steep, bounds, finer):
    """What keeps the gain from more; steep: the law's gain at high frequency for the gain 1; finer:
    Goal.hf_cure()."""
    law = bank.response(grid.z)
    free = replace(bounds, hf_gain=math.inf)
    _, name, member, timing, hz = grid.largest_gain(law, steep, free)
    reached = bank.force_gain * steep >= NEAR * bounds.hf_gain
    high = f"the gain at high frequency ({bounds.hf_gain:.3g} codes per 8-bit count)"
    if name == "hf" or (reached and _margin_left(grid, law, bank, free, steep)):
        return f"{high[0].upper()}{high[1:]} is the limit: {finer}."
    mode = _mode_near(grid.open_loops[member], hz)
    where = f"at {hz:.1f} Hz" + (f", over the plant's mode at {mode:.1f} Hz," if mode else "")
    late = ", one tick late" if DELAYS[grid.timings[timing]] else ""
    text = f"The {CONSTRAINTS[name]} {where} {_with(grid.members[member])}{late} is the limit"
    cure = "more damping of that mode" if mode else "a looser margin"
    text += f": {cure} or a narrower set would move it"
    return text + (f"; so is {high}: {finer}." if reached else ".")


def _with(member):
    label = member.label()
    return "on the nominal plant" if label == "nominal" else f"with {label}"


def _margin_left(grid, law, bank, bounds, steep):
    return grid.largest_gain(law, steep, bounds)[0] > bank.force_gain / NEAR


def _mode_near(loop, hz):
    """Hz of the plant's lightly damped pole nearest to a frequency, or None."""
    poles = loop.open.poles_s()
    poles = poles[np.isfinite(poles) & (poles.imag > 0)]
    light = poles[np.abs(poles.real) < 0.2 * np.abs(poles)].imag / (2 * math.pi)
    near = [p for p in light if max(p / hz, hz / p) < MODE]
    return min(near, key=lambda p: abs(math.log(p / hz)), default=None)
