"""Logs of a stand-in gateway: exported, damaged, replayed."""

import csv
import json
import struct
import subprocess
import sys
import time
from pathlib import Path

import lcm
import numpy as np
import pytest
from forceaxis.bus import log as logs
from forceaxis.bus import log_tables
from forceaxis.bus.lcm import (
    NOT_AVAILABLE,
    Bus,
    blank,
)
from forceaxis.bus.messages import (
    axis_capture_t,
    axis_state_t,
    sim_truth_t,
)
from forceaxis.bus.monitor import AxisPanel
from forceaxis.bus.monitor_state import Watch
from forceaxis.bus.sources import LiveSource, ReplaySource
from gateway_stand_in import sample, state_of, truth
from live_bus import (  # noqa: F401
    forceaxis,
    free_url,
    gateway,
    namespace,
    refused,
    until,
    url_fixture,
)
from monitor_pilot import head_text, panel_text, run_monitor, settle

COUNT = 61


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A log of a whole session of the stand-in: two axes, every seventh state missing."""
    url = free_url()
    path = tmp_path_factory.mktemp("log") / "session.log"
    source = LiveSource(Watch(), url)
    source.record(path)
    with gateway(url, axes="1,2", rate=100, count=COUNT, drop=7, double=11, capture=150) as process:
        assert process.wait(10) == 0
    time.sleep(0.3)
    source.close()
    return path


def test_exported_values_are_those_that_were_sent(recorded, tmp_path):
    done = forceaxis("recording", "export", recorded, "--out", tmp_path, "--json")
    assert done.returncode == 0 and done.stderr == "", done.stderr
    summary = json.loads(done.stdout)
    assert summary["undecodable"] == 0 and summary["not_exported"] == []
    sent = [k for k in range(COUNT) if k % 7 != 3]
    for axis in (1, 2):
        table = np.load(tmp_path / f"AXIS_{axis}_STATE.npz")
        states = [state_of(axis, k) for k in sent]
        assert table["seq"].tolist() == sent  # duplicates once, lost ones never
        for name in axis_state_t.__slots__:
            if name in ("utime", "wall_utime", "seq", "run_id") or "more" in name:
                continue
            if getattr(states[0], name) == NOT_AVAILABLE:
                assert np.isnan(table[name]).all()
                continue
            assert table[name].tolist() == [getattr(s, name) for s in states], name
        assert table["utime_us"].tolist() == [20_000 * k for k in sent]
        assert set(table["drive_state"]) == {"operation enabled"}
        assert table["force_gain_code_per_count"].tolist() == [axis] * len(sent)
        with (tmp_path / f"AXIS_{axis}_STATE.csv").open() as file:
            rows = list(csv.DictReader(file))
        assert [int(r["position_cnt"]) for r in rows] == [1000 * axis + k for k in sent]
        assert rows[0]["mode_text"] == "cyclic force"
    with (tmp_path / "AXIS_1_EVENT.csv").open() as file:
        events = list(csv.DictReader(file))
    assert [e["kind_text"] for e in events] == ["drive state", "mode", "capture"]
    assert events[1]["text"] == "mode cyclic force" and events[1]["command_id"] == ""
    capture = np.load(tmp_path / "AXIS_1_CAPTURE_1.npz")
    assert capture["tick"].tolist() == list(range(3000, 3150))
    assert capture["force_count"].tolist() == [sample(1, 0, i) / 256 for i in range(150)]
    assert capture["dac_code"].tolist() == [sample(1, 1, i) for i in range(150)]
    assert capture["time_s"].tolist() == [t / 1500 for t in range(3000, 3150)]
    plant = np.load(tmp_path / "SIM_TRUTH.npz")
    ticks = [30 * k + i for k in range(0, COUNT, 5) for i in range(30)]
    assert plant["tick"].tolist() == ticks
    assert plant["robot.position_m"].tolist() == [truth(t, 0) for t in ticks]
    with (tmp_path / "SIM_TRUTH.csv").open() as file:
        column = [float(r["sensor.force_N"]) for r in csv.DictReader(file)]
    assert column == [truth(t, 1) for t in ticks]


def test_export_of_one_kind_and_for_a_reader(recorded, tmp_path):
    done = forceaxis("recording", "export", recorded, "--out", tmp_path, "--csv")
    assert done.returncode == 0
    assert "AXIS_1_STATE.csv" in done.stdout and "npz" not in done.stdout
    assert not list(tmp_path.glob("*.npz"))


def test_info_counts_messages_and_losses(recorded):
    done = forceaxis("recording", "info", recorded, "--json")
    assert done.returncode == 0 and done.stderr == ""
    summary = json.loads(done.stdout)
    row = summary["channels"]["AXIS_1_STATE"]
    assert row["type"] == "axis_state_t" and row["runs"] == 1
    left_out = [k for k in range(COUNT) if k % 7 == 3]
    doubled = [k for k in range(COUNT) if k % 7 != 3 and k % 11 == 5]
    # The last state is sent, so all missing ones are before it.
    assert (COUNT - 1) % 7 != 3
    assert row["lost"] == len(left_out) and row["doubled"] == len(doubled)
    assert row["count"] == COUNT - len(left_out) + len(doubled)
    assert summary["messages"] == sum(r["count"] for r in summary["channels"].values())
    assert 0.4 < summary["span_s"] < 15  # 61 states at 100 a second
    text = forceaxis("recording", "info", recorded).stdout
    assert "AXIS_2_STATE" in text and f"{summary['messages']} messages" in text


def test_a_log_that_is_cut_off_gives_what_is_whole(recorded, tmp_path):
    whole = list(logs.LogReader(recorded))
    data, path = recorded.read_bytes(), tmp_path / "cut.log"
    path.write_bytes(data[:-5])
    done = forceaxis("recording", "info", path)
    assert done.returncode == 0
    assert done.stderr.count("\n") == 1
    assert "cut off" in done.stderr and f"{len(whole) - 1} messages saved" in done.stderr
    done = forceaxis("recording", "export", path, "--out", tmp_path / "out", "--json")
    assert done.returncode == 0 and "cut off" in done.stderr
    # Everything before the cut is read, wherever it is.
    starts = [0]
    for entry in whole:
        starts.append(starts[-1] + logs.HEADER.size + len(entry.channel) + len(entry.data))
    for cut in range(starts[3] - 40, starts[3] + 40):
        path.write_bytes(data[:cut])
        reader = logs.LogReader(path)
        saved = list(reader)
        assert saved == whole[: sum(1 for s in starts[1:] if s <= cut)]
        assert (reader.damage is None) == (cut in starts)


def test_damage_inside_a_log_costs_only_what_it_hit(recorded, tmp_path):
    whole, path = list(logs.LogReader(recorded)), tmp_path / "damaged.log"
    good = recorded.read_bytes()
    start = sum(logs.HEADER.size + len(e.channel) + len(e.data) for e in whole[:10])
    cases = {
        "lengths that lie": (start + 24, struct.pack(">I", 5000)),
        "a length beyond the file": (start + 24, b"\x0f\xff\xff\xff"),
        "no mark": (start, b"\0\0\0\0"),
    }
    for what, (at, bytes_) in cases.items():
        path.write_bytes(good[:at] + bytes_ + good[at + len(bytes_) :])
        reader = logs.LogReader(path)
        assert list(reader) == whole[:10] + whole[11:], what
        assert "is damaged" in reader.damage and f"{len(whole) - 1} messages saved" in reader.damage
    # Bytes of another program's type on our channel are counted, not shown.
    entry = next(e for e in whole if e.channel == "AXIS_1_STATE")
    with path.open("wb") as file:
        name = b"AXIS_1_STATE"
        for data in (b"\x12" * 40, entry.data):
            header = logs.HEADER.pack(logs.SYNC_MARK, 0, 1, len(name), len(data))
            file.write(header + name + data)
    summary = log_tables.export(path, tmp_path / "out")
    assert summary.undecodable == 1
    assert [t.rows for t in summary.tables] == [1]


def block_of(kind):
    """Two samples of one signal."""
    block = blank(kind)
    block.run_id, block.seq, block.first_tick, block.decimation = 1, 0, 5, 3
    block.num_signals, block.signal, block.num_samples, block.value = 1, ["x"], 2, [[4], [5]]
    if kind is axis_capture_t:
        block.first_sample, block.total_samples, block.trigger_sample = 2, 8, 2
    else:
        block.unit = [""]
    return block


@pytest.mark.parametrize(
    ("kind", "damage", "ticks"),
    [
        (sim_truth_t, {"first_tick": 2**63 - 2}, [5, 8]),
        (sim_truth_t, {"first_tick": 2**63 - 1}, [5, 8]),
        (axis_capture_t, {"first_tick": 2**63 - 2}, range(-1, 21, 3)),
        (axis_capture_t, {"first_tick": -(2**63) + 1}, range(-1, 21, 3)),
        (axis_capture_t, {"decimation": 2**31 - 1, "first_tick": 2**63 - 2**32}, range(-1, 21, 3)),
    ],
)
def test_ticks_beyond_64_bits_cost_only_their_block(kind, damage, ticks, tmp_path):
    channel = "SIM_TRUTH" if kind is sim_truth_t else "AXIS_1_CAPTURE"
    path, damaged, good = tmp_path / "damaged.log", block_of(kind), block_of(kind)
    for name, value in damage.items():
        setattr(damaged, name, value)
    good.seq = 1
    with path.open("wb") as file:
        for message in (damaged, good):
            data = message.encode()
            header = logs.HEADER.pack(logs.SYNC_MARK, 0, 1, len(channel), len(data))
            file.write(header + channel.encode() + data)
    done = forceaxis("recording", "export", path, "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    assert "1 messages that are damaged" in done.stdout
    with np.load(next((tmp_path / "out").glob("*.npz"))) as table:
        assert table["tick"].tolist() == list(ticks)
        assert table["x"][np.isin(table["tick"], [5, 8])].tolist() == [4, 5]


@pytest.mark.parametrize("channel", ["../outside", "a/b", "\0"])
def test_a_channel_of_any_name_is_a_file_in_the_folder(channel, tmp_path):
    path, data = tmp_path / "odd.log", block_of(sim_truth_t).encode()
    header = logs.HEADER.pack(logs.SYNC_MARK, 0, 1, len(channel), len(data))
    path.write_bytes(header + channel.encode() + data)
    summary = log_tables.export(path, tmp_path / "out")
    assert {f.name for f in tmp_path.iterdir()} == {"odd.log", "out"}
    assert {f.name for f in (tmp_path / "out").iterdir()} == set(summary.tables[0].files)


def test_a_foreign_log_has_channels_but_no_tables(tmp_path):
    path = tmp_path / "foreign.log"
    log = lcm.EventLog(str(path), "w")
    log.write_event(1_000_000, "EXAMPLE", b"something else")
    log.close()
    summary = json.loads(forceaxis("recording", "info", path, "--json").stdout)
    assert summary["channels"]["EXAMPLE"]["type"] is None
    refused(
        forceaxis("recording", "export", path, "--out", tmp_path / "o"), "foreign.log", "forceaxis"
    )
    # Our types are known on any channel.
    log = lcm.EventLog(str(path), "w", overwrite=True)
    state = state_of(1, 5)
    state.run_id, state.seq = 1, 0
    log.write_event(1_000_000, "COPY_OF_STATE", state.encode())
    log.close()
    summary = json.loads(forceaxis("recording", "info", path, "--json").stdout)
    assert summary["channels"]["COPY_OF_STATE"]["type"] == "axis_state_t"
    assert log_tables.export(path, tmp_path / "o").tables[0].rows == 1


def test_lcm_logplayer_plays_a_recorded_log_and_the_monitor_replays_it(recorded, url):
    heard = []
    with Bus(url, lambda channel, data, _: heard.append((channel, data))):
        player = Path(sys.executable).parent / "lcm-logplayer"
        done = subprocess.run(
            [player, f"--lcm-url={url}", "--speed=4", str(recorded)],
            capture_output=True, text=True, check=False, timeout=20,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        whole = [(e.channel, e.data) for e in logs.LogReader(recorded)]
        assert until(lambda: len(heard) == len(whole))
    assert heard == whole

    watch = Watch()

    async def steps(app, pilot):
        await settle(pilot, lambda: len(app.query(AxisPanel)) == 2)
        await pilot.press("f")
        at = app.source.now_us()
        await pilot.pause(0.3)
        assert app.source.now_us() - at < 0.15 * 1e6  # a frozen replay waits
        await pilot.press("f")
        await settle(pilot, lambda: app.source.ended)
        await settle(pilot, lambda: "END" in head_text(app))
        assert "operation enabled" in panel_text(app, 1)
        last = state_of(1, COUNT - 1)
        assert f"{last.position_cnt:,}".replace(",", " ") + " count" in panel_text(app, 1)
        await pilot.press("r")
        assert app.source.writer is None

    begun = time.monotonic()
    run_monitor(ReplaySource(watch, recorded, speed=2), watch, steps)
    assert time.monotonic() - begun < 10
    assert watch.axes[1].lost() == len([k for k in range(COUNT) if k % 7 == 3])


def test_a_replay_can_be_snapshot(recorded):
    done = forceaxis("monitor", "--replay", recorded, "--once", "--json")
    shown = json.loads(done.stdout)
    assert shown["axes"]["2"]["position_cnt"] == 2000 + COUNT - 1
    assert shown["axes"]["1"]["age_s"] < 1
