"""The numbers that the thesis quotes, and the numbers that the models of the thesis give.
A check compares both.

Each chapter has a module with its claims; sentences.toml lists the sentences of the thesis to which
they belong.
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
    """All numbers and statements of the thesis, together with the values that the models give."""

    claims: list[CheckedClaim]
    agree: int  # number of claims of the thesis with which the models agree
    differ: int  # number of claims of the thesis with which the models disagree
    # number of claims of the thesis that differ from the model without a known reason
    unexplained: int


def check() -> CheckedClaims:
    """Returns all numbers and statements of the thesis, each together with the value that a model
    gives."""
    claims = [claim.checked() for claim in CLAIMS]
    return CheckedClaims(
        claims=claims,
        agree=sum(c.agrees for c in claims),
        differ=sum(not c.agrees for c in claims),
        unexplained=sum(not c.agrees and not c.why for c in claims),
    )


def value(number: float | str, unit: str) -> str:
    """Returns a number with its unit as text. Numbers below 1000 have 3 digits, and larger numbers
    have no decimals. A value that already is a text is returned unchanged."""
    if not isinstance(number, str):
        number = f"{number:.3g}" if number < 1e3 else f"{number:.0f}"
    return f"{number} {unit}".strip()
