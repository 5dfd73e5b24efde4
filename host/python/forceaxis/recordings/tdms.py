"""TDMS files of LabVIEW and DIAdem as sources of recordings."""

import logging
import math
import re
import struct
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.errors import expect_package
from forceaxis.recordings.source import ArraySource, Grid, Head, Source, time_by_name
from forceaxis.recordings.units import split_name

# names of the properties that state the unit of a channel
UNITS = ("unit_string", "NI_UnitDescription")
# Names of the properties that state the times of a waveform
STEP, OFFSET, START, STEP_UNIT = (
    "wf_increment", "wf_start_offset", "wf_start_time", "wf_xunit_string",
)  # fmt: skip
# The path of a channel in the head of a segment, or the start of a waveform: 16 bytes
OBJECT_OR_START = re.compile(
    rb"(?P<name>/'(?:[^']|'')*'/'(?:[^']|'')*')|wf_start_time(?:D\0\0\0|\0\0\0D)(?P<start>.{16})",
    re.DOTALL,
)
LEAD_BYTES = 28  # size of the head of a segment; the head contains the length of the rest
# an earlier start time means that nobody has set the start time
FIRST_START = np.datetime64("1971-01-01")
REMEDY = "export it as CSV in LabVIEW or DIAdem"


def read_tdms(path: Path) -> Source:
    """Returns the channels of a TDMS file as a source, with the names GROUP/CHANNEL. Raises
    InputError."""
    expect_package(paths.display(path), "nptdms", "npTDMS", "tdms")
    import nptdms
    from nptdms.log import log_manager

    log_manager.console_handler.setLevel(logging.CRITICAL)
    notes: list[str] = []
    with files.parsing(path, "a TDMS file", REMEDY), files.remarks("nptdms") as remarks:
        # From an open file, the library does not read an index beside it, which may be an old one.
        file = nptdms.TdmsFile.open(path.open("rb"))
        groups = [group.channels() for group in file.groups()]
        channels = [channel for group in groups for channel in group]
        begins_s = _begins_s(channels, notes)
        heads = [
            head
            for group in groups
            for head in _heads(group, channels.index(group[0]) if group else 0, begins_s)
        ]
        rest, starts = _segments(path)
        if file.file_status.incomplete_final_segment or rest:
            remarks.append("its last segment is not complete, so samples may be lost")
    arrays = [
        partial(_array, path, one, 0 if head.time is not None else len(starts.get(one.path, ())))
        for one, head in zip(channels, heads, strict=True)
    ]
    source = ArraySource(path, "TDMS", heads, arrays)
    source.is_whole = True
    source.notes += notes
    source.notes += [f"damaged or cut off: {remark}" for remark in remarks]
    return source


def _segments(path: Path) -> tuple[int, dict[str, set[bytes]]]:
    """Reads what the library does not say of the segments of a file. Returns (number of bytes
    behind the last complete head of a segment, {path of a channel: its starts as stored})."""
    begin, size = 0, path.stat().st_size
    starts: dict[str, set[bytes]] = {}
    with path.open("rb") as file:
        while size - begin >= LEAD_BYTES:
            file.seek(begin)
            _, _, _, length, data = struct.unpack("<4s2IQQ", file.read(LEAD_BYTES))
            name = ""
            for found in OBJECT_OR_START.finditer(file.read(min(data, length, size))):
                if found["start"] is None:
                    name = found["name"].decode(errors="replace")
                else:
                    starts.setdefault(name, set()).add(found["start"])
            begin += LEAD_BYTES + length
    return max(size - begin, 0), starts


def _array(path: Path, channel: Any, starts: int) -> NDArray[np.generic]:
    """Returns the scaled values of a channel. `starts`: number of the starts of its
    waveform, if these give its times. Raises InputError."""
    if starts > 1 and channel.properties.get(STEP):
        raise InputError(
            f"{paths.display(path)}: {channel.path}: expected one {START}, got {starts} in "
            "segments behind each other, with unknown times between them; export each of them as a "
            "file"
        )
    with files.parsing(path, f"values of {channel.path}", REMEDY), files.remarks("nptdms") as said:
        values = np.asarray(channel[:])
    if said:
        raise InputError(
            f"{paths.display(path)}: {channel.path}: expected values with a known scale, got: "
            f"{said[0]}; {REMEDY}"
        )
    return values


def _heads(group: Sequence[Any], first: int, begins_s: dict[str, float]) -> list[Head]:
    """Returns the heads of the channels of a group. `first`: place of its first channel."""
    time = time_by_name([channel.name for channel in group])
    return [
        Head(
            f"{channel.group_name}/{channel.name}",
            next((str(channel.properties[key]) for key in UNITS if channel.properties.get(key)),
                 split_name(channel.name)[1]),
            (channel.name,),
            None if time is None else first + time,
            _grid(channel, begins_s.get(channel.path, 0.0)),
        )
        for channel in group
    ]  # fmt: skip


def _grid(channel: Any, begin_s: float) -> Grid | None:
    """Returns the times of a waveform, or None if a channel has none. `begin_s`: time of its start
    after the start of the first waveform of the file."""
    properties = channel.properties
    step_s, offset_s = properties.get(STEP), properties.get(OFFSET, 0.0)
    is_time = str(properties.get(STEP_UNIT) or "s") == "s"
    numbers = isinstance(step_s, int | float) and isinstance(offset_s, int | float)
    if not (numbers and is_time and 0 < step_s < math.inf and math.isfinite(offset_s)):
        return None
    start = f", {START} {begin_s:.9g} s after the first one" if begin_s else ""
    text = f"{STEP} {step_s:.9g} s of {channel.name}{start}"
    return Grid(begin_s + offset_s, step_s, text)


def _begins_s(channels: Sequence[Any], remarks: list[str]) -> dict[str, float]:
    """Returns {path of a channel: start of its waveform in s after the first start}. `remarks`:
    receives which waveforms have no start, although others have one."""
    starts: dict[str, Any] = {}
    without: list[str] = []
    for channel in channels:
        start = channel.properties.get(START)
        if isinstance(start, np.datetime64) and start > FIRST_START:
            starts[channel.path] = start.astype("M8[ns]")
        elif channel.properties.get(STEP):
            without.append(f"{channel.group_name}/{channel.name}")
    if starts and without:
        few = ", ".join(without[:4]) + (", ..." if len(without) > 4 else "")
        remarks.append(f"no {START} for {few}, whose times begin at 0")
    first = min(starts.values(), default=None)
    return {path: float((start - first).astype(np.int64)) * 1e-9 for path, start in starts.items()}
