"""What a fitted model does not explain of a response, and Ms of a law that has to bear it."""

from dataclasses import replace

import numpy as np
import pytest
from forceaxis.commission import joint_fit, known, unexplained
from forceaxis.commission.unexplained import UNSTABLE_MS, Unexplained
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import PlantSet
from test_axis_fit import OVER, model, three, true_values  # noqa: F401

pytestmark = pytest.mark.beside
HZ = np.geomspace(0.5, 200, 400)


def integrator(crossover_hz, delay_s):
    """L and S of an integrator with a delay."""
    s = 2j * np.pi * HZ
    L = 2 * np.pi * crossover_hz * np.exp(-s * delay_s) / s
    return L, 1 / (1 + L)


def quotient(values, error=0.0):
    error = np.full(len(HZ), error)
    return Unexplained(*(tuple(part.tolist()) for part in (HZ, values.real, values.imag, error)))


@pytest.mark.parametrize("more_s", [0.001, 0.004])
def test_a_delay_that_the_model_lacks_gives_the_ms_of_the_delayed_loop(more_s):
    _, S = integrator(20, 0.001)
    _, true = integrator(20, 0.001 + more_s)
    lacks = quotient(np.exp(-2j * np.pi * HZ * more_s))
    assert lacks.largest(S).max() == pytest.approx(abs(true).max(), rel=1e-9)
    assert quotient(np.exp(-2j * np.pi * HZ * more_s), 0.05).largest(S).max() > abs(true).max()


def test_a_delay_beyond_the_delay_margin_is_unstable():
    """The phase margin of 90 degrees is used up by a delay of a quarter of a period."""
    _, S = integrator(20, 0.0)
    bears, breaks = (
        quotient(np.exp(-2j * np.pi * HZ * share / 20)).largest(S).max() for share in (0.15, 0.26)
    )
    assert bears < 10 and breaks == UNSTABLE_MS


def test_a_model_without_a_lag_of_the_axis_predicts_ms_with_the_measured_quotient(model):  # noqa: F811
    corner_hz, at_hz = 40.0, np.arange(2.0, 150.0, 2.0)
    lag = 1 / (1 + 1j * at_hz / corner_hz)
    responses = [
        one
        if one.free
        else replace(one, response=one.response * lag, variance=one.variance * abs(lag) ** 2)
        for one in three(model, true_values(model))
    ]  # fmt: skip
    rejected = joint_fit.joint(model, known.priors(model, OVER), responses, OVER)
    assert rejected.rejected in ("chi2", "prior")
    found = joint_fit.with_model_error(rejected, OVER)
    assert found.rejected is None
    lacks = unexplained.of_fit(found, ["free", "30N", "100N"])
    assert list(lacks) == ["30N", "100N"]
    plants = PlantSet(str(model), found.values)
    loop = plants.loop(plants.nominal()[0], "zoh", LoopSpec("bank", bank=Bank(1.0)))
    gain = 0.05 * loop.limit().gain
    bank = Bank(loop.firmware_gain(gain))
    S = loop.sensitivity_at(gain, at_hz)
    truth = responses[1].predict(true_values(model)) * lag / responses[1].predict(found.values)
    exact = abs(1 / (1 + (1 / S - 1) * truth)).max()
    predicted = unexplained.largest_ms(plants, bank, ("zoh",), lacks)["zoh"]
    assert abs(exact - abs(S).max()) > 0.1
    assert exact * 0.97 < predicted < exact * 1.15
