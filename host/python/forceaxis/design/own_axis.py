"""The end of `forceaxis new`: a bank for the new axis, and a contact that is held with it."""

import os

import tomlkit

from forceaxis import _core
from forceaxis.design import changes, reduced, sets, simulate
from forceaxis.design.search import Goal
from forceaxis.linear.bank import Bank

NAME = "held.toml"
PAYS = 1.5  # below this the summary says what limits


def design(folder):
    """(text of NAME or None, what it buys) for the axis in `folder`, as `forceaxis new` wrote it.

    The set: what is pressed on, +-30 %, in every slope of the amplifier; the gain comes down until
    touch-downs and strikes with the firmware are stable. What it buys: {"over", "modes",
    "structure", "bank", "fS_Hz", "p_fS_Hz", "p_force_gain", "p_static_error", "limited_by",
    "contact_loss"}; or {"refused": why} without a bank.
    """
    try:
        with changes.Design(_approach(folder)) as plant:
            return _designed(plant)
    except (_core.InputError, _core.SimulationError) as error:
        return None, {"refused": str(error)}


def _approach(folder):
    """contact.toml with the position gain of step.toml, which mode of operation 4 approaches by."""
    contact, step = (
        tomlkit.parse((folder / name).read_text(encoding="utf-8"))
        for name in ("contact.toml", "step.toml")
    )
    contact["firmware"]["position_gain"] = step["firmware"]["position_gain"]
    path = folder / "approach.toml"
    path.write_text(tomlkit.dumps(contact), encoding="utf-8")
    return path


def _designed(plant):
    bits = plant.facts["reading"]["bits"]
    over = sets.workpiece(plant.model, plant.overrides)
    plants = sets.plant_set(plant.model, plant.overrides, over)
    problem = reduced.Problem(plants, Goal(adc_bits=bits))
    p, found = problem.worst(Bank(1.0)), problem.designed()
    if found["worst"] is None:
        raise _core.InputError(problem.limited_by(found))
    bench = simulate.Bench(plant, bits)
    bank, loss, _, steps = simulate.safe(bench, found["bank"], [{}], threads=os.cpu_count() or 1)
    worst = found["worst"] if not steps else problem.at(bank)
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
        "contact_loss": loss,
    }
    return _text(bench, bank, loss, bought), bought


def _text(bench, bank, loss, bought):
    case = bench.cases[2]
    document = tomlkit.parse(bench.text(case, bank, loss, "model.toml"))
    document["title"] = f"{case.setpoint_N:.4g} N held by a designed bank"
    document["expect"] = {"verdict": "stable"}
    head = tomlkit.document()
    for line in (
        "Contact in mode of operation 4: approach at limited speed, then the force law of bank 1,",
        f"designed for {_set(bought)}: bandwidth {bought['fS_Hz']:.3g} Hz over that set.",
    ):
        head.add(tomlkit.comment(line))
    return tomlkit.dumps(head) + tomlkit.dumps(document)


def _set(bought):
    return ", ".join(text.replace("=", " +-").replace("%", " %") for text in bought["over"])


def describe(bought):
    """Lines (key, value) for the summary of `forceaxis new`."""
    if "refused" in bought:
        return [("bank", f"none: {bought['refused']}")]
    before, after = bought["p_fS_Hz"], bought["fS_Hz"]
    rows = [("set", f"{_set(bought)}: what P and bank bear below, at the same margins")]
    if before:
        rows.append(
            ("P", f"force_gain {bought['p_force_gain']:.4g}, bandwidth fS {before:.3g} Hz, static "
             f"error up to {100 * bought['p_static_error']:.3g} %")
        )  # fmt: skip
    rows.append(
        ("bank", f"{bought['structure']}, bandwidth fS {after:.3g} Hz"
         + (f", {after / before:.2g} times P's" if before else "")
         + f", no static error: {NAME}")
    )  # fmt: skip
    if before and after < PAYS * before:
        rows.append(("limited by", bought["limited_by"]))
    return rows
