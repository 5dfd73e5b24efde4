"""The guided first motion: a sound axis passes and is left as it was; each fault of an axis is
named before or while it moves, within the bounds that were announced."""

import json
import re
from pathlib import Path

import pytest
import verbs
from forceaxis.axis import parameter_set
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer
from forceaxis.axis.sim import SimLink
from forceaxis.commission.check import MotionCheck

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
