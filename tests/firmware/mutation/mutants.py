"""Small faults on one line of the firmware, each built alone and run against the unit tests.

usage: .venv/bin/python tests/firmware/mutation/mutants.py [--commit COMMIT] FILE:LINE...
       .venv/bin/python tests/firmware/mutation/mutants.py --campaign

FILE is a C file below firmware/ (guard/contact_guard.c). LINE counts in the tree as it is, or with
--commit in that commit; it is then looked for in the tree. --campaign runs the lines of
campaign.toml.

The mutants of a line: every relation made another one, && made || and back, each condition negated,
each number and named constant one more and one less, a copied value one more and one less, true
made false, the two bounds of a clamp and the two branches of ?: swapped, each statement deleted.

A mutant is compiled alone and linked before the library, so the unit tests of build/release run
with it and nothing else is built anew. Printed is "killed" with the first test that fails,
"refused" where the compiler does not take it, "equivalent" with the reason where campaign.toml
argues that no test can tell it from the firmware, or "survived". Exit status: 1 where one survived.

Before: cmake --build --preset release --target quick_programs
"""

import argparse
import difflib
import functools
import json
import re
import resource
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
BUILD = ROOT / "build/release"
CAMPAIGN = Path(__file__).with_name("campaign.toml")
# By the beginning of the file's name, those that are likely to kill first.
PROGRAMS = {
    "storage/archive": ("fw_unit", "store_unit"),
    "storage/": ("store_unit", "fw_unit"),
    "app/": ("fw_unit", "firmware_unit"),
    "canopen/": ("fw_unit", "canopen_unit"),
    "drive402/": ("drive402_unit",),
    "modbus/": ("modbus_unit", "fw_unit"),
    "": ("firmware_unit", "fw_unit"),
}
# Of the processor. A mutant may loop for ever; the slowest program takes a few seconds.
HANGS_S = 60

TOKEN = re.compile(
    r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*'|#[^\n]*"
    r"|[A-Za-z_]\w*|0[xX][0-9a-fA-F]+[uUlL]*|\d+[uUlL]*"
    r"|->|\+\+|--|<<=|>>=|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|\S",
    re.DOTALL,
)
RELATIONS = {
    "==": ("!=",),
    "!=": ("==",),
    "<": ("<=", ">", ">="),
    "<=": ("<", ">", ">="),
    ">": (">=", "<", "<="),
    ">=": (">", "<", "<="),
    "&&": ("||",),
    "||": ("&&",),
    "true": ("false",),
    "false": ("true",),
}
BOUNDED = ("fx_clamp", "fx_saturate", "fx_saturate_wide")
OPEN, CLOSE = "([{", ")]}"


class Unfit(Exception):
    """The line or the build cannot be used; the text says what to do."""


@dataclass(frozen=True)
class Token:
    """A piece of a C file: its text, place in the file and line, from 1."""

    text: str
    start: int
    end: int
    line: int


@dataclass(frozen=True)
class Mutant:
    """One change of a file: [start, end) becomes `text`."""

    start: int
    end: int
    text: str

    def of(self, source: str) -> str:
        """The whole file with the change."""
        return source[: self.start] + self.text + source[self.end :]

    def shown(self, source: str) -> str:
        """The changed lines in one, without their indentation."""
        begin = source.rfind("\n", 0, self.start) + 1
        end = source.find("\n", self.end)
        text = source[begin : self.start] + self.text + source[self.end : end]
        return " ".join(text.split()) or "(deleted)"


@dataclass(frozen=True)
class Place:
    """A line of a file below firmware/, and which tests to run first."""

    file: str
    line: int
    tests: str = "*"

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant: killed, refused, equivalent or survived, and by what or why."""

    what: str
    why: str


def tokens_of(source: str) -> list[Token]:
    """The tokens of a C file, without comments and directives."""
    found = []
    line, at = 1, 0
    for match in TOKEN.finditer(source):
        line += source.count("\n", at, match.start())
        at = match.start()
        if not match[0].startswith(("/*", "//", "#")):
            found.append(Token(match[0], match.start(), match.end(), line))
    return found


def partner(tokens: list[Token], at: int) -> int:
    """Index of the bracket that closes the one at `at`."""
    depth = 0
    for i in range(at, len(tokens)):
        depth += (tokens[i].text in OPEN) - (tokens[i].text in CLOSE)
        if depth == 0:
            return i
    raise Unfit(f"line {tokens[at].line}: a bracket that nothing closes")


def until(tokens: list[Token], at: int, ends: tuple[str, ...]) -> int:
    """Index of the first token of `ends` from `at` on that is in no bracket of its own."""
    i = at
    while tokens[i].text not in ends and tokens[i].text not in CLOSE:
        i = partner(tokens, i) + 1 if tokens[i].text in OPEN else i + 1
    return i


def begins_statement(tokens: list[Token], at: int) -> bool:
    """Whether the token is the first of a statement within a function."""
    before = tokens[at - 1].text if at else ""
    if before != ":":
        return before in (";", "{", "}", "else")
    i = at - 1
    while tokens[i].text not in (";", "{", "}", "case", "default", "?"):
        i -= 1
    return tokens[i].text in ("case", "default")


def relations(tokens: list[Token], at: int) -> Iterator[Mutant]:
    token = tokens[at]
    for other in RELATIONS.get(token.text, ()):
        yield Mutant(token.start, token.end, other)


def is_value(tokens: list[Token], at: int) -> bool:
    """Whether the token is a number, or a named constant that is not called."""
    text = tokens[at].text
    named = re.fullmatch(r"[A-Z][A-Z0-9_]{2,}", text) and text != "NULL"
    return bool(re.match(r"\d", text) or (named and tokens[at + 1].text != "("))


def one_off(tokens: list[Token], at: int) -> Iterator[Mutant]:
    """Numbers and constants, and a value that is copied as it is."""
    token = tokens[at]
    if is_value(tokens, at):
        for sign in "+-":
            yield Mutant(token.start, token.end, f"({token.text} {sign} 1)")
    if token.text == "=":
        end = until(tokens, at + 1, (";", ","))
        copied = range(at + 1, end)
        if not any(is_value(tokens, i) or tokens[i].text in "?<>!" for i in copied):
            for sign in "+-":
                yield Mutant(tokens[end].start, tokens[end].start, f" {sign} 1")


def condition_from(tokens: list[Token], at: int) -> tuple[int, int] | None:
    """[first, last] of the condition that the token at `at` opens."""
    text = tokens[at].text
    begins = text in ("&&", "||", "return")
    heads = text == "(" and tokens[at - 1].text in ("if", "while")
    declares = text == "=" and any(t.text == "bool" for t in tokens[max(0, at - 3) : at])
    if not (begins or heads or declares):
        return None
    first = at + 1
    last = until(tokens, first, ("&&", "||", "?", ";", ":", ",")) - 1
    return (first, last) if last >= first else None


def whole(tokens: list[Token], at: int, source: str) -> str:
    """What stands behind if, while or return: the bracket, or up to the semicolon."""
    if tokens[at].text == "return":
        return source[tokens[at].end : tokens[until(tokens, at + 1, (";",))].start]
    return source[tokens[at].end : tokens[partner(tokens, at + 1)].end]


def negations(tokens: list[Token], at: int, source: str) -> Iterator[Mutant]:
    if tokens[at].text == "!":
        yield Mutant(tokens[at].start, tokens[at].end, "")
    if tokens[at].text in ("if", "while", "return") and re.search(
        r"&&|\|\|", whole(tokens, at, source)
    ):
        start, end = tokens[at].end, tokens[at].end + len(whole(tokens, at, source))
        if tokens[at].text != "return" or returns_bool(source, start):
            yield Mutant(start, end, f" (!({source[start:end].strip()}))")
    condition = condition_from(tokens, at)
    if condition is None:
        return
    first, last = condition
    inside = [tokens[i].text for i in range(first, last + 1)]
    if inside[0] in ("!", "true", "false") or any(t in RELATIONS for t in inside):
        return  # the relation itself is turned
    if tokens[at].text == "return" and not returns_bool(source, tokens[at].start):
        return
    start, end = tokens[first].start, tokens[last].end
    yield Mutant(start, end, f"!({source[start:end]})")


def returns_bool(source: str, at: int) -> bool:
    """Whether the function around this place returns a bool."""
    heads = re.findall(r"^(?!enum|struct|typedef)(\w[\w \*]*?)\w+\(", source[:at], re.MULTILINE)
    return bool(heads) and heads[-1].split()[-1] == "bool"


def swaps(tokens: list[Token], at: int, source: str) -> Iterator[Mutant]:
    """The bounds of a clamp; the branches of a condition."""
    if tokens[at].text in BOUNDED:
        close = partner(tokens, at + 1)
        low = until(tokens, at + 2, (",",)) + 1
        high = until(tokens, low, (",",)) + 1
        first, second = (tokens[low].start, tokens[high - 1].start), (tokens[high].start, close)
        middle = source[first[1] : second[0]]
        end = tokens[close].start
        yield Mutant(first[0], end, source[second[0] : end] + middle + source[slice(*first)])
    if tokens[at].text == "?":
        colon = until(tokens, at + 1, (":",))
        last = until(tokens, colon + 1, (";", ",", ":")) - 1
        one = source[tokens[at + 1].start : tokens[colon - 1].end]
        other = source[tokens[colon + 1].start : tokens[last].end]
        yield Mutant(tokens[at + 1].start, tokens[last].end, f"{other} : {one}")


def deletions(tokens: list[Token], at: int) -> Iterator[Mutant]:
    token = tokens[at]
    if not begins_statement(tokens, at) or token.text in (*OPEN, *CLOSE, ";", "case", "default"):
        return
    if token.text in ("if", "while"):
        close = partner(tokens, at + 1)
        yield Mutant(tokens[at + 1].end, tokens[close].start, "0")
        return
    end = until(tokens, at, (";",))
    before = [t.text for t in tokens[:at]]
    is_last = before.count("{") - before.count("}") == 1 and tokens[end + 1].text == "}"
    if tokens[end].text != ";" or (token.text == "return" and is_last):
        return  # a function that ends without its value is no program
    declares = re.match(r"(const|static|bool|u?int\d+_t|\w+_t)$", token.text)
    if not declares:
        yield Mutant(token.start, tokens[end].end, ";")


def mutants_of(source: str, line: int) -> list[Mutant]:
    """Every mutant of a line, in the order of its places."""
    tokens = tokens_of(source)
    found: list[Mutant] = []
    for at, token in enumerate(tokens):
        if token.line != line:
            continue
        found += deletions(tokens, at)
        found += relations(tokens, at)
        found += negations(tokens, at, source)
        found += swaps(tokens, at, source)
        found += one_off(tokens, at)
    return [m for m in found if m.of(source) != source]


@functools.cache
def commands(build: Path) -> dict[str, dict[str, str]]:
    """How each C file is compiled in a build, by its path below firmware/."""
    path = build / "compile_commands.json"
    if not path.exists():
        raise Unfit(f"{path} is not there: run `cmake --preset {build.name}`")
    entries = json.loads(path.read_text())
    prefix = f"{ROOT}/firmware/"
    return {e["file"].removeprefix(prefix): e for e in entries if e["file"].startswith(prefix)}


@functools.cache
def link_command(program: str, build: Path) -> tuple[str, ...]:
    """The command that links a program of a build, up to its output."""
    asked = ["ninja", "-C", build, "-t", "commands", "-s", program]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    lines = [x for x in done.stdout.splitlines() if f"-o {program}" in x]
    if not lines:
        raise Unfit(f"{program}: ninja does not know how it is linked")
    command = lines[-1].removeprefix(": && ").split(" && ")[0]
    return tuple(shlex.split(command))


def compile_to(file: str, source: Path, target: Path, build: Path = BUILD) -> bool:
    """Compiles one file of the firmware with its own flags, but without warnings."""
    if file not in commands(build):
        raise Unfit(f"{file}: not a file of the firmware that {build} compiles")
    words = shlex.split(commands(build)[file]["command"])
    kept = [w for w in words[:-4] if w not in ("-Werror", "-O3")]
    command = [*kept, "-O1", "-w", "-o", str(target), "-c", str(source)]
    return subprocess.run(command, cwd=build, capture_output=True, check=False).returncode == 0


def link(
    program: str, mutant: Path, folder: Path, kind: str = "tests/firmware/unit", build: Path = BUILD
) -> Path:
    """A program of the tests with this object in place of the library's."""
    words = list(link_command(f"{kind}/{program}", build))
    executable = folder / program
    at = words.index("-o")
    words[at : at + 2] = [str(mutant), "-o", str(executable)]
    linked = subprocess.run(words, cwd=build, capture_output=True, text=True, check=False)
    if linked.returncode:
        raise Unfit(f"{program} does not link; build it first: {linked.stderr[-300:]}")
    return executable


def first_failure(executable: Path, tests: str) -> str | None:
    """The first of these tests (a filter of GoogleTest) that fails; None: all pass."""
    options = ("--gtest_brief=1", "--gtest_fail_fast", "--gtest_color=no")
    done = subprocess.run(
        [executable, *options, f"--gtest_filter={tests}"],
        cwd=executable.parent,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (HANGS_S, HANGS_S)),
    )
    if done.returncode == 0:
        return None
    failed = re.search(r"FAILED +\] (\w+\.\w+|\S+/\S+)", done.stdout)
    return failed[1] if failed else f"{executable.name}, which ends with {done.returncode}"


def try_source(file: str, text: str, tests: str) -> Outcome:
    """Builds one file with this text and runs the unit tests, those that `tests` selects first."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as name:
        folder = Path(name)
        source, target = folder / Path(file).name, folder / "mutant.o"
        source.write_text(text)
        if not compile_to(file, source, target):
            return Outcome("refused", "by the compiler")
        names = next(PROGRAMS[begin] for begin in PROGRAMS if file.startswith(begin))
        programs = [link(program, target, folder) for program in names]
        for selected in dict.fromkeys((tests, "*")):
            for executable in programs:
                killer = first_failure(executable, selected)
                if killer is not None:
                    return Outcome("killed", killer)
    return Outcome("survived", "")


def read(file: str) -> str:
    path = ROOT / "firmware" / file
    if path.suffix != ".c" or not path.is_file():
        raise Unfit(f"{file}: expected a C file below firmware/, as guard/contact_guard.c")
    return path.read_text()


def place_of(text: str, commit: str | None) -> Place:
    """FILE:LINE of the tree; of a commit, where that line stands in the tree today."""
    file, _, number = text.rpartition(":")
    if not file or not number.isdecimal():
        raise Unfit(f"{text}: expected FILE:LINE")
    line = int(number)
    lines = read(file).splitlines()
    if commit is not None:
        shown = subprocess.run(
            ["git", "show", f"{commit}:firmware/{file}"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        if shown.returncode:
            raise Unfit(f"{text}: git shows no such file in {commit}: {shown.stderr.strip()}")
        matcher = difflib.SequenceMatcher(None, shown.stdout.splitlines(), lines, autojunk=False)
        for old, new, size in matcher.get_matching_blocks():
            if old < line <= old + size:
                return Place(file, new + line - old)
        raise Unfit(f"{text}: changed since {commit}; give its line in the tree")
    if not 1 <= line <= len(lines):
        raise Unfit(f"{text}: the file has {len(lines)} lines")
    return Place(file, line)


def place_in_function(file: str, function: str, text: str, tests: str) -> Place:
    """The line of a function that has this text."""
    lines = read(file).splitlines()
    heads = [i for i, x in enumerate(lines) if re.match(rf"\w.*\b{function}\(.*[,{{]$", x)]
    for begin in heads:
        for i in range(begin, len(lines)):
            if lines[i].strip() == text:
                return Place(file, i + 1, tests)
            if lines[i] == "}":
                break
    raise Unfit(f"{file}: no line `{text}` in {function}(); bring campaign.toml up to date")


def campaign() -> tuple[list[Place], dict[tuple[str, str, str], str]]:
    """The lines of campaign.toml, and the reasons by (file, line, mutant)."""
    table = tomllib.loads(CAMPAIGN.read_text())
    places = [
        place_in_function(x["file"], x["function"], x["text"], x["tests"]) for x in table["line"]
    ]
    reasons = {
        (x["file"], x["line"], x["mutant"]): x["reason"] for x in table.get("equivalent", [])
    }
    return places, reasons


def outcomes_of(
    place: Place, reasons: dict[tuple[str, str, str], str]
) -> Iterator[tuple[str, Outcome]]:
    """Each mutant of a line as it is shown, and what became of it."""
    source = read(place.file)
    line = source.splitlines()[place.line - 1].strip()
    for mutant in mutants_of(source, place.line):
        shown = mutant.shown(source)
        outcome = try_source(place.file, mutant.of(source), place.tests)
        reason = reasons.get((place.file, line, shown))
        if outcome.what == "survived" and reason:
            outcome = Outcome("equivalent", reason)
        yield shown, outcome


def main() -> int:
    """Runs the mutants that the command line names; see the top of the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("lines", nargs="*", metavar="FILE:LINE")
    parser.add_argument("--commit", help="in which LINE counts, in place of the tree")
    parser.add_argument("--campaign", action="store_true", help="the lines of campaign.toml")
    arguments = parser.parse_args()
    try:
        places, reasons = campaign()
        if not arguments.campaign:
            places = [place_of(text, arguments.commit) for text in arguments.lines]
        if not places:
            raise Unfit("expected FILE:LINE or --campaign")
        counts: dict[str, int] = {}
        for file in dict.fromkeys(p.file for p in places):
            outcome = try_source(file, read(file), "*")
            if outcome.what != "survived":
                raise Unfit(f"{file} unchanged is {outcome.what} {outcome.why}: mend that first")
        for place in places:
            print(place, read(place.file).splitlines()[place.line - 1].strip(), flush=True)
            for shown, outcome in outcomes_of(place, reasons):
                counts[outcome.what] = counts.get(outcome.what, 0) + 1
                print(f"  {outcome.what:10} {shown}  {outcome.why}".rstrip(), flush=True)
    except Unfit as error:
        print(f"mutants: {error}", file=sys.stderr)
        return 2
    print(", ".join(f"{n} {what}" for what, n in sorted(counts.items())))
    return 1 if counts.get("survived") else 0


if __name__ == "__main__":
    sys.exit(main())
