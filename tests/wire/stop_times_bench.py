"""Wall times of stops by CANopen and through the gateway: the last column of docs/stop_times.md.

usage: tools/vcan .venv/bin/python tests/wire/stop_times_bench.py [REPETITIONS]

From before a client sends, to the time stamp of the first record of the link (vcan1) with code 0
and the amplifier off; of a halt, with another code. CANopen owns the axis. The ticks of that table
are made by tests/firmware/unit/fw_stop_test.cpp, which leaves this column as it is.
"""

import contextlib
import datetime
import os
import platform
import socket
import statistics
import struct
import sys
import tempfile
import time
from pathlib import Path

from forceaxis.bus.client import AxisClient
from forceaxis.objects import BY_NAME
from forceaxis.thesis import session as thesis_session
from gateway_clients import CAN_FRAME, Can, Tcp, gateway, operational, until

TABLE = Path(__file__).resolve().parents[2] / "docs" / "stop_times.md"
CODE = 200
WORDS = {
    "disable voltage": 0x00,
    "quick stop": 0x02,
    "shutdown": 0x06,
    "disable operation": 0x07,
    "halt (controlled)": 0x10F,
}
SO_TIMESTAMPNS, SO_RCVBUFFORCE = 35, 33
TO_PLANT = 1 << 28


class Outputs:
    """The firmware's outputs, with the kernel's time stamps."""

    def __init__(self):
        self.socket = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        direction = struct.pack("=II", TO_PLANT | socket.CAN_EFF_FLAG,
                                TO_PLANT | socket.CAN_EFF_FLAG)  # fmt: skip
        self.socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, direction)
        self.socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, 8 << 20)
        self.socket.bind(("vcan1",))
        self.socket.settimeout(5)

    def next(self):
        """(time, code, amplifier on)."""
        data, ancillary, _, _ = self.socket.recvmsg(16, 64)
        seconds, nanoseconds = struct.unpack("qq", ancillary[0][2][:16])
        code, out = struct.unpack("<hB", struct.unpack(CAN_FRAME, data)[2][:3])
        return seconds + nanoseconds * 1e-9, code, out & 1

    def drain(self):
        """Drops what waits: the kernel keeps the first of too many records, not the latest."""
        self.socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while self.socket.recv(16):
                pass
        self.socket.settimeout(5)

    def first(self, since, holds):
        """The time of the first outputs after `since` for which it holds."""
        at = since
        while at < since + 5:
            at, code, on = self.next()
            if at >= since and holds(code, on):
                return at
        raise TimeoutError(f"code {code}, amplifier {on}")


def stopped(code, on):
    return code == 0 and not on


class Bench:
    def __init__(self, count):
        self.count, self.can, self.outputs, self.found = count, Can(), Outputs(), {}

    def without_ramps(self):
        for name in ("quick_stop_option", "disable_operation_option", "shutdown_option"):
            self.write(name, 0, 2)

    def write(self, name, value, size):
        index, sub = BY_NAME[name].index, BY_NAME[name].sub
        if not until(lambda: self.can.write(1, index, sub, value, size) == 0x60):
            raise TimeoutError(f"{name} {value} was refused")

    def enable(self, code):
        """As CANopen: a controlword that does not enable, then those that do."""
        self.write("controlword", 0, 2)
        self.write("controlword", 0x80, 2)
        self.write("modes_of_operation", -2 & 0xFFFFFFFF, 1)
        self.write("open_loop_code", code & 0xFFFFFFFF, 2)
        self.outputs.drain()
        for word in (6, 7, 15):
            self.write("controlword", word, 2)
        self.outputs.first(time.time(), lambda now, on: now != 0 and on)

    def prepared(self, enable, code, tries=3):
        """Enabled: a guest that stalled has lost the axis, then once more."""
        try:
            enable(code)
        except TimeoutError:
            if tries == 1:
                raise
            self.prepared(enable, code, tries - 1)

    def row(self, event, source, act, after=lambda: None, count=None, before=None):
        times, code = [], CODE
        for _ in range(count or self.count):
            code = -code  # to and fro
            self.prepared(before or self.enable, code)
            halts = event.startswith("halt")
            if halts:  # the code rises slowly
                self.outputs.first(time.time(), lambda now, _, code=code: now == code)
            since = time.time()
            answer = act()
            goal = (lambda now, on, code=code: now != code) if halts else stopped
            try:
                times.append(1000 * (self.outputs.first(since, goal) - since))
            except TimeoutError as still:
                raise TimeoutError(
                    f"{event}, {source}: {still} after the answer {answer}"
                ) from still
            after()
        self.found[event, source] = times
        print(f"{event}, {source}: {text(times)}", file=sys.stderr, flush=True)


def text(times):
    return f"{statistics.median(times):.1f} / {max(times):.1f}"


def through(bench, axis, tcp):
    """The stops that every bus has."""

    def modbus(name, value):
        where = BY_NAME[name].modbus
        return lambda: tcp.ask(1, struct.pack(">BHH", 6, where, value))

    for event, word in WORDS.items():
        bench.row(event, "CANopen", lambda word=word: bench.can.write(1, 0x6040, 0, word, 2))
        bench.row(event, "Modbus TCP", modbus("controlword", word))
        bench.row(event, "LCM", lambda word=word: axis.write("controlword", word))
        data = struct.pack("<Hb", word, -2)
        bench.row(event, "CANopen RPDO", lambda data=data: bench.can.send(0x201, data))
    event = "native mode disabled"
    bench.row(event, "CANopen", lambda: bench.write("mode", 0, 1))
    bench.row(event, "Modbus TCP", modbus("mode", 0))
    bench.row(event, "LCM", lambda: axis.write("mode", "disabled"))


def killed(bench, axis):
    """The gateway ends without a word while LCM owns the axis."""
    running = []

    def own(code):
        running.append(gateway(heartbeat_ms=100))
        until(lambda: operational(axis), 10)
        axis.take()
        for word in (0, 0x80, 0):
            axis.write("controlword", word)
        axis.write_all({"modes_of_operation": -2, "open_loop_code": code, "watchdog": 60_000})
        for word in (6, 7, 15):
            axis.write("controlword", word)
        until(lambda: axis.state().statusword & 0x6F == 0x27)
        bench.outputs.drain()

    def act():
        running[-1].kill()
        running[-1].wait()

    event = "gateway killed: heartbeat 300 ms, watchdog 1000 ms (defaults)"
    bench.row(event, "gateway", act, count=3, before=own)


def measured(count):
    bench = Bench(count)
    nodes = ("axis_node", "plant_node")
    with (
        thesis_session.machine(Path(tempfile.mkdtemp()), programs=nodes, endless=True),
        AxisClient(1, timeout_s=4) as axis,
    ):
        killed(bench, axis)
        process = gateway(heartbeat_ms=100)
        until(lambda: operational(axis), 10)
        bench.write("controlword", 0x80, 2)
        bench.without_ramps()
        through(bench, axis, Tcp())
        start = lambda: bench.can.send(0, b"\x01\x01")  # noqa: E731
        bench.row("NMT stop", "CANopen", lambda: bench.can.send(0, b"\x02\x01"), start)
        process.terminate()
        process.wait(5)
    return bench.found


def machine():
    """Its kind, for the reader of the figures."""
    guest = "User Mode Linux" in Path("/proc/cpuinfo").read_text()
    host = "a user-mode-linux guest" if guest else f"Linux on {platform.machine()}"
    return f"{host}, {os.cpu_count()} CPU{'s' if os.cpu_count() != 1 else ''}"


def filled(table, found, count):
    """The document with the measured column of wall-clock times and the text after the table."""
    lines = []
    for line in table.splitlines():
        cells = [c.strip() for c in line.strip("|").split("|")]
        if line.startswith("| ") and cells[0] != "event":
            times = found.get((cells[0], cells[1]))
            line = line[: line.rstrip("|").rindex("|") + 1] + f" {text(times) if times else ''} |"
        if not line.startswith("|") and lines and lines[-1].startswith("|"):
            break
        lines.append(line.replace("|  |", "| |"))
    today = datetime.datetime.now(tz=datetime.UTC).date()
    lines += [
        "",
        "The last column gives the median and the maximum of the time in ms from the call of the "
        "client to the",
        f"outputs that the link shows. It was measured on {today} on {machine()}",
        "without real time, so it is no bound. Each row has",
        f"{count} repetitions with CANopen as the owner. The row of the killed gateway has 3",
        "repetitions, with LCM as the owner and a watchdog of 60 s.",
    ]
    return "\n".join(lines) + "\n"


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    found = measured(count)
    TABLE.write_text(filled(TABLE.read_text(), found, count))


if __name__ == "__main__":
    main()
