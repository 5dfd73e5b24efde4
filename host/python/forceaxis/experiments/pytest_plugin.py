"""Plugin of pytest: a fixture that runs an experiment, and a test for each experiment with a table
[expect].

    def test_axis(forceaxis_experiment):
        forceaxis_experiment("contact.toml").check()

The path is relative to the file of the test. Further arguments are overrides, such as
"firmware.force_gain=7". For other assertions, the returned object has `.run.columns` (the trace),
`.run.summary` and `.measured.values`. With these lines in pyproject.toml,

    [tool.pytest.ini_options]
    forceaxis_experiments = ["axes"]

pytest runs every *.toml file below these folders that has a table [expect] as a test.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from _pytest._code.code import TerminalRepr, TracebackStyle

    from forceaxis.experiments.expect import ExpectationCheck, Measured
    from forceaxis.experiments.run import Run


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addini(
        "forceaxis_experiments",
        "folders in which every *.toml file with a table [expect] is a test; the page "
        "Experiments of the reference describes the table; in a function, the fixture "
        'forceaxis_experiment runs an experiment: forceaxis_experiment("contact.toml").check()',
        type="paths",
        default=[],
    )


def pytest_configure(config: pytest.Config) -> None:
    """Adds the folders of forceaxis_experiments to those that pytest searches if it has no
    arguments."""
    if config.args_source == config.ArgsSource.TESTPATHS:
        config.args += [str(p) for p in config.getini("forceaxis_experiments")]


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> "ExperimentFile | None":
    folders = parent.config.getini("forceaxis_experiments")
    if file_path.suffix != ".toml" or not any(file_path.is_relative_to(f) for f in folders):
        return None
    from forceaxis.experiments import regression

    if not regression.is_test(file_path):
        return None
    return ExperimentFile.from_parent(parent, path=file_path)


class ExperimentFile(pytest.File):
    """The file of an experiment with a table [expect]. Each such file is one test."""

    def collect(self) -> "Iterator[ExperimentItem]":
        yield ExperimentItem.from_parent(self, name="expect")


class ExperimentItem(pytest.Item):
    """The test of an experiment file. It runs the experiment and compares the result with
    [expect]."""

    def runtest(self) -> None:
        CheckedExperiment(self.path).check()

    def repr_failure(
        self,
        excinfo: pytest.ExceptionInfo[BaseException],
        style: "TracebackStyle | None" = None,
    ) -> "str | TerminalRepr":
        from forceaxis._core import InputError, SimulationError

        if excinfo.errisinstance((AssertionError, InputError, SimulationError)):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        return self.path, None, self.path.name


class CheckedExperiment:
    """A finished run, and the comparison with the table [expect] of the experiment."""

    def __init__(self, file: Path, overrides: tuple[str, ...] = ()) -> None:
        from forceaxis.experiments import expect

        examined = expect.examine(file, overrides)
        self.file = file
        self.run: Run = examined.run
        self.measured: Measured = examined.measured
        self.checks: list[ExpectationCheck] = examined.checks

    def check(self) -> None:
        """Raises AssertionError with one text line for each value that differs from [expect].
        Raises InputError if [expect] has no values."""
        __tracebackhide__ = True
        from forceaxis._core import InputError

        if not self.checks:
            raise InputError(
                f"{self.file}: expect: expected a table [expect] with at least one value; to fill "
                "this table, run the test with `update`"
            )
        lines = [str(check) for check in self.checks if not check.passed]
        if lines:
            head = f"{self.file}: the run differs from its table [expect]:"
            raise AssertionError("\n  ".join([head, *lines]))


@pytest.fixture
def forceaxis_experiment(request: pytest.FixtureRequest) -> Callable[..., CheckedExperiment]:
    """Returns a function that runs an experiment and returns a CheckedExperiment. Its argument is
    the path of the experiment relative to the test file: forceaxis_experiment(path).check()."""

    def run(path: str | Path, *overrides: str) -> CheckedExperiment:
        return CheckedExperiment(Path(request.path).parent / path, overrides)

    return run
