"""Compares recordings of a real machine with the predictions of an experiment.

Measured and predicted signals are aligned at the first contact. A figure is a number about a
contact, such as its peak force. Each measured figure is compared with a band around the predicted
one. The experiment is run for several values of the parameters and several seeds of the noise. So a
band contains the uncertainty of the parameters, the noise of the recording, and the resolution of
its samples. If the machine is as the model says, all bands of a recording together hold 95 % of the
recordings.
"""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from forceaxis import paths, progress
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.experiments.prediction import (
    TICK_S,
    Columns,
    PredictionRequest,
    Predictor,
    SignalModel,
)
from forceaxis.recordings import signal_recording
from forceaxis.recordings.findings import quantum_of
from forceaxis.recordings.signal_recording import Floats
from forceaxis.recordings.touch import (
    CONTACTS,
    IMPULSE_S,
    ForceLevel,
    figures_of,
    level_of,
    touch_of,
)

# Probability that all measured values of a recording are within their bands.
CONFIDENCE = 0.95
SAMPLES = (8, 2000)  # smallest and largest number of runs
BEFORE_S = 0.05  # signals are compared and drawn from this time in s before the first contact
LEAST_SPAN_S = 0.02
AFTER_S = 0.05  # each run lasts longer than the comparison by this time in s
POINT_BAND = 1.96  # half width of the band of a single sample, in standard deviations
SAME_TICKS = 2  # two first contacts with at most this distance in ticks are simultaneous
# a characteristic value is expected if at least this fraction of the runs has this value
LEAST_SHARE = 0.5


@dataclass(frozen=True)
class ComparedFigure:
    """One characteristic value of a contact, such as its peak force: the measured value, the median
    of the predicted values, and the band in which the measured value is expected. None means that
    the contact has no such value."""

    figure: str
    unit: str
    measured: float | None
    predicted: float | None
    low: float | None
    high: float | None
    agrees: bool  # True if the measured value is within the band, or is missing as expected


@dataclass(frozen=True)
class RecordingComparison:
    """The comparison of one recording with an experiment."""

    recording: str  # file name of the recording
    title: str
    experiment: str
    agrees: bool  # True if all characteristic values are within their bands
    # recorded signal that is the input of the runs, or "law" if the force law controls the runs
    input: str
    touch_s: float  # time of the first contact in the recording, in s
    gap_m: float | None  # gap of the model in m with which a run makes contact at touch_s
    # mean of the measured force in N before the first contact; it is subtracted from all forces
    zero_N: float
    noise_N: float  # standard deviation in N of the noise of the measured force
    runs: int
    span_s: float  # time in s after the first contact up to which signals are compared
    figures: tuple[ComparedFigure, ...]
    # {signal: fraction of its samples that are within the band for a single sample}
    inside: dict[str, float]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ComparedSignal:
    """A signal over the time in s from the first contact, with n values. It has the measured
    values, the predicted values, and the band for a single sample."""

    name: str
    unit: str
    time_s: Floats
    measured: Floats
    predicted: Floats
    low: Floats
    high: Floats

    @property
    def share_inside(self) -> float:
        """Returns the share of the samples after the first contact that are within the band."""
        inside = (self.measured >= self.low) & (self.measured <= self.high)
        return float(inside[self.time_s >= 0].mean())


@dataclass(frozen=True)
class ComparedRecording:
    """The result of a comparison, and the signals for its plot."""

    result: RecordingComparison
    signals: tuple[ComparedSignal, ...]


@dataclass(frozen=True)
class _Figure:
    """A characteristic value of a contact before its band is computed. `runs`: the value in each
    run. `resolution`: error of the value because of the finite sampling rate."""

    figure: str
    unit: str
    measured: float | None
    runs: Sequence[float | None]
    resolution: float = 0.0
    has_low: bool = True  # False if a small value does not count as a difference


@dataclass
class _Measured:
    """The first contact of a recording."""

    where: str
    predictor: Predictor
    touch_s: float  # time of the first contact in the recording
    level: ForceLevel
    notes: list[str] = field(default_factory=list)
    gap_m: float | None = None


# (columns of a simulated run, time in s from tick 0 of the run to its first contact)
_Run = tuple[Columns, float]


def compare(
    request: PredictionRequest, file: Path, span_s: float | None = None
) -> ComparedRecording:
    """Compares one recording with an experiment, up to the time `span_s` in s after the first
    contact. None compares up to the end of the recording or of the runs. Raises InputError,
    ParameterError, SimulationError."""
    if not SAMPLES[0] <= request.samples <= SAMPLES[1]:
        raise ParameterError("samples", f"expected {SAMPLES[0]} to {SAMPLES[1]} runs")
    if span_s is not None and not span_s >= LEAST_SPAN_S:
        raise ParameterError("span", f"expected at least {LEAST_SPAN_S:g} s")
    recording = signal_recording.read(file).even(TICK_S)
    predictor = Predictor.of(request, recording)
    where = paths.display(file)
    force = recording["force"]
    level = level_of(force.values, f"{where}: force")
    touch_s = touch_of(force.true_time_s, force.values, level)
    assert touch_s is not None  # touch_s is never None here, because level_of() has found a contact
    if span_s is not None:
        predictor.until_s = touch_s + span_s + AFTER_S
    measured = _Measured(where, predictor, touch_s, level)
    runs = _runs(measured)
    lasts_s = min(
        float(force.true_time_s[-1]) - touch_s,
        *((len(columns["encoder"]) - 1) * TICK_S - begins_s for columns, begins_s in runs),
        *(() if span_s is None else (span_s,)),
    )
    if lasts_s < LEAST_SPAN_S:
        raise InputError(
            f"{where}: expected at least {LEAST_SPAN_S:g} s after the first contact in recording "
            f"and prediction, got {max(lasts_s, 0):.3g} s; record longer, or raise duration_s"
        )
    return _compared(measured, runs, _grid(measured, runs, lasts_s))


def _runs(measured: _Measured) -> list[_Run]:
    """Returns runs with random values of the parameters. Raises InputError if no run makes
    contact."""
    predictor, request = measured.predictor, measured.predictor.request
    nominal = predictor.run(predictor.nominal, request.seed)
    if predictor.input == "force_setpoint":
        # The recorded set-points act at their recorded times after the first contact.
        found = predictor.touch_s(nominal, measured.level)
        if found is not None:
            predictor.setpoint_shift_s = found - measured.touch_s
    touch_s = measured.touch_s - predictor.start_s
    runs: list[_Run] = []
    without = 0
    for seed, member in progress.each(
        list(enumerate(predictor.members(nominal, measured.level), request.seed)),
        "runs",
        request.samples,
    ):
        own = predictor.with_gap(member, touch_s, measured.level)
        if predictor.is_fed and predictor.gap in own and measured.gap_m is None:
            measured.gap_m = own[predictor.gap]
        columns = predictor.run(own, seed)
        found = predictor.touch_s(columns, measured.level)
        if found is None:
            without += 1
        else:
            runs.append((columns, found))
    if not runs:
        raise InputError(
            f"{paths.display(request.experiment)}: expected a simulated run with a contact, as in "
            "the recording, got simulated runs without contact; correct the gap between axis and "
            "workpiece in the model, or the set-point"
        )
    if without:
        measured.notes.append(f"{without} of {request.samples} runs make no contact")
    late_s = float(np.median([begin for _, begin in runs])) - touch_s
    for finding in predictor.recording["force"].findings:
        if finding.kind != "constant" and finding.to_s >= measured.touch_s:
            measured.notes.append(
                f"{finding.kind} of the force at {finding.from_s:.6g} s: {finding.text}"
            )
    if predictor.is_fed and abs(late_s) > SAME_TICKS * TICK_S:
        measured.notes.append(
            f"the model makes contact {abs(late_s):.3g} s {'after' if late_s > 0 else 'before'} "
            f"the machine, so the recorded {predictor.input} acts at other times of the contact; "
            "give `gap`, the parameter that moves the first contact"
        )
    return runs


def _grid(measured: _Measured, runs: Sequence[_Run], lasts_s: float) -> Floats:
    """Returns the times in s from the first contact at which signals are compared. They are the
    times of the recorded samples, or the ticks if the recording has more than one sample a tick."""
    force = measured.predictor.recording["force"]
    time_s = force.true_time_s - measured.touch_s
    if float(np.median(np.diff(time_s))) < 0.999 * TICK_S:
        first = np.ceil(max(float(time_s[0]), -BEFORE_S) / TICK_S)
        time_s = np.arange(first, np.floor(lasts_s / TICK_S) + 1) * TICK_S
    begins_s = min(begin for _, begin in runs)
    inside = (time_s >= -min(BEFORE_S, begins_s)) & (time_s <= lasts_s + 1e-9)
    return np.asarray(time_s[inside])


def _compared(measured: _Measured, runs: Sequence[_Run], grid: Floats) -> ComparedRecording:
    predictor, level = measured.predictor, measured.level
    recording, request = predictor.recording, predictor.request
    rng = np.random.default_rng(request.seed)
    figures: list[_Figure] = []
    signals: list[ComparedSignal] = []
    for model in predictor.signals:
        name, source = model.name, recording[model.name]
        values = recording.sampled(name, grid + measured.touch_s)
        quantum = quantum_of(source.values)
        floor = quantum / 2
        series = _series(model, runs, grid)
        if name == "force":
            values = values - level.zero
            series += _missing_noise(series, grid, level) * rng.standard_normal(series.shape)
            own = ForceLevel(0.0, level.noise, level.contact)
            figures = _contact_figures(grid, values, series, own, quantum) + figures
        elif name == "position":  # Position 0 of the machine is not position 0 of the model.
            values = values - np.interp(0.0, grid, values)
            # The time of the first contact is uncertain by half a sample.
            floor += 0.5 * float(np.max(np.abs(np.diff(values[abs(grid) <= 3 * TICK_S]))))
        middle = np.median(series, axis=0)
        spread = POINT_BAND * series.std(axis=0) + floor
        signals.append(
            ComparedSignal(name, model.unit, grid, values, middle, middle - spread, middle + spread)
        )
        figures.append(_residual(signals[-1], series, floor))
    judged = _with_bands(figures)
    result = RecordingComparison(
        recording=measured.where, title=recording.title,
        experiment=paths.display(request.experiment),
        agrees=all(one.agrees for one in judged), input=predictor.input,
        touch_s=measured.touch_s, gap_m=measured.gap_m, zero_N=level.zero, noise_N=level.noise,
        runs=len(runs), span_s=float(grid[-1]), figures=judged,
        inside={signal.name: signal.share_inside for signal in signals},
        notes=(*predictor.notes, *measured.notes),
    )  # fmt: skip
    return ComparedRecording(result, tuple(signals))


def _series(model: SignalModel, runs: Sequence[_Run], grid: Floats) -> Floats:
    """Returns one signal of all runs at the times `grid` from the first contact, as an array
    (runs, n)."""
    rows = []
    for columns, begins_s in runs:
        values = model.of(columns)
        time_s = np.arange(len(values)) * TICK_S - begins_s
        at = np.interp(grid, time_s, values)
        if model.name == "position":
            at = at - np.interp(0.0, time_s, values)
        rows.append(at)
    return np.array(rows)


def _missing_noise(series: Floats, grid: Floats, level: ForceLevel) -> float:
    """Returns the standard deviation of that part of the recorded noise that the runs do not have.
    It is computed from the samples before the first contact."""
    before = series[:, grid < -2 * TICK_S]
    own = float(before.std(axis=1).mean()) if before.shape[1] > 4 else 0.0
    return float(np.sqrt(max(0.0, level.noise**2 - own**2)))


def _contact_figures(
    grid: Floats, force: Floats, series: Floats, level: ForceLevel, quantum: float
) -> list[_Figure]:
    """Returns the characteristic values of the contact force, as measured and in all runs."""
    own = figures_of(grid, force, level)
    runs = [figures_of(grid, one, level) for one in series]
    period_s = float(np.median(np.diff(grid)))

    def nth(times: tuple[float, ...], index: int) -> float | None:
        return times[index] if index < len(times) else None

    # The instant of the first contact is uncertain by half a sample.
    impulse = 0.5 * (quantum * IMPULSE_S + period_s * own.peak_N)
    figures = [
        _Figure("peak", "N", own.peak_N, [r.peak_N for r in runs], quantum),
        _Figure("impulse of 25 ms", "N s", own.impulse_N_s, [r.impulse_N_s for r in runs], impulse),
        _Figure("contact losses", "", own.bounces, [r.bounces for r in runs]),
    ]
    for i in range(CONTACTS - 1):
        for text, pick in (("loss", "ends_s"), ("contact", "starts_s")):
            number = i + 1 if text == "loss" else i + 2
            figure = _Figure(
                f"{text} {number}", "s", nth(getattr(own, pick), i),
                [nth(getattr(r, pick), i) for r in runs], period_s,
            )  # fmt: skip
            if figure.measured is not None or _share(figure.runs) > LEAST_SHARE:
                figures.append(figure)
    return [
        *figures,
        _Figure("settling", "s", own.settling_s, [r.settling_s for r in runs], period_s),
        _Figure("held force", "N", own.held_N, [r.held_N for r in runs], quantum / 2),
    ]


def _residual(signal: ComparedSignal, series: Floats, floor: float) -> _Figure:
    """Returns the rms difference between a signal and the median of the runs, after the first
    contact."""
    after = signal.time_s >= 0

    def rms(values: Floats) -> float:
        return float(np.sqrt(np.mean((values - signal.predicted)[after] ** 2)))

    runs = [rms(one) for one in series]
    text = f"residual of {signal.name}"
    return _Figure(text, signal.unit, rms(signal.measured), runs, floor, has_low=False)


def _share(values: Sequence[float | None]) -> float:
    return sum(value is not None for value in values) / len(values)


def _with_bands(figures: Sequence[_Figure]) -> tuple[ComparedFigure, ...]:
    """Returns the characteristic values with their bands. With the probability CONFIDENCE, all
    measured values are within their bands. A band is the range of all runs, or as many standard
    deviations as a normal distribution needs, whichever is wider. The resolution is added to the
    band."""
    tail = (1 - CONFIDENCE) / (2 * len(figures))
    deviations = statistics.NormalDist().inv_cdf(1 - tail)
    return tuple(_with_band(figure, deviations) for figure in figures)


def _with_band(figure: _Figure, deviations: float) -> ComparedFigure:
    known = np.array([value for value in figure.runs if value is not None])
    if _share(figure.runs) < LEAST_SHARE:
        is_rare = figure.measured is None or len(known) > 0
        known = known if figure.measured is not None else np.empty(0)
        if not len(known):
            return ComparedFigure(
                figure.figure, figure.unit, figure.measured, None, None, None, is_rare
            )
    middle = float(np.median(known))
    width = deviations * float(known.std())
    low = min(float(known.min()), middle - width) - figure.resolution
    high = max(float(known.max()), middle + width) + figure.resolution
    low = max(low, 0.0) if figure.unit in ("s", "") else low  # a time or a count is never negative
    low = low if figure.has_low else 0.0
    is_missing = figure.measured is None
    agrees = _share(figure.runs) < 1 if is_missing else low <= (figure.measured or 0.0) <= high
    return ComparedFigure(figure.figure, figure.unit, figure.measured, middle, low, high, agrees)
