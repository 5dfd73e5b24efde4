"""Texts that `forceaxis loop advise` and `forceaxis loop compliance` print on a terminal."""

import textwrap
from dataclasses import dataclass

from forceaxis.cli.common import aligned
from forceaxis.design.advise import (
    Advice,
    AdviceRow,
    FiguresOverSet,
    LimitingMode,
    PresentDesign,
    SimulatedLimit,
)
from forceaxis.design.compliance import Compliance
from forceaxis.linear.stability import known_text

FS = (
    "lowest frequency at which |S| reaches -3 dB, of the worst member with the largest gain at "
    "gain margin 2.3 and |S| <= 2"
)
FIRMWARE_GAIN_MAX = 256  # largest value of the object force_gain
NAME_WIDTH_MIN = 20  # smallest number of characters for the name of a change of the axis


def short(value: float | None) -> str:
    """Return a number as text with three significant digits. Return "-" for the value None."""
    return "-" if value is None else f"{value:.3g}"


@dataclass(frozen=True)
class Column:
    """A column of the table that `forceaxis loop advise` prints. `head`: the heading of the column,
    in one or two text lines. `note`: a text that explains the column, or "" if the heading is
    enough."""

    head: str
    note: str = ""
    is_optional: bool = False  # True if a narrow terminal does not show the column


def describe(result: Advice, width: int | None = None) -> str:
    """Return the text that `forceaxis loop advise` prints, at most `width` characters wide. Without
    `width`, no text line is wrapped."""
    lines = [f"model        {result.title}", f"timing       {result.timing}"]
    lines += [*_limit_lines(result), *_gain_lines(result)]
    if width:
        lines = [
            t for text in lines for t in textwrap.wrap(text, width, subsequent_indent=13 * " ")
        ]
    heads = _columns(result)
    rows = {"present design": _cells(result.present)}
    for row in result.rows:
        name = row.change + (f" [{row.thesis}]" if row.thesis else "")
        rows[name + ("" if row.in_firmware else " (not in the firmware)")] = _cells(row)
    table = {name: [cells[i] for i in heads] for name, cells in rows.items()}
    shown = list(heads.values())
    wide = [
        max(map(len, [*column.head.split("\n"), *(cells[i] for cells in table.values())]))
        for i, column in enumerate(shown)
    ]
    for column in [one for one in shown if one.is_optional]:
        if width and NAME_WIDTH_MIN + sum(w + 2 for w in wide) > width:
            i = shown.index(column)
            del shown[i], wide[i]
            for cells in table.values():
                del cells[i]
    first = max(map(len, table))
    if width:
        first = max(NAME_WIDTH_MIN, min(first, width - sum(w + 2 for w in wide)))

    def line(name: str, cells: list[str]) -> None:
        padded = [name.ljust(first), *(c.rjust(w) for c, w in zip(cells, wide, strict=True))]
        lines.append("  ".join(padded).rstrip())

    for i in (-2, -1):
        line("", [("\n" + column.head).split("\n")[i] for column in shown])
    for text, cells in table.items():
        *above, name = textwrap.wrap(text, first, subsequent_indent=" ")
        lines += above
        line(name, cells)
    for note in _notes(result, shown):
        lines += textwrap.wrap(note, width) if width else [note]
    return "\n".join(lines)


def _limit_lines(result: Advice) -> list[str]:
    """Return the text lines about the limit of the present design: the states of the model's
    elements (such as a closed contact), the limiting mode of vibration, and the critical gain."""
    base, mode = result.present, result.limiting_mode
    lines = [f"mode         {result.mode_text}"] if result.mode_text else []
    if isinstance(mode, LimitingMode):
        lines.append(
            f"limited by   {mode.name}, {mode.label}, {mode.frequency_hz:.3g} Hz undamped: "
            f"{mode.how}"
        )
    elif mode:
        lines.append(f"limited by   {mode.how}")
    if base.critical_gain is None:
        which = "at every gain"
        if base.known_to is not None:
            which = f"up to {known_text(base.known_to, result.unit)}"
        lines.append(f"limit        none: stable {which}")
    elif base.critical_gain:
        own = f" (force_gain {base.firmware_gain:.4g})" if base.firmware_gain else ""
        lines.append(
            f"limit        {base.critical_gain:.4g} {result.unit}{own} at "
            f"{base.frequency_hz:.3g} Hz"
        )
    else:
        lines.append("limit        0, unstable at any small gain")
    return lines


def _gain_lines(result: Advice) -> list[str]:
    """Return the text lines about three gains: the gain at which another pole becomes unstable, the
    gain of the experiment, and the largest gain that is stable in the simulation."""
    lines = []
    if following := result.next_crossing:
        lines.append(
            f"next         {following.gain:.4g} {result.unit}, another pole leaves at "
            f"{following.frequency_hz:.3g} Hz"
        )
    if result.present_gain is not None:
        lines.append(f"force_gain   {result.present_gain:g} in {result.experiment}")
    found = result.present.simulated
    if isinstance(found, SimulatedLimit) and found.of_limit:
        lines.append(
            f"simulated    stable up to force_gain {found.stable_gain:.4g}, "
            f"{found.of_limit:.2f} of the linear limit, with the firmware and loss of contact "
            f"({found.runs} runs)"
        )
    return lines


def _columns(result: Advice) -> dict[int, Column]:
    """Return those columns of the table of `forceaxis loop advise` that have values, as {index:
    column}. The index is the position of the column in each list that _cells() returns."""
    hz = short(result.reference_hz)
    columns = [
        Column(result.unit),
        Column("force_\ngain", "force_gain: DAC codes per 8-bit count, up to 256 in the firmware"),
        Column("gain\nx", "x: against the present design", is_optional=True),
        Column("at\nHz"),
        Column(f"L x\n{hz} Hz", f"L x {hz} Hz: loop gain there at the limit", is_optional=True),
        Column(
            "f_c\nHz",
            f"f_c: crossover, |L| = 1 with the gain at the limit / {result.gain_margin:g}",
        ),
        Column("f_c\nx"),
        Column("fS over\nset", f"fS over set: {FS}"),
        Column("run\ngain", "run gain: force_gain up to which simulated contacts are stable"),
        Column("ripple", "ripple: its counts at half the present one", is_optional=True),
    ]
    has_runs = isinstance(result.present.simulated, SimulatedLimit)
    left_out = (() if has_runs else (8, 9)) + (() if result.over else (7,))
    return {i: column for i, column in enumerate(columns) if i not in left_out}


def _cells(row: PresentDesign | AdviceRow) -> list[str]:
    """Return one row of the table that `forceaxis loop advise` prints. The row has one text for
    each column that the table can have, in the order of the columns."""
    factors: tuple[float | None, ...] = (1.0, 1.0, 1.0)
    if isinstance(row, AdviceRow):
        factors = (row.ratio.critical_gain, row.ratio.loop_gain_at, row.ratio.crossover_hz)
    critical = "no limit" if row.known_to is None else f"> {row.known_to:.4g}"
    if row.critical_gain is not None:
        critical = f"{row.critical_gain:.4g}"
    gain = "> " * (row.known_to is not None) + short(row.firmware_gain)
    if row.firmware_gain is not None and row.firmware_gain >= FIRMWARE_GAIN_MAX:
        gain = "> 256"
    run = ripple = ""
    if isinstance(row.simulated, SimulatedLimit):
        run = "none"
        if row.simulated.stable_gain is not None:
            more = "> " if row.simulated.unstable_gain is None else ""
            run = f"{more}{row.simulated.stable_gain:.3g}"
            ripple = short(row.simulated.ripple_count)
    return [
        critical,
        gain,
        short(factors[0]),
        short(row.frequency_hz),
        short(factors[1]),
        short(row.crossover_hz),
        short(factors[2]),
        short(row.over.fS_Hz if isinstance(row.over, FiguresOverSet) else None),
        run,
        ripple,
    ]


def _notes(result: Advice, shown: list[Column]) -> list[str]:
    """Return the notes that `forceaxis loop advise` prints below its table, such as the meaning of
    each column."""
    notes = ["; ".join(column.note for column in shown if column.note)]
    if any(row.known_to is not None for row in (result.present, *result.rows)):
        notes.append(
            "V/N with >: no limit up to there, above it rounding decides; the row's other figures "
            "are those of that gain"
        )
    if not result.over:
        notes.append(
            "these are figures of one plant: --over NAME=30%,.. ranks by the bandwidth over a set, "
            "with a bank designed for it among the rows"
        )
    thesis = [row.thesis for row in result.rows if row.thesis]
    if thesis:
        notes.append(f"[{thesis[0]}]: the section of the thesis that looks at this change")
    return notes


def describe_compliance(result: Compliance) -> str:
    """Return the text that `forceaxis loop compliance` prints: a table with one row for each
    stiffness."""

    def number(value: float | None, scale: float = 1.0) -> str:
        return "-" if value is None else f"{scale * value:.3g}"

    def strike(value: float | None) -> str:
        return (">= " if value == result.strike_max_N_s else "") + number(value)

    lines = [
        f"model        {result.model}, {result.element} = {result.present:.6g} N/m",
        f"set          {', '.join(result.over) or 'this plant alone'}",
        *([f"mode         {result.mode_text}"] if result.mode_text else []),
        f"set-point    {result.setpoint_N:.4g} N",
    ]
    table = [["", "P fS", "bank fS", "P error", "motion", "P strike", "bank strike"],
             ["N/m", "Hz", "Hz", "%", "mm", "N s", "N s"]]  # fmt: skip
    for row in result.rows:
        table.append([
            f"{row.stiffness:.4g}", number(row.p_fS_Hz), number(row.fS_Hz),
            number(row.p_static_error, 100), number(row.motion_m, 1e3),
            strike(row.p_strike_N_s), strike(row.strike_N_s),
        ])  # fmt: skip
    lines += aligned(table, ())
    lines += textwrap.wrap(
        "fS: lowest frequency at which |S| reaches -3 dB, of the set's worst member; error: of the "
        "force held; motion: of the drive, from touch to the set-point; strike: the hardest "
        "survived in simulation; -: no gain at the margins",
        80,
    )
    return "\n".join(lines)
