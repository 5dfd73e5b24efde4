"""Signal analyzer in simulation: measures frequency responses of the simulated axis (thesis
sections 3.1.1, 3.2).

The excitation is either a voltage of the drive, with a smaller sampling period than that of the
controller, or DAC codes from the excitation mode of the running firmware. Two signals are recorded.
The response from one to the other is estimated (H1) with its error, and compared with the linear
model.

Each realisation of the excitation (another noise sequence or phase) is periodic. It is applied
until the transient of the previous one has decayed. Then one whole period is recorded, so there is
no leakage between spectral lines. The residuals of H1 over the realisations therefore consist of
noise alone, and determine the error of the response:

    H = sum U* Y / sum |U|^2,   variance = sum |Y - H U|^2 / ((K - 1) sum |U|^2),
    |H - true|^2 / variance follows F(2, 2 (K - 1)),    K realisations

This holds for circular complex noise (Pintelon and Schoukens, System Identification, 2.5). The
converters of the analyzer add the noise of their triangular dither. Its variance is q^2 / 4 for a
step of q. The codes of the firmware have no added noise, only their rounding error.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core, linear, objects, progress
from forceaxis._core import InputError
from forceaxis.identify.measurement import Complexes, Measurement, Reals
from forceaxis.identify.setup import CODES, Setup, SetupTable, read_setup

TRANSIENT_SHARE = 1e-8  # fraction of a transient that may remain when a recording begins
FIRST_HANN_LINE = 3  # number of the lowest spectral line that is used with a Hann window
MOST_STEPS = 20_000_000  # largest number of time steps of one measurement in the simulation
MOST_PARTS = 64  # largest number of time steps of the plant within one tick

Lines = NDArray[np.int_]  # numbers of spectral lines
# [(spectral lines, input and output at these lines as an array (averages, 2, samples))]
Records = list[tuple[Lines, Reals]]


class ExcitedPlant:
    """A simulated plant with one kind of excitation. The class applies the excitation and records
    two signals."""

    wave: Reals  # excitation in V: one period, or all segments if there is a window function

    def __init__(
        self, setup: Setup, overrides: linear.Overrides, parts: int, samples: int, where: str
    ) -> None:
        self.setup, self.samples, self.where = setup, samples, where
        self.columns = [setup.input, setup.output]
        # number of ADC codes that were at an end of the ADC range, and number of all ADC codes
        self.at_end = self.converted = 0
        # {"element: state": number of recorded samples in this state}
        self.met: Counter[str] = Counter()
        try:
            model = str(linear.find_model(setup.model))
            self.plant = _core.Excited(model, dict(overrides), setup.seed, parts, setup.clamped)
        except _core.SimulationError as error:
            raise InputError(
                f"{where}: set: expected a plant that can be simulated, got: {error}"
            ) from None
        self.rate = _core.TICKS_PER_SECOND * parts
        if setup.inject == "codes":
            low, high = setup.band_hz
            waveform = "noise" if setup.excitation == "noise" else "sine"
            self.write("excitation_waveform", ("noise", "sine").index(waveform))
            self.write("excitation_amplitude", setup.level)
            self.write("excitation_hold", max(1, min(int(self.rate / (2.5 * high)), 65535)))
            self.write("excitation_period", samples if setup.window == "none" else 0)
            self.write("open_loop_code", setup.bias)
            if setup.excitation == "chirp":
                self.write("excitation_frequency", low)
                self.write("excitation_sweep", (high - low) * self.rate / samples)
            self.started = False

    def write(self, name: str, value: float) -> None:
        """Writes a value to an object of the firmware. Raises InputError if the firmware refuses
        the value."""
        try:
            self.plant.write(name, float(value))
        except ValueError as error:
            raise InputError(
                f"{self.where}: excitation: expected values that the firmware accepts, got: {error}"
            ) from None

    def prepare(self, rng: np.random.Generator, line: int | None) -> None:
        """Prepares the next realisation of the excitation, which the next call of play() applies.
        `line`: number of the spectral line of a sine, or None for another excitation."""
        if self.setup.inject == "volts":
            self.wave = self.waveform(rng, line)
            return
        self.write("excitation_seed", int(rng.integers(65536)))
        if line is not None:
            self.write("excitation_frequency", line * self.rate / self.samples)
            # The amplitude is random, because the rounding error depends on the amplitude.
            # With a constant amplitude, the variance of the response would not include this error.
            level = int(self.setup.level)
            self.write("excitation_amplitude", int(rng.integers((level + 1) // 2, level + 1)))
        if not self.started:
            self.write("mode", objects.BY_NAME["mode"].enum.index("excitation"))
            self.started = True

    def waveform(self, rng: np.random.Generator, line: int | None) -> Reals:
        """Returns the next realisation of the excitation in V. It is one period of the excitation,
        or all segments if there is a window function."""
        from scipy import fft, signal

        setup, count = self.setup, self.samples
        low, high = setup.band_hz
        if setup.excitation == "noise":
            if setup.window == "hann":
                count = count * (setup.averages + 1) // 2
            lines = np.arange(math.ceil(low * count / self.rate), int(high * count / self.rate) + 1)
            spectrum = np.zeros(count // 2 + 1, complex)
            spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
            wave = fft.irfft(spectrum, count)
            return np.asarray(wave * (setup.level / np.sqrt(np.mean(wave**2))))
        time = np.arange(count) / self.rate
        phase = 360 * rng.random()
        if setup.excitation == "chirp":
            end = count / self.rate
            chirp = signal.chirp(time, low, end, high, "linear", phi=phase)
            return np.asarray(setup.level * chirp)
        assert line is not None, "a sine needs its line"
        turns = line * np.arange(count) / count + phase / 360
        return np.asarray(setup.level * np.sin(2 * np.pi * turns))

    def play(self, count: int) -> Reals:
        """Applies the excitation for `count` samples. Returns input and output as an array (2,
        count), in the units of the linear model."""
        try:
            if self.setup.inject == "volts":
                volts = np.resize(self.wave, count) + self.setup.bias
                return np.asarray(self.plant.volts(volts, self.columns))
            values: Reals = self.plant.codes(count, self.columns)
        except _core.SimulationError as error:
            raise unstable(self.where, str(error)) from None
        for row, name in zip(values, self.columns, strict=True):
            if name in ("adc0", "adc1"):
                bits = self.plant.adc_bits[int(name[3])]
                self.at_end += int(((row == 0) | (row == 2**bits - 1)).sum())
                self.converted += len(row)
                row *= 2.0 ** (8 - bits)
        return values

    def states(self) -> dict[str, dict[str, float]]:
        """Returns, for each element, the fraction of the measured time in each of its states, as
        {element: {state: fraction}}."""
        shares: dict[str, dict[str, int]] = {}
        for text, count in self.met.items():
            element, _, state = text.rpartition(": ")
            shares.setdefault(element, {})[state] = count
        return {
            element: {state: n / sum(counts.values()) for state, n in counts.items()}
            for element, counts in shares.items()
        }


def unstable(where: str, text: str) -> InputError:
    """Returns the InputError for a measurement in which the amplitude of the response grows."""
    return InputError(
        f"{where}: excitation: expected a response that settles, but the excited axis is "
        f"unstable: {text}; lower the level, or close a loop that controls the position of the "
        "axis"
    )


def converter(values: Reals, bits: int, rng: np.random.Generator) -> tuple[Reals, float]:
    """Rounds values as the converters of the analyzer do. Returns (rounded values, step of the
    converter).

    The range of a converter is the smallest of 1, 2, 5 times 10^n that contains the values. With
    the triangular dither, the rounding error is noise with the variance step^2 / 4.
    """
    peak = float(np.max(np.abs(values)))
    if peak == 0.0:
        return values, 0.0
    decade = 10.0 ** math.floor(math.log10(peak))
    step = next(r for r in (decade, 2 * decade, 5 * decade, 10 * decade) if r >= peak)
    step /= 2 ** (bits - 1)
    dither = rng.random(values.shape) - rng.random(values.shape)
    return step * np.floor(values / step + dither + 0.5), step


def settling_steps(system: linear.System, where: str) -> int:
    """Returns the number of samples after which a transient has decayed. The slowest pole
    determines this number. Raises InputError if the transient never decays."""
    poles = system.poles()
    size = abs(poles)
    if size.max(initial=0) > 1 + 1e-7:
        rate = float(np.log(size.max()) / system.dt)
        raise InputError(
            f"{where}: model: expected a stable plant, got an unstable pole at "
            f"+{rate:.3g} 1/s; change the parameters, or measure with open contacts"
        )
    # True for each pole of an integrator. The drift of an integrator is removed from recordings.
    still = abs(poles - 1) < 1e-7
    slowest = size[~still].max(initial=0)
    if slowest > 1 - 1e-7:
        raise InputError(
            f"{where}: model: expected a plant with damping, but a mode of vibration of this "
            "plant never settles; add damping to the springs"
        )
    return math.ceil(math.log(TRANSIENT_SHARE) / math.log(slowest)) if slowest > 0 else 1


def measure(
    target: str | Path,
    options: SetupTable | None = None,
    plant_set: linear.Overrides | None = None,
) -> Measurement:
    """Measures a frequency response of the simulated axis and returns a Measurement.

    target: a measurement file or a model. A measurement file is a path, or the name of a file in
    sim/measurements without suffix ("fig3_9"). options: {key of Setup: value}, which replace keys
    of the file. Its key "set" has parameters {name: value} of both plant and model. plant_set:
    {name: value} of parameters of the plant alone, not of the linear model. Raises InputError for a
    wrong set-up and for a plant that cannot be measured.
    """
    setup, where = read_setup(target, options)
    return measure_setup(setup, where, plant_set)


def measure_setup(
    setup: Setup, where: str, plant_set: linear.Overrides | None = None
) -> Measurement:
    """Measures a frequency response as measure() does, from a Setup. `where`: name of the set-up in
    error messages."""
    rng = np.random.default_rng(setup.seed)
    parts, samples, lines = grid_of(setup, where)
    rate = _core.TICKS_PER_SECOND * parts
    facts = linear.facts(setup.model, setup.set)
    if setup.inject == "codes":
        facts.expect_no_bus("a measurement of codes")
    overrides = {name: facts.parameters[name][0] for name in setup.set}
    units = facts.signals | {
        "adc0": "count",
        "adc1": "count",
        "encoder": "count",
        "dac_code": "code",
    }
    for key in ("input", "output"):
        if getattr(setup, key) not in units:
            raise InputError(
                f"{where}: {key}: expected one of {', '.join(units)}, got {getattr(setup, key)}"
            )
    done = Measurement(
        *(np.zeros(0), np.zeros(0, complex), np.zeros(0), np.zeros(0), np.zeros(0)),
        dof=setup.averages - 1,
        averages=setup.averages,
        input=setup.input,
        output=setup.output,
        unit=setup.unit,
        dt=1 / rate,
        inject=setup.inject,
        model=str(linear.find_model(setup.model)),
        overrides=overrides,
        free=setup.free,
        scale=setup.scale,
        window=setup.window,
        resolution_hz=rate / samples,
        band_hz=setup.band_hz if setup.inject == "volts" else (0.0, math.inf),
    )
    settling, drifts = settling_of(setup, plant_set, done.dt, where)
    lead_in = math.ceil(settling / samples) + 1
    segments = len(lines) if setup.excitation == "sine" else 1
    steps = (lead_in + 1) * samples * segments * setup.averages
    if steps > MOST_STEPS:
        raise InputError(
            f"{where}: resolution_hz: expected a measurement of at most {MOST_STEPS / rate:g} s, "
            f"got {steps / rate:.4g} s, including {settling / rate:.3g} s in which the axis "
            "settles; raise resolution_hz or take fewer averages"
        )

    bench = ExcitedPlant(setup, {**overrides, **(plant_set or {})}, parts, samples, where)
    record: Recorder = record_segments if setup.window == "hann" else record_periods
    chunks = record(bench, lines, lead_in, drifts, rng)
    return replace(
        estimate(done, chunks, lines, setup, bench.plant.adc_bits, rng, where),
        unit=setup.unit or f"{units[setup.output]}/{units[setup.input]}",
        saturated=bench.at_end / max(bench.converted, 1),
        states=bench.states(),
    )


def grid_of(setup: Setup, where: str) -> tuple[int, int, Lines]:
    """Returns the time grid of a measurement: (number of samples in a tick, number of samples of a
    recording, numbers of the measured spectral lines). Raises InputError."""
    low, high = setup.band_hz
    tick_rate = _core.TICKS_PER_SECOND
    parts = 1
    if setup.inject == "volts":
        # The shortest period of the excitation has at least ten samples.
        # The zero-order hold lags by half a sample: 18 degrees at ten samples in a period.
        parts = max(4, math.ceil(10 * high / tick_rate))
        if parts > MOST_PARTS:
            raise InputError(
                f"{where}: band_hz: expected at most {MOST_PARTS * tick_rate / 10:g} Hz, a tenth "
                f"of the highest sampling rate, got {high:g}"
            )
    elif high >= tick_rate / 2:
        raise InputError(
            f"{where}: band_hz: expected less than {tick_rate / 2:g} Hz, half of the "
            f"tick rate, got {high:g}; inject volts to measure higher frequencies"
        )
    rate = tick_rate * parts
    samples = round(rate / setup.resolution_hz)
    first = max(1, math.ceil(low * samples / rate - 1e-9))
    last = math.floor(high * samples / rate + 1e-9)
    if last < first:
        raise InputError(
            f"{where}: resolution_hz: expected at least one line of the spectrum between {low:g} "
            f"and {high:g} Hz, got none; use a smaller resolution_hz, which measures longer"
        )
    # The removal of mean and drift distorts the two spectral lines next to 0 Hz.
    if setup.window == "hann":
        first = max(first, FIRST_HANN_LINE)
        if last < first:
            raise InputError(
                f"{where}: resolution_hz: expected at most a third of the highest frequency of "
                "band_hz, because the Hann window makes the first two spectral lines useless, got "
                f"{rate / samples:g} Hz"
            )
    lines = np.arange(first, last + 1)
    if setup.excitation == "sine":
        lines = np.unique(np.round(np.geomspace(first, last, setup.points)).astype(int))
    return parts, samples, lines


def settling_of(
    setup: Setup, plant_set: linear.Overrides | None, dt: float, where: str
) -> tuple[int, bool]:
    """Returns (number of samples after which a transient has decayed, True if the output drifts).
    The output drifts if the plant has an integrator. Raises InputError."""
    overrides = dict(setup.set)
    continuous = linear.linearise(
        setup.model,
        ("drive.command",),
        [s for s in (setup.input, setup.output) if s != "dac_code"],
        overrides,
        free=setup.free,
    )
    for name in continuous.outputs:
        if not continuous.select(outputs=[name]).has_path():
            raise InputError(
                f"{where}: {'input' if name == setup.input else 'output'}: expected a signal that "
                f"depends on the drive, but there is no signal path from drive.command to {name}; "
                "choose another signal"
            )
    settling = settling_steps(continuous.sampled(dt=dt), where)
    # The plant with changed parameters may settle later than the nominal plant.
    # If the plant with changed parameters is unstable, the application of the excitation fails.
    if plant_set:
        moved = linear.linearise(
            *(setup.model, ("drive.command",), continuous.outputs, {**overrides, **plant_set}),
            free=setup.free,
        ).sampled(dt=dt)
        if abs(moved.poles()).max(initial=0) <= 1 + 1e-7:
            settling = max(settling, settling_steps(moved, where))
    return settling, bool(np.any(abs(continuous.poles()) < 1e-9))


def record_periods(
    bench: ExcitedPlant, lines: Lines, lead_in: int, drifts: bool, rng: np.random.Generator
) -> Records:
    """Records one period of each realisation. For a sine, records one period at each spectral line.
    Returns [(spectral lines, array (averages, 2, samples))].

    The output of an integrating plant drifts with the mean of the excitation. The drift is equal in
    each period, and is removed as a ramp.
    """
    setup, n = bench.setup, bench.samples
    sets: list[tuple[Lines, int | None]] = [(np.array([line]), line) for line in lines]
    if setup.excitation != "sine":
        sets = [(lines, None)]
    recorded = [np.empty((setup.averages, 2, n)) for _ in sets]
    ramp = (np.arange(n) - (n - 1) / 2) / n
    for i in progress.each(range(setup.averages), "averages"):
        for place, (_, line) in enumerate(sets):
            bench.prepare(rng, line)
            before = bench.play(lead_in * n)[:, -n:]
            now = bench.play(n)
            # If a contact opens and closes, the range of a signal may grow once by chance.
            if grown(before, now):
                before, now = now, bench.play(n)
                if (factor := grown(before, now)) is not None:
                    raise unstable(
                        bench.where, f"it grows {factor:.3g} times from period to period"
                    )
            bench.met.update(bench.plant.states)
            change = (now - before).mean(axis=1, keepdims=True)
            recorded[place][i] = now - change * ramp if drifts else now
    return [(used, values) for (used, _), values in zip(sets, recorded, strict=True)]


def grown(before: Reals, now: Reals) -> float | None:
    """Returns the factor by which the range of a signal has grown since the previous period of the
    excitation. Returns None for a factor below 1.5."""
    swing = np.ptp(before, axis=1)
    factor = (np.ptp(now, axis=1) / np.maximum(swing, 1e-300)).max()
    return float(factor) if swing.min() > 0 and factor > 1.5 else None


def record_segments(
    bench: ExcitedPlant, lines: Lines, lead_in: int, drifts: bool, rng: np.random.Generator
) -> Records:
    """Records noise that is not periodic. It is recorded in segments that overlap by half and have
    a Hann window. Returns [(spectral lines, array (averages, 2, samples))]."""
    from scipy import signal

    setup, n = bench.setup, bench.samples
    bench.prepare(rng, None)
    bench.play(lead_in * n)
    if setup.inject == "volts":
        bench.wave = np.roll(bench.wave, -(lead_in * n) % len(bench.wave))
    values = bench.play(n * (setup.averages + 1) // 2)
    bench.met.update(bench.plant.states)
    starts = np.arange(setup.averages) * (n // 2)
    segments = np.stack([values[:, s : s + n] for s in starts])
    kind = "linear" if drifts else "constant"
    return [(lines, signal.detrend(segments, type=kind) * signal.get_window("hann", n))]


Recorder = Callable[[ExcitedPlant, Lines, int, bool, np.random.Generator], Records]


def estimate(
    done: Measurement,
    chunks: Records,
    lines: Lines,
    setup: Setup,
    adc_bits: Sequence[int],
    rng: np.random.Generator,
    where: str,
) -> Measurement:
    """Completes the Measurement `done` with the results from the recordings `chunks`: response
    (estimator H1), coherence, variance, and standard deviation due to quantisation. Returns it."""
    from scipy import fft

    coherence, variance, floor = np.empty((3, len(lines)))
    response: Complexes = np.empty(len(lines), complex)
    place, bias = 0, 0.0
    for used, values in chunks:
        count = values.shape[-1]
        spectra, noise = [], []
        for column, name in enumerate((done.input, done.output)):
            record = values[:, column]
            if name in ("adc0", "adc1"):
                step, factor = 2.0 ** (8 - adc_bits[int(name[3])]), 12
            elif name in CODES:
                step, factor = float(name == "encoder"), 12
            else:
                record, step = converter(record, setup.bits, rng)
                factor = 4
            spectra.append(fft.rfft(record, axis=-1)[:, used])
            # mean of the squared values of the window function
            power = 0.375 if setup.window == "hann" else 1.0
            noise.append(step**2 / factor * count * power)
        U, Y = spectra
        here = slice(place, place + len(used))
        place += len(used)
        uu, yy = (abs(U) ** 2).sum(0), (abs(Y) ** 2).sum(0)
        if not uu.all():
            raise InputError(
                f"{where}: level: expected an excitation that changes the input signal of the "
                "response, but this signal stays at 0; raise the level"
            )
        H = (U.conj() * Y).sum(0) / uu
        response[here] = H
        residual = (abs(Y - H * U) ** 2).sum(0)
        # Hann windows that overlap by half have a correlation of a sixth (Welch 1967).
        shared = 1 + 2 / 36 if setup.window == "hann" else 1.0
        dof = done.averages / shared - 1
        variance[here] = shared * residual / ((done.averages - 1) * uu)
        coherence[here] = abs(H) ** 2 * uu / np.maximum(yy, 1e-300)
        bias = max(bias, float((noise[0] * done.averages / uu).max()))
        floor[here] = np.sqrt((noise[1] + abs(H) ** 2 * noise[0]) / uu)
    if not (variance > 0).all():
        raise InputError(
            f"{where}: level: expected an output signal that changes by more than one count, but "
            f"{done.output} changes less; raise the level, or keep the contact closed by a bias "
            "or by clamped contacts"
        )
    scale = done.scale
    return replace(
        done,
        frequency_hz=lines / (values.shape[-1] * done.dt),
        response=np.asarray(response * scale, complex),
        coherence=np.minimum(coherence, 1.0),
        variance=variance * scale**2,
        floor=floor * abs(scale),
        dof=dof,
        input_bias=bias,
    )
