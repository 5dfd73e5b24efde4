"""A virtual signal analyzer: frequency responses measured on the simulated axis (3.1.1, 3.2).

An excitation goes into the drive as volts on a clock finer than the controller's, or comes as DAC
codes from the excitation mode of the running firmware; two signals are recorded and the response
from one to the other is estimated (H1), with its error, beside that of the linear model.

Every realisation of the excitation (another noise, another phase) repeats itself exactly. It is
played until what the one before has left behind is gone, and then one whole period is measured:
nothing leaks from line to line, so the residuals of H1 over the realisations are the noise alone,
and with it the error of the response is known, not assumed:

    H = sum U* Y / sum |U|^2,   variance = sum |Y - H U|^2 / ((K - 1) sum |U|^2),
    |H - true|^2 / variance follows F(2, 2 (K - 1)),    K realisations

(circular complex noise; Pintelon and Schoukens, System Identification, 2.5). The analyzer's own
converters add the noise of their triangular dither, variance q^2 / 4 for a step of q; the codes of
the firmware have no noise but their own rounding.
"""

import math
import os
from collections import Counter
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from forceaxis import _core, objects, paths, toml
from forceaxis._core import InputError
from forceaxis.linear import system as linear

CODES = ("adc0", "adc1", "encoder", "dac_code")
BAND = 0.95
COHERENT = 0.9
FLAT = 0.1  # spread of an octave's amplitudes over their size that is a plateau
LEFT_BEHIND = 1e-8  # of what a transient was, when measuring starts
FIRST_OF_HANN = 3  # line
STOPS = (".low", ".high")  # ends of the names of a stop's two contacts
MOST_STEPS = 20_000_000
MOST_PARTS = 64  # of a tick


@dataclass(frozen=True)
class Setup:
    """What is measured and how: the keys of a measurement file and the options of the verb.

    Files are TOML; [set] holds model parameters. See sim/measurements/fig3_6.toml.
    """

    model: str  #: path, or the stem of a file of sim/models; in a file: relative to it
    title: str = ""
    figure: str = ""
    shows: str = ""
    input: str = ""  #: a signal or dac_code; default: what is injected (drive.command, dac_code)
    output: str = ""  #: a signal of the model, or adc0, adc1 (8-bit counts), encoder (counts)
    inject: str = "volts"  #: "volts" into the drive, or "codes" by the firmware's excitation mode
    excitation: str = "noise"  #: noise | sine (one line after the other) | chirp
    band_hz: tuple = (1.0, 200.0)  #: lowest and highest frequency
    resolution_hz: float = 0.0  #: distance of the lines; 0: the lowest frequency
    #: noise V rms, else amplitude V; amplitude in codes (a sine's is drawn from half of it on).
    #: 0: 0.1 V, 20 codes
    level: float = 0.0
    bias: float = 0.0  #: V or code about which it swings
    averages: int = 16  #: realisations, or half overlapping segments
    window: str = "none"  #: none (periodic), or hann for noise that never repeats
    points: int = 40  #: lines of a sine measurement, logarithmically spaced
    bits: int = 12  #: of the analyzer's converters, whose ranges are 1, 2 or 5 times 10^n
    scale: float = 1.0  #: the output's factor, for a sensor that is not in the model
    unit: str = ""  #: of the response; default: from the signals
    clamped: bool = False  #: contacts pull as well as they push, as if clamped (3.2.2)
    free: bool = False  #: the contacts are apart; else pressed
    seed: int = 0
    set: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Measurement:
    """A measured frequency response, output over input, as both were sampled every `dt` seconds.

    What excites the plant is held from sample to sample. A simulated signal at sample k is that of
    the instant just after the new excitation acts; the firmware's codes (adc0, adc1, encoder) are
    converted just before it. So y[k] = C x[k] + D u[k], or C x[k] + D u[k-1] for codes: the exact
    model of the measured response is the plant sampled with zero-order hold, `predict()`.

    The n points may be taken as independent; the error of `response` at each is circular complex
    normal with the unknown variance that `variance` estimates from `dof` complex residuals, so that
    |response - true|^2 / variance follows F(2, 2 dof). Under a window neighbouring points share
    noise and leakage counts as noise, so that bands and tests err on the safe side.
    """

    frequency_hz: np.ndarray  #: (n,) rising, > 0, below 1 / (2 dt)
    response: np.ndarray  #: (n,) complex, in units
    coherence: np.ndarray  #: (n,) 0..1, ordinary coherence of input and output
    variance: np.ndarray  #: (n,) of the complex response: E |response - true|^2, units squared
    floor: np.ndarray  #: (n,) what quantisation alone makes of the standard deviation, units
    dof: float  #: degrees of freedom of `variance` (complex): averages - 1, fewer with overlap
    averages: int
    input: str  #: a signal of the model ("drive.command": V), or "dac_code"
    output: str  #: a signal of the model, "adc0", "adc1" (8-bit counts) or "encoder" (counts)
    unit: str  #: of the response
    dt: float  #: s from sample to sample, 1 / (1500 parts)
    inject: str  #: "volts" (plant alone) or "codes" (through the firmware, dt = 1/1500 s)
    model: str  #: path of the model file that was measured
    overrides: dict  #: nominal parameters, those of `predict()` without arguments
    free: bool = False  #: contacts apart
    scale: float = 1.0  #: what the output was multiplied by
    window: str = "none"  #: or "hann", under which neighbouring frequencies mix
    resolution_hz: float = 0.0  #: distance of the lines, 1 / length of a record
    band_hz: tuple = (0.0, math.inf)  #: that was excited
    saturated: float = 0.0  #: share of the samples in which an ADC stood at one of its ends
    #: {element: {state: share of the measured time}} of what switches: contacts, the drive's limits
    states: dict = field(default_factory=dict)
    input_bias: float = 0.0  #: share by which the converter's noise in the input makes H1 too small

    def predict(self, overrides=None, frequency_hz=None):
        """The linear model's response between the same two signals, sampled alike: (n,) complex.

        overrides: {parameter: value} on top of the nominal ones. Raises InputError.
        """
        frequency = self.frequency_hz if frequency_hz is None else np.asarray(frequency_hz, float)
        system = sampled(self, self.overrides | (overrides or {}))
        if self.window == "none":
            x, y = self._signals(system, frequency)
            return self.scale * y / x
        # What H1 tends to under a window W, exactly: sum |W|^2 X* Y / sum |W|^2 |X|^2 about a line.
        offset = np.arange(-48, 49) / 8 + 1e-9  # lines; 1e-9: not 0 / 0
        near = frequency[:, None] + offset * self.resolution_hz
        weight = (np.sinc(offset) / (1 - offset**2)) ** 2
        weight = weight * ((near >= self.band_hz[0]) & (near <= self.band_hz[1]))
        x, y = self._signals(system, abs(near).ravel())
        x, y = x.reshape(near.shape), y.reshape(near.shape)
        return self.scale * (weight * x.conj() * y).sum(1) / (weight * abs(x) ** 2).sum(1)

    def _signals(self, system, frequency):
        """Input and output over what drives the plant."""
        values = system.response(frequency).reshape(len(frequency), 2).T
        late = np.exp(-2j * np.pi * frequency * self.dt) - 1
        for row, name in enumerate((self.input, self.output)):
            if name in CODES[:3]:  # converted before the new excitation acts
                values[row] += system.D[row, 0] * late
            elif name == "dac_code":
                values[row] = 1.0
        return values

    def radius(self, share=BAND):
        """(n,) The true response is within this distance with probability `share`."""
        from scipy import stats

        return np.sqrt(self.variance * stats.f.ppf(share, 2, 2 * self.dof))

    def random_error(self):
        """(n,) Relative standard deviation of |response| as the coherence tells it:
        sqrt((1 - coherence) / (2 averages coherence)) (Bendat and Piersol)."""
        shown = np.maximum(self.coherence, 1e-12)
        return np.sqrt((1 - self.coherence) / (2 * (self.dof + 1) * shown))

    def compare(self, model=None):
        """Whether a response (default: predict()) is the one measured.

        Returns {"points", "coherent" (of coherence above 0.9), "inside" (share of these within the
        95 % band), "p_value", "fits" (p_value >= 0.05)}. The test is of all points at once: with
        F = |response - model|^2 / variance, the sum of 2 dof log(1 + F / dof) is chi-square with 2
        degrees of freedom a point if the model is true (Fisher's sum of the points' log p-values,
        which here is the likelihood ratio).
        """
        from scipy import stats

        model = self.predict() if model is None else model
        ratio = abs(self.response - model) ** 2 / self.variance
        statistic = float(np.sum(2 * self.dof * np.log1p(ratio / self.dof)))
        p_value = float(stats.chi2.sf(statistic, 2 * len(ratio)))
        coherent = self.coherence > COHERENT
        inside = ratio <= stats.f.ppf(BAND, 2, 2 * self.dof)
        return {
            "points": len(ratio),
            "coherent": int(coherent.sum()),
            "inside": float(inside[coherent].mean()) if coherent.any() else None,
            "statistic": statistic,
            "p_value": p_value,
            "fits": p_value >= 1 - BAND,
        }

    def readings(self):
        """What one reads off the plot: gain at the lowest frequency measured; where it has fallen
        3 dB below that, if the first octave is flat (no corner otherwise: the curve's plateau, if
        it has one, is not in the band); where the phase passes through 0 (or 180) degrees, Hz."""
        size, frequency = abs(self.response), self.frequency_hz
        octave = size[frequency <= 2 * frequency[0] * (1 + 1e-9)]
        flat = len(octave) > 1 and np.ptp(octave) <= FLAT * octave[0]
        low = float(size[0])
        plateau = float(np.median(octave))
        below = np.flatnonzero(size < plateau / math.sqrt(2)) if flat else []
        corner = None
        if len(below) and below[0] > 0:
            i = below[0]
            span = np.log(size[i - 1 : i + 1])
            part = (span[0] - math.log(plateau / math.sqrt(2))) / (span[0] - span[1])
            corner = float(frequency[i - 1] + part * (frequency[i] - frequency[i - 1]))
        # Noise about the axis is no crossing: only points clearly on one side count.
        clear = np.flatnonzero(abs(self.response.imag) > 2 * self.radius())
        a, f = self.response.imag[clear], frequency[clear]
        crossings = []
        for i in np.flatnonzero(np.diff(np.signbit(a))):
            at = float(f[i] + a[i] / (a[i] - a[i + 1]) * (f[i + 1] - f[i]))
            degrees = 0 if self.response.real[clear[i]] > 0 else 180
            crossings.append({"frequency_hz": at, "phase_deg": degrees})
        return {
            "low_gain": low,
            "low_hz": float(frequency[0]),
            "plateau": bool(flat),
            "corner_hz": corner,
            "phase_crossings": crossings[:20],
        }


def sampled(measured, overrides):
    """The two signals over the drive's command (or the DAC's code) as a sampled System."""
    plain = [
        "drive.command" if name == "dac_code" else name
        for name in (measured.input, measured.output)
    ]
    system = linear.linearise(
        measured.model, ("drive.command",), plain, overrides, free=measured.free
    )
    if measured.inject == "codes":
        factor = linear.facts(measured.model, overrides)["volts_per_code"]
        system = replace(system, B=system.B * factor, D=system.D * factor)
    return system.sampled(dt=measured.dt)


# --- the set-up ------------------------------------------------------------------------------


def read_setup(target, options=None):
    """(Setup, where) of a measurement file, or of a model; `options` replace keys. InputError."""
    options = {k: v for k, v in (options or {}).items() if v is not None}
    if not str(target).strip():
        raise InputError("measure: TARGET: expected a measurement or a model, got nothing")
    path = Path(target)
    given, where = {"model": str(target)}, str(target)
    known = paths.MEASUREMENTS / f"{target}.toml"
    if path.suffix != ".toml" and path.parent == Path() and known.exists():
        path, where = Path(paths.display(known)), paths.display(known)
    if path.suffix == ".toml":
        table = toml.read(path)
        if isinstance(table.get("model"), str):
            given = table | {"model": os.path.normpath(path.parent / table["model"])}
        elif not any(key in table for key in ("body", "drive", "parameters_file")):
            raise InputError(f"{where}: model: expected the path of a model beside the measurement")
    if "set" in options and isinstance(given.get("set", {}), dict):
        options["set"] = given.get("set", {}) | options["set"]
    for key in ("input", "output"):  # another signal than the file's: not what its title says
        if options.get(key, given.get(key)) != given.get(key):
            given = {k: v for k, v in given.items() if k not in ("title", "figure", "shows")}
    given = given | options
    return check(given, where), where


# What each key may be, in words and as a test.
KEYS = {
    "input": ("a signal's name", lambda v: isinstance(v, str) and v),
    "output": ("a signal's name", lambda v: isinstance(v, str) and v),
    "inject": ("volts or codes", ("volts", "codes").__contains__),
    "excitation": ("noise, sine or chirp", ("noise", "sine", "chirp").__contains__),
    "window": ("none or hann", ("none", "hann").__contains__),
    "band_hz": (
        "two rising frequencies below 1e6, [1, 200]",
        lambda v: len(v) == 2 and all(is_number(x) for x in v) and 0 < v[0] < v[1] < 1e6,
    ),
    "resolution_hz": (
        "a frequency of 0.001 Hz or more",
        lambda v: is_number(v) and 1e-3 <= v < 1e6,
    ),
    "level": ("a number > 0, below 1e6", lambda v: is_number(v) and 0 < v < 1e6),
    "bias": ("a number between -1e6 and 1e6", lambda v: is_number(v) and abs(v) < 1e6),
    "averages": ("a whole number 4..4096", lambda v: is_whole(v) and 4 <= v <= 4096),
    "points": ("a whole number 2..1000", lambda v: is_whole(v) and 2 <= v <= 1000),
    "bits": ("a whole number 8..16", lambda v: is_whole(v) and 8 <= v <= 16),
    "scale": (
        "a number other than 0, below 1e12",
        lambda v: is_number(v) and v != 0 and abs(v) < 1e12,
    ),
    "clamped": ("true or false", lambda v: isinstance(v, bool)),
    "free": ("true or false", lambda v: isinstance(v, bool)),
    "seed": ("a whole number 0..2^31 - 1", lambda v: is_whole(v) and 0 <= v < 2**31),
    "set": (
        "a table of numbers or quantities",
        lambda v: (
            isinstance(v, dict) and all(is_number(x) or isinstance(x, str) for x in v.values())
        ),
    ),
}


def is_number(value):
    return not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value)


def is_whole(value):
    return not isinstance(value, bool) and isinstance(value, int)


def check(given, where):
    """A Setup of a file's keys, every one of them checked. Raises InputError."""

    def fail(key, text):
        raise InputError(f"{where}: {key}: {text}")

    names = [f.name for f in fields(Setup)]
    toml.expect_keys(given, names, fail)
    for key, value in given.items():
        text, holds = KEYS.get(
            key, ("a text of one line", lambda v: isinstance(v, str) and v.isprintable())
        )
        try:
            good = holds(value)
        except TypeError:
            good = False
        if not good:
            fail(key, f"expected {text}, got {value!r}")
    setup = Setup(**given)
    codes = setup.inject == "codes"
    if not setup.output:
        fail("output", "expected the name of a signal; name what is measured")
    low, high = setup.band_hz
    setup = replace(
        setup,
        input=setup.input or ("dac_code" if codes else "drive.command"),
        level=setup.level or (20 if codes else 0.1),
        resolution_hz=setup.resolution_hz or low,
        band_hz=(float(low), float(high)),
    )
    if setup.window == "hann" and setup.excitation != "noise":
        fail("window", f"expected none with {setup.excitation}, which is measured over a period")
    if setup.free and setup.clamped:
        fail("clamped", "expected either clamped or free contacts")
    if codes and not (setup.level <= 2048 and setup.level == int(setup.level)):
        fail("level", f"expected whole codes 1..2048, got {setup.level:g}")
    if codes and not (-2048 <= setup.bias <= 2047 and setup.bias == int(setup.bias)):
        fail("bias", f"expected a whole code -2048..2047, got {setup.bias:g}")
    if codes and setup.level + abs(setup.bias) > 2048:
        fail(
            "level",
            f"expected level and bias of 2048 codes together at most, where the DAC ends, got "
            f"{setup.level:g} and {setup.bias:g}",
        )
    for key in ("input", "output"):
        if not codes and getattr(setup, key) in CODES:
            fail(key, f"expected a simulated signal, {getattr(setup, key)} needs inject = codes")
    return setup


# --- the measurement -------------------------------------------------------------------------


class Bench:
    """One plant under one kind of excitation: plays a waveform and records the two signals."""

    def __init__(self, setup, overrides, parts, samples, where):
        self.setup, self.samples, self.where = setup, samples, where
        self.columns = [setup.input, setup.output]
        self.at_end = self.converted = 0  # readings of an ADC, and those at one of its ends
        self.met = Counter()  # "element: state" -> samples
        try:
            self.plant = _core.Excited(
                str(linear.find_model(setup.model)), overrides, setup.seed, parts, setup.clamped
            )
        except _core.SimulationError as error:
            raise InputError(
                f"{where}: set: expected a plant that can be simulated, {error}"
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

    def write(self, name, value):
        try:
            self.plant.write(name, float(value))
        except ValueError as error:
            raise InputError(
                f"{self.where}: excitation: expected what the firmware takes, {error}"
            ) from None

    def prepare(self, rng, line):
        """The next realisation; `line` of a sine. It starts with the next play()."""
        if self.setup.inject == "volts":
            self.wave = self.waveform(rng, line)
            return
        self.write("excitation_seed", rng.integers(65536))
        if line is not None:
            self.write("excitation_frequency", line * self.rate / self.samples)
            # How a sine is rounded hangs on its size; one size alone would be an error unseen.
            level = int(self.setup.level)
            self.write("excitation_amplitude", rng.integers((level + 1) // 2, level + 1))
        if not self.started:
            self.write("mode", objects.BY_NAME["mode"].enum.index("excitation"))
            self.started = True

    def waveform(self, rng, line):
        """One period, V; without a window. With one: all segments of noise at once."""
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
            return wave * (setup.level / np.sqrt(np.mean(wave**2)))
        time = np.arange(count) / self.rate
        phase = 360 * rng.random()
        if setup.excitation == "chirp":
            end = count / self.rate
            return setup.level * signal.chirp(time, low, end, high, "linear", phi=phase)
        turns = line * np.arange(count) / count + phase / 360
        return setup.level * np.sin(2 * np.pi * turns)

    def play(self, count):
        """(2, count) of input and output, in the units of the linear model."""
        try:
            if self.setup.inject == "volts":
                volts = np.resize(self.wave, count) + self.setup.bias
                return self.plant.volts(volts, self.columns)
            values = self.plant.codes(count, self.columns)
        except _core.SimulationError as error:
            raise unstable(self.where, str(error)) from None
        for row, name in zip(values, self.columns, strict=True):
            if name in ("adc0", "adc1"):
                bits = self.plant.adc_bits[int(name[3])]
                self.at_end += int(((row == 0) | (row == 2**bits - 1)).sum())
                self.converted += len(row)
                row *= 2.0 ** (8 - bits)
        return values

    def states(self):
        """{element: {state: share of the measured time}}."""
        shares = {}
        for text, count in self.met.items():
            element, _, state = text.rpartition(": ")
            shares.setdefault(element, {})[state] = count
        return {
            element: {state: n / sum(counts.values()) for state, n in counts.items()}
            for element, counts in shares.items()
        }


def unstable(where, text):
    """The InputError of a response that grows."""
    return InputError(
        f"{where}: excitation: expected a response that settles, got an unstable excitation: {text}"
        "; lower the level, or close a loop that holds the axis"
    )


def converter(values, bits, rng):
    """What the analyzer's converter makes of values: (rounded, step). Its range is the smallest of
    1, 2, 5 times 10^n that holds them; triangular dither makes the error noise of step^2 / 4."""
    peak = float(np.max(np.abs(values)))
    if peak == 0.0:
        return values, 0.0
    decade = 10.0 ** math.floor(math.log10(peak))
    step = next(r for r in (decade, 2 * decade, 5 * decade, 10 * decade) if r >= peak)
    step /= 2 ** (bits - 1)
    dither = rng.random(values.shape) - rng.random(values.shape)
    return step * np.floor(values / step + dither + 0.5), step


def settling_steps(system, where):
    """Samples after which a transient is gone, by the slowest pole. Raises InputError."""
    poles = system.poles()
    size = abs(poles)
    if size.max(initial=0) > 1 + 1e-7:
        rate = float(np.log(size.max()) / system.dt)
        raise InputError(
            f"{where}: model: expected a stable plant, it has a pole at +{rate:.3g} 1/s: unstable "
            "excitation; change the parameters or measure it with the contacts apart"
        )
    still = abs(poles - 1) < 1e-7  # integrators drift, which is taken out
    slowest = size[~still].max(initial=0)
    if slowest > 1 - 1e-7:
        raise InputError(
            f"{where}: model: expected a plant with some damping, one of its modes never settles; "
            "give its springs a damping"
        )
    return math.ceil(math.log(LEFT_BEHIND) / math.log(slowest)) if slowest > 0 else 1


def measure(target, options=None, plant_set=None):
    """Measure a frequency response. Returns a Measurement.

    target: a measurement file (path, or stem of a file of sim/measurements: "fig3_9"), or a model
    (path or stem) with `options`, {key: value} of Setup, which also replace keys of a file; "set"
    holds parameters {name: value} of both plant and model. plant_set: {name: value} of the plant
    alone, behind the analyzer's back. Raises InputError: one line, for whatever is wrong or cannot
    be measured.
    """
    setup, where = read_setup(target, options)
    return measure_setup(setup, where, plant_set)


def measure_setup(setup, where, plant_set=None):
    """measure() with the set-up already read; `where` names it in errors."""
    rng = np.random.default_rng(setup.seed)
    low, high = setup.band_hz
    tick_rate = _core.TICKS_PER_SECOND
    parts = 1
    if setup.inject == "volts":
        # Ten steps in the shortest period at least: the hold turns the phase by 18 degrees there.
        parts = max(4, math.ceil(10 * high / tick_rate))
        if parts > MOST_PARTS:
            raise InputError(
                f"{where}: band_hz: expected at most {MOST_PARTS * tick_rate / 10:g} Hz, a tenth "
                f"of what can be sampled, got {high:g}"
            )
    elif high >= tick_rate / 2:
        raise InputError(
            f"{where}: band_hz: expected less than {tick_rate / 2:g} Hz, half of the firmware's "
            f"ticks, got {high:g}; inject volts to see more"
        )
    rate = tick_rate * parts
    samples = round(rate / setup.resolution_hz)
    first = max(1, math.ceil(low * samples / rate - 1e-9))
    last = math.floor(high * samples / rate + 1e-9)
    if last < first:
        raise InputError(
            f"{where}: resolution_hz: expected a line between {low:g} and {high:g} Hz, got too "
            f"little data for one; measure longer, with a smaller resolution_hz"
        )
    if setup.window == "hann":  # taking out mean and drift bends the two lines beside 0 Hz
        first = max(first, FIRST_OF_HANN)
        if last < first:
            raise InputError(
                f"{where}: resolution_hz: expected a third of the highest frequency or less with "
                f"window hann, whose first line is the third, got {rate / samples:g} Hz"
            )
    lines = np.arange(first, last + 1)
    if setup.excitation == "sine":
        lines = np.unique(np.round(np.geomspace(first, last, setup.points)).astype(int))

    nothing = np.zeros(0)
    facts = linear.facts(setup.model, setup.set)
    overrides = {name: facts["parameters"][name][0] for name in setup.set}
    units = facts["signals"] | {
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
        *(nothing,) * 5,
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
                f"the drive acts on, there is no path from drive.command to {name}"
            )
    settling = settling_steps(continuous.sampled(dt=done.dt), where)
    if plant_set:  # it may settle later than the nominal one; its instability shall show itself
        moved = linear.linearise(
            *(setup.model, ("drive.command",), continuous.outputs, overrides | plant_set),
            free=setup.free,
        ).sampled(dt=done.dt)
        if abs(moved.poles()).max(initial=0) <= 1 + 1e-7:
            settling = max(settling, settling_steps(moved, where))
    lead_in = math.ceil(settling / samples) + 1
    segments = len(lines) if setup.excitation == "sine" else 1
    steps = (lead_in + 1) * samples * segments * setup.averages
    if steps > MOST_STEPS:
        raise InputError(
            f"{where}: resolution_hz: expected a measurement of at most {MOST_STEPS / rate:g} s, "
            f"this one takes {steps / rate:.4g} s (it waits for transients that last "
            f"{settling / rate:.3g} s); raise resolution_hz or take fewer averages"
        )

    bench = Bench(setup, overrides | (plant_set or {}), parts, samples, where)
    drifts = bool(np.any(abs(continuous.poles()) < 1e-9))
    record = record_segments if setup.window == "hann" else record_periods
    chunks = record(bench, lines, lead_in, drifts, rng)
    return replace(
        estimate(done, chunks, lines, setup, bench.plant.adc_bits, rng, where),
        unit=setup.unit or f"{units[setup.output]}/{units[setup.input]}",
        saturated=bench.at_end / max(bench.converted, 1),
        states=bench.states(),
    )


def record_periods(bench, lines, lead_in, drifts, rng):
    """[(lines, (averages, 2, samples))]: a period of each realisation, and of each line of a sine.

    A plant that integrates drifts by what the excitation's mean makes of it, the same in every
    period: that ramp is taken out.
    """
    setup, n = bench.setup, bench.samples
    sets = [(np.array([line]), line) for line in lines]
    if setup.excitation != "sine":
        sets = [(lines, None)]
    recorded = [np.empty((setup.averages, 2, n)) for _ in sets]
    ramp = (np.arange(n) - (n - 1) / 2) / n
    for i in range(setup.averages):
        for place, (_, line) in enumerate(sets):
            bench.prepare(rng, line)
            before = bench.play(lead_in * n)[:, -n:]
            now = bench.play(n)
            if grown(before, now):  # once may be chance, where a contact bounces
                before, now = now, bench.play(n)
                if (factor := grown(before, now)) is not None:
                    raise unstable(
                        bench.where, f"it grows {factor:.3g} times from period to period"
                    )
            bench.met.update(bench.plant.states)
            change = (now - before).mean(axis=1, keepdims=True)
            recorded[place][i] = now - change * ramp if drifts else now
    return [(used, values) for (used, _), values in zip(sets, recorded, strict=True)]


def grown(before, now):
    """How many times larger a signal's swing is than a period before, or None."""
    swing = np.ptp(before, axis=1)
    factor = (np.ptp(now, axis=1) / np.maximum(swing, 1e-300)).max()
    return factor if swing.min() > 0 and factor > 1.5 else None


def record_segments(bench, lines, lead_in, drifts, rng):
    """The same for noise that does not repeat: overlapping segments under a Hann window."""
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


def estimate(done, chunks, lines, setup, adc_bits, rng, where):
    """H1, coherence, variance and quantisation floor from the recorded chunks."""
    from scipy import fft

    results = {name: np.empty(len(lines)) for name in ("coherence", "variance", "floor")}
    response = np.empty(len(lines), complex)
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
            power = 0.375 if setup.window == "hann" else 1.0  # of the window
            noise.append(step**2 / factor * count * power)
        U, Y = spectra
        here = slice(place, place + len(used))
        place += len(used)
        uu, yy = (abs(U) ** 2).sum(0), (abs(Y) ** 2).sum(0)
        if not uu.all():
            raise InputError(f"{where}: level: expected an excitation, the input stays at 0")
        H = (U.conj() * Y).sum(0) / uu
        response[here] = H
        residual = (abs(Y - H * U) ** 2).sum(0)
        # Half overlapping Hann windows share a sixth of their amplitude (Welch 1967).
        shared = 1 + 2 / 36 if setup.window == "hann" else 1.0
        dof = done.averages / shared - 1
        results["variance"][here] = shared * residual / ((done.averages - 1) * uu)
        results["coherence"][here] = abs(H) ** 2 * uu / np.maximum(yy, 1e-300)
        bias = max(bias, float((noise[0] * done.averages / uu).max()))
        results["floor"][here] = np.sqrt((noise[1] + abs(H) ** 2 * noise[0]) / uu)
    if not (results["variance"] > 0).all():
        raise InputError(
            f"{where}: level: expected an output that moves by more than one count, {done.output} "
            "does not; raise the level, or keep the contact by a bias or clamped"
        )
    scale = done.scale
    return replace(
        done,
        frequency_hz=lines / (values.shape[-1] * done.dt),
        response=response * scale,
        coherence=np.minimum(results["coherence"], 1.0),
        variance=results["variance"] * scale**2,
        floor=results["floor"] * abs(scale),
        dof=dof,
        input_bias=bias,
    )
