"""The library says what is wrong with a value; only the command line names options and commands."""

import ast
import itertools
import json
import re
from pathlib import Path

import click
import pytest
import verbs
from forceaxis.axis.axis import Axis
from forceaxis.cli import common, main, moved
from forceaxis.pages import template
from forceaxis.pages.commands import ACTIONS, with_commands

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "host/python/forceaxis"
# Folders of C++ programs, which have options of their own.
PROGRAMS = ("gateway", "program", "axis_node", "plant_node", "axis_linux")
# An option, such as --out, and a command.
NAMED = re.compile(
    rf"(?<![\w-])--[a-z][a-z-]+|\bforceaxis ({'|'.join([*main.WORDS, *moved.COMMANDS])})\b"
)
OTHER_PROGRAM = re.compile(r"(tools/\w+|npm \w+)\s+--[a-z-]+")
COMMANDS = "pages/commands.py"  # names of commands for the terminal and for pages
OPTIONS = "words.py"  # option_words() makes options of a command line from arguments
GENERATED = "bus/messages"  # from the comments of host/lcm/*.lcm
pytestmark = pytest.mark.quick


def is_word_of_program(node):
    """Whether a node is an option alone, as in a list of words that starts another program."""
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and bool(re.fullmatch(r"--[a-z-]+", node.value))
    )


def texts(source):
    """[(line, text)] of each string of a source, with "value" for each value of a format string.
    Options in a list, or appended to one, start another program, such as axis_node, and are left
    out."""
    tree = ast.parse(source)
    known = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.List | ast.Tuple):
            known |= {id(word) for word in node.elts if is_word_of_program(word)}
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "append":
            known |= {id(word) for word in node.args if is_word_of_program(word)}
        elif isinstance(node, ast.JoinedStr):
            pieces = [p.value if isinstance(p, ast.Constant) else "value" for p in node.values]
            known |= {id(p) for p in node.values}
            yield node.lineno, "".join(pieces)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in known:
            yield node.lineno, node.value


def named_in(source):
    """[(line, words)] of each option and command that a string of a source names."""
    for line, text in texts(source):
        for found in NAMED.finditer(OTHER_PROGRAM.sub("", text)):
            yield line, found[0]


# A comment, a character or a string of C++. Adjacent strings are one text.
TOKEN = re.compile(r'//[^\n]*|\'(?:\\.|[^\'\\\n])+\'|(?:"(?:\\.|[^"\\\n])*"\s*)+')


def named_in_cpp(source):
    """[(line, words)] of each option and command that a string of a C++ source names."""
    for token in TOKEN.finditer(source):
        if token[0].startswith('"') and "#include" not in source[: token.start()].split("\n")[-1]:
            text = re.sub(r'"\s*"', "", token[0])
            for found in NAMED.finditer(text):
                yield source.count("\n", 0, token.start()) + 1, found[0]


def cpp_library():
    return [
        path
        for folder in ("host", "sim")
        for path in sorted((ROOT / folder).rglob("*.[ch]pp"))
        if path.relative_to(ROOT / folder).parts[0] not in PROGRAMS
    ]


def library():
    files = {path: path.relative_to(PACKAGE).as_posix() for path in sorted(PACKAGE.rglob("*.py"))}
    return [
        path
        for path, name in files.items()
        if not name.startswith(("cli/", COMMANDS, OPTIONS, GENERATED))
    ]


def test_the_library_names_no_option_and_no_command():
    named = [
        f"{path.relative_to(PACKAGE)}:{line}: {words}"
        for path in library()
        for line, words in named_in(path.read_text())
    ]
    assert not named, "\n".join(named)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('raise InputError("x: use --out")', ["--out"]),
        ('raise InputError("--out")', ["--out"]),
        ('raise InputError("x: add " + "--out")', ["--out"]),
        ('raise InputError(f"{x}: add --{name}")', ["--value"]),
        ('f"{x}: `forceaxis axis reset` resets it"', ["forceaxis axis"]),
        ('def f():\n    """As `forceaxis limit` prints it."""', ["forceaxis limit"]),
        ('run(["axis_node", "--can", "vcan0"])', []),
        ('"`tools/setup --tests` builds it"', []),
        ('"the version of forceaxis that fits; a well-known --"', []),
    ],
)
def test_what_names_an_option_or_a_command(text, named):
    assert [words for _, words in named_in(text)] == named


def test_the_library_in_cpp_names_no_option_and_no_command():
    files = cpp_library()
    assert len(files) > 100
    named = [
        f"{path.relative_to(ROOT)}:{line}: {words}"
        for path in files
        for line, words in named_in_cpp(path.read_text())
    ]
    assert not named, "\n".join(named)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('fail("x: use --out");', ["--out"]),
        ('fail("lists `forceaxis "\n     "objects`");', ["forceaxis objects"]),
        ("char q = '\"'; // as --out", []),
        ("// `forceaxis run` and --out", []),
        ('#include "forceaxis run.hpp"', []),
        ('node.value == "forceaxis gateway of a bus"', ["forceaxis gateway"]),
        ('f("\\"", "--json")', ["--json"]),
        ("--i; a --b;", []),
    ],
)
def test_what_names_an_option_or_a_command_in_cpp(text, named):
    assert [words for _, words in named_in_cpp(text)] == named


def test_each_action_that_the_library_names_is_a_command_that_exists():
    texts = "".join(path.read_text() for path in [*library(), *cpp_library()])
    for action, words in ACTIONS.items():
        assert f"`{action}`" in texts, action
        command = main.cli
        for word in itertools.takewhile(str.islower, words.split()):
            command = command.get_command(click.Context(command), word)
            assert command is not None, words
    text = "a `axis.reset_fault()` b `force` `list_objects`"
    assert with_commands(text) == "a `forceaxis axis reset` b `force` `forceaxis objects`"
    with_axis = "a `forceaxis axis reset --on can0:5` b `force` `forceaxis objects`"
    assert with_commands(text, "--on can0:5") == with_axis


def test_a_method_of_an_axis_that_a_text_names_exists():
    named = {
        name for path in library() for name in re.findall(r"`axis\.(\w+)\(\)`", path.read_text())
    }
    assert {"stop", "start", "reset_fault"} <= named
    for name in named:
        assert callable(getattr(Axis, name)) and f"axis.{name}()" in ACTIONS


def test_a_page_has_commands_for_actions_and_escapes_the_rest():
    page = template.template("tuning").environment.from_string("<p>{{ text }}</p>{{ page | safe }}")
    shown = page.render(text="`list_objects` <b>", page="<i>`force`</i>")
    assert shown == "<p>`forceaxis objects` &lt;b&gt;</p><i>`force`</i>"


def test_json_has_options_for_parameters(capsys):
    @click.command()
    @click.option("--force")
    def command(force):
        common.print_json({"text": "`forces_N` is missing, `list_objects`"})

    command.main(["--force", "3"], standalone_mode=False)
    assert capsys.readouterr().out == '{"text": "--force is missing, `list_objects`"}\n'


def test_json_has_the_address_of_the_axis_in_each_command(capsys):
    @click.command()
    def command():
        common.set_axis_option("""--on 'sim:a"b'""")
        common.print_json({"text": "then `axis.reset_fault()`"})

    command.main([], standalone_mode=False)
    text = json.loads(capsys.readouterr().out)["text"]
    assert text == """then `forceaxis axis reset --on 'sim:a"b'`"""


def test_the_program_prints_commands_for_actions_and_options_for_parameters(tmp_path):
    done = verbs.forceaxis("run", "contact", "--set", "firmware.force_gian=1")
    assert "`forceaxis objects` lists them" in done.stderr
    (tmp_path / "x.csv").write_text("t,F\n0,1\n1,2\n")
    words = ("recording", "import", tmp_path / "x.csv", "--out", tmp_path / "r")
    assert "--map: expected a column" in verbs.forceaxis(*words, "--map", "force=c:N").stderr
