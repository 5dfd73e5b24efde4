"""Curves of pressed parts, and what they must be judged to be, computed in NumPy and exact
fractions from the SI values of the recording. Nothing of the package takes part but the types of a
recording."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from math import ceil, floor

import numpy as np
from element_oracle import (
    AT,
    DIFFERENCE,
    EITHER,
    END,
    ENVELOPE,
    FALLING,
    PEAK,
    RISING,
    VALLEY,
    WINDOW,
    WORK,
    expected,
)
from forceaxis.recordings.signal_recording import (
    RecordedSignal,
    RecordingSource,
    SignalFinding,
    SignalRecording,
)

KINDS = {"peak": PEAK, "valley": VALLEY, "at": AT, "difference": DIFFERENCE, "work": WORK,
         "last": END, "window": WINDOW, "envelope": ENVELOPE}  # fmt: skip
VERDICTS = ("good", "below", "above", "wrong side", "again", "not reached")
DIRECTIONS = {"rising": RISING, "falling": FALLING, "either": EITHER}
SIDES = {"left": 1, "right": 2, "bottom": 4, "top": 8}
INFINITE = {"least": -(2**31), "most": 2**31 - 1}


def signal(name, time_s, values, findings=(), unit=None):
    """A signal of a recording."""
    found = unit or {"force": "N", "position": "m"}.get(name, "1")
    rate_hz = 1 / float(np.median(np.diff(time_s)))
    return RecordedSignal(
        name, found, name, found, 1.0, 1, rate_hz, findings=tuple(findings),
        time_s=np.asarray(time_s, float), values=np.asarray(values, float),
    )  # fmt: skip


def recording(time_s, force_N, position_m, findings=(), **others):
    """A recording with force and position, and other signals such as phase."""
    signals = [
        signal("force", time_s, force_N, findings), signal("position", time_s, position_m),
        *(signal(name, time_s, values) for name, values in others.items()),
    ]  # fmt: skip
    return SignalRecording("part", RecordingSource("part.csv", "CSV", "0" * 64, 1), tuple(signals))


def saturation(begin_s, end_s):
    """The finding of an import that a signal is saturated."""
    return SignalFinding("saturation", begin_s, end_s, 3, "3 samples at an end of the range")


def counted(values, count):
    """The nearest whole numbers of counts, halves up."""
    return np.array([floor(Fraction(float(v)) / Fraction(count) + Fraction(1, 2)) for v in values])


def interpolated(points, x):
    """The value of a table at a whole number x, rounded half up; constant beyond its ends."""
    for (x0, y0), (x1, y1) in pairwise(points):
        if x0 <= x <= x1:
            return floor(y0 + Fraction(x - x0, x1 - x0) * (y1 - y0) + Fraction(1, 2))
    return points[0][1] if x < points[0][0] else points[-1][1]


def element_of(table, phases, scale, points):
    """An element of a TOML table as a dict for the oracle. scale: function that converts a number
    with its unit to counts. points: list to which the points of an envelope are added."""
    kind = KINDS[table["kind"]]
    over_time = int(table.get("over") == "time")
    x_unit = "s" if over_time else "m"
    of_force = int(table.get("of") == "force")
    level_unit = "N" if of_force else x_unit
    value_unit = "N"
    if kind in (AT, DIFFERENCE) and of_force:
        value_unit = x_unit
    if kind == WORK:
        value_unit = "N s" if over_time else "J"
    far = 2**30 - 1

    def whole(key, unit, default):
        return scale(table[key], unit) if key in table else default

    def bound(key, rounding):
        return scale(table[key], value_unit, rounding) if key in table else INFINITE[key]

    found = {
        "kind": kind, "over_time": over_time, "of_force": of_force,
        "phases": sum(1 << phases.index(name) for name in table["phases"]),
        "x_least": whole("from", x_unit, -far), "x_most": whole("to", x_unit, far),
        "y_least": bound("least", ceil),
        "y_most": bound("most", floor),
        "level": whole("level", level_unit, 0), "level_2": whole("level_2", level_unit, 0),
        "direction": DIRECTIONS[table.get("direction", "rising")],
        "ordinal": table.get("ordinal", 1),
        "enters": sum(SIDES[side] for side in table.get("enters", [])),
        "leaves": sum(SIDES[side] for side in table.get("leaves", [])),
    }  # fmt: skip
    if kind == ENVELOPE:
        for side in ("lower", "upper"):
            xs = [scale(x, x_unit) for x in table[f"{side}_x"]]
            forces = [scale(y, "N") for y in table[f"{side}_force"]]
            found[side] = len(xs)
            found.setdefault("first", len(points))
            points += zip(xs, forces, strict=True)
        low = points[found["first"] : found["first"] + found["lower"]]
        high = points[found["first"] + found["lower"] :]
        if "from" not in table:
            found["x_least"] = max(low[0][0], high[0][0])
        if "to" not in table:
            found["x_most"] = min(low[-1][0], high[-1][0])
    return found


class Oracle:
    """Judges the curves of a program. travel_count and force_count: exact sizes of the counts as
    texts, such as "1e-6"."""

    def __init__(self, program, travel_count, force_count, contact_N=None):
        self.program = program
        self.travel, self.force = Fraction(travel_count), Fraction(force_count)
        self.contact_N = contact_N
        self.phases = [phase["name"] for phase in program["phase"]]

    def scale(self, rate_hz):
        """The function that converts a number of a unit to counts, for numbers that are whole
        numbers of counts."""
        sizes = {"m": self.travel, "N": self.force, "s": 1 / Fraction(rate_hz)}
        # The unit of an energy is 256 of 1/256 counts of force times a count of x.
        sizes["J"] = 256 * self.force * self.travel
        sizes["N s"] = 256 * self.force / Fraction(rate_hz)

        def scaled(value, unit, whole=None):
            counts = Fraction(float(value)) / sizes[unit]
            if whole is not None:  # a bound, without the rounding error of a number of the file
                near = Fraction(1, 10**6) * (-1 if whole is ceil else 1)
                return whole(counts + near)
            assert abs(counts - round(counts)) < Fraction(1, 1000), (value, unit)
            return round(counts)

        return scaled

    def samples(self, made):
        """(position, force, valid, label) of each period, in counts; label None: none."""
        force, position = made["force"], made["position"]
        period = float(np.median(np.diff(force.time_s)))
        begin_s = min(s.time_s[0] for s in made)
        count = round((max(s.time_s[-1] for s in made) - begin_s) / period) + 1
        number = np.rint((force.time_s - begin_s) / period).astype(int)
        is_force = np.isin(position.time_s, force.time_s)  # the force may be missing at the ends
        place = counted(position.values[is_force], self.travel)
        load = counted(force.values, self.force)
        named = {}
        if "phase" in made:
            times = np.rint((made["phase"].time_s - begin_s) / period).astype(int)
            named = dict(zip(times.tolist(), counted(made["phase"].values, 1), strict=True))
        valid = [
            abs(y) <= 131071
            and not any(f.from_s <= t <= f.to_s for s in (force, position) for f in s.findings)
            for t, y in zip(force.time_s, load, strict=True)
        ]  # fmt: skip
        rows, last, label = {}, int(number[0]), None
        for n, x, y, v in zip(number, place, load, valid, strict=True):
            rows[int(n)] = (int(x), max(-131071, min(131071, int(y))), v)
        found = []
        for n in range(count):
            last = n if n in rows else last
            label = named.get(n, label)
            found.append((*rows[last][:2], rows[n][2] if n in rows else "missing", label))
        return found

    def zero(self, samples, points):
        """The index of the sample with travel 0, or None."""
        kind = self.program.get("zero", "touch")
        if kind == "position":
            return 0
        for k, (_, y, valid, _) in enumerate(samples):
            if valid is not True:
                continue
            if kind == "force":
                level = round(Fraction(float(self.program["zero_force"])) / self.force)
                if (y >= level) if level > 0 else (y <= level):
                    return k
            elif abs(y) > round(Fraction(float(self.contact_N)) / self.force):
                return k
        return None

    def curve(self, samples, start):
        """(travel of each sample, index of travel 0 or None)."""
        table = [
            (round(Fraction(float(f)) / self.force), round(Fraction(float(d)) / self.travel))
            for f, d in zip(self.program.get("compliance_force", []),
                            self.program.get("compliance_deflection", []), strict=True)
        ]  # fmt: skip

        def deflection(y):
            return interpolated(table, y) if table else 0

        at = self.zero(samples, table)
        if self.program.get("zero") == "position":
            origin = round(Fraction(float(self.program["zero_position"])) / self.travel)
            return [x - origin - deflection(y) for x, y, *_ in samples], 0
        first = start[0] - deflection(start[1])
        found = None if at is None else samples[at][0] - deflection(samples[at][1])
        return [
            x - (found if at is not None and k >= at else first) - deflection(y)
            for k, (x, y, *_) in enumerate(samples)
        ], at  # fmt: skip

    def judged(self, made, rate_hz, labels=None):
        """[(name, verdict, value in counts or None)] of each element. labels: the phases of the
        samples, if the recording does not name them."""
        samples = self.samples(made)
        if labels is not None:
            samples = [(*s[:3], label) for s, label in zip(samples, labels, strict=False)]
        inside = [k for k, s in enumerate(samples) if s[3] is not None and s[3] >= 0]
        start = samples[max(inside[0] - 1, 0)]
        samples = samples[inside[0] : inside[-1] + 1]
        travel, zero = self.curve(samples, start)
        found, scale = [], self.scale(rate_hz)
        for table in self.program["element"]:
            points = []
            element = element_of(table, self.phases, scale, points)
            numbers = {self.phases.index(name) for name in table["phases"]}
            needed = 0 if element["over_time"] else len(samples) if zero is None else zero
            if self.is_invalid(samples, numbers, needed):
                found.append((table["name"], "invalid", None))
                continue
            # No line leads over travel 0, so later ticks are one further.
            rows = [
                (k + (not element["over_time"] and zero is not None and k >= zero), t, s[1], s[3])
                for k, (t, s) in enumerate(zip(travel, samples, strict=True))
                if s[2] is True
            ]  # fmt: skip
            value, _, verdict = expected(
                element, points, np.array(rows, dtype=np.int64).reshape(-1, 4)
            )
            found.append((table["name"], VERDICTS[verdict], value))
        return found

    def is_invalid(self, samples, numbers, zero):
        """Whether an element over these phases has a sample that is not valid, or one before the
        sample `zero`."""
        for k, (_, _, valid, label) in enumerate(samples):
            if valid is True:
                continue
            after = next((s[3] for s in samples[k:] if s[2] != "missing"), None)
            if label in numbers or (valid == "missing" and after in numbers):
                return True
            if k < zero:
                return True
        return False


def without(made, lost, names=None):
    """The recording without the samples of these indices; with names, only of these signals."""
    keep = np.setdiff1d(np.arange(len(made["force"].time_s)), lost)
    signals = [
        replace(s, time_s=s.time_s[keep], values=s.values[keep])
        if names is None or s.name in names else s
        for s in made
    ]  # fmt: skip
    return replace(made, signals=tuple(signals))
