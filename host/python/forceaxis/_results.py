"""Results of the compiled module. Their fields are the keys of the JSON output.

Written by tools/gen_results.py.
"""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class HeldForce:
    """The controlled force over the window of the verdict."""

    setpoint_N: float
    held_N: float  # mean of the force over the time window of the verdict
    error_N: float  # set-point minus held_N
    error_percent: float  # magnitude of error_N, in per cent of the set-point
    # largest excess of the force over the set-point after from_s, in per cent of the set-point
    overshoot_percent: float
    # start of `settle_s`: last change of set-point or excitation, last impulse or first contact
    from_s: float
    # time after from_s until the force stays within 5 % of held_N; None: not before the window
    settle_s: float | None


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
    # mean position in the window minus the last position set-point in counts; None without one
    position_error_count: float | None
    contacts: int  # number of contacts that the criterion names, or of all contacts of the model
    contact_losses: int  # number of contact losses in the window
    contact_losses_run: int  # number of contact losses in the whole run
    # first time at which each of `contacts` was closed at least once; None if one never closed
    first_contact_s: float | None
    # True if all contacts that `contacts` counts are closed at the start of the window
    contact_at_window: bool
    in_contact: bool  # True if all contacts that `contacts` counts are closed at the end of the run
    peak_force_N: float  # largest contact force in the whole run
    final_force_N: float  # force of the first contact of the model at the last tick
    # number of ticks of the window in which the DAC code is at an end of the DAC range
    saturated_ticks: int
    # number of ticks of the whole run in which the DAC code is at an end of the DAC range
    saturated_run_ticks: int
    # number of ticks of the window with the force at an end of the measurable range, except force 0
    reading_range_ticks: int
    # last force set-point if it is outside the range of the measured force; otherwise None
    setpoint_beyond_N: float | None
    # end of the measured range that the set-point exceeds or the force last reached; otherwise 0
    reading_end_N: float
    last_adc_change_tick: int  # last tick in which the code of ADC 0 changed; 0 if it never changed
    held_force: HeldForce | None  # the controlled force; None if the experiment controls no force


@dataclass(frozen=True)
class Criterion:
    """The limits of the table [verdict]. None means that the experiment does not have the limit."""

    # Length of the window at the end of the run over which the verdict is evaluated.
    window_s: float
    # Largest peak-to-peak ripple of the measured force, in counts at 8 bits.
    force_ripple_max_count: float | None
    # Largest peak-to-peak ripple of the encoder, in counts.
    position_ripple_max_count: float | None
    # Largest distance of the mean position in the window from the last set-point, in counts.
    position_error_max_count: float | None
    # Largest difference between the mean force in the window and the set-point.
    held_force_error_max_N: float | None
    # Largest error of the mean force in the window, in percent of the force set-point.
    held_force_error_max_percent: float | None
    # Largest excess of the force over the last set-point, in percent of the set-point.
    overshoot_max_percent: float | None
    # Longest time until the force stays within 5 % of its mean in the window.
    settle_max_s: float | None
    peak_force_max_N: float | None  # Largest force of any contact over the complete run.
    # Largest force of any contact over the complete run, in percent of the last set-point.
    peak_force_max_percent: float | None
    # Largest number of losses of the contacts of contact_held, or of all contacts, in the run.
    contact_losses_max: float | None
    # Longest total time of the DAC code at an end of its range, over the complete run.
    saturated_max_s: float | None
    # True if all contacts must remain closed, or a list of contacts that must remain closed
    contact_held: bool | list[str]


@dataclass(frozen=True)
class MissedLimit:
    """A limit of [verdict] that a run exceeds."""

    limit: str  # key of [verdict], or the name of another condition
    verdict: str  # verdict that this missed limit alone would give
    # value of the run; None if the force does not settle, so that the value is infinite
    value: float | None
    bound: float
    unit: str  # unit of the limit: N, %, s, count, tick, or empty


@dataclass(frozen=True)
class Energy:
    """Balance of the mechanical energy of a plant or a run."""

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
class CycleFigure:
    """The figure of an evaluation element over the last cycle of a run."""

    name: str
    kind: str  # kind of evaluation element: peak, window, ...
    value: float  # value of the evaluation element in `unit`; 0 if the element found no value
    unit: str  # empty for a number
    tick: int  # tick of the sample that gave the value
    verdict: str  # verdict: good, below, above, wrong side, again, not reached or aborted


@dataclass(frozen=True)
class CycleReport:
    """The last cycle of a run."""

    title: str  # title of the program
    state: str  # value of the object cycle_state
    outcome: str  # value of the object cycle_outcome
    # name of the phase in which the cycle failed; empty if it ended as its program intends
    failed_phase: str
    cycles: int  # number of cycles that were started
    # number of ticks in evaluated phases whose sample is not valid; 0 before the end of a cycle
    invalid_ticks: int
    phases: list[str]  # names by number
    # values of the evaluation elements in their order; empty before the end of a cycle
    figures: list[CycleFigure]


@dataclass(frozen=True)
class CycleEnd:
    """A condition that ends the phase. Up to 4 are checked in each tick, in the order of the file,
    after the limits."""

    when: str
    value: float | None  # value of the condition in `unit`; None if the condition has no value
    unit: str  # s, N, N/m, m, or empty
    next: str  # name of the phase that follows this condition, or end


@dataclass(frozen=True)
class CyclePhase:
    """A phase of the cycle, at most 16. The cycle begins with the first one."""

    name: str
    ends: list[CycleEnd]
    on_limit: str
    tare_s: float | None  # time over which the phase measures the offset of the force


@dataclass(frozen=True)
class CycleElement:
    """An evaluation element, at most 16: a figure of the curve of force over x in some phases. The
    part is good if the cycle ends as intended and each element is within its bounds. A window needs
    all of from, to, least and most, in the units of x and of the force."""

    name: str
    kind: str  # kind of evaluation element: peak, window, ...
    is_shape: bool  # True for a window or an envelope, whose bounds are curves and not two numbers
    phases: list[str]
    over: str  # travel or time
    of: str  # quantity that crosses the level of the kinds `at` and `difference`: x or force
    unit: str  # SI unit of the value; empty for a number
    per_value: float  # value in SI units = value of the firmware * per_value
    x_from: float | None
    x_to: float | None
    least: float | None  # bounds of the value; None: no such bound
    most: float | None
    level: float | None
    lower: list[tuple[float, float]]  # points (x, N) of the curves of an envelope
    upper: list[tuple[float, float]]


@dataclass(frozen=True)
class CycleProgram:
    """A cycle: phases that follow each other, and what makes a part good."""

    file: Path
    title: str
    number: int  # number by which an axis selects this program; 0: it cannot be selected
    record: bytes  # bytes of the program that are downloaded to an axis (firmware/cycle/program.h)
    crc: int  # CRC of the record
    zero: str  # what defines travel 0: touch, force or position
    zero_at: float | None  # force in N or position in m that defines travel 0
    phases: list[CyclePhase]
    elements: list[CycleElement]
    compliance: list[tuple[float, float]]  # points (N, m): deflection of the press over the force


@dataclass(frozen=True)
class PlotTable:
    """Content of the figure of a run."""

    rows: list[list[str]]  # Columns of the trace. One diagram shows the columns of one row.
    from_s: float | None  # Start of the time axis.
    to_s: float | None  # End of the time axis, later than from_s.


@dataclass(frozen=True)
class UnitVariable:
    """A variable of a co-simulation unit."""

    name: str
    type: str  # real, int32, uint32 or boolean
    role: str  # input, output, fixed, tunable or independent
    unit: str  # empty without unit
    meaning: str
    start: float  # value of an input or parameter after the creation of the unit


@dataclass(frozen=True)
class LinkDetails:
    """Speed of a run over a connection, and numbers of messages."""

    ticks_per_s: float
    real_time: float  # ratio of simulated time to elapsed time
    overruns: int
    statistics: dict[str, int]  # {name of an event, such as repeated: number of messages}


@dataclass(frozen=True)
class ChipDetails:
    """Speed of a run on an emulated chip."""

    interrupts: int  # number of interrupts in which the chip has computed a tick
    ticks: int
    late_ticks: int  # number of ticks that the main loop had not completed before the next one
    ticks_per_s: float


@dataclass(frozen=True)
class JournalHeader:
    """What a journal of axis_node says about its run."""

    experiment: str
    overrides: list[str]
    entries: int
    ticks: int | None  # number of ticks of the recorded run; None if the journal is incomplete
    replayed: int  # number of ticks that a replay repeats
    trace_hash: str  # trace hash of the recorded run; empty if the journal is incomplete


@dataclass(frozen=True)
class ObjectBit:
    """One bit of an object whose value is a set of bits."""

    bit: int
    key: str
    text: str
    modes: tuple[int, ...]  # modes of operation in which the bit has this meaning; empty for all


@dataclass(frozen=True)
class AxisObject:
    """One parameter, signal or command of the firmware. The engineering value is the raw value
    times `scale`."""

    number: int
    name: str
    kind: str  # parameter, signal or command
    part: str
    meaning: str
    type: str  # u8, i8, u16, i16, u32 or i32
    unit: str  # unit of the engineering value
    scale: float
    min: int  # smallest raw value
    max: int  # largest raw value
    default: int  # raw value after power-up
    access: str  # rw, ro or wo
    writable: str  # states in which the object can be written: any, disabled or recorder_idle
    enum: tuple[str, ...]  # texts of the raw values 0, 1, 2, ...
    index: int  # CANopen index
    sub: int
    # first register: holding register for rw, input register for ro; -1 without a register
    modbus: int
    stored: bool  # True if the parameter store contains the object
    title: str  # name of the object in CANopen
    node_id: bool  # True for a COB-ID whose default value is a number plus the node id
    mappable: int  # 0: in no PDO, 1: in all PDOs that its access permits, 2: in TPDOs only
    quantity: str  # quantity of a count: force or encoder; empty if the unit defines the quantity
    # effect of a write while a cycle runs: free (none), ends (ends the cycle), refused
    in_cycle: str
    # names of special raw values, for an object that is not an enumeration
    values: tuple[tuple[int, str], ...]
    # a sentence for each named value, such as the cause of a fault; empty without a sentence
    sentences: tuple[str, ...]
    bits: tuple[ObjectBit, ...]  # bits of a value that is, or contains, a set of bits


@dataclass(frozen=True)
class AxisBit:
    """One coil or discrete input of the Modbus server."""

    address: int
    name: str
    meaning: str


@dataclass(frozen=True)
class StatusState:
    """A state of CiA 402: a statusword shows it if its bits in `mask` are `value`."""

    mask: int
    value: int
    text: str


@dataclass(frozen=True)
class Refusal:
    """Reason for which the firmware refuses an access to an object."""

    error: int  # number in the firmware
    name: str
    text: str  # text for the user
    aborts: tuple[int, ...]  # SDO abort codes with which the axis reports this refusal
