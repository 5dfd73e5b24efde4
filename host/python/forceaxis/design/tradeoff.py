"""Trade-off between the bandwidth and a second property of the force loop: computes one design for
each value of this property."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from forceaxis import paths
from forceaxis.design import changes, for_set, simulate
from forceaxis.design.certificate import WorstFigures
from forceaxis.design.grid import Goal
from forceaxis.design.outcome import LATE, DesignOrder
from forceaxis.design.reduced import ShapedDesign, ShortSearch
from forceaxis.errors import ParameterError
from forceaxis.linear.bank import Bank, BankKeys
from forceaxis.results import json_field

# {name of the second property: (values of this property, text about its meaning)}
AGAINST: dict[str, tuple[tuple[float, ...], str]] = {
    "ms": (
        (1.4, 1.6, 1.8, 2.0, 2.2, 2.4, 2.6),
        "largest |S|, a tenth more with one tick of latency",
    ),
    "hf": ((2, 4, 8, 15, 30, 60, 120), "gain at high frequency, codes per 8-bit count"),
    "gain_margin": ((1.6, 1.9, 2.3, 2.7, 3.2, 4.0), "gain margin"),
}


@dataclass(frozen=True, kw_only=True)
class TradeoffRow:
    """The design for one value of the second property. Only one of the fields `ms`, `hf` and
    `gain_margin` has a value: the field of the second property. All other fields are None if no
    gain keeps the margins."""

    bandwidth_Hz: float | None
    p_bandwidth_Hz: float | None
    p_static_error: float | None
    bank: BankKeys
    worst: WorstFigures | None
    ms: float | None = json_field(omit_none=True)
    hf: float | None = json_field(omit_none=True)
    gain_margin: float | None = json_field(omit_none=True)

    @property
    def value(self) -> float:
        """Returns the value of the second property."""
        return next(v for v in (self.ms, self.hf, self.gain_margin) if v is not None)


@dataclass(frozen=True)
class Tradeoff:
    """The trade-off between bandwidth and a second property. `against`: name of the second
    property. `what`: meaning of this property."""

    model: str
    over: list[str]
    modes: list[dict[str, str]]
    adc_bits: int
    against: str
    what: str
    rows: list[TradeoffRow]


def against_of(text: str) -> str:
    """Returns the name of the second property in a text such as "bandwidth,ms". Raises InputError
    for another text."""
    names = text.split(",")
    if len(names) != 2 or names[0] != "bandwidth" or names[1] not in AGAINST:
        raise ParameterError(
            "pareto", f"expected two figures, bandwidth and one of {', '.join(AGAINST)}, got {text}"
        )
    return names[1]


def tradeoff(
    order: DesignOrder, against: str, progress: Callable[[str], None] | None = None
) -> Tradeoff:
    """Returns one design for each value of the property `against`, from the search in `reduced`.
    `order`, the request for a design, defines all other margins. Raises InputError."""
    for_set.check(order)
    values, what = AGAINST[against]
    with changes.Design(order.text, order.overrides, states=order.states) as plant:
        plant.require_force_sensor()
        bits = order.adc_bits or plant.facts.required_reading.bits
        plants = for_set.plant_set(simulate.ContactBench(plant, bits), order)
        goal = replace(order.goal(bits), hf_gain=None, ramp_s=None)
        problem = ShortSearch(plants, goal)
        known, rows = [], []
        for done, value in enumerate(values):
            if progress:
                progress(f"{against} {value:g}, {done}/{len(values)}")
            _set(problem, goal, against, value)
            known.append(problem.designed().numbers)
        # The best design for one value may also be the best design for another value.
        for value in values:
            _set(problem, goal, against, value)
            rows.append(_row(against, value, problem, problem.best_of(known)))
    return Tradeoff(
        model=paths.display(plant.model),
        over=list(order.over),
        modes=list(plants.modes),
        adc_bits=bits,
        against=against,
        what=what,
        rows=rows,
    )


def _set(problem: ShortSearch, goal: Goal, against: str, value: float) -> None:
    problem.goal = _with(goal, against, value)
    problem.inner.bounds = problem.goal.bounds()


def _with(goal: Goal, against: str, value: float) -> Goal:
    if against == "ms":
        return replace(goal, ms=value, ms_late=LATE * value)
    if against == "hf":
        return replace(goal, hf_gain=float(value), adc_bits=16)
    return replace(goal, gain_margin=value)


def _row(against: str, value: float, problem: ShortSearch, found: ShapedDesign) -> TradeoffRow:
    p = problem.worst(Bank(1.0)).worst
    return TradeoffRow(
        bandwidth_Hz=found.worst.fS_Hz if found.worst else None,
        p_bandwidth_Hz=p.fS_Hz if p else None,
        p_static_error=p.static_error if p else None,
        bank=replace(found.bank.keys(), hf_gain=found.bank.hf_gain()),
        worst=found.worst,
        ms=value if against == "ms" else None,
        hf=value if against == "hf" else None,
        gain_margin=value if against == "gain_margin" else None,
    )
