"""Sessions: nodes that run until they are ended, and go on after one of them was stopped."""

import json
import re
import signal
import subprocess
import time

import endless_session
import pytest
import verbs
from fault_session import NODES, end
from forceaxis.experiments import link
from steps import run

MODBUS = 2  # of stopped_by
LINKS = [pytest.param("lcm", marks=pytest.mark.long), "socketcan"]
SHORT = "--set", "experiment.duration_s=0.1", "--set", "verdict.window_s=0.1"


@pytest.fixture(scope="module")
def sessions(tmp_path_factory, vcan):
    class Sessions(dict):
        """What was seen by kind of session, each run once."""

        def __missing__(self, kind):
            folder = tmp_path_factory.mktemp(kind)
            self[kind] = run(vcan, folder, 120, endless_session.__file__, kind)
            return self[kind]

    found = Sessions()
    yield found
    for session in found.values():
        session.expect_end()


def start(name, *args, wait_s=20):
    return endless_session.start(name, *args, pace="fast", wait_s=wait_s)


def replayed(journal):
    done = verbs.forceaxis("recording", "replay", journal, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def missed(pattern, text):
    """Of the line: seconds, ticks and the tick at which it goes on."""
    found = re.search(pattern + r" (\d+\.\d+) s, (\d+) ticks; continues at tick (\d+)", text)
    assert found, text
    seconds, ticks, tick = float(found[1]), int(found[2]), int(found[3])
    assert abs(ticks - 1500 * seconds) <= 2
    return seconds, tick


@pytest.mark.parametrize("kind", LINKS)
@pytest.mark.parametrize("node", ["plant", "axis"])
def test_a_stopped_node_says_what_it_missed_and_the_axis_moves_again(sessions, kind, node):
    seen = sessions[kind]
    assert seen["before"]["state"] == endless_session.OPERATION_ENABLED
    assert seen["before"]["way"] < -300
    # Disabled by name, and it stays so until it is reset.
    stopped = seen[node]
    assert endless_session.SENSOR_INVALID in stopped["emergencies"]
    assert (stopped["fault"], stopped["error_code"]) == (1, endless_session.SENSOR_INVALID)
    assert (stopped["state"], stopped["code"]) == (0x08, 0)
    assert stopped["after"]["state"] == endless_session.OPERATION_ENABLED
    assert stopped["after"]["way"] < -300
    reports = seen["reports"]
    own, tick = missed("_node: suspended for", reports[node]["stderr"])
    assert own >= endless_session.STOPPED_S - 0.01
    other = "axis" if node == "plant" else "plant"
    line = rf"{other}_node: {node}_node (?:\(axis 1\) )?was silent for"
    assert missed(line, reports[other]["stderr"])[1] == pytest.approx(tick, abs=1)
    for report in reports.values():
        assert report["session"]["interruptions"] == 2
        assert report["session"]["missed_s"] > 3


@pytest.mark.parametrize("kind", LINKS)
def test_either_node_ends_the_session_and_the_other_names_it(sessions, kind):
    reports = sessions[kind]["reports"]
    first, second = ("axis", "plant") if kind == "lcm" else ("plant", "axis")
    assert [r["status"] for r in reports.values()] == [0, 0]
    assert reports[first]["session"]["ended"] == "by a signal"
    assert reports[second]["session"]["ended"].startswith(f"{first}_node has ended at tick ")
    assert f"{second}_node: {first}_node has ended" in reports[second]["stderr"]


@pytest.mark.parametrize("kind", LINKS)
def test_an_interrupted_session_replays_to_one_hash(sessions, kind, tmp_path):
    journal = tmp_path / "axis.journal"
    journal.write_text(sessions[kind]["journal"])
    hashes = {r["axes"][0]["trace_hash"] for r in sessions[kind]["reports"].values()}
    summary = replayed(journal)
    assert {summary["trace_hash"]} == hashes and summary["replay"]["same"]
    # It is no replay of a shorter run, and the ticks without sensors matter to it.
    assert summary["ticks"] == sessions[kind]["reports"]["axis"]["axes"][0]["ticks"] > 3000
    without = [x for x in journal.read_text().splitlines() if not x.startswith("sensorless")]
    journal.write_text("\n".join([*without, ""]))
    assert verbs.forceaxis("recording", "replay", journal).returncode == 1
    journal.write_text("\n".join([*without[:5], "sensorless 0 0", ""]))
    done = verbs.forceaxis("recording", "replay", journal)
    assert done.returncode == 2 and "line 6: expected a count" in done.stderr


def test_a_stop_reaches_an_axis_whose_heartbeat_is_missed(sessions):
    seen = sessions["not_heard"]
    assert seen["before"]["state"] == endless_session.OPERATION_ENABLED
    assert "axis 1: heartbeat lost" in seen["said"]
    # The burst of frames that waited for the axis may cost the answer, not the stop.
    assert seen["answer"] in ("0600000000", "860b")
    assert (seen["state"], seen["fault"], seen["stopped_by"]) == (0x40, 0, MODBUS)


def test_a_session_outlives_its_experiment(tmp_path):
    run = ["--run-id", link.new_run_id(), *SHORT]
    journal = tmp_path / "axis.journal"
    axis, plant = start("axis_node", *run, "--journal", journal), start("plant_node", *run)
    time.sleep(1)
    # Ctrl-C in a shell reaches both.
    for process in (axis, plant):
        process.send_signal(signal.SIGINT)
    reports = end(axis), end(plant)
    assert [(r["status"], r["axes"][0].get("verdict")) for r in reports] == [(0, None)] * 2
    ticks = reports[1]["ticks"]
    assert ticks > 300  # the experiment has 151
    assert reports[0]["axes"][0]["ticks"] - ticks in (0, 1)
    summary = replayed(journal)
    assert summary["replay"]["same"] and summary["ticks"] == reports[0]["axes"][0]["ticks"]


@pytest.mark.parametrize("killed", ["axis", "plant"])
def test_a_killed_node_ends_the_session_by_name(killed):
    run = ["--run-id", link.new_run_id(), "--timeout", "0.3"]
    nodes = {"axis": start("axis_node", *run), "plant": start("plant_node", *run)}
    time.sleep(0.3)
    victim = nodes.pop(killed)
    victim.kill()
    victim.communicate()
    (other,) = nodes
    told = end(nodes[other])
    assert told["status"] == 0
    assert told["stderr"].startswith(f"{other}_node: {killed}_node has ended at tick ")
    assert told["stderr"].count("\n") == 1


def test_a_session_whose_partner_never_comes_fails():
    for name, partner in (("plant_node", "axis_node"), ("axis_node", "plant_node")):
        told = end(start(name, "--run-id", link.new_run_id(), wait_s=0.3))
        assert told["status"] == 1 and f"{name}: {partner}" in told["stderr"]


def test_runs_of_standard_input_end():
    words = [NODES / "axis_node", "--serve", "--endless"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=20, check=False)
    assert done.returncode == 2
    assert (
        done.stderr
        == "axis_node: --endless: expected no --serve, because runs of --serve have a duration\n"
    )
