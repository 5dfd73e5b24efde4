"""What a model lacks is named by what it leaves of the responses, and the TOML that is printed
would explain it."""

import numpy as np
import pytest
import tomlkit
from forceaxis import linear
from forceaxis.commission import joint_fit, known, missing_parts
from test_axis_fit import OVER, TRUTH, measured, model, parameters, true_values  # noqa: F401

pytestmark = pytest.mark.beside


def responses(path, truth, change=None, drive=None):
    """A response apart and two in contact; change(hz, i): a factor of each that the model lacks."""
    found = [measured(path, truth | (drive or {}), free=i == 0, seed=30 + i) for i in range(3)]
    if change:
        for i, one in enumerate(found):
            factor = change(one.frequency_hz, i)
            one.response[:] = one.response * factor
            one.variance[:] = one.variance * abs(factor) ** 2
    return found


def candidates(path, found):
    rejected = joint_fit.joint(path, known.priors(path, OVER), found, OVER)
    assert rejected.rejected == "chi2", rejected.text
    return missing_parts.of(rejected)


def pole_pair(hz, at, zeta):
    return 1 - (hz / at) ** 2 + 2j * zeta * hz / at


def test_a_slow_winding_is_a_lag_of_the_drive_and_its_inductance_is_printed(model):  # noqa: F811
    truth = true_values(model)
    own = parameters(model)["L"]
    first = candidates(model, responses(model, truth, drive={"L": 3.5 * own}))[0]
    assert first.name == "drive_lag" and first.p > 1e-3
    assert tomlkit.parse(first.toml)["L"]["value"] == pytest.approx(3.5 * own, rel=0.15)


@pytest.mark.long
def test_a_lag_of_the_sensor_alone_is_named_with_its_corner(model):  # noqa: F811
    lag = 1.5e-3
    found = responses(
        model, true_values(model), lambda hz, i: 1 / (1 + 2j * np.pi * hz * lag) if i else 1.0
    )
    first = candidates(model, found)[0]
    assert first.name == "sensor_lag" and first.p > 1e-3
    corner = float(tomlkit.parse(first.toml)["filter"].removesuffix(" rad/s"))
    assert corner == pytest.approx(1 / lag, rel=0.1)


@pytest.mark.long
def test_a_mode_that_the_model_lacks_is_named_with_a_body_and_its_spring(model):  # noqa: F811
    found = responses(
        model, true_values(model),
        lambda hz, _: pole_pair(hz, 17.0, 0.03) / pole_pair(hz, 18.5, 0.03),
    )  # fmt: skip
    first = candidates(model, found)[0]
    assert first.name == "mode" and first.p > 1e-3
    table = tomlkit.parse(first.toml)
    mass, stiffness = table["body"][0]["mass"], table["spring"][0]["stiffness"]
    assert np.sqrt(stiffness / mass) / (2 * np.pi) == pytest.approx(17.0, rel=0.03)
    added = model.parent / "with_mode.toml"
    added.write_text(model.read_text() + "\n" + first.toml)
    poles = linear.linearise(added, outputs=("encoder",), free=True).poles_s()
    near = abs(poles[poles.imag > 0]) / (2 * np.pi)
    assert np.min(abs(near / 18.5 - 1)) < 0.1  # the drive shifts it


@pytest.mark.long
def test_a_gain_that_differs_by_level_is_named(model):  # noqa: F811
    found = responses(model, true_values(model), lambda hz, i: 2.0 if i == 2 else 1.0)
    rejected = joint_fit.joint(model, known.priors(model, OVER), found, OVER)
    assert rejected.rejected == "chi2"
    first = missing_parts.of(rejected)[0]
    assert (first.name == "gain" and "1, 2" in first.text) or "1, 1.9" in first.text


@pytest.mark.long
def test_nothing_is_named_where_the_model_explains_the_responses(model):  # noqa: F811
    found = joint_fit.joint(
        model, known.priors(model, OVER), responses(model, true_values(model)), OVER
    )
    assert found.rejected is None and missing_parts.of(found) == []
