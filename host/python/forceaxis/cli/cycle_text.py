"""Text that `forceaxis cycle` prints on a terminal."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from forceaxis import paths
from forceaxis.cli.common import aligned
from forceaxis.cycles.curve import CurvePoints
from forceaxis.cycles.live import LivePart
from forceaxis.cycles.part import ElementFigure, PartResult
from forceaxis.cycles.propose import MovedBounds, Proposal
from forceaxis.cycles.rates import PartCounts, RatesResult
from forceaxis.cycles.statistics import Share
from forceaxis.experiments import summary

Rows = list[summary.Row]


def number(value: float | None, unit: str) -> str:
    """Return a value without its unit as text: a length in mm, other values in their unit."""
    if value is None:
        return "-"
    return f"{value * 1e3 if unit == 'm' else value:.6g}"


def shown_unit(unit: str) -> str:
    """Return the unit of number()."""
    return "mm" if unit == "m" else unit


def table(key: str, rows: Sequence[Sequence[str]], to_the_left: tuple[int, ...] = (0,)) -> Rows:
    """Return a table as rows (key, text)."""
    lines = aligned(rows, to_the_left)
    return [(key if i == 0 else "", line) for i, line in enumerate(lines)]


def part_rows(result: PartResult) -> Rows:
    """Return the rows (key, text) about one part."""
    state = summary.CYCLE_STATES.get(result.state, result.state)
    if result.failed_phase:
        state += f": {summary.CYCLE_OUTCOMES[result.outcome]} in phase {result.failed_phase}"
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


def live_rows(part: LivePart) -> Rows:
    """Return the rows (key, text) about the last part of an axis."""
    state = summary.CYCLE_STATES.get(part.state, part.state)
    if part.outcome != "by_program":
        state += f": {summary.CYCLE_OUTCOMES[part.outcome]}, last phase {part.phase}"
    rows = [
        ("cycle", f"{part.title}: {state}"),
        ("program", f"{part.program}, CRC {part.program_crc}"),
    ]
    head = ["element", "verdict", "value", "least", "most", "unit"]
    return rows + table("", [head, *map(element_cells, part.elements)], (0, 1, 5))


def curve_rows(curve: CurvePoints | None, files: Sequence[Path]) -> Rows:
    """Return the row (key, text) about the curve of a part and its files."""
    if curve is None:
        return []
    text = f"{len(curve.time_s)} points"
    if curve.thinned:
        times = "once" if curve.thinned == 1 else f"{curve.thinned} times"
        text += f", thinned {times} because the memory of the axis was full"
    return [("curve", text), ("files", " ".join(map(paths.quoted, files)))]


def element_cells(figure: ElementFigure) -> list[str]:
    """Return the row of an element in the table of a part."""
    texts = [number(v, figure.unit) for v in (figure.value, figure.least, figure.most)]
    return [figure.name, figure.verdict, *texts, shown_unit(figure.unit)]


def percent(share: Share) -> list[str]:
    """Return a share and its interval as cells of a table."""
    if share.share is None:
        return ["-", "-"]
    return [f"{100 * share.share:.3g} %", f"{100 * share.low:.3g} to {100 * share.high:.3g} %"]


def counts_text(counts: PartCounts) -> str:
    """Return the numbers of parts by their result as text."""
    text = f"{counts.parts}: {counts.good} good, {counts.bad} bad, {counts.aborted} aborted"
    text += f", {counts.no_result} without result" if counts.no_result else ""
    return text + (f", {counts.failed} failed" if counts.failed else "")


def rates_rows(result: RatesResult, proposal: Proposal | None) -> Rows:
    """Return the rows (key, text) about error rates."""
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
    """Return the rows (key, text) about proposed bounds."""
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
    """Return the row of an element in the table of proposed bounds."""
    new, old = (
        [number(value, bounds.unit) for value in pair]
        for pair in ((bounds.least, bounds.most), (bounds.least_before, bounds.most_before))
    )
    return [bounds.name, *new, shown_unit(bounds.unit), f"{old[0]} to {old[1]}"]
