"""Axes drawn from the ranges of `forceaxis new`, measured in simulation, fitted, designed for, and
judged by what the tool never sees: their true parameters."""

import math

import numpy as np
from forceaxis import linear
from forceaxis._core import InputError
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer
from forceaxis.axis.sim import SimLink
from forceaxis.commission import fit, tune
from forceaxis.commission.refusal import Refusal
from forceaxis.design import data_sheet, files, for_set, new, outcome, own_axis
from forceaxis.design import simulate as simulation
from forceaxis.design.changes import Design
from forceaxis.identify.fit import read_response
from forceaxis.linear import over as margins
from forceaxis.linear.plant_set import PlantSet, ranges_of

OVER = ("k_w=30%,m_w=30%",)
PRESS = {
    "torque_constant_n_m_per_a": 0.5, "resistance_ohm": 4.5, "inductance_h": 0.0158,
    "rotor_inertia_kg_m2": 0.0013, "motor_peak_current_a": 30, "supply_v": 60,
    "lead_mm_per_rev": 25, "moving_mass_kg": 50, "full_scale_speed_m_per_s": 0.4,
    "sensor_full_scale_n": 300, "sensor_stiffness_n_per_m": 4e5, "sensor_noise_n": 0.1,
    "workpiece_stiffness_n_per_m": 4e5, "workpiece_mass_kg": 6, "workpiece_damping_ratio": 0.005,
}  # fmt: skip


def written(folder, sheet):
    values, sources = data_sheet.collect({name: repr(value) for name, value in sheet.items()})
    new.write(folder, values, sources)
    return folder


def press(folder):
    return written(folder, PRESS)


def draw(seed):
    """(data sheet, {parameter: true value over that of the data sheet})."""
    rng = np.random.default_rng([1988, seed])

    def between(low, high):
        return float(math.exp(rng.uniform(math.log(low), math.log(high))))

    lead, moving, full = between(10, 40), between(10, 100), between(150, 500)
    r = lead / 1e3 / (2 * math.pi)
    stiffness = full / (between(0.25, 1) * 1e-3)
    speed, torque = between(0.1, 0.4), between(0.1, 0.8)
    sheet = {
        "torque_constant_n_m_per_a": torque,
        "resistance_ohm": between(0.5, 4),
        "inductance_h": between(2e-3, 1.5e-2),
        "rotor_inertia_kg_m2": between(0.3, 1.5) * moving * r * r,
        "motor_peak_current_a": between(3, 8) * full * r / torque / 0.9,
        "lead_mm_per_rev": lead,
        "moving_mass_kg": moving,
        "guide_damping_n_s_per_m": between(2, 8) * moving,
        "full_scale_speed_m_per_s": speed,
        "velocity_loop_hz": between(20, 60),
        "sensor_full_scale_n": full,
        "sensor_stiffness_n_per_m": stiffness,
        "sensor_damping_n_s_per_m": stiffness * between(5e-5, 5e-4),
        "sensor_noise_n": between(0.5, 1) * full / 2048,
        "encoder_counts_per_rev": round(between(4000, 16000)),
        "workpiece_stiffness_n_per_m": stiffness * between(0.3, 3),
        "workpiece_mass_kg": between(1, 10),
        "workpiece_damping_ratio": between(0.01, 0.05),
    }
    least = 1.2 * sheet["motor_peak_current_a"] * sheet["resistance_ohm"]
    sheet["supply_v"] = max(48.0, 2 * torque * speed / r, least)
    off = {
        "k_w": between(1 / 3, 3), "m_w": between(1 / 3, 3), "b_w": between(1 / 3, 3),
        "k_s": between(0.85, 1.18), "b_s": between(0.5, 2), "b_axis": between(0.5, 2),
        "m_axis": between(0.96, 1.04), "k_torque": between(0.95, 1.05),
        "k_preamp_fdbk": between(0.95, 1.05), "k_preamp_cmd": between(0.97, 1.03),
        "a_preamp_fdbk": between(0.95, 1.05),
    }  # fmt: skip
    return sheet, off


def judged(seed, folder):
    """What became of a drawn axis: {"seed", "refused", ...figures of the true plant}."""
    sheet, off = draw(seed)
    folder = written(folder / f"axis{seed}", sheet)
    model = folder / "model.toml"
    known = {n: value for n, (value, _) in linear.facts(model)["parameters"].items()}
    truth = {n: known[n] * factor for n, factor in off.items()}
    speed = min(0.02, 10 / math.sqrt(known["k_s"] * known["m_axis"]))  # a touch-down of 10 N
    counts = max(1, round(speed * known["encoder_scale"]))
    forces = 30.0, min(150.0, sheet["sensor_full_scale_n"] / 3)
    try:
        found = fitted(folder, truth, forces, counts, min(0.9 * sheet["sensor_full_scale_n"], 300))
        if found.rejected:
            raise Refusal(found.rejected, found.text)
        text = str(own_axis._approach(folder, counts))
        order = outcome.Order(text, over=found.over, overrides=found.values)
        designed = for_set.design(order)
    except (Refusal, NoAnswer, InputError) as error:
        return {"seed": seed, "refused": str(error)}
    plants = PlantSet(str(model), truth, ranges_of(model, OVER, truth), designed.plants.modes)
    worst = margins.worst(plants, ("zoh",), law="bank", bank=designed.bank)
    rows = contacts(text, truth, forces, designed)
    true = known | truth
    return {
        "seed": seed,
        "refused": None,
        "Ms": worst.Ms,
        "Ms_predicted": designed.worst["Ms"],
        "fS_Hz": worst.fS_Hz,
        "p_fS_Hz": designed.p["fS_Hz"],
        "stable": not simulation.unstable(rows),
        "static_error_percent": [row["static_error_percent"] for row in rows],
        "inside": sum(low <= true[n] <= high for n, (low, high) in found.intervals.items()),
        "of": len(found.intervals),
        "limited_by": designed.limited_by,
    }


def fitted(folder, truth, forces, counts, force_max_N):
    """The fit of what is measured: apart, and at the forces."""
    model = folder / "model.toml"
    given = [f"{name}={value!r}" for name, value in truth.items()]
    given += [f"firmware.approach_velocity_max={counts}", "firmware.contact_loss_cap=2048"]
    with Axis(SimLink(folder / "contact.toml", given)) as axis:
        order = tune.Order(str(model), forces, OVER, force_max_N=force_max_N)
        work = tune.Tuning(axis, order, folder / "tune")
        for step in ("check", "free", "measure"):
            work.run(only=step)
    names = ["free", *(f"{force:g}N" for force in forces)]
    responses = [read_response(folder / "tune" / name, model) for name in names]
    return fit.joint(model, fit.priors(model, OVER), responses, OVER)


def contacts(text, truth, forces, designed):
    """Rows of simulate: the true plant's contacts at the forces."""
    with Design(text, truth) as plant:
        bench = simulation.Bench(plant, designed.bits)
        bench.wait_for(designed.bank)
        bench.rated_N = max(forces)
        bench.settings["rated_force"] = round(1e3 * bench.rated_N)
        loss = {name: designed.loss[name] for name in files.LOSS if name in designed.loss}
        cases = [simulation.Case(force, bench.cases[0].speed_m_per_s) for force in forces]
        jobs = [bench.job(case, designed.bank, {}, 0, loss) for case in cases]
        done = simulation.run(jobs, 1)
        return [
            simulation.row("design", case.name, {}, 0, outcome)
            for case, outcome in zip(cases, done, strict=True)
        ]
