"""Searches for the reason why a model does not explain the measured responses. Candidates for this
reason are fitted and ranked.

A candidate is a part that the model may lack (friction, play, a frame, rubber that relaxes, a lag),
or a number of the model that may be wrong. Its few parameters are fitted together with all other
parameters. The candidates are ranked by their evidence: the decrease of chi-square and of the
distances from the priors, minus a penalty of ln n for each parameter, where n is the number of real
residuals (Schwarz, The Annals of Statistics 6, 1978).

The best candidate is named as the cause only if it explains the responses and if its evidence
exceeds that of every other candidate by EVIDENCE_MIN. A difference of 10 means that the data are
exp(5) = 150 times as likely with it (Kass and Raftery, J. American Statistical Association 90,
1995).
"""

import itertools
import math
import tempfile
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import tomlkit
from scipy import optimize

from forceaxis import linear
from forceaxis._core import InputError
from forceaxis.axis.link import TICKS_PER_S
from forceaxis.commission import friction, friction_models, joint_fit
from forceaxis.commission.joint_fit import JointFit, Own, Response, Responses, Samples, Values
from forceaxis.commission.known import Prior
from forceaxis.design import model_file
from forceaxis.design.model_file import ModelFile
from forceaxis.identify.distributions import chi_square_tail
from forceaxis.identify.fit import REJECTED_BELOW
from forceaxis.linear import PlantFacts

# START_MODES: number of start frequencies, distributed over the band, in the search for a mode.
# WORST_MODES: number of start frequencies at which the model explains the responses worst.
# WORST_APART: smallest difference of the logarithms of two such frequencies.
START_MODES, WORST_MODES, WORST_APART = 6, 2, 0.1
EVIDENCE_MIN = 10.0  # least difference of the evidence between the cause and other candidates
START_LAG_S = 1e-3  # start value of a lag or of a latency in s
FREED_SPREAD = 0.5  # prior standard deviation of the logarithm of a number that may be wrong
# A number of the model is a candidate if its prior standard deviation is below this value.
NARROW_SPREAD = 0.31
STIFFENING_SPREAD = 0.7  # prior standard deviation of the stiffness at each force
# A number is a candidate if its estimated decrease of the cost exceeds this value.
FREED_GAIN_MIN = 3.0
# BEGIN_EVALUATIONS: largest number for a fit of the parameters of a candidate alone.
# FIRST_EVALUATIONS: largest number for a fit of all parameters.
# EVALUATIONS_MAX: largest number for the best candidates, which are fitted again.
# The best candidates are REFINED_MIN ones, and all that have REFINED_SHARE of the best evidence.
BEGIN_EVALUATIONS, FIRST_EVALUATIONS, EVALUATIONS_MAX = 10, 4, 30
WHOLE_EVALUATIONS = 10
REFINED_MIN, REFINED_SHARE = 4, 0.3
# Highest frequency of a mode of a candidate, divided by the highest one of the responses.
# A body whose mode has a higher frequency moves rigidly: the responses show only its mass.
MODE_BAND = 1.3
# Largest damping ratio of a mode of frame or tool.
# With more damping, the mode is no vibration and represents another effect, such as a latency.
MODE_DAMPING_MAX = 0.4
BED, TOOL = "bed", "tool_head"  # names of the bodies of a frame
# {name of such a body: what changes in the model beside it}
PLACES = {
    BED: '# beside `reaction` of [drive] and `reference` of [encoder], which become "bed", and '
    'what is fixed to the ground beside the axis, which is fixed to "bed"\n',
    TOOL: "# with the same position as the body that carries it, beside the [[contact]], which "
    'becomes one between "tool_head" and the workpiece\n',
}
CANDIDATE_MODEL = "candidate.toml"  # name of the file of the model of a candidate


@dataclass(frozen=True)
class Candidate:
    """A reason why a model does not explain the responses.

    `name` is one word. `priors`: its parameters, which replace the priors of the model with the
    same names. `elements(values)`: elements that the model lacks, as TOML text, in which each
    parameter of `values` is a number or a name. `own`: for each response, parameters of the model
    that belong only to this response. `factor(values, i, hz)`: factor by which response i is
    multiplied. `model`: text of a model in place of the given one.

    `words(values)`: description for a user. `lines(values)`: what to add to the model; `option`:
    what to add to the command. `values`: all parameters of the fit.
    """

    name: str
    priors: dict[str, Prior]
    words: Callable[[Values], str]
    lines: Callable[[Values], str] = lambda _: ""
    option: Callable[[Values], str] = lambda _: ""
    elements: Callable[[Mapping[str, float | str]], str] | None = None
    model: str = ""
    own: tuple[Own, ...] = ()
    factor: Callable[[Values, int, Samples], Response | float] | None = None
    #: {parameter of `elements`: (its first value, its unit)}
    parameters: dict[str, tuple[float, str]] = field(default_factory=dict)
    #: True if a model with `lines` describes it by linear elements, so that a law may rely on it
    linear: bool = True
    #: True if its fit begins with all parameters: without it, the others have taken its effect
    whole: bool = False
    #: False for values with which the responses do not show the candidate
    is_shown: Callable[[Values], bool] = lambda _: True


@dataclass(frozen=True)
class Tried:
    """A fitted candidate: its name, its description, the TOML text and the option with which the
    command accepts it, and its parameters. `gain`: its evidence. `p`: probability that chi-square
    is at least as large, if the model with the candidate is correct. `linear`: see Candidate."""

    name: str
    text: str
    toml: str
    option: str
    gain: float
    p: float
    values: Values
    linear: bool = True

    @property
    def priors(self) -> tuple[str, ...]:
        """Returns the values of the option as texts of TuningOrder.priors."""
        return tuple(self.option.split()[1:])

    @property
    def explains(self) -> bool:
        """Returns True if the model with this candidate is not rejected."""
        return self.p >= REJECTED_BELOW


def winner(tried: Sequence[Tried]) -> Tried | None:
    """Returns the first candidate if it is the cause by evidence, otherwise None. `tried`: sorted
    from best to worst. Candidates with the same name are the same cause."""
    first = leader(tried)
    return first if first and first.explains else None


def leader(tried: Sequence[Tried]) -> Tried | None:
    """Returns the first candidate if by evidence it is the cause or one of several causes,
    otherwise None. `tried`: as for winner()."""
    first = tried[0] if tried and tried[0].gain > 0 else None
    return first if first and lead(tried) >= EVIDENCE_MIN else None


def delay(tried: Sequence[Tried]) -> Tried | None:
    """Returns the first candidate if only a lag and a latency of the measured force are not
    excluded, otherwise None. Both delay the measured force, and the step `verify` measures the law
    that is designed with one of them. `tried`: as for winner()."""
    left = {one.name for one in tried if possible(tried, one.name)}
    return tried[0] if left == DELAYS else None


def lead(tried: Sequence[Tried]) -> float:
    """Returns the evidence of the first candidate minus the evidence of the best candidate with
    another name. The model as it is does not count, because its fit was rejected."""
    others = [one.gain for one in tried[1:] if one.name != tried[0].name]
    return tried[0].gain - max(others, default=0.0)


def possible(tried: Sequence[Tried], name: str) -> bool:
    """Returns True if a candidate with this name is not excluded by the evidence."""
    gains = [one.gain for one in tried if one.name == name]
    return bool(gains) and max(gains) > max(0.0, tried[0].gain - EVIDENCE_MIN)


def text_of(tried: Sequence[Tried]) -> str:
    """Returns a text about the cause, or about the candidates that remain and the measurement that
    distinguishes them."""
    first = leader(tried)
    if first:
        is_one = "the cause is" if first.explains else "one of several causes is"
        where = f"give {first.option}" if first.option else "add it to the model"
        others = [one for one in tried if one.name != first.name]
        beside = f", that of {others[0].text}" if others else ""
        return (
            f"{is_one} {first.text}: its evidence exceeds that of the next candidate{beside} by "
            f"{lead(tried):.0f} (BIC); {where}"
        )
    left: dict[str, Tried] = {}
    for one in tried:
        if possible(tried, one.name):
            left.setdefault(one.name, one)
    excluded = dict.fromkeys(WORDS[one.name] for one in tried if one.name not in left)
    if not left:
        return f"the cause is not known; none of these alone explains it: {', '.join(excluded)}"
    some = " or ".join(one.text for one in left.values())
    what = "explains them" if any(one.explains for one in left.values()) else "is a part of it"
    text = f"the cause is not known: {some} {what}"
    text += f"; excluded: {', '.join(excluded)}" if excluded else ""
    return f"{text}; {_measurement(set(left))}"


# {name of a candidate: what it is}
WORDS = {
    "drive_numbers": "a number of the drive", "moving_mass": "a moving mass",
    "stiffness": "a stiffness of the axis", "sensor_lag": "a lag in the sensor",
    "latency": "a latency of the measured force", "frame": "a mode of frame or tool",
    "guide_friction": "dry friction of guide or gear", "relaxing": "a workpiece that relaxes",
    "stiffening": "a stiffness that depends on the force", "play": "play in the transmission",
    "cogging": "cogging of the motor",
}  # fmt: skip
DELAYS = {"sensor_lag", "latency"}
BY_AMPLITUDE = {"guide_friction", "play", "cogging"}


def _measurement(names: set[str]) -> str:
    """Returns a text with the measurement that distinguishes candidates. `names`: their names."""
    if names & BY_AMPLITUDE:
        return (
            "a response out of contact, measured with two excitation levels, tells: friction, play "
            "and cogging change this response with the amplitude, other causes do not"
        )
    if "relaxing" in names:
        return (
            "a recording of force and position while the axis holds a force tells: a workpiece "
            "that relaxes yields further at a constant force"
        )
    if "stiffening" in names:
        return (
            "a third of the `forces` between the two tells: only a stiffness that depends on the "
            "force changes with it"
        )
    if names & {"moving_mass", "drive_numbers", "stiffness"}:
        return (
            "weigh the moving mass and give it as `priors` NAME=KG: then only the other candidates "
            "remain"
        )
    return (
        "a response out of contact tells: it shows a mode of the frame too, but no lag of the "
        "force sensor"
    )


def with_lines(model: str | Path, lines: str) -> str:
    """Returns the text of a model with the TOML text of a cause, each line in its place."""
    document = model_file.document(model)
    parsed = tomlkit.parse(lines)
    first = lines.splitlines()[0]
    if first.startswith("# in the [[adc]]"):
        next(adc for adc in document["adc"] if adc["channel"] == 0).update(parsed)
    elif first.startswith("# in [parameters]"):
        document["parameters"].update(parsed)
    else:
        _add(document, model, lines)
    return tomlkit.dumps(document)


def of(
    found: JointFit, folder: Path, speeds: Sequence[float] = (), held: Collection[str] = ()
) -> list[Tried]:
    """Fits all candidates for the rejection of a fit. Returns them sorted from best to worst.

    folder: where models of candidates are written. speeds: rms speed in m/s of the axis in each
    response, or () if it is not known. held: parameters whose values the user gave.
    """
    with tempfile.TemporaryDirectory(dir=folder) as models:
        return _ranked(replace(found.problem), found.at, found.best, Path(models), speeds, held)


def _ranked(
    problem: Responses, x: Samples, best: Values, folder: Path, speeds: Sequence[float],
    held: Collection[str],
) -> list[Tried]:  # fmt: skip
    """Fits all candidates, first with few evaluations; then the best of them completely. `x`,
    `best`: logarithms and values of the parameters of the rejected fit."""
    before = _cost(problem, x)
    begun = []
    for variants in _candidates(problem, x, best, speeds, held):
        fits = [one for v in variants if (one := _begun(problem, x, v, folder)) is not None]
        alone = [one for one in fits if not one.candidate.whole]
        starts = [_refined(one, WHOLE_EVALUATIONS) for one in fits if one.candidate.whole]
        if alone:
            starts.append(_refined(min(alone, key=lambda one: one.cost), FIRST_EVALUATIONS))
        if starts:
            begun.append(min(starts, key=lambda one: one.cost))
    begun.sort(key=lambda one: one.tried(before).gain, reverse=True)
    # A fit that began with all parameters had more evaluations. It is therefore no repeated fit.
    plain = [one for one in begun if not one.candidate.whole]
    least = REFINED_SHARE * plain[0].tried(before).gain if plain else 0.0
    tried = [
        _refined(one, EVALUATIONS_MAX).tried(before)
        if one.tried(before).gain > least or any(one is other for other in plain[:REFINED_MIN])
        else one.tried(before)
        for one in begun
    ]
    shown = [fit.candidate.is_shown(one.values) for fit, one in zip(begun, tried, strict=True)]
    return sorted((one for one, is_shown in zip(tried, shown, strict=True) if is_shown),
                  key=lambda one: -one.gain)  # fmt: skip


def _cost(problem: Responses, x: Samples) -> float:
    """Returns the sum of the squares of the residuals of responses and priors."""
    return float(np.sum(problem.fine(x) ** 2))


@dataclass(frozen=True)
class _Fit:
    """A fit with a candidate: the problem that includes its parameters, the logarithms of all
    parameters, and half of the sum of the squares of the residuals."""

    candidate: Candidate
    wider: Responses
    x: Samples
    cost: float

    def tried(self, before: float) -> Tried:
        """Returns the result. `before`: sum of the squares without the candidate."""
        one, scores = self.candidate, np.concatenate(self.wider.scores(self.x))
        values = self.wider.all_values(self.x)
        gain = before - 2 * self.cost - len(one.priors) * math.log(len(scores))
        return Tried(
            one.name, one.words(values), one.lines(values), one.option(values), gain,
            chi_square_tail(float(np.sum(scores**2)), len(scores)),
            {name: values[name] for name in one.priors}, one.linear,
        )  # fmt: skip


def _begun(problem: Responses, x: Samples, candidate: Candidate, folder: Path) -> _Fit | None:
    """Fits only the parameters of a candidate, while all other parameters stay at x. The cost is
    computed from the residuals coarse(). A candidate whose fit begins with all parameters is not
    fitted here. Returns None if the candidate is not possible in the model."""
    try:
        wider = _with(problem, candidate, folder)
    except InputError:
        return None
    begin = wider.centre.copy()
    places = [wider.names.index(name) for name in problem.names]
    begin[places] = x
    if candidate.whole:
        return _Fit(candidate, wider, begin, math.inf)
    free = [wider.names.index(name) for name in candidate.priors]
    low, high = (bound[free] for bound in wider.bounds(1e-3))

    def at(y: Samples) -> Samples:
        point = begin.copy()
        point[free] = y
        return point

    found = optimize.least_squares(
        lambda y: wider.coarse(at(y)), np.clip(begin[free], low, high), loss="soft_l1",
        bounds=(low, high), x_scale=wider.spread[free], max_nfev=BEGIN_EVALUATIONS,
    )  # fmt: skip
    return _Fit(candidate, wider, at(found.x), float(found.cost))


def _with(problem: Responses, candidate: Candidate, folder: Path) -> Responses:
    """Returns the problem with the parameters of a candidate."""
    model, factor = problem.model, candidate.factor
    priors = problem.priors | candidate.priors
    if candidate.elements or candidate.model:
        document = tomlkit.parse(candidate.model) if candidate.model else model_file.document(model)
        if candidate.elements:
            text = candidate.elements({name: name for name in candidate.parameters})
            _add(document, model, text)
            parameters = document.setdefault("parameters", tomlkit.table())
            for name, (value, unit) in candidate.parameters.items():
                parameters[name] = {"value": value, "unit": unit}
        whole = tomlkit.dumps(document).encode()
        path = folder / f"{zlib.crc32(whole):08x}-{CANDIDATE_MODEL}"
        path.write_bytes(whole)
        model = str(path)
    own = (
        [a | b for a, b in zip(problem.own, candidate.own, strict=True)]
        if candidate.own
        else (problem.own)
    )

    class Shaped(Responses):
        def predictions(self, x: Samples) -> list[Response]:
            found = super().predictions(x)
            if not factor:
                return found
            values = self.all_values(x)
            return [
                np.asarray(h * factor(values, i, m.frequency_hz))
                for i, (m, h) in enumerate(zip(self.measured, found, strict=True))
            ]

    return Shaped(
        model, priors, [replace(m, model=model) for m in problem.measured], problem.modes, own,
        problem.errors, problem.states,
    )  # fmt: skip


def _refined(begun: _Fit, evaluations: int) -> _Fit:
    """Fits all parameters together, beginning at the parameters of `begun`. If parameters of the
    model are then far from their priors, another fit begins with their prior values."""
    wider = begun.wider

    def at(begin: Samples) -> _Fit:
        best = optimize.least_squares(
            wider.fine, np.clip(begin, *wider.bounds(1e-3)), bounds=wider.bounds(),
            x_scale=wider.spread, max_nfev=evaluations,
        )  # fmt: skip
        return replace(begun, x=best.x, cost=float(best.cost))

    found = at(begun.x)
    far = abs(found.x - wider.centre) > joint_fit.FAR * wider.spread
    far[[wider.names.index(name) for name in begun.candidate.priors]] = False
    if not far.any():
        return found
    return min(found, at(np.where(far, wider.centre, found.x)), key=lambda one: one.cost)


@dataclass(frozen=True)
class _Model:
    """Data of the fitted model from which the candidates are made. `best`: the fitted values."""

    problem: Responses
    best: Values
    tables: ModelFile
    facts: PlantFacts

    @property
    def pressed(self) -> list[int]:
        """Returns the numbers of the responses in contact."""
        return [i for i, m in enumerate(self.problem.measured) if not m.free]

    @property
    def body(self) -> str:
        """Returns the body of the drive."""
        return self.facts.required_drive.body

    @property
    def tool(self) -> str:
        """Returns the body that touches the workpiece."""
        return self.tables.contact.between[0] if self.tables.contact else self.body

    @property
    def moved(self) -> list[str]:
        """Returns the bodies of drive and tool, which may be the same."""
        return list(dict.fromkeys([self.body, self.tool]))

    @property
    def ground(self) -> str:
        """Returns the counterpart of the drive."""
        return self.facts.required_drive.reaction


def _candidates(
    problem: Responses, at: Samples, best: Values, speeds: Sequence[float], held: Collection[str]
) -> list[list[Candidate]]:
    """Returns one list for each candidate. The members of a list differ in their start values or in
    their place."""
    model = _Model(problem, best, model_file.read(problem.model), linear.facts(problem.model))
    return [
        *([one] for one in _numbers(model, at, held)),
        _sensor_lag(model),
        [_latency(model)],
        *_frames(model, at),
        _frictions(model, speeds),
        _relaxing(model),
        _stiffening(model),
        _play(model),
        _cogging(model),
    ]


def _numbers(model: _Model, at: Samples, held: Collection[str]) -> list[Candidate]:
    """Returns a candidate for each number of the model that may be wrong: constants and loops of
    the drive, masses and stiffnesses of the axis. Dampings are known only by their magnitude."""
    tables, priors = model.tables, model.problem.priors
    gains = _gains_if_freed(model.problem, at)
    of_drive = {value for value in vars(tables.drive).values() if isinstance(value, str)}
    work = tables.body(tables.workpiece)
    masses = {body.mass for body in tables.bodies if body is not work}
    found = []
    for name, (value, unit) in model.facts.parameters.items():
        if value <= 0 or (name in priors and priors[name].spread > NARROW_SPREAD):
            continue
        if name in of_drive and (name in priors or name in (tables.drive.L, tables.drive.a_act)):
            kind = "drive_numbers"
        elif name in priors and name in masses:
            kind = "moving_mass"
        elif name in priors and unit == "N/m":
            kind = "stiffness"
        else:
            continue
        if gains.get(name, math.inf) > FREED_GAIN_MIN:
            found.append(_number(name, value, unit, kind, name in held))
    return found


def _gains_if_freed(problem: Responses, at: Samples) -> dict[str, float]:
    """Estimates for each parameter by how much the cost decreases without its prior, from the
    curvature of the cost at the best values `at`."""
    _, information = problem.information(at, [1.0] * len(problem.measured))
    weight = problem.spread**-2.0
    shown = 1 / np.diag(np.linalg.inv(information)) - weight  # what the responses alone tell
    gains = ((at - problem.centre) * weight) ** 2 / np.maximum(shown, 1e-9) + (
        (at - problem.centre) ** 2 * weight
    )
    return dict(zip(problem.names, gains.tolist(), strict=True))


def _number(name: str, value: float, unit: str, kind: str, held: bool) -> Candidate:
    """Returns the candidate that one number of the model is wrong."""

    def words(values: Values) -> str:
        change = 100 * (values[name] / value - 1)
        return f"{name} of {values[name]:.4g} {unit}, {change:+.2g} % from the model" + (
            ", against the value that you gave" if held else ""
        )

    return Candidate(
        kind, {name: Prior(value, FREED_SPREAD)}, words,
        option=lambda values: f"`priors` {name}={values[name]:.4g}+-{joint_fit.GIVEN_PERCENT}%",
    )  # fmt: skip


def _sensor_lag(model: _Model) -> list[Candidate]:
    """Returns the candidate of a low pass in the sensor, if the model has none."""
    if "filter" in model_file.force_adc_table(model.problem.model):
        return []

    def factor(values: Values, i: int, hz: Samples) -> Response | float:
        if i not in model.pressed:
            return 1.0
        return np.asarray(1 / (1 + 2j * np.pi * hz * values["lag_s@"]), np.complex128)

    def lines(values: Values) -> str:
        return f'# in the [[adc]] of channel 0\nfilter = "{1 / values["lag_s@"]:.4g} rad/s"'

    return [Candidate(
        "sensor_lag", {"lag_s@": Prior(START_LAG_S, 1.2)},
        lambda values: f"a lag of {1e3 * values['lag_s@']:.2g} ms in the sensor", lines,
        factor=factor,
    )]  # fmt: skip


def _latency(model: _Model) -> Candidate:
    """Returns the candidate that the measured force arrives later than the model says."""
    name = model_file.force_adc_table(model.problem.model).get("latency")
    sampling = model.facts.required_reading.sampling
    has = sampling.latency_s if sampling else -0.5 / TICKS_PER_S

    def factor(values: Values, i: int, hz: Samples) -> Response | float:
        return np.exp(-2j * np.pi * hz * values["late_s@"]) if i in model.pressed else 1.0

    def lines(values: Values) -> str:
        late = max(has + values["late_s@"], 1e-6)
        if isinstance(name, str) and name in model.facts.parameters:
            text = f'{name} = {{ value = {late:.4g}, unit = "s" }}'
            return f"# in [parameters], in place of {has:.4g}\n{text}"
        return f'# in the [[adc]] of channel 0\nlatency = "{1e3 * late:.4g} ms"'

    return Candidate(
        "latency", {"late_s@": Prior(START_LAG_S, 1.2)},
        lambda values: f"a latency of {1e3 * values['late_s@']:.2g} ms more of the measured force",
        lines, factor=factor,
    )  # fmt: skip


def _worst_hz(problem: Responses, x: Samples) -> list[float]:
    """Returns the frequencies at which a model explains the responses worst, at most WORST_MODES,
    each farther than WORST_APART from the others."""
    size = np.concatenate([np.hypot(*np.split(one, 2)) for one in problem.scores(x)])
    hz = np.concatenate([m.frequency_hz for m in problem.measured])
    found: list[float] = []
    for at in hz[np.argsort(-size)].tolist():
        if len(found) < WORST_MODES and all(abs(math.log(at / f)) > WORST_APART for f in found):
            found.append(at)
    return found


def _frames(model: _Model, at: Samples) -> list[list[Candidate]]:
    """Returns candidates for a mode of vibration of the machine, one list for each place: a bed
    that carries motor and encoder, a tool that is held elastically, or another body on a spring at
    a body of the axis. `at`: logarithms of the fitted parameters."""
    hz = np.concatenate([m.frequency_hz for m in model.problem.measured])
    moving = model.facts.moving_kg(model.tables.workpiece)
    taken = {body.name for body in model.tables.bodies}
    numbers = (f"mode_{number}" for number in itertools.count(2))
    mode = next(name for name in itertools.chain(["mode"], numbers) if name not in taken)
    kinds = [(mode, body) for body in model.moved]
    if model.ground == "ground" and BED not in taken:
        kinds.append((BED, "ground"))
    if model.tables.contact and TOOL not in taken:
        kinds.append((TOOL, model.tool))

    def of(name: str, end: str, at_hz: float, whole: bool = False) -> Candidate:
        mass = (2.0 if name == BED else 0.1) * moving
        stiffness = mass * (2 * math.pi * at_hz) ** 2

        def elements(values: Mapping[str, float | str]) -> str:
            m, k, b = (_toml(values[key]) for key in ("m_mode", "k_mode", "b_mode"))
            return (
                f'{PLACES.get(name, "")}[[body]]\nname = "{name}"\nmass = {m}\n\n[[spring]]\n'
                f'name = "{name}_spring"\nbetween = ["{name}", "{end}"]\nstiffness = {k}\n'
                f"damping = {b}"
            )

        def alone_hz(values: Values) -> float:
            return math.sqrt(values["k_mode"] / values["m_mode"]) / (2 * math.pi)

        def is_mode(values: Values) -> bool:
            ratio = values["b_mode"] / (2 * math.sqrt(values["k_mode"] * values["m_mode"]))
            return alone_hz(values) < MODE_BAND * hz.max() and ratio < MODE_DAMPING_MAX

        def words(values: Values) -> str:
            alone = alone_hz(values)
            what = {BED: "of the machine bed", TOOL: "of the tool"}.get(name, f"at {end}")
            return f"a mode {what} near {alone:.3g} Hz"

        return Candidate(
            "frame",
            {
                "m_mode": Prior(mass, 1.0), "k_mode": Prior(stiffness, 1.0),
                "b_mode": Prior(0.06 * math.sqrt(stiffness * mass), 1.0),
            },
            words, elements, elements=elements,
            parameters={"m_mode": (mass, "kg"), "k_mode": (stiffness, "N/m"),
                        "b_mode": (0.0, "N s/m")},
            is_shown=is_mode, whole=whole,
        )  # fmt: skip

    starts = np.geomspace(1.3 * hz.min() + 1, 0.9 * hz.max(), START_MODES).tolist()
    worst = _worst_hz(model.problem, at)  # where a narrow mode is
    starts += worst
    return [
        [*(of(name, end, at) for at in starts), *(of(name, end, at, whole=True) for at in worst)]
        for name, end in kinds
    ]


def _add(document: tomlkit.TOMLDocument, model: str | Path, text: str) -> None:
    """Adds elements of a TOML text to the document of a model. A machine bed then carries what
    was fixed to the ground beside it, and a tool is what touches the workpiece."""
    tables, drive = model_file.read(model), linear.facts(model).required_drive
    contact = tables.contact
    moved = {drive.body, *(contact.between[:1] if contact else ())}
    elements = tomlkit.parse(text)
    for name, parameter in elements.pop("parameters", {}).items():
        document.setdefault("parameters", tomlkit.table())[name] = parameter
    for kind, added in elements.items():
        for table in added:
            if kind == "body" and table["name"] == BED:
                for links in ("damper", "friction", "brake", "cogging"):
                    for link in document.get(links, ()):
                        if link["between"][0] in moved and link["between"][1] == "ground":
                            link["between"] = [link["between"][0], BED]
                document["drive"]["reaction"] = BED
                document["encoder"]["reference"] = BED
            if kind == "body" and table["name"] == TOOL and contact:
                held = next(body for body in tables.bodies if body.name == contact.between[0])
                if held.position is not None:
                    table["position"] = held.position
                own = next(one for one in document["contact"] if one["name"] == contact.name)
                own["between"] = [TOOL, contact.between[1]]
            document.setdefault(kind, tomlkit.aot()).append(table)


def _toml(value: float | str) -> str:
    """Returns a number or the name of a parameter as TOML text."""
    return f'"{value}"' if isinstance(value, str) else f"{value:.4g}"


def _frictions(model: _Model, speeds: Sequence[float]) -> list[Candidate]:
    """Returns candidates for dry friction of guide or gear. In each response it is a damper that
    depends on the speed (see forceaxis.commission.friction). A model with dampers in place of its
    friction has no such candidate."""
    if any(model.problem.own) or len(speeds) != len(model.problem.measured):
        return []

    def at(place: str) -> Candidate:
        one = friction_models.FrictionElement("seals", (place, model.ground), 1.0)
        per_N = [friction.damping(1.0, max(speed, 1e-7)) for speed in speeds]

        def lines(values: Values) -> str:
            return friction_models.toml_lines((replace(one, newton=values["friction_N@"]),))

        return Candidate(
            "guide_friction", {"friction_N@": Prior(0.1 * _least_N(model, per_N), 3.0)},
            lambda values: f"dry friction of {values['friction_N@']:.2g} N at {place}", lines,
            model=friction_models.damped(model.problem.model, (one,)),
            own=tuple({one.damping: ("friction_N@", factor)} for factor in per_N), linear=False,
        )  # fmt: skip

    return [at(place) for place in model.moved]


def _least_N(model: _Model, per_N: Sequence[float]) -> float:
    """Returns the friction in N whose damping, in the response with the smallest one, is that of
    all moving masses at the middle of the band."""
    m = model.problem.measured[0]
    middle = 2 * math.pi * math.sqrt(float(m.frequency_hz[0] * m.frequency_hz[-1]))
    return model.facts.moving_kg(model.tables.workpiece) * middle / min(per_N)


def relaxing(model: str | Path, share: float, time_s: float) -> str:
    """Returns the TOML text of a workpiece that relaxes: a spring in series with a dashpot beside
    its spring. `share`: stiffness of this spring divided by that of the spring of the workpiece.
    `time_s`: time constant with which its force relaxes. Returns "" if the model has one already,
    or no parameter for the stiffness of the workpiece."""
    tables = model_file.read(model)
    name = tables.support.stiffness if tables.support else None
    own = [link for link in tables.springs if tables.workpiece in link.between]
    if not isinstance(name, str) or any(link.maxwell_stiffness is not None for link in own):
        return ""
    return (
        f'[parameters.k_relaxing]\nvalue = "{share:.4g} * {name}"\nunit = "N/m"\n\n'
        f'[[spring]]\nname = "relaxing"\nbetween = ["{tables.workpiece}", "ground"]\n'
        f'stiffness = 0.0\nmaxwell_stiffness = "k_relaxing"\nmaxwell_time = {time_s:.4g}'
    )


def _relaxing(model: _Model) -> list[Candidate]:
    """Returns candidates for a workpiece that relaxes. Its stiffness is the one that is fitted
    times the share of the further spring."""
    path = model.problem.model
    if not relaxing(path, 1.0, 1.0):
        return []

    def of(time_s: float) -> Candidate:
        def elements(values: Mapping[str, float | str]) -> str:
            work = model.tables.workpiece
            k, t = (_toml(values[name]) for name in ("k_relaxing", "t_relaxing"))
            return (
                f'[[spring]]\nname = "relaxing"\nbetween = ["{work}", "ground"]\n'
                f"stiffness = 0.0\nmaxwell_stiffness = {k}\nmaxwell_time = {t}"
            )

        def share(values: Values) -> float:
            return values["k_relaxing"] / values[name]

        def words(values: Values) -> str:
            return (
                f"a workpiece that relaxes, by {100 * share(values):.2g} % of its stiffness in "
                f"{values['t_relaxing']:.2g} s"
            )

        return Candidate(
            "relaxing",
            {
                "k_relaxing": Prior(0.3 * model.best[name], 1.2),
                "t_relaxing": Prior(time_s, 1.0),
            },
            words,
            lambda values: relaxing(path, share(values), values["t_relaxing"]),
            elements=elements,
            parameters={"k_relaxing": (model.best[name], "N/m"), "t_relaxing": (time_s, "s")},
        )

    name = str(model.tables.support.stiffness) if model.tables.support else ""
    return [of(time_s) for time_s in (0.01, 0.1)] if name in model.best else []


def _stiffening(model: _Model) -> list[Candidate]:
    """Returns the candidate that the stiffness of the workpiece differs between the forces."""
    support = model.tables.support
    name = support.stiffness if support else None
    known_name = isinstance(name, str) and name in model.best
    if support is None or not isinstance(name, str) or not known_name or len(model.pressed) < 2:
        return []
    keys = {i: f"{name}@{i}" for i in model.pressed}

    def words(values: Values) -> str:
        sizes = ", ".join(f"{values[key]:.4g}" for key in keys.values())
        return f"a stiffness {name} that depends on the force, {sizes} N/m from the least force on"

    def lines(values: Values) -> str:
        sizes = ", ".join(f"{values[key]:.4g}" for key in keys.values())
        return (
            f'# in the [[spring]] "{support.name}", with loads: a force between each two forces\n'
            f"stiffness = [{sizes}]"
        )

    return [
        Candidate(
            "stiffening",
            {key: Prior(model.best[name], STIFFENING_SPREAD) for key in keys.values()},
            words,
            lines,
            linear=False,
            own=tuple(
                {name: (keys[i], 1.0)} if i in keys else {}
                for i in range(len(model.problem.measured))
            ),
        )
    ]


def _play(model: _Model) -> list[Candidate]:
    """Returns the candidate for play in the transmission. Out of contact no force closes it, so the
    transmission has a smaller stiffness in this response (describing function of a dead zone)."""
    link = next(
        (s for s in model.tables.springs if set(s.between) == {model.body, model.tool}), None
    )
    name = link.stiffness if link else None
    if link is None or model.body == model.tool or not isinstance(name, str):
        return []
    value = model.best.get(name, model.facts.parameters[name].value)
    key = f"{name}@free"
    return [
        Candidate(
            "play", {key: Prior(share * value, 1.5)},
            lambda values: f"play in {link.name}: out of contact its stiffness is "
            f"{values[key] / value:.2g} of that in contact",
            lambda _: f'# in place of the [[spring]] "{link.name}": a [[backlash]] with its keys '
            "and `width`, the play in m",
            own=tuple({name: (key, 1.0)} if m.free else {} for m in model.problem.measured),
            linear=False,
        )
        for share in (1e-3, 0.03, 0.3)
    ]  # fmt: skip


def _cogging(model: _Model) -> list[Candidate]:
    """Returns the candidate for cogging of a linear motor. Within one magnet it is like a spring
    between motor and ground, with another stiffness at each place. Of both signs, only a positive
    one is tried."""
    if model.tables.drive.k_force is None:
        return []
    responses = model.problem.measured
    least = min(float(m.frequency_hz[0]) for m in responses)
    moving = model.facts.moving_kg(model.tables.workpiece)
    least_stiffness = moving * (2 * math.pi * least) ** 2
    names = ["k_cogging@free" if m.free else "k_cogging@pressed" for m in responses]
    priors = {name: Prior(least_stiffness, 2.0) for name in dict.fromkeys(names)}

    def elements(values: Mapping[str, float | str]) -> str:
        return (
            f'[[spring]]\nname = "cogging_slope"\nbetween = ["{model.body}", "{model.ground}"]\n'
            f"stiffness = {_toml(values['k_cogging'])}"
        )

    return [
        Candidate(
            "cogging", priors,
            lambda values: "cogging with a slope of "
            f"{max(values[name] for name in priors):.3g} N/m",
            lambda _: "# a [[cogging]] with its force and its period, from cogging_n and "
            "magnet_period_mm of a data sheet",
            elements=elements, parameters={"k_cogging": (least_stiffness, "N/m")},
            own=tuple({"k_cogging": (name, 1.0)} for name in names), linear=False,
        )
    ]  # fmt: skip
