"""Creates a model and two experiments of a user's axis from data-sheet values."""

import functools
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import jinja2
import numpy as np

from forceaxis import _core, objects, paths
from forceaxis._core import InputError
from forceaxis.axis import bus_times
from forceaxis.design.data_sheet import BY_NAME, SheetValues
from forceaxis.errors import ParameterError
from forceaxis.linear.bank import BankKeys

if TYPE_CHECKING:
    from forceaxis.linear.stability import Loop

APPROACH_M_PER_S = 0.02  # largest approach speed of a new axis
MOMENTUM_SHARE = 0.1  # peak force at the first contact as a share of the full scale of the sensor
TICK_S = 1.0 / _core.TICKS_PER_SECOND
# Shortest and longest usual electrical time constant L / R of a motor, in s.
FASTEST_TAU_S, SLOWEST_TAU_S = 2e-5, 0.1
DAC_CODES = 2048  # number of DAC codes from 0 V to the full scale of the command voltage
# Ratio of the first gains of a new axis to the critical gains of its loops.
# Contact loss makes a force loop unstable below the critical gain.
FIRST_GAIN_SHARE = 1 / 6
# Contact loss makes contact.toml unstable far below the critical gain.
# The gain of contact.toml is therefore lowered in steps, each by the factor RESERVE_STEP.
# The search ends when the simulated contact is stable even with RESERVE times the gain.
# The gain never falls below RESERVE_LEAST times the first gain.
RESERVE, RESERVE_STEP, RESERVE_LEAST = 2.0, 0.95, 0.25
GAIN_MOST = 256.0  # largest gain of a new axis, in DAC codes per unit of the controlled signal
STATIC_GAIN_MAX = 1e6  # static gain above which a loop has an integral
# The first contact of contact.toml comes within this time in s. Otherwise the axis starts nearer.
REACH_MAX_S = 20.0
# Limit of the force error in contact.toml with an integral in the loop, a share of the set-point.
# An error of HALF_COUNT 8-bit counts, or of one DAC code, is always permitted.
ERROR_MAX, HALF_COUNT = 0.02, 0.6
FRACTION_BITS = 12  # largest number of bits of an output without fractions of a DAC code
MODEL, CONTACT, STEP = "model.toml", "contact.toml", "step.toml"
FILES = (MODEL, CONTACT, STEP)
HELD = "held.toml"  # name of the experiment that makes contact with the designed filter bank


# {object: reason for its value in the files of a new axis}
WHY = {
    "position_age_max": "three cycles of the bus, so that one missing position is no fault",
    "force_age_max": "latency and two samples of the force, so that one missing sample is no "
    "fault; at most the largest age that the firmware measures",
    "cycle_age_max": "the largest age while no value is missing; an older one makes a part bad",
    "drive_on_ticks_max": "longer than drive_wait (5 s), so that the reason of the drive comes "
    "first",
    "brake_engage_ticks": "until the brake holds, the amplifier stays on when the axis is disabled",
}


@dataclass
class AmplifierCircuit:
    """Constants of an amplifier with a velocity loop around a current loop. The fields are in SI
    units and have the names of the model's parameters."""

    k_current: float
    k_amp: float
    k_tach: float
    k_preamp_fdbk: float
    k_preamp_cmd: float
    a_preamp_fdbk: float


@dataclass(frozen=True)
class FirmwareTime:
    """Value of a firmware object in ticks, and a sentence for the experiment file that explains
    this value."""

    name: str
    ticks: int
    why: str


@dataclass
class AxisConstants:
    """Constants of the model that follow from the data sheet. The fields are in SI units and have
    the names of the model's parameters. r_trans, k_torque: 0 for a linear motor. circuit: None for
    a drive with a control loop of its own. cycle_ticks: cycle of the bus in ticks, 1 without a bus.
    times: result of firmware_times()."""

    v: SheetValues
    r_trans: float
    rotor_mass: float
    mass: float
    k_torque: float
    current_limit: float
    circuit: AmplifierCircuit | None
    cycle_ticks: int
    times: list[FirmwareTime]
    b_transmission: float
    b_workpiece: float
    encoder_scale: float
    force_per_count: float
    current_per_count: float


def amplifier_circuit(v: SheetValues) -> AmplifierCircuit:
    """Returns the gains of the amplifier. Raises InputError if no gain gives the bandwidths of the
    data sheet."""
    r, mass, full_V = v.radius_m, v.total_mass_kg, v.command_full_scale_v
    speed = v.full_scale_speed_m_per_s
    current = v.current_limit_a
    k_torque = v.efficiency * v.torque_constant_n_m_per_a
    k_current = full_V / current
    L, R = v.inductance_h, v.resistance_ohm
    k_amp = (2 * math.pi * v.current_loop_hz * L - R) / k_current
    if k_amp <= 0:
        raise ParameterError(
            "current_loop_hz", f"expected more than R/(2 pi L) = {R / (2 * math.pi * L):.4g} Hz, "
            f"got {v.current_loop_hz:g} Hz; raise `current_loop_hz`, or check R and L",
        )  # fmt: skip
    k_tach = v.tachometer_v_s_per_rad or full_V * r / speed
    # Drive without filter and inductance, with K = k_amp and the motor speed v/r:
    # (R + K k_current) i = K (k_preamp_cmd u - k_preamp_fdbk k_tach v/r) - k_back_emf v/r.
    # The force k_torque/r i - b v has to equal D (speed/full_V u - v).
    D = 2 * math.pi * v.velocity_loop_hz * mass
    b = v.guide_damping_n_s_per_m + v.motor_damping_n_m_s_per_rad / r**2
    Z = R + k_amp * k_current
    back = v.back_emf_v_s_per_rad
    k_fdbk = ((D - b) * Z * r**2 / k_torque - back) / (k_amp * k_tach)
    if k_fdbk < 0:
        natural = (b + k_torque * back / (Z * r**2)) / (2 * math.pi * mass)
        raise ParameterError(
            "velocity_loop_hz", f"expected more than {natural:.4g} Hz, the bandwidth due to "
            f"friction and back EMF without a velocity loop, got {v.velocity_loop_hz:g} Hz; raise "
            "`velocity_loop_hz` or `current_loop_hz`",
        )  # fmt: skip
    k_cmd = speed / full_V * D * Z * r / (k_torque * k_amp)
    filter_rad_per_s = 2 * math.pi * v.velocity_filter_hz
    return AmplifierCircuit(k_current, k_amp, k_tach, k_fdbk, k_cmd, filter_rad_per_s)


def bus_ticks(v: SheetValues) -> int:
    """Returns the cycle of the bus in ticks, or 1 without a bus. Raises InputError if the cycle is
    not a multiple of 2 ms (3 ticks)."""
    if v.bus_cycle_ms is None:
        return 1
    if v.bus_cycle_ms % 2:
        raise ParameterError(
            "bus_cycle_ms", f"expected a multiple of 2 ms, got {v.bus_cycle_ms:g} ms"
        )
    return round(v.bus_cycle_ms * 1.5)


def firmware_times(v: SheetValues) -> list[FirmwareTime]:
    """Returns the times of those firmware objects whose default is too short for the axis. The
    times follow from the cycle of the bus, the rate of the sensor, the start of the drive and the
    brake.
    Raises InputError if the cycle of the bus is not a multiple of 2 ms, or if a reading of the
    force is older than the firmware can measure."""
    cycle = bus_ticks(v) if v.bus_cycle_ms is not None else None
    period = bus_times.TICKS_PER_MS * 1e3 / v.sensor_rate_hz if v.sensor_rate_hz else 0.0
    latency = v.sensor_latency_ms * bus_times.TICKS_PER_MS
    if latency + period > bus_times.AGE_MOST:
        raise ParameterError(
            "sensor_latency_ms", "expected a latency of at most "
            f"{(bus_times.AGE_MOST - period) / bus_times.TICKS_PER_MS:.4g} ms, because the "
            f"firmware measures no age above {bus_times.AGE_MOST / bus_times.TICKS_PER_MS:.4g} ms, "
            f"got {v.sensor_latency_ms:g} ms beside a sample of "
            f"{period / bus_times.TICKS_PER_MS:.4g} ms; use a faster sensor",
        )  # fmt: skip
    found = [
        FirmwareTime(name, ticks, WHY[name])
        for name, ticks in bus_times.ages(cycle, period, latency).items()
    ]
    on = bus_times.on_ticks(objects.default("drive_wait"), objects.default("drive_sdo_timeout"))
    if cycle and on > objects.default("drive_on_ticks_max"):
        found.append(FirmwareTime("drive_on_ticks_max", on, WHY["drive_on_ticks_max"]))
    if v.brake_holding_n is not None and v.brake_engage_ms > 0:
        name = "brake_engage_ticks"
        found.append(FirmwareTime(name, bus_times.brake_ticks(v.brake_engage_ms), WHY[name]))
    return found


def derive(v: SheetValues) -> AxisConstants:
    """Returns the constants of the model for a data sheet. Raises InputError if no gain gives the
    bandwidths of the data sheet."""
    rotary = v.motor == "rotary"
    r, mass = v.radius_m if rotary else 0.0, v.total_mass_kg
    current = v.current_limit_a
    b_transmission = 0.0
    if k := v.transmission_stiffness_n_per_m:
        pair = v.rotor_mass_kg * v.moving_mass_kg / mass
        b_transmission = 2 * v.transmission_damping_ratio * math.sqrt(k * pair)
    b_workpiece, zeta = v.workpiece_damping_n_s_per_m, v.workpiece_damping_ratio
    if zeta is not None:
        b_workpiece = (
            2 * zeta * math.sqrt((v.workpiece_stiffness_n_per_m or 0.0) * v.workpiece_mass_kg)
        )
    return AxisConstants(
        v, r, v.rotor_mass_kg, mass, v.efficiency * v.torque_constant_n_m_per_a, current,
        amplifier_circuit(v) if v.drive == "amplifier" else None, bus_ticks(v), firmware_times(v),
        b_transmission, b_workpiece,
        encoder_counts_per_m(v),
        v.sensor_full_scale_n / 2 ** (v.sensor_bits - 1), 1.25 * current / 2 ** (v.code_bits - 1),
    )  # fmt: skip


@dataclass(frozen=True)
class Plausible:
    """A quantity that follows from the data sheet, with the range in which machines have it.

    `value`: function that computes the quantity, or returns None if the axis does not have it.
    `what`: text about the quantity, `unit`: its unit. `check`: what may be wrong outside the range.
    """

    value: Callable[[SheetValues], float | None]
    low: float
    high: float
    what: str
    unit: str
    check: str


def _of_motor(value: Callable[[SheetValues], float]) -> Callable[[SheetValues], float | None]:
    """Returns a function that computes a quantity of an axis with a rotary motor."""
    return lambda v: value(v) if v.motor == "rotary" else None


def _torque_n_m(v: SheetValues) -> float:
    return v.peak_force_n * v.radius_m / v.efficiency


PLAUSIBLE = (
    Plausible(
        lambda v: v.inductance_h / v.resistance_ohm if v.drive == "amplifier" else None,
        FASTEST_TAU_S, SLOWEST_TAU_S,
        "electrical time constant, inductance over resistance,", "s",
        "an inductance of 1 mH is 0.001",
    ),
    Plausible(
        _of_motor(lambda v: v.rotor_mass_kg / v.moving_mass_kg), 0.0, 1e3,
        "mass of the reflected rotor divided by the moving mass", "",
        "is lead_mm_per_rev or pulley_radius_mm in mm, and rotor_inertia_kg_m2 in kg m^2? "
        "1 kg cm^2 is 1e-4",
    ),
    Plausible(
        _of_motor(lambda v: _torque_n_m(v) / v.rotor_inertia_kg_m2), 200.0, 1e7,
        "acceleration of the motor alone at its peak torque", "rad/s^2",
        "1 kg cm^2 is 1e-4 kg m^2, 1 g cm^2 is 1e-7; or check torque and current",
    ),
    Plausible(
        _of_motor(lambda v: v.command_speed_m_per_s / v.radius_m if v.drive != "torque" else 0.0),
        0.0, 4e3, "speed of the motor at full-scale command", "rad/s",
        "is lead_mm_per_rev or pulley_radius_mm in mm, and full_scale_speed_m_per_s in m/s?",
    ),
    Plausible(
        lambda v: v.peak_force_n / v.total_mass_kg, 0.05, 5e3,
        "acceleration of the axis at its peak force", "m/s^2",
        "check force or torque constant, peak current, lead and moving_mass_kg",
    ),
    Plausible(
        lambda v: v.peak_force_n / v.sensor_full_scale_n, 0.02, 100.0,
        "peak force of the drive divided by the full scale of the sensor", "",
        "is sensor_full_scale_n in N? 1 kg is 9.81 N",
    ),
    Plausible(
        lambda v: 1e3 * v.sensor_full_scale_n / v.sensor_stiffness_n_per_m, 1e-3, 30.0,
        "deflection of the sensor at its full scale", "mm",
        "is sensor_stiffness_n_per_m in N/m? 1 N/mm is 1e3, 1 N/um is 1e6",
    ),
    Plausible(
        lambda v: 1e3 * v.sensor_full_scale_n / 4 / (v.workpiece_stiffness_n_per_m or math.inf),
        0.0, 50.0, "deflection of the workpiece at a quarter of the full scale of the sensor", "mm",
        "is workpiece_stiffness_n_per_m in N/m? 1 N/mm is 1e3",
    ),
    Plausible(
        lambda v: 1e3 * v.peak_force_n / (v.transmission_stiffness_n_per_m or math.inf), 0.0, 20.0,
        "deflection of the transmission at the peak force", "mm",
        "is transmission_stiffness_n_per_m in N/m? 1 N/um is 1e6",
    ),
    Plausible(
        lambda v: v.sensor_noise_n / v.sensor_full_scale_n, 0.0, 0.05,
        "noise of the sensor divided by its full scale", "", "is sensor_noise_n in N?",
    ),
    Plausible(
        lambda v: 1e3 / (encoder_counts_per_m(v)), 1e-6, 0.2, "step of the encoder", "mm",
        "check the counts of the encoder and the lead",
    ),
    Plausible(
        lambda v: abs(v.weight_n) / v.peak_force_n, 0.0, 1.0,
        "weight divided by the peak force of the drive", "",
        "the drive cannot hold the axis; check moving_mass_kg, lead and peak current",
    ),
    Plausible(
        lambda v: None if v.brake_holding_n is None else abs(v.weight_n) / v.brake_holding_n,
        0.0, 1.0, "weight divided by the holding force of the brake", "",
        "the brake cannot hold the axis; check brake_holding_n",
    ),
    Plausible(
        lambda v: abs(v.inclination_deg or 0.0) if abs(v.inclination_deg or 0.0) < 1.6 else None,
        0.0, 1.5, "angle of the axis", "deg", "is inclination_deg in degrees? 90 is vertical",
    ),
)  # fmt: skip


def encoder_counts_per_m(v: SheetValues) -> float:
    """Returns the number of encoder counts per metre of travel."""
    if v.encoder_counts_per_rev is None:
        return 1e3 * v.encoder_counts_per_mm
    return v.encoder_counts_per_rev / (2 * math.pi * v.radius_m)


def doubts(v: SheetValues) -> list[str]:
    """Returns one-line texts about data-sheet values that are possible but unlikely, usually
    because a value has another unit."""
    found = []
    for one in PLAUSIBLE:
        value = one.value(v)
        if value is None or one.low <= value <= one.high:
            continue
        unit = f" {one.unit}" if one.unit else ""
        usual = f"{one.low:g} to {one.high:g}{unit}" if one.low else f"at most {one.high:g}{unit}"
        found.append(f"the {one.what} is {value:.3g}{unit}, usual is {usual}: {one.check}")
    return found


def stuck(v: SheetValues, first: "First") -> list[str]:
    """Returns one-line texts that explain why the axis does not reach the workpiece with the first
    force law."""
    if first.friction_most is not None:
        return []
    back_N = 0.0 if first.output_bias else -min(v.weight_n, 0.0)
    weight = f" and the weight of {back_N:.3g} N" if back_N else ""
    return [
        f"the dry friction of {v.guide_coulomb_n:g} N{weight} keeps the axis at standstill, "
        f"because the law of contact.toml pushes with {first.pushes_N + back_N:.3g} N, so that its "
        "run never comes into contact; raise force_gain or force_setpoint, or take a law with "
        "integral action (held.toml)"
    ]


def too_heavy(v: SheetValues, first: "First") -> list[str]:
    """Returns a one-line text if the weight needs more DAC codes than output_bias may have."""
    codes = -v.weight_n / first.newton_per_code
    if abs(codes) <= objects.BY_NAME["output_bias"].max * objects.BY_NAME["output_bias"].scale:
        return []
    return [
        f"the weight of {v.weight_n:.4g} N needs {codes:.4g} DAC codes, more than the half of the "
        f"range that output_bias may have, so that output_bias = {first.output_bias:g} holds a "
        "part of it only; take a stronger drive, or a counterbalance"
    ]


def within(name: str, value: float) -> float:
    """Returns `value`, limited to the range of the firmware object `name`."""
    known = objects.BY_NAME[name]
    return min(max(value, known.min * known.scale), known.max * known.scale)


@dataclass
class First:
    """The first gains of a new axis, and results that follow from these gains. The gains are in DAC
    codes per count. The force set-point is in 8-bit counts."""

    limit: float
    gain: float
    setpoint: float
    held: float  # settled force as a share of the force set-point; 1 with integral action
    # largest error of the settled force at a third of the gain, as a share of the force set-point
    error_most: float
    contact_s: float  # duration of the experiment contact.toml
    position_limit: float
    position_gain: float
    distance_m: float
    speed_m_per_s: float
    acceleration_m_per_s2: float
    step_s: float  # duration of the experiment step.toml
    # sum of the forces in N at the start of the approach: DAC code, output_bias, weight of the axis
    pushes_N: float
    # largest multiple of the declared dry friction that `pushes_N` overcomes; None if below 1
    friction_most: float | None
    raised: str  # reason why the force set-point was increased, or ""
    # DAC codes that hold the weight; 0 for a drive whose velocity loop has an integral
    output_bias: float
    newton_per_code: float  # force of the drive at standstill; infinity with an integral
    # distance to the workpiece in m at the start of contact.toml, if that of the model is too large
    start_m: float | None = None
    free_m_per_s: float = 0.0  # speed of the approach of contact.toml
    simulated_N: float | None = None  # settled force of contact.toml in the simulation
    # Factor by which the gain can rise while the simulated contact stays stable. None: not known.
    reserve: float | None = None


def approach_m_per_s(axis: AxisConstants) -> float:
    """Returns the approach speed in m/s, at most APPROACH_M_PER_S. At the speed v, the peak force
    of the first contact is v sqrt(k m). Until the firmware reads the first force, the axis moves on
    for the delay T of the sensor, which adds the force v k T. Each of both forces is at most the
    share MOMENTUM_SHARE of the full scale of the sensor.
    """
    v, stiffness = axis.v, axis.v.sensor_stiffness_n_per_m
    force = MOMENTUM_SHARE * v.sensor_full_scale_n
    behind = v.workpiece_stiffness_n_per_m or math.inf
    series = 1 / (1 / stiffness + 1 / behind)
    blind = force / (series * v.sensor_delay_s)
    return min(APPROACH_M_PER_S, force / math.sqrt(stiffness * axis.mass), blind)


def highest_gain(loop: "Loop", volts_per_code: float) -> float:
    """Returns the highest stable gain of a loop in DAC codes per unit of the controlled signal. The
    result is at most GAIN_MOST, because the firmware stores no larger gain."""
    gain = loop.limit().stable_to
    return min(GAIN_MOST, math.inf if gain is None else gain / volts_per_code)


def first_gain(limit: float) -> float:
    """Returns the first gain of a loop: FIRST_GAIN_SHARE times the highest stable gain `limit`, but
    at least the smallest gain that the firmware stores."""
    return max(1, math.floor(limit * FIRST_GAIN_SHARE * 256)) / 256


def first_gains(axis: AxisConstants, model: Path, lower: float | None = None) -> First:
    """Returns the first gains of a new axis as a share of the critical gains of the force loop and
    of the position loop. `lower`: gain of the force loop that is used instead of its share.

    The force set-point is a quarter of the sensor range, or of the drive's peak force if that is
    smaller. The set-point is larger if the approach has to overcome the weight and twice the dry
    friction.
    """
    from forceaxis import linear
    from forceaxis.linear import loops

    v = axis.v
    sliding = {"seals": "forward"} if v.guide_coulomb_n else {}
    if v.transmission_stiffness_n_per_m and v.backlash_mm:
        sliding["transmission.high"] = "pressed"  # state of a closed backlash
    # Forces along the axis that act on the pressing body: gravity and dry friction.
    pull = f"{'axis' if v.transmission_stiffness_n_per_m is None else 'load'}.force"
    inputs = ("drive.command", pull)
    plant = linear.linearise(model, inputs, ("adc0",), modes=sliding)
    free = linear.linearise(model, outputs=("encoder",), modes=sliding, free=True)
    poles = np.concatenate([plant.poles().real, free.poles().real])
    if poles.max() > 1e-6 * np.abs(poles).max():
        raise unstable_drive(v)
    volts = v.command_full_scale_v / DAC_CODES
    force = loops.force_loop(model, modes=sliding, output="adc0")
    limit = highest_gain(force, volts)
    gain = first_gain(limit) if lower is None else lower
    newton_per_count = v.sensor_full_scale_n / 128
    peak = v.peak_force_n
    setpoint = math.floor(min(32.0, peak / 4 / newton_per_count) * 256) / 256
    full_speed = v.command_speed_m_per_s
    code = full_speed / DAC_CODES
    if gain * setpoint < 2 or limit * FIRST_GAIN_SHARE < 1 / 256:
        key, change = "full_scale_speed_m_per_s", "lower"
        if v.drive == "torque":
            key, change = "torque_damping_n_s_per_m", "raise"
        raise ParameterError(
            key, "expected a speed at full command at which the safe approach outputs at least two "
            f"DAC codes, got {full_speed:g} m/s ({gain * setpoint:.2g} DAC codes); {change} "
            f"`{key}`, or check sensor and drive",
        )  # fmt: skip
    weight, dry = v.weight_n, v.guide_coulomb_n
    moving = linear.linearise(
        model, inputs, (pull.replace("force", "velocity"),), modes=sliding, free=True
    )
    speed_per_N = abs(moving.at([0.02j * math.pi]).ravel()[1])
    of_command, of_force = plant.at(0.0).real.ravel()
    static = gain * volts * of_command
    # If the drive has an integral in its velocity loop, its force rises until the force error is 0.
    integrates = not static < STATIC_GAIN_MAX
    newton_per_code = math.inf if integrates else volts * of_command / of_force
    bias = bias_codes(v, newton_per_code)
    # The output bias holds the weight except for the rounding error of the bias.
    unheld = weight + (bias * newton_per_code if bias else 0.0)
    need = 1.1 * (2 * dry - min(unheld, 0.0)) * speed_per_N / (gain * code)
    highest = math.floor(min(96.0, peak / 2 / newton_per_count) * 256) / 256
    fast = v.approach_mm / 1e3 / (REACH_MAX_S * gain * code)
    usual, wanted = setpoint, math.ceil(max(need, fast) * 256) / 256
    setpoint = max(setpoint, min(wanted, highest))
    raised = ""
    if setpoint > usual:
        raised = (
            "against its weight and twice the dry friction"
            if need >= fast
            else f"within {REACH_MAX_S:g} s"
        )
    held = 1.0 if integrates else (static + of_force * unheld / setpoint) / (1 + static)

    def error_at(factor: float) -> float:
        """Largest error of the settled force at `factor` times the gain, as a share of the force
        set-point, with any dry friction up to twice the declared one."""
        steps = max(HALF_COUNT, 1 / gain) / setpoint
        if integrates:
            return float(max(ERROR_MAX, steps))
        loop = factor * static
        rubs = abs(of_force) * (2 * dry + v.cogging_n) / setpoint
        error = abs(1 - of_force * unheld / setpoint) + rubs
        return float(ERROR_MAX + steps + error / (1 + loop))

    rate = force.decay(gain * volts)
    free_speed = min(gain * setpoint, DAC_CODES) * code
    start_m = v.approach_mm / 1e3
    if start_m > REACH_MAX_S * free_speed:
        start_m = REACH_MAX_S * free_speed
    reach = start_m / free_speed
    # A user may run the file with lower gains and set-points, which make the approach slower.
    # The simulated time is sufficient at a tenth of the speed, unless the run then takes too long.
    room = min(10 * reach, 1.3 * reach + 3)
    pushes = min(free_speed / speed_per_N, peak) if integrates else free_speed / speed_per_N
    pushes += unheld  # force in N at standstill, including the weight
    most = friction_most(dry, pushes)
    if most is not None and not integrates:
        slowest = (pushes - most * dry) * speed_per_N
        room = max(room, 1.3 * start_m / slowest + 0.5)
    contact = min(600.0, math.ceil(2 * (room + min(10 / rate, 30) + 1.5)) / 2)

    position = loops.force_loop(model, modes=sliding, output="encoder", free=True)
    position_limit = highest_gain(position, volts)
    position_gain = first_gain(position_limit)
    distance, acceleration = 0.02, 0.25 * peak / axis.mass
    speed = full_speed / 4
    settle = 10 / max(position.decay(position_gain * volts), 0.5)
    step = math.ceil(2 * (distance / speed + speed / acceleration + settle + 0.5)) / 2
    return First(
        limit, gain, setpoint, held, min(error_at(1 / 3), (1 + error_at(1.0)) / 2), contact,
        position_limit, position_gain, distance, speed, acceleration, min(step, 600.0), pushes,
        most, raised, bias, newton_per_code, start_m if start_m < v.approach_mm / 1e3 else None,
        free_speed,
    )  # fmt: skip


def bias_codes(v: SheetValues, newton_per_code: float) -> float:
    """Returns the value of the object output_bias in DAC codes that holds the weight, at the
    resolution of the output and within the range of the object. `newton_per_code`: force of the
    drive at standstill, infinity for a velocity loop with an integral, which needs no bias."""
    codes = -v.weight_n / newton_per_code
    if v.output_bits <= FRACTION_BITS:
        codes = round(codes)
    known = objects.BY_NAME["output_bias"]
    return within("output_bias", round(codes / known.scale) * known.scale)


def with_reserve(
    axis: AxisConstants, trial: Path, first: First, contact: Callable[[First], str]
) -> First:
    """Returns first gains with which contact.toml is stable in the simulation of the firmware, up
    to RESERVE times its force gain. Returns `first` if the axis does not come into contact, or if
    no such gain is found.

    trial: folder with the model. contact: function that returns the text of contact.toml.
    """
    found, file = first, trial / CONTACT
    while first.friction_most is not None and found.gain > RESERVE_LEAST * first.gain:
        file.write_text(contact(found), encoding="utf-8")
        experiments = _core.Experiments()
        try:
            for factor in (RESERVE, 1.5, 1.0):
                held_N = _held_N(file, factor * found.gain, experiments)
                if held_N is None:
                    break
            else:
                return replace(found, reserve=RESERVE, simulated_N=held_N)
            lower = math.floor(RESERVE_STEP * found.gain * 256) / 256
            found = first_gains(axis, trial / MODEL, lower)
        # the approach is too slow, or the simulation fails
        except (InputError, _core.SimulationError):
            break
    return first


def _held_N(file: Path, gain: float, experiments: _core.Experiments) -> float | None:
    """Returns the settled force in N of contact.toml with a force gain, or None if its verdict is
    not stable. `experiments` keeps the parsed file. Raises SimulationError."""
    from forceaxis.experiments import verdicts

    job = (str(file), [f"firmware.force_gain={gain}"])
    (done,) = _core.run_many([job], 1, None, True, None, experiments)
    if "error" in done:
        raise _core.SimulationError(done["error"])
    held = done["metrics"].held_force
    if done["verdict"] != verdicts.STABLE or held is None:
        return None
    return float(held.held_N)


def unstable_drive(v: SheetValues) -> ParameterError:
    """Returns the error for a drive that is unstable even before a force loop is closed."""
    if v.drive == "torque":
        return ParameterError(
            "torque_damping_n_s_per_m", "expected a damping with which the drive is stable with "
            f"its current loop and transmission, got {v.torque_damping_n_s_per_m:g} N s/m; lower "
            "`torque_damping_n_s_per_m`, or raise `current_loop_hz`",
        )  # fmt: skip
    if v.drive == "stepper":
        return ParameterError(
            "load_angle_damping_ratio", "expected a damping ratio with which the axis is stable, "
            f"got {v.load_angle_damping_ratio:g}; raise `load_angle_damping_ratio`",
        )  # fmt: skip
    filtered = "`velocity_filter_hz` and " if v.drive == "amplifier" else ""
    return ParameterError(
        "velocity_loop_hz", "expected a bandwidth at which the drive is stable with its "
        f"current loop, filter and transmission, got {v.velocity_loop_hz:g} Hz; lower "
        f"`velocity_loop_hz`, or raise {filtered}`current_loop_hz`",
    )  # fmt: skip


def friction_most(dry_N: float, pushes_N: float) -> float | None:
    """Returns the multiple of the declared dry friction that an approach with the force `pushes_N`
    overcomes.

    The multiple is 2. If the mean of 1 and the largest multiple is less than 2, it is this mean.
    The result is None if the force does not overcome the declared friction.
    """
    if pushes_N <= dry_N:
        return None
    return 2.0 if 2 * dry_N < pushes_N else (1 + pushes_N / dry_N) / 2


@functools.cache
def _template(name: str) -> jinja2.Template:
    """Returns the compiled template of the file `name`, one of FILES."""
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda x: f"{x:.6g}" if isinstance(x, float) else x,
    )
    text = resources.files("forceaxis.design").joinpath(f"new_{name}.jinja").read_text()
    return environment.from_string(text)


def render(
    name: str,
    title: str,
    axis: AxisConstants,
    sources: Mapping[str, str],
    first: First | None = None,
) -> str:
    """Returns the text of one of the files of a new axis. `name` is one of FILES. `first` is None
    for the model, whose text contains no gains."""
    v = axis.v

    def entry(key: str, value: float, unit: str, source: str = "derived") -> str:
        return f'{key} = {{ value = {float(value)!r}, unit = "{unit}", source = "{source}" }}'

    def given(key: str, name: str, unit: str, scale: float = 1.0) -> str:
        return f"# {BY_NAME[name].ask}\n{entry(key, getattr(v, name) * scale, unit, sources[name])}"

    context = dict(
        title=title, a=axis, v=v, src=sources, entry=entry, given=given, exact=repr,
        pi=math.pi,
        bits=v.code_bits, half=1 << (v.code_bits - 1), sensor_bits=int(v.sensor_bits),
        back_emf_speed=v.back_emf_speed_m_per_s if axis.circuit else 0.0, weight=v.weight_n,
        count_N=v.sensor_full_scale_n / 128,
        force_scale=round(within("force_scale", 1e6 * v.sensor_full_scale_n / 128)),
        rated_force=round(within("rated_force", 1e3 * v.sensor_full_scale_n)),
    )  # fmt: skip
    if first:
        count = axis.encoder_scale
        target = round((-v.approach_mm / 1e3 - first.distance_m) * count)
        if abs(target) >= 2**31:
            key = "encoder_counts_per_rev" if v.encoder_counts_per_rev else "encoder_counts_per_mm"
            raise ParameterError(
                key,
                "expected a travel of less than 2^31 encoder counts; give a shorter travel or "
                "an encoder with a lower resolution",
            )
        context |= dict(
            f=first, target=target, approach_mm_per_s=1e3 * approach_m_per_s(axis),
            most=GAIN_MOST, lowered=first.gain < first_gain(first.limit),
            speed=within("profile_velocity_max", first.speed_m_per_s * count * TICK_S),
            acceleration=within("profile_acceleration_max",
                                first.acceleration_m_per_s2 * count * TICK_S**2),
            ripple=max(10.0, math.ceil(2e-5 * count)), beside=beside_counts(first, v),
        )  # fmt: skip
    return _template(name).render(context)


def beside_counts(first: First, v: SheetValues) -> int:
    """Returns how many encoder counts beside its target the axis may stop because of dry friction:
    the position law is proportional, and near the target it pushes with less than the friction."""
    held_N = first.newton_per_code * first.position_gain  # for each encoder count
    return math.ceil((v.guide_coulomb_n or 0.0) / held_N)


@dataclass(frozen=True)
class BankForAxis:
    """The filter bank that was designed for a new axis, and the P law with the same margins."""

    over: list[str]  # tolerances of the set of plants as texts NAME=PERCENT%
    modes: list[dict[str, str]]  # {element: state} of each mode of the set of plants
    structure: str
    bank: BankKeys
    fS_Hz: float  # bandwidth of the filter bank over the set of plants
    # bandwidth of the P law over the set of plants; None if no gain of the P law keeps the margins
    p_fS_Hz: float | None
    p_force_gain: float  # force_gain of the P law in DAC codes per 8-bit count
    p_static_error: float | None  # static error with the P law as a share of the set-point
    limited_by: str  # sentence about the bound that limits the bandwidth
    approach_m_per_s: float

    @property
    def set_text(self) -> str:
        """Returns the tolerances as text, such as "k_w +-30 %"."""
        return ", ".join(text.replace("=", " +-").replace("%", " %") for text in self.over)


@dataclass(frozen=True)
class NoBank:
    """Result instead of BankForAxis if a new axis has no filter bank. `refused` is the reason."""

    refused: str


@dataclass(frozen=True)
class NewAxis:
    """The result of creating an axis."""

    folder: str
    files: list[str]
    total_mass_kg: float  # moving mass plus rotor inertia as a mass at the axis
    mass_with: str  # end of the sentence about `total_mass_kg`
    force_limit_gain: float  # largest force_gain at which the linear force loop is stable
    force_gain: float  # gain of contact.toml in DAC codes per 8-bit count
    # factor by which force_gain can rise while the contact of contact.toml stays stable, or None
    force_gain_reserve: float | None
    force_setpoint: float  # force set-point in 8-bit counts
    setpoint_N: float
    held_share: float  # settled force in contact.toml as a share of the force set-point
    # end of the sentence about `held_share`: states whether weight and dry friction are included
    held_with: str
    position_gain: float  # position gain in DAC codes per encoder count
    design: BankForAxis | NoBank | None  # None if the user did not request a filter bank
    defaults: list[str]  # names of the data-sheet values that are defaults
    doubts: list[str]  # sentences about data-sheet values that are possible but unlikely
    marked: int  # number of model values that are defaults


def write(
    folder: str | Path,
    values: SheetValues,
    sources: Mapping[str, str],
    force: bool = False,
    design: Callable[[Path], tuple[str | None, BankForAxis | NoBank]] | None = None,
) -> NewAxis:
    """Writes the model and the experiments of a new axis to `folder`, either all files or no file.

    values, sources: results of data_sheet.collect(). design: own_axis.design, or None for an axis
    without a filter bank.
    """
    folder = Path(folder)
    title = folder.name
    if not title or any(c in title for c in '"\\') or not title.isprintable():
        raise InputError(
            f"NAME: expected the name of a folder without quotation marks, got {str(folder)!r}"
        )
    axis = derive(values)
    written = {MODEL: render(MODEL, title, axis, sources)}
    with tempfile.TemporaryDirectory() as scratch:
        trial = Path(scratch)
        (trial / MODEL).write_text(written[MODEL], encoding="utf-8")
        first = with_reserve(
            axis,
            trial,
            first_gains(axis, trial / MODEL),
            lambda first: render(CONTACT, title, axis, sources, first),
        )
        written |= {name: render(name, title, axis, sources, first) for name in (CONTACT, STEP)}
        held, bought = None, None
        if design:
            (trial / CONTACT).write_text(written[CONTACT], encoding="utf-8")
            held, bought = design(trial)
        if held:
            written[HELD] = held
    refuse_existing(folder, force)
    with paths.replacing(folder, *written) as files:
        for file, text in zip(files, written.values(), strict=True):
            file.write_text(text, encoding="utf-8")
        if HELD not in written:  # an existing file HELD belongs to the model that was replaced
            (folder / HELD).unlink(missing_ok=True)
    return NewAxis(
        folder=paths.display(folder),
        files=list(written),
        total_mass_kg=axis.mass,
        mass_with=", reflected rotor included" if values.motor == "rotary" else "",
        force_limit_gain=first.limit,
        force_gain=first.gain,
        force_gain_reserve=first.reserve,
        force_setpoint=first.setpoint,
        setpoint_N=first.setpoint * values.sensor_full_scale_n / 128,
        held_share=first.held,
        held_with=held_with(values, first),
        position_gain=first.position_gain,
        design=bought,
        defaults=[n for n, s in sources.items() if s != "given"],
        doubts=doubts(values) + too_heavy(values, first) + stuck(values, first),
        marked=written[MODEL].count("default, check"),
    )


def held_with(v: SheetValues, first: First) -> str:
    """Returns the end of the sentence about the force at which contact.toml settles. The text
    states what holds the weight, and whether dry friction may change the force."""
    text = ""
    if first.output_bias:
        text = (
            f"; output_bias of {first.output_bias:g} codes holds the weight of {v.weight_n:.3g} N"
        )
    return text + (", plus or minus the dry friction" if v.guide_coulomb_n else "")


def refuse_existing(folder: Path, force: bool) -> None:
    """Raises InputError if `folder` is a file. Also raises it if `folder` contains files of an axis
    and `force` is False. `force`: True if the user permits to replace the files."""
    if folder.exists() and not folder.is_dir():
        raise InputError(
            f"{folder}: expected the name of a new or existing folder, got a file; choose another "
            "name"
        )
    there = [name for name in (*FILES, HELD) if (folder / name).exists()]
    if there and not force:
        raise ParameterError(
            "name", f"{folder}: expected a folder without {', '.join(there)}; choose another "
            "name, or give `force` to replace these files",
        )  # fmt: skip
