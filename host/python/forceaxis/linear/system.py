"""The plant as a linear system, for given states of its elements. The module computes matrices,
poles, zeros and responses, and samples the system with a zero-order hold.

All results come from the equations that the time simulation integrates (`_core.linear`). The module
`loops` closes control loops around the system, and `modes` analyses the mechanics alone. Poles,
zeros and zero-order holds are computed in extended precision (sim/linear/extended.hpp), because the
last digits of LAPACK depend on the processor.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from forceaxis import _core, paths
from forceaxis.errors import ParameterError
from forceaxis.linear import equations, plant_facts
from forceaxis.linear import working as working_mode
from forceaxis.linear.equations import Matrix
from forceaxis.linear.plant_facts import Overrides, PlantFacts
from forceaxis.linear.working import States, Working
from forceaxis.results import json_field

if TYPE_CHECKING:
    import control

TICK_S = 1 / _core.TICKS_PER_SECOND
CODE = "drive.code"  # input of linearise()


def _complement(rows: Matrix) -> Matrix:
    """Returns n - d orthonormal columns of length n that are orthogonal to all d rows. They are
    computed by Householder reflections."""
    work = np.array(rows.T, np.longdouble)
    basis = np.eye(len(work), dtype=np.longdouble)
    for k in range(len(rows)):
        turn = work[k:, k].copy()
        turn[0] += np.copysign(np.linalg.norm(turn), turn[0])
        turn /= np.linalg.norm(turn)
        work[k:] -= 2 * turn[:, None] * (turn @ work[k:])
        basis[:, k:] -= 2 * (basis[:, k:] @ turn)[:, None] * turn
    return basis[:, len(rows) :]


@dataclass(frozen=True)
class System:
    """A linear system with y = C x + D u. It is x' = A x + B u, or x(k+1) = A x(k) + B u(k) every
    `dt` seconds.

    A (n, n), B (n, m), C (p, n), D (p, m): float arrays in SI units. `states`, `inputs` and
    `outputs` name their rows and columns. Some methods use one transfer function (`zeros`,
    `transfer_function`). They need one input and one output, which `select` selects.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float | None = None

    def select(
        self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
    ) -> "System":
        """Returns the system with only the given inputs and outputs."""
        columns = [self.inputs.index(name) for name in inputs or self.inputs]
        rows = [self.outputs.index(name) for name in outputs or self.outputs]
        return replace(
            self,
            B=self.B[:, columns],
            C=self.C[rows],
            D=self.D[np.ix_(rows, columns)],
            inputs=tuple(self.inputs[i] for i in columns),
            outputs=tuple(self.outputs[i] for i in rows),
        )

    @cached_property
    def balanced(self) -> tuple[Matrix, Matrix, Matrix]:
        """The matrices (A, B, C) in other units of the states, so that rows and columns of A have
        similar magnitudes."""
        if not len(self.A):
            return self.A, self.B, self.C
        scale = _core.balance(self.A)
        return self.A * scale / scale[:, None], self.B / scale[:, None], self.C * scale

    def poles(self) -> Matrix:
        """Returns the poles of the system, which are the eigenvalues of A. They are in 1/s, or
        values of z for a sampled system."""
        result: Matrix = _core.eigenvalues(self.A)
        return result

    def poles_s(self) -> Matrix:
        """Returns the poles of the system in 1/s. For a sampled system they are log(z) / dt. A pole
        at z = 0 is then -infinity."""
        return self._per_second(self.poles())

    def stable(self) -> bool:
        """Returns True if all poles of the system are inside the stable region."""
        poles = self.poles()
        return bool(np.all(poles.real < 0 if self.dt is None else abs(poles) < 1))

    def _markov(self) -> tuple[int, float]:
        """Returns (relative degree r of the transfer function, first Markov parameter that is not
        0). This Markov parameter is C A^(r-1) B, or D for r = 0."""
        if self.B.shape[1] != 1 or self.C.shape[0] != 1:
            raise ValueError("expected one input and one output")
        A, B, C = (matrix.astype(np.longdouble) for matrix in self.balanced)
        if self.D[0, 0] != 0:
            return 0, self.D[0, 0]
        row, bound = C, abs(C)
        for degree in range(1, len(A) + 1):
            if not row.any():
                break
            value, size = (row @ B).item(), (bound @ abs(B)).item()
            # A Markov parameter below this bound is 0, apart from rounding errors.
            if abs(value) > 1e-11 * size:
                return degree, value
            row, bound = row @ A, bound @ abs(A)
        return len(A) + 1, 0.0  # The input of the system does not act on the output.

    def has_path(self) -> bool:
        """Returns True if the input of the system acts on the output."""
        return self._markov()[1] != 0.0

    def zeros(self) -> Matrix:
        """Returns the zeros of the transfer function in 1/s, or in z for a sampled system. Zeros
        that cancel poles are included.

        The zeros are the poles of the system under a feedback that keeps its output at 0. This
        feedback uses the lowest derivative of the output on which the input acts. Only states count
        for which the output and its lower derivatives are 0.
        """
        degree, value = self._markov()
        if value == 0.0:
            raise ValueError(f"expected a path from {self.inputs[0]} to {self.outputs[0]}")
        A, B, C = (matrix.astype(np.longdouble) for matrix in self.balanced)
        if not degree:
            result: Matrix = _core.eigenvalues(A - B @ C / value)
            return result
        # Rows of the output and of its lower derivatives, made orthogonal to each other.
        rows = C / np.linalg.norm(C)
        for _ in range(degree - 1):
            row = rows[-1:] @ A
            for _ in range(2):
                row = row - (row @ rows.T) @ rows
            rows = np.vstack([rows, row / np.linalg.norm(row)])
        held = A - B @ (rows[-1:] @ A) / (rows[-1:] @ B)
        basis = _complement(rows)
        result = _core.eigenvalues(basis.T @ held @ basis)
        return result

    def zeros_s(self) -> Matrix:
        """Returns the zeros of the transfer function in 1/s. Zeros of a sampled system are
        converted as in `poles_s`."""
        return self._per_second(self.zeros())

    def _per_second(self, roots: Matrix) -> Matrix:
        if self.dt is None:
            return roots.astype(complex)
        with np.errstate(divide="ignore", invalid="ignore"):
            result: Matrix = np.log(roots.astype(complex)) / self.dt
            return result

    def gain(self) -> float:
        """Returns the factor g of the transfer function g prod(s - zero) / prod(s - pole)."""
        return float(self._markov()[1])

    def transfer_function(self) -> tuple[Matrix, Matrix]:
        """Returns the coefficients (numerator, denominator) of the transfer function, with the
        highest power first. The first coefficient of the denominator is 1."""
        value = self.gain()
        if value == 0.0:
            return np.zeros(1), polynomial(self.poles())
        return value * polynomial(self.zeros()), polynomial(self.poles())

    @cached_property
    def _hessenberg(self) -> tuple[Matrix, Matrix, Matrix]:
        result: tuple[Matrix, Matrix, Matrix] = _core.hessenberg(*self.balanced)
        return result

    def at(self, points: ArrayLike) -> Matrix:
        """Returns the values of the transfer function at complex points s (or z), in the shape of
        `points`. With several inputs or outputs, the shape is extended by (outputs, inputs)."""
        s = np.asarray(points, complex)
        H, B, C = self._hessenberg
        values: Matrix = _core.hessenberg_response(H, B, C, self.D, s.ravel())
        if values.shape[1:] == (1, 1):
            return values.reshape(s.shape)
        return values.reshape(s.shape + values.shape[1:])

    def response(self, frequency_hz: ArrayLike) -> Matrix:
        """Returns the frequency response at frequencies in Hz. The result has the same shape as the
        result of at()."""
        s = 2j * np.pi * np.asarray(frequency_hz, float)
        return self.at(s if self.dt is None else np.exp(s * self.dt))

    def sampled(self, delay_ticks: int = 0, dt: float = TICK_S, extended: bool = False) -> "System":
        """Returns the sampled system with a zero-order hold at its input. `dt`: sampling period in
        s. `delay_ticks`: number of samples by which the inputs act later. `extended`: True if A and
        B are returned as np.longdouble. With double precision, a very small response G would lose
        its digits."""
        if self.dt is not None:
            raise ValueError("expected a continuous system")
        n = len(self.A)
        step = _core.sampled(self.A, self.B, dt)
        A, B = np.eye(n) + step[:, :n], step[:, n:]
        if not extended:
            A, B = A.astype(float), B.astype(float)
        system = replace(self, A=A, B=B, dt=dt)
        for _ in range(delay_ticks):
            system = system.delayed()
        return system

    def delayed(self) -> "System":
        """Returns this sampled system with an additional delay of one sample at its inputs."""
        n, m = self.B.shape
        A = np.zeros((n + m, n + m), self.A.dtype)
        A[:n, :n], A[:n, n:] = self.A, self.B
        waiting = tuple(
            f"{name} held {sum(name in s for s in self.states)}" for name in self.inputs
        )
        return replace(
            self,
            A=A,
            B=np.vstack([np.zeros((n, m)), np.eye(m)]),
            C=np.hstack([self.C, self.D]),
            D=np.zeros_like(self.D),
            states=self.states + waiting,
        )

    def state_space(self) -> "control.StateSpace":
        """Returns the system as `control.StateSpace`, with the names of inputs, outputs and states.
        Dots in these names become _, because python-control does not allow dots."""
        import control

        def plain(names: Sequence[str]) -> list[str]:
            return [name.replace(".", "_") for name in names]

        return control.ss(
            *(self.A, self.B, self.C, self.D),
            self.dt or 0,
            states=plain(self.states),
            inputs=plain(self.inputs),
            outputs=plain(self.outputs),
            remove_useless_states=False,
        )


def polynomial(roots: Matrix) -> Matrix:
    """Returns the coefficients of the real polynomial with the given roots, with the highest power
    first. The first coefficient is 1."""
    # Without roots, NumPy returns the scalar 1 as the polynomial.
    return np.atleast_1d(np.real(np.poly(roots)))


def find_model(text: str | Path) -> Path:
    """Returns the path of a model. `text`: its path, or the name of a file in sim/models without
    suffix (fig4_19)."""
    path = Path(text)
    if path.suffix == ".toml" or path.parent != Path():
        return path
    known = paths.MODELS / f"{text}.toml"
    if not known.exists():
        raise _core.InputError(
            f"MODEL: {text}: expected a path ending in .toml or one of "
            + ", ".join(sorted(p.stem for p in paths.MODELS.glob("*.toml")))
        )
    return known


def overrides(texts: Iterable[str]) -> dict[str, float | str]:
    """Returns {name: value} from texts NAME=VALUE. A value is a number, the text of a quantity with
    a unit, or the name of another parameter. Raises ParameterError for a text of another form, and
    for a name with two different values."""
    values: dict[str, float | str] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not name or not value:
            raise ParameterError(
                "overrides", f"{text}: expected NAME=VALUE with a number or a quantity as VALUE"
            )
        if name in values:
            raise ParameterError(
                "overrides",
                f"{name}: expected one value, got {values[name]} and {value}; remove one of these "
                "values",
            )
        try:
            values[name] = float(value)
        except ValueError:
            values[name] = value
    return values


def shown(value: float | str) -> str:
    """Returns the value of an override as text for a user."""
    return value if isinstance(value, str) else f"{value:g}"


def override_texts(values: Overrides) -> list[str]:
    """Returns texts NAME=VALUE from {name: number or text}."""
    return [f"{n}={v if isinstance(v, str) else repr(float(v))}" for n, v in values.items()]


def states(texts: Sequence[str]) -> dict[str, str]:
    """Returns {element: state} from texts ELEMENT=STATE. Raises ParameterError for a text of
    another form."""
    for text in texts:
        if not all(text.partition("=")):
            raise ParameterError(
                "states",
                f"{text}: expected ELEMENT=STATE, the name of an element and a state of this "
                "element",
            )
    return {t.partition("=")[0]: t.partition("=")[2] for t in texts}


def facts(model: str | Path, overrides: Overrides | None = None) -> PlantFacts:
    """Returns the contents of a model: bodies, signals with units, parameters, drive, sensor and
    encoder."""
    return plant_facts.read(str(find_model(model)), overrides)


def linearise(
    model: str | Path,
    inputs: Sequence[str] = ("drive.command",),
    outputs: Sequence[str] = ("reading",),
    overrides: Overrides | None = None,
    modes: States | None = None,
    free: bool = False,
    drive: bool = True,
) -> System:
    """Returns a model with given states of its elements as a System. The System has the equations
    that the simulation integrates.

    model: a path, or the file name without suffix in sim/models.

    inputs: drive.command (V), drive.code (DAC codes of the same command), drive.tach (V, added to
    the tachometer voltage), drive.force (N, between the body of the drive and its reaction body, in
    addition to the force of the drive), BODY.force (N, from outside).

    outputs: any signal of the model, reading (the input of ADC 0 in its own unit), adc0 and adc1
    (8-bit counts), encoder (counts).

    overrides: {parameter: value}. modes: {element: state}, with the names of events.csv, such as
    {"drive.amplifier": "high outer", "rail": "stuck"}. free: True if contacts are open. drive:
    False removes the drive. The input drive.command then means drive.force.

    Elements that `modes` does not name are in their default state. By default, contacts are
    pressed, frictions slide, and backlash is closed (see `working`). Every other element is in the
    middle of its range.

    Raises InputError for a model, parameter, name or state that does not exist.
    """
    if not drive:
        inputs = ["drive.force" if name == "drive.command" else name for name in inputs]
    path = str(find_model(model))
    states = working_mode.working(path, overrides, modes, free).modes
    plain = ["drive.command" if name == CODE else name for name in inputs]
    m = equations.read(path, plain, outputs, overrides or {}, states, free, drive)
    if CODE in inputs:
        factors = np.where([name == CODE for name in inputs], m.volts_per_code, 1.0)
        m = replace(m, B=m.B * factors, D=m.D * factors)
    return System(m.A, m.B, m.C, m.D, tuple(m.states), tuple(inputs), tuple(outputs))


def once(parameter: str, names: Sequence[str]) -> None:
    """Raises ParameterError if a name occurs twice in `names`. `parameter`: the argument of the
    caller that has these names."""
    if len(set(names)) < len(names):
        raise ParameterError(
            parameter, f"expected each name once, got {', '.join(names)}; remove repeated names"
        )


def check_export(path: str | Path | None) -> None:
    """Raises InputError if a file with the name `path` cannot contain matrices, because of its
    suffix. A caller checks this before the computation."""
    if path is not None and Path(path).suffix not in (".npz", ".mat"):
        raise ParameterError("out", f"{path}: expected a file ending in .npz or .mat")


def export(system: System, path: str | Path) -> None:
    """Writes A, B, C, D, dt and the names of inputs, outputs and states to a file .npz or .mat. dt
    is 0 for a continuous system."""
    dt, names = system.dt or 0.0, (system.states, system.inputs, system.outputs)
    if Path(path).suffix == ".mat":
        from scipy import io

        arrays = {"A": system.A, "B": system.B, "C": system.C, "D": system.D, "dt": dt}
        states, inputs, outputs = (np.array(texts, object) for texts in names)
        io.savemat(path, arrays | {"states": states, "inputs": inputs, "outputs": outputs})
    else:
        states, inputs, outputs = map(np.array, names)
        np.savez(
            path, A=system.A, B=system.B, C=system.C, D=system.D, dt=dt, states=states,
            inputs=inputs, outputs=outputs,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class SystemResult:
    """A System for the JSON output. It also has the states of the switching elements of the model,
    or None if the model has no such element. dt in s is None for a continuous system."""

    working: Working | None = json_field(inline=True)
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float | None
    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


def system_result(system: System, mode: Working) -> SystemResult:
    """Returns a System as a SystemResult, together with the states of the elements of its model."""
    return SystemResult(
        working=mode.shown,
        states=system.states,
        inputs=system.inputs,
        outputs=system.outputs,
        dt=system.dt,
        A=system.A,
        B=system.B,
        C=system.C,
        D=system.D,
    )
