"""The command line: results, files, exit statuses, one-line refusals."""

import csv
import hashlib
import importlib
import json
import os
import re
import shlex
import signal
import struct
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import numpy as np
import pytest
import verbs
from click.shell_completion import BashComplete
from forceaxis import objects
from forceaxis.cli import main, moved

ROOT = Path(__file__).resolve().parents[3]
CONTACT = "sim/experiments/contact.toml"
FORCEAXIS = Path(sys.executable).parent / "forceaxis"


def forceaxis(*arguments):
    return verbs.forceaxis(*arguments, cwd=ROOT)


@pytest.mark.parametrize("arguments", [["objects", "force", "--json"], ["run", "nowhere.toml"]])
def test_the_program_is_what_the_tests_call(arguments):
    """The other tests call the verbs in their own process."""
    words = [FORCEAXIS, *arguments]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    called = forceaxis(*arguments)
    assert (done.returncode, done.stdout, done.stderr) == (
        called.returncode, called.stdout, called.stderr,
    )  # fmt: skip
    assert done.returncode == (2 if "run" in arguments else 0)


def test_version_tells_apart_what_has_a_version_of_its_own():
    lines = dict(re.split(r" {2,}", line) for line in forceaxis("--version").stdout.splitlines())
    header = (ROOT / "firmware/app/fw.h").read_text()
    assert lines["firmware"] == re.search(r'FW_VERSION "(.*)"', header).group(1)
    assert lines["object table"] == objects.OBJECTS_HASH[:8]
    assert lines["parameter set"] == "FAS2"
    assert lines["models and experiments"] == lines["axis journal"] == "1"
    assert set(lines) == {
        "forceaxis", "firmware", "object table", "LCM types", "models and experiments",
        "parameter set", "axis journal",
    }  # fmt: skip


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    out = tmp_path_factory.mktemp("run")
    done = forceaxis(
        "run", CONTACT, "--set", "firmware.force_gain=7", "--set", "firmware.force_setpoint=20",
        "--out", out, "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), out


def test_run_reports_what_identifies_it(shown):
    result, _ = shown
    assert result["verdict"] in ("stable", "unstable")
    assert len(result["trace_hash"]) == 64
    assert 0 <= result["edge_margin"] <= 0.5
    assert result["events"] > 0
    assert abs(result["energy"]["residual_J"]) <= 1e-9 * result["energy"]["supplied_J"]
    for key in ("inputs_hash", "firmware_hash", "objects_hash"):
        assert len(result[key]) == 64


def test_the_command_that_it_prints_reproduces_it(shown):
    result, _ = shown
    again = forceaxis(*result["command"].split()[1:], "--json")
    assert json.loads(again.stdout)["trace_hash"] == result["trace_hash"]


def test_csv_and_npz_hold_the_same_trace(shown):
    _, out = shown
    trace = np.load(out / "trace.npz")
    with (out / "trace.csv").open() as file:
        rows = list(csv.reader(file))
    assert set(rows[0]) == set(trace.files)
    assert len(rows) - 1 == len(trace["tick"]) == 9001
    for name in ("dac", "adc0", "sensor.force", "robot.position"):
        column = rows[0].index(name)
        assert [float(r[column]) for r in rows[1:]] == trace[name].tolist()


def test_the_trace_hash_is_the_documented_one(shown):
    """SHA-256 over {tick u32, enc i32, adc0 u16, adc1 u16, din u8, dac i16, out u8}."""
    result, out = shown
    t = np.load(out / "trace.npz")
    names = ("tick", "encoder", "adc0", "adc1", "din", "dac", "out")
    packed = b"".join(
        struct.pack("<IiHHBhB", *row) for row in zip(*(t[n].tolist() for n in names), strict=True)
    )
    assert hashlib.sha256(packed).hexdigest() == result["trace_hash"]


def test_json_prints_nothing_else(shown):
    short = ["--set", "experiment.duration_s=0.1", "--set", "verdict.window_s=0.1"]
    done = forceaxis("run", CONTACT, *short, "--json")
    assert done.stderr == ""
    assert done.stdout.count("\n") == 1
    json.loads(done.stdout)


MODEL = """
[parameters]
m = {{ value = {mass}, unit = "{unit}" }}
[[body]]
name = "robot"
mass = "m"
[[spring]]
name = "k"
between = ["robot", "{end}"]
stiffness = {stiffness}
{more}
"""
EXPERIMENT = 'title = "t"\nmodel = "model.toml"\nduration_s = 0.1\n'
GOOD = {"mass": "1.0", "unit": "kg", "end": "ground", "stiffness": "100.0", "more": ""}
LONELY = '[[body]]\nname = "lonely"\nmass = 1.0'


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"more": "stifness = 3"}, "stifness"),
        ({"unit": "N/m"}, "parameters.m"),
        ({"unit": "stone"}, "parameters.m"),
        ({"mass": "-1.0"}, "m"),
        ({"mass": "nan"}, "m"),
        ({"end": "wall"}, "between"),
        ({"stiffness": "inf"}, "stiffness"),
        ({"stiffness": "-3.0"}, "stiffness"),
        ({"more": LONELY}, "body[1]"),
        ({"more": "[spring"}, "line"),
    ],
)
def test_a_bad_model_is_one_line_and_status_2(tmp_path, change, key):
    (tmp_path / "model.toml").write_text(MODEL.format(**(GOOD | change)))
    (tmp_path / "e.toml").write_text(EXPERIMENT)
    refused(forceaxis("run", tmp_path / "e.toml", "--out", tmp_path / "out"), "model.toml", key)
    assert not (tmp_path / "out").exists()


def test_the_good_model_of_those_cases_is_taken(tmp_path):
    (tmp_path / "model.toml").write_text(MODEL.format(**GOOD))
    (tmp_path / "e.toml").write_text(EXPERIMENT)
    assert forceaxis("run", tmp_path / "e.toml").returncode == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", CONTACT, "--set", "firmware.force_gain=256"], ["firmware.force_gain", "255.99"]),
        (["run", CONTACT, "--set", "firmware.force_gain=nan"], ["firmware.force_gain"]),
        (["run", CONTACT, "--set", "m_w=0"], ["m_w"]),
        (["run", CONTACT, "--set", "nonsense"], ["nonsense", "NAME=VALUE"]),
        (["run", CONTACT, "--set", "m_x=3"], ["m_x"]),
        (["run", "no/such.toml"], ["no/such.toml"]),
        (["run"], ["EXPERIMENT"]),
        (["rnu"], ["rnu"]),
        (["run", CONTACT, "--sett", "x=1"], ["--sett"]),
    ],
)
def test_bad_usage_is_one_line_and_status_2(arguments, words):
    refused(forceaxis(*arguments), *words)


WHOLE_LINES = [
    (
        ["firmware.force_setpoint=12 mm/s"],
        f'{CONTACT}: firmware.force_setpoint: expected a force in N, got "12 mm/s", a velocity; '
        "correct the value or its unit",
    ),
    (
        ["m_w=3.5 lb"],
        f'{CONTACT}: set.m_w: expected a mass in kg, got "3.5 lb", whose unit is not known; '
        "correct the value or its unit",
    ),
    (
        ["m_w=nan"],
        f"{CONTACT}: set.m_w: expected a finite number in kg, got nan; correct the override's "
        "value",
    ),
    (
        ["firmware.force_gain=nan"],
        f"{CONTACT}: firmware.force_gain: expected a number 0 to 255.99609375 code/count, got nan; "
        "choose a value in that range",
    ),
    (
        ["m_w=1", "firmware.force_gain=2", "m_w=3"],
        "--set: m_w: expected one value, got 1 and 3; remove one value",
    ),
    (
        ["firmware.force_gian=2", "firmware.laws=3"],
        f"{CONTACT}: firmware.force_gian: expected the name of a firmware object, got "
        '"force_gian", "laws"; did you mean force_gain?; `forceaxis objects` lists them',
    ),
    (
        ["m_b=1", "k_b=1"],
        f"{CONTACT}: set.k_b: expected parameters that the model or the experiment uses, got k_b, "
        "m_b, which have no effect; remove these parameters",
    ),
    (
        ["verdict.windw_s=1"],
        f"{CONTACT}: verdict.windw_s: expected one of the keys window_s, force_ripple_max_count, "
        "position_ripple_max_count, position_error_max_count, held_force_error_max_N, "
        "held_force_error_max_percent, overshoot_max_percent, settle_max_s, peak_force_max_N, "
        "peak_force_max_percent, "
        'contact_losses_max, saturated_max_s, contact_held, got "windw_s"; did you mean '
        "window_s?; remove or rename this key",
    ),
]


@pytest.mark.parametrize(("sets", "line"), WHOLE_LINES, ids=lambda v: v[0] if v else "")
def test_a_wrong_override_is_this_line(sets, line):
    done = forceaxis("run", CONTACT, *(word for text in sets for word in ("--set", text)))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"forceaxis: {line}\n"


def test_a_quantity_is_the_number_it_stands_for():
    """2.5 N a count, so 75 N is the file's set-point of 30; 4 codes a newton are a gain of 10."""
    wanted = tomllib.loads((ROOT / CONTACT).read_text())
    assert wanted["firmware"]["force_setpoint"] == 30

    def hash_of(*sets):
        words = [word for text in sets for word in ("--set", text)]
        return json.loads(forceaxis("run", CONTACT, *words, "--json").stdout)["trace_hash"]

    assert hash_of("firmware.force_setpoint=75 N") == wanted["expect"]["trace_hash"]
    assert hash_of("experiment.duration_s=500 ms", "verdict.window_s=0.1 s") == hash_of(
        "experiment.duration_s=0.5", "verdict.window_s=0.1"
    )
    assert hash_of("firmware.force_gain=19.53125 mV/N", "m_w=6 kg") == hash_of(
        "firmware.force_gain=10", "m_w=6000 g"
    )


def test_quantities_override_models_in_python(tmp_path):
    from forceaxis import _core, toml

    model = str(ROOT / "sim/models/laboratory.toml")
    number = _core.facts(model, {"m_w": 3.5, "k_w": 250000.0})["parameters"]
    quantity = _core.facts(model, {"m_w": "3500 g", "k_w": "250 N/mm"})["parameters"]
    assert quantity == number
    assert number["m_w"] == (3.5, "kg")
    with pytest.raises(_core.InputError, match="m_w: expected a mass in kg, got"):
        _core.facts(model, {"m_w": "3 N"})
    assert _core.quantity("400 kN/m") == 4e5
    # The reader of TOML returns what Python's own returns, in the order of the file.
    for file in sorted((ROOT / "sim").rglob("*.toml")):
        assert repr(toml.read(file)) == repr(tomllib.loads(file.read_text())), file


def test_every_column_of_a_trace_can_be_plotted(tmp_path):
    """The names that [plot] takes are those that a trace has."""
    (tmp_path / "model.toml").write_text(MODEL.format(**GOOD))
    (tmp_path / "e.toml").write_text(EXPERIMENT)
    assert forceaxis("run", tmp_path / "e.toml", "--out", tmp_path).returncode == 0
    columns = (tmp_path / "trace.csv").read_text().splitlines()[0].split(",")
    (tmp_path / "e.toml").write_text(f"{EXPERIMENT}[plot]\nrows = [{json.dumps(columns)}]\n")
    assert forceaxis("run", tmp_path / "e.toml").returncode == 0


def test_a_truncated_experiment_is_one_line_and_status_2(tmp_path):
    text = (ROOT / CONTACT).read_text()
    (tmp_path / "cut.toml").write_text(text[: text.index("force_gain") + 12])
    refused(forceaxis("run", tmp_path / "cut.toml"), "cut.toml", "line")


PLOTS = ['rows = [["nosuch"]]', "rows = 5", "rows = []", 'from_s = "a"', "to_s = -1", "colour = 1"]


@pytest.mark.parametrize("plot", PLOTS)
def test_a_bad_plot_is_one_line_and_status_2(tmp_path, plot):
    (tmp_path / "model.toml").write_text(MODEL.format(**GOOD))
    (tmp_path / "e.toml").write_text(f"{EXPERIMENT}[plot]\n{plot}\n")
    refused(forceaxis("run", tmp_path / "e.toml", "--out", tmp_path), "e.toml", "plot")


def test_odd_files_are_one_line_and_status_2(tmp_path):
    (tmp_path / "binary.toml").write_bytes(bytes(range(256)))
    (tmp_path / "empty.toml").write_text("")
    for name in ("binary.toml", "empty.toml", ".", "x" * 5000):
        refused(forceaxis("run", tmp_path / name))


def test_a_byte_order_mark_is_harmless(tmp_path):
    (tmp_path / "model.toml").write_text(MODEL.format(**GOOD))
    (tmp_path / "e.toml").write_text("\ufeff" + EXPERIMENT)
    done = forceaxis("run", tmp_path / "e.toml", "--json")
    assert done.returncode == 0, done.stderr
    # Nothing is converted in this model, so nothing came close to an edge.
    assert json.loads(done.stdout)["edge_margin"] is None


def test_a_parameter_that_changes_nothing_is_refused():
    refused(forceaxis("run", CONTACT, "--set", "m_b=1"), "m_b")


def test_a_write_that_the_firmware_refuses_on_the_way_is_reported(tmp_path):
    (tmp_path / "model.toml").write_text(MODEL.format(**GOOD))
    text = '[firmware]\nmode = "open_loop"\n[[at]]\ntime_s = 0.05\nfirmware = { adc_bits = 12 }\n'
    (tmp_path / "e.toml").write_text(EXPERIMENT + text)
    done = forceaxis("run", tmp_path / "e.toml", "--json")
    (row,) = json.loads(done.stdout)["refused"]
    assert (row["tick"], row["object"]) == (75, "adc_bits")


def refused(done, *words):
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr


def test_objects_lists_the_table():
    done = forceaxis("objects", "force_gain", "--json")
    (row,) = json.loads(done.stdout)
    assert row["name"] == "force_gain"
    assert row["scale"] == 1 / 256
    # Objects without a unit show none; values that are no numbers show as text.
    listed = forceaxis("objects", "excitation").stdout
    assert "[0 to 65535]" in listed
    assert "below 750 Hz" in listed and "aliases above 750 Hz" in listed


@pytest.mark.parametrize(
    ("overrides", "verdict", "because"),
    [
        (
            ["firmware.force_gain=0.5", "firmware.force_setpoint=2"],
            "never_in_contact",
            ["never in contact"],
        ),
        (
            ["firmware.force_gain=15", "firmware.force_setpoint=30"],
            "unstable",
            ["contact lost", "force ripple"],
        ),
        ([], "stable", []),
    ],
)
def test_a_verdict_that_is_not_stable_says_why(overrides, verdict, because):
    sets = [word for text in overrides for word in ("--set", text)]
    done = forceaxis("run", "sim/experiments/contact.toml", *sets, "--json")
    result = json.loads(done.stdout)
    assert result["verdict"] == verdict
    assert len(result["because"]) == len(because)
    for reason, expected in zip(result["because"], because, strict=True):
        assert reason.startswith(expected)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["loop", "linearise", CONTACT],
            ["expected a model, got an experiment", "../models/laboratory.toml"],
        ),
        (
            ["loop", "poles", "sim/measurements/fig3_9.toml"],
            ["expected a model", "../models/fig4_5.toml"],
        ),
        (["run", "sim/models/fig4_19.toml"], ["expected an experiment, got a model"]),
        (["run", "sim/measurements/fig3_9.toml"], ["got a measurement", "`forceaxis measure`"]),
        (
            ["measure", CONTACT],
            ["expected the file of a measurement or a model, got an experiment"],
        ),
    ],
)
def test_a_file_of_another_kind_is_named(arguments, words):
    refused(forceaxis(*arguments), arguments[-1], *words)


def test_a_grid_of_too_many_values_names_the_bound(tmp_path):
    for grid in ("b_w=1:2:1000000000", "b_w=1:2:1000001"):
        done = forceaxis("sweep", CONTACT, "--grid", grid, "--out", tmp_path)
        refused(done, grid, "a whole number from 2 to 1000000")
    grids = ["--grid", "b_w=1:2:2000", "--grid", "k_w=1e5:2e5:2000"]
    done = forceaxis("sweep", CONTACT, *grids, "--out", tmp_path)
    refused(done, "at most 1000000 points, got 4000000")


def test_the_help_of_a_fit_says_what_a_csv_file_needs():
    text = " ".join(forceaxis("identify", "fit", "--help").stdout.split())
    for option in ("--output", "--averages", "--dt"):
        line = text.split(f"{option} ", 1)[1].split(" --", 1)[0]
        assert "equired with a CSV file." in line, option


def test_paths_with_blanks_can_be_copied(tmp_path):
    folder = tmp_path / "two words"
    out = folder / "a figure.png"
    folder.mkdir()
    assert f"figure       '{out}'" in forceaxis("loop", "poles", "fig4_19", "--out", out).stdout
    done = forceaxis("run", CONTACT, "--set", "experiment.duration_s=1.5", "--out", folder)
    assert f"files        '{folder}'" in done.stdout
    done = forceaxis("new", folder / "my press", "--yes")
    assert f"next         forceaxis run '{folder}/my press/contact.toml'" in done.stdout


def test_a_link_over_can_without_can_is_refused(monkeypatch, tmp_path):
    """Neither this kernel's CAN nor a guest: one line and the status of wrong input."""
    unshare = tmp_path / "unshare"  # no network namespace, so no vcan of this kernel
    unshare.write_text("#!/bin/sh\nexit 1\n")
    unshare.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setenv("UML", "/no/such/kernel")
    words = [FORCEAXIS, "run", CONTACT, "--link", "socketcan"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "expected a kernel with vcan, or user-mode-linux" in done.stderr


def commands(command, words=()):
    """[(its words, the command)] of every verb and every group."""
    found = [(words, command)] if words else []
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            found += commands(command.get_command(context, name), (*words, name))
    return found


VERBS = commands(main.cli)
EXAMPLES = [
    (words, line)
    for words, verb in VERBS
    for line in (verb.epilog or "").replace("\\\n", "").splitlines()
]


@pytest.mark.parametrize(("words", "verb"), VERBS, ids=lambda v: str(v))
def test_every_verb_has_examples_and_a_sentence(words, verb):
    if words == ("gateway",):  # becomes that program, so it needs a process
        call = [Path(sys.executable).parent / "forceaxis", *words, "--help"]
        text = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    else:
        text = forceaxis(*words, "--help").stdout
    assert any(f"forceaxis {' '.join(words)}" in line for w, line in EXAMPLES if w == words)
    assert text.startswith(f"Usage: forceaxis {' '.join(words)} [OPTIONS]")
    about, example, _ = text.partition("\nExample")
    assert example and max(map(len, about.splitlines())) <= 80
    assert verb.get_short_help_str(200).rstrip(".")


@pytest.mark.parametrize(("words", "line"), EXAMPLES, ids=lambda v: str(v))
def test_examples_can_be_typed(words, line):
    """Each is taken by the parser of its verb; that they work is for the guide's test."""
    for part in re.split(r"&&|&|>|\|", line.strip()):
        typed = shlex.split(part, comments=True)
        if typed[:1] == ["forceaxis"] and typed[-1] == "--help":
            continue
        if typed[:1] != ["forceaxis"]:
            assert typed == [] or typed[0] in ("axis_node", "plant_node", "xdg-open", "axis3.toml")
            continue
        verb, rest = main.cli, typed[1:]
        context = click.Context(verb, info_name="forceaxis")
        while isinstance(verb, click.Group):
            _, verb, rest = verb.resolve_command(context, rest)
            context = click.Context(verb, parent=context, info_name=verb.name)
        try:
            verb.make_context(verb.name, list(rest), parent=context.parent)
        except click.UsageError as error:  # files of an example need not be there
            assert "does not exist" in error.format_message(), line


def test_each_command_of_the_first_page_is_in_the_module_that_is_stated():
    """A command loads when it is used, so a list says where it is."""
    stated = {}
    for word in main.WORDS:
        stated.setdefault(main.MODULES.get(word, (word,))[0], set()).add(word)
    holders = {
        path.stem: {
            verb.name for verb in importlib.import_module(f"forceaxis.cli.{path.stem}").VERBS
        }
        for path in (ROOT / "host/python/forceaxis/cli").glob("*.py")
        if re.search(r"^VERBS = ", path.read_text(), re.M)
    }
    assert holders == stated
    assert main.MODULES.keys() <= {*main.WORDS}


def test_each_module_of_a_group_adds_commands_to_it():
    for word, names in main.MODULES.items():
        verb = main.cli.get_command(click.Context(main.cli), word)
        for name in names[1:]:
            of = {command.callback.__module__ for _, command in commands(verb, (word,))}
            assert f"forceaxis.cli.{name}" in of, word


def test_the_first_page_fits_a_terminal_and_says_where_everything_is():
    done = forceaxis()
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == forceaxis("--help").stdout
    lines = done.stdout.splitlines()
    assert len(lines) < 24 and max(map(len, lines)) <= 80  # the prompt has a line too
    words = [word for line in lines if line.startswith("  ") for word in first_words(line)]
    assert words == main.WORDS


def first_words(line):
    """The commands at the beginning of a line of the first page: "  monitor, gateway  watch"."""
    return re.fullmatch(r"  (\w[\w, ]*?)  +\w.*", line).group(1).split(", ")


def test_a_group_lists_all_its_commands_under_headings_or_none():
    for words, group in VERBS:
        if isinstance(group, click.Group):
            listed = [name for names in group.sections.values() for name in names]
            assert sorted(listed) == sorted(group.commands) or not listed, words
            text = forceaxis(*words, "--help").stdout
            assert all(re.search(rf"^  {name} ", text, re.M) for name in group.commands), words


@pytest.mark.parametrize("earlier", moved.COMMANDS)
def test_the_earlier_name_of_a_command_shows_the_line_of_today(earlier):
    done = forceaxis(earlier, "a model", "--set", "b_m=1")
    line = re.search("expected the present name of this command, `(.*)`", done.stderr).group(1)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    typed = shlex.split(line)
    assert typed[0] == "forceaxis" and typed[-3:] == ["a model", "--set", "b_m=1"]
    words = tuple(typed[1:-3])
    assert earlier not in main.WORDS and words in [known for known, _ in VERBS]


def completed(*typed):
    completion = BashComplete(main.cli, {}, "forceaxis", "_FORCEAXIS_COMPLETE")
    return [item.value for item in completion.get_completions(list(typed[:-1]), typed[-1])]


def test_a_shell_completes_models_experiments_and_objects():
    assert "sweep" in completed("sw")
    assert {"fig4_19", "fig4_15"} <= set(completed("loop", "limit", "fig4_1"))
    assert "contact" in completed("run", "conta") and "fig2_40" not in completed("run", "fig")
    assert "contact" in completed("loop", "limit", "conta")
    assert "firmware.force_gain=" in completed("run", "contact", "--set", "firmware.force_g")
    assert "firmware.position=" not in completed("run", "contact", "--set", "firmware.pos")
    assert completed("run", "contact", "--set", "firmware.mode=fo") == ["firmware.mode=force"]
    assert "m_w=" in completed("run", "contact", "--set", "m_")
    assert "b_w=" in completed("loop", "limit", "fig4_19", "--set", "b")
    assert completed("loop", "limit", "nowhere", "--set", "b_") == []
    assert "m_w=" in completed("sweep", "contact", "--grid", "m_")
    assert "firmware.force_gain=" in completed("sweep", "contact", "--bisect", "firmware.force_g")
    assert "k_w=" in completed("design", "laboratory", "--over", "k_")
    assert "k_w=" in completed("tune", "--model", "laboratory", "--prior", "k_")
    assert "laboratory" in completed("tune", "--model", "lab")
    assert {"force", "force_gain"} <= set(completed("axis", "get", "forc"))
    assert "force_gain=" in completed("axis", "set", "forc")
    assert "force=" not in completed("axis", "set", "forc")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_installed_by_one_command(shell, tmp_path, monkeypatch):
    for variable in ("XDG_DATA_HOME", "XDG_CONFIG_HOME", "ZDOTDIR"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", f"/usr/bin/{shell}")
    if shell != "fish":
        (tmp_path / f".{shell}rc").write_text("alias one=two\n")
    for _ in range(2):
        done = forceaxis("completion", "install")
        assert done.returncode == 0, done.stderr
    script = Path(done.stdout.split()[1])
    assert "_FORCEAXIS_COMPLETE" in script.read_text()
    if shell != "fish":
        assert (tmp_path / f".{shell}rc").read_text() == f"alias one=two\nsource {script}\n"


# An import, and a file opened to write: the moments at which the program is interrupted.
MOMENTS = [
    ("import", "click"),
    ("import", "forceaxis._core"),
    ("import", "forceaxis.experiments.link"),
    ("import", "numpy"),
    ("import", "numpy.linalg"),
    ("import", "matplotlib"),
    ("open", "trace.csv"),
    ("open", "plot.png"),
]
HOOK = """
import os, signal, sys
kind, what = os.environ["MOMENT"].split()
def hook(event, arguments):
    global kind
    name = str(arguments[0]) if arguments else ""
    if event == kind and (name == what or kind == "open" and what in name):
        kind = None
        os.killpg(0, signal.SIGINT)
sys.addaudithook(hook)
"""


def interrupted(words, kind, what, tmp_path):
    """`forceaxis WORDS`, which gets Ctrl-C at the moment; returns what it leaves in `out`."""
    (tmp_path / "hook").mkdir()
    (tmp_path / "hook/sitecustomize.py").write_text(HOOK)
    done = subprocess.run(
        [FORCEAXIS, *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        # A shell that runs the tests in the background has it ignored.
        start_new_session=True,  # Ctrl-C is sent to a group of processes
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        env=os.environ | {"PYTHONPATH": str(tmp_path / "hook"), "MOMENT": f"{kind} {what}"},
    )
    assert done.returncode == 130, done.stderr
    assert re.fullmatch(r"forceaxis: interrupted(, .* is disabled and released)?",
                        done.stderr.strip())  # fmt: skip
    assert done.stdout == "" or "tune" in words
    return {str(p.relative_to(tmp_path / "out")) for p in (tmp_path / "out").rglob("*")}


@pytest.mark.parametrize(("kind", "what"), MOMENTS, ids=lambda v: v)
def test_an_interrupt_at_any_moment_is_status_130_and_leaves_nothing(kind, what, tmp_path):
    words = ["run", CONTACT, "--set", "experiment.duration_s=1.5", "--out", tmp_path / "out"]
    assert interrupted(words, kind, what, tmp_path) == set()
    assert not (tmp_path / "out").exists()


TUNE = (
    "tune --on sim:sim/experiments/contact.toml --set firmware.position_gain=4 --model laboratory "
    "--force 30,75 --over k_w=30%,m_w=30% --force-max 150"
)
INTERRUPTED = [
    ("sweep contact --grid firmware.force_gain=4:6:2", "import", "matplotlib.pyplot"),
    ("report {axes}", "open", "index.html"),
    ("identify fit fig4_19 {measured} --fit m_r", "open", "result.json"),
    ("design fig4_19 --over k_w=30%", "import", "forceaxis.design.search"),
    pytest.param(
        "design fig4_19 --over k_w=30% --no-simulate", "open", "bank.toml", marks=pytest.mark.long
    ),
    ("measure fig4_19 --output sensor.force --bias 1 --averages 4", "open", "response.csv"),
    ("loop compliance fig4_19 --points 2", "open", "c.png"),
    ("loop advise fig4_19 --linear", "open", "a.png"),
    ("new", "open", "model.toml"),
    ("test sim/experiments/contact.toml", "import", "forceaxis.experiments.expect"),
    ("thesis tables", "import", "rich.progress"),
    (TUNE, "open", "response.csv"),
]


@pytest.mark.parametrize(("line", "kind", "what"), INTERRUPTED, ids=lambda v: v.split(" -")[0])
def test_an_interrupt_of_any_verb_is_one_line_and_leaves_nothing_half_written(
    line, kind, what, tmp_path
):
    """A sweep keeps the journal of its finished runs, tune the steps that are done."""
    verb = next(word for word in line.split() if word not in ("loop", "thesis"))
    measured = tmp_path / "measured"
    if "{measured}" in line:
        simple = [
            "measure",
            "fig4_19",
            "--output",
            "sensor.force",
            "--bias",
            "1",
            "--averages",
            "4",
        ]
        assert forceaxis(*simple, "--out", measured).returncode == 0
    axes, out = tmp_path / "axes", tmp_path / "out"
    axes.mkdir()
    text = (ROOT / CONTACT).read_text()
    (axes / "contact.toml").write_text(text.replace("../models", str(ROOT / "sim/models")))
    if verb in ("advise", "compliance", "test"):
        out.mkdir()  # these write a file
    words = line.format(measured=measured, axes=axes).split()
    words += {"new": [out, "--yes"], "test": ["--junit", out / "results.xml"], "tables": [],
              "advise": ["--out", out / "a.png"], "compliance": ["--out", out / "c.png"],
              }.get(verb, ["--out", out])  # fmt: skip
    kept = {"sweep": {"journal.jsonl"}, "tune": {"tune.json", "check.json", "index.html"}}
    assert interrupted(words, kind, what, tmp_path) <= kept.get(verb, set())
