"""Beams and the two-link arm against classical constants and closed forms."""

import itertools

import numpy as np
import pytest
from forceaxis._core import InputError
from forceaxis.linear import beam

# Classical roots, from the literature (Blevins): tan y = -tanh y and cos y cosh y = -1.
SLIDING_FREE = [2.365020372431352, 5.497803919000836, 8.639379828699741, 11.78097245102023]
CLAMPED_FREE = [1.875104068711961, 4.694091132974175, 7.854757438237612, 10.995540734875467]

BEAM = beam.Beam(bending_stiffness_Nm2=1300.0, mass_per_length_kg_per_m=2.9, length_m=0.8)


def classical(roots, part=BEAM):
    """rad/s of roots y: y^2 sqrt(E I / rho A) / l^2."""
    stiffness = part.bending_stiffness_Nm2 / part.mass_per_length_kg_per_m
    return np.array(roots) ** 2 * np.sqrt(stiffness) / part.length_m**2


def test_roots_are_the_classical_constants():
    assert beam.sliding_free_roots(4) == pytest.approx(SLIDING_FREE, rel=1e-15, abs=0)
    assert beam.clamped_free_roots(4) == pytest.approx(CLAMPED_FREE, rel=1e-15, abs=0)
    # Far up both tend to odd quarters and halves of pi.
    assert beam.sliding_free_roots(400)[-1] == pytest.approx(399.75 * np.pi, rel=1e-15)
    assert beam.clamped_free_roots(400)[-1] == pytest.approx(399.5 * np.pi, rel=1e-15)


def test_poles_and_zeros():
    poles = BEAM.poles(4)
    assert poles[0] == 0
    assert poles[1:].real == pytest.approx(0, abs=0)
    w = np.repeat(classical(SLIDING_FREE), 2)
    assert abs(poles[1:].imag) == pytest.approx(w, rel=1e-12)
    assert np.sum(poles) == 0
    zeros = BEAM.actuator_zeros(4)
    assert zeros.real == pytest.approx(0, abs=0)
    assert abs(zeros.imag) == pytest.approx(np.repeat(classical(CLAMPED_FREE), 2), rel=1e-12)
    tip = BEAM.tip_zeros(4)
    assert tip.imag == pytest.approx(0, abs=0)
    half_waves = np.sqrt(2) * np.array([0.5, 1.5, 2.5, 3.5]) * np.pi
    assert abs(tip.real) == pytest.approx(np.repeat(classical(half_waves), 2), rel=1e-12)
    assert sorted(np.sign(tip.real)) == [-1] * 4 + [1] * 4


@pytest.mark.parametrize("damping_s", [0.0, 1e-4])
def test_transfer_functions_have_those_poles_and_zeros(damping_s):
    part = beam.Beam(1300.0, 2.9, 0.8, damping_s)
    off = 1 + 1e-7
    for poles in part.poles(6)[1:]:
        near, far = part.actuator(poles * np.array([off, 1.05]))
        assert abs(near) > 1e4 * abs(far)
    for zeros, of in ((part.actuator_zeros(6), part.actuator), (part.tip_zeros(6), part.tip)):
        for zero in zeros:
            near, far = of(zero * np.array([off, 1.05]))
            assert abs(near) < 1e-4 * abs(far)


def test_damping_ratio_of_a_mode():
    part = beam.Beam(1300.0, 2.9, 0.8, damping_s=1e-4)
    first = part.poles(1)[1]
    w = classical(SLIDING_FREE)[0]
    assert abs(first) == pytest.approx(w)
    assert -first.real / abs(first) == pytest.approx(1e-4 * w / 2)


def test_form_of_the_thesis():
    """S and C of 2.4.4 with the missing 1 / sqrt(E I rho A), and 6 C^2 for the printed 2 C^2."""
    part = BEAM
    EI, rhoA = part.bending_stiffness_Nm2, part.mass_per_length_kg_per_m
    for s in [3.0, 40 + 2000j, 5j, 700j, 9000j, -20 + 300j, 1e5j]:
        p = s / np.sqrt(EI / rhoA)
        root = np.sqrt(part.length_m**2 / 2 * p + 0j)
        S, C = np.exp(-root) * np.sin(root), np.exp(-root) * np.cos(root)
        E = S * S + C * C
        D = E * E - 4 * C * S - 1
        scale = np.sqrt(2 / (p + 0j)) / np.sqrt(EI * rhoA)
        act = -0.5 * scale * (E * E + 2 * S * S + 6 * C * C + 1) / D
        tip = -2 * scale * C * (E + 1) / D
        assert part.actuator(s) == pytest.approx(act, rel=1e-10)
        assert part.tip(s) == pytest.approx(tip, rel=1e-10)


def test_against_modal_sum():
    """The series of free modes, whose shapes are known: an independent way to the same response."""
    y = np.array(SLIDING_FREE + [(k - 0.25) * np.pi for k in range(5, 4000)])
    # Sliding-free shapes at both ends, of unit modal mass: phi(0) and phi(l).
    # phi = cos(b x) / cos(y) + cosh(b x) / cosh(y), whose mean square over the length is 1.
    start, end = 1 / np.cos(y) + 1 / np.cosh(np.minimum(y, 700)), 2.0
    w = classical(y)
    for hz in (0.3, 20.0, 100.0, 333.0, 1500.0):
        s = 2j * np.pi * hz
        act = s / BEAM.mass_kg * (1 / s**2 + np.sum(start**2 / (s * s + w * w)))
        tip = s / BEAM.mass_kg * (1 / s**2 + np.sum(start * end / (s * s + w * w)))
        assert BEAM.actuator(s) == pytest.approx(act, rel=1e-6)
        assert BEAM.tip(s) == pytest.approx(tip, rel=1e-6)


def test_low_frequency_is_the_rigid_mass_and_high_frequency_stays_finite():
    for s in (1e-6j, 1e-3, 1e-3j):
        assert BEAM.actuator(s) == pytest.approx(1 / (BEAM.mass_kg * s), rel=1e-6)
        assert BEAM.tip(s) == pytest.approx(1 / (BEAM.mass_kg * s), rel=1e-6)
    s = 2j * np.pi * np.geomspace(1e3, 1e15, 40)
    assert np.isfinite(BEAM.actuator(s)).all()
    assert np.isfinite(BEAM.tip(s)).all()
    # Off the imaginary axis no wave comes back from the tip: V / F of a half-infinite beam.
    s = 1e8 * np.exp(0.7j)
    EI, rhoA = BEAM.bending_stiffness_Nm2, BEAM.mass_per_length_kg_per_m
    b = np.sqrt(s * np.sqrt(rhoA / EI) / 2)
    assert BEAM.actuator(s) == pytest.approx(s / (4 * EI * b**3), rel=1e-12)


def test_polynomial_approximation():
    table = {row.modes: row for row in BEAM.approximation_errors()}
    assert sorted(table) == list(range(4, 41))
    assert table[12].actuator < 0.01
    assert table[24].tip < 0.01
    assert table[4].actuator > 0.01
    assert table[12].tip > 0.01
    # Each further mode helps; the rest of the products falls as n^-4 and n^-3.
    for output, power in (("actuator", 4), ("tip", 3)):
        errors = [getattr(row, output) for row in table.values()]
        assert all(b < a for a, b in itertools.pairwise(errors))
        assert errors[16] / errors[-1] == pytest.approx(2**power, rel=0.15)  # n = 20 and 40
    # The error does not depend on the beam.
    other = beam.Beam(7.0, 0.1, 3.0)
    assert other.approximation_error(12) == pytest.approx(table[12].actuator, rel=1e-4)


def test_polynomial_as_a_transfer_function():
    short = BEAM.polynomial(6, "tip")
    G = short.transfer_function()
    for s in (3j, 500j, 40 + 100j):
        assert G(s) == pytest.approx(complex(short.at(s)), rel=1e-6)
    zeros, poles, gain = short.zpk()
    s = 12 + 700j
    assert gain * np.prod(s - zeros) / np.prod(s - poles) == pytest.approx(complex(short.at(s)))
    with pytest.raises(InputError, match="fewer modes"):
        BEAM.polynomial(60).transfer_function()
    with pytest.raises(InputError, match="actuator"):
        BEAM.polynomial(4, "middle")


def test_lumped_beam_of_the_figure():
    """Fig 2.25: alternating at the actuator, one real pair at the tip iff e (l/2) m2 > J2."""
    EI, length, m1, m2, J2 = 4000.0, 0.6, 3.0, 2.0, 0.02
    for e in (0.2, 0.0):
        model = beam.LumpedBeam.figure_2_24(EI, length, m1, m2, J2, e)
        assert model.nonminimum_phase() == (e == 0.2)
        system = model.system()
        poles = np.sort(abs(system.poles().imag))[2::2]
        zeros = system.select(["force"], ["actuator"]).zeros()
        zeros = np.sort(zeros.imag[zeros.imag > 1])
        assert poles[0] < poles[1]
        # Clamped at the sliding mass: the classical cantilever with a mass and an inertia.
        k = EI / length**3 * np.array([[12, -6 * length], [-6 * length, 4 * length**2]])
        cantilever = np.linalg.eigvals(np.diag([1 / m2, 1 / J2]) @ k)
        assert zeros == pytest.approx(np.sort(np.sqrt(cantilever.real)), rel=1e-9)
        assert zeros[0] < poles[0] < zeros[1] < poles[1]
        tip = system.select(["force"], ["tip"]).zeros()
        square = EI / (length * (e * length / 2 * m2 - J2))
        pair = tip[abs(tip) > 1]
        assert pair**2 == pytest.approx([square, square], rel=1e-9)
        assert (abs(pair.imag).max() < 1e-6 * abs(pair).max()) == (e == 0.2)


def test_lumped_beam_tends_to_the_distributed_one():
    expected = classical(SLIDING_FREE)
    errors = []
    for elements in (1, 4, 16, 64):
        poles = BEAM.lumped(elements).system().poles()
        w = np.sort(abs(poles.imag))[2::2]
        errors.append(abs(w[0] / expected[0] - 1))
        masses = BEAM.lumped(elements).masses_kg
        assert sum(masses) == pytest.approx(BEAM.mass_kg)
    assert errors[0] < 0.2
    assert errors[1] < 0.01
    assert errors[3] < errors[2] / 10 < errors[1] / 100
    assert w[:4] == pytest.approx(expected, rel=2e-3)
    one = BEAM.lumped(1)
    assert one.nonminimum_phase()


def test_two_link_arm_zeros():
    """A zero comes to the right when link 2's centre of percussion lies before the endpoint."""
    l2, c2, m2 = 0.5, 0.2, 5.0
    border = m2 * c2 * (l2 - c2)
    for factor in (0.5, 0.9, 1.1, 2.0):
        for angle in (0.0, 0.8, -1.2):
            arm = beam.TwoLinkArm(c2=c2, I2=factor * border, angle2_rad=angle)
            zeros = arm.system().select(["torque1"], ["normal"]).zeros()
            finite = zeros[abs(zeros) > 1]
            positive = (finite.real > 1) & (abs(finite.imag) < 1e-6 * abs(finite))
            assert positive.any() == (factor < 1) == arm.nonminimum_phase()
            M = arm.mass_matrix()
            a = arm.l1 * np.cos(angle) * (arm.I2 - border)
            square = -arm.k2 * (arm.l2 + arm.l1 * np.cos(angle)) / a
            assert finite**2 == pytest.approx([square, square], rel=1e-8)
            # The driven joint's own angle is colocated: imaginary zeros whatever the masses.
            own = arm.system().select(["torque1"], ["joint1"]).zeros()
            assert own**2 == pytest.approx([-arm.k2 / M[1, 1]] * 2, rel=1e-8)


def test_two_link_arm_matrices():
    """Mass matrix and Jacobian against velocities of many point masses by differences."""
    lengths = {"l1": 0.7, "l2": 0.4, "c1": 0.35, "c2": 0.2}
    mass = {"m1": 4.0, "m2": 3.0, "I1": 4 * 0.7**2 / 12, "I2": 3 * 0.4**2 / 12}
    arm = beam.TwoLinkArm(**lengths, **mass, angle1_rad=0.3, angle2_rad=1.1)

    def points(q, n=400):
        u = (np.arange(n) + 0.5) / n
        one = 0.7 * np.exp(1j * q[0])
        two = 0.4 * np.exp(1j * (q[0] + q[1]))
        return np.concatenate([u * one, one + u * two, [one + two]])

    q, h = np.array([0.3, 1.1]), 1e-6
    rates = np.array([(points(q + h * e) - points(q - h * e)) / (2 * h) for e in np.eye(2)])
    weight = np.concatenate([np.full(400, 4 / 400), np.full(400, 3 / 400), [0]])
    M = np.real((rates * weight) @ rates.conj().T)
    assert arm.mass_matrix() == pytest.approx(M, rel=1e-5)
    end = rates[:, -1]
    assert arm.jacobian()[:2] == pytest.approx(np.array([end.real, end.imag]), rel=1e-6)
    across = end * np.exp(-1j * (0.3 + 1.1))
    assert arm.jacobian()[2] == pytest.approx(across.imag, rel=1e-6)


def test_refusals():
    with pytest.raises(InputError, match="length_m"):
        beam.Beam(1.0, 1.0, 0.0)
    with pytest.raises(InputError, match="at least 1 mode"):
        BEAM.polynomial(0)
    with pytest.raises(InputError, match="k2"):
        beam.TwoLinkArm(k2=-1.0)
    with pytest.raises(InputError, match="masses"):
        beam.LumpedBeam(1.0, (1.0,), (1.0,), (1.0,))
