"""The first contact of a recorded force: contacts of one sample, noise, and disturbances."""

import numpy as np
import pytest
import touch_study
from forceaxis._core import InputError
from forceaxis.recordings import touch

pytestmark = pytest.mark.quick
RATE_HZ = 1000.0


def held(noise, seed, count=600, first=400, force_N=30.0):
    """Returns times and a force that is held from the sample `first` on."""
    rng = np.random.default_rng([45, seed])
    force = noise * rng.standard_normal(count)
    force[first:] += force_N * (1 - np.exp(-np.arange(1, count - first + 1) / 5))
    return np.arange(count) / RATE_HZ, force


def first_of(time_s, force):
    return touch.first_touch(time_s, force, touch.level_of(time_s, force, "force"))


def test_contacts_of_one_and_two_samples_are_found_within_a_sample():
    """At 50 Hz to 5 kHz and with 8 to 24 bits; two successive samples were needed before, which
    found 86 of these 200."""
    every = [touch_study.found(touch_study.drawn(seed)) for seed in range(200)]
    assert every.count("missed") == 0
    assert every.count("found") >= 195


def test_noise_alone_is_no_contact():
    """Noise alone exceeds the level in one of 1,000 recordings, so in more than 3 of 300 with a
    probability of 0.03 %."""
    early = 0
    for seed in range(300):
        time_s, force = held(0.1, seed)
        early += first_of(time_s, force).time_s < 0.399
    assert early <= 3


def test_a_single_contact_is_noted_with_the_time_between_its_samples():
    time_s, force = held(0.1, 1)
    force[391] += 7.0
    found = first_of(time_s, force)
    assert found.is_single and found.deviations == pytest.approx(70, rel=0.2)
    assert (found.open_s, found.doubtful_s) == (pytest.approx(0.390), None)
    assert 0.390 < found.time_s <= 0.391


def test_a_force_between_noise_and_contact_cannot_be_told():
    """1.2 N is far above the noise of 0.01 N, but less than 0.5 % of 500 N."""
    time_s, force = held(0.01, 2, force_N=500.0)
    force[380] += 1.2
    found = first_of(time_s, force)
    assert found.time_s == pytest.approx(0.399, abs=0.002)
    assert found.doubtful_s == pytest.approx(0.380)


@pytest.mark.parametrize(("place", "size"), [(100, 8388607.0), (100, -8388607.0), (398, 1e6)])
def test_a_disturbance_of_the_sensor_is_neither_contact_nor_noise(place, size):
    """A converter gives 2^23 - 1 for a sample; level_of() and touch_of() then disagreed."""
    time_s, force = held(0.1, 3)
    force[place] = size
    level = touch.level_of(time_s, force, "force")
    assert level.noise == pytest.approx(0.1, rel=0.15)
    assert touch.touch_of(time_s, force, level) == pytest.approx(0.399, abs=0.002)


def test_a_single_sample_without_a_contact_within_half_a_second_is_a_disturbance():
    time_s, force = held(0.1, 4, count=1200, first=1000)
    force[300] += 7.0
    assert first_of(time_s, force).time_s == pytest.approx(0.999, abs=0.002)
    force[300] -= 7.0
    force[600] += 7.0  # here the contact follows within 0.4 s
    assert first_of(time_s, force).time_s == pytest.approx(0.5995, abs=0.001)


def test_a_recording_of_one_sample_in_contact_is_refused():
    time_s, force = held(0.1, 5, first=600)
    force[300] += 7.0
    with pytest.raises(InputError, match="positive in compression and rises"):
        touch.level_of(time_s, force, "force")


@pytest.mark.parametrize("quiet", [0, 1, 4, 6, 7, 8])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3])
def test_a_recording_that_begins_too_late_says_so(quiet, noise):
    """A force that is in contact, or that rises within the first samples, has the right sign; its
    zero was that of the contact."""
    for seed in range(20):
        time_s, force = held(noise, seed, first=quiet)
        with pytest.raises(InputError, match="begin the recording earlier"):
            touch.level_of(time_s, force, "force")


@pytest.mark.parametrize("rise", [1, 2, 3])
@pytest.mark.parametrize("quiet", [0, 4])
@pytest.mark.parametrize("count", [40, 400, 2000])
def test_a_slow_rise_that_begins_too_late_says_so(quiet, rise, count):
    """A spring that is pressed from the first samples on, evenly or ever faster."""
    force = np.maximum(np.arange(count) - quiet, 0.0) ** rise
    force *= 40 / force[-1]
    with pytest.raises(InputError, match="begin the recording earlier"):
        touch.level_of(np.arange(count) / RATE_HZ, force, "force")


def transient(first, last_N, time_constant):
    """A filter that begins at `first` and approaches `last_N`."""
    return lambda count: last_N + (first - last_N) * np.exp(-np.arange(count) / time_constant)


BEGINS = {
    "a filter begins at 0": transient(0.0, 3.0, 4.0),
    "four samples are low": lambda count: np.where(np.arange(count) < 4, -0.5, 0.0),
    "five samples are 0": lambda count: np.where(np.arange(count) < 5, 0.0, 2.0),
    "the sensor drifts": lambda count: 0.2 * np.arange(count) / count,
}


@pytest.mark.parametrize("begin", BEGINS.values(), ids=BEGINS)
@pytest.mark.parametrize("noise", [0.0005, 0.02, 0.1])
def test_a_transient_at_the_begin_is_no_contact(begin, noise):
    """There are 1,500 samples before the contact."""
    for seed in range(5):
        time_s, force = held(noise, seed, count=3000, first=1500, force_N=40.0)
        force += begin(3000)
        assert first_of(time_s, force).time_s == pytest.approx(1.4995, abs=0.001)


def test_a_force_of_the_other_sign_begins_early_enough():
    for seed in range(20):
        time_s, force = held(0.3, seed, first=40)
        with pytest.raises(InputError, match="opposite sign"):
            touch.level_of(time_s, -force, "force")
        level = touch.level_of(time_s, force, "force")
        assert abs(level.zero) < 0.3 and level.noise < 0.6
