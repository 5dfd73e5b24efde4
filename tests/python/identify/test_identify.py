"""Identification: the procedures recover what the simulator was given, and say how well."""

import csv
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import verbs
from click.testing import CliRunner
from forceaxis import _core, linear
from forceaxis._core import InputError
from forceaxis.cli import main as cli
from forceaxis.experiments import run as runs
from forceaxis.identify import fit as fit_response
from forceaxis.identify import measure
from forceaxis.identify import procedures as identify
from forceaxis.identify import result as measure_result
from forceaxis.identify.procedures import Estimate

pytestmark = pytest.mark.beside

ROOT = Path(__file__).resolve().parents[3]
EXPERIMENTS = ROOT / "sim/experiments"


def save(path, **columns):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def run(*arguments, status=0):
    """The verb's JSON."""
    done = CliRunner().invoke(cli.cli, ["identify", *map(str, arguments), "--json"])
    assert done.exit_code == status, done.output + repr(done.exception)
    assert done.output.count("\n") == 1
    return json.loads(done.output)


def refusal(*arguments):
    """What the verb says instead of a result: one line, without a traceback."""
    done = CliRunner().invoke(
        cli.cli, ["identify", *map(str, arguments)], standalone_mode=False, catch_exceptions=True
    )
    assert isinstance(done.exception, InputError | cli.click.ClickException), done.exception
    text = getattr(done.exception, "message", str(done.exception))
    assert "\n" not in text and "expected" in text
    return text


def inside(estimate, true):
    low, high = estimate["interval"]
    return low <= true <= high


# Ring-down.


def recorded(tmp_path, experiment, signal, *overrides):
    """A column of a run as a CSV file."""
    columns = runs.run(EXPERIMENTS / f"{experiment}.toml", overrides).columns
    return save(tmp_path / "down.csv", time_s=columns["time_s"], signal=columns[signal])


@pytest.mark.parametrize("damping", [8.25, 363.0])
def test_the_workpieces_of_5_2_1(tmp_path, damping):
    """Figures 4.26 and 5.6: 6.6 kg on 412700 N/m; zeta = b / (2 sqrt(k m)) is .0025 and .11."""
    file = recorded(tmp_path, "fig4_19_free", "workpiece.position", f"b_w={damping}")
    found = run("decrement", file, "--mass", 6.6)
    ratio = damping / (2 * math.sqrt(412700 * 6.6))
    assert found["natural_frequency"]["value"] == pytest.approx(39.7984, rel=3e-4)
    assert found["damping_ratio_exact"]["value"] == pytest.approx(ratio, rel=1e-3)
    # The thesis's formula leaves sqrt(1 - zeta^2) out.
    by_formula = ratio / math.sqrt(1 - ratio**2)
    assert found["damping_ratio"]["value"] == pytest.approx(by_formula, rel=1e-3)
    assert found["stiffness"]["value"] == pytest.approx(412700, rel=6e-4)
    assert found["damping"]["value"] == pytest.approx(damping, rel=1e-3)
    from_stiffness = run("decrement", file, "--stiffness", "412700+-4127")
    assert from_stiffness["mass"]["value"] == pytest.approx(6.6, rel=6e-4)
    assert inside(from_stiffness["mass"], 6.6 * 1.009) and not inside(
        from_stiffness["mass"], 6.6 * 1.012
    )
    assert from_stiffness["damping"]["value"] == pytest.approx(damping, rel=1e-3)


def test_the_base_of_4_4_3(tmp_path):
    """500 kg on 3.6e6 N/m, and what the slide's damper adds to b_b = 9500."""
    file = recorded(tmp_path, "fig4_17_free", "base.position", "firmware.mode=disabled")
    found = run("decrement", file, "--mass", 500)
    assert found["stiffness"]["value"] == pytest.approx(3.6e6, rel=2e-3)
    assert found["damping"]["value"] == pytest.approx(9500 + 500, rel=5e-3)


@pytest.mark.parametrize(("noise", "step", "ratio"), [(0.02, 0.0, 0.02), (0.0, 0.05, 0.05)])
def test_the_intervals_of_a_ring_down_hold(noise, step, ratio):
    """Noise, or the steps of an ADC, on an offset: 95 % intervals of frequency and damping."""
    omega, hits = 2 * math.pi * 12.0, []
    rate = omega * ratio / math.sqrt(1 - ratio**2)
    for seed in range(200):
        rng = np.random.default_rng(seed)
        t = np.arange(0, 2, 1 / 1500)
        y = 3.7 + np.exp(-rate * t) * np.cos(omega * t + rng.uniform(0, 6)) * rng.uniform(1, 2)
        y += noise * rng.standard_normal(len(t))
        if step:
            y = step * np.floor(y / step + 0.5)
        found = identify.ring_down(t, y, floor=0.1)
        hits.append(
            [
                abs(found.damped_frequency.value - 12.0) <= found.damped_frequency.half,
                abs(found.damping_ratio_exact.value - ratio) <= found.damping_ratio_exact.half,
            ]
        )
    share = np.mean(hits, axis=0)
    # Rounding is no noise: there the intervals err on the safe side.
    assert np.all((share > 0.88) & (share < (1.01 if step else 0.995))), share


@pytest.mark.parametrize(
    ("rate_hz", "frequency", "ratio", "noise"),
    [
        (1500, 33.0, 0.01, 0.1),  # noise whose peaks are more than the vibration's
        (200, 33.0, 0.02, 0.01),  # six samples a cycle
        (1500, 250.0, 0.01, 0.01),
        (1500, 39.8, 0.11, 0.01),
        (1500, 33.0, 0.0, 0.05),  # does not die out at all
    ],
)
def test_noise_and_few_samples_are_in_the_intervals_of_a_ring_down(
    rate_hz, frequency, ratio, noise
):
    omega, hits = 2 * math.pi * frequency, []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        t = np.arange(0, 2, 1 / rate_hz)
        wave = np.cos(omega * math.sqrt(1 - ratio**2) * t + rng.uniform(0, 6))
        y = 3 + np.exp(-ratio * omega * t) * wave + noise * rng.standard_normal(len(t))
        found = identify.ring_down(t, y)
        assert found.cycles > 3 and found.noise == pytest.approx(noise, rel=0.3)
        pairs = ((found.natural_frequency, frequency), (found.damping_ratio_exact, ratio))
        hits.append([abs(estimate.value - true) <= estimate.half for estimate, true in pairs])
    assert np.all(np.sum(hits, axis=0) >= 34), np.sum(hits, axis=0)  # chance: 1.4 % each


def test_what_is_not_one_ring_down_is_refused(tmp_path):
    t = np.arange(0, 2, 1 / 1500)
    noise = np.random.default_rng(0).standard_normal(len(t))
    file = save(tmp_path / "noise.csv", time_s=t, signal=noise)
    assert "explains" in refusal("decrement", file)
    save(file, time_s=t[:50], signal=noise[:50])
    assert "explains" in refusal("decrement", file)
    save(file, time_s=t[:20], signal=noise[:20])
    assert "at least 30 samples, got 20" in refusal("decrement", file)
    save(file, time_s=t, signal=0 * t)
    assert "got 0" in refusal("decrement", file)
    # A second mode nearby widens the intervals, and is reported.
    other = 0.2 * np.exp(-4 * t) * np.sin(2 * np.pi * 50 * t)
    save(file, time_s=t, signal=np.exp(-10 * t) * np.sin(2 * np.pi * 33 * t) + other)
    found = run("decrement", file)
    assert inside(found["damped_frequency"], 33.0)
    assert inside(found["decrement"], 10 / 33)
    assert "not white noise" in found["warnings"][0]
    # What was recorded before the blow does not count.
    later = np.where(t > 0.3, np.exp(-10 * (t - 0.3)) * np.sin(2 * np.pi * 33 * (t - 0.3)), 0)
    save(file, time_s=t, signal=5 + t + later)
    found = run("decrement", file)
    assert found["decrement"]["value"] == pytest.approx(10 / 33, rel=1e-6)
    assert found["decrement_of_ratio"] == pytest.approx(10 / 33, rel=1e-2)
    assert found["warnings"] == []


def test_too_short_a_ring_down_is_refused(tmp_path):
    t = np.arange(0, 1, 1e-3)
    y = np.exp(-2 * t) * np.cos(2 * np.pi * 10 * t)
    file = save(tmp_path / "a.csv", time_s=t, a=y, b=y)
    assert "--signal" in refusal("decrement", file)
    assert "column with the name c in the first line" in refusal("decrement", file, "--signal", "c")
    assert "3 cycles, got 2" in refusal("decrement", file, "--signal", "a", "--to-s", 0.26)
    assert "3 cycles, got 0" in refusal("decrement", file, "--signal", "a", "--to-s", 0.05)
    assert "got both options" in refusal(
        "decrement", file, "--signal", "a", "--mass", 1, "--stiffness", 2
    )
    assert "+-ERROR" in refusal("decrement", file, "--signal", "a", "--mass", "1+-x")
    file.write_text("time_s,a\n0,1\n1,x\n")
    assert "line 3, a: expected a number below 1e+100, got 'x'" in refusal("decrement", file)
    file.write_text("")
    assert "time_s" in refusal("decrement", file)


# Two masses.


def test_the_arm_of_4_4_2_free_and_locked(tmp_path):
    """33 Hz is the arm's mode in free space; with the shaft locked it would be 30.7 Hz."""
    known = ["--total-mass", 132.4, "--stiffness", 665000, "--frequency-hz"]
    free = recorded(tmp_path, "fig4_15_free", "arm.deflection")
    frequency = run("decrement", free)["natural_frequency"]["value"]
    assert frequency == pytest.approx(32.986, rel=1e-3)
    found = run("split", *known, frequency)
    (chosen, other) = found["solutions"]
    assert chosen["m_r1"]["value"] == pytest.approx(114.5, rel=2e-3)
    assert chosen["m_r2"]["value"] == pytest.approx(17.9, rel=1e-2)
    assert (other["m_r1"], other["m_r2"]) == (chosen["m_r2"], chosen["m_r1"])

    # A motor side of 1e6 kg does not move.
    locked = recorded(tmp_path, "fig4_15_free", "arm.deflection", "m_r1=1e6")
    frequency = run("decrement", locked)["natural_frequency"]["value"]
    assert frequency == pytest.approx(found["locked_frequency_hz"], rel=3e-3)
    assert run("split", *known, frequency)["if_locked"]["m_r2"]["value"] == pytest.approx(
        17.9, rel=2e-3
    )


def test_the_split_carries_errors_and_refuses_what_has_no_solution():
    known = ["--total-mass", 132.4, "--stiffness", 665000, "--frequency-hz"]
    m_r2 = run("split", *known, "33+-0.5")["solutions"][0]["m_r2"]
    ends = [run("split", *known, f)["solutions"][0]["m_r2"]["value"] for f in (33.5, 32.5)]
    assert m_r2["interval"] == pytest.approx(ends, rel=5e-3)
    assert "at least 22.559 Hz" in refusal("split", *known, 22.5)
    assert "from 1e-30" in refusal("split", *known, -3)
    tiny = run("split", *known, 1e10)["solutions"][0]["m_r2"]["value"]
    assert tiny == pytest.approx(665000 / (2 * math.pi * 1e10) ** 2)


# Motor.


def steady(tmp_path, rng):
    """The unloaded motor of Figure 4.5 at steady voltages, read as meters show them."""
    rows = []
    for code in range(40, 401, 40):
        plant = _core.Plant(str(linear.find_model("fig4_5")), {"b_m": 0.02})
        for _ in range(3000):
            plant.step(code)
        speed = plant.signal("rotor.velocity") / 0.004043
        volts, tach = plant.signal("drive.voltage"), plant.signal("drive.tach")
        # A revolution counter over a minute; two voltmeters with noise of 5 and 1 mV.
        turns = np.floor(speed * 60 / (2 * math.pi) + rng.random()) * 2 * math.pi / 60
        noise = rng.standard_normal(2) * [0.005, 0.001]
        rows.append((turns, volts + noise[0], tach + noise[1]))
    names = ("speed_rad_per_s", "motor_V", "tach_V")
    return save(tmp_path / "steady.csv", **dict(zip(names, zip(*rows, strict=True), strict=True)))


CONSTANTS = ["--k-torque", 0.5, "--k-back-emf", 0.5, "--k-tach", "0.039", "--resistance"]


def test_tachometer_constant_and_motor_damping(tmp_path):
    """Figure 4.4: k_tach = .039, b_m = .02."""
    file = steady(tmp_path, np.random.default_rng(3))
    through_zero, line = run("tach", file), run("tach", file, "--offset")
    for found in (through_zero["k_tach"], line["k_tach"]):
        assert inside(found, 0.039)
        assert found["value"] == pytest.approx(0.039, rel=5e-3)
    assert inside(line["offset"], 0.0)
    damping = run("motor", file, *CONSTANTS, 4.5)["b_m"]
    assert inside(damping, 0.02)
    assert damping["value"] == pytest.approx(0.02, rel=0.02)
    # An error of the resistance goes over as R b_m = constant.
    wide = run("motor", file, *CONSTANTS, "4.5+-0.45")["b_m"]["interval"]
    assert wide[1] - wide[0] == pytest.approx(2 * 0.1 * 0.02, rel=0.1)


def test_too_few_speeds_are_refused(tmp_path):
    names = ("speed_rad_per_s", "motor_V", "tach_V")

    def rows(*values):
        return save(tmp_path / "a.csv", **dict(zip(names, zip(*values, strict=True), strict=True)))

    file = rows((1, 1, 0.039), (2, 2, 0.078))
    assert "3 rows, got 2" in refusal("tach", file)
    file = rows((1, 1, 0.039), (2, 2, 0.078), (3, 3, 0.117))
    assert "4 rows, got 3" in refusal("tach", file, "--offset")
    assert "other than 0" in refusal("tach", rows(*[(0, 0, 0.1)] * 3))
    assert "different values" in refusal("tach", rows(*[(1, 1, 0.1)] * 4), "--offset")
    backward = rows((1, -1, 0.039), (2, -2, 0.078), (3, -3, 0.117))
    assert "rises" in refusal("motor", backward, *CONSTANTS, 4.5)
    fast = rows((1, 1, 0.1), (2, 2, 0.2), (3, 3, 0.3))
    assert "b_m below 0" in run("motor", fast, *CONSTANTS, 4.5)["warnings"][0]
    assert "line 2, speed_rad_per_s: expected a number below 1e+100, got '1e+200'" in refusal(
        "tach", rows((1e200, 1, 1), (2, 2, 2), (3, 3, 3))
    )
    file.write_text("speed_rad_per_s,tach_V,tach_V\n1,2,3\n2,4,6\n3,6,9\n")
    assert "exactly one column with the name tach_V" in refusal("tach", file)
    file.write_bytes(b"speed_rad_per_s,tach_V\n\xff,1\n")
    assert f"{file}: expected a CSV file in UTF-8" in refusal("tach", file)


# Fit.

TRUTH = {"m_r": 110.0, "k_w": 520000.0}
OPTIONS = {"output": "sensor.spring_force", "band_hz": [2, 120], "bias": 1.0, "averages": 8}


@pytest.fixture(scope="module")
def response(tmp_path_factory):
    """A response that was measured with the plant's parameters changed behind the analyzer."""
    out = tmp_path_factory.mktemp("response")
    measure_result.write(
        measure_result.run("fig4_19", OPTIONS | {"set": {"b_w": 100.0}}, TRUTH), out
    )
    return out


def test_a_fit_finds_what_was_changed(response, tmp_path):
    out = tmp_path / "out"
    found = run("fit", "fig4_19", response, "--fit", "m_r", "--fit", "k_w=3e5", "--out", out)
    for name, true in TRUTH.items():
        row = found["parameters"][name]
        low, high = row["joint_interval"]
        assert low <= true <= high
        assert low < row["interval"][0] < row["value"] < row["interval"][1] < high
        assert high / low < 1.03
    assert found["parameters"]["k_w"]["start"] == 3e5
    assert found["p_value"] > 0.001
    assert json.loads((out / "result.json").read_text()) == found
    assert (out / "plot.png").stat().st_size > 10_000


def test_a_wrong_model_is_told(response):
    found = run("fit", "fig4_19", response, "--fit", "m_r", "--set", "k_w=412700", status=1)
    assert found["p_value"] < 1e-6
    assert any("does not explain" in text for text in found["warnings"])
    assert found["rejected"] and found["set"] is None
    row = found["parameters"]["m_r"]
    assert row["interval"] is row["joint_interval"] is None and row["value"] > 0
    far = run("fit", "fig4_19", response, "--fit", "m_r=5000", "--set", "k_w=412700", status=1)
    assert any("edge of the search range" in text for text in far["warnings"])


def test_a_rejected_model_has_no_intervals_and_nothing_to_set(response):
    """A value from a model that cannot be the plant must not look like an answer."""
    asked = ["identify", "fit", "fig4_19", response, "--fit", "m_r"]
    done = verbs.forceaxis(*asked, "--set", "k_w=412700")
    assert done.returncode == 1 and not done.stderr
    wrong = done.stdout
    assert "verdict      the model is rejected, p " in wrong
    assert "best, but rejected" in wrong
    assert "95 %" not in wrong and "--set" not in wrong and ".." not in wrong
    done = verbs.forceaxis(*asked, "--set", "k_w=520000")
    right = done.stdout
    assert "95 % interval" in right and "use          --set m_r=" in right
    assert "rejected" not in right and done.returncode == 0


def test_a_search_that_has_not_converged_ends_with_status_1(response, monkeypatch):
    searched = fit_response.optimize.least_squares
    monkeypatch.setattr(
        fit_response.optimize, "least_squares", lambda *a, **b: searched(*a, **{**b, "max_nfev": 1})
    )
    done = verbs.forceaxis("identify", "fit", "fig4_19", response, "--fit", "m_r", "--fit", "k_w")
    assert done.returncode == 1 and "the search has not converged" in done.stdout
    assert "use " not in done.stdout


def test_a_csv_file_of_another_analyzer(response, tmp_path):
    """Real and imaginary part with coherence, and what the file does not say as options."""
    saved = np.load(response / "response.npz")
    dt = json.loads(str(saved["about"]))["dt"]
    keep = saved["coherence"] < 1
    file = save(
        tmp_path / "lab.csv",
        frequency_hz=saved["frequency_hz"][keep],
        real=saved["response"].real[keep],
        imag=saved["response"].imag[keep],
        coherence=saved["coherence"][keep],
    )
    asked = ["--fit", "m_r", "--fit", "k_w", "--set", "b_w=100"]
    about = ["--output", "sensor.spring_force", "--averages", 8, "--dt", dt]
    found = run("fit", "fig4_19", file, *asked, *about)
    exact = run("fit", "fig4_19", response, *asked)
    for name in TRUTH:
        span = exact["parameters"][name]["joint_interval"]
        assert span[0] <= found["parameters"][name]["value"] <= span[1]
    again = fit_response.read_response(
        file,
        "fig4_19",
        settings=fit_response.ResponseSettings(output="sensor.spring_force", averages=8, dt=dt),
    )
    assert again.variance == pytest.approx(saved["variance"][keep], rel=1e-6)
    for option, value in [("dt", "nan"), ("dt", "1e9")]:
        words = refusal("fit", "fig4_19", file, *asked, *about, f"--{option}", value)
        assert f"{option}: expected a number" in words
    assert "below 50 Hz" in refusal("fit", "fig4_19", file, *asked, *about[:4], "--dt", 0.01)
    assert "--averages" in refusal("fit", "fig4_19", file, *asked, *about[:2])
    assert "--dt" in refusal("fit", "fig4_19", file, *asked, *about[:4])
    file.write_text("frequency_hz,real,imag,coherence\n1,1,1,1\n")
    assert "coherence" in refusal("fit", "fig4_19", file, *asked, *about)
    file.write_text("frequency_hz,magnitude,phase_deg,coherence\n1,-1,1,.5\n")
    assert "magnitude: expected values above 0" in refusal("fit", "fig4_19", file, *asked, *about)
    file.write_text("frequency_hz,magnitude,phase_deg,coherence\n1,1,1,.5\n2e9,1,1,.5\n")
    assert "frequency_hz: expected rising frequencies above 0" in refusal(
        "fit", "fig4_19", file, *asked, *about
    )


def test_a_damaged_recording_is_refused(response, tmp_path):
    saved = dict(np.load(response / "response.npz").items())
    about = json.loads(str(saved["about"]))

    def words(**changed):
        np.savez(tmp_path / "bad.npz", **(saved | changed))
        return refusal("fit", "fig4_19", tmp_path / "bad.npz", "--fit", "m_r")

    for bad in ([1], 3, about | {"more": 1}, about | {"overrides": [1]}):
        assert "expected a CSV file or a file response.npz" in words(about=json.dumps(bad))
    assert "inject: expected volts" in words(about=json.dumps(about | {"inject": 1}))
    assert "band_hz: expected" in words(about=json.dumps(about | {"band_hz": [None, 1]}))
    variance = saved["variance"]
    for bad in (0 * variance, math.nan * variance, variance[1:], variance[:, None]):
        assert "variance: expected" in words(variance=bad)
    with (tmp_path / "bad.npz").open("wb") as file:
        np.save(file, variance)
    assert "expected a CSV file or a file response.npz" in refusal(
        "fit", "fig4_19", tmp_path / "bad.npz", "--fit", "m_r"
    )


def test_all_files_are_written_or_none(response, tmp_path):
    (tmp_path / "plot.png").mkdir()
    arguments = ["identify", "fit", "fig4_19", str(response), "--fit", "m_r"]
    done = CliRunner().invoke(cli.cli, [*arguments, "--out", str(tmp_path)])
    assert isinstance(done.exception, IsADirectoryError)
    assert "plot.png" in str(done.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["plot.png"]


def test_what_cannot_be_fitted_is_refused(response, tmp_path):
    def words(*names, path=response, model="fig4_19"):
        return refusal("fit", model, path, *(w for n in names for w in ("--fit", n)))

    assert "expected a parameter that the model uses" in words("m_r9")
    assert "START" in words("m_r=heavy")
    assert "as --fit m_r=5" in refusal("fit", "fig4_19", response, "--fit", "m_r", "--set", "m_r=5")
    assert "once" in words("m_r", "m_r=3")
    assert "above 0, got 0" in words("b_m")
    assert "approach: expected a parameter that changes the response" in words("m_r", "approach=1")
    together = words("m_r", "k_torque", "k_back_emf", "r_trans", "k_tach", "m_w", "k_w", "k_s",
                     "b_s", "b_w", "b_r")  # fmt: skip
    assert "only a combination" in together and "r_trans" in together
    assert "response.npz" in words("m_r", path=response / "plot.png")
    few = json.loads(str(np.load(response / "response.npz")["about"]))
    arrays = {n: v for n, v in np.load(response / "response.npz").items() if v.ndim}
    np.savez(tmp_path / "few.npz", about=json.dumps(few), **{n: v[:3] for n, v in arrays.items()})
    assert "at least 4 frequencies for 2" in words("m_r", "k_w", path=tmp_path / "few.npz")


def test_parameters_that_are_hard_to_tell_apart_are_told():
    """The arm's frequency shows k_rf over m_r2 much better than either of them."""
    measured = measure.measure("fig4_15", OPTIONS, {})
    starts = {"m_r1": 114.5, "m_r2": 17.9, "k_rf": 665000.0, "k_s": 110100.0}
    (warned,) = (
        w for w in fit_response.fit(measured, starts).warnings if w.startswith("m_r2 and k_rf")
    )
    assert "nearly indistinguishable" in warned


# Blind.


@pytest.mark.long
def test_blind_axes_are_identified(tmp_path):
    """Twenty axes made by another process, which reports their parameters after the estimates.

    Of each, 4 or 5 parameters are 0.64 to 1.57 times the nominal value at which the fit starts.
    Every set must lie in the intervals that hold for all its parameters at once, but for two. Were
    the intervals too wide, a parameter wrong by a tenth would lie inside, too.
    """
    count = 20
    process = subprocess.Popen(
        [sys.executable, ROOT / "tests/support/blind_axes.py", "19880131", str(count), tmp_path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    tasks = json.loads(process.stdout.readline())
    fits = []
    for task in tasks:
        measured = fit_response.read_response(task["response"], task["model"])
        starts, _ = fit_response.starts_of(task["fit"], measured)
        fits.append(fit_response.fit(measured, starts))
    print(json.dumps([f.values.tolist() for f in fits]), file=process.stdin, flush=True)
    truths = json.loads(process.stdout.readline())
    assert process.wait(10) == 0

    all_inside, region, single, sharp = 0, 0, [], []
    for found, truth in zip(fits, truths, strict=True):
        true = np.array([truth[name] for name in found.names])
        error = abs(np.log(true / found.values))
        all_inside += bool(np.all(error <= found.joint))
        single += (error <= found.single).tolist()
        region += found.distance(true) <= 1
        tenth = np.exp(0.1 * np.eye(len(true)))
        sharp += [found.distance(true * wrong) > 1 for wrong in tenth]
        assert np.ptp([truth[n] / s for n, s in zip(found.names, found.starts, strict=True)]) > 0.1
    assert len(fits) == count and all_inside >= 18
    assert region >= 18  # the joint region itself, of which those intervals are the shadow
    # Of the intervals of one parameter each, too: 95 % of about 85, of which those of a set hang
    # together.
    assert np.mean(single) > 0.85
    assert np.mean(sharp) > 0.8


def test_estimates_carry_errors():
    a, b = Estimate(3.0, 0.3), Estimate(4.0, 0.4)
    product = identify.propagate(lambda x, y: x * y, a, b, unit="m")
    assert (product.value, product.unit) == (12.0, "m")
    assert product.half == pytest.approx(12 * math.sqrt(0.02))


@pytest.mark.parametrize("verb", ["", "decrement", "split", "tach", "motor", "fit"])
def test_every_procedure_has_help_with_an_example(verb):
    words = ["identify", *verb.split()]
    shown = CliRunner().invoke(cli.cli, [*words, "--help"]).output
    assert f"forceaxis {' '.join(words)}" in shown.partition("Example:")[2]
