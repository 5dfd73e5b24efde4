"""Figures of loops and of sets of them, against python-control and a sweep of their own."""

import json
import math
import warnings
from pathlib import Path

import control
import numpy as np
import pytest
import verbs
from forceaxis import _core, linear, paths
from forceaxis._core import InputError
from forceaxis.linear import bank as banks
from forceaxis.linear import loops, over, plant_set, settings
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.precise import FIGURES, PreciseLoops, Responses
from forceaxis.linear.request import LoopRequest
from forceaxis.linear.stability import Loop
from forceaxis.linear.system import System
from scipy import optimize

TICK = 1 / 1500
OUTER = {"drive.amplifier": "high outer"}
BANK = banks.Bank(4.37, 8.0, 0.0, ((1.394373, -2.718615, 1.362417, -1.741615, 0.77979),))
RANGES = ["k_w=30%,m_w=30%"]
# Plants of the thesis and variants of the laboratory: (model, overrides, modes).
PLANTS = [
    ("fig2_11", {}, {}),
    ("fig4_17", {}, {}),
    ("fig4_19", {}, {}),
    ("fig4_24", {}, {}),
    ("fig5_2", {}, {}),
    ("fig5_5", {}, {}),
    ("full_axis", {}, {}),
    ("laboratory", {}, {}),
    ("laboratory", {"k_w": 300000.0, "b_w": 363.0}, OUTER),
    ("laboratory_grip", {}, {}),
]
LAWS = ("p", "pi", "bank")
CASES = [(p, law, timing) for p in PLANTS for law in LAWS for timing in ("zoh", "zoh+1")]
QUICK = CASES[::7]  # of each plant, law and timing some


def name_of(case):
    (model, given, modes), law, timing = case
    return f"{model}{'-varied' * bool(given or modes)}-{law}-{timing}"


# Independent computations: python-control's hold, its delay, its series of the law's transfer
# functions; responses by dense solves.


def by_control(case):
    """L / k of a case as control.StateSpace."""
    (model, given, modes), law, timing = case
    plant = linear.linearise(model, overrides=given, modes=modes)
    system = control.sample_system(control.ss(plant.A, plant.B, plant.C, plant.D), TICK, "zoh")
    if timing == "zoh+1":
        system = control.ss([[0]], [[1]], [[1]], [[0]], TICK) * system
    if law == "p":
        return system
    w = 8.0 if law == "pi" else BANK.quantised().integral_rad_per_s
    system = system * control.tf2ss(control.tf([1 + w * TICK, -1], [1, -1], TICK))
    if law == "bank":
        (b0, b1, b2, a1, a2) = BANK.quantised().sections[0]
        system = system * control.tf2ss(control.tf([b0, b1, b2], [1, a1, a2], TICK))
    return system


def loop_of(case):
    (model, given, modes), law, timing = case
    more = {"pi": {"parameters": {"integral_rad_per_s": 8.0}}, "bank": {"bank": BANK.quantised()}}
    return LoopSpec(law, timing, **more.get(law, {})).around(model, given, modes)


def swept(system, gain):
    """(fS, fT, Ms, sag, phase margin) of a loop from responses alone: a sweep of 40,000
    frequencies, closer around the poles, refined between neighbours."""

    def at(hz):
        z = np.exp(2j * math.pi * np.atleast_1d(hz) * TICK)
        pencil = z[:, None, None] * np.eye(len(system.A)) - system.A
        return gain * (system.C @ np.linalg.solve(pencil, system.B + 0j))[:, 0, 0]

    closed = np.linalg.eigvals(system.A - gain * system.B @ system.C).astype(complex)
    roots = np.log(closed[np.abs(closed) > 1e-9]) / TICK
    near = [
        abs(root.imag) / (2 * math.pi) + np.linspace(-8, 8, 801) * abs(root.real) / (2 * math.pi)
        for root in roots
    ]
    grid = np.unique(np.concatenate([np.geomspace(1e-3, 750, 40000), *near]))
    grid = grid[(grid >= 1e-3) & (grid <= 750)]
    L = np.concatenate([at(part) for part in np.array_split(grid, 20)])

    def crossings(values, function, up, level=over.HALF_POWER):
        sign = values - level
        found = np.flatnonzero(sign[:-1] * sign[1:] < 0)
        return [
            optimize.brentq(lambda f: function(f) - level, grid[i], grid[i + 1], xtol=1e-12,
                            rtol=1e-13)
            for i in found if (sign[i] < 0) == up
        ]  # fmt: skip

    def S(f):
        return float(1 / abs(1 + at(f)[0]))

    def T(f):
        return float(abs(at(f)[0] / (1 + at(f)[0])))

    sizes, others = np.abs(1 / (1 + L)), np.abs(L / (1 + L))
    rises, falls = crossings(sizes, S, True), crossings(others, T, False)
    fS = 0.0 if sizes[0] >= over.HALF_POWER else min(rises, default=None)
    fT = None if others[-1] >= over.HALF_POWER else max(falls, default=0.0)
    sag = others[0] < over.HALF_POWER or min(falls, default=math.inf) < (fS or math.inf)
    i = int(np.argmax(sizes))
    low, high = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
    top = optimize.minimize_scalar(
        lambda f: -S(f), bounds=(low, high), method="bounded", options={"xatol": 1e-10 * high}
    )
    ones = [
        f for up in (True, False) for f in crossings(np.abs(L), lambda f: abs(at(f)[0]), up, 1.0)
    ]
    phase = min((float(np.degrees(np.angle(-at(f)[0]))) for f in ones), key=abs, default=None)
    return fS, fT, max(float(sizes[i]), -top.fun), sag, phase


def margin_by_poles(system, gain):
    """The factor above 1 at which python-control's closed loop loses stability."""

    def growth(factor):
        poles = control.feedback(gain * factor * system, 1).poles()
        return float(np.log(np.abs(poles)).max())

    factors = np.geomspace(1, 10, 60)
    first = next(i for i, factor in enumerate(factors) if growth(factor) > 0)
    return optimize.brentq(growth, factors[first - 1], factors[first], xtol=1e-14, rtol=1e-13)


def close(value, expected, rel=1e-6):
    if expected is None or value is None:
        return value == expected
    return value == pytest.approx(expected, rel=rel, abs=1e-9)


def agrees(case):
    loop, system = loop_of(case), by_control(case)
    limit = loop.limit().gain
    assert limit
    for share in (0.15, 0.5):
        found = over.figures(loop, share * limit)
        assert found.stable
        fS, fT, Ms, sag, phase = swept(system, share * limit)
        assert close(found.fS_Hz, fS), (found, fS)
        assert close(found.fT_Hz, fT), (found, fT)
        assert close(found.Ms, Ms), (found, Ms)
        assert found.sag == sag
        assert found.gain_margin == pytest.approx(margin_by_poles(system, share * limit), rel=1e-6)
        assert close(found.phase_margin_deg, phase)
    assert not over.figures(loop, 1.001 * limit).stable


@pytest.mark.parametrize("case", QUICK, ids=name_of)
def test_figures_agree_with_python_control_and_a_sweep(case):
    agrees(case)


@pytest.mark.long
@pytest.mark.parametrize("case", [c for c in CASES if c not in QUICK], ids=name_of)
def test_all_figures_agree_with_python_control_and_a_sweep(case):
    agrees(case)


def test_figures_of_a_loop_without_crossings():
    """A first-order lag: closed forms."""
    one = np.eye(1)
    whole = System(-one, one, np.vstack([one, one]), np.zeros((2, 1)), ("x",), ("error",),
                   ("feedback", "y"))  # fmt: skip
    loop = Loop("", "p", "continuous", whole, "y", "V/N", None)
    found = over.figures(loop, 9.0)  # S = (s + 1) / (s + 10), T = 9 / (s + 10)
    assert found.fS_Hz == pytest.approx(math.sqrt(98) / (2 * math.pi), rel=1e-9)
    assert found.fT_Hz == pytest.approx(math.sqrt(62) / (2 * math.pi), rel=1e-9)
    assert found.Ms == pytest.approx(1.0, rel=1e-9)
    assert (found.gain_margin, found.sag) == (None, True)  # |T| falls before |S| rises
    slack = over.figures(loop, 0.1)  # |S| starts at .91
    assert (slack.fS_Hz, slack.fT_Hz, slack.sag) == (0.0, 0.0, True)


# Sets.


def plants_of(modes=({}, OUTER)):
    return plant_set.PlantSet("laboratory", {}, plant_set.ranges_of("laboratory", RANGES), modes)


def not_better(worst, plants, timings, members, spec):
    """The worst found is at least as bad as each of some members."""
    for member in members:
        for timing in timings:
            loop = plants.loop(member, timing, spec)
            one = over.figures(loop, loop.gain_of(BANK.quantised().force_gain))
            assert one.stable
            for name, largest in over.FIGURES.items():
                ours, theirs = getattr(worst, name), getattr(one, name)
                if theirs is not None:
                    apart = (theirs - ours) if largest else (ours - abs(theirs))
                    assert apart <= 1e-9 * abs(ours), (name, ours, theirs, member)


def named(worst, plants, spec):
    """Each worst figure is that of the member that it names."""
    for name in over.FIGURES:
        member, timing = worst.member[name]
        loop = plants.loop(member, timing, spec)
        one = over.figures(loop, loop.gain_of(BANK.quantised().force_gain))
        assert getattr(one, name) == getattr(worst, name)
        for parameter, (_, low, high) in plants.ranges.items():
            assert low <= member.values[parameter] <= high


@pytest.mark.parametrize("law", [(8, 0), (30, 1), (200, 0.6), (100, 20)])
def test_a_pole_below_the_grid_leaves_a_loop_known_and_its_figures_exact(law):
    """A workpiece against a heavy damping: a pole at 0.005 Hz, where the grid begins at 0.02."""
    plants = plant_set.PlantSet("laboratory", {"b_r": 1e6, "k_w": 5e4}, {}, ({},))
    (member,) = plants.nominal()
    spec = LoopSpec("bank", bank=banks.Bank(float(law[0]), float(law[1])))
    both = ("zoh", "zoh+1")
    quick = PreciseLoops.of(Responses(plants, both), both, spec, None, None).figures([member])
    for timing, found in zip(both, quick[0], strict=True):
        loop = plants.loop(member, timing, spec)
        true = over.figures(loop, loop.gain_of(spec.bank.force_gain))
        assert (found is not None) == true.stable
        for name in FIGURES if found else ():
            assert getattr(found, name) == pytest.approx(getattr(true, name), rel=1e-6), name


def test_the_worst_is_worse_than_random_members():
    plants, spec = plants_of(), LoopSpec("bank", bank=BANK.quantised())
    worst = over.worst(plants, ("zoh",), spec)
    assert worst.stable
    not_better(worst, plants, ("zoh",), plants.random(40, seed=7), spec)
    named(worst, plants, spec)


@pytest.mark.long
@pytest.mark.beside
def test_the_worst_is_worse_than_three_hundred_random_members():
    plants, spec = plants_of(), LoopSpec("bank", bank=BANK.quantised())
    timings = ("zoh", "zoh+1")
    worst = over.worst(plants, timings, spec)
    not_better(worst, plants, timings, plants.random(300, seed=7), spec)
    assert over.worst(plants, timings, spec) == worst  # by seed


def test_the_search_analyses_only_the_delay_that_it_follows():
    """An analysis of a loop with a pd law takes milliseconds, so that the other delay is left out
    after the first plants."""
    plants = plant_set.PlantSet("laboratory", {}, plant_set.ranges_of("laboratory", RANGES))
    steps = []

    def analyse(members, timings):
        steps.append((len(members), tuple(timings)))
        return [{t: m.values["k_w"] + (t == "zoh+1") for t in timings} for m in members]

    group = over._Set(plants, ("zoh", "zoh+1"), analyse)
    group.cover(over.sample(plants))
    _, timing, value = group.worst(lambda value: value)
    assert timing == "zoh+1" and value == plants.ranges["k_w"][2] + 1
    assert steps[0][1] == ("zoh", "zoh+1") and set(steps[1:]) == {(1, ("zoh+1",)), (1, ("zoh",))}


def test_the_largest_gain_that_all_bear():
    plants = plants_of()
    largest = over.largest_gain(plants, ("zoh",))
    gain, member, timing, frequency_hz = (
        largest.gain, largest.member, largest.timing, largest.frequency_hz
    )  # fmt: skip
    for other in plants.random(60, seed=7):
        assert plants.loop(other, "zoh").limit().gain >= gain * (1 - 1e-9)
    # python-control's poles and margin at the member that is named.
    plant = linear.linearise("laboratory", overrides=member.values, modes=member.modes)
    system = control.sample_system(control.ss(plant.A, plant.B, plant.C, plant.D), TICK, "zoh")
    assert timing == "zoh"
    assert 0.3 * gain * margin_by_poles(system, 0.3 * gain) == pytest.approx(gain, rel=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # python-control takes a grid and says so
        gains, _, _, at, _, _ = control.stability_margins(system, returnall=True)
    smallest = int(np.argmin(gains))
    assert gain == pytest.approx(gains[smallest], rel=1e-3)
    assert frequency_hz == pytest.approx(at[smallest] / (2 * math.pi), rel=1e-3)


def test_an_unstable_member_is_named():
    worst = over.worst(plants_of(), force_gain=4.5)
    assert not worst.stable and worst.fS_Hz is None
    member, timing = worst.member["stable"]
    loop = plants_of().loop(member, timing)
    assert not loop.stable(loop.gain_of(4.5))


def test_the_modes_that_a_run_visits():
    assert over.modes_visited(paths.EXPERIMENTS / "contact.toml") == ({}, OUTER)
    assert over.modes_visited(paths.EXPERIMENTS / "fig4_19.toml") == ({},)
    # Softly enough pressed, the amplifier stays in its inner slope.
    soft = ["firmware.force_setpoint=2", "firmware.force_gain=0.5"]
    assert over.modes_visited(paths.EXPERIMENTS / "contact.toml", soft) == ({},)


def test_all_modes():
    assert over.modes_all("laboratory") == ({}, OUTER)
    stiff = {"support": "segment 2"}
    found = over.modes_all("laboratory_two_stiffnesses")
    assert len(found) == 4
    assert all(modes in found for modes in ({}, OUTER, stiff, stiff | OUTER))


# What an experiment's firmware is set to.


def test_negative_values_of_an_experiment_are_negative():
    firmware = _core.inputs(str(paths.EXPERIMENTS / "strike_biquad.toml"))["firmware"]
    found = [firmware[f"bank_coefficient_{i}"] for i in range(1, 6)]
    assert found == list(BANK.quantised().sections[0])
    assert found[1] < 0


def test_the_bank_of_an_experiment_as_the_firmware_holds_it():
    own = settings.of("strike_biquad")
    assert (own.law, own.timing, own.firmware_gain) == ("bank", "zoh", 4.37109375)
    assert own.bank == BANK.quantised()
    late = settings.of("strike_biquad", {"firmware.latency_ticks": 1.0, "k_w": 3e5})
    assert late.timing == "zoh+1"
    assert late.overrides["k_w"] == 3e5 and late.overrides["approach"] == pytest.approx(0.004)


def test_the_gain_of_an_experiment():
    own = settings.of("hold_p")
    assert (own.law, own.bank, own.firmware_gain) == ("p", None, 4.5)
    assert settings.of("laboratory").experiment is None
    assert settings.of("fig4_19").experiment is None  # a model's stem goes first


@pytest.mark.parametrize(
    ("mode", "law"), [(-6, "stiffness"), (-7, "damping"), (-8, "impedance")]
)  # fmt: skip
def test_the_laws_of_motion_of_an_experiment(mode, law):
    """Their set-point is made before the tick: x and v are one tick old."""
    given = {"firmware.modes_of_operation": mode, "firmware.stiffness": 0.25,
             "firmware.damping": 2.0}  # fmt: skip
    own = settings.of("hold_p", given)
    assert own.law == law
    facts = linear.facts("laboratory")
    per_count, scale = facts.required_reading.per_count, facts.required_encoder.scale
    K, D = 0.25 * abs(per_count) * scale, 2.0 * abs(per_count) * scale * TICK
    wanted = {"stiffness_N_per_m": K, "damping_Ns_per_m": D}
    for name, value in own.parameters.items():
        assert value == pytest.approx(wanted[name], rel=1e-9)
    assert len(own.parameters) == len(loops.LAWS[law])
    loop = LoopRequest("hold_p", given).loop()
    assert loop.own_gain == pytest.approx(loop.gain_of(4.5))
    plant = linear.linearise("laboratory", outputs=("reading", "robot.position")).sampled()
    for hz in (0.7, 6.0, 44.0, 300.0):
        z = np.exp(2j * math.pi * hz * TICK)
        f, x = plant.response(hz)[:, 0]
        back = 0.0
        if law != "damping":
            back += K
        if law != "stiffness":
            back += D * (1 - 1 / z) / TICK
        assert loop.open.response(hz) == pytest.approx(f + back * x / z, rel=1e-7)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["loop", "limit", "move"], "controls the force, got the mode profile_position"),
        (["loop", "limit", "position_step"], "controls the force, got the mode position"),
        (["loop", "limit", "tables"], "lists the tables"),
        (
            ["loop", "limit", "contact", "--law", "bank"],
            "expected an experiment that selects a bank",
        ),
        (
            ["loop", "limit", "contact", "--set", "firmware.force_bank=2"],
            "expected the values of the filter bank bank_2",
        ),
        (
            ["loop", "limit", "strike_biquad", "--timing", "continuous"],
            "computes a bank once per tick",
        ),
        (["loop", "limit", "laboratory", "--over", "k_x=30%"], "expected a parameter of the model"),
        (["loop", "limit", "laboratory", "--over", "k_w=0%"], "NAME=PERCENT%"),
        (["loop", "limit", "laboratory", "--over", "k_w=9..1"], "NAME=PERCENT%"),
        (["loop", "limit", "laboratory", "--modes", "visited"], "expected an experiment"),
        (
            ["loop", "limit", "laboratory", "--modes", "all", "--mode", "drive.amplifier=inner"],
            "--mode",
        ),
        (["loop", "limit", "laboratory", "--modes", "all", "--free"], "--free"),
        (
            ["loop", "limit", "fig3_10", "--modes", "all"],
            "expected a model with an ADC on channel 0",
        ),
        (
            ["loop", "limit", "fig4_19", "--modes", "all", "--output", "nothing"],
            "output: expected one of",
        ),
        (["loop", "bode", "laboratory", "--of", "plant", "--over", "k_w=30%"], "--of"),
        (["loop", "bode", "contact", "--of", "loop", "--input", "drive.force"], "--of"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_one_line(arguments, message):
    result = verbs.forceaxis(*arguments)
    assert result.returncode == 2
    assert result.stdout == ""
    assert message in result.stderr and result.stderr.count("\n") == 1


def printed(*arguments):
    result = verbs.forceaxis(*arguments)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_limit_of_an_experiment_and_over_a_set():
    one = json.loads(printed("loop", "limit", "strike_biquad", "--json"))
    assert one["law"] == "bank" and one["bank"]["gain"] == 4.37109375
    assert one["at"]["stable"] and one["at"]["fS_Hz"] == pytest.approx(5.140, abs=1e-3)
    several = json.loads(
        printed("loop", "limit", "hold_p", "--over", "k_w=30%", "--law", "force_gain=1.5", "--json")
    )
    assert several["critical_gain"] < several["nominal"]["critical_gain"] / 3
    assert several["member"]["modes"] == OUTER
    assert several["over"]["modes"] == [{}, OUTER]
    at = several["at"]
    assert at["stable"] and at["firmware_gain"] == pytest.approx(1.5)
    assert set(at["member"]) >= set(over.FIGURES) - {"phase_margin_deg"}
    text = printed("loop", "limit", "hold_p", "--over", "k_w=30%", "--law", "force_gain=1.5")
    assert "limit " in text and "drive.amplifier = high outer" in text and "Ms " in text


@pytest.mark.parametrize("verb", ["nyquist", "bode", "step"])
def test_figures_over_a_set(verb, tmp_path):
    out = tmp_path / "set.png"
    asked = ("loop", verb, "strike_biquad", "--timing", "both", "--out", out)
    found = json.loads(printed(*asked, "--json"))
    assert out.stat().st_size > 10000
    rows = found["members" if verb == "step" else "curves"]
    assert [(row["modes"], row["timing"]) for row in rows] == [
        (modes, timing) for modes in ({}, OUTER) for timing in ("zoh", "zoh+1")
    ]
    if verb == "step":
        assert found["worst"]["overshoot"]["value"] == max(row["overshoot"] for row in rows)
    else:
        assert found["at"]["Ms"] == pytest.approx(1.963, abs=1e-3)
        sensitive = json.loads(
            printed("loop", "bode", "strike_biquad", "--of", "sensitivity", "--json")
        )
        size = max(sensitive["curves"][0]["magnitude"])
        assert size == pytest.approx(sensitive["curves"][0]["loop"]["at"]["Ms"], rel=1e-3)


def test_ranges_are_refused_by_name():
    with pytest.raises(InputError, match="each parameter once"):
        plant_set.ranges_of("laboratory", ["k_w=30%", "k_w=20%"])


def test_the_stiffness_mode_loses_stability_where_the_analysis_says():
    """The firmware, with a fine ADC and encoder: the limit is 1.5 times higher were x not late."""
    values = {
        "firmware.modes_of_operation": -6,
        "firmware.force_bank": 0,
        "firmware.stiffness": 10 / 64,
        "firmware.target_position": 3000,
        "encoder_scale": 64e6 / 6.35,
        "approach": 0.0002,
    }
    loop = LoopRequest("hold_biquad_12bit", values).loop()
    limit = loop.limit()

    def ripple(share):
        gain = share * loop.firmware_gain(limit.gain)
        texts = linear.override_texts(values | {"firmware.force_gain": gain})
        run = _core.run(str(paths.EXPERIMENTS / "hold_biquad_12bit.toml"), texts)
        force = run.columns()["sensor.force"][-1500:]
        spectrum = np.abs(np.fft.rfft(force - force.mean()))
        return np.ptp(force), spectrum.argmax() * 1500 / len(force)

    assert ripple(0.7)[0] < 0.5  # N
    size, hz = ripple(1.15)
    assert size > 3
    assert hz == pytest.approx(limit.frequency_hz, rel=0.1)


def test_eigenvalues_for_which_the_iteration_fails_are_those_of_the_transpose():
    """The matrix came from |S| of a loop over a bus. NumPy has its eigenvalues in double."""
    matrix = np.load(Path(__file__).with_name("level_roots.npy"))
    found = np.sort_complex(np.array(_core.eigenvalues(matrix)).round(6))
    expected = np.sort_complex(np.linalg.eigvals(matrix.astype(float)).round(6))
    np.testing.assert_allclose(found, expected, atol=2e-5)
