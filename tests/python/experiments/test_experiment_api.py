"""`from forceaxis import Experiment, Axis`: what scripts and notebooks use."""

import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import forceaxis
import numpy as np
import pytest
from forceaxis import Axis, Experiment, InputError, Result, paths, toml

ROOT = Path(__file__).resolve().parents[3]
CONTACT = paths.EXPERIMENTS / "contact.toml"


@pytest.fixture(scope="module")
def contact():
    return Experiment.load(CONTACT)


@pytest.fixture(scope="module")
def result(contact):
    return contact.run(duration_s=1.5)


def test_keywords_are_what_set_says(contact):
    from forceaxis.experiments.run import run

    texts = ["firmware.force_gain=7.0", "firmware.force_setpoint=75 N", "experiment.duration_s=1"]
    wanted = run(CONTACT, texts).summary["trace_hash"]
    given = contact.run(force_gain=np.float64(7), force_setpoint="75 N", duration_s=np.int64(1))
    assert given.trace_hash == wanted
    named = dict(text.split("=") for text in texts)
    assert contact.run(named).trace_hash == wanted
    both = contact.run({"firmware.force_gain": 7}, force_setpoint="75 N", duration_s=1)
    assert both.trace_hash == wanted
    assert contact.run(force_gain=6, duration_s=1).trace_hash != wanted


def test_a_parameter_of_the_model(contact):
    assert contact.parameters["k_w"][1] == "N/m"
    soft = contact.run(k_w=np.float32(50e3), duration_s=1)
    assert soft.trace_hash == contact.run({"k_w": "50 kN/m"}, duration_s=1).trace_hash
    assert soft.trace_hash != contact.run(duration_s=1).trace_hash


@pytest.mark.parametrize(
    ("given", "values", "says"),
    [
        (
            {},
            {"force_gian": 1, "laws": 2, "durations": 3},
            "force_gian: expected an object, a parameter, duration_s or seed, got force_gian, "
            "laws, durations; did you mean force_gain, duration_s\\?; remove or rename these keys",
        ),
        (
            {"firmware.force_gain": 1},
            {"force_gain": 2},
            "force_gain: expected one value of this parameter, got one as a keyword",
        ),
        ({}, {"force_gain": [1, 2]}, "force_gain: expected a number or a text with a unit, got"),
        ({}, {"force_gain": None}, "force_gain: expected a number or a text with a unit, got None"),
        ({}, {"force_setpoint": "75 kg"}, "force_setpoint: expected a force in N, got"),
    ],
)
def test_wrong_values_are_one_line(contact, given, values, says):
    with pytest.raises(InputError, match=says) as error:
        contact.run(given, **values)
    assert "\n" not in str(error.value)


def test_from_memory_is_the_same_run(contact, monkeypatch):
    text = CONTACT.read_text(encoding="utf-8")
    wanted = contact.run(duration_s=1).trace_hash
    of_text = Experiment(text, folder=CONTACT.parent)
    assert of_text.run(duration_s=1).trace_hash == wanted
    tables = tomllib.loads(text)
    tables["firmware"]["force_gain"] = np.float64(tables["firmware"]["force_gain"])
    of_tables = Experiment(tables, folder=CONTACT.parent)
    assert of_tables.run(duration_s=1).trace_hash == wanted
    assert repr(of_tables) == f"<Experiment {tables['title']!r}, (in memory)>"
    monkeypatch.chdir(CONTACT.parent)
    assert Experiment(tables).run(duration_s=1).trace_hash == wanted


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("title = ", r"\(in memory\): line 1, column 9: expected valid TOML"),
        (
            {"title": "t"},
            r"\(in memory\): model: expected a text in quotes, got nothing; add",
        ),
        (
            {"title": {1, 2}},
            r"\(in memory\): expected only tables, texts and numbers in the .*, got \{1, 2\}",
        ),
        ({"titel": "t", "modle": "m"}, "did you mean model, title\\?"),
    ],
)
def test_a_wrong_text_is_one_line(source, says):
    with pytest.raises(InputError, match=says):
        Experiment(source)


def test_by_name_and_what_is_not_there():
    assert Experiment.load("contact").title == Experiment.load(CONTACT).title
    with pytest.raises(InputError, match=r"contcat\.toml: file: expected a readable file"):
        Experiment.load("contcat")


def test_result(result):
    assert isinstance(result, Result) and result.verdict in ("stable", "unstable")
    text = repr(result)
    assert text.startswith(f"<Result of {result.title!r}: {result.verdict}")
    assert f"held {result.held_force_N:.4g} N of {result.setpoint_N:.4g} N" in text
    assert str(result).startswith("experiment") and "trace hash" in str(result)
    assert result.stable == (result.verdict == "stable") and result.fault == "none"


def test_arrays_have_units(result):
    assert result.time_s.shape == result["force"].shape == result["adc0"].shape == (2251,)
    assert {n: result.units[n] for n in ("force", "position", "command", "sensor.force")} == {
        "force": "N", "position": "m", "command": "V", "sensor.force": "N",
    }  # fmt: skip
    # A reading is the true force within a count and what the tick between them moves.
    per_count = result.summary["converters"]["adc0"]["per_code"]
    late = slice(-300, None)
    assert np.abs(result["force"] - result["sensor.force"])[late].max() < 1.5 * abs(per_count)
    assert set(result) >= {"force", "encoder"} and "force" in result and "forse" not in result
    with pytest.raises(KeyError, match="forse: expected one of time_s, "):
        result["forse"]


def test_events_are_named(result):
    touch = next(e for e in result.events if e.element == "sensor")
    assert (touch.before, touch.after) == ("apart", "pressed") and 0 < touch.time_s < 1.5


def test_an_axis_that_controls_no_force_has_none_held():
    free = Experiment.load("homing").run()
    assert free.held_force_N is free.settling_s is free.setpoint_N is None
    assert "held" not in repr(free)


def test_plot(result, tmp_path):
    drawn = result.plot(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    result.plot(tmp_path / "a.svg")
    assert "<svg" in (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert drawn.get_axes() and len(list(tmp_path.iterdir())) == 2


def test_a_simulated_axis_in_one_line():
    with Axis.sim("sim/experiments/session.toml") as axis:
        axis.set(force_gain=np.float64(5.0))
        assert axis.read("force_gain") == 5.0


def test_numpy_values_in_a_design():
    from forceaxis.design.advise import Design

    with Design("laboratory", {"k_w": np.float64(3e5)}) as design:
        assert design.overrides == {"k_w": 3e5}


@pytest.mark.parametrize(
    "table",
    [
        {"a": 1, "b": -0.5, "c": True, "d": 'quote " and \\ and é\n', "e": [1, [2.5], {}]},
        {"t": {"u": {"v w": [{"x": 1e-9}, {"x": 1e300}]}}, "n": np.arange(3), "f": np.float32(0.5)},
    ],
)
def test_tables_are_written_as_they_are_read(table):
    read = toml.read_text(toml.write_text(table))
    assert read == tomllib.loads(toml.write_text(table))
    assert read == {k: v.tolist() if hasattr(v, "tolist") else v for k, v in table.items()}


def test_import_loads_nothing():
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys, forceaxis; print(*{'numpy', 'forceaxis._core'} & set(sys.modules));"
            "print(sorted(set(forceaxis.__all__) - set(dir(forceaxis))));"
            "[getattr(forceaxis, name) for name in forceaxis.__all__]",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("\n[]\n", "")
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        forceaxis.nothing  # noqa: B018


def test_the_example(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["experiment.py", str(tmp_path)])
    runpy.run_path(str(ROOT / "examples/experiment.py"), run_name="__main__")
    said = capsys.readouterr().out
    assert "<Result of 'Fig 3.14" in said and "<Result of 'A harder workpiece': " in said
    assert (tmp_path / "contact.png").exists()
