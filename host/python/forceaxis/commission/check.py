"""First motion test of a new axis. The axis is observed at rest, then moved with a low output, and
then moved a short distance out and back. Each step has a result. After a failed step, the axis is
not moved."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from forceaxis.axis import actions, bus_times, parameter_file, parameter_set, quantity
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import TICKS_PER_S, NoAnswer, Refused
from forceaxis.bus import client
from forceaxis.commission.known import Weight
from forceaxis.commission.level import noise_of
from forceaxis.commission.refusal import ORPHANED, REMEDY_AFTER_KILL
from forceaxis.objects import BY_NAME, mask
from forceaxis.recordings.robust import quiet_of

REST_SAMPLES = 750  # number of samples of the recording at rest, which lasts half a second
# Without recordings: number of reads at rest, and time in s between two reads.
READINGS, READING_PERIOD_S = 25, 0.02
# Largest change of the encoder count that is regarded as standstill.
# The limit at standstill in the first motion test of the firmware has the same value.
STANDING_CNT = 2
DITHER_LSB = 0.4  # rms noise in ADC codes below which an average is not more accurate than one code
# Largest motion in the first motion test of the firmware, divided by `first_motion_counts`.
FIRST_MOTION_REACH = 8
# Default values of the move out and back: travel in encoder counts, and largest DAC code.
TRAVEL_CNT, OUTPUT_CODES = 400, 250
# Smallest distance of the first motion test, divided by the travel while the drive takes a weight.
# In this travel, a drive with an integral takes over the weight from the brake.
SAG_FACTOR = 2.0
# Objects of which an axis with a weight or a brake keeps the larger value. Without them it falls or
# has a fault when it is enabled or disabled the next time.
RAISED = ("brake_engage_ticks", "first_motion_counts", "first_motion_speed")
# steps in which the axis moves
MOVING_STEPS = ("first motion", "move", "weight")
# HOLD_S: time in s for which the position law holds the axis before its output is read.
# AT_REST_S: time in s over which the output at standstill is averaged.
# SAME_CODES: difference of two outputs, in DAC codes, up to which they count as equal.
HOLD_S, AT_REST_S, SAME_CODES = 1.5, 0.5, 2.0
# time in s in which the position law brings the axis to rest after the first motion test
AFTER_FIRST_MOTION_S = 0.5
# WEIGHT_TOLERANCE: largest relative difference between measured weight and weight of the model.
# HELD_TOLERANCE: largest relative difference of the output at standstill from output_bias.
# If HELD_TOLERANCE is exceeded, the sign of output_bias or the size of the weight is wrong.
# If output_bias has the wrong sign, the difference at standstill is twice the output_bias.
# A motor constant a third too low and a weight a tenth too high give a difference of 0.65.
WEIGHT_TOLERANCE, HELD_TOLERANCE = 0.1, 0.7
# Duration of each move in ticks, and largest speed of a move in encoder counts per tick.
MOVE_TICKS, MOVE_SPEED = 1000, 2.0
SETTLE_S = 1.3  # time in s from the end of a move to the read of the position error
# speed in encoder counts per tick that disables the axis: at least four times the speed of a move
MOVE_SPEED_MAX = 8
ARRIVED_CNT = 20  # largest position error at the end of a move
# Dry friction explains position errors of opposite signs at both ends of a move.
# FRICTION_UNLIKE: largest sum of the errors at both ends, divided by the larger one of them.
FRICTION_UNLIKE = 0.3
CREEP_CNT = 2  # largest motion of an axis at rest, in encoder counts, while its output is read
RESTORE_TRIES = 4
ENABLE_CHAIN = mask("digital_inputs", "enable")
LIMIT_POS, LIMIT_NEG = (mask("digital_inputs", f"limit_{way}") for way in ("positive", "negative"))
NO_LIMIT = 2**31 - 1
# {fault that can stop the first motion test: text about its most frequent causes}
FAULT_CAUSES = {
    "force_sensor_failed": "the force sensor is at an end of its range or unsteady: check "
    "cable, supply and force_zero_code",
    "current_sensor_failed": "the current is at the end of its range or jumps: check the wiring",
    "not_standing": "the axis does not come to a standstill: check brake and encoder cable",
    "amplifier_offset": "the axis moves without a command: trim the amplifier's offset; if it "
    "carries a weight or a counterbalance, give its model, or set output_bias",
    "encoder_reversed": "encoder and amplifier disagree: swap the encoder's channels or the "
    "motor's leads, whichever makes a positive code move toward the workpiece",
    "no_motion": "the encoder did not count: check amplifier, enable, brake and encoder cable",
    "drive_not_ready": "the drive did not come on within drive_on_ticks_max: check power and STO; "
    "on a bus the time has to be longer than drive_wait (wait_ms of axis_linux)",
    "runaway": "the axis moves faster or further than it should: check amplifier and encoder",
    "force_reversed": "the measured force is negative in compression: change force_sign",
    "position_gain_zero": "set position_gain",
    "following_error": "the axis does not follow: it is blocked, or position_gain is too low",
    "force_max": "the axis met an obstacle: remove it, or tare the force",
    "overspeed": "the axis moved faster than its target: check gains and signs",
} | dict.fromkeys(ORPHANED, f"the owner of the axis stopped writing; {REMEDY_AFTER_KILL}")


Value = float | str | None


@dataclass(frozen=True)
class CheckStep:
    """Result of one step of the first motion test.

    `verdict`: "passed", "noted", "skipped" or "failed". "noted" is no failure, but a person has to
    examine the value. `value` and `limit` belong to the checked quantity. Each is a number, a name,
    or None if the step has no value.
    """

    step: str
    verdict: str
    text: str
    value: Value = None
    limit: Value = None


@dataclass(frozen=True)
class CheckedObjects:
    """Objects of an axis, in engineering values. The test compares the observed values with these
    objects."""

    adc_bits: int
    force_zero_code: int
    contact_force: float
    force_max: float
    position_min: int
    position_max: int
    position_gain: float
    output_limit: int
    output_bias: float
    brake_engage_ticks: int
    dac_bits: int
    following_error_max: int
    speed_max: float
    inputs_fitted: int
    tare_band: float
    first_motion_counts: int
    first_motion_code: int
    first_motion_speed: float
    force_scale: float
    calibration_date: int
    drive_node_id: int
    drive_cycle: float
    drive_wait: float
    drive_sdo_timeout: float
    drive_on_ticks_max: int
    position_age_max: int
    cycle_age_max: int


@dataclass(frozen=True)
class ConnectionObjects:
    """CANopen node id and owner of an axis."""

    node_id: int
    command_source: str


@dataclass(frozen=True)
class StopCauseObjects:
    """The latched fault, and the command source that stopped the axis."""

    fault: str
    stopped_by: str


@dataclass(frozen=True)
class FirstMotionObjects:
    """Result of the first motion test in the firmware: distance in encoder counts, largest DAC
    code, change of the force in force counts, and the latched fault."""

    first_motion_result: str
    first_motion_moved: int
    first_motion_code_reached: int
    first_motion_force: float
    fault: str


@dataclass(frozen=True)
class MoveObjects:
    """State of an axis that moves. The position is in encoder counts."""

    position: int
    dac_code: int
    dac_fine: float
    fault: str
    limit_reason: str


@dataclass(frozen=True)
class Move:
    """A move out and back: position errors in encoder counts and mean outputs in DAC codes at
    standstill at its end points, the largest output, and the last state. `rested`: the axis was at
    rest at both, and no limit bounded its output."""

    errors: tuple[int, ...]
    codes: tuple[float, ...]
    largest: int
    last: MoveObjects
    rested: bool

    @property
    def error(self) -> int:
        """Returns the position error of the larger magnitude."""
        return max(self.errors, key=abs)

    @property
    def code(self) -> float:
        """Returns the mean of the outputs at standstill. The axis has come to rest in both
        directions, so dry friction cancels."""
        return float(np.mean(self.codes))

    @property
    def spread(self) -> float:
        """Returns half the difference of the outputs at standstill, at least SAME_CODES."""
        return max(SAME_CODES, (max(self.codes) - min(self.codes)) / 2)

    @property
    def friction(self) -> float:
        """Returns the dry friction in DAC codes, if it alone explains the position errors, or 0.

        With friction the axis stops on the near side of each target, equally far from both. An axis
        that something blocks, or whose output is bounded, stops short of one of them.
        """
        if len(self.errors) < 2 or not self.rested:
            return 0.0
        out, back = self.errors
        if out * back >= 0 or abs(out + back) > FRICTION_UNLIKE * abs(self.error):
            return 0.0
        return self.spread


@dataclass(frozen=True)
class MotionCheckResult:
    """The steps of a first motion test. `passed` is True if no step failed."""

    axis: str
    passed: bool
    steps: tuple[CheckStep, ...]


class MotionCheck:
    """The first motion test of an axis that this program owns and that is disabled. After run(),
    the axis is disabled, and all parameters have their previous values, except `force_tare` and,
    for an axis with a weight or a brake, `output_bias` and the objects RAISED."""

    def __init__(
        self, axis: Axis, travel: int = TRAVEL_CNT, output: int = OUTPUT_CODES,
        say: Callable[[CheckStep], None] = lambda step: None, weight: Weight | None = None,
    ) -> None:  # fmt: skip
        """`travel`: distance of the move in encoder counts. `output`: largest DAC code during the
        motion, beside output_bias. `say`: function that is called with a CheckStep at the end of
        each step. `weight`: weight by the model of the axis, None without a model."""
        self.axis, self.travel, self.output, self.say = axis, travel, output, say
        self.weight = weight
        self.bias = 0.0  # value of output_bias during the motion
        self.learned: float | None = None  # value of output_bias that was measured
        self.raised: dict[str, float] = {}  # larger values of the objects RAISED
        self.steps: list[CheckStep] = []

    @property
    def passed(self) -> bool:
        """True if no step failed."""
        return all(step.verdict != "failed" for step in self.steps)

    def result(self) -> MotionCheckResult:
        """Returns the results of all steps that have ended so far."""
        return MotionCheckResult(self.axis.link.where, self.passed, tuple(self.steps))

    def run(self, consent: Callable[[str], bool], tare: bool = True) -> None:
        """Runs all steps. If the steps at rest have passed, calls consent(text). The axis moves
        only if consent() returns True. `tare`: False leaves the tare as it is."""
        self._connection()
        if not self._table():
            return
        held = self.axis.record(CheckedObjects)
        self.known = self._for_weight(held, self.weight) if self.weight else held
        values = {name: getattr(self.known, name) for name in RAISED}
        self.raised = {n: value for n, value in values.items() if value != getattr(held, n)}
        self.bias = self.known.output_bias
        if self.weight and not self.bias:
            self.bias = self._rounded(self.weight.codes)
        for step in (self._faults, self._inputs, self._gains, self._drive_times, self._rest,
                     self._limits):  # fmt: skip
            step()
        if not self.passed:
            self._skip("an earlier step failed", *MOVING_STEPS, "tare")
        elif not consent(self.asked(tare)):
            self._skip("nobody allowed the axis to move", *MOVING_STEPS, "tare")
        else:
            self._motion()
            if tare:
                self._tare()

    def _for_weight(self, held: CheckedObjects, weight: Weight) -> CheckedObjects:
        """Returns the objects with the values that the weight and its brake need."""
        # The output is up to half of its step beside the weight.
        rounding = 2.0 ** (12 - held.dac_bits) / 2
        drift = rounding * weight.drift_counts if self._weighs else 0.0
        sag = math.ceil(SAG_FACTOR * (weight.sag_counts + drift))
        sag = min(sag, round(BY_NAME["first_motion_counts"].max))
        counts = max(held.first_motion_counts, sag)
        # An axis that is accelerated over a longer way becomes faster with its square root.
        faster = math.sqrt(counts / held.first_motion_counts)
        speed = min(faster * held.first_motion_speed, BY_NAME["first_motion_speed"].max)
        return replace(
            held, first_motion_counts=counts, first_motion_speed=float(round(speed)),
            brake_engage_ticks=max(held.brake_engage_ticks,
                                   bus_times.brake_ticks(1e3 * weight.engage_s)),
        )  # fmt: skip

    def asked(self, tare: bool = True) -> str:
        """Returns the text that describes the motion. A person has to confirm this motion before
        the axis moves. `tare`: True if the tare is taken too."""
        counts, code = self.known.first_motion_counts, self.known.first_motion_code
        speed = self.known.first_motion_speed
        way = "away from" if self.direction < 0 else "toward"
        held = f"An output of {self.bias:g} codes holds its weight. " if self.bias else ""
        if self.weight and self.weight.fall_m:
            fall_mm = 1e3 * self.weight.fall_m
            held += f"After a fault it falls {fall_mm:.2g} mm until its brake holds. "
        zero = " The tare is taken where the reading is near zero." if tare else ""
        return (
            f"{held}It moves {counts} encoder counts in open loop, at most "
            f"{FIRST_MOTION_REACH * counts} with {code} of 2047 codes and {speed:g} counts per "
            f"tick ({TICKS_PER_S * speed:.0f} counts/s), then {self.travel} counts {way} the "
            f"workpiece and back with at most {self._output()} codes, never more than "
            f"{self._span()} counts from here while it is enabled; after a stop it coasts."
            f"{zero}"
        )

    def _done(
        self, step: str, verdict: str, text: str, value: Value = None, limit: Value = None
    ) -> bool:
        made = CheckStep(step, verdict, text, value, limit)
        self.steps.append(made)
        self.say(made)
        return verdict != "failed"

    def _skip(self, why: str, *names: str) -> None:
        for name in names:
            self._done(name, "skipped", why)

    def _evaluate(
        self, step: str, fine: bool, text: str, value: Value = None, limit: Value = None,
        hint: str = "",
    ) -> bool:  # fmt: skip
        return self._done(step, "passed" if fine else "failed", text if fine else text + hint,
                          value, limit)  # fmt: skip

    def _connection(self) -> None:
        found = self.axis.record(ConnectionObjects)
        text = f"{self.axis.link.where}, node {found.node_id}, owned by {found.command_source}"
        self._done("connection", "passed", text, found.node_id)

    def _table(self) -> bool:
        raw = self.axis.link.read_one("object_table_hash")
        theirs, ours = f"0x{raw:08x}", parameter_file.table_hash()
        hint = (
            f", this program has {ours}: use the forceaxis that belongs to the firmware of the axis"
        )
        return self._evaluate("object table", theirs == ours, theirs, theirs, ours, hint)

    def _faults(self) -> None:
        found = self.axis.record(StopCauseObjects)
        fault, by = found.fault, found.stopped_by
        if fault != "none":
            hint = FAULT_CAUSES.get(fault, "find its cause")
            self._done("faults", "failed", f"{_words(fault)}: {hint}, then `axis.reset_fault()`",
                       fault, "none")  # fmt: skip
        else:
            self._done("faults", "passed", "none" if by == "nobody" else f"none, stopped by {by}",
                       fault, "none")  # fmt: skip

    def _inputs(self) -> None:
        bits = self.axis.integer("digital_inputs")
        fitted = self.known.inputs_fitted
        self.switches = bits & fitted & (LIMIT_POS | LIMIT_NEG)
        on = [text for bit, text in ((LIMIT_NEG, "negative"), (LIMIT_POS, "positive"))
              if self.switches & bit]  # fmt: skip
        chain = "enable chain closed" if bits & ENABLE_CHAIN else "enable chain open"
        text = f"{chain}, limit switches {' and '.join(on) if on else 'off'}"
        if not fitted & (LIMIT_POS | LIMIT_NEG):
            text = f"{chain}, no limit switches (inputs_fitted)"
        fine = bits & ENABLE_CHAIN and len(on) < 2
        self._evaluate("inputs", bool(fine), text, bits, ENABLE_CHAIN,
                    ": close the chain; two limit switches at once are a broken cable")  # fmt: skip

    def _gains(self) -> None:
        gain = self.known.position_gain
        self._evaluate("position gain", gain > 0 and self._output() > 0,
                    f"{gain:g} code/count, output limited to {self._output()} codes", gain,
                    "above 0", ": set them, the axis would not move")  # fmt: skip

    def _drive_times(self) -> None:
        """Compares time objects of the axis with the bus of its drive, if the axis has such a bus.
        If a time is too short, a fault occurs although the drive has no defect, or each pressed
        part gets the verdict bad."""
        known = self.known
        if not known.drive_node_id:
            return
        cycle = round(known.drive_cycle * bus_times.TICKS_PER_MS)
        times = [
            ("position_age_max", known.position_age_max, bus_times.age_without_loss(cycle),
             bus_times.age_with_one_lost(cycle)),
            ("cycle_age_max", known.cycle_age_max, bus_times.age_without_loss(cycle),
             bus_times.age_without_loss(cycle)),
            ("drive_on_ticks_max", known.drive_on_ticks_max,
             bus_times.on_ticks(known.drive_wait, 0),
             bus_times.on_ticks(known.drive_wait, known.drive_sdo_timeout)),
        ]  # fmt: skip
        short = [
            f"{name} {value} is too short, set it to {good}"
            for name, value, least, good in times if value < least
        ]  # fmt: skip
        if known.drive_wait * bus_times.TICKS_PER_MS > bus_times.ON_TICKS_MOST:
            most_ms = bus_times.ON_TICKS_MOST / bus_times.TICKS_PER_MS
            short.append(f"drive_wait is beyond drive_on_ticks_max, set it below {most_ms:g} ms")
        text = f"a cycle of {known.drive_cycle:g} ms, a wait of {known.drive_wait:g} ms"
        self._done("drive times", "noted" if short else "passed", "; ".join([text, *short]))

    def _scale(self) -> None:
        scale = self.known.force_scale
        self.newton = scale * 1e-6
        unset = quantity.never_set(scale, self.known.calibration_date)
        text = f"{self.newton:.6g} N a force count"
        self._done("force scale", "noted" if unset else "passed",
                   text + (", as delivered: set force_scale, or calibrate; all newtons follow it"
                           if unset else ""), self.newton)  # fmt: skip

    def _rest(self) -> None:
        names = ("force_raw", "force", "current_raw", "position")
        try:
            held = self.axis.capture(list(names), samples=REST_SAMPLES)
            raw, force, current, place = (held.values(name) for name in names)
        except Refused:  # this connection cannot transfer recordings
            rows = []
            for _ in range(READINGS):
                rows.append([self.axis.read(name) for name in names])
                self.axis.link.wait(READING_PERIOD_S)
            raw, force, current, place = np.array(rows).T
        top, zero = 2**self.known.adc_bits - 1, self.known.force_zero_code
        railed = raw.max() >= top or (raw.min() <= 0 and zero != 0)
        code = quiet_of(raw, 1.0).zero
        self._evaluate("force sensor", not railed, f"code {code:.5g} of 0 to {top}", code, top,
                    ": at an end of its range; check cable, supply, force_zero_code")  # fmt: skip
        self._scale()
        swing, band = float(np.ptp(force)), self.known.contact_force
        noise = noise_of(raw)
        text = f"{noise:.3g} LSB rms, {swing:.3g} force counts from peak to peak"
        if swing > band:
            self._done("force at rest", "failed", f"{text}: expected at most contact_force; check "
                       "shield and supply", swing, band)  # fmt: skip
        elif noise < DITHER_LSB:
            self._done("force at rest", "noted", f"{text}; below {DITHER_LSB:g} LSB a measurement "
                       "in contact sees its codes", noise, DITHER_LSB)  # fmt: skip
        else:
            self._done("force at rest", "passed", text, noise, DITHER_LSB)
        self.reading = quiet_of(force, 1.0).zero
        newton = self.reading * self.newton
        apart = abs(self.reading) <= band
        self._done("zero", "passed" if apart else "noted", f"{self.reading:.4g} force counts "
                   f"({newton:.4g} N)" + ("" if apart else ": in contact, or without its tare"),
                   self.reading, band)  # fmt: skip
        self._evaluate("current", current.max() < top, f"code {float(np.mean(current)):.0f}",
                    float(current.max()), top, ": at its upper end; check its wiring")  # fmt: skip
        moved = int(np.ptp(place))
        self.start = int(place[-1])
        self._evaluate("encoder at rest", moved <= STANDING_CNT, f"position {self.start}, {moved} "
                    "counts from peak to peak", moved, STANDING_CNT,
                    ": the axis moves, or its cable picks up noise")  # fmt: skip

    def _limits(self) -> None:
        """Selects the direction of the move, so that the position limit is far enough away. If both
        directions are possible, selects the direction away from the workpiece."""
        low, high = self.known.position_min, self.known.position_max
        room = {-1: self.start - low, 1: high - self.start}
        free = [way for way, switch in ((-1, LIMIT_NEG), (1, LIMIT_POS))
                if room[way] >= self._span() and not self.switches & switch]  # fmt: skip
        self.direction = free[0] if free else -1
        named = [f"{n} {v}" for n, v in (("position_min", low), ("position_max", high))
                 if abs(v) < NO_LIMIT]  # fmt: skip
        text = f"{', '.join(named)}, position {self.start}" if named else "no soft limits"
        self._evaluate("limits", bool(free), text, max(room.values()), self._span(),
                    f": expected room for {self._span()} encoder counts on one side")  # fmt: skip

    def _span(self) -> int:
        """Returns the largest distance from the start position in encoder counts. An overshoot is
        included."""
        reach = FIRST_MOTION_REACH * self.known.first_motion_counts
        return max(self.travel, reach, self._sag()) + ARRIVED_CNT

    def _sag(self) -> int:
        """Returns the largest position error, in encoder counts, by which the position law holds
        the part of a weight that output_bias does not hold."""
        if not self.known.position_gain:
            return 0
        return math.ceil(HELD_TOLERANCE * abs(self.bias) / self.known.position_gain)

    def _speed(self) -> float:
        """Returns the speed of the move in counts per tick."""
        return min(self.travel / MOVE_TICKS, MOVE_SPEED)

    def _output(self) -> int:
        return min(self.output, self.known.output_limit)

    def _motion(self) -> None:
        """Runs the first motion test and the move out and back. Before these motions, narrower
        limits are written to the axis. At the end, the earlier limits are restored."""
        known = self.known
        force = abs(self.reading) + 4 * known.contact_force
        bounds: dict[str, client.Value] = {
            **self._position_bounds(),
            "following_error_max": _least(known.following_error_max, max(self.travel, self._sag())),
            "force_max": _least(known.force_max, force),
            "first_motion_counts": known.first_motion_counts,
            "first_motion_speed": known.first_motion_speed,
            "profile_enable": "trapezoid",
            "profile_velocity_max": self._speed(),
            "profile_acceleration_max": self._speed() / 100,
        }
        names = [*bounds, "first_motion_test", "position_setpoint", "modes_of_operation",
                 "output_bias", "brake_engage_ticks", "output_limit", "speed_max"]  # fmt: skip
        before = self.axis.link.read(names)
        try:
            self.axis.set(**bounds, first_motion_test="off", output_bias=self.bias,
                          brake_engage_ticks=known.brake_engage_ticks)  # fmt: skip
            self._bound_first_motion()
            if not self._first_motion():
                self._skip("an earlier step failed", "move", "weight")
                return
            self._bound_move()
            self._move()
            if self.passed:
                before |= {name: client.to_raw(name, v) for name, v in self.raised.items()}
                if self.learned is not None:
                    before["output_bias"] = client.to_raw("output_bias", self.learned)
        finally:
            self._put_back(before)

    def _bound_first_motion(self) -> None:
        """Writes the bounds of output and speed during the first motion test."""
        most = max(self.output, self.known.first_motion_code)
        speed = _least(self.known.speed_max, 2 * self.known.first_motion_speed)
        self.axis.set(output_limit=self._limit(most), speed_max=speed)

    def _bound_move(self) -> None:
        """Writes the bounds of output and speed during the move, when the position law has brought
        the axis to rest after its first motion."""
        self.axis.link.wait(AFTER_FIRST_MOTION_S)
        speed = _least(self.known.speed_max, MOVE_SPEED_MAX)
        self.axis.set(output_limit=self._limit(self.output), speed_max=speed)

    def _position_bounds(self) -> dict[str, int]:
        """Returns the position limits of the motion from the start position."""
        return {
            "position_min": max(self.known.position_min, self.start - self._span()),
            "position_max": min(self.known.position_max, self.start + self._span()),
        }

    def _change_bias(self, bias: float) -> None:
        """Disables the axis and writes a new output_bias, with the bounds of the first motion test,
        which then runs again. With an output_bias that is wrong, the axis falls a little until its
        brake holds, so its motion begins from its new position. The speed of this fall is not
        bounded, because a fault would switch the amplifier off before the brake holds."""
        self.axis.set(speed_max=self.known.speed_max)
        self.axis.off()
        actions.wait_to_stand(self.axis)
        self.bias = bias
        self.axis.set(output_bias=bias)
        self._bound_first_motion()
        self.start = self.axis.integer("position")
        bounds = self._position_bounds()
        parameter_set.write(self.axis, bounds, self.axis.link.read(list(bounds)))

    def _rounded(self, codes: float) -> float:
        """Returns `codes` at the resolution of the output, within the range of output_bias."""
        known = BY_NAME["output_bias"]
        step = 2.0 ** (12 - self.known.dac_bits)
        most = known.max * known.scale
        return min(max(round(codes / step) * step, -most), most)

    def _limit(self, codes: int) -> int:
        """Returns the output limit that leaves `codes` on both sides of output_bias."""
        return min(self.known.output_limit, codes + math.ceil(abs(self.bias)))

    @property
    def _weighs(self) -> bool:
        """True if by the model an output of the drive has to hold a weight."""
        return self.weight is not None and self.weight.codes != 0

    def _enabled(self) -> str:
        """Enables the axis in position mode at its present position, whatever target was written
        before. Returns the text of the error, or ""."""
        try:
            here = self.axis.integer("position")
            self.axis.enable("native position", position_setpoint=here)
        except (Refused, NoAnswer) as refusal:
            return str(refusal)
        return ""

    def _first_motion(self) -> bool:
        """Runs the first motion test of the firmware, with an output_bias that holds the axis. The
        test is in open loop, and if it finds that the axis moves by itself, the amplifier is off
        before the brake holds, so the axis falls."""
        if self.bias and not self._hold():
            return False
        # A write to this object deletes the result of an earlier test.
        self.axis.set(first_motion_test="on")
        error = self._enabled()
        found = self.axis.record(FirstMotionObjects)
        result = found.first_motion_result
        text = (
            f"{_words(result)}: {found.first_motion_moved} encoder counts at code "
            f"{found.first_motion_code_reached}, force changed by {found.first_motion_force:.3g} "
            "force counts"
        )
        if result == "passed" and not error:
            seen = abs(found.first_motion_force) > self.known.contact_force
            sign = "" if seen else "; the sign of the force shows at the first contact"
            return self._done("first motion", "passed", text + sign, result, "passed")
        name = found.fault if result in ("passed", "running", "not_run") else result
        cause = FAULT_CAUSES.get(name, error)
        return self._done("first motion", "failed", f"{text}: {cause}", name, "passed")

    def _hold(self) -> bool:
        """Lets the position law hold the axis, because the value of output_bias may be wrong. The
        output at standstill becomes output_bias. The first motion test has the same bounds: with a
        reversed encoder the axis has a fault. Returns True if the axis was held."""
        used, codes = self.bias, 0.0
        if not (error := self._enabled()):
            try:
                self.axis.link.wait(HOLD_S)
                codes = self._codes_at_rest()
                fault = str(self.axis.get("fault")["fault"])
                error = "" if fault == "none" else _words(fault)
            except (Refused, NoAnswer) as refusal:
                error = str(refusal)
        if error or abs(codes - used) > HELD_TOLERANCE * abs(used):
            found = f"the axis has {error}" if error else f"{codes:.4g} codes hold the axis"
            return self._done("first motion", "failed", f"with output_bias {used:g} codes {found}: "
                              "check the sign of output_bias, moving mass, inclination and "
                              "counterbalance, then the directions of encoder and amplifier",
                              used, codes)  # fmt: skip
        self._change_bias(self._rounded(codes))
        return True

    def _codes_at_rest(self) -> float:
        """Returns the mean output in DAC codes in a time of AT_REST_S."""
        codes = []
        for _ in range(round(AT_REST_S / READING_PERIOD_S)):
            codes.append(self.axis.record(MoveObjects).dac_fine)
            self.axis.link.wait(READING_PERIOD_S)
        return float(np.mean(codes))

    def _move(self) -> None:
        """Moves the axis out and back in position mode. Checks the largest position error at the
        end points, and the weight."""
        moved = self._out_and_back()
        if moved and self.bias and abs(moved.error) > ARRIVED_CNT:
            # The position law holds the part of the weight that output_bias does not hold.
            # This part causes a position error.
            # With the measured output as output_bias, the axis has to reach its target.
            self._change_bias(self._rounded(moved.code))
            if error := self._enabled():
                self._done("move", "failed", error)
                return
            self._bound_move()
            moved = self._out_and_back()
        if moved is None:
            return
        text = (
            f"{self.travel} encoder counts out and back, {moved.error} beside its target, at most "
            f"code {moved.largest}"
        )
        if abs(moved.error) > ARRIVED_CNT and moved.friction:
            enough = moved.friction / ARRIVED_CNT
            self._done("move", "noted", f"{text}: dry friction of {moved.friction:.3g} codes holds "
                       f"it beside both targets with position_gain {self.known.position_gain:.3g}; "
                       f"{enough:.2g} would bring it within {ARRIVED_CNT} counts, if the position "
                       "loop is stable with it", moved.error, ARRIVED_CNT)  # fmt: skip
            self._weigh(moved)
        elif self._evaluate("move", abs(moved.error) <= ARRIVED_CNT, text, moved.error, ARRIVED_CNT,
                            f", {_words(moved.last.limit_reason)} limits it: it is blocked, or "
                            "position_gain is too low"):  # fmt: skip
            self._weigh(moved)
        else:
            self._skip("an earlier step failed", "weight")

    def _weigh(self, moved: Move) -> None:
        """Compares the output at standstill with the weight of the model, and with output_bias of
        the axis. If the axis carries a weight, the output becomes its output_bias."""
        codes, model = moved.code, self.weight
        # number of DAC codes for a position error of one encoder count
        spread = max(moved.spread, self.known.position_gain)
        text = f"{codes:.4g} codes at standstill"
        raised = "".join(f", {name} {value:g}" for name, value in self.raised.items())
        if not self._weighs and not self.known.output_bias:
            if model and model.newton:
                text += f", the drive holds the weight by itself{raised}"
            offset = abs(codes) > spread
            if offset:
                text += ": trim the amplifier's offset" + (
                    "" if model else "; if the axis carries a weight, give its model"
                )
            self._done("weight", "noted" if offset else "passed", text, codes)
            return
        self.learned = self._rounded(codes)
        kept = f"output_bias {self.learned:g} codes{raised}; `axis params store` keeps it"
        if model is None or not self._weighs:
            self._done("weight", "passed", f"{text}, {kept}", codes, self.known.output_bias)
            return
        newton = -codes * model.newton_per_code
        if abs(codes - model.codes) <= max(spread, WEIGHT_TOLERANCE * abs(model.codes)):
            self._done("weight", "passed", f"weight of {newton:.4g} N, {kept}", codes, model.codes)
            return
        self._done("weight", "noted", f"weight of {newton:.4g} N ({codes:.4g} codes), but by the "
                   f"model {model.newton:.4g} N ({model.codes:.4g} codes): check moving mass, "
                   f"inclination, counterbalance and force constant; {kept}", codes,
                   model.codes)  # fmt: skip

    def _out_and_back(self) -> Move | None:
        """Moves the axis out and back. Returns None after a failed step, whose result is stored."""
        largest, errors, codes = 0, [], []
        rested = True
        for target in (self.start + self.direction * self.travel, self.start):
            try:
                self.axis.set(position_setpoint=target)
                passed = 0.0
                while passed < self.travel / self._speed() / TICKS_PER_S + SETTLE_S:
                    now = self.axis.record(MoveObjects)
                    largest = max(largest, abs(now.dac_code))
                    if now.fault != "none":
                        break
                    self.axis.link.wait(READING_PERIOD_S)
                    passed += READING_PERIOD_S
                if now.fault == "none":
                    codes.append(self._codes_at_rest())
                    crept = abs(self.axis.record(MoveObjects).position - now.position)
                    rested &= crept <= CREEP_CNT and now.limit_reason == "none"
            except (Refused, NoAnswer) as error:
                self._done("move", "failed", str(error))
                self._skip("an earlier step failed", "weight")
                return None
            if now.fault != "none":
                cause = FAULT_CAUSES.get(now.fault, f"at position {now.position}")
                self._done("move", "failed", f"{_words(now.fault)}: {cause}", now.fault,
                           "none")  # fmt: skip
                self._skip("an earlier step failed", "weight")
                return None
            errors.append(now.position - target)
            if abs(errors[-1]) >= self.travel:
                break  # it has not moved
        return Move(tuple(errors), tuple(codes), largest, now, rested)

    def _put_back(self, before: dict[str, int]) -> None:
        """Disables the axis and restores the objects that were changed for the motion.

        After an error of the connection, the function repeats the writes. A first Ctrl-C ends the
        program only after the objects are restored.
        """
        interrupt: KeyboardInterrupt | None = None
        reason: str | None = None
        for again in range(RESTORE_TRIES):
            try:
                self.axis.off()
                now = self.axis.link.read(list(before))
                parameter_set.write(
                    self.axis, {n: v for n, v in before.items() if now[n] != v}, now
                )
                reason = None
                break
            except KeyboardInterrupt as error:
                if interrupt:
                    raise
                interrupt = error
            except (Refused, NoAnswer) as error:
                reason = str(error)
                if again + 1 < RESTORE_TRIES:
                    self.axis.link.wait(0.5)
        if reason:
            self._done("restore", "failed", f"{reason}; the limits of the check remain "
                       "active until the axis is switched off and on")  # fmt: skip
        if interrupt:
            raise interrupt

    def _tare(self) -> None:
        band = self.known.tare_band or self.known.contact_force
        if not self.passed:
            self._skip("an earlier step failed", "tare")
        elif abs(self.reading) > band:
            self._done("tare", "skipped", f"{self.reading:.4g} force counts at rest: beyond "
                       f"{'tare_band' if self.known.tare_band else 'contact_force'}",
                       self.reading, band)  # fmt: skip
        else:
            try:
                found = actions.tare(self.axis)
            except (Refused, NoAnswer) as error:
                self._done("tare", "failed", str(error), self.reading, band)
                return
            self._done("tare", "passed", f"{found.force_tare:.4g} force counts, the reading is "
                       f"{found.force:.4g}; `axis params store` keeps it", found.force_tare,
                       band)  # fmt: skip


def _least(own: float, bound: float) -> float:
    """Returns the smaller of two limits. `own` is a limit of the axis, where 0 means no limit. If
    the result is an integer, its type is int."""
    return min(own, bound) if own else bound


def _words(name: str) -> str:
    """Returns the name of an enumeration value with blanks in place of underscores."""
    return name.replace("_", " ")
