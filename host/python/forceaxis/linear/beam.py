"""Beams in bending (thesis section 2.4.4) and the two-link arm (thesis section 6.2.3). The transfer
functions of both have real zeros.

These models are linear and have no time simulation. Displacement and force are positive in the same
direction. A transfer function is the velocity per actuator force, in m/s per N.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from forceaxis._core import InputError
from forceaxis.linear.equations import Matrix
from forceaxis.linear.system import System

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class Factored:
    """A rational function in factored form: gain s^order prod(1 - s / zero) / prod(1 - s / pole).

    Zeros and poles are complex arrays in 1/s without roots at s = 0. `order` is the number of zeros
    at s = 0, and is negative for poles there. So `gain` is the low-frequency gain, and no
    coefficient can overflow.
    """

    zeros: Matrix
    poles: Matrix
    gain: float
    order: int = 0

    def at(self, s: ArrayLike) -> Matrix:
        """Returns the values of the rational function at complex s in 1/s. The array s may have any
        shape."""
        s = np.asarray(s, dtype=complex)
        value = self.gain * s**self.order
        for zero, pole in zip_longest(self.zeros, self.poles):
            # Zeros and poles are taken in turn, so that no intermediate product overflows.
            if zero is not None:
                value = value * (1 - s / zero)
            if pole is not None:
                value = value / (1 - s / pole)
        return value

    def response(self, frequency_hz: ArrayLike) -> Matrix:
        """Returns the complex values of the rational function at s = 2 pi j frequency_hz, in the
        shape of frequency_hz."""
        return self.at(2j * np.pi * np.asarray(frequency_hz))

    def zpk(self) -> tuple[Matrix, Matrix, float]:
        """Returns zeros, poles and gain of the rational function in the form gain prod(s - zero) /
        prod(s - pole). Zeros and poles are in 1/s and include roots at s = 0."""
        zeros = np.concatenate([self.zeros, np.zeros(max(self.order, 0))])
        poles = np.concatenate([self.poles, np.zeros(max(-self.order, 0))])
        gain = self.gain
        for zero, pole in zip_longest(self.zeros, self.poles, fillvalue=-1.0):
            gain = gain * (-pole) / (-zero)
        return zeros, poles, float(np.real(gain))

    def transfer_function(self) -> "control.TransferFunction":
        """Returns the rational function as a control.TransferFunction in powers of s (1/s). Raises
        InputError if a coefficient exceeds the range of double precision."""
        import control

        zeros, poles, gain = self.zpk()
        with np.errstate(over="ignore", invalid="ignore"):
            num, den = gain * np.real(np.poly(zeros)), np.real(np.poly(poles))
        if not (np.isfinite(num).all() and np.isfinite(den).all()):
            raise InputError(
                "transfer function: expected polynomial coefficients below 1e308, but the "
                f"{len(poles)} poles up to {np.abs(poles).max():.3g} 1/s give larger ones; use "
                "fewer modes, or use the zeros and poles that zpk() returns"
            )
        return control.TransferFunction(num, den)


def _newton(x: Matrix, step: Callable[[Matrix], Matrix]) -> Matrix:
    """Returns roots of a function f by Newton's iteration. `step(x)`: function that returns f / f'.
    The iteration ends when the steps are as small as rounding errors."""
    for _ in range(40):
        change = step(x)
        x = x - change
        if np.all(np.abs(change) <= 4 * np.finfo(float).eps * x):
            return x
    # Newton's iteration converges here, because every start value is close to a root.
    # If the iteration does not converge, the program has a defect.
    raise ArithmeticError("a root of the beam did not converge")


def sliding_free_roots(count: int) -> Matrix:
    """Returns the first `count` positive roots of tan y + tanh y = 0: 2.36502, 5.49780, ... The
    roots have no unit, and the array has the shape (count,)."""
    y = (np.arange(1, count + 1) - 0.25) * np.pi

    def step(y: Matrix) -> Matrix:
        sin, cos, tanh = np.sin(y), np.cos(y), np.tanh(y)
        result: Matrix = (sin + tanh * cos) / (cos - tanh * sin + (1 - tanh**2) * cos)
        return result

    return _newton(y, step)


def clamped_free_roots(count: int) -> Matrix:
    """Returns the first `count` positive roots of cos y cosh y = -1: 1.87510, 4.69409, ... The
    roots have no unit, and the array has the shape (count,)."""
    y = (np.arange(1, count + 1) - 0.5) * np.pi

    def step(y: Matrix) -> Matrix:
        e = np.exp(-y)
        sech, tanh = 2 * e / (1 + e * e), np.tanh(y)
        result: Matrix = (np.cos(y) + sech) / (-np.sin(y) - sech * tanh)
        return result

    return _newton(y, step)


@dataclass(frozen=True)
class Beam:
    """Distributed-parameter beam of Figure 2.21 of the thesis. One end slides without turning, and
    the other end is free.

    The actuator pushes the sliding end. `damping_s` changes the elastic modulus E to E (1 +
    damping_s s). So a bending mode with the natural frequency w_k has the damping ratio
    damping_s w_k / 2. Raises InputError if the bending stiffness in N m^2, the mass per length in
    kg/m or the length in m is outside of 1e-12 to 1e12, or if damping_s is below 0.
    """

    bending_stiffness_Nm2: float  # bending stiffness E I
    mass_per_length_kg_per_m: float  # mass per length rho A
    length_m: float
    damping_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("bending_stiffness_Nm2", "mass_per_length_kg_per_m", "length_m"):
            value = getattr(self, name)
            if not 1e-12 <= value <= 1e12:
                raise InputError(f"Beam: {name}: expected a number from 1e-12 to 1e12, got {value}")
        if not (np.isfinite(self.damping_s) and self.damping_s >= 0):
            raise InputError(f"Beam: damping_s: expected a number >= 0, got {self.damping_s}")

    @property
    def mass_kg(self) -> float:
        """Mass of the whole beam in kg."""
        return self.mass_per_length_kg_per_m * self.length_m

    @property
    def rate(self) -> float:
        """The factor sqrt(E I / (rho A)) / l^2 of the beam in rad/s. For a root y of the beam
        equation, the natural frequency of the beam is y^2 times this factor."""
        a = np.sqrt(self.bending_stiffness_Nm2 / self.mass_per_length_kg_per_m)
        return float(a / self.length_m**2)

    def natural_frequencies(self, count: int) -> Matrix:
        """Returns the frequencies of the first `count` bending modes in rad/s, ascending, in the
        shape (count,). The rigid-body mode at frequency 0 is not included."""
        return self.rate * sliding_free_roots(count) ** 2

    def poles(self, count: int) -> Matrix:
        """Returns the poles of the transfer function from force to velocity in 1/s, in the shape (1
        + 2 count,). The first pole is 0 and belongs to the rigid body. A pair of poles for each of
        the first `count` bending modes follows, in ascending order."""
        return np.concatenate([[0.0], self._roots(-(self.natural_frequencies(count) ** 2))])

    def actuator_zeros(self, count: int) -> Matrix:
        """Returns `count` pairs of zeros of V_act / F_a (actuator velocity per force) in 1/s, in
        the shape (2 count,). At the frequency of a zero the sliding end does not move."""
        return self._roots(-((self.rate * clamped_free_roots(count) ** 2) ** 2))

    def tip_zeros(self, count: int) -> Matrix:
        """Returns `count` real pairs of zeros of V_tip / F_a (tip velocity per force) in 1/s, in
        the shape (2 count,). Without damping the zeros are +-2 rate ((k - 1/2) pi)^2."""
        k = np.arange(1, count + 1)
        return self._roots((2 * self.rate * ((k - 0.5) * np.pi) ** 2) ** 2)

    def _roots(self, squares: Matrix) -> Matrix:
        """Returns, as a complex array, both roots s of the equation s^2 = q (1 + damping_s s) for
        each element q of `squares`."""
        half = squares * self.damping_s / 2
        root = np.sqrt((half**2 + squares).astype(complex))
        # The root with the larger magnitude comes first, because its formula has no cancellation.
        far = half + np.where(half < 0, -1, 1) * root
        return np.column_stack([-squares / far, far]).ravel()

    def actuator(self, s: ArrayLike) -> Matrix:
        """Returns V_act / F_a (actuator velocity per force) in m/s per N at complex s (1/s), in the
        shape of s. The function has a pole at s = 0. No frequency causes an overflow."""
        return self._transfer(s)[0]

    def tip(self, s: ArrayLike) -> Matrix:
        """Returns V_tip / F_a (tip velocity per force) in m/s per N at complex s (1/s), in the
        shape of s. The function has a pole at s = 0."""
        return self._transfer(s)[1]

    def _transfer(self, s: ArrayLike) -> tuple[Matrix, Matrix]:
        # Transfer functions of thesis section 2.4.4, corrected, with X = b l and 4 b^4 = p^2.
        # In the transfer functions of the beam, p^2 = rho A s^2 / (E I).
        # The denominator of both is D = 4 E I b^3 (sinh X cosh X + sin X cos X).
        # Response of the actuator: V_act / F_a = s (cosh^2 X + cos^2 X) / D.
        # Response of the tip: V_tip / F_a = 2 s cosh X cos X / D.
        # Both transfer functions of the beam are even in p. So p may be in the right half-plane.
        # With p in the right half-plane, |arg X| <= pi/4, and exp(-2X) times each term is bounded.
        s = np.asarray(s, dtype=complex)
        stiffness = self.bending_stiffness_Nm2 * (1 + self.damping_s * s)
        p = s * np.sqrt(self.mass_per_length_kg_per_m / stiffness)
        p = np.where(p.real < 0, -p, p)
        b = np.sqrt(p / 2)
        z = 2 * b * self.length_m
        e = np.exp(-z)
        cos_part = np.exp((1j - 1) * z), np.exp(-(1j + 1) * z)  # e^-z (cos z +- j sin z)
        act = (4 * e + 1 + e * e + cos_part[0] + cos_part[1]) / 4
        # identity for the response of the tip: 2 cosh X cos X = cosh(X + jX) + cosh(X - jX)
        half = z / 2
        tip = sum(np.exp(k * half - z) for k in (1 + 1j, -1 - 1j, 1 - 1j, -1 + 1j)) / 2
        # np.where computes both formulas: the one for small |z| and the one for large |z|.
        # The formula that np.where does not select may overflow.
        with np.errstate(over="ignore", invalid="ignore"):
            # This formula for small |z| is exact to all digits near z = 0.
            small = e * (np.sinh(z) + np.sin(z)) / 2
        large = (1 - e * e + (cos_part[0] - cos_part[1]) / 1j) / 4
        bending = np.where(np.abs(z) < 1, small, large)
        factor = s / (4 * stiffness * b**3 * bending)
        return factor * act, factor * tip

    def polynomial(self, modes: int, output: str = "actuator") -> Factored:
        """Returns a rational approximation of V_act / F_a or V_tip / F_a as an object of the class
        Factored.

        It has the exact poles and zeros of the first `modes` bending modes, the same number of
        each. It also has the exact low-frequency gain 1 / (rho A l s).
        """
        zeros = {"actuator": self.actuator_zeros, "tip": self.tip_zeros}
        if output not in zeros:
            raise InputError(f'beam output: expected "actuator" or "tip", got "{output}"')
        if modes < 1:
            raise InputError(f"beam: expected at least 1 mode, got {modes}")
        return Factored(zeros[output](modes), self.poles(modes)[1:], 1 / self.mass_kg, -1)

    def approximation_error(self, modes: int, output: str = "actuator", through: int = 4) -> float:
        """Returns the largest error |approximation / true - 1| of the complex frequency response of
        the beam, from frequency 0 to the frequency of the bending mode number `through`.

        The error is evaluated at 4000 frequencies from a thousandth of the first pole to the pole
        of mode `through`. It is also evaluated at a relative distance of 1e-6 from each pole and
        zero in this range. No frequency is excluded: the approximation has the same poles and
        zeros, so the ratio has no peak there. The error increases up to the last frequency.
        """
        if modes < through:
            raise InputError(f"beam: expected at least {through} modes, got {modes}")
        marks = self.natural_frequencies(through)
        if output == "actuator":
            marks = np.concatenate([marks, self.rate * clamped_free_roots(through) ** 2])
        w = np.geomspace(1e-3 * marks[0], marks[:through].max(), 4000)[:-1]
        s = 1j * np.concatenate([w, marks * (1 - 1e-6), marks * (1 + 1e-6)])
        true = self.actuator(s) if output == "actuator" else self.tip(s)
        return float(np.abs(self.polynomial(modes, output).at(s) / true - 1).max())

    def approximation_errors(
        self, modes: Iterable[int] = range(4, 41), through: int = 4
    ) -> list["ApproximationError"]:
        """Returns the errors of the approximations of V_act and V_tip, for each number of bending
        modes in `modes`. See `approximation_error`."""
        outputs = ("actuator", "tip")
        return [
            ApproximationError(n, *(self.approximation_error(n, o, through) for o in outputs))
            for n in modes
        ]

    def lumped(self, elements: int) -> "LumpedBeam":
        """Returns a lumped-parameter beam with `elements` bending elements and the total mass of
        this beam.

        The beam is divided into 2 `elements` equal parts. The sliding body gets one part, each
        inner body two, and the last body one. Each body is at the common centre of mass of its
        parts. With more elements, the modes approach those of the beam.
        """
        if elements < 1:
            raise InputError(f"beam: expected at least 1 element, got {elements}")
        part = self.length_m / (2 * elements)
        m = self.mass_per_length_kg_per_m * part
        masses = np.full(elements + 1, 2 * m)
        masses[[0, -1]] = m
        inertias = 2 * m * (2 * part) ** 2 / 12 * np.ones(elements)
        inertias[-1] = m * part**2 / 12
        lengths = np.full(elements, 2 * part)
        # The distance from the centre of the last body to the tip is half the length of an element.
        lengths[-1] -= part / 2
        return LumpedBeam(
            self.bending_stiffness_Nm2, tuple(lengths), tuple(masses), tuple(inertias), part / 2
        )


@dataclass(frozen=True)
class LumpedBeam:
    """Lumped-parameter beam in bending. Figure 2.24 of the thesis shows the model with one element.

    The model has one mass that slides without turning, and masses that move and turn. A massless
    bending element joins each mass to the previous one. The tip is `tip_offset_m` beyond the centre
    of the last mass.
    """

    bending_stiffness_Nm2: float  # bending stiffness E I of the elements
    # length in m of each element, from the centre of its first mass to that of its second mass
    lengths_m: tuple[float, ...]
    # mass of the sliding body in kg, followed by one mass in kg for each element
    masses_kg: tuple[float, ...]
    # moments of inertia in kg m^2 of all masses except the sliding mass
    inertias_kgm2: tuple[float, ...]
    tip_offset_m: float = 0.0

    def __post_init__(self) -> None:
        n = len(self.lengths_m)
        if n < 1 or len(self.masses_kg) != n + 1 or len(self.inertias_kgm2) != n:
            raise InputError(
                "LumpedBeam: expected n lengths, n inertias and n + 1 masses for n elements, got "
                f"{n} lengths, {len(self.masses_kg)} masses, {len(self.inertias_kgm2)} inertias"
            )
        values = (self.bending_stiffness_Nm2, *self.lengths_m, *self.masses_kg, *self.inertias_kgm2)
        if not (np.isfinite(values).all() and min(values) > 0):
            raise InputError(
                "LumpedBeam: expected numbers above 0 for stiffness, lengths, masses and inertias"
            )

    @classmethod
    def figure_2_24(
        cls,
        bending_stiffness_Nm2: float,
        length_m: float,
        m1_kg: float,
        m2_kg: float,
        J2_kgm2: float,
        tip_offset_m: float,
    ) -> "LumpedBeam":
        """Returns the beam of Figure 2.24 with two masses and one element. The arguments are the
        bending stiffness E I in N m^2, the length of the element in m, the masses in kg, the
        inertia of the second mass in kg m^2, and the offset of the tip in m. Raises InputError for
        a value that is not above 0."""
        return cls(bending_stiffness_Nm2, (length_m,), (m1_kg, m2_kg), (J2_kgm2,), tip_offset_m)

    def matrices(self) -> tuple[Matrix, Matrix]:
        """Returns mass matrix M and stiffness matrix K of the beam, each (2 n + 1, 2 n + 1) for n
        elements. The coordinates are (x_1; x_2, angle_2; x_3, angle_3; ...) in m and rad."""
        n = len(self.lengths_m)
        diagonal = np.zeros(2 * n + 1)
        diagonal[[0, *range(1, 2 * n, 2)]] = self.masses_kg
        diagonal[2::2] = self.inertias_kgm2
        # The matrix also has a coordinate for the angle of the sliding mass.
        # The angle of the sliding mass is removed at the end, because this mass cannot turn.
        whole = np.zeros((2 * n + 2, 2 * n + 2))
        # Stiffness matrix of a massless beam element.
        # The beam element has four coordinates: displacement, and angle times length, at both ends.
        bending = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
        for i, length in enumerate(self.lengths_m):
            scale = np.array([1, length, 1, length])
            span = slice(2 * i, 2 * i + 4)
            whole[span, span] += (
                self.bending_stiffness_Nm2 / length**3 * np.outer(scale, scale) * bending
            )
        keep = np.delete(np.arange(2 * n + 2), 1)
        return np.diag(diagonal), whole[np.ix_(keep, keep)]

    def system(self) -> System:
        """Returns the beam without damping as a System. The input is the force on the sliding mass
        in N, and the outputs are the velocities of the sliding mass and of the tip in m/s."""
        M, K = self.matrices()
        tip = np.zeros(len(M))
        tip[-2:] = 1.0, self.tip_offset_m
        names = ["x1"] + [
            f"{q}{i}" for i in range(2, len(self.masses_kg) + 1) for q in ("x", "angle")
        ]
        first = np.eye(len(M))[0]
        structure = _Structure(tuple(names), M, 0 * K, K, ("force",), first[:, None])
        return structure.system(("actuator", "tip"), np.array([first, tip]), velocity=True)

    def nonminimum_phase(self) -> bool:
        """Returns True if the tip of the beam of Figure 2.24 (one element) has a real +- pair of
        zeros. The condition is e (l/2) m2 > J2, where e is the offset of the tip.

        The zeros follow from s^2 = E I / (l (e (l/2) m2 - J2)). If both sides of the condition are
        equal, there are no zeros.
        """
        if len(self.lengths_m) != 1:
            raise InputError(
                "LumpedBeam.nonminimum_phase: expected a beam with one element, got more; use the "
                "zeros of `system` for this beam"
            )
        return self.tip_offset_m * self.lengths_m[0] / 2 * self.masses_kg[1] > self.inertias_kgm2[0]


@dataclass(frozen=True)
class TwoLinkArm:
    """Rigid two-link arm of Figure 6.3 of the thesis in a horizontal plane, linearised at rest.

    Motor 1 turns link 1 against ground, and motor 2 turns link 2 against link 1. A joint without a
    drive torque is held by its servo with the stiffness k (N m/rad) and the damping d (N m s/rad).
    l: lengths of the links in m. c: distances of the centres of mass from the joints in m. m:
    masses in kg. I: inertias about the centres of mass in kg m^2. The defaults are two uniform
    links, not values of the thesis.
    """

    l1: float = 0.5
    l2: float = 0.5
    c1: float = 0.25
    c2: float = 0.25
    m1: float = 10.0
    m2: float = 5.0
    I1: float = 10.0 * 0.5**2 / 12
    I2: float = 5.0 * 0.5**2 / 12
    k1: float = 0.0
    k2: float = 2000.0
    d1: float = 0.0
    d2: float = 0.0
    angle1_rad: float = 0.0
    angle2_rad: float = 0.0  # angle of link 2 relative to link 1; 0 for the stretched arm

    def __post_init__(self) -> None:
        for name in ("l1", "l2", "m1", "m2", "I1", "I2"):
            if not getattr(self, name) > 0:
                raise InputError(
                    f"TwoLinkArm: {name}: expected a number above 0, got {getattr(self, name)}"
                )
        for name in ("k1", "k2", "d1", "d2"):
            if not getattr(self, name) >= 0:
                raise InputError(
                    f"TwoLinkArm: {name}: expected a number of at least 0, got "
                    f"{getattr(self, name)}"
                )

    def mass_matrix(self) -> Matrix:
        """Returns the mass matrix of the arm, 2 x 2, in kg m^2. The coordinates are the angle of
        link 1, and the angle of link 2 relative to link 1."""
        M22 = self.I2 + self.m2 * self.c2**2
        cross = self.m2 * self.l1 * self.c2 * np.cos(self.angle2_rad)
        M11 = self.I1 + self.m1 * self.c1**2 + self.m2 * self.l1**2 + M22 + 2 * cross
        return np.array([[M11, M22 + cross], [M22 + cross, M22]])

    def jacobian(self) -> Matrix:
        """Returns the motion of the endpoint of the arm per joint angle in m/rad, with the rows x,
        y and normal. `normal` is the direction at right angles to link 2."""
        end = self.angle1_rad + self.angle2_rad
        s1, c1, s2, c2 = np.sin(self.angle1_rad), np.cos(self.angle1_rad), np.sin(end), np.cos(end)
        x = [-self.l1 * s1 - self.l2 * s2, -self.l2 * s2]
        y = [self.l1 * c1 + self.l2 * c2, self.l2 * c2]
        normal = [self.l1 * np.cos(self.angle2_rad) + self.l2, self.l2]
        return np.array([x, y, normal])

    def system(self) -> System:
        """Returns the arm as a System. The inputs are the torques 1 and 2 in N m, and the outputs
        are both joint angles in rad and the coordinates x, y and normal of the endpoint in m."""
        names, torques = ("joint1", "joint2"), ("torque1", "torque2")
        K, D = np.diag([self.k1, self.k2]), np.diag([self.d1, self.d2])
        structure = _Structure(names, self.mass_matrix(), D, K, torques, np.eye(2))
        rows = np.vstack([np.eye(2), self.jacobian()])
        return structure.system((*names, "x", "y", "normal"), rows, velocity=False)

    def nonminimum_phase(self) -> bool:
        """Returns True if the response from torque 1 to the normal motion of the endpoint has a
        real zero > 0. A spring with the stiffness k2 > 0 acts on joint 2.

        The zeros are those of (l2 + l1 cos) (M22 s^2 + d2 s + k2) - l2 M21 s^2. The factor of s^2
        is l1 cos(angle 2) (I2 - m2 c2 (l2 - c2)). For an angle below 90 degrees, one zero is
        positive if and only if I2 < m2 c2 (l2 - c2). This means that the centre of percussion of
        link 2 lies before the endpoint.
        """
        j1, j2 = self.jacobian()[2]
        M = self.mass_matrix()
        return bool(self.k2 > 0 and j1 * (j1 * M[1, 1] - j2 * M[1, 0]) < 0)


@dataclass(frozen=True)
class _Structure:
    """A mechanical structure with the equation M q'' + D q' + K q = forces u.

    coordinates: names of q. M, D, K: matrices (n, n) in SI units. inputs: names of u. forces:
    matrix (n, inputs) with the force of each input on each coordinate.
    """

    coordinates: tuple[str, ...]
    M: Matrix
    D: Matrix
    K: Matrix
    inputs: tuple[str, ...]
    forces: Matrix

    def system(self, outputs: tuple[str, ...], rows: Matrix, velocity: bool) -> System:
        """Returns the structure as a System with the outputs y = rows q, or y = rows q' if
        `velocity` is True. `rows`: matrix with one row for each output. `outputs`: names of the
        outputs."""
        n = len(self.M)
        inverse = np.linalg.inv(self.M)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ self.K, -inverse @ self.D]])
        B = np.vstack([np.zeros((n, len(self.inputs))), inverse @ self.forces])
        C = np.hstack([0 * rows, rows] if velocity else [rows, 0 * rows])
        states = tuple(
            f"{name}.{quantity}"
            for quantity in ("position", "velocity")
            for name in self.coordinates
        )
        return System(A, B, C, np.zeros((len(C), len(self.inputs))), states, self.inputs, outputs)


@dataclass(frozen=True)
class ApproximationError:
    """Error of the rational approximation of a beam with the first `modes` bending modes: the
    largest |approximation / true - 1| of the actuator's response and of the tip's response."""

    modes: int
    actuator: float
    tip: float


@dataclass(frozen=True)
class BeamMode:
    """A bending mode of a beam. It has the root b l of the beam equation, the pole and the
    actuator's zero in rad/s (each an imaginary pair), and the tip's zero in 1/s (a real pair)."""

    b_l: float
    pole_rad_per_s: float
    actuator_zero_rad_per_s: float
    tip_zero_per_s: float


@dataclass(frozen=True)
class BeamAnalysis:
    """The first bending modes of a beam, and the errors of the rational approximations of the
    beam."""

    modes: list[BeamMode]
    approximation_errors: list[ApproximationError]


def analyse(beam: Beam, modes: int) -> BeamAnalysis:
    """Returns the first `modes` bending modes of a beam, and the errors of the approximations of
    thesis section 2.4.4 with 4 to 40 bending modes."""
    roots = sliding_free_roots(modes)
    poles = beam.natural_frequencies(modes)
    zeros, tip = beam.actuator_zeros(modes)[1::2], beam.tip_zeros(modes)[1::2]
    return BeamAnalysis(
        [
            BeamMode(float(root), float(pole), float(abs(zero)), float(abs(real)))
            for root, pole, zero, real in zip(roots, poles, zeros, tip, strict=True)
        ],
        beam.approximation_errors(),
    )
