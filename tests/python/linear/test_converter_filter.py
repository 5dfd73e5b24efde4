"""Limits of force loops whose converter has a sinc filter, against a loop that is stepped with
integrals over its past; the response of a sensor with creep; what a drift leaves as it is."""

import itertools
import math
from fractions import Fraction
from pathlib import Path

import control
import numpy as np
import pytest
from forceaxis import _core, linear, paths
from forceaxis.linear import over
from forceaxis.linear.loops import LoopSpec, force_loop
from forceaxis.linear.periodic import FreeLoop
from forceaxis.linear.plant_set import PlantSet
from forceaxis.linear.precise import PreciseLoops, Responses
from forceaxis.linear.system import facts, linearise
from scipy import linalg

TICK_S = 1 / 1500
NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)
# Rate in Hz, phase and latency in ticks, cycle of the bus in ticks, order of the filter
SENSORS = [
    (1000, "1/4", "3", 1, 3),
    (1500, "0", "0", 1, 3),
    (500, "5/4", "1/2", 1, 4),
    (4800, "1/8", "3/4", 1, 5),
    (1000, "0", "1", 3, 5),
    (1000, "1", "2", 6, 3),
]


def model(folder: Path, adc: str, cycle: int = 1) -> Path:
    """Writes fig4_19 with further keys of its sensor."""
    text = (paths.MODELS / "fig4_19.toml").read_text()
    text = text.replace("[[adc]]\n", "[[adc]]\n" + adc)
    text = text.replace("[drive]\n", f"[drive]\ncycle_ticks = {cycle}\n")
    file = folder / "filtered.toml"
    file.write_text(text)
    (folder / "thesis.toml").write_text((paths.MODELS / "thesis.toml").read_text())
    return file


def keys(rate: int, phase: str | None, latency: str, order: int) -> str:
    found = f"sample_rate = {rate}\nlatency = {float(Fraction(latency)) * TICK_S!r}\n"
    if phase is not None:
        found += f"sample_phase = {float(Fraction(phase)) * TICK_S!r}\n"
    return found + f'converter_filter = "sinc{order}"\n'


def spline(order: int, x: float) -> float:
    """The N-fold convolution of a boxcar of the width 1, by truncated powers."""
    terms = ((-1) ** i * math.comb(order, i) * max(x - i, 0.0) ** (order - 1) for i in range(order))
    return sum(terms) / math.factorial(order - 1)


class Stepped:
    """The loop from tick to tick, whose state has the plant at the past ticks, the commands that
    acted from each of them on, and the codes of samples. A sample is an integral over the past, by
    Gauss's rule between the knots of the spline."""

    def __init__(self, path: Path, law: str, sensor: tuple[int, str, str, int, int]) -> None:
        plant = linearise(path)
        n = len(plant.A)
        self.block = np.zeros((n + 1, n + 1))
        self.block[:n, :n], self.block[:n, n:] = plant.A, plant.B
        self.C = np.append(plant.C[0], plant.D[0])
        self.law = law
        rate, phase, latency, self.cycle, self.order = sensor
        self.every, self.latency = Fraction(1500, rate), Fraction(latency)
        self.phase = Fraction(phase)
        self.period = math.lcm(self.every.numerator, self.cycle)
        self.past = math.ceil(self.order * self.every + self.latency + self.every) + 1
        self.whole = linalg.expm(self.block * TICK_S)
        self.rows = {}

    def newest(self, tick: int) -> Fraction:
        index = math.floor((tick - self.latency - self.phase) / self.every)
        return self.phase + index * self.every

    def over(self, tick: int, instant: Fraction) -> np.ndarray:
        """The row over plant and command at a tick of what the following tick adds to a sample."""
        key = instant - tick
        if key in self.rows:
            return self.rows[key]
        row = np.zeros(len(self.block))
        knots = {instant - i * self.every for i in range(self.order + 1)}
        inner = [k for k in knots if tick < k < tick + 1]
        ends = sorted({Fraction(tick), Fraction(tick + 1), *inner})
        for low, high in itertools.pairwise(ends):
            for node, weight in zip(NODES, WEIGHTS, strict=True):
                at = float(low - tick) + (node + 1) / 2 * float(high - low)
                age = float((key - Fraction(at)) / self.every)
                factor = spline(self.order, age) if 0 < age < self.order else 0.0
                if factor:
                    move = linalg.expm(self.block * at * TICK_S)
                    share = weight / 2 * float(high - low) * factor / float(self.every)
                    row += share * self.C @ move
        self.rows[key] = row
        return row

    def radius(self, gain: float) -> float:
        n = len(self.block)
        size = n * (self.past + 1) + 2
        unit = np.eye(size)
        # Plant and command at the present tick and before it, the newest first.
        seen = [unit[i * n : (i + 1) * n] for i in range(self.past + 1)]
        memory, reading_before = (unit[-2] if self.law == "pi" else 0 * unit[-2]), unit[-1]
        for tick in range(self.period):
            instant = self.newest(tick)
            reading = np.zeros(size)
            for i in range(1, len(seen)):
                if tick - i < instant and tick - i + 1 > instant - self.order * self.every:
                    reading += self.over(tick - i, instant) @ seen[i]
            error = -reading
            if self.law == "pi":
                memory = memory - 30.0 * TICK_S * reading
                error = error + memory
            if self.law == "pd":
                error = error - 0.002 * (reading - reading_before) / TICK_S
            reading_before = reading
            now = seen[0].copy()
            if tick % self.cycle == 0:
                now[-1] = gain * error
            seen = [self.whole @ now, now, *seen[1:-1]]
        after = np.vstack([*seen, memory, reading_before])
        return float(np.abs(np.linalg.eigvals(after)).max())


LAWS = {"p": {}, "pi": {"integral_rad_per_s": 30.0}, "pd": {"derivative_s": 0.002}}


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("law", LAWS)
def test_limit_is_that_of_the_stepped_loop(tmp_path, law, sensor):
    rate, phase, latency, cycle, order = sensor
    path = model(tmp_path, keys(rate, phase, latency, order), cycle)
    loop = force_loop(path, law, **LAWS[law])
    assert f"sinc{order}" in loop.timing
    gain, stepped = loop.limit().gain, Stepped(path, law, sensor)
    assert stepped.radius(gain * (1 - 1e-6)) < 1 < stepped.radius(gain * (1 + 1e-6))
    assert stepped.radius(gain / 2) < 1


def test_a_fast_filter_is_none(tmp_path):
    """At 30 kHz a sinc3 has a delay of 50 us, and the limit is that of samples so much older."""
    filtered = force_loop(model(tmp_path, keys(30000, "0", "0", 3))).limit().gain
    late = keys(30000, "1/40", "3/40", 3).replace('converter_filter = "sinc3"\n', "")
    assert filtered == pytest.approx(force_loop(model(tmp_path, late)).limit().gain, rel=1e-3)


def test_without_a_phase_the_worst_of_all_phases(tmp_path):
    free = force_loop(model(tmp_path, keys(1000, None, "3", 3)))
    assert isinstance(free, FreeLoop)
    gain = free.limit().gain
    for part in range(6):
        one = force_loop(model(tmp_path, keys(1000, str(Fraction(part, 4)), "3", 3)))
        assert one.limit().gain >= gain * (1 - 1e-4), part


@pytest.mark.parametrize("cycle", [1, 3])
def test_the_grid_of_a_search_agrees_with_the_lifted_loop(tmp_path, cycle):
    path = model(tmp_path, keys(1000, None, "3", 3), cycle)
    plants = PlantSet(str(path), ranges={"k_w": (2e5, 1.5e5, 2.5e5)})
    gain = force_loop(path).limit().gain / 2
    search = over.WorstSearch(Responses(plants, ("zoh",)), ("zoh",), LoopSpec(), gain)
    quick, exact = search.quick(), search.exact()
    for name in ("fS_Hz", "Ms", "gain_margin", "phase_margin_deg"):
        expected = getattr(exact, name)  # None: the loop gain stays below 1
        assert getattr(quick, name) == (expected and pytest.approx(expected, rel=0.01)), name


def test_what_cannot_know_the_filter_refuses(tmp_path):
    path = model(tmp_path, keys(1000, "0", "0", 3))
    with pytest.raises(_core.InputError, match=r"adc\.sample_rate: .* got 1000 Hz, sinc3, 0 ms"):
        LoopSpec(timing="continuous").around(path)
    assert facts(path).reading.sampling.sinc_order == 3


@pytest.mark.parametrize("share", [0.95, 1.2])
def test_a_run_is_stable_below_the_limit_and_not_above(tmp_path, share):
    loop = force_loop(model(tmp_path, keys(1000, "1/4", "3", 3)))
    text = (paths.EXPERIMENTS / "fig4_19.toml").read_text().split("[plot]")[0]
    gain = loop.firmware_gain(share * loop.limit().gain)
    text = text.replace("../models/fig4_19.toml", "filtered.toml")
    text = text.replace("force_gain = 5.0", f"force_gain = {round(gain * 256) / 256}")
    text = text.replace("duration_s = 4.0", "duration_s = 20.0")
    (tmp_path / "run.toml").write_text(text)
    result = _core.run(str(tmp_path / "run.toml"), [])
    assert (result.verdict == "stable") == (share < 1)


SLOW = "creep = 0.0005\ncreep_time = 600\ndrift = 3\ndrift_time = 900\n"


def test_creep_is_a_slow_pole_and_zero_and_drift_no_part_of_the_response(tmp_path):
    plain = linearise(model(tmp_path, ""), outputs=("reading", "sensor.spring_force"))
    slow = linearise(model(tmp_path, SLOW), outputs=("reading", "sensor.spring_force"))
    assert set(slow.states) - set(plain.states) == {"adc0.creep"}
    s = control.tf("s")
    creep = 1 + 0.0005 / (1 + 600 * s)
    hz = np.geomspace(1e-5, 700, 60)
    found, before = slow.response(hz)[:, :, 0].T, plain.response(hz)[:, :, 0].T
    assert np.all(abs(found[0] / before[0] - creep(2j * np.pi * hz)) < 1e-9)
    assert np.all(abs(found[1] / before[1] - 1) < 1e-9)
    drifting = linearise(model(tmp_path, "drift = 3\ndrift_time = 900\n"))
    assert drifting.states == plain.states and np.all(drifting.A == plain.A)


@pytest.mark.parametrize("law", ["p", "pi"])
def test_creep_leaves_a_loop_in_the_fast_search(tmp_path, law):
    """The evaluation in C++ knows the loop, and its figures are those of the eigenvalues."""
    path = model(tmp_path, SLOW)
    spec = LoopSpec(law, parameters=LAWS[law])
    loop = spec.around(path)
    gain = loop.limit().gain / 2
    responses = Responses(PlantSet(str(path)), ("zoh",))
    loops = PreciseLoops.of(responses, ("zoh",), spec, gain, None)
    (found,), *_ = loops.figures(PlantSet(str(path)).nominal())
    assert found is not None
    expected = over.figures(loop, gain)
    for name in ("fS_Hz", "fT_Hz", "Ms", "gain_margin", "phase_margin_deg"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-6), name


def test_a_slow_pole_that_is_no_creep_needs_the_eigenvalues(tmp_path):
    path = model(tmp_path, "creep = 0.05\ncreep_time = 600\n")
    loop = force_loop(path)
    responses = Responses(PlantSet(str(path)), ("zoh",))
    loops = PreciseLoops.of(responses, ("zoh",), LoopSpec(), loop.limit().gain / 2, None)
    (found,), *_ = loops.figures(PlantSet(str(path)).nominal())
    assert found is None


def test_the_limit_does_not_depend_on_creep_and_drift(tmp_path):
    plain = force_loop(model(tmp_path, "")).limit()
    slow = force_loop(model(tmp_path, SLOW)).limit()
    assert slow.gain == pytest.approx(plain.gain, rel=1e-4)
    assert slow.frequency_hz == pytest.approx(plain.frequency_hz, rel=1e-4)
    assert linear.facts(str(model(tmp_path, SLOW))).reading.sampling is None
