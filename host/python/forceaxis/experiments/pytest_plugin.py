"""pytest: a fixture that runs an experiment, and experiments with [expect] as test items.

    def test_axis(forceaxis_experiment):
        forceaxis_experiment("contact.toml").check()

The path is relative to the test's file. The returned object also has `.run.columns` (the trace),
`.run.summary` and `.measured.values` for further assertions; further arguments are overrides,
"firmware.force_gain=7". With

    [tool.pytest.ini_options]
    forceaxis_experiments = ["axes"]

pytest runs every *.toml with an [expect] table below these folders as a test.
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
        "folders in which every *.toml with an [expect] table is a test (forceaxis test --help); "
        "in a test, the fixture forceaxis_experiment runs one: "
        'forceaxis_experiment("contact.toml").check()',
        type="paths",
        default=[],
    )


def pytest_configure(config: pytest.Config) -> None:
    """Adds the folders to the arguments of a plain `pytest`, even if testpaths does not name
    them."""
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
    """The file of an experiment with [expect]; it has one test item."""

    def collect(self) -> "Iterator[ExperimentItem]":
        yield ExperimentItem.from_parent(self, name="expect")


class ExperimentItem(pytest.Item):
    """The test item: runs the experiment and compares the result with [expect]."""

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
    """A finished run: `run` (summary, columns, events), `measured` and `checks` of its [expect]."""

    def __init__(self, file: Path, overrides: tuple[str, ...] = ()) -> None:
        from forceaxis.experiments import expect

        self.file = file
        self._examined = expect.examine(file, overrides)

    @property
    def run(self) -> "Run":
        return self._examined.run

    @property
    def measured(self) -> "Measured":
        return self._examined.measured

    @property
    def checks(self) -> "list[ExpectationCheck]":
        return self._examined.checks

    def check(self) -> None:
        """Fails with a line for each value that differs from [expect]."""
        __tracebackhide__ = True
        from forceaxis._core import InputError

        if not self.checks:
            raise InputError(
                f"{self.file}: expect: expected something to compare; add [expect] and run "
                "`forceaxis test --update`"
            )
        lines = [str(c) for c in self._examined.differences]
        if lines:
            raise AssertionError("\n  ".join([f"{self.file} is not as its [expect] says:", *lines]))


@pytest.fixture
def forceaxis_experiment(request: pytest.FixtureRequest) -> Callable[..., CheckedExperiment]:
    """Runs an experiment; its path is relative to the test's file:
    forceaxis_experiment(path).check()."""

    def run(path: str | Path, *overrides: str) -> CheckedExperiment:
        return CheckedExperiment(Path(request.path).parent / path, overrides)

    return run
