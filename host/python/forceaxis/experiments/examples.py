"""Copies the files that come with the package, so that a user can read and change them. They are
models, experiments, cycles, example programs and images of the firmware."""

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

from forceaxis import paths
from forceaxis._core import InputError

# {pattern of file paths, relative to paths.ROOT: description of these files}
FILES = {
    "sim/*/*.toml": "models, experiments, cycles, parts, measurements",
    "sim/*/*.json": "records of the thesis",
    "examples/*.py": "programs in Python",
    "examples/*.toml": "models for these programs, and for the recording",
    "examples/*.csv": "a recording that another program made",
    "tools/vcan": "runs a command with virtual CAN buses",
    "build/image/*.elf": "images of the firmware",
    "build/image/*.hex": "images of the firmware",
    "build/image/*.bin": "images of the firmware",
}


@dataclass(frozen=True)
class CopiedExamples:
    """The copied examples: the target folder, and the number of files in each of its folders."""

    folder: str
    files: dict[str, int]


def copy(folder: Path) -> CopiedExamples:
    """Copies the files into a folder, with the paths that they have in a checkout. The folder need
    not exist. Raises InputError if the folder already contains a file or folder with one of these
    names, and OSError. In both cases the folder is unchanged."""
    names = sorted({pattern.split("/")[0] for pattern in FILES})
    for name in names:
        if (folder / name).exists():
            raise InputError(
                f"{paths.display(folder / name)}: expected no existing file or folder of this "
                "name; choose another folder, or remove the existing one"
            )
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    counts: dict[str, int] = {}
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".examples.") as temporary:
            for pattern in FILES:
                for source in sorted(paths.ROOT.glob(pattern)):
                    place = source.parent.relative_to(paths.ROOT)
                    (Path(temporary) / place).mkdir(parents=True, exist_ok=True)
                    shutil.copy(source, Path(temporary) / place)
                    counts[str(place)] = counts.get(str(place), 0) + 1
            for made in sorted(Path(temporary).iterdir()):
                made.rename(folder / made.name)
    except OSError:
        if is_new:
            folder.rmdir()
        raise
    return CopiedExamples(paths.display(folder), counts)
