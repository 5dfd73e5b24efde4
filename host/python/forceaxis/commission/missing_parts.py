"""Searches for the element that a rejected model lacks. Candidates for this element are fitted and
ranked.

Each candidate multiplies the responses of the model by a factor. The parameters of this factor are
fitted together with all other parameters. The candidates are ranked by chi-square plus a penalty of
ln n for each parameter, where n is the number of real residuals (Schwarz, The Annals of Statistics
6, 1978). Each candidate states the TOML text to add to the model.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from forceaxis import linear
from forceaxis.commission.joint_fit import JointFit, Response, Responses, Samples, Values
from forceaxis.commission.known import Prior
from forceaxis.design import model_file
from forceaxis.identify.distributions import chi_square_tail
from forceaxis.identify.fit import REJECTED_BELOW

START_MODES = 10  # number of start frequencies in the search for a mode of vibration
SHOWN_CANDIDATES = 3  # largest number of candidates that a text names
START_LAG_S = 4e-4  # start value of a time constant in s
GAIN_SPREAD = 0.2  # prior standard deviation of the logarithm of a gain that differs between forces
START_SPLIT = 1.05  # start value of the ratio (pole frequency / zero frequency) for a mode
EVALUATIONS_MAX = 25


@dataclass(frozen=True)
class Shape:
    """A candidate: an element that the model may lack. factor(parameters, i, hz) returns the factor
    by which response i is multiplied. words(parameters, best) returns a description and the TOML
    text to add to the model. `best` are the values of the parameters of the model.

    `parameters` are values in the order of `priors`. If a candidate only frees parameters of the
    model (`freed`), its factor is 1.
    """

    name: str
    priors: dict[str, Prior]
    factor: Callable[[Sequence[float], int, Samples], Response | float]
    words: Callable[[Sequence[float], Values], tuple[str, str]]
    freed: bool = False

    def parameters(self, values: Values) -> list[float]:
        """Returns the values of the parameters of the candidate. `values`: all values of a fit."""
        return [values[self.key(name)] for name in self.priors]

    def key(self, name: str) -> str:
        """Returns the name that a parameter of the candidate has in the fit."""
        return name if self.freed else f"{name}@shape"


@dataclass(frozen=True)
class Tried:
    """A fitted candidate. `gain`: decrease of chi-square minus the penalty. `p`: probability that
    chi-square is at least as large, if the model with the candidate is correct."""

    name: str
    text: str
    toml: str
    gain: float
    p: float
    values: Values


def tried(problem: Responses, x: Samples) -> list[Tried]:
    """Fits all candidates. Returns the candidates whose decrease of chi-square exceeds their
    penalty, sorted from best to worst.

    problem, x: the responses of a rejected joint_fit.joint(), and the logarithms of its best
    parameters.
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
    """Returns the TOML text of the best candidates. A comment above each candidate describes it."""
    lines = []
    for number, one in enumerate(found[:SHOWN_CANDIDATES], 1):
        explains = "then" if one.p >= REJECTED_BELOW else "which is not all,"
        lines.append(f"# {number}. {one.text}, {explains} p = {one.p:.2g}\n{one.toml}")
    return "\n".join(lines)


def _begun(problem: Responses, x: Samples, shape: Shape) -> tuple[Shape, Responses, float, Samples]:
    """Fits only the parameters of a candidate, while all other parameters stay at x. Returns four
    values: candidate, problem that includes its parameters, cost, and logarithms of its parameters.
    """
    own = {shape.key(name): prior for name, prior in shape.priors.items()}

    class Shaped(Responses):
        def predictions(self, x: Samples) -> list[Response]:
            parameters = shape.parameters(self.all_values(x))
            return [
                np.asarray(h * shape.factor(parameters, i, m.frequency_hz))
                for i, (m, h) in enumerate(zip(self.measured, super().predictions(x), strict=True))
            ]

    wider = Shaped(
        problem.model, problem.priors | own, problem.measured, problem.modes, problem.own,
        problem.errors,
    )  # fmt: skip
    free, (low, high) = len(x), wider.bounds(1e-3)
    found = optimize.least_squares(
        lambda y: wider.coarse(np.concatenate([x, y])), wider.centre[free:], loss="soft_l1",
        bounds=(low[free:], high[free:]), x_scale=wider.spread[free:], max_nfev=EVALUATIONS_MAX,
    )  # fmt: skip
    return shape, wider, float(found.cost), found.x


def _fitted(
    x: Samples, shape: Shape, wider: Responses, _: float, y: Samples, before: float, size: int
) -> Tried:
    """Fits all parameters together, beginning at the result of _begun()."""
    begin = np.clip(np.concatenate([x, y]), *wider.bounds(1e-3))
    best = optimize.least_squares(
        wider.fine, begin, bounds=wider.bounds(), x_scale=wider.spread, max_nfev=EVALUATIONS_MAX
    )
    scores = np.concatenate(wider.scores(best.x))
    chi2 = float(np.sum(scores**2))
    parameters = shape.parameters(wider.all_values(best.x))
    words, lines = shape.words(parameters, wider.values(best.x))
    gain = before - 2 * best.cost - len(parameters) * math.log(size)
    values = dict(zip(shape.priors, parameters, strict=True))
    return Tried(shape.name, words, lines, gain, chi_square_tail(chi2, size), values)


def _shapes(problem: Responses) -> list[list[Shape]]:
    """Returns one list for each kind of element. The candidates of a list differ in their start
    values."""
    return [
        [_sensor_lag(problem)],
        [_drive_lag(problem)],
        _modes(problem),
        *([[_gains(problem)]] if sum(not m.free for m in problem.measured) > 1 else []),
    ]


def _lag(lag_s: float, hz: Samples) -> Response:
    """Returns the frequency response of a first-order lag."""
    return np.asarray(1 / (1 + 2j * np.pi * hz * lag_s))


def _sensor_lag(problem: Responses) -> Shape:
    pressed = [not m.free for m in problem.measured]

    def words(parameters: Sequence[float], _: Values) -> tuple[str, str]:
        (lag,) = parameters
        lines = f'# in the [[adc]] of channel 0\nfilter = "{1 / lag:.4g} rad/s"'
        return f"a lag of {1e3 * lag:.2g} ms in the sensor", lines

    return Shape(
        "sensor_lag", {"lag_s": Prior(START_LAG_S, 1.2)},
        lambda p, i, hz: _lag(p[0], hz) if pressed[i] else 1.0, words,
    )  # fmt: skip


def _drive_lag(problem: Responses) -> Shape:
    """Returns the candidate for the lag of the drive. If the model already has a time constant of
    the drive (inductance of the winding or corner frequency of the force), the candidate frees this
    parameter. Otherwise it is an additional first-order lag."""
    drive, facts = model_file.read(problem.model).drive, linear.facts(problem.model)
    name = {"dc_motor": drive.L, "first_order": drive.a_act}.get(drive.type)
    if isinstance(name, str) and name in facts.parameters and name not in problem.priors:
        value, unit = facts.parameters[name]
        of_drive = facts.required_drive.values

        def words(parameters: Sequence[float], _: Values) -> tuple[str, str]:
            (new,) = parameters
            lag = 1 / new - 1 / value
            if drive.type == "dc_motor":
                resistance = of_drive["R"] + of_drive["k_amp"] * of_drive["k_current"]
                lag = (new - value) / resistance
            line = f'{name} = {{ value = {new:.4g}, unit = "{unit}" }}'
            text = f"a lag of {1e3 * abs(lag):.2g} ms {'more' if lag > 0 else 'less'} in the drive"
            return text, f"# in [parameters], in place of {value:.4g}\n{line}"

        prior = {name: Prior(value, 1.0)}
        return Shape("drive_lag", prior, lambda *_: 1.0, words, freed=True)

    def behind(parameters: Sequence[float], _: Values) -> tuple[str, str]:
        (lag,) = parameters
        return f"a lag of {1e3 * lag:.2g} ms in the drive", f"# 1/s, the corner: {1 / lag:.4g}"

    return Shape(
        "drive_lag", {"lag_s": Prior(START_LAG_S, 1.2)}, lambda p, _, hz: _lag(p[0], hz), behind
    )


def _modes(problem: Responses) -> list[Shape]:
    """Returns the candidates for a mode of vibration. The element is a mass on a spring that is
    attached to the body of the drive. It adds a pair of zeros and, at a higher frequency, a pair of
    poles."""
    hz = np.concatenate([m.frequency_hz for m in problem.measured])
    facts = linear.facts(problem.model)
    body = facts.required_drive.body
    work = model_file.read(problem.model).workpiece
    moving = facts.moving_kg(work)

    def factor(parameters: Sequence[float], _: int, hz: Samples) -> Response:
        zero, split, zeta = parameters

        def pair(at: float) -> Response:
            ratio = hz / at
            return np.asarray(1 - ratio**2 + 2j * zeta * ratio)

        return pair(zero) / pair(zero * split)

    def words(parameters: Sequence[float], _: Values) -> tuple[str, str]:
        zero, split, zeta = parameters
        mass = moving * abs(split**2 - 1)
        stiffness = mass * (2 * math.pi * zero) ** 2
        damping = 2 * zeta * math.sqrt(stiffness * mass)
        lines = (
            f'[[body]]\nname = "mode"\nmass = {mass:.4g}\n\n[[spring]]\nname = "mode_spring"\n'
            f'between = ["mode", "{body}"]\nstiffness = {stiffness:.4g}\ndamping = {damping:.4g}'
        )
        return f"a mode near {zero * split:.3g} Hz", lines

    return [
        Shape(
            "mode",
            {"mode_hz": Prior(f, 0.15), "split": Prior(START_SPLIT, 0.1), "zeta": Prior(0.03, 1.0)},
            factor, words,
        )
        for f in np.geomspace(1.3 * hz.min() + 1, 0.9 * hz.max(), START_MODES).tolist()
    ]  # fmt: skip


def _gains(problem: Responses) -> Shape:
    """Returns the candidate with a separate gain for each response in contact except the first."""
    pressed = [i for i, m in enumerate(problem.measured) if not m.free]
    support = model_file.read(problem.model).support

    def factor(parameters: Sequence[float], i: int, _: Samples) -> float:
        return parameters[pressed.index(i) - 1] if i in pressed[1:] else 1.0

    def words(parameters: Sequence[float], best: Values) -> tuple[str, str]:
        gains = [1.0, *parameters]
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

    return Shape("gain", {f"gain_{i}": Prior(1.0, GAIN_SPREAD) for i in pressed[1:]}, factor, words)


def of(found: JointFit) -> list[Tried]:
    """Returns the elements that the model of a rejected fit may lack, sorted with the most likely
    first."""
    return tried(replace(found.problem), found.at)
