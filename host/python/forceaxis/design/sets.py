"""The default sets of plants of a design."""

from collections.abc import Iterable
from pathlib import Path

from forceaxis.design import model_file
from forceaxis.linear import over as margins
from forceaxis.linear import system as linear
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.plant_set import PlantSet, set_of
from forceaxis.linear.working import States

# Tolerance of a workpiece whose values come from a data sheet, or from a test without contact.
WORKPIECE_TOLERANCE = "30%"


def workpiece(model: str | Path, overrides: Overrides | None = None) -> tuple[str, ...]:
    """Returns the default tolerances of a set of plants as texts NAME=PERCENT%. The mass of the
    workpiece and the stiffness of its support have a tolerance of 30 %.

    If the workpiece is the ground, the stiffness of the contact has the tolerance instead. The
    result is empty for a model without a contact.
    """
    known, tables = linear.facts(model, overrides).parameters, model_file.read(model)
    if tables.contact is None:
        return ()
    body, support = tables.body(tables.workpiece), tables.support
    named = (support.stiffness, body.mass) if support and body else (tables.contact.stiffness,)
    return tuple(
        f"{name}={WORKPIECE_TOLERANCE}"
        for name in named
        if isinstance(name, str) and name in known and known[name].value
    )


def slopes(
    model: str | Path, overrides: Overrides | None = None, fixed: States | None = None
) -> tuple[dict[str, str], ...]:
    """Returns the modes of a set of plants, each as {element: state}. They combine every linear
    range of the amplifier and of other elements, with stuck and with sliding friction.

    Modes with limited current are excluded, because an axis does not work in these modes. `fixed`:
    {element: state} that all modes have.
    """
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
    """Returns the set of plants of a model.

    `over`: tolerances as texts NAME=PERCENT% or NAME=LOW..HIGH, or None for the result of
    workpiece(). `modes`: {element: state} of each mode, or None for the result of slopes().
    `fixed`: {element: state} that all modes of slopes() have.
    """
    overrides = dict(overrides or {})
    over = workpiece(model, overrides) if over is None else over
    modes = slopes(model, overrides, fixed) if modes is None else modes
    ranges, together = set_of(model, over, overrides)
    return PlantSet(str(model), overrides, ranges, modes or ({},), together)
