"""Tables whose times, or whose header, are in several places: dates beside clock times, and a file
of its own for the header."""

import numpy as np
import pytest
from test_text_tables import FORCE, expect, imported, refused, rows, table

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


def test_a_row_without_its_date_has_no_time(tmp_path):
    lines = rows("2024-01-15,14:03:04.{k:03},{f:.3f}")
    lines[20] = lines[20].removeprefix("2024-01-15")
    said = refused(tmp_path, table(lines, "Date,Time,F_N\n"), "--map", "force=F_N")
    assert "line 22, Time: expected a time for the value of F_N, got none" in said
