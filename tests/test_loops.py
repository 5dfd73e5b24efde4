"""Force loops: critical gains against python-control, frequency sweeps and the stepper."""

import json
import math
import subprocess
import sys
import tomllib
from pathlib import Path

import control
import numpy as np
import pytest
from forceaxis import _core, linear, loops, paths
from forceaxis._core import InputError
from scipy import optimize, signal

ROOT = Path(__file__).resolve().parents[1]
FORCEAXIS = Path(sys.executable).parent / "forceaxis"
TICK = 1 / 1500
SAMPLED = ("zoh", "zoh+1")

# Nothing reads a force | nothing moves what is read: the slide sticks, the screw is in its backlash.
NO_READING = {"fig4_27", "fig4_5", "nl_gravity", "nl_stop", "nl_viscous"}
NO_PATH = {"nl_friction": "rail=forward", "nl_stiction": "", "nl_backlash": ""}
MODELS = sorted(
    p.stem for p in paths.MODELS.glob("*.toml") if p.stem not in NO_READING | {*NO_PATH, "thesis"}
)


# --- Independent computations -------------------------------------------------------------------


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


# --- Critical gains -----------------------------------------------------------------------------


@pytest.mark.parametrize("timing", loops.TIMINGS)
@pytest.mark.parametrize("name", MODELS)
def test_crossings_of_every_model(name, timing):
    loop = loops.force_loop(name, timing=timing)
    agrees(loop, exported(linear.linearise(name), timing))


def test_models_without_a_force_loop():
    for name in NO_READING:
        with pytest.raises(InputError, match=r"adc: expected an ADC on channel 0"):
            loops.force_loop(name)
    for name in NO_PATH:
        with pytest.raises(InputError, match=r"expected a path from drive.command to"):
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
