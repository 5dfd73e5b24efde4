"""A live axis in engineering units, over any link.

with Axis.sim("sim/experiments/session.toml") as axis:    # acquired; or can, gateway, modbus
    axis.set(position_gain=4.0, velocity_gain=20.0, force_gain=5.0)
    axis.get("force", "fault")                        # {"force": 0.0, "fault": "none"}
    axis.enable("profile position")
    axis.move(36_000)                                 # or "10 mm"
    axis.press("75 N", seconds=2.0, retract="5 mm")   # approach, hold, apart again, disabled
    held = axis.capture(["force", "dac_code"], samples=1500)
                                              # at the end: disabled and released
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from forceaxis._core import InputError
from forceaxis.axis import actions, bounds, quantity
from forceaxis.axis.link import Link, NoAnswer, Recording, Refused
from forceaxis.axis.quantity import trigger_on
from forceaxis.bus import state_names
from forceaxis.bus.client import from_raw, object_named, to_raw
from forceaxis.bus.state_names import POWERED

if TYPE_CHECKING:
    from forceaxis.objects import AxisObject

__all__ = ["MODES", "Axis", "trigger_on"]

MODES = {text: number for number, text in state_names.MODES.items()}
# CiA 402: controlwords and bits of the statusword.
SHUTDOWN, SWITCH_ON, ENABLE, NEW_SETPOINT = 0x06, 0x07, 0x0F, 0x1F
START_HOMING, FAULT_RESET = 0x1F, 0x80
DISABLE_VOLTAGE = 0  # the only command that leaves a latched quick stop
TARGET_REACHED, BIT_12, HOMING_ERROR = 1 << 10, 1 << 12, 1 << 13
POLL_S = 0.02
# End of an error text for an axis with a fault. A verb replaces the function by its own command.
RESETS = "; reset_fault() resets the fault"
# longest time from the controlword to the disabled state, including the ramp of a stop
OFF_S = 2.0
ABOUT = ("statusword", "modes_of_operation_display", "fault", "position", "force")


class Axis:
    """A connected axis. __enter__ acquires it; close() disables and releases it."""

    def __init__(self, link: Link) -> None:
        self.link, self._owned = link, False

    @classmethod
    def sim(cls, experiment: str | Path, overrides: Sequence[str] = (), store: str = "") -> Axis:
        """The simulated axis of an experiment, in its own time. Raises InputError. Warns if the
        axis' force scale differs from that of its model."""
        from forceaxis.axis.sim import SimLink

        link = SimLink(experiment, overrides, store)
        if link.warning:
            warnings.warn(link.warning, stacklevel=2)
        return cls(link)

    @classmethod
    def can(cls, interface: str = "can0", node: int = 1, model: str | Path | None = None) -> Axis:
        """A node of a CAN interface. model: a file whose encoder gives the size of a count in mm.
        Raises InputError, NoAnswer."""
        from forceaxis.axis.can import CanLink

        return cls(_with_model(CanLink(interface, node), model))

    @classmethod
    def gateway(
        cls, axis: int = 1, url: str | None = None, model: str | Path | None = None
    ) -> Axis:
        """An axis at the gateway of an LCM bus; url None: the default of LCM. model: as in can().
        Raises InputError."""
        from forceaxis.axis.gateway import GatewayLink

        return cls(_with_model(GatewayLink(axis, url), model))

    @classmethod
    def modbus(cls, url: str, unit: int = 1, model: str | Path | None = None) -> Axis:
        """A unit at "tcp://HOST[:PORT]" or "/dev/ttyX[:BAUD]". model: as in can(). Raises
        InputError, NoAnswer."""
        from forceaxis.axis.modbus import ModbusLink

        return cls(_with_model(ModbusLink(url, unit), model))

    def __enter__(self) -> Axis:
        self.acquire()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def acquire(self, shared: bool = False) -> None:
        """Acquires the axis. Raises Refused if another client has enabled it. shared: if that
        client is on the same bus, it keeps the axis; this program may write to it and does not
        disable it in close()."""
        found = self.link.read(["command_source", "statusword"])
        state = state_names.drive_state(found["statusword"])
        if state in POWERED:
            ours = found["command_source"] == self.link.source
            if ours and shared:
                return
            owner = state_names.enum("command_source", found["command_source"])
            whose = "another client of this bus" if ours else f"the client that owns it, {owner}"
            raise Refused(f"{self.link.where}: it is {state} by {whose}")
        self.link.acquire()
        self._owned = True

    def close(self) -> str:
        """Disables and releases an owned axis and ends the connection, also after an error. Returns
        the result as text."""
        done = "was not owned"
        try:
            if self._owned:
                self._owned = False
                done = "does not answer; its watchdog disables it"
                self.off()
                self.link.release()
                done = "is disabled and released"
        except Refused:
            done = "is owned by another client"
        except NoAnswer:
            pass
        finally:
            self.link.close()
        return done

    def get(self, *names: str) -> dict[str, Any]:
        """{name: engineering value or text of an enumeration}, in the order of `names`. Raises
        InputError for an unknown name."""
        for name in names:
            _known(name)
        found = self.link.read(names)
        return {name: from_raw(name, found[name]) for name in names}

    def read(self, name: str) -> Any:
        """The value of one object, in the form of get()."""
        return self.get(name)[name]

    def set(self, **values: Any) -> None:
        """Writes engineering values, texts of enumerations or quantities ("75 N", "10 mm/s") in
        order. Raises InputError, before anything is written, for an unknown or read-only object, an
        invalid value, or a target that the axis would limit (see bounds)."""
        for name in values:
            if _known(name).access == "ro":
                raise InputError(f"{name}: expected an object that can be written, it is read-only")
        raw = quantity.all_raw(self, values)
        bounds.expect(self, {name: from_raw(name, value) for name, value in raw.items()})
        self.link.write(raw)

    def put_back(self, **values: Any) -> None:
        """Writes back engineering values that the axis had before, or reduces a value in steps to
        0. As set(), but without the check of bounds, so that a bound that has changed meanwhile
        does not prevent it."""
        self.link.write({name: to_raw(name, value) for name, value in values.items()})

    def wait_for(
        self,
        holds: Callable[[dict[str, Any]], Any],
        names: Sequence[str],
        what: str,
        timeout_s: float = 5.0,
    ) -> dict[str, Any]:
        """Reads `names` until holds({name: value}) is True, for at most timeout_s of the axis'
        time; returns these values. Raises NoAnswer, which names `what` and the state of the axis,
        at the time limit or after an unexpected fault."""
        passed = 0.0
        while True:
            found = self.get(*names, "fault")
            if holds(found):
                return found
            if passed >= timeout_s or (found["fault"] != "none" and "fault" not in names):
                unasked = found["fault"] != "none" and "fault" not in names
                mended = RESETS if unasked else ""
                raise NoAnswer(
                    f"{self.link.where}: expected {what} within {timeout_s:g} s, "
                    f"{self.about()}{mended}"
                )
            self.link.wait(POLL_S)
            passed += POLL_S

    def about(self) -> str:
        """The state of the axis as text."""
        found = self.link.read(ABOUT)
        return (
            f"{state_names.condition(found['statusword'], found['fault'])}, "
            f"mode {state_names.mode(found['modes_of_operation_display'])}, "
            f"position {found['position']} encoder counts, "
            f"force {from_raw('force', found['force']):g} force counts"
        )

    def enable(self, mode: str | int, **parameters: Any) -> None:
        """Enables the axis (state operation enabled) in a mode of operation, given by its name
        (state_names.MODES) or number. `parameters` are written before the mode changes."""
        number = MODES.get(mode, mode) if isinstance(mode, str) else mode
        if number not in state_names.MODES:
            raise InputError(f"{mode}: expected a mode of operation: {', '.join(MODES)}")
        found = self.get("drive_state", "fault")
        if found["fault"] != "none":
            fault = found["fault"].replace("_", " ")
            raise Refused(f"{self.link.where}: fault {fault}{RESETS}")
        self.set(**parameters, modes_of_operation=number)
        if found["drive_state"] != "operation_enabled":
            for word in (SHUTDOWN, SWITCH_ON, ENABLE):
                self.set(controlword=word)
                self.link.wait(POLL_S)
        self.wait_for(
            lambda s: (
                state_names.drive_state(s["statusword"]) == "operation enabled"
                and to_raw("modes_of_operation_display", s["modes_of_operation_display"]) == number
            ),
            ("statusword", "modes_of_operation_display"),
            f"operation enabled in mode {mode}",
        )

    def disable(self) -> None:
        """Commands the disabled state without waiting for it."""
        self.link.write({"controlword": SHUTDOWN})

    def off(self) -> None:
        """Disables the axis if it is enabled, and waits for the disabled state. Raises Refused,
        NoAnswer."""
        state = state_names.drive_state(self.read("statusword"))
        if state not in (*POWERED, "switched on"):
            return
        self.link.write({"controlword": DISABLE_VOLTAGE if "quick" in state else SHUTDOWN})
        self.wait_for(
            lambda s: state_names.drive_state(s["statusword"]) not in POWERED,
            ("statusword", "fault"),
            "it to be disabled",
            OFF_S,
        )

    def reset_fault(self) -> None:
        """Resets a fault; the axis stays disabled."""
        self.link.write({"controlword": 0})
        self.link.write({"controlword": FAULT_RESET})

    def move(self, position: int | str, timeout_s: float = 20.0) -> dict[str, Any]:
        """Moves to `position` in profile position mode, in user units of the axis or "10 mm", and
        waits until the position is reached: {"statusword", "position", "fault"}. Raises InputError
        for a position beyond a limit; Refused if a limit has changed meanwhile; NoAnswer."""
        self.set(target_position=position, controlword=NEW_SETPOINT)
        wanted = self.read("target_position")
        self.wait_for(lambda s: s["statusword"] & BIT_12, ("statusword",), "the set-point taken")
        self.set(controlword=ENABLE)
        found = self.wait_for(
            lambda s: s["statusword"] & TARGET_REACHED,
            ("statusword", "position"),
            f"position {position} to be reached",
            timeout_s,
        )
        actions.expect_unclipped(self, {"target_position": wanted}, "while it moved")
        return found

    def press(
        self,
        force: float | str,
        seconds: float = 3.0,
        *,
        speed: float | str | None = None,
        approach_s: float = 10.0,
        force_max: float | str | None = None,
        retract: float | str | None = None,
    ) -> actions.PressResult:
        """Approaches, presses for `seconds` from the first contact on, and disables the axis.

        force: "75 N" in mode 4, with the active force law or bank; a number (8-bit counts) in mode
        -1, with the P law. speed: limit of the approach speed, "4 mm/s" or encoder counts per
        second; default: approach_velocity_max. approach_s: after this time without contact, the
        axis stops with the fault no_contact. force_max: a larger measured force disables the axis
        in the same tick; default: twice the force plus 8 counts. retract: distance of a retract()
        at the end. Changed settings are restored.

        Raises InputError before the motion if the axis would limit a value, with the bound in N;
        Refused or NoAnswer with the reason, after the axis has been disabled.
        """
        order = actions.PressOrder(seconds, speed, approach_s, force_max, retract)
        return actions.press(self, quantity.force(force), order)

    def retract(
        self, distance: float | str, speed: float | str | None = None
    ) -> actions.AxisStatus:
        """Moves an axis in contact back by a distance, "5 mm" or in user units, and disables it
        there; returns its state() before that.

        The force is released first. The axis then moves in the opposite direction of the force, or
        away from the workpiece without a force, at most at `speed` (default: approach_velocity_max)
        and within its limits. A measured force above the initial one plus 8 counts disables it.
        Raises InputError, NoAnswer, and Refused if the axis is still in contact at the end.
        """
        return actions.retract(self, distance, speed)

    def arm(self, signals: Sequence[str], samples: int = 0, **settings: Any) -> None:
        """Starts a recording; see capture()."""
        if not 1 <= len(signals) <= 8:
            raise InputError(f"capture: expected 1 to 8 signals, got {len(signals)}")
        for name in signals:
            _known(name)
        wanted = {"length": samples, **settings}
        self.link.arm(signals, {n: to_raw(f"recorder_{n}", v) for n, v in wanted.items()})

    def capture(
        self, signals: Sequence[str], samples: int = 0, timeout_s: float = 30.0, **settings: Any
    ) -> Recording:
        """Records `signals` in each tick and waits for the end; returns a link.Recording.

        samples 0: as many as the recorder can store. `settings` are further objects of the recorder
        without their prefix: decimation=3, pretrigger=100, trigger_edge="rising"; see trigger_on().
        """
        self.arm(signals, samples, **settings)
        return self.link.recording(timeout_s)


def _with_model(link: Link, model: str | Path | None) -> Link:
    if model is not None:
        link.use_model(model)
    return link


def _known(name: str) -> AxisObject:
    known: AxisObject | None = object_named(name)
    if known is None:
        raise InputError(f"{name}: expected the name of an object")
    return known
