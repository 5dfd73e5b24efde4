"""Operations of one axis: stop, tare, calibrate, move, press, retract."""

import contextlib
import datetime
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from forceaxis._core import InputError
from forceaxis.axis import bounds, quantity
from forceaxis.axis.link import Live, NoAnswer, Refused
from forceaxis.axis.quantity import Force, force_per_count
from forceaxis.bus import state_names
from forceaxis.bus.client import from_raw
from forceaxis.bus.state_names import POWERED
from forceaxis.errors import ParameterError

QUICK_STOP = 0x02
STOP_S = 10.0  # longest duration of a quick stop
FIRST_DAY = datetime.date(1984, 1, 1)  # of CiA 301's dates
POINTS = range(2, 9)
POLL_S = 0.02
MOST_COUNTS = 512  # of force_max
STAND_S = 5.0  # longest time for which a disabled axis may coast
GUARD_COUNTS = 8  # counts by which the force may exceed its initial value during a retract
# steps of the target down to 0; longest wait until the force is released
RELEASE_STEPS, RELEASE_S = 25, 3.0
# {mode of operation: the target that sets the force in it}
TARGETS = {
    "force": "target_force", "cyclic_force": "target_force", "force_counts": "force_setpoint"
}  # fmt: skip
APART_S = 10.0  # time that a retract may take in addition to the time for its distance
# force counts, a quarter of a signed range: a move ends if the force reaches this value
MOVE_COUNTS = 32


@dataclass(frozen=True)
class AxisStatus:
    """State of an axis at one moment: state of CiA 402, mode of operation, fault, position in
    encoder counts, measured force in 8-bit counts and in N, name of the command source that owns
    the axis."""

    state: str
    mode: str
    fault: str
    position: int
    force: float
    command_source: str
    force_N: float


def state(axis: Live) -> AxisStatus:
    """The present AxisStatus. Raises NoAnswer, Refused."""
    word, mode, fault, position, force, source = axis.get(
        "statusword", "modes_of_operation_display", "fault", "position", "force", "command_source"
    ).values()
    return AxisStatus(
        state=state_names.drive_state(word),
        mode=str(mode).replace("_", " "),
        fault=fault,
        position=position,
        force=force,
        command_source=source,
        force_N=force * force_per_count(axis),
    )


def stop(axis: Live) -> AxisStatus:
    """Commands a quick stop, which acts for every owner, and waits until the axis is disabled, or
    at standstill if quick_stop_option keeps it enabled; returns its state(). Raises NoAnswer,
    Refused."""
    for remaining in (2, 1, 0):  # another master may interrupt a transfer
        try:
            axis.link.write({"controlword": QUICK_STOP})
            break
        except NoAnswer:
            if not remaining:
                raise
    axis.wait_for(
        lambda s: state_names.drive_state(s["statusword"]) != "operation enabled",
        ("statusword", "fault"),
        "the axis to leave operation enabled",
    )
    stays = axis.link.read(["quick_stop_option"])["quick_stop_option"] >= 5
    if not stays:
        axis.wait_for(
            lambda s: state_names.drive_state(s["statusword"]) not in POWERED,
            ("statusword", "fault"),
            "the axis to be off",
            STOP_S,
        )
    return state(axis)


def wait_to_stand(axis: Live) -> None:
    """Waits while a disabled axis coasts, at most STAND_S. Raises NoAnswer, Refused."""
    before, passed = None, 0.0
    while (now := axis.read("position")) != before and passed < STAND_S:
        before = now
        axis.link.wait(0.2)
        passed += 0.2


@dataclass(frozen=True)
class TareResult:
    """The tare of an axis and the measured force after taring, both in 8-bit counts."""

    force_tare: float
    force: float


def tare(axis: Live) -> TareResult:
    """Tares a disabled axis at standstill. Raises Refused with the reason from the axis."""
    axis.set(tare=1)
    axis.link.wait(POLL_S)
    found = axis.wait_for(
        lambda s: s["tare_state"] != "running", ("tare_state", "fault"), "the end of the tare", 10.0
    )
    if found["tare_state"] != "done":
        raise Refused(f"{axis.link.where}: tare {found['tare_state'].replace('_', ' ')}")
    axis.link.wait(POLL_S)
    return TareResult(**axis.get("force_tare", "force"))


def reading(axis: Live, seconds: float = 0.5) -> float:
    """Mean of the measured force in counts over `seconds` of the axis' time."""
    values: list[float] = []
    passed = 0.0
    while passed < seconds:
        values.append(axis.read("force"))
        axis.link.wait(POLL_S)
        passed += POLL_S
    return sum(values) / len(values)


@dataclass(frozen=True)
class CalibrationResult:
    """Result of a calibration: scale of the measured force, and linearity error in per mille of the
    span."""

    force_scale_N_per_count: float
    linearity_permille: float


def calibrate(axis: Live, points: Sequence[tuple[float, float]]) -> CalibrationResult:
    """Calculates and sets force_scale of a disabled axis from a line through 2 to 8 `points`, each
    (measured force in counts, reference force in N). Raises InputError, and Refused with the reason
    from the axis."""
    if len(points) not in POINTS:
        raise InputError(f"calibrate: expected 2 to 8 points, got {len(points)}")
    values: dict[str, float] = {}
    for i, (count, newton) in enumerate(points, 1):
        values[f"calibration_reading_{i}"] = count
        values[f"calibration_force_{i}"] = newton * 1e3
    today = (datetime.date.today() - FIRST_DAY).days
    axis.set(**values, calibration_points=len(points), date=today)
    refusal = None
    try:
        axis.set(calibrate=1)
        axis.link.wait(POLL_S)
    except Refused as error:  # calibration_state contains the reason
        refusal = error
    found = axis.get("calibration_state", "calibration_linearity", "force_scale")
    if refusal or found["calibration_state"] != "done":
        if refusal and found["calibration_state"] in ("idle", "done"):
            raise refusal
        raise Refused(
            f"{axis.link.where}: calibration {found['calibration_state'].replace('_', ' ')}, "
            f"linearity error {found['calibration_linearity']:g} per mille"
        )
    return CalibrationResult(
        force_scale_N_per_count=found["force_scale"] * 1e-6,
        linearity_permille=found["calibration_linearity"],
    )


@contextlib.contextmanager
def bounded(axis: Live, counts: float) -> Iterator[None]:
    """Context with a lower force limit: a measured force above `counts`, or above force_max if that
    is less, disables the axis in the same tick. At the end the axis is disabled and force_max is
    restored."""
    own = axis.read("force_max")
    axis.set(force_max=min(counts, own) if own else counts)
    try:
        yield
    finally:
        axis.off()
        axis.put_back(force_max=own)


def expect_position_gain(axis: Live) -> None:
    """Raises Refused for an axis whose position_gain is 0, because it cannot approach or follow a
    position."""
    if axis.read("position_gain") == 0:
        raise Refused(
            f"{axis.link.where}: expected a position_gain above 0, the axis neither approaches nor "
            "follows without it; set position_gain, for a simulated axis firmware.position_gain of "
            "its experiment"
        )


def expect_unclipped(axis: Live, values: Mapping[str, Any], when: str) -> None:
    """Raises Refused, in one line, if the axis now limits one of the force targets. when: text such
    as "while it moved"."""
    text = bounds.clipped(axis, values)
    if text:
        raise Refused(f"{axis.link.where}: its bounds have changed {when}: {text}")


def most_counts(axis: Live, force_max: float | str | None) -> float | None:
    """A force limit in counts, from "120 N" or counts; None stays None. Raises InputError."""
    if force_max is None:
        return None
    try:
        counts = quantity.number(axis, "force_max", str(force_max))
    except InputError:
        counts = 0.0
    if not 0 < counts <= MOST_COUNTS:
        newton = MOST_COUNTS * force_per_count(axis)
        raise ParameterError(
            "force_max",
            f'expected up to {MOST_COUNTS} force counts, or a force as "75 N" up to '
            f"{newton:.6g} N, got {force_max}",
        )
    return counts


def move(
    axis: Live,
    position: int | str,
    speed: float | str | None = None,
    timeout_s: float = 60.0,
    counts: float = MOVE_COUNTS,
) -> AxisStatus:
    """Moves to a position in profile position mode and then disables the axis; returns its state()
    before that. position: in user units of the axis or "10 mm"; speed: in user units per second or
    "5 mm/s", None: trajectory_velocity; counts: force limit. Raises InputError before the motion if
    the axis would limit a target; Refused; NoAnswer, which names the fault if the force limit was
    exceeded."""
    expect_position_gain(axis)
    settings = {} if speed is None else {"trajectory_velocity": speed}
    settings = expect(axis, {**settings, "target_position": position})
    place = int(settings.pop("target_position"))
    before = axis.get(*settings)
    try:
        with bounded(axis, counts):
            axis.enable("profile position", **settings)
            axis.move(place, timeout_s)
            return state(axis)
    finally:
        axis.put_back(**before)


def expect(axis: Live, values: Mapping[str, Any]) -> dict[str, Any]:
    """Converts targets and quantities to engineering values and checks that the axis limits none of
    them. Raises InputError with the bound and its object."""
    found = {n: from_raw(n, raw) for n, raw in quantity.all_raw(axis, values).items()}
    bounds.expect(axis, found)
    return found


@dataclass(frozen=True)
class PressOrder:
    """Options of a press besides its force; see Axis.press(). A value of None has the default that
    is stated there."""

    seconds: float = 3.0
    speed: float | str | None = None
    approach_s: float = 10.0
    force_max: float | str | None = None
    retract: float | str | None = None


@dataclass(frozen=True)
class PressSample:
    """One sample of a press: measured force in 8-bit counts, position in encoder counts,
    statusword."""

    force: float
    position: int
    statusword: int


@dataclass(frozen=True)
class PressResult:
    """Measured force of a press: mean, smallest and largest value in the second half of the time,
    and the peak since the first contact. Positions are in encoder counts."""

    force_count: float
    force_N: float
    least_N: float
    most_N: float
    peak_N: float
    position: int
    retracted_position: int | None = None  #: after a retract, otherwise None


def press(
    axis: Live,
    force: Force,
    order: PressOrder,
    shown: Callable[[PressSample], None] | None = None,
) -> PressResult:
    """Presses with `force` as `order` specifies, then disables the axis. Errors as in Axis.press().
    shown(sample) is called a few times per second."""
    speed = order.speed
    expect_position_gain(axis)
    bound = "approach_velocity_max" if force.newton else "touch_velocity_max"
    wanted = "target_force" if force.newton else "force_setpoint"
    given: dict[str, Any] = {} if speed is None else {"approach_velocity_max": speed}
    given[wanted] = f"{force.value!r} N" if force.newton else force.value
    asked = expect(axis, given)
    value, per_count = asked[wanted], force_per_count(axis)
    counts = _force_bound(
        axis, abs(force.value) / (per_count if force.newton else 1), order.force_max
    )
    way = None if order.retract is None else _distance(axis, order.retract)
    settings = {"approach_timeout": order.approach_s * 1e3}
    if speed is not None or not (force.newton or axis.read(bound)):
        settings[bound] = asked.get("approach_velocity_max") or axis.read("approach_velocity_max")
    before = axis.get(*settings, *(() if force.newton else (wanted,)))
    apart = None
    ends = contextlib.ExitStack()
    try:
        ends.enter_context(bounded(axis, counts))
        if force.newton:
            axis.enable("force", **settings, target_force=0)
            axis.set(target_force=value)
        else:
            axis.enable("force counts", **settings, force_setpoint=value)
        axis.wait_for(lambda s: s["contact"] == 1, ("contact",), "contact", order.approach_s + 1)
        samples = _hold(axis, order.seconds, {wanted: value}, shown)
        if way is not None:
            apart = _back(axis, way, speed, wanted).position
    finally:
        ends.close()
        axis.put_back(**before)
    last = [sample.force for sample in samples[len(samples) // 2 :]]
    mean = sum(last) / len(last)
    return PressResult(
        force_count=mean,
        force_N=mean * per_count,
        least_N=min(last) * per_count,
        most_N=max(last) * per_count,
        peak_N=max(sample.force for sample in samples) * per_count,
        position=samples[-1].position,
        retracted_position=apart,
    )


def _force_bound(axis: Live, counts: float, force_max: float | str | None) -> float:
    """Force limit of a press in counts, which has to exceed the force of the press. Raises
    InputError."""
    most = most_counts(axis, force_max)
    newton, own = force_per_count(axis), axis.read("force_max")
    for limit, by, remedy in (
        (most, "`force_max`", "give a larger one"),
        (own or None, "force_max (201Dh) of the axis", "raise it, or ask for less"),
    ):
        if limit is not None and limit <= counts:
            raise ParameterError(
                "press",
                f"expected less than {limit * newton:.6g} N ({limit:g} force counts), where "
                f"{by} disables it, got {counts * newton:.6g} N; {remedy}",
            )
    return most or min(2 * counts + MOVE_COUNTS / 4, MOST_COUNTS)


def _hold(
    axis: Live,
    seconds: float,
    target: Mapping[str, Any],
    shown: Callable[[PressSample], None] | None,
) -> list[PressSample]:
    """Samples the axis while it presses; calls shown(sample) a few times per second. Raises Refused
    if the axis becomes disabled, or if it limits the target because a bound has changed."""
    samples: list[PressSample] = []
    passed, steps, limited = 0.0, 0, False
    while passed < seconds:
        found = axis.wait_for(lambda s: True, ("force", "position", "statusword"), "")
        found.pop("fault")
        now = PressSample(**found)
        word = now.statusword
        if state_names.drive_state(word) != "operation enabled":
            raise Refused(f"{axis.link.where}: it was disabled while it pressed, {axis.about()}")
        if word & bounds.INTERNAL_LIMIT and not limited:
            expect_unclipped(axis, target, "while it pressed")
        limited = bool(word & bounds.INTERNAL_LIMIT)
        samples.append(now)
        if shown is not None and steps % 10 == 0:
            shown(now)
        axis.link.wait(POLL_S)
        passed, steps = passed + POLL_S, steps + 1
    return samples


def _distance(axis: Live, distance: float | str) -> float:
    """A distance in user units of the axis. Raises InputError."""
    value = quantity.number(axis, "target_position", str(distance))
    if not value > 0:
        raise InputError(f'retract: expected a distance above 0 as "5 mm", got {distance}')
    return value


def retract(axis: Live, distance: float | str, speed: float | str | None = None) -> AxisStatus:
    """Moves back from a contact by a distance and disables the axis; returns its state() before
    that. Arguments and errors as in Axis.retract()."""
    expect_position_gain(axis)
    way = _distance(axis, distance)
    if speed is not None:
        expect(axis, {"approach_velocity_max": speed})
    force = axis.read("force")
    with bounded(axis, min(abs(force) + GUARD_COUNTS, MOST_COUNTS)):
        mode = str(axis.read("modes_of_operation_display"))
        enabled = state_names.drive_state(axis.read("statusword")) == "operation enabled"
        return _back(axis, way, speed, TARGETS.get(mode, "") if enabled else "")


def _back(axis: Live, way: float, speed: float | str | None, target: str) -> AxisStatus:
    """Releases the force, if a target presses, then moves in the opposite direction of the force by
    `way`, measured from the position of the press. Returns the state() there; the axis is still
    enabled."""
    ratio = quantity.user_per_count(axis) or 1.0
    slow = {} if speed is None else {"approach_velocity_max": speed}
    most = (expect(axis, slow) or axis.get("approach_velocity_max"))["approach_velocity_max"]
    own, counts = axis.read("trajectory_velocity"), axis.read("contact_force")
    per_s = max(1.0, min(ratio * most, own))
    reverse = bool(axis.read("polarity") & bounds.REVERSED)
    sign = 1 if (axis.read("force") < 0) != reverse else -1
    place = round(axis.read("position_actual") + sign * way)
    if target:
        _release(axis, target, counts)
    here = axis.read("position_actual")  # the axis does not move toward the workpiece
    place = max(place, here) if sign > 0 else min(place, here)
    try:
        axis.enable("profile position", trajectory_velocity=per_s)
        try:
            axis.move(place, way / per_s + APART_S)
        except InputError as error:  # a limit in the way
            raise Refused(f"{axis.link.where}: it cannot be retracted: {error}") from None
        found = axis.get("contact", "force")
        if found["contact"] or abs(found["force"]) > counts:
            newton = found["force"] * force_per_count(axis)
            raise Refused(
                f"{axis.link.where}: expected it apart after the retract, it still reads "
                f"{newton:.4g} N: retract it further"
            )
        return state(axis)
    finally:
        axis.put_back(trajectory_velocity=own)


def _release(axis: Live, target: str, counts: float) -> None:
    """Lowers a target to 0 in steps and waits until the measured force is below `counts`. In one
    step, the contact spring would accelerate the axis away from the workpiece."""
    value = axis.read(target)
    for step in range(1, RELEASE_STEPS + 1):
        axis.put_back(**{target: value * (1 - step / RELEASE_STEPS)})
        axis.link.wait(POLL_S)
    passed = 0.0
    while passed < RELEASE_S and abs(axis.read("force")) > counts:
        axis.link.wait(POLL_S)
        passed += POLL_S
