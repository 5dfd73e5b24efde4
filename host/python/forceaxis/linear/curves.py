"""Frequency responses of plants and force loops as curves for Bode and Nyquist plots."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.linear import limits, loops, working
from forceaxis.linear import system as linear
from forceaxis.linear.equations import Numbers, Roots
from forceaxis.linear.limits import AnalysedLoop, LimitResult, LoopAtGain
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.request import LoopRequest, varied
from forceaxis.linear.stability import Loop
from forceaxis.linear.system import System
from forceaxis.linear.working import States, Working
from forceaxis.results import json_field

NYQUIST_HZ = (0.05, 2000.0)


def _loop_gain(loop: Loop, gain: float) -> System:
    open_loop = loop.open
    return replace(open_loop, C=gain * open_loop.C, D=gain * open_loop.D)


# {name of a transfer function of a force loop: function that returns it as a System at a gain}
PARTS: dict[str, Callable[[Loop, float], System]] = {
    "loop": _loop_gain,
    "closed": lambda loop, gain: loop.closed(gain),
    "sensitivity": lambda loop, gain: loop.sensitivity(gain),
}


def phase_deg(frequency_hz: Numbers, response: Roots) -> Numbers:
    """Returns the phase of a frequency response in degrees without jumps of 360 degrees. The phase
    at the lowest frequency is chosen to fit the slope of the magnitude there.

    A response with a constant magnitude at the lowest frequencies starts at 0 degrees, or at -180
    degrees if it is negative. A response with an integrator starts at -90 degrees. A response that
    increases with the frequency starts at +90 degrees.
    """
    phase: Numbers = np.degrees(np.unwrap(np.angle(response)))
    if len(phase) < 2:
        return phase
    size = np.log(np.maximum(np.abs(response[:2]), 1e-300))
    slope = (size[1] - size[0]) / np.log(frequency_hz[1] / frequency_hz[0])
    turns = (90 * round(slope) - phase[0]) / 360
    # With a negative gain and a nearly constant magnitude, the phase curve starts at -180 degrees.
    result: Numbers = phase + 360 * np.ceil(turns - 0.55)
    return result


def grid_hz(
    low_hz: float, high_hz: float, roots: Iterable[complex] = (), points: int = 400
) -> Numbers:
    """Returns frequencies in Hz with equal logarithmic steps. Near lightly damped roots, the steps
    are smaller.

    roots: poles and zeros in 1/s. The smaller steps near a root are proportional to the width of
    its peak, so that no peak and no phase change falls between two frequencies.
    """
    grid = [np.geomspace(low_hz, high_hz, points)]
    widths = np.concatenate([[0.0], np.geomspace(0.1, 60, 32)])
    widths = np.concatenate([-widths[::-1], widths])
    for root in roots:
        natural, width = abs(root.imag) / (2 * np.pi), max(abs(root.real), 1e-6 * abs(root))
        if low_hz < natural < high_hz and width < 0.3 * abs(root):
            grid.append(natural + widths * width / (2 * np.pi))
    every = np.unique(np.concatenate(grid))
    return every[(every >= low_hz) & (every <= high_hz)]


@dataclass(frozen=True)
class CurveTable:
    """A frequency response for the JSON output, at the frequencies `frequency_hz`: magnitude in
    `unit`, and phase in degrees without jumps."""

    label: str
    unit: str
    frequency_hz: Numbers
    magnitude: Numbers
    phase_deg: Numbers


@dataclass(frozen=True)
class Curve:
    """A frequency response: complex values `response` at the frequencies `frequency_hz` in Hz."""

    label: str
    frequency_hz: Numbers
    response: Roots
    unit: str = ""  # unit of the response

    @property
    def magnitude(self) -> Numbers:
        """Magnitude of the frequency response in `unit`."""
        return np.abs(self.response)

    @property
    def phase_deg(self) -> Numbers:
        """Phase of the frequency response in degrees, without jumps of 360 degrees; see the
        function phase_deg()."""
        return phase_deg(self.frequency_hz, self.response)

    def table(self) -> CurveTable:
        """Returns the frequency response as a CurveTable for the JSON output."""
        return CurveTable(self.label, self.unit, self.frequency_hz, self.magnitude, self.phase_deg)


def curve(
    system: System, label: str, span_hz: tuple[float, float], unit: str = "", points: int = 400
) -> Curve:
    """Returns the frequency response of a System with one input and one output, between the two
    frequencies of span_hz = (low, high)."""
    low, high = span_hz
    if system.dt is not None:
        high = min(high, 0.5 / system.dt)
    roots = system.poles_s()
    if system.has_path():
        roots = np.concatenate([roots, system.zeros_s()])
    roots = roots[np.isfinite(roots)]
    frequency = grid_hz(low, high, roots, points)
    return Curve(label, frequency, system.response(frequency), unit)


@dataclass(frozen=True, kw_only=True)
class BodeCurve:
    """One curve of a Bode plot: the name of the output, the values of the curve, and the force loop
    with its margins at the plotted gain. The force loop is None if the frequency response has
    another input than the force loop."""

    output: str
    table: CurveTable = json_field(inline=True)
    loop: LimitResult | None = json_field(omit_none=True)


@dataclass(frozen=True, kw_only=True)
class LoopBode:
    """Frequency responses of a force loop. `of`: name of the shown transfer function, a key of
    PARTS."""

    loop: AnalysedLoop = json_field(inline=True)
    of: str
    input: str
    curves: list[BodeCurve]

    @property
    def working(self) -> Working | None:
        """States of the switching elements of the plant, such as contacts, or None if the plant has
        no such element."""
        return self.loop.working


@dataclass(frozen=True, kw_only=True)
class PlantBode:
    """Frequency responses of a plant from its input `input`. `of`: the text "plant". `timing`: name
    of the delay (a key of loops.TIMINGS), or the sampling period of a measurement. `working`:
    states of the switching elements of the plant, or None if it has no such element."""

    model: str
    of: str
    input: str
    timing: str
    working: Working | None = json_field(inline=True)
    curves: list[BodeCurve]


@dataclass(frozen=True, kw_only=True)
class NyquistResult:
    """The result of a Nyquist plot: the loop gain k L at its frequencies, the critical gain of the
    loop, and the margins of the loop at the plotted gain."""

    limit: LimitResult = json_field(inline=True)
    at: LoopAtGain
    frequency_hz: Numbers = json_field(key="frequency_hz_of_curve")
    real: Numbers
    imag: Numbers
    magnitude: Numbers
    phase_deg: Numbers


@dataclass(frozen=True)
class Channel:
    """Specification of one frequency response of a model: input, output, parameter values, and
    states of the elements of the model.

    input, output, overrides, modes, free, drive: as in `linear.linearise`. timing: "continuous", or
    a value as in LoopSpec.
    """

    input: str = "drive.command"
    output: str = "reading"
    overrides: Overrides = field(default_factory=dict)
    modes: States = field(default_factory=dict)
    free: bool = False
    drive: bool = True
    timing: str = "continuous"


def model_curve(
    model: str | Path,
    label: str,
    channel: Channel | None = None,
    span_hz: tuple[float, float] = (0.5, 500.0),
) -> Curve:
    """Returns the open-loop frequency response of a model in SI units. `channel`: input and output
    of the response. None selects the response from the command to the measured force.

    Raises InputError if the input does not act on the output.
    """
    own = channel or Channel()
    input = "drive.force" if not own.drive and own.input == "drive.command" else own.input
    path = linear.find_model(model)
    states = working.working(path, own.overrides, own.modes, own.free).modes

    def plant(states: dict[str, str]) -> System:
        return linear.linearise(
            path, (input,), (own.output,), own.overrides, states, own.free, own.drive
        )

    system = plant(states)
    if not system.has_path():
        cut = working.cut_by(path, own.overrides, states, lambda other: plant(other).has_path())
        raise InputError(
            f"{path}: expected a signal path from {input} to {own.output}, got none{cut}"
        )
    if own.timing != "continuous":
        linear.facts(path, own.overrides).expect_no_bus("the response of a sampled plant")
        system = system.sampled(loops.TIMINGS.index(own.timing) - 1)
    return curve(system, label, span_hz, unit_of(model, input, own.output, own.overrides))


def unit_of(model: str | Path, input: str, output: str, settings: Overrides | None = None) -> str:
    """Returns the unit of a frequency response, such as "N/V": the unit of the output divided by
    the unit of the input. Returns "" if both units are equal. `settings`: {parameter of the model:
    value}."""
    facts = linear.facts(model, settings)
    if output == "reading":
        output = facts.required_reading.signal
    # An output that is not in the table of signals is an ADC or the encoder. Its unit is the count.
    above = facts.signals.get(output, "count")
    below = "V" if input in ("drive.command", "drive.tach") else "N"
    return "" if above == below else f"{above}/{below}"


def check_span(span_hz: tuple[float, float], timing: str) -> None:
    """Raises InputError if the frequencies `span_hz` are outside of the range in which the
    frequency response is defined, for example above half the sampling rate."""
    low_hz, high_hz = span_hz
    highest = 1e6 if timing == "continuous" else 0.5 / linear.TICK_S
    if not (1e-6 <= low_hz < high_hz <= highest):
        raise ParameterError(
            "from_hz",
            f"expected FROM < TO, both within 1e-6 to {highest:g} Hz, got FROM {low_hz:g} and TO "
            f"{high_hz:g}",
        )


@dataclass(frozen=True)
class BodeView:
    """What a user selects for a Bode plot: transfer function of the loop, input, outputs,
    frequencies and varied parameters.

    part: "plant", or a name of PARTS. None selects the plant of a model, or the loop of an
    experiment. input, outputs: names of signals of the plant. span_hz: lowest and highest frequency
    in Hz. vary: texts NAME=VALUE,VALUE. The plot has one curve for each combination of values.
    """

    part: str | None = None
    input: str = "drive.command"
    outputs: tuple[str, ...] = ("reading",)
    span_hz: tuple[float, float] = (0.5, 500.0)
    vary: tuple[str, ...] = ()


def loop_bode_of(request: LoopRequest, view: BodeView, part: str) -> tuple[list[Curve], LoopBode]:
    """Returns (curves, result) for one transfer function of a force loop. There is one curve for
    each combination of the parameter values in `vary`."""
    curves, rows = [], []
    for label, values in varied(request.overrides, view.vary):
        loop = replace(request, overrides=values).loop()
        k = request.drawn_gain(loop)
        check_span(view.span_hz, loop.timing)
        one = curve(PARTS[part](loop, k), label, view.span_hz)
        curves.append(one)
        own = limits.limit_result(loop, k)
        rows.append(BodeCurve(output=part, table=one.table(), loop=own))
    return curves, LoopBode(loop=AnalysedLoop.of(loop), of=part, input="error", curves=rows)


def bode_of(request: LoopRequest, view: BodeView) -> tuple[list[Curve], PlantBode]:
    """Returns (curves, result) of the Bode plot of a plant. There is one curve for each output and
    each combination of the parameter values in `vary`."""
    timing = request.timing or "continuous"
    if request.has_gain and view.input != "drive.command":
        raise ParameterError(
            "gain",
            "expected `input` drive.command together with a gain, because the loop acts on this "
            "input; remove the gain or the input",
        )
    check_span(view.span_hz, timing)
    linear.once("output", view.outputs)
    curves, rows = [], []
    for label, given in varied(request.overrides, view.vary):
        own = replace(request, overrides=given).settings(plant=True)
        for output in view.outputs:
            name = ", ".join(filter(None, [label, output if len(view.outputs) > 1 else ""]))
            channel = Channel(
                view.input, output, own.overrides, request.states, request.free, timing=timing
            )
            one = model_curve(own.model, name, channel, view.span_hz)
            curves.append(one)
            limit = None
            if view.input == "drive.command":  # The only input of a force loop is drive.command.
                spec = loops.LoopSpec("p", timing, output, request.free)
                loop = spec.around(own.model, own.overrides, request.states)
                limit = limits.limit_result(loop, request.gain_of(loop))
            rows.append(BodeCurve(output=output, table=one.table(), loop=limit))
    path = linear.find_model(own.model)
    mode = working.working(path, own.overrides, request.states, request.free)
    return curves, PlantBode(
        model=own.model,
        of="plant",
        input=view.input,
        timing=timing,
        working=mode.shown,
        curves=rows,
    )


def nyquist_of(request: LoopRequest) -> NyquistResult:
    """Returns the curve of a Nyquist plot. Without a given gain, the plot uses half the critical
    gain, or the gain 1 if the loop has no critical gain."""
    loop = request.loop()
    gain = request.drawn_gain(loop)
    c = curve(loop.open, "", NYQUIST_HZ, points=1200)
    return NyquistResult(
        limit=limits.limit_result(loop),
        at=limits.loop_at(loop, gain),
        frequency_hz=c.frequency_hz,
        real=gain * c.response.real,
        imag=gain * c.response.imag,
        magnitude=gain * c.magnitude,
        phase_deg=c.phase_deg,
    )
