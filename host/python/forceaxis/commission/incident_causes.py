"""Possible causes of an incident. A change of a sensor is an additional unknown of the likelihood.
A change of the plant is an additional element of the model."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from forceaxis import linear
from forceaxis.commission import contact_elements, incident_problem
from forceaxis.commission import contact_search as searching
from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_elements import Element
from forceaxis.commission.contact_likelihood import Unknown, gap_of
from forceaxis.commission.incident import Incident
from forceaxis.commission.incident_problem import IncidentProblem, Slack
from forceaxis.commission.known import POSTERIOR_SPREAD_MIN, WORKPIECE_SPREAD, Prior, priors
from forceaxis.design import model_file
from forceaxis.linear import posterior, working
from forceaxis.linear.plant_facts import Overrides

# Largest standard deviation of the logarithm of a parameter, if there is no released posterior.
# If a machine has no released posterior, it is assumed to agree with its model.
RELEASED_SPREAD = 0.05
ITERATIONS, BEND = 12, 30.0
FORCE_MIN_N = 1.0  # smallest force from which start values of a changed plant are computed
# Prior standard deviations: gain of a sensor, encoder scale, position of the workpiece.
GAIN_DEVIATION, SCALE_DEVIATION, PLACE_DEVIATION_M = 0.5, 0.3, 5e-3
COMMAND = "command"
CHANGED = "changed_"  # prefix of the names of parameters that a cause adds to the model
# {type of drive: key of the table [drive] to which its force or speed is proportional}
DRIVE_KEYS = {
    "dc_motor": "k_preamp_cmd", "first_order": "velocity_per_volt", "perfect": "force_per_volt",
    "torque": "current_per_volt", "velocity": "velocity_per_volt",
}  # fmt: skip
UNITS = {
    "stiffness": "N/m", "k_preamp_cmd": "1", "velocity_per_volt": "m/s/V",
    "force_per_volt": "N/V", "current_per_volt": "A/V",
}  # fmt: skip

Document = tomlkit.TOMLDocument


@dataclass(frozen=True)
class Cause:
    """A possible cause of an incident. `unknowns`: unknown numbers of a changed sensor. `starts`:
    start values for the fit of these unknowns, in standard deviations. `element`: change of the
    plant. `released`: {name of a fitted number: its value in the released machine}. `slip_at`: time
    step of the plant at which the encoder slips. `count`: number of fitted numbers."""

    name: str
    text: str
    count: int
    unknowns: tuple[Unknown, ...] = ()
    starts: tuple[float, ...] = ()
    element: Element | None = None
    released: Mapping[str, float] = field(default_factory=dict)
    slip_at: float = 0.0


@dataclass(frozen=True)
class FittedCause:
    """The result of the fit of a cause: the problem in which the cause was fitted, the most likely
    point, and its cost. `model_text`: text of the model with the cause, or "" if it is the model of
    the released machine."""

    cause: Cause
    problem: IncidentProblem
    point: Floats
    cost: float
    model_text: str = ""

    def values(self) -> dict[str, float]:
        """Returns the fitted numbers of the cause, as {name: value in SI units}."""
        found = dict(zip(self.problem.names, np.exp(self.point).tolist(), strict=False))
        for unknown in self.cause.unknowns:
            found[unknown.kind] = float(self._number(unknown, self.point))
        return found

    def intervals(self) -> dict[str, tuple[float, float]]:
        """Returns the 95 % intervals of the changed numbers of a cause."""
        half = 1.96 * np.sqrt(np.diag(searching.covariance(self.problem, self.point)))
        found = {}
        for i, name in enumerate(self.problem.names):
            low, high = np.exp([self.point[i] - half[i], self.point[i] + half[i]])
            found[name] = (float(low), float(high))
        for unknown in self.cause.unknowns:
            own = len(self.problem.names) + self.problem.unknowns.index(unknown)
            value, wide = self._number(unknown, self.point), unknown.deviation * half[own]
            found[unknown.kind] = (float(value - wide), float(value + wide))
        return found

    def _number(self, unknown: Unknown, point: Floats) -> float:
        own = len(self.problem.names) + self.problem.unknowns.index(unknown)
        return float(unknown.mean + unknown.deviation * point[own])


def descended(problem: IncidentProblem, point: Floats) -> tuple[Floats, float]:
    """Searches the most likely point, beginning at `point`. Returns the point and its cost."""
    point, _ = searching.descend(problem, point, ITERATIONS, BEND)
    return searching.descend(problem, point, ITERATIONS)


def _named(document: Document, kind: str, name: str) -> Any:
    if not name:
        return document[kind]
    return next(table for table in document[kind] if table["name"] == name)


class Released:
    """Compares the recorded second before a fault with the released machine. Fits the released
    machine, and possible causes of the incident.

    `names`: parameters of the released machine that are uncertain. Raises InputError.
    """

    def __init__(
        self, model: str, incident: Incident, held: Overrides, released: Path | None = None
    ) -> None:
        self.path = linear.find_model(model)
        self.held = held
        self.data = incident_problem.data_of(incident, self.path, held)
        self.facts = linear.facts(str(self.path), held)
        self.names, self.slack, self.centre = self._slack(released)
        self.problem = self.changed(Cause(COMMAND, "", 0), self.path)
        text = "plant and sensors are as released; what was commanded made the fault"
        self.fit = FittedCause(
            Cause(COMMAND, text, 0), self.problem, *descended(self.problem, self.problem.centre)
        )

    def _slack(self, released: Path | None) -> tuple[tuple[str, ...], Slack, dict[str, float]]:
        """Returns three values: names of the uncertain parameters, their effect on the residuals of
        the recorded second (a Slack), and their most likely values."""
        if released is None:
            known = priors(self.path, (), (), self.held)
            own = {n: p for n, p in known.items() if n not in self.held}
            inverse = np.diag([min(p.spread, RELEASED_SPREAD) ** -2 for p in own.values()])
        else:
            read = posterior.read(released)
            own = {n: p for n, p in priors(self.path, [str(released)], (), self.held).items()
                   if n in read.names}  # fmt: skip
            own = {n: own[n] for n in read.names}
            inverse = np.linalg.inv(log_covariance(read.table))
        free = IncidentProblem(self.path, self.data, own, self.held)
        count = len(free.force.values) + len(free.position.values)
        _, matrix = searching.derivatives(free, free.centre)
        centre = {name: prior.value for name, prior in own.items()}
        self.held = {**self.held, **centre}
        return tuple(own), Slack(matrix[:count, : len(own)], inverse), centre

    def changed(
        self, cause: Cause, path: Path, own: dict[str, Prior] | None = None
    ) -> IncidentProblem:
        """Returns the likelihood problem of a cause. `path`: model file that contains the cause.
        `own`: priors of the parameters that the cause adds to the model."""
        drops = cause.element.drops if cause.element else ()
        held = {name: value for name, value in self.held.items() if name not in drops}
        return IncidentProblem(
            path, self.data, own or {}, held, cause.unknowns, cause.slip_at, self.slack
        )

    def fitted(self, cause: Cause, folder: Path) -> FittedCause:
        """Fits the numbers of a cause, beginning with the best of its start values. `folder`:
        folder to which the model file with the cause is written."""
        if cause.element is None:
            problem = self.changed(cause, self.path)
            points = [self._begun(problem, (start,)) for start in cause.starts]
            costs = np.sum(problem.residuals(np.array(points)) ** 2, axis=1)
            return FittedCause(cause, problem, *descended(problem, points[int(np.argmin(costs))]))
        path = folder / "model.toml"
        begun: list[tuple[float, int, IncidentProblem, Floats, str]] = []
        for start in cause.element.starts:
            text = contact_elements.model_text(self.problem, cause.element, start)
            text = contact_elements.without_unused(text, path)
            path.write_text(text)
            own = {name: Prior(value, WORKPIECE_SPREAD) for name, value in start.items()}
            problem = self.changed(cause, path, own)
            point = self._begun(problem, ())
            cost = float(np.sum(problem.residuals(point[None]) ** 2))
            begun.append((cost, len(begun), problem, point, text))
        _, _, problem, point, text = min(begun, key=lambda one: one[:2])
        path.write_text(text)
        return FittedCause(cause, problem, *descended(problem, point), text)

    def again(self, fit: FittedCause) -> FittedCause:
        """Repeats the fit of a cause, beginning at the result `fit`. The effect of the uncertain
        parameters is now computed for the plant with this cause, instead of the released plant."""
        old = fit.problem
        free = {name: Prior(value, 1.0) for name, value in self.centre.items()}
        drops = fit.cause.element.drops if fit.cause.element else ()
        free = {name: one for name, one in free.items() if name not in drops}
        held = {name: value for name, value in old.held.items() if name not in free}
        wide = IncidentProblem(
            old.model, self.data, old.priors | free, held, fit.cause.unknowns, fit.cause.slip_at
        )
        own = len(old.names)
        point = np.concatenate([
            fit.point[:own], np.log([one.value for one in free.values()]), fit.point[own:],
        ])  # fmt: skip
        _, matrix = searching.derivatives(wide, point)
        slack = np.zeros_like(self.slack.matrix)
        for i, name in enumerate(free, own):
            slack[:, self.names.index(name)] = matrix[: len(slack), i]
        problem = IncidentProblem(
            old.model, self.data, old.priors, old.held, fit.cause.unknowns, fit.cause.slip_at,
            Slack(slack, self.slack.inverse),
        )  # fmt: skip
        point, cost = descended(problem, fit.point)
        return replace(fit, problem=problem, point=point, cost=cost)

    def _begun(self, problem: IncidentProblem, start: tuple[float, ...]) -> Floats:
        """Returns the point at which a fit begins. It is the point of the released machine, with
        the start values `start`."""
        point = problem.centre.copy()
        known = dict(zip(self.problem.unknowns, self.fit.point.tolist(), strict=True))
        for i, unknown in enumerate(problem.unknowns, len(problem.names)):
            point[i] = known.get(unknown, 0.0)
        if start:
            point[len(point) - len(start) :] = start
        return point

    def parameters(self, fit: FittedCause) -> dict[str, float]:
        """Returns the most likely values of the uncertain parameters of the released machine, for
        the fit of a cause."""
        logs = fit.problem.slack_logs(fit.problem.residuals(fit.point[None]))[0]
        return {name: self.centre[name] * float(np.exp(log))
                for name, log in zip(self.names, logs, strict=True)}  # fmt: skip

    def causes(self) -> list[Cause]:
        """Returns all possible causes to fit, except the cause that the released machine has only
        followed its command."""
        scales = contact_elements.Scales(self.problem, self.fit.point)
        expected = self.problem.predict(self.fit.point[None]).force
        scales.force_N = max(scales.force_N, float(np.ptp(expected)), FORCE_MIN_N)
        scales.overlap_m = scales.force_N / scales.stiffness
        found = [
            _sensor("sensor gain", "the gain of the force sensor is off",
                    Unknown("gain", -1, 1.0, GAIN_DEVIATION), (-0.8, 0.8, 2.0)),
            _sensor("sensor offset", "the zero of the force sensor is off",
                    Unknown("offset", -1, 0.0, scales.force_N), (0.0,)),
            self._place(),
            _sensor("encoder scale", "the encoder has another scale",
                    Unknown("scale", -1, 1.0, SCALE_DEVIATION), (-0.7, 0.7)),
            self._slip(), *self._stiffness(), *self._drive(),
        ]  # fmt: skip
        for make in (contact_elements.lag, contact_elements.backlash, contact_elements.friction):
            element = make(scales)
            if element is not None:
                count = len(element.units)
                found.append(Cause(element.name, element.text, count, element=element))
        return found

    def _place(self) -> Cause:
        """Returns the cause "the workpiece is at another position". The fit begins at the position
        of the first contact. Without a contact, it begins at the farthest position that the axis
        has reached."""
        touch, known = self.data.touches[0], float(self.problem.places[0])
        assert touch.position is not None
        reached = float(np.interp(touch.onset, touch.position.at, touch.position.values))
        travel = reached - incident_problem.start_place(self.path, self.held)
        off = (gap_of(self.path, self.held) - travel) / PLACE_DEVIATION_M
        return _sensor(
            "workpiece place", "the workpiece is nearer or farther, or the axis is homed elsewhere",
            Unknown("place", 0, known, PLACE_DEVIATION_M), (off, off - 0.05),
        )  # fmt: skip

    def _slip(self) -> Cause:
        """Returns the cause "the encoder loses counts at one instant". This instant is the sample
        at which a single step explains the residuals of the position best."""
        problem = self.problem
        predicted = problem.predict(self.fit.point[None])
        weight = problem.position.spread**-2
        residual = (problem.position.values - predicted.position[0]) * weight
        sums = np.cumsum(residual[::-1])[::-1]
        steps = sums / np.cumsum(weight[::-1])[::-1]
        at = int(np.argmax((sums * steps)[1:])) + 1
        deviation = max(abs(float(steps[at])), 10 * float(problem.position.spread[at]))
        cause = _sensor(
            "encoder slip", "the encoder jumps by counts at one instant",
            Unknown("slip", -1, 0.0, deviation), (float(steps[at]) / deviation,),
        )  # fmt: skip
        return replace(cause, slip_at=float(problem.position.low[at]), count=2)

    def _stiffness(self) -> list[Cause]:
        """Returns the cause "the workpiece has another stiffness". This is the stiffness of the
        spring behind the contact, or of the contact itself."""
        tables = model_file.read(self.path)
        behind = [s for s in tables.springs if tables.workpiece and tables.workpiece in s.between]
        kind, name = ("spring", behind[0].name) if behind else ("contact", tables.contacts[0].name)
        text = "the workpiece is stiffer or softer"
        return self._key("workpiece stiffness", text, (kind, name, "stiffness"), (2.0, 0.5))

    def _drive(self) -> list[Cause]:
        key = DRIVE_KEYS.get(model_file.read(self.path).drive.type, "")
        return self._key("drive gain", "the drive has another gain", ("drive", "", key), (0.7, 1.4))

    def _key(
        self, cause: str, text: str, where: tuple[str, str, str], factors: tuple[float, ...]
    ) -> list[Cause]:
        """Returns the cause "a value of the model has changed" for one key. `where`: kind of the
        element, its name, and the key. Returns no cause if the key does not have a single value
        above 0."""
        kind, name, key = where
        given = _named(model_file.document(self.path), kind, name).get(key)
        known = linear.facts(str(self.path), self.held).parameters
        value = None if given is None or isinstance(given, list) else working.number(given, known)
        if value is None or value <= 0:
            return []
        is_parameter = isinstance(given, str) and given in known
        number = f"{CHANGED}{given if is_parameter else key}"
        unit = known[given].unit if is_parameter else UNITS[key]

        def add(document: Document) -> None:
            _named(document, kind, name)[key] = number

        released = float(value)
        starts = tuple({number: released * factor} for factor in factors)
        drops = (str(given),) if is_parameter else ()
        element = Element(cause, text, add, starts, {number: unit}, drops)
        return [Cause(cause, text, 1, element=element, released={number: released})]


def _sensor(name: str, text: str, unknown: Unknown, starts: tuple[float, ...]) -> Cause:
    return Cause(name, text, 1, (unknown,), starts, released={unknown.kind: unknown.mean})


def log_covariance(samples: Floats) -> Floats:
    """Returns the covariance matrix of the logarithms of samples, which have one row for each
    sample. The day-to-day variation of a machine is added."""
    found = np.atleast_2d(np.cov(np.log(samples), rowvar=False))
    return np.asarray(found + POSTERIOR_SPREAD_MIN**2 * np.eye(len(found)))
