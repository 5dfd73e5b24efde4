"""The image on an emulated chip: qemu-system-arm with two pipes to the plant.

The machine is an STM32F405, whose addresses the STM32F446 shares. It counts instructions instead
of time, so a run is the same every time. Only what the emulator has no model of is replaced in the
image (firmware/port/stm32f4/emulated): start-up, interrupt and firmware are those that are flashed.
"""

import contextlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from forceaxis._core import TransportError

QEMU = "qemu-system-arm"
# 2^6 ns an instruction, some 10,000 of them a tick; time stands still while the chip waits.
CLOCK = ("-icount", "shift=6,sleep=off")


class Emulator:
    """A chip at power-up. `pipes`: file descriptors to it and from it.

    serial, can: QEMU's words for what is at the two serial lines, Modbus RTU and CAN frames (no
    chip that QEMU knows has CAN), each {identifier u16, length u8, remote u8, data 8 bytes}.
    """

    def __init__(self, image, serial="null", can="null", clock=CLOCK):
        if shutil.which(QEMU) is None:
            raise TransportError(f"{QEMU}: expected it on PATH; apt-get install qemu-system-arm")
        self._stack = contextlib.ExitStack()
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="forceaxis.")))
        names = [folder / "to_chip", folder / "from_chip"]
        for name in names:
            os.mkfifo(name)
        # Opened so that neither waits for the other end nor breaks when it goes.
        self.pipes = os.open(names[0], os.O_RDWR), os.open(names[1], os.O_RDONLY | os.O_NONBLOCK)
        for fd in self.pipes:
            self._stack.callback(os.close, fd)
        arguments = "".join(f",arg={word}" for word in ("forceaxis", *names))
        self._log = self._stack.enter_context((folder / "log").open("w+"))
        # Its first two serial lines are USART1, which is not used, and USART2.
        self.process = subprocess.Popen(
            [
                *(QEMU, "-M", "netduinoplus2", "-nographic", "-monitor", "none", *clock),
                *("-serial", "null", "-serial", serial, "-serial", can),
                *("-semihosting-config", f"enable=on,target=native{arguments}"),
                *("-kernel", str(image)),
            ],
            stdin=subprocess.DEVNULL, stdout=self._log, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def __enter__(self):
        return self

    def __exit__(self, *_):
        try:
            self.process.wait(0.5)
        except subprocess.TimeoutExpired:
            self.process.kill()  # while it waits in a pipe it heeds nothing else
            self.process.wait()
        self._stack.close()

    def last_words(self):
        """What the emulator said last, for a message."""
        self._log.flush()
        self._log.seek(0)
        lines = self._log.read().split("\n")
        said = [line.strip() for line in lines if line.strip()]
        return f"{QEMU} said: {said[-1]}" if said else f"{QEMU} said nothing"
