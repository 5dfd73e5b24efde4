"""Shares of parts with exact 95 % confidence intervals, and the number of parts that a statement
about a share needs."""

import math
from dataclasses import dataclass

from scipy import special

CONFIDENCE = 0.95
# Smallest number of good parts from which bounds are proposed (Wilks): 0.99^299 < 0.05.
# With 95 % confidence, 99 % of later values do not exceed the largest of 299 values.
PARTS_LEAST = 299


@dataclass(frozen=True)
class Share:
    """A share of parts with its confidence interval (Clopper and Pearson). Without any part, the
    share is None and the interval is 0 to 1."""

    count: int
    of: int
    share: float | None
    low: float
    high: float


def share(count: int, of: int, confidence: float = CONFIDENCE) -> Share:
    """Returns the share `count` / `of` and the interval that contains the true probability with at
    least the probability `confidence`."""
    tail = (1 - confidence) / 2
    low = float(special.betaincinv(count, of - count + 1, tail)) if count else 0.0
    high = float(special.betaincinv(count + 1, of - count, 1 - tail)) if count < of else 1.0
    return Share(count, of, count / of if of else None, low, high)


def refused_range(blocks: int, parts: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Returns the range of the share of later parts that is outside a region from which `blocks` of
    `parts` parts were taken one by one (statistically equivalent blocks): Beta(blocks, parts + 1 -
    blocks)."""
    tail = (1 - confidence) / 2
    low, high = special.betaincinv(blocks, parts + 1 - blocks, [tail, 1 - tail])
    return float(low), float(high)


def parts_needed(rate: float, bounds: int) -> int:
    """Returns the smallest number of good parts for a proposal: each bound needs at least one part,
    and the most extreme parts must show with 95 % confidence that at most the share `rate` of later
    parts is beyond them."""
    wilks = math.ceil(math.log(1 - CONFIDENCE) / math.log1p(-rate))
    return max(PARTS_LEAST, wilks, math.ceil(bounds / rate - 1e-9) - 1)
