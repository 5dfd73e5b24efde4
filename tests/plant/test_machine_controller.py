"""A controller of the machine in place of the firmware: its commands are those of its documented
law, written here once more from the documentation, and the plant between them is exact."""

import math

import numpy as np
import pytest
from forceaxis import _core
from forceaxis._core import InputError

TICK_S = 1 / 1500
MODEL = """
[[body]]
name = "tool"
mass = 4.0
position = -0.002
[[damper]]
name = "guide"
between = ["tool", "ground"]
damping = 30.0
[[contact]]
name = "part"
between = ["tool", "ground"]
stiffness = 60e3
damping = 40.0
[drive]
body = "tool"
"""
VELOCITY = 'type = "first_order"\nk_act = 20e3\na_act = 600.0\nvelocity_per_volt = 0.02\n'
FORCE = 'type = "perfect"\nforce_per_volt = -8.0\n'
SENSED = 'signal = "part.force"\nsetpoint = 50.0\nspeed_max = 0.1\n'


def model_of(tmp_path, drive, controller):
    path = tmp_path / "machine.toml"
    path.write_text(MODEL + drive + "[machine_controller]\n" + controller)
    return path


def run(path, ticks, names=("drive.command", "tool.position", "part.force")):
    plant = _core.Plant(str(path))
    _, signals = plant.follow(np.full(ticks, 2000.0), False, list(names))
    return dict(zip(names, signals.T, strict=True))


def replay(tmp_path, drive, law, ticks):
    """The same plant without a controller, fed with law(tick, force) in V."""
    path = tmp_path / "plain.toml"
    path.write_text(MODEL + drive)
    plant = _core.Plant(str(path))
    seen = []
    for tick in range(ticks):
        force = plant.signal("part.force")
        seen.append((plant.signal("tool.position"), force))
        plant.step_volts(law(tick, force))
    return np.array(seen).T


class Law:
    """A law of the documentation, of exact steps for a force that is constant in a cycle."""

    def __init__(
        self, kind, mass=8.0, damping=400.0, integral_s=None, filter_=None, delay=0, cycle=1
    ):
        self.kind, self.mass, self.damping, self.integral_s = kind, mass, damping, integral_s
        self.filter, self.delay, self.cycle = filter_, delay, cycle
        self.low, self.speed, self.q, self.past = None, 0.0, 0.0, []

    def __call__(self, tick, force):
        if self.low is None or self.filter is None:
            self.low = force
        else:
            self.low += (1 - math.exp(-self.filter * TICK_S)) * (force - self.low)
        self.past.append(self.low)
        measured = self.past[max(0, tick - self.delay)]
        if tick % self.cycle == 0:
            self.move(50.0 - measured, self.cycle * TICK_S)
        return self.speed / 0.02

    def move(self, f, step_s):
        if self.kind == "admittance" and self.damping:
            decay = math.exp(-self.damping / self.mass * step_s)
            self.speed = decay * self.speed + (1 - decay) * f / self.damping
        elif self.kind == "admittance":
            self.speed += f / self.mass * step_s
        else:
            grown = self.q + (
                f * step_s / (self.damping * self.integral_s) if self.integral_s else 0
            )
            wanted = f / self.damping + grown
            if abs(wanted) <= 0.1 or (abs(wanted) > 0.1 and (grown - self.q) * wanted < 0):
                self.q = grown
            self.speed = wanted
        self.speed = min(max(self.speed, -0.1), 0.1)


CASES = {
    "admittance": ('law = "admittance"\nmass = 8.0\ndamping = 400.0\n', {}),
    "admittance without damping": (
        'law = "admittance"\nmass = 30.0\n',
        {"mass": 30.0, "damping": 0},
    ),
    "PI, late, filtered, every third tick": (
        'law = "force_pi"\ndamping = 2000.0\nintegral_time = 0.05\nfilter = 500.0\n'
        "delay_ticks = 4\ncycle_ticks = 3\n",
        {"damping": 2000.0, "integral_s": 0.05, "filter_": 500.0, "delay": 4, "cycle": 3},
    ),
    "P": ('law = "force_pi"\ndamping = 900.0\n', {"damping": 900.0}),
}


@pytest.mark.parametrize("case", CASES)
def test_a_controller_follows_its_documented_law(tmp_path, case):
    text, values = CASES[case]
    found = run(model_of(tmp_path, VELOCITY, text + SENSED), 900)
    kind = "admittance" if case.startswith("admittance") else "force_pi"
    position, force = replay(tmp_path, VELOCITY, Law(kind, **values), 900)
    assert force.max() > 40  # it has made contact
    np.testing.assert_allclose(found["tool.position"], position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["part.force"], force, rtol=0, atol=1e-6)


def test_an_admittance_approaches_with_its_largest_speed_and_holds_its_set_point(tmp_path):
    text = 'law = "admittance"\nmass = 8.0\ndamping = 400.0\n' + SENSED
    found = run(model_of(tmp_path, VELOCITY, text), 6000)
    speed = found["drive.command"] * 0.02
    # f / damping is 0.125 m/s, more than speed_max: v = 0.125 (1 - e^(-50 t)) up to 0.1 m/s.
    expected = 0.125 * (1 - np.exp(-50 * TICK_S * np.arange(1, 11)))
    np.testing.assert_allclose(speed[1:11], expected, rtol=1e-12)
    assert speed.max() == pytest.approx(0.1)
    # At rest the drive needs the command F / k_act for its force F, so F + 400 F / 20e3 = 50.
    assert found["part.force"][-1] == pytest.approx(50 / 1.02, rel=1e-6)


def test_a_table_of_forces_moves_a_mass_exactly(tmp_path):
    """Held values: the force changes at the first tick at or after its time. Without damping the
    way to the contact is a sum of parabolas."""
    text = 'law = "table"\ntimes = [0.0, 0.1, 0.2001]\nforces = [2.0, -3.0, 1.0]\n'
    path = model_of(tmp_path, FORCE, text)
    path.write_text(path.read_text().replace("damping = 30.0", "damping = 1e-12"))
    found = run(path, 400, ("tool.position", "drive.force"))
    force = np.where(np.arange(400) < 150, 2.0, np.where(np.arange(400) < 301, -3.0, 1.0))
    v = np.concatenate([[0], np.cumsum(force) * TICK_S / 4])[:-1]
    x = -0.002 + np.concatenate([[0], np.cumsum(v * TICK_S + force * TICK_S**2 / 8)])[:-1]
    before = int(np.flatnonzero(x > 0)[0])  # the first contact
    assert before > 100
    np.testing.assert_allclose(found["tool.position"][:before], x[:before], atol=1e-15)
    np.testing.assert_allclose(found["drive.force"][1:], force[:-1], rtol=1e-15)


def test_a_table_may_be_interpolated_at_the_ticks(tmp_path):
    text = 'law = "table"\ntimes = [0.01, 0.03]\nspeeds = [0.0, 0.02]\ninterpolated = true\n'
    found = run(model_of(tmp_path, VELOCITY, text), 61, ("drive.command",))
    expected = np.interp(np.arange(60) * TICK_S, [0.01, 0.03], [0, 0.02]) / 0.02
    np.testing.assert_allclose(found["drive.command"][1:], expected, atol=1e-12)


WRONG = {
    "a force for a drive that follows a velocity": (
        VELOCITY, 'law = "table"\ntimes = [0, 1]\nforces = [0, 1]\n',
        r"machine_controller\.law: expected a drive that follows a force"),
    "a law of velocity for a force source": (
        FORCE, 'law = "force_pi"\ndamping = 1.0\n' + SENSED,
        r"expected a drive that follows a velocity"),
    "speeds and forces": (VELOCITY, 'law = "table"\ntimes = [0, 1]\nforces = [0, 1]\nspeeds = 0',
                          r"expected speeds or forces, got both keys"),
    "one time": (VELOCITY, 'law = "table"\ntimes = 0\nspeeds = 0', r"expected at least two times"),
    "two lengths": (VELOCITY, 'law = "table"\ntimes = [0, 1]\nspeeds = [0, 1, 2]',
                    r"speeds: expected 2 values"),
    "no force": (VELOCITY, 'law = "force_pi"\ndamping = 1.0\nsetpoint = 1.0\nspeed_max = 1.0\n'
                 'signal = "tool.position"', r"signal: expected a force in N"),
    "a bus": (VELOCITY + "cycle_ticks = 3\n", 'law = "table"\ntimes = [0, 1]\nspeeds = [0, 1]',
              r"expected a drive without bus"),
    "no damping": (VELOCITY, 'law = "force_pi"\n' + SENSED, r"damping"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_controller_is_refused(tmp_path, case):
    drive, controller, message = WRONG[case]
    with pytest.raises(InputError, match=message):
        _core.Plant(str(model_of(tmp_path, drive, controller)))


def test_an_experiment_selects_no_mode_beside_the_controller(tmp_path):
    model_of(tmp_path, VELOCITY, 'law = "admittance"\nmass = 8.0\ndamping = 400.0\n' + SENSED)
    text = 'title = "Robot"\nmodel = "machine.toml"\nduration_s = 2.0\n[verdict]\n'
    text += "peak_force_max_N = 400.0\n"
    done = _core.run(str(tmp_path / "robot.toml"), text=text)
    assert done.verdict == "stable"
    assert done.metrics.final_force_N == pytest.approx(50 / 1.02, rel=1e-3)
    assert not done.columns()["dac"].any()  # the firmware is idle
    with pytest.raises(InputError, match=r"firmware: expected no mode of operation"):
        _core.run(str(tmp_path / "robot.toml"), text=text + '[firmware]\nmode = "force"\n')
