"""The four verdicts as texts. Their meanings are in host/run/verdict.hpp."""

STABLE = "stable"
NOT_STABLE = ("unstable", "not_met", "never_in_contact")
VERDICTS = (STABLE, *NOT_STABLE)

# {verdict: its text on pages and figures}.
WORDS = {
    "stable": "stable",
    "unstable": "unstable",
    "not_met": "not met",
    "never_in_contact": "never in contact",
}


def stability(verdict: str) -> str:
    """ "stable" or "unstable", for comparisons with two verdicts only, such as the tables of the
    thesis; "" and None are returned unchanged."""
    return "unstable" if verdict in NOT_STABLE else verdict
