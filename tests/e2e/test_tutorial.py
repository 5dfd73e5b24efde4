"""The README's tutorial, typed as printed there: its commands run and print what it shows."""

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from forceaxis.experiments import run as runs

ROOT = Path(__file__).resolve().parents[2]
HEADING = "## A stability verdict for your own axis in ten minutes\n"


def section():
    text = (ROOT / "README.md").read_text()
    return text.partition(HEADING)[2].partition("\n## ")[0]


def blocks():
    """Indented blocks in order; one that begins with a command is typed, any other is printed."""
    found = re.findall(r"(?:^    .*\n)+", section(), re.MULTILINE)
    return [re.sub(r"^    ", "", b, flags=re.MULTILINE).replace("\\\n", "") for b in found]


def is_typed(block):
    return block.startswith(("forceaxis ", "sed "))


@pytest.fixture(scope="module")
def typed(tmp_path_factory):
    """The folder after every command, and (printed block, what the commands above it printed)."""
    folder = tmp_path_factory.mktemp("tutorial")
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    printed, claims = "", []
    for block in blocks():
        if not is_typed(block):
            claims.append((block, printed))
            continue
        printed = ""
        for command in block.splitlines():
            done = subprocess.run(
                command, shell=True, cwd=folder, env=environment, capture_output=True, text=True
            )
            assert done.returncode == 0, (command, done.stdout, done.stderr)
            printed += done.stdout
    return folder, claims


def test_the_tutorial_uses_every_step():
    commands = "\n".join(b for b in blocks() if is_typed(b))
    for verb in ("new", "run", "sweep", "test"):
        assert f"forceaxis {verb} " in commands
    assert len([b for b in blocks() if not is_typed(b)]) == 6


def test_the_commands_print_what_the_text_shows(typed):
    for block, printed in typed[1]:
        for line in block.splitlines():
            assert line in printed.splitlines()


def test_the_files_are_where_the_text_says(typed):
    for name in re.findall(r"`(press/[^`]+\.\w+)`", section()):
        assert (typed[0] / name).stat().st_size > 0
    with (typed[0] / "press/map/results.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 16 * 12


def test_the_boundary_and_the_safe_gain_are_as_the_text_says(typed):
    boundary = float(re.search(r"at a gain of ([\d.]+\d)", section())[1])
    safe = float(re.search(r"force_gain = ([\d.]+)/'", section())[1])
    assert safe == boundary / 2
    contact = typed[0] / "press/contact.toml"

    def verdict(gain):
        return runs.run(contact, [f"firmware.force_gain={gain}"]).summary["verdict"]

    assert [verdict(boundary), verdict(boundary + 0.1)] == ["stable", "unstable"]
    assert f"force_gain = {safe}\n" in contact.read_text()
    # Between safe gain and boundary nothing is unstable.
    step = (boundary - safe) / 6
    assert {verdict(safe + k * step) for k in range(7)} == {"stable"}
