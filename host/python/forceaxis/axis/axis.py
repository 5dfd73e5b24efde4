"""Operates one axis over any connection. All values are in engineering units.

with Axis.on("sim:session") as axis:                  # or "can0:5"; acquires the axis
    axis.set(position_gain=4.0, velocity_gain=20.0, force_gain=5.0)
    axis.get("force", "fault")                        # {"force": 0.0, "fault": "none"}
    axis.enable("profile position")
    axis.move(36_000)                                 # or "10 mm"
    axis.press("75 N", seconds=2.0, retract="5 mm")   # then disables the axis
    held = axis.capture(["force", "dac_code"], samples=1500)
                                              # the end of the block releases the axis
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forceaxis._core import InputError
from forceaxis.axis import actions, quantity
from forceaxis.axis import address as addresses
from forceaxis.axis.drive import MODES, Drive, StatusObjects
from forceaxis.axis.link import COMMAND_SOURCES, Link, NoAnswer, Recording, Refused
from forceaxis.axis.quantity import trigger_on
from forceaxis.axis.values import known_object
from forceaxis.bus.client import Value, to_raw
from forceaxis.bus.state_names import POWERED

__all__ = ["MODES", "Axis", "trigger_on"]


@dataclass(frozen=True)
class OwnerObjects(StatusObjects):
    """The statusword of an axis, and the command source that owns the axis."""

    command_source: str


class Axis(Drive):
    """An axis that this program operates over a connection. A `with` block acquires the axis. At
    its end, close() disables and releases the axis."""

    def __init__(self, link: Link) -> None:
        super().__init__(link)
        self._owned = False

    @classmethod
    def on(cls, address: str, model: str | Path | None = None) -> Axis:
        """Returns the axis at an address. Examples of an address are "can0:5",
        "tcp://192.168.1.5/3", "serial:/dev/ttyUSB0:3", "lcm:2" and "sim:contact". `model`: see
        Axis.can(). Raises InputError, NoAnswer."""
        return cls(_with_model(addresses.parse(address).link(), model))

    @classmethod
    def sim(cls, experiment: str | Path, overrides: Sequence[str] = (), store: str = "") -> Axis:
        """Returns a simulated axis. An experiment describes the axis, which runs in simulated time.
        Raises InputError. Prints a warning if `force_scale` of the axis differs from the scale of
        the force sensor in the model."""
        from forceaxis.axis.sim import SimLink

        link = SimLink(experiment, overrides, store)
        if link.warning:
            warnings.warn(link.warning, stacklevel=2)
        return cls(link)

    @classmethod
    def can(cls, interface: str = "can0", node: int = 1, model: str | Path | None = None) -> Axis:
        """Returns the axis with a node id on a CAN interface. `model`: path of a model of the axis,
        or None. The encoder in the model defines the size of an encoder count in mm. Raises
        InputError, NoAnswer."""
        from forceaxis.axis.can import CanLink

        return cls(_with_model(CanLink(interface, node), model))

    @classmethod
    def gateway(
        cls, axis: int = 1, url: str | None = None, model: str | Path | None = None
    ) -> Axis:
        """Returns an axis at the gateway of an LCM bus. `url`: URL of the LCM bus, or None for the
        default URL of LCM. `model`: see Axis.can(). Raises InputError."""
        from forceaxis.axis.gateway import GatewayLink

        return cls(_with_model(GatewayLink(axis, url), model))

    @classmethod
    def modbus(cls, url: str, unit: int = 1, model: str | Path | None = None) -> Axis:
        """Returns the axis with a Modbus unit number at `url`, which is "tcp://HOST[:PORT]" or
        "/dev/ttyX[:BAUD]". `model`: see Axis.can(). Raises InputError, NoAnswer."""
        from forceaxis.axis.modbus import ModbusLink

        return cls(_with_model(ModbusLink(url, unit), model))

    def __enter__(self) -> Axis:
        self.acquire()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def acquire(self, shared: bool = False) -> None:
        """Acquires the axis. Raises Refused if another client has enabled the axis. `shared`: True
        permits an axis that another client on the same bus has enabled. The other client then stays
        the owner, this program may write to the axis, and close() does not disable the axis."""
        now = self.record(OwnerObjects)
        if now.state in POWERED:
            is_this_bus = now.command_source == COMMAND_SOURCES[self.link.source]
            if is_this_bus and shared:
                return
            whose = (
                "another client of this bus"
                if is_this_bus
                else f"the client that owns it, {now.command_source}"
            )
            raise Refused(
                f"{self.link.where}: the axis is {now.state} by {whose}; end that client, or stop "
                "the axis with `axis.stop()`"
            )
        self.link.acquire()
        self._owned = True

    def close(self) -> str:
        """Disables and releases the axis if this program owns it. Always ends the connection, also
        after an error. Returns a text that says whether the axis was disabled."""
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

    def stop(self) -> actions.AxisStatus:
        """Stops the axis by a quick stop, even if another client owns the axis. Waits until the
        axis is disabled, or at standstill if `quick_stop_option` keeps the axis enabled. Returns
        the state of the axis. Raises NoAnswer, Refused."""
        return actions.stop(self)

    def start(self) -> None:
        """Starts a CANopen node that an NMT command has stopped, so that the node answers again.
        Does not enable the drive. Raises NoAnswer. Over Modbus, which has no NMT, raises
        Refused."""
        self.link.start()

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
        """Approaches the workpiece, presses for `seconds` from the first contact on, and disables
        the axis.

        force: "75 N" in mode 4, with the active force law or bank; a number (8-bit counts) in mode
        -1, with the P law. speed: limit of the approach speed, "4 mm/s" or encoder counts per
        second; default: approach_velocity_max. approach_s: after this time without contact, the
        axis stops with the fault no_contact. force_max: a larger measured force disables the axis
        in the same tick; default: twice the force plus 8 counts. retract: distance of a retract()
        at the end. Changed settings are restored.

        Raises InputError before the motion if the axis would limit a value; the error text states
        the bound in N. If the press fails, disables the axis and raises Refused or NoAnswer with
        the reason.
        """
        order = actions.PressOrder(seconds, speed, approach_s, force_max, retract)
        return actions.press(self, quantity.force(force), order)

    def retract(
        self, distance: float | str, speed: float | str | None = None
    ) -> actions.AxisStatus:
        """Moves the axis back from a contact and then disables the axis. `distance`: a text such as
        "5 mm", or a number in user units. Returns the last state of the axis before it was
        disabled.

        The axis first lowers its target force to 0. From there it moves by `distance` in the
        opposite direction of the measured force; if no force is measured, it moves away from the
        workpiece. The speed is at most `speed` (default: approach_velocity_max), and the motion
        stays within the limits of the axis. If the measured force exceeds its initial value by more
        than 8 counts, the axis disables itself. Raises InputError and NoAnswer, and Refused if the
        axis is still in contact at the end.
        """
        return actions.retract(self, distance, speed)

    def arm(self, signals: Sequence[str], samples: int = 0, **settings: Value) -> None:
        """Starts a recording of signals and does not wait for its end. The arguments are the same
        as for capture()."""
        if not 1 <= len(signals) <= 8:
            raise InputError(f"capture: expected 1 to 8 signals, got {len(signals)}")
        for name in signals:
            known_object(name)
        wanted = {"length": samples, **settings}
        self.link.arm(signals, {n: to_raw(f"recorder_{n}", v) for n, v in wanted.items()})

    def capture(
        self, signals: Sequence[str], samples: int = 0, timeout_s: float = 30.0, **settings: Value
    ) -> Recording:
        """Records `signals` in each tick and waits for the end of the recording. Returns a
        link.Recording.

        `samples`: number of samples; 0 means as many as the recorder can store. `settings`: values
        of further objects of the recorder, named without the prefix `recorder_`, such as
        decimation=3, pretrigger=100 or trigger_edge="rising"; see trigger_on().
        """
        self.arm(signals, samples, **settings)
        return self.link.recording(timeout_s)


def _with_model(link: Link, model: str | Path | None) -> Link:
    if model is not None:
        link.use_model(model)
    return link
