"""The record of one pressed part. It can be written as a JSON object or as a row of a table.

A PartRecord describes a part that an axis has pressed, or a part that was read from a table. Tables
of recorded parts and of simulated parts have the same columns for an evaluation element.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from forceaxis._core import InputError
from forceaxis.cycles.outcome import BY_PROGRAM, MEASURED
from forceaxis.cycles.part import ElementFigure
from forceaxis.experiments.summary import why_text
from forceaxis.results import json_field

Cell = str | float | int | None
# one point of the curve of a part: time in s, travel in m, force in N
CurvePoint = tuple[float, float, float]
# Endings of the column names of an evaluation element, in the order of the columns.
# A column whose name has no ending contains the value of the evaluation element.
VERDICT, LEAST, MOST, UNIT = "_verdict", "_least", "_most", "_unit"
ENDINGS = ("", VERDICT, LEAST, MOST, UNIT)
NOTES_BETWEEN = "; "
# Texts that the field `notes` in the record of a part can contain.
MASTER_DUE, CALIBRATION_DUE = "master due", "calibration due"
LOST = "lost"  # state of a part whose result was lost in a power cut of the axis


@dataclass(frozen=True)
class PartRecord:
    """One pressed part, with all data on which its verdict depends. The number of the power-up and
    the number of the part together identify a part of an axis."""

    number: int
    power_up: int = 0  # number of the power-up of the axis in which the part was pressed
    serial: str = ""  # serial number that a client of the axis has written for the part
    # time in UTC at which the record was made, such as 2026-11-28T03:00:00+00:00
    recorded: str = ""
    axis: str = ""  # connection over which the axis was read, such as "node 1 on can0"
    device: str = ""  # serial number of the axis as 0x and 8 digits
    program: str = ""  # path of the program file
    title: str = ""  # title of the cycle program with which the part was pressed
    program_number: int = 0
    # CRC of the cycle program as 8 hexadecimal digits; the next two CRCs have the same form
    program_crc: str = ""
    # force law with which the part was pressed: "bank", or "P" for the law with force_gain alone
    law: str = ""
    law_crc: str = ""  # CRC of the filter bank of the force law; empty for the P law
    parameters_crc: str = ""  # CRC of all parameters that the axis stores
    begin_tick: int = 0  # value of the tick counter of the axis at the start of the cycle
    duration_s: float = 0.0
    state: str = ""  # verdict on the part: "good", "bad", "aborted" or "lost"
    outcome: str = ""  # text that says how the press cycle ended
    phase: str = ""  # number of the last phase that ran, or of the phase in which the cycle failed
    # number of ticks in evaluated phases that have no valid sample of force and travel
    invalid_ticks: int = 0
    notes: list[str] = json_field(default_factory=list)
    elements: list[ElementFigure] = json_field(default_factory=list)
    curve: list[CurvePoint] | None = json_field(omit_none=True)

    @property
    def key(self) -> tuple[int, int]:
        """The numbers that identify the part among all parts of its axis: number of the power-up,
        and number of the part."""
        return self.power_up, self.number

    def is_same_part(self, other: "PartRecord") -> bool:
        """Returns True if another record describes the same part. Both records may have been made
        at different times and over different connections."""
        names = ("power_up", "number", "device", "program_crc", "begin_tick", "state", "outcome")
        return all(getattr(self, name) == getattr(other, name) for name in names) and [
            (e.verdict, e.value) for e in self.elements
        ] == [(e.verdict, e.value) for e in other.elements]


def state_text(record: PartRecord) -> str:
    """Returns the verdict on a part as text. If the cycle did not end as its program intends, the
    text also states the reason."""
    if record.outcome in ("", BY_PROGRAM):
        return record.state
    return f"{record.state}: {why_text(record.outcome, record.phase, record.invalid_ticks)}"


# Columns of a record in a table. The columns of its evaluation elements follow them.
HEAD = tuple(f.name for f in fields(PartRecord) if f.name not in ("elements", "curve"))


def element_columns(names: Sequence[str]) -> list[str]:
    """Returns the column names of evaluation elements: first all values, then all verdicts, then
    all bounds and units."""
    return [f"{name}{ending}" for ending in ENDINGS for name in names]


def element_cells(elements: Sequence[ElementFigure]) -> list[Cell]:
    """Returns the cells of one part in the columns of element_columns(). None stands for an empty
    cell."""
    rows: list[list[Cell]] = [[e.value, e.verdict, e.least, e.most, e.unit] for e in elements]
    return [row[i] for i in range(len(ENDINGS)) for row in rows]


def row_of(record: PartRecord) -> dict[str, Cell]:
    """Converts a record to a row of a table, as {column: cell}. The row does not contain the
    curve."""
    head = {name: getattr(record, name) for name in HEAD}
    columns = element_columns([element.name for element in record.elements])
    cells = dict(zip(columns, element_cells(record.elements), strict=True))
    return {**head, "notes": NOTES_BETWEEN.join(record.notes), **cells}


def elements_of(columns: Sequence[str]) -> list[str]:
    """Returns the names of the evaluation elements in a table of parts. Each element has a column
    with its verdict and a column with its value."""
    names = [c.removesuffix(VERDICT) for c in columns if c.endswith(VERDICT)]
    return [name for name in names if name in columns]


def from_row(row: Mapping[str, str], names: Sequence[str], where: str) -> PartRecord:
    """Converts a row of a table to a record. `names`: names of the evaluation elements in the
    table. Unknown columns are ignored. If a cell must be a number but is not, raises InputError
    with a text that begins with `where`."""

    def number(column: str) -> float | None:
        text = row.get(column, "")
        try:
            return float(text) if text else None
        except ValueError:
            raise InputError(
                f"{where}: {column}: expected a number, got {text}; correct the table"
            ) from None

    given: dict[str, Any] = {"number": 0}
    for field in fields(PartRecord):
        if field.name in row and field.type in (int, float, str):
            text = row[field.name]
            given[field.name] = text if field.type is str else number(field.name) or 0.0
            if field.type is int:
                given[field.name] = int(given[field.name])
    given["notes"] = [note for note in row.get("notes", "").split(NOTES_BETWEEN) if note]
    given["elements"] = [
        ElementFigure(
            name=name,
            kind="",
            verdict=row[f"{name}{VERDICT}"],
            value=number(name),
            unit=row.get(f"{name}{UNIT}", ""),
            least=number(f"{name}{LEAST}"),
            most=number(f"{name}{MOST}"),
        )
        for name in names
        # An empty verdict means that the cycle program of this part has no such evaluation element.
        if row[f"{name}{VERDICT}"]
    ]
    return PartRecord(**given)


def measured(element: ElementFigure) -> float | None:
    """Returns the value of an evaluation element if this value was compared with the bounds,
    otherwise None."""
    return element.value if element.verdict in MEASURED else None
