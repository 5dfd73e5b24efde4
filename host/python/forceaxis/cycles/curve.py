"""Reads the curve of the last cycle from an axis over a connection. The curve consists of points
with force, travel and time. It is written as a table or drawn as a plot.

The axis adds a point to the curve whenever travel, force or time have changed by a step (objects
cycle_curve_step_travel, cycle_curve_step_force, cycle_curve_step_time). The points therefore have
unequal distances. Over CAN, one SDO transfer reads all points. Over other connections, five points
are read at a time.
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

# Layout of one point of the curve of a cycle in the firmware (firmware/cycle/curve.h).
POINT = np.dtype([("time", "<u4"), ("travel", "<i4"), ("force_phase", "<i4")])
# number of the lowest bit of the force in force_phase; the bits below contain the phase number
FORCE_BIT = 8
COUNTS_PER_FORCE = 256  # The force of a point has the unit of 1/256 of a force count.
# Number of curve points that the objects cycle_data contain after a write to cycle_curve_first.
SHOWN_POINTS = 5
WORDS = [f"cycle_data_{i}" for i in range(1, SHOWN_POINTS * POINT.itemsize // 4 + 1)]
BUSY = ("running", "evaluating")
COLUMNS = ("time_s", "travel_m", "force_N", "phase")


@dataclass(frozen=True)
class CurvePoints(Curve):
    """The points of the curve of a press cycle. Each array has one value for each point: time in s
    since the start of the cycle, travel in m, force in N, and number of the phase. The travel is
    measured from the origin that the cycle program defines, and the deflection of the press is
    subtracted. The force is the measured force minus the offset of a tare."""

    # number of times that the memory was full and the axis deleted every second point
    thinned: int

    def rows(self) -> list[CurvePoint]:
        """Returns time, travel and force of each point, in the form that the record of a part
        has."""
        columns = self.time_s.tolist(), self.travel_m.tolist(), self.force_N.tolist()
        return list(zip(*columns, strict=True))


@dataclass(frozen=True)
class CurveObjects:
    """Objects of the firmware about the curve of the last cycle."""

    cycle_state: str
    cycle_count: int
    cycle_curve_points: int
    cycle_curve_thinned: int


def read(axis: Drive, wanted: LiveProgram) -> CurvePoints:
    """Reads the curve of the last cycle of an axis that this client owns. Raises Refused if a cycle
    is running or if there is no curve, and NoAnswer if the axis does not answer."""
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
    """Reads the bytes of all points of a curve from the axis, SHOWN_POINTS points at a time."""
    parts = []
    for first in range(0, count, SHOWN_POINTS):
        axis.link.write({"cycle_curve_first": first})
        found = axis.link.read(WORDS)
        parts.append(struct.pack(f"<{len(WORDS)}I", *(found[word] for word in WORDS)))
    return b"".join(parts)[: count * POINT.itemsize]


def points(data: bytes, wanted: LiveProgram, thinned: int = 0) -> CurvePoints:
    """Converts the bytes of the points of a curve to numbers. An experiment defines the scales of
    the numbers."""
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
    """Writes the points of a curve and the names of their phases to a CSV file. Raises OSError."""
    names = [phase.name for phase in wanted.program.phases]
    columns = curve.time_s.tolist(), curve.travel_m.tolist(), curve.force_N.tolist()
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        for *values, phase in zip(*columns, curve.phase.tolist(), strict=True):
            writer.writerow([*(f"{value:.9g}" for value in values), names[phase]])


def picture(curve: CurvePoints, part: PartRecord, wanted: LiveProgram) -> PartPicture:
    """Returns the data with which plots.draw() draws the plot of a part."""
    return PartPicture(
        title=part.title,
        state=part.state,
        program=wanted.program,
        elements=part.elements,
        phases=_spans(curve, wanted),
        curve=curve,
    )


def _spans(curve: CurvePoints, wanted: LiveProgram) -> Sequence[PhaseSpan]:
    """Returns the phases of the curve of a press cycle in the order in which they ran. Each phase
    ends where the next one begins."""
    starts = [0, *(np.flatnonzero(np.diff(curve.phase)) + 1).tolist(), len(curve.phase) - 1]
    return [
        PhaseSpan(
            wanted.program.phases[int(curve.phase[begin])].name,
            float(curve.time_s[begin]), float(curve.time_s[end]), "",
        )
        for begin, end in pairwise(starts)
    ]  # fmt: skip
