"""Plants with structures given by their modes, and contacts with hysteresis, in linear analysis and
in runs: a structure is the bodies and springs that it was computed from."""

import json
import math

import numpy as np
import pytest
import verbs
from forceaxis import Experiment, beam, modes
from forceaxis.design import advise
from forceaxis.linear import loops, over, working
from forceaxis.linear import system as linear
from scipy import linalg

# Base, slide and head of an axis in a row of springs; damping 2e-4 s of each stiffness.
MASS = np.array([60.0, 25.0, 8.0])
STIFFNESS = (3e6, 1.5e6)
BETA = 2e-4

REST = """
[[body]]
name = "workpiece"
mass = 5
position = 0.001
[[spring]]
name = "fixture"
between = ["workpiece", "ground"]
stiffness = 4e5
damping = 120
[[damper]]
name = "rail"
between = ["base", "ground"]
damping = 900
[[contact]]
name = "sensor"
between = ["head", "workpiece"]
stiffness = 6e5
damping = 90
[drive]
type = "first_order"
body = "base"
k_act = 8000
a_act = 500
velocity_per_volt = 0.02
[encoder]
body = "base"
scale = 1e6
[[adc]]
channel = 0
signal = "sensor.spring_force"
per_count = 0.1
bits = 12
"""

PAD = """
[[body]]
name = "axis"
mass = 20
position = -0.001
[[damper]]
name = "rail"
between = ["axis", "ground"]
damping = 400
[[contact]]
name = "pad"
between = ["axis", "ground"]
{keys}
[drive]
type = "first_order"
body = "axis"
k_act = 2000
a_act = 500
velocity_per_volt = 0.02
[encoder]
body = "axis"
scale = 1e6
[[adc]]
channel = 0
signal = "pad.force"
per_count = 0.1
bits = 12
"""
HYSTERESIS = "stiffness = 1e5\nhysteresis_stiffness = 3e5\nhysteresis_force = 4"

RUN = """
title = "press"
model = "{model}"
duration_s = 2.0
[firmware]
mode = "force"
adc_bits = 12
force_gain = {gain}
force_setpoint = 40.0
[[at]]
time_s = 1.2
impulse = {{ body = "{struck}", N_s = 0.5 }}
[verdict]
window_s = 0.2
contact_held = true
force_ripple_max_count = 1.0
"""


def chain():
    """Stiffness matrix of the three bodies in a row."""
    K = np.zeros((3, 3))
    for i, k in enumerate(STIFFNESS):
        K[i : i + 2, i : i + 2] += k * np.array([[1, -1], [-1, 1]])
    return K


def as_bodies(folder):
    lines = [f'[[body]]\nname = "{n}"\nmass = {m}'
             for n, m in zip(("base", "slide", "head"), MASS, strict=True)]  # fmt: skip
    for name, ends, k in (("lower", ["base", "slide"], STIFFNESS[0]),
                          ("upper", ["slide", "head"], STIFFNESS[1])):  # fmt: skip
        lines.append(f'[[spring]]\nname = "{name}"\nbetween = {ends}\nstiffness = {k}\n'
                     f"damping = {BETA * k}")  # fmt: skip
    path = folder / "bodies.toml"
    path.write_text("\n".join(lines).replace("'", '"') + REST)
    return path


def as_modes(folder):
    squares, shapes = linalg.eigh(chain(), np.diag(MASS))  # mass-normalised
    lines = ['[[structure]]\nname = "axis"\nports = ["base", "slide", "head"]']
    for i, shape in enumerate(shapes.T):
        w = math.sqrt(squares[i]) if i else 0.0
        lines.append(f"[[structure.mode]]\nfrequency = {w / (2 * math.pi)!r}\n"
                     f"damping_ratio = {BETA * w / 2!r}\nshape = {shape.tolist()}")  # fmt: skip
    path = folder / "modes.toml"
    path.write_text("\n".join(lines) + REST)
    return path


@pytest.fixture
def pair(tmp_path):
    return as_bodies(tmp_path), as_modes(tmp_path)


def test_limits_and_margins_are_those_of_the_bodies(pair):
    for timing in ("continuous", "zoh"):
        one, other = (loops.force_loop(path, timing=timing) for path in pair)
        assert other.limit().gain == pytest.approx(one.limit().gain, rel=1e-7)
        assert other.limit().frequency_hz == pytest.approx(one.limit().frequency_hz, rel=1e-7)
    one, other = (np.linalg.eigvals(linear.linearise(path).A) for path in pair)
    nearest = np.abs(one[:, None] - other[None, :])
    assert nearest.min(axis=0).max() < 1e-6 * np.abs(one).max()
    assert nearest.min(axis=1).max() < 1e-6 * np.abs(one).max()


def test_modes_have_the_labels_and_shapes_of_the_bodies(pair):
    for free in (False, True):
        one, other = (modes.modes(path, free=free) for path in pair)
        assert len(one.modes) == 4
        for a, b in zip(one.modes, other.modes, strict=True):
            assert b.frequency_hz == pytest.approx(a.frequency_hz, rel=1e-9, abs=1e-5)
            assert (b.label, b.against_below, b.reference) == (
                a.label,
                a.against_below,
                a.reference,
            )
            assert b.residue == pytest.approx(a.residue, rel=1e-8)
            turn = math.copysign(1, a.shape["head"] * b.shape["head"])
            assert set(b.shape) == {"base", "slide", "head", "workpiece"}
            for point, size in a.shape.items():
                assert turn * b.shape[point] == pytest.approx(size, abs=1e-7)


def test_a_run_is_that_of_the_bodies(pair, tmp_path):
    results = []
    for path in pair:
        text = RUN.format(model=path.name, gain=0.6, struck="head")
        (tmp_path / "run.toml").write_text(text)
        results.append(Experiment.load(tmp_path / "run.toml").run())
    one, other = results
    assert one.verdict == other.verdict
    force = one["sensor.force"]
    assert other["sensor.force"] == pytest.approx(force, abs=1e-8 * force.max())
    assert other["slide.velocity"] == pytest.approx(one["slide.velocity"], abs=1e-9)
    energy = other.summary["energy"]
    assert abs(energy["residual_J"]) < 1e-9 * sum(energy["dissipated_J"].values())
    assert set(energy["dissipated_J"]) == {"axis", "fixture", "rail", "sensor"}


def test_advise_and_sets_of_plants_take_structures(pair, tmp_path):
    body, mode = (
        path.with_stem(f"set_{path.stem}") for path in pair
    )  # the workpiece as a parameter
    for new, old in zip((body, mode), pair, strict=True):
        text = old.read_text().replace("mass = 5", 'mass = "m_w"')
        new.write_text('[parameters]\nm_w = { value = 5, unit = "kg", source = "given" }\n' + text)
    done = [
        verbs.forceaxis("loop", "limit", str(path), "--over", "m_w=40%", "--json")
        for path in (body, mode)
    ]
    gains = [json.loads(one.stdout)["critical_gain"] for one in done]
    assert gains[1] == pytest.approx(gains[0], rel=1e-6)
    shape = modes.modes(mode).modes[-1].shape
    assert advise.strain(mode, {}, shape) in ("sensor", "fixture")


def test_a_beam_by_its_modes_is_the_beam(tmp_path):
    """The beam of 2.4.4: one end slides on a rail without turning, the other one is free. Its
    mass-normalised modes are 2 / sqrt(m) at the tip and this times (cos y + cosh y) / (2 cos y
    cosh y) at the rail, where tan y = -tanh y."""
    steel = beam.Beam(bending_stiffness_Nm2=2000.0, mass_per_length_kg_per_m=8.0, length_m=0.5)
    count, mass = 20, steel.mass_kg
    w = steel.natural_frequencies(count)
    y = np.sqrt(w * steel.length_m**2 * np.sqrt(8.0 / 2000.0))
    assert np.tan(y[:4]) == pytest.approx(-np.tanh(y[:4]), abs=1e-9)
    rail = (1 / np.cosh(y) + 1 / np.cos(y)) / 2
    hz = (w / (2 * math.pi)).tolist()
    lines = ['[[structure]]\nname = "beam"\nports = ["rail", "tip"]',
             f"[[structure.mode]]\nfrequency = 0\nmodal_mass = {mass}\nshape = [1, 1]"]  # fmt: skip
    lines += [f"[[structure.mode]]\nfrequency = {f}\nmodal_mass = {mass}\nshape = [{2 * r}, 2]"
              for f, r in zip(hz, rail.tolist(), strict=True)]  # fmt: skip
    path = tmp_path / "beam.toml"
    path.write_text("\n".join(lines) + '\n[[damper]]\nname = "way"\nbetween = ["rail", "ground"]\n'
                    "damping = 0\n")  # fmt: skip
    system = linear.linearise(path, ["rail.force"], ["rail.velocity", "tip.velocity"])
    hz = np.array([3.0, 30.0, 52.0, 80.0, 200.0, 400.0])
    found = system.response(hz)
    s = 2j * math.pi * hz
    # The modes that are left out have at most the compliance sum 4 / (m w^2) beyond the last one.
    left = 4 / mass * np.sum(1 / (w[-1] * (1 + np.arange(1, 2000) / count) ** 2) ** 2)
    for column, closed in zip(found.reshape(len(hz), 2).T, (steel.actuator(s), steel.tip(s)),
                              strict=True):  # fmt: skip
        assert np.all(np.abs(column - closed) < np.abs(s) * left * 1.1 + 1e-12)
        assert np.all(np.abs(column - closed) < 1e-2 * np.abs(closed).max())


def test_the_slider_sticks_in_linear_figures(tmp_path):
    path, plain, soft = (tmp_path / f"{n}.toml" for n in ("pad", "plain", "soft"))
    path.write_text(PAD.format(keys=HYSTERESIS))
    plain.write_text(PAD.format(keys="stiffness = 4e5"))
    soft.write_text(PAD.format(keys="stiffness = 1e5"))
    assert working.working(path).modes == {"pad.hysteresis": "stuck"}
    assert working.working(path).text == "pad pressed, pad.hysteresis stuck (small motions)"
    assert working.working(path, free=True).text == "pad apart"
    assert loops.force_loop(path).limit().gain == loops.force_loop(plain).limit().gain
    slips = {"pad.hysteresis": "forward"}
    assert loops.force_loop(path, modes=slips).limit().gain == loops.force_loop(soft).limit().gain
    assert over.modes_all(path) == ({}, slips)
    done = verbs.forceaxis("loop", "limit", str(path))
    assert "mode         pad pressed, pad.hysteresis stuck (small motions)\n" in done.stdout
    system = linear.linearise(path)
    assert system.states == linear.linearise(plain).states


def test_hysteresis_bounds_the_oscillation_above_the_limit(tmp_path):
    """Above the limit of the stuck slider the loop oscillates, but no more than the slider, whose
    losses it has to make up for, lets it; without hysteresis it bounces."""
    gains = {}
    for name, keys in (("pad", HYSTERESIS), ("plain", "stiffness = 4e5")):
        (tmp_path / f"{name}.toml").write_text(PAD.format(keys=keys))
        loop = loops.force_loop(tmp_path / f"{name}.toml", timing="zoh")
        gains[name] = 1.05 * loop.firmware_gain(loop.limit().gain)
        text = RUN.format(model=f"{name}.toml", gain=round(gains[name] * 256) / 256, struck="axis")
        (tmp_path / f"{name}_run.toml").write_text(text)
    pad, plain = (Experiment.load(tmp_path / f"{name}_run.toml").run() for name in gains)
    assert plain.summary["metrics"]["contact_losses"] > 0
    assert pad.summary["metrics"]["contact_losses"] == 0
    ripple = np.ptp(pad["pad.force"][-600:])
    assert ripple < 30
    energy = pad.summary["energy"]
    assert abs(energy["residual_J"]) < 1e-9 * sum(energy["dissipated_J"].values())
