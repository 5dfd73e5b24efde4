"""Vertical axes drawn by chance, through the verbs of a user: check, move, press with a retract,
press cycle. Weights as the model says, wrong by a fifth, of a counterbalance, of the wrong sign:
the axis does what the same axis does level, or is refused, and never falls.

FORCEAXIS_VERTICAL=50 tries so many of each kind of drive.
"""

import dataclasses
import functools
import itertools
import json
import math
import os
import re
from types import SimpleNamespace

import drawn_axes
import drawn_machines
import pytest
import verbs
from forceaxis import linear
from forceaxis.axis import actions
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer
from forceaxis.axis.sim import SimLink
from forceaxis.commission import as_found, contact, known, machine_bounds, tune, tune_measure
from forceaxis.commission.check import MotionCheck
from forceaxis.commission.refusal import Refusal
from forceaxis.cycles import live
from forceaxis.design import data_sheet, new

KINDS = ("voice_coil", "torque", "linear", "velocity", "amplifier")
COUNT = int(os.environ.get("FORCEAXIS_VERTICAL", "1"))
# {name: (true weight over that of the data sheet, weight over it that the model has)}
WEIGHTS = {
    "right": (1.0, 1.0), "light": (0.8, 1.0), "heavy": (1.2, 1.0), "counterbalance": (-0.6, -0.6),
    "wrong sign": (1.0, -1.0),
}  # fmt: skip
CYCLE = """
title = "A held force"
number = 1
[[phase]]
name = "approach"
do = "approach"
distance = "{reach} mm"
speed = "{speed} mm/s"
force_max = "{most} N"
travel_max = "{travel} mm"
time_max = "60 s"
on_limit = "retract"
[[phase.end]]
when = "contact"
next = "press"
[[phase]]
name = "press"
do = "press"
force = "{force} N"
slope = "{slope} N/s"
force_max = "{most} N"
travel_max = "{travel} mm"
time_max = "10 s"
on_limit = "retract"
[[phase.end]]
when = "time"
value = "2 s"
next = "retract"
[[phase]]
name = "retract"
do = "move_to_depth"
distance = "-{back} mm"
speed = "{speed} mm/s"
force_max = "{most} N"
travel_max = "{travel} mm"
time_max = "60 s"
[[phase.end]]
when = "reached"
next = "end"
[[element]]
name = "held"
kind = "envelope"
phases = ["press"]
over = "time"
from = "1.5 s"
to = "1.9 s"
lower_x = [0, 3]
lower_force = ["{low} N", "{low} N"]
upper_x = [0, 3]
upper_force = ["{most} N", "{most} N"]
"""


class Session:
    """An axis as delivered, with the weight that its model has, and a twin of it that lies level:
    the same files, and no gravity."""

    def __init__(self, folder, machine, first, true, model):
        self.machine, self.folder = machine, folder
        self.force_N = float(f"{first.setpoint_N:.4g}")
        sheet = known.weight(folder / "model.toml")
        self.weight = dataclasses.replace(sheet, newton=model * sheet.newton)
        self.true_N = true * sheet.newton
        self.wrong_N = (true - model) * sheet.newton
        acceleration = linear.facts(str(folder / "model.toml")).parameters["g_axis"][0]
        # Somebody who checks an axis leaves it room to fall until its brake holds, and more.
        self.room_mm = machine.number("approach_mm") + 5e3 * sheet.fall_m
        self.axis = Axis(SimLink(folder / "contact.toml", [
            f"g_axis={true * acceleration!r}", f"approach={1e-3 * self.room_mm!r}",
            "firmware.output_bias=0", "firmware.brake_engage_ticks=0",
        ]))  # fmt: skip
        self.axis.acquire()
        self.live = self.axis.link.axis
        self.counts_per_mm = 1e-3 * self.axis.link.counts_per_metre
        self.place = self.axis.integer("position")
        self.done = {}

    def check(self):
        run = MotionCheck(self.axis, weight=self.weight)
        run.run(lambda text: True)
        # The largest distance that the text of the command says.
        self.span = max(run.travel, 8 * run.known.first_motion_counts) + 20
        return {step.step: step for step in run.steps}

    def move(self):
        """2 mm away from the workpiece; the error in mm."""
        target = self.axis.integer("position") - round(2 * self.counts_per_mm)
        place = actions.move(self.axis, target, counts=100).position
        return (place - target) / self.counts_per_mm

    def press(self):
        order = actions.PressOrder(
            seconds=2.0, approach_s=60.0, force_max=f"{self.most_N} N", retract="2 mm"
        )
        return actions.press(self.axis, actions.Force(self.force_N, True), order)

    def cycle(self):
        """The state of the part, in a program that presses and goes back."""
        reach = 10 + self.room_mm
        speed = self.axis.number("approach_velocity_max") / self.counts_per_mm
        file = self.folder / "cycle.toml"
        file.write_text(CYCLE.format(
            reach=reach, travel=2 * reach, speed=float(f"{speed:.3g}"), force=self.force_N,
            slope=10 * self.force_N,
            most=self.most_N, low=float(f"{0.1 * self.force_N:.3g}"), back=2,
        ))  # fmt: skip
        wanted = live.live_program(self.folder / "contact.toml", program=file)
        live.load(self.axis, wanted)
        return live.start(self.axis, wanted, 200.0) or self.axis.text("cycle_state")

    @property
    def most_N(self):
        return float(f"{2 * self.force_N + 0.15 * self.machine.full_N:.4g}")

    def falls(self, newton, speed=0.0):
        """Largest distance in counts of an axis that `newton` move until it has a speed in m/s, and
        then until its brake, which closes, has stopped it."""
        mass, t = (
            self.machine.number("moving_mass_kg"),
            self.machine.number("brake_engage_ms") / 1e3,
        )
        hold = (self.machine.number("brake_holding_n") - abs(self.true_N)) / mass
        a = max(abs(newton) / mass, 1e-9)
        speed += 2 * a / 1500  # a tick of twice the force
        way = speed**2 / (2 * a) + speed * t + a * t**2 / 2 + (speed + a * t) ** 2 / (2 * hold)
        return 1.01 * 1e3 * way * self.counts_per_mm + 2  # counts are rounded

    def expect_held(self, bound, toward=0.0):
        """The axis stands still, disabled, and was within `bound` counts of where it was when this
        was asked last, and of what it was asked to do."""
        assert self.axis.read("active_mode") == "disabled"
        self.axis.link.wait(0.3)
        rests = self.axis.integer("position")
        self.axis.link.wait(1.0)
        assert abs(self.axis.integer("position") - rests) <= 1
        reached = self.live.extremes
        assert reached["position_min_cnt"] >= self.place - bound
        assert reached["position_max_cnt"] <= self.place + bound + toward
        assert reached["force_N"] <= self.most_N
        self.place = rests
        self.live.reset_extremes()


CASES = [
    pytest.param(kind, number, name, id=f"{kind}-{number}-{name}")
    for kind, number, name in itertools.product(KINDS, range(COUNT), WEIGHTS)
]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A function that gives (folder, machine, what `forceaxis new` says, what it does level)."""
    folder, names = tmp_path_factory.mktemp("vertical"), itertools.count()

    @functools.cache
    def of(kind, number):
        """Without machines that are refused when they lie level, such as those whose sensor has
        more noise than contact_force, or whose first law does not reach the workpiece."""
        found = 0
        for seed in itertools.count():
            machine = drawn_machines.draw("vertical", seed, exact=True)
            if machine.drive != kind:
                continue
            place = folder / f"{kind}{number}-{seed}-{next(names)}"
            given = {key: str(value) for key, value in machine.sheet.items()}
            first = new.write(place, *data_sheet.collect(given))
            level = Session(place, machine, first, 0.0, 0.0)
            if any(step.verdict == "failed" for step in level.check().values()):
                continue
            try:
                done = level.move(), level.press(), level.cycle()
            except NoAnswer:  # its first law does not reach the workpiece
                continue
            if found == number:
                return place, machine, first, done
            found += 1

    return of


@pytest.mark.parametrize(("kind", "number", "name"), CASES)
def test_a_vertical_axis_does_what_a_level_one_does_or_is_refused(drawn, kind, number, name):
    folder, machine, first, level = drawn(kind, number)
    session = Session(folder, machine, first, *WEIGHTS[name])
    axis = session.axis
    axis.link.wait(0.2)
    session.live.reset_extremes()
    steps = session.check()
    # The bounds of the check. A wrong sign ends with a fault, at a speed that the check bounds.
    speed = 2e-3 * 1500 * axis.number("first_motion_speed") / session.counts_per_mm
    refused = name == "wrong sign" and session.weight.codes
    falls = session.falls(session.true_N, speed) if refused else session.falls(session.wrong_N)
    wide = session.span + falls
    failed = [step for step in steps.values() if step.verdict == "failed"]
    session.expect_held(wide)
    if refused:
        (step,) = failed
        assert step.step == "first motion" and "sign of output_bias" in step.text
        assert axis.read("output_bias") == 0
        return
    assert not failed, failed
    wrong = name in ("light", "heavy") and session.weight.codes
    assert steps["weight"].verdict == ("noted" if wrong else "passed"), steps["weight"]

    # From here on the bias holds the axis, but for its resolution and noise.
    code_N = session.weight.newton_per_code if session.weight.codes else 0.0
    fall = 20 + session.falls(0.03 * abs(session.true_N) + 3 * code_N)
    away, press, cycle = level
    assert session.move() == pytest.approx(away, abs=0.02)
    session.expect_held(2.1 * session.counts_per_mm + fall)
    reach = (4 + session.room_mm) * session.counts_per_mm + wide
    pressed = session.press()
    newton = machine.full_N / 128
    assert pressed.force_N == pytest.approx(press.force_N, abs=0.6 * newton)
    assert pressed.peak_N <= 1.1 * press.peak_N + newton
    session.expect_held(3 * session.counts_per_mm + fall, reach)
    assert session.cycle() == cycle
    session.expect_held(3 * session.counts_per_mm + fall, reach)


HEAD = dict(
    drive="torque", motor="linear", force_constant_n_per_a=22, motor_peak_current_a=6,
    moving_mass_kg=1.6, guide_damping_n_s_per_m=6, inclination_deg=-90, brake_holding_n=40,
    current_loop_hz=800, sensor_full_scale_n=150, sensor_stiffness_n_per_m=5e5, sensor_bits=16,
    sensor_noise_n=0.05, encoder_counts_per_mm=2000, workpiece_stiffness_n_per_m=1.5e4,
    workpiece_mass_kg=0.2, approach_mm=3,
)  # fmt: skip


def delivered_head(folder, share, **changed):
    """(model, link) of a head as delivered, whose weight is so many times that of its model."""
    given = {key: str(value) for key, value in (HEAD | changed).items()}
    new.write(folder / "head", *data_sheet.collect(given))
    model = folder / "head/model.toml"
    acceleration = linear.facts(str(model)).parameters["g_axis"][0]
    overrides = [f"g_axis={share * acceleration!r}", *drawn_axes.DELIVERED]
    return model, SimLink(model.with_name("contact.toml"), overrides, folder / "store.bin")


def tuning(axis, model, out, **changed):
    order = tune.TuningOrder(str(model), (20.0, 50.0), ("k_w=50%",), force_max_N=90.0)
    return tune.Tuning(axis, dataclasses.replace(order, **changed), out)


def light_head(folder, share, **changed):
    return delivered_head(
        folder, share, guide_damping_n_s_per_m=2.097, force_constant_n_per_a=17.26,
        motor_peak_current_a=8.368, torque_damping_n_s_per_m=41.53, brake_holding_n=10.76,
        brake_release_ms=20.93, brake_engage_ms=20.4, sensor_full_scale_n=29, sensor_bits=12,
        sensor_noise_n=0.005142, sensor_stiffness_n_per_m=94900,
        workpiece_stiffness_n_per_m=63150, approach_mm=15, **changed,
    )  # fmt: skip


@pytest.mark.parametrize(("share", "kg", "per_mm", "gain", "travel"), [
    (1.0, 0.3557, 2705, 0.09, 400), (0.8, 0.3557, 2705, 0.09, 400),
    (0.97, 0.3, 4000, 0.15, 1200), (1.03, 0.3, 4000, 0.12, 1500),
])  # fmt: skip
def test_a_light_axis_may_drift_by_half_a_step_of_its_output(
    tmp_path, share, kg, per_mm, gain, travel
):
    """0.36 kg and 12 bits of output: half a code accelerates it by 0.1 m/s^2, and in the 60 ms in
    which the first motion test has it stand, it moves by more than 100 counts of 0.4 um. After the
    check it also passes the test of the next power-up, where it had a fault and fell."""
    model, link = light_head(tmp_path, share, moving_mass_kg=kg, encoder_counts_per_mm=per_mm)
    asked = []
    with Axis(link) as axis:
        axis.acquire()
        axis.set(position_gain=gain, force_scale=29e6 / 128)
        run = MotionCheck(axis, travel, weight=known.weight(model))
        run.run(lambda text: asked.append(text) or True)
        assert run.passed, [one.text for one in run.steps if one.verdict == "failed"]
        # The person has confirmed the speed that the axis may have from now on.
        speed = axis.number("first_motion_speed")
        per_tick, per_s = re.search(r"(\S+) counts per tick \((\S+) counts/s\)", asked[0]).groups()
        assert float(per_tick) == speed > 16 and float(per_s) == 1500 * speed
        (weight,) = (one.text for one in run.steps if one.step == "weight")
        assert f"first_motion_speed {speed:g}" in weight
        axis.link.wait(1.0)
        here = axis.integer("position")
        axis.set(first_motion_test="on")
        axis.enable("native position", position_setpoint=here)
        axis.link.wait(0.5)
        assert axis.get("first_motion_result", "fault") == {
            "first_motion_result": "passed", "fault": "none",
        }  # fmt: skip
        assert abs(axis.integer("position") - here) < 1000


def test_a_tuning_of_a_light_axis_keeps_what_its_first_motion_test_needs(tmp_path):
    model, link = light_head(tmp_path, 0.97, moving_mass_kg=0.3, encoder_counts_per_mm=4000)
    with Axis(link) as axis:
        axis.set(position_gain=0.15, force_scale=29e6 / 128)
        before = axis.get("first_motion_counts", "first_motion_speed")
        work = tuning(axis, model, tmp_path / "out", forces=(3.0, 8.0), force_max_N=14.0)
        work.run("check")
        settings = tune.CHECK.result(work).settings
        assert all(settings[name] > value for name, value in before.items())
        assert axis.get(*before) == before  # until the law is written


@pytest.mark.parametrize(("share", "gain", "per_mm"), [
    (0.8, 0.08, 2000),  # 49 codes of the weight are 600 counts beside the target
    (0.8, 0.3, 5000), (1.2, 0.3, 5000),  # 8 counts a tick are 2.4 mm/s
])  # fmt: skip
def test_a_weight_is_learned_with_any_position_gain_and_encoder(tmp_path, share, gain, per_mm):
    model, link = delivered_head(tmp_path, share, encoder_counts_per_mm=per_mm)
    sheet = known.weight(model)
    with Axis(link) as axis:
        axis.set(position_gain=gain)
        run = MotionCheck(axis, weight=sheet)
        run.run(lambda text: True)
        assert run.passed, [one.text for one in run.steps if one.verdict == "failed"]
        assert axis.read("output_bias") == pytest.approx(share * sheet.codes, abs=2)


@pytest.mark.parametrize("share", [0.8, 1.2])
def test_a_tuning_measures_the_weight_before_it_moves_the_axis_in_open_loop(tmp_path, share):
    """With the output that holds the weight of the model, the axis moves by itself."""
    model, link = delivered_head(tmp_path, share)
    codes = share * known.weight(model).codes
    with Axis(link) as axis:
        before = axis.get("output_bias", "brake_engage_ticks", "first_motion_counts")
        start = axis.integer("position")
        work = tuning(axis, model, tmp_path / "out")
        work.run("check")
        settings = tune.CHECK.result(work).settings
        assert settings["output_bias"] == pytest.approx(codes, abs=2)
        assert axis.get(*before) == before  # until the law is written
        link.axis.reset_extremes()
        work.run("free")
        assert tune.FREE.result(work).glide.dead_zone < 1
        assert axis.get(*before) == before
        ends = [link.axis.extremes[f"position_{end}_cnt"] - start for end in ("min", "max")]
        assert max(map(abs, ends)) < machine_bounds.gap_counts(model)
        assert link.axis.extremes["force_N"] == 0


def test_a_refusal_after_the_law_was_written_puts_the_earlier_output_back(tmp_path):
    model, link = delivered_head(tmp_path, 1.2)
    with Axis(link) as axis:
        before = axis.get("output_bias", "brake_engage_ticks", "force_bank")
        work = tuning(axis, model, tmp_path / "out")
        work.run("check")
        checked = tune.CHECK.result(work)
        law = tune_measure.objects_of(work, checked, checked.law.bank, {})
        with as_found.restoring(work):
            with tune_measure.temporary(axis, checked.settings):
                pass
            tune.write(work, SimpleNamespace(objects=law), checked)
            assert axis.read("output_bias") == checked.settings["output_bias"]
            tune._restore_earlier_law(work)
        assert axis.get(*before) == before


def test_a_falling_axis_turns_its_rotor(tmp_path):
    """A ram of 62 kg on a screw of 1.6667 mm: its rotor is 10 t there, whether the screw is rigid
    or not, and the brake holds after 30 ms."""
    sheet = dict(
        drive="velocity", rotor_inertia_kg_m2=7.2e-4, lead_mm_per_rev=1.6667, moving_mass_kg=62,
        inclination_deg=-90, brake_holding_n=2500, brake_engage_ms=30, approach_mm=8,
    )  # fmt: skip
    moving_kg = 62 + 7.2e-4 / (1.6667e-3 / (2 * math.pi)) ** 2
    fall_m = 62 * 9.81 / moving_kg * 0.03**2 / 2
    for name, more in (
        ("rigid", {}),
        ("soft", {"transmission_stiffness_n_per_m": 1.8e8}),
        ("play", {"transmission_stiffness_n_per_m": 1.8e8, "backlash_mm": 0.02}),
    ):
        given = {key: str(value) for key, value in (sheet | more).items()}
        new.write(tmp_path / name, *data_sheet.collect(given))
        found = known.weight(tmp_path / name / "model.toml")
        assert found.newton == pytest.approx(62 * 9.81)
        assert found.fall_m == pytest.approx(fall_m, rel=1e-6), name
    assert 2.6e-5 < fall_m < 2.7e-5


def test_an_axis_that_could_fall_onto_its_workpiece_is_not_moved(tmp_path):
    """A fifth of the weight, which the damping of the drive slows down, falls by 4.4 mm until a
    brake of 0.3 s holds; the workpiece is at 3 mm."""
    model, link = delivered_head(tmp_path, 1.2, brake_engage_ms=300)
    values = {name: one.value for name, one in linear.facts(model).parameters.items()}
    with Axis(link) as axis:
        start = axis.integer("position")
        with pytest.raises(Refusal, match=r"at least (\S+) mm .* got 3 mm") as refused:
            tuning(axis, model, tmp_path / "out").run("check")
        assert refused.value.name == "weight"
        place = speed = 0.0
        for _ in range(3000):
            damping = values["b_axis"] + values["drive_damping"]
            speed += 1e-4 * (0.2 * 9.81 - damping / values["m_axis"] * speed)
            place += 1e-4 * speed
        least_mm = float(re.search(r"at least (\S+) mm", refused.value.text)[1])
        assert least_mm == pytest.approx(1e3 * place, rel=0.02) and 3 < least_mm < 10
        assert axis.integer("position") == start and link.axis.extremes["force_N"] == 0


def test_a_simulated_contact_holds_the_weight_of_its_own_plant(tmp_path):
    """The output that was measured holds the weight of the machine. That of the fit differs by a
    little, and what was left moved the simulated axis away from a light contact."""
    model, link = delivered_head(tmp_path, 1.2)
    heavier = {"m_axis": 1.1 * linear.facts(model).parameters["m_axis"].value}
    with Axis(link) as axis:
        work = tuning(axis, model, tmp_path / "out")
        work.run("check")
        checked = tune.CHECK.result(work)
        held = contact.firmware_of(work, checked, heavier)["output_bias"]
    assert held == pytest.approx(1.1 * known.weight(model).codes, abs=1)
    assert held != checked.settings["output_bias"]


def test_a_disabled_axis_takes_parameters_when_its_brake_has_engaged(tmp_path):
    _, link = delivered_head(tmp_path, 1.0)
    with Axis(link) as axis:
        axis.set(brake_engage_ticks=300, position_gain=1.0, first_motion_test="off")
        axis.enable("profile position")
        tune_measure.disable(axis)
        axis.set(force_scale=1e6)
        assert axis.read("force_scale") == 1e6


@pytest.mark.long
def test_tune_of_a_vertical_head_succeeds_at_its_first_command(tmp_path):
    """Its DAC has 12 bits, so that a part of the weight moves it in open loop."""
    given = {key: str(value) for key, value in HEAD.items()}
    new.write(tmp_path / "head", *data_sheet.collect(given))
    done = verbs.forceaxis(
        "tune", "--model", "head/model.toml", "--on", "sim:head/contact.toml", "--force", "20,50",
        "--force-max", "90", "--over", "k_w=50%", "--out", "tuned", "--json", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["refused"] is None
    # The promise is that of the worst plant of the set.
    assert 1 < found["Ms_verified"] < found["Ms_predicted"] + 0.15
