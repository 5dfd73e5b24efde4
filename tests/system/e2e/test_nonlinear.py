"""The elements of 2.7 in runs, and the statements of 2.7 about contact and friction."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from forceaxis.experiments import run as runs
from forceaxis.thesis import nonlinear

ROOT = Path(__file__).resolve().parents[3]
EXPERIMENTS = ROOT / "sim/experiments"


# Experiments in which something saturates below the demanded force: calm, but short of it.
CALM_BUT_SHORT = [f"nl_saturation_{what}" for what in ("actuator", "conditioning", "sensor")]


def columns(name, *overrides):
    return runs.run(EXPERIMENTS / f"{name}.toml", overrides).columns


def at(trace, column, time_s):
    """The trace's last value before a time."""
    return trace[column][np.searchsorted(trace["time_s"], time_s) - 1]


def newtons(codes):
    """Stall force of the simple actuator for a DAC code."""
    return codes * 20 / 4096 * 0.0963 * 9500


def test_every_verdict_is_its_text():
    paths = sorted(EXPERIMENTS.glob("nl_*.toml"))
    assert len(paths) >= 20
    for path in paths:
        text = tomllib.loads(path.read_text())
        assert text["shows"]
        run = runs.run(path)
        assert run.summary["fault"] == "none"
        if "verdict" in text:
            expected = "unstable" if path.stem.endswith("_unstable") else "stable"
            if path.stem in CALM_BUT_SHORT:
                expected = "not_met"
            assert run.summary["verdict"] == expected, path.stem


def test_above_the_linear_limit_every_run_cycles_and_below_it_some_starts_do():
    light, printed, friction = nonlinear.contact_maps(2)
    gains = np.array(nonlinear.GAINS)
    assert light.cycles[gains > 1].all()
    below = light.cycles[gains < 1]
    assert (below.any(axis=1) & ~below.all(axis=1)).sum() >= 2  # one gain, two outcomes
    assert not below[gains[gains < 1] < 0.8].any()
    # With the printed damping the linear limit decides; friction moves it up, whatever the start.
    assert (printed.cycles == (gains > 1)[:, None]).all()
    assert (friction.cycles <= printed.cycles).all()
    assert not friction.cycles[gains <= 1.12].any()
    assert friction.cycles[gains >= 1.5].all()


def test_coulomb_friction_widens_the_stable_region():
    forces, limits = np.transpose(nonlinear.friction_limits(2))
    assert limits[0] == 0.96  # the last step below the linear limit
    assert (np.diff(limits) > 0).all()
    assert limits[forces == 5] >= 1.16


def test_stiction_sticks_and_slips_for_ever_and_coulomb_friction_slides():
    run = runs.run(EXPERIMENTS / "nl_stick_slip.toml")
    loose = [t for t, name, old, new in run.events if (name, old) == ("rail", "stuck")]
    periods = np.diff(loose)[2:]
    assert len(periods) > 10
    assert np.ptp(periods) < 1e-6 * periods[0]
    trace = run.columns
    late = trace["time_s"] > 1
    assert trace["rail.force"][late].max() == pytest.approx(15, abs=0.1)
    assert np.mean(trace["load.velocity"][late] == 0) > 0.5
    slide = columns("nl_stick_slip_none")
    late = slide["time_s"] > 2
    assert np.ptp(slide["load.velocity"][late]) < 1e-5
    assert slide["load.velocity"][-1] > 1e-3


def test_backlash_is_lost_at_the_turn():
    trace = columns("nl_backlash")
    motor, load = (at(trace, f"{b}.position", 1.5) - at(trace, f"{b}.position", 3) for b in
                   ("robot", "tip"))  # fmt: skip
    assert motor - load == pytest.approx(0.001, abs=3e-5)


def test_load_dependent_compliance():
    trace = columns("nl_load_compliance")
    for time_s in (1, 2, 3, 4):
        force = at(trace, "pad.spring_force", time_s)
        expected = min(force, 20) / 25e3 + min(max(force - 20, 0), 40) / 120e3
        expected += max(force - 60, 0) / 1e6
        assert at(trace, "pad.deflection", time_s) == pytest.approx(expected, rel=1e-9)


def test_drag_grows_with_speed():
    trace = columns("nl_viscous")
    assert at(trace, "robot.velocity", 2) == pytest.approx(20 / 500, rel=1e-3)
    # 80 N = 500 x 0.05 + 2000 (v - 0.05)
    assert at(trace, "robot.velocity", 4) == pytest.approx(0.0775, rel=1e-6)


def test_stops_hold():
    trace = columns("nl_stop")
    assert at(trace, "robot.position", 2.5) == pytest.approx(0.02 + 40e-6, abs=1e-6)
    assert at(trace, "robot.position", 5) == pytest.approx(-0.02 - 40e-6, abs=1e-6)


def test_gravity_grows_along_the_travel():
    trace = columns("nl_gravity")
    for time_s, wanted in ((2, 3000), (4, 6000)):
        error = wanted - at(trace, "encoder", time_s)
        load = 132.4 * 3 * at(trace, "robot.position", time_s) / 0.05
        assert newtons(error) == pytest.approx(load, abs=newtons(1))


def test_saturations():
    # Reading 60 N = 24 of 40 counts: gain 10 keeps commanding 160 codes.
    for name in ("sensor", "conditioning"):
        trace = columns(f"nl_saturation_{name}")
        assert trace["adc0"].max() == 6144
        assert trace["sensor.force"][-1] == pytest.approx(newtons(160), rel=0.01)
    assert columns("nl_saturation")["sensor.force"][-1] == pytest.approx(94.7, abs=0.3)
    actuator = columns("nl_saturation_actuator")
    assert np.abs(actuator["drive.force"]).max() == pytest.approx(60)
    assert actuator["sensor.force"][-1] == pytest.approx(60, abs=6)
    dac = columns("nl_saturation_controller_unstable")["dac"][-750:]
    assert set(np.unique(dac)) >= {-2048, 2047}


@pytest.mark.parametrize("name", CALM_BUT_SHORT[1:])
def test_a_force_beyond_what_the_sensor_gives_is_not_met_without_any_limit_of_the_error(name):
    """The converter reads 640 N, sensor or electronics end at 60 N: 100 N cannot be controlled."""
    path = EXPERIMENTS / f"{name}.toml"
    text = path.read_text()
    limit = "held_force_error_max_percent = 10.0\n"
    assert limit in text
    result = runs.run(path, text=text.replace(limit, "")).result
    assert result.verdict == "not_met"
    missed = {one.limit: one for one in result.missed}
    assert missed.keys() == {"reading_range", "setpoint_range"}
    assert missed["setpoint_range"].bound == pytest.approx(60) and missed["reading_range"].value > 0
    assert any("range (0 to 60 N)" in reason for reason in result.because)


def test_noise_is_the_seeds():
    quiet, noisy = columns("nl_noise_none"), columns("nl_noise")
    late = quiet["time_s"] > 2
    assert np.ptp(quiet["adc0"][late]) <= 1
    jitter = noisy["adc0"] - noisy["sensor.spring_force"] / 2.5
    assert np.std(jitter) == pytest.approx(np.hypot(1, 1 / np.sqrt(12)), rel=0.05)
    assert (columns("nl_noise")["adc0"] == noisy["adc0"]).all()
    assert (columns("nl_noise", "experiment.seed=3")["adc0"] != noisy["adc0"]).any()


def test_velocity_sensing_force_sensor_and_accelerometers():
    trace = columns("nl_sensors")
    rate = np.floor(trace["sensor.spring_force_rate"] / 2 + 0.5) + 32768
    assert (trace["adc1"] == rate).all()
    held = trace["time_s"] > 0.2
    rates = np.gradient(trace["sensor.spring_force"], trace["time_s"])
    assert rates[held] == pytest.approx(trace["sensor.spring_force_rate"][held], abs=20)
    for body in ("robot", "tip"):
        slope = np.gradient(trace[f"{body}.velocity"], trace["time_s"])[held]
        assert slope == pytest.approx(trace[f"{body}.acceleration"][held], abs=0.05)


def test_stiction_cycles_in_the_force_loop_where_friction_alone_settles():
    file = EXPERIMENTS / "nl_stiction_unstable.toml"
    sticking = runs.run(file)
    assert sticking.summary["verdict"] == "unstable"
    # It goes on: the last second has the ripple of the five before, and both ends are stuck.
    force = sticking.columns["sensor.force"]
    assert np.ptp(force[-1500:]) == pytest.approx(np.ptp(force[-9000:-1500]), rel=1e-3)
    assert np.ptp(force[-1500:]) > 40
    pulls = np.abs(sticking.columns["rail.force"][-1500:])
    assert 55 < pulls.max() <= 60
    assert runs.run(file, ["stiction=20"]).summary["verdict"] == "stable"
