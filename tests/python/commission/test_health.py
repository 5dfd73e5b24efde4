"""`forceaxis axis health`: an unchanged machine is healthy, a changed parameter is named."""

import json
import math
import os

import contact_study
import numpy as np
import pytest
from forceaxis import linear
from forceaxis.commission import contact_fit
from forceaxis.commission.health import HealthOrder, health
from forceaxis.identify import result
from forceaxis.linear import posterior
from forceaxis.results import to_json
from verbs import forceaxis

MODEL = "fig3_12"
RESPONSE = {
    "inject": "codes", "output": "adc0", "level": 60, "resolution_hz": 1.0, "band_hz": [1, 100],
}  # fmt: skip
# Parameters of bodies, springs, dampers and the drive, each 20 % higher.
CHANGED = (
    "m_r1", "m_r2", "m_w", "k_w", "k_rf", "k_s", "b_w", "b_r", "k_torque", "k_preamp_cmd",
)  # fmt: skip
HIGHER = 1.2
HEAVIER = 2.0  # moves a resonance by many of its widths
# Largest factor of a parameter that is drawn, and of those of the machine before that.
FACTOR_MAX, MACHINE_MAX = 2.5, 1.2


def measured(folder, seed, **plant):
    """Measures a response of the plant with changed parameters into a folder."""
    result.write(result.run(MODEL, RESPONSE | {"seed": seed}, plant), folder, draw=False)
    return folder


def value(name):
    return linear.facts(MODEL).parameters[name].value


def higher(name):
    return {name: HIGHER * value(name)}


def touched_today(folder, machine, read, seed, gain):
    """Returns the recordings of three touch-downs of a machine."""
    touches = contact_study.touched(machine, read, seed, gain)
    return contact_study.order_of(folder, machine, read, touches).recordings


def posterior_of(file, machine):
    """Writes a posterior around a machine, with 2 % of each parameter."""
    best = np.array(
        [getattr(machine, contact_study.PARAMETERS[name][0]) for name in contact_study.FITTED]
    )
    off = np.random.default_rng(1).standard_normal((400, len(best)))
    off -= off.mean(axis=0)
    known = posterior.Posterior(
        posterior.FORMAT, contact_study.FITTED, tuple(best.tolist()),
        tuple(map(tuple, (best * np.exp(0.02 * off)).tolist())), (0.0,) * len(off),
    )  # fmt: skip
    file.write_text(json.dumps({"posterior": to_json(known)}))
    return file


def test_an_unchanged_response_is_healthy_and_a_heavier_workpiece_is_drift(tmp_path):
    released = measured(tmp_path / "released", 1)
    same = forceaxis(
        "axis", "health", MODEL, measured(tmp_path / "same", 2), "--released", released
    )
    assert same.returncode == 0 and "health       healthy" in same.stdout
    today = measured(tmp_path / "today", 3, m_w=HEAVIER * value("m_w"))
    done = forceaxis("axis", "health", MODEL, today, "--released", released, "--json")
    found = json.loads(done.stdout)
    assert done.returncode == 1 and not found["healthy"]
    assert found["moved"] == ["m_w"]
    low, high = found["parameters"]["m_w"]["interval"]
    assert low < HEAVIER < high


def test_a_touch_down_is_held_against_a_posterior(tmp_path):
    machine, read, gain = contact_study.drawn(1)
    released = posterior_of(tmp_path / "posterior.json", machine)
    model = tmp_path / "same/model.toml"
    files = touched_today(tmp_path / "same", machine, read, 900, gain)
    assert health(HealthOrder(str(model), files, released)).healthy
    files = touched_today(tmp_path / "today", machine.but(k_w=1.2 * machine.k_w), read, 901, gain)
    found = health(HealthOrder(str(model), files, released))
    assert (found.healthy, found.moved) == (False, ("k_w",))


@pytest.mark.long
def test_a_machine_that_is_nearly_its_model_is_healthy_and_drifts_by_name(tmp_path):
    """Drive gains, friction and contact are a little off the model on both days, as the release
    found: its error of the model is one of today too."""
    machine, nearly, read, gain = contact_study.nearly(3)
    names = contact_study.NEARLY
    sheet = contact_study.sheet_of(machine, names, 3)
    touches = contact_study.touched(nearly, read, 3, gain)
    order = contact_study.order_of(tmp_path / "released", sheet, read, touches, names)
    released = contact_fit.identify(order)
    assert released.result.posterior.model_error
    contact_fit.write(released, tmp_path / "out")

    def judged(name, seed, **change):
        touches = contact_study.touched(nearly.but(**change), read, seed, gain)
        files = contact_study.order_of(tmp_path / name, sheet, read, touches, names).recordings
        return health(HealthOrder(order.model, files, tmp_path / "out/posterior.json"))

    same = [judged(f"same{i}", 700 + i).healthy for i in range(4)]
    assert all(same), same
    assert not judged("today", 800, k_w=1.5 * nearly.k_w).healthy


@pytest.mark.parametrize(
    ("today", "text"),
    [
        ("other", "measure again with the same options"),
        ("none", "expected a CSV file or a file response.npz"),
    ],
)
def test_what_cannot_be_compared_is_refused(tmp_path, today, text):
    released = measured(tmp_path / "released", 1)
    other = RESPONSE | {"seed": 2, "output": "encoder"}
    result.write(result.run(MODEL, other), tmp_path / "other", draw=False)
    done = forceaxis("axis", "health", MODEL, tmp_path / today, "--released", released)
    assert done.returncode == 2 and text in done.stderr


@pytest.mark.beside
@pytest.mark.long
def test_responses_of_twenty_unchanged_and_ten_changed_machines(tmp_path):
    def judged(number, name=""):
        released = measured(tmp_path / f"released_{number}", 1000 + number)
        today = measured(
            tmp_path / f"today_{number}", 2000 + number, **(higher(name) if name else {})
        )
        return health(HealthOrder(MODEL, [today], released))

    assert sum(judged(i).healthy for i in range(20)) >= 19
    named = [name for i, name in enumerate(CHANGED, 20) if judged(i, name).moved[:1] == (name,)]
    assert len(named) >= 9, named


@pytest.mark.beside
@pytest.mark.long
def test_a_large_change_of_a_drawn_machine_has_its_size(tmp_path):
    """The machine is not exactly the model, on neither day. FORCEAXIS_MACHINES machines, else 6."""
    count = int(os.environ.get("FORCEAXIS_MACHINES", "6"))
    wrong = []
    for number in range(count):
        rng = np.random.default_rng([44, number])
        plant = {name: value(name) * MACHINE_MAX ** rng.uniform(-1, 1) for name in CHANGED}
        name = (
            CHANGED[rng.integers(len(CHANGED))] if number % 2 else ("m_w", "k_w")[number % 4 // 2]
        )
        factor = FACTOR_MAX ** (rng.choice([-1, 1]) * rng.uniform(0.3, 1))
        released = measured(tmp_path / f"released_{number}", 3000 + number, **plant)
        plant[name] *= factor
        today = measured(tmp_path / f"today_{number}", 4000 + number, **plant)
        found = health(HealthOrder(MODEL, [today], released))
        change = found.parameters[name].change
        if found.moved[:1] != (name,) or not math.isclose(change, factor, rel_tol=0.1):
            wrong.append((number, name, factor, change, found.moved))
    assert len(wrong) <= 0.1 * count, wrong


@pytest.mark.beside
@pytest.mark.long
def test_touch_downs_of_twenty_unchanged_and_ten_changed_machines(tmp_path):
    """The release is the posterior of three recorded touch-downs."""
    machine, read, gain = contact_study.drawn(1)
    touches = contact_study.touched(machine, read, 1, gain)
    order = contact_study.order_of(tmp_path / "released", machine, read, touches)
    contact_fit.write(contact_fit.identify(order), tmp_path / "out")

    def judged(number, changed):
        files = touched_today(tmp_path / str(number), changed, read, 5000 + number, gain)
        return health(HealthOrder(order.model, files, tmp_path / "out/posterior.json"))

    assert sum(judged(i, machine).healthy for i in range(20)) >= 19
    named = []
    for name in contact_study.FITTED:
        field = contact_study.PARAMETERS[name][0]
        for factor in (HIGHER, 1 / HIGHER):
            number = f"{name}_{factor:.2f}"
            changed = machine.but(**{field: factor * getattr(machine, field)})
            found = judged(100 + len(named), changed)
            if found.moved[:1] == (name,):
                one = found.parameters[name]
                assert math.isclose(one.change, factor, rel_tol=0.1), number
                named.append(number)
    assert len(named) >= 9, named


def test_responses_with_different_amplitudes_are_hinted_at(tmp_path):
    """Dry friction makes a response depend on the amplitude, and --level is what fixes it."""
    folders = [measured(tmp_path / name, seed) for name, seed in (("released", 1), ("today", 2))]
    said = {}
    for today in (100, 128):
        for folder, amplitude in zip(folders, (128, today), strict=True):
            file = folder / "result.json"
            file.write_text(json.dumps(json.loads(file.read_text()) | {"amplitude": amplitude}))
        done = forceaxis("axis", "health", MODEL, folders[1], "--released", folders[0])
        said[today] = [line for line in done.stdout.splitlines() if line.startswith("hint")]
    assert said[128] == []
    (line,) = said[100]
    assert "today 100 codes, at the release 128" in line and "--level" in line
