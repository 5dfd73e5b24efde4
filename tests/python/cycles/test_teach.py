"""Bounds from recorded parts are those that the same simulated parts give."""

import dataclasses
from pathlib import Path

import pytest
from forceaxis import InputError
from forceaxis.cycles import live, propose, rates, teach
from forceaxis.cycles.records import RecordedParts, RecordFolder, read_parts
from forceaxis.errors import ParameterError
from part_records import recorded

SIM = Path(__file__).resolve().parents[3] / "sim"
PRESS_FIT = SIM / "experiments/press_fit.toml"
GOOD = SIM / "parts/press_fit_good.toml"


@pytest.fixture(scope="module")
def done():
    return rates.rates(rates.RatesRequest(PRESS_FIT, GOOD, parts=599, seed=1))


@pytest.fixture(scope="module")
def wanted():
    return live.live_program(PRESS_FIT)


def test_recorded_parts_give_the_bounds_of_the_same_simulated_parts(done, wanted, tmp_path):
    simulated = propose.propose(done, 0.01, tmp_path / "one.toml", PRESS_FIT, [])
    with RecordFolder(tmp_path / "records") as folder:
        for record in recorded(done, wanted):
            folder.add(record)
    for source in ("records", "records/parts.csv"):
        file = tmp_path / "two.toml"
        taught = teach.teach(read_parts(tmp_path / source), wanted, 0.01, file)
        assert file.read_text() == (tmp_path / "one.toml").read_text()
        assert dataclasses.replace(taught, program=simulated.program) == simulated


def test_parts_count_as_good_whatever_the_old_bounds_said(done, wanted, tmp_path):
    parts = recorded(done, wanted)
    refused = [
        dataclasses.replace(
            r, state="bad",
            elements=[
                dataclasses.replace(e, verdict="below") if e.name == "work" else e
                for e in r.elements
            ],
        )
        for r in parts
    ]  # fmt: skip
    one, two = tmp_path / "one.toml", tmp_path / "two.toml"
    teach.teach(RecordedParts("here", parts), wanted, 0.01, one)
    teach.teach(RecordedParts("here", refused), wanted, 0.01, two)
    assert one.read_text() == two.read_text()


def test_aborted_parts_and_other_programs_do_not_count(done, wanted, tmp_path):
    parts = recorded(done, wanted)
    aborted = recorded(done, wanted, 50, state="aborted", outcome="stopped")
    others = recorded(done, wanted, 50, program_crc="12345678")
    file = tmp_path / "new.toml"
    found = teach.teach(RecordedParts("here", [*aborted, *parts, *others]), wanted, 0.01, file)
    assert found.parts == 599
    with pytest.raises(
        InputError,
        match=r"here: expected parts that .* 50 parts that were pressed with other programs",
    ):
        teach.teach(RecordedParts("here", others), wanted, 0.01, file)


def test_too_few_parts_are_refused_and_nothing_is_written(done, wanted, tmp_path):
    file = tmp_path / "new.toml"
    for count in (298, 598):
        parts = RecordedParts("here", recorded(done, wanted, count))
        with pytest.raises(ParameterError, match=f"at least 599 good parts .* got {count}"):
            teach.teach(parts, wanted, 0.01, file)
    assert not file.exists()
