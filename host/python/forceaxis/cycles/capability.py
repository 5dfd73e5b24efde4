"""Statistics of pressed parts: the proportion of good parts, and for each evaluation element the
mean, the standard deviation, the process capability, and all values in the order of the parts.

The capability is computed from the mean m and the standard deviation s of all values (with n - 1 in
the denominator), and from the lower bound L and the upper bound U:

    Cp  = (U - L) / (6 s)                        only if there are two bounds
    Cpk = min((U - m) / (3 s), (m - L) / (3 s))  with one bound: only its term

Other texts call these two numbers Pp and Ppk, because s is the standard deviation of all values and
not that within groups of parts. A drift of the process is therefore included. The confidence
interval of Cp is exact (chi-squared distribution). The interval of Cpk is that of Bissell (1990).
Both intervals assume values with a normal distribution.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from forceaxis.cycles.outcome import ABORTED, BAD, GOOD
from forceaxis.cycles.part import ElementFigure
from forceaxis.cycles.record import LOST, CurvePoint, PartRecord, measured
from forceaxis.cycles.records import RecordedParts
from forceaxis.cycles.statistics import CONFIDENCE, Share, share

# Smallest number of values for which Cp and Cpk are computed.
# With 30 values, the confidence interval extends about 25 % of Cpk to each side.
VALUES_LEAST = 30
TOO_FEW = f"fewer than {VALUES_LEAST} values"
NO_BOUND = "no bound that is a number"
CONSTANT = "all values are equal"
BINS_MOST = 30
CURVES_DRAWN = 20  # largest number of curves that one plot shows over each other


@dataclass(frozen=True)
class Interval:
    """A number with the lower and the upper end of its 95 % confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class ElementStatistics:
    """The values of one evaluation element in all good and bad parts, in `unit`. The cycle program
    of the last part has the bounds `least` and `most`."""

    name: str
    unit: str
    least: float | None
    most: float | None
    n: int  # number of parts in which this evaluation element has a value
    not_found: int  # number of parts in which this evaluation element has no value
    # proportion of the parts whose value is within the bounds of this evaluation element
    good: Share
    mean: float | None
    deviation: float | None  # standard deviation of the values, with n - 1 in the denominator
    smallest: float | None
    largest: float | None
    cp: Interval | None
    cpk: Interval | None
    # reason why Cpk was not computed for this evaluation element; empty if it was computed
    without: str
    # values in the order of the parts; None for a part in which the evaluation element has no value
    values: list[float | None]


@dataclass(frozen=True)
class PartStatistics:
    """Statistics of recorded or simulated parts. The statistics of the evaluation elements use only
    parts that were pressed with the same cycle program as the last part."""

    source: str
    title: str  # title of the cycle program with which the last part was pressed
    program_crc: str
    parts: int
    good: int
    bad: int
    aborted: int
    lost: int  # number of parts whose results were lost in a power cut of the axis
    without_result: int
    good_share: Share  # number of good parts divided by the number of good and bad parts
    bad_in_row: int  # number of bad or aborted parts since the last good part
    # number of parts with another cycle program; statistics of the elements exclude these parts
    other_programs: int
    left_out: int  # number of simulated bad parts, which all statistics exclude
    elements: list[ElementStatistics]


def own_parts(records: Sequence[PartRecord]) -> list[PartRecord]:
    """Returns the parts that were pressed with the same cycle program as the last part, without
    those whose results were lost."""
    known = [record for record in records if record.state != LOST]
    return [record for record in known if record.program_crc == known[-1].program_crc]


def statistics(parts: RecordedParts) -> PartStatistics:
    """Returns the statistics of parts. `parts` must contain at least one part."""
    records = parts.records
    last = next((r for r in reversed(records) if r.state != LOST), records[-1])
    known = [record for record in records if record.state != LOST]
    own = own_parts(records)
    judged = [record for record in own if record.state in (GOOD, BAD)]
    states = [record.state for record in records]
    good, bad, aborted = (states.count(state) for state in (GOOD, BAD, ABORTED))
    names = [element.name for element in last.elements]
    return PartStatistics(
        source=parts.source,
        title=last.title,
        program_crc=last.program_crc,
        parts=len(records),
        good=good,
        bad=bad,
        aborted=aborted,
        lost=states.count(LOST),
        without_result=len(records) - good - bad - aborted - states.count(LOST),
        good_share=share(good, good + bad),
        bad_in_row=next(
            (i for i, state in enumerate(reversed(states)) if state == GOOD), len(states)
        ),
        other_programs=len(known) - len(own),
        left_out=parts.left_out,
        elements=[_element(name, judged, last) for name in names],
    )


def _element(name: str, judged: Sequence[PartRecord], last: PartRecord) -> ElementStatistics:
    """Returns the statistics of one evaluation element over the pressed parts."""
    found = [e for record in judged for e in record.elements if e.name == name]
    bounds = next(element for element in last.elements if element.name == name)
    values = [measured(element) for element in found]
    numbers = np.array([value for value in values if value is not None])
    few = ElementStatistics(
        name=name,
        unit=bounds.unit,
        least=bounds.least,
        most=bounds.most,
        n=len(numbers),
        not_found=len(values) - len(numbers),
        good=share(sum(element.verdict == GOOD for element in found), len(found)),
        mean=None,
        deviation=None,
        smallest=None,
        largest=None,
        cp=None,
        cpk=None,
        without=TOO_FEW,
        values=values,
    )
    if not len(numbers):
        return few
    mean = float(numbers.mean())
    deviation = float(numbers.std(ddof=1)) if len(numbers) > 1 else None
    figures = replace(
        few,
        mean=mean,
        deviation=deviation,
        smallest=float(numbers.min()),
        largest=float(numbers.max()),
    )
    without = _without(figures, bounds)
    if without or deviation is None:
        return replace(figures, without=without)
    return replace(
        figures,
        cp=cp(bounds.least, bounds.most, deviation, len(numbers)),
        cpk=cpk(bounds.least, bounds.most, mean, deviation, len(numbers)),
        without="",
    )


def _without(figures: ElementStatistics, bounds: ElementFigure) -> str:
    """Returns the reason why an evaluation element has no Cpk, or an empty text if it has a Cpk."""
    if bounds.least is None and bounds.most is None:
        return NO_BOUND
    if figures.n < VALUES_LEAST:
        return TOO_FEW
    is_constant = figures.smallest == figures.largest
    return CONSTANT if is_constant else ""


def cp(least: float | None, most: float | None, deviation: float, n: int) -> Interval | None:
    """Returns the process capability Cp of n values with its exact confidence interval. Returns
    None unless the evaluation element has two bounds."""
    if least is None or most is None:
        return None
    value = (most - least) / (6 * deviation)
    tail = (1 - CONFIDENCE) / 2
    # (n - 1) s^2 / sigma^2 has the chi-squared distribution with n - 1 degrees of freedom.
    low, high = (float(2 * special.gammaincinv((n - 1) / 2, p) / (n - 1)) for p in (tail, 1 - tail))
    return Interval(value, value * math.sqrt(low), value * math.sqrt(high))


def cpk(
    least: float | None, most: float | None, mean: float, deviation: float, n: int
) -> Interval | None:
    """Returns the process capability Cpk of n values with the confidence interval of Bissell.
    Returns None if the evaluation element has no bound."""
    sides = [
        *([] if least is None else [(mean - least) / (3 * deviation)]),
        *([] if most is None else [(most - mean) / (3 * deviation)]),
    ]
    if not sides:
        return None
    value = min(sides)
    z = float(special.ndtri((1 + CONFIDENCE) / 2))
    half = z * math.sqrt(1 / (9 * n) + value**2 / (2 * (n - 1)))
    return Interval(value, value - half, value + half)


def histogram(values: Sequence[float | None]) -> tuple[list[int], list[float]]:
    """Returns a histogram with classes of equal width: the number of values in each class, and the
    edges of the classes. The number of classes is the square root of the number of values, at most
    30."""
    numbers = np.array([value for value in values if value is not None])
    if not len(numbers):
        return [], []
    classes = max(1, min(BINS_MOST, round(math.sqrt(len(numbers)))))
    counts, edges = np.histogram(numbers, bins=classes)
    return counts.tolist(), edges.tolist()


def last_curves(
    parts: RecordedParts, most: int = CURVES_DRAWN
) -> list[tuple[str, list[CurvePoint]]]:
    """Returns the verdict and the curve of each of the last parts. Parts without a curve are
    skipped. At most `most` curves are returned."""
    found = [(r.state, r.curve) for r in parts.records if r.curve]
    return found[-most:] if most else []
