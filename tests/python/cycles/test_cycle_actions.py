"""The actions follow, tare and output and the compliance of the press, on the simulated press."""

from pathlib import Path

import numpy as np
import pytest
from forceaxis.cycles import part

PRESS_FIT = Path(__file__).resolve().parents[3] / "sim/experiments/press_fit.toml"
PROGRAM = PRESS_FIT.parents[1] / "cycles/press_fit.toml"
# The force reads 1 N too little: a code is 0.01 N, and 256 codes are a count.
OFFSET = [f"firmware.force_tare={100 / 256}", "firmware.tare_band=8"]
TARE = """
[[phase]]
name = "tare"
do = "tare"
tare_time = "0.1 s"
outputs_on = ["output_1"]
force_max = "50 N"
travel_max = "1 mm"
time_max = "1 s"

[[phase.end]]
when = "reached"
next = "approach"
"""
FOLLOW = """
[[phase]]
name = "seat"
do = "follow"
over = "time"
table_x = [0, 0.5, 0.8]
table_force = ["250 N", "400 N", "300 N"]
slope = "500 N/s"
force_max = "480 N"
travel_max = "1 mm"
time_max = "2 s"

[[phase.end]]
when = "reached"
next = "retract"

"""


def program(folder, changes):
    text = PROGRAM.read_text()
    for old, new in changes:
        assert text.count(old) >= 1, old
        text = text.replace(old, new, 1)
    file = folder / "program.toml"
    file.write_text(text)
    return file


def with_tare(folder):
    return program(folder, [("number = 1\n", "number = 1\n" + TARE)])


def values(run):
    return {figure.name: figure.value for figure in run.result.elements}


def test_a_tare_takes_the_offset_of_the_sensor_away(tmp_path):
    exact = part.run(PRESS_FIT)
    off = part.run(PRESS_FIT, OFFSET)
    tared = part.run(PRESS_FIT, OFFSET, with_tare(tmp_path))
    assert tared.result.state == "good"
    assert [span.name for span in tared.result.phases][:2] == ["tare", "approach"]
    assert tared.result.phases[0].why == "reached"
    # The forces are multiples of a code, so the tared cycle is the one without an offset.
    assert values(tared) == pytest.approx(values(exact), abs=1e-9)
    assert values(off)["work"] == pytest.approx(values(exact)["work"] - 0.0035, abs=0.0015)
    held = [run.curve.force_N[run.curve.phase == seat][-100:].mean()
            for run, seat in ((exact, 2), (tared, 3), (off, 2))]  # fmt: skip
    assert held[1] == pytest.approx(held[0], abs=0.02), "the target contains the offset"
    assert held[2] == pytest.approx(held[0] + 1, abs=0.05), "without a tare 1 N more acts"


def test_a_tare_beyond_the_band_ends_the_cycle_by_name(tmp_path):
    # The sensor reads 4 N too little, within its range: a count is 2.56 N.
    model = (PRESS_FIT.parents[1] / "models/press_fit.toml").read_text()
    (tmp_path / "model.toml").write_text(model.replace("[[adc]]\n", "[[adc]]\nzero_code = 1000\n"))
    text = PRESS_FIT.read_text().split("\n[expect]")[0]
    text = text.replace("../models/press_fit.toml", "model.toml")
    file = tmp_path / "off.toml"
    file.write_text(text.replace("../cycles", str(PRESS_FIT.parents[1] / "cycles")))
    overrides = ["firmware.force_zero_code=1400", "firmware.tare_band=1"]
    result = part.run(file, [*overrides, "firmware.contact_force=10 N"], with_tare(tmp_path))
    assert (result.result.state, result.result.outcome) == ("bad", "tare_band")
    assert result.result.failed_phase == "tare"
    assert result.result.phases[0].why == "tare beyond tare_band"


def test_the_force_follows_its_table(tmp_path):
    text = PROGRAM.read_text()
    seat = text[text.index('[[phase]]\nname = "seat"') : text.index('[[phase]]\nname = "retract"')]
    run = part.run(PRESS_FIT, [], program(tmp_path, [(seat, FOLLOW.lstrip())]))
    inside = run.curve.phase == 2
    time = run.curve.time_s[inside] - run.curve.time_s[inside][0]
    wanted = np.interp(time, [0, 0.5, 0.8], [250, 400, 300])
    # The law follows a ramp of 300 N/s with an error that stays the same.
    error = run.curve.force_N[inside] - wanted
    rises, falls = (time > 0.35) & (time < 0.5), (time > 0.65) & (time < 0.8)
    assert error[rises].mean() == pytest.approx(-12, abs=3) and np.ptp(error[rises]) < 1
    assert error[falls].mean() == pytest.approx(13, abs=3) and np.ptp(error[falls]) < 2
    assert run.result.phases[2].why == "reached"
    assert 0.8 <= run.result.phases[2].end_s - run.result.phases[2].begin_s < 1.0
    assert values(run)["seating_force"] == pytest.approx(388, abs=4)


def test_the_deflection_is_subtracted_from_the_travel(tmp_path):
    """The frame deflects by 1 um for each newton from 100 N on, so the shoulder at 200 N is found
    0.1 mm earlier, and the condition at 2 mm is met by 100 N later."""
    points = (
        'compliance_force = ["-100 N", "100 N", "600 N"]\n'
        'compliance_deflection = ["0 mm", "0 mm", "0.5 mm"]\n'
    )
    plain = part.run(PRESS_FIT)
    bent = part.run(PRESS_FIT, [], program(tmp_path, [("number = 1\n", "number = 1\n" + points)]))
    assert values(bent)["shoulder"] == pytest.approx(values(plain)["shoulder"] - 1e-4, abs=2e-6)
    for run in (plain, bent):
        join = run.curve.phase == 1
        at = np.interp(200, run.curve.force_N[join], run.curve.travel_m[join])
        assert values(run)["shoulder"] == pytest.approx(at, abs=2e-6)
        work = np.trapezoid(run.curve.force_N[join], run.curve.travel_m[join])
        assert values(run)["work"] == pytest.approx(work, rel=1e-3)
    first = np.flatnonzero(bent.curve.phase == 1)[0]
    assert bent.curve.travel_m[first] == pytest.approx(plain.curve.travel_m[first], abs=1e-9)


def test_a_condition_of_the_depth_sees_the_deflection(tmp_path):
    """At 40 N for each mm, 2 mm of travel are 80 N. A frame that deflects by 5 um for each newton
    reaches a depth of 2 mm at 2 mm / (1 - 0.2) of travel."""
    end = 'when = "force_above"\nvalue = "250 N"'
    points = 'compliance_force = ["0 N", "600 N"]\ncompliance_deflection = ["0 mm", "3 mm"]\n'
    run = part.run(
        PRESS_FIT, [],
        program(tmp_path, [(end, 'when = "depth_above"\nvalue = "2 mm"'),
                           ("number = 1\n", "number = 1\n" + points)]),
    )  # fmt: skip
    assert run.result.phases[1].why == "depth_above 2 mm"
    join = run.curve.phase == 1
    assert run.curve.travel_m[join][-1] == pytest.approx(2e-3, abs=5e-6)
    assert run.curve.travel_m[join][-2] < 2e-3
    # Some newtons are the damping of the contact. Without the deflection the force is near 80 N.
    assert run.curve.force_N[join][-1] == pytest.approx(100, abs=4)


def test_outputs_are_in_the_trace_and_go_off_at_the_end(tmp_path):
    from forceaxis import _core

    traced = '["cycle_phase", "cycle_state"]\n\n[plot]'
    text = PRESS_FIT.read_text()
    assert traced in text
    text = text.replace(traced, traced.replace("[", '["cycle_outputs", ', 1))
    file = with_tare(tmp_path)
    seat = 'name = "seat"\n'
    file.write_text(file.read_text().replace(seat, seat + 'outputs_on = ["output_3"]\n'))
    result = _core.run(PRESS_FIT, [f"experiment.cycle={file}", "firmware.tare_band=8"], text=text)
    assert result.cycle.state == "good"
    columns = result.columns()
    outputs, running = columns["cycle_outputs"], columns["cycle_state"] == 1
    assert set(outputs[running]) == {1, 5}
    assert set(outputs[~running]) == {0}
