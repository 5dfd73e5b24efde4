"""The search for a bank: its grid against exact figures, bounds, result, what it refuses."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from forceaxis import _core, paths
from forceaxis.design import certificate, own_axis, search, simulate, structures
from forceaxis.design.grid import Bounds, Grid
from forceaxis.linear import over
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import PlantSet, ranges_of
from forceaxis.linear.precise import Responses, law_shape
from forceaxis.results import to_json

ROOT = Path(__file__).resolve().parents[3]
BOTH = ("zoh", "zoh+1")
SLOPES = ({}, {"drive.amplifier": "high outer"})
RANGES = ["k_w=30%,m_w=30%"]
# Of an integral and one section: rad/s, zero Hz and damping, pole Hz and damping.
NUMBERS = np.log([7.0, 39.5, 0.07, 69.0, 0.67])
FREE = Bounds((1e6, 1e6), 1.0, None, 1e9)


def plant_set(model="laboratory", ranges=RANGES, modes=SLOPES, overrides=None):
    values = overrides or {}
    return PlantSet(model, values, ranges_of(model, ranges, values), modes)


@pytest.fixture(scope="module")
def laboratory():
    plants = plant_set()
    return plants, Grid(plants, plants.nominal() + plants.corners(), BOTH)


def exact(plants, member, timing, numbers, gain):
    loop = plants.loop(member, timing, LoopSpec("bank", bank=structures.bank(numbers, gain)))
    return over.figures(loop, loop.gain_of(gain))


@pytest.mark.quick
def test_the_grid_has_the_exact_figures(laboratory):
    plants, grid = laboratory
    found = grid.figures(structures.bank(NUMBERS, 4.5))
    for j, member in enumerate(grid.members):
        for t, timing in enumerate(BOTH):
            true = exact(plants, member, timing, NUMBERS, 4.5)
            assert found.fS_Hz[j, t] == pytest.approx(true.fS_Hz, rel=3e-3)
            assert found.fT_Hz[j, t] == pytest.approx(true.fT_Hz, rel=3e-3)
            assert found.Ms[j, t] == pytest.approx(true.Ms, rel=3e-3)
    every = [exact(plants, m, t, NUMBERS, 4.5) for m in grid.members for t in BOTH]
    assert found.gain_margin.min() == pytest.approx(min(f.gain_margin for f in every), rel=5e-3)
    worst = min(abs(f.phase_margin_deg) for f in every)
    assert np.degrees(found.phase_margin_rad.min()) == pytest.approx(worst, rel=5e-3)


@pytest.mark.parametrize(
    ("name", "bounds", "hf"),
    [
        ("ms", Bounds((2.0, 2.2), 1.0, None, 1e9), 1.0),
        ("gm", Bounds((1e6, 1e6), 2.3, None, 1e9), 1.0),
        ("pm", Bounds((1e6, 1e6), 1.0, 45.0, 1e9), 1.0),
        ("hf", Bounds((2.0, 2.2), 2.3, None, 15.0), 7.5),
    ],
)
def test_the_largest_gain_is_where_its_bound_is_reached(laboratory, name, bounds, hf):
    plants, grid = laboratory
    gain, ended, place = grid.largest_gain(structures.bank(NUMBERS, 1.0), hf, bounds)
    assert ended == name
    if name == "hf":
        assert gain == 2.0 and place is None
        return
    member, timing, hz = place
    true = exact(plants, grid.members[member], BOTH[timing], NUMBERS, gain)
    if name == "ms":
        assert true.Ms == pytest.approx(bounds.ms[timing], rel=3e-3)
    elif name == "gm":
        assert true.gain_margin == pytest.approx(2.3, rel=5e-3)
    else:
        # At this gain |L| is 1 within the angle nowhere yet; a little more, and it is.
        assert abs(true.phase_margin_deg) == pytest.approx(45.0, abs=0.5)
    assert 0 < hz < 750


def test_a_section_has_its_zeros_and_poles_where_they_are_asked_for():
    b0, b1, b2, a1, a2 = structures.bank(np.log([1.0, 39.5, 0.07, 69.0, 0.67]), 1.0).sections[0]
    assert (b0 + b1 + b2) / (1 + a1 + a2) == pytest.approx(1.0, rel=1e-9)
    z = np.exp(2j * np.pi * 39.5 / 1500)
    at_zero = abs(b0 + b1 / z + b2 / z**2)
    near = [
        abs(b0 + b1 / z + b2 / z**2) for z in np.exp(2j * np.pi * np.array([38.0, 41.0]) / 1500)
    ]
    assert at_zero < min(near)
    poles = np.roots([1, a1, a2])
    assert np.all(abs(poles) < 1)
    # Bilinear with prewarping: at the pole's frequency the section's denominator is imaginary.
    z = np.exp(2j * np.pi * 69.0 / 1500)
    assert abs(np.angle((1 + a1 / z + a2 / z**2) * z / (z + 2 + 1 / z) * (1 + 0j))) == (
        pytest.approx(math.pi / 2, abs=1e-6)
    )


def test_the_numbers_and_their_bank_are_one_law(laboratory):
    _, grid = laboratory
    bounds, bank = search.Goal(adc_bits=12).bounds(), structures.bank(NUMBERS, 1.0)
    gain = grid.evaluate(NUMBERS[None], bounds)[0, 1]
    steep = max(bank.hf_gain(), grid.noise_gain(bank))
    assert grid.largest_gain(bank, steep, bounds).gain == pytest.approx(gain, rel=1e-9)


def test_a_ramp_is_followed_as_the_loop_follows_it(laboratory):
    plants, _ = laboratory
    member = plants.nominal()[0]
    ramp = Grid(plants, [member], ("zoh",)).ramp([member], 0.1)
    for rate in (7.0, 25.0):
        numbers = np.log([rate, *np.exp(NUMBERS[1:])])
        loop = plants.loop(member, "zoh", LoopSpec("bank", bank=structures.bank(numbers, 4.5)))
        closed = loop.closed(loop.gain_of(4.5))
        state, response = np.zeros(len(closed.A)), []
        for setpoint in np.clip(np.arange(1500) / 150, 0, 1):
            response.append(closed.C[0] @ state + closed.D[0, 0] * setpoint)
            state = closed.A @ state + closed.B[:, 0] * setpoint
        excess = ramp.excess(law_shape(structures.bank(numbers, 1.0)), 4.5)
        if rate == 7.0:
            assert excess == 0.0 and max(response) < 1.055
        else:
            assert excess == pytest.approx(max(response) - 1.055, abs=3e-3) and excess > 0.05


@pytest.fixture
def fast(monkeypatch):
    monkeypatch.setattr(search, "RANDOM", 30)
    monkeypatch.setattr(search, "PROBE_RANDOM", 10)
    monkeypatch.setattr(search, "RESTARTS", (1, 1, 1))
    small = {n: structures.STRUCTURES[n] for n in ("P", "PI", "PI and one biquad")}
    monkeypatch.setattr(structures, "STRUCTURES", small)


def held(plants, found, goal):
    """The worst of the set keeps the goal, by figures that the search did not compute."""
    for timing in goal.timings:
        spec = LoopSpec("bank", bank=found.bank)
        worst = over.worst(plants, (timing,), spec)
        assert worst.stable
        if worst.sag:  # of a loop whose own bandwidth is above that of the set
            loop = plants.loop(worst.member["sag"][0], timing, spec)
            closed = loop.closed(loop.gain_of(found.bank.force_gain))
            below = closed.response(np.linspace(0.05, found.worst.fS_Hz, 4000))
            assert abs(below).min() >= math.sqrt(0.5)
        assert worst.Ms <= goal.ms_of(timing)
        assert worst.gain_margin >= goal.gain_margin
    assert found.bank == found.bank.quantised()
    assert found.bank.hf_gain() <= min(15 * 2.0 ** (goal.adc_bits - 8), 80)


@pytest.mark.usefixtures("fast")
def test_a_search_keeps_its_goal():
    plants, goal = plant_set("fig4_19", ["k_w=10%"], ({},)), search.Goal(adc_bits=12)
    said = []
    found = search.search(plants, goal, said.append)
    held(plants, found, goal)
    assert found.chosen == "PI and one biquad" and len(said) >= 3
    assert found.worst.fS_Hz > 2 * found.p.fS_Hz > 0
    assert [row.name for row in found.structures] == ["P", "PI", "PI and one biquad"]
    assert " is the limit" in found.limited_by


@pytest.mark.usefixtures("fast")
def test_a_search_is_repeated_to_the_bit_and_a_smaller_peak_of_S_costs_bandwidth():
    plants = plant_set("fig4_19", [], ({},))
    one, again, narrow = (
        search.search(plants, search.Goal(adc_bits=12, ms=ms, timings=("zoh",)))
        for ms in (2.0, 2.0, 1.4)
    )
    assert (one.bank, one.worst, one.limited_by) == (again.bank, again.worst, again.limited_by)
    assert one.worst.Ms_late is None and narrow.worst.Ms <= 1.4 < one.worst.Ms
    assert narrow.worst.fS_Hz < one.worst.fS_Hz


@pytest.mark.parametrize(
    ("says", "plants", "goal"),
    [
        ("ms: expected a number above 1", {}, {"ms": 1.0}),
        ("gain_margin: expected a number above 1", {}, {"gain_margin": 0.5}),
        ("timing: expected zoh or zoh+1", {}, {"timings": ("zoh+2",)}),
        ("ms: expected margins that a force law can keep", {}, {"gain_margin": 1e5}),
        (
            "expected a model with an ADC on channel 0",
            {"model": "fig3_7", "ranges": [], "modes": ({},)},
            {},
        ),
        ("expected a signal path", {"modes": ({"sensor": "apart"},)}, {}),
    ],
)
def test_what_cannot_be_designed_is_refused_in_one_line(says, plants, goal):
    with pytest.raises(_core.InputError) as caught:
        search.search(plant_set(**plants), search.Goal(**goal))
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_a_gain_that_breaks_the_set_is_lowered(laboratory):
    plants = plant_set(ranges=["k_w=30%"], modes=({},))
    _, grid = laboratory
    bank = structures.bank(NUMBERS, 7.0).quantised()
    goal = search.Goal(timings=("zoh+1",))
    assert over.worst(plants, goal.timings, LoopSpec("bank", bank=bank)).gain_margin < 2
    lowered, figures = certificate.exact(Responses(plants, goal.timings), grid, bank, goal)
    assert 3.0 < lowered.force_gain < 7.0
    assert 2.3 <= figures.gain_margin < 2.5 or 2.1 < figures.Ms_late <= 2.2


def test_a_gain_above_the_one_that_the_gain_margin_permits_is_not_tried(laboratory, monkeypatch):
    """The product of gain and gain margin is 13 at each gain, and Ms is small. So the first gain
    says that the largest one is 13 / 2.3, and the second one keeps the margins."""
    plants, grid = laboratory
    tried = []

    def worst(searches, *_):
        (bank,) = {search.gain for search in searches.values()}
        tried.append(bank)
        return {"zoh": over.Worst(True, 5.0, 9.0, 1.5, 13 / bank, 40.0)}

    monkeypatch.setattr(certificate, "_worst_of", worst)
    monkeypatch.setattr(
        certificate, "_searches", lambda _, bank: {"zoh": SimpleNamespace(gain=bank.force_gain)}
    )
    goal, bank = search.Goal(timings=("zoh",)), structures.bank(NUMBERS, 7.0).quantised()
    found, _ = certificate.exact(Responses(plants, ("zoh",)), grid, bank, goal)
    assert 0.98 * 13 / 2.3 < found.force_gain <= 13 / 2.3
    assert list(dict.fromkeys(tried)) == [pytest.approx(0.995 * 7, rel=1e-2), found.force_gain]


def test_an_integral_that_reduces_the_error_needs_no_loop(monkeypatch):
    """The other plants are looked at: an integral that acts the other way, two integrals, and one
    beside a pole at a frequency below the grid."""
    poles = np.array([-1e-12, -40.0 + 300j, -40.0 - 300j])
    doubtful, response = np.array([True, False, False]), np.array([0.3 - 2j, 0.1 - 1j])
    assert search._integrates(poles, doubtful, response)
    assert not search._integrates(poles, doubtful, response.conj())
    assert not search._integrates(np.array([0.0, 0.0, -40.0]), poles.real > -30, response)
    assert not search._integrates(np.array([0.0, -0.01, -40.0]), doubtful, response)
    assert not search._integrates(poles - 1e-3, doubtful, response)


@pytest.mark.parametrize("losses_max", [3, 1])
def test_the_contact_that_failed_last_is_simulated_first(monkeypatch, losses_max):
    """Of 40 contacts of a new axis, contact 17 is lost twice, and contact 30 is not stable."""
    simulated = []

    def rows(_bench, _bank, contacts, *_, **__):
        simulated.extend(contacts)
        return [
            SimpleNamespace(is_stable=i != 30, losses=2 * (i == 17), losses_max=4) for i in contacts
        ]

    monkeypatch.setattr(own_axis.simulate, "simulate_contacts", rows)
    trials, hard, fails = own_axis._Trials(None, range(40)), [], 30 if losses_max == 3 else 17
    assert trials.contacts_until(None, {}, hard, losses_max) is None
    assert hard == [fails] and simulated[0] == 0 and fails in simulated
    simulated.clear()
    assert trials.contacts_until(None, {}, hard, losses_max) is None and simulated == [fails]
    other = own_axis._Trials(None, range(17))
    assert len(other.contacts_until(None, {}, [5], losses_max)) == 17


@pytest.mark.parametrize("friction", [False, True])
def test_the_limits_after_a_loss_are_those_of_all_impacts(monkeypatch, friction):
    """Of 200 benches: each contact bears impacts up to a drawn one. The choice has the largest one
    that all of its contacts bear, then the largest sum; fewer than half of all runs say so."""
    rng, runs, most = np.random.default_rng(4), 0, 0
    plants = [{"f": 1.0}, {"f": 2.0}]
    monkeypatch.setattr(simulate.friction, "members", lambda _: plants if friction else [])
    factors = simulate.STRIKE_FACTORS
    for _ in range(200):
        borne = {}

        def job(case, _bank, plant, latency, loss, borne=borne):
            key = (tuple(loss.values()), case.setpoint_N, latency, tuple(plant.values()))
            return borne.setdefault(key, rng.choice([0.0, *factors])), case.strike_N_s / 0.1

        def run(jobs, *_):
            nonlocal runs
            runs += len(jobs)
            return [
                SimpleNamespace(verdict="stable" if hit <= up_to + 1e-9 else "unstable")
                for up_to, hit in jobs
            ]

        monkeypatch.setattr(simulate, "run", run)
        cases = [simulate.ContactCase(force, 0.01, 0.1) for force in (30.0, 60.0)]
        bench = SimpleNamespace(
            press_speed_code=lambda speed, share: round(1e5 * speed * share), cases=cases,
            frictions=[None] * friction, job=job,
        )  # fmt: skip
        loss = simulate.choose_loss(bench, None)
        choices = list(dict.fromkeys(key[0] for key in borne))
        found = {c: [up_to for key, up_to in borne.items() if key[0] == c] for c in choices}
        able = [c for c in choices if c[0] or not friction]
        best = max(able, key=lambda c: (min(found[c]), sum(found[c])))
        assert tuple(loss.objects.values()) == best
        assert loss.strike_N_s == pytest.approx(0.1 * min(found[best]))
        assert loss.strike_default_N_s == pytest.approx(0.1 * min(found[0, 300]))
        most += len(borne) * len(factors)
    assert runs < most / 2


def test_a_section_may_begin_near_the_bandwidth_of_pi(monkeypatch):
    """A search of another program reached 26 Hz; with zeros and poles four times above 18.5."""
    monkeypatch.setattr(search, "RANDOM", 10)
    monkeypatch.setattr(search, "PROBE_RANDOM", 5)
    plants = plant_set("fig4_19", [], ({},))
    found = search.search(plants, search.Goal(adc_bits=12, timings=("zoh",)))
    assert found.chosen == "PI and two biquads" and found.worst.fS_Hz > 24


def test_a_section_attenuates_a_mode_that_leaves_a_pi_law_no_bandwidth(monkeypatch):
    monkeypatch.setattr(search, "RANDOM", 10)
    monkeypatch.setattr(search, "PROBE_RANDOM", 5)
    plants = plant_set(str(ROOT / "tests/plant/light_mode.toml"), ["k_w=20%,m_w=20%"], ({},))
    goal = search.Goal(adc_bits=12)
    found = search.search(plants, goal)
    held(plants, found, goal)
    assert "biquad" in found.chosen and found.worst.fS_Hz > 0.5
    assert "PI" not in [row.name for row in found.structures]


@pytest.mark.parametrize(("error", "is_chosen"), [(0.019, True), (0.021, False)])
def test_p_with_more_than_the_permitted_static_error_is_not_chosen_and_named(error, is_chosen):
    worst = SimpleNamespace(static_error=error)
    p = SimpleNamespace(name="P", bandwidth_Hz=2.0, worst=worst, leaves_error=True)
    assert search._chosen([p], search.Goal()) is p
    assert (search._chosen([p], search.Goal(static_error_max=0.02)) is p) == is_chosen
    assert f"a static error of {100 * error:.2g} %" in str(search._no_gain([p]))
    pi = SimpleNamespace(name="PI", worst=SimpleNamespace(static_error=0.0))
    assert "only P" not in str(search._no_gain([p, pi]))


# Plant, the bandwidth in Hz that the best law of any structure reaches over its set: of the issue.
POSSIBLE = [(ROOT / "tests/plant/two_modes.toml", 20.9), ("fig4_19", 19.3)]


@pytest.mark.beside
@pytest.mark.long
@pytest.mark.parametrize(("model", "possible"), POSSIBLE)
def test_the_search_finds_the_order_of_the_law(model, possible):
    plants, goal = plant_set(str(model), modes=({},)), search.Goal(adc_bits=12)
    found = search.search(plants, goal)
    held(plants, found, goal)
    best = max(row.worst.fS_Hz for row in found.structures)
    assert found.worst.fS_Hz >= 0.95 * max(best, possible)


# Model, overrides, modes, ADC bits, least fS in Hz.
AXES = {
    "laboratory, 8 bits": ("laboratory", {}, SLOPES, 8, 5.0),
    "laboratory, 12 bits": ("laboratory", {}, SLOPES, 12, 6.5),
    "rigid robot": ("fig4_19", {}, ({},), 12, 10.0),
    "damped workpiece": ("laboratory", {"b_w": 363.0}, SLOPES, 12, 7.5),
    "soft pad": ("laboratory_grip", {}, SLOPES, 12, 5.5),
    "full axis": ("full_axis", {}, SLOPES, 12, 5.0),
}


@pytest.mark.beside
@pytest.mark.long
@pytest.mark.parametrize("name", AXES)
def test_bandwidth_over_the_set(name, tmp_path):
    model, overrides, modes, bits, least = AXES[name]
    plants, goal = plant_set(model, overrides=overrides, modes=modes), search.Goal(adc_bits=bits)
    found = search.search(plants, goal)
    held(plants, found, goal)
    assert found.worst.fS_Hz >= least
    if model == "laboratory" and not overrides:
        assert settles(found.bank, bits, tmp_path) <= 0.16  # of the bandwidth that the set has


def settles(bank, bits, folder):
    """Seconds to 5 % of the contact at 75 N; its peak and its error are checked."""
    stem = "hold_biquad" if bits == 8 else "hold_biquad_12bit"
    text = (paths.EXPERIMENTS / f"{stem}.toml").read_text()
    before, _, rest = text.partition("[firmware.bank_1]")
    rest = rest.partition("[[at]]")[2].partition("[expect]")[0]
    keys = "\n".join(f"{key} = {value}" for key, value in to_json(bank.keys()).items())
    text = f"{before}[firmware.bank_1]\n{keys}\n\n[[at]]{rest}"
    path = folder / "hold.toml"
    path.write_text(text.replace("../models", str(paths.MODELS)))
    columns = _core.run(str(path)).columns()
    force = np.asarray(columns["sensor.force"])
    time_s = np.arange(len(force)) / 1500
    assert force.max() <= 80.0
    assert abs(force[-1500:].mean() - 75.0) <= (0.45 if bits == 8 else 0.075)
    outside = np.flatnonzero(np.abs(force - 75.0) > 3.75)
    return time_s[outside[-1]] + 1 / 1500 - 0.244


@pytest.mark.parametrize("hf_gain", [None, 2.0])
def test_the_rows_of_all_structures_are_for_all_plants(hf_gain):
    """Also if the gain at high frequency is the limit, which says nothing about the worst plant."""
    plants = plant_set("fig4_19", modes=({},))
    found = search.search(plants, search.Goal(hf_gain=hf_gain))
    others = plants.random(search.RANDOM, search.SEED + 1)
    every = Grid(plants, plants.nominal() + plants.corners() + others, BOTH)
    for row in found.structures:
        bank, worst = row.bank.bank, row.worst
        figures = every.figures(bank)
        tight = 1 + 2e-3
        assert worst.fS_Hz < tight * figures.fS_Hz.min()
        assert worst.fT_Hz < tight * figures.fT_Hz.min()
        assert worst.gain_margin < tight * figures.gain_margin.min()
        assert max(worst.Ms, worst.Ms_late) > figures.Ms.max() / tight
        if row.name != found.chosen:  # on the same plants and another grid, not worse than there
            assert worst.fS_Hz > figures.fS_Hz.min() * 0.95


@pytest.mark.parametrize(("error", "said"), [
    (0.05, " P reaches 2 Hz, but leaves a static error of 5 %."),
    (0.0, " P reaches 2 Hz, without a static error too."),
])  # fmt: skip
def test_a_faster_P_is_said_with_the_static_error_that_it_leaves(error, said):
    """An axis that integrates has none: the text was that P leaves a static error of 0 %."""
    p = SimpleNamespace(name="P", bandwidth_Hz=2.0, worst=SimpleNamespace(static_error=error))
    chosen = SimpleNamespace(name="PI", bandwidth_Hz=1.5)
    problem = SimpleNamespace(ramp=None)
    assert search._costs(problem, [p, chosen], chosen, np.zeros(1)) == said
