"""Times of the samples of a source: texts with clock times, and numbers that lose no digits.

A time since 1970 has more digits than a number in the memory. The first time of a column is
therefore subtracted as an integer, before the rest becomes a number in s.
"""

import datetime
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from forceaxis.recordings.signal_recording import Floats

NS_PER_S = 1_000_000_000
DAY_NS = 86_400 * NS_PER_S
NO_TIME_NS = int(np.iinfo(np.int64).min)  # stands for an empty text
FORMS = (
    "14:03:04.125, 2026-05-14T14:03:04.125, 14.05.2026 14:03:04,125 or 05/14/2026 02:03:04.125 PM"
)
MONTHS = {
    name: number
    for number, names in enumerate(
        ("jan", "feb", "mar mär mrz", "apr", "may mai", "jun", "jul", "aug", "sep", "oct okt",
         "nov", "dec dez"), 1,
    )
    for name in names.split()
}  # fmt: skip
_DATE = r"""(?:(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})
        |(?P<one>\d{1,2})(?P<mark>[-/.])(?P<two>\d{1,2})(?P=mark)(?P<year2>\d{4}|\d{2})
        |(?P<day3>\d{1,2})[-\ .]+(?P<name>[A-Za-zä]{3,9})\.?[-\ ](?P<year3>\d{4}|\d{2}))"""
_DATE_ALONE = re.compile(rf"{_DATE}$", re.VERBOSE)
_CLOCK = re.compile(
    rf"""(?:{_DATE}[T ,_-]+)?"""
    r"""(?P<hour>\d{1,2}):(?P<minute>\d{2})
        (?::(?P<second>\d{2})(?:[.,:](?P<part>\d{1,12}))?)?
        \ ?(?P<half>[AaPp]\.?[Mm]\.?)?
        \ ?(?P<zone>Z|UTC|[-+]\d{2}:?\d{2})?$""",
    re.VERBOSE,
)
# A clock time without hours, such as 03:04.125.
_MINUTES = re.compile(r"(?P<minute>\d{1,3}):(?P<second>\d{2})[.,](?P<part>\d{1,12})$")
ORIGIN = datetime.date(1970, 1, 1).toordinal()


class ClockError(ValueError):
    """Error: a text is no clock time. `row`: number of the text from 0. `text`: what is wrong."""

    def __init__(self, row: int, text: str) -> None:
        super().__init__(text)
        self.row = row


def is_clock(text: str) -> bool:
    """Returns True if a text is a clock time, perhaps with a date."""
    return ":" in text and bool(_CLOCK.match(text) or _MINUTES.match(text))


@dataclass(frozen=True)
class Clock:
    """Times of a column relative to its begin. The time is (base + values) units of `unit`. The
    values belong to the reader of the times, which may change them."""

    name: str
    unit: str | None  # unit that the source states
    values: Floats = field(repr=False)  # NaN where there is no time
    base: Fraction = Fraction(0)
    lines: Sequence[int] = field(repr=False, default=())
    is_text: bool = False  # True for clock times; their unit is s, whatever a user says

    def place(self, sample: int) -> str:
        """Returns the place of a time in its file as text for messages."""
        if len(self.lines):
            return f"line {self.lines[sample]}, {self.name}"
        return f"{self.name}, sample {sample}"


def is_date(text: str) -> bool:
    """Returns True if a text is a date without a time."""
    return bool(_DATE_ALONE.match(text))


def is_time_of_day(text: str) -> bool:
    """Returns True if a text is a clock time without a date."""
    found = _CLOCK.match(text)
    return found is not None and not (found["year"] or found["one"] or found["name"])


def is_whole_second(text: str) -> bool:
    """Returns True if a text is a clock time with seconds and without a part of a second."""
    found = _CLOCK.match(text)
    return found is not None and bool(found["second"]) and found["part"] is None


def is_millisecond(text: str) -> bool:
    """Returns True if a text is a whole number from 0 to 999."""
    return text.isdecimal() and int(text) < 1000


def are_milliseconds(times: Sequence[str], parts: Sequence[str]) -> bool:
    """Returns True if texts may be the milliseconds of clock times in whole seconds: whole numbers
    up to 999 that ascend within a second, and mostly begin again with the next one."""
    if not all(map(is_millisecond, filter(None, parts))):
        return False
    known = [(time, int(part)) for time, part in zip(times, parts, strict=True) if time and part]
    inside = [b[1] >= a[1] for a, b in itertools.pairwise(known) if a[0] == b[0]]
    across = [b[1] < a[1] for a, b in itertools.pairwise(known) if a[0] != b[0]]
    # Without two rows in a second, nothing can be seen.
    return all(inside) and (not inside or 2 * sum(across) >= len(across))


def joined(times: Sequence[str], dates: Sequence[str], parts: Sequence[str]) -> list[str]:
    """Returns the clock times of texts in several columns: times of the day, their dates, and the
    milliseconds behind them. `dates` and `parts` may be empty. A time without its date or its
    milliseconds is none. Raises ClockError for other milliseconds than 0 to 999."""
    found = list(times)
    if parts:
        wrong = (k for k, part in enumerate(parts) if part and not is_millisecond(part))
        if (row := next(wrong, None)) is not None:
            raise ClockError(row, f"expected milliseconds from 0 to 999, got {parts[row][:40]!r}")
        found = [f"{a}.{int(b):03}" if a and b else "" for a, b in zip(found, parts, strict=True)]
    if dates:
        found = [f"{b} {a}" if a and b else "" for a, b in zip(found, dates, strict=True)]
    return found


class ClockReader:
    """Reads the clock times of one column, in parts. The order of day and month is the same in the
    whole column. `notes`: what a user has to know about it."""

    def __init__(self, samples: Sequence[str]) -> None:
        self.notes: list[str] = []
        self._day_first, self._is_sure = _order(samples)
        self._dates: dict[tuple[str | None, ...], int] = {}
        self._last_ns: int | None = None
        self._midnight_ns = 0

    def read(self, texts: Sequence[str]) -> NDArray[np.int64]:
        """Returns the times in ns since 1970 or since midnight, or the smallest integer for an
        empty text. Raises ClockError."""
        times = _equal_forms(texts, self)
        if times is None:
            times = np.array(
                [self.time_ns(row, text) for row, text in enumerate(texts)], dtype=np.int64
            )
        return self._without_midnights(times)

    def time_ns(self, row: int, text: str) -> int:
        """Returns the time of one text. `row`: its number for messages. Raises ClockError."""
        if not text:
            return NO_TIME_NS
        found = _CLOCK.match(text)
        if found is None:
            short = _MINUTES.match(text)
            if short is None:
                raise ClockError(row, f"expected a time such as {FORMS}, got {text[:40]!r}")
            minutes, seconds = int(short["minute"]), int(short["second"])
            return (60 * minutes + seconds) * NS_PER_S + _part_ns(short["part"])
        key = found.group("year", "month", "day", "one", "two", "year2", "day3", "name", "year3")
        if key not in self._dates:
            self._dates[key] = self._day_of(row, text, found)
        return self._dates[key] + _time_of_day_ns(row, text, found) - _zone_ns(found["zone"])

    def _day_of(self, row: int, text: str, found: re.Match[str]) -> int:
        if found["year"]:
            numbers = [int(found[key]) for key in ("year", "month", "day")]
        elif found["one"]:
            day, month = int(found["one"]), int(found["two"])
            if found["mark"] != "." and not self._day_first:
                day, month = month, day
            numbers = [_whole_year(found["year2"]), month, day]
            if found["mark"] != "." and not self._is_sure:
                if self._dates:
                    raise ClockError(
                        row, "expected dates with a known order of day and month, got "
                        f"{text[:40]!r}; export dates such as 2026-05-14"
                    )  # fmt: skip
                self.notes.append(f"the date of {text[:40]!r} was read as month/day/year")
        elif found["name"]:
            month = MONTHS.get(found["name"][:3].casefold(), 0)
            numbers = [_whole_year(found["year3"]), month, int(found["day3"])]
        else:
            return 0
        try:
            return (datetime.date(*numbers).toordinal() - ORIGIN) * DAY_NS
        except ValueError:
            raise ClockError(row, f"expected a date, got {text[:40]!r}") from None

    def _without_midnights(self, times: NDArray[np.int64]) -> NDArray[np.int64]:
        """Adds a day to clock times without a date after each midnight."""
        known = times[times != NO_TIME_NS]
        if not len(known) or int(known.max()) >= DAY_NS:
            return times
        first = known[0] if self._last_ns is None else self._last_ns
        falls = np.diff(known, prepend=first) < -DAY_NS // 2
        days = self._midnight_ns + np.cumsum(falls) * DAY_NS
        if falls.any() and not self._midnight_ns:
            self.notes.append("the clock times pass midnight")
        self._last_ns, self._midnight_ns = int(known[-1]), int(days[-1])
        times = times.copy()
        times[times != NO_TIME_NS] = known + days
        return times


def _order(samples: Sequence[str]) -> tuple[bool, bool]:
    """Returns (the day is before the month, this is sure) for dates such as 05/14/2026."""
    found = [match for text in samples if (match := _CLOCK.match(text)) and match["one"]]
    if any(int(match["one"]) > 12 for match in found):
        return True, True
    return False, any(int(match["two"]) > 12 or match["half"] for match in found)


def _part_ns(part: str | None) -> int:
    return int((part or "0")[:9].ljust(9, "0"))


def _whole_year(text: str) -> int:
    return int(text) + (2000 if len(text) == 2 else 0)


def _time_of_day_ns(row: int, text: str, found: re.Match[str]) -> int:
    hour, minute, second = (int(found[key] or 0) for key in ("hour", "minute", "second"))
    half = (found["half"] or "").casefold()[:1]
    if half:
        hour = hour % 12 + (12 if half == "p" else 0)
    has_date = found["year"] or found["one"] or found["name"]
    if (hour > 24 and has_date) or minute > 59 or second > 60:
        raise ClockError(row, f"expected a time of the day, got {text[:40]!r}")
    return (3600 * hour + 60 * minute + second) * NS_PER_S + _part_ns(found["part"])


def _zone_ns(zone: str | None) -> int:
    if not zone or zone[0] not in "+-":
        return 0
    minutes = 60 * int(zone[1:3]) + int(zone[-2:])
    return (minutes if zone[0] == "+" else -minutes) * 60 * NS_PER_S


def _equal_forms(texts: Sequence[str], reader: ClockReader) -> NDArray[np.int64] | None:
    """Reads texts that differ in the digits of their time of day alone, all at once. Returns None
    for other texts."""
    first = texts[0] if len(texts) else ""
    found = _CLOCK.match(first)
    if found is None or len(texts) < 2 or not first.isascii():
        return None
    try:
        table = np.array(texts, dtype=f"S{len(first) + 1}")
    except UnicodeEncodeError:
        return None
    codes = table.view(np.uint8).reshape(len(texts), len(first) + 1)
    digits = np.zeros(len(first) + 1, dtype=bool)
    weights_ns = np.zeros(len(first) + 1, dtype=np.int64)
    for key, unit_ns in (("hour", 3600), ("minute", 60), ("second", 1)):
        begin, end = found.span(key)
        for place in range(begin, end):
            digits[place] = True
            weights_ns[place] = unit_ns * NS_PER_S * 10 ** (end - 1 - place)
    begin, end = found.span("part")
    for place in range(begin, min(end, begin + 9)):
        digits[place] = True
        weights_ns[place] = 10 ** (8 - (place - begin))
    if found["half"]:  # the hour has another meaning
        digits[slice(*found.span("hour"))] = False
    if not np.array_equal(
        codes[:, ~digits], np.broadcast_to(codes[0, ~digits], codes[:, ~digits].shape)
    ):
        return None
    numbers = codes[:, digits].astype(np.int64) - ord("0")
    if numbers.min() < 0 or numbers.max() > 9:
        return None
    tens = [found.span(key)[0] for key in ("minute", "second") if found[key]]
    if (codes[:, tens] > ord("5")).any():  # another function reports the wrong line
        return None
    start_ns = reader.time_ns(0, first)
    steps = numbers @ weights_ns[digits]
    return np.asarray(start_ns + steps - steps[0], dtype=np.int64)
