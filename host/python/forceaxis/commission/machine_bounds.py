"""Bounds of a tuning that are computed from the model of the machine: speed of the approach, travel
out of contact, and travel in contact. An option of the user replaces each of them."""

import math
from pathlib import Path

from forceaxis import linear
from forceaxis._core import InputError
from forceaxis.commission import friction, known
from forceaxis.commission.contact_likelihood import gap_of
from forceaxis.design import simulate as simulation
from forceaxis.design.changes import Design
from forceaxis.linear import PlantFacts

# Largest peak force by the momentum of the axis at a first contact, divided by the smallest force.
# The smallest force here is the smallest force of the request.
IMPACT_SHARE = 1 / 3
# Travel out of contact in encoder counts, with which rounding is small against the motion.
FREE_TRAVEL_CNT = 400
# Largest travel out of contact, as a fraction of the distance to the workpiece in the model.
GAP_SHARE = 0.4
# Travel out of contact, divided by the smallest travel in which a speed can be measured.
SPEED_TRAVELS = 2.0
# WEIGHT_ERROR_CODES: error of the output that holds a weight. It causes a drift of the axis.
# OPEN_LOOP_S: duration of the drift in s: two periods of noise in open loop out of contact.
WEIGHT_ERROR_CODES, OPEN_LOOP_S = 1.0, 2.0
# Permitted travel in contact, divided by the deflection of the model.
# The workpiece may be softer than the model by this factor, as its stiffness is nearly unknown.
SOFTER_FACTOR = 3.0
# Travel in contact divided by the measured motion between the forces.
MEASURED_FACTOR = 2.0


def gap_counts(model: Path) -> float:
    """Returns the distance from the start of a model to its workpiece in encoder counts, or 0 if
    the model begins in contact."""
    scale = abs(linear.facts(model).required_encoder.scale)
    return max(0.0, gap_of(model, {})) * scale


def impact_N(model: Path, facts: PlantFacts, counts_per_s: float) -> float:
    """Returns the peak force in N that the momentum of the axis causes in the spring of the contact
    at an approach speed in encoder counts/s. Raises InputError for a model without one contact."""
    stiffness, moving_kg = _contact(model, facts)
    speed = counts_per_s / abs(facts.required_encoder.scale)
    return speed * math.sqrt(stiffness * moving_kg)


def approach_counts_per_s(model: Path, facts: PlantFacts, least_N: float) -> int:
    """Returns the approach speed in encoder counts/s at which the momentum of the axis causes a
    peak force of IMPACT_SHARE times `least_N`. Raises InputError for a model without one
    contact."""
    stiffness, moving_kg = _contact(model, facts)
    speed = IMPACT_SHARE * least_N / math.sqrt(stiffness * moving_kg)
    speed = min(simulation.APPROACH_M_PER_S, speed)
    return max(1, round(speed * abs(facts.required_encoder.scale)))


def _contact(model: Path, facts: PlantFacts) -> tuple[float, float]:
    """Returns the stiffness of the contact in N/m, and the mass in kg that moves before it."""
    with Design(str(model)) as plant:
        contact = plant.tables.contact
        stiffness = plant.value(contact.stiffness) if contact else None
    if not stiffness or contact is None:
        raise InputError(
            f"{model}: contact: expected a model with exactly one contact that has a stiffness"
        )
    return stiffness, facts.moving_kg(contact.between[1])


def free_counts(model: Path) -> int:
    """Returns the travel out of contact in encoder counts. It follows from the resolution of the
    encoder, from the speed of the axis at the smallest DAC code, from the part of a weight that
    output_bias does not hold, and from the backlash. The travel is at most GAP_SHARE of the
    distance to the workpiece."""
    rate = abs(known.code_rate(model))
    slow = (
        rate
        * friction.SMALLEST_CODE
        * (friction.SETTLED_S + friction.RECORD_MIN_S)
        / (2 * friction.TRAVEL_SHARE)
    )
    travel = max(FREE_TRAVEL_CNT, SPEED_TRAVELS * slow) + known.play_counts(model)
    if known.weight(model).codes:
        travel += WEIGHT_ERROR_CODES * rate * OPEN_LOOP_S
    if gap := gap_counts(model):
        travel = min(travel, free_most_counts(gap))
    return max(friction.TRAVEL_MIN_CNT, math.ceil(travel))


def free_most_counts(gap: float) -> int:
    """Returns the largest travel out of contact in encoder counts to which a measurement may widen
    the travel of free_counts(). `gap`: distance to the workpiece in encoder counts. The result
    is 0 if `gap` is 0."""
    return math.floor(GAP_SHARE * gap)


def squeeze_most_counts(gap: float) -> int:
    """Returns the largest travel in contact in encoder counts to which a measurement may widen the
    travel of squeeze_counts(). It is the distance to the workpiece, over which the axis moves
    anyway. `gap`: this distance in encoder counts."""
    return math.floor(gap)


def squeeze_counts(model: Path, low_N: float, high_N: float) -> int:
    """Returns the travel in contact in encoder counts: SOFTER_FACTOR times the deflection of the
    model between two forces, plus the backlash."""
    signal = linear.facts(model).required_reading.signal
    plant = linear.linearise(str(model), outputs=("encoder", signal))
    place, force = plant.at(2j * math.pi * known.STEADY_HZ).ravel()
    deflection = float(abs(place / force)) * (high_N - low_N)
    travel = SOFTER_FACTOR * deflection + known.play_counts(model)
    return max(friction.TRAVEL_MIN_CNT, math.ceil(travel))
