"""`forceaxis bench --growth`: its points, its counts, its files. No times."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from forceaxis import paths
from forceaxis.bench import growth
from forceaxis.cli.bench import growth_text
from forceaxis.results import from_json, to_json

FORCEAXIS = Path(sys.executable).parent / "forceaxis"


@pytest.fixture(scope="module")
def result():
    plan = growth.GrowthPlan(bodies=(2, 5), frequencies_Hz=(0, 20), runs=(1, 100))
    return growth.run(plan, 1)


def test_each_tool_has_each_point_once(result):
    assert result.missing == {}
    found = [(p.growth, p.tool, p.size) for p in result.points]
    assert len(found) == len(set(found)) == 12
    for tool in growth.TOOLS:
        assert [p.size for p in result.of("states", tool)] == [6, 12]
        assert [p.size for p in result.of("runs", tool)] == [1, 100]
        few, many = (p.size for p in result.of("events", tool))
        assert few == 0 < 40 <= many
    for p in result.points:
        assert p.cpu_s > 0 and p.unit_us > 0 and p.start_MiB > 1 and p.added_MiB >= 0
        units = p.size if p.growth == "runs" else 3000
        assert p.unit_us * units == pytest.approx(1e6 * p.cpu_s)


def test_the_counts_of_events_are_those_of_the_plant(result):
    """40 periods in 2 s, or some more because of the stop. A period has two events of the stop and
    two reversals, which forceaxis counts as two events each."""
    own, odeint = (result.of("events", tool) for tool in growth.TOOLS)
    assert own[0].events == odeint[0].events == 0
    assert 40 * 6 <= own[1].events <= 50 * 6
    assert odeint[1].events / own[1].events == pytest.approx(4 / 6, rel=0.02)
    for tool in growth.TOOLS:
        assert {p.events for p in result.of("states", tool)} == {0}
        assert {p.events for p in result.of("runs", tool)} == {None}


@pytest.mark.parametrize(("kind", "amount"), [("states", 2), ("states", 29), ("events", 10)])
def test_both_tools_solve_the_same_plant(tmp_path, kind, amount):
    own, peer = (
        growth.one_run(growth.Job(kind, tool, amount, 1), tmp_path) for tool in growth.TOOLS
    )
    assert np.array_equal(own.codes, peer.codes)
    assert own.force_N.max() > 1
    assert abs(own.force_N - peer.force_N).max() < 1e-4 * own.force_N.max()


def test_the_peak_is_that_of_the_process_and_not_of_its_parent():
    held = b"\1" * (300 << 20)  # a parent that is larger than the process of a point
    point = growth.in_process(growth.Job("states", "forceaxis", 2, 1))
    assert len(held) / 2**20 > point.start_MiB + point.added_MiB


def test_without_the_library_of_peers_only_forceaxis_is_measured(monkeypatch, tmp_path):
    plan = growth.GrowthPlan(bodies=(2,), frequencies_Hz=(), runs=())
    with monkeypatch.context() as patched:
        patched.setattr(paths, "ROOT", tmp_path)
        alone = growth.run(plan, 1)
    assert [p.tool for p in alone.points] == ["forceaxis"]
    assert "bench_peers.so not found" in alone.missing["odeint"]


def test_table_json_and_picture(result, tmp_path):
    growth.write(result, tmp_path / "new")
    assert (tmp_path / "new/growth.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "new/growth.json").read_text().count("\n") == 1
    assert from_json(growth.Growth, to_json(result)) == result
    text = growth_text(result)
    assert "none is extrapolated" in text
    assert text.count("forceaxis ") == text.count("odeint ") == 6
    assert "not idle" in growth_text(replace(result, load=3.0))


def test_a_folder_without_growth_is_refused(tmp_path):
    done = subprocess.run(
        [FORCEAXIS, "bench", "--out", tmp_path / "x"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and "--growth" in done.stderr
    assert not (tmp_path / "x").exists()
