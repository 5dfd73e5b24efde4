"""Tables of many makers, made from known samples and changed at random: their import gives these
samples, or it says what is different, or one line refuses."""

import collections
import os
import random
import re

import draws
import makers
import numpy as np
import pytest
from forceaxis._core import InputError
from forceaxis.recordings.importing import ImportRequest, import_sources
from forceaxis.recordings.reading import read_sources

TABLES = 600  # tables of a run; FORCEAXIS_TABLES: another number
# What a note says if samples of the table are missing.
NAMED = re.compile(
    r"skipped|left out|no value|begin again in one section|not imported, as|has \d+ recordings"
    r"|outside the range|has no line end|empty line|states \d+ sample"
)


def imported(layout, file):
    """The recordings of a table, or the text of the refusal."""
    file.write_bytes(layout.data())
    try:
        return import_sources(read_sources(file), file, ImportRequest(layout.maps()))
    except InputError as error:
        assert "\n" not in str(error)
        return str(error)


def nearest(known, values):
    return np.array([int(np.argmin(np.abs(known - value))) for value in values])


def expect_samples(done, known):
    """Asserts that a recording has samples of `known` alone, and returns True if it has all."""
    notes = " | ".join(done.notes)
    force = done.recording["force"]
    at = nearest(known["force"], force.values)
    count = len(at) - ("has no line end" in notes)  # then the last number is named as doubtful
    np.testing.assert_allclose(force.values[:count], known["force"][at][:count], atol=2e-3)
    time_s = known["time"][at[0]] + force.time_s - force.time_s[0]
    if "empty line" not in notes:
        np.testing.assert_allclose(time_s[:count], known["time"][at][:count], atol=2e-6)
    is_whole = len(at) == len(known["force"])
    if "position" in done.recording:
        position = done.recording["position"]
        time_s = known["time"][at[0]] + position.time_s - force.time_s[0]
        at = nearest(known["time"], time_s)
        np.testing.assert_allclose(time_s, known["time"][at], atol=2e-6)
        count = len(at) - ("has no line end" in notes)
        wanted_m = 1e-3 * known["position"][at]
        np.testing.assert_allclose(position.values[:count], wanted_m[:count], atol=2e-6)
        is_whole &= len(at) == len(known["force"])
    return is_whole


@pytest.mark.parametrize("maker", makers.MAKERS, ids=lambda maker: maker.__name__)
@pytest.mark.parametrize("seed", range(3))
def test_the_table_of_each_maker_is_imported_by_the_first_command(tmp_path, maker, seed):
    rng = random.Random(seed)
    known = makers.samples(rng)
    layout = maker(known, rng)
    found = imported(layout, tmp_path / "table.csv")
    if maker is makers.keysight:  # its channels have numbers as names
        assert isinstance(found, str) and "write #1 or #2" in found
        layout.columns["force"] = (1, "#2")
        found = imported(layout, tmp_path / "table.csv")
    assert not isinstance(found, str), found
    assert len(found) == 1 and expect_samples(found[0], known)
    force = found[0].recording["force"]
    assert not force.findings
    elsewhere = (makers.twincat, makers.plc_log, makers.dated_log, makers.epoch_log)
    if maker not in elsewhere:  # those begin at another time
        np.testing.assert_allclose(force.time_s, known["time"], atol=1e-9)
    layout.columns = {k: (place, f"#{place + 1}") for k, (place, _) in layout.columns.items()}
    again = imported(layout, tmp_path / "table.csv")
    assert expect_samples(again[0], known)  # numbers and names mean the same columns


def test_changed_tables_give_their_samples_or_say_what_is_different(tmp_path):
    count, kinds = int(os.environ.get("FORCEAXIS_TABLES", TABLES)), collections.Counter()
    # The gate reads the same tables for each commit; a run that asks for more draws its own.
    begin = draws.number("tables", 10**6) if "FORCEAXIS_TABLES" in os.environ else 0
    for seed in range(begin, begin + count):
        layout, known, changes = makers.drawn(seed)
        found = imported(layout, tmp_path / "table.csv")
        about = f"table {seed} of {layout.maker}, changed by {', '.join(changes) or 'nothing'}"
        if isinstance(found, str):
            kinds["refused"] += 1
            continue
        try:
            is_whole = all([expect_samples(one, known) for one in found])
        except AssertionError as error:
            raise AssertionError(f"{about}: {error}") from error
        notes = " | ".join(note for one in found for note in one.notes)
        gaps = [f for one in found for s in one.recording for f in s.findings if f.kind == "gap"]
        assert is_whole or NAMED.search(notes) or gaps, f"{about}: missing samples: {notes}"
        kinds["whole" if is_whole else "named"] += 1
    # A third of the changes make a table doubtful, and a doubtful one is refused.
    assert kinds["whole"] > 0.4 * count and kinds["named"] > 0.04 * count, kinds
    assert kinds["refused"] < 0.5 * count, kinds


def test_there_are_more_than_fifteen_makers():
    known = makers.samples(random.Random(0))
    names = {maker(known, random.Random(0)).maker for maker in makers.MAKERS}
    assert len(names) >= 20
