"""Modes of vibration: frequencies of the thesis, labels of the thesis, and closed forms."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from forceaxis import linear, paths
from forceaxis._core import InputError
from forceaxis.cli import main as cli
from forceaxis.linear import modes
from forceaxis.results import to_json


def leading(mode, without=()):
    """The body that moves most."""
    shape = {b: abs(x) for b, x in mode.shape.items() if b not in without}
    return max(shape, key=shape.get)


# What the thesis calls the modes: model, apart, mode (the lowest is 1), the body that it is named
# for (that with the largest motion), label, where it says so.
LABELS = [
    ("fig2_16a", False, 2, "base", "colocated"),  # 2.4.3
    ("fig2_16b", False, 2, "base", "colocated"),
    ("fig4_17", False, 2, "base", "colocated"),  # 4.3.5
    ("fig4_17", True, 2, "base", "colocated"),  # 3.2.2, Fig 3.11: phase dip at 12 Hz
    ("fig4_14", False, 2, "workpiece", "colocated"),  # base with the workpiece on it
    ("fig2_26", False, 2, "workpiece", "colocated"),  # 2.5.1
    ("fig4_19", False, 2, "workpiece", "colocated"),  # 4.3.6
    ("fig4_21", False, 2, "workpiece", "colocated"),
    ("fig4_22", False, 2, "workpiece", "colocated"),
    ("fig5_5", False, 2, "workpiece", "colocated"),
    ("fig2_11", False, 2, "tip", "noncolocated"),  # 2.4.2
    ("fig2_11", True, 2, "tip", "noncolocated"),
    ("fig4_15", False, 2, "tip", "noncolocated"),  # 4.3.4
    ("fig4_15", True, 2, "tip", "noncolocated"),
    ("fig4_14", False, 3, "tip", "noncolocated"),
    ("fig2_29", False, 2, "tip", "noncolocated"),
    ("laboratory", False, 2, "tip", "noncolocated"),
    ("fig2_35", False, 3, "sensor_mass", "colocated"),  # 2.6
    ("fig4_24", False, 3, "sensor_mass", "colocated"),  # 4.3.7, 5.1.1
    ("fig4_25", False, 2, "workpiece", "colocated"),
    ("fig5_2", False, 3, "sensor_mass", "colocated"),
    ("fig4_19", True, 2, "workpiece", "neither"),  # 6.1.4: the robot does not touch it
]


@pytest.mark.parametrize(("model", "free", "number", "body", "label"), LABELS)
def test_labels_of_the_thesis(model, free, number, body, label):
    mode = modes.modes(model, free=free).modes[number - 1]
    assert leading(mode) == body
    assert mode.label == mode.against_lowest == label


def test_frequencies_of_the_thesis():
    # 12 Hz: the base carries the robot, which the drive's speed loop all but locks to it.
    for free in (False, True):
        base = modes.modes("fig4_17", free=free).modes[1]
        assert base.driven.frequency_hz == pytest.approx(12.4, abs=0.15)
    # Undamped and without the drive the base is alone: 3.6e6 N/m, 500 kg.
    assert base.frequency_hz == pytest.approx(np.sqrt(3.6e6 / 500) / (2 * np.pi), rel=1e-9)
    # 33 Hz: both masses of the arm free, m_r1 + m_r2 = 132.4 kg.
    arm = modes.modes("fig4_15", free=True).modes[1]
    w = np.sqrt(665000 * (114.5 + 17.9) / (114.5 * 17.9))
    assert arm.frequency_hz == pytest.approx(w / (2 * np.pi), rel=1e-9)
    assert arm.frequency_hz == pytest.approx(33.0, abs=0.1)
    assert arm.driven.frequency_hz == pytest.approx(33.0, abs=0.3)
    assert arm.shape == pytest.approx({"robot": -17.9 / 114.5, "tip": 1.0}, rel=1e-9)
    assert arm.damping_ratio == pytest.approx(
        (640 * w / 665000 + 500 * (17.9 / 132.4 / 114.5) / w) / 2, rel=1e-9
    )
    # 39.8 Hz and 0.0025: the workpiece alone; 0.11 with the damper of Figure 5.7.
    work = modes.modes("fig4_19", free=True).modes[1]
    assert work.frequency_hz == pytest.approx(39.8, abs=0.01)
    assert work.damping_ratio == pytest.approx(0.0025, rel=1e-3)
    damped = modes.modes("fig4_19", free=True, overrides={"b_w": 363.0}).modes[1]
    assert damped.damping_ratio == pytest.approx(0.11, rel=1e-3)


def test_residues_are_those_of_the_undamped_response():
    """Partial fractions against the plain solve of the stiffness and mass matrices, typed here."""
    M = np.diag([114.5, 17.9, 6.6])
    k_rf, k_s, k_w = 665000, 110100, 412700
    K = np.array([[k_rf, -k_rf, 0], [-k_rf, k_rf + k_s, -k_s], [0, -k_s, k_s + k_w]])
    found = modes.modes("fig2_29").modes
    for hz in (1.0, 10.0, 40.0, 200.0):
        s = 2j * np.pi * hz
        x = np.linalg.solve(M * s * s + K, [1, 0, 0])
        total = sum(m.residue / (s**2 + (2 * np.pi * m.frequency_hz) ** 2) for m in found)
        assert total == pytest.approx(k_s * (x[1] - x[2]), rel=1e-9)


def test_both_comparisons():
    """The workpiece behind a flexible arm: opposite to the lowest mode, in step with the arm's."""
    found = modes.modes("fig2_29").modes
    assert [m.label for m in found] == ["colocated", "noncolocated", "noncolocated"]
    assert [m.against_below for m in found] == ["colocated", "noncolocated", "colocated"]
    assert [m.reference for m in found] == [True, False, False]


@pytest.mark.parametrize("model", ["fig2_29", "fig4_14", "full_axis", "fig4_24", "laboratory_grip"])
def test_same_sign_as_the_mode_below_means_zeros_between(model):
    """The rule behind `against_below`, on the zeros of the undamped transfer function."""
    result = modes.modes(model)
    w = np.array([m.frequency_hz for m in result.modes])
    residues = np.array([m.residue for m in result.modes])
    for low, high, mode in zip(w, w[1:], result.modes[1:], strict=False):
        grid = 2 * np.pi * np.linspace(low, high, 4001)[1:-1]
        values = (residues / ((2 * np.pi * w) ** 2 - grid[:, None] ** 2)).sum(axis=1)
        crossings = np.count_nonzero(np.diff(np.sign(values)))
        assert (crossings % 2 == 1) == (mode.against_below == "colocated")


def test_a_mode_that_only_dampers_couple():
    """Fig 2.16a: nothing but b_r joins robot and base, so the base's zeros lie on its poles."""
    mode = modes.modes("fig2_16a").modes[1]
    assert mode.residue == 0.0
    assert mode.label == "colocated"
    assert mode.shape == {"robot": 0.0, "base": 1.0}
    # A robot that floats free (a double pole at 0) does not hide what a damper couples.
    undamped = {"b_r": 1e-3, "b_b": 0.0}
    assert modes.modes("fig4_17", free=True, overrides=undamped).modes[1].label == "colocated"
    alone = modes.modes("fig2_16a", overrides={"b_r": 0.0}).modes[1]
    assert alone.label == "neither"


@pytest.mark.parametrize("free", [False, True])
def test_every_model(free):
    """Poles of the driven system are all there, matched or not, and the masses hold the shapes."""
    for path in sorted(paths.MODELS.glob("*.toml")):
        if path.stem == "thesis":
            continue
        result = modes.modes(path, free=free)
        system = linear.linearise(path, ["drive.force"], [result.output], free=free)
        expected = system.poles()
        named = [m.driven for m in result.modes if m.driven] + result.other_poles
        count = sum(2 if p.imag_per_s > 0 else 1 for p in named)
        assert count == len(expected), path.stem
        if not result.modes:  # the shaft is locked: nothing can vibrate
            assert path.stem in ("fig3_7", "fig3_8")
            continue
        masses = linear.facts(path).masses_kg
        shapes = np.array([[m.shape[b] for b in masses] for m in result.modes])
        assert np.abs(shapes).max(axis=1) == pytest.approx(1.0)
        gram = shapes @ np.diag(list(masses.values())) @ shapes.T
        size = np.sqrt(np.diag(gram))
        assert gram / np.outer(size, size) == pytest.approx(np.eye(len(gram)), abs=1e-6), path.stem
        json.dumps(to_json(result), allow_nan=False)


def test_inputs_and_outputs():
    """A force on the base instead of the drive's; a rate stands for its position."""
    rate = modes.modes("fig4_15", output="tip.acceleration", free=True)
    assert rate.output == "tip.position"
    assert [m.label for m in rate.modes] == ["colocated", "noncolocated"]
    own = modes.modes("fig4_15", output="robot.velocity", free=True)
    assert [m.label for m in own.modes] == ["colocated", "colocated"]
    pushed = modes.modes("fig4_19", input="workpiece.force", output="workpiece.position")
    assert [m.label for m in pushed.modes] == ["colocated", "colocated"]
    with pytest.raises(InputError, match="no signal path"):
        modes.modes("fig4_19", output="sensor.spring_force", free=True)
    with pytest.raises(InputError, match="output"):
        modes.modes("fig4_19", output="tip.position")


def test_friction_that_sticks_takes_its_motion_away():
    result = modes.modes("nl_friction", states={"rail": "stuck"})
    assert not result.has_path
    assert [leading(m) for m in result.modes] == ["tip"]
    sliding = modes.modes("nl_friction")
    assert [m.label for m in sliding.modes] == ["colocated", "noncolocated"]


def test_states_of_elements():
    """The drive's change the driven poles alone; a contact that is apart changes the output."""
    plain = modes.modes("laboratory")
    outer = modes.modes("laboratory", states={"drive.amplifier": "high outer"})
    assert [m.frequency_hz for m in plain.modes] == [m.frequency_hz for m in outer.modes]
    assert plain.other_poles != outer.other_poles
    free = modes.modes("fig4_15", free=True)
    assert modes.modes("fig4_15", states={"sensor": "apart"}) == free
    assert free.output == "tip.position"
    assert modes.modes("fig4_15", output="reading").output == "sensor.spring_force"
    with pytest.raises(InputError, match=r"drive\.amplifier"):
        modes.modes("laboratory", states={"drive.amplifier": "x"})


def test_command_line():
    def call(*arguments):
        return CliRunner().invoke(cli.cli, ["loop", "modes", *arguments])

    plain = call("fig4_19")
    assert plain.exit_code == 0
    assert "44.84" in plain.output
    done = call("fig4_19", "--set", "b_w=363", "--free", "--json")
    result = json.loads(done.output)
    assert result["contact"] == "apart"
    assert result["modes"][1]["damping_ratio"] == pytest.approx(0.11, rel=1e-3)
    assert set(result["modes"][1]) == {
        "frequency_hz", "damping_ratio", "shape", "residue", "label", "against_lowest",
        "against_below", "reference", "driven",
    }  # fmt: skip
    for arguments in (["fig9"], ["fig4_19", "--output", "x"], ["fig4_19", "--input", "x"],
                      ["fig4_19", "--set", "b_w"], ["fig4_19", "--mode", "arm=x"]):  # fmt: skip
        assert isinstance(call(*arguments).exception, InputError), arguments
