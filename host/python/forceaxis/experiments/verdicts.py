"""The four verdicts as texts. The file host/run/verdict.hpp defines the meaning of each verdict."""

STABLE = "stable"
NOT_STABLE = ("unstable", "not_met", "never_in_contact")
VERDICTS = (STABLE, *NOT_STABLE)

# {verdict: text for this verdict on pages and plots}
WORDS = {verdict: verdict.replace("_", " ") for verdict in VERDICTS}


def stability(verdict: str) -> str:
    """Returns "stable" for the verdict "stable", and "unstable" for every other verdict. For an
    empty text, returns the empty text."""
    return "unstable" if verdict in NOT_STABLE else verdict
