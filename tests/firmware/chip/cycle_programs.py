"""Random programs of a cycle, each one right (firmware/cycle/program.h)."""

import struct
import zlib

MAGIC, VERSION, END = 0x59435846, 1, 255
HEADER, PHASE, CONDITION = "<IHHBBHII12s", "<BBhIiIIIII", "<BBHi"
ELEMENT, POINT = "<BBHBBBBBBBBHHiiiiii", "<ii"
MOVE, MOVE_BY, MOVE_TO_TOUCH, APPROACH, PRESS, WAIT = range(6)
TIME, FORCE_ABOVE, FORCE_BELOW, TRAVEL_ABOVE, TOUCH_ABOVE, TOUCH_BELOW = range(2, 8)
INPUT_ON, INPUT_OFF, CONDITION_KINDS = 10, 11, 12
PEAK, VALLEY, AT, DIFFERENCE, WORK, LAST, WINDOW, ENVELOPE = range(8)
PHASES_MAX, ELEMENTS_MAX = 16, 16


def condition(rng, phases):
    when = rng.randrange(CONDITION_KINDS)
    levels = {
        TIME: [1, 5, 40, 400],
        FORCE_ABOVE: [-256, 0, 2560, 30000],
        FORCE_BELOW: [-256, 0, 2560],
        TRAVEL_ABOVE: [1, 30, 500],
        TOUCH_ABOVE: [-20, 0, 40],
        TOUCH_BELOW: [-20, 0, 40],
        INPUT_ON: [1, 2, 6],
        INPUT_OFF: [1, 2, 6],
    }
    next_phase = rng.choice([*range(phases), *range(phases), END])
    return struct.pack(
        CONDITION, when, next_phase, rng.choice([0, 1, 3]), rng.choice(levels.get(when, [0]))
    )


def phase(rng, phases, position):
    action = rng.choice([MOVE_BY, MOVE_TO_TOUCH, APPROACH, APPROACH, PRESS, PRESS, PRESS, WAIT])
    if rng.random() < 0.05:
        action = MOVE
    force = slope = target = speed = 0
    if action == PRESS:
        force, slope = rng.choice([1, 100, 750, -500, 32767]), rng.choice([1, 10_000, 1_000_000])
    elif action != WAIT:
        near = rng.choice([3, 300, 3000])
        target = rng.randint(-near, near) + (position if action in (MOVE, APPROACH) else 0)
        speed = rng.choice([1, 1500, 15_000, 300_000])
    limits = (
        rng.choice([131_071, 131_071, 20_000]),
        rng.choice([2**30 - 1, 100_000, 200]),
        rng.choice([2**32 - 1, 2000, 60]),
    )
    reaction = rng.choice([*range(phases), END])
    fields = (action, reaction, force, slope, target, speed, *limits, 0)
    return struct.pack(PHASE, *fields) + b"".join(condition(rng, phases) for _ in range(4))


def element(rng, kinds, points):
    kind = rng.choice(kinds)
    over_time = int(rng.random() < 0.3)
    ends = (
        sorted(rng.randint(-60, 300) for _ in range(2)) if rng.random() < 0.7 else (-(10**6), 10**6)
    )
    least, most = sorted(rng.choice([-5000, 0, 100, 2560, 9000, 30_000]) for _ in range(2))
    of_force = direction = ordinal = enters = leaves = lower = upper = first = level = level_2 = 0
    if kind in (AT, DIFFERENCE):
        of_force, direction, ordinal = (
            rng.randint(0, 1),
            rng.randint(1, 3),
            rng.choice([1, 1, 2, 9]),
        )
        levels = [0, 256, 2560, 9000] if of_force else [0, 5, 30, 200]
        level = rng.choice(levels)
        level_2 = rng.choice(levels) if kind == DIFFERENCE else 0
    if kind == WINDOW:
        enters, leaves = rng.randint(1, 15), rng.choice([0, 15, rng.randint(1, 15)])
    if kind == ENVELOPE:
        first, lower, upper = len(points), rng.randint(2, 6), rng.randint(2, 6)
        for count in (lower, upper):
            inner = rng.sample(range(ends[0], ends[1] + 9), count - 2)
            for x in sorted([ends[0] - 1, *inner, ends[1] + 9]):
                points.append((x, rng.randint(-5000, 30_000)))
    return struct.pack(
        ELEMENT, kind, over_time, 0xFFFF, of_force, direction, ordinal, enters, leaves, lower,
        upper, 0, first, 0, *ends, least, most, level, level_2,
    )  # fmt: skip


def random_program(rng, position):
    """The record of a program around a position in counts."""
    phases, elements = rng.choice([1, 3, 6, PHASES_MAX]), rng.choice([0, 3, ELEMENTS_MAX])
    # The longest evaluation is that of sixteen elements of one kind.
    kinds, points = rng.choice([range(8), [rng.randrange(8)]]), []
    body = b"".join(phase(rng, phases, position) for _ in range(phases))
    body += b"".join(element(rng, kinds, points) for _ in range(elements))
    body += b"".join(struct.pack(POINT, *p) for p in points)
    size = struct.calcsize(HEADER) + len(body) + 4
    header = struct.pack(
        HEADER, MAGIC, VERSION, size, phases, elements, len(points), 0, rng.randrange(9), b"fuzz"
    )
    record = header + body
    return record + struct.pack("<I", zlib.crc32(record))
