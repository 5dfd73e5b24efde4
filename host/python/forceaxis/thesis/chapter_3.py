"""Numbers and statements of Chapter 3 of the thesis: measurements of the machine."""

import functools
import math
from itertools import product

import numpy as np

from forceaxis import _core, linear, paths
from forceaxis.experiments import run as runs
from forceaxis.thesis.analysis import (
    Numbers,
    cells,
    column,
    crossing_hz,
    highest_stable,
    matching,
    parameter,
    phase_deg,
    pole,
    prominence_db,
    resonances_hz,
    response,
    verdicts,
)
from forceaxis.thesis.claim import Claim, compared, stated

TIP, MOTOR = "tip.acceleration", "robot.acceleration"
ARM_HZ = (25.0, 37.0)  # frequencies in Hz around the mode of vibration of the arm
K_AMP = (
    "k_amp = 15 of Fig 4.4 gives a soft current loop; the laboratory's amplifier (Fig 4.3) must "
    "have been steeper: k_amp = 582 gives the 2000 Hz"
)


def outer() -> float:
    """Returns the parameter k_amp_outer: the slope of the laboratory's amplifier in its outer
    range."""
    return parameter("laboratory", "k_amp_outer")


def rolloff_hz(model: str, output: str, **overrides: float) -> tuple[float, float]:
    """Returns (gain at 0.01 Hz, frequency in Hz at which the gain is 3 dB below this gain) of the
    frequency response of a model."""
    f = np.geomspace(0.01, 1e4, 60001)
    size = abs(response(model, output, f, overrides=overrides))
    return size[0], f[np.argmax(size < size[0] / math.sqrt(2))]


def loop_rolloff_hz(k_amp: float) -> float:
    """Returns the bandwidth (-3 dB) in Hz of the current loop with a locked shaft. The transfer
    function of the loop is k_amp k_current / (L s + R + k_amp k_current)."""
    feedback = k_amp * parameter("laboratory", "k_current")
    inductance = parameter("laboratory", "L")
    return (parameter("laboratory", "R") + feedback) / inductance / (2 * math.pi)


def current_loop_gain(k_amp: float) -> float:
    """Returns the ratio of current feedback to command at frequency 0, which is k_amp k_current /
    (R + k_amp k_current)."""
    feedback = k_amp * parameter("laboratory", "k_current")
    return feedback / (parameter("laboratory", "R") + feedback)


def flatness(output: str, frequency_hz: float) -> float:
    """Returns the gain of the laboratory's drive at `frequency_hz`, divided by its gain at 0.01 Hz.
    Both gains are from the command to the output `output`."""
    low, high = abs(response("laboratory", output, [0.01, frequency_hz]))
    return float(high / low)


def preamplifier_phase() -> str:
    """Returns a text that states whether the current command follows the velocity command without a
    phase shift at 1600 Hz."""
    phase = np.degrees(np.angle(response("laboratory", "drive.current_command", 1600.0)))
    return stated(bool(abs(phase) < 1), "zero", f"{phase:.2g} deg")


def phase_crossing_hz(output: str, model: str = "fig4_14") -> float | str:
    """Returns the frequency in Hz at which the phase from the command to an acceleration falls
    through 0 degrees, without contact. Returns "none" if it never does."""
    f = np.linspace(5.0, 200.0, 39001)
    H = response(model, output, f, free=True)
    falls = (H.imag[:-1] > 0) & (H.imag[1:] <= 0) & (H.real[:-1] > 0)
    return float(f[np.argmax(falls)]) if falls.any() else "none"


def later_crossing() -> str:
    """Returns a text that compares two accelerations, of the motor and of the tip. It states
    whether the phase of the motor's acceleration falls through 0 degrees at a higher frequency."""
    motor, tip = phase_crossing_hz(MOTOR), phase_crossing_hz(TIP)
    if isinstance(motor, str) or isinstance(tip, str):
        return f"motor {motor}, tip {tip}"
    return compared(motor / tip, "higher")


def base_dip() -> tuple[float, float]:
    """Returns (frequency in Hz, phase in degrees) of the first minimum in the phase of the tip's
    acceleration, without contact."""
    f = np.linspace(5.0, 25.0, 8001)
    phase = np.degrees(np.unwrap(np.angle(response("fig4_14", TIP, f, free=True))))
    least = np.flatnonzero((phase[1:-1] < phase[:-2]) & (phase[1:-1] <= phase[2:]))[0] + 1
    return float(f[least]), float(phase[least])


def more_lag() -> str:
    """Returns a text that states whether the tip's acceleration lags behind the motor's
    acceleration at all frequencies from 5 to 100 Hz."""
    f = np.linspace(5.0, 100.0, 2001)
    behind = np.unwrap(np.angle(response("fig4_14", TIP, f, free=True)
                                / response("fig4_14", MOTOR, f, free=True)))  # fmt: skip
    return stated(
        bool((behind <= 1e-9).all()),
        "everywhere",
        f"by {np.degrees(-behind).max():.3g} deg at most",
    )


def same_poles() -> str:
    """Returns a text that states whether the accelerations of motor and tip have equal poles and
    different zeros."""
    motor, tip = (linear.linearise("fig4_14", outputs=(o,), free=True) for o in (MOTOR, TIP))
    poles = np.allclose(np.sort_complex(motor.poles()), np.sort_complex(tip.poles()))
    first, second = (np.sort_complex(one.zeros()) for one in (motor, tip))
    differ = len(first) != len(second) or not np.allclose(first, second)
    return "equal poles, different zeros" if poles and differ else "otherwise"


def arm_peak(first: tuple[str, bool], second: tuple[str, bool]) -> str:
    """Returns a text that states whether the resonance of the arm is lower in the first response of
    Fig 4.14 than in the second. A response is a pair (output, True for the response without
    contact)."""
    low, high = (prominence_db("fig4_14", output, free, ARM_HZ) for output, free in (first, second))
    return stated(low < high, "lower", f"{low:.2g} and {high:.2g} dB")


def crossing_phase_deg() -> float:
    """Returns the phase in degrees of the open loop of motor and rigid robot, at the frequency at
    which the closed loop becomes unstable."""
    f = np.geomspace(0.1, crossing_hz("fig4_11"), 2000)
    return float(phase_deg(response("fig4_11", "reading", f))[-1])


def resonances_below_80() -> str:
    """Returns the frequencies of the resonances below 80 Hz in Fig 4.14, without contact."""
    return ", ".join(f"{hz:.3g}" for hz in resonances_hz("fig4_14") if hz < 80)


@functools.cache
def position_step(*sets: str) -> runs.Run:
    """Returns the simulated run of the step of 36,000 counts in Fig 3.13. `sets`: overrides of the
    run."""
    return runs.run(paths.EXPERIMENTS / "position_step.toml", sets)


def overshoot(*sets: str) -> str:
    """Returns a text that states whether the encoder's position overshoots in the step of Fig
    3.13."""
    encoder = position_step(*sets).columns["encoder"]
    percent = 100 * (encoder.max() / 36000 - 1)
    return f"some: {percent:.2g} %" if percent > 0 else "none"


def constant(speed: Numbers) -> str:
    """Returns a text that states whether a speed is constant within 5 %."""
    change = float(np.ptp(speed) / speed.mean())
    return stated(change < 0.05, "constant", f"it changes by {100 * change:.2g} %")


def steady_speed() -> str:
    """Returns a text that states whether the speed is constant from 30 to 70 % of the step."""
    columns = position_step().columns
    part = (columns["encoder"] > 0.3 * 36000) & (columns["encoder"] < 0.7 * 36000)
    return constant(columns["robot.velocity"][part])


def reverses() -> str:
    """Returns a text that states whether the output of the controller reverses to brake the axis.
    The text has the smallest and the largest output."""
    dac = position_step().columns["dac"]
    return stated(dac.min() < 0, "reverses", f"{dac.max():.0f} to {dac.min():.0f}")


def flexible_step() -> str:
    """Returns a text that states whether the position step with the flexible arm of the laboratory
    differs from the step with the rigid robot by less than 0.2 % of the travel. The step starts 10
    inch before the workpiece."""
    sets = ("experiment.model=../models/laboratory.toml", "approach=0.254",
            "firmware.position_setpoint=-4000")  # fmt: skip
    moved = [one.columns["encoder"] for one in (position_step(), position_step(*sets))]
    part = float(abs((moved[1] - moved[1][0]) - moved[0]).max()) / 36000
    return stated(part < 0.002, "not noticeable", f"{100 * part:.1g} % of the travel")


def saturated() -> str:
    """Returns a text that names the quantities that reach an end of their range in the step of Fig
    3.13: controller output, current command, or both."""
    columns = position_step().columns
    ends = {
        "output": columns["dac"].max() == 2047,
        "current command": columns["drive.current_command"].max() >= 10,
    }
    return " and ".join(name for name, reached in ends.items() if reached)


def highest_by_setpoint() -> str:
    """Returns a text that states whether the highest stable gain of Fig 3.15 falls as the force
    set-point rises. The text lists the highest stable gains of the simulated runs."""
    highest: dict[int, int] = {}
    for one in cells():
        if one.figure == "3.15" and one.force_setpoint is not None and one.ours == "stable":
            before = highest.get(one.force_setpoint, 0)
            highest[one.force_setpoint] = max(before, one.force_gain)
    gains = [highest[setpoint] for setpoint in sorted(highest)]
    falls = gains == sorted(gains, reverse=True) and gains[0] > gains[-1]
    return stated(falls, "falls", ", ".join(str(gain) for gain in gains))


def setpoint_of_3_16() -> str:
    """Returns a text with the lowest force set-point at which the runs agree with Fig 3.16: gain 9
    holds the contact, and gain 10 does not. By Fig 3.15, this is possible from 11 to 15 counts,
    because gain 10 is stable up to 10 counts and unstable from 15 counts on."""
    pairs = list(product(range(10, 17), (9, 10)))
    found = verdicts(
        "contact",
        [[f"firmware.force_gain={gain}", f"firmware.force_setpoint={s}"] for s, gain in pairs],
    )
    at = dict(zip(pairs, found, strict=True))
    both = [s for s in range(10, 17) if (at[s, 9], at[s, 10]) == ("stable", "unstable")]
    if not both:
        return "at no set-point"
    return f"above 10, at most 15: from {both[0]} counts on" if 10 < both[0] <= 15 else str(both[0])


def first_touch(run: runs.Run) -> int:
    """Returns the index of the last row of a simulated run before the robot first touches the
    workpiece."""
    first = next(event[0] for event in run.events if event[1:] == ("sensor", "apart", "pressed"))
    return int(np.searchsorted(run.columns["time_s"], first)) - 1


def speed_before_touch() -> str:
    """Returns a text that states whether the speed of the robot is constant over the last 5 mm
    before the contact of Fig 3.14."""
    run = runs.run(paths.EXPERIMENTS / "contact.toml")
    end = first_touch(run)
    start = int(np.searchsorted(run.columns["robot.position"][:end], -0.005))
    return constant(run.columns["robot.velocity"][start : end + 1])


def contact_speed() -> str:
    """Returns a text that compares two speeds in mm/s. It states whether the robot touches the
    workpiece at a lower speed than the workpiece has after an impact."""
    run = runs.run(paths.EXPERIMENTS / "strike.toml")
    time_s = run.columns["time_s"]
    touch = run.columns["tip.velocity"][first_touch(run)]
    strike = abs(run.columns["workpiece.velocity"][(time_s > 4.99) & (time_s < 5.05)]).max()
    return stated(touch < strike, "slower", f"{1e3 * touch:.3g} and {1e3 * strike:.3g} mm/s")


def lower_limit() -> str:
    """Returns a text that states whether an impact on the workpiece lowers the highest stable gain
    of a contact."""
    with_strike, contact = (highest_stable(test, "original") for test in ("disturbance", "contact"))
    return stated(with_strike < contact, "lower", f"{with_strike:g} instead of {contact:g}")


CLAIMS = [
    Claim(
        "3.0.1", "rigid robot with motor: phase of the open loop at the crossing", -180, "deg",
        crossing_phase_deg, 1e-6,
    ),
    Claim(
        "3.1.1, Fig 3.6", "preamplifier, phase of the velocity command at 1600 Hz", "zero", "",
        preamplifier_phase,
    ),
    Claim(
        "3.1.2", "rate of the servo loops", 1500, "Hz", lambda: _core.TICKS_PER_SECOND, 0.0
    ),
    Claim(
        "3.1.2", "A/D converter of the force", 8, "bits",
        lambda: linear.facts("laboratory").required_reading.bits, 0.0,
    ),
    Claim(
        "3.1.2", "D/A converter of the command", 12, "bits",
        lambda: math.log2(
            2 * parameter("laboratory", "dac_range") / linear.facts("laboratory").volts_per_code
        ), 1e-9,
    ),
    Claim(
        "3.1.3", "workpiece by itself", 39.8, "Hz",
        lambda: pole("fig4_19", 39.8, free=True)[0], 0.002,
    ),
    Claim(
        "3.2.1, Fig 3.6", "preamplifier, gain of the velocity command", 4.1, "V/V",
        lambda: float(abs(response("laboratory", "drive.current_command", 1e-4))), 0.03,
        "Fig 4.4 prints 3.9; 4.1.2 exchanges the two measured gains (3.9 and 4.2)",
    ),
    Claim(
        "3.2.1, Fig 3.6", "preamplifier, gain at 1600 Hz over that at DC: flat", 1, "",
        lambda: flatness("drive.current_command", 1600.0), 0.01,
    ),
    Claim(
        "3.2.1, Fig 3.7", "preamplifier, gain of the tachometer feedback", -3.9, "V/V",
        lambda: float(response("fig3_7", "drive.current_command", 1e-4).real), 0.03,
        "Fig 4.4 prints 4.2; 4.1.2 exchanges the two measured gains",
    ),
    Claim(
        "3.2.1, Fig 3.7", "filter of the tachometer feedback", 150, "Hz",
        lambda: parameter("laboratory", "a_preamp_fdbk") / (2 * math.pi), 0.01,
    ),
    Claim(
        "3.2.1, Fig 3.8", "current loop at low frequency, k_amp = 15: roughly", 1, "",
        lambda: current_loop_gain(15), 0.1, K_AMP,
    ),
    Claim(
        "3.2.1, Fig 3.8", "current loop at low frequency, outer slope: roughly", 1, "",
        lambda: current_loop_gain(outer()), 0.1,
    ),
    Claim(
        "3.2.1, Fig 3.8", "current loop, shaft locked, k_amp = 15", 2000, "Hz",
        lambda: loop_rolloff_hz(15), 0.1, K_AMP,
    ),
    Claim(
        "3.2.1, Fig 3.8", "current loop, shaft locked, outer slope (chosen for it)",
        2000, "Hz", lambda: loop_rolloff_hz(outer()), 0.1,
    ),
    Claim(
        "3.2.1, Fig 3.9", "motor without load at DC, k_amp = 15", 0.85, "V/V",
        lambda: rolloff_hz("fig4_5", "drive.tach")[0], 0.05, K_AMP,
    ),
    Claim(
        "3.2.1, Fig 3.9", "motor without load at DC, outer slope", 0.85, "V/V",
        lambda: rolloff_hz("fig4_5", "drive.tach", k_amp=outer())[0],
    ),
    Claim(
        "3.2.1, Fig 3.9", "motor without load, roll-off, k_amp = 15", 46, "Hz",
        lambda: rolloff_hz("fig4_5", "drive.tach")[1], 0.1, K_AMP,
    ),
    Claim(
        "3.2.1, Fig 3.9", "motor without load, roll-off, outer slope", 46, "Hz",
        lambda: rolloff_hz("fig4_5", "drive.tach", k_amp=outer())[1], 0.1,
    ),
    Claim(
        "3.2.3", "accelerations of motor and tip", "equal poles, different zeros", "", same_poles
    ),
    Claim(
        "3.2.3, Fig 3.11", "resonances below 80 Hz, free", "12, 38, 44, 67, 77", "Hz",
        resonances_below_80,
        why="in Fig 4.14 they are base, arm and workpiece; the others belong to parts of the "
        "machine that no model of Chapter 4 has",
    ),
    Claim(
        "3.2.3, Fig 3.10", "resonance of the arm: motor against tip", "lower", "",
        lambda: arm_peak((MOTOR, True), (TIP, True)),
    ),
    Claim(
        "3.2.3, Fig 3.10", "motor acceleration: phase falls through 0", 50, "Hz",
        lambda: phase_crossing_hz(MOTOR), 0.1,
    ),
    Claim(
        "3.2.3, Fig 3.11", "tip acceleration: dip of the phase at the base mode", 12, "Hz",
        lambda: base_dip()[0], 0.1,
    ),
    Claim(
        "3.2.3, Fig 3.11", "tip acceleration: that dip reaches", "below 0 deg", "",
        lambda: "below 0 deg" if base_dip()[1] < 0 else f"{base_dip()[1]:.0f} deg",
        why="the base of Fig 4.26 is damped too well for that: half its b_b gives -6 deg",
    ),
    Claim(
        "3.2.3, Fig 3.11", "tip acceleration: phase falls through 0", 28, "Hz",
        lambda: phase_crossing_hz(TIP), 0.1,
    ),
    Claim(
        "3.2.3", "tip acceleration, without the base: phase falls through 0", 28, "Hz",
        lambda: phase_crossing_hz(TIP, "fig4_15"), 0.1,
        "24 Hz with arm and motor alone; the lead behind the base's mode moves it to 26 Hz",
    ),
    Claim(
        "3.2.3", "phase falls through 0: motor over tip", "higher", "", later_crossing
    ),
    Claim("3.2.3", "lag of the tip behind the motor", "everywhere", "", more_lag),
    Claim(
        "3.2.3, Fig 3.12", "resonance of the arm: contact force against tip acceleration", "lower",
        "", lambda: arm_peak(("reading", False), (TIP, True)),
    ),
    Claim(
        "3.2.3", "arm mode in contact over arm mode free", "higher", "",
        lambda: compared(pole("fig4_15", 35)[0] / pole("fig4_15", 33, free=True)[0], "higher"),
    ),
    Claim(
        "3.3.1", "travel of the 36,000-count step", 9, "inch",
        lambda: 36000 / parameter("laboratory", "encoder_scale") / 0.0254, 0.001,
    ),
    Claim("3.3.1, Fig 3.13", "36,000-count step: overshoot", "some", "", overshoot),
    Claim(
        "3.3.1, Fig 3.13", "36,000-count step, three times the velocity gain: overshoot", "none",
        "", lambda: overshoot("firmware.velocity_gain=60"),
    ),
    Claim(
        "3.3.1, Fig 3.13", "36,000-count step: speed in the middle of the travel", "constant", "",
        steady_speed,
    ),
    Claim("3.3.1, Fig 3.13", "36,000-count step: output", "reverses", "", reverses),
    Claim(
        "3.3.1, 4.5.1", "36,000-count step: flexible arm against rigid robot", "not noticeable", "",
        flexible_step,
    ),
    Claim(
        "3.3.1, Fig 3.13", "36,000-count step: at the end of their range",
        "output and current command", "", saturated,
    ),
    Claim(
        "3.3.2, Fig 3.14", "speed of the robot over the last 5 mm before the contact", "constant",
        "", speed_before_touch,
    ),
    Claim(
        "3.3.2, Fig 3.15", "cells of Fig 3.15 with the measured verdict", 15, "",
        lambda: matching("3.15"), 0.0,
    ),
    Claim(
        "3.3.2, Fig 3.15", "highest stable gain at set-points 5, 10, 15, 20, 30", "falls", "",
        highest_by_setpoint,
    ),
    Claim(
        "3.3.2, Fig 3.16", "cells of Fig 3.16 with the measured verdict", 18, "",
        lambda: sum(c.agrees for t in ("contact", "disturbance") for c in column(t, "original")),
        0.0,
    ),
    Claim(
        "3.3.2, Fig 3.16", "highest stable gain in contact", 9, "",
        lambda: highest_stable("contact", "original"), 0.0,
    ),
    Claim(
        "3.3.2, Fig 3.16", "highest stable gain with a strike", 5, "",
        lambda: highest_stable("disturbance", "original"), 0.0,
    ),
    Claim(
        "3.3.2, Fig 3.16", "highest stable gain: strike against contact", "lower", "", lower_limit
    ),
    Claim(
        "3.3.2, Fig 3.16", "set-point that Fig 3.16 leaves open, by Fig 3.15",
        "above 10, at most 15", "", setpoint_of_3_16,
    ),
    Claim(
        "3.3.2", "first touch against a strike: speed", "slower", "", contact_speed
    ),
]  # fmt: skip
