"""The examples of cycles: good parts are good, and each kind of bad part has its own reason."""

from pathlib import Path

import pytest
from forceaxis import _core

EXPERIMENTS = Path(__file__).resolve().parents[3] / "sim/experiments"
EXAMPLES = ("spring_test", "snap_fit", "leak_plug", "polishing")


def cycle_of(name, *overrides):
    return _core.run(EXPERIMENTS / f"{name}.toml", list(overrides)).cycle


def wrong(cycle):
    """The elements that are not good."""
    return {figure.name for figure in cycle.figures if figure.verdict != "good"}


def figure(cycle, name):
    return next(f.value for f in cycle.figures if f.name == name)


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_good_part_is_good(name):
    cycle = cycle_of(name)
    assert (cycle.state, cycle.outcome, wrong(cycle)) == ("good", "by_program", set())


@pytest.mark.parametrize(("name", "overrides", "outcome", "reasons"), [
    ("spring_test", ("gap=30 mm",), "by_program", {"force_1", "rate"}),  # no spring
    ("spring_test", ("k_coil=17 kN/m",), "by_program", {"force_3", "rate"}),  # too weak
    ("spring_test", ("k_coil=23 kN/m",), "by_program", {"force_1", "rate"}),  # too strong
    ("spring_test", ("solid=7 mm",), "over_force", {"force_3"}),  # too many coils
    ("snap_fit", ("k_arm=30 kN/m",), "by_program", {"arm"}),  # the arm is broken
    ("snap_fit", ("k_arm=120 kN/m",), "by_program", {"arm"}),  # wrong material
    ("snap_fit", ("k_slide=60 kN/m",), "by_program", {"slide"}),  # a burr at the edge
    ("snap_fit", ("seat=2.4 mm",), "by_program", {"click"}),  # dirt in the seat
    ("snap_fit", ("seat=9 mm",), "over_travel", {"click", "seated"}),  # no seat
    ("leak_plug", ("gap=30 mm",), "by_program", {"depth"}),  # no plug
    ("leak_plug", ("k_plug=15 kN/m", "k_relaxing=135 kN/m", "relaxation=1.5 s"), "over_travel",
     {"held"}),  # the plug leaks
    ("leak_plug", ("k_plug=300 kN/m",), "by_program", {"depth"}),  # too hard
    ("polishing", ("k_rim=60 kN/m",), "by_program", {"held"}),  # the fixture is loose
    ("polishing", ("k_felt=900 kN/m",), "by_program", {"held"}),  # the felt is worn
    ("polishing", ("gap=30 mm",), "by_program", {"held"}),  # no rim
])  # fmt: skip
def test_each_bad_part_has_its_reason(name, overrides, outcome, reasons):
    cycle = cycle_of(name, *overrides)
    assert (cycle.state, cycle.outcome) == ("bad", outcome)
    assert reasons <= wrong(cycle), wrong(cycle)


def test_the_forces_of_a_spring_are_those_of_its_stiffness():
    """Travel counts from 2 N, so the force at 3, 6 and 9 mm is 2 N and 20 N/mm of them."""
    cycle = cycle_of("spring_test")
    for number, travel_mm in enumerate((3, 6, 9), 1):
        assert figure(cycle, f"force_{number}") == pytest.approx(2 + 20 * travel_mm, abs=1.5)
    assert figure(cycle, "rate") == pytest.approx(20 * 4, rel=0.02)


def test_the_motion_of_a_snap_fit_ends_at_its_seat():
    """The stiffness rises from 8 to 1500 kN/m at 3 mm, and a section of it is 0.04 mm."""
    cycle = cycle_of("snap_fit")
    assert figure(cycle, "click") == pytest.approx(3.0e-3, abs=0.06e-3)
    # 0.6 mm of the arm, and 1.6 mm of the sliding hook.
    assert figure(cycle, "arm") == pytest.approx(0.6 * 80, rel=0.04)
    assert figure(cycle, "slide") == pytest.approx(1.6 * 8, rel=0.05)
