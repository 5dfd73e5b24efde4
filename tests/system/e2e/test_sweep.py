"""Sweeps: values by hand, equal numbers in every file, resuming after a kill, failures as rows."""

import csv
import fcntl
import hashlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import dask_cluster
import numpy as np
import pyarrow.parquet
import pytest
import verbs
from forceaxis import InputError
from forceaxis.experiments import points as points_of
from forceaxis.experiments import run as runs
from forceaxis.experiments import runner
from forceaxis.experiments import sweep as sweeps
from forceaxis.experiments.sweep import SweepRequest

ROOT = Path(__file__).resolve().parents[3]
CONTACT = "sim/experiments/contact.toml"
CASE_B = "sim/experiments/axis_contact_b.toml"
BIN = Path(sys.executable).parent
BRIEF = ["--set", "experiment.duration_s=0.1", "--set", "verdict.window_s=0.1"]

# A free mass on a spring, released at `reach`: the encoder swings by 2 * reach.
MODEL = """
[parameters]
m = { value = 1.0, unit = "kg" }
k = { value = 100.0, unit = "N/m" }
reach = { value = 0.01, unit = "m" }
[[body]]
name = "bob"
mass = "m"
position = "reach"
[[spring]]
name = "string"
between = ["bob", "ground"]
stiffness = "k"
[encoder]
body = "bob"
scale = 1000.0
"""
SWING = """
title = "swing"
model = "model.toml"
duration_s = 2.0
[verdict]
window_s = 2.0
position_ripple_max_count = 100.0
"""


@pytest.fixture
def swing(tmp_path):
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "swing.toml").write_text(SWING)
    return tmp_path / "swing.toml"


def command(*arguments):
    return [BIN / "forceaxis", "sweep", *map(str, arguments)]


def forceaxis_sweep(*arguments):
    return verbs.forceaxis("sweep", *arguments, cwd=ROOT)


def done(*arguments):
    finished = forceaxis_sweep(*arguments, "--json")
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.count("\n") == 1
    return json.loads(finished.stdout)


def rows_of(out):
    with (out / "results.csv").open() as file:
        return list(csv.DictReader(file))


def journal(out):
    return (out / "journal.jsonl").read_bytes().splitlines(keepends=True)


# Which points.


def test_a_grid_is_every_combination_with_both_ends():
    axes = points_of.grid_axes({"a": "1:3:5", "b": "1:100:3:log", "c": [4, 2]})
    assert [a.values for a in axes] == [(1, 1.5, 2, 2.5, 3), (1, 10, 100), (4, 2)]
    points = points_of.grid_points(axes)
    assert len(points) == 30
    assert points[:3] == [(1, 1, 4), (1, 1, 2), (1, 10, 4)]
    assert points_of.grid_axes({"a": "4,0.5,3"})[0].values == (4, 0.5, 3)
    assert points_of.grid_axes({"a": "0:0.3:4"})[0].values == (0, 0.1, 0.2, 0.3)


def test_a_random_point_depends_on_seed_name_and_index_alone():
    def draw(count, seed, **ranges):
        axes = points_of.random_axes(ranges)
        columns = np.transpose(points_of.random_points(axes, count, seed))
        return dict(zip(ranges, columns.tolist(), strict=True))

    many = draw(400, 7, k="2:6", b="1:1e4:log")
    # The first 13 hexadecimal digits and a bit are u's 53 bits.
    digits = hashlib.sha256(b"7:k:3").hexdigest()
    u = int(digits[:13], 16) / 2**52 + (int(digits[13], 16) >= 8) / 2**53
    assert many["k"][3] == pytest.approx(2 + 4 * u, rel=1e-11)
    assert draw(5, 7, b="1:1e4:log", k="2:6")["k"] == many["k"][:5]
    assert draw(5, 8, k="2:6")["k"] != many["k"][:5]
    assert 2 <= min(many["k"]) < 2.1 < 5.9 < max(many["k"]) <= 6
    # Half of the log-uniform points lie below the geometric mean, 5 standard deviations wide.
    assert abs(sum(b < 100 for b in many["b"]) - 200) < 50


# What a sweep gives.


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    out = tmp_path_factory.mktemp("small")
    gains = ["--grid", "firmware.force_gain=2:12:3", "--grid", "b_w=8.25:363:2"]
    return done(CONTACT, *gains, *BRIEF, "--threads", 2, "--out", out), out


def test_every_row_is_the_run_that_run_would_give(small):
    summary, out = small
    rows = rows_of(out)
    pairs = [(row["firmware.force_gain"], row["b_w"]) for row in rows]
    assert pairs == [(g, b) for g in ("2.0", "7.0", "12.0") for b in ("8.25", "363.0")]
    sets = [text for text in BRIEF if text != "--set"]
    for row, (gain, damping) in zip(rows, pairs, strict=True):
        alone = runs.run(
            ROOT / CONTACT, [*sets, f"firmware.force_gain={gain}", f"b_w={damping}"]
        ).summary
        assert row["trace_hash"] == alone["trace_hash"]
        assert row["verdict"] == alone["verdict"]
        assert float(row["edge_margin"]) == alone["edge_margin"]
        for name in ("peak_force_N", "position_ripple_count", "last_adc_change_tick"):
            assert float(row[name]) == alone["metrics"][name]
    assert summary["counts"]["points"] == 6
    assert summary["parameters"] == {"firmware.force_gain": "code/count", "b_w": "N s/m"}


def test_csv_npz_and_parquet_agree(small):
    _, out = small
    rows, npz = rows_of(out), np.load(out / "results.npz")
    table = pyarrow.parquet.read_table(out / "results.parquet")
    assert list(rows[0]) == npz.files == table.column_names
    for name in npz.files:
        kind = type(npz[name].tolist()[0])
        read = [kind(row[name] or "nan") if kind is float else kind(row[name]) for row in rows]
        for values in (table[name].to_pylist(), read):
            np.testing.assert_array_equal(values, npz[name])
    assert (out / "plot.png").read_bytes()[:4] == b"\x89PNG"
    assert json.loads((out / "sweep.json").read_text())["counts"]["points"] == 6
    assert not list(out.glob("*.new"))


def test_its_command_runs_nothing_again_and_more_points_only_the_new(small):
    summary, out = small
    before = (out / "results.csv").read_bytes()
    again = done(*summary["command"].split()[2:])
    assert (again["counts"]["runs"], again["counts"]["resumed"]) == (6, 6)
    assert (out / "results.csv").read_bytes() == before
    gains = ["--grid", "firmware.force_gain=2:12:5", "--grid", "b_w=8.25:363:2"]
    more = done(CONTACT, *gains, *BRIEF, "--out", out)
    assert (more["counts"]["runs"], more["counts"]["resumed"]) == (10, 6)


def test_threads_change_nothing(tmp_path):
    columns = []
    for threads in (1, 3):
        gains = {"firmware.force_gain": "1:16:9", "k_s": "8e4:2e5:3:log"}
        brief = ["experiment.duration_s=0.3"]
        columns.append(
            sweeps.sweep(
                SweepRequest(ROOT / CASE_B, grid=gains, overrides=brief), threads=threads
            ).columns
        )
    for name in columns[0]:
        np.testing.assert_array_equal(columns[0][name], columns[1][name])
    assert len(set(columns[0]["trace_hash"])) == 27


# Boundaries.


def test_a_boundary_is_where_it_is_by_hand(swing):
    """floor(1000 a + 1/2) - floor(-1000 a + 1/2) is 101 from a = 0.0505 on, and 201 from 0.1005."""
    found = sweeps.sweep(
        SweepRequest(
            swing,
            grid={"verdict.position_ripple_max_count": [100, 200]},
            bisect={"reach": "0.01:0.5:1e-4"},
        )
    )
    for i, edge in enumerate((0.0505, 0.1005)):
        stable, unstable = found.columns["boundary"][i], found.columns["unstable_at"][i]
        assert edge - 1e-4 <= stable < edge <= unstable <= edge + 1e-4
        # Both ends, then log2(0.49 / 1e-4) = 12.3 halvings.
        assert found.columns["runs"][i] == 2 + 13


def test_a_boundary_may_have_its_stable_side_above(swing):
    found = sweeps.sweep(
        SweepRequest(
            swing,
            bisect={"verdict.position_ripple_max_count": "50:400:0.5"},
            overrides=["reach=0.1"],
        )
    )
    stable, unstable = found.columns["boundary"][0], found.columns["unstable_at"][0]
    assert unstable < 200 <= stable <= unstable + 0.5


def test_a_bracket_without_a_change_says_so(swing, tmp_path):
    out = tmp_path / "out"
    text = forceaxis_sweep(swing, "--bisect", "reach=0.001:0.02:0.001", "--out", out)
    assert text.returncode == 0, text.stderr
    assert "no change: stable from 0.001 to 0.02" in text.stdout
    (row,) = rows_of(out)
    assert (row["boundary"], row["note"]) == ("", "no change: stable from 0.001 to 0.02")
    assert row["runs"] == "2.0"


# A kill.

LONG = [
    CASE_B, "--grid", "firmware.force_gain=2:16:30", "--grid", "firmware.force_setpoint=10:60:30",
    "--set", "experiment.duration_s=8",
]  # fmt: skip


def kill_after(lines, out):
    """Start the long sweep and kill it as soon as its journal has so many lines."""
    process = subprocess.Popen(
        command(*LONG, "--out", out), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    while process.poll() is None:
        if (out / "journal.jsonl").exists() and len(journal(out)) > lines:
            process.send_signal(signal.SIGKILL)
        time.sleep(0.002)
    assert process.returncode == -signal.SIGKILL, process.stderr.read()


def test_a_kill_loses_at_most_the_last_moment(tmp_path):
    whole, torn = tmp_path / "whole", tmp_path / "torn"
    assert done(*LONG, "--out", whole)["counts"]["runs"] == 900
    kill_after(20, torn)
    kept = len(journal(torn)) - 1
    assert not (torn / "results.csv").exists()
    kill_after(kept + 100, torn)
    kept = sum(line.endswith(b"\n") for line in journal(torn)) - 1
    assert 120 <= kept < 900
    counts = done(*LONG, "--out", torn)["counts"]
    assert (counts["runs"], counts["resumed"]) == (900, kept)
    assert (torn / "results.csv").read_bytes() == (whole / "results.csv").read_bytes()
    assert len(journal(torn)) == 901


def test_a_torn_or_spoilt_line_is_run_again(small, tmp_path):
    _, out = small
    lines = journal(out)[:7]  # the first line and six runs
    lines[3] = b'{"key": "no end\n'
    lines[6] = lines[6][:50]
    (tmp_path / "journal.jsonl").write_bytes(b"".join(lines))
    gains = ["--grid", "firmware.force_gain=2:12:3", "--grid", "b_w=8.25:363:2"]
    for resumed in (4, 6):
        counts = done(CONTACT, *gains, *BRIEF, "--out", tmp_path)["counts"]
        assert (counts["runs"], counts["resumed"]) == (6, resumed)


@pytest.mark.parametrize(
    ("other", "word"),
    [
        ([CASE_B, "--grid", "firmware.force_gain=2:12:3"], "inputs_hash"),
        ([CONTACT, "--grid", "firmware.force_gain=2:12:3", "--set", "b_w=9"], "inputs_hash"),
    ],
)
def test_another_experiment_in_the_folder_is_refused(small, other, word):
    _, out = small
    before = journal(out)
    refused(forceaxis_sweep(*other, "--out", out), "journal.jsonl", word)
    assert journal(out) == before


def test_another_firmware_or_journal_in_the_folder_is_refused(small, tmp_path):
    _, out = small
    header = json.loads(journal(out)[0])
    arguments = [CONTACT, "--grid", "firmware.force_gain=2:12:3", *BRIEF, "--out", tmp_path]
    torn = '\n{"key": "torn'
    for text, word in (
        (json.dumps(header | {"firmware_hash": "0" * 64}) + torn, "firmware_hash"),
        (json.dumps(header | {"simulator_hash": "0" * 64}) + "\n", "simulator_hash"),
        ('{"some": "thing"}' + torn, "line 1"),
        ("notes without a line's end", "line 1"),
        (json.dumps(header | {"inputs_hash": "0" * 64}), "line 1"),
    ):
        (tmp_path / "journal.jsonl").write_text(text)
        refused(forceaxis_sweep(*arguments), "journal.jsonl", word)
        assert (tmp_path / "journal.jsonl").read_text() == text
    # A journal of the same sweep, killed in its first line, is started again.
    (tmp_path / "journal.jsonl").write_text(json.dumps(header)[:40])
    assert done(*arguments)["counts"]["runs"] == 3


def test_two_sweeps_in_one_folder_are_refused(small):
    summary, out = small
    with (out / "journal.jsonl").open("ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        refused(
            forceaxis_sweep(*summary["command"].split()[2:]),
            "journal.jsonl",
            "another sweep uses this folder",
        )


# Failing runs.


def test_one_percent_of_failing_runs_is_reported_and_the_rest_is_run(swing, tmp_path):
    out = tmp_path / "out"
    text = forceaxis_sweep(swing, "--grid", "m=0:99:100", "--out", out)
    assert text.returncode == 0, text.stderr
    assert "1 of 100" in text.stdout
    rows = rows_of(out)
    assert "mass" in rows[0]["error"] or "parameters.m" in rows[0]["error"]
    assert rows[0]["verdict"] == rows[0]["trace_hash"] == rows[0]["peak_force_N"] == ""
    assert all(row["error"] == "" and row["verdict"] == "stable" for row in rows[1:])
    summary = json.loads((out / "sweep.json").read_text())
    assert summary["counts"]["failed"] == 1
    assert summary["failures"][0]["m"] == 0


def test_a_plant_that_cannot_be_stepped_and_an_object_that_is_refused_are_rows(swing):
    # Rates of sqrt(k / m): 1, 1e3, 1e6 and 1e9 / s; modes are built up to 1.2e7.
    stiff = sweeps.sweep(SweepRequest(swing, grid={"k": "1:1e18:4:log"}))
    assert [bool(e) for e in stiff.columns["error"]] == [False, False, False, True]
    assert math.isnan(stiff.columns["position_ripple_count"][3])
    gains = sweeps.sweep(SweepRequest(ROOT / CASE_B, grid={"firmware.force_gain": [4, 256, 5]}))
    assert ["255.99" in e for e in gains.columns["error"]] == [False, True, False]
    whole = sweeps.sweep(SweepRequest(ROOT / CASE_B, grid={"firmware.latency_ticks": [0, 0.5, 1]}))
    assert ["whole" in e for e in whole.columns["error"]] == [False, True, False]


def test_status_1_only_if_all_runs_fail(swing, tmp_path):
    text = forceaxis_sweep(swing, "--grid", "m=-2:0:3", "--out", tmp_path / "a")
    assert text.returncode == 1
    assert "3 of 3" in text.stdout
    search = forceaxis_sweep(
        swing, "--grid", "m=-2:0:3", "--bisect", "reach=0.01:0.5:0.1", "--out", tmp_path / "b"
    )
    assert search.returncode == 1
    assert all("at reach" in row["error"] for row in rows_of(tmp_path / "b"))


# Mistakes in the command.

GAIN = "firmware.force_gain"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["--grid", "--random", "--bisect"]),
        (["--grid", f"{GAIN}"], ["--grid", "NAME=FROM:TO:COUNT"]),
        (["--grid", f"{GAIN}=1,x"], ["--grid", "VALUE,VALUE"]),
        (["--grid", f"{GAIN}=1:2"], ["--grid", "FROM:TO:COUNT"]),
        (["--grid", f"{GAIN}=1:2:3:lin"], ["--grid", "FROM:TO:COUNT"]),
        (["--grid", f"{GAIN}=1:nan:3"], ["--grid", "finite"]),
        (["--grid", f"{GAIN}=1:2:1"], ["--grid", "COUNT"]),
        (["--grid", f"{GAIN}=1:2:2.5"], ["--grid", "COUNT"]),
        (["--grid", f"{GAIN}=1:2:1e9"], ["--grid", "COUNT"]),
        (["--grid", f"{GAIN}=2:1:3"], ["--grid", "FROM below TO"]),
        (["--grid", f"{GAIN}=0:1:3:log"], ["--grid", "above 0"]),
        (["--grid", f"{GAIN}=1:2:2", "--grid", f"{GAIN}=1:2:2"], [GAIN, "once"]),
        (["--grid", f"{GAIN}=1:2:2", "--set", f"{GAIN}=1"], [GAIN, "once"]),
        (["--grid", f"{GAIN}=1:2:2", "--random", "k_s=1:2"], ["--random", "either"]),
        (["--grid", "m_x=1:2:2"], ["m_x", "parameter of the model"]),
        (["--grid", "m_b=1:2:2"], ["m_b", "changes the model"]),
        (["--grid", "firmware.gain=1:2:2"], ["firmware.gain", "forceaxis objects"]),
        (["--grid", "firmware.tick=1:2:2"], ["firmware.tick"]),
        (["--grid", "experiment.title=1:2:2"], ["experiment.title", "experiment.duration_s"]),
        (["--grid", "plant.x=1:2:2"], ["plant.x", "model parameter"]),
        (["--random", "k_s=1:2"], ["--count"]),
        (["--random", "k_s=1:2:3", "--count", "3"], ["--random", "FROM:TO"]),
        (["--bisect", f"{GAIN}=1:2:0"], ["--bisect", "TOLERANCE"]),
        (["--bisect", f"{GAIN}=1:2:1"], ["--bisect", "TOLERANCE"]),
        (["--bisect", f"{GAIN}=1:2:.1", "--bisect", "k_s=1:2:.1"], ["--bisect", "one parameter"]),
        (["--grid", f"{GAIN}=1:2:2", "--set", "m_w=0"], ["m_w"]),
        (["--grid", f"{GAIN}=1:2:2", "--scheduler", "nowhere"], ["--scheduler", "tcp://HOST:PORT"]),
        (
            ["--grid", f"{GAIN}=1:2:2", "--scheduler", "foo://a:1"],
            ["--scheduler", "tcp://HOST:PORT"],
        ),
    ],
)
def test_a_mistake_in_the_command_is_one_line_before_anything_runs(tmp_path, arguments, words):
    refused(forceaxis_sweep(CONTACT, *arguments, "--out", tmp_path / "out"), *words)
    assert not (tmp_path / "out").exists()


def test_a_search_needs_a_verdict(tmp_path):
    search = ["--bisect", f"{GAIN}=1:16:0.1", "--out", tmp_path / "out"]
    refused(forceaxis_sweep("sim/experiments/axis_contact_a.toml", *search), "verdict")
    refused(forceaxis_sweep("no/such.toml", *search), "no/such.toml")


def refused(finished, *words):
    assert finished.returncode == 2, (finished.stdout, finished.stderr)
    assert finished.stdout == ""
    assert finished.stderr.count("\n") == 1, finished.stderr
    for word in words:
        assert word in finished.stderr


# A cluster.


@pytest.fixture
def cluster(tmp_path):
    with dask_cluster.started(tmp_path) as found:
        yield found


@pytest.mark.long
def test_a_cluster_that_loses_a_worker_loses_no_run(cluster, tmp_path):
    address, workers = cluster
    here, there = tmp_path / "here", tmp_path / "there"
    done(*LONG, "--out", here)
    process = subprocess.Popen(
        command(*LONG, "--scheduler", address, "--out", there, "--json"),
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while process.poll() is None:
        if (there / "journal.jsonl").exists() and len(journal(there)) > 50:
            break
        time.sleep(0.002)
    os.kill(workers[0].pid, signal.SIGKILL)
    assert process.poll() is None, "the sweep was over before the worker was killed"
    stdout, stderr = process.communicate(timeout=120)
    assert process.returncode == 0, stderr
    assert json.loads(stdout)["counts"] == json.loads((here / "sweep.json").read_text())["counts"]
    assert (there / "results.csv").read_bytes() == (here / "results.csv").read_bytes()


def test_a_worker_with_other_files_or_firmware_says_so(swing):
    identity = runner.identity_of(swing, [])
    assert len(runner.run_chunk(str(swing), [], identity, [["reach=0.02"]])) == 1
    for name in identity:
        with pytest.raises(runner.WorkerDiffers, match=name):
            runner.run_chunk(str(swing), [], identity | {name: "0" * 64}, [["reach=0.02"]])
    swing.write_text(SWING.replace("100.0", "101.0"))
    with pytest.raises(runner.WorkerDiffers, match="inputs_hash"):
        runner.run_chunk(str(swing), [], identity, [["reach=0.02"]])
    swing.unlink()
    with pytest.raises(runner.WorkerDiffers, match="expected a readable file, got none"):
        runner.run_chunk(str(swing), [], identity, [["reach=0.02"]])


def test_the_python_side_refuses_as_the_command_does():
    with pytest.raises(InputError, match="finite"):
        sweeps.sweep(SweepRequest(ROOT / CONTACT, grid={"k_s": [1.0, math.nan]}))
    with pytest.raises(InputError, match="one parameter"):
        sweeps.sweep(SweepRequest(ROOT / CONTACT, bisect={"k_s": "1:2:.1", "m_w": "1:2:.1"}))
