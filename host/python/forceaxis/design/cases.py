"""Simulated contacts of a design: the simulated cases, the results of each run, and the gains that
were rejected because a contact was not stable."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from forceaxis import _core
from forceaxis.experiments.run_result import Metrics, MissedLimit
from forceaxis.words import plain


@dataclass(frozen=True)
class ContactCase:
    """A simulated first contact with a force set-point in N and an approach speed in m/s. If
    `strike_N_s` is above 0, an impact with this impulse in N s follows."""

    setpoint_N: float
    speed_m_per_s: float
    strike_N_s: float = 0.0

    @property
    def name(self) -> str:
        """Name of the simulated contact, such as "contact 30 N at 20 mm/s, strike 0.25 N s"."""
        text = f"contact {plain(self.setpoint_N)} N at {1e3 * self.speed_m_per_s:.3g} mm/s"
        return text + (f", strike {self.strike_N_s:.3g} N s" if self.strike_N_s else "")


class NamedCase(NamedTuple):
    """The user's experiment as a simulated contact. Its name is the file name of the experiment
    without the suffix."""

    name: str


class Outcome:
    """Common fields of the results of a simulated contact: the verdict, and the fault of the
    firmware."""

    verdict: str
    fault: str

    @property
    def is_stable(self) -> bool:
        """True if the verdict is stable and the firmware reports no fault."""
        return self.verdict == "stable" and self.fault == "none"


@dataclass(frozen=True)
class ContactRun(Outcome):
    """The results of one simulated run that a design uses."""

    verdict: str
    fault: str
    missed: tuple[MissedLimit, ...]
    metrics: Metrics


def read_run(outcome: "_core.RunOutcome") -> ContactRun:
    """Returns the result of a simulated run from the object that `_core.run_many` returns."""
    return ContactRun(
        verdict=outcome["verdict"],
        fault=outcome["fault"],
        missed=tuple(outcome["missed"]),
        metrics=outcome["metrics"],
    )


@dataclass(frozen=True)
class SimulatedContact(Outcome):
    """One row of "simulated" in the result of `design`: a contact that was simulated with one
    control law on one plant."""

    law: str  # name of the control law: "design" or "p"
    case: str
    # {parameter: value in SI units} of the simulated plant; empty for the nominal plant
    member: dict[str, float]
    latency_ticks: int
    verdict: str
    fault: str
    # static error of the force; None if the experiment controls no force
    static_error_percent: float | None
    missed: tuple[MissedLimit, ...]
    peak_N: float
    losses: int  # number of contact losses in the whole run
    saturated_ms: float
    settle_ms: float | None  # settling time of the force; None if the force does not settle
    overshoot_percent: float | None
    # largest number of contact losses that the verdict permits; None means no limit
    losses_max: int | None = None


def simulated_contact(
    law: str, case: str, member: dict[str, float], latency_ticks: int, run: ContactRun,
    losses_max: int | None = None,
) -> SimulatedContact:  # fmt: skip
    """Returns the row of a simulated run in the result of `design`. `losses_max` is the largest
    number of contact losses that the verdict permits; None means no limit."""
    metrics, held = run.metrics, run.metrics.held_force
    settle_s = held.settle_s if held else None
    return SimulatedContact(
        law=law,
        case=case,
        member=member,
        latency_ticks=latency_ticks,
        verdict=run.verdict,
        fault=run.fault,
        static_error_percent=held.error_percent if held else None,
        missed=run.missed,
        peak_N=metrics.peak_force_N,
        losses=metrics.contact_losses_run,
        losses_max=losses_max,
        saturated_ms=1e3 * metrics.saturated_run_ticks / _core.TICKS_PER_SECOND,
        settle_ms=None if settle_s is None else 1e3 * settle_s,
        overshoot_percent=held.overshoot_percent if held else None,
    )


@dataclass(frozen=True)
class GainCut:
    """A gain of a control law that was rejected because a simulated contact was not stable.

    `force_gain` is in DAC codes per 8-bit count. `failed` and `simulated` are numbers of contacts.
    `case` is the name of the first unstable contact. `why` names the limits that this contact did
    not keep.
    """

    force_gain: float
    failed: int
    simulated: int
    case: str
    why: str

    @property
    def text(self) -> str:
        """Returns a sentence about the rejected gain for a terminal or an HTML page."""
        return (
            f"gain {self.force_gain:.3g}: {self.failed} of {self.simulated} not stable, "
            f"{self.case}: {self.why}"
        )


def why(contact: SimulatedContact) -> str:
    """Returns one text line that names the limits that a simulated contact did not keep. Each limit
    has its value and unit."""
    texts = []
    for missed in contact.missed:
        if missed.limit == "fault":
            texts.append(f"fault {contact.fault}")
            continue
        value = "never" if missed.value is None else f"{missed.value:.3g}"
        unit = missed.unit and f" {missed.unit}"
        limit = f"{missed.limit} {value}{unit}"
        texts.append(limit + (f" of {missed.bound:.3g}{unit}" if missed.bound else ""))
    return ", ".join(texts)


def most_losses(contacts: Sequence[SimulatedContact]) -> int:
    """Returns the largest number of contact losses among the simulated first contacts, or 0 if no
    first contact was simulated."""
    return max((one.losses for one in contacts if one.losses_max is not None), default=0)


def unstable(contacts: Sequence[SimulatedContact]) -> list[SimulatedContact]:
    """Returns the simulated contacts whose verdict is not stable or that end with a fault."""
    return [one for one in contacts if not one.is_stable]
