"""Threads that keep an axis enabled. They repeatedly write the watchdog of the axis, or send the
heartbeat that the axis monitors."""

import contextlib
import socket
import struct
import threading
from collections.abc import Callable

from forceaxis.bus.client import AxisClient, NoAnswer, Refused

KEEP_PERIOD_S = 0.2


class Keeper:
    """A thread that calls feed() repeatedly until close(). feed() returns the time in s until the
    next call.

    A write that is refused or not answered does not end the thread. The owner of the axis sees this
    error in its other accesses.
    """

    def __init__(self, feed: Callable[[], float]) -> None:
        self._feed, self._stop = feed, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name="keeper")
        self._thread.start()

    def _run(self) -> None:
        pause_s = 0.0
        while not self._stop.wait(pause_s):
            try:
                pause_s = self._feed()
            except (Refused, NoAnswer):
                pause_s = KEEP_PERIOD_S

    def close(self) -> None:
        self._stop.set()
        self._thread.join()


class HeartbeatKeeper(Keeper):
    """Sends a CANopen heartbeat every `period_s` seconds. The heartbeat is a CAN frame with the
    identifier `can_id` and one byte. The constructor starts the heartbeat.

    On a CAN interface, the kernel sends the heartbeat (broadcast manager of SocketCAN). The kernel
    goes on for BRIDGED_S after the last command of this thread, because other threads may delay
    this thread. The heartbeat ends with the process. If the kernel cannot send it, the thread calls
    send(data).
    """

    BRIDGED_S = 2.0

    def __init__(
        self,
        interface: str | None,
        can_id: int,
        data: bytes,
        period_s: float,
        send: Callable[[bytes], None],
    ) -> None:
        self._period_s = period_s
        self._socket: socket.socket | None = None
        self._send: Callable[[], int | None] = lambda: send(data)
        with contextlib.suppress(OSError):
            self._socket = kernel = _broadcast_manager(interface)
            repeated = round(self.BRIDGED_S / period_s)
            job = _job(can_id, data, repeated, round(period_s * 1e6))
            self._send = lambda: kernel.send(job)
        self._beat()
        super().__init__(self._beat)

    def _beat(self) -> float:
        try:
            self._send()
        except OSError as error:
            raise NoAnswer(f"expected to send a heartbeat, {error}") from None
        return self._period_s

    def close(self) -> None:
        super().close()
        if self._socket:
            self._socket.close()


def _broadcast_manager(interface: str | None) -> socket.socket:
    """Returns a socket by which a program lets the kernel send cyclic frames. Raises OSError if the
    kernel or the interface does not support cyclic frames."""
    if interface is None:
        raise OSError
    made = socket.socket(socket.PF_CAN, socket.SOCK_DGRAM, socket.CAN_BCM)
    try:
        made.connect((interface,))
    except OSError:
        made.close()
        raise
    return made


def _job(can_id: int, data: bytes, count: int, period_us: int) -> bytes:
    """Returns the bytes of a command to the kernel (linux/can/bcm.h). The kernel then sends a frame
    `count` times with the period `period_us`, and sends the first frame immediately."""
    set_and_start = socket.CAN_BCM_SETTIMER | socket.CAN_BCM_STARTTIMER
    head = (socket.CAN_BCM_TX_SETUP, set_and_start, count, 0, period_us, 0, 0, can_id, 1)
    frame = struct.pack("=IB3x8s", can_id, len(data), data.ljust(8, b"\0"))
    return struct.pack("@3I4l2I0q", *head) + frame


class WatchdogKeeper(Keeper):
    """Prevents a time-out of the watchdog of an axis: writes the present value of the object
    `watchdog` several times within the watchdog time.

    The firmware ignores a write by a client that does not own the axis, so the thread has no effect
    on an axis that another client has acquired.

    The function read() returns the value of the object `watchdog` in ms, and write(ms) writes it.
    This thread calls both, and holds the lock `unchanged` from reading to writing. A caller that
    changes the watchdog must hold this lock.
    """

    def __init__(self, read: Callable[[], int], write: Callable[[int], None]) -> None:
        self.unchanged = threading.Lock()
        self._read, self._write = read, write
        super().__init__(self._rewrite)

    def _rewrite(self) -> float:
        with self.unchanged:
            watchdog_ms = self._read()
            self._write(watchdog_ms)
        return min(KEEP_PERIOD_S, watchdog_ms / 4000)


class GatewayKeeper(WatchdogKeeper):
    """A WatchdogKeeper for an axis at a gateway. It has an LCM client of its own, so that it can
    write while the client of the owner waits for a capture."""

    def __init__(self, axis: int, url: str | None) -> None:
        self._client = AxisClient(axis, url)
        super().__init__(lambda: int(self._client.read("watchdog")), self._write_watchdog)

    def _write_watchdog(self, watchdog_ms: int) -> None:
        self._client.write("watchdog", watchdog_ms)

    def close(self) -> None:
        super().close()
        self._client.close()
