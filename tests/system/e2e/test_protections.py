"""Every protection acts in time, and not in the run beside it; docs/protections.md says so."""

import os
from pathlib import Path

import pytest
from forceaxis import _core
from protections import (
    CARRIERS,
    ENABLE,
    NEAR,
    PROTECTIONS,
    TABLE,
    experiment,
    pressing,
    strike,
    table,
)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("protections")
    return {
        row.name: row.measure(folder, lambda file: _core.run(str(file)).columns())
        for row in PROTECTIONS
    }


@pytest.mark.parametrize("row", PROTECTIONS, ids=lambda row: row.name)
def test_a_protection_acts_in_time(measured, row):
    ticks, _ = measured[row.name]
    assert ticks is not None and 1 <= ticks <= row.within


@pytest.mark.parametrize("row", PROTECTIONS, ids=lambda row: row.name)
def test_it_does_not_act_in_the_run_beside_it(measured, row):
    _, beside = measured[row.name]
    assert beside is None


def test_the_table_is_that_of_these_runs(measured):
    ticks = {name: both[0] for name, both in measured.items()}
    text = table({carrier: ticks for carrier in CARRIERS})
    if "PROTECTIONS" in os.environ:
        Path(os.environ["PROTECTIONS"]).write_text(text)
    assert TABLE.read_text() == text, "PROTECTIONS=docs/protections.md with this test writes it"


VERDICT = """[verdict]
window_s = 0.5
contact_held = true
force_ripple_max_count = 3.0
"""
CYCLES = [(-1, 10.0, 15, 0.0), (-1, 10.0, 30, 0.0), (-1, 4.5, 30, 2.0), (4, 4.5, 30, 2.0)]


@pytest.mark.parametrize("mode, gain, setpoint, blow", CYCLES)
def test_half_the_gain_calms_what_would_cycle(tmp_path, mode, gain, setpoint, blow):
    verdicts = []
    for option in ("warn", "halve_gain"):
        protection = f"""contact_loss_dwell = 0
limit_cycle_losses = 3
limit_cycle_window = 200
contact_unstable_option = "{option}"
"""
        law = f"modes_of_operation = -1\nforce_gain = {gain}\nforce_setpoint = {setpoint}\n"
        firmware = law + protection if mode == -1 else pressing(protection, k_f=gain)
        hit = strike(blow, 2.0) if blow else ""
        text = experiment(firmware, f"{ENABLE}{hit}{VERDICT}", duration_s=5.0, sets=NEAR)
        file = tmp_path / f"{option}.toml"
        file.write_text(text)
        verdicts.append(_core.run(str(file)).verdict)
    assert verdicts == ["unstable", "stable"]
