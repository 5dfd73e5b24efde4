"""Models of a user's folder: in words, with limits, the recommended P gain, and what laws hold."""

import re

from forceaxis import _core, paths, toml
from forceaxis.design import reduced, sets
from forceaxis.design.search import Goal
from forceaxis.linear import loops, modes, settings, working
from forceaxis.linear import system as linear
from forceaxis.linear.bank import Bank
from forceaxis.words import plain


def limits(model):
    """(force_gain, Hz) at the limit for each timing, None where there is none; or None: no loop."""
    try:
        found = [loops.force_loop(model, timing=timing) for timing in loops.TIMINGS]
    except _core.InputError:  # no sensor of the force, or no response (stuck, no contact)
        return None
    pairs = [(loop, loop.limit()) for loop in found]
    return [
        None if limit.gain is None else (loop.firmware_gain(limit.gain), limit.frequency_hz)
        for loop, limit in pairs
    ]


def described(entries):
    """One row a model that an experiment runs on: title, words, limits, P, laws (see `laws`)."""
    users = {}
    for entry in entries:
        if entry.done:
            users.setdefault(entry.done.model, []).append(entry)
    rows = []
    for model, used_by in users.items():
        row = {
            "id": "model_" + re.sub(r"\W", "_", paths.display(model)),
            "file": paths.display(model),
            "title": toml.read(model).get("title", model.stem),
            "words": words(model),
            "limits": limits(model),
        }
        rows.append(row | laws(model, used_by))
    return rows


def words(model):
    """Sentences about a model."""
    facts, text = linear.facts(model), model.read_text(encoding="utf-8")
    masses = ", ".join(f"{name} {kg:.4g} kg" for name, kg in facts["masses_kg"].items())
    lines = [f"Bodies: {masses}."]
    if drive := facts["drive"]:
        lines.append(f"Drive {drive['type'].replace('_', ' ')} on {drive['body']}.")
    if mode := working.working(model).text:
        lines.append(f"Linear figures are for {mode}.")
    for contact in facts["contacts"]:
        lines.append(f"Contact {contact['name']} between {' and '.join(contact['between'])}.")
    if reading := facts["reading"]:
        unit = facts["signals"].get(reading["signal"], "")
        lines.append(
            f"The firmware reads {reading['signal']} with {reading['bits']} bits, "
            f"{abs(reading['per_count']) * 2 ** (8 - reading['bits']):.3g} {unit} a code."
        )
    try:
        found = modes.modes(model)["modes"]
    except _core.InputError:
        found = []
    if found:
        lines.append(f"Modes at {', '.join(format(m['frequency_hz'], '.3g') for m in found)} Hz.")
    if defaults := text.count("default, check"):
        lines.append(f'{defaults} values are defaults: look for "default, check" in the file.')
    return lines


def laws(model, entries):
    """{"over", "p", "banks"}: the P gain that bears the set of plants at the usual margins, and the
    worst figures over that set of each bank of the experiments; or {"refused": why}."""
    try:
        plants = sets.plant_set(str(model))
        bits = linear.facts(model)["reading"]["bits"]
        problem = reduced.Problem(plants, Goal(adc_bits=bits), random=0)
        p = problem.worst(Bank(1.0))
    except (_core.InputError, TypeError) as error:
        reason = "no force sensor is read" if isinstance(error, TypeError) else str(error)
        return {"refused": reason}
    banks = []
    for entry in entries:
        try:
            own = settings.of(str(entry.file))
        except _core.InputError:  # no force law
            continue
        if own.bank and own.law == "bank":
            banks.append({"entry": entry, "bank": own.bank, "worst": problem.at(own.bank)})
    units = {name: unit for name, (_, unit) in linear.facts(model)["parameters"].items()}
    over = ", ".join(
        f"{name} {plain(low, 4)} to {plain(high, 4)} {units.get(name, '')}".rstrip()
        for name, (_, low, high) in plants.ranges.items()
    )
    return {"over": over, "p": p, "banks": banks}
