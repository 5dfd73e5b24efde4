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
# CiA 402: controlwords, and bits of the statusword.
SHUTDOWN, SWITCH_ON, ENABLE, NEW_SETPOINT = 0x06, 0x07, 0x0F, 0x1F
START_HOMING, FAULT_RESET = 0x1F, 0x80
DISABLE_VOLTAGE = 0  # the one way out of a quick stop that stays
TARGET_REACHED, BIT_12, HOMING_ERROR = 1 << 10, 1 << 12, 1 << 13
POLL_S = 0.02
# The end of an error of an axis that has a fault. A verb prints its command for the function.
RESETS = "; reset_fault() resets the fault"
OFF_S = 2.0  # from the controlword to a disabled axis; a slow-down on a stop takes its time
ABOUT = ("statusword", "modes_of_operation_display", "fault", "position", "force")


class Axis:
    """An axis, owned from __enter__ to close(), where it is disabled and released."""

    def __init__(self, link: Link) -> None:
        self.link, self._owned = link, False

    @classmethod
    def sim(cls, experiment: str | Path, overrides: Sequence[str] = (), store: str = "") -> Axis:
        """The axis of an experiment in process, in its own time. Raises InputError; warns where its
        newtons are not those of its model."""
        from forceaxis.axis.sim import SimLink

        link = SimLink(experiment, overrides, store)
        if link.warning:
            warnings.warn(link.warning, stacklevel=2)
        return cls(link)

    @classmethod
    def can(cls, interface: str = "can0", node: int = 1, model: str | Path | None = None) -> Axis:
        """A node of a CAN interface. model: a file whose encoder says what a count is in mm. Raises
        InputError, NoAnswer."""
        from forceaxis.axis.can import CanLink

        return cls(_with_model(CanLink(interface, node), model))

    @classmethod
    def gateway(
        cls, axis: int = 1, url: str | None = None, model: str | Path | None = None
    ) -> Axis:
        """An axis at the gateway of an LCM bus; None: LCM's default. model: as of can(). Raises
        InputError."""
        from forceaxis.axis.gateway import GatewayLink

        return cls(_with_model(GatewayLink(axis, url), model))

    @classmethod
    def modbus(cls, url: str, unit: int = 1, model: str | Path | None = None) -> Axis:
        """A unit at "tcp://HOST[:PORT]" or "/dev/ttyX[:BAUD]". model: as of can(). Raises
        InputError, NoAnswer."""
        from forceaxis.axis.modbus import ModbusLink

        return cls(_with_model(ModbusLink(url, unit), model))

    def __enter__(self) -> Axis:
        self.acquire()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def acquire(self, shared: bool = False) -> None:
        """Owns the axis. One that another client has enabled is refused (Refused); shared: if that
        is one of the same bus, the axis stays its own, is written to, and not disabled at close().
        """
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
        """Disables and releases an owned axis, and ends the connection, whatever happened. What
        came of it, in words."""
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
        """{name: engineering value or enum text}, in the order of `names`. Raises InputError for an
        unknown name."""
        for name in names:
            _known(name)
        found = self.link.read(names)
        return {name: from_raw(name, found[name]) for name in names}

    def read(self, name: str) -> Any:
        """The value of one object, as get()."""
        return self.get(name)[name]

    def set(self, **values: Any) -> None:
        """Writes engineering values, enum texts or quantities ("75 N", "10 mm/s") in order. Nothing
        is written if the object table has no such name, value or way to write it, or if the axis
        would clip a target (InputError; see bounds)."""
        for name in values:
            if _known(name).access == "ro":
                raise InputError(f"{name}: expected an object that can be written, it is read-only")
        raw = quantity.all_raw(self, values)
        bounds.expect(self, {name: from_raw(name, value) for name, value in raw.items()})
        self.link.write(raw)

    def put_back(self, **values: Any) -> None:
        """Writes engineering values that the axis had before, or lower ones on the way to 0: as
        set(), but bounds are not asked, so that a bound that moved meanwhile keeps nothing set."""
        self.link.write({name: to_raw(name, value) for name, value in values.items()})

    def wait_for(
        self,
        holds: Callable[[dict[str, Any]], Any],
        names: Sequence[str],
        what: str,
        timeout_s: float = 5.0,
    ) -> dict[str, Any]:
        """Reads `names` until holds({name: value}), of the axis' own time: those values. NoAnswer
        names `what` when that does not come, or a fault that was not asked for comes instead, and
        what the axis does."""
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
        """What the axis does, in words."""
        found = self.link.read(ABOUT)
        return (
            f"{state_names.condition(found['statusword'], found['fault'])}, "
            f"mode {state_names.mode(found['modes_of_operation_display'])}, "
            f"position {found['position']} encoder counts, "
            f"force {from_raw('force', found['force']):g} force counts"
        )

    def enable(self, mode: str | int, **parameters: Any) -> None:
        """Operation enabled in a mode of operation, by its name (state_names.MODES) or number;
        `parameters` are written before the mode changes."""
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
        """Switches the amplifier off without waiting."""
        self.link.write({"controlword": SHUTDOWN})

    def off(self) -> None:
        """Disables the axis if it is enabled, and waits until it is not. Raises Refused,
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
        """Acknowledges a fault; the axis stays disabled."""
        self.link.write({"controlword": 0})
        self.link.write({"controlword": FAULT_RESET})

    def move(self, position: int | str, timeout_s: float = 20.0) -> dict[str, Any]:
        """Profile position mode: moves to `position`, in the axis' own units or "10 mm", and waits
        until it is reached: {"statusword", "position", "fault"}. Raises InputError for a place
        beyond its limits; Refused where a limit was moved meanwhile; NoAnswer."""
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
        """Approaches, presses for `seconds` from the contact on, and disables the axis.

        force: "75 N" in mode 4 by the force law or bank in force; a number, counts of an 8-bit
        reading, in mode -1 by the P law. speed: of the approach, "4 mm/s" or encoder counts a
        second, at most; default: approach_velocity_max. approach_s: without contact for so long it
        is the fault no_contact. force_max: a reading beyond it disables the axis in the same tick;
        default: twice the force and 8 counts. retract: see retract(), at the end. What is set for
        it is put back.

        Raises InputError before anything moves for what the axis would clip, with the bound in N;
        Refused, NoAnswer with what happened, the axis disabled.
        """
        order = actions.PressOrder(seconds, speed, approach_s, force_max, retract)
        return actions.press(self, quantity.force(force), order)

    def retract(
        self, distance: float | str, speed: float | str | None = None
    ) -> actions.AxisStatus:
        """Moves an axis that presses, or stands in contact, back by a distance, "5 mm" or in its
        own units, and disables it there: its state() before that.

        The force is released first; the way is against the force, or away from the workpiece where
        there is none, at most at `speed` (default: approach_velocity_max), within its limits, and a
        reading beyond that of its start and 8 counts disables it. Raises InputError, NoAnswer;
        Refused where it still touches afterwards.
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
        """Records `signals` tick by tick and waits: a link.Recording.

        samples 0: as many as the recorder holds. `settings` are further recorder objects without
        the prefix: decimation=3, pretrigger=100, trigger_edge="rising"; see trigger_on().
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
