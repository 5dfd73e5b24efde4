"""Folders with records of parts: written completely or not at all, resumed, repaired."""

import csv
import json
import os

import pyarrow.parquet
import pytest
from forceaxis import InputError
from forceaxis.cycles import record, records
from forceaxis.cycles.part import ElementFigure
from forceaxis.cycles.record import PartRecord
from forceaxis.cycles.records import RecordFolder
from forceaxis.results import from_json, to_json

pytestmark = pytest.mark.quick


@pytest.fixture(autouse=True)
def disk(monkeypatch):
    """No test waits for the disk; the order of the calls is tested instead."""
    monkeypatch.setattr(os, "fsync", lambda handle: None)


def part(number, power_up=1, elements=("shoulder", "force"), **given):
    figures = [ElementFigure(name, "at", "good", 0.1 / number, "m", 0.0, None) for name in elements]
    defaults = {"state": "good", "outcome": "by_program", "serial": f'S,"{number}"',
                "duration_s": 1 / 3, "notes": ["master due", "calibration due"]}  # fmt: skip
    return PartRecord(number, power_up, **{**defaults, "elements": figures, **given})


def table(folder):
    with (folder / "parts.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def numbers(folder):
    return [(int(row["power_up"]), int(row["number"])) for row in table(folder)]


def test_a_record_is_one_json_object_and_one_row():
    curve = [(0.0, 0.0, 1.5), (0.1, 1e-3, 2.5)]
    one = part(7, curve=curve)
    assert from_json(PartRecord, json.loads(json.dumps(to_json(one)))) == one
    assert "curve" not in to_json(part(7))
    row = {name: "" if cell is None else str(cell) for name, cell in record.row_of(one).items()}
    names = record.elements_of(list(row))
    again = record.from_row(row, names, "here")
    assert names == ["shoulder", "force"]
    kinds = [ElementFigure(**{**vars(e), "kind": ""}) for e in one.elements]
    assert again == PartRecord(**{**vars(one), "elements": kinds, "curve": None})


def test_parts_are_added_and_the_folder_is_resumed(tmp_path):
    with RecordFolder(tmp_path / "new/records") as folder:
        assert folder.add(part(1)) and folder.add(part(2))
        assert not folder.add(part(2, recorded="later", axis="another connection"))
    with RecordFolder(tmp_path / "new/records") as folder:
        assert (1, 2) in folder and folder.keys == [(1, 1), (1, 2)]
        assert not folder.add(part(1)) and folder.add(part(1, power_up=2))
    path = tmp_path / "new/records"
    assert numbers(path) == [(1, 1), (1, 2), (2, 1)]
    assert sorted(f.name for f in (path / "parts").iterdir()) == [
        "00001_0000000001.json", "00001_0000000002.json", "00002_0000000001.json",
    ]  # fmt: skip
    assert table(path)[1]["serial"] == 'S,"2"' and float(table(path)[1]["force"]) == 0.05


@pytest.mark.parametrize(
    "change",
    [
        {"state": "bad"}, {"program_crc": "12"}, {"begin_tick": 9}, {"device": "0x1"},
        {"elements": ("shoulder",)},
    ],
)  # fmt: skip
def test_another_part_with_the_same_number_is_refused_and_changes_nothing(tmp_path, change):
    with RecordFolder(tmp_path) as folder:
        folder.add(part(1))
        before = (tmp_path / "parts/00001_0000000001.json").read_text()
        with pytest.raises(InputError, match=r"a different part with the number 1 of power-up 1"):
            folder.add(part(1, **change))
    assert (tmp_path / "parts/00001_0000000001.json").read_text() == before


def test_a_table_that_was_cut_anywhere_is_repaired(tmp_path):
    with RecordFolder(tmp_path) as folder:
        for number in (1, 2, 3):
            folder.add(part(number))
    whole = (tmp_path / "parts.csv").read_bytes()
    for length in [*range(0, len(whole), 7), len(whole) - 1]:
        (tmp_path / "parts.csv").write_bytes(whole[:length])
        RecordFolder(tmp_path).close()
        assert (tmp_path / "parts.csv").read_bytes() == whole, length


@pytest.mark.parametrize("damage", ["missing", "doubled", "other order", "no head", "nonsense"])
def test_a_table_that_does_not_follow_from_the_files_is_written_again(tmp_path, damage):
    with RecordFolder(tmp_path) as folder:
        folder.add(part(1))
        folder.add(part(2))
    file = tmp_path / "parts.csv"
    whole = file.read_text()
    head, one, two = whole.splitlines(keepends=True)
    damaged = {"doubled": whole + two, "other order": head + two + one, "no head": one + two,
               "nonsense": "\0\n"}  # fmt: skip
    if damage == "missing":
        file.unlink()
    else:
        file.write_text(damaged[damage])
    with RecordFolder(tmp_path) as folder:
        assert file.read_text() == whole
        folder.add(part(3))
    assert numbers(tmp_path) == [(1, 1), (1, 2), (1, 3)]


def test_other_elements_get_columns_of_their_own(tmp_path):
    with RecordFolder(tmp_path) as folder:
        folder.add(part(1))
        folder.add(part(2, elements=("shoulder", "work")))
        folder.add(part(3))
    rows = table(tmp_path)
    assert [row["work"] for row in rows] == ["", "0.05", ""]
    assert [row["force_verdict"] for row in rows] == ["good", "", "good"]
    read = records.read_parts(tmp_path / "parts.csv").records
    assert [[e.name for e in one.elements] for one in read] == [
        ["shoulder", "force"], ["shoulder", "work"], ["shoulder", "force"],
    ]  # fmt: skip


def test_a_part_that_comes_late_has_its_place(tmp_path):
    with RecordFolder(tmp_path) as folder:
        for number in (1, 3, 2):
            folder.add(part(number))
    assert numbers(tmp_path) == [(1, 1), (1, 2), (1, 3)]
    RecordFolder(tmp_path).close()
    assert numbers(tmp_path) == [(1, 1), (1, 2), (1, 3)]


class Killed(BaseException):
    """Stands for the end of the process."""


def test_a_command_that_is_killed_anywhere_loses_no_part_that_was_added(tmp_path, monkeypatch):
    """At every call that writes, replaces or waits for the disk."""
    calls, at = [], None

    def counted(module, name):
        real = getattr(module, name)

        def call(*arguments, **options):
            calls.append(name)
            if at is not None and len(calls) > at:
                raise Killed
            return real(*arguments, **options)

        monkeypatch.setattr(module, name, call)

    for module, name in ((os, "fsync"), (os, "replace"), (json, "dumps"), (csv, "writer")):
        counted(module, name)

    def added(path):
        """The numbers of the parts that add() has accepted."""
        found = []
        try:
            with RecordFolder(path) as folder:
                for number in (1, 2, 3):
                    folder.add(part(number, elements=("a",) if number < 3 else ("a", "b")))
                    found.append(number)
        except Killed:
            pass
        return found

    assert added(tmp_path / "whole") == [1, 2, 3]
    total = len(calls)
    assert total > 15
    for at in range(total):
        calls.clear()
        path = tmp_path / str(at)
        accepted = added(path)
        at = None
        with RecordFolder(path) as folder:
            there = [number for _, number in folder.keys]
            assert there[: len(accepted)] == accepted and len(there) <= len(accepted) + 1
            assert [r.number for r in folder.records()] == there
        assert [number for _, number in numbers(path)] == there
        assert added(path) == [1, 2, 3] and numbers(path) == [(1, 1), (1, 2), (1, 3)]
        assert (path / "parts.csv").read_bytes() == (tmp_path / "whole/parts.csv").read_bytes()
        assert not list(path.rglob("*.new"))


def test_a_file_is_on_the_disk_before_it_has_its_name_and_its_name_before_add_returns(
    tmp_path, monkeypatch
):
    order = []
    replace = os.replace

    def synced(handle):
        order.append(os.readlink(f"/proc/self/fd/{handle}"))

    def replaced(old, new):
        order.append(f"{new}")
        replace(old, new)

    with RecordFolder(tmp_path) as folder:
        monkeypatch.setattr(os, "fsync", synced)
        monkeypatch.setattr(os, "replace", replaced)
        folder.add(part(1))
    file = str(tmp_path / "parts/00001_0000000001.json")
    assert order[:3] == [f"{file}.new", file, str(tmp_path / "parts")]


def test_two_commands_do_not_write_to_one_folder(tmp_path):
    with (
        RecordFolder(tmp_path),
        pytest.raises(InputError, match="that no other command writes to"),
    ):
        RecordFolder(tmp_path)
    RecordFolder(tmp_path).close()


def test_a_folder_that_cannot_be_one_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: expected a folder for the records of parts"):
        RecordFolder(tmp_path / "file")


def test_a_damaged_record_is_named(tmp_path):
    with RecordFolder(tmp_path) as folder:
        folder.add(part(1))
    file = tmp_path / "parts/00001_0000000001.json"
    file.write_text(file.read_text()[:-20])
    with pytest.raises(InputError, match=r"00001_0000000001.json: expected the record of a part"):
        records.read_parts(tmp_path)
    file.write_text('{"number": "one"}')
    with pytest.raises(InputError, match=r"00001_0000000001.json: number: expected an integer"):
        records.read_parts(tmp_path)


def test_parquet_has_the_rows_of_the_table(tmp_path):
    with RecordFolder(tmp_path) as folder:
        for number in (1, 2, 3):
            folder.add(part(number, elements=("a",) if number < 3 else ("a", "b")))
        file = folder.write_parquet()
    found = pyarrow.parquet.read_table(file).to_pylist()
    rows = table(tmp_path)
    assert [row["number"] for row in found] == [1, 2, 3]
    assert [row["b"] for row in found] == [None, None, 0.1 / 3]
    for one, other in zip(found, rows, strict=True):
        assert {n: "" if v is None else str(v) for n, v in one.items()} == other


def test_the_last_parts_are_read(tmp_path):
    with RecordFolder(tmp_path) as folder:
        for number in range(1, 6):
            folder.add(part(number))
    for source in (tmp_path, tmp_path / "parts.csv"):
        assert [r.number for r in records.read_parts(source, 2).records] == [4, 5]
        assert len(records.read_parts(source, 9).records) == 5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "expected a folder with records of parts, or a table"),
        ("", "expected a table of parts with a column `state`"),
        ("a,b\n1,2\n", "expected a table of parts with a column `state`"),
        ("state,a,a_verdict\n", "expected the record of at least one pressed part"),
        ("state,a,a_verdict\ngood,1\n", "line 2: expected 3 cells, got 2"),
        ("state,a,a_verdict\ngood,much,good\n", "line 2: a: expected a number, got much"),
        ("state,number,a,a_verdict\ngood,x,1,good\n", "line 2: number: expected a number, got x"),
    ],
)
def test_another_table_is_one_line(tmp_path, text, words):
    file = tmp_path / "parts.csv"
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputError, match=words) as error:
        records.read_parts(file)
    assert "\n" not in str(error.value)


def test_of_simulated_parts_the_good_ones_are_read(tmp_path):
    file = tmp_path / "parts.csv"
    file.write_text(
        "group,kind,number,gap,state,outcome,failed_phase,error,a,a_verdict,a_least,a_most,a_unit\n"
        "good parts,good,0,1e-3,good,by_program,,,0.5,good,0.1,,N\n"
        "good parts,good,1,1e-3,,,,no,,,0.1,,N\n"
        "bad tight,tight,0,1e-3,bad,by_program,,,0.05,below,0.1,,N\n"
    )
    found = records.read_parts(tmp_path)
    assert (len(found.records), found.left_out) == (1, 1)
    assert found.records[0].elements == [ElementFigure("a", "", "good", 0.5, "N", 0.1, None)]


def test_json_lines_are_all_records_and_are_read_again(tmp_path):
    with RecordFolder(tmp_path / "records") as folder:
        folder.add(part(2, curve=[(0.0, 0.0, 1.5)]))
        folder.add(part(1))
        lines = folder.write_lines()
        written = list(folder.records())
    texts = lines.read_text(encoding="utf-8").splitlines()
    assert [from_json(PartRecord, json.loads(text)) for text in texts] == written
    assert [one.number for one in written] == [1, 2] and written[1].curve
    parts = records.read_parts(lines)
    assert parts.records == written
    assert [one.number for one in records.read_parts(lines, last=1).records] == [2]


def test_a_wrong_line_of_json_is_refused(tmp_path):
    file = tmp_path / "parts.jsonl"
    file.write_text(json.dumps(to_json(part(1))) + "\n{\n")
    with pytest.raises(InputError, match=r"parts\.jsonl: line 2: expected the record of a part"):
        records.read_parts(file)
