"""Evaluation elements of a cycle against an evaluation in NumPy and exact fractions, over random
curves on a coarse grid, so that corners are touched, windows are entered twice and curves end on
lines."""

import random
from fractions import Fraction
from itertools import pairwise
from math import ceil, floor

import numpy as np
import pytest
from forceaxis import _core

PEAK, VALLEY, AT, DIFFERENCE, WORK, END, WINDOW, ENVELOPE = range(8)
GOOD, BELOW, ABOVE, WRONG_SIDE, AGAIN, NOT_REACHED = range(6)
RISING, FALLING, EITHER = 1, 2, 3
LEFT, RIGHT, BOTTOM, TOP = 1, 2, 4, 8
ALL_SIDES = LEFT | RIGHT | BOTTOM | TOP


def half_up(value):
    return floor(value + Fraction(1, 2))


# An independent evaluation. A curve is an array (samples, 3) of tick, x and force.


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


# Random curves and elements.


def drawn_samples(rng, grid, count):
    """A curve on a grid of x and force; now and then a tick is missing, and phases change."""
    tick = rng.choice([0, 7, 2**32 - count // 2]) if count else 0
    x, y = rng.randint(-4, 4), rng.randint(-4, 4)
    phase, rows = rng.randint(0, 3), []
    for _ in range(count):
        rows.append((tick, x * grid[0], y * grid[1], phase))
        tick += 1 if rng.random() < 0.98 else 2
        x += rng.choice([-1, 0, 0, 1, 1, 2, 3])
        y += rng.choice([-3, -2, -1, 0, 1, 2, 3])
        x, y = max(-9, min(9, x)), max(-9, min(9, y))
        phase = phase if rng.random() < 0.9 else rng.randint(0, 3)
    return np.array(rows, np.int64).reshape(-1, 4)


def drawn_range(rng, step):
    return sorted((rng.randint(-8, 8) * step, rng.randint(-8, 8) * step))


def drawn_element(rng, grid, points):
    # With the largest grid the sum of WORK would saturate.
    kind = rng.choice([k for k in range(8) if k != WORK or grid[0] < 10**6])
    over_time = int(rng.random() < 0.25)
    x_step = 2 if over_time else grid[0]
    element = {"kind": kind, "over_time": over_time, "phases": rng.choice([15, 15, 1, 6, 9])}
    element["x_least"], element["x_most"] = drawn_range(rng, x_step)
    element["y_least"], element["y_most"] = drawn_range(rng, grid[1])
    if kind == WORK:
        element["y_least"], element["y_most"] = sorted(rng.randint(-5000, 5000) for _ in range(2))
    if kind in (AT, DIFFERENCE):
        of_force = int(rng.random() < 0.5)
        step = grid[1] if of_force else x_step
        element |= {"of_force": of_force, "direction": rng.choice([RISING, FALLING, EITHER]),
                    "ordinal": rng.choice([1, 1, 1, 2, 3])}  # fmt: skip
        levels = [rng.randint(-6, 6) * step + rng.choice([0, 0, step // 3]) for _ in range(2)]
        element["level"], element["level_2"] = levels[0], levels[1] * (kind == DIFFERENCE)
    if kind == WINDOW:
        element["enters"] = rng.randint(1, ALL_SIDES)
        element["leaves"] = rng.choice([0, ALL_SIDES, rng.randint(1, ALL_SIDES)])
    if kind == ENVELOPE:
        element |= {"first": len(points), "lower": rng.randint(2, 5), "upper": rng.randint(2, 5)}
        for count, side in ((element["lower"], -1), (element["upper"], 1)):
            inner = rng.sample(range(-9 * x_step + 1, 9 * x_step), count - 2)
            for x in sorted([-9 * x_step, 9 * x_step, *inner]):
                points.append((x, side * rng.randint(-grid[1], 9 * grid[1])))
    return element


@pytest.mark.parametrize("seed", range(4))
def test_a_thousand_curves_have_the_values_of_numpy_to_the_last_count(seed):
    rng = random.Random(320 + seed)
    verdicts = {kind: set() for kind in range(8)}
    for _ in range(250):
        grid = rng.choice([(1, 1), (3, 2), (7, 5), (1000, 640), (100_000_003, 14000)])
        samples = drawn_samples(rng, grid, rng.choice([0, 1, 2, 5, 20, 60]))
        points: list[tuple[int, int]] = []
        elements = [drawn_element(rng, grid, points) for _ in range(16)]
        results = _core.evaluate_elements(elements, points, samples)
        for element, result in zip(elements, results, strict=True):
            value, tick, verdict = expected(element, points, samples)
            assert result == (value, tick % 2**32, verdict), (element, points, samples.tolist())
            verdicts[element["kind"]].add(verdict)
    for kind, seen in verdicts.items():
        least = {WINDOW: {GOOD, WRONG_SIDE, AGAIN, NOT_REACHED}, END: {GOOD, WRONG_SIDE}}
        assert seen >= least.get(kind, {GOOD, BELOW, ABOVE, NOT_REACHED}), (kind, seen)


# Edges, by hand. The window is 0..10 by 0..10, entered at the left and left at the top.

WINDOW_0_10 = {"kind": WINDOW, "phases": 1, "x_least": 0, "x_most": 10, "y_least": 0, "y_most": 10,
               "enters": LEFT, "leaves": TOP}  # fmt: skip


def evaluated(element, *points):
    rows = np.array([(tick, x, y, 0) for tick, (x, y) in enumerate(points)])
    return _core.evaluate_elements([element], [], rows)[0]


@pytest.mark.parametrize(("points", "verdict"), [
    (((-5, 5), (5, 5), (5, 15)), GOOD),
    (((-5, 5), (15, 5)), WRONG_SIDE),  # leaves at the right
    (((-5, 5), (5, 5), (5, 15), (5, 5), (5, 15)), WRONG_SIDE),  # enters again through the top
    (((-5, 5), (5, 5), (5, 15), (-5, 15), (-5, 5), (5, 5), (5, 15)), AGAIN),
    (((-10, 10), (10, -10)), WRONG_SIDE),  # touches the corner (0, 0) and goes on below
    (((-5, 5), (0, 10), (5, 15)), GOOD),  # enters at the corner (0, 10), and leaves at the top
    (((-5, 15), (5, 5), (5, 15)), GOOD),  # the same corner from above
    (((-4, 15), (5, 5), (5, 15)), WRONG_SIDE),  # beside it, through the top
    (((-5, 5), (5, 5)), NOT_REACHED),  # ends inside
    (((-5, 5), (5, 5), (5, 10)), NOT_REACHED),  # ends on the top
    (((-5, 5), (5, 5), (5, 11)), GOOD),
    (((-5, 11), (5, 11)), NOT_REACHED),
    (((5, 5), (5, 15)), WRONG_SIDE),  # begins inside
    (((-5, 5), (-1, 5)), NOT_REACHED),
    (((-5, 5), (0, 5), (5, 15)), GOOD),  # on the left side, then over the corner region
])  # fmt: skip
def test_windows(points, verdict):
    assert evaluated(WINDOW_0_10, *points)[2] == verdict


def test_a_window_without_an_exit_has_to_be_the_end():
    ends = WINDOW_0_10 | {"leaves": 0}
    assert evaluated(ends, (-5, 5), (5, 5))[2] == GOOD
    assert evaluated(ends, (-5, 5), (5, 5), (5, 11))[2] == WRONG_SIDE


def test_a_level_is_crossed_where_a_line_ends_on_it_and_not_where_it_begins_on_it():
    rising = {"kind": AT, "phases": 1, "of_force": 1, "direction": RISING, "ordinal": 1, "level": 4,
              "y_least": -99, "y_most": 99}  # fmt: skip
    assert evaluated(rising, (0, 0), (10, 4)) == (10, 1, GOOD)
    assert evaluated(rising, (0, 4), (10, 8))[2] == NOT_REACHED
    assert evaluated(rising, (0, 3), (10, 6)) == (3, 1, GOOD)  # 10/3
    assert evaluated(rising, (0, 0), (1, 8)) == (1, 1, GOOD)  # 1/2 is rounded up
    falling = rising | {"direction": FALLING, "ordinal": 2}
    assert evaluated(falling, (0, 8), (10, 0), (20, 8), (30, 2)) == (27, 3, GOOD)  # 26 2/3


@pytest.mark.parametrize(("change", "name"), [
    ({"kind": 8}, "kind"), ({"phases": 0}, "phases"), ({"over_time": 2}, "over_time"),
    ({"x_least": 11}, "x_least"), ({"x_most": 2**30}, "x_most"), ({"y_least": 11}, "y_least"),
    ({"enters": 0}, "enters"), ({"enters": 16}, "enters"), ({"leaves": 16}, "leaves"),
    ({"y_most": 131072}, "y_most"), ({"kind": AT, "direction": 0, "ordinal": 1}, "direction"),
    ({"kind": AT, "direction": 4, "ordinal": 1}, "direction"),
    ({"kind": AT, "direction": 1}, "ordinal"),
    ({"kind": AT, "direction": 1, "ordinal": 1, "of_force": 1, "level": 131072}, "level"),
    ({"kind": DIFFERENCE, "direction": 1, "ordinal": 1, "level_2": 2**30}, "level_2"),
    ({"kind": ENVELOPE, "lower": 2, "upper": 2}, "points"),
])  # fmt: skip
def test_an_element_that_cannot_be_evaluated_is_refused(change, name):
    with pytest.raises(ValueError, match="expected a valid element"):
        _core.evaluate_elements([WINDOW_0_10 | change], [], np.zeros((0, 4), int))


@pytest.mark.parametrize("points", [
    [(0, -5), (9, -5), (0, 5), (10, 5)],  # the lower curve ends before x_most
    [(1, -5), (10, -5), (0, 5), (10, 5)],
    [(0, -5), (10, -5), (0, 5), (0, 5)],  # does not rise
    [(0, -5), (10, -5), (0, 5), (10, 131072)],
    [(0, -5), (10, -5), (0, 5)],
])  # fmt: skip
def test_curves_of_an_envelope_that_do_not_cover_its_range_are_refused(points):
    element = {"kind": ENVELOPE, "phases": 1, "x_most": 10, "lower": 2, "upper": 2}
    with pytest.raises(ValueError, match="expected a valid element"):
        _core.evaluate_elements([element], points, np.zeros((0, 4), int))
