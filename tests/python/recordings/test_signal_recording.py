"""The file of a recording: what is written is read, and other files are refused in one line."""

import dataclasses
import zipfile

import numpy as np
import pytest
from forceaxis import files
from forceaxis._core import InputError
from forceaxis.recordings import signal_recording
from forceaxis.recordings.signal_recording import (
    RecordedSignal,
    RecordingSource,
    SignalFinding,
    SignalRecording,
)

pytestmark = pytest.mark.quick
FINDING = SignalFinding("gap", 0.1, 0.3, 2, 'samples are "missing"')
TIME_S = np.array([0.0, 0.1, 0.3])


def recording():
    force = RecordedSignal(
        "force", "N", "Fz", "kN", 1e3, -1, 10.0, 0.01, "0", (FINDING,), TIME_S,
        np.array([0.0, np.nan, -1 / 3]),
    )  # fmt: skip
    code = RecordedSignal(
        "code", "count", "dac", "count", 1.0, 1, 10.0, 0.0, "0", (), TIME_S, np.array([0.0, 4, 9])
    )
    source = RecordingSource("a.csv", "CSV", "0" * 64, 12, 1.7e9, ("other",))
    return SignalRecording('Press "7", 3 µm', source, (force, code))


def test_a_recording_is_read_as_it_was_written(tmp_path):
    given = recording()
    path = signal_recording.write(given, tmp_path / "new/touch")
    assert path == tmp_path / "new/touch.npz"
    read = signal_recording.read(path)
    assert read == given  # all but the arrays
    for before, after in zip(given, read, strict=True):
        np.testing.assert_array_equal(before.time_s, after.time_s)
        np.testing.assert_array_equal(before.values, after.values)
    again = signal_recording.write(read, tmp_path / "again")
    assert again.read_bytes() == path.read_bytes()
    with np.load(path) as plain:  # NumPy alone
        np.testing.assert_array_equal(plain["time_0"], TIME_S)


def long_recording(values):
    time_s = np.arange(len(values)) / 1e4
    signals = tuple(
        RecordedSignal(name, "N", name, "N", 1.0, 1, 1e4, time_s=time_s, values=values)
        for name in ("force", "load")
    )
    return SignalRecording("long", recording().source, signals)


def test_a_long_recording_is_read_and_a_small_file_that_unpacks_to_much_is_not(
    tmp_path, monkeypatch
):
    """An hour of five signals at 10 kHz has 1.7 GB; what is limited are files of a few bytes."""
    noise = np.random.default_rng(1).normal(size=40_000)
    measured = signal_recording.write(long_recording(noise), tmp_path / "measured")
    empty = signal_recording.write(long_recording(np.zeros(40_000)), tmp_path / "empty")
    for path in (measured, empty):
        assert len(signal_recording.read(path)["load"].values) == 40_000
    monkeypatch.setattr(files, "UNPACKED_MOST_BYTES", 100_000)
    monkeypatch.setattr(files, "UNPACKED_MOST_TIMES", 2)
    read = signal_recording.read(measured)
    assert read["force"].time_s is read["load"].time_s  # in the memory once
    with pytest.raises(InputError, match="expected a content of at most"):
        signal_recording.read(empty)


def test_values_are_those_of_the_time_at_which_they_were_true(tmp_path):
    given = recording()
    # The force is 10 ms late: its samples were true at -0.01, 0.09 and 0.29 s.
    assert given.held("code", np.array([0.0999, 0.1, 0.2, 5.0, -1.0])).tolist() == [0, 4, 4, 9, 0]
    assert given.sampled("code", np.array([0.05, 0.2])).tolist() == [2.0, 6.5]
    assert given["force"].true_time_s.tolist() == pytest.approx([-0.01, 0.09, 0.29])
    assert given.names == ("force", "code")
    assert "position" not in given


@pytest.mark.parametrize("decimals", [4, 5, 6, 9])
@pytest.mark.parametrize("every", [1, 6])
def test_a_code_acts_in_its_own_tick_for_all_decimals_of_the_stamps(decimals, every):
    """Ticks of 1/1500 s, or every sixth one, written with a few decimals; samples are missing."""
    tick = np.delete(np.arange(0, 3000, every), [*range(40, 45), 77])
    stamps = np.array([float(f"{(t + 1) / 1500 + 12:.{decimals}f}") for t in tick])
    code = RecordedSignal(
        "code", "count", "dac", "count", 1.0, 1, 1500.0, time_s=stamps, values=tick.astype(float)
    )
    given = SignalRecording("codes", recording().source, (code,)).even(1 / 1500)
    at_s = given["code"].true_time_s[0] + np.arange(tick[-1] + 1) / 1500
    expected = [tick[tick <= t][-1] for t in range(tick[-1] + 1)]
    assert given.held("code", at_s).tolist() == expected


def test_stamps_off_a_grid_by_more_than_a_quarter_of_a_step_stay():
    for stamps in (
        np.arange(9) / 1500 + np.array([0, 0, 0, 0, 0.6, 0, 0, 0, 0]) / 1500,
        np.round(np.arange(0, 30) / 1500, 3),  # some are equal
        np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 30)) / 1500,
        TIME_S[:2],
    ):
        signal = dataclasses.replace(recording()["code"], time_s=stamps, values=stamps)
        given = SignalRecording("codes", recording().source, (signal,))
        np.testing.assert_array_equal(given.even(1 / 1500)["code"].time_s, stamps)


def test_two_signals_of_one_clock_have_the_same_times(tmp_path):
    force, code = recording()
    late = dataclasses.replace(code, time_s=TIME_S + 0.02)
    both = SignalRecording("a", recording().source, (force, late))
    with pytest.raises(ValueError, match="code: expected the times of the clock 0"):
        signal_recording.write(both, tmp_path / "a")
    assert not list(tmp_path.iterdir())


def broken(tmp_path, name, content):
    path = tmp_path / "broken.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(name, content)
    return path


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.npy", b""),
        ("recording.toml", "format = 1\n"),
        ("recording.toml", "format = "),
        ("recording.toml", 'format = 1\n[[signal]]\nname = "force"\nclock = "0"\n'),
    ],
)
def test_another_file_is_refused_in_one_line(tmp_path, name, content):
    path = broken(tmp_path, name, content)
    with pytest.raises(InputError, match="expected") as refused:
        signal_recording.read(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_missing_or_cut_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.npz: expected a readable file, got none"):
        signal_recording.read(tmp_path / "none.npz")
    path = signal_recording.write(recording(), tmp_path / "cut")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(InputError, match="expected a recording that"):
        signal_recording.read(path)
    assert not signal_recording.is_recording(path)
