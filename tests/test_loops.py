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
    """How far the outermost pole of python-control's feedback loop is outside, 1/s."""
    poles = control.feedback(gain * system, 1).poles()
    return poles.real.max() if system.dt == 0 else np.log(np.abs(poles).max()) / system.dt


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
    for i in np.flatnonzero((values.imag[:-1] * values.imag[1:] < 0) & (values.real[1:] < 0)):
        w = optimize.brentq(lambda w: at(w).imag, grid[i], grid[i + 1], xtol=1e-300, rtol=1e-14)
        found.append((-1 / at(w).real, w))
    return sorted(found)


def agrees(loop, system):
    """All crossings, and the first of them, against both computations; the worst disagreement."""
    inside = [
        c for c in loop.crossings() if c.frequency_hz and c.frequency_hz != 0.5 / (loop.dt or 1e-9)
    ]
    sweep = swept(system)
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
