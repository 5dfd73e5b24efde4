"""Lock-step over real transports: processes, datagrams and frames, lost, doubled and changed ones.

Expected hashes are those of the run in process.
"""

import collections
import contextlib
import json
import os
import re
import signal
import struct
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import lcm
import pytest
import verbs
from cycle_examples import PARTS, expect_the_same, file_of
from forceaxis import _core
from forceaxis.bus.lcm import Bus, decode
from forceaxis.experiments import link
from forceaxis.thesis import tables
from own_network import OWN_NETWORK
from steps import found_by

ROOT = Path(__file__).resolve().parents[2]
EXPERIMENT = ROOT / "sim" / "experiments" / "contact.toml"
FORCEAXIS = Path(sys.executable).parent / "forceaxis"
NODES = ROOT / "build" / "release" / "host"
VCAN = ROOT / "tools" / "vcan"
SHORT = "experiment.duration_s=1"
FAULTS = "drop=0.06,double=0.06,seed=3"


def forceaxis(*args, status=0):
    done = subprocess.run(
        [FORCEAXIS, *map(str, args)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == status, done.stderr
    return done


def replay(*args, status=0):
    done = verbs.forceaxis("recording", "replay", *args)
    assert done.returncode == status, done.stderr
    return done


def run(*args):
    return json.loads(forceaxis("run", EXPERIMENT, *args, "--json").stdout)


def in_process(*overrides):
    return _core.run(str(EXPERIMENT), list(overrides)).trace_hash


@contextlib.contextmanager
def load():
    """A process that never sleeps on every CPU but one, so that the two sides must wait."""
    words = [sys.executable, "-c", "while True: pass"]
    busy = [subprocess.Popen(words) for _ in range(max(1, (os.cpu_count() or 1) - 1))]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def start(name, *args, experiment=EXPERIMENT):
    words = [str(NODES / name), str(experiment), *map(str, args)]
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
    )
    assert "ready" in process.stdout.readline()
    return process


def end(process):
    out, error = process.communicate(timeout=60)
    return {"status": process.returncode, "stderr": error, **json.loads(out.splitlines()[-1])}


def hashes(report):
    return [axis["trace_hash"] for axis in report["axes"]]


@pytest.fixture(scope="module")
def can(tmp_path_factory, vcan):
    """Everything that needs CAN frames."""
    session = Path(__file__).with_name("can_session.py")
    yield from found_by(vcan, tmp_path_factory.mktemp("can"), 120, session)


# The same trace.


# The other boards have the program of the STM32 and no image in a short run: test_lockstep.py.
BOARDS = ("pil-stm32", "pil-microbit", "pil-riscv32")
KINDS = [kind for kind in link.KINDS if kind in BOARDS or not kind.startswith("pil-")]


@pytest.mark.parametrize("kind", KINDS)
def test_the_trace_is_that_of_the_run_in_process_on_a_loaded_machine(kind):
    with load():
        summary = run("--link", kind)
    told = summary["link"]
    assert summary["trace_hash"] == in_process()
    assert told["hashes"] == {"plant": summary["trace_hash"], "axis": summary["trace_hash"]}
    assert told["kind"] == kind
    assert len(set(told["pids"].values())) == (1 if kind == "inproc" else 2)
    assert summary["verdict"] == "stable"
    assert summary["energy"]["supplied_J"] > 0


def test_lost_and_doubled_datagrams_change_nothing():
    with load():
        summary = run("--link", "lcm", "--inject", FAULTS)
    told = summary["link"]
    assert told["hashes"] == {"plant": in_process(), "axis": in_process()}
    for end_ in told["statistics"].values():
        assert end_["dropped"] > 0 and end_["doubled"] > 0
        assert end_["dropped"] + end_["doubled"] >= 0.09 * end_["sent"]
        assert end_["on_wire"] == end_["sent"] - end_["dropped"] + end_["doubled"]
    plant, axis = told["statistics"]["plant"], told["statistics"]["axis"]
    # Every loss causes one repeat; only ticks and repeats were sent.
    assert plant["repeated"] >= plant["dropped"]
    assert plant["sent"] == summary["ticks"] + plant["repeated"]
    # The second one of the last record may come after the axis has ended.
    assert 0 <= plant["on_wire"] - axis["received"] <= 1
    assert axis["sent"] == summary["ticks"] + axis["repeated"]


def logged_run(log, duration):
    """The reports of a run in real time, and {channel: [tick, ...]} as lcm-logger has it."""
    run_id = link.new_run_id()
    url = _core.lcm_url_of(run_id)
    first = ["nice", "-n", "-15"] if os.geteuid() == 0 else []  # it must never be late
    logger = subprocess.Popen(
        [*first, "lcm-logger", "-q", "-f", f"--lcm-url={url}&recv_buf_size=4000000", log]
    )
    time.sleep(0.5)
    common = ["--run-id", run_id, "--set", duration]
    axis = start("axis_node", *common)
    reports = {"plant": end(start("plant_node", *common, "--pace", "real")), "axis": end(axis)}
    time.sleep(0.5)
    logger.send_signal(signal.SIGINT)
    logger.wait(10)
    seen = collections.defaultdict(list)
    for event in lcm.EventLog(str(log)):
        if event.channel == "LCM_SELF_TEST":  # of LCM itself, when a process joins
            continue
        # Fingerprint, then utime, wall_utime, seq (the tick), run_id.
        _, _, utime, _, seq, of_run = struct.unpack(">2I4q", event.data[:40])
        assert (of_run, utime) == (run_id, seq * 1_000_000 // 1500)
        seen[event.channel].append(seq)
    return reports, seen


HEARD_SHARE_MIN = 0.95  # of the messages that a listener on a busy machine receives


@pytest.mark.long  # twenty seconds; candump counts the frames of the other bus
def test_lcm_logger_counts_a_message_a_tick_and_direction(tmp_path):
    ticks = 3001
    # Multicast is not acknowledged: on a busy machine the listener may miss messages, so the test
    # is repeated, and the last run may lack some. An extra message is always an error.
    for _ in range(6):
        reports, seen = logged_run(tmp_path / "link.lcmlog", "experiment.duration_s=2")
        assert set(seen) == {"AXIS_1_LINK_INPUTS", "AXIS_1_LINK_OUTPUTS"}
        heard, sent = {}, {}
        for end_, channel in (("plant", "AXIS_1_LINK_INPUTS"), ("axis", "AXIS_1_LINK_OUTPUTS")):
            heard[end_] = len(seen[channel])
            sent[end_] = ticks + reports[end_]["statistics"]["repeated"]
            assert heard[end_] <= sent[end_]
        if heard == sent:
            break
    for end_, count in sent.items():
        assert heard[end_] >= HEARD_SHARE_MIN * count
    for ticks_seen in seen.values():
        assert set(ticks_seen) <= set(range(ticks))
        assert len(set(ticks_seen)) >= HEARD_SHARE_MIN * ticks


def test_candump_counts_a_frame_a_tick_and_direction(can):
    done = can["candump"]
    ticks = 9001
    for end_ in ("plant", "axis"):
        assert hashes(done[end_]) == [in_process()]
        assert done["frames"][end_] == ticks + done[end_]["statistics"]["repeated"]
    assert done["other"] == []  # candump reports dropped frames here
    assert done["plant"]["pid"] != done["axis"]["pid"]
    # The bytes, written again from the trace: axis 1, enable (bit 9), tick mod 4096 from bit 13 on.
    result = _core.run(str(EXPERIMENT), [])
    c = {name: values.tolist() for name, values in result.columns().items()}
    expected = []
    for k in range(len(done["frames_of_first"]) // 2):
        there = struct.pack("<iHH", c["encoder"][k], c["adc0"][k], c["adc1"][k])
        back = struct.pack("<hBHBB", c["dac"][k], c["out"][k], k, c["fault"][k],
                           c["limit_reason"][k])  # fmt: skip
        expected.append(f"{0x200 | k << 13:08X}#{there.hex().upper()}")
        expected.append(f"{1 << 28 | k << 13:08X}#{back.hex().upper()}")
    assert done["frames_of_first"] == expected


def test_some_cells_of_the_tables_over_lcm_are_those_in_process():
    known = tables.load()
    jobs = [known.job(c) for c in known.cells[::11]]
    ours = link.run_many(link.LinkOptions("lcm"), jobs)
    for one, other in zip(ours, _core.run_many(jobs), strict=True):
        assert one == other


def test_cycles_over_lcm_have_the_trace_and_the_part_of_the_run_in_process():
    with link.AxisNode(link.LinkOptions("lcm")) as node:
        for name, overrides in PARTS:
            result, report, _, cycle = link.run_with(node, file_of(name), overrides, trace=False)
            assert report.same
            expect_the_same(result, cycle, _core.run(str(file_of(name)), list(overrides)))


def test_a_cycle_over_a_link_is_reported_as_in_process():
    words = ["run", file_of("press_fit"), "--json"]
    plain = json.loads(forceaxis(*words).stdout)
    over = json.loads(forceaxis(*words, "--link", "lcm").stdout)
    assert over["cycle"] == plain["cycle"] and over["cycle"]["state"] == "good"


def test_six_axes(can):
    sets = [w for n in range(1, 7) for w in ("--set", f"{n}:firmware.force_gain={n + 1}")]
    common = ["--axes", 6, "--set", SHORT, "--run-id", link.new_run_id(), *sets]
    axis = start("axis_node", *common)
    plant = end(start("plant_node", *common))
    expected = [in_process(SHORT, f"firmware.force_gain={n + 1}") for n in range(1, 7)]
    assert len(set(expected)) == 6
    assert hashes(plant) == hashes(end(axis)) == expected
    assert plant["status"] == 0
    for end_ in ("plant", "axis"):
        assert hashes(can["six_axes"][end_]) == expected


# Changed data is detected.


def test_one_flipped_bit_changes_the_result(can):
    done = forceaxis(
        "run", EXPERIMENT, "--set", SHORT, "--link", "lcm", "--inject", "flip=100", "--json",
        status=1,
    )  # fmt: skip
    told = json.loads(done.stdout)["link"]
    assert told["hashes"]["plant"] != told["hashes"]["axis"]
    assert told["statistics"]["plant"]["flipped"] == 1
    assert done.stderr.startswith(
        "forceaxis: link lcm: expected equal trace hashes of plant and firmware"
    )
    assert done.stderr.count("\n") == 1
    flipped = can["flipped"]
    assert hashes(flipped["plant"]) != hashes(flipped["axis"])
    assert hashes(flipped["axis"]) != [in_process(SHORT)]


def test_what_the_firmware_refuses_is_told_by_the_other_process(tmp_path):
    file = tmp_path / "refused.toml"
    text = EXPERIMENT.read_text().replace("../models", str(ROOT / "sim" / "models"))
    file.write_text(f"{text}\n[[at]]\ntime_s = 0.5\nfirmware = {{ adc_bits = 8 }}\n")
    plain = json.loads(forceaxis("run", file, "--json").stdout)
    over = json.loads(forceaxis("run", file, "--link", "lcm", "--json").stdout)
    assert plain["refused"][0]["object"] == "adc_bits" and plain["refused"][0]["tick"] == 750
    for key in ("trace_hash", "refused", "metrics", "energy", "fault", "verdict", "events"):
        assert over[key] == plain[key]
    done = forceaxis(
        "run", EXPERIMENT, "--link", "lcm", "--set", "firmware.position_max=-300",
        "--set", "firmware.position_min=-200", status=2,
    )  # fmt: skip
    assert "firmware.position_min: expected a value that the firmware accepts" in done.stderr


# A silent partner is named.


def test_a_killed_axis_node_is_named_in_the_stated_time(can):
    run_id = ["--run-id", link.new_run_id()]
    axis = start("axis_node", *run_id)
    plant = start("plant_node", *run_id, "--pace", "real", "--timeout", "0.5")
    time.sleep(0.5)
    axis.kill()
    axis.communicate()
    since = time.monotonic()
    told = end(plant)
    assert 0.4 < time.monotonic() - since < 5
    assert told["status"] == 1
    assert told["error"].startswith("axis_node (axis 1) silent for 0.5 s at tick ")
    assert told["stderr"] == f"plant_node: {told['error']}\n"
    over_can = can["killed_axis"]
    assert over_can["status"] == 1
    assert "axis_node (axis 1) silent for 1 s at tick " in over_can["stderr"]
    assert 0.9 < over_can["after_s"] < 10


def test_a_killed_plant_disables_the_axis():
    run_id = ["--run-id", link.new_run_id()]
    axis = start("axis_node", *run_id, "--timeout", "0.5")
    plant = start("plant_node", *run_id, "--pace", "real")
    time.sleep(0.5)
    plant.kill()
    plant.communicate()
    since = time.monotonic()
    told = end(axis)
    assert 0.4 < time.monotonic() - since < 5
    assert told["status"] == 1
    assert told["stderr"].startswith("axis_node: plant_node silent for 500 ms (axis 1)")
    lost = told["axes"][0]["after_silence"]
    assert lost == {
        "tick": told["axes"][0]["ticks"],
        "dac_code": 0,
        "amp_enable": False,
        "brake_release": False,
        "fault": "sensor_invalid",
    }


def test_a_partner_that_never_comes_is_named():
    for name, partner in (("plant_node", "axis_node"), ("axis_node", "plant_node")):
        node = start(name, "--run-id", link.new_run_id(), "--start-timeout", "0.3")
        told = end(node)
        assert told["status"] == 1
        assert f"{name}: {partner}" in told["stderr"] and "silent for" in told["stderr"]
        assert f"run {partner} on this link and with this run id" in told["stderr"]


# Late ticks.


def paused(tmp_path, *axis_args):
    """A plant in real time that stands still for 0.1 s: the axis' report, and its journal."""
    run_id = ["--run-id", link.new_run_id(), "--set", "experiment.duration_s=2"]
    journal = tmp_path / "axis.journal"
    axis = start("axis_node", *run_id, "--journal", journal, "--timeout", "10", *axis_args)
    plant = start("plant_node", *run_id, "--pace", "real")
    time.sleep(0.5)
    plant.send_signal(signal.SIGSTOP)
    time.sleep(0.1)
    plant.send_signal(signal.SIGCONT)
    assert end(plant)["status"] == 0
    told = end(axis)
    assert json.loads(replay(journal, "--json").stdout)["replay"]["same"]
    return told["axes"][0], journal.read_text().splitlines()


def test_a_late_tick_is_an_overrun_where_the_axis_is_to_be_in_real_time(tmp_path):
    told, journal = paused(tmp_path, "--pace", "real")
    late = [int(line.split()[1]) for line in journal if line.startswith("overrun ")]
    assert told["overruns"] == len(late) > 0
    assert any(600 < tick < 2900 for tick in late)  # where the plant was suspended
    assert told["trace_hash"] == in_process("experiment.duration_s=2")


def test_nothing_is_late_in_lock_step(tmp_path):
    told, journal = paused(tmp_path)
    assert told["overruns"] == 0
    assert not [line for line in journal if line.startswith("overrun ")]


# Buses and their journal.


def test_the_journal_of_an_axis_on_buses_gives_the_same_hash_in_process(can, tmp_path):
    done = can["buses"]
    assert hashes(done["plant"]) == hashes(done["axis"])
    assert done["store_bytes"] == 2 * 16384
    lines = done["journal"].splitlines()
    kinds = collections.Counter(line.split()[0] for line in lines)
    assert kinds["can"] > 20 and kinds["modbus"] >= 3 and kinds["write"] == 5
    assert lines[-1] == f"end 1501 {hashes(done['axis'])[0]}"
    ticks = [int(line.split()[1]) for line in lines if line.split()[0] in ("can", "modbus")]
    assert ticks == sorted(ticks)
    journal = tmp_path / "axis.log"
    journal.write_text(done["journal"])
    summary = json.loads(replay(journal, "--json").stdout)
    assert summary["trace_hash"] == hashes(done["axis"])[0]
    assert summary["replay"]["same"] is True
    assert summary["replay"]["entries"] == sum(kinds[k] for k in ("can", "modbus", "write"))


def test_replay_refuses_what_is_no_journal_or_breaks_off(tmp_path):
    run_id = ["--run-id", link.new_run_id(), "--set", SHORT]
    journal = tmp_path / "axis.log"
    axis = start("axis_node", *run_id, "--journal", journal)
    assert end(start("plant_node", *run_id))["status"] == 0
    assert hashes(end(axis)) == [in_process(SHORT)]
    replay(journal)
    text = journal.read_text()
    for changed, status, word in (
        ("", 2, "expected a readable journal"),
        (text.replace("write 0 force_gain", "write 0 force_gian"), 2, "line 7"),
        (text.replace("inputs_hash ", "inputs_hash 0"), 2, "has changed since"),
        (text[: text.index("end ")], 1, "expected a line `end`"),
        (text[:-1], 1, "expected a line `end`"),
        (text[: text.index("1280") + 2], 1, "expected a line `end`"),
        (text.replace("force_gain 1280", "force_gain 2560"), 1, "expected the trace hash"),
    ):
        journal.write_text(changed)
        done = replay(journal, status=status)
        assert word in done.stderr and done.stderr.count("\n") == 1


def test_the_replay_of_a_cycle_has_its_part(tmp_path):
    run_id, press_fit = ["--run-id", link.new_run_id()], file_of("press_fit")
    journal = tmp_path / "axis.log"
    axis = start("axis_node", *run_id, "--journal", journal, experiment=press_fit)
    assert end(start("plant_node", *run_id, experiment=press_fit))["status"] == 0
    told = end(axis)["axes"][0]["cycle"]
    assert told == asdict(_core.run(str(press_fit)).cycle)
    assert json.loads(replay(journal, "--json").stdout)["cycle"] == told


@pytest.mark.parametrize("after_s", [0, 2])
def test_the_journal_of_a_killed_node_is_replayed_as_far_as_it_goes(tmp_path, after_s):
    run_id = ["--run-id", link.new_run_id()]
    journal = tmp_path / "axis.journal"
    axis = start("axis_node", *run_id, "--journal", journal, "--store", tmp_path / "store")
    waits = ["--start-timeout", "1", "--timeout", "0.3"]
    plant = start("plant_node", *run_id, "--pace", "real", *waits)
    time.sleep(after_s)
    axis.kill()
    axis.communicate()
    end(plant)
    assert "end " not in journal.read_text()
    out = tmp_path / "out"
    done = replay(journal, "--json", "--out", out, status=1)
    summary = json.loads(done.stdout)
    assert summary["replay"]["ticks"] is None and summary["replay"]["same"] is False
    assert done.stderr == (
        f"forceaxis: {journal}: expected a line `end`, got none, because the node was killed; "
        f"only the {summary['ticks']} ticks in the journal were replayed\n"
    )
    assert (out / "trace.csv").exists()
    plain = replay(journal, status=1)
    assert "broken off" in plain.stdout and plain.stderr.count("\n") == 1


def test_the_replay_for_the_model_reads_a_journal_as_replay_does(tmp_path):
    """canopen_replay, on which test_clients.py relies, also where the journal breaks off."""
    run_id = ["--run-id", link.new_run_id(), "--set", SHORT]
    journal = tmp_path / "axis.log"
    axis = start("axis_node", *run_id, "--journal", journal)
    assert end(start("plant_node", *run_id))["status"] == 0
    end(axis)
    whole = journal.read_text()
    header = whole[: whole.index("end ")]
    for text in (whole, f"{header}can 700 601 8 4041600000000000\nlost 800 3\ncan 900 601 8 40"):
        journal.write_text(text)
        summary = json.loads(replay(journal, "--json", status=int(text != whole)).stdout)
        log = subprocess.run(
            [ROOT / "build/release/tests/wire/canopen_replay", journal],
            capture_output=True, timeout=60, check=True,
        ).stdout  # fmt: skip
        records = list(struct.iter_unpack("<BBHIQ", log))
        assert f"{records[-1][-1]:016x}" == summary["trace_hash"][:16]
        # Records 2: ticks, 1: frames in, 10: frames lost.
        counts = collections.Counter(record[0] for record in records)
        assert counts[2] == summary["ticks"] == (1501 if text == whole else 801)
        assert (counts[1], counts[10]) == ((0, 0) if text == whole else (1, 1))


def test_a_journal_replaces_nothing_but_a_journal(tmp_path):
    other = tmp_path / "plant.toml"
    other.write_text("forceaxis = 1\n")
    words = [NODES / "axis_node", EXPERIMENT, "--run-id", str(link.new_run_id())]
    done = subprocess.run(
        [*words, "--journal", other], capture_output=True, text=True, timeout=20, check=False
    )
    assert done.returncode == 2 and str(other) in done.stderr
    assert other.read_text() == "forceaxis = 1\n"
    # Where the bus is in use no file is touched.
    done = subprocess.run(
        [*words, "--can", "nocan0", "--journal", tmp_path / "j", "--store", tmp_path / "s"],
        capture_output=True, text=True, timeout=20, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert os.listdir(tmp_path) == ["plant.toml"]


def test_an_axis_node_that_is_ended_leaves_a_whole_journal(tmp_path):
    run_id = ["--run-id", link.new_run_id()]
    journal = tmp_path / "axis.journal"
    axis = start("axis_node", *run_id, "--journal", journal)
    plant = start("plant_node", *run_id, "--pace", "real", "--timeout", "3")
    time.sleep(0.5)
    # A second one of this run is refused and does not touch the journal.
    second = subprocess.run(
        list(map(str, [NODES / "axis_node", EXPERIMENT, *run_id, "--journal", journal])),
        capture_output=True, text=True, timeout=20, check=False,
    )  # fmt: skip
    assert second.returncode == 1
    assert f"run {run_id[1]} on udpm" in second.stderr and "only axis 1 here" in second.stderr
    axis.terminate()
    told = end(axis)
    assert told["status"] == 143 and told["stderr"].startswith("axis_node: ended by SIGTERM")
    lost = end(plant)
    assert lost["status"] == 1 and lost["ticks_per_s"] > 0
    assert journal.read_text().splitlines()[-1] == (
        f"end {told['axes'][0]['ticks']} {hashes(told)[0]}"
    )
    summary = json.loads(replay(journal, "--json").stdout)
    assert summary["trace_hash"] == hashes(told)[0]


def test_a_journal_that_cannot_be_written_is_told_and_the_run_goes_on():
    common = ["--run-id", link.new_run_id(), "--set", SHORT]
    axis = start("axis_node", *common, "--journal", "/dev/full")
    plant = start("plant_node", *common)
    assert end(plant)["status"] == 0
    told = end(axis)
    assert told["status"] == 1 and hashes(told) == [in_process(SHORT)]
    assert told["stderr"] == (
        "axis_node: /dev/full: cannot write the journal, so the journal is incomplete\n"
    )


# Observers.


def test_a_live_plant_publishes_its_clock_and_what_is_true(monkeypatch):
    url = _core.lcm_url_of(link.new_run_id())
    monkeypatch.setenv("LCM_DEFAULT_URL", url)
    heard = []
    bus = Bus(None, lambda name, data, _: heard.append((name, decode(name, data))), "SIM_.*")
    common = ["--run-id", link.new_run_id(), "--set", SHORT]
    axis = start("axis_node", *common)
    plant = start("plant_node", *common, "--live")
    report = end(plant)
    assert report["status"] == 0 and end(axis)["status"] == 0
    # Observing changes nothing.
    assert hashes(report) == [in_process(SHORT)]
    ended = time.monotonic() + 10
    while not (heard and getattr(heard[-1][1], "clock_state", 0) == 3) and time.monotonic() < ended:
        time.sleep(0.02)
    bus.close()
    ticks = list(range(0, 1501, 150))
    clocks = [message for name, message in heard if name == "SIM_CLOCK"]
    truths = [message for name, message in heard if name == "SIM_TRUTH"]
    assert [c.tick for c in clocks] == [*ticks, 1500]
    assert [c.clock_state for c in clocks] == [1] * len(ticks) + [3]
    assert [t.utime for t in truths] == [k * 2000 // 3 for k in ticks]
    assert {t.axis for t in truths} == {1} and len({t.run_id for t in truths}) == 1
    trace = _core.run(str(EXPERIMENT), [SHORT]).columns()
    for name, unit in (("sensor.force", "N"), ("robot.position", "m")):
        at = truths[0].signal.index(name)
        assert truths[0].unit[at] == unit
        assert [t.value[0][at] for t in truths] == [float(trace[name][k]) for k in ticks]
    force = truths[0].signal.index("sensor.force")
    assert max(t.value[0][force] for t in truths) > 1  # it is in contact, truly


# Runs are separate.


def test_parallel_runs_on_one_port_do_not_meet():
    """One run in real time, and while it goes on another one, of another gain, on the same port."""
    url = _core.lcm_url_of(link.new_run_id())
    sets = "firmware.force_gain=3", "experiment.duration_s=3"
    common = ["--run-id", link.new_run_id(), "--lcm-url", url]
    common += [word for one in sets for word in ("--set", one)]
    axis = start("axis_node", *common)
    plant = start("plant_node", *common, "--pace", "real")
    summary = run("--link", "lcm", "--lcm-url", url, "--set", SHORT)
    reports = end(plant), end(axis)
    assert summary["link"]["hashes"] == dict.fromkeys(("plant", "axis"), in_process(SHORT))
    for report in reports:
        assert hashes(report) == [in_process(*sets)]
        # They did receive each other's messages.
        assert report["statistics"]["foreign"] > 100


def test_an_interface_carries_one_plant(can):
    assert can["second_plant"]["status"] == 1
    assert can["second_plant"]["stderr"].startswith(
        "plant_node: vcan1: expected to be the only plant here"
    )


# Missing set-up is named.


def test_no_route_for_multicast_says_how():
    words = [*OWN_NETWORK, NODES / "plant_node", EXPERIMENT]
    done = subprocess.run(words, capture_output=True, text=True, timeout=20, check=False)
    assert done.returncode == 1
    assert "ip route add 224.0.0.0/4 dev lo" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_claim_that_fails_is_not_called_another_run():
    # One descriptor is free for both axes.
    words = ["sh", "-c", 'ulimit -n 4; exec "$0" "$@"', NODES / "axis_node", EXPERIMENT]
    done = subprocess.run(
        [*words, "--axes", "2", "--run-id", str(link.new_run_id())],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=20, check=False,
    )  # fmt: skip
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert done.stderr.endswith("cannot lock the role axis 2: Too many open files\n")


def test_no_can_interface_says_how():
    words = [NODES / "axis_node", EXPERIMENT, "--link", "socketcan", "--link-can", "nocan0"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=20, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("axis_node: nocan0: expected ") and "tools/vcan" in done.stderr


@pytest.mark.parametrize("name", ["axis_node", "plant_node"])
@pytest.mark.parametrize(
    ("args", "word"),
    [
        (["nowhere.toml"], "nowhere.toml"),
        ([EXPERIMENT, "--axes", "7"], "--axes"),
        ([EXPERIMENT, "--timeout", "nan"], "--timeout"),
        ([EXPERIMENT, "--link", "pigeon"], "pigeon"),
        ([EXPERIMENT, "--inject", "drop=2"], "drop=2"),
        ([EXPERIMENT, "--inject", "lose=0.1"], "lose=0.1"),
        ([EXPERIMENT, "--set", "2:m_r1=3"], "2:m_r1=3"),
        ([EXPERIMENT, "--set", "firmware.force_gain=300"], "firmware.force_gain"),
        ([EXPERIMENT, "--frobnicate"], "--frobnicate"),
        ([], "EXPERIMENT"),
    ],
)
def test_bad_input_is_one_line_and_status_2(name, args, word):
    done = subprocess.run(
        [NODES / name, *args], capture_output=True, text=True, timeout=20, check=False
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"{name}: ") and done.stderr.count("\n") == 1
    assert word in done.stderr


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (
            ["--node-id", "127", "--axes", "2"],
            "--node-id 127: expected ids up to 127, but the last node id",
        ),
        (["--node-id", "0", "--axes", "2"], "--node-id 0: expected one axis, because several"),
        (["--node-id", "128"], "--node-id"),
        (["--serial", "-1"], "--serial"),
    ],
)
def test_a_bad_identity_is_one_line_and_status_2(args, said):
    words = [NODES / "axis_node", EXPERIMENT, *args]
    done = subprocess.run(words, capture_output=True, text=True, timeout=20, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr and done.stderr.count("\n") == 1


def identities(folder, *args):
    """Node id and serial number of each of two axes, as their journals have them."""
    common = ["--axes", 2, "--set", SHORT, "--run-id", link.new_run_id()]
    journal = folder / "axis.journal"
    axis = start("axis_node", *common, "--journal", journal, *args)
    end(start("plant_node", *common))
    end(axis)
    configs = [
        re.search(r"^config (\d+) 0 \d+ (\d+)$", text, re.MULTILINE)
        for text in (Path(f"{journal}.{n}").read_text() for n in (1, 2))
    ]
    return [(int(found[1]), int(found[2])) for found in configs]


def test_two_nodes_of_a_run_have_serial_numbers_of_their_own(tmp_path):
    first = identities(tmp_path)
    assert [node for node, _ in first] == [1, 2]
    assert len({serial for _, serial in first}) == 2
    assert first == identities(tmp_path), "the same ones in every run"
    given = identities(tmp_path, "--node-id", "126", "--serial", "4000000000")
    assert given == [(126, 4_000_000_000), (127, 4_000_000_001)]
    by_lss = identities(tmp_path, "--node-id", "255")
    assert by_lss == [(255, serial) for _, serial in first]
    replay = subprocess.run(
        [FORCEAXIS, "recording", "replay", tmp_path / "axis.journal.2"],
        capture_output=True,
        check=False,
    )
    assert replay.returncode == 0


@pytest.mark.parametrize(
    "url",
    [
        "nonsense",
        "pigeon://1",
        "tcpq://localhost:1",  # on which liblcm ends the process
        "udpm://nohost:7667",
        "udpm://10.0.0.1:7667",  # no multicast
        "udpm://239.255.76.67:99999",
        "udpm://239.255.76.67:7667?ttl=x",
        "udpm://239.255.76.67:7667?tll=0",
    ],
)
def test_a_bad_lcm_url_is_one_line_and_status_2(url):
    programs = (
        ("axis_node", [EXPERIMENT, "--lcm-url", url], {}, f"--lcm-url {url}: "),
        ("plant_node", [EXPERIMENT, "--lcm-url", url], {}, f"--lcm-url {url}: "),
        # Also where there is no CAN: nothing is opened before.
        ("gateway", ["--can", "nocan0", "--lcm-url", url], {}, f"--lcm-url {url}: "),
        ("gateway", [], {"LCM_DEFAULT_URL": url}, f"LCM_DEFAULT_URL {url}: "),
        (
            "plant_node",
            [EXPERIMENT, "--live"],
            {"LCM_DEFAULT_URL": url},
            f"LCM_DEFAULT_URL {url}: ",
        ),
    )
    for name, args, more, said in programs:
        done = subprocess.run(
            [NODES / name, *args], env=os.environ | more, capture_output=True, text=True,
            timeout=20, check=False,
        )  # fmt: skip
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == (
            f"{name}: {said}expected an LCM URL such as udpm://239.255.76.67:7667?ttl=0\n"
        )


def test_a_bad_lcm_url_of_a_run_is_one_line_and_status_2():
    done = forceaxis("run", EXPERIMENT, "--link", "lcm", "--lcm-url", "pigeon://1", status=2)
    assert "pigeon://1: expected an LCM URL" in done.stderr and done.stderr.count("\n") == 1


@pytest.mark.parametrize("option", ["--store", "--journal"])
@pytest.mark.parametrize(
    ("axes", "file"),
    [
        *((1, file) for file in ("nowhere/a", "folder", "locked/a", "text", "text/a")),
        # The first axis' could be opened; it is closed again.
        *((2, file) for file in ("folder/a", "text")),
    ],
)
def test_a_file_that_cannot_be_written_is_one_line_and_status_2(tmp_path, option, axes, file):
    (tmp_path / "folder" / "a.2").mkdir(parents=True)
    (tmp_path / "locked").mkdir(mode=0o555)
    texts = [tmp_path / "text", tmp_path / "text.2"]
    for text in texts:
        text.write_text("precious\n")
    before = sorted(tmp_path.rglob("*"))
    # Root may write everywhere, but for what that right is taken from.
    bound = ["setpriv", "--bounding-set=-dac_override"] if os.geteuid() == 0 else []
    other = "--journal" if option == "--store" else "--store"
    done = subprocess.run(
        [*bound, NODES / "axis_node", EXPERIMENT, "--axes", str(axes),
         "--run-id", str(link.new_run_id()), "--start-timeout", "0.3",
         option, tmp_path / file, other, tmp_path / "other"],
        capture_output=True, text=True, timeout=20, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"axis_node: {tmp_path / file}")
    assert f": {option}: expected " in done.stderr and done.stderr.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before
    assert [text.read_text() for text in texts] == ["precious\n"] * 2


@pytest.mark.parametrize(
    ("sets", "words"),
    [
        (["m_w=1", "m_w=2"], "--set: m_w: expected one value, got 1 and 2"),
        (["firmware.force_gian=1"], "`forceaxis objects` lists them"),
    ],
)
def test_a_node_names_options_and_commands_for_what_the_library_names(sets, words):
    given = [word for text in sets for word in ("--set", text)]
    done = subprocess.run(
        [NODES / "axis_node", EXPERIMENT, *given], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("axis_node: ") and words in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("name", ["axis_node", "plant_node"])
def test_help_has_an_example(name):
    done = subprocess.run([NODES / name, "--help"], capture_output=True, text=True, check=True)
    assert "Example:" in done.stdout and "--run-id" in done.stdout


@pytest.mark.parametrize("name", ["press_fit", "contact"])
def test_an_experiment_that_enables_its_axis_beside_a_bus_says_so(name):
    """contact.toml has no table [[at]]."""
    ours, theirs = os.openpty()
    words = ["--modbus", os.ttyname(theirs), "--start-timeout", "0.05", "--run-id", "991"]
    done = subprocess.run(
        [NODES / "axis_node", ROOT / f"sim/experiments/{name}.toml", *words],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    os.close(ours)
    os.close(theirs)
    first, *others = done.stderr.splitlines()
    assert ("enables itself; remove the tables [[at]]" in first) == (name == "press_fit")
    assert len(others) == (name == "press_fit")
