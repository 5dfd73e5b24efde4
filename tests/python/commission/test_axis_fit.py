"""The parameters of an axis from all its responses at once: what they are, how far they are known,
and what is refused."""

import math
from dataclasses import replace
from types import SimpleNamespace

import drawn_axes
import numpy as np
import pytest
from forceaxis import linear
from forceaxis._core import InputError
from forceaxis.commission import (
    damper_fit,
    joint_fit,
    known,
    tune_fit,
    tune_results,
)
from forceaxis.design import data_sheet, new
from forceaxis.identify import fit as fit_response
from forceaxis.identify.measurement import Measurement
from forceaxis.linear import loops

pytestmark = pytest.mark.beside

OVER = ("k_w=30%,m_w=30%",)
TRUTH = {"k_w": 2.1, "m_w": 0.6, "b_w": 1.8, "k_s": 1.1, "b_s": 0.7, "m_axis": 1.03, "b_axis": 1.5,
         "k_torque": 0.97, "k_preamp_fdbk": 1.04}  # fmt: skip
DOF = 7
ARRAYS = ("frequency_hz", "response", "coherence", "floor", "variance")


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return drawn_axes.press(tmp_path_factory.mktemp("axis") / "press") / "model.toml"


def parameters(model):
    return {n: value for n, (value, _) in linear.facts(model).parameters.items()}


def true_values(model, factors=TRUTH):
    values = parameters(model)
    return {n: values[n] * factor for n, factor in factors.items()}


def measured(model, truth, free=False, error=0.02, seed=0, coherence=0.99, modes=None):
    """A response whose noise has the distribution that Measurement states."""
    hz = np.arange(2.0, 150.0, 2.0)
    empty = np.zeros(len(hz))
    one = Measurement(
        hz, empty + 0j, empty + coherence, empty, empty, DOF, DOF + 1, "dac_code",
        "encoder" if free else "adc0", "", 1 / 1500, "codes", str(model), {}, free,
        modes=modes or {},
    )  # fmt: skip
    rng = np.random.default_rng([2024, seed])
    exact = one.predict(truth)
    size = (error * abs(exact)) ** 2
    noise = (rng.normal(size=(2, len(hz))) * np.sqrt(size / 2)).T @ [1, 1j]
    estimated = size * rng.chisquare(2 * DOF, len(hz)) / (2 * DOF)
    return replace(one, response=exact + noise, variance=estimated, modes={})


def three(model, truth, **given):
    return [
        measured(model, truth, free=True, seed=10, **given),
        measured(model, truth, seed=11, **given),
        measured(model, truth, seed=12, **given),
    ]


def test_parameters_lie_in_their_intervals_and_absolute_ones_are_known_less_than_ratios(model):
    truth = true_values(model)
    found = joint_fit.joint(model, known.priors(model, OVER), three(model, truth), OVER)
    assert found.rejected is None and found.p > 0.01
    true = parameters(model) | truth
    inside = [low <= true[n] <= high for n, (low, high) in found.intervals.items()]
    assert sum(inside) >= len(inside) - 1
    for name in ("k_w", "m_w", "k_s"):
        assert found.values[name] == pytest.approx(true[name], rel=0.1)
    value, low, high = found.ratios["m_w/k_w"]
    assert value == pytest.approx(true["m_w"] / true["k_w"], rel=0.01)
    ratio = math.log(high / low)
    for name in ("k_w", "m_w"):
        low, high = found.intervals[name]
        assert 2 * ratio < math.log(high / low)


def test_without_the_response_apart_ratios_stay_and_absolute_values_do_not(model):
    truth = true_values(model)
    priors = known.priors(model, OVER)
    priors |= {n: known.Prior(p.value, 0.5) for n, p in priors.items() if n in ("m_axis", "k_s")}
    found = joint_fit.joint(model, priors, three(model, truth)[1:], OVER)
    low, high = found.intervals["k_w"]
    assert high / low > 1.2
    _, low, high = found.ratios["m_w/k_w"]
    assert high / low < 1.01
    # A law meets the code and the reading alone: the set is not widened by what neither shows.
    _, low, high = found.plants.ranges["k_w"]
    assert high / low < 1.05 * 1.3 / 0.7


def test_a_stiffness_that_differs_between_forces_widens_the_set_once(model):
    """Its change was added to the range, and again as an error that the responses leave open: a
    stiffness of 3065 and 6359 N/m gave a set of 770 to 22,960 N/m."""
    truth, forces = true_values(model), (0.7, 1.4)
    found = [measured(model, truth, free=True, seed=10)] + [
        measured(model, truth | {"k_w": factor * truth["k_w"]}, seed=11 + i)
        for i, factor in enumerate(forces)
    ]
    fit = joint_fit.joint(model, known.priors(model, OVER), found, OVER)
    first = {f"k_w@{i + 1}": factor * truth["k_w"] for i, factor in enumerate(forces)}
    fit = joint_fit.with_levels(fit, "k_w", first, OVER)
    assert fit.rejected is None
    _, low, high = fit.plants.ranges["k_w"]
    least, most = (f * truth["k_w"] for f in (0.7 * min(forces), 1.3 * max(forces)))
    assert 0.85 * least < low < 1.02 * least and 0.98 * most < high < 1.18 * most


def test_the_ranges_are_those_asked_for_and_what_the_fit_leaves_open(model):
    truth = true_values(model)
    found = [
        joint_fit.joint(model, known.priors(model, OVER), three(model, truth, error=e), OVER)
        for e in (0.005, 0.2)
    ]
    for one in found:
        for name, (value, low, high) in one.plants.ranges.items():
            assert low < 0.7 * value and high > 1.3 * value and value == one.values[name]
        assert one.over[0].startswith("k_w=") and set(one.plants.ranges) == {"k_w", "m_w"}
    wide = [one.plants.ranges["k_w"][2] / one.plants.ranges["k_w"][0] for one in found]
    assert 1.3 < wide[0] < 1.31 and wide[1] > 1.315


BUS_AXIS = {
    "drive": "velocity", "bus_cycle_ms": 4, "sensor_bits": 16, "sensor_noise_n": 0.1,
    "workpiece_stiffness_n_per_m": 1e6,
}  # fmt: skip


def test_what_responses_below_a_mode_leave_open_widens_the_set(tmp_path):
    """Over a bus the mode of the workpiece is above the measured band: its stiffness and mass and
    the stiffness of the sensor trade against each other. A law for a set about the fitted values
    had an Ms of 3.5 on the true plants."""
    values, sources = data_sheet.collect({name: str(v) for name, v in BUS_AXIS.items()})
    new.write(tmp_path / "axis", values, sources)
    model = str(tmp_path / "axis/model.toml")
    priors = known.priors(model, OVER)
    true = {name: value for name, value in parameters(model).items() if name in priors}
    slow = [
        replace(m, **{name: getattr(m, name)[m.frequency_hz < 100.0] for name in ARRAYS})
        for m in three(model, true, error=0.03)
    ]
    found = joint_fit.joint(model, priors, slow, OVER)
    assert found.rejected is None
    for name in ("k_w", "m_w"):
        (best, low, high), (least, most) = found.plants.ranges[name], found.intervals[name]
        half = math.log(most / least) / 2
        assert half > 0.05
        for wider in (0.7 * best / low, high / (1.3 * best)):
            assert 0.7 * half < math.log(wider) < 1.01 * half
        # The true plants with their tolerances belong to the set.
        assert low < 0.7 * true[name] and 1.3 * true[name] < high


@pytest.mark.parametrize(
    "factors, given, error, name",
    [
        ({"k_s": 2.5}, ("k_s={k_s}+-20%",), 0.02, "prior"),
        ({"k_s": 1.6}, (), 0.02, None),  # far from a value of a data sheet, which is only said
        ({"k_s": 1.2}, (), 0.02, None),
        ({"k_w": 1.5}, ("k_w=400000+-10%",), 0.02, "prior"),
        ({}, (), 1.0, "coherence"),
        ({}, (), 0.1, None),
        ({"k_back_emf": 12.0, "L": 4.0}, (), 0.02, "chi2"),
        ({"k_back_emf": 1.1}, (), 0.02, None),
    ],
)
def test_a_fit_is_rejected_by_name_or_taken(model, factors, given, error, name):
    truth = true_values(model, TRUTH | factors)
    priors = known.priors(model, OVER, [text.format(**parameters(model)) for text in given])
    found = joint_fit.joint(model, priors, three(model, truth, error=error), OVER)
    assert found.rejected == name, found.text
    summary = found.summary()
    assert (summary.set is None) == (summary.intervals is None) == (name is not None)


def test_a_mode_in_a_narrow_band_is_not_hidden_by_a_large_error_of_all_lines(model):
    """A machine bed of 13 Hz was accepted at p = 1 beside friction that made every line uncertain
    by 15 %."""
    found, errors = three(model, true_values(model), error=0.1), [0.15] * 3
    priors = known.priors(model, OVER)
    assert joint_fit.joint(model, priors, found, OVER, errors=errors).rejected is None
    for one in found[1:]:
        s = 1j * one.frequency_hz / 31.0
        one.response[:] *= (1 + 0.06 * s + s**2) / (1 + 0.06 * s + (s * 31 / 33) ** 2)
    fit = joint_fit.joint(model, priors, found, OVER, errors=errors)
    assert fit.rejected == "chi2" and fit.p > 0.1  # of all lines together


def test_a_workpiece_whose_antiresonance_is_above_all_lines_is_fitted(model):
    """A sheet with a workpiece of 0.1 g on a stiff spring gave the search nothing to begin with."""
    light = known.priors(model, OVER)
    light |= {n: replace(light[n], value=v) for n, v in (("k_w", 2e7), ("m_w", 1e-4))}
    found = joint_fit.joint(model, light, three(model, true_values(model)), OVER)
    assert found.rejected in ("chi2", "prior")


def test_the_error_at_half_the_rate_of_a_slow_sensor_is_that_of_its_highest_line():
    """A refusal had named an infinite error and a wider band, which a sensor of 10/s does not
    show."""
    hz = np.arange(1.0, 4.01, 0.25)
    slow = SimpleNamespace(
        frequency_hz=hz, resolution_hz=0.25, response=np.ones(len(hz), complex),
        variance=np.linspace(0.01, 0.25, len(hz)), ages=(75.0, 150.0), dt=1 / 1500,
    )  # fmt: skip
    assert joint_fit._error_near(slow, 5.0) == pytest.approx(0.5)
    assert joint_fit._error_near(slow, 4.8) == math.inf
    slow.ages = (0.0, 0.0)
    assert joint_fit._error_near(slow, 5.0) == math.inf


def test_levels_that_differ_widen_the_set_so_that_it_holds_all_of_them(model):
    truth = true_values(model)
    stiffer = truth | {"k_s": 1.15 * truth["k_s"]}
    responses = three(model, truth)
    responses[2] = measured(model, stiffer, seed=12)
    found = joint_fit.joint(model, known.priors(model, OVER), responses, OVER)
    assert found.rejected is None and found.levels_differ
    _, low, high = found.plants.ranges["k_s"]
    assert low <= 1.01 * truth["k_s"] and high >= 0.99 * stiffer["k_s"]
    assert not joint_fit.joint(
        model, known.priors(model, OVER), three(model, truth), OVER
    ).levels_differ


def test_each_level_is_taken_in_the_slope_of_the_amplifier_that_it_was_in():
    model = "laboratory_12bit"
    outer = {"drive.amplifier": "high outer"}
    truth = {n: parameters(model)[n] * f for n, f in (("k_w", 1.3), ("m_w", 0.8))}
    responses = [
        measured(model, truth, free=True),
        measured(model, truth, seed=1),
        measured(model, truth, seed=2, modes=outer),
    ]
    found = joint_fit.joint(model, known.priors(model, OVER), responses, OVER)
    assert found.rejected is None
    taken = [level.modes.get("drive.amplifier", "inner") for level in found.levels]
    assert taken[:2] == ["inner", "inner"] and "outer" in taken[2]
    assert len(found.plants.modes) == 2
    assert found.values["k_w"] == pytest.approx(truth["k_w"], rel=0.1)


def test_the_states_that_mode_names_are_those_of_every_response_and_of_the_set():
    """Of one slope of the amplifier alone, apart as well as pressed."""
    model, outer = "laboratory_12bit", {"drive.amplifier": "high outer"}
    truth = {n: parameters(model)[n] * f for n, f in (("k_w", 1.3), ("m_w", 0.8))}
    responses = [
        measured(model, truth, free=True, modes=outer),
        measured(model, truth, seed=1, modes=outer),
    ]
    named = outer | {"sensor": "pressed"}
    found = joint_fit.joint(model, known.priors(model, OVER), responses, OVER, states=named)
    assert found.rejected is None
    assert [level.modes for level in found.levels] == [outer, named]  # apart nothing presses
    assert all(modes.items() >= named.items() for modes in found.plants.modes)
    assert found.values["k_w"] == pytest.approx(truth["k_w"], rel=0.1)
    loop = loops.force_loop(model, "p", "zoh", found.best, named)
    assert found.limiting_hz == pytest.approx(loop.limit().frequency_hz)


def test_priors_follow_the_part_that_a_parameter_plays(model):
    priors = known.priors(model, OVER, ("m_w=4", "b_axis=150+-20%"))
    assert priors["k_w"].wide and not priors["k_s"].wide
    assert priors["m_w"] == known.Prior(4.0, known.GIVEN_SPREAD)
    assert priors["b_axis"] == known.Prior(150.0, 0.2)
    assert priors["m_axis"].spread == known.MASS_SPREAD and "force_per_count" not in priors


@pytest.mark.parametrize("gain", [1.03, 0.97])
def test_an_error_that_all_frequencies_have_in_common_is_in_the_interval(model, gain):
    """A damper in place of dry friction errs with the same sign at neighbouring frequencies, so the
    mean of many lines is not nearer to the truth."""
    values = true_values(model, {"k_w": 1.3})
    one = measured(model, values, error=0.003)
    below = {name: getattr(one, name)[:20] for name in ARRAYS}  # no resonance there
    one = replace(one, **below | {"response": below["response"] * gain})
    found = fit_response.fit(one, {"k_w": values["k_w"]}, tries=0)
    wide = damper_fit._with_common_error(damper_fit.DamperFit(found, one, (), {}), 0.03)
    off = abs(math.log(found.values[0] / values["k_w"]))
    assert found.single[0] < off < wide.single[0] < wide.joint[0] * 1.001
    assert "3 % of the response" in wide.warnings[-1]


@pytest.mark.parametrize("text", ["m_w", "m_w=0", "m_w=4+-0%", "m_w=4+-x%", "nobody=1"])
def test_a_wrong_prior_is_one_line(model, text):
    with pytest.raises(InputError, match=r"^priors: .*expected NAME=VALUE") as error:
        known.priors(model, OVER, (text,))
    assert "\n" not in str(error.value)


def test_the_amplitude_leaves_the_voltage_within_the_supply(model):
    values = parameters(model)
    first = values["k_preamp_cmd"] * values["k_amp"] * 10 / 2048  # V of the amplifier for a code
    assert known.linear_codes(model) == pytest.approx(0.7 * values["supply"] / first, rel=0.1)
    assert known.linear_codes(model, {"supply": values["supply"] / 2}) == pytest.approx(
        known.linear_codes(model) / 2, abs=1
    )
    assert known.linear_codes("fig4_19") == np.inf


@pytest.mark.parametrize(("interval", "told"), [((2e5, 4e5), True), ((7.6e3, 3.5e7), False)])
def test_a_parameter_that_the_responses_hardly_tell_is_named_with_a_way_on(interval, told):
    """The law of its whole interval was verified and stored with 0.02 Hz, and nothing said why."""
    rows = {
        "k_w": tune_results.ParameterRow(3e5, interval, "N/m"),
        "b_w": tune_results.ParameterRow(3.0, (1e-3, 1e3), "N s/m"),
    }
    said = tune_fit.untold(rows, ["k_w", "absent"])
    assert len(said) == (0 if told else 1)
    for line in said:
        assert "k_w only as 7600 to 3.5e+07 N/m" in line, line
        assert "`priors` k_w=VALUE+-PERCENT%" in line and "`averages`" in line
