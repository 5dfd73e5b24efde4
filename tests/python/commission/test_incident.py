"""`forceaxis axis incident`: faults provoked on a simulated axis, each named with what led to
it."""

import dataclasses
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from forceaxis._core import InputError
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import Refused
from forceaxis.axis.sim import SimLink
from forceaxis.commission import incident, incident_text
from forceaxis.recordings import signal_recording
from protections import ENABLE, NEAR, PROTECTIONS, experiment, pressing
from verbs import forceaxis

ROOT = Path(__file__).resolve().parents[3]
CONTACT = ROOT / "sim/experiments/contact.toml"
SESSION = ROOT / "sim/experiments/session.toml"
GAINS = {"position_gain": 4.0, "velocity_gain": 20.0, "force_gain": 5.0}
COUNTS_PER_MM = 157.480315
BY_NAME = {row.name: row for row in PROTECTIONS}
# What the story of a fault has to say beside its name.
PROVOKED = {
    "force too large": ("force_max", "contact began 4.7 ms before", "force rose 155 N in 12.7 ms"),
    "force sensor at an end of its range": ("force_railed", "end of its range in the last 75 tick"),
    "force sensor that jumps": ("force_jump", "jumped by 57.5 N in one tick, 0.0 ms before"),
    "force sensor that is stuck": ("force_stuck", "at one code (23) for", "moved 0.4"),
    "force sensor that is disconnected": ("force_disconnected", "at one code (0)", "up to 135"),
    "travel in contact": ("contact_travel", "in contact by more than contact_travel_max"),
    "time of an approach": ("no_contact", "enabled for 305 ms", "no contact in the recorded"),
    "contact lost again and again, option fault": (
        "contact_unstable",
        "lost 3 times",
        "swung by 72.5 N",
    ),
}


def at_end_of(folder, text, owned=True):
    """The axis of an experiment whose time is over."""
    file = folder / "run.toml"
    file.write_text(text)
    content = tomllib.loads(text)
    mode = content["firmware"].get("mode")
    link = SimLink(file, [f"firmware.mode={mode}"] if mode else [])
    link.axis.step(round(content["duration_s"] * 1500))
    axis = Axis(link)
    if owned:
        axis.acquire()
    return axis


def moving(**parameters):
    """An axis on its way, in profile position mode, owned."""
    axis = Axis(SimLink(SESSION))
    axis.acquire()
    axis.set(**GAINS, **parameters)
    axis.enable("profile position")
    axis.set(target_position=36_000, controlword=0x1F)
    axis.link.wait(0.05)
    return axis


def told(axis, fault):
    found = incident.fetch(axis)
    assert (found.fault, axis.read("fault")) == (fault, fault)
    return "\n".join(incident_text.tell(found, COUNTS_PER_MM))


@pytest.mark.parametrize("name", PROVOKED)
def test_a_fault_is_named_with_what_led_to_it(tmp_path, name):
    fault, *led = PROVOKED[name]
    text = told(at_end_of(tmp_path, BY_NAME[name].provoked), fault)
    for words in (fault.replace("_", " "), *led):
        assert words in text


def test_a_protection_that_does_not_act_is_no_incident(tmp_path):
    axis = at_end_of(tmp_path, BY_NAME["force too large"].beside, owned=False)
    with pytest.raises(Refused, match="nothing has happened since"):
        incident.fetch(axis)


def test_what_the_board_said_of_its_fault_is_told():
    """PC, LR, CFSR, HFSR and BFAR of a fault of the processor; bits of board_state in words."""
    axis = moving(speed_max=0)
    axis.set(following_error_max=1)
    axis.link.wait(0.05)
    found = incident.fetch(axis)
    assert {"reset_cause", "board_state", "core_fault_pc"} <= found.parameters.keys()
    said = {"core_fault_pc": 0x0800D234, "core_fault_lr": -1, "core_fault_cfsr": 0x8200,
            "core_fault_hfsr": 0x40000000, "core_fault_bfar": 0x20030000}  # fmt: skip
    core = dataclasses.replace(
        found, fault="none", error_code="core_fault", parameters=found.parameters | said
    )
    text = "\n".join(incident_text.tell(core))
    for words in ("core fault", "PC 0x0800d234", "LR 0xffffffff", "CFSR 0x00008200"):
        assert words in text, text
    board = dataclasses.replace(
        found, fault="output_wrong", parameters=found.parameters | {"board_state": 64 + 1}
    )
    assert "DAC output differs from its code" in "\n".join(incident_text.tell(board))


def test_the_input_that_changed_is_named():
    """By the bits of digital_inputs in the manual: 3 is the index pulse, 4 the home switch."""
    for bit, name in enumerate(("enable chain", "positive", "negative", "index", "home")):
        story = object.__new__(incident_text._Story)
        story.inputs, story.at = np.array([0, 0, 1 << bit]), 2
        assert name in story.switches() and "0.0 ms before" in story.switches()


def test_speed():
    axis = moving()
    axis.set(speed_max=5)
    axis.link.wait(0.5)
    text = told(axis, "overspeed")
    assert (
        "overspeed at tick" in text
        and "it moved at 61.9 mm/s" in text
        and "set-point 0.48 mm" in text
    )


def test_following_error():
    axis = moving(following_error_max=40)
    axis.link.wait(0.5)
    assert "following error" in told(axis, "following_error")


def test_an_owner_that_is_lost():
    axis = moving()
    axis.link.axis.step(2000)  # nobody writes
    axis.acquire()
    text = told(axis, "source_lost")
    assert "the owner of the axis wrote nothing" in text


def test_the_recorder_is_anybodys_after_a_fetch_and_the_incident_stays(tmp_path):
    axis = at_end_of(tmp_path, BY_NAME["force sensor that jumps"].provoked)
    first = incident.fetch(axis)
    assert axis.read("recorder_state") == "idle"
    assert (incident.fetch(axis).recording.raw == first.recording.raw).all()
    incident.clear(axis)
    assert axis.read("blackbox_state") == "recording"


def test_an_incident_outlives_a_power_cut_until_it_is_cleared(tmp_path):
    file, store = tmp_path / "hard.toml", tmp_path / "store"
    file.write_text(experiment(pressing("force_max = 20"), ENABLE, sets=NEAR))

    def powered(clear=False, wait_s=0.0):
        """What the axis has after a power cut, without a second fault."""
        link = SimLink(file, [] if wait_s else ["firmware.force_setpoint=0"], store)
        axis = Axis(link)
        if wait_s:
            axis.link.axis.step(round(wait_s * 1500))
            axis.wait_for(incident.ArchiveObjects, lambda s: s.incident_stored == "stored", "", 5.0)
        axis.acquire()
        try:
            found = incident.fetch(axis)
            if clear:
                incident.clear(axis)
                axis.link.wait(0.01)
            return found
        finally:
            axis.close()

    first = powered(wait_s=3.0)
    assert not first.archived
    again = powered()
    assert again.archived and (again.recording.raw == first.recording.raw).all()
    assert incident_text.tell(again)[0].startswith("force max (kept over a power cut) at tick")
    assert powered(clear=True).tick == first.tick
    with pytest.raises(Refused, match="nothing has happened since"):
        powered()


def test_a_capture_gives_the_buffer_back():
    axis = moving()
    axis.capture(["force"], samples=10)
    axis.link.wait(0.01)
    assert axis.read("blackbox_state") == "recording"


def test_the_file_is_the_incident(tmp_path):
    found = incident.fetch(at_end_of(tmp_path, BY_NAME["force too large"].provoked))
    incident.write(found, tmp_path / "kept", incident.figure(found, COUNTS_PER_MM))
    kept = tmp_path / "kept/incident.json"
    again = incident.load(kept)
    assert (again.recording.raw == found.recording.raw).all()
    assert incident_text.tell(again) == incident_text.tell(found)
    assert (tmp_path / "kept/incident.png").stat().st_size > 10_000
    content = json.loads(kept.read_text())
    content["samples"]["position"][3] += 1
    kept.write_text(json.dumps(content))
    with pytest.raises(InputError, match="CRC"):
        incident.load(kept)
    content["forceaxis_incident"] = 2
    kept.write_text(json.dumps(content))
    with pytest.raises(InputError, match="expected an incident file of version 1, got version 2"):
        incident.load(kept)


def test_an_incident_becomes_a_recording(tmp_path):
    sets = ("firmware.mode=force", "firmware.force_gain=5", "firmware.force_max=30")
    options = [word for text in sets for word in ("--set", text)]
    done = forceaxis(
        "axis", "incident", "--on", f"sim:{CONTACT}", *options, "--wait", "5", "--out", tmp_path
    )
    assert done.returncode == 0, done.stderr
    found = incident.load(tmp_path / "incident.json")
    done = forceaxis(
        "recording", "import", tmp_path / "incident.json", "--out", tmp_path / "fault",
        "--map", "force=force_N,code=dac_code,position=travel_count:6.35um,enabled=enabled",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    recording = signal_recording.read(tmp_path / "fault.npz")
    assert recording.source.kind == "incident"
    np.testing.assert_allclose(recording["force"].values, found.force_N)
    np.testing.assert_allclose(recording["force"].time_s * 1e3, found.time_ms, atol=1e-9)
    np.testing.assert_allclose(recording["position"].values, found.travel * 6.35e-6)
    assert (recording["code"].values == found.column("dac_code")).all()
    # Fed with codes and enable, the plant makes the contact and the bounce after the fault again.
    done = forceaxis(
        "compare", CONTACT, tmp_path / "fault.npz", "--gap", "approach", "--samples", "8", "--json"
    )
    figures = {one["figure"]: one for one in json.loads(done.stdout)[0]["figures"]}
    assert figures["residual of force"]["measured"] < 1.25  # half of a count
    assert figures["residual of position"]["measured"] < 4 * 6.35e-6
    assert figures["loss 1"]["agrees"]


def test_a_replay_names_what_an_incident_lacks(tmp_path):
    texts = {}
    for name in ("force too large", "force sensor that is stuck"):
        found = incident.fetch(at_end_of(tmp_path, BY_NAME[name].provoked))
        incident.write(found, tmp_path / name, incident.figure(found))
        done = forceaxis("recording", "replay", tmp_path / name / "incident.json")
        assert done.returncode == 1
        texts[name] = done.stderr
    assert all("targets and controlwords" in text for text in texts.values())
    # The first one was enabled within its second: everything before is as at power-up.
    assert "force_integral" not in texts["force too large"]
    assert "force_integral" in texts["force sensor that is stuck"]


def test_the_verb(tmp_path):
    file = tmp_path / "hard.toml"
    file.write_text(experiment(pressing("force_max = 20"), ENABLE, sets=NEAR))
    out = tmp_path / "out"
    words = ("axis", "incident", "--on", f"sim:{file}", "--wait", "3", "--counts-per-mm", "157.48")
    done = forceaxis(*words, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "force max at tick" in done.stdout and "mm/s" in done.stdout
    assert sorted(p.name for p in out.iterdir()) == ["incident.json", "incident.png"]
    found = json.loads(forceaxis(*words, "--json").stdout)
    assert found["fault"] == "force_max" and found["story"]


def test_the_verb_without_an_incident():
    done = forceaxis("axis", "incident", "--on", f"sim:{CONTACT}")
    assert done.returncode == 1
    assert "expected an incident, nothing has happened" in done.stderr
