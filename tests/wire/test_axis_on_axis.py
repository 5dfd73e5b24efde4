"""An axis on Linux presses by another axis of this project as its drive, with python-canopen as the
supervisor, on real CAN and in real time: the bands of tests/loop/axis_on_axis_test.cpp.
axis_on_axis_session.py did it; the tests check its records.
"""

from pathlib import Path

import pytest
from steps import found_by

pytestmark = pytest.mark.long  # half a minute; in lock-step it is tests/loop/axis_on_axis_test.cpp

SESSION = Path(__file__).with_name("axis_on_axis_session.py")
SETPOINT, NEWTONS, CYCLE_MS = 30, 2.5, 20  # codes, N a code
# Of the run in lock-step: 75 N, and 0.26 s.
PEAK_N, SETTLED_CYCLES = 75.0, 13
# The springs of sensor and workpiece in series, in N/m, and their force at an approach of 5 mm/s
# in N/ms.
STIFFNESS = 1 / (1 / 110_100 + 1 / 412_700)
RISE_N = 0.005 * STIFFNESS / 1000


@pytest.fixture(scope="module")
def results(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("axis_on_axis"), 120, SESSION)


def test_it_holds_75_n(results):
    assert results["fault"] == 0
    assert {abs(code - SETPOINT) for code in results["codes"][-50:]} <= {0, 1}


def test_peak_and_settling_are_those_of_the_run_in_lock_step(results):
    """A late tick of the axis or of the drive is a longer delay. While the force rises, each ms
    adds RISE_N; four times the longest lateness covers two processes with a cycle each."""
    late_ms = results["lateness"]["late_us"]["longest"] / 1000
    peak_N = NEWTONS * max(results["codes"])
    assert peak_N <= PEAK_N + NEWTONS + 4 * late_ms * RISE_N
    outside = [n for n, code in enumerate(results["codes"], 1) if abs(code - SETPOINT) > 1]
    assert outside[-1] <= SETTLED_CYCLES + (5 if late_ms < CYCLE_MS else 50)


def test_python_canopen_enables_reads_and_stops_it(results):
    assert results["enabled"] == "OPERATION ENABLED"
    assert results["drive_on"] == 0x27
    assert results["read"]["force"] == pytest.approx(750, abs=25)
    # 4000 counts an inch: from the contact and 75 N into its springs.
    way_mm = 1000 * 75 / STIFFNESS
    assert results["read"]["position"] == pytest.approx(way_mm / 25.4 * 4000, abs=20)
    assert results["stopped"] == "READY TO SWITCH ON"
    assert results["drive_off"] == 0x40
