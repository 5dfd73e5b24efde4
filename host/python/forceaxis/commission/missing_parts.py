"""Searches for what a rejected model lacks: fits candidates for the missing part and ranks them.

Each candidate multiplies the model's responses by a factor whose parameters are fitted together
with all others. The rank is the chi-square plus a penalty of ln n for each parameter (Schwarz, The
Annals of Statistics 6, 1978), where n is the number of real residuals. Each candidate states the
TOML to add to the model.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import optimize, stats

from forceaxis import linear, toml
from forceaxis.commission.joint_fit import JointFit, Response, Responses, Samples
from forceaxis.commission.known import Prior
from forceaxis.design import model_file
from forceaxis.identify.fit import REJECTED_BELOW

MODES_FROM = 10  # number of frequencies at which the search of a mode begins
SHOWN = 3  # candidates in a text
LAG_S = 4e-4  # initial value of a lag
GAIN = 0.2  # standard deviation of the logarithm of a gain that differs between forces
SPLIT = 1.05  # initial ratio of pole to zero of a mode
EVALUATIONS = 25

Values = dict[str, float]


@dataclass(frozen=True)
class Shape:
    """A candidate: factor(values, i, hz) of response i, the priors of its parameters, and
    words(values, best), which returns (description, TOML). A candidate with `freed` parameters of
    the model itself has no factor."""

    name: str
    priors: dict[str, Prior]
    factor: Callable[[Values, int, Samples], Any]
    words: Callable[[Values, Values], tuple[str, str]]
    freed: bool = False

    def key(self, name: str) -> str:
        """Name of a candidate's parameter in the fit."""
        return name if self.freed else f"{name}@shape"


@dataclass(frozen=True)
class Tried:
    """A fitted candidate. gain: decrease of the chi-square less the penalty; p: probability of the
    chi-square with the candidate."""

    name: str
    text: str
    toml: str
    gain: float
    p: float
    values: Values


def tried(problem: Responses, x: Samples) -> list[Tried]:
    """The candidates that decrease the chi-square by more than their penalty, best first.

    problem, x: the Responses of fit.joint and the parameters at which it was rejected.
    """
    scores = np.concatenate(problem.scores(x))
    before = float(np.sum(scores**2)) + float(np.sum(((x - problem.centre) / problem.spread) ** 2))
    found = []
    for shapes in _shapes(problem):
        begun = [_begun(problem, x, shape) for shape in shapes]
        one = _fitted(x, *min(begun, key=lambda pair: pair[2]), before, len(scores))
        if one.gain > 0:
            found.append(one)
    return sorted(found, key=lambda one: -one.gain)


def lines_of(found: list[Tried]) -> str:
    """The TOML of the best candidates, each below a comment that describes the candidate."""
    lines = []
    for number, one in enumerate(found[:SHOWN], 1):
        explains = "then" if one.p >= REJECTED_BELOW else "which is not all,"
        lines.append(f"# {number}. {one.text}, {explains} p = {one.p:.2g}\n{one.toml}")
    return "\n".join(lines)


def _begun(problem: Responses, x: Samples, shape: Shape) -> tuple[Shape, Responses, float, Samples]:
    """Fits the parameters of a Shape while all other parameters stay at x: (shape, problem with its
    parameters, cost, logarithms of its parameters)."""
    own = {shape.key(name): prior for name, prior in shape.priors.items()}

    class Shaped(Responses):
        def predictions(self, x: Samples) -> list[Response]:
            every = dict(zip(self.names, np.exp(x).tolist(), strict=True))
            values = {name: every[shape.key(name)] for name in shape.priors}
            return [
                h * shape.factor(values, i, m.frequency_hz)
                for i, (m, h) in enumerate(zip(self.measured, super().predictions(x), strict=True))
            ]

    wider = Shaped(
        problem.model, problem.priors | own, problem.measured, problem.modes, problem.own,
        problem.errors,
    )  # fmt: skip
    free, (low, high) = len(x), wider.bounds(1e-3)
    found = optimize.least_squares(
        lambda y: wider.coarse(np.concatenate([x, y])), wider.centre[free:], loss="soft_l1",
        bounds=(low[free:], high[free:]), x_scale=wider.spread[free:], max_nfev=EVALUATIONS,
    )  # fmt: skip
    return shape, wider, float(found.cost), found.x


def _fitted(
    x: Samples, shape: Shape, wider: Responses, _: float, y: Samples, before: float, size: int
) -> Tried:
    """Fits a Shape again, with all parameters free, from the result of _begun."""
    begin = np.clip(np.concatenate([x, y]), *wider.bounds(1e-3))
    best = optimize.least_squares(
        wider.fine, begin, bounds=wider.bounds(), x_scale=wider.spread, max_nfev=EVALUATIONS
    )
    scores = np.concatenate(wider.scores(best.x))
    chi2 = float(np.sum(scores**2))
    every = dict(zip(wider.names, np.exp(best.x).tolist(), strict=True))
    values = {name: every[shape.key(name)] for name in shape.priors}
    words, lines = shape.words(values, wider.values(best.x))
    gain = before - 2 * best.cost - len(values) * math.log(size)
    return Tried(shape.name, words, lines, gain, float(stats.chi2.sf(chi2, size)), values)


def _shapes(problem: Responses) -> list[list[Shape]]:
    """Kinds of candidates; for each kind the Shapes from which a fit begins."""
    return [
        [_sensor_lag(problem)],
        [_drive_lag(problem)],
        _modes(problem),
        *([[_gains(problem)]] if sum(not m.free for m in problem.measured) > 1 else []),
    ]


def _lag(values: Values, hz: Samples) -> Any:
    return 1 / (1 + 2j * np.pi * hz * values["lag_s"])


def _sensor_lag(problem: Responses) -> Shape:
    pressed = [not m.free for m in problem.measured]

    def words(values: Values, _: Values) -> tuple[str, str]:
        lag = values["lag_s"]
        lines = f'# in the [[adc]] of channel 0\nfilter = "{1 / lag:.4g} rad/s"'
        return f"a lag of {1e3 * lag:.2g} ms in the sensor", lines

    return Shape(
        "sensor_lag", {"lag_s": Prior(LAG_S, 1.2)},
        lambda v, i, hz: _lag(v, hz) if pressed[i] else 1.0, words,
    )  # fmt: skip


def _drive_lag(problem: Responses) -> Shape:
    """Candidate: the time constant of the drive's own lag (inductance of the winding or corner
    frequency of the force) if it is a parameter of the model, otherwise an additional lag."""
    table = toml.read(linear.find_model(problem.model)).get("drive", {})
    facts = linear.facts(problem.model)
    name = table.get({"dc_motor": "L", "first_order": "a_act"}.get(table.get("type"), ""))
    if isinstance(name, str) and name in facts.parameters and name not in problem.priors:
        value, unit = facts.parameters[name]
        drive = facts.required_drive.values

        def words(values: Values, _: Values) -> tuple[str, str]:
            new = values[name]
            lag = (new - value) / (drive["R"] + drive["k_amp"] * drive["k_current"]) if (
                table["type"] == "dc_motor") else 1 / new - 1 / value  # fmt: skip
            line = f'{name} = {{ value = {new:.4g}, unit = "{unit}" }}'
            text = f"a lag of {1e3 * abs(lag):.2g} ms {'more' if lag > 0 else 'less'} in the drive"
            return text, f"# in [parameters], in place of {value:.4g}\n{line}"

        prior = {name: Prior(value, 1.0)}
        return Shape("drive_lag", prior, lambda *_: 1.0, words, freed=True)

    def behind(values: Values, _: Values) -> tuple[str, str]:
        lag = values["lag_s"]
        return f"a lag of {1e3 * lag:.2g} ms in the drive", f"# 1/s, the corner: {1 / lag:.4g}"

    return Shape("drive_lag", {"lag_s": Prior(LAG_S, 1.2)}, lambda v, _, hz: _lag(v, hz), behind)


def _modes(problem: Responses) -> list[Shape]:
    """Candidates: a mass on a spring on the drive's body, which adds a zero and a pole above it."""
    hz = np.concatenate([m.frequency_hz for m in problem.measured])
    facts = linear.facts(problem.model)
    body = facts.required_drive.body
    work = model_file.read(problem.model).workpiece
    moving = sum(kg for name, kg in facts.masses_kg.items() if name != work)

    def factor(values: Values, _: int, hz: Samples) -> Any:
        def pair(at: float) -> Any:
            ratio = hz / at
            return 1 - ratio**2 + 2j * values["zeta"] * ratio

        zero = values["mode_hz"]
        return pair(zero) / pair(zero * values["split"])

    def words(values: Values, _: Values) -> tuple[str, str]:
        zero, split = values["mode_hz"], values["split"]
        mass = moving * abs(split**2 - 1)
        stiffness = mass * (2 * math.pi * zero) ** 2
        damping = 2 * values["zeta"] * math.sqrt(stiffness * mass)
        lines = (
            f'[[body]]\nname = "mode"\nmass = {mass:.4g}\n\n[[spring]]\nname = "mode_spring"\n'
            f'between = ["mode", "{body}"]\nstiffness = {stiffness:.4g}\ndamping = {damping:.4g}'
        )
        return f"a mode near {zero * split:.3g} Hz", lines

    return [
        Shape(
            "mode",
            {"mode_hz": Prior(f, 0.15), "split": Prior(SPLIT, 0.1), "zeta": Prior(0.03, 1.0)},
            factor, words,
        )
        for f in np.geomspace(1.3 * hz.min() + 1, 0.9 * hz.max(), MODES_FROM).tolist()
    ]  # fmt: skip


def _gains(problem: Responses) -> Shape:
    """Candidate: a separate gain for each response in contact after the first."""
    pressed = [i for i, m in enumerate(problem.measured) if not m.free]
    support = model_file.read(problem.model).support

    def factor(values: Values, i: int, _: Samples) -> Any:
        return values[f"gain_{i}"] if i in pressed[1:] else 1.0

    def words(values: Values, best: Values) -> tuple[str, str]:
        gains = [1.0, *(values[f"gain_{i}"] for i in pressed[1:])]
        shares = ", ".join(f"{gain:.3g}" for gain in gains)
        what = f"a gain that differs by level, {shares} from the smallest force on"
        name = support.stiffness if support else None
        known = linear.facts(problem.model).parameters
        own = best.get(str(name), known.get(str(name), (1.0,))[0])
        softer = [float(f"{own * gain:.4g}") for gain in gains]
        where = (
            "# in the [[spring]] behind the contact, with loads: a force between each two levels"
        )
        return what, f"{where}\nstiffness = {softer}"

    return Shape("gain", {f"gain_{i}": Prior(1.0, GAIN) for i in pressed[1:]}, factor, words)


def of(found: JointFit) -> list[Tried]:
    """The candidates for a rejected JointFit."""
    return tried(replace(found.problem), found.at)
