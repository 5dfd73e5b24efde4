"""Commands to one axis: write objects, wait, enable, move, disable."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from forceaxis._core import InputError
from forceaxis.axis import bounds, quantity
from forceaxis.axis.link import POLL_PERIOD_S, NoAnswer, Refused
from forceaxis.axis.values import AxisValues, R, known_object, object_names
from forceaxis.bus import state_names
from forceaxis.bus.client import Value, to_raw
from forceaxis.bus.state_names import POWERED
from forceaxis.objects import mask

MODES = {text: number for number, text in state_names.MODES.items()}
# Values of the controlword, and bits of the statusword (CiA 402).
SHUTDOWN = mask("controlword", "enable_voltage", "no_quick_stop")
SWITCH_ON = SHUTDOWN | mask("controlword", "switch_on")
ENABLE = SWITCH_ON | mask("controlword", "enable_operation")
NEW_SETPOINT = START_HOMING = ENABLE | mask("controlword", "start")
FAULT_RESET = mask("controlword", "fault_reset")
COMMAND_BITS = ENABLE | FAULT_RESET  # bits of the controlword that select the drive state
DISABLE_VOLTAGE = 0  # the only controlword that ends a latched quick stop
TARGET_REACHED = mask("statusword", "reached")
ACKNOWLEDGED = mask("statusword", "acknowledged")
# End of an error text about an axis with a fault.
FAULT_REMEDY = "; `axis.reset_fault()` resets the fault"
# an axis that stands still for this time in s beside its target does not reach the target
STANDS_S = 2.0
# Longest time in s from the write of the controlword until the axis is disabled.
# The time includes the deceleration of the axis to standstill, and at most 1 s for its brake.
DISABLE_TIMEOUT_S = 3.0


@dataclass(frozen=True)
class DriveObjects:
    """Objects that describe the state of an axis: position in encoder counts, force in 8-bit
    counts."""

    statusword: int
    # active mode of operation; a mode without a name is shown as a number
    modes_of_operation_display: str | int
    fault: str
    position: int
    force: float
    command_source: str

    @property
    def state(self) -> str:
        """Returns the CiA 402 state of the drive as text."""
        return state_names.drive_state(self.statusword)

    @property
    def mode(self) -> str:
        """Returns the mode of operation of the axis as text."""
        return str(self.modes_of_operation_display).replace("_", " ")


@dataclass(frozen=True)
class FaultObjects:
    """The latched fault of the axis as text, which is "none" without a fault."""

    fault: str


@dataclass(frozen=True)
class ExcitationObjects:
    """State of the excitation signal of the axis, such as "running" or "done"."""

    excitation_state: str


@dataclass(frozen=True)
class StatusObjects:
    """The statusword of the axis."""

    statusword: int

    @property
    def state(self) -> str:
        """Returns the CiA 402 state of the drive as text."""
        return state_names.drive_state(self.statusword)


@dataclass(frozen=True)
class StoppedObjects(StatusObjects):
    """The statusword, the native mode and the fault of an axis that is to be disabled."""

    active_mode: str
    fault: str


@dataclass(frozen=True)
class ModeObjects(StatusObjects):
    """The statusword of the axis and the active mode of operation."""

    modes_of_operation_display: str | int


@dataclass(frozen=True)
class ReachedPosition(StatusObjects):
    """The statusword of the axis, the position in encoder counts at the end of a move, and the
    position in user units to which the axis was commanded. `contact`: 1 if the axis was in contact
    at the end of the move."""

    position: int
    position_demand: int
    contact: int


class Drive(AxisValues):
    """An axis to which this program sends commands. The connection must have acquired the axis, so
    that the axis accepts the commands."""

    def set(self, **values: Value) -> None:
        """Writes engineering values, texts of enumerations or quantities ("75 N", "10 mm/s") to the
        axis in order. Raises InputError, before the first write, for an unknown or read-only
        object, for an invalid value, and for a target that the axis would limit (see
        forceaxis.axis.bounds). Also raises Refused, NoAnswer."""
        for name in values:
            if known_object(name).access == "ro":
                raise InputError(
                    f"{name}: expected an object that can be written, got a read-only object; "
                    "choose another object"
                )
        raw = quantity.all_raw(self, values)
        bounds.expect_raw(self, raw)
        self.link.write(raw)

    def put_back(self, **values: Value) -> None:
        """Writes engineering values without the check of bounds that set() makes. Use this function
        to restore earlier values, whose bounds may have changed meanwhile, or to lower a value to 0
        in steps. Raises InputError, Refused, NoAnswer."""
        self.link.write({name: to_raw(name, value) for name, value in values.items()})

    def wait_for(
        self,
        kind: type[R],
        holds: Callable[[R], bool | int],
        what: str,
        timeout_s: float = 5.0,
    ) -> R:
        """Waits for a condition on objects of the axis. The fields of the dataclass `kind` name
        these objects. The objects are read repeatedly until holds(values) is true, and these values
        are returned. Raises NoAnswer after `timeout_s` by the clock of the axis. If `kind` has no
        field `fault`, a fault also raises NoAnswer. The error text contains `what` and the state of
        the axis."""
        names = object_names(kind)
        passed_s = 0.0
        while True:
            values = self.get(*dict.fromkeys([*names, "fault"]))
            found = kind(**{name: values[name] for name in names})
            if holds(found):
                return found
            has_failed = values["fault"] != "none" and "fault" not in names
            if passed_s >= timeout_s or has_failed:
                remedy = FAULT_REMEDY if has_failed else ""
                raise NoAnswer(
                    f"{self.link.where}: expected {what} within {timeout_s:g} s, "
                    f"{self.about()}{remedy}"
                )
            self.link.wait(POLL_PERIOD_S)
            passed_s += POLL_PERIOD_S

    def about(self) -> str:
        """Returns a text about the axis: drive state, fault, mode of operation, position in encoder
        counts, and force in 8-bit counts."""
        now = self.record(DriveObjects)
        return (
            f"{state_names.condition(now.statusword, now.fault)}, mode {now.mode}, "
            f"position {now.position} encoder counts, force {now.force:g} force counts"
        )

    def enable(self, mode: str | int, **parameters: Value) -> None:
        """Enables the axis in a mode of operation, so that its drive state is "operation enabled".
        `mode`: name in state_names.MODES, or number of the mode. `parameters`: values of objects,
        which are written before the mode changes. Raises InputError for an unknown mode, Refused if
        the axis has a fault, and NoAnswer."""
        number = MODES.get(mode, mode) if isinstance(mode, str) else mode
        if number not in state_names.MODES:
            raise InputError(f"{mode}: expected a mode of operation: {', '.join(MODES)}")
        before = self.record(StoppedObjects)
        if before.fault != "none":
            fault = before.fault.replace("_", " ")
            raise Refused(f"{self.link.where}: fault {fault}{FAULT_REMEDY}")
        self.set(**parameters, modes_of_operation=number)
        if before.state != "operation enabled":
            for word in (SHUTDOWN, SWITCH_ON, ENABLE):
                self.set(controlword=word)
                self.link.wait(POLL_PERIOD_S)

        def is_enabled(now: ModeObjects) -> bool:
            mode = to_raw("modes_of_operation_display", now.modes_of_operation_display)
            return now.state == "operation enabled" and mode == number

        self.wait_for(ModeObjects, is_enabled, f"operation enabled in mode {mode}")

    def disable(self) -> None:
        """Sends the command to disable the axis and does not wait for the disabled state. Raises
        Refused, NoAnswer."""
        self.link.write({"controlword": SHUTDOWN})

    def off(self) -> None:
        """Disables an enabled axis and waits until it is disabled and its brake has engaged, for at
        most 3 s by the clock of the axis. Raises Refused, NoAnswer."""

        def is_off(now: StoppedObjects) -> bool:
            return now.state not in POWERED and now.active_mode == "disabled"

        now = self.record(StoppedObjects)
        if is_off(now) and now.state != "switched on":
            return
        if now.state in (*POWERED, "switched on"):
            word = DISABLE_VOLTAGE if "quick" in now.state else SHUTDOWN
            self.link.write({"controlword": word})
        self.wait_for(StoppedObjects, is_off, "it to be disabled", DISABLE_TIMEOUT_S)

    def reset_fault(self) -> None:
        """Resets the fault of the axis, which stays disabled. Raises Refused, NoAnswer."""
        self.link.write({"controlword": 0})
        self.link.write({"controlword": FAULT_RESET})

    def move(
        self, position: int | str, timeout_s: float = 20.0, until_contact: bool = False
    ) -> ReachedPosition:
        """Moves the axis to `position` in profile position mode. Waits until the axis has reached
        the position, for at most `timeout_s` by the clock of the axis. `position`: number in user
        units of the axis, or a text such as "10 mm". With `until_contact`, it also returns when the
        axis comes into contact; the axis then still moves. Raises InputError for a position beyond
        a limit, Refused if a limit has changed during the motion, and NoAnswer."""
        self.set(target_position=position, controlword=NEW_SETPOINT)
        target = self.number("target_position")
        self.wait_for(
            StatusObjects, lambda s: s.statusword & ACKNOWLEDGED, "the set-point acknowledged"
        )
        self.set(controlword=ENABLE)
        unit = quantity.user_per_count(self) or 1.0
        stood_s = 0.0
        before: int | None = None

        def ends(now: ReachedPosition) -> bool:
            """True if the axis has reached its target, or if it has stood still for STANDS_S
            seconds after its motion.
            """
            nonlocal stood_s, before
            stands = before is not None and abs(now.position - before) <= 1
            at_end = abs(now.position_demand - target) <= max(1.0, unit)
            stood_s = stood_s + POLL_PERIOD_S if stands and at_end else 0.0
            before = now.position
            touches = until_contact and bool(now.contact)
            return bool(now.statusword & TARGET_REACHED) or touches or stood_s >= stands_s

        stands_s = STANDS_S + 1e-3 * self.number("position_window_time")
        reached = self.wait_for(
            ReachedPosition, ends, f"position {position} to be reached", timeout_s
        )
        self.expect_unlimited({"target_position": target}, "while it moved")
        if not (reached.statusword & TARGET_REACHED or (until_contact and reached.contact)):
            beside = self.number("position_actual") - target
            raise Refused(
                f"{self.link.where}: expected the axis within position_window "
                f"({self.number('position_window'):g}) of its target {target:g}, but it stands "
                f"{beside:g} beside it: a position_gain that is too small for the friction (raise "
                "it, or position_window), an obstacle, or a weight that output_bias does not hold "
                "(axis check)"
            )
        return reached

    def expect_unlimited(self, targets: Mapping[str, Value], when: str) -> None:
        """Raises Refused if the axis now limits one of the targets. `when`: text at the end of the
        message, such as "while it moved"."""
        try:
            bounds.expect(self, targets)
        except InputError as error:
            raise Refused(
                f"{self.link.where}: the bounds of the axis have changed {when}: {error}"
            ) from None
