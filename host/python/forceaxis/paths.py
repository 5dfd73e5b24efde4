"""Paths of the files of this package, which differ between a checkout and an installed wheel. Also
functions that replace files completely or not at all."""

import contextlib
import errno
import os
import shlex
import signal
from collections.abc import Iterator
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_CHECKOUT = _PACKAGE.parents[2]

# ROOT is the root folder of all files of the package that are not Python modules.
# The folders below ROOT are the same in a wheel as in a checkout.
ROOT = _CHECKOUT if (_CHECKOUT / "sim/experiments").is_dir() else _PACKAGE / "data"

SIM = ROOT / "sim"
EXPERIMENTS = SIM / "experiments"
MODELS = SIM / "models"
MEASUREMENTS = SIM / "measurements"

# Folder of files for other programs that were generated from the object table.
OBJECT_FILES = ROOT / "firmware/objects/generated"

# folder that contains one folder for each board on which the firmware runs
PORTS = ROOT / "firmware/port"
IMAGES = ROOT / "build/image"  # folder of the firmware images
# Folders of the compiled programs that commands start, such as axis_node and gateway.
PROGRAMS = (ROOT / "build/release/host", ROOT / "tools")
# folder of the shared libraries that a wheel contains; a checkout does not have it
LIBRARIES = ROOT / "build/lib"


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
    """Context manager that yields temporary paths, whose files replace the final files at its end.

    If the `with` block ends without an exception, the temporary files become the files `names` of
    the folder, and the folder is created if necessary. After an exception, such as that of Ctrl-C,
    the folder has no new file, and no new folder remains. Raises OSError.
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
                # rmdir() fails, as it should, if the folder contains the written files
                folder.rmdir()


def replace_text(file: Path | str, text: str) -> None:
    """Replaces the content of a file. After an error, the file has its old content. The permissions
    of the file do not change, and a symbolic link remains a symbolic link. Raises OSError."""
    file = Path(file).resolve()
    temporary = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8", newline="")
        if file.exists():
            temporary.chmod(file.stat().st_mode & 0o7777)
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)
