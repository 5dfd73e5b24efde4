"""The curve of the last cycle of an axis on a connection: points of force over travel and time, as
a table and as a plot.

The axis makes a point where travel, force or time have changed by a step, so the points are at
unequal distances (objects cycle_curve_step_travel, _force and _time). Over CAN the points are one
SDO transfer, over the other connections they are read five at a time.
"""

import csv
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from forceaxis import _core
from forceaxis.axis.drive import Drive
from forceaxis.axis.link import TICKS_PER_S, Refused
from forceaxis.cycles.live import LiveProgram
from forceaxis.cycles.part import Curve, PartPicture, PhaseSpan
from forceaxis.cycles.record import CurvePoint, PartRecord

# A point as the firmware has it (firmware/cycle/curve.h).
POINT = np.dtype([("time", "<u4"), ("travel", "<i4"), ("force_phase", "<i4")])
FORCE_BIT = 8  # lowest bit of the force in force_phase; the bits below are the phase
COUNTS_PER_FORCE = 256  # force is in 1/256 count
# Number of points that cycle_data shows after a write of cycle_curve_first.
SHOWN_POINTS = 5
WORDS = [f"cycle_data_{i}" for i in range(1, SHOWN_POINTS * POINT.itemsize // 4 + 1)]
BUSY = ("running", "evaluating")
COLUMNS = ("time_s", "travel_m", "force_N", "phase")


@dataclass(frozen=True)
class CurvePoints(Curve):
    """The curve of a cycle, with one value for each of its n points: time in s since the start of
    the cycle, travel in m from travel 0 of the program less the deflection of the press, force in N
    less the offset of a tare, number of the phase."""

    # number of times that the axis dropped every second point, because its memory was full
    thinned: int

    def rows(self) -> list[CurvePoint]:
        """Returns the points as a record has them: time, travel and force of each."""
        columns = self.time_s.tolist(), self.travel_m.tolist(), self.force_N.tolist()
        return list(zip(*columns, strict=True))


@dataclass(frozen=True)
class CurveObjects:
    """State of the curve of an axis."""

    cycle_state: str
    cycle_count: int
    cycle_curve_points: int
    cycle_curve_thinned: int


def read(axis: Drive, wanted: LiveProgram) -> CurvePoints:
    """Returns the curve of the last cycle of an axis that is owned. Raises Refused while a cycle
    runs, or if there is no curve; NoAnswer."""
    found = axis.record(CurveObjects)
    where = axis.link.where
    if found.cycle_state in BUSY:
        raise Refused(
            f"{where}: expected a cycle that has ended, but it is {found.cycle_state}; read the "
            "curve after its end"
        )
    if found.cycle_curve_points == 0:
        raise Refused(
            f"{where}: expected the curve of a cycle, got none; start a cycle first, on an axis "
            "with memory for a curve"
        )
    data = axis.link.cycle_curve()
    if data is None:
        data = _read_parts(axis, found.cycle_curve_points)
    if axis.record(CurveObjects) != found or len(data) != found.cycle_curve_points * POINT.itemsize:
        raise Refused(
            f"{where}: another cycle has started and replaced the curve; read the curve again"
        )
    return points(data, wanted, found.cycle_curve_thinned)


def _read_parts(axis: Drive, count: int) -> bytes:
    """Returns the points of a curve, which are read SHOWN_POINTS at a time."""
    parts = []
    for first in range(0, count, SHOWN_POINTS):
        axis.link.write({"cycle_curve_first": first})
        found = axis.link.read(WORDS)
        parts.append(struct.pack(f"<{len(WORDS)}I", *(found[word] for word in WORDS)))
    return b"".join(parts)[: count * POINT.itemsize]


def points(data: bytes, wanted: LiveProgram, thinned: int = 0) -> CurvePoints:
    """Returns the points of a curve from their bytes, with the scales of an experiment."""
    converters = _core.inputs(str(wanted.experiment), list(wanted.overrides))["converters"]
    sensor, encoder = converters["adc0"], converters["encoder"]
    newtons = abs(sensor["per_code"]) * 2.0 ** (sensor["bits"] - 8) / COUNTS_PER_FORCE
    raw = np.frombuffer(data, POINT)
    force_phase = raw["force_phase"].astype(np.int64)
    return CurvePoints(
        time_s=raw["time"] / TICKS_PER_S,
        travel_m=raw["travel"] * abs(encoder["per_code"]),
        force_N=(force_phase >> FORCE_BIT) * newtons,
        phase=force_phase % (1 << FORCE_BIT),
        thinned=thinned,
    )


def write_table(curve: CurvePoints, wanted: LiveProgram, file: Path) -> None:
    """Writes the points of a curve as CSV, with the names of the phases. Raises OSError."""
    names = [phase.name for phase in wanted.program.phases]
    columns = curve.time_s.tolist(), curve.travel_m.tolist(), curve.force_N.tolist()
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        for *values, phase in zip(*columns, curve.phase.tolist(), strict=True):
            writer.writerow([*(f"{value:.9g}" for value in values), names[phase]])


def picture(curve: CurvePoints, part: PartRecord, wanted: LiveProgram) -> PartPicture:
    """Returns what the plot of a part shows (plots.draw)."""
    return PartPicture(
        title=part.title,
        state=part.state,
        program=wanted.program,
        elements=part.elements,
        phases=_spans(curve, wanted),
        curve=curve,
    )


def _spans(curve: CurvePoints, wanted: LiveProgram) -> Sequence[PhaseSpan]:
    """Returns the phases of a curve in the order in which they ran. A phase ends where the next one
    begins."""
    starts = [0, *(np.flatnonzero(np.diff(curve.phase)) + 1).tolist(), len(curve.phase) - 1]
    return [
        PhaseSpan(
            wanted.program.phases[int(curve.phase[begin])].name,
            float(curve.time_s[begin]), float(curve.time_s[end]), "",
        )
        for begin, end in pairwise(starts)
    ]  # fmt: skip
