"""Likelihood of recorded touch-downs for many plants at once.

The recorded command is the input of the simulated plant, so that no control law is needed. In
addition to the fitted parameters, each touch-down has its own unknowns: the position of the axis
before it (`place`), the error of the encoder, which is a fraction of a count (`count`), and the
error of the times of a force sensor that has its own clock (`late`, in time steps). If no
command was recorded, the speed at the start and the command are also unknowns. The zero of the
force sensor is one more unknown, which all touch-downs have in common.
"""

import hashlib
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomlkit
from numpy.typing import NDArray
from scipy import signal

from forceaxis import _core, linear, toml
from forceaxis._core import InputError
from forceaxis.commission.contact_data import ContactData, Floats, Samples, TouchDown
from forceaxis.commission.contact_timing import sinc_weights
from forceaxis.commission.contact_workers import ContactsOrder, ContactWorkers
from forceaxis.commission.known import Prior
from forceaxis.design import model_file
from forceaxis.experiments.workers import Workers
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.posterior import ModelError

LOG_MAX = 300.0  # largest magnitude of the logarithm of a parameter
# residual, in standard deviations, that is used for a plant that cannot be simulated
WORST_RESIDUAL = 1e5
PLACE_DEVIATION_M = 1e-3  # prior standard deviation in m of the position of the axis
# prior standard deviation of the zero of the force, divided by the range of the recorded force
ZERO_SHARE = 0.01
# REST_STEPS: largest motion of an axis at rest, in steps of the encoder.
# REST_DEVIATIONS: largest motion of an axis at rest, in standard deviations of the position noise.
REST_STEPS, REST_DEVIATIONS = 1.5, 6.0
LATE_MIN = 0.02  # smallest error of the times of a force, in time steps, that is an unknown
START_VALUES = 3  # number of start values in _core.Contacts: shift in m, speed in m/s, command in V
# Function simulate(values, starts), which returns the same readings as _core.Contacts.run().
Simulate = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True)
class Unknown:
    """An unknown number that is fitted in addition to the parameters of the model, with a normal
    prior. `kind`: "zero", "place", "count", "late", "speed" or "volts". `touch`: number of the
    touch-down, or -1 if it belongs to all."""

    kind: str
    touch: int
    mean: float
    deviation: float


@dataclass(frozen=True)
class Predicted:
    """Simulated signals of all touch-downs for n points: force in N and position in m at the times
    of the recorded samples. Each array has one row for each point, and one column for each sample
    of all touch-downs. `valid`: for each point, False if its plant cannot be simulated."""

    force: Floats
    position: Floats
    valid: NDArray[np.bool_]


def moved_bodies(model: str | Path) -> list[str]:
    """Returns the names of the bodies that move with the drive while all contacts are open."""
    tables = model_file.read(model)
    moved = {linear.facts(model).required_drive.body}
    links = (*tables.springs, *tables.dampers, *tables.backlashes)
    while more := {
        end for link in links if moved & set(link.between) for end in link.between
    } - moved - {"ground"}:  # fmt: skip
        moved |= more
    return sorted(name for name in moved if name)


def gap_of(model: str | Path, held: Overrides) -> float:
    """Returns the distance in m by which the axis of a model moves from its start position to the
    contact. Raises InputError for a model without a contact."""
    contacts = model_file.read(model).contacts
    if not contacts:
        raise InputError(f"{model}: contact: expected a model with a contact, got none")
    plant = _core.Plant(str(model), dict(held))
    return min(-float(plant.signal(f"{contact.name}.deflection")) for contact in contacts)


def with_open_brake(model: str | Path, data: ContactData, held: Overrides) -> Overrides:
    """Returns `held` with brakes that open at the first recorded motion, if this is earlier than
    the model says. The simulation enables the drive at its start, and a recording often begins
    later."""
    rests = min((_rest_steps(touch) for touch in data.touches), default=math.inf) / data.rate_hz
    known = linear.facts(str(model), held).parameters
    times = [row.get("release") for row in toml.read(linear.find_model(model)).get("brake", ())]
    found = {name: known[name].value for name in times if name in known}
    return {**held, **{name: rests for name, value in found.items() if rests < value}}


def _rest_steps(touch: TouchDown) -> float:
    """Returns the time step of the plant up to which a touch-down has rested from its start."""
    if touch.speed[0]:
        return 0.0
    if touch.position is None:
        return math.inf
    values = touch.position.values
    moved = np.abs(values - values[0]) > max(
        REST_STEPS * touch.position.step, REST_DEVIATIONS * touch.position.noise
    )
    return float(touch.position.at[max(0, int(moved.argmax()) - 1)]) if moved.any() else math.inf


def _simulation(model: Path, order: ContactsOrder, site: int | Workers) -> Simulate:
    # A wrong model is refused here, before the long computation on the workers.
    here = order.on(model)
    if isinstance(site, Workers):
        return ContactWorkers(site, order)
    return lambda values, starts: here.run(values, starts, site)


class ContactProblem:
    """Likelihood of recorded touch-downs for plants with different parameters.

    A point is a vector. It begins with the logarithms of the parameters, in the order of `priors`.
    Then follows each of the `unknowns`, as the distance from its mean in standard deviations.
    `priors`: prior of each parameter, which is a normal distribution of its logarithm. `site`:
    number of threads that simulate, or workers of a Dask scheduler. The result does not depend on
    `site`. `errors`: {kind: error of the model}, which with_errors() sets; without them, all
    residuals are noise.
    """

    def __init__(
        self,
        model: str | Path,
        data: ContactData,
        priors: dict[str, Prior],
        held: Overrides,
        site: int | Workers = 1,
    ) -> None:
        self.model, self.data, self.priors = Path(model), data, priors
        self.held, self.site = held, site
        self.errors: dict[str, ModelError] = {}
        gap = gap_of(self.model, held)
        self.places = np.array([gap - touch.travel for touch in data.touches])
        self.names = tuple(priors)
        self.unknowns = self._unknowns()
        self.centre = np.array(
            [math.log(p.value) for p in priors.values()] + [0.0] * len(self.unknowns)
        )
        self.spread = np.array([p.spread for p in priors.values()] + [1.0] * len(self.unknowns))
        self.order = ContactsOrder(
            tomlkit.dumps(model_file.document(self.model)), self.held, tuple(priors),
            tuple(moved_bodies(self.model)), tuple(touch.volts for touch in data.touches),
            data.parts,
        )  # fmt: skip
        reading = linear.facts(str(model), held).reading
        sampling = reading.sampling if reading else None
        #: weights of the sinc filter of the force sensor, or None
        self.filter = (
            sinc_weights(sampling.sinc_order, sampling.period_s * data.rate_hz)
            if sampling and sampling.sinc_order
            else None
        )
        self.force = Joined([t.force for t in data.touches], [len(t.volts) for t in data.touches])
        self.position = Joined(
            [t.position for t in data.touches], [len(t.volts) for t in data.touches]
        )
        self._choose_brake()
        self.simulate = _simulation(self.model, self.order, site)
        self.parts: tuple[ErrorPart, ...] = ()
        self.calls, self.counting = 0, threading.Lock()

    def _choose_brake(self) -> None:
        """Opens the brakes of the model at the first recorded motion, if the position before the
        contact then agrees better with the model. It does not if the drive has pulled the axis
        through its brake."""
        held = with_open_brake(self.model, self.data, self.held)
        if held == self.held:
            return
        opened = replace(self.order, held=held)
        if self._free_misfit(opened) < self._free_misfit(self.order):
            self.held, self.order = held, opened

    def _free_misfit(self, order: ContactsOrder) -> float:
        """Returns the sum of squares of the errors of the free motion at the centre of the priors,
        in m^2."""
        point = self.centre[None]
        rows = order.on(self.model).run(self.values(point), self.starts(point), 1)[0, 1]
        total = 0.0
        for i, begin, end in self.position.parts:
            free = (
                self.position.exact[begin:end]
                < self.position.ends[i][0] + self.data.touches[i].onset
            )
            measured = self.position.values[begin:end][free]
            moved = self.position.at(rows[None])[0, begin:end][free]
            off = measured - measured[:1] - moved + moved[:1]
            total += float(np.sum(off**2))
        return total

    def rows_of(self, touch: int) -> NDArray[np.int_]:
        """Returns the numbers of the residuals of force and position of a touch-down."""
        found, first = [], 0
        for joined in (self.force, self.position):
            found += [
                np.arange(first + begin, first + end)
                for i, begin, end in joined.parts
                if i == touch
            ]
            first += len(joined.values)
        return np.concatenate(found)

    def whitened(self, predicted: Predicted) -> Floats:
        """Returns the residuals of force and position, divided by the square root of the covariance
        of noise and errors of the model, with one row for each point."""
        parts = [self.force.scaled(predicted.force), self.position.scaled(predicted.position)]
        found = np.concatenate(parts, axis=1)
        for part in self.parts:
            found[:, part.rows] = part.whitened(found[:, part.rows])
        return found

    def with_errors(
        self, errors: Mapping[str, ModelError], parts: Sequence["ErrorPart"]
    ) -> "ContactProblem":
        """Returns the same problem for a model with other errors. `parts`: their covariance in each
        touch-down."""
        found = ContactProblem(self.model, self.data, self.priors, self.held, self.site)
        found.errors, found.parts = dict(errors), tuple(parts)
        found.calls = self.calls
        return found

    @property
    def size(self) -> int:
        """Returns the number of elements of a point: parameters and unknowns."""
        return len(self.centre)

    def key(self, seed: int) -> str:
        """Returns a hash of all data on which samples of the posterior depend."""
        text = [self.model.read_text(encoding="utf-8"), repr(self.priors), repr(self.held), seed,
                repr(self.errors)]  # fmt: skip
        known = hashlib.sha256(repr([_core.SIMULATOR_HASH, *text]).encode())
        for touch in self.data.touches:
            known.update(np.ascontiguousarray(touch.volts).tobytes())
        for joined in (self.force, self.position):
            known.update(joined.values.tobytes() + joined.spread.tobytes())
        return known.hexdigest()

    def shorter(self, steps_after: int) -> "ContactProblem":
        """Returns the same problem of an exact model with shortened touch-downs. Each touch-down
        ends `steps_after` time steps after its onset."""
        touches = tuple(t.until(int(t.onset) + steps_after) for t in self.data.touches)
        data = replace(self.data, touches=touches)
        return ContactProblem(self.model, data, self.priors, self.held, self.site)

    def _unknowns(self) -> list[Unknown]:
        touches = self.data.touches
        top = max(float(np.ptp(t.force.values)) for t in touches)
        found = [Unknown("zero", -1, 0.0, max(touches[0].force.step, ZERO_SHARE * top))]
        for i, touch in enumerate(touches):
            found.append(Unknown("place", i, float(self.places[i]), PLACE_DEVIATION_M))
            if touch.position is not None:
                found.append(Unknown("count", i, 0.0, touch.position.spread))
            if touch.late > LATE_MIN:
                found.append(Unknown("late", i, 0.0, touch.late / math.sqrt(3)))
            for kind, (mean, deviation) in (("speed", touch.speed), ("volts", touch.held)):
                if deviation > 0:
                    found.append(Unknown(kind, i, mean, deviation))
        return found

    def number(self, kind: str, touch: int, points: Floats, known: float = 0.0) -> Floats:
        """Returns the value of an unknown in SI units for each point. If the problem does not have
        this unknown, the value is `known`."""
        for i, unknown in enumerate(self.unknowns):
            if (unknown.kind, unknown.touch) == (kind, touch):
                scaled = points[:, len(self.names) + i]
                return np.asarray(unknown.mean + unknown.deviation * scaled)
        return np.full(len(points), known)

    def values(self, points: Floats) -> Floats:
        """Returns the parameters of the model in SI units, with one row for each point."""
        return np.exp(np.clip(points[:, : len(self.names)], -LOG_MAX, LOG_MAX))

    def starts(self, points: Floats) -> Floats:
        """Returns the start values of _core.Contacts for each point and each touch-down."""
        count = len(self.data.touches)
        starts = np.zeros((len(points), count, START_VALUES))
        for i in range(count):
            starts[:, i, 0] = self.number("place", i, points)
            starts[:, i, 1] = self.number("speed", i, points, self.data.touches[i].speed[0])
            starts[:, i, 2] = self.number("volts", i, points)
        return starts

    def responses(self, point: Floats, changes: Sequence[Floats]) -> Floats:
        """Returns the change of force and position by a change of the command, in standard
        deviations of the noise. `changes`: for each touch-down the change in V of the command, with
        one row for each time step and one column for each of k changes. The result has one row for
        each residual and one column for each change."""
        count = changes[0].shape[1]
        volts = [
            touch.volts + change[:, k] for k in range(count)
            for touch, change in zip(self.data.touches, changes, strict=True)
        ]  # fmt: skip
        moved = _simulation(self.model, replace(self.order, volts=tuple(volts)), self.site)
        starts = np.tile(self.starts(point[None]), (1, count, 1))
        values = self.values(point[None])
        steps = sum(len(touch.volts) for touch in self.data.touches)
        rows = moved(values, starts)[0].reshape(2, count, steps)
        rows = rows - self.simulate(values, self.starts(point[None]))[0][:, None, :]
        self.calls += count + 1
        force = self.force.at(self.sensed(rows[0])) / self.force.spread
        place = self.position.at(rows[1])
        for i, begin, end in self.position.parts:
            place[:, begin:end] -= rows[1][:, self.position.first_row[i], None]
        place = place / self.position.spread
        return np.asarray(np.concatenate([force, place], axis=1).T)

    def sensed(self, rows: Floats) -> Floats:
        """Returns the force behind the filter of the sensor's converter. `rows`: the force before
        the filter at all time steps of all touch-downs, with one row for each simulation."""
        if self.filter is None:
            return rows
        ends = np.cumsum([len(touch.volts) for touch in self.data.touches])[:-1]
        found = []
        for part in np.split(rows, ends, axis=1):
            # Before its start, the force has had its first value.
            found.append(signal.lfilter(self.filter, 1.0, part - part[:, :1]) + part[:, :1])
        return np.concatenate(found, axis=1)

    def predict(self, points: Floats) -> Predicted:
        """Simulates all touch-downs for each point."""
        rows = self.simulate(self.values(points), self.starts(points))
        with self.counting:
            self.calls += len(points)
        valid = np.asarray(np.isfinite(rows).all(axis=(1, 2)))
        rows = np.where(valid[:, None, None], rows, 0.0)
        late = [self.number("late", i, points) for i in range(len(self.data.touches))]
        force = self.force.at(self.sensed(rows[:, 0]), late)
        force = force + self.number("zero", -1, points)[:, None]
        place = self.position.at(rows[:, 1])
        for i, begin, end in self.position.parts:
            touch = self.data.touches[i]
            start = rows[:, 1, self.position.first_row[i]]
            assert touch.position is not None
            moved = touch.position.values[0] - start + self.number("count", i, points)
            place[:, begin:end] += moved[:, None]
        return Predicted(force, place, valid)

    def posterior_log(self, points: Floats) -> Floats:
        """Returns the logarithm of the posterior density, up to a constant, for each point."""
        return np.asarray(-0.5 * np.sum(self.residuals(points) ** 2, axis=1))

    def residuals_of(self, touch: int, number: int) -> Floats:
        """Returns a mask over all residuals. It is True for the residuals of a touch-down, and for
        the residual of the prior of one element of the point. `number`: index of this element."""
        own = np.arange(self.size) == number
        masks = []
        for joined in (self.force, self.position):
            mask = np.zeros(len(joined.values), dtype=bool)
            for i, begin, end in joined.parts:
                mask[begin:end] = touch in (i, -1)
            masks.append(mask)
        return np.concatenate([*masks, own])

    def residuals(self, points: Floats) -> Floats:
        """Returns the residuals of force, position and prior in standard deviations of noise and
        errors of the model, with one row for each point. Half the sum of squares of a row is the
        negative logarithm of the posterior density."""
        predicted = self.predict(points)
        prior = (self.centre - points) / self.spread
        found = np.concatenate([self.whitened(predicted), prior], axis=1)
        found[~predicted.valid] = WORST_RESIDUAL
        return found


@dataclass(frozen=True)
class ErrorPart:
    """The errors of the model in one touch-down. `rows` (n,): numbers of its residuals. Divided by
    the deviation of the noise, the errors have the covariance V diag(`sizes`) V', where V are the
    `vectors` (n, k)."""

    rows: NDArray[np.int_]
    vectors: Floats
    sizes: Floats

    def whitened(self, scaled: Floats) -> Floats:
        """Returns residuals divided by the square root of the covariance of noise and error.
        `scaled`: residuals divided by the noise, with one row for each point."""
        shrunk = 1 - 1 / np.sqrt(1 + self.sizes)
        return np.asarray(scaled - (scaled @ self.vectors * shrunk) @ self.vectors.T)


class Joined:
    """The samples of one signal in all touch-downs, in one array. `parts`: for each touch-down that
    has the signal, its number, the index of its first sample, and the index after its last sample.
    `free`: for each of these touch-downs, the number of samples from which the noise was
    computed."""

    def __init__(self, each: list[Samples | None], steps: list[int]) -> None:
        first = np.concatenate([[0], np.cumsum(steps)]).astype(int)
        self.parts: list[tuple[int, int, int]] = []
        self.first_row: dict[int, int] = {}
        self.free: list[int] = []
        rows, values, spread = [], [], []
        end = 0
        for i, samples in enumerate(each):
            if samples is None:
                continue
            size = len(samples.at)
            self.free.append(samples.free)
            self.parts.append((i, end, end + size))
            end += size
            at = np.clip(samples.at, 0, steps[i] - 1)
            self.first_row[i] = int(first[i] + round(float(at[0])))
            rows.append(first[i] + at)
            values.append(samples.values)
            spread.append(samples.deviations)

        def joined(parts: list[Floats]) -> Floats:
            return np.concatenate(parts) if parts else np.zeros(0)

        at = joined(rows)
        self.low = np.floor(at + 1e-9).astype(int)
        self.share = np.clip(at - self.low, 0.0, 1.0)
        self.on_rows = bool(np.all(self.share < 1e-6))
        self.high = self.low if self.on_rows else np.minimum(self.low + 1, first[-1] - 1)
        self.values, self.spread = joined(values), joined(spread)
        self.exact, self.ends = (
            at,
            [(int(first[i]), int(first[i + 1]) - 1) for i in range(len(each))],
        )

    def at(self, rows: Floats, late: Sequence[Floats] = ()) -> Floats:
        """Returns the simulated signal at the times of the samples, by interpolation. `rows` has
        the values of the signal at all time steps, with one row for each point. `late` has for each
        touch-down the time steps by which the samples of each point are later."""
        if any(np.any(one) for one in late):
            found = np.empty((len(rows), len(self.values)))
            for i, begin, end in self.parts:
                at = np.clip(self.exact[begin:end] + late[i][:, None], *self.ends[i])
                low = np.minimum(at.astype(int), self.ends[i][1] - 1)
                left = np.take_along_axis(rows, low, axis=1)
                right = np.take_along_axis(rows, low + 1, axis=1)
                found[:, begin:end] = left + (at - low) * (right - left)
            return found
        if self.on_rows:
            return np.asarray(rows[:, self.low])
        low = rows[:, self.low]
        return np.asarray(low + self.share * (rows[:, self.high] - low))

    def scaled(self, predicted: Floats) -> Floats:
        """Returns the differences between recorded and predicted samples in standard deviations."""
        return np.asarray((self.values - predicted) / self.spread)
