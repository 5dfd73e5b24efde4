"""Heads of the columns of a text table: names, units and times from the lines above its rows.

The line above the rows has the names, or the units below the names. Other lines have keys, such as
the begin and the step of the times of an oscilloscope.
"""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.recordings.columns import (
    CLOCK,
    EMPTY,
    NUMBER,
    SCOPE_KEYS,
    TEXT,
    Line,
    Section,
    is_count,
)
from forceaxis.recordings.dialect import GROUPED, Dialect
from forceaxis.recordings.source import TIME_NAMES, Grid, Head, time_by_name
from forceaxis.recordings.units import IN_BRACKETS, factor_of, is_unit, split_name

COMMENT = re.compile(r"^\s*(#|%|//|!)+\s*")
KEY_MARK = re.compile(r"\s*([:=])\s*")  # between a key and its value
# A blank before a unit in brackets does not separate columns.
BLANK_BEFORE_UNIT = re.compile(r"\s+(?=[\[(][^\[\]()\s]*[\])])")
# A number in a line that may have separators of thousands
GROUPS = re.compile(
    r"(?<![\w.,'])[1-9]\d{0,2}(?:[.,']\d{3})+(?:[.,]\d+)?(?!\d|[.,']\d|[eE][-+]?\d)"
)
SCOPE = "TwinCAT Scope"
# Keys in a header, in lower case, that state the time step of the samples.
# A time step without a unit is in s only in files of makers that define it so.
STEPS_IN_S = ("increment", "delta_x", "sample interval", "xinc", "xincrement", "x increment")
STEPS = (*STEPS_IN_S, "sampling interval", "sample period", "sampling period", "sample time",
         "abtastintervall", "abtastzeit", "dt", "delta t")  # fmt: skip
RATES = ("sample rate", "samplerate", "sampling rate", "sampling frequency", "sample frequency",
         "abtastrate", "abtastfrequenz", "sps")  # fmt: skip
BEGINS = ("x0", "xorg", "xorigin", "x origin", "hoffset", "start")
CHANNEL_UNITS = ("y_unit_label", "vertical units", "vertical unit", "vunit", "unit", "units",
                 "einheit")  # fmt: skip
HEAD_LINES = 4  # largest number of lines above the rows that may have names and units
CHANNEL_NAMES = ("tracename", "name", "channel", "channel name", "signal", "signal name", "kanal",
                 "kanalname", "label")  # fmt: skip
COUNTS = ("samples", "record length", "points", "blocksize", "number of samples", "anzahl werte")
TIME_UNITS = ("horizontal units", "horizontal unit")
KEYS = (*STEPS, *RATES, *BEGINS, *COUNTS, *CHANNEL_UNITS, *TIME_UNITS)
# Names of a column of remarks at the end of the rows, in which every row may lack it
REMARKS = ("comment", "comments", "kommentar", "bemerkung", "remark", "remarks")
# First words of files whose times are in s without saying so: {word in lower case: kind of file}
TIMES_IN_S = {"lecroy": "LeCroy", "labview measurement": "LabVIEW LVM"}


@dataclass
class Heads:
    """The heads of the columns of a section. `names`: line of the names, or None. `units`: line of
    the units, or None."""

    heads: list[Head]
    kind: str = "CSV"
    names: Line | None = None
    units: Line | None = None
    # number of samples that the header states, and the place of this number in the header
    count: tuple[int, str] | None = None
    notes: list[str] = field(default_factory=list)
    refused: Line | None = None  # line with more names than the rows have fields
    unread: str = ""  # why no names were read, or ""


def heads_of(section: Section, before: Heads | None) -> Heads:
    """Returns the heads of the columns of a section. `before`: the heads of the section above. This
    section has the same names if it has none of its own."""
    lines = [_without_comment(section, line) for line in section.header]
    scope = {line.cells[0]: line for line in lines if line.cells and line.cells[0] in SCOPE_KEYS}
    if "Name" in scope or "SymbolName" in scope:
        return _scope_heads(scope, section)
    width = _width_of(section)
    keys, side = _keys_of(lines), _keys_beside(section)
    found = _keyed_heads(section, keys, width) or _named_heads(section, lines, width)
    has_none = found.names is None and found.refused is None
    # If a table has more columns than names, the names may belong to any of the columns.
    if has_none and before is not None and len(section.kinds) >= len(before.heads) >= width:
        found = replace(before, notes=[])
    found.count = _count_of(keys | side)
    _add_units(found, keys)
    _group_by_times(found, section)
    kinds = [kind for word, kind in TIMES_IN_S.items() if _begins(lines, word)]
    found.kind = kinds[0] if kinds else before.kind if before is not None else found.kind
    if found.kind in TIMES_IN_S.values():
        _set_time_unit(found, "s")
    _add_grids(found, section, keys or side)
    _add_time_of_interval(found, section, keys | side)
    return found


def _begins(lines: Sequence[Line], word: str) -> bool:
    return bool(lines) and lines[0].text.strip().strip('"').casefold().startswith(word)


def _without_comment(section: Section, line: Line) -> Line:
    text = COMMENT.sub("", line.text)
    if section.dialect.separator == " ":
        cells = section.dialect.cells(BLANK_BEFORE_UNIT.sub("\0", text))
        return Line(line.number, text, [cell.replace("\0", " ") for cell in cells])
    return Line(line.number, text, section.dialect.cells(text))


def _width_of(section: Section) -> int:
    """Returns the number of columns without the empty ones at the end that a separator causes."""
    filled = [k for row in section.samples for k, cell in enumerate(row) if cell]
    return max(section.core, max(filled, default=0) + 1)


def _is_wide(line: Line, section: Section, width: int) -> bool:
    """Returns True if a line may have names or units of all columns."""
    cells = line.cells
    while cells and not cells[-1]:
        cells = cells[:-1]
    if len(cells) < max(section.core, 1):
        return False
    # If this line is too short, the columns that it lacks at its end must not contain numbers.
    if len(cells) < width and any(kind == NUMBER for kind in section.kinds[len(cells) : width]):
        return False
    known = [cell for cell in cells[:width] if cell]
    if not 2 * len(known) >= min(width, len(section.checked)):
        return False
    is_number = all(section.dialect.value(cell) is not None for cell in known)
    return not is_number or line.cells == section.counted


def _has_too_many_names(line: Line, section: Section) -> bool:
    """Returns True if a line has names where the rows have no fields. A separator inside of a name
    may then have shifted the names behind it. Keys and remarks may stand there."""
    least = section.widths[0]
    for place, cell in enumerate(line.cells[least:], least):
        is_remark = place < section.widest and split_name(cell)[1] is None
        if cell and not (_is_key(cell) or is_remark or cell.casefold() in REMARKS):
            return True
    return False


def _are_units(cells: Sequence[str]) -> bool:
    """Returns True if a line has units, and not names, of the columns."""
    known = [cell for cell in cells if cell]
    if is_count(cells):
        return False
    units = sum(
        _is_bracketed(cell) or (is_unit(cell) and not IN_BRACKETS.match(cell)) for cell in known
    )
    return 2 * units >= len(known) > 0


def _is_bracketed(cell: str) -> bool:
    return (cell[:1], cell[-1:]) in (("(", ")"), ("[", "]"))


def _named_heads(section: Section, lines: Sequence[Line], width: int) -> Heads:
    """Returns heads with the names and units of the lines directly above the rows."""
    wide = [line for line in lines if _is_wide(line, section, width)]
    if not wide and lines:
        _expect_decimal_points(section, lines[-1], width)
    names_line, units_line = _lines_of(section, wide, width)
    refused = None
    if names_line is not None and _has_too_many_names(names_line, section):
        refused, names_line, units_line = names_line, None, None
    if names_line is not None:  # columns without any field that have a name
        names = names_line.cells[: section.width]
        width = max(width, *(k + 1 for k, cell in enumerate(names) if cell and not _is_key(cell)))
    found = Heads([Head(f"column {place + 1}") for place in range(width)], refused=refused)
    if names_line is None:
        last = refused or (lines[-1] if lines else None)
        if last is not None and len(last.cells) > 1:
            found.unread = (
                f"line {last.number} has {len(last.cells)} fields, and no names of the {width} "
                "columns were read from it"
            )
            found.notes.append(found.unread)
        return found
    found.names, found.units = names_line, units_line
    texts = [*found.names.cells, *[""] * width][:width]
    units = [*(found.units.cells if found.units else []), *[""] * width][:width]
    pairs = [split_name(text) for text in texts]
    names = [name or "time" * bool(unit and factor_of(unit, "s")) for name, unit in pairs]
    # Names that differ only in the brackets behind them keep the brackets.
    names = [
        text if names.count(name) > 1 and texts.count(text) == 1 else name
        for text, name in zip(texts, names, strict=True)
    ]
    found.heads = [
        Head(
            _numbered(names, place),
            _unit_of(units[place]) or (None if name == text and not is_unit(unit or "") else unit),
            tuple(sorted({text, names[place]} - {_numbered(names, place), ""})),
        )
        for place, (text, name, (_, unit)) in enumerate(zip(texts, names, pairs, strict=True))
    ]  # fmt: skip
    return found


def _lines_of(
    section: Section, wide: Sequence[Line], width: int
) -> tuple[Line | None, Line | None]:
    """Returns (line of the names, line of the units) of the lines above the rows. If one of the
    last lines names the times, this line has the names."""
    if not wide:
        return None, None
    above = wide[-HEAD_LINES:]
    has_units = [_are_units(line.cells[:width]) for line in above]
    timed = [
        place for place, line in enumerate(above)
        if {split_name(cell)[0].casefold() for cell in line.cells} & set(TIME_NAMES)
        and not any(section.is_damaged_row([cell]) for cell in line.cells[: section.width])
        and above[-1].number - line.number == len(above) - 1 - place  # no other line between
    ]  # fmt: skip
    if timed:
        units = [k for k in range(timed[-1] + 1, len(above)) if has_units[k]]
        return above[timed[-1]], above[units[0]] if units else None
    if has_units[-1]:
        has_names = len(above) > 1 and not _has_key(section, above[-2])
        return above[-2] if has_names else above[-1], above[-1]
    return above[-1], None


def _has_key(section: Section, line: Line) -> bool:
    """Returns True if a line has a key with its values, and no names of columns."""
    ends = [cell.rpartition(":")[2].strip() for cell in line.cells[1:]]
    values = [end for end in ends if section.is_damaged_row([end])]
    return any(not cell.isdecimal() for cell in values) or line.cells[0].casefold() in KEYS


def _keyed_heads(
    section: Section, keys: Mapping[str, tuple[Line, list[str]]], width: int
) -> Heads | None:
    """Returns heads with names that stand behind a key, if the keys are in the first column."""
    key = next((k for k in CHANNEL_NAMES if k in keys), None)
    if key is None or section.kinds[0] != EMPTY:
        return None
    names = [f"column {k + 1}" if k == 0 or not cell else cell
             for k, cell in enumerate([*keys[key][0].cells, *[""] * width][:width])]  # fmt: skip
    heads = [Head(_numbered(names, k)) for k in range(width)]
    return Heads(heads, names=keys[key][0])


def _count_of(keys: Mapping[str, tuple[Line, list[str]]]) -> tuple[int, str] | None:
    key = next((k for k in COUNTS if k in keys and keys[k][1]), None)
    text = keys[key][1][0].rpartition(":")[2].strip() if key else ""
    count = None if GROUPED.match(text) else _number(text)
    if key is None or count is None or not 1 < count < 1e12:
        return None
    return round(count), f"line {keys[key][0].number}"


def _expect_decimal_points(section: Section, above: Line, width: int) -> None:
    """Raises InputError if a file seems to have decimal commas between columns with commas."""
    names = [cell for cell in above.cells if cell]
    if section.dialect.separator == "," and width == 2 * len(names) > 2:
        raise InputError(
            f"line {section.first_line}: expected {len(names)} columns as in the line above, got "
            f"{width}; if the numbers have decimal commas, export the file with semicolons "
            "between the columns"
        )


def _is_key(text: str) -> bool:
    return text.casefold() in (*STEPS, *BEGINS)


def _numbered(names: Sequence[str], place: int) -> str:
    """Returns the name of a column, with its number if several columns have this name."""
    name = names[place]
    if not name:
        return f"column {place + 1}"
    return f"{name} {place + 1}" if names.count(name) > 1 else name


def _unit_of(cell: str) -> str | None:
    text = cell.strip()
    text = text[1:-1].strip() if _is_bracketed(text) else text
    return text or None


def _scope_heads(rows: Mapping[str, Line], section: Section) -> Heads:
    """Returns the heads of a file that TwinCAT Scope has exported. `rows`: {first field: line} of
    the lines above its rows. In each group, the first column has the times in ms."""
    key = "Name" if "Name" in rows else "SymbolName"
    symbols = rows.get("SymbolName")
    if symbols is not None and len(symbols.cells) > len(rows[key].cells):
        key = "SymbolName"  # the only line `Name` has the name of the file
    filled = [place for place, cell in enumerate(rows[key].cells) if cell]
    width = max(_width_of(section), filled[-1] + 1)
    texts = [*rows[key].cells, *[""] * width][:width]
    others = [*(symbols.cells if symbols else []), *[""] * width][:width]
    units = [*(rows["Unit"].cells if "Unit" in rows else []), *[""] * width][:width]
    is_time = [place == 0 or text == key for place, text in enumerate(texts)]
    names = [f"time of {texts[min(place + 1, width - 1)]}" if timed and place else text
             for place, (text, timed) in enumerate(zip(texts, is_time, strict=True))]  # fmt: skip
    names[0] = "time"
    heads, time = [], 0
    for place in range(width):
        time = place if is_time[place] else time
        unit = units[place].strip().strip("[]") if not is_time[place] else "ms"
        unit = unit[1:-1] if _is_bracketed(unit) else unit
        name = _numbered(names, place)
        labels = sorted({others[place], texts[place]} - {name, key, ""})
        heads.append(
            Head(
                name, None if unit in ("", "None") else unit, tuple(labels),
                None if is_time[place] else time,
            )
        )  # fmt: skip
    return Heads(heads, SCOPE, rows[key], rows.get("Unit"))


def _keys_of(lines: Sequence[Line]) -> dict[str, tuple[Line, list[str]]]:
    """Returns {key in lower case: (line, values)} of the lines above the rows. A key and its values
    stand beside each other, as "key: value", or above each other at the end of the line of the
    names."""
    keys: dict[str, tuple[Line, list[str]]] = {}
    for line in lines:
        cells = line.cells
        first = next((k for k, cell in enumerate(cells) if cell), None)
        if first is None:
            continue
        name, mark, value = [*KEY_MARK.split(line.text.strip().strip('"'), 1), "", ""][:3]
        keys[cells[first].rstrip(":=").strip().casefold()] = (line, cells[first + 1 :])
        if mark and value.strip(' ",;\t') and len(name) < 40:
            values = [text.strip() for text in re.split(r"[,;\t:]", value.strip(' ",;\t'))]
            keys.setdefault(name.strip().casefold(), (line, values))
    for above, below in itertools.pairwise(lines):
        for place, cell in enumerate(above.cells):
            if _is_key(cell) and 0 < place < len(below.cells):
                keys[cell.casefold()] = (below, [below.cells[place]])
    return keys


def _keys_beside(section: Section) -> dict[str, tuple[Line, list[str]]]:
    """Returns {key in lower case: (line, values)} of a header that stands beside the first rows, as
    some oscilloscopes write it."""
    keys = {}
    for row, cells in enumerate(section.samples):
        if section.kinds[0] != TEXT or len(cells) < 3 or not cells[0]:
            continue
        line = Line(section.line_of(row), "", cells)
        keys[cells[0].casefold()] = (line, [cells[1]])
    return keys


def _add_units(found: Heads, keys: Mapping[str, tuple[Line, list[str]]]) -> None:
    """Adds units that stand behind a key, one for each channel in the columns' own order."""
    time = next((k for k in TIME_UNITS if k in keys and keys[k][1]), None)
    if time is not None:
        _set_time_unit(found, keys[time][1][0])
    for key in CHANNEL_UNITS:
        if key not in keys or found.names is None:
            continue
        cells = keys[key][0].cells
        for place, head in enumerate(found.heads):
            unit = cells[place].rpartition(":")[2] if 0 < place < len(cells) else ""
            if (
                unit
                and not (head.unit and is_unit(head.unit))
                and head.name.casefold() not in TIME_NAMES
            ):
                found.heads[place] = replace(head, unit=unit)


def _set_time_unit(found: Heads, unit: str) -> None:
    for place, head in enumerate(found.heads):
        names = {split_name(name)[0].casefold() for name in (head.name, *head.labels)}
        if head.unit is None and names & set(TIME_NAMES) and factor_of(unit, "s"):
            found.heads[place] = replace(head, unit=unit)


def _group_by_times(found: Heads, section: Section) -> None:
    """If several columns have times, each with columns behind it, these columns belong to it."""
    times = [
        place for place, head in enumerate(found.heads)
        if _is_time(head) and section.kinds[place] in (NUMBER, CLOCK) and _ascends(section, place)
    ]  # fmt: skip
    if len(times) < 2 or times[0] != 0 or 1 in np.diff([*times, len(found.heads)]):
        return
    for place, head in enumerate(found.heads):
        if place not in times:
            found.heads[place] = replace(head, time=max(k for k in times if k < place))


def _is_time(head: Head) -> bool:
    names = {split_name(name)[0].casefold() for name in (head.name, *head.labels)}
    return bool(names & set(TIME_NAMES)) or bool(head.unit and factor_of(head.unit, "s"))


def _ascends(section: Section, place: int) -> bool:
    """Returns True if the numbers of a column in the first rows ascend."""
    cells = [row[place] for row in section.samples if place < len(row)]
    values = [section.dialect.value(cell) for cell in cells]
    numbers = [value for value in values if value is not None and not np.isnan(value)]
    return section.kinds[place] == CLOCK or bool(np.all(np.diff(numbers) > 0))


def _seconds(text: str, key: str) -> float | None:
    """Returns the step of the times in s that a key states."""
    text = text.strip().replace(",", ".")
    if key in RATES:
        rate_hz = _core.quantity_in(text, "Hz") or _number(text)
        if rate_hz is None and (found := re.match(r"([\d.eE+-]+)\s*([kMG]?)(Hz|Sa/s|S/s)?$", text)):
            rate_hz = _core.quantity_in(f"{found[1]} {found[2]}Hz", "Hz")
        return 1 / rate_hz if rate_hz else None
    return _core.quantity_in(text, "s") or (
        _number(text) if key in (*STEPS_IN_S, *BEGINS) else None
    )


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _doubtful_number(
    line: Line, key: str, values: Sequence[str], dialect: Dialect, is_sure: bool
) -> str:
    """Returns a number behind a key that may have a separator of thousands, or "". `is_sure`:
    whether the rows show that the decimal sign of the dialect is one."""
    at = line.text.casefold().find(key)
    texts = values if at < 0 else [line.text[at + len(key) :].lstrip(' ,;:=|"\t')]
    if at >= 0 and dialect.separator == "," and len({value for value in values if value}) == 1:
        texts = values  # the same number for each channel
    for found in (found for text in texts for found in GROUPS.finditer(text)):
        number = found[0]
        is_decimal = number.count(dialect.decimal) == 1 and dialect.separator != dialect.decimal
        if not (is_sure and is_decimal and re.fullmatch(r"\d+.\d{3}", number)):
            return number
    return ""


def _add_grids(found: Heads, section: Section, keys: Mapping[str, tuple[Line, list[str]]]) -> None:
    """Adds the times that the header states by begin and step, for each column of numbers."""
    key = next((k for k in (*STEPS, *RATES) if k in keys and keys[k][1]), None)
    if key is None:
        return
    line, steps = keys[key]
    begin_key = next((k for k in BEGINS if k in keys), None)
    begins = keys[begin_key][1] if begin_key else []
    counter = next((k for k, head in enumerate(found.heads) if _counts(head)), None)
    dialect = section.dialect
    is_sure = any(dialect.has_sure_decimals(cell) for row in section.samples for cell in row)
    doubt = _doubtful_number(line, key, steps, dialect, is_sure)
    numbers = [one for one in begins if _number(one.strip().replace(",", ".")) is not None]
    doubt = doubt or _doubtful_number(line._replace(text=""), key, numbers, dialect, is_sure)
    for place, head in enumerate(found.heads):
        # The fields behind a key stand above their columns if there are several of them.
        own = place - 1 if len([s for s in steps if s]) > 1 else 0
        step_s = _seconds(steps[own], key) if 0 <= own < len(steps) else None
        begin = begins[own] if 0 <= own < len(begins) else ""
        begin_s = _number(begin.strip().replace(",", "."))
        if doubt:
            text = f"the {key} of line {line.number}"
            found.heads[place] = replace(head, grid=Grid(0.0, 1.0, text, doubt=doubt))
        elif step_s and step_s > 0 and section.kinds[place] in (NUMBER, EMPTY, TEXT):
            text = f"{key} {steps[own]} of line {line.number}"
            found.heads[place] = replace(head, grid=Grid(begin_s or 0.0, step_s, text, counter))


def _counts(head: Head) -> bool:
    return (head.unit or "").casefold() in ("sequence", "index")


def _add_time_of_interval(
    found: Heads, section: Section, keys: Mapping[str, tuple[Line, list[str]]]
) -> None:
    """Finds the times in the column whose steps are the interval that the header states, if no
    column of times is known, and names the column behind it by its source, if the header stands
    beside the rows. Otherwise times that count the rows would hide that rows are missing."""
    key = next((k for k in (*STEPS, *RATES) if k in keys and keys[k][1]), "")
    interval = _seconds(keys[key][1][0], key) if key else None
    if interval is None or time_place_of(section, found.heads) is not None:
        return
    numbers = [k for k in section.checked if section.kinds[k] == NUMBER]
    if found.names is not None:  # a later column with a name may be a signal that moves so slowly
        numbers = numbers[:1]
    for place in (k for k in numbers if not found.heads[k].unit):
        values = [section.dialect.value(row[place]) for row in section.samples if len(row) > place]
        if _counts_steps([np.nan if value is None else value for value in values], interval):
            head = found.heads[place]
            name = "time" if found.names is None else head.name
            found.heads[place] = replace(head, name=name, unit="s", grid=None)
            found.notes.append(
                f"the times are those of column {place + 1}, whose steps are the {key} of line "
                f"{keys[key][0].number}"
            )
            is_beside = found.names is None and section.kinds[0] == TEXT
            names = keys["source"][1] if "source" in keys and is_beside else [""]
            if place + 1 < len(found.heads) and names[0]:
                unit = keys["vertical units"][1][0] if "vertical units" in keys else ""
                found.heads[place + 1] = Head(names[0], unit or None)
            return


def _counts_steps(values: Sequence[float], interval: float) -> bool:
    """Returns True if numbers rise by an interval from row to row, and by whole multiples of it
    where rows are missing."""
    steps = np.diff(values) / interval
    is_one = np.isclose(steps, 1.0, rtol=0.02, atol=0)
    is_whole = (steps > 0.9) & np.isclose(steps, np.round(steps), rtol=0, atol=0.1)
    return bool(is_one.sum() > max(2.0, 0.7 * len(steps)) and is_whole.sum() >= 0.95 * len(steps))


def time_place_of(section: Section, heads: Sequence[Head]) -> int | None:
    """Returns the place of the column with the times: by its name, by its unit, or by its texts."""
    filled = [k for k in range(len(heads)) if section.kinds[k] != EMPTY]
    named = time_by_name([heads[k].name if k in filled else "" for k in range(len(heads))])
    if named is not None:
        return named
    by_unit = [
        k for k in filled
        if section.kinds[k] == NUMBER and heads[k].unit and factor_of(heads[k].unit or "", "s")
    ]  # fmt: skip
    by_text = [k for k in filled if section.kinds[k] == CLOCK]
    if len(by_unit) == 1 or by_unit[:1] == [0]:
        return by_unit[0]
    return by_text[0] if len(by_text) == 1 else None
