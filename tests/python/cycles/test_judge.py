"""Parts that are judged from recorded curves have the values of an independent evaluation to the
last count, and those of the firmware that pressed them."""

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from forceaxis import InputError
from forceaxis.cycles import curve_samples, judge
from forceaxis.errors import ParameterError
from forceaxis.experiments import run as runs
from forceaxis.recordings.signal_recording import SignalFinding
from judged_curves import SIDES, Oracle, recording, saturation, signal, without

EXPERIMENTS = Path(__file__).resolve().parents[3] / "sim/experiments"
TRAVEL, FORCE = "0.000001", "0.01"
COUNTS = judge.Counts(float(TRAVEL), float(FORCE), 3.0)
PHASES = ("a", "b", "c", "d")


def program_of(elements, **head):
    """A program of four phases that end by their time. It repeats them, so a curve may come back to
    its first phase."""
    phases = [
        {"name": name, "do": "wait", "force_max": 1300.0, "travel_max": 100.0, "time_max": 1000.0,
         "end": [{"when": "time", "value": 900.0, "next": after}]}
        for name, after in zip(PHASES, (*PHASES[1:], "end"), strict=True)
    ]  # fmt: skip
    phases[-1]["end"].insert(0, {"when": "time", "value": 800.0, "next": "a", "count": 3})
    return {"title": "Curves", **head, "phase": phases, "element": elements}


def press_of(folder, program, counts=COUNTS):
    file = folder / "program.toml"
    file.write_text(tomlkit.dumps(program))
    return judge.JudgePress(file, counts)


def expect_equal(judged, wanted, press, rate_hz):
    """Asserts that the elements have the wanted verdicts and values in counts."""
    program = press.at(rate_hz).program()
    for element, figure, (name, verdict, value) in zip(
        program.elements, judged.record.elements, wanted, strict=True
    ):
        assert (figure.name, figure.verdict) == (name, verdict)
        if verdict in ("invalid", "not reached"):
            assert figure.value is None
        else:
            assert figure.value == pytest.approx(value * element.per_value, rel=1e-11, abs=0), name
            assert round(figure.value / element.per_value) == value


# Random curves on a coarse grid, so that levels and corners are met exactly.


def drawn_bounds(rng, low, high, step):
    return dict(zip(("least", "most"), sorted(rng.randint(low, high) * step for _ in "ab"),
                    strict=True))  # fmt: skip


def drawn_element(rng, name, grid, rate_hz):
    kind = rng.choice(["peak", "valley", "at", "difference", "work", "last", "window", "envelope"])
    over_time = rng.random() < 0.25
    x_step = 2 / rate_hz if over_time else grid[0] * 1e-6
    y_step = grid[1] * 0.01
    low = 0 if over_time else -8
    element = {"name": name, "kind": kind, "phases": rng.sample(PHASES, rng.choice([1, 2, 4]))}
    if over_time:
        element["over"] = "time"
    if kind not in ("at", "difference", "envelope"):
        x = sorted(rng.randint(low, 12) * x_step for _ in "ab")
        element |= {"from": x[0], "to": x[1]}
    if kind == "window":
        element |= drawn_bounds(rng, -8, 8, y_step)
        element["enters"] = rng.sample(sorted(SIDES), rng.randint(1, 4))
        if leaves := rng.sample(sorted(SIDES), rng.choice([0, 1, 4])):
            element["leaves"] = leaves
    elif kind == "envelope":
        far = 1000 if over_time else 9
        for bound, sign in (("lower", -1), ("upper", 1)):
            inner = rng.sample(range(1, 9), rng.randint(0, 3))
            xs = sorted({far, -far * (not over_time), *inner})
            element[f"{bound}_x"] = [x * x_step for x in xs]
            element[f"{bound}_force"] = [sign * rng.randint(-1, 9) * y_step for _ in xs]
        if rng.random() < 0.5:
            x = sorted(rng.randint(max(low, -far), 8) * x_step for _ in "ab")
            element |= {"from": x[0], "to": x[1]}
    elif kind in ("at", "difference"):
        of_force = rng.random() < 0.5
        step = y_step if of_force else x_step
        element |= {"of": "force" if of_force else "x", "ordinal": rng.choice([1, 1, 2, 3]),
                    "direction": rng.choice(["rising", "falling", "either"]),
                    "level": rng.randint(-6, 6) * step}  # fmt: skip
        if kind == "difference":
            element["level_2"] = rng.randint(-6, 6) * step
        element |= drawn_bounds(rng, -9, 9, x_step if of_force else y_step)
    elif kind == "work":
        unit = 256 * 0.01 * (1 / rate_hz if over_time else 1e-6)
        element |= drawn_bounds(rng, -500, 500, 3 * unit)
    else:
        element |= drawn_bounds(rng, -8, 8, y_step)
    return element


def drawn_curve(rng, grid, rate_hz):
    """(recording, numbers of the lost samples) of a walk over the grid."""
    count = rng.choice([9, 20, 60])
    x, y, phase, rows = rng.randint(-3, 3), rng.randint(-3, 3), rng.randint(0, 3), []
    for _ in range(count):
        rows.append((x * grid[0], y * grid[1], phase))
        x = max(-9, min(12, x + rng.choice([-1, 0, 0, 1, 1, 2, 3])))
        y = max(-9, min(9, y + rng.choice([-3, -2, -1, 0, 1, 2, 3])))
        phase = phase if rng.random() < 0.9 else rng.randint(0, 3)
    outside = rng.randint(0, 3)
    rows = [*((*r[:2], -1) for r in rows[:outside]), *rows[outside:]]
    whole = np.array(rows)
    off = np.array([[rng.uniform(-0.45, 0.45) for _ in "ab"] for _ in rows])
    time_s = rng.choice([0.0, 12.3]) + np.arange(count) / rate_hz
    findings = []
    if rng.random() < 0.15:
        k = rng.randrange(1, count)
        findings.append(saturation(time_s[k], time_s[min(count - 1, k + 2)]))
    made = recording(time_s, (whole[:, 1] + off[:, 1]) * 0.01, (whole[:, 0] + off[:, 0]) * 1e-6,
                     findings, phase=whole[:, 2])  # fmt: skip
    lost = []
    if rng.random() < 0.2:
        begin = rng.randrange(outside + 1, count - 1)
        lost = list(range(begin, min(count - 1, begin + rng.randint(1, 3))))
    made = without(made, lost)
    left = len(made["force"].values)
    if left > 8 and rng.random() < 0.2:  # the force is beyond its range at an end
        head, tail = rng.randint(0, 2), rng.randint(0, 2)
        made = without(made, [*range(head), *range(left - tail, left)], ["force"])
    return made


def drawn_head(rng, grid):
    zero = rng.choice(["touch", "force", "position"])
    head = {"zero": zero}
    if zero == "force":
        head["zero_force"] = rng.choice([-2, -1, 1, 2]) * grid[1] * 0.01
    if zero == "position":
        head["zero_position"] = rng.randint(-2, 2) * grid[0] * 1e-6
    if rng.random() < 0.3 and grid[0] < 10**6:  # Deflections are at most 8.3 million counts.
        head |= {"compliance_force": [-20.0, 0.0, 37.77],
                 "compliance_deflection": [-grid[0] * 1e-6, 0.0, 3 * grid[0] * 1e-6]}  # fmt: skip
    return head


@pytest.mark.parametrize("seed", range(4))
def test_a_thousand_curves_have_the_values_of_numpy_to_the_last_count(seed, tmp_path):
    rng = random.Random(4500 + seed)
    seen, curves = set(), 0
    while curves < 250:
        grid = rng.choice([(1, 1), (3, 2), (7, 5), (1000, 640), (20_000_000, 14000)])
        rate_hz = rng.choice([100.0, 1000.0, 1500.0, 10000.0])
        elements = [drawn_element(rng, f"e{k}", grid, rate_hz) for k in range(9)]
        if grid[0] > 10**6:  # The sum of a work would saturate.
            elements = [e for e in elements if e["kind"] != "work"]
        program = program_of(elements, **drawn_head(rng, grid))
        contact_N = round(2.5 * grid[1]) * 0.01
        press = press_of(tmp_path, program, judge.Counts(float(TRAVEL), float(FORCE), contact_N))
        oracle = Oracle(program, TRAVEL, FORCE, contact_N)
        for _ in range(10):
            made = drawn_curve(rng, grid, rate_hz)
            judged = judge.judge(press, made, "part")
            wanted = oracle.judged(made, rate_hz)
            expect_equal(judged, wanted, press, rate_hz)
            is_good = judged.record.state == "good"
            if is_good or judged.record.outcome == "by_program":
                assert is_good == all(verdict == "good" for _, verdict, _ in wanted)
            seen |= {
                (e["kind"], verdict) for e, (_, verdict, _) in zip(elements, wanted, strict=True)
            }
            curves += 1
    for kind in ("peak", "valley", "at", "difference", "work", "envelope"):
        assert seen >= {(kind, v) for v in ("good", "below", "above", "not reached", "invalid")}
    assert seen >= {("window", v) for v in ("wrong side", "again", "not reached", "invalid")}
    assert seen >= {("last", v) for v in ("good", "wrong side", "invalid")}


# Curves as a press with a force sensor of 16 bits and a scale records them.

PRESS = {
    "title": "A bush", "zero": "force", "zero_force": 5.0,
    "phase": [
        {"name": "press", "do": "move_by", "distance": 0.02, "speed": 0.02, "force_max": 1200.0,
         "travel_max": 0.05, "time_max": 5.0,
         "end": [{"when": "force_above", "value": 250.0, "next": "hold"}]},
        {"name": "hold", "do": "wait", "force_max": 1200.0, "travel_max": 0.05, "time_max": 5.0,
         "end": [{"when": "time", "value": 0.03, "next": "back"}]},
        {"name": "back", "do": "wait", "force_max": 1200.0, "travel_max": 0.05, "time_max": 5.0,
         "end": [{"when": "force_below", "value": 4.0, "next": "end"}]},
    ],
    "element": [
        {"name": "joining", "kind": "window", "phases": ["press"], "from": 0.001, "to": 0.002,
         "least": 20.0, "most": 80.0, "enters": ["left"], "leaves": ["right"]},
        {"name": "shoulder", "kind": "at", "phases": ["press"], "of": "force", "level": 200.0,
         "least": 0.0028, "most": 0.0032},
        {"name": "slope", "kind": "difference", "phases": ["press"], "level": 0.0005,
         "level_2": 0.0025, "least": 40.0, "most": 70.0},
        {"name": "work", "kind": "work", "phases": ["press"], "from": 0.0, "least": 0.08,
         "most": 0.2},
        {"name": "largest", "kind": "peak", "phases": ["press", "hold"], "most": 600.0},
        {"name": "held", "kind": "valley", "phases": ["hold"], "over": "time", "from": 0.01,
         "least": 240.0},
        {"name": "push", "kind": "work", "phases": ["hold"], "over": "time", "least": 1.0},
        {"name": "band", "kind": "envelope", "phases": ["press"], "from": 0.001, "to": 0.0025,
         "lower_x": [0.0, 0.003], "lower_force": [0.0, 40.0],
         "upper_x": [0.0, 0.003], "upper_force": [60.0, 120.0]},
    ],
}  # fmt: skip


def pressed(rng, rate_hz, shoulder=0.003, friction=25e3, noise_N=0.4):
    """(time, force, position) of a stroke until the shoulder, a hold and the way back."""
    gap, speed = rng.uniform(0.0003, 0.0006), rng.uniform(0.018, 0.022)
    way = np.arange(0, gap + shoulder + 0.0003, speed / rate_hz)
    hold = np.full(int(0.06 * rate_hz), way[-1])
    place = np.concatenate([way, hold, np.linspace(way[-1], -0.0001, len(way) // 2)])
    depth = np.clip(place - gap, 0, None)
    force = friction * depth + 1.0e6 * np.clip(depth - shoulder, 0, None)
    force += np.array([rng.gauss(0, noise_N) for _ in force])
    bits = np.round(force / 0.0305181) * 0.0305181  # No code is between two counts.
    scale = np.round((place + 0.0123) / 0.8e-6) * 0.8e-6
    return np.arange(len(place)) / rate_hz, bits, scale


def labels_of(force_N, rate_hz):
    """The phases of a curve by the conditions of PRESS: the sample that meets one belongs to the
    phase that it ends."""
    counts = np.floor(force_N / 0.01 + 0.5)
    first = int(np.flatnonzero(counts >= 25000)[0])
    second = first + int(np.ceil(0.03 * rate_hz - 1e-6))
    after = np.flatnonzero(counts[second + 1 :] <= 400)
    last = second + 1 + int(after[0])
    labels = np.full(len(force_N), -1)
    labels[: first + 1], labels[first + 1 : second + 1], labels[second + 1 : last + 1] = 0, 1, 2
    return labels


@pytest.mark.parametrize("rate_hz", [500.0, 1000.0, 1500.0, 2000.0])
def test_measured_curves_have_the_values_of_numpy_to_the_last_count(rate_hz, tmp_path):
    """Of 50 curves each. The conditions of the program decide about the phases, or a signal."""
    rng = random.Random(rate_hz)
    press, oracle = press_of(tmp_path, PRESS), Oracle(PRESS, TRAVEL, FORCE)
    seen = set()
    for number in range(50):
        time_s, force, place = pressed(
            rng, rate_hz, rng.uniform(0.0026, 0.0034), rng.uniform(10e3, 40e3)
        )
        labels = labels_of(force, rate_hz)
        others = {"phase": labels} if number % 2 else {}
        made = recording(time_s, force, place, **others)
        judged = judge.judge(press, made, "part")
        assert judged.by_program == (not others)
        wanted = oracle.judged(made, rate_hz, labels)
        expect_equal(judged, wanted, press, rate_hz)
        assert (judged.record.state == "good") == all(verdict == "good" for _, verdict, _ in wanted)
        seen |= {(name, verdict) for name, verdict, _ in wanted}
        counts = np.bincount(labels[labels >= 0]) / rate_hz
        lasted = [span.end_s - span.begin_s + 1 / rate_hz for span in judged.phases]
        assert lasted == pytest.approx(counts.tolist(), abs=1e-6)
    assert seen >= {("shoulder", v) for v in ("good", "below", "above")}
    assert seen >= {("joining", "good"), ("slope", "below"), ("slope", "above"), ("band", "below")}


# Curves of the simulated press have the values that its firmware found.

TRACED = ["cycle_phase", "cycle_state"]
PARTS = [
    ("press_fit", ()), ("press_fit", ("k_bore=80 kN/m",)), ("press_fit", ("force_noise=0.3 N",)),
    ("press_fit", ("k_bore=42 kN/m", "gap=3 mm")), ("spring_test", ()),
    ("spring_test", ("k_coil=17 kN/m",)), ("snap_fit", ()), ("snap_fit", ("seat=2.4 mm",)),
    ("snap_fit", ("k_arm=120 kN/m",)), ("leak_plug", ()), ("leak_plug", ("k_plug=300 kN/m",)),
    ("polishing", ()), ("polishing", ("k_felt=900 kN/m",)),
]  # fmt: skip


def simulated(name, overrides, extra=()):
    """(report of the firmware, recording of the codes) of a simulated part."""
    experiment = EXPERIMENTS / f"{name}.toml"
    text = tomlkit.parse(experiment.read_text())
    text["trace"]["objects"] = [*TRACED, *extra]
    for key in ("model", "cycle"):
        text[key] = str((EXPERIMENTS / text[key]).resolve())
    done = runs.run(experiment, list(overrides), text=tomlkit.dumps(text))
    found = {}
    for column, own in (("adc0", "force"), ("encoder", "position")):
        converter = done.result.converters[column]
        found[own] = (done.columns[column].astype(float) - converter.zero) * converter.per_code
    traced = {column: done.columns[column] for column in TRACED}
    return done.result.cycle, recording(done.time_s, found["force"], found["position"], **traced)


TARED = """
title = "A tare, a table of force and a press that deflects"
compliance_force = ["0 N", "500 N"]
compliance_deflection = ["0 mm", "0.2 mm"]

[[phase]]
name = "tare"
do = "tare"
tare_time = "0.1 s"
force_max = "50 N"
travel_max = "1 mm"
time_max = "1 s"
end = [{ when = "reached", next = "approach" }]

[[phase]]
name = "approach"
do = "approach"
distance = "12 mm"
speed = "20 mm/s"
force_max = "150 N"
travel_max = "13 mm"
time_max = "3 s"
end = [{ when = "contact", next = "press" }]

[[phase]]
name = "press"
do = "follow"
table_x = [0, 1.0, 1.5]
table_force = ["10 N", "120 N", "60 N"]
slope = "200 N/s"
force_max = "150 N"
travel_max = "6 mm"
time_max = "3 s"
end = [{ when = "reached", next = "end" }]
"""
TARED_ELEMENTS = """
[[element]]
name = "depth"
kind = "at"
phases = ["press"]
of = "force"
level = "80 N"

[[element]]
name = "no_load"
kind = "valley"
phases = ["approach"]

[[element]]
name = "impulse"
kind = "work"
phases = ["tare", "approach", "press"]
over = "time"

[[element]]
name = "end"
kind = "last"
phases = ["press"]
"""


def test_a_curve_with_a_tare_has_the_values_that_the_firmware_found(tmp_path):
    """The sensor shows force_tare and noise. The first sample of the cycle is one of the tare."""
    (tmp_path / "tared.toml").write_text(TARED + TARED_ELEMENTS)
    overrides = ("firmware.tare_band=8", "firmware.force_tare=0.4", "force_noise=0.3 N",
                 f"experiment.cycle={tmp_path / 'tared.toml'}")  # fmt: skip
    report, made = simulated("press_fit", overrides)
    tare_N = round(0.4 * 256) * 0.01  # 0.4 force counts, in 1/256 counts of 0.01 N
    made = changed(made, force={"values": made["force"].values - tare_N})
    press = judge.JudgePress(EXPERIMENTS / "press_fit.toml", None, overrides)
    judged = judge.judge(press, made, "part")
    assert report.state == judged.record.state == "good"
    assert [e.value for e in judged.record.elements] == [f.value for f in report.figures]


@pytest.mark.parametrize(("name", "overrides"), PARTS)
def test_a_curve_has_the_values_that_the_firmware_found(name, overrides):
    report, made = simulated(name, overrides)
    press = judge.JudgePress(EXPERIMENTS / f"{name}.toml", None, overrides)
    judged = judge.judge(press, made, "part")
    assert [(e.name, e.verdict) for e in judged.record.elements] == [
        (figure.name, figure.verdict) for figure in report.figures
    ]
    for element, figure in zip(judged.record.elements, report.figures, strict=True):
        if element.value is not None:
            assert element.value == figure.value, element.name
    if report.outcome == "by_program":
        assert judged.record.state == report.state


# Samples that are not valid, ends of curves, and input that is refused.


def bush(shoulder=0.003, rate_hz=1000.0, seed=1, **others):
    """A good part of PRESS."""
    time_s, force, place = pressed(random.Random(seed), rate_hz, shoulder)
    return recording(time_s, force, place, **others)


def verdicts(judged):
    return {element.name: element.verdict for element in judged.record.elements}


@pytest.fixture
def press(tmp_path):
    return press_of(tmp_path, PRESS)


def held_sample(made):
    """The number of a sample in the phase hold."""
    return int(np.flatnonzero(made["force"].values > 250)[0]) + 10


def test_a_good_part_is_good(press):
    assert judge.judge(press, bush(), "part").record.state == "good"


def test_a_missing_sample_makes_the_elements_of_its_phase_invalid_by_name(press):
    made = bush()
    lost = held_sample(made)
    judged = judge.judge(press, without(made, [lost]), "part")
    found = verdicts(judged)
    assert {name for name, verdict in found.items() if verdict == "invalid"} == {
        "largest", "held", "push",
    }  # fmt: skip
    assert (judged.record.state, judged.record.outcome) == ("bad", "samples_invalid")
    assert f"held is invalid: 1 sample missing, from {lost / 1000:g} s on, in phase hold" in (
        judged.record.notes
    )
    assert judged.record.elements[5].value is None


def test_a_missing_sample_may_be_of_the_phase_after_it(tmp_path):
    """Nothing depends on the phase press here, so the firmware alone would call the part good."""
    program = {**PRESS, "element": [e for e in PRESS["element"] if e["phases"] == ["hold"]]}
    made = bush()
    labels = labels_of(made["force"].values, 1000.0)
    made = bush(phase=labels)
    last = int(np.flatnonzero(labels == 0)[-1])
    press = press_of(tmp_path, program)
    for lost, state in ((last, "bad"), (last - 1, "good")):
        judged = judge.judge(press, without(made, [lost]), "part")
        assert (judged.record.state, verdicts(judged)["held"]) == (
            state, "good" if state == "good" else "invalid",
        )  # fmt: skip


def test_a_saturated_stretch_makes_the_elements_of_its_phase_invalid_by_name(press):
    made = bush()
    at = held_sample(made)
    signals = [made["force"], made["position"]]
    for k, name in enumerate(("force", "position")):
        own = list(signals)
        own[k] = replace(made[name], findings=(saturation(at / 1000, (at + 2) / 1000),))
        judged = judge.judge(press, replace(made, signals=tuple(own)), "part")
        assert verdicts(judged)["held"] == "invalid"
        assert "3 samples saturated" in judged.record.notes[0]
        assert verdicts(judged)["shoulder"] == "good"


def test_values_that_are_interpolated_with_a_spike_are_not_valid(press):
    """The position has other times than the force: the two values around its sample rest on it."""
    made = bush()
    position, at = made["position"], held_sample(made)
    time_s = position.time_s - 0.0004
    values = np.interp(time_s, position.time_s, position.values)
    found = SignalFinding("spike", float(time_s[at]), float(time_s[at]), 1, "1 sample")
    own = replace(position, time_s=time_s, values=values, clock="1", findings=(found,))
    judged = judge.judge(press, replace(made, signals=(made["force"], own)), "part")
    assert verdicts(judged)["held"] == "invalid"
    text = f"held is invalid: 2 samples in a spike, from {(at - 1) / 1000:g} s on, in phase hold"
    assert text in judged.record.notes


@pytest.mark.parametrize("value", [1310.72, -1310.72, 5e8, np.nan, np.inf])
def test_a_force_without_a_count_makes_elements_invalid(press, value):
    made = bush()
    values = made["force"].values.copy()
    values[held_sample(made)] = value
    judged = judge.judge(press, replace(made, signals=(
        replace(made["force"], values=values), made["position"])), "part")  # fmt: skip
    assert verdicts(judged)["held"] == "invalid"
    reason = "beyond the end of the range" if np.isfinite(value) else "missing"
    assert reason in judged.record.notes[0]


def test_the_range_of_the_sensor_of_an_axis_bounds_the_valid_forces():
    """The ADC of the press has 16 bits of 0.01 N from 0 on: 655.35 N is its last code."""
    _, made = simulated("press_fit", ())
    press = judge.JudgePress(EXPERIMENTS / "press_fit.toml")
    assert press.at(1500).force_ends == (None, 65535.0)
    values = made["force"].values.copy()
    at = int(np.argmax(values))
    values[at] = 655.34
    for last, verdict in ((655.34, "above"), (655.35, "invalid")):
        values[at] = last
        changed = [replace(s, values=values) if s.name == "force" else s for s in made]
        judged = judge.judge(press, replace(made, signals=tuple(changed)), "part")
        assert verdicts(judged)["seating_force"] == verdict


def test_before_travel_0_a_sample_that_is_not_valid_makes_figures_of_travel_invalid(press):
    """Its true force may have been the one of travel 0."""
    judged = judge.judge(press, without(bush(), [5]), "part")
    found = verdicts(judged)
    assert found["shoulder"] == "invalid"
    assert found["held"] == "good"  # of time
    after_zero = int(np.flatnonzero(bush()["force"].values > 6)[0]) + 3
    found = verdicts(judge.judge(press, without(bush(), [after_zero]), "part"))
    assert (found["shoulder"], found["held"], found["push"]) == ("invalid", "good", "good")


def test_a_sample_outside_of_the_cycle_does_not_matter(press):
    made = bush()
    last = len(made["force"].values) - 3
    assert judge.judge(press, without(made, [last]), "part").record.state == "good"


@pytest.mark.parametrize("has_phases", [False, True])
def test_a_force_that_is_missing_at_an_end_of_the_curve_makes_elements_invalid(press, has_phases):
    """An import leaves out what is no force, such as OVLD."""
    made = bush()
    labels = labels_of(made["force"].values, 1000.0)
    others, phase = ({"phase": labels}, None) if has_phases else ({}, "press")
    made, count = bush(**others), len(labels)
    assert verdicts(judge.judge(press, made, "part", phase=phase))["shoulder"] == "good"
    hold = int(np.flatnonzero(labels == 1)[0])
    judged = judge.judge(press, without(made, range(hold + 4, count), ["force"]), "part",
                         phase=phase)  # fmt: skip
    assert verdicts(judged)["held" if has_phases else "shoulder"] == "invalid"
    assert verdicts(judged)["largest"] == "invalid"
    assert (judged.record.state, judged.is_interpolated) == ("bad", False)
    assert (
        f"from {(hold + 4) / 1000:g} s on, in phase {'hold' if has_phases else 'press'}"
        in (judged.record.notes[-1])
    )
    judged = judge.judge(press, without(made, range(8), ["force"]), "part", phase=phase)
    assert (judged.record.state, verdicts(judged)["shoulder"]) == ("bad", "invalid")
    assert "shoulder is invalid: 8 samples missing, from 0 s on, in phase press" in (
        judged.record.notes
    )
    assert judged.phases[0].begin_s == 0


def test_of_a_trace_the_force_may_be_missing_at_its_ends_too():
    _, made = simulated("press_fit", ())
    press = judge.JudgePress(EXPERIMENTS / "press_fit.toml")
    count = len(made["force"].values)
    largest = int(np.argmax(made["force"].values))
    judged = judge.judge(press, without(made, range(largest, count), ["force"]), "part")
    assert (judged.record.state, verdicts(judged)["seating_force"]) == ("bad", "invalid")
    begin = int(np.flatnonzero(made["cycle_state"].values == 1)[0])
    judged = judge.judge(press, without(made, range(begin + 9), ["force"]), "part")
    assert (judged.record.state, verdicts(judged)["shoulder"]) == ("bad", "invalid")
    judged = judge.judge(press, without(made, range(begin - 2), ["force"]), "part")
    assert judged.record.state == "good"


def test_a_phase_without_any_force_is_known_by_its_signal(press):
    made = bush()
    labels = labels_of(made["force"].values, 1000.0)
    hold = np.flatnonzero(labels == 1)
    judged = judge.judge(press, without(bush(phase=labels), hold, ["force"]), "part")
    assert [span.name for span in judged.phases] == ["press", "hold", "back"]
    assert verdicts(judged)["held"] == "invalid"


def clipped(made, end_N, count):
    """The first samples of a curve, with a force of at most end_N."""
    made = without(made, range(count, len(made["force"].values)))
    return changed(made, force={"values": np.minimum(made["force"].values, end_N)})


def test_a_force_that_is_cut_off_until_an_end_of_the_curve_is_saturated(press):
    made = bush()
    first = int(np.flatnonzero(made["force"].values > 230)[0])
    for count, is_cut in ((first + 2, False), (first + 3, True)):
        own = clipped(made, 230.0, count)
        judged = judge.judge(press, own, "part", phase="press")
        assert (verdicts(judged)["shoulder"] == "invalid") == is_cut
        notes = [note for note in judged.record.notes if "shoulder is invalid: 3 samples s" in note]
        assert len(notes) == is_cut
    known = replace(press, ranges=judge.Ranges(force_N=(-500.0, 500.0)))
    assert verdicts(judge.judge(known, own, "part", phase="press"))["shoulder"] == "good"
    pulled = changed(own, force={"values": -own["force"].values})
    judged = judge.judge(press, pulled, "part", phase="press")
    assert "3 samples saturated" in judged.record.notes[0]
    turned = changed(own, force={"values": own["force"].values[::-1]})
    judged = judge.judge(press, turned, "part", phase="press")
    assert "3 samples saturated, from 0 s on" in judged.record.notes[0]


def test_a_force_at_rest_before_the_contact_is_valid(press):
    made = bush()
    values = made["force"].values.copy()
    for rest_N in (0.0, -3.0):
        values[:9] = rest_N
        values[-9:] = rest_N
        own = changed(made, force={"values": values})
        assert judge.judge(press, own, "part").record.state == "good"


def test_a_delay_loses_no_sample(press):
    """It moves the ends of the force against those of the position."""
    made = bush()
    labels = np.where(np.arange(len(made["force"].values)) < 30, -1, 0)
    made = with_phase(made, labels)
    for name in ("force", "position"):
        own = changed(made, **{name: {"delay_s": 0.003}})
        assert len(curve_samples.times_of(own, "part").number) == len(labels)
        assert curve_samples.times_of(own, "part").periods == len(labels)


def test_positions_with_other_times_are_interpolated_except_over_gaps(press):
    made = bush()
    position = made["position"]
    time_s = np.arange(-1, len(position.values) + 1) / 1000 + 0.0004
    own = np.interp(time_s, position.time_s, position.values)
    shifted = replace(position, time_s=time_s, values=own, clock="1")
    judged = judge.judge(press, replace(made, signals=(made["force"], shifted)), "part")
    assert (judged.record.state, judged.is_interpolated) == ("good", True)
    assert not judge.judge(press, made, "part").is_interpolated
    middle = held_sample(made)
    gap = np.delete(np.arange(len(time_s)), [middle, middle + 1])
    shifted = replace(shifted, time_s=time_s[gap], values=own[gap])
    judged = judge.judge(press, replace(made, signals=(made["force"], shifted)), "part")
    assert verdicts(judged)["held"] == "invalid"


def test_a_delay_of_the_force_is_taken_out(press):
    made = bush()
    late = replace(made["force"], time_s=made["force"].time_s + 0.002, delay_s=0.002)
    judged = judge.judge(press, replace(made, signals=(late, made["position"])), "part")
    plain = judge.judge(press, made, "part")
    assert judged.record.elements == plain.record.elements


def test_a_curve_that_ends_before_the_program_is_aborted(press):
    made = bush()
    cut = held_sample(made) + 5
    judged = judge.judge(press, without(made, range(cut, len(made["force"].values))), "part")
    assert (judged.record.state, judged.record.outcome) == ("aborted", "stopped")
    assert judged.record.phase == "hold"
    judged = judge.judge(press, without(made, [5, *range(cut, len(made["force"].values))]), "part")
    assert (judged.record.state, verdicts(judged)["shoulder"]) == ("aborted", "invalid")
    begin = without(made, range(60, len(made["force"].values)))
    judged = judge.judge(press, begin, "part")
    assert (judged.record.state, verdicts(judged)["held"]) == ("aborted", "aborted")


def test_a_limit_of_a_phase_makes_a_part_bad(tmp_path):
    program = tomlkit.parse(tomlkit.dumps(PRESS))
    program["phase"][0]["travel_max"] = 0.002
    judged = judge.judge(press_of(tmp_path, program), bush(), "part")
    assert (judged.record.state, judged.record.outcome) == ("bad", "over_travel")
    # The phases of a recording are those of its press, whose limits are not those of the program.
    made = bush()
    labelled = bush(phase=labels_of(made["force"].values, 1000.0))
    assert judge.judge(press_of(tmp_path, program), labelled, "part").record.state == "good"


def test_all_samples_may_be_of_one_phase(press):
    judged = judge.judge(press, bush(), "part", phase="press")
    assert [span.name for span in judged.phases] == ["press"]
    assert verdicts(judged)["shoulder"] == "good"
    assert verdicts(judged)["held"] == "not reached"


def test_a_tare_is_measured_in_its_phase(tmp_path):
    phase = dict(PRESS["phase"][0])
    program = {
        **PRESS, "phase": [
            {"name": "tare", "do": "tare", "tare_time": 0.02, "force_max": 50.0,
             "travel_max": 0.001, "time_max": 1.0, "end": [{"when": "reached", "next": "press"}]},
            phase, *PRESS["phase"][1:]],
    }  # fmt: skip
    made = bush()
    still = np.full(30, made["position"].values[0])
    offset_N = 1.37
    time_s = np.arange(30 + len(made["force"].values)) / 1000
    force = np.concatenate([np.full(30, 0.0), made["force"].values]) + offset_N
    labels = np.concatenate([np.zeros(30), labels_of(made["force"].values, 1000.0) + 1])
    labels[labels == 0] = np.where(np.arange((labels == 0).sum()) < 30, 0, -1)
    judged = judge.judge(
        press_of(tmp_path, program),
        recording(time_s, force, np.concatenate([still, made["position"].values]), phase=labels),
        "part",
    )
    wanted = judge.judge(press_of(tmp_path, PRESS), made, "part")
    assert [e.value for e in judged.record.elements] == [e.value for e in wanted.record.elements]
    short = np.where((labels == 0) & (np.arange(len(labels)) < 15), -1, labels)
    judged = judge.judge(
        press_of(tmp_path, program),
        recording(time_s, force, np.concatenate([still, made["position"].values]), phase=short),
        "part",
    )
    assert (judged.record.state, judged.record.outcome) == ("bad", "tare_moving")


def changed(made, **fields):
    return replace(made, signals=tuple(
        replace(s, **fields.get(s.name, {})) for s in made))  # fmt: skip


REFUSED = [
    (lambda m: replace(m, signals=(m["position"],)), "expected a signal force in N, got position"),
    (lambda m: replace(m, signals=(m["force"],)), "expected a signal position in m, got force"),
    (lambda m: changed(m, force={"unit": "V"}), "force: expected the unit N, got 'V'"),
    (lambda m: changed(m, position={"unit": "1"}), "position: expected the unit m, got '1'"),
    (lambda m: changed(m, force={"time_s": m["force"].time_s ** 2 + m["force"].time_s}),
     "expected samples at a constant rate"),
    (lambda m: changed(m, position={"values": 1e6 * m["position"].values}),
     "expected a motion of at most 2147483647 counts, which are 2147.48 m"),
    (lambda m: with_phase(m, 0.5), "phase: expected the number of a phase, an integer, got 0.5"),
    (lambda m: with_phase(m, -1), "expected samples in a phase of the program, got none"),
    (lambda m: with_phase(m, 3), "expected phases from 0 to 2, those of the program, got 3"),
    (lambda m: with_phase(m, np.where(np.arange(len(m["force"].values)) == 9, -1, 0)),
     "samples without a phase from 0.009 s on"),
    (lambda m: replace(m, signals=(*m, signal("cycle_phase", m["force"].time_s, m["force"].values),
                                   signal("cycle_state", m["force"].time_s, m["force"].values))),
     "expected 1500 samples per second, one for each tick of the axis, got 1000"),
    (lambda m: traced_from_the_start(), "begins before the cycle, but the cycle runs in its first"),
]  # fmt: skip


def traced_from_the_start():
    time_s = np.arange(100) / 1500
    return recording(time_s, time_s, time_s, cycle_phase=np.zeros(100), cycle_state=np.ones(100))


def with_phase(made, values):
    whole = np.broadcast_to(values, made["force"].values.shape)
    return replace(made, signals=(*made, signal("phase", made["force"].time_s, whole)))


@pytest.mark.parametrize(("change", "text"), REFUSED)
def test_a_recording_that_is_no_curve_is_refused(press, change, text):
    with pytest.raises(InputError) as found:
        judge.judge(press, change(bush()), "part.npz")
    assert text in str(found.value)
    assert "\n" not in str(found.value)
    assert str(found.value).startswith("part.npz: ")


def test_times_in_a_wrong_unit_are_said_of_the_curve_and_not_of_the_program(press):
    made = bush()
    fast = changed(made, **{name: {"time_s": 1e-9 * made[name].time_s} for name in made.names})
    with pytest.raises(
        InputError, match=r"^part: expected a curve .* got 1e\+12 samples per second"
    ):
        judge.judge(press, fast, "part")


def test_an_error_of_the_program_is_said_of_the_program(tmp_path):
    program = tomlkit.parse(tomlkit.dumps(PRESS))
    program["phase"][0]["end"][0]["next"] = "nowhere"
    with pytest.raises(InputError, match=r"program\.toml: phase\[0\]\.end\[0\]\.next: expected"):
        judge.judge(press_of(tmp_path, program), bush(), "part")


def test_a_phase_that_ends_on_what_a_curve_does_not_show_needs_a_signal_of_the_phases():
    press = judge.JudgePress(EXPERIMENTS / "press_fit.toml")
    with pytest.raises(
        InputError, match=r"the phase approach of .* ends on reached, which a curve"
    ):
        judge.judge(press, bush(), "part")


def test_contact_needs_its_force(tmp_path):
    program = {**PRESS, "zero": "touch"}
    del program["zero_force"]
    press = press_of(tmp_path, program, judge.Counts(1e-6, 0.01))
    with pytest.raises(ParameterError, match="because travel 0 of the program is the first cont"):
        judge.judge(press, bush(), "part")
    assert judge.judge(press_of(tmp_path, program), bush(), "part").record.state == "good"


def test_a_program_alone_needs_counts_and_an_experiment_has_its_own(tmp_path):
    (tmp_path / "p.toml").write_text(tomlkit.dumps(PRESS))
    with pytest.raises(ParameterError, match="is a program alone"):
        judge.JudgePress(tmp_path / "p.toml")
    with pytest.raises(ParameterError, match="expected no size of a count"):
        judge.JudgePress(EXPERIMENTS / "press_fit.toml", COUNTS)
