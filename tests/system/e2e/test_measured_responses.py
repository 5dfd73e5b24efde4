"""What `forceaxis measure` writes of a live axis: over a model, and as the plant of a design."""

import json

import numpy as np
import pytest
import verbs
from drawn_axes import PRESS, written

pytestmark = pytest.mark.beside


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """(model of the data sheet, folders of responses of an axis whose workpiece differs)."""
    sheet = PRESS | {"sensor_bits": 12, "sensor_noise_n": 0.3}
    folder = written(tmp_path_factory.mktemp("axis") / "press", sheet)
    done = verbs.forceaxis(
        "measure", "--on", f"sim:{folder / 'contact.toml'}", "--set", "k_w=5e5", "--set",
        "firmware.position_gain=8", "--free", "--force", "30,75", "--force-max", 150,
        "--averages", 5, "--band", "1:200", "--out", folder / "m",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder / "model.toml", [folder / "m" / name for name in ("free", "30N", "75N")]


def options(folders):
    return [word for folder in folders for word in ("--measured", folder)]


def test_points_lie_on_the_model_that_was_measured_and_not_on_another(measured, tmp_path):
    model, folders = measured
    bode = "loop", "bode", model, *options(folders[1:])
    true = json.loads(verbs.forceaxis(*bode, "--set", "k_w=5e5", "--json").stdout)
    (curve,) = true["curves"]
    for row in true["measured"]:
        assert row["p_value"] > 1e-4 and row["inside"] > 0.85
        # Alike without the turns of the phase in between.
        at = np.interp(row["frequency_hz"], curve["frequency_hz"], curve["phase_deg"])
        coherent = np.array(row["coherence"]) > 0.9
        assert coherent.sum() > 30
        assert np.abs(at - row["phase_deg"])[coherent].max() < 60
    other = json.loads(verbs.forceaxis(*bode, "--json").stdout)
    assert all(row["p_value"] < 1e-9 for row in other["measured"])
    done = verbs.forceaxis(*bode, "--out", tmp_path / "both.svg")
    assert done.returncode == 0 and "the model does not fit" in done.stdout
    assert "75N" in (tmp_path / "both.svg").read_text()


@pytest.mark.long
def test_a_design_is_for_the_plant_that_was_measured(measured):
    model, folders = measured
    done = verbs.forceaxis(
        "design", model, *options(folders), "--over", "k_w=30%,m_w=30%", "--no-simulate", "--json"
    )
    assert done.returncode == 0, done.stderr
    value, low, high = json.loads(done.stdout)["over"]["k_w"]
    assert value == pytest.approx(5e5, rel=0.05)
    assert 0.64 * 5e5 < low < 0.72 * 5e5 and 1.28 * 5e5 < high < 1.37 * 5e5


def test_a_design_is_refused_where_the_fit_is(measured):
    model, folders = measured
    done = verbs.forceaxis(
        "design", model, *options(folders), "--over", "k_w=30%", "--prior", "k_w=2e5+-2%"
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith(("forceaxis: prior: expected", "forceaxis: chi2: expected"))
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "words, text",
    [
        (("bode", "--of", "loop"), "--of: expected only without --measured"),
        (("bode", "--output", "encoder"), "--output: expected only without --measured"),
        (
            ("bode", "--measured", "free"),
            "expected responses with equal input and equal output",
        ),
        (("bode", "--measured", "nowhere"), "expected a CSV file or a file response.npz"),
    ],
)
def test_what_does_not_belong_to_it_is_one_line(measured, words, text):
    model, folders = measured
    words = [folders[0] if word == "free" else word for word in words]
    done = verbs.forceaxis("loop", words[0], model, "--measured", folders[1], *words[1:])
    assert done.returncode == 2 and done.stdout == ""
    assert text in done.stderr and done.stderr.count("\n") == 1, done.stderr


def test_a_prior_is_of_measured_responses(measured):
    done = verbs.forceaxis("design", measured[0], "--prior", "k_w=2e5")
    assert (done.returncode, done.stderr) == (
        2,
        "forceaxis: --prior: expected --measured together with this option; add --measured or "
        "remove --prior\n",
    )
