"""Imports files of other programs as recordings of forceaxis."""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.recordings import findings
from forceaxis.recordings.signal_recording import (
    UNITS,
    Floats,
    RecordedSignal,
    RecordingSource,
    SignalRecording,
)
from forceaxis.recordings.source import Source, SourceColumn
from forceaxis.recordings.units import factor_of, is_unit, si_unit_of
from forceaxis.words import suggestion

NAME = re.compile(r"[a-z][a-z0-9_.]*$")
LEAST_SAMPLES = 8
DELAY_MAX_S = 1.0
RATE_MAX_HZ = 10e6
# If the times in s begin after this value, they are calendar times (s since 1970).
LARGE_TIME_S = 1e5


@dataclass(frozen=True)
class SignalMap:
    """The assignment of a source column to a signal of the recording, which a user writes as
    NAME=[-]COLUMN[:UNIT]."""

    name: str
    column: str
    unit: str | None  # unit of the values in the column; None: the unit that the source states
    sign: int


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


@dataclass(frozen=True)
class Imported:
    """An imported recording, and notes about the import for the user."""

    recording: SignalRecording
    notes: tuple[str, ...]


def parse_map(text: str, source: Source) -> SignalMap:
    """Reads a SignalMap from a text of the form NAME=[-]COLUMN[:UNIT]. Raises ParameterError,
    InputError."""
    name, equals, rest = text.partition("=")
    if not (equals and rest.strip("-")):
        raise ParameterError("map", f"{text}: expected SIGNAL=COLUMN:UNIT, such as force=Fz:N")
    # In the file of a recording, arrays whose names begin with time_ contain times.
    if not NAME.match(name) or name.startswith("time_"):
        raise ParameterError(
            "map", f"{name}: expected a name of small letters, digits, _ and ., such as force, "
            "without time_ at its begin"
        )  # fmt: skip
    known = source.names()
    head, colon, unit = rest.rpartition(":")
    if rest in known or not colon:
        head, unit = rest, ""
    elif not is_unit(unit) and factor_of(unit, UNITS.get(name, "1")) is None:
        if head.lstrip("-") in known:
            raise ParameterError(
                "map", f"{text}: expected a unit such as {UNITS.get(name, 'N')}, got {unit!r}"
            )
        head, unit = rest, ""
    is_negative = head.startswith("-") and head not in known
    column = source.find(head[is_negative:], "maps")
    return SignalMap(name, column, unit or None, -1 if is_negative else 1)


def import_source(source: Source, path: Path, request: ImportRequest) -> Imported:
    """Returns a recording that contains the requested signals of a source. Raises InputError,
    ParameterError."""
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
    times = _Times(source, request)
    notes: list[str] = []
    signals: list[RecordedSignal] = []
    clocks: list[Floats] = []
    for one in maps:
        column = source.column(one.column)
        unit, source_unit, factor = _unit_of(one, column, source, notes)
        time_s, values = times.of(column)
        if len(values) < LEAST_SAMPLES:
            raise InputError(
                f"{source.where}: {column.name}: expected at least {LEAST_SAMPLES} samples with a "
                f"value, got {len(values)}; record for a longer time"
            )
        clock = next((k for k, t in enumerate(clocks) if np.array_equal(t, time_s)), len(clocks))
        if clock == len(clocks):
            clocks.append(time_s)
        values = values * (one.sign * factor)
        # Digits of the sampling rate that are only rounding errors are removed.
        rate_hz = float(f"{1 / np.median(np.diff(time_s)):.9g}")
        signals.append(
            RecordedSignal(
                one.name, unit, column.name, source_unit, factor, one.sign,
                rate_hz, delays.get(one.name, 0.0), str(clock),
                findings.find(one.name, time_s, values), time_s, values,
            )
        )  # fmt: skip
    used = {one.column for one in maps} | times.used
    rest = tuple(name for name in source.names() if name not in used)
    data = path.read_bytes()
    about = RecordingSource(
        path.name, source.kind, hashlib.sha256(data).hexdigest(), len(data), times.origin_s, rest
    )
    return Imported(
        SignalRecording(request.title or path.stem, about, tuple(signals)), tuple(notes)
    )


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
    where = f"{source.where}: {column.name}"
    if given is None and wanted not in ("count", "1", None):
        raise InputError(
            f"{where}: expected the unit of this column, but the source states none; write "
            f"`maps` {one.name}={one.column}:UNIT, such as :{wanted}"
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
            f"`maps` {one.name}={one.column}:UNIT. For counts, UNIT is the size of one count, "
            "such as 0.5um"
        )
    if column.unit not in (None, "count") and one.unit is not None:
        size = factor_of(column.unit or "", found[0])
        if size is None or abs(size - found[1]) > 1e-9 * found[1]:
            notes.append(
                f"{one.name}: the source gives the unit {column.unit!r} for {column.name}, which "
                f"was read in {one.unit} as asked for"
            )
    return found[0], given or "1", found[1]


class _Times:
    """The times in s at which the samples of a source were taken."""

    def __init__(self, source: Source, request: ImportRequest) -> None:
        self._source, self._request = source, request
        self._known: dict[str, tuple[Floats, SourceColumn]] = {}
        self.used: set[str] = set()
        self.origin_s = 0.0
        if request.time is not None and request.rate is not None:
            raise ParameterError("rate", "expected either a column of times or a rate, got both")
        if request.rate is not None and not 0 < request.rate <= RATE_MAX_HZ:
            raise ParameterError(
                "rate", f"expected a rate up to {RATE_MAX_HZ:g} Hz, got {request.rate:g}"
            )

    def of(self, column: SourceColumn) -> tuple[Floats, Floats]:
        """Returns (times, values) of the samples of a column that have a value. A sample that
        repeats the previous sample at the same time is left out. Raises InputError."""
        has_value = ~np.isnan(column.values)
        if self._request.rate is not None:
            time_s = np.arange(len(column.values)) / self._request.rate
            return time_s[has_value], column.values[has_value]
        time_s, times = self._column(self._name(column))
        if len(time_s) != len(column.values):
            raise InputError(
                f"{self._source.where}: {column.name}: expected {len(time_s)} values, as many as "
                f"in the column {times.name}, got {len(column.values)}; choose another column of "
                "times"
            )
        places = np.flatnonzero(has_value)
        without = np.flatnonzero(has_value & np.isnan(time_s))
        if len(without):
            raise InputError(
                f"{self._source.where}: {times.place(int(without[0]))}: expected a time for the "
                f"value of {column.name}, got none; add the time or remove the sample"
            )
        time_s, values = time_s[places], column.values[places]
        repeated = np.append(False, (np.diff(time_s) == 0) & (np.diff(values) == 0))[: len(time_s)]
        time_s, values, places = time_s[~repeated], values[~repeated], places[~repeated]
        wrong = np.flatnonzero(np.diff(time_s) <= 0)
        if len(wrong):
            at = int(places[wrong[0] + 1])
            raise InputError(
                f"{self._source.where}: {times.place(at)}: expected a time later than that of the "
                f"sample before, {time_s[wrong[0]]:.9g} s, got {time_s[wrong[0] + 1]:.9g} s; sort "
                "the samples, or export a recording during which the clock was not restarted"
            )
        return time_s, values

    def _wanted(self) -> tuple[str | None, str | None]:
        """Returns the (column, unit) of the times that the request of the user names."""
        text = self._request.time
        if text is None:
            return None, None
        head, colon, unit = text.rpartition(":")
        if not colon or text in self._source.names():
            head, unit = text, ""
        return self._source.find(head, "time"), unit or None

    def _name(self, column: SourceColumn) -> str:
        source = self._source
        name = self._wanted()[0] or column.time_column or source.time_name()
        if name is None or name not in source.names():
            raise InputError(
                f"{source.where}: expected a column of times, got {', '.join(source.names()[:12])};"
                " write `time` COLUMN:UNIT, or `rate` HZ for samples at a constant rate"
            )
        return name

    def _column(self, name: str) -> tuple[Floats, SourceColumn]:
        if name not in self._known:
            column = self._source.column(name)
            unit = self._wanted()[1] or column.unit
            factor = factor_of(unit, "s") if unit else None
            if name.rpartition("/")[2] == "tick" and not unit:
                factor = 1 / _core.TICKS_PER_SECOND
            if factor is None:
                raise InputError(
                    f"{self._source.where}: {name}: expected the unit of the times, got "
                    f"{unit or 'none'}; write `time` {name}:ms, or :s, :us"
                )
            self.used.add(name)
            known = column.values[~np.isnan(column.values)]
            begin_s = float(known[0]) * factor if len(known) else 0.0
            if not self._known and abs(begin_s) > LARGE_TIME_S:
                self.origin_s = float(np.floor(begin_s))
            # The origin is subtracted before the conversion to s, so that no digits are lost.
            self._known[name] = (column.values - self.origin_s / factor) * factor, column
        return self._known[name]
