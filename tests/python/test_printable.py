"""Texts of buses and files do nothing on a terminal but show (FINDINGS row D7)."""

import io
import re

import click
import pytest
from forceaxis.bus import lcm, messages
from forceaxis.cli import common
from forceaxis.words import printable
from verbs import forceaxis

CLIPBOARD = "\x1b]52;c;cm0gLXJmIH4=\x07"  # OSC 52: writes the operator's clipboard
CLEAR = "\x1b[2J\x1b[H"
C1 = "\x9b2J"  # CSI as one character
HOSTILE = ("\x1b[8m", CLIPBOARD, CLEAR, C1, "\x08\x08", "\x7f", "\u202e", "\x1bc", "\x0e")
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]")


@pytest.mark.parametrize("text", HOSTILE)
def test_what_a_terminal_obeys_is_shown(text):
    shown = printable(f"a{text}b")
    assert not OBEYED.search(shown)
    assert shown.startswith("a") and shown.endswith("b") and len(shown) > 3


def test_ordinary_texts_stay():
    text = "Kraft 5 N, 20 µm, Ω, 中文, 1 %"
    assert printable(text) == text
    assert printable("a\nb\tc", keep="\n\t") == "a\nb\tc"
    assert printable("a\nb") == "a\\nb"


def test_texts_of_lcm_messages_are_printable():
    event = messages.axis_event_t()
    event.text = f"fault {CLIPBOARD}{CLEAR}"
    event.object, event.value, event.num_items = [f"force{C1}"], [1], 1
    read = lcm.decode("FORCEAXIS_1_EVENT", event.encode())
    assert not OBEYED.search(read.text + "".join(read.object))
    assert "fault" in read.text and "\\x1b" in read.text


def printed(text, terminal=True):
    """What a stream that is a terminal gets when a verb prints `text`."""
    raw = io.BytesIO()
    below = io.TextIOWrapper(raw, encoding="utf-8")
    stream = common.Printed(below)
    stream.isatty = lambda: terminal
    click.echo(text, file=stream)
    return raw.getvalue().decode()


@pytest.mark.parametrize("text", HOSTILE)
def test_a_verb_prints_no_foreign_control_sequence(text):
    assert not OBEYED.search(printed(f"title {text}"))


def test_colours_and_the_line_of_progress_pass():
    assert printed(click.style("stable", fg="green", bold=True)) == "\x1b[32m\x1b[1mstable\x1b[0m\n"
    assert printed("\r\x1b[2Kdesign, 3 s") == "\r\x1b[2Kdesign, 3 s\n"


@pytest.mark.parametrize("verb", ["run", "poles", "objects"])
def test_texts_of_files_are_printable_whatever_prints_them(tmp_path, verb):
    name = tmp_path / f"x{CLEAR}.toml"
    done = forceaxis(verb, str(name))
    assert done.returncode == 2
    assert not OBEYED.search(done.stdout + done.stderr.replace("\n", ""))
    name.write_text(
        f'title = "{"a" * 3}\\u001b]52;c;AAAA\\u0007"\n[parameters]\n"k\\u009b2J" = 1\n'
    )
    done = forceaxis(verb, str(name))
    assert not OBEYED.search(done.stdout + done.stderr.replace("\n", ""))
