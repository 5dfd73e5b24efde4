"""Times of firmware objects that follow from the bus of a drive."""

import math

from forceaxis import objects
from forceaxis.axis.link import TICKS_PER_S

TICKS_PER_MS = TICKS_PER_S / 1e3
ON_TICKS_MOST = round(objects.BY_NAME["drive_on_ticks_max"].max)  # its largest value


def age_without_loss(cycle_ticks: int) -> int:
    """Returns the largest age in ticks of a value that comes in each cycle of a bus, if none is
    lost. The value arrives in any tick of the cycle that begins with its measurement. With one
    lost, the age reaches at least two cycles, which is more."""
    return 2 * cycle_ticks - 1


def age_with_one_lost(cycle_ticks: int) -> int:
    """Returns an age in ticks that a value that comes in each cycle of a bus never exceeds if at
    most one in succession is lost."""
    return 3 * cycle_ticks


def on_ticks(wait_ms: float, sdo_timeout_ms: float) -> int:
    """Returns a value of drive_on_ticks_max in ticks for a drive on a bus: the wait of its master
    (drive_wait, `wait_ms` of axis_linux) and one SDO time-out, so that the reason of the master
    comes first. The largest value of the object is the limit."""
    ticks = math.ceil((wait_ms + sdo_timeout_ms) * TICKS_PER_MS)
    return min(ticks, ON_TICKS_MOST)
