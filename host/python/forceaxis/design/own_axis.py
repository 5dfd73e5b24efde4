"""The end of `forceaxis new`: a bank for the new axis, and a contact that is held with it."""

import itertools
import os
from dataclasses import replace

import tomlkit

from forceaxis import _core
from forceaxis.design import changes, friction, reduced, sets, simulate
from forceaxis.design.grid import LOWEST_HZ
from forceaxis.design.search import Goal
from forceaxis.design.simulate import PEAK_MAX, SPEEDS
from forceaxis.linear.bank import Bank
from forceaxis.progress import phase

NAME = "held.toml"
GAINS = (1.0, 0.7, 0.5)  # of the designed one
# How often a touch-down may lose contact: what is asked for, and what a light part may need.
LOSSES = (1, 3)
FRICTIONS, SEED = 3, 1988  # members with random friction
PAYS = 1.5  # below this the summary says what limits


def design(folder):
    """(text of NAME or None, what it buys) for the axis in `folder`, as `forceaxis new` wrote it.

    The set: what is pressed on, +-30 %, in every slope of the amplifier. Of approach speeds, what
    is done at a loss of contact and gains the first is taken with which touch-downs and strikes
    with the firmware settle, largest first. What it buys: {"over", "modes", "structure", "bank",
    "fS_Hz", "p_fS_Hz", "p_force_gain", "p_static_error", "limited_by", "approach_m_per_s"}; or
    {"refused": why} without a bank.
    """
    try:
        with changes.Design(folder / "contact.toml") as plant:
            return _designed(plant, folder)
    except (_core.InputError, _core.SimulationError) as error:
        return None, {"refused": str(error)}


def _approach(folder, count_per_s):
    """contact.toml with a speed of the approach of mode of operation 4."""
    contact = tomlkit.parse((folder / "contact.toml").read_text(encoding="utf-8"))
    contact["firmware"]["approach_velocity_max"] = count_per_s
    path = folder / "approach.toml"
    path.write_text(tomlkit.dumps(contact), encoding="utf-8")
    return path


def _designed(plant, folder):
    over = sets.workpiece(plant.model, plant.overrides)
    plants = sets.plant_set(plant.model, plant.overrides, over)
    bits = plant.facts.required_reading.bits
    problem = reduced.Problem(plants, Goal(adc_bits=bits))
    with phase("searching a bank for the set"):
        p, found = problem.worst(Bank(1.0)), problem.designed()
    if found["worst"] is None:
        raise _core.InputError(problem.limited_by(found))
    designed, worst = problem.exact(found["bank"])
    if worst is None:
        raise _core.InputError(problem.limited_by(found))
    with phase("simulating contacts with the firmware"):
        bank, text, speed = _settled(plant, folder, bits, designed)
    if bank != designed:
        worst = problem.at(bank)
    bought = {
        "over": list(over),
        "modes": list(plants.modes),
        "structure": reduced.NAME,
        "bank": bank.keys(),
        "fS_Hz": worst["fS_Hz"],
        "p_fS_Hz": p["worst"]["fS_Hz"] if p["worst"] else None,
        "p_force_gain": p["bank"].force_gain,
        "p_static_error": p["worst"]["static_error"] if p["worst"] else None,
        "limited_by": problem.limited_by(found),
        "approach_m_per_s": speed,
    }
    return _headed(text, bought), bought


def _settled(plant, folder, bits, designed):
    """(bank, text of NAME, approach speed in m/s) of the first choice that settles."""
    scale = abs(plant.facts.required_encoder.scale)
    fastest = simulate.Bench(plant, bits).cases[0].speed_m_per_s
    rubs = bool(simulate.Bench(plant, bits).frictions)
    spare = None  # the first choice with more losses
    # With friction the default at a loss of contact, a cap of 0, is the last resort: see
    # simulate.losses().
    for stands, gain, share in itertools.product((False, True)[: 1 + rubs], GAINS, SPEEDS):
        bank = replace(designed, force_gain=gain * designed.force_gain).quantised()
        speed = share * fastest
        with changes.Design(_approach(folder, max(1, round(speed * scale)))) as slower:
            bench = simulate.Bench(slower, bits)
            bench.wait_for(designed)
            bench.losses_max = LOSSES[-1]
            plants = [{}, *friction.members(bench.frictions)]
            plants += friction.drawn(bench.frictions, FRICTIONS, SEED) if rubs else []
            for loss in _losses(bench, speed, stands):
                rows = simulate.simulate(bench, bank, plants, (0, 1), loss, os.cpu_count() or 1)
                if bad := simulate.unstable(rows):
                    refused = f"{bad[0]['case']}: {simulate.why(bad[0])}"
                    continue
                losses = max(row["losses"] for row in rows if ", strike" not in row["case"])
                found = bank, _text(bench, bank, loss, max(losses, LOSSES[0])), speed
                if losses <= LOSSES[0]:
                    return found
                spare = spare or found
    if spare:
        return spare
    raise _core.InputError(
        f"no contact settles in simulation, not at {1e3 * speed:.3g} mm/s with {gain:g} of the "
        f"designed gain ({refused}); a softer sensor or pad would"
    )


def _losses(bench, speed, stands):
    """What is done at a loss of contact, in the order in which it is tried."""
    own = bench.press_speed_code(speed)
    slow = [bench.press_speed_code(speed / 4, share) for share in simulate.SHARES]
    caps = [*slow, own, 2048] if bench.frictions else [None, own, 2048]
    return [{"contact_loss_cap": cap} if cap else {} for cap in ([None] if stands else caps)]


def _text(bench, bank, loss, losses):
    """The touch-down at the largest force, with limits of what was asked: force held, overshoot,
    peak, losses of contact, saturation."""
    case = bench.largest
    document = tomlkit.parse(bench.text(case, bank, loss, "model.toml"))
    document["title"] = f"{case.setpoint_N:.4g} N held by a designed bank"
    verdict = document["verdict"]
    for key in ("held_force_error_max_N", "peak_force_max_N"):
        verdict.pop(key, None)  # in percent they are those of another set-point too
    verdict["held_force_error_max_percent"] = 100 * simulate.ERROR_MAX
    verdict["overshoot_max_percent"] = round(100 * (PEAK_MAX - 1))
    verdict["peak_force_max_percent"] = round(100 * PEAK_MAX)
    verdict["contact_losses_max"] = losses
    document["expect"] = {"verdict": "stable"}
    return tomlkit.dumps(document)


def _headed(text, bought):
    head = (
        "Contact in mode of operation 4: approach at limited speed, then the force law of bank 1,",
        f"designed for {_set(bought)}: bandwidth {bought['fS_Hz']:.3g} Hz over that set.",
    )
    return "".join(f"# {line}\n" for line in head) + text


def _set(bought):
    return ", ".join(text.replace("=", " +-").replace("%", " %") for text in bought["over"])


def describe(bought):
    """Lines (key, value) for the summary of `forceaxis new`."""
    if "refused" in bought:
        return [("bank", f"none: {bought['refused']}")]
    before, after = bought["p_fS_Hz"], bought["fS_Hz"]
    compared = before is not None and before > 1.01 * LOWEST_HZ
    rows = [("set", f"{_set(bought)}: what P and bank bear below, at the same margins")]
    if before is not None:
        reached = f"bandwidth fS {before:.3g} Hz" if compared else "|S| never below -3 dB"
        rows.append(
            ("P", f"force_gain {bought['p_force_gain']:.4g}, {reached}, static error up to "
             f"{100 * bought['p_static_error']:.3g} %")
        )  # fmt: skip
    rows.append(
        ("bank", f"{bought['structure']}, bandwidth fS {after:.3g} Hz"
         + (f", {after / before:.2g} times P's" if compared else "")
         + f", no static error: {NAME}")
    )  # fmt: skip
    if compared and after < PAYS * before:
        rows.append(("limited by", bought["limited_by"]))
    return rows
