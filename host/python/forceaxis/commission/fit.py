"""A model's parameters from all responses of one axis, and from what was known of it before.

    found = joint(model, priors(model, over), [free, at_30_N, at_150_N], over)
    found.values, found.intervals, found.over     # or why not: found.rejected, found.text

Responses in contact fix ratios of masses, stiffnesses and the drive's force alone: the response
apart and the priors fix the absolute values, as well as they are known. A force law does not meet
what they leave open, since it acts from the reading to the code, as the responses do.
"""

import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import optimize, stats

from forceaxis import linear, toml
from forceaxis._core import InputError
from forceaxis.design import sets
from forceaxis.identify.fit import MISFIT, SHARE
from forceaxis.identify.measurement import COHERENT
from forceaxis.linear import loops, plant_set

# Standard deviations of the logarithms of what is known before.
MASS, DRIVE, STIFFNESS, DAMPING, WORKPIECE = 0.05, 0.05, 0.2, math.log(2), math.log(5)
DRIVEN = ("k_torque", "k_preamp_cmd", "k_preamp_fdbk", "a_preamp_fdbk", "k_amp")
OUTSIDE = 3.0  # standard deviations from its prior: rejected
EDGE = 3.5  # how far is searched
MODEL_ERROR = 0.01  # of a response, that is no fault of the parameters
GRID = 9  # starts of each wide parameter, evaluated; the best are searched from
SEARCHES = 4
NEAR = 0.15  # logarithm of the frequency: lines at the limiting mode
STEP = 1e-5
LIMITED = (("drive.voltage", "supply_limit"), ("drive.current_command", "preamp_limit"))
FINE_S, FINE_STEPS = 1e-5, 300  # the peak of a step comes within a few time constants
UNSATURATED = 0.7  # of the limit: a step of the noise is up to twice its amplitude


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter: its value > 0 and the standard deviation of its logarithm."""

    value: float
    spread: float

    @property
    def wide(self):
        return self.spread > 1.0


@dataclass
class Found:
    """What joint() found. Of a rejected fit only `rejected`, `text`, `best`, `levels` and the
    chi-square say anything."""

    model: str
    best: dict  #: {parameter: value}
    chi2: float
    dof: int
    #: per response {"name", "points", "chi2", "dof", "p", "modes"}
    levels: list
    rejected: str | None = None  #: one word: prior, chi2 or coherence
    text: str = ""  #: why, for people
    values: dict | None = None  #: `best`, of a fit that is not rejected
    intervals: dict | None = None  #: {parameter: (low, high)}, 95 %
    #: {"a/b" or "a*b": (value, low, high)}: what is known better than either
    ratios: dict | None = None
    correlation: np.ndarray | None = None  #: in the order of `best`
    plants: plant_set.PlantSet | None = None  #: for a design
    limiting_hz: float | None = None

    @property
    def p(self):
        """Probability of a chi-square as large, were the model right."""
        return float(stats.chi2.sf(self.chi2, self.dof))

    @property
    def over(self):
        """The ranges of `plants`, as texts of --over."""
        return tuple(f"{n}={r[1]:.9g}..{r[2]:.9g}" for n, r in self.plants.ranges.items())

    def summary(self):
        """The JSON object."""
        names = list(self.best)
        return {
            "model": self.model,
            "values": self.values,
            "best": self.best,
            "intervals": self.intervals,
            "ratios": self.ratios,
            "correlation": None if self.values is None else self.correlation.tolist(),
            "order": names,
            "chi_square": self.chi2,
            "dof": self.dof,
            "p_value": self.p,
            "responses": self.levels,
            "rejected": self.rejected,
            "why": self.text,
            "limiting_hz": self.limiting_hz,
            "over": None if self.values is None else list(self.over),
            "set": None
            if self.values is None
            else " ".join(f"--set {n}={v:.6g}" for n, v in self.values.items()),
        }


def priors(model, over=(), given=(), overrides=None):
    """{parameter: Prior} of a model by the part that each plays: masses, the drive's and the
    contact's constants as a data sheet has them; the workpiece and what `over` names hardly known.

    given: texts NAME=VALUE (as exact as a mass) or NAME=VALUE+-PERCENT%. Raises InputError.
    """
    known = linear.facts(model, overrides)["parameters"]
    table = toml.read(linear.find_model(model))
    work = _workpiece(table)
    spreads = {}

    def add(name, spread):
        if isinstance(name, str) and name in known and known[name][0] > 0:
            spreads[name] = max(spread, spreads.get(name, 0.0))

    for body in table.get("body", ()):
        add(body.get("mass"), WORKPIECE if body["name"] == work else MASS)
    for kind in ("spring", "damper", "contact", "backlash"):
        for part in table.get(kind, ()):
            on_it = kind != "contact" and work in part["between"]
            add(part.get("stiffness"), WORKPIECE if on_it else STIFFNESS)
            add(part.get("damping"), WORKPIECE if on_it else DAMPING)
    for key in DRIVEN:
        add(table.get("drive", {}).get(key), DRIVE)
    for name in plant_set.ranges_of(model, over, overrides):
        add(name, WORKPIECE)
    found = {name: Prior(known[name][0], spread) for name, spread in spreads.items()}
    for text in given:
        name, _, value = text.partition("=")
        value, _, percent = value.partition("+-")
        try:
            share = float(percent.removesuffix("%")) / 100 if percent else MASS
            prior = Prior(float(value), share)
        except ValueError:
            prior = Prior(0.0, 0.0)
        if name not in known or not (0 < prior.value < math.inf and 0 < prior.spread < math.inf):
            raise InputError(
                f"--prior: {text}: expected NAME=VALUE or NAME=VALUE+-PERCENT%, above 0, of a "
                f"parameter of the model: {', '.join(sorted(known))}"
            )
        found[name] = prior
    return found


def linear_codes(model, overrides=None):
    """Codes of noise that leave the drive's voltage and current within their limits, by the model;
    None without limits. Beyond, the amplifier answers with less than its gain."""
    path = linear.find_model(model)
    known, table = linear.facts(path, overrides), toml.read(path).get("drive", {})
    found = []
    for signal, key in LIMITED:
        limit = table.get(key)
        limit = known["parameters"].get(limit, (limit,))[0]
        if signal not in known["signals"] or not isinstance(limit, int | float):
            continue
        step = linear.linearise(path, outputs=(signal,), overrides=overrides).sampled(dt=FINE_S)
        x, peak = np.zeros(len(step.A)), abs(step.D[0, 0])
        for _ in range(FINE_STEPS):
            x = step.A @ x + step.B[:, 0]
            peak = max(peak, abs((step.C @ x)[0] + step.D[0, 0]))
        found.append(UNSATURATED * limit / (peak * known["volts_per_code"]))
    return max(1, int(min(found))) if found else None


def _workpiece(table):
    """The body that the contact presses on."""
    contacts = table.get("contact", ())
    return contacts[0]["between"][1] if len(contacts) == 1 else None


@dataclass
class _Responses:
    """The responses of one axis as residuals of the logarithms of its parameters."""

    model: str
    priors: dict
    measured: list
    modes: list = field(default_factory=list)  # of each response

    def __post_init__(self):
        self.names = tuple(self.priors)
        self.centre = np.log([p.value for p in self.priors.values()])
        self.spread = np.array([p.spread for p in self.priors.values()])
        self.modes = self.modes or [{}] * len(self.measured)
        self.variance = [m.variance + (MODEL_ERROR * abs(m.response)) ** 2 for m in self.measured]

    def values(self, x):
        return dict(zip(self.names, np.exp(x).tolist(), strict=True))

    def predictions(self, x):
        """What the model gives; contact levels of the same modes and lines are predicted once."""
        values, known, found = self.values(x), {}, []
        for m, modes in zip(self.measured, self.modes, strict=True):
            key = (m.free, m.output, m.input, m.scale, m.window, tuple(sorted(modes.items())),
                   m.frequency_hz.tobytes())  # fmt: skip
            if key not in known:
                known[key] = replace(m, modes=modes).predict(values)
            found.append(known[key])
        return found

    def coarse(self, x):
        """By the logarithm of the ratio, which converges from afar."""
        parts = []
        for m, v, h in zip(self.measured, self.variance, self.predictions(x), strict=True):
            relative = np.sqrt(v) / np.maximum(abs(m.response), 1e-300)
            parts.append(np.log(m.response / h) / np.hypot(relative, 0.1))
        return np.concatenate([*map(_real, parts), (x - self.centre) / self.spread])

    def scores(self, x):
        """Each response's residuals, real, whose squares' sum is a chi-square, two degrees of
        freedom a line: see identify.fit.fit."""
        found = []
        for m, v, h in zip(self.measured, self.variance, self.predictions(x), strict=True):
            error = (m.response - h) / np.sqrt(v)
            square = np.maximum(abs(error) ** 2, 1e-30)
            found.append(_real(error * np.sqrt(2 * m.dof * np.log1p(square / m.dof) / square)))
        return found

    def fine(self, x):
        # The likelihood's own factor is (dof + 1) / dof, here 1 as in the test.
        return np.concatenate([*self.scores(x), (x - self.centre) / self.spread])

    def information(self, x, scales):
        """Of the logarithms: (the lines', that of lines and priors). scales: how much larger than
        its variance says each response's error is."""
        shifted = [
            [self.predictions(x + s * STEP * d) for s in (1, -1)] for d in np.eye(len(self.names))
        ]
        known, lines = self.predictions(x), np.zeros((len(x), len(x)))
        for i, (m, v) in enumerate(zip(self.measured, self.variance, strict=True)):
            J = np.stack([(a[i] - b[i]) / (2 * STEP) for a, b in shifted], 1)
            T = m.dof * v + abs(m.response - known[i]) ** 2
            lines += 2 * m.dof**2 / (m.dof + 1) * (J.conj().T @ (J / T[:, None])).real / scales[i]
        return lines, lines + np.diag(self.spread**-2.0)

    def starts(self):
        """The best of a grid of the wide parameters, everything else as known: [x]."""
        wide = [i for i, p in enumerate(self.priors.values()) if p.wide]
        steps = np.linspace(-2, 2, GRID if len(wide) < 3 else 7)
        damped = [i for i in wide if self.names[i].startswith("b")]
        grids = [np.array([-1.0, 0.0, 1.0]) if i in damped else steps for i in wide]
        found = []
        for shifts in itertools.product(*grids):
            x = self.centre.copy()
            x[wide] += np.array(shifts) * self.spread[wide]
            size = np.sum(2 * (np.sqrt(1 + self.coarse(x) ** 2) - 1))
            found.append((float(size), x))
        return [x for _, x in sorted(found, key=lambda pair: pair[0])[:SEARCHES]]

    def search(self, begin):
        low, high = self.centre - EDGE * self.spread, self.centre + EDGE * self.spread
        options = {"bounds": (low, high), "x_scale": self.spread, "max_nfev": 40}
        near = optimize.least_squares(self.coarse, begin, loss="soft_l1", **options).x
        inside = 1e-3 * self.spread
        near = np.clip(near, low + inside, high - inside)
        return optimize.least_squares(self.fine, near, xtol=1e-9, ftol=1e-9, **options)


def _real(values):
    return np.concatenate([values.real, values.imag])


def joint(model, priors, measurements, over=(), coherent=COHERENT):
    """Fit all responses of one axis at once: a Found.

    model: a path or stem. priors: {parameter: Prior or (value, spread of the logarithm)}, of what
    is searched. measurements: Measurements of the axis, apart or in contact at some force; each in
    contact is taken in the slope of the amplifier that explains it best. over: texts as --over,
    what may change about the values found. Raises InputError.
    """
    model = str(linear.find_model(model))
    priors = {n: p if isinstance(p, Prior) else Prior(*p) for n, p in priors.items()}
    measured = [replace(m, model=model) for m in measurements]
    if not priors or not any(not m.free for m in measured):
        raise InputError("fit: expected parameters to find, and a response in contact")
    problem = _Responses(model, priors, measured)
    best = _searched(problem)
    slopes = [{}, *(modes for modes in sets.slopes(model) if modes)]
    if len(slopes) > 1:
        for _ in range(2):
            chosen = _modes(problem, best.x, slopes)
            if chosen == problem.modes:
                break
            problem.modes = chosen
            best = min([problem.search(best.x), _searched(problem)], key=lambda r: r.cost)
    return _judged(problem, best.x, over, coherent)


def _searched(problem):
    best = None
    enough = stats.chi2.isf(0.05, 2 * sum(len(m.frequency_hz) for m in problem.measured))
    for start in problem.starts():
        found = problem.search(start)
        best = found if best is None or found.cost < best.cost else best
        if 2 * best.cost < enough:
            break
    return best


def _modes(problem, x, slopes):
    """The modes in which each response in contact is explained best."""
    sizes = []
    for modes in slopes:
        tried = replace(problem, modes=[{} if m.free else modes for m in problem.measured])
        sizes.append([float(np.sum(s**2)) for s in tried.scores(x)])
    pick = np.argmin(sizes, 0)
    return [
        {} if m.free else slopes[i] for m, i in zip(problem.measured, pick.tolist(), strict=True)
    ]


def _judged(problem, x, over, coherent):
    """The Found of the best parameters."""
    levels = []
    for m, modes, score in zip(problem.measured, problem.modes, problem.scores(x), strict=True):
        chi2, dof = float(np.sum(score**2)), 2 * len(m.frequency_hz)
        levels.append({
            "name": "apart" if m.free else "in contact", "points": len(m.frequency_hz),
            "chi2": chi2, "dof": dof, "p": float(stats.chi2.sf(chi2, dof)), "modes": modes,
        })  # fmt: skip
    away = (x - problem.centre) / problem.spread
    chi2 = sum(level["chi2"] for level in levels) + float(np.sum(away**2))
    best = problem.values(x)
    found = Found(problem.model, best, chi2, sum(level["dof"] for level in levels), levels)
    limit = loops.force_loop(problem.model, "p", "zoh", best).limit()
    found.limiting_hz = limit.frequency_hz
    _reject(found, problem, away, coherent)
    if found.rejected:
        return found
    scales = [max(1.0, level["chi2"] / level["dof"]) for level in levels]
    lines, information = problem.information(x, scales)
    covariance = np.linalg.inv(information)
    spread = np.sqrt(np.diag(covariance))
    size = stats.norm.ppf((1 + SHARE) / 2)
    found.values = best
    found.intervals = {
        name: tuple(value * math.exp(s * size * h) for s in (-1, 1))
        for (name, value), h in zip(best.items(), spread, strict=True)
    }
    found.correlation = covariance / np.outer(spread, spread)
    found.ratios = _ratios(best, covariance, size)
    # What the others' freedom adds does not show in a response, so no law meets it.
    alone = size / np.sqrt(np.maximum(np.diag(lines), 1e-12))
    ranges = plant_set.ranges_of(problem.model, over, best)
    for i, name in enumerate(problem.names):
        if name in ranges:
            value, low, high = ranges[name]
            wider = math.exp(min(alone[i], size * spread[i]))
            ranges[name] = (value, low / wider, high * wider)
    visited = [modes for i, modes in enumerate(problem.modes) if not problem.measured[i].free]
    modes = tuple({tuple(sorted(m.items())): m for m in visited}.values())
    found.plants = plant_set.PlantSet(problem.model, best, ranges, modes)
    return found


def _reject(found, problem, away, coherent):
    """Says why a fit is not taken, if it is not."""
    worst = int(abs(away).argmax())
    misfits = [level for level in found.levels if level["p"] < MISFIT / len(found.levels)]
    if found.p < MISFIT or misfits:
        p = min([found.p, *(level["p"] for level in misfits)])
        found.rejected = "chi2"
        found.text = (
            f"expected a model that explains the responses, p = {p:.2g}: another parameter is "
            "wrong, or something is in the axis that the model has not"
        )
    elif abs(away[worst]) > OUTSIDE:
        name = problem.names[worst]
        found.rejected = "prior"
        found.text = (
            f"expected {name} within {OUTSIDE:g} standard deviations of "
            f"{problem.priors[name].value:.5g}, got {found.best[name]:.5g}: check what the model "
            "says of it, or give --prior"
        )
    elif found.limiting_hz is not None:
        for m in problem.measured:
            near = abs(np.log(m.frequency_hz / found.limiting_hz)) < NEAR
            best = float(m.coherence[near].max()) if near.any() else 0.0
            if not m.free and best < coherent:
                found.rejected = "coherence"
                found.text = (
                    f"expected {coherent:g} or more at the limiting {found.limiting_hz:.3g} Hz, "
                    f"got {best:.2g}: take more averages, a larger force or a wider band"
                )
                return


def _ratios(best, covariance, size):
    """{text: (value, low, high)} of pairs whose quotient or product is known twice as well as
    either alone."""
    found = {}
    names = list(best)
    for i, j in itertools.combinations(range(len(names)), 2):
        for sign, text in ((-1, "/"), (1, "*")):
            variance = covariance[i, i] + covariance[j, j] + 2 * sign * covariance[i, j]
            if variance < min(covariance[i, i], covariance[j, j]) / 4:
                value = best[names[i]] * best[names[j]] ** sign
                half = math.exp(size * math.sqrt(max(variance, 0.0)))
                found[f"{names[i]}{text}{names[j]}"] = (value, value / half, value * half)
    return found
