"""The likelihood of the recorded second before a fault. This second is treated as a touch-down of a
machine whose plant or sensors may have changed.

The recorded DAC codes are the input of the simulated plant. A change of the plant is an element of
the model. A change of a sensor is an additional unknown. The likelihood is therefore that of
forceaxis.commission.contact_likelihood.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomlkit

from forceaxis import _core, linear
from forceaxis._core import TICKS_PER_SECOND, InputError
from forceaxis.commission import contact_data, contact_timing
from forceaxis.commission.contact_data import SPEED_SHARE, ContactData, Floats, Samples, TouchDown
from forceaxis.commission.contact_likelihood import (
    START_VALUES,
    ContactProblem,
    Predicted,
    Unknown,
    gap_of,
    moved_bodies,
    with_open_brake,
)
from forceaxis.commission.contact_workers import ContactsOrder
from forceaxis.commission.incident import Incident
from forceaxis.commission.known import Prior
from forceaxis.design import model_file
from forceaxis.linear.plant_facts import Overrides, PlantFacts
from forceaxis.recordings.findings import spikes
from forceaxis.recordings.robust import quiet_of, without
from forceaxis.recordings.signal_recording import (
    RecordedSignal,
    RecordingSource,
    SignalRecording,
)

# Standard deviation in m of the position of an axis that is homed as in its model.
PLACE_KNOWN_M = 2e-5
# A contact changes the force by more than TOUCH_DEVIATIONS standard deviations of the free force.
# A contact also changes the force by more than TOUCH_STEPS steps of the converter.
TOUCH_DEVIATIONS, TOUCH_STEPS = 6.0, 2.0
# a recorded second must begin with at least this number of ticks without contact
FREE_TICKS_MIN = 10
RUN_UP_S = 0.1  # time in s after which a velocity loop has settled
REST_TICKS = 4  # the speed at the start is computed from this number of ticks


@dataclass(frozen=True)
class Slack:
    """Effect of the uncertain parameters of the released machine on the residuals of the recorded
    second. `matrix`: derivatives of the residuals with respect to the logarithms of the parameters,
    with one row for each residual. `inverse`: inverse covariance matrix of these logarithms."""

    matrix: Floats
    inverse: Floats

    def fitted(self, residuals: Floats) -> Floats:
        """Returns the changes of the logarithms of the parameters that fit the residuals best.
        `residuals` and the result have one row for each point."""
        square = self.matrix.T @ self.matrix + self.inverse
        return np.asarray(-np.linalg.solve(square, self.matrix.T @ residuals.T).T)


class IncidentProblem(ContactProblem):
    """The likelihood of the second before a fault, for plants and sensors that may have caused it.
    `extra`: additional unknowns. Their kinds are "gain" and "offset" of the force sensor, "place"
    (replaces the known position), and "scale" and "slip" of the encoder. `slip_at`: time step of
    the plant at which the encoder slips. `slack`: effect of the uncertain parameters of the
    released machine. For each point, their best values are computed with a linear approximation, so
    that no additional plant has to be simulated."""

    def __init__(
        self,
        model: str | Path,
        data: ContactData,
        priors: dict[str, Prior],
        held: Overrides,
        extra: Sequence[Unknown] = (),
        slip_at: float = 0.0,
        slack: Slack | None = None,
    ) -> None:
        self.extra, self.slip_at, self.slack = tuple(extra), slip_at, slack
        super().__init__(model, data, priors, held)
        every = self.simulate

        def different(values: Floats, starts: Floats) -> Floats:
            # Unknowns of the sensors change neither the plant nor its start values.
            rows = np.concatenate([values, starts.reshape(len(starts), -1)], axis=1)
            _, first, same = np.unique(rows, axis=0, return_index=True, return_inverse=True)
            return np.asarray(every(values[first], starts[first])[same.reshape(-1)])

        self.simulate = different

    def _unknowns(self) -> list[Unknown]:
        kinds = {unknown.kind for unknown in self.extra}
        found = [
            replace(unknown, deviation=PLACE_KNOWN_M) if unknown.kind == "place" else unknown
            for unknown in super()._unknowns()
            if unknown.kind not in kinds
        ]
        return [*found, *self.extra]

    def changed(self, kind: str, points: Floats, same: float) -> Floats:
        """Returns an unknown of a sensor for each point. If the problem does not have this unknown,
        the value is `same`."""
        if any(unknown.kind == kind for unknown in self.extra):
            return self.number(kind, -1, points)
        return np.full(len(points), same)

    def number(self, kind: str, touch: int, points: Floats, known: float = 0.0) -> Floats:
        """Returns an unknown in SI units for each point. If the encoder has another scale, the axis
        is also at another position at the start."""
        found = super().number(kind, touch, points, known)
        position = self.data.touches[0].position
        if kind != "place" or position is None:
            return found
        scale = self.changed("scale", points, 1.0)
        return np.asarray(found + float(position.values[0]) * (1 / scale - 1))

    def predict(self, points: Floats) -> Predicted:
        """Simulates the second before the fault for each point, and applies the changes of the
        sensors to the signals."""
        found = super().predict(points)
        force = found.force * self.changed("gain", points, 1.0)[:, None]
        force = force + self.changed("offset", points, 0.0)[:, None]
        place = found.position
        for touch, begin, end in self.position.parts:
            samples = self.data.touches[touch].position
            assert samples is not None
            first = place[:, begin : begin + 1]
            moved = (place[:, begin:end] - first) * self.changed("scale", points, 1.0)[:, None]
            slipped = np.where(samples.at >= self.slip_at, 1.0, 0.0)
            place[:, begin:end] = (
                first + moved + self.changed("slip", points, 0.0)[:, None] * slipped
            )
        if self.slack is None:
            return Predicted(force, place, found.valid)
        moved = self.slack.fitted(self._compared(force, place)) @ self.slack.matrix.T
        cut = force.shape[1]
        return Predicted(
            force - moved[:, :cut] * self.force.spread,
            place - moved[:, cut:] * self.position.spread,
            found.valid,
        )

    def _compared(self, force: Floats, place: Floats) -> Floats:
        return np.concatenate([self.force.scaled(force), self.position.scaled(place)], axis=1)

    def residuals(self, points: Floats) -> Floats:
        """Returns the residuals of force, position, prior and released parameters in standard
        deviations, with one row for each point."""
        found = super().residuals(points)
        if self.slack is None:
            return found
        root = np.linalg.cholesky(self.slack.inverse)
        return np.concatenate([found, self.slack_logs(found) @ root], axis=1)

    def slack_logs(self, residuals: Floats) -> Floats:
        """Returns the changes of the logarithms of the released parameters that belong to
        residuals(), with one row for each point. For the best changes d, J' r + K d = 0."""
        assert self.slack is not None
        matrix, inverse = self.slack.matrix, self.slack.inverse
        return np.asarray(-np.linalg.solve(inverse, matrix.T @ residuals[:, : len(matrix)].T).T)

    def residuals_of(self, touch: int, number: int) -> Floats:
        """Returns an array with the single value True, because all residuals belong to the only
        touch-down."""
        return np.ones(1)


def start_place(model: str | Path, held: Overrides) -> float:
    """Returns the position in m that the encoder of a model shows at the start."""
    simulated = _core.Contacts(str(model), dict(held), [], [], [np.zeros(1)], 1)
    rows = simulated.run(np.zeros((1, 0)), np.zeros((1, 1, START_VALUES)))
    return float(rows[0, 1, 0])


def _recorded(incident: Incident, used: slice, facts: PlantFacts) -> SignalRecording:
    """Returns force in N, position in m and command in V of the first ticks of an incident."""
    counts, codes = incident.column("position"), incident.column("dac_code")
    columns = {
        "force": incident.force_N[used],
        "position": counts[used] / facts.required_encoder.scale,
        "code": codes[used] * float(facts.volts_per_code),
    }
    signals = tuple(
        RecordedSignal(
            name, "1", name, "1", 1.0, 1, TICKS_PER_SECOND,
            time_s=np.arange(len(values)) / TICKS_PER_SECOND, values=np.asarray(values, float),
        )
        for name, values in columns.items()
    )  # fmt: skip
    return SignalRecording("incident", RecordingSource(incident.where, "incident", "", 0), signals)


def data_of(incident: Incident, model: str | Path, held: Overrides) -> ContactData:
    """Converts the ticks of an incident before its fault to the form that the likelihood needs.
    Raises InputError if the recording begins in contact."""
    facts = linear.facts(str(model), held)
    used = slice(0, incident.recording.trigger_sample + 1)
    ticks = np.arange(incident.recording.trigger_sample + 1, dtype=float)
    force_N = incident.force_N[used]
    step = incident.force.count_N * 2.0 ** (8 - incident.force.adc_bits)
    # A disturbance of the sensor is no contact.
    rest_N = without(force_N, spikes("force", ticks / TICKS_PER_SECOND, force_N))
    first = rest_N[:FREE_TICKS_MIN]
    quiet = quiet_of(first, step)
    limit = max(TOUCH_DEVIATIONS * quiet.noise, TOUCH_STEPS * step)
    touching = incident.force.contact_force * incident.force.count_N + limit
    if len(force_N) < FREE_TICKS_MIN or float(first[quiet.usual].max()) > touching:
        raise InputError(
            f"{incident.where}: expected an incident whose recording begins out of contact, got "
            f"a recording of {len(force_N)} ticks that begins with a force of {force_N[0]:.3g} N; "
            "only a recording that begins out of contact can be explained"
        )
    is_touched = np.abs(rest_N - float(np.median(first))) > limit
    is_touched[: len(first)] &= quiet.usual
    touched = np.flatnonzero(is_touched)
    onset = int(touched[0]) if len(touched) else len(force_N) - 1
    noise, count = contact_data.noise_of(rest_N[:onset], step)
    scale = facts.required_encoder.scale
    recorded, late_s = contact_timing.at_instants(_recorded(incident, used, facts), facts)
    parts = contact_data.parts_of(facts)
    rate = float(TICKS_PER_SECOND * parts)

    def samples(name: str, step: float, noise: float, free: int = 0, seen: float = 0.0) -> Samples:
        # Samples before the first tick are left out, because the simulation begins there.
        signal = recorded[name]
        at = np.round(signal.time_s * rate, 6)
        return Samples(at[at >= 0], signal.values[at >= 0], step, noise, free, seen)

    force = samples("force", step, noise, count, quiet_of(rest_N[:onset], step).noise)
    count_m = abs(1 / scale)
    position = samples("position", count_m, contact_data.LEAST_NOISE_STEPS * count_m)
    shift = float(position.values[0]) - start_place(model, held)
    early = slice(max(2, int(np.count_nonzero(position.at < REST_TICKS * parts))))
    speed = float(np.polyfit(position.at[early], position.values[early], 1)[0]) * rate
    slowest = position.step * TICKS_PER_SECOND / REST_TICKS
    if abs(speed) <= slowest:
        speed = 0.0
    steps = np.arange((len(ticks) - 1) * parts + 1) / rate
    # The black box has codes of 12 bits. For a finer output, each code has a rounding error.
    is_fine = facts.volts_per_step < facts.volts_per_code
    rounding = float(facts.volts_per_code) / math.sqrt(12) if is_fine else 0.0
    touch = TouchDown(
        "incident", recorded.held("code", steps), float(onset * parts), force,
        position, gap_of(model, held) - shift, (speed, max(SPEED_SHARE * abs(speed), slowest)),
        held=(0.0, rounding), late=late_s * rate,
    )  # fmt: skip
    if speed and facts.required_drive.type == "velocity":
        touch = _run_up(touch, model, held, rate)
    return ContactData((touch,), parts)


def _run_up(touch: TouchDown, model: str | Path, held: Overrides, rate: float) -> TouchDown:
    """Leaves out the first samples of an axis that a velocity loop already moves. The loop begins
    the simulation without the force that friction needs, and the axis falls behind. The start is
    moved by this distance."""
    begin = round(RUN_UP_S * rate)
    if begin >= touch.onset:
        return touch
    assert touch.position is not None
    moved = moved_bodies(model)
    order = ContactsOrder(
        tomlkit.dumps(model_file.document(Path(model))),
        with_open_brake(model, ContactData((touch,), round(rate / TICKS_PER_SECOND)), held),
        (), tuple(moved), (touch.volts[: begin + 1],), round(rate / TICKS_PER_SECOND),
    )  # fmt: skip
    start = np.array([[[gap_of(model, held) - touch.travel, touch.speed[0], 0.0]]])
    rows = order.on(Path(model)).run(np.zeros((1, 0)), start, 1)[0, 1]
    went = np.interp(begin, touch.position.at, touch.position.values) - touch.position.values[0]
    behind = float(went) - float(rows[begin] - rows[0])
    later = touch.until(len(touch.volts), begin)
    return replace(later, travel=touch.travel - behind)
