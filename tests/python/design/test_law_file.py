"""A law from a file has the gain limit of the experiment whose law it is, whichever program wrote
the file, and a file without a law is refused in one line."""

import json

import pytest
import verbs
from forceaxis import paths


def limit(*arguments):
    done = verbs.forceaxis("loop", "limit", *arguments, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def experiment(folder, firmware):
    """hold_p with other objects of the firmware, as a file."""
    text = (paths.EXPERIMENTS / "hold_p.toml").read_text().replace('"../', f'"{paths.SIM}/')
    file = folder / "own.toml"
    file.write_text(text.replace("modes_of_operation = 4\n", firmware))
    return file


@pytest.mark.parametrize(
    "firmware",
    [
        "modes_of_operation = 4\n",
        "modes_of_operation = -6\nstiffness = 0.02\n",
        "modes_of_operation = -7\ndamping = 0.2\n",
        "modes_of_operation = -8\nstiffness = 0.02\ndamping = 0.2\n",
    ],
)
def test_the_law_of_an_experiment_closes_the_same_loop_around_its_model(firmware, tmp_path):
    file = experiment(tmp_path, firmware)
    alone = limit("laboratory", "--law", file)
    assert alone == limit(file) and alone["at"]


@pytest.mark.parametrize("name", ["hold_p", "hold_biquad"])
def test_the_dump_of_an_axis_has_the_law_of_its_experiment(name, tmp_path):
    dump = tmp_path / "axis.toml"
    told = verbs.forceaxis(
        "axis", "params", "dump", dump, "--on", f"sim:sim/experiments/{name}.toml"
    )
    assert told.returncode == 0, told.stderr
    assert limit("laboratory", "--law", dump) == limit(name)


def test_the_law_of_a_file_takes_the_place_of_that_of_the_experiment():
    assert limit("hold_p", "--law", "sim/experiments/hold_biquad.toml") == limit("hold_biquad")
    assert limit("hold_biquad", "--law", "sim/experiments/hold_p.toml") == limit("hold_p")


def test_a_set_of_plants_has_the_law_of_the_file_at_its_gain():
    over = ("--over", "k_w=30%", "--modes", "nominal")
    of_file = limit("laboratory", *over, "--law", "sim/experiments/hold_biquad.toml")
    assert of_file == limit("hold_biquad", *over) and of_file["at"]["Ms"]


def test_poles_of_a_law_from_a_file_are_those_of_the_closed_loop():
    law = ("--law", "sim/experiments/hold_biquad.toml")
    one, other = (
        verbs.forceaxis("loop", "poles", *words, "--json")
        for words in (("laboratory", *law), ("hold_biquad",))
    )
    assert one.returncode == 0 and json.loads(one.stdout) == json.loads(other.stdout)


BANK = "[firmware]\nbank_sections_1 = 0\nbank_gain_1 = 4.0\nforce_bank = {}\n"


def bank_of_tuning(**other):
    """The text of a design.json whose bank has other values than a law that the axis can run."""
    bank = {"force_gain": 4.0, "integral_rad_per_s": 2.0, "sections": [[1.0, 0.0, 0.0, -0.2, 0.0]],
            "velocity_gain": 0.5, "hf_gain": 4.0}  # fmt: skip
    return json.dumps({"result": {"bank": bank | other}})


def test_a_bank_of_a_tuning_is_that_which_the_axis_stores(tmp_path):
    """Gains in steps of 1/256, coefficients in steps of 2^-26: the same bank of an experiment."""
    bank = {"force_gain": 4.0017, "integral_rad_per_s": 2.0, "velocity_gain": 0.0,
            "sections": [[1.0, 0.0, 0.0, -0.2, 0.0]]}  # fmt: skip
    (tmp_path / "design.json").write_text(bank_of_tuning(**bank))
    file = experiment(tmp_path, "modes_of_operation = 4\nforce_bank = 1\n")
    rows = bank | {"gain": bank["force_gain"]}
    lines = (f"{key} = {rows[key]}\n" for key in ("gain", "integral_rad_per_s", "sections"))
    file.write_text(file.read_text() + "[firmware.bank_1]\n" + "".join(lines))
    of_tuning = limit("laboratory", "--law", tmp_path / "design.json")
    assert of_tuning == limit("laboratory", "--law", file) and of_tuning["at"]


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"force_gain": 900.0}, "force_gain: expected a number from 0.00390625 to 255.996, got 90"),
        ({"force_gain": 0.0}, "force_gain: expected a number from 0.00390625"),
        ({"force_gain": -4.0}, "force_gain: expected a number from 0.00390625"),
        ({"integral_rad_per_s": -5.0}, "integral_rad_per_s: expected a number from 0 to 1500, got"),
        ({"integral_rad_per_s": 1501.0}, "integral_rad_per_s: expected a number from 0 to 1500"),
        ({"velocity_gain": -0.1}, "velocity_gain: expected a number from 0 to 255.996, got -0.1"),
        ({"velocity_gain": 256.0}, "velocity_gain: expected a number from 0 to 255.996"),
        (
            {"sections": [[1.0, 0.0, 0.0]]},
            "section 1: expected the 5 coefficients b0, b1, b2, a1, a2",
        ),
        ({"sections": [[1.0, 0, 0, 0, 0]] * 4}, "expected at most 3 second-order sections, got 4"),
        ({"sections": [[1.0, 0, 0, 0, 0], [16.1, 0, 0, 0, 0]]},
         "section 2: expected a number from -16 to 16, got 16.1"),
        ({"sections": [[1.0, 0, 0, 0, -17.0]]}, "section 1: expected a number from -16 to 16"),
    ],
)  # fmt: skip
def test_a_bank_that_no_axis_can_store_is_refused_as_in_an_experiment(other, words, tmp_path):
    (tmp_path / "design.json").write_text(bank_of_tuning(**other))
    done = verbs.forceaxis("loop", "limit", "laboratory", "--law", tmp_path / "design.json")
    assert done.returncode == 2 and done.stdout == "" and done.stderr.count("\n") == 1
    assert words in done.stderr and "design.json: bank: " in done.stderr, done.stderr


def test_no_command_without_skip_advises_it(tmp_path):
    (tmp_path / "axis.toml").write_text("[firmware]\nforce_gian = 4\n")
    told = verbs.forceaxis("loop", "limit", "laboratory", "--law", tmp_path / "axis.toml")
    assert "correct the values of these objects" in told.stderr and "`" not in told.stderr
    on = ("--on", f"sim:{paths.EXPERIMENTS}/hold_p.toml")
    told = verbs.forceaxis("axis", "params", "diff", tmp_path / "axis.toml", *on)
    assert "name them in `skip`" in told.stderr or "--skip" in told.stderr


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("gone.toml", None, "expected a file with a law, but there is no such file"),
        ("bank.toml", "[firmware]\nforce_bank = 0\n", "expected force_bank or force_gain"),
        ("bank.toml", BANK.format(1), "expected all values of the filter bank 1"),
        ("bank.toml", BANK.format(9), "force_bank: expected 0 to 4, got 9"),
        ("bank.toml", "[firmware]\nforce_gian = 4\n", "force_gian: expected the name of an object"),
        ("bank.toml", "[firmware\n", "line 1"),
        ("model.toml", "[[body]]\nname = 'robot'\n", "an experiment, the bank.toml of a design"),
        ("empty.toml", "", "an experiment, the bank.toml of a design"),
        ("design.json", "[1]", "an experiment, the bank.toml of a design"),
        ("design.json", "{", "an experiment, the bank.toml of a design"),
        ("design.json", '{"result": {"worst": {}}}', "JSON without a bank"),
        ("design.json", '{"bank": {"force_gain": 4.0}}', "design.json: bank"),
        ("design.json", '{"result": 3}', "JSON without a bank"),
    ],
)
def test_a_file_without_a_law_is_refused_in_one_line(name, text, words, tmp_path):
    if text is not None:
        (tmp_path / name).write_text(text)
    done = verbs.forceaxis("loop", "limit", "laboratory", "--law", tmp_path / name)
    assert done.returncode == 2 and done.stdout == ""
    assert words in done.stderr and name in done.stderr
    assert done.stderr.startswith("forceaxis: --law") and done.stderr.count("\n") == 1


def test_an_experiment_that_controls_no_force_gives_no_law():
    done = verbs.forceaxis("loop", "limit", "laboratory", "--law", "sim/experiments/move.toml")
    assert done.returncode == 2 and "give another experiment" in done.stderr
