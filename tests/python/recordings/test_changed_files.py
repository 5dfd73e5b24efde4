"""Binary files and logs of other programs, made from known samples and damaged at random: their
import gives these samples, or says what is different, or one line refuses."""

import collections
import os
import random
import re

import draws
import foreign_files
import hostile_files
import numpy as np
from forceaxis._core import InputError
from forceaxis.recordings.can_names import Names
from forceaxis.recordings.importing import ImportRequest, import_sources
from forceaxis.recordings.reading import read_sources

FILES = 120  # files of a run; FORCEAXIS_TABLES: another number
NAMED = re.compile(
    r"damaged|cut off|lost|left out|skipped|no value|could not be read|not written|missing"
    r"|begin again|without a name|Failed|ropping|rows of numbers|not in the order"
)


def imported(folder, name, made, data):
    file = folder / name
    file.write_bytes(data)
    words = {}
    for kind, content in made.more.items():
        (folder / f"names.{kind}").write_text(content)
        words[kind] = (("1=" if kind == "eds" else "") + str(folder / f"names.{kind}"),)
    try:
        sources = read_sources(file, names=Names(**words))
        return import_sources(sources, file, ImportRequest(made.maps))
    except InputError as error:
        assert "\n" not in str(error)
        return str(error)


def is_of(signal, time_s, values, atol):
    """Returns True if each sample is one of the known ones at its time."""
    shift = signal.time_s[0] - time_s
    nearest = [int(np.argmin(np.abs(values - v))) for v in signal.values[:1]]
    at_s = signal.time_s - shift[nearest[0]]
    places = np.argmin(np.abs(time_s[:, None] - at_s), axis=0)
    return bool(
        np.allclose(time_s[places], at_s, atol=2e-6)
        and np.allclose(values[places], signal.values, atol=atol, rtol=2e-7)
    )


def cut_inside(data, rng):
    """Returns the begin of a file. It never ends with a line or a segment: nobody could see it."""
    end = rng.randrange(1, len(data))
    while data[end - 1 : end] == b"\n" or data[end : end + 4] == b"TDSm":
        end -= 1
    return data[:end]


def test_files_of_each_format_have_their_samples(tmp_path):
    """Not damaged: all samples, and a gap where some were left out."""
    kinds = collections.Counter()
    for seed in range(FILES // 3):
        name, made, known, changes = foreign_files.drawn(seed)
        found = imported(tmp_path, name, made, made.data)
        assert not isinstance(found, str), f"file {seed}, {name}: {found}"
        recording = found[0].recording
        about = f"file {seed}, {name} {changes}: {found[0].notes}"
        assert is_of(recording["force"], known.time_s, known.force_N, 1e-9), about
        assert is_of(recording["position"], known.time_s, known.travel_mm / 1e3, 1e-9), about
        gaps = [f for f in recording["force"].findings if f.kind == "gap"]
        assert bool(gaps) == ("gap" in changes), about
        assert len(recording["force"].values) == len(known.force_N) - (
            gaps[0].samples if gaps else 0
        )
        kinds[name] += 1
    assert len(kinds) == len(foreign_files.MAKERS)


def test_damaged_files_of_each_format_are_right_or_named_or_refused(tmp_path):
    """A flipped bit of a value cannot be seen in most formats; asserted is that no file ends in a
    traceback, and that samples which are missing are named."""
    count, kinds = int(os.environ.get("FORCEAXIS_TABLES", FILES)), collections.Counter()
    begin = draws.number("files", 10**6) if "FORCEAXIS_TABLES" in os.environ else 0
    for seed in range(begin, begin + count):
        name, made, known, _ = foreign_files.drawn(seed)
        rng = random.Random(seed)
        cut = rng.random() < 0.4
        data = (
            cut_inside(made.data, rng) if cut
            else foreign_files.damaged(name, made.data, rng, hostile_files.of_bytes)
        )  # fmt: skip
        found = imported(tmp_path, name, made, data)
        if isinstance(found, str):
            kinds["refused"] += 1
            continue
        kinds["imported"] += 1
        whole = imported(tmp_path, name, made, made.data)[0].recording["force"]
        for one in found:
            assert all(np.isfinite(s.values).all() for s in one.recording)
            if cut and len(one.recording["force"].values) < len(whole.values):
                notes = " | ".join(one.notes)
                assert NAMED.search(notes), f"file {seed}, {name}: {notes}"
                assert is_of(one.recording["force"], known.time_s, known.force_N, 1e-9)
    assert kinds["refused"] > 0.1 * count and kinds["imported"] > 0.1 * count, kinds
