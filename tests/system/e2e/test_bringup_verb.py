"""`forceaxis axis bringup` at a terminal, with a simulated axis."""

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

from forceaxis.commission import bringup

FORCEAXIS = Path(sys.executable).parent / "forceaxis"


def at_a_terminal(answers, *arguments):
    """Exit status, standard output, and standard error, with answers that are typed ahead."""
    ours, theirs = pty.openpty()
    os.write(ours, answers)
    done = subprocess.run(
        [FORCEAXIS, "axis", "bringup", "--on", "sim:contact", *map(str, arguments)],
        stdin=theirs,
        capture_output=True,
        text=True,
        timeout=100,
    )
    os.close(ours)
    os.close(theirs)
    return done.returncode, done.stdout, done.stderr


def test_each_step_is_asked_judged_and_in_the_protocol(tmp_path):
    out = tmp_path / "protocol.json"
    steps = ("--step", "identity", "--step", "encoder", "--step", "can", "--out", out)
    status, shown, asked = at_a_terminal(b"many\n500\n\ns\n", *steps)
    assert status == 1
    verdicts = [tuple(line.split(": ")[0].split()) for line in shown.splitlines()]
    assert verdicts == [("passed", "identity"), ("failed", "encoder"), ("skipped", "can")]
    assert "0 counts in a turn: check the line receiver" in shown
    assert "expected a number in lines, got many" in asked
    assert "Turn the encoder by one turn" in asked
    protocol = json.loads(out.read_text())
    found = [(step["name"], step["verdict"]) for step in protocol["steps"]]
    assert found == [("identity", "passed"), ("encoder", "failed"), ("can", "skipped")]
    assert protocol["steps"][1]["values"] == {"counts": 0.0, "counts_expected": 2000.0}


def test_one_step_that_passes_is_no_complete_bring_up():
    status, shown, _ = at_a_terminal(b"", "--step", "identity")
    assert status == 1 and shown.split()[:3] == ["passed", "identity:", "firmware"]


def test_the_help_names_every_group_of_steps():
    done = subprocess.run([FORCEAXIS, "axis", "bringup", "--help"], capture_output=True, text=True)
    for name in bringup.STEPS:
        assert name in done.stdout
