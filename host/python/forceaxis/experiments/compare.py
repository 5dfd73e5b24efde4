"""Compares recordings of a real machine with the predictions of an experiment.

Measured and predicted signals are aligned at the first contact. A figure is a number about a
contact, such as its peak force. Each measured figure is compared with a band around the predicted
one. The experiment is run for several values of the parameters and several seeds of the noise. So a
band contains the uncertainty of the parameters, the noise of the recording, and the resolution of
its samples. If the machine is as the model says, all bands of a recording together hold 95 % of the
recordings.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import special

from forceaxis import paths, progress
from forceaxis._core import InputError
from forceaxis.errors import ParameterError
from forceaxis.experiments.prediction import (
    TICK_S,
    Columns,
    PredictionRequest,
    Predictor,
    SignalModel,
    TouchArea,
)
from forceaxis.linear.posterior import ModelError
from forceaxis.recordings import model_error, signal_recording
from forceaxis.recordings.findings import quantum_of, spike_notes
from forceaxis.recordings.model_error import ErrorSize
from forceaxis.recordings.signal_recording import Floats
from forceaxis.recordings.touch import (
    CONTACTS,
    IMPULSE_S,
    ForceLevel,
    Touch,
    figures_of,
    first_touch,
    level_of,
)

# Probability that all measured values of a recording are within their bands.
CONFIDENCE = 0.95
SAMPLES = (8, 2000)  # smallest and largest number of runs
BEFORE_S = 0.05  # signals are compared and drawn from this time in s before the first contact
LEAST_SPAN_S = 0.02
AFTER_S = 0.05  # time in s by which each run lasts longer than the comparison
POINT_BAND = 1.96  # half width of the band of a single sample, in standard deviations
AREA_SAMPLES = 3  # number of samples of the first contact from which the gap of a run is found
SAME_TICKS = 2  # two first contacts with at most this distance in ticks are simultaneous
NEEDED_SHARES = tuple(
    float(f"{0.0005 * 1.25**i:.2g}") for i in range(28)
)  # shares of an error of the model that are tried, from small to large
# smallest share of the runs with a characteristic value that is then expected in a recording
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
    # {signal: error of the model} that the bands contain
    model_error: dict[str, ErrorSize]
    # {signal: smallest error of the model} with which all characteristic values would agree.
    # The result is {} if the values agree already, or if all errors in NEEDED_SHARES are too small.
    needed_error: dict[str, ErrorSize]
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
    # False if a difference of a small characteristic value from the prediction is ignored
    has_low: bool = True


@dataclass
class _Measured:
    """The first contact of a recording. `area`: integral of the force over the first samples of
    the contact. `slope_N_per_s`: slope of the force in these samples. `bend_N`: largest error of
    the force there, if it is interpolated by a line between two ticks of a run."""

    where: str
    predictor: Predictor
    touch_s: float  # time of the first contact in the recording
    level: ForceLevel
    area: TouchArea
    slope_N_per_s: float
    bend_N: float
    notes: list[str]
    gap_m: float | None = None

    @property
    def period_s(self) -> float:
        """Returns the time in s between two samples of the force."""
        return float(np.median(np.diff(self.predictor.recording["force"].true_time_s)))

    @property
    def start_s(self) -> float:
        """Returns the time in s from tick 0 of a run to the first contact of the recording."""
        return self.touch_s - self.predictor.start_s


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
    level = level_of(force.true_time_s, force.values, f"{where}: force")
    time_s = predictor.sample_times() if predictor.is_fed else force.true_time_s
    sampled = recording.sampled("force", time_s)
    found = first_touch(time_s, sampled, level)
    if found is None:
        raise InputError(
            f"{where}: expected a contact that lasts for a tick of {TICK_S:.3g} s, got a shorter "
            "one; record a contact that is held"
        )
    touch_s = found.time_s
    if span_s is not None:
        predictor.until_s = touch_s + span_s + AFTER_S
    measured = _measured(where, predictor, (time_s, sampled - level.zero), level, found)
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


def _measured(
    where: str, predictor: Predictor, force: tuple[Floats, Floats], level: ForceLevel, found: Touch
) -> _Measured:
    """Returns the first contact of a recording. `force`: times, and forces above the zero."""
    time_s, above = force
    after = min(max(int(np.searchsorted(time_s, found.time_s)), 1), len(time_s) - 1)
    slope = max(float(np.diff(above)[after - 1] / np.diff(time_s)[after - 1]), 1e-9)
    begin_s, period_s = predictor.start_s, float(np.median(np.diff(time_s)))
    share = float((time_s[after] - begin_s) / TICK_S % 1)
    few = slice(after - 1, after + AREA_SAMPLES)
    area = TouchArea(
        found.time_s - begin_s, float(time_s[few][-1]) - begin_s,
        float(above[few].sum()) * period_s, float(above[few].max()), period_s,
    )  # fmt: skip
    bend_N = share * (1 - share) * TICK_S * slope
    notes = _touch_notes(found)
    return _Measured(where, predictor, found.time_s, level, area, slope, bend_N, notes)


def _touch_notes(found: Touch) -> list[str]:
    """Returns notes about a first contact whose instant or force is not clear in the recording."""
    notes = []
    if found.is_single:
        notes.append(
            f"the first contact has one sample, {found.deviations:.3g} standard deviations of the "
            f"noise; it is made between {found.open_s:.6g} s and the next sample"
        )
    if found.doubtful_s is not None:
        notes.append(
            f"it cannot be told whether the first contact is at {found.time_s:.6g} s or already at "
            f"{found.doubtful_s:.6g} s, where the force is above the noise"
        )
    return notes


def _missing(measured: _Measured, nominal: Columns) -> tuple[float, float]:
    """Returns the standard deviation in N of the noise, and the step in N of the converter, that
    the recording has and the runs do not have."""
    predictor, level = measured.predictor, measured.level
    force = predictor.force().of(nominal)
    touch_s = min(measured.start_s, predictor.touch_s(nominal, level) or math.inf)
    free = force[: max(2, round(touch_s / TICK_S) - 2)]
    step = quantum_of(predictor.recording["force"].values)
    return (
        math.sqrt(max(0.0, level.noise**2 - float(free.std()) ** 2)),
        0.0 if quantum_of(force) > 0.5 * step else step,
    )


def _runs(measured: _Measured) -> list[_Run]:
    """Returns runs with random values of the parameters. Raises InputError if no run makes
    contact."""
    predictor, request = measured.predictor, measured.predictor.request
    rng = np.random.default_rng(request.seed)
    nominal = predictor.run(predictor.nominal, request.seed)
    if predictor.input == "force_setpoint":
        # The recorded set-points act at their recorded times after the first contact.
        found = predictor.touch_s(nominal, measured.level)
        if found is not None:
            predictor.setpoint_shift_s = found - measured.touch_s
    noise, step = _missing(measured, nominal)
    runs: list[_Run] = []
    gaps: list[float] = []
    without = 0
    for seed, member in progress.each(
        list(enumerate(predictor.members(nominal, measured.level), request.seed)),
        "runs",
        request.samples,
    ):
        errors = noise * rng.standard_normal(AREA_SAMPLES) + step * rng.uniform(
            -0.5, 0.5, AREA_SAMPLES
        )
        # A run has its force at the ticks only; between two ticks it is interpolated by a line.
        # The true force may begin to rise between the two ticks.
        errors[0] += measured.bend_N * rng.uniform(-1, 1)
        begin = measured.area
        area = begin.area_N_s + float(errors.sum()) * begin.period_s
        own, columns = predictor.touching(
            member, seed, replace(begin, area_N_s=area), measured.level
        )
        found = predictor.touch_s(columns, measured.level)
        if found is None:
            without += 1
        elif predictor.has_gap:
            gaps.append(own[str(predictor.gap)])
            runs.append((columns, measured.start_s))
        else:
            # An error of the recorded time also shifts the recording against the run.
            runs.append((columns, found + errors[-1] / measured.slope_N_per_s))
    measured.gap_m = float(np.median(gaps)) if gaps else None
    if not runs:
        raise InputError(
            f"{paths.display(request.experiment)}: expected a simulated run with a contact, as in "
            "the recording, got simulated runs without contact; correct the gap between axis and "
            "workpiece in the model, or the set-point"
        )
    if without:
        measured.notes.append(f"{without} of {request.samples} runs make no contact")
    measured.notes.extend(spike_notes([predictor.recording["force"]]))
    late_s = float(np.median([begin for _, begin in runs])) - measured.start_s
    for finding in predictor.recording["force"].findings:
        if finding.kind not in ("constant", "spike") and finding.to_s >= measured.touch_s:
            measured.notes.append(
                f"{finding.kind} of the force at {finding.from_s:.6g} s: {finding.text}"
            )
    if predictor.is_fed and abs(late_s) > max(SAME_TICKS * TICK_S, measured.period_s):
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


@dataclass(frozen=True)
class _Signal:
    """One signal at the times `grid` from the first contact: its measured values (n,), and its
    values in the runs (runs, n). `floor`: largest error of a value because of finite steps and
    samples. `errors` (runs, n): an error of the model in each run, in units of its share; or
    None."""

    model: SignalModel
    grid: Floats
    values: Floats
    series: Floats
    floor: float
    quantum: float
    errors: Floats | None
    correlation_s: float

    def with_error(self, share: float) -> Floats:
        """Returns the signals of the runs with an added error of the model, whose size is the
        share `share`.
        """
        return self.series if self.errors is None else self.series + share * self.errors


def _compared(measured: _Measured, runs: Sequence[_Run], grid: Floats) -> ComparedRecording:
    predictor, level = measured.predictor, measured.level
    recording, request = predictor.recording, predictor.request
    rng = np.random.default_rng(request.seed)
    signals = [_signal(measured, model, runs, grid, rng) for model in predictor.signals]
    known = predictor.model_error
    shares = {name: error.share for name, error in known.items() if name != "drive"}
    judged, drawn = _judged(signals, shares, level)
    agrees = all(one.agrees for one in judged)
    needed = {} if agrees or known else _needed(signals, level)
    sizes = _error_sizes(signals, known), _error_sizes(signals, needed)
    result = RecordingComparison(
        recording=measured.where, title=recording.title,
        experiment=paths.display(request.experiment),
        agrees=agrees, input=predictor.input,
        touch_s=measured.touch_s, gap_m=measured.gap_m, zero_N=level.zero, noise_N=level.noise,
        runs=len(runs), span_s=float(grid[-1]), figures=judged,
        inside={signal.name: signal.share_inside for signal in drawn},
        model_error=sizes[0], needed_error=sizes[1],
        notes=(*predictor.notes, *measured.notes),
    )  # fmt: skip
    return ComparedRecording(result, drawn)


def _signal(
    measured: _Measured,
    model: SignalModel,
    runs: Sequence[_Run],
    grid: Floats,
    rng: np.random.Generator,
) -> _Signal:
    level, name = measured.level, model.name
    source = measured.predictor.recording[name]
    values = measured.predictor.recording.sampled(name, grid + measured.touch_s)
    quantum = quantum_of(source.values)
    floor = quantum / 2
    series = _series(model, runs, grid, rng)
    if name == "force":
        values = values - level.zero
        series += _missing_noise(series, grid, level) * rng.standard_normal(series.shape)
    elif name == "position":  # machine and model may measure the position from different origins
        values = values - np.interp(0.0, grid, values)
        # The time of the first contact is uncertain by half a sample.
        floor += 0.5 * float(np.max(np.abs(np.diff(values[abs(grid) <= 3 * TICK_S]))))
    known = measured.predictor.model_error.get(name)
    correlation_s = known.correlation_s if known else model_error.CORRELATION_S
    errors, after = None, grid >= 0
    if name in ("force", "position") and np.count_nonzero(after) > 1:
        errors = np.zeros(series.shape)
        errors[:, after] = _errors(name, grid[after], np.median(series, axis=0)[after],
                                   ModelError(1.0, correlation_s), rng, len(series))  # fmt: skip
    return _Signal(model, grid, values, series, floor, quantum, errors, correlation_s)


def _errors(
    name: str,
    time_s: Floats,
    middle: Floats,
    error: ModelError,
    rng: np.random.Generator,
    count: int,
) -> Floats:
    """Returns random errors (count, n) of the model in a signal. `middle` (n,): the predicted
    signal."""
    knots = model_error.knots_of(time_s, middle)
    if name == "force":
        basis = model_error.force_basis(time_s, middle, knots, 0.0)
    else:
        basis = model_error.position_basis(time_s, middle, knots)
    drawn = rng.standard_normal((count, len(knots)))
    return np.asarray(drawn @ (basis @ model_error.root_of(knots, error)).T)


def _judged(
    signals: Sequence[_Signal], shares: Mapping[str, float], level: ForceLevel
) -> tuple[tuple[ComparedFigure, ...], tuple[ComparedSignal, ...]]:
    """Returns the characteristic values and the signals with their bands. The bands contain errors
    of the model with the sizes `shares`."""
    figures: list[_Figure] = []
    drawn: list[ComparedSignal] = []
    for one in signals:
        name, unit = one.model.name, one.model.unit
        series = one.with_error(shares.get(name, 0.0))
        if name == "force":
            own = ForceLevel(0.0, level.noise, level.contact)
            figures = _contact_figures(one.grid, one.values, series, own, one.quantum) + figures
        middle = np.median(series, axis=0)
        spread = POINT_BAND * series.std(axis=0) + one.floor
        drawn.append(
            ComparedSignal(name, unit, one.grid, one.values, middle, middle - spread,
                           middle + spread)
        )  # fmt: skip
        figures.append(_residual(drawn[-1], series, one.floor))
    return _with_bands(figures), tuple(drawn)


def _needed(signals: Sequence[_Signal], level: ForceLevel) -> dict[str, ModelError]:
    """Returns {signal: smallest error of the model}. With these errors, all characteristic values
    of the recording and of the model agree. Returns {} if no errors make them agree. Small errors
    are tried first, because a large error of the force causes contact losses."""

    def differing(shares: Mapping[str, float]) -> set[str]:
        figures = [one.figure for one in _judged(signals, shares, level)[0] if not one.agrees]
        parts = [text.partition("residual of ")[2] for text in figures]
        # A characteristic value whose name contains no signal belongs to the force.
        return {name or "force" for name in parts}

    times = {one.model.name: one.correlation_s for one in signals if one.errors is not None}
    names = differing({})
    shares = {
        name: share for name in sorted(names & times.keys())
        if (share := next((s for s in NEEDED_SHARES if name not in differing({name: s})), None))
    }  # fmt: skip
    if shares.keys() != names:
        return {}
    return {name: ModelError(share, times[name]) for name, share in shares.items()}


def _error_sizes(
    signals: Sequence[_Signal], errors: Mapping[str, ModelError]
) -> dict[str, ErrorSize]:
    """Returns the size of the error of the model in each signal."""
    most = {"force": 0.0, "position": 0.0}
    for one in signals:
        own = np.median(one.series, axis=0)[one.grid >= 0]
        if one.model.name == "force":
            most["force"] = float(own.max())
        elif one.model.name == "position":
            most["position"] = float(model_error.path_of(own)[-1])
    return model_error.sizes_of(errors, None, most["force"], most["position"])


def _series(
    model: SignalModel, runs: Sequence[_Run], grid: Floats, rng: np.random.Generator
) -> Floats:
    """Returns one signal of all runs at the times `grid` from the first contact, as an array
    (runs, n). Between two ticks the signal is a line. Where its slope changes, it differs from the
    line by an unknown part of this change, which is added at random."""
    rows = []
    for columns, begins_s in runs:
        values = model.of(columns)
        time_s = np.arange(len(values)) * TICK_S - begins_s
        at = np.interp(grid, time_s, values)
        if model.name == "position":
            at = at - np.interp(0.0, time_s, values)
        if model.name == "force":
            place = np.clip((grid - time_s[0]) / TICK_S, 0.0, len(values) - 1.001)
            low = place.astype(int)
            bend = np.abs(np.diff(values, 2, prepend=values[0], append=values[-1]))
            bend = np.maximum(bend[low], bend[low + 1])
            share = (place - low) * (1 - place + low)
            at = at + rng.uniform(-1, 1, len(grid)) * share * bend
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
    """Returns the characteristic values with their bands. The bands contain all measured values
    together with the probability CONFIDENCE. A band is the range of all runs, or as many standard
    deviations as Student's t distribution needs, whichever is wider. The error of the value because
    of the sampling rate is added to the band.
    """
    tail = (1 - CONFIDENCE) / (2 * len(figures))
    return tuple(_with_band(figure, tail) for figure in figures)


def _with_band(figure: _Figure, tail: float) -> ComparedFigure:
    known = np.array([value for value in figure.runs if value is not None])
    if _share(figure.runs) < LEAST_SHARE:
        is_rare = figure.measured is None or len(known) > 0
        known = known if figure.measured is not None else np.empty(0)
        if not len(known):
            return ComparedFigure(
                figure.figure, figure.unit, figure.measured, None, None, None, is_rare
            )
    middle = float(np.median(known))
    width = 0.0
    if len(known) > 1:
        # The standard deviation that is estimated from a few runs is not accurate.
        factor = float(special.stdtrit(len(known) - 1, 1 - tail)) * math.sqrt(1 + 1 / len(known))
        width = factor * float(known.std(ddof=1))
    low = min(float(known.min()), middle - width) - figure.resolution
    high = max(float(known.max()), middle + width) + figure.resolution
    low = max(low, 0.0) if figure.unit in ("s", "") else low  # a time or a count is never negative
    low = low if figure.has_low else 0.0
    is_missing = figure.measured is None
    agrees = _share(figure.runs) < 1 if is_missing else low <= (figure.measured or 0.0) <= high
    return ComparedFigure(figure.figure, figure.unit, figure.measured, middle, low, high, agrees)
