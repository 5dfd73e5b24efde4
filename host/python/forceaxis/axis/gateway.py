"""Access to an axis that a gateway serves on LCM."""

import contextlib
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TypeVar

from forceaxis.axis.drive import ENABLE, FAULT_RESET
from forceaxis.axis.link import (
    COMMAND_SOURCES,
    DEVICE_NAME_INDEX,
    VERSION_INDEX,
    Link,
    NoAnswer,
    Recording,
    Refused,
    unsigned,
)
from forceaxis.bus import state_names
from forceaxis.bus.client import AxisClient
from forceaxis.bus.keeper import GatewayKeeper
from forceaxis.objects import BY_NAME

T = TypeVar("T")
READY_S = 10.0
# Longest time in s until the gateway, which polls the axis, detects the end of a recording.
RECORDING_END_MAX_S = 2.0
RETRY_PERIOD_S = 0.1  # time in s between two attempts to send a command that the gateway refuses
# These words occur in texts with which the gateway (commands.cpp) refuses a command.
NOT_SET_UP_TEXT = "not set up yet"
RECORDER_BUSY_TEXT = "another recording is in progress"
PRODUCT, REVISION = "product_code", "revision_number"
DEVICE = "forceaxis"  # device name (object 1008h) of every axis with the product code of forceaxis
OBJECTS_PER_COMMAND = 64  # largest number of objects in one command to the gateway
# Objects whose names begin with these texts are set by a gateway for its own use.
MANAGED_PREFIXES = ("tpdo_", "consumer_heartbeat_", "producer_heartbeat_time")


class GatewayLink(Link):
    """Connection to an axis, with a number from 1 to 127, at the gateway of an LCM bus. `client`:
    an existing client, which close() does not close. `ready_s`: longest time in s until the gateway
    has set up the axis and the axis is operational. Raises InputError."""

    source = COMMAND_SOURCES.index("lcm")

    def __init__(
        self,
        axis: int = 1,
        url: str | None = None,
        timeout_s: float = 2.0,
        client: AxisClient | None = None,
        ready_s: float = READY_S,
    ) -> None:
        self.client = client or AxisClient(axis, url, timeout_s)
        self._closes, self._ready_s = client is None, ready_s
        self.where = f"axis {axis} at the gateway"
        self._axis, self._url = axis, url
        # identification number of the LCM command that started the latest recording
        self._armed = 0

    def manages(self, name: str) -> bool:
        return name.startswith(MANAGED_PREFIXES)

    def read(self, names: Iterable[str]) -> dict[str, int]:
        found: dict[str, int] = {}
        names = list(names)
        for i in range(0, len(names), OBJECTS_PER_COMMAND):
            part = names[i : i + OBJECTS_PER_COMMAND]
            found |= self._when_set_up(partial(self.client.read_raw, part))
        return {name: unsigned(name, raw) for name, raw in found.items()}

    def text(self, index: int) -> str | None:
        """Returns the device name or a version of the axis as text. LCM transmits no texts, so the
        function makes this text from the numbers in object 1018h."""
        found = self._when_set_up(partial(self.client.read_raw, [PRODUCT, REVISION]))
        if index == DEVICE_NAME_INDEX:
            return DEVICE if found[PRODUCT] == BY_NAME[PRODUCT].default else None
        return (
            f"{found[REVISION] >> 16}.{found[REVISION] & 0xFFFF}"
            if index == VERSION_INDEX
            else None
        )

    def write(self, values: Mapping[str, int]) -> None:
        command = partial(self.client.write_raw, values)
        with self.unfed(values):
            # The gateway has set up an acquired axis.
            # If an acquired axis is no longer set up, it has restarted.
            # A late command must not reach a restarted axis, because the command may move it.
            # A stop command does not wait, because the user must know at once if it is refused.
            if self._keeper or _only_stops(values):
                command()
            else:
                self._when_set_up(command)

    def start(self) -> None:
        """Waits until the gateway has started the CANopen node of the axis. The gateway starts
        every node without a command."""
        end = time.monotonic() + self._ready_s
        while True:
            state = self.client.state(max(end - time.monotonic(), RETRY_PERIOD_S))
            ready = state.nmt_state == state.NMT_OPERATIONAL
            if ready and state.statusword != state.NOT_AVAILABLE:
                break
            if time.monotonic() > end:
                raise NoAnswer(
                    f"{self.where}: expected a node in the NMT state operational within "
                    f"{self._ready_s:g} s, got the state {state_names.node_state(state.nmt_state)}"
                )

    def acquire(self) -> None:
        self.start()
        self._when_set_up(self.client.take)
        self._keeper = GatewayKeeper(self._axis, self._url)

    def _when_set_up(self, command: Callable[[], T]) -> T:
        """Sends a command by calling command(), and returns its result. The gateway refuses
        commands while it sets up an axis that has just appeared on the bus. In this case, the
        command is sent again for at most `ready_s` seconds."""
        end = time.monotonic() + self._ready_s
        while True:
            try:
                return command()
            except Refused as refusal:
                if NOT_SET_UP_TEXT not in str(refusal):
                    raise
                if time.monotonic() > end:
                    raise NoAnswer(f"{self.where}: {refusal}") from None
            time.sleep(RETRY_PERIOD_S)

    def release(self) -> None:
        self._end_keeper()
        self.client.release()

    def arm(self, signals: Sequence[str], settings: Mapping[str, int]) -> None:
        wanted = {"decimation": 1, "pretrigger": 0, "trigger_edge": 0, **settings}
        samples = wanted.pop("length", 0)
        end = time.monotonic() + RECORDING_END_MAX_S
        while True:
            try:
                self._armed = self.client.arm(list(signals), samples, **wanted)
                return
            # The recorder of the axis still contains the finished recording of another client.
            except Refused as refusal:
                if RECORDER_BUSY_TEXT not in str(refusal) or time.monotonic() > end:
                    raise
            self.client.write_raw({"recorder_arm": 0})
            time.sleep(RETRY_PERIOD_S)

    def fetch(self, signals: Sequence[str]) -> None:
        self._armed = self.client.fetch(list(signals))

    def recording(self, timeout_s: float) -> Recording:
        held = self.client.captured(self._armed, timeout_s)
        if not held.complete:
            raise NoAnswer(
                f"{self.where}: {held.missing} of {held.total} samples were lost on the way; "
                "record again"
            )
        # If CANopen owns the axis, the gateway has already made the recorder idle.
        # If a client on another bus owns the axis, only that client can make the recorder idle.
        # If the axis refuses this write, the samples are valid nevertheless.
        with contextlib.suppress(Refused):
            self.client.write_raw({"recorder_arm": 0})
        return Recording(held.signals, held.raw, held.decimation, held.trigger_sample)

    def close(self) -> None:
        self._end_keeper()
        if self._closes:
            self.client.close()


def _only_stops(values: Mapping[str, int]) -> bool:
    """Returns True for a write that can only stop the axis. The gateway carries it out even while
    it sets up the axis."""
    raw = values.get("controlword", ENABLE)
    return len(values) == 1 and raw & ENABLE != ENABLE and not raw & FAULT_RESET
