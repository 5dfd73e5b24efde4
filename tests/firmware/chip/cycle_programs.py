"""Random programs of a cycle, each one right (firmware/cycle/program.h)."""

import struct
import zlib

MAGIC, VERSION, END = 0x59435846, 2, 255
HEADER, PHASE, CONDITION = "<IHHBBHII12siBBBB", "<BBhIiIIIIHHBBBB", "<BBHi"
ELEMENT, POINT = "<BBHBBBBBBBBHHiiiiii", "<ii"
MOVE, MOVE_BY, MOVE_TO_DEPTH, APPROACH, PRESS, WAIT, FOLLOW, TARE, OUTPUT = range(9)
REACHED, TIME, FORCE_ABOVE, FORCE_BELOW, TRAVEL_ABOVE, DEPTH_ABOVE, DEPTH_BELOW = range(1, 8)
INPUT_ON, INPUT_OFF, STIFFNESS_ABOVE, STIFFNESS_BELOW, CONDITION_KINDS = range(10, 15)
ZERO_TOUCH, ZERO_FORCE, ZERO_POSITION = range(3)
PEAK, VALLEY, AT, DIFFERENCE, WORK, LAST, WINDOW, ENVELOPE = range(8)
PHASES_MAX, ELEMENTS_MAX, OUTPUTS = 16, 16, 15


def condition(rng, phases):
    when = rng.randrange(CONDITION_KINDS)
    levels = {
        TIME: [1, 5, 40, 400],
        FORCE_ABOVE: [-256, 0, 2560, 30000],
        FORCE_BELOW: [-256, 0, 2560],
        TRAVEL_ABOVE: [1, 30, 500],
        DEPTH_ABOVE: [-20, 0, 40],
        DEPTH_BELOW: [-20, 0, 40],
        INPUT_ON: [1, 2, 6],
        INPUT_OFF: [1, 2, 6],
        STIFFNESS_ABOVE: [-(2**20), 0, 2**24],
        STIFFNESS_BELOW: [-(2**20), 0, 2**24],
    }
    next_phase = rng.choice([*range(phases), *range(phases), END])
    level = rng.choice(levels.get(when, [0]))
    return when, struct.pack(CONDITION, when, next_phase, rng.choice([0, 1, 3]), level)


def table(rng, points):
    """Adds a table of force over time or travel. Returns its first point and its length."""
    first, count = len(points), rng.choice([2, 3, 9, 25])
    if first > 30:  # a record has at most 4096 bytes
        count = 2
    x = rng.choice([0, 0, -30, 40])
    for _ in range(count):
        points.append((x, 256 * rng.choice([0, 1, 100, 750, -500, 32766])))
        x += rng.choice([1, 7, 200])
    return first, count


def phase(rng, phases, position, points, is_first):
    action = rng.choice([*range(MOVE_BY, OUTPUT + 1), APPROACH, PRESS, FOLLOW])
    if rng.random() < 0.05:
        action = MOVE
    if is_first and rng.random() < 0.3:  # before the axis has touched anything
        action = TARE
    force = slope = target = speed = first = count = over_travel = on = 0
    if action in (PRESS, FOLLOW):
        slope = rng.choice([1, 10_000, 1_000_000])
    if action == PRESS:
        force = rng.choice([1, 100, 750, -500, 32767])
    elif action == FOLLOW:
        (first, count), over_travel = table(rng, points), rng.randint(0, 1)
    elif action == TARE:
        target = rng.choice([1, 1, 20, 15_000])
    elif action not in (WAIT, OUTPUT):
        near = rng.choice([3, 300, 3000])
        target = rng.randint(-near, near) + (position if action in (MOVE, APPROACH) else 0)
        target = max(-(2**31), min(2**31 - 1, target))
        speed = rng.choice([1, 1500, 15_000, 300_000])
    limits = (
        rng.choice([65_000, 65_000, 20_000]),  # below the end of a sensor of 8 bits
        rng.choice([2**30 - 1, 100_000, 200]),
        rng.choice([2**32 - 1, 2000, 60]),
    )
    reaction = rng.choice([*range(phases), END])
    conditions = [condition(rng, phases) for _ in range(4)]
    if action == TARE:
        conditions[0] = REACHED, struct.pack(CONDITION, REACHED, rng.randrange(phases), 0, 0)
    measures = any(when in (STIFFNESS_ABOVE, STIFFNESS_BELOW) for when, _ in conditions)
    stiffness_travel = rng.choice([1, 8]) if measures else 0
    if action == OUTPUT or rng.random() < 0.2:
        on = rng.randint(1, OUTPUTS)
    off = rng.randint(0, OUTPUTS) & ~on
    more = (stiffness_travel, first, count, over_travel, on, off)
    fields = (action, reaction, force, slope, target, speed, *limits, *more)
    return struct.pack(PHASE, *fields) + b"".join(record for _, record in conditions)


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
    sides = (direction, ordinal, enters, leaves, lower, upper, 0, first, 0)
    bounds = (*ends, least, most, level, level_2)
    return struct.pack(ELEMENT, kind, over_time, 0xFFFF, of_force, *sides, *bounds)


def short_phase(rng, position, points, number, phases):
    """APPROACH and FOLLOW in turn. The fourth condition of APPROACH is met as soon as travel 0 is
    found, so that three conditions, the compliance and the begin of FOLLOW are in one tick."""
    next_phase = (number + 1) % phases
    limits = 65_000, 2**30 - 1, 2**32 - 1
    if number % 2 == 0:
        first, over_travel = (0, 0), 0
        action, slope, speed = APPROACH, 0, rng.choice([1500, 15_000, 300_000])
        target = max(-(2**31), min(2**31 - 1, position + rng.randint(-3000, 3000)))
        conditions = [
            rng.choice([(STIFFNESS_ABOVE, 0, 0, 2**30), (DEPTH_ABOVE, 0, 0, 30_000)])
            for _ in range(3)
        ]
        conditions.append((DEPTH_BELOW, next_phase, rng.choice([0, 3]), 30_000))
    else:
        first, over_travel = table(rng, points), rng.randint(0, 1)
        action, slope, speed, target = FOLLOW, rng.choice([1, 10_000, 1_000_000]), 0, 0
        conditions = [(TIME, next_phase, 0, rng.choice([3, 40]))] + 3 * [(0, 0, 0, 0)]
    measures = any(when == STIFFNESS_ABOVE for when, *_ in conditions)
    more = (8 if measures else 0, *first, over_travel, rng.randint(1, OUTPUTS), 0)
    fields = (action, END, 0, slope, target, speed, *limits, *more)
    records = (struct.pack(CONDITION, *fields) for fields in conditions)
    return struct.pack(PHASE, *fields) + b"".join(records)


def random_program(rng, position, short_share=0.25):
    """The record of a program around a position in counts; `short_share`: of the programs with
    phases of short_phase()."""
    is_short = rng.random() < short_share
    phases, elements = rng.choice([1, 3, 6, PHASES_MAX]), rng.choice([0, 3, ELEMENTS_MAX])
    if is_short:
        phases = 8
    # The longest evaluation is that of sixteen elements of one kind.
    kinds, points = rng.choice([range(8), [rng.randrange(8)]]), []
    compliance = 16 if is_short else rng.choice([0, 2, 3, 16])
    for i in range(compliance):
        points.append((5000 * (i - 1) - rng.randint(0, 4000), rng.randint(-3, 30)))
    if is_short:
        body = b"".join(short_phase(rng, position, points, i, phases) for i in range(phases))
    else:
        body = b"".join(phase(rng, phases, position, points, i == 0) for i in range(phases))
    body += b"".join(element(rng, kinds, points) for _ in range(elements))
    body += b"".join(struct.pack(POINT, *p) for p in points)
    size = struct.calcsize(HEADER) + len(body) + 4
    parts = (phases, elements, len(points), 0, rng.randrange(9), b"fuzz")
    zero = rng.choice([ZERO_TOUCH] * 8 + [ZERO_FORCE] * 3 + [ZERO_POSITION])
    level = {ZERO_TOUCH: 0, ZERO_FORCE: 2560, ZERO_POSITION: position}[zero]
    header = struct.pack(
        HEADER, MAGIC, VERSION, size, *parts, level, zero, compliance, rng.randint(0, OUTPUTS), 0
    )
    record = header + body
    return record + struct.pack("<I", zlib.crc32(record))
