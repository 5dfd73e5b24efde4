"""Results of the analysis of one force loop as dataclasses: critical gain, margins, poles and step
response."""

import math
from dataclasses import dataclass, replace

import numpy as np

from forceaxis import _core, paths
from forceaxis.errors import ParameterError
from forceaxis.linear import loops, over, working
from forceaxis.linear import system as linear
from forceaxis.linear.bank import GAIN_STEP, Bank, BankKeys
from forceaxis.linear.equations import Matrix
from forceaxis.linear.precise import Figures
from forceaxis.linear.request import LoopRequest
from forceaxis.linear.settings import ModelSettings
from forceaxis.linear.stability import Crossing, Limit, Loop, Margins
from forceaxis.linear.system import System
from forceaxis.linear.working import Working
from forceaxis.results import json_field


@dataclass(frozen=True, kw_only=True)
class AnalysedLoop:
    """Description of the force loop that was analysed, for the JSON output.

    model: path of the model. parameters: parameters of the law in SI units. timing: a name of
    loops.TIMINGS, or several names joined by "and". output: the controlled signal. working: states
    of the elements, or None if no element has different states. bank: coefficients of the law, or
    None for a law without a filter bank.
    """

    model: str
    law: str
    parameters: dict[str, float]
    timing: str
    output: str
    working: Working | None = json_field(inline=True)
    bank: BankKeys | None = json_field(omit_none=True)

    @classmethod
    def of(cls, loop: Loop) -> "AnalysedLoop":
        """Returns the description of the force loop `loop`."""
        return cls(
            model=paths.display(loop.model),
            law=loop.law,
            parameters=loop.parameters,
            timing=loop.timing,
            output=loop.signal,
            working=loop.working.shown,
            bank=loop.bank.keys() if loop.bank else None,
        )


@dataclass(frozen=True, kw_only=True)
class LoopAtGain:
    """Bandwidths and margins of a force loop at one gain k, in the unit of the loop.
    `firmware_gain`: k in DAC codes per 8-bit count, or None if the loop does not feed back ADC 0.
    `dead_law`: reason why the law gives no command for any force that the sensor measures. It is
    None if the law gives a command."""

    gain: float
    firmware_gain: float | None
    dead_law: str | None = json_field(omit_none=True)
    figures: Figures = json_field(inline=True)
    margins: Margins = json_field(inline=True)


@dataclass(frozen=True, kw_only=True)
class LimitResult:
    """The critical gain of a force loop, the gains at which a closed-loop pole crosses the
    stability boundary, and the ranges of stable gains.

    critical_gain: gain in `unit`. None if the loop is stable at every gain, or at every gain up to
    known_to. 0 if the loop is unstable at every small gain, see `reason`. frequency_hz: frequency
    at which the pole crosses the stability boundary. firmware_gain: the critical gain in DAC codes
    per 8-bit count. largest_firmware_gain: largest value below it that the firmware can store. at:
    the loop at the gain of the request.
    """

    critical_gain: float | None
    unit: str
    frequency_hz: float | None
    crossings: list[Crossing]
    stable_ranges: list[tuple[float, float | None]]
    reason: str | None
    known_to: float | None
    loop: AnalysedLoop = json_field(inline=True)
    firmware_gain: float | None
    largest_firmware_gain: float | None
    at: LoopAtGain | None = json_field(omit_none=True)


@dataclass(frozen=True)
class StepResponse:
    """Response of a closed force loop to a unit step of the set-point at time 0.

    rise_s: time from 10 to 90 % of the final value. settle_s: time from which on the signal stays
    within 2 % of the final value. overshoot: share of the final value. These three fields are None
    if the signal does not reach the value within the duration, if the final value is 0, or if the
    loop is unstable. final: final value, or None for an unstable loop. value: signal at the times
    time_s.
    """

    stable: bool
    rise_s: float | None
    settle_s: float | None
    overshoot: float | None
    final: float | None
    time_s: Matrix
    value: Matrix


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """The step response of a force loop at a gain k in `unit`. `firmware_gain`: k in DAC codes per
    8-bit count, or None if the loop does not feed back ADC 0."""

    loop: AnalysedLoop = json_field(inline=True)
    gain: float
    unit: str
    firmware_gain: float | None
    response: StepResponse = json_field(inline=True)


@dataclass(frozen=True)
class Root:
    """A pole or a zero: real and imaginary part in 1/s, magnitude in Hz, and damping ratio. These
    four values are None for an infinite root. `re_z`, `im_z`: real and imaginary part of z for a
    root of a sampled system."""

    re_per_s: float | None
    im_per_s: float | None
    hz: float | None
    damping_ratio: float | None
    re_z: float | None = json_field(omit_none=True)
    im_z: float | None = json_field(omit_none=True)


@dataclass(frozen=True)
class ClosingGain:
    """The gain k at which a force loop is closed, in `unit` and in DAC codes per 8-bit count. The
    value in DAC codes is None if the loop does not feed back ADC 0."""

    gain: float
    unit: str
    firmware_gain: float | None


@dataclass(frozen=True, kw_only=True)
class ClosedLoop:
    """Description of the closed force loop to which the computed poles belong."""

    loop: AnalysedLoop = json_field(inline=True)
    closed: ClosingGain

    @property
    def model(self) -> str:
        """Path of the model of the plant."""
        return self.loop.model

    @property
    def timing(self) -> str:
        """Delay of the force loop by its name in loops.TIMINGS, such as zoh+1."""
        return self.loop.timing

    @property
    def working(self) -> Working | None:
        """States of the switching elements of the plant, such as contacts, or None if the model has
        no such element."""
        return self.loop.working


@dataclass(frozen=True, kw_only=True)
class AnalysedPlant:
    """Description of the plant to which the computed poles belong: path of the model, delay of the
    input, and states of the switching elements. The states are None if the model has no such
    element."""

    model: str
    timing: str
    working: Working | None = json_field(inline=True)


@dataclass(frozen=True, kw_only=True)
class PolesResult:
    """Poles, zeros and transfer function of a plant or force loop between one input and one output.

    gain: factor g in g prod(s - zero) / prod(s - pole). numerator, denominator: coefficients, with
    the highest power first. The first coefficient of the denominator is 1.
    """

    subject: AnalysedPlant | ClosedLoop = json_field(inline=True)
    input: str
    output: str
    stable: bool
    poles: list[Root]
    zeros: list[Root]
    gain: float
    numerator: Matrix
    denominator: Matrix


def largest_firmware_gain(loop: Loop, limit: Limit) -> float | None:
    """Returns the largest value of `force_gain` below the critical gain that the firmware can
    store. Returns None if there is no such value, or if the model has no measured force."""
    gain = limit.stable_to
    if loop.codes_per_gain is None or gain == 0:
        return None
    if gain is None:
        return loops.FIRMWARE_HIGHEST
    steps = math.ceil(loop.firmware_gain(gain) / GAIN_STEP) - 1
    return min(steps * GAIN_STEP, loops.FIRMWARE_HIGHEST) if steps > 0 else None


def limit_result(loop: Loop, gain: float | None = None) -> LimitResult:
    """Returns the critical gain of a force loop. If the gain `gain` is given, the result also has
    the bandwidths and margins at this gain."""
    limit = loop.limit()
    return LimitResult(
        critical_gain=limit.gain,
        unit=loop.unit,
        frequency_hz=limit.frequency_hz,
        crossings=limit.crossings,
        stable_ranges=limit.stable_ranges,
        reason=limit.reason or None,
        known_to=limit.known_to,
        loop=AnalysedLoop.of(loop),
        firmware_gain=loop.optional_firmware_gain(limit.gain),
        largest_firmware_gain=largest_firmware_gain(loop, limit),
        at=None if gain is None else loop_at(loop, gain),
    )


def loop_at(loop: Loop, gain: float) -> LoopAtGain:
    """Returns the bandwidths and margins of a force loop at a gain k."""
    return LoopAtGain(
        gain=gain,
        firmware_gain=loop.optional_firmware_gain(gain),
        dead_law=dead_law(loop, gain),
        figures=over.figures(loop, gain),
        margins=loop.margins(gain),
    )


def dead_law(loop: Loop, gain: float) -> str | None:
    """Returns a text if the control law at a gain k rounds its output to 0 for every force that the
    sensor measures. Otherwise returns None."""
    force_gain = loop.optional_firmware_gain(gain)
    if not force_gain or loop.law not in ("p", "pi", "bank"):
        return None
    known = linear.facts(loop.model)
    whole = 128 * abs(known.required_reading.per_count)
    bank = replace(loop.bank or Bank(0.0), force_gain=force_gain)
    return known.dead_law(bank.gain_at_rest(), whole)


def hz_text(hz: float | None, digits: int = 4) -> str:
    """Returns a frequency as text, such as "at 12 Hz". None stands for an infinite frequency."""
    return "at infinite frequency" if hz is None else f"at {hz:.{digits}g} Hz"


def _figures(
    time_s: Matrix, value: Matrix, final: float, duration_s: float
) -> tuple[float | None, float | None, float | None]:
    """Returns (rise_s, settle_s, overshoot) of a step response: the rise time, settling time and
    overshoot. The array `value` also contains the response after `duration_s`.

    The response is settled if the signal stays within 2 % to the end of `value`. A returned value
    is None if the signal does not reach it within duration_s, or if the final value is 0.
    """
    if final == 0:
        return None, None, None
    share = value / final
    low, high = (time_s[share >= part][:1] for part in (0.1, 0.9))
    after = np.max(np.flatnonzero(np.abs(share - 1) >= 0.02), initial=-1) + 1
    peak = share.argmax()
    settled = after < len(time_s) and time_s[after] <= duration_s
    seen = settled or (share[peak] > 1 and time_s[peak] <= duration_s)
    return (
        float(high[0] - low[0]) if len(high) and high[0] <= duration_s else None,
        float(time_s[after]) if settled else None,
        float(max(share[peak] - 1, 0)) if seen else None,
    )


def step_response(loop: Loop, gain: float, duration_s: float) -> StepResponse:
    """Returns the step response of a force loop at a gain k. Raises ParameterError if `duration_s`
    is below two ticks or above 600 s, or if the response is unstable and exceeds the range of
    double precision."""
    if not (2 * linear.TICK_S <= duration_s <= 600):
        raise ParameterError(
            "duration_s", f"expected a duration from two ticks to 600 s, got {duration_s:g}"
        )
    stable = loop.stable(gain)
    # A settled signal stays within 2 % of its final value. To see this, twice the time is computed.
    time_s, value = loop.step(gain, 2 * duration_s if stable else duration_s)
    within = time_s <= duration_s * (1 + 1e-12)
    final: float | None = None
    figures: tuple[float | None, float | None, float | None] = (None, None, None)
    if stable:
        final = float(loop.closed(gain).at(0.0 if loop.dt is None else 1.0).real)
        if not abs(final) > 1e-9 * np.abs(value).max():
            final = 0.0
        figures = _figures(time_s, value, final, time_s[within][-1])
    time_s, value = time_s[within], value[within]
    if not np.isfinite(value).all():
        raise ParameterError(
            "duration_s",
            "expected a response within the range of floating-point numbers, but the response "
            f"exceeds this range within {duration_s:g} s; use a shorter duration or a lower gain",
        )
    return StepResponse(stable, *figures, final, time_s, value)


def step_result(loop: Loop, gain: float, duration_s: float) -> StepResult:
    """Returns the step response of a force loop at a gain k, together with a description of the
    loop. Arguments and errors are the same as for step_response()."""
    return StepResult(
        loop=AnalysedLoop.of(loop),
        gain=gain,
        unit=loop.unit,
        firmware_gain=loop.optional_firmware_gain(gain),
        response=step_response(loop, gain, duration_s),
    )


def _root(value: complex, dt: float | None) -> Root:
    """Returns an eigenvalue as a Root. The eigenvalue is in 1/s if `dt` is None. Otherwise it is a
    value of z for a system that is sampled every `dt` seconds."""

    def number(x: float) -> float | None:
        return float(x) if np.isfinite(x) else None

    with np.errstate(divide="ignore", invalid="ignore"):
        s = complex(value) if dt is None else complex(np.log(complex(value)) / dt)
        size = abs(s)
        root = Root(
            number(s.real),
            number(s.imag),
            number(size / (2 * math.pi)),
            number(-s.real / size) if size and np.isfinite(size) else None,
        )
    return root if dt is None else replace(root, re_z=float(value.real), im_z=float(value.imag))


def _poles_result(system: System, subject: AnalysedPlant | ClosedLoop) -> PolesResult:
    """Returns the poles and zeros of a System with one input and one output as a PolesResult."""

    def ordered(values: Matrix) -> list[complex]:
        return sorted(
            values.astype(complex), key=lambda v: (abs(v - (system.dt is not None)), v.imag)
        )

    numerator, denominator = system.transfer_function()
    return PolesResult(
        subject=subject,
        input=system.inputs[0],
        output=system.outputs[0],
        stable=system.stable(),
        poles=[_root(p, system.dt) for p in ordered(system.poles())],
        zeros=[_root(z, system.dt) for z in ordered(system.zeros())],
        gain=system.gain(),
        numerator=numerator,
        denominator=denominator,
    )


GAIN_EXPECTED = (
    "expected `gain` or `firmware_gain` together with a law, because only a gain closes the loop; "
    "add a gain or remove the law"
)


def poles_of(request: LoopRequest, input: str | None, output: str | None) -> PolesResult:
    """Returns the poles and zeros of the force loop of `request`, closed at the gain of the
    request. Without a gain, or with an input, returns the poles and zeros of the plant instead.
    `input`: None means drive.command. `output`: None means the measured force."""
    own = request.settings(plant=input is not None)
    if not request.has_gain and (input is not None or request.law_of(own).firmware_gain is None):
        if request.law not in (None, "p") or request.parameters or request.firmware_law:
            raise ParameterError("law", GAIN_EXPECTED)
        return _plant_poles(request, own, input or "drive.command", output or "reading")
    if input is not None:
        raise ParameterError(
            "input",
            "expected no input together with a gain, because the input of a closed loop is the "
            "set-point; remove the input or the gain",
        )
    loop = replace(request, output=output or "reading").loop()
    gain = request.gain_of(loop)
    if gain is None:  # The control law of the request differs from that of the experiment.
        raise ParameterError("law", GAIN_EXPECTED)
    closing = ClosingGain(gain, loop.unit, loop.optional_firmware_gain(gain))
    return _poles_result(loop.closed(gain), ClosedLoop(loop=AnalysedLoop.of(loop), closed=closing))


def _plant_poles(request: LoopRequest, own: ModelSettings, input: str, output: str) -> PolesResult:
    """Returns the poles and zeros of the plant of `request` between an input and an output."""
    path, overrides = linear.find_model(own.model), own.overrides
    if output == "reading" and linear.facts(path, overrides).reading is None:
        raise loops.no_reading(str(path))
    mode = working.working(path, overrides, request.states, request.free)

    def plant_in(states: dict[str, str]) -> System:
        return linear.linearise(path, (input,), (output,), overrides, states, request.free)

    plant = plant_in(mode.modes)
    if not plant.has_path():
        cut = working.cut_by(path, overrides, mode.modes, lambda m: plant_in(m).has_path())
        raise _core.InputError(
            f"{path}: output: expected a signal path from {input} to {output}, got none in this "
            f"mode{cut or '; choose another output or mode'}"
        )
    timing = request.timing or "continuous"
    if timing != "continuous":
        linear.facts(path, overrides).expect_no_bus("poles of a sampled plant")
        plant = plant.sampled(delay_ticks=loops.TIMINGS.index(timing) - 1)
    return _poles_result(
        plant, AnalysedPlant(model=paths.display(path), timing=timing, working=mode.shown)
    )
