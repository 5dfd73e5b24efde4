"""tests/wire/steps.py: a failure in a session on a bus fails the tests of its own step."""

import subprocess
from pathlib import Path

import pytest
from steps import found_by, run

SESSION = f"""
import os, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from steps import Steps

def late():
    raise RuntimeError("no capture")

with Steps(sys.argv[1]) as steps:
    steps["first"] = 1
    steps("late", late)
    steps("after", lambda: steps["first"] + 1)
    {{}}
    steps["never"] = 3
"""
DEATHS = {
    "error": "raise ValueError('the bus is down')",
    "kill": "os.kill(os.getpid(), 9)",
    "status": "steps['never'] = 3; sys.exit(5)",
}


def here(words, _seconds):
    return subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)


def session(folder, end=""):
    file = folder / "session.py"
    file.write_text(SESSION.format(end))
    return file


def failure(found, name):
    with pytest.raises(pytest.fail.Exception) as caught:
        found[name]
    return str(caught.value)


def test_a_step_that_fails_fails_alone_with_its_error(tmp_path):
    found = run(here, tmp_path, 60, session(tmp_path))
    assert (found["first"], found["after"], found["never"]) == (1, 2, 3)
    assert "late: Traceback" in failure(found, "late")
    assert "RuntimeError: no capture" in failure(found, "late")
    found.expect_end()
    with pytest.raises(KeyError):
        found["no such step"]


def test_a_step_that_fails_and_that_no_test_reads_fails_the_last_test(tmp_path, monkeypatch):
    monkeypatch.delenv("FORCEAXIS_SOME_TESTS", raising=False)
    found = run(here, tmp_path, 60, session(tmp_path))
    with pytest.raises(pytest.fail.Exception, match="late: Traceback"):
        found.expect_end()
    monkeypatch.setenv("FORCEAXIS_SOME_TESTS", "1")
    found.expect_end()


@pytest.mark.parametrize(
    ("end", "why"), [("error", "ValueError: the bus is down"), ("kill", "status -9 after after")]
)
def test_the_error_of_a_session_is_told_once_and_other_steps_name_it_in_a_line(tmp_path, end, why):
    found = run(here, tmp_path, 60, session(tmp_path, DEATHS[end]))
    assert (found["first"], found["after"]) == (1, 2)
    assert why in failure(found, "never")
    later = failure(found, "later")
    assert later.startswith("later was not reached: the session ended with status ")
    assert later.endswith("after after") and "\n" not in later
    found.expect_end()


def test_a_session_that_dies_after_its_last_step_fails_the_last_test(tmp_path):
    fixture = found_by(here, tmp_path, 60, session(tmp_path, DEATHS["status"]))
    assert next(fixture)["never"] == 3
    with pytest.raises(pytest.fail.Exception, match="ended with status"):
        next(fixture)


def test_a_session_that_does_not_begin_or_whose_guest_hangs_is_told(tmp_path):
    file = tmp_path / "session.py"
    file.write_text("import no_such_module")
    assert "No module named 'no_such_module'" in failure(run(here, tmp_path, 60, file), "first")

    def hangs(words, seconds):
        raise TimeoutError("no answer of the guest")

    assert "no answer of the guest" in failure(run(hangs, tmp_path, 60, file), "first")


def test_half_a_line_of_a_killed_session_is_left_out(tmp_path):
    file = session(tmp_path, "steps._file.open('a').write('{\"step\": '); " + DEATHS["kill"])
    assert run(here, tmp_path, 60, file)["after"] == 2
