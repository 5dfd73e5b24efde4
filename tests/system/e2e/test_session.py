"""A whole session of the thesis through the gateway alone, on real CAN and in real time: what
`forceaxis thesis session` says, what it leaves behind, and that its journal runs again in
process."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.alone, pytest.mark.long]  # half a minute of real time
ROOT = Path(__file__).resolve().parents[3]
FORCEAXIS = Path(sys.executable).parent / "forceaxis"


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    done = subprocess.run(
        [FORCEAXIS, "thesis", "session", "--out", folder, "--json"],
        cwd=ROOT, capture_output=True, text=True, timeout=120, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return json.loads(done.stdout), folder


def test_the_axis_went_where_it_was_sent(held):
    found, _ = held
    assert found["software"] != 0
    # position_window is 10 counts; the workpiece is 37,795 counts away.
    assert abs(found["position_after_move_cnt"] - 36_000) <= 10
    assert 37_700 <= found["position_in_contact_cnt"] <= 38_100


def test_contact_is_held_and_survives_the_strike(held):
    found, _ = held
    # k_f = 5 and f_d = 30: as in sim/experiments/contact.toml the reading settles at 26 or 27.
    assert 25 <= found["force_held_cnt"] <= 28
    assert found["peak_force_cnt"] >= found["force_held_cnt"] + 10
    assert 23 <= found["force_after_cnt"] <= 30
    assert found["fault"] == "none"


def test_nothing_was_lost_on_the_way(held):
    found, _ = held
    assert (found["samples"], found["samples_missing"]) == (1800, 0)
    assert found["messages_lost"] == 0
    assert found["states"] > 200
    assert found["gateway_status"] == 0


def test_plant_firmware_and_replay_agree(held):
    found, folder = held
    assert len({*found["trace_hash"].values(), found["replayed_hash"]}) == 1
    done = subprocess.run(
        [FORCEAXIS, "recording", "replay", folder / "axis.journal", "--json"],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    again = json.loads(done.stdout)
    assert again["trace_hash"] == found["trace_hash"]["plant_node"]
    assert again["replay"]["same"]


@pytest.mark.long
def test_the_example_holds_the_session_too(tmp_path, vcan):
    script = (
        "import pathlib, subprocess, sys\n"
        "from forceaxis.thesis import session as thesis_session\n"
        "with thesis_session.machine(pathlib.Path(sys.argv[1])):\n"
        "    sys.exit(subprocess.run([sys.executable, 'examples/session.py']).returncode)\n"
    )
    done = vcan([sys.executable, "-c", script, tmp_path], 60)
    assert done.returncode == 0, done.stderr
    moved, touched, struck = done.stdout.splitlines()
    assert moved.startswith("position 3600") or moved.startswith("position 3599")
    assert touched.startswith("in contact, force 2")
    assert struck.startswith("struck: 1800 samples, ")


def test_there_is_a_plot(held):
    _, folder = held
    assert (folder / "session.png").read_bytes().startswith(b"\x89PNG")
