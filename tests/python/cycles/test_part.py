"""One part: its phases with their times and ends, its elements with bounds, its plot."""

from pathlib import Path

import numpy as np
import pytest
from forceaxis import InputError, _core
from forceaxis.cycles import judge, part, plots
from forceaxis.cycles.program import is_within, read_program
from test_judge import TARED, TARED_ELEMENTS, simulated

PRESS_FIT = Path(__file__).resolve().parents[3] / "sim/experiments/press_fit.toml"
PROGRAM = PRESS_FIT.parents[1] / "cycles/press_fit.toml"


def phases(result):
    return [(span.name, span.why) for span in result.phases]


@pytest.fixture(scope="module")
def good():
    return part.run(PRESS_FIT)


def test_the_phases_follow_each_other_without_a_gap(good):
    result = good.result
    assert phases(result) == [
        ("approach", "contact"),
        ("join", "force_above 250 N"),
        ("seat", "time 0.8 s"),
        ("retract", "reached"),
    ]
    # The experiment starts the cycle at 0.1 s; the seat lasts 0.8 s.
    assert result.phases[0].begin_s == pytest.approx(0.1, abs=1.5e-3)
    seat = result.phases[2]
    assert seat.end_s - seat.begin_s == pytest.approx(0.8, abs=1e-9)
    for before, after in zip(result.phases, result.phases[1:], strict=False):
        assert after.begin_s == before.end_s


def test_the_times_are_those_of_the_simulated_press(good):
    """The approach takes 5 mm at 20 mm/s, and its ramp. The bearing then moves 4 mm at 5 mm/s, and
    its force rises by 40 N for each mm."""
    events = _core.run(PRESS_FIT).events
    touch_s = next(time for time, name, *_ in events if name == "bearing")
    assert 0 < good.result.phases[0].end_s - touch_s < 0.02  # contact_force is 4 N
    curve = good.curve
    join = curve.phase == 1
    slope = np.polyfit(curve.travel_m[join][200:900], curve.force_N[join][200:900], 1)[0]
    assert slope == pytest.approx(40e3, rel=0.02)
    assert curve.force_N[curve.phase == 1].max() >= 250
    assert curve.force_N[np.flatnonzero(curve.phase == 1)[-2]] < 250  # the phase ends at once


def test_the_elements_have_values_and_bounds(good):
    table = {figure.name: figure for figure in good.result.elements}
    assert [f.verdict for f in table.values()] == ["good"] * 5
    shoulder = table["shoulder"]
    assert (shoulder.least, shoulder.most, shoulder.unit) == (0.0038, 0.0043, "m")
    assert shoulder.value == pytest.approx(0.00401, abs=2e-5)
    assert (table["work"].least, table["work"].unit) == (0.3, "J")
    assert table["joining_force"].least is None and table["joining_force"].value == 1
    curve = good.curve
    assert table["seating_force"].value == pytest.approx(curve.force_N[curve.phase == 2].max())


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (["gap=30 mm"], [("approach", "reached"), ("retract", "reached")]),
        (
            ["joining_depth=9 mm", "k_bore=20 kN/m"],  # 140 N at the limit of 7 mm
            [("approach", "contact"), ("join", "travel_max exceeded"), ("retract", "reached")],
        ),
        (
            ["k_bore=140 kN/m", "joining_depth=9 mm"],
            [
                ("approach", "contact"),
                ("join", "force_above 250 N"),
                ("seat", "travel_max exceeded"),
                ("retract", "reached"),
            ],
        ),
        (
            ["experiment.duration_s=1.5"],
            [("approach", "contact"), ("join", "force_above 250 N"), ("seat", "the run ended")],
        ),
    ],
)
def test_other_parts_end_their_phases_otherwise(overrides, expected):
    result = part.run(PRESS_FIT, overrides).result
    assert phases(result) == expected


def experiment(folder, old="", new="", more=""):
    """A copy of the experiment with other text."""
    text = PRESS_FIT.read_text().replace('"../', f'"{PRESS_FIT.parents[1]}/')
    file = folder / "press_fit.toml"
    file.write_text(text.replace(old, new) + more)
    return file


def test_a_stop_ends_the_last_phase(tmp_path):
    stop = "\n[[at]]\ntime_s = 0.8\nfirmware = { controlword = 7 }\n"
    result = part.run(experiment(tmp_path, more=stop)).result
    assert result.state == "aborted"
    assert phases(result) == [("approach", "contact"), ("join", "stopped")]


def test_of_two_cycles_the_last_one_is_shown(tmp_path, good):
    more = "".join(
        f"\n[[at]]\ntime_s = {time_s}\nfirmware = {{ controlword = {word} }}\n"
        for time_s, word in ((2.6, 15), (2.7, 31))
    )
    result = part.run(experiment(tmp_path, more=more), ["experiment.duration_s=6"]).result
    assert phases(result) == phases(good.result)
    assert result.phases[0].begin_s == pytest.approx(2.7, abs=1.5e-3)


def test_a_run_without_a_cycle_has_no_phases(tmp_path):
    done = part.run(experiment(tmp_path, "controlword = 31", "controlword = 15"))
    assert (done.result.state, done.result.phases, done.curve) == ("idle", [], None)
    assert done.result.elements == []
    # The cycle starts with the last tick.
    assert part.run(PRESS_FIT, ["experiment.duration_s=0.1"]).result.phases == []


def test_another_program_replaces_that_of_the_experiment(tmp_path):
    file = tmp_path / "other.toml"
    file.write_text(PROGRAM.read_text().replace('most = "4.3 mm"', 'most = "3.9 mm"'))
    result = part.run(PRESS_FIT, [], file).result
    assert result.state == "bad"
    assert [f.verdict for f in result.elements][1] == "above"
    assert result.elements[1].most == 0.0039


def test_an_experiment_without_a_program_is_refused():
    other = PRESS_FIT.with_name("contact.toml")
    with pytest.raises(InputError, match=r"contact.toml: cycle: expected an experiment that names"):
        part.run(other)
    assert read_program(PRESS_FIT).file.resolve() == PROGRAM


def test_of_several_conditions_the_one_that_the_firmware_took_is_named(tmp_path):
    """Three conditions lead to the same phase; the axis records which one ended the phase."""
    text = PROGRAM.read_text()
    end = '[[phase.end]]\nwhen = "force_above"\nvalue = "250 N"\nnext = "seat"\n'
    others = [("time", "2.9 s"), ("depth_above", "2 mm"), ("force_above", "100 N")]
    more = "".join(
        f'[[phase.end]]\nwhen = "{when}"\nvalue = "{value}"\nnext = "seat"\n'
        for when, value in others
    )
    assert text.count(end) == 1
    file = tmp_path / "several.toml"
    file.write_text(text.replace(end, more + end))
    # 40 N for each mm: 80 N at 2 mm, and 100 N at 2 mm for 60 N/mm
    for k_bore, why in (("40 kN/m", "depth_above 2 mm"), ("60 kN/m", "force_above 100 N")):
        result = part.run(PRESS_FIT, [f"k_bore={k_bore}"], file).result
        assert phases(result)[1] == ("join", why)


def test_the_program_is_read_as_it_is_written():
    program = read_program(PRESS_FIT)
    assert [phase.name for phase in program.phases] == ["approach", "join", "seat", "retract"]
    window, _, work, force, seated = program.elements
    assert (window.x_from, window.x_to, window.least, window.most) == (0.002, 0.003, 80, 200)
    assert (work.unit, work.most) == ("J", 0.8)
    assert [is_within(force, N) for N in (390, 425, 425.01)] == [True, True, False]
    assert seated.lower == [(0, 390), (1, 390)] and seated.over == "time"


def test_the_plot_shows_what_a_part_is_judged_by(good):
    figure = plots.part(good)
    over_travel = figure.axes[0]
    named = [text.get_text() for ax in figure.axes for text in ax.texts]
    for name in ("joining force", "shoulder 3.8 to 4.3 mm", "seating force 390 to 425 N", "seated"):
        assert name in named
    (window,) = over_travel.patches
    assert window.get_xy() == pytest.approx((2, 80))
    assert (window.get_width(), window.get_height()) == pytest.approx((1, 120))
    labels = [text.get_text() for text in over_travel.get_legend().get_texts()]
    assert labels == ["approach", "join", "seat", "retract"]
    bad = plots.part(part.run(PRESS_FIT, ["k_bore=80 kN/m"]))
    named = [text.get_text() for ax in bad.axes for text in ax.texts]
    assert "joining force: wrong side" in named


@pytest.mark.parametrize(("zero", "at_20_N_mm"), [
    ("", 0.8), ('zero = "force"\nzero_force = "20 N"', 0.0),
])  # fmt: skip
def test_travel_counts_from_the_zero_of_the_program(tmp_path, zero, at_20_N_mm):
    """The stiffness of the spring is 20 N/mm. Travel 0 is at the contact, which has 4 N, or at
    20 N."""
    spring = PROGRAM.with_name("spring_test.toml").read_text()
    before = spring[spring.index("zero =") : spring.index("\n\n[[phase]]")]
    program = tmp_path / "spring.toml"
    program.write_text(spring.replace(before, zero, 1))
    curve = part.run(PRESS_FIT.with_name("spring_test.toml"), program=program).curve
    pressed = slice(0, int(np.argmax(curve.force_N > 40)))
    at_20_N = np.interp(20.0, curve.force_N[pressed], curve.travel_m[pressed])
    assert 1e3 * at_20_N == pytest.approx(at_20_N_mm, abs=0.1)


def test_the_curve_begins_with_the_first_sample_of_the_cycle(tmp_path):
    """A recording of the same axis is judged from its first sample on, and the tare of 0.1 s takes
    150 samples."""
    program = tmp_path / "tared.toml"
    program.write_text(TARED + TARED_ELEMENTS)
    overrides = ("firmware.tare_band=8", "force_noise=0.3 N", f"experiment.cycle={program}")
    curve = part.run(PRESS_FIT, overrides[:2], program).curve
    _, recorded = simulated("press_fit", overrides)
    judged = judge.judge(judge.JudgePress(PRESS_FIT, None, overrides), recorded, "part")
    assert judged.record.duration_s * 1500 == pytest.approx(len(curve.time_s))
    assert judged.phases[0].begin_s == pytest.approx(curve.time_s[0])
    spans = [(span.begin_s, span.end_s) for span in judged.phases]
    own = [curve.time_s[curve.phase == k] for k in range(len(spans))]
    np.testing.assert_allclose(spans, [(times[0], times[-1]) for times in own])
    assert np.count_nonzero(curve.phase == 0) == 150
