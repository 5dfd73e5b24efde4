"""The library says what is wrong with a value; only the command line names options and commands."""

import ast
import itertools
import re
from pathlib import Path

import click
import pytest
import verbs
from forceaxis.cli import main, moved
from forceaxis.cli.common import ACTIONS, with_commands

PACKAGE = Path(__file__).resolve().parents[3] / "host/python/forceaxis"
# An option, such as --out, and a command.
NAMED = re.compile(
    rf"(?<![\w-])--[a-z][a-z-]+|\bforceaxis ({'|'.join([*main.WORDS, *moved.COMMANDS])})\b"
)
OTHER_PROGRAM = re.compile(r"(tools/\w+|npm \w+)\s+--[a-z-]+")
GENERATED = "bus/messages"  # from the comments of host/lcm/*.lcm
pytestmark = pytest.mark.quick


def named_in(source):
    """[(line, words)] of each option and command that a string of the source names, without the
    words of a list, which starts another program, such as axis_node."""
    tree = ast.parse(source)
    words_of_programs = {
        id(constant)
        for node in ast.walk(tree)
        if isinstance(node, ast.List | ast.Tuple | ast.Call)
        for constant in ast.walk(node)
        if isinstance(constant, ast.Constant)
        and isinstance(constant.value, str)
        and re.fullmatch(r"--[a-z-]+", constant.value)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if id(node) in words_of_programs:
                continue
            for found in NAMED.finditer(OTHER_PROGRAM.sub("", node.value)):
                yield node.lineno, found[0]


def library():
    files = {path: path.relative_to(PACKAGE).as_posix() for path in sorted(PACKAGE.rglob("*.py"))}
    return [path for path, name in files.items() if not name.startswith(("cli/", GENERATED))]


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
        ('f"{x}: `forceaxis axis reset` resets it"', ["forceaxis axis"]),
        ('def f():\n    """As `forceaxis limit` prints it."""', ["forceaxis limit"]),
        ('run(["axis_node", "--can", "vcan0"])', []),
        ('"`tools/setup --tests` builds it"', []),
        ('"the version of forceaxis that fits; a well-known --"', []),
    ],
)
def test_what_names_an_option_or_a_command(text, named):
    assert [words for _, words in named_in(text)] == named


def test_each_action_that_the_library_names_is_a_command_that_exists():
    texts = "".join(path.read_text() for path in library())
    for action, words in ACTIONS.items():
        assert f"`{action}`" in texts, action
        command = main.cli
        for word in itertools.takewhile(str.islower, words.split()):
            command = command.get_command(click.Context(command), word)
            assert command is not None, words
    assert with_commands("a `reset_fault` b `force`") == "a `forceaxis axis reset` b `force`"


def test_the_program_prints_commands_for_actions_and_options_for_parameters(tmp_path):
    done = verbs.forceaxis("run", "contact", "--set", "firmware.force_gian=1")
    assert "`forceaxis objects` lists them" in done.stderr
    (tmp_path / "x.csv").write_text("t,F\n0,1\n1,2\n")
    words = ("recording", "import", tmp_path / "x.csv", "--out", tmp_path / "r")
    assert "--map: expected a column" in verbs.forceaxis(*words, "--map", "force=c:N").stderr
