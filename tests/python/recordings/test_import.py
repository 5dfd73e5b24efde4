"""Import of recordings: the same touch in many kinds of file gives the same signals, and wrong or
odd files are refused in one line with their place, while nothing is written."""

import io
import json
import random
import re

import numpy as np
import pyarrow
import pytest
from forceaxis._core import InputError
from forceaxis.bus.log import LogWriter
from forceaxis.recordings import findings, importing, signal_recording
from forceaxis.recordings.reading import read_source
from mcap.writer import Writer
from pyarrow import parquet
from verbs import forceaxis

TIME_S = np.arange(40) / 1000
FORCE_N = np.round(np.where(TIME_S < 0.01, 0, 80 * np.sin(150 * (TIME_S - 0.01)) ** 2), 2)
FORCE_N += np.tile([0.01, -0.02, 0.03, 0, -0.01], 8)
POSITION_MM = np.round(5 - 200 * TIME_S, 4)


def rows(line, decimal="."):
    """The samples, one a line, in the format `line` of t, f and p."""
    texts = [
        line.format(t=t, f=f, p=p) for t, f, p in zip(TIME_S, FORCE_N, POSITION_MM, strict=True)
    ]
    return "\n".join(texts).replace(".", decimal) + "\n"


SCOPE_ROWS = """\
Name\tC:\\scope\\touch.svdx
File\tC:\\scope\\touch.csv
Starttime of export\t133500000000000000\tMonday, 15 January 2024
Endtime of export\t133500000000400000\tMonday, 15 January 2024

Name\tForce\tName\tPos
SymbolComment\t\tSymbolComment\t
Data-Type\tREAL64\tData-Type\tREAL64
SampleTime[ms]\t1\tSampleTime[ms]\t1
SymbolName\tMAIN.fForce\tSymbolName\tAxes.Axis 1.ActPos
Unit\t(N)\tUnit\t(mm)

"""
DIALECTS = {
    "comma": ("t_s,F [N],pos [mm]\n" + rows("{t:.3f},{f:.2f},{p:.4f}"), "F,pos"),
    "semicolon and decimal comma": (
        "Zeit (s);Kraft (N);Weg (mm)\n" + rows("{t:.3f};{f:.2f};{p:.4f}", ","), "Kraft,Weg"),
    "tab, unit row, lines before": (
        "Prüfstand 7\nDatum: 1.2.2024\n\nTime\tF\tpos\nms\tN\tmm\n"
        + rows("{t:.3f}e3\t{f:.2f}\t{p:.4f}"), "F,pos"),
    "blanks and comments": (
        "# touch of press 7\n# t_s F_N pos_mm\n" + rows("  {t:.3f}   {f:.2f} {p:.4f}"),
        "F_N,pos_mm"),
    "quotes": ('"t_s","F, total [N]","pos_mm"\n' + rows('"{t:.3f}","{f:.2f}","{p:.4f}"'),
               "2,pos_mm"),
    "bars, a separator at the end": (
        "t_s|F_N|pos_mm|\n" + rows("{t:.3f}|{f:.2f}|{p:.4f}|"), "F_N,pos_mm"),
    "clock": ("time_s;F_N;pos_mm\n" + rows("12:00:0{t:.6f};{f:.2f};{p:.4f}"), "F_N,pos_mm"),
    "no header": (rows("{t:.3f},{f:.2f},{p:.4f}"), "2:N,3:mm"),
    "STM Studio": (
        "STM Studio log file\nAcquisition period: 1 ms\n\nTime (ms)\tforce_N\tpos\n"
        + rows("{t:.3f}E3\t{f:.2f}\t{p:.4f}"), "force_N,pos:mm"),
    "TwinCAT Scope": (
        SCOPE_ROWS + rows("{t:.3f}e3\t{f:.2f}\t{t:.3f}e3\t{p:.4f}", ",") + "EOF\n",
        "MAIN.fForce,Axes.Axis 1.ActPos"),
    "UTF-16": (("t_s\tF_N\tpos_mm\n" + rows("{t:.3f}\t{f:.2f}\t{p:.4f}")).encode("utf-16"),
               "F_N,pos_mm"),
    "Windows-1252": (("t_s;F_N;Weg [µm]\n" + rows("{t:.3f};{f:.2f};{p:.4f}e3")).encode("cp1252"),
                     "F_N,Weg"),
}  # fmt: skip


def imported(folder, content, columns, *options, suffix="csv"):
    """Imports `content` as `force` and `position` of two columns, and returns the recording."""
    file = folder / f"source.{suffix}"
    if content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    pairs = zip(("force", "position"), columns.split(","), strict=True)
    maps = [word for name, column in pairs for word in ("--map", f"{name}={column}")]
    done = forceaxis("recording", "import", file, *maps, *options, "--out", folder / "touch")
    assert done.returncode == 0, done.stderr
    return signal_recording.read(folder / "touch.npz"), done.stdout


def expect_touch(recording):
    force, position = recording["force"], recording["position"]
    start_s = force.time_s[0]
    np.testing.assert_allclose(force.time_s - start_s, TIME_S, atol=2e-6)
    np.testing.assert_allclose(force.values, FORCE_N, atol=1e-9)
    np.testing.assert_allclose(position.values, POSITION_MM * 1e-3, atol=1e-12)
    assert (force.unit, position.unit) == ("N", "m")
    assert force.rate_hz == pytest.approx(1000, rel=1e-3)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_touch_is_the_same_in_every_dialect(tmp_path, dialect):
    content, columns = DIALECTS[dialect]
    options = ("--time", "1:s") if dialect == "no header" else ()
    recording, printed = imported(tmp_path, content, columns, *options)
    expect_touch(recording)
    if "comma" in dialect.split() and "decimal" in dialect:
        assert "CSV with decimal commas" in printed
    if dialect == "TwinCAT Scope":
        assert recording.source.kind == "TwinCAT Scope with decimal commas"


def test_a_scope_with_little_header(tmp_path):
    """Names alone, with commas and decimal points; and one channel in a file of two columns."""
    text = "Name,Force,Name,Pos\n" + rows("{t:.3f}e3,{f:.2f},{t:.3f}e3,{p:.4f}")
    expect_touch(imported(tmp_path, text, "Force:N,Pos:mm")[0])
    text = "Name,Force,Pos\n" + rows("{t:.3f}e3,{f:.2f},{p:.4f}")
    expect_touch(imported(tmp_path, text, "Force:N,Pos:mm")[0])
    head = "Name\tC:\\a.svdx\nFile\tC:\\a.csv\n\nName\tForce\nSampleTime[ms]\t1\n\n"
    (tmp_path / "one.csv").write_text(head + rows("{t:.3f}e3\t{f:.2f}", ","))
    done = forceaxis(
        "recording",
        "import",
        tmp_path / "one.csv",
        "--map",
        "force=Force:N",
        "--out",
        tmp_path / "a",
    )
    assert done.returncode == 0, done.stderr
    force = signal_recording.read(tmp_path / "a.npz")["force"]
    np.testing.assert_allclose(force.values, FORCE_N)
    np.testing.assert_allclose(force.time_s, TIME_S, atol=1e-12)


def test_groups_of_a_scope_have_their_own_times(tmp_path):
    """A group of 2 ms beside one of 1 ms: its rows end early, and each group has its own clock."""
    lines = rows("{t:.3f}e3\t{f:.2f}").splitlines()
    slow = rows("{t:.3f}e3\t{p:.4f}").splitlines()[::2]
    text = "\n".join(a + ("\t" + slow[i] if i < len(slow) else "") for i, a in enumerate(lines))
    recording, _ = imported(tmp_path, SCOPE_ROWS + text, "MAIN.fForce,Axes.Axis 1.ActPos")
    np.testing.assert_allclose(recording["force"].values, FORCE_N)
    np.testing.assert_allclose(recording["position"].time_s, TIME_S[::2], atol=1e-9)
    np.testing.assert_allclose(recording["position"].values, POSITION_MM[::2] * 1e-3)
    assert recording["position"].clock != recording["force"].clock


def test_arrays_and_parquet(tmp_path):
    table = {"t_s": TIME_S, "F_N": FORCE_N, "pos_mm": POSITION_MM}
    np.savez(tmp_path / "source.npz", **table)
    expect_touch(imported(tmp_path, None, "F_N,pos_mm", suffix="npz")[0])
    parquet.write_table(pyarrow.table(table), tmp_path / "source.parquet")
    expect_touch(imported(tmp_path, None, "F_N,pos_mm", suffix="parquet")[0])


def test_json_messages_of_another_program_in_mcap(tmp_path):
    with (tmp_path / "source.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        topic = writer.register_channel("/ft", "json", 0)
        for t, f, p in zip(TIME_S, FORCE_N, POSITION_MM, strict=True):
            data = json.dumps({"wrench": {"force": {"z": -f}}, "at": [0, p]}).encode()
            writer.add_message(topic, round(t * 1e9) + 10**18, data, 0)
        writer.finish()
    columns = "-/ft/wrench.force.z:N,/ft/at.1:mm"
    recording, _ = imported(tmp_path, None, columns, suffix="mcap")
    expect_touch(recording)
    assert recording["force"].sign == -1


@pytest.mark.parametrize("suffix", ["mcap", "log"])
def test_the_trace_of_a_run_as_messages(tmp_path, suffix):
    """The trace of the simulator through its recording of messages is the trace itself."""
    done = forceaxis(
        "run", "contact", "--set", "experiment.duration_s=0.5", "--set", "verdict.window_s=0.3",
        "--record", tmp_path / f"source.{suffix}", "--out", tmp_path / "out",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    recording, _ = imported(tmp_path, None, "sensor.force_N,robot.position_m", suffix=suffix)
    with np.load(tmp_path / "out/trace.npz") as trace:
        np.testing.assert_allclose(recording["force"].values, trace["sensor.force"])
        np.testing.assert_allclose(recording["force"].time_s, trace["time_s"], atol=1e-12)
    assert recording["position"].rate_hz == pytest.approx(1500)


def test_what_the_recorder_of_the_axis_has_written(tmp_path):
    table = {"time_s": TIME_S, "force_count": np.round(FORCE_N / 0.39), "position_count": TIME_S}
    np.savez(tmp_path / "source.npz", **table)
    columns = "force_count:0.39N,position_count:0.5um"
    recording, _ = imported(tmp_path, None, columns, suffix="npz")
    np.testing.assert_allclose(recording["force"].values, np.round(FORCE_N / 0.39) * 0.39)
    np.testing.assert_allclose(recording["position"].values, TIME_S * 0.5e-6)


def test_rate_delay_and_sign_are_kept(tmp_path):
    recording, printed = imported(
        tmp_path, rows("{f:.2f};{p:.4f}"), "-1:kN,2:mm", "--rate", "1250",
        "--delay", "force=2.5ms", "--title", "Press 7",
    )  # fmt: skip
    force = recording["force"]
    assert (force.sign, force.factor, force.source_unit) == (-1, 1000.0, "kN")
    assert (force.rate_hz, force.delay_s) == (pytest.approx(1250), 0.0025)
    np.testing.assert_allclose(force.values, -1000 * FORCE_N)
    np.testing.assert_allclose(force.true_time_s, np.arange(40) / 1250 - 0.0025, atol=1e-12)
    assert recording.title == "Press 7"
    assert "-column 1, kN" in printed


@pytest.mark.parametrize(("unit", "factor"), [("us", 1e6), ("ms", 1e3), ("s", 1)])
def test_times_of_a_calendar_keep_their_digits(tmp_path, unit, factor):
    """Times in s since 1970 would have steps of 0.24 us."""
    start_s = 1_760_000_000
    times = [f"{round((start_s + t) * factor, 6):.6f}" for t in TIME_S.tolist()]
    lines = [f"{t},{f:.2f},{p:.4f}" for t, f, p in zip(times, FORCE_N, POSITION_MM, strict=True)]
    text = "\n".join([f"time ({unit}),F_N,p_mm", *lines])
    recording, printed = imported(tmp_path, text, "F_N,p_mm")
    assert recording.source.origin_s == start_s
    np.testing.assert_allclose(recording["force"].time_s, TIME_S, atol=5e-7)
    assert f"0 s is {start_s} s of the source" in printed


def test_the_column_of_the_times_may_be_given(tmp_path):
    text = "a,b,F_N,p_mm\n" + rows("{t:.3f}e3,1,{f:.2f},{p:.4f}")
    for time in ("a:ms", "1:ms"):
        expect_touch(imported(tmp_path, text, "F_N,p_mm", "--time", time)[0])
    text = text.replace("a,b", "a (ms),b")
    for time in ("a", "1"):
        expect_touch(imported(tmp_path, text, "F_N,p_mm", "--time", time)[0])


def test_what_was_not_imported_and_an_unequal_unit_are_reported(tmp_path):
    text = "t_s,F [N],pos [mm],temp\n" + rows("{t:.3f},{f:.2f},{p:.4f},20")
    recording, printed = imported(tmp_path, text, "F:kN,pos")
    assert recording.source.not_imported == ("temp",)
    assert "not imported temp" in printed
    assert "the source gives the unit 'N' for F, which was read in kN" in printed
    shown = forceaxis("recording", "info", tmp_path / "touch.npz")
    assert shown.stdout == "\n".join(
        line for line in printed.splitlines() if not line.startswith(("files", "note"))
    ) + "\n"  # fmt: skip
    facts = json.loads(forceaxis("recording", "info", tmp_path / "touch.npz", "--json").stdout)
    assert [one["samples"] for one in facts["signals"]] == [40, 40]


def finding(force, time_s=None):
    time_s = np.arange(len(force)) / 1000 if time_s is None else time_s
    return [(f.kind, round(f.from_s, 4), f.samples) for f in findings.find("force", time_s, force)]


def noisy_touch():
    """A touch of 600 samples with noise, in steps of 0.1 N."""
    noise = np.random.default_rng(1).normal(0, 0.3, 600)
    t = np.arange(600) / 1000
    ringing = 100 * (1 - np.exp(-30 * (t - 0.1)) * np.cos(300 * (t - 0.1)))
    return np.round(np.where(t < 0.1, 0, ringing) + noise, 1)


def test_an_ordinary_touch_has_no_findings():
    assert finding(noisy_touch()) == []


def test_gap_jump_saturation_and_constant_stretch_are_found():
    force, time_s = noisy_touch(), np.arange(600) / 1000
    keep = np.ones(600, bool)
    keep[300:307] = False
    assert finding(force[keep], time_s[keep]) == [("gap", 0.299, 7)]
    assert finding(force + 40 * (time_s >= 0.45)) == [("jump", 0.449, 2)]
    top = np.minimum(force, 120.0)
    found = finding(top)
    assert {kind for kind, _, _ in found} == {"saturation"}
    for _, from_s, samples in found:
        first = round(from_s * 1000)
        assert (force[first : first + samples] >= 120).all()
    stuck = force.copy()
    stuck[400:470] = stuck[400]
    assert [kind for kind, _, _ in finding(stuck)] == ["constant"]
    assert finding(stuck)[0][2] in range(69, 73)


def test_empty_fields_are_missing_samples_of_that_signal_alone(tmp_path):
    lines = rows("{t:.3f};{f:.2f};{p:.4f}").splitlines()
    lines[20] = "0.020;;" + lines[20].split(";")[2]
    recording, printed = imported(tmp_path, "\n".join(["t_s;F_N;p_mm", *lines]), "F_N,p_mm")
    assert len(recording["force"].values) == 39
    assert len(recording["position"].values) == 40
    assert (
        "gap          force, 0.019 to 0.021 s: no sample for 0.002 s, 1 sample missing" in printed
    )


TOUCH = "t_s,F_N,pos_mm\n" + rows("{t:.3f},{f:.2f},{p:.4f}")


def changed(line, text):
    """The touch with another text in a line (from 1)."""
    lines = TOUCH.splitlines()
    lines[line - 1] = text
    return "\n".join(lines) + "\n"


def npz(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def mcap(encoding):
    file = io.BytesIO()
    writer = Writer(file)
    writer.start()
    writer.add_message(writer.register_channel("/ft", encoding, 0), 0, b"\0\1", 0)
    writer.finish()
    return file.getvalue()


def foreign_log(path):
    writer = LogWriter(path)
    writer.write("POSE", b"12345678abcdefgh", 1)
    writer.close()


GOOD = ("--map", "force=F_N")
# what is wrong: (content of the file, options, a pattern of the message)
WRONG = {
    "empty": (b"", GOOD, r"wrong: expected a file with data, got an empty file"),
    "blank lines": ("\n\n\n", GOOD, "expected rows of numbers"),
    "prose": ("Dear colleague,\nthe data follow.\n", GOOD, "expected rows of numbers"),
    "a picture": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", GOOD, "got other binary data"),
    "a byte 0 inside": (TOUCH[:90] + "\0" + TOUCH[90:], GOOD, r"line \d+: expected text, got a"),
    "a row too short": (changed(9, "0.007,1.0"), GOOD, r"line 9: expected 3 fields as in line 2"),
    "a row too long": (changed(9, "0.007,1.0,4,5"), GOOD, r"line 9: expected 3 fields .* got 4"),
    "a row of missing values too short": (
        changed(9, "NaN,NaN"), GOOD, r"line 9: expected 3 fields as in line 2"),
    "cut off": (TOUCH[:-9], GOOD, r"line 41: expected 3 fields .*perhaps because the file was cut"),
    "decimal commas between commas": (
        "t_s,F_N\n" + "".join(f"0,{k:03},1,5\n" for k in range(20)), GOOD,
        r"line 2: expected 2 columns as in the line above, got 4; if the numbers have"),
    "a text in a field": (changed(12, "0.010,overload,3"), GOOD,
                          r"line 12, F_N: expected a number .* got 'overload'"),
    "a decimal comma in one field": ("t_s;F_N\n" + "".join(
        f"0.0{k:02};1,{k}\n" if k == 15 else f"0.0{k:02};1.{k}\n" for k in range(30)), GOOD,
        r"line 17, F_N: expected a number with a decimal point as in line 2, got '1,15'"),
    "an infinite number": (changed(12, "0.010,1e300,3"), GOOD,
                           r"line 12, F_N: expected a number below 1e\+100"),
    "times that go back": (changed(22, "0.002,1,3"), GOOD,
                           r"line 22, t_s: .* later than .*, 0.019 s, got 0.002 s"),
    "times that stand still": (changed(22, "0.019,1,3"), GOOD,
                               r"line 22, t_s: .* later than .*, 0.019 s, got 0.019 s"),
    "a value without a time": (changed(22, ",1,3"), GOOD, r"line 22, t_s: expected a time for"),
    "no column of times": (TOUCH.replace("t_s", "x"), GOOD,
                           r"expected a column of times, got x, F_N, pos_mm; write --time"),
    "times without a unit": (TOUCH.replace("t_s", "t"), GOOD,
                             r"t: expected the unit of the times, got none; write --time t:ms"),
    "an unknown column": (TOUCH, ("--map", "force=Fz:N"),
                          r"--map: expected a column of wrong \(t_s, F_N, pos_mm\), got Fz"),
    "a column of many": ("t_s,a.F_N,b.F_N\n" + rows("{t},{f},{p}"), GOOD,
                         r"--map: expected the name of one column .* #2 a.F_N, #3 b.F_N"),
    "no unit": (TOUCH.replace("F_N", "F"), ("--map", "force=F"),
                r"F: expected the unit of this column, but the source states none; write --map"),
    "a unit of something else": (TOUCH, ("--map", "force=F_N:mm"),
                                 r"F_N: expected a unit of force, such as N, got 'mm'"),
    "an unknown unit": (TOUCH, ("--map", "force=F_N:pdl"),
                        r"--map: .*expected a unit such as N, .* its size, such as :9.80665N"),
    "a mass": (TOUCH, ("--map", "force=F_N:kg"), r"kg measures a mass; .* write :kgf"),
    "a wrong name": (TOUCH, ("--map", "Force=F_N"), r"--map: Force: expected a name of small"),
    "the name of the times": (TOUCH, ("--map", "time_0=F_N"), r"--map: time_0: expected a name"),
    "no equals sign": (TOUCH, ("--map", "F_N"), r"--map: F_N: expected SIGNAL=COLUMN:UNIT"),
    "one signal twice": (TOUCH, ("--map", "force=F_N,force=pos_mm:N"),
                         r"--map: force: expected each signal once"),
    "too few samples": ("t_s,F_N\n0,1\n1,2\n2,3\n", GOOD, r"F_N: expected at least 8 samples"),
    "a rate of 0": (TOUCH, (*GOOD, "--rate", "0"), r"--rate: expected a rate up to"),
    "rate and times": (TOUCH, (*GOOD, "--rate", "10", "--time", "t_s"), r"--rate: expected either"),
    "delay of another signal": (TOUCH, (*GOOD, "--delay", "forc=1ms"),
                                r"--delay: forc: expected one of the signals force; did you mean"),
    "delay without a unit": (TOUCH, (*GOOD, "--delay", "force=2"),
                             r"--delay: force=2: expected a time with its unit"),
    "an archive that is cut off": (npz(t_s=TIME_S, F_N=FORCE_N)[:-40], GOOD,
                                   r"wrong: expected an NPZ file with arrays of numbers"),
    "an array of texts": (npz(t_s=TIME_S, F_N=np.array(["a"] * 40)), GOOD,
                          r"F_N: expected an array of numbers in one dimension"),
    "a matrix": (npz(t_s=TIME_S, F_N=np.ones((40, 2))), GOOD, r"in the shape \(40, 2\)"),
    "arrays of two lengths": (npz(t_s=TIME_S, F_N=FORCE_N[:30]), GOOD,
                              r"F_N: expected 40 values, as many as in the column t_s, got 30"),
    "a Parquet file that is cut off": (b"PAR1\x15\x04", GOOD, r"wrong: expected a Parquet file"),
    "messages in another encoding": (mcap("cdr"), GOOD, r"got only those of /ft \(cdr\)"),
    "messages of another program": (foreign_log, GOOD, r"got only those of POSE"),
    "UTF-16 that is cut off": (TOUCH.encode("utf-16")[:-1], GOOD, r"expected text in UTF-16"),
    "an incident that is damaged": ('{"forceaxis_incident": 1, "samples": {}}', GOOD,
                                    r"expected a file with an incident"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_refused_in_one_line_and_nothing_is_written(tmp_path, case):
    content, options, message = WRONG[case]
    file = tmp_path / "wrong"
    if callable(content):
        content(file)
    else:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    out = tmp_path / "out/touch"
    done = forceaxis("recording", "import", "wrong", *options, "--out", out, cwd=tmp_path)
    assert done.returncode == 2, done.stdout
    assert done.stdout == ""
    assert re.search(message, done.stderr), done.stderr
    assert done.stderr.count("\n") == 1
    assert re.search(r"\bwrong\b|--\w", done.stderr)  # the file or the option
    assert "; " in done.stderr or "such as" in done.stderr or "expected" in done.stderr
    assert not out.parent.exists()


def damaged(rng, data):
    """`data` with one to four faults: other bytes, missing bytes, more separators, or a cut end."""
    d = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at, kind = rng.randrange(len(d) + 1), rng.random()
        if kind < 0.4 and d:
            d[at % len(d)] = rng.randrange(256)
        elif kind < 0.6:
            del d[at : at + rng.randint(1, 30)]
        elif kind < 0.85:
            d[at:at] = rng.choice([b"\n", b",", b";", b"\t", b"nan", b'"', b"1e999", b"\0", b":"])
        else:
            d = d[:at]
    return bytes(d)


def test_damaged_files_are_imported_whole_or_refused(tmp_path):
    """Whatever is damaged: one line, or signals of finite values at ascending times."""
    packed = io.BytesIO()
    table = {"t_s": TIME_S, "F_N": FORCE_N, "pos_mm": POSITION_MM}
    parquet.write_table(pyarrow.table(table), packed)
    sources = [(content, columns) for content, columns in DIALECTS.values()]
    sources += [(content, "F_N,pos_mm") for content in (packed.getvalue(), npz(**table))]
    rng, file, done = random.Random(3), tmp_path / "damaged", {"whole": 0, "refused": 0}
    for _ in range(200):
        content, columns = rng.choice(sources)
        content = content if isinstance(content, bytes) else content.encode()
        file.write_bytes(damaged(rng, content))
        maps = [f"{n}={c}" for n, c in zip(("force", "position"), columns.split(","), strict=True)]
        try:
            made = importing.import_source(read_source(file), file, importing.ImportRequest(maps))
        except InputError as error:
            done["refused"] += 1
            assert "\n" not in str(error)
            continue
        done["whole"] += 1
        for one in made.recording:
            assert np.isfinite(one.values).all()
            assert (np.diff(one.time_s) > 0).all()
    assert min(done.values()) > 4, done


def test_there_are_thirty_wrong_files():
    assert len(WRONG) >= 30


def test_a_recording_is_not_imported_twice_and_an_old_one_stays_after_an_error(tmp_path):
    imported(tmp_path, TOUCH, "F_N,pos_mm")
    before = (tmp_path / "touch.npz").read_bytes()
    again = forceaxis(
        "recording", "import", tmp_path / "touch.npz", *GOOD, "--out", tmp_path / "touch"
    )
    assert again.returncode == 2
    assert "got a recording that was already imported" in again.stderr
    (tmp_path / "source.csv").write_text(changed(12, "0.010,bad,3"))
    failed = forceaxis(
        "recording", "import", tmp_path / "source.csv", *GOOD, "--out", tmp_path / "touch"
    )
    assert failed.returncode == 2
    assert (tmp_path / "touch.npz").read_bytes() == before
