"""tests/findings.toml: each finding has a test that fails if it comes back, or a reason."""

import ast
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
TABLE = tomllib.loads((ROOT / "tests/findings.toml").read_text(encoding="utf-8"))
ROWS = [f"{letter}{number}" for letter, last in (("V", 16), ("N", 3), ("D", 12), ("C", 13))
        for number in range(1, last + 1)]  # fmt: skip
GTEST = re.compile(r"^\s*TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\)", re.M)
pytestmark = pytest.mark.quick


@pytest.fixture(scope="module")
def known():
    """Ids of all tests: "tests/FILE.py::NAME" of pytest, "ctest:SUITE.NAME" of GoogleTest."""
    ids = set()
    for path in (ROOT / "tests").rglob("test_*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        ids |= {
            f"{path.relative_to(ROOT)}::{node.name}"
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
        }
    for path in (ROOT / "tests").rglob("*.cpp"):
        ids |= {f"ctest:{s}.{n}" for s, n in GTEST.findall(path.read_text(encoding="utf-8"))}
    assert len(ids) > 2000
    return ids


def test_every_finding_has_its_row():
    assert list(TABLE) == ROWS


@pytest.mark.parametrize("row", ROWS)
def test_a_finding_names_tests_that_exist_or_a_reason(row, known):
    found = TABLE[row]
    assert set(found) <= {"now", "tests", "reason"} and found["now"]
    assert found.get("tests") or found.get("reason")
    assert [test for test in found.get("tests", []) if test not in known] == []
