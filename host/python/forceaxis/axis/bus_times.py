"""Times of firmware objects that follow from the bus of a drive."""

import math

from forceaxis import objects
from forceaxis.axis.link import TICKS_PER_S

TICKS_PER_MS = TICKS_PER_S / 1e3
ON_TICKS_MOST = round(objects.BY_NAME["drive_on_ticks_max"].max)  # its largest value


def age_without_loss(cycle_ticks: int) -> int:
    """Returns the largest age in ticks of a value that a drive sends in each bus cycle, if no frame
    is lost. The value may arrive in any tick of the cycle that begins with its measurement. After a
    lost frame, the age reaches at least two cycles, which is more."""
    return 2 * cycle_ticks - 1


def age_with_one_lost(cycle_ticks: int) -> int:
    """Returns an age in ticks that a value sent in each bus cycle never exceeds, as long as no two
    consecutive frames are lost."""
    return 3 * cycle_ticks


def on_ticks(wait_ms: float, sdo_timeout_ms: float) -> int:
    """Returns a value in ticks of drive_on_ticks_max for a drive on a bus: the longest wait of its
    master (drive_wait, or `wait_ms` of axis_linux) plus one SDO time-out, so that the master
    reports its reason before this fault occurs. The result is at most the largest value of the
    object."""
    ticks = math.ceil((wait_ms + sdo_timeout_ms) * TICKS_PER_MS)
    return min(ticks, ON_TICKS_MOST)
