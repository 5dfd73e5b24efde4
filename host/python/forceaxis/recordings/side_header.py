"""Headers in a file beside a table: oscilloscopes of Rohde & Schwarz (RTO, RTE, RTP) write the
samples into NAME.Wfm.csv, and NAME.csv has a property in each line, as KEY:VALUE:VALUE.

The samples have no names and, unless the export interleaves them, no times.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.recordings.columns import Section
from forceaxis.recordings.heads import Heads
from forceaxis.recordings.source import Grid, Head
from forceaxis.recordings.units import is_unit

MARK = ".wfm"  # text before the suffix of the name of a file of samples, in lower case
KIND = "Rohde & Schwarz"
STEPS = ("signalresolution", "resolution")  # keys of the step of the times in s
# (key of the number of samples of an acquisition, key of the time of its first one in s)
LENGTHS = (
    ("signalhardwarerecordlength", "hardwarexstart"),
    ("signalrecordlength", "xstart"),
    ("recordlength", "xstart"),
)
UNITS = ("verticalunit", "multichannelverticaloffset", "verticaloffset", "verticalscale")
LEAST = 1e-15  # smallest magnitude of a number in a header, and the inverse of the largest one
HEADER_BYTES = 1 << 20  # a longer file is no header
SOURCE = re.compile(r"^(?:eRS_SIGNAL_SOURCE_)?(?P<name>.+)$")

Properties = Mapping[str, Sequence[str]]


def _properties(path: Path) -> Properties | None:
    """Returns {key in lower case: values} of a header, or None if a file is none."""
    if not path.is_file() or path.stat().st_size > HEADER_BYTES:
        return None
    found = {}
    for line in path.read_bytes().decode("utf-8-sig", "replace").splitlines():
        key, mark, rest = line.strip().partition(":")
        if mark:
            found[key.strip().casefold()] = [text.strip() for text in rest.rstrip(":").split(":")]
    return found if any(key in found for key in STEPS) else None


def expect_samples(path: Path) -> None:
    """Raises InputError if a file is the header of a file of samples beside it."""
    samples = path.with_name(f"{path.stem}.Wfm{path.suffix}")
    if samples.is_file() and _properties(path) is not None:
        raise InputError(
            f"{paths.display(path)}: expected samples, got the header of {samples.name}; import "
            "that file, which is read together with its header"
        )


def with_header(path: Path, section: Section, found: Heads) -> Heads:
    """Returns the heads of the columns of a file of samples with the names and times of its header.
    Returns other heads unchanged."""
    stem = Path(path.stem)
    if stem.suffix.casefold() != MARK or found.names is not None:
        return found
    header = path.with_name(f"{stem.stem}{path.suffix}")
    known = _properties(header)
    if known is None:
        note = f"the header {header.name} is not beside the samples, so names and times are unknown"
        return replace(found, notes=[*found.notes, note], unread=note)
    return _headed(header.name, known, section, found)


def _headed(name: str, known: Properties, section: Section, found: Heads) -> Heads:
    """Returns heads with the properties of the header `name`."""
    names, width = _names(known), len(found.heads)
    has_times = width == len(names) + 1
    notes, heads = list(found.notes), list(found.heads)
    if has_times:
        names = ["time", *names]
    if width == len(names):
        unit = _unit(known)
        heads = [Head(text, unit) for text in names]
        if has_times:
            heads[0] = Head("time", "s")
        notes.append(f"names of {name}")
    else:
        notes.append(f"{name} has {len(names)} channels, and the rows {width} columns")
    count, begin_s = _length(known, section.rows)
    key = next(key for key in STEPS if key in known)
    step_s = _number(known[key][0])
    if step_s is not None and step_s > 0 and not has_times:
        if begin_s is None:
            begin_s = 0.0
            notes.append(f"{name} does not state the begin of the times, which is 0 here")
        grid = Grid(begin_s, step_s, f"{key} {known[key][0]} of {name}")
        heads = [replace(head, grid=grid) for head in heads]
    return replace(
        found, heads=heads, kind=KIND, notes=notes, unread="",
        count=(count, name) if count is not None else None,
    )  # fmt: skip


def _names(known: Properties) -> list[str]:
    """Returns the names of the columns of samples. An envelope has two for each channel."""
    states = known.get("multichannelexportstate", ["0"])
    channels = [
        f"Ch{place}" for place, state in enumerate(states[1:], 1) if state.casefold().endswith("on")
    ]
    is_multi = known.get("multichannelexport", [""])[0].casefold().endswith("on")
    if not is_multi or not channels:
        source = SOURCE.match(known.get("source", [""])[0])
        channels = [source["name"] if source else "Ch1"]
    traces = _number(known.get("interleavedtracecount", ["1"])[0]) or 1
    if traces == 2:
        return [f"{channel} {end}" for channel in channels for end in ("min", "max")]
    return channels


def _unit(known: Properties) -> str | None:
    """Returns the unit of the samples, which stands at the end of a property of the vertical
    axis."""
    texts = (known[key][-1] for key in UNITS if key in known)
    return next((text for text in texts if re.match(r"[A-Za-z]", text) and is_unit(text)), None)


def _length(known: Properties, rows: int) -> tuple[int | None, float | None]:
    """Returns (number of samples of an acquisition, time of the first one in s), None for what is
    not known. The rows have whole acquisitions, with or without the samples that the oscilloscope
    needs around them."""
    stated = [
        (round(_number(known[key][0]) or 0), _number(known.get(begin, [""])[0]))
        for key, begin in LENGTHS
        if key in known
    ]
    fitting = [one for one in stated if one[0] > 0 and rows % one[0] == 0]
    exact = [one for one in fitting if one[0] == rows]
    chosen = [*exact, *fitting, *stated]
    return chosen[0] if chosen else (None, _number(known.get("xstart", [""])[0]))


def _number(text: str) -> float | None:
    """Returns the number of a property, or None for another text and a number of no size that an
    oscilloscope has."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if value == 0 or LEAST <= abs(value) <= 1 / LEAST else None
