"""A drive that needs time to come on (`enable_ticks`): the axis waits for it, and begins as if it
had never waited; after drive_on_ticks_max it is drive_not_ready."""

import numpy as np
import pytest
from forceaxis import _core
from forceaxis.objects import BY_NAME
from protections import ENABLE, LABORATORY, NEAR, experiment, model_with, pressing

TRACE = "[trace]\nobjects = ['force_integral', 'profile_position', 'drive_report', 'active_mode']\n"
# A bank with an integral, reached by mode 4; and a position trajectory, profile position.
MODES = {
    "force": pressing("force_bank = 1\n[firmware.bank_1]\ngain = 0.75\nintegral_rad_per_s = 5"),
    "position": """position_gain = 4.0
velocity_gain = 20.0
modes_of_operation = 1
trajectory_velocity = "20 mm/s"
target_position = 4000
""",
}
START = "[[at]]\ntime_s = 0.04\nfirmware = { controlword = 31 }\n"
FITTED, ON = 1, 3


def trace(tmp_path, mode, keys, firmware="", sets=NEAR):
    plant = model_with(tmp_path, keys)
    text = experiment(firmware + MODES[mode], ENABLE + START, duration_s=2.0, sets=sets)
    file = tmp_path / "run.toml"
    file.write_text(text.replace(str(LABORATORY), plant.name) + TRACE)
    return _core.run(str(file)).columns()


def first(condition):
    return int(np.flatnonzero(condition)[0])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("ticks", [2, 45, 599])
def test_law_and_trajectory_wait_for_the_drive(tmp_path, mode, ticks):
    late = trace(tmp_path, mode, f"enable_ticks = {ticks}")
    begin = first(late["out"] != 0)
    on = first(late["drive_report"] == ON)
    assert on == begin + ticks
    waits = slice(begin, on)
    assert (late["drive_report"][:on] == FITTED).all()
    assert (late["out"][waits] == 1).all(), "the amplifier is on, the brake is engaged"
    for column in ("dac", "force_integral", "active_mode"):
        assert not late[column][waits].any(), column
    assert (late["profile_position"][waits] == late["encoder"][waits]).all()
    assert late["out"][on] == 3
    assert late["dac"][on : on + 300].any()


def test_force_is_controlled_as_if_the_axis_had_not_waited(tmp_path):
    """A drive that needs no time is known to be on a tick after it was enabled."""
    soon, late = (trace(tmp_path, "force", f"enable_ticks = {ticks}") for ticks in (0, 200))
    begin = first(soon["out"] != 0)
    assert first(soon["out"] == 3) == begin + 1
    for column in ("dac", "encoder", "adc0", "force_integral"):
        assert (soon[column][begin + 1 : -199] == late[column][begin + 200 :]).all(), column
    assert late["force_integral"].max() > 1
    assert late["adc0"][-1] == 30


def test_a_drive_that_reports_and_needs_no_time_moves_as_one_that_reports_nothing(tmp_path):
    plain, reports = (trace(tmp_path, "position", keys) for keys in ("", "enable_ticks = 0"))
    assert not plain["drive_report"].any()
    assert reports["drive_report"].any()
    assert plain["dac"].any()
    for column in ("dac", "encoder"):
        assert (plain[column] == reports[column]).all(), column


@pytest.mark.parametrize("ticks, ready", [(300, True), (301, False)])
def test_after_drive_on_ticks_max_it_is_not_ready(tmp_path, ticks, ready):
    run = trace(tmp_path, "position", f"enable_ticks = {ticks}", "drive_on_ticks_max = 300\n")
    names = BY_NAME["fault"].enum
    begin = first(run["out"] != 0)
    if ready:
        assert not run["fault"].any()
        return
    fault = first(run["fault"] != 0)
    assert names[run["fault"][fault]] == "drive_not_ready"
    assert fault == begin + 300
    assert not run["dac"].any() and not run["out"][fault:].any()
    assert run["encoder"].min() == run["encoder"].max()
