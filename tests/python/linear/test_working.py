"""The mode that a model is linearised in where nobody names one: sliding, taken up, pressed."""

import math

import numpy as np
import pytest
import verbs
from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.linear import loops, over, working
from forceaxis.linear import system as linear

TICK = 1 / 1500
# A motor, a gear, a load on a guide, a sensor, a workpiece on a fixture: SI.
M1, M2, M3 = 12.0, 8.0, 3.0
K_GEAR, B_GEAR, K_SENSOR, B_SENSOR, K_FIXTURE, B_FIXTURE = 4e6, 900.0, 8e5, 150.0, 5e5, 60.0
B_GUIDE, FORCE_PER_VOLT = 400.0, 50.0
# Where a friction may be, by its ends; what is then one body.
PLACES = {
    "guide": ("load", "ground"),
    "bearing": ("motor", "ground"),
    "gear": ("motor", "load"),
    "bed": ("workpiece", "ground"),
}


def model(folder, frictions=(), play=None, coulomb=20.0, stiction=None, name="axis"):
    """The path of a model with frictions at PLACES; play: m of backlash in the gear."""
    bodies = [("motor", M1), ("load", M2), ("workpiece", M3)]
    lines = ['title = "a gear, a guide, a workpiece"']
    if frictions:
        lines += [
            "[parameters]",
            f'coulomb = {{ value = {coulomb}, unit = "N", source = "given" }}',
            f'stiction = {{ value = {stiction or coulomb}, unit = "N", source = "given" }}',
        ]
    for body, mass in bodies:
        start = "" if body == "workpiece" else "\nposition = -0.001"
        lines.append(f'[[body]]\nname = "{body}"\nmass = {mass}{start}')
    kind, width = ("spring", "") if play is None else ("backlash", f"\nwidth = {play}")
    lines += [
        f'[[{kind}]]\nname = "gear_spring"\nbetween = ["motor", "load"]\nstiffness = {K_GEAR}\n'
        f"damping = {B_GEAR}{width}",
        f'[[damper]]\nname = "rail"\nbetween = ["load", "ground"]\ndamping = {B_GUIDE}',
        f'[[spring]]\nname = "fixture"\nbetween = ["workpiece", "ground"]\n'
        f"stiffness = {K_FIXTURE}\ndamping = {B_FIXTURE}",
        f'[[contact]]\nname = "sensor"\nbetween = ["load", "workpiece"]\n'
        f"stiffness = {K_SENSOR}\ndamping = {B_SENSOR}",
    ]
    for place in frictions:
        near, far = PLACES[place]
        lines.append(
            f'[[friction]]\nname = "{place}"\nbetween = ["{near}", "{far}"]\n'
            'coulomb = "coulomb"\nstiction = "stiction"'
        )
    lines.append(
        f'[drive]\ntype = "perfect"\nbody = "motor"\nforce_per_volt = {FORCE_PER_VOLT}\n'
        '[encoder]\nbody = "motor"\nscale = 1e6\n'
        '[[adc]]\nchannel = 0\nsignal = "sensor.spring_force"\nper_count = 0.1\nbits = 12\n'
        "[dac]\nrange = 10.0"
    )
    path = folder / f"{name}.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def by_hand(hz, stuck=()):
    """N/V of the spring force in the sensor, by solving (M s^2 + B s + K) x = F at each frequency.
    Of a friction that sticks, its two ends move as one."""
    M = np.diag([M1, M2, M3])
    B = np.diag([0.0, B_GUIDE, B_FIXTURE])
    K = np.diag([0.0, 0.0, K_FIXTURE])
    for matrix, (i, j, value) in ((K, (0, 1, K_GEAR)), (B, (0, 1, B_GEAR)),
                                  (K, (1, 2, K_SENSOR)), (B, (1, 2, B_SENSOR))):  # fmt: skip
        matrix[np.ix_((i, j), (i, j))] += value * np.array([[1.0, -1.0], [-1.0, 1.0]])
    free = np.eye(3)  # columns: the motions that are left
    order = ["motor", "load", "workpiece"]
    for place in stuck:
        near, far = PLACES[place]
        i = order.index(near)
        if far == "ground":
            free[:, i] = 0.0
        else:
            j = order.index(far)
            free[:, i], free[:, j] = 0.0, free[:, i] + free[:, j]
    free = free[:, np.abs(free).sum(0) > 0]
    found = []
    for s in 2j * math.pi * np.atleast_1d(hz):
        whole = free.T @ (M * s**2 + B * s + K) @ free
        x = free @ np.linalg.solve(whole, free.T @ np.array([FORCE_PER_VOLT, 0.0, 0.0]))
        found.append(K_SENSOR * (x[1] - x[2]))
    return np.array(found)


HZ = np.array([0.7, 9.0, 44.0, 61.0, 130.0, 400.0])


@pytest.mark.parametrize("frictions", [(), ("guide",), ("bearing", "bed"), (*PLACES,)[:2]])
@pytest.mark.parametrize("play", [None, 2e-4])
def test_what_slides_is_the_plant_without_friction_and_play(tmp_path, frictions, play):
    """Sliding friction is a constant force, and of a gear whose play is taken up its spring is
    left: the response is that of the springs and dampers alone."""
    path = model(tmp_path, frictions, play)
    found = linear.linearise(path).response(HZ)
    assert found == pytest.approx(by_hand(HZ), rel=1e-9)
    loop = loops.force_loop(path)
    assert loop.limit().gain == loops.force_loop(model(tmp_path, name="plain")).limit().gain


def test_what_sticks_is_another_loop_or_none(tmp_path):
    """Under the workpiece and in the gear stuck friction makes two bodies one; the axis' own, stuck
    to the ground, leaves no path, so there is no loop and no member of a set."""
    path = model(tmp_path, ("guide", "gear", "bed"))
    for place in ("gear", "bed"):
        stuck = linear.linearise(path, modes={place: "stuck"}).response(HZ)
        assert stuck == pytest.approx(by_hand(HZ, (place,)), rel=1e-9)
    bearing = model(tmp_path, ("bearing",), name="bearing")
    for cut, place in ((path, "guide"), (bearing, "bearing")):
        assert not linear.linearise(cut, modes={place: "stuck"}).has_path()
    assert over.modes_all(bearing) == ({},)
    found = over.modes_all(path)
    assert found[0] == {} and found[3] == {"gear": "stuck", "bed": "stuck"}
    assert sorted(map(str, found[1:3])) == ["{'bed': 'stuck'}", "{'gear': 'stuck'}"]


def test_both_flanks_of_a_play_are_one_member_and_never_pressed_together(tmp_path):
    path = model(tmp_path, play=2e-4)
    low, high = ({f"gear_spring.{side}": "pressed"} for side in ("low", "high"))
    assert linear.linearise(path, modes=low).response(HZ) == pytest.approx(by_hand(HZ), rel=1e-9)
    assert linear.linearise(path, modes=high).response(HZ) == pytest.approx(by_hand(HZ), rel=1e-9)
    assert over.modes_all(path) == ({},)  # the open gap has no path
    open_gap = working.working(path, modes={"gear_spring.high": "apart"})
    assert open_gap.text == "gear_spring open, sensor pressed"


def test_an_open_play_is_no_member_although_the_machine_bed_moves_the_load(tmp_path):
    path = model(tmp_path, play=2e-4)
    text = path.read_text().replace('["load", "ground"]', '["load", "bed"]')
    text = text.replace('body = "motor"\nforce', 'body = "motor"\nreaction = "bed"\nforce')
    carried = '[[body]]\nname = "bed"\nmass = 100.0\n[[spring]]\nname = "feet"\n'
    carried += 'between = ["bed", "ground"]\nstiffness = 1e6\n'
    path.write_text(text.replace("[[backlash]]", f"{carried}[[backlash]]", 1))
    gap = {f"gear_spring.{side}": "apart" for side in ("low", "high")}
    assert linear.linearise(path, modes=gap).has_path()
    assert over.modes_all(path) == ({},)
    assert over.distinct(path, None, "reading", [{}, gap]) == ({},)


def test_a_friction_that_the_drive_cannot_break_loose_stays_stuck(tmp_path):
    """10 V of 50 N/V are 500 N; the gear's own stuck friction gets part of them."""
    assert [one.name for one in working.held(model(tmp_path, ("guide",), coulomb=499.0))] == []
    path = model(tmp_path, ("guide",), coulomb=501.0)
    assert [one.name for one in working.held(path)] == ["guide"]
    assert working.working(path).modes == {"guide": "stuck"}
    with pytest.raises(
        InputError,
        match=r"guide sticks, because the breakaway force 501 N exceeds the force of the drive",
    ):
        loops.force_loop(path)
    with pytest.raises(InputError, match=r"guide sticks, because the breakaway force 501 N"):
        over.modes_all(path)
    held = model(tmp_path, ("guide",), coulomb=20.0, stiction=600.0)
    assert working.working(held).modes == {"guide": "stuck"}
    # What a workpiece's clamp holds is a plant of its own.
    clamped = model(tmp_path, ("bed",), coulomb=5000.0)
    assert over.modes_all(clamped) == ({},)
    assert linear.linearise(clamped).response(HZ) == pytest.approx(by_hand(HZ, ("bed",)), rel=1e-9)


def test_a_value_that_changes_is_seen(tmp_path):
    """By --set, and in the file."""
    path = model(tmp_path, ("guide",))
    assert working.working(path).modes == {"guide": "forward"}
    assert working.working(path, {"coulomb": 700.0, "stiction": 700.0}).modes == {"guide": "stuck"}
    assert working.working(model(tmp_path, ("guide",), coulomb=700.0)).modes == {"guide": "stuck"}


def test_the_element_that_cuts_the_path_is_named(tmp_path):
    path = model(tmp_path, ("guide", "bed"), play=2e-4)
    for modes, said in (
        ({"guide": "stuck"}, r"while guide is stuck; `states` guide=forward gives a signal path"),
        (
            {"gear_spring.high": "apart"},
            r"while gear_spring.high is apart; `states` gear_spring.high=",
        ),
        (
            {"sensor": "apart"},
            r"while sensor is apart; `states` sensor=pressed gives a signal path",
        ),
    ):
        with pytest.raises(InputError, match=r"expected a signal path from drive.command.*" + said):
            loops.force_loop(path, modes=modes)


def test_a_run_that_never_slides_has_the_sliding_member_too(tmp_path):
    """A workpiece that stays stuck under a small force slides under a larger one."""
    model(tmp_path, ("bed",), coulomb=400.0)
    experiment = tmp_path / "run.toml"
    experiment.write_text(
        'title = "touch"\nmodel = "axis.toml"\nduration_s = 1.0\n[firmware]\nmode = "force"\n'
        "adc_bits = 12\nforce_gain = 1.0\nforce_setpoint = 20.0\n"
    )
    assert over.modes_visited(experiment) == ({}, {"bed": "stuck"})


def test_verbs_say_which_mode_they_took(tmp_path):
    path = str(model(tmp_path, ("guide", "bed"), play=2e-4))
    said = "guide slides, bed slides, gear_spring closed, sensor pressed"
    verb_names = ("limit", "rlocus", "nyquist", "step", "bode", "poles", "linearise", "modes")
    for verb, *more in [*((v,) for v in verb_names), ("limit", "--over", "stiction=20..30")]:
        done = verbs.forceaxis("loop", verb, path, *more)
        assert done.returncode == 0, done.stderr
        assert f"mode         {said}\n" in done.stdout, verb
    done = verbs.forceaxis("loop", "limit", path, "--mode", "bed=stuck")
    assert "guide slides, bed stuck, gear_spring closed, sensor pressed\n" in done.stdout
    plain = verbs.forceaxis("loop", "limit", str(model(tmp_path, name="plain")))
    assert "mode" not in plain.stdout  # nothing was chosen


def test_models_of_the_project():
    """The locked rotor of Fig 3.7 stays locked; the slides of 2.7 slide."""
    taken = {p.stem: working.working(p).modes for p in sorted(paths.MODELS.glob("*.toml"))
             if p.stem != "thesis"}  # fmt: skip
    assert {stem: modes for stem, modes in taken.items() if modes} == {
        "fig3_7": {"lock": "stuck"},
        "fig3_8": taken["fig3_8"],
        "nl_backlash": {"screw.high": "pressed"},
        "nl_friction": {"rail": "forward"},
        "nl_stick_slip": {"rail": "forward"},
        "nl_stiction": {"rail": "forward"},
    }


def test_a_code_is_an_input_beside_the_command_that_it_stands_for():
    """The input in DAC codes is the command in V times the V per code; other inputs keep theirs."""
    inputs = ("drive.code", "drive.command", "drive.tach")
    found = linear.linearise("fig4_19", inputs, ("drive.command", "reading"))
    volts = linear.facts("fig4_19").volts_per_code
    one = linear.linearise("fig4_19", ("drive.command", "drive.tach"), ("drive.command", "reading"))
    assert found.inputs == inputs
    for whole, part in ((found.B, one.B), (found.D, one.D)):
        np.testing.assert_array_equal(whole, np.column_stack([volts * part[:, 0], part]))
