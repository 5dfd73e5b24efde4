"""Comparison of recordings with predictions: a machine that is as the model says agrees, a machine
of another stiffness or structure does not, and the figures are those of their definitions."""

import dataclasses
import json
import os

import numpy as np
import pytest
from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.commission import contact_data
from forceaxis.experiments import compare, compare_plots
from forceaxis.experiments.prediction import PredictionRequest
from forceaxis.linear import posterior
from forceaxis.recordings import findings, signal_recording, touch
from forceaxis.recordings.signal_recording import RecordedSignal, RecordingSource, SignalRecording
from forceaxis.recordings.touch import ForceLevel
from forceaxis.results import to_json
from verbs import forceaxis

TICK_S = 1 / 1500
MODEL = """
[parameters]
m = { value = 3.0, unit = "kg", source = "weighed" }
k_w = { value = 80e3, unit = "N/m", source = "data sheet" }
gap = { value = 1.0e-3, unit = "m", source = "chosen" }
[[body]]
name = "tool"
mass = "m"
position = "-gap"
[[damper]]
name = "guide"
between = ["tool", "ground"]
damping = 40.0
[[contact]]
name = "part"
between = ["tool", "ground"]
stiffness = "k_w"
damping = 30.0
[drive]
type = "first_order"
body = "tool"
k_act = 5e3
a_act = 600.0
velocity_per_volt = 0.02
[encoder]
body = "tool"
scale = 1e6
[[adc]]
channel = 0
signal = "part.spring_force"
per_count = 0.05
zero_code = 2048
bits = 12
noise = 0.2
"""
PLATE = """
k_p = { value = 80e3, unit = "N/m", source = "data sheet" }
[[body]]
name = "plate"
mass = 0.2
[[spring]]
name = "support"
between = ["plate", "ground"]
stiffness = "k_p"
damping = 30.0
"""
EXPERIMENT = """
title = "A touch"
model = "model.toml"
duration_s = 1.0
[firmware]
mode = "force"
adc_bits = 12
force_zero_code = 2048
force_scale = 800000
force_gain = 4.0
force_setpoint = "20 N"
"""


@pytest.fixture
def experiment(tmp_path):
    (tmp_path / "model.toml").write_text(MODEL)
    file = tmp_path / "touch.toml"
    file.write_text(EXPERIMENT)
    return file


def signal(name, unit, time_s, values, delay_s=0.0):
    rate_hz = float(1 / np.median(np.diff(time_s)))
    return RecordedSignal(
        name,
        unit,
        name,
        unit,
        1.0,
        1,
        rate_hz,
        delay_s,
        name,
        (),
        time_s,
        np.asarray(values, float),
    )


def recorded(file, *signals):
    source = RecordingSource(file.name, "test", "0" * 64, 0)
    return signal_recording.write(SignalRecording("Press 7", source, signals), file)


def machine(experiment, *overrides, seed=77):
    """What the machine records of the experiment: (times in s, columns of the trace)."""
    result = _core.run(str(experiment), [*overrides, f"experiment.seed={seed}"])
    columns = result.columns()
    return np.arange(len(result.tick)) * TICK_S, columns


def force_of(columns):
    return (columns["adc0"].astype(float) - 2048) * 0.05


def codes_recording(experiment, *overrides, seed=77, name="codes"):
    """A recording with force, position and codes, which begins 20 ms after tick 0 at another time
    and another zero of force and position."""
    time_s, columns = machine(experiment, *overrides, seed=seed)
    time_s = time_s + 7.25
    return recorded(
        experiment.parent / name,
        signal("force", "N", time_s, force_of(columns) + 1.5),
        signal("position", "m", time_s, columns["encoder"] * 1e-6 + 0.3),
        signal("code", "count", time_s, columns["dac"]),
    )


def compared(experiment, file, *, span_s=0.4, **given):
    request = PredictionRequest(experiment, **({"samples": 12} | given))
    return compare.compare(request, file, span_s)


def by_name(result):
    return {one.figure: one for one in result.figures}


def test_a_machine_that_is_as_the_model_says_agrees(experiment):
    file = codes_recording(experiment, "gap=1.7e-3")
    done = compared(experiment, file)
    result = done.result
    assert result.agrees, result.figures
    assert result.input == "code"
    assert result.gap_m == pytest.approx(1.7e-3, abs=20e-6)  # found by the instant of contact
    assert result.zero_N == pytest.approx(1.5, abs=0.05)
    assert result.noise_N == pytest.approx(0.2, rel=0.2)
    assert {s.name for s in done.signals} == {"force", "position"}
    assert min(result.inside.values()) > 0.85
    assert not result.notes


def test_codes_are_those_of_the_dac_of_the_model(experiment):
    """A DAC of 16 bits has codes beyond 2047. The same machine agrees, and `identify contact` reads
    the same command."""
    model = experiment.parent / "model.toml"
    fine = model.read_text().replace("velocity_per_volt = 0.02", "velocity_per_volt = 0.005")
    model.write_text(fine + "[dac]\nbits = 16\n")
    experiment.write_text(experiment.read_text().replace("force_gain = 4.0", "force_gain = 16.0"))
    file = codes_recording(experiment)
    codes = signal_recording.read(file)["code"].values
    assert 4096 < codes.max() < 32768
    result = compared(experiment, file).result
    assert result.agrees, result.figures
    data = contact_data.touch_downs(str(model), [("touch", signal_recording.read(file))], {})
    assert data.touches[0].volts.max() == pytest.approx(10 * codes.max() / 32768)
    model.write_text(fine)
    with pytest.raises(InputError, match=r"code: expected codes of the DAC .* -2048 to 2047, got"):
        compared(experiment, file)


def test_stamps_of_few_decimals_change_no_figure(experiment):
    """A code that acts a tick late moved the settling time out of its band."""
    exact = codes_recording(experiment)
    whole = signal_recording.read(exact)
    rounded = tuple(dataclasses.replace(s, time_s=np.round(s.time_s, 6)) for s in whole)
    given = signal_recording.write(
        dataclasses.replace(whole, signals=rounded), exact.with_name("few.npz")
    )
    found = compared(experiment, given).result
    assert found.agrees
    for before, after in zip(
        compared(experiment, exact).result.figures, found.figures, strict=True
    ):
        assert (after.measured, after.predicted) == pytest.approx(
            (before.measured, before.predicted), rel=1e-5, abs=1e-6
        )


def test_a_machine_of_another_stiffness_differs_until_the_uncertainty_says_so(experiment):
    file = codes_recording(experiment, "k_w=100e3")
    wrong = compared(experiment, file).result
    assert not wrong.agrees
    assert not by_name(wrong)["residual of force"].agrees
    wide = compared(experiment, file, over=["k_w=40%"], samples=24).result
    assert wide.agrees, wide.figures
    assert compared(experiment, file, overrides=["k_w=100e3"]).result.agrees


def posterior_of(file, values):
    """Writes a posterior with these samples (n,) of each parameter."""
    samples = tuple(zip(*(column.tolist() for column in values.values()), strict=True))
    best = tuple(float(np.median(column)) for column in values.values())
    logs = tuple([0.0] * len(samples))
    found = posterior.Posterior(posterior.FORMAT, tuple(values), best, samples, logs)
    file.write_text(json.dumps({"posterior": to_json(found)}))
    return str(file)


def test_a_posterior_gives_the_bands_of_its_joint_samples(experiment):
    """The force tells the stiffness of tool and support in series, not that of each: joint samples
    with one stiffness of both give a narrow band, the same values in another order a wide one."""
    model = experiment.parent / "model.toml"
    text = MODEL.replace("[[body]]", PLATE + "[[body]]", 1)
    model.write_text(text.replace('name = "part"\nbetween = ["tool", "ground"]',
                                  'name = "part"\nbetween = ["tool", "plate"]'))  # fmt: skip
    file = codes_recording(experiment)
    share = 0.6 * np.random.default_rng(3).uniform(-1, 1, 400)
    one = posterior_of(
        experiment.parent / "joint.json", {"k_w": 80e3 / (1 + share), "k_p": 80e3 / (1 - share)}
    )
    two = posterior_of(
        experiment.parent / "any.json", {"k_w": 80e3 / (1 + share), "k_p": 80e3 / (1 - share[::-1])}
    )
    joint, apart = (
        compared(experiment, file, span_s=0.2, over=[over], samples=40).result
        for over in (one, two)
    )
    assert joint.agrees and apart.agrees, joint.figures
    impulse = [by_name(result)["impulse of 25 ms"] for result in (joint, apart)]
    narrow, wide = (figure.high - figure.low for figure in impulse)
    assert narrow < 0.6 * wide
    assert compared(experiment, file, span_s=0.1, over=[f"{one},m=5%"]).result.agrees


def test_without_a_recorded_command_the_law_of_the_firmware_is_the_input(experiment):
    time_s, columns = machine(experiment, "gap=0.8e-3")
    file = recorded(experiment.parent / "law", signal("force", "N", time_s, force_of(columns)))
    result = compared(experiment, file, samples=40).result
    assert result.input == "law"
    assert result.gap_m is None
    assert result.agrees, result.figures
    assert not compared(experiment, file, overrides=["firmware.force_gain=6"]).result.agrees


def test_recorded_set_points_act_at_their_times_after_the_first_contact(experiment):
    at = '[[at]]\ntime_s = 0.4\nfirmware = { force_setpoint = "35 N" }\n'
    plain = experiment.read_text()
    experiment.write_text(plain + at)
    time_s, columns = machine(experiment)
    experiment.write_text(plain)
    asked = np.where(time_s < 0.4, 20.0, 35.0)
    file = recorded(
        experiment.parent / "setpoints",
        signal("force", "N", time_s + 3, force_of(columns)),
        signal("force_setpoint", "N", time_s + 3, asked),
    )
    result = compared(experiment, file, span_s=0.8).result
    assert result.input == "force_setpoint"
    assert result.agrees, result.figures
    assert by_name(result)["held force"].measured > 22
    assert not compared(experiment, file, span_s=0.8, input="law").result.agrees


@pytest.mark.parametrize("rate_hz", [1000, 1500, 20000])
def test_a_machine_whose_speed_is_recorded(experiment, rate_hz):
    """The speed that somebody else's controller commands is the input of the drive, and the
    recorder has a rate and a delay of its own."""
    ticks = 1200
    speed = np.where(np.arange(ticks) < 500, 0.012, 0.004)
    plant = _core.Plant(str(experiment.parent / "model.toml"), {"gap": 2.2e-3}, seed=5)
    codes, _ = plant.follow(speed / 0.02, True, [])
    tick_s = np.arange(ticks) * TICK_S
    time_s = np.arange(int(ticks * TICK_S * rate_hz)) / rate_hz
    held = np.searchsorted(tick_s, time_s + 1e-9, side="right") - 1
    force = np.interp(time_s, tick_s, (codes[:, 1] - 2048.0) * 0.05)
    file = recorded(
        experiment.parent / "speed",
        signal("force", "N", time_s + 0.02, force, delay_s=0.02),
        signal("speed_command", "m/s", time_s, speed[held]),
    )
    result = compared(experiment, file, samples=24).result
    assert result.input == "speed_command"
    assert result.agrees, result.figures
    assert result.gap_m == pytest.approx(2.2e-3, abs=20e-6)
    assert not compared(experiment, file, overrides=["k_w=95e3"]).result.agrees


# FORCEAXIS_CONTACTS=200 makes so many; the band of a few runs is as wide as its few runs require.
CONTACTS = int(os.environ.get("FORCEAXIS_CONTACTS", "6"))


def test_steep_contacts_of_the_exact_machine_agree_at_any_rate(experiment):
    """The plant is simulated with 12,000 steps a second, and recorded at a rate that does not fit
    the ticks. The force rises by 10 to 70 N within a sample, so an error of the gap of 2 um is
    larger than the noise: of 20 such recordings 11 differed."""
    text = MODEL.replace("value = 80e3", "value = 600e3").replace(
        "damping = 30.0", "damping = 60.0"
    )
    text = text.replace("noise = 0.2", "noise = 0.1").replace("per_count = 0.05", "per_count = 0.2")
    model = experiment.parent / "model.toml"
    model.write_text(text)
    parts, ticks, agreed = 8, 900, 0
    for seed in range(CONTACTS):
        rng = np.random.default_rng([6, seed])
        rate_hz = float(rng.choice([500, 1000, 1500, 3000]))
        fast, slow = rng.uniform(0.01, 0.03), rng.uniform(0.0008, 0.0016)
        volts = np.where(np.arange(ticks) < 500, fast, slow) / 0.02
        held = {"gap": float(rng.uniform(0.6e-3, 2.0e-3))}
        plant = _core.Contacts(
            str(model), held, ["k_w"], ["tool"], [np.repeat(volts, parts)], parts
        )
        force, _ = plant.run(np.array([[600e3]]), np.zeros((1, 1, 3)), 1)[0]
        time_s = np.arange(int(ticks * TICK_S * rate_hz) - 2) / rate_hz
        read = np.interp(time_s, np.arange(len(force)) * TICK_S / parts, force)
        read = 0.2 * np.floor((read + 0.1 * rng.standard_normal(len(read))) / 0.2 + 0.5)
        file = recorded(
            experiment.parent / f"steep{seed}",
            signal("force", "N", time_s, read),
            signal("voltage_command", "V", np.arange(ticks) * TICK_S, volts),
        )
        found = compared(experiment, file, span_s=0.25, samples=24, seed=seed).result
        agreed += found.agrees
        assert found.gap_m == pytest.approx(held["gap"], abs=2e-6)
    assert agreed >= 0.93 * CONTACTS - 1


def test_an_error_of_the_model_is_told_and_widens_the_bands(experiment):
    """A workpiece 10 % stiffer differs. The smallest error with which it agrees is told, and given
    as an option it gives this verdict; much smaller errors do not."""
    file = codes_recording(experiment, "k_w=88e3")
    wrong = compared(experiment, file).result
    assert not wrong.agrees and wrong.model_error == {}
    needed = {kind: one.share for kind, one in wrong.needed_error.items()}
    # The position in contact is 10 % smaller, and the rest of the path is that of the force.
    assert 0.01 < needed["position"] < 0.2
    right = compared(experiment, file, model_error=needed).result
    assert right.agrees and right.model_error.keys() == needed.keys() and not right.needed_error
    little = {kind: share / 4 for kind, share in needed.items()}
    assert not compared(experiment, file, model_error=little).result.agrees
    options = ["--span", "0.4", "--samples", "12"]
    done = forceaxis("compare", experiment, file, *options)
    assert done.returncode == 1 and "with it, all figures would agree (--model-error" in done.stdout
    given = done.stdout.partition("(--model-error ")[2].partition(")")[0]
    done = forceaxis("compare", experiment, file, *options, "--model-error", given)
    assert done.returncode == 0 and "contained in the bands" in done.stdout


def test_a_controller_of_the_machine_is_the_law_until_its_command_is_recorded(experiment):
    model = experiment.parent / "model.toml"
    controller = '[machine_controller]\nlaw = "force_pi"\nsignal = "part.force"\nsetpoint = 25.0\n'
    controller += "speed_max = 0.02\ndamping = 900.0\nintegral_time = 0.05\n"
    model.write_text(model.read_text() + controller)
    head = EXPERIMENT.partition("[firmware]")[0]
    experiment.write_text(head + "[firmware]\nadc_bits = 12\n")
    time_s, columns = machine(experiment, "gap=1.3e-3")
    signals = [
        signal("force", "N", time_s, force_of(columns)),
        signal("speed_command", "m/s", time_s, columns["drive.command"] * 0.02),
        signal("force_setpoint", "N", time_s, np.full(len(time_s), 99.0)),
    ]
    file = recorded(experiment.parent / "pi", *signals)
    law = compared(experiment, file, input="law", overrides=["gap=1.3e-3"]).result
    assert law.agrees, law.figures
    # The command of a tick is a signal only after the tick, so it is recorded one tick late.
    late = dataclasses.replace(signals[1], delay_s=TICK_S)
    fed = compared(experiment, recorded(experiment.parent / "fed", signals[0], late)).result
    assert (fed.input, fed.agrees) == ("speed_command", True), fed.figures
    found = compared(experiment, recorded(experiment.parent / "two", signals[0], signals[2])).result
    assert found.input == "law"
    assert "force_setpoint are no input" in found.notes[0]
    with pytest.raises(InputError, match="input: expected one of law, voltage_command"):
        compared(experiment, file, input="force_setpoint")


def test_gaps_of_the_recorded_force_are_noted(experiment):
    time_s, columns = machine(experiment)
    kept = (time_s < 0.3) | (time_s > 0.32)
    force, time_s = force_of(columns)[kept], time_s[kept]
    own = dataclasses.replace(
        signal("force", "N", time_s, force), findings=findings.find("force", time_s, force)
    )
    notes = compared(experiment, recorded(experiment.parent / "gap", own)).result.notes
    assert any("gap of the force at 0.299" in note for note in notes), notes


@pytest.mark.parametrize("spike", [-400.0, 8388607.0])
def test_a_spike_before_the_contact_changes_no_figure_and_is_noted(experiment, spike):
    time_s, columns = machine(experiment)
    force = force_of(columns)
    results = []
    for name, values in (("clean", force), ("spiked", force.copy())):
        if name == "spiked":
            values[100] = spike
        own = dataclasses.replace(
            signal("force", "N", time_s, values), findings=findings.find("force", time_s, values)
        )
        results.append(compared(experiment, recorded(experiment.parent / name, own)).result)
    clean, spiked = results
    assert spiked.noise_N == pytest.approx(clean.noise_N, rel=0.02)
    assert by_name(spiked)["peak"].measured == pytest.approx(
        by_name(clean)["peak"].measured, abs=0.01
    )
    assert spiked.agrees == clean.agrees
    assert any(note.startswith("force: 1 spike, at 0.0666") for note in spiked.notes)


def test_the_figures_are_those_of_their_definitions():
    """Half sines of 50, 40 and 20 N with two losses of contact, then 10 N."""
    time_s = np.arange(0, 0.5, 0.0005)

    def bump(start, length, top):
        phase = (time_s - start) / length
        return np.where((phase > 0) & (phase < 1), top * np.sin(np.pi * phase), 0)

    force = bump(0, 0.02, 50) + bump(0.03, 0.02, 40) + bump(0.06, 0.02, 20)
    force += np.where(time_s >= 0.1, 10.0, 0)
    level = ForceLevel(0.0, 0.01, 1.0)
    found = touch.figures_of(time_s, force + 3, ForceLevel(3.0, 0.01, 1.0))
    assert found == touch.figures_of(time_s, force, level)
    assert found.peak_N == pytest.approx(50, rel=1e-3)
    assert found.impulse_N_s == pytest.approx(50 * 0.02 * 2 / np.pi, rel=1e-3)
    assert found.bounces == 3
    # A half sine of the length T and the height F is F pi t / T near its ends.
    assert found.ends_s == pytest.approx([0.0199, 0.0499, 0.0798], abs=2e-4)
    assert found.starts_s == pytest.approx([0.0302, 0.0603, 0.1], abs=6e-4)
    assert found.held_N == pytest.approx(10)
    assert found.settling_s == pytest.approx(0.1)


def test_a_force_that_does_not_settle_has_no_settling_time():
    time_s = np.arange(0, 0.5, 0.001)
    found = touch.figures_of(time_s, 30 + 5 * np.sin(200 * time_s), ForceLevel(0, 0.1, 1))
    assert found.settling_s is None
    assert found.bounces == 0


REFUSED = {
    "no contact": (np.zeros(400), {}, r"expected a force that is positive in compression"),
    "the other sign": (np.where(np.arange(400) < 200, 0, -30.0), {}, r"import the force with the"),
    "no beginning": (np.where(np.arange(400) < 7, 0, 30.0), {}, r"at least 8 samples before the"),
    "no such gap": (None, {"gap": "k_w"}, r"gap: expected a length among the parameters"),
    "another input": (None, {"input": "speed_command"}, r"input: expected a signal of the"),
    "an unknown input": (None, {"input": "joy"}, r"input: expected one of law, code"),
    "few runs": (None, {"samples": 2}, r"samples: expected 8 to 2000 runs"),
    "a wrong range": (None, {"over": ["k_x=3%"]}, r"over: k_x=3%: expected a parameter"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_compared_is_refused(experiment, case):
    force, given, message = REFUSED[case]
    if force is None:
        file = codes_recording(experiment)
    else:
        time_s = np.arange(400) * TICK_S
        file = recorded(experiment.parent / "bad", signal("force", "N", time_s, force))
    with pytest.raises(InputError, match=message):
        compared(experiment, file, **given)


def test_a_gap_that_moves_another_contact_is_refused(experiment):
    model = experiment.parent / "model.toml"
    spare = 'spare = { value = 1, unit = "m", source = "none" }\n[[body]]'
    stop = '[[stop]]\nname = "end"\nbetween = ["tool", "ground"]\nhigh = "spare"\nstiffness = 1e5\n'
    model.write_text(model.read_text().replace("[[body]]", spare, 1) + stop)
    file = codes_recording(experiment)
    with pytest.raises(InputError, match="gap: spare: expected a parameter that moves the contact"):
        compared(experiment, file, gap="spare")


def test_a_drive_that_does_not_follow_the_recorded_command_is_refused(experiment):
    time_s, columns = machine(experiment)
    file = recorded(
        experiment.parent / "force",
        signal("force", "N", time_s, force_of(columns)),
        signal("force_command", "N", time_s, 0 * time_s),
    )
    with pytest.raises(InputError, match="whose drive follows the recorded force command"):
        compared(experiment, file)


def test_the_verb_prints_a_table_writes_its_files_and_ends_with_the_verdict(experiment):
    good, bad = codes_recording(experiment), codes_recording(experiment, "k_w=110e3", name="bad")
    out = experiment.parent / "out"
    options = ("--samples", "12", "--span", "0.3")
    done = forceaxis("compare", experiment, good, *options, "--out", out)
    assert done.returncode == 0, done.stdout
    assert "verdict      agrees" in done.stdout
    names = {file.name for file in out.iterdir()}
    assert names == {"comparison.json", "codes.png", "codes.svg", "codes.npz"}
    both = forceaxis("compare", experiment, good, bad, *options, "--json")
    assert both.returncode == 1
    results = json.loads(both.stdout)
    assert [one["agrees"] for one in results] == [True, False]
    assert json.loads((out / "comparison.json").read_text())[0] == results[0]
    with np.load(out / "codes.npz") as arrays:
        assert arrays["measured_force"].shape == arrays["low_force"].shape
        assert (arrays["low_force"] <= arrays["high_force"]).all()
    missing = forceaxis("compare", experiment, "none.npz", *options)
    assert missing.returncode == 2
    assert missing.stderr == "forceaxis: none.npz: expected a readable file, got none\n"


def test_the_picture_shows_each_signal_and_its_residual(experiment):
    done = compared(experiment, codes_recording(experiment))
    drawn = compare_plots.figure(done)
    labels = [ax.get_ylabel() for ax in drawn.axes]
    assert labels == ["force, N", "residual, N", "position, mm", "residual, mm"]
    measured = drawn.axes[2].lines[-1].get_ydata()
    np.testing.assert_allclose(measured, done.signals[1].measured * 1e3)


def test_an_experiment_carries_its_recordings(experiment):
    codes_recording(experiment)
    plain = experiment.read_text()
    experiment.write_text(plain + '[expect]\nfault = "none"\nrecording = "codes.npz"\n')
    done = forceaxis("test", experiment, "--json")
    assert done.returncode == 0, done.stdout
    keys = [check["key"] for check in json.loads(done.stdout)["tests"][0]["checks"]]
    assert keys[:3] == ["fault", "codes.npz: peak", "codes.npz: impulse of 25 ms"]
    experiment.write_text(experiment.read_text() + "[set]\nk_w = 100e3\n")
    failed = forceaxis("test", experiment)
    assert failed.returncode == 1
    assert "codes.npz: residual of force: expected" in failed.stdout
    before = experiment.read_text()
    assert forceaxis("test", experiment, "--update").returncode == 1
    assert experiment.read_text() == before  # a recording is a demand, no recorded result
    text = 'recording = ["codes.npz"]\nrecording_over = ["k_w=40%"]\n'
    experiment.write_text(plain + "[set]\nk_w = 100e3\n[expect]\n" + text)
    assert forceaxis("test", experiment).returncode == 0
    share = np.exp(0.2 * np.random.default_rng(4).standard_normal(400))
    posterior_of(experiment.parent / "fit.json", {"k_w": 80e3 * share})
    experiment.write_text(plain + "[expect]\n" + text.replace("k_w=40%", "fit.json"))
    assert forceaxis("test", experiment).returncode == 0
    experiment.write_text(plain + "[expect]\nrecording = 3\n")
    wrong = forceaxis("test", experiment)
    assert wrong.returncode == 2
    assert "expect.recording: expected a text or a list of texts" in wrong.stderr


@pytest.mark.long
def test_the_bands_hold_what_they_say(experiment):
    """Machines with parameters of the stated ranges and noise of their own: 95 % of the recordings
    agree, so at least 33 of 40 with a probability of 99.9 %."""
    rng = np.random.default_rng(11)
    agree = 0
    for seed in range(40):
        k_w, m = 80e3 * rng.uniform(0.8, 1.2), 3.0 * rng.uniform(0.9, 1.1)
        overrides = [f"k_w={k_w}", f"m={m}", f"gap={rng.uniform(0.8e-3, 1.4e-3)}"]
        file = codes_recording(experiment, *overrides, seed=500 + seed)
        result = compared(experiment, file, over=["k_w=20%,m=10%"], samples=40).result
        agree += result.agrees
    assert agree >= 33
