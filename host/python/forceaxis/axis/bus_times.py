"""Computes values of time objects of the firmware from the bus cycle and the time-outs of a
drive."""

import math

from forceaxis import objects
from forceaxis.axis.link import TICKS_PER_S

TICKS_PER_MS = TICKS_PER_S / 1e3
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


def on_ticks(wait_ms: float, sdo_timeout_ms: float) -> int:
    """Returns a value of the object `drive_on_ticks_max` for a drive on a bus, in ticks. The value
    is the longest time that the master waits for the drive (`wait_ms`), plus one SDO time-out. The
    master then reports its own reason before the fault of this object occurs. The result is at most
    the largest value of the object."""
    ticks = math.ceil((wait_ms + sdo_timeout_ms) * TICKS_PER_MS)
    return min(ticks, ON_TICKS_MOST)
