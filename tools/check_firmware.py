#!/usr/bin/env python3
"""Check the rules of the firmware: no float, heap, mutable static, libc or #if; layers.

usage: check_firmware.py [--root DIR]

Each rule is checked in the source text, without comments, and where a trick could hide it also in
the objects that a Cortex-M4 compiler makes of it. One line per finding, and status 1; status 0 and
one line when there is none; status 2 when a tool or a folder is missing.

In firmware/{fx,objects,core,cycle,guard,drive,canopen,drive402,modbus,storage,app}, without
axis_objects_meta.h of the host, with every folder below them:
  float        no float or double type, no floating literal; no floating instruction, compiled with
               hardware floating point, so that the compiler would use one
  heap         no malloc and its kin
  static       no mutable static or global: .data, .bss and common are empty
  libc         only stdint.h, stdbool.h and stddef.h are included; no undefined symbol is left
  conditional  no #if of any kind but the include guard
  layering     each folder includes only what MAY_INCLUDE allows it: no port, and no layer above
  shift        no << >> / % outside fx: whatever can round or overflow goes through it
  spelling     no trigraph, digraph or computed include, which could hide code from the other rules
Everywhere in firmware, sim and host:
  layering     firmware includes firmware only and sim sim only; a project header is included in
               quotes, from the root ("firmware/...", "sim/...", "host/..."), without ".."; a port
               includes the chip.h of its board by that name
  circle       no file reaches itself by includes, and in those folders of firmware/ none by
               includes and calls, nor a module (NAME.h with NAME.c) by includes
  folder       nothing lies below firmware/ but in those folders and port
"""

import argparse
import functools
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

FOLDERS = (
    "fx", "objects", "core", "cycle", "guard", "drive", "canopen", "drive402", "modbus", "storage",
    "app",
)  # fmt: skip
PORTS = "port"  # may include all of firmware, the library of the compiler and conditionals
# The header of a board with an STM32 that the shared files include by its name alone (tools/image).
CHIP_HEADER = "chip.h"
# The other folders of firmware/.
OTHER_FILES = {
    "CMakeLists.txt",
    "objects/axis_objects.toml",
    "objects/numbers.txt",
    "objects/released/0.1.0.csv",
    # Files that are generated for other programs.
    "objects/generated/forceaxis.eds",
    "objects/generated/forceaxis.dbc",
    "objects/generated/forceaxis-gateway.dbc",
    "objects/generated/forceaxis-gateway.dcf",
    "objects/generated/forceaxis-bus.yml",
    "objects/generated/forceaxis-modbus.csv",
}
HOST_ONLY = ("objects/generated/axis_gateway.h", "objects/generated/axis_objects_meta.h")
SOURCE_SUFFIXES = (".h", ".hpp", ".hh", ".hxx", ".c", ".cpp", ".cc", ".cxx", ".inc", ".inl", ".ipp")
# The parts of the project whose headers each part may include.
ROOTS = {"firmware": ("firmware/",), "sim": ("sim/",), "host": ("firmware/", "sim/", "host/")}
LIBC_HEADERS = {"stdint.h", "stdbool.h", "stddef.h"}
HEAP = ("malloc", "calloc", "realloc", "aligned_alloc", "free", "alloca", "strdup", "sbrk")
# The folders of firmware/ whose headers each folder may include.
MAY_INCLUDE = {
    "fx": ("fx/",),
    "objects": ("objects/", "fx/"),
    "core": ("core/", "objects/", "fx/"),
    "cycle": ("cycle/", "fx/"),
    "guard": ("guard/", "core/", "objects/", "fx/"),
    "drive": ("drive/", "cycle/", "guard/", "core/", "objects/", "fx/"),
    "canopen": ("canopen/", "objects/", "fx/"),
    "drive402": ("drive402/", "canopen/", "fx/"),
    "modbus": ("modbus/", "objects/", "fx/"),
    "storage": ("storage/", "canopen/", "core/", "objects/", "fx/"),
    "app": (
        "app/",
        "storage/",
        "modbus/",
        "canopen/",
        "drive/",
        "cycle/",
        "guard/",
        "core/",
        "objects/",
        "fx/",
    ),
}
# Functions of the compiler's library that a target may call. No target needs one.
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
FLOAT_WORD = re.compile(
    r"\b(float|double|_Complex|float_t|double_t|_Float\w+|_Decimal\w+|__fp16|__bf16|__float\w+"
    r"|__(?:FLT|DBL|LDBL|DEC|BFLT)\w*|__builtin_(?:inf|nan|huge_val)\w*)\b"
)
FLOAT_LITERAL = re.compile(
    r"(?<![\w.])(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?|(?<![\w.])\d+[eE][+-]?\d+|\b0[xX][\da-fA-F]*\.?"
    r"[\da-fA-F]*[pP]"
)
STATIC = re.compile(r"\b(static|_Thread_local|register)\b(?!\s+inline\b)(?P<rest>[^;{=(]*)")
SHIFT = re.compile(r"<<|>>|/|%")


# The beginning of a preprocessor directive, in every form that the preprocessor accepts.
HASH = r"^[ \t\f\v]*#"
TRIGRAPH = re.compile(r"\?\?[=/'()!<>-]")
DIGRAPH = re.compile(r"%:|<:|:>|<%|%>")


@functools.cache  # several rules read each file
def joined(text):
    """Text with continued lines made one; empty lines after them keep the numbers of the others."""

    def join(match):
        line = match.group(0)
        return re.sub(r"\\[ \t]*\n", "", line) + "\n" * line.count("\n")

    return re.sub(r"(?:[^\n]*\\[ \t]*\n)+[^\n]*", join, text)


@functools.cache
def without_comments(text, strings=False):
    """Text with comments and string contents blanked, line numbers kept. strings=True leaves the
    strings, and so the names of included headers."""

    def blank(match):
        found = match.group(0)
        if found.startswith(("/*", "//")):
            return re.sub(r"[^\n]", " ", found)
        return found if strings else found[0] + " " * (len(found) - 2) + found[-1]

    return re.sub(
        r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'", blank, text, flags=re.S
    )


@functools.cache
def included(text):
    """(line number, header, quoted or angled) of every include of a joined text; "?" for one that
    only the preprocessor can resolve."""
    code, found = without_comments(text, strings=True), []
    for match in re.finditer(HASH + r"\s*(?:include|include_next|import)\b([^\n]*)", code, re.M):
        line = code.count("\n", 0, match.start(1)) + 1
        header = re.fullmatch(r'\s*(?:"([^"]+)"|<([^>]+)>)\s*', match.group(1))
        if header is None:
            found.append((line, match.group(1).strip(), "?"))
        else:
            kind = '"' if header.group(1) else "<"
            found.append((line, header.group(1) or header.group(2), kind))
    return found


def read(path):
    return joined(path.read_text(encoding="utf-8"))


CONDITIONALS = ("if", "ifdef", "ifndef", "elif", "elifdef", "elifndef", "else")


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
        for m in re.finditer(HASH + r"\s*(\w+)([^\n]*)", code, flags=re.M)
    ]
    conditionals = [d for d in directives if d[0] in CONDITIONALS]
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
    text = read(path)
    code = without_comments(text)
    check_conditionals(path, code, findings)
    for pattern, where in ((TRIGRAPH, text), (DIGRAPH, code)):
        for match in pattern.finditer(where):
            line = where.count("\n", 0, match.start()) + 1
            findings.add(path, line, "spelling", f"{match.group(0)!r}")
    for line, header, kind in included(text):
        if kind == "?":
            findings.add(path, line, "spelling", f"computed include {header}")
        elif kind == "<":
            if header not in LIBC_HEADERS:
                findings.add(
                    path, line, "libc", f"<{header}> is not one of the headers that need no library"
                )
        elif not header.startswith(tuple("firmware/" + f for f in MAY_INCLUDE[folder])):
            findings.add(path, line, "layering", f"firmware/{folder} must not include {header}")
        elif header.removeprefix("firmware/") in HOST_ONLY:
            findings.add(path, line, "layering", f"{header} is for the host")
    # The remaining text consists of declarations and statements.
    body = re.sub(HASH + r"[ \t]*include\b[^\n]*", "", code, flags=re.M)
    for number, line in enumerate(body.split("\n"), 1):
        for pattern in (FLOAT_WORD, FLOAT_LITERAL):
            for match in pattern.finditer(line):
                findings.add(path, number, "float", f"{match.group(0)!r}")
        for match in re.finditer(r"\b(" + "|".join(HEAP) + r")\b", line):
            findings.add(path, number, "heap", f"{match.group(0)!r}")
        if folder != "fx":
            for match in SHIFT.finditer(line):
                findings.add(path, number, "shift", f"{match.group(0)!r} outside firmware/fx")
    for match in STATIC.finditer(body):
        # The name of a function is followed by its arguments. An object must be const.
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


def examine(source, root):
    """What the compiler makes of a source: (its errors, nm's (type, name) of every symbol, the
    first floating instruction)."""
    with tempfile.TemporaryDirectory() as folder:
        compiled = Path(folder) / "source.o"
        done = tool(*COMPILER, f"-I{root}", "-c", source, "-o", compiled)
        if done.returncode != 0:
            return done.stderr.strip().split("\n")[0], [], None
        symbols = [
            tuple(line.split()[-2:])
            for line in tool("arm-none-eabi-nm", compiled).stdout.splitlines()
        ]
        listing = tool("arm-none-eabi-objdump", "-d", "--no-show-raw-insn", compiled).stdout
    instructions = (line.split("\t")[1:2] for line in listing.splitlines())
    floating = (i[0].strip() for i in instructions if i and i[0].startswith("v"))
    return None, symbols, next(floating, None)


def check_objects(sources, root, findings):
    """What the source text can hide, the objects show. Returns which file calls which."""
    defined, undefined, called = {}, {}, {}
    for source in sources:
        complaint, symbols, floating = examine(source, root)
        if complaint is not None:
            findings.add(source, 0, "compile", complaint)
        for kind, name in symbols:
            if kind in "Uw":
                undefined.setdefault(name, source)
                called.setdefault(source, set()).add(name)
                continue
            defined[name] = source
            if kind in "bBdDcCsSgG":
                findings.add(source, 0, "static", f"{name} is mutable (nm type {kind})")
        if floating:
            findings.add(source, 0, "float", f"instruction {floating}")
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
    return {
        source: {defined[name] for name in names if name in defined}
        for source, names in called.items()
    }


def sources_below(folder):
    return sorted(p for p in folder.rglob("*") if p.suffix in SOURCE_SUFFIXES and p.is_file())


def check_includes(root, findings):
    """Includes stay in their part of the project and are written from its root."""
    sources = {part: sources_below(root / part) for part in ROOTS}
    project_headers = {p.name for paths in sources.values() for p in paths}
    for part, paths in sources.items():
        for path in paths:
            for line, header, kind in included(read(path)):
                if kind == "?":
                    findings.add(path, line, "spelling", f"computed include {header}")
                elif kind == "<" and not (
                    header.startswith(tuple(f"{r}/" for r in ROOTS)) or header in project_headers
                ):
                    continue  # a header of the system or of a library
                elif kind == "<":
                    findings.add(path, line, "layering", f"expected quotes around {header}")
                elif header == CHIP_HEADER and path.is_relative_to(root / "firmware" / PORTS):
                    continue
                elif ".." in Path(header).parts or not header.startswith(ROOTS[part]):
                    findings.add(
                        path,
                        line,
                        "layering",
                        f"{part} must not include {header}; expected {' or '.join(ROOTS[part])}...",
                    )


def circles(uses):
    """Each set of names that reach one another, of a mapping from a name to those that it uses."""

    def reached(name):
        seen, ahead = set(), [name]
        while ahead:
            for used in uses.get(ahead.pop(), ()):
                if used not in seen:
                    seen.add(used)
                    ahead.append(used)
        return seen

    reach = {name: reached(name) for name in uses}
    found = {
        tuple(sorted(other for other in reach[name] if name in reach.get(other, ())))
        for name in uses
        if name in reach[name]
    }
    return sorted(found)


def check_circles(root, calls, findings):
    """No file uses itself, by way of others, in the includes and in who calls whose function."""
    uses = {}

    def add(path, used):
        own, other = (p.relative_to(root).as_posix() for p in (path, used))
        if own != other:
            uses.setdefault(own, set()).add(other)

    for part in ROOTS:
        for path in sources_below(root / part):
            for _, header, kind in included(read(path)):
                if kind == '"' and (root / header).is_file():
                    add(path, root / header)
    for path, others in calls.items():
        for other in others:
            add(path, other)
    for names in circles(uses):
        findings.add(Path(names[0]), 0, "circle", "uses itself through " + ", ".join(names[1:]))
    check_module_circles(root, findings)


def check_module_circles(root, findings):
    """No module, NAME.h with NAME.c, includes itself through others."""
    uses = {}
    for folder in FOLDERS:
        for path in sources_below(root / "firmware" / folder):
            own = path.relative_to(root).with_suffix("").as_posix()
            for _, header, kind in included(read(path)):
                other = Path(header).with_suffix("").as_posix()
                if kind == '"' and other != own:
                    uses.setdefault(own, set()).add(other)
    for names in circles(uses):
        found = "the module includes itself through " + ", ".join(names[1:])
        findings.add(Path(names[0]), 0, "circle", found)


def folder_of(name):
    """The folder of FOLDERS or PORTS that a path below firmware/ lies in."""
    for folder in (*FOLDERS, PORTS):
        if name.startswith(folder + "/"):
            return folder
    return None


def main(argv=None):
    parser = argparse.ArgumentParser(description="prove what the firmware promises")
    parser.add_argument(
        "--root", type=Path, default=Path(__file__).resolve().parent.parent, help="project folder"
    )
    root = parser.parse_args(argv).root.resolve()
    findings = Findings(root)
    for part in (*(f"firmware/{f}" for f in FOLDERS), "sim", "host"):
        if not (root / part).is_dir() or not any((root / part).iterdir()):
            return fail(f"{root / part}: expected the project's sources")
    sources, count = [], 0
    for path in sorted((root / "firmware").rglob("*")):
        name = path.relative_to(root / "firmware").as_posix()
        folder = folder_of(name)
        if path.is_symlink():
            findings.add(path, 0, "folder", "expected no symbolic link")
        elif path.is_dir() or name in OTHER_FILES or name in HOST_ONLY or folder == PORTS:
            continue
        elif folder is None:
            findings.add(path, 0, "folder", "not in a folder of the firmware that is checked")
        elif path.suffix not in (".c", ".h"):
            findings.add(path, 0, "folder", "expected C sources only")
        else:
            count += 1
            check_text(path, folder, findings)
            if path.suffix == ".c":
                sources.append(path)
    calls = check_objects(sources, root, findings)
    check_includes(root, findings)
    check_circles(root, calls, findings)
    for line in findings.lines:
        print(line)
    if findings.lines:
        return 1
    print(f"firmware gates: {count} files, {len(sources)} objects, nothing found")
    return 0


if __name__ == "__main__":
    sys.exit(main())
