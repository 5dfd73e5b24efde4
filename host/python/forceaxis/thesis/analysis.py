"""Values of the models of the thesis, which are compared with numbers and statements of the thesis.
They are critical gains, poles and zeros, phases, resonances, and verdicts of runs."""

import functools
import math
import os
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from forceaxis import _core, linear, paths, toml
from forceaxis.experiments.verdicts import stability as judged
from forceaxis.linear import loops, modes
from forceaxis.linear.stability import Limit
from forceaxis.thesis import tables

Response = NDArray[np.complex128]
Numbers = NDArray[np.float64]

STABLE, UNSTABLE = "stable at any gain", "unstable at high gain"
BETWEEN = "unstable between two gains"
# Largest damping ratio of a pole that counts as a resonance.
LIGHT = 0.3
# A pole counts as near a zero up to this distance, relative to the frequency of the pole.
NEAR = 0.2


@functools.cache
def limit(model: str, **overrides: float) -> Limit:
    """Returns the largest gain at which the force loop of a model is stable in continuous time."""
    return loops.force_loop(model, timing="continuous", overrides=overrides).limit()


def stability(model: str, **overrides: float) -> str:
    """Returns a text that states whether the linear model is stable at high gains in continuous
    time."""
    found = limit(model, **overrides)
    if found.gain is None:
        return STABLE
    return BETWEEN if found.stable_ranges[-1][1] is None else UNSTABLE


def critical_gain(model: str, **overrides: float) -> float:
    """Returns the critical gain of the force loop of a model in continuous time, or infinity if
    there is none."""
    gain = limit(model, **overrides).gain
    return math.inf if gain is None else gain


def crossing_hz(model: str, **overrides: float) -> float:
    """Returns the frequency in Hz at which the force loop of a model becomes unstable in continuous
    time, or infinity if the loop is stable at every gain."""
    frequency_hz = limit(model, **overrides).frequency_hz
    return math.inf if frequency_hz is None else frequency_hz


def settings(experiment: str) -> dict[str, float]:
    """Returns the parameter values that an experiment file sets, as {parameter: value}."""
    values: dict[str, float] = toml.read(paths.EXPERIMENTS / f"{experiment}.toml")["set"]
    return values


def parameter(model: str, name: str) -> float:
    """Returns the value that a model file has for one of its parameters."""
    return linear.facts(model).parameters[name].value


def printed(name: str) -> float:
    """Returns the value that the file sim/models/thesis.toml has for a parameter of the thesis."""
    return float(tables.parameters()[name].value)


def stiffer(factor: float) -> dict[str, float]:
    """Returns {parameter: value} for the stiffness and damping of the workpiece, each multiplied by
    a factor as in Figs 4.21 and 4.22."""
    return {"k_w": factor * printed("k_w"), "b_w": factor * printed("b_w")}


def nearest(roots: Response, near_hz: float) -> complex:
    """Returns the complex root above the real axis whose frequency is nearest to `near_hz`."""
    roots = roots[roots.imag > 0]
    return complex(roots[np.argmin(abs(abs(roots) / (2 * math.pi) - near_hz))])


def pole(
    model: str,
    near_hz: float,
    overrides: linear.Overrides | None = None,
    free: bool = False,
    drive: bool = True,
) -> tuple[float, float]:
    """Returns (natural frequency in Hz, damping ratio) of the pole of a model that is nearest to
    the frequency `near_hz`."""
    system = linear.linearise(model, outputs=(), overrides=overrides, free=free, drive=drive)
    found = nearest(system.poles(), near_hz)
    return abs(found) / (2 * math.pi), -found.real / abs(found)


def resonances_hz(
    model: str, overrides: linear.Overrides | None = None, drive: bool = True
) -> list[float]:
    """Returns the frequencies in Hz of the lightly damped pole pairs of a model without contact, in
    ascending order. Their damping ratio is below LIGHT. A pair at frequency 0 is not included."""
    system = linear.linearise(model, outputs=(), overrides=overrides, free=True, drive=drive)
    poles = system.poles()
    light = (poles.imag > 1.0) & (-poles.real < LIGHT * abs(poles))
    return sorted((abs(poles[light]) / (2 * math.pi)).tolist())


def spacing(model: str, pole_hz: float, zero_hz: float, **overrides: float) -> float:
    """Returns the distance between a pole and a zero of the force response, divided by the
    frequency of the pole. They are the pole nearest to `pole_hz` and the zero nearest to
    `zero_hz`."""
    system = linear.linearise(model, overrides=overrides)
    at = nearest(system.poles(), pole_hz)
    return abs(at - nearest(system.zeros(), zero_hz)) / abs(at)


def near(model: str, pole_hz: float, zero_hz: float, **overrides: float) -> str:
    """Returns a text that states whether a pole of the force response is near a zero."""
    part = spacing(model, pole_hz, zero_hz, **overrides)
    return ("near" if part < NEAR else "apart") + f": {100 * part:.2g} %"


def added(model: str, without: str, **overrides: float) -> str:
    """Returns a text about the numbers of poles and zeros that the force response of `model` has in
    addition to the poles and zeros of `without`."""
    more, less = linear.linearise(model, overrides=overrides), linear.linearise(without)
    poles = len(more.poles()) - len(less.poles())
    return f"{poles} and {len(more.zeros()) - len(less.zeros())}"


def excess(model: str) -> int:
    """Returns the number of poles of the force response minus the number of its zeros."""
    system = linear.linearise(model)
    return len(system.poles()) - len(system.zeros())


def response(
    model: str,
    output: str,
    frequency_hz: ArrayLike,
    overrides: linear.Overrides | None = None,
    free: bool = False,
    drive: bool = True,
) -> Response:
    """Returns the frequency response of a model from the command of the drive to one output.
    Without `drive`, it is the response from the force of a perfect actuator."""
    system = linear.linearise(model, outputs=(output,), overrides=overrides, free=free, drive=drive)
    return system.response(frequency_hz)


def phase_deg(found: Response) -> Numbers:
    """Returns the phase of a frequency response in degrees, without jumps of 360 degrees."""
    return np.degrees(np.unwrap(np.angle(found)))


def passed_180(model: str, drive: bool = True) -> str:
    """Returns a text that states whether the phase of the force response falls below -180 degrees
    at frequencies up to 500 Hz."""
    f = np.geomspace(0.1, 500.0, 20001)
    least = phase_deg(response(model, "reading", f, drive=drive)).min()
    word = "past" if least < -180 else "never past"
    return f"{word} -180 deg: {least:.4g} deg"


def added_phase_deg(
    model: str, without: str, drive: bool = True, span_hz: tuple[float, float] = (5.0, 400.0),
    **overrides: float,
) -> Numbers:  # fmt: skip
    """Returns the phase of the force response of `model` minus the phase for `without`, in degrees,
    at frequencies in the range `span_hz`."""
    f = np.geomspace(*span_hz, 20001)
    with_it = response(model, "reading", f, overrides=overrides, drive=drive)
    return phase_deg(with_it / response(without, "reading", f, drive=drive))


def turns(model: str, without: str, **overrides: float) -> str:
    """Returns a text that describes how a mode of vibration shifts the phase of the force response
    with a perfect actuator, such as "lag, then lead" or "lead". The text also has the largest lag
    and lead in degrees."""
    change = added_phase_deg(model, without, drive=False, span_hz=(8.0, 60.0), **overrides)
    found = {"lag": (-change.min(), change.argmin()), "lead": (change.max(), change.argmax())}
    largest = max(turn for turn, _ in found.values())
    # A phase change that is below a twentieth of the largest phase change is ignored.
    names = [name for name, (turn, _) in found.items() if turn > largest / 20]
    names.sort(key=lambda name: found[name][1])
    return f"{', then '.join(names)}: {', '.join(f'{found[name][0]:.3g} deg' for name in names)}"


def prominence_db(model: str, output: str, free: bool, span_hz: tuple[float, float]) -> float:
    """Returns the height in dB of the highest peak of a frequency response above its surroundings,
    between the two frequencies `span_hz`. Returns 0 if there is no peak."""
    f = np.geomspace(5.0, 200.0, 20001)
    size_db = 20 * np.log10(abs(response(model, output, f, free=free)))
    peaks, found = signal.find_peaks(size_db, prominence=0)
    inside = (f[peaks] > span_hz[0]) & (f[peaks] < span_hz[1])
    return float(found["prominences"][inside].max(initial=0.0))


def label(model: str, number: int) -> str:
    """Returns the label of a mode of vibration in contact: colocated or noncolocated. `number`:
    number of the mode from 1 on, in ascending order of frequency."""
    return modes.modes(model).modes[number - 1].label


def sampled_part(model: str, ticks: float) -> float:
    """Returns the critical gain of a sampled force loop divided by that of the loop in continuous
    time. The sampling rate is `ticks` times the crossover frequency of the loop in continuous
    time."""
    spec = loops.LoopSpec(timing="zoh", tick_s=1 / (ticks * crossing_hz(model)))
    found = spec.around(model).limit().gain
    return (math.inf if found is None else found) / critical_gain(model)


def crossing_root(model: str) -> str:
    """Returns a text about the branch of the root locus that first crosses the imaginary axis as
    the gain rises. It names the kind and frequency of the pole at which the branch starts:
    "workpiece" for a pole at about 40 to 45 Hz."""
    loop = loops.force_loop(model, timing="continuous")
    highest = critical_gain(model)
    branches = loop.locus(np.concatenate([[0.0], np.geomspace(1e-6, 1.0, 800) * highest]))
    start = branches[0, np.argmin(abs(branches[-1].real))]
    hz = abs(start) / (2 * math.pi)
    word = "workpiece" if start.imag and 38 < hz < 47 else "another"
    return f"{word}: {hz:.3g} Hz"


@functools.cache
def cells() -> list[tables.CellResult]:
    """Returns all cells of the stability tables of the thesis. Each cell has the verdict of its
    simulated run."""
    return tables.run().cells


def column(test: str, workpiece: str) -> list[tables.CellResult]:
    """Returns the cells of one column of the stability table in Fig 5.10 of the thesis."""
    return [c for c in cells() if (c.figure, c.test, c.workpiece) == ("5.10", test, workpiece)]


def highest_stable(test: str, workpiece: str) -> float:
    """Returns the highest gain with a stable simulated run in one column of the stability table in
    Fig 5.10 of the thesis."""
    return float(max(c.force_gain for c in column(test, workpiece) if c.ours == "stable"))


def matching(figure: str) -> int:
    """Returns the number of cells of a stability table whose run has the measured verdict."""
    return sum(c.agrees for c in cells() if c.figure == figure)


def cell(figure: str) -> str:
    """Returns the verdict of the simulated run for a stability table of the thesis with a single
    cell. `figure`: number of the figure with this table, such as 5.2."""
    return next(c.ours for c in cells() if c.figure == figure)


def verdicts(experiment: str, runs: Iterable[Sequence[str]]) -> list[str]:
    """Returns "stable" or "unstable" for each run of an experiment. `runs`: overrides of each
    run."""
    path = str(paths.EXPERIMENTS / f"{experiment}.toml")
    found = _core.run_many([(path, list(sets)) for sets in runs], os.cpu_count() or 1)
    return [judged(one["verdict"]) for one in found]


def verdict(experiment: str) -> str:
    """Returns "stable" or "unstable" for the run of an experiment without overrides."""
    return verdicts(experiment, [()])[0]
