"""Measures the frequency response of an axis from the DAC code to the force or to the position.

    analyzer = Analyzer(axis, MeasuringOrder(force_max_N=120))
    analyzer.rest()
    free = analyzer.free()
    pressed = analyzer.contact(30.0)

In contact the waveform is added to the output of the force law in mode 4. The loop stays closed,
because an axis with an integrating drive would drift in open loop. Each realisation is another
noise sequence of one period: the axis settles during the first period and the analyzer records the
next period. Out of contact the analyzer uses the open-loop excitation mode. It moves the axis back
to its start position before each realisation and at the end.

The firmware ends the excitation in the tick in which a bound is exceeded. close() disables the axis
and restores all objects that the analyzer has written.
"""

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from forceaxis import linear
from forceaxis.axis import bounds
from forceaxis.axis.axis import Axis
from forceaxis.axis.drive import ExcitationObjects
from forceaxis.axis.link import TICKS_PER_S, NoAnswer, Recording, Refused
from forceaxis.bus.state_names import BY_NAME
from forceaxis.commission import friction, known, response
from forceaxis.commission.level import Abort, Level, MeasuringOrder, Rest, Samples, noise_of
from forceaxis.commission.refusal import Refusal
from forceaxis.identify.measurement import Measurement

Record = tuple[Samples, Samples, Samples]  # waveform, codes, output; (n,) each
Play = Callable[..., Record]  # (amplitude in codes, seed, settling time as a share) -> Record

IN_CONTACT = ("force_raw", "dac_code", "excitation_value")
APART = ("position", "dac_code", "force")
SWING = MeasuringOrder.swing
# relative standard deviation of the response, median over the lines
DEVIATION = {"adc0": 0.05, "encoder": 0.02}
LOWEST = 0.5  # share of the bias force: the measured force does not fall below it
MARGIN = 0.1  # share of the bias force: distance of the excitation bounds from the expected force
RAMP_S = 0.1
APPROACH_S = 60.0
RELEASE_S = 1.0
WAIT_POLL_S = 0.1
BIAS_TRIES = 8
QUIET_LSB = 0.4  # rms: below it the rounding hides the noise of the measured force
JUDGED = 3  # number of realisations from which the distortion is computed
# Permitted ratio of the difference of realisations to their noise. It is above 1, because the
# rounding of a slow motion is not white noise.
DISTORTED = {"adc0": 1.35, "encoder": 6.0}
# smallest and largest factor of the amplitude in one step
LEAST_STEP, FAR = 1.4, {"adc0": 8.0, "encoder": 4.0}
BACKS = 6  # largest number of times that the amplitude is halved
# With dry friction, the amplitude is this multiple of the friction if the bounds permit it, so
# that the axis slides.
LESS, BACKS_RUBS = 0.7, 12
FREE_SWING = 400  # counts, peak to peak
FREE_SETTLE = 0.3  # settling time out of contact, as a share of the settling time in contact
# settling time during the search of the amplitude, as a share of the normal one
SEARCH_SETTLE = 0.5
CERTAIN = 0.04  # relative error, median over the lines, at which fewer averages suffice
STANDING = 4  # counts: at standstill the position changes by less
CODE_NOISE = 5.0  # largest difference of two mean DAC codes, in standard deviations of a mean


@dataclass(frozen=True)
class TouchObjects:
    """Whether the axis is in contact (1), number of contact losses, DAC code."""

    contact: int
    contact_losses: int
    dac_code: int


class Ended(Exception):
    """The axis has ended an excitation; the argument is the name in `excitation_state`."""


class Analyzer:
    """Measures responses of an Axis that is owned and disabled; close() restores its parameters and
    disables it.

    model, overrides: the model and its changed parameters for Measurement.predict(); "" without a
    model. Methods raise Refusal, and NoAnswer and Refused of the connection.
    """

    def __init__(
        self, axis: Axis, order: MeasuringOrder | None = None, model: str | Path = "",
        overrides: linear.Overrides | None = None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        self.axis, self.order, self.say = axis, order or MeasuringOrder(), say
        self.model, self.overrides = str(model), dict(overrides or {})
        self._before: dict[str, Any] = {}
        names = ("adc_bits", "force_sign", "force_zero_code", "force_scale", "rated_force",
                 "contact_force", "force_max", "tare_band", "contact_loss_cap", "position",
                 "position_min", "position_max", "output_limit")  # fmt: skip
        held = axis.get(*names)
        self.bits, self.sign, self.zero = (held[n] for n in names[:3])
        self.newton = held["force_scale"] * 1e-6  # N per force count
        self.rated_N = held["rated_force"] * 1e-3
        self.known, self.home = held, held["position"]
        self.samples = round(TICKS_PER_S / self.order.resolution_hz)
        low, high = self.order.band_hz
        if not 0 < low < high < TICKS_PER_S / 2:
            raise Refusal("band", f"expected 0 < low < high < 750 Hz, got {low:g} to {high:g} Hz")
        self.lines = response.lines_of(self.samples, (low, high), TICKS_PER_S)
        if not len(self.lines):
            raise Refusal("band", "expected a line in it; take a finer resolution")
        if self.samples > self._most_samples(IN_CONTACT):
            finest = TICKS_PER_S / self._most_samples(IN_CONTACT)
            raise Refusal(
                "resolution", f"expected at least {finest:.2g} Hz, of which the recorder holds a "
                f"whole period, got {self.order.resolution_hz:g} Hz"
            )  # fmt: skip

    def _most_samples(self, signals: Sequence[str]) -> int:
        """Largest number of samples of these signals in the recorder's memory of 32 KiB."""
        width = sum(int(BY_NAME[name].type[1:]) // 8 for name in signals)
        return 32768 // width

    def set(self, **values: Any) -> None:
        """Writes parameters; close() restores their previous values."""
        new = [name for name in values if name not in self._before]
        if new:
            self._before |= self.axis.get(*new)
        self.axis.set(**values)

    def close(self) -> None:
        """Disables the axis and restores the values that set() has replaced."""
        self.axis.disable()
        before, self._before = self._before, {}
        for name, value in before.items():
            try:
                self.axis.put_back(**{name: value})
            except Refused:
                self.say(f"{name} could not be set to {value} again")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # if the axis does not answer, its watchdog disables it
        with contextlib.suppress(NoAnswer):
            self.close()

    def rest(self) -> Rest:
        """Checks and returns the state of the disabled axis at rest. Raises Refusal if the axis
        moves or its force is not tared. A motor without power may move within the backlash of its
        gear; the check permits this motion."""
        held = self.axis.capture(["force_raw", "position", "force"], samples=TICKS_PER_S // 2)
        raw, place = held.values("force_raw"), held.values("position")
        if np.ptp(place) > STANDING + self._play():
            moved = f"{np.ptp(place)} encoder counts"
            raise Refusal("moving", f"expected an axis at rest, it moves by {moved}")
        reading = float(np.mean(held.values("force")))
        band = self.known["tare_band"] or self.known["contact_force"] / 2
        if abs(reading) > band:
            raise Refusal(
                "tare", f"expected a reading within {band:g} force counts at rest, got "
                f"{reading:.3g}; move the axis out of contact and tare it"
            )  # fmt: skip
        ends = raw.min() == 0 or raw.max() == 2**self.bits - 1
        noise = None if ends else noise_of(raw)
        return Rest(reading, noise, int(np.median(place)))

    def _play(self) -> int:
        """Total backlash of the model in encoder counts; 0 without a model."""
        return known.play_counts(self.model, self.overrides) if self.model else 0

    def contact(self, force_N: float, of_loop: bool = False) -> Level:
        """The response from the DAC code to the measured force at the force `force_N`. of_loop: the
        amplitude is searched for the accuracy of the sensitivity function, for which a smaller
        amplitude suffices."""
        order = self.order
        if not force_N * (1 + SWING / 2) < order.force_max_N:
            raise Refusal(
                "force", f"expected a force below {order.force_max_N / (1 + SWING / 2):.4g} N, "
                f"whose swing stays below force_max, got {force_N:g} N"
            )  # fmt: skip
        bias = self.press(force_N)
        self.bound(bias, "noise", self.samples)
        still = self.axis.capture(IN_CONTACT, samples=self.samples)
        noise = noise_of(still.values("force_raw"))
        level = Level(order.amplitude, bias, noise)
        seeds = [(order.seed + i) % 65536 for i in range(order.averages)]
        level.of_loop = of_loop
        self._measure(level, self._pressed, still, order.swing * bias, "adc0", seeds)
        # without it the contact spring would push the axis away after the disabling
        self.set(target_force=0)
        self.wait(RELEASE_S, lambda: None)
        return level

    def bound(self, bias_N: float, waveform: str, period: int) -> None:
        """Sets up an excitation of the force law's output about `bias_N`, with the bounds at which
        the axis ends the excitation. period: ticks, 0 without a period."""
        least, most = (LOWEST + MARGIN) * bias_N, self.order.force_max_N - MARGIN * bias_N
        most = min(most, BY_NAME["excitation_force_max"].max / 256 * self.newton)
        self.set(
            excitation_waveform=waveform, excitation_point="output", excitation_code=0,
            excitation_hold=self._hold(), excitation_seed=0,
            excitation_period=period, excitation_ramp=1e3 * RAMP_S,
            excitation_force_min=least / self.newton, excitation_force_max=most / self.newton,
            excitation_travel=self.order.travel,
        )  # fmt: skip

    def free(self) -> Level:
        """The response from the DAC code to the encoder position, out of contact."""
        start = self.axis.read("position")
        travel = self.order.travel
        self.set(
            position_min=max(start - travel, self.known["position_min"]),
            position_max=min(start + travel, self.known["position_max"]),
            open_loop_code=0, excitation_waveform="noise", excitation_amplitude=0,
            excitation_hold=self._hold(),
            excitation_period=self.samples, bump_decay_shift=0,
        )  # fmt: skip
        self.home = start
        self.axis.enable("profile position")
        still = self.axis.capture(APART, samples=self.samples)
        level = Level(self.order.amplitude)
        try:
            seeds = response.calm_seeds(
                self.order.averages, self.samples, self._hold(), self.order.seed
            )
            self._measure(level, self._apart, still, min(FREE_SWING, travel / 2), "encoder", seeds)
            self.go_home()
        finally:
            self.close()
        return level

    def between(self, low_N: float, high_N: float) -> Record:
        """Changes the force slowly from `low_N` to `high_N` and back; returns (measured force in N,
        position in counts, DAC codes), each (n,)."""
        reached = self.press(low_N)
        self.rated_N = self.axis.read("rated_force") * 1e-3
        found = friction.between(self, low_N, high_N, reached)
        self.set(target_force=0)  # for the same reason as in contact()
        self.wait(RELEASE_S, lambda: None)
        return found

    def _hold(self) -> int:
        return max(1, int(TICKS_PER_S / (2.5 * self.order.band_hz[1])))

    def _measure(
        self, level: Level, play: Play, still: Recording, swing: float, output: str,
        seeds: Sequence[int],
    ) -> None:  # fmt: skip
        """Searches the amplitude unless the order gives it, then measures the response into
        `level`."""
        records = None
        if not level.amplitude:
            level.amplitude = self._search(level, play, still, swing, output, seeds[0])
        rest = still.values("dac_code"), self._output(still, output)
        for _ in range(BACKS_RUBS if self.order.rubs else BACKS):
            try:
                records = self._realisations(level, play, seeds, rest, output)
                break
            except Ended as ended:
                level.amplitude = self._halve(level, level.amplitude, ended)
        if records is None:
            raise Refusal("amplitude", f"expected one that the bounds permit, got {level.aborts}")
        r, u, y = (np.array([record[i] for record in records]) for i in range(3))
        steps = self._steps(output)
        found, level.sensitivity, level.sensitivity_error = response.estimate(
            r, u, y, self.lines, steps
        )
        level.speed_rms = self._speed(found["response"], u)
        scale = self.sign if output == "adc0" else 1
        found["response"] = found["response"] * scale
        level.swing = float(np.ptp(y, axis=1).max())
        if output == "adc0":
            level.speed_rms *= self.newton
            level.swing *= self.newton
            force = (y * scale).min(), (y * scale).max()
            zero = self.zero * 2.0 ** (8 - self.bits)
            level.force_min_N, level.force_max_N = (float((f - zero) * self.newton) for f in force)
        level.measured_or_none = Measurement(
            frequency_hz=self.lines * TICKS_PER_S / self.samples,
            **found,
            dof=float(len(r) - 1),
            averages=len(r),
            input="dac_code",
            output=output,
            unit="count/code",
            dt=1 / TICKS_PER_S,
            inject="codes",
            model=self.model,
            overrides=self.overrides,
            free=output == "encoder",
            scale=float(scale),
            resolution_hz=TICKS_PER_S / self.samples,
        )

    def _speed(self, response: Any, u: Samples) -> float:
        """Rms of the output's rate of change that the codes cause, in N/s or counts/s."""
        shown = abs(np.fft.rfft(u, axis=1)[:, self.lines]) ** 2
        hz = self.lines * TICKS_PER_S / self.samples
        power = 2 * (shown.mean(0) / self.samples**2) * abs(2 * np.pi * hz * response) ** 2
        return float(np.sqrt(power.sum()))

    def _realisations(
        self, level: Level, play: Play, seeds: Sequence[int], rest: response.Still, output: str
    ) -> list[Record]:
        """Records all realisations. If the first realisations show distortion, the amplitude is
        reduced first."""
        records = [play(level.amplitude, seed) for seed in seeds[:JUDGED]]
        r, u, y = (np.array([record[i] for record in records]) for i in range(3))
        found = response.excess(r, u, y, rest, self.lines, self._steps(output))
        self.say(f"{level.amplitude} codes: {found:.3g} times the noise")
        level.distorted = float(found)
        # Dry friction distorts more at a smaller amplitude, and the variance contains this
        # distortion.
        if found > DISTORTED[output] and level.amplitude > 1 and not self.order.rubs:
            raise Ended("distorted")
        for seed in seeds[JUDGED:]:
            if self.order.fewest and len(records) >= self.order.fewest:
                r, u, y = (np.array([record[i] for record in records]) for i in range(3))
                steps = self._steps(output)
                if response.error(r, u, y, self.lines, steps, level.of_loop) < CERTAIN:
                    break
            records.append(play(level.amplitude, seed))
        return records

    def _steps(self, output: str) -> response.Steps:
        return 1.0, (2.0 ** (8 - self.bits) if output == "adc0" else 1.0)

    def _search(
        self, level: Level, play: Play, still: Recording, swing: float, output: str, seed: int
    ) -> int:
        """Searches the amplitude in codes. It is increased within the permitted force or position
        range until the output is large enough or the expected relative deviation is below
        DEVIATION."""
        most = min(self.order.most, self.known["output_limit"])
        amplitude = min(self.order.first, most)
        unit = self.newton if output == "adc0" else 1.0
        steps = self._steps(output)
        rest = still.values("dac_code"), self._output(still, output)
        while True:
            try:
                _, u, y = play(amplitude, seed, SEARCH_SETTLE)
            except Ended as ended:
                return self._halve(level, amplitude, ended)
            moved = np.ptp(y) * unit
            errors = response.deviation(u, y, rest, self.lines, steps, self.order.averages)
            error = errors[level.of_loop]
            swung = f"{moved:.3g} {'N' if unit != 1 else 'encoder counts'}"
            self.say(f"amplitude {amplitude} codes: swing {swung}, deviation {100 * error:.2g} %")
            # While the axis sticks its noise is small, so the amplitude has to be as large as the
            # bounds permit.
            sure = error < DEVIATION[output] and not (self.order.rubs and output == "adc0")
            if moved >= 0.9 * swing or sure or amplitude >= most:
                return amplitude
            room = swing / max(moved, 1e-9)
            wanted = max(LEAST_STEP, 1.1 * error / DEVIATION[output])
            factor = min(wanted, FAR[output], room)
            amplitude = min(max(amplitude + 1, int(amplitude * factor)), most)

    def _halve(self, level: Level, amplitude: int, ended: Ended) -> int:
        level.aborts.append(Abort(amplitude, ended.args[0]))
        self.say(f"{ended.args[0]} at {amplitude} codes: {'less' if self.order.rubs else 'halved'}")
        if amplitude < 2 or len(level.aborts) > (BACKS_RUBS if self.order.rubs else BACKS):
            raise Refusal(
                ended.args[0].removeprefix("ended_"),
                f"expected an excitation within the bounds, {amplitude} codes pass them",
            )
        if level.bias_N is not None:
            self.standing()
        return int(amplitude * LESS) if self.order.rubs else amplitude // 2

    def _output(self, held: Recording, output: str) -> Any:
        if output == "encoder":
            return held.values("position").astype(float)
        return held.values("force_raw") * 2.0 ** (8 - self.bits)

    def press(self, force_N: float) -> float:
        """Approaches in mode 4 and presses until the measured force has settled at `force_N`;
        returns the settled force in N."""
        axis = self.axis
        if math.isfinite(self.order.force_max_N):
            bound, own = self.order.force_max_N / self.newton, self.known["force_max"]
            self.set(force_max=min(bound, own) if own else bound)
        wanted = force_N
        self.set(target_force=self.per_mille(wanted))
        axis.enable("force")
        self._touch()
        for _ in range(BIAS_TRIES):
            reached = self.standing()
            if abs(reached - force_N) <= self.order.within * force_N:
                return reached
            wanted *= min(max(force_N / max(reached, 1e-3), 0.5), 2.0)
            self.set(target_force=self.per_mille(wanted))
        raise Refusal(
            "bias", f"expected the reading to stand at {force_N:g} N, it stands at {reached:.3g} N "
            f"with the law that the axis has and a target of {self.per_mille(wanted):.4g} per "
            "mille; raise force_limit, rated_force or the law's gain"
        )  # fmt: skip

    def _touch(self) -> None:
        """Waits for the contact. After a contact loss the axis may then approach at the speed of
        the first approach. With the default limit, a weak force law would lose a light contact for
        a tick again and again because of noise."""
        fastest = 0

        def touches(state: TouchObjects) -> bool:
            nonlocal fastest
            fastest = max(fastest, abs(state.dac_code)) if not state.contact else fastest
            return bool(state.contact or state.contact_losses > before)

        before = self.axis.read("contact_losses")
        try:
            self.axis.wait_for(TouchObjects, touches, "a contact", APPROACH_S)
        except NoAnswer as late:
            raise Refusal("contact", str(late)) from None
        if fastest > self.known["contact_loss_cap"]:
            self.set(contact_loss_cap=fastest)

    def per_mille(self, force_N: float) -> float:
        """Target of a force in per mille of the rated force, limited to the axis' own limit."""
        return min(1e3 * force_N / self.rated_N, bounds.most_force(self.axis))

    def standing(self, timeout_s: float = 20.0) -> float:
        """Waits until the measured force in contact and the DAC code are constant; returns the
        force in N. Both are compared, because dry friction can keep the force constant while the
        integral action still changes the code."""
        passed, before, code = 0.0, None, 0.0
        while passed < timeout_s:
            self.axis.link.wait(0.2)
            held = self.axis.capture(["force", "dac_code"], samples=TICKS_PER_S // 5)
            passed += 0.4
            state = self.axis.get("contact", "fault", "drive_state", "contact_losses")
            self._expect_enabled(state)
            now = float(np.mean(held.values("force"))) * self.newton
            near = before is not None and abs(now - before) < 0.01 * abs(now) + 0.5 * self.newton
            codes = held.values("dac_code")
            was, code = code, float(np.mean(codes))
            noise = CODE_NOISE * float(np.std(codes)) / math.sqrt(len(codes))
            if state["contact"] and near and abs(code - was) < max(1.0, 0.02 * abs(code), noise):
                return now
            before = now
        raise Refusal(
            "contact", f"expected a force that stands within {timeout_s:g} s, {self.axis.about()}"
        )

    def _expect_enabled(self, state: Mapping[str, Any]) -> None:
        if state["fault"] != "none" or state["drive_state"] != "operation_enabled":
            raise Refusal(
                "fault" if state["fault"] != "none" else "disabled",
                f"expected an axis that goes on, it is {state['drive_state']}, "
                f"fault {state['fault']}",
            )

    def _pressed(self, amplitude: int, seed: int, settle: float = 1.0) -> Record:
        """Records a realisation in contact: (r, u, y), each (n,), in codes, codes and counts."""
        axis = self.axis
        self.set(excitation_code=amplitude, excitation_seed=seed)
        try:
            axis.set(excitation_run="start")
        except Refused:
            raise Refusal("contact", f"expected contact, {axis.about()}") from None
        self.wait(RAMP_S + settle * self.order.settle_s, self.goes_on)
        axis.arm(IN_CONTACT, self.samples)
        held = axis.link.recording(10 + 2 * self.samples / TICKS_PER_S)
        self.goes_on()
        axis.set(excitation_run="stop")
        axis.wait_for(ExcitationObjects, lambda s: s.excitation_state == "done", "the ramp's end")
        wave = held.values("excitation_value")
        return wave, held.values("dac_code"), self._output(held, "adc0")

    def goes_on(self) -> None:
        """Raises Refusal or Ended unless the axis is enabled and its excitation runs."""
        state = self.axis.get("excitation_state", "fault", "drive_state")
        self._expect_enabled(state)
        if state["excitation_state"] not in ("running", "ramping_up"):
            raise Ended(state["excitation_state"])

    def wait(self, seconds: float, check: Callable[[], object]) -> None:
        """Waits for `seconds` of the axis' time; calls check() at each poll."""
        passed = 0.0
        while passed < seconds:
            step = min(WAIT_POLL_S, seconds - passed)
            self.axis.link.wait(step)
            passed += step
            check()

    def _apart(self, amplitude: int, seed: int, settle: float = 1.0) -> Record:
        """A realisation out of contact: (u, u, y), without the drift from period to period."""
        axis, n = self.axis, self.samples
        self.go_home()
        self.set(excitation_amplitude=amplitude, excitation_seed=seed)
        axis.enable("excitation")
        self.wait(FREE_SETTLE * settle * self.order.settle_s, self._free)
        # the drift is the difference of two samples that are one period apart
        count = min(n + n // 4, self._most_samples(APART))
        axis.arm(APART, count)
        held = axis.link.recording(10 + 2 * count / TICKS_PER_S)
        self._free()
        axis.set(modes_of_operation=1)
        place, u = self._output(held, "encoder"), held.values("dac_code")
        if np.any(u[n:] != u[: count - n]):
            raise Ended("ended_travel")
        if np.abs(held.values("force")).max() > self.known["contact_force"]:
            raise Refusal("contact", "expected the axis apart, it touched; start further away")
        drift = np.mean(place[n:] - place[: count - n])
        ramp = (np.arange(n) - (n - 1) / 2) / n
        return u[:n], u[:n], place[:n] - drift * ramp

    def _free(self) -> None:
        state = self.axis.get("contact", "fault", "drive_state", "limit_reason")
        self._expect_enabled(state)
        if state["contact"]:
            self.axis.disable()
            raise Refusal("contact", "expected the axis apart, it touched; start further away")
        if state["limit_reason"] in ("position_min", "position_max"):
            raise Ended("ended_travel")

    def go_home(self) -> None:
        """Moves the axis back to the position at which the measurement began."""
        self.axis.enable("profile position")
        if abs(self.axis.read("position") - self.home) > STANDING:
            self.axis.move(self.home)
        self.wait(0.2, lambda: None)
