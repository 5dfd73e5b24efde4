"""The weight of an axis at the beginning of a tuning. A model states the weight with an error of
some per cent. This error would move an axis whose drive holds the weight, so the check of the first
motion measures the weight."""

from dataclasses import dataclass

from forceaxis.axis.axis import Axis
from forceaxis.commission import known, machine_bounds
from forceaxis.commission.check import MOVING_STEPS, TRAVEL_CNT, CheckStep, MotionCheck
from forceaxis.commission.level import Rest
from forceaxis.commission.refusal import Refusal
from forceaxis.commission.tune_folder import TuningFolder
from forceaxis.commission.tune_measure import free_travel_mm, per_mm, temporary
from forceaxis.commission.tune_results import Settings

# Largest peak-to-peak value of normal noise, divided by its rms value.
# Half a second of normal noise exceeds PEAK_TO_PEAK once in ten thousand recordings.
PEAK_TO_PEAK = 10.0
# Relative uncertainty of the DAC code of the model that holds the weight.
# WRONG_SHARE follows from the accuracy with which a data sheet states mass and motor constant.
WRONG_SHARE = known.MASS_SPREAD + known.DRIVE_SPREAD


@dataclass(frozen=True)
class FirstMotionState:
    """The objects that tell whether the axis makes a first motion test when it is enabled: the
    order for this test, and the result of an earlier test."""

    first_motion_test: str
    first_motion_result: str


@dataclass(frozen=True)
class WeightObjects:
    """The objects that hold a weight, and with which the first motion test of such an axis
    passes."""

    output_bias: float
    brake_engage_ticks: int
    first_motion_counts: int
    first_motion_speed: float


def held_weight(tuning: TuningFolder, settings: Settings, rest: Rest) -> Settings:
    """Moves an axis with a weight as `axis check` does, within its travel out of contact, if the
    axis would begin with its first motion test. Returns the WeightObjects that have changed, as
    {object: engineering value}. They are on the axis until the end of the run.

    `settings`: objects that are not set on the axis. `rest`: state of the disabled axis. At the
    end, the axis is disabled again. Raises Refusal if a step of the check fails.
    """
    axis, weight = tuning.axis, known.weight(tuning.model)
    first = axis.record(FirstMotionState)
    done = first.first_motion_test == "off" or first.first_motion_result == "passed"
    if not weight.newton or done:
        return {}

    _expect_room_to_fall(tuning, weight)

    def say(step: CheckStep) -> None:
        if step.step in MOVING_STEPS:
            tuning.say(f"{step.step:<13}{step.text}")

    def moves(text: str) -> bool:
        tuning.say(f"the axis has a weight of {abs(weight.newton):.3g} N. {text}")
        return True

    travel = round(free_travel_mm(tuning, tuning.order) * per_mm(tuning))
    before = axis.record(WeightObjects)
    with temporary(axis, settings | _contact_above_noise(axis, settings, rest)):
        run = MotionCheck(axis, min(TRAVEL_CNT, travel), say=say, weight=weight)
        run.run(moves, tare=False)
    if failed := next((step for step in run.steps if step.verdict == "failed"), None):
        raise Refusal(
            "weight", "expected an axis that `axis check` finds without a fault, so that its "
            f"weight is held, but {failed.step}: {failed.text}"
        )  # fmt: skip
    now = vars(axis.record(WeightObjects))
    return {name: value for name, value in now.items() if value != getattr(before, name)}


def _expect_room_to_fall(tuning: TuningFolder, weight: known.Weight) -> None:
    """Raises Refusal if the axis could fall onto the workpiece when it is disabled, while its brake
    engages and the output holds the weight of the model instead of the weight of the machine."""
    speed_per_code = abs(known.code_rate(tuning.model)) / (1e3 * per_mm(tuning))
    fall_mm = 1e3 * weight.driven_fall_m(WRONG_SHARE, speed_per_code)
    gap_mm = machine_bounds.gap_counts(tuning.model) / per_mm(tuning)
    if weight.codes and weight.newton > 0 and fall_mm > gap_mm:
        raise Refusal(
            "weight", f"expected a distance of at least {fall_mm:.2g} mm to the workpiece, got "
            f"{gap_mm:.2g} mm in the model: if the weight differs from that of the model by "
            f"{100 * WRONG_SHARE:g} %, the axis falls so far each time until its brake holds; "
            "start further away and correct `approach` of the model, or run `axis check` without "
            "the workpiece and store the parameters"
        )  # fmt: skip


def _contact_above_noise(axis: Axis, settings: Settings, rest: Rest) -> Settings:
    """Returns a `contact_force` above the noise from peak to peak. The check of the first motion
    compares it with this noise, while contact is told from the noise by its rms value."""
    if rest.noise_lsb is None:
        return {}
    noise = rest.noise_lsb * 2.0 ** (8 - axis.integer("adc_bits"))
    own = axis.get("contact_force") | settings
    least = PEAK_TO_PEAK * noise
    return {"contact_force": max(float(own["contact_force"]), round(256 * least) / 256)}
