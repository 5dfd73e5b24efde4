"""Measures the frequency response of an axis from the DAC code to the measured force or to the
position.

    analyzer = Analyzer(axis, MeasuringOrder(force_max_N=120))
    analyzer.rest()
    free = analyzer.free()
    pressed = analyzer.contact(30.0)

In contact, the excitation is added to the output of the force law in mode 4. The force loop stays
closed, because an axis with an integrating drive would drift in open loop. The excitation is
periodic noise. Each realisation is one period of another noise sequence. The axis settles during
the first period, and the analyzer records the next period. Out of contact, the analyzer uses the
open-loop excitation mode. It moves the axis back to its start position before each realisation and
at the end.

The firmware ends the excitation in the tick in which a bound of force or travel is exceeded.
close() disables the axis and restores all objects that the analyzer has written.
"""

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Literal, NoReturn, Protocol, Self

import numpy as np

from forceaxis import linear
from forceaxis.axis import bounds
from forceaxis.axis.axis import Axis
from forceaxis.axis.drive import ExcitationObjects, ReachedPosition
from forceaxis.axis.link import TICKS_PER_S, NoAnswer, Recording, Refused
from forceaxis.bus.client import Value
from forceaxis.commission import known, response
from forceaxis.commission.level import Abort, Level, MeasuringOrder, Rest, Samples, noise_of
from forceaxis.commission.refusal import Refusal
from forceaxis.errors import ParameterError
from forceaxis.identify.measurement import Measurement
from forceaxis.linear.plant_facts import BusFacts
from forceaxis.objects import BY_NAME
from forceaxis.recordings.robust import quiet_of

# Three signals of a recording: waveform of the excitation, DAC codes, and output signal.
Record = tuple[Samples, Samples, Samples]

# The object dac_fine is the DAC code with the fraction that an output of more than 12 bits has.
SIGNALS_IN_CONTACT = ("force_raw", "dac_fine", "excitation_value")
SIGNALS_APART = ("position", "dac_fine", "force")
RECORDER_BYTES = 32768
SWING = MeasuringOrder.swing
# Smallest permitted force in contact, divided by the bias force.
FORCE_MIN_SHARE = 0.5
# Distance of the force bounds from the expected force, divided by the bias force.
FORCE_MARGIN_SHARE = 0.1
DAC_BITS = 12  # resolution in bits at which the output has whole DAC codes
RAMP_S = 0.1  # duration in s of the ramp at the start and at the end of an excitation
# The distortion of a response by the amplitude falls below this share at half the amplitude.
DISTORTION_FALL = 0.8
# longest time in s of a move: MOVE_S, plus MOVE_FACTOR times its distance divided by its speed
MOVE_S, MOVE_FACTOR = 20.0, 2.0
# Time in s in which the axis has to be at standstill, and longest time until then.
RESTING_S, REST_S = 0.5, 10.0
RELEASE_S = 1.0  # time in s in which the axis releases the force
# KEPT_S: time in s for which an axis has to stay in contact, so that the contact is not lost.
# KEPT_TRIES: largest number of times KEPT_S for which the program waits.
KEPT_S, KEPT_TRIES = 1.0, 10
# A moving axis approaches the force set-point if |force - set-point| decreases by this factor.
APPROACHES_SHARE = 0.9
# At a standstill, the axis still approaches the set-point if |force - set-point| decreases enough.
# NEARER_SHARE: smallest relative decrease of |force - set-point| within the time NEARER_S in s.
NEARER_SHARE, NEARER_S = 0.02, 3.0
WAIT_POLL_S = 0.1  # time in s between two checks of the state of the axis while the program waits
# largest number of values of the object target_force that are tried to reach one bias force
BIAS_TRIES = 8
QUIET_LSB = 0.4  # rms noise in ADC codes below which rounding hides the noise of the measured force
# Number of realisations from which the distortion of the response is computed.
DISTORTION_RECORDS = 3
# ARRIVALS_MIN: smallest number of changes of the position that must agree with the bus cycle.
# ARRIVALS_SURE: from this number of changes on, a multiple of the bus cycle is an error.
ARRIVALS_MIN, ARRIVALS_SURE = 6, 8
AMPLITUDE_FACTOR_MIN = 1.4  # smallest factor of one increase of the amplitude in the search
# After a bound was exceeded, the amplitude is multiplied by a factor, a limited number of times.
# The constants with SLIDING in their names apply to an axis with dry friction.
REDUCTION, REDUCTIONS_MAX = 0.5, 6
REDUCTION_SLIDING, REDUCTIONS_MAX_SLIDING = 0.7, 12
FACTOR_MAX_SLIDING = 2.0  # largest factor of one increase of the amplitude in the search
# Largest peak-to-peak range of the force in contact, divided by the bias force, with dry friction.
# The range reaches down to the smallest permitted force, so that the axis slides most of the time.
SWING_SLIDING = 2 * (1 - FORCE_MIN_SHARE - FORCE_MARGIN_SHARE)
FREE_SWING_CNT = 400  # largest peak-to-peak motion out of contact, in encoder counts
FREE_SETTLE_SHARE = 0.3  # settling time out of contact, divided by the settling time in contact
# Settling time while the amplitude is searched, divided by the settling time in the measurement.
SEARCH_SETTLE_SHARE = 0.5
# UNSETTLED_READINGS: number of last readings that a text about an unsettled force describes.
# UNSETTLED_SHARE: least range of the last readings of a swinging force, divided by the set-point.
UNSETTLED_READINGS, UNSETTLED_SHARE = 10, 0.05
# ERROR_ENOUGH: median of the relative errors over the frequencies, below which averaging may end.
ERROR_ENOUGH = 0.04
WINDOW_SHARE = 0.1  # permitted error of a position, divided by the permitted travel
STANDSTILL_CNT = 4  # largest change of the position in encoder counts at standstill
# Largest difference of two mean DAC codes at standstill, in standard deviations of a mean DAC code.
CODE_NOISE = 5.0


class Unsettled(Refusal):
    """Refusal: the force in contact does not come to rest."""

    def __init__(self, text: str) -> None:
        super().__init__("contact", text)


class FewChanges(Refusal):
    """Refusal: the position changes too rarely, so that the cycle of the bus cannot be seen."""


@dataclass(frozen=True)
class OutputSignal:
    """The output signal of a frequency response, and the conditions that end the search for the
    amplitude of the excitation.

    name: name of the output in a Measurement. unit: unit of the output in messages. deviation_max:
    largest relative standard deviation of the response, as the median over the spectral lines.
    distortion_max: largest difference between realisations, divided by their noise. This ratio may
    be above 1, because the rounding errors of a slow motion are not white noise. factor_max:
    largest factor of one increase of the amplitude in the search.
    """

    name: str
    unit: str
    deviation_max: float
    distortion_max: float
    factor_max: float


FORCE = OutputSignal("adc0", "N", 0.05, 1.35, 8.0)
POSITION = OutputSignal("encoder", "encoder counts", 0.02, 6.0, 4.0)


@dataclass(frozen=True)
class AnalyzedObjects:
    """The objects of an axis on which a measurement depends. Positions are in encoder counts, and
    forces in 8-bit counts. `force_scale` is in uN per count, `rated_force` in mN."""

    adc_bits: int
    dac_bits: int
    force_sign: int
    force_zero_code: int
    force_scale: float
    rated_force: float
    contact_force: float
    force_max: float
    tare_band: float
    contact_loss_cap: int
    position: int
    position_min: int
    position_max: int
    position_window: int
    output_limit: int
    output_bias: float

    @property
    def codes_most(self) -> int:
        """Returns the largest amplitude in DAC codes that the output has on both sides of
        output_bias."""
        return max(1, math.floor(self.output_limit - abs(self.output_bias)))


@dataclass(frozen=True)
class TouchObjects:
    """State of the contact. `contact` is 1 while the axis is in contact, and `contact_losses` is
    the number of contact losses so far."""

    contact: int
    contact_losses: int
    dac_code: int


@dataclass(frozen=True)
class KeptObjects:
    """State of the contact as TouchObjects, and the position in encoder counts."""

    contact: int
    contact_losses: int
    position: int


@dataclass(frozen=True)
class EnabledObjects:
    """Latched fault of the axis, and state of the drive."""

    fault: str
    drive_state: str


@dataclass(frozen=True)
class PressedObjects(EnabledObjects):
    """State of an axis in a force mode. `contact` is 1 while the axis is in contact."""

    contact: int


@dataclass(frozen=True)
class FreeObjects(PressedObjects):
    """State of an axis that moves out of contact. `limit_reason` is the reason why the axis limits
    its DAC code."""

    limit_reason: str


@dataclass(frozen=True)
class ExcitedObjects(EnabledObjects):
    """State of an axis, and state of the excitation that it outputs."""

    excitation_state: str


class Ended(Exception):
    """Exception: an excitation has ended before its planned end, or the response is distorted.
    `reason` is the value of the object `excitation_state`, or "distorted"."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Play(Protocol):
    """Function that records one realisation of the noise. The amplitude is in DAC codes. `settle`
    is the factor by which the settling time `settle_s` of the request is multiplied."""

    def __call__(self, amplitude: int, seed: int, settle: float = 1.0) -> Record: ...


@dataclass(frozen=True)
class Excitation:
    """Settings with which a frequency response is measured.

    `play`: function that records one realisation. `still`: DAC codes and output without an
    excitation. `swing`: largest peak-to-peak range of the output, in N or encoder counts. `seeds`:
    seed of the noise for each realisation.
    """

    play: Play
    output: OutputSignal
    still: response.Still
    swing: float
    seeds: Sequence[int]


class Analyzer:
    """Measures frequency responses of an axis that this program owns and that is disabled. close()
    disables the axis and restores its parameters.

    model: model file that Measurement.predict() uses, or "" for no model. overrides: parameters of
    the model that are changed. The methods raise Refusal, and the errors NoAnswer and Refused of
    the connection.
    """

    def __init__(
        self, axis: Axis, order: MeasuringOrder | None = None, model: str | Path = "",
        overrides: linear.Overrides | None = None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        self.axis, self.order, self.say = axis, order or MeasuringOrder(), say
        self.model, self.overrides = str(model), dict(overrides or {})
        self._before: dict[str, Value] = {}
        self.objects = axis.record(AnalyzedObjects)
        self.newton = self.objects.force_scale * 1e-6  # force in N of one force count
        # number of force counts per ADC code
        self.count_per_code = 2.0 ** (8 - self.objects.adc_bits)
        self.home = self.objects.position
        # True if a smaller amplitude does not reduce the distortion of a response
        self._takes_distortion = False
        # Factor by which the noise keeps each value for a shorter time than its band permits.
        self._shorter = 1
        facts = linear.facts(self.model, self.overrides) if self.model else None
        self.bus = facts.bus if facts else BusFacts(1, 0, 0)
        sampling = facts.reading.sampling if facts and facts.reading else None
        mean_s, width_s = sampling.ages_s() if sampling else (0.0, 0.0)
        self.ages = mean_s * TICKS_PER_S, width_s * TICKS_PER_S
        self.sinc_order = sampling.sinc_order if sampling else 0
        # number of ticks for which the firmware has the same sample of the force
        self.held_ticks = math.ceil(TICKS_PER_S / sampling.rate_hz) if sampling else 1
        samples = round(TICKS_PER_S / self.order.resolution_hz)
        # The period of the excitation must be a whole number of bus cycles.
        self.samples = samples - samples % self.bus.cycle_ticks
        low, high = self.order.band_hz
        if not 0 < low < high < TICKS_PER_S / 2:
            raise ParameterError(
                "band_hz",
                f"expected a frequency band with 0 < low end < high end < 750 Hz, got {low:g} to "
                f"{high:g} Hz",
            )
        self.lines = response.lines_of(self.samples, (low, high), TICKS_PER_S)
        if not len(self.lines):
            raise ParameterError(
                "band_hz",
                "expected at least one line of the spectrum in the frequency band, got none; use "
                "a smaller resolution in Hz",
            )
        most = _most_samples(SIGNALS_IN_CONTACT)
        if self.samples > most:
            raise ParameterError(
                "resolution_hz",
                f"expected a frequency resolution of at least {TICKS_PER_S / most:.2g} Hz, got "
                f"{self.order.resolution_hz:g} Hz; with a finer resolution, the recorder of the "
                "axis cannot store a complete period"
            )  # fmt: skip

    def set(self, **values: Value) -> None:
        """Writes parameters to the axis. close() restores the previous values of these
        parameters."""
        new = [name for name in values if name not in self._before]
        if new:
            self._before |= self.axis.get(*new)
        self.axis.set(**values)

    def close(self) -> None:
        """Disables the axis, waits until its brake has engaged, and restores the values that set()
        has replaced."""
        disable(self.axis)
        before, self._before = self._before, {}
        for name, value in before.items():
            try:
                self.axis.put_back(**{name: value})
            except Refused:
                self.say(f"{name} could not be set to {value} again")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        # If the axis does not answer, its watchdog disables it.
        with contextlib.suppress(NoAnswer):
            self.close()

    def rest(self) -> Rest:
        """Checks that the disabled axis is at rest. Returns its force reading, the noise and the
        position.

        Waits while an axis coasts or swings after a motion, for at most REST_S. Raises Refusal if
        the axis then still moves or if the force sensor was not tared. A motion within the backlash
        of the gear is permitted, because the motor has no power.
        """
        # backlash is the total backlash of the model in encoder counts
        backlash = known.play_counts(self.model, self.overrides) if self.model else 0
        for _ in range(round(REST_S / RESTING_S)):
            held = self.axis.capture(
                ["force_raw", "position", "force"], samples=round(RESTING_S * TICKS_PER_S)
            )
            raw, place = held.values("force_raw"), held.values("position")
            if np.ptp(place) <= STANDSTILL_CNT + backlash:
                break
        else:
            moved = f"{np.ptp(place)} encoder counts"
            raise Refusal(
                "moving",
                "expected an axis at standstill before the measurement, but the axis moves by "
                f"{moved}",
            )
        reading = quiet_of(held.values("force"), 1.0).zero
        band = self.objects.tare_band or self.objects.contact_force / 2
        if abs(reading) > band:
            raise Refusal(
                "tare",
                f"expected a measured force within {band:g} force counts at standstill, got "
                f"{reading:.3g}; move the axis out of contact and set the tare"
            )  # fmt: skip
        is_at_end = raw.min() == 0 or raw.max() == 2**self.objects.adc_bits - 1
        return Rest(
            reading, None if is_at_end else noise_of(raw, self.held_ticks), int(np.median(place))
        )

    def contact(self, force_N: float, of_loop: bool = False) -> Level:
        """Measures the frequency response from the DAC code to the measured force, while the axis
        presses with the force `force_N`. `of_loop`: True if only the sensitivity function has to be
        accurate. A smaller amplitude is then sufficient."""
        order = self.order
        if not force_N * (1 + SWING / 2) < self.force_max_N:
            raise Refusal(
                "force",
                f"expected a force set-point below {self.force_max_N / (1 + SWING / 2):.4g} N, "
                f"so that the force with the excitation stays below force_max, got {force_N:g} N"
            )  # fmt: skip
        bias = self.press(force_N)
        self.bound(bias, "noise", self.samples)
        still = self.axis.capture(SIGNALS_IN_CONTACT, samples=self.samples)
        noise = noise_of(still.values("force_raw"), self.held_ticks)
        level = Level(order.amplitude, bias, noise, of_loop=of_loop)
        seeds = [(order.seed + i) % 65536 for i in range(order.averages)]
        rest = still.floats("dac_fine"), self._force_counts(still)
        self._measure(level, Excitation(self._pressed, FORCE, rest, order.swing * bias, seeds))
        self.release()
        return level

    def release(self) -> None:
        """Lowers the force of an axis in contact to 0. Otherwise the compressed contact would push
        the axis away when it is disabled."""
        self.set(target_force=0)
        self.wait(RELEASE_S)

    def bound(self, bias_N: float, waveform: str, period: int) -> None:
        """Prepares an excitation that is added to the output of the force law. Also sets an upper
        and a lower bound of the force around `bias_N`. If a bound is exceeded, the axis ends the
        excitation.

        `period`: period of the waveform in ticks. 0 means a waveform that is not periodic.
        """
        least = (FORCE_MIN_SHARE + FORCE_MARGIN_SHARE) * bias_N
        most = self.force_max_N - FORCE_MARGIN_SHARE * bias_N
        most = min(most, BY_NAME["excitation_force_max"].max / 256 * self.newton)
        self.set(
            excitation_waveform=waveform, excitation_point="output", excitation_code=0,
            excitation_hold=self._hold_ticks(), excitation_seed=0,
            excitation_period=period, excitation_ramp=1e3 * RAMP_S,
            excitation_force_min=least / self.newton, excitation_force_max=most / self.newton,
            excitation_travel=self.order.squeeze,
        )  # fmt: skip

    def widen(self, bound: Literal["travel", "squeeze"], counts: float, why: str) -> bool:
        """Widens a bound of the request, "travel" or "squeeze", to `counts` encoder counts, if the
        request permits so many. Returns False if it does not. `why`: text about the reason."""
        order = self.order
        wider, own = math.ceil(counts), getattr(order, bound)
        if not own < wider <= getattr(order, f"{bound}_most"):
            return False
        is_free = bound == "travel"
        self.order = replace(order, travel=wider) if is_free else replace(order, squeeze=wider)
        self.say(f"{why}: {wider} counts of travel in place of {own}")
        return True

    def bound_travel(self, travel: int) -> None:
        """Writes the position limits of the motion out of contact, `travel` encoder counts to both
        sides of the position at which the measurement began."""
        self.set(
            position_min=max(self.home - travel, self.objects.position_min),
            position_max=min(self.home + travel, self.objects.position_max),
            position_window=self.window(),
        )

    def free(self) -> Level:
        """Measures the frequency response from the DAC code to the encoder position, out of
        contact."""
        self.home = self.axis.integer("position")
        travel = self.order.travel
        self.bound_travel(travel)
        self.set(
            open_loop_code=0, excitation_waveform="noise", excitation_amplitude=0,
            excitation_hold=self._hold_ticks(), excitation_period=self.samples, bump_decay_shift=0,
        )  # fmt: skip
        self.axis.enable("profile position")
        still = self.axis.capture(SIGNALS_APART, samples=self.samples)
        level = Level(self.order.amplitude)
        rest = still.floats("dac_fine"), still.floats("position")
        swing = min(FREE_SWING_CNT, travel / 2)
        try:
            seeds = response.calm_seeds(
                self.order.averages, self.samples, self._hold_ticks(), self.order.seed
            )
            self._measure(level, Excitation(self._apart, POSITION, rest, swing, seeds))
            self.go_home()
        finally:
            self.close()
        return level

    def _hold_ticks(self) -> int:
        """Returns the number of ticks for which the noise signal keeps each of its values."""
        return max(1, int(TICKS_PER_S / (2.5 * self.order.band_hz[1])) // self._shorter)

    @property
    def _reductions_max(self) -> int:
        return REDUCTIONS_MAX_SLIDING if self.order.rubs else REDUCTIONS_MAX

    def _measure(self, level: Level, excitation: Excitation) -> None:
        """Measures a frequency response and writes it to `level`. If the request states no
        amplitude of the excitation, the amplitude is searched first."""
        if not level.amplitude:
            level.amplitude = self._search(level, excitation)
        distorted: list[tuple[int, float]] = []  # amplitude and distortion of each attempt
        attempts = 0
        while attempts < self._reductions_max:
            attempts += 1
            try:
                r, u, y = np.stack(self._realisations(level, excitation), 1)
                break
            except Ended as ended:
                if ended.reason == "distorted":
                    distorted.append((level.amplitude, level.distorted))
                stays = (
                    ended.reason == "distorted"
                    and len(distorted) > 1
                    and (
                        distorted[-1][1] > DISTORTION_FALL * distorted[-2][1]
                        or len(distorted) == self._reductions_max
                    )
                )
                if stays:
                    level.amplitude, self._takes_distortion = distorted[0][0], True
                    attempts = 0  # these attempts had amplitudes within the bounds
                    self.say(
                        "a smaller amplitude does not remove the distortion, as with dry friction: "
                        "it counts as noise of the response"
                    )
                    continue
                level.amplitude = self._reduce(level, level.amplitude, ended)
        else:
            ends = ", ".join(f"{abort.why} at {abort.amplitude} codes" for abort in level.aborts)
            raise Refusal(
                "amplitude",
                "expected an excitation amplitude at which force and travel of the axis stay "
                f"within their bounds, but the axis stopped every excitation early: {ends}"
                + self._remedy(level),
            )
        output = excitation.output
        found = response.estimate(r, u, y, self.lines, self._steps(output))
        level.sensitivity, level.sensitivity_error = found.sensitivity, found.sensitivity_error
        level.speed_rms = self._speed(found.response, u)
        level.swing = float(np.ptp(y, axis=1).max())
        scale = 1
        if output is FORCE:
            scale = self.objects.force_sign
            level.speed_rms *= self.newton
            level.swing *= self.newton
            force = (y * scale).min(), (y * scale).max()
            zero = self.objects.force_zero_code * self.count_per_code
            level.force_min_N, level.force_max_N = (float((f - zero) * self.newton) for f in force)
        level.measured_or_none = Measurement(
            frequency_hz=self.lines * TICKS_PER_S / self.samples,
            response=found.response * scale,
            variance=found.variance,
            coherence=found.coherence,
            floor=found.floor,
            dof=float(len(r) - 1),
            averages=len(r),
            input="dac_code",
            output=output.name,
            unit="count/code",
            dt=1 / TICKS_PER_S,
            inject="codes",
            model=self.model,
            overrides=self.overrides,
            free=output is POSITION,
            scale=float(scale),
            resolution_hz=TICKS_PER_S / self.samples,
            positions=(self.bus.cycle_ticks, self.bus.delay_ticks_in),
            command_delay=self.bus.delay_ticks_out,
            ages=self.ages if output is FORCE else (0.0, 0.0),
            sinc_order=self.sinc_order if output is FORCE else 0,
        )

    def _speed(self, H: response.Response, u: Samples) -> float:
        """Returns the rms rate of change of the output signal, in force counts/s or encoder
        counts/s. Only the changes that the DAC codes cause are included. `H` is the frequency
        response. `u` has the DAC codes, with one row for each realisation."""
        shown = abs(np.fft.rfft(u, axis=1)[:, self.lines]) ** 2
        hz = self.lines * TICKS_PER_S / self.samples
        power = 2 * (shown.mean(0) / self.samples**2) * abs(2 * np.pi * hz * H) ** 2
        return float(np.sqrt(power.sum()))

    def _realisations(self, level: Level, excitation: Excitation) -> list[Record]:
        """Records all realisations of the excitation. Raises Ended if the first realisations show
        distortion. The caller then reduces the amplitude."""
        play, seeds, output = excitation.play, excitation.seeds, excitation.output
        steps = self._steps(output)
        records = [play(level.amplitude, seed) for seed in seeds[:DISTORTION_RECORDS]]
        r, u, y = np.stack(records, 1)
        level.distorted = response.excess(r, u, y, excitation.still, self.lines, steps)
        self.say(
            f"amplitude {level.amplitude} codes: periods differ by {level.distorted:.3g} times the "
            "noise"
        )
        # Dry friction distorts more at a smaller amplitude, so the amplitude is not reduced.
        # The variance of the response contains the distortion by dry friction.
        takes = self.order.rubs or self._takes_distortion
        is_distorted = level.distorted > output.distortion_max and not takes
        if is_distorted and level.amplitude > 1:
            raise Ended("distorted")
        for seed in seeds[DISTORTION_RECORDS:]:
            if self.order.fewest and len(records) >= self.order.fewest:
                r, u, y = np.stack(records, 1)
                found = response.estimate(r, u, y, self.lines, steps)
                error = (
                    found.relative_sensitivity_error() if level.of_loop else found.relative_error()
                )
                if error < ERROR_ENOUGH:
                    break
            records.append(play(level.amplitude, seed))
        return records

    def _steps(self, output: OutputSignal) -> response.Steps:
        code_step = 2.0 ** (DAC_BITS - self.objects.dac_bits)
        # A bus holds each position for one cycle, and with it the rounding error of the position.
        # A slow sensor holds each measured force, with its rounding error, for one sampling period.
        if output is FORCE:
            return code_step, self.count_per_code * math.sqrt(self.held_ticks)
        return code_step, math.sqrt(self.bus.cycle_ticks)

    def _search(self, level: Level, excitation: Excitation) -> int:
        """Searches the amplitude of the excitation. Returns it in DAC codes.

        The amplitude is increased until the peak-to-peak output is large enough, or until the
        expected relative deviation of the response is small enough. It stays within the permitted
        range of force or position.
        """
        output, swing = excitation.output, excitation.swing
        most = min(self.order.most, self.objects.codes_most)
        amplitude = min(self.order.first, most)
        unit = self.newton if output is FORCE else 1.0
        steps = self._steps(output)
        while True:
            try:
                _, u, y = excitation.play(amplitude, excitation.seeds[0], SEARCH_SETTLE_SHARE)
            except Ended as ended:
                return self._reduce(level, amplitude, ended)
            except FewChanges:
                if amplitude >= most:
                    raise
                self.say(f"amplitude {amplitude} codes: the position hardly changes")
                amplitude = min(math.ceil(AMPLITUDE_FACTOR_MIN * amplitude), most)
                continue
            moved = np.ptp(y) * unit
            errors = response.deviation(
                u, y, excitation.still, self.lines, steps, self.order.averages
            )
            error = errors[level.of_loop]
            swung = f"{moved:.3g} {output.unit}"
            self.say(f"amplitude {amplitude} codes: swing {swung}, deviation {100 * error:.2g} %")
            # The position of an axis that sticks has little noise.
            # The expected deviation of an axis that sticks is small, so it does not show sliding.
            # With dry friction, the search increases the amplitude up to its bound.
            may_stick = self.order.rubs and output is FORCE
            is_accurate = error < output.deviation_max and not may_stick
            if moved >= 0.9 * swing or is_accurate or amplitude >= most:
                return amplitude
            room = swing / max(moved, 1e-9)
            wanted = max(AMPLITUDE_FACTOR_MIN, 1.1 * error / output.deviation_max)
            wanted = max(wanted, FACTOR_MAX_SLIDING) if may_stick else wanted
            # An axis that sticks moves less at a small amplitude than in proportion to it.
            most_factor = FACTOR_MAX_SLIDING if may_stick else output.factor_max
            factor = min(wanted, most_factor, room)
            amplitude = min(max(amplitude + 1, int(amplitude * factor)), most)

    def _reduce(self, level: Level, amplitude: int, ended: Ended) -> int:
        """Returns a smaller amplitude, in DAC codes, for the next attempt after an excitation has
        ended early. Raises Refusal after too many reductions."""
        level.aborts.append(Abort(amplitude, ended.reason))
        less = "less" if self.order.rubs else "halved"
        if amplitude < 2 and ended.reason == "ended_travel" and self._widened(level):
            return amplitude
        if amplitude < 2 and self._shortened(level):
            return amplitude
        self.say(f"{ended.reason} at {amplitude} codes: {less}")
        if amplitude < 2 or len(level.aborts) > self._reductions_max:
            raise Refusal(
                ended.reason.removeprefix("ended_"),
                "expected an excitation that keeps force and travel within their bounds, but an "
                f"amplitude of {amplitude} DAC codes exceeds a bound{self._remedy(level)}",
            )
        if level.bias_N is not None:
            self.standing()
        return int(amplitude * (REDUCTION_SLIDING if self.order.rubs else REDUCTION))

    def _widened(self, level: Level) -> bool:
        """Widens the permitted travel, because the axis leaves it even with the smallest
        amplitude. Returns False if the request does not permit this."""
        bound: Literal["travel", "squeeze"] = "travel" if level.bias_N is None else "squeeze"
        own, most = (getattr(self.order, name) for name in (bound, f"{bound}_most"))
        wider = min(2 * own, most)
        if not self.widen(bound, wider, "the smallest amplitude moves the axis farther"):
            return False
        if bound == "travel":
            self.bound_travel(wider)
        else:
            self.standing()
            self.set(excitation_travel=wider)
        return True

    def _shortened(self, level: Level) -> bool:
        """Halves the time for which the noise keeps each value, if the smallest amplitude in
        contact exceeds a bound. A slow sensor has a narrow band, in which a DAC code that is kept
        for long moves the axis far. Returns False if this time is a tick already."""
        ticks = self._hold_ticks()
        if level.bias_N is None or ticks < 2 or len(level.aborts) > self._reductions_max:
            return False
        self._shorter *= 2
        self.standing()
        self.set(excitation_hold=self._hold_ticks())
        self.say(f"the noise keeps each value for {self._hold_ticks()} ticks in place of {ticks}")
        return True

    def _remedy(self, level: Level) -> str:
        """Returns the end of a text about excitations that were ended. It names the bound that was
        exceeded last, and the option with which it would be wider."""
        why, order = level.aborts[-1].why, self.order
        if why == "ended_travel":
            bound = "travel" if level.bias_N is None else "squeeze"
            counts = getattr(order, bound)
            where = "out of contact" if level.bias_N is None else "in contact"
            return f", the travel of {counts} counts {where}; {order.wider(bound, 2 * counts)}"
        if why.startswith("ended_force"):
            text = f", a force of {FORCE_MIN_SHARE + FORCE_MARGIN_SHARE:g} times the set-point"
            most_N = self.force_max_N
            if not math.isfinite(most_N):
                return f"{text}; give other forces"
            larger = "give a larger `force_max_N`"
            if most_N < order.force_max_N:
                counts = self.objects.force_max
                larger = f"raise the object force_max of the axis, {counts:g} counts,"
            return f"{text} or the force bound of {most_N:.4g} N; {larger} or give other forces"
        return ""

    def _force_counts(self, held: Recording) -> Samples:
        """Returns the signal of the force sensor in force counts. Its zero code and its sign are
        not corrected."""
        return held.floats("force_raw") * self.count_per_code

    @property
    def force_max_N(self) -> float:
        """Largest force in N: the smaller one of the force of the order and `force_max` of the
        axis."""
        own = self.objects.force_max * self.newton
        return min(self.order.force_max_N, own or math.inf)

    def press(self, force_N: float) -> float:
        """Approaches the workpiece in mode 4, and presses until the measured force has settled at
        `force_N`. Returns the settled force in N."""
        axis = self.axis
        if math.isfinite(self.force_max_N):
            self.set(force_max=self.force_max_N / self.newton)
        wanted, first_N = force_N, min(force_N, self.order.touch_N or force_N)
        self.set(target_force=self.per_mille(first_N))
        axis.enable("force")
        self._touch()
        if self.order.rubs or first_N < force_N:
            self._keep_contact(first_N)
            self.set(target_force=self.per_mille(force_N))
        for _ in range(BIAS_TRIES):
            reached = self._nearest(force_N)
            if abs(reached - force_N) <= self.order.within * force_N:
                return reached
            wanted *= min(max(force_N / max(reached, 1e-3), 0.5), 2.0)
            self.set(target_force=self.per_mille(wanted))
        raise Refusal(
            "bias", f"expected a measured force of {force_N:g} N, but with target_force "
            f"{self.per_mille(wanted):.4g} per mille the force law of the axis holds only "
            f"{reached:.3g} N; raise force_limit, rated_force or the gain of the law"
        )  # fmt: skip

    def _touch(self) -> None:
        """Waits for the contact. Then increases `contact_loss_cap` to the largest DAC code of the
        approach, without output_bias. With its default value, noise would repeatedly end a light
        contact with a weak force law."""
        fastest = 0

        def touches(state: TouchObjects) -> bool:
            nonlocal fastest
            if not state.contact:
                code = math.ceil(abs(state.dac_code - self.objects.output_bias))
                fastest = max(fastest, code)
            return bool(state.contact or state.contact_losses > before)

        before = self.axis.integer("contact_losses")
        rate = self.axis.number("approach_velocity_max")
        try:
            self.axis.wait_for(TouchObjects, touches, "a contact", self.order.approach_s(rate))
        except NoAnswer as late:
            why = ""
            if self.order.gap and self.order.counts_per_mm:
                mm, speed = (v / self.order.counts_per_mm for v in (self.order.gap, rate))
                why = (
                    f"; in the model the distance is {mm:.3g} mm, and approach_velocity_max is "
                    f"{speed:.3g} mm/s: start nearer to the workpiece, correct `approach` of the "
                    "model, or give a larger `approach_mm_per_s`"
                )
            raise Refusal("contact", f"{late}{why}") from None
        if fastest > self.objects.contact_loss_cap:
            self.set(contact_loss_cap=fastest)

    def _keep_contact(self, force_N: float) -> None:
        """Waits until an axis that bounces stays in contact, for at most KEPT_TRIES times KEPT_S.
        At a first contact, dry friction may hold an axis whose force law has no integral action
        yet, so that it loses the contact again and again; it presses with a larger force then, at
        most `touch_most_N`. `force_N`: force with which the axis presses."""
        wanted, most = force_N, max(force_N, self.order.touch_most_N)
        for _ in range(KEPT_TRIES):
            before, after = self._kept()
            if after.contact and after.contact_losses == before.contact_losses:
                return
            if abs(after.position - before.position) <= STANDSTILL_CNT and wanted < most:
                wanted = min(2 * wanted, most)
                self.say(f"the axis sticks at its first contact: {wanted:.3g} N")
                self.set(target_force=self.per_mille(wanted))

    def _kept(self) -> tuple[KeptObjects, KeptObjects]:
        """Returns the states of the contact before and after a time of KEPT_S."""
        before = self.axis.record(KeptObjects)
        self.wait(KEPT_S, self._expect_enabled)
        return before, self.axis.record(KeptObjects)

    def _nearest(self, force_N: float) -> float:
        """Returns the force in N at which the axis comes to rest. Waits as long as the force
        approaches `force_N`, because the force of a slow loop hardly changes in the time over which
        standing() compares it."""
        reached = self.standing()
        while (away_N := abs(reached - force_N)) > self.order.within * force_N:
            self.wait(NEARER_S, self._expect_enabled)
            reached = self.standing()
            least_N = max(NEARER_SHARE * away_N, 0.5 * self.newton)
            if away_N - abs(reached - force_N) < least_N:
                break
        return reached

    def per_mille(self, force_N: float) -> float:
        """Converts a force in N to per mille of the rated force. The result is at most the largest
        `target_force` that the axis accepts."""
        return min(1e6 * force_N / self.objects.rated_force, bounds.most_force(self.axis))

    def standing(self, timeout_s: float = 20.0) -> float:
        """Waits until the measured force in contact and the DAC code are constant, and returns the
        force in N. The DAC code is compared too, because dry friction can keep the force constant
        while the integral action still changes the code. `timeout_s`: longest time in s in which
        the force comes no nearer to its set-point, however slow the loop is."""
        passed, before, code = 0.0, None, 0.0
        forces_N: list[float] = []
        target_N = self.axis.number("target_force") * 1e-6 * self.objects.rated_force
        least_N = math.inf  # smallest distance from the set-point so far
        while passed < timeout_s:
            self.axis.link.wait(0.2)
            held = self.axis.capture(["force", "dac_fine"], samples=TICKS_PER_S // 5)
            passed += 0.4
            state = self.axis.record(PressedObjects)
            _expect_enabled(state)
            measured_N = held.floats("force") * self.newton
            now = float(np.mean(measured_N))
            forces_N += [float(measured_N.min()), float(measured_N.max())]
            near = before is not None and abs(now - before) < 0.01 * abs(now) + 0.5 * self.newton
            codes = held.values("dac_fine")
            was, code = code, float(np.mean(codes))
            noise = CODE_NOISE * float(np.std(codes)) / math.sqrt(len(codes))
            if state.contact and near and abs(code - was) < max(1.0, 0.02 * abs(code), noise):
                return now
            before = now
            away_N = max(abs(now - target_N), self.newton)
            if away_N < APPROACHES_SHARE * least_N:
                passed, least_N = 0.0, away_N
        raise Unsettled(
            f"expected a force that comes nearer to its set-point within {timeout_s:g} s, or that "
            f"settles, got: {self.axis.about()}{_unsettled(forces_N, target_N)}",
        )

    def excited(self, signals: Sequence[str], samples: int, settle_s: float) -> Recording:
        """Returns a recording of `signals` in contact. The recording begins `settle_s` seconds
        after the start of the excitation that bound() has set up. Raises Ended."""
        axis = self.axis
        try:
            axis.set(excitation_run="start")
        except Refused:
            raise Refusal(
                "contact", f"expected contact with the workpiece, got no contact: {axis.about()}"
            ) from None
        self.wait(settle_s, self._expect_excitation)
        axis.arm(signals, samples)
        held = axis.link.recording(10 + 2 * samples / TICKS_PER_S)
        self._expect_excitation()
        axis.set(excitation_run="stop")
        # A bound may also end the excitation between this command and the end of its ramp.
        ends = axis.wait_for(ExcitationObjects, _has_ended, "the ramp's end")
        if ends.excitation_state != "done":
            raise Ended(ends.excitation_state)
        return held

    def _pressed(self, amplitude: int, seed: int, settle: float = 1.0) -> Record:
        """Records one realisation of the excitation in contact. Returns three signals: waveform of
        the excitation in DAC codes, DAC codes, and force in force counts."""
        self.set(excitation_code=amplitude, excitation_seed=seed)
        settle_s = RAMP_S + settle * self.order.settle_s
        over_bus = () if self.bus.is_immediate else ("position",)
        held = self.excited(SIGNALS_IN_CONTACT + over_bus, self.samples, settle_s)
        wave, code = held.floats("excitation_value"), held.floats("dac_fine")
        if over_bus:
            places = held.floats("position")
            wave, code = self._sent(wave, places), self._sent(code, places)
        return wave, code, self._force_counts(held)

    def _sent(self, code: Samples, places: Samples) -> Samples:
        """Returns the commands that the drive applies at each tick. Over a bus, the drive receives
        one DAC code in each bus cycle, with a delay.

        code: DAC codes of one period. places: positions of the axis at the same ticks. They change
        only in ticks in which the bus transmits a position, so they show the bus cycle. Raises
        Refusal if they show another cycle. Raises FewChanges if there are too few changes, and a
        larger amplitude may help.
        """
        cycle, late_out, late_in = self.bus
        arrivals = np.flatnonzero(np.diff(places)) + 1
        shown = int(np.gcd.reduce(np.diff(arrivals))) if len(arrivals) > 1 else 0
        is_other = shown % cycle or (shown > cycle and len(arrivals) >= ARRIVALS_SURE)
        if is_other or len(arrivals) < ARRIVALS_MIN:
            raise (Refusal if is_other else FewChanges)(
                "cycle",
                f"expected a position that changes once in {cycle} ticks, as the bus of the model "
                f"has it, but {len(arrivals)} changes do not show this cycle: correct cycle_ticks, "
                "or measure with a larger amplitude",
            )
        start = int(arrivals[0]) % cycle - late_in  # tick at which a bus cycle starts
        ticks = np.arange(len(code)) - late_out - start
        return np.asarray(code[(ticks // cycle * cycle + start) % len(code)])

    def _expect_enabled(self) -> None:
        """Raises Refusal if the axis is not enabled."""
        _expect_enabled(self.axis.record(EnabledObjects))

    def _expect_excitation(self) -> None:
        """Raises Refusal or Ended unless the axis is enabled and outputs the excitation."""
        state = self.axis.record(ExcitedObjects)
        _expect_enabled(state)
        if state.excitation_state not in ("running", "ramping_up"):
            raise Ended(state.excitation_state)

    def wait(self, seconds: float, check: Callable[[], None] | None = None) -> None:
        """Waits until the clock of the axis has advanced by `seconds`. Calls check() each time the
        clock is read."""
        ticks, passed = round(seconds * TICKS_PER_S), 0
        begin = self.axis.integer("tick_count")
        while passed < ticks:
            self.axis.link.wait(min(WAIT_POLL_S, (ticks - passed) / TICKS_PER_S))
            passed = (self.axis.integer("tick_count") - begin) % 2**32
            if check:
                check()

    def _apart(self, amplitude: int, seed: int, settle: float = 1.0) -> Record:
        """Records one realisation of the excitation out of contact.

        Returns three signals: DAC codes, the DAC codes again, and position in encoder counts. The
        drift, which is the mean motion from period to period, is subtracted from the position.
        """
        axis, n = self.axis, self.samples
        self.go_home()
        self.set(excitation_amplitude=amplitude, excitation_seed=seed)
        axis.enable("excitation")
        self.wait(FREE_SETTLE_SHARE * settle * self.order.settle_s, self._expect_free)
        # The drift is the mean difference of two samples with a distance of one period.
        count = min(n + n // 4, _most_samples(SIGNALS_APART))
        axis.arm(SIGNALS_APART, count)
        held = axis.link.recording(10 + 2 * count / TICKS_PER_S)
        self._expect_free()
        axis.set(modes_of_operation=1)
        place, u = held.floats("position"), held.floats("dac_fine")
        if np.any(u[n:] != u[: count - n]):
            raise Ended("ended_travel")
        self.expect_apart(held)
        drift = np.mean(place[n:] - place[: count - n])
        ramp = (np.arange(n) - (n - 1) / 2) / n
        code = u[:n] if self.bus.is_immediate else self._sent(u[:n], held.floats("position")[:n])
        return code, code, place[:n] - drift * ramp

    def _expect_free(self) -> None:
        """Raises Refusal or Ended unless the axis moves out of contact and within the permitted
        travel."""
        state = self.axis.record(FreeObjects)
        _expect_enabled(state)
        if state.contact:
            self.refuse_contact()
        if state.limit_reason in ("position_min", "position_max"):
            raise Ended("ended_travel")

    def expect_apart(self, held: Recording) -> None:
        """Raises Refusal if the signal `force` of a recording shows a contact."""
        if np.abs(held.values("force")).max() > self.objects.contact_force:
            self.refuse_contact()

    def refuse_contact(self) -> NoReturn:
        """Stops an axis that has unexpectedly come into contact, moves it back to the position at
        which the measurement began, disables it there, and raises Refusal. An axis that is disabled
        in contact is pushed away by its force, and coasts."""
        self.axis.stop()
        with contextlib.suppress(NoAnswer, Refused):
            self.go_home()
        self.axis.disable()
        raise Refusal(
            "contact",
            "expected an axis out of contact, but the axis touched the workpiece; start further "
            "away",
        )

    def window(self) -> int:
        """Returns the value of `position_window` for the moves of a measurement, in encoder counts.
        A position law without integral action stops beside its target if the axis has dry friction
        or a weight."""
        return max(self.objects.position_window, round(WINDOW_SHARE * self.order.travel))

    def go(self, position: int, until_contact: bool = False) -> ReachedPosition:
        """Moves the axis to `position` in encoder counts, at most at the speed of the approach, so
        that it does not strike the workpiece harder than at a first contact. With `until_contact`,
        it also returns when the axis comes into contact; the axis then still moves. Raises
        NoAnswer, Refused."""
        axis = self.axis
        speed = min(axis.number("trajectory_velocity"), axis.number("approach_velocity_max"))
        self.set(position_window=self.window(), trajectory_velocity=speed)
        axis.enable("profile position")
        way = abs(axis.integer("position") - position)
        return axis.move(position, MOVE_S + MOVE_FACTOR * way / speed, until_contact)

    def go_home(self) -> None:
        """Moves the axis back to the position at which the measurement began, at most at the speed
        of the approach. Raises NoAnswer, Refused."""
        if abs(self.axis.integer("position") - self.home) > STANDSTILL_CNT:
            self.go(self.home)
        else:
            self.axis.enable("profile position")
        self.wait(0.2)


def disable(axis: Axis) -> None:
    """Disables an axis. Waits until its brake has engaged, if it has one, because it accepts no
    parameters before."""
    axis.disable()
    if axis.integer("brake_engage_ticks"):
        axis.off()


def finest_resolution_hz() -> float:
    """Returns the smallest distance of spectral lines in Hz with which the recorder can store a
    complete period, also over a bus."""
    most = min(_most_samples((*SIGNALS_IN_CONTACT, "position")), _most_samples(SIGNALS_APART) // 2)
    return TICKS_PER_S / most


def _most_samples(signals: Sequence[str]) -> int:
    """Returns the largest number of samples that the recorder can store of these signals."""
    return RECORDER_BYTES // sum(int(BY_NAME[name].type[1:]) // 8 for name in signals)


def _has_ended(state: ExcitationObjects) -> bool:
    return state.excitation_state == "done" or state.excitation_state.startswith("ended")


def _unsettled(forces_N: list[float], target_N: float) -> str:
    """Returns a text about a force that did not settle, and what to change. `forces_N`: smallest
    and largest force in N of each reading, the last reading at the end."""
    recent = forces_N[-2 * UNSETTLED_READINGS :]
    low, high = min(recent), max(recent)
    text = f"; with a set-point of {target_N:.4g} N the force was at last {low:.4g} to {high:.4g} N"
    if high - low < UNSETTLED_SHARE * target_N:
        return f"{text}, while the DAC code changed: something holds the axis, or its drive limits"
    return (
        f"{text}: with dry friction or backlash the integral action of a law moves it to and fro; "
        "reduce the friction of guide and workpiece, or take larger `forces`"
    )


def _expect_enabled(state: EnabledObjects) -> None:
    """Raises Refusal if the axis is not enabled."""
    if state.fault != "none" or state.drive_state != "operation_enabled":
        raise Refusal(
            "fault" if state.fault != "none" else "disabled",
            "expected an axis that stays enabled during the measurement, but the drive state is "
            f"{state.drive_state} with the fault {state.fault}",
        )
