"""Trade-off between a soft contact and a low gain (thesis section 6.2.1): computes how the
stiffness of one element of the model affects the force loop.

A softer pad, sensor or workpiece permits a higher gain but lowers the loop gain, and the axis moves
farther until it reaches its force. For each stiffness, the result has the bandwidth over the set of
plants for the P law and for a bank that is designed for this stiffness (`reduced`), at the same
margins. It also has the static error of P, the travel from first contact to the set-point, and the
largest impact that each of the two laws tolerates in a simulation with the firmware.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forceaxis import paths, progress
from forceaxis._core import InputError
from forceaxis.design import friction, model_file, sets, simulate
from forceaxis.design.cases import ContactCase
from forceaxis.design.changes import Design
from forceaxis.design.grid import goal_of_noise
from forceaxis.design.reduced import ShortSearch
from forceaxis.design.simulate import ContactBench, Plant
from forceaxis.errors import ParameterError
from forceaxis.linear import system as linear
from forceaxis.linear.bank import Bank, BankKeys
from forceaxis.linear.plant_facts import Overrides
from forceaxis.results import json_field

SPAN = (1 / 20, 4.0)  # lowest and highest stiffness, as multiples of the stiffness in the model
POINTS_MAX = 40  # largest number of stiffness values in the series
# Factors by which the impulses of the simulated impacts in simulate.py are multiplied.
STRIKE_FACTORS = np.geomspace(0.25, 64.0, 9)
# number of impulses that are simulated together before their results are checked
STRIKES_AT_ONCE = 3
# Frequency at which the static response is computed. At 0 Hz the response may be infinite.
STATIC_HZ = 0.01


@dataclass(frozen=True)
class CompliancePoint:
    """The results for one stiffness in N/m, or None if no gain keeps the margins. Fields with the
    prefix `p_` belong to the P law. All other fields belong to the filter bank that is designed for
    this stiffness."""

    stiffness: float
    p_fS_Hz: float | None
    fS_Hz: float | None
    p_static_error: float | None  # static error with the P law as a share of the set-point
    static_error: float | None
    motion_m: float  # travel of the drive in m from the first contact to the force set-point
    # impulse of the largest stable impact; 0 if the smallest simulated impact is unstable
    p_strike_N_s: float | None
    strike_N_s: float | None
    p_bank: BankKeys | None
    bank: BankKeys | None
    refused: str | None = json_field(omit_none=True)  # reason why no control law keeps the margins


@dataclass(frozen=True, kw_only=True)
class Compliance:
    """Margins of the force loop for several values of a stiffness. `present`: stiffness in the
    model in N/m. `over`: tolerances of the set of plants. `strike_max_N_s`: impulse of the largest
    simulated impact in N s."""

    model: str
    element: str
    unit: str
    present: float
    over: list[str]
    adc_bits: int
    setpoint_N: float
    strike_max_N_s: float
    rows: list[CompliancePoint]
    mode: dict[str, str] | None = json_field(omit_none=True)
    mode_text: str | None = json_field(omit_none=True)


@dataclass(frozen=True)
class ComplianceOrder:
    """The request for a Compliance: model, element with the stiffness, stiffness values and set of
    plants."""

    text: str  # the model or experiment, as a path or a name
    # name of a stiffness parameter in N/m; None: stiffness of the contact
    element: str | None = None
    overrides: Mapping[str, float | str] | None = None
    # tolerances as texts NAME=PERCENT%; None selects the tolerances of `sets.workpiece`
    over: Sequence[str] | None = None
    # (lowest, highest) stiffness in N/m; None selects SPAN times the stiffness in the model
    span: tuple[float, float] | None = None
    points: int = 9
    bits: int | None = None  # bits of the force ADC; None: those of the model
    threads: int | None = None
    # {element: state} that all plants of the set of plants have
    states: Mapping[str, str] | None = None


def element_of(model: str | Path, overrides: Overrides) -> str:
    """Returns the name of the parameter that is the stiffness of the contact. Raises InputError if
    the model file contains a number in place of a parameter."""
    contact = model_file.read(model).contact
    name = contact.stiffness if contact else None
    if not isinstance(name, str) or name not in linear.facts(model, overrides).parameters:
        raise ParameterError(
            "element",
            "expected the name of a stiffness parameter, because the stiffness of the contact in "
            f"{model} is a number",
        )
    return name


def compliance(order: ComplianceOrder) -> Compliance:
    """Returns the results of the P law and of a designed filter bank for each stiffness. Raises
    InputError."""
    element, span, points, states = order.element, order.span, order.points, order.states
    with Design(order.text, order.overrides, states=states) as design:
        design.require_force_sensor()
        element = element or element_of(design.model, design.overrides)
        known = design.facts.parameters
        if element not in known or known[element][1] != "N/m":
            stiff = sorted(n for n, (_, unit) in known.items() if unit == "N/m")
            raise ParameterError(
                "element",
                f"expected the name of a stiffness, one of {', '.join(stiff)}, got {element}",
            )
        own = known[element][0]
        low, high = span or (own * SPAN[0], own * SPAN[1])
        if not (0 < low < high and 2 <= points <= POINTS_MAX):
            raise ParameterError(
                "lowest", f"expected 0 < `lowest` < `highest` and 2 to {POINTS_MAX} `points`, got "
                f"`lowest` {low:g}, `highest` {high:g} and {points} `points`",
            )  # fmt: skip
        over = tuple(
            sets.workpiece(design.model, design.overrides) if order.over is None else order.over
        )
        bits = order.bits or design.facts.required_reading.bits
        bench = ContactBench(design, bits)
        setpoint, hardest = bench.setpoints_N[1], _strikes(bench)[1][-1]
        overrides, mode = design.overrides, design.working()
    given = replace(order, overrides=overrides, over=over, bits=bits)
    rows = [
        _point(given, element, float(value), setpoint)
        for value in progress.each(np.geomspace(low, high, points), "stiffnesses")
    ]
    return Compliance(
        model=paths.display(design.model),
        element=element,
        unit="N/m",
        present=own,
        over=list(over),
        adc_bits=bits,
        setpoint_N=setpoint,
        strike_max_N_s=hardest,
        rows=rows,
        mode=dict(mode.modes) if mode.text else None,
        mode_text=mode.text or None,
    )


def _point(order: ComplianceOrder, element: str, value: float, setpoint: float) -> CompliancePoint:
    overrides = {**(order.overrides or {}), element: value}
    with Design(order.text, overrides, states=order.states) as design:
        plants = sets.plant_set(design.model, design.overrides, order.over, fixed=design.states)
        motion_m = setpoint * motion(design)
        bits = order.bits or design.facts.required_reading.bits
        try:
            problem = ShortSearch(plants, goal_of_noise(bits, design.noise_codes(bits)), random=0)
        except InputError as error:  # One plant of the set of plants is unstable at every gain.
            nothing = None, None, None, None
            return CompliancePoint(value, *nothing, motion_m, *nothing, refused=str(error))
        p, found = problem.worst(Bank(1.0)), problem.designed()
        p_strike, strike = (
            _strike(design, bits, law.bank, order.threads) if law.worst else None
            for law in (p, found)
        )
        return CompliancePoint(
            stiffness=value,
            p_fS_Hz=p.worst.fS_Hz if p.worst else None,
            fS_Hz=found.worst.fS_Hz if found.worst else None,
            p_static_error=p.worst.static_error if p.worst else None,
            static_error=found.worst.static_error if found.worst else None,
            motion_m=motion_m,
            p_strike_N_s=p_strike,
            strike_N_s=strike,
            p_bank=p.bank.keys() if p.worst else None,
            bank=found.bank.keys() if found.worst else None,
        )


def motion(design: Design) -> float:
    """Returns the travel of the drive's body in m per newton of measured force, at standstill."""
    body = design.facts.required_drive.body
    plants = (
        linear.linearise(
            design.model, outputs=(output,), overrides=design.overrides, modes=design.states
        )
        for output in (f"{body}.position", "reading")
    )
    travel, force = (abs(plant.response(STATIC_HZ)) for plant in plants)
    return float(travel / force)


def _strike(design: Design, bits: int, bank: Bank, threads: int | None) -> float:
    """Returns the largest impulse in N s that a filter bank tolerates: all simulated impacts up to
    this impulse are stable. Returns 0 if the smallest impact is unstable."""
    bench = ContactBench(design, bits)
    bench.wait_for(bank)
    case, strikes = _strikes(bench)
    plants: list[Plant] = [{}, *friction.members(bench.frictions)]
    tolerated = 0.0
    for begin in range(0, len(strikes), STRIKES_AT_ONCE):
        some = strikes[begin : begin + STRIKES_AT_ONCE]
        jobs = [bench.job(replace(case, strike_N_s=s), bank, m, 0) for s in some for m in plants]
        good = [one.is_stable for one in simulate.run(jobs, threads or os.cpu_count() or 1)]
        for i, strike in enumerate(some):
            if not all(good[i * len(plants) : (i + 1) * len(plants)]):
                return tolerated
            tolerated = strike
    return tolerated


def _strikes(bench: ContactBench) -> tuple[ContactCase, list[float]]:
    """Returns (simulated contact with an impact at the middle force set-point, impulses in N s)."""
    case = next(c for c in bench.cases if c.strike_N_s and c.setpoint_N == bench.setpoints_N[1])
    return case, [float(s) * case.strike_N_s for s in STRIKE_FACTORS]
