"""Result of a sweep: the points with their runs or stability boundaries, and a summary."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy import special

from forceaxis.experiments.points import Point, SweepParameter, tidy
from forceaxis.experiments.run_result import Columns, Converters
from forceaxis.experiments.verdicts import STABLE
from forceaxis.results import JsonObject, json_field, to_json

Row: TypeAlias = dict[str, float]  # values of one point: {swept parameter: value}


@dataclass(frozen=True, slots=True)
class PointOutcome:
    """Result of the run at one point of a sweep. A failed run has only the field `error`. Each
    field is a column of the file results.csv."""

    verdict: str = ""
    fault: str = ""
    error: str = ""
    peak_force_N: float | None = None
    final_force_N: float | None = None
    force_ripple_count: float | None = None
    position_ripple_count: float | None = None
    contact_losses: int | None = None
    contact_losses_run: int | None = None
    first_contact_s: float | None = None
    in_contact: bool | None = None
    reading_range_ticks: int | None = None
    saturated_ticks: int | None = None
    setpoint_beyond_N: float | None = None
    last_adc_change_tick: int | None = None
    edge_margin: float | None = None
    trace_hash: str = ""


# Fields of a PointOutcome that have the same name in the metrics of a run.
METRICS = tuple(
    field.name
    for field in fields(PointOutcome)
    if field.type is not str and field.name != "edge_margin"
)


def outcome_columns(outcomes: Sequence[PointOutcome]) -> Columns:
    """Returns the outcomes as columns of results: texts, and numbers with nan for None."""
    return {
        field.name: np.array(
            [getattr(outcome, field.name) for outcome in outcomes],
            dtype=str if field.type is str else float,
        )
        for field in fields(PointOutcome)
    }


@dataclass
class Boundary:
    """Stability boundary at one point of a sweep: where the verdict changes along the searched
    parameter. Values are in the unit of this parameter."""

    row: Row
    # value next to the boundary; the run with this value is stable
    stable: float = math.nan
    # value next to the boundary; the run with this value is not stable
    unstable: float = math.nan
    beyond: str = ""  # verdict of the run at `unstable`
    note: str = ""  # reason why there is no boundary
    error: str = ""  # error of the last failed run
    runs: int = 0
    # True while the verdict changes between the values `stable` and `unstable`
    searching: bool = False

    def begin(self, search: SweepParameter, low: str | None, high: str | None) -> None:
        """Stores the verdicts at the two ends of the range. None means that the run failed."""
        if low is None or high is None:
            return
        if (low == STABLE) == (high == STABLE):
            self.note = (
                f"no change: {low} from {search.low:g} to {search.high:g}"
                if low == high
                else f"stable at neither end: {low} at {search.low:g}, {high} at {search.high:g}"
            )
            return
        self.searching = True
        up = low == STABLE
        self.stable, self.unstable = (search.low, search.high)[:: 1 if up else -1]
        self.beyond = high if up else low

    @property
    def middle(self) -> float:
        """Returns the value in the middle of the range."""
        return tidy((self.stable + self.unstable) / 2)

    def is_open(self, tolerance: float) -> bool:
        """Returns True if the range is wider than the tolerance and can be halved."""
        return (
            self.searching
            and abs(self.unstable - self.stable) > tolerance
            and self.middle not in (self.stable, self.unstable)
        )

    def halve(self, verdict: str | None) -> None:
        """Halves the range. `verdict`: verdict of the run in the middle of the range. None means
        that this run failed. The boundary is then unknown."""
        if verdict is None:
            self.searching, self.stable, self.unstable = False, math.nan, math.nan
        elif verdict == STABLE:
            self.stable = self.middle
        else:
            self.unstable, self.beyond = self.middle, verdict


@dataclass(frozen=True)
class SweepPlan:
    """Points of a sweep: `axes`, one value of each axis for every point, and the parameter whose
    stability boundary is searched at every point, or None."""

    axes: list[SweepParameter]
    points: list[Point]
    search: SweepParameter | None

    @property
    def swept(self) -> list[SweepParameter]:
        """Returns every parameter that changes between runs."""
        return [*self.axes, *([self.search] if self.search else [])]

    @property
    def names(self) -> list[str]:
        """Returns the names of the axes."""
        return [axis.name for axis in self.axes]

    def row(self, point: Point) -> Row:
        """Returns a point as {swept parameter: value}."""
        return dict(zip(self.names, point, strict=True))

    def columns(self, points: Sequence[Point]) -> Columns:
        """Returns the parameter values of all points as columns, one column for each swept
        parameter.
        """
        values = np.array(points, dtype=float).reshape(len(points), len(self.axes))
        return dict(zip(self.names, values.T.copy(), strict=True))


@dataclass(frozen=True)
class SweepCounts:
    """Numbers of points and runs, and the number of points with each result."""

    points: int
    runs: int
    resumed: int  # number of runs that were read from the journal
    failed: int
    # number of boundaries; None without a search
    boundaries: int | None = json_field(omit_none=True)
    # number of stable points; in a search, the numbers of points with each verdict are None
    stable: int | None = json_field(omit_none=True)
    unstable: int | None = json_field(omit_none=True)
    not_met: int | None = json_field(omit_none=True)
    never_in_contact: int | None = json_field(omit_none=True)

    def of(self, verdict: str) -> int:
        """Returns the number of points with this verdict."""
        return int(getattr(self, verdict) or 0)


@dataclass(frozen=True)
class FailedPoint:
    """A point of a sweep whose run failed."""

    index: int
    values: Row
    error: str


@dataclass(frozen=True)
class IsolatedPoint:
    """A point whose verdict differs from the verdicts of all neighbours.

    `around`: number of further points around the isolated point that were run. `alike`: number of
    those among them with the same stability as the isolated point. Both are None if no further
    points were run.
    """

    values: Row
    verdict: str
    around: int | None = None
    alike: int | None = None


@dataclass(frozen=True)
class Bounces:
    """The number of runs with a contact loss, and the probability of a contact loss with its 95 %
    interval (Clopper and Pearson)."""

    runs: int
    lost: int
    low: float
    high: float


def bounces(outcomes: Sequence[PointOutcome]) -> Bounces:
    """Returns how many runs had contact, and how many of these runs lost the contact."""
    touched = [one for one in outcomes if not one.error and one.first_contact_s is not None]
    runs, lost = len(touched), sum(bool(one.contact_losses_run) for one in touched)
    low = float(special.betaincinv(lost, runs - lost + 1, 0.025)) if lost else 0.0
    high = float(special.betaincinv(lost + 1, runs - lost, 0.975)) if lost < runs else 1.0
    return Bounces(runs, lost, low, high)


@dataclass(frozen=True)
class SweepResult:
    """Summary of a sweep, without the results of the single points."""

    experiment: str
    title: str
    parameters: dict[str, str]  # {swept parameter: unit}
    counts: SweepCounts
    failures: list[FailedPoint]  # the first ten points whose run failed
    warnings: list[str]
    refined: bool
    alone: list[IsolatedPoint]
    seed: int | None  # seed of random points
    inputs_hash: str
    firmware_hash: str
    simulator_hash: str
    objects_hash: str
    where: str  # number of threads that executed the runs, or address of the Dask scheduler
    seconds: float
    command: str  # command line that repeats the sweep
    # contact losses of a sweep over a posterior
    bounces: Bounces | None = json_field(omit_none=True)


@dataclass(frozen=True)
class Sweep:
    """A finished sweep: its summary, and the outcome or the stability boundary of each point."""

    result: SweepResult
    plan: SweepPlan
    outcomes: list[PointOutcome]  # outcome of each point; empty in a search
    boundaries: list[Boundary]  # stability boundary of each point; empty without a search
    # (value, outcome) of each run of a search without other parameters
    search_runs: list[tuple[float, PointOutcome]]
    converters: Converters  # converters of the model; empty if the sweep changes a converter
    closer: dict[Point, PointOutcome]  # {point: outcome} of further points around isolated points

    @cached_property
    def columns(self) -> Columns:
        """Returns the columns of results.csv, with one row for each point.

        The columns are index, the parameters, and the fields of PointOutcome. In a search, they are
        index, the parameters, boundary (last stable value), unstable_at (first value beyond the
        boundary that is not stable), beyond (verdict there), note (reason for a missing boundary),
        error and runs. A missing number is nan, and a missing text is empty.
        """
        found = {"index": np.arange(len(self.plan.points))} | self.plan.columns(self.plan.points)
        if not self.plan.search:
            return found | outcome_columns(self.outcomes)
        return found | {
            "boundary": np.array([one.stable for one in self.boundaries]),
            "unstable_at": np.array([one.unstable for one in self.boundaries]),
            "beyond": np.array([one.beyond for one in self.boundaries], dtype=str),
            "note": np.array([one.note for one in self.boundaries], dtype=str),
            "error": np.array([one.error for one in self.boundaries], dtype=str),
            "runs": np.array([one.runs for one in self.boundaries], dtype=float),
        }

    @property
    def closer_columns(self) -> Columns:
        """Returns the columns of closer.csv: the parameters and outcomes of `closer`."""
        return self.plan.columns(list(self.closer)) | outcome_columns(list(self.closer.values()))

    @property
    def summary(self) -> JsonObject:
        """Returns the result for JSON. In the JSON object of a point, each parameter value has a
        key of its own."""
        failures = [_flattened(point) for point in self.result.failures]
        alone = [_flattened(point) for point in self.result.alone]
        return {**to_json(self.result), "failures": failures, "alone": alone}


def _flattened(point: FailedPoint | IsolatedPoint) -> dict[str, float | str | None]:
    """Returns the fields of a point, followed by the values of the swept parameters."""
    fields = asdict(point)
    return {name: value for name, value in fields.items() if name != "values"} | point.values
