"""Imports files of other programs as recordings of forceaxis."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.recordings import findings
from forceaxis.recordings.signal_recording import (
    UNITS,
    RecordedSignal,
    RecordingSource,
    SignalRecording,
)
from forceaxis.recordings.source import Source, SourceColumn
from forceaxis.recordings.times import LEAST_SAMPLES, Times, rate_of
from forceaxis.recordings.units import factor_of, hint_of, is_unit, si_unit_of, unit_text_of
from forceaxis.words import counted, suggestion

NAME = re.compile(r"[a-z][a-z0-9_.]*$")
# A comma between two maps separates them. Other commas belong to the name of a column.
BETWEEN_MAPS = re.compile(r",(?=\s*[A-Za-z][\w.]*=)")
DELAY_MAX_S = 1.0
# Largest pause between two signals of one clock, divided by the duration of the longest signal.
APART = 10.0


@dataclass(frozen=True)
class SignalMap:
    """The assignment of a source column to a signal of the recording, which a user writes as
    NAME=[-]COLUMN[:UNIT[OFFSET]]."""

    name: str
    place: int  # place of the column in the source
    text: str  # the column as the user has written it
    unit: str | None  # unit of the values in the column; None: the unit that the source states
    sign: int
    offset: float  # what is added to the values in the column, in `unit`, before the sign


@dataclass(frozen=True)
class ImportRequest:
    """The request for an import of a recording. Its fields have the names of the command
    options."""

    map: Sequence[str]
    # column with the times as COLUMN[:UNIT]; None: the import searches for it
    time: str | None = None
    rate: float | None = None  # sampling rate in Hz for a source that contains no times
    delay: Mapping[str, str] = field(default_factory=dict)  # {signal: delay with its unit}
    title: str = ""
    # {signal: FROM:TO}, a stretch of time in s in which the signal is 0
    zero: Mapping[str, str] = field(default_factory=dict)
    section: int | None = None  # number of the only recording to import, from 1
    without_spikes: bool = False  # the samples of spikes are left out


@dataclass(frozen=True)
class Imported:
    """An imported recording, and notes about the import for the user."""

    recording: SignalRecording
    notes: tuple[str, ...]


def maps_of(text: str) -> list[str]:
    """Returns the single maps in a text of several maps that are separated by commas. A column may
    have commas in its name."""
    return [one.strip() for one in BETWEEN_MAPS.split(text) if one.strip()]


def parse_map(text: str, source: Source) -> SignalMap:
    """Reads a SignalMap from a text of the form NAME=[-]COLUMN[:UNIT[OFFSET]]. Raises
    ParameterError, InputError."""
    name, equals, rest = text.partition("=")
    if not (equals and rest.strip("-")):
        raise ParameterError("map", f"{text}: expected SIGNAL=COLUMN:UNIT, such as force=Fz:N")
    # In the file of a recording, arrays whose names begin with time_ contain times.
    if not NAME.match(name) or name.startswith("time_"):
        raise ParameterError(
            "map", f"{name}: expected a name of small letters, digits, _ and ., such as force, "
            "without time_ at its begin"
        )  # fmt: skip
    known, wanted = source.names(), UNITS.get(name)
    head, colon, unit = rest.rpartition(":")
    given = unit_text_of(unit)
    if rest in known or not colon:
        head, given = rest, unit_text_of("")
    elif not is_unit(given.unit) and factor_of(given.unit, wanted or "1") is None:
        try:
            source.find(head.lstrip("-"), "maps")
        except ParameterError:
            head, given = rest, unit_text_of("")  # the colon belongs to the name
        else:
            hint = hint_of(given.unit, wanted or "N")
            raise ParameterError(
                "map", f"{text}: expected a unit such as {wanted or 'N'}, got {unit!r}; {hint}"
            )
    is_negative = head.startswith("-") and head not in known
    place = source.find(head[is_negative:], "maps")
    return SignalMap(
        name, place, head[is_negative:], given.unit or None, -1 if is_negative else 1, given.offset
    )  # fmt: skip


def import_source(source: Source, path: Path, request: ImportRequest) -> Imported:
    """Returns the recording that contains the requested signals of a source. Raises InputError,
    ParameterError, also if the source has several recordings and `request` does not choose one."""
    found = import_sources([source], path, request)
    if len(found) > 1:
        raise InputError(
            f"{source.where}: expected one recording, got {len(found)} in which the times begin "
            "again; write `section` 1 for the first one"
        )
    return found[0]


def import_sources(sources: Sequence[Source], path: Path, request: ImportRequest) -> list[Imported]:
    """Returns the recordings that contain the requested signals of the sections of a file. Sections
    without these columns are named in the notes. Raises InputError, ParameterError."""
    known, notes = _sources_with(sources, request)
    found = [one for source in known for one in _import_parts(source, path, request)]
    if request.section is not None:
        if not 1 <= request.section <= len(found):
            raise ParameterError(
                "section", f"expected a number from 1 to {len(found)}, got {request.section}"
            )
        found = [found[request.section - 1]]
    elif len(found) > 1:
        notes.append(f"the file has {len(found)} recordings; `section` chooses one of them")
    return [Imported(one.recording, (*notes, *one.notes)) for one in found]


def _sources_with(
    sources: Sequence[Source], request: ImportRequest
) -> tuple[list[Source], list[str]]:
    """Returns the sources that have all requested columns, and notes about the others. Raises
    InputError, if none has, or if they have different columns behind the same numbers."""
    known: list[Source] = []
    errors: list[tuple[Source, ParameterError]] = []
    for source in sources:
        try:
            for text in request.map:
                parse_map(text, source)
            known.append(source)
        except ParameterError as error:
            errors.append((source, error))
    if not known:
        raise max(errors, key=lambda one: len(one[0].heads))[1]
    several = {tuple(source.names()) for source in known}
    numbers = [text for text in request.map if re.match(r"[^=]*=-?#?\d+(:|$)", text)]
    if len(several) > 1 and numbers and request.section is None:
        lists = "; ".join(
            f"{place}: {', '.join(source.names()[:4])}" for place, source in enumerate(known, 1)
        )
        raise ParameterError(
            "map", f"{numbers[0]}: expected the name of a column, as {known[0].where} has sections "
            f"with other columns ({lists}); write a name, or choose by `section`"
        )  # fmt: skip
    notes = [f"{source.notes[0]}: not imported, as {error.text}" for source, error in errors]
    return known, notes


def _import_parts(source: Source, path: Path, request: ImportRequest) -> list[Imported]:
    """Returns the recordings in one source: a new one begins where its times begin again."""
    maps = [parse_map(text, source) for text in request.map]
    if not maps:
        few = ", ".join(source.names()[:12])
        raise ParameterError(
            "map", f"expected at least one signal such as force=Fz:N of the columns {few}"
        )
    names = [one.name for one in maps]
    for name in names:
        if names.count(name) > 1:
            raise ParameterError("map", f"{name}: expected each signal once; remove one of the two")
    delays = {name: _delay_s(name, text, names) for name, text in request.delay.items()}
    zeros = {name: _stretch_of(name, text, names) for name, text in request.zero.items()}
    notes: list[str] = []
    times = Times(source, request, notes, {one.place for one in maps})
    columns = [source.column(one.place) for one in maps]
    units = [_unit_of(*pair, source, notes) for pair in zip(maps, columns, strict=True)]
    longest = max(len(column.values) for column in columns)
    parts = times.parts([one.place for one in maps], longest)
    digest = _digest(path)
    found = []
    for number, part in enumerate(parts, 1):
        own: list[str] = []
        if len(parts) > 1:
            own.append(
                f"recording {number} of {len(parts)}, which begin again in one section: "
                f"{columns[0].stretch(part)}"
            )
        signals: list[RecordedSignal] = []
        for one, column, unit in zip(maps, columns, units, strict=True):
            signal = _signal(one, column, unit, times, part)
            if one.name in zeros:
                signal = _zeroed(signal, *zeros[one.name], own)
            delayed = delays.get(one.name, 0.0)
            signal = _with_findings(signal, delayed, request.without_spikes, own)
            signals.append(_on_clock(signal, signals))
        _expect_one_clock(signals, source.where, own)
        used = {one.place for one in maps} | times.used
        rest = tuple(head.name for place, head in enumerate(source.heads) if place not in used)
        about = RecordingSource(path.name, source.kind, *digest, times.origin_s, rest)
        recording = SignalRecording(request.title or path.stem, about, tuple(signals))
        found.append(Imported(recording, (*source.notes, *notes, *own)))
    return found


def _expect_one_clock(signals: Sequence[RecordedSignal], where: str, notes: list[str]) -> None:
    """Raises InputError for signals whose times are so far apart that they are of several clocks,
    such as one that begins in 1970 and one that begins with the program. `notes`: receives signals
    that have no time in common."""
    spans = [(s.time_s[0], s.time_s[-1]) for s in signals]
    longest = max(end - begin for begin, end in spans)
    (last, late), (first, early) = (
        max(zip(spans, signals, strict=True), key=lambda one: one[0][0]),
        min(zip(spans, signals, strict=True), key=lambda one: one[0][1]),
    )
    stretches = (
        f"{early.name} from {first[0]:.6g} to {first[1]:.6g} s and {late.name} from "
        f"{last[0]:.6g} to {last[1]:.6g} s"
    )
    if last[0] - first[1] > APART * longest:
        raise InputError(
            f"{where}: expected signals of the same time, got {stretches}; import them one by one, "
            "or choose their times by `time`"
        )
    if last[0] > first[1]:
        notes.append(f"signals without a time in common: {stretches}")


def _digest(path: Path) -> tuple[str, int]:
    """Returns (SHA-256, size in bytes) of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest(), path.stat().st_size


def _signal(
    one: SignalMap, column: SourceColumn, unit: tuple[str, str, float], times: Times, part: slice
) -> RecordedSignal:  # fmt: skip
    """Returns the signal of a part of a column, without its findings."""
    time_s, values = times.of(one.place, column, part)
    if len(values) < LEAST_SAMPLES:
        raise InputError(
            f"{times.where}: {column.name}: expected at least {LEAST_SAMPLES} samples with a "
            f"value, got {len(values)}; record for a longer time, or choose another column"
        )
    factor = one.sign * unit[2]
    offset = factor * one.offset
    if factor != 1 or offset:  # the values belong to this column alone
        values *= factor
        values += offset
    return RecordedSignal(
        one.name, unit[0], column.name, unit[1], unit[2], one.sign, rate_of(time_s),
        time_s=time_s, values=values, offset=offset,
    )  # fmt: skip


def _on_clock(signal: RecordedSignal, others: Sequence[RecordedSignal]) -> RecordedSignal:
    """Returns a signal with the times of another signal that has the same times, or with its own
    clock."""
    alike = next((o for o in others if np.array_equal(o.time_s, signal.time_s)), None)
    if alike is not None:
        return replace(signal, clock=alike.clock, time_s=alike.time_s)
    return replace(signal, clock=str(len({o.clock for o in others})))


def _zeroed(signal: RecordedSignal, from_s: float, to_s: float, notes: list[str]) -> RecordedSignal:
    """Returns a signal minus its median in a stretch of time in which it is 0."""
    inside = (signal.time_s >= from_s) & (signal.time_s <= to_s)
    if inside.sum() < LEAST_SAMPLES:
        raise ParameterError(
            "zero", f"{signal.name}: expected a stretch with at least {LEAST_SAMPLES} samples "
            f"between {signal.time_s[0]:.6g} and {signal.time_s[-1]:.6g} s, got {inside.sum()}"
        )  # fmt: skip
    zero = float(np.median(signal.values[inside]))
    notes.append(
        f"{signal.name}: {zero:.6g} {signal.unit} subtracted, the median from {from_s:g} to "
        f"{to_s:g} s"
    )
    np.subtract(signal.values, zero, out=signal.values)
    return replace(signal, offset=signal.offset - zero)


def _with_findings(
    signal: RecordedSignal, delay_s: float, without_spikes: bool, notes: list[str]
) -> RecordedSignal:
    """Returns a signal with its delay and its findings, perhaps without the samples of spikes."""
    found = findings.find(signal.name, signal.time_s, signal.values)
    spikes = [one for one in found if one.kind == "spike"]
    if without_spikes and spikes:
        lost = np.zeros(len(signal.values), dtype=bool)
        for one in spikes:
            lost |= (signal.time_s >= one.from_s) & (signal.time_s <= one.to_s)
        notes.append(
            f"{signal.name}: {counted(len(spikes), 'spike')} left out, which are "
            f"{counted(int(lost.sum()), 'sample')}"
        )
        signal = replace(signal, time_s=signal.time_s[~lost], values=signal.values[~lost])
        left = findings.find(signal.name, signal.time_s, signal.values)
        spikes = [replace(one, text=f"{one.text}, left out") for one in spikes]
        found = tuple(sorted((*left, *spikes), key=lambda one: one.from_s))
    return replace(signal, delay_s=delay_s, findings=found)


def _stretch_of(name: str, text: str, names: Sequence[str]) -> tuple[float, float]:
    """Returns (begin, end) in s of the stretch of time FROM:TO of a signal."""
    if name not in names:
        raise ParameterError(
            "zero", f"{name}: expected one of the signals {', '.join(names)}"
            f"{suggestion(name, names)}"
        )  # fmt: skip
    ends = [_core.quantity_in(end if end[-1:].isalpha() else f"{end}s", "s")
            for end in map(str.strip, text.split(":"))]  # fmt: skip
    if len(ends) != 2 or ends[0] is None or ends[1] is None or not ends[0] < ends[1]:
        raise ParameterError(
            "zero", f"{name}={text}: expected a stretch of time FROM:TO in s, such as 0:0.2"
        )
    return ends[0], ends[1]


def _delay_s(name: str, text: str, names: Sequence[str]) -> float:
    if name not in names:
        raise ParameterError(
            "delay", f"{name}: expected one of the signals {', '.join(names)}"
            f"{suggestion(name, names)}"
        )  # fmt: skip
    value = _core.quantity_in(text, "s")
    if value is None or not abs(value) <= DELAY_MAX_S:
        raise ParameterError(
            "delay", f"{name}={text}: expected a time with its unit up to {DELAY_MAX_S:g} s, such "
            "as 2ms"
        )  # fmt: skip
    return value


def _unit_of(
    one: SignalMap, column: SourceColumn, source: Source, notes: list[str]
) -> tuple[str, str, float]:
    """Returns (SI unit, unit in the source, factor between them) of a signal. Raises InputError."""
    given = one.unit if one.unit is not None else column.unit
    wanted = UNITS.get(one.name)
    where, asked = f"{source.where}: {column.name}", f"`maps` {one.name}={one.text}"
    if given is None and wanted not in ("count", "1", None):
        raise InputError(
            f"{where}: expected the unit of this column, but the source states none; write "
            f"{asked}:UNIT, such as :{wanted}"
        )
    given = given or ""
    if wanted is None:
        found = si_unit_of(given)
    else:
        factor = factor_of(given, wanted)
        found = (wanted, factor) if factor else None
    if found is None:
        unit_kind = f"a unit of {one.name}, such as {wanted}" if wanted else "an SI unit"
        raise InputError(
            f"{where}: expected {unit_kind}, got {given!r}; write another unit in "
            f"{asked}:UNIT; {hint_of(given, wanted or '1')}"
        )
    if column.unit not in (None, "count") and one.unit is not None:
        size = factor_of(column.unit or "", found[0])
        if size is None or abs(size - found[1]) > 1e-9 * found[1]:
            notes.append(
                f"{one.name}: the source gives the unit {column.unit!r} for {column.name}, which "
                f"was read in {one.unit} as asked for"
            )
    return found[0], given or "1", found[1]
