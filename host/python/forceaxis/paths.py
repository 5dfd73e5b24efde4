"""Where models and experiments are: the checkout's sim/, or the copy inside an installed wheel."""

import contextlib
import errno
import os
import shlex
import signal
from collections.abc import Iterator
from pathlib import Path

_package = Path(__file__).resolve().parent
_checkout = _package.parents[2] / "sim"

SIM = _checkout if (_checkout / "experiments").is_dir() else _package / "sim"
EXPERIMENTS = SIM / "experiments"
MODELS = SIM / "models"
MEASUREMENTS = SIM / "measurements"

# The files generated for other programs: data sheet, DBC, Modbus map.
_generated = _package.parents[2] / "firmware/objects/generated"
OBJECT_FILES = _generated if _generated.is_dir() else _package / "objects_files"


def display(path: Path | str) -> str:
    """The path for display: relative to the current folder where it lies below."""
    path = Path(path).resolve()
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def quoted(path: Path | str) -> str:
    """The path for display as a word of a shell, quoted where it has blanks."""
    return shlex.quote(display(path))


@contextlib.contextmanager
def replacing(folder: Path, *names: str) -> Iterator[list[Path]]:
    """Paths to write to. They become the files `names` of the folder, which is created, when the
    block ends without an exception (Ctrl-C is one). Otherwise no file is written and no folder
    remains. Raises OSError."""
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
                folder.rmdir()  # refused where the files are there


def replace_text(file: Path | str, text: str) -> None:
    """Replace the contents of a file completely or not at all. The file keeps its mode, a link
    remains a link. Raises OSError."""
    file = Path(file).resolve()
    temporary = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8", newline="")
        if file.exists():
            temporary.chmod(file.stat().st_mode & 0o7777)
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)
