"""Text tables of other programs: what stood wrong in first imports, each with two siblings. Every
expected number is that from which the file was made."""

import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.recordings import signal_recording
from forceaxis.recordings.importing import ImportRequest, import_source
from forceaxis.recordings.reading import read_source
from forceaxis.recordings.units import factor_of, split_name, unit_text_of
from pyarrow import parquet
from verbs import forceaxis

STEPS = np.arange(60)
FORCE = 0.5 * STEPS
ZERO_TO_FORCE = [f"{v:.2f}" for v in FORCE]


def table(lines, head="", end="\n"):
    return head + end.join(lines) + end


def rows(form, step=0.001, begin=0.0):
    """Rows of the format `form` of t (s), f (force) and k (number)."""
    return [form.format(t=begin + step * k, f=0.5 * k, k=k) for k in range(60)]


def run(folder, content, *words, name="source.csv"):
    file = folder / name
    if content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return forceaxis("recording", "import", file, *words, "--out", folder / "made")


def imported(folder, content, *words, name="source.csv"):
    """Imports a file; returns (force or the only signal, what the command has printed)."""
    done = run(folder, content, *words, name=name)
    assert done.returncode == 0, done.stderr
    return signal_recording.read(folder / "made.npz").signals[0], done.stdout


def refused(folder, content, *words, name="source.csv"):
    done = run(folder, content, *words, name=name)
    assert done.returncode == 2, done.stdout
    assert done.stderr.count("\n") == 1 and not list(folder.glob("made*"))
    return done.stderr


def expect(signal, values=FORCE, rate_hz=1000.0, begin_s=0.0):
    np.testing.assert_allclose(signal.values, values, rtol=1e-12)
    assert signal.rate_hz == pytest.approx(rate_hz, rel=1e-7)
    assert signal.time_s[0] == pytest.approx(begin_s, abs=1e-9)
    steps = np.arange(len(values)) / rate_hz
    np.testing.assert_allclose(signal.time_s - signal.time_s[0], steps, atol=1e-6 / rate_hz)


def test_recordings_of_another_import_are_named_and_kept(tmp_path):
    """Three tests in a file, then two, then one: the line says which ones are not new. A file of
    the same name may be that of another day, so nothing is removed."""
    part = table(rows("{t:.3f},{f:.3f}"), "t_s,F_N\n")
    other = tmp_path / "made_4.npz"

    def files():
        return sorted(file.name for file in tmp_path.glob("made*"))

    run(tmp_path, 4 * part, "--map", "force=F_N", name="another.csv")
    for old in ("made_1.npz", "made_2.npz", "made_3.npz"):
        (tmp_path / old).unlink()
    assert run(tmp_path, 3 * part, "--map", "force=F_N").stderr == ""
    assert files() == ["made_1.npz", "made_2.npz", "made_3.npz", "made_4.npz"]
    before = (tmp_path / "made_3.npz").read_bytes()
    done = run(tmp_path, 2 * part, "--map", "force=F_N", "--json")
    assert done.stderr.count("\n") == 1
    assert done.stderr.endswith(
        "made_3.npz: of another import of a file source.csv, kept; remove what you no longer need\n"
    )
    assert len(json.loads(done.stdout)["recordings"]) == 2
    assert run(tmp_path, 2 * part, "--map", "force=F_N", "--section", "1").stderr == ""
    stderr = run(tmp_path, part, "--map", "force=F_N").stderr
    assert [f"made{k}.npz" in stderr for k in ("", "_1", "_2", "_3", "_4")] == [
        False, True, True, True, False,  # the last one is of another file
    ]  # fmt: skip
    assert files() == ["made.npz", *(f"made_{k}.npz" for k in (1, 2, 3, 4))]
    assert (tmp_path / "made_3.npz").read_bytes() == before
    assert signal_recording.source_file(other) == "another.csv"
    assert signal_recording.source_file(tmp_path / "source.csv") is None


def test_every_recording_is_written_whoever_reads_the_output(tmp_path):
    """`| head -2` closes the output after two lines."""
    part = table(rows("{t:.3f},{f:.3f}"), "t_s,F_N\n")
    (tmp_path / "source.csv").write_text(5 * part)
    words = ("recording", "import", "source.csv", "--map", "force=F_N", "--out", "made")
    with subprocess.Popen(
        [sys.executable, "-m", "forceaxis", *words], cwd=tmp_path, stdout=subprocess.PIPE
    ) as running:
        running.stdout.close()
        running.wait()
    assert len(list(tmp_path.glob("made_*.npz"))) == 5


# Times of a calendar: a double has steps of 0.24 us there.
BEGIN_NS = 1_778_767_384_000_000_000


@pytest.mark.parametrize(("step_ns", "rate_hz"), [(20_000, 5e4), (200, 5e6)])
@pytest.mark.parametrize("form", ["ns", "s", "decimal comma", "ISO"])
def test_times_of_a_calendar_keep_their_steps(tmp_path, form, step_ns, rate_hz):
    stamps = [BEGIN_NS + k * step_ns for k in range(60)]
    text = {
        "ns": "t [ns];F_N\n" + table(f"{t};{f}" for t, f in zip(stamps, FORCE, strict=True)),
        "s": "t [s];F_N\n" + table(
            f"{t // 10**9}.{t % 10**9:09};{f}" for t, f in zip(stamps, FORCE, strict=True)),
        "decimal comma": "t [s];F_N\n" + table(
            f"{t // 10**9},{t % 10**9:09};{f}".replace(".", ",")
            for t, f in zip(stamps, FORCE, strict=True)),
        "ISO": "time;F_N\n" + table(
            f"2026-05-14T14:03:04.{t % 10**9:09}Z;{f}" for t, f in zip(stamps, FORCE, strict=True)),
    }[form]  # fmt: skip
    signal, printed = imported(tmp_path, text, "--map", "force=F_N")
    expect(signal, rate_hz=rate_hz)
    assert "0 s is 1778767384 s of the source" in printed


def test_times_with_a_number_that_is_none_are_refused(tmp_path):
    for number in ("1e300", "1e23", "1e999999999"):
        lines = [f"{BEGIN_NS + k},{f}" for k, f in enumerate(FORCE)]
        lines[30] = f"{number},15.0"
        said = refused(tmp_path, table(lines, "t [ns],F_N\n"), "--map", "force=F_N")
        assert "line 32, t: expected a" in said


def test_integers_and_typed_stamps_of_arrays_keep_their_steps(tmp_path):
    stamps = BEGIN_NS + 20_000 * STEPS
    np.savez(tmp_path / "a.npz", stamp=stamps, F_N=FORCE)
    signal, _ = imported(
        tmp_path, None, "--map", "force=F_N", "--time", "stamp:ns", name="a.npz"
    )  # fmt: skip
    expect(signal, rate_hz=5e4)
    typed = pyarrow.table({"time": stamps.astype("datetime64[ns]"), "F_N": FORCE})
    parquet.write_table(typed, tmp_path / "a.parquet")
    expect(imported(tmp_path, None, "--map", "force=F_N", name="a.parquet")[0], rate_hz=5e4)


CLOCKS = {
    "time of day": "14:03:04.{k:03}",
    "ISO with a zone": "2026-05-14T14:03:04.{k:03}+02:00",
    "German": "14.05.2026 14:03:04,{k:03}",
    "USA": "05/14/2026 02:03:04.{k:03} PM",
    "colon before ms": "2026/05/14 14:03:04:{k:03}",
    "name of the month": "14-May-2026 14:03:04.{k:03}",
    "over midnight": "",
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_clock_times_are_in_s_and_take_no_unit(tmp_path, clock):
    if clock == "over midnight":
        ms = [(86_399_970 + k) % 86_400_000 for k in range(60)]
        stamps = [f"{m // 3_600_000:02}:{m // 60_000 % 60:02}:{m % 60_000 / 1e3:06.3f}" for m in ms]
    else:
        stamps = [CLOCKS[clock].format(k=k) for k in range(60)]
    text = "Time;Force (N)\n" + table(f"{s};{f}" for s, f in zip(stamps, FORCE, strict=True))
    signal, _ = imported(tmp_path, text, "--map", "force=Force")
    expect(signal, begin_s=signal.time_s[0])
    (tmp_path / "made.npz").unlink()
    said = refused(tmp_path, text, "--map", "force=Force", "--time", "Time:ms")
    assert "--time: Time: expected no unit" in said and "write --time Time" in said


def test_typed_stamps_take_no_unit(tmp_path):
    typed = pyarrow.table({"time": (1_000_000 * STEPS).astype("datetime64[ns]"), "F_N": FORCE})
    parquet.write_table(typed, tmp_path / "a.parquet")
    words = ("--map", "force=F_N", "--time", "time:ms")
    assert "expected no unit" in refused(tmp_path, None, *words, name="a.parquet")


def test_a_unit_of_the_times_that_the_source_denies_is_said(tmp_path):
    text = table(rows("{t:.3f},{f}"), "Time [s],F_N\n")
    _, printed = imported(tmp_path, text, "--map", "force=F_N", "--time", "Time:ms")
    assert "gives the unit 's' for the times Time, which were read in ms" in printed


@pytest.mark.parametrize(
    ("head", "maps"),
    [
        ('"Time, s","Force, N","Travel, mm"', "force=Force, N:N"),
        ('"Time, s","Force, N","Travel, mm"', "force=Force:N,position=Travel, mm:mm"),
        ('"t (s)","F, axial, left [N]","x, raw [mm]"', "force=F, axial, left,position=x, raw"),
    ],
)
def test_columns_may_have_commas_in_their_names(tmp_path, head, maps):
    text = table(rows("{t:.3f},{f},{k}"), head + "\n")
    expect(imported(tmp_path, text, "--map", maps)[0])


@pytest.mark.parametrize(
    ("head", "form"),
    [
        ("Time;X;Y;Y2\ns;mm;kN;kN", "{t:.3f};{k};{f};"),
        ("Time;Y2;X;Y\ns;kN;mm;kN", "{t:.3f};;{k};{f}"),
        ("Time;X;Y;Y2\ns;mm;kN;kN", "{t:.3f};{k};{f};NaN"),
    ],
)
def test_a_column_without_a_value_is_refused_and_the_others_are_not(tmp_path, head, form):
    text = table(rows(form), head + "\n")
    assert "Y2: expected at least 8 samples with a value, got 0" in refused(
        tmp_path, text, "--map", "force=Y2"
    )
    expect(imported(tmp_path, text, "--map", "force=Y")[0], 1000 * FORCE)


@pytest.mark.parametrize(
    "header",
    [
        [f"Parameter {k};{k};ok" for k in range(420)],
        [f"setting_{k} = {1.5 * k}" for k in range(1200)],
        [f"Value {k};{k};{2 * k};{3 * k}" for k in range(3000)] + ["", "Curve"],
    ],
)
def test_rows_are_found_below_any_header(tmp_path, header):
    text = table([*header, "Time;Travel;Force", "s;mm;kN", *rows("{t:.3f};{k};{f}")])
    signal, printed = imported(tmp_path, text, "--map", "force=Force")
    expect(signal, 1000 * FORCE)
    assert f"60 rows in lines {len(header) + 3} to {len(header) + 62}" in printed


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_quoted_numbers_may_have_decimal_commas(tmp_path, mark):
    lines = [
        f'"{t:.4f}"{mark}"{f:.2f}"'.replace(".", ",")
        for t, f in zip(STEPS / 1e3, FORCE, strict=True)
    ]
    text = table(lines, f'"Zeit [s]"{mark}"Kraft [N]"\n')
    signal, printed = imported(tmp_path, text, "--map", "force=Kraft")
    expect(signal)
    assert "CSV with decimal commas" in printed


def test_stamps_coarser_than_the_samples_are_refused_with_the_rate(tmp_path):
    lines = [f"14:03:{4 + k // 20:02};{0.5 * k}" for k in range(60)]
    said = refused(tmp_path, table(lines, "Time;F (N)\n"), "--map", "force=F")
    assert "60 samples with 3 times in steps of 1 s" in said and "--rate 20 for" in said
    lines = [f"{int(k / 1.5)};{0.5 * k}" for k in range(60)]
    said = refused(tmp_path, table(lines, "t [ms];F (N)\n"), "--map", "force=F")
    assert "--rate 1500 for" in said
    lines = [f"{np.float32(2000 + k / 1e5):.9g};{0.5 * k}" for k in range(60)]
    said = refused(tmp_path, table(lines, "t [s];F (N)\n"), "--map", "force=F")
    assert "expected another time for each sample" in said
    lines = [f"{k // 2 / 1000};{k // 2 * 0.5}" for k in range(60)]
    _, printed = imported(tmp_path, table(lines, "t [s];F (N)\n"), "--map", "force=F")
    assert "F: 30 samples left out, which repeat the sample before" in printed


def test_a_counter_of_samples_that_begins_later_or_misses_some(tmp_path):
    lines = [f"{22 + k},{f}," for k, f in enumerate(FORCE)]
    signal, _ = imported(tmp_path, table(lines, RIGOL), "--map", "force=CH1:1N")
    expect(signal, begin_s=-0.01 + 0.022)
    del lines[30:34]
    signal, printed = imported(tmp_path, table(lines, RIGOL), "--map", "force=CH1:1N")
    np.testing.assert_allclose(signal.time_s, 0.012 + np.delete(STEPS, range(30, 34)) / 1e3)
    assert "4 samples missing" in printed


RIGOL = "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-1.0e-02,1.0e-03,\n"


@pytest.mark.parametrize(
    ("head", "form", "maps", "begin_s", "factor"),
    [
        (RIGOL, "{k},{f:e},1.0e-1,", "force=CH1:10N", -0.01, 10),
        ("X,CH1,CH2,\nSecond,Volt,Volt,\n", "{t:e},{f:e},1.0e-1,", "force=CH1:10N", 0, 10),
        ("Time,Force,Temp\nsec,kgf,deg C\n", "{t:.4f},{f:.3f},21.5", "force=Force", 0, 9.80665),
    ],
)
def test_names_units_and_times_of_a_header_of_two_lines(
    tmp_path, head, form, maps, begin_s, factor
):
    signal, _ = imported(tmp_path, table(rows(form), head), "--map", maps)
    expect(signal, factor * FORCE, begin_s=begin_s)


def test_the_header_of_a_labview_measurement_has_the_times_of_each_channel(tmp_path):
    head = (
        "LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t,\nX_Columns\tNo\n"
        "***End_of_Header***\n\t\nChannels\t2\t\t\nSamples\t60\t60\t\nY_Unit_Label\tNewtons\tmm\t\n"
        "X0\t0,0\t0,5\t\nDelta_X\t0,001\t0,002\t\n***End_of_Header***\t\t\t\n"
        "X_Value\tForce\tTravel\tComment\n"
    )
    lines = [f"\t{f:.3f}\t{k}".replace(".", ",") for k, f in enumerate(FORCE)]
    lines[30] += "\tthe part slips"
    text = table(lines, head)
    expect(imported(tmp_path, text, "--map", "force=Force")[0])
    travel, printed = imported(tmp_path, text, "--map", "position=Travel")
    expect(travel, STEPS * 1e-3, 500, 0.5)
    assert "the times are those of delta_x 0,002 of line 11" in printed


def tds(form="{},,{:.6f},{:.5f},"):
    side = ["Record Length,6.0e+01", "Sample Interval,1.0e-03", "Trigger Point,1.0e+01", ",", ",",
            ",", "Source,CH1", "Vertical Units,V", *[","] * 52]  # fmt: skip
    return table(
        form.format(left, t - 0.01, f) for left, t, f in zip(side, STEPS / 1e3, FORCE, strict=True)
    )  # fmt: skip


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ("{},,{:.6f},{:.5f},", ("--map", "force=5:10N", "--time", "4:s")),
        ("{},,{:.6f},{:.5f},", ("--map", "force=CH1:10N")),
        ("{},,{:.6f},{:.5f}", ("--map", "force=5:10N")),
    ],
)
def test_a_header_beside_the_rows_takes_none_of_them(tmp_path, form, words):
    signal, printed = imported(tmp_path, tds(form), *words)
    expect(signal, 10 * FORCE, begin_s=-0.01)
    assert "not imported column 1, column 2, column 3" in printed


STATES = {
    "words": lambda k: "APPROACH" if k < 20 else "PRESS",
    "switches": lambda k: "FALSE" if k < 20 else "TRUE",
    "hexadecimal": lambda k: "0x0637" if k < 20 else "0x1637",
    "empty first": lambda k: "" if k < 20 else "contact",
    "another text each": lambda k: f"sample no {k}",
}


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("states", STATES)
def test_columns_of_texts_are_not_imported_and_disturb_nothing(tmp_path, states, place):
    names, lines = ["time_s", "force_N"], []
    names.insert(place, "state")
    for k in range(60):
        cells = [f"{k / 1000:.3f}", f"{0.5 * k:.1f}"]
        cells.insert(place, STATES[states](k))
        lines.append(",".join(cells))
    signal, printed = imported(
        tmp_path, table([",".join(names), *lines]), "--map", "force=force_N"
    )  # fmt: skip
    expect(signal)
    assert "not imported state" in printed


def test_switches_and_hexadecimal_numbers_are_numbers(tmp_path):
    lines = [
        f"{k / 1000:.3f},{STATES['switches'](k)},{STATES['hexadecimal'](k)}" for k in range(60)
    ]
    text = table(lines, "t_s,on,statusword\n")
    expect(imported(tmp_path, text, "--map", "enabled=on")[0], 1.0 * (STEPS >= 20))
    words = np.where(STEPS < 20, 0x0637, 0x1637)
    expect(imported(tmp_path, text, "--map", "status=statusword")[0], words)
    (tmp_path / "made.npz").unlink()
    text = table([f"{k / 1000:.3f},{STATES['words'](k)}" for k in range(60)], "t_s,state\n")
    said = refused(tmp_path, text, "--map", "force=state:N")
    assert re.search("line 2, state: expected numbers .* got 'APPROACH'; this column has", said)


def test_a_time_in_an_unknown_form_is_refused_with_line_column_and_forms(tmp_path):
    lines = [f"14h03m04s{k:03},{f}" for k, f in enumerate(FORCE)]
    said = refused(tmp_path, table(lines, "Time,Force (N)\n"), "--map", "force=Force")
    assert "line 2, Time: expected a time such as 14:03:04.125" in said
    lines = [f"05/0{1 + k // 30}/2026 14:03:04.{k:03},{f}" for k, f in enumerate(FORCE)]
    said = refused(tmp_path, table(lines, "Time,Force (N)\n"), "--map", "force=Force")
    assert "line 32, Time: expected dates with a known order of day and month" in said


SCOPE = (
    "Name\tScope\t\nFile\tC:\\x.csv\t\nStarttime of export\t134232409840000000\tDonnerstag\n\n"
    "Name\t{names}\nData-Type\tREAL64\tREAL64\nSampleTime[ms]\t1\t1\n"
    "SymbolName\tMAIN.fForce\tMAIN.fForce\nUnit\t{unit}\t{unit}\n\n"
)


@pytest.mark.parametrize(
    ("names", "column"),
    [
        ("fForce\tfForce_half", "3:N"),
        ("fForce\tfForce_half", "fForce_half"),
        ("fForce\tfForce", "fForce 3"),
        ("fForce\tfForce", "#3"),
    ],
)
@pytest.mark.parametrize("unit", ["N (Newton)", "(N)", "[N]"])
def test_channels_of_one_symbol_keep_their_places_names_and_units(tmp_path, names, column, unit):
    lines = [f"{k}\t{k},00\t{f:.2f}".replace(".", ",") for k, f in enumerate(FORCE)]
    text = table(lines, SCOPE.format(names=names, unit=unit))
    expect(imported(tmp_path, text, "--map", f"force={column}")[0])
    for several in {"MAIN.fForce", names.split("\t")[1]} - {"fForce_half"}:
        (tmp_path / "made.npz").unlink(missing_ok=True)
        said = refused(tmp_path, text, "--map", f"force={several}")
        assert "expected the name of one column" in said and "#2" in said and "#3" in said


@pytest.mark.parametrize(
    ("unit", "size_N"),
    [
        ("kgf", 9.80665), ("kp", 9.80665), ("gf", 9.80665e-3), ("lbf", 4.4482216152605),
        ("ozf", 4.4482216152605 / 16), ("daN", 10), ("MN", 1e6), ("kN", 1e3), ("KN", 1e3),
        ("Newton", 1), ("tf", 9806.65), ("2.5N", 2.5), ("2 lbf", 2 * 4.4482216152605),
        ("LBF", 4.4482216152605), ("Kgf", 9.80665), ("OZF", 4.4482216152605 / 16), ("DaN", 10),
        ("dyn", 1e-5), ("kip", 4448.2216152605),
    ],
)  # fmt: skip
def test_units_of_force_that_people_write(tmp_path, unit, size_N):
    text = table(rows("{t:.3f},{f}"), f"Time (s),Force ({unit})\n")
    signal, _ = imported(tmp_path, text, "--map", "force=Force")
    np.testing.assert_allclose(signal.values, size_N * FORCE, rtol=1e-12)


@pytest.mark.parametrize(
    ("unit", "size_m"),
    [("inch", 0.0254), ("in", 0.0254), ("mil", 2.54e-5), ("thou", 2.54e-5), ("um", 1e-6),
     ("µm", 1e-6), ("dm", 0.1), ("micron", 1e-6), ("Millimeter", 1e-3), ("ft", 0.3048),
     ("INCH", 0.0254), ("Mil", 2.54e-5), ("uin", 2.54e-8), ("feet", 0.3048), ("0.0001in", 2.54e-6)],
)  # fmt: skip
def test_units_of_length_that_people_write(unit, size_m):
    assert factor_of(unit, "m") == pytest.approx(size_m, rel=1e-12)
    assert factor_of(unit, "N") is None


@pytest.mark.parametrize(
    ("unit", "wanted", "size"),
    # NIST SP 811: 1 lbf in = 0.112984829 N m, 1 ft lbf = 1.355817948 N m, 1 ozf in = 7.061552 mN m
    [("lbf in", "N m", 0.112984829), ("in-lbf", "N m", 0.112984829), ("lb-in", "N m", 0.112984829),
     ("ft-lbf", "N m", 1.355817948), ("ozf in", "N m", 7.061552e-3), ("oz-in", "N m", 7.061552e-3),
     ("kgf cm", "N m", 0.0980665), ("N-m", "N m", 1.0), ("N·m", "N m", 1.0), ("Ncm", "N m", 0.01),
     ("in/s", "m/s", 0.0254), ("in/min", "m/s", 0.0254 / 60), ("ft/min", "m/s", 0.00508),
     ("mm/sec", "m/s", 1e-3), ("2 mm/sec", "m/s", 2e-3), ("ipm", "m/s", 0.0254 / 60)],
)  # fmt: skip
def test_products_and_quotients_of_units_that_people_write(unit, wanted, size):
    assert factor_of(unit, wanted) == pytest.approx(size, rel=1e-6)
    assert factor_of(unit, "N") is None and factor_of(unit, "s") is None


def test_a_ratio_of_signals_is_no_unit():
    for name in ("OUT/IN", "x-y", "F-N", "time/step", "Valve IN"):
        assert split_name(name) == (name, None)


def test_a_unit_that_is_not_known_has_a_hint_with_its_size(tmp_path):
    head = "Time (s),Force (pdl),Travel (kg),Load (tonf),Way (IN)\n"
    text = table(rows("{t:.3f},{f},{k},{k},{k}"), head)
    said = refused(tmp_path, text, "--map", "force=Force")
    assert "expected a unit of force, such as N, got 'pdl'" in said and ":9.80665N" in said
    said = refused(tmp_path, text, "--map", "force=Load")
    assert "tonf has several sizes; write the one that is meant: 9806.65N (metric), 8896" in said
    said = refused(tmp_path, text, "--map", "position=Way")
    assert "got 'IN'; write another unit in --map position=Way:UNIT; write :in if" in said
    said = refused(tmp_path, text, "--map", "force=Travel")
    assert "kg measures a mass; for the weight of this mass write :kgf, which is 9.80665 N" in said
    expect(imported(tmp_path, text, "--map", "force=Force:1e-5N")[0], 1e-5 * FORCE)


def test_an_archive_of_other_files_says_to_unpack_it(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("data/curve.csv", "x")
    said = refused(tmp_path, None, "--map", "force=F:N", name="a.zip")
    assert "a ZIP archive with data/curve.csv; unpack it" in said


def parts(folder):
    return [signal_recording.read(path) for path in sorted(folder.glob("made_*.npz"))]


@pytest.mark.parametrize("between", ["Test 2\nt_s,F_N\n", "\n\nt_s,F_N\n", ""])
def test_sections_are_recordings_of_their_own(tmp_path, between):
    text = "Test 1\nt_s,F_N\n" + table(rows("{t:.3f},{f}")) + between + table(rows("{t:.3f},-{f}"))
    done = run(tmp_path, text, "--map", "force=F_N")
    assert done.returncode == 0, done.stderr
    one, two = parts(tmp_path)
    expect(one["force"])
    expect(two["force"], -FORCE)
    assert "the file has 2 recordings; --section chooses one of them" in done.stdout
    expect(imported(tmp_path, text, "--map", "force=F_N", "--section", "2")[0], -FORCE)
    (tmp_path / "made.npz").unlink()
    for old in tmp_path.glob("made*"):
        old.unlink()
    assert "expected a number from 1 to 2" in refused(
        tmp_path, text, "--map", "force=F_N", "--section", "3"
    )


def test_two_tests_without_times_are_told_by_the_count_or_the_index(tmp_path):
    lines = [f"{k},{0.5 * k}" for k in (*range(60), *range(60))]
    done = run(tmp_path, table(lines, "n,F_N\n"), "--map", "force=F_N", "--rate", "1000")
    assert done.returncode == 0 and len(parts(tmp_path)) == 2
    saw = [f"{0.5 * k}" for k in (*range(60), *range(60))]  # a force may look like an index
    signal, _ = imported(tmp_path, table(saw, "F_N\n"), "--map", "force=F_N", "--rate", "1000")
    expect(signal, np.tile(FORCE, 2))
    lines = [f"{0.5 * k}" for k in (*range(60), *range(60))]
    head = "Points:,60\nXInc:,1.0E-03\nXOrg:,0\nData:\n"
    done = run(tmp_path, table(lines, head), "--map", "force=1:N")
    assert done.returncode == 0, done.stderr
    for one in parts(tmp_path):
        expect(one["force"])


def test_sections_with_other_columns_are_never_mixed(tmp_path):
    first = "a,b,c\n" + table(f"{k},{2 * k},{3 * k}" for k in range(20))
    text = first + "\nTime (s),Force (N)\n" + table(rows("{t:.3f},{f}"))
    signal, printed = imported(tmp_path, text, "--map", "force=Force")
    expect(signal)
    assert (
        "20 rows in lines 2 to 21, names of line 1: not imported, as expected a column" in printed
    )
    (tmp_path / "made.npz").unlink()
    said = refused(tmp_path, text, "--map", "force=2:N")
    assert "has sections with other columns (1: a, b, c; 2: Time, Force); write a name" in said


def test_a_header_that_is_repeated_is_named_and_the_recording_goes_on(tmp_path):
    lines = rows("{t:.3f},{f}")
    lines[20:20] = ["t_s,F_N"]
    lines[40:40] = ["# the part was changed"]
    signal, printed = imported(tmp_path, table(lines, "t_s,F_N\n"), "--map", "force=F_N")
    expect(signal)
    assert "skipped lines 22 to 42, which are no rows: line 22: t_s,F_N; line 42: # the" in printed


def test_rows_of_several_signals_are_refused(tmp_path):
    lines = [f"{('Force', 'Travel')[k % 2]};14:03:04.{k:03};{k}" for k in range(60)]
    text = table(lines, "VarName;TimeString;VarValue\n")
    said = refused(tmp_path, text, "--map", "force=VarValue:N", "--time", "TimeString")
    assert "got rows of several signals (Force, Travel); export each signal as a column" in said


@pytest.mark.parametrize(
    "head",
    ["Time;F;Time;x\ns;N;s;mm", "X;F;X;x\ns;N;s;mm", "t1 [s];F [N];t2 [s];x [mm]"],
)
def test_columns_with_times_of_their_own_keep_them(tmp_path, head):
    text = table(rows("{t:.3f};{f};{k};{k}"), head + "\n")
    expect(imported(tmp_path, text, "--map", "force=F")[0])
    signal, printed = imported(tmp_path, text, "--map", "position=x")
    expect(signal, 1e-3 * STEPS, rate_hz=1)
    assert "x: the times are those of" in printed
    text = table(rows("{t:.3f};{f};0.5;{k}"), "Time [s];F [N];Settling time [s];x [mm]\n")
    expect(imported(tmp_path, text, "--map", "position=x")[0], 1e-3 * STEPS)


def test_names_of_fewer_columns_name_none(tmp_path):
    """The names of the rows have no name themselves in tables of R."""
    text = table([f"{k} {k / 1000:.3f} {f}" for k, f in enumerate(FORCE)], "t_s F_N\n")
    said = refused(tmp_path, text, "--map", "force=F_N")
    assert "(column 1, column 2, column 3), got F_N" in said
    signal, printed = imported(tmp_path, text, "--map", "force=3:N", "--time", "2:s")
    expect(signal)
    assert "line 1 has 2 fields, and no names of the 3 columns were read from it" in printed


def test_a_name_that_is_the_number_of_another_column_is_refused(tmp_path):
    text = table(rows("{t:.3f},{f},{k}"), "x-axis,1,2\nsecond,Volt,Volt\n")
    said = refused(tmp_path, text, "--map", "force=1:10N")
    assert "the number of column 1 and the name of column 2; write #1 or #2" in said
    expect(imported(tmp_path, text, "--map", "force=#2:10N")[0], 10 * FORCE)


def test_values_outside_a_converter_are_named_and_left_out(tmp_path):
    for word in ("∞", "-∞", "OVLD", "9.91E+37"):
        lines = rows("{t:.3f},{f},1")
        lines[30] = f"0.030,{word},1"
        signal, printed = imported(tmp_path, table(lines, "t_s,F_N,x\n"), "--map", "force=F_N")
        np.testing.assert_allclose(signal.values, np.delete(FORCE, 30))
        assert "F_N: 1 value outside the range of the converter, in line 32 first" in printed


@pytest.mark.parametrize(
    ("end", "kept"), [("0.059,29.50", 60), ("0.059,29.5", 59), ("0.059,2", 59)]
)
def test_a_last_number_that_was_cut_off_is_left_out(tmp_path, end, kept):
    text = "t_s,F_N\n" + table(rows("{t:.3f},{f:.2f}")[:-1]) + end
    signal, printed = imported(tmp_path, text, "--map", "force=F_N")
    np.testing.assert_allclose(signal.values, FORCE[:kept])
    assert ("(cut off)" in printed) == (kept < 60)


def test_an_offset_is_subtracted_and_said(tmp_path):
    text = table(rows("{t:.3f},{f},{k}"), "t_s,F_N,n\n")
    signal, printed = imported(tmp_path, text, "--map", "force=-2:N-5.5")
    assert "-F_N, N, +5.5 N" in printed
    assert "-F_N, N, +5.5 N" in forceaxis("recording", "info", tmp_path / "made.npz").stdout
    np.testing.assert_allclose(signal.values, -(FORCE - 5.5))
    assert signal.offset == pytest.approx(5.5)
    signal, _ = imported(tmp_path, text, "--map", "force=F_N:kN+0.25")
    np.testing.assert_allclose(signal.values, 1000 * FORCE + 250)
    signal, printed = imported(tmp_path, text, "--map", "force=F_N", "--zero", "force=0.01:0.02")
    np.testing.assert_allclose(signal.values, FORCE - 7.5)
    assert "force: 7.5 N subtracted, the median from 0.01 to 0.02 s" in printed
    assert unit_text_of("m s^-2").offset == 0 and unit_text_of("5e-7m").offset == 0
    (tmp_path / "made.npz").unlink()
    for zero, said in (("force=3:4", "at least 8 samples"), ("force=1", "FROM:TO in s"),
                       ("forc=0:1", "one of the signals force")):  # fmt: skip
        assert said in refused(tmp_path, text, "--map", "force=F_N", "--zero", zero)


def test_a_long_table_takes_twice_the_memory_of_its_numbers(tmp_path):
    count = 1_000_000
    with (tmp_path / "long.csv").open("w") as file:
        file.write("t_s,F_N,x_mm\n")
        file.writelines(f"{k / 1e4:.4f},{k % 977 * 0.25:.2f},{k % 31}\n" for k in range(count))
    code = (
        "import pathlib, pyarrow.csv, sys\n"
        "from forceaxis.recordings import importing, reading, signal_recording\n"
        "def peak(): return next(int(l.split()[1]) for l in open('/proc/self/status')"
        " if l.startswith('VmHWM')) / 1024\n"
        "before, path = peak(), pathlib.Path(sys.argv[1])\n"
        "done = importing.import_sources(reading.read_sources(path), path,"
        " importing.ImportRequest(['force=F_N']))\n"
        "signal_recording.write(done[0].recording, path.with_suffix('.npz'))\n"
        "assert len(done[0].recording['force'].values) == 1_000_000\n"
        "print(peak() - before)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "long.csv"],
        capture_output=True, text=True, check=True, cwd=paths.ROOT,
    )  # fmt: skip
    numbers_MiB = 2 * 8 * count / 2**20
    fixed_MiB = 90  # blocks of 4 MiB in the several forms of their text, and blocks of samples
    assert float(done.stdout) < 2 * numbers_MiB + fixed_MiB


@pytest.mark.parametrize(
    "text",
    [
        table([f"{k};{990 + k:,}" for k in range(60)], "t [s];F_N\n"),
        table([f"{k};{990 + k:,}".replace(",", ".") for k in range(60)], "t [s];F_N\n"),
        table([f"{k}\t{k % 1000:,}" for k in range(2000)], "t [s]\tF_N\n"),
    ],
)
def test_separators_of_thousands_are_no_decimal_signs(tmp_path, text):
    said = refused(tmp_path, text.replace("999\n", "1,000\n"), "--map", "force=F_N")
    assert "without separators of thousands" in said or "with a separator of thousands" in said
    if ".000" in text:  # another number shows that a point is the decimal sign
        sure = text.replace("\n0;", "\n0.5;")
        signal, _ = imported(tmp_path, sure, "--map", "force=F_N")
        assert signal.values[10] == 1.0


@pytest.mark.parametrize("lines", ["s;N\nfloat;float", "KMD;1A2\ns;N", "float;float\ns;N\n\n"])
def test_other_lines_between_names_and_rows(tmp_path, lines):
    text = table(rows("{t:.3f};{f}"), f"Test;7\nTime;Force\n{lines}\n")
    expect(imported(tmp_path, text, "--map", "force=Force")[0])


def test_the_separator_is_one_character(tmp_path):
    text = table(rows("{t:.3f}#{f}"), "t_s#F_N\n")
    expect(imported(tmp_path, text, "--map", "force=F_N", "--separator", "#")[0])
    (tmp_path / "made.npz").unlink()
    said = refused(tmp_path, text, "--map", "force=F_N", "--separator", "##")
    assert "--separator: expected one character such as ;" in said


def test_three_decimals_everywhere_are_said(tmp_path):
    text = table([f"{k};{12 + k / 8:.3f}" for k in range(60)], "t [ms];F_N\n")
    signal, printed = imported(tmp_path, text, "--map", "force=F_N")
    np.testing.assert_allclose(signal.values, 12 + STEPS / 8)
    assert "F_N: 12.125 was read with three decimals, and not as 12125" in printed


def test_several_recordings_as_json_and_in_the_library(tmp_path):
    text = "t_s,F_N\n" + 2 * table(rows("{t:.3f},{f}"))
    done = run(tmp_path, text, "--map", "force=F_N", "--json")
    facts = json.loads(done.stdout)["recordings"]
    assert [one["signals"][0]["samples"] for one in facts] == [60, 60]
    assert [Path(one["file"]).name for one in facts] == ["made_1.npz", "made_2.npz"]
    file = tmp_path / "source.csv"
    with pytest.raises(InputError, match=r"expected one recording, got 2"):
        import_source(read_source(file), file, ImportRequest(["force=F_N"]))
    file.write_text("a,b\n" + table(rows("{k},{f}")) + "\nt_s,F_N,x\n" + table(rows("{t},{f},1")))
    with pytest.raises(InputError, match=r"expected one section of rows, got 2"):
        read_source(file)


@pytest.mark.parametrize(("unit", "digits"), [("ns", 9), ("us", 6), ("ms", 3), ("s", 0)])
def test_times_since_1970_without_a_unit_tell_it_by_their_size(tmp_path, unit, digits):
    step = 1 if digits else 1.0
    stamps = [1_778_767_384 * 10**digits + step * k for k in range(60)]
    text = table([f"{t},{f}" for t, f in zip(stamps, FORCE, strict=True)], "%time,field.z\n")
    said = refused(tmp_path, text, "--map", "force=field.z:N")
    assert f"write --time time:{unit}, as the numbers look like {unit} since 1970" in said
    signal, _ = imported(tmp_path, text, "--map", "force=z:N", "--time", f"time:{unit}")
    expect(signal, rate_hz=10.0**digits)


def test_units_inside_of_names(tmp_path):
    head = "Time (s) Run #1,Force (N) Run #1,Time (s) Run #2,Force (N) Run #2\n"
    lines = [f"{k / 1000:.3f},{0.5 * k},{k},{-0.5 * k}" for k in range(60)]
    signal, _ = imported(tmp_path, table(lines, head), "--map", "force=Force (N) Run #1")
    expect(signal)
    signal, _ = imported(tmp_path, table(lines, head), "--map", "force=Force Run #2")
    expect(signal, -FORCE, rate_hz=1)


def test_a_column_that_steps_by_the_interval_of_the_header_has_the_times(tmp_path):
    """The names lack one for the last column, so they name none; two rows are missing."""
    lines = rows("{t:.3f},{f},TRUE")
    del lines[30:32]
    text = table(lines, "Sample Interval,1.0e-03\nTIME,CH1\n")
    signal, printed = imported(tmp_path, text, "--map", "force=2:1N")
    np.testing.assert_allclose(signal.time_s, np.delete(STEPS, [30, 31]) / 1e3)
    assert "the times are those of column 1, whose steps are the sample interval of" in printed


def test_a_first_row_with_a_text_in_front_is_named(tmp_path):
    lines = [f"{k}\t{k},00\t{f:.2f}".replace(".", ",") for k, f in enumerate(FORCE)]
    lines[0] = "#REF!\t0,00\t0,00"
    text = table(lines, SCOPE.format(names="a\tb", unit="N"))
    signal, printed = imported(tmp_path, text, "--map", "force=b")
    np.testing.assert_allclose(signal.values, FORCE[1:])
    assert "skipped line 11 above the rows, which is no row: #REF!" in printed


def test_rows_behind_the_stated_samples_are_left_out_or_another_recording(tmp_path):
    head = "Points:,60\nXInc:,1.0E-03\nXOrg:,0\nData:\n"
    more = [f"{0.5 * k}" for k in (*range(60), *range(3))]
    signal, printed = imported(tmp_path, table(more, head), "--map", "force=1:N")
    expect(signal)
    assert "the last 3 rows left out, behind the 60 samples that the source states" in printed
    fewer = [f"{0.5 * k}" for k in range(40)]
    signal, printed = imported(tmp_path, table(fewer, head), "--map", "force=1:N")
    expect(signal, FORCE[:40])
    assert "line 1 states 60 samples, and not 40" in printed
    more = [f"{0.5 * k}" for k in (*range(60), *range(30))]
    assert run(tmp_path, table(more, head), "--map", "force=1:N").returncode == 0
    assert [len(one["force"].values) for one in parts(tmp_path)] == [60, 30]
