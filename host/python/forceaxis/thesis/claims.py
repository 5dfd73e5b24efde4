"""Checks the thesis: compares the numbers that the thesis quotes with the numbers that its models
give.

Each chapter has a module with its claims. The file sentences.toml lists the sentences of the thesis
to which the claims belong.
"""

from dataclasses import dataclass

from forceaxis.thesis import chapter_2, chapter_3, chapter_4, chapter_5, chapter_6
from forceaxis.thesis.claim import CheckedClaim

CLAIMS = [
    *chapter_2.CLAIMS,
    *chapter_3.CLAIMS,
    *chapter_4.CLAIMS,
    *chapter_5.CLAIMS,
    *chapter_6.CLAIMS,
]


@dataclass(frozen=True)
class CheckedClaims:
    """All numbers and statements of the thesis, each with the value that a model gives."""

    claims: list[CheckedClaim]
    agree: int  # number of claims with which the models agree
    differ: int  # number of claims with which the models disagree
    # number of claims with which the models disagree without a known reason
    unexplained: int


def check() -> CheckedClaims:
    """Returns all numbers and statements of the thesis, each with the value that a model gives."""
    claims = [claim.checked() for claim in CLAIMS]
    return CheckedClaims(
        claims=claims,
        agree=sum(c.agrees for c in claims),
        differ=sum(not c.agrees for c in claims),
        unexplained=sum(not c.agrees and not c.why for c in claims),
    )


def value(number: float | str, unit: str) -> str:
    """Returns a number with its unit as text. A number below 1000 has 3 significant digits, and a
    larger number has no decimals. A value that is already a text is returned unchanged."""
    if not isinstance(number, str):
        number = f"{number:.3g}" if number < 1e3 else f"{number:.0f}"
    return f"{number} {unit}".strip()
