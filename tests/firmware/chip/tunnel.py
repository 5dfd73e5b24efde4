"""The emulated chip with its frames of CAN at a socket, because no chip that QEMU knows has CAN."""

import contextlib
import os
import select
import socket
import struct
import subprocess
import threading
import time

import can
from chip import BOARD, EMULATED
from forceaxis import _core
from forceaxis.chip import emulator as chip

FRAME = struct.Struct("<HBB8s")
# As board.toml has it, but at the pace of the host's clock.
REAL_TIME = ("-icount", "shift=7,sleep=on,align=on")


class SerialBus(can.BusABC):
    """python-can over the tunnel."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(str(path))
        self.bytes = b""
        super().__init__(channel=str(path))

    def send(self, msg, timeout=None):
        self.socket.sendall(
            FRAME.pack(msg.arbitration_id, msg.dlc, msg.is_remote_frame, bytes(msg.data))
        )

    def _recv_internal(self, timeout):
        end = time.monotonic() + (timeout or 0)
        while len(self.bytes) < FRAME.size:
            remaining = end - time.monotonic()
            if not select.select([self.socket], [], [], max(remaining, 0))[0]:
                return None, False
            self.bytes += self.socket.recv(4096)
        can_id, length, _, data = FRAME.unpack(self.bytes[: FRAME.size])
        self.bytes = self.bytes[FRAME.size :]
        frame = can.Message(
            arbitration_id=can_id, data=data[:length], is_extended_id=False, timestamp=time.time()
        )
        return frame, False

    def shutdown(self):
        super().shutdown()
        self.socket.close()


def emulator(*options, arguments=(), **lines):
    """The emulated chip in real time, with these at its serial lines."""
    return subprocess.Popen(
        chip.command(BOARD, EMULATED, *options, arguments=arguments, **lines),
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


@contextlib.contextmanager
def frames(folder, *options, arguments=()):
    """The socket of a chip's frames."""
    path = folder / "frames"
    process = emulator(*options, arguments=arguments, can=f"unix:{path},server=on,wait=off")
    try:
        end = time.monotonic() + 20
        while not path.exists():
            assert process.poll() is None and time.monotonic() < end
            time.sleep(0.01)
        yield path
    finally:
        process.kill()
        process.wait()


@contextlib.contextmanager
def before_plant(folder, experiment):
    """The socket of the frames of a chip that is disabled before an experiment's plant, in real
    time, for up to ten minutes."""
    pipes = [folder / "to_chip", folder / "from_chip"]
    for pipe in pipes:
        os.mkfifo(pipe)
    fds = os.open(pipes[0], os.O_RDWR), os.open(pipes[1], os.O_RDONLY | os.O_NONBLOCK)
    overrides = ["experiment.duration_s=600", "firmware.mode=disabled"]

    def ticks():
        with contextlib.suppress(_core.TransportError):  # the chip was ended
            _core.run_on_chip(str(experiment), overrides, *fds, timeout_s=5.0, trace=False)

    plant = threading.Thread(target=ticks)
    try:
        with frames(folder, *REAL_TIME, arguments=["forceaxis", *pipes]) as path:
            plant.start()
            yield path
        plant.join()
    finally:
        for fd in fds:
            os.close(fd)
