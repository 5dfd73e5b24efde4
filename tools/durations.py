#!/usr/bin/env python3
"""Seconds of the tests of each folder, beside those of the recorded table tests/seconds.toml.

    tools/durations.py      records what the last runs of tools/test took (build/*.xml)

`tools/test` prints the comparison. A change may add 20 s to `tools/test`, and 180 s to what
`tools/test --all` runs beside that; an excess is named, but fails nothing. Seconds are those of the
tests, which several processes may share, and not those of a clock.

A machine that is slower or busy takes longer everywhere, so recorded seconds are first multiplied
by the median of measured over recorded seconds of the folders that take at least SCALING_S.
"""

import statistics
import tomllib
from pathlib import Path

import junit

ROOT = Path(__file__).resolve().parents[1]
RECORDED = ROOT / "tests/seconds.toml"
HEAD = "# Seconds of the tests by stage and folder. Written by tools/durations.py.\n"
SCALING_S, SHOWN_S = 2.0, 0.5
# Largest excess in s: of tools/test, and of the stages that --all adds.
BUDGETS = {"tools/test": 20, "tools/test --all": 180}


def budget_of(stage):
    """The key of BUDGETS for a stage."""
    return "tools/test --all" if "long" in stage or "debug" in stage else "tools/test"


def folder_of(label):
    """The folder of a test by its label (junit.label): at most two parts below tests."""
    file = label.partition(" ")[0]
    return "/".join(Path(file).parent.parts[:3]) if file.startswith("tests/") else "programs"


def by_folder(xml):
    """{(stage, folder): (seconds, number of tests)} of a JUnit file of tools/test."""
    found, stage = {}, xml.stem.removeprefix("pytest-")
    for label, (seconds, _) in junit.outcomes(xml).items():
        before, count = found.get((stage, folder_of(label)), (0.0, 0))
        found[stage, folder_of(label)] = before + seconds, count + 1
    return found


def load(path=RECORDED):
    """{(stage, folder): seconds} of the recorded table."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    return {(stage, folder): s for stage, rows in tables.items() for folder, s in rows.items()}


def report(measured, recorded):
    """The lines of the table, and one for each budget that is exceeded. Stages that were not
    recorded count for no budget."""
    stages = {stage for stage, _ in recorded}
    both = [key for key in measured if recorded.get(key, 0.0) >= SCALING_S]
    scale = statistics.median(measured[key][0] / recorded[key] for key in both) if both else 1.0
    lines = ["seconds of tests, and their excess over the recorded ones"]
    lines[0] += f" (times {scale:.2f} for this machine)"
    excess = {name: [] for name in BUDGETS}
    for key, (seconds, count) in sorted(measured.items()):
        more = seconds - scale * recorded.get(key, 0.0)
        if key[0] in stages:
            excess[budget_of(key[0])].append((more, " ".join(key)))
        shown = f"{more:+8.1f} s" if key[0] in stages else "not recorded"
        if max(seconds, abs(more)) >= SHOWN_S:
            lines.append(f"  {key[0]:14} {key[1]:24} {count:5} tests {seconds:8.1f} s {shown}")
    for name, rows in excess.items():
        total = sum(more for more, _ in rows)
        if total > BUDGETS[name] * scale:
            most = ", ".join(f"{where} {more:+.0f} s" for more, where in sorted(rows)[:-4:-1])
            lines.append(
                f"budget: {name}: {total:.0f} s more than recorded, expected at most "
                f"{BUDGETS[name] * scale:.0f} s ({most}); shorten tests, or record with "
                "tools/durations.py"
            )
    return lines


def record(measured, path=RECORDED):
    """Writes the seconds of the measured stages. The other stages of the table stay as they are."""
    stages = {stage for stage, _ in measured}
    rows = {key: s for key, s in load(path).items() if key[0] not in stages}
    rows |= {key: round(s, 1) for key, (s, _) in measured.items()}
    text, before = HEAD, None
    for (stage, folder), seconds in sorted(rows.items()):
        text += f"\n[{stage}]\n" * (stage != before) + f'"{folder}" = {seconds}\n'
        before = stage
    path.write_text(text, encoding="utf-8")


def main():
    measured = {}
    for xml in sorted((ROOT / "build").glob("*.xml")):
        if not xml.stem.endswith((".second", "quick")):
            measured |= by_folder(xml)
    record(measured)


if __name__ == "__main__":
    main()
