"""`forceaxis tune`: a hidden plant gets a law that holds on it; what cannot be tuned is refused by
name and leaves the axis as it was; a tuning that is killed goes on."""

import json
import os
import shutil
import signal

import pytest
import verbs
from forceaxis._core import InputError
from forceaxis.axis.axis import Axis
from forceaxis.axis.sim import SimLink
from forceaxis.commission import tune, tune_page, tune_steps
from forceaxis.commission.refusal import Refusal
from forceaxis.design import data_sheet, new, outcome, reduced
from forceaxis.design.changes import Design
from forceaxis.design.search import Goal
from forceaxis.linear import over, plant_set
from forceaxis.linear.bank import Bank

pytestmark = pytest.mark.beside

# README's own axis; what it presses on is half as stiff and a third heavier than the model says.
SHEET = {
    "torque_constant_n_m_per_a": 0.5, "resistance_ohm": 4.5, "inductance_h": 0.0158,
    "rotor_inertia_kg_m2": 0.0013, "motor_peak_current_a": 30, "supply_v": 60,
    "lead_mm_per_rev": 25, "moving_mass_kg": 50, "full_scale_speed_m_per_s": 0.4,
    "sensor_full_scale_n": 300, "sensor_stiffness_n_per_m": 4e5,
}  # fmt: skip
TRUTH = {
    "workpiece_stiffness_n_per_m": 4e5,
    "workpiece_mass_kg": 6,
    "workpiece_damping_ratio": 0.02,
}
KNOWN = {"workpiece_stiffness_n_per_m": 8e5, "workpiece_mass_kg": 4.5}
NOISE_N = 0.1
FORCES = (30.0, 100.0)
FORCE_MAX_N = 160.0
OVER = ("k_w=30%,m_w=30%",)


@pytest.fixture(scope="module")
def plants(tmp_path_factory):
    """A folder with the hidden axis "true" and the model "known" of it."""
    folder = tmp_path_factory.mktemp("plants")
    for name, values in (
        ("true", SHEET | TRUTH | {"sensor_noise_n": NOISE_N}),
        ("quiet", SHEET | TRUTH),
        ("known", SHEET | KNOWN),
        ("fine", SHEET | KNOWN | {"sensor_bits": 14}),
    ):
        new.write(folder / name, *data_sheet.collect({k: str(v) for k, v in values.items()}))
        contact = folder / name / "contact.toml"
        contact.write_text(contact.read_text().replace('mode = "force"\n', ""))
    return folder


def order(plants, **changed):
    model = str(plants / changed.pop("known", "known") / "model.toml")
    given = {"model": model, "forces": FORCES, "over": OVER, "force_max_N": FORCE_MAX_N}
    return tune.Order(**(given | {"averages": 6} | changed))


def link(plants, overrides=(), name="true", store=""):
    return SimLink(plants / name / "contact.toml", overrides, store)


def quick(asked, _out, say):
    """for_set.design by its short search, not simulated: two seconds."""
    with Design(asked.text, asked.overrides) as plant:
        ranges = plant_set.ranges_of(plant.model, asked.over, plant.overrides)
        plants = plant_set.PlantSet(str(plant.model), plant.overrides, ranges)
        bits = plant.facts["reading"]["bits"]
        problem = reduced.Problem(plants, Goal(ms=asked.ms, ms_late=asked.ms_late, adc_bits=bits))
        found = problem.designed()
        bank, worst = problem.exact(found["bank"])
        units = {n: unit for n, (_, unit) in plant.facts["parameters"].items()}
        return outcome.Outcome(
            asked, plants, units, bits, bank, outcome.plain(worst), {}, Bank(0.0), [],
            reduced.NAME, "",
        )  # fmt: skip


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(tune_steps.for_set, "design", quick)


@pytest.fixture(scope="module")
def done(plants, tmp_path_factory):
    """A folder in which everything up to the simulation is done."""
    folder = tmp_path_factory.mktemp("tuned") / "out"
    patch = pytest.MonkeyPatch()
    patch.setattr(tune_steps.for_set, "design", quick)
    with Axis(link(plants)) as axis:
        truth = axis.link.axis
        tuning = tune.Tuning(axis, order(plants), folder)
        for step in tune.STEPS[: tune.STEPS.index("write")]:
            tuning.run(step)
            assert truth.extremes["force_N"] < FORCE_MAX_N
    patch.undo()
    return folder


@pytest.fixture
def designed(done, tmp_path):
    return shutil.copytree(done, tmp_path / "out")


def parameters(axis):
    law = ("force_bank", "force_gain", "bank_crc_1", "bank_gain_1", "position_gain", "force_scale")
    used = ("rated_force", "target_force", "excitation_code", "position_max", "force_max")
    return axis.get(*law, *used)


def test_a_hidden_plant_is_tuned_and_the_law_holds_on_it(plants, designed, tmp_path):
    store = tmp_path / "store.bin"
    with Axis(link(plants, store=store)) as axis:
        tuning = tune.Tuning(axis, order(plants), designed)
        summary = tuning.run()
        assert axis.link.axis.extremes["force_N"] < FORCE_MAX_N
        assert axis.read("drive_state") != "operation_enabled"
        tune_page.write(tuning, summary)
    axis.link.axis = None  # whose store another may open now
    assert summary["refused"] is None
    assert summary["stored"]
    assert summary["certificate_state"] == "fits"
    for force in FORCES:
        level = summary["levels"][f"verified-{force:g}N"]
        assert abs(level["Ms"] - level["Ms_predicted"]) < 0.3
        assert level["force_min_N"] > force / 2
    fitted = {n: summary["parameters"][n]["value"] for n in ("k_w", "m_w")}
    assert fitted == pytest.approx({"k_w": 4e5, "m_w": 6.0}, rel=0.05)
    # The truth: over the same set about the true values.
    held = summary["bank"]
    sections = tuple(map(tuple, held["sections"]))
    bank = Bank(held["force_gain"], held["integral_rad_per_s"], 0.0, sections)
    true = str(plants / "true/model.toml")
    about = plant_set.PlantSet(true, {}, plant_set.ranges_of(true, OVER))
    worst = over.worst(about, ("zoh",), law="bank", bank=bank)
    assert worst.stable
    assert abs(worst.Ms - summary["Ms_predicted"]) < 0.3
    assert "verified-30N" in (designed / "index.html").read_text()
    with Axis(link(plants, store=store)) as axis:
        assert axis.get("force_bank", "certificate_state_1") == {
            "force_bank": 1, "certificate_state_1": "fits",
        }  # fmt: skip


REFUSED = {
    "levels": ({"forces": (30.0,)}, (), "true"),
    "tare": ({}, ("firmware.force_tare=5.0",), "true"),
    "dither": ({}, (), "quiet"),
    "adc": ({"known": "fine"}, (), "true"),
    "scale": ({}, ("firmware.force_scale=1000000",), "true"),
    "force": ({"force_max_N": 105.0}, (), "true"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_by_name_leave_the_axis_as_it_was(plants, short, tmp_path, name):
    changed, overrides, plant = REFUSED[name]
    with Axis(link(plants, overrides, plant)) as axis:
        before = parameters(axis)
        with pytest.raises(Refusal) as refused:
            tune.Tuning(axis, order(plants, **changed), tmp_path / "out").run()
        assert refused.value.name == name
        assert parameters(axis) == before
        assert axis.read("drive_state") != "operation_enabled"


def altered(folder, step, change):
    file = folder / f"{step}.json"
    held = json.loads(file.read_text())
    change(held["result"])
    file.write_text(json.dumps(held))


def test_a_contact_that_does_not_settle_in_simulation_is_refused(plants, designed):
    altered(designed, "design", lambda r: r["bank"].update(force_gain=8 * r["bank"]["force_gain"]))
    (designed / "simulate.json").unlink()
    with Axis(link(plants)) as axis:
        before = parameters(axis)
        with pytest.raises(Refusal) as refused:
            tune.Tuning(axis, order(plants), designed).run()
        assert refused.value.name == "simulation"
        assert parameters(axis) == before


def test_a_law_that_is_not_verified_is_taken_back(plants, designed, monkeypatch):
    """Judged by a bound that no measured loop keeps: Ms below what is predicted by 2."""
    monkeypatch.setattr(tune_steps, "MS_WITHIN", -2.0)
    with Axis(link(plants)) as axis:
        before = parameters(axis)
        with pytest.raises(Refusal) as refused:
            tune.Tuning(axis, order(plants), designed).run()
        assert refused.value.name == "verify"
        assert refused.value.text.endswith("the law before is in force again")
        assert parameters(axis) == before
        assert not (designed / "write.json").exists()
        assert axis.link.axis.extremes["force_N"] < FORCE_MAX_N


def test_a_bank_that_the_firmware_refuses_is_named(plants, designed):
    altered(designed, "design", lambda r: r["objects"].update(bank_gain_1=200.0))
    with Axis(link(plants)) as axis:
        before = parameters(axis)
        with pytest.raises(Refusal) as refused:
            tune.Tuning(axis, order(plants), designed).run()
        assert refused.value.name == "wrong_crc"
        assert parameters(axis) == before


def test_another_order_does_not_go_on_in_the_folder(plants, designed):
    with Axis(link(plants)) as axis, pytest.raises(InputError, match="another order"):
        tune.Tuning(axis, order(plants, ms=1.5), designed)


@pytest.mark.long
def test_a_tuning_that_is_killed_in_any_step_goes_on(plants, short, tmp_path):
    """Killed when the step has done its work and not yet said so."""
    folder, store = tmp_path / "out", tmp_path / "store.bin"
    for step in tune.STEPS:
        child = os.fork()
        if child == 0:
            work = getattr(tune_steps, step)

            def killed(tuning, work=work):
                work(tuning)
                os.kill(os.getpid(), signal.SIGKILL)

            setattr(tune_steps, step, killed)
            with Axis(link(plants, store=store)) as axis:
                tune.Tuning(axis, order(plants), folder).run()
            os._exit(1)
        _, status = os.waitpid(child, 0)
        assert os.WTERMSIG(status) == signal.SIGKILL
        assert not (folder / f"{step}.json").exists()
        for file in folder.glob("*.json"):
            json.loads(file.read_text())
        assert not list(folder.glob("*.new"))
        with Axis(link(plants, store=store)) as axis:
            assert axis.read("drive_state") != "operation_enabled"
            tune.Tuning(axis, order(plants), folder).run(step)
        axis.link.axis = None  # whose store the next child opens
    with Axis(link(plants, store=store)) as axis:
        summary = tune.Tuning(axis, order(plants), folder).run()
    assert summary["stored"]


@pytest.mark.long
def test_the_verb_goes_on_and_prints_one_object(plants, designed):
    done = verbs.forceaxis(
        "tune", "--sim", plants / "true/contact.toml", "--model", plants / "known/model.toml",
        "--force", "30,100", "--over", OVER[0], "--force-max", FORCE_MAX_N, "--averages", 6,
        "--out", designed, "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["levels"].keys() == {"verified-30N", "verified-100N"}
    assert not summary["stored"]  # a simulated axis without a file for its store
    assert "check: done before" in done.stderr


def test_a_refusal_of_the_verb_is_status_1_and_its_name(plants, tmp_path):
    done = verbs.forceaxis(
        "tune", "--sim", plants / "quiet/contact.toml", "--model", plants / "known/model.toml",
        "--force", "30,100", "--over", OVER[0], "--force-max", 160, "--out", tmp_path / "o",
        "--json",
    )  # fmt: skip
    assert done.returncode == 1
    assert json.loads(done.stdout)["refused"]["name"] == "dither"
    assert done.stderr.splitlines()[-1].startswith("forceaxis: dither: expected readings at rest")
