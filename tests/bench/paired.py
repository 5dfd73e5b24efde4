"""Times a command in two trees alternately, another commit's and this one, and prints the ratios.

    python tests/bench/paired.py ../before 9 forceaxis run sim/experiments/contact.toml --out /tmp/x

The program is taken from each tree's .venv/bin. Wall time and processor time, of children too: the
median of the ratios this / before, and their smallest and largest.
"""

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]


def once(tree, words):
    """(wall, processor) s of the command in a tree."""
    before, began = os.times(), time.monotonic()
    program = tree / ".venv/bin" / words[0]
    subprocess.run([program, *words[1:]], cwd=tree, stdout=subprocess.DEVNULL, check=True)
    wall, after = time.monotonic() - began, os.times()
    used = (after.children_user, after.children_system)
    return wall, sum(used) - before.children_user - before.children_system


def main():
    other, count, *words = sys.argv[1:]
    other = Path(other).resolve()
    once(other, words), once(HERE, words)  # files are read and compiled
    pairs = [(once(other, words), once(HERE, words)) for _ in range(int(count))]
    for at, name in enumerate(("wall", "processor")):
        ratios = sorted(this[at] / before[at] for before, this in pairs)
        middle = [statistics.median(pair[side][at] for pair in pairs) for side in (0, 1)]
        print(
            f"{name:10} {middle[0]:7.3f} s before, {middle[1]:7.3f} s now, "
            f"ratio {statistics.median(ratios):.3f} ({ratios[0]:.3f} to {ratios[-1]:.3f})"
        )


if __name__ == "__main__":
    main()
