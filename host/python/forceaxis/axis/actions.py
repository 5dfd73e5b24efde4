"""Operations of one axis: stop, tare, calibrate, move, press."""

import contextlib
import datetime

from forceaxis._core import InputError
from forceaxis.axis.axis import POWERED
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.axis.quantity import force_per_count
from forceaxis.bus import state_names

QUICK_STOP = 0x02
STOP_S = 10.0  # a quick stop ends by then in any case
FIRST_DAY = datetime.date(1984, 1, 1)  # of CiA 301's dates
POINTS = range(2, 9)
POLL_S = 0.02
MOST_COUNTS = 512  # of force_max
STAND_S = 5.0  # a disabled axis coasts
MOVE_COUNTS = 32  # of the reading, a quarter of a signed one: a move that meets so much ends there


def state(axis):
    """State, mode, fault, position, force and owner of an axis: {name: value}."""
    found = axis.get(
        "statusword", "modes_of_operation_display", "fault", "position", "force", "command_source"
    )
    word = found.pop("statusword")
    return {
        "state": state_names.drive_state(word),
        "mode": str(found.pop("modes_of_operation_display")).replace("_", " "),
        **found,
        "force_N": found["force"] * force_per_count(axis),
    }


def stop(axis):
    """A quick stop, effective whichever source owns the axis; waits until it is disabled, or at
    standstill where quick_stop_option requires that. Its state() then. Raises NoAnswer, Refused."""
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


def wait_to_stand(axis):
    """Waits while a disabled axis coasts, STAND_S at most. Raises NoAnswer, Refused."""
    before, passed = None, 0.0
    while (now := axis.read("position")) != before and passed < STAND_S:
        before = now
        axis.link.wait(0.2)
        passed += 0.2


def tare(axis):
    """Takes the tare of a disabled axis at a stand: the new force_tare and the reading after it, in
    counts. Raises Refused with the axis' reason."""
    axis.set(tare=1)
    axis.link.wait(POLL_S)
    found = axis.wait_for(
        lambda s: s["tare_state"] != "running", ("tare_state", "fault"), "the end of the tare", 10.0
    )
    if found["tare_state"] != "done":
        raise Refused(f"{axis.link.where}: tare {found['tare_state'].replace('_', ' ')}")
    axis.link.wait(POLL_S)
    return axis.get("force_tare", "force")


def reading(axis, seconds=0.5):
    """Mean of `force` in counts over so much of the axis' time."""
    values, passed = [], 0.0
    while passed < seconds:
        values.append(axis.read("force"))
        axis.link.wait(POLL_S)
        passed += POLL_S
    return sum(values) / len(values)


def calibrate(axis, points):
    """Sets force_scale of a disabled axis by the line through 2 to 8 `points`, (reading in counts,
    reference force in N). Returns force_scale in N a count and the linearity error in per mille.
    Raises InputError, Refused with the axis' reason."""
    if len(points) not in POINTS:
        raise InputError(f"calibrate: expected 2 to 8 points, got {len(points)}")
    values = {}
    for i, (count, newton) in enumerate(points, 1):
        values[f"calibration_reading_{i}"] = count
        values[f"calibration_force_{i}"] = newton * 1e3
    today = (datetime.date.today() - FIRST_DAY).days
    axis.set(**values, calibration_points=len(points), date=today)
    refusal = None
    try:
        axis.set(calibrate=1)
        axis.link.wait(POLL_S)
    except Refused as error:  # calibration_state has the reason
        refusal = error
    found = axis.get("calibration_state", "calibration_linearity", "force_scale")
    if refusal or found["calibration_state"] != "done":
        if found["calibration_state"] in ("idle", "done"):
            raise refusal
        raise Refused(
            f"{axis.link.where}: calibration {found['calibration_state'].replace('_', ' ')}, "
            f"linearity error {found['calibration_linearity']:g} per mille"
        )
    return {
        "force_scale_N_per_count": found["force_scale"] * 1e-6,
        "linearity_permille": found["calibration_linearity"],
    }


@contextlib.contextmanager
def bounded(axis, counts):
    """Context in which a reading beyond `counts`, or beyond force_max where that is less, disables
    the axis in the same tick. At its end the axis is disabled and force_max restored."""
    own = axis.read("force_max")
    axis.set(force_max=min(counts, own) if own else counts)
    try:
        yield
    finally:
        axis.off()
        axis.set(force_max=own)


def expect_position_gain(axis):
    """Refuses an axis whose position_gain is 0: it neither approaches nor follows."""
    if axis.read("position_gain") == 0:
        raise Refused(
            f"{axis.link.where}: expected a position_gain, without which it neither approaches nor "
            "follows; give it one, `axis set position_gain=4`, or with --sim "
            "`--set firmware.position_gain=4`"
        )


def move(axis, position, speed=None, timeout_s=60.0, counts=MOVE_COUNTS):
    """Moves to a position in profile position mode and disables the axis there: its state() before
    that. speed: count/s, None: trajectory_velocity; counts: bound of the reading. Raises Refused,
    NoAnswer, which names the fault where the bound was passed."""
    expect_position_gain(axis)
    with bounded(axis, counts):
        axis.enable("profile position", **({"trajectory_velocity": speed} if speed else {}))
        axis.move(position, timeout_s)
        return state(axis)


def press(axis, force, newton, speed, approach_s, seconds, shown=lambda state: None, counts=None):
    """Presses with `force` for `seconds` from the contact on, then disables the axis: what was
    held.

    newton: force is in N, mode 4; else in counts of an 8-bit reading, mode -1, the P law. The
    approach is no faster than `speed`, count/s, and ends in the fault no_contact after
    `approach_s`. A reading beyond `counts`, by default twice the force and some, disables it.
    Parameters set for it are restored afterwards. shown(state) is called some times a second.
    Raises InputError, Refused, NoAnswer.
    """
    expect_position_gain(axis)
    bounds = {"approach_timeout": approach_s * 1e3}
    bounds["approach_velocity_max" if newton else "touch_velocity_max"] = speed
    wanted = "target_force" if newton else "force_setpoint"
    value = force * 1e6 / axis.read("rated_force") if newton else force
    before = axis.get(*bounds, *(() if newton else (wanted,)))
    per_count = force_per_count(axis)
    least = abs(force) / (per_count if newton else 1)
    ends = contextlib.ExitStack()
    try:
        ends.enter_context(bounded(axis, counts or min(2 * least + MOVE_COUNTS / 4, MOST_COUNTS)))
        if newton:
            axis.enable("force", **bounds, target_force=0)
            axis.set(target_force=value)
        else:
            axis.enable("force counts", **bounds, force_setpoint=value)
        axis.wait_for(lambda s: s["contact"] == 1, ("contact",), "contact", approach_s + 1)
        held, passed, steps = [], 0.0, 0
        while passed < seconds:
            now = axis.wait_for(lambda s: True, ("force", "position", "statusword"), "")
            if state_names.drive_state(now["statusword"]) != "operation enabled":
                raise Refused(
                    f"{axis.link.where}: it was disabled while it pressed, {axis.about()}"
                )
            held.append(now)
            if steps % 10 == 0:
                shown(now)
            axis.link.wait(POLL_S)
            passed, steps = passed + POLL_S, steps + 1
    finally:
        ends.close()
        axis.set(**before)
    last = [now["force"] for now in held[len(held) // 2 :]]
    mean = sum(last) / len(last)
    return {
        "force_count": mean,
        "force_N": mean * per_count,
        "least_N": min(last) * per_count,
        "most_N": max(last) * per_count,
        "peak_N": max(now["force"] for now in held) * per_count,
        "position": held[-1]["position"],
    }
