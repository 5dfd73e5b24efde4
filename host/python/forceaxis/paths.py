"""Paths of the files of this package, in a checkout and in an installed wheel, and functions that
write files."""

import contextlib
import errno
import os
import shlex
import signal
from collections.abc import Iterator
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_CHECKOUT = _PACKAGE.parents[2]

# The folder of all files that are no Python modules. A wheel has the same tree as a checkout.
ROOT = _CHECKOUT if (_CHECKOUT / "sim/experiments").is_dir() else _PACKAGE / "data"

SIM = ROOT / "sim"
EXPERIMENTS = SIM / "experiments"
MODELS = SIM / "models"
MEASUREMENTS = SIM / "measurements"

# Generated files for other programs: data sheet, DBC, table of Modbus registers.
OBJECT_FILES = ROOT / "firmware/objects/generated"

PORTS = ROOT / "firmware/port"  # a folder for each board
IMAGES = ROOT / "build/image"  # images of the firmware
# Programs that commands start: axis_linux, axis_node, plant_node, gateway, vcan.
PROGRAMS = (ROOT / "build/release/host", ROOT / "tools")
LIBRARIES = ROOT / "build/lib"  # shared libraries that only a wheel contains, not a checkout


def display(path: Path | str) -> str:
    """Returns the path as text. The text is relative to the current folder if the path is below the
    current folder."""
    path = Path(path).resolve()
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def quoted(path: Path | str) -> str:
    """Returns the path as text for a shell, with quotes if the path contains blanks."""
    return shlex.quote(display(path))


@contextlib.contextmanager
def replacing(folder: Path, *names: str) -> Iterator[list[Path]]:
    """Context that yields temporary paths to write to.

    If the block ends without an exception (Ctrl-C is an exception), the written files become the
    files `names` of the folder, which is created. Otherwise no file is written and no new folder
    remains. Raises OSError.
    """
    fresh = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        if (folder / name).is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), folder / name)
    new = [folder / f"{name}.new" for name in names]
    try:
        yield new
        masked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            for path, name in zip(new, names, strict=True):
                os.replace(path, folder / name)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, masked)
    finally:
        for path in new:
            path.unlink(missing_ok=True)
        if fresh:
            with contextlib.suppress(OSError):
                folder.rmdir()  # rmdir() fails if the folder contains the files that were written


def replace_text(file: Path | str, text: str) -> None:
    """Replaces the content of a file. After an error the file still has its old content. The
    function keeps the mode of the file, and a symbolic link remains a link. Raises OSError."""
    file = Path(file).resolve()
    temporary = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8", newline="")
        if file.exists():
            temporary.chmod(file.stat().st_mode & 0o7777)
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)
