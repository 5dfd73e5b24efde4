"""One number or statement of the thesis, and its comparison with the value that a model gives."""

from collections.abc import Callable
from dataclasses import dataclass

from forceaxis.words import plain


@dataclass(frozen=True)
class CheckedClaim:
    """One number or statement of the thesis, and the value that a model of the thesis gives for
    it."""

    where: str
    what: str
    thesis: float | str
    ours: float | str
    unit: str
    # Largest permitted relative difference from the number of the thesis; None for a statement.
    within: float | None
    agrees: bool
    why: str  # reason why the value of the model differs from that of the thesis


@dataclass(frozen=True)
class Claim:
    """One number or statement of the thesis. `what`: unique name of the number or statement.

    `ours`: function that computes the value from the models. A number agrees if its relative
    difference from that of the thesis is at most `within`. With `at_least`, a larger number agrees
    too. A text agrees if its part before a colon is that of the thesis, as in "higher: 2.83 times".
    `why`: reason for a difference.
    """

    where: str
    what: str
    thesis: float | str
    unit: str
    ours: Callable[[], float | str]
    within: float = 0.05
    why: str = ""
    at_least: bool = False

    def checked(self) -> CheckedClaim:
        """Computes the value that the models give for this claim. Returns the claim with this
        value."""
        ours = self.ours()
        if isinstance(self.thesis, str) or isinstance(ours, str):
            agrees = str(ours).partition(":")[0] == self.thesis
        else:
            agrees = abs(ours - self.thesis) <= self.within * abs(self.thesis)
            agrees = agrees or (self.at_least and ours > self.thesis)
        return CheckedClaim(
            where=self.where,
            what=self.what,
            thesis=self.thesis,
            ours=ours,
            unit=self.unit,
            within=None if isinstance(self.thesis, str) else self.within,
            agrees=bool(agrees),
            why="" if agrees else self.why,
        )


def stated(holds: bool, word: str, value: str) -> str:
    """Returns the text of a statement with a value after a colon. An example is "higher: 2.83
    times" if the statement holds, and "not higher: 0.9 times" if it does not hold."""
    return f"{word}: {value}" if holds else f"not {word}: {value}"


def compared(ratio: float, word: str, below: bool = False) -> str:
    """Returns the text of a statement about a ratio of two values. The statement `word`, such as
    "higher", holds if the ratio is above 1. With `below`, it holds if the ratio is below 1."""
    return stated(ratio < 1 if below else ratio > 1, word, f"{plain(ratio)} times")
