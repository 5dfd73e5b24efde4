"""The points of a sweep: a grid, random draws, and the axis of a bisection."""

import hashlib
import itertools
import math
from dataclasses import dataclass

from forceaxis import _core, objects
from forceaxis._core import InputError
from forceaxis.words import suggestion

MOST_POINTS = 1_000_000


# Keys of an experiment's tables that are numbers and so can be swept.
KEYS = {
    "experiment": ("duration_s", "seed"),
    "verdict": ("window_s", "force_ripple_max_count", "position_ripple_max_count"),
}


def meant(name, parameters=()):
    """As words.suggestion(), of all that --set takes; a name without its table is given it."""
    full = {key: f"{room}.{key}" for room, keys in KEYS.items() for key in keys}
    full |= {o.name: f"firmware.{o.name}" for o in objects.OBJECTS if "w" in o.access}
    if name in full:
        return f"; did you mean {full[name]}?"
    room = name.partition(".")[0] + "."
    near = [text for text in full.values() if text.startswith(room)] if "." in name else []
    return suggestion(name, near or [*parameters, *full.values()])


@dataclass(frozen=True)
class Axis:
    """A swept parameter."""

    name: str
    low: float
    high: float
    log: bool = False
    values: tuple = ()  # of a grid
    tolerance: float = 0.0  # of a bisection

    def at(self, u):
        """The value at u = 0..1 of the range, rounded to 12 digits: its printed form is exact."""
        if self.log:
            return tidy(self.low * (self.high / self.low) ** u)
        return tidy(self.low + (self.high - self.low) * u)


def tidy(value):
    """The value rounded to 12 digits."""
    return float(f"{value:.12g}")


def parse(option, name, text, more, may_log):
    """An axis from FROM:TO and the numbers named in `more`, with :log where it may be."""
    shape = ":".join(("FROM", "TO", *more))
    parts = str(text).split(":")
    log = may_log and parts[-1] == "log"
    numbers = parts[:-1] if log else parts

    def fail(message):
        raise InputError(f"{option}: {name}={text}: expected {message}")

    try:
        values = [float(part) for part in numbers]
    except ValueError:
        values = []
    if len(values) != 2 + len(more) or not all(map(math.isfinite, values)):
        fail(f"NAME={shape}" + ("[:log]" if may_log else "") + ", with finite numbers")
    low, high = values[:2]
    if not low < high:
        fail("FROM below TO")
    if log and low <= 0:
        fail("FROM above 0 for :log")
    if "TOLERANCE" in more:
        if not 0 < values[2] < high - low:
            fail("TOLERANCE above 0 and below TO - FROM")
        return Axis(name, low, high, tolerance=values[2])
    if "COUNT" in more:
        if values[2] != int(values[2]) or not 2 <= values[2] <= MOST_POINTS:
            fail(f"COUNT to be a whole number from 2 to {MOST_POINTS}; --set gives one value")
        axis = Axis(name, low, high, log)
        n = int(values[2])
        return Axis(name, low, high, log, tuple(axis.at(i / (n - 1)) for i in range(n)))
    return Axis(name, low, high, log)


def grid_axes(grid):
    """Axes from {name: text or values}."""
    axes = []
    for name, given in grid.items():
        if isinstance(given, str) and ":" in given:
            axes.append(parse("--grid", name, given, ("COUNT",), True))
            continue
        try:
            values = tuple(
                float(v) for v in (given.split(",") if isinstance(given, str) else given)
            )
        except ValueError:
            values = ()
        if not values or not all(map(math.isfinite, values)):
            raise InputError(
                f"--grid: {name}={given}: expected NAME=FROM:TO:COUNT[:log] or "
                "NAME=VALUE,VALUE,..., with finite numbers"
            )
        axes.append(Axis(name, min(values), max(values), values=values))
    points = math.prod(len(a.values) for a in axes)
    if points > MOST_POINTS:
        raise InputError(f"--grid: expected at most {MOST_POINTS} points, got {points}")
    return axes


def grid_points(axes):
    """All combinations, the last axis fastest."""
    return list(itertools.product(*(a.values for a in axes)))


def random_axes(random):
    """Axes from {name: "FROM:TO[:log]"}."""
    return [parse("--random", name, text, (), True) for name, text in random.items()]


def random_points(axes, count, seed):
    """Point i of a parameter depends on seed, name and i alone.

    u = the first 53 bits of SHA-256("SEED:NAME:INDEX") / 2^53.
    """
    if not count or not 1 <= count <= MOST_POINTS:
        raise InputError(f"--count: expected a number of random points, 1 to {MOST_POINTS}")

    def draw(axis, i):
        digest = hashlib.sha256(f"{seed}:{axis.name}:{i}".encode()).digest()
        return axis.at((int.from_bytes(digest[:8], "big") >> 11) / 2**53)

    return [tuple(draw(a, i) for a in axes) for i in range(count)]


def check_names(experiment, inputs, overrides, axes):
    """Refuse names that `--set` would refuse, and parameters without effect."""
    taken = {text.partition("=")[0] for text in overrides}
    for axis in axes:
        name = axis.name

        def fail(message, name=name):
            raise InputError(f"{experiment}: {name}: expected {message}")

        if name in taken:
            fail("each name once among --grid, --random, --bisect and --set")
        taken.add(name)
        room, dot, key = name.partition(".")
        if not dot:
            if name not in inputs["parameters"]:
                fail(
                    "a parameter of the model, firmware.OBJECT, experiment.KEY or verdict.KEY"
                    f"{meant(name, inputs['parameters'])}"
                )
            value = inputs["parameters"][name]["value"]
            if name in _core.inputs(str(experiment), [*overrides, f"{name}={value!r}"])["unused"]:
                fail("a parameter that the model uses, this one changes nothing here")
        elif room == "firmware":
            if not any(o.name == key and "w" in o.access for o in objects.OBJECTS):
                fail(f"a firmware object that can be written{meant(name)}; `forceaxis objects` "
                     "lists them")  # fmt: skip
        elif key not in KEYS.get(room, ()):
            known = [f"{r}.{k}" for r, keys in KEYS.items() for k in keys]
            fail(f"a model parameter, firmware.OBJECT or one of {', '.join(known)}{meant(name)}")


def unit_of(name, inputs):
    """The unit of a swept parameter, "" for none."""
    room, _, key = name.partition(".")
    if room == "firmware":
        unit = next(o.unit for o in objects.OBJECTS if o.name == key)
    elif key:
        unit = {"s": "s", "t": "count"}.get(key[-1], "") if key != "seed" else ""
    else:
        unit = inputs["parameters"][name]["unit"]
    return "" if unit == "1" else unit
