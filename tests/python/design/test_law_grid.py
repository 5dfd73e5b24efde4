"""The evaluation of force laws in C++ against NumPy formulas, and against eigenvalue problems."""

import math

import law_oracle
import numpy as np
import pytest
from forceaxis.design import structures
from forceaxis.design.grid import Bounds, Grid
from forceaxis.linear import over
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import PlantSet, ranges_of
from forceaxis.linear.precise import FIGURES, PreciseLoops

MODELS = ("laboratory", "laboratory_grip", "fig4_19", "full_axis")
TIMINGS = (("zoh",), ("zoh", "zoh+1"), ("zoh+1",))


def random_set(rng):
    """A set of two plants or more of one model, with one delay or two."""
    model = MODELS[rng.integers(len(MODELS))]
    width = rng.uniform(5, 60)
    ranges = ranges_of(model, [f"k_w={width}%", "m_w=30%"])
    plants = PlantSet(model, {}, ranges)
    members = plants.random(int(rng.integers(1, 4)), seed=int(rng.integers(1000)))
    return plants, members, TIMINGS[rng.integers(len(TIMINGS))]


def random_bounds(rng, timings):
    return Bounds(
        tuple(rng.uniform(1.2, 3.0, len(timings)).tolist()),
        rng.choice([None, 1.1, 1.5]),
        rng.uniform(1.5, 4.0),
        rng.choice([None, 30.0, 50.0]),
        rng.choice([15.0, 80.0, 1e6]),
    )


def compare(laws, seed):
    """The largest relative difference of (bandwidth, gain) over some random laws and sets, and the
    number of laws that the firmware can store."""
    rng, worst, legal = np.random.default_rng(seed), 0.0, 0
    for _ in range(laws // 50):
        plants, members, timings = random_set(rng)
        grid = Grid(plants, members, timings, density=rng.choice([1 / 3, 1.0]))
        own = law_oracle.Grid(grid)
        bounds = random_bounds(rng, timings)
        ramp_s = rng.uniform(0.05, 0.5)
        loops = [plants.loop(member) for member in members]
        ramps = grid.ramp(members, ramp_s), law_oracle.Ramp(loops, law_oracle.delays(own), ramp_s)
        for name in structures.STRUCTURES:
            limits = structures.bounds(name, 2.0)
            rows = rng.uniform(*limits.T, (13, len(limits))) if len(limits) else np.zeros((1, 0))
            found = grid.evaluate(rows, bounds, ramps[0] if len(limits) else None)
            for numbers, values in zip(rows, found, strict=True):
                bank = structures.bank(numbers, 1.0)
                if not structures.is_legal(bank.sections):
                    assert np.all(values == 0)
                    continue
                true = law_oracle.evaluate(numbers, bank, own, bounds, ramps[1])
                legal += 1
                worst = max(worst, np.abs(values / true - 1).max())
    return worst, legal


def test_the_evaluation_has_the_values_of_the_oracle():
    worst, legal = compare(500, seed=30)
    assert legal > 200 and worst < 1e-9


@pytest.mark.long
def test_ten_thousand_random_laws_and_sets_have_the_values_of_the_oracle():
    worst, legal = compare(20_000, seed=31)
    print(f"{legal} laws, largest relative difference {worst:.1e}")
    assert legal >= 10_000 and worst < 1e-9


def test_the_result_does_not_depend_on_the_number_of_threads():
    rng = np.random.default_rng(1)
    plants, members, _ = random_set(rng)
    limits = structures.bounds("PI and two biquads", 2.0)
    rows = rng.uniform(*limits.T, (100, len(limits)))
    bounds = random_bounds(rng, ("zoh", "zoh+1"))
    one, two = (
        Grid(plants, members, ("zoh", "zoh+1"), threads=n).evaluate(rows, bounds) for n in (1, 2)
    )
    assert np.array_equal(one, two) and one[:, 0].max() > 0


@pytest.mark.parametrize("model", MODELS)
def test_precise_figures_are_those_of_the_eigenvalue_problems(model):
    plants = PlantSet(model, {}, ranges_of(model, ["k_w=30%,m_w=30%"]))
    members, timings = [*plants.nominal(), *plants.random(2)], ("zoh", "zoh+1")
    numbers = np.log([7.0, 39.5, 0.07, 69.0, 0.67])
    for gain, given in ((1.0, numbers[:1]), (2.0, numbers[:0]), (1.5, numbers)):
        spec = LoopSpec("bank", bank=structures.bank(given, gain))
        found = PreciseLoops.of(plants, timings, spec, None, None).figures(members)
        for member, rows in zip(members, found, strict=True):
            for timing, row in zip(timings, rows, strict=True):
                loop = plants.loop(member, timing, spec)
                true = over.figures(loop, loop.gain_of(gain))
                assert row.stable and row.sag == true.sag
                for name in FIGURES:
                    value, expected = getattr(row, name), getattr(true, name)
                    if expected is None:
                        assert value is None
                    else:
                        assert value == pytest.approx(abs(expected), rel=1e-8), name


def test_a_loop_that_is_not_known_to_be_stable_has_no_precise_figures():
    plants = PlantSet("laboratory")
    spec = LoopSpec("bank", bank=structures.bank(np.zeros(0), 1.0))
    critical = plants.loop(plants.nominal()[0], "zoh", spec).limit().gain
    for factor, known in ((0.99, True), (1.01, False)):
        loops = PreciseLoops.of(plants, ("zoh",), spec, factor * critical, None)
        row = loops.figures(plants.nominal())[0][0]
        assert (row is not None) == known
        if known:
            assert row.gain_margin == pytest.approx(1 / factor, rel=1e-9)


@pytest.mark.parametrize(
    "spec",
    [
        LoopSpec("pd", parameters={"derivative_s": 0.01}),
        LoopSpec("p", output="sensor.spring_force"),
        LoopSpec("p", timing="continuous"),
        LoopSpec("p", parameters={"velocity_gain_Vs_per_m": 1.0}),
    ],
)
def test_other_loops_are_left_to_the_eigenvalue_problems(spec):
    assert PreciseLoops.of(PlantSet("laboratory"), (spec.timing,), spec, 1.0, None) is None


def test_the_phase_margin_is_a_bound_of_the_gain():
    plants = PlantSet("laboratory")
    grid = Grid(plants, plants.nominal(), ("zoh",))
    bank = structures.bank(np.log([5.0]), 1.0)
    free = Bounds((1e6,), None, 1.0, 45.0, 1e9)
    limit = grid.largest_gain(bank, 1.0, free)
    spec = LoopSpec("bank", bank=structures.bank(np.log([5.0]), limit.gain))
    loop = plants.loop(plants.nominal()[0], "zoh", spec)
    margin = over.figures(loop, loop.gain_of(limit.gain)).phase_margin_deg
    assert limit.name == "pm" and math.isclose(abs(margin), 45.0, abs_tol=0.5)


def test_a_narrow_section_is_left_to_the_eigenvalue_problems():
    """A peak of the law could lie between two points of a grid that knows the plants only."""
    plants = PlantSet("fig4_19", {}, ranges_of("fig4_19", ["k_w=30%"]))
    narrow = structures.section(10.875, 3.69e-4, 8.0826, 4.249e-4)
    spec = LoopSpec("bank", bank=Bank(0.008925, 0.0, 0.0, (narrow,)))
    assert PreciseLoops.of(plants, ("zoh", "zoh+1"), spec, None, None) is None
    assert not over.worst(plants, ("zoh", "zoh+1"), spec).stable
