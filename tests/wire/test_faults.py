"""Real processes die, a real bus goes down, two masters fight: the axis is off, and named.

Within the ticks that firmware/app/fw.h states, and by the same name on every bus.

Ticks are those of the link, as candump saw it, and of the axis' journal.
"""

from pathlib import Path

import fault_session
import pytest
from steps import found_by

ROOT = Path(__file__).resolve().parents[2]
SENSOR_INVALID, HEARTBEAT_LOST, SOURCE_LOST, CAN_OFF = 1, 8, 9, 10
OVERRUN = 0xFF04
HEARTBEAT_TICKS = fault_session.HEARTBEAT_MS * 3 // 2
WATCHDOG_TICKS = fault_session.WATCHDOG_MS * 3 // 2


@pytest.fixture(scope="module")
def session(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("faults"), 100, fault_session.__file__)


def expect(seen, fault, code):
    """Off for good, code 0, and the same name by SDO, Modbus and emergency."""
    assert seen["after"] == [[0, 0, fault]]
    assert (seen["fault"], seen["error_code"]) == (fault, code)
    assert seen["register"] == f"010402{code:04x}"
    assert code in seen["emergencies"]


def test_a_killed_supervisor_is_missed(session):
    seen = session["killed_supervisor"]
    assert seen["alive"] == 0
    expect(seen, HEARTBEAT_LOST, 0x8130)
    assert (
        seen["on"][1] - seen["last"] == HEARTBEAT_TICKS
    )  # off in the next one, N + 2 with its own
    assert seen["axis"]["axes"][0]["fault"] == "heartbeat_lost"


def test_a_killed_plant_is_missed(session):
    seen = session["killed_plant"]
    assert (seen["fault"], seen["error_code"]) == (SENSOR_INVALID, 0x7305)
    assert seen["register"] == "0104027305"
    assert 0x7305 in seen["emergencies"]
    axis = seen["axis"]
    assert axis["status"] == 1
    assert "plant_node silent for 500 ms" in axis["stderr"]
    lost = axis["axes"][0]["after_silence"]
    # One tick after the last one that the plant requested.
    assert lost["tick"] == seen["on"][1] + 1
    assert (lost["dac_code"], lost["amp_enable"], lost["brake_release"]) == (0, False, False)
    assert axis["axes"][0]["fault"] == "sensor_invalid"


def test_late_ticks_are_counted_and_told(session):
    seen = session["late_in_real_time"]
    # The guest itself may stall, so more than one may be late.
    assert 1 <= seen["overruns"] <= len(seen["late"])
    assert seen["register"][:6] == "010402" and int(seen["register"][6:], 16) >= seen["overruns"]
    assert OVERRUN in seen["emergencies"]
    assert seen["on"][1] > seen["late"][0] + 300  # a warning: the axis stays enabled


def test_in_lock_step_no_tick_is_late(session):
    seen = session["late_ticks"]
    assert (seen["overruns"], seen["late"], seen["register"]) == (0, [], "0104020000")
    assert OVERRUN not in seen["emergencies"]


def test_a_lost_bus_is_seen(session):
    seen = session["lost_bus"]
    expect(seen, CAN_OFF, 0x8140)
    (down, state), (up, active) = seen["told"]
    assert (state, active) == ("2", "0")
    assert seen["on"][1] == down - 1  # reported before tick `down`, which is off
    assert up > down
    assert seen["axis"]["axes"][0]["fault"] == "can_off"


def test_a_controller_that_is_bus_off_is_not_back_before_its_restart(session):
    """CiA 301: no frame before the return, then an emergency message, and pre-operational by 1029h,
    whose default is that."""
    seen = session["bus_off"]
    expect(seen, CAN_OFF, 0x8140)
    assert seen["while_off"] == []
    assert seen["after_return"][:2] == [0x8140, 0]
    assert seen["nmt"] == [0x7F]
    assert [state for _, state in seen["told"]] == ["2", "0", "2", "0"]
    (off, _), (back, _), (again, _), (end, _) = seen["told"]
    assert seen["on"][1] == off - 1
    assert back > off + 300, "the interface is up, but the controller is not back"
    assert again == end, "bus off and restart in one tick are both told"


def test_an_interface_that_was_removed_is_used_again(session):
    seen = session["removed_interface"]
    assert [state for _, state in seen["told"]] == ["2", "0"]
    assert (seen["fault"], seen["error_code"]) == (CAN_OFF, 0x8140)
    assert 0x8140 in seen["emergencies"]


def test_of_two_masters_one_owns_and_is_missed(session):
    seen = session["two_masters"]
    assert (seen["owner"], seen["refused"], seen["alive"]) == (1, 0x08000021, 0)
    assert seen["after"] == [[0, 0, SOURCE_LOST]]
    assert (seen["fault"], seen["error_code"]) == (SOURCE_LOST, 0x6010)
    assert 0x6010 in seen["emergencies"]
    assert seen["on"][1] - seen["last"] == WATCHDOG_TICKS - 1  # off N + 1 with the request's own
    assert seen["owner_after"] == 0
    assert seen["rival_after"] == "018604"
    assert seen["axis"]["axes"][0]["fault"] == "source_lost"
