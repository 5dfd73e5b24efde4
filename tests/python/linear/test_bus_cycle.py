"""Limits of force loops over a bus, against a loop that is stepped tick by tick, and against poles
that SciPy computes from the plant lifted over a cycle."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from forceaxis import _core, paths
from forceaxis.linear import over, sets
from forceaxis.linear.loops import LoopSpec, force_loop
from forceaxis.linear.plant_set import PlantSet
from forceaxis.linear.system import linearise
from scipy import linalg, signal

TICK_S = 1 / 1500
LAWS = {
    "p": {},
    "pi": {"integral_rad_per_s": 30.0},
    "lead": {"lead_zero_hz": 40.0, "lead_pole_hz": 400.0},
    "pd": {"derivative_s": 0.002},
    "impedance": {"stiffness_N_per_m": 2e5, "damping_Ns_per_m": 900.0},
}
BUSES = [(3, 0, 0), (3, 3, 3), (3, 4, 2), (6, 1, 7), (1, 2, 3)]


def model(folder: Path, bus: tuple[int, int, int]) -> Path:
    """Writes fig4_19, whose encoder measures the robot, with a bus."""
    text = (paths.MODELS / "fig4_19.toml").read_text()
    keys = dict(zip(("cycle_ticks", "delay_ticks_out", "delay_ticks_in"), bus, strict=True))
    lines = "".join(f"{key} = {value}\n" for key, value in keys.items())
    file = folder / ("bus_" + "_".join(map(str, bus)) + ".toml")
    file.write_text(text.replace("[drive]\n", "[drive]\n" + lines))
    (folder / "thesis.toml").write_text((paths.MODELS / "thesis.toml").read_text())
    return file


class Stepped:
    """A loop that computes one tick after the other, as firmware, bus and drive do."""

    def __init__(self, path: Path, law: str, bus: tuple[int, int, int], late: int) -> None:
        plant = linearise(path, outputs=("reading", "robot.position"))
        n = len(plant.A)
        block = np.zeros((n + 1, n + 1))
        block[:n, :n], block[:n, n:] = plant.A, plant.B
        step = linalg.expm(block * TICK_S)
        self.A, self.B, self.C = step[:n, :n], step[:n, n], plant.C
        assert not plant.D.any()
        self.law, self.given, self.bus, self.late = law, LAWS[law], bus, late

    def radius(self, gain: float) -> float:
        """Spectral radius over a period: the growth of every unit vector of the complete state."""
        cycle, out, back = self.bus
        n, past = len(self.A), 2 + max(out, back) // cycle + 3
        size = n + 2 * past + 3
        columns = [self.cycle(gain, unit, past) for unit in np.eye(size)]
        return float(np.abs(np.linalg.eigvals(np.array(columns).T)).max())

    def cycle(self, gain: float, state: np.ndarray, past: int) -> np.ndarray:
        cycle, out, back = self.bus
        n = len(self.A)
        x, rest = state[:n], state[n:]
        sent, counts = list(rest[:past]), list(rest[past : 2 * past])  # newest first
        code_before, memory, force_before = rest[2 * past :]
        for tick in range(cycle):
            force, position = self.C @ x
            if tick == 0:
                counts = [position, *counts]
            seen = [counts[self.ago(tick - back) + k] for k in (0, 1)]
            code, memory = self.code(gain, force, force_before, seen, memory)
            force_before = force
            if tick == 0:
                sent = [code_before if self.late else code, *sent]
            code_before = code
            x = self.A @ x + self.B * sent[self.ago(tick - out)]
        return np.array([*x, *sent[:past], *counts[:past], code_before, memory, force_before])

    def ago(self, tick: int) -> int:
        """How many cycles before this one the cycle of a tick began."""
        found = 0
        while tick < 0:
            tick, found = tick + self.bus[0], found + 1
        return found

    def code(self, gain, force, force_before, seen, memory):
        given = self.given
        if self.law == "pi":
            memory = memory - given["integral_rad_per_s"] * TICK_S * force
            return gain * (memory - force), memory
        if self.law == "lead":
            # bilinear: (1 + s/wz) / (1 + s/wp), memory as a direct form with one state
            z, p = (2 / TICK_S / (2 * math.pi * given[f"lead_{k}_hz"]) for k in ("zero", "pole"))
            b0, b1, a1 = (1 + z) / (1 + p), (1 - z) / (1 + p), (1 - p) / (1 + p)
            now = -force - a1 * memory
            return gain * (b0 * now + b1 * memory), now
        if self.law == "pd":
            rate = (force - force_before) / TICK_S
            return gain * (-force - given["derivative_s"] * rate), 0.0
        if self.law == "impedance":
            velocity = (seen[0] - seen[1]) / (self.bus[0] * TICK_S)
            force = force + given["stiffness_N_per_m"] * seen[0]
            force += given["damping_Ns_per_m"] * velocity
        return -gain * force, 0.0

    def limit(self, near: float) -> float:
        """The smallest gain with a pole at the boundary, by bisection from a stable gain."""
        low, high = 0.5 * near, 1.5 * near
        assert self.radius(low) < 1 < self.radius(high)
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (middle, high) if self.radius(middle) < 1 else (low, middle)
        return (low + high) / 2


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("bus", BUSES)
@pytest.mark.parametrize("timing", ["zoh", "zoh+1"])
def test_limit_is_that_of_the_stepped_loop(tmp_path, law, bus, timing):
    path = model(tmp_path, bus)
    found = force_loop(path, law, timing, **LAWS[law]).limit()
    stepped = Stepped(path, law, bus, int(timing == "zoh+1"))
    if not found.gain:
        assert stepped.radius(1e-9) > 1 - 1e-9, found.reason
        return
    assert found.gain == pytest.approx(stepped.limit(found.gain), rel=1e-6)


def test_poles_are_those_of_the_plant_lifted_by_scipy(tmp_path):
    """Held for 3 ticks, 3 ticks late: the plant sampled every 2 ms with a delay of one sample."""
    path, gain = model(tmp_path, (3, 3, 0)), 0.01
    plant = linearise(path)
    A, B, C, _, _ = signal.cont2discrete((plant.A, plant.B, plant.C, plant.D), 3 * TICK_S)
    n = len(A)
    closed = np.block([[A, B], [-gain * C, np.zeros((1, 1))]])
    found = force_loop(path).closed(gain).poles().astype(complex)
    found = found[np.abs(found) > 1e-6]  # the states that no output shows are at 0
    expected = np.linalg.eigvals(closed)
    assert len(found) == n + 1
    for pole in expected:
        assert np.abs(found - pole).min() < 1e-9


@pytest.mark.parametrize("law", ["p", "pi"])
def test_a_cycle_of_one_tick_and_one_tick_late_is_latency(tmp_path, law):
    """Over a bus of one tick that is one tick late, the code acts as with a latency of one tick."""
    late = force_loop(paths.MODELS / "fig4_19.toml", law, "zoh+1", **LAWS[law])
    bus = force_loop(model(tmp_path, (1, 1, 0)), law, "zoh", **LAWS[law])
    gain = late.limit().gain / 2
    assert bus.limit().gain == pytest.approx(late.limit().gain, rel=1e-11)
    expected, found = over.figures(late, gain), over.figures(bus, gain)
    for name in ("fS_Hz", "fT_Hz", "Ms", "gain_margin", "phase_margin_deg"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-7), name


def test_the_worst_of_a_set_is_that_of_its_members(tmp_path):
    path = model(tmp_path, (3, 3, 3))
    plants = PlantSet(str(path), ranges={"k_w": (2e5, 1.5e5, 2.5e5)})
    found = over.largest_gain(plants)
    for stiffness in np.linspace(1.5e5, 2.5e5, 7):
        assert found.gain <= force_loop(path, overrides={"k_w": stiffness}).limit().gain * (
            1 + 1e-9
        )
    gain = found.gain / 2
    worst = over.worst(plants, gain=gain)
    alone = over.figures(force_loop(path), gain)
    assert worst.Ms >= alone.Ms and worst.gain_margin <= alone.gain_margin
    assert worst.gain_margin == pytest.approx(2.0, rel=1e-6)


def test_the_loop_says_what_it_was_measured_under(tmp_path):
    assert force_loop(model(tmp_path, (3, 3, 2))).timing == "zoh, cycle 3 ticks, 3 out, 2 in"
    assert force_loop(model(tmp_path, (1, 0, 0))).timing == "zoh"
    chosen = {"k_w": (2e5, 1.5e5, 2.5e5)}
    plants = PlantSet(str(model(tmp_path, (3, 3, 2))), ranges=chosen)
    found = sets.LoopSet(plants, ("zoh", "zoh+1"), LoopSpec(), None, None)
    assert sets._analysed(found).loop.timing == "zoh and zoh+1, cycle 3 ticks, 3 out, 2 in"


def test_what_does_not_know_the_bus_refuses(tmp_path):
    path = model(tmp_path, (3, 3, 0))
    with pytest.raises(
        _core.InputError, match=r"drive\.cycle_ticks: expected a bus cycle of 1 tick"
    ):
        LoopSpec(timing="continuous").around(path)
    bode = [sys.executable, "-m", "forceaxis", "loop", "bode", str(path)]
    found = subprocess.run(bode, capture_output=True, text=True, check=False)
    assert found.returncode == 2 and "drive.cycle_ticks" in found.stderr, found


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_run_is_stable_below_the_limit_and_not_above(tmp_path, share):
    """Firmware, bus and plant of a run, with 16 bits, at both sides of the computed limit."""
    file = model(tmp_path, (3, 3, 3))
    loop = force_loop(file)
    text = (paths.EXPERIMENTS / "fig4_19.toml").read_text().split("[plot]")[0]
    gain = loop.firmware_gain(share * loop.limit().gain)
    text = text.replace("../models/fig4_19.toml", file.name)
    text = text.replace("force_gain = 5.0", f"force_gain = {round(gain * 256) / 256}")
    text = text.replace("duration_s = 4.0", "duration_s = 20.0")
    (tmp_path / "run.toml").write_text(text)
    result = _core.run(str(tmp_path / "run.toml"), [])
    assert (result.verdict == "stable") == (share < 1)
