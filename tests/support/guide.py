#!/usr/bin/env python3
"""The pages of docs/guide as what they are to a test: commands, the lines that they print, files.

`tests/support/guide.py PAGE...` plays pages in a built checkout, and prints
each line that a page shows and its commands did not print.

A fenced block of a page is, by its language,
  bash      typed, command by command, in the folder of the page's session; `export NAME=VALUE`
            holds for all later commands
  python    run by the session's Python
  text      lines that the commands above it have printed, in this order
  yaml      shown only
A toml or python block with a title is written to the file of that name instead.
A line `<!-- needs: WHAT -->` before a block says what a test does not have: it is not run, but
what needs `sources` is run, except from a wheel.
A line `<!-- within: 5 % -->` before a block of text says that a search or a fit found its numbers,
so that they depend on the processor: they may differ by that, words may not. `<!-- within: 5 % or
0.1 -->` is for numbers near zero too, which may differ by 0.1.
The time that a step took, "(8.7 s)" at the end of a line, is not compared; a page may leave it out.
A line `<!-- session: WHAT -->` at the head of a page says when its commands are run:
  short     by every tools/test
  long      by tools/test --all, from the wheel (tests/system/e2e/test_release.py)
  vcan      by tools/test --all, on a virtual CAN bus (tests/wire/test_on_the_bus.py)
A page without commands has no such line.
"""

import math
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs/guide"
BLOCK = re.compile(
    r"(?:^ *<!-- needs: (?P<needs>[^>]+) -->\n)?"
    r"(?:^ *<!-- within: (?P<relative>[\d.]+) %(?: or (?P<absolute>[\d.]+))? -->\n)?"
    r"^(?P<indent> *)```(?P<kind>\w+)(?: title=\"(?P<title>[^\"]+)\")?\n(?P<text>.*?)^ *```$",
    re.MULTILINE | re.DOTALL,
)
# A number that stands by itself: the digits of a name or of a hash are part of a word.
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)")
TOOK = re.compile(r" \(\d+\.\d s\)$")
TYPED = ("bash", "python")


@dataclass
class Block:
    kind: str
    text: str
    needs: str | None
    title: str | None
    relative: float = 0.0
    absolute: float = 0.0

    def says(self, line, printed):
        """Whether a line of this block is the printed one, its numbers within the stated bounds."""
        line, printed = (TOOK.sub("", text.rstrip()) for text in (line, printed))
        if not self.relative:
            return line == printed
        if NUMBER.sub("#", line).split() != NUMBER.sub("#", printed).split():
            return False
        shown, found = (
            [float(number.replace(",", "")) for number in NUMBER.findall(text)]
            for text in (line, printed)
        )
        return all(
            math.isclose(found[k], shown[k], rel_tol=self.relative, abs_tol=self.absolute)
            for k in range(len(shown))
        )

    def commands(self):
        """The commands of a block; a line that ends with \\ goes on in the next one."""
        return re.sub(r"\\\n *", "", self.text).splitlines()


def pages():
    return sorted(PAGES.rglob("*.md"))


def session(page):
    found = re.search(r"^<!-- session: (\w+) -->$", page.read_text(), re.MULTILINE)
    return found[1] if found else None


def blocks(page):
    return [
        Block(
            found["kind"],
            re.sub(f"^{found['indent']}", "", found["text"], flags=re.MULTILINE),
            found["needs"],
            found["title"],
            float(found["relative"] or 0) / 100,
            float(found["absolute"] or 0),
        )
        for found in BLOCK.finditer(page.read_text())
    ]


def environment(wheel=None):
    """`wheel`: the Python of an environment with an installed wheel, instead of this checkout."""
    programs = [Path(wheel or sys.executable).parent]
    programs += [] if wheel else [ROOT / "build/release/host", ROOT / "tools"]
    return os.environ | {
        "PATH": ":".join(map(str, [*programs, os.environ["PATH"]])),
        "COLUMNS": "120",
    }


def missing(block, printed):
    """The first line of a block of text that was not printed after the lines before it."""
    rest = iter(printed.splitlines())
    return next(
        (
            line
            for line in block.text.splitlines()
            if not any(block.says(line, later) for later in rest)
        ),
        None,
    )


def play(page, folder, wheel=None):
    """Runs a page in `folder`: (what it says and what the commands before it printed) pairs.
    `wheel`: the Python of an environment with an installed wheel, instead of this checkout."""
    if wheel:
        copy = [wheel.parent / "forceaxis", "examples", folder]
        subprocess.run(copy, env=environment(wheel), stdout=subprocess.DEVNULL, check=True)
    else:
        for name in ("sim", "examples", "tools", "build", "firmware"):
            (folder / name).symlink_to(ROOT / name)
    printed, claims = "", []
    after_text, own = True, environment(wheel)
    for block in blocks(page):
        if block.needs and (wheel or block.needs != "sources"):
            continue
        if block.kind == "text":
            claims.append((block, printed))
            after_text = True
        elif block.title:
            (folder / block.title).parent.mkdir(parents=True, exist_ok=True)
            (folder / block.title).write_text(block.text)
        elif block.kind in TYPED:
            printed = "" if after_text else printed
            after_text = False
            typed = (
                [[wheel or sys.executable, "-c", block.text]]
                if block.kind == "python"
                else [["bash", "-c", command] for command in block.commands()]
            )
            for command in typed:
                if command[-1].startswith("export "):
                    own |= [command[-1].removeprefix("export ").split("=", 1)]
                    continue
                done = subprocess.run(command, cwd=folder, env=own, capture_output=True, text=True)
                assert done.returncode == 0, (command, done.stdout, done.stderr)
                printed += done.stdout
    return claims


def main(pages):
    """Plays pages, and prints each line that a page shows and its commands did not print. Returns
    the exit status."""
    status = 0
    for page in map(Path, pages):
        with tempfile.TemporaryDirectory() as folder:
            for block, printed in play(page.resolve(), Path(folder)):
                if line := missing(block, printed):
                    status = 1
                    print(f"{page}: expected the line\n{line}\ngot\n{printed}")
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
