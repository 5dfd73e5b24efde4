"""What a person sees of a run and a sweep: words, colours, figures, files."""

import csv
import errno
import os
import pty
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import verbs
from forceaxis import _core, objects, paths
from forceaxis.cli import sweep_text
from forceaxis.experiments import isolated, plots, sweep_plots, sweep_result, trace
from forceaxis.experiments import run as runs
from forceaxis.experiments import summary as summary_of
from forceaxis.experiments import sweep as sweeps
from forceaxis.experiments.points import SweepParameter

ROOT = Path(__file__).resolve().parents[3]
EXPERIMENTS = ROOT / "sim/experiments"
FORCEAXIS = Path(sys.executable).parent / "forceaxis"
BARE = r"\bcounts?\b(?! (of the (force|encoder)|of force))(?<!encoder count)(?<!encoder counts)"


@pytest.fixture(scope="module")
def lively():
    """A contact at a gain at which it is lost, with an override and a window inside the plot."""
    sets = ["firmware.force_gain=12", "experiment.duration_s=2", "verdict.window_s=0.5"]
    return runs.run(EXPERIMENTS / "contact.toml", sets)


@pytest.mark.parametrize("name", ["contact", "contact_unstable", "press_hold_retract", "homing"])
def test_no_count_is_said_without_of_what(name):
    done = runs.run(EXPERIMENTS / f"{name}.toml")
    text = "\n".join(value for key, value in summary_of.rows(done.result) if key != "experiment")
    assert not re.search(BARE, text), text


def test_a_verdict_says_why_in_newton_and_over_which_window(lively):
    """A count of the force reading is 2.5 N in this model, ten of them are allowed."""
    stable = runs.run(EXPERIMENTS / "contact.toml").result
    count = stable.metrics.force_ripple_count
    assert summary_of.verdict_text(stable) == (
        f"stable: contact held, force ripple {2.5 * count:.3g} N of 25 N allowed ({count:.3g} of "
        "10 counts of the force reading at 8 bits), over the last 1 s"
    )
    metrics = lively.summary["metrics"]
    text = summary_of.verdict_text(lively.result)
    assert text.startswith(f"unstable: contact lost {metrics['contact_losses']} times")
    assert f"{2.5 * metrics['force_ripple_count']:.3g} N above the 25 N allowed" in text
    assert text.endswith(", over the last 0.5 s")


def test_twelve_bits_have_the_same_size_of_count():
    """4096 codes over the range of 256: a count at 8 bits is sixteen codes."""
    converters = runs.run(EXPERIMENTS / "hold_biquad_12bit.toml").result.converters
    assert converters["adc0"].bits == 12
    size, unit = summary_of.size_of_count("force", converters)
    assert (size, unit) == (pytest.approx(16 * abs(converters["adc0"].per_code)), "N")


def test_every_unit_of_counts_and_codes_says_of_what():
    words = {o.name: objects.unit_in_words(o) for o in objects.OBJECTS}
    assert words["force_setpoint"] == "count of force"
    assert words["target_position"] == "encoder count"
    assert words["force_gain"] == "DAC code/count of force"
    assert words["position_gain"] == "DAC code/encoder count"
    assert words["velocity_actual"] == "encoder count/s"
    for name, unit in words.items():
        assert not re.search(BARE, unit), (name, unit)
        assert not re.search(r"(?<![DA][A-Z]C )\bcode", unit), (name, unit)


def texts_of(figure):
    return [text.get_text() for text in figure.texts]


def test_the_plot_shows_setpoint_contact_window_events_and_overrides(lively):
    figure = trace.figure(lively)
    assert figure._suptitle.get_text() == "Fig 3.14: Contact at k_f = 5, f_d = 30"
    assert any("with firmware.force_gain=12" in text for text in texts_of(figure))
    keys = [text.get_text() for text in figure.legends[0].get_texts()]
    lost = sum(e[1] == "sensor" and e[2] == "pressed" and 0.1 <= e[0] <= 2 for e in lively.events)
    assert keys[:3] == ["set-point", "contact", "verdict: unstable"]
    assert f"contact lost ({lost})" in keys
    position, reading, _ = figure.axes
    assert position.get_ylabel() == "position (encoder)\nmm"
    assert reading.get_ylabel() == "force (adc0)\nN"
    # 2.5 N a count, 30 counts asked for; the encoder's scale is 157,480 counts a metre.
    assert 75 in np.concatenate([line.get_ydata() for line in reading.lines])
    shown = lively.columns["time_s"] >= 0.1
    assert reading.lines[0].get_ydata() == pytest.approx(2.5 * lively.columns["adc0"][shown])
    per_m = lively.columns["encoder"][shown][0] / position.lines[0].get_ydata()[0] * 1e3
    assert per_m == pytest.approx(157480, rel=1e-4)


def test_raw_codes_on_demand(lively):
    figure = trace.figure(lively, codes=True)
    assert [ax.get_ylabel() for ax in figure.axes[:2]] == [
        "encoder\nencoder count",
        "adc0\nADC code",
    ]
    shown = lively.columns["time_s"] >= 0.1
    assert figure.axes[1].lines[0].get_ydata().tolist() == lively.columns["adc0"][shown].tolist()


def test_marks_are_where_the_run_has_them(lively):
    marks = trace.marks_of(lively)
    force, time_s = lively.columns["sensor.force"], lively.columns["time_s"]
    inside = np.zeros(len(time_s), bool)
    for begin, end in marks.contacts:
        inside |= (time_s >= begin) & (time_s < end)
    assert (inside[:-1] == (force > 0)[:-1]).all()
    assert marks.window == (1.5, 2.0, "unstable")
    assert marks.setpoints == [(0.0, 75.0)]
    struck = trace.marks_of(runs.run(EXPERIMENTS / "strike_biquad.toml"))
    assert (2.0, "impulse", "impulse 2.8 N s") in struck.events
    assert struck.setpoints == [(0.0, 0.0), (0.03, 75.0)]
    frozen = trace.marks_of(runs.run(EXPERIMENTS / "hold_biquad.toml", ["firmware.force_max=5"]))
    faults = [e for e in frozen.events if e[1] == "fault"]
    assert [text for *_, text in faults] == ["fault force_max"]


def test_a_plot_without_converters_or_verdict_has_no_marks(lively):
    figure = plots.trace(np.arange(3) / 10, [[plots.Line("x", "", np.arange(3))]], "t")
    assert not figure.legends and texts_of(figure) == ["t"]


def test_files_are_written_all_or_none(lively, tmp_path, monkeypatch):
    trace.write(lively, tmp_path / "whole")
    assert {p.name for p in (tmp_path / "whole").iterdir()} == set(trace.FILES)
    assert "<svg" in (tmp_path / "whole/plot.svg").read_text()

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(trace.json, "dumps", interrupted)
    before = (tmp_path / "whole/trace.csv").stat().st_mtime_ns
    for name in ("none", "whole"):
        with pytest.raises(KeyboardInterrupt):
            trace.write(lively, tmp_path / name)
    assert not (tmp_path / "none").exists()
    assert {p.name for p in (tmp_path / "whole").iterdir()} == set(trace.FILES)
    assert (tmp_path / "whole/trace.csv").stat().st_mtime_ns == before


def test_files_are_none_where_one_cannot_be_replaced(tmp_path):
    (tmp_path / "b").mkdir()
    with pytest.raises(IsADirectoryError), paths.replacing(tmp_path, "a", "b"):
        raise AssertionError("refused before anything is written")
    assert [p.name for p in tmp_path.iterdir()] == ["b"]


def printed(words, **environment):
    """What a command prints on a terminal of 60 columns."""
    reader, terminal = pty.openpty()
    process = subprocess.Popen(
        [FORCEAXIS, *words], stdout=terminal, stderr=subprocess.DEVNULL,
        env=os.environ | {"COLUMNS": "60"} | environment,
    )  # fmt: skip
    os.close(terminal)
    text = b""
    try:
        while piece := os.read(reader, 65536):
            text += piece
    except OSError:  # the terminal's other end is closed
        pass
    os.close(reader)
    assert process.wait() == 0
    return text.decode().replace("\r\n", "\n")


@pytest.mark.parametrize(
    "line",
    [
        "loop poles contact --law p --timing zoh",
        "loop advise fig4_11 --linear",
        "loop limit contact",
        "loop modes fig4_19",
        "objects force_tare",
        "loop limit hold_biquad --law bank",
        "axis stop --on sim:contact",
        "axis check --on sim:contact --set firmware.position_gain=4 --yes",
        "measure --on sim:contact --set firmware.position_gain=4 --free",
    ],
)
def test_tables_fit_80_columns(line):
    text = printed(line.split(), COLUMNS="80")
    assert max(map(len, re.sub(r"\x1b\[[0-9;]*m", "", text).splitlines())) <= 80


def test_colour_and_width_on_a_terminal_none_in_a_pipe():
    words = ["run", EXPERIMENTS / "contact.toml", "--set", "experiment.duration_s=1.5"]
    coloured = printed(words)
    assert "verdict      \x1b[32m\x1b[1mstable\x1b[0m: contact held" in coloured
    plain = printed(words, NO_COLOR="1")
    assert "\x1b" not in plain and "verdict      stable: " in plain
    wide = [line for line in plain.splitlines() if len(line) > 60]
    assert [line.split()[0] for line in wide] in (["trace", "again"], ["trace"])
    piped = verbs.forceaxis(*words).stdout
    verdict = next(line for line in piped.splitlines() if line.startswith("verdict"))
    assert "\x1b" not in piped and len(verdict) > 100


# Cells that stand alone.


def grid(*rows):
    """(axes, verdicts) of a map drawn as text: S, U, or . for one that failed."""
    axes = [
        SweepParameter("y", 0, 1, values=tuple(float(i) for i in range(len(rows)))),
        SweepParameter("x", 0, 1, values=tuple(float(i) for i in range(len(rows[0])))),
    ]
    kinds = {"S": "stable", "U": "unstable", ".": ""}
    return axes, np.array([kinds[c] for c in "".join(rows)])


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        (("UUU", "USU", "UUU"), [4]),
        (("UUU", "USU", "UUS"), []),  # it has company, on the diagonal
        (("SUU", "UUU", "UUU"), [0]),
        (("SSU", "SUU", "UUU"), []),  # a staircase
        (("...", ".S.", "..."), []),  # nothing to compare it with
        (("SSSS", "SSUS", "SSSS"), [6]),
        (("UUU", "U.U", "UUU"), []),
    ],
)
def test_a_cell_that_stands_alone(rows, found):
    assert isolated.find(*grid(*rows)) == found


def test_the_order_of_given_values_does_not_matter():
    axes = [SweepParameter("x", 1, 5, values=(5.0, 1.0, 3.0, 2.0, 4.0))]
    verdict = np.array(["unstable", "stable", "unstable", "stable", "unstable"])
    assert isolated.find(axes, verdict) == []
    verdict = np.array(["unstable", "unstable", "stable", "unstable", "unstable"])
    assert isolated.find(axes, verdict) == [2]
    assert isolated.around(axes, (3.0,)) == [(2.5,), (3.5,)]


def test_around_a_corner_and_on_a_logarithmic_axis():
    axes = [
        SweepParameter("x", 1, 100, True, (1.0, 10.0, 100.0)),
        SweepParameter("y", 0, 2, values=(0.0, 1.0, 2.0)),
    ]
    near = isolated.around(axes, (1.0, 2.0))
    assert near == [(1.0, 1.5), (pytest.approx(10**0.5), 2.0), (pytest.approx(10**0.5), 1.5)]


def test_a_map_marks_them_and_refine_looks_closer(tmp_path, monkeypatch):
    """One made-up island: 3 x 3 runs of which only the middle one is stable."""

    def judged(jobs, _threads, progress, _going, finished, _experiments=None):
        for i, (_, sets) in enumerate(jobs):
            values = dict(text.split("=") for text in sets)
            gain, wanted = (float(values[f"firmware.force_{n}"]) for n in ("gain", "setpoint"))
            metrics = SimpleNamespace(**dict.fromkeys(sweep_result.METRICS, 1.0))
            verdict = "stable" if (gain, abs(wanted - 20) <= 5) == (4.0, True) else "unstable"
            finished(i, {"verdict": verdict, "fault": "none", "metrics": metrics,
                         "edge_margin": 0.1, "trace_hash": "0"})  # fmt: skip
        progress(len(jobs), len(jobs))

    monkeypatch.setattr(_core, "run_many", judged)
    grid = {"firmware.force_gain": "2:6:3", "firmware.force_setpoint": "10:30:3"}
    given = sweeps.SweepRequest(EXPERIMENTS / "contact.toml", grid)
    done = sweeps.sweep(given)
    (one,) = done.summary["alone"]
    assert one == {"firmware.force_gain": 4.0, "firmware.force_setpoint": 20.0,
                   "verdict": "stable", "around": None, "alike": None}  # fmt: skip
    line = dict(sweep_text.rows(done))["alone"]
    assert line.endswith("stable, its neighbours are not; --refine looks closer")

    done = sweeps.sweep(replace(given, refine=True), out=tmp_path)
    (one,) = done.summary["alone"]
    assert (one["around"], one["alike"]) == (8, 2)  # at set-points 15 and 25
    assert len(done.columns["verdict"]) == 9  # the grid stays a grid
    assert len((tmp_path / "closer.csv").read_text().splitlines()) == 9
    assert "--refine" in done.summary["command"]
    assert "around it" in dict(sweep_text.rows(done))["alone"]
    grid["firmware.force_setpoint"] = "26:30:2"
    even = sweeps.sweep(replace(given, refine=True))
    assert dict(sweep_text.rows(even))["alone"] == "no point: nothing to look closer at"
    figure = sweep_plots.sweep(done)
    assert "stands alone" in [t.get_text() for t in figure.legends[0].get_texts()]
    (newton,) = figure.axes[0].child_axes
    assert newton.get_ylabel() == "set-point, N"
    figure.canvas.draw()
    low, high = figure.axes[0].get_ylim()
    assert newton.get_ylim() == pytest.approx((2.5 * low, 2.5 * high))


@pytest.mark.parametrize(
    "arguments",
    [
        ["--random", "b_w=1:2", "--count", "3"],
        ["--bisect", "firmware.force_gain=3:20:0.5"],
        ["--grid", "b_w=1:2:2", "--grid", "k_w=1e5:2e5:2", "--grid", "m_w=5:6:2"],
    ],
)
def test_refine_needs_a_grid_that_can_be_drawn(arguments, tmp_path):
    out = tmp_path / "out"
    done = verbs.forceaxis(
        "sweep", EXPERIMENTS / "contact.toml", *arguments, "--refine", "--out", out
    )
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "--refine: expected a --grid of one or two parameters" in done.stderr
    assert not out.exists()


def full(*_):
    raise OSError(errno.ENOSPC, "full")


def test_tables_that_cannot_be_written_leave_no_file_of_the_run(lively, tmp_path, monkeypatch):
    monkeypatch.setattr(trace, "write_tables", full)
    with pytest.raises(OSError) as raised:
        trace.write(lively, tmp_path / "out")
    assert raised.value.errno == errno.ENOSPC
    assert not [p for p in (tmp_path / "out").rglob("*") if p.is_file()]


def test_the_tables_are_the_trace_to_the_last_digit(lively, tmp_path):
    trace.write(lively, tmp_path)
    with (tmp_path / "trace.csv").open() as file:
        names, *rows = csv.reader(file)
    assert names == list(lively.columns) and len(rows) == len(lively.columns["tick"])
    for name, column in zip(names, zip(*rows, strict=True), strict=True):
        assert np.array_equal(np.array(column, float), lively.columns[name]), name
