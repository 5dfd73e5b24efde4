"""Runs the firmware image of a board on the emulator QEMU. Two pipes connect the emulated chip to
the plant.

Only the code for peripherals that the emulator does not have is replaced. Start-up code, interrupts
and firmware are the same as in the image that is flashed.
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

LINK_PREFIX = "pil-"  # pil: "processor in the loop"


def links() -> tuple[str, ...]:
    """Returns the link names, such as "pil-NAME", of all boards that have an emulator."""
    return tuple(LINK_PREFIX + board.name for board in boards.known(paths.PORTS) if board.emulator)


def board_of(link: str) -> boards.Board:
    """Returns the board to which a link name such as "pil-NAME" refers."""
    (board,) = [b for b in boards.known(paths.PORTS) if b.emulator and LINK_PREFIX + b.name == link]
    return board


def emulated_image(board: boards.Board) -> boards.EmulatedImage:
    """Returns the description of the emulator image of a board. Raises InputError if the board has
    no emulator."""
    if board.emulator is None:
        raise InputError(
            f"{board.name}: expected a board with an emulator, got a board without an emulator; "
            "choose another board"
        )
    return board.emulator


def command(
    board: boards.Board,
    image: Path,
    *options: str,
    arguments: Iterable[str | Path] = (),
    **lines: str,
) -> list[str]:
    """Returns the command line that starts the emulator with a firmware image. `options`: options
    for QEMU. `arguments`: command line arguments for the program in the image.

    lines: options of QEMU for the serial lines `modbus` and `can`. QEMU has no chip with CAN, so
    the line `can` transmits each CAN frame as a record: {identifier u16, length u8, remote u8, data
    8 bytes}. Raises InputError if the program or the image is missing.
    """
    emulator = emulated_image(board)
    if not image.is_file():
        raise InputError(
            f"{paths.display(image)}: expected a firmware image, got no such file; `tools/image "
            f"--emulated {paths.display(board.folder)}` builds the image"
        )
    if shutil.which(emulator.program) is None:
        raise InputError(
            f"{emulator.program}: expected this program in a folder of PATH; install the program "
            f"with `apt install {emulator.package}`"
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
    """An emulated board. The creation of the object powers the board up. tools/image must have
    built the firmware image before.

    The clock of the emulator counts instructions, so that equal runs have equal results. `pipes`
    are two file descriptors, for data to the board and from the board. Raises the errors of
    command().
    """

    def __init__(self, board: boards.Board) -> None:
        self.board = board
        self._stack = contextlib.ExitStack()
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="forceaxis.")))
        names = [folder / "to_chip", folder / "from_chip"]
        try:
            line = command(
                board,
                paths.IMAGES / f"{board.image}-emulated.elf",
                *emulated_image(board).options,
                arguments=["forceaxis", *map(str, names)],
            )
        except InputError:
            self._stack.close()
            raise
        for name in names:
            os.mkfifo(name)
        # With O_RDWR or O_NONBLOCK, os.open() does not wait until the other program opens the pipe.
        # With O_RDWR or O_NONBLOCK, no error occurs if the other program closes the pipe.
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
            self.process.kill()  # QEMU ignores other signals while it waits for a pipe.
            self.process.wait()
        self._stack.close()

    def last_words(self) -> str:
        """Returns the last line that the emulator printed, for an error message."""
        self._log.flush()
        self._log.seek(0)
        lines = [line.strip() for line in self._log.read().split("\n") if line.strip()]
        return f"{emulated_image(self.board).program} printed {lines[-1] if lines else 'nothing'}"
