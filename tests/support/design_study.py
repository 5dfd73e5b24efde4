"""Designs for axes drawn from data sheets of eight kinds of drive, judged by the figures of
`limit --over` and by closed-loop poles.

`design_study.py COUNT [FIRST]` prints a line for each design and ends with status 1 if one is bad.
"""

import math
import operator
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from forceaxis.design import data_sheet, new, search, sets
from forceaxis.design.grid import Goal
from forceaxis.errors import ParameterError
from forceaxis.linear import over
from forceaxis.linear.bank import GAIN_STEP, Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.precise import Responses, law_shape

KINDS = (
    "amplifier", "velocity", "torque", "linear", "voice coil", "stepper", "vertical", "bus",
)  # fmt: skip
# Smallest share of the bandwidth of a smaller structure, and error of a printed figure.
LEAST_SHARE, PRINTED = 0.99, 1e-5
STATIC_ERROR_MAX = 0.01  # of a P law that is a law for the same purpose
SLOW_RAD_PER_S = 0.6  # slowest integral of a designed law


def sheet(kind, seed):
    """The data sheet of an axis: {field: value}."""
    rng = np.random.default_rng([42, KINDS.index(kind), seed])

    def between(low, high):
        return float(f"{math.exp(rng.uniform(math.log(low), math.log(high))):.4g}")

    full = between(150, 2000)
    found = {
        "moving_mass_kg": between(5, 60),
        "sensor_full_scale_n": full,
        "sensor_stiffness_n_per_m": full / (between(0.1, 1) * 1e-3),
        "sensor_bits": int(rng.choice([12, 16, 24])),
        "sensor_noise_n": full / 5000,
        "workpiece_stiffness_n_per_m": full / (between(0.1, 1) * 1e-3),
        "workpiece_mass_kg": between(0.5, 8),
        "workpiece_damping_ratio": between(0.01, 0.1),
    }
    drive = {
        "amplifier": lambda: {"drive": "amplifier", "torque_constant_n_m_per_a": 0.4,
                              "motor_peak_current_a": 30},
        "velocity": lambda: {"drive": "velocity", "velocity_loop_hz": between(20, 80)},
        "torque": lambda: {"drive": "torque", "current_loop_hz": between(300, 1500)},
        "linear": lambda: {"drive": "torque", "motor": "linear",
                           "torque_damping_n_s_per_m": between(1000, 8000)},
        "voice coil": lambda: {"drive": "torque", "motor": "linear", "moving_mass_kg":
                               between(0.3, 3), "torque_damping_n_s_per_m": between(50, 500)},
        "stepper": lambda: {"drive": "stepper"},
        "vertical": lambda: {"drive": "velocity", "inclination_deg": -90.0,
                             "brake_holding_n": 2500.0, "velocity_loop_hz": between(20, 60)},
        "bus": lambda: {"drive": "velocity", "bus_cycle_ms": int(rng.choice([2, 4])),
                        "velocity_loop_hz": between(20, 60)},
    }[kind]  # fmt: skip
    found |= drive()
    # A converter of its own: one code leaves a period, or several do.
    if kind == "bus" and rng.random() < 0.6:
        found |= {"sensor_rate_hz": int(rng.choice([500, 1000, 1500])), "sensor_latency_ms": 0.4}
        found |= {"sensor_bits": 24, "sensor_filter": str(rng.choice(["none", "sinc3"]))}
    return found


def made(folder, kind, seed):
    """(PlantSet, Goal) of an axis."""
    values, sources = data_sheet.collect({n: str(v) for n, v in sheet(kind, seed).items()})
    new.write(folder / "axis", values, sources)
    return sets.plant_set(folder / "axis/model.toml"), Goal(adc_bits=min(values.sensor_bits, 16))


def worst(responses, bank, timing):
    """The worst figures as `limit --over` searches them."""
    return over.WorstSearch(responses, (timing,), LoopSpec("bank", bank=bank))


def keeps(one, goal, timing):
    """Whether worst figures keep the goal."""
    gain_margin = math.inf if one.gain_margin is None else one.gain_margin
    return one.stable and one.Ms <= goal.ms_of(timing) and gain_margin >= goal.gain_margin


def fastest(responses, goal, shape):
    """(Hz, law): the largest bandwidth of a law over the gain, within 1 % of the largest gain that
    keeps the goal: a search of its own, from a grid of gains."""
    best, law = 0.0, shape
    low, high = GAIN_STEP, 255.0
    while high > 1.01 * low:
        gain = math.sqrt(low * high)
        bank = Bank(gain, shape.integral_rad_per_s).quantised()
        found = [worst(responses, bank, timing).quick() for timing in goal.timings]
        if all(keeps(one, goal, t) for one, t in zip(found, goal.timings, strict=True)):
            best, law = max(
                (best, law),
                (min(one.fS_Hz or 0.0 for one in found), bank),
                key=operator.itemgetter(0),
            )
            low = gain
        else:
            high = gain
    return best, law


def follows(plants, goal, found, bank):
    """Whether the force of a law follows the ramp of the set-point that the search asked for."""
    problem = search.SearchProblem(plants, plants.nominal(), goal)
    pi_hz = next((row.bandwidth_Hz for row in found.structures if row.name == "PI"), math.inf)
    problem.follow_ramp(plants, goal, pi_hz)
    return problem.ramp.excess(law_shape(bank), bank.force_gain) == 0.0


def faults(plants, goal, found):
    """What is wrong with the result of a search."""
    texts = []
    responses = Responses(plants, goal.timings)
    for row in found.structures:
        bank = row.bank.bank
        if bank != bank.quantised():
            texts.append(f"{row.name}: not as the firmware stores it")
        exact = {t: worst(responses, bank, t).exact() for t in goal.timings}
        if not all(keeps(one, goal, t) for t, one in exact.items()):
            texts.append(f"{row.name}: limit --over does not confirm it: {exact}")
            continue
        least = min(one.fS_Hz for one in exact.values())
        if abs(least - row.bandwidth_Hz) > PRINTED * max(least, 1):
            texts.append(f"{row.name}: {row.bandwidth_Hz} Hz printed, {least} Hz by limit --over")
        for member in [*plants.corners(), *plants.random(4, 7)]:
            loop = plants.loop(member, goal.timings[-1], LoopSpec("bank", bank=bank))
            if max(loop.closed_poles(loop.gain_of(bank.force_gain)).real) >= 0:
                texts.append(f"{row.name}: a closed-loop pole is unstable, {member.label()}")
    smaller = {row.name: row.bandwidth_Hz for row in found.structures}
    smaller = dict(list(smaller.items())[: list(smaller).index(found.chosen)])
    smaller["own P"], _ = fastest(responses, goal, Bank(1.0))
    # A PI law with a slow integral is fast where |S| of P stays just below -3 dB. It is a law for
    # the same purpose only if the force follows the ramp of the goal.
    hz, slow = fastest(responses, goal, Bank(1.0, SLOW_RAD_PER_S))
    smaller["own PI"] = hz if follows(plants, goal, found, slow) else 0.0
    for name, hz in smaller.items():
        if found.worst.fS_Hz >= LEAST_SHARE * hz:
            continue
        said = "static error" in found.limited_by
        if not (said and name in ("P", "own P") and found.p.static_error > STATIC_ERROR_MAX):
            texts.append(f"{found.chosen} with {found.worst.fS_Hz:.4g} Hz, {name} has {hz:.4g} Hz")
    return texts


def study(kind, seed):
    """(line of the result, faults) of one design."""
    began = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        try:
            plants, goal = made(Path(scratch), kind, seed)
        except ParameterError as error:  # no axis has these values
            return f"{kind} {seed}: no axis: {error}", []
        try:
            found = search.search(plants, goal)
        except ParameterError as error:
            if fastest(Responses(plants, goal.timings), goal, Bank(1.0, SLOW_RAD_PER_S))[0]:
                return f"{kind} {seed}: no law", [f"a PI law keeps the goal, but: {error}"]
            return f"{kind} {seed}: no law: {error}", []
        took = time.process_time() - began
        texts = faults(plants, goal, found)
    rows = ", ".join(f"{row.name} {row.bandwidth_Hz:.3g}" for row in found.structures)
    return (
        f"{kind} {seed}: {found.chosen} {found.worst.fS_Hz:.4g} Hz of {rows}; {took:.1f} s",
        texts,
    )


if __name__ == "__main__":
    bad = 0
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    for number in range(first, first + int(sys.argv[1])):
        line, wrong = study(KINDS[number % len(KINDS)], number // len(KINDS))
        bad += bool(wrong)
        print(line, *(f"    {text}" for text in wrong), sep="\n", flush=True)
    print(f"{bad} bad")
    sys.exit(bad > 0)
