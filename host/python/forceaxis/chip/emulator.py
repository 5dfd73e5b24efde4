"""The image of a board on its emulator, QEMU, with two pipes to the plant.

Only code for peripherals that the emulator lacks is replaced: start-up, interrupt and firmware are
those of the image that is flashed.
"""

import contextlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.chip import board as boards

LINK_PREFIX = "pil-"  # processor in the loop
IMAGES = Path(__file__).resolve().parents[4] / "build/image"


def links() -> tuple[str, ...]:
    """Names of the links to the boards that have an emulator."""
    return tuple(LINK_PREFIX + board.name for board in boards.known() if board.emulator)


def board_of(link: str) -> boards.Board:
    """The board of a link."""
    (board,) = [b for b in boards.known() if b.emulator and LINK_PREFIX + b.name == link]
    return board


def emulated_image(board: boards.Board) -> boards.EmulatedImage:
    """The image for the emulator of a board. Raises InputError for a board without one."""
    if board.emulator is None:
        raise InputError(
            f"{board.name}: expected a board that has an emulator; choose another board"
        )
    return board.emulator


def command(
    board: boards.Board,
    image: Path,
    *options: str,
    arguments: Iterable[str | Path] = (),
    **lines: str,
) -> list[str]:
    """The emulator's command line for an image, with a command line of its own.

    lines: QEMU's options for the serial lines `modbus` and `can` (frames, since QEMU models no
    chip with CAN: {identifier u16, length u8, remote u8, data 8 bytes}).
    Raises InputError if the program or the image is missing.
    """
    emulator = emulated_image(board)
    if not image.is_file():
        raise InputError(
            f"{paths.display(image)}: expected an image of the firmware, there is no such file; "
            "`tools/image --emulated` builds it"
        )
    if shutil.which(emulator.program) is None:
        raise InputError(
            f"{emulator.program}: expected this program on PATH; install it with `apt install "
            f"{emulator.package}`"
        )
    serial = [w for line in emulator.serial_lines for w in ("-serial", lines.get(line, "null"))]
    words = "".join(f",arg={word}" for word in arguments)
    return [
        *(emulator.program, "-M", emulator.machine, "-nographic", "-monitor", "none"),
        *serial,
        *("-semihosting-config", f"enable=on,target=native{words}"),
        *("-kernel", str(image)),
        *options,
    ]


class Emulator:
    """A board at power-up, with the image that tools/image built; counts instructions instead of
    time, so a run is the same every time. `pipes`: file descriptors to it and from it. Raises as
    command() does."""

    def __init__(self, board: boards.Board) -> None:
        self.board = board
        self._stack = contextlib.ExitStack()
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="forceaxis.")))
        names = [folder / "to_chip", folder / "from_chip"]
        try:
            line = command(
                board,
                IMAGES / f"{board.image}-emulated.elf",
                *emulated_image(board).clock,
                arguments=["forceaxis", *map(str, names)],
            )
        except InputError:
            self._stack.close()
            raise
        for name in names:
            os.mkfifo(name)
        # Opened so that neither blocks on the other end nor fails when that closes.
        self.pipes = os.open(names[0], os.O_RDWR), os.open(names[1], os.O_RDONLY | os.O_NONBLOCK)
        for fd in self.pipes:
            self._stack.callback(os.close, fd)
        self._log = self._stack.enter_context((folder / "log").open("w+"))
        self.process = subprocess.Popen(
            line, stdin=subprocess.DEVNULL, stdout=self._log, stderr=subprocess.STDOUT
        )

    def __enter__(self) -> "Emulator":
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.process.wait(0.5)
        except subprocess.TimeoutExpired:
            self.process.kill()  # it ignores other signals while it waits in a pipe
            self.process.wait()
        self._stack.close()

    def last_words(self) -> str:
        """The last line that the emulator printed, for a message."""
        self._log.flush()
        self._log.seek(0)
        lines = [line.strip() for line in self._log.read().split("\n") if line.strip()]
        return f"{emulated_image(self.board).program} printed {lines[-1] if lines else 'nothing'}"
