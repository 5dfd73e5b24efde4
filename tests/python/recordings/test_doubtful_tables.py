"""Text tables that may be read in two ways: nothing of them is imported in silence."""

import numpy as np
import pytest
from test_text_tables import expect, imported, refused, rows, run, table

TOO_MANY = {
    "comma": ("t [s],Force, actual [N],Position [mm]\n", "{t:.4f},{f:.4f},{k}"),
    "blank": ("Time [s] Contact force [N] Position [mm]\n", "{t:.4f} {f:.4f} {k}"),
    "no units": ("t contact force position\n", "{t:.4f} {f:.4f} {k}"),
    "units below": ("t,Force, actual,Position\ns,N,mm\n", "{t:.4f},{f:.4f},{k}"),
    "no field": (",t [s],F [N],x [mm]\n", "{t:.4f},{f:.4f},{k}"),
}


@pytest.mark.parametrize("form", TOO_MANY)
def test_more_names_than_fields_name_no_columns(tmp_path, form):
    head, row = TOO_MANY[form]
    text = table(rows(row), head)
    for name in ("force", "actual", "F"):
        said = refused(tmp_path, text, "--map", f"force={name}:N", "--time", "1:s")
        assert f"(column 1, column 2, column 3), got {name}; line 1 has 4 fields, and no" in said
    signal, printed = imported(tmp_path, text, "--map", "force=2:N", "--time", "1:s")
    expect(signal)
    assert "line 1 has 4 fields, and no names of the 3 columns were read from it" in printed


def test_more_names_than_fields_take_no_names_of_the_section_above(tmp_path):
    head, row = TOO_MANY["comma"]
    text = table(rows(row), "t [s],F [N],x [mm]\n") + table(rows(row), head)
    signal, printed = imported(tmp_path, text, "--map", "force=F")
    expect(signal)
    assert "of the 3 columns were read from it: not imported, as expected a column" in printed


def test_a_remark_in_a_row_makes_no_place_for_a_name_with_a_unit(tmp_path):
    head, row = TOO_MANY["comma"]
    lines = rows(row)
    lines[30] += ",the part slips"
    refused(tmp_path, table(lines, head), "--map", "force=actual")
    signal, _ = imported(tmp_path, table(lines, "t [s],F [N],x [mm],What\n"), "--map", "force=F")
    expect(signal)
    for head in ("t [s],F [N],x [mm],Comment\n", "t [s],F [N],x [mm],,\n"):
        expect(imported(tmp_path, table(rows(row), head), "--map", "force=F")[0])


@pytest.mark.parametrize("first", [0, 1])
def test_numbers_above_the_columns_are_names_and_no_sample(tmp_path, first):
    lines = rows("{k},{f:.3f},{k}.125")
    text = table(lines, f",{first},{first + 1}\n")
    words = ("--map", "force=#2:N", "--rate", "1000")
    signal, printed = imported(tmp_path, text, *words)
    expect(signal)
    assert "60 rows in lines 2 to 61, names of line 1" in printed
    signal, _ = imported(tmp_path, text + text, *words, "--section", "2")
    expect(signal)  # a second header is no sample either
    other = text.replace(f",{first},{first + 1}\n", ",0.5,1\n", 1)  # a sample without an index
    assert len(imported(tmp_path, other, *words)[0].values) == 61


@pytest.mark.parametrize(
    "unit", ["1.2.3kgf", "1e400N", "1e400kgf", "1e-400N", "1..2N", "1e200N", "N-1e999", "N+1e101"]
)
def test_sizes_and_offsets_of_units_are_finite_numbers(tmp_path, unit):
    text = table(rows("{t:.3f},{f}"), "t_s,F_N\n")
    said = refused(tmp_path, text, "--map", f"force=2:{unit}")
    assert f"expected a unit such as N, got '{unit}'" in said
    said = refused(tmp_path, text.replace("F_N", f"F ({unit})"), "--map", "force=2")
    assert "expected a unit of force, such as N, got" in said


def test_a_signal_has_no_times_by_its_unit_alone(tmp_path):
    text = table(rows("{k};{t:.4f};{f}"), "Step;pos_s;F_N\n")
    said = refused(tmp_path, text, "--map", "position=pos_s:mm,force=F_N")
    assert "expected a column of times, got pos_s, which is a signal here; write --time" in said
    words = ("--map", "force=F_N,position=pos_s:mm", "--rate", "1000")
    expect(imported(tmp_path, text, *words)[0])
    signal, printed = imported(tmp_path, text, "--map", "force=F_N")
    expect(signal)
    assert "the times are those of pos_s, column 2, which was not found by its name" in printed
    named = text.replace("pos_s", "t_s")
    assert "not found by its name" not in imported(tmp_path, named, "--map", "force=F_N")[1]


def test_a_signal_has_no_times_of_a_group_by_its_unit_alone(tmp_path):
    text = table(rows("{t:.3f};{k};{t:.4f};{f}"), "t1 [s];x [mm];pos_s;F_N\n")
    said = refused(tmp_path, text, "--map", "position=pos_s:mm,force=F_N")
    assert "which is a signal here" in said
    expect(imported(tmp_path, text, "--map", "force=F_N")[0])


def test_the_note_of_a_restart_names_the_lines(tmp_path):
    _, printed = imported(
        tmp_path, table([*rows("{t:.3f},{f}"), *rows("{t:.3f},{f}")], "t_s,F_N\n"),
        "--map", "force=F_N", "--section", "2",
    )  # fmt: skip
    assert "recording 2 of 2, which begin again in one section: lines 62 to 121" in printed


RATES = {
    "semicolon": ("Sample rate;1,000 Hz\nF [N];x [mm]\n", "{f:.4f};{k}"),
    "colon": ("Sample rate: 1,000 Hz\nF [N];x [mm]\n", "{f:.4f};{k}"),
    "comma": ("Sample rate,1,000 Hz\nF [N],x [mm]\n", "{f:.4f},{k}"),
    "quoted": ('"Sample rate","1,000"\nF [N],x [mm]\n', "{f:.4f},{k}"),
    "point": ("Abtastrate;1.000 Hz\nF [N];x [mm]\n", "{f};{k},25"),
    "integers": ("Sample rate;1.000\nF [N];x [mm]\n", "{k};{k}"),
    "step": ("Increment;1.000\nF [N];x [mm]\n", "{k};{k}"),
    "begin": ("X0;1.000\nIncrement;0.001\nF [N];x [mm]\n", "{k};{k}"),
    "two groups": ("Sample rate;1,000,000 Hz\nF [N];x [mm]\n", "{f:.4f};{k}"),
}


@pytest.mark.parametrize("form", RATES)
def test_a_stated_rate_with_a_separator_of_thousands_is_refused(tmp_path, form):
    head, row = RATES[form]
    lines = rows(row)
    if "Abtast" in head:
        lines = [line.replace(".", ",") for line in lines]
    text = table(lines, head)
    said = refused(tmp_path, text, "--map", "force=F:N")
    assert "may have a separator of thousands; write --time COLUMN:UNIT, or --rate HZ" in said
    signal, _ = imported(tmp_path, text, "--map", "force=F:N", "--rate", "1000")
    assert signal.rate_hz == 1000 and signal.time_s[0] == 0


@pytest.mark.parametrize(
    ("head", "row", "rate_hz"),
    [
        ("Sample rate;2.500 Hz\nF [N];x [mm]\n", "{f:.4f};{k}", 2.5),
        ("Sample rate;2500.000 Hz\nF [N];x [mm]\n", "{f:.3f};{k}", 2500),
        ("Increment;1.000e-3\nF [N];x [mm]\n", "{f};{k}", 1000),
        ("Sample interval;0.001 s\nF [N];x [mm]\n", "{f};{k}", 1000),
        ("Start;14:03:14.125\nSample rate;1000 Hz\nF [N];x [mm]\n", "{f};{k}", 1000),
        ("Sample rate,500,500\n,F [N],x [mm]\n", ",{f},{k}", 500),
    ],
)
def test_a_stated_rate_whose_decimal_sign_is_sure_is_read(tmp_path, head, row, rate_hz):
    signal, _ = imported(tmp_path, table(rows(row), head), "--map", "force=F")
    expect(signal, rate_hz=rate_hz)


def test_a_rate_in_doubt_does_not_matter_beside_times(tmp_path):
    text = table(rows("{t:.4f};{f}"), "Sample rate;1,000 Hz\nt [s];F [N]\n")
    signal, printed = imported(tmp_path, text, "--map", "force=F")
    expect(signal)
    assert "the source states" not in printed


def test_a_stated_count_with_a_separator_of_thousands_is_not_read(tmp_path):
    text = table(rows("{f};{k}"), "Samples;10.000\nIncrement;1.0e-3\nF [N];x [mm]\n")
    expect(imported(tmp_path, text, "--map", "force=F")[0])


@pytest.mark.parametrize("row", ["{t:.4f}", "{k}"])
def test_whole_thousands_are_refused(tmp_path, row):
    lines = [f"{line};{1 + k % 7}.000" for k, line in enumerate(rows(row))]
    text = table(lines, "t [ms];F [N]\n")
    if row == "{t:.4f}":  # the times show the decimal sign
        assert imported(tmp_path, text, "--map", "force=F")[0].values[0] == 1.0
        return
    said = refused(tmp_path, text, "--map", "force=F")
    assert "line 2, F: expected a sure decimal sign, got '1.000', which may be 1000" in said


# Headers that state the step of the times, above rows whose times have no name.
UNNAMED_TIMES = {
    "a column without a name": ("Sample Rate,1000.0\nSecond,Volt\n", "{t:.6f},{f:.3f},0x0637"),
    "no names": ("Sample Interval,0.001\nVertical Scale,5.0\n", "{t:.6f},{f:.3f},{k}"),
    "another name": ("Sample Rate: 1 kHz\nX,CH1,CH2\n", "{t:.6f},{f:.3f},{k}.25"),
    "another place": ("dt;1 ms\n", "{k}.25;{f:.3f};{t:.6f}"),
}


@pytest.mark.parametrize("form", UNNAMED_TIMES)
def test_times_of_the_stated_step_are_known_without_a_name(tmp_path, form):
    """Times that count the rows put all rows behind a missing one at wrong times."""
    head, row = UNNAMED_TIMES[form]
    lines = rows(row)
    del lines[40:43]
    signal, printed = imported(tmp_path, table(lines, head), "--map", "force=#2:N")
    assert signal.rate_hz == pytest.approx(1000)
    kept = [k for k in range(60) if not 40 <= k < 43]
    np.testing.assert_allclose(signal.values, [0.5 * k for k in kept])
    np.testing.assert_allclose(signal.time_s, [1e-3 * k for k in kept], atol=1e-9)
    assert "no sample for 0.004 s, 3 samples missing" in printed
    assert "the times are those of column" in printed or "was not found by its name" in printed


@pytest.mark.parametrize("row", ["{k},{f:.3f},{t:.6f}", "{r:.3f},{f:.3f},{k}.25"])
def test_a_signal_that_moves_as_slowly_as_the_times_is_no_time(tmp_path, row):
    """A set-point in mm at 1 mm/s: it stands behind another signal, or it moves a part of the
    time."""
    lines = [row.format(k=k, f=0.5 * k, t=1e-3 * k, r=1e-3 * min(k, 50)) for k in range(60)]
    head = "Sample Interval,0.001\nset,load,other\n"
    signal, printed = imported(tmp_path, table(lines, head), "--map", "force=load:N")
    expect(signal)
    assert "the times are those of sample interval 0.001 of line 1" in printed


def test_times_that_count_rows_say_that_rows_are_missing(tmp_path):
    lines = rows("{f:.3f}")
    head = "Points:,60\nXInc:,1.0E-03\nXOrg:,0.0\nData:\n"
    whole, printed = imported(tmp_path, table(lines, head), "--map", "force=1:N")
    assert "missing" not in printed
    expect(whole)
    del lines[40:43]
    _, printed = imported(tmp_path, table(lines, head), "--map", "force=1:N")
    assert "3 samples missing: if not at the end, all later times are too early" in printed


def test_a_narrower_section_without_names_takes_none(tmp_path):
    """The names above it are those of three columns; nobody knows which two these are."""
    between = "second part\nof two\n"
    wide = table(rows("{t:.3f},{f:.3f},{k}.5"), "t [s],F [N],x [mm]\n")
    narrow = table(rows("{t:.3f},{k}.25", begin=0.06))
    signal, printed = imported(tmp_path, wide + between + narrow, "--map", "force=F")
    expect(signal)
    assert "not imported, as expected a column" in printed
    same = table(rows("{t:.3f},{f:.3f},{k}.5", begin=0.2))
    run(tmp_path, wide + between + same, "--map", "force=F")
    assert len(list(tmp_path.glob("made_*.npz"))) == 2  # equally many columns keep their names
