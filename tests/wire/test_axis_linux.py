"""The axis as a process of Linux, on the drive of another program with a load cell: it presses, and
has each failure by name. axis_linux_session.py did it all on real CAN; the tests check its records.
"""

import json
import subprocess
from pathlib import Path

import pytest
from forceaxis.experiments import link
from steps import found_by

SESSION = Path(__file__).with_name("axis_linux_session.py")
LOCK_WATCH = Path(__file__).with_name("lock_watch.c")
FAILED = ("operation_enabled", "operation enabled")


@pytest.fixture(scope="module")
def results(tmp_path_factory, vcan):
    folder = tmp_path_factory.mktemp("axis_linux")
    command = ["cc", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", LOCK_WATCH]
    subprocess.run([*command, "-o", folder / "lock_watch.so"], check=True)
    yield from found_by(vcan, folder, 150, SESSION)


def test_it_starts_without_a_fault_and_presses(results):
    assert results["first"] == {"fault": "none", "drive_state": "switch_on_disabled", "position": 0}
    # The drive integrates, so the P law leaves no error but the 10 count/s of a DAC code.
    assert results["pressed"]["force_count"] == pytest.approx(20, abs=0.7)
    assert results["disabled"] == {
        "fault": "none", "drive_state": "ready_to_switch_on", "drive": "switch on disabled",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("failure", "fault", "drive"),
    [
        ("killed_drive", "drive_fault", "quick stop active"),  # by its own heartbeat consumer
        ("drive_fault", "drive_fault", "fault"),
        ("silent_cell", "force_old", "switch on disabled"),
        ("bus_down", "drive_fault", "quick stop active"),
        ("stalled", "clock_wrong", "switch on disabled"),
        ("converter_ends", "force_old", "switch on disabled"),
    ],
)
def test_each_failure_disables_the_axis_by_name(results, failure, fault, drive):
    found = results[failure]
    assert (found["before"], found["drive_before"]) == FAILED
    assert found["fault"] == fault
    assert found["drive_state"] == "fault"
    assert found["drive"] == drive


@pytest.mark.parametrize("again", ["new_drive", "reset_drive", "speaking_cell", "bus_up"])
def test_a_reset_and_an_enable_bring_the_drive_back(results, again):
    assert results[again] == {
        "fault": "none", "drive_state": "operation_enabled", "drive": "operation enabled",
    }  # fmt: skip


def test_a_disabled_axis_counts_late_ticks_and_has_no_fault(results):
    before, found = results["reset_stalled"], results["stalled_disabled"]
    assert before["fault"] == found["fault"] == "none"
    assert found["overruns"] - before["overruns"] >= 600


def test_the_tick_sends_under_the_lock_from_the_first_frame_to_the_last(results):
    """Another thread reads the state of the drive's master under that lock."""
    said = results["end"]["stderr"] + results["converter_stderr"]
    assert "without the lock" not in said


def test_a_signal_stops_the_drive_and_ends_the_process(results):
    end = results["end"]
    assert (end["status"], end["drive"]) == (0, "switch on disabled")
    report = json.loads(end["report"])
    assert report["ticks"] > 5000
    assert report["missed"] > 600, "the process was stopped for 600 ms"
    assert 0 < report["late_us"]["50%"] <= report["late_us"]["99%"] <= report["late_us"]["longest"]


def test_the_process_says_why_the_drive_has_failed(results):
    lines = results["end"]["stderr"].splitlines()
    assert all(line.startswith("axis_linux: ") for line in lines)
    killed, fault = [line for line in lines if "_max is" not in line][:2]
    # Its TPDOs come in each cycle, its heartbeats more rarely.
    assert "TPDOs of the drive in succession are missing" in killed or "heartbeat" in killed
    assert "the drive has sent an emergency message" in fault
    assert "error code 2310h" in fault


def test_the_process_says_which_times_contradict_the_drive(results):
    """Of a fresh axis, on a bus of 10 ms with a wait of 5 s; with the values of the page, none."""
    lines = results["end"]["stderr"].splitlines()
    on, age = [line for line in lines if "_max is" in line]
    assert "drive_on_ticks_max is 600, but wait_ms grants the drive 7500 ticks" in on
    assert "cycle_age_max is 3" in age and age.endswith("set cycle_age_max to 29")


def test_the_process_says_that_a_bus_is_down_and_back(results):
    lines = results["end"]["stderr"].splitlines()
    told = [line for line in lines if "vcan" in line]
    assert told == [
        "axis_linux: vcan1: the interface is down",
        "axis_linux: vcan1: the bus works again",
    ]


def test_parameters_are_kept_in_the_file(results):
    assert results["stored"] == {"adc_bits": 16, "position_gain": 1.0}


def test_the_force_of_a_converter_is_read_from_its_buffer(results):
    found = results["converter"]
    deflection = found["position"] - 400  # counts beyond the contact, each 64 codes
    expected = 32768 + 100 + 64 * max(0, deflection)
    assert found["force_raw"] == pytest.approx(expected, abs=64)
    assert "buffer: the buffer of the force has ended" in results["converter_stderr"]


def test_a_killed_process_is_missed_by_the_drive(results):
    assert results["killed"] == {"before": "operation enabled", "drive": "quick stop active"}


CONVERTER = '[iio]\ndevice = "/nowhere"\nchannel = "voltage0"\n'
GOOD = """
supervisor = "none0"
[drive]
interface = "none1"
node_id = 9
target_num = 10
target_max = 20000
[load_cell]
identifier = 0x301
bytes = 4
"""


@pytest.mark.parametrize(
    ("before", "after", "line"),
    [
        ("", "", "none0: expected a"),
        (
            "[load_cell]",
            "[load]",
            "load_cell: expected one of the tables [load_cell] and [iio], got n",
        ),
        ("[load_cell]", f"{CONVERTER}[load_cell]", "[load_cell] and [iio], got both"),
        ("[load_cell]\nidentifier = 0x301\nbytes = 4", CONVERTER, "none0: expected a"),
        (
            "[load_cell]\nidentifier = 0x301\nbytes = 4",
            f"{CONVERTER}shift = 32",
            "iio.shift: expected",
        ),
        ("[load_cell]\nidentifier = 0x301\nbytes = 4", "[iio]", "iio.device: expected"),
        ("node_id = 9", "node_id = 128", "drive.node_id: expected"),
        ("node_id = 9", "node_id = 9\ncycle_ms = 3", "drive.cycle_ms: expected an even number"),
        (
            "bytes = 4",
            "bytes = 4\nbyte = 6",
            "load_cell.bytes: expected a force within the 8",
        ),
        ("target_num = 10", "target_num = 0", "drive.target_num: expected"),
        ("node_id = 9", "node_id = 9\nmode = 'homing'", "drive.mode: expected"),
    ],
)
def test_wrong_settings_are_one_line(tmp_path, before, after, line):
    file = tmp_path / "axis.toml"
    file.write_text(GOOD.replace(before, after) if before else GOOD)
    done = subprocess.run(
        [link.program("axis_linux"), file], capture_output=True, text=True, timeout=20
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert line in done.stderr and done.stderr.count("\n") == 1
