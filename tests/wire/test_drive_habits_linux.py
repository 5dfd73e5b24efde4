"""The axis as a process of Linux with kinds of drives of drive_habits.py, which
drive_habits_session.py tries on real CAN: each is on, or refused by a line that names the key."""

from pathlib import Path

import pytest
from drive_habits import BY_NAME
from drive_habits_session import KINDS
from fake_drive import ENABLED
from steps import found_by

SESSION = Path(__file__).with_name("drive_habits_session.py")
ON = [(name, cured) for name, cured in KINDS if cured or not BY_NAME[name].reason]
REFUSED = [name for name, cured in KINDS if not cured and BY_NAME[name].reason]


@pytest.fixture(scope="module")
def results(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("drive_habits"), 200, SESSION)


@pytest.mark.long
@pytest.mark.parametrize(("name", "cured"), ON)
def test_it_is_on(results, name, cured):
    found = results[f"{name}{', cured' if cured else ''}"]
    assert found["axis"] == {"fault": "none", "drive_state": "operation_enabled"}, found
    assert found["drive"] == ENABLED


@pytest.mark.long
@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_by_a_line_that_names_the_key(results, name):
    found, kind = results[name], BY_NAME[name]
    assert found["axis"]["fault"] == "drive_fault", found
    lines = found["stderr"].splitlines()
    assert lines and all(line.startswith("axis_linux: ") for line in lines)
    assert any(kind.word in line for line in lines), lines
