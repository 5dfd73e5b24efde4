"""Experiments as regression tests: runs each file with a table [expect], and compares the results
with this table."""

import contextlib
import functools
import os
import time
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING

from forceaxis import paths, toml
from forceaxis._core import InputError, SimulationError
from forceaxis.experiments import expect, rewrite
from forceaxis.experiments.inputs import read_inputs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass
class RegressionOutcome:
    """The result of the test of one file. `status` is "passed", "failed", "error" (the file is
    wrong), "updated" (a new [expect] was written) or "skipped" (the file has no [expect])."""

    file: Path
    status: str
    seconds: float = 0.0  # duration of the test in s
    message: str = ""  # reason why the test could not run
    checks: list[expect.ExpectationCheck] = field(default_factory=list)
    # the run with its checks; None when no plot or update needs the run any longer
    examined: expect.Examined | None = None
    drawn: Path | None = None  # path of the plot of the differences

    @property
    def name(self) -> str:
        """The path of the file as all outputs show it."""
        return paths.display(self.file)

    @property
    def lines(self) -> list[str]:
        """The differences between expected and obtained values, one text line each."""
        return [str(c) for c in self.checks if not c.passed] or [self.message]

    @property
    def warnings(self) -> list[str]:
        """Warnings about values that pass but should be changed in the file, one text line each."""
        return [c.warning for c in self.checks if c.warning]

    def summary(self) -> "OutcomeSummary":
        """Returns the outcome in the form of the JSON output."""
        return OutcomeSummary(
            experiment=self.name,
            status=self.status,
            seconds=round(self.seconds, 3),
            message=self.message,
            warnings=self.warnings,
            checks=[
                CheckSummary(c.key, str(c.expected), c.obtained, c.passed) for c in self.checks
            ],
        )


@dataclass(frozen=True)
class CheckSummary:
    """An expected value and the value of the run, in the form of the JSON output."""

    key: str
    expected: str
    obtained: expect.Obtained
    passed: bool


@dataclass(frozen=True)
class OutcomeSummary:
    """The result of one test in the form of the JSON output."""

    experiment: str
    status: str
    seconds: float
    message: str
    warnings: list[str]
    checks: list[CheckSummary]


@dataclass(frozen=True)
class RegressionCounts:
    """Number of tests with each status."""

    passed: int
    updated: int
    failed: int
    error: int
    skipped: int


def is_test(file: Path) -> bool | None:
    """Returns True if a file is an experiment with a table [expect], False if it is an experiment
    without it, and None if it is not an experiment. A file that cannot be read counts as a test.
    The test then reports the error."""
    try:
        data = toml.read(file)
    except InputError:
        return True
    if "expect" in data:
        return True
    return False if {"model", "duration_s"} <= data.keys() else None


def find(
    targets: Sequence[str | Path], pattern: str | None = None
) -> tuple[list[Path], list[Path]]:
    """Returns (files with a table [expect], experiments without this table). `targets`: files and
    folders in which these are searched.

    `pattern`: pattern of the file name, with the wildcards * and ?. Raises InputError if no file
    has the table.
    """
    files: dict[Path, Path] = {}
    for target in map(Path, targets):
        if target.is_dir():
            below = (p for p in target.rglob("*.toml") if p.is_file())
            found = [
                p
                for p in below
                if not any(part.startswith(".") for part in p.relative_to(target).parts)
            ]
        elif target.exists():
            found = [target]
        else:
            raise InputError(
                f"{target}: expected a folder or an experiment file, got no such path; check the "
                "path"
            )
        files |= {p.resolve(): p for p in sorted(found)}
    if pattern:
        asked = f"*{pattern.lower()}*"
        files = {r: p for r, p in files.items() if fnmatch(paths.display(p).lower(), asked)}
    kinds = {p: is_test(p) for p in files.values()}
    tests = [p for p, kind in kinds.items() if kind]
    skipped = [p for p, kind in kinds.items() if kind is False]
    if not tests:
        where = ", ".join(map(str, targets)) + (f" with {pattern!r} in its name" if pattern else "")
        others = [paths.display(p) for p, kind in kinds.items() if kind is None]
        add = "add a table [expect] and run the test with `update`, which fills the table"
        if others and not skipped:
            add = f"{', '.join(others[:3])}: no experiments, because they have no duration_s"
        raise InputError(
            f"{where}: expected at least one experiment with a table [expect], got {len(skipped)} "
            f"experiments without this table; {add}"
        )
    return tests, skipped


def run_test(file: Path, update: bool = False) -> RegressionOutcome:
    """Runs the test of one file. An error in the file is an outcome, not an exception. `update`:
    True if the outcome also has to contain the run, in case [expect] has to be written again."""
    began = time.perf_counter()
    outcome = RegressionOutcome(file, "error")
    try:
        outcome.examined = expect.examine(file)
        outcome.checks = outcome.examined.checks
        if not outcome.checks:
            outcome.message = (
                f"{file}: expect: expected values to compare; run the test with `update`, which "
                "fills the table"
            )
        elif outcome.examined.differences:
            outcome.status = "failed"
        else:
            outcome.status = "passed"
            if not (update and (rewrite.bare(outcome.checks) or outcome.warnings)):
                outcome.examined = None
    except SimulationError as error:
        outcome.status, outcome.message = "failed", str(error)
    except InputError as error:
        outcome.message = str(error)
    except OSError as error:
        outcome.message = f"{file}: expected a readable file, got: {error.strerror}"
    outcome.message = " ".join(outcome.message.split())
    outcome.seconds = time.perf_counter() - began
    return outcome


def write_update(outcome: RegressionOutcome, examined: expect.Examined) -> None:
    """Writes the values of the run into the table [expect] of the file, and compares again. Limits
    do not change, so the test can still fail."""
    file = outcome.file
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            text = stream.read()
        mark = "\ufeff" if text.startswith("\ufeff") else ""
        new = mark + rewrite.rewritten(file, text.removeprefix("\ufeff"), examined)
        if new != text:
            paths.replace_text(file, new)
        elif outcome.status == "passed":
            return
        inputs = read_inputs(file)
        expected = expect.read(file, inputs.expect or {}, inputs.criterion is not None)
    except InputError as error:
        outcome.status, outcome.message = "error", str(error)
        return
    except OSError as error:
        outcome.status = "error"
        outcome.message = f"{file}: expected a file that can be written, got: {error.strerror}"
        return
    outcome.checks = [
        expect.ExpectationCheck(k, v, examined.measured.values[k])
        for k, v in expected.wanted.items()
    ] + [c for c in examined.checks if c.agrees is not None]
    outcome.status = "updated" if all(c.passed for c in outcome.checks) else "failed"
    outcome.message = ""


def run(
    targets: Sequence[str | Path],
    update: bool = False,
    out: Path | None = None,
    threads: int | None = None,
    pattern: str | None = None,
    report: Callable[[RegressionOutcome], None] | None = None,
) -> list[RegressionOutcome]:
    """Runs all tests in the files and folders `targets`, in parallel. Returns the outcomes in the
    order of the file names.

    update: True to write the values of the run into [expect] if they differ. out: folder for a plot
    and a table of each difference. pattern: pattern of the file name, with the wildcards * and ?.
    report: function that receives each outcome, in order, as soon as it is known. Raises InputError
    if there is no test.
    """
    tests, skipped = find(targets, pattern)
    fresh = out is not None and not out.exists()
    if out:
        out.mkdir(parents=True, exist_ok=True)
    top = Path(os.path.commonpath([p.resolve().parent for p in tests]))
    outcomes = []
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        try:
            for outcome in pool.map(functools.partial(run_test, update=update), tests):
                if out and outcome.status == "failed" and outcome.examined:
                    place = out / outcome.file.resolve().relative_to(top)
                    outcome.drawn = write_difference(outcome, outcome.examined, place)
                if update and outcome.examined:
                    write_update(outcome, outcome.examined)
                outcome.examined = None
                outcomes.append(outcome)
                if report:
                    report(outcome)
        except KeyboardInterrupt:
            if out and fresh:
                with contextlib.suppress(OSError):
                    out.rmdir()  # rmdir() fails if the folder contains files about a difference
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    return outcomes + [
        RegressionOutcome(p, "skipped", message="no [expect] table") for p in skipped
    ]


def write_difference(outcome: RegressionOutcome, examined: expect.Examined, place: Path) -> Path:
    """Writes files about a difference to the folder `place`: a plot of expected and obtained values
    (.png, .svg), a table of these values (.txt), and the trace (.npz). Returns the path of the .png
    file."""
    import numpy as np

    from forceaxis import drawing

    drawn = figure(examined)
    names = [place.with_suffix(suffix).name for suffix in (".png", ".svg", ".txt", ".npz")]
    with paths.replacing(place.parent, *names) as (png, svg, text, trace):
        drawing.save(drawn, png, "png")
        drawing.save(drawn, svg, "svg")
        text.write_text(f"{outcome.name}\n{expect.table(outcome.checks)}\n", encoding="utf-8")
        with trace.open("wb") as file:
            np.savez_compressed(file, **examined.run.columns)  # type: ignore[arg-type]
    return place.with_suffix(".png")


def figure(examined: expect.Examined) -> "Figure":
    """Returns a plot of the trace with the expected peak force, final value and settling time."""
    from forceaxis.experiments import plots

    measured, wanted = examined.measured, examined.expect.wanted
    columns, time_s = examined.run.columns, examined.run.time_s
    forces = [f"{name}.force" for name in examined.run.contacts]
    names = [[measured.signal]]
    if "peak_force_N" in wanted and forces != names[0]:
        names.append(forces)
    levels = [
        plots.ExpectedLevel(row, key, start, level.low, level.high, value)
        for row, key, start in (
            (0, "final_value", time_s[-1] - measured.final_s),
            (len(names) - 1, "peak_force_N", time_s[0]),
        )
        if isinstance(level := wanted.get(key), expect.Number)
        and isinstance(value := measured.values[key], float)
    ]
    settling, due, got = None, wanted.get("settle_s"), measured.values["settle_s"]
    if due is not None:
        settling = plots.Settling(
            measured.from_s,
            [measured.final - measured.width, measured.final + measured.width],
            (due.low, due.high) if isinstance(due, expect.Number) else None,
            got if isinstance(got, float) else None,
        )
    rows = [{name: columns[name] for name in row} for row in names]
    text = expect.table(examined.checks)
    return plots.comparison(time_s, rows, levels, settling, text, examined.run.title)


def counts(outcomes: Sequence[RegressionOutcome]) -> RegressionCounts:
    """Returns the number of outcomes with each status."""
    numbers = Counter(o.status for o in outcomes)
    return RegressionCounts(**{kind.name: numbers[kind.name] for kind in fields(RegressionCounts)})


def status(outcomes: Sequence[RegressionOutcome]) -> int:
    """Returns the exit status: 2 for a wrong file, 1 for a difference, otherwise 0."""
    ended = {o.status for o in outcomes}
    return 2 if "error" in ended else 1 if "failed" in ended else 0


def write_junit(outcomes: Sequence[RegressionOutcome], file: Path) -> None:
    """Writes the outcomes as JUnit XML, a format that CI servers read."""
    number = counts(outcomes)
    suite = ET.Element(
        "testsuite",
        name="forceaxis",
        tests=str(len(outcomes)),
        failures=str(number.failed),
        errors=str(number.error),
        skipped=str(number.skipped),
        time=f"{sum(o.seconds for o in outcomes):.3f}",
    )
    for outcome in outcomes:
        name = Path(outcome.name)
        case = ET.SubElement(
            suite,
            "testcase",
            classname=xml_printable(".".join(name.parent.parts).lstrip("/.") or "forceaxis"),
            name=xml_printable(name.stem),
            file=xml_printable(outcome.name),
            time=f"{outcome.seconds:.3f}",
        )
        tag = {"failed": "failure", "error": "error", "skipped": "skipped"}.get(outcome.status)
        if tag:
            entry = ET.SubElement(case, tag, message=xml_printable("; ".join(outcome.lines)))
            entry.text = xml_printable(expect.table(outcome.checks) if outcome.checks else "")
        if outcome.warnings:
            ET.SubElement(case, "system-out").text = xml_printable("\n".join(outcome.warnings))
    suites = ET.Element("testsuites")
    suites.append(suite)
    ET.indent(suites)
    file.parent.mkdir(parents=True, exist_ok=True)
    paths.replace_text(file, ET.tostring(suites, encoding="unicode", xml_declaration=True) + "\n")


def xml_printable(text: str) -> str:
    """Returns the text without those characters that XML does not permit."""
    return "".join(c if c.isprintable() or c in "\n\t" else "?" for c in text)
