"""Files of other programs that are no text tables: workbooks, TDMS, MDF. Every file is made here
from known arrays, and every expected number is one of these."""

import datetime
import importlib.util
import json
import zipfile

import numpy as np
import openpyxl
import pytest
from asammdf import MDF, Signal
from forceaxis.recordings import signal_recording
from foreign_files import imported, run
from nptdms import ChannelObject, RootObject, TdmsWriter
from verbs import forceaxis

STEPS = np.arange(60)
FORCE_N = np.round(3 + 2.345 * STEPS, 3)
TRAVEL_MM = np.round(-7 + 0.11 * STEPS, 4)


def refused(file, *words):
    done = run(file, *words)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stdout + done.stderr
    assert not list(file.parent.glob("made*"))
    return done.stderr


def expect(signal, values, rate_hz=1000.0, begin_s=0.0):
    np.testing.assert_allclose(signal.values, values, rtol=1e-12, atol=1e-15)
    assert signal.rate_hz == pytest.approx(rate_hz, rel=1e-7)
    assert signal.time_s[0] == pytest.approx(begin_s, abs=1e-9)


def workbook(folder, *sheets):
    """Writes a workbook of (title, rows)."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets:
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(folder / "press.xlsx")
    return folder / "press.xlsx"


TABLE = [
    ["Report of press 7"], [], ["", "Time", 'Force "Fz"', "Travel", "State"], ["", "s", "N", "mm"],
    *([None, k * 0.001, float(f), float(x), "RUN"]
      for k, f, x in zip(STEPS, FORCE_N, TRAVEL_MM, strict=True)),
]  # fmt: skip
PARAMETERS = ("Setup", [["Operator", "me"], ["Program", 7]])


def test_a_table_of_a_workbook_has_the_names_and_units_above_it(tmp_path):
    file = workbook(tmp_path, PARAMETERS, ("Curve", TABLE), ("Notes", [["nothing"]]))
    found, said = imported(file, "--map", "force=Force 'Fz',position=Travel")
    expect(found["force"], FORCE_N)
    expect(found["position"], 1e-3 * TRAVEL_MM)
    assert "sheet Curve: 60 rows in lines 5 to 64, names of line 3, units of line 4" in said
    assert "sheet Setup" in said and "sheet Notes: expected rows of numbers, got none" in said
    assert found.source.file == "press.xlsx" and found.source.bytes == file.stat().st_size


def test_the_numbers_of_a_workbook_have_no_separators_of_thousands(tmp_path):
    rows = [["t_s", "F_N"], *([k / 1000, 1.234 if k % 2 else 1234] for k in range(20))]
    found, _ = imported(workbook(tmp_path, ("A", rows)), "--map", "force=F_N")
    np.testing.assert_array_equal(found["force"].values, [1234, 1.234] * 10)


def test_clock_times_in_a_workbook(tmp_path):
    begin = datetime.datetime(2026, 5, 14, 23, 59, 59, 900_000)
    for stamp in (lambda k: begin + datetime.timedelta(milliseconds=10 * k),
                  lambda k: datetime.timedelta(hours=30, milliseconds=10 * k),
                  lambda k: datetime.time(1, 2, 3, 10_000 * k)):  # fmt: skip
        rows = [["Zeit", "Kraft [N]"], *([stamp(k), float(FORCE_N[k])] for k in range(60))]
        found, said = imported(workbook(tmp_path, ("A", rows)), "--map", "force=Kraft")
        expect(found["force"], FORCE_N, 100, found["force"].time_s[0])
    assert "to 1 ms" in said


def test_elapsed_times_in_a_workbook_pass_24_hours(tmp_path):
    rows = [["Time", "F [N]"], *([(86390 + k / 2) / 86400, float(FORCE_N[k])] for k in range(60))]
    file = workbook(tmp_path, ("A", rows))
    book = openpyxl.load_workbook(file)
    for row in range(2, 62):
        book.active.cell(row, 1).number_format = "hh:mm:ss.000"
    book.save(file)
    found, _ = imported(file, "--map", "force=F")
    expect(found["force"], FORCE_N, 2, 86390)


def test_several_sheets_with_the_column_are_several_recordings(tmp_path):
    rows = [["t_s", "F_N"], *([k / 1000, float(f)] for k, f in enumerate(FORCE_N))]
    file = workbook(tmp_path, ("1", rows), ("2", [*rows[:1], *([t, -f] for t, f in rows[1:])]))
    assert run(file, "--map", "force=F_N").returncode == 0
    both = [signal_recording.read(tmp_path / f"made_{k}.npz")["force"].values for k in (1, 2)]
    np.testing.assert_array_equal(both[0], FORCE_N)
    np.testing.assert_array_equal(both[1], -FORCE_N)


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (("[Content_Types].xml", "xl/workbook.xml", "xl/sheet1.xml"), "a workbook (xlsx)"),
        (("[Content_Types].xml", "word/document.xml"), "got another document"),
        (("mimetype", "content.xml"), "save the sheet with the data as xlsx or CSV"),
    ],
)  # fmt: skip
def test_an_archive_that_is_no_readable_workbook_says_what_it_is(tmp_path, inside, said):
    with zipfile.ZipFile(tmp_path / "press.xlsx", "w") as archive:
        for name in inside:
            archive.writestr(name, "x")
    text = refused(tmp_path / "press.xlsx", "--map", "force=force_N")
    assert said in text and "app.xml" not in text


def waves(folder, **channels):
    """Writes a TDMS file of {GROUP__CHANNEL: (values, properties)}."""
    with TdmsWriter(folder / "press.tdms") as writer:
        objects = [
            ChannelObject(*name.split("__"), values, properties)
            for name, (values, properties) in channels.items()
        ]
        writer.write_segment([RootObject({}), *objects])
    return folder / "press.tdms"


START = np.datetime64("2026-05-14T12:00:00.100000")


def test_waveforms_of_a_tdms_file_have_their_own_step_start_and_unit(tmp_path):
    fast = {"wf_increment": 5e-4, "wf_start_offset": 0.0, "wf_start_time": START}
    slow = fast | {"wf_increment": 2e-3, "wf_start_time": START + np.timedelta64(10, "ms")}
    file = waves(tmp_path, Fast__Force=(FORCE_N / 1e3, fast | {"unit_string": "kN"}),
                 Slow__Travel=(TRAVEL_MM[:20], slow | {"unit_string": "mm"}))  # fmt: skip
    for words in ("position=Travel,force=Force", "force=#1,position=Slow/Travel"):
        found, said = imported(file, "--map", words)
        expect(found["force"], FORCE_N, 2000)
        expect(found["position"], 1e-3 * TRAVEL_MM[:20], 500, 0.01)
    assert "wf_increment 0.0005 s of Force" in said


@pytest.mark.parametrize("gap_s", [10, 0])
def test_a_waveform_that_starts_again_is_no_single_one(tmp_path, gap_s):
    """Segments of one channel with other starts; with the same one, they are one waveform."""
    begin = np.datetime64("2026-05-14T14:03:04")
    with TdmsWriter(tmp_path / "press.tdms") as writer:
        for k in (0, 1):
            about = {"wf_increment": 1e-3, "unit_string": "N",
                     "wf_start_time": begin + k * np.timedelta64(gap_s, "s")}  # fmt: skip
            writer.write_segment([ChannelObject("g", "It's F", FORCE_N, about)])
    words = ("--map", "force=g/It's F")
    if gap_s:
        assert "expected one wf_start_time, got 2" in refused(tmp_path / "press.tdms", *words)
        return
    found, _ = imported(tmp_path / "press.tdms", *words)
    expect(found["force"], np.tile(FORCE_N, 2))


def test_a_waveform_without_a_start_is_named_and_others_keep_theirs(tmp_path):
    wave = {"wf_increment": 1e-3, "wf_start_offset": 0.0}
    late = wave | {"wf_start_time": START + np.timedelta64(100, "ms")}
    never = wave | {"wf_start_time": np.datetime64("1904-01-01T00:00:00")}
    file = waves(tmp_path, A__F=(FORCE_N, wave | {"wf_start_time": START}), A__G=(FORCE_N, late),
                 A__H=(FORCE_N, never))  # fmt: skip
    found, said = imported(file, "--map", "force=F:N,x=G:1")
    assert [s.time_s[0] for s in found] == [0, pytest.approx(0.1, abs=1e-9)]
    assert "no wf_start_time for A/H, whose times begin at 0" in said


def test_a_channel_of_times_serves_its_group(tmp_path):
    file = waves(tmp_path, A__Time=(STEPS * 1e-3, {"unit_string": "s"}), A__F=(FORCE_N, {}),
                 B__Time=(STEPS * 2e-3, {"unit_string": "s"}), B__F=(-FORCE_N, {}))  # fmt: skip
    found, _ = imported(file, "--map", "force=A/F:N,x=B/F:N")
    expect(found["force"], FORCE_N)
    expect(found["x"], -FORCE_N, 500)
    (tmp_path / "made.npz").unlink()
    said = refused(file, "--map", "force=F:N")
    assert "got F, which is #2 A/F, #4 B/F" in said
    assert "expected a column of" in (said := refused(file, "--map", "force=Fz"))
    assert "A/Time, A/F, B/Time, B/F" in said


def test_a_tdms_file_without_times_asks_for_a_rate(tmp_path):
    file = waves(tmp_path, A__F=(FORCE_N, {"wf_increment": 0.0}))
    assert "--rate" in refused(file, "--map", "force=F:N")
    expect(imported(file, "--map", "force=F:N", "--rate", 1000)[0]["force"], FORCE_N)
    file.write_bytes(file.read_bytes()[:-100])
    assert "may be lost" in imported(file, "--map", "force=F:N", "--rate", 1000)[1]


def measurement(folder, *groups, version="4.10"):
    """Writes an MDF file of (name of the group, times, signals)."""
    file = MDF(version=version)
    for name, time_s, signals in groups:
        file.append(
            [Signal(v, time_s, unit=u, name=n, **more) for n, v, u, more in signals], acq_name=name
        )
    file.save(folder / "press.mf4", overwrite=True)
    file.close()
    return folder / "press.mf4" if version >= "4" else folder / "press.mdf"


@pytest.mark.parametrize("version", ["3.30", "4.10"])
def test_channels_of_an_mdf_file_have_scale_unit_and_the_times_of_their_group(tmp_path, version):
    codes = np.round(FORCE_N / 0.5).astype(np.int16)
    file = measurement(
        tmp_path,
        ("fast", STEPS * 5e-4, [("Force", codes, "N", {"conversion": {"a": 0.5, "b": 10.0}})]),
        ("slow", STEPS[:20] * 2e-3 + 1e-3, [("Travel", TRAVEL_MM[:20], "mm", {})]),
        version=version,
    )
    for words in ("position=Travel,force=Force", "force=#2,position=#4"):
        found, _ = imported(file, "--map", words)
        expect(found["force"], 0.5 * codes + 10, 2000)
        expect(found["position"], 1e-3 * TRAVEL_MM[:20], 500, 1e-3)


def test_invalid_samples_and_texts_of_an_mdf_file(tmp_path):
    states = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on"}
    file = measurement(tmp_path, ("", STEPS * 1e-3, [
        ("Force", FORCE_N, "N", {"invalidation_bits": np.isin(STEPS, [5, 6])}),
        ("State", STEPS.astype(np.uint8) % 2, "", {"conversion": states}),
    ]))  # fmt: skip
    found, said = imported(file, "--map", "force=Force")
    np.testing.assert_array_equal(found["force"].values, np.delete(FORCE_N, [5, 6]))
    assert "2 invalid samples left out" in said
    assert "raw numbers" not in said
    found, said = imported(file, "--map", "x=State")
    np.testing.assert_array_equal(found["x"].values, STEPS % 2)
    assert "State: raw numbers in place of their texts" in said


def test_a_damaged_mdf_file_is_one_line(tmp_path, capfd):
    """Its library logs errors, and prints a traceback when the object of a damaged file ends."""
    file = measurement(tmp_path, ("", STEPS * 1e-3, [("Force", FORCE_N, "N", {})]))
    data = file.read_bytes()
    for damage in (data[:-1500], data[:1000], data.replace(b"##CG", b"##XX"),
                   data.replace(b"##DT", b"##XX")):  # fmt: skip
        file.write_bytes(damage)
        assert "press.mf4: " in refused(file, "--map", "force=Force")
    assert capfd.readouterr().err == ""


def test_equal_names_of_an_mdf_file_are_told_apart(tmp_path):
    force = [("F", FORCE_N, "N", {}), ("F", -FORCE_N, "N", {})]
    file = measurement(tmp_path, ("", STEPS * 1e-3, force), ("", STEPS * 1e-3, force[:1]))
    said = refused(file, "--map", "force=F")
    assert "#2 group 1/F #2, #3 group 1/F #3, #5 group 2/F" in said
    expect(imported(file, "--map", "force=F #3")[0]["force"], -FORCE_N)


@pytest.mark.parametrize(
    ("data", "module", "extra"),
    [(b"TDSm", "nptdms", "tdms"), (b"MDF     4.10", "asammdf", "mdf"), (b"PK", "openpyxl", "xlsx")],
)
def test_without_its_package_a_format_names_the_extra(tmp_path, monkeypatch, data, module, extra):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == module else find(n))
    file = tmp_path / "press.dat"
    file.write_bytes(data)
    if extra == "xlsx":
        file = workbook(tmp_path, ("A", [[1, 2]] * 9))
    assert f"pip install 'forceaxis[{extra}]'" in refused(file, "--map", "force=F:N")


def test_what_is_in_a_file_is_listed_before_it_is_imported(tmp_path):
    """A file has more channels than the message for a wrong name shows."""
    signals = [(f"Channel {k}", FORCE_N, "N", {}) for k in range(20)]
    file = measurement(tmp_path, ("fast", STEPS * 1e-3, signals), ("slow", STEPS * 2e-3, signals))
    done = forceaxis("recording", "info", file)
    assert done.returncode == 0
    assert "42  slow/Channel 19  N     slow/time" in done.stdout
    assert "`forceaxis recording info` lists all 42" in refused(file, "--map", "force=Fz")
    file = workbook(tmp_path, PARAMETERS, ("Curve", TABLE))
    assert "4  Travel      mm    Time" in forceaxis("recording", "info", file).stdout
    found = json.loads(forceaxis("recording", "info", file, "--json").stdout)
    assert [one["name"] for one in found["sources"][1]["columns"]][1:3] == ["Time", "Force 'Fz'"]
    table = tmp_path / "t.csv"
    table.write_text("t_s,F_N\n" + "".join(f"{k},{k}\n" for k in range(20)))
    assert "2  F_N     N     t_s" in forceaxis("recording", "info", table).stdout
    missing = forceaxis("recording", "info", tmp_path / "none.csv")
    assert missing.returncode == 2 and missing.stderr.count("\n") == 1


FOREIGN = {
    "log.stcm": (
        json.dumps({"groupname": "g", "variablename": "v",
                    "variabledata": [{"x": k, "y": k} for k in range(60)]}).encode(), "v time",
    ),
    "run.dat": (b"t_s\tF_N\n" + b"".join(b"%d\t%d\n" % (k, k) for k in range(60)), "F_N"),
    "press.xls": (b"\xd0\xcf\x11\xe0" + bytes(99), "save it as xlsx or CSV"),
    "press.mat": (b"MATLAB 5.0 MAT-file Platform: any".ljust(128) + bytes(99), "CSV or Parquet"),
}  # fmt: skip


@pytest.mark.parametrize("name", FOREIGN)
def test_every_file_that_is_imported_or_explained_is_listed_or_explained(tmp_path, name):
    data, said = FOREIGN[name]
    (tmp_path / name).write_bytes(data)
    done = forceaxis("recording", "info", tmp_path / name)
    assert said in done.stdout + done.stderr and "LCM log with at least" not in done.stderr
    assert done.returncode == (2 if name.startswith("press") else 0)
    if done.returncode:
        assert said in refused(tmp_path / name, "--map", "force=F")
