"""examples/scope.csv, the recording of the page on real machines: what made it is no part of
forceaxis, and shows what the data sheets of examples/stage.toml do not say."""

import json
import shutil
import tomllib

import other_machine
import pytest
import verbs

EXAMPLES = other_machine.FILE.parent


def test_the_recording_is_the_one_of_the_other_program():
    assert other_machine.FILE.read_text() == other_machine.text()


def test_the_data_sheets_say_neither_the_friction_nor_the_stiffness():
    parameters = tomllib.loads((EXAMPLES / "stage.toml").read_text())["parameters"]
    same = {"m_r", "b_r", "k_s", "b_s", "m_w", "b_w"}
    for name in same:
        assert parameters[name]["value"] == getattr(other_machine.MACHINE, name), name
    assert parameters["f_c"]["value"] == 0 and other_machine.FRICTION_N == 8
    assert parameters["k_w"]["value"] == 1.25 * other_machine.STIFFNESS_N_PER_M


@pytest.mark.long
def test_a_model_without_the_friction_is_rejected_and_gives_no_stiffness(tmp_path):
    for name in ("stage.toml", "scope.csv"):
        shutil.copy(EXAMPLES / name, tmp_path)
    made = ["--map", "force=Fz,position=position,voltage_command=command", "--out", "scope"]
    assert verbs.forceaxis("recording", "import", "scope.csv", *made, cwd=tmp_path).returncode == 0
    fit = ["stage.toml", "scope.npz", "--fit", "k_w", "--json"]
    done = verbs.forceaxis("identify", "contact", *fit, "--out", "fit", cwd=tmp_path)
    assert done.returncode == 1 and json.loads(done.stdout)["rejected"] is True
    assert not (tmp_path / "fit/posterior.json").exists()
