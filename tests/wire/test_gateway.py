"""The gateway on real CAN, with the firmware behind it: gateway_bench.py runs there, and
this says what must come out. Expected values are those of host/lcm/axis.lcm, of the Modbus
specification, and of CiA 301 and 402, not what the program says of itself.
"""

import itertools
import subprocess
from pathlib import Path

import cantools
import pytest
from forceaxis import objects
from forceaxis._core import InputError
from forceaxis.axis.axis import trigger_on
from forceaxis.experiments import link
from gateway_clients import HEARTBEAT_MS
from recorded import entries
from steps import found_by

ROOT = Path(__file__).resolve().parents[2]
VCAN = ROOT / "tools" / "vcan"
BENCH = Path(__file__).parent / "gateway_bench.py"
LOCKED = 0x08000021
DONE, REFUSED = 1, 2  # EVENT_ of axis_event_t
SDO_WAYS = ("REQUEST", "ANSWER")
DBC = ROOT / "firmware/objects/generated/forceaxis-gateway.dbc"


@pytest.fixture(scope="module")
def ran(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("gateway"), 200, BENCH)


@pytest.fixture
def of(ran):
    return ran.__getitem__


def test_ready_line_says_where_it_is(ran):
    assert ran["ready"] == (
        "gateway ready pid N, vcan0 axes 1, node id 127, LCM udpm://239.255.76.67:7667?ttl=0, "
        "Modbus TCP 127.0.0.1:1502\n"
    )


def test_state_is_published_steadily_whole_and_in_firmware_time(of):
    got = of("states")
    assert 5 <= got["rate"] <= 55  # 50 SYNCs a second, as far as the guest keeps up
    assert got["missing"] == []
    assert got["lost"] == 0
    assert got["nmt"] == 5 and got["hash"]
    # About 2 s of 1500 ticks, however the guest's clock limps; 3 ticks are 2000 us.
    assert 300 <= got["ticks"] <= 4500
    assert abs(got["utime"] - got["ticks"] * 2000 / 3) <= 1
    assert got["ages_us"][0] >= 0 and got["ages_us"][1] < 2_000_000
    assert got["set"] == 3.0  # --set force_gain=3, written at the set-up


def test_the_lock_of_the_firmware_holds_for_lcm_and_modbus(of):
    got = of("lock")
    assert got["before"] == [
        "force_gain: the axis belongs to canopen; acquire the axis first (abort 08000021h)", LOCKED
    ]  # fmt: skip
    assert got["lock_event"] == [2, "the axis belongs to lcm"]
    # Written through one, read through the other: 7 code/count is 1792.
    assert got["modbus_reads"] == [1792]
    assert got["modbus_write"] == 4
    assert got["modbus_takes"] is False  # no error
    assert got["after"] == [
        "force_gain: the axis belongs to modbus; acquire the axis first (abort 08000021h)", LOCKED
    ]  # fmt: skip
    assert got["modbus_writes"] is False
    assert got["lcm_reads"] == 5.0


def test_a_refused_write_says_why_and_those_before_it_stay(of):
    got = of("refusals")
    text = "latency_ticks: value too high (abort 06090031h), expected a raw value from 0 to 1"
    assert got["range"] == [text, 0x06090031]  # fmt: skip
    assert got["read_only"] == ["0x6041: read-only (abort 06010002h)", 0x06010002]
    assert got["write_only"] == ["recorder_arm: write-only (abort 06010001h)", 0x06010001]
    assert got["no_object"] == ["0x5000: no such object", 0]
    assert got["type"] == ["0x2019: 70000 is not a value of type u8", 0]
    assert got["items"] == [["output_limit", 1000], ["latency_ticks", 3]]
    assert got["stays_done"] == [2048, 1000]


def test_commands_that_are_doubled_late_or_of_another_table(of):
    got = of("repetitions")
    # Answered twice, executed once: another client's value is unchanged.
    assert got["answers"] == [[DONE, "force_tare written", [11]]] * 2
    assert got["value"] == 22
    [[kind, text]] = got["other_table"]
    assert kind == REFUSED
    assert "12345678" in text and objects.OBJECTS_HASH[:8] in text
    assert got["by_address"] == [[DONE, [22]]]
    assert got["late"] == [0, 22]
    assert got["patient"] == [[DONE, [44]]]
    # 2100 commands later its answer is forgotten, and it is not carried out again.
    [[kind, text]] = got["forgotten"]
    assert kind == REFUSED and "command 5 may have been executed before" in text
    assert got["unchanged"] == [2100, 55]


def test_what_the_axis_does_of_itself_becomes_events(of):
    got = of("events")
    said = {(kind, code): text for kind, code, text in got["events"]}
    assert said[6, -2] == "mode open loop"
    assert said[8, 2] == "limit output_limit"
    states = [text for kind, _, text in got["events"] if kind == 5]
    assert states[-3:] == ["operation enabled", "fault", "switch on disabled"]
    overspeed = objects.OBJECTS[[o.name for o in objects.OBJECTS].index("fault")].enum.index(
        "overspeed"
    )
    assert said[4, overspeed] == "fault overspeed"
    assert said[4, 0] == "fault cleared"
    assert said[3, 0x7310] == "EMCY 7310h overspeed"
    # Generic error, and the fault in the first manufacturer byte.
    assert got["emcy"][0]["error_register"] & 1
    assert got["emcy"][0]["manufacturer"] & 0xFF == overspeed


def test_a_session_resets_a_fault_and_keeps_the_latest_states(of):
    got = of("faulted")
    assert got["faults"] == [["overspeed", "fault"]] * 2
    assert got["after"] == ["switch_on_disabled"] * 2
    assert got["kept"] == [5, 5] and got["in_order"]


def test_captures_are_whole_and_tick_by_tick(of):
    got = of("captures")
    assert got["total"] == 500 and got["missing"] == 0
    assert got["steps"] == [1]
    assert got["first_tick"]
    assert [word & 0x4F for word in got["statusword"]] == [0x40]  # switch on disabled
    assert got["decimated"] == [100, [3]]
    assert got["stopped"] == "capture failed: the recorder was stopped"
    # 30 and 50 % of all datagrams are lost, also of those that are sent again.
    assert got["lossy"] == [[200, 0, [1], True]] * 2
    assert got["handed_out"] == [300, "canopen", "idle"]
    assert got["too_long"] == "recorder_arm: value not valid (abort 06090030h)"


def test_every_register_reads_as_over_the_other_bus(of):
    got = of("map_reads")
    assert got["differ"] == []
    with_register = [o for o in objects.OBJECTS if o.modbus >= 0]
    assert got["objects"] == len(with_register)
    assert got["registers"] == sum(2 if o.type in ("u32", "i32") else 1 for o in with_register)


def test_modbus_exceptions_and_writes_that_are_all_or_none(of):
    got = of("map_refuses")
    assert got["hole"] == 2
    assert got["half_read"] == 1 and got["half_write"] == 3
    assert got["range"] == 3
    assert got["function"] == "8701" and got["device_id"].startswith("2b0e018300000300")
    assert got["counts"] == ["8303", "8303"] and got["short"] == "8303"
    assert got["in_step"].startswith("0302")
    assert got["all_or_none"] == [3, True]
    assert got["mask"] == [False, True]
    assert got["exchange"][0] == 770
    assert got["exchange_hole"] == ["9702", [770]]  # refused before it is written
    assert got["low_first"] == [0xFF00, 0xFFFF]


def test_every_request_of_the_table_is_answered_as_on_rtu(of):
    got = of("request_table")
    assert got["differ"] == []
    assert got["requests"] > 80


def test_an_unsigned_object_has_its_whole_range_on_every_bus(of):
    got = of("wide_values")
    for bus in ("canopen", "modbus", "lcm"):
        assert got[bus] == [4 * [3_000_000_000], 4 * [4_294_967_295]], bus


def test_modbus_coils_drive_the_state_machine(of):
    got = of("map_refuses")
    assert got["enable"] is False and got["disable"] is False  # no error
    assert got["enabled"] == [True, False, False, False, False]
    # Ready, switched on, enabled, no fault, voltage, no quick stop, not "switch on disabled".
    assert got["discrete"] == [True, True, True, False, True, True, False]
    # latency_ticks is not written while enabled; output_limit before it is as it was.
    assert got["state"] == 4 and got["taken_back"]
    assert got["disabled"] is False
    # One request asks for either; both are refused before anything is done.
    assert got["enable_and_store"] == ["8f03", False, True]


def test_modbus_streams(of):
    got = of("streams")
    assert got["pieces"].startswith("0404")
    # Two registers; nobody behind unit 7.
    assert [text[:4] for text in got["pipelined"]] == ["0404", "840a", "0404"]
    assert got["clients"] == 6 and got["seconds"] < 10
    assert got["rubbish"] == ""  # the connection is closed


def test_units_that_are_no_axis_answer_too(of):
    got = of("units")
    # One request has the same answer everywhere: echo. Identities are texts.
    name = {unit: bytes.fromhex(got[unit]["product"])[9:] for unit in ("1", "255", "0")}
    assert name == {"1": b"forceaxis", "255": b"forceaxis gateway", "0": b"forceaxis gateway"}
    for unit in ("1", "255", "0"):
        assert got[unit]["echo"] == "0800001234"
        assert got[unit]["hash"].startswith("2b0e0483000001" + "8008")
        assert bytes.fromhex(got[unit]["hash"])[9:].decode() == objects.OBJECTS_HASH[:8]
        server = bytes.fromhex(got[unit]["server"])
        assert server[:3] == bytes([17, len(server) - 2, int(unit)]) and server[4:] == name[unit]
    assert got["1"]["read"][:4] == "0402"
    for unit in ("255", "0"):  # no registers
        assert (got[unit]["read"], got[unit]["write"]) == ("8401", "8601")
    for unit in ("2", "254"):  # gateway path unavailable
        assert set(got[unit].values()) == {"840a", "860a", "880a", "910a", "ab0a"}


def test_silent_clients_lock_nobody_out(of):
    got = of("crowd")
    assert got["next"][:4] == "0402" and got["seconds"] < 3
    # The owner of the axis keeps its connection.
    assert got["owner"] == got["owner_then"] == "1000070002"
    assert got["owner_last"] == "0600070000"
    assert got["first"] == "" and got["half"] == ""  # closed
    assert got["idle"] is None  # not


def test_a_second_gateway_refuses_to_start(of):
    got = of("second_gateway")
    assert got["status"] == 1
    assert got["said"] == (
        "gateway: vcan0: another gateway has node id 127; "
        "stop that gateway, or use another --node-id here\n"
    )
    assert got["port"] == [
        1,
        "gateway: 127.0.0.1:1502: expected a free port for Modbus TCP, Address already in use\n",
    ]


def test_nothing_went_wrong_meanwhile(ran):
    assert ran["said"] == ""


@pytest.mark.parametrize("owner", ["canopen", "modbus", "lcm"])
def test_a_killed_gateway_switches_the_axis_off(of, owner):
    got = of(f"killed_{owner}")
    assert got["driven"]
    assert got["emergencies"] == 1  # 8130h
    # The axis waits for three heartbeats, in its own time, which limps in the guest and then
    # catches up.
    assert 300 <= got["silence_ms"] <= 3000
    # The next gateway finds the axis off and the fault by name.
    assert got["fault"] == "heartbeat_lost"
    assert got["statusword"] == 0x08
    assert got["owner"] == "canopen"


@pytest.mark.parametrize("owner", ["canopen", "modbus", "lcm"])
def test_a_gateway_that_is_ended_stops_the_axis_first(of, owner):
    got = of(f"ended_{owner}")
    assert got["driven"] and got["status"] == 0 and got["said"] == ""
    assert got["statusword"] == [0x27, 0x40]  # operation enabled, switch on disabled
    # No loss is detected afterwards. That canopen stopped another one's axis is reported.
    assert got["emergencies"] == ([] if owner == "canopen" else ["ff08"])


def test_a_lost_axis_is_named_on_both_sides(of):
    got = of("lost_axis")
    ms, text = got["event"]
    assert 3 * HEARTBEAT_MS <= ms <= 10_000
    assert text == f"heartbeat lost: no message from the node for {ms} ms"
    assert got["stale"] and got["age_grows"]
    assert got["modbus"] == "840b"  # the target does not respond
    assert got["command"] == "axis 1 at the gateway: the axis is silent"


def test_a_node_that_another_master_stops_is_started_and_not_enabled(of):
    got = of("nmt_stopped")
    assert got["driven"] and got["back"] and got["found"] and got["operational"]
    assert got["starts"] == 1
    assert got["unanswered"] <= 2  # what was asked when it stopped
    disabled = {"switch_on_disabled", "fault"}
    assert {got["drive"], got["drive_then"]} <= disabled


def test_another_object_table_is_named_and_nothing_but_a_stop_is_written(of):
    got = of("other_table")
    ours = objects.OBJECTS_HASH[:8]
    assert got["said"] == (
        f"gateway: axis 2: expected object table {ours}, the axis has object table 12345678; "
        "writes are refused; build gateway and firmware from one object table\n"
    )
    assert got["hash"] == 0x12345678
    assert "12345678" in got["write"] and ours in got["write"]
    assert got["by_address"] == 1178687537  # product code
    assert got["asked_again"] == [7, 2]  # the frames of two requests were lost
    assert got["modbus"] == "8604"
    # A stop is never refused, also at an axis that the gateway does not set up.
    assert got["stopped"] == ["controlword"] and got["downloads"] == [[0x6040, 2]]
    assert got["starts"] == 0
    assert got["status"] == 0


def test_a_gateway_that_is_ended_stops_all_axes_together(of):
    got = of("two_axes_end")
    # Each receives a stop, reports it, and no longer consumes the gateway's heartbeat.
    assert got["together"] == [[True, True], [True, True], 0]
    # If the axes do not stop, a second signal ends the gateway: they detect its loss.
    assert got["at_once"] == [[True, True], [False, False], 143]


def test_two_axes_behind_one_gateway_are_kept_apart(of):
    got = of("two_axes")
    enabled, disabled = 0x27, 0x40
    # The same by LCM and by Modbus, whose raw gain has 8 fractional bits.
    assert got["gains"] == [[3.0, 7.0], [[768], [1792]]]
    assert got["node_ids"] == [[1], [2]]
    assert got["owners"] == ["lcm", "canopen"]
    assert (got["taken"], got["owners_then"]) == (None, ["modbus", "canopen"])
    # Axis 1 goes 2000 counts by LCM, axis 2 not one.
    (first, second), (first_after, second_after) = got["by_lcm"]
    assert first == [0, enabled, 1] and second[1:] == [disabled, 2]
    assert abs(first_after[0] - 2000) <= 10 and first_after[1:] == [enabled, 1]
    assert second_after == second
    # Axis 2 goes 1500 counts by Modbus, axis 1 holds its place.
    (first, second), (first_after, second_after) = got["by_modbus"]
    assert abs(second_after[0] - second[0] - 1500) <= 10 and second_after[1:] == [enabled, 2]
    assert abs(first_after[0] - first[0]) <= 2 and first_after[1:] == [enabled, 1]
    for seen, state in zip(got["modbus_sees"], (first_after, second_after), strict=True):
        assert abs(seen - state[0]) <= 2
    # Unit 1 is LCM's, unit 2 takes it.
    assert got["refused"] == [4, None]
    assert got["gains_after"] == [3.0, 2.0]
    assert got["owners_after"] == ["lcm", "modbus"]
    assert [state for _, state, _ in got["off"]] == [enabled, disabled]
    assert got["lost"] == 0 and got["said"] == ""


# Without CAN.


def test_cantools_decodes_every_frame_of_the_bus(ran):
    """All scenarios of this module, in which clients read, write, capture, stop and restart."""
    database = cantools.database.load_file(DBC)
    frames = [(i, data) for _, i, data in entries((ran.folder / "bus.log").read_text())]
    lengths = {m.frame_id: m.length for m in database.messages}
    assert {(i, len(data)) for i, data in frames} <= set(lengths.items())
    decoded = {}
    for identifier, data in dict.fromkeys(frames):
        message = database.get_message_by_frame_id(identifier)
        values = message.decode(data)
        decoded.setdefault(message.name, []).append(values)
        assert message.encode(values, strict=False)[: len(data)] == data, message.name
    others = ("AXIS2", "AXIS3")  # nodes of three scenarios
    kinds = {name.removeprefix("AXIS1_") for name in decoded if not name.startswith(others)}
    sdos = {f"SDO{channel}_{way}" for channel in ("", "_LCM", "_MODBUS") for way in SDO_WAYS}
    tpdos = {f"TPDO{n}" for n in range(1, 5)}
    assert kinds == {"NMT", "SYNC", "EMCY", "HEARTBEAT", "GATEWAY_HEARTBEAT", *tpdos, *sdos}
    # At each SYNC the count is higher, by less than a second.
    ticks = [row["tick_count"] for row in decoded["AXIS1_TPDO4"]]
    steps = [after - before for before, after in itertools.pairwise(ticks)]
    assert sum(0 < step < 1500 for step in steps) > 0.9 * len(steps)
    owners = {str(row["command_source"]) for row in decoded["AXIS1_TPDO4"]}
    assert owners == {"canopen", "modbus", "lcm"}
    assert {str(row["fault"]) for row in decoded["AXIS1_TPDO3"]} >= {"none", "overspeed"}


def test_a_trigger_is_an_object_of_the_table():
    assert trigger_on("force", 31.0, "falling") == {
        "trigger_source": objects.BY_NAME["force"].index << 8,
        "trigger_level": 31 * 256,
        "trigger_edge": "falling",
    }
    for name in ("0x6064", "0x6064:0", "no_such"):
        with pytest.raises(InputError, match=f"^{name}: expected "):
            trigger_on(name, 1)


def gateway(*args):
    return subprocess.run(
        [link.program("gateway"), *args], capture_output=True, text=True, timeout=20, check=False
    )


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["--axes", "0"], "--axes 0: expected numbers from 1 to 127 such as 1,2 or 1-6"),
        (["--axes", "1,1"], "--axes 1,1: expected numbers from 1 to 127 such as 1,2 or 1-6"),
        (["--axes", "3-2"], "--axes 3-2: expected numbers from 1 to 127 such as 1,2 or 1-6"),
        (["--axes", "128"], "--axes 128: expected numbers from 1 to 127 such as 1,2 or 1-6"),
        (
            ["--axes", "90-114"],
            "--axes 90-114: expected at most 24 axes, CAN has no SDO identifiers left for axis 114",
        ),
        (
            ["--axes", "3,4", "--node-id", "4"],
            "--node-id 4: expected a node id that no axis has, --axes 3,4",
        ),
        (["--set", "force_gain"], "--set force_gain: expected NAME=VALUE or N:NAME=VALUE"),
        (["--set", "force=1"], "--set force=1: expected a parameter, got a signal"),
        (
            ["--set", "force_gain=-1"],
            "--set force_gain=-1: expected 0 to 255.996 code/count",
        ),
        (["--set", "2:force_gain=1"], "--set 2:force_gain=1: expected an axis of --axes 1"),
        (
            ["--set", "profile_enable=fast"],
            "--set profile_enable=fast: expected one of raw_step,trapezoid",
        ),
        *(
            (
                ["--modbus-bind", bind],
                f"--modbus-bind {bind}: expected an IPv4 address such as 127.0.0.1, or 0.0.0.0",
            )
            for bind in ("0127.0.0.1", "0.1.2.3", "localhost", "999.1.1.1", "")
        ),
        (["--watch-ms", "100"], "--watch-ms: expected more than one heartbeat period, 100 ms"),
    ],
)
def test_bad_input_is_one_line_and_status_2(args, said):
    done = gateway(*args)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"gateway: {said}\n"


def test_an_unknown_option_is_one_line_too():
    done = gateway("--nonsense")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_no_such_interface_says_what_to_do():
    done = gateway("--can", "nocan0")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("gateway: nocan0: expected ") and done.stderr.count("\n") == 1


def test_help_shows_an_example():
    done = gateway("--help")
    assert done.returncode == 0
    assert "Example:" in done.stdout and "gateway --can vcan0 --axes 1,2" in done.stdout
