"""An emulated chip whose flash is a file: loader, slots, parameters. Each reset ends QEMU, which
starts again with what is in the file then, as a chip does with its flash."""

import dataclasses
import re
import struct
import subprocess
import threading
import zlib

import tunnel
from chip import BOARD, EMULATED, FLASH, FLASH_BYTES, segments
from forceaxis.axis.can import CanLink
from forceaxis.axis.link import NoAnswer
from forceaxis.axis.modbus import ModbusLink
from forceaxis.chip import emulator, update_file

SLOTS, SLOT_BYTES = BOARD.slots.addresses, BOARD.slots.bytes
STORE = slice(0x4000, 0xC000)
UPDATE = EMULATED.with_suffix(".update")
ANSWER_S = 5.0
BRANCH_TO_ITSELF = b"\xfe\xe7"


def new_flash():
    """The bytes of a flash that a debug probe has written: loader and a confirmed image in slot
    A."""
    flash = bytearray(b"\xff" * FLASH_BYTES)
    for address, data in segments(EMULATED):
        flash[address - FLASH : address - FLASH + len(data)] = data
    return flash


def changed(record, at, data):
    """A record whose image has other bytes, with the CRC of these bytes."""
    image = record.image[:at] + data + record.image[at + len(data) :]
    return dataclasses.replace(record, image=image, crc=zlib.crc32(image))


def newer(text=b"newer"):
    """The records of an image that differs from the one that runs by the commit in its identity."""
    records = update_file.read(UPDATE)
    at = records[0].image.index(b"FAXI") + 24
    return [changed(one, at, text.ljust(16, b"\0")) for one in records]


def hanging():
    """The records of an image that stops in its first instruction."""
    found = []
    for one in update_file.read(UPDATE):
        (reset,) = struct.unpack_from("<I", one.image, 4)
        found.append(changed(one, (reset & ~1) - one.address, BRANCH_TO_ITSELF))
    return found


def file_of(path, records):
    path.write_bytes(update_file.write(records))
    return path


class EmulatedFlash:
    """A chip in real time. `starts` counts its starts; reset() is what the watchdog or the supply
    does."""

    def __init__(self, folder, modbus=False):
        self.path, self.socket, self.tty = folder / "flash", folder / "frames", folder / "tty"
        self.path.write_bytes(new_flash())
        self.modbus, self.starts, self.is_over = modbus, 0, False
        self.started = threading.Event()
        self.thread = threading.Thread(target=self.run)

    def __enter__(self):
        self.thread.start()
        assert self.started.wait(20)
        return self

    def __exit__(self, *_):
        self.is_over = True
        self.process.kill()
        self.thread.join()

    def run(self):
        while not self.is_over:
            self.socket.unlink(missing_ok=True)
            lines = (
                {"modbus": "pty"}
                if self.modbus
                else {"can": f"unix:{self.socket},server=on,wait=off"}
            )
            command = emulator.command(
                BOARD, EMULATED, "-no-reboot", arguments=["flash", self.path], **lines
            )
            # In place of the ELF file the bytes of the flash.
            at = command.index("-kernel")
            command[at : at + 2] = [
                "-device", f"loader,file={self.path},addr={FLASH:#x},force-raw=on",
            ]  # fmt: skip
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
                stderr=subprocess.STDOUT,
            )  # fmt: skip
            if self.modbus:
                # Warnings of the emulator may come before this line.
                told = (re.search(r"redirected to (\S+)", text) for text in self.process.stdout)
                found = next(match for match in told if match)
                self.tty.unlink(missing_ok=True)
                self.tty.symlink_to(found[1])
            self.starts += 1
            self.started.set()
            self.process.wait()

    def reset(self):
        self.process.kill()

    @property
    def flash(self):
        return self.path.read_bytes()

    def slot(self, number):
        begin = SLOTS[number] - FLASH
        return self.flash[begin : begin + SLOT_BYTES]

    def trailer(self, number):
        return update_file.TRAILER.unpack(self.slot(number)[-64:])

    def connect(self):
        """A new connection to the axis."""
        try:
            if self.modbus:
                return ModbusLink(str(self.tty), 1, ANSWER_S)
            return CanLink("tunnel", 1, bus=tunnel.SerialBus(self.socket), timeout_s=ANSWER_S)
        except OSError as error:
            raise NoAnswer(f"the emulated chip restarts: {error}") from None
