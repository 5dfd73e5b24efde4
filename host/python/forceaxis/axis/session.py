"""A session of a program with one axis through the gateway: acquire, move, record, release.

    from forceaxis.gateway import Session

    # Session(1) waits until axis 1 is available, and acquires it.
    with Session(1) as axis:
        axis.write_all({"position_gain": 4.0, "velocity_gain": 20.0, "force_gain": 5.0})
        axis.home()                                # the present position becomes 0
        axis.enable("profile position")
        axis.move(36_000)
        axis.enable("force counts", force_setpoint=30.0)
        axis.wait_contact()
        held = axis.capture(["force", "dac_code"], samples=1500)
                                                   # the end of the block disables and releases it

A Session also has all methods of AxisClient (read, write, capture, wait_event, state). If the axis
refuses a command, the method raises Refused with the reason. If the time limit of a wait expires,
the method raises NoAnswer.
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
# largest number of stored states of the axis: ten minutes at 50 states per second
STATES_KEPT = 30_000


class Session(AxisClient):
    """An axis that this program owns until the session is closed."""

    def __init__(
        self,
        axis: int = 1,
        url: str | None = None,
        timeout_s: float = 2.0,
        wait_s: float = READY_S,
    ) -> None:
        # The latest states of the axis, in the order of their reception.
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
        """Writes objects as AxisClient does, with two differences. First, the thread that
        repeatedly writes the watchdog does not overwrite a new value of the object `watchdog`.
        Second, a target that the axis would limit raises InputError (see forceaxis.axis.bounds). If
        the gateway has to set up the axis again, the write is not repeated. The axis has restarted
        in this case, and a late command could move it."""
        bounds.expect(self._drive, values)
        with self._link.unfed(values):
            return super().write_all(values)

    def close(self) -> None:
        """Disables and releases the axis, unless the axis no longer answers. A second call has no
        effect."""
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
        state. The gateway goes on publishing the last values of an axis that no longer sends; such
        states are ignored. Raises NoAnswer after `timeout_s`, with `what` in the error text."""
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
        """Enables the axis in a mode of operation. The arguments are the same as for
        Axis.enable()."""
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
        the axis has reached the position. Returns the first axis_state_t after that."""
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
        """Waits until the axis has been in steady contact for `held_s` seconds.

        During this time, the measured force must differ from `force_cnt` by at most `within_cnt`.
        Both are in 8-bit counts. If `force_cnt` is None, every force is accepted.
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
    """Returns all received states that contain the time of the firmware. Also returns the time of
    each of these states in s, counted from the first of them."""
    known = [s for s in states if s.utime != axis_state_t.NOT_AVAILABLE]
    start = known[0].utime if known else 0
    return known, [(s.utime - start) / 1e6 for s in known]
