"""Text that `forceaxis sweep` prints on a terminal."""

import math

from forceaxis.experiments import summary
from forceaxis.experiments.sweep_result import Boundary, IsolatedPoint, Row, Sweep
from forceaxis.experiments.verdicts import VERDICTS, WORDS

SHOWN_POINTS = 10


def rows(done: Sweep) -> list[summary.Row]:
    """Return the rows (key, text) about a sweep: its runs, its verdicts or stability boundaries,
    its warnings and its failed runs."""
    result, counts = done.result, done.result.counts
    ran = counts.runs - counts.resumed
    speed = f", {ran / result.seconds:.0f} a second" if ran and result.seconds else ""
    journal = f"{counts.runs}: {counts.resumed} from the journal, {ran} now on {result.where}"
    lines = [("experiment", result.experiment), ("runs", journal + speed)]
    if search := done.plan.search:
        lines.append(("boundaries", f"{counts.boundaries} of {counts.points}"))
        shown_points = done.boundaries[:SHOWN_POINTS]
        lines += [("", boundary_text(boundary, search.name)) for boundary in shown_points]
    elif any(counts.of(verdict) for verdict in VERDICTS):
        shown = [v for v in VERDICTS if counts.of(v) or v in VERDICTS[:2]]
        lines.append(("verdict", ", ".join(f"{counts.of(v)} {WORDS[v]}" for v in shown)))
    if found := result.bounces:
        share = 100 * found.lost / found.runs if found.runs else 0.0
        lines.append((
            "bounces",
            f"{found.lost} of {found.runs} contacts: {share:.3g} %, "
            f"95 % from {100 * found.low:.3g} % to {100 * found.high:.3g} %",
        ))  # fmt: skip
    lines += [("warning", text) for text in result.warnings]
    lines += [("alone", isolated_text(point)) for point in result.alone[:SHOWN_POINTS]]
    if result.refined and not result.alone:
        lines.append(("alone", "no point: nothing to look closer at"))
    if result.failures:
        first = result.failures[0]
        text = f"{counts.failed} of {counts.points}; the first, index {first.index}: {first.error}"
        lines.append(("failed", text))
    return [*lines, ("again", result.command)]


def isolated_text(point: IsolatedPoint) -> str:
    """Return a text about an isolated point of a sweep. A point is a combination of parameter
    values; it is isolated if its verdict differs from those of all neighbouring points."""
    at = text_of(point.values)
    if point.around:
        return f"{at}: {point.verdict}, as are {point.alike} of {point.around} points around it"
    return f"{at}: {point.verdict}, its neighbours are not; --refine looks closer"


def boundary_text(boundary: Boundary, name: str) -> str:
    """Return a text about the stability boundary at one point of a sweep. `name`: the parameter
    whose stability boundary was searched."""
    what = (
        f"{name}: stable at {boundary.stable:.6g}, "
        f"{WORDS[boundary.beyond]} at {boundary.unstable:.6g}"
        if math.isfinite(boundary.stable)
        else boundary.note or boundary.error
    )
    return f"{text_of(boundary.row)}: {what}" if boundary.row else what


def text_of(values: Row) -> str:
    """Return the parameter values of one point of a sweep as text."""
    return ", ".join(f"{name} = {value:g}" for name, value in values.items())
