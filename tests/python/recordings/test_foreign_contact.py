"""examples/foreign_contact.py: a machine that the test makes up stands for one of somebody else."""

import runpy
import sys

import numpy as np
import pytest
from forceaxis import _core, paths

MODEL = """
title = "Machine with an admittance"
[parameters]
approach = { value = 0.1, unit = "m/s", source = "of the experiment" }
gap = { value = 0.02, unit = "m", source = "of the experiment" }
run_up = { value = 0.2, unit = "s", source = "of the experiment", documentation = true }
m_tool = { value = 1.0, unit = "kg", source = "guess" }
m_arm = { value = 8.0, unit = "kg", source = "guess" }
k_wrist = { value = 5e5, unit = "N/m", source = "guess" }
k_part = { value = 2e6, unit = "N/m", source = "guess" }
m_virtual = { value = 20.0, unit = "kg", source = "guess" }
[[body]]
name = "tool"
mass = "m_tool"
position = "-gap"
velocity = "approach"
[[body]]
name = "arm"
mass = "m_arm"
position = "-gap"
velocity = "approach"
[[spring]]
name = "wrist"
between = ["arm", "tool"]
stiffness = "k_wrist"
damping = 120.0
[[contact]]
name = "part"
between = ["tool", "ground"]
stiffness = "k_part"
damping = 80.0
[drive]
type = "first_order"
body = "arm"
k_act = 600.0
a_act = 200.0
velocity_per_volt = 0.1
[machine_controller]
law = "admittance"
signal = "part.force"
setpoint = 100.0
speed_max = "approach"
mass = "m_virtual"
damping = 10.0
"""
TRUE = {"m_tool": 1.2, "m_arm": 7.0, "k_wrist": 7e5, "k_part": 1.6e6, "m_virtual": 30.0}
PHASES, EVERY, TICK_S = 5, 6, 1 / 1500  # 7500 Hz, of which every sixth sample is recorded: 1250 Hz


def truth(model, speed):
    """Time after the contact in s, force in N at 7500 Hz."""
    ticks = 2400
    force = np.empty((ticks, PHASES))
    for phase in range(PHASES):
        gap = speed * (0.2 + TICK_S * (PHASES - 1 - phase) / PHASES)
        plant = _core.Plant(str(model), {**TRUE, "approach": speed, "gap": gap})
        force[:, phase] = plant.follow(np.zeros(ticks), False, ["part.force"])[1][:, 0]
    force = force.ravel()
    first = int(np.argmax(force > 0))
    return (np.arange(force.size) - first) * TICK_S / PHASES, force


def record(path, time_s, force, rng):
    samples = slice(int(rng.integers(EVERY)), None, EVERY)
    values = force[samples] + 0.1 * rng.normal(size=len(force[samples]))
    np.savetxt(path, np.column_stack([time_s[samples] + 7, values]), "%.5f", ",",
               header="t_s,F_N", comments="")  # fmt: skip


def run(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["foreign_contact.py", *map(str, words)])
    runpy.run_path(str(paths.ROOT / "examples/foreign_contact.py"), run_name="__main__")


def figures(lines, title):
    """{figure: {column: value}} of the table after a line that begins with `title`."""
    first = next(i for i, line in enumerate(lines) if line.startswith(title)) + 1
    names = lines[first].split()[2:]
    rows = [line.split() for line in lines[first + 1 : first + 5]]
    return {row[0]: dict(zip(names, row[-len(names) :], strict=True)) for row in rows}


def test_a_fit_of_one_contact_predicts_a_faster_one(tmp_path, monkeypatch, capsys):
    model, rng = tmp_path / "machine.toml", np.random.default_rng(3)
    model.write_text(MODEL)
    contacts = {speed: truth(model, speed) for speed in (0.1, 0.25)}
    for speed, (time_s, force) in contacts.items():
        record(tmp_path / f"{speed}.csv", time_s, force, rng)
    run(monkeypatch, model, tmp_path / "0.1.csv", "--signal", "part.force", "--speed", 0.1,
        "--predict", 0.25, "--against", tmp_path / "0.25.csv", "--evaluated", 1.2, "--starts", 1,
        "--out", tmp_path / "out.png")  # fmt: skip
    lines = capsys.readouterr().out.splitlines()
    assert (tmp_path / "out.png").exists()
    assert lines[-2:] == [
        "lacks        nothing in these figures",
        "wrong        no predicted figure",
    ]
    for title, speed in (("residual", 0.1), ("prediction", 0.25)):
        time_s, force = contacts[speed]
        begin = (time_s >= 0) & (time_s <= 0.025)
        lost_s = time_s[(time_s > 0) & (force <= 0)][0]
        found = figures(lines, title)
        impulse = np.trapezoid(force[begin], time_s[begin])
        # The low pass moves the instants of contact by 1 to 2 ms.
        assert float(found["impulse"]["model"]) == pytest.approx(impulse, rel=0.05)
        assert float(found["first"]["model"]) == pytest.approx(1e3 * lost_s, abs=4)
        assert float(found["impulse"]["measured"]) == pytest.approx(
            float(found["impulse"]["model"]), rel=0.02
        )
        assert float(found["peak"]["low"]) < force.max() * 1.001
        assert float(found["peak"]["high"]) == pytest.approx(force.max(), rel=0.03)


def csv(force):
    """Text of a CSV file with a force at 1 kHz."""
    return "t_s,F_N\n" + "".join(f"{k / 1000},{f}\n" for k, f in enumerate(force))


WRONG = {
    "no such column": ("t_s,force\n" + "0,1\n" * 20, "F_N"),
    "no contact": (csv([0.0] * 50), "expected a force that is positive in"),
    "a gap": (csv([0.0] * 60 + [50.0] * 40).replace("0.09", "1.09"), "equally spaced"),
    "no number": (csv([0.0] * 60 + ["x"] * 4), "line 62, F_N: expected a number"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_recording_is_refused_in_one_line(tmp_path, monkeypatch, capsys, case):
    text, says = WRONG[case]
    (tmp_path / "touch.csv").write_text(text)
    (tmp_path / "machine.toml").write_text(MODEL)
    with pytest.raises(SystemExit) as ended:
        run(monkeypatch, tmp_path / "machine.toml", tmp_path / "touch.csv", "--speed", 0.1,
            "--predict", 0.25, "--signal", "part.force", "--out", tmp_path / "out.png")  # fmt: skip
    said = capsys.readouterr()
    assert ended.value.code == 2 and says in said.err and said.err.count("\n") == 1
    assert not said.out and not (tmp_path / "out.png").exists()


@pytest.mark.parametrize("name", ["robot_force_mode", "contact_flange"])
def test_the_models_beside_the_example_make_contact(name):
    plant = _core.Plant(str(paths.ROOT / f"examples/{name}.toml"))
    force = plant.follow(np.zeros(3000), False, ["sensor.force"])[1]
    assert force.max() > 100


def signals_of(tmp_path, name, structure, signals, **values):
    """Signals of a model beside the example with a structure, (n, signals)."""
    example = runpy.run_path(str(paths.ROOT / "examples/foreign_contact.py"), run_name="example")
    model = paths.ROOT / f"examples/{name}.toml"
    made = example["with_structures"](model, [structure] if structure else [], tmp_path)
    plant = _core.Plant(str(made), values)
    return plant.follow(np.zeros(3000), False, signals)[1]


def test_each_structure_acts_as_its_name_says(tmp_path):
    robot, flange = "robot_force_mode", "contact_flange"
    free = np.abs(signals_of(tmp_path, robot, None, ["drive.force"]))
    assert free.max() > 150
    held = np.abs(signals_of(tmp_path, robot, "limits", ["drive.force"], f_limit=120.0))
    assert held.max() == pytest.approx(120.0, rel=1e-9)
    way = signals_of(tmp_path, flange, "path-end", ["flange.position", "end.force"], stroke=20e-6)
    assert way[:, 1].max() > 10 and way[way[:, 0] < 20e-6, 1].max() == 0
    for name, link in ((robot, "joints"), (flange, "mount")):
        found = signals_of(
            tmp_path, name, "dead-zone", [f"{link}.deflection", f"{link}.force"], play=60e-6
        )
        inside = np.abs(found[:, 0]) < 30e-6
        assert inside.sum() > 20 and np.abs(found[inside, 1]).max() == 0
        assert np.abs(found[~inside, 1]).max() > 10


def test_a_structure_that_the_model_cannot_have_is_one_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "touch.csv").write_text(csv([0.0] * 60 + [50.0] * 40))
    with pytest.raises(SystemExit) as ended:
        run(monkeypatch, paths.ROOT / "examples/contact_flange.toml", tmp_path / "touch.csv",
            "--speed", 0.1, "--predict", 0.25, "--structure", "limits")  # fmt: skip
    said = capsys.readouterr()
    assert ended.value.code == 2 and "--structure limits: expected" in said.err
    assert said.err.count("\n") == 1
