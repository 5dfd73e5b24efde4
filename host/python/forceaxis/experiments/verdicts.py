"""The four verdicts as texts. Their meanings are in host/run/verdict.hpp."""

STABLE = "stable"
NOT_STABLE = ("unstable", "not_met", "never_in_contact")
VERDICTS = (STABLE, *NOT_STABLE)

# {verdict: its text on pages and figures}.
WORDS = {verdict: verdict.replace("_", " ") for verdict in VERDICTS}


def stability(verdict: str) -> str:
    """Whether a run with this verdict is "stable" or "unstable": every verdict other than "stable"
    counts as "unstable". An empty text is returned unchanged."""
    return "unstable" if verdict in NOT_STABLE else verdict
