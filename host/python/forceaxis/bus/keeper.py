"""Keeping an axis while its owner does something else."""

import threading

from forceaxis.bus.client import AxisClient, NoAnswer, Refused

PERIOD_S = 0.2


class Keeper:
    """Calls feed(), which returns the seconds until the next call, in a thread of its own until
    close(). A refusal or a missing answer ends nothing: the owner notices it by itself."""

    def __init__(self, feed):
        self._feed, self._stop = feed, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name="keeper")
        self._thread.start()

    def _run(self):
        pause_s = 0.0
        while not self._stop.wait(pause_s):
            try:
                pause_s = self._feed()
            except (Refused, NoAnswer):
                pause_s = PERIOD_S

    def close(self):
        self._stop.set()
        self._thread.join()


class WatchdogKeeper(Keeper):
    """Feeds the watchdog by writing its own value several times within it; only writes of the owner
    count, so an axis that another client acquired stays with that one.

    read() gives the watchdog in ms, write(ms) writes it, both in this thread. Who changes the
    watchdog meanwhile holds `unchanged`, locked from reading it to writing it again.
    """

    def __init__(self, read, write):
        self.unchanged = threading.Lock()
        self._read, self._write = read, write
        super().__init__(self._rewrite)

    def _rewrite(self):
        with self.unchanged:
            watchdog_ms = self._read()
            self._write(watchdog_ms)
        return min(PERIOD_S, watchdog_ms / 4000)


class GatewayKeeper(WatchdogKeeper):
    """For an axis behind a gateway, with a client of its own, so that it also runs while the
    owner's waits for a capture."""

    def __init__(self, axis, url):
        self._client = AxisClient(axis, url)
        super().__init__(
            lambda: self._client.read("watchdog"),
            lambda value: self._client.write("watchdog", value),
        )

    def close(self):
        super().close()
        self._client.close()
