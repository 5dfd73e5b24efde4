"""The curve that an axis has recorded, with the simulated axis: its points against the recorder,
its table, its plot, and when it cannot be read."""

import csv
from pathlib import Path

import numpy as np
import pytest
from forceaxis.axis.axis import Axis
from forceaxis.axis.drive import ENABLE, NEW_SETPOINT
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.cycles import curve as curves
from forceaxis.cycles import live, plots, results
from forceaxis.objects import BY_NAME

PRESS_FIT = Path(__file__).resolve().parents[3] / "sim/experiments/press_fit.toml"
STEP = {"travel": 25e-6, "force": 655.36 / 256, "time": 15 / 1500}  # by default: m, N, s
RECORDED = ("tick_count", "position", "force", "contact", "cycle_phase")


@pytest.fixture
def axis():
    with Axis.sim(PRESS_FIT) as axis:
        yield axis


@pytest.fixture(scope="module")
def wanted():
    return live.live_program(PRESS_FIT)


@pytest.fixture(scope="module")
def pressed(wanted):
    """A part, its curve, and what the recorder has of its first ticks."""
    with Axis.sim(PRESS_FIT) as axis:
        live.load(axis, wanted)
        state = BY_NAME["cycle_state"]
        axis.link.arm(RECORDED, {
            "trigger_source": state.index << 8 | state.sub, "trigger_edge": 1, "trigger_level": 1,
        })  # fmt: skip
        part = results.press(axis, wanted)
        recording = axis.link.recording(5.0)
        return part, curves.read(axis, wanted), recording


def test_the_points_are_those_of_the_recorded_ticks(pressed):
    _, curve, recording = pressed
    value = {name: recording.values(name) for name in RECORDED}
    first = recording.trigger_sample
    assert first == 0 or value["tick_count"][0] < value["tick_count"][first]
    at_zero = first + int(np.argmax(value["contact"][first:] != 0))
    assert value["contact"][at_zero] == 1
    inside = curve.time_s * 1500 <= len(recording.raw) - first - 1
    assert 300 < inside.sum() < len(curve.time_s)
    row = np.rint(curve.time_s[inside] * 1500).astype(int) - 1 + first
    assert row[0] == first and np.all(np.diff(row) >= 1)
    # a trace has the phase after the tick
    phase = value["cycle_phase"][np.maximum(row - 1, first)]
    assert np.array_equal(curve.phase[inside], phase)
    travel = (value["position"][row] - value["position"][at_zero]) * 1e-6
    assert curve.travel_m[inside] == pytest.approx(travel, abs=1e-12)
    assert curve.force_N[inside] == pytest.approx(value["force"][row] * 2.56, abs=1e-9)


def test_no_gap_is_larger_than_the_steps(pressed):
    """One tick more for what moves within it: 30 mm/s, and 200 N/s on the shoulder."""
    _, curve, _ = pressed
    factor = 2**curve.thinned
    assert 300 < len(curve.time_s) <= 1000
    assert np.diff(curve.time_s).max() <= STEP["time"] * factor * 1.001
    assert np.abs(np.diff(curve.travel_m)).max() <= factor * (STEP["travel"] + 22e-6)
    same = np.diff(curve.phase) == 0
    assert np.abs(np.diff(curve.force_N))[same].max() <= factor * (STEP["force"] + 20)


def test_the_figures_of_the_elements_are_those_of_the_curve(pressed, wanted):
    part, curve, _ = pressed
    seat = [phase.name for phase in wanted.program.phases].index("seat")
    peak = next(figure for figure in part.elements if figure.name == "seating_force")
    assert curve.force_N[curve.phase == seat].max() == pytest.approx(peak.value, abs=STEP["force"])
    join = curve.phase == seat - 1
    shoulder = next(figure for figure in part.elements if figure.name == "shoulder")
    at_200_N = np.interp(200.0, curve.force_N[join], curve.travel_m[join])
    assert at_200_N == pytest.approx(shoulder.value, abs=2 * STEP["travel"])


def test_the_table_has_every_point(pressed, wanted, tmp_path):
    _, curve, _ = pressed
    file = tmp_path / "part.csv"
    curves.write_table(curve, wanted, file)
    with file.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["time_s", "travel_m", "force_N", "phase"]
    assert len(rows) == len(curve.time_s)
    for name in ("time_s", "travel_m", "force_N"):
        found = np.array([float(row[name]) for row in rows])
        assert found == pytest.approx(getattr(curve, name), rel=1e-8, abs=1e-12)
    names = list(dict.fromkeys(row["phase"] for row in rows))
    assert names == ["approach", "join", "seat", "retract"]


def test_the_plot_has_the_elements_of_the_part(pressed, wanted):
    part, curve, _ = pressed
    figure = plots.draw(curves.picture(curve, part, wanted))
    named = [text.get_text() for ax in figure.axes for text in ax.texts]
    for name in ("joining force", "shoulder 3.8 to 4.3 mm", "seating force 390 to 425 N", "seated"):
        assert name in named
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels == ["approach", "join", "seat", "retract"]
    (line,) = figure.axes[1].get_lines()[:1]
    assert len(line.get_xdata()) == len(curve.time_s)


def test_steps_of_the_axis_make_the_points(axis, wanted):
    live.load(axis, wanted)
    axis.set(cycle_curve_step_travel=0, cycle_curve_step_force=0, cycle_curve_step_time=300)
    live.start(axis, wanted)
    curve = curves.read(axis, wanted)
    assert 10 < len(curve.time_s) < 30 and curve.thinned == 0
    starts = 1 + np.flatnonzero(np.diff(curve.phase))
    gaps = np.delete(np.diff(curve.time_s), [*(starts - 1), len(curve.time_s) - 2])
    assert gaps == pytest.approx(0.2)


def test_a_stopped_part_has_its_curve(axis, wanted):
    live.load(axis, wanted)
    with pytest.raises(NoAnswer):
        live.start(axis, wanted, timeout_s=0.6)
    assert axis.text("cycle_state") == "aborted"
    curve = curves.read(axis, wanted)
    assert curve.time_s[-1] == pytest.approx(0.6, abs=0.05)


def test_before_the_first_cycle_and_while_one_runs_there_is_none(axis, wanted):
    live.load(axis, wanted)
    with pytest.raises(Refused, match="expected the curve of a cycle, got none; start a cycle"):
        curves.read(axis, wanted)
    axis.enable(live.MODE)
    axis.link.write({"controlword": ENABLE})
    axis.link.write({"controlword": NEW_SETPOINT})
    axis.link.wait(0.2)
    with pytest.raises(Refused, match="expected a cycle that has ended, but it is running"):
        curves.read(axis, wanted)
    with pytest.raises(Refused, match=r"cycle_curve_first: .*; while a cycle runs it cannot be"):
        axis.link.write({"cycle_curve_first": 0})
    with pytest.raises(Refused, match=r"adc_bits: .*; it can be written only while .* disabled"):
        axis.set(adc_bits=14)
    axis.off()
    axis.link.wait(0.1)
    assert curves.read(axis, wanted).time_s[-1] == pytest.approx(0.2, abs=0.05)


def test_a_curve_that_is_replaced_while_it_is_read_is_refused(axis, wanted, monkeypatch):
    live.load(axis, wanted)
    live.start(axis, wanted)
    monkeypatch.setattr(axis.link, "cycle_curve", lambda: live.start(axis, wanted) or b"")
    with pytest.raises(Refused, match="another cycle has started and replaced the curve"):
        curves.read(axis, wanted)


def test_bytes_become_points_with_units(wanted):
    """By hand: 3 ticks, -2 um, -1/256 count, phase 2; 1500 ticks, 1 mm, 100 counts, phase 15."""
    data = bytes.fromhex("03000000 feffffff 02ffffffdc050000 e8030000 0f006400")
    found = curves.points(data, wanted, 1)
    assert found.time_s == pytest.approx([0.002, 1.0])
    assert found.travel_m == pytest.approx([-2e-6, 1e-3])
    assert found.force_N == pytest.approx([-0.01, 256.0])
    assert (found.phase.tolist(), found.thinned) == ([2, 15], 1)
