"""Force loops: critical gains against python-control, frequency sweeps and the stepper."""

import dataclasses
import json
import math
import re
import sys
import tomllib
from pathlib import Path

import control
import numpy as np
import pytest
import verbs
from forceaxis import _core, linear, paths
from forceaxis._core import InputError
from forceaxis.cli import main as cli
from forceaxis.cli import text_loops
from forceaxis.linear import limits, loops
from scipy import linalg, optimize, signal

ROOT = Path(__file__).resolve().parents[3]
TICK = 1 / 1500
SAMPLED = ("zoh", "zoh+1")

STEMS = {p.stem for p in paths.MODELS.glob("*.toml")} - {"thesis"}
NO_READING = {n for n in STEMS if not linear.facts(n).reading}
# Their friction or backlash lets them settle above the linear limit, or nothing move below it.
BESIDES_LINEAR = {"nl_friction", "nl_stiction", "nl_stick_slip", "nl_backlash"}
MODELS = sorted(STEMS - NO_READING)


# Independent computations.


def exported(plant, timing):
    """L / k of law p as control.StateSpace: python-control's own hold, its own delay."""
    system = control.ss(plant.A, plant.B, plant.C, plant.D)
    if timing == "continuous":
        return system
    system = control.sample_system(system, TICK, "zoh")
    return system if timing == "zoh" else control.ss([[0]], [[1]], [[1]], [[0]], TICK) * system


def growth(system, gain):
    """How far the outermost pole of python-control's feedback loop is outside, 1/s.

    Without what drifts at s = 0 unseen; no loop here has an integrator that is seen.
    """
    poles = control.feedback(gain * system, 1).poles().astype(complex)
    if system.dt:
        poles = np.log(poles[np.abs(poles) > 1e-9]) / system.dt
    return poles[np.abs(poles) > 1e-5].real.max()


def bisected(system, low, high, points=60):
    """The smallest gain of low..high at which python-control's closed-loop poles go unstable."""
    gains = np.geomspace(low, high, points)
    first = next((i for i, k in enumerate(gains) if growth(system, k) > 0), None)
    assert first != 0
    if first is None:
        return None
    return optimize.brentq(
        lambda k: growth(system, k), gains[first - 1], gains[first], xtol=1e-300, rtol=1e-13
    )


def swept(system, points=40000):
    """[(gain, rad/s)] where the phase crosses -180 degrees on a dense sweep, from residues."""
    poles, vectors = np.linalg.eig(system.A)
    residues = (system.C @ vectors)[0] * np.linalg.solve(vectors, system.B)[:, 0]

    def at(w):
        s = 1j * w if system.dt == 0 else np.exp(1j * w * system.dt)
        return np.sum(residues / (np.asarray(s)[..., None] - poles), axis=-1) + system.D[0, 0]

    fast = np.abs(poles.imag).max() if system.dt == 0 else math.pi / system.dt
    top = math.pi / system.dt * (1 - 1e-9) if system.dt else 30 * max(fast, 1e3)
    grid = np.geomspace(0.01, top, points)
    rotations = np.abs(np.log(poles.astype(complex) + 1e-300).imag / (system.dt or 1))
    for w in rotations if system.dt else np.abs(poles.imag):  # closer around each resonance
        if w > 0.1:
            grid = np.concatenate([grid, w * (1 + np.geomspace(1e-6, 0.03, 400))])
            grid = np.concatenate([grid, w * (1 - np.geomspace(1e-6, 0.03, 400))])
    grid = np.unique(grid[(grid > 0) & (grid <= top)])
    values = at(grid)
    found = []
    for i in np.flatnonzero(values.imag[:-1] * values.imag[1:] < 0):
        w = optimize.brentq(lambda w: at(w).imag, grid[i], grid[i + 1], xtol=1e-300, rtol=1e-14)
        if at(w).real < 0:
            found.append((-1 / at(w).real, w))
    return sorted(found)


def agrees(loop, system):
    """All crossings, and the first of them, against both computations; the worst disagreement."""
    inside = [
        c for c in loop.crossings() if c.frequency_hz and c.frequency_hz != 0.5 / (loop.dt or 1e-9)
    ]
    sweep = swept(system)
    if sweep:  # far above the first, rounding of G decides
        inside = [c for c in inside if c.gain < 1e6 * sweep[0][0]]
        sweep = [pair for pair in sweep if pair[0] < 1e6 * sweep[0][0]]
    assert len(inside) == len(sweep), (inside, sweep)
    worst = 0.0
    for own, (gain, w) in zip(inside, sweep, strict=True):
        assert own.gain == pytest.approx(gain, rel=1e-6)
        assert 2 * math.pi * own.frequency_hz == pytest.approx(w, rel=1e-6)
        worst = max(worst, abs(own.gain / gain - 1), abs(2 * math.pi * own.frequency_hz / w - 1))
    limit = loop.limit()
    if limit.gain is None:
        for gain in np.geomspace(1e-4, 1e3, 15):
            assert growth(system, gain) < 1e-9
        return worst
    found = bisected(system, limit.gain / 1e3, 3 * limit.gain)
    assert limit.gain == pytest.approx(found, rel=1e-6)
    return max(worst, abs(limit.gain / found - 1))


# Critical gains.


@pytest.mark.parametrize("timing", loops.TIMINGS)
@pytest.mark.parametrize("name", MODELS)
def test_crossings_of_every_model(name, timing):
    loop = loops.force_loop(name, timing=timing)
    agrees(loop, exported(linear.linearise(name), timing))


def test_models_without_a_force_loop():
    assert len(MODELS) >= 36
    assert {"fig4_27", "fig4_5", "nl_gravity", "nl_stop", "nl_viscous"} <= NO_READING
    for name in NO_READING:
        with pytest.raises(InputError, match=r"adc: expected a model with an ADC on channel 0"):
            loops.force_loop(name)


def chain(seed):
    """A random row of 2 to 6 bodies from ground on, lightly damped, a random drive on one of them,
    the force of one spring read: x' = A x + B u, y = C x."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 7))
    masses = 10.0 ** random.uniform(-1, 2.5, n)
    stiffness = 10.0 ** random.uniform(4, 7, n)
    between = np.eye(n) - np.eye(n, k=-1)  # deflection of spring i is x_i - x_(i-1)
    damping = stiffness * 10.0 ** random.uniform(-6, -3, n)
    K = between.T @ np.diag(stiffness) @ between
    D = between.T @ np.diag(damping) @ between
    driven, read = random.integers(0, n, 2)
    force = np.zeros((n, 1))
    force[driven] = 1 / masses[driven]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K / masses[:, None], -D / masses[:, None]]])
    B = np.vstack([np.zeros((n, 1)), force])
    C = np.hstack([stiffness[read] * between[[read]], np.zeros((1, n))])
    C *= np.sign((C @ np.linalg.solve(-A, B)).item())  # a positive command presses
    for a in 10.0 ** random.uniform(1.5, 3.5, int(random.integers(0, 3))):  # lags of the drive
        lag = signal.StateSpace([[-a]], [[a]], [[1.0]], [[0.0]])
        A = np.block([[A, B @ lag.C], [np.zeros((1, len(A))), lag.A]])
        B = np.vstack([B * 0, lag.B])
        C = np.hstack([C, [[0.0]]])
    return linear.System(A, B, C, np.zeros((1, 1)), ("",) * len(A), ("u",), ("y",))


def loop_of(system):
    """A Loop of a System: what force_loop makes for law p."""
    whole = linear.System(
        system.A, system.B, np.vstack([system.C] * 2), np.vstack([system.D] * 2),
        system.states, ("error",), ("feedback", "y"), system.dt,
    )  # fmt: skip
    return loops.Loop("", "p", "", whole, "y", "V/N", None)


@pytest.mark.parametrize("timing", loops.TIMINGS)
@pytest.mark.parametrize("seed", [*range(20), 330, 431, 517, 599, 683])
def test_crossings_of_random_chains(seed, timing):
    plant = chain(seed)
    held = plant if timing == "continuous" else plant.sampled(timing == "zoh+1")
    agrees(loop_of(held), exported(plant, timing))


def rational(numerator, denominator):
    """A continuous System of polynomials, highest power first."""
    A, B, C, D = signal.tf2ss(numerator, denominator)
    return linear.System(A, B, C, D, ("",) * len(A), ("u",), ("y",))


# Numerator, denominator, limit with rad/s, crossings (gain, rad/s, direction), stable ranges; by
# Routh's criterion.
BY_HAND = {
    "integrator": ([1], [1, 3, 2, 0], (6, 2**0.5), [(6, 2**0.5, 1)], [(0, 6)]),
    "positive feedback at rest": ([-1], [1, 1], (1, 0), [(1, 0, 1)], [(0, 1)]),
    "through infinity": ([-0.5, 1], [1, 1], (2, None), [(2, None, 1)], [(0, 2)]),
    "direct path": ([2, 1], [1, 1], (None, None), [], [(0, None)]),
    "undamped": ([1], [1, 0, 1], (0, None), [(0, 1, 0)], []),
    "undamped pair pushed out": ([1, 0, 4], [1, 1, 1, 1], (0, None), [(0, 1, 1)], []),
    "undamped pair drawn in": ([1, 0, 1], [1, 1, 4, 4], (None, None), [], [(0, None)]),
    "touches": (
        [1, 2, 3], [1, 0.9, 0.8, 0.7], (0.1, 1), [(0.1, 1, 0)], [(0, 0.1), (0.1, None)],
    ),
    "stable above": ([1, 2], [1, -1, 1], (0, None), [(1, 3**0.5, -1)], [(1, None)]),
    "between": (
        # s^3 + (k - 1) s^2 + (5 - k) s + 1: stable where (k - 1)(5 - k) > 1
        [1, -1, 0], [1, -1, 5, 1], (0, None),
        [(3 - 3**0.5, (2 + 3**0.5) ** 0.5, -1), (3 + 3**0.5, (2 - 3**0.5) ** 0.5, 1)],
        [(3 - 3**0.5, 3 + 3**0.5)],
    ),
    "undamped with an integrator": ([1], [1, 0, 1, 0], (0, None), [(0, 0, -1), (0, 1, 1)], []),
    "drifts unseen": ([1, 0], [1, 3, 3, 1, 0], (8, 3**0.5), [(8, 3**0.5, 1)], [(0, 8)]),
}  # fmt: skip


@pytest.mark.parametrize("case", BY_HAND)
def test_limits_known_by_hand(case):
    numerator, denominator, (gain, w), crossings, ranges = BY_HAND[case]
    found = loop_of(rational(numerator, denominator)).limit()

    def near(value, expected):
        if expected is None:
            return value is None
        return value == pytest.approx(expected, rel=1e-9, abs=1e-12)

    assert near(found.gain, gain)
    assert near(found.frequency_hz, w and w / (2 * math.pi))
    assert bool(found.reason) == (not gain)
    assert [c.direction for c in found.crossings] == [d for _, _, d in crossings]
    for own, (k, at, _) in zip(found.crossings, crossings, strict=True):
        assert near(own.gain, k)
        assert near(own.frequency_hz, at and at / (2 * math.pi))
    assert len(found.stable_ranges) == len(ranges)
    for own, expected in zip(found.stable_ranges, ranges, strict=True):
        assert near(own[0], expected[0])
        assert near(own[1], expected[1])


UNDAMPED = """
title = "A row of which nothing is damped"
[parameters]
k = { value = 1e5, unit = "N/m" }
[[body]]
name = "robot"
mass = 20.0
[[body]]
name = "arm"
mass = 4.0
[[body]]
name = "tip"
mass = 1.0
[[spring]]
name = "link"
between = ["robot", "arm"]
stiffness = 5e4
[[spring]]
name = "wrist"
between = ["arm", "tip"]
stiffness = 8e4
[[contact]]
name = "sensor"
between = ["tip", "ground"]
stiffness = "k"
damping = 0.0
[drive]
type = "perfect"
body = "robot"
force_per_volt = 1.0
[encoder]
body = "robot"
scale = 1e5
[[adc]]
channel = 0
signal = "sensor.spring_force"
per_count = 0.001
bits = 16
[dac]
range = 2048
"""


@pytest.fixture
def undamped(tmp_path):
    (tmp_path / "undamped.toml").write_text(UNDAMPED)
    return tmp_path / "undamped.toml"


@pytest.mark.parametrize("derivative_s", [0.0, 1e-4, 0.0019415877, 0.019415877, 0.05, 1.0])
def test_an_undamped_plant_tells_where_its_poles_leave_the_axis(undamped, derivative_s):
    K = np.array([[5e4, -5e4, 0], [-5e4, 13e4, -8e4], [0, -8e4, 18e4]])
    w2, shapes = linalg.eigh(K, np.diag([20.0, 4.0, 1.0]))
    law = {"derivative_s": derivative_s} if derivative_s else {}
    loop = loops.force_loop(undamped, "pd" if law else "p", "continuous", **law)
    found = loop.limit()
    assert (found.gain, found.reason) == (0, "stable at no gain")
    at_0 = [c for c in found.crossings if c.gain == 0]
    assert [c.frequency_hz for c in at_0] == pytest.approx(w2**0.5 / (2 * math.pi), rel=1e-9)
    # A force -k (f + T f') on the robot adds k k_s T robot tip / 2 to a mode's decay.
    decays = derivative_s * shapes[0] * shapes[2]
    assert [c.direction for c in at_0] == [-int(np.sign(d)) for d in decays]
    held = loops.force_loop(undamped, "pd" if law else "p", "zoh", **law).limit()
    assert [c.gain for c in held.crossings][:3] == [0, 0, 0]
    assert all(c.gain > 1e-3 for c in held.crossings[3:])


def test_poles_of_a_plant_without_zeros(undamped):
    """With drive, link, wrist and sensor in a row every zero is at infinity."""
    done = forceaxis("loop", "poles", undamped, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["zeros"] == [] and len(found["poles"]) == 6
    # Force of the sensor over that of the drive: k_1 k_2 k_s / (m_1 m_2 m_3) over s^6 + ...
    assert found["numerator"] == pytest.approx([5e4 * 8e4 * 1e5 / 80], rel=1e-9)


def test_the_verb_says_which_undamped_poles_leave(undamped):
    pd = ["--law", "pd:derivative=0.019415877", "--timing", "continuous"]
    done = forceaxis("loop", "limit", undamped, *pd)
    assert (done.returncode, done.stderr) == (0, "")
    assert "limit        0: stable at no gain" in done.stdout
    assert re.search(r"0 \S+ at 24.52 Hz, an undamped pole of the plant leaves", done.stdout)
    assert done.stdout.count("is drawn in") == 2
    done = forceaxis("loop", "limit", undamped, *pd, "--json")
    assert [c["direction"] for c in json.loads(done.stdout)["crossings"]] == [-1, 1, -1]


def at_rest(model, output, timing, integral):
    loop = loops.force_loop(model, "pi", timing, output=output, integral_rad_per_s=float(integral))
    return [
        c.gain for c in loop.crossings() if c.frequency_hz is not None and c.frequency_hz < 0.01
    ]


# G(0) is 0, or 0/0 where the plant drifts: its sign and size are those of rounding.
ROUNDED = [
    ("fig4_14", "sensor_mass.acceleration"),
    ("fig4_25", "sensor_mass.acceleration"),
    ("full_axis", "sensor_mass.acceleration"),
    ("nl_backlash", "robot.position"),
    ("nl_backlash", "screw.deflection"),
]


@pytest.mark.parametrize("timing", loops.TIMINGS)
@pytest.mark.parametrize(("model", "output"), ROUNDED)
def test_rounding_makes_no_crossing_at_0_hz(model, output, timing):
    for integral in (7.3, 8, 8 * (1 + 1e-13), 50):
        assert at_rest(model, output, timing, integral) == []


def test_a_plants_zero_at_0_hz_under_the_integral_crosses_where_its_slope_says():
    """(1 + w / s) P(s) at s = 0 with P(0) = 0 is w P'(0) = -w C A^-2 B, the sum's w T P'(z = 1)."""
    for model, output, timing in (
        ("fig2_16a", "base.velocity", "continuous"),
        ("fig2_16a", "base.velocity", "zoh"),
        ("fig4_14_ground", "mount.spring_force_rate", "zoh"),
        ("fig2_11", "robot.acceleration", "zoh"),
    ):
        plant = linear.linearise(model, outputs=[output])
        matrix, scale = -plant.A, 8
        if timing == "zoh":
            plant = plant.sampled()
            matrix, scale = np.eye(len(plant.A)) - plant.A, 8 * TICK
        slope = -(plant.C @ np.linalg.solve(matrix, np.linalg.solve(matrix, plant.B))).item()
        slope -= plant.D.item()  # which acts one tick later: D / z
        assert slope < 0
        assert at_rest(model, output, timing, 8) == [pytest.approx(-1 / (scale * slope), rel=1e-6)]


def test_sampled_integrator_leaves_at_minus_one():
    """x' = u sampled: z - 1 + k T = 0 is at z = -1 for k = 2 / T."""
    found = loop_of(rational([1], [1, 0]).sampled()).limit()
    assert found.gain == pytest.approx(3000, rel=1e-9)
    assert found.frequency_hz == 750


def test_an_output_without_dynamics():
    assert loops.force_loop("fig2_3", timing="continuous", output="drive.command").limit().reason
    sampled = loops.force_loop("fig2_3", output="drive.command")  # z + k = 0
    assert sampled.limit().gain == pytest.approx(1)
    assert sampled.limit().frequency_hz == 750


def test_a_position_that_drifts_unseen_does_not_count():
    loop = loops.force_loop("fig4_19", free=True, output="robot.velocity", timing="continuous")
    assert min(abs(loop.open.poles())) < 1e-9
    assert loop.unit == "V/(m/s)"
    assert loop.limit().reason == "stable at every gain"


# The laws.

PARAMETERS = {
    "p": {"velocity_gain_Vs_per_m": 0.3},
    "pi": {"integral_rad_per_s": 10.0, "velocity_gain_Vs_per_m": 0.3},
    "pd": {"derivative_s": 2e-3, "velocity_gain_Vs_per_m": 0.3},
    "lead": {"lead_zero_hz": 30.0, "lead_pole_hz": 200.0},
    "derivative": {"derivative_s": 2e-3},
    "stiffness": {"stiffness_N_per_m": 2e4, "velocity_gain_Vs_per_m": 0.3},
    "damping": {"damping_Ns_per_m": 300.0},
    "impedance": {"stiffness_N_per_m": 2e4, "damping_Ns_per_m": 300.0},
}


def law_by_hand(name, law, timing, s):
    """L / k at s from python-control's plant and the law's own formula."""
    p = {"velocity_gain_Vs_per_m": 0.0} | PARAMETERS[law]
    base = linear.facts(name).required_drive.reaction
    bodies = ["robot"] if base == "ground" else ["robot", base]
    reading = linear.facts(name).required_reading.signal
    outputs = [reading, f"{reading.partition('.')[0]}.spring_force_rate"]
    outputs += [f"{b}.{q}" for q in ("position", "velocity") for b in bodies]
    plant = linear.linearise(name, outputs=outputs)
    system = control.ss(plant.A, plant.B, plant.C, plant.D)
    z = np.exp(s * TICK)
    if timing == "continuous":
        G, d = system(s)[:, 0], s
        late = 1.0
    else:
        G, d = control.sample_system(system, TICK, "zoh")(z)[:, 0], (1 - 1 / z) / TICK
        late = 1.0 if timing == "zoh" else 1 / z
    f, rate = G[0] * late, G[1] * late
    x, v = (G[i] - (G[i + 1] if len(bodies) > 1 else 0) for i in (2, 2 + len(bodies)))
    x, v = x * late, v * late if timing == "continuous" else x * late * d
    if law in ("p", "pi", "lead"):
        fed = f
    elif law == "pd":
        fed = f * (1 + p["derivative_s"] * d)
    elif law == "derivative":
        fed = f + p["derivative_s"] * rate
    else:
        fed = f * (law != "none") + p.get("stiffness_N_per_m", 0) * x
        fed = fed + p.get("damping_Ns_per_m", 0) * v
    L = fed / (1 + p["velocity_gain_Vs_per_m"] * v)
    if law == "pi":
        w = p["integral_rad_per_s"]
        L = L * (1 + (w / s if timing == "continuous" else w * TICK * z / (z - 1)))
    if law == "lead":
        b = s if timing == "continuous" else 2 / TICK * (z - 1) / (z + 1)
        zero, pole = (2 * math.pi * p[f"lead_{end}_hz"] for end in ("zero", "pole"))
        L = L * (1 + b / zero) / (1 + b / pole)
    return L


@pytest.mark.parametrize("timing", loops.TIMINGS)
@pytest.mark.parametrize("law", [law for law in loops.LAWS if law != "bank"])
@pytest.mark.parametrize("name", ["fig4_19", "fig4_17", "fig2_11"])
def test_laws(name, law, timing):
    loop = loops.force_loop(name, law, timing, **PARAMETERS[law])
    for hz in (0.3, 4.0, 30.0, 47.0, 300.0, 700.0):
        expected = law_by_hand(name, law, timing, 2j * math.pi * hz)
        assert abs(loop.open.response(hz) - expected) < 1e-7 * abs(expected)
    system = control.ss(*(getattr(loop.open, m) for m in "ABCD"), loop.dt or 0)
    limit = loop.limit()
    if limit.gain:
        found = bisected(system, limit.gain / 1e3, 3 * limit.gain, 300)
        assert limit.gain == pytest.approx(found, rel=1e-6)
    else:
        assert limit.reason == "stable at every gain"
        for gain in np.geomspace(1e-4, 1e3, 15):
            assert growth(system, gain) < 0


def test_law_parameters_are_required_and_refused():
    for law in loops.LAWS:
        for missing in loops.LAWS[law]:
            given = {n: v for n, v in PARAMETERS[law].items() if n != missing}
            with pytest.raises(
                InputError, match=f"{missing}: expected a value of this parameter, because law"
            ):
                loops.force_loop("fig4_19", law, **given)
    with pytest.raises(
        InputError, match="derivative_s: expected this parameter only with another law"
    ):
        loops.force_loop("fig4_19", derivative_s=1.0)
    with pytest.raises(InputError, match="expected a number > 0, got -1"):
        loops.force_loop("fig4_19", "pd", derivative_s=-1.0)
    with pytest.raises(InputError, match="expected the force of a spring"):
        loops.force_loop("fig4_19", "derivative", derivative_s=1.0, output="robot.velocity")


# Margins, steps, loci.


@pytest.mark.filterwarnings("ignore:overflow")  # in python-control's polynomials
@pytest.mark.parametrize("name", ["fig4_19", "fig4_14", "full_axis"])
def test_margins_agree_with_python_control(name):
    loop = loops.force_loop(name, timing="continuous")
    gain = 0.4 * loop.limit().gain
    margins = loop.margins(gain)
    system = gain * control.ss(*(getattr(loop.open, m) for m in "ABCD"))
    factor, phase, _, _, crossover, _ = control.stability_margins(system)
    assert margins.gain_margin == pytest.approx(2.5, rel=1e-9)
    assert margins.gain_margin == pytest.approx(factor, rel=1e-6)
    assert margins.phase_margin_deg == pytest.approx(phase, abs=1e-5)
    assert 2 * math.pi * margins.crossover_hz == pytest.approx(crossover, rel=1e-6)


@pytest.mark.parametrize("name", ["fig4_19", "fig4_14", "full_axis"])
def test_sampled_phase_margin_is_the_phase_that_destabilises(name):
    loop = loops.force_loop(name, timing="zoh+1")
    gain = 0.4 * loop.limit().gain
    margins = loop.margins(gain)
    assert min(abs(c.phase_margin_deg) for c in margins.crossovers) == abs(margins.phase_margin_deg)
    frequencies = np.linspace(0.01, 749.9, 300000)
    size = abs(gain * loop.open.response(frequencies))
    assert len(margins.crossovers) == np.count_nonzero((size[1:] > 1) != (size[:-1] > 1))
    for crossover in margins.crossovers:
        L = gain * loop.open.response(crossover.frequency_hz)
        assert L * np.exp(-1j * np.radians(crossover.phase_margin_deg)) == pytest.approx(
            -1, abs=1e-9
        )


def stepped(duration_s, model="fig4_15", gain=2.0, **given):
    loop = loops.force_loop(model, **given)
    return limits.step_response(loop, loop.gain_of(gain), duration_s)


def test_a_step_shorter_than_its_response_has_no_figures_of_it(capsys, monkeypatch):
    """fig4_15 at gain 2 passes 90 % at 44 ms, peaks 2.5 % over at 76 ms and settles at 93 ms."""
    whole = stepped(1.0)
    assert None not in (whole.rise_s, whole.overshoot, whole.settle_s)
    peak_s = whole.time_s[int(np.argmax(whole.value))]
    ninety = 0.9 * whole.final
    arrived_s = next(t for t, y in zip(whole.time_s, whole.value, strict=True) if y >= ninety)
    assert arrived_s < peak_s < whole.settle_s
    for ticks in range(2, 160):
        short = stepped((ticks + 0.5) * TICK)
        seen_s = short.time_s[-1]
        assert short.rise_s == (whole.rise_s if arrived_s <= seen_s else None)
        assert short.overshoot == (whole.overshoot if peak_s <= seen_s else None)
        assert short.settle_s == (whole.settle_s if whole.settle_s <= seen_s else None)
        assert (short.final, short.stable) == (whole.final, True)
    arguments = "loop step fig4_15 --law force_gain=2 --duration-s 0.03"
    monkeypatch.setattr(sys, "argv", ["forceaxis", *arguments.split()])
    cli.main()
    assert capsys.readouterr().out.count("not within 0.03 s") == 3


@pytest.mark.parametrize("overshoot", [0.0, 5.063e-14])
def test_a_step_that_does_not_pass_its_end_has_no_overshoot(overshoot):
    loop = loops.force_loop("fig4_15")
    result = limits.step_result(loop, loop.gain_of(2.0), 1.0)
    settled = dataclasses.replace(result.response, overshoot=overshoot)
    text = text_loops.describe_step(dataclasses.replace(result, response=settled))
    assert "overshoot    0 of the final value" in text


def test_a_step_without_a_final_value_has_no_figures_of_it():
    """Of an acceleration nothing stays; shares of what rounding makes of 0 say nothing."""
    loop = loops.force_loop("fig2_11", output="tip.acceleration")
    result = limits.step_response(loop, 1.0, 1.0)
    assert result.stable
    assert result.final == 0
    assert (result.rise_s, result.overshoot, result.settle_s) == (None, None, None)


@pytest.mark.parametrize("timing", loops.TIMINGS)
def test_step_response_agrees_with_python_control(timing):
    loop = loops.force_loop("fig4_19", "pi", timing, integral_rad_per_s=10.0)
    gain = 0.5 * loop.limit().gain
    time_s, y = loop.step(gain, 3.0)
    system = control.feedback(
        gain * control.ss(*(getattr(loop.open, m) for m in "ABCD"), loop.dt or 0), 1
    )
    expected = control.forced_response(system, time_s, np.ones_like(time_s)).outputs
    assert y == pytest.approx(expected, abs=1e-7)
    assert y[-1] == pytest.approx(1.0, abs=1e-3)  # pi leaves no error


@pytest.mark.parametrize("timing", loops.TIMINGS)
@pytest.mark.parametrize("name", ["fig4_19", "full_axis"])
def test_locus_follows_each_branch(name, timing):
    loop = loops.force_loop(name, timing=timing)
    gains = np.geomspace(1e-3, 1, 60) * 5 * loop.limit().gain
    branches = loop.locus(gains)
    for gain, row in zip(gains, branches, strict=True):
        own, expected = (np.sort_complex(p) for p in (row, loop.closed_poles(gain)))
        assert np.allclose(own, expected, rtol=1e-6, atol=1e-6)
    # A branch moves on as ten times finer steps lead it.
    fine = loop.locus(np.geomspace(1e-3, 1, 591) * 5 * loop.limit().gain)[::10]
    pairs = np.abs(branches.imag - fine.imag) < 1e-6 * (1 + np.abs(fine.imag))
    assert np.mean(pairs) > 0.95


# The stepper.


LIMITS = (
    "current_feedback_limit", "preamp_limit", "supply_limit", "amp_break", "k_amp_outer",
    "force_limit", "sensor_limit", "conditioning_limit", "noise",
)  # fmt: skip


def bilateral(name, folder):
    """A copy of a model that is linear: contacts that pull too, nothing limited, all at rest at 0.

    What remains nonlinear (stiction, bent springs) is not reached by the motions of 1e-6 m."""
    text = tomllib.loads((paths.MODELS / f"{name}.toml").read_text())
    for contact in text.pop("contact", []):
        contact.pop("gap", None)
        text.setdefault("spring", []).append(contact)
    for body in text["body"]:
        body.pop("position", None)
    for table in (text["drive"], *text["adc"]):
        for key in LIMITS:
            table.pop(key, None)
    for adc in text["adc"]:
        if "filter" in adc:  # shows in codes alone
            adc.update(per_count=1e-7, bits=16, zero_code=32768)
    parameters = text.pop("parameters", {})
    if "parameters_file" in text:
        text["parameters_file"] = str(paths.MODELS / text["parameters_file"])
    lines = [f"{key} = {json.dumps(v)}" for key, v in text.items() if isinstance(v, str)]
    elements = [
        (f"[[{key}]]" if isinstance(value, list) else f"[{key}]", table)
        for key, value in text.items()
        if not isinstance(value, str)
        for table in (value if isinstance(value, list) else [value])
    ]
    body = [
        line
        for head, table in elements
        for line in (head, *(f"{key} = {json.dumps(v)}" for key, v in table.items()))
    ]
    used = [n for n in parameters if any(n in re.split(r'[" \[\],=-]+', line) for line in body)]
    lines.append("[parameters]")
    for n in used:
        fields = ", ".join(f"{key} = {json.dumps(v)}" for key, v in parameters[n].items())
        lines.append(f"{n} = {{ {fields} }}")
    path = folder / f"{name}.toml"
    path.write_text("\n".join([*lines, *body]) + "\n")
    return path


def simulated(model, loop, gain, ticks):
    """The reading, tick by tick, of the sampled loop around the stepper, from a small push."""
    plant = _core.Plant(str(model))
    for i, (body, mass) in enumerate(linear.facts(model).masses_kg.items()):
        plant.apply_impulse(body, 1e-6 * mass / (1 + i))
    filtered = "adc0.filtered" in loop.whole.states
    late = loop.timing == "zoh+1"
    readings, waiting = np.empty(ticks), 0.0
    for k in range(ticks):
        if filtered:
            readings[k] = 1e-7 * (plant.codes()[1] - 32768)
        else:
            readings[k] = plant.signal(loop.signal)
        volts = -gain * readings[k]
        plant.step_volts(waiting if late else volts)
        waiting = volts
    return readings


def rate(readings, hz, order):
    """1/s at which the slowest of `order` exponentials decays (< 0) or the fastest grows: the poles
    of a trace by realisation (Kung 1978), from every so many samples that `hz` shows."""
    every = max(1, int(1500 / (12 * hz))) if hz else 1
    y = readings[::every][:400]
    hankel = np.lib.stride_tricks.sliding_window_view(y, len(y) // 3).T[:, ::2]
    U, s, _ = np.linalg.svd(hankel, full_matrices=False)
    order = min(order, int((s > 1e-11 * s[0]).sum()))
    z = np.linalg.eigvals(np.linalg.lstsq(U[:-1, :order], U[1:, :order], rcond=None)[0])
    return np.log(np.abs(z)).max() / (every * TICK)


@pytest.mark.parametrize("name", sorted({*MODELS} - BESIDES_LINEAR))
def test_stepped_loop_decays_below_the_limit_and_grows_above(name, tmp_path):
    model = bilateral(name, tmp_path)
    for timing in SAMPLED:
        loop = loops.force_loop(name, timing=timing)
        limit = loop.limit().gain
        for factor, sign in ((0.98, -1), (1.02, 1)):
            poles = loop.closed_poles(factor * limit)
            poles = poles[abs(poles) > 1e-5]  # a position that drifts unseen
            dominant = poles[poles.real.argmax()]
            assert np.sign(dominant.real) == sign
            readings = simulated(model, loop, factor * limit, 3000)[300:]
            found = rate(readings, abs(dominant.imag) / (2 * math.pi), 2 * len(loop.whole.A))
            assert found == pytest.approx(dominant.real, rel=0.01), (timing, factor)


@pytest.mark.parametrize("timing", SAMPLED)
def test_what_jumps_with_the_command_is_read_a_tick_later(timing, tmp_path):
    """An acceleration under a perfect actuator: the code that causes it comes after its reading."""
    model = bilateral("fig2_3", tmp_path)
    loop = loops.force_loop("fig2_3", timing=timing, output="robot.acceleration")
    for factor in (0.98, 1.02):
        gain = factor * loop.limit().gain
        poles = loop.closed_poles(gain)
        readings = simulated(model, loop, gain, 1000)[20:]
        assert rate(readings, 0, 8) == pytest.approx(poles.real.max(), rel=0.01)


# The mode in which an experiment holds its set-point, where that is not the one at rest.
HELD = {"nl_softening": {"pad": "segment 2"}}
# Half or twice the limit is more than the firmware's largest gain.
BEYOND = {
    ("fig2_35", "zoh", 0.5), ("fig2_35", "zoh", 2), ("fig2_35", "zoh+1", 0.5),
    ("fig2_35", "zoh+1", 2), ("fig2_35_coupled", "zoh", 2), ("fig2_35_coupled", "zoh+1", 2),
    ("fig4_25", "zoh", 0.5), ("fig4_25", "zoh", 2), ("fig4_25", "zoh+1", 2),
    ("nl_stiffening", "zoh", 2), ("nl_stiffening", "zoh+1", 2),
    ("nl_softening", "zoh", 2), ("nl_softening", "zoh+1", 2),
}  # fmt: skip


def test_runs_of_the_firmware_at_half_and_twice_the_limit():
    """Every model with a contact experiment of its own name, firmware and quantisation on."""
    names = []
    for name in sorted({*MODELS} - BESIDES_LINEAR):
        path = paths.EXPERIMENTS / f"{name}.toml"
        if path.exists() and "verdict" in tomllib.loads(path.read_text()):
            names.append(name)
    assert len(names) >= 27
    jobs, cases, beyond = [], [], set()
    for name in names:
        for timing in SAMPLED:
            loop = loops.force_loop(name, timing=timing, modes=HELD.get(name))
            limit = loop.firmware_gain(loop.limit().gain)
            for factor, verdict in ((0.5, "stable"), (2, "unstable")):
                if factor * limit > loops.FIRMWARE_HIGHEST:
                    beyond.add((name, timing, factor))
                    continue
                settings = [
                    f"firmware.force_gain={factor * limit}",
                    f"firmware.latency_ticks={SAMPLED.index(timing)}",
                    "experiment.duration_s=10",
                ]
                jobs.append((str(paths.EXPERIMENTS / f"{name}.toml"), settings))
                cases.append((name, timing, factor, verdict))
    assert beyond == BEYOND
    for (*case, verdict), run in zip(cases, _core.run_many(jobs, 2), strict=True):
        assert run["verdict"] == verdict, case


# The verbs.


def forceaxis(*arguments):
    return verbs.forceaxis(*arguments, cwd=ROOT)


def printed(*arguments):
    done = forceaxis(*arguments, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_limit_verb():
    result = printed("loop", "limit", "fig4_19", "--timing", "zoh", "--set", "b_m=0.02")
    expected = loops.force_loop("fig4_19", overrides={"b_m": 0.02})
    assert result["critical_gain"] == expected.limit().gain
    assert result["unit"] == "V/N"
    assert result["frequency_hz"] == expected.limit().frequency_hz
    assert {"gain", "frequency_hz", "direction"} == set(result["crossings"][0])
    # 2.5 N per 8-bit count, 20/4096 V per code.
    assert result["firmware_gain"] == pytest.approx(result["critical_gain"] * 2.5 * 204.8)
    steps = result["largest_firmware_gain"] * 256
    assert steps == int(steps)
    assert 0 < result["firmware_gain"] - result["largest_firmware_gain"] <= 1 / 256
    at = printed("loop", "limit", "fig4_19", "--law", "force_gain=4")["at"]
    assert at["gain"] == pytest.approx(4 / 512)
    assert at["stable"]
    assert printed("loop", "limit", "fig2_3", "--timing", "continuous")["critical_gain"] is None
    text = forceaxis("loop", "limit", "fig4_19")
    assert "limit        0.020789 V/N at 45.71 Hz" in text.stdout


def test_poles_verb():
    plant = printed("loop", "poles", "fig4_19", "--timing", "continuous")
    poles = [p["re_per_s"] + 1j * p["im_per_s"] for p in plant["poles"]]
    assert np.allclose(np.poly(poles), plant["denominator"], rtol=1e-6)
    assert any(z["hz"] == pytest.approx(39.8, abs=0.01) for z in plant["zeros"])
    loop = loops.force_loop("fig4_19", timing="zoh+1")
    closed = printed(
        "loop", "poles", "fig4_19", "--timing", "zoh+1", "--law", f"gain={loop.limit().gain}"
    )
    assert max(abs(p["re_z"] + 1j * p["im_z"]) for p in closed["poles"]) == pytest.approx(1)
    free = printed("loop", "poles", "fig4_19", "--free", "--output", "drive.tach")
    assert free["poles"][0]["hz"] == 0


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["loop", "limit", "fig9_9"], "MODEL: fig9_9: expected"),
        (["loop", "limit", "fig4_5"], "adc: expected a model with an ADC on channel 0"),
        (["loop", "limit", "fig4_19", "--output", "robot.speed"], "output: expected one of"),
        (
            ["loop", "limit", "fig4_19", "--mode", "sensor=apart"],
            "expected a signal path from drive.command",
        ),
        (
            ["loop", "limit", "fig4_19", "--mode", "sensor=open"],
            "sensor: expected one of its states",
        ),
        (["loop", "limit", "fig4_19", "--set", "m_x=1"], "parameters.m_x: expected one of"),
        (
            ["loop", "limit", "fig2_3", "--set", "b_m=1"],
            "parameters.b_m: expected a parameter that",
        ),
        (
            ["loop", "limit", "fig4_19", "--law", "pi"],
            "--law integral: expected a value of this parameter, because law pi",
        ),
        (
            ["loop", "limit", "fig4_19", "--law", "pole=9"],
            "--law pole: expected this parameter only",
        ),
        (["loop", "limit", "fig4_19", "--law", "gain=1,force_gain=1"], "got both"),
        (["loop", "limit", "fig4_19", "--law", "gain=-1"], "--law gain: expected a number from"),
        (["loop", "poles", "fig4_19", "--free"], "expected a signal path from drive.command to"),
        (
            ["loop", "poles", "fig4_19", "--law", "pi"],
            "--law: expected --law gain or --law force_gain together with a law",
        ),
        (["loop", "poles", "fig4_19", "--input", "arm.force"], "input: expected one of"),
    ],
)
def test_wrong_input_is_one_line(arguments, expected, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["forceaxis", *arguments])
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    assert stopped.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert expected in err


def test_what_is_far_faster_than_the_rest_does_not_hide_stability():
    """A winding of no inductance, at its limit: 200 digits on the same matrices."""
    loop = loops.force_loop("fig4_19", timing="continuous", overrides={"L": 1e-9})
    limit = loop.limit()
    assert limit.gain == pytest.approx(278240.00839149440, rel=1e-10)
    assert limit.frequency_hz == pytest.approx(66825.66024, rel=1e-9)
    assert limit.stable_ranges == [(0.0, limit.gain)]


def test_a_late_crossing_has_all_its_digits():
    """The third crossing of a heavy axis, against 60 digits on the same matrices."""
    loop = loops.force_loop("fig4_19", overrides={"m_r": 132400.0, "m_w": 6600.0})
    assert loop.crossings()[2].gain == pytest.approx(1.3430395, rel=2e-7)


def test_the_published_limit_of_the_benchmark_plant():
    """0.02314 V/N with the hold, where the reading includes the sensor's damping."""
    assert loops.force_loop("axis_contact").limit().gain == pytest.approx(0.02314, rel=2e-3)
