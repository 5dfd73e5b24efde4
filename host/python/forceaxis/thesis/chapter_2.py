"""Numbers and statements of Chapter 2 of the thesis: models of machines in general."""

import math
from itertools import pairwise

import numpy as np

from forceaxis import linear, paths
from forceaxis.linear import loops
from forceaxis.thesis import figures, nonlinear
from forceaxis.thesis.analysis import (
    BETWEEN,
    STABLE,
    UNSTABLE,
    added,
    added_phase_deg,
    critical_gain,
    crossing_hz,
    label,
    limit,
    near,
    nearest,
    parameter,
    passed_180,
    phase_deg,
    pole,
    resonances_hz,
    response,
    sampled_part,
    settings,
    stability,
    stiffer,
    turns,
    verdict,
    verdicts,
)
from forceaxis.thesis.claim import Claim, compared, stated

# damping of base A in Figs 2.17 to 2.20 of the thesis, in N s/m
BASE_DAMPING = (2000.0, 9500.0, 38000.0)
LIGHT_BASE = {"b_b": BASE_DAMPING[0]}
# Damping in N s/m of the lightly damped arm of Fig 2.42, and of the arm of Fig 4.26.
LIGHT_ARM, PRINTED_ARM = 60.0, 640.0
# Gains of the runs with contact loss, relative to the critical gain of the linear model.
# GAPS has the initial distances between robot and workpiece of these runs, in m.
ABOVE, BELOW, FAR_BELOW = (1.04, 1.2, 1.5), (0.84, 0.88, 0.92), (0.5, 0.6, 0.7)
GAPS = (0.0, 3e-4, 1e-3, 5e-3, 2e-2)
STIFF_GRIP = {"k_g": 1e7}
RIGID_RUN = ("experiment.duration_s=60",)


def rolls_off() -> str:
    """Returns a text that states whether amplitude and phase of the rigid robot fall at all
    frequencies above its natural frequency."""
    f = np.geomspace(pole("fig2_3", 4.6, drive=False)[0], 500.0, 5001)
    found = response("fig2_3", "reading", f, drive=False)
    falls = bool((np.diff(abs(found)) < 0).all() and (np.diff(phase_deg(found)) < 0).all())
    return "both fall" if falls else "not both fall"


def rigid_roots(k_f: float, output: str = "reading") -> np.ndarray:
    """Returns the sorted closed-loop poles in 1/s of the rigid robot with a perfect actuator. The
    loop feeds back the force, or the position of the joint multiplied by k_s."""
    loop = loops.force_loop("fig2_3", timing="continuous", output=output)
    volts_per_N = k_f / 40.96  # the drive of Fig 2.3 gives a force of 40.96 N/V
    scale = 1.0 if output == "reading" else parameter("fig2_3", "k_s")
    return np.sort_complex(loop.closed_poles(volts_per_N * scale))


def stiffness_ratio(k_f: float) -> float:
    """Returns the product of the closed-loop poles of the rigid robot, divided by the product of
    its open-loop poles. The product of the poles is stiffness divided by mass."""
    return float(np.real(np.prod(rigid_roots(k_f)) / np.prod(rigid_roots(0.0))))


def opposite_deg() -> float:
    """Returns the largest phase difference in degrees between endpoint and actuator of the flexible
    robot."""
    f = np.linspace(1.0, 300.0, 20001)
    ends = [response("fig2_11", f"{body}.position", f, drive=False) for body in ("tip", "robot")]
    return float(-phase_deg(ends[0] / ends[1]).min())


def base_lags_deg() -> list[float]:
    """Returns the largest lag in degrees that base A adds to the rigid robot. There is one value
    for each damping in BASE_DAMPING."""
    return [
        float(-added_phase_deg("fig2_16a", "fig2_3", False, (8.0, 60.0), b_b=b).min())
        for b in BASE_DAMPING
    ]


def base_damping_ratios() -> list[tuple[float, float]]:
    """Returns (damping ratio of the poles, damping ratio of the zeros) of base A. There is one pair
    for each damping in BASE_DAMPING."""
    found = []
    for b in BASE_DAMPING:
        system = linear.linearise("fig2_16a", overrides={"b_b": b}, drive=False)
        roots = [nearest(part, 13.4) for part in (system.poles(), system.zeros())]
        found.append((-roots[0].real / abs(roots[0]), -roots[1].real / abs(roots[1])))
    return found


def rising(values: list[tuple[float, float]]) -> str:
    """Returns a text that states whether the values in both columns of a table rise. The text also
    lists the values of the first column."""
    rises = bool((np.diff(np.array(values), axis=0) > 0).all())
    return stated(rises, "rise", ", ".join(f"{first:.3g}" for first, _ in values))


def alternates() -> str:
    """Returns a text that states whether the poles and zeros of the beam's actuator response lie on
    the imaginary axis and alternate."""
    poles, zeros = figures.BEAM.poles(4)[1:], figures.BEAM.actuator_zeros(4)
    roots = sorted([(r.imag, "pole") for r in poles] + [(r.imag, "zero") for r in zeros])
    above = [name for at, name in roots if at > 0]
    on_axis = max(abs(np.concatenate([poles, zeros]).real)) < 1e-9
    alternate = all(a != b for a, b in pairwise(above))
    return "alternate" if on_axis and alternate else "do not alternate"


def real_tip_zeros() -> str:
    """Returns a text about the number of real zeros in the beam's tip response. Only the zeros
    below the fifth pair of zeros are counted.

    The real zeros are sign changes of the response on the real axis. The number of all zeros
    follows from the number of turns of the response along a circle. Inside this circle, the
    response has the pole at 0 and a pair of poles for each mode.
    """
    sizes = abs(figures.BEAM.tip_zeros(5))[::2].real
    radius = math.sqrt(sizes[3] * sizes[4])
    axis = np.linspace(1e-3 * radius, radius, 4001)
    real = 0
    for sign in (1, -1):
        values = figures.BEAM.tip(sign * axis).real
        real += int(np.sum(values[1:] * values[:-1] < 0))
    around = figures.BEAM.tip(radius * np.exp(2j * np.pi * np.linspace(0, 1, 20001)))
    inside = len([p for p in figures.BEAM.poles(8) if abs(p) < radius])
    turned = phase_deg(around)
    zeros = inside + round(float(turned[-1] - turned[0]) / 360)
    return f"all: {real} of {zeros}" if real == zeros else f"{real} of {zeros}"


def tip_zeros_phase() -> str:
    """Returns a text that states whether the tip's zeros add no phase at frequencies up to the
    fourth mode."""
    w = np.linspace(0.0, figures.BEAM.natural_frequencies(4)[-1], 1001)
    factors = np.prod(1 - 1j * w[:, None] / figures.BEAM.tip_zeros(4), axis=1)
    largest_deg = abs(np.degrees(np.angle(factors))).max()
    return stated(bool(largest_deg < 1e-6), "none", f"{largest_deg:.1g} deg")


def tip_zeros_gain() -> float:
    """Returns the factor by which the zeros of the beam's tip raise its amplitude at the fourth
    mode of vibration."""
    w = figures.BEAM.natural_frequencies(4)[-1]
    return float(abs(np.prod(1 - 1j * w / figures.BEAM.tip_zeros(4))))


def right_half_plane_zeros() -> int:
    """Returns the number of zeros with a positive real part in the force responses of all
    lumped-mass models of Chapter 2."""
    models = sorted(path.stem for path in paths.MODELS.glob("fig2_*.toml"))
    return sum(int(np.sum(linear.linearise(name).zeros().real > 0)) for name in models)


def lumped_beam_zeros(output: str) -> np.ndarray:
    """Returns the zeros in 1/s of the lumped bending beam, except zeros at 0."""
    zeros = figures.LUMPED.system().select(outputs=(output,)).zeros()
    return zeros[abs(zeros) > 1e-3]


def lumped_tip() -> str:
    """Returns a text that describes the zeros in the tip response of the lumped bending beam."""
    zeros = lumped_beam_zeros("tip")
    real = abs(zeros.imag) < 1e-9 * abs(zeros)
    pair = len(zeros) == 2 and bool(real.all()) and abs(zeros.sum()) < 1e-9 * abs(zeros).sum()
    return "one pair of equal size" if pair else f"{int(real.sum())} of {len(zeros)} are real"


def workpiece_spacings() -> str:
    """Returns a text that states whether damping moves the poles of the workpiece nearer to its
    zeros."""
    parts = []
    for b_w in (parameter("fig2_26", "b_w"), 363.0):
        system = linear.linearise("fig2_26", overrides={"b_w": b_w}, drive=False)
        at = nearest(system.poles(), 45.0)
        parts.append(abs(at - nearest(system.zeros(), 40.0)) / abs(at))
    falls = parts[1] < 0.9 * parts[0]
    return stated(falls, "nearer", " and ".join(f"{100 * part:.3g} %" for part in parts))


def workpiece_damping_rises() -> str:
    """Returns a text that states whether damping moves the poles of the workpiece away from the
    imaginary axis."""
    ratios = [
        pole("fig2_26", 45.0, {"b_w": b_w}, drive=False)[1]
        for b_w in (parameter("fig2_26", "b_w"), 363.0)
    ]
    return compared(ratios[1] / ratios[0], "more")


def real_part_ratio() -> float:
    """Returns the real part of the poles of a workpiece with four times the original stiffness,
    divided by that of the original workpiece. Both have the original damping."""
    parts = []
    for times, hz in ((4, 82.0), (1, 45.0)):
        k_w = times * parameter("fig2_26", "k_w")
        frequency, zeta = pole("fig2_26", hz, {"k_w": k_w}, drive=False)
        parts.append(frequency * zeta)
    return parts[0] / parts[1]


def dampers() -> str:
    """Returns a text that lists the dampers of Fig 2.35 by their names, from the smallest to the
    largest damping."""
    names = {"grip": "b_g", "sensor": "b_s", "workpiece": "b_w", "robot": "b_r"}
    values = {part: parameter("fig2_35", name) for part, name in names.items()}
    order = sorted(values, key=lambda part: values[part])
    return f"{order[0]}: {', '.join(f'{part} {values[part]:g}' for part in order)} N s/m"


def limit_ratio(model: str, experiment: str, without: str) -> str:
    """Returns a text that states whether the critical gain with the workpiece of an experiment is
    higher than the critical gain with a rigid workpiece."""
    ratio = critical_gain(model, **settings(experiment)) / critical_gain(without)
    return compared(ratio, "higher")


def base_lag_ratio() -> str:
    """Returns a text that states whether base B with little damping adds more lag if the drive is
    the motor than if it is a perfect actuator."""
    lags = [
        -added_phase_deg(model, without, drive, (5.0, 60.0), **LIGHT_BASE).min()
        for model, without, drive in (
            ("fig4_17", "fig4_11", True),
            ("fig2_16b", "fig2_3", False),
        )
    ]
    return stated(lags[0] > lags[1], "more", f"{lags[0]:.2g} against {lags[1]:.2g} deg")


def slow_sampling() -> str:
    """Returns a text that states whether a loop with half of the critical gain in continuous time
    is unstable at a low sampling rate. This rate is twice the frequency at which the loop in
    continuous time becomes unstable."""
    part = sampled_part("fig4_11", 2)
    return stated(part < 0.5, "unstable", f"the limit is {part:.2g} of that in continuous time")


def crossing_ratio(model: str, without: str, **overrides: float) -> float:
    """Returns the frequency at which the force loop of `model` becomes unstable, divided by the
    same frequency for `without`."""
    return crossing_hz(model, **overrides) / crossing_hz(without)


def cycles(b_rf: float, parts: tuple[float, ...]) -> np.ndarray:
    """Returns an array that is True for each run of the flexible robot with contact that ends in a
    limit cycle. Rows are gains relative to the critical gain of the linear model. Columns are
    initial gaps."""
    largest, _ = nonlinear.flexible_robot(b_rf)
    found = verdicts(
        "fig2_43_settles",
        [
            [f"b_rf={b_rf}", f"firmware.force_gain={part * largest:.4f}", f"approach={gap}"]
            for part in parts
            for gap in GAPS
        ],
    )
    return np.reshape([one == "unstable" for one in found], (len(parts), len(GAPS)))


def some_cycle(b_rf: float) -> str:
    """Returns a text that states whether some runs below the critical gain of the linear model end
    in a limit cycle."""
    found = cycles(b_rf, BELOW)
    return f"{'some' if found.any() else 'none'}: {found.sum()} of {found.size}"


def depends_on_start() -> str:
    """Returns a text that states whether, at one gain below the critical gain of the linear model,
    the initial gap decides: runs from some gaps end in a limit cycle, and runs from others
    settle."""
    found = cycles(LIGHT_ARM, BELOW)
    both = found.any(axis=1) & ~found.all(axis=1)
    return stated(bool(both.any()), "depends", f"at {both.sum()} of {len(BELOW)} gains")


def rigid_cycles() -> int:
    """Returns the number of runs of the rigid robot with contact that end in a limit cycle. The
    gains are up to 95 % of the critical gain of the sampled linear loop, and the initial gaps up to
    20 mm. The runs take 60 s, because the contact is lost many times before it lasts."""
    loop = loops.force_loop("fig2_40")
    largest = loop.firmware_gain(loop.limit().gain or math.inf)
    found = verdicts(
        "rigid_discontinuous",
        [
            [f"firmware.force_gain={part * largest:.4f}", f"approach={gap}", *RIGID_RUN]
            for part in (0.5, 0.8, 0.95)
            for gap in GAPS[::2]
        ],
    )
    return found.count("unstable")


def bits_ratio() -> float:
    """Returns the highest gain with a stable contact at a force set-point of 15 counts with 8-bit
    converters, divided by the highest gain with 12-bit converters."""
    highest = []
    fine = ["experiment.model=../models/laboratory_12bit.toml", "firmware.adc_bits=12"]
    for sets in ([], fine):
        gains = range(5, 13)
        found = verdicts(
            "contact",
            [
                [f"firmware.force_gain={gain}", "firmware.force_setpoint=15", *sets]
                for gain in gains
            ],
        )
        highest.append(max(g for g, one in zip(gains, found, strict=True) if one == "stable"))
    return highest[0] / highest[1]


def beam_error_percent(output: str) -> float:
    """Returns the largest error in per cent of a beam response that is computed from the poles and
    zeros of four modes of vibration, up to the frequency of the fourth mode. `output`: the actuator
    or the tip."""
    return 100 * figures.BEAM.approximation_error(4, output)


ARM_DAMPING = "the arm's damping of Fig 4.26, 640 N s/m, takes the rest; 60 N s/m leave 176 or more"
PHASE_OF_A_MODE = (
    "the printed masses put the zeros, 12 and 40 Hz, below the poles, so that lead comes first"
)

CLAIMS = [
    Claim(
        "2.2.2, Fig 2.4", "rigid robot: gain at frequency 0", 1, "",
        lambda: float(abs(response("fig2_3", "reading", 1e-4, drive=False))) , 0.001,
    ),
    Claim(
        "2.2.2, Fig 2.4", "rigid robot: natural frequency over sqrt(k_s / m_r)", 1, "",
        lambda: 2 * math.pi * pole("fig2_3", 4.6, drive=False)[0]
        / math.sqrt(parameter("fig2_3", "k_s") / parameter("fig2_3", "m_r")), 0.001,
    ),
    Claim(
        "2.2.2, Fig 2.4", "rigid robot: amplitude and phase above its natural frequency",
        "both fall", "", rolls_off,
    ),
    Claim(
        "2.2.2, Fig 2.5", "rigid robot: real part of the roots at k_f = 100 over that at 0", 1, "",
        lambda: float(rigid_roots(100.0)[0].real / rigid_roots(0.0)[0].real), 1e-6,
    ),
    Claim(
        "2.2.2, Fig 2.5", "rigid robot, perfect actuator", STABLE, "",
        lambda: stability("fig2_3"),
    ),
    Claim(
        "2.2.3", "rigid robot: stiffness at k_f = 10 over that at 0, 1 + k_f", 11, "",
        lambda: stiffness_ratio(10.0), 1e-6,
    ),
    Claim(
        "2.2.3", "rigid robot: roots with fed back force and with fed back joint position",
        "equal", "",
        lambda: "equal" if np.allclose(rigid_roots(10.0), rigid_roots(10.0, "robot.position"))
        else "different",
    ),
    Claim(
        "2.3.4, Fig 2.10", "rigid robot, simple actuator", UNSTABLE, "",
        lambda: stability("fig2_8"),
    ),
    Claim(
        "2.4.2, Fig 2.4", "rigid robot, perfect actuator: phase", "never past -180 deg", "",
        lambda: passed_180("fig2_3", drive=False),
    ),
    Claim(
        "2.4.2, Fig 2.12", "flexible robot: phase", "past -180 deg", "",
        lambda: passed_180("fig2_11", drive=False),
    ),
    Claim("2.4.2, Fig 2.13", "flexible robot", UNSTABLE, "", lambda: stability("fig2_11")),
    Claim(
        "2.4.2, Fig 2.14", "endpoint against actuator above the arm's mode", "out of phase", "",
        lambda: stated(opposite_deg() > 90, "out of phase", f"by {opposite_deg():.3g} deg"),
    ),
    Claim(
        "2.4.2", "endpoint against actuator: completely out of phase", 180, "deg",
        opposite_deg, 0.1, ARM_DAMPING,
    ),
    Claim(
        "2.4.2", "base A, hardly damped: a colocated mode is no guarantee", BETWEEN, "",
        lambda: stability("fig2_16a", **LIGHT_BASE),
    ),
    Claim(
        "2.4.2", "flexible robot, joint position fed back: limit over that of the force",
        "higher", "",
        lambda: stated(
            loops.force_loop("fig2_11", timing="continuous", output="robot.position")
            .limit().gain is None and limit("fig2_11").gain is not None, "higher", "no limit"
        ),
    ),
    Claim(
        "2.4.2", "rigid robot, simple actuator, joint position fed back", UNSTABLE, "",
        lambda: UNSTABLE
        if loops.force_loop("fig2_8", timing="continuous", output="robot.position").limit().gain
        else STABLE,
    ),
    Claim(
        "2.4.3", "lowest mode of the whole machine", 12, "Hz",
        lambda: resonances_hz("fig4_14")[0],
    ),
    Claim(
        "2.4.3, Fig 2.15", "base mode, robot carried along by its drive, free", 12, "Hz",
        lambda: pole("fig4_17", 12, free=True)[0],
    ),
    Claim(
        "2.4.3, Fig 2.17", "base A, hardly damped: phase at its mode", "lag, then lead", "",
        lambda: turns("fig2_16a", "fig2_3", **LIGHT_BASE),
    ),
    Claim(
        "2.4.3, Fig 2.19", "base B, hardly damped: phase at its mode", "lag, then lead", "",
        lambda: turns("fig2_16b", "fig2_3", **LIGHT_BASE), why=PHASE_OF_A_MODE,
    ),
    Claim(
        "2.4.3, Fig 2.18", "base A: its poles and zeros", "near", "",
        lambda: near("fig2_16a", 13.4, 13.4),
    ),
    Claim(
        "2.4.3, Fig 2.20", "base B: its poles and zeros", "near", "",
        lambda: near("fig2_16b", 13.6, 12.0),
    ),
    Claim(
        "2.4.3", "base A: damping ratios of its poles and zeros with b_b", "rise", "",
        lambda: rising(base_damping_ratios()),
    ),
    Claim(
        "2.4.3", "base A: lag at its mode with b_b = 2000, 9500, 38000", "falls", "",
        lambda: stated(
            bool((np.diff(base_lags_deg()) < 0).all()), "falls",
            ", ".join(f"{lag:.2g}" for lag in base_lags_deg()) + " deg",
        ),
    ),
    Claim("2.4.3, Fig 2.18", "base A", STABLE, "", lambda: stability("fig2_16a")),
    Claim("2.4.3, Fig 2.20", "base B", STABLE, "", lambda: stability("fig2_16b")),
    Claim(
        "2.4.3", "base B, hardly damped", STABLE, "",
        lambda: stability("fig2_16b", **LIGHT_BASE),
    ),
    Claim(
        "2.4.3", "crossover with the base over that with the flexible arm, with motor", "higher",
        "", lambda: compared(crossing_ratio("fig4_17", "fig4_15"), "higher"),
    ),
    Claim(
        "2.4.3", "base B, hardly damped: lag with motor against that with a perfect actuator",
        "more", "", base_lag_ratio,
    ),
    Claim(
        "2.4.3", "mode of base A and of base B", "colocated", "",
        lambda: " and ".join(dict.fromkeys(label(m, 2) for m in ("fig2_16a", "fig2_16b"))),
    ),
    Claim(
        "2.4.4, Fig 2.23", "distributed beam, actuator: poles and zeros on the imaginary axis",
        "alternate", "", alternates,
    ),
    Claim(
        "2.4.4, Fig 2.23", "distributed beam, tip: real zeros through the fourth pair", "all", "",
        real_tip_zeros,
    ),
    Claim(
        "2.4.4, Fig 2.22", "distributed beam, tip: phase that its zeros add", "none", "",
        tip_zeros_phase,
    ),
    Claim(
        "2.4.4", "distributed beam, tip: amplitude at the fourth mode over that without zeros",
        "higher", "", lambda: compared(tip_zeros_gain(), "higher"),
    ),
    Claim(
        "2.4.4", "distributed beam: error of four modes as a polynomial, through the fourth", 0,
        "%", lambda: beam_error_percent("actuator"), 0.0,
        "poles and zeros are exact, but the modes above the fourth add to the response between "
        "them; eight modes leave 1.2 %",
    ),
    Claim(
        "2.4.4", "distributed beam, tip: error of four modes as a polynomial, through the fourth",
        0, "%", lambda: beam_error_percent("tip"), 0.0,
        "as at the actuator; eight modes leave 14 %, 24 modes .6 %",
    ),
    Claim(
        "2.4.4", "lumped-mass models of Chapter 2: zeros in the right half-plane", 0, "",
        right_half_plane_zeros, 0.0,
    ),
    Claim(
        "2.4.4, Fig 2.25", "lumped bending beam, actuator: zeros in the right half-plane", 0, "",
        lambda: int(np.sum(lumped_beam_zeros("actuator").real > 1e-6)), 0.0,
    ),
    Claim(
        "2.4.4, Fig 2.25", "lumped bending beam, tip: real zeros", "one pair of equal size", "",
        lumped_tip,
    ),
    Claim("2.5.1, Fig 2.28", "dynamic workpiece", STABLE, "", lambda: stability("fig2_26")),
    Claim(
        "2.5.1", "dynamic workpiece, four times stiffer", STABLE, "",
        lambda: stability("fig2_26", k_w=4 * parameter("fig2_26", "k_w")),
        why="with b_w as printed its damping ratio is .0012 and the roots are unstable from k_f = "
        "244 to 767; with b_w x 4, as in Fig 4.21, at no gain",
    ),
    Claim(
        "2.5.1", "workpiece, rigid robot: poles and zeros that it adds", "2 and 2", "",
        lambda: added("fig2_26", "fig2_3"),
    ),
    Claim(
        "2.5.1, Fig 2.27", "workpiece: phase at its mode", "lag, then lead", "",
        lambda: turns("fig2_26", "fig2_3"), why=PHASE_OF_A_MODE,
    ),
    Claim(
        "2.5.1", "workpiece: damping ratio of its poles, b_w = 363 over 8.25", "more", "",
        workpiece_damping_rises,
    ),
    Claim(
        "2.5.1", "workpiece: distance of its poles from its zeros, b_w = 8.25 and 363", "nearer",
        "", workpiece_spacings,
        why="the poles stay at sqrt(1 + k_s / k_w) = 1.13 times the frequency of the zeros; "
        "damping only spreads what they do to the phase",
    ),
    Claim(
        "2.5.1", "workpiece four times stiffer: frequency of its poles", "higher", "",
        lambda: compared(
            pole("fig2_26", 82.0, {"k_w": 4 * parameter("fig2_26", "k_w")}, drive=False)[0]
            / pole("fig2_26", 45.0, drive=False)[0], "higher",
        ),
    ),
    Claim(
        "2.5.1", "workpiece four times stiffer: real part of its poles over that of the original",
        1, "", real_part_ratio,
    ),
    Claim("2.5.1", "mode of the workpiece", "colocated", "", lambda: label("fig2_26", 2)),
    Claim(
        "2.5.2, Fig 2.30", "workpiece, flexible robot: poles and zeros that it adds", "2 and 2", "",
        lambda: added("fig2_29", "fig2_11"),
    ),
    Claim(
        "2.5.2, Fig 2.30", "workpiece, flexible robot", UNSTABLE, "", lambda: stability("fig2_29")
    ),
    Claim(
        "2.5.2", "workpiece far above the flexible robot's crossing: crossing over that without", 1,
        "", lambda: crossing_ratio("fig2_29", "fig2_11", **stiffer(4)),
    ),
    Claim(
        "2.5.2", "workpiece far below the flexible robot's crossing: crossing over that without", 1,
        "", lambda: crossing_ratio("fig2_29", "fig2_11", **stiffer(1 / 16)), 0.05,
        "a wall holds the tip by the sensor's spring, a workpiece that soft does not: even as a "
        "free mass of 6.6 kg it moves the crossing to 1.33 times",
    ),
    Claim(
        "2.5.2, Fig 2.31", "workpiece in the flexible robot's crossing: limit over that without",
        "higher", "", lambda: limit_ratio("fig2_29", "fig2_31", "fig2_11"),
    ),
    Claim(
        "2.5.2, Fig 2.31", "workpiece in the flexible robot's crossing: frequency of the crossing",
        "higher", "",
        lambda: compared(crossing_ratio("fig2_29", "fig2_11", **settings("fig2_31")), "higher"),
    ),
    Claim(
        "2.5.3, Fig 2.33", "workpiece, simple actuator: poles and zeros that it adds", "2 and 2",
        "", lambda: added("fig2_32", "fig2_8"),
    ),
    Claim(
        "2.5.3", "workpiece far above the actuator's crossing: crossing over that without", 1, "",
        lambda: crossing_ratio("fig2_32", "fig2_8", **stiffer(4)),
    ),
    Claim(
        "2.5.3", "workpiece far below the actuator's crossing: crossing over that without", 1, "",
        lambda: crossing_ratio("fig2_32", "fig2_8", **stiffer(1 / 16)),
    ),
    Claim(
        "2.5.3, Fig 2.34", "workpiece in the actuator's crossing: limit over that without",
        "higher", "", lambda: limit_ratio("fig2_32", "fig2_34", "fig2_8"),
    ),
    Claim(
        "2.5.3, Fig 2.34", "workpiece in the actuator's crossing: frequency of the crossing",
        "higher", "",
        lambda: compared(crossing_ratio("fig2_32", "fig2_8", **settings("fig2_34")), "higher"),
    ),
    Claim("2.6", "workpiece, simple actuator", UNSTABLE, "", lambda: stability("fig2_32")),
    Claim(
        "2.6", "weakest damper of the model with grip", "grip", "", dampers,
        why="Fig 4.26 prints b_g = 30 above b_s = 16.5 and b_w = 8.25; 5.1.3 calls b_g high for "
        "its stiffness",
    ),
    Claim("2.6, Fig 2.37", "grip, perfect actuator", STABLE, "", lambda: stability("fig2_35")),
    Claim(
        "2.6, Fig 2.37", "stiff grip, perfect actuator", STABLE, "",
        lambda: stability("fig2_35", **STIFF_GRIP),
        why="at huge gains alone, k_f from 4750 to 131,000, where the sensor's mass rings",
    ),
    Claim(
        "2.6, Fig 2.39", "grip, simple actuator", UNSTABLE, "",
        lambda: stability("fig2_35_coupled"),
    ),
    Claim(
        "2.6, Fig 2.39", "stiff grip, simple actuator", UNSTABLE, "",
        lambda: stability("fig2_35_coupled", **STIFF_GRIP),
    ),
    Claim(
        "2.6", "stiff grip, simple actuator: limit over that without grip", 1, "",
        lambda: critical_gain("fig2_35_coupled", **STIFF_GRIP) / critical_gain("fig2_32"),
    ),
    Claim(
        "2.6", "stiff grip: poles and zeros that it adds", "near", "",
        lambda: near("fig2_35_coupled", 1366.0, 1359.0, **STIFF_GRIP),
    ),
    Claim(
        "2.6", "soft grip: poles and zeros that it adds", "apart", "",
        lambda: near("fig2_35_coupled", 156.0, 68.0),
    ),
    Claim(
        "2.6", "soft grip: poles of the workpiece over those of the workpiece by itself", 1, "",
        lambda: pole("fig2_35_coupled", 41.0)[0] / pole("fig4_19", 39.8, free=True)[0],
    ),
    Claim(
        "2.7", "converters of 8 bits: highest stable gain in contact over that with 12 bits", 1, "",
        bits_ratio, 0.1,
    ),
    Claim(
        "2.7", "sampling at twice the crossing, half of the limit in continuous time", "unstable",
        "", slow_sampling,
    ),
    Claim(
        "2.7", "sampling at five times the crossing: limit over that in continuous time", 1, "",
        lambda: sampled_part("fig4_11", 5), 0.2,
        "the hold of a tick that long takes 59 % of the gain: stable, but not as fast",
    ),
    Claim(
        "2.7", "sampling at ten times the crossing: limit over that in continuous time", 1, "",
        lambda: sampled_part("fig4_11", 10), 0.2,
        "the hold still takes 43 % of the gain; the laboratory's 1500 Hz take 15 %",
    ),
    Claim(
        "2.7", "Coulomb friction of 5 N, gain 1.1 of the linear limit", "stable", "",
        lambda: verdict("nl_friction"),
    ),
    Claim(
        "2.7", "no Coulomb friction, gain 1.1 of the linear limit", "unstable", "",
        lambda: verdict("nl_friction_none_unstable"),
    ),
    Claim(
        "2.7", "force loop with a stiction of three times the friction", "unstable", "",
        lambda: verdict("nl_stiction_unstable"),
    ),
    Claim(
        "2.7", "force loop with the friction alone", "stable", "",
        lambda: verdict("nl_stiction_none"),
    ),
    Claim(
        "2.7.1, Fig 2.41", "rigid robot that can lose contact: runs in a limit cycle", 0, "",
        rigid_cycles, 0.0,
    ),
    Claim(
        "2.7.1, Fig 2.43",
        "flexible robot that can lose contact, above the linear limit: runs that settle", 0, "",
        lambda: int((~cycles(LIGHT_ARM, ABOVE)).sum()), 0.0,
    ),
    Claim(
        "2.7.1, Fig 2.43", "below the linear limit, arm lightly damped: limit cycles", "some", "",
        lambda: some_cycle(LIGHT_ARM),
    ),
    Claim(
        "2.7.1", "below the linear limit, damping of Fig 4.26: limit cycles", "some", "",
        lambda: some_cycle(PRINTED_ARM),
        why="the thesis names no parameters; an arm with the damping ratio .1 of Fig 4.26 loses "
        "the energy of each impact, so that the linear limit decides, one with .009 does not",
    ),
    Claim(
        "2.7.1, Fig 2.43", "far below the linear limit, arm lightly damped: limit cycles", 0, "",
        lambda: int(cycles(LIGHT_ARM, FAR_BELOW).sum()), 0.0,
    ),
    Claim(
        "2.7.1", "below the linear limit, arm lightly damped: the outcome and the start", "depends",
        "", depends_on_start,
    ),
]  # fmt: skip
