"""Prior knowledge from the model of an axis: priors of its parameters, and the largest DAC codes
with which the drive stays linear."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from forceaxis import linear, toml
from forceaxis.design import model_file
from forceaxis.design.model_file import Given, ModelLink
from forceaxis.errors import ParameterError
from forceaxis.linear import plant_set, posterior, working
from forceaxis.linear.posterior import Posterior

# Prior standard deviations of the logarithms of masses, drive constants and stiffnesses.
MASS_SPREAD, DRIVE_SPREAD, STIFFNESS_SPREAD = 0.1, 0.1, 0.2
DAMPING_SPREAD, WORKPIECE_SPREAD = math.log(2), math.log(5)
# prior standard deviation of the logarithm of a value that the user gives without its accuracy
GIVEN_SPREAD = 0.05
# {key of the table [drive]: prior standard deviation of the logarithm of its value}.
# A data sheet states constants of the motor and scales of the command accurately.
# The bandwidth of a loop depends on the settings of the drive and on the load.
DRIVE_SPREADS = {
    **dict.fromkeys(
        ("k_torque", "k_force", "k_preamp_cmd", "k_preamp_fdbk", "a_preamp_fdbk", "k_amp",
         "current_per_volt", "velocity_per_volt", "force_per_volt"), DRIVE_SPREAD,
    ),
    **dict.fromkeys(
        ("bandwidth", "k_velocity", "integral_time", "damping_ratio", "tuned_inertia",
         "k_act", "a_act", "holding_force"), 0.2,
    ),
    "current_bandwidth": 0.3, "damping": 0.3, "tuned_mass": 0.1,
}  # fmt: skip
# Smallest standard deviation of a prior that was read from a posterior.
# The prior must not be narrower, because a machine changes a little from day to day.
POSTERIOR_SPREAD_MIN = 0.01
# INTEGRAL_RATIO: smallest force per DAC code at STEADY_HZ of a drive with an integral.
# The force at STEADY_HZ is divided by the force in the band INTEGRAL_BAND_HZ.
INTEGRAL_RATIO = 10.0
INTEGRAL_BAND_HZ = (1.0, 100.0)  # frequency band in which a drive without an integral has one force
# Time step in s of a step response, and its number of time steps.
# The step response reaches its peak within a few time constants.
STEP_S, STEP_COUNT = 1e-5, 300
STEADY_HZ = 0.02  # at this low frequency in Hz, the axis moves with its steady speed
# Largest DAC code of noise, divided by the largest step at which the drive stays linear.
# This factor of the noise is above 1 because the noise rarely reaches its peak.
NOISE_PEAK_FACTOR = 2
# The excitation by noise may use this fraction of the limit of the drive.
# A step from one noise value to the next is up to twice the amplitude.
LINEAR_SHARE = 0.7
ZERO_S = 0.06  # time in s in which the first motion test has the axis stand without a command
# Smallest compliance behind the contact, divided by the compliance of the contact.
# Below this ratio of compliances, a workpiece that always sticks cannot be detected.
SUPPORT_COMPLIANCE_SHARE = 0.3


@dataclass(frozen=True)
class Prior:
    """Prior knowledge of a parameter: a value above 0, and the standard deviation of the logarithm
    of this value. `surmised`: True if value and standard deviation come from a data sheet or a
    rough estimate. A distant fitted value is then a reason to doubt them."""

    value: float
    spread: float
    surmised: bool = False

    @property
    def wide(self) -> bool:
        """Returns True if the standard deviation is so large that the value is nearly unknown."""
        return self.spread > 1.0


def drive_parameters(model: str | Path) -> list[str]:
    """Returns the names that the table [drive] of a model gives in place of numbers."""
    given = [getattr(model_file.read(model).drive, key) for key in DRIVE_SPREADS]
    return [name for name in given if isinstance(name, str)]


def exact_parameters(model: str | Path) -> list[str]:
    """Returns the names of the parameters that do not change: the speed of a stepper follows from
    its pulses."""
    drive = model_file.read(model).drive
    speed = getattr(drive, "velocity_per_volt", None)
    return [speed] if drive.type == "stepper" and isinstance(speed, str) else []


def priors(
    model: str | Path, over: Sequence[str] = (), given: Sequence[str] = (),
    overrides: linear.Overrides | None = None,
) -> dict[str, Prior]:  # fmt: skip
    """Returns {parameter: Prior} of a model. Masses, drive constants and contact constants have the
    accuracy of a data sheet. The workpiece and the parameters in `over` are nearly unknown, unless
    `over` names the file of a posterior. In this case, the posterior becomes the prior of its
    parameters.

    given: texts NAME=VALUE+-PERCENT%, or NAME=VALUE with the accuracy GIVEN_SPREAD of a value that
    somebody has measured. Raises InputError.
    """
    known = linear.facts(model, overrides).parameters
    tables = model_file.read(model)
    drive, workpiece = tables.drive, tables.workpiece
    spreads: dict[str, float] = {}

    def add(name: Given | None, spread: float) -> None:
        if isinstance(name, str) and name in known and known[name].value > 0:
            spreads[name] = max(spread, spreads.get(name, 0.0))

    for body in tables.bodies:
        add(body.mass, WORKPIECE_SPREAD if body.name == workpiece else MASS_SPREAD)
    for link in (*tables.springs, *tables.dampers, *tables.contacts, *tables.backlashes):
        is_support = link not in tables.contacts and workpiece in link.between
        add(link.stiffness, WORKPIECE_SPREAD if is_support else STIFFNESS_SPREAD)
        add(link.damping, WORKPIECE_SPREAD if is_support else DAMPING_SPREAD)
    for key, spread in DRIVE_SPREADS.items():
        add(getattr(drive, key), spread)
    texts = [part for text in over for part in text.split(",")]
    files = [text for text in texts if posterior.is_posterior(text)]
    for name in plant_set.ranges_of(model, [t for t in texts if t not in files], overrides):
        add(name, WORKPIECE_SPREAD)
    found = {name: Prior(known[name].value, spread, True) for name, spread in spreads.items()}
    for file in files:
        # this call raises InputError for an unknown name of a parameter
        plant_set.ranges_of(model, [file], overrides)
        found |= _of_posterior(posterior.read(file))
    for text in given:
        name, _, value = text.partition("=")
        value, _, percent = value.partition("+-")
        try:
            share = float(percent.removesuffix("%")) / 100 if percent else GIVEN_SPREAD
            prior = Prior(float(value), share)
        except ValueError:
            prior = Prior(0.0, 0.0)
        if name not in known or not (0 < prior.value < math.inf and 0 < prior.spread < math.inf):
            raise ParameterError(
                "priors",
                f"{text}: expected NAME=VALUE or NAME=VALUE+-PERCENT% with numbers above 0, where "
                f"NAME is one of {', '.join(sorted(known))}",
            )
        found[name] = prior
    return found


def _of_posterior(known: Posterior) -> dict[str, Prior]:
    """Returns the parameters of a posterior as priors."""
    deviations = np.std(np.log(known.table), axis=0)
    return {
        name: Prior(best, max(float(deviation), POSTERIOR_SPREAD_MIN))
        for name, best, deviation in zip(known.names, known.best, deviations, strict=True)
    }


def _drive_limits(
    model: str | Path, overrides: linear.Overrides | None = None
) -> list[tuple[str, float]]:
    """Returns all limits of the drive in a model, as pairs of a signal and its limit in SI
    units."""
    facts, drive = linear.facts(model, overrides), model_file.read(model).drive
    limits = (("drive.voltage", drive.supply_limit), ("drive.current_command", drive.preamp_limit))
    found = [
        (signal, limit) for signal, given in limits
        if signal in facts.signals
        and (limit := working.number(given, facts.parameters)) is not None
    ]  # fmt: skip
    step = working.number(drive.full_step, facts.parameters)
    # this limit is the end of the first segment of the force of a stepper, whose period is 4 steps
    if step is not None:
        found.append(("drive.load_angle", 4 * step / drive.segments))
    return found


def linear_codes(model: str | Path, overrides: linear.Overrides | None = None) -> float:
    """Returns the largest DAC code of an excitation by noise that keeps voltage and current of the
    drive within their limits. Returns infinity if the model has no limits. Above a limit, the gain
    of the amplifier would decrease."""
    volts_per_code = linear.facts(model, overrides).volts_per_code
    found = []
    for signal, limit in _drive_limits(model, overrides):
        step = linear.linearise(model, outputs=(signal,), overrides=overrides).sampled(dt=STEP_S)
        x, peak = np.zeros(len(step.A)), abs(step.D[0, 0])
        for _ in range(STEP_COUNT):
            x = step.A @ x + step.B[:, 0]
            peak = max(peak, abs((step.C @ x)[0] + step.D[0, 0]))
        found.append(LINEAR_SHARE * limit / (peak * volts_per_code))
    return max(1, int(min(found))) if found else math.inf


def newton_per_code(
    model: str | Path, overrides: linear.Overrides | None = None, hz: float = STEADY_HZ
) -> float:
    """Returns the force of the drive in N per DAC code at the frequency `hz`, while the body of the
    drive is held at standstill. At a low frequency, the force of a drive with an integral is
    large."""
    facts = linear.facts(model, overrides)
    # The body stays at standstill if an additional force balances the force of the command.
    inputs, outputs = ("drive.command", "drive.force"), (f"{facts.required_drive.body}.velocity",)
    plant = linear.linearise(str(model), inputs, outputs, overrides, free=True)
    of_command, of_force = plant.at(2j * math.pi * hz).ravel()
    return float(abs(of_command / of_force)) * facts.volts_per_code


def has_integral(
    model: str | Path, band_hz: tuple[float, float], overrides: linear.Overrides | None = None
) -> bool:
    """Returns True if the force of the drive at a constant DAC code grows with time, as in a drive
    with an integral. `band_hz`: frequency band of the measured responses."""
    middle = newton_per_code(model, overrides, math.sqrt(math.prod(band_hz)))
    return newton_per_code(model, overrides) > INTEGRAL_RATIO * middle


class CurrentSensor(NamedTuple):
    """The measured current of a drive: its ADC code without current, and the force of the drive in
    N that one ADC code means."""

    zero_code: float
    newton_per_code: float


def current_sensor(
    model: str | Path, overrides: linear.Overrides | None = None
) -> CurrentSensor | None:
    """Returns how the measured current of a model shows the force of its drive. Returns None if the
    model has no ADC for the current, or a drive without a current."""
    facts, adc = linear.facts(model, overrides), model_file.read(model).current_adc
    values = facts.required_drive.values
    if adc is None:
        return None
    newton_per_amp = values.get("k_force")
    if newton_per_amp is None and "k_torque" in values:
        newton_per_amp = values["k_torque"] / values["r_trans"]
    amp_per_code = working.number(adc.per_count, facts.parameters)
    zero_code = working.number(adc.zero_code, facts.parameters)
    if newton_per_amp is None or not amp_per_code or zero_code is None:
        return None
    return CurrentSensor(zero_code, newton_per_amp * amp_per_code)


@dataclass(frozen=True)
class KnownDrive:
    """Properties of a drive that follow from its model: its force in N per DAC code in the
    frequency band of the responses, its speed out of contact in counts/s per DAC code, and its
    measured current. The numbers are 0, and the current is None, if they are not known."""

    newton_per_code: float = 0.0
    rate: float = 0.0
    current: CurrentSensor | None = None


def drive(
    model: str | Path, band_hz: tuple[float, float], overrides: linear.Overrides | None = None
) -> KnownDrive:
    """Returns the properties of a drive that follow from its model. The current is used only for a
    drive with an integral, because a DAC code has a finer resolution than a current."""
    integral = has_integral(model, band_hz, overrides)
    return KnownDrive(
        newton_per_code(model, overrides, math.sqrt(math.prod(band_hz))),
        abs(code_rate(model, overrides)),
        current_sensor(model, overrides) if integral else None,
    )


@dataclass(frozen=True)
class Weight:
    """The weight of an axis by its model: the force of gravity along the axis in N, positive toward
    the workpiece, and the force of the drive at standstill in N per DAC code. This force is
    infinity for a drive whose velocity loop has an integral. `engage_s`: time in s until the brake
    holds, 0 without a brake. `fall_m`: way in m of an axis without friction in this time, which
    turns its rotor as it falls.
    `sag_counts`: way in encoder counts until a drive with an integral holds the weight after its
    brake has opened, 0 for other drives. `drift_counts`: way in encoder counts in ZERO_S for each
    DAC code that the output is beside the weight, 0 for a drive with an integral."""

    newton: float
    newton_per_code: float
    engage_s: float = 0.0
    fall_m: float = 0.0
    sag_counts: float = 0.0
    drift_counts: float = 0.0

    @property
    def codes(self) -> float:
        """Returns the DAC code that holds the weight. A drive with an integral needs none."""
        return -self.newton / self.newton_per_code

    def driven_fall_m(self, share: float, m_per_s_per_code: float) -> float:
        """Returns the way in m until the brake holds, while the output leaves `share` of the weight
        and the damping of drive and guide acts. `m_per_s_per_code`: steady speed out of contact."""
        way = share * self.fall_m
        final = share * abs(self.codes) * m_per_s_per_code
        if not way or not final:
            return way
        time_s = final * self.engage_s**2 / (2 * way)  # time constant of mass and damping
        return final * (self.engage_s + time_s * math.expm1(-self.engage_s / time_s))


def weight(model: str | Path, overrides: linear.Overrides | None = None) -> Weight:
    """Returns the weight of the axis of a model: the sum of all [[gravity]] elements, a
    counterbalance included. If the acceleration depends on the position, its first value
    counts."""
    parameters = linear.facts(model, overrides).parameters
    table = toml.read(str(model))
    masses = {body["name"]: body["mass"] for body in table.get("body", ())}
    total = sag = 0.0
    weighed: set[str] = set()
    holds = has_integral(model, INTEGRAL_BAND_HZ, overrides)
    for row in table.get("gravity", ()):
        given = row["acceleration"]
        acceleration = working.number(given[0] if isinstance(given, list) else given, parameters)
        mass = working.number(masses.get(row["body"]), parameters)
        newton = (acceleration or 0.0) * (mass or 0.0)
        total += newton
        weighed.add(row["body"])
        if holds and newton:
            pull = (f"{row['body']}.force",)
            plant = linear.linearise(str(model), pull, ("encoder",), overrides, free=True)
            sag += newton * plant.at(2j * math.pi * STEADY_HZ).item().real
    engages = [
        working.number(row.get("engage"), parameters) or 0.0 for row in table.get("brake", ())
    ]
    engage_s = max(engages, default=0.0)
    falling = [working.number(masses.get(body), parameters) for body in _joined(model, weighed)]
    moving = sum(mass or 0.0 for mass in falling)
    fall_m = abs(total / moving) * engage_s**2 / 2 if moving else 0.0
    per_code = math.inf if holds else newton_per_code(model, overrides)
    drift = 0.0
    if total and moving and not holds:
        free_counts = (
            per_code
            / moving
            * ZERO_S**2
            / 2
            * abs(linear.facts(model, overrides).required_encoder.scale)
        )
        drift = min(free_counts, abs(code_rate(model, overrides)) * ZERO_S)
    return Weight(total, per_code, engage_s, fall_m, abs(sag), drift)


def _joined(model: str | Path, bodies: Iterable[str]) -> list[str]:
    """Returns the names of the bodies that move with `bodies` while all contacts are open, and
    these. A transmission is a spring or a backlash, so a reflected rotor is one of them."""
    tables, moved = model_file.read(model), set(bodies)
    links = (*tables.springs, *tables.backlashes)
    while more := {
        end for link in links if moved & set(link.between) for end in link.between
    } - moved - {"ground"}:  # fmt: skip
        moved |= more
    return sorted(moved)


def code_rate(model: str | Path, overrides: linear.Overrides | None = None) -> float:
    """Returns the steady speed of the axis out of contact, in encoder counts/s per DAC code."""
    s = 2j * math.pi * STEADY_HZ
    plant = linear.linearise(str(model), outputs=("encoder",), overrides=overrides, free=True)
    speed = float((s * plant.at(s).item()).real)  # speed of the axis per volt of the command
    return speed * linear.facts(model, overrides).volts_per_code


def rigid_counts(model: str | Path, overrides: linear.Overrides | None = None) -> float:
    """Returns the compliance of the axis in counts/N while the workpiece sticks to its table. It is
    the compliance of the spring in the contact. Returns 0 if the workpiece never moves in the
    model, or moves little, so that the compliance does not show whether it sticks."""
    rigid = contact_counts(model, overrides)
    return rigid if behind_counts(model, overrides) > SUPPORT_COMPLIANCE_SHARE * rigid else 0.0


def contact_counts(model: str | Path, overrides: linear.Overrides | None = None) -> float:
    """Returns the deflection in counts/N of the spring in the contact, or 0 if the model has no
    such spring with a stiffness."""
    return _counts_per_newton(model, overrides, model_file.read(model).contact)


def behind_counts(model: str | Path, overrides: linear.Overrides | None = None) -> float:
    """Returns the deflection in counts/N of the spring between workpiece and ground. Returns 0 if
    the model does not have exactly one such spring."""
    return _counts_per_newton(model, overrides, model_file.read(model).support)


def _counts_per_newton(
    model: str | Path, overrides: linear.Overrides | None, link: ModelLink | None
) -> float:
    """Returns the deflection of a spring in encoder counts per N. Returns 0 if there is no spring
    with a stiffness."""
    facts = linear.facts(model, overrides)
    stiffness = working.number(link.stiffness, facts.parameters) if link else None
    return abs(facts.required_encoder.scale) / stiffness if stiffness else 0.0


def states_of(model: str | Path, states: dict[str, str]) -> dict[str, str]:
    """Returns only those entries of `states`, {element: state}, whose element is in the model. For
    example, a model in which dampers replace dry friction has no states of friction."""
    switches = linear.facts(model).switches
    return {name: state for name, state in states.items() if name in switches}


def states_apart(model: str | Path, states: dict[str, str]) -> dict[str, str]:
    """Returns `states`, {element: state}, without the contacts of the model. These contacts are
    open when the axis is out of contact."""
    contacts = {contact.name for contact in linear.facts(model).contacts}
    return {name: state for name, state in states.items() if name not in contacts}


def play_counts(model: str | Path, overrides: linear.Overrides | None = None) -> int:
    """Returns the total backlash of a model in encoder counts. Returns 0 if the model has no
    backlash or no encoder."""
    facts = linear.facts(model, overrides)
    if facts.encoder is None:
        return 0
    widths = [
        working.number(part.width, facts.parameters) for part in model_file.read(model).backlashes
    ]
    return math.ceil(sum(width or 0.0 for width in widths) * abs(facts.encoder.scale))


class SineBounds:
    """Computes the largest amplitude of a sine with which the drive of a model stays within its
    limits."""

    def __init__(self, model: str | Path) -> None:
        volts_per_code = linear.facts(model).volts_per_code
        self._limits = [
            (linear.linearise(model, outputs=(signal,)), LINEAR_SHARE * limit / volts_per_code)
            for signal, limit in _drive_limits(model)
        ]

    def codes(self, hz: float) -> int:
        """Returns the largest amplitude in DAC codes at a frequency in Hz. The result is at least
        1."""
        found = [limit / abs(plant.response([hz])[0]) for plant, limit in self._limits]
        return max(1, int(min([*found, 2047.0])))
