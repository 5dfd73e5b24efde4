"""The default sets of plants of a design."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from forceaxis import toml
from forceaxis.design.changes import contact_of
from forceaxis.linear import over as margins
from forceaxis.linear import system as linear
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.plant_set import PlantSet, ranges_of
from forceaxis.linear.working import States

SHARE = "30%"  # uncertainty of a workpiece after a data sheet or a test without contact


def workpiece(model: str | Path, overrides: Overrides | None = None) -> tuple[str, ...]:
    """Default of --over for the workpiece, +-30 %: its mass and the stiffness of its support. If
    the workpiece is the ground: the stiffness of the contact. Empty without a contact."""
    table = toml.read(linear.find_model(model))
    known = linear.facts(model, overrides).parameters
    contact = contact_of(table)
    if contact is None:
        return ()
    body = contact["between"][1]
    supports = [s for s in table.get("spring", ()) if body in s["between"]]
    masses = [b["mass"] for b in table["body"] if b["name"] == body]
    if len(supports) == 1 and masses:
        named: tuple[Any, ...] = (supports[0].get("stiffness"), masses[0])
    else:
        named = (contact.get("stiffness"),)
    return tuple(f"{n}={SHARE}" for n in named if n in known and known[n][0])


def slopes(
    model: str | Path, overrides: Overrides | None = None, fixed: States | None = None
) -> tuple[dict[str, str], ...]:
    """Modes of a PlantSet: every linear range of the amplifier and of other elements, frictions
    stuck and sliding, but no limits of the current, at which an axis is not meant to work. fixed:
    states that all modes have."""
    return tuple(
        modes
        for modes in margins.modes_all(model, overrides, fixed=fixed)
        if "drive.current_feedback" not in modes
    )


def plant_set(
    model: str | Path,
    overrides: Overrides | None = None,
    over: Iterable[str] | None = None,
    modes: tuple[dict[str, str], ...] | None = None,
    fixed: States | None = None,
) -> PlantSet:
    """The PlantSet of a model. over: texts as --over, None: `workpiece`; modes: None: `slopes`,
    with the states of `fixed`."""
    overrides = dict(overrides or {})
    over = workpiece(model, overrides) if over is None else over
    modes = slopes(model, overrides, fixed) if modes is None else modes
    return PlantSet(str(model), overrides, ranges_of(model, over, overrides), modes or ({},))
