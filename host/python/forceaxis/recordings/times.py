"""Times in s of the samples of a source: of a column, of a rate, or of a grid that it states.

Where times begin again, another recording begins. Times that are coarser than the samples are
refused, because nobody knows the times between them.
"""

import itertools
from collections.abc import Callable, Collection
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.recordings.clock import Clock
from forceaxis.recordings.signal_recording import Floats, even_times
from forceaxis.recordings.source import Grid, Source, SourceColumn
from forceaxis.recordings.units import factor_of
from forceaxis.words import counted

LEAST_SAMPLES = 8
RATE_MAX_HZ = 10e6
# If the times in s begin after this value, they are calendar times (s since 1970).
LARGE_TIME_S = 1e5
# Time stamps are coarser than the sampling period if many samples repeat the stamp before them.
# Share of samples with a repeated stamp, above which the time stamps are regarded as coarse.
COARSE_SHARE = 0.1
# Times that begin again fall by at least FALL_PERIODS sampling periods.
# The step of the times after such a fall is at most STEP_PERIODS sampling periods.
FALL_PERIODS, STEP_PERIODS = 8.0, 3.0
# Largest relative difference between the steps of a column that counts the samples.
EVEN_STEPS = 0.01
RATED_SAMPLES = 200_000  # largest number of samples from which a rate is computed


class TimesRequest(Protocol):
    """What a user asks for about the times of an import."""

    @property
    def time(self) -> str | None:
        """Column with the times as COLUMN[:UNIT], or None to search for it."""

    @property
    def rate(self) -> float | None:
        """Sampling rate in Hz for a source without times, or None."""


@dataclass(frozen=True)
class _Stamps:
    """The times of a column in s after the origin, and their column, or None for a grid."""

    time_s: Floats
    clock: Clock | None


class Times:
    """The times in s at which the samples of a source were taken. `notes`: receives what a user has
    to know about them. `signals`: places of the columns that are signals."""

    def __init__(
        self, source: Source, request: TimesRequest, notes: list[str],
        signals: Collection[int] = (),
    ) -> None:  # fmt: skip
        self._source, self._request, self._notes = source, request, notes
        self._signals = signals
        self._known: dict[int, _Stamps] = {}
        self.used: set[int] = set()
        self.origin_s = 0.0
        if request.time is not None and request.rate is not None:
            raise ParameterError("rate", "expected either a column of times or a rate, got both")
        if request.rate is not None and not 0 < request.rate <= RATE_MAX_HZ:
            raise ParameterError(
                "rate", f"expected a rate up to {RATE_MAX_HZ:g} Hz, got {request.rate:g}"
            )

    @property
    def where(self) -> str:
        """The name of the file in messages."""
        return self._source.where

    def of(self, place: int, column: SourceColumn, part: slice) -> tuple[Floats, Floats]:
        """Returns (times, values) of the samples of a part of a column that have a value. A sample
        that repeats the previous sample at the same time is left out. Raises InputError."""
        stamps = self._stamps(place, len(column.values))
        if len(stamps.time_s) != len(column.values):
            name = stamps.clock.name if stamps.clock is not None else "the times"
            raise InputError(
                f"{self._source.where}: {column.name}: expected {len(stamps.time_s)} values, as "
                f"many as in the column {name}, got {len(column.values)}; choose another column of "
                "times"
            )
        if stamps.clock is not None and self._source.heads[place].time is not None:
            self._note(f"{column.name}: the times are those of {stamps.clock.name}")
        time_s, values = stamps.time_s[part], column.values[part]
        if stamps.clock is None:
            time_s = time_s if part.start == 0 else time_s - time_s[0] + stamps.time_s[0]
        has_value = ~np.isnan(values)
        places = None if has_value.all() else np.flatnonzero(has_value)
        if places is not None:
            time_s, values = time_s[places], values[places]

        def row(sample: int) -> int:
            return int(part.start + (sample if places is None else places[sample]))

        if stamps.clock is not None:
            self._expect_stamps(stamps.clock, column, time_s, row)
            time_s, values = self._ascending(stamps.clock, column, time_s, values, row)
        return time_s, values

    def parts(self, places: list[int], count: int) -> list[slice]:
        """Returns the rows of each recording in the source: the times restart between them.
        `places`: columns that are asked for. `count`: number of rows of the longest of them."""
        whole = [slice(0, count)]
        clocks = {self._place(place) for place in places}
        if len(clocks) != 1:
            return whole
        place = clocks.pop()
        grid = self._source.heads[places[0]].grid
        stated = self._source.count
        has_counter = grid is not None and grid.counter is not None and self._request.rate is None
        if place is None and not has_counter and stated and stated >= LEAST_SAMPLES:
            rest = count % stated
            if count > stated and 0 < rest < LEAST_SAMPLES:
                self._note(
                    f"the last {counted(rest, 'row')} left out, behind the {stated} samples that "
                    "the source states"
                )
                count -= rest
            if count > stated or rest:
                return [slice(k, min(k + stated, count)) for k in range(0, count, stated)]
        is_column = place is not None or has_counter
        values = self._stamps(places[0], count).time_s if is_column else self._index(places, count)
        if values is None or len(values) != count:
            return whole
        begins = [0, *restarts(values), count]
        return [slice(a, b) for a, b in itertools.pairwise(begins)]

    def _index(self, places: list[int], count: int) -> Floats | None:
        """Returns the numbers of the column of the times, or of the first one, if it counts the
        samples in equal steps. `places`: columns that are signals."""
        if self._source.is_whole:
            return None
        place = self._source.time_place() or 0
        try:
            values = self._source.clock(place).values
        except InputError:
            return None
        if place in places or len(values) != count or not np.isfinite(values).all():
            return None
        steps = np.diff(values)
        rising = steps[steps > 0]
        is_even = len(rising) > 0 and np.ptp(rising) <= EVEN_STEPS * np.median(rising)
        return values if is_even else None

    def _stamps(self, place: int, count: int) -> _Stamps:
        time = self._place(place)
        if time is not None:
            return self._column(time)
        grid = self._source.heads[place].grid
        if self._request.rate is not None or grid is None:
            return _Stamps(_grid(count, 0.0, 1 / (self._request.rate or 1.0)), None)
        if grid.counter is not None:
            self._note(f"the times are those of {grid.text}")
            return self._counted(grid, grid.counter)
        missing = max((self._source.count or 0) - count, 0)
        self._note(
            f"the times are those of {grid.text}"
            + f"; {counted(missing, 'sample')} missing: if not at the end, all later times are too "
            "early" * bool(missing)
        )
        return _Stamps(_grid(count, grid.begin_s, grid.step_s), None)

    def _counted(self, grid: Grid, counter: int) -> _Stamps:
        """Returns the times of a grid whose steps a column counts."""
        if counter not in self._known:
            clock = self._source.clock(counter)
            np.add(clock.values, float(clock.base), out=clock.values)
            np.multiply(clock.values, grid.step_s, out=clock.values)
            np.add(clock.values, grid.begin_s, out=clock.values)
            self.used.add(counter)
            self._known[counter] = _Stamps(clock.values, clock)
        return self._known[counter]

    def _note(self, note: str) -> None:
        if note not in self._notes:
            self._notes.append(note)

    def _place(self, place: int) -> int | None:
        """Returns the place of the column with the times of a column, or None for a rate or a
        grid. Raises InputError if there is none of these."""
        source = self._source
        if self._request.rate is not None:
            return None
        head = source.heads[place]
        if (wanted := self._wanted(place)[0]) is not None:
            return wanted
        time = head.time if head.time is not None else source.time_place()
        if time is None:
            if head.grid is None:
                raise self._no_times(", ".join(source.names()[:12]))
            if head.grid.doubt:
                raise self._no_times(
                    f"{head.grid.text}, where {head.grid.doubt!r} may have a separator of thousands"
                )
        elif not source.has_sure_times(time):
            name = source.heads[time].name
            if time in self._signals:
                raise self._no_times(f"{name}, which is a signal here")
            if head.time is None:
                self._note(
                    f"the times are those of {name}, column {time + 1}, which was not found by its "
                    "name; `time` chooses another one"
                )
        return time

    def _no_times(self, got: str) -> InputError:
        return InputError(
            f"{self._source.where}: expected a column of times, got {got}; write `time` "
            "COLUMN:UNIT, or `rate` HZ for samples at a constant rate"
        )

    def _wanted(self, near: int) -> tuple[int | None, str | None]:
        """Returns the (column, unit) of the times that the request of the user names. `near`: place
        of the column with the values."""
        text = self._request.time
        if text is None:
            return None, None
        head, colon, unit = text.rpartition(":")
        if not colon or text in self._source.names() or factor_of(unit, "s") is None:
            try:
                return self._source.find(text, "time", near), None
            except ParameterError:
                if not colon:
                    raise
        return self._source.find(head, "time", near), unit or None

    def _column(self, place: int) -> _Stamps:
        if place not in self._known:
            clock = self._source.clock(place)
            factor = self._factor_of(clock, place)
            self.used.add(place)
            base_s = clock.base * Fraction(str(factor))
            first = clock.values[int(np.argmin(np.isnan(clock.values)))] if len(clock.values) else 0
            begin_s = float(base_s) + (0.0 if np.isnan(first) else float(first) * factor)
            if not self._known and abs(begin_s) > LARGE_TIME_S:
                self.origin_s = float(np.floor(begin_s))
            # The origin is subtracted before the conversion to s, so that no digits are lost.
            shift = float((base_s - Fraction(self.origin_s)) / Fraction(str(factor)))
            if shift:
                np.add(clock.values, shift, out=clock.values)
            if factor != 1:
                np.multiply(clock.values, factor, out=clock.values)
            self._known[place] = _Stamps(clock.values, clock)
            self._expect_grid(place, clock.values)
        return self._known[place]

    def _factor_of(self, clock: Clock, place: int) -> float:
        """Returns the size in s of the unit of the times in the column at a place. Raises
        InputError, ParameterError."""
        asked = self._wanted(place)[1]
        if clock.is_text:
            if asked is not None and factor_of(asked, "s") != 1:
                raise ParameterError(
                    "time", f"{clock.name}: expected no unit, as this column has clock times, got "
                    f"{asked}; write `time` {clock.name}"
                )  # fmt: skip
            return 1.0
        unit = asked or clock.unit
        factor = factor_of(unit, "s") if unit else None
        if clock.name.rpartition("/")[2] == "tick" and not unit:
            factor = 1 / _core.TICKS_PER_SECOND
        if factor is None:
            raise InputError(
                f"{self._source.where}: {clock.name}: expected the unit of the times, got "
                f"{unit or 'none'}; write `time` {clock.name}:{_units_for(clock)}"
            )
        if asked and clock.unit and (factor_of(clock.unit, "s") or factor) != factor:
            self._notes.append(
                f"the source gives the unit {clock.unit!r} for the times {clock.name}, which were "
                f"read in {asked} as asked for"
            )
        return factor

    def _expect_grid(self, place: int, time_s: Floats) -> None:
        """Notes that the step of the times differs from the step that the source states."""
        grid = self._source.heads[place].grid
        known = time_s[:1000][np.isfinite(time_s[:1000])]
        if grid is None or grid.doubt or len(known) < 3:
            return
        step_s = float(np.median(np.diff(known)))
        if abs(step_s - grid.step_s) > 0.01 * grid.step_s:
            self._notes.append(
                f"the times of {self._source.heads[place].name} have steps of {step_s:.6g} s, but "
                f"the source states {grid.text}"
            )

    def _expect_stamps(
        self, clock: Clock, column: SourceColumn, time_s: Floats, row: Callable[[int], int]
    ) -> None:
        without = np.flatnonzero(np.isnan(time_s))
        if len(without):
            raise InputError(
                f"{self._source.where}: {clock.place(row(int(without[0])))}: expected a time for "
                f"the value of {column.name}, got none; add the time or remove the sample"
            )

    def _ascending(
        self, clock: Clock, column: SourceColumn, time_s: Floats, values: Floats,
        row: Callable[[int], int],
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Returns ascending times and their values, without samples that repeat the sample before
        at the same time. Raises InputError for other times."""
        same = np.zeros(len(time_s), dtype=bool)
        np.equal(time_s[1:], time_s[:-1], out=same[1:])
        if same.any():
            repeated = same.copy()
            repeated[1:] &= values[1:] == values[:-1]
            if same.sum() > COARSE_SHARE * len(same) and not repeated[same].all():
                raise self._coarse(clock, time_s, ~same, row)
            if repeated.any():
                first = int(np.flatnonzero(repeated)[0])
                self._notes.append(
                    f"{column.name}: {counted(int(repeated.sum()), 'sample')} left out, which "
                    f"repeat the sample before at the same time, first {clock.place(row(first))}"
                )
            kept = np.flatnonzero(~repeated)
            time_s, values, row = time_s[kept], values[kept], _row_behind(kept, row)
        wrong = np.flatnonzero(time_s[1:] <= time_s[:-1])
        if len(wrong):
            at = int(wrong[0])
            raise InputError(
                f"{self._source.where}: {clock.place(row(at + 1))}: expected a time later than "
                f"that of the sample before, {time_s[at]:.9g} s, got {time_s[at + 1]:.9g} s; sort "
                "the samples, or export a recording during which the clock was not restarted"
            )
        return time_s, values

    def _coarse(
        self, clock: Clock, time_s: Floats, is_new: NDArray[np.bool_], row: Callable[[int], int]
    ) -> InputError:
        news = np.flatnonzero(is_new)
        step_s = float(np.median(np.diff(time_s[news]))) if len(news) > 1 else 0.0
        hint = "export the times with more digits"
        if len(news) > 2:  # the first and the last time stamp may belong to fewer samples
            rate_hz = (news[-1] - news[1]) / (time_s[news[-1]] - time_s[news[1]])
            hint += f", or write `rate` {float(f'{rate_hz:.4g}'):g} for samples at a constant rate"
        first = int(np.flatnonzero(~is_new)[0])
        return InputError(
            f"{self._source.where}: {clock.place(row(first))}: expected another time for each "
            f"sample, got {counted(len(time_s), 'sample')} with {counted(len(news), 'time')} in "
            f"steps of {step_s:.6g} s; {hint}"
        )


def _units_for(clock: Clock) -> str:
    """Returns the units that a user can write for times without a unit. Numbers since 1970 tell it
    by their size."""
    first = abs(float(clock.base) + (float(clock.values[0]) if len(clock.values) else 0.0))
    for unit, size in (("ns", 1e18), ("us", 1e15), ("ms", 1e12), ("s", 1e9)):
        if 0.5 * size < first < 4 * size:
            return f"{unit}, as the numbers look like {unit} since 1970"
    return "ms, or :s, :us"


def _row_behind(kept: NDArray[np.int64], row: Callable[[int], int]) -> Callable[[int], int]:
    """Returns the function that gives the row of a sample, after only some samples were kept."""
    return lambda sample: row(int(kept[sample]))


def _grid(count: int, begin_s: float, step_s: float) -> Floats:
    times = np.arange(count, dtype=np.float64)
    times *= step_s
    times += begin_s
    return times


def restarts(values: Floats) -> list[int]:
    """Returns the rows at which ascending times begin again at an earlier time. Returns none for
    times that go back in any other way."""
    if len(values) < 2 * LEAST_SAMPLES:
        return []
    falls = np.flatnonzero(values[1:] < values[:-1]) + 1
    if not len(falls) or len(falls) > len(values) / LEAST_SAMPLES:
        return []
    lengths = np.diff([0, *falls, len(values)])
    steps = np.diff(values)
    period = float(np.median(steps[steps > 0]))
    after = steps[falls[falls < len(steps)]]
    is_restart = (
        lengths.min() >= LEAST_SAMPLES
        and (-steps[falls - 1] >= FALL_PERIODS * period).all()
        and (after <= STEP_PERIODS * period).all()
    )
    return [int(row) for row in falls] if is_restart else []


def rate_of(time_s: Floats) -> float:
    """Returns the rate of samples in Hz: the rate of equally spaced times through rounded times, or
    the median rate. Digits that are only rounding errors are removed."""
    some = time_s[:RATED_SAMPLES]
    steps = np.diff(even_times(some))
    return float(f"{1 / np.median(steps):.9g}")
