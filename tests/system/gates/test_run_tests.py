"""tools/run_tests.py: what counts as failed, and the second try of tests on real buses."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import durations
import pytest

ROOT = Path(__file__).resolve().parents[3]
pytestmark = pytest.mark.quick

ONCE = """
from pathlib import Path
import pytest

def test_passes():
    pass

def test_fails_at_its_first_try():
    mark = Path(__file__).with_name("tried")
    first = not mark.exists()
    mark.write_text("")
    assert not first, "late"
"""
TWICE = (
    ONCE
    + """
def test_fails_always():
    assert False, "wrong"

def test_is_skipped():
    pytest.skip("no bus")
"""
)

INTERRUPTED = """
import os, signal

def test_is_interrupted_at_its_second_try():  # as `timeout` does it
    mark = Path(__file__).with_name("interrupted")
    if mark.exists():
        os.kill(os.getpid(), signal.SIGINT)
    mark.write_text("")
    assert False, "late"
"""


@pytest.fixture
def gate(tmp_path, monkeypatch):
    """The module of tools/test, whose tree and build are an empty folder."""
    spec = importlib.util.spec_from_file_location("run_tests", ROOT / "tools/run_tests.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "BUILD", tmp_path)
    return module


def run(gate, tmp_path, text, twice):
    """A stage of pytest over a file of tests; its tally."""
    (tmp_path / "test_bus.py").write_text(text, encoding="utf-8")
    tally = gate.Tally()
    gate.pytest(tally, "alone", "not long", twice=twice)
    return tally


def test_a_test_that_fails_once_is_tried_again_and_named(gate, tmp_path, capfd):
    tally = run(gate, tmp_path, ONCE, twice=True)
    assert (tally.passed, tally.failed) == (2, 0)
    assert tally.end() == 0
    printed = capfd.readouterr().out
    assert "AssertionError: late" in printed  # of the first try
    assert "what failed is tried a second time" in printed
    assert "second tries: 1" in printed
    assert "test_bus test_fails_at_its_first_try: failed, then passed" in printed
    assert printed.splitlines()[-1] == "2 passed, 0 failed"


def test_a_test_that_fails_twice_and_one_that_is_skipped_are_failures(gate, tmp_path, capfd):
    tally = run(gate, tmp_path, TWICE, twice=True)
    assert (tally.passed, tally.failed) == (2, 2)
    assert tally.end() == 1
    printed = capfd.readouterr().out
    assert printed.count("AssertionError: wrong") >= 2  # both tries are shown
    assert "test_bus test_fails_always: failed, then failed again" in printed


@pytest.mark.parametrize("text", [TWICE, ONCE + INTERRUPTED], ids=["before a test", "in a test"])
def test_a_second_try_that_does_not_end_in_time_is_a_failure_by_name(
    gate, tmp_path, monkeypatch, capfd, text
):
    if text == TWICE:
        monkeypatch.setattr(gate, "SECOND_S", 0.01)
    tally = run(gate, tmp_path, text, twice=True)
    assert tally.passed == 1 and tally.failed >= 2
    assert tally.end() == 1
    name = "test_bus test_fails_at_its_first_try"
    assert f"{name}: failed, then did not end within" in capfd.readouterr().out


def test_other_stages_have_one_try(gate, tmp_path):
    tally = run(gate, tmp_path, ONCE, twice=False)
    assert (tally.passed, tally.failed, tally.second_tries) == (1, 1, [])


def test_a_run_that_does_not_end_as_pytest_does_is_a_failure(gate, tmp_path):
    text = (
        "import os\ndef test_passes():\n    pass\ndef test_ends_the_process():\n    os._exit(0)\n"
    )
    tally = run(gate, tmp_path, text, twice=True)
    assert tally.failed == 1


def test_promises_are_checked_against_the_stages_of_the_run(gate, tmp_path, monkeypatch, capfd):
    promise = {"part": "", "text": "", "tests": ["test_bus.py::test_passes"]}
    monkeypatch.setattr(gate.promises, "known", lambda: {"test_bus.py::test_passes": ""})
    monkeypatch.setattr(gate.promises, "load", lambda: {"P": promise})
    tally = run(gate, tmp_path, ONCE, twice=False)
    before = tally.failed
    gate.check_promises(tally)
    assert tally.failed == before
    promise["tests"] = ["test_bus.py::test_fails_at_its_first_try"]
    monkeypatch.setattr(gate.promises, "known", lambda: {promise["tests"][0]: ""})
    gate.check_promises(tally)
    assert tally.failed == before + 1
    assert "P: test_bus.py::test_fails_at_its_first_try: failed" in capfd.readouterr().out


def stages(**seconds):
    """Seconds of a folder in each of three stages; more of them with `more`."""
    table = {
        ("parallel", "tests/a"): 40.0,
        ("parallel", "tests/b"): 100.0,
        ("long", "tests/a"): 900.0,
    }
    return {
        key: s * seconds.get("slower", 1.0) + seconds.get(key[0], 0.0) for key, s in table.items()
    }


def reported(measured):
    return durations.report({key: (s, 1) for key, s in measured.items()}, stages())


def test_seconds_beyond_the_budget_of_an_issue_are_named_with_their_folder():
    assert not any("budget" in line for line in reported(stages()))
    measured = stages() | {("parallel", "tests/new"): 19.0}
    assert not any("budget" in line for line in reported(measured))
    measured["parallel", "tests/new"] = 21.0
    said = "budget: tools/test: 21 s more than recorded, expected at most 20 s (parallel tests/new"
    assert reported(measured)[-1].startswith(said)
    assert not any("budget" in line for line in reported(stages(long=179.0)))
    assert "budget: tools/test --all: 181 s more" in reported(stages(long=181.0))[-1]


def test_a_machine_that_is_slower_everywhere_exceeds_no_budget():
    measured = stages(slower=3.0)
    assert not any("budget" in line for line in reported(measured))
    measured["parallel", "tests/new"] = 61.0
    assert (
        "budget: tools/test: 61 s more than recorded, expected at most 60 s"
        in reported(measured)[-1]
    )


def test_a_stage_that_was_never_recorded_counts_for_no_budget():
    lines = reported(stages() | {("alone", "tests/wire"): 300.0})
    assert not any("budget" in line for line in lines)
    assert any(line.endswith("not recorded") for line in lines)


def test_recorded_seconds_are_those_of_the_run_and_other_stages_stay(tmp_path):
    table = tmp_path / "seconds.toml"
    table.write_text('[alone]\n"tests/wire" = 300.0\n')
    xml = tmp_path / "pytest-parallel.xml"
    cases = [
        ("tests.python.axis.test_x", 1.25),
        ("tests.python.axis.test_y", 2.0),
        ("tests.wire.test_z", 4.0),
    ]
    rows = (f'<testcase classname="{name}" name="test_a" time="{s}"/>' for name, s in cases)
    xml.write_text(f"<testsuite>{''.join(rows)}</testsuite>")
    durations.record(durations.by_folder(xml), table)
    assert durations.load(table) == {
        ("alone", "tests/wire"): 300.0,
        ("parallel", "tests/python/axis"): 3.2,
        ("parallel", "tests/wire"): 4.0,
    }


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        ("report: green only where the force is held\n\nIt was green at 715 N of 100 N.\n", ""),
        ("tools, docs: x\n\nWhy.\n# Please enter the message\n", ""),
        ("Merge front\n", ""),
        ("report: " + 65 * "x" + "\n\nWhy.\n", "at most 72 characters, got 73"),
        ("green only where the force is held\n\nWhy.\n", "`area: what`"),
        ("report: green\n", "a body that says why"),
        ("report: green\nWhy.\n", "an empty line after the subject"),
        ("report: green\n\n# Please enter the message\n", "a body that says why"),
    ],
)
def test_the_hook_for_messages_asks_for_a_short_subject_and_a_body(message, complaint, tmp_path):
    (tmp_path / "message").write_text(message)
    command = [sys.executable, ROOT / "tools/check_message", tmp_path / "message"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == bool(complaint) and done.stderr.count("\n") == bool(complaint)
    assert complaint in done.stderr


@pytest.mark.parametrize("file", [".pre-commit-config.yaml", ".github/workflows/ci.yml"])
def test_hooks_and_ci_call_the_quick_tests_and_no_other_host(file):
    text = (ROOT / file).read_text()
    assert "tools/test --quick" in text
    assert "://" not in text
    assert [line for line in text.splitlines() if "uses:" in line] == (
        ["      - uses: actions/checkout@v4"] if "workflows" in file else []
    )
