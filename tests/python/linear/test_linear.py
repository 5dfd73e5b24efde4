"""The linear plant: matrices against the mechanics, zeros, sampling, names and refusals."""

import control
import numpy as np
import pytest
from forceaxis import linear, paths
from forceaxis._core import InputError
from scipy import signal

MODELS = sorted(p.stem for p in paths.MODELS.glob("*.toml") if p.stem != "thesis")
FREQUENCIES = np.geomspace(0.3, 700, 60)


def force_models():
    """Models with a drive and an ADC 0."""
    found = [n for n in MODELS if (f := linear.facts(n)).drive and f.reading]
    assert len(found) > 30
    return found


def test_drives_with_their_own_loops_have_the_transfer_functions_of_their_blocks(tmp_path):
    """Torque: g w / (s + w) k with damping from the velocity; velocity: PI, lag and mass."""
    s = control.tf("s")
    m, w, k = 3.0, 4000.0, 25.0
    lag = w / (s + w)
    body = '[[body]]\nname = "axis"\nmass = 3\n[drive]\nbody = "axis"\nk_force = 25\n'
    body += "current_bandwidth = 4000\n"
    torque = 'type = "torque"\ncurrent_per_volt = 0.7\ndamping = 600\n'
    velocity = 'type = "velocity"\nvelocity_per_volt = 0.02\nk_velocity = 900\n'
    velocity += "integral_time = 0.02\n"
    pi = 900 / k * (1 + 1 / (0.02 * s))
    expected = {
        torque: control.feedback(lag * k / (m * s), control.tf(600 / k, 1)) * 0.7,
        velocity: 0.02 * control.feedback(pi * lag * k / (m * s)),
    }
    file = tmp_path / "m.toml"
    for text, transfer in expected.items():
        file.write_text(body + text)
        found = linear.linearise(file, outputs=("axis.velocity",)).response(FREQUENCIES)
        due = transfer(2j * np.pi * FREQUENCIES)
        assert np.all(abs(found - due) <= 1e-9 * abs(due))
    names = linear.linearise(file, outputs=("axis.velocity",)).states
    assert tuple(names) == ("axis.position", "axis.velocity", "drive.integral", "drive.current")


def near(found, expected, relative):
    """Every expected value has one found within a relative distance, and as many."""
    assert len(found) == len(expected)
    found = list(found)
    for value in expected:
        closest = min(range(len(found)), key=lambda i: abs(found[i] - value))
        assert abs(found.pop(closest) - value) <= relative * max(abs(value), 1.0)


@pytest.mark.parametrize("name", force_models())
def test_poles_zeros_and_response_agree_with_python_control(name):
    plant = linear.linearise(name)
    other = plant.state_space()
    near(plant.poles(), other.poles(), 1e-6)
    if plant.has_path() and name != "nl_stick_slip":  # a double zero at 0, found to 1e-6 by either
        near(plant.zeros(), other.zeros(), 1e-6)
    expected = other(2j * np.pi * FREQUENCIES)
    assert np.all(abs(plant.response(FREQUENCIES) - expected) <= 1e-6 * abs(expected) + 1e-300)


@pytest.mark.parametrize("name", ["fig2_11", "fig4_15", "fig4_19", "fig4_14", "full_axis"])
def test_transfer_function_coefficients(name):
    plant = linear.linearise(name)
    numerator, denominator = plant.transfer_function()
    s = 2j * np.pi * FREQUENCIES
    ratio = np.polyval(numerator, s) / np.polyval(denominator, s) / plant.at(s)
    assert np.all(abs(ratio - 1) < 1e-6)


def chain(tmp_path, masses, springs, dampers):
    """A row of bodies from ground on, a perfect drive on the last, force of the first spring."""
    lines = ['title = "chain"']
    for i, mass in enumerate(masses):
        lines.append(f'[[body]]\nname = "m{i}"\nmass = {mass}')
    ends = ["ground", *(f"m{i}" for i in range(len(masses)))]
    for i, (k, b) in enumerate(zip(springs, dampers, strict=True)):
        lines.append(
            f'[[spring]]\nname = "k{i}"\nbetween = ["{ends[i]}", "{ends[i + 1]}"]\n'
            f"stiffness = {k}\ndamping = {b}"
        )
    lines.append(
        f'[drive]\ntype = "perfect"\nbody = "{ends[-1]}"\nforce_per_volt = 2.0\n'
        '[encoder]\nbody = "m0"\nscale = 1000\n'
        '[[adc]]\nchannel = 0\nsignal = "k0.spring_force"\nper_count = 0.25\nbits = 10\n'
        "[dac]\nrange = 10\n"
    )
    path = tmp_path / "chain.toml"
    path.write_text("\n".join(lines))
    return path


def test_any_input_and_output_is_the_mechanics(tmp_path):
    m, k, b = [2.0, 3.0, 0.5], [1e4, 2e5, 7e4], [3.0, 0.0, 5.0]
    inputs = ["drive.command", "drive.force", "m0.force", "m1.force"]
    outputs = ["m0.position", "m1.velocity", "m2.acceleration", "k0.force", "reading", "adc0",
               "encoder", "drive.force", "k2.deflection"]  # fmt: skip
    plant = linear.linearise(chain(tmp_path, m, k, b), inputs, outputs)
    for f in FREQUENCIES:
        s = 2j * np.pi * f
        Z = np.diag(m).astype(complex) * s * s
        for i in range(3):
            d = np.eye(3)[i] - (np.eye(3)[i - 1] if i else 0)
            Z += (k[i] + b[i] * s) * np.outer(d, d)
        push = np.array([[0, 0, 2.0], [0, 0, 1.0], [1.0, 0, 0], [0, 1.0, 0]]).T
        x = np.linalg.solve(Z, push)
        spring = -k[0] * x[0]  # positive in compression, as a link to ground on side a
        expected = np.array(
            [
                x[0],
                s * x[1],
                s * s * x[2],
                -(k[0] + b[0] * s) * x[0],
                spring,
                spring / 0.25 / 4,
                1000 * x[0],
                [2.0, 0, 0, 0],
                x[1] - x[2],
            ]
        )
        found = plant.response(f)
        scale = abs(expected).max(axis=1, keepdims=True)
        # drive.force is what the drive gives; drive.force as an input acts besides it.
        assert np.all(abs(found - expected) <= 1e-9 * scale), f


def test_stuck_friction_takes_part_in_every_input():
    outputs = ["robot.velocity", "robot.position"]
    stuck = linear.linearise("nl_friction", ["robot.force"], outputs, modes={"rail": "stuck"})
    assert not stuck.B.any()  # what sticks to ground does not answer
    slides = linear.linearise("nl_friction", ["robot.force"], outputs)
    assert slides.B.any()


@pytest.mark.parametrize("name", ["fig2_3", "fig4_19", "fig4_14", "laboratory"])
def test_sampled_with_hold(name):
    plant = linear.linearise(name, outputs=("reading", "drive.force"))
    sampled = plant.sampled()
    A, B, *_ = signal.cont2discrete((plant.A, plant.B, plant.C, plant.D), 1 / 1500)
    assert np.allclose(sampled.A, A, rtol=1e-9, atol=1e-12 * abs(A).max())
    assert np.allclose(sampled.B, B, rtol=1e-9, atol=1e-12 * abs(B).max())
    later = plant.sampled(2)
    z = np.exp(2j * np.pi * FREQUENCIES / 1500)
    ratio = later.response(FREQUENCIES) / sampled.response(FREQUENCIES)
    assert np.all(abs(ratio * (z**2)[:, None, None] - 1) < 1e-7)  # where little is left of it
    slow = sampled.poles_s()
    slow = slow[abs(slow) < 500]
    near(slow, [p for p in plant.poles() if abs(p) < 500], 1e-6)


def test_right_half_plane_zeros_are_found():
    s = control.tf("s")
    G = control.ss(5 * (s - 30) * (s + 30) * (s * s + 2 * s + 900) / ((s + 1) * (s + 10) ** 5))
    system = linear.System(G.A, G.B, G.C, G.D, ("",) * 6, ("u",), ("y",))
    near(system.zeros(), [30, -30, -1 + 29.98333j, -1 - 29.98333j], 1e-5)
    assert system.gain() == pytest.approx(5)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (dict(model="fig9_99"), "MODEL: fig9_99: expected a path ending in .toml or one of"),
        (dict(model="fig4_19", outputs=("sensor.farce",)), "output: expected one of"),
        (dict(model="fig4_19", inputs=("rabot.force",)), "input: expected one of drive.command"),
        (dict(model="fig4_19", overrides={"m_x": 1.0}), "parameters.m_x: expected one of"),
        (dict(model="laboratory", modes={"tip": "gone"}), "tip: expected"),
        (dict(model="laboratory", modes={"drive.amplifier": "gone"}), "expected one of its states"),
        (dict(model="nl_stop", drive=False, outputs=("drive.current",)), "output: expected one of"),
    ],
)
def test_refusals(arguments, words):
    with pytest.raises(InputError, match=words.replace(".", r"\.")) as error:
        linear.linearise(**arguments)
    assert "\n" not in str(error.value)
