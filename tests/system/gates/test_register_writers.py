"""No register of a chip is read, changed and written where something of a higher priority writes it
as well: an interrupt between the read and the write would be undone. The sources of the released
images are read behind the preprocessor, so that macros of the chip are registers; `thread` and
`levels` of board.toml say from where a function is reached.

A register that has bits for several users is written by one priority alone, or has addresses at
which writing 0 does nothing, such as those of NVIC and the set and reset registers of the ports.
"""

import functools
import re
import subprocess
from pathlib import Path

import pytest
from forceaxis.chip import board as boards

ROOT = Path(__file__).resolve().parents[3]
PORTS = ROOT / "firmware/port"
BOARDS = [b for b in boards.known(PORTS) if b.stack is not None and (b.folder / "chip.h").is_file()]

HEAD = re.compile(
    r"^(?!typedef|struct|enum|extern)[\w*][^;={}]*?\b(\w+)\(([^;{}]*)\)[^;{}()]*\{", re.M
)
CALL = re.compile(r"\b([a-z]\w*)\s*\(")
POINTER = re.compile(r"\b(\w+_t) \*(?:const )?(\w+)\b")
# A pointer and a member of it in capitals: ((exti_t *)0x40013C00)->IMR, line->registers->CCCR.
PLACE = r"(?:\(\((\w+_t) \*\)(\w+)\)|\b((?:\w+->)*\w+))->([A-Z][A-Z0-9_]*)"
CHANGE = re.compile(PLACE + r"\s*(?:[|&^+-]=)")
WRITE = re.compile(PLACE + r"\s*=(?!=)([^;]*);")
KEPT = re.compile(r"\b(\w+)\s*=(?!=)([^;]*);")  # what a variable is set to
ALIAS = re.compile(r"typedef (\w+_t) (\w+_t);")
READ = re.compile(PLACE)
PASSED = re.compile(r"(\w+)\s*\(\s*&" + PLACE)


def preprocessed(board, source):
    """The text of a source as the compiler of the board sees it, without what it includes."""
    command = [
        board.build.tools + "gcc", *board.build.flags, "-E", "-std=c11", "-I.", "-iquote",
        board.folder, source,
    ]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    own, keep = [], False
    for line in done.stdout.splitlines():
        if line.startswith("# "):
            name = line.split('"')[1]
            # An inline function of a header of the ports belongs to what includes it.
            keep = "firmware/port" in name or Path(name).name == "chip.h"
        elif keep:
            own.append(line)
    return "\n".join(own)


def body_at(text, begin):
    """The text of a function from its first brace on."""
    depth = 0
    for at in range(begin, len(text)):
        depth += {"{": 1, "}": -1}.get(text[at], 0)
        if depth == 0:
            return text[begin : at + 1]
    return text[begin:]


class File:
    """What the functions of a file have in common."""

    def __init__(self, path, text):
        self.path = path
        self.types = {variable: kind for kind, variable in POINTER.findall(text)}
        self.aliases = {alias: kind for kind, alias in ALIAS.findall(text)}
        self.by_reference = set(re.findall(r"\b(\w+)\(reg_t \*", text))


class Function:
    def __init__(self, file, name, parameters, body):
        self.file, self.source, self.name = file, file.path, name
        self.calls = set(CALL.findall(body))
        self.types = {variable: kind for kind, variable in POINTER.findall(parameters + body)}
        self.changed = {self.key(match.groups()) for match in CHANGE.finditer(body)}
        self.changed |= {
            self.key(match.groups()[1:])
            for match in PASSED.finditer(body)
            if match.group(1) in file.by_reference
        }
        self.written = set(self.changed)
        held = {}  # variable: registers of which it has bits
        for match in KEPT.finditer(body):
            held.setdefault(match.group(1), set()).update(self.read(match.group(2)))
        for match in WRITE.finditer(body):
            key, value = self.key(match.groups()[:4]), match.group(5)
            variables = [held.get(word, set()) for word in re.findall(r"\w+", value)]
            self.written.add(key)
            if key in self.read(value).union(*variables):
                self.changed.add(key)

    def read(self, text):
        return {self.key(match.groups()) for match in READ.finditer(text)}

    def key(self, groups):
        """(kind or address, register); a pointer whose kind is not known has its name."""
        kind, address, pointer, register = groups
        if address:
            return f"{kind} at {address}", register
        name = pointer.split("->")[-1]
        kind = self.types.get(name) or self.file.types.get(name, name)
        return self.file.aliases.get(kind, kind), register


def functions_of(board):
    """{name: [functions]} of the sources of the released image that belong to ports."""
    sources = [*board.build.sources, *(board.released.sources if board.released else [])]
    texts = {}
    for name in sources:
        path = boards.source(PORTS, board.folder, name)
        texts[path] = preprocessed(board, path)
    texts[PORTS / "main.c"] = preprocessed(board, PORTS / "main.c")
    found = {}
    for path, text in texts.items():
        file = File(path, text)
        for match in HEAD.finditer(text):
            if match.group(1) in ("if", "while", "for", "switch"):
                continue
            body = body_at(text, match.end() - 1)
            function = Function(file, match.group(1), match.group(2), body)
            found.setdefault(match.group(1), []).append(function)
    return found


def reached(found, roots, indirect):
    """The functions that are reached from these names: of several with a name, first those of the
    caller's file."""
    seen, left = [], [f for name in roots for f in found.get(name, [])]
    while left:
        function = left.pop()
        if function in seen:
            continue
        seen.append(function)
        file = function.source.relative_to(ROOT).as_posix()
        for name in function.calls | set(indirect.get(file, [])):
            named = found.get(name, [])
            left += [f for f in named if f.source == function.source] or named
    return seen


def levels_of(board, found):
    """[functions of the thread, of the tick, ...], from the lowest priority to the highest one.
    The thread also starts from main() and from functions that the portable code calls through
    pointers, such as those of the flash."""
    stack = board.stack
    pointers = {name for names in stack.indirect.values() for name in names}
    # The portable code between the ports' main() and its own calls has no registers.
    thread = reached(found, [stack.thread, "reset", "main", *sorted(pointers)], stack.indirect)
    return [thread, *(reached(found, level, stack.indirect) for level in stack.levels)]


def is_same(first, second):
    """Whether two keys may be one register: a pointer of a kind may be any peripheral of it."""
    kinds = [key[0].split(" at ") for key in (first, second)]
    return (
        first[1] == second[1]
        and kinds[0][0] == kinds[1][0]
        and (len(kinds[0]) + len(kinds[1]) < 4 or kinds[0][1] == kinds[1][1])
    )


def conflicts(board):
    """Lines about registers that a function changes which a higher priority may interrupt to write
    the same register."""
    found = functions_of(board)
    levels = levels_of(board, found)
    lines = set()
    for low, functions in enumerate(levels):
        above = [f for level in levels[low + 1 :] for f in level]
        for function in functions:
            for key in function.changed:
                for other in above:
                    if any(is_same(key, written) for written in other.written):
                        lines.add(
                            f"{key[0]}->{key[1]}: changed in {function.name}(), which "
                            f"{other.name}() may interrupt to write it"
                        )
    return sorted(lines), levels


@functools.cache
def result_of(folder):
    return conflicts(boards.read(folder))


@pytest.mark.quick
@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.name)
def test_no_register_is_changed_below_another_writer_of_it(board):
    lines, levels = result_of(board.folder)
    assert lines == []
    # The test has seen what it is about: registers at each level, also behind pointers and macros.
    counts = [len({key for f in level for key in f.written}) for level in levels]
    assert counts[0] > 60 and counts[1] > 8 and counts[2] > 8 and counts[3] >= 2, counts
    tick = {key for f in levels[1] for key in f.written}
    assert any(register == "ISER0" for _, register in tick)
    assert any(kind in ("can_t", "fdcan_t") for kind, _ in tick)
