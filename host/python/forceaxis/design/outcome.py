"""Request and result of a design, and tables of its simulated contacts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from forceaxis import paths, words
from forceaxis.design.banks import BankFigures, bank_figures
from forceaxis.design.cases import GainCut, SimulatedContact
from forceaxis.design.certificate import P, WorstFigures
from forceaxis.design.friction import FrictionRange
from forceaxis.design.grid import RAMP_MIN_S, Goal
from forceaxis.design.search import StructureDesign
from forceaxis.linear.bank import Bank
from forceaxis.linear.plant_set import PlantSet
from forceaxis.linear.working import Working
from forceaxis.results import json_field
from forceaxis.words import counted

# {latency of the request: values of latency_ticks}
LATENCIES = {"both": (0, 1), "0": (0,), "1": (1,)}
TIMINGS = ("zoh", "zoh+1")  # names of the delays in loops.TIMINGS for a latency of 0 and of 1 tick
MEMBERS = 12  # number of random plants on which contacts are simulated


LATE = 1.1  # largest permitted Ms with one tick of latency, relative to Ms without latency


@dataclass(frozen=True)
class DesignOrder:
    """The request for a design: model, set of plants, margins and simulated contacts."""

    text: str  # the model or experiment, as a path or a name
    over: tuple[str, ...] = ()  # tolerances as texts NAME=PERCENT% or NAME=LOW..HIGH
    # changed parameters: {parameter: value}
    overrides: Mapping[str, float | str] = field(default_factory=dict)
    # sets of values that change together, as in PlantSet
    together: tuple[dict[str, float], ...] = ({},)
    modes: str = "visited"
    # {element: state} that all plants of the set of plants have
    states: dict[str, str] = field(default_factory=dict)
    ms: float = 2.0  # largest permitted Ms; with one tick of latency, LATE times this value
    gain_margin: float = 2.3  # smallest permitted gain margin as a factor of the gain
    adc_bits: int | None = None  # bits of the force ADC; None: those of the model
    latency: str = "both"  # latencies of the design, a key of LATENCIES
    # largest gain at high frequency in codes per 8-bit count; None selects the default of grid.Goal
    hf_gain: float | None = None
    # ramp_s: rise time in s of a ramp of the force set-point that the force has to follow.
    # ramp_min_s: smallest rise time in s if the bandwidth of the law determines the rise time.
    ramp_s: float | None = None
    ramp_min_s: float = RAMP_MIN_S
    static_error_max: float = 1.0  # largest static error of the law as a share of the set-point
    # values of firmware objects that replace or add to the values in the experiment
    firmware: dict[str, float | str] = field(default_factory=dict)
    # Force set-points of the simulated first contacts in N.
    # Without force set-points, the ranges of sensor and drive determine them.
    forces_N: tuple[float, ...] = ()
    # approach speed; None selects the speed of the experiment, or 20 mm/s without an experiment
    approach_mm_per_s: float | None = None
    # True if the design may also reduce an approach speed that the user has given
    may_slow: bool = False
    simulate: bool = True
    threads: int | None = None

    @property
    def latencies(self) -> tuple[int, ...]:
        """Returns the values of `latency_ticks` for which the design has to keep the margins."""
        return LATENCIES[self.latency]

    def goal(self, adc_bits: int) -> Goal:
        """Returns the required margins of this request for an ADC of `adc_bits` bits."""
        return Goal(
            ms=self.ms, ms_late=LATE * self.ms, gain_margin=self.gain_margin, adc_bits=adc_bits,
            timings=tuple(TIMINGS[latency] for latency in self.latencies), hf_gain=self.hf_gain,
            ramp_s=self.ramp_s, ramp_min_s=self.ramp_min_s, static_error_max=self.static_error_max,
        )  # fmt: skip


@dataclass(frozen=True)
class ContactLoss:
    """The selected limits after a contact loss, and the impacts that the control law tolerates with
    these limits.

    contact_loss_cap: DAC codes. contact_loss_dwell: ms. The impulses are in N s. strike_N_s: every
    impact up to this impulse is stable at both lower set-points. strike_default_N_s: the same
    impulse with the default limits of the firmware. strike_hardest_N_s: largest simulated impulse.
    An impulse of 0 means that even the smallest simulated impact is unstable.
    """

    contact_loss_cap: int
    contact_loss_dwell: int
    strike_N_s: float
    strike_default_N_s: float
    strike_hardest_N_s: float

    @property
    def objects(self) -> dict[str, int]:
        """Returns the limits after a contact loss as {firmware object: value}."""
        return {
            "contact_loss_cap": self.contact_loss_cap,
            "contact_loss_dwell": self.contact_loss_dwell,
        }

    @property
    def text(self) -> str:
        """Returns a sentence about the impacts that the law tolerates. The impulse has the prefix
        ">=" if the largest simulated impact is stable."""
        own, default = (
            (">= " if impulse == self.strike_hardest_N_s else "") + f"{impulse:.3g}"
            for impulse in (self.strike_N_s, self.strike_default_N_s)
        )
        return f"tolerates impacts of {own} N s, {default} with the firmware's defaults"


@dataclass(frozen=True)
class SlowedApproach:
    """A reduction of the approach speed because contacts were lost.

    `losses_before` is the largest number of contact losses in a simulated first contact at the
    original speed, and `losses` is that at the reduced speed. `longer_s` is the additional time in
    s until the first contact.
    """

    from_m_per_s: float
    to_m_per_s: float
    # number of contact losses at the original speed; None: the force does not settle at that speed
    losses_before: int | None
    losses: int
    longer_s: float

    @property
    def text(self) -> str:
        """Returns a sentence about the slower approach for a terminal or an HTML page."""
        before = "contacts do not settle"
        if self.losses_before is not None:
            before = f"a first contact is lost {counted(self.losses_before, 'time')}"
        return (
            f"{1e3 * self.to_m_per_s:.3g} mm/s, because at {1e3 * self.from_m_per_s:.3g} mm/s "
            f"{before}; now {counted(self.losses, 'time')} at most, and the first contact is "
            f"{self.longer_s:.3g} s later"
        )


@dataclass(frozen=True, kw_only=True)
class DesignResult:
    """The result of a design. A tuning also stores it.

    over: {parameter: (nominal, low, high)} in SI units. together: {parameter: SI value} of the
    parameters that change together. modes: {element: state} of each mode. friction_N: {parameter:
    (low, high)} in the simulated contacts. gain_reductions: number of reductions of the gain by a
    tenth. passed_over: {structure of the law: reason why it was not chosen}.
    """

    model: str
    over: dict[str, tuple[float, float, float]]
    together: list[dict[str, float]]
    modes: list[dict[str, str]]
    friction_N: dict[str, tuple[float, float]]
    adc_bits: int
    bank: BankFigures
    worst: WorstFigures
    p: P
    simulated: list[SimulatedContact]
    structures: list[StructureDesign]
    chosen: str
    limited_by: str
    contact_loss: ContactLoss | None
    gain_reductions: int
    passed_over: dict[str, str]
    gain_cuts: list[GainCut]
    approach_slowed: SlowedApproach | None
    out: str | None
    files: list[str]
    mode: dict[str, str] | None = json_field(omit_none=True)
    mode_text: str | None = json_field(omit_none=True)


@dataclass
class DesignOutcome:
    """The data of a design, which its three steps fill: the search for the law, the simulation, and
    the writing of files."""

    order: DesignOrder
    plants: PlantSet
    units: dict[str, str]  # units of the parameters: {parameter: unit}
    bits: int
    bank: Bank
    worst: WorstFigures
    p: P
    structures: list[StructureDesign]
    chosen: str
    limited_by: str
    loss: ContactLoss | None = None
    rows: list[SimulatedContact] = field(default_factory=list)
    cuts: list[GainCut] = field(default_factory=list)
    # {structure of the law: reason why the design does not use it}
    passed_over: dict[str, str] = field(default_factory=dict)
    out: str | None = None
    written: list[str] = field(default_factory=list)
    working: Working = field(default_factory=lambda: Working({}))
    frictions: tuple[FrictionRange, ...] = ()  # friction ranges in the simulated contacts
    slowed: SlowedApproach | None = None

    @property
    def ranges(self) -> dict[str, tuple[float, float, float]]:
        """Returns {parameter: (nominal, low, high)} for the set of plants."""
        return self.plants.ranges

    @property
    def backoffs(self) -> int:
        """Returns how many times the simulation has reduced the gain by a tenth."""
        return len(self.cuts)

    @property
    def p_bank(self) -> Bank:
        """Returns the P law with the largest gain that keeps the margins of the design. The gain is
        0 if no gain keeps the margins."""
        return Bank(self.p.force_gain)

    @property
    def loss_objects(self) -> dict[str, int]:
        """Returns the limits after a contact loss as {firmware object: value}. The result is empty
        without a simulation."""
        return self.loss.objects if self.loss else {}

    def result(self) -> DesignResult:
        """Returns the design in the form of its JSON result."""
        shown = self.working if self.working.text else None
        return DesignResult(
            model=paths.display(Path(self.plants.model)),
            over=self.ranges,
            together=[one for one in self.plants.together if one],
            modes=list(self.plants.modes),
            friction_N={
                n: (0.0, N * one.most) for one in self.frictions for n, N in one.declared_N
            },
            adc_bits=self.bits,
            bank=bank_figures(self.bank),
            worst=self.worst,
            p=self.p,
            simulated=self.rows,
            structures=self.structures,
            chosen=self.chosen,
            limited_by=self.limited_by,
            contact_loss=self.loss,
            gain_reductions=self.backoffs,
            passed_over=self.passed_over,
            gain_cuts=self.cuts,
            approach_slowed=self.slowed,
            out=self.out,
            files=self.written,
            mode=dict(shown.modes) if shown else None,
            mode_text=shown.text if shown else None,
        )


def number(value: float | None, digits: int = 3) -> str:
    """Returns a number as text for a table, or "-" for None."""
    return "-" if value is None else words.plain(value, digits)


CASE_HEAD = [
    "simulated", "law", "stable", "static error %", "peak N", "losses", "settle ms", "overshoot %",
    "worst peak N", "saturated ms",
]  # fmt: skip


def cases(contacts: Sequence[SimulatedContact]) -> list[list[str]]:
    """Returns the rows of a table of simulated contacts with the columns CASE_HEAD. Each row
    belongs to one kind of contact and one control law.

    A row has the number of stable contacts, and values of the nominal plant at the first latency.
    Contact losses, worst peak force and saturation are the largest values of all contacts.
    """
    grouped: dict[tuple[str, str], list[SimulatedContact]] = {
        (one.case, law): [] for one in contacts for law in ("design", "p")
    }
    for one in contacts:
        grouped[one.case, one.law].append(one)
    lines = []
    for (case, law), own in grouped.items():
        if not own:
            continue
        first = own[0]
        losses = max(one.losses for one in own)
        lines.append([
            case, law, f"{sum(one.verdict == 'stable' for one in own)} of {len(own)}",
            number(first.static_error_percent), number(first.peak_N),
            str(losses) if first.losses_max is None else f"{losses} of {first.losses_max}",
            number(first.settle_ms), number(first.overshoot_percent),
            number(max(one.peak_N for one in own)), number(max(one.saturated_ms for one in own)),
        ])  # fmt: skip
    return lines
