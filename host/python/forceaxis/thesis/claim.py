"""One number or statement of the thesis, and its comparison with the value that a model gives."""

from collections.abc import Callable
from dataclasses import dataclass

from forceaxis.words import plain


@dataclass(frozen=True)
class CheckedClaim:
    """One number or statement of the thesis, together with the value that a model of the thesis
    gives."""

    where: str
    what: str
    thesis: float | str
    ours: float | str
    unit: str
    # Largest permitted relative difference from the number of the thesis. None for a statement.
    within: float | None
    agrees: bool
    why: str  # reason why the value of the model differs from the thesis


@dataclass(frozen=True)
class Claim:
    """One number or statement of the thesis. `what` names it and is different for each claim.

    `ours` computes the value from the models. A number agrees if it differs from that of the thesis
    by the fraction `within` at most; with `at_least`, a larger number agrees too. A text agrees if
    it is that of the thesis, also with a value behind a colon ("higher: 2.83 times"). `why` is the
    reason for a difference.
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
        """Computes the value that the model gives for a claim of the thesis. Returns the claim
        together with this value."""
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
    """Returns the text of a statement with the value behind it: "higher: 2.83 times" if the
    statement holds, otherwise "not higher: 0.9 times"."""
    return f"{word}: {value}" if holds else f"not {word}: {value}"


def compared(ratio: float, word: str, below: bool = False) -> str:
    """Returns the text of a statement about a ratio of two values. `word`, such as "higher", holds
    if the ratio is above 1, with `below` if the ratio is below 1."""
    return stated(ratio < 1 if below else ratio > 1, word, f"{plain(ratio)} times")
