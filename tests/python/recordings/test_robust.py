"""Zero, noise and spikes of a signal with a few wrong samples: those of the other samples."""

import json

import numpy as np
import pytest
import touch_study
from forceaxis.commission import contact_data, level
from forceaxis.recordings import findings, robust, signal_recording, touch
from verbs import forceaxis

pytestmark = pytest.mark.quick
CONVERTER_END = 8388607.0


def test_without_outliers_zero_and_noise_are_mean_and_standard_deviation():
    for seed in range(300):
        rng = np.random.default_rng(seed)
        step = rng.choice([0.0, 0.1, 1.0, 5.0])
        values = rng.normal(rng.uniform(-50, 50), 1.0, int(rng.integers(8, 400)))
        values = np.round(values / step) * step if step else values
        found = robust.quiet_of(values, step)
        if found.count == len(values):
            assert (found.zero, found.noise) == (values.mean(), values.std())
        else:  # eight samples tell their noise badly
            assert len(values) < 20 and found.count >= 0.875 * len(values)


@pytest.mark.parametrize("step", [0.0, 0.5])
@pytest.mark.parametrize("size", [30.0, -3e4, CONVERTER_END])
def test_outliers_change_neither_zero_nor_noise(step, size):
    values = np.random.default_rng(1).normal(3.0, 0.4, 200)
    values = np.round(values / step) * step if step else values
    clean = robust.quiet_of(values, step)
    changed = values.copy()
    changed[::17] += size
    found = robust.quiet_of(changed, step)
    assert found.count == len(values) - len(values[::17])
    assert found.zero == pytest.approx(clean.zero, abs=0.05)
    assert found.noise == pytest.approx(clean.noise, rel=0.1)


def test_a_signal_that_moves_has_no_outliers():
    """A signal at rest in most of the samples that moves in the others is not at rest."""
    values = np.zeros(100)
    values[80:] = 50.0
    assert robust.quiet_of(values, 0.1).count == 100
    assert robust.quiet_of(np.zeros(9)).noise == 0.0


@pytest.mark.parametrize("step", [0.0, 0.25])
def test_the_noise_of_a_touch_down_does_not_have_a_spike(step):
    values = np.random.default_rng(2).normal(0.0, 0.7, 300)
    values = np.round(values / step) * step if step else values
    clean, count = contact_data.noise_of(values, step)
    values[40] = 900.0
    assert contact_data.noise_of(values, step) == (pytest.approx(clean, rel=0.03), count - 1)


def test_the_noise_of_an_axis_at_rest_does_not_have_a_spike():
    codes = np.random.default_rng(3).integers(2046, 2050, 400)
    clean = level.noise_of(codes)
    codes[100] = 4095
    assert level.noise_of(codes) == pytest.approx(clean, rel=0.05)


def test_no_contact_of_one_or_two_samples_is_a_spike():
    """1,000 recordings of 50 Hz to 5 kHz with 8 to 24 bits, of which half bounce for a sample."""
    for seed in range(1000):
        one = touch_study.drawn(seed)
        assert findings.spikes("force", one.time_s, one.force_N) == [], seed


def test_every_spike_of_up_to_three_equal_samples_is_found():
    for seed in range(400):
        one, rng = touch_study.drawn(seed), np.random.default_rng(seed)
        force, width = one.force_N.copy(), int(rng.integers(1, 4))
        at = int(rng.integers(8, len(force) - 8))
        force[at : at + width] = force[at] + rng.choice([-1, 1]) * 10 ** rng.uniform(3, 7)
        assert (at, at + width) in findings.spikes("force", one.time_s, force), seed


def touch_down(spikes):
    """A held contact at 1 kHz after 0.2 s, with spikes {sample: value}."""
    force = np.round(np.random.default_rng(4).normal(0, 0.05, 500), 3)
    force[200:] += 50 * (1 - np.exp(-np.arange(300) / 6))
    for at, value in spikes.items():
        force[at] = value
    return np.arange(500) / 1000, force


def kinds(time_s, force, name="force"):
    return [(one.kind, round(one.from_s, 4)) for one in findings.find(name, time_s, force)]


@pytest.mark.parametrize("size", [700.0, -200.0, CONVERTER_END])
@pytest.mark.parametrize("at", [50, 199, 400])
def test_a_spike_is_named_and_nothing_else(at, size):
    time_s, force = touch_down({at: size})
    assert kinds(time_s, force) == [("spike", at / 1000)]
    (found,) = findings.find("force", time_s, force)
    assert found.samples == 1 and f"1 sample of {size:.6g} between" in found.text
    assert touch.level_of(time_s, force, "force").noise == pytest.approx(0.05, rel=0.2)


@pytest.mark.parametrize("name", ["current", "torque", "voltage_command", "motor.current"])
def test_a_reaction_of_the_controller_is_no_spike(name):
    """For a single tick at a contact, the current of `hold_biquad` is 27 counts lower."""
    time_s, force = touch_down({300: -400.0})
    assert ("spike", 0.3) not in kinds(time_s, force, name)
    assert ("spike", 0.3) in kinds(time_s, force, "position")


def test_a_spike_hides_no_jump_and_makes_no_saturation():
    time_s, force = touch_down({50: CONVERTER_END})
    force[300:] += 40
    assert kinds(time_s, force) == [("spike", 0.05), ("jump", 0.299)]


def test_a_force_of_zero_without_contact_is_no_saturation():
    """Of a simulation or of a converter with a dead zone: nothing there has noise."""
    stroke = np.concatenate([np.full(30, 60.0) + np.arange(30), [60.0, 30.0, 10.0]])
    force = np.concatenate([np.zeros(20), stroke, np.zeros(9), stroke])
    time_s = np.arange(len(force)) / 1000
    assert "saturation" not in {kind for kind, _ in kinds(time_s, force)}
    assert "saturation" not in {kind for kind, _ in kinds(time_s, force + 7)}  # begins there
    top = np.where((force > 0) & (np.arange(len(force)) > 70), 200.0, force)
    top[80:85] = 60.0
    assert "saturation" in {kind for kind, _ in kinds(time_s, top)}


@pytest.mark.parametrize("name", ["force", "position"])
@pytest.mark.parametrize("rest", [0.0, -0.5])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_a_signal_that_is_lost_in_the_middle_of_a_stroke_is_saturation(name, rest, noise):
    """A loose cable gives the value without contact for 4 samples or more."""
    stroke = 0.4 * np.arange(1.0, 201) + np.random.default_rng(6).uniform(0, noise, 200)
    for count in (4, 40):
        force = np.concatenate([np.full(5, rest), stroke, np.full(9, rest)])
        assert "saturation" not in {kind for kind, _ in kinds(np.arange(214) / 1000, force, name)}
        force[105 : 105 + count] = rest
        found = kinds(np.arange(214) / 1000, force, name)
        assert ("saturation", 0.105) in found


def test_a_machine_that_lets_go_at_once_is_at_rest_after_its_last_contact():
    """Of a converter with a dead zone; a small disturbance of the machine follows."""
    force = np.concatenate([np.zeros(20), 0.4 * np.arange(200), np.zeros(30), [1.0, 2.0], [0.0]])
    found = kinds(np.arange(len(force)) / 1000, force)
    assert "saturation" not in {kind for kind, _ in found}


def recorded(tmp_path, spikes, *words):
    time_s, force = touch_down(spikes)
    lines = [f"{t:.3f},{f:.4f},{0.01 * t:.6f}" for t, f in zip(time_s, force, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["t_s,F_N,s_mm", *lines]))
    return forceaxis("recording", "import", "a.csv", "--map", "force=F_N,position=s_mm", *words,
                     "--out", "a", cwd=tmp_path)  # fmt: skip


def test_spikes_are_kept_and_named_or_left_out_and_named(tmp_path):
    spikes = {50: CONVERTER_END, 300: -77.5}
    kept = recorded(tmp_path, spikes)
    assert "spike        force, 0.05 to 0.05 s: 1 sample of 8.38861e+06 between" in kept.stdout
    assert len(signal_recording.read(tmp_path / "a.npz")["force"].values) == 500
    left = recorded(tmp_path, spikes, "--without-spikes")
    assert "note         force: 2 spikes left out, which are 2 samples\n" in left.stdout
    read = signal_recording.read(tmp_path / "a.npz")
    assert len(read["force"].values) == 498 and len(read["position"].values) == 500
    assert np.abs(read["force"].values).max() < 60
    named = [(one.kind, one.from_s) for one in read["force"].findings]
    assert named == [("gap", 0.049), ("spike", 0.05), ("gap", 0.299), ("spike", 0.3)]
    assert read["force"].findings[1].text.endswith(", left out")
    facts = json.loads(recorded(tmp_path, {}, "--without-spikes", "--json").stdout)
    assert [one["clock"] for one in facts["signals"]] == ["0", "0"]
    assert not any("spike" in note for note in facts["notes"])
