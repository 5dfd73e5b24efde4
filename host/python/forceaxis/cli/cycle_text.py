"""Text that `forceaxis cycle` prints on a terminal."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from forceaxis import paths
from forceaxis.cli.common import aligned
from forceaxis.cycles.capability import ElementStatistics, Interval, PartStatistics
from forceaxis.cycles.curve import CurvePoints
from forceaxis.cycles.outcome import GOOD
from forceaxis.cycles.part import ElementFigure, PartResult
from forceaxis.cycles.propose import MovedBounds, Proposal
from forceaxis.cycles.rates import PartCounts, RatesResult
from forceaxis.cycles.record import LOST, PartRecord, state_text
from forceaxis.cycles.statistics import Share
from forceaxis.experiments import summary
from forceaxis.words import counted

Rows = list[summary.Row]
# Texts for values of the object cycle_store_state.
STORE_STATES = {
    "stored": "the axis has stored the program",
    "no_memory": "the axis has no parameter store: a power cut loses the program",
    "failed": "the axis could not store the program: a power cut loses it; see 2438h in the guide",
}


def number(value: float | None, unit: str) -> str:
    """Return a value as text without its unit. `unit` is the SI unit of the value. A length in m
    is shown in mm; other values are not converted."""
    if value is None:
        return "-"
    return f"{value * 1e3 if unit == 'm' else value:.6g}"


def shown_unit(unit: str) -> str:
    """Return the unit in which number() writes a value: mm for a length in m, otherwise `unit`
    itself."""
    return "mm" if unit == "m" else unit


def table(key: str, rows: Sequence[Sequence[str]], to_the_left: tuple[int, ...] = (0,)) -> Rows:
    """Return a table as pairs (key, text), one for each table row. Only the first pair has the key
    `key`."""
    lines = aligned(rows, to_the_left)
    return [(key if i == 0 else "", line) for i, line in enumerate(lines)]


def part_rows(result: PartResult) -> Rows:
    """Return the rows (key, text) about one simulated part."""
    state = summary.CYCLE_STATES.get(result.state, result.state)
    if result.failed_phase:
        state += f": {summary.why_text(result.outcome, result.failed_phase, result.invalid_ticks)}"
    rows = [("cycle", f"{result.title}: {state}"), ("program", result.program)]
    if result.fault != "none":
        rows.append(("fault", result.fault))
    if result.elements:
        head = ["element", "verdict", "value", "least", "most", "unit"]
        rows += table("", [head, *map(element_cells, result.elements)], (0, 1, 5))
    if result.phases:
        cells = [
            [span.name, f"{span.begin_s:.3f}", f"{span.end_s:.3f}", span.why]
            for span in result.phases
        ]
        rows += table("", [["phase", "begin s", "end s", "ended by"], *cells], (0, 3))
    return rows


def record_rows(record: PartRecord) -> Rows:
    """Return the rows (key, text) about a recorded part."""
    rows = [("cycle", f"{record.title or 'unknown program'}: {state_text(record)}")]
    serial = f", serial number {record.serial}" if record.serial else ""
    rows.append(("part", f"{record.number} of power-up {record.power_up}{serial}"))
    rows.append(("program", f"{record.program or 'unknown'}, CRC {record.program_crc}"))
    law = f"bank, CRC {record.law_crc}" if record.law_crc else record.law
    rows.append(("law", f"{law}; parameters, CRC {record.parameters_crc}"))
    rows += [("note", note) for note in record.notes]
    if not record.elements:
        return rows
    head = ["element", "verdict", "value", "least", "most", "unit"]
    return rows + table("", [head, *map(element_cells, record.elements)], (0, 1, 5))


def record_line(record: PartRecord) -> str:
    """Return one text line about a recorded part: the number of the part, its verdict, the
    evaluation elements that are not good, and the notes."""
    if record.state == LOST:
        return f"part {record.number}: the axis has lost its result in a power cut"
    serial = f" {record.serial}" if record.serial else ""
    wrong = [f"{e.name} {e.verdict}" for e in record.elements if e.verdict != GOOD]
    return f"part {record.number}{serial}: {', '.join([state_text(record), *wrong, *record.notes])}"


def running_text(found: PartStatistics) -> str:
    """Return a short text about all parts that were pressed until now: the number of good parts,
    and the smallest Cpk."""
    text = f"{found.good} of {found.good_share.of} good"
    smallest = min(
        ((e.cpk.value, e.name) for e in found.elements if e.cpk is not None), default=None
    )
    return text if smallest is None else f"{text}, Cpk {smallest[0]:.3g} of {smallest[1]}"


def curve_rows(curve: CurvePoints | None, files: Sequence[Path]) -> Rows:
    """Return the rows (key, text) about the recorded curve of a part: its number of points, and the
    files to which the curve was written."""
    if curve is None:
        return []
    text = f"{len(curve.time_s)} points"
    if curve.thinned:
        times = "once" if curve.thinned == 1 else f"{curve.thinned} times"
        text += f", thinned {times} because the memory of the axis was full"
    return [("curve", text), ("files", " ".join(map(paths.quoted, files)))]


def element_cells(figure: ElementFigure) -> list[str]:
    """Return the row for one evaluation element in the table of a pressed part."""
    texts = [number(v, figure.unit) for v in (figure.value, figure.least, figure.most)]
    return [figure.name, figure.verdict, *texts, shown_unit(figure.unit)]


def percent(share: Share) -> list[str]:
    """Return a proportion of simulated parts, and the confidence interval of this proportion, as
    two cells of a table.
    """
    if share.share is None:
        return ["-", "-"]
    return [f"{100 * share.share:.3g} %", f"{100 * share.low:.3g} to {100 * share.high:.3g} %"]


def counts_text(counts: PartCounts) -> str:
    """Return a text with the numbers of parts whose result is good, bad and aborted."""
    text = f"{counts.parts}: {counts.good} good, {counts.bad} bad, {counts.aborted} aborted"
    text += f", {counts.no_result} without result" if counts.no_result else ""
    return text + (f", {counts.failed} failed" if counts.failed else "")


def rates_rows(result: RatesResult, proposal: Proposal | None) -> Rows:
    """Return the rows (key, text) about how often good parts are refused and bad parts pass."""
    ran = result.runs - result.resumed
    speed = f", {result.ms_per_part:.2f} ms a part" if result.ms_per_part else ""
    rows = [
        ("program", f"{result.program}: {result.title}"),
        ("runs", f"{result.runs}: {result.resumed} from the journal, {ran} now on {result.where}"
                 f"{speed}"),
        ("good parts", counts_text(result.good.counts)),
    ]  # fmt: skip
    cells = [["refused", "share", "95 % interval"], ["the part", *percent(result.good.refused)]]
    cells += [[one.name, *percent(one.refused)] for one in result.good.elements]
    cells.append(["limits", *percent(result.good.limits)])
    rows += table("", cells)
    if result.bad:
        names = [element.name for element in result.bad[0].elements]
        head = ["passed", "parts", "aborted", "share", "95 % interval", *names, "limits"]
        cells = [head]
        for one in result.bad:
            shares = [*(e.passed for e in one.elements), one.limits]
            cells.append([
                one.name, str(one.counts.parts), str(one.counts.aborted), *percent(one.passed),
                *(percent(share)[0] for share in shares),
            ])  # fmt: skip
        rows += [("bad parts", "the share that passes, and by each element alone")]
        rows += table("", cells)
    if result.bad_passed is not None and len(result.bad) > 1:
        rows.append(
            ("all bad", f"{100 * result.bad_passed:.3g} % pass, by the weights of the kinds")
        )
    rows += [("warning", text) for text in result.warnings]
    again = result.command
    if proposal is not None:
        rows += proposal_rows(proposal)
        again += f" --propose {proposal.rate:g} -o {shlex.quote(proposal.program)}"
    return [*rows, ("again", again)]


def proposal_rows(proposal: Proposal) -> Rows:
    """Return the rows (key, text) about the bounds that `forceaxis cycle` proposes for evaluation
    elements."""
    low, high = (f"{100 * value:.3g}" for value in (proposal.low, proposal.high))
    rows = [
        ("proposal", f"{proposal.program}: {100 * proposal.expected:.3g} % of good parts refused"),
        ("", f"from {proposal.parts} good parts; 95 % of such proposals refuse {low} to {high} %"),
    ]
    if proposal.refused_anyway:
        rows.append(("", f"{proposal.refused_anyway} of the parts are refused whatever the bounds"))
    head = ["element", "least", "most", "unit", "before"]
    rows += table("", [head, *map(bound_cells, proposal.bounds)], (0, 3, 4))
    rows += [("unchanged", f"{one.name} ({one.kind}): {one.why}") for one in proposal.left]
    if proposal.bad:
        cells = [[one.name, *percent(one.passed)] for one in proposal.bad]
        rows += table("", [["passed with them", "share", "95 % interval"], *cells])
    if proposal.bad_passed is not None and len(proposal.bad) > 1:
        rows.append(("all bad", f"{100 * proposal.bad_passed:.3g} % pass"))
    return rows


def bound_cells(bounds: MovedBounds) -> list[str]:
    """Return the row for one evaluation element in the table of proposed bounds."""
    new, old = (
        [number(value, bounds.unit) for value in pair]
        for pair in ((bounds.least, bounds.most), (bounds.least_before, bounds.most_before))
    )
    return [bounds.name, *new, shown_unit(bounds.unit), f"{old[0]} to {old[1]}"]


# Characters for the columns of a run chart, from the lowest to the highest column.
# COLUMNS_MOST is the largest number of columns of a run chart.
HEIGHTS = "▁▂▃▄▅▆▇█"
COLUMNS_MOST = 60


def run_chart(values: Sequence[float | None]) -> str:
    """Return a run chart as one text line. It has one column for each value, in the order of the
    parts, and "·" for a part without a value. The heights are scaled from the smallest to the
    largest value. With many values, a column is the mean of consecutive parts."""
    groups = -(-len(values) // COLUMNS_MOST)
    columns = []
    for i in range(0, len(values), groups or 1):
        there = [value for value in values[i : i + groups] if value is not None]
        columns.append(sum(there) / len(there) if there else None)
    known = [value for value in columns if value is not None]
    if not known:
        return ""
    low, span = min(known), max(known) - min(known)

    def height(value: float) -> int:
        return round((value - low) / span * (len(HEIGHTS) - 1)) if span else len(HEIGHTS) // 2

    return "".join("·" if value is None else HEIGHTS[height(value)] for value in columns)


def interval_cells(interval: Interval | None, without: str) -> list[str]:
    """Return two cells of a table: a statistical value and its confidence interval, or the reason
    why this value is missing."""
    if interval is None:
        return ["-", without]
    return [f"{interval.value:.3g}", f"{interval.low:.3g} to {interval.high:.3g}"]


def bounds_text(one: ElementStatistics) -> str:
    """Return the bounds of an evaluation element as text."""
    least, most = (number(bound, one.unit) for bound in (one.least, one.most))
    if one.least is None and one.most is None:
        return "-"
    if one.most is None:
        return f"from {least}"
    return f"to {most}" if one.least is None else f"{least} to {most}"


def element_table(found: PartStatistics) -> list[list[str]]:
    """Return a table with the statistics of each evaluation element. The first row is the
    header."""
    rows = [["element", "values", "mean", "deviation", "bounds", "unit", "good", "Cp", "Cpk",
             "95 % interval"]]  # fmt: skip
    for one in found.elements:
        mean, deviation = (number(v, one.unit) for v in (one.mean, one.deviation))
        rows.append([
            one.name, str(one.n), mean, f"{float(deviation):.3g}" if one.deviation else deviation,
            bounds_text(one), shown_unit(one.unit), percent(one.good)[0],
            "-" if one.cp is None else f"{one.cp.value:.3g}", *interval_cells(one.cpk, one.without),
        ])  # fmt: skip
    return rows


def statistics_rows(found: PartStatistics) -> Rows:
    """Return the rows (key, text) about statistics of parts."""
    counts = f"{found.parts}: {found.good} good, {found.bad} bad, {found.aborted} aborted"
    counts += f", {found.lost} lost" if found.lost else ""
    if found.without_result:
        counts += f", {found.without_result} without result"
    rows = [("source", found.source)]
    if found.title:
        rows.append(("program", f"{found.title}, CRC {found.program_crc}"))
    rows.append(("parts", counts))
    if found.good_share.share is not None:
        share, interval = percent(found.good_share)
        rows.append(("good", f"{share}, {interval} (95 % interval), of the good and bad parts"))
    if found.bad_in_row:
        last = "part is" if found.bad_in_row == 1 else f"{found.bad_in_row} parts are"
        rows.append(("warning", f"the last {last} not good"))
    if found.other_programs:
        text = f"{counted(found.other_programs, 'part')} with another program, not in the table"
        rows.append(("left out", text))
    if found.left_out:
        rows.append(("left out", f"{counted(found.left_out, 'simulated bad part')}"))
    rows += table("elements", element_table(found), (0, 4, 5))
    charts = [(one.name, run_chart(one.values)) for one in found.elements]
    return rows + table("run chart", [[name, text] for name, text in charts if text], (0, 1))
