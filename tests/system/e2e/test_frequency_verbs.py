"""The verbs linearise, step and beam on the command line, and one-line refusals of all."""

import json
from pathlib import Path

import control
import numpy as np
import pytest
import verbs
from forceaxis import linear
from scipy import io

ROOT = Path(__file__).resolve().parents[3]


def run(*arguments):
    """Standard output of a verb."""
    done = verbs.forceaxis(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_exported_matrices_are_the_model(tmp_path):
    """JSON, .npz and .mat hold one and the same system."""
    plant = linear.linearise("fig4_19", outputs=("reading", "robot.velocity")).sampled(1)
    options = ["loop", "linearise", "fig4_19", "--timing", "zoh+1", "--output", "reading"]
    options += ["--output", "robot.velocity"]
    run(*options, "--out", tmp_path / "plant.npz")
    printed = json.loads(run(*options, "--out", tmp_path / "plant.mat", "--json"))
    for found in (
        printed,
        np.load(tmp_path / "plant.npz"),
        io.loadmat(tmp_path / "plant.mat", squeeze_me=True),
    ):
        for name in "ABCD":
            expected = getattr(plant, name)
            assert np.array_equal(np.reshape(found[name], expected.shape), expected)
        assert found["dt"] == plant.dt
        assert [str(name).strip() for name in found["states"]] == list(plant.states)


def test_step_is_python_controls():
    """Value, final value and overshoot of a closed loop, continuous and sampled."""
    gain = 0.008
    for timing in ("continuous", "zoh"):
        result = json.loads(
            run(
                "loop",
                "step",
                "fig4_19",
                "--law",
                f"gain={gain}",
                "--timing",
                timing,
                "--duration-s",
                0.5,
                "--json",
            )
        )
        plant = linear.linearise("fig4_19")
        if timing == "zoh":
            plant = plant.sampled()
        closed = control.feedback(gain * plant.state_space(), 1)
        time_s = np.array(result["time_s"])
        expected = control.step_response(closed, time_s).outputs
        assert result["value"] == pytest.approx(expected, abs=1e-6)
        assert result["final"] == pytest.approx(float(np.real(closed.dcgain())), rel=1e-9)
        assert result["stable"]
        over = max(expected) / result["final"] - 1
        assert result["overshoot"] == pytest.approx(max(over, 0.0), abs=1e-4)


@pytest.mark.parametrize(
    ("law", "firmware"),
    [
        ("p:", None),
        ("pi:integral=3,", "runs this law as a bank with an integral"),
        ("lead:zero=20,pole=80,", "runs this law as a bank with a section"),
        ("pd:derivative=0.002,", "runs this law by differences"),
        ("derivative:derivative=0.002,", "does not have this law"),
    ],
)
def test_a_limit_says_how_the_firmware_runs_the_law(law, firmware):
    """force_gain is a setting of the proportional law alone."""
    shown = run("loop", "limit", "laboratory", "--law", f"{law}gain=0.001")
    assert ("force_gain" in shown) == (firmware is None)
    assert ("firmware  " in shown) == (firmware is not None)
    assert firmware is None or f"firmware     {firmware}" in shown


@pytest.mark.parametrize("over", [[], ["--over", "k_w=30%", "--modes", "nominal"]])
def test_a_step_without_a_gain_has_half_the_critical_one(over, tmp_path):
    figure = tmp_path / "step.png"
    step = json.loads(run("loop", "step", "fig4_19", *over, "--out", figure, "--json"))
    limit = json.loads(run("loop", "limit", "fig4_19", *over, "--json"))
    critical = limit["critical_gain"]
    assert step["gain"] == pytest.approx(critical / 2, rel=1e-9)
    assert step["stable"] and figure.stat().st_size > 10_000


def test_an_unstable_step_says_so():
    result = json.loads(
        run("loop", "step", "fig4_19", "--law", "force_gain=20", "--duration-s", 3, "--json")
    )
    assert not result["stable"] and result["final"] is None
    value = np.abs(result["value"])
    assert value[-300:].max() > 5 * value[:300].max()


def test_beam_has_the_classical_constants():
    result = json.loads(run("thesis", "beam", "--modes", "4", "--json"))
    sliding = [2.365020372431352, 5.497803919000836, 8.63937982869974, 11.78097245102023]
    clamped = [1.875104068711961, 4.694091132974175, 7.854757438237613, 10.995540734875467]
    for k, mode in enumerate(result["modes"]):
        assert mode["b_l"] == pytest.approx(sliding[k], rel=1e-12)
        assert mode["pole_rad_per_s"] == pytest.approx(sliding[k] ** 2, rel=1e-12)
        assert mode["actuator_zero_rad_per_s"] == pytest.approx(clamped[k] ** 2, rel=1e-12)
        tip = 2 * ((k + 0.5) * np.pi) ** 2
        assert mode["tip_zero_per_s"] == pytest.approx(tip, rel=1e-12)
    errors = {row["modes"]: row for row in result["approximation_errors"]}
    assert set(errors) == set(range(4, 41))
    assert errors[12]["actuator"] < 0.01 and errors[24]["tip"] < 0.01


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("loop linearise fig4_19 --out plant.txt", "--out: plant.txt: expected a file ending in"),
        ("loop linearise fig4_19 --output sensor.farce", "output: expected one of"),
        ("loop linearise fig4_19 --input wall.force", "input: expected one of"),
        ("loop linearise fig4_19 --set m_x=1", "m_x"),
        (
            "loop step fig4_19 --law gain=0.01 --duration-s 0",
            "--duration-s: expected a duration from two ticks",
        ),
        (
            "loop step fig4_19 --law gain=1e6 --duration-s 60",
            "--duration-s: expected a response within the range",
        ),
        (
            "loop step nl_friction --law gain=0.01 --mode rail=stuck",
            "expected a signal path from drive.command",
        ),
        (
            "loop linearise fig4_19 --output reading --output reading",
            "--output: expected each name once",
        ),
        ("loop modes fig4_19 --output= ", "output"),
        ("thesis beam --length-m 1e-300", "length_m: expected a number from 1e-12"),
        ("loop advise sim/experiments/tables.toml", "expected a model or an experiment"),
        # What the model knows but does not use would change nothing, unnoticed.
        (
            "loop modes fig2_3 --set b_m=1",
            "parameters.b_m: expected a parameter that the model uses",
        ),
        ("loop linearise fig2_3 --set b_m=1", "parameters.b_m"),
        ("loop bode fig2_3 --set b_m=1", "parameters.b_m"),
        ("loop bode fig2_3 --vary b_m=1,2", "parameters.b_m"),
        ("loop advise fig2_3 --set b_m=1", "parameters.b_m"),
        ("loop step fig2_3 --law gain=1 --set b_m=1", "parameters.b_m"),
        ("measure fig3_12 --plant-set k_g=1", "parameters.k_g"),
        ("thesis beam --length-m 0", "length_m: expected a number from 1e-12"),
        ("loop limit fig9_99", "MODEL: fig9_99: expected"),
        ("loop limit fig4_5", "expected a model with an ADC on channel 0"),
        ("loop modes fig4_19 --output nowhere", "output: expected"),
        ("loop bode fig4_19 --output nowhere", "output: expected"),
        ("measure fig4_19 --output nowhere", "expected"),
        ("measure fig4_19 --output adc0 --inject codes --level 20 --band 1:5000", "band"),
        ("loop advise nowhere", "expected"),
    ],
)
def test_refusals_are_one_line(arguments, words):
    done = verbs.forceaxis(*arguments.split(), cwd=ROOT)
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1 and done.stderr.startswith("forceaxis: ")
    assert words in done.stderr
