"""Text that `forceaxis cycle judge` prints on a terminal."""

import re
from itertools import pairwise

from forceaxis.cli.cycle_text import (
    Rows,
    element_cells,
    number,
    proposal_rows,
    shown_unit,
    statistics_rows,
    table,
)
from forceaxis.cycles.capability import PartStatistics
from forceaxis.cycles.drift import Drift, ElementDrift
from forceaxis.cycles.judge import Judged, JudgedPart, counts_text, not_good
from forceaxis.cycles.outcome import BY_PROGRAM, GOOD
from forceaxis.cycles.propose import Proposal
from forceaxis.experiments.summary import CYCLE_OUTCOMES
from forceaxis.words import counted

SHOWN = 20  # largest number of parts of a series that are shown for one reason


def state_text(part: JudgedPart) -> str:
    """Return the verdict on a part as text. If the cycle did not end as its program intends, the
    text also states the reason."""
    record = part.record
    if record.outcome in ("", BY_PROGRAM):
        return record.state
    if record.outcome == "samples_invalid":
        return f"{record.state}: samples are not valid"
    if record.outcome == "stopped":
        return f"{record.state}: the curve ends in phase {record.phase}"
    return f"{record.state}: {CYCLE_OUTCOMES[record.outcome]} in phase {record.phase}"


def part_line(part: JudgedPart) -> str:
    """Return one text line about one pressed part: its file, its verdict, and the evaluation
    elements that are not good.
    """
    wrong = [f"{e.name} {e.verdict}" for e in not_good(part.record)]
    return f"{part.file}: {', '.join([state_text(part), *wrong])}"


def part_rows(part: JudgedPart) -> Rows:
    """Return the rows (key, text) about one pressed part: its verdict, a table of its evaluation
    elements, and a table of its phases.
    """
    head = ["element", "verdict", "value", "least", "most", "unit"]
    found = [("cycle", f"{part.record.title}: {state_text(part)}")]
    found += table("", [head, *map(element_cells, part.record.elements)], (0, 1, 5))
    cells = [[span.name, f"{span.begin_s:.6g}", f"{span.end_s:.6g}"] for span in part.phases]
    return found + table("", [["phase", "from s", "to s"], *cells])


def drift_cells(element: ElementDrift) -> list[str]:
    """Return the row for one evaluation element in the table of the test for wear and drift."""
    if element.without:
        return [element.name, str(element.n), "-", "-", "-", shown_unit(element.unit),
                f"not tested: {element.without}"]  # fmt: skip
    if element.found_at is None:
        return [element.name, str(element.n), "-", "-", "-", shown_unit(element.unit), "no change"]
    change = number(element.change, element.unit)
    return [element.name, str(element.n), str(element.found_at), str(element.since),
            f"{float(change):+.4g}", shown_unit(element.unit), element.direction]  # fmt: skip


def drift_rows(drift: Drift) -> Rows:
    """Return the rows (key, text) about the test for wear and drift."""
    head = ["element", "values", "found at", "since", "change", "unit", ""]
    cells = [drift_cells(element) for element in drift.elements]
    rows = table("drift", [head, *cells], (0, 5, 6))
    tested = sum(not element.without for element in drift.elements)
    if tested:
        share = f"{100 * drift.false_alarms:.3g} %"
        rows.append(
            ("false alarms", f"in at most {share} of the series without a change: {tested} "
             f"elements, {drift.parts} parts, compared with the first {drift.reference}")
        )  # fmt: skip
    return rows


def change_rows(drift: Drift, names: list[str]) -> Rows:
    """Return a row (key, text) for each evaluation element whose values have changed within the
    series of parts. The row names the part at which the change began, and the part at which the
    test detected the change."""
    return [
        (
            "warning",
            f"{one.name} {one.direction} from {names[one.since - 1]} on, found at "
            f"{names[one.found_at - 1]}: look for wear and drift",
        )
        for one in drift.elements
        if one.found_at is not None and one.since is not None
    ]


def order_rows(files: list[str]) -> Rows:
    """Return a row (key, text) with a warning if numbered files are in alphabetical order, for
    example 10.npz before 2.npz. A shell gives the files of a folder in this order."""
    if files != sorted(files):
        return []
    for one, after in pairwise(files):
        words = [re.sub(r"\d+", "1", file) for file in (one, after)]
        numbers = [[int(part) for part in re.findall(r"\d+", file)] for file in (one, after)]
        if words[0] == words[1] and numbers[0] > numbers[1]:
            text = f"{one} was given before {after}: give the curves in the order of the parts"
            return [("warning", text)]
    return []


def import_rows(parts: list[JudgedPart]) -> Rows:
    """Return the rows (key, text) about the import of the curves. If the notes about several files
    differ only in their numbers, only the first note is shown, with the number of the other files.
    """
    first, files = dict[str, str](), dict[str, set[str]]()
    for part in parts:
        for note in part.import_notes:
            alike = re.sub(r"\d+", "1", note)
            first.setdefault(alike, f"{part.file}: {note}")
            files.setdefault(alike, set()).add(part.file)
    return [
        ("note", text + (f" (and {counted(len(files[alike]) - 1, 'file')} alike)"
                         if len(files[alike]) > 1 else ""))
        for alike, text in first.items()
    ]  # fmt: skip


def shown(key: str, lines: list[str]) -> Rows:
    """Return a row (key, text) for each of the first SHOWN lines. If there are more lines, the
    last row states how many are not shown.
    """
    found = [(key, line) for line in lines[:SHOWN]]
    return found + ([(key, f"and {len(lines) - SHOWN} more")] if len(lines) > SHOWN else [])


def rows(
    judged: Judged, statistics: PartStatistics, drift: Drift, proposal: Proposal | None
) -> Rows:
    """Return the rows (key, text) about the evaluation of recorded curves."""
    rates = sorted({part.rate_hz for part in judged.parts})
    found = [
        ("program", f"{judged.program}: {judged.title}"),
        ("counts", f"{counts_text(judged)}; {', '.join(f'{r:g}' for r in rates)} samples per s"),
    ]
    if len(judged.parts) == 1:
        part = judged.parts[0]
        found += [("curve", part.file), *part_rows(part)]
        found += [("invalid", note) for note in part.record.notes]
    else:
        parts = judged.parts
        found += shown("not good", [part_line(one) for one in parts if one.record.state != GOOD])
        found += shown(
            "invalid", [f"{one.file}: {note}" for one in parts for note in one.record.notes]
        )
        found += [row for row in statistics_rows(statistics) if row[0] not in ("program", "source")]
        files = [one.file for one in parts]
        found += [*drift_rows(drift), *order_rows(files), *change_rows(drift, files)]
    found += import_rows(judged.parts)
    if any(part.is_interpolated for part in judged.parts):
        found.append(("note", "the position was interpolated at the times of the force"))
    if any("saturated" in note for part in judged.parts for note in part.record.notes):
        found.append(
            ("note", "if the saturated values are true ones, give --force-range and --travel-range")
        )
    return found + ([] if proposal is None else proposal_rows(proposal))
