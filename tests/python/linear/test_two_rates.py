"""Limits of force loops whose sensor samples with a clock of its own, against a loop that is
stepped from event to event, and against poles that python-control computes."""

import dataclasses
import math
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import control
import numpy as np
import pytest
from forceaxis import _core, paths
from forceaxis.linear import loops, over
from forceaxis.linear.lifted import Samples
from forceaxis.linear.loops import LoopSpec, force_loop
from forceaxis.linear.periodic import FreeLoop, PeriodicLoop
from forceaxis.linear.plant_set import PlantSet
from forceaxis.linear.precise import Responses
from forceaxis.linear.system import facts, linearise
from forceaxis.pages import design
from scipy import linalg

TICK_S = 1 / 1500
LAWS = {
    "p": {},
    "pi": {"integral_rad_per_s": 30.0},
    "pd": {"derivative_s": 0.002},
    "damping": {"damping_Ns_per_m": 900.0},
}
# Rate in Hz, phase and latency in ticks, cycle of the bus in ticks
SENSORS = [
    (1000, "1/4", "3", 1),
    (1000, "0", "0", 3),
    (500, "5/4", "1/2", 1),
    (4800, "0", "3/4", 1),
    (1200, "1", "1", 1),
    (1000, "1", "2", 6),
]


def model(folder: Path, sensor: tuple[int, str | None, str, int]) -> Path:
    """Writes fig4_19 with a sensor that samples with a clock of its own."""
    rate, phase, latency, cycle = sensor
    text = (paths.MODELS / "fig4_19.toml").read_text()
    keys = f"sample_rate = {rate}\nlatency = {float(Fraction(latency)) * TICK_S!r}\n"
    if phase is not None:
        keys += f"sample_phase = {float(Fraction(phase)) * TICK_S!r}\n"
    text = text.replace("[[adc]]\n", "[[adc]]\n" + keys)
    text = text.replace("[drive]\n", f"[drive]\ncycle_ticks = {cycle}\n")
    file = folder / f"sampled_{rate}_{str(phase).replace('/', '_')}_{cycle}.toml"
    file.write_text(text)
    (folder / "thesis.toml").write_text((paths.MODELS / "thesis.toml").read_text())
    return file


class Stepped:
    """A loop that goes from event to event, as sensor, firmware and drive do: samples, ticks,
    arrivals. Times are exact fractions of a tick."""

    def __init__(self, path: Path, law: str, sensor: tuple[int, str, str, int]) -> None:
        plant = linearise(path, outputs=("reading", "robot.position"))
        n = len(plant.A)
        self.block = np.zeros((n + 1, n + 1))
        self.block[:n, :n], self.block[:n, n:] = plant.A, plant.B
        self.C, self.law, self.given = plant.C, law, LAWS[law]
        self.rate, self.cycle = sensor[0], sensor[3]
        self.phase, self.latency = Fraction(sensor[1]), Fraction(sensor[2])
        every = Fraction(1500, self.rate)
        self.period = math.lcm(every.numerator, self.cycle)
        self.instants = [self.phase + k * every for k in range(-40, 40 + int(self.period / every))]
        self.moves = {}

    def move(self, z: np.ndarray, ticks: Fraction) -> np.ndarray:
        if ticks not in self.moves:
            self.moves[ticks] = linalg.expm(self.block * float(ticks) * TICK_S)
        return self.moves[ticks] @ z

    def step(self, gain: float, z: np.ndarray) -> np.ndarray:
        """Moves a complete state over one period. The plant's state with the held command comes
        first, then the samples of the last 40 instants before tick 0, memory of the law, reading
        and position of the last tick."""
        n = len(self.block)
        x, taken = z[:n].copy(), dict(enumerate(z[n : n + 40]))
        memory, reading_before, position_before = z[n + 40 :]
        now, index = Fraction(0), 40
        assert self.instants[39] < 0 <= self.instants[40]
        for tick in range(self.period):
            while self.instants[index] <= tick:
                x, now = self.move(x, self.instants[index] - now), self.instants[index]
                taken[index] = self.C[0] @ x[:-1]
                index += 1
            x, now = self.move(x, tick - now), Fraction(tick)
            arrived = [i for i in taken if self.instants[i] + self.latency <= tick]
            reading, position = taken[max(arrived)], self.C[1] @ x[:-1]
            error = -reading
            memory = memory if self.law == "pi" else 0.0
            if self.law == "pi":
                memory -= self.given["integral_rad_per_s"] * TICK_S * reading
                error += memory
            if self.law == "pd":
                error -= self.given["derivative_s"] * (reading - reading_before) / TICK_S
            if self.law == "damping" and tick % self.cycle == 0:
                travel = (position - position_before) / (self.cycle * TICK_S)
                error -= self.given["damping_Ns_per_m"] * travel
            if tick % self.cycle == 0:
                x[-1], position_before = gain * error, position
            reading_before = reading
        while self.instants[index] < self.period:
            x, now = self.move(x, self.instants[index] - now), self.instants[index]
            taken[index] = self.C[0] @ x[:-1]
            index += 1
        x = self.move(x, self.period - now)
        late = [taken[i] for i in range(index - 40, index)]
        return np.array([*x, *late, memory, reading_before, position_before])

    def radius(self, gain: float) -> float:
        size = len(self.block) + 43
        columns = [self.step(gain, unit) for unit in np.eye(size)]
        return float(np.abs(np.linalg.eigvals(np.array(columns).T)).max())

    def limit(self, near: float) -> float:
        low, high = 0.5 * near, 1.5 * near
        assert self.radius(low) < 1 < self.radius(high)
        for _ in range(30):
            middle = (low + high) / 2
            low, high = (middle, high) if self.radius(middle) < 1 else (low, middle)
        return (low + high) / 2


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("law", LAWS)
def test_limit_is_that_of_the_stepped_loop(tmp_path, law, sensor):
    path = model(tmp_path, sensor)
    loop = force_loop(path, law, **LAWS[law])
    found = loop.limit()
    assert found.gain == pytest.approx(Stepped(path, law, sensor).limit(found.gain), rel=1e-6)


def test_poles_are_those_of_the_plant_that_python_control_samples(tmp_path):
    """500 Hz, half a tick late at phase 0.5, and a bus of 3 ticks: tick 0 of a cycle has the sample
    that was taken 0.5 ticks after tick 0 of the cycle before."""
    path = model(tmp_path, (500, "1/2", "1/2", 3))
    plant = linearise(path, outputs=("reading",))
    continuous = control.ss(plant.A, plant.B, plant.C, plant.D)
    half, cycle = (
        control.sample_system(continuous, ticks * TICK_S, method="zoh") for ticks in (0.5, 3)
    )
    n, gain = len(plant.A), 0.01
    # States: plant and last sample. The code of a cycle is -gain times the last sample.
    closed = np.block([
        [cycle.A, -gain * cycle.B],
        [half.C @ half.A, -gain * half.C @ half.B],
    ])  # fmt: skip
    expected = np.linalg.eigvals(closed)
    found = force_loop(path).closed(gain).poles().astype(complex)
    found = found[np.abs(found) > 1e-6]
    assert len(expected) == n + 1 == len(found)
    for pole in expected:
        assert np.abs(found - pole).min() < 1e-9


@dataclasses.dataclass(frozen=True)
class Repeated(Samples):
    """Samples whose period is counted several times, so that a loop has several codes."""

    times: int = 3

    @property
    def period_ticks(self) -> int:
        return self.times * self.every.numerator


@pytest.mark.parametrize("law", LAWS)
def test_a_loop_whose_ticks_are_all_alike_has_the_figures_of_one_code(tmp_path, law):
    """A sensor of 1500 Hz that is one tick late, analysed by ticks, and by periods of three."""
    path = model(tmp_path, (1500, "0", "1", 1))
    spec = LoopSpec(law, parameters=LAWS[law])
    one = spec.around(path)
    site = loops._Site(facts(path), str(path), None, {})
    plant = loops._tick_plant(spec, site, 0.0, one)
    samples = Repeated(Fraction(1), Fraction(0), Fraction(1))
    three = loops._of_one_period(plant, site.known.bus, samples, one, spec)
    assert isinstance(three, PeriodicLoop) and not isinstance(one, PeriodicLoop)
    assert three.limit().gain == pytest.approx(one.limit().gain, rel=1e-9)
    assert three.limit().frequency_hz == pytest.approx(one.limit().frequency_hz, rel=1e-6)
    gain = one.limit().gain / 2
    assert three.decay(gain) == pytest.approx(one.decay(gain), rel=1e-8)
    found, expected = over.figures(three, gain), over.figures(one, gain)
    for name in ("fS_Hz", "Ms", "gain_margin", "phase_margin_deg"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-6), name
    margins = three.margins(gain), one.margins(gain)
    assert margins[0].crossover_hz == pytest.approx(margins[1].crossover_hz, rel=1e-6)
    assert three.closed(gain).poles_s().real.max() == pytest.approx(-one.decay(gain), rel=1e-8)
    hz = np.geomspace(1, 740, 40)  # the curves of the page of a design
    shown, drawn = (design.loop_gain(loop, gain, hz) for loop in (three, one))
    assert np.all(abs(shown - drawn) <= 1e-7 * (1 + abs(drawn)))


@pytest.mark.parametrize(("rate", "cycle"), [
    (1000, 1), (1000, 3), (4800, 1), pytest.param(80, 1, marks=pytest.mark.long),
])  # fmt: skip
def test_without_a_phase_limit_and_figures_are_the_worst_of_all_phases(tmp_path, rate, cycle):
    """Twelve phases in a period of samples and cycles are no worse by more than what lies between
    the analysed phases."""
    free = force_loop(model(tmp_path, (rate, None, "3", cycle)))
    assert isinstance(free, FreeLoop) and "any phase" in free.timing
    every = Fraction(1500, rate)
    gain = free.limit().gain
    worst = over.figures(free, gain / 2)
    for part in range(12):
        sensor = (rate, str(every * part / 12), "3", cycle)
        one = force_loop(model(tmp_path, sensor))
        assert one.limit().gain >= gain * (1 - 1e-4), part
        found = over.figures(one, gain / 2)
        assert found.Ms <= worst.Ms * 1.001 and found.fS_Hz >= worst.fS_Hz * 0.999, part
        assert found.phase_margin_deg >= worst.phase_margin_deg - 0.01, part


@pytest.mark.parametrize("cycle", [1, 3])
def test_the_grid_of_a_search_agrees_with_the_lifted_loop(tmp_path, cycle):
    """The grid of a search leaves out that the ages of readings mix frequencies, and over a bus it
    has the largest age."""
    path = model(tmp_path, (1000, None, "3", cycle))
    plants = PlantSet(str(path), ranges={"k_w": (2e5, 1.5e5, 2.5e5)})
    loop = force_loop(path)
    gain = loop.limit().gain / 2
    search = over.WorstSearch(Responses(plants, ("zoh",)), ("zoh",), LoopSpec(), gain)
    quick, exact = search.quick(), search.exact()
    for name in ("fS_Hz", "Ms", "gain_margin", "phase_margin_deg"):
        assert getattr(quick, name) == pytest.approx(getattr(exact, name), rel=0.01), name
    alone = over.figures(loop, gain)
    assert exact.Ms >= alone.Ms and exact.gain_margin <= alone.gain_margin


@pytest.mark.parametrize("share", [0.05, 0.5, 0.9])
def test_the_peak_of_S_is_the_largest_of_a_fine_grid(tmp_path, share):
    """The grid is of the loop gain; a peak may also be at half the rate of the periods."""
    loop = force_loop(model(tmp_path, (1200, "1", "1", 1)), "pi", integral_rad_per_s=5.0)
    gain = share * loop.limit().gain
    A, B, C, D = (getattr(loop._minimal, name).astype(float) for name in "ABCD")

    def size(turn):
        L = D + C @ np.linalg.solve(np.exp(1j * turn) * np.eye(len(A)) - A, B)
        return np.linalg.norm(np.linalg.inv(np.eye(len(D)) + gain * L), 2)

    low, high, points = 1e-4, math.pi, 3001
    for _ in range(5):
        turns = np.linspace(low, high, points)
        sizes = [size(turn) for turn in turns]
        top = int(np.argmax(sizes))
        low, high, points = turns[max(top - 1, 0)], turns[min(top + 1, points - 1)], 41
    assert loop.peak(gain) == pytest.approx(max(sizes), rel=2e-8)


def test_a_slow_sensor_has_the_figures_of_all_codes_of_a_period(tmp_path):
    """4 samples and 75 codes in a period: S, its component and poles from matrices of all codes,
    and Ms from fewer than a third of so many directions."""
    loop = force_loop(model(tmp_path, (80, "1", "1", 1)), "pi", integral_rad_per_s=5.0)
    gain = loop.limit().gain / 3
    codes = loop.codes
    A, B = (getattr(loop.whole, name).astype(float) for name in "AB")
    C, D = (getattr(loop.whole, name)[:codes].astype(float) for name in "CD")
    share = gain * np.linalg.inv(np.eye(codes) + gain * D)
    closed = A - B @ share @ C
    assert loop.decay(gain) == pytest.approx(
        -math.log(abs(np.linalg.eigvals(closed)).max()) / loop.dt, rel=1e-7
    )
    hz = np.geomspace(0.05, 9.9, 60)
    largest, mixed = [], []
    for at in hz:
        z = np.exp(2j * math.pi * at * loop.dt)
        L = D + C @ np.linalg.solve(z * np.eye(len(A)) - A, B)
        S = np.linalg.inv(np.eye(codes) + gain * L)
        turned = np.exp(2j * math.pi * at * loop.dt / codes * np.arange(codes))
        largest.append(np.linalg.norm(S, 2))
        mixed.append(turned.conj() @ S @ turned / codes)
    found = loop._sensitivity(gain).at(hz)
    assert np.linalg.norm(found, 2, axis=(1, 2)) == pytest.approx(largest, rel=1e-9)
    assert np.all(abs(loop.sensitivity_at(gain, hz) - mixed) < 1e-9)
    assert codes == 75 and loop.directions.shape[1] < codes / 3


def test_figures_that_are_not_needed_are_left_out(tmp_path):
    for sensor in ((1000, None, "3", 1), (1500, "0", "1", 1)):
        loop = force_loop(model(tmp_path, sensor))
        gain = loop.limit().gain / 2
        every = over.figures(loop, gain)
        some = over.figures(loop, gain, ("Ms", "gain_margin"))
        assert (some.stable, some.Ms, some.gain_margin) == (True, every.Ms, every.gain_margin)
        assert (some.fS_Hz, some.fT_Hz, some.phase_margin_deg) == (None, None, None)
        assert every.fS_Hz and every.phase_margin_deg


def test_what_cannot_know_the_samples_refuses(tmp_path):
    path = model(tmp_path, (1000, None, "3", 1))
    with pytest.raises(_core.InputError, match=r"adc\.sample_rate: .* samples at each tick"):
        LoopSpec(timing="continuous").around(path)
    with pytest.raises(_core.InputError, match=r"adc\.sample_rate: expected a sampling rate"):
        force_loop(model(tmp_path, (977, None, "0", 1)))
    bode = [sys.executable, "-m", "forceaxis", "loop", "bode", str(path)]
    found = subprocess.run(bode, capture_output=True, text=True, check=False)
    assert found.returncode == 2 and "adc.sample_rate" in found.stderr, found


@pytest.mark.parametrize("phase", ["0", "1/4", "1/2", "3/4", "1"])
@pytest.mark.parametrize("share", [0.95, 1.2])
def test_a_run_is_stable_below_the_limit_and_not_above(tmp_path, share, phase):
    """Firmware, sensor and plant of a run, with 16 bits, at both sides of the limit of any phase.
    The limits of the phases differ by 5 %; just above a limit the vibration grows slowly."""
    free = force_loop(model(tmp_path, (1000, None, "3", 1)))
    file = model(tmp_path, (1000, phase, "3", 1))
    text = (paths.EXPERIMENTS / "fig4_19.toml").read_text().split("[plot]")[0]
    gain = free.firmware_gain(share * free.limit().gain)
    text = text.replace("../models/fig4_19.toml", file.name)
    text = text.replace("force_gain = 5.0", f"force_gain = {round(gain * 256) / 256}")
    text = text.replace("duration_s = 4.0", "duration_s = 20.0")
    (tmp_path / "run.toml").write_text(text)
    result = _core.run(str(tmp_path / "run.toml"), [])
    assert (result.verdict == "stable") == (share < 1)
