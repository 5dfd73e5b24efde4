"""Result of a sweep: numbers of points, failures, and columns with one row for each point."""

from dataclasses import dataclass
from typing import Any

from forceaxis.experiments.points import SweepParameter
from forceaxis.experiments.run_result import Columns, Converters
from forceaxis.experiments.sweep_runs import Outcome, Row
from forceaxis.results import json_field, to_json


@dataclass(frozen=True)
class SweepCounts:
    """Numbers of points and runs, and of points by their results."""

    points: int
    runs: int
    resumed: int  # runs that were read from the journal
    failed: int
    boundaries: int | None = json_field(omit_none=True)  # of a search alone
    stable: int | None = json_field(omit_none=True)  # only in a sweep without a search
    unstable: int | None = json_field(omit_none=True)
    not_met: int | None = json_field(omit_none=True)
    never_in_contact: int | None = json_field(omit_none=True)

    def of(self, verdict: str) -> int:
        """The number of points with this verdict."""
        return int(getattr(self, verdict) or 0)


@dataclass(frozen=True)
class FailedPoint:
    """A point whose run failed."""

    index: int
    values: Row
    error: str


@dataclass(frozen=True)
class LonePoint:
    """A point whose verdict differs from that of all neighbours. around and alike: number of points
    around it that were also run, and of those with its verdict; None: no such points were run."""

    values: Row
    verdict: str
    around: int | None = None
    alike: int | None = None


@dataclass(frozen=True)
class SweepResult:
    """The result of a sweep without its columns."""

    experiment: str
    title: str
    parameters: dict[str, str]  # name -> unit
    counts: SweepCounts
    failures: list[FailedPoint]  # the first SHOWN_FAILURES
    warnings: list[str]
    refined: bool
    alone: list[LonePoint]
    seed: int | None  # of random points
    inputs_hash: str
    firmware_hash: str
    simulator_hash: str
    objects_hash: str
    where: str  # the runs were done
    seconds: float
    command: str  # command line that repeats the sweep


@dataclass
class Sweep:
    """A finished sweep: its result, and columns with one row for each point.

    Columns: index, the parameters, then of a run: verdict, fault, error, METRICS, edge_margin,
    trace_hash; of a boundary search: boundary (the last stable value), unstable_at (the first
    one beyond it that is not stable), beyond (its verdict), note (why there is none), error, runs.
    NaN and "" stand for nothing.
    """

    result: SweepResult
    columns: Columns
    axes: list[SweepParameter]  # of the points
    search: SweepParameter | None
    runs: list[tuple[float, Outcome]]  # of a search without axes: (value, outcome)
    converters: Converters  # converters of the model, {} if the sweep changes them
    closer: Columns  # columns of the points around isolated points

    @property
    def summary(self) -> dict[str, Any]:
        """The result in the form of `forceaxis sweep --json`; the values of a point are in one
        object."""
        found: dict[str, Any] = to_json(self.result)
        for points in (found["failures"], found["alone"]):
            for point in points:
                point |= point.pop("values")
        return found
