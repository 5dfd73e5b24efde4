"""Numbers and statements of Chapter 6 of the thesis: conclusions."""

import math
from dataclasses import replace

import numpy as np

from forceaxis import linear
from forceaxis.linear import loops
from forceaxis.linear.beam import TwoLinkArm
from forceaxis.thesis.analysis import (
    STABLE,
    added_phase_deg,
    critical_gain,
    crossing_hz,
    excess,
    label,
    parameter,
    passed_180,
    pole,
    stability,
)
from forceaxis.thesis.chapter_2 import ARM_DAMPING, LIGHT_BASE
from forceaxis.thesis.claim import Claim, compared, stated

# Two-link arm. The mass of link 2 is at its end, beyond its centre of percussion.
MASS_AT_THE_END = TwoLinkArm(c2=TwoLinkArm.l2)


def arm_lag_deg(times: float = 1.0) -> float:
    """Returns the largest lag in degrees that the flexible arm adds to the force response with the
    motor. The damping of the arm is multiplied by `times`."""
    b_rf = times * parameter("fig4_15", "b_rf")
    return float(-added_phase_deg("fig4_15", "fig4_11", b_rf=b_rf).min())


def colocated_lag_deg() -> float:
    """Returns the largest lag in degrees that the base adds to the force response with the motor.
    The base has no damping."""
    return float(-added_phase_deg("fig4_17", "fig4_11", span_hz=(5.0, 60.0), b_b=0.0).min())


def stiff_arm(above: float) -> str:
    """Returns a text that states whether a stiff arm changes the frequency at which the loop
    becomes unstable by less than 10 %, compared with a rigid robot. The frequency of the arm's mode
    is `above` times this frequency."""
    k_rf = parameter("fig4_15", "k_rf")
    times = (above * crossing_hz("fig4_11") / pole("fig4_15", 35, drive=False)[0]) ** 2
    ratio = crossing_hz("fig4_15", k_rf=times * k_rf) / crossing_hz("fig4_11")
    return stated(abs(ratio - 1) < 0.1, "enough", f"crossover {ratio:.2g} times")


def labels() -> str:
    """Returns a text that names the modes of base, workpiece and arm, with the motor and in
    contact, as colocated or noncolocated."""
    names = {"base": "fig4_17", "workpiece": "fig4_19", "arm": "fig4_15"}
    return ", ".join(f"{name} {label(model, 2)}" for name, model in names.items())


def added_zeros() -> int:
    """Returns the number of zeros that a force sensor adds to the force loop if its signal also has
    the time derivative of the force."""
    spec = loops.LoopSpec("derivative", "continuous", parameters={"derivative_s": 0.005})
    plain = loops.force_loop("fig4_11", timing="continuous")
    return len(spec.around("fig4_11").open.zeros()) - len(plain.open.zeros())


def bandwidth_ratio(law: str, **parameters: float) -> str:
    """Returns a text that compares the control law `law` with a gain alone. It states whether the
    loop of rigid robot and motor becomes unstable at a higher frequency with this law."""
    spec = loops.LoopSpec(law, "continuous", parameters=parameters)
    hz = spec.around("fig4_11").limit().frequency_hz
    return "higher: no limit" if hz is None else compared(hz / crossing_hz("fig4_11"), "higher")


def steady_error(model: str) -> float:
    """Returns the static error of the force at half of the critical gain, relative to the
    set-point."""
    loop = loops.force_loop(model, timing="continuous")
    return float(1 / (1 + critical_gain(model) / 2 * abs(loop.open.response(1e-4))))


def lowest_zero_hz(k_w: float) -> float:
    """Returns the frequency in Hz of the zeros of the workpiece. `k_w`: its stiffness in N/m."""
    zeros = linear.linearise("fig4_19", overrides={"k_w": k_w}).zeros()
    return float(min(abs(zeros[zeros.imag > 0]))) / (2 * math.pi)


def nearer_zeros() -> str:
    """Returns a text that states whether the zeros of a softer workpiece are nearer to the poles of
    the rigid robot. These poles are below 20 Hz."""
    k_w = parameter("fig4_19", "k_w")
    soft, printed = lowest_zero_hz(k_w / 4), lowest_zero_hz(k_w)
    return stated(soft < printed, "nearer", f"{soft:.3g} instead of {printed:.3g} Hz")


def two_links() -> str:
    """Returns a text that states whether the zeros of the two-link arm are in the right half-plane
    for some masses and not for others."""
    uniform = TwoLinkArm()
    found = {uniform.nonminimum_phase(), MASS_AT_THE_END.nonminimum_phase()}
    zeros = uniform.system().select(("torque1",), ("normal",)).zeros()
    right = int(np.sum(zeros.real > 1e-6))
    return stated(found == {True, False}, "depend", f"{right} with uniform links")


def arm_is_stable(arm: TwoLinkArm, output: str) -> bool:
    """Returns True if the two-link arm is stable at gains from 1 to 1e6 N m/rad or N. Torque 1
    feeds back a position plus 0.1 s times its velocity, and a damper acts on joint 2."""
    system = replace(arm, d2=20.0).system().select(("torque1",), (output,))
    fed = system.C + 0.1 * system.C @ system.A
    closed = (system.A - gain * system.B @ fed for gain in np.geomspace(1.0, 1e6, 25))
    return all(np.linalg.eigvals(A).real.max() < 0 for A in closed)


def zeros_limit() -> str:
    """Returns a text that states whether zeros in the right half-plane limit the gain of the
    two-link arm. This is so if only the endpoint with such zeros has a critical gain. The joint,
    and an endpoint without such zeros, then have none."""
    endpoint = arm_is_stable(TwoLinkArm(), "normal")
    others = arm_is_stable(TwoLinkArm(), "joint1") and arm_is_stable(MASS_AT_THE_END, "normal")
    return "limit the gain" if others and not endpoint else "do not limit the gain"


CLAIMS = [
    Claim(
        "6.1.2, Fig 6.1", "poles more than zeros, rigid axis and actuator", 3, "",
        lambda: excess("fig2_8"), 0,
    ),
    Claim(
        "6.1.2, Fig 6.1", "rigid axis and actuator: phase", "past -180 deg", "",
        lambda: passed_180("fig2_8"),
    ),
    Claim(
        "6.1.2", "lag that a colocated mode can add (the base, undamped), or more", 50, "deg",
        colocated_lag_deg, 0.0, at_least=True,
    ),
    Claim(
        "6.1.2", "base A, hardly damped, at half of its frequency", STABLE, "",
        lambda: stability("fig2_16a", k_b=parameter("fig2_16a", "k_b") / 4, **LIGHT_BASE),
    ),
    Claim(
        "6.1.2", "lag that a well damped colocated mode adds, over an undamped one", "less", "",
        lambda: compared(
            -added_phase_deg("fig4_17", "fig4_11", span_hz=(5.0, 60.0)).min()
            / colocated_lag_deg(), "less", True,
        ),
    ),
    Claim(
        "6.1.2", "noncolocated arm: poles more than zeros that it adds", "more poles", "",
        lambda: stated(
            excess("fig4_15") > excess("fig4_11"), "more poles",
            f"{excess('fig4_15') - excess('fig4_11')}",
        ),
    ),
    Claim(
        "6.1.2, 6.1.4", "lag that a noncolocated mode can add (the arm)", 180, "deg", arm_lag_deg,
        0.1, ARM_DAMPING,
    ),
    Claim(
        "6.1.3", "damping of the workpiece: limit, b_w = 363 over 8.25", "higher", "",
        lambda: compared(critical_gain("fig4_19", b_w=363.0) / critical_gain("fig4_19"), "higher"),
    ),
    Claim(
        "6.1.4", "heavier robot, x 1.2: crossover over that of the printed one", "lower", "",
        lambda: compared(
            crossing_hz("fig4_11", m_r=1.2 * parameter("fig4_11", "m_r")) / crossing_hz("fig4_11"),
            "lower", True,
        ),
    ),
    Claim(
        "6.1.4", "more damping (x 4) of the noncolocated arm: its lag over that as printed", 1, "",
        lambda: arm_lag_deg(4.0) / arm_lag_deg(), 0.1,
        "the damper of the arm carries force past the spring, so that the lag falls from 149 to 95 "
        "degrees",
    ),
    Claim(
        "6.1.4", "modes of base, workpiece and arm",
        "base colocated, workpiece colocated, arm noncolocated", "", labels,
    ),
    Claim(
        "6.1.4", "arm mode raised to twice the crossover of the rigid robot", "enough", "",
        lambda: stiff_arm(2.0),
    ),
    Claim(
        "6.1.4", "arm mode raised just beyond the crossover of the rigid robot, by 10 %", "enough",
        "", lambda: stiff_arm(1.1),
        why="the lag of a mode begins below its frequency: a mode at 1.5 times the crossover "
        "leaves .91 of it, at twice .96",
    ),
    Claim(
        "6.2.1", "derivative force control, 5 ms: crossover over that without", "higher", "",
        lambda: bandwidth_ratio("derivative", derivative_s=0.005),
    ),
    Claim(
        "6.2.1", "lead filter, 30 to 200 Hz: crossover over that without", "higher", "",
        lambda: bandwidth_ratio("lead", lead_zero_hz=30.0, lead_pole_hz=200.0),
    ),
    Claim("6.2.1", "velocity-sensing force sensor: zeros that it adds", 1, "", added_zeros, 0.0),
    Claim("6.2.1", "softer workpiece: its zeros and the poles of the robot", "nearer", "",
          nearer_zeros),
    Claim(
        "6.2.1", "softer workpiece: crossover over that of the original", "no better", "",
        lambda: "no better: " + f"{crossing_hz('fig4_22') / crossing_hz('fig4_19'):.2g} times"
        if crossing_hz("fig4_22") <= crossing_hz("fig4_19") else "better",
    ),
    Claim(
        "6.2.1", "soft grip: steady error at half of the limit over that without grip", "lower", "",
        lambda: compared(steady_error("fig4_25") / steady_error("fig4_19"), "lower", True),
    ),
    Claim(
        "6.2.2", "base of the machine: limit with it over limit without", "not lower", "",
        lambda: stated(
            critical_gain("fig4_17") > 0.95 * critical_gain("fig4_11"), "not lower",
            f"{critical_gain('fig4_17') / critical_gain('fig4_11'):.3g} times",
        ),
    ),
    Claim("6.2.3, Fig 6.3", "two-link arm: zeros and the masses of the links", "depend", "",
          two_links),
    Claim(
        "6.2.3, Fig 6.3", "two-link arm: zeros of the endpoint in the right half-plane",
        "limit the gain", "", zeros_limit,
    ),
]  # fmt: skip
