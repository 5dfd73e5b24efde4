"""Forty experiments, good and bad in ways that users name, each with the verdict that physics and
its user's intention demand: tests/system/verdicts/cases.toml."""

import json
import tomllib
from pathlib import Path

import pytest
import verbs
from forceaxis.cli import sweep_text
from forceaxis.experiments import run as runs
from forceaxis.experiments import summary as summaries
from forceaxis.experiments import sweep as sweeps
from forceaxis.experiments.verdicts import VERDICTS

ROOT = Path(__file__).resolve().parents[3]
HERE = ROOT / "tests/system/verdicts"
CASES = tomllib.loads((HERE / "cases.toml").read_text())["case"]


def run(case):
    """The run of a case."""
    name = case["experiment"]
    file = HERE / name if name.endswith(".toml") else ROOT / f"sim/experiments/{name}.toml"
    text = file.read_text()
    if "replace" in case:
        assert case["replace"][0] in text
        text = text.replace(*case["replace"])
    if "at" in case:
        text += f"\n{case['at']}\n"
    return runs.run(file, case.get("set", []), text=text)


def test_there_are_forty_of_every_kind():
    assert len({case["what"] for case in CASES}) == len(CASES) == 40
    assert {case["verdict"] for case in CASES} == set(VERDICTS)


@pytest.mark.parametrize("case", CASES, ids=[case["what"] for case in CASES])
def test_the_verdict_is_what_its_user_wanted_to_know(case):
    done = run(case)
    summary = done.summary
    assert summary["verdict"] == case["verdict"], summary["because"]
    assert bool(summary["because"]) == bool(summary["missed"]) == (case["verdict"] != "stable")
    assert case.get("because", "") in "\n".join(summary["because"])
    for one in summary["missed"]:  # which limit, its number and its unit
        assert one["verdict"] in VERDICTS[1:]
        assert one["value"] is None or isinstance(one["value"], float)
        assert {"limit", "bound", "unit"} < one.keys()
    if case["verdict"] == "not_met":
        assert {one["verdict"] for one in summary["missed"]} == {"not_met"}
    assert summaries.verdict_text(done.result).startswith(case["verdict"])


def test_a_setpoint_beyond_the_sensor_is_warned_of():
    done = verbs.forceaxis("run", HERE / "contact.toml", "--set", "firmware.force_setpoint=400 N")
    assert done.returncode == 0
    assert "warning      set-point 400 N: expected one within the force reading" in done.stdout
    assert "verdict      not_met: " in done.stdout
    within = runs.run(HERE / "contact.toml", ["firmware.force_setpoint=299 N"]).summary
    assert within["warnings"] == [] and within["verdict"] == "stable"


@pytest.mark.parametrize(
    ("limits", "most_N"),
    [
        (["force_limit=500"], 50),
        (["force_limit_positive=600"], 60),
        (["force_limit=500", "force_limit_positive=600"], 50),
        (["force_limit=750"], None),
        (["force_limit_negative=100"], None),  # of tension
    ],
)
def test_a_setpoint_above_the_limit_of_the_force_is_warned_of(limits, most_N):
    """75 N of a rated force of 100 N; the axis presses with no more than the limit."""
    sets = [f"firmware.{limit}" for limit in limits]
    summary = runs.run(ROOT / "sim/experiments/hold_biquad.toml", sets).summary
    held_N = summary["metrics"]["held_force"]["held_N"]
    assert held_N == pytest.approx(most_N or 75, abs=1)
    expected = [f"set-point 75 N: expected at most the limit of the force, {most_N} N"]
    assert [text.partition(" (")[0] for text in summary["warnings"]] == expected * bool(most_N)


# A count of the press's reading at 8 bits is 300 N / 128: it ends at 127.9 counts.
def test_a_map_is_not_green_beyond_the_sensor(tmp_path):
    grid = {"firmware.force_setpoint": "32,96,160,200", "firmware.force_gain": "3.5,7"}
    request = sweeps.SweepRequest(HERE / "contact.toml", grid)
    done = sweeps.sweep(request, out=tmp_path / "map")
    beyond = done.columns["firmware.force_setpoint"] > 128
    assert set(done.columns["verdict"][~beyond]) == {"stable"}
    assert set(done.columns["verdict"][beyond]) == {"not_met"}
    assert done.summary["counts"]["not_met"] == 4 and done.summary["counts"]["unstable"] == 0
    (warning,) = done.summary["warnings"]
    assert "4 of 8 points" in warning and "375 N" in warning
    shown = dict(sweep_text.rows(done))
    assert shown["verdict"] == "4 stable, 0 unstable, 4 not met"
    assert "never in contact" not in (tmp_path / "map/plot.svg").read_text()


# Between two verdicts that are both not stable there is no boundary of stability.
def test_a_boundary_is_where_stable_ends_whatever_follows():
    search = {"firmware.force_setpoint": "100:200:1"}
    done = sweeps.sweep(sweeps.SweepRequest(HERE / "contact.toml", bisect=search))
    assert 127 <= done.columns["boundary"][0] <= 128 <= done.columns["unstable_at"][0] <= 129
    assert done.columns["beyond"][0] == "not_met"
    search = {"firmware.force_gain": "0:20:1"}
    done = sweeps.sweep(sweeps.SweepRequest(HERE / "contact.toml", bisect=search))
    assert done.columns["note"][0] == "stable at neither end: never_in_contact at 0, unstable at 20"


def test_a_page_calls_each_verdict_by_its_name(tmp_path):
    for name in ("contact", "model"):
        (tmp_path / f"{name}.toml").write_text((HERE / f"{name}.toml").read_text())
    text = (tmp_path / "contact.toml").read_text()
    (tmp_path / "never.toml").write_text(text.replace("force_gain = 7.2890625", "force_gain = 0"))
    limit = "[verdict]\nheld_force_error_max_N = 1"
    (tmp_path / "error.toml").write_text(text.replace("[verdict]", limit))
    done = verbs.forceaxis("report", tmp_path, "--out", tmp_path / "page", "--json")
    assert json.loads(done.stdout)["counts"] == {"stable": 1, "not_met": 1, "never_in_contact": 1}
    page = (tmp_path / "page/index.html").read_text()
    assert "1 not met" in page and "1 never in contact" in page
