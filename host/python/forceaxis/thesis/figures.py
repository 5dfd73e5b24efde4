"""The Bode plots, root loci and pole-zero arrays of the thesis. The functions draw these plots from
models."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from forceaxis import linear
from forceaxis.identify import resonance
from forceaxis.identify.setup import read_setup
from forceaxis.linear import beam, curves, locus, loops, plots
from forceaxis.linear.system import System

Response = NDArray[np.complex128]
Settings = dict[str, float]  # {model parameter: value}
Run = tuple[str, str, Settings | None]  # (model, label of the curve, parameter values)
Data = list[curves.Curve] | list[locus.Locus] | list[locus.Array]
Source = Callable[[], Data]
# keyword arguments of a drawing function, as {name: value}
Options = Mapping[str, str | float | tuple[float, float]]

# Input and output of each frequency response that the figures show.
# VOLTAGE is the response from command voltage to measured force.
# FORCE is the response from the force of a perfect actuator to measured force.
# TACH is the response from command voltage to tachometer voltage.
VOLTAGE = curves.Channel()
FORCE = curves.Channel(drive=False)
TACH = curves.Channel(output="drive.tach")

# {kind of a plot: function that draws it}
DRAWINGS: dict[str, Callable[..., Figure]] = {
    "bode": plots.bode,
    "rlocus": plots.rlocus,
    "poles": plots.pole_zero,
}


@dataclass(frozen=True)
class ThesisFigure:
    """One plot of the thesis (Bode plot, root locus or pole-zero array) that is drawn from
    models."""

    figure: str  # number of the figure in the thesis
    kind: str  # kind of the plot, a key of DRAWINGS
    title: str
    see: str  # text about what the reader sees in the plot
    data: Source  # function that computes the data of the plot for the drawing function
    # further arguments of the function that draws the plot
    options: Options = field(default_factory=dict)

    def draw(self, data: Data | None = None) -> Figure:
        """Draws the plot. `data`: result of the method data(), if it is already computed."""
        title = f"Fig {self.figure}: {self.title}"
        return DRAWINGS[self.kind](self.data() if data is None else data, title, **self.options)


def responses(
    *runs: Run,
    span_hz: tuple[float, float] = (0.5, 200.0),
    channel: curves.Channel = VOLTAGE,
) -> list[curves.Curve]:
    """Returns one frequency response for each of `runs`. `channel`: input and output of the
    frequency response."""
    return [
        curves.model_curve(m, label, replace(channel, overrides=settings or {}), span_hz)
        for m, label, settings in runs
    ]


def outputs(model: str, names: dict[str, str], channel: curves.Channel) -> list[curves.Curve]:
    """Returns the frequency responses of one model to several outputs. `names`: {output: label of
    its curve}."""
    return [
        curves.model_curve(model, label, replace(channel, output=output), (0.5, 200.0))
        for output, label in names.items()
    ]


def loci(*runs: Run, span_hz: float | None = None) -> list[locus.Locus]:
    """Returns one root locus for each of `runs`. The force loops are in continuous time."""
    found = [loops.force_loop(m, timing="continuous", overrides=s) for m, _, s in runs]
    return locus.loci(found, [label for _, label, _ in runs], span_hz)


def damped(model: str, parameter: str, values: Sequence[float], unit: str) -> list[Run]:
    """Returns several variants of one model for a plot. They have different values of the parameter
    `parameter`, in the unit `unit`."""
    return [(model, f"{parameter} = {value:g} {unit}", {parameter: value}) for value in values]


# Beam with example values: mass 17.9 kg, first bending mode at 103 Hz.
BEAM = beam.Beam(3.0e4, 35.8, 0.5)
LUMPED = beam.LumpedBeam.figure_2_24(3.0e4, 0.4, 9.0, 8.9, 0.05, 0.1)
ARM = beam.TwoLinkArm()


def beam_curves() -> list[curves.Curve]:
    """Returns the curves of Fig 2.22. They are the exact velocity responses of a
    distributed-parameter beam, at its actuator and at its tip."""
    natural = BEAM.natural_frequencies(4)
    roots = np.concatenate([BEAM.poles(4), BEAM.actuator_zeros(4)])
    # The poles and zeros of the undamped beam get the damping ratio 0.001 in the plot.
    roots = roots - 1e-3 * np.abs(roots)
    frequency = curves.grid_hz(
        0.05 * natural[0] / (2 * np.pi), 1.35 * natural[3] / (2 * np.pi), roots, 800
    )
    s = 2j * np.pi * frequency * (1 - 1e-3j)
    return [
        curves.Curve("actuator (colocated)", frequency, BEAM.actuator(s), "(m/s)/N"),
        curves.Curve("tip (noncolocated)", frequency, BEAM.tip(s), "(m/s)/N"),
    ]


def beam_arrays() -> list[locus.Array]:
    """Returns the arrays of Fig 2.23. They are the poles and zeros of a distributed-parameter beam
    up to its fourth bending mode, at its actuator and at its tip."""
    poles = BEAM.poles(4)
    return [
        locus.Array("actuator (colocated)", poles, BEAM.actuator_zeros(4)),
        locus.Array("tip (noncolocated)", poles, BEAM.tip_zeros(4)),
    ]


def arrays(system: System, names: dict[str, str], input: str | None = None) -> list[locus.Array]:
    """Returns one pole-zero array for each output of a system. `names`: {output: label of its
    array}."""
    inputs = (input,) if input else None
    return [locus.array(system.select(inputs, (o,)), label) for o, label in names.items()]


def measured(*runs: Run) -> list[curves.Curve]:
    """Returns the frequency responses that the models predict for the measurements in thesis
    section 3.2.

    runs: (file name in sim/measurements without suffix, label, parameter values or None).
    """
    found = []
    for stem, label, settings in runs:
        setup, _ = read_setup(stem, {"set": settings})
        names = (setup.input or "drive.command", setup.output)
        system = linear.linearise(
            setup.model, ("drive.command",), names, setup.set, free=setup.free
        )
        frequency = curves.grid_hz(*setup.band_hz, system.poles())
        x, y = system.response(frequency).reshape(len(frequency), 2).T
        ratio = np.asarray(setup.scale * y / x, np.complex128)
        unit = setup.unit or curves.unit_of(setup.model, names[0], names[1])
        found.append(curves.Curve(label, frequency, ratio, "" if unit == "V/V" else unit))
    return found


def fitted_resonances() -> tuple[NDArray[np.float64], Response, System, resonance.Fit]:
    """Returns the data of Fig 4.14 without contact: (frequencies in Hz, tip acceleration, system of
    the rigid body, resonance model of thesis section 4.2 that is fitted to them)."""
    frequency = np.geomspace(1, 200, 1500)
    tip = linear.linearise("fig4_14", outputs=("tip.acceleration",), free=True)
    rigid = linear.linearise("fig4_11", outputs=("robot.acceleration",), free=True)
    data = tip.response(frequency)
    return frequency, data, rigid, resonance.fit(frequency, data, rigid.response(frequency))


def resonance_curves() -> list[curves.Curve]:
    """Returns the curves of Fig 4.8. They are the frequency response of the lumped-parameter model,
    and the frequency response of the polynomial model that is fitted to it."""
    frequency, data, rigid, fit = fitted_resonances()
    unit = curves.unit_of("fig4_14", "drive.command", "tip.acceleration")
    model = fit.response(frequency, rigid.response(frequency))
    return [
        curves.Curve("lumped model of Fig 4.14, apart", frequency, data, unit),
        curves.Curve("rigid body times resonances", frequency, model, unit),
    ]


def resonance_array() -> list[locus.Array]:
    """Returns the array of Fig 4.9. It has the poles and zeros of the polynomial model that is
    fitted to the lumped-parameter model."""
    _, _, rigid, fit = fitted_resonances()
    own = locus.array(rigid)
    zeros, poles, _ = fit.cascade().zpk()
    return [locus.Array("", np.append(own.poles, poles), np.append(own.zeros, zeros))]


def three_problems() -> list[curves.Curve]:
    """Returns the curves of Fig 6.1. They are two force responses on a rigid workpiece: of the
    robot with base and arm, and of the rigid axis with its actuator."""
    hard = {"k_g": 1e8, "k_w": 4e8, "b_b": 1500.0, "b_rf": 200.0}
    return [
        curves.model_curve(
            "fig4_14", "with base and arm", curves.Channel(overrides=hard), (1, 100)
        ),
        curves.model_curve("fig4_11", "rigid axis and actuator", span_hz=(1, 100)),
    ]


def thesis_figures() -> list[ThesisFigure]:
    """Returns all Bode plots, root loci and pole-zero arrays that the text of the thesis
    defines."""
    both = {"robot.position": "actuator x_r1", "tip.position": "endpoint x_r2"}
    base = (2000.0, 9500.0, 38000.0)
    work = (("fig2_26", "b_w = 8.25", None), ("fig2_26", "b_w = 363", {"b_w": 363.0}),
            ("fig2_26", "k_w x 4", {"k_w": 1650800.0}))  # fmt: skip
    grips = (("fig2_35", "soft, 25 kN/m", None), ("fig2_35", "stiff, 10 MN/m", {"k_g": 1e7}))
    coupled = tuple(("fig2_35_coupled", label, settings) for _, label, settings in grips)
    sensed = {"ylabel": "F_s / F_a"}
    volts = {"ylabel": "F_s / V_cmd"}
    phase: Options = {"phase_only": True, "size": (5.6, 2.8)}
    return [
        ThesisFigure("2.4", "bode", "rigid robot", "1 at 0 Hz; amplitude and phase roll off",
                     partial(responses, ("fig2_3", "F_s / F_a", None), channel=FORCE), sensed),
        ThesisFigure("2.5", "rlocus", "rigid robot", "straight up: stable at every gain",
                     partial(loci, ("fig2_3", "", None), span_hz=15)),
        ThesisFigure("2.9", "bode", "rigid robot, simple actuator", "the actuator's lag",
                     partial(responses, ("fig2_8", "", None)), volts),
        ThesisFigure("2.10", "rlocus", "rigid robot, simple actuator", "now unstable at high gain",
                     partial(loci, ("fig2_8", "", None))),
        ThesisFigure("2.12", "bode", "link flexibility", "the phase drops below -180 degrees",
                     partial(responses, ("fig2_11", "F_s / F_a", None), channel=FORCE), sensed),
        ThesisFigure("2.13", "rlocus", "link flexibility", "roots cross into the right half",
                     partial(loci, ("fig2_11", "", None))),
        ThesisFigure("2.14", "bode", "link flexibility, actuator and endpoint",
                     "above the arm's mode the two move opposite",
                     partial(outputs, "fig2_11", both, FORCE), phase),
        ThesisFigure("2.17", "bode", "base A", "a sharp lag and lead; damping spreads it",
                     partial(responses, *damped("fig2_16a", "b_b", base, "N s/m"), channel=FORCE),
                             sensed),
        ThesisFigure("2.18", "rlocus", "base A",
                     "colocated: poles beside zeros; 2000: unstable between two gains",
                     partial(loci, *damped("fig2_16a", "b_b", base, "N s/m"), span_hz=20)),
        ThesisFigure("2.19", "bode", "base B", "the workpiece on the base: less lag",
                     partial(responses, *damped("fig2_16b", "b_b", base, "N s/m"), channel=FORCE),
                             sensed),
        ThesisFigure("2.20", "rlocus", "base B", "poles beside zeros, colocated",
                     partial(loci, *damped("fig2_16b", "b_b", base, "N s/m"), span_hz=20)),
        ThesisFigure("2.22", "bode", "distributed beam", "colocated: zeros between the poles",
                     beam_curves, {"ylabel": "v / F_a"}),
        ThesisFigure("2.23", "poles", "distributed beam through its fourth mode",
                     "colocated: alternating; tip: zeros in real +- pairs", beam_arrays),
        ThesisFigure("2.25", "poles", "lumped bending beam", "tip: one real +- pair of zeros",
                     partial(arrays, LUMPED.system(), {"actuator": "actuator (colocated)",
                                                       "tip": "tip (noncolocated)"})),
        ThesisFigure("2.27", "bode", "workpiece", "a lead of the phase; less with damping",
                     partial(responses, *work, channel=FORCE), sensed),
        ThesisFigure("2.28", "rlocus", "workpiece",
                     "no gain limit; stiffer, hardly damped: unstable between two gains",
                     partial(loci, *work, span_hz=100)),
        ThesisFigure("2.30", "rlocus", "workpiece and link flexibility", "the arm still limits",
                     partial(loci, ("fig2_29", "", None))),
        ThesisFigure("2.31", "rlocus", "workpiece mode at the arm's crossover",
                     "its zeros hold the roots back: a higher limit",
                     partial(loci, ("fig2_29", "k_w = 412700", None),
                          ("fig2_29", "k_w = 300000, b_w = 363",
                           {"k_w": 300000.0, "b_w": 363.0}))),
        ThesisFigure("2.33", "rlocus", "workpiece and simple actuator", "poles and zeros in pairs",
                     partial(loci, ("fig2_32", "", None))),
        ThesisFigure("2.34", "rlocus", "damped workpiece at the crossover",
                     "its zeros hold the roots back: a higher limit",
                     partial(loci, ("fig2_32", "b_w = 363", {"b_w": 363.0}))),
        ThesisFigure("2.36", "bode", "grip, perfect actuator", "a soft grip parts zeros and poles",
                     partial(responses, *grips, channel=FORCE), sensed),
        ThesisFigure("2.37", "rlocus", "grip, perfect actuator", "colocated: only huge gains cross",
                     partial(loci, *grips, span_hz=200)),
        ThesisFigure("2.38", "bode", "grip, simple actuator", "the actuator's lag is added",
                     partial(responses, *coupled), volts),
        ThesisFigure("2.39", "rlocus", "grip, simple actuator",
                     "soft: the limit moves to the sensor's mode",
                     partial(loci, *coupled, span_hz=200)),
        ThesisFigure("3.6", "bode", "preamplifier, command to current command (model)", "flat",
                     partial(measured, ("fig3_6", "", None)), {"ylabel": "V_ic / V_cmd"}),
        ThesisFigure("3.7", "bode", "preamplifier, tachometer to current command (model)",
                     "inverting, first order at 150 Hz", partial(measured, ("fig3_7", "", None)),
                     {"ylabel": "V_ic / V_tach"}),
        ThesisFigure("3.8", "bode", "current loop, shaft locked (model)",
                     "measured: 1 up to 2000 Hz, which wants k_amp = 582",
                     partial(measured, ("fig3_8", "k_amp = 582", None),
                              ("fig3_8", "k_amp = 15", {"k_amp": 15})),
                     {"ylabel": "V_if / V_ic"}),
        ThesisFigure("3.9", "bode", "motor velocity, no load (model)",
                     "measured: .85 at DC, 46 Hz",
                     partial(measured, ("fig3_9", "k_amp = 582", None),
                              ("fig3_9", "k_amp = 15", {"k_amp": 15})),
                     {"ylabel": "V_tach / V_cmd"}),
        ThesisFigure("3.10", "bode", "motor acceleration, apart (model)",
                     "colocated: each mode's zeros before its poles",
                     partial(measured, ("fig3_10", "", None)), {"ylabel": "acceleration / V_cmd"}),
        ThesisFigure("3.11", "bode", "tip acceleration, apart (model)",
                     "noncolocated: the phase falls by 180 degrees at the arm's mode",
                     partial(measured, ("fig3_11", "tip", None),
                             ("fig3_10", "motor (Fig 3.10)", None)),
                     {"ylabel": "acceleration / V_cmd"}),
        ThesisFigure("3.12", "bode", "contact force, clamped (model)", "poles moved by the contact",
                     partial(measured, ("fig3_12", "", None)), volts),
        ThesisFigure("4.6", "bode", "motor without load", "tachometer follows the command",
                     partial(responses, ("fig4_5", "", None), channel=TACH, span_hz=(0.5, 500)),
                     {"ylabel": "V_tach / V_cmd"}),
        ThesisFigure("4.8", "bode", "polynomial resonance model", "five steps fit the magnitude",
                     resonance_curves, {"ylabel": "acceleration / V_cmd"}),
        ThesisFigure("4.9", "poles", "polynomial resonance model",
                     "the rigid body's, and a pair of poles and of zeros for each resonance",
                     resonance_array, {"span_hz": 60}),
        ThesisFigure("4.12", "bode", "motor and rigid robot", "-180 degrees at 34 Hz",
                     partial(responses, ("fig4_11", "", None)), volts),
        ThesisFigure("4.13", "rlocus", "motor and rigid robot", "the motor alone limits the gain",
                     partial(loci, ("fig4_11", "", None))),
        ThesisFigure("4.16", "rlocus", "arm flexibility", "noncolocated: a lower limit",
                     partial(loci, ("fig4_15", "", None))),
        ThesisFigure("4.18", "rlocus", "base flexibility", "poles beside zeros at 12 Hz",
                     partial(loci, ("fig4_17", "", None))),
        ThesisFigure("4.20", "rlocus", "workpiece", "the workpiece's poles cross",
                     partial(loci, ("fig4_19", "", None), span_hz=70)),
        ThesisFigure("4.21", "rlocus", "workpiece four times stiffer",
                     "crosses where the rigid robot does",
                     partial(loci, ("fig4_21", "", None), span_hz=110)),
        ThesisFigure("4.22", "rlocus", "workpiece four times softer",
                     "its slower mode rings and crosses",
                     partial(loci, ("fig4_22", "", None), span_hz=70)),
        ThesisFigure("4.24", "rlocus", "stiff grip", "as without a grip",
                     partial(loci, ("fig4_24", "", None), span_hz=70)),
        ThesisFigure("4.25", "rlocus", "soft grip", "the sensor's mode limits, far out",
                     partial(loci, ("fig4_25", "", None), span_hz=200)),
        ThesisFigure("5.4", "rlocus", "original workpiece damping", "as Fig 4.20",
                     partial(loci, ("fig4_19", "b_w = 8.25", None), span_hz=70)),
        ThesisFigure("5.5", "rlocus", "workpiece damping x 20", "crosses at a higher gain",
                     partial(loci, ("fig5_5", "b_w = 165", None), span_hz=70)),
        ThesisFigure("6.1", "bode", "three dynamic problems", "actuator lag, a colocated mode's "
                     "dip at 12 Hz, 180 degrees lost at the arm's mode", three_problems, phase),
        ThesisFigure("6.3", "poles", "two-link arm, torque 1", "endpoint: a zero on the right",
                     partial(arrays, ARM.system(), {"joint1": "joint 1", "normal": "endpoint"},
                             "torque1")),
    ]  # fmt: skip
