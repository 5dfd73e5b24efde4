"""`forceaxis test`, the pytest fixture and collection, and the CI example, as a user has them."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import verbs
import yaml
from forceaxis import SimulationError
from forceaxis.experiments import expect as expectations
from forceaxis.experiments import regression

ROOT = Path(__file__).resolve().parents[3]

# A mass that rolls out against viscous friction: x(t) = (J/b) (1 - exp(-b t / m)), J the impulse.
# With J = 2 N s, b = 4 N s/m, m = 1 kg it comes to rest at 0.5 m.
MODEL = """
[[body]]
name = "slider"
mass = 1.0
[[damper]]
name = "oil"
between = ["slider", "ground"]
damping = 4.0
[dac]
bits = 12
[encoder]
body = "slider"
scale = 100000.0
"""
EXPERIMENT = """# An axis that was pushed once.
title   =   "Roll out"   # odd spacing is the user's
model = "model.toml"
duration_s = 4.0
at = [ { time_s = 0.0, impulse = { body = "slider", N_s = 2.0 } } ]

[firmware]
bump_decay_shift = 0

[verdict]
window_s = 0.5
position_ripple_max_count = 20

[expect]   # what the commissioning sheet says
signal = "slider.position"
from_s = 0.0
{expect}

[plot]   # kept below
rows = [["encoder"]]
"""
# By hand: the band of 5 % of 0.5 m is entered for the last time at t = ln(20)/4 s.
SETTLE_S = np.log(20) / 4
GOOD = f"""verdict = "stable"
fault = "none"
final_value = 0.5
settle_s = {SETTLE_S:.4f}   # ln(20)/4
overshoot = {{ max = 0.001 }}"""


def forceaxis(*arguments, cwd=ROOT):
    return verbs.forceaxis(*arguments, cwd=cwd)


def axes(folder, **files):
    """A user's folder: the model and experiments by name, each with the lines of its [expect]."""
    folder.mkdir(exist_ok=True)
    (folder / "model.toml").write_text(MODEL)
    for name, expect in files.items():
        (folder / f"{name}.toml").write_text(EXPERIMENT.replace("{expect}", expect))
    return folder


def run_json(*arguments, cwd=ROOT):
    done = forceaxis("test", *arguments, "--json", cwd=cwd)
    assert done.stdout.count("\n") == 1, done.stderr
    return done.returncode, json.loads(done.stdout)


def test_the_thesis_is_such_a_directory():
    status, result = run_json("sim/experiments")
    assert status == 0
    with_model = [p for p in (ROOT / "sim/experiments").glob("*.toml") if p.stem != "tables"]
    assert result["passed"] == len(with_model) >= 13
    assert all(len(t["checks"]) >= 3 for t in result["tests"])


def test_values_worked_out_by_hand_pass(tmp_path):
    status, result = run_json(axes(tmp_path / "a", good=GOOD))
    assert (status, result["passed"]) == (0, 1), result
    got = {c["key"]: c["obtained"] for c in result["tests"][0]["checks"]}
    assert got["final_value"] == pytest.approx(0.5, abs=1e-6)
    assert got["settle_s"] == pytest.approx(SETTLE_S, abs=1 / 1500)
    assert got["overshoot"] == pytest.approx(0, abs=1e-6)


def response(values, **how):
    """measure() on a made-up response, one value a tick."""
    expect = expectations.read("e.toml", {"signal": "x", **how}, False)
    columns = {"x": np.asarray(values, float), "time_s": np.arange(len(values)) / 1500}
    metrics = SimpleNamespace(held_force=None)
    result = SimpleNamespace(
        verdict=None, fault="none", cycle=None, metrics=metrics, trace_hash="0"
    )
    done = SimpleNamespace(experiment="e.toml", columns=columns, result=result, contacts=[])
    return expectations.measure(done, expect).values


def test_the_definitions_on_responses_made_by_hand():
    """1000 ticks: a step to 10 at tick 100, 13 at tick 200 alone, 10.4 at tick 300 alone."""
    x = np.zeros(1001)
    x[100:] = 10
    x[200], x[300] = 13, 10.4
    got = response(x)
    assert got["final_value"] == 10
    assert got["overshoot"] == pytest.approx(0.3)
    assert got["settle_s"] == 201 / 1500  # 10.4 is inside +-5 %
    assert response(x, band=0.03)["settle_s"] == 301 / 1500
    assert response(x, band={"absolute": 3.0})["settle_s"] == 100 / 1500
    assert response(-x)["overshoot"] == pytest.approx(0.3)
    # From tick 150 there is no step; the last 900 ticks hold all three.
    late = response(x, from_s=0.1, band={"absolute": 1})
    assert (late["settle_s"], late["overshoot"]) == (51 / 1500, "undefined")
    assert response(x, final_s=0.6)["settle_s"] == "never"
    x[950] = 20
    assert response(x)["settle_s"] == "never"
    assert response(np.full(1001, 0.1))["settle_s"] == 0
    assert response(np.exp(-np.arange(1001) / 10))["final_value"] == 0  # 4e-40
    assert response(np.exp(-np.arange(1001) / 100))["final_value"] > 0  # 7e-5


def test_measurements_and_models_are_no_experiments(tmp_path):
    """They have a model too, or are one, but nothing that could have an [expect]."""
    here = axes(tmp_path / "a", good=GOOD)
    (here / "fig3_9.toml").write_bytes((ROOT / "sim/measurements/fig3_9.toml").read_bytes())
    done = forceaxis("test", here)
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "1 passed, 0 failed")
    assert "without [expect]" not in done.stdout
    done = forceaxis("test", here / "fig3_9.toml", here / "model.toml")
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert (
        "fig3_9.toml, " in done.stderr
        and "no experiments, because they have no duration_s" in done.stderr
    )
    assert "add [expect]" not in done.stderr


GUARD = """
[[body]]
name = "post"
mass = 1.0
position = -1.0
[[contact]]
name = "guard"
between = ["post", "ground"]
stiffness = 1e5
damping = 10.0
"""


@pytest.fixture
def guarded(tmp_path):
    """Runs the laboratory's contact beside a guard that nothing ever touches."""
    model = (ROOT / "sim/models/laboratory.toml").read_text() + GUARD
    thesis = ROOT / "sim/models/thesis.toml"
    (tmp_path / "model.toml").write_text(model.replace('"thesis.toml"', f'"{thesis}"'))
    text = (ROOT / "sim/experiments/contact.toml").read_text()
    text = text[: text.index("[plot]")].replace("../models/laboratory.toml", "model.toml")

    def run(held, gain=5):
        assert "contact_held = true" in text
        file = tmp_path / "contact.toml"
        file.write_text(text.replace("contact_held = true", f"contact_held = {held}"))
        return forceaxis("run", file, "--set", f"firmware.force_gain={gain}", "--json")

    return run


def test_a_verdict_names_the_contacts_that_must_hold(guarded):
    def verdict(held, gain=5):
        done = guarded(held, gain)
        assert done.returncode == 0, done.stderr
        result = json.loads(done.stdout)
        return result["verdict"], " ".join(result["because"])

    assert verdict("true") == ("never_in_contact", "never in contact")
    assert verdict('"sensor"') == verdict('["sensor"]') == ("stable", "")
    for held in ('"guard"', '["sensor", "guard"]'):
        assert verdict(held) == ("never_in_contact", "never in contact")
    # At gain 10 it bounces for ever.
    assert re.search("contact lost [0-9]+ times", verdict('"sensor"', gain=10)[1])
    assert "contact lost" not in verdict('"guard"', gain=10)[1]


# What the four words are written for, by the limit that the laboratory's contact misses.
NOT_STABLE = {
    "not_met": ("settle_max_s = 0.01", "5"),
    "never_in_contact": ("", "0.00390625"),  # the approach would take minutes
    "unstable": ("", "10"),  # bounces for ever
}


@pytest.fixture
def expecting(tmp_path):
    """The laboratory's contact with a verdict of NOT_STABLE, and another one in its [expect]."""

    def write(verdict, expected):
        limit, gain = NOT_STABLE[verdict]
        text = (ROOT / "sim/experiments/contact.toml").read_text()
        text = text[: text.index("[expect]")] + f'[expect]\nverdict = "{expected}"\n'
        text = text.replace("../models", str(ROOT / "sim/models"))
        text = re.sub("force_gain = .*", f"force_gain = {gain}", text)
        file = tmp_path / "contact.toml"
        file.write_text(text.replace("[verdict]\n", f"[verdict]\n{limit}\n"))
        return file

    return write


@pytest.mark.parametrize("verdict", NOT_STABLE)
def test_unstable_in_a_file_from_before_matches_with_a_warning(expecting, tmp_path, verdict):
    file = expecting(verdict, "unstable")
    done = forceaxis("test", file, "--junit", tmp_path / "r.xml")
    assert done.returncode == 0, done.stdout + done.stderr
    warned = verdict != "unstable"
    assert ("warning: verdict: expected unstable" in done.stdout) == warned
    assert (f"write {verdict}" in done.stdout) == warned
    (case,) = ET.parse(tmp_path / "r.xml").getroot().iter("testcase")
    assert case.find("failure") is None
    assert (case.find("system-out") is not None) == warned
    summary = json.loads(forceaxis("test", file, "--json").stdout)
    assert bool(summary["tests"][0]["warnings"]) == warned
    # --update writes the word that came out, and nothing is left to warn of.
    assert forceaxis("test", file, "--update").returncode == 0
    assert tomllib.loads(file.read_text())["expect"]["verdict"] == verdict
    done = forceaxis("test", file)
    assert done.returncode == 0 and "warning" not in done.stdout


@pytest.mark.parametrize("verdict", NOT_STABLE)
def test_every_other_word_is_taken_at_its_word(expecting, verdict):
    for expected in ("stable", *NOT_STABLE):
        if expected not in ("unstable", verdict):
            done = forceaxis("test", expecting(verdict, expected))
            assert done.returncode == 1
            assert f"verdict: expected {expected}, got {verdict}" in done.stdout
    done = forceaxis("test", expecting(verdict, "wobbly"))
    assert done.returncode == 2
    assert "expected one of stable, unstable, not_met, never_in_contact" in done.stderr


@pytest.mark.parametrize("held", ['"sensro"', "[]", "1", '["sensor", 2]', '""'])
def test_contacts_that_the_model_does_not_have_are_refused(guarded, held):
    done = guarded(held)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "verdict.contact_held: expected true, false or contacts of the model" in done.stderr
    assert "(sensor, guard)" in done.stderr


HASH = "0" * 64
DIFFERENCES = [
    ('verdict = "unstable"', "verdict: expected unstable, got stable"),
    ('fault = "sensor_invalid"', "fault: expected sensor_invalid, got none"),
    (f'trace_hash = "{HASH}"', "trace_hash: expected 0000000000000000..., got "),
    ("final_value = 0.49", "final_value: expected 0.49 +-0.0049, got 0.5 (0.01 m above, 2.0%)"),
    ("final_value = { value = 0.501, tolerance = 0.0009 }", "expected 0.501 +-0.0009, got 0.5"),
    ("final_value = { value = 0.502, relative = 0.003 }", "expected 0.502 +-0.00151, got 0.5"),
    ("final_value = { max = 0.4 }", "expected at most 0.4, got 0.5"),
    (
        "settle_s = { min = 1, max = 2 }",
        "at least 1 and at most 2, got 0.749333 (0.251 s below, 25.1%)",
    ),
    ('settle_s = "never"', "settle_s: expected never, got 0.749"),
    ("overshoot = 0.1", "overshoot: expected 0.1 +-0.01, got "),
    ('overshoot = "undefined"', "overshoot: expected undefined, got "),
]


@pytest.fixture(scope="module")
def differing(tmp_path_factory):
    """Each kind of difference, in a folder of its own, run at once."""
    top = tmp_path_factory.mktemp("differing")
    axes(top, **{f"d{i:02}": expect for i, (expect, _) in enumerate(DIFFERENCES)})
    axes(top, good=GOOD)
    done = forceaxis("test", ".", "--junit", "ci/r.xml", "--out", "out", "--threads", "2", cwd=top)
    return top, done


@pytest.mark.parametrize("index", range(len(DIFFERENCES)), ids=lambda i: DIFFERENCES[i][0][:20])
def test_each_kind_of_difference_is_told(differing, index):
    top, done = differing
    assert done.returncode == 1, done.stderr
    block = re.search(rf"failed +d{index:02}.toml\n((?:  +.*\n)+)", done.stdout)
    assert DIFFERENCES[index][1] in block[1]
    assert block[1].count("\n") == 2  # the difference, and where both are
    assert block[1].splitlines()[1].split() == (
        f"both curves: out/d{index:02}.png; the trace is the file .npz beside it".split()
    )
    assert "slider.position" in np.load(top / f"out/d{index:02}.npz").files
    case = ET.parse(top / "ci/r.xml").find(f".//testcase[@name='d{index:02}']")
    assert DIFFERENCES[index][1] in case.find("failure").get("message")
    assert "differs" in case.find("failure").text
    assert (top / f"out/d{index:02}.png").read_bytes().startswith(b"\x89PNG")
    assert "differs" in (top / f"out/d{index:02}.txt").read_text()


def test_the_counts_agree_everywhere(differing):
    top, done = differing
    assert done.stdout.endswith(f"1 passed, {len(DIFFERENCES)} failed\n")
    suite = ET.parse(top / "ci/r.xml").find("testsuite")
    assert suite.get("tests") == str(len(DIFFERENCES) + 1)
    assert suite.get("failures") == str(len(DIFFERENCES)) == str(len(suite.findall("*/failure")))
    assert (suite.get("errors"), suite.get("skipped")) == ("0", "0")
    assert not (top / "out/good.png").exists()


def test_parallel_is_serial(differing):
    top, _ = differing
    results = []
    for count in ("1", "4"):
        _, result = run_json(".", "--threads", count, cwd=top)
        for entry in result["tests"]:
            entry.pop("seconds")
        results.append(result)
    assert results[0] == results[1]


def test_a_changed_axis_fails_and_update_heals_it(tmp_path):
    here = axes(tmp_path, axis=f'{GOOD}\ntrace_hash = "{HASH}"')
    assert forceaxis("test", here, "--update").returncode == 0
    assert forceaxis("test", here).returncode == 0
    (here / "model.toml").write_text(MODEL.replace("4.0", "5.0"))
    before = (here / "axis.toml").read_text()
    assert forceaxis("test", here).returncode == 1
    assert (here / "axis.toml").read_text() == before
    done = forceaxis("test", here, "--update")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "updated" in done.stdout
    after = (here / "axis.toml").read_text()
    assert forceaxis("test", here).returncode == 0
    # By hand: 2/5 m, ln(20)/5 s. Only these values and the hash moved.
    expect = tomllib.loads(after)["expect"]
    assert expect["final_value"] == pytest.approx(0.4, rel=1e-4)
    assert expect["settle_s"] == pytest.approx(np.log(20) / 5, abs=1 / 1500)
    moved = [(a, b) for a, b in zip(before.splitlines(), after.splitlines(), strict=True) if a != b]
    assert [a.split()[0] for a, _ in moved] == ["final_value", "settle_s", "trace_hash"]
    assert moved[1][1].endswith("   # ln(20)/4")
    assert forceaxis("test", here, "--update").stdout.endswith("1 passed, 0 failed\n")
    assert (here / "axis.toml").read_text() == after
    assert sorted(p.name for p in here.iterdir()) == ["axis.toml", "model.toml"]


def test_update_keeps_forms_and_limits(tmp_path):
    lines = (
        "final_value = { value = 9.0, tolerance = 0.001 } # m\nsettle_s = 3\n"
        'overshoot = "undefined"'
    )
    here = axes(tmp_path, axis=lines, limit="final_value = { max = 0.4 }")
    before = (here / "limit.toml").read_text()
    done = forceaxis("test", here, "--update")
    assert done.returncode == 1
    assert re.search(r"failed +.*limit.toml\n +final_value: expected at most 0.4", done.stdout)
    assert (here / "limit.toml").read_text() == before
    text = (here / "axis.toml").read_text()
    assert "final_value = { value = 0.5, tolerance = 0.001 } # m\n" in text
    assert re.search(r"^settle_s = 0\.749", text, re.M)
    assert re.search(r"^overshoot = 0\.0$", text, re.M)
    assert text.splitlines()[:3] == EXPERIMENT.splitlines()[:3]


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_update_fills_an_empty_table(tmp_path, line_end):
    here = axes(tmp_path, axis="")
    file = here / "axis.toml"
    start = EXPERIMENT.replace("{expect}", "").replace("\n", line_end)
    file.write_bytes(b"\xef\xbb\xbf" + start.encode())
    file.chmod(0o640)
    done = forceaxis("test", here)
    assert done.returncode == 2
    assert "axis.toml: expect: " in done.stderr
    assert "--update" in done.stderr
    assert forceaxis("test", here, "--update").returncode == 0
    raw = file.read_bytes()
    assert raw.startswith(b"\xef\xbb\xbf#")
    assert raw.count(b"\n") == raw.count(line_end.encode())
    assert file.stat().st_mode & 0o777 == 0o640
    text = raw.decode("utf-8-sig")
    expect = tomllib.loads(text)["expect"]
    assert list(expect)[:4] == ["verdict", "final_value", "settle_s", "trace_hash"]
    added = text[text.index("verdict = ") : text.index("signal = ")]
    assert text.replace(added, "") == start
    assert forceaxis("test", here).returncode == 0


def test_update_holds_a_verdict_alone_to_what_comes_out(tmp_path):
    """As `forceaxis new` writes it; limits and numbers of one's own are not added to."""
    here = axes(tmp_path, axis='verdict = "stable"', own='verdict = "stable"\nsettle_s = 0.749')
    own = (here / "own.toml").read_bytes()
    assert forceaxis("test", here).returncode == 0
    done = forceaxis("test", here, "--update")
    assert done.stdout.endswith("1 passed, 1 updated, 0 failed\n"), done.stdout + done.stderr
    after = (here / "axis.toml").read_bytes()
    expect = tomllib.loads(after.decode())["expect"]
    assert expect["final_value"] == pytest.approx(0.5, rel=1e-4) and "trace_hash" in expect
    assert forceaxis("test", here, "--update").stdout.endswith("2 passed, 0 failed\n")
    assert ((here / "axis.toml").read_bytes(), (here / "own.toml").read_bytes()) == (after, own)
    (here / "model.toml").write_text(MODEL.replace("4.0", "5.0"))
    assert forceaxis("test", here, "-k", "axis").returncode == 1


def test_update_of_contact_adds_its_peak(tmp_path):
    shutil.copytree(ROOT / "sim/models", tmp_path / "models")
    (tmp_path / "e").mkdir()
    text = (ROOT / "sim/experiments/axis_contact_a.toml").read_text()
    (tmp_path / "e/a.toml").write_text(text[: text.index("[expect]")] + "[expect]\n")
    assert forceaxis("test", tmp_path, "--update").returncode == 0
    expect = tomllib.loads((tmp_path / "e/a.toml").read_text())["expect"]
    # An independent integration in extended precision gives 69.69030030811 N at tick 233.
    assert expect["peak_force_N"] == pytest.approx(69.69, abs=0.02)
    assert expect["trace_hash"] == tomllib.loads(text)["expect"]["trace_hash"]


def test_a_bare_zero_is_exact(tmp_path):
    """Case A touches down at 0.1267 s; before that no force is exactly what there is."""
    shutil.copytree(ROOT / "sim/models", tmp_path / "models")
    (tmp_path / "e").mkdir()
    text = (ROOT / "sim/experiments/axis_contact_a.toml").read_text()
    text = text[: text.index("[expect]")].replace("duration_s = 2.0", "duration_s = 0.1")
    (tmp_path / "e/a.toml").write_text(text + "[expect]\n")
    assert forceaxis("test", tmp_path, "--update").returncode == 0
    assert forceaxis("test", tmp_path).returncode == 0
    (tmp_path / "e/a.toml").write_text(text + "[expect]\npeak_force_N = 0\nfinal_value = 1e-9\n")
    done = forceaxis("test", tmp_path)
    assert "final_value: expected 1e-09 +-1e-11, got 0 (1e-09 N below, 100.0%)\n" in done.stdout
    assert "peak" not in done.stdout


BAD = [
    ("peek_force_N = 3", "expect.peek_force_N: expected one of verdict"),
    ('verdict = "wobbly"', "expect.verdict: expected one of stable, unstable"),
    ("verdict = true", "expect.verdict: "),
    ('fault = "fire"', "expect.fault: expected one of none"),
    ('trace_hash = "08b6"', "expect.trace_hash: expected 64"),
    ("trace_hash = 5", "expect.trace_hash: expected 64"),
    ("peak_force_N = 5", "expect.peak_force_N: expected a model with a contact"),
    ("final_value = true", "expect.final_value: expected a number"),
    ('final_value = "never"', "expect.final_value: expected a number"),
    ("final_value = nan", "expect.final_value: expected a number"),
    ("final_value = [1]", "expect.final_value: expected a number"),
    ("final_value = {}", "expect.final_value: expected one of the keys value"),
    ("final_value = { valu = 1 }", "expect.final_value.valu: expected one of"),
    ("final_value = { tolerance = 1 }", "expect.final_value: expected one of the keys value"),
    ("final_value = { value = 1, tolerance = -1 }", "expect.final_value.tolerance: "),
    ("final_value = { value = 1, tolerance = nan }", "expect.final_value.tolerance: "),
    ("final_value = { value = 1, tolerance = true }", "expect.final_value.tolerance: "),
    ("final_value = { value = 0, relative = 0.1 }", "expect.final_value.relative: "),
    ("overshoot = { value = 0, relative = 0.1 }", "expect.overshoot.relative: "),
    ("final_value = { value = 1, relative = 1, tolerance = 1 }", "tolerance or relative"),
    ("final_value = { value = 1, min = 0 }", "expect.final_value: expected either"),
    ("final_value = { min = 1, max = 0 }", "expect.final_value: expected min below max"),
    ('settle_s = "soon"', 'expect.settle_s: expected a number or "never"'),
    ("settle_s = -1", "expect.settle_s: "),
    ("overshoot = { max = -1 }", "expect.overshoot.max: "),
    ("band = -1", "expect.band: "),
    ("band = { width = 1 }", "expect.band: "),
    ("final_s = 5", "expect.final_s: expected at most 4 s"),
    ("final_s = 'a'", "expect.final_s: "),
]


@pytest.fixture(scope="module")
def bad(tmp_path_factory):
    top = tmp_path_factory.mktemp("bad")
    axes(top, **{f"b{i:02}": expect for i, (expect, _) in enumerate(BAD)}, good=GOOD)
    (top / "other").mkdir()
    axes(top / "other", signal=GOOD, late=GOOD, table=GOOD)
    for name, old, new in (
        ("signal", "slider.position", "slider.colour"),
        ("late", "from_s = 0.0", "from_s = 4"),
    ):
        file = top / "other" / f"{name}.toml"
        file.write_text(file.read_text().replace(old, new))
    (top / "other/table.toml").write_text('title="t"\nmodel="model.toml"\nexpect=3\nduration_s=1')
    (top / "other/cut.toml").write_text("title = ")
    (top / "other/binary.toml").write_bytes(bytes(range(256)))
    (top / "other/deep.toml").write_text("a = " + "[" * 20000)
    (top / "other/nomodel.toml").write_text('title = "t"\nduration_s = 1\n[expect]\n')
    (top / "other/.hidden").mkdir()
    (top / "other/.hidden/x.toml").write_text("title = ")
    before = {p: p.read_bytes() for p in top.rglob("*") if p.is_file()}
    done = forceaxis("test", ".", "--junit", top / "r.xml", "--update", cwd=top)
    after = {p: p.read_bytes() for p in top.rglob("*") if p.is_file() and p.name != "r.xml"}
    assert before == after
    return top, done


@pytest.mark.parametrize("index", range(len(BAD)), ids=lambda i: BAD[i][0][:30])
def test_a_bad_table_is_one_line(bad, index):
    _, done = bad
    (line,) = (row for row in done.stderr.splitlines() if f" b{index:02}.toml: " in row)
    assert line.startswith(f"forceaxis: b{index:02}.toml: ")
    assert BAD[index][1] in line


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("signal", "expect.signal: expected a column"),
        ("late", "expect.from_s: expected a time before the end"),
        ("table", "expect: expected a table"),
        ("cut", "line 1, column 9: expected valid TOML"),
        ("binary", "line 1, column 1: expected valid TOML"),
        ("deep", "line 1"),
        ("nomodel", "model: expected"),
    ],
)
def test_a_bad_file_is_one_line(bad, name, words):
    _, done = bad
    (line,) = (row for row in done.stderr.splitlines() if f"other/{name}.toml: " in row)
    assert words in line


def test_bad_files_do_not_keep_the_others_from_running(bad):
    top, done = bad
    assert done.returncode == 2
    wrong = len(BAD) + 7
    assert done.stderr.count("\n") == wrong
    assert re.search(r"^passed +good.toml$", done.stdout, re.M)
    assert done.stdout.endswith(f"1 passed, 0 failed, {wrong} error\n")
    suite = ET.parse(top / "r.xml").find("testsuite")
    assert suite.get("errors") == str(wrong) == str(len(suite.findall("*/error")))


def test_what_is_not_a_test_is_named_or_left_alone(tmp_path):
    here = axes(tmp_path, good=GOOD)
    text = EXPERIMENT.replace("{expect}", "")
    (here / "plain.toml").write_text(text[: text.index("[expect]")])
    (here / "pyproject.toml").write_text('[project]\nname = "x"\n')
    done = forceaxis("test", ".", "--junit", "r.xml", cwd=here)
    assert done.returncode == 0
    assert done.stdout.splitlines()[-2:] == [
        "without [expect]: plain.toml",
        "1 passed, 0 failed, 1 skipped",
    ]
    (case,) = ET.parse(here / "r.xml").findall(".//testcase[skipped]")
    assert case.get("name") == "plain"
    for arguments in (["plain.toml"], [".", "-k", "nosuch"], ["no/such"], [], ["pyproject.toml"]):
        refused = forceaxis("test", *arguments, cwd=here)
        assert (refused.returncode, refused.stdout) == (2, ""), arguments
        assert refused.stderr.count("\n") == 1, refused.stderr
    assert "1 passed" in forceaxis("test", ".", "plain.toml", "-k", "go?d", cwd=here).stdout


def test_update_refuses_what_it_would_have_to_move(tmp_path):
    """tomlkit brings [[at]] tables together; [expect] between them stays as it is."""
    here = axes(tmp_path, inline="", between="")
    text = (here / "inline.toml").read_text()
    rest = text[: text.index("[expect]")] + text[text.index("[plot]") :]
    at = "[[at]]\ntime_s = {}\nfirmware = {{ force_gain = 2.0 }}\n"
    between = re.sub("^at = .*$", "", rest, flags=re.M)
    between += at.format(1) + "[expect]\nfinal_value = 7\n" + at.format(2)
    for name, content in (("inline", "expect = {}\n" + rest), ("between", between)):
        file = here / f"{name}.toml"
        file.write_text(content)
        done = forceaxis("test", file, "--update")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert (
            f"{name}.toml: expect: expected a table [expect] whose values can be replaced"
            in done.stderr
        )
        assert file.read_text() == content


def test_a_run_that_cannot_go_on_is_a_failure(tmp_path, monkeypatch):
    def stop(file):
        raise SimulationError("contact: chatters at 0.1 s")

    monkeypatch.setattr(expectations, "examine", stop)
    here = axes(tmp_path, axis=GOOD)
    (outcome,) = regression.run([here])
    assert regression.status([outcome]) == 1
    regression.write_junit([outcome], here / "r.xml")
    message = ET.parse(here / "r.xml").find(".//failure").get("message")
    assert message == "contact: chatters at 0.1 s"


# pytest in a user's repository.


def user_pytest(folder, *arguments):
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments],
        cwd=folder, capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip


FIXTURE = """
import pytest

def test_axis(forceaxis_experiment):
    forceaxis_experiment("axes/good.toml").check()

def test_wrong(forceaxis_experiment):
    forceaxis_experiment("axes/wrong.toml").check()

def test_override(forceaxis_experiment):
    done = forceaxis_experiment("axes/good.toml", "experiment.duration_s=1")
    assert len(done.run.columns["slider.position"]) == 1501
    assert done.measured.values["final_value"] < 0.5
    with pytest.raises(AssertionError, match="final_value"):
        done.check()
"""


def test_the_pytest_fixture(tmp_path):
    axes(tmp_path / "axes", good=GOOD, wrong="final_value = 7")
    (tmp_path / "test_axes.py").write_text(FIXTURE)
    done = user_pytest(tmp_path)
    assert "1 failed, 2 passed" in done.stdout, done.stdout
    assert re.search(
        r"^E .*final_value: expected 7 \+-0.07, got 0.5 \(6.5 m below, 92.9%\)$", done.stdout, re.M
    )
    assert "expect.py" not in done.stdout


@pytest.mark.parametrize("testpaths", ["", 'testpaths = ["tests"]\n'])
def test_pytest_collects_experiments_when_asked(tmp_path, testpaths):
    axes(tmp_path / "axes", good=GOOD, wrong="final_value = 7", bad="final_value = true")
    text = EXPERIMENT.replace("{expect}", "")
    (tmp_path / "axes/plain.toml").write_text(text[: text.index("[expect]")])
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests/test_one.py").write_text("def test_one(): pass\n")
    settings = tmp_path / "pyproject.toml"
    settings.write_text("[tool.pytest.ini_options]\n" + testpaths)
    assert "1 passed" in user_pytest(tmp_path).stdout
    settings.write_text(settings.read_text() + 'forceaxis_experiments = ["axes"]\n')
    done = user_pytest(tmp_path)
    assert "2 failed, 2 passed" in done.stdout, done.stdout
    assert "final_value: expected 7 +-0.07, got 0.5" in done.stdout
    assert "expect.final_value: expected a number" in done.stdout
    assert "Traceback" not in done.stdout


def test_pytest_help_names_both(tmp_path):
    words = user_pytest(tmp_path, "--help").stdout
    assert "forceaxis_experiments" in words
    assert "forceaxis_experiment(" in words


def test_the_ci_example_does_what_it_says(tmp_path):
    job = yaml.safe_load((ROOT / "docs/files/ci-example.yml").read_text())["jobs"]["axes"]
    (command,) = (s["run"] for s in job["steps"] if "forceaxis test" in s.get("run", ""))
    program, *arguments = shlex.split(command)
    assert program == "forceaxis"
    axes(tmp_path / "axes", good=GOOD, wrong="final_value = 7")
    assert forceaxis(*arguments, cwd=tmp_path).returncode == 1
    (kept,) = (s["with"]["path"].split() for s in job["steps"] if "path" in s.get("with", {}))
    assert all((tmp_path / p).exists() for p in kept)
    assert (tmp_path / "differences/wrong.png").exists()
    (tmp_path / "axes/wrong.toml").unlink()
    assert forceaxis(*arguments, cwd=tmp_path).returncode == 0


# CMake's dependencies and their sources: a package of apt, or pip and the job itself.
BROUGHT_BY = {
    "CLI11": "libcli11-dev",
    "Eigen3": "libeigen3-dev",
    "lcm": "liblcm-dev",
    "lcm-gen": "liblcm-bin",
    "modbus": "libmodbus-dev",
    "toml++/toml.h": "libtomlplusplus-dev",
    "Threads": "build-essential",
    "Python": None,
    "pybind11": None,
}


def test_the_ci_example_installs_what_the_wheel_is_built_from():
    job = yaml.safe_load((ROOT / "docs/files/ci-example.yml").read_text())["jobs"]["axes"]
    (install,) = (s["run"] for s in job["steps"] if "apt-get install" in s.get("run", ""))
    (command,) = re.findall(r"apt-get install -y (.*)", install.replace("\\\n", " "))
    needed = set()
    for part in ("firmware", "sim", "host"):
        for file in (ROOT / part).rglob("CMakeLists.txt"):
            text = file.read_text()
            assert "pkg_check_modules" not in text
            needed |= set(re.findall(r"\bfind_package\(\s*([^\s)]+)", text))
            # Of the others the second word is what is looked for.
            needed |= set(
                re.findall(r"\bfind_(?:file|library|path|program)\(\s*\S+\s+([^\s)]+)", text)
            )
    assert {"Eigen3", "lcm", "lcm-gen", "modbus"} <= needed
    assert needed <= set(BROUGHT_BY), "a package that BROUGHT_BY does not know"
    tools = {"build-essential", "cmake", "ninja-build"}
    assert set(command.split()) == tools | {BROUGHT_BY[name] for name in needed} - {None}
    setup = (ROOT / "tools/setup").read_text().split()
    for package in command.split():
        assert package in setup or f"packages=({package}" in setup, package
