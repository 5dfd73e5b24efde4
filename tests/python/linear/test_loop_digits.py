"""The digits of limits, margins and figures: against a computation of its own with 300 digits, and
the same under every kernel of OpenBLAS."""

import itertools
import json
import math
import random
import subprocess
import sys
from pathlib import Path

import draws
import kernels
import numpy as np
import pytest
from exact_loops import ExactLoop
from forceaxis import linear, paths
from forceaxis._core import InputError
from forceaxis.design import data_sheet, new
from forceaxis.linear import bank as banks
from forceaxis.linear import loops, over
from forceaxis.linear.system import System
from scipy import stats

ROOT = Path(__file__).resolve().parents[3]
TICK = 1 / 1500
BANK = banks.Bank(4.37, 8.0, 0.0, ((1.394373, -2.718615, 1.362417, -1.741615, 0.77979),))
BANK = BANK.quantised()
NO_READING = {
    p.stem
    for p in paths.MODELS.glob("*.toml")
    if p.stem == "thesis" or not linear.facts(p.stem).reading
}
# Stuck or in its backlash nothing moves what is read; the mode in which something does.
MOVES = {
    "nl_friction": {"rail": "forward"},
    "nl_stiction": {"rail": "forward"},
    "nl_backlash": {"screw.high": "pressed"},
}
MODELS = sorted(p.stem for p in paths.MODELS.glob("*.toml") if p.stem not in NO_READING)
CASES = [
    (name, timing, law)
    for name in MODELS
    for timing in loops.TIMINGS
    for law in ("p", "bank")
    if (law, timing) != ("bank", "continuous")
]
QUICK = CASES[::23]
OTHERS = [case for case in CASES if case not in QUICK]
REL = 1e-9


def exact(plant, timing, law):
    """The ExactLoop of a plant's matrices under a law."""
    sections = []
    if law == "bank":
        share = BANK.integral_rad_per_s * TICK
        sections = [((1 + share, -1.0), (1.0, -1.0))]
        sections += [((b0, b1, b2), (1.0, a1, a2)) for b0, b1, b2, a1, a2 in BANK.sections]
    period = None if timing == "continuous" else TICK
    return ExactLoop(plant.A, plant.B, plant.C, plant.D, period, timing == "zoh+1", sections)


def has_its_digits(model, timing, law, overrides=None, modes=None):
    """Every crossing, and the figures at two gains, to 1e-9."""
    plant = linear.linearise(model, overrides=overrides, modes=modes)
    true = exact(plant, timing, law)
    spec = loops.LoopSpec(law, timing, bank=BANK if law == "bank" else None)
    loop = spec.around(model, overrides, modes)
    limit = loop.limit()
    assert limit.known_to is None
    ends = (0, None, 0.5 / loop.dt if loop.dt else None)
    inside = [c for c in limit.crossings if c.gain and c.frequency_hz not in ends]
    expected = true.crossings()
    assert len(inside) == len(expected), (inside, expected)
    for own, (gain, hz) in zip(inside, expected, strict=True):
        assert own.gain == pytest.approx(gain, rel=REL)
        assert own.frequency_hz == pytest.approx(hz, rel=REL)
    if not limit.gain:
        return
    for share in (0.15, 0.5):
        own = over.figures(loop, share * limit.gain)
        assert own.stable
        for name, value in true.figures(share * limit.gain).items():
            if name == "gain_margin" and len(inside) < len(limit.crossings):
                continue  # one at an end of the axis, which is not among the reference's
            if value is None:  # the loop has no such figure
                assert getattr(own, name) is None, name
                continue
            assert getattr(own, name) == pytest.approx(value, rel=REL, abs=1e-12), name


DRIVE = """[[body]]
name = "axis"
mass = 3
[[contact]]
name = "wall"
between = ["axis", "ground"]
stiffness = 4e4
damping = 60
[[adc]]
channel = 0
signal = "wall.spring_force"
per_count = 0.05
[encoder]
body = "axis"
scale = 1e6
[drive]
type = "velocity"
body = "axis"
velocity_per_volt = 0.02
k_force = 25
current_bandwidth = 4000
"""


@pytest.mark.parametrize("timing", ["zoh", "zoh+1"])
@pytest.mark.parametrize("keys", ["k_velocity = 900\nintegral_time = 0.02\n",
                                  "bandwidth = 200\ntuned_mass = 3\n"])  # fmt: skip
def test_an_integral_above_a_velocity_loop_with_integral_has_its_digits(tmp_path, keys, timing):
    """Two integrators: rounding separates them by the root of its size, and no limit was found."""
    file = tmp_path / "model.toml"
    file.write_text(DRIVE + keys)
    has_its_digits(str(file), timing, "bank")
    has_its_digits(str(file), timing, "p")


@pytest.mark.parametrize(("name", "timing", "law"), QUICK)
def test_loops_have_their_digits(name, timing, law):
    has_its_digits(name, timing, law, modes=MOVES.get(name))


@pytest.mark.beside
@pytest.mark.long
@pytest.mark.parametrize(("name", "timing", "law"), draws.some("loops", OTHERS, len(OTHERS) // 3))
def test_every_loop_has_its_digits(name, timing, law):
    """Every third, drawn by the commit; with FORCEAXIS_WHOLE=1 all of them."""
    has_its_digits(name, timing, law, modes=MOVES.get(name))


# Of 200 digits by another program, V/N at Hz.
FAST = {1e-9: (278240.00839149440, 66825.66024), 1e-11: (27823565.138, None)}


@pytest.mark.parametrize("timing", loops.TIMINGS)
@pytest.mark.parametrize("inductance_h", [10.0**-n for n in range(5, 12)])
def test_a_winding_of_no_inductance_costs_no_digits(inductance_h, timing):
    has_its_digits("fig4_19", timing, "p", {"L": inductance_h})
    if timing != "continuous":
        return
    limit = loops.force_loop("fig4_19", timing=timing, overrides={"L": inductance_h}).limit()
    assert limit.stable_ranges == [(0.0, limit.gain)]
    if inductance_h in FAST:
        gain, hz = FAST[inductance_h]
        assert limit.gain == pytest.approx(gain, rel=1e-10)
        assert hz is None or limit.frequency_hz == pytest.approx(hz, rel=1e-9)


def dense(inverse_lag):
    """1 / ((s + 1)^2 (s / a + 1)) with its states turned so that each is a bit of all: the entries
    are as large as a, and their rounding is larger than what the slow states do."""
    a = inverse_lag
    A = np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, -a]])
    turn = stats.ortho_group.rvs(3, random_state=5)
    return System(
        turn @ A @ turn.T, turn @ [[0.0], [0.0], [a]], np.array([[1.0, 0.0, 0.0]]) @ turn.T,
        np.zeros((1, 1)), ("",) * 3, ("u",), ("y",),
    )  # fmt: skip


def loop_of(system):
    whole = System(
        system.A, system.B, np.vstack([system.C] * 2), np.vstack([system.D] * 2),
        system.states, ("error",), ("feedback", "y"), system.dt,
    )  # fmt: skip
    return loops.Loop("", "p", "", whole, "y", "V/N", None)


@pytest.mark.parametrize("inverse_lag", [10.0**n for n in range(2, 15)])
def test_where_rounding_decides_it_is_said(inverse_lag):
    """By Routh the limit is 2 (a + 1)^2 / a. From a = 1e6 on the entries' rounding moves it or
    takes it away: there is no other number then, and no "stable at every gain"."""
    a = inverse_lag
    system = dense(a)
    limit = loop_of(system).limit()
    true = ExactLoop(system.A, system.B, system.C, system.D).crossings()
    if a < 1e6:
        assert limit.gain == pytest.approx(2 * (a + 1) ** 2 / a, rel=1e-6)
        assert limit.gain == pytest.approx(true[0][0], rel=REL)
        assert limit.known_to is None or limit.known_to > limit.gain
        return
    assert limit.gain is None
    assert limit.known_to > 0
    assert not true or limit.known_to < true[0][0] * (1 + 1e-6)
    assert limit.stable_ranges == [(0.0, limit.known_to)]
    assert "above which rounding decides" in limit.reason


def drawn(rng, wide=30.0):
    """Values of a data sheet, within a factor of the defaults, that `forceaxis new` accepts."""
    left = {"approach_mm", "sensor_bits", "guide_coulomb_n", "backlash_mm", "sensor_noise_n"}
    # test_two_rates.py, test_converter_filter.py
    left |= {"sensor_rate_hz", "sensor_latency_ms", "sensor_filter"}
    while True:
        given = {}
        for field in data_sheet.FIELDS:
            if field.name in left or field.instead_of or field.word == "none":
                continue
            if field.needs and field.needs not in given:
                continue
            if field.default is None and rng.random() < 0.5:
                given[field.name] = 10 ** rng.uniform(4, 9)  # a stiffness
            elif not callable(field.default) and field.default and rng.random() < 0.6:
                value = field.default * wide ** rng.uniform(-1, 1)
                given[field.name] = min(max(value, field.low), field.high)
        try:
            values, sources = data_sheet.collect({n: repr(v) for n, v in given.items()})
            return new.render("model.toml", "drawn", new.derive(values), sources)
        except InputError:
            continue


def drawn_loops(folder, seed, numbers):
    rng = random.Random(seed)
    texts = [drawn(rng) for _ in range(max(numbers) + 1)]
    for i in numbers:
        model = folder / f"{i}.toml"
        model.write_text(texts[i])
        for _, timing, law in (c for c in CASES if c[0] == MODELS[0]):
            has_its_digits(str(model), timing, law)


def test_drawn_data_sheets_have_their_digits(tmp_path):
    drawn_loops(tmp_path, 28, [0])


@pytest.mark.beside
@pytest.mark.long
def test_thirty_drawn_data_sheets_have_their_digits(tmp_path):
    """A third of them, drawn by the commit; with FORCEAXIS_WHOLE=1 all of them."""
    drawn_loops(tmp_path, 29, draws.some("data sheets", range(30), 10))


# Kernels.


def numbers_in(value):
    if isinstance(value, dict):
        value = list(value.values())
    return list(itertools.chain(*map(numbers_in, value))) if isinstance(value, list) else [value]


def under_kernels(models):
    """The digits of models are the same under every kernel, and it is another one each time."""
    first, ran = None, {}
    for kernel in kernels.executed():
        done = subprocess.run(
            [sys.executable, kernels.__file__, *models], env=kernels.environment(kernel),
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        found = json.loads(done.stdout)
        ran[kernel] = tuple(found["running"])
        first = first or found["digits"]
        assert found["digits"].keys() == first.keys()
        for key, row in found["digits"].items():
            own, expected = numbers_in(row), numbers_in(first[key])
            assert len(own) == len(expected), (kernel, key)
            for value, other in zip(own, expected, strict=True):
                if isinstance(value, float) and isinstance(other, float):
                    assert math.isclose(value, other, rel_tol=REL), (kernel, key, value, other)
                else:
                    assert value == other, (kernel, key)
    assert all(ran.values()) and len(set(ran.values())) == len(ran), ran


@pytest.mark.quick
def test_the_sharpest_loops_have_the_same_digits_under_every_kernel():
    under_kernels(["fig4_19", "fig4_14", "full_axis", "laboratory"])


@pytest.mark.beside
@pytest.mark.long
def test_all_loops_have_the_same_digits_under_every_kernel():
    under_kernels([name for name in MODELS if name not in MOVES])


@pytest.mark.beside
@pytest.mark.long
def test_what_computes_digits_passes_under_other_kernels():
    """The tests of loops, sets and designs as they are, in a process of a kernel: two kernels drawn
    by the commit, or with FORCEAXIS_WHOLE=1 each that this processor executes."""
    files = [
        "python/linear/test_loops.py", "python/linear/test_over.py",
        "python/design/test_design_search.py",
    ]  # fmt: skip
    for kernel in draws.some("kernels", kernels.executed(), 2):
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not long",
             *(f"tests/{name}" for name in files)],
            env=kernels.environment(kernel), cwd=ROOT, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, (kernel, done.stdout[-4000:])
