"""The steps `free` and `measure` of a tuning, and the settings of the axis for them."""

import contextlib
import datetime
import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from forceaxis import linear
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import TICKS_PER_S, NoAnswer, Refused
from forceaxis.commission import (
    analyzer,
    friction,
    known,
    machine_bounds,
    measuring,
    sine_excitation,
)
from forceaxis.commission.analyzer import (
    SWING,
    SWING_SLIDING,
    Analyzer,
    FewChanges,
    finest_resolution_hz,
)
from forceaxis.commission.friction import TRAVEL_MIN_CNT
from forceaxis.commission.friction_search import FORCE_TOLERANCE, LOWEST_FORCE_SHARE
from forceaxis.commission.level import MOST_CODES, Level, MeasuringOrder, Rest
from forceaxis.commission.refusal import Refusal
from forceaxis.commission.tune_folder import TuningFolder, TuningOrder, small_of
from forceaxis.commission.tune_results import (
    Checked,
    FreeResponse,
    GlideFigures,
    MeasuredResponses,
    PressedResponse,
    ResponseFigures,
    Settings,
    SlowChange,
)
from forceaxis.design import files, model_file
from forceaxis.design import simulate as simulation
from forceaxis.design.changes import Design
from forceaxis.identify import result as results
from forceaxis.linear import PlantFacts
from forceaxis.linear.bank import Bank
from forceaxis.linear.plant_set import PlantSet

A = TypeVar("A", bound=Analyzer)

# smallest number of averages with which the measurement of a response may end early
AVERAGES_MIN = 5
LINES_MIN = 25  # smallest number of spectral lines in the band, if the recorder permits it
# first amplitude of the excitation at each force, divided by the second amplitude
AMPLITUDE_RATIO = 3
# BAND_MAX_HZ: highest frequency of a response in contact.
# SAMPLED_BAND: highest frequency of a response, divided by the rate of the bus or of the sensor.
# The rate of the sensor matters only if the sensor has a clock of its own.
BAND_MAX_HZ, SAMPLED_BAND = 400.0, 0.4
# Lowest and highest frequency in Hz of the sines that move a workpiece.
SINE_MIN_HZ, SINE_MAX_HZ = 4.0, 150.0
# Number of time constants of the integral action after which a response in contact is recorded.
SETTLE_INTEGRALS = 4.0
# smallest force of a first contact, divided by `contact_force`
TOUCH_OVER_CONTACT = 2.0


def free(tuning: TuningFolder, checked: Checked) -> FreeResponse:
    """Measures the friction out of contact, and then the frequency response from the DAC code to
    the encoder."""
    settings = checked.settings
    with (
        returning(tuning, checked),
        analyzing(tuning, settings, measuring_order(tuning), Analyzer) as measures,
    ):
        measures.rest()
        drive = known.drive(tuning.model, measures.order.band_hz)
        most, travel = measures.order.most, measures.order.travel
        first = friction.first_code(most, travel, drive.rate)
        found = friction.glide(measures, most, tuning.say, first, drive=drive)
    asked = measuring_order(tuning, first=max(4, found.noise_codes), rubs=found.rubs)
    asked = replace(asked, travel=measures.order.travel)
    _, figures = take_response(tuning, "free", settings, asked, Analyzer, Analyzer.free)
    return FreeResponse(**vars(figures), glide=GlideFigures(**vars(found), rubs=found.rubs))


def free_line(tuning: TuningFolder, done: FreeResponse) -> str:
    """Returns the text about the result of the step `free`."""
    line = line_of("codes to the encoder", done)
    if done.glide.rubs:
        line += (
            f"; a dead zone of {done.glide.dead_zone:.2g} codes, dry friction of "
            f"{moving_N(tuning, done):.3g} N"
        )
    return line


@contextlib.contextmanager
def returning(tuning: TuningFolder, checked: Checked) -> Iterator[None]:
    """Context of a step that moves the axis. If a killed run has left the axis moving, the axis
    first moves back to its position in the step `check`. After a Refusal, the axis moves back to
    the position at which the step began, because near the workpiece the next run could not check
    it."""
    if tuning.coasted:
        _return(tuning, checked)
        tuning.coasted = False
    start = tuning.axis.integer("position")
    try:
        yield
    except Refusal:
        with contextlib.suppress(NoAnswer, Refused, Refusal):
            if abs(tuning.axis.integer("position") - start) > analyzer.STANDSTILL_CNT:
                go_home(tuning, checked, start)
        raise


def _return(tuning: TuningFolder, checked: Checked) -> None:
    """Moves an axis that a killed run has left back to its position in the step `check`, from any
    distance. Its position is valid, because the encoder continues to count while a fault is
    latched. Raises Refusal if the axis meets a workpiece on this way, which was free before."""
    axis, start = tuning.axis, checked.rest.position
    distance = abs(axis.integer("position") - start)
    tuning.say(
        "the axis returns to the position at which this tuning began, over "
        f"{distance / per_mm(tuning):.3g} mm"
    )
    with temporary(axis, checked.settings), analyzer_of(tuning) as measures:
        measures.home = axis.integer("position")
        is_free = not axis.integer("contact")
        if measures.go(start, until_contact=is_free).contact and is_free:
            measures.refuse_contact()


def moving_N(tuning: TuningFolder, free: FreeResponse) -> float:
    """Returns the dry friction of guide and gear in N. If the current of the drive is not measured,
    the friction is converted from DAC codes with the model. Returns 0 if there is no friction."""
    if not free.glide.rubs:
        return 0.0
    if free.glide.moving_N is not None:
        return free.glide.moving_N
    return free.glide.dead_zone * known.newton_per_code(tuning.model)


def measure(tuning: TuningFolder, checked: Checked, free: FreeResponse) -> MeasuredResponses:
    """Measures the compliance between the forces. Then measures, at each force and with two
    amplitudes, the frequency response from the DAC code to the measured force."""
    with returning(tuning, checked):
        return _measured(tuning, checked, free)


def _measured(tuning: TuningFolder, checked: Checked, free: FreeResponse) -> MeasuredResponses:
    levels: dict[str, PressedResponse] = {}
    first = 1
    averages = checked.averages or tuning.order.averages
    order = replace(tuning.order, band_hz=checked.band_hz, averages=averages)
    law = objects_of(tuning, checked, checked.law.bank, {}) | {"bump_decay_shift": 0}
    law |= force_objects(tuning)
    order_of = functools.partial(
        measuring_order, tuning, touch_N=first_contact_N(tuning, checked),
        settle_s=settling_s(checked.law.bank), fewest=checked.averages,
    )  # fmt: skip
    between, law = _between(tuning, law, order_of(order, rubs=free.glide.rubs), order)
    order = with_measured_way(tuning, order, between.way)
    workpiece_rubs = between.friction_N > 0
    shaken = None
    if workpiece_rubs:
        shaken = _shaken(tuning, law, order_of(order), between, free.glide.rate)
    rubs = workpiece_rubs or free.glide.rubs
    if rubs:
        first = max(1, math.ceil(friction.NOISE_SLIDES * free.glide.dead_zone))
    for force in tuning.order.forces:
        name = f"{force:g}N"

        def take(measures: Analyzer, force: float = force) -> Level:
            level = measures.contact(force)
            law["contact_loss_cap"] = tuning.axis.read("contact_loss_cap")
            return level

        asked = order_of(order, first=first, rubs=rubs)
        if rubs:
            asked = replace(asked, swing=SWING_SLIDING)
        _, figures = take_response(tuning, name, law, asked, Analyzer, take)
        small = max(1, figures.amplitude // AMPLITUDE_RATIO)
        smaller = None
        while smaller is None and small < figures.amplitude:
            asked = replace(order_of(order, rubs=True), amplitude=small)
            with contextlib.suppress(FewChanges):
                _, smaller = take_response(tuning, small_of(name), law, asked, Analyzer, take)
            small += 1
        levels[name] = PressedResponse(**vars(figures), small=smaller)
        first = next_amplitude(figures.amplitude, force, order.forces)
    go_home(tuning, checked)
    return MeasuredResponses(levels, between, shaken)


def measure_line(tuning: TuningFolder, done: MeasuredResponses) -> str:
    """Returns the text about the result of the step `measure`."""
    return "; ".join(line_of(name, level) for name, level in done.levels.items())


def go_home(tuning: TuningFolder, checked: Checked, home: int | None = None) -> None:
    """Moves the axis to `home` in encoder counts, by default its position in the step `check`.
    Otherwise a disabled axis with friction would stay in contact, and one without friction would
    coast away from the workpiece."""
    with temporary(tuning.axis, checked.settings), analyzer_of(tuning) as measures:
        measures.home = checked.rest.position if home is None else home
        measures.go_home()


def _between(
    tuning: TuningFolder, law: Settings, asked: MeasuringOrder, order: TuningOrder
) -> tuple[SlowChange, Settings]:
    """Changes the force slowly over all forces and over the range of the excitation. Returns two
    values: the result of this change, and the settings `law` with the present `contact_loss_cap` of
    the axis."""
    low, high = forces_between(order)
    with analyzing(tuning, law, asked, Analyzer) as measures:
        force, place, _ = friction.record_slow_change(measures, low, high)
        # An axis that is still in contact does not approach again.
        # The `contact_loss_cap` of the first contact therefore remains.
        law = law | {"contact_loss_cap": tuning.axis.read("contact_loss_cap")}
        # All friction is stated with the force scale of the model.
        force *= abs(linear.facts(tuning.model).required_reading.per_count) / measures.newton
    found = friction.slow_loading(force, place, known.rigid_counts(tuning.model))
    step = (found.high_N - found.low_N) / friction.FORCE_BINS
    if found.soft and all(abs(force - found.softest_N) > step for force in order.forces):
        forces = ",".join(f"{f:.4g}" for f in sorted({*order.forces, round(found.softest_N)}))
        raise Refusal(
            "soft", f"expected the smallest stiffness at {low:g} N or at {high:g} N, but the "
            f"axis is {found.softest:.2g} times as soft near {found.softest_N:.3g} N; measure with "
            f"the forces {forces}, or only with forces above or only with forces below "
            f"{found.softest_N:.3g} N"
        )  # fmt: skip
    tuning.say(
        f"from {found.low_N:.3g} to {found.high_N:.3g} N and back: {found.way} counts, "
        + (f"friction of {found.friction_N:.3g} N under the workpiece" if found.rubs
           else f"a workpiece that relaxes in {found.creep_s:.2g} s" if found.creep
           else "no friction under the workpiece")
    )  # fmt: skip
    return SlowChange(
        friction_N=found.friction_N, sticks=found.sticks, compliance=found.compliance,
        sliding=found.sliding, bends=found.bends, softest_N=found.softest_N, softest=found.softest,
        low_N=found.low_N, creep=found.creep or None, creep_s=found.creep_s or None,
        high_N=found.high_N, force_N=tuple(friction.block_means(force).tolist()),
        way=tuple(friction.block_means(place).tolist()),
    ), law  # fmt: skip


def _shaken(
    tuning: TuningFolder, law: Settings, asked: MeasuringOrder, slow: SlowChange, rate: float
) -> sine_excitation.SineTestResult | None:
    """Measures the workpiece with sines at the largest force. Returns None if the workpiece does
    not slide within the limits. Also returns None if it did not slide before and its stiffness is
    not in the model. `rate`: speed of the axis in encoder counts/s per DAC code.
    """
    facts = linear.facts(tuning.model)
    scale = abs(facts.required_encoder.scale)
    # If the workpiece never slid, its compliance was not measured and is taken from the model.
    sliding = slow.sliding or known.behind_counts(tuning.model)
    if not sliding:
        return None
    sensor, workpiece = scale / slow.compliance, scale / sliding
    drive = known.SineBounds(str(tuning.model))
    # At the lowest frequency the stiffness determines the motion of the workpiece.
    # At the highest frequency the mass determines the motion, for each mass that is possible.
    mass = facts.masses_kg.get(model_file.read(tuning.model).workpiece or "")
    own = math.sqrt(workpiece / mass) / (2 * math.pi) if mass else 30.0
    lowest, highest = max(SINE_MIN_HZ, own / 4), min(2 * own, SINE_MAX_HZ, highest_hz(facts))
    if highest <= lowest:  # the force sensor shows the workpiece at rest only
        return None
    hz = sorted({2 * round(f / 2)
                 for f in np.geomspace(lowest, highest, sine_excitation.FREQUENCIES)})  # fmt: skip
    with analyzing(tuning, law, asked, Analyzer) as measures:
        found = sine_excitation.measure(
            measures, max(tuning.order.forces),
            sine_excitation.SineTestSetup(
                slow.friction_N, sensor, workpiece, tuple(map(float, hz)), rate, scale,
                abs(facts.required_reading.per_count),
            ),
            drive.codes,
        )  # fmt: skip
    if found:
        tuning.say(
            f"sines move the workpiece: {found.stiffness:.4g} N/m, {found.mass:.3g} kg "
            f"+-{200 * found.mass_error:.2g} %, friction {found.friction_N:.3g} N"
        )
    return found


def first_contact_N(tuning: TuningFolder, checked: Checked) -> float:
    """Returns the force in N with which an axis makes its first contact before a measurement. At
    this error of the force, the law without its integral has the same output as in the approach.
    With a larger one, an axis that bounces would become faster than its approach."""
    own = tuning.axis.get("approach_velocity_max", "contact_force") | checked.settings
    code = float(own["approach_velocity_max"]) / abs(known.code_rate(tuning.model))
    counts = max(TOUCH_OVER_CONTACT * float(own["contact_force"]),
                 code / checked.law.bank.gain_at_rest())  # fmt: skip
    return counts * abs(linear.facts(tuning.model).required_reading.per_count)


def highest_hz(facts: PlantFacts) -> float:
    """Returns the highest frequency of a response in contact. Frequencies near half of the rate of
    the bus, or of a force sensor with a clock of its own, are not shown. A bus holds each code for
    a cycle, so that the excitation vanishes at the rate of the bus."""
    rates = [TICKS_PER_S / facts.required_drive.bus.cycle_ticks]
    if sampling := facts.required_reading.sampling:
        rates.append(sampling.rate_hz)
    return min(BAND_MAX_HZ, *(SAMPLED_BAND * rate for rate in rates))


def force_objects(tuning: TuningFolder) -> Settings:
    """Returns values of the objects that limit the force: rated force, force limit and slope of the
    force. They permit the largest force plus the range of the excitation."""
    return {
        "rated_force": round(1.5e3 * max(tuning.order.forces)), "force_limit": 1000,
        "force_slope": 2000,
    }  # fmt: skip


def measuring_order(
    tuning: TuningFolder, order: TuningOrder | None = None, *, first: int = 1,
    rubs: bool = False, touch_N: float = 0.0, settle_s: float = MeasuringOrder.settle_s,
    fewest: int = 0,
) -> MeasuringOrder:  # fmt: skip
    """Returns the request for a measurement with an Analyzer. `order`: request for a tuning, by
    default that of `tuning`. `first`, `rubs`, `touch_N`, `settle_s`, `fewest`: values
    of these fields of MeasuringOrder."""
    order, model = order or tuning.order, str(tuning.model)
    counts_per_mm = 1e-3 * abs(linear.facts(model).required_encoder.scale)
    gap = machine_bounds.gap_counts(tuning.model)
    return MeasuringOrder(
        band_hz=order.band_hz, resolution_hz=resolution_of(order.band_hz),
        averages=order.averages, fewest=fewest or min(AVERAGES_MIN, order.averages),
        force_max_N=order.force_max_N, rubs=rubs,
        touch_N=touch_N, touch_most_N=max(order.forces),
        travel=max(TRAVEL_MIN_CNT, round(free_travel_mm(tuning, order) * counts_per_mm)),
        squeeze=max(TRAVEL_MIN_CNT, round(squeeze_mm(tuning, order) * counts_per_mm)),
        # A travel that the user has given is never exceeded.
        travel_most=0 if tuning.order.travel_mm else machine_bounds.free_most_counts(gap),
        squeeze_most=0 if tuning.order.squeeze_mm else machine_bounds.squeeze_most_counts(gap),
        counts_per_mm=counts_per_mm, gap=gap,
        seed=order.seed, first=first, settle_s=settle_s,
        within=FORCE_TOLERANCE if rubs else MeasuringOrder.within,
        most=int(min(known.NOISE_PEAK_FACTOR * known.linear_codes(model), MOST_CODES)),
    )  # fmt: skip


def settling_s(law: Bank) -> float:
    """Returns the time in s in which a loop with this law settles after the start of an excitation.
    A loop behind a slow sensor has a slow integral. The rest of its transient differs from period
    to period, as a distortion does, but is proportional to the amplitude."""
    rate = law.integral_rad_per_s
    return max(MeasuringOrder.settle_s, SETTLE_INTEGRALS / rate if rate else 0.0)


def resolution_of(band_hz: tuple[float, float]) -> float:
    """Returns the distance of the spectral lines in Hz. A narrow band has more of them than one
    for each Hz, as far as the recorder can store a period."""
    wanted = min(MeasuringOrder.resolution_hz, band_hz[1] / LINES_MIN)
    return max(wanted, finest_resolution_hz())


def per_mm(tuning: TuningFolder) -> float:
    """Returns the encoder counts of a millimetre."""
    return 1e-3 * abs(linear.facts(tuning.model).required_encoder.scale)


def free_travel_mm(tuning: TuningFolder, order: TuningOrder) -> float:
    """Returns the largest travel in mm out of contact, of the request or from the model."""
    if order.travel_mm is not None:
        return order.travel_mm
    return machine_bounds.free_counts(tuning.model) / per_mm(tuning)


def squeeze_mm(tuning: TuningFolder, order: TuningOrder) -> float:
    """Returns the largest travel in mm in contact, of the request or from the model."""
    if order.squeeze_mm is not None:
        return order.squeeze_mm
    return machine_bounds.squeeze_counts(tuning.model, *forces_between(order)) / per_mm(tuning)


def forces_between(order: TuningOrder) -> tuple[float, float]:
    """Returns the smallest and the largest force in N of a measurement with all forces of the
    request and the range of the excitation."""
    return LOWEST_FORCE_SHARE * min(order.forces), (1 + SWING / 2) * max(order.forces)


def with_measured_way(
    tuning: TuningFolder, order: TuningOrder, way: tuple[float, ...]
) -> TuningOrder:
    """Returns the request with a travel in contact that permits the measured motion between the
    forces. `way`: positions in encoder counts during this motion. A travel that the user has given
    does not change."""
    if order.squeeze_mm is not None:
        return order
    measured = machine_bounds.MEASURED_FACTOR * (max(way) - min(way)) / per_mm(tuning)
    return replace(order, squeeze_mm=max(squeeze_mm(tuning, order), measured))


def analyzer_of(tuning: TuningFolder, order: TuningOrder | None = None) -> Analyzer:
    """Returns an Analyzer of the axis. `order`: request for a tuning, by default that of
    `tuning`."""
    return Analyzer(tuning.axis, measuring_order(tuning, order), tuning.model, {}, tuning.say)


@contextlib.contextmanager
def analyzing(
    tuning: TuningFolder, settings: Settings, order: MeasuringOrder, kind: type[A]
) -> Iterator[A]:
    """Context that disables the axis, writes `settings` to it, and yields an Analyzer of the class
    `kind`. At its end, the previous values are restored."""
    disable(tuning.axis)
    with (
        temporary(tuning.axis, settings),
        kind(tuning.axis, order, tuning.model, {}, tuning.say) as analyzer,
    ):
        yield analyzer


def take_response(
    tuning: TuningFolder, name: str, settings: Settings, order: MeasuringOrder, kind: type[A],
    take: Callable[[A], Level],
) -> tuple[Level, ResponseFigures]:  # fmt: skip
    """Measures a response with `settings` and writes it to the folder `name`. `take`: function that
    measures the response with an Analyzer of the class `kind`."""
    with analyzing(tuning, settings, order, kind) as analyzer:
        rest = analyzer.rest() if name == "free" else Rest(0.0, None, 0)
        level = take(analyzer)
    done = measuring.result_of(analyzer, level, rest)
    # No plots are written to the folder, because the page of the tuning shows the response.
    results.write(done, tuning.folder / name, draw=False)
    return level, ResponseFigures(
        coherence_median=done.summary.coherence_median,
        random_error_median=done.summary.random_error_median,
        amplitude=level.amplitude, swing=level.swing, speed_rms=level.speed_rms,
        bias_N=level.bias_N, force_min_N=level.force_min_N, force_max_N=level.force_max_N,
        noise_lsb=level.noise_lsb, distorted=level.distorted, aborts=tuple(level.aborts),
        of_loop=level.of_loop,
    )  # fmt: skip


def next_amplitude(amplitude: int, force: float, forces: tuple[float, ...]) -> int:
    """Returns the amplitude in DAC codes with which the search begins at the next force. If this
    force is smaller, the permitted range of the force is smaller too."""
    following = forces[min(forces.index(force) + 1, len(forces) - 1)]
    return max(1, int(amplitude * min(1.0, following / force)))


def line_of(name: str, figures: ResponseFigures) -> str:
    """Returns a text about a response: its amplitude in DAC codes and its relative error."""
    error = 100 * (figures.random_error_median or 0.0)
    return f"{name} with {figures.amplitude} codes, error {error:.2g} %"


@contextlib.contextmanager
def temporary(axis: Axis, values: Settings) -> Iterator[None]:
    """Context that writes objects to a disabled axis, and restores their previous values at the
    end. An `output_bias` stays until the end of the run, because the axis would begin with its
    first motion test again after each change."""
    before = axis.get(*values) if values else {}
    bias = before.pop("output_bias", None)
    _write({n: v for n, v in values.items() if n != "output_bias" or v != bias}, axis.set)
    try:
        yield
    finally:
        # If the axis has another owner or does not answer, no value is restored.
        with contextlib.suppress(NoAnswer, Refused):
            disable(axis)
            _write(before, axis.put_back)


def _write(values: Settings, write: Callable[..., None]) -> None:
    if "force_bank" in values:  # The firmware refuses writes to a selected filter bank.
        write(force_bank=0)
    write(**values)


def disable(axis: Axis) -> None:
    """Disables the axis, and waits until its brake has engaged and the connection reports the
    disabled state."""
    analyzer.disable(axis)
    axis.link.wait(0.05)


def objects_of(
    tuning: TuningFolder, checked: Checked, bank: Bank, loss: Mapping[str, int], ms: float = 2.0,
    plants: PlantSet | None = None,
) -> Settings:  # fmt: skip
    """Returns {object: engineering value} in the order in which the objects must be written. The
    objects are the settings that check() has added, and a filter bank with the certificate for this
    axis.

    `loss`: objects that limit the output after a contact loss. `ms`: largest Ms in the set of
    plants. `plants`: the set of plants, or None for a certificate without tolerances.
    """
    own = checked.settings
    held = tuning.axis.get("force_scale", "adc_bits", "force_zero_code") | own
    units = {n: row.unit for n, row in linear.facts(tuning.model).parameters.items()}
    with Design(str(tuning.model)) as plant:
        bench = simulation.ContactBench(plant, int(held["adc_bits"]))
        bench.settings |= held
        values = files.bank_objects(
            plant.file("bank.toml", bench.text(bench.shown, bank, loss)), ms,
            plants.ranges if plants else {}, units if plants else {}, datetime.date.today(),
        )  # fmt: skip
    return own | {n: v for n, v in values.items() if n not in ("adc_bits", "force_scale")}
