"""One axis by gateway, CAN and Modbus TCP, on real CAN and in real time: each way finds and does
the same, and an owner that is killed leaves a disabled axis. axis_session.py is the session."""

from pathlib import Path

import pytest
from forceaxis.objects import BY_NAME, OBJECTS_HASH
from steps import found_by

SESSION = Path(__file__).parent / "axis_session.py"
WAYS = ("can", "gateway", "modbus")
KEPT = {"state": "ready to switch on", "fault": "none", "command_source": "canopen"}


@pytest.fixture(scope="module")
def found(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("ways"), 90, SESSION)


@pytest.mark.parametrize("way", WAYS)
def test_the_axis_does_the_same_by_each_way(found, way):
    used = found[f"use {way}"]
    assert used["gains"] == {"position_gain": 4.0, "velocity_gain": 20.0, "force_gain": 5.0}
    assert abs(used["reached"] + 2000) <= 10  # position_window
    # k_f = 5 and f_d = 30 settle at 26 or 27 counts of 2.5 N, within half a second of the strike.
    assert 24 <= used["pressed"]["force_count"] <= 29
    assert used["pressed"]["force_N"] == pytest.approx(2.5 * used["pressed"]["force_count"])
    assert used["owner"] == {"can": "canopen", "gateway": "lcm", "modbus": "modbus"}[way]
    assert used["after"].items() >= KEPT.items()


@pytest.mark.parametrize("way", WAYS)
def test_what_is_refused_is_refused_by_name_and_changes_nothing(found, way):
    used = found[f"use {way}"]
    says, gain = used["nothing_written"]
    assert says == "watchdog: expected 10 to 65535 ms, got 5"
    assert gain == 5.0
    assert used["refused"].startswith("adc_bits: not in this state")
    assert used["refused"].endswith("; it can be written only while the axis is disabled")


def test_all_ways_read_the_same_parameters(found):
    # The owner, and what the sessions before have set.
    differ = {"command_source", "controlword", "modes_of_operation", "velocity_window"}
    differ |= {"target_position", "trajectory_velocity", "force_setpoint", "position_gain"}
    differ |= {"velocity_gain", "force_gain", "mode", "homing_travel"}
    differ |= {name for name in BY_NAME if name.startswith("recorder_")}
    read = [found[f"use {way}"]["parameters"] for way in WAYS]
    assert len(read[0]) > 100
    for name in read[0].keys() - differ:
        assert len({str(values[name]) for values in read}) == 1, name


def test_reading_over_can_works_beside_a_gateway(found):
    first, second = found["can beside gateway"]
    assert len(first) > 50 and first == second


@pytest.mark.parametrize(("way", "travel"), [("can", 4321), ("gateway", 1_000_000)])
def test_parameters_are_loaded_and_taken_back(found, way, travel):
    loaded = found[f"load {way}"]
    assert set(loaded["changed"]) == {"homing_travel", "rpdo_mapping_25", "rpdo_mapped_4"}
    assert loaded["homing_travel"] == travel
    assert "no memory" in loaded["store"]  # this node has none


def test_recordings_have_every_tick(found):
    for way in ("can", "gateway"):
        samples, ticks, _, decimation = found[f"use {way}"]["capture"]
        assert (samples, ticks, decimation) == (300, 299, 1)
    assert "cannot be read over Modbus; connect over CAN" in found["use modbus"]["capture"]


def test_an_incident_is_the_same_by_each_way(found):
    fault, _, samples, told = found["incident can"]
    assert fault == "overspeed" and len(samples) > 1000 and "overspeed at tick" in told[0]
    assert found["incident gateway"] == found["incident can"]


def test_the_watched_heartbeat_is_given_back(found):
    assert found["use can"]["after"]["watched"] == 0
    assert found["killed can"]["after"]["watched"] == 0


def test_the_kernel_bridges_a_stall_but_no_longer(found):
    # One at the start, the thread's own first one, and then four, 0.1 s apart; never more.
    assert 4 <= found["bridged"]["frames"] <= 6
    assert found["bridged"]["last"] < 0.8


@pytest.mark.parametrize(("way", "fault"), [("can", "heartbeat_lost"), ("gateway", "source_lost")])
def test_a_killed_owner_leaves_a_disabled_axis(found, way, fault):
    killed = found[f"killed {way}"]
    assert killed["before"] == "operation_enabled"
    # Both are watched for 1000 ms, fed five or ten times in it; reading adds to it.
    assert 0.5 < killed["seconds"] < 2.0
    assert (killed["fault"], killed["owner"]) == (fault, "canopen")
    assert killed["again"] == "operation_enabled"
    assert killed["recorded"] == 50  # though the killed one had armed the recorder
    assert killed["after"].items() >= KEPT.items()


@pytest.mark.parametrize("way", ["can", "gateway"])
def test_an_enabled_axis_is_shared_but_not_owned(found, way):
    says, written, state = found[f"killed {way}"]["shared"]
    assert "the axis is operation enabled by another client of this bus; end that client" in says
    assert (written, state) == (300, "operation_enabled")


def test_anyone_stops_and_the_owner_starts_again(found):
    assert found["stopped"] == {
        "state": "switch on disabled", "stopped_by": "modbus", "again": "operation_enabled",
    }  # fmt: skip


def test_who_is_on_the_bus(found):
    for bus, version in (("can", "0.1.0"), ("gateway", "0.1"), ("modbus", "0.1.0")):
        (row,) = found[f"list {bus}"]
        assert (row["id"], row["name"], row["table"]) == (1, "forceaxis", OBJECTS_HASH[:8])
        assert row["version"].split(" ")[0] == version
        assert row["fault"] == "none" and row["owner"] == "canopen" and row["note"] is None
