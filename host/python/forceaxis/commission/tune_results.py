"""Results of the steps of a tuning, in the form of the files in the folder of the tuning.

Each step has one frozen dataclass. `forceaxis.results` converts the dataclass to JSON and back, so
the names of the fields are the keys of the files. Forces are in N, frequencies in Hz, stiffnesses
in N/m, masses in kg, positions in encoder counts, amplitudes in DAC codes.
"""

from dataclasses import dataclass, field

from forceaxis.commission import sine_excitation
from forceaxis.commission.friction_models import FrictionElement
from forceaxis.commission.joint_fit import JointSummary
from forceaxis.commission.level import Abort, Rest
from forceaxis.design.banks import BankFigures
from forceaxis.design.cases import SimulatedContact
from forceaxis.design.certificate import P, WorstFigures
from forceaxis.design.outcome import DesignResult
from forceaxis.linear.bank import BankKeys
from forceaxis.linear.precise import Figures
from forceaxis.results import json_field

Setting = int | float | str  # engineering value of an object, or the name of an enumeration value
Settings = dict[str, Setting]  # {object: Setting}
Values = dict[str, float]  # {parameter of the model: value in SI units}
Range = tuple[float, float]  # low, high


@dataclass(frozen=True)
class Checked:
    """Result of `check`. `settings`: values from the model for objects that are not set on the
    axis.

    `law`: the force law for the measurement. `band_hz`: lowest and highest frequency of the
    responses. `before`: the previous force law of the axis. `latency_ticks`: latency of the output
    of the axis in ticks.
    """

    rest: Rest
    settings: Settings
    law: BankKeys
    band_hz: Range
    before: BankKeys
    latency_ticks: int


@dataclass(frozen=True, kw_only=True)
class ResponseFigures:
    """Numbers of a measured response.

    `swing`: range of the output from peak to peak, in N in contact and in counts out of contact.
    `speed_rms`: rms rate of change of the output that the waveform alone causes, in N/s or
    counts/s. See level.Level.
    """

    amplitude: int
    swing: float
    speed_rms: float
    coherence_median: float | None = None
    random_error_median: float | None = None
    bias_N: float | None = None
    force_min_N: float | None = None
    force_max_N: float | None = None
    noise_lsb: float | None = None
    distorted: float | None = None
    aborts: tuple[Abort, ...] = ()
    of_loop: bool = False


@dataclass(frozen=True)
class GlideFigures:
    """A friction.Glide, and True if the axis has friction out of contact. Dead zone and difference
    are in DAC codes, `rate` is in counts/s per DAC code."""

    dead_zone: float
    rate: float
    codes: int
    rubs: bool
    difference: float


@dataclass(frozen=True, kw_only=True)
class FreeResponse(ResponseFigures):
    """Result of `free`: the response out of contact, and the friction that was measured before this
    response."""

    glide: GlideFigures


@dataclass(frozen=True, kw_only=True)
class PressedResponse(ResponseFigures):
    """Numbers of the response at one force. `small`: numbers of the response with the smaller
    amplitude. `differs`: True if `fit` has found that the two responses differ."""

    bias_N: float = field()
    small: ResponseFigures | None = json_field(omit_none=True)
    differs: bool | None = json_field(omit_none=True)


@dataclass(frozen=True, kw_only=True)
class SlowChange:
    """The friction.SlowLoading between the smallest and the largest force, with the keys of the
    file. `force_N` and `way` are block means of the recording, (n,), in N and counts."""

    friction_N: float
    sticks: bool
    compliance: float
    sliding: float
    low_N: float
    high_N: float
    softest_N: float | None = None
    softest: float | None = None
    way: tuple[float, ...] = ()
    force_N: tuple[float, ...] = ()


@dataclass(frozen=True)
class MeasuredResponses:
    """Result of `measure`, in three files.

    `levels`: {folder of a response: numbers of the response}. `between`: slow change of the force.
    `shaken`: measurement of the workpiece with sines, None if the workpiece did not slide.
    """

    levels: dict[str, PressedResponse]
    between: SlowChange
    shaken: sine_excitation.SineTestResult | None


@dataclass(frozen=True)
class ParameterRow:
    """A fitted parameter: SI value, 95 % interval, and unit."""

    value: float
    interval: Range
    unit: str


@dataclass(frozen=True, kw_only=True)
class Fitted(JointSummary):
    """Result of `fit`. `values`: values for the design.

    `own`: {response: values of the parameters that only this response has}. `friction`: the
    measured dry friction. `lines`: the friction elements that the model lacks, as TOML. `left_out`:
    responses during which the backlash of the gear opens. `relied`: texts about parameters whose
    design value differs from the fit. `together`: values that change together.
    """

    values: Values = field()
    over: tuple[str, ...] = field()
    parameters: dict[str, ParameterRow]
    friction: tuple[FrictionElement, ...]
    lines: str
    own: dict[str, Values]
    left_out: tuple[str, ...] = ()
    relied: tuple[str, ...] = ()
    together: tuple[Values, ...] = ({},)


@dataclass(frozen=True, kw_only=True)
class FittedLoop(Figures):
    """Bandwidth and margins of a force law on the fitted plant."""

    law: BankKeys


@dataclass(frozen=True, kw_only=True)
class Designed(DesignResult):
    """Result of the step design: the result of a design and more.

    `on_fitted`: {"before" and "designed": bandwidth and margins on the fitted plant, None without a
    law}. `objects`: values in the order of writing. `cut`: text about the gain reduction by
    simulated contacts. `times_p`: bandwidth divided by the bandwidth of the P law.
    """

    on_fitted: dict[str, FittedLoop | None]
    cut: str
    times_p: float | None
    objects: Settings


@dataclass(frozen=True, kw_only=True)
class ContactOfKind(SimulatedContact):
    """A contact that the step `simulate` has simulated. `kind` is "contact", "strike" (an impact
    follows the contact) or "set" (a random plant of the set of plants)."""

    kind: str


@dataclass(frozen=True)
class Simulated:
    """Result of `simulate`."""

    contacts: tuple[ContactOfKind, ...]


@dataclass(frozen=True)
class Written:
    """Result of `write`: state of the certificate on the axis, and number of written objects."""

    certificate_state: str
    objects: int


@dataclass(frozen=True, kw_only=True)
class LoopPeak:
    """Peak of the sensitivity function: the largest measured |S| with its standard error and
    frequency in Hz, and the largest |S| of the fitted model at the same frequencies.

    `lines` is the number of frequencies at which |S| is certain.
    """

    Ms: float
    Ms_error: float
    Ms_hz: float
    Ms_predicted: float
    lines: int


@dataclass(frozen=True, kw_only=True)
class TouchDownPeaks:
    """The largest force of a first contact in N, as recorded and as simulated on the fitted plant.
    The simulated value is None if the simulated force does not settle."""

    peak_N: float
    peak_predicted_N: float | None


@dataclass(frozen=True, kw_only=True)
class VerifiedResponse(TouchDownPeaks, LoopPeak, ResponseFigures):
    """The response with the new law, the peak of |S|, and the largest force of the first
    contact."""

    bias_N: float = field()


@dataclass(frozen=True)
class Verified:
    """Result of `verify`: {folder of the response: numbers of the response}."""

    levels: dict[str, VerifiedResponse]


@dataclass(frozen=True)
class Stored:
    """Result of `store`. `why` is the reason that an axis without memory for parameters gives."""

    stored: bool
    why: str | None = json_field(omit_none=True)


@dataclass(frozen=True)
class StepRefusal:
    """A step that ended with a Refusal: name of the step, name and text of the Refusal. `lines` is
    TOML to add to the model."""

    step: str
    name: str
    text: str
    lines: str | None = json_field(omit_none=True)


@dataclass(frozen=True, kw_only=True)
class TuningSummary:
    """Results of a tuning.

    A field is None if the result is not known yet. `levels`: levels of Verified. `cuts`: texts of
    the gain_cuts. `holds`: texts of tune_fit.validity_lines(). `seconds`: {step: wall time in s}.
    `axis_seconds`: {step: time of the axis in s}.
    """

    axis: str
    folder: str
    parameters: dict[str, ParameterRow] | None = None
    bank: BankFigures | None = None
    worst: WorstFigures | None = None
    p: P | None = None
    on_fitted: dict[str, FittedLoop | None] | None = None
    limited_by: str | None = None
    cut: str | None = None
    cuts: tuple[str, ...] = ()
    simulated: tuple[SimulatedContact, ...] = ()
    holds: tuple[str, ...] = ()
    Ms_predicted: float | None = None
    Ms_verified: float | None = None
    levels: dict[str, VerifiedResponse] | None = None
    certificate_state: str | None = None
    stored: bool = False
    times_p: float | None = None
    friction: tuple[FrictionElement, ...] | None = None
    friction_lines: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    axis_seconds: dict[str, float] = field(default_factory=dict)
    refused: StepRefusal | None = None
