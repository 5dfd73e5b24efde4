"""`forceaxis axis` on a simulated one in its own time. tests/wire/test_axis_ways.py has it on real
buses, tests/python/axis/test_axis_links.py what carries it."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from forceaxis._core import InputError
from forceaxis.axis import actions, address, parameter_set, quantity
from forceaxis.axis.axis import Axis, trigger_on
from forceaxis.axis.drive import FaultObjects, StatusObjects
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.axis.scan import ScannedAxis
from forceaxis.axis.sim import SimLink
from forceaxis.bus.keeper import WatchdogKeeper
from forceaxis.cli import live_options
from forceaxis.cli.axis import table_of
from forceaxis.objects import BY_NAME, OBJECTS_HASH
from forceaxis.recordings import signal_recording
from verbs import forceaxis

ROOT = Path(__file__).resolve().parents[3]
CONTACT = ROOT / "sim/experiments/contact.toml"
HOLD = ROOT / "sim/experiments/hold_biquad.toml"
GAINS = ["firmware.position_gain=4", "firmware.velocity_gain=20"]
SIM = ["--on", f"sim:{CONTACT}", *(word for gain in GAINS for word in ("--set", gain))]


@pytest.fixture
def axis():
    with Axis(SimLink(CONTACT, GAINS)) as axis:
        yield axis


def said(done, status=0):
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout


def refusal(done, status):
    """The one line of a verb that ends with this status."""
    assert done.returncode == status, done.stdout + done.stderr
    assert done.stderr.startswith("forceaxis: ") and done.stderr.count("\n") == 1
    return done.stderr.removeprefix("forceaxis: ").strip()


def test_get_has_units_and_patterns():
    lines = said(forceaxis("axis", "get", *SIM, "force_gain", "tare_st*")).splitlines()
    assert lines == ["force_gain  5 DAC code/count of force", "tare_state  idle"]
    found = json.loads(said(forceaxis("axis", "get", *SIM, "force_scale", "fault", "--json")))
    assert found == {"force_scale": 2_500_000, "fault": "none"}


def test_a_scale_that_is_not_its_models_is_warned_of():
    done = forceaxis("axis", "get", *SIM, "--set", "firmware.force_scale=5000000", "force")
    assert said(done).startswith("force") and done.stderr.count("\n") == 1
    assert "warning" in done.stderr and "expected force_scale 2.5 N/count" in done.stderr
    assert "wrong by a factor of 0.5" in done.stderr
    assert forceaxis("axis", "get", *SIM, "force").stderr == ""
    with pytest.warns(UserWarning, match="wrong by a factor of 0.5"):
        Axis.sim(CONTACT, ["firmware.force_scale=5000000"])


def test_newtons_of_a_scale_that_nobody_set_are_warned_of(axis, capsys):
    def warned(on):
        way = live_options.AxisConnection((address.parse(on),))
        live_options.warn_of_newtons(axis, way)
        return capsys.readouterr().err

    assert warned(f"sim:{CONTACT}") == "", "is compared with its model"
    assert "force_scale (2.5 N/count) was never set" in warned("can0")
    axis.set(calibration_date=15_000)
    assert warned("can0") == ""
    axis.set(calibration_date=0, force_scale=2_400_000)
    assert warned("can0") == ""


def test_a_value_is_read_as_the_type_that_its_object_has(axis):
    axis.set(force_gain=6.999)
    assert axis.number("force_gain") == 1792 / 256
    assert axis.numbers("adc_bits", "force_gain") == {"adc_bits": 8, "force_gain": 7.0}
    assert axis.integer("adc_bits") == 8 and axis.text("fault") == "none"
    with pytest.raises(InputError, match="fault: expected an object that is a number, got none"):
        axis.number("fault")
    with pytest.raises(InputError, match="force_gain: expected an object that is an integer"):
        axis.integer("force_gain")


def test_set_reads_back_what_the_axis_has():
    done = forceaxis("axis", "set", *SIM, "force_gain=6.999", "force_setpoint=75 N", "--json")
    # 1/256 is the least step; 2.5 N a count.
    assert json.loads(said(done)) == {"force_gain": 1792 / 256, "force_setpoint": 30.0}


def test_what_a_simulated_axis_forgets_is_warned_of(tmp_path):
    """Each command powers it up. It begins with what it has stored, and with [firmware] of its
    experiment if it has stored nothing."""
    on = ["--on", f"sim:{CONTACT}@{tmp_path / 'axis.store'}"]
    done = forceaxis("axis", "set", *on, "force_gain=7", "contact_force=3")
    assert said(done) and done.stderr.count("\n") == 1
    options = re.findall(r"--set firmware\.\w+=\S+", done.stderr)
    given = " ".join(options).split()
    wanted = {"force_gain": 7, "contact_force": 3}

    def has(*more):
        done = forceaxis("axis", "get", *on, *more, *wanted, "--json")
        assert done.stderr == ""
        return json.loads(said(done))

    # A command of the axis is no parameter.
    assert "forgets" not in forceaxis("axis", "set", *on, "controlword=0").stderr
    before = has()
    assert before["force_gain"] == 5 and before["contact_force"] != 3
    assert has(*given) == wanted
    stored = forceaxis("axis", "params", "store", *on, *given)
    assert said(stored) and stored.stderr == ""
    assert has() == wanted, "[firmware] gives 5"
    assert has("--set", "firmware.force_gain=9") == wanted | {"force_gain": 9}, "one command alone"
    assert has() == wanted
    assert said(forceaxis("axis", "params", "restore", "--yes", *on))
    assert has() == before


def test_a_value_that_is_not_stored_is_warned_of(tmp_path, capsys):
    def warning():
        live_options.warn_of_power_up(axis)
        return capsys.readouterr().err

    with Axis(SimLink(CONTACT, GAINS, tmp_path / "axis.store")) as axis:
        axis.acquire()
        assert warning() == ""
        travel = axis.number("homing_travel")
        axis.set(force_gain=7, position_gain=2)
        line = warning()
        assert line.count("\n") == 1
        assert "it then has force_gain = 5, position_gain = 4 again" in line
        assert "--set firmware.force_gain=7" in line
        parameter_set.store(axis)
        assert warning() == ""
        # A value set after the save, and a parameter that [firmware] does not have.
        axis.set(force_gain=8, homing_travel=4321)
        assert axis.link.forgets() == {"force_gain": 7, "homing_travel": travel}
        assert "it then has force_gain = 7, " in warning()
        parameter_set.store(axis)
        assert warning() == ""


def test_a_store_of_an_axis_with_another_converter_is_refused(tmp_path):
    """Its stored adc_bits would make other forces of the codes."""
    store = tmp_path / "axis.store"
    with Axis(SimLink(CONTACT, store=store)) as axis:
        axis.acquire()
        parameter_set.store(axis)
    on = ["--on", f"sim:{ROOT / 'sim/experiments/fig2_11.toml'}@{store}"]
    done = forceaxis("axis", "get", *on, "adc_bits")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    for part in (f"{store}: adc_bits: expected 16, ", "got the stored 8; ", "override firmware."):
        assert part in done.stderr
    # What the line says to do.
    given = ("--set", "firmware.adc_bits=16")
    assert said(forceaxis("axis", "params", "store", *on, *given))
    assert json.loads(said(forceaxis("axis", "get", *on, "adc_bits", "--json"))) == {"adc_bits": 16}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["force_gain=7", "nonsense=1"], "nonsense: expected the name of an object"),
        (["force_gain=7", "watchdog=5"], "watchdog: expected 10 to 65535 ms, got 5"),
        (["force_gain=7", "force=1"], "force: expected an object that can be written"),
        (["force_gain=7", "fault"], "fault: expected NAME=VALUE"),
        (
            ["force_gain=7 N"],
            "force_gain: expected a value with the unit code/count or V/N, got 7 N",
        ),
        (
            ["force_setpoint=7 kg"],
            "force_setpoint: expected a value with the unit count or N, got 7 kg",
        ),
        (["mode=sideways"], "mode: expected one of disabled"),
    ],
)
def test_set_refuses_by_name(words, says):
    assert refusal(forceaxis("axis", "set", *SIM, *words), 2).startswith(says)


def test_nothing_is_written_if_one_value_is_wrong(axis):
    for wrong in ({"watchdog": 5}, {"force": 1.0}, {"nonsense": 1}):
        with pytest.raises(InputError):
            axis.set(force_gain=7.0, **wrong)
    assert axis.read("force_gain") == 5.0


def test_what_the_axis_refuses_is_status_1():
    done = forceaxis("axis", "set", *SIM, "force_bank=1")  # a bank that is not valid
    state = "force_bank: not in this state of the axis; while a cycle runs it cannot be changed"
    assert refusal(done, 1) == state


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "expected the address of one axis, as --on ADDRESS or in the environment"),
        (["--on", "lcm:1", "--on", "can0"], "expected the address of one axis, as --on ADDRESS"),
        (["--on", "lcm"], "--on: lcm: expected an address with the number of an axis, such"),
        (["--on", "lcm:1", "--set", "a=1"], "--set: expected a simulated axis together with"),
        (["--on", "nocan7"], "--on: nocan7: expected a CAN interface that is up"),
        (["--on", "can0:126"], "--on: can0:126: expected two different node ids"),
        (["--on", "http://x"], "--on: http://x: expected the address of an axis, such as can0:5"),
        (["--on", "sim:nowhere.toml"], "nowhere.toml"),
    ],
)
def test_one_way_and_no_more(options, says):
    assert refusal(forceaxis("axis", "get", *options, "force"), 2).startswith(says)


def test_a_library_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "canopen", None)
    monkeypatch.delitem(sys.modules, "forceaxis.axis.can", raising=False)
    done = forceaxis("axis", "get", "--on", "can0", "force")
    assert "pip install 'forceaxis[can]'" in refusal(done, 2)
    monkeypatch.setitem(sys.modules, "pymodbus.client", None)
    done = forceaxis("axis", "get", "--on", "tcp://localhost", "force")
    assert "pip install 'forceaxis[modbus]'" in refusal(done, 2)


def test_list_shows_the_simulated_axis():
    (row,) = json.loads(said(forceaxis("axis", "list", *SIM, "--json")))
    assert (row["id"], row["state"], row["fault"]) == (1, "switch on disabled", "none")
    assert row["table"] == OBJECTS_HASH[:8]
    done = forceaxis("axis", "list", "--on", "lcm:1")
    assert refusal(done, 2) == "expected the address of one bus, without an axis, such as --on lcm"
    done = forceaxis("axis", "list", "--on", "lcm@udpm://239.255.76.67:7699?ttl=0", "--json")
    assert (done.returncode, json.loads(done.stdout)) == (1, [])


def test_move_reaches_and_disables():
    done = json.loads(
        said(forceaxis("axis", "move", *SIM, "-1800", "--speed", "900 count/s", "--json"))
    )
    assert abs(done["position"] + 1800) <= 10
    with Axis(SimLink(CONTACT, GAINS)) as axis:
        axis.enable("profile position")
        axis.move(-1800)
        behind = axis.link.axis
    assert behind.read(BY_NAME["drive_state"].number) == 2  # ready_to_switch_on
    assert behind.read(BY_NAME["command_source"].number) == 0


def test_a_move_that_meets_something_ends_there(axis):
    truth, newton = axis.link.axis, quantity.force_per_count(axis)
    with pytest.raises(NoAnswer, match=r"expected position 5000 to be reached.*fault force_max"):
        actions.move(axis, 5000, 2000)
    axis.link.wait(0.5)
    # Switched off at 32 counts it still has the energy of its speed, some 40 counts.
    assert 32 * newton < truth.extremes["force_N"] < 80 * newton
    assert (axis.read("drive_state"), axis.read("force_max")) == ("fault", 0)
    axis.reset_fault()
    axis.set(force_max=100.0)
    actions.move(axis, -3000, counts=500.0)
    assert axis.read("force_max") == 100


def test_press_ends_beyond_its_bound(axis):
    with pytest.raises((NoAnswer, Refused), match="fault force_max"):
        axis.press(30.0, 1.0, speed=20_000, approach_s=5.0, force_max=31)
    assert axis.read("drive_state") == "fault" and axis.read("force_max") == 0
    done = forceaxis("axis", "press", *SIM, "30", "--force-max", "4000 N")
    assert "--force-max: expected a force limit of at most 512 force counts" in refusal(done, 2)


def test_a_position_that_is_not_reached_is_said(axis):
    axis.enable("profile position", trajectory_velocity=1000)
    with pytest.raises(NoAnswer, match="expected position -20000 to be reached"):
        axis.move(-20_000, timeout_s=0.1)


def test_press_in_newtons_holds_them_with_the_bank():
    found = json.loads(said(forceaxis("axis", "press", "--on", f"sim:{HOLD}", "75 N", "--json")))
    assert found["force_N"] == pytest.approx(75, abs=1)
    assert found["peak_N"] < 80.1  # sim/experiments/hold_biquad.toml


def test_press_in_counts_is_the_p_law():
    done = forceaxis("axis", "press", *SIM, "30", "--seconds", "1.5")
    lines = done.stdout.splitlines()
    # Figure 3.14: k_f = 5, f_d = 30 hold 26 or 27 counts.
    assert lines[-1].startswith("held 66") and len(lines) > 3
    # 66 of 75 N is not what was asked for.
    text = refusal(done, 1)
    assert "expected a mean force of 75 N within 1.5 N, got 66" in text
    assert "the P law (force_gain) leaves this error" in text and "`forceaxis design`" in text


@pytest.mark.parametrize("force", ["-50", "-50 N", "0", "0 N"])
def test_a_force_that_does_not_press_is_refused_before_the_axis_moves(axis, force):
    """It ran away from the part for 64 mm, or waited for a contact."""
    text = refusal(forceaxis("axis", "press", *SIM, "--", force), 2)
    assert "expected a force above 0" in text
    with pytest.raises(InputError, match="expected a force above 0"):
        axis.press(force)
    assert axis.read("drive_state") == "switch_on_disabled"


@pytest.mark.parametrize(("asked", "held", "has_bank", "words"), [
    (60.0, [32.9] * 8, True, "limit of the drive"),  # 32.87 of 60 N was success
    (60.0, [32.9] * 8, False, "P law"),
    (60.0, [20.0] * 4 + [40.0] * 4, True, "press longer"),
    (60.0, [61.1, 58.9] * 8, True, None),
    (10.0, [10.5] * 8, True, None),  # the reading has steps of one count
])  # fmt: skip
def test_a_press_beyond_two_per_cent_is_not_held(asked, held, has_bank, words):
    text = actions._not_held(asked, held, 1.0, has_bank)
    assert text is None if words is None else words in text


@pytest.mark.parametrize("verb", ["move 100", "press 20"])
def test_a_speed_without_its_unit_is_refused(verb):
    """`move --speed 5` was 5 encoder counts/s."""
    text = refusal(forceaxis("axis", *verb.split(), *SIM, "--speed", "5"), 2)
    assert '--speed: expected a speed with its unit, such as "' in text and '"5 count/s"' in text


def test_press_bounds_the_approach_and_restores_what_it_set(axis):
    before = axis.get("touch_velocity_max", "approach_timeout", "force_setpoint")
    axis.arm(["velocity_actual", "contact"], 2200)
    axis.press(30.0, 0.1, speed=1000)
    held = axis.link.recording(1.0)
    approach = held.values("velocity_actual")[held.values("contact") == 0]
    # touch.h: it overshoots by a tenth; the velocity comes in steps of 1500 / 16.
    assert 900 < approach.max() < 1300
    assert axis.get(*before) == before
    assert axis.read("drive_state") == "ready_to_switch_on"
    axis.set(force_setpoint=0.0)
    actions.move(axis, -3000, counts=500.0)
    with pytest.raises(NoAnswer, match=r"expected contact.*fault no_contact"):
        axis.press(30.0, 0.1, speed=10, approach_s=0.3)  # too slow for the distance
    assert axis.read("drive_state") == "fault"


@pytest.mark.parametrize("mode, gain, said", [("force", 0, 1), ("force", 4, 0), ("-2", 0, 0)])
def test_an_axis_that_is_enabled_without_a_position_gain_is_warned_of(mode, gain, said):
    done = forceaxis(
        "axis", "enable", "--on", f"sim:{CONTACT}", "--seconds", "0.2", "--set",
        f"firmware.position_gain={gain}", "--", mode,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("position_gain is 0: the axis neither approaches nor follows") == said


@pytest.mark.parametrize("verb", ["axis move 100", "axis press 20", "measure --free"])
def test_nothing_moves_without_a_position_gain(tmp_path, verb):
    out = ["--out", tmp_path / "out"] if verb.startswith("measure") else []
    done = forceaxis(*verb.split(), "--on", f"sim:{CONTACT}", *out)
    text = refusal(done, 1)
    assert "expected a position_gain" in text and "firmware.position_gain in the experiment" in text
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("force", ["60 kg", "much", "", "1 2 3"])
def test_press_wants_a_force(force):
    assert "expected a force such as" in refusal(forceaxis("axis", "press", *SIM, force), 2)


def test_enable_holds_for_a_while_and_ends_with_a_fault():
    done = forceaxis(
        "axis", "enable", *SIM, "profile velocity", "target_velocity=-3000", "--seconds", "0.5"
    )
    assert said(done).splitlines()[-1].startswith("after: operation enabled, mode profile velocity")
    done = forceaxis(
        "axis", "enable", *SIM, "force counts", "approach_timeout=100", "force_setpoint=-5"
    )
    last = said(done, 1).splitlines()[-1]
    assert last.startswith("no longer enabled: fault, mode force counts, fault no_contact")
    done = forceaxis("axis", "enable", *SIM, "sideways")
    assert "expected a mode of operation" in refusal(done, 2)


def test_reset_and_stop(axis):
    axis.enable("force counts", approach_timeout=100, force_setpoint=-5.0)
    with pytest.raises(NoAnswer):
        axis.wait_for(StatusObjects, lambda s: False, "the fault", 1.0)
    axis.reset_fault()
    assert axis.wait_for(FaultObjects, lambda s: s.fault == "none", "no fault")
    axis.enable("profile velocity", target_velocity=0)
    axis.set(target_velocity=-5000)
    axis.link.wait(0.5)
    now = actions.stop(axis)
    assert (now.state, now.fault) == ("switch on disabled", "none")
    assert said(forceaxis("axis", "stop", *SIM)).startswith("stopped: switch on disabled")
    assert said(forceaxis("axis", "reset", *SIM)).startswith("reset: switch on disabled")


@pytest.mark.parametrize(
    ("words", "begun", "sent", "status"),
    [
        (["enable", "profile velocity"], "stdout", signal.SIGINT, 130),
        (["enable", "profile velocity"], "stdout", signal.SIGTERM, 143),
        (["press", "30", "--seconds", "3600"], "stdout", signal.SIGINT, 130),
        (["measure", "--force", "30", "--averages", "4000"], "stderr", signal.SIGINT, 130),
    ],
)
def test_an_interrupt_disables_and_says_so(words, begun, sent, status):
    verb = ["measure"] if words[0] == "measure" else ["axis", words[0]]
    process = subprocess.Popen(
        [Path(sys.executable).parent / "forceaxis", *verb, *SIM, *words[1:]],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
        # A shell's background command, as tests may be, ignores it.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    assert getattr(process, begun).readline()  # it is enabled, or about to be
    process.send_signal(sent)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == status
    *before, last = errors.splitlines()
    assert (
        last == f"forceaxis: interrupted, the simulated axis of {CONTACT} is disabled and released"
    )
    assert not before or begun == "stderr"


def test_an_interrupt_of_a_verb_that_only_reads_is_one_line(monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Axis, "get", interrupted)
    done = forceaxis("axis", "get", *SIM, "force")
    assert refusal(done, 130) == f"interrupted, the simulated axis of {CONTACT} was not owned"
    monkeypatch.setattr(SimLink, "__init__", interrupted)
    assert refusal(forceaxis("axis", "press", *SIM, "30"), 130) == "interrupted"


def test_tare_at_rest_and_the_reason_where_it_is_refused(axis):
    assert actions.tare(axis) == actions.TareResult(force_tare=0.0, force=0.0)
    axis.enable("profile velocity")
    with pytest.raises(Refused, match="tare: not in this state of the axis"):
        actions.tare(axis)
    lines = said(forceaxis("axis", "tare", *SIM)).splitlines()
    assert lines == ["force_tare  0 N (0 force counts)", "force       0 N (0 force counts)"]


def test_calibration_by_points(axis):
    found = actions.calibrate(axis, [(0.0, 0.0), (20.0, 50.0), (40.0, 100.2)])
    # Least squares by NumPy.
    slope = np.polyfit([0.0, 20.0, 40.0], [0.0, 50.0, 100.2], 1)[0]
    assert found.force_scale_N_per_count == pytest.approx(slope, abs=1e-6)
    assert axis.read("date") > 15_000  # days since 1984
    with pytest.raises(Refused, match="calibration refused spread"):
        actions.calibrate(axis, [(0.0, 0.0), (20.0, 50.0)])
    with pytest.raises(Refused, match="calibration refused linearity, linearity error"):
        actions.calibrate(axis, [(0.0, 0.0), (20.0, 70.0), (40.0, 100.0)])
    with pytest.raises(InputError, match="expected 2 to 8 calibration points, got 1"):
        actions.calibrate(axis, [(0.0, 0.0)])


def test_calibrate_takes_points_or_asks():
    done = forceaxis("axis", "calibrate", *SIM, "--point", "0,0", "--point", "40,101")
    assert said(done).startswith("force_scale 2.525 N/count, linearity error 0 per mille")
    # Nothing presses: both readings are 0, which the axis refuses.
    done = forceaxis("axis", "calibrate", *SIM, stdin="0\n50\n\n")
    assert "0 force counts = 50 N" in done.stdout
    assert "calibration refused spread" in refusal(done, 1)
    done = forceaxis("axis", "calibrate", *SIM, "--point", "40")
    assert refusal(done, 2) == (
        "--point 40: expected COUNT,N, a measured force in counts and a reference force in N, such "
        "as 20.4,50"
    )


def test_capture_of_a_touch_with_its_files(tmp_path):
    """The trigger is a force in N, which comes while a verb of another kind presses."""
    with Axis(SimLink(CONTACT, GAINS)) as axis:
        settings = quantity.trigger(axis, "force rising 25 N")
        assert settings == trigger_on("force", 10.0)
        axis.arm(["force", "position", "tick_count"], 300, pretrigger=50, **settings)
        axis.enable("force counts", force_setpoint=30.0)
        held = axis.link.recording(5.0)
    force, ticks = held.values("force"), held.values("tick_count")
    assert (len(force), held.trigger_sample) == (300, 50)
    assert (np.diff(ticks) == 1).all()
    assert (force[:50] < 10).all() and force[50] >= 10
    assert held.time_s[50] == 0 and held.time_s[-1] == pytest.approx(249 / 1500)
    done = forceaxis(
        "axis", "capture", *SIM, "force", "position", "--samples", "90", "--decimation", "3",
        "--out", tmp_path / "held", "--json",
    )  # fmt: skip
    found = json.loads(said(done))
    assert found["samples"] == 90 and found["signals"]["position"]["mean"] == -1575
    rows = (tmp_path / "held/capture.csv").read_text().splitlines()
    assert rows[0] == "time_s,force_count,position_count" and len(rows) == 91
    assert np.load(tmp_path / "held/capture.npz")["time_s"][1] == pytest.approx(3 / 1500)
    assert (tmp_path / "held/capture.png").read_bytes().startswith(b"\x89PNG")
    for suffix in ("csv", "npz"):  # both files of the axis' own recorder become a recording
        made = forceaxis(
            "recording", "import", tmp_path / f"held/capture.{suffix}", "--out", tmp_path / suffix,
            "--map", "force=force_count:2.5N,position=position_count:6.35um",
        )  # fmt: skip
        assert made.returncode == 0, made.stderr
        recording = signal_recording.read(tmp_path / f"{suffix}.npz")
        captured = np.load(tmp_path / "held/capture.npz")
        np.testing.assert_allclose(recording["force"].values, captured["force_count"] * 2.5)
        assert recording["force"].rate_hz == pytest.approx(500)


def test_a_trigger_that_does_not_fire_is_said():
    done = forceaxis(
        "axis", "capture", *SIM, "force", "--trigger", "force rising 31", "--timeout", "0.5"
    )
    assert refusal(done, 1).endswith(
        "but the recorder is armed; the trigger condition has not occurred"
    )
    done = forceaxis("axis", "capture", *SIM, "force", "--trigger", "force up 31")
    assert 'expected a trigger as "NAME rising|falling|either LEVEL"' in refusal(done, 2)
    done = forceaxis("axis", "capture", *SIM, *["force"] * 9)
    assert refusal(done, 2) == "capture: expected 1 to 8 signals, got 9"


def test_the_watchdog_is_fed_several_times_within_it():
    fed, refused = [], []

    def write(value):
        if len(fed) == 3 and not refused:
            refused.append(value)
            raise Refused("not now")
        fed.append((time.monotonic(), value))

    keeper = WatchdogKeeper(lambda: 100, write)
    time.sleep(0.15)
    with keeper.unchanged:
        time.sleep(0.02)
        held = len(fed)
        time.sleep(0.08)
        assert len(fed) == held  # nobody's new value is overwritten
    time.sleep(0.4)
    keeper.close()
    assert {value for _, value in fed} == {100} and refused == [100]
    assert fed[2][0] - fed[0][0] < 0.3  # 25 ms apart, where the machine is not busy
    assert len(fed) > 5  # a refusal ended nothing


def test_a_busy_program_feeds_the_watchdog_all_the_same():
    """Python and NumPy at work in the main thread for two seconds."""
    fed = []
    keeper = WatchdogKeeper(lambda: 500, lambda value: fed.append(time.monotonic()))
    end, matrix = time.monotonic() + 2.0, np.eye(150)
    while time.monotonic() < end:
        sum(i * i for i in range(20_000))
        np.linalg.svd(matrix)
    keeper.close()
    assert np.diff(fed).max() < 0.5
    assert len(fed) > 8


class Lost(SimLink):
    """An axis that stops answering, or is taken by another client."""

    error = None

    def read(self, names):
        if self.error:
            raise self.error
        return super().read(names)


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (None, "is disabled and released"),
        (NoAnswer("silent"), "does not answer; its watchdog disables it"),
        (Refused("locked"), "is owned by another client"),
    ],
)
def test_close_says_what_came_of_it(error, says):
    axis = Axis(Lost(CONTACT, GAINS))
    axis.acquire()
    axis.enable("profile velocity")
    axis.link.error = error
    assert axis.close() == says
    assert axis.close() == "was not owned"


def test_an_enabled_axis_of_another_client_is_shared_only_if_wanted(axis, monkeypatch):
    monkeypatch.setattr(axis.link, "close", lambda: None)  # both have this one
    axis.enable("profile velocity")
    other = Axis(axis.link)
    with pytest.raises(
        Refused,
        match="the axis is operation enabled by another client of this bus; end that client, or "
        r"stop the axis with `axis.stop\(\)`",
    ):
        other.acquire()
    other.acquire(shared=True)
    other.set(velocity_window=123)
    other.close()
    assert axis.read("drive_state") == "operation_enabled"
    assert axis.get("velocity_window", "command_source") == {
        "velocity_window": 123, "command_source": "lcm",
    }  # fmt: skip


def test_what_was_not_enabled_is_left_as_it_was():
    with Axis(SimLink(CONTACT)) as axis:
        axis.set(force_gain=6.0)
        behind = axis.link.axis
    assert behind.read(BY_NAME["drive_state"].number) == 1  # switch_on_disabled


def test_a_closed_link_frees_the_file_of_its_store(tmp_path):
    store = tmp_path / "store.bin"
    with Axis(SimLink(CONTACT, store=store)) as axis:
        axis.set(velocity_window=321)
        axis.set(store_all=0x65766173)
        axis.link.wait(1.0)
        with pytest.raises(InputError, match="store"):
            SimLink(CONTACT, store=store)  # one has it already
    with Axis(SimLink(CONTACT, store=store)) as again:  # though `axis` is still there
        assert again.read("velocity_window") == 321


def test_a_fault_is_named_in_words_with_the_command_that_resets_it(axis):
    done = forceaxis("axis", "move", *SIM, "5000", "--speed", "2000 count/s")
    told = "; `forceaxis axis reset --on sim:sim/experiments/contact.toml` resets the fault"
    assert refusal(done, 1).endswith(told)
    resets = r"; `axis.reset_fault\(\)` resets the fault$"
    with pytest.raises(NoAnswer, match=f"fault force_max.*{resets}"):
        actions.move(axis, 5000, 2000)
    for enabling in (
        lambda: axis.enable("profile velocity"),
        lambda: actions.move(axis, 0),
        lambda: axis.press(30.0, 0.1, speed=1000, approach_s=1.0),
    ):
        with pytest.raises(Refused, match=f"fault force max{resets}"):
            enabling()


def test_a_list_fits_80_columns_with_the_longest_words():
    longest = ScannedAxis(
        127, "forceaxis", "0.1.0 904ee356 0123456", "904ee356", "fault reaction active",
        "cyclic synchronous torque", max(BY_NAME["fault"].enum, key=len), "canopen", "silent " * 20,
    )  # fmt: skip
    shown = list(table_of([longest, ScannedAxis(1)]))
    assert max(map(len, shown)) <= 80
    assert shown[0].split() == ["id", "name", "version", "table", "state", "fault"]
    assert "current sensor failed" in shown[1] and shown[1].index("0.1.0") == shown[0].index("ver")
    assert shown[2].startswith("  silent") and shown[-1].split() == ["1", *"-----"]
