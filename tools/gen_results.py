#!/usr/bin/env python3
"""Writes the Python types of results from their rows in C++ (host/run/item.hpp): the dataclasses of
host/python/forceaxis/_results.py, and the dicts at the end of host/python/forceaxis/_core.pyi.

    tools/gen_results.py            writes both
    tools/gen_results.py --check    status 1 and one line a file that is not fresh

Needs the built package: run it with .venv/bin/python after a build of `_core`.
"""

import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

from forceaxis import _core

PACKAGE = Path(__file__).resolve().parents[1] / "host/python/forceaxis"
CLASSES, STUB = PACKAGE / "_results.py", PACKAGE / "_core.pyi"
MARK = "\n# Written by tools/gen_results.py from here to the end.\n"
WIDTH = 100
HEAD = '''"""Results of the compiled module. Their fields are the keys of the JSON output.

Written by tools/gen_results.py.
"""

from dataclasses import dataclass
from pathlib import Path
'''


def document(text: str) -> Iterator[str]:
    """Yields the lines of a docstring."""
    yield from textwrap.wrap(f'"""{text}"""', WIDTH - 4)


def field(name: str, kind: str, meaning: str) -> Iterator[str]:
    """Yields the lines of a field with its meaning as a comment."""
    line = f"{name}: {kind}"
    if not meaning:
        yield line
    elif len(line) + len(meaning) + 8 <= WIDTH:
        yield f"{line}  # {meaning}"
    else:
        yield from (f"# {part}" for part in textwrap.wrap(meaning, WIDTH - 6))
        yield line


def class_text(head: str, meaning: str, fields: list[tuple[str, str, str]]) -> str:
    """Returns the text of a class."""
    lines = [*document(meaning), ""]
    for one in fields:
        lines += field(*one)
    return "\n".join([head, *(f"    {line}".rstrip() for line in lines)])


def texts() -> tuple[str, str]:
    """Returns the texts of the two files."""
    classes, dicts = [HEAD], []
    for name, meaning, form, fields in _core.result_types():
        if form == "class":
            head = f"@dataclass(frozen=True)\nclass {name}:"
            classes.append(class_text(head, meaning, fields))
        else:
            total = ", total=False" if form == "partial dict" else ""
            dicts.append(class_text(f"class {name}(TypedDict{total}):", meaning, fields))
    kept = STUB.read_text(encoding="utf-8").partition(MARK)[0]
    return "\n\n".join(classes) + "\n", kept + MARK + "\n" + "\n\n".join(dicts) + "\n"


def formatted(file: Path, text: str) -> str:
    """Returns a text in the form of `ruff format`."""
    command = [Path(sys.executable).with_name("ruff"), "format", "--stdin-filename", file, "-"]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


def main() -> int:
    """Writes or checks the files."""
    stale = []
    for file, text in zip((CLASSES, STUB), texts(), strict=True):
        fresh = formatted(file, text)
        if file.exists() and file.read_text(encoding="utf-8") == fresh:
            continue
        stale.append(file)
        if "--check" not in sys.argv:
            file.write_text(fresh, encoding="utf-8")
    if "--check" in sys.argv:
        for file in stale:
            print(f"{file}: expected what tools/gen_results.py writes; run it")
        return int(bool(stale))
    return 0


if __name__ == "__main__":
    sys.exit(main())
