"""Types of the result of a run. Their fields are the keys of the JSON output of the command
`run`.

The functions read_... convert dicts of the compiled module, whose keys are the names of the fields.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from forceaxis.experiments import verdicts
from forceaxis.results import json_field

CoreTable: TypeAlias = Mapping[str, Any]  # a dict that the compiled module returns
Array: TypeAlias = np.ndarray[Any, np.dtype[Any]]  # array of numbers or texts
Columns: TypeAlias = dict[str, Array]  # {name of a column: values of the column}


@dataclass(frozen=True)
class Converter:
    """A converter of the model, with quantity = (code - zero) * per_code in `unit`."""

    signal: str  # name of the quantity in the model
    unit: str
    per_code: float  # change of the quantity per code, in `unit`
    zero: int  # code that represents 0
    bits: int

    @property
    def per_8_bit_count(self) -> float:
        """Returns the size of one count in `unit`, > 0. The range of the converter has 256
        counts."""
        return float(abs(self.per_code) * 2 ** (self.bits - 8))

    @property
    def per_12_bit_code(self) -> float:
        """Returns the size of one code of the firmware in `unit`. The range of the DAC has 4096
        codes."""
        return float(self.per_code * 2 ** (self.bits - 12))

    @property
    def range(self) -> tuple[float, float]:
        """Returns the smallest and the largest quantity in the range of the converter, in
        `unit`."""
        ends = sorted((code - self.zero) * self.per_code for code in (0, 2**self.bits - 1))
        return ends[0], ends[1]


Converters: TypeAlias = dict[
    str, Converter
]  # {column of codes ("encoder", "adc0", ...): converter of these codes}


@dataclass(frozen=True)
class HeldForce:
    """The controlled force over the window of the verdict."""

    setpoint_N: float
    held_N: float  # mean over the window
    error_N: float
    error_percent: float  # error in per cent of the set-point
    overshoot_percent: float  # overshoot in per cent of the set-point
    # time at which `settle_s` begins: last change of the set-point, or a later first contact
    from_s: float
    settle_s: float | None  # settling time in s; None means that the force does not settle


@dataclass(frozen=True)
class Metrics:
    """The quantities of a run from which the verdict is evaluated."""

    window_ticks: int
    window_start_s: float
    force_ripple_count: float  # force ripple in the window of the verdict, in 8-bit counts
    force_ripple_late_count: float  # force ripple in the second half of the window, in 8-bit counts
    position_ripple_count: float  # position ripple in the window of the verdict, in encoder counts
    # position ripple in the second half of the window, in encoder counts
    position_ripple_late_count: float
    contacts: int  # number of contacts of the model
    contact_losses: int  # number of contact losses in the window
    contact_losses_run: int  # number of contact losses in the whole run
    first_contact_s: float | None
    contact_at_window: bool  # in contact at the start of the window
    in_contact: bool  # in contact at the end of the run
    peak_force_N: float
    final_force_N: float
    # number of ticks of the window in which the DAC code is at an end of the DAC range
    saturated_ticks: int
    # largest number of successive ticks in which the DAC code is at an end of the DAC range
    saturated_run_ticks: int
    # number of ticks of the window in which the measured force is at an end of the ADC range
    reading_range_ticks: int
    # first force set-point outside the range of the measured force; None if there is none
    setpoint_beyond_N: float | None
    # end of the range of the measured force that the set-point exceeds, or at which the reading was
    # last in the window; otherwise 0
    reading_end_N: float
    last_adc_change_tick: int  # last tick in which the code of ADC 0 changed
    # the controlled force; None if the experiment controls no force
    held_force: HeldForce | None


@dataclass(frozen=True)
class Criterion:
    """The limits of the table [verdict]. None means that the experiment does not have the limit."""

    window_s: float
    force_ripple_max_count: float | None
    position_ripple_max_count: float | None
    held_force_error_max_N: float | None
    held_force_error_max_percent: float | None
    overshoot_max_percent: float | None
    settle_max_s: float | None
    peak_force_max_N: float | None
    peak_force_max_percent: float | None
    contact_losses_max: float | None
    saturated_max_s: float | None
    # True if all contacts must remain closed, or a list of contacts that must remain closed
    contact_held: bool | list[str]


@dataclass(frozen=True)
class MissedLimit:
    """A limit of [verdict] that a run exceeds."""

    limit: str  # key of [verdict], or the name of another condition
    verdict: str  # verdict that follows
    value: float | None  # value of the run; None means infinite, because the force does not settle
    bound: float
    unit: str


@dataclass(frozen=True)
class Energy:
    """Balance of the mechanical energy over a run."""

    initial_J: float
    supplied_J: float
    dissipated_J: dict[str, float]  # {element of the model: dissipated energy in J}
    kinetic_J: float
    stored_J: float
    discarded_J: float
    residual_J: float


@dataclass(frozen=True)
class RefusedWrite:
    """A refused write: the firmware refused the write to an object in [[at]] of the experiment."""

    tick: int
    object: str
    reason: str


@dataclass(frozen=True)
class ProcessIds:
    """Process identifiers of the two processes of a run over a connection."""

    plant: int
    axis: int


@dataclass(frozen=True)
class TraceHashes:
    """The trace hash that each process of a run over a connection has computed."""

    plant: str
    axis: str


@dataclass(frozen=True)
class RecordCounts:
    """Numbers of messages by their result (sent, repeated, dropped, ...) for each process of a run
    over a connection."""

    plant: dict[str, int]
    axis: dict[str, int]


@dataclass(frozen=True)
class LinkReport:
    """Report of a run over a connection between two processes."""

    kind: str  # kind of the connection
    where: str  # address of the connection
    run_id: int | None
    pids: ProcessIds
    hashes: TraceHashes
    same: bool  # True if the trace hashes of the two processes are equal
    ticks_per_s: float
    real_time: float  # ratio of simulated time to elapsed time
    repeated: int  # number of messages that were sent again
    statistics: RecordCounts | None
    interrupts: int | None = json_field(omit_none=True)  # timer interrupts of an emulated chip
    ticks: int | None = json_field(omit_none=True)  # ticks of an emulated chip
    # number of ticks that the main loop of an emulated chip had not completed before the next one
    late_ticks: int | None = json_field(omit_none=True)


@dataclass(frozen=True)
class JournalFacts:
    """The content of a journal of axis_node."""

    experiment: str
    overrides: list[str]
    entries: int
    ticks: int | None  # number of ticks of the recorded run; None if the journal is incomplete
    trace_hash: str  # trace hash of the recorded run; empty if the journal is incomplete
    traced: bool  # False if the replay has no trace, because the session is longer than ten minutes


@dataclass(frozen=True)
class ReplayedJournal(JournalFacts):
    """A journal whose run was repeated."""

    same: bool  # True if replay and recorded run have equal trace hashes


@dataclass(frozen=True)
class PlotTable:
    """The table [plot] of an experiment."""

    # names of the columns in each row of the plot
    rows: list[list[str]] = field(default_factory=lambda: [["encoder"], ["adc0"], ["dac"]])
    from_s: float | None = None  # start of the plotted time in s; None selects the start of the run
    to_s: float | None = None  # None: to the end of the run


@dataclass(frozen=True)
class CycleFigure:
    """The figure of an evaluation element over the last cycle of a run."""

    name: str
    kind: str  # kind of evaluation element: "peak", "window", ...
    value: float  # in `unit`; 0 if nothing was found
    unit: str  # empty for a number
    tick: int  # tick in which the value was found
    # "good", "below", "above", "wrong side", "again", "not reached" or "aborted"
    verdict: str


@dataclass(frozen=True)
class CycleReport:
    """The last cycle of a run."""

    title: str  # title of the program
    state: str  # value of the object cycle_state
    outcome: str  # value of the object cycle_outcome
    failed_phase: str  # phase that failed; empty if the cycle ended by its program
    cycles: int  # number of cycles that were started
    invalid_ticks: int  # ticks in evaluated phases whose sample is not valid
    phases: list[str]  # names by number
    figures: list[CycleFigure]  # empty before the end of a cycle


@dataclass(frozen=True)
class RunResult:
    """The result of a run: verdict, quantities of the verdict, and hashes of the inputs."""

    experiment: str
    title: str
    figure: str  # figure number of the thesis; may be empty
    verdict: str | None  # verdict of the run; None if the experiment has no [verdict]
    because: list[str]  # reasons for a verdict other than "stable", as texts
    missed: list[MissedLimit]
    warnings: list[str]
    fault: str
    refused: list[RefusedWrite]
    trace_hash: str
    # Smallest distance in LSB of a converted value from the edge between two codes.
    # None if no value was converted.
    edge_margin: float | None
    ticks: int  # number of ticks
    events: int  # number of state changes of elements
    energy: Energy
    metrics: Metrics
    criterion: Criterion | None
    converters: Converters
    objects: dict[str, str]  # {object of the table [trace]: unit of the object}
    inputs_hash: str
    firmware_hash: str
    objects_hash: str
    seed: int
    command: str  # command line that repeats the run
    cycle: CycleReport | None = json_field(omit_none=True)
    link: LinkReport | None = json_field(omit_none=True)
    replay: ReplayedJournal | None = json_field(omit_none=True)

    @property
    def mark(self) -> str:
        """Returns how pages and plots mark the run: its verdict, or NOT_HELD for a stable run that
        misses its demanded force. Empty without a verdict."""
        held, limits = self.metrics.held_force, self.criterion
        if self.verdict != verdicts.STABLE or held is None or limits is None:
            return self.verdict or ""
        limited = (limits.held_force_error_max_N, limits.held_force_error_max_percent)
        missed = limited == (None, None) and held.error_percent > verdicts.HELD_ERROR_MAX_PERCENT
        return verdicts.NOT_HELD if missed else self.verdict

    @property
    def force_reading(self) -> Converter | None:
        """Returns the converter ADC 0, whose quantity the firmware controls, or None if the model
        has no ADC 0."""
        return self.converters.get("adc0")


def read_converters(given: Mapping[str, CoreTable]) -> Converters:
    """Returns the converters of a model by their columns of codes."""
    return {column: Converter(**converter) for column, converter in given.items()}


def read_cycle(given: CoreTable | None) -> CycleReport | None:
    """Returns the last cycle of a run, or None if the experiment has no program."""
    if given is None:
        return None
    figures = [CycleFigure(**figure) for figure in given["figures"]]
    return CycleReport(**{**given, "figures": figures})


def read_metrics(given: CoreTable) -> Metrics:
    """Returns the metrics of a run from a dict of the compiled module."""
    held = given["held_force"]
    return Metrics(**{**given, "held_force": HeldForce(**held) if held else None})


def read_criterion(given: CoreTable | None) -> Criterion | None:
    """Returns the limits of the table [verdict] from a dict of the compiled module."""
    return Criterion(**given) if given else None


def read_missed(given: Sequence[CoreTable]) -> list[MissedLimit]:
    """Returns the limits that a run exceeds."""
    return [MissedLimit(**limit) for limit in given]


def read_refused(given: Sequence[CoreTable]) -> list[RefusedWrite]:
    """Returns the writes that the firmware refused."""
    return [RefusedWrite(**write) for write in given]
