"""Measures the dry friction of an axis before the frequency responses of the axis are measured.

`glide` drives the axis out of contact with constant codes in both directions. The speed is
proportional to the code minus a dead zone, and the dead zone is the friction of guide and gear in
codes. `record_slow_change` changes the force in contact slowly from the smallest to the largest one
and back. The position shows the compliance between these forces. If the position differs between
rising and falling force, the workpiece has friction on its table. `directions` computes the
difference of the codes for rising and falling force at the same measured force, which is the
friction of guide and gear in contact.

For a noise whose speed has the standard deviation s, Coulomb friction of F newtons acts like a
damper of sqrt(2 / pi) F / s (statistical linearisation; Gelb and Vander Velde, Multiple-Input
Describing Functions, 2.3). This damping is large at small amplitudes and small at large ones. A
response is therefore valid for its own amplitude only.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from forceaxis.axis.link import TICKS_PER_S
from forceaxis.commission.analyzer import Analyzer
from forceaxis.commission.level import Samples
from forceaxis.commission.refusal import Refusal

# Constants of glide(), the motion out of contact:
TRAVEL_SHARE = 0.85  # share of the permitted travel that the motion uses in each direction
# Durations in s: longest recording, shortest recording, start phase with a speed that changes.
GLIDE_S, RECORD_MIN_S, SETTLED_S = 0.5, 0.06, 0.05
# ratio of the DAC code of the slower motion to the DAC code of the faster motion
SMALLER_CODE_SHARE = 0.6
SMALLEST_CODE = 2  # DAC codes of the faster motion, below which there is no slower one
# A DAC code is large enough if the axis would move by this multiple of the travel in one recording.
ENOUGH_TRAVELS = 1.2
# Time in s between two reads of the position. A motion ends at this multiple of the travel.
POSITION_POLL_S, TRAVELS_MAX = 0.02, 1.3
TRAVEL_MIN_CNT = 20
MOTION_MIN_CNT = 6  # smallest change of the position in encoder counts that is a motion
DEAD_ZONE_MIN_CODES = 0.12  # smallest dead zone in DAC codes that is treated as friction
# Amplitude of a noise with which the axis slides most of the time, as a multiple of the dead zone.
NOISE_SLIDES = 2.5

# Constants of record_slow_change(), which changes the force slowly: duration in s and number of
# samples of the rise of the force, and the same of its fall
LEG_S, LEG_SAMPLES, DECIMATION = 3.0, 1600, 5
# Above this relative force error, friction has stopped an axis without integral action.
FORCE_ERROR_MIN = 0.06

# Constants of slow_loading(), for compliance and friction under the workpiece:
# number of samples of a block, which the mean of the samples replaces
BLOCK_SAMPLES = 20
FORCE_BINS = 6  # number of intervals of the force; the compliance is computed for each interval
# Ratio of the compliance between two forces to the compliance at the two forces.
# The workpiece is soft above this ratio.
SOFT_RATIO = 1.6
# Smallest relative decrease of the error of the predicted position with which friction is accepted.
ERROR_REDUCTION_MIN = 0.15
# smallest travel in encoder counts at which friction under the workpiece can be measured
DISPLACEMENT_MIN_CNT = 0.35
# Smallest ratio of half of the force range to the friction under the workpiece.
# The workpiece slides only above this ratio.
SLIDE_FACTOR = 1.2

# Constants of directions(), for the friction of guide and gear while the axis is in contact:
# Smallest ratio of the slope of the force in a block of samples to the mean slope.
# A block with a larger slope belongs to a motion.
SLOPE_MIN_SHARE = 0.3
# smallest number of blocks of a motion; waiting time in s at the end of a motion
MOTION_MIN_BLOCKS, HELD_S = 8, 1.0
# The dead zone is treated as friction only if the dead zone exceeds three bounds.
# The bounds are multiples of the standard error, of one DAC code and of the codes for the speed.
FOUND_ERRORS, FOUND_CODES, FOUND_SPEED_SHARE = 4.0, 0.3, 0.5


@dataclass(frozen=True)
class Glide:
    """Friction of the axis out of contact: dead zone and difference between the two directions of
    motion in DAC codes. `rate` is the speed in counts/s for each DAC code beyond the dead zone."""

    dead_zone: float
    difference: float
    rate: float
    codes: int  #: largest DAC code that was output

    @property
    def rubs(self) -> bool:
        return self.dead_zone > DEAD_ZONE_MIN_CODES

    @property
    def noise_codes(self) -> int:
        """Returns the amplitude in DAC codes of a noise with which the axis slides most of the
        time, or 0 without friction."""
        return math.ceil(NOISE_SLIDES * self.dead_zone) if self.rubs else 0


@dataclass(frozen=True)
class Directions:
    """Friction of guide and gear from a slow change of the force.

    `dead_zone`: half of the difference in DAC codes between falling and rising force at the same
    measured force, less the codes for the speed. `error`: standard error of `dead_zone`. `speed`:
    DAC codes for the speed. `least`: True if `dead_zone` is a lower bound.
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
    """Compliance and friction from a slow change between two forces.

    `friction_N`: friction under the workpiece (0 if not measurable; a lower bound if `sticks`, when
    the workpiece never slides). `compliance` and `sliding` in counts/N: compliance of what always
    moves, and of what moves only after the friction is overcome. `softest`: ratio of the largest
    compliance between the two forces to the compliance at the two forces. `softest_N`: force in N
    with the largest compliance.
    """

    friction_N: float
    sticks: bool
    compliance: float
    sliding: float
    softest_N: float
    softest: float
    low_N: float
    high_N: float
    way: int  #: counts

    @property
    def rubs(self) -> bool:
        return self.friction_N > 0

    @property
    def soft(self) -> bool:
        return self.softest > SOFT_RATIO


@dataclass(frozen=True)
class FrictionSummary:
    """Dry friction that was measured together with a response, as the entry "friction" of a
    summary. None means that the quantity was not measured.

    rubs: whether dry friction was found. dead_zone_codes, moving_N: friction of guide and gear in
    DAC codes and in N. glide, directions, slow: results of the motion out of contact, of the
    difference of the codes for rising and falling force, and of the slow change of the force.
    workpiece_N: friction under the workpiece; workpiece_slides: whether the workpiece slid during
    the response. left_N: measured force in N with a target of 0 N. why: reason why the force was
    not changed slowly, or "". lines: the [[friction]] elements that the model lacks, as TOML.
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


class _TooFast(Exception):
    """Exception: with this DAC code the axis moves through the travel too fast for a measurement of
    the speed."""


def damping(friction_N: float, speed_rms: float) -> float:
    """Returns the damping in N s/m that reduces a noisy motion of `speed_rms` m/s as much as the
    dry friction does."""
    return math.sqrt(2 / math.pi) * friction_N / speed_rms


def first_code(most: int, travel: int, rate: float) -> int:
    """Returns the DAC code with which glide() begins: an eighth of `most`, or less if an axis with
    the speed `rate` in counts/s per DAC code would cover `travel` counts to both sides before its
    speed is measured."""
    fastest = 2 * TRAVEL_SHARE * travel / (SETTLED_S + RECORD_MIN_S)  # counts/s
    return max(SMALLEST_CODE, int(min(most // 8, fastest / abs(rate) if rate else math.inf)))


def glide(
    analyzer: Analyzer,
    most: int,
    say: Callable[[str], None] = lambda text: None,
    first: int = SMALLEST_CODE,
    highest: int = 0,
    newton: float = 0.0,
) -> Glide:
    """Measures the friction out of contact.

    The Analyzer's axis is owned, disabled and at rest; at the end, the axis is disabled at the
    start position. `most`: largest DAC code of an axis that slides. `first`: first code.
    `highest`: largest code of an axis that does not slide yet, by default 16 times `most`.
    `newton`: force in N per DAC code, 0 if unknown.

    The code is increased until the axis slides through the travel, and decreased
    if it covers the travel too soon in one of the directions. Raises Refusal if no code is slow
    enough, if the axis does not slide, if its speed does not grow with the code, or if it comes
    into contact.
    """
    start = analyzer.axis.integer("position")
    low, high = analyzer.objects.position_min, analyzer.objects.position_max
    travel = min(analyzer.order.travel, start - low, high - start)
    if travel < TRAVEL_MIN_CNT:
        raise Refusal(
            "travel", f"expected an axis that can move by at least {TRAVEL_MIN_CNT} counts to "
            f"both sides, but its position is {start}, with position_min {low} and position_max "
            f"{high}: move the axis away from the nearer bound"
        )  # fmt: skip
    analyzer.set(
        position_min=start - travel, position_max=start + travel, open_loop_code=0,
        excitation_waveform="noise", excitation_amplitude=0, bump_decay_shift=0,
    )  # fmt: skip
    analyzer.home = start
    most = max(SMALLEST_CODE, most)
    highest = max(SMALLEST_CODE, highest or min(16 * most, 2048))
    code = max(SMALLEST_CODE, first)
    too_fast = 0  # the last code at which the axis covered the travel too soon
    try:
        while True:
            try:
                forward = _speed(analyzer, code, travel)
                if forward is not None and (
                    too_fast
                    or code >= min(most, highest)
                    or abs(forward) * GLIDE_S > ENOUGH_TRAVELS * travel
                ):
                    smaller = math.floor(SMALLER_CODE_SHARE * code)
                    rows = [(code, forward)]
                    rows += [(c, speed) for c in (-code, smaller, -smaller)
                             if (speed := _speed(analyzer, c, travel)) is not None]  # fmt: skip
                    break
            except _TooFast:
                if code == SMALLEST_CODE:
                    raise Refusal(
                        "travel", f"expected an axis that moves by at most {travel} counts to "
                        f"both sides within {SETTLED_S + RECORD_MIN_S:g} s, but at {code} DAC "
                        "codes the axis moves farther: give a larger travel"
                    ) from None  # fmt: skip
                too_fast, code = code, max(SMALLEST_CODE, round(code / 1.5))
                continue
            if forward is None and too_fast:
                raise Refusal(
                    "travel", "expected a DAC code at which the axis slides slowly within "
                    f"{travel} counts to both sides, but at {too_fast} codes it is too fast for a "
                    f"speed to be measured, and at {code} it does not slide: give a larger travel"
                )  # fmt: skip
            if forward is None and code >= highest:
                held = f", {newton * code:.3g} N by the model" if newton else ""
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
    found = _of_speeds(rows)
    say(f"{found.codes} codes out of contact: a dead zone of {found.dead_zone:.2g} codes")
    return found


def _of_speeds(rows: list[tuple[int, float]]) -> Glide:
    """Returns the friction from (DAC code, speed in counts/s) of the motions, of which the first
    has the largest code. Raises Refusal."""
    (code, forward), smaller = rows[0], math.floor(SMALLER_CODE_SHARE * rows[0][0])
    if len(rows) < 4:
        # The smaller DAC code is within the dead zone and becomes the new dead zone.
        width, shift, rate = float(smaller), 0.0, forward / (code - smaller)
    else:
        codes, speeds = (np.array(values, float) for values in zip(*rows, strict=True))
        table = np.column_stack([codes, -np.sign(codes), -np.ones(len(codes))])
        rate, width, shift = np.linalg.lstsq(table, speeds, rcond=None)[0]
        if rate > 0:
            width, shift = width / rate, shift / rate
    if not rate > 0:
        at = ", ".join(f"{speed:.3g} counts/s at {c} codes" for c, speed in rows)
        raise Refusal(
            "friction", f"expected a speed of the axis that grows with the DAC code, got {at}: "
            "check the sign "
            "of the encoder, output_limit and the speed limit of the drive"
        )  # fmt: skip
    return Glide(float(width), float(shift), float(rate), code)


def _speed(analyzer: Analyzer, code: int, travel: int) -> float | None:
    """Returns the speed in counts/s with a constant DAC code from one end of the travel to the
    opposite end, or None if the axis does not move."""
    axis = analyzer.axis
    axis.enable("profile position")
    axis.move(analyzer.home - int(math.copysign(TRAVEL_SHARE * travel, code)))
    analyzer.wait(0.1)
    analyzer.set(open_loop_code=code)
    axis.enable("excitation")
    axis.arm(("position", "force"), round(GLIDE_S * TICKS_PER_S))
    for _ in range(round(GLIDE_S / POSITION_POLL_S) + 1):
        analyzer.wait(POSITION_POLL_S)
        state = axis.record(MovingObjects)
        if abs(state.position - analyzer.home) > TRAVELS_MAX * travel:
            axis.disable()
            raise Refusal(
                "travel", f"expected the axis to stay within {travel} counts of the start "
                f"position at {code} DAC codes, but the axis moves further: the speed does not "
                "correspond to the DAC code; check the drive, or give a larger travel"
            )  # fmt: skip
        if state.contact:
            analyzer.refuse_contact()
    held = axis.link.recording(5.0)
    axis.set(modes_of_operation=1)
    analyzer.set(open_loop_code=0)
    analyzer.expect_apart(held)
    place = held.floats("position")
    inside = np.abs(place - analyzer.home) < TRAVEL_SHARE * travel + MOTION_MIN_CNT
    last = int(np.argmin(inside)) if not inside.all() else len(place)
    first = round(SETTLED_S * TICKS_PER_S)
    if last - first < RECORD_MIN_S * TICKS_PER_S:
        raise _TooFast
    if abs(place[last - 1] - place[first]) < MOTION_MIN_CNT:
        return None
    time_s = np.arange(first, last) / TICKS_PER_S
    return float(np.polyfit(time_s, place[first:last], 1)[0])


def record_slow_change(
    analyzer: Analyzer, low_N: float, high_N: float
) -> tuple[Samples, Samples, Samples]:
    """Records (measured force in N, position in counts, DAC codes), (n,) each.

    During the recording, the axis presses and the force changes from `low_N` to `high_N` and back.
    The axis then releases the force. Raises Refusal if the axis moves farther than the order's
    travel.
    """
    reached_N = analyzer.press(low_N)
    axis, rated_N = analyzer.axis, analyzer.objects.rated_force * 1e-3
    start, travel = axis.integer("position"), analyzer.order.travel
    target = axis.number("target_force") * 1e-3 * rated_N / reached_N
    if abs(target - 1) < FORCE_ERROR_MIN:
        target = 1.0
    slope = 1e3 * target * (high_N - low_N) / rated_N / LEG_S
    analyzer.set(force_slope=max(1, round(slope)))

    def expect_near() -> None:
        way = abs(axis.integer("position") - start)
        if way > travel:
            axis.disable()
            raise Refusal(
                "travel",
                f"expected at most {travel} counts of travel between the forces {low_N:g} and "
                f"{high_N:g} N, got {way}: the structure is soft in this range of force; give a "
                "larger travel, or forces that differ less"
            )  # fmt: skip

    legs = []
    for force in (high_N, low_N):
        axis.arm(("force", "position", "dac_code"), LEG_SAMPLES, decimation=DECIMATION)
        analyzer.set(target_force=analyzer.per_mille(target * force))
        analyzer.wait(LEG_SAMPLES * DECIMATION / TICKS_PER_S, expect_near)
        held = axis.link.recording(10.0)
        forces = held.floats("force") * analyzer.newton
        legs.append((forces, held.floats("position"), held.floats("dac_code")))
    axis.set(recorder_decimation=1)
    pushed, went, put = (np.concatenate(parts) for parts in zip(*legs, strict=True))
    analyzer.release()
    return pushed, went - start, put


def directions(force: Samples, place: Samples, codes: Samples, rate: float = 0.0) -> Directions:
    """Returns the friction of guide and gear from a recording of record_slow_change().

    `rate` is the speed in counts/s per DAC code that remains after force and friction. If `rate` is
    0 (unknown), the dead zone is a lower bound from the codes at standstill after the rise and
    after the fall, because integral action and noise reduce the difference of these codes.
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
    )  # DAC codes in addition to the DAC codes that produce the measured force
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
    """Returns the means of blocks of BLOCK_SAMPLES samples, (blocks,)."""
    whole = len(values) // BLOCK_SAMPLES * BLOCK_SAMPLES
    return np.asarray(values[:whole].reshape(-1, BLOCK_SAMPLES).mean(1))


def play_operator(force: Samples, half: float) -> Samples:
    """Returns the force in N, (n,), that is transmitted through Coulomb friction of `half` N (play
    operator). Before the first sample, the friction slid in the positive direction."""
    left, now = np.empty(len(force)), force[0] - half
    for i, one in enumerate(force):
        now = min(max(now, one - half), one + half)
        left[i] = now
    return left


def slow_loading(force: Samples, place: Samples, rigid: float = 0.0) -> SlowLoading:
    """Returns compliance and friction from a recording of record_slow_change(). `rigid` is the
    compliance in counts/N of the model's elements between encoder and workpiece, 0 if unknown."""
    F, x = block_means(force), block_means(place)
    low, high = float(np.percentile(F, 2)), float(np.percentile(F, 98))
    span = high - low

    def left(half: float) -> tuple[Samples, Samples]:
        columns = [np.ones(len(F)), F, play_operator(F, half)]
        table = np.column_stack(columns if half else columns[:2])
        solved = np.linalg.lstsq(table, x, rcond=None)[0]
        return np.asarray(table @ solved - x), np.asarray(solved)

    def size(half: float) -> float:
        error, solved = left(half)
        return float(np.sum(error**2)) * (1.0 if half == 0 or min(solved[1:]) > 0 else 4.0)

    grid = np.linspace(0.004, 0.49, 60) * span
    sizes = [size(half) for half in grid]
    i = int(np.argmin(sizes))
    ends = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
    half = float(optimize.minimize_scalar(size, bounds=ends, method="bounded").x)
    plain, (_, c_all) = left(0.0)
    error, (_, c_stuck, c_slide) = left(half)
    # Friction is accepted only if the positions at rising and at falling force clearly differ.
    shows = 2 * half * c_slide > DISPLACEMENT_MIN_CNT and c_slide > 0.05 * c_all
    rubs = bool(shows and np.sum(error**2) < (1 - ERROR_REDUCTION_MIN) * np.sum(plain**2))
    sticks = bool(not rubs and rigid and c_all < 1.15 * rigid)
    softest_N, softest = _softest(
        F, x - (c_slide * (play_operator(F, half) - F) if rubs else 0.0), low, high
    )
    friction = half if rubs else (span / 2 if sticks else 0.0)
    return SlowLoading(
        float(friction), sticks, float(c_stuck if rubs else c_all), float(c_slide if rubs else 0.0),
        softest_N, softest, low, high, round(float(np.ptp(x))),
    )  # fmt: skip


def _softest(F: Samples, x: Samples, low: float, high: float) -> tuple[float, float]:
    """Returns (force in N with the largest compliance, ratio of this compliance to the larger
    compliance at the two end forces)."""
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
