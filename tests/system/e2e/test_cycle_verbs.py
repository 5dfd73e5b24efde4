"""`forceaxis cycle` as a user calls it: tables, JSON, pictures, journals, and new programs."""

import csv
import json
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import dask_cluster
import numpy as np
import part_records
import pytest
import verbs
from forceaxis.cycles import live, rates
from forceaxis.cycles.records import RecordFolder

ROOT = Path(__file__).resolve().parents[3]
PARTS = ["--good", "sim/parts/press_fit_good.toml", "--bad", "sim/parts/press_fit_bad.toml"]
FEW = [*PARTS, "--parts", "20", "--bad-parts", "3", "--seed", "1"]


def cycle(*arguments, status=0):
    done = verbs.forceaxis("cycle", *arguments, cwd=ROOT)
    assert done.returncode == status, (done.stdout, done.stderr)
    return done


def test_run_prints_the_part_and_draws_it(tmp_path):
    picture = tmp_path / "part.png"
    done = cycle("run", "press_fit", "--plot", picture)
    lines = [line.split() for line in done.stdout.splitlines()]
    assert lines[0] == ["cycle", "Press-fit", "of", "a", "bearing:", "good"]
    assert ["shoulder", "good", "4.009", "3.8", "4.3", "mm"] in lines
    assert ["joining_force", "good", "1", "-", "-"] in lines
    assert ["seat", "1.097", "1.897", "time", "0.8", "s"] in lines
    assert picture.read_bytes().startswith(b"\x89PNG")
    bad = cycle("run", "press_fit", "--set", "gap=30 mm")
    assert "cycle        Press-fit of a bearing: bad" in bad.stdout


def test_a_run_that_starts_no_cycle_says_how_one_starts(tmp_path):
    text = (ROOT / "sim/experiments/press_fit.toml").read_text()
    text = text.split("[[at]]")[0].replace('"../', f'"{ROOT}/sim/')
    (tmp_path / "part.toml").write_text(text)
    (line, *_) = cycle("run", tmp_path / "part.toml").stdout.splitlines()
    assert "no cycle was started" in line
    for word in ("modes_of_operation = -9", "[[at]]", "6, 7, 15 and 31 one after the other"):
        assert word in line


def test_the_json_of_run_has_the_same():
    table = json.loads(cycle("run", "press_fit", "--json").stdout)
    assert table["state"] == "good" and table["program"] == "sim/cycles/press_fit.toml"
    assert [phase["name"] for phase in table["phases"]] == ["approach", "join", "seat", "retract"]
    assert table["elements"][1] | {"value": 0} == {
        "name": "shoulder", "kind": "at", "verdict": "good", "value": 0, "unit": "m",
        "least": 0.0038, "most": 0.0043,
    }  # fmt: skip


def test_rates_prints_shares_with_intervals_and_resumes(tmp_path):
    out = tmp_path / "out"
    done = cycle("rates", "press_fit", *FEW, "--out", out)
    assert "runs         38: 0 from the journal, 38 now" in done.stdout
    part = next(line for line in done.stdout.splitlines() if "the part" in line)
    assert part.split() == ["the", "part", "0", "%", "0", "to", "16.8", "%"]  # 1 - 0.025^(1/20)
    assert "38 parts" in done.stderr
    again = cycle("rates", "press_fit", *FEW, "--out", out, "--json")
    table = json.loads(again.stdout)
    assert (table["runs"], table["resumed"]) == (38, 38)
    assert table["good"]["refused"] == {
        "count": 0, "of": 20, "share": 0.0, "low": 0.0,
        "high": pytest.approx(1 - 0.025 ** (1 / 20)),
    }  # fmt: skip
    assert {kind["name"]: kind["passed"]["count"] for kind in table["bad"]} == dict.fromkeys(
        ["no_part", "too_tight", "too_loose", "askew", "no_shoulder", "stuck"], 0
    )


@pytest.mark.long
def test_two_workers_of_a_cluster_give_the_parts_of_one_thread(tmp_path):
    with dask_cluster.started(tmp_path) as (address, _):
        cycle("rates", "press_fit", *FEW, "--out", tmp_path / "there", "--scheduler", address)
    cycle("rates", "press_fit", *FEW, "--out", tmp_path / "here", "--threads", "1")
    here, there = (tmp_path / name / "parts.csv" for name in ("here", "there"))
    assert here.read_bytes() == there.read_bytes() and len(here.read_text().splitlines()) == 39


def test_a_proposal_is_a_program_that_runs(tmp_path):
    new = tmp_path / "new.toml"
    few = [*PARTS, "--parts", "599", "--bad-parts", "1"]
    done = cycle("rates", "press_fit", *few, "--propose", "1%", "-o", new)
    assert "of good parts refused" in done.stdout
    assert "joining_force (window): its bounds are a shape" in done.stdout
    old_lines = (ROOT / "sim/cycles/press_fit.toml").read_text().splitlines()
    new_lines = new.read_text().splitlines()
    changed = [pair for pair in zip(old_lines, new_lines, strict=True) if pair[0] != pair[1]]
    assert len(changed) == 6 and all(line[0] in "lm" for pair in changed for line in pair)
    force = tomllib.loads(new.read_text())["element"][3]
    assert 390 < float(force["least"].removesuffix(" N")) < float(force["most"].removesuffix(" N"))
    part = json.loads(
        cycle("run", "press_fit", "--program", new, "--set", "k_bore=44 kN/m", "--json").stdout
    )
    assert part["elements"][1]["verdict"] == "good" and part["program"] == str(new)


def test_start_writes_the_curve_of_the_part(tmp_path):
    table, picture = tmp_path / "new" / "part.csv", tmp_path / "part.png"
    to = ["start", "press_fit", "--on", "sim:press_fit"]
    done = cycle(*to, "--curve", table, "--plot", picture)
    lines = [line.split() for line in done.stdout.splitlines()]
    assert lines[0] == ["cycle", "Press-fit", "of", "a", "bearing:", "good"]
    points = next(int(line[1]) for line in lines if line[0] == "curve")
    rows = table.read_text().splitlines()
    assert rows[0] == "time_s,travel_m,force_N,phase"
    assert len(rows) == 1 + points and 300 < points <= 1000
    assert rows[1].endswith(",approach") and rows[-1].endswith(",retract")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert json.loads(cycle(*to, "--json", "--curve", table).stdout)["state"] == "good"
    assert table.read_text().splitlines() == rows
    assert "curve" not in cycle(*to).stdout


def test_statistics_of_simulated_parts(tmp_path):
    """The figures are those of NumPy over the table."""
    cycle("rates", "press_fit", *FEW, "--parts", "40", "--out", tmp_path)
    plot, page = tmp_path / "new/statistics.png", tmp_path / "new/statistics.html"
    done = cycle("statistics", tmp_path, "--plot", plot, "--page", page)
    assert "parts        40: 40 good, 0 bad, 0 aborted\n" in done.stdout
    assert "left out     18 simulated bad parts\n" in done.stdout
    assert plot.read_bytes().startswith(b"\x89PNG")
    html = page.read_text()
    assert html.count("data:image/svg+xml") == 4 and "<b>40</b> parts" in html
    with (tmp_path / "parts.csv").open(newline="") as stream:
        rows = [row for row in csv.DictReader(stream) if row["group"] == "good parts"]
    values = np.array([float(row["shoulder"]) for row in rows])
    table = json.loads(cycle("statistics", tmp_path, "--json").stdout)
    one = next(e for e in table["elements"] if e["name"] == "shoulder")
    assert (one["n"], one["least"], one["most"], one["unit"]) == (40, 0.0038, 0.0043, "m")
    assert one["mean"] == pytest.approx(values.mean()) and one["values"] == values.tolist()
    s = values.std(ddof=1)
    nearest = min(0.0043 - values.mean(), values.mean() - 0.0038)
    assert one["cpk"]["value"] == pytest.approx(nearest / (3 * s))
    line = next(line for line in done.stdout.splitlines() if line.strip().startswith("shoulder"))
    assert line.split()[1:4] == ["40", f"{1e3 * values.mean():.6g}", f"{1e3 * s:.3g}"]
    last = json.loads(cycle("statistics", tmp_path / "parts.csv", "--last", "10", "--json").stdout)
    assert last["elements"][1]["values"] == values.tolist()[-10:]
    assert last["elements"][1]["without"] == "fewer than 30 values"


def axis_of(folder):
    """The options of a simulated axis that keeps its store in a folder. Each command is a power-up
    of it."""
    return ["--on", f"sim:press_fit@{folder / 'axis.store'}"]


def test_parts_are_pressed_and_recorded(tmp_path):
    axis, out = axis_of(tmp_path), tmp_path / "records"
    loaded = cycle("load", "press_fit", *axis).stdout
    assert "store        the axis has stored the program\n" in loaded
    to = ["start", "press_fit", *axis, "--out", out]
    done = cycle(*to, "--serial", "B-1", "--parquet")
    lines = done.stdout.splitlines()
    assert lines[0] == "cycle        Press-fit of a bearing: good"
    assert lines[1] == "part         1 of power-up 2, serial number B-1"
    assert (out / "parts.parquet").exists()
    bad = json.loads(cycle(*to, "--set", "k_bore=80 kN/m", "--json").stdout)
    assert (bad["number"], bad["power_up"], bad["state"]) == (1, 3, "bad")
    assert len(bad["curve"]) > 100 and len(bad["curve"][0]) == 3
    files = sorted((out / "parts").iterdir())
    assert [file.name for file in files] == ["00002_0000000001.json", "00003_0000000001.json"]
    assert json.loads(files[1].read_text()) == bad
    with (out / "parts.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["serial"], row["state"]) for row in rows] == [("B-1", "good"), ("", "bad")]
    assert rows[0]["parameters_crc"] == bad["parameters_crc"]
    # Both results are acknowledged; without --out a part is acknowledged when it is printed.
    assert "curve" not in json.loads(cycle("start", "press_fit", *axis, "--json").stdout)
    done = cycle("result", "press_fit", *axis, "--out", out)
    assert "results      0 results\n" in done.stdout
    picture = tmp_path / "statistics.png"
    done = cycle("statistics", out, "--plot", picture, "--page", tmp_path / "page.html")
    assert "parts        2: 1 good, 1 bad, 0 aborted\n" in done.stdout
    assert "warning      the last part is not good\n" in done.stdout
    assert "Force over travel of the last parts" in (tmp_path / "page.html").read_text()


def test_a_part_that_a_plc_has_started_is_recorded_until_ctrl_c(tmp_path):
    """The commands of the experiment are the PLC."""
    words = [
        sys.executable,
        "-m",
        "forceaxis",
        "cycle",
        "watch",
        "press_fit",
        "--on",
        "sim:press_fit",
    ]
    words += ["--out", tmp_path / "records", "--master-every", "8", "--master-serial", "M1"]
    # A shell lets the programs that it starts in the background ignore the signal.
    ignored = signal.signal(signal.SIGINT, signal.SIG_DFL)
    watch = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    signal.signal(signal.SIGINT, ignored)
    try:
        assert watch.stdout.readline() == "part 1: good, master due; 1 of 1 good\n"
    finally:
        watch.send_signal(signal.SIGINT)
        rest, _ = watch.communicate(timeout=60)
    assert watch.returncode == 0 and rest.startswith("files ")
    (file,) = (tmp_path / "records/parts").iterdir()
    assert json.loads(file.read_text())["notes"] == ["master due"]


def test_watch_ends_after_a_number_of_parts(tmp_path):
    to = ["watch", "press_fit", "--on", "sim:press_fit", "--parts", "1", "--out", tmp_path]
    done = cycle(*to, "--set", "k_bore=80 kN/m", "--calibration-due", "2020-01-01", "--json")
    record = json.loads(done.stdout)
    assert record["state"] == "bad" and record["notes"] == ["calibration due"]
    assert not (tmp_path / "parts.parquet").exists()


def test_bounds_are_taught_from_records(tmp_path):
    request = rates.RatesRequest(
        ROOT / "sim/experiments/press_fit.toml", ROOT / PARTS[1], parts=599, seed=1
    )
    wanted = live.live_program(request.experiment)
    with RecordFolder(tmp_path / "records") as folder:
        for record in part_records.recorded(rates.rates(request), wanted):
            folder.add(record)
    new = tmp_path / "new.toml"
    done = cycle("teach", "press_fit", tmp_path / "records", "--propose", "1%", "-o", new)
    assert done.stdout.startswith(f"proposal     {new}: 1 % of good parts refused")
    assert "unchanged    joining_force (window)" in done.stdout
    force = tomllib.loads(new.read_text())["element"][3]
    assert float(force["least"].removesuffix(" N")) > 390
    few = ["teach", "press_fit", tmp_path / "records", "--propose", "0.1%", "-o", tmp_path / "no"]
    assert "--parts: expected at least 5999 good parts" in cycle(*few, status=2).stderr
    assert not (tmp_path / "no").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["rates", "press_fit", *FEW, "--propose", "1%"], ["--propose", "-o FILE"]),
        (["rates", "press_fit", *FEW, "-o", "new.toml"], ["--propose", "-o FILE"]),
        (["rates", "press_fit", *FEW, "--propose", "many", "-o", "x"], ["--propose: many", "1%"]),
        (["rates", "press_fit", *FEW, "--propose", "1%", "-o", "x"], ["--parts", "at least 599"]),
        (["rates", "press_fit"], ["'--good'"]),
        (["rates", "press_fit", *PARTS, "--parts", "0"], ["--parts", "expected 1 to"]),
        (["rates", "press_fit", *FEW, "--scheduler", "nowhere"], ["--scheduler", "tcp://"]),
        (["rates", "press_fit", "--good", "no.toml"], ["no.toml", "expected a readable file"]),
        (["rates", "contact", *FEW], ["contact.toml: cycle", "names a program"]),
        (["run", "press_fit", "--plot", "part.gif"], ["--plot", ".png"]),
        (["run", "press_fit", "--program", "no.toml"], ["no.toml", "expected a readable file"]),
        (["start", "press_fit", "--on", "sim:press_fit", "--plot", "p.gif"], ["--plot", ".png"]),
        (["start", "press_fit", "--on", "sim:press_fit", "--curve", "p.txt"], ["--curve", ".csv"]),
        (["run", "contact"], ["contact.toml: cycle", "names a program"]),
        (["rnu", "press_fit"], ["'rnu'"]),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(arguments, words):
    done = cycle(*arguments, status=2)
    assert done.stdout == "" and not (ROOT / "x").exists() and not (ROOT / "new.toml").exists()
    line = done.stderr.splitlines()[-1]
    assert line.startswith("forceaxis: ")
    for word in words:
        assert word in line, line
