"""Experiments as regression tests: what must come out stands in the experiment's [expect] table.

    [expect]
    verdict = "stable"       or "unstable": what [verdict] finds
    fault = "none"           the first fault that the firmware latched
    trace_hash = "08b6..."   every code of every tick
    peak_force_N = 69.7      largest force in any contact of the model, at any tick
    final_value = 30.2       mean of `signal` over its last final_s
    settle_s = 0.81          from from_s until `signal` stays within final_value +- band (the tick
                             after the last one outside); "never" if outside in the last final_s
    overshoot = 0.12         how far `signal` goes beyond final_value, as a fraction of the step
                             from its value at from_s; "undefined" when there is no step

    signal = "sensor.force"  a column of the trace; default: the first contact's force, else encoder
    from_s = 0.0             `signal` is looked at from here on, for instance from a disturbance
    final_s = 0.3            default: a tenth of what follows from_s
    band = 0.05              fraction of the step, or { absolute = 1.5 } in the unit of `signal`

A number is 69.7, { value = 69.7, tolerance = 0.5 }, { value = 69.7, relative = 0.01 } or a limit
{ min = 60, max = 80 }, one or both. A bare number is met within TOLERANCES; 1 % of 0 is 0, so a
final_value below 1e-9 of the largest value counts as 0.
"""

import difflib
import json
import math
import os
import re
import time
import xml.etree.ElementTree as ET
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from forceaxis import _core, objects, paths, toml
from forceaxis._core import InputError, SimulationError
from forceaxis.experiments import files as experiments

TEXTS = ("verdict", "fault", "trace_hash")
# How near a bare number must be met: 1 % of it, 10 ms, one percent of the step.
TOLERANCES = {
    "peak_force_N": {"relative": 0.01},
    "final_value": {"relative": 0.01},
    "settle_s": {"tolerance": 0.01},
    "overshoot": {"tolerance": 0.01},
}
NOTHING = {"settle_s": "never", "overshoot": "undefined"}  # where no number can be had
HOW = ("signal", "from_s", "final_s", "band")
LARGEST = 1e18


@dataclass(frozen=True)
class Number:
    """A number that is expected within low .. high; `value` is None for a limit."""

    low: float
    high: float
    value: float | None = None

    def __str__(self):
        if self.value is None:
            low = f"at least {self.low:.6g}" if math.isfinite(self.low) else ""
            high = f"at most {self.high:.6g}" if math.isfinite(self.high) else ""
            return " and ".join(filter(None, (low, high)))
        return f"{self.value:.6g} +-{self.high - self.value:.3g}"


@dataclass(frozen=True)
class Expectation:
    """A checked [expect] table: key -> text or Number, and how `signal` is looked at."""

    wanted: dict
    signal: str | None
    from_s: float
    final_s: float | None
    band: float
    band_is_absolute: bool


@dataclass(frozen=True)
class Measured:
    """What a run gave: values by the keys of [expect], and the response they come from."""

    values: dict
    signal: str
    from_s: float
    final_s: float
    start: float
    final: float
    width: float  # the settling band is final +- width
    contacts: list


@dataclass(frozen=True)
class Check:
    """One expectation beside what was obtained."""

    key: str
    expected: str | Number
    obtained: str | float

    @property
    def passed(self):
        """Whether the obtained is as expected."""
        if isinstance(self.expected, Number) and isinstance(self.obtained, float):
            return self.expected.low <= self.obtained <= self.expected.high
        return self.expected == self.obtained

    def __str__(self):
        return f"{self.key}: expected {shown(self.expected)}, got {shown(self.obtained)}"


@dataclass(frozen=True)
class Examined:
    """A finished run beside its [expect]; without one `checks` is empty and `expect` None."""

    run: experiments.Run
    expect: Expectation | None
    measured: Measured
    checks: list

    @property
    def differences(self):
        """The checks that failed."""
        return [c for c in self.checks if not c.passed]


@dataclass
class Outcome:
    """One test's end: passed, failed, error (bad input), updated or skipped (no [expect])."""

    file: Path
    status: str
    seconds: float = 0.0
    message: str = ""  # why it could not be examined
    checks: list = field(default_factory=list)
    examined: Examined | None = None  # kept while it is needed for a plot or an update

    @property
    def name(self):
        """How it is called in every output."""
        return paths.display(self.file)

    @property
    def lines(self):
        """What differs, a line each."""
        return [str(c) for c in self.checks if not c.passed] or [self.message]

    def summary(self):
        """The entry that `--json` prints."""
        checks = [
            {
                "key": c.key,
                "expected": str(c.expected),
                "obtained": c.obtained,
                "passed": c.passed,
            }
            for c in self.checks
        ]
        return {
            "experiment": self.name,
            "status": self.status,
            "seconds": round(self.seconds, 3),
            "message": self.message,
            "checks": checks,
        }


def shown(value):
    """A value for a reader; `--json` and --update have all digits."""
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) < 64 else text[:16] + "..."


def read(file, data):
    """The Expectation of `_core.inputs`, None without [expect]. Raises InputError."""
    table = data["expect"]
    if table is None:
        return None

    def fail(key, message):
        raise InputError(f"{file}: expect{key and '.'}{key}: {message}")

    def number(key, value, low=-LARGEST):
        if isinstance(value, bool) or not isinstance(value, int | float):
            fail(key, "expected a number")
        if not low <= value <= LARGEST:  # NaN too
            fail(key, f"expected a number from {low:g} to {LARGEST:g}, got {value:g}")
        return float(value)

    def wanted(key, value):
        low = -LARGEST if key == "final_value" else 0.0
        if isinstance(value, str) and key in NOTHING:
            if value != NOTHING[key]:
                fail(key, f'expected a number or "{NOTHING[key]}", got "{value}"')
            return value
        if not isinstance(value, dict):
            value = {"value": number(key, value, low)}
        for name in value:
            if name not in ("value", "tolerance", "relative", "min", "max"):
                fail(
                    f"{key}.{name}",
                    "expected one of value, tolerance, relative, min, max; "
                    "remove or rename this key",
                )
        given = {n: number(f"{key}.{n}", v, -LARGEST) for n, v in value.items()}
        if "min" in given or "max" in given:
            if len(given) != len(given.keys() & {"min", "max"}):
                fail(key, "expected either min and max or value with its tolerance, not both")
            limits = Number(given.get("min", -math.inf), given.get("max", math.inf))
            if limits.low > limits.high:
                fail(key, f"expected min below max, got {limits.low:g} and {limits.high:g}")
            if limits.high < low:
                fail(f"{key}.max", f"expected at least {low:g}, it is never below")
            return limits
        if "value" not in given:
            fail(key, "expected value or min or max; add value = ...")
        expected = number(f"{key}.value", given["value"], low)
        if "tolerance" in given and "relative" in given:
            fail(key, "expected tolerance or relative, not both")
        if "relative" in given and expected == 0:
            fail(f"{key}.relative", "expected tolerance beside a value of 0, a part of 0 is 0")
        allowed = {n: v for n, v in given.items() if n != "value"} or TOLERANCES[key]
        ((name, width),) = allowed.items()
        width = number(f"{key}.{name}", width, 0.0)
        if name == "relative":
            width *= abs(expected)
        return Number(expected - width, expected + width, expected)

    known = (*TEXTS, *TOLERANCES, *HOW)
    toml.expect_keys(table, known, fail)
    faults = next(o.enum for o in objects.OBJECTS if o.name == "fault")
    for key, texts in (("verdict", ("stable", "unstable")), ("fault", faults)):
        if key in table and table[key] not in texts:
            fail(key, f"expected one of {', '.join(texts)}, got {table[key]!r}")
    if "verdict" in table and not data["criterion"]:
        fail("verdict", "expected a [verdict] table that says when the run is stable; add it")
    text = table.get("trace_hash", "0" * 64)
    if not (isinstance(text, str) and len(text) == 64 and set(text) <= set("0123456789abcdef")):
        fail("trace_hash", "expected 64 hexadecimal digits, as `forceaxis run` prints them")
    if not isinstance(table.get("signal", ""), str):
        fail("signal", "expected the name of a column of the trace")
    band, absolute = table.get("band", 0.05), False
    if isinstance(band, dict):
        if list(band) != ["absolute"]:
            fail("band", "expected a fraction of the step or { absolute = ... }")
        band, absolute = band["absolute"], True
    return Expectation(
        wanted={k: v if k in TEXTS else wanted(k, v) for k, v in table.items() if k not in HOW},
        signal=table.get("signal"),
        from_s=number("from_s", table.get("from_s", 0), 0.0),
        final_s=number("final_s", table["final_s"], 0.0) if "final_s" in table else None,
        band=number("band", band, 0.0),
        band_is_absolute=absolute,
    )


def measure(done, expect, contacts):
    """What a run gave by the definitions above. Raises InputError where [expect] is at odds."""

    def fail(key, message):
        raise InputError(f"{done.experiment}: expect.{key}: {message}")

    rate = _core.TICKS_PER_SECOND
    signal = expect.signal or (f"{contacts[0]}.force" if contacts else "encoder")
    if signal not in done.columns:
        fail("signal", f"expected a column ({', '.join(done.columns)}), got {signal!r}")
    if "peak_force_N" in expect.wanted and not contacts:
        fail("peak_force_N", "expected a model with a contact, this one has none; remove the key")
    first = math.ceil(expect.from_s * rate - 1e-9)
    values = done.columns[signal][first:].astype(float)
    if len(values) < 2:
        fail("from_s", f"expected a time before the end, {done.columns['time_s'][-1]:g} s")
    lasts_s = (len(values) - 1) / rate
    final_s = lasts_s / 10 if expect.final_s is None else expect.final_s
    if final_s > lasts_s + 1e-9:
        fail("final_s", f"expected at most the {lasts_s:g} s that follow from_s, got {final_s:g}")
    window = math.floor(final_s * rate + 1e-9) + 1
    final, start = float(values[-window:].mean()), float(values[0])
    largest = float(np.abs(values).max())
    if abs(final) < 1e-9 * largest:  # what has died out is 0, not a number that rounding makes
        final = 0.0
    step, rounding = final - start, 1e-12 * largest
    width = expect.band if expect.band_is_absolute else expect.band * abs(step)
    outside = np.flatnonzero(np.abs(values - final) > width + rounding)
    last = int(outside[-1]) if len(outside) else -1
    settled = last < len(values) - window
    beyond = float((math.copysign(1, step) * (values - final)).max())
    got = {
        "verdict": done.summary["verdict"],
        "fault": done.summary["fault"],
        "peak_force_N": done.summary["metrics"]["peak_force_N"] if contacts else None,
        "final_value": final,
        "settle_s": (last + 1) / rate if settled else NOTHING["settle_s"],
        "overshoot": max(0.0, beyond) / abs(step) if abs(step) > rounding else "undefined",
        "trace_hash": done.summary["trace_hash"],
    }
    return Measured(got, signal, expect.from_s, final_s, start, final, width, contacts)


def examine(file, overrides=()):
    """Run one experiment and set it beside its [expect]. Raises InputError, SimulationError."""
    file = Path(file)
    given = _core.inputs(str(file), list(overrides))
    expect = read(file, given)  # bad tables are refused before the work
    done = experiments.run(file, overrides)
    measured = measure(done, expect or read(file, {"expect": {}}), given["contacts"])
    wanted = expect.wanted if expect else {}
    checks = [Check(key, value, measured.values[key]) for key, value in wanted.items()]
    return Examined(done, expect, measured, checks)


def filled(text, values):
    """The experiment's text with all but overshoot put below the line [expect]."""
    keys = ("verdict", "peak_force_N", "final_value", "settle_s", "trace_hash")
    lines = [
        f"{key} = {json.dumps(written(values[key], TOLERANCES.get(key, {})))}\n"
        for key in keys
        if values[key] is not None
    ]
    return re.sub(
        r"^[ \t]*\[expect\][ \t]*(#.*)?(\n|\Z)",
        lambda header: header[0].rstrip("\n") + "\n" + "".join(lines),
        text,
        count=1,
        flags=re.M,
    )


def updated(text, examined):
    """The experiment's text with the failing values of [expect] replaced. Limits are demands, not
    records: they stay."""
    import tomlkit

    try:
        document = tomlkit.parse(text)
    except tomlkit.exceptions.ParseError as error:  # two readers of TOML may differ
        file = examined.run.experiment
        raise InputError(f"{file}: file: expected TOML that can be edited, {error}") from None
    table = document["expect"]
    for check in examined.differences:
        entry, allowed = table[check.key], TOLERANCES.get(check.key, {})
        if isinstance(check.expected, Number) and check.expected.value is None:
            continue
        if isinstance(entry, dict) and isinstance(check.obtained, float):
            own = {k: v for k, v in entry.items() if k != "value"}
            entry["value"] = written(check.obtained, own or allowed)
        else:
            table[check.key] = written(check.obtained, allowed)
    return tomlkit.dumps(document)


def rewritten(file, text, examined):
    """filled() or updated(), with the text's line ends.

    Raises InputError rather than touch anything but [expect].
    """
    crlf = text.count("\r\n") == text.count("\n")
    old = text.replace("\r\n", "\n") if crlf else text
    new = updated(old, examined) if examined.checks else filled(old, examined.measured.values)
    changes = difflib.SequenceMatcher(None, old.splitlines(), new.splitlines(), autojunk=False)
    lost = sum(end - start for kind, start, end, *_ in changes.get_opcodes() if kind != "equal")
    before, after = ({**toml.read_text(t), "expect": None} for t in (old, new))
    filled_nothing = new == old and not examined.checks
    if before != after or lost > len(examined.differences) or filled_nothing:
        raise InputError(
            f"{file}: expect: expected a table that can be rewritten in place; write [expect] on a "
            "line of its own, at the end of the file"
        )
    return new.replace("\n", "\r\n") if crlf else new


def written(value, allowed):
    """A value as it goes into the file: as short as a hundredth of its tolerance lets it be."""
    if not isinstance(value, float):
        return value
    near = float(allowed.get("tolerance", allowed.get("relative", 0.01) * abs(value))) / 100
    short = (round(value, decimals) for decimals in range(17))
    return next((s for s in short if abs(s - value) <= near), value)


def replace(file, text):
    """Write a file whole or not at all; its mode stays, a link stays a link."""
    file = Path(file).resolve()
    temporary = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8", newline="")
        if file.exists():
            temporary.chmod(file.stat().st_mode & 0o7777)
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)


def is_test(file):
    """True: has [expect] (or cannot be read, which a run will tell); False: an experiment without
    one; None: not an experiment."""
    try:
        data = toml.read(file)
    except InputError:
        return True
    if "expect" in data:
        return True
    return False if "model" in data else None


def find(targets, pattern=None):
    """(tests, experiments without [expect]) at and below the targets. Raises InputError."""
    files = {}
    for target in map(Path, targets):
        if target.is_dir():
            below = (p for p in target.rglob("*.toml") if p.is_file())
            found = (
                p
                for p in below
                if not any(part.startswith(".") for part in p.relative_to(target).parts)
            )
        elif target.exists():
            found = [target]
        else:
            raise InputError(f"{target}: expected a folder or an experiment file, there is none")
        files |= {p.resolve(): p for p in sorted(found)}
    if pattern:
        asked = f"*{pattern.lower()}*"
        files = {r: p for r, p in files.items() if fnmatch(paths.display(p).lower(), asked)}
    kinds = {p: is_test(p) for p in files.values()}
    tests = [p for p, kind in kinds.items() if kind]
    skipped = [p for p, kind in kinds.items() if kind is False]
    if not tests:
        where = ", ".join(map(str, targets)) + (f" with {pattern!r} in its name" if pattern else "")
        raise InputError(
            f"{where}: expected an experiment with an [expect] table, found none and "
            f"{len(skipped)} without; add [expect] and run `forceaxis test --update`"
        )
    return tests, skipped


def run_test(file):
    """Outcome of one file; never raises for what a user can do wrong."""
    began = time.perf_counter()
    outcome = Outcome(file, "error")
    try:
        outcome.examined = examine(file)
        outcome.checks = outcome.examined.checks
        if not outcome.checks:
            outcome.message = (
                f"{file}: expect: expected something to compare; run `forceaxis test --update`"
            )
        elif outcome.examined.differences:
            outcome.status = "failed"
        else:
            outcome.status, outcome.examined = "passed", None
    except SimulationError as error:
        outcome.status, outcome.message = "failed", str(error)
    except InputError as error:
        outcome.message = str(error)
    except OSError as error:
        outcome.message = f"{file}: expected to be able to read it, {error.strerror}"
    outcome.message = " ".join(outcome.message.split())
    outcome.seconds = time.perf_counter() - began
    return outcome


def update(outcome):
    """Rewrite the file's [expect] so that it passes, as far as limits let it."""
    file, examined = outcome.file, outcome.examined
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            text = stream.read()
        mark = "\ufeff" if text.startswith("\ufeff") else ""
        new = mark + rewritten(file, text.removeprefix("\ufeff"), examined)
        if new != text:
            replace(file, new)
        expect = read(file, _core.inputs(str(file)))
    except InputError as error:
        outcome.status, outcome.message = "error", str(error)
        return
    except OSError as error:
        outcome.status = "error"
        outcome.message = f"{file}: expected to be able to write it, {error.strerror}"
        return
    outcome.checks = [Check(k, v, examined.measured.values[k]) for k, v in expect.wanted.items()]
    outcome.status = "updated" if all(c.passed for c in outcome.checks) else "failed"
    outcome.message = ""


def run(targets, rewrite=False, out=None, threads=None, pattern=None, tell=None):
    """Run every test at and below the targets, in parallel; Outcomes in the order of their names.

    rewrite: rewrite [expect] where it differs. out: folder for a plot and a table of each
    difference. tell: called with each Outcome as soon as those before it are done.
    """
    tests, skipped = find(targets, pattern)
    if out:
        out.mkdir(parents=True, exist_ok=True)
    top = Path(os.path.commonpath([p.resolve().parent for p in tests]))
    outcomes = []
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        try:
            for outcome in pool.map(run_test, tests):
                if out and outcome.status == "failed" and outcome.examined:
                    write_difference(outcome, out / outcome.file.resolve().relative_to(top))
                if rewrite and outcome.examined:
                    update(outcome)
                outcome.examined = None
                outcomes.append(outcome)
                if tell:
                    tell(outcome)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    return outcomes + [Outcome(p, "skipped", message="no [expect] table") for p in skipped]


def write_difference(outcome, place):
    """place.png: expected and obtained; place.txt: the same as a table."""
    from forceaxis.experiments import plots

    place.parent.mkdir(parents=True, exist_ok=True)
    plots.comparison(outcome.examined).savefig(place.with_suffix(".png"), dpi=120)
    replace(place.with_suffix(".txt"), outcome.name + "\n" + comparison(outcome.checks) + "\n")


def comparison(checks):
    """Expected beside obtained, one row a key."""
    rows = [("", "expected", "obtained", "")]
    rows += [
        (c.key, shown(c.expected), shown(c.obtained), "" if c.passed else "differs") for c in checks
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    return "\n".join(
        "  ".join(f"{cell:{w}}" for cell, w in zip(row, [*widths, 0], strict=True)).rstrip()
        for row in rows
    )


def describe(outcome):
    """An outcome for a terminal: its line, and one below for each difference."""
    line = f"{outcome.status:7}  {outcome.name}"
    if outcome.status == "failed":
        line += "".join(f"\n           {text}" for text in outcome.lines)
    return line


def counts(outcomes):
    """How many ended how."""
    kinds = ("passed", "updated", "failed", "error", "skipped")
    return {kind: sum(o.status == kind for o in outcomes) for kind in kinds}


def status(outcomes):
    """The exit status: 2 bad input, 1 a difference, 0 neither."""
    ended = {o.status for o in outcomes}
    return 2 if "error" in ended else 1 if "failed" in ended else 0


def write_junit(outcomes, file):
    """The outcomes as JUnit XML, the form that CI servers read."""
    number = counts(outcomes)
    suite = ET.Element(
        "testsuite",
        name="forceaxis",
        tests=str(len(outcomes)),
        failures=str(number["failed"]),
        errors=str(number["error"]),
        skipped=str(number["skipped"]),
        time=f"{sum(o.seconds for o in outcomes):.3f}",
    )
    for outcome in outcomes:
        name = Path(outcome.name)
        case = ET.SubElement(
            suite,
            "testcase",
            classname=printable(".".join(name.parent.parts).lstrip("/.") or "forceaxis"),
            name=printable(name.stem),
            file=printable(outcome.name),
            time=f"{outcome.seconds:.3f}",
        )
        tag = {"failed": "failure", "error": "error", "skipped": "skipped"}.get(outcome.status)
        if tag:
            entry = ET.SubElement(case, tag, message=printable("; ".join(outcome.lines)))
            entry.text = printable(comparison(outcome.checks) if outcome.checks else "")
    suites = ET.Element("testsuites")
    suites.append(suite)
    ET.indent(suites)
    file.parent.mkdir(parents=True, exist_ok=True)
    replace(file, ET.tostring(suites, encoding="unicode", xml_declaration=True) + "\n")


def printable(text):
    """Without the characters that XML cannot hold."""
    return "".join(c if c.isprintable() or c in "\n\t" else "?" for c in text)
