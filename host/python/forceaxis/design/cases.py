"""Simulated contacts: the cases, the figures of a run, and the gains that were reduced for them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from forceaxis import _core
from forceaxis.experiments.run_result import Metrics, MissedLimit, read_metrics, read_missed


@dataclass(frozen=True)
class ContactCase:
    """A first contact at a force set-point in N and an approach speed in m/s; with `strike_N_s`
    above 0 an impact of that impulse follows."""

    setpoint_N: float
    speed_m_per_s: float
    strike_N_s: float = 0.0

    @property
    def name(self) -> str:
        """Such as "contact 30 N at 20 mm/s, strike 0.25 N s"."""
        text = f"contact {self.setpoint_N:.3g} N at {1e3 * self.speed_m_per_s:.3g} mm/s"
        return text + (f", strike {self.strike_N_s:.3g} N s" if self.strike_N_s else "")


class NamedCase(NamedTuple):
    """The user's own experiment as a case, under the name of its file."""

    name: str


class Outcome:
    """What both forms of a simulated contact have: its verdict and the fault of the firmware."""

    verdict: str
    fault: str

    @property
    def is_stable(self) -> bool:
        """Whether the verdict is stable and the firmware reports no fault."""
        return self.verdict == "stable" and self.fault == "none"


@dataclass(frozen=True)
class ContactRun(Outcome):
    """The result of one run that a design uses."""

    verdict: str
    fault: str
    missed: tuple[MissedLimit, ...]
    metrics: Metrics


def read_run(outcome: Mapping[str, Any]) -> ContactRun:
    """The result of a run, from the outcome that `_core.run_many` gives."""
    return ContactRun(
        verdict=outcome["verdict"],
        fault=outcome["fault"],
        missed=tuple(read_missed(outcome["missed"])),
        metrics=read_metrics(outcome["metrics"]),
    )


@dataclass(frozen=True)
class SimulatedContact(Outcome):
    """A row of "simulated" in the result of `design`: a case with one law on one plant."""

    law: str  # "design" or "p"
    case: str
    member: dict[str, float]  # values of parameters in SI; empty: the nominal plant
    latency_ticks: int
    verdict: str
    fault: str
    static_error_percent: float | None  # None: the experiment controls no force
    missed: tuple[MissedLimit, ...]
    peak_N: float
    losses: int  # number of contact losses in the whole run
    saturated_ms: float
    settle_ms: float | None  # None: the force does not settle
    overshoot_percent: float | None
    losses_max: int | None = None  # contact losses that the verdict permits; None: any number


def simulated_contact(
    law: str, case: str, member: dict[str, float], latency_ticks: int, run: ContactRun,
    losses_max: int | None = None,
) -> SimulatedContact:  # fmt: skip
    """The row of a run; losses_max: contact losses that its verdict permits."""
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
    """A gain that simulate.safe() rejected: force_gain in DAC codes per 8-bit count, the number of
    failed and of simulated contacts, the first failed case and the limits that it did not keep."""

    force_gain: float
    failed: int
    simulated: int
    case: str
    why: str

    @property
    def text(self) -> str:
        """One line for a terminal or a page."""
        return (
            f"gain {self.force_gain:.3g}: {self.failed} of {self.simulated} not stable, "
            f"{self.case}: {self.why}"
        )


def why(contact: SimulatedContact) -> str:
    """The limits that a simulated contact did not keep, in one line: each with number and unit."""
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
    """Largest number of losses of contact in a simulated first contact; 0 without any."""
    return max((one.losses for one in contacts if one.losses_max is not None), default=0)


def unstable(contacts: Sequence[SimulatedContact]) -> list[SimulatedContact]:
    """The contacts that are not stable or end with a fault."""
    return [one for one in contacts if not one.is_stable]
