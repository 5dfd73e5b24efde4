"""What a model lacks is named by what it leaves of the responses. The responses are computed from
the true plant, in which the disturbance is a part or a number, and what is printed is accepted."""

import copy
from dataclasses import replace
from types import SimpleNamespace

import drawn_axes
import drawn_machines
import numpy as np
import pytest
from forceaxis import linear
from forceaxis.commission import joint_fit, known, missing_parts
from forceaxis.design import model_file
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


def candidates(path, found, folder):
    rejected = joint_fit.joint(path, known.priors(path, OVER), found, OVER)
    assert rejected.rejected in ("chi2", "prior"), rejected.text
    return missing_parts.of(rejected, folder)


def accepted(path, cause, found, folder):
    """Whether the fit takes what is printed, unedited: lines in the model, or an option."""
    whole = path
    if cause.toml:
        whole = folder / "whole.toml"
        whole.write_text(missing_parts.with_lines(path, cause.toml))
    given = known.priors(whole, OVER, cause.priors)
    return joint_fit.joint(whole, given, found, OVER)


@pytest.mark.long
def test_a_slow_winding_is_named_and_its_inductance_is_printed(model, tmp_path):  # noqa: F811
    own = parameters(model)["L"]
    found = responses(model, true_values(model), drive={"L": 3.5 * own})
    first = missing_parts.winner(candidates(model, found, tmp_path))
    assert first.name == "drive_numbers"
    assert first.values["L"] == pytest.approx(3.5 * own, rel=0.15)
    assert accepted(model, first, found, tmp_path).rejected is None


MACHINE = ("velocity", 1)  # a screw drive with an elastic transmission
FRAME = {"hz": 30.0, "mass": 300.0, "stiffness": 300.0 * (60 * np.pi) ** 2, "damping": 3000.0}
# A light bed below a stiff loop of the drive: in noisy responses, the fit without the bed takes its
# effect into that loop, and from there a mode at the tool was found in its place.
LIGHT_MACHINE, LIGHT_KG = ("velocity", 31), 71.0
LIGHT = {"hz": 20.0, "mass": LIGHT_KG, "stiffness": LIGHT_KG * (40 * np.pi) ** 2, "damping": 105.0}
LIGHT_OFF = {"k_w": 1.06, "m_w": 1.52, "b_w": 2.2, "k_s": 0.91, "b_s": 1.9, "b_axis": 1.4}
# {cause: (truth over the model, elements, {response: states})}
DISTURBED = {
    "latency": ({}, {"latency": {"s": 4e-3, "as": "delay"}}),
    "sensor_lag": ({}, {"latency": {"s": 3e-3, "as": "low pass"}}),
    "frame": ({}, {"frame": FRAME | {"where": "bed"}}),
    "light_frame": (LIGHT_OFF, {"frame": LIGHT | {"where": "bed"}}),
    "drive_numbers": ({"velocity_loop": 2.1}, {}),
    "moving_mass": ({"m_load": 1.5}, {}),
    "stiffening": ({}, {"stiffening": {"factors": [0.4, 1.0, 2.0], "loads_N": [500.0, 900.0]}}),
}
GATE = ("light_frame",)
FAR = ("drive_numbers", "moving_mass")


@pytest.mark.parametrize(
    "cause", [c if c in GATE else pytest.param(c, marks=pytest.mark.long) for c in DISTURBED]
)
def test_a_disturbance_alone_is_named_with_what_the_fit_then_accepts(cause, tmp_path):
    light = cause == "light_frame"
    drawn = LIGHT_MACHINE if light else MACHINE
    machine = copy.deepcopy(drawn_machines.draw(*drawn, exact=True))
    machine.truth, machine.elements = DISTURBED[cause]
    path = drawn_axes.written(tmp_path / "known", machine.sheet) / "model.toml"
    plant = drawn_machines.true_model(path, machine, tmp_path / "true")
    found = []
    for i in range(3):
        segments = linear.facts(plant).switches.get("fixture")
        states = {"fixture": segments[i]} if segments and i else {}
        one = measured(plant, {}, free=i == 0, seed=50 + i, modes=states,
                       error=0.05 if light else 0.01)  # fmt: skip
        if cause == "latency" and i:
            late = np.exp(-2j * np.pi * one.frequency_hz * machine.elements["latency"]["s"])
            one = replace(one, response=one.response * late)
        found.append(replace(one, model=str(path)))
    if cause in FAR:  # the value of the data sheet is doubted, and the fit goes on
        fit = joint_fit.joint(path, known.priors(path, OVER), found, OVER)
        (name,) = machine.truth
        assert fit.rejected is None and fit.far == (name,)
        wanted = machine.truth[name] * linear.facts(path).parameters[name].value
        assert fit.best[name] == pytest.approx(wanted, rel=0.1)
        return
    tried = candidates(path, found, tmp_path)
    first = missing_parts.winner(tried)
    assert first is not None, missing_parts.text_of(tried)
    assert first.name == cause.removeprefix("light_"), missing_parts.text_of(tried)
    assert missing_parts.text_of(tried).startswith(f"the cause is {first.text}: ")
    if cause == "frame":
        assert "machine bed near 30" in first.text or "machine bed near 29" in first.text
    if light:
        assert first.text.startswith("a mode of the machine bed near ")
        assert first.values["m_mode"] == pytest.approx(LIGHT_KG, rel=0.3)
    if cause not in ("stiffening", "latency"):  # ages of readings belong to a response, not a model
        again = accepted(path, first, found, tmp_path)
        assert again.rejected is None, again.text


@pytest.mark.long
def test_a_lag_of_the_sensor_is_told_from_a_latency(tmp_path):
    """Of 0.4 ms: the phases are the same up to 150 Hz, and the lag takes 6 % of the size there."""
    machine = copy.deepcopy(drawn_machines.draw(*MACHINE, exact=True))
    path = drawn_axes.written(tmp_path / "known", machine.sheet) / "model.toml"
    found = []
    for i in range(3):
        one = measured(path, {}, free=i == 0, seed=60 + i, error=0.02)
        lag = 1 / (1 + 2j * np.pi * one.frequency_hz * 4e-4)
        found.append(replace(one, response=one.response * lag) if i else one)
    tried = candidates(path, found, tmp_path)
    first = missing_parts.winner(tried)
    assert first.name == "sensor_lag" and first.values["lag_s@"] == pytest.approx(4e-4, rel=0.1)
    text = missing_parts.text_of(tried)
    assert text.startswith(f"the cause is {first.text}: ") and "a latency of 0.3" in text


def test_the_evidence_decides_whether_a_cause_is_named():
    def one(name, gain, p=0.5):
        return missing_parts.Tried(name, f"{name} text", "", "", gain, p, {})

    lag, latency, frame = one("sensor_lag", 40.0), one("latency", 25.0), one("frame", -3.0)
    assert missing_parts.winner([lag, latency, frame]) is lag
    assert missing_parts.winner([lag, replace(latency, gain=31.0), frame]) is None
    assert missing_parts.winner([replace(lag, gain=9.0), replace(frame, gain=0.0)]) is None
    assert missing_parts.winner([replace(lag, gain=-1.0), replace(frame, gain=-20.0)]) is None
    part = [replace(lag, p=1e-9), frame]  # it does not explain the responses
    assert missing_parts.winner(part) is None and missing_parts.leader(part) is part[0]
    assert missing_parts.text_of(part).startswith("one of several causes is sensor_lag text: ")
    assert missing_parts.winner([lag, replace(lag, gain=39.0), frame]) is not None  # the same cause
    assert missing_parts.winner([]) is None
    both = [lag, replace(latency, gain=31.0), frame]
    assert missing_parts.delay(both) is lag  # a law with one of them bears the other
    assert missing_parts.delay([*both[:2], replace(frame, gain=31.0)]) is None
    assert missing_parts.delay([lag, latency, frame]) is None
    text = missing_parts.text_of(both)
    assert "sensor_lag text or latency text" in text and "frame text" not in text
    text = missing_parts.text_of([frame])
    assert "none of these alone explains it: a mode of frame or tool" in text


@pytest.mark.long
def test_nothing_is_named_where_the_model_explains_the_responses(model, tmp_path):  # noqa: F811
    found = joint_fit.joint(
        model, known.priors(model, OVER), responses(model, true_values(model)), OVER
    )
    assert found.rejected is None
    assert missing_parts.winner(missing_parts.of(found, tmp_path)) is None


def test_a_second_mode_has_a_name_of_its_own(model, tmp_path, monkeypatch):  # noqa: F811
    """A mode of the tool was added as a cause, and the next one had the same name: the refusal was
    that of the reader of models."""
    monkeypatch.setattr(missing_parts, "_worst_hz", lambda *_: [])
    values = {"m_mode": 2.0, "k_mode": 1e5, "b_mode": 30.0}
    path = tmp_path / "model.toml"
    path.write_text(model.read_text())
    kinds = 0
    for _ in range(3):
        problem = SimpleNamespace(
            model=path, measured=[SimpleNamespace(frequency_hz=np.array([1.0, 100.0]))]
        )
        one = missing_parts._Model(problem, {}, model_file.read(path), linear.facts(path))
        places = [members[0] for members in missing_parts._frames(one, np.zeros(0))]
        for place in places:
            whole = tmp_path / "whole.toml"
            whole.write_text(missing_parts.with_lines(path, place.lines(values)))
            bodies = len(linear.facts(whole).masses_kg)
            assert bodies == len(linear.facts(path).masses_kg) + 1
        kinds += len(places)
        path.write_text(missing_parts.with_lines(path, places[kinds % len(places)].lines(values)))
    assert kinds >= 6


def test_a_mode_is_searched_where_the_model_explains_the_responses_worst(model):  # noqa: F811
    """A bed at 28 Hz lay between two starts of a band to 400 Hz, and another mode was taken."""
    hz = np.geomspace(1.0, 400.0, 200)
    size = np.exp(-((np.log(hz / 28.5) / 0.02) ** 2)) + 0.5 * np.exp(
        -((np.log(hz / 90) / 0.02) ** 2)
    )
    problem = SimpleNamespace(
        model=model, measured=[SimpleNamespace(frequency_hz=hz)],
        scores=lambda x: [np.concatenate([0.6 * size, -0.8 * size])],
    )  # fmt: skip
    one = missing_parts._Model(problem, {}, model_file.read(model), linear.facts(model))
    for places in missing_parts._frames(one, np.zeros(0)):
        starts = [
            np.sqrt(c.priors["k_mode"].value / c.priors["m_mode"].value) / (2 * np.pi)
            for c in places
        ]
        assert min(abs(np.log(at / 28.5)) for at in starts) < 0.03
        assert min(abs(np.log(at / 90)) for at in starts) < 0.03
