"""Tunes the force law of an axis. The steps are: measure responses, fit a model, design a force
law, simulate it, write it to the axis, verify it, and store it.

Tuning(axis, order, folder).run() runs the steps of STEP_TABLE one after another. Each step is a
function whose arguments are the folder of the tuning and the results of earlier steps. The function
returns the result of the step or raises a Refusal. The result is written to a JSON file in the
folder. A step with such a file is not run again, so that an interrupted tuning continues with the
next step. The steps `free` and `measure` are in the module tune_measure, the step `fit` is in
tune_fit.
"""

import hashlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from forceaxis import _core, linear, objects
from forceaxis._core import InputError
from forceaxis.axis import bounds, parameter_set, quantity
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import FORCE_SCALE_TOLERANCE, REASONS, TICKS_PER_S, NoAnswer, Refused
from forceaxis.axis.values import PlannedValues
from forceaxis.commission import (
    analyzer,
    as_found,
    contact,
    known,
    machine_bounds,
    margins,
    tune_fit,
    tune_measure,
    tune_weight,
    unexplained,
)
from forceaxis.commission.as_found import FolderFile
from forceaxis.commission.level import Level, Rest
from forceaxis.commission.refusal import (
    ORPHANED,
    REMEDY_AFTER_KILL,
    DesignAgain,
    MeasureAgain,
    Refusal,
    of_link,
)
from forceaxis.commission.tune_folder import (
    BEFORE,
    MEASURED,
    PROPOSED_MODEL,
    TUNE,
    StepFile,
    TuningFolder,
    TuningIdentity,
    TuningOrder,
    read_touch_down,
    small_of,
)
from forceaxis.commission.tune_measure import (
    analyzer_of,
    disable,
    force_objects,
    go_home,
    highest_hz,
    measuring_order,
    next_amplitude,
    objects_of,
    returning,
    take_response,
    with_measured_way,
)
from forceaxis.commission.tune_results import (
    Checked,
    Designed,
    Fitted,
    FreeResponse,
    MeasuredResponses,
    Settings,
    Simulated,
    StepRefusal,
    Stored,
    TuningSummary,
    Verified,
    VerifiedResponse,
    Written,
)
from forceaxis.design import experiment_file, for_set, outcome
from forceaxis.design import simulate as simulation
from forceaxis.design.certificate import NoPFigures, PFigures
from forceaxis.design.grid import Bounds, Grid, hf_of_noise
from forceaxis.design.outcome import DesignResult
from forceaxis.errors import ParameterError
from forceaxis.identify.distributions import normal_bound
from forceaxis.linear import PlantFacts, loops, plant_set, working
from forceaxis.linear.bank import Bank, low_pass
from forceaxis.linear.plant_set import Member, PlantSet
from forceaxis.results import from_json, to_json

R = TypeVar("R")  # type of the result of a step

GAIN_MAX = 256.0  # largest gain of the firmware in DAC codes per 8-bit count
LIMIT_FACTOR = 1 / 6  # gain of the force law for the measurement, divided by the critical gain
# Factors of stiffness and mass in the set of plants for which the critical gain is computed.
SPREAD_FACTORS = (0.3, 1.0, 3.0)
# Integral rates among which the force law for the measurement is chosen.
RATES_RAD_PER_S = (4.0, 16.0, 64.0, 256.0, 1024.0)
# Lowest crossover frequency of a loop in the set of plants.
# With this crossover frequency, a force settles within seconds.
CROSSOVER_RAD_PER_S = 3.0
# MS_MEASURING: largest |S| of the loop during the measurement.
# LOW_PASS_HZ: corner frequencies of a low pass that the filter bank gets if |S| is larger.
# If no low pass is sufficient, the integral rate of the filter bank is reduced.
MS_MEASURING = 2.2
LOW_PASS_HZ = (30.0, 10.0, 3.0, 1.0)
SLOW_RATES_RAD_PER_S = (0.25, 1.0)
MS_TOLERANCE = 0.3  # largest amount by which a measured Ms may exceed the predicted Ms
# If a measured Ms exceeds the predicted Ms by more than MS_TOLERANCE, the law is designed again.
# New limit of Ms = old limit x predicted Ms / measured Ms x MS_AGAIN_MARGIN.
# MS_AGAIN_MIN: smallest limit of Ms with which a law is designed again.
MS_AGAIN_MARGIN, MS_AGAIN_MIN = 0.95, 1.15
# probability with which noise alone makes the measured Ms exceed its bound
PEAK_PROBABILITY = 0.025
# If |S| is certain at no frequency, the response is measured again with more averages.
# AVERAGES_FACTORS: factors of the number of averages, in the order in which they are tried.
AVERAGES_FACTORS = (1, 4, 16)
# Highest measured frequency, divided by the highest frequency at which a loop becomes unstable.
RESPONSE_BAND_FACTOR = 1.3
BAND_RATIO_MIN = 20.0  # smallest ratio of the highest and the lowest frequency of a response
# Largest `force_max` that is written, divided by the largest force that the sensor can show.
READABLE_SHARE = 0.98
# The object contact_force is at least CONTACT_NOISE_FACTOR times the noise.
# The object contact_force is also at least CONTACT_COUNTS_MIN force counts.
CONTACT_NOISE_FACTOR, CONTACT_COUNTS_MIN = 8.0, 0.25
# Ratio of `contact_force` of the axis to the noise, below which `contact_force` is replaced.
CONTACT_NOISE_MIN = 5.0
# Smallest change of the force by the excitation, in ADC codes, if the measured force has no noise.
ROUNDED_CODES_MIN = 16
ROUNDING_LSB = 0.29  # rms error of rounding in codes
# Largest change of the force by the smallest step of the output, before the sensor shows it.
# The change of the force is divided by the smallest force of the request.
# On 25 random machines, the force error was at most 3 % up to a share of 0.04.
# With shares from 0.1 on, the force error was up to 13 %, or no law was found.
STEP_SHARE_MAX = 0.1
# Longest time in s of an approach over the distance of the model.
APPROACH_LONGEST_S = 300.0
# Ratio of a bandwidth to the bandwidth of the P law, below which a text names the limiting bound.
BANDWIDTH_FACTOR = 1.7
# A law whose margins the error of the model exceeds is designed again, for a smaller limit of Ms.
# MODEL_ERROR_ROUNDS: largest number of designs for a smaller limit of Ms.
# MODEL_ERROR_STEP_: bounds of the factor by which each design reduces the distance of Ms from 1.
# MODEL_ERROR_MS_MIN: smallest distance of Ms from 1, divided by the distance in the first design.
# With a smaller limit of Ms, laws are too slow.
MODEL_ERROR_MS_MIN = 0.25
MODEL_ERROR_ROUNDS, MODEL_ERROR_STEP_MIN, MODEL_ERROR_STEP_MAX = 7, 0.4, 0.85
# An axis without friction coasts while a law is designed, so it may have to move back.
# AWAY_GAPS: largest distance from the start at which an axis does not move back before an approach.
# The distance from the start is divided by the distance to the workpiece in the model.
AWAY_GAPS = 1.5
NO_MEMORY = -10  # key in REASONS for an axis without memory for parameters
EARLIER_LAW_AGAIN = "the axis uses its earlier force law again"


@dataclass(frozen=True)
class AxisSettings:
    """Objects of an axis, in engineering values. The step `check` compares them with the model."""

    adc_bits: int
    force_zero_code: int
    force_scale: float
    calibration_date: int
    position_gain: float
    velocity_gain: float
    fault: str
    latency_ticks: int
    force_sign: int
    approach_velocity_max: float
    contact_force: float
    force_max: float


def check(tuning: TuningFolder) -> Checked:
    """Checks that the axis is at rest and that the converters of the axis agree with the model. An
    axis with a weight is also moved, as by `axis check`, so that its weight is known."""
    axis, model = tuning.axis, tuning.model
    held = axis.record(AxisSettings)
    facts = linear.facts(model)
    _expect_axis_of_model(tuning, held, facts)
    settings = _sensor_settings(held, facts) | _position_settings(tuning, held, facts)
    settings |= _approach_settings(tuning, held, facts)
    settings |= _force_bound(tuning, held, facts)
    rest = analyzer_of(tuning).rest()
    _expect_noise(tuning, rest, facts)
    settings |= _contact_settings(tuning, held, rest, facts)
    if text := working.working(model, None, tuning.states).text:
        tuning.say(f"mode         {text}")
    bank, highest = measuring_law(tuning)
    low, high = tuning.order.band_hz
    high = min(max(high, RESPONSE_BAND_FACTOR * highest), highest_hz(facts))
    low = min(low, high / BAND_RATIO_MIN)
    if held_weight := tune_weight.held_weight(tuning, settings, rest):
        settings |= held_weight
        rest = analyzer_of(tuning).rest()
    return Checked(
        rest, settings, bank.keys(), (low, high), margins.active_law(axis).keys(),
        held.latency_ticks,
    )  # fmt: skip


def check_line(tuning: TuningFolder, done: Checked) -> str:
    """Returns the text about the result of the step `check`."""
    rest, law = done.rest, done.law.bank
    noise = "" if rest.noise_lsb is None else f", noise {rest.noise_lsb:.2g} codes"
    text = (
        f"at rest, measured force {rest.reading:.2g} counts{noise}; the responses are measured "
        f"with the gain {law.force_gain:.3g} and the integral rate {law.integral_rad_per_s:.3g} 1/s"
    )
    return text + (f"; from the model: {', '.join(done.settings)}" if done.settings else "")


def _expect_axis_of_model(tuning: TuningFolder, held: AxisSettings, facts: PlantFacts) -> None:
    """Raises Refusal if the axis has a fault, or if its ADC differs from the model. Raises
    InputError if a force of the request is beyond the range of the axis."""
    if held.fault != "none":
        left = f"; {REMEDY_AFTER_KILL}" if held.fault in ORPHANED else ""
        raise Refusal(
            "fault", f"expected an axis without a fault, got {held.fault}; "
            f"`axis.reset_fault()` resets the fault{left}"
        )  # fmt: skip
    if facts.reading is None or facts.encoder is None or not facts.contacts:
        raise InputError(
            f"{tuning.model}: expected a model with a force sensor, an encoder and a contact"
        )
    if held.adc_bits != facts.reading.bits:
        raise Refusal(
            "adc", f"expected an ADC of {facts.reading.bits} bits as in the model, but the axis "
            f"has adc_bits = {held.adc_bits}: correct adc_bits or the model"
        )  # fmt: skip
    bounds.expect_readable(
        tuning.axis, max(tuning.order.forces), analyzer.SWING, abs(facts.required_reading.per_count)
    )


def _sensor_settings(held: AxisSettings, facts: PlantFacts) -> Settings:
    """Returns the `force_scale` of the model if the axis was never calibrated. Raises Refusal if
    the calibrated `force_scale` of the axis differs from the `force_scale` of the model."""
    scale = 1e6 * abs(facts.required_reading.per_count)
    if abs(held.force_scale / scale - 1) <= FORCE_SCALE_TOLERANCE:
        return {}
    if not quantity.never_set(held.force_scale, held.calibration_date):
        raise Refusal(
            "scale", f"expected a force_scale of {scale:.6g} uN/count as in the model, but the "
            f"axis has {held.force_scale:g} uN/count: calibrate the axis, or correct the model"
        )  # fmt: skip
    return {"force_scale": max(1, round(scale))}


def _position_settings(tuning: TuningFolder, held: AxisSettings, facts: PlantFacts) -> Settings:
    """Returns a `position_gain` if the axis has none. It is computed from the critical gain of the
    model."""
    if held.position_gain:
        return {}
    moves = known.states_apart(str(tuning.model), tuning.states)
    loop = loops.force_loop(str(tuning.model), modes=moves, output="encoder", free=True)
    gain = loop.limit().stable_to
    highest = 256.0 if gain is None else gain / facts.volts_per_code
    return {"position_gain": max(1, math.floor(LIMIT_FACTOR * min(highest, 256.0) * 256)) / 256}


def _approach_settings(tuning: TuningFolder, held: AxisSettings, facts: PlantFacts) -> Settings:
    """Returns an `approach_velocity_max` that is computed from the model, if the axis has the
    default value or if its value gives the axis too much momentum. A speed of the request replaces
    it. Raises Refusal if the approach would take longer than APPROACH_LONGEST_S."""
    model, least_N = tuning.model, min(tuning.order.forces)
    slow = machine_bounds.approach_counts_per_s(model, facts, least_N)
    own, delivered = held.approach_velocity_max, objects.default("approach_velocity_max")
    per_mm = 1e-3 * abs(facts.required_encoder.scale)
    settings: Settings = {"approach_velocity_max": slow}
    if tuning.order.approach_mm_per_s is not None:
        slow = max(1, round(tuning.order.approach_mm_per_s * per_mm))
        impact = machine_bounds.impact_N(model, facts, slow)
        tuning.say(
            f"approach at {slow / per_mm:.3g} mm/s as given: by the model, the momentum of the "
            f"axis alone causes an impact of {impact:.3g} N"
        )
        settings = {} if slow == own else {"approach_velocity_max": slow}
    elif own <= slow and own != delivered:
        slow, settings = int(own), {}
    elif own != delivered:
        tuning.say(
            f"approach_velocity_max becomes {slow / per_mm:.3g} mm/s, it was {own / per_mm:.3g}: "
            "with this speed the momentum of the axis alone would cause an impact of "
            f"{machine_bounds.impact_N(model, facts, own):.3g} N, above "
            f"{machine_bounds.IMPACT_SHARE:.2g} times the least force"
        )
    gap = machine_bounds.gap_counts(model)
    if gap > APPROACH_LONGEST_S * slow:
        raise Refusal(
            "approach", f"expected an approach of at most {APPROACH_LONGEST_S:g} s, but at "
            f"{slow / per_mm:.3g} mm/s the {gap / per_mm:.3g} mm of the model take "
            f"{gap / slow:.3g} s: start nearer to the workpiece and correct `approach` of the "
            f"model, or give `approach_mm_per_s` {1.1 * gap / APPROACH_LONGEST_S / per_mm:.2g}"
        )  # fmt: skip
    return settings


def _force_bound(tuning: TuningFolder, held: AxisSettings, facts: PlantFacts) -> Settings:
    """Returns the `force_max` of the request if the axis has none, so that the axis keeps the bound
    with the force law. Also replaces a larger one that an earlier run in this folder has written. A
    sensor at an end of its range cannot show a larger force, so the bound is below this end."""
    counts = tuning.order.force_max_N / abs(facts.required_reading.per_count)
    written = (BEFORE.read(tuning.folder) or {}).get("force_max") == 0
    if held.force_max and not (written and held.force_max > counts):
        return {}
    reading = bounds.of_reading(PlannedValues(tuning.axis, {}))
    most = READABLE_SHARE * reading.most if reading else counts
    return {"force_max": math.floor(256 * min(counts, most)) / 256}


def _expect_noise(tuning: TuningFolder, rest: Rest, facts: PlantFacts) -> None:
    """Raises Refusal if the rounding to ADC codes hides the response. The error of rounding is like
    noise if the measured force has noise, or if the excitation changes it by many codes."""
    reading = facts.required_reading
    newton_per_code = abs(reading.per_count) * 2.0 ** (8 - reading.bits)
    least_N = ROUNDED_CODES_MIN * newton_per_code / analyzer.SWING
    quiet = rest.noise_lsb is not None and rest.noise_lsb < analyzer.QUIET_LSB
    if quiet and min(tuning.order.forces) < least_N:
        raise Refusal(
            "dither", f"expected a noise of at least {analyzer.QUIET_LSB:g} ADC codes rms at rest, "
            f"or a smallest force of at least {least_N:.3g} N, so that the excitation changes the "
            f"force by {ROUNDED_CODES_MIN} codes, got {rest.noise_lsb:.2g} codes and "
            f"{min(tuning.order.forces):g} N: the rounding to ADC codes hides the response; give "
            "larger forces, or use an ADC with more bits"
        )  # fmt: skip


def _contact_settings(
    tuning: TuningFolder, held: AxisSettings, rest: Rest, facts: PlantFacts
) -> Settings:
    """Returns the lowest `contact_force` that the noise permits, if `contact_force` has the default
    value or one that the noise exceeds. Raises Refusal if the noise exceeds each `contact_force`
    below the forces of the request.

    Below `contact_force`, the integral action does not work. With a larger `contact_force`, the
    force of a weak force law could stay there.
    """
    if rest.noise_lsb is None:
        return {}
    noise = rest.noise_lsb * 2.0 ** (8 - held.adc_bits)
    own, delivered = held.contact_force, objects.default("contact_force")
    least, least_N = CONTACT_NOISE_MIN * noise, min(tuning.order.forces)
    newton_per_count = abs(facts.required_reading.per_count)
    most = analyzer.FORCE_MIN_SHARE * least_N / newton_per_count
    if least > most:
        needed_N = least * newton_per_count / analyzer.FORCE_MIN_SHARE
        raise Refusal(
            "noise", f"expected a smallest force of at least {needed_N:.3g} N, so that contact can "
            f"be told from the noise of the sensor, {noise * newton_per_count:.2g} N rms, got "
            f"{least_N:g} N: give larger forces, or use a sensor with less noise"
        )  # fmt: skip
    if own != delivered and own >= least:
        return {}
    counts = max(CONTACT_NOISE_FACTOR * noise, 2 * abs(rest.reading), CONTACT_COUNTS_MIN)
    return {"contact_force": round(256 * max(least, min(counts, most, max(own, least)))) / 256}


def _expect_resolution(tuning: TuningFolder) -> None:
    """Raises Refusal if the smallest step of the output moves the force too far before the sensor
    shows it. Each law then swings about its set-point by about half of this force."""
    model, least_N = tuning.model, min(tuning.order.forces)
    facts = linear.facts(model)
    reading = facts.required_reading
    late_s = reading.sampling.delay_s() if reading.sampling else 0.0
    late_s += facts.bus.cycle_ticks / TICKS_PER_S
    plant = linear.linearise(model, outputs=(reading.signal,), modes=tuning.states)
    step_N = facts.volts_per_step * abs(plant.at(1j / late_s).item())
    if step_N > STEP_SHARE_MAX * least_N:
        raise Refusal(
            "resolution", "expected an output whose smallest step moves the force by at most "
            f"{STEP_SHARE_MAX * least_N:.3g} N, {STEP_SHARE_MAX:.0%} of the least force, before "
            f"the sensor shows it, but in {1e3 * late_s:.3g} ms it moves the force of this model "
            f"by {step_N:.3g} N: use an output of more bits, a drive with a lower speed or force "
            f"at full command, a faster sensor, or forces from {step_N / STEP_SHARE_MAX:.3g} N"
        )  # fmt: skip


def measuring_law(tuning: TuningFolder) -> tuple[Bank, float]:
    """Returns a filter bank for the measurement, and the highest frequency in Hz at which its loop
    may become unstable. With this filter bank, the loop is stable with a margin for all plants of
    the prior knowledge.

    The integral action of the bank brings the force to the set-point. If the loop is badly damped,
    the bank has a low pass, which permits a larger gain where a resonance limits it, and another
    integral rate. Raises Refusal if the gain is so small that the command for the smallest
    set-point is rounded to 0.
    """
    model, members = str(tuning.model), _measured_members(tuning)
    grids = _measured_grids(tuning, members)
    law = _fast_law(tuning, members, grids)
    if law.largest_ms(grids) > MS_MEASURING:
        damped = [_largest_law(grids, Bank(1.0, rate, sections=sections))
                  for rate in (*SLOW_RATES_RAD_PER_S, *RATES_RAD_PER_S)
                  for sections in ((), *((low_pass(hz),) for hz in LOW_PASS_HZ))]  # fmt: skip
        damped = [one for one in damped if one.largest_ms(grids) <= MS_MEASURING]
        law = max(damped, key=lambda one: one.bandwidth_hz(grids), default=law)
    bank = law.bank.quantised()
    if why := linear.facts(model).dead_law(bank.gain_at_rest(), min(tuning.order.forces)):
        raise Refusal("dead_zone", why)
    _expect_resolution(tuning)
    return bank, law.highest_hz


def _measured_members(tuning: TuningFolder) -> list[Member]:
    """Returns the plants of the prior knowledge, for which a measurement has to be stable."""
    values = {n: r[0] for n, r in plant_set.ranges_of(str(tuning.model), tuning.order.over).items()}
    factors = np.array(np.meshgrid(*[SPREAD_FACTORS] * len(values))).T.reshape(-1, len(values))
    return [
        Member({n: f * values[n] for n, f in zip(values, row, strict=True)}, tuning.states)
        for row in factors
    ]


def _measured_grids(tuning: TuningFolder, members: list[Member]) -> list[Grid]:
    return [Grid(PlantSet(str(tuning.model)), [member], ("zoh+1",)) for member in members]


def measure(tuning: TuningFolder, checked: Checked, free: FreeResponse) -> MeasuredResponses:
    """Measures the responses in contact. A drive that integrates reaches the set-point without the
    integral of the law, which dry friction lets move the force to and fro: if the force does not
    come to rest, the responses are measured again with a law without integral."""
    try:
        return tune_measure.measure(tuning, checked, free)
    except analyzer.Unsettled as refusal:
        bank = _law_without_integral(tuning) if checked.law.bank.integral_rad_per_s else None
        if bank is None:
            raise
        why = "the force does not come to rest: it is measured with a law without integral"
        raise MeasureAgain(refusal.name, refusal.text, why, law=bank.keys()) from None


def _law_without_integral(tuning: TuningFolder) -> Bank | None:
    """Returns a P law for the measurement, or None if with it a force error would remain."""
    model = tuning.model
    if not known.has_integral(model, known.INTEGRAL_BAND_HZ):
        return None
    grids = _measured_grids(tuning, _measured_members(tuning))
    law = _largest_law(grids, Bank(1.0))
    if law.largest_ms(grids) > MS_MEASURING:
        return None
    bank = law.bank.quantised()
    dead = linear.facts(str(model)).dead_law(bank.gain_at_rest(), min(tuning.order.forces))
    return None if dead else bank


@dataclass(frozen=True)
class MeasuringLaw:
    """A force law with the largest gain at which all loops have the gain margin of the measurement.
    `highest_hz`: highest frequency in Hz at which one of the loops may become unstable."""

    bank: Bank
    highest_hz: float

    def largest_ms(self, grids: list[Grid]) -> float:
        """Returns the largest |S| of the loops, or infinity for a gain of 0."""
        if not self.bank.force_gain:
            return math.inf
        return max(float(grid.figures(self.bank).Ms.max()) for grid in grids)

    def bandwidth_hz(self, grids: list[Grid]) -> float:
        """Returns the smallest bandwidth fS of the loops in Hz."""
        return min(float(grid.figures(self.bank).fS_Hz.min()) for grid in grids)


def _largest_law(grids: list[Grid], bank: Bank) -> MeasuringLaw:
    """Returns the law of a filter bank, whose gain is 1, with its largest gain."""
    bounds = Bounds((math.inf,), 1 / LIMIT_FACTOR, None, LIMIT_FACTOR * GAIN_MAX)
    limits = [grid.largest_gain(bank, bank.hf_gain(), bounds) for grid in grids]
    highest = max((one.place.frequency_hz for one in limits if one.place), default=0.0)
    gain = math.floor(min(one.gain for one in limits) * 256) / 256
    return MeasuringLaw(replace(bank, force_gain=gain), highest)


def _fast_law(tuning: TuningFolder, members: list[Member], grids: list[Grid]) -> MeasuringLaw:
    """Returns the law with the smallest integral rate with which each loop is fast enough, or the
    law of the fastest loops."""
    model = str(tuning.model)
    volts = linear.facts(model).volts_per_code
    slowest = min(
        volts * abs(linear.linearise(model, outputs=("adc0",), overrides=member.values,
                                     modes=tuning.states).at(0.0).item())
        for member in members
    )  # fmt: skip
    best: tuple[float, MeasuringLaw] | None = None
    for rate in RATES_RAD_PER_S:
        law = _largest_law(grids, Bank(1.0, rate))
        crossover = law.bank.force_gain * rate * slowest
        if best is None or crossover > best[0]:
            best = crossover, law
        if best[0] > CROSSOVER_RAD_PER_S:
            break
    assert best is not None  # `best` is set, because RATES_RAD_PER_S is not empty
    return best[1]


def design(tuning: TuningFolder, fitted: Fitted, checked: Checked) -> Designed:
    """Designs a filter bank for the set of plants around the fitted values."""
    order = tuning.order
    asked = outcome.DesignOrder(
        str(tuning.model), over=fitted.over, overrides=fitted.values,
        together=fitted.together or ({},), ms=checked.ms or order.ms,
        hf_gain=_hf_gain(tuning, checked), ramp_min_s=simulation.RAMP_S,
        static_error_max=simulation.ERROR_MAX,
        may_slow=order.approach_mm_per_s is None and "approach_velocity_max" in checked.settings,
        firmware=contact.firmware_of(tuning, checked, fitted.values), states=tuning.states,
        forces_N=order.forces,
    )  # fmt: skip
    found = _designed(tuning, fitted, asked)
    laws = {"before": checked.before.bank, "designed": found.bank}
    ms = found.worst.largest_ms
    result = found.result()
    objects = objects_of(tuning, checked, found.bank, found.loss_objects, ms, found.plants)
    if found.slowed:
        tuning.say(f"approach: {found.slowed.text}")
        per_m = abs(linear.facts(tuning.model).required_encoder.scale)
        objects["approach_velocity_max"] = max(1, round(found.slowed.to_m_per_s * per_m))
    done = Designed(
        **vars(result), cut=_cut(result), times_p=_times_p(result),
        on_fitted=margins.on_fitted(tuning, fitted, laws, checked.latency_ticks), objects=objects,
    )  # fmt: skip
    if done.cut:
        tuning.say(done.cut)
    p = done.p
    if done.times_p is not None and done.times_p < BANDWIDTH_FACTOR and isinstance(p, PFigures):
        limited_by = (
            f"P alone has {p.fS_Hz:.3g} Hz at the same margins, the bank {done.times_p:.3g} "
            f"times that. {done.limited_by}"
        )
        tuning.say(limited_by)
        done = replace(done, limited_by=limited_by)
    return done


class _NotBorne(Exception):
    """Exception: because of the error of the model, the Ms of a force law is too large. ms:
    largest Ms with the measured part that the model lacks. above: distance of Ms from 1, divided by
    the permitted distance."""

    def __init__(self, ms: float, above: float) -> None:
        super().__init__(ms, above)
        self.ms, self.above = ms, above


def _designed(
    tuning: TuningFolder, fitted: Fitted, order: outcome.DesignOrder
) -> outcome.DesignOutcome:
    """Designs the force law. If the model does not explain the responses, the law is designed for a
    smaller Ms, until the plants with the measured part that the model lacks have at most the Ms of
    the request. Raises Refusal."""

    def design(ms: float, accept: for_set.Accept | None) -> outcome.DesignOutcome:
        try:
            return for_set.design(replace(order, ms=ms), None, tuning.say, accept=accept)
        except (InputError, _core.SimulationError) as error:
            raise Refusal("design", str(error)) from None

    if not fitted.unexplained:
        return design(order.ms, None)

    def borne(found: outcome.DesignOutcome) -> list[float]:
        """Returns the largest Ms with each delay. Raises _NotBorne."""
        timings = found.order.goal(found.bits).timings
        peaks = unexplained.largest_ms(found.plants, found.bank, timings, fitted.unexplained)
        above = max(
            (peak - 1) / (most * order.ms - 1)
            for peak, most in zip(peaks.values(), (1.0, outcome.LATE), strict=False)
        )
        if above > 1:
            raise _NotBorne(max(peaks.values()), above)
        return list(peaks.values())

    ms = order.ms
    for _ in range(MODEL_ERROR_ROUNDS):
        try:
            # A law whose Ms is too large because of the error of the model is not simulated.
            found = design(ms, borne)
            peaks = borne(found)
        except _NotBorne as error:
            step = max(MODEL_ERROR_STEP_MIN, min(MODEL_ERROR_STEP_MAX, 1 / error.above))
            ms = 1 + (ms - 1) * step
            if ms - 1 < MODEL_ERROR_MS_MIN * (order.ms - 1):
                break
            tuning.say(
                f"with the part that the model lacks, Ms is {error.ms:.3g}; the law is designed "
                f"again, for Ms {ms:.3g}"
            )
            continue
        worst = found.worst
        found.worst = replace(
            worst, Ms=max(worst.Ms or 0.0, peaks[0]), Ms_late=max(worst.Ms_late or 0.0, peaks[-1])
        )
        return found
    raise Refusal(
        "chi2", f"{fitted.why_not}; no force law bears the part that the model lacks",
        *tune_fit.proposed(tuning, tune_fit.TRIED.required(tuning.folder), fitted.lines),
    )  # fmt: skip


def design_line(tuning: TuningFolder, done: Designed) -> str:
    """Returns the text about the result of the step `design`."""
    line = f"{done.chosen}, fS {done.worst.fS_Hz:.3g} Hz, Ms {done.worst.Ms:.3g}"
    times = done.times_p
    return line + ("" if times is None else f", {times:.3g} times P's bandwidth")


def _cut(designed: DesignResult) -> str:
    """Returns a text about the reduction of the gain because of simulated contacts, and its reason.
    Returns "" if the gain was not reduced."""
    times, chosen = designed.gain_reductions, designed.chosen
    if not times:
        return ""
    left = designed.worst
    searched = next((s.worst for s in designed.structures if s.name == chosen), None)
    why = [f": {cut.case}, {cut.why}" for cut in designed.gain_cuts][:1]
    return (
        f"{chosen} x {simulation.BACKOFF**times:.3g}: contacts simulated with the fitted plant did "
        f"not settle at the designed gain{''.join(why)}"
        + (f"; the search had reached fS {searched.fS_Hz:.3g} Hz and Ms {searched.Ms:.3g}, "
           f"after the reduction they are {left.fS_Hz:.3g} Hz and {left.Ms:.3g}"
           if searched and searched.fS_Hz and left.fS_Hz else "")
    )  # fmt: skip


def _times_p(designed: DesignResult) -> float | None:
    """Returns the bandwidth of the filter bank divided by the bandwidth of the P law. Returns None
    if there is no gain with which the P law keeps the margins."""
    p, bank = designed.p, designed.worst.fS_Hz
    if isinstance(p, NoPFigures) or not p.fS_Hz or bank is None:
        return None
    return bank / p.fS_Hz


def _hf_gain(tuning: TuningFolder, checked: Checked) -> float | None:
    """Returns the largest permitted gain at high frequencies in DAC codes per 8-bit count, or None
    if the noise is not known.

    The bound in the firmware assumes a noise of one ADC code. In addition, the noise at the output
    of the force law must be so small that the drive stays linear.
    """
    if checked.rest.noise_lsb is None:
        return None
    noise = max(checked.rest.noise_lsb, ROUNDING_LSB)
    bits = linear.facts(tuning.model).required_reading.bits
    # Rms value of uniform noise with the largest amplitude at which the drive stays linear.
    rms_codes = known.NOISE_PEAK_FACTOR * known.linear_codes(tuning.model) / math.sqrt(3)
    linear_gain = rms_codes / (noise * 2.0 ** (8 - bits))
    return min(hf_of_noise(bits, noise), linear_gain)


def simulate(
    tuning: TuningFolder, designed: Designed, checked: Checked, fitted: Fitted
) -> Simulated:
    """Simulates contacts and impacts with the fitted plant, and contacts with random plants of the
    set of plants. The firmware is part of all simulations."""
    return Simulated(contact.simulated(contact.FittedAxis(tuning, checked, fitted, designed)))


def simulate_line(tuning: TuningFolder, done: Simulated) -> str:
    """Returns the text about the result of the step `simulate`."""
    kinds = [row.kind for row in done.contacts]
    errors = ", ".join(
        f"{row.static_error_percent:.2g} %" for row in done.contacts if row.kind == "contact"
    )
    text = f"{kinds.count('contact')} contacts, {kinds.count('strike')} strikes and "
    return text + f"{kinds.count('set')} of the set settle, static error {errors}"


def write(tuning: TuningFolder, designed: Designed, checked: Checked) -> Written:
    """Writes the filter bank to the axis. Before that, writes a copy of the previous values to a
    file. `force_max` is that of the present request, for which an earlier design may be kept."""
    axis = tuning.axis
    values = {n: v for n, v in designed.objects.items() if n != "force_max"}
    values |= {n: v for n, v in checked.settings.items() if n == "force_max"}
    disable(axis)
    if BEFORE.read(tuning.folder) is None:
        names = [n for n in values if n != "force_bank"] + ["force_bank"]
        before = axis.link.read(names)
        # An output_bias that was measured has already been written to the axis.
        found = as_found.FOUND.read(tuning.folder)
        if found and "output_bias" in before:
            before["output_bias"] = found.values["output_bias"]
        BEFORE.write(tuning.folder, before)
    try:
        axis.set(force_bank=0)
        axis.set(**values)
    except Refused as error:
        state = axis.text(f"bank_state_{experiment_file.BANK}")
        _restore_earlier_law(tuning)
        raise Refusal(
            "bank" if state == "valid" else state,
            f"expected the axis to accept the filter bank of the force law, got: {error}",
        ) from None
    certificate = axis.text(f"certificate_state_{experiment_file.BANK}")
    if certificate != "fits":
        _restore_earlier_law(tuning)
        raise Refusal(
            "certificate",
            "expected a certificate of the filter bank that is valid for the axis, got the "
            f"certificate state {certificate}",
        )
    as_found.replace_saved(tuning, axis.link.read(list(values)))
    return Written(certificate, len(values))


def write_line(tuning: TuningFolder, done: Written) -> str:
    """Returns the text about the result of the step `write`."""
    return f"{done.objects} objects, certificate {done.certificate_state}"


def _has_lost(tuning: TuningFolder, designed: Designed) -> bool:
    """Returns True if the axis does not have the filter bank."""
    names = ("force_bank", f"bank_crc_{experiment_file.BANK}")
    return any(value != designed.objects[name] for name, value in tuning.axis.get(*names).items())


def _ensure_written(tuning: TuningFolder, designed: Designed, checked: Checked) -> None:
    """Writes the filter bank again if the axis has lost it because of a power cut or a reset."""
    if _has_lost(tuning, designed):
        tuning.say("the axis has lost the bank; the bank is written again")
        write(tuning, designed, checked)


def _restore_earlier_law(tuning: TuningFolder) -> None:
    """Restores the values of the objects before write(). The step `write` must then run again."""
    as_found.replace_saved(tuning, BEFORE.required(tuning.folder))
    as_found.put_back(tuning)
    for name in (
        WRITE.file.name,
        BEFORE.name,
    ):  # when write() is repeated, the previous force law of the axis may be another one
        (tuning.folder / name).unlink(missing_ok=True)


def verify(
    tuning: TuningFolder, written: Written, designed: Designed, measured: MeasuredResponses,
    checked: Checked, fitted: Fitted,
) -> Verified:  # fmt: skip
    """Measures the responses again with the active filter bank. Also measures Ms of the loop with
    this filter bank."""
    _ensure_written(tuning, designed, checked)
    order = with_measured_way(tuning, tuning.order, measured.between.way)
    # A mode above the measured band may limit the loop, so |S| is verified beyond this band.
    high = highest_hz(linear.facts(tuning.model))
    band_hz = (min(order.band_hz[0], high / BAND_RATIO_MIN), high)
    order = replace(order, band_hz=band_hz, averages=max(5, order.averages // 2))
    fitted_axis = contact.FittedAxis(tuning, checked, fitted, designed)
    gap, start = machine_bounds.gap_counts(tuning.model), checked.rest.position
    levels: dict[str, VerifiedResponse] = {}
    first = max(1, measured.levels[f"{order.forces[0]:g}N"].amplitude // 4)
    try:
        with returning(tuning, checked):
            for force in order.forces:
                if gap and abs(tuning.axis.integer("position") - start) > AWAY_GAPS * gap:
                    go_home(tuning, checked)
                about, order = _verified(fitted_axis, force, first, order)
                first = next_amplitude(about.amplitude, force, order.forces)
                levels[f"verified-{force:g}N"] = about
                ms = checked.ms or tuning.order.ms
                _expect_predicted(about, force, checked.band_hz, band_hz[1], ms)
    except Refusal as refusal:
        _restore_earlier_law(tuning)
        text = f"{refusal.text}; {EARLIER_LAW_AGAIN}"
        if isinstance(refusal, DesignAgain):
            raise DesignAgain(refusal.name, text, refusal.why, refusal.ms) from None
        if isinstance(refusal, MeasureAgain):
            raise MeasureAgain(refusal.name, text, refusal.why, band_hz=refusal.band_hz) from None
        raise Refusal(refusal.name, text) from None
    return Verified(levels)


def _expect_predicted(
    about: VerifiedResponse, force: float, measured_hz: tuple[float, float], most_hz: float,
    limit_ms: float,
) -> None:  # fmt: skip
    """Raises Refusal if the measured Ms at a force in N is larger than predicted, by more than its
    error. `measured_hz`: band of the responses. `most_hz`: highest frequency that can be measured.
    `limit_ms`: limit of Ms for which the law was designed."""
    error = _bound_of_peak(about) * about.Ms_error
    if about.Ms - error <= about.Ms_predicted + MS_TOLERANCE:
        return
    text = (
        f"expected a measured Ms that exceeds the predicted Ms {about.Ms_predicted:.3g} at "
        f"{force:g} N by at most {MS_TOLERANCE:g}, got {about.Ms:.3g} +-{error:.2g} at "
        f"{about.Ms_hz:.3g} Hz"
    )
    low, high = measured_hz
    if about.Ms_hz <= high:
        ms = MS_AGAIN_MARGIN * limit_ms * about.Ms_predicted / about.Ms
        why = (
            f"Ms at {force:g} N is {about.Ms:.3g}, {about.Ms_predicted:.3g} was predicted: the law "
            f"is designed again, for Ms {ms:.2g}"
        )
        raise DesignAgain("verify", text, why, ms)
    text += (
        f": a mode that the model lacks, above the responses, which end at {high:.3g} Hz; give "
        f"`band_hz` {low:.3g}:{most_hz:.3g}, so that they show it"
    )
    why = (
        f"|S| has a peak at {about.Ms_hz:.3g} Hz, above the responses, which end at {high:.3g} Hz: "
        f"they are measured again to {most_hz:.3g} Hz"
    )
    raise MeasureAgain("verify", text, why, band_hz=(low, most_hz))


def _bound_of_peak(about: VerifiedResponse) -> float:
    """Returns how many standard errors the largest of many noisy values of |S| may exceed the
    largest true value, with a probability of PEAK_PROBABILITY."""
    return normal_bound(1 - PEAK_PROBABILITY / max(1, about.lines))


def _verified(
    fitted_axis: contact.FittedAxis, force: float, first: int, order: TuningOrder
) -> tuple[VerifiedResponse, TuningOrder]:
    """Returns the response at a force with the measured Ms. Also returns the request, with the
    number of averages that this response needed."""
    tuning = fitted_axis.tuning
    touched: list[contact.TouchDown] = []

    def take(measures: contact.Touching) -> Level:
        level = measures.contact(force, True)
        touched.append(measures.touch)
        return level

    rubs = bool(fitted_axis.fitted.friction)
    for factor in AVERAGES_FACTORS:  # a response with a small amplitude needs more averages
        used = replace(order, averages=factor * order.averages)
        asked = measuring_order(tuning, used, first=first, rubs=rubs)
        level, figures = take_response(
            tuning, f"verified-{force:g}N", force_objects(tuning), asked, contact.Touching, take
        )
        lacks = fitted_axis.fitted.unexplained.get(f"{force:g}N")
        peak = margins.peaks(fitted_axis, level, lacks)
        if peak:
            peaks = contact.write(fitted_axis, touched[-1])
            row = VerifiedResponse(**(vars(figures) | vars(peak) | vars(peaks)))
            return row, used
        tuning.say("the sensitivity function is uncertain at all frequencies: more averages")
    raise Refusal(
        "verify", "expected at least one frequency at which the uncertainty of the measured "
        "sensitivity function is small, got none; measure with more averages"
    )  # fmt: skip


def verify_line(tuning: TuningFolder, done: Verified) -> str:
    """Returns the text about the result of the step `verify`."""
    pairs = zip(tuning.order.forces, done.levels.values(), strict=True)
    return "; ".join(
        f"{force:g} N Ms {level.Ms:.3g}, predicted {level.Ms_predicted:.3g}"
        for force, level in pairs
    )


def store(tuning: TuningFolder, verified: Verified, designed: Designed, checked: Checked) -> Stored:
    """Stores the parameters and the certificate in the non-volatile memory of the axis."""
    _ensure_written(tuning, designed, checked)
    axis = tuning.axis
    disable(axis)
    try:
        parameter_set.store(axis)
    except Refused as error:
        if REASONS[NO_MEMORY] in str(error):
            return Stored(False, str(error))
        _restore_earlier_law(tuning)
        raise Refusal(
            "store",
            "expected the axis to store the force law in its memory, got: "
            f"{error}; {EARLIER_LAW_AGAIN}",
        ) from None
    return Stored(True)


def store_line(tuning: TuningFolder, done: Stored) -> str:
    """Returns the text about the result of the step `store`."""
    return "parameters and certificate are stored" if done.stored else f"not stored: {done.why}"


@dataclass(frozen=True)
class TuningStep(Generic[R]):
    """One step of a tuning. `function` is called with the TuningFolder and the results of the steps
    in `takes`, and returns the result of the step. The result is written to `file`. `line` is a
    function that returns a text about the result."""

    name: str
    function: Callable[..., R]
    file: FolderFile[StepFile[R]]
    takes: tuple[str, ...]
    line: Callable[[TuningFolder, R], str]

    def done(self, tuning: TuningFolder) -> R | None:
        """Returns the result of the step, or None if the step was not done yet."""
        held = self.file.read(tuning.folder)
        return None if held is None else held.result

    def result(self, tuning: TuningFolder) -> R:
        """Returns the result of the step. Raises Refusal if the step was not done yet."""
        done = self.done(tuning)
        if done is None:
            raise Refusal(
                self.name,
                "expected the complete result of this step of `tune` from an earlier run, got "
                "none; run this step first",
            )
        return done

    def run(self, tuning: TuningFolder) -> str:
        """Runs the step and writes its result and duration to the file. Returns the text about the
        result."""
        began, tick = time.monotonic(), tuning.axis.integer("tick_count")
        results = [STEP_TABLE[name].result(tuning) for name in self.takes]
        result = self.function(tuning, *results)
        took = time.monotonic() - began
        ticks = (tuning.axis.integer("tick_count") - tick) % 2**32
        self.file.write(
            tuning.folder, StepFile(round(took, 3), round(ticks / TICKS_PER_S, 3), result)
        )
        return f"{self.line(tuning, result)} ({took:.1f} s)"


CHECK = TuningStep("check", check, FolderFile("check.json", StepFile[Checked]), (), check_line)
FREE = TuningStep(
    "free", tune_measure.free, FolderFile("free.json", StepFile[FreeResponse]), ("check",),
    tune_measure.free_line,
)  # fmt: skip
MEASURE = TuningStep("measure", measure, MEASURED, ("check", "free"), tune_measure.measure_line)
FIT = TuningStep(
    "fit", tune_fit.fit, FolderFile("fit.json", StepFile[Fitted]), ("free", "measure"),
    tune_fit.fit_line,
)  # fmt: skip
DESIGN = TuningStep(
    "design", design, FolderFile("design.json", StepFile[Designed]), ("fit", "check"), design_line
)
SIMULATE = TuningStep(
    "simulate", simulate, FolderFile("simulate.json", StepFile[Simulated]),
    ("design", "check", "fit"), simulate_line,
)  # fmt: skip
WRITE = TuningStep(
    "write", write, FolderFile("write.json", StepFile[Written]), ("design", "check"), write_line
)
VERIFY = TuningStep(
    "verify", verify, FolderFile("verify.json", StepFile[Verified]),
    ("write", "design", "measure", "check", "fit"), verify_line,
)  # fmt: skip
STORE = TuningStep(
    "store",
    store,
    FolderFile("store.json", StepFile[Stored]),
    ("verify", "design", "check"),
    store_line,
)
AnyStep = (
    TuningStep[Checked] | TuningStep[FreeResponse] | TuningStep[MeasuredResponses]
    | TuningStep[Fitted] | TuningStep[Designed] | TuningStep[Simulated] | TuningStep[Written]
    | TuningStep[Verified] | TuningStep[Stored]
)  # fmt: skip
IN_ORDER: tuple[AnyStep, ...] = (
    CHECK, FREE, MEASURE, FIT, DESIGN, SIMULATE, WRITE, VERIFY, STORE
)  # fmt: skip
STEP_TABLE = {step.name: step for step in IN_ORDER}
STEPS = tuple(STEP_TABLE)
# {field of the request: first step that must run again after a change of this field}.
# The step `check` always runs.
AGAIN_FROM = {
    "model": "fit", "forces": "measure", "over": "fit", "priors": "fit", "states": "fit",
    "ms": "design",
    "force_max_N": "simulate", "band_hz": "free", "averages": "free", "travel_mm": "free",
    "squeeze_mm": "measure", "approach_mm_per_s": "measure", "seed": "free",
}  # fmt: skip
# names of objects, in the order of the fields of a TuningIdentity
AXIS_KEYS = ("object_table_hash", "serial_number")


def _expect_forces(order: TuningOrder) -> None:
    """Raises InputError for a request with a single force, or with a force that exceeds its bound
    together with the excitation."""
    if len(order.forces) < 2:
        raise ParameterError(
            "forces", f"expected at least two forces, got {len(order.forces)}; with a single "
            "force, `tune` cannot find which parameters depend on the force; give two forces, for "
            "example 30 and 150"
        )  # fmt: skip
    most_N = order.force_max_N / (1 + analyzer.SWING / 2)
    if max(order.forces) >= most_N:
        needed_N = 1.01 * max(order.forces) * (1 + analyzer.SWING / 2)
        raise ParameterError(
            "forces", f"expected forces below {most_N:.4g} N, so that force and excitation "
            f"together stay below `force_max_N`, got {max(order.forces):g} N; give smaller "
            f"forces or `force_max_N` {math.ceil(needed_N)}"
        )  # fmt: skip


def _changes(before: TuningOrder, after: TuningOrder) -> dict[str, str]:
    """Compares two requests. Returns {field: text with the old and the new value} for all changed
    fields except `model`."""
    changes = {}
    for (name, old), new in zip(vars(before).items(), vars(after).values(), strict=True):
        if name != "model" and old != new:
            texts = [", ".join(map(str, v)) if isinstance(v, tuple) else str(v) for v in (old, new)]
            changes[name] = f"{name} {' to '.join(texts)}"
    return changes


class Tuning(TuningFolder):
    """Runs the steps of a tuning on an axis that this program owns and that is disabled. The folder
    `folder` is created if it does not exist.

    say(text): function that shows each step and its actions. If the folder contains a tuning with
    another request or model, the results that do not depend on the change are kept. Raises
    InputError if the folder belongs to another axis, if it contains a damaged file, or if the
    request names something that the model does not have.
    """

    def __init__(
        self, axis: Axis, order: TuningOrder, folder: str | Path,
        say: as_found.Say = as_found.say_nothing,
    ) -> None:  # fmt: skip
        _expect_forces(order)
        super().__init__(axis, order, folder, say)
        self.step = STEPS[0]
        # Names of steps that are done and stay valid when an earlier step runs again.
        self.kept: frozenset[str] = frozenset()
        # Fields of the result of `check` with which the kept results were made.
        self.carried: dict[str, Any] = {}
        self.refused: StepRefusal | None = None
        self._check_files()
        self._claim()

    def _check_files(self) -> None:
        """Reads all files that later steps need. Raises InputError for the first damaged or missing
        file."""
        free, measured, verified = FREE.done(self), MEASURE.done(self), VERIFY.done(self)
        for step in (CHECK, FIT, DESIGN, SIMULATE, STORE):
            step.file.read(self.folder)
        if WRITE.done(self):
            BEFORE.required(self.folder)
        as_found.FOUND.read(self.folder)
        TUNE.read(self.folder)
        if free:
            self.check_response("free", "free")
        for name, level in (measured.levels if measured else {}).items():
            self.check_response(name, "measure")
            if level.small:
                self.check_response(small_of(name), "measure")
        for name in verified.levels if verified else ():
            self.check_response(name, "verify")
        for file in sorted(self.folder.glob("touch-down-*.csv")):
            read_touch_down(file)

    def _claim(self) -> None:
        """Writes the request to the folder. If the request has changed, keeps the results of the
        steps that do not depend on the change. Raises InputError if the folder belongs to another
        axis."""
        # The values of the request get the types of values from a file: 30 becomes 30.0.
        order = from_json(TuningOrder, to_json(self.order))
        digest = hashlib.sha256(self.given.read_bytes()).hexdigest()
        identity = TuningIdentity(order, digest, *map(self.axis.integer, AXIS_KEYS))
        held = TUNE.read(self.folder)
        if held is not None and held != identity:
            before, now = vars(held), vars(identity)
            other = [key for key in AXIS_KEYS if before[key] != now[key]]
            if other:
                raise InputError(
                    f"{self.folder}: expected a folder with the results of `tune` for this axis, "
                    f"got results with a different {', '.join(other)}; give another folder"
                )
            self._renew(held, identity)
        TUNE.write(self.folder, identity)

    def _renew(self, held: TuningIdentity, identity: TuningIdentity) -> None:
        """If the request or the model has changed, shows the change, and deletes the results of the
        steps that depend on it."""
        changes = _changes(held.order, identity.order)
        first = [STEPS.index(AGAIN_FROM[name]) for name in changes]
        if held.model_sha256 != identity.model_sha256:
            changes["model"] = "the model"
            first.append(STEPS.index(AGAIN_FROM["model"]))
        if not first:  # only the name of the model has changed, on which no step depends
            return
        done = [step for step in STEPS if self._file(step).exists()]
        checked = CHECK.done(self)
        kept = [step for step in done if step != STEPS[0] and STEPS.index(step) < min(first)]
        for step in STEPS:
            if step not in kept:
                self._file(step).unlink(missing_ok=True)
        self.kept = frozenset(kept)
        if checked and MEASURE.name in kept:
            names = ("band_hz", "averages", "law", *(("ms",) if DESIGN.name in kept else ()))
            self.carried = {name: getattr(checked, name) for name in names}
        if done:
            self.say(
                f"changed since the last run: {', '.join(changes.values())}; results kept: "
                f"{', '.join(kept) or 'none'}; the other steps run again"
            )

    def _file(self, step: str) -> Path:
        return self.folder / STEP_TABLE[step].file.name

    def run(self, only: str | None = None) -> TuningSummary:
        """Runs all steps that were not done yet. If `only` is given, runs only this step, even if
        it was already done. Returns the summary. After a Refusal or another exception, the axis has
        its previous parameters."""
        self.step = only or STEPS[0]
        try:
            with as_found.restoring(self):
                self._run_steps(only)
        except (Refusal, Refused, NoAnswer) as error:
            refusal = error if isinstance(error, Refusal) else of_link(self.axis, error)
            raise self._told(refusal) from None
        return self.summary()

    def _run_steps(self, only: str | None) -> None:
        """Runs one step or all. A step may raise MeasureAgain: then the responses are measured
        again, once for each reason. `verify` may raise DesignAgain: then the law is designed again,
        once."""
        left, before = list((only,) if only else STEPS), set[str]()
        larger: DesignAgain | None = None  # why the law is designed again
        while left:
            self.step = left.pop(0)
            try:
                self._do(STEP_TABLE[self.step], bool(only))
            except MeasureAgain as refusal:
                if only or refusal.name in before:
                    raise
                before.add(refusal.name)
                left = list(STEPS[STEPS.index(MEASURE.name) :])
                self._measure_again(refusal)
            except DesignAgain as refusal:
                if only or DESIGN.name in before or refusal.ms < MS_AGAIN_MIN:
                    raise
                before.add(DESIGN.name)
                left, larger = list(STEPS[STEPS.index(DESIGN.name) :]), refusal
                self._design_again(refusal)
            except Refusal as refusal:
                if larger is None or self.step != DESIGN.name:
                    raise
                self._limit_ms(0.0)
                text = f"{larger.text}; for Ms {larger.ms:.2g} no law was found: {refusal.text}"
                raise Refusal(larger.name, text) from None

    def _design_again(self, refusal: DesignAgain) -> None:
        self.say(refusal.why)
        self._limit_ms(refusal.ms)
        self._forget(DESIGN.name)

    def _limit_ms(self, ms: float) -> None:
        held = CHECK.file.required(self.folder)
        CHECK.file.write(self.folder, replace(held, result=replace(held.result, ms=ms)))

    def _forget(self, first: str) -> None:
        """Deletes the results of the step `first` and of all later steps, because these steps run
        again. Results that were kept after a change of the request are deleted too."""
        self.kept -= set(STEPS[STEPS.index(first) :])
        self._file(first).unlink(missing_ok=True)

    def _measure_again(self, refusal: MeasureAgain) -> None:
        self.say(refusal.why)
        held = CHECK.file.required(self.folder)
        checked = replace(
            held.result, band_hz=refusal.band_hz or held.result.band_hz,
            averages=max(refusal.averages, held.result.averages),
            law=refusal.law or held.result.law,
        )  # fmt: skip
        CHECK.file.write(self.folder, replace(held, result=checked))
        self._forget(MEASURE.name)

    def _told(self, refusal: Refusal) -> Refusal:
        """Shows what a refusal adds to the model, and writes the model with it."""
        lines, path = refusal.lines or None, self.folder / PROPOSED_MODEL
        if refusal.model:
            path.write_text(refusal.model, encoding="utf-8")
        model = str(path) if refusal.model else None
        self.refused = StepRefusal(self.step, refusal.name, refusal.text, lines, model)
        if lines:
            where = f"; {model} has it" if model else ""
            for line in (f"to be added to the model{where}:", *lines.splitlines()):
                self.say(line)
        return refusal

    def _do(self, step: AnyStep, again: bool) -> None:
        index = STEPS.index(step.name)
        place = f"{index + 1}/{len(STEPS)} {step.name}"
        if not again and step.done(self) is not None:
            lost = step.name == STEPS[-1] and _has_lost(self, DESIGN.result(self))
            again_by = ", but the axis does not have this law now; `only` store stores it again"
            self.say(f"{place}: done before{again_by if lost else ''}")
            return
        # the results of later steps depend on the result that is replaced
        for later in STEPS[index:]:
            if later == step.name or later not in self.kept:
                self._file(later).unlink(missing_ok=True)
        try:
            text = step.run(self)
        except (Refusal, Refused, NoAnswer) as error:
            # the step `check` has not changed the axis
            if step.name == STEPS[0] and isinstance(error, Refusal):
                raise
            raise of_link(self.axis, error) from None
        if step.name == CHECK.name and self.carried:
            held = CHECK.file.required(self.folder)
            CHECK.file.write(
                self.folder, replace(held, result=replace(held.result, **self.carried))
            )
        self.say(f"{place}: {text}")

    def summary(self) -> TuningSummary:
        """Returns the summary of the results of all steps that were done."""
        files = {
            name: held for name, step in STEP_TABLE.items()
            if (held := step.file.read(self.folder)) is not None
        }  # fmt: skip
        summary = TuningSummary(
            axis=self.axis.link.where,
            folder=str(self.folder),
            seconds={name: held.seconds for name, held in files.items()},
            axis_seconds={name: held.axis_seconds for name, held in files.items()},
            refused=self.refused,
        )
        fitted = FIT.done(self)
        if measured := MEASURE.done(self):
            summary = replace(summary, holds=tuple(tune_fit.validity_lines(measured, fitted)))
        if fitted:
            summary = replace(
                summary, parameters=fitted.parameters, friction=fitted.friction,
                friction_lines=fitted.lines,
            )  # fmt: skip
        if designed := DESIGN.done(self):
            summary = replace(
                summary, bank=designed.bank, worst=designed.worst, p=designed.p,
                on_fitted=designed.on_fitted, limited_by=designed.limited_by,
                cut=designed.cut or None, cuts=tuple(cut.text for cut in designed.gain_cuts),
                times_p=designed.times_p,
                simulated=tuple(row for row in designed.simulated if row.law == "design"),
                Ms_predicted=designed.worst.Ms,
            )  # fmt: skip
        if simulated := SIMULATE.done(self):
            summary = replace(summary, simulated=summary.simulated + simulated.contacts)
        if written := WRITE.done(self):
            summary = replace(summary, certificate_state=written.certificate_state)
        if verified := VERIFY.done(self):
            largest = max((level.Ms for level in verified.levels.values()), default=None)
            summary = replace(summary, levels=verified.levels or None, Ms_verified=largest)
        if stored := STORE.done(self):
            summary = replace(summary, stored=stored.stored)
        return summary
