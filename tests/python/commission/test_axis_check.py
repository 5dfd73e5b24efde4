"""The guided first motion: a sound axis passes and is left as it was; each fault of an axis is
named before or while it moves, within the bounds that were announced."""

import json
import re
from pathlib import Path

import pytest
import verbs
from forceaxis import linear
from forceaxis.axis import actions, parameter_set
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.axis.sim import SimLink
from forceaxis.commission import known
from forceaxis.commission.check import MotionCheck, Move, MoveObjects
from forceaxis.design import data_sheet, new

ROOT = Path(__file__).resolve().parents[3]
GAINS = {"position_gain": 4.0, "velocity_gain": 20.0}
SPAN = 420  # 400 counts and what it may miss them by


@pytest.fixture
def experiment(tmp_path):
    """An experiment of the laboratory axis: model parameters, [firmware], further text, and text
    that is added to the model."""

    def write(given=None, firmware=None, more="", model_more=""):
        model = (ROOT / "sim/models/laboratory.toml").read_text()
        model = model.replace('"thesis.toml"', f'"{ROOT}/sim/models/thesis.toml"') + model_more
        (tmp_path / "model.toml").write_text(model)
        lines = ['title = "An axis"', 'model = "model.toml"', "duration_s = 100.0"]
        for table, values in (("set", given or {}), ("firmware", GAINS | (firmware or {}))):
            lines += [f"[{table}]", *(f"{n} = {json.dumps(v)}" for n, v in values.items())]
        file = tmp_path / "axis.toml"
        file.write_text("\n".join([*lines, more]))
        return file

    return write


def checked(file, wait_s=0.0, consent=lambda text: True, change=None, **options):
    """(Check, axis, largest way from the start) after a run."""
    axis = Axis(SimLink(file))
    axis.acquire()
    axis.link.wait(wait_s)
    if change:
        change(axis.link)
    axis.link.axis.reset_extremes()
    start = axis.read("position")
    axis.link.wait(0.001)
    run = MotionCheck(axis, **options)
    run.run(consent)
    seen = axis.link.axis.extremes
    way = max(seen["position_max_cnt"] - start, start - seen["position_min_cnt"])
    assert axis.read("drive_state") in ("switch_on_disabled", "ready_to_switch_on", "fault")
    return run, axis, way


@pytest.mark.parametrize(("values", "short"), [
    # a bus of 2 ms and the defaults of the axis
    ({"drive_cycle": 2}, {"cycle_age_max": 5, "drive_on_ticks_max": 9000}),
    ({"drive_cycle": 2, "cycle_age_max": 5, "drive_on_ticks_max": 9000}, {}),
    # 10 ms, of which docs/guide/your_drive.md has the values
    ({"drive_cycle": 10, "drive_wait": 300},
     {"position_age_max": 45, "cycle_age_max": 29}),
    ({"drive_cycle": 10, "position_age_max": 45, "cycle_age_max": 29, "drive_on_ticks_max": 9000},
     {}),
    ({"drive_cycle": 2, "cycle_age_max": 5, "drive_wait": 20000, "drive_on_ticks_max": 15000},
     {"drive_wait": 10000}),
])  # fmt: skip
def test_times_that_contradict_the_bus_of_the_drive_are_named(experiment, values, short):
    run, *_ = checked(
        experiment(firmware={"drive_node_id": 9} | values), consent=lambda text: False
    )
    (step,) = [step for step in run.steps if step.step == "drive times"]
    assert step.verdict == ("noted" if short else "passed")
    said = dict(re.findall(r"(\w+_max|drive_wait) .*?set it (?:to|below) (\d+)", step.text))
    assert {name: float(value) for name, value in said.items()} == short


def verdicts(run):
    return {step.step: step.verdict for step in run.steps}


def test_a_sound_axis_passes_and_is_left_as_it_was(experiment):
    file = experiment(firmware={"tare_band": 5.0, "force_zero_code": 0, "profile_enable": 0})
    before = parameter_set.read(Axis(SimLink(file)))
    asked = []
    run, axis, way = checked(file, consent=lambda text: asked.append(text) or True)
    assert run.passed, run.steps
    assert {step.verdict for step in run.steps} == {"passed", "noted"}
    noted = [step.step for step in run.steps if step.verdict == "noted"]
    assert noted == ["force scale", "force at rest"], "never set; no dither"
    assert 400 <= way <= SPAN and f"never more than {SPAN} counts" in asked[0]
    assert parameter_set.read(axis) == before
    found = {step.step: step for step in run.steps}
    assert found["first motion"].value == "passed" and abs(found["move"].value) <= 2
    assert found["force sensor"].value == 0 and found["force sensor"].limit == 255


@pytest.mark.parametrize("given", [{"force_scale": 2_400_000}, {"calibration_date": 15000}])
def test_a_scale_that_was_set_passes(experiment, given):
    run, _, _ = checked(experiment(firmware=given))
    scale = next(step for step in run.steps if step.step == "force scale")
    assert scale.verdict == "passed" and scale.value == given.get("force_scale", 2_500_000) * 1e-6


def test_a_noisy_reading_is_measured_in_codes(experiment):
    noisy = "per_count = 2.5\nzero_code = 128\nnoise = 2.5"  # N rms: a code
    file = experiment(firmware={"force_zero_code": 128, "contact_force": 20.0, "tare_noise": 20.0})
    model = file.with_name("model.toml")
    text, replaced = re.subn(r"per_count = .*\nzero_code = .*", noisy, model.read_text(), count=1)
    assert replaced == 1
    model.write_text(text)
    run, _, _ = checked(file)
    rest = next(step for step in run.steps if step.step == "force at rest")
    assert rest.verdict == "passed" and 0.95 < rest.value < 1.15  # the root of 1 + 1/12 is 1.04
    assert run.passed


def test_nobody_allows_it_to_move(experiment):
    run, _, way = checked(experiment(), consent=lambda text: False)
    assert run.passed and way == 0
    assert [verdicts(run)[name] for name in ("first motion", "move", "tare")] == ["skipped"] * 3


IN_CONTACT = (
    '\n[[friction]]\nname = "gib"\nbetween = ["robot", "ground"]\ncoulomb = 60\nstiction = 80\n'
)
PRESSED = {"approach": -0.0004, "force_zero_code": 128.0}
# Of the model, [firmware], the step that fails, its value.
MOVING = {
    "encoder reversed": ({"encoder_scale": -157480.3}, {}, "encoder_reversed"),
    "amplifier reversed": ({"k_preamp_cmd": -3.9}, {}, "encoder_reversed"),
    "encoder dead": ({"encoder_scale": 1e-6}, {}, "no_motion"),
    "motor dead": ({"k_torque": 1e-9}, {}, "no_motion"),
    "too fast": ({"encoder_scale": 1574803.0}, {"first_motion_counts": 4096}, "runaway"),
}


@pytest.mark.parametrize("name", MOVING)
def test_what_the_first_motion_finds_is_named(experiment, name):
    given, firmware, result = MOVING[name]
    file = experiment(given, firmware)
    before = parameter_set.read(Axis(SimLink(file)))
    run, axis, _ = checked(file)
    failed = [step for step in run.steps if step.verdict == "failed"]
    assert [(s.step, s.value) for s in failed] == [("first motion", result)]
    assert verdicts(run)["move"] == verdicts(run)["tare"] == "skipped"
    assert axis.read("fault") == result and axis.read("drive_state") == "fault"
    assert parameter_set.read(axis) == before


@pytest.mark.parametrize("sign", [1, -1])
def test_in_contact_the_sign_of_the_force_is_judged(experiment, sign):
    firmware = {"force_sign": sign, "force_zero_code": 128}
    file = experiment(PRESSED, firmware, model_more=IN_CONTACT)
    run, axis, _ = checked(file, wait_s=4.0)
    found = verdicts(run)
    assert found["zero"] == "noted" and axis.link.axis.extremes["force_N"] < 60
    if sign > 0:
        assert run.passed and found["move"] == "passed" and found["tare"] == "skipped"
    else:
        assert [s.value for s in run.steps if s.verdict == "failed"] == ["force_reversed"]


def at_start(what):
    return f"[[at]]\ntime_s = 0.0\nsensor = {{ force = {json.dumps(what)} }}\n"


def bits(value):
    """digital_inputs as of an axis that is wired so."""

    def change(link):
        read = link.read
        link.read = lambda names: (
            read(names) | ({"digital_inputs": value} if "digital_inputs" in names else {})
        )

    return change


SWITCHES = {"inputs_fitted": 6}
# What is seen at rest: [firmware], text of the experiment, change of the link, the step that fails.
RESTING = {
    "no gain": ({"position_gain": 0.0}, "", None, "position gain"),
    "sensor railed": ({}, at_start("high"), None, "force sensor"),
    "signed sensor at its lower end": ({"force_zero_code": 128}, at_start("low"), None,
                                       "force sensor"),
    "no room": ({"position_min": -1700, "position_max": -1500}, "", None, "limits"),
    "enable chain open": ({}, "", bits(0), "inputs"),
    "both limit switches": (SWITCHES, "", bits(7), "inputs"),
}  # fmt: skip


@pytest.mark.parametrize("name", RESTING)
def test_what_is_wrong_at_rest_keeps_the_axis_from_moving(experiment, name):
    firmware, more, change, step = RESTING[name]
    run, axis, way = checked(experiment(firmware=firmware, more=more), change=change)
    assert next(s.step for s in run.steps if s.verdict == "failed") == step
    assert [verdicts(run)[n] for n in ("first motion", "move", "tare")] == ["skipped"] * 3
    assert way == 0 and axis.read("first_motion_result") == "not_run"


def test_an_axis_that_moves_is_not_at_rest(experiment):
    run, _, _ = checked(experiment({"approach": -0.001}))
    assert verdicts(run)["encoder at rest"] == "failed" and not run.passed


def test_a_fault_comes_first(experiment):
    file = experiment({"k_torque": 1e-9})
    run, axis, _ = checked(file)
    again = MotionCheck(axis)
    again.run(lambda text: True)
    found = {step.step: step for step in again.steps}
    assert found["faults"].verdict == "failed" and found["faults"].value == "no_motion"
    assert found["first motion"].verdict == "skipped" and not run.passed


def test_a_limit_of_the_user_stays_in_force(experiment):
    run, axis, _ = checked(experiment(firmware={"output_limit": 20}))
    assert run.passed and axis.read("output_limit") == 20
    assert next(s.text for s in run.steps if s.step == "move").endswith("at most code 20")


def test_what_stands_in_the_way_ends_the_move(experiment):
    """No room away from the workpiece, which stands 1 mm, 157 counts, ahead."""
    run, axis, way = checked(experiment({"approach": 0.001}, {"position_min": -300}))
    failed = [(step.step, step.value) for step in run.steps if step.verdict == "failed"]
    assert failed == [("move", "force_max")] and way < 250
    assert axis.link.axis.extremes["force_N"] < 60 and axis.read("force_max") == 0


def test_a_limit_switch_that_is_on_turns_the_way_around(experiment):
    run, _, _ = checked(experiment(firmware=SWITCHES), change=bits(5))
    assert run.direction == 1 and run.passed
    assert next(s for s in run.steps if s.step == "inputs").text.endswith("switches negative")


def test_another_object_table_ends_the_check(experiment):
    def change(link):
        read = link.read
        link.read = lambda names: {n: 7 if n == "object_table_hash" else v
                                   for n, v in read(names).items()}  # fmt: skip

    run, _, way = checked(experiment(), change=change)
    assert [s.step for s in run.steps] == ["connection", "object table"]
    assert not run.passed and way == 0


@pytest.mark.parametrize("lost", [2, 100])
def test_what_cannot_be_restored_is_said(experiment, lost):
    """The link is lost for so many writes when the check disables the axis after the move."""

    def change(link):
        write, remaining = link.write, lost

        def failing(values):
            nonlocal remaining
            moved = link.axis.extremes["position_max_cnt"] - link.axis.extremes["position_min_cnt"]
            if moved > 300 and values == {"controlword": 6} and remaining:
                remaining -= 1
                raise NoAnswer("it does not answer")
            write(values)

        link.write = failing

    file = experiment()
    before = parameter_set.read(Axis(SimLink(file)))
    axis = Axis(SimLink(file))
    axis.acquire()
    axis.link.axis.reset_extremes()
    change(axis.link)
    run = MotionCheck(axis)
    run.run(lambda text: True)
    if lost == 2:
        assert run.passed and parameter_set.read(axis) == before
    else:
        assert verdicts(run)["restore"] == "failed" and verdicts(run)["tare"] == "skipped"


@pytest.mark.parametrize("after", [3, 12, 18, 20, 24])
def test_ctrl_c_restores_what_was_set(experiment, after):
    file = experiment()
    before = parameter_set.read(Axis(SimLink(file)))
    axis = Axis(SimLink(file))
    axis.acquire()
    write, count = axis.link.write, 0

    def interrupted(values):
        nonlocal count
        count += 1
        if count == after:
            raise KeyboardInterrupt
        write(values)

    axis.link.write = interrupted
    with pytest.raises(KeyboardInterrupt):
        MotionCheck(axis).run(lambda text: True)
    assert parameter_set.read(axis) == before and axis.read("drive_state") != "operation_enabled"


def test_the_verb(experiment):
    way = ("axis", "check", "--on", f"sim:{experiment()}")
    ran = verbs.forceaxis(*way)  # nobody can be asked
    assert ran.returncode == 0 and "skipped first motion" in ran.stdout
    ran = verbs.forceaxis(*way, "--yes", "--json", "--travel", "100", "--output", "100")
    found = json.loads(ran.stdout)
    assert ran.returncode == 0 and found["passed"] and ran.stderr == ""
    assert set(found["steps"][0]) == {"step", "verdict", "text", "value", "limit"}
    ran = verbs.forceaxis(*way, "--yes", "--set", "k_torque=1e-9")
    assert ran.returncode == 1 and "failed  first motion     no motion" in ran.stdout


def test_an_experiment_that_commands_its_axis_leaves_it_to_the_owner():
    """Its controlwords of [[at]] would enable the axis in the middle of the check."""
    ran = verbs.forceaxis("axis", "check", "--on", "sim:hold_biquad", "--yes")
    assert ran.returncode == 0 and "failed" not in ran.stdout, ran.stdout + ran.stderr
    axis = Axis(SimLink("sim/experiments/hold_biquad.toml"))
    axis.link.wait(0.1)  # nobody owns it
    assert axis.read("drive_state") == "operation_enabled"


# Vertical axes from data sheets. The head is a voice coil without friction, whose tool points down;
# the lift is a ball screw behind an analogue amplifier, which presses up. Far from the workpiece.
SHEETS = {
    "head": dict(
        drive="torque", motor="linear", force_constant_n_per_a=22, motor_peak_current_a=6,
        moving_mass_kg=1.6, guide_damping_n_s_per_m=6, inclination_deg=-90, brake_holding_n=40,
        current_loop_hz=800, sensor_full_scale_n=150, sensor_stiffness_n_per_m=5e5,
        sensor_noise_n=0.05, encoder_counts_per_mm=2000, workpiece_stiffness_n_per_m=1.5e4,
        workpiece_mass_kg=0.2, approach_mm=60,
    ),
    "lift": dict(inclination_deg=90, moving_mass_kg=20, brake_holding_n=400, approach_mm=60),
}  # fmt: skip


@pytest.fixture(scope="module")
def machines(tmp_path_factory):
    """{name: folder of the axis that `forceaxis new` has written}."""
    folder = tmp_path_factory.mktemp("machines")
    for name, sheet in SHEETS.items():
        given = {key: str(value) for key, value in sheet.items()}
        new.write(folder / name, *data_sheet.collect(given))
    return folder


def hanging(folder, name, share=1.0, **firmware):
    """(axis, its weight by the model) of a machine that weighs `share` of its model, as delivered:
    with output_bias 0."""
    model = folder / name / "model.toml"
    sheet = known.weight(model)
    mass_factor = linear.facts(str(model)).parameters["g_axis"][0]
    overrides = [f"g_axis={share * mass_factor!r}", "firmware.output_bias=0"]
    overrides += [f"firmware.{key}={value}" for key, value in firmware.items()]
    axis = Axis(SimLink(folder / name / "step.toml", overrides))
    axis.acquire()
    axis.link.wait(0.1)
    return axis, sheet


@pytest.mark.parametrize("name", SHEETS)
@pytest.mark.parametrize("share", [1.0, 0.8, 1.2, -0.6])
def test_the_weight_is_learned(machines, name, share):
    """Of a counterbalance that is heavier than the axis, too, if its model says so."""
    axis, sheet = hanging(machines, name, share)
    if share < 0:
        sheet = known.Weight(share * sheet.newton, sheet.newton_per_code)
    run = MotionCheck(axis, weight=sheet)
    run.run(lambda text: "holds its weight" in text)
    assert run.passed, run.steps
    codes = abs(share) * sheet.codes if share > 0 else sheet.codes
    assert axis.read("output_bias") == pytest.approx(codes, abs=2)
    (step,) = [step for step in run.steps if step.step == "weight"]
    wrong = share in (0.8, 1.2)
    assert step.verdict == ("noted" if wrong else "passed"), step
    said = [float(text) for text in re.findall(r"(\S+) N\b", step.text)]
    true_N = share * sheet.newton if share > 0 else sheet.newton
    assert said[0] == pytest.approx(true_N, rel=0.03)
    if wrong:  # both figures
        assert said[1] == pytest.approx(sheet.newton, rel=1e-3)


@pytest.mark.parametrize("name", SHEETS)
def test_a_weight_of_the_wrong_sign_is_refused(machines, name):
    axis, sheet = hanging(machines, name)
    run = MotionCheck(axis, weight=known.Weight(-sheet.newton, sheet.newton_per_code))
    run.run(lambda text: True)
    (failed,) = [step for step in run.steps if step.verdict == "failed"]
    assert failed.step == "first motion" and "sign of output_bias" in failed.text
    assert axis.read("output_bias") == 0 and axis.read("first_motion_test") == "off"


@pytest.mark.parametrize("name", SHEETS)
def test_without_its_weight_an_axis_is_asked_for_it(machines, name):
    axis, _ = hanging(machines, name)
    run = MotionCheck(axis)
    run.run(lambda text: True)
    (failed,) = [step for step in run.steps if step.verdict == "failed"]
    assert failed.value == "amplifier_offset" and "output_bias" in failed.text
    assert axis.read("output_bias") == 0


def test_the_offset_of_an_amplifier_is_no_weight(experiment):
    """A level axis: the offset is named, and stays for the amplifier."""
    model = ROOT / "sim/models/laboratory.toml"
    run, axis, _ = checked(experiment(), weight=known.weight(model))
    (step,) = [step for step in run.steps if step.step == "weight"]
    assert step.verdict == "passed" and axis.read("output_bias") == 0


@pytest.mark.parametrize("name", SHEETS)
@pytest.mark.parametrize("share", [1.0, 0.8, 1.2])
def test_with_its_bias_a_vertical_axis_does_what_a_level_one_does(machines, name, share):
    """Moves, presses and retracts; disabled, the brake holds it."""
    axis, sheet = hanging(machines, name, share)
    MotionCheck(axis, weight=sheet).run(lambda text: True)
    axis.link.wait(1.0)
    here = axis.integer("position")
    done = actions.move(axis, here + (-4000 if sheet.newton > 0 else 4000))
    assert done.state == "operation enabled"
    window = axis.read("position_window")
    assert abs(done.position - here) - 4000 == pytest.approx(0, abs=window)
    axis.link.wait(1.0)
    rests = axis.integer("position")
    axis.link.wait(2.0)
    assert axis.integer("position") == rests, "the brake holds"


def test_a_move_that_ends_beside_its_target_says_by_how_much(machines):
    """The position law holds the weight by an error, and the axis stands still."""
    axis, sheet = hanging(machines, "head")
    error = -sheet.codes / axis.number("position_gain")
    with pytest.raises(Refused, match="beside it") as refused:
        actions.move(axis, axis.integer("position") - 4000)
    said = re.search(r"stands (\S+) beside it", str(refused.value))
    assert float(said[1]) == pytest.approx(error, rel=0.02)


def test_the_tare_waits_for_a_motor_that_swings_within_the_backlash_of_its_gear(tmp_path):
    """The friction of the guide holds the load, and nothing damps the motor of a drive that is off:
    after the motion of the check it swings for seconds."""
    given = dict(
        drive="velocity", velocity_loop_hz=30, full_scale_speed_m_per_s=0.3, lead_mm_per_rev="none",
        torque_constant_n_m_per_a=0.35, rotor_inertia_kg_m2=4e-5, motor_peak_current_a=9,
        pulley_radius_mm=4, efficiency=0.92, transmission_stiffness_n_per_m=4.5e5,
        backlash_mm=0.06, moving_mass_kg=9.5, guide_coulomb_n=12, sensor_full_scale_n=250,
        sensor_stiffness_n_per_m=1.5e6, sensor_bits=16, sensor_noise_n=0.08,
        encoder_counts_per_rev=4096, workpiece_stiffness_n_per_m=8000, workpiece_mass_kg=0.3,
        approach_mm=6,
    )  # fmt: skip
    sheet = {key: str(value) for key, value in given.items()}
    new.write(tmp_path / "gantry", *data_sheet.collect(sheet))
    run, axis, _ = checked(tmp_path / "gantry/contact.toml")
    assert run.passed, run.steps
    assert [step.verdict for step in run.steps if step.step == "tare"] == ["passed"]
    assert axis.read("tare_state") == "done"


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory):
    """Folder of a vertical axis on a current loop, whose guide takes more than the position law
    pushes with at 20 encoder counts."""
    folder = tmp_path_factory.mktemp("rubbing") / "lift"
    sheet = dict(SHEETS["head"], guide_coulomb_n=2)
    new.write(folder, *data_sheet.collect({key: str(value) for key, value in sheet.items()}))
    return folder


@pytest.mark.parametrize("weighs", [True, False])
def test_dry_friction_that_holds_a_sound_axis_beside_its_targets_is_no_fault(rubbing, weighs):
    """The law is proportional: it pushes with less than the friction near the target. The text says
    how large the friction is; the weight is learned, of which friction is no part."""
    level = [] if weighs else ["g_axis=0", "firmware.output_bias=0"]
    axis = Axis(SimLink(rubbing / "contact.toml", level))
    axis.acquire()
    sheet = known.weight(rubbing / "model.toml")
    run = MotionCheck(axis, weight=sheet if weighs else None)
    run.run(lambda text: True)
    assert run.passed, run.steps
    found = {step.step: step for step in run.steps}
    assert found["move"].verdict == "noted" and abs(found["move"].value) > 20
    codes = float(re.search(r"dry friction of (\S+) codes", found["move"].text)[1])
    assert codes * sheet.newton_per_code == pytest.approx(2, rel=0.1)
    enough = float(re.search(r"; (\S+) would bring it within 20 counts", found["move"].text)[1])
    assert enough == pytest.approx(codes / 20, rel=0.05)
    if weighs:
        assert axis.read("output_bias") == pytest.approx(sheet.codes, abs=2)


@pytest.mark.parametrize(("errors", "rested", "codes"), [
    ((175, -175), True, 21), ((-175, 160), True, 21),
    ((400,), True, 0),  # blocked from the start
    ((200, 0), True, 0),  # blocked half-way
    ((60, 55), True, 0),  # a weight or an offset
    ((175, -60), True, 0),
    ((175, -175), False, 0),  # a slow loop that still creeps, or a limit
])  # fmt: skip
def test_only_equal_errors_at_both_ends_are_friction(errors, rested, codes):
    last = MoveObjects(0, 0, 0.0, "none", "none")
    assert Move(errors, (-140.0, -98.0), 140, last, rested).friction == codes
