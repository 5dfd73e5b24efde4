"""Texts that `forceaxis design` prints about the designed filter bank and, with the option
--pareto, about the trade-off."""

from pathlib import Path

from forceaxis import paths
from forceaxis.cli.common import aligned
from forceaxis.design import simulate
from forceaxis.design.outcome import CASE_HEAD, DesignOutcome, cases, number
from forceaxis.design.tradeoff import Tradeoff
from forceaxis.linear.plant_set import Member
from forceaxis.words import counted

NARROW_HEAD = ["law", "stable", "error %", "peak N", "losses", "settle ms"]


def describe(outcome: DesignOutcome, width: int | None = None) -> str:
    """Return the text about a designed force law, at most `width` characters wide. If `width` is
    None, the tables in this text have all columns."""
    bank = outcome.bank
    ranges = ", ".join(f"{n} {r[1]:.4g} to {r[2]:.4g}" for n, r in outcome.ranges.items())
    lines = [
        f"model        {paths.display(Path(outcome.plants.model))}",
        f"set          {ranges}; {counted(len(outcome.plants.modes), 'mode')}",
        *_set_lines(outcome),
        f"bank         {outcome.chosen}: gain {bank.force_gain:.5g} codes per 8-bit count, "
        f"integral {bank.integral_rad_per_s:.4g} 1/s, {len(bank.sections)} sections, "
        f"{bank.hf_gain():.3g} codes per count at high frequency",
        f"limited by   {outcome.limited_by}",
    ]
    for name, why in outcome.passed_over.items():
        lines.append(f"not taken    {name}: {why.removeprefix('simulation: ')}")
    if outcome.backoffs:
        times = counted(outcome.backoffs, "time")
        lines.append(f"simulation   took the gain down {times}, a tenth each:")
        lines += [f"             {cut.text}" for cut in outcome.cuts]
    if outcome.slowed:
        lines.append(f"approach     {outcome.slowed.text}")
    lines += [*_figures(outcome), *_simulated(outcome, width)]
    if loss := outcome.loss:
        lines.append(
            f"contact loss cap {loss.contact_loss_cap} codes for {loss.contact_loss_dwell} "
            f"ms: {loss.text}"
        )
    if outcome.out:
        lines.append(f"files        {', '.join(f'{outcome.out}/{n}' for n in outcome.written)}")
    return "\n".join(lines)


def _figures(outcome: DesignOutcome) -> list[str]:
    """Return two tables with bandwidth and margins for the worst plant of the set. The first table
    compares the P law with the designed filter bank, and the second table compares the structures
    of the force law."""
    table = [["", "fS Hz", "fT Hz", "Ms", "a tick late", "gain margin", "phase margin"]]
    for name, law in (("P", outcome.p), ("design", outcome.worst)):
        table.append([name, *map(number, law.row)])
    lines = aligned(table)
    if outcome.structures:
        table = [["structure", "fS Hz", "Ms", "gain margin"]]
        for one in outcome.structures:
            table.append([one.name, *map(number, one.row)])
        lines += aligned(table)
    return lines


def _simulated(outcome: DesignOutcome, width: int | None) -> list[str]:
    """Return the table of the simulated contacts. On a terminal that is too narrow, the table has
    fewer columns."""
    if not outcome.rows:
        return []
    rows = cases(outcome.rows)
    lines = aligned([CASE_HEAD, *rows])
    if width and len(lines[0]) > width:
        short = [[case.removeprefix("contact "), law,
                  *(cell.replace(" of ", "/") for cell in (stable, *cells[:-3]))]
                 for case, law, stable, *cells in rows]  # fmt: skip
        lines = aligned([["simulated contact", *NARROW_HEAD], *short])
    if max(row.losses_max or 0 for row in outcome.rows) > simulate.LOSSES_MAX:
        lines.append(
            "losses       contact losses of the permitted number, one more than the impact causes"
        )
    return lines


def _set_lines(outcome: DesignOutcome) -> list[str]:
    """Return the text lines about the set of plants: the states of the model's elements in the
    linear analysis, and all further states in the set. The last text line states the dry friction
    in the simulated contacts."""
    text = outcome.working.text
    lines = [f"mode         {text}"] if text else []
    others = [Member({}, m).label() for m in outcome.plants.modes if m != outcome.order.states]
    if lines and others:
        lines.append(f"and with     {'; '.join(others)}")
    texts = [
        f"{n} 0 to {N * one.most:.4g} N" for one in outcome.frictions for n, N in one.declared_N
    ]
    if texts:
        lines.append(f"friction     {', '.join(texts)} in the simulated contacts")
    return lines


def describe_tradeoff(result: Tradeoff) -> str:
    """Return the text that `forceaxis design --pareto` prints: a table with one row for each
    design."""

    def short(value: float | None) -> str:
        return "-" if value is None else f"{value:.3g}"

    lines = [
        f"model        {result.model}",
        f"set          {', '.join(result.over)}; {counted(len(result.modes), 'mode')}",
        f"{result.against:>11}  bandwidth Hz  P's  Ms    late  gain margin  "
        "DAC codes/count of force at high frequency",
    ]
    for row in result.rows:
        w = row.worst
        margins = (w.Ms, w.Ms_late, w.gain_margin) if w else (None,) * 3
        figures = (row.bandwidth_Hz, row.p_bandwidth_Hz, *margins)
        wide = zip(map(short, figures), (12, 4, 4, 5, 12), strict=True)
        cells = "  ".join(text.ljust(width) for text, width in wide)
        lines.append(f"{row.value:11g}  {cells} {row.bank.hf_gain:.3g}")
    lines.append(f"{result.against}: {result.what}")
    return "\n".join(lines)
