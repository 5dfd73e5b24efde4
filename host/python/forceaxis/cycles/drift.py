"""Finds wear and drift in a series of pressed parts. Each evaluation element is tested by itself.

The test is a CUSUM of sequential ranks (McDonald 1990). The rank of a part is the number of
earlier parts with a smaller value, plus one. If nothing changes, that is, if the parts are
independent and their values have the same distribution, the rank of part i has each of the values
1 to i with the same probability, and the ranks are independent. This holds for any distribution.
The score of a rank is the quantile of the standard normal distribution at rank / (i + 1), in steps
of STEP. The first parts, the reference, only give ranks. After them, two sums are formed, one for
a rise and one for a fall:

    sum = max(0, sum + score - ALLOWANCE)      the fall has the negative score

An element is flagged at the first part at which a sum exceeds its limit. The sums are whole
numbers of steps, so their distribution is computed exactly, part by part. The limit is the smallest
one that a sum exceeds in at most the wanted share of series without a change. This share is divided
by the number of elements and by two for the directions (Bonferroni). The stated share is therefore
an upper bound, whatever the dependence of the elements. Parts with equal values share the mean of
their ranks, which makes false alarms rarer.
"""

import bisect
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from forceaxis.cycles.outcome import ABORTED
from forceaxis.cycles.record import PartRecord, measured
from forceaxis.errors import ParameterError

# Scores and their sums are integers. A step (one unit) is this part of a standard deviation.
STEP = 0.05
SCORE_MOST = 80  # Largest score of a value, in steps. It is 4 standard deviations.
# The test detects a change of the mean earliest if the change is twice this distance.
ALLOWANCE = 10  # number of steps that each sum loses at each part: half a standard deviation
REFERENCE_LEAST = 10
REFERENCE = 30
FALSE_ALARMS = 0.01
RATE_LEAST = 1e-6
# Borders between the scores, as probabilities of the standard normal distribution.
BORDERS = special.ndtr((np.arange(-SCORE_MOST, SCORE_MOST) + 0.5) * STEP)
TOO_FEW = "fewer values than the reference and one more"
WINDOW = "the value of a window is a number of entries"
RISE, FALL = "rises", "falls"


@dataclass(frozen=True)
class Series:
    """The values of one evaluation element in a series of parts, in `unit`."""

    name: str
    unit: str
    # True if the evaluation element counts how often the curve enters a window
    is_count: bool
    # values in the order of the parts; None for a part in which the evaluation element has no value
    values: Sequence[float | None]


@dataclass(frozen=True)
class ElementDrift:
    """Result of the test of one evaluation element for wear and drift. The first part has the
    number 1.
    """

    name: str
    unit: str
    # number of parts in which the element has a value, including the first parts (the reference)
    n: int
    # number of the part at which the test detected a change; None if it detected none
    found_at: int | None
    since: int | None  # number of the part at which the change of the values probably began
    direction: str  # "rises" or "falls"; empty without a change
    # mean of the values from part `since` on, minus the mean of the earlier values, in `unit`
    change: float | None
    # largest sum of scores at which the test reports no change, in standard deviations
    limit: float | None
    # upper bound of the share of unchanged series in which this test reports a change by mistake
    false_alarms: float
    without: str  # reason why the element was not tested; empty if it was tested


@dataclass(frozen=True)
class Drift:
    """The test of a series of parts for wear and drift."""

    parts: int
    # number of first values of each element (the reference) with which later values are compared
    reference: int
    # requested share of unchanged series in which the test reports a change by mistake
    wanted: float
    # upper bound of the share of unchanged series in which the test of any element reports a change
    false_alarms: float
    elements: list[ElementDrift]

    @property
    def is_found(self) -> bool:
        """True if the test has detected a change of at least one evaluation element."""
        return any(element.found_at is not None for element in self.elements)


def series_of(records: Sequence[PartRecord]) -> list[Series]:
    """Returns the values of each evaluation element in a series of parts with the same cycle
    program. A part that was aborted has no values."""
    values = [
        {} if record.state == ABORTED else {e.name: measured(e) for e in record.elements}
        for record in records
    ]
    return [
        Series(one.name, one.unit, one.kind == "window", [known.get(one.name) for known in values])
        for one in (records[-1].elements if records else [])
    ]


def scores(values: Sequence[float]) -> list[int]:
    """Returns the score of each value in steps. The score follows from the rank of the value among
    itself and all earlier values.
    """
    known: list[float] = []
    ranks = []
    for value in values:
        less, most = bisect.bisect_left(known, value), bisect.bisect_right(known, value)
        # equal values have the ranks less + 1 to most + 1, and each gets the mean of these ranks
        ranks.append((less + most) / 2 + 1)
        known.insert(most, value)
    shares = np.array(ranks) / np.arange(2, len(ranks) + 2)
    return list((np.searchsorted(BORDERS, shares) - SCORE_MOST).tolist())


def distribution(i: int) -> NDArray[np.float64]:
    """Returns the probability of each score from -SCORE_MOST to SCORE_MOST for part i of a series
    whose values do not change."""
    below = np.clip(np.floor(BORDERS * (i + 1)), 0, i)
    return np.diff(np.concatenate([[0.0], below, [float(i)]])) / i


def exceeded(limit: int, reference: int, n: int) -> float:
    """Returns the probability that the sum of scores for rising (or for falling) values exceeds
    `limit` in a series of n parts whose values do not change. `limit` is in steps."""
    sums = np.zeros(limit + 1)
    sums[0] = 1.0
    for i in range(reference + 1, n + 1):
        # Element j of `spread` is the probability of the sum j - SCORE_MOST - ALLOWANCE.
        spread = np.convolve(sums, distribution(i))
        at_zero = SCORE_MOST + ALLOWANCE
        kept = spread[at_zero : at_zero + limit + 1]
        sums[:] = 0.0
        sums[: len(kept)] = kept
        sums[0] += spread[:at_zero].sum()
    return max(0.0, 1.0 - float(sums.sum()))


@functools.cache
def limit_of(reference: int, n: int, share: float) -> tuple[int, float]:
    """Returns the smallest limit, in steps, that a sum of scores exceeds in at most the share
    `share` of unchanged series. Also returns the exact share of these series."""
    low, high = 0, SCORE_MOST
    while exceeded(high, reference, n) > share:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if exceeded(middle, reference, n) > share else (low, middle)
    return high, exceeded(high, reference, n)


def _first_alarm(steps: Sequence[int], reference: int, limit: int) -> tuple[int, int] | None:
    """Returns two indices of values, or None if the sum of the scores never exceeds the limit. At
    the first value, the sum exceeds the limit. The second value is the first one after the sum was
    last 0."""
    total, since = 0, reference
    for i in range(reference, len(steps)):
        if total == 0:
            since = i
        total = max(0, total + steps[i] - ALLOWANCE)
        if total > limit:
            return i, since
    return None


def check(share: float, reference: int) -> None:
    """Raises ParameterError if the wanted share of false alarms is not possible, or the
    reference."""
    if not RATE_LEAST <= share <= 0.5:
        raise ParameterError(
            "false_alarms", f"expected a share from {RATE_LEAST:g} to 0.5, got {share:g}"
        )
    if reference < REFERENCE_LEAST:
        raise ParameterError(
            "reference", f"expected at least {REFERENCE_LEAST} parts, got {reference}"
        )


def drift(
    series: Sequence[Series], share: float = FALSE_ALARMS, reference: int = REFERENCE
) -> Drift:
    """Tests whether the values of each evaluation element change after the first `reference`
    values. In at most the fraction `share` of unchanged series, the test reports a change by
    mistake. Raises ParameterError."""
    check(share, reference)
    known = [[(k, v) for k, v in enumerate(one.values, 1) if v is not None] for one in series]
    without = [
        WINDOW if one.is_count else TOO_FEW if len(numbered) <= reference else ""
        for one, numbered in zip(series, known, strict=True)
    ]
    tested = max(1, without.count(""))
    found = []
    for one, numbered, why in zip(series, known, without, strict=True):
        plain = ElementDrift(
            one.name, one.unit, len(numbered), None, None, "", None, None, 0.0, why
        )  # fmt: skip
        found.append(plain if why else _tested(plain, numbered, reference, share / tested))
    return Drift(
        parts=max((len(one.values) for one in series), default=0),
        reference=reference,
        wanted=share,
        false_alarms=sum(element.false_alarms for element in found),
        elements=found,
    )


def _tested(
    plain: ElementDrift, numbered: Sequence[tuple[int, float]], reference: int, share: float
) -> ElementDrift:
    """Returns the result of the test of one evaluation element. `numbered`: pairs (number of the
    part, value of the element).
    """
    limit, one_side = limit_of(reference, len(numbered), share / 2)
    values = [value for _, value in numbered]
    steps = scores(values)
    tested = replace(plain, limit=limit * STEP, false_alarms=2 * one_side)
    alarms = [
        (*alarm, direction)
        for direction, sign in ((RISE, 1), (FALL, -1))
        if (alarm := _first_alarm([sign * step for step in steps], reference, limit))
    ]
    if not alarms:
        return tested
    at, since, direction = min(alarms)
    change = math.fsum(values[since:]) / len(values[since:]) - math.fsum(values[:since]) / since
    return replace(
        tested, found_at=numbered[at][0], since=numbered[since][0], direction=direction,
        change=change,
    )  # fmt: skip
