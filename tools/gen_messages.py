#!/usr/bin/env python3
"""Generate the Python types of the LCM messages.

usage: gen_messages.py [--check] [--root DIR]

Reads host/lcm/*.lcm (package forceaxis) and writes host/python/forceaxis/bus/messages/ with lcm-gen
of the environment this runs in (.venv/bin/python tools/gen_messages.py), so that all generate with
the version that requirements.txt pins.

--check writes nothing and ends with status 1 when a file is not up to date.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

SOURCES = "host/lcm"
GENERATED = "host/python/forceaxis/bus/messages"


def generate(root):
    """{file name: text} that lcm-gen generates from the types below `root`."""
    sources = sorted((root / SOURCES).glob("*.lcm"))
    # If the script runs in .venv, the program is next to the interpreter. Otherwise it is the first
    # one on the path.
    beside = Path(sys.executable).parent / "lcm-gen"
    program = beside if beside.exists() else shutil.which("lcm-gen")
    if program is None or not sources:
        sys.exit(fail(f"{SOURCES}: expected *.lcm files, and lcm-gen (tools/setup)"))
    with tempfile.TemporaryDirectory() as folder:
        command = [program, "--python", "--ppath", folder, *sources]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            output = " ".join((done.stderr + done.stdout).split())
            sys.exit(fail(f"{SOURCES}: expected types that lcm-gen accepts: {output}"))
        made = Path(folder) / "forceaxis"
        return {p.name: p.read_text() for p in sorted(made.glob("*.py"))}


def fail(message):
    print(f"gen_messages: {message}", file=sys.stderr)
    return 2


def main():
    parser = argparse.ArgumentParser(description="generate the Python types of the LCM messages")
    parser.add_argument("--check", action="store_true", help="write nothing, status 1 when stale")
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[1])
    args = parser.parse_args()
    files, folder = generate(args.root), args.root / GENERATED
    there = {p.name: p.read_text() for p in folder.glob("*.py")}
    stale = sorted(n for n in files.keys() | there.keys() if files.get(n) != there.get(n))
    if args.check:
        for name in stale:
            print(f"gen_messages: {GENERATED}/{name} is stale: run tools/gen_messages.py")
        return 1 if stale else 0
    folder.mkdir(parents=True, exist_ok=True)
    for name in stale:
        if name in files:
            (folder / name).write_text(files[name])
        else:
            (folder / name).unlink()
    return 0


if __name__ == "__main__":
    sys.exit(main())
