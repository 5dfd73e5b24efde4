"""Text that `forceaxis sweep` prints on a terminal."""

import math

from forceaxis.experiments.summary import Row
from forceaxis.experiments.sweep_result import LonePoint, Sweep
from forceaxis.experiments.verdicts import VERDICTS, WORDS

SHOWN_POINTS = 10


def rows(done: Sweep) -> list[Row]:
    """Return the rows (key, text) about a sweep: runs, verdicts or boundaries, warnings,
    failures."""
    result, counts = done.result, done.result.counts
    ran = counts.runs - counts.resumed
    speed = f", {ran / result.seconds:.0f} a second" if ran and result.seconds else ""
    journal = f"{counts.runs}: {counts.resumed} from the journal, {ran} now on {result.where}"
    lines = [("experiment", result.experiment), ("runs", journal + speed)]
    if done.search:
        lines.append(("boundaries", f"{counts.boundaries} of {counts.points}"))
        lines += [("", boundary_text(done, i)) for i in range(min(SHOWN_POINTS, counts.points))]
    elif any(counts.of(verdict) for verdict in VERDICTS):
        shown = [v for v in VERDICTS if counts.of(v) or v in VERDICTS[:2]]
        lines.append(("verdict", ", ".join(f"{counts.of(v)} {WORDS[v]}" for v in shown)))
    lines += [("warning", text) for text in result.warnings]
    lines += [("alone", alone_text(point)) for point in result.alone[:SHOWN_POINTS]]
    if result.refined and not result.alone:
        lines.append(("alone", "no point: nothing to look closer at"))
    if result.failures:
        first = result.failures[0]
        text = f"{counts.failed} of {counts.points}; the first, index {first.index}: {first.error}"
        lines.append(("failed", text))
    return [*lines, ("again", result.command)]


def alone_text(point: LonePoint) -> str:
    """Return a text about a point whose verdict differs from the verdict of its neighbours."""
    at = ", ".join(f"{name} = {value:g}" for name, value in point.values.items())
    if point.around:
        return f"{at}: {point.verdict}, as are {point.alike} of {point.around} points around it"
    return f"{at}: {point.verdict}, its neighbours are not; --refine looks closer"


def boundary_text(done: Sweep, i: int) -> str:
    """Return a text about the stability boundary that row `i` of the sweep has found."""
    assert done.search is not None
    columns = done.columns
    at = ", ".join(f"{a.name} = {columns[a.name][i]:g}" for a in done.axes)
    stable, unstable = columns["boundary"][i], columns["unstable_at"][i]
    what = (
        f"{done.search.name}: stable at {stable:.6g}, "
        f"{WORDS[str(columns['beyond'][i])]} at {unstable:.6g}"
        if math.isfinite(stable)
        else str(columns["note"][i] or columns["error"][i])
    )
    return f"{at}: {what}" if at else what
