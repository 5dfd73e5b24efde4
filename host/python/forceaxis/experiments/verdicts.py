"""The four words of a verdict. Their meanings are in host/run/verdict.hpp."""

STABLE = "stable"
NOT_STABLE = ("unstable", "not_met", "never_in_contact")
VERDICTS = (STABLE, *NOT_STABLE)

# As a page or a figure calls them.
WORDS = {
    "stable": "stable",
    "unstable": "unstable",
    "not_met": "not met",
    "never_in_contact": "never in contact",
}


def stability(verdict: str) -> str:
    """ "stable" or "unstable", for what knows only these two, such as the thesis's tables; "" and
    None stay."""
    return "unstable" if verdict in NOT_STABLE else verdict
