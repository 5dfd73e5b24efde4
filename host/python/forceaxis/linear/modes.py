"""Modes of vibration of a model. The analysis also finds which modes of vibration are dynamically
colocated (thesis sections 2.4 to 2.6 and 6.1.4).

The labels follow from the undamped mechanics without the drive, M x'' + K x = force. The output has
to be a function of positions: the measured force, or the position of the endpoint out of contact.
The response from the drive's pair of forces to this output is sum r_i / (s^2 + w_i^2). The sign of
the residue r_i shows whether actuator and sensor move in the same direction in mode i.

* Comparison with the lowest mode, the reference: a mode with the same sign is colocated, and a mode
  with the opposite sign is noncolocated. This is the label of the mode. The thesis requires motion
  opposite to that of the rigid-body mode.

* Comparison with the next lower mode: with the same sign, a pair of zeros lies between the two
  modes, so that the phase recovers. With the opposite sign there is no zero, and the phase
  decreases by 180 degrees.

Only modes with a residue are compared. A mode with the residue 0 has its zeros exactly on its
poles. If dampers couple such a mode to input and output, its poles and zeros are close together.
The base in Figure 2.16a is an example. The mode is then colocated. Otherwise it has no label and no
effect on the loop.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import linalg, optimize

from forceaxis._core import InputError
from forceaxis.linear import system as linear
from forceaxis.linear import working
from forceaxis.linear.equations import Matrix
from forceaxis.linear.plant_facts import ContactFacts, Overrides, PlantFacts
from forceaxis.linear.working import States, Working
from forceaxis.results import json_field

CRITERION = (
    "sign of the undamped residue from input to output, drive removed: against the lowest mode "
    "(label) and against the mode below; residue 0: colocated if dampers couple it, else neither"
)
# Largest residue that counts as 0, divided by the sum of all residues.
NO_RESIDUE = 1e-9
# Largest frequency of a rigid mode, divided by the highest frequency of all modes.
# The frequency of a rigid-body mode differs from 0 only by rounding errors.
NO_STIFFNESS = 1e-6
# Below this magnitude in rad/s, all poles count as equally similar to a mode at 0 Hz.
SLOW_RAD_PER_S = 0.06


@dataclass(frozen=True)
class Pole:
    """A pole of a system with damping. Of a complex pair, this is the pole with the positive
    imaginary part.

    frequency_hz: magnitude of the pole divided by 2 pi. damping_ratio: damping ratio, or None for a
    pole at 0. real_per_s, imag_per_s: real and imaginary part in 1/s.
    """

    frequency_hz: float
    damping_ratio: float | None
    real_per_s: float = json_field(key="real")
    imag_per_s: float = json_field(key="imag")


@dataclass(frozen=True)
class VibrationMode:
    """One mode of vibration of the mechanics, without damping and without the drive.

    damping_ratio: effect of the dampers in the undamped mode shape, or None at 0 Hz. shape: {point:
    displacement}. The largest displacement has the magnitude 1. A point is a body or a port.
    residue: residue of the response from input to output, in the unit of the output per N s^2.

    label, against_lowest: "colocated", "noncolocated" or "neither", in comparison with the lowest
    mode that has a residue. `reference` is True for that mode. against_below: the same in
    comparison with the next lower mode. driven: the corresponding pole of the complete system with
    damping and drive, or None.
    """

    frequency_hz: float
    damping_ratio: float | None
    shape: dict[str, float]
    residue: float
    label: str
    against_lowest: str
    against_below: str
    reference: bool
    driven: Pole | None

    @property
    def largest_body(self) -> str:
        """The body or port with the largest displacement in the mode of vibration."""
        return max(self.shape, key=lambda body: abs(self.shape[body]))


@dataclass(frozen=True, kw_only=True)
class ModeAnalysis:
    """The modes of vibration of a model with their labels, in ascending order of frequency.

    model: name of the model file without suffix. contact: "pressed", "apart", or None for a model
    without contact. working: states of the elements, or None if no element has different states.
    has_path: True if the input acts on the output. other_poles: poles of the complete system that
    correspond to no mode of vibration.
    """

    model: str
    title: str
    contact: str | None
    working: Working | None = json_field(inline=True)
    input: str
    output: str
    has_path: bool = json_field(key="path")
    criterion: str
    modes: list[VibrationMode]
    other_poles: list[Pole]


@dataclass(frozen=True)
class Mechanics:
    """The modes of vibration of a model without damping and without the drive. There are c
    coordinates, p points and n modes of vibration.

    bodies: names of the coordinates, which are the bodies and the modes of structures. masses (c,):
    in kg. w (n,): angular frequencies in rad/s, ascending. shapes (c, n): displacement of each
    coordinate in each mode, scaled to a modal mass of 1 kg. damping_ratio (n,): nan for w = 0.
    drive (n,), output (n,): gains of the input and of the output in each mode. points: names of the
    bodies and of the ports of structures. places (p, n): displacement of each point in each mode.
    """

    bodies: tuple[str, ...]
    masses: np.ndarray
    w: np.ndarray
    shapes: np.ndarray
    damping_ratio: np.ndarray
    drive: np.ndarray
    output: np.ndarray
    points: tuple[str, ...]
    places: np.ndarray


def mechanics(
    model: str | Path,
    input: str,
    output: str,
    overrides: Overrides | None = None,
    states: States | None = None,
    free: bool = False,
) -> Mechanics:
    """Returns the modes of vibration between one input and one output, without damping and without
    the drive.

    model, overrides, free: as in `modes`. input: "drive.force" or "BODY.force" in N. output: a
    signal that is a function of positions. states: {element: state} of elements outside the drive.
    Raises InputError for a model, parameter, signal or state that does not exist.
    """
    facts = linear.facts(model, overrides)
    masses = facts.coordinates_kg
    names = tuple(masses)
    pushes = [f"{name}.force" for name in names]
    system = linear.linearise(
        model, [input, *pushes], [output], overrides, states, free=free, drive=False
    )
    x = [system.states.index(f"{name}.position") for name in names]
    v = [system.states.index(f"{name}.velocity") for name in names]
    root = np.sqrt(np.array([masses[name] for name in names]))
    # In the coordinates sqrt(m) x, with the masses m, all matrices are symmetric.
    # Stuck frictions turn the equation into M x'' = P (force - K x) with a projection P.
    # The shapes of all modes of vibration are in the range of P, the projection by stuck frictions.
    P = root[:, None] * system.B[np.ix_(v, range(1, len(v) + 1))] * root
    share, basis = linalg.eigh((P + P.T) / 2)
    basis = basis[:, share > 0.5]

    def symmetric(columns: list[int]) -> np.ndarray:
        scaled = -root[:, None] * system.A[np.ix_(v, columns)] / root
        reduced = basis.T @ scaled @ basis
        result: Matrix = (reduced + reduced.T) / 2
        return result

    squares, vectors = linalg.eigh(symmetric(x))
    shapes = basis @ vectors
    push = shapes.T @ (root * system.B[v, 0])
    # Modes with equal frequencies are rotated so that the input excites only one of them.
    highest = squares.max(initial=0.0)
    w = np.sqrt(np.where(squares > NO_STIFFNESS**2 * highest, squares, 0.0))
    first = 0
    while first < len(w):
        last = int(np.searchsorted(w, w[first] + 1e-9 * np.sqrt(highest), side="right"))
        if last - first > 1:
            turn = linalg.qr(push[first:last, None])[0]
            shapes[:, first:last] = shapes[:, first:last] @ turn
            vectors[:, first:last] = vectors[:, first:last] @ turn
        first = last
    loss = np.einsum("in,ij,jn->n", vectors, symmetric(v), vectors)
    with np.errstate(divide="ignore", invalid="ignore"):
        zeta = np.where(w > 0, loss / (2 * w), np.nan)
    shapes = shapes / root[:, None]
    push = shapes.T @ (root**2 * system.B[v, 0])
    places = facts.displacements() @ shapes if facts.structures else shapes
    seen = system.C[0, x] @ shapes
    return Mechanics(names, root**2, w, shapes, zeta, push, seen, facts.points, places)


def default_output(facts: PlantFacts, apart: Sequence[ContactFacts]) -> str:
    """Returns the output at which the residues are computed: the measured signal, or the position
    of the body that would touch the workpiece. `apart`: the open contacts if all contacts of the
    model are open, otherwise empty."""
    for contact in apart:
        return next(end for end in contact.between if end != "ground") + ".position"
    reading = facts.reading
    if reading and not reading.signal.startswith("drive."):
        return reading.signal
    # A tachometer signal or a motor current follows the motion of the drive, not of the workpiece.
    body = facts.required_drive.body if facts.drive else facts.points[0]
    return f"{body}.position"


def as_positions(output: str) -> str:
    """Returns the signal whose residues are compared for an output. For a velocity or acceleration,
    this is the position. For the time derivative of a force, it is the force."""
    for ending, plain in (
        (".velocity", ".position"),
        (".acceleration", ".position"),
        (".spring_force_rate", ".spring_force"),
    ):
        if output.endswith(ending):
            return output.removesuffix(ending) + plain
    return output


def modes(
    model: str | Path,
    input: str = "drive.force",
    output: str | None = None,
    overrides: Overrides | None = None,
    states: States | None = None,
    free: bool = False,
) -> ModeAnalysis:
    """Returns the modes of vibration of a model with their labels, in ascending order of frequency.

    model: a path, or the file name without suffix in sim/models. input: "drive.force" or
    "BODY.force", in N. output: a signal of the model. The default is the measured force, or the
    position of the endpoint if no contact is closed. A velocity or acceleration is replaced by its
    position. overrides: {parameter: SI value or text with a unit}. states: {element: state} in
    which the model is analysed. free: True if contacts are open.

    Raises InputError for a model, parameter, signal or state that does not exist, and if the input
    has no effect on a given output.
    """
    path = linear.find_model(model)
    facts = linear.facts(path, overrides)
    taken = working.working(path, overrides, states, free)
    states = taken.modes
    contacts = facts.contacts
    otherwise = "apart" if free else "pressed"
    pressed = any(states.get(c.name, otherwise) == "pressed" for c in contacts)
    named = output is not None or input not in ("drive.force", "drive.command")
    if input == "drive.command":
        # The input is the force of the drive, so that the dynamics of the drive are left out.
        input = "drive.force"
    if output in ("reading", "adc0") and facts.reading:
        # signal of the force sensor before the filter of the ADC
        output = facts.required_reading.signal
    if output is None:
        output = default_output(facts, [] if pressed else contacts)
    output = as_positions(output)
    of_mechanics = {k: v for k, v in states.items() if not k.startswith("drive.")}
    m = mechanics(path, input, output, overrides, of_mechanics, free)
    residues = m.drive * m.output
    total = np.abs(residues).sum()
    seen = np.abs(residues) > NO_RESIDUE * total if total > 0 else np.zeros(len(residues), bool)

    bare = linear.linearise(path, [input], [output], overrides, of_mechanics, free, drive=False)
    damped = _damped_residues(m, bare)
    has_path = bool(seen.any() or damped.any())
    if named and not has_path:

        def moves(modes: dict[str, str]) -> bool:
            of_mode = linear.linearise(path, [input], [output], overrides, modes, free)
            return bool(of_mode.has_path())

        cut = working.cut_by(path, overrides, states, moves)
        raise InputError(
            f"{path}: expected an output that the input moves, got no signal path from {input} to "
            f"{output} in this "
            f"mode{cut or '; choose other signals, or give another state in `states`'}"
        )
    driven = linear.linearise(path, [input], [output], overrides, states, free)
    matched, others = match(m, driven)

    rows, reference, below = [], None, None
    for i, w in enumerate(m.w):
        if seen[i]:
            reference = i if reference is None else reference
            below = i if below is None else below
            lowest, next_below = (
                "colocated" if residues[i] * residues[j] > 0 else "noncolocated"
                for j in (reference, below)
            )
            below = i
        else:
            lowest = next_below = "colocated" if damped[i] else "neither"
        largest = m.places[np.argmax(np.abs(m.places[:, i])), i]
        # A displacement of 0 is possible: all ports may be at nodes of the mode.
        shape = m.places[:, i] / (largest or 1.0)
        rows.append(
            VibrationMode(
                frequency_hz=float(w / (2 * np.pi)),
                damping_ratio=None if w == 0 else float(m.damping_ratio[i]),
                shape=dict(zip(m.points, map(float, shape), strict=True)),
                residue=float(residues[i]) if seen[i] else 0.0,
                label=lowest,
                against_lowest=lowest,
                against_below=next_below,
                reference=i == reference,
                driven=matched[i],
            )
        )
    return ModeAnalysis(
        model=path.stem,
        title=facts.title,
        contact=("pressed" if pressed else "apart") if contacts else None,
        working=taken.shown,
        input=input,
        output=output,
        has_path=has_path,
        criterion=CRITERION,
        modes=rows,
        other_poles=others,
    )


def match(m: Mechanics, system: linear.System) -> tuple[list[Pole | None], list[Pole]]:
    """Assigns a pole of the damped system `system` to each undamped mode of vibration. Returns
    ([pole or None for each mode], [other poles]).

    Each pole is assigned at most once. The mode has similar displacements and a similar frequency.
    """
    poles, vectors = linalg.eig(system.A)
    keep = poles.imag >= 0
    poles, vectors = poles[keep], vectors[:, keep]
    pairs = _assign(m, system, poles, vectors)
    # The exact pole of a rigid body is 0, but the computed pole differs by rounding errors.
    poles = np.where(np.abs(poles) > 1e-12 * np.abs(poles).max(), poles, 0)
    names = [_pole(p) for p in poles]
    others = sorted(
        (p for j, p in enumerate(names) if j not in pairs.values()), key=lambda p: p.frequency_hz
    )
    return [names[pairs[i]] if i in pairs else None for i in range(len(m.w))], others


def _assign(
    m: Mechanics, system: linear.System, poles: np.ndarray, vectors: np.ndarray
) -> dict[int, int]:
    """Returns {index of a mode of vibration: index of its pole}. The displacements and the
    frequency of this pole are most similar to the mode."""
    x = [system.states.index(f"{name}.position") for name in m.bodies]
    shapes = vectors[x] * np.sqrt(m.masses)[:, None]
    norm = np.linalg.norm(shapes, axis=0)
    overlap = np.abs((m.shapes * np.sqrt(m.masses)[:, None]).T @ shapes) ** 2
    overlap /= np.where(norm > 0, norm, 1) ** 2
    near = np.abs(np.log((np.abs(poles) + SLOW_RAD_PER_S) / (m.w[:, None] + SLOW_RAD_PER_S)))
    rows, columns = optimize.linear_sum_assignment(-overlap * np.exp(-near))
    return dict(zip(map(int, rows), map(int, columns), strict=True))


def _damped_residues(m: Mechanics, system: linear.System) -> np.ndarray:
    """Returns an array with one value for each mode of vibration. It is True if the damped
    mechanics have a residue at the pole of this mode."""
    poles, left, right = linalg.eig(system.A, left=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.einsum("in,in->n", left.conj(), right)
        residues = np.abs((system.C[0] @ right) * (left.conj().T @ system.B[:, 0]) / scale)
    # A free body without damping has a double pole at 0, where no residue is defined.
    residues[~np.isfinite(residues) | (np.abs(poles) < 1e-6 * np.abs(poles).max())] = 0.0
    keep = np.flatnonzero(poles.imag >= 0)
    pairs = _assign(m, system, poles[keep], right[:, keep])
    sizes = np.array([residues[keep[pairs[i]]] if i in pairs else 0.0 for i in range(len(m.w))])
    result: Matrix = sizes > NO_RESIDUE * max(residues.sum(), 1e-300)
    return result


def _pole(pole: complex) -> Pole:
    size = abs(pole)
    return Pole(
        frequency_hz=float(size / (2 * np.pi)),
        damping_ratio=float(-pole.real / size) if size > 0 else None,
        real_per_s=float(pole.real),
        imag_per_s=float(pole.imag),
    )
