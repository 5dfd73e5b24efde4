"""Every protection acts in time, and not in the run beside it; docs/protections.md says so."""

import os
from pathlib import Path

import pytest
from forceaxis import _core
from protections import CARRIERS, PROTECTIONS, TABLE, table


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
