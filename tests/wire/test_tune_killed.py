"""`forceaxis tune` is killed in its steps, over a virtual CAN bus in real time. Then the axis is
disabled, nothing is half-written, and the same command goes on. The session: tune_session.py.

The commit draws the steps of a run: two of the three in which the command moves the axis, and one
other step. With FORCEAXIS_WHOLE=1, it is killed in every step.
"""

import json
import random
from pathlib import Path

import draws
import pytest
from forceaxis.commission.tune import STEPS
from steps import found_by
from tune_session import SETTINGS

SESSION = Path(__file__).parent / "tune_session.py"
pytestmark = pytest.mark.long  # two minutes of real time
KILLED = -9
MOVING = ("free", "measure", "verify")  # steps in which the axis is enabled
DRAWN = {
    *draws.some("kills in motion", MOVING, 2),
    *draws.some("kills at rest", [step for step in STEPS if step not in MOVING], 1),
}
# The steps in which the command is killed, in their order.
KILLS = [step for step in STEPS if step in DRAWN]


@pytest.fixture(scope="module")
def found(tmp_path_factory, vcan):
    folder = tmp_path_factory.mktemp("killed")
    yield from found_by(vcan, folder, 1800, SESSION, random.randrange(10**6), *KILLS)


@pytest.mark.parametrize("step", KILLS)
def test_a_kill_leaves_a_disabled_axis_and_nothing_half_written(found, step):
    killed = found[f"killed {step}"]
    assert killed["status"] == KILLED and killed["in_step"], found["seed"]
    # The heartbeat is missed after 1000 ms; reading, and a busy machine, add to it.
    assert killed["seconds"] < 2.0, found["seed"]
    assert killed["fault"] == ("heartbeat_lost" if killed["enabled"] else "none")
    assert killed["broken"] == []
    assert killed["force_bank"] == 0 or killed["bank_state_1"] == "valid"
    for line in killed["lines"]:
        assert not line.startswith("forceaxis: ")


def test_kills_met_an_enabled_axis(found):
    assert any(found[f"killed {step}"]["enabled"] for step in KILLS if step in MOVING)


def test_the_same_command_goes_on_and_finishes(found):
    assert found["status"] == 0, found["lines"]
    summary = json.loads(next(line for line in found["lines"] if line.startswith("{")))
    assert summary["stored"] and summary["refused"] is None
    assert set(summary["seconds"]) == set(STEPS)
    now = found["is"]
    assert now["drive_state"] in ("switch_on_disabled", "ready_to_switch_on")
    assert (now["fault"], now["force_bank"], now["bank_state_1"]) == ("none", 1, "valid")
    assert (now["certificate_state_1"], now["command_source"]) == ("fits", "canopen")
    assert now["consumer_heartbeat_1"] == 0


def test_kills_have_left_nothing_of_the_tool_but_the_law(found):
    """Of all parameters, the recorder and the excitation."""
    assert len(found["before"]) > 300
    # An approach that would strike is slowed down, and stays so with the law.
    slowed = found["is"]["approach_velocity_max"]
    assert slowed < SETTINGS["approach_velocity_max"]
    assert {n: found["is"][n] for n in SETTINGS} == SETTINGS | {"approach_velocity_max": slowed}
    changed = {n: (raw, found["after"][n]) for n, raw in found["before"].items()
               if found["after"][n] != raw}  # fmt: skip
    assert {"force_bank", "bank_crc_1"} <= changed.keys()
    assert {n: pair for n, pair in changed.items() if n not in found["law"]} == {}


def test_a_run_after_a_kill_resets_its_own_fault_and_says_so(found):
    says = "the previous run was killed: the fault heartbeat_lost that it left is reset"
    for step, after in zip(KILLS, (*KILLS[1:], None), strict=True):
        run = found[f"killed {after}"] if after else {"tries": 1, "lines": found["lines"]}
        if run["tries"] == 1:  # the one right after that kill
            assert (says in run["lines"]) == found[f"killed {step}"]["enabled"]
