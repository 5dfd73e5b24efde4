"""A session of a program with one axis through the gateway: acquire, move, record, release.

    from forceaxis.gateway import Session

    # waits until the axis is available, and acquires it
    with Session(1) as axis:
        axis.write_all({"position_gain": 4.0, "velocity_gain": 20.0, "force_gain": 5.0})
        axis.home()                                # here is position 0
        axis.enable("profile position")
        axis.move(36_000)
        axis.enable("force counts", force_setpoint=30.0)
        axis.wait_contact()
        held = axis.capture(["force", "dac_code"], samples=1500)
                                                   # at the end: disabled and released

It has all of AxisClient too (read, write, capture, wait_event, state). A refused command raises
Refused with the reason, a wait that times out NoAnswer.
"""

import contextlib
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from forceaxis.axis import bounds
from forceaxis.axis.drive import ENABLE, START_HOMING, Drive
from forceaxis.axis.gateway import READY_S, GatewayLink
from forceaxis.bus import state_names
from forceaxis.bus.client import AxisClient, NoAnswer, Refused, Value
from forceaxis.bus.messages import axis_event_t, axis_state_t
from forceaxis.objects import mask

HOMING_ATTAINED, HOMING_ERROR = mask("statusword", "attained"), mask("statusword", "homing_error")
STATES_KEPT = 30_000  # number of stored states: ten minutes at 50 states per second


class Session(AxisClient):
    """An axis that this program owns until the session is closed."""

    def __init__(
        self,
        axis: int = 1,
        url: str | None = None,
        timeout_s: float = 2.0,
        wait_s: float = READY_S,
    ) -> None:
        # Client that receives states of the axis until the first state of the bus thread.
        self._states: deque[axis_state_t] = deque(maxlen=STATES_KEPT)
        self._is_closed = False
        super().__init__(axis, url, timeout_s)
        self._link = GatewayLink(axis, url, client=self, ready_s=wait_s)
        self._drive = Drive(self._link)
        try:
            self._link.acquire()
        except BaseException:
            super().close()
            raise

    def write_all(self, values: Mapping[str, Value]) -> axis_event_t:
        """Writes objects as AxisClient does, with two differences. The thread that repeatedly
        writes the watchdog does not overwrite a new watchdog value, and a target that the axis
        would limit raises InputError (axis/bounds). A write is not repeated while the gateway sets
        up the axis again: the axis has restarted, and a late command could move it."""
        bounds.expect(self._drive, values)
        with self._link.unfed(values):
            return super().write_all(values)

    def close(self) -> None:
        """Disables and releases the axis, unless the axis no longer answers. A session that is
        closed already stays closed."""
        if self._is_closed:
            return
        self._is_closed = True
        # The axis cannot be released if another client owns it or if it does not answer.
        with contextlib.suppress(Refused, NoAnswer):
            self._drive.off()
            self._link.release()
        self._link.close()
        super().close()

    @property
    def states(self) -> list[axis_state_t]:
        """Returns the received states of the axis (`axis_state_t`) in order. At most the latest
        STATES_KEPT states are stored."""
        with self._news:
            return list(self._states)

    def _take(self, channel: str, data: bytes, wall_us: int) -> None:
        super()._take(channel, data, wall_us)
        with self._news:
            state = self._state
            if state is not None and (not self._states or self._states[-1] is not state):
                self._states.append(state)

    def wait_for(
        self, holds: Callable[[axis_state_t], bool | int], what: str, timeout_s: float = 5.0
    ) -> axis_state_t:
        """Waits for the first state of the axis for which holds(state) is True, and returns this
        state. States of a silent axis, which have its last values, do not count. Raises NoAnswer,
        which contains `what`, if no such state arrives within timeout_s."""
        end = time.monotonic() + timeout_s
        state: axis_state_t | None = None
        is_silent = False
        while (remaining := end - time.monotonic()) > 0:
            try:
                state = self.state(remaining)
            except NoAnswer:
                break
            age_us = state.age_us if state.age_us != state.NOT_AVAILABLE else 0
            is_silent = state_names.is_silent(state.nmt_state, age_us / 1e6)
            if not is_silent and holds(state):
                return state
        reason = self._bus.trouble or f"nothing was received on {self._bus.url}"
        if state is not None and is_silent:
            reason = f"the axis is silent, its node is {state_names.node_state(state.nmt_state)}"
        elif state is not None:
            fault = state_names.enum("fault", state.fault)
            reason = (
                f"{state_names.condition(state.statusword, fault)}, "
                f"mode {state_names.mode(state.mode_display)}, "
                f"position {state.position_cnt}, force {state.force_cnt_q8 / 256:g}"
            )
        raise NoAnswer(f"axis {self.axis}: expected {what} within {timeout_s:g} s, {reason}")

    def enable(self, mode: str | int, **parameters: Value) -> None:
        """Enables the axis in a mode of operation; see Axis.enable()."""
        self._drive.enable(mode, **parameters)

    def disable(self) -> None:
        self._drive.disable()

    def reset_fault(self) -> None:
        self._drive.reset_fault()

    def home(self, position: int = 0) -> None:
        """Homes the axis at the present position, which becomes `position` in encoder counts."""
        self.enable("homing", homing_method=37, home_offset=position)
        self.write("controlword", START_HOMING)
        state = self.wait_for(
            lambda s: s.statusword & (HOMING_ATTAINED | HOMING_ERROR), "to be homed"
        )
        if state.statusword & HOMING_ERROR:
            raise NoAnswer(f"axis {self.axis}: homing failed")
        self.write("controlword", ENABLE)

    def move(self, position: int | str, timeout_s: float = 20.0) -> axis_state_t:
        """Moves the axis to `position`, in encoder counts, in profile position mode. Waits until
        the axis has reached the position and returns the next axis_state_t."""
        self._drive.move(position, timeout_s)
        state: axis_state_t = self.state()
        return state

    def wait_contact(
        self,
        force_cnt: float | None = None,
        within_cnt: float = 5.0,
        held_s: float = 0.3,
        timeout_s: float = 10.0,
    ) -> axis_state_t:
        """Waits until the axis is in contact with a force of `force_cnt`, with a tolerance of
        `within_cnt`, for `held_s` seconds.

        Forces are in 8-bit counts; without `force_cnt` any force counts as contact.
        """
        since: int | None = None

        def held(s: axis_state_t) -> bool:
            nonlocal since
            near = force_cnt is None or abs(s.force_cnt_q8 / 256 - force_cnt) <= within_cnt
            if s.contact != 1 or not near:
                since = None
                return False
            since = since or s.wall_utime
            return bool(s.wall_utime - since >= held_s * 1e6)

        return self.wait_for(held, "a steady contact", timeout_s)


def seconds(states: Sequence[axis_state_t]) -> tuple[list[axis_state_t], list[float]]:
    """Returns the states of the axis whose firmware time is available, and the times of these
    states in s from the first such state."""
    known = [s for s in states if s.utime != axis_state_t.NOT_AVAILABLE]
    start = known[0].utime if known else 0
    return known, [(s.utime - start) / 1e6 for s in known]
