"""The default states of the elements of a model for its linearisation. They are the states in which
the axis works.

A force law works while the axis presses and moves. Contacts are then pressed, frictions slide,
backlash is closed, and all other elements are in the middle of their range. The slider of a contact
with hysteresis sticks, as it does in small motions about any point.

Sliding friction is a constant force, so its size and direction do not change the linear equations.
Both flanks of a backlash give the same equations. A friction that the drive cannot overcome never
slides, and stays stuck. At rest all frictions stick, which is another combination of states. If the
command then acts on the measured force, `linear.over` uses this combination as a further plant of a
set.
"""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from stat import S_ISREG
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from forceaxis import _core, toml
from forceaxis.linear import equations, plant_facts
from forceaxis.linear.plant_facts import Overrides, PlantFacts
from forceaxis.results import json_field

STUCK, SLIDING = "stuck", "forward"
FLANKS = (".low", ".high")
OPEN, CLOSED = "apart", "pressed"
SLIDER = ".hysteresis"
DAC_CODES = 2048  # number of DAC codes from 0 V to full scale
SLOW_PER_S = 0.06  # frequency in rad/s that is low enough for a static response

States = Mapping[str, str]  # states of elements: {element: state}
Stamp = tuple[int, int]  # version of a model file: (time of the last change in ns, size in bytes)
Used = tuple[tuple[str, float | str], ...]  # parameter values: ((parameter, value), ...)


@dataclass(frozen=True)
class Friction:
    """An element [[friction]] of a model: its name, its two ends, and its sliding force and
    breakaway force in N. `parameters`: names of the parameters that define these two forces. A name
    is None if the file states the force as a number."""

    name: str
    between: tuple[str, str]
    coulomb_N: float
    stiction_N: float
    parameters: tuple[str | None, str | None]


@dataclass(frozen=True)
class Working:
    """The states of the elements with which a model is linearised. `modes`: {element: state}, given
    by the caller or chosen. `text`: the chosen states as one text line for a user. It is "" if the
    model has no switching element and no state was given."""

    modes: dict[str, str] = json_field(key="mode")
    text: str = json_field(key="mode_text", default="")

    @property
    def shown(self) -> "Working | None":
        """Returns this object for the JSON output, or None if the model has no switching
        element."""
        return self if self.text else None


class _FrictionRow(NamedTuple):
    """A [[friction]] element as written in a model file. A force is a number, a quantity or the
    name of a parameter."""

    name: str
    between: tuple[str, str]
    coulomb: float | str
    stiction: float | str


class _Elements(NamedTuple):
    """The parts of a model file that determine the default states of its elements. `drive`: the
    table [drive] of the file."""

    frictions: tuple[_FrictionRow, ...] = ()
    backlashes: tuple[str, ...] = ()
    sliders: tuple[str, ...] = ()  # names of contacts with hysteresis
    drive: Mapping[str, float | str] = MappingProxyType({})


@lru_cache(maxsize=64)
def _elements(path: str, stamp: Stamp) -> _Elements:
    """Returns the elements of a model file whose default states depend on the parameters. `stamp`:
    time and size of the file, which are part of the key of the cache."""
    table = toml.read(path)
    frictions = (
        _FrictionRow(
            row["name"],
            tuple(row["between"]),
            row["coulomb"],
            row.get("stiction", row["coulomb"]),
        )
        for row in table.get("friction", ())
    )
    sliders = (
        row["name"] + SLIDER for row in table.get("contact", ()) if "hysteresis_stiffness" in row
    )
    return _Elements(
        tuple(frictions), tuple(row["name"] for row in table.get("backlash", ())), tuple(sliders),
        table.get("drive", {}),
    )  # fmt: skip


def _stamp(path: str | Path) -> Stamp | None:
    """Returns the version of a file, or None if there is no such file."""
    try:
        stat = os.stat(path)
    except OSError:
        return None
    return (stat.st_mtime_ns, stat.st_size) if S_ISREG(stat.st_mode) else None


def _own_elements(path: str | Path) -> _Elements:
    # A missing model file is reported later, by the function that reads models.
    stamp = _stamp(path)
    return _elements(str(path), stamp) if stamp else _Elements()


def number(given: float | str | None, parameters: Mapping[str, tuple[float, str]]) -> float | None:
    """Returns the SI value of an entry in a model file: a number, a quantity with a unit, or the
    name of a parameter. Returns None for an entry of another type.

    parameters: {name: (SI value, unit)}, as in facts().
    """
    if isinstance(given, str) and given[:1].isidentifier():
        return parameters.get(given, (None,))[0]
    if isinstance(given, str):
        return float(_core.quantity(given))
    return given if isinstance(given, int | float) else None


def frictions(path: str | Path, overrides: Overrides | None = None) -> tuple[Friction, ...]:
    """Returns the friction elements of the model at `path`, in the order of the file. `overrides`:
    {parameter: value}."""
    rows = _own_elements(path).frictions
    return _frictions(rows, plant_facts.read(str(path), overrides).parameters) if rows else ()


def _frictions(
    rows: Sequence[_FrictionRow], parameters: Mapping[str, tuple[float, str]]
) -> tuple[Friction, ...]:
    found = []
    for row in rows:
        given = row.coulomb, row.stiction
        coulomb, stiction = (number(one, parameters) or 0.0 for one in given)
        first, second = (
            one if isinstance(one, str) and one in parameters else None for one in given
        )
        found.append(Friction(row.name, row.between, coulomb, stiction, (first, second)))
    return tuple(found)


def backlashes(path: str | Path) -> tuple[str, ...]:
    """Returns the names of the backlash elements of a model."""
    return _own_elements(path).backlashes


def sliders(path: str | Path) -> tuple[str, ...]:
    """Returns the names of the sliders of contacts with hysteresis, such as "pad.hysteresis"."""
    return _own_elements(path).sliders


def held(path: str | Path, overrides: Overrides | None = None) -> tuple[Friction, ...]:
    """Returns the friction elements that the drive cannot overcome. The largest force of the drive
    at such an element is below its breakaway force."""
    return _held(*_loaded(_own_elements(path), path, overrides))


def _held(own: Sequence[Friction], arriving: Mapping[str, float]) -> tuple[Friction, ...]:
    return tuple(one for one in own if arriving.get(one.name, math.inf) < one.stiction_N)


def arriving_N(path: str | Path, overrides: Overrides | None = None) -> dict[str, float]:
    """Returns {friction: force in N}. This force is the largest force with which the drive can load
    the friction while it sticks. It is computed for the DAC at full scale within the limits of the
    drive, with all other frictions sliding and all contacts pressed. The result is empty for a
    model without a drive."""
    return _loaded(_own_elements(path), path, overrides)[1]


def _loaded(
    elements: _Elements, path: str | Path, overrides: Overrides | None
) -> tuple[tuple[Friction, ...], dict[str, float]]:
    """Returns two values: the friction elements of a model, and the result of arriving_N()."""
    if not elements.frictions:
        return (), {}
    values = dict(overrides or {})
    known = plant_facts.read(str(path), values)
    own = _frictions(elements.frictions, known.parameters)
    if known.drive is None:
        return own, {}
    full_V = DAC_CODES * known.volts_per_code
    most = _stall_N(elements.drive, known)
    found = {}
    for one in own:
        states = _sliding(elements, own) | {one.name: STUCK}
        m = equations.read(str(path), ["drive.command"], [f"{one.name}.force"], values, states)
        answer = np.linalg.solve(1j * SLOW_PER_S * np.eye(len(m.A)) - m.A, m.B)
        found[one.name] = min(full_V * abs((m.C @ answer + m.D).item()), most)
    return own, found


def _stall_N(table: Mapping[str, float | str], known: PlantFacts) -> float:
    """Returns the largest static force of the drive in N, or infinity if the drive has no limits.
    `table`: the table [drive] of the model file."""
    drive = known.required_drive.values

    def limit(name: str) -> float:
        return number(table.get(name), known.parameters) or math.inf

    if "k_force" in drive:
        return min(limit("peak_current"), limit("rated_current")) * drive["k_force"]
    if "k_torque" not in drive:
        return limit("force_limit")
    current = limit("supply_limit") / drive["R"] if drive["R"] else math.inf
    if drive["k_current"]:
        current = min(current, limit("preamp_limit") / drive["k_current"])
    return float(current * drive["k_torque"] / drive["r_trans"])


def _sliding(elements: _Elements, own: Sequence[Friction]) -> dict[str, str]:
    closed = {name + FLANKS[1]: CLOSED for name in elements.backlashes}
    small = dict.fromkeys(elements.sliders, STUCK)
    return {one.name: SLIDING for one in own} | closed | small


@lru_cache(maxsize=64)
def _contacts(path: str, stamp: Stamp) -> tuple[str, ...]:
    """Returns the names of the contacts of a model. `stamp`: as for _elements()."""
    return tuple(contact.name for contact in plant_facts.read(path).contacts)


@lru_cache(maxsize=512)
def _chosen(path: str, stamp: Stamp, overrides: Used) -> dict[str, str]:
    """Returns the default states of friction and backlash elements. `stamp`: as for
    _elements()."""
    elements = _elements(path, stamp)
    own, arriving = _loaded(elements, path, dict(overrides))
    return _sliding(elements, own) | {one.name: STUCK for one in _held(own, arriving)}


def working(
    path: str | Path,
    overrides: Overrides | None = None,
    modes: States | None = None,
    free: bool = False,
) -> Working:
    """Returns the states of the elements with which the model at `path` is linearised. States in
    `modes` are kept.

    free: True if contacts are open. Raises InputError for a file that is not a model.
    """
    named = dict(modes or {})
    stamp = _stamp(path)
    own = _elements(str(path), stamp) if stamp else _Elements()
    if not stamp or not (own.frictions or own.backlashes or own.sliders):
        return Working(named)
    if own.frictions:
        chosen = dict(_chosen(str(path), stamp, tuple(sorted((overrides or {}).items()))))
    else:
        chosen = _sliding(own, ())
    for name in own.backlashes:
        # If one flank of the backlash is closed, the other flank is not.
        if named.get(name + FLANKS[0], OPEN) != OPEN:
            chosen.pop(name + FLANKS[1])
    taken = chosen | named
    return Working(taken, _text(path, _contacts(str(path), stamp), taken, free))


def friction_states(
    path: str | Path, overrides: Overrides | None = None
) -> list[tuple[tuple[str, str], ...]]:
    """Returns the possible states of each friction of the model as ((name, state), ...). They are
    sliding and stuck, or only stuck if the drive cannot overcome the friction. Both directions of
    sliding give the same linear system, so only one of them is returned."""
    own, arriving = _loaded(_own_elements(path), path, overrides)
    stuck = {one.name for one in _held(own, arriving)}
    return [
        ((one.name, STUCK),) if one.name in stuck else ((one.name, SLIDING), (one.name, STUCK))
        for one in own
    ]


def choices(
    path: str | Path, switches: Mapping[str, tuple[str, ...]], overrides: Overrides | None = None
) -> list[list[dict[str, str]]]:
    """Returns, for each element that switches, the states that can last and that give different
    linear systems. Each state is {switch: its state}. `switches`: as in facts(). A backlash or a
    stop with two ends has at most one closed end. Both flanks of a backlash give the same
    system."""
    found = [[dict([one]) for one in states] for states in friction_states(path, overrides)]
    done = {name for states in found for one in states for name in one}
    plays = backlashes(path)
    for name, states in switches.items():
        low, high = (name.removesuffix(FLANKS[0]) + flank for flank in FLANKS)
        if name in done:
            continue
        if name == low and high in switches and OPEN in states:
            one = [{low: OPEN, high: CLOSED}, {low: CLOSED, high: OPEN}, {low: OPEN, high: OPEN}]
            if name.removesuffix(FLANKS[0]) in plays:
                del one[1]
            found.append(one)
            done.add(high)
        else:
            found.append([{name: state} for state in reversed(states)])
    return found


def _text(path: str | Path, contacts: Sequence[str], taken: dict[str, str], free: bool) -> str:
    left = dict(taken)
    words = []
    for row in _own_elements(path).frictions:
        words.append(f"{row.name} {'stuck' if left.pop(row.name) == STUCK else 'slides'}")
    for name in backlashes(path):
        flanks = [left.pop(name + flank, OPEN) for flank in FLANKS]
        words.append(f"{name} {'closed' if CLOSED in flanks else 'open'}")
    touching = {name: left.pop(name, OPEN if free else CLOSED) for name in contacts}
    words += [f"{name} {state}" for name, state in touching.items()]
    for name in _own_elements(path).sliders:
        state = left.pop(name)
        if touching[name.removesuffix(SLIDER)] != OPEN:
            words.append(f"{name} {state}" + (" (small motions)" if state == STUCK else ""))
    return ", ".join([*words, *(f"{name} {state}" for name, state in left.items())])


def cut_by(
    path: str | Path,
    overrides: Overrides | None,
    taken: States,
    has_path: Callable[[dict[str, str]], bool],
) -> str:
    """Returns the end of an error text. It names the element that interrupts the signal path with
    the states `taken`, and the remedy. It is empty if no single element interrupts the path.
    `has_path(modes)`: function that returns True if the path exists with the states `modes`."""
    for one in held(path, overrides):
        if has_path({**taken, one.name: SLIDING}):
            return (
                f"; {one.name} sticks, because the breakaway force {one.stiction_N:.4g} N exceeds "
                "the force of the drive on this element: check both forces"
            )
    switches = plant_facts.read(str(path), overrides).switches
    order = [*(name for name in taken if name in switches), *switches]
    for name in dict.fromkeys(order):
        for state in reversed(switches[name]):
            if state != taken.get(name) and has_path({**taken, name: state}):
                now = f" while {name} is {taken[name]}" if name in taken else ""
                return f"{now}; `states` {name}={state} gives a signal path"
    return ""
