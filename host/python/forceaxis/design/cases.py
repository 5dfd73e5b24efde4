"""A simulated contact: what is asked of it, what came of it, and why a gain was cut for it."""

from dataclasses import dataclass
from typing import NamedTuple

from forceaxis import _core


@dataclass(frozen=True)
class Case:
    """A touch-down, perhaps with a strike: newtons, m/s, N s."""

    setpoint_N: float
    speed_m_per_s: float
    strike_N_s: float = 0.0

    @property
    def name(self):
        text = f"contact {self.setpoint_N:.3g} N at {1e3 * self.speed_m_per_s:.3g} mm/s"
        return text + (f", strike {self.strike_N_s:.3g} N s" if self.strike_N_s else "")


class Named(NamedTuple):
    """An experiment among cases."""

    name: str


def row(law, case, member, latency, outcome, losses_max=None):
    """A simulated case as `forceaxis design --json` prints it; None: there is no such value.
    losses_max: of contact, that its verdict allows."""
    held = outcome["metrics"]["held_force"] or {}
    settle = held.get("settle_s")
    return {
        "law": law,
        "case": case,
        "member": member,
        "latency_ticks": latency,
        "verdict": outcome["verdict"],
        "fault": outcome["fault"],
        "static_error_percent": held.get("error_percent"),
        "missed": outcome["missed"],
        "peak_N": outcome["metrics"]["peak_force_N"],
        "losses": outcome["metrics"]["contact_losses_run"],
        "losses_max": losses_max,
        "saturated_ms": 1e3 * outcome["metrics"]["saturated_run_ticks"] / _core.TICKS_PER_SECOND,
        "settle_ms": None if settle is None else 1e3 * settle,
        "overshoot_percent": held.get("overshoot_percent"),
    }


@dataclass(frozen=True)
class Cut:
    """A step of safe() that was not taken: its gain, how many simulated cases failed, the first of
    them and the limits that it missed."""

    force_gain: float
    failed: int
    simulated: int
    case: str
    why: str

    @property
    def text(self):
        return (
            f"gain {self.force_gain:.3g}: {self.failed} of {self.simulated} not stable, "
            f"{self.case}: {self.why}"
        )


def why(row):
    """What a simulated case missed, in one line: each limit with its number and unit."""
    found = []
    for one in row["missed"]:
        if one["limit"] == "fault":
            found.append(f"fault {row['fault']}")
            continue
        value = "never" if one["value"] is None else f"{one['value']:.3g}"
        unit = one["unit"] and f" {one['unit']}"
        limit = f"{one['limit']} {value}{unit}"
        found.append(limit + (f" of {one['bound']:.3g}{unit}" if one["bound"] else ""))
    return ", ".join(found)


def most_losses(rows) -> int:
    """Of contact, in a simulated touch-down of the design, of all members; 0 without one."""
    return max((r["losses"] for r in rows if r["losses_max"] is not None), default=0)


def unstable(rows):
    return [r for r in rows if r["verdict"] != "stable" or r["fault"] != "none"]
