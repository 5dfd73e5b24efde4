"""The evaluation of force laws in C++ against NumPy formulas, and against eigenvalue problems."""

import math
import os
import subprocess
import sys
from dataclasses import replace

import law_oracle
import numpy as np
import pytest
from forceaxis import _core, paths
from forceaxis.design import certificate, data_sheet, new, reduced, structures
from forceaxis.design.grid import Bounds, Goal, Grid
from forceaxis.linear import over
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import PlantSet, ranges_of
from forceaxis.linear.precise import FIGURES, PreciseLoops, Responses
from forceaxis.linear.system import find_model

MODELS = ("laboratory", "laboratory_grip", "fig4_19", "full_axis")
TIMINGS = (("zoh",), ("zoh", "zoh+1"), ("zoh+1",))


def random_set(rng):
    """A set of two plants or more of one model, with one delay or two."""
    model = MODELS[rng.integers(len(MODELS))]
    width = rng.uniform(5, 60)
    ranges = ranges_of(model, [f"k_w={width}%", "m_w=30%"])
    plants = PlantSet(model, {}, ranges)
    members = plants.random(int(rng.integers(2, 5)), seed=int(rng.integers(1000)))
    return plants, members, TIMINGS[rng.integers(len(TIMINGS))]


def random_bounds(rng, timings):
    return Bounds(
        tuple(rng.uniform(1.2, 3.0, len(timings)).tolist()),
        rng.uniform(1.5, 4.0),
        rng.choice([None, 30.0, 50.0]),
        rng.choice([15.0, 80.0, 1e6]),
    )


def wide_bounds(name):
    """Limits of a structure's numbers that also permit narrow poles, and laws that are so slow or
    so steep that the bandwidth is 0."""
    limits = structures.bounds(name, 2.0)
    limits[:1, 0] = math.log(0.01)
    limits[4::4, 0] = math.log(0.005)
    return limits


def compare(laws, seed):
    """Compares (bandwidth, gain) of some random laws and sets with the oracle. Returns the number
    of laws that the firmware can store, and the number of laws with the bandwidth 0."""
    rng, legal, zero = np.random.default_rng(seed), 0, 0
    for _ in range(laws // 50):
        plants, members, timings = random_set(rng)
        grid = Grid(plants, members, timings, density=rng.choice([1 / 3, 1.0]))
        own = law_oracle.Grid(grid)
        bounds = random_bounds(rng, timings)
        ramp_s = rng.uniform(0.05, 0.5)
        loops = [plants.loop(member) for member in members]
        ramps = grid.ramp(members, ramp_s), law_oracle.Ramp(loops, law_oracle.delays(own), ramp_s)
        for name in structures.STRUCTURES:
            limits = wide_bounds(name)
            rows = rng.uniform(*limits.T, (13, len(limits))) if len(limits) else np.zeros((1, 0))
            found = grid.evaluate(rows, bounds, ramps[0] if len(limits) else None)
            for numbers, values in zip(rows, found, strict=True):
                bank = structures.bank(numbers, 1.0)
                if not structures.is_legal(bank.sections):
                    assert np.all(values == 0)
                    continue
                true = law_oracle.evaluate(numbers, bank, own, bounds, ramps[1])
                legal += 1
                zero += true[0] == 0
                np.testing.assert_allclose(values, true, rtol=1e-9, atol=0, equal_nan=False)
    return legal, zero


def test_the_evaluation_has_the_values_of_the_oracle():
    legal, zero = compare(500, seed=30)
    assert legal > 200 and 0 < zero < legal / 2


@pytest.mark.long
def test_ten_thousand_random_laws_and_sets_have_the_values_of_the_oracle():
    legal, zero = compare(20_000, seed=31)
    print(f"{legal} laws, {zero} with the bandwidth 0")
    assert legal >= 10_000 and zero > 0


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


@pytest.fixture(scope="module")
def velocity_drive(tmp_path_factory):
    """A model whose drive has an integral in its velocity loop, so that its force loop has one."""
    sheet = {"drive": "velocity", "workpiece_stiffness_n_per_m": "4e5", "workpiece_mass_kg": "4"}
    values, sources = data_sheet.collect(sheet)
    path = tmp_path_factory.mktemp("velocity") / "model.toml"
    path.write_text(new.render("model.toml", "axis", new.derive(values), sources))
    return path


def compare_precise(plants, members, timings, bank, errors):
    """Compares the precise figures of all loops with those of the eigenvalue problems. errors:
    permitted relative error of each figure. Returns the precise figures."""
    spec = LoopSpec("bank", bank=bank)
    loops = PreciseLoops.of(Responses(plants, timings), timings, spec, None, None)
    rows = []
    for member, found in zip(members, loops.figures(members), strict=True):
        for timing, row in zip(timings, found, strict=True):
            loop = plants.loop(member, timing, spec)
            true = over.figures(loop, loop.gain_of(bank.force_gain))
            assert row.stable and row.sag == true.sag
            rows.append(row)
            for name, error in errors.items():
                value, expected = getattr(row, name), getattr(true, name)
                if expected is None:
                    assert value is None
                else:
                    assert value == pytest.approx(abs(expected), rel=error), (name, timing)
    return rows


# Cycle in ticks, delay of the command and of the position in ticks.
BUSES = [(3, 3, 1), (3, 4, 2), (6, 1, 7), (1, 2, 3)]


@pytest.fixture(scope="module")
def on_a_bus(tmp_path_factory):
    """Models of fig4_19 whose drive is on a bus."""
    folder = tmp_path_factory.mktemp("bus")
    text = (paths.MODELS / "fig4_19.toml").read_text()
    (folder / "thesis.toml").write_text((paths.MODELS / "thesis.toml").read_text())
    for bus in BUSES:
        keys = "cycle_ticks = {}\ndelay_ticks_out = {}\ndelay_ticks_in = {}\n".format(*bus)
        model = folder / "bus_{}_{}_{}.toml".format(*bus)
        model.write_text(text.replace("[drive]\n", "[drive]\n" + keys))
    return folder


@pytest.mark.parametrize("bus", BUSES)
def test_precise_figures_over_a_bus_are_those_of_the_lifted_loop(on_a_bus, bus):
    model = on_a_bus / "bus_{}_{}_{}.toml".format(*bus)
    plants = PlantSet(model, {}, ranges_of(model, ["k_w=30%,m_w=30%"]))
    members, timings = [*plants.nominal(), *plants.random(2)], ("zoh", "zoh+1")
    # |T| of the search is |L / (1 + L)|, without the cycle of the set-point.
    errors = dict.fromkeys(FIGURES, 1e-8) | {"fT_Hz": 0.02}
    for gain, count in ((0.3, 0), (0.2, 1), (0.1, 5)):
        numbers = np.log([3.0, 39.5, 0.07, 69.0, 0.67])[:count]
        compare_precise(plants, members, timings, structures.bank(numbers, gain), errors)


@pytest.mark.parametrize("model", [*MODELS, "velocity_drive"])
def test_precise_figures_are_those_of_the_eigenvalue_problems(model, request):
    if model == "velocity_drive":
        model = request.getfixturevalue(model)
    plants = PlantSet(model, {}, ranges_of(model, ["k_w=30%,m_w=30%"]))
    members, timings = [*plants.nominal(), *plants.random(2)], ("zoh", "zoh+1")
    numbers = np.log([7.0, 39.5, 0.07, 69.0, 0.67])
    sags = zeros = 0
    laws = ((1.0, 1), (2.0, 0), (1.5, 5), (0.02, 0), (0.05, 1))  # (gain, count of numbers)
    if model not in MODELS:
        laws = laws[:3]  # with the others the bandwidth is below the grid
    for gain, count in laws:
        bank = structures.bank(numbers[:count], gain)
        errors = dict.fromkeys(FIGURES, 1e-8)
        for row in compare_precise(plants, members, timings, bank, errors):
            sags, zeros = sags + row.sag, zeros + (row.fS_Hz == 0)
    assert (sags > 0 and zeros > 0) or model not in MODELS


def keeps(plants, members, timings, bank, bounds):
    """Whether all loops are stable and within the bounds, by eigenvalue problems."""
    for member in members:
        for timing, ms in zip(timings, bounds.ms, strict=True):
            loop = plants.loop(member, timing, LoopSpec("bank", bank=bank))
            true = over.figures(loop, loop.gain_of(bank.force_gain))
            if not true.stable or true.Ms > ms:
                return False
            if true.gain_margin is not None and true.gain_margin < bounds.gain_margin:
                return False
    return True


def test_with_an_integral_in_plant_and_law_the_largest_gain_is_that_of_the_eigenvalue_problems(
    velocity_drive,
):
    """Such a loop has little phase margin at low gains, which bound the gain from below."""
    rng = np.random.default_rng(7)
    plants = PlantSet(velocity_drive, {}, ranges_of(velocity_drive, ["k_w=30%,m_w=30%"]))
    members, timings = [*plants.nominal(), *plants.random(2)], ("zoh", "zoh+1")
    grid = Grid(plants, members, timings)
    bounds = Bounds((2.0, 2.2), 2.3, None, 1e6)
    found, none = 0, 0
    for name in ("PI", "PI and one biquad") * 12:
        bank = structures.bank(rng.uniform(*structures.bounds(name, 2.0).T), 1.0)
        if not structures.is_legal(bank.sections):
            continue
        gain = grid.largest_gain(bank, 1e-9, bounds).gain
        if gain == 0:
            gains = np.geomspace(1e-4, 50, 30)
            assert not any(
                keeps(plants, members, timings, replace(bank, force_gain=g), bounds) for g in gains
            )
            none += 1
        elif gain < 200:
            for share, kept in ((0.99, True), (1.02, False)):
                near = replace(bank, force_gain=share * gain)
                assert keeps(plants, members, timings, near, bounds) is kept
            found += 1
    assert found >= 8 and none >= 1


def test_a_p_law_on_a_plant_with_an_integral_has_no_static_error(velocity_drive):
    plants = PlantSet(velocity_drive)
    grid = Grid(plants, plants.nominal(), ("zoh",))
    assert certificate.on_grid(grid, Bank(1.0)).static_error == 0


def test_a_loop_that_is_not_known_to_be_stable_has_no_precise_figures():
    plants = PlantSet("laboratory")
    spec = LoopSpec("bank", bank=structures.bank(np.zeros(0), 1.0))
    critical = plants.loop(plants.nominal()[0], "zoh", spec).limit().gain
    for factor, known in ((0.99, True), (1.01, False)):
        responses = Responses(plants, ("zoh",))
        loops = PreciseLoops.of(responses, ("zoh",), spec, factor * critical, None)
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
    responses = Responses(PlantSet("laboratory"), ("zoh",))
    assert PreciseLoops.of(responses, (spec.timing,), spec, 1.0, None) is None


def test_the_phase_margin_is_a_bound_of_the_gain():
    plants = PlantSet("laboratory")
    grid = Grid(plants, plants.nominal(), ("zoh",))
    bank = structures.bank(np.log([5.0]), 1.0)
    free = Bounds((1e6,), 1.0, 45.0, 1e9)
    limit = grid.largest_gain(bank, 1.0, free)
    spec = LoopSpec("bank", bank=structures.bank(np.log([5.0]), limit.gain))
    loop = plants.loop(plants.nominal()[0], "zoh", spec)
    margin = over.figures(loop, loop.gain_of(limit.gain)).phase_margin_deg
    assert limit.name == "pm" and math.isclose(abs(margin), 45.0, abs_tol=0.5)


def test_a_narrow_section_is_left_to_the_eigenvalue_problems():
    """A peak of the law could lie between two points of a grid that knows the plants only."""
    plants = PlantSet("fig4_19", {}, ranges_of("fig4_19", ["k_w=30%"]))
    sections = structures.bank(np.log([1.0, 10.875, 3.69e-4, 8.0826, 4.249e-4]), 1.0).sections
    spec = LoopSpec("bank", bank=Bank(0.008925, 0.0, 0.0, sections))
    responses = Responses(plants, ("zoh", "zoh+1"))
    assert PreciseLoops.of(responses, responses.timings, spec, None, None) is None
    assert not over.worst(plants, ("zoh", "zoh+1"), spec).stable


def known_and_stable(plants, bank):
    """(True if the evaluation knows that the nominal loop is stable, True if it is stable by
    eigenvalues)."""
    loops = PreciseLoops(Responses(plants, ("zoh",)), bank, None, ("zoh",))
    known = loops.figures(plants.nominal())[0][0] is not None
    loop = plants.loop(plants.nominal()[0], "zoh", LoopSpec("bank", bank=bank))
    return known, bool(loop.stable(loop.gain_of(bank.force_gain)))


@pytest.mark.parametrize("model", MODELS)
def test_a_loop_that_is_known_to_be_stable_is_stable(model):
    """Also with an integral or a gain of the wrong sign, and with unstable sections."""
    rng, plants = np.random.default_rng(7), PlantSet(model)
    count = {(False, False): 0, (True, True): 0, (False, True): 0}
    for _ in range(60):
        sections = [
            (*rng.uniform(-2, 2, 3), -2 * r * math.cos(turn), r * r)
            for r, turn in rng.uniform((0.5, 0), (1.05, 3), (rng.integers(3), 2)).tolist()
        ]
        bank = Bank(
            float(rng.choice([-1, 1, 1]) * np.exp(rng.uniform(-5, 2))),
            float(rng.choice([-3.0, 0.0, 3.0, 30.0])),
            0.0,
            tuple(sections),
        )
        count[known_and_stable(plants, bank)] += 1  # KeyError: known, but not stable
    assert all(count.values()), count


@pytest.mark.parametrize("gain", [1.0, -1.0])
def test_an_integral_of_the_wrong_sign_is_not_stable(gain):
    """The plant of the laboratory has a positive gain at rest. The integral of a negative one rises
    with the error, so the loop is unstable at every gain."""
    plants = PlantSet("laboratory")
    upside_down = ((-1.0, 0.0, 0.0, 0.0, 0.0),) if gain > 0 else ()
    assert known_and_stable(plants, Bank(0.5 * gain, 5.0, 0.0, upside_down)) == (False, False)


def test_a_bandwidth_below_the_grid_is_computed_from_eigenvalues():
    """The loop gain of a slow integral is k w_i / s, so that |S| is -3 dB at k w_i rad/s."""
    plants = PlantSet("laboratory")
    bank = Bank(1.0, 0.001)
    loop = plants.loop(plants.nominal()[0], "zoh", LoopSpec("bank", bank=bank))
    static = abs(loop.open.response([1e-6])[0]) * loop.gain_of(1.0) / 0.001 * 2e-6 * math.pi
    for rate in (0.001, 0.01, 0.02):
        slow = Bank(0.02 / static, rate)
        loops = PreciseLoops(Responses(plants, ("zoh",)), slow, None, ("zoh",))
        assert loops.figures(plants.nominal())[0][0] is None
        worst = over.worst(plants, ("zoh",), LoopSpec("bank", bank=slow))
        # S = s / (s (1 + k) + k w_i) with k = 0.02: |S| stays above -3 dB from some frequency on.
        k, half = 0.02, 0.5
        expected = k * rate * math.sqrt(half / (1 - half * (1 + k) ** 2)) / (2 * math.pi)
        assert worst.fS_Hz == pytest.approx(expected, rel=1e-2)


def test_the_figures_of_an_unstable_law_are_not_shown():
    plants = PlantSet("laboratory", {}, ranges_of("laboratory", ["k_w=30%"]))
    search = reduced.ShortSearch(plants, Goal(), random=0)
    spec = LoopSpec("p")
    critical = over.largest_gain(plants, ("zoh", "zoh+1"), spec)
    loop = plants.loop(critical.member, critical.timing, spec)
    for factor, stable in ((0.99, True), (1.01, False)):
        found = search.at(Bank(factor * loop.firmware_gain(critical.gain)))
        assert (found is not None) == stable
        if stable:
            assert found.gain_margin == pytest.approx(1 / factor, rel=1e-4)


def small_grid():
    plants = PlantSet("laboratory")
    return Grid(plants, plants.nominal(), ("zoh", "zoh+1")).core


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("ms", lambda g, law, b: g.largest_gain(law, 1.0, _core.LawBounds([2.0], 2.0, 0.0, 80.0))),
        ("ms", lambda g, law, b: g.gains(law, 1.0, _core.LawBounds([2.0], 2.0, 0.0, 80.0))),
        ("ms", lambda g, law, b: g.evaluate(
            np.zeros((1, 1)), _core.LawBounds([2.0], 2.0, 0.0, 80.0), None, [], 16.0)),
        ("ms", lambda g, law, b: _core.LawBounds([2.0, 1.0], 2.0, 0.0, 80.0)),
        ("gain_margin", lambda g, law, b: _core.LawBounds([2.0, 2.0], math.nan, 0.0, 80.0)),
        ("phase_margin_deg", lambda g, law, b: _core.LawBounds([2.0, 2.0], 2.0, 90.0, 80.0)),
        ("hf_gain", lambda g, law, b: _core.LawBounds([2.0, 2.0], 2.0, 0.0, 0.0)),
        ("plant", lambda g, law, b: g.frequency_hz(1)),
        ("plant", lambda g, law, b: g.response(1)),
        ("plant", lambda g, law, b: g.poles(1)),
        ("plant", lambda g, law, b: g.zeros(1)),
        ("plant", lambda g, law, b: g.count_per_code(1)),
        ("plant", lambda g, law, b: g.ramp([1], 0.1)),
        ("plants", lambda g, law, b: g.ramp([], 0.1)),
        ("ramp_s", lambda g, law, b: g.ramp([0], 0.0)),
        ("gains", lambda g, law, b: g.precise(law, [])),
        ("numbers", lambda g, law, b: g.evaluate(np.zeros(5), b, None, [], 16.0)),
        ("numbers", lambda g, law, b: g.evaluate(np.zeros((1, 4)), b, None, [], 16.0)),
        ("floors_hz", lambda g, law, b: g.evaluate(np.zeros((2, 1)), b, None, [1.0], 16.0)),
        ("numbers", lambda g, law, b: _core.law_coefficients([math.nan], 1 / 1500)),
    ],
)  # fmt: skip
def test_a_wrong_argument_of_the_evaluation_is_refused(name, call):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        call(small_grid(), _core.LawShape(0.0, []), _core.LawBounds([2.0, 2.2], 2.3, 0.0, 80.0))


@pytest.mark.parametrize(
    ("name", "delays", "density", "tick_s"),
    [
        ("delays", [], 1.0, 1e-3),
        ("delays", [-1], 1.0, 1e-3),
        ("density", [0], 0.0, 1e-3),
        ("density", [0], math.nan, 1e-3),
        ("tick_s", [0], 1.0, 0.0),
    ],
)
def test_a_wrong_grid_is_refused(name, delays, density, tick_s):
    model = _core.ModelFile(str(find_model("laboratory")))
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        _core.LawGrid(model, [({}, {})], delays, density, tick_s)


def test_a_grid_without_a_plant_has_no_figures():
    model = _core.ModelFile(str(find_model("laboratory")))
    empty = _core.LawGrid(model, [], [0], 1.0, 1 / 1500)
    with pytest.raises(ValueError, match="expected a plant with a path"):
        empty.figures(_core.LawShape(0.0, []), 1.0)


def test_a_law_that_is_not_finite_has_the_value_0():
    bounds = _core.LawBounds([2.0, 2.2], 2.3, 0.0, 80.0)
    rows = np.zeros((25, 5))
    rows[:] = np.log([7.0, 39.5, 0.07, 69.0, 0.67])
    for i, (column, bad) in enumerate(
        (column, bad) for column in range(5) for bad in (math.nan, math.inf, -math.inf, 800.0, -800)
    ):
        rows[i, column] = bad
    found = small_grid().evaluate(rows, bounds, None, [], 16.0)
    assert np.all(np.isfinite(found)) and np.all(found >= 0)
    assert np.all(found[np.isnan(rows).any(axis=1)] == 0)


# Functions of a program that prints all results of the evaluation as bytes.
PROGRAM = """
import sys
import numpy as np
from forceaxis.design import reduced, structures
from forceaxis.design.grid import Goal, Grid
from forceaxis.linear.plant_set import PlantSet, ranges_of
from forceaxis.linear.precise import law_shape

rng = np.random.default_rng(5)
for model in ("laboratory", "fig4_19", "full_axis"):
    plants = PlantSet(model, {}, ranges_of(model, ["k_w=30%,m_w=30%"]))
    members = plants.nominal() + plants.random(2)
    grid = Grid(plants, members, ("zoh", "zoh+1"))
    ramp = grid.ramp(members, 0.1)
    limits = structures.bounds("PI and two biquads", 2.0)
    rows = rng.uniform(*limits.T, (30, len(limits)))
    out = [grid.core.poles(i) for i in range(3)] + [grid.core.zeros(i) for i in range(3)]
    out += [grid.core.response(i) for i in range(3)]
    out.append(grid.evaluate(rows, Goal().bounds(), ramp))
    many = rng.uniform(*limits.T, (3000, len(limits)))
    out.append(Grid(plants, members[:1], ("zoh",), 1 / 3).evaluate(
        many, Goal(timings=("zoh",)).bounds()))
    banks = [structures.bank(row, 1.0) for row in many]
    out += [np.array([bank.integral_rad_per_s, *np.ravel(bank.sections)]) for bank in banks]
    for bank in banks[:30]:
        out.append(np.stack(grid.figures(bank)))
        out.append(grid.core.precise(law_shape(bank), [0.1] * len(members)))
    for one in out:
        sys.stdout.buffer.write(one.tobytes())
found = reduced.ShortSearch(PlantSet("laboratory"), Goal(), random=0).designed()
print(found.bank, found.numbers.tolist())
"""


def bytes_of(**environment):
    return subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=os.environ | environment,
        capture_output=True,
        check=True,
    ).stdout


def test_the_results_do_not_depend_on_the_processor():
    """The C library has other functions for processors without these instructions."""
    plain = bytes_of(
        GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL,-SSE4_1,-AVX",
        OPENBLAS_CORETYPE="Prescott",
    )
    assert len(plain) > 100_000 and plain == bytes_of()
