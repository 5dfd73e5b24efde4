"""Objects of the firmware for another processor, compiled once for a content.

All processes of a run of tests, and all later runs, share them in build/cross. The content is that
of all sources and headers of the firmware, of the command and of the compiler's version.
"""

import fcntl
import hashlib
import os
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware"
CACHE = ROOT / "build/cross"


def run(*command):
    """Output of a tool; a missing or failing one fails the test with what it printed."""
    assert shutil.which(command[0]), f"{command[0]} is not installed: run tools/setup --tests"
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}"
    return done.stdout


def objects(command, sources, firmware=FIRMWARE, cache=CACHE):
    """The objects of `sources`, in their order: FOLDER_NAME.o of FOLDER/NAME.c. `command` is the
    compiler with its options."""
    words = [str(word) for word in command]
    content = hashlib.sha256(run(words[0], "--version").encode())
    for file in sorted(path for path in firmware.rglob("*") if path.suffix in (".c", ".h")):
        content.update(f"{file.relative_to(firmware)}\0".encode() + file.read_bytes())
    # One folder for a command, so that an older content is replaced.
    folder = cache / hashlib.sha256("\0".join(words).encode()).hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        mark = folder / "content"
        if not mark.exists() or mark.read_text() != content.hexdigest():
            for old in folder.glob("*.o"):
                old.unlink()
            mark.write_text(content.hexdigest())
        return [_compiled(words, source, folder) for source in sources]


def _compiled(words, source, folder):
    made = folder / f"{source.parent.name}_{source.stem}.o"
    if not made.exists():
        part = made.with_suffix(".part")
        run(*words, "-c", source, "-o", part)
        os.replace(part, made)
    return made
