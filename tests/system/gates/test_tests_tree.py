"""A test is in the folder of its subject, and every import of tests finds one file."""

from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
AT_THE_TOP = {"CMakeLists.txt", "conftest.py", "findings.toml", "promises.toml", "seconds.toml"}
WINGS = {p.parent.name for p in (ROOT / "host/python/forceaxis").glob("*/__init__.py")}
pytestmark = pytest.mark.quick


def complaints(tests):
    """What is against the table of CONTRIBUTING.md, a line each."""
    loose = sorted(p.name for p in tests.iterdir() if p.is_file() and p.name not in AT_THE_TOP)
    lines = [f"{name}: expected in the folder of its subject" for name in loose]
    programs = [p for p in tests.rglob("*.py") if p.name != "conftest.py"]
    names = Counter(p.name for p in programs)
    lines += [f"{name}: expected one file of this name" for name, n in names.items() if n > 1]
    for folder in sorted((tests / "python").glob("*/")):
        if folder.name not in WINGS | {"__pycache__"}:
            lines.append(f"python/{folder.name}: expected a folder of the package")
    for path in sorted((tests / "support").rglob("test_*")):
        lines.append(f"{path.name}: expected no test among the helpers")
    for path in sorted(tests.rglob("test_*.cpp")):
        lines.append(f"{path.name}: expected a name that ends in _test.cpp")
    return lines


def test_tests_are_in_the_folder_of_their_subject():
    assert complaints(ROOT / "tests") == []


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("test_new.py", "test_new.py: expected in the folder"),
        ("wire/test_axis.py", "test_axis.py: expected one file"),
        ("python/attic/test_new.py", "python/attic: expected a folder of the package"),
        ("support/test_new.py", "test_new.py: expected no test among the helpers"),
        ("loop/test_new.cpp", "test_new.cpp: expected a name that ends in _test.cpp"),
    ],
)
def test_a_test_at_the_wrong_place_is_found(tmp_path, file, says):
    for name in ("conftest.py", "python/axis/test_axis.py", "support/verbs.py", file):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    (line,) = complaints(tmp_path)
    assert line.startswith(says)
