"""tests/promises.toml: tests that ran and passed hold each promise of docs/guide/proofs.md."""

import promises
import pytest

pytestmark = pytest.mark.quick
PASSES, FAILS, SKIPPED = "tests/test_a.py::test_x", "tests/test_a.py::test_y", "ctest:Fw.Stops"
FLAKY, NEVER = "tests/test_a.py::test_z", "fuzz:sdo_fuzz"
FIRST = """<testsuites><testsuite>
<testcase classname="tests.test_a" name="test_x[1]"/>
<testcase classname="tests.test_a" name="test_x[2]"/>
<testcase classname="tests.test_a" name="test_y[1]"/>
<testcase classname="tests.test_a" name="test_y[2]"><failure/></testcase>
<testcase classname="tests.test_a" name="test_z"><failure/></testcase>
<testcase classname="All/Fw.Stops/4 &lt;01-00&gt;" name="All/Fw.Stops/4 &lt;01-00&gt;">
<skipped/></testcase>
</testsuite></testsuites>"""
SECOND = '<testsuite><testcase classname="tests.test_a" name="test_z"/></testsuite>'


def test_every_promise_has_tests_that_exist():
    rows, tests = promises.load(), promises.known()
    assert len(rows) > 30 and promises.faults(rows, tests) == []


def test_the_page_is_that_of_the_table():
    assert promises.main(["--check"]) == 0


@pytest.mark.parametrize(
    ("tests", "says"),
    [
        ([], "P: expected at least one test"),
        (["tests/test_a.py::test_none"], "P: tests/test_a.py::test_none: expected a test"),
        (["ctest:Fw.None"], "P: ctest:Fw.None: expected a test"),
    ],
)
def test_a_promise_that_nothing_holds_is_found(tests, says):
    (line,) = promises.faults({"P": {"tests": tests}}, {PASSES: "tests/test_a.py"})
    assert line.startswith(says)


def test_each_kind_of_test_is_known():
    tests = promises.known()
    for test in (
        "ctest:Store.ASetOfVersion010Loads", "ctest:DampedContact.TouchReleaseAndSeparation",
        "ctest:wide_sweep", "ctest:fuzz_corpus_sdo", "fuzz:sdo_fuzz",
        "tests/system/gates/test_promises.py::test_each_kind_of_test_is_known",
    ):  # fmt: skip
        assert test in tests


@pytest.fixture
def junit_files(tmp_path):
    (tmp_path / "first.xml").write_text(FIRST)
    (tmp_path / "second.xml").write_text(SECOND)
    return tmp_path / "first.xml", tmp_path / "second.xml"


@pytest.mark.parametrize(
    ("test", "says"),
    [
        (PASSES, None),
        (FLAKY, None),  # it passed when it was tried a second time
        (FAILS, "failed or was skipped"),
        (SKIPPED, "failed or was skipped"),
        (NEVER, "did not run"),
    ],
)
def test_a_promise_is_held_by_tests_that_ran_and_passed(junit_files, test, says):
    lines = promises.unproven({"P": {"tests": [test]}}, [junit_files])
    assert lines == ([f"P: {test}: {says}"] if says else [])


def test_a_page_that_is_not_fresh_is_found(tmp_path, monkeypatch, capsys):
    (tmp_path / "proofs.md").write_text(promises.PAGE.read_text() + "\n")
    monkeypatch.setattr(promises, "PAGE", tmp_path / "proofs.md")
    assert promises.main(["--check"]) == 1
    assert "not fresh" in capsys.readouterr().err


def test_results_are_given_as_files(junit_files, capsys):
    assert promises.main(["--results", str(junit_files[0])]) == 1
    assert "did not run" in capsys.readouterr().err
