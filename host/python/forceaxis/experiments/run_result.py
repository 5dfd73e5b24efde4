"""Types of the result of a run. Their fields are the keys in the JSON output of the command `run`.

The types of the compiled module are in _results.py. That file is generated from rows in C++.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from forceaxis._results import Criterion as Criterion
from forceaxis._results import CycleFigure as CycleFigure
from forceaxis._results import CycleReport as CycleReport
from forceaxis._results import Energy as Energy
from forceaxis._results import HeldForce as HeldForce
from forceaxis._results import Metrics as Metrics
from forceaxis._results import MissedLimit as MissedLimit
from forceaxis._results import RefusedWrite as RefusedWrite
from forceaxis.experiments import verdicts
from forceaxis.results import json_field

if TYPE_CHECKING:
    from forceaxis import _core

Array: TypeAlias = np.ndarray[Any, np.dtype[Any]]  # array of numbers or texts
Columns: TypeAlias = dict[str, Array]  # {name of a column: values of the column}


@dataclass(frozen=True)
class Converter:
    """A converter of the model. It has quantity = (code - zero) * per_code, in `unit`."""

    signal: str  # name of the converted quantity in the model
    unit: str
    per_code: float  # change of the quantity per code, in `unit`
    zero: int  # code that stands for the quantity 0
    bits: int

    @property
    def per_8_bit_count(self) -> float:
        """Returns the size of one 8-bit count in `unit`, > 0. The range of the converter has 256
        such counts."""
        return float(abs(self.per_code) * 2 ** (self.bits - 8))

    @property
    def per_12_bit_code(self) -> float:
        """Returns the size in `unit` of one code of the firmware. The range of the DAC has 4096
        such codes."""
        return float(self.per_code * 2 ** (self.bits - 12))

    @property
    def range(self) -> tuple[float, float]:
        """Returns (smallest, largest) quantity in the range of the converter, in `unit`."""
        ends = sorted((code - self.zero) * self.per_code for code in (0, 2**self.bits - 1))
        return ends[0], ends[1]


Converters: TypeAlias = dict[
    str, Converter
]  # {column of the trace with codes, such as "encoder": converter of these codes}


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
    """Numbers of messages of the two processes of a run over a connection. Each process has
    {result, such as sent, repeated or dropped: number of messages}."""

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
    # number of timer interrupts of an emulated chip
    interrupts: int | None = json_field(omit_none=True)
    ticks: int | None = json_field(omit_none=True)  # number of ticks of an emulated chip
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
    traced: bool  # False if the run is longer than ten minutes; it then has no trace


@dataclass(frozen=True)
class ReplayedJournal(JournalFacts):
    """A journal whose run was repeated."""

    same: bool  # True if the replay and the recorded run have equal trace hashes


@dataclass(frozen=True)
class RunResult:
    """The result of a run: its verdict, the quantities of the verdict, and hashes of its inputs."""

    experiment: str
    title: str
    figure: str  # number of the figure in the thesis; may be empty
    verdict: str | None  # verdict of the run; None if the experiment has no [verdict]
    because: list[str]  # reasons for a verdict other than "stable", as texts
    missed: list[MissedLimit]
    warnings: list[str]
    fault: str
    refused: list[RefusedWrite]
    trace_hash: str
    # Smallest distance of a converted value from the edge between two codes, in LSB.
    # The distance is None if no value was converted.
    edge_margin: float | None
    ticks: int  # number of ticks of the run
    events: int  # number of state changes of elements
    energy: Energy
    metrics: Metrics
    criterion: Criterion | None
    converters: Converters
    objects: dict[str, str]  # {object of the table [trace]: unit}
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
        """Returns the text with which pages and plots mark the run. This is the verdict, or
        NOT_HELD for a stable run with a large error of the controlled force. Empty without a
        verdict."""
        held, limits = self.metrics.held_force, self.criterion
        if self.verdict != verdicts.STABLE or held is None or limits is None:
            return self.verdict or ""
        limited = (limits.held_force_error_max_N, limits.held_force_error_max_percent)
        missed = limited == (None, None) and held.error_percent > verdicts.HELD_ERROR_MAX_PERCENT
        return verdicts.NOT_HELD if missed else self.verdict

    @property
    def force_reading(self) -> Converter | None:
        """Returns the converter ADC 0, whose quantity the firmware controls. Returns None if the
        model has no ADC 0."""
        return self.converters.get("adc0")


def read_converters(given: "Mapping[str, _core.ConverterTable]") -> Converters:
    """Returns the converters of a model as {column of codes: converter}."""
    return {column: Converter(**converter) for column, converter in given.items()}
