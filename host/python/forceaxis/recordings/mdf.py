"""Measurement files (MDF 3 and 4) as sources of recordings."""

import contextlib
import io
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.errors import expect_package
from forceaxis.recordings.source import ArraySource, Head, Source
from forceaxis.words import counted

UNFINISHED = b"UnFinMF "  # first bytes of a file whose program ended before it was complete
TIME = 1  # what a master channel counts: s. Others count angles, distances or samples.
REMEDY = "export it as CSV"


def read_mdf(path: Path) -> Source:
    """Returns the channels of a measurement file as a source. If the file has several groups of
    channels, their names are GROUP/CHANNEL. Raises InputError."""
    expect_package(paths.display(path), "asammdf", "asammdf", "mdf")
    from asammdf import MDF  # takes a second
    from asammdf.blocks.mdf_v4 import MDF4

    setattr(MDF4, "__del__", _quiet_end)  # noqa: B010
    with files.parsing(path, "a measurement file (MDF)", REMEDY), files.remarks("asammdf") as said:
        # The library completes an unfinished file in its place, so it gets a copy of it.
        stream = path.open("rb")
        is_finished = not stream.read(len(UNFINISHED)).startswith(UNFINISHED)
        stream.seek(0)
        file = MDF(stream if is_finished else io.BytesIO(stream.read()))
        source = _Mdf(path, file)
        source.notes += said
        if not is_finished:
            source.notes.append("the program that wrote the file ended before it was complete")
    return source


def _quiet_end(file: Any) -> None:
    """Closes an MDF file whose object ends. The library's own function prints a traceback if the
    file was too damaged to be opened."""
    with contextlib.suppress(Exception):
        file.close()


class _Mdf(ArraySource):
    """The channels of an MDF file of asammdf as a source."""

    def __init__(self, path: Path, file: Any) -> None:
        self._path, self._file = path, file
        heads: list[Head] = []
        arrays: list[Callable[[], NDArray[np.generic]]] = []
        groups = [number for number, group in enumerate(file.groups) if len(group.channels)]
        names = _group_names(file, groups)
        for number in groups:
            first = len(heads)
            for head in self._heads(number, names.get(number), first):
                arrays.append(partial(self._values, number, len(heads) - first))
                heads.append(head)
        super().__init__(path, f"MDF {file.version}", heads, arrays)

    def _heads(self, number: int, group: str | None, first: int) -> Iterator[Head]:
        """Yields the heads of the channels of a group. `group`: its name, or None if the file has
        no other group. `first`: place of its first channel."""
        channels = self._file.groups[number].channels
        master = self._file.masters_db.get(number)
        has_times = master is not None and getattr(channels[master], "sync_type", TIME) == TIME
        equal = Counter(channel.name for channel in channels)
        for index, channel in enumerate(channels):
            name = channel.name + (f" #{index + 1}" if equal[channel.name] > 1 else "")
            unit = self._file.get_channel_unit(group=number, index=index).strip()
            yield Head(
                f"{group}/{name}" if group else name,
                unit or ("s" if has_times and index == master else None),
                (channel.name,),
                first + master if has_times and index != master else None,
            )

    def _values(self, group: int, index: int) -> NDArray[np.generic]:
        """Returns the physical values of a channel, NaN where the file says that they are invalid.
        Raises InputError."""
        name = self._file.groups[group].channels[index].name
        get = partial(self._file.get, group=group, index=index, ignore_invalidation_bits=True)
        with files.parsing(self._path, f"values of {name}", REMEDY):
            with files.remarks("asammdf") as said:
                signal = get()
                if np.asarray(signal.samples).dtype.kind in "SUO":
                    raw = get(raw=True)
                    if np.asarray(raw.samples).dtype.kind in "iufb":  # texts that stand for numbers
                        signal = raw
                        self._note(f"{name}: raw numbers in place of their texts")
            if said:
                raise ValueError(said[0])
        values = np.asarray(signal.samples)
        stated = self._file.groups[group].channel_group.cycles_nr
        if len(values) != stated:
            raise InputError(
                f"{self.where}: {name}: expected {counted(stated, 'sample')}, as the file states, "
                f"got {len(values)}; the file is damaged or cut off; export it again"
            )
        invalid = np.asarray([] if signal.invalidation_bits is None else signal.invalidation_bits)
        if invalid.any() and values.dtype.kind in "iufb":
            self._note(f"{name}: {counted(int(invalid.sum()), 'invalid sample')} left out")
            values = np.where(invalid, np.nan, values.astype(np.float64))
        return values

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _group_names(file: Any, groups: list[int]) -> dict[int, str]:
    """Returns {number of a group: its name}, all different, or none for a single group."""
    if len(groups) < 2:
        return {}
    stated = {n: str(getattr(file.groups[n].channel_group, "acq_name", "") or "") for n in groups}
    equal = Counter(stated.values())
    return {
        number: f"{name or 'group'} {number + 1}" if not name or equal[name] > 1 else name
        for number, name in stated.items()
    }
