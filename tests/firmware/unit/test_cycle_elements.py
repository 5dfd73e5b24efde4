"""Evaluation elements of a cycle against an evaluation in NumPy and exact fractions, over random
curves on a coarse grid, so that corners are touched, windows are entered twice and curves end on
lines."""

import random

import numpy as np
import pytest
from element_oracle import (
    ABOVE,
    AGAIN,
    ALL_SIDES,
    AT,
    BELOW,
    DIFFERENCE,
    EITHER,
    END,
    ENVELOPE,
    FALLING,
    GOOD,
    LEFT,
    NOT_REACHED,
    RISING,
    TOP,
    WINDOW,
    WORK,
    WRONG_SIDE,
    expected,
)
from forceaxis import _core

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
