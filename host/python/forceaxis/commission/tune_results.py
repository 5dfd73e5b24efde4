"""Results of the steps of a tuning. The results have the same fields as the files in the folder of
the tuning.

The result of each step is a frozen dataclass. The module forceaxis.results converts it to JSON and
back, so that the names of the fields are the keys in the files. Forces are in N, frequencies in Hz,
stiffnesses in N/m, masses in kg, positions in encoder counts, amplitudes in DAC codes.
"""

from dataclasses import dataclass, field

from forceaxis.commission import sine_excitation
from forceaxis.commission.friction_models import FrictionElement
from forceaxis.commission.joint_fit import JointSummary
from forceaxis.commission.level import Abort, Rest
from forceaxis.commission.unexplained import Unexplained
from forceaxis.design.banks import BankFigures
from forceaxis.design.cases import SimulatedContact
from forceaxis.design.certificate import P, WorstFigures
from forceaxis.design.outcome import DesignResult
from forceaxis.linear.bank import BankKeys
from forceaxis.linear.precise import Figures
from forceaxis.results import json_field

Setting = int | float | str  # engineering value of an object, or text of an enumeration
Settings = dict[str, Setting]  # {name of the object: its value}
Values = dict[str, float]  # {parameter of the model: value in SI units}
Range = tuple[float, float]  # ends of a range: (low, high)


@dataclass(frozen=True)
class Checked:
    """Result of the step `check`. `settings`: values, computed from the model, for objects that are
    not set on the axis.

    `law`: objects of the force law with which the responses are measured. `band_hz`: lowest and
    highest frequency of the responses. `before`: the previous force law of the axis.
    `latency_ticks`: latency in ticks with which the axis outputs a DAC code. `averages`: number of
    realisations of each response in contact; 0: that of the request, or fewer if they suffice.
    `ms`: limit of Ms for the design; 0: that of the request.
    """

    rest: Rest
    settings: Settings
    law: BankKeys
    band_hz: Range
    before: BankKeys
    latency_ticks: int
    averages: int = 0
    ms: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ResponseFigures:
    """Numbers of a measured response.

    `swing`: peak-to-peak range of the output, in N in contact, in encoder counts out of contact.
    `speed_rms`: rms rate of change of the output that the excitation alone causes, in N/s or
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
    """The fields of a friction.Glide. `rubs` is True if the axis has friction out of contact. Dead
    zone and difference are in DAC codes, `rate` is in counts/s per DAC code. The friction
    `moving_N` is in N; it is None if the current is not measured."""

    dead_zone: float
    rate: float
    codes: int
    rubs: bool
    difference: float
    moving_N: float | None = None


@dataclass(frozen=True, kw_only=True)
class FreeResponse(ResponseFigures):
    """Result of the step `free`: the response out of contact, and the friction that was measured
    before it."""

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
    """The friction.SlowLoading between the smallest and the largest force. The fields have the
    names of the keys in the file. `creep` and `creep_s` are None if the workpiece does not relax.
    `force_N` and `way` are block means of the recording, in N and encoder counts."""

    friction_N: float
    sticks: bool
    compliance: float
    sliding: float
    low_N: float
    high_N: float
    softest_N: float | None = None
    softest: float | None = None
    creep: float | None = None
    creep_s: float | None = None
    bends: tuple[float, float] = (1.0, 1.0)
    way: tuple[float, ...] = ()
    force_N: tuple[float, ...] = ()


@dataclass(frozen=True)
class MeasuredResponses:
    """Result of the step `measure`, which is written to three files.

    `levels`: {folder of a response: numbers of the response}. `between`: result of the slow change
    of the force. `shaken`: result of the test with sines, or None if the workpiece did not slide.
    """

    levels: dict[str, PressedResponse]
    between: SlowChange
    shaken: sine_excitation.SineTestResult | None


@dataclass(frozen=True)
class ParameterRow:
    """A fitted parameter: its SI value, its 95 % interval, and its unit."""

    value: float
    interval: Range
    unit: str


@dataclass(frozen=True, kw_only=True)
class Fitted(JointSummary):
    """Result of the step `fit`. `values`: values of the parameters for the design.

    `own`: {response: values of the parameters that belong only to this response}. `friction`: the
    measured dry friction. `lines`: the friction elements that have to be added to the model, as
    TOML text. `left_out`: responses that were not used, because the backlash of the gear opens.
    `relied`: texts about parameters whose value in the design differs from the fit. `together`:
    parameters that change together in the set of plants. `unexplained`: for each response in
    contact, what the model does not explain; it is empty if the model explains all responses.
    `why_not`: what the model may lack in that case.
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
    unexplained: dict[str, Unexplained] = field(default_factory=dict)
    why_not: str = ""


@dataclass(frozen=True, kw_only=True)
class FittedLoop(Figures):
    """Bandwidth and margins of a force law on the fitted plant."""

    law: BankKeys


@dataclass(frozen=True, kw_only=True)
class Designed(DesignResult):
    """Result of the step `design`. It has the fields of a DesignResult and additional fields.

    `on_fitted`: bandwidth and margins with the fitted plant, for the laws "before" and "designed";
    None if there is no such law. `objects`: values of objects in the order in which they are
    written. `cut`: text about the reduction of the gain because of simulated contacts. `times_p`:
    bandwidth divided by that of the P law.
    """

    on_fitted: dict[str, FittedLoop | None]
    cut: str
    times_p: float | None
    objects: Settings


@dataclass(frozen=True, kw_only=True)
class ContactOfKind(SimulatedContact):
    """A contact that the step `simulate` has simulated. `kind` is "contact", "strike" (with an
    impact after the contact) or "set" (with a random plant of the set of plants)."""

    kind: str


@dataclass(frozen=True)
class Simulated:
    """Result of the step `simulate`."""

    contacts: tuple[ContactOfKind, ...]


@dataclass(frozen=True)
class Written:
    """Result of the step `write`: state of the certificate in the axis, and number of written
    objects."""

    certificate_state: str
    objects: int


@dataclass(frozen=True, kw_only=True)
class LoopPeak:
    """Peak of the sensitivity function S. It has the largest measured |S| with its standard error
    and its frequency in Hz, and the largest |S| of the fitted model at the same frequencies.

    `lines` is the number of frequencies at which |S| is certain.
    """

    Ms: float
    Ms_error: float
    Ms_hz: float
    Ms_predicted: float
    lines: int


@dataclass(frozen=True, kw_only=True)
class TouchDownPeaks:
    """The largest force in N of a first contact: the recorded value, and the value that was
    simulated with the fitted plant. The simulated value is None if the simulated force does not
    settle."""

    peak_N: float
    peak_predicted_N: float | None


@dataclass(frozen=True, kw_only=True)
class VerifiedResponse(TouchDownPeaks, LoopPeak, ResponseFigures):
    """The numbers of the response with the new force law, the peak of |S|, and the largest force of
    the first contact."""

    bias_N: float = field()


@dataclass(frozen=True)
class Verified:
    """Result of the step `verify`: {folder of a response: numbers of the response}."""

    levels: dict[str, VerifiedResponse]


@dataclass(frozen=True)
class Stored:
    """Result of the step `store`. `why`: reason that the axis states if it has no memory for
    parameters."""

    stored: bool
    why: str | None = json_field(omit_none=True)


@dataclass(frozen=True)
class StepRefusal:
    """A step that ended with a Refusal: name of the step, and name and text of the Refusal.
    `lines`: TOML text to add to the model. `model`: path of a model with these lines."""

    step: str
    name: str
    text: str
    lines: str | None = json_field(omit_none=True)
    model: str | None = json_field(omit_none=True)


@dataclass(frozen=True, kw_only=True)
class TuningSummary:
    """Results of a tuning.

    A field is None if its value is not known yet. `levels`: field `levels` of Verified. `cuts`:
    texts about the reductions of the gain. `holds`: texts of tune_fit.validity_lines(). `seconds`:
    {step: duration in s by the wall clock}. `axis_seconds`: {step: duration in s by the clock of
    the axis}.
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
