#!/usr/bin/env python3
"""Prove what the firmware promises: no float, heap, mutable static, libc or #if; layers.

usage: check_firmware.py [--root DIR]

Each rule is checked in the source text, without comments, and where a trick could hide it also in
the objects that a Cortex-M4 compiler makes of it. One line per finding, and status 1; status 0 and
one line when there is none; status 2 when a tool or a folder is missing.

In firmware/{core,fx,app} and firmware/objects/generated (without the host's axis_objects_meta.h):
  float        no float or double type, no floating literal; no floating instruction, compiled with
               hardware floating point, so that the compiler would use one
  heap         no malloc and its kin
  static       no mutable static or global: .data, .bss and common are empty
  libc         only stdint.h, stdbool.h and stddef.h are included; no undefined symbol is left
  conditional  no #if of any kind but the include guard
  layering     firmware includes firmware only, and core, fx and app no port, app or host header
               from below; sim includes no firmware
  shift        no << >> / % outside fx: whatever can round or overflow goes through it
"""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

FOLDERS = ("core", "fx", "app", "objects/generated")
HOST_ONLY = "axis_objects_meta.h"
LIBC_HEADERS = {"stdint.h", "stdbool.h", "stddef.h"}
HEAP = ("malloc", "calloc", "realloc", "aligned_alloc", "free", "alloca", "strdup", "sbrk")
# What each folder may include below firmware/.
MAY_INCLUDE = {
    "fx": ("fx/",),
    "core": ("core/", "fx/", "objects/generated/"),
    "app": ("app/", "core/", "fx/", "objects/generated/"),
    "objects/generated": ("objects/generated/",),
}
# Helpers of the compiler that a target may call. None is needed.
COMPILER_HELPERS = frozenset()
COMPILER = (
    "arm-none-eabi-gcc",
    "-mcpu=cortex-m4",
    "-mthumb",
    "-mfloat-abi=hard",
    "-mfpu=fpv4-sp-d16",
    "-std=c11",
    "-O2",
    "-ffreestanding",
    "-fno-common",
)
FLOAT_WORD = re.compile(r"\b(float|double|_Complex|float_t|double_t|_Float\w+)\b")
FLOAT_LITERAL = re.compile(
    r"(?<![\w.])(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?|(?<![\w.])\d+[eE][+-]?\d+|\b0[xX][\da-fA-F]*\.?"
    r"[\da-fA-F]*[pP]"
)
STATIC = re.compile(r"\b(static|_Thread_local|register)\b(?!\s+inline\b)(?P<rest>[^;{=(]*)")
SHIFT = re.compile(r"<<|>>|/|%")


def without_comments(text):
    """Text with comments and string contents blanked, line numbers kept."""

    def blank(match):
        found = match.group(0)
        if found.startswith(("/*", "//")):
            return re.sub(r"[^\n]", " ", found)
        return found[0] + " " * (len(found) - 2) + found[-1]

    return re.sub(
        r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'", blank, text, flags=re.S
    )


def included(text):
    """(line number, header, quoted or angled) of every #include."""
    for match in re.finditer(r'^[ \t]*#[ \t]*include[ \t]*(["<])([^">]*)', text, flags=re.M):
        yield text.count("\n", 0, match.start()) + 1, match.group(2), match.group(1)


class Findings:
    def __init__(self, root):
        self.root = root
        self.lines = []

    def add(self, path, line, rule, message):
        where = path.relative_to(self.root) if path.is_absolute() else path
        self.lines.append(
            f"{where}:{line}: {rule}: {message}" if line else f"{where}: {rule}: {message}"
        )


def check_conditionals(path, code, findings):
    directives = [
        (m.group(1), m.group(2).strip(), code.count("\n", 0, m.start()) + 1)
        for m in re.finditer(r"^[ \t]*#[ \t]*(\w+)([^\n]*)", code, flags=re.M)
    ]
    conditionals = [d for d in directives if d[0] in ("if", "ifdef", "ifndef", "elif", "else")]
    if path.suffix == ".h":
        guard = re.sub(r"\W", "_", str(path.relative_to(findings.root))).upper() + "_"
        if directives[:2] and [d[:2] for d in directives[:2]] == [
            ("ifndef", guard),
            ("define", guard),
        ]:
            conditionals = conditionals[1:]
        else:
            findings.add(path, 1, "conditional", f"expected the include guard {guard}")
    for name, _, line in conditionals:
        findings.add(path, line, "conditional", f"#{name}: no conditional but the include guard")


def check_text(path, folder, findings):
    text = path.read_text(encoding="utf-8")
    code = without_comments(text)
    check_conditionals(path, code, findings)
    for line, header, kind in included(text):
        if kind == "<":
            if header not in LIBC_HEADERS:
                findings.add(
                    path, line, "libc", f"<{header}> is not one of the headers that need no library"
                )
        elif not header.startswith(tuple("firmware/" + f for f in MAY_INCLUDE[folder])):
            findings.add(path, line, "layering", f"firmware/{folder} must not include {header}")
        elif header.endswith(HOST_ONLY):
            findings.add(path, line, "layering", f"{header} is for the host")
    # What is left are declarations and statements.
    body = re.sub(r"^[ \t]*#[ \t]*include[^\n]*", "", code, flags=re.M)
    for number, line in enumerate(body.split("\n"), 1):
        for pattern in (FLOAT_WORD, FLOAT_LITERAL):
            for match in pattern.finditer(line):
                findings.add(path, number, "float", f"{match.group(0)!r}")
        for match in re.finditer(r"\b(" + "|".join(HEAP) + r")\b", line):
            findings.add(path, number, "heap", f"{match.group(0)!r}")
        if folder in ("core", "app"):
            for match in SHIFT.finditer(line):
                findings.add(path, number, "shift", f"{match.group(0)!r} outside firmware/fx")
    for match in STATIC.finditer(body):
        # A function's name is followed by its arguments; an object must be const.
        after = body[match.end() : match.end() + 1]
        if "const" not in match.group("rest").split() and after != "(":
            findings.add(
                path,
                body.count("\n", 0, match.start()) + 1,
                "static",
                f"mutable: {' '.join(match.group(0).split())!r}",
            )


def tool(*command):
    if shutil.which(command[0]) is None:
        raise SystemExit(fail(f"{command[0]}: not found; install gcc-arm-none-eabi"))
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)


def fail(message):
    print(f"check_firmware.py: {message}", file=sys.stderr)
    return 2


def check_objects(sources, root, findings):
    """What the source text can hide, the objects show."""
    defined, undefined = set(), {}
    with tempfile.TemporaryDirectory() as folder:
        for number, source in enumerate(sources):
            compiled = Path(folder) / f"{number}.o"
            done = tool(*COMPILER, f"-I{root}", "-c", source, "-o", compiled)
            if done.returncode != 0:
                findings.add(source, 0, "compile", done.stderr.strip().split("\n")[0])
                continue
            for line in tool("arm-none-eabi-nm", compiled).stdout.splitlines():
                *_, kind, name = line.split()
                if kind in "Uw":
                    undefined.setdefault(name, source)
                    continue
                defined.add(name)
                if kind in "bBdDcCsSgG":
                    findings.add(source, 0, "static", f"{name} is mutable (nm type {kind})")
            for line in tool(
                "arm-none-eabi-objdump", "-d", "--no-show-raw-insn", compiled
            ).stdout.splitlines():
                words = line.split("\t")
                if len(words) > 1 and words[1].startswith("v"):
                    findings.add(source, 0, "float", f"instruction {words[1].strip()}")
                    break
    for name, source in sorted(undefined.items()):
        if name in defined or name in COMPILER_HELPERS:
            continue
        rule = (
            "float"
            if re.match(r"__aeabi_[dfc]|__(float|fix|add|sub|mul|div)\w*[sd]f", name)
            else "heap"
            if name in HEAP
            else "libc"
        )
        findings.add(source, 0, rule, f"needs {name}, which the firmware does not define")


def check_sim(root, findings):
    sim = root / "sim"
    for path in sorted(p for p in sim.rglob("*") if p.suffix in (".h", ".hpp", ".c", ".cpp")):
        for line, header, _ in included(path.read_text(encoding="utf-8")):
            if "firmware/" in header:
                findings.add(path, line, "layering", f"sim must not include {header}")
    for path in sorted(
        p for p in (root / "firmware").rglob("*") if p.suffix in (".h", ".hpp", ".c", ".cpp")
    ):
        for line, header, _ in included(path.read_text(encoding="utf-8")):
            if re.search(r"(^|/)(sim|host|tests|tools)/", header) and not header.startswith(
                "firmware/"
            ):
                findings.add(path, line, "layering", f"firmware must not include {header}")


def main(argv=None):
    parser = argparse.ArgumentParser(description="prove what the firmware promises")
    parser.add_argument(
        "--root", type=Path, default=Path(__file__).resolve().parent.parent, help="project folder"
    )
    root = parser.parse_args(argv).root.resolve()
    findings = Findings(root)
    sources, count = [], 0
    for folder in FOLDERS:
        where = root / "firmware" / folder
        paths = sorted(p for p in where.glob("*") if p.is_file() and p.name != HOST_ONLY)
        if not paths:
            return fail(f"{where}: expected the firmware's sources")
        for path in paths:
            count += 1
            if path.suffix not in (".c", ".h"):
                findings.add(path, 0, "layering", "expected C sources only")
                continue
            check_text(path, folder, findings)
            if path.suffix == ".c":
                sources.append(path)
    check_objects(sources, root, findings)
    check_sim(root, findings)
    for line in findings.lines:
        print(line)
    if findings.lines:
        return 1
    print(f"firmware gates: {count} files, {len(sources)} objects, nothing found")
    return 0


if __name__ == "__main__":
    sys.exit(main())
