"""The transfer functions as the thesis prints them, against the models of the same figures. Where
the print is damaged the formula here is the corrected one, and the print itself has to disagree."""

import numpy as np
import pytest
from forceaxis import linear
from forceaxis.thesis.analysis import parameter
from forceaxis.thesis.analysis import printed as p

S = 2j * np.pi * np.geomspace(0.5, 700, 40)
k_s, m_r, m_b, m_w = p("k_s"), p("m_r"), p("m_b"), p("m_w")
b_r, b_s = p("b_r"), p("b_s")


def sensor(s):
    """(b_s + b_r) s + k_s, the last terms of the rigid robot's denominator."""
    return (b_r + b_s) * s + k_s


def rigid_force(s):
    """2.2.2: F_s / F_a. 2.3.4 and 4.3.1 call it G_lf."""
    return k_s / (m_r * s**2 + sensor(s))


def rigid_velocity(s):
    """2.3.4 and 4.3.1: G_lv."""
    return s / (m_r * s**2 + sensor(s))


def flexible(s):
    """2.4.2."""
    arm = p("b_rf") * s + p("k_rf")
    actuator = p("m_r1") * s**2 + (b_r + p("b_rf")) * s + p("k_rf")
    endpoint = p("m_r2") * s**2 + (p("b_rf") + b_s) * s + p("k_rf") + k_s
    return k_s * arm / (actuator * endpoint - arm**2)


def base_a(s, last=lambda s: (b_r * s) ** 2):
    """2.4.3, first model. The print has b_r^2 for the last term."""
    b_b, k_b = p("b_b"), p("k_b")
    base = m_b * s**2 + (b_b + b_r) * s + k_b
    numerator = k_s * (m_b * s**2 + b_b * s + k_b)
    return numerator / (base * (m_r * s**2 + sensor(s)) - last(s))


def base_b(s):
    """2.4.3, second model. The print names k_s X_r / F_a, but has k_s (X_r - X_b) / F_a."""
    b_b, k_b = p("b_b"), p("k_b")
    base = m_b * s**2 + (b_b + b_r + b_s) * s + k_b + k_s
    numerator = k_s * ((m_b + m_r) * s**2 + b_b * s + k_b)
    return numerator / (base * (m_r * s**2 + sensor(s)) - sensor(s) ** 2)


def workpiece(s):
    """2.5.1."""
    b_w, k_w = p("b_w"), p("k_w")
    part = m_w * s**2 + (b_s + b_w) * s + k_s + k_w
    numerator = k_s * (m_w * s**2 + b_w * s + k_w)
    return numerator / ((m_r * s**2 + sensor(s)) * part - (b_s * s + k_s) ** 2)


def motor(s):
    """4.1.1: G_af and G_av. Of G_av the print lacks the sign, a power of r and the factor a, and
    has a sign of addition for one of multiplication."""
    a, k_t, k_amp, r = (p(n) for n in ("a_preamp_fdbk", "k_torque", "k_amp", "r_trans"))
    loop = p("L") * s + p("R") + k_amp * p("k_current")
    tach = k_amp * p("k_preamp_fdbk") * p("k_tach") * a
    g_av = -k_t * (tach + p("k_back_emf") * (s + a)) / (r**2 * loop * (s + a))
    return k_t * k_amp * p("k_preamp_cmd") / (r * loop), g_av


def motor_as_printed(s):
    """4.1.1: G_av as the print has it."""
    a, k_t, k_amp, r = (p(n) for n in ("a_preamp_fdbk", "k_torque", "k_amp", "r_trans"))
    loop = p("L") * s + p("R") + k_amp * p("k_current")
    numerator = k_t * k_amp * p("k_preamp_fdbk") + p("k_tach") * p("k_back_emf") * (s + a)
    return numerator / (r * loop * (s + a))


def off(found, expected):
    """Largest relative difference over S."""
    return abs(found / expected - 1).max()


@pytest.mark.parametrize(
    ("model", "formula"),
    [
        ("fig2_3", rigid_force),
        ("fig2_11", flexible),
        ("fig2_16a", base_a),
        ("fig2_16b", base_b),
        ("fig2_26", workpiece),
    ],
)
def test_printed_force_response(model, formula):
    assert off(linear.linearise(model, drive=False).at(S), formula(S)) < 1e-9


def test_printed_simple_actuator():
    """2.3.3 and 2.3.4, by the rule of 2.3.2. The command is a velocity there."""
    k_act, a_act = parameter("fig2_8", "k_act"), parameter("fig2_8", "a_act")
    g_af = k_act * a_act / (S + a_act)
    expected = rigid_force(S) * g_af / (1 + g_af * rigid_velocity(S))
    per_volt = parameter("fig2_8", "velocity_per_volt")
    assert off(linear.linearise("fig2_8").at(S), per_volt * expected) < 1e-9


def test_printed_motor():
    """4.1.1 with the loads of 4.3.1 and of 4.1.3."""
    g_af, g_av = motor(S)
    expected = rigid_force(S) * g_af / (1 - g_av * rigid_velocity(S))
    assert off(linear.linearise("fig4_11").at(S), expected) < 1e-9
    rotor = p("J_m") * S + 0.02  # b_m as printed
    tach, velocity = p("k_tach") * p("r_trans") / rotor, p("r_trans") ** 2 / rotor
    expected = tach * g_af / (1 - g_av * velocity)
    unloaded = linear.linearise("fig4_5", outputs=("drive.tach",)).at(S)
    assert off(unloaded, expected) < 2e-4  # J_m / r_trans^2 is rounded in the file


def test_damaged_prints_do_not_agree():
    found = linear.linearise("fig2_16a", drive=False).at(S)
    assert off(base_a(S, last=lambda s: b_r**2 * np.ones_like(s)), found) > 1e-3
    g_af, _ = motor(S)
    expected = rigid_force(S) * g_af / (1 - motor_as_printed(S) * rigid_velocity(S))
    assert off(linear.linearise("fig4_11").at(S), expected) > 0.1
