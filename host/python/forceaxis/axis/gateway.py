"""An axis behind a gateway, over LCM."""

import contextlib
import time

from forceaxis.axis.link import Link, NoAnswer, Recording, Refused, unsigned
from forceaxis.bus import state_names
from forceaxis.bus.client import AxisClient
from forceaxis.bus.keeper import GatewayKeeper

READY_S = 10.0
STOPPED_S = 2.0  # a stopped recording is noticed by the gateway within its poll
NOT_YET = "not set up yet"  # the gateway's words
AT_ONCE = 64  # objects of one command
MANAGED = ("tpdo_", "consumer_heartbeat_", "producer_heartbeat_time")  # set up by each gateway


class GatewayLink(Link):
    """Axis 1 to 127 at the gateway of an LCM bus; its default is LCM's. Raises InputError."""

    source = state_names.BY_NAME["command_source"].enum.index("lcm")

    def __init__(self, axis=1, url=None, timeout_s=2.0):
        self.client = AxisClient(axis, url, timeout_s)
        self.where = f"axis {axis} at the gateway"
        self._axis, self._url, self._keeper, self._armed = axis, url, None, None

    def manages(self, name):
        return name.startswith(MANAGED)

    def read(self, names):
        found = {}
        names = list(names)
        for i in range(0, len(names), AT_ONCE):
            found |= self.client.read_raw(names[i : i + AT_ONCE])
        return {name: unsigned(name, raw) for name, raw in found.items()}

    def write(self, values):
        keeps = self._keeper and "watchdog" in values
        with self._keeper.unchanged if keeps else contextlib.nullcontext():
            self.client.write_raw(values)

    def acquire(self):
        end = time.monotonic() + READY_S
        while True:
            state = self.client.state()
            ready = state.nmt_state == state.NMT_OPERATIONAL
            try:
                if ready and state.statusword != state.NOT_AVAILABLE:
                    self.client.take()
                    break
            except Refused as refusal:  # operational, but not yet by this gateway
                if NOT_YET not in str(refusal) or time.monotonic() > end:
                    raise
                time.sleep(0.1)
            if time.monotonic() > end:
                raise NoAnswer(
                    f"{self.where}: expected it operational within {READY_S:g} s, it is "
                    f"{state_names.node_state(state.nmt_state)}"
                )
        self._keeper = GatewayKeeper(self._axis, self._url)

    def release(self):
        self._end_keeper()
        self.client.release()

    def arm(self, signals, settings):
        wanted = {"decimation": 1, "pretrigger": 0, "trigger_edge": 0, **settings}
        samples = wanted.pop("length", 0)
        end = time.monotonic() + STOPPED_S
        while True:
            try:
                self._armed = self.client.arm(list(signals), samples, **wanted)
                return
            except Refused as refusal:  # a capture of a client that is gone
                if "another capture" not in str(refusal) or time.monotonic() > end:
                    raise
            self.client.write_raw({"recorder_arm": 0})
            time.sleep(0.1)

    def fetch(self, signals):
        self._armed = self.client.fetch(list(signals))

    def recording(self, timeout_s):
        held = self.client.captured(self._armed, timeout_s)
        if not held.complete:
            raise NoAnswer(
                f"{self.where}: {held.missing} of {held.total} samples were lost on the way; "
                "record again"
            )
        self.client.write_raw({"recorder_arm": 0})
        return Recording(held.signals, held.raw, held.decimation, held.trigger_sample)

    def close(self):
        self._end_keeper()
        self.client.close()

    def _end_keeper(self):
        if self._keeper:
            self._keeper.close()
            self._keeper = None
