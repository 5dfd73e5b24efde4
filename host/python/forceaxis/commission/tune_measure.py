"""The steps of a tuning that measure, and what sets an axis up for them."""

import contextlib
import datetime
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from forceaxis import linear
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.commission import analyzer, friction, known, measuring, shake
from forceaxis.commission.level import MOST_CODES, Level, MeasuringOrder, Rest
from forceaxis.commission.refusal import Refusal
from forceaxis.commission.tune_files import TuningOrder, small_of
from forceaxis.commission.tune_folder import TuningFolder
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
from forceaxis.design import files
from forceaxis.design import simulate as simulation
from forceaxis.design.changes import Design, contact_of
from forceaxis.identify import result as results
from forceaxis.linear.bank import Bank
from forceaxis.linear.plant_set import PlantSet

AVERAGES_MIN = 5
SMALLER_FACTOR = 3  # the second amplitude that is measured is so many times smaller
LOWEST_FORCE_FACTOR = 0.6  # of the smallest force: from there the force is changed slowly
COASTED_TRAVELS = 5  # an axis that a killed run has moved farther does not return


def free(tuning: TuningFolder, checked: Checked) -> FreeResponse:
    """The response of codes to the encoder, after the friction of what moves."""
    off(tuning.axis)
    settings = checked.settings
    with temporary(tuning.axis, settings), analyzer_of(tuning) as measures:
        measures.rest()
        if tuning.coasted:
            _back_to_start(tuning, measures, checked.rest.position)
        newton = newton_per_code(tuning)
        newton = newton if math.isfinite(newton) else 0.0
        found = friction.glide(measures, measures.order.most, tuning.say, newton=newton)
    first = max(4, found.noise_codes)
    taking = Taking("free", lambda a: a.free(), settings, first=first, rubs=found.rubs)
    _, figures = taking.run(tuning)
    return FreeResponse(**vars(figures), glide=GlideFigures.of(found))


def free_line(tuning: TuningFolder, done: FreeResponse) -> str:
    """What `free` says when it ends."""
    line = line_of("codes to the encoder", done)
    if done.glide.rubs:
        line += (
            f"; a dead zone of {done.glide.dead_zone:.2g} codes, dry friction of "
            f"{moving_N(tuning, done):.3g} N"
        )
    return line


def _back_to_start(tuning: TuningFolder, measures: analyzer.Analyzer, start: int) -> None:
    """Moves an axis that a killed run has left moving back to its position at `check`, counts, and
    disables it. Farther than COASTED_TRAVELS the axis does not return. The fault of the killed run
    was still latched, so the encoder has counted on since."""
    if abs(tuning.axis.read("position") - start) <= COASTED_TRAVELS * measures.order.travel:
        tuning.say("the axis returns to the position at which this tuning began")
        measures.home = start
        measures.go_home()
        tuning.axis.disable()


def moving_N(tuning: TuningFolder, free: FreeResponse) -> float:
    """N of dry friction of what moves, by the model; 0: none."""
    return free.glide.dead_zone * newton_per_code(tuning) if free.glide.rubs else 0.0


def newton_per_code(tuning: TuningFolder) -> float:
    """N that the drive of the model gives for a code at standstill; inf: the drive integrates."""
    return known.newton_per_code(tuning.model)


def measure(tuning: TuningFolder, checked: Checked, free: FreeResponse) -> MeasuredResponses:
    """What is between the forces, then the responses of codes to the reading at each of them, with
    two amplitudes."""
    levels: dict[str, PressedResponse] = {}
    first = 1
    order = replace(tuning.order, band_hz=checked.band_hz)
    law = objects_of(tuning, checked, checked.law.bank, {}) | {"bump_decay_shift": 0}
    law |= reach(tuning)
    between, law = _between(tuning, law, order)
    shaken = None
    if between.friction_N > 0:
        shaken = _shaken(tuning, law, order, between, free.glide.rate)
    rubs = between.friction_N > 0 or free.glide.rubs
    for force in tuning.order.forces:
        name = f"{force:g}N"

        def take(measures: analyzer.Analyzer, force: float = force) -> Level:
            level = measures.contact(force)
            law["contact_loss_cap"] = tuning.axis.read("contact_loss_cap")
            return level

        if rubs:
            first = MOST_CODES  # up to what the drive bears: the most of it slides
        taking = Taking(name, take, law, order, first, rubs=rubs)
        _, figures = taking.run(tuning)
        small = max(1, figures.amplitude // SMALLER_FACTOR)
        smaller = None
        if small < figures.amplitude:
            taking = Taking(small_of(name), take, law, order, amplitude=small, rubs=True)
            _, smaller = taking.run(tuning)
        levels[name] = PressedResponse(**vars(figures), small=smaller)
        first = next_amplitude(figures.amplitude, force, order.forces)
    _go_home(tuning, checked)
    return MeasuredResponses(levels, between, shaken)


def measure_line(tuning: TuningFolder, done: MeasuredResponses) -> str:
    """What `measure` says when it ends."""
    return "; ".join(line_of(name, level) for name, level in done.levels.items())


def _go_home(tuning: TuningFolder, checked: Checked) -> None:
    """Moves the axis to where check() found it: what rubs stays in contact when it is disabled."""
    with temporary(tuning.axis, checked.settings), analyzer_of(tuning) as measures:
        measures.home = checked.rest.position
        measures.go_home()


def _between(
    tuning: TuningFolder, law: Settings, order: TuningOrder
) -> tuple[SlowChange, Settings]:
    """(the slow change between the smallest and the largest force, and what they swing by; `law`
    with the contact_loss_cap that the axis has then)."""
    off(tuning.axis)
    low, high = (
        LOWEST_FORCE_FACTOR * min(order.forces),
        (1 + analyzer.SWING / 2) * max(order.forces),
    )
    with temporary(tuning.axis, law), analyzer_of(tuning, order) as measures:
        force, place, _ = measures.between(low, high)
        # An axis that still touches does not approach again, so it keeps the cap of the first.
        law = law | {"contact_loss_cap": tuning.axis.read("contact_loss_cap")}
        force *= reading_N(tuning) / measures.newton
    found = friction.slow(force, place, _rigid(tuning))
    step = (found.high_N - found.low_N) / friction.BINS
    if found.soft and all(abs(force - found.softest_N) > step for force in order.forces):
        forces = ",".join(f"{f:.4g}" for f in sorted({*order.forces, round(found.softest_N)}))
        raise Refusal(
            "soft", f"expected no place between {low:g} and {high:g} N that is softer than at "
            f"these forces, near {found.softest_N:.3g} N the axis goes {found.softest:.2g} times "
            f"as far: measure there too, with forces {forces}, or keep to one side of it"
        )  # fmt: skip
    tuning.say(
        f"from {found.low_N:.3g} to {found.high_N:.3g} N and back: {found.way} counts, "
        + (f"friction of {found.friction_N:.3g} N under the workpiece" if found.rubs
           else "no friction under the workpiece")
    )  # fmt: skip
    return SlowChange(
        friction_N=found.friction_N, sticks=found.sticks, compliance=found.compliance,
        sliding=found.sliding, softest_N=found.softest_N, softest=found.softest, low_N=found.low_N,
        high_N=found.high_N, force_N=tuple(friction.means(force).tolist()),
        way=tuple(friction.means(place).tolist()),
    ), law  # fmt: skip


def reading_N(tuning: TuningFolder) -> float:
    """N of a count of the reading by the model, in which all friction is stated."""
    return abs(linear.facts(tuning.model).required_reading.per_count)


def _shaken(
    tuning: TuningFolder, law: Settings, order: TuningOrder, slow: SlowChange, rate: float
) -> shake.Shaken | None:
    """What sines of the largest force say of the workpiece; None where it does not slide within the
    bounds. rate: encoder counts a second for each code."""
    scale = abs(linear.facts(tuning.model).required_encoder.scale)
    sensor, workpiece = scale / slow.compliance, scale / slow.sliding
    drive = known.SineBounds(str(tuning.model))
    # From where the spring rules to where the mass does; the mass is not known.
    mass = _mass(tuning)
    own = math.sqrt(workpiece / mass) / (2 * math.pi) if mass else 30.0
    hz = sorted({2 * round(f / 2) for f in np.geomspace(max(4.0, own / 4), min(2.0 * own, 150.0),
                                                       shake.FREQUENCIES)})  # fmt: skip
    off(tuning.axis)
    with temporary(tuning.axis, law), analyzer_of(tuning, order) as measures:
        found = shake.shake(
            measures, max(order.forces),
            shake.Shaking(
                slow.friction_N, sensor, workpiece, tuple(map(float, hz)), rate, scale,
                reading_N(tuning),
            ),
            drive.codes, analyzer.Ended,
        )  # fmt: skip
    if found:
        tuning.say(
            f"sines move the workpiece: {found.stiffness:.4g} N/m, {found.mass:.3g} kg "
            f"+-{200 * found.mass_error:.2g} %, friction {found.friction_N:.3g} N"
        )
    return found


def _mass(tuning: TuningFolder) -> float | None:
    """Kg of the workpiece by the model."""
    with Design(str(tuning.model)) as plant:
        contact = contact_of(plant.table)
        return plant.facts.masses_kg.get(contact["between"][1]) if contact else None


def _rigid(tuning: TuningFolder) -> float:
    """Counts a newton of the contact by the model."""
    return known.rigid_counts(tuning.model)


def reach(tuning: TuningFolder) -> Settings:
    """Rated force and slope of the force, for the largest of the forces and what it swings by."""
    return {
        "rated_force": round(1.5e3 * max(tuning.order.forces)), "force_limit": 1000,
        "force_slope": 2000,
    }  # fmt: skip


def analyzer_of(
    tuning: TuningFolder, order: TuningOrder | None = None, first: int = 1,
    kind: type[analyzer.Analyzer] = analyzer.Analyzer, amplitude: int = 0, rubs: bool = False,
) -> Any:  # fmt: skip
    """An analyzer of type `kind`; first, amplitude, rubs: as level.MeasuringOrder has them."""
    order, model = order or tuning.order, str(tuning.model)
    scale = abs(linear.facts(model).required_encoder.scale)
    low, high = order.band_hz
    asked = MeasuringOrder(
        band_hz=(low, high), averages=order.averages, fewest=min(AVERAGES_MIN, order.averages),
        force_max_N=order.force_max_N, amplitude=amplitude, rubs=rubs,
        travel=max(20, round(1e-3 * order.travel_mm * scale)), seed=order.seed, first=first,
        most=min(known.PEAKY * (known.linear_codes(model) or 1024), MOST_CODES),
    )  # fmt: skip
    return kind(tuning.axis, asked, model, {}, tuning.say)


@dataclass(frozen=True)
class Taking:
    """A response that is taken under `settings` and written to the folder `name`. take: measures
    with the analyzer of type `kind`; order: the tuning's by default; first, amplitude, rubs: as
    level.MeasuringOrder has them."""

    name: str
    take: Callable[[Any], Level]
    settings: Settings
    order: TuningOrder | None = None
    first: int = 1
    kind: type[analyzer.Analyzer] = analyzer.Analyzer
    amplitude: int = 0
    rubs: bool = False

    def run(self, tuning: TuningFolder) -> tuple[Level, ResponseFigures]:
        """Takes the response."""
        off(tuning.axis)
        with (
            temporary(tuning.axis, self.settings),
            analyzer_of(
                tuning, self.order, self.first, self.kind, self.amplitude, self.rubs
            ) as measures,
        ):
            rest = measures.rest() if self.name == "free" else Rest(0.0, None, 0)
            level = self.take(measures)
        done = measuring.result_of(tuning.axis, measures.order, level, rest)
        results.write(done, tuning.folder / self.name, draw=False)  # the page shows it
        return level, ResponseFigures(
            coherence_median=done.summary["coherence_median"],
            random_error_median=done.summary["random_error_median"],
            amplitude=level.amplitude, swing=level.swing, speed_rms=level.speed_rms,
            bias_N=level.bias_N, force_min_N=level.force_min_N, force_max_N=level.force_max_N,
            noise_lsb=level.noise_lsb, distorted=level.distorted, aborts=tuple(level.aborts),
            of_loop=level.of_loop,
        )  # fmt: skip


def next_amplitude(amplitude: int, force: float, forces: tuple[float, ...]) -> int:
    """Codes to begin with at the force after `force`: of a smaller one the swing is smaller."""
    after = forces[min(forces.index(force) + 1, len(forces) - 1)]
    return max(1, int(amplitude * min(1.0, after / force)))


def line_of(name: str, figures: ResponseFigures) -> str:
    """A response in words."""
    error = 100 * (figures.random_error_median or 0.0)
    return f"{name} with {figures.amplitude} codes, error {error:.2g} %"


@contextlib.contextmanager
def temporary(axis: Axis, values: Settings) -> Iterator[None]:
    """Writes objects to a disabled axis, and puts back at the end what it had."""
    before = axis.get(*values) if values else {}
    _write(values, axis.set)
    try:
        yield
    finally:
        with contextlib.suppress(NoAnswer, Refused):  # another's, or lost; nothing is stored
            off(axis)
            _write(before, axis.put_back)


def _write(values: Settings, write: Callable[..., None]) -> None:
    if "force_bank" in values:  # a selected bank is not written
        write(force_bank=0)
    write(**values)


def off(axis: Axis) -> None:
    """Disables the axis, and waits for the link to show it."""
    axis.disable()
    axis.link.wait(0.05)


def objects_of(
    tuning: TuningFolder, checked: Checked, bank: Bank, loss: Mapping[str, Any], ms: float = 2.0,
    plants: PlantSet | None = None,
) -> Settings:  # fmt: skip
    """{object: engineering value} of a bank, in order, with its certificate for this axis, and of
    what check() found never to have been set. ms: the largest of the set; plants: the set, None:
    no tolerances are certified."""
    own = checked.settings
    held = tuning.axis.get("force_scale", "adc_bits", "force_zero_code") | own
    units = {n: unit for n, (_, unit) in linear.facts(tuning.model).parameters.items()}
    with Design(str(tuning.model)) as plant:
        bench = simulation.ContactBench(plant, held["adc_bits"])
        bench.settings |= held
        values = files.bank_objects(
            plant.file("bank.toml", bench.text(bench.shown, bank, loss)), ms,
            plants.ranges if plants else {}, units if plants else {}, datetime.date.today(),
        )  # fmt: skip
    return own | {n: v for n, v in values.items() if n not in ("adc_bits", "force_scale")}
