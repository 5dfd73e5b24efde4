"""Proportions of parts, such as the proportion of good parts, with exact 95 % confidence intervals.
Also computes the number of parts that is needed for a statement about a proportion."""

import math
from dataclasses import dataclass

from scipy import special

CONFIDENCE = 0.95
# Smallest number of good parts from which bounds are proposed (Wilks), because 0.99^299 < 0.05:
# with 95 % confidence, 99 % of later values do not exceed the largest of 299 values.
PARTS_LEAST = 299


@dataclass(frozen=True)
class Share:
    """The proportion of parts with some property, such as good parts, and its confidence interval
    (Clopper and Pearson). If there are no parts, the proportion is None and the interval is 0 to
    1."""

    count: int
    of: int
    share: float | None
    low: float
    high: float


def share(count: int, of: int, confidence: float = CONFIDENCE) -> Share:
    """Returns the proportion `count` / `of` with its confidence interval. The interval contains the
    true probability with at least the probability `confidence`."""
    tail = (1 - confidence) / 2
    low = float(special.betaincinv(count, of - count + 1, tail)) if count else 0.0
    high = float(special.betaincinv(count + 1, of - count, 1 - tail)) if count < of else 1.0
    return Share(count, of, count / of if of else None, low, high)


def refused_range(blocks: int, parts: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Returns a confidence range for the fraction of later parts that proposed bounds refuse. The
    bounds were computed from `parts` parts by the removal of `blocks` parts (statistically
    equivalent blocks). The fraction has the distribution Beta(blocks, parts + 1 - blocks)."""
    tail = (1 - confidence) / 2
    low, high = special.betaincinv(blocks, parts + 1 - blocks, [tail, 1 - tail])
    return float(low), float(high)


def parts_needed(rate: float, bounds: int) -> int:
    """Returns the smallest number of good parts that a proposal of bounds needs, from two
    conditions. At least one part can be removed for each bound. With 95 % confidence, at most the
    fraction `rate` of later parts is beyond the most extreme parts."""
    wilks = math.ceil(math.log(1 - CONFIDENCE) / math.log1p(-rate))
    return max(PARTS_LEAST, wilks, math.ceil(bounds / rate - 1e-9) - 1)
