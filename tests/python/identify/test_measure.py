"""The virtual signal analyzer: its statistics, its errors, the seven measurements of 3.2."""

import csv
import json
import sys
import tomllib
from pathlib import Path

import drawn_axes
import numpy as np
import pytest
import tune_study
import verbs
from forceaxis import _core, linear
from forceaxis._core import InputError
from forceaxis.cli import main as cli
from forceaxis.cli.measure import command_line, in_words
from forceaxis.identify import measure, measurement
from forceaxis.identify import result as measure_result
from forceaxis.identify.setup import read_setup
from scipy import stats

ROOT = Path(__file__).resolve().parents[3]
FILES = ROOT / "sim/measurements"
SEEDS = range(20)

VOLTS = ("fig3_9", {"resolution_hz": 2.0, "band_hz": [2, 300]}, {"rotor_mass": 1.1 * 79.53})
CODES = (
    "fig3_12",
    {"inject": "codes", "output": "adc0", "level": 60, "band_hz": [1, 100], "resolution_hz": 1.0},
    {"m_r1": 1.1 * 114.5},
)


# The player.


def replayed(system, volts):
    """y = C x + D u of a sampled system, step by step: (outputs, n)."""
    x, rows = np.zeros(len(system.A)), []
    for u in volts:
        rows.append(system.C @ x + system.D[:, 0] * u)
        x = system.A @ x + system.B[:, 0] * u
    return np.array(rows).T


@pytest.mark.parametrize("parts", [1, 4, 34])
def test_volts_on_a_fine_clock_play_the_sampled_plant(parts):
    names = ["sensor.spring_force", "tip.acceleration", "drive.current_command", "drive.command"]
    volts = np.random.default_rng(1).normal(0, 0.05, 400)
    played = _core.Excited(str(ROOT / "sim/models/fig3_12.toml"), {}, 0, parts).volts(volts, names)
    system = linear.linearise("fig3_12", outputs=names).sampled(dt=1 / (1500 * parts))
    expected = replayed(system, volts)
    assert abs(played - expected).max(axis=1) == pytest.approx(
        np.zeros(4), abs=1e-9 * abs(expected).max()
    )


def test_firmware_ticks_play_the_same_plant_as_codes():
    """Codes of the running firmware into the linear plant give its readings to half a count."""
    excited = _core.Excited(str(ROOT / "sim/models/fig3_12.toml"))
    for name, value in (("excitation_amplitude", 100), ("open_loop_code", 3), ("mode", 4)):
        excited.write(name, value)
    code, adc, force = excited.codes(1500, ["dac_code", "adc0", "sensor.spring_force"])
    assert code.min() < -80
    assert code.max() > 80
    system = linear.linearise("fig3_12", outputs=["sensor.spring_force"]).sampled()
    expected = replayed(system, code * 20 / 4096)[0]
    assert abs(force - expected).max() < 1e-9 * abs(expected).max()
    assert abs((adc - 32768) * 0.009765625 - expected).max() <= 0.5001 * 0.009765625


def test_tachometer_input_of_the_drive_is_the_linear_input():
    s = 2j * np.pi * np.geomspace(1, 1000, 20)
    outputs = ["drive.current_command", "drive.current"]
    ours = linear.linearise("fig3_7", outputs=outputs).at(s)
    other = linear.linearise("fig3_8", inputs=["drive.tach"], outputs=outputs).at(s)
    assert np.allclose(ours, other, rtol=1e-12)
    expected = -4.2 * 942 / (s + 942)  # Fig 4.4, with the tachometer of a shaft that stands still
    assert np.allclose(ours[:, 0, 0], expected, rtol=1e-12)


# Statistics.


@pytest.mark.parametrize(("target", "options", "heavier"), [VOLTS, CODES], ids=["volts", "codes"])
def test_true_model_fits_and_a_tenth_more_mass_is_seen(target, options, heavier):
    inside, rejected, caught = [], 0, 0
    for seed in SEEDS:
        true = measure_result.run(target, options | {"seed": seed}).summary.comparison
        wrong = measure_result.run(target, options | {"seed": seed}, heavier).summary.comparison
        assert true.coherent > 0.9 * true.points
        inside.append(true.inside)
        rejected += not true.fits
        caught += not wrong.fits
    assert np.mean(inside) >= 0.93
    assert rejected <= 2
    assert caught == 20


@pytest.mark.parametrize(
    "options",
    [
        {"excitation": "chirp"},
        {"excitation": "sine", "averages": 8, "points": 12},
        {"window": "hann", "averages": 32},
        {"inject": "codes", "excitation": "chirp", "output": "adc0", "level": 60},
        {"inject": "codes", "excitation": "sine", "points": 12, "output": "adc0", "level": 60},
        {"inject": "codes", "window": "hann", "averages": 32, "output": "adc0", "level": 60},
        {"inject": "codes", "output": "encoder", "level": 60, "band_hz": [1, 40]},
        {"inject": "codes", "input": "drive.current", "output": "tip.acceleration", "level": 60},
    ],
    ids=lambda o: "-".join(map(str, o.values())),
)
def test_other_excitations_outputs_and_inputs_fit_too(options):
    """Of eight seeds at most two are rejected at 5 % (chance: 0.6 %)."""
    base = {"resolution_hz": 1.0, "band_hz": [1, 100]} | options
    compared = [measure.measure("fig3_12", base | {"seed": s}).compare() for s in range(8)]
    assert sum(not c.fits for c in compared) <= 2
    assert np.mean([c.inside for c in compared]) >= 0.9


def test_an_axis_that_drifts_away_is_measured_all_the_same():
    """A bias drives the free axis at constant speed: the ramp is taken out of its position."""
    drift = {"inject": "codes", "output": "encoder", "bias": 20, "level": 200, "band_hz": [1, 30]}
    compared = [measure.measure("fig3_10", drift | {"seed": s}).compare() for s in range(6)]
    assert sum(not c.fits for c in compared) <= 2
    assert min(c.coherent for c in compared) == 59


@pytest.mark.parametrize("model", ["fig2_29", "fig4_14", "fig4_19", "fig4_25", "full_axis"])
def test_contacts_may_be_clamped(model):
    force = {"output": "sensor.spring_force", "clamped": True, "band_hz": [1, 100], "seed": 3}
    assert measure.measure(model, force | {"level": 0.05}).compare().fits
    assert measure.measure(model, force | {"inject": "codes", "level": 15}).compare().fits


def test_a_contact_that_does_not_stay_as_the_model_has_it_is_told():
    force = {"output": "sensor.force", "band_hz": [2, 100], "averages": 4}
    lost = measure_result.run("fig4_19", force)
    share = lost.summary.contact["sensor"]
    assert 0 < share < 0.1
    (hint,) = lost.summary.hints
    assert f"apart {100 * (1 - share):.3g} % of the time" in hint and "press harder" in hint
    assert hint in in_words(lost.summary)
    kept = measure_result.run("fig4_19", force | {"bias": 1.0, "level": 0.02})
    assert kept.summary.contact == {"sensor": 1.0} and kept.summary.hints == []
    codes = force | {"inject": "codes", "output": "adc0", "bias": 100, "level": 15}
    assert measure_result.run("fig4_19", codes).summary.contact == {"sensor": 1.0}

    free = {"free": True, "output": "robot.velocity", "band_hz": [2, 60], "level": 0.3}
    met = measure_result.run("fig4_17", free).summary
    assert met.contact["sensor"] > 0 and "approach = 0.5" in met.hints[0]
    apart = measure_result.run("fig4_17", free | {"set": {"approach": 0.5}}).summary
    assert apart.contact == {"sensor": 0.0} and apart.hints == []
    clamped = measure_result.run("fig4_19", force | {"clamped": True}).summary
    assert clamped.contact == {} and clamped.hints == []


def test_the_rounding_of_the_input_is_told():
    codes = {"inject": "codes", "output": "drive.current", "level": 20, "band_hz": [1, 50]}
    hints = measure_result.run("fig3_9", codes | {"input": "encoder"}).summary.hints
    assert "too small" in hints[0]
    assert measure_result.run("fig3_9", codes).summary.hints == []
    volts = {"input": "drive.current", "output": "drive.tach", "band_hz": [1, 50]}
    assert measure_result.run("fig3_9", volts).summary.hints == []


def test_hann_begins_where_taking_out_the_mean_does_not_reach():
    codes = {"inject": "codes", "output": "adc0", "level": 60, "band_hz": [1, 40]}
    many = codes | {"window": "hann", "averages": 256, "resolution_hz": 1.0}
    done = [measure.measure("fig3_12", many | {"seed": seed}) for seed in range(4)]
    assert done[0].frequency_hz[0] == pytest.approx(3.0)
    error = np.mean([abs(m.response - m.predict()) ** 2 / m.variance for m in done], axis=0)
    assert error[:3].mean() < 2.5


def test_what_a_plant_of_less_damping_leaves_behind_is_waited_for(monkeypatch):
    waited = []
    record = measure.record_periods
    monkeypatch.setattr(measure, "record_periods", lambda *a: (waited.append(a[2]), record(*a))[1])
    options = {"output": "sensor.spring_force", "clamped": True, "band_hz": [5, 60], "averages": 4}
    for b_w in (363.0, 3.63):
        measure.measure("fig4_19", options | {"set": {"b_w": 363.0}}, {"b_w": b_w})
    assert waited[1] > 2 * waited[0]


def test_files_of_a_measurement_are_written_all_or_none(tmp_path):
    (tmp_path / "plot.png").mkdir()
    title = {"title": "cost $5^$ a piece", "band_hz": [5, 50]}
    done = measure_result.run("fig3_9", title)
    with pytest.raises(IsADirectoryError):
        measure_result.write(done, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["plot.png"]
    measure_result.write(done, tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"response.csv", "response.npz", "plot.png", "result.json"}


def test_the_noise_is_held_no_longer_than_the_firmware_can():
    slow = {"inject": "codes", "level": 20, "band_hz": [0.004, 0.006], "averages": 4}
    assert measure.measure("fig3_9", slow).compare().points == 1


def test_the_command_to_repeat_a_measurement_is_exact():
    low, high = 2.00000123, 50.0000045
    options = {"band_hz": (low, high), "output": "drive.current"}
    command = command_line("fig3_9", options, {"m_r": 110.0}, {"m_r": 146.0})
    assert f"--band {low!r}:{high!r}" in command
    assert command.endswith("--set m_r=110.0 --plant-set m_r=146.0")
    done = measure_result.run("fig3_9", options)
    assert done.summary.title == ""  # the file's is that of another signal


def test_a_saturated_converter_is_told():
    codes = {"inject": "codes", "output": "adc0", "excitation": "sine", "points": 4}
    done = measure_result.run("fig3_12", codes | {"level": 200})
    assert 0.01 < done.measured.saturated < 0.9
    assert not done.summary.comparison.fits
    assert "at an end of the ADC" in in_words(done.summary)
    for kind in ({}, {"excitation": "noise", "window": "hann"}):
        assert measure.measure("fig3_12", codes | {"level": 60} | kind).saturated == 0


def test_contact_is_kept_by_a_bias():
    kept = {"inject": "codes", "output": "adc0", "bias": 100, "level": 15, "band_hz": [1, 100]}
    assert measure.measure("fig4_19", kept).compare().fits
    lost = measure.measure("fig4_19", kept | {"bias": 5, "level": 60})
    assert not lost.compare().fits
    assert np.median(lost.coherence) < 0.9


def test_noise_is_what_the_converters_make():
    """Standard deviation from residuals, the converters' floor, and the coherence's error agree."""
    m = measure.measure("fig3_9", {"averages": 64})
    assert np.mean(m.floor**2) / np.mean(m.variance) == pytest.approx(1, rel=0.05)
    assert np.median(m.random_error() * abs(m.response)) / np.median(
        np.sqrt(m.variance / 2)
    ) == pytest.approx(1, rel=0.05)
    coarse = measure.measure("fig3_9", {"averages": 64, "bits": 9})
    assert np.median(coarse.floor / m.floor) == pytest.approx(8, rel=0.1)
    assert np.median(coarse.variance / m.variance) == pytest.approx(64, rel=0.2)


def test_p_values_are_uniform():
    p = [measure.measure("fig3_6", {"seed": s, "averages": 8}).compare().p_value for s in range(40)]
    assert stats.kstest(p, "uniform").pvalue > 0.01


def test_measurement_follows_the_plant_not_the_model():
    nominal = measure.measure("fig3_9")
    moved = measure.measure("fig3_9", plant_set={"rotor_mass": 1.1 * 79.53})
    assert not moved.compare().fits
    assert moved.compare(moved.predict({"rotor_mass": 1.1 * 79.53})).fits
    ratio = moved.readings().corner_hz / nominal.readings().corner_hz
    truth = [
        linear.linearise(
            "fig4_5", outputs=["drive.tach"], overrides={"k_amp": 582, "rotor_mass": m}
        )
        for m in (79.53, 1.1 * 79.53)
    ]
    corners = []
    for system in truth:
        f = np.linspace(30, 60, 3001)
        size = abs(system.response(f)) / abs(system.response([0.01]))
        corners.append(f[np.flatnonzero(size < np.sqrt(0.5))[0]])
    assert ratio == pytest.approx(corners[1] / corners[0], rel=2e-3)
    # With the same parameter the model agrees.
    same = measure_result.run("fig3_9", {"set": {"rotor_mass": 1.1 * 79.53}})
    assert same.summary.comparison.fits


def test_same_seed_same_measurement():
    codes = {"inject": "codes", "output": "adc0", "level": 60}
    a, b = (measure.measure("fig3_12", codes) for _ in range(2))
    assert (a.response == b.response).all()
    c = measure.measure("fig3_12", codes | {"seed": 1})
    assert (a.response != c.response).any()


# The seven measurements of 3.2.

# What our parameters give: gain at the lowest line, corner and first phase crossing, Hz.
READINGS = {
    "fig3_6": (3.9, None, None),
    "fig3_7": (4.2, 150, None),
    "fig3_8": (0.977, 2000, None),
    "fig3_9": (0.853, 42.6, None),
    "fig3_10": (0.477, None, 45.0),
    "fig3_11": (0.478, None, 26.0),
    "fig3_12": (609, None, 28.2),
}


def test_there_are_seven():
    assert {p.stem for p in FILES.glob("*.toml")} == set(READINGS)
    for path in FILES.glob("*.toml"):
        text = tomllib.loads(path.read_text())
        assert text["figure"] == path.stem[3:].replace("_", ".")
        assert text["title"]
        assert text["shows"]


@pytest.mark.parametrize("name", READINGS)
def test_measurement_of_the_thesis_runs_and_fits(name):
    done = measure_result.run(name)
    assert done.summary.verdict == "the model fits"
    assert done.summary.comparison.inside >= 0.9
    assert done.summary.coherence_median > 0.99
    gain, corner, crossing = READINGS[name]
    readings = done.summary.readings
    assert readings.low_gain == pytest.approx(gain, rel=0.02)
    assert readings.low_gain == pytest.approx(abs(done.model[0]), rel=0.01)
    if corner:
        assert readings.corner_hz == pytest.approx(corner, rel=0.02)
    else:
        assert readings.corner_hz is None
    if crossing:
        assert readings.phase_crossings[0].frequency_hz == pytest.approx(crossing, rel=0.02)
    else:
        assert readings.phase_crossings == []


def test_preamplifier_is_flat():
    m = measure.measure("fig3_6")
    assert abs(m.response / 3.9 - 1).max() < 0.005


# The verb.


def forceaxis(*arguments, cwd=ROOT):
    return verbs.forceaxis("measure", *arguments, cwd=cwd)


def test_files_and_summary(tmp_path):
    done = forceaxis("fig3_9", "--plant-set", "k_tach=0.0398", "--out", tmp_path, "--json")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary == json.loads((tmp_path / "result.json").read_text())
    assert summary["verdict"] == "the model is rejected at 5 %"
    assert summary["command"] == "forceaxis measure fig3_9 --plant-set k_tach=0.0398"
    with (tmp_path / "response.csv").open() as file:
        rows = list(csv.DictReader(file))
    arrays = np.load(tmp_path / "response.npz")
    assert len(rows) == summary["comparison"]["points"] == len(arrays["response"]) == 400
    one = rows[41]
    assert float(one["frequency_hz"]) == 42
    assert float(one["magnitude"]) == pytest.approx(abs(arrays["response"][41]))
    assert float(one["model_magnitude"]) == pytest.approx(abs(arrays["model"][41]))
    assert (tmp_path / "plot.png").stat().st_size > 10000
    text = forceaxis("fig3_9").stdout
    assert "the model fits" in text
    assert "corner       42." in text


def test_model_with_options_from_any_folder(tmp_path):
    done = forceaxis(
        "fig4_19", "--free", "--output", "robot.velocity", "--band", "2:40", "--level", "0.3",
        "--set", "approach=0.5", "--json", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["comparison"]["fits"]


LINE = {
    "unknown output": (
        ["fig3_12", "--output", "nothing"],
        "output: expected one of robot.position",
    ),
    "unknown input": (["fig3_12", "--input", "nothing"], "input: expected one of"),
    "no path": (["fig3_8", "--output", "rotor.velocity"], "no signal path from drive.command"),
    "code without firmware": (["fig3_12", "--output", "adc0"], "needs inject = codes"),
    "Nyquist": (
        ["fig3_12", "--inject", "codes", "--level", 9, "--band", "1:750"],
        "band_hz: expected less than 750 Hz",
    ),
    "band": (["fig3_12", "--band", "1:9601"], "band_hz: expected at most 9600 Hz"),
    "band text": (
        ["fig3_12", "--band", "9"],
        "--band: 9: expected two frequencies in Hz as LOW:HIGH",
    ),
    "band order": (["fig3_12", "--band", "9:2"], "expected two rising frequencies"),
    "too little data": (["fig3_12", "--averages", "2"], "averages: expected a whole number 4"),
    "no line": (["fig3_12", "--resolution", "500"], "expected at least one line"),
    "too long": (["fig3_12", "--resolution", "0.002"], "expected a measurement of at most"),
    "codes level": (
        ["fig3_12", "--inject", "codes"],
        "level: expected a whole number of DAC codes",
    ),
    "DAC": (
        ["fig3_9", "--inject", "codes", "--level", 2048, "--bias", 2047],
        "sum of level and bias of at most 2048 codes",
    ),
    "empty": (["", "--output", "drive.current"], "TARGET: expected a measurement or a model"),
    "stiff": (
        ["fig3_12", "--plant-set", "k_s=1e25", "--band", "5:9"],
        "sensor: expected time constants of at least 1e-8 s, got 6.9e-13 s with workpiece",
    ),
    "hann": (
        ["fig3_12", "--window", "hann", "--band", "5:9", "--resolution", 4],
        "makes the first two spectral lines useless",
    ),
    "clamped": (
        ["fig4_19", "--output", "adc0", "--clamped", "--free"],
        "either --clamped or --free",
    ),
    "no contact": (
        ["laboratory", "--output", "sensor.force"],
        "by a bias or by clamped contacts",
    ),
    "window": (
        ["fig3_12", "--excitation", "sine", "--window", "hann"],
        "expected no window with the excitation sine",
    ),
    "parameter": (["fig3_12", "--set", "nothing=1"], "nothing"),
    "unused": (
        ["fig3_12", "--plant-set", "k_g=1"],
        "parameters.k_g: expected a parameter that the model",
    ),
    "no output": (["fig4_19"], "output: expected the name of the measured signal"),
    "no model": (["fig9_9", "--output", "drive.current"], "fig9_9"),
    "no file": (["fig9_9.toml", "--output", "drive.current"], "fig9_9.toml"),
    "counts that stay": (
        ["fig3_8", "--inject", "codes", "--level", 1, "--output", "adc1", "--band", "10:400"],
        "expected an output signal that changes",
    ),
}


@pytest.mark.parametrize("case", LINE)
def test_mistake_is_one_line(case, monkeypatch, capsys):
    arguments, words = LINE[case]
    monkeypatch.setattr(sys, "argv", ["forceaxis", "measure", *map(str, arguments)])
    monkeypatch.chdir(ROOT)
    with pytest.raises(SystemExit) as done:
        cli.main()
    printed = capsys.readouterr()
    assert done.value.code == 2
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert words in printed.err


GOOD = 'model = "%s"\noutput = "drive.current"\n' % (ROOT / "sim/models/fig3_8.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("colour = 3\n", "colour: expected one of model, title"),
        ("level = -1\n", "level: expected a number > 0, below 1e6, got -1"),
        ('band_hz = "wide"\n', "band_hz: expected two rising frequencies"),
        ("averages = 4.5\n", "averages: expected a whole number"),
        ("set = 3\n", "set: expected a table of numbers"),
        ("bits = 4\n", "bits: expected a whole number 8..16"),
        ('inject = "amperes"\n', "inject: expected volts or codes"),
        ("title = 3\n", "title: expected a text"),
        ('unit = "N\\nm"\n', "unit: expected a text of one line"),
        ("[set]\nk_amp = true\n", "set: expected a table of numbers"),
        ("level =\n", "expected valid TOML"),
    ],
)
def test_file_is_checked(tmp_path, text, words):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    assert read_setup(path)[0].level == 0.1
    path.write_text(GOOD + text)
    with pytest.raises(InputError) as error:
        read_setup(path)
    assert words in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
    path.write_text('output = "drive.current"\n')
    with pytest.raises(InputError, match="model: expected the path"):
        read_setup(path)


# Tachometer feedback a hundred times too strong: growth 60 1/s at 57 Hz.
UNSTABLE = {"k_preamp_fdbk": 400.0, "a_preamp_fdbk": 20.0}


def test_unstable_plants_are_refused():
    with pytest.raises(InputError, match=r"an unstable pole at \+60.* 1/s"):
        measure.measure("fig3_12", {"set": UNSTABLE})
    with pytest.raises(InputError, match="the excited axis is unstable: ") as error:
        measure.measure("fig3_12", plant_set=UNSTABLE)
    assert "\n" not in str(error.value)
    # One that grows so slowly that no bound is passed: seen from period to period.
    slow = {"k_preamp_fdbk": 400.0, "a_preamp_fdbk": 100.0, "k_amp": 582.0}
    with pytest.raises(InputError, match="from period to period"):
        measure.measure("fig3_12", plant_set=slow)


def test_latched_fault_ends_the_measurement():
    excited = _core.Excited(str(ROOT / "sim/models/fig3_12.toml"))
    excited.write("speed_max", 1)
    excited.write("excitation_amplitude", 2000)
    excited.write("mode", 4)
    with pytest.raises(_core.SimulationError, match="latched the fault overspeed"):
        excited.codes(3000, ["dac_code"])
    with pytest.raises(ValueError, match="refuses excitation_amplitude = 4000"):
        excited.write("excitation_amplitude", 4000)


@pytest.mark.parametrize("delay", [0, 2, 6])
def test_a_position_over_a_bus_has_the_aliases_of_its_cycle(tmp_path, delay):
    """Without them the response of an exact machine was 2 % too large at a sixth of the rate of the
    bus and 18 % at 0.4 times of it, and a fit with p = 0.55 had k_s = 3.1 for 2.0 MN/m."""
    folder = drawn_axes.written(tmp_path / "axis", tune_study.BUS)
    period, late, count, tick_s = 6, 1, 600, 1 / 1500
    hz = np.arange(10.0, 110.0, 10.0)
    empty = np.zeros(len(hz))
    one = measurement.Measurement(
        hz, empty + 0j, empty, empty, empty, 1.0, 2, "dac_code", "encoder", "", tick_s, "codes",
        str(folder / "model.toml"), {}, free=True, positions=(period, late), command_delay=delay,
    )  # fmt: skip
    system = measurement.sampled(one, {})
    # In time: the command of a cycle reaches the drive `delay` ticks after its start, at which the
    # drive reads its position; the position arrives `late` ticks after that.
    rng = np.random.default_rng(7)
    sent = rng.normal(size=count // period)
    sent -= sent.mean()
    n = np.arange(count)
    applied = sent[(n - delay) // period % len(sent)]
    x, place = np.zeros(len(system.A)), np.zeros(count)
    for _ in range(60):  # until the motion repeats
        for k in range(count):
            place[k] = system.C[1] @ x + system.D[1, 0] * applied[k]
            x = system.A @ x + system.B[:, 0] * applied[k]
    shown = place[(n - late) // period * period % count]
    lines = np.round(hz * tick_s * count).astype(int)
    measured = np.fft.fft(shown)[lines] / np.fft.fft(applied)[lines]
    assert one.predict() == pytest.approx(measured, rel=1e-6)
