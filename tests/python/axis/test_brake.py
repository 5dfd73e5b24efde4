"""A vertical axis with a brake, its firmware in the loop: held from the start, released by the
firmware's output, sagging until the brake holds again. The plant alone: tests/plant/brake_test.cpp.
"""

import json
import tomllib

import numpy as np
import pytest
from forceaxis import linear
from forceaxis.axis.axis import Axis
from forceaxis.axis.sim import SimLink
from forceaxis.experiments import run as runs
from test_axis import forceaxis, said

G = 9.81
# A force source that balances nothing while it is off: the brake and the weight alone decide.
MODEL = """
title = "A mass on a vertical guide"
[parameters]
m = { value = 4, unit = "kg" }
tau = { value = "20 ms", unit = "s" }
k_act = { value = "m / tau", unit = "N s/m", source = "time constant of the data sheet" }
stator = { value = 3, unit = "kg", documentation = true }
[[body]]
name = "axis"
mass = "m"
[[gravity]]
name = "weight"
body = "axis"
acceleration = -9.81
%s
[drive]
type = "first_order"
body = "axis"
k_act = "k_act"
a_act = 600
velocity_per_volt = 0.02
[encoder]
body = "axis"
scale = 1e6
"""
BRAKE = """
[[brake]]
name = "brake"
between = ["axis", "ground"]
holding = 100
release = 0.05
engage = "31.1 ms"
"""
EXPERIMENT = """
title = "Enabled for half a second"
model = "model.toml"
duration_s = 1.2
[firmware]
position_gain = 2
[[at]]
time_s = 0.1
firmware = { mode = "position", position_setpoint = 0 }
[[at]]
time_s = 0.6
firmware = { mode = "disabled" }
"""


@pytest.fixture
def vertical(tmp_path):
    (tmp_path / "model.toml").write_text(MODEL % BRAKE)
    (tmp_path / "vertical.toml").write_text(EXPERIMENT)
    return tmp_path / "vertical.toml"


def test_the_firmware_releases_it_and_the_axis_sags_until_it_holds(vertical):
    done = runs.run(vertical)
    time_s, place = done.columns["time_s"], done.columns["axis.position"]
    assert not place[time_s < 0.15].any()  # held, and then not yet released
    events = [(at, after) for at, element, _, after in done.events if element == "brake"]
    on, off = (round(t * 1500) / 1500 for t in (0.1, 0.6))
    assert [after for _, after in events][:2] == ["released", "backward"]
    assert events[0][0] == pytest.approx(on + 0.05, abs=1e-12)
    held = off + 0.0311
    assert events[1][0] == pytest.approx(held, abs=1e-12)
    assert events[-1][1] == "stuck"
    # From the last tick before: g t^2 / 2 on what it moved with, until the brake holds.
    k = int(off * 1500 + 0.5)
    assert (done.columns["out"][k - 1], done.columns["out"][k]) == (3, 0)  # amplifier, brake
    velocity, t = done.columns["axis.velocity"][k], 0.0311
    falling = place[k] + velocity * t - G * t * t / 2
    speed = G * t - velocity
    stop = falling - speed**2 / (2 * (100 / 4 - G))
    assert place[-1] == pytest.approx(stop, abs=1e-12)
    # 4.8 mm while nothing holds and as much again as the brake needs.
    assert place[k] - place[-1] == pytest.approx(G * t * t / 2 * 25 / (25 - G), abs=2e-4)


def test_a_live_axis_does_not_fall_while_it_is_disabled(vertical):
    with Axis(SimLink(vertical)) as axis:
        axis.link.wait(2.0)
        assert axis.read("position") == 0
        axis.enable("profile position")
        axis.link.wait(0.5)
        axis.off()
        axis.link.wait(1.0)
        place = axis.read("position")
        assert -11_000 < place < -5_000  # um
        axis.link.wait(1.0)
        assert axis.read("position") == place


def test_a_disabled_axis_is_held_until_its_brake_holds(vertical):
    """47 ticks are 31.3 ms. A code is 20 V / 4096, at which the drive pushes with k_act times its
    speed."""
    model = vertical.parent / "model.toml"
    model.write_text(
        model.read_text().replace("velocity_per_volt = 0.02", "velocity_per_volt = 0.2")
    )
    codes = 4 * G / (4 / 0.02 * 0.2 * 20 / 4096)
    overrides = [f"firmware.{text}" for text in ("brake_engage_ticks=47", "position_gain=0.2")]
    overrides.append(f"firmware.output_bias={codes}")
    done = runs.run(vertical, overrides)
    place, out = (done.columns[name] for name in ("axis.position", "out"))
    assert np.ptp(place) < 1e-5
    k = int(0.6 * 1500 + 0.5)
    assert list(out[k : k + 47]) == [1] * 47 and out[k + 47] == 0  # the amplifier, no brake
    # With nine tenths of the weight, a tenth of it falls, against the damping of the drive.
    overrides[-1] = f"firmware.output_bias={0.9 * codes}"
    done = runs.run(vertical, overrides)
    place, velocity = done.columns["axis.position"], done.columns["axis.velocity"]
    t, a, tau = 0.0311, 0.1 * G, 0.02
    speed = a * tau * (1 - np.exp(-t / tau))
    falls = tau * (a * t - speed) + speed**2 / (2 * (100 / 4 - G))
    assert abs(velocity[k]) < 1e-3
    assert place[k] - place[-1] == pytest.approx(falls, rel=0.08)


def test_an_analysis_has_it_released(vertical):
    """Poles as without a brake, and stuck where that is asked for."""
    model = vertical.parent / "model.toml"
    bare = vertical.parent / "bare.toml"
    bare.write_text(MODEL % "")
    poles = linear.linearise(str(model), outputs=("axis.velocity",)).poles()
    assert np.allclose(np.sort(poles), np.sort(linear.linearise(
        str(bare), outputs=("axis.velocity",)).poles()))  # fmt: skip
    stuck = linear.linearise(
        str(model), outputs=("axis.velocity",), modes={"brake": "stuck"}
    ).response(1.0)
    assert abs(stuck) < 1e-15


def test_it_is_the_same_over_a_link(vertical):
    """The outputs travel as they are."""
    alone = runs.run(vertical, ["experiment.duration_s=0.7"]).summary["trace_hash"]
    done = forceaxis(
        "run", vertical, "--set", "experiment.duration_s=0.7", "--link", "lcm", "--json"
    )
    assert json.loads(said(done))["trace_hash"] == alone


@pytest.mark.parametrize("deg", [90, -90])
def test_new_writes_the_brake_of_a_vertical_axis(tmp_path, deg):
    done = forceaxis(
        "new", "mine", "--yes", "--no-design", "--inclination-deg", deg, "--guide-coulomb-n", "5",
        "--workpiece-stiffness-n-per-m", "4e5", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    model = tomllib.loads((tmp_path / "mine/model.toml").read_text())
    p = {name: entry["value"] for name, entry in model["parameters"].items()}
    # 10 kg have a weight, the rotor has none: 5e-5 kg m^2 at 10 mm a turn is 19.74 kg.
    weight = -np.sign(deg) * G * 10
    assert p["g_axis"] * p["m_axis"] == pytest.approx(weight, rel=1e-6)
    assert p["brake_holding"] == pytest.approx(2 * abs(weight))
    assert (p["brake_release"], p["brake_engage"]) == (0.05, 0.03)
    link = SimLink(tmp_path / "mine/contact.toml")
    start = link.read(["position"])["position"]
    link.wait(1.0)
    assert link.read(["position"])["position"] == start
    assert link.read(["brake_engage_ticks"])["brake_engage_ticks"] == 45  # 30 ms
    for experiment in ("contact.toml", "step.toml"):
        assert runs.run(tmp_path / "mine" / experiment).summary["verdict"] == "stable"


def test_new_without_a_brake_falls_and_says_where_it_may_not_be_given(tmp_path):
    made = forceaxis(
        "new", "mine", "--yes", "--no-design", "--inclination-deg", "-90", "--brake-holding-n",
        "none", cwd=tmp_path,
    )  # fmt: skip
    assert made.returncode == 0 and "[[brake]]" not in (tmp_path / "mine/model.toml").read_text()
    link = SimLink(tmp_path / "mine/contact.toml")
    start = link.read(["position"])["position"]
    link.wait(0.05)
    assert link.read(["position"])["position"] > start
    done = forceaxis("new", "other", "--brake-holding-n", "5", "--yes", cwd=tmp_path)
    assert done.returncode == 2 and "--inclination-deg" in done.stderr


def test_a_parameter_that_is_a_quotient_follows_what_is_set(vertical):
    model = str(vertical.parent / "model.toml")
    assert linear.facts(model).parameters["k_act"] == (4 / 0.02, "N s/m")
    assert linear.facts(model, {"tau": "40 ms"}).parameters["k_act"] == (4 / 0.04, "N s/m")
    assert linear.facts(model, {"k_act": "2 * m / tau"}).parameters["k_act"][0] == 400
    found = json.loads(said(forceaxis("run", vertical, "--set", "m=6", "--json")))
    assert found["verdict"] is None
    done = forceaxis("run", vertical, "--set", "k_act=m * tau")
    assert done.returncode == 2 and "set.k_act: expected a damping in N s/m" in done.stderr
    done = forceaxis("run", vertical, "--set", "tau=m / k_act")
    assert done.returncode == 2 and "the circular reference" in done.stderr


@pytest.mark.long
def test_a_sweep_moves_what_is_computed(vertical, tmp_path):
    out = tmp_path / "sweep"
    done = forceaxis("sweep", vertical, "--grid", "tau=0.01:0.04:2", "--out", out)
    assert done.returncode == 0, done.stderr


def test_a_set_has_ranges_of_what_only_others_name(vertical):
    from forceaxis.linear import plant_set

    plants = plant_set.ranges_of(str(vertical.parent / "model.toml"), ("m=30%", "tau=20%"))
    assert plants["tau"] == pytest.approx((0.02, 0.016, 0.024))


def test_forces_of_an_experiment_are_in_newtons_of_its_rated_force(tmp_path):
    """target_force = "1500 N" beside rated_force, in [firmware] and [[at]]."""
    from forceaxis import _core

    (tmp_path / "model.toml").write_text(MODEL % BRAKE)
    text = EXPERIMENT.replace(
        "position_gain = 2", 'rated_force = "2 kN"\ntarget_force = "1500 N"\nforce_limit = "1.8 kN"'
    ).replace('mode = "position", position_setpoint = 0', 'target_force = "500N"')
    file = tmp_path / "e.toml"
    file.write_text(text)
    firmware = _core.inputs(str(file))["firmware"]
    assert (firmware["target_force"], firmware["force_limit"]) == (750, 900)
    with pytest.raises(_core.InputError, match="target_force: expected a force in N, got"):
        _core.inputs(str(file), ["firmware.target_force=3 kg"])
    with pytest.raises(_core.InputError, match=r"expected a number in code/count or a parameter"):
        _core.inputs(str(file), ["firmware.force_gain=abc"])
