"""`forceaxis cycle judge` on files: recordings and files of other programs, records for statistics
and teach, proposals, and the one line of each wrong input."""

import csv
import json
import random
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
import tomlkit
from forceaxis.cycles import live
from forceaxis.cycles.part import ElementFigure
from forceaxis.cycles.record import PartRecord
from forceaxis.cycles.records import RecordFolder, read_parts
from forceaxis.recordings import signal_recording
from judged_curves import recording, saturation, signal, without
from test_judge import EXPERIMENTS, PRESS, bush, held_sample, labels_of, simulated
from verbs import forceaxis

FOREIGN = ("--map", "force=-Fz:kN,position=way:mm")
COUNTS = ("--travel-count", "1um", "--force-count", "10mN")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The program of a bush, recordings of four parts, and two of them as CSV files."""
    made = tmp_path_factory.mktemp("judge")
    (made / "bush.toml").write_text(tomlkit.dumps(PRESS))
    for k, shoulder in enumerate((0.003, 0.0031, 0.0036, 0.003), 1):
        one = bush(shoulder, seed=k)
        if k == 4:
            one = without(one, [held_sample(one)])
        signal_recording.write(one, made / f"part{k}")
        with (made / f"part{k}.csv").open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(["t [ms]", "Fz [kN]", "way [mm]"])
            for t, f, x in zip(one["force"].time_s, one["force"].values, one["position"].values,
                               strict=True):  # fmt: skip
                writer.writerow([f"{1e3 * t:.6f}", f"{-1e-3 * f:.9f}", f"{1e3 * x:.7f}"])
    return made


def judged(folder, *words):
    done = forceaxis("cycle", "judge", *words, cwd=folder)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    return done.stdout


def judged_json(folder, *words):
    return json.loads(judged(folder, *words, "--json"))


def test_one_part_prints_its_elements_and_phases(folder):
    text = judged(folder, "bush.toml", "part1.npz", *COUNTS)
    assert "cycle        A bush: good\n" in text
    assert "counts       0.001 mm of travel, 0.01 N of force; 1000 samples per s\n" in text
    assert [line.split()[:2] for line in text.splitlines()][5:13] == [
        [element["name"], "good"] for element in PRESS["element"]
    ]
    assert "drift" not in text


def test_a_part_with_a_missing_sample_names_the_elements(folder):
    text = judged(folder, "bush.toml", "part4.npz", *COUNTS)
    assert "cycle        A bush: bad: samples are not valid\n" in text
    assert "held is invalid: 1 sample missing, from 0.203 s on, in phase hold" in text
    assert "held      invalid" in text


def test_a_file_of_another_program_is_imported_by_its_columns(folder):
    found = [
        judged_json(folder, "bush.toml", *files, *COUNTS, *words)["parts"]
        for files, words in (
            (("part1.npz", "part3.npz"), ()),
            (("part1.csv", "part3.csv"), (*FOREIGN, "--travel-range", "0mm..20mm")),
        )
    ]
    elements = [[part["record"]["elements"] for part in parts] for parts in found]
    assert elements[0] == elements[1]
    assert [part["record"]["state"] for part in found[1]] == ["good", "bad"]


def test_a_rest_at_the_end_of_the_way_may_be_a_saturated_sensor(folder):
    """The position of the hold is the largest one. Only the user knows the range of its sensor."""
    text = judged(folder, "bush.toml", "part1.csv", *COUNTS, *FOREIGN)
    assert "invalid      held is invalid: 26 samples saturated" in text
    assert "give --force-range and --travel-range" in text
    text = judged(
        folder, "bush.toml", "part1.csv", *COUNTS, *FOREIGN, "--travel-range", "0mm..12.5mm"
    )
    assert "shoulder is invalid" in text
    text = judged(folder, "bush.toml", "part1.csv", *COUNTS, *FOREIGN, "--travel-range", "0mm..1m",
                  "--force-range", "-5N..378N")  # fmt: skip
    assert "held is invalid" in text and "shoulder is invalid" not in text


def way(k):
    return f"{k * 0.02:.4f}"


def foreign(file, force_of, heads=("t [s]", "F [N]", "s [mm]"), place_of=way):
    """Writes a curve of 200 samples of another program. force_of, place_of: force in N and position
    in mm as text."""
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(heads)
        writer.writerows((f"{k / 1000:.4f}", force_of(k), place_of(k)) for k in range(200))


def ramp(k):
    return f"{0.4 * k + 0.013 * (k % 7):.4f}"


# (force of a sample, number of notes of the import about samples, text about the part)
AT_AN_END = [
    (ramp, 0, "good"),
    (lambda k: ramp(k) if k < 110 else "OVLD", 2, "90 samples missing, from 0.11 s on"),
    (lambda k: ramp(k) if k < 110 else "9.9e37", 2, "90 samples missing, from 0.11 s on"),
    (lambda k: "OVLD" if k < 40 else ramp(k), 2, "40 samples missing, from 0 s on"),
    (lambda k: min(ramp(k), "45.0000", key=float), 0, "87 samples saturated, from 0.113 s on"),
]  # fmt: skip


@pytest.mark.parametrize(("force_of", "notes", "text"), AT_AN_END)
def test_a_force_over_its_range_at_an_end_of_a_file_makes_the_part_bad(
    tmp_path, force_of, notes, text
):
    element = dict(PRESS["element"][4], phases=["press"])
    (tmp_path / "bush.toml").write_text(tomlkit.dumps({**PRESS, "element": [element]}))
    foreign(tmp_path / "a.csv", force_of)
    words = ("bush.toml", "a.csv", *COUNTS, "--map", "force=F,position=s", "--phase", "press")
    shown = judged(tmp_path, *words)
    assert text in shown
    assert ("cycle        A bush: good\n" in shown) == (text == "good")
    (part,) = judged_json(tmp_path, *words)["parts"]
    assert len(part["import_notes"]) == 1 + notes
    for note in part["import_notes"]:
        assert f"note         a.csv: {note}\n" in shown
    assert "left out" in str(part["import_notes"]) or not notes


def bushes(file, shoulders, gap="", first=1):
    """Writes a table with the curve of a bush for each shoulder, one below the other."""
    text = ""
    for k, shoulder in enumerate(shoulders, first):
        made = bush(shoulder, seed=k)
        text += gap + "t [s],F [N],s [mm]\n" + "".join(
            f"{t:.6f},{f:.6f},{1e3 * x:.7f}\n"
            for t, f, x in zip(made["force"].time_s, made["force"].values,
                               made["position"].values, strict=True)
        )  # fmt: skip
    file.write_text(text)


@pytest.mark.parametrize("gap", ["", "\nnext part\n"])
def test_each_section_of_a_table_is_a_part(folder, tmp_path, gap):
    shutil.copy(folder / "bush.toml", tmp_path)
    shoulders = (0.003, 0.0036, 0.0031)
    bushes(tmp_path / "day.csv", shoulders, gap)
    files = [f"alone_{k}.csv" for k in (1, 2, 3)]
    for k, file in enumerate(files):
        bushes(tmp_path / file, shoulders[k : k + 1], first=k + 1)
    maps = ("--map", "force=F,position=s")
    parts = judged_json(tmp_path, "bush.toml", "day.csv", *COUNTS, *maps, "--out", "r")["parts"]
    alone = judged_json(tmp_path, "bush.toml", *files, *COUNTS, *maps)
    assert [part["file"] for part in parts] == [f"day.csv, part {k}" for k in (1, 2, 3)]
    records = [part["record"] for part in parts]
    assert [(one["serial"], one["number"]) for one in records] == [
        ("day_1", 1), ("day_2", 2), ("day_3", 3),
    ]  # fmt: skip
    assert [one["elements"] for one in records] == [
        one["record"]["elements"] for one in alone["parts"]
    ]
    assert len(read_parts(tmp_path / "r").records) == 3


def test_each_pass_through_the_phases_is_a_part(folder, tmp_path):
    """A recording of three strokes, with the signal phase; -1 between them."""
    shutil.copy(folder / "bush.toml", tmp_path)
    alone, values = [], {"force": [], "position": [], "phase": []}
    for k, shoulder in enumerate((0.003, 0.0036, 0.0031), 1):
        made = bush(shoulder, seed=k)
        count = len(made["force"].values)
        one = replace(made, signals=(*made, signal("phase", made["force"].time_s, np.zeros(count))))
        alone.append(signal_recording.write(one, tmp_path / f"alone_{k}").name)
        for name, before in (("force", 0.0), ("position", one["position"].values[0]),
                             ("phase", -1.0)):  # fmt: skip
            values[name] += [np.full(20, before), one[name].values]
    whole = {name: np.concatenate(parts) for name, parts in values.items()}
    time_s = np.arange(len(whole["force"])) / 1000
    day = recording(time_s, whole["force"], whole["position"], phase=whole["phase"])
    signal_recording.write(day, tmp_path / "day")
    parts = judged_json(tmp_path, "bush.toml", "day.npz", *COUNTS)["parts"]
    singles = judged_json(tmp_path, "bush.toml", *alone, *COUNTS)["parts"]
    assert [part["file"] for part in parts] == [f"day.npz, part {k}" for k in (1, 2, 3)]
    assert [part["record"]["elements"] for part in parts] == [
        part["record"]["elements"] for part in singles
    ]
    short = replace(day, signals=tuple(
        replace(s, time_s=s.time_s[15:], values=s.values[15:]) for s in day))  # fmt: skip
    short.signals[2].values[700:703] = -1
    signal_recording.write(short, tmp_path / "short")
    done = forceaxis("cycle", "judge", "bush.toml", "short.npz", *COUNTS, cwd=tmp_path)
    assert done.returncode == 2 and "expected the curve of one part, or several ones" in done.stderr


def three_passes(folder, tmp_path, change=None, program="bush.toml"):
    """Judges three bushes, the first one bad, that follow each other without a pause. `change`
    changes the phases of their samples in place."""
    shutil.copy(folder / "bush.toml", tmp_path)
    values = {"force": [], "position": [], "phase": []}
    for k, shoulder in enumerate((0.0036, 0.003, 0.0031), 1):
        one = bush(shoulder, seed=k)
        phase = labels_of(one["force"].values, 1000.0)
        for name, own in (*((s.name, s.values) for s in one), ("phase", phase.astype(float))):
            values[name].append(own[phase >= 0])
    whole = {name: np.concatenate(parts) for name, parts in values.items()}
    if change:
        change(whole["phase"])
    time_s = np.arange(len(whole["force"])) / 1000
    day = recording(time_s, whole["force"], whole["position"], phase=whole["phase"])
    signal_recording.write(day, tmp_path / "day")
    return forceaxis("cycle", "judge", program, "day.npz", *COUNTS, "--json", cwd=tmp_path)


def test_a_part_begins_where_the_phases_begin_again(folder, tmp_path):
    done = three_passes(folder, tmp_path)
    states = [part["record"]["state"] for part in json.loads(done.stdout)["parts"]]
    assert states == ["bad", "good", "good"]


def test_a_part_of_a_program_that_repeats_its_phases_is_not_cut(folder, tmp_path):
    again = {"when": "force_below", "value": 4.5, "next": "press", "count": 3}
    back = dict(PRESS["phase"][2], end=[again, *PRESS["phase"][2]["end"]])
    program = {**PRESS, "phase": [*PRESS["phase"][:2], back]}
    (tmp_path / "loop.toml").write_text(tomlkit.dumps(program))
    done = three_passes(folder, tmp_path, program="loop.toml")
    assert len(json.loads(done.stdout)["parts"]) == 1, done.stderr


def hole(phase):
    """Ten samples in the first phase of the first part have no phase."""
    first = int(np.argmax(phase > 0))
    phase[first - 40 : first - 30] = -1


def cut(phase):
    """The recording ends in the first phase of the last part."""
    phase[np.flatnonzero(np.diff(phase) < 0)[-1] + 40 :] = -1


@pytest.mark.parametrize("change", [hole, cut])
def test_a_part_that_ends_in_an_earlier_phase_than_the_others_is_refused(folder, tmp_path, change):
    done = three_passes(folder, tmp_path, change)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "expected parts that end in the same phase of the program, got one" in done.stderr
    assert "ends in phase 0 at" in done.stderr


def test_a_second_stroke_that_nothing_separates_is_noted(folder, tmp_path):
    """The program decides about the phases, and its cycle ends with the first stroke."""
    shutil.copy(folder / "bush.toml", tmp_path)
    first, second = bush(0.003, seed=1), bush(0.003, seed=2)
    force, place = (
        np.concatenate([first[name].values, second[name].values]) for name in ("force", "position")
    )
    twice = recording(np.arange(len(force)) / 1000, force, place)
    signal_recording.write(first, tmp_path / "once")
    signal_recording.write(twice, tmp_path / "twice")
    note = "the curve presses once more at "
    assert note not in judged(tmp_path, "bush.toml", "once.npz", *COUNTS)
    assert note in judged(tmp_path, "bush.toml", "twice.npz", *COUNTS)


def test_a_spike_of_a_curve_is_named_and_judged(folder, tmp_path):
    shutil.copy(folder / "bush.toml", tmp_path)
    foreign(tmp_path / "a.csv", lambda k: "8388.6" if k == 40 else ramp(k))
    words = ("bush.toml", "a.csv", *COUNTS, "--map", "force=F,position=s", "--phase", "press")
    note = "force: 1 spike, at 0.04 s first: 1 sample of 8388.6 between 15.652 and 16.478"
    assert f"note         a.csv: {note}\n" in judged(tmp_path, *words)
    (part,) = judged_json(tmp_path, *words)["parts"]
    assert note in part["import_notes"] and part["record"]["state"] == "bad"


def instead(of, value, count):
    """The text of a sample, with `count` samples of another value in the middle of the stroke."""
    return lambda k: value if 100 <= k < 100 + count else of(k)


# (force of a sample, position of a sample, why the part is not good)
DISTURBED = [
    (instead(ramp, "590.0000", 3), way, "3 samples in a spike, from 0.1 s on"),
    (instead(ramp, "0.0000", 3), way, "3 samples in a spike, from 0.1 s on"),
    (ramp, instead(way, "99.0000", 1), "1 sample in a spike, from 0.1 s on"),
    (ramp, instead(way, "99.0000", 3), "3 samples in a spike, from 0.1 s on"),
    (instead(ramp, "300.0000", 4), way, "4 samples saturated, from 0.1 s on"),
    (instead(ramp, "0.0000", 40), way, "40 samples saturated, from 0.1 s on"),
]


@pytest.mark.parametrize(("force_of", "place_of", "text"), DISTURBED)
def test_a_disturbance_in_the_middle_of_a_stroke_leaves_no_part_good(
    tmp_path, force_of, place_of, text
):
    """The largest force is good, with these samples and without them."""
    element = dict(PRESS["element"][4], phases=["press"])
    (tmp_path / "bush.toml").write_text(tomlkit.dumps({**PRESS, "element": [element]}))
    foreign(tmp_path / "a.csv", force_of, place_of=place_of)
    words = ("bush.toml", "a.csv", *COUNTS, "--map", "force=F,position=s", "--phase", "press")
    shown = judged(tmp_path, *words)
    assert f"largest is invalid: {text}, in phase press" in shown
    assert "cycle        A bush: bad: samples are not valid\n" in shown


def test_maps_and_notes_are_those_of_the_import(folder, tmp_path):
    shutil.copy(folder / "bush.toml", tmp_path)
    for name in "abc":
        foreign(tmp_path / f"{name}.csv", ramp, ("t [s]", "Force, actual", "s [mm]"))
    maps = ("--map", "force=Force, actual:N,position=s")
    text = judged(tmp_path, "bush.toml", "a.csv", "b.csv", "c.csv", *COUNTS, *maps)
    done = forceaxis("recording", "import", "a.csv", *maps, "--out", "a", "--json", cwd=tmp_path)
    (note,) = json.loads(done.stdout)["notes"]
    assert f"note         a.csv: {note} (and 2 files alike)\n" in text
    parts = judged_json(tmp_path, "bush.toml", "a.csv", "a.npz", *COUNTS, *maps)["parts"]
    assert [part["import_notes"] for part in parts] == [[note], []]
    assert parts[0]["record"]["elements"] == parts[1]["record"]["elements"]


def test_a_series_prints_statistics_and_drift(folder):
    text = judged(folder, "bush.toml", "part1.npz", "part2.npz", "part3.npz", "part4.npz", *COUNTS)
    lines = text.splitlines()
    assert "parts        4: 2 good, 2 bad, 0 aborted" in lines
    assert any(line.startswith("not good     part3.npz: bad, shoulder above") for line in lines)
    assert any(
        line.startswith("invalid      part4.npz: held is invalid: 1 sample") for line in lines
    )
    assert any("not tested: fewer values than the reference" in line for line in lines)


def test_records_of_curves_are_those_that_statistics_and_teach_read(tmp_path):
    """With the program of an experiment, the CRC is that of an axis."""
    _, made = simulated("press_fit", ())
    signal_recording.write(made, tmp_path / "part")
    experiment = EXPERIMENTS / "press_fit.toml"
    judged(tmp_path, str(experiment), "part.npz", "--out", "records")
    judged(tmp_path, "press_fit", "part.npz", "--out", "records")  # the same part, once
    (record,) = read_parts(tmp_path / "records").records
    assert record.program_crc == f"{live.live_program(experiment).program.crc:08X}"
    assert (record.state, record.serial) == ("good", "part")
    done = forceaxis("cycle", "statistics", "records", cwd=tmp_path)
    assert "parts        1: 1 good, 0 bad, 0 aborted" in done.stdout
    done = forceaxis("cycle", "teach", "press_fit", "records", "--propose", "1%", "-o", "new.toml",
                     cwd=tmp_path)  # fmt: skip
    assert "expected at least 599 good parts" in done.stderr


def test_records_of_a_series_are_tested_for_wear(tmp_path):
    """The hundred parts of a folder; those after the sixtieth have another shoulder."""
    rng = np.random.default_rng(3)
    with RecordFolder(tmp_path / "records") as into:
        for number in range(1, 101):
            value = rng.normal(3e-3, 2e-5) + 1e-4 * (number > 60)
            figure = ElementFigure("shoulder", "at", "good", value, "m", 2e-3, 4e-3)
            state = "aborted" if number == 40 else "good"
            into.add(PartRecord(number, state=state, serial=f"S{number}", elements=[figure]))
    words = ("cycle", "statistics", "records", "--false-alarms", "1%")
    text = forceaxis(*words, cwd=tmp_path).stdout
    assert "shoulder      99  " in text
    assert re.search(
        r"warning      shoulder rises from part (\d\d) \(S\1\) on, found at part 6", text
    )
    assert "in at most 0.9" in text
    found = json.loads(forceaxis(*words, "--json", cwd=tmp_path).stdout)["drift"]
    assert 60 < found["elements"][0]["found_at"] < 70
    assert "drift" not in forceaxis(*words[:3], cwd=tmp_path).stdout
    done = forceaxis(*words, "--reference", "3", cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_bounds_from_good_curves_refuse_the_stated_share(tmp_path):
    """300 parts, one bound: three of them are beyond it."""
    program = tomlkit.parse(tomlkit.dumps(PRESS))
    element = dict(PRESS["element"][1], least=0.0001)
    del element["most"]
    program["element"] = [element]
    (tmp_path / "bush.toml").write_text(f"# A comment.\n{tomlkit.dumps(program)}")
    rng, names = random.Random(8), []
    for k in range(300):
        made = bush(0.003 + 1e-5 * rng.gauss(0, 1), 500.0, seed=k)
        names.append(signal_recording.write(made, tmp_path / f"{k:03}").name)
    found = judged_json(tmp_path, "bush.toml", *names, *COUNTS, "--propose", "1%", "-o", "new.toml")
    assert found["proposal"]["expected"] == pytest.approx(3 / 301)
    assert (tmp_path / "new.toml").read_text().startswith("# A comment.\n")
    parts = judged_json(tmp_path, "new.toml", *names, *COUNTS)["parts"]
    assert [part["record"]["state"] for part in parts].count("bad") == 2  # the bound is a good part


def test_of_a_recording_of_the_axis_the_ends_of_its_sensor_are_known(tmp_path):
    """The force is 0 for some ticks of the way back, which the import names saturated."""
    _, made = simulated("press_fit", ())
    labels = [s for s in made if s.name.startswith("cycle")]
    force = made["force"]
    low = replace(force, findings=(saturation(1.2, 1.3),))
    own = replace(made, signals=(low, made["position"], *labels))
    signal_recording.write(own, tmp_path / "own")
    text = judged(tmp_path, "press_fit", "own.npz")
    assert "cycle        Press-fit of a bearing: good" in text
    text = judged(tmp_path, "press_fit", "own.npz", "--force-range", "0N..399.6N")
    assert "seating_force is invalid" in text


CODES = ("force=adc0:0.01N", "position=encoder:1um", "cycle_phase=cycle_phase:1",
         "cycle_state=cycle_state:1")  # fmt: skip


@pytest.mark.parametrize(("changed", "overrides", "text"), [
    ({}, (), None),
    ({0: "force=adc0:0.1N"}, (), "force: expected 0.01 N for a count of adc0, as in the"),
    ({1: "position=encoder:1mm"}, (), "position: expected 0.001 mm for a count of encoder"),
    ({}, ("force_tare = 0.4",), "codes of adc0, from which force_tare of the experiment"),
])  # fmt: skip
def test_the_scales_of_a_trace_are_those_of_its_experiment(tmp_path, changed, overrides, text):
    experiment = tomlkit.parse((EXPERIMENTS / "press_fit.toml").read_text())
    del experiment["expect"]
    for key in ("model", "cycle"):
        experiment[key] = str((EXPERIMENTS / experiment[key]).resolve())
    for line in overrides:
        experiment["firmware"] |= tomlkit.parse(line)
    (tmp_path / "e.toml").write_text(tomlkit.dumps(experiment))
    assert forceaxis("run", "e.toml", "--out", "out", cwd=tmp_path).returncode == 0
    maps = [changed.get(k, one) for k, one in enumerate(CODES)]
    done = forceaxis("cycle", "judge", "e.toml", "out/trace.csv", "--map", ",".join(maps),
                     cwd=tmp_path)  # fmt: skip
    if text is None:
        assert "cycle        Press-fit of a bearing: good" in done.stdout
    else:
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert text in done.stderr


def test_an_order_by_letters_of_numbered_curves_is_said(folder, tmp_path):
    """A shell gives 10.npz before 2.npz."""
    for number in (1, 2, 9, 10, 11):
        shutil.copy(folder / "part1.npz", tmp_path / f"{number}.npz")
    shutil.copy(folder / "bush.toml", tmp_path)
    names = sorted(path.name for path in tmp_path.glob("*.npz"))
    text = judged(tmp_path, "bush.toml", *names, *COUNTS)
    assert (
        "warning      11.npz was given before 2.npz: give the curves in the order of the parts"
        in text
    )
    by_number = sorted(names, key=lambda name: int(name[:-4]))
    assert "was given before" not in judged(tmp_path, "bush.toml", *by_number, *COUNTS)


WRONG = [
    ("bush.toml part1.npz", "--travel-count: expected the size of a count", "give --travel-count"),
    ("bush.toml part1.npz --travel-count 1um", "--force-count: expected the size", "give both"),
    ("bush.toml part1.npz --travel-count 1kg --force-count 1N", "--travel-count: 1kg", "as 1um"),
    ("bush.toml part1.npz --travel-count 1um --force-count 0N", "--force-count: 0N", "such as 5mN"),
    ("press_fit part1.npz --travel-count 1um --force-count 1N", "--travel-count: expected no size"),
    ("press_fit part1.npz", "part1.npz: expected a signal phase", "ends on reached", "--phase"),
    ("bush.toml none.npz {counts}", "none.npz: expected a readable file"),
    ("bush.toml part1.csv {counts}", "part1.csv: expected a recording", "recording import"),
    ("bush.toml bush.toml {counts}", "bush.toml: expected a recording"),
    ("bush.toml part1.csv {counts} --map force=Fz:kN", "csv: expected a signal position in m"),
    ("bush.toml part1.csv {counts} --map force=way:mm,position=way:mm", "a unit of force"),
    ("bush.toml part1.npz {counts} --phase pull", "--phase: expected one of the phases"),
    ("bush.toml part1.npz {counts} --false-alarms 2", "--false-alarms: 2: expected a share"),
    ("bush.toml part1.npz {counts} --false-alarms 70%", "--false-alarms: expected a share from"),
    ("bush.toml part1.npz {counts} --force-range 5N", "--force-range: 5N: expected LOW..HIGH"),
    ("bush.toml part1.npz {counts} --travel-range 5mm..1mm", "--travel-range: 5mm..1mm: expected"),
    ("bush.toml part1.npz {counts} --reference 5", "--reference: expected at least 10 parts"),
    ("bush.toml part1.npz {counts} --propose 1%", "--propose: expected both --propose RATE and -o"),
    ("bush.toml part1.npz {counts} --propose 1% -o n.toml", "expected at least", "take more parts"),
    ("bush.toml part1.npz --travel-count 1um --force-count 1mN", "phase[0].force_max: expected"),
    ("bush.toml part1.npz {counts} --program bush.toml", "--program: expected no second program"),
    ("contact part1.npz", "cycle: expected an experiment that names a program"),
    ("bush.toml", "Missing argument 'CURVE...'"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "texts"), [(w, t) for w, *t in WRONG])
def test_wrong_input_ends_in_one_line_and_status_2(folder, words, texts):
    done = forceaxis("cycle", "judge", *words.format(counts=" ".join(COUNTS)).split(), cwd=folder)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    for text in texts:
        assert text in done.stderr
