"""The press-fit of sim/experiments: good parts, six kinds of bad ones, each way to end a cycle."""

import json
import zlib
from pathlib import Path

import numpy as np
import pytest
import verbs
from forceaxis import _core
from forceaxis.experiments import run as runs

PRESS_FIT = Path(__file__).resolve().parents[3] / "sim/experiments/press_fit.toml"


def run(*overrides, more=""):
    text = PRESS_FIT.read_text() + more
    return _core.run(PRESS_FIT, list(overrides), text=text)


def verdicts(cycle):
    return {figure.name: figure.verdict for figure in cycle.figures}


def test_a_good_part_is_good_and_its_figures_are_those_of_the_trace():
    result = run()
    cycle, columns = result.cycle, result.columns()
    assert (cycle.state, cycle.outcome, cycle.cycles) == ("good", "by_program", 1)
    assert set(verdicts(cycle).values()) == {"good"}
    assert result.fault == "none"
    figures = {figure.name: figure.value for figure in cycle.figures}
    force = (columns["adc0"].astype(float) - 0) * 0.01
    phase = columns["cycle_phase"]
    running = columns["cycle_state"] == 1
    seat = (phase == 2) & running
    # The sample of the tick in which a phase ends belongs to that phase.
    seat = np.roll(seat, 1)
    assert figures["seating_force"] == pytest.approx(force[seat].max(), abs=0.02)
    touch = np.argmax(np.abs(force) > 4)
    travel = (columns["encoder"] - columns["encoder"][touch]) * 1e-6
    join = np.roll((phase == 1) & running, 1)
    work = np.sum((force[join][1:] + force[join][:-1]) / 2 * np.diff(travel[join]))
    assert figures["work"] == pytest.approx(work, rel=1e-3)
    at = np.interp(200, force[join], travel[join])
    assert figures["shoulder"] == pytest.approx(at, abs=3e-6)


@pytest.mark.parametrize(("overrides", "state", "outcome", "wrong"), [
    (("gap=30 mm",), "bad", "by_program", "seating_force"),  # no part
    (("k_bore=80 kN/m",), "bad", "by_program", "joining_force"),  # too tight
    (("k_bore=10 kN/m",), "bad", "by_program", "joining_force"),  # too loose
    (("joining_depth=3 mm",), "bad", "by_program", "shoulder"),  # lies askew
    (("joining_depth=9 mm",), "bad", "over_travel", "shoulder"),  # no shoulder
    (("k_bore=140 kN/m", "joining_depth=9 mm"), "bad", "over_travel", "shoulder"),  # stuck
])  # fmt: skip
def test_bad_parts_are_never_good(overrides, state, outcome, wrong):
    cycle = run(*overrides).cycle
    assert (cycle.state, cycle.outcome) == (state, outcome)
    assert verdicts(cycle)[wrong] != "good"


def action(time_s, text):
    return f"\n[[at]]\ntime_s = {time_s}\n{text}\n"


@pytest.mark.parametrize("what", [
    "firmware = { controlword = 15 }",  # without the start bit
    "firmware = { controlword = 287 }",  # halt
    "firmware = { controlword = 7 }",  # disable operation
    "firmware = { controlword = 6 }",  # shutdown
    "firmware = { controlword = 2 }",  # quick stop
    "firmware = { controlword = 0 }",  # disable voltage
    'firmware = { modes_of_operation = 4 }',
    'firmware = { mode = "disabled" }',
    'sensor = { force = "high" }',  # a fault by force_max
])  # fmt: skip
@pytest.mark.parametrize("when", [0.3, 0.8, 1.6])
def test_a_cycle_that_is_stopped_is_aborted_and_never_good(what, when):
    result = run("firmware.force_max=200", more=action(when, what))
    cycle = result.cycle
    assert (cycle.state, cycle.outcome, cycle.cycles) == ("aborted", "stopped", 1)
    # The axis stands after the stop.
    encoder = result.columns()["encoder"]
    assert np.ptp(encoder[-300:]) <= 20


@pytest.mark.parametrize("what", ["force_limit = 300", "speed_max = 60000", "force_max = 400"])
def test_a_bound_that_is_changed_ends_the_part(what):
    result = run(more=action(0.8, f"firmware = {{ {what} }}"))
    cycle = result.cycle
    assert (cycle.state, cycle.outcome, cycle.cycles) == ("bad", "changed", 1)
    assert np.ptp(result.columns()["encoder"][-300:]) <= 20


def test_without_a_program_no_cycle_starts(tmp_path):
    text = PRESS_FIT.read_text().replace('cycle = "../cycles/press_fit.toml"\n', "")
    result = _core.run(PRESS_FIT, text=text + "\n", overrides=[])
    assert result.cycle is None
    assert result.columns()["cycle_state"][-1] == 6  # no_program
    assert np.ptp(result.columns()["encoder"][300:]) <= 2


def test_a_program_for_another_bank_does_not_start(tmp_path):
    program = (PRESS_FIT.parents[1] / "cycles/press_fit.toml").read_text()
    (tmp_path / "cycle.toml").write_text('bank_crc = "12345678"\n' + program)
    text = PRESS_FIT.read_text().replace("../cycles/press_fit.toml", str(tmp_path / "cycle.toml"))
    result = _core.run(PRESS_FIT, text=text)
    assert result.cycle.state == "other_bank" and result.cycle.cycles == 0
    assert np.ptp(result.columns()["encoder"][300:]) <= 2


def test_an_absolute_move_needs_a_homed_axis(tmp_path):
    program = (PRESS_FIT.parents[1] / "cycles/press_fit.toml").read_text()
    program = program.replace(
        'do = "move_to_depth"\ndistance = "-8 mm"', 'do = "move"\nposition = 0'
    )
    (tmp_path / "cycle.toml").write_text(program)
    text = PRESS_FIT.read_text().replace("../cycles/press_fit.toml", str(tmp_path / "cycle.toml"))
    assert _core.run(PRESS_FIT, text=text).cycle.state == "not_homed"
    homed = text.replace(
        "modes_of_operation = -9", "modes_of_operation = 6\nhoming_method = 35"
    ) + action(0.2, "firmware = { modes_of_operation = -9 }")
    homed += action(0.22, "firmware = { controlword = 15 }")
    homed += action(0.24, "firmware = { controlword = 31 }")
    cycle = _core.run(PRESS_FIT, text=homed).cycle
    assert cycle.state == "good"


def test_two_cycles_in_a_row_have_the_same_figures():
    more = action(2.6, "firmware = { controlword = 15 }")
    more += action(2.7, "firmware = { controlword = 31 }")
    first, second = run().cycle, run("experiment.duration_s=6", more=more).cycle
    assert (second.cycles, second.state) == (2, "good")
    for one, two in zip(first.figures, second.figures, strict=True):
        assert two.value == pytest.approx(one.value, rel=0.01), one.name


def test_the_bound_of_force_holds_whatever_the_program_wants():
    # 400 N of the program are 800 per mille; force_limit lets 300 N.
    result = run(more=action(0.05, "firmware = { force_limit = 600 }"))
    assert result.cycle.state == "bad"
    seat = result.columns()["cycle_phase"] == 2
    assert result.columns()["sensor.force"][seat][600:].max() < 301


def test_the_report_of_a_run_has_the_part():
    report = runs.run(PRESS_FIT).result.cycle
    assert report.state == "good"
    assert [figure.name for figure in report.figures][:2] == ["joining_force", "shoulder"]


def test_the_record_of_the_program_is_what_an_axis_takes():
    record = _core.cycle_program(PRESS_FIT).record
    assert record[:4] == b"FXCY" and int.from_bytes(record[6:8], "little") == len(record)
    assert zlib.crc32(record[:-4]) == int.from_bytes(record[-4:], "little")
    with pytest.raises(
        _core.InputError, match="cycle: expected an experiment that names a program"
    ):
        _core.cycle_program(PRESS_FIT.with_name("contact.toml"))


# A load cell whose range ends at 400.4 N, under a press that joins at 40 mm/s: 680 N at the peak.
def pressed_to_the_end(folder, **limits):
    model = (PRESS_FIT.parents[1] / "models/press_fit.toml").read_text()
    assert "per_count = 0.01 " in model
    (folder / "model.toml").write_text(model.replace("per_count = 0.01 ", "per_count = 0.00611 "))
    program = (PRESS_FIT.parents[1] / "cycles/press_fit.toml").read_text()
    program = program.replace('speed = "5 mm/s"', 'speed = "40 mm/s"')
    for old, new in limits.items():
        assert f'"{old[1:]} N"' in program
        program = program.replace(f'"{old[1:]} N"', f'"{new} N"')
    (folder / "cycle.toml").write_text(program)
    text = PRESS_FIT.read_text().split("\n[expect]")[0]
    text = text.replace("../cycles/press_fit.toml", str(folder / "cycle.toml"))
    text = text.replace("../models/press_fit.toml", str(folder / "model.toml"))
    (folder / "run.toml").write_text(text.replace("2560000", "1564160"))
    return folder / "run.toml"


def test_forces_at_the_end_of_the_sensor_are_refused_with_the_program(tmp_path):
    file = pressed_to_the_end(tmp_path)
    done = verbs.forceaxis("cycle", "run", str(file))
    assert done.returncode == 2
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, lines
    assert "phase[1].force_max: expected less than 400.4" in lines[0]
    assert "lower it, or choose a sensor with a larger range" in lines[0]
    for limits, key in [
        ({"_450": 399, "_480": 399, "_400": 398}, None),
        ({"_450": 399, "_480": 400.42, "_400": 398}, "phase[2].force_max"),
    ]:
        done = verbs.forceaxis(
            "cycle", "run", str(pressed_to_the_end(tmp_path, **limits)), "--json"
        )
        assert (done.returncode == 2) == (key is not None), done.stderr
        assert key is None or key in done.stderr


def test_a_reading_at_its_end_makes_the_part_bad_by_its_name(tmp_path):
    file = pressed_to_the_end(tmp_path, _450=399, _480=399, _400=398)
    done = verbs.forceaxis("cycle", "run", str(file), "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["state"], result["outcome"]) == ("bad", "samples_invalid")
    phase = result["failed_phase"]
    assert phase in ("join", "seat") and result["invalid_ticks"] >= 1
    text = verbs.forceaxis("cycle", "run", str(file)).stdout
    why = "with a sample at an end of its range or older than cycle_age_max"
    assert f"bad: {result['invalid_ticks']} tick" in text and f"in phase {phase} {why}" in text


def test_the_axis_refuses_at_the_start_what_its_sensor_cannot_show():
    # The zero of the sensor is written after the program was selected: the range ends at 435 N.
    late = "\n[[at]]\ntime_s = 0.01\nfirmware = { force_zero_code = 22000 }\n"
    result = run(more=late)
    assert (result.cycle.state, result.cycle.cycles) == ("beyond_sensor", 0)
    assert np.ptp(result.columns()["encoder"][300:]) <= 2
