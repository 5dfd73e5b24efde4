"""An independent evaluation of the elements of a cycle, in NumPy and exact fractions.

An element is a dict with the fields of cycle_element_t (firmware/cycle/element.h) that are not 0. A
curve is an array (samples, 3) of tick, x and force."""

from fractions import Fraction
from itertools import pairwise
from math import ceil, floor

import numpy as np

PEAK, VALLEY, AT, DIFFERENCE, WORK, END, WINDOW, ENVELOPE = range(8)
GOOD, BELOW, ABOVE, WRONG_SIDE, AGAIN, NOT_REACHED = range(6)
RISING, FALLING, EITHER = 1, 2, 3
LEFT, RIGHT, BOTTOM, TOP = 1, 2, 4, 8
ALL_SIDES = LEFT | RIGHT | BOTTOM | TOP


def half_up(value):
    return floor(value + Fraction(1, 2))


def curve_of(element, samples):
    rows = samples[[bool(element["phases"] >> phase & 1) for phase in samples[:, 3]]]
    if not element.get("over_time"):
        return rows[:, [0, 1, 2]]
    return np.column_stack([rows[:, 0], rows[:, 0] - rows[:1, 0], rows[:, 2]])


def lines_of(curve):
    """Pairs of points of consecutive ticks."""
    return [(a, b) for a, b in pairwise(curve) if b[0] == a[0] + 1]


def in_range(element, x):
    return (x >= element.get("x_least", 0)) & (x <= element.get("x_most", 0))


def compared(element, value, tick):
    least, most = element["y_least"], element["y_most"]
    return value, tick, BELOW if value < least else ABOVE if value > most else GOOD


def extreme(element, curve):
    inside = curve[in_range(element, curve[:, 1])]
    if not len(inside):
        return 0, 0, NOT_REACHED
    best = np.argmax(inside[:, 2] if element["kind"] == PEAK else -inside[:, 2])
    return compared(element, int(inside[best, 2]), int(inside[best, 0]))


def crossing(element, curve, level):
    """(value, tick) of the crossing that counts, or None."""
    of, by = (2, 1) if element.get("of_force") else (1, 2)
    number = 0
    for a, b in lines_of(curve):
        is_rising, is_falling = a[of] < level <= b[of], b[of] < level <= a[of]
        if (is_rising and element["direction"] & RISING) or (
            is_falling and element["direction"] & FALLING
        ):
            number += 1
            if number == element["ordinal"]:
                share = Fraction(int(level - a[of]), int(b[of] - a[of]))
                return half_up(int(a[by]) + share * int(b[by] - a[by])), int(b[0])
    return None


def at(element, curve):
    found = crossing(element, curve, element["level"])
    return compared(element, *found) if found else (0, 0, NOT_REACHED)


def difference(element, curve):
    first = crossing(element, curve, element["level"])
    second = crossing(element, curve, element["level_2"])
    if not first or not second:
        return 0, 0, NOT_REACHED
    return compared(element, second[0] - first[0], max(first[1], second[1]))


def work(element, curve):
    inside = [
        (a, b) for a, b in lines_of(curve) if in_range(element, a[1]) and in_range(element, b[1])
    ]
    if not inside:
        return 0, 0, NOT_REACHED
    areas = [(int(b[1]) - int(a[1])) * Fraction(int(a[2]) + int(b[2]), 512) for a, b in inside]
    return compared(element, half_up(sum(areas)), int(inside[-1][1][0]))


def end(element, curve):
    if not len(curve):
        return 0, 0, NOT_REACHED
    tick, x, y = (int(v) for v in curve[-1])
    result = compared(element, y, tick)
    return result if in_range(element, x) else (y, tick, WRONG_SIDE)


def is_inside(element, x, y):
    return bool(in_range(element, x)) and element["y_least"] <= y <= element["y_most"]


def part_inside(element, a, b):
    """The first and the last place (0 to 1) of a line in the window, by trying every place where
    the line meets a side; None: it misses the window."""
    (x0, y0), (x1, y1) = (tuple(int(v) for v in p[1:]) for p in (a, b))
    places = {Fraction(0), Fraction(1)}
    for start, way, sides in ((x0, x1 - x0, ("x_least", "x_most")),
                              (y0, y1 - y0, ("y_least", "y_most"))):  # fmt: skip
        places |= {Fraction(element[side] - start, way) for side in sides if way}
    inside = [
        p for p in places
        if 0 <= p <= 1 and is_inside(element, x0 + p * (x1 - x0), y0 + p * (y1 - y0))
    ]  # fmt: skip
    return (min(inside), max(inside)) if inside else None


def side_at(element, a, b, place, goes_out):
    """The side that a line passes at a place. A corner belongs to the left or right side."""
    start, way = a[1:].astype(object), (b[1:] - a[1:]).astype(object)
    x, y = start[0] + place * way[0], start[1] + place * way[1]
    forward = 1 if goes_out else -1
    if x == element["x_least"] and forward * way[0] < 0:
        return LEFT
    if x == element["x_most"] and forward * way[0] > 0:
        return RIGHT
    if y == element["y_least"] and forward * way[1] < 0:
        return BOTTOM
    assert y == element["y_most"] and forward * way[1] > 0
    return TOP


def window(element, curve):
    entries, exits, tick, inside = [], [], 0, False
    lines = {int(b[0]): (a, b) for a, b in lines_of(curve)}
    for point in curve:
        now = int(point[0])
        inside = is_inside(element, *point[1:])
        if now not in lines:
            if inside:
                entries.append(0)
                tick = now
            continue
        a, b = lines[now]
        part = part_inside(element, a, b)
        if part and not is_inside(element, *a[1:]):
            entries.append(side_at(element, a, b, part[0], False))
            tick = now
        if part and not inside:
            exits.append(side_at(element, a, b, part[1], True))
    value = len(entries)
    if not entries:
        return 0, 0, NOT_REACHED
    leaves = element.get("leaves", 0)
    if any(not s & element["enters"] for s in entries) or any(not s & leaves for s in exits):
        return value, tick, WRONG_SIDE
    if value > 1 or len(exits) > 1:
        return value, tick, AGAIN
    ended = len(exits) == 1 if leaves else inside
    return value, tick, GOOD if ended else NOT_REACHED


def envelope(element, curve, points):
    first, lower = element.get("first", 0), element["lower"]
    low = points[first : first + lower]
    high = points[first + lower : first + lower + element["upper"]]

    def force(bound, x):
        for (x0, y0), (x1, y1) in pairwise(bound):
            if x0 <= x <= x1:
                return y0 + Fraction(x - x0, x1 - x0) * (y1 - y0)
        raise AssertionError(x)

    inside = curve[in_range(element, curve[:, 1])]
    if not len(inside):
        return 0, 0, NOT_REACHED
    distances = []
    for _, x, y in inside.tolist():
        distances.append((y - ceil(force(low, x)), floor(force(high, x)) - y))
    least = min(range(len(distances)), key=lambda i: min(distances[i]))
    over, under = distances[least]
    value, tick = min(over, under), int(inside[least, 0])
    if value < 0:
        return value, tick, BELOW if over < under else ABOVE
    covered = curve[:, 1].min() <= element["x_least"] and curve[:, 1].max() >= element["x_most"]
    return value, tick, GOOD if covered else NOT_REACHED


def expected(element, points, samples):
    curve = curve_of(element, samples)
    if element["kind"] == ENVELOPE:
        return envelope(element, curve, points)
    by_kind = {PEAK: extreme, VALLEY: extreme, AT: at, DIFFERENCE: difference, WORK: work,
               END: end, WINDOW: window}  # fmt: skip
    return by_kind[element["kind"]](element, curve)
