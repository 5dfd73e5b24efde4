"""tests/findings.toml: each finding has a test that fails if it comes back, or a reason."""

import tomllib
from pathlib import Path

import promises
import pytest

ROOT = Path(__file__).resolve().parents[3]
TABLE = tomllib.loads((ROOT / "tests/findings.toml").read_text(encoding="utf-8"))
ROWS = [f"{letter}{number}" for letter, last in (("V", 16), ("N", 3), ("D", 12), ("C", 13))
        for number in range(1, last + 1)]  # fmt: skip
pytestmark = pytest.mark.quick


@pytest.fixture(scope="module")
def known():
    tests = promises.known()
    assert len(tests) > 2000
    return tests


def test_every_finding_has_its_row():
    assert list(TABLE) == ROWS


@pytest.mark.parametrize("row", ROWS)
def test_a_finding_names_tests_that_exist_or_a_reason(row, known):
    found = TABLE[row]
    assert set(found) <= {"now", "tests", "reason"} and found["now"]
    assert found.get("tests") or found.get("reason")
    assert promises.unknown({row: found}, known) == []
