"""Which of many equal cases a run of the tests tries.

They are drawn by the commit, so that each case of a commit is tried again by its next run, and the
runs of later commits try the others. FORCEAXIS_DRAW=WORD draws by another word, for example by an
earlier commit; FORCEAXIS_WHOLE=1 tries all cases.
"""

import functools
import os
import random
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

ROOT = Path(__file__).resolve().parents[2]
Case = TypeVar("Case")


def whole() -> bool:
    return "FORCEAXIS_WHOLE" in os.environ


@functools.cache
def word() -> str:
    """By which a run draws: the same in all its processes. Outside of a repository, where a commit
    is not known, it is the same for all runs."""
    if "FORCEAXIS_DRAW" in os.environ:
        return os.environ["FORCEAXIS_DRAW"]
    try:
        command = ["git", "rev-parse", "HEAD"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()


def some(name: str, cases: Sequence[Case], count: int) -> list[Case]:
    """`count` of the cases, in their order. `name`: what is drawn; each draws apart."""
    if whole():
        return list(cases)
    count = min(count, len(cases))
    chosen = set(random.Random(f"{name} {word()}").sample(range(len(cases)), count))
    return [case for number, case in enumerate(cases) if number in chosen]


def number(name: str, below: int) -> int:
    """A number to begin with, where cases are not listed but numbered."""
    return random.Random(f"{name} {word()}").randrange(below)


def left_out(modules: Mapping[str, bool]) -> set[str]:
    """Those of the modules with long tests {name: whether one of its tests holds a promise} that
    `tools/test --all` leaves to later commits: half of those that hold none."""
    free = sorted(name for name, holds in modules.items() if not holds)
    return set(free) - set(some("modules with long tests", free, (len(free) + 1) // 2))


def dealt(name: str, cases: Sequence[Case], hands: int) -> list[list[Case]]:
    """All cases, dealt to so many hands, or all to each hand where the whole is tried."""
    if whole():
        return [list(cases)] * hands
    order = random.Random(f"{name} {word()}").sample(range(len(cases)), len(cases))
    return [[cases[number] for number in sorted(order[hand::hands])] for hand in range(hands)]
