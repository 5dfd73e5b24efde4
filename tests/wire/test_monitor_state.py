"""What the monitor shows: the target of the mode in force, and events that stay readable."""

import dataclasses
import re

import pytest
from forceaxis.bus import lcm, messages, monitor_state, monitor_view

MODE = {
    "guarded move": -5,
    "native position": -4,
    "force counts": -1,
    "none": 0,
    "profile position": 1,
    "profile velocity": 3,
    "force": 4,
    "cyclic position": 8,
    "cyclic force": 10,
    "impedance": -8,
    "open loop": -2,
}


def watched(mode, **more):
    """An axis at 75 N of rated 100 N, of which 60 % are demanded by the law in force."""
    state = messages.axis_state_t()
    for name in state.__slots__:
        if isinstance(getattr(state, name), int):
            setattr(state, name, lcm.NOT_AVAILABLE)
    state.mode_display = mode
    state.rated_force_mN, state.force_scale_uN = 100_000, 2_500_000
    state.force_cnt_q8 = 30 * 256
    state.target_force_permille = 0  # written for another mode
    state.target_position_cnt, state.demand_position_cnt = 5000, 1234
    state.position_cnt = 1200
    state.more_name, state.more_value = list(more), list(more.values())
    axis = monitor_state.AxisWatch(1)
    axis.take_state(state, 1_000_000)
    return axis


@pytest.mark.parametrize("mode", ["force counts", "force", "cyclic force", "impedance"])
def test_the_target_of_a_force_mode_is_what_its_law_demands(mode):
    axis = watched(MODE[mode], force_demand=600)
    words = axis.words(1_000_000)
    assert words.target_force_N == pytest.approx(60)
    assert words.force_N == pytest.approx(75)
    assert words.target_position_cnt is None


@pytest.mark.parametrize(
    ("mode", "target"),
    [
        ("guarded move", 5000),
        ("profile position", 5000),
        ("cyclic position", 5000),
        ("native position", 1234),
        ("profile velocity", 1234),
        ("open loop", None),
        ("none", None),
    ],
)
def test_the_target_of_a_position_mode_is_no_force(mode, target):
    words = watched(MODE[mode], force_demand=600).words(1_000_000)
    assert words.target_force_N is None
    assert words.target_position_cnt == target


def test_a_log_without_the_demand_shows_no_wrong_target():
    assert watched(MODE["force counts"]).words(0).target_force_N is None
    assert watched(MODE["force"]).words(0).target_force_N == 0


def event(kind, text, number):
    message = messages.axis_event_t()
    message.kind, message.text, message.axis = kind, text, 1
    message.run_id, message.seq = 7, number
    return message


def test_a_repeated_command_is_one_line_and_others_stay():
    watch = monitor_state.Watch()
    done, fault = messages.axis_event_t.EVENT_DONE, messages.axis_event_t.EVENT_FAULT
    for n in range(1, 601):
        watch.take("AXIS_1_EVENT", event(done, "watchdog written", n).encode(), n)
    watch.take("AXIS_1_EVENT", event(fault, "fault overspeed", 601).encode(), 601)
    watch.take("AXIS_1_EVENT", event(fault, "fault overspeed", 602).encode(), 602)
    watch.take("AXIS_1_EVENT", event(done, "watchdog written", 603).encode(), 603)
    watch.take("AXIS_1_EVENT", event(done, "force_gain written", 604).encode(), 604)
    assert [dataclasses.astuple(event) for event in watch.events][-4:] == [
        (601, 1, False, "fault overspeed"),
        (602, 1, False, "fault overspeed"),
        (603, 1, False, "watchdog written x601"),
        (604, 1, False, "force_gain written"),
    ]
    assert len(watch.events) == 4


@pytest.mark.parametrize(
    ("more", "mm_per_count", "unit", "position"),
    [
        ({}, None, "count", 1200),
        ({}, 0.01, "mm", 12.0),
        ({"feed": 5000, "position_unit": 0xFA010000}, 0.01, "mm", 1.2),  # um, and no model's
        ({"feed": 5000, "position_unit": 0x00410000}, None, "deg", 1200),
        ({"feed": 5000}, 0.01, "user unit", 1200),
        ({"position_unit": 0xFA010000}, None, "count", 1200),  # without a feed counts are counts
    ],
)
def test_a_position_is_in_the_unit_that_the_axis_or_the_model_has(
    more, mm_per_count, unit, position
):
    axis = watched(MODE["profile position"], **more)
    axis.mm_per_count = mm_per_count
    words = axis.words(1_000_000)
    assert words.position_unit == unit
    assert words.position == pytest.approx(position)
    assert words.target_position == pytest.approx(position / 1200 * 5000)
    assert words.target_position_cnt == 5000


def test_units_come_first_and_codes_on_demand_each_with_what_it_counts():
    axis = watched(MODE["force"], force_demand=600)
    axis.state.dac_code, axis.state.command_code = 300, 400
    axis.state.velocity_cnt_per_s = 80
    axis.mm_per_count = 0.01
    words = axis.words(1_000_000)
    shown = "\n".join(str(line) for line in monitor_view.full(words, 60, False))
    for text in ("75.00 N target 60.0 N", "12.000 mm 0.80 mm/s", "1.953 V out 1.465 V"):
        assert text in shown
    shown = "\n".join(str(line) for line in monitor_view.full(words, 60, True))
    for text in (
        "30.00 force count target 60.0 %",
        "1 200 count 80 count/s",
        "400 code out 300 code",
    ):
        assert text in shown
    assert "encoder" in shown and not re.search(r"\b(N|mm|V)\b", shown)
    compact = [str(line) for line in monitor_view.compact(words, 34, True)]
    assert "force 30.00 enc 1 200 DAC 300" in compact[1]
