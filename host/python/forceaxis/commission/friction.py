"""Measures the dry friction of an axis before the frequency responses of the axis are measured.

glide() moves the axis out of contact with constant DAC codes in both directions. The speed is
proportional to the code minus a dead zone. This dead zone is the friction of guide and gear in DAC
codes. A drive with an integral has no dead zone, but its current shows the friction: the force of
the drive differs between the two directions by twice the friction.

record_slow_change() presses, and changes the force slowly from the smallest to the largest force
and back. The position then shows the compliance between these forces. If the position at a rising
force differs from that at a falling force, there is friction between the workpiece and its table.
directions() compares the DAC codes at a rising and at a falling force, at the same measured force.
Their difference is due to the friction of guide and gear in contact.

If the axis moves with a random speed of standard deviation s, Coulomb friction of F newtons acts
like a damper with the damping sqrt(2 / pi) F / s (statistical linearisation; Gelb and Vander Velde,
Multiple-Input Describing Functions, 2.3). This damping is large at a small amplitude and small at a
large amplitude. A measured response is therefore valid only for its own amplitude.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy import optimize

from forceaxis.axis.link import TICKS_PER_S
from forceaxis.commission.analyzer import Analyzer
from forceaxis.commission.known import KnownDrive
from forceaxis.commission.level import Samples
from forceaxis.commission.refusal import Refusal

# The following constants belong to glide(), the motion out of contact.
TRAVEL_SHARE = 0.85  # fraction of the permitted travel that the motion uses in each direction
# Durations in s: longest recording, shortest recording, and time in which the speed still changes.
GLIDE_S, RECORD_MIN_S, SETTLED_S = 0.5, 0.06, 0.05
# DAC code of the slower motion, divided by the DAC code of the faster motion.
SMALLER_CODE_SHARE = 0.6
MOTIONS = 4  # number of motions from which friction and viscous damping are distinguished
# if the DAC code of the faster motion is not above this value, there is no slower motion
SMALLEST_CODE = 2
# A DAC code suffices if it would move the axis by ENOUGH_TRAVELS x the travel in one recording.
ENOUGH_TRAVELS = 1.2
# POSITION_POLL_S: time in s between two reads of the position.
# TRAVELS_MAX: distance after which a motion ends, divided by the travel.
POSITION_POLL_S, TRAVELS_MAX = 0.02, 1.3
TRAVEL_MIN_CNT = 20
SPEED_SAMPLES = 50  # number of the last samples from which the speed of a too fast motion follows
# smallest change of the position, in encoder counts, that is regarded as a motion
MOTION_MIN_CNT = 6
DEAD_ZONE_MIN_CODES = 0.12  # smallest dead zone, in DAC codes, that is regarded as friction
# NOISE_SLIDES: amplitude of noise with which the axis mostly slides, divided by the dead zone.
NOISE_SLIDES = 2.5

# The following constants belong to record_slow_change(), which changes the force slowly.
# LEG_S and LEG_SAMPLES: duration in s and number of samples while the force rises.
# LEG_S and LEG_SAMPLES also apply while the force falls.
LEG_S, LEG_SAMPLES, DECIMATION = 3.0, 1600, 5
# The travel that a Refusal recommends, divided by the travel that was needed.
WIDER_FACTOR = 1.5
# Smallest relative force error after friction has stopped an axis without integral action.
FORCE_ERROR_MIN = 0.06

# The following constants belong to slow_loading(), which finds compliance and friction.
# BLOCK_SAMPLES: number of samples of a block, which are replaced by their mean.
BLOCK_SAMPLES = 20
FORCE_BINS = 6  # number of force intervals; the compliance is computed for each of them
KNOTS = 3  # number of forces at which the compliance may change
# start values of the search for the first state of the friction
FIRST_STATES = (-1.0, -0.5, 0.0, 0.5, 1.0)
# A compliance that changes with the force is assumed if it reduces the squared errors enough.
# BENT_SHARE: largest ratio of the sums of squared errors, with changing and constant compliance.
# Stick-slip of the guide reduces the sum of the squared errors less.
BENT_SHARE = 0.3
# Smallest compliance of a workpiece whose compliance changes with the force, divided by its mean.
# If a smaller compliance fits best, another element of the machine bends the curve.
BEND_MIN = 0.2
# Largest compliance between two forces, divided by the compliance at these two forces.
# Above this ratio of compliances, the workpiece is regarded as soft between the forces.
SOFT_RATIO = 1.6
# ERROR_REDUCTION_MIN: smallest relative reduction of the position error by an accepted friction.
ERROR_REDUCTION_MIN = 0.15
# A workpiece that relaxes also has different positions at rising and falling force.
# RELAXING_SHARE: largest sum of squared errors with relaxation, divided by the sum with friction.
# A likelihood would detect relaxation too often, because errors of neighbouring samples are alike.
RELAXING_SHARE = 0.2
# Below this difference of the positions in counts, the smaller sum of squared errors decides alone.
SMALL_CNT = 3.0
CREEP_S = (0.03, 20.0)  # shortest and longest time constant that is tried
# smallest travel in encoder counts at which friction under the workpiece can be measured
DISPLACEMENT_MIN_CNT = 0.35
# Smallest ratio of half of the force range to the friction of a workpiece that slides.
SLIDE_FACTOR = 1.2

# The following constants belong to directions(), which finds the friction of guide and gear.
# Slope of the force in a block of samples, divided by the mean slope.
# If the ratio of the slopes is larger, the block of samples belongs to a motion.
SLOPE_MIN_SHARE = 0.3
# Smallest number of blocks of a motion, and waiting time in s at the end of a motion.
MOTION_MIN_BLOCKS, HELD_S = 8, 1.0
# A dead zone is regarded as friction only if it exceeds three bounds.
# The bounds are multiples of its standard error, of one DAC code, and of the codes for the speed.
FOUND_ERRORS, FOUND_CODES, FOUND_SPEED_SHARE = 4.0, 0.3, 0.5


@dataclass(frozen=True)
class Glide:
    """Friction of the axis out of contact. It has the dead zone in DAC codes, and the difference
    between the two directions of motion in DAC codes. `rate` is the speed in counts/s for each DAC
    code beyond the dead zone.

    `moving_N`: friction of guide and gear in N, computed from the current of the drive. It is None
    if the current is not measured.
    """

    dead_zone: float
    difference: float
    rate: float
    codes: int  #: largest DAC code of the motions
    moving_N: float | None = None

    @property
    def rubs(self) -> bool:
        return self.dead_zone > DEAD_ZONE_MIN_CODES

    @property
    def noise_codes(self) -> int:
        """Returns the amplitude of the noise, in DAC codes, with which the axis slides most of the
        time. Returns 0 if there is no friction."""
        return math.ceil(NOISE_SLIDES * self.dead_zone) if self.rubs else 0


@dataclass(frozen=True)
class Directions:
    """Friction of guide and gear, computed from a recording in which the force changes slowly.

    `dead_zone`: half of the difference between the DAC codes at rising and at falling force, at the
    same measured force, without the codes that the speed needs. `error`: standard error of
    `dead_zone`. `speed`: DAC codes that the speed needs. `least`: True if `dead_zone` is only a
    lower bound.
    """

    dead_zone: float
    error: float
    speed: float
    least: bool = False

    @property
    def rubs(self) -> bool:
        return self.dead_zone > max(
            FOUND_ERRORS * self.error, FOUND_CODES, FOUND_SPEED_SHARE * self.speed
        )


@dataclass(frozen=True)
class SlowLoading:
    """Compliance and friction, computed from a recording in which the force changes slowly between
    two forces.

    `friction_N`: friction in N between the workpiece and its table, or 0 if it cannot be measured.
    `sticks`: True if the workpiece never slides; `friction_N` is then a lower bound. `compliance`:
    compliance in counts/N of the parts that always move. `sliding`: compliance in counts/N of the
    parts that move only after the friction is overcome. `softest`: largest compliance between the
    two forces, divided by the compliance at the two forces. `softest_N`: force in N at which the
    compliance is largest. `creep`: compliance in counts/N that follows the force with the time
    constant `creep_s`, of a workpiece that relaxes; 0 for one that does not. `bends`: smallest and
    largest value of `sliding` between the two forces, divided by its mean.
    """

    friction_N: float
    sticks: bool
    compliance: float
    sliding: float
    softest_N: float
    softest: float
    low_N: float
    high_N: float
    way: int  #: change of the position in encoder counts
    creep: float = 0.0
    creep_s: float = 0.0
    bends: tuple[float, float] = (1.0, 1.0)

    @property
    def rubs(self) -> bool:
        return self.friction_N > 0

    @property
    def soft(self) -> bool:
        return self.softest > SOFT_RATIO


@dataclass(frozen=True)
class FrictionSummary:
    """Dry friction that was measured together with a response. It is the entry "friction" of the
    summary of the response. None means that a quantity was not measured.

    rubs: True if dry friction was found. dead_zone_codes, moving_N: friction of guide and gear in
    DAC codes and in N. glide: result of the motion out of contact. directions: result of the
    comparison of the DAC codes at rising and falling force. slow: result of the slow change of the
    force. workpiece_N: friction in N between the workpiece and its table. workpiece_slides: True if
    the workpiece slid while the response was measured. left_N: measured force in N at a target
    force of 0 N. why: reason why the force was not changed slowly, or "". lines: the [[friction]]
    elements that have to be added to the model, as TOML text.
    """

    rubs: bool
    dead_zone_codes: float
    moving_N: float | None
    glide: Glide | None
    directions: Directions | None
    workpiece_N: float | None
    workpiece_slides: bool | None
    slow: SlowLoading | None
    left_N: float | None
    why: str
    lines: str


@dataclass(frozen=True)
class MovingObjects:
    """Position in encoder counts, and `contact`, which is 1 while the axis is in contact."""

    position: int
    contact: int


UNKNOWN_DRIVE = KnownDrive()


@dataclass(frozen=True)
class _Motion:
    """A motion out of contact: its DAC code, its speed in counts/s, and the force of the drive in
    N, which is NaN if the current of the drive is not measured."""

    code: int
    speed: float
    force_N: float


class _TooFast(Exception):
    """Exception: with this DAC code, the axis is so fast that its speed cannot be measured within
    the travel. `travel`: distance to both sides, in encoder counts, with which it can be."""

    def __init__(self, travel: float) -> None:
        super().__init__(travel)
        self.travel = travel


def damping(friction_N: float, speed_rms: float) -> float:
    """Returns the damping in N s/m that has the same effect as dry friction on a random motion with
    the rms speed `speed_rms` in m/s."""
    return math.sqrt(2 / math.pi) * friction_N / speed_rms


def first_code(most: int, travel: int, rate: float) -> int:
    """Returns the DAC code with which glide() begins. It is at most an eighth of `most`. It is
    smaller if the axis would otherwise leave the travel of `travel` counts to both sides before its
    speed is measured. `rate`: speed of the axis in counts/s per DAC code."""
    # largest speed in counts/s that can be measured within the travel
    fastest = 2 * TRAVEL_SHARE * travel / (SETTLED_S + RECORD_MIN_S)
    return max(SMALLEST_CODE, int(min(most // 8, fastest / abs(rate) if rate else math.inf)))


def glide(
    analyzer: Analyzer,
    most: int,
    say: Callable[[str], None] = lambda text: None,
    first: int = SMALLEST_CODE,
    highest: int = 0,
    drive: KnownDrive = UNKNOWN_DRIVE,
) -> Glide:
    """Measures the friction out of contact.

    The axis of the Analyzer must be owned by this program, disabled and at rest. At the end, it is
    disabled at its start position. `most`: largest DAC code for an axis that slides. `first`: DAC
    code of the first motion. `highest`: largest DAC code for an axis that does not slide yet, by
    default 16 times `most`. `drive`: what the model tells of the drive.

    The DAC code is increased until the axis slides through the travel. If the axis is too fast in
    one direction, the code is decreased. Raises Refusal in these cases: the axis is too fast with
    every code, the axis does not slide, its speed does not increase with the code, or the axis
    comes into contact.
    """
    start = analyzer.axis.integer("position")
    low, high = analyzer.objects.position_min, analyzer.objects.position_max
    room = min(start - low, high - start)
    travel = min(analyzer.order.travel, room)
    if travel < TRAVEL_MIN_CNT:
        raise Refusal(
            "travel", f"expected an axis that can move by at least {TRAVEL_MIN_CNT} counts to "
            f"both sides, but its position is {start}, with position_min {low} and position_max "
            f"{high}: move the axis away from the nearer bound"
        )  # fmt: skip
    analyzer.home = start
    analyzer.bound_travel(travel)
    analyzer.set(
        open_loop_code=0, excitation_waveform="noise", excitation_amplitude=0, bump_decay_shift=0
    )
    most = max(SMALLEST_CODE, most)
    highest = max(SMALLEST_CODE, highest or min(16 * most, analyzer.objects.codes_most))
    code = max(SMALLEST_CODE, first)
    too_fast, more = 0, ""  # last DAC code with which the axis was too fast, and the remedy

    def move(code: int) -> _Motion | None:
        return _motion(analyzer, code, travel, drive)

    try:
        while True:
            try:
                forward = move(code)
                if forward is not None and (
                    too_fast
                    or code >= min(most, highest)
                    or abs(forward.speed) * GLIDE_S > ENOUGH_TRAVELS * travel
                ):
                    smaller = math.floor(SMALLER_CODE_SHARE * code)
                    others = [move(c) for c in (-code, smaller, -smaller)]
                    rows = [forward, *(one for one in others if one is not None)]
                    break
            except _TooFast as fast:
                wider = WIDER_FACTOR * fast.travel
                more = analyzer.order.wider("travel", wider)
                if code == SMALLEST_CODE and _widens(analyzer, wider, room):
                    travel = analyzer.order.travel
                    continue
                if code == SMALLEST_CODE:
                    raise Refusal(
                        "travel", f"expected an axis that moves by at most {travel} counts to "
                        f"both sides within {SETTLED_S + RECORD_MIN_S:g} s, but at {code} DAC "
                        f"codes the axis moves farther: {more}"
                    ) from None  # fmt: skip
                too_fast, code = code, max(SMALLEST_CODE, round(code / 1.5))
                continue
            if forward is None and too_fast:
                raise Refusal(
                    "travel", "expected a DAC code at which the axis slides slowly within "
                    f"{travel} counts to both sides, but at {too_fast} codes it is too fast for a "
                    f"speed to be measured, and at {code} it does not slide: {more}"
                )  # fmt: skip
            if forward is None and code >= highest:
                newton = drive.newton_per_code * code
                held = f", {newton:.3g} N by the model" if newton else ""
                raise Refusal(
                    "friction",
                    "expected an axis that slides while out of contact, but the axis does not "
                    f"slide at {code} DAC codes{held}: free the guide, release the brake, or "
                    "raise the amplifier's gain"
                )  # fmt: skip
            code = min(2 * code, highest if forward is None else min(most, highest))
        analyzer.go_home()
    finally:
        analyzer.close()
    found = _of_motions(rows)
    text = f"{found.codes} codes out of contact: a dead zone of {found.dead_zone:.2g} codes"
    if drive.current and len(rows) == MOTIONS:
        found = _with_forces(
            found, rows, drive.newton_per_code, drive.current.newton_per_code
        )  # fmt: skip
        if found.moving_N is not None:
            text += f", a force of {found.moving_N:.2g} N against the motion"
    say(text)
    return found


def _widens(analyzer: Analyzer, travel: float, room: int) -> bool:
    """Widens the travel for the smallest DAC code, with which the axis is too fast for a speed to
    be measured. `room`: distance in encoder counts to the nearer position limit of the axis.
    Returns False if the request or this limit does not permit it."""
    why = f"at {SMALLEST_CODE} DAC codes the axis is too fast for a speed to be measured"
    if math.ceil(travel) > room or not analyzer.widen("travel", travel, why):
        return False
    analyzer.bound_travel(analyzer.order.travel)
    return True


def _with_forces(found: Glide, rows: list[_Motion], newton: float, resolution_N: float) -> Glide:
    """Returns the result with the friction that the forces of the drive show. `newton`: force in N
    per DAC code. `resolution_N`: force of one ADC code of the current; a smaller friction is not
    regarded as measured. If the friction at `newton` has a larger dead zone, the result gets this
    dead zone."""
    speeds, forces = (np.array(values) for values in zip(*((r.speed, r.force_N) for r in rows),
                                                         strict=True))  # fmt: skip
    table = np.column_stack([speeds, np.sign(speeds), np.ones(len(rows))])
    _, friction_N, _ = np.linalg.lstsq(table, forces, rcond=None)[0]
    friction_N = float(friction_N)
    if friction_N < abs(resolution_N):
        return found
    dead_zone = max(found.dead_zone, friction_N / newton if newton else 0.0)
    return replace(found, dead_zone=dead_zone, moving_N=friction_N)


def _of_motions(rows: list[_Motion]) -> Glide:
    """Computes the friction from the speeds of several motions. The first motion has the largest
    DAC code. Raises Refusal."""
    code, forward = rows[0].code, rows[0].speed
    smaller = math.floor(SMALLER_CODE_SHARE * code)
    if len(rows) < MOTIONS:
        # The smaller DAC code is within the dead zone, so it is taken as the dead zone.
        width, shift, rate = float(smaller), 0.0, forward / (code - smaller)
    else:
        codes = np.array([one.code for one in rows], float)
        speeds = np.array([one.speed for one in rows])
        table = np.column_stack([codes, -np.sign(codes), -np.ones(len(codes))])
        rate, width, shift = np.linalg.lstsq(table, speeds, rcond=None)[0]
        if rate > 0:
            width, shift = width / rate, shift / rate
    if not rate > 0:
        at = ", ".join(f"{one.speed:.3g} counts/s at {one.code} codes" for one in rows)
        raise Refusal(
            "friction", f"expected a speed of the axis that grows with the DAC code, got {at}: "
            "check the sign "
            "of the encoder, output_limit and the speed limit of the drive"
        )  # fmt: skip
    return Glide(float(width), float(shift), float(rate), code)


def _motion(analyzer: Analyzer, code: int, travel: int, drive: KnownDrive) -> _Motion | None:
    """Moves the axis with a constant DAC code from one end of the travel toward the other end.
    Returns None if the axis does not move."""
    current = drive.current
    axis = analyzer.axis
    begin = analyzer.home - int(math.copysign(TRAVEL_SHARE * travel, code))
    if analyzer.go(begin, until_contact=True).contact:
        analyzer.refuse_contact()
    analyzer.wait(0.1)
    analyzer.set(open_loop_code=code)
    axis.enable("excitation")
    signals = ("position", "force", *(("current_raw",) if current else ()))
    axis.arm(signals, round(GLIDE_S * TICKS_PER_S))
    for _ in range(round(GLIDE_S / POSITION_POLL_S) + 1):
        analyzer.wait(POSITION_POLL_S)
        state = axis.record(MovingObjects)
        if abs(state.position - analyzer.home) > TRAVELS_MAX * travel:
            axis.disable()
            # The axis stops only after the time between two reads and the delays of its bus.
            late = drive.rate * abs(code) * (2 * POSITION_POLL_S + sum(analyzer.bus) / TICKS_PER_S)
            axis.link.recording(5.0)  # ends the recording, so that the next one can be armed
            if abs(state.position - analyzer.home) <= TRAVELS_MAX * travel + late:
                fastest = max(drive.rate * abs(code), late / POSITION_POLL_S)
                raise _TooFast(fastest * (SETTLED_S + RECORD_MIN_S) / (2 * TRAVEL_SHARE))
            raise Refusal(
                "travel", f"expected the axis to stay within {travel} counts of the start "
                f"position at {code} DAC codes, but the axis moves further: the speed does not "
                "correspond to the DAC code; check the drive, or "
                + analyzer.order.wider("travel", WIDER_FACTOR * abs(state.position - analyzer.home))
            )  # fmt: skip
        if state.contact:
            analyzer.refuse_contact()
    held = axis.link.recording(5.0)
    axis.set(modes_of_operation=1)
    analyzer.set(open_loop_code=0)
    analyzer.expect_apart(held)
    place = held.floats("position")
    # Only the far end of a travel counts: dry friction may have stopped the axis beyond the start.
    ahead = math.copysign(1.0, code) * (place - analyzer.home)
    inside = ahead < TRAVEL_SHARE * travel + MOTION_MIN_CNT
    last = int(np.argmin(inside)) if not inside.all() else len(place)
    first = round(SETTLED_S * TICKS_PER_S)
    if last - first < RECORD_MIN_S * TICKS_PER_S:
        # The axis accelerates, so the speed at the end is the largest one.
        recent = place[max(0, last - SPEED_SAMPLES) : max(last, 3)]
        speed = abs(float(np.polyfit(np.arange(len(recent)) / TICKS_PER_S, recent, 1)[0]))
        raise _TooFast(speed * (SETTLED_S + RECORD_MIN_S) / (2 * TRAVEL_SHARE))
    if abs(place[last - 1] - place[first]) < MOTION_MIN_CNT:
        return None
    time_s = np.arange(first, last) / TICKS_PER_S
    force_N = math.nan
    if current:
        raw = float(np.mean(held.floats("current_raw")[first:last]))
        force_N = (raw - current.zero_code) * current.newton_per_code
    return _Motion(code, float(np.polyfit(time_s, place[first:last], 1)[0]), force_N)


def record_slow_change(
    analyzer: Analyzer, low_N: float, high_N: float
) -> tuple[Samples, Samples, Samples]:
    """Records three signals: measured force in N, position in encoder counts, and DAC codes.

    During the recording, the axis presses, and its force changes from `low_N` to `high_N` and back.
    Then the axis releases the force. Raises Refusal if the axis moves farther than the travel that
    the request permits.
    """
    reached_N = analyzer.press(low_N)
    axis, rated_N = analyzer.axis, analyzer.objects.rated_force * 1e-3
    start = axis.integer("position")
    target = axis.number("target_force") * 1e-3 * rated_N / reached_N
    if abs(target - 1) < FORCE_ERROR_MIN:
        target = 1.0
    slope = 1e3 * target * (high_N - low_N) / rated_N / LEG_S
    analyzer.set(force_slope=max(1, round(slope)))

    def expect_near() -> None:
        way = abs(axis.integer("position") - start)
        if way > analyzer.order.squeeze:
            force_N = axis.number("force") * analyzer.newton
            # the travel between the two forces, if the compliance stays as it was so far
            needed = way * max(1.0, (high_N - low_N) / max(abs(force_N - reached_N), 1e-9))
            if analyzer.widen("squeeze", WIDER_FACTOR * needed, "the structure is softer"):
                return
            axis.disable()
            raise Refusal(
                "travel",
                f"expected at most {analyzer.order.squeeze} counts of travel between the forces "
                f"{low_N:.4g} and "
                f"{high_N:.4g} N, got about {needed:.3g}: the structure is softer than expected; "
                f"{analyzer.order.wider('squeeze', WIDER_FACTOR * needed)}, or forces that differ "
                "less"
            )  # fmt: skip

    legs = []
    for force in (high_N, low_N):
        axis.arm(("force", "position", "dac_fine"), LEG_SAMPLES, decimation=DECIMATION)
        analyzer.set(target_force=analyzer.per_mille(target * force))
        analyzer.wait(LEG_SAMPLES * DECIMATION / TICKS_PER_S, expect_near)
        held = axis.link.recording(10.0)
        forces = held.floats("force") * analyzer.newton
        legs.append((forces, held.floats("position"), held.floats("dac_fine")))
    axis.set(recorder_decimation=1)
    pushed, went, put = (np.concatenate(parts) for parts in zip(*legs, strict=True))
    analyzer.release()
    return pushed, went - start, put


def directions(force: Samples, place: Samples, codes: Samples, rate: float = 0.0) -> Directions:
    """Computes the friction of guide and gear from the signals that record_slow_change() has
    recorded.

    Part of the DAC code produces the force and overcomes the friction. `rate` is the speed in
    counts/s for each remaining DAC code, or 0 if it is unknown. In this case, the dead zone is
    computed from the codes at standstill, after the rise and after the fall of the force. It is
    only a lower bound, because integral action and noise reduce the difference of these codes.
    """
    F, x, c = (block_means(values) for values in (force, place, codes))
    step_s = BLOCK_SAMPLES * DECIMATION / TICKS_PER_S
    takes = np.gradient(x, step_s) / rate if rate else np.zeros(len(F))
    slope = np.gradient(F, step_s)
    moves = abs(slope) > SLOPE_MIN_SHARE * np.ptp(F) / LEG_S
    if moves.sum() < MOTION_MIN_BLOCKS or len(set(np.sign(slope[moves]))) < 2:
        return Directions(0.0, math.inf, 0.0, not rate)
    table = np.column_stack([np.ones(len(F)), F, np.sign(slope)])
    wanted = c - takes
    solved = np.linalg.lstsq(table[moves], wanted[moves], rcond=None)[0]
    more = (wanted - table[:, :2] @ solved[:2]) * np.sign(
        solved[1]
    )  # DAC codes in addition to those that produce the measured force
    if not rate:
        leg, held = len(F) // 2, round(HELD_S / step_s)
        rose, fell = more[leg - held : leg], more[-held:]
        error = math.hypot(np.std(rose), np.std(fell)) / 2 / math.sqrt(held)
        error = math.hypot(error, float(np.mean(rose) + np.mean(fell)) / 2)
        return Directions(float(np.mean(rose) - np.mean(fell)) / 2, error, 0.0, True)
    left = more[moves] - solved[2] * np.sign(solved[1]) * table[moves, 2]
    size = float(np.sum(left**2)) / (moves.sum() - table.shape[1])
    error = math.sqrt(size * float(np.linalg.inv(table[moves].T @ table[moves])[2, 2]))
    dead_zone = float(solved[2] * np.sign(solved[1]))
    return Directions(dead_zone, error, float(np.median(abs(takes[moves]))), False)


def block_means(values: Samples) -> Samples:
    """Returns the mean of each block of BLOCK_SAMPLES samples."""
    whole = len(values) // BLOCK_SAMPLES * BLOCK_SAMPLES
    return np.asarray(values[:whole].reshape(-1, BLOCK_SAMPLES).mean(1))


def play_operator(force: Samples, half: float, begin: float = 1.0) -> Samples:
    """Returns the force in N that is transmitted if Coulomb friction of `half` N acts against
    `force` (play operator). `begin`: part of the friction that acts against the first force, from
    -1 to 1. It is 1 if the body slid in the positive direction before."""
    left, now = np.empty(len(force)), force[0] - begin * half
    for i, one in enumerate(force):
        now = min(max(now, one - half), one + half)
        left[i] = now
    return left


def slow_loading(force: Samples, place: Samples, rigid: float = 0.0) -> SlowLoading:
    """Computes compliance and friction from the signals that record_slow_change() has recorded.
    `rigid`: compliance in counts/N of the elements of the model between encoder and workpiece, or 0
    if it is unknown."""
    F, x = block_means(force), block_means(place)
    low, high = float(np.percentile(F, 2)), float(np.percentile(F, 98))
    late = _simplest([_creep(F, x, knots) for knots in (0, KNOTS)])
    one, curved = (_loops(F, x, knots, (1.0,)) for knots in (0, KNOTS))
    bent = _simplest([one, curved])
    if one.rubs or (bent.rubs and bent.left < late.left):
        # A friction's size changes with its first state and with a force-dependent stiffness.
        one = _simplest([_loops(F, x, knots, FIRST_STATES) for knots in (0, KNOTS)])
    half, c_all, c_slide, rubs = one.half, one.whole, one.slides, one.rubs
    other = min(one.left, curved.left)
    # Friction and relaxation look alike if both directions differ by a few counts only.
    small = 2 * half * c_slide < SMALL_CNT
    share = 1.0 if small else RELAXING_SHARE
    relaxes = min(late.at_once, late.creep) > 0 and late.left < share * other
    creep, creep_s = 0.0, 0.0
    if relaxes:
        rubs, c_all, creep, creep_s = False, late.at_once, late.creep, late.creep_s
    sticks = bool(not rubs and not relaxes and rigid and c_all < 1.15 * rigid)
    softest_N, softest = _softest(
        F, x - (c_slide * (play_operator(F, half, one.begin) - F) if rubs else 0.0), low, high
    )
    friction = half if rubs else ((high - low) / 2 if sticks else 0.0)
    return SlowLoading(
        float(friction), sticks, one.stuck if rubs else c_all, c_slide if rubs else 0.0,
        softest_N, softest, low, high, round(float(np.ptp(x))), creep, creep_s,
        one.bends if rubs else (1.0, 1.0),
    )  # fmt: skip


@dataclass(frozen=True)
class _Loop:
    """The dry friction that explains different positions at rising and falling force best.

    half: the friction in N. begin: as for play_operator(). stuck, slides: compliance in counts/N of
    the parts that always move, and of those behind the friction. whole: compliance of all parts
    without friction. left, without: sum of the squares of the errors of the position, with and
    without friction. bends: smallest and largest compliance behind the friction, divided by
    `slides`.
    """

    half: float
    begin: float
    stuck: float
    slides: float
    whole: float
    left: float
    without: float
    bends: tuple[float, float]

    @property
    def rubs(self) -> bool:
        """True if the positions at rising and falling force clearly differ by friction."""
        shows = 2 * self.half * self.slides > DISPLACEMENT_MIN_CNT
        shows = shows and self.slides > 0.05 * self.whole
        return shows and self.left < (1 - ERROR_REDUCTION_MIN) * self.without


@dataclass(frozen=True)
class _Creep:
    """The slow yielding that explains different positions at rising and falling force best.

    at_once, creep: compliance in counts/N that follows the force at once, and with the time
    constant `creep_s`. left: sum of the squares of the errors of the position. bends: smallest and
    largest value of `at_once` between the two forces, divided by its mean.
    """

    at_once: float
    creep: float
    creep_s: float
    left: float
    bends: tuple[float, float]


Slow = TypeVar("Slow", _Loop, _Creep)


def _simplest(found: Sequence[Slow]) -> Slow:
    """Returns the result with a constant stiffness. If a stiffness that depends on the force
    clearly reduces the error, returns the result with this stiffness. `found`: these two
    results."""
    straight, bent = found
    clear = bent.left < BENT_SHARE * straight.left and bent.bends[0] > BEND_MIN
    return bent if clear else straight


def _loops(F: Samples, x: Samples, knots: int, begins: Sequence[float]) -> _Loop:
    """Fits dry friction to block means of force in N and position in encoder counts. `begins`:
    first states of the friction from which the best one is searched; a single one is kept."""

    def fitted(half: float, begin: float = 1.0) -> tuple[float, float, Samples]:
        """Sum of the squares, compliance before the friction, and behind it between the knots."""
        through = play_operator(F, half, begin) if half else F
        table = np.column_stack([np.ones(len(F)), *([F] if half else []), _curve(through, knots)])
        solved = np.linalg.lstsq(table, x, rcond=None)[0]
        stuck = float(solved[1]) if half else 0.0
        return float(np.sum((table @ solved - x) ** 2)), stuck, np.cumsum(solved[-knots - 1 :])

    def size(at: Sequence[float]) -> float:
        error, stuck, behind = fitted(*at)
        return error * (1.0 if min(stuck, *behind) > 0 else 4.0)

    span = float(np.percentile(F, 98) - np.percentile(F, 2))
    halves = np.linspace(0.004, 0.49, 60) * span
    start = min(itertools.product(halves, begins), key=size)
    states = (-1.0, 1.0) if len(begins) > 1 else (begins[0], begins[0])
    found = optimize.minimize(
        size, start, method="Nelder-Mead", bounds=((halves[0], halves[-1]), states),
        options={"initial_simplex": _corners(start, halves[1] - halves[0]), "xatol": 1e-4},
    )  # fmt: skip
    half, begin = map(float, found.x)
    without, _, whole = fitted(0.0)
    left, stuck, behind = fitted(half, begin)
    slides, whole_mean = float(behind.mean()), float(whole.mean())
    return _Loop(half, begin, stuck, slides, whole_mean, left, without, _bends(behind))


def _corners(start: tuple[float, float], step: float) -> Samples:
    """Returns the corners of the first simplex of a search for friction and its first state."""
    half, begin = start
    return np.array([start, (half + step, begin), (half, begin - math.copysign(0.3, begin))])


def _curve(force: Samples, knots: int) -> Samples:
    """Returns functions of a force in N, one in each column. Their sum is any position whose slope
    changes at each of `knots` forces. A stiffness that depends on the force is thus not regarded as
    friction or as a workpiece that relaxes: with it, a force has one position."""
    places = np.linspace(force.min(), force.max(), knots + 2)[1:-1]
    return np.column_stack([force, *(np.maximum(force - place, 0.0) for place in places)])


def _creep(force: Samples, x: Samples, knots: int) -> _Creep:
    """Fits a workpiece that relaxes to block means of force in N and position in encoder counts: a
    part of the compliance follows the force through a first-order lag, which is at rest at the
    first sample. `knots`: number of forces at which the other compliance changes."""
    block_s = BLOCK_SAMPLES * DECIMATION / TICKS_PER_S

    def fitted(log_s: float) -> tuple[float, Samples, float]:
        keeps = math.exp(-block_s / math.exp(log_s))
        late, now = np.empty(len(force)), float(force[0])
        for i, one in enumerate(force):
            now = one + (now - one) * keeps
            late[i] = now
        table = np.column_stack([np.ones(len(force)), late, curve])
        solved = np.linalg.lstsq(table, x, rcond=None)[0]
        return float(np.sum((table @ solved - x) ** 2)), np.cumsum(solved[2:]), float(solved[1])

    curve = _curve(force, knots)
    grid = np.log(np.geomspace(*CREEP_S, 25))
    i = int(np.argmin([fitted(one)[0] for one in grid]))
    ends = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
    best = float(
        optimize.minimize_scalar(lambda one: fitted(one)[0], bounds=ends, method="bounded").x
    )
    size, at_once, creep = fitted(best)
    return _Creep(float(at_once.mean()), creep, math.exp(best), size, _bends(at_once))


def _bends(compliances: Samples) -> tuple[float, float]:
    """Returns the smallest and the largest compliance, divided by their mean."""
    mean = float(compliances.mean())
    return float(compliances.min()) / mean, float(compliances.max()) / mean


def _softest(F: Samples, x: Samples, low: float, high: float) -> tuple[float, float]:
    """Returns two numbers: force in N at which the compliance is largest, and this compliance
    divided by the larger one of the compliances at the two end forces."""
    edges = np.linspace(low, high, FORCE_BINS + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    slopes = np.array([
        np.polyfit(F[inside], x[inside], 1)[0] if np.ptp(F[inside]) > (high - low) / FORCE_BINS / 2
        else np.nan
        for a, b in itertools.pairwise(edges)
        for inside in [(a <= F) & (b >= F)]
    ])  # fmt: skip
    at_forces = max(slopes[0], slopes[-1])
    inner = slopes[1:-1]
    if not np.isfinite(inner).any() or not at_forces > 0:
        return float((low + high) / 2), 1.0
    i = int(np.nanargmax(inner))
    return float(middle[1:-1][i]), float(inner[i] / at_forces)
