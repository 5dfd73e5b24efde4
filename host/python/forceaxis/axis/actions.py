"""Operations of one axis: stop, tare, calibrate, move, press, retract."""

import contextlib
import datetime
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from forceaxis._core import InputError
from forceaxis.axis import bounds, quantity
from forceaxis.axis.drive import Drive, DriveObjects, ModeObjects, StoppedObjects
from forceaxis.axis.link import POLL_PERIOD_S, NoAnswer, Refused
from forceaxis.axis.quantity import Force, force_per_count
from forceaxis.bus import state_names
from forceaxis.bus.client import Value, from_raw
from forceaxis.bus.state_names import POWERED
from forceaxis.errors import ParameterError

QUICK_STOP = 0x02
QUICK_STOP_MAX_S = 10.0  # longest duration of a quick stop in s
FIRST_DAY = datetime.date(1984, 1, 1)  # day 0 of dates in CiA 301
CALIBRATION_POINTS = range(2, 9)
FORCE_MAX_COUNTS = 512  # largest value of the object `force_max` in force counts
COAST_MAX_S = 5.0  # longest time in s for which a disabled axis may coast
# A tare that is refused because a disabled axis moves is repeated for this time in s.
TARE_STAND_MAX_S = 10.0
# Largest increase of the measured force during a retract, in 8-bit counts.
RETRACT_FORCE_COUNTS = 8
# Number of steps in which a target force is lowered to 0. Longest time in s that it may take.
RELEASE_MAX_STEPS, RELEASE_MAX_S = 25, 3.0
# Name of the object that sets the target force, for each mode of operation with force control.
FORCE_TARGETS = {
    "force": "target_force", "cyclic_force": "target_force", "force_counts": "force_setpoint"
}  # fmt: skip
# A press has held its force if the mean force differs by at most this fraction of the force.
# A difference of HELD_ERROR_COUNTS is always permitted, because the measured force has this step.
HELD_ERROR_SHARE, HELD_ERROR_COUNTS = 0.02, 0.6
# time in s that a retract may take in addition to the computed time of its motion
RETRACT_EXTRA_S = 10.0
# Force limit of a move in 8-bit counts.
# The limit is a quarter of 128 counts, the largest magnitude of a signed 8-bit value.
MOVE_COUNTS = 32


@dataclass(frozen=True)
class AxisStatus:
    """State of an axis at one moment: drive state by CiA 402, mode of operation, fault, position,
    measured force, and command source that owns the axis. `position` is in encoder counts, `force`
    in 8-bit counts."""

    state: str
    mode: str
    fault: str
    position: int
    force: float
    command_source: str
    force_N: float


def state(axis: Drive) -> AxisStatus:
    """Returns the present state of an axis as an AxisStatus. Raises NoAnswer, Refused."""
    now = axis.record(DriveObjects)
    return AxisStatus(
        state=now.state,
        mode=now.mode,
        fault=now.fault,
        position=now.position,
        force=now.force,
        command_source=now.command_source,
        force_N=now.force * force_per_count(axis),
    )


def command_stop(axis: Drive) -> None:
    """Commands a quick stop, which also stops an axis that another client owns, and does not wait
    for the stop. Raises NoAnswer, Refused."""
    for remaining in (2, 1, 0):  # another CANopen master may interrupt a transfer of an object
        try:
            axis.link.write({"controlword": QUICK_STOP})
            break
        except NoAnswer:
            if not remaining:
                raise


def stop(axis: Drive) -> AxisStatus:
    """Commands a quick stop, as command_stop() does. Waits until the axis is disabled, or at
    standstill if `quick_stop_option` keeps the axis enabled. Returns the state of the axis. Raises
    NoAnswer, Refused."""
    command_stop(axis)
    axis.wait_for(
        StoppedObjects,
        lambda s: s.state != "operation enabled",
        "the axis to leave operation enabled",
    )
    stays_enabled = axis.link.read_one("quick_stop_option") >= 5
    if not stays_enabled:
        axis.wait_for(
            StoppedObjects, lambda s: s.state not in POWERED, "the axis to be off", QUICK_STOP_MAX_S
        )
    return state(axis)


def wait_to_stand(axis: Drive) -> None:
    """Waits until a disabled axis no longer coasts. Waits for at most COAST_MAX_S seconds. Raises
    NoAnswer, Refused."""
    before, passed = None, 0.0
    while (now := axis.integer("position")) != before and passed < COAST_MAX_S:
        before = now
        axis.link.wait(0.2)
        passed += 0.2


@dataclass(frozen=True)
class TareResult:
    """Result of taring: the new tare of the axis, and the measured force after taring. Both are in
    8-bit counts."""

    force_tare: float
    force: float


@dataclass(frozen=True)
class TareObjects:
    """State of the taring, and the latched fault of the axis. The state is idle, running, done, or
    the reason why the taring failed."""

    tare_state: str
    fault: str


def tare(axis: Drive) -> TareResult:
    """Tares a disabled axis at standstill. A motor that still coasts, or that swings within the
    backlash of its gear, has TARE_STAND_MAX_S seconds to come to rest. Raises Refused with the
    reason that the axis states."""
    for _ in axis.link.polls(TARE_STAND_MAX_S):
        axis.set(tare=1)
        axis.link.wait(POLL_PERIOD_S)
        found = axis.wait_for(
            TareObjects, lambda s: s.tare_state != "running", "the end of the tare", 10.0
        )
        if found.tare_state != "refused_moving":
            break
    if found.tare_state != "done":
        raise Refused(f"{axis.link.where}: tare {found.tare_state.replace('_', ' ')}")
    axis.link.wait(POLL_PERIOD_S)
    return axis.record(TareResult)


def reading(axis: Drive, seconds: float = 0.5) -> float:
    """Returns the mean of the measured force, in 8-bit counts, over `seconds` by the clock of the
    axis."""
    return statistics.fmean(axis.number("force") for _ in axis.link.polls(seconds))


@dataclass(frozen=True)
class CalibrationResult:
    """Result of a calibration of the force sensor: scale of the measured force, and linearity error
    in per mille of the span of the reference forces."""

    force_scale_N_per_count: float
    linearity_permille: float


@dataclass(frozen=True)
class CalibrationObjects:
    """State of a calibration of the force sensor, and its results: linearity error in per mille of
    the span of the reference forces, and `force_scale` in uN per 8-bit count."""

    calibration_state: str
    calibration_linearity: float
    force_scale: float


def calibrate(axis: Drive, points: Sequence[tuple[float, float]]) -> CalibrationResult:
    """Computes `force_scale` of a disabled axis from a straight line through 2 to 8 calibration
    points, and writes `force_scale` to the axis. Each element of `points` is (measured force in
    counts, reference force in N). Raises InputError, and Refused with the reason that the axis
    states."""
    if len(points) not in CALIBRATION_POINTS:
        raise InputError(f"calibrate: expected 2 to 8 calibration points, got {len(points)}")
    values: dict[str, float] = {}
    for i, (count, newton) in enumerate(points, 1):
        values[f"calibration_reading_{i}"] = count
        values[f"calibration_force_{i}"] = newton * 1e3
    today = (datetime.date.today() - FIRST_DAY).days
    axis.set(**values, calibration_points=len(points), date=today)
    refusal = None
    try:
        axis.set(calibrate=1)
        axis.link.wait(POLL_PERIOD_S)
    # After a refusal, the object `calibration_state` contains the reason.
    except Refused as error:
        refusal = error
    found = axis.record(CalibrationObjects)
    if refusal or found.calibration_state != "done":
        if refusal and found.calibration_state in ("idle", "done"):
            raise refusal
        raise Refused(
            f"{axis.link.where}: calibration {found.calibration_state.replace('_', ' ')}, "
            f"linearity error {found.calibration_linearity:g} per mille"
        )
    return CalibrationResult(
        force_scale_N_per_count=found.force_scale * 1e-6,
        linearity_permille=found.calibration_linearity,
    )


@contextlib.contextmanager
def bounded(axis: Drive, counts: float) -> Iterator[None]:
    """Context manager that limits the measured force. Within the context, the axis disables itself
    in the tick in which the measured force exceeds `counts` or the earlier `force_max`, whichever
    is smaller. At the end, the axis is disabled and `force_max` has its earlier value again."""
    own = axis.number("force_max")
    axis.set(force_max=min(counts, own) if own else counts)
    try:
        yield
    finally:
        axis.off()
        axis.put_back(force_max=own)


def expect_position_gain(axis: Drive) -> None:
    """Raises Refused if `position_gain` of the axis is 0, because an axis without position gain
    cannot approach or follow a position."""
    if axis.number("position_gain") == 0:
        raise Refused(
            f"{axis.link.where}: expected a position_gain above 0, because the axis neither "
            "approaches nor follows without position_gain; set position_gain, or for a simulated "
            "axis firmware.position_gain in the experiment"
        )


def most_counts(axis: Drive, force_max: float | str | None) -> float | None:
    """Converts a force limit such as "120 N" to 8-bit counts. A number is regarded as counts and is
    not converted. None stays None. Raises InputError."""
    if force_max is None:
        return None
    try:
        counts = quantity.number(axis, "force_max", str(force_max))
    except InputError:
        counts = 0.0
    if not 0 < counts <= FORCE_MAX_COUNTS:
        newton = FORCE_MAX_COUNTS * force_per_count(axis)
        raise ParameterError(
            "force_max",
            f'expected a force limit of at most {FORCE_MAX_COUNTS} force counts, or such as "75 '
            f'N" up to {newton:.6g} N, got {force_max}',
        )
    return counts


def move(
    axis: Drive,
    position: int | str,
    speed: float | str | None = None,
    timeout_s: float = 60.0,
    counts: float = MOVE_COUNTS,
) -> AxisStatus:
    """Moves the axis to a position in profile position mode and then disables the axis. Returns the
    last state of the axis before it was disabled. `position`: number in user units of the axis, or
    a text such as "10 mm". `speed`: number in user units per second, a text such as "5 mm/s", or
    None for the value of the object `trajectory_velocity`. `counts`: force limit in 8-bit counts.
    Raises InputError before the motion if the axis would limit a target. Raises Refused, and
    NoAnswer. If the force limit was exceeded, NoAnswer names the fault."""
    expect_position_gain(axis)
    given: dict[str, Value] = {} if speed is None else {"trajectory_velocity": speed}
    settings = expect(axis, {**given, "target_position": position})
    place = int(settings.pop("target_position"))
    before = axis.get(*settings)
    try:
        with bounded(axis, counts):
            axis.enable("profile position", **settings)
            axis.move(place, timeout_s)
            return state(axis)
    finally:
        axis.put_back(**before)


def expect(axis: Drive, values: Mapping[str, Value]) -> dict[str, Value]:
    """Converts targets, such as "10 mm", to engineering values in the unit of each object. Raises
    InputError if the axis would limit a target. The error text states the bound of the target and
    the object that sets the bound."""
    raw = quantity.all_raw(axis, values)
    bounds.expect_raw(axis, raw)
    return {name: from_raw(name, value) for name, value in raw.items()}


@dataclass(frozen=True)
class PressOrder:
    """Options of a press, except its force. Axis.press() describes each option and its default
    value. If an option is None, its default value is used."""

    seconds: float = 3.0
    speed: float | str | None = None
    approach_s: float = 10.0
    force_max: float | str | None = None
    retract: float | str | None = None


@dataclass(frozen=True)
class PressSample:
    """One sample that was read during a press: measured force in 8-bit counts, position in encoder
    counts, and statusword."""

    force: float
    position: int
    statusword: int


@dataclass(frozen=True)
class PressResult:
    """Result of a press. It has the requested force, the mean, smallest and largest
    measured force in the second half of the pressing time, and the largest measured force since the
    first contact. Positions are in encoder counts."""

    asked_N: float
    force_count: float
    force_N: float
    least_N: float
    most_N: float
    peak_N: float
    position: int
    #: Reason why the mean force is not the force that was asked for. None if the force was held.
    not_held: str | None
    #: Position after a retract in encoder counts. None without a retract.
    retracted_position: int | None = None


@dataclass(frozen=True)
class LawObjects:
    """The filter bank that modes of force control in newtons use, or 0 for the P law."""

    force_bank: int


@dataclass(frozen=True)
class ContactObjects:
    """The object `contact`, which is 1 while the axis touches the workpiece, and the measured force
    in 8-bit counts."""

    contact: int
    force: float


def press(
    axis: Drive,
    force: Force,
    order: PressOrder,
    shown: Callable[[PressSample], None] | None = None,
) -> PressResult:
    """Presses with the force `force` and the options `order`, and then disables the axis. Calls the
    function shown(sample) a few times per second. Raises the errors of Axis.press()."""
    speed = order.speed
    expect_pressing(force)
    expect_position_gain(axis)
    bound = "approach_velocity_max" if force.newton else "touch_velocity_max"
    wanted = "target_force" if force.newton else "force_setpoint"
    given: dict[str, Value] = {} if speed is None else {"approach_velocity_max": speed}
    given[wanted] = f"{force.value!r} N" if force.newton else force.value
    asked = expect(axis, given)
    value, per_count = asked[wanted], force_per_count(axis)
    counts = _force_bound(
        axis, abs(force.value) / (per_count if force.newton else 1), order.force_max
    )
    way = None if order.retract is None else _distance(axis, order.retract)
    settings: dict[str, Value] = {"approach_timeout": order.approach_s * 1e3}
    if speed is not None or not (force.newton or axis.read(bound)):
        settings[bound] = asked.get("approach_velocity_max") or axis.read("approach_velocity_max")
    before = axis.get(*settings, *(() if force.newton else (wanted,)))
    has_bank = force.newton and axis.record(LawObjects).force_bank > 0
    apart = None
    ends = contextlib.ExitStack()
    try:
        ends.enter_context(bounded(axis, counts))
        if force.newton:
            axis.enable("force", **settings, target_force=0)
            axis.set(target_force=value)
        else:
            axis.enable("force counts", **settings, force_setpoint=value)
        axis.wait_for(ContactObjects, lambda s: s.contact == 1, "contact", order.approach_s + 1)
        samples = _hold(axis, order.seconds, {wanted: value}, shown)
        if way is not None:
            apart = _back(axis, way, speed, wanted).position
    finally:
        ends.close()
        axis.put_back(**before)
    last = [sample.force for sample in samples[len(samples) // 2 :]]
    mean = sum(last) / len(last)
    asked_N = force.value if force.newton else force.value * per_count
    return PressResult(
        asked_N=asked_N,
        not_held=_not_held(asked_N / per_count, last, per_count, has_bank),
        force_count=mean,
        force_N=mean * per_count,
        least_N=min(last) * per_count,
        most_N=max(last) * per_count,
        peak_N=max(sample.force for sample in samples) * per_count,
        position=samples[-1].position,
        retracted_position=apart,
    )


def expect_pressing(force: Force) -> None:
    """Raises InputError for a force of a press that is not above 0. The axis would move away from
    the workpiece, or would stay at standstill."""
    if force.value > 0:
        return
    unit = "N" if force.newton else "force counts"
    moves = "moves away from the workpiece" if force.value < 0 else "does not approach"
    raise InputError(
        f"press: expected a force above 0, because with another force the axis {moves}, got "
        f"{force.value:g} {unit}"
    )


def _not_held(
    counts: float, held: Sequence[float], newton_per_count: float, has_bank: bool
) -> str | None:
    """Returns None if the mean of the measured forces `held` agrees with the requested force
    `counts`, otherwise the reason why it does not. All forces are in 8-bit counts. `has_bank`:
    False for the P law."""
    bound = max(HELD_ERROR_SHARE * counts, HELD_ERROR_COUNTS)
    mean = statistics.fmean(held)
    if abs(mean - counts) <= bound:
        return None
    half = len(held) // 2
    change = statistics.fmean(held[half:]) - statistics.fmean(held[:half] or held)
    if abs(change) > bound / 2:
        why = "the force still changes: press longer"
    elif has_bank:
        why = (
            "the force law of the bank does not reach the force: look for a limit of the drive, "
            "friction or a bank without integral action"
        )
    else:
        why = (
            "the P law (force_gain) leaves this error: raise force_gain, or use a bank with "
            "integral action (`design_law`) and a force in N"
        )
    return (
        f"expected a mean force of {counts * newton_per_count:.4g} N within "
        f"{bound * newton_per_count:.3g} N, got {mean * newton_per_count:.4g} N; {why}"
    )


def _force_bound(axis: Drive, counts: float, force_max: float | str | None) -> float:
    """Returns the force limit of a press in 8-bit counts. Raises InputError if this limit is not
    larger than the force of the press."""
    most = most_counts(axis, force_max)
    newton, own = force_per_count(axis), axis.number("force_max")
    for limit, by, remedy in (
        (most, "`force_max`", "give a larger `force_max`"),
        (own or None, "force_max (201Dh) of the axis", "raise force_max, or give a smaller force"),
    ):
        if limit is not None and limit <= counts:
            raise ParameterError(
                "press",
                f"expected a force below {limit * newton:.6g} N ({limit:g} force counts), at "
                f"which {by} disables the axis, got {counts * newton:.6g} N; {remedy}",
            )
    return most or min(2 * counts + MOVE_COUNTS / 4, FORCE_MAX_COUNTS)


def _hold(
    axis: Drive,
    seconds: float,
    target: Mapping[str, Value],
    shown: Callable[[PressSample], None] | None,
) -> list[PressSample]:
    """Reads the state of the axis repeatedly while the axis presses. Calls shown(sample) a few
    times per second, and returns all samples. Raises Refused if the axis becomes disabled. Also
    raises Refused if a bound was changed so that the axis now limits the target."""
    samples: list[PressSample] = []
    was_limited = False
    for _ in axis.link.polls(seconds):
        now = axis.record(PressSample)
        if state_names.drive_state(now.statusword) != "operation enabled":
            raise Refused(
                f"{axis.link.where}: expected an enabled axis during the press, but the axis was "
                f"disabled: {axis.about()}"
            )
        is_limited = bool(now.statusword & bounds.INTERNAL_LIMIT)
        if is_limited and not was_limited:
            axis.expect_unlimited(target, "while it pressed")
        was_limited = is_limited
        samples.append(now)
        if shown is not None and len(samples) % 10 == 1:
            shown(now)
    return samples


def _distance(axis: Drive, distance: float | str) -> float:
    """Converts a distance to user units of the axis. Raises InputError if the distance is not above
    0."""
    value = quantity.number(axis, "target_position", str(distance))
    if not value > 0:
        raise InputError(f'retract: expected a distance above 0, such as "5 mm", got {distance}')
    return value


def retract(axis: Drive, distance: float | str, speed: float | str | None = None) -> AxisStatus:
    """Moves the axis away from a contact by a distance, and then disables the axis. Returns the
    last state of the axis before it was disabled. Arguments and errors are the same as for
    Axis.retract()."""
    expect_position_gain(axis)
    way = _distance(axis, distance)
    if speed is not None:
        expect(axis, {"approach_velocity_max": speed})
    force = axis.number("force")
    with bounded(axis, min(abs(force) + RETRACT_FORCE_COUNTS, FORCE_MAX_COUNTS)):
        now = axis.record(ModeObjects)
        is_enabled = now.state == "operation enabled"
        mode = str(now.modes_of_operation_display)
        return _back(axis, way, speed, FORCE_TARGETS.get(mode, "") if is_enabled else "")


@dataclass(frozen=True)
class RetractObjects:
    """Objects from which the motion of a retract is computed. The velocity is in user units, forces
    are in 8-bit counts."""

    trajectory_velocity: float
    contact_force: float
    polarity: int
    force: float


def _back(axis: Drive, way: float, speed: float | str | None, target: str) -> AxisStatus:
    """Moves the axis back against the direction of the force, by the distance `way`. Before the
    motion, lowers the force target in the object `target` to 0, unless `target` is "". The distance
    is measured from the position of the axis at force 0, so that it does not include the deflection
    of a soft workpiece. Returns the state of the axis, which is still enabled."""
    ratio = quantity.user_per_count(axis) or 1.0
    if speed is None:
        most = axis.read("approach_velocity_max")
    else:
        (most,) = expect(axis, {"approach_velocity_max": speed}).values()
    before = axis.record(RetractObjects)
    own, counts = before.trajectory_velocity, before.contact_force
    per_s = max(1.0, min(ratio * float(most), own))
    is_reversed = bool(before.polarity & bounds.REVERSED_POSITIONS)
    sign = 1 if (before.force < 0) != is_reversed else -1
    if target:
        _release(axis, target, counts)
    place = round(axis.integer("position_actual") + sign * way)
    try:
        axis.enable("profile position", trajectory_velocity=per_s)
        try:
            axis.move(place, way / per_s + RETRACT_EXTRA_S)
        # The retract would end beyond a position limit of the axis.
        except InputError as error:
            raise Refused(
                f"{axis.link.where}: expected an axis that can be retracted, got: {error}"
            ) from None
        found = axis.record(ContactObjects)
        if found.contact or abs(found.force) > counts:
            newton = found.force * force_per_count(axis)
            raise Refused(
                f"{axis.link.where}: expected no contact after the retraction, but the measured "
                f"force is still {newton:.4g} N: retract the axis further"
            )
        return state(axis)
    finally:
        axis.put_back(trajectory_velocity=own)


def _release(axis: Drive, target: str, counts: float) -> None:
    """Lowers a target force to 0 in steps, and waits until the measured force is below `counts`. If
    the force became 0 in a single step, the compressed contact would push the axis away."""
    value = axis.number(target)
    for step in range(1, RELEASE_MAX_STEPS + 1):
        axis.put_back(**{target: value * (1 - step / RELEASE_MAX_STEPS)})
        axis.link.wait(POLL_PERIOD_S)
    for _ in axis.link.polls(RELEASE_MAX_S):
        if abs(axis.number("force")) <= counts:
            return
