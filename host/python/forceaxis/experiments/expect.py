"""The table [expect] of an experiment. Reads the table, and compares the expected values with a
run.

FORMAT defines the keys of the table; docs/guide/reference/experiment.md is generated from FORMAT.
"""

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, TypeAlias

import numpy as np

from forceaxis import _core, objects, toml
from forceaxis._core import InputError
from forceaxis.experiments import run as runs
from forceaxis.experiments.inputs import ExpectTable, read_inputs
from forceaxis.experiments.run_result import RunResult
from forceaxis.experiments.verdicts import NOT_STABLE, VERDICTS
from forceaxis.linear import posterior
from forceaxis.toml import TomlValue

HELD_FORCE_KEYS = ("held_force_N", "held_force_error_percent")
LARGEST_NUMBER = 1e18


@dataclass(frozen=True)
class Tolerance:
    """Largest permitted difference from an expected number. `tolerance` is in the unit of the
    number, and `relative` is a fraction of the magnitude of the number."""

    tolerance: float = 0.0
    relative: float = 0.0

    def of(self, value: float) -> float:
        """Returns the tolerance of a value, in the unit of this value."""
        return self.tolerance + self.relative * abs(value)


@dataclass(frozen=True)
class FormatKey:
    """Description of a key of a table for docs/guide/reference."""

    key: str
    form: str
    default: str
    meaning: str
    unit: str = ""
    range: str = ""
    required: bool = False


@dataclass(frozen=True)
class ResultKey(FormatKey):
    """A key of [expect] whose value is compared with a result of the run.

    `texts`: permitted texts of a key whose value is a text; empty permits any text. `tolerance`:
    tolerance of a number if [expect] gives none, and None for a text. `low`: smallest number that
    the result can be. `no_number`: text of the result of a run that has no such number."""

    texts: tuple[str, ...] = ()
    tolerance: Tolerance | None = None
    low: float = 0.0
    no_number: str = ""


@dataclass(frozen=True)
class FormatTable:
    """Description of a table of an experiment and of its keys, for docs/guide/reference."""

    path: str
    header: str
    meaning: str
    keys: tuple[FormatKey, ...]
    when: str = ""  # condition under which the table has these keys


def _number(
    key: str,
    tolerance: Tolerance,
    meaning: str,
    unit: str = "",
    low: float = 0.0,
    no_number: str = "",
) -> ResultKey:
    """Returns the description of a key whose value is a number. `meaning` is a sentence without the
    full stop."""
    allowed = (
        f"{100 * tolerance.relative:g} %"
        if tolerance.relative
        else f"{tolerance.tolerance:g} {unit}".rstrip()
    )
    return ResultKey(
        key,
        f'number, {{ ... }} or "{no_number}"' if no_number else "number or { ... }",
        "not compared",
        f"{meaning}; tolerance {allowed}.",
        unit,
        ">= 0" if low == 0 else "",
        tolerance=tolerance,
        low=low,
        no_number=no_number,
    )


def _text(key: str, form: str, meaning: str, texts: tuple[str, ...] = ()) -> ResultKey:
    return ResultKey(key, form, "not compared", meaning, texts=texts)


# Results of a run that [expect] can name.
RESULTS = (
    _text(
        "verdict",
        ", ".join(VERDICTS),
        "Verdict of the run. `unstable` also accepts `not_met` and `never_in_contact`, with a "
        "warning.",
        tuple(VERDICTS),
    ),
    _text(
        "fault",
        "fault or none",
        "First fault that the firmware has latched.",
        tuple(objects.BY_NAME["fault"].enum),
    ),
    _text(
        "cycle",
        "good, bad, aborted, or another value of cycle_state",
        "State of the part at the end of the run, for an experiment with the program of a cycle.",
        tuple(objects.BY_NAME["cycle_state"].enum),
    ),
    _text("trace_hash", "64 hex digits", "Hash of all codes in all ticks."),
    _number(
        "peak_force_N",
        Tolerance(relative=0.01),
        "Largest force of all contacts in the run",
        "N",
    ),
    _number(
        "final_value",
        Tolerance(relative=0.01),
        "Mean of `signal` over the last `final_s` seconds",
        low=-LARGEST_NUMBER,
    ),
    _number(
        "settle_s",
        Tolerance(0.01),
        "Time from `from_s` until `signal` stays within the band around its final value",
        "s",
        no_number="never",
    ),
    _number(
        "overshoot",
        Tolerance(0.01),
        "Largest excess of `signal` over its final value, as a fraction of the step from the value "
        "at `from_s` to the final value",
        no_number="undefined",
    ),
    _number(
        "held_force_N",
        Tolerance(relative=0.01),
        "Mean of the force measured by ADC 0 over the window of [verdict]",
        "N",
        low=-LARGEST_NUMBER,
    ),
    _number(
        "held_force_error_percent",
        Tolerance(0.1),
        "Difference of `held_force_N` and the set-point at the end of the run, in per cent of the "
        "set-point",
        "percentage points",
    ),
)
RESULT = {row.key: row for row in RESULTS}
# Tolerances of numbers for which [expect] gives no tolerance.
TOLERANCES = {row.key: row.tolerance for row in RESULTS if row.tolerance is not None}
# Keys that define the evaluation of `signal`, and the recordings that are compared.
EVALUATION = (
    FormatKey(
        "signal",
        "column of the trace",
        "force of the first contact, else encoder",
        "Column of which final_value, settle_s and overshoot are computed.",
    ),
    FormatKey(
        "from_s",
        "number",
        "0",
        "Start of the evaluation of `signal`, for instance the time of a disturbance.",
        "s",
        ">= 0",
    ),
    FormatKey(
        "final_s",
        "number",
        "a tenth of what follows from_s",
        "Duration at the end of the run over which the mean gives the final value.",
        "s",
        ">= 0",
    ),
    FormatKey(
        "recording",
        "file name or list of file names",
        "none",
        "Imported recordings of the real machine, relative to this file. Each is compared "
        "with the predicted signals, and the test fails if a figure is outside its band.",
    ),
    FormatKey(
        "recording_over",
        "list of texts",
        "none",
        'Uncertainty of parameters for these bands: ["k_w=10%", "b_w=5..20"], '
        'or ["posterior.json"], relative to this file.',
    ),
    FormatKey(
        "band",
        "number or { absolute = ... }",
        "0.05",
        "Half the settling band: a fraction of the step, or absolute in the unit of `signal`.",
        "",
        ">= 0",
    ),
)
FORMAT = (
    FormatTable(
        path="expect",
        header="[expect]",
        meaning="Expected results of the run, which a test compares with the run. A "
        "number without a table has the tolerance that the meaning of its key names. A "
        "`final_value` below 1e-9 of the largest value of `signal` counts as 0.",
        keys=(*RESULTS, *EVALUATION),
    ),
    FormatTable(
        path="expect.KEY",
        header="[expect] KEY = { ... }",
        meaning="A number with its tolerance, `{ value = 69.7, tolerance = 0.5 }`, or with one or "
        "two limits, `{ min = 60, max = 80 }`.",
        keys=(
            FormatKey("value", "number", "min or max", "Expected value."),
            FormatKey(
                "tolerance",
                "number",
                "as above",
                "Largest permitted difference from `value`.",
                "",
                ">= 0",
            ),
            FormatKey(
                "relative",
                "number",
                "as above",
                "Largest permitted difference as a fraction of `value`.",
                "",
                ">= 0",
            ),
            FormatKey("min", "number", "no limit", "Smallest permitted value."),
            FormatKey("max", "number", "no limit", "Largest permitted value."),
        ),
    ),
)
KEYS, NUMBER_KEYS = ([key.key for key in table.keys] for table in FORMAT)


@dataclass(frozen=True)
class Number:
    """An expected number: its range low .. high. `value` is None if the table gives only limits of
    the number."""

    low: float
    high: float
    value: float | None = None

    @classmethod
    def around(cls, value: float, allowed: Tolerance) -> "Number":
        """Returns the range of a value: the value plus and minus the tolerance."""
        width = allowed.of(value)
        return cls(value - width, value + width, value)

    def __str__(self) -> str:
        if self.value is None:
            low = f"at least {self.low:.6g}" if math.isfinite(self.low) else ""
            high = f"at most {self.high:.6g}" if math.isfinite(self.high) else ""
            return " and ".join(filter(None, (low, high)))
        return f"{self.value:.6g} +-{self.high - self.value:.3g}"


@dataclass(frozen=True)
class NumberTable:
    """The keys of an expected number that [expect] gives as a table. A field is None if the table
    does not have the key."""

    value: float | None = None
    tolerance: float | None = None
    relative: float | None = None
    min: float | None = None
    max: float | None = None


Expected: TypeAlias = str | Number
# value of the run that is compared; None if the run does not have this value
Obtained: TypeAlias = str | float | None


@dataclass(frozen=True)
class Expectation:
    """A checked table [expect]: the expected values, and how `signal` is evaluated."""

    wanted: dict[str, Expected]  # {key of [expect]: expected value}
    # column of the trace; None: force of the first contact, or the encoder without a contact
    signal: str | None
    from_s: float
    # duration in s of the mean for the final value; None: a tenth of the time after from_s
    final_s: float | None
    band: float  # half of the width of the settling band
    # True if the settling band is in the unit of `signal`; False if it is a fraction of the step
    band_is_absolute: bool
    recordings: tuple[Path, ...] = ()  # files with recordings of the real machine
    # uncertainty of parameters for the bands of the recordings
    recording_over: tuple[str, ...] = ()


@dataclass(frozen=True)
class Measured:
    """The values of a run for the keys of [expect], and the settings with which they were
    computed."""

    values: dict[str, Obtained]
    signal: str  # evaluated column of the trace
    from_s: float  # time in s at which the evaluation starts
    final_s: float  # duration in s of the mean at the end of the run
    final: float  # final value of the evaluated column
    # half width of the settling band, which extends from final - width to final + width
    width: float


@dataclass(frozen=True)
class ExpectationCheck:
    """An expected value of [expect], and the value of the run."""

    key: str
    expected: Expected
    obtained: Obtained
    unit: str = ""  # unit of the obtained number
    why: str = ""  # reason for the verdict of the run
    # for a value from a recording: True if it agrees with the prediction
    agrees: bool | None = None

    @property
    def passed(self) -> bool:
        """True if the obtained value agrees with the expected value."""
        if isinstance(self.expected, Number) and isinstance(self.obtained, float):
            return self.expected.low <= self.obtained <= self.expected.high
        if self.agrees is not None:
            return self.agrees
        return self.expected == self.obtained or bool(self.warning)

    @property
    def warning(self) -> str:
        """A warning if the expected verdict was written by an earlier version, which had only two
        verdicts. Otherwise an empty text."""
        matches = self.expected == "unstable" and self.obtained in NOT_STABLE[1:]
        if self.key != "verdict" or not matches:
            return ""
        return (
            f"verdict: expected unstable, got {self.obtained} ({self.why}); this passes, because "
            "earlier versions had only the verdicts stable and unstable; write "
            f"{self.obtained}, or run the test with `update`"
        )

    @property
    def difference(self) -> str:
        """Returns a text about the difference of the obtained value from the expected value or
        limit."""
        if not (isinstance(self.expected, Number) and isinstance(self.obtained, float)):
            return self.why
        due = self.expected.value
        if due is None:
            due = self.expected.low if self.obtained < self.expected.low else self.expected.high
        off = self.obtained - due
        text = f"{abs(off):.3g} {self.unit}".rstrip() + (" above" if off > 0 else " below")
        return text + (f", {abs(off / due):.1%}" if due else "")

    def __str__(self) -> str:
        text = f"{self.key}: expected {shown(self.expected)}, got {shown(self.obtained)}"
        if self.passed or not self.difference:
            return text
        return f"{text} ({self.difference})"


@dataclass(frozen=True)
class Examined:
    """A finished run and the checks of the table [expect]. Without the table, `checks` is empty."""

    run: runs.Run
    expect: Expectation
    measured: Measured
    checks: list[ExpectationCheck]

    @property
    def differences(self) -> list[ExpectationCheck]:
        """The checks that have failed."""
        return [c for c in self.checks if not c.passed]


def shown(value: Expected | Obtained) -> str:
    """Returns a value as text. A number has six digits, and a long text is shortened."""
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) < 64 else text[:16] + "..."


class Reader:
    """Checks the keys of one table [expect]. Error messages contain the file name `file`."""

    def __init__(self, file: str | Path) -> None:
        self.file = file

    def fail(self, key: str, message: str) -> NoReturn:
        """Raises InputError with the file, the key `key` and the text `message`."""
        raise InputError(f"{self.file}: expect{key and '.'}{key}: {message}")

    def number(self, key: str, value: TomlValue, low: float = -LARGEST_NUMBER) -> float:
        """Returns a plain number of at least `low`."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(key, "expected a number")
        if not low <= value <= LARGEST_NUMBER:  # false for NaN too
            self.fail(key, f"expected a number from {low:g} to {LARGEST_NUMBER:g}, got {value:g}")
        return float(value)

    def wanted(self, key: str, value: TomlValue) -> Expected:
        """Returns the expectation of a number: a Number, or a text which states that the number
        does not exist."""
        low, no_number = RESULT[key].low, RESULT[key].no_number
        if isinstance(value, str) and no_number:
            if value != no_number:
                self.fail(key, f'expected a number or "{no_number}", got "{value}"')
            return value
        if not isinstance(value, dict):
            expected = self.number(key, value, low)
            return Number.around(expected, TOLERANCES[key])
        toml.expect_keys(value, NUMBER_KEYS, lambda name, text: self.fail(f"{key}.{name}", text))
        given = NumberTable(**{n: self.number(f"{key}.{n}", v) for n, v in value.items()})
        if given.min is not None or given.max is not None:
            return self.limits(key, given, low)
        if given.value is None:
            self.fail(key, "expected one of the keys value, min or max; add value = ...")
        expected = self.number(f"{key}.value", given.value, low)
        if given.tolerance is not None and given.relative is not None:
            self.fail(key, "expected either tolerance or relative, got both keys")
        if given.relative is not None:
            if expected == 0:
                self.fail(
                    f"{key}.relative",
                    "expected `tolerance` instead, because a fraction of the value 0 is 0",
                )
            relative = self.number(f"{key}.relative", given.relative, 0.0)
            return Number.around(expected, Tolerance(relative=relative))
        if given.tolerance is not None:
            tolerance = self.number(f"{key}.tolerance", given.tolerance, 0.0)
            return Number.around(expected, Tolerance(tolerance))
        return Number.around(expected, TOLERANCES[key])

    def limits(self, key: str, given: NumberTable, low: float) -> Number:
        """Returns the Number that the keys `min` and `max` define."""
        if (given.value, given.tolerance, given.relative) != (None, None, None):
            self.fail(
                key, "expected either min and max, or value with tolerance, got keys of both kinds"
            )
        limits = Number(
            -math.inf if given.min is None else given.min,
            math.inf if given.max is None else given.max,
        )
        if limits.low > limits.high:
            self.fail(
                key, f"expected min below max, got min {limits.low:g} and max {limits.high:g}"
            )
        if limits.high < low:
            self.fail(
                f"{key}.max", f"expected at least {low:g}, because {key} is never below this value"
            )
        return limits


def read(file: str | Path, table: ExpectTable, has_verdict: bool) -> Expectation:
    """Returns the Expectation for a table [expect]. `has_verdict`: True if the experiment has a
    table [verdict]. Raises InputError."""
    reader = Reader(file)
    toml.expect_keys(table, KEYS, reader.fail)
    _check_texts(reader, table, has_verdict)
    band, absolute = table.get("band", 0.05), False
    if isinstance(band, dict):
        if list(band) != ["absolute"]:
            reader.fail("band", "expected a fraction of the step, or { absolute = ... }")
        band, absolute = band["absolute"], True
    final_s = table.get("final_s")
    return Expectation(
        wanted={
            key: reader.wanted(key, value) if key in TOLERANCES else value
            for key, value in table.items()
            if key in RESULT
        },
        signal=table.get("signal"),
        from_s=reader.number("from_s", table.get("from_s", 0), 0.0),
        final_s=None if final_s is None else reader.number("final_s", final_s, 0.0),
        band=reader.number("band", band, 0.0),
        band_is_absolute=absolute,
        recordings=tuple(Path(file).parent / name for name in _texts(reader, table, "recording")),
        recording_over=tuple(
            str(Path(file).parent / part) if posterior.is_posterior(part) else part
            for text in _texts(reader, table, "recording_over")
            for part in text.split(",")
        ),
    )


def _texts(reader: Reader, table: ExpectTable, key: str) -> tuple[str, ...]:
    """Returns the texts of a key whose value is a text or a list of texts. Raises InputError."""
    if key not in table:
        return ()
    texts = table[key] if isinstance(table[key], list) else [table[key]]
    if not (texts and all(isinstance(text, str) and text for text in texts)):
        reader.fail(key, "expected a text or a list of texts")
    return tuple(texts)


def _check_texts(reader: Reader, table: ExpectTable, has_verdict: bool) -> None:
    """Checks the keys whose values are texts. `has_verdict`: True if the experiment has a table
    [verdict]. Raises InputError."""
    for row in RESULTS:
        given = table.get(row.key)
        if given is not None and row.texts and given not in row.texts:
            meant = difflib.get_close_matches(str(given), row.texts, 1)
            hint = f"; did you mean {meant[0]}?" if meant else ""
            reader.fail(row.key, f"expected one of {', '.join(row.texts)}, got {given!r}{hint}")
    if "verdict" in table and not has_verdict:
        reader.fail(
            "verdict", "expected a table [verdict] with the limits of a stable run; add this table"
        )
    text = table.get("trace_hash", "0" * 64)
    if not (isinstance(text, str) and len(text) == 64 and set(text) <= set("0123456789abcdef")):
        reader.fail("trace_hash", "expected 64 hexadecimal digits, as a run prints them")
    if not isinstance(table.get("signal", ""), str):
        reader.fail("signal", "expected the name of a column of the trace")


def measure(done: runs.Run, expect: Expectation) -> Measured:
    """Returns the values of a run, as FORMAT defines them. Raises InputError if [expect] does not
    apply to the run."""
    reader, result, contacts = Reader(done.experiment), done.result, done.contacts
    rate = _core.TICKS_PER_SECOND
    signal = expect.signal or (f"{contacts[0]}.force" if contacts else "encoder")
    if signal not in done.columns:
        reader.fail(
            "signal", f"expected a column of the trace ({', '.join(done.columns)}), got {signal!r}"
        )
    if "peak_force_N" in expect.wanted and not contacts:
        reader.fail(
            "peak_force_N",
            "expected a model with a contact, got a model without contacts; remove this key",
        )
    held = result.metrics.held_force
    if asked := [key for key in HELD_FORCE_KEYS if key in expect.wanted and not held]:
        reader.fail(
            min(asked),
            "expected an experiment that controls a force, got another experiment; remove this key",
        )
    first = math.ceil(expect.from_s * rate - 1e-9)
    values = done.columns[signal][first:].astype(float)
    if len(values) < 2:
        reader.fail("from_s", f"expected a time before the end of the run, {done.time_s[-1]:g} s")
    lasts_s = (len(values) - 1) / rate
    final_s = lasts_s / 10 if expect.final_s is None else expect.final_s
    if final_s > lasts_s + 1e-9:
        reader.fail(
            "final_s",
            f"expected at most {lasts_s:g} s, the time from from_s to the end of the run, got "
            f"{final_s:g} s",
        )
    window = math.floor(final_s * rate + 1e-9) + 1
    final, start = float(values[-window:].mean()), float(values[0])
    largest = float(np.abs(values).max())
    # A final value that is only a rounding error becomes 0.
    if abs(final) < 1e-9 * largest:
        final = 0.0
    step, rounding = final - start, 1e-12 * largest
    width = expect.band if expect.band_is_absolute else expect.band * abs(step)
    outside = np.flatnonzero(np.abs(values - final) > width + rounding)
    last = int(outside[-1]) if len(outside) else -1
    settled = last < len(values) - window
    beyond = float((math.copysign(1, step) * (values - final)).max())
    got: dict[str, Obtained] = {
        "verdict": result.verdict,
        "cycle": result.cycle.state if result.cycle else None,
        "fault": result.fault,
        "peak_force_N": result.metrics.peak_force_N if contacts else None,
        "final_value": final,
        "held_force_N": held.held_N if held else None,
        "held_force_error_percent": held.error_percent if held else None,
        "settle_s": (last + 1) / rate if settled else "never",
        "overshoot": max(0.0, beyond) / abs(step) if abs(step) > rounding else "undefined",
        "trace_hash": result.trace_hash,
    }
    return Measured(got, signal, expect.from_s, final_s, final, width)


def examine(file: str | Path, overrides: Sequence[str] = ()) -> Examined:
    """Runs one experiment and compares the result with the table [expect]. Raises InputError,
    SimulationError."""
    file = Path(file)
    inputs = read_inputs(file, overrides)
    # The table is read before the run, so that an error in the table is reported before the run.
    expect = read(file, inputs.expect or {}, inputs.criterion is not None)
    done = runs.run(file, overrides)
    measured = measure(done, expect)
    checks = [
        ExpectationCheck(
            key,
            value,
            measured.values[key],
            unit_of(key, measured.signal, done),
            why(key, done.result),
        )
        for key, value in expect.wanted.items()
    ]
    checks += recording_checks(file, expect, overrides)
    return Examined(done, expect, measured, checks)


def recording_checks(
    file: Path, expect: Expectation, overrides: Sequence[str] = ()
) -> list[ExpectationCheck]:
    """Returns one check for each characteristic value of the recordings that [expect] names. Raises
    InputError, SimulationError."""
    if not expect.recordings:
        return []
    # These modules load much code that a test without recordings does not need.
    from forceaxis.experiments import compare
    from forceaxis.experiments.prediction import PredictionRequest

    request = PredictionRequest(file, expect.recording_over, overrides)
    checks = []
    for path in expect.recordings:
        for figure in compare.compare(request, path).result.figures:
            is_number = figure.low is not None and figure.high is not None
            checks.append(
                ExpectationCheck(
                    f"{path.name}: {figure.figure}",
                    Number(figure.low or 0.0, figure.high or 0.0) if is_number else "never",
                    "never" if figure.measured is None else figure.measured,
                    figure.unit,
                    agrees=figure.agrees,
                )
            )
    return checks


# Units of the columns of the trace that contain codes.
CODES = {"encoder": "encoder count", "dac": "DAC code", "adc0": "ADC code", "adc1": "ADC code"}


def unit_of(key: str, signal: str, done: runs.Run) -> str:
    """Returns the unit of the number for the key `key` of [expect]. The key final_value has the
    unit of `signal`."""
    if key != "final_value":
        return RESULT[key].unit
    if signal in done.units:
        return str(objects.unit_in_words(objects.BY_NAME[signal]))
    return CODES.get(signal) or done.signal_units.get(signal, "")


def why(key: str, result: RunResult) -> str:
    """Returns the reason for the verdict of a run if `key` is "verdict". Returns an empty text for
    another key."""
    return ", ".join(result.because) if key == "verdict" else ""


def table(checks: Sequence[ExpectationCheck]) -> str:
    """Returns a table with the expected and obtained values as text. It has one row for each
    key."""
    rows = [("", "expected", "obtained", "")]
    for c in checks:
        differs = (
            "" if c.passed else " ".join(["differs", f"({c.difference})" * bool(c.difference)])
        )
        rows.append((c.key, shown(c.expected), shown(c.obtained), differs))
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    return "\n".join(
        "  ".join(f"{cell:{w}}" for cell, w in zip(row, [*widths, 0], strict=True)).rstrip()
        for row in rows
    )
