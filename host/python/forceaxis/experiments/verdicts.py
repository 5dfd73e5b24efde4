"""Texts for the verdicts of a run. The file host/run/verdict.hpp defines the meaning of each
verdict."""

STABLE = "stable"
NOT_STABLE = ("unstable", "not_met", "never_in_contact")
VERDICTS = (STABLE, *NOT_STABLE)

# Mark of a stable run whose error of the controlled force exceeds HELD_ERROR_MAX_PERCENT.
# Runs of experiments whose [verdict] limits the force error do not get this mark.
NOT_HELD = "not_held"
HELD_ERROR_MAX_PERCENT = 25.0

# {verdict: text for this verdict on pages and plots}
WORDS = {verdict: verdict.replace("_", " ") for verdict in VERDICTS}
MARK_WORDS = {**WORDS, NOT_HELD: "stable, force not held"}


def stability(verdict: str) -> str:
    """Returns "stable" for the verdict "stable", and "unstable" for every other verdict. Returns an
    empty text for an empty text."""
    return "unstable" if verdict in NOT_STABLE else verdict
