"""Computes values of time objects of the firmware from the bus cycle, the time-outs of a drive and
the time of a brake."""

import math

from forceaxis import objects
from forceaxis.axis.link import TICKS_PER_S

TICKS_PER_MS = TICKS_PER_S / 1e3
# largest age in ticks of a position or a force that the firmware measures
AGE_MOST = round(objects.BY_NAME["force_age_max"].max)
# largest value of the object drive_on_ticks_max
ON_TICKS_MOST = round(objects.BY_NAME["drive_on_ticks_max"].max)


def age_without_loss(cycle_ticks: int) -> int:
    """Returns the largest age in ticks of a value that a drive sends in each bus cycle, if no frame
    is lost. The drive measures the value at the beginning of a cycle, and the value arrives in any
    tick of this cycle. If a frame is lost, the age becomes larger, at least two cycles."""
    return 2 * cycle_ticks - 1


def age_with_one_lost(cycle_ticks: int) -> int:
    """Returns an upper bound in ticks for the age of a value that a drive sends in each bus cycle.
    The bound holds if no two consecutive frames are lost."""
    return 3 * cycle_ticks


def ages(cycle_ticks: int | None, period_ticks: float, latency_ticks: float) -> dict[str, int]:
    """Returns the values in ticks of those objects whose default is too short for the age of
    positions and forces, as {object: ticks}.

    `cycle_ticks`: cycle of the bus, or None without a bus. `period_ticks`, `latency_ticks`: time
    between two samples of the force, and time from a sample to its arrival. With the limits for a
    fault, one missing value is no fault, as far as the firmware can measure such an age. With
    cycle_age_max, a missing value makes a part bad.
    """
    reading = latency_ticks + period_ticks
    bus_fault = age_with_one_lost(cycle_ticks) if cycle_ticks else 0
    bus_part = age_without_loss(cycle_ticks) if cycle_ticks else 0
    ticks = {
        "position_age_max": float(bus_fault),
        "force_age_max": reading + period_ticks,
        "cycle_age_max": max(bus_part, reading),
    }
    found = {name: min(math.ceil(value - 1e-9), AGE_MOST) for name, value in ticks.items()}
    return {name: value for name, value in found.items() if value > objects.default(name)}


def on_ticks(wait_ms: float, sdo_timeout_ms: float) -> int:
    """Returns a value of the object `drive_on_ticks_max` for a drive on a bus, in ticks. The value
    is the longest time that the master waits for the drive (`wait_ms`), plus one SDO time-out. The
    master then reports its own reason before the fault of this object occurs. The result is at most
    the largest value of the object."""
    ticks = math.ceil((wait_ms + sdo_timeout_ms) * TICKS_PER_MS)
    return min(ticks, ON_TICKS_MOST)


def brake_ticks(engage_ms: float) -> int:
    """Returns the value of the object `brake_engage_ticks`, in ticks, for a brake that holds
    `engage_ms` after it was closed. The result is at most the largest value of the object."""
    most = round(objects.BY_NAME["brake_engage_ticks"].max)
    return min(math.ceil(engage_ms * TICKS_PER_MS - 1e-9), most)
