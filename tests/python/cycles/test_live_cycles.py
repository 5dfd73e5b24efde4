"""Programs and parts of an axis on a connection, with the simulated axis."""

import dataclasses
from pathlib import Path

import pytest
from forceaxis import InputError
from forceaxis.axis import actions
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.bus.state_names import POWERED
from forceaxis.cli import cycle_text
from forceaxis.cycles import live, results

PRESS_FIT = Path(__file__).resolve().parents[3] / "sim/experiments/press_fit.toml"
SNAP_FIT = PRESS_FIT.with_name("snap_fit.toml")


@pytest.fixture
def axis():
    with Axis.sim(PRESS_FIT) as axis:
        yield axis


@pytest.fixture(scope="module")
def wanted():
    return live.live_program(PRESS_FIT)


def programs(axis):
    return axis.get("cycle_program_count", "cycle_program", "cycle_program_crc")


def test_a_program_is_loaded_and_selected(axis, wanted):
    loaded = live.load(axis, wanted)
    assert (loaded.number, loaded.programs, loaded.size_bytes) == (1, 1, len(wanted.program.record))
    assert int(loaded.crc, 16) == wanted.program.crc == axis.integer("cycle_program_crc")
    live.load(axis, live.live_program(SNAP_FIT))
    assert programs(axis) == {
        "cycle_program_count": 2, "cycle_program": 3,
        "cycle_program_crc": live.live_program(SNAP_FIT).program.crc,
    }  # fmt: skip


def test_the_axis_is_disabled_after_a_cycle(axis, wanted):
    live.load(axis, wanted)
    for number in (1, 2):
        live.start(axis, wanted)
        assert axis.text("cycle_state") == "good" and axis.integer("cycle_number") == number
        assert actions.state(axis).state not in POWERED


@pytest.mark.parametrize("byte", [0, 40, 200, -1])
def test_a_damaged_program_changes_nothing(axis, wanted, byte):
    live.load(axis, live.live_program(SNAP_FIT))
    before = programs(axis)
    record = bytearray(wanted.program.record)
    record[byte] ^= 1
    damaged = dataclasses.replace(wanted.program, record=bytes(record))
    with pytest.raises(Refused, match=r"refuses the program: (no program|wrong crc)"):
        live.load(axis, dataclasses.replace(wanted, program=damaged))
    assert programs(axis) == before


def test_a_program_for_another_axis_is_refused(axis, wanted):
    axis.set(rated_force=axis.number("rated_force") / 2)
    with pytest.raises(Refused, match=r"expected rated_force .* got"):
        live.load(axis, wanted)
    axis.set(rated_force=axis.number("rated_force") * 2, force_scale=axis.number("force_scale") * 2)
    with pytest.raises(Refused, match="expected force_scale within 1%"):
        live.load(axis, wanted)
    assert axis.integer("cycle_program_count") == 0


def test_no_cycle_starts_with_another_program(axis, wanted):
    live.load(axis, live.live_program(SNAP_FIT))
    with pytest.raises(Refused, match="`load_program`"):
        live.start(axis, wanted)


def test_a_cycle_that_is_waited_for_in_vain_is_aborted(axis, wanted):
    live.load(axis, wanted)
    with pytest.raises(NoAnswer, match=r"the end of the cycle within 0\.3 s"):
        live.start(axis, wanted, timeout_s=0.3)
    assert axis.get("cycle_state", "cycle_outcome") == {
        "cycle_state": "aborted", "cycle_outcome": "stopped",
    }  # fmt: skip


def test_a_part_that_a_fault_ends_names_the_fault_and_its_remedy(axis, wanted):
    live.load(axis, wanted)
    axis.set(force_max="100 N")
    record = results.press(axis, wanted)
    assert (record.state, record.outcome) == ("aborted", "stopped")
    assert record.notes == ["fault force_max: reset it before the next part"]
    shown = "\n".join(" ".join(row) for row in cycle_text.record_rows(record))
    assert "fault force_max: reset it before the next part" in shown
    axis.reset_fault()
    axis.set(force_max=0)
    assert results.press(axis, wanted).notes == []


def test_a_program_needs_a_number(tmp_path):
    text = (PRESS_FIT.parents[1] / "cycles/press_fit.toml").read_text()
    file = tmp_path / "cycle.toml"
    file.write_text(text.replace("number = 1\n", ""))
    with pytest.raises(InputError, match="number: expected the number of the program"):
        live.live_program(PRESS_FIT, program=file)
