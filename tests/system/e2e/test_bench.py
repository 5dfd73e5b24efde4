"""`forceaxis bench`: its JSON, its accuracy, its output without peers. No times."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from forceaxis import _core, paths
from forceaxis.bench import bench, scipy_peer
from forceaxis.results import from_json

FORCEAXIS = Path(sys.executable).parent / "forceaxis"


@pytest.fixture(scope="module")
def result():
    command = [FORCEAXIS, "bench", "--repeat", "1", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    return json.loads(done.stdout)


def test_every_tool_has_a_row_with_speed_and_error(result):
    assert result["missing"] == {}
    found = [(r["case"], r["tool"]) for r in result["results"]]
    wanted = {(case, tool) for case in "AB" for tool in bench.TOOLS}
    wanted |= {("full", tool) for tool in bench.TOOLS if tool != "scipy"}
    assert len(found) == len(set(found)) and set(found) == wanted
    for row in result["results"]:
        assert row["real_time_factor"] > 0 and row["force_error_N"] >= 0


def test_own_force_is_the_reference_at_every_tick(result):
    most = {"A": 1e-9, "B": 1e-8, "full": 1e-8}
    for row in result["results"]:
        if row["tool"].startswith("forceaxis"):
            assert 0 < row["force_error_N"] <= most[row["case"]], row
            assert row["codes_differ"] == 0


def test_peers_solve_the_same_problem(result):
    """Their errors are those that others measured for them: the scenario's 1.5e-5 N and so on."""
    error = {(r["case"], r["tool"]): r["force_error_N"] for r in result["results"]}
    assert 1e-5 < error["A", "odeint"] < 2e-5
    assert 5e-4 < error["B", "odeint"] < 8e-4
    assert 5e-3 < error["A", "mujoco"] < 8e-3
    assert 1e-5 < error["A", "scipy"] < 2e-5
    events = {(r["case"], r["tool"]): r["events"] for r in result["results"]}
    for tool in ("forceaxis", "forceaxis+firmware", "odeint", "scipy"):
        assert events["A", tool] == 2 and events["B", tool] == 335, tool


def test_a_case_and_a_tool_alone():
    command = [FORCEAXIS, "bench", "--case", "A", "--tool", "forceaxis", "--repeat", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "A     forceaxis  " in done.stdout
    assert "odeint" not in done.stdout and "full" not in done.stdout


def test_without_a_checkout_it_times_itself_and_says_what_is_missing(monkeypatch, tmp_path):
    monkeypatch.setattr(paths, "ROOT", tmp_path)
    rows, missing = bench.cases(["A"], ("forceaxis", "odeint"), 1, lambda: None)
    assert [r.tool for r in rows] == ["forceaxis"]
    assert rows[0].force_error_N is None
    assert set(missing) == {"odeint", "reference"}
    assert "bench_peers.so not found" in missing["odeint"]


def test_sweeps_do_not_depend_on_the_number_of_threads():
    case = bench.CASES["A"]
    own = _core.BenchCase(paths.EXPERIMENTS / case.experiment, *case.signals)
    one, three = (own.sweep((4, 15), (59, 100), 2, n) for n in (1, 3))
    for name in ("peak_force_N", "end_force_N", "contact_losses", "last_change"):
        assert np.array_equal(one[name], three[name])
    # The first run is case A: values of an independent 113-bit integration.
    assert one["peak_force_N"][0] == pytest.approx(69.69030030811, abs=1e-10)
    assert one["end_force_N"][0] == pytest.approx(52.053813653183, abs=1e-10)
    assert one["last_change"][0] == 1873 and one["contact_losses"][0] == 0
    assert one["contact_losses"][3] > 0  # the last is case B


def test_a_check_fails_on_a_figure_that_is_missing_or_short(result):
    found = from_json(bench.BenchResult, result)
    assert any(c.check.startswith("A: plant / odeint") for c in bench.check(found))
    fast = [
        replace(row, times_forceaxis=row.times_forceaxis / 1000) if row.tool == "odeint" else row
        for row in found.results
    ]
    short = bench.check(replace(found, results=fast))
    assert not any(c.held for c in short if "odeint" in c.check)
    assert not any(c.held for c in bench.check(replace(found, results=[])))


def test_a_case_that_is_none_is_refused():
    done = subprocess.run(
        [FORCEAXIS, "bench", "--case", "C"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "'C'" in done.stderr


def test_scipy_runs_part_of_a_case():
    force, counts, seconds, events = scipy_peer.run(4, 59, 200)
    assert len(force) == len(counts) == 201
    assert force[189] == 0 < force[190]  # touch-down at 0.12666 s, tick 189.99
    assert events == 2 and seconds > 0


def test_the_check_asks_for_each_peer_and_for_mujoco_only_where_it_is_installed(result):
    found = from_json(bench.BenchResult, result)
    asked = [c.check for c in bench.check(found)]
    for start in ("A: plant / odeint", "B: plant / odeint", "full: plant / odeint"):
        assert any(c.startswith(start) for c in asked), start
    assert any("mujoco" in c for c in asked)
    without = replace(
        found,
        results=[row for row in found.results if row.tool != "mujoco"],
        missing={"mujoco": "not built"},
    )
    assert not any("mujoco" in c.check for c in bench.check(without))
    unknown = [c for c in bench.check(replace(without, missing={})) if "mujoco" in c.check]
    assert [c.held for c in unknown] == [False]


def test_no_requirement_of_the_linear_analysis_is_a_time():
    rows = [
        bench.AnalysisSpeed("10000 frequencies of full_axis", 9, 1.0, 1000.0, 0.0),
        bench.AnalysisSpeed("advice table of laboratory, 33 rows", 9, 1000.0, None, None),
    ]
    slower = [
        replace(r, seconds=7 * r.seconds, control_seconds=r.control_seconds and 7000.0)
        for r in rows
    ]
    assert bench.linear_checks(rows) == bench.linear_checks(slower)
    assert all(c.held for c in bench.linear_checks(rows))
    alone = bench.linear_checks([replace(rows[0], control_seconds=1.0), rows[1]])
    assert [c.held for c in alone] == [False, True, False]


def test_a_ratio_compares_neighbouring_turns():
    """The clock doubles after the first repetition: each tool's fastest run is of another one."""
    other = [[3.0, 2.0], [1.0, 1.5], [2.0]]
    assert bench.paired_ratio([[4.0], [2.5, 2.0], [9.0]], other) == 2.0
    assert bench.paired_ratio(other, other) == 1.0
