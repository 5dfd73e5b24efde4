"""Numbers and statements of Chapter 5 of the thesis: grip compliance and workpiece damping."""

import functools
import math

import numpy as np

from forceaxis import linear, paths
from forceaxis.experiments import run as runs
from forceaxis.linear import loops
from forceaxis.thesis.analysis import (
    cell,
    cells,
    column,
    critical_gain,
    crossing_hz,
    crossing_root,
    highest_stable,
    near,
    nearest,
    parameter,
    pole,
    printed,
    response,
    spacing,
    stiffer,
)
from forceaxis.thesis.claim import Claim, compared, stated

SOFTER = 0.25  # stiffness of a softer sensor, relative to the stiffness that the thesis prints
ONE_MORE = "gain 9 with a strike is stable here; a damper that yields would give it, see the report"


def workpiece_damping(b_w: float) -> float:
    """Returns the damping ratio of the workpiece alone. `b_w`: its damping in N s/m."""
    return pole("fig4_19", 39.8, overrides={"b_w": b_w}, free=True)[1]


def higher_gains_percent(test: str) -> float:
    """Returns by how many per cent the highest stable gain is higher with the damped workpiece."""
    return 100 * (highest_stable(test, "damped") / highest_stable(test, "original") - 1)


def grip_zero_hz(model: str, near_hz: float) -> float:
    """Returns the frequency in Hz of the zeros that the grip adds to the force response."""
    return abs(nearest(linear.linearise(model).zeros(), near_hz)) / (2 * math.pi)


def cancelled() -> str:
    """Returns a text that states whether the zeros of the grip cancel the poles of the workpiece as
    the stiffness of the grip goes to 0. The computation divides the stiffness and the damping of
    the grip by 1000."""
    softest = {name: printed(name) / 1000 for name in ("k_g", "b_g")}
    parts = [spacing("fig4_25", 40.8, 39.2), spacing("fig4_25", 39.8, 39.8, **softest)]
    return stated(parts[1] < 1e-3, "cancel", f"{100 * parts[0]:.2g} to {100 * parts[1]:.1g} %")


def dominant() -> str:
    """Returns a text that states whether, at gain 10 and with the soft grip, the least damped
    closed-loop poles have the frequency of the workpiece."""
    loop = loops.force_loop("fig4_25", timing="continuous")
    poles = loop.closed_poles(loop.gain_of(10.0))
    hz = abs(poles[np.argmin(-poles.real / abs(poles))]) / (2 * math.pi)
    return stated(abs(hz - 39.8) < 2, "of the workpiece", f"{hz:.3g} Hz")


def zeta(b: float, k: float, m: float) -> float:
    """Returns the damping ratio of a mass m in kg on a spring k in N/m and a damper b in N s/m."""
    return b / 2 / math.sqrt(k * m)


def grip_damps_robot() -> str:
    """Returns a text that states whether the damping that the grip adds to the robot is
    negligible."""
    ratio = zeta(printed("b_g"), printed("k_g"), printed("m_r"))
    return stated(ratio < 0.05, "too little", f"damping ratio {ratio:.2g}")


def grip_damps_sensor() -> str:
    """Returns a text that states whether the grip damps the sensor's mass well."""
    ratio = zeta(printed("b_g"), printed("k_g"), printed("m_s"))
    return stated(ratio > 0.1, "well", f"damping ratio {ratio:.2g}")


def lead() -> str:
    """Returns a text that states whether the zeros of the soft grip have lower frequencies than its
    poles, as in a lead compensator."""
    zeros_hz, poles_hz = grip_zero_hz("fig4_25", 68.0), pole("fig4_25", 156.0)[0]
    return stated(zeros_hz < poles_hz, "zeros first", f"{zeros_hz:.3g} and {poles_hz:.3g} Hz")


def contact_hz(part: float, k_s: float) -> float:
    """Returns the frequency in Hz at which rigid robot and motor vibrate in contact. `part`: gain
    relative to the critical gain that the thesis prints. `k_s`: stiffness of the sensor in N/m."""
    loop = loops.force_loop("fig4_11", timing="continuous", overrides={"k_s": k_s})
    poles = loop.closed_poles(part * critical_gain("fig4_11"))
    return abs(nearest(poles, 0.0)) / (2 * math.pi)


def soft_over_none(frequency_hz: float) -> float:
    """Returns the loop gain with the soft grip divided by the loop gain without a grip, at one
    frequency."""
    soft, none = (abs(response(m, "reading", frequency_hz)) for m in ("fig4_25", "fig4_19"))
    return float(soft / none)


def reshaped() -> str:
    """Returns a text that states whether the soft grip has more effect than a lower loop gain. This
    is so if the ratio of the critical gains times the ratio of the loop gains at 10 Hz is not 1."""
    product = critical_gain("fig4_25") / critical_gain("fig4_19") * soft_over_none(10.0)
    return stated(abs(product - 1) > 0.1, "changes", f"{product:.3g} times beyond the loop gain")


def motion_per_force(model: str) -> float:
    """Returns the motion of the robot in m for a measured force of 1 N at frequency 0."""
    moved, sensed = (abs(response(model, o, 1e-4, drive=False))
                     for o in ("robot.position", "reading"))  # fmt: skip
    return float(moved / sensed)


def together(k_g: float) -> float:
    """Returns the amplitude of the sensor's mass divided by the amplitude of the workpiece, at 20
    Hz."""
    ends = [
        response("fig4_25", f"{body}.position", 20.0, {"k_g": k_g})
        for body in ("sensor_mass", "workpiece")
    ]
    return float(abs(ends[0] / ends[1]))


def moves_apart() -> str:
    """Returns a text that states whether sensor and workpiece move together with a stiff grip, but
    not with a soft grip."""
    stiff, soft = together(1e7), together(printed("k_g"))
    return stated(abs(stiff - 1) < 0.1 and soft > 2, "apart", f"{soft:.3g} against {stiff:.3g}")


@functools.cache
def touch_speed(workpiece: str) -> float:
    """Returns the speed in m/s at the first contact. The gain is the highest stable gain of Fig
    5.10."""
    gain = highest_stable("contact", workpiece)
    run = runs.run(
        paths.EXPERIMENTS / "contact.toml",
        [f"firmware.force_gain={gain:g}", f"firmware.force_setpoint={printed('setpoint_fig5_10')}"],
    )
    first = next(event[0] for event in run.events if event[1:] == ("sensor", "apart", "pressed"))
    at = np.searchsorted(run.columns["time_s"], first) - 1
    return float(run.columns["tip.velocity"][at])


def much_faster() -> str:
    """Returns a text that states whether, with the damped workpiece, the speed at the first contact
    is more than a quarter higher than with the original one. The gain is the highest stable
    gain."""
    ratio = touch_speed("damped") / touch_speed("original")
    return stated(ratio > 1.25, "much higher", f"{ratio:.3g} times")


def corner() -> str:
    """Returns the verdict of the run at gain 10 and at a force set-point of 15 counts without a
    pad, as in Fig 3.15."""
    return next(
        c.ours for c in cells() if (c.figure, c.force_gain, c.force_setpoint) == ("3.15", 10, 15)
    )


CLAIMS = [
    Claim(
        "5.1.1, Fig 4.24", "stiff grip with motor: its poles and zeros", "near", "",
        lambda: near("fig4_24", 1366.0, 1359.0),
    ),
    Claim(
        "5.1.1, Fig 4.24", "stiff grip with motor: its poles over the crossover", "far above", "",
        lambda: stated(
            pole("fig4_24", 1366.0)[0] > 10 * crossing_hz("fig4_24"), "far above",
            f"{pole('fig4_24', 1366.0)[0] / crossing_hz('fig4_24'):.2g} times",
        ),
    ),
    Claim(
        "5.1.1, Fig 4.25", "zeros of the grip: frequency of the soft over that of the stiff",
        "much lower", "",
        lambda: compared(
            grip_zero_hz("fig4_25", 68.0) / grip_zero_hz("fig4_24", 1359.0), "much lower", True
        ),
    ),
    Claim(
        "5.1.1", "grip zeros and workpiece poles as k_g goes to 0, distance", "cancel", "",
        cancelled,
    ),
    Claim("5.1.2, Fig 5.1", "gain 10, set-point 15 without a pad", "unstable", "", corner),
    Claim(
        "5.1.2, Fig 5.2", "gain 10, set-point 15 on the hard pad", "unstable", "",
        lambda: cell("5.2"),
        why="a linear pad lowers the loop gain by 42 %; that pads stiffen when compressed (5.1.3) "
        "is not in the model",
    ),
    Claim("5.1.2, Fig 5.3", "gain 10, set-point 15 on the soft pad", "stable", "",
          lambda: cell("5.3")),
    Claim("5.1.2, Fig 4.25", "soft grip: dominant poles", "of the workpiece", "", dominant),
    Claim("5.1.3", "damping of the robot by the grip", "too little", "", grip_damps_robot),
    Claim("5.1.3", "damping of the sensor by the grip", "well", "", grip_damps_sensor),
    Claim(
        "5.1.3", "grip: damping for its stiffness, b_g / k_g over b_s / k_s", "high", "",
        lambda: compared(
            printed("b_g") / printed("k_g") / (printed("b_s") / printed("k_s")), "high"
        ),
    ),
    Claim(
        "5.1.3", "soft grip: damping ratio of the workpiece over that of the workpiece by itself",
        "higher", "",
        lambda: compared(pole("fig4_25", 41.0)[1] / pole("fig4_19", 39.8, free=True)[1], "higher"),
    ),
    Claim(
        "5.1.3", "soft grip: crossover over that without grip", "higher", "",
        lambda: compared(crossing_hz("fig4_25") / crossing_hz("fig4_19"), "higher"),
    ),
    Claim("5.1.3", "soft grip: lead at low frequency, taken away above", "zeros first", "", lead),
    Claim(
        "5.1.3", "soft grip: loop gain at 10 Hz over that without grip", "lower", "",
        lambda: compared(soft_over_none(10.0), "lower", True),
    ),
    Claim(
        "5.1.3", "soft grip: limit over that without grip", "higher", "",
        lambda: compared(critical_gain("fig4_25") / critical_gain("fig4_19"), "higher"),
    ),
    Claim(
        "5.1.3", "softer workpiece, / 4: limit over that of the original", "higher", "",
        lambda: compared(
            critical_gain("fig4_19", **stiffer(0.25)) / critical_gain("fig4_19"), "higher"
        ),
    ),
    Claim(
        "5.1.3", "softer sensor, / 4: limit over that of the printed one", "higher", "",
        lambda: compared(
            critical_gain("fig4_11", k_s=SOFTER * printed("k_s")) / critical_gain("fig4_11"),
            "higher",
        ),
    ),
    Claim(
        "5.1.3", "softer sensor, / 4: frequency in contact, half of the printed limit", "lower", "",
        lambda: compared(
            contact_hz(0.5, SOFTER * printed("k_s")) / contact_hz(0.5, printed("k_s")), "lower",
            True,
        ),
    ),
    Claim("5.1.3", "soft grip: shape of the root locus", "changes", "", reshaped),
    Claim("5.1.3", "soft grip: sensor and workpiece", "apart", "", moves_apart),
    Claim(
        "5.1.3", "soft grip: motion for the same force over that without grip", "greater", "",
        lambda: compared(motion_per_force("fig4_25") / motion_per_force("fig4_19"), "greater"),
    ),
    Claim(
        "5.2, Fig 5.5", "b_w of the damped workpiece over that of the original", 20, "",
        lambda: 363.0 / printed("b_w"), 0.01,
        "20 times b_w is a damping ratio of .05; the damper that was built has .11 (5.2.1)",
    ),
    Claim(
        "5.2, Fig 5.5", "workpiece damping (x 20): damping ratio of its poles in contact", "better",
        "", lambda: compared(pole("fig5_5", 45)[1] / pole("fig4_19", 45)[1], "better"),
    ),
    Claim(
        "5.2, Fig 5.5", "workpiece damping (x 20): roots cross at a higher frequency", "higher", "",
        lambda: compared(crossing_hz("fig5_5") / crossing_hz("fig4_19"), "higher"),
    ),
    Claim(
        "5.2, Fig 5.5", "workpiece damping (x 20): the root that crosses starts at a pole of",
        "workpiece", "", lambda: crossing_root("fig5_5"),
    ),
    Claim(
        "5.2, Fig 5.5", "workpiece damping (x 20): limit over that of the original", "higher", "",
        lambda: compared(critical_gain("fig5_5") / critical_gain("fig4_19"), "higher"),
    ),
    Claim(
        "5.2.1, Fig 5.6a", "damping ratio of the original workpiece", 0.002, "",
        lambda: workpiece_damping(parameter("fig4_19", "b_w")), 0.1,
        "b_w = 8.25 of Fig 4.26 is .0025",
    ),
    Claim(
        "5.2.1, Fig 5.6b", "damping ratio with material under the beam, b_w = 49.5 (chosen for it)",
        0.015, "", lambda: workpiece_damping(49.5), 0.01,
    ),
    Claim(
        "5.2.1, Fig 5.6c", "damping ratio of the damped workpiece, b_w = 363 (chosen for it)",
        0.11, "", lambda: workpiece_damping(363.0), 0.01,
    ),
    Claim(
        "5.2.1, Fig 5.7", "frequency of the damped workpiece over that of the original", 1, "",
        lambda: pole("fig4_19", 39.8, {"b_w": 363.0}, free=True)[0]
        / pole("fig4_19", 39.8, free=True)[0], 1e-6,
    ),
    Claim(
        "5.2.1, Fig 5.8", "gain 7, set-point 40, original workpiece", "unstable", "",
        lambda: cell("5.8"),
    ),
    Claim(
        "5.2.1, Fig 5.9", "gain 7, set-point 40, damped workpiece", "stable", "",
        lambda: cell("5.9"),
    ),
    Claim(
        "5.2.1", "higher gains with the damped workpiece, contact", 10, "%",
        lambda: higher_gains_percent("contact"), 0.2,
    ),
    Claim(
        "5.2.1", "higher gains with the damped workpiece, disturbance", 40, "%",
        lambda: higher_gains_percent("disturbance"), 0.5,
        "whole steps of gain: the thesis's own table goes from 5 to 8, 60 %; in ours 9 is stable "
        "too (a cell that differs)",
    ),
    Claim(
        "5.2.1, Fig 5.10", "cells of the damped half of Fig 5.10 with the measured verdict", 18, "",
        lambda: sum(c.agrees for t in ("contact", "disturbance") for c in column(t, "damped")), 0.0,
        ONE_MORE,
    ),
    Claim(
        "5.2.1, Fig 5.10", "highest stable gain in contact, damped workpiece", 10, "",
        lambda: highest_stable("contact", "damped"), 0.0,
    ),
    Claim(
        "5.2.1, Fig 5.10", "highest stable gain with a strike, damped workpiece", 8, "",
        lambda: highest_stable("disturbance", "damped"), 0.0, ONE_MORE,
    ),
    Claim(
        "5.2.1", "damped workpiece: speed of the contact at the highest stable gain", "much higher",
        "", much_faster,
        why="the speed of the approach follows the gain, which rises by 11 %, as the 10 % of the "
        "thesis say",
    ),
]  # fmt: skip
