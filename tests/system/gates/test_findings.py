"""tests/findings.toml: each finding has a test that fails if it comes back, or a reason."""

import tomllib
from pathlib import Path

import promises
import pytest

ROOT = Path(__file__).resolve().parents[3]
TABLE = tomllib.loads((ROOT / "tests/findings.toml").read_text(encoding="utf-8"))
# Letter, number of the first and of the last row of each round.
ROUNDS = {
    "2026-11-24": (("V", 1, 16), ("N", 1, 3), ("D", 1, 12), ("C", 1, 13)),
    "2026-11-28": (("S", 0, 10), ("B", 1, 14), ("N", 1, 7), ("L", 1, 5), ("I", 1, 4)),
}
ROWS = [
    (date, f"{letter}{number}")
    for date, groups in ROUNDS.items()
    for letter, first, last in groups
    for number in range(first, last + 1)
]
pytestmark = pytest.mark.quick


@pytest.fixture(scope="module")
def known():
    tests = promises.known()
    assert len(tests) > 2000
    return tests


def test_every_finding_has_its_row():
    assert [(date, row) for date, rows in TABLE.items() for row in rows] == ROWS


@pytest.mark.parametrize(("date", "row"), ROWS)
def test_a_finding_names_tests_that_exist_or_a_reason(date, row, known):
    found = TABLE[date][row]
    assert set(found) <= {"now", "tests", "reason"} and found["now"]
    assert found.get("tests") or found.get("reason")
    assert promises.unknown({row: found}, known) == []
