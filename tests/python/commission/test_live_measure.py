"""The signal analyzer on a live axis: its responses are the plant's, its bounds hold in every tick,
what it refuses is refused by name and leaves the axis as it was."""

import functools
import json
import math
from types import SimpleNamespace

import live_axes
import numpy as np
import pytest
import verbs
from forceaxis.axis.axis import Axis
from forceaxis.axis.sim import SimLink
from forceaxis.cli import live_options
from forceaxis.commission import as_found, measuring, response
from forceaxis.commission.analyzer import Analyzer, MeasuringOrder, noise_of
from forceaxis.commission.level import Abort, Level
from forceaxis.commission.refusal import Refusal
from forceaxis.design import data_sheet, new
from forceaxis.identify import fit, result
from live_axes import NOISE_N, ONE_SLOPE

ORDER = MeasuringOrder(force_max_N=150.0, averages=6)
PARAMETERS = ("force_gain", "target_force", "excitation_code", "position_max", "force_max")


@pytest.fixture
def axis_file(tmp_path):
    """See live_axes.write()."""
    return functools.partial(live_axes.write, tmp_path)


def state(axis):
    return axis.get("drive_state", "fault", *PARAMETERS)


def test_responses_are_those_of_the_plant_and_bounds_hold_in_every_tick(axis_file):
    file = axis_file()
    model = file.parent / "model.toml"
    with Axis(SimLink(file)) as axis:
        before, truth = state(axis), axis.link.axis
        with Analyzer(axis, ORDER, model, ONE_SLOPE) as analyzer:
            rest = analyzer.rest()
            assert rest.noise_lsb == pytest.approx(np.hypot(NOISE_N / 0.15625, 12**-0.5), rel=0.1)
            truth.reset_extremes()
            free = analyzer.free()
            assert truth.extremes["force_N"] == 0
            start = rest.position
            assert start - 520 < truth.extremes["position_min_cnt"]
            assert truth.extremes["position_max_cnt"] < start + 520
            levels = []
            for force in (30.0, 75.0):
                truth.reset_extremes()
                levels.append(analyzer.contact(force))
                assert truth.extremes["force_N"] < 150
        assert state(axis) == before | {"drive_state": "ready_to_switch_on"}
    for level, force in zip(levels, (30.0, 75.0), strict=True):
        assert level.bias_N == pytest.approx(force, rel=0.05)
        assert level.force_min_N > force / 2
        assert 0.2 * force < level.swing < 0.6 * force
    for level in (free, *levels):
        compared = level.measured.compare()
        assert compared.p_value > 1e-3, compared
        assert compared.inside > 0.85
        assert compared.coherent > 50
        # The band is no wider than it has to be: a workpiece 5 % heavier is seen.
        if not level.measured.free:
            heavier = level.measured.predict({"m_w": 1.05 * 6.6})
            assert level.measured.compare(heavier).p_value < 1e-3


def test_a_simulated_axis_and_its_model_measure_the_same(axis_file):
    """tests/firmware/chip/test_measure_ways.py adds gateway, CAN and the emulated chip."""
    file = axis_file()
    model = file.parent / "model.toml"
    order = MeasuringOrder(force_max_N=150.0, averages=6, amplitude=50)
    with Axis(SimLink(file)) as axis:
        done = measuring.measure(axis, order, (75.0,), True, model, ONE_SLOPE)
    live = [done[name].measured for name in live_axes.OF_MODEL]
    # A plant that is not the same is seen: a softer workpiece, a heavier rotor.
    for plant, least, most in (({}, 0.9, 1), ({"k_w": 0.8 * 4.127e5, "m_r1": 1.3 * 114.5}, 0, 0.7)):
        of_model = [
            result.run(model, options, plant).measured for options in live_axes.OF_MODEL.values()
        ]
        assert least <= live_axes.shared(live, of_model) <= most


def test_averages_end_where_the_response_is_certain_and_the_axis_is_not_thrown_back(axis_file):
    order = MeasuringOrder(force_max_N=150.0, averages=12, fewest=4, first=16)
    with Axis(SimLink(axis_file())) as axis:
        truth = axis.link.axis
        with Analyzer(axis, order) as analyzer:
            level = analyzer.contact(75.0)
            pressed = axis.read("position")
            truth.reset_extremes()
        axis.link.wait(2.0)
        assert axis.read("drive_state") != "operation_enabled"
        assert truth.extremes["position_min_cnt"] > pressed - order.travel
    assert 4 <= level.measured.averages < 12
    assert level.measured.dof == level.measured.averages - 1
    assert np.median(level.measured.random_error()) < 0.04


def test_the_verb_writes_what_fit_and_design_take(axis_file, tmp_path):
    file, out = axis_file(), tmp_path / "m"
    done = verbs.forceaxis(
        "measure", "--on", f"sim:{file}", "--free", "--force", "30,75", "--force-max", 150,
        "--averages", 6, "--out", out, "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert list(summary) == ["free", "30N", "75N"]
    assert summary["75N"]["comparison"] is None
    assert summary["75N"]["hints"] == []
    assert sorted(f.name for f in (out / "75N").iterdir()) == [
        "plot.png", "response.csv", "response.npz", "result.json",
    ]  # fmt: skip
    model = file.parent / "model.toml"
    measured = fit.read_response(out / "75N", model, ONE_SLOPE)
    found = fit.fit(measured, {"m_w": 8.0, "k_w": 5e5})
    assert not found.rejected
    assert np.allclose(found.values, (6.6, 4.127e5), rtol=0.01)


class Killed(SimLink):
    """A tool that is killed once the axis is pressed: nothing is written from then on."""

    class Kill(BaseException):
        pass

    killed = True

    def write(self, values):
        if self.killed and self.read(["contact"])["contact"]:
            self._owned = False
            raise Killed.Kill
        super().write(values)

    def close(self):
        """The axis is looked at afterwards."""


def test_a_run_after_a_kill_puts_back_what_was_changed(axis_file, tmp_path, monkeypatch):
    link = Killed(axis_file())
    axis, names = Axis(link), (*PARAMETERS, "excitation_period", "excitation_travel")
    axis.acquire()
    axis.set(force_max=40.0, excitation_travel=77)
    before = axis.get(*names)
    monkeypatch.setattr(live_options.AxisConnection, "link", lambda way: link)
    words = ["measure", "--on", "lcm:1", "--force", 30, "--force-max", 100, "--averages", 4]
    out = tmp_path / "m"
    assert "Kill" in verbs.forceaxis(*words, "--out", out).stderr
    link.axis.step(15_000)
    assert axis.read("fault") == "source_lost"
    assert axis.get(*names) != before
    link.killed = False
    done = verbs.forceaxis(*words, "--out", out)
    assert done.returncode == 0, done.stderr
    warning, *said = done.stderr.splitlines()[:3]
    assert "force_scale (2.5 N/count) was never set" in warning
    assert said[0] == "the previous run was killed: the fault source_lost that it left is reset"
    assert said[1].endswith("objects have their earlier values again")
    assert axis.get(*names) == before
    assert not (out / as_found.FOUND.name).exists()


def test_a_strike_ends_the_excitation_in_its_tick_and_half_the_amplitude_is_taken(axis_file):
    """Provoked: a hand that strikes the pressed workpiece while noise of 40 codes acts."""
    strike = "".join(
        f'[[at]]\ntime_s = {t}\nimpulse = {{ body = "workpiece", N_s = -0.35 }}\n' for t in (6.0,)
    )
    seen = []
    with Axis(SimLink(axis_file(plant=strike))) as axis:
        order = MeasuringOrder(force_max_N=100.0, averages=4, amplitude=40)
        with Analyzer(axis, order, say=seen.append) as analyzer:
            level = analyzer.contact(75.0)
    assert level.aborts == [Abort(40, "ended_force")]
    assert level.amplitude == 20
    assert level.force_max_N < 100.0


@pytest.mark.parametrize("last", [2.9, 2.0])
def test_a_distortion_that_the_last_attempt_still_has_is_noise(axis_file, monkeypatch, last):
    """As on a gantry with backlash: it falls with each halving of the amplitude, but remains."""
    distortions = iter([32.0, 16.0, 8.0, 4.0, 3.0, last, 32.0])
    monkeypatch.setattr(response, "excess", lambda *given: next(distortions))
    with Axis(SimLink(axis_file())) as axis:
        order = MeasuringOrder(force_max_N=150.0, averages=4, amplitude=64)
        with Analyzer(axis, order) as analyzer:
            level = analyzer.contact(75.0)
    assert level.amplitude == 64 and level.distorted == 32.0
    assert [abort.why for abort in level.aborts] == ["distorted"] * 5


@pytest.mark.parametrize(
    ("firmware", "plant", "name"),
    [
        ("force_tare = 4.0", "", "tare"),
        ("position_gain = 0.0", "", "contact"),
        ("force_limit = 200", "", "bias"),
        ("position_max = -300", "", "contact"),
        ("", "[[at]]\ntime_s = 4.0\nsensor = { force = 'zero' }\n", "contact"),
    ],
)
def test_refusals_by_name_leave_the_axis_as_it_was(axis_file, firmware, plant, name):
    text = firmware.split(" ")[0]
    file = axis_file(firmware, plant)
    if text == "position_gain":
        file.write_text(file.read_text().replace("position_gain = 4.0\n", ""))
    with Axis(SimLink(file)) as axis:
        before = state(axis)
        with pytest.raises(Refusal) as refused, Analyzer(axis, ORDER) as analyzer:
            analyzer.rest()
            analyzer.contact(75.0)
        assert refused.value.name == name
        after = state(axis)
        assert after["drive_state"] != "operation_enabled"
        assert all(after[n] == before[n] for n in PARAMETERS)


def test_the_free_response_does_not_touch(axis_file):
    file = axis_file()
    file.write_text(file.read_text().replace('"4 mm"', '"0.02 mm"'))
    with (
        Axis(SimLink(file)) as axis,
        Analyzer(axis, MeasuringOrder(travel=500)) as analyzer,
        pytest.raises(Refusal) as refused,
    ):
        analyzer.free()
    assert refused.value.name == "contact"


@pytest.mark.parametrize(("own_N", "asked_N", "bound_N", "remedy"), [
    (0.0, 150.0, 150.0, "give a larger `force_max_N` or"),
    (100.0, 150.0, 100.0, "raise the object force_max of the axis, 40 counts, or"),
    (100.0, math.inf, 100.0, "raise the object force_max of the axis, 40 counts, or"),
    (200.0, 150.0, 150.0, "give a larger `force_max_N` or"),
    (0.0, math.inf, None, "the set-point; give other forces"),
])  # fmt: skip
def test_the_force_bound_that_acted_is_the_one_that_is_told(
    axis_file, own_N, asked_N, bound_N, remedy
):
    """The smaller one of the request and of the axis; of no bound the text said "inf N"."""
    with Axis(SimLink(axis_file())) as axis:
        axis.acquire()
        axis.set(force_max=own_N / 2.5)
        order = MeasuringOrder(force_max_N=asked_N, averages=4, amplitude=8)
        with Analyzer(axis, order) as analyzer:
            rest = analyzer.rest()
            level = analyzer.contact(30.0)
    assert measuring.result_of(analyzer, level, rest).summary.force_max_allowed_N == bound_N
    level.aborts.append(Abort(8, "ended_force"))
    text = analyzer._remedy(level)
    assert remedy in text and "inf" not in text
    assert (f"the force bound of {bound_N:g} N;" in text) if bound_N else "bound" not in text


def test_a_quiet_reading_is_hinted_at(axis_file):
    order = MeasuringOrder(force_max_N=150.0, averages=4)
    with Axis(SimLink(axis_file(noise=0.0))) as axis:
        done = measuring.measure(axis, order, (30.0,))
    (text,) = done["30N"].summary.hints
    assert text.startswith("the noise of the measured force is 0 codes rms, below 0.4")


@pytest.mark.parametrize(("amplitude", "lowered"), [(1, True), (30, False)])
def test_a_response_without_coherence_is_hinted_at_with_what_would_help(amplitude, lowered):
    """An axis with friction and backlash: its excitation was halved until nothing moved. With an
    amplitude that was kept, a larger force helps."""
    seen = SimpleNamespace(coherence=np.full(100, 0.1), model="model.toml")
    aborts = [Abort(8, "distorted"), Abort(4, "distorted"), Abort(40, "ended_force")]
    level = Level(amplitude, noise_lsb=2.0, measured_or_none=seen, aborts=aborts)
    (text,) = measuring.hints(level, SimpleNamespace(noise_lsb=2.0))
    assert text.startswith("coherence above 0.9 at 0 % of the frequencies: ")
    assert ("8 codes became 1 because" in text and "`level`" in text) == lowered
    assert ("larger force" in text) != lowered


class Late(SimLink):
    """An axis that does half of its ticks by the wall clock, as one on a busy machine."""

    def wait(self, seconds):
        super().wait(seconds / 2)


@pytest.mark.parametrize("link", [SimLink, Late])
def test_a_wait_lasts_as_long_as_it_says_by_the_clock_of_the_axis(axis_file, link):
    """A period of noise would otherwise begin before the response to the one before has ended."""
    checks = []
    with Axis(link(axis_file())) as axis, Analyzer(axis, ORDER) as analyzer:
        begin = axis.read("tick_count")
        analyzer.wait(1.23, lambda: checks.append(axis.read("tick_count")))
        assert axis.read("tick_count") - begin == pytest.approx(1.23 * 1500, abs=1)
    assert max(np.diff([begin, *checks])) <= 151  # 0.1 s


def test_noise_fed_back_biases_the_quotient_but_not_the_estimate():
    """A law without delay over a gain of 0.5 whose output noise is as large as what is added."""
    rng = np.random.default_rng(1)
    count, n, gain, law = 1600, 64, 0.5, 3.0
    r, noise = rng.normal(size=(2, count, n))
    u = (r - law * noise) / (1 + law * gain)
    y = gain * u + noise
    lines = np.arange(1, 30)
    found = response.estimate(r, u, y, lines, (0.0, 0.0))
    error = abs(found.response - gain)
    assert error.mean() < 0.1
    assert np.allclose(found.sensitivity, 1 / (1 + law * gain), atol=0.1)
    inside = error**2 < 3.0 * found.variance  # F(2, 3198) at 95 %
    assert inside.mean() > 0.85
    U, Y = (np.fft.rfft(v, axis=1)[:, lines] for v in (u, y))
    assert abs((U.conj() * Y).sum(0) / (abs(U) ** 2).sum(0) - gain).min() > 0.25


def test_noise_of_a_slow_cycle_between_two_codes_is_none():
    assert noise_of(np.repeat([0, 1] * 5, 150)) < 0.1
    assert noise_of(np.random.default_rng(0).normal(0, 2, 4000)) == pytest.approx(2, rel=0.05)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("measure",), "expected the address of one axis, as --on ADDRESS"),
        (("measure", "--on", "sim:session"), "expected --free (measure out of contact), --force"),
        (
            ("measure", "fig3_9", "--on", "sim:session"),
            "expected either TARGET (a simulation) or --on ADDRESS (an axis)",
        ),
        (
            ("measure", "--on", "sim:session", "--force", "0,3"),
            "--force: 0,3: expected one or more forces in N, above 0",
        ),
    ],
)
def test_wrong_input_is_one_line(arguments, says):
    done = verbs.forceaxis(*arguments)
    assert done.returncode == 2
    assert says in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_refusal_is_status_1(axis_file):
    done = verbs.forceaxis(
        "measure", "--on", f"sim:{axis_file('force_tare = 4.0')}", "--force", "30"
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith(
        "forceaxis: tare: expected a measured force within"
    )


def test_without_its_model_a_drive_on_a_slow_bus_is_hinted_at(tmp_path):
    """Its commands last 4 ms: without the model the excitation does not know that."""
    given = dict(
        drive="velocity", motor="linear", bus_cycle_ms=4, velocity_loop_hz=60,
        full_scale_speed_m_per_s=0.25, force_constant_n_per_a=45, motor_peak_current_a=16,
        moving_mass_kg=11, guide_coulomb_n=6, sensor_full_scale_n=500, sensor_bits=24,
        sensor_stiffness_n_per_m=2e6, sensor_rate_hz=500, sensor_filter="sinc3",
        sensor_noise_n=0.05, workpiece_stiffness_n_per_m=3e4, workpiece_mass_kg=0.4,
        workpiece_damping_ratio=0.2,
    )  # fmt: skip
    sheet = {name: str(value) for name, value in given.items()}
    new.write(tmp_path / "slow", *data_sheet.collect(sheet))
    folder = tmp_path / "slow"
    words = ("measure", "--on", f"sim:{folder / 'contact.toml'}", "--force", "80", "--force-max",
             "300", "--travel", "3000", "--level", "128", "--json")  # fmt: skip
    hints = {}
    for model in ((), ("--model", folder / "model.toml")):
        done = verbs.forceaxis(*words, *model)
        assert done.returncode == 0, done.stderr
        (found,) = json.loads(done.stdout).values()
        hints[bool(model)] = [text for text in found["hints"] if "bus of a drive" in text]
    assert len(hints[False]) == 1 and hints[True] == []


def test_what_is_said_while_it_measures_names_the_options_of_the_command(axis_file):
    """The slow change of the force needs more than 50 counts of travel in contact."""
    done = verbs.forceaxis("measure", "--on", f"sim:{axis_file()}", "--set", "k_w=2e4", "--force",
                           "75", "--force-max", "150", "--travel", "50")  # fmt: skip
    assert "give --travel " in done.stderr, done.stderr
    assert "`travel`" not in done.stderr
