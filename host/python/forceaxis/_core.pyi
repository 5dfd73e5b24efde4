# Types of all names in the compiled module (host/python/binding).
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from forceaxis._results import (
    AxisBit,
    AxisObject,
    ChipDetails,
    Criterion,
    CycleProgram,
    CycleReport,
    Energy,
    JournalHeader,
    LinkDetails,
    Metrics,
    MissedLimit,
    PlotTable,
    Refusal,
    RefusedWrite,
    StatusState,
    UnitVariable,
)

_Floats = np.ndarray[Any, np.dtype[np.float64]]
_Complex = np.ndarray[Any, np.dtype[np.complex128]]
_Wide = np.ndarray[Any, np.dtype[np.longdouble]]  # extended precision
_Numbers = np.ndarray[Any, np.dtype[Any]]  # that are converted to what the function needs

class InputError(ValueError): ...
class SimulationError(RuntimeError): ...
class TransportError(RuntimeError): ...
class LinkSilent(RuntimeError): ...

TICKS_PER_SECOND: int
CYCLE_FORCE_MAX_Q8: int

FIRMWARE_HASH: str
FIRMWARE_VERSION: str
OBJECTS_HASH: str
FILE_FORMAT: int
PARAMETER_SET_FORMAT: str
JOURNAL_FORMAT: str
SIMULATOR_HASH: str

class Result:
    """A finished run with its trace."""

    title: str
    figure: str
    shows: str
    model: str
    plot: PlotTable
    verdict: str
    missed: list[MissedLimit]
    fault: str
    cycle: CycleReport | None
    trace_hash: str
    firmware_hash: str
    overridden: list[str]
    inputs_hash: str
    seed: int
    edge_margin: float
    event_count: int
    refused: list[RefusedWrite]
    events: list[tuple[float, str, str, str]]
    energy: Energy
    metrics: Metrics
    criterion: Criterion | None
    tick: np.ndarray[Any, np.dtype[np.uint32]]
    objects: dict[str, str]
    setpoints: list[tuple[float, float]]
    limited_setpoints: list[tuple[float, float]]
    impulses: list[tuple[float, str, float]]
    contacts: list[str]
    signal_units: dict[str, str]
    converters: dict[str, ConverterTable]
    def columns(self) -> dict[str, np.ndarray[Any, np.dtype[Any]]]: ...

class DriveMaster:
    """A master of one CiA 402 drive on CANopen (firmware/drive402), in ticks of 1/1500 s."""

    def __init__(
        self, settings: Mapping[str, int], extra: Sequence[tuple[int, int, int, int]] = ...
    ) -> None: ...
    def receive(self, id: int, data: bytes) -> None: ...
    def bus(self, off: bool, frames_lost: int) -> None: ...
    def tick(self, target: int, enable: bool, reset: bool) -> list[tuple[int, bytes]]: ...
    def feedback(self) -> DriveFeedback: ...

def evaluate_elements(
    elements: Sequence[Mapping[str, int]],
    points: Sequence[tuple[int, int]],
    samples: np.ndarray[Any, np.dtype[np.int64]],
) -> list[tuple[int, int, int]]: ...

class CurveJudge:
    """The program of a cycle with the scales of recorded curves."""

    @staticmethod
    def of_experiment(
        experiment: str | Path, overrides: Sequence[str], rate_hz: float
    ) -> CurveJudge: ...
    @staticmethod
    def of_program(
        file: str | Path,
        travel_count_m: float,
        force_count_N: float,
        rate_hz: float,
        contact_N: float | None,
    ) -> CurveJudge: ...
    def program(self) -> CycleProgram: ...
    @property
    def counts_per_m(self) -> float: ...
    @property
    def counts_per_N(self) -> float: ...
    @property
    def force_ends(self) -> tuple[float | None, float | None]: ...
    @property
    def knows_contact(self) -> bool: ...
    def judge(
        self, samples: np.ndarray[Any, np.dtype[np.int64]], open: int | None
    ) -> tuple[CycleReport, np.ndarray[Any, np.dtype[np.uint8]], int]: ...

class Excited:
    """A simulated plant to which an excitation is applied."""

    states: dict[str, int]
    adc_bits: Sequence[int]
    def __init__(
        self,
        model: str,
        overrides: dict[str, float | str],
        seed: int = ...,
        parts: int = ...,
        clamped: bool = ...,
    ) -> None: ...
    def write(self, object: str, value: float) -> None: ...
    def volts(
        self, volts: np.ndarray[Any, np.dtype[np.float64]], signals: Sequence[str]
    ) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def codes(
        self, ticks: int, columns: Sequence[str]
    ) -> np.ndarray[Any, np.dtype[np.float64]]: ...

class Experiments:
    """Experiment files, each with the content that was read first."""

class LiveAxis:
    """The simulated axis of an experiment, which runs in steps of ticks."""

    ticks: int
    extremes: Extremes
    def __init__(self, experiment: str, overrides: Sequence[str], store: str) -> None: ...
    def step(self, ticks: int) -> None: ...
    def read(self, number: int) -> int: ...
    def write(self, number: int, raw: int) -> int: ...
    def end_schedule(self) -> None: ...
    def reset_extremes(self) -> None: ...
    def signal(self, name: str) -> float: ...
    def samples(
        self, first: int, count: int, signals: int
    ) -> np.ndarray[Any, np.dtype[np.int32]]: ...

class BenchCase:
    """The simulated plant of a case of the benchmark, with its force loop."""

    def __init__(self, file: Path, force: str, robot: str, workpiece: str) -> None: ...
    def run(self, gain: int, setpoint_N: int, firmware: bool = ...) -> BenchRun: ...
    def sweep(
        self,
        gains: tuple[float, float],
        setpoints_N: tuple[float, float],
        side: int,
        threads: int,
    ) -> BenchSweep: ...

class ModelFile:
    """A model file that is read once, for many plants."""

    def __init__(self, path: str | Path) -> None: ...

class LawShape:
    """A force law with the gain 1."""

    hf_gain: float
    def __init__(
        self,
        integral_rad_per_s: float,
        sections: Sequence[tuple[float, float, float, float, float]],
    ) -> None: ...

def law_coefficients(
    numbers: Sequence[float] | np.ndarray[Any, np.dtype[np.float64]], tick_s: float
) -> tuple[float, list[tuple[float, float, float, float, float]]]: ...

class LawBounds:
    """Bounds that all loops have to keep."""

    def __init__(
        self,
        ms: Sequence[float],
        gain_margin: float,
        phase_margin_deg: float,
        hf_gain: float,
    ) -> None: ...

class LawRamp:
    """Force loops that have to follow a ramp of the set-point."""

    def excess(self, law: LawShape, gain: float) -> float: ...

class LawGrid:
    """Frequency responses of a set of plants, on which force laws are evaluated."""

    kept: list[int]
    def __init__(
        self,
        model: ModelFile,
        plants: Sequence[tuple[Mapping[str, float | str], Mapping[str, str]]],
        delays: Sequence[int],
        density: float,
        tick_s: float,
        threads: int = ...,
        all_phases: bool = ...,
    ) -> None: ...
    @property
    def exact(self) -> bool: ...
    @property
    def free(self) -> bool: ...
    def frequency_hz(self, plant: int) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def response(self, plant: int) -> np.ndarray[Any, np.dtype[np.complex128]]: ...
    def count_per_code(self, plant: int) -> float: ...
    def poles(self, plant: int) -> np.ndarray[Any, np.dtype[np.complex128]]: ...
    def zeros(self, plant: int) -> np.ndarray[Any, np.dtype[np.complex128]]: ...
    def noise_gain(self, law: LawShape) -> float: ...
    def ramp(self, plants: Sequence[int], ramp_s: float) -> LawRamp: ...
    def evaluate(
        self,
        numbers: np.ndarray[Any, np.dtype[np.float64]],
        bounds: LawBounds,
        ramp: LawRamp | None,
        floors_hz: Sequence[float],
        coefficient_max: float,
        threads: int = ...,
    ) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def largest_gain(
        self, law: LawShape, hf_gain: float, bounds: LawBounds
    ) -> tuple[float, str, int, int, float]: ...
    def gains(
        self, law: LawShape, hf_gain: float, bounds: LawBounds
    ) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def figures(self, law: LawShape, gain: float) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def precise(
        self, law: LawShape, gains: Sequence[float], threads: int = ...
    ) -> np.ndarray[Any, np.dtype[np.float64]]: ...

class Plant:
    """A simulated axis without firmware, in steps of one tick."""

    signal_names: list[str]
    edge_margin: float
    tick: int
    def __init__(
        self,
        model: str | Path,
        overrides: Mapping[str, float | str] = ...,
        seed: int = ...,
        audit: bool = ...,
    ) -> None: ...
    def step(self, code: int, enable: bool = ...) -> None: ...
    def step_volts(self, volts: float, enable: bool = ...) -> None: ...
    def follow(
        self,
        commands: _Numbers,
        volts: bool = ...,
        signals: Sequence[str] = ...,
        enabled: np.ndarray[Any, np.dtype[np.bool_]] | None = ...,
    ) -> tuple[np.ndarray[Any, np.dtype[np.int64]], _Floats]: ...
    def apply_impulse(self, body: str, impulse_N_s: float) -> None: ...
    def codes(self) -> tuple[int, int, int]: ...
    def signals(self) -> _Floats: ...
    def signal(self, name: str) -> float: ...
    def mode(self) -> str: ...
    def events(self) -> list[tuple[float, str, str, str, bool]]: ...
    def energy(self) -> Energy: ...

class Contacts:
    """Contacts of a plant without firmware, each with a recorded command."""

    def __init__(
        self,
        model: str | Path,
        held: Mapping[str, float | str],
        fitted: Sequence[str],
        moved: Sequence[str],
        volts: Sequence[_Floats],
        parts: int = ...,
    ) -> None: ...
    def run(self, values: _Numbers, starts: _Numbers, threads: int = ...) -> _Floats: ...

class BoundaryResponse:
    """The response of one input to one output along the stability boundary."""

    def __init__(self, A: _Numbers, B: _Numbers, C: _Numbers, D: float, dt: float) -> None: ...
    def __call__(self, w: _Numbers | Sequence[float]) -> tuple[_Complex, _Complex, _Floats]: ...

def objects() -> list[AxisObject]: ...
def status_states() -> list[StatusState]: ...
def refusals() -> list[Refusal]: ...
def coils() -> list[AxisBit]: ...
def discretes() -> list[AxisBit]: ...
def certificate(bank_crc: int, adc_bits: int, force_scale: float) -> CertificateValues: ...
def quantity_in(text: str, unit: str) -> float | None: ...
def quantity(text: str) -> float: ...
def units() -> list[tuple[str, str]]: ...
def model_format() -> list[FormatTable]: ...
def experiment_format() -> list[FormatTable]: ...
def cycle_format() -> list[FormatTable]: ...
def axis_linux_format() -> list[FormatTable]: ...
def linear(
    model: str | Path,
    inputs: Sequence[str],
    outputs: Sequence[str],
    overrides: Mapping[str, float | str] = ...,
    modes: Mapping[str, str] = ...,
    free: bool = ...,
    drive: bool = ...,
) -> LinearTable: ...
def facts(model: str | Path, overrides: Mapping[str, float | str] = ...) -> FactsTable: ...
def balance(A: _Numbers) -> _Floats: ...
def eigenvalues(A: _Numbers) -> _Complex: ...
def solve(A: _Numbers, B: _Numbers) -> _Wide: ...
def sampled(A: _Numbers, B: _Numbers, T: float) -> _Wide: ...
def hessenberg(A: _Numbers, B: _Numbers, C: _Numbers) -> tuple[_Floats, _Floats, _Floats]: ...
def hessenberg_response(
    H: _Numbers, B: _Numbers, C: _Numbers, D: _Numbers, points: _Numbers
) -> _Complex: ...
def read_toml(path: str) -> dict[str, Any]: ...
def parse_toml(text: str) -> dict[str, Any]: ...
def inputs(
    experiment: str | Path, overrides: Sequence[str] = ..., text: str | None = ...
) -> Inputs: ...
def fmu_variables(resources: str | Path) -> list[UnitVariable]: ...
def fmu_writes(experiment: str | Path, overrides: Sequence[str] = ...) -> FirmwareWrites: ...
def cycle_program(experiment: str | Path, overrides: Sequence[str] = ...) -> CycleProgram: ...
def run(
    experiment: str | Path,
    overrides: Sequence[str] = ...,
    firmware_hash: bool = ...,
    text: str | None = ...,
) -> Result: ...
def lcm_url_of(run_id: int) -> str: ...
def run_linked(
    experiment: str, overrides: Sequence[str], kind: str, run_id: int, **options: Any
) -> tuple[Result, LinkDetails]: ...
def run_on_chip(
    experiment: str, overrides: Sequence[str], *pipes: int, timeout_s: float, trace: bool
) -> tuple[Result, ChipDetails]: ...
def replay(journal: str) -> tuple[Result, JournalHeader]: ...
def run_many(
    jobs: Sequence[tuple[str, Sequence[str]]],
    threads: int = ...,
    progress: Callable[[int, int], None] | None = ...,
    keep_going: bool = ...,
    finished: Callable[[int, RunOutcome], None] | None = ...,
    experiments: Experiments | None = ...,
) -> list[RunOutcome]: ...
def evaluate(
    criterion: Criterion, metrics: Metrics, fault: str
) -> tuple[str, list[MissedLimit]]: ...
def result_types() -> list[tuple[str, str, str, list[tuple[str, str, str]]]]: ...

# Written by tools/gen_results.py from here to the end.

class ConverterTable(TypedDict):
    """A converter of the model, where quantity in `unit` = (code - zero) * per_code."""

    signal: str
    unit: str
    per_code: float
    zero: int
    bits: int

class ParameterTable(TypedDict):
    """A parameter of the model."""

    value: float
    unit: str

class Inputs(TypedDict):
    """The experiment that inputs() has read."""

    title: str
    model: str
    contacts: list[str]
    converters: dict[str, ConverterTable]
    firmware: dict[str, float]  # {object: value at the start}
    expect: dict[str, Any] | None
    inputs_hash: str
    criterion: Criterion | None
    not_evaluable: str | None  # reason why [verdict] cannot be evaluated, or None
    parameters: dict[str, ParameterTable]
    unused: list[str]  # overrides that have no effect

class RunOutcome(TypedDict, total=False):
    """A result of run_many(). A run that has failed has only the text `error`."""

    error: str
    verdict: str
    missed: list[MissedLimit]
    fault: str
    metrics: Metrics
    criterion: Criterion | None
    overridden: list[str]
    trace_hash: str
    edge_margin: float
    cycle: CycleReport | None

class LinearTable(TypedDict):
    """The linear equations of a model in one mode."""

    A: _Floats
    B: _Floats
    C: _Floats
    D: _Floats
    states: list[str]
    volts_per_code: float

class StructureTable(TypedDict):
    """A structure of a model that is given by its modes; for the fields see StructureFacts."""

    name: str
    ports: tuple[str, ...]
    modal_masses_kg: list[float]
    shapes: list[list[float]]  # modes x ports

class ContactTable(TypedDict):
    """A contact of a model and the two points between which it acts."""

    name: str
    between: tuple[str, str]

class DriveTable(TypedDict):
    """The drive of a model; for the fields see DriveFacts."""

    type: str
    body: str
    reaction: str
    values: dict[str, float]  # {key: parameter}
    bus: tuple[int, int, int]

class ReadingTable(TypedDict):
    """The force sensor of a model; for the fields see SensorFacts."""

    signal: str
    per_count: float  # unit of the signal per 8-bit count
    bits: int
    sampling: tuple[float, float | None, float, int] | None

class EncoderTable(TypedDict):
    """The encoder of a model; for the fields see EncoderFacts."""

    body: str
    reference: str
    scale: float

class FactsTable(TypedDict):
    """The contents of a model file; for the fields see PlantFacts."""

    title: str
    masses_kg: dict[str, float]
    structures: list[StructureTable]
    signals: dict[str, str]  # {signal: unit}
    parameters: dict[str, tuple[float, str]]  # {used parameter: value and unit}
    contacts: list[ContactTable]
    switches: dict[str, tuple[str, ...]]  # {element: its states}
    drive: DriveTable | None
    reading: ReadingTable | None
    encoder: EncoderTable | None
    volts_per_code: float
    volts_per_step: float

class BenchRun(TypedDict):
    """A run of 2 s: the value of each tick, before the control law is computed."""

    force: _Floats  # contact force in N
    robot: _Floats  # position in m
    workpiece: _Floats  # position in m
    current: _Floats  # current of the motor in A
    count: np.ndarray[Any, np.dtype[np.int32]]  # code of ADC 0 minus the code of the force 0
    seconds: float  # CPU time in s
    events: int  # number of state changes of elements

class BenchSweep(TypedDict):
    """Metrics of the runs of a sweep, in which the set-point changes fastest, and its time."""

    peak_force_N: _Floats
    end_force_N: _Floats
    contact_losses: np.ndarray[Any, np.dtype[np.int32]]
    last_change: np.ndarray[Any, np.dtype[np.int32]]  # last tick in which the code of ADC 0 changed
    wall_s: float
    cpu_s: float  # CPU time of all threads

class DriveFeedback(TypedDict):
    """What a master knows of its drive: drive402_feedback_t in
    firmware/drive402/drive402_state.h."""

    position_cnt: int
    torque: int  # per mille of the rated torque
    age_ticks: int  # age of position and torque
    statusword: int
    error_code: int
    fitted: bool  # True if the configuration was accepted
    on: bool  # True if targets act
    fault: bool
    limit: bool
    saturated: bool
    phase: str
    state: str
    reason: str  # first failure since the last reset
    reason_text: str
    failed_index: int
    failed_sub: int
    abort_code: int
    key: str  # setting that the drive refused; empty if there is none

class FirmwareWrites(TypedDict):
    """What the firmware of an experiment has."""

    title: str
    dac_bits: int
    initial: list[tuple[str, int]]  # (object, raw value) of each initial write
    at: list[tuple[int, str, int]]  # (tick, object, raw value) of each later write
    program: list[int]  # words of its program of a cycle

class Extremes(TypedDict):
    """What a simulated axis has reached since a reset of them."""

    force_N: float  # largest true contact force
    position_min_cnt: int
    position_max_cnt: int

class CertificateValues(TypedDict):
    """Raw values of the certificate of a bank."""

    certificate_hash: int
    certificate_parts: int

class KeyTable(TypedDict):
    """A key of a table of an input file, as its reader declares it."""

    key: str
    form: str  # kind of value
    unit: str
    range: str
    required: bool
    default: str  # value or effect without the key
    meaning: str

class FormatTable(TypedDict):
    """A table of an input file, as its reader declares it."""

    path: str
    header: str  # as it is written in a file; empty for the file
    meaning: str
    when: str  # condition under which a table has these keys
    open: bool  # True if the table accepts keys with any name
    keys: list[KeyTable]
