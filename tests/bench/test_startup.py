"""How long the command line takes to start, as a ratio to a Python that does nothing."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long
FORCEAXIS = Path(sys.executable).parent / "forceaxis"


def cost_s(*words):
    """Processor time of one command: the least of some, each a little disturbed."""

    def used():
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        return spent.ru_utime + spent.ru_stime

    costs = []
    for _ in range(7):
        before = used()
        subprocess.run(words, capture_output=True, check=True)
        costs.append(used() - before)
    return min(costs)


def test_the_version_costs_few_bare_starts_of_python(record_property):
    """It loads neither NumPy nor a verb; 9 bare starts; with them it was 24."""
    bare = cost_s(sys.executable, "-c", "pass")
    ratio = cost_s(FORCEAXIS, "--version") / bare
    record_property("ratio", ratio)
    print(f"--version / bare start: {ratio:.2f}")
    assert ratio < 15
