"""Homing and the user's units with a master that nobody here wrote: python-canopen moves axis_node
in micrometres on real CAN and homes it by switch, index and contact. The plant's switches are where
its model has them, so each place that was found is compared with the true one.
"""

from pathlib import Path

import pytest
from steps import found_by

pytestmark = pytest.mark.long  # a quarter of a minute; each method is in cia402_homing_test.cpp

ROOT = Path(__file__).resolve().parents[2]
SESSION = Path(__file__).with_name("homing_session.py")
UM_A_COUNT = 25400 / 4000
# Of sim/models/homing.toml, in counts; the index every 4000 from 0.
LIMIT_NEG, LIMIT_POS, INDEX = -10000, -1575, -4000
# 6099h:2 is 1500 count/s, a count a tick: an edge is seen a tick later, two where the bus was late
# with the reading of one tick; the rest is rounding.
LATE = 2.6


@pytest.fixture(scope="module")
def results(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("homing"), 100, SESSION)


@pytest.fixture
def step(results):
    return results.__getitem__


def home_of(found, offset_um=0):
    """The count of the place that was called home."""
    return found["count"] - (found["user"] - offset_um) / UM_A_COUNT


def show(name, found, true):
    print(f"\n{name}: found {found:.1f}, true {true} counts, after {(found - true):+.1f}")


def test_methods_need_their_inputs(step):
    found = step("refused")
    assert found["before"] == [35, 37, -1]
    assert found["after"] == [35, 37, -1, 17, 18, 19, 20, 21, 22, 33, 34]
    for method in (17, 18, 19, 20, 21, 22, 33, 34):
        assert found[str(method)] == 0x06090030


@pytest.mark.parametrize(
    "method, true, direction, offset",
    [("17", LIMIT_NEG, 1, 0), ("18", LIMIT_POS, -1, 0), ("33", 2 * INDEX, -1, 635)],
)
def test_a_switch_is_found_where_the_plant_has_it(step, method, true, direction, offset):
    found = step(method)
    assert found["attained"]
    home = home_of(found, offset)
    show(f"method {method}", home, true)
    assert -LATE <= (home - true) * direction <= LATE


def test_moves_are_in_micrometres_from_home(step):
    home = home_of(step("17"))
    for name, target in (("move out", 10000), ("move back", 1234), ("move on", 20000)):
        found = step(name)
        moved = (found["count"] - home) * UM_A_COUNT
        print(f"\n{name}: {target} um asked, {moved:.1f} um gone, {found['user']} um shown")
        # The axis swings by a count about its target, also between the two readings; by two where
        # the bus of a busy machine is late.
        assert found["user"] == pytest.approx(target, abs=3.2 * UM_A_COUNT)
        assert moved == pytest.approx(found["user"], abs=2.2 * UM_A_COUNT)


def test_contact_is_found_at_the_workpiece(step):
    found = step("contact")
    assert found["attained"]
    home = home_of(found)
    # 2 counts of the reading are 5 N: 45 um of the sensor, 12 of the support, 8 of the arm.
    true = (5 / 110100 + 5 / 412700 + 5 / 665000) / 25.4e-3 * 4000
    show("contact", home, round(true, 1))
    assert -1 <= home - true <= 5
    off = step("move off")
    assert off["user"] == pytest.approx(-2000, abs=3.2 * UM_A_COUNT)
