"""Measures the frequency responses of an axis, out of contact and at several forces."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forceaxis import _core, linear, objects
from forceaxis.axis import actions, bounds
from forceaxis.axis.axis import Axis
from forceaxis.commission import friction_search
from forceaxis.commission.analyzer import QUIET_LSB, SWING, Analyzer
from forceaxis.commission.friction import FrictionSummary
from forceaxis.commission.level import Abort, Level, MeasuringOrder, Rest
from forceaxis.identify import result
from forceaxis.identify.measurement import COHERENT, Comparison, Readings
from forceaxis.results import json_field

FREE = "free"


@dataclass(frozen=True, kw_only=True)
class AxisMeasurementSummary:
    """The summary of a measured response of an axis.

    amplitude: amplitude of the excitation in DAC codes. bias_N: mean force in N, or None out of
    contact. force_min_N, force_max_N: smallest and largest measured force in N. swing: peak-to-peak
    range of the output, in N in contact, in encoder counts out of contact. speed_rms: rms rate of
    change of the output, in N/s or encoder counts/s. noise_lsb: rms noise in ADC codes. distorted:
    difference between the first realisations, divided by their noise. coherent: number of the
    `points` whose coherence is above 0.9. comparison: comparison with the model, or None if there
    is no model. friction: dry friction, or None if it was not searched.
    """

    measurement: str
    title: str
    figure: str = ""
    input: str
    output: str
    unit: str
    amplitude: int
    bias_N: float | None
    force_min_N: float | None
    force_max_N: float | None
    swing: float
    noise_lsb: float | None
    speed_rms: float
    distorted: float
    aborts: tuple[Abort, ...]
    of_loop: bool
    rest: Rest
    force_max_allowed_N: float | None
    averages: int
    band_hz: tuple[float, float]
    coherence_median: float
    coherent: int
    points: int
    random_error_median: float
    comparison: Comparison | None
    readings: Readings
    hints: tuple[str, ...]
    seed: int
    firmware_hash: str
    objects_hash: str
    friction: FrictionSummary | None = json_field(omit_none=True)


AxisMeasurement = result.MeasurementResult[AxisMeasurementSummary]


def measure(
    axis: Axis, order: MeasuringOrder, forces: Sequence[float] = (), free: bool = False,
    model: str | Path = "", overrides: linear.Overrides | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> dict[str, AxisMeasurement]:  # fmt: skip
    """Measures one response out of contact, if `free` is True, and one response in contact at each
    of the `forces` in N. Returns {name: response}.

    The axis must be owned by this program, disabled and at rest. At the end, the axis is disabled
    at its start position.

    model: path of a model with which the response is compared, or "". Raises InputError if the axis
    would limit a target; the axis has not moved in this case. Also raises Refusal, NoAnswer,
    Refused.
    """
    done: dict[str, AxisMeasurement] = {}
    actions.expect_position_gain(axis)
    for force in forces:
        bounds.expect_force(axis, force, SWING)
    if order.amplitude:
        bounds.expect(axis, {"excitation_code": order.amplitude})
    with Analyzer(axis, order, model, overrides, say) as analyzer:
        rest = analyzer.rest()
        search = (
            friction_search.FrictionSearch(analyzer, str(model), overrides)
            if order.finds_friction
            else None
        )
        if free:
            say("apart, commands to the encoder")
            if search:
                search.apart()
            done[FREE] = _taken(analyzer, analyzer.free(), rest, search)
        if forces and search:
            say("a slow change of the force, for friction")
            search.between(tuple(forces))
        for force in forces:
            say(f"in contact with {force:g} N: response from the codes to the measured force")
            level = analyzer.contact(force)
            done[f"{force:g}N"] = _taken(analyzer, level, rest, search)
        if forces:
            analyzer.go_home()
    return done


def _taken(
    analyzer: Analyzer,
    level: Level,
    rest: Rest,
    search: friction_search.FrictionSearch | None,
) -> AxisMeasurement:
    """Returns the result of a measured response, including the friction that `search` has found."""
    if search:
        search.expect_sliding(level)
    done = result_of(analyzer, level, rest)
    if not search:
        return done
    return replace(
        done, summary=replace(done.summary, friction=friction_search.summary(search.found, level))
    )


def hints(level: Level, rest: Rest) -> list[str]:
    """Returns texts about conditions of the measurement because of which the error of a response is
    larger than its confidence band."""
    texts = []
    noise = level.noise_lsb if rest.noise_lsb is None else rest.noise_lsb
    if noise is not None and noise < QUIET_LSB:
        texts.append(
            f"the noise of the measured force is {noise:.2g} codes rms, below {QUIET_LSB:g}: its "
            "rounding is no random error, so the confidence band may be too narrow; an ADC with "
            "more bits would help"
        )
    coherent = level.measured.coherence > COHERENT
    if coherent.mean() < 0.5:
        remedy = "measure with a larger force, more averages or a narrower band"
        distorted = [abort.amplitude for abort in level.aborts if abort.why == "distorted"]
        if distorted and level.amplitude < max(distorted):
            remedy = (
                f"{max(distorted)} codes became {level.amplitude} because the response was "
                "distorted, as by dry friction or backlash; give the amplitude with `level`, the "
                "same for all measurements that are compared, or let `tune` measure"
            )
        texts.append(
            f"coherence above {COHERENT:g} at {100 * coherent.mean():.2g} % of the frequencies: "
            + remedy
        )
        if not level.measured.model:
            texts.append(
                "without a model the measurement does not know the bus of a drive and the clock of "
                "a converter, whose cycles reduce the coherence: give `model`"
            )
    return texts


def result_of(analyzer: Analyzer, level: Level, rest: Rest) -> AxisMeasurement:
    """Returns the result of a measured response, without an entry about friction."""
    measured = level.measured
    model = measured.predict() if measured.model else None
    most_N = analyzer.force_max_N
    where = "apart" if measured.free else f"pressed with {level.bias_N:.4g} N"
    title = f"{analyzer.axis.link.where}, {where}"
    summary = AxisMeasurementSummary(
        measurement=analyzer.axis.link.where,
        title=title,
        input=measured.input,
        output=measured.output,
        unit=measured.unit,
        amplitude=level.amplitude,
        bias_N=level.bias_N,
        force_min_N=level.force_min_N,
        force_max_N=level.force_max_N,
        swing=level.swing,
        noise_lsb=level.noise_lsb,
        speed_rms=level.speed_rms,
        distorted=level.distorted,
        aborts=tuple(level.aborts),
        of_loop=level.of_loop,
        rest=rest,
        force_max_allowed_N=most_N if np.isfinite(most_N) else None,
        averages=measured.averages,
        band_hz=(float(measured.frequency_hz[0]), float(measured.frequency_hz[-1])),
        coherence_median=float(np.median(measured.coherence)),
        coherent=int((measured.coherence > COHERENT).sum()),
        points=len(measured.coherence),
        random_error_median=float(np.median(measured.random_error())),
        comparison=None if model is None else measured.compare(model),
        readings=measured.readings(),
        hints=tuple(hints(level, rest)),
        seed=analyzer.order.seed,
        firmware_hash=_core.FIRMWARE_HASH,
        objects_hash=objects.OBJECTS_HASH,
    )
    return AxisMeasurement(None, measured, model, summary, title)
