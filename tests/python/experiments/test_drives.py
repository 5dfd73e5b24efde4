"""Two axes described by data sheets: a linear motor with cogging, a belt with a velocity drive."""

import json
from pathlib import Path

import pytest
import verbs

DRIVES = Path(__file__).parent / "drives"
AXES = ("linear_motor", "belt_axis")


def told(*arguments):
    done = verbs.forceaxis(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_their_recorded_runs_stay():
    done = json.loads(told("test", str(DRIVES), "--json"))
    assert (done["passed"], done["failed"]) == (len(AXES), 0)


@pytest.mark.parametrize("axis", AXES)
def test_the_energy_balances(axis):
    run = json.loads(told("run", str(DRIVES / f"{axis}.toml"), "--json"))
    energy = run["energy"]
    turned = abs(energy["supplied_J"]) + sum(energy["dissipated_J"].values())
    assert abs(energy["residual_J"]) <= 1e-9 * turned


def test_the_linear_motor_is_stable_below_the_limit_and_not_above():
    """With a tick of latency; the pad is three times as stiff where it is pressed further."""
    file = str(DRIVES / "linear_motor.toml")
    late = ("--set", "firmware.latency_ticks=1")
    limit = json.loads(told("loop", "limit", file, "--timing", "zoh+1", "--json"))["firmware_gain"]
    assert 100 < limit < 230
    for share, verdict in ((0.3, "stable"), (1.1, "unstable")):
        gain = ("--set", f"firmware.force_gain={share * limit}")
        run = json.loads(told("run", file, *late, *gain, "--json"))
        assert run["verdict"] == verdict, share


def test_the_gains_of_the_velocity_loop_are_printed():
    """8 kg, 40 Hz, damping ratio 0.8 behind a current loop of 600 Hz."""
    text = told("loop", "linearise", str(DRIVES / "belt_axis_model.toml"), "--output", "pad.force")
    assert "drive        velocity loop: k_velocity 1405.3 N s/m, integral_time 0.014426 s" in text
