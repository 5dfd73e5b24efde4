"""Dry friction that a model does not have: found in newtons, in its place, and put into the fit."""

import json
import math
import re
import shutil
from dataclasses import replace
from types import SimpleNamespace

import drawn_axes
import numpy as np
import pytest
import tomlkit
import tune_study
import verbs
from forceaxis import linear
from forceaxis.axis import actions
from forceaxis.axis.axis import Axis
from forceaxis.axis.sim import SimLink
from forceaxis.cli import design
from forceaxis.cli.response_text import describe_response
from forceaxis.commission import (
    analyzer,
    friction,
    friction_models,
    known,
    machine_bounds,
    measuring,
    missing_parts,
    sine_excitation,
    tune,
    tune_fit,
    tune_measure,
    tune_results,
)
from forceaxis.commission.analyzer import Analyzer
from forceaxis.commission.level import MOST_CODES, MeasuringOrder
from forceaxis.commission.refusal import Refusal
from forceaxis.design import data_sheet, model_file, new, outcome
from forceaxis.identify import fit as fit_response
from forceaxis.identify import result
from forceaxis.objects import BY_NAME

pytestmark = pytest.mark.beside

FORCES, FORCE_MAX_N = (30.0, 100.0), 160.0
OVER = ("k_w=30%,m_w=30%",)
STEPS = ("check", "free", "measure", "fit")
K_S, K_W, COUNTS = 4e5, 2.5e5, 160e3  # N/m, counts a metre


@pytest.fixture(scope="module")
def press(tmp_path_factory):
    return drawn_axes.press(tmp_path_factory.mktemp("axis") / "press")


def rubbing_press(press, folder, **found):
    """The press with frictions of so many newtons; seals: of the axis, table: of the workpiece."""
    places = {"seals": ("axis", "ground"), "table": ("workpiece", "ground")}
    shutil.copytree(press, folder)
    model = folder / "model.toml"
    rows = [
        f'[[friction]]\nname = "{name}"\nbetween = {list(places[name])}\ncoulomb = {newton}\n\n'
        for name, newton in found.items()
    ]
    model.write_text(model.read_text().replace("[drive]", "".join(rows) + "[drive]", 1))
    return folder


def tuning(press, axis, out, say=lambda text: None, **changed):
    given = {"model": str(press / "model.toml"), "forces": FORCES, "over": OVER, "averages": 6}
    order = tune.TuningOrder(**(given | {"force_max_N": FORCE_MAX_N} | changed))
    return tune.Tuning(axis, order, out, say)


def link(folder):
    return SimLink(folder / "contact.toml", list(drawn_axes.DELIVERED))


def pushed(friction_N, low=18.0, high=120.0, noise=0.3, stiffer=1.0, k_w=K_W):
    """(force, position in counts) of a workpiece on a spring and a table that is pushed from `low`
    to `high` and back, slid forward before: it moves only where the force overcomes the table. The
    spring is `stiffer` above half of the largest force."""
    rng = np.random.default_rng(28)
    force = np.concatenate([np.linspace(low, high, 1600), np.linspace(high, low, 1600)])
    place, spring = [], low - friction_N
    for one in force:
        spring = min(max(spring, one - friction_N), one + friction_N)
        at = min(spring, high / 2) / k_w + max(spring - high / 2, 0.0) / (stiffer * k_w)
        place.append(at + one / K_S)
    counts = np.round(COUNTS * np.array(place) + rng.normal(size=len(place)) * 0.3)
    return force + noise * rng.normal(size=len(force)), counts


@pytest.mark.parametrize("newton", [2.0, 8.0, 25.0, 45.0])
def test_friction_under_a_workpiece_shows_in_the_way_there_and_back(newton):
    found = friction.slow_loading(*pushed(newton), COUNTS / K_S)
    assert found.friction_N == pytest.approx(newton, rel=0.15)
    assert found.sliding == pytest.approx(COUNTS / K_W, rel=0.15)
    assert found.compliance == pytest.approx(COUNTS / K_S, rel=0.15)
    assert not found.soft


def test_a_small_friction_is_seen_beside_a_stiffness_that_grows_much():
    """Of a soft workpiece: the curve was larger than its loop, and 0.9 N were not found. Its law
    had Ms 2.3 where the workpiece stuck, and had promised 2.0."""
    asked = {"low": 2.7, "high": 27.7, "noise": 0.02, "stiffer": 5.0, "k_w": 3400.0}
    found = friction.slow_loading(*pushed(0.9, **asked), COUNTS / K_S)
    assert found.friction_N == pytest.approx(0.9, rel=0.4)
    assert not friction.slow_loading(*pushed(0.0, **asked), COUNTS / K_S).rubs


@pytest.mark.parametrize("newton", [4.0, 8.0])
def test_friction_is_told_from_a_stiffness_that_grows_with_the_force(newton):
    """A fixture with 1.8 times the stiffness at the larger forces was told to hold 37 N of 8 N."""
    found = friction.slow_loading(*pushed(newton, stiffer=1.8), COUNTS / K_S)
    assert found.friction_N == pytest.approx(newton, rel=0.3)
    mean = (0.5 + 0.5 / 1.8) / 1.0
    assert found.bends[0] == pytest.approx(1 / 1.8 / mean, rel=0.2)
    assert found.bends[1] == pytest.approx(1 / mean, rel=0.2)
    assert friction.slow_loading(*pushed(newton), COUNTS / K_S).bends == (1.0, 1.0)
    without = friction.slow_loading(*pushed(0.0, stiffer=1.8), COUNTS / K_S)
    assert not without.rubs and not without.creep


def test_without_friction_there_is_none_and_nothing_is_soft():
    found = friction.slow_loading(*pushed(0.0), COUNTS / K_S)
    assert not found.rubs and not found.sticks and not found.soft
    assert found.compliance == pytest.approx(COUNTS / K_S + COUNTS / K_W, rel=0.03)


def relaxing(share, time_s, dt_s=1 / 300, noise=0.3):
    """(force, position in counts) of a workpiece that relaxes: its spring K_W, and beside it a
    spring of `share` of it in series with a dashpot, at rest at the first force. Euler's method."""
    rng = np.random.default_rng(29)
    force = np.interp(np.arange(3200) * dt_s, [0, 3, 5.3, 8.3, 11], [18, 120, 120, 18, 18])
    place, dashpot = [], force[0] / K_W
    for one in force:
        at = (one + share * K_W * dashpot) / (K_W + share * K_W)
        dashpot += dt_s * (at - dashpot) / time_s
        place.append(at + one / K_S)
    counts = np.round(COUNTS * np.array(place) + rng.normal(size=len(place)) * 0.3)
    return force + noise * rng.normal(size=len(force)), counts


@pytest.mark.parametrize("share, time_s", [(0.2, 0.3), (0.5, 1.0), (1.0, 4.0)])
def test_a_workpiece_that_relaxes_is_not_taken_for_one_that_rubs(share, time_s):
    """Rubber of 250 N/mm was told to have dry friction of 2.4 N, with lines for the model."""
    found = friction.slow_loading(*relaxing(share, time_s), COUNTS / K_S)
    assert not found.rubs and not found.sticks
    at_once = 1 / (1 + share) / K_W
    assert found.compliance == pytest.approx(COUNTS * (1 / K_S + at_once), rel=0.1)
    assert found.creep == pytest.approx(COUNTS * (1 / K_W - at_once), rel=0.25)
    assert found.creep_s == pytest.approx(time_s * (1 + share), rel=0.35)
    rubs = friction.slow_loading(*pushed(8.0), COUNTS / K_S)
    assert rubs.rubs and not rubs.creep


@pytest.mark.parametrize("coarse", [8, 12, 16])
def test_with_a_few_counts_what_fits_better_decides_between_friction_and_relaxing(coarse):
    """A way of 34 counts with 0.9 counts between both directions: 1.4 N of a workpiece without."""
    rigid, found = COUNTS / K_S / coarse, []
    for share, time_s in ((0.2, 1.0), (0.2, 1.65), (0.3, 0.5)):
        force, counts = relaxing(share, time_s)
        for shift in (-0.2, 0.0, 0.2):
            found.append(friction.slow_loading(force, np.round(counts / coarse + shift), rigid))
    assert sum(one.creep > 0 for one in found) >= 3  # 0 before
    for newton in (8.0, 25.0):
        force, counts = pushed(newton)
        rubs = friction.slow_loading(force, np.round(counts / coarse), rigid)
        assert rubs.friction_N == pytest.approx(newton, rel=0.45) and not rubs.creep


def test_the_lines_of_a_workpiece_that_relaxes_are_taken_by_its_model(press, tmp_path):
    lines = missing_parts.relaxing(press / "model.toml", 0.5, 1.0)
    whole = tmp_path / "model.toml"
    whole.write_text(f"{(press / 'model.toml').read_text()}\n{lines}\n")  # as a user appends them
    added = tmp_path / "added.toml"
    added.write_text(missing_parts.with_lines(press / "model.toml", lines))

    def stiffness(model, hz):
        plant = linear.linearise(model, ("drive.command",), ("sensor.force", "workpiece.position"))
        force, place = plant.at(2j * np.pi * hz).ravel()
        return abs(force / place)

    k_w = linear.facts(press / "model.toml").parameters["k_w"].value
    for model in (whole, added):
        assert stiffness(model, 1e-3) == pytest.approx(k_w, rel=0.01)
        assert stiffness(model, 2.0) == pytest.approx(1.5 * k_w, rel=0.02)
        assert known.behind_counts(model) == known.behind_counts(press / "model.toml")
        assert missing_parts.relaxing(model, 0.5, 1.0) == ""  # which it has now
        assert model_file.document(model)["parameters"]["k_w"]["value"] == k_w


def test_a_soft_place_between_two_forces_is_found_where_it_is():
    force, place = pushed(0.0)
    softer = np.interp(force, [60.0, 80.0], [0.0, 20 * 4 * COUNTS / K_S])  # 5 times as soft there
    found = friction.slow_loading(force, place + softer, COUNTS / K_S)
    assert found.soft and 60 < found.softest_N < 80


@pytest.mark.parametrize("mass, newton", [(6.0, 4.0), (1.5, 12.0)])
def test_sines_show_stiffness_and_mass_whatever_the_friction_is(mass, newton):
    """Force on a mass, a spring and Coulomb friction by the balance of the first harmonic."""
    rows = []
    for hz in np.linspace(10, 1.3 * np.sqrt(K_W / mass) / 2 / np.pi, 8):
        w, way = 2 * np.pi * hz, 1e-4 * np.exp(0.7j)
        force = (K_W - mass * w**2 + 20j * w) * way + 4j / np.pi * newton * way / abs(way)
        place = way + force / K_S
        rows.append((hz, force.real, force.imag, place.real, place.imag, 30))
    found = sine_excitation.of_sines(rows, K_S)
    assert (found.stiffness, found.mass) == pytest.approx((K_W, mass), rel=0.01)
    assert found.friction_N == pytest.approx(newton, rel=0.05)


@pytest.mark.parametrize("newton", [0.0, 3.0, 12.0, 25.0])
def test_friction_of_guide_and_gear_shows_apart(press, tmp_path, newton):
    hidden = rubbing_press(press, tmp_path / "hidden", **({"seals": newton} if newton else {}))
    with Axis(link(hidden)) as axis:
        work = tuning(press, axis, tmp_path / "out")
        for step in STEPS[:2]:
            work.run(step)
        scale = abs(linear.facts(work.model).required_encoder.scale)
        assert max(
            abs(axis.link.axis.extremes[f"position_{end}_cnt"]) for end in ("min", "max")
        ) < 5e-3 * scale + 2 * machine_bounds.free_counts(work.model)
        found = tune_measure.moving_N(work, tune.FREE.result(work))
    assert found == pytest.approx(newton, rel=0.05, abs=0.3)


def test_what_is_printed_is_toml_that_the_model_takes(press, tmp_path):
    model = press / "model.toml"
    found = friction_models.frictions_of(model, 12.5, 4.0)
    assert [rub.between for rub in found] == [("axis", "ground"), ("workpiece", "ground")]
    assert not any(rub.declared for rub in found)
    added = tmp_path / "model.toml"
    added.write_text(model.read_text() + "\n" + friction_models.toml_lines(found))
    table = tomlkit.parse(added.read_text())["friction"]
    assert [one["coulomb"] for one in table] == [12.5, 4.0]
    again = friction_models.frictions_of(
        added, 10.0, 5.0
    )  # what is declared keeps its place, with what is found
    assert [rub.newton for rub in again] == pytest.approx([10.0, 5.0])
    assert all(rub.declared for rub in again) and friction_models.toml_lines(again) == ""
    changed = tmp_path / "changed.toml"
    changed.write_text(friction_models.with_friction(added, again))
    assert [one["coulomb"] for one in tomlkit.parse(changed.read_text())["friction"]] == [10.0, 5.0]
    slides = tmp_path / "slides.toml"
    slides.write_text(friction_models.damped(added, again))
    assert "friction" not in tomlkit.parse(slides.read_text())
    free = linear.linearise(model, outputs=("adc0",)).at(30j)
    assert linear.linearise(slides, outputs=("adc0",)).at(30j) == pytest.approx(free)


def test_a_soft_window_between_the_forces_is_refused_by_name(press, tmp_path):
    """Between 50 and 75 N the fixture yields: a tenth of its stiffness."""
    hidden = tmp_path / "hidden"
    shutil.copytree(press, hidden)
    text = (hidden / "model.toml").read_text()
    old = 'stiffness = "k_w"'
    assert text.count(old) == 1
    new = 'stiffness = ["k_w", 4e4, "k_w"]\nloads = [50.0, 75.0]'
    (hidden / "model.toml").write_text(text.replace(old, new))
    with Axis(link(hidden)) as axis:
        work = tuning(press, axis, tmp_path / "out", travel_mm=2.0)
        with pytest.raises(Refusal, match=r"measure with the forces 30,[56]") as refused:
            work.run()
        assert axis.link.axis.extremes["force_N"] < FORCE_MAX_N
    assert refused.value.name == "soft"


@pytest.mark.long
def test_friction_is_freed_in_the_fit_and_the_way_between_the_forces_is_told(press, tmp_path):
    hidden, said = rubbing_press(press, tmp_path / "hidden", seals=12.0, table=5.0), []
    with Axis(link(hidden)) as axis:
        work = tuning(press, axis, tmp_path / "out", said.append)
        for step in STEPS:
            work.run(step)
        assert axis.link.axis.extremes["force_N"] < FORCE_MAX_N
    found = {rub.name: rub.newton for rub in tune.FIT.result(work).friction}
    assert found == pytest.approx(
        {friction_models.MOVING: 12.0, friction_models.TABLE: 5.0}, rel=0.3
    )
    values = tune.FIT.result(work).values
    assert (values["k_w"], values["m_w"]) == pytest.approx((4e5, 6.0), rel=0.2)
    assert work.model == tmp_path / "out/model.toml"
    summary = work.summary()
    assert tomlkit.parse(summary.friction_lines)["friction"][0]["name"] == friction_models.MOVING
    text = " ".join(summary.holds)
    for part in ("N from peak to peak", "not measured", "made the workpiece slide", "sticks"):
        assert part in text, part
    assert "add to the model:" in " ".join(said)


@pytest.mark.long
def test_a_workpiece_that_does_not_slide_is_refused_and_the_lines_let_the_same_folder_go_on(
    press, tmp_path
):
    hidden, said = rubbing_press(press, tmp_path / "hidden", table=40.0), []
    known = tmp_path / "known"
    shutil.copytree(press, known)
    with Axis(link(hidden)) as axis:
        work = tuning(known, axis, tmp_path / "out")
        with pytest.raises(Refusal) as refused:
            for step in STEPS:
                work.run(step)
        assert refused.value.name == "friction"
        table = tomlkit.parse(work.refused.lines)["friction"]
        assert table[0]["coulomb"] == pytest.approx(40.0, rel=0.3)
        model = known / "model.toml"
        assert "table_friction" in linear.facts(work.refused.model).switches
        model.write_text(model.read_text() + "\n" + work.refused.lines)
        work = tuning(known, axis, tmp_path / "out", said.append)
        assert "changed since the last run: the model; results kept: free, measure" in said[0]
        for step in ("check", "fit"):
            work.run(step)
        assert json.loads((tmp_path / "out/fit.json").read_text())["result"]["friction"]
        assert tune.FIT.result(work).friction[0].declared
        # The mass does not show: a third to three times the model's, unless it is given.
        lows, highs = mass_of(work)
        assert lows < 6.0 * 0.7 / 2.9 and highs > 6.0 * 1.3 * 2.9
        assert any("do not show its mass" in line for line in work.summary().holds)
        work = tuning(known, axis, tmp_path / "out", priors=("m_w=6",))
        for step in ("check", "fit"):
            work.run(step)
        lows, highs = mass_of(work)
        assert 0.5 * 6.0 < lows < highs < 1.5 * 6.0


def test_an_axis_that_a_killed_run_has_moved_goes_back_before_it_glides(press, tmp_path):
    """A kill leaves the axis to coast toward the workpiece: the next glide would touch."""
    with Axis(link(press)) as axis:
        work = tuning(press, axis, tmp_path / "out")
        work.run("check")
        start = tune.CHECK.result(work).rest.position
        axis.set(position_gain=tune.CHECK.result(work).settings["position_gain"])
        axis.enable("profile position")
        axis.move(start + 780)
        axis.disable()
        actions.wait_to_stand(axis)
        with pytest.raises(
            Refusal, match="the axis touched the workpiece; start further away"
        ) as refused:
            work.run("free")
        assert refused.value.name == "contact"
        work = tuning(press, axis, tmp_path / "out")
        work.coasted = True
        actions.wait_to_stand(axis)
        work.run("free")
        assert abs(axis.read("position") - start) < 400
        assert axis.link.axis.extremes["force_N"] < FORCE_MAX_N


def test_a_step_begins_where_the_tuning_began_and_a_refusal_ends_there(
    press, tmp_path, monkeypatch
):
    """A kill in contact lets the workpiece push the axis away, over many times the distance to it:
    the approach of the next run ended before a contact. A refusal left the axis near the
    workpiece, where the weight cannot be checked."""
    with Axis(link(press)) as axis:
        work = tuning(press, axis, tmp_path / "out")
        work.run("check")
        checked = tune.CHECK.result(work)
        start, places = checked.rest.position, []
        axis.set(position_gain=checked.settings["position_gain"])

        def go(position):
            axis.enable("profile position")
            axis.move(position, 120.0)
            axis.disable()
            actions.wait_to_stand(axis)

        def refused(*_):
            places.append(axis.read("position"))
            go(start + 300)
            raise Refusal("unit", "as this test wants")

        go(start - 5000)
        work.coasted = True
        monkeypatch.setattr(tune_measure, "_measured", refused)
        with pytest.raises(Refusal, match="as this test wants"):
            tune_measure.measure(work, checked, None)
        assert [places[0], axis.read("position")] == pytest.approx([start, start], abs=50)


def test_an_axis_that_returns_stops_at_a_workpiece_that_was_not_there(press, tmp_path):
    """Someone has put a longer part in after the kill: the place of the start is inside it."""
    with Axis(link(press)) as axis:
        work = tuning(press, axis, tmp_path / "out")
        work.run("check")
        checked = tune.CHECK.result(work)
        inside = replace(checked.rest, position=checked.rest.position + 3000)
        work.coasted, before = True, axis.read("position")
        with (
            pytest.raises(Refusal, match="the axis touched the workpiece"),
            tune_measure.returning(work, replace(checked, rest=inside)),
        ):
            raise AssertionError("the step begins")
        assert axis.read("position") == pytest.approx(before, abs=50)
        assert axis.read("drive_state") != "operation_enabled"
        assert axis.link.axis.extremes["force_N"] < FORCE_MAX_N / 2


def test_a_sensor_yields_no_more_than_was_measured_before_the_workpiece_slid(press, monkeypatch):
    """A latency had made the fitted sensor a third too soft and the workpiece too stiff: on a
    workpiece that sticks, the law had Ms 2.6 and had promised 2.0. The stiffnesses of the slow
    change are measured values, which a fit may not leave as one of a data sheet."""
    monkeypatch.setattr(
        tune_fit.linear, "facts", lambda model: SimpleNamespace(
            required_encoder=SimpleNamespace(scale=COUNTS),
            parameters={"m_w": SimpleNamespace(value=2.0)},
        ),
    )  # fmt: skip
    work = SimpleNamespace(
        given=press / "model.toml", order=SimpleNamespace(priors=("m_w=2",)),
    )  # fmt: skip
    rub = friction_models.FrictionElement(friction_models.TABLE, ("workpiece", "ground"), 5.0)
    slow = tune_results.SlowChange(
        friction_N=5.0, sticks=False, compliance=COUNTS / K_S, sliding=COUNTS / K_W,
        low_N=20.0, high_N=120.0,
    )  # fmt: skip
    measured = SimpleNamespace(between=slow, shaken=None)
    found = [
        tune_fit._workpiece(work, (rub,), measured, best)
        for best in (None, {"k_s": 0.95 * K_S}, {"k_s": 0.65 * K_S}, {"k_s": 1.5 * K_S})
    ]
    assert ["k_s" in one for one in found] == [False, False, True, False]
    assert found[2]["k_s"].value == pytest.approx(K_S)
    assert not any(prior.surmised for one in found for prior in one.values())


def mass_of(work):
    """(kg, kg): the range that a law is designed for."""
    over = next(text for text in tune.FIT.result(work).over if text.startswith("m_w="))
    return tuple(map(float, over.removeprefix("m_w=").split("..")))


def test_a_friction_seen_at_the_motor_may_be_at_the_load(worn, press):
    """A damper at the motor alone left friction of the load to the damping of the guide: a fit had
    thirty times the true one, and a drive a quarter too fast."""
    seen = friction_models.FrictionElement(friction_models.MOVING, ("motor", "ground"), 40.0)
    table = friction_models.FrictionElement(friction_models.TABLE, ("workpiece", "ground"), 5.0)
    model = worn / "model.toml"
    found = {
        one.between[0]: one.newton for one in friction_models.at_both_ends(model, (seen, table))
    }
    assert found == {"motor": 20.0, "load": 20.0, "workpiece": 5.0}
    declared = friction_models.FrictionElement("seals", ("load", "ground"), 40.0, True)
    assert friction_models.at_both_ends(model, (declared, table)) == (declared, table)
    one_body = friction_models.FrictionElement(friction_models.MOVING, ("axis", "ground"), 40.0)
    assert friction_models.at_both_ends(press / "model.toml", (one_body,)) == (one_body,)


def measured(hidden, model, *words, **given):
    """({response: Result}, true extremes) of `measure` on a hidden axis, which is as it was."""
    order = {"force_max_N": FORCE_MAX_N, "averages": 4} | given
    with Axis(SimLink(hidden / "contact.toml")) as axis:
        axis.link.axis.reset_extremes()
        names = ("position_min", "position_max", "force_max", "target_force", "drive_state")
        before = axis.get(*names)
        forces = tuple(word for word in words if word != "free")
        try:
            done = measuring.measure(
                axis, MeasuringOrder(**order), forces, "free" in words, str(model)
            )
        finally:
            after = axis.get(*names)
            assert after.pop("drive_state") != "operation_enabled"
            assert after.items() <= before.items()
        return done, dict(axis.link.axis.extremes)


def test_measure_finds_friction_raises_the_amplitude_until_it_slides_and_says_both(press, tmp_path):
    hidden = rubbing_press(press, tmp_path / "hidden", seals=12.0, table=5.0)
    contact = hidden / "contact.toml"
    # With less gain the friction of the axis takes too much of the swing.
    contact.write_text(re.sub(r"\bforce_gain = .*", "force_gain = 7.29", contact.read_text()))
    model = press / "model.toml"
    done, extremes = measured(hidden, model, "free", 30.0, 100.0)
    assert extremes["force_N"] < FORCE_MAX_N
    for name, one in done.items():
        found = one.summary.friction
        assert found.rubs and found.moving_N == pytest.approx(12.0, rel=0.05), name
        table = tmp_path / f"{name}.toml"
        table.write_text(model.read_text() + "\n" + found.lines)
        assert known.newton_per_code(table) > 0  # it is TOML that a model takes
        assert one.summary.amplitude > 2 * found.dead_zone_codes
        rows = dict(describe_response(one.summary))
        assert "12 N" in rows["friction"] and "[[friction]]" in rows["model lacks"]
    assert done["30N"].summary.friction.workpiece_N == pytest.approx(5.0, rel=0.2)
    assert "sticks in this swing" in rows["friction"]  # of a drive that is linear up to 7 codes
    assert done["free"].summary.friction.workpiece_N is None
    done, extremes = measured(hidden, "", "free", 30.0, 100.0)
    assert extremes["force_N"] < FORCE_MAX_N
    for force in (30.0, 100.0):
        about = done[f"{force:g}N"].summary
        found = about.friction
        codes = 12.0 / known.newton_per_code(model)
        assert found.dead_zone_codes == pytest.approx(codes, rel=0.05)
        assert found.moving_N is None and found.workpiece_N == pytest.approx(5.0, rel=0.2)
        assert found.workpiece_slides and about.swing > 0.3 * force


def test_a_motion_apart_keeps_the_position_limits_that_the_axis_has(press):
    with Axis(SimLink(press / "contact.toml")) as axis:
        start = axis.read("position")
        axis.set(position_min=start - 120, position_max=start + 300)
        with Analyzer(axis, MeasuringOrder(travel=500)) as analyzer:
            assert not friction.glide(analyzer, 512).rubs
        ends = [axis.link.axis.extremes[f"position_{end}_cnt"] for end in ("min", "max")]
        assert start - 130 < ends[0] and ends[1] < start + 130  # as far to either side
        axis.set(position_min=start - 5)
        with (
            Analyzer(axis, MeasuringOrder(travel=500)) as analyzer,
            pytest.raises(Refusal, match="counts"),
        ):
            friction.glide(analyzer, 512)


@pytest.mark.parametrize("travel", [30, 60, 130, 270, 400, 800])
def test_a_motion_apart_over_a_bus_finds_the_speed_within_any_travel(tmp_path, travel):
    """A position over a bus of 4 ms is late, so the same code may be slow enough one way alone."""
    folder = drawn_axes.written(tmp_path / "axis", tune_study.BUS)
    first = friction.first_code(MOST_CODES, travel, known.code_rate(folder / "model.toml"))
    with (
        Axis(SimLink(folder / "contact.toml")) as axis,
        Analyzer(axis, MeasuringOrder(travel=travel)) as analyzer,
    ):
        found = friction.glide(analyzer, MOST_CODES, first=first)
    assert not found.rubs
    assert found.rate == pytest.approx(0.25 * 400e3 / 2048, rel=0.05)  # full speed, counts/m, codes


def test_an_axis_that_covers_its_travel_at_once_needs_the_named_travel(tmp_path):
    folder = drawn_axes.written(
        tmp_path / "axis", tune_study.BUS | {"encoder_counts_per_rev": 30000}
    )
    with Axis(SimLink(folder / "contact.toml")) as axis:
        with (
            Analyzer(axis, MeasuringOrder(travel=40)) as analyzer,
            pytest.raises(Refusal, match="at 2 DAC codes the axis moves farther") as refused,
        ):
            friction.glide(analyzer, 64)
        travel = int(re.search(r"give `travel` (\d+)$", refused.value.text)[1])
        assert travel < 800
        with Analyzer(axis, MeasuringOrder(travel=travel)) as analyzer:
            assert friction.glide(analyzer, 64).rate > 0
        # Where the machine has room for it, the measurement takes the travel that it needs.
        axis.link.axis.reset_extremes()
        start, said = axis.integer("position"), []
        most = MeasuringOrder(travel=40, travel_most=travel)
        with Analyzer(axis, most, say=said.append) as analyzer:
            assert friction.glide(analyzer, 64).rate > 0
            assert 40 < analyzer.order.travel <= travel
        assert any("counts of travel in place of 40" in text for text in said)
        ends = [axis.link.axis.extremes[f"position_{end}_cnt"] - start for end in ("min", "max")]
        assert max(map(abs, ends)) < 1.5 * travel
        with (
            Analyzer(axis, MeasuringOrder(travel=40, travel_most=60)) as analyzer,
            pytest.raises(Refusal, match="at 2 DAC codes the axis moves farther"),
        ):
            friction.glide(analyzer, 64)


def test_a_smallest_amplitude_that_leaves_the_travel_gets_the_travel_of_the_machine(tmp_path):
    sheet = tune_study.BUS | {"encoder_counts_per_rev": 30000}
    folder = drawn_axes.written(tmp_path / "axis", sheet)
    with Axis(SimLink(folder / "contact.toml")) as axis:
        start, said = axis.integer("position"), []
        with (
            Analyzer(axis, MeasuringOrder(travel=6, averages=4)) as analyzer,
            pytest.raises(Refusal, match="the travel of 6 counts out of contact; give `travel`"),
        ):
            analyzer.free()
        order = MeasuringOrder(travel=6, averages=4, travel_most=200)
        axis.link.axis.reset_extremes()
        with Analyzer(axis, order, say=said.append) as analyzer:
            assert analyzer.free().amplitude >= 1
            assert 6 < analyzer.order.travel <= 200
        assert any("the smallest amplitude moves the axis farther: 12 counts" in t for t in said)
        ends = [axis.link.axis.extremes[f"position_{end}_cnt"] - start for end in ("min", "max")]
        assert max(map(abs, ends)) < 1.5 * 200


def test_a_code_that_is_too_fast_in_one_direction_alone_is_reduced(press, monkeypatch):
    def moved(analyzer, code, *_):
        if code < -8:
            raise friction._TooFast(500.0)
        return friction._Motion(code, 50.0 * code, math.nan)

    monkeypatch.setattr(friction, "_motion", moved)
    with Axis(link(press)) as axis, Analyzer(axis, MeasuringOrder(travel=400)) as analyzer:
        found = friction.glide(analyzer, 200)
    assert found.rate == pytest.approx(50.0) and found.codes <= 8 and not found.rubs


@pytest.mark.parametrize(
    "speed, text",
    [
        (lambda code: 50.0 * code if code > 16 else None, "at 21 codes it is too fast"),
        (lambda code: math.copysign(300.0, code), "a speed of the axis that grows with"),
        (lambda code: -5.0 * code, "a speed of the axis that grows with the DAC code"),
    ],
)  # fmt: skip
def test_speeds_that_show_no_friction_are_refused(press, monkeypatch, speed, text):
    def moved(analyzer, code, *_):
        if abs(code) > 20:
            raise friction._TooFast(500.0)
        found = speed(code)
        return None if found is None else friction._Motion(code, found, math.nan)

    monkeypatch.setattr(friction, "_motion", moved)
    with (
        Axis(link(press)) as axis, Analyzer(axis, MeasuringOrder(travel=400)) as analyzer,
        pytest.raises(Refusal, match=text),
    ):  # fmt: skip
        friction.glide(analyzer, 200)


def test_measure_looks_within_its_travel_and_finds_nothing_where_nothing_is(press, tmp_path):
    done, extremes = measured(press, press / "model.toml", "free", travel=400)
    assert extremes["force_N"] == 0.0
    ends = [extremes[f"position_{end}_cnt"] for end in ("min", "max")]
    assert ends[1] - ends[0] < 2 * 400 + 40
    assert not done["free"].summary.friction.rubs
    assert "friction" not in dict(describe_response(done["free"].summary))


class Overtaken(SimLink):
    """The excitation of its axis ends by a bound of the force while it is being stopped."""

    ends = 0

    def write(self, values):
        own = self.read(["excitation_force_min"])
        if values.get("excitation_run") == 0 and self.ends:
            self.ends -= 1
            super().write({"excitation_force_min": BY_NAME["excitation_force_min"].max})
            self.wait(0.02)
            super().write(own)
        super().write(values)


def test_an_excitation_that_ends_by_a_bound_while_it_is_stopped_is_reduced(press):
    """It was waited for until the time was over, and the measurement was refused."""
    said = []
    with Axis(Overtaken(press / "contact.toml")) as axis:
        axis.link.ends = 1
        order = MeasuringOrder(force_max_N=FORCE_MAX_N, averages=4, amplitude=8)
        with Analyzer(axis, order, say=said.append) as analyzer:
            analyzer.rest()
            level = analyzer.contact(60.0)
    assert "ended_force at 8 codes: halved" in said and level.amplitude == 4


@pytest.mark.parametrize("newton, force", [(12.0, 30.0), (25.0, 100.0)])
def test_friction_of_the_guide_shows_in_contact_by_the_codes_of_both_directions(
    press, tmp_path, newton, force
):
    hidden = rubbing_press(press, tmp_path / "hidden", seals=newton)
    done, _ = measured(hidden, press / "model.toml", force)
    found = done[f"{force:g}N"].summary.friction
    assert found.moving_N == pytest.approx(newton, rel=0.1)
    assert found.workpiece_N == 0.0 and found.glide is None
    # With a target of 0 N the axis comes to rest where spring and law are less than the friction.
    own = tomlkit.parse((hidden / "contact.toml").read_text())["firmware"]
    reading = linear.facts(press / "model.toml").reading
    count_N = abs(reading.per_count) * 2 ** (reading.bits - 8)
    pulls = known.newton_per_code(press / "model.toml") * own["force_gain"] / count_N
    assert 0 < found.left_N * (1 + pulls) / newton < 1.05


@pytest.mark.parametrize("newton", [0.0, 12.0, 25.0])
def test_friction_of_the_guide_shows_in_contact_without_model_and_motion_apart(
    press, tmp_path, newton
):
    """At least a part of it: what is left of it where the axis stands."""
    hidden = rubbing_press(press, tmp_path / "hidden", **({"seals": newton} if newton else {}))
    done, _ = measured(hidden, "", 60.0)
    found, codes = (
        done["60N"].summary.friction,
        newton / known.newton_per_code(press / "model.toml"),
    )
    assert found.rubs is (newton > 0)
    assert 0.5 * codes <= found.dead_zone_codes <= 1.05 * codes
    if newton:
        assert done["60N"].summary.swing > 0.3 * 60.0
        assert "at least" in dict(describe_response(done["60N"].summary))["friction"]


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(i, marks=pytest.mark.long) for i in range(1, 11))]
)
def test_measure_finds_the_friction_of_drawn_axes_in_contact_alone(tmp_path, seed):
    """Of a law without an integral, which such friction keeps away from the force asked for."""
    sheet, off, rubs = drawn_axes.rubbed(seed)
    model = drawn_axes.written(tmp_path / "known", sheet) / "model.toml"
    shutil.copytree(model.parent, tmp_path / "true")
    (tmp_path / "true/model.toml").write_text(drawn_axes.with_friction(model, rubs))
    (low, high), most = drawn_axes.asked_of(sheet)
    truth = drawn_axes.given(drawn_axes.truth_of(model, off))
    with Axis(SimLink(tmp_path / "true/contact.toml", truth)) as axis:
        done = measuring.measure(
            axis, MeasuringOrder(force_max_N=most, averages=4), (low, high), False, str(model)
        )
        assert axis.link.axis.extremes["force_N"] < most
    found = next(one.summary.friction for one in done.values())
    assert found.moving_N == pytest.approx(rubs["seals"] + rubs["gear"], rel=0.1)
    assert found.workpiece_N == pytest.approx(rubs["table"], rel=0.25, abs=2.0)


def test_a_workpiece_that_sticks_all_the_way_shows_and_a_rigid_one_is_none(press, tmp_path):
    hidden = rubbing_press(press, tmp_path / "hidden", table=60.0)
    done, _ = measured(hidden, press / "model.toml", 30.0)
    rows = dict(describe_response(done["30N"].summary))
    assert "at least" in rows["friction"] and "which sticks" in rows["friction"]
    found = done["30N"].summary.friction
    assert 7.0 < found.workpiece_N < 60.0  # the force was changed by 18 N
    rigid = {n: v for n, v in drawn_axes.PRESS.items() if not n.startswith("workpiece")}
    model = drawn_axes.written(tmp_path / "rigid", rigid) / "model.toml"
    done, _ = measured(model.parent, model, 30.0)
    assert not done["30N"].summary.friction.rubs


@pytest.mark.parametrize("words", [("free",), (60.0,)])
def test_noise_that_does_not_slide_is_refused_with_newtons(press, tmp_path, words):
    hidden = rubbing_press(press, tmp_path / "hidden", seals=25.0)
    with pytest.raises(Refusal, match="a larger excitation level") as refused:
        measured(hidden, press / "model.toml", *words, amplitude=3)
    assert refused.value.name == "friction" and " N" in refused.value.text
    if words != ("free",):
        (table,) = tomlkit.parse(refused.value.lines)["friction"]
        assert table["coulomb"] == pytest.approx(25.0, rel=0.1)


@pytest.mark.parametrize("dead_zone", [0.0, 2.0, 6.0])
def test_codes_of_both_directions_less_what_the_speed_takes(dead_zone):
    """A motor on a spring: the force of a code is F = g c less the friction and less what the speed
    takes; it sticks at the turn until the code has changed by twice the dead zone."""
    force = np.concatenate([np.linspace(20, 60, 900), np.full(300, 60.0), np.linspace(60, 20, 900)])
    rng = np.random.default_rng(28)
    place, rate, g = 3.0 * force, 60.0, 1.5
    speed = np.gradient(place, friction.DECIMATION / 1500)
    slides = np.where(np.arange(len(force)) < 1050, 1.0, -1.0)
    codes = force / g + speed / rate + dead_zone * slides
    found = friction.directions(
        force + 0.3 * rng.normal(size=len(force)), np.round(place),
        np.round(codes + rng.normal(size=len(force))), rate,
    )  # fmt: skip
    assert found.dead_zone == pytest.approx(dead_zone, abs=0.2)
    assert found.rubs is (dead_zone > 0)


@pytest.fixture(scope="module")
def rubbed(press, tmp_path_factory):
    """A folder of `measure --out`: apart, and with 60 N, of an axis with 12 N in its guide."""
    folder = tmp_path_factory.mktemp("rubbed")
    hidden = rubbing_press(press, folder / "hidden", seals=12.0)
    done, _ = measured(hidden, press / "model.toml", "free", 60.0, averages=6)
    for name, one in done.items():
        result.write(one, folder / name, draw=False)
    return folder


def identified(*words):
    """`identify fit`, which does not search long where a model does not fit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit_response, "OTHER_STARTS", 1)
        return verbs.forceaxis("identify", "fit", *words)


def test_identify_fit_frees_the_friction_that_was_measured(press, rubbed):
    model = press / "model.toml"
    words = (model, rubbed / "60N", "--fit", "k_w=6e5", "--fit", "m_w=5")
    done = identified(*words, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert not found["rejected"] and found["model"] == str(model)
    values = {name: row["value"] for name, row in found["parameters"].items()}
    assert (values["k_w"], values["m_w"]) == pytest.approx((4e5, 6.0), rel=0.05)
    (one,) = found["friction"]["freed"]
    assert one["between"] == ["axis", "ground"] and one["newton"] == pytest.approx(12.0, rel=0.05)
    assert one["damping"] == values["b_guide_friction"] > 0
    (table,) = tomlkit.parse(found["friction"]["lines"])["friction"]
    assert table["coulomb"] == pytest.approx(12.0, rel=0.05)
    assert found["set"].split()[::2] == ["--set", "--set"] and "b_guide" not in found["set"]


def test_a_design_about_measured_responses_frees_their_friction(press, rubbed, tmp_path):
    model = press / "model.toml"
    order = outcome.DesignOrder(str(model), over=OVER)
    folders = [str(rubbed / name) for name in ("free", "60N")]
    found = design._identified(order, folders, ())
    values = [found.overrides[name] for name in ("k_w", "m_w")]
    assert values == pytest.approx([4e5, 6.0], rel=0.05)
    assert [text.partition("=")[0] for text in found.over] == ["k_w", "m_w"]
    about = json.loads((rubbed / "60N/result.json").read_text())
    about["friction"] |= {"workpiece_N": 4.0, "workpiece_slides": True}
    shutil.copytree(rubbed / "60N", tmp_path / "60N")
    (tmp_path / "60N/result.json").write_text(json.dumps(about))
    with pytest.raises(Refusal, match="4 N under the workpiece") as refused:
        design._identified(order, [folders[0], str(tmp_path / "60N")], ())
    assert refused.value.name == "friction"


@pytest.mark.long
def test_a_friction_that_the_model_has_keeps_its_place(rubbed, press, tmp_path):
    """12 N where the model has 3."""
    folder = rubbing_press(press, tmp_path / "declared", seals=3.0)
    model = folder / "model.toml"
    found = friction_models.frictions_of(model, 12.0, 0.0)
    assert [(rub.name, rub.newton) for rub in found] == [("seals", 12.0)]
    done = identified(model, rubbed / "60N", "--fit", "k_w=6e5", "--fit", "m_w=5", "--json")
    (one,) = json.loads(done.stdout)["friction"]["freed"]
    assert one["name"] == "seals" and one["declared"]
    assert one["newton"] == pytest.approx(12.0, rel=0.05)
    assert json.loads(done.stdout)["friction"]["lines"] == ""


@pytest.mark.long
def test_a_response_without_its_file_has_a_damper_but_no_newtons(press, rubbed, tmp_path):
    shutil.copytree(rubbed / "free", tmp_path / "free")
    (tmp_path / "free/result.json").unlink()
    words = (press / "model.toml", tmp_path / "free", "--fit", "m_axis")
    done = identified(*words)
    assert done.returncode == 0, done.stderr
    assert "N s/m between axis and ground in this response\n" in done.stdout
    assert "model lacks" not in done.stdout and "rejected" not in done.stdout


def test_a_workpiece_that_rubs_is_refused_by_identify_fit(press, tmp_path):
    """Noise in which it slides by halves would give a mass that is twice too large."""
    hidden = rubbing_press(press, tmp_path / "hidden", table=2.0)
    done, _ = measured(hidden, press / "model.toml", 100.0)
    result.write(done["100N"], tmp_path / "out", draw=False)
    done = identified(press / "model.toml", tmp_path / "out", "--fit", "k_w=6e5", "--fit", "m_w")
    assert done.returncode == 1
    said = done.stderr.splitlines()
    assert said[0] == "to be added to the model:"
    (table,) = tomlkit.parse("\n".join(said[1:-1]))["friction"]
    assert table["between"] == ["workpiece", "ground"]
    assert table["coulomb"] == pytest.approx(2.0, rel=0.2)
    assert said[-1].startswith("forceaxis: friction: ") and " N under the workpiece" in said[-1]


WORN = (
    "--guide-coulomb-n", "40", "--backlash-mm", "0.05", "--transmission-stiffness-n-per-m", "2e7",
    "--sensor-full-scale-n", "320", "--sensor-noise-n", "0.3",
    "--workpiece-stiffness-n-per-m", "4e5", "--workpiece-mass-kg", "4",
)  # fmt: skip


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    """A press of `forceaxis new` whose guide rubs, which its model has, and whose gear has play."""
    folder = tmp_path_factory.mktemp("worn")
    done = verbs.forceaxis("new", "press", *WORN, "--yes", "--no-design", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "press"


def test_a_motor_in_the_play_of_its_gear_is_at_rest_and_its_friction_found(worn, tmp_path):
    """Nothing holds the motor of a disabled axis: it goes to and fro in the play, 20 counts, for
    seconds. And an integral needs seconds to overcome the friction, while the reading stands."""
    order = {"forces": (30.0, 120.0), "force_max_N": 250.0}
    said = []
    with Axis(SimLink(worn / "contact.toml")) as axis:
        work = tuning(worn, axis, tmp_path / "out", said.append, **order)
        work.run("check")
        assert any(line.startswith("mode ") and "seals slides" in line for line in said)
        work.run("free")
        assert tune_measure.moving_N(work, tune.FREE.result(work)) == pytest.approx(40.0, rel=0.05)
        checked = tune.CHECK.result(work)
        law = tune_measure.objects_of(work, checked, checked.law.bank, {})
        law |= tune_measure.force_objects(work)
        tune_measure.disable(axis)
        with (
            tune_measure.temporary(axis, law),
            tune_measure.analyzer_of(work) as measures,
        ):
            assert measures.press(18.0) == pytest.approx(18.0, rel=0.05)


def test_a_rigid_workpiece_never_sticks(tmp_path):
    """A workpiece that is no body of the model has no friction: its force changes slowly, the axis
    moves by the spring in the contact only, and the measurement goes on."""
    noisy = ("--sensor-noise-n", "0.5")
    done = verbs.forceaxis("new", "press", *noisy, "--yes", "--no-design", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = []
    order = {"forces": (30.0, 100.0), "force_max_N": 200.0, "over": ("k_s=20%",)}
    with Axis(SimLink(tmp_path / "press/contact.toml")) as axis:
        work = tuning(tmp_path / "press", axis, tmp_path / "out", said.append, **order)
        for step in ("check", "free", "measure"):
            work.run(step)
    assert any("no friction under the workpiece" in line for line in said)
    assert tune.MEASURE.result(work).shaken is None


def test_a_model_whose_friction_is_a_parameter_loses_that_with_it(worn, tmp_path):
    """A model refuses a parameter that nothing refers to."""
    model = worn / "model.toml"
    rubs = friction_models.frictions_of(model, 35.0, 0.0)
    assert [(rub.name, rub.newton, rub.declared) for rub in rubs] == [("seals", 35.0, True)]
    for text in (friction_models.damped(model, rubs), friction_models.with_friction(model, rubs)):
        (tmp_path / "model.toml").write_text(text)
        left = linear.facts(tmp_path / "model.toml").parameters
        assert "coulomb" not in left and {"play", "k_trans", "k_torque"} <= left.keys()


def test_responses_in_which_the_play_opens_are_left_out_of_the_fit(worn, tmp_path):
    """Apart and with 30 N the friction of 40 N is more than what presses the load back."""
    order, said = {"forces": (30.0, 120.0), "force_max_N": 250.0}, []
    with Axis(SimLink(worn / "contact.toml")) as axis:
        work = tuning(worn, axis, tmp_path / "out", said.append, **order)
        for step in STEPS:
            work.run(step)
    assert "left out, because the backlash of the gear opens: free, 30N" in said
    # The amplitude rises from that at which the axis slides, and is never far beyond the bounds.
    levels, glide = tune.MEASURE.result(work).levels, tune.FREE.result(work).glide
    tried = [int(found[1]) for text in said if (found := re.match(r"ended_\w+ at (\d+) ", text))]
    slides = friction.NOISE_SLIDES * glide.dead_zone + 1
    assert max(tried) <= max(slides, 2 * max(level.amplitude for level in levels.values()))
    assert 0.5 < levels["120N"].swing / 120 < 0.9
    assert any("backlash of the gear opens at free, 30N" in line for line in work.summary().holds)
    values = tune.FIT.result(work).values
    assert (values["k_w"], values["m_w"]) == pytest.approx((4e5, 4.0), rel=0.1)
    (rub,) = tune.FIT.result(work).friction
    assert (rub.name, rub.declared) == ("seals", True)
    assert rub.newton == pytest.approx(40.0, rel=0.05)
    # Dampings, which a response cannot tell from friction: half to twice what the model has.
    given = linear.facts(worn / "model.toml").parameters
    low, high = (one["b_s"] / given["b_s"][0] for one in tune.FIT.result(work).together)
    assert low <= 0.5 and high == pytest.approx(2.0)
    assert tune.FIT.result(work).values["b_s"] == low * given["b_s"][0]
    assert any(line.startswith("designed for b_s from") for line in said)
    measured = json.loads((tmp_path / "out/measure.json").read_text())
    for level in measured["result"].values():
        level["bias_N"] = 30.0
    (tmp_path / "out/measure.json").write_text(json.dumps(measured))
    with Axis(SimLink(worn / "contact.toml")) as axis:
        work = tuning(worn, axis, tmp_path / "out", **order)
        with pytest.raises(Refusal, match="give a force of 60") as refused:
            work.run("fit")
    assert refused.value.name == "play"


@pytest.fixture(scope="module")
def voice_coil(tmp_path_factory):
    """A level axis on a current loop, whose guide takes 2 N."""
    given = dict(
        drive="torque", motor="linear", force_constant_n_per_a=22, motor_peak_current_a=6,
        moving_mass_kg=1.6, guide_damping_n_s_per_m=6, guide_coulomb_n=2, current_loop_hz=800,
        sensor_full_scale_n=150, sensor_stiffness_n_per_m=5e5, sensor_noise_n=0.05,
        encoder_counts_per_mm=2000, workpiece_stiffness_n_per_m=1.5e4, workpiece_mass_kg=0.2,
        approach_mm=10,
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("coil") / "coil"
    new.write(folder, *data_sheet.collect({key: str(value) for key, value in given.items()}))
    return folder


@pytest.mark.parametrize("gain", [0.1, 0.4])
@pytest.mark.parametrize("travel", [900, 3000])
def test_a_motion_apart_may_begin_beside_its_place(voice_coil, gain, travel):
    """Dry friction stops a proportional position law 80 or 300 counts beside the begin."""
    place = SimLink(voice_coil / "contact.toml", [f"firmware.position_gain={gain}"])
    newton = known.newton_per_code(voice_coil / "model.toml")
    with Axis(place) as axis:
        axis.acquire()
        axis.set(first_motion_test="off", position_window=2000)
        order = MeasuringOrder(force_max_N=100.0, travel=travel)
        with Analyzer(axis, order, voice_coil / "model.toml") as analyzer:
            analyzer.rest()
            found = friction.glide(analyzer, 256)
    assert found.dead_zone * newton == pytest.approx(2, rel=0.25)


def test_a_force_that_friction_moves_to_and_fro_says_so(tmp_path):
    """A stepper with a slow sensor, whose guide takes half of the smallest force that the search
    presses with: the integral action of the law does not come to rest."""
    given = dict(
        drive="stepper", holding_torque_n_m=0.9, rotor_inertia_kg_m2=2.8e-5, lead_mm_per_rev="none",
        pulley_radius_mm=2.0, efficiency=0.85, transmission_stiffness_n_per_m=1.8e5,
        backlash_mm=0.04, moving_mass_kg=2.4, guide_coulomb_n=3, full_scale_speed_m_per_s=0.03,
        sensor_full_scale_n=50, sensor_stiffness_n_per_m=2.5e5, sensor_bits=12, sensor_rate_hz=100,
        sensor_noise_n=0.02, workpiece_stiffness_n_per_m=6e5, workpiece_mass_kg=1.5, approach_mm=4,
    )  # fmt: skip
    folder = tmp_path / "slide"
    new.write(folder, *data_sheet.collect({key: str(value) for key, value in given.items()}))
    order = tune.TuningOrder(
        str(folder / "model.toml"), (10.0, 25.0), ("k_w=30%",), force_max_N=45.0
    )
    with Axis(SimLink(folder / "contact.toml", drawn_axes.DELIVERED)) as axis:
        work = tune.Tuning(axis, order, tmp_path / "out")
        for step in ("check", "free"):
            work.run(step)
        with pytest.raises(Refusal, match=r"contact: .* reduce the friction .* larger `forces`"
                           ) as refused:  # fmt: skip
            work.run("measure")
    said = r"with a set-point of (\S+) N the force was at last (\S+) to (\S+) N"
    target, low, high = map(float, re.search(said, refused.value.text).groups())
    assert low < target < high and high - low > 0.05 * target
    # The drive integrates itself, so the same command measures with a law without integral.
    assert refused.value.law.bank.integral_rad_per_s == 0
    assert refused.value.law.bank.force_gain > 0


def test_a_distortion_that_stays_ends_the_search_for_another_amplitude():
    """With dry friction, the distortion counted as noise; a bound of the force that the same
    amplitude then exceeded began the search again, for ever."""
    tried = []

    def realisations(level, _):
        tried.append(level.amplitude)
        assert len(tried) < 50
        if not work._takes_distortion:
            level.distorted = 100.0
            raise analyzer.Ended("distorted")
        if level.amplitude > 64:
            raise analyzer.Ended("ended_force")
        raise LookupError  # the responses are taken

    reduced = lambda level, amplitude, ended: amplitude // 2  # noqa: E731
    work = SimpleNamespace(
        _reductions_max=6, _realisations=realisations, _takes_distortion=False, _reduce=reduced,
        say=lambda text: None,
    )  # fmt: skip
    with pytest.raises(LookupError):
        analyzer.Analyzer._measure(work, SimpleNamespace(amplitude=256, distorted=0.0), None)
    assert tried == [256, 128, 256, 128, 64]
