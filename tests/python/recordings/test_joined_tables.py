"""Tables whose times, or whose header, are in several places: dates beside clock times, and a file
of its own for the header."""

import json

import numpy as np
import pytest
from forceaxis.recordings import signal_recording
from test_text_tables import FORCE, expect, imported, refused, rows, run, table

DATED = {
    "German": ("Datum;Uhrzeit;Kraft [N]\n", "15.01.2024;14:03:04,{k:03};{f:.3f}"),
    "ISO and blanks": ("Date Time F_N\n", "2024-01-15 14:03:04.{k:03} {f:.3f}"),
    "American": ("Date,Time,F [N]\n", "01/15/2024,2:03:04.{k:03} PM,{f:.3f}"),
    "date behind": ("Time\tDate\tF [N]\n", "14:03:04.{k:03}\t15-Jan-2024\t{f:.3f}"),
    "milliseconds": ("Time,ms,F [N]\n", "14:03:04,{k},{f:.3f}"),
    "all three": ("Date,Time,Millisecond,F [N]\n", "2024/01/15,14:03:04,{k},{f:.3f}"),
}


@pytest.mark.parametrize("form", DATED)
def test_times_in_several_columns_are_joined(tmp_path, form):
    head, row = DATED[form]
    lines = rows(row)
    if form == "German":
        lines = [line[:-4] + line[-4:].replace(".", ",") for line in lines]
    words = ("--map", f"force=#{4 if form == 'all three' else 3}:N")
    signal, printed = imported(tmp_path, table(lines, head), *words)
    begin_s = 14 * 3600 + 3 * 60 + 4 if form == "milliseconds" else 0.0
    expect(signal, begin_s=begin_s)
    if form != "milliseconds":
        assert "0 s is 1705327384 s of the source" in printed
    assert ": with " in printed


def test_the_date_counts_where_two_days_have_one_time(tmp_path):
    """The second half was recorded two days later, at a later time of the day."""
    row = "2024-01-{day},14:00:{s:02}.{ms:03},{f:.3f}"
    lines = [row.format(day=15 + 2 * (k // 30), s=k // 10, ms=100 * (k % 10), f=0.5 * k)
             for k in range(60)]  # fmt: skip
    signal, printed = imported(tmp_path, table(lines, "Date,Time,F_N\n"), "--map", "force=F_N")
    np.testing.assert_allclose(signal.values, FORCE)
    assert signal.time_s[30] - signal.time_s[29] == pytest.approx(2 * 86400 + 0.1)
    assert "no sample for 1.728e+05 s" in printed


def test_a_date_passes_midnight_with_its_time(tmp_path):
    lines = [
        f"01/{15 + k // 30}/2024,{'23:59:59' if k < 30 else '00:00:00'}."
        f"{970 + k if k < 30 else k - 30:03},{0.5 * k:.3f}"
        for k in range(60)
    ]
    signal, _ = imported(tmp_path, table(lines, "Date,Time,F_N\n"), "--map", "force=F_N")
    expect(signal, begin_s=0.97)


@pytest.mark.parametrize(
    ("head", "row", "said"),
    [
        # What is no date, and what are no milliseconds, is not joined.
        ("State,Time,F_N\n", "2024,14:03:04.{k:03},{f:.3f}", None),
        ("Time,load,F_N\n", "14:03:04.{k:03},{k},{f:.3f}", None),
        ("Time,ms,F_N\n", "14:03:04,5,{f:.3f}", "expected another time for each sample"),
        ("Time,ms,F_N\n", "14:03:04,{k}.5,{f:.3f}", "expected another time for each sample"),
    ],
)
def test_other_columns_beside_a_clock_are_not_joined(tmp_path, head, row, said):
    text = table(rows(row), head)
    if said:
        assert said in refused(tmp_path, text, "--map", "force=F_N")
    else:
        signal, printed = imported(tmp_path, text, "--map", "force=F_N")
        expect(signal, begin_s=14 * 3600 + 3 * 60 + 4)
        assert ": with " not in printed


@pytest.mark.parametrize("wrong", ["500.0", "1000", "-1"])
def test_no_millisecond_below_the_first_rows_is_named(tmp_path, wrong):
    lines = [f"08:00:0{k // 100},{k % 100 * 10},{k}" for k in range(600)]
    signal, _ = imported(tmp_path, table(lines, "Time,ms,F_N\n"), "--map", "force=F_N")
    assert signal.rate_hz == pytest.approx(100)
    (tmp_path / "made.npz").unlink()
    lines[550] = f"08:00:05,{wrong},550"
    said = refused(tmp_path, table(lines, "Time,ms,F_N\n"), "--map", "force=F_N")
    assert f"line 552, Time: expected milliseconds from 0 to 999, got '{wrong}'" in said


def test_a_duration_beside_a_clock_is_no_part_of_it(tmp_path):
    """A press takes 480 to 770 ms, once in a second."""
    lines = [f"08:00:{k:02},{480 + 37 * k % 290},{k}" for k in range(60)]
    text = table(lines, "Time,Press time [ms],F_N\n")
    signal, printed = imported(tmp_path, text, "--map", "force=F_N")
    assert signal.rate_hz == pytest.approx(1) and ": with " not in printed


def test_milliseconds_that_do_not_begin_again_with_a_second_are_no_part_of_it(tmp_path):
    lines = [f"08:00:{k // 2:02},{100 + 7 * k},{k}" for k in range(60)]
    said = refused(tmp_path, table(lines, "Time,ms,F_N\n"), "--map", "force=F_N")
    assert "Time: expected" in said and "--rate" in said


def test_a_row_without_its_date_has_no_time(tmp_path):
    lines = rows("2024-01-15,14:03:04.{k:03},{f:.3f}")
    lines[20] = lines[20].removeprefix("2024-01-15")
    said = refused(tmp_path, table(lines, "Date,Time,F_N\n"), "--map", "force=F_N")
    assert "line 22, Time: expected a time for the value of F_N, got none" in said


def header(**changed):
    """A header of an oscilloscope of Rohde & Schwarz; 60 samples at 1 kHz from -0.01 s on."""
    known = {
        "FirmwareVersion": "4.70.1.0", "SignalFormat": "FLOAT", "Source": "Ch1",
        "Resolution": "1e-03", "SignalResolution": "0.001", "RecordLength": "60",
        "XStart": "-0.01", "XStop": "0.05", "SignalRecordLength": "60",
        "HardwareXStart": "-0.01", "SignalHardwareRecordLength": "60",
        "InterleavedTraceCount": "1", "NumberOfAcquisitions": "1",
        "VerticalScale": "0.02", "VerticalUnit": "V", "MultiChannelExport": "Off",
        "MultiChannelExportState": "4:On:Off:Off:Off",
    }  # fmt: skip
    return "".join(f"{key}:{value}:\n" for key, value in (known | changed).items())


BOTH = {"MultiChannelExport": "On", "MultiChannelExportState": "4:On:Off:On:Off"}
SIDES = {
    "a channel": ({}, "{f:.6e}", "force=Ch1:1N"),
    "another source": ({"Source": "eRS_SIGNAL_SOURCE_MATH2"}, "{f:.6e}", "force=MATH2:1N"),
    "two channels": (BOTH, "{k}.5e0 {f:.6e}", "force=Ch3:1N"),
    "times beside": (BOTH, "{t:.5e},{k}.5e0,{f:.6e}", "force=Ch3:1N"),
    "an envelope": ({"InterleavedTraceCount": "2"}, "{k}.5;{f:.6f}", "force=Ch1 max:1N"),
    "samples around it": (
        {"SignalRecordLength": "50", "RecordLength": "50", "XStart": "-0.005"}, "{f:.6e}",
        "force=Ch1:1N",
    ),
}  # fmt: skip


@pytest.mark.parametrize("form", SIDES)
def test_the_header_of_an_oscilloscope_stands_in_a_file_beside(tmp_path, form):
    changed, row, signal = SIDES[form]
    (tmp_path / "source.csv").write_text(header(**changed))
    lines = rows(row, begin=-0.01)
    found, printed = imported(tmp_path, table(lines), "--map", signal, name="source.Wfm.csv")
    expect(found, begin_s=-0.01)
    assert "Rohde & Schwarz" in printed and "names of source.csv" in printed
    assert "the times are those of" in printed or form == "times beside"
    (tmp_path / "made.npz").unlink()
    said = refused(tmp_path, None, "--map", signal, name="source.csv")
    assert "got the header of source.Wfm.csv; import that file" in said


def test_several_acquisitions_of_an_oscilloscope_are_several_recordings(tmp_path):
    (tmp_path / "source.csv").write_text(header(NumberOfAcquisitions="2"))
    done = run(tmp_path, table(2 * rows("{f:.6e}")), "--map", "force=Ch1:1N",
               name="source.Wfm.csv")  # fmt: skip
    assert done.returncode == 0, done.stderr
    for number in (1, 2):
        expect(signal_recording.read(tmp_path / f"made_{number}.npz")["force"], begin_s=-0.01)


def test_samples_without_their_header_say_so(tmp_path):
    lines = table(rows("{f:.6e}"))
    words = ("--map", "force=Ch1:1N", "--rate", "1000")
    said = refused(tmp_path, lines, *words, name="source.Wfm.csv")
    assert "the header source.csv is not beside the samples" in said
    words = ("--map", "force=1:1N", "--rate", "1000")
    expect(imported(tmp_path, lines, *words, name="source.Wfm.csv")[0])


def test_a_header_with_other_channels_names_none(tmp_path):
    lengths = ("SignalHardwareRecordLength", "SignalRecordLength", "RecordLength")
    (tmp_path / "source.csv").write_text(header(**BOTH, **dict.fromkeys(lengths, "62")))
    found, printed = imported(tmp_path, table(rows("{f:.6e}")), "--map", "force=1:1N",
                              name="source.Wfm.csv")  # fmt: skip
    expect(found, begin_s=-0.01)
    assert "source.csv has 2 channels, and the rows 1 columns" in printed
    assert "source.csv states 62 samples, and not 60" in printed


def stcm(*lines):
    """A log of STM32CubeMonitor; each line: (group, variable, [(time in ms, value or None)])."""
    return "".join(
        json.dumps({
            "groupname": group, "variablename": name,
            "variabledata": [{"x": t} if y is None else {"y": y, "x": t} for t, y in data],
        }) + "\n"
        for group, name, data in lines
    )  # fmt: skip


BEGIN_MS = 1_578_586_445_584


@pytest.mark.parametrize("step_ms", [1, 0.5, 25])
def test_a_log_of_cube_monitor_has_a_clock_for_each_variable(tmp_path, step_ms):
    """The first object of a measurement has no value; a variable stands in several lines."""
    force = [(BEGIN_MS + step_ms * k, 0.5 * k) for k in range(60)]
    travel = [(BEGIN_MS + 10 * k, k) for k in range(60)]
    text = stcm(
        ("g", "force", [(BEGIN_MS - step_ms, None), *force[:25]]), ("g", "travel", travel[:7]),
        ("g", "force", force[25:]), ("g", "travel", travel[7:]),
    )  # fmt: skip
    signal, printed = imported(tmp_path, text, "--map", "force=force:N,position=travel:um",
                               name="Log_g_2020.stcm")  # fmt: skip
    expect(signal, rate_hz=1000 / step_ms, begin_s=0.584)
    position = signal_recording.read(tmp_path / "made.npz")["position"]
    np.testing.assert_allclose(position.values, 1e-6 * np.arange(60))
    assert position.rate_hz == pytest.approx(100)
    assert "STM32CubeMonitor; 0 s is 1578586445 s of the source" in printed


def test_variables_of_several_groups_of_cube_monitor_keep_their_group(tmp_path):
    data = [(BEGIN_MS + k, 0.5 * k) for k in range(60)]
    text = stcm(("fast", "force", data), ("slow", "force", [(t, 7 * y) for t, y in data]))
    expect(imported(tmp_path, text, "--map", "force=fast/force:N")[0], begin_s=0.584)
    (tmp_path / "made.npz").unlink()
    assert "which is #1 fast/force, #3 slow/force" in refused(
        tmp_path, text, "--map", "force=force"
    )


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('{"groupname":"g","variabledata":[{"x":1,"y":2}', "in line 2"),
        ('{"groupname":"g"}', "in line 2, got: no variabledata"),
        ('{"variabledata":[{"y":2}]}', "a sample without the time x"),
        ('{"variabledata":[{"x":1,"y":"on"}]}', "'on' in place of a number"),
    ],
)
def test_a_damaged_log_of_cube_monitor_is_refused_by_its_line(tmp_path, line, said):
    good = stcm(("g", "force", [(BEGIN_MS + k, 0.5 * k) for k in range(60)]))
    assert said in refused(tmp_path, good + line + "\n" + good, "--map", "force=force:N")


@pytest.mark.parametrize("value", ["1e999", "nan", "1e-300", "-1"])
def test_a_step_of_no_size_in_a_header_is_no_step(tmp_path, value):
    (tmp_path / "source.csv").write_text(header(SignalResolution=value))
    lines = table(rows("{f:.6e}"))
    said = refused(tmp_path, lines, "--map", "force=Ch1:1N", name="source.Wfm.csv")
    assert "expected a column of times, got Ch1; write --time COLUMN:UNIT, or --rate HZ" in said


@pytest.mark.parametrize("value", ["", "1e999"])
def test_a_header_without_the_begin_of_the_times_says_so(tmp_path, value):
    (tmp_path / "source.csv").write_text(header(HardwareXStart=value))
    signal, printed = imported(tmp_path, table(rows("{f:.6e}")), "--map", "force=Ch1:1N",
                               name="source.Wfm.csv")  # fmt: skip
    expect(signal)
    assert "source.csv does not state the begin of the times, which is 0 here" in printed
