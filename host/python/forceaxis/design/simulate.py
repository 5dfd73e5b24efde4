"""Simulates contacts with the firmware, for effects that the linear analysis does not contain.

A ContactBench is a model with an ADC of the chosen resolution, and with the axis in mode of
operation 4. Its cases are simulated contacts: first contacts at three set-points, one of them at
half the approach speed, and impacts at the two lower set-points. Each case runs with every latency,
on the nominal plant and on random plants of a set.

The table [verdict] of each case has limits. In a first contact, the force error is at most
ERROR_MAX, the peak force is at most PEAK_MAX set-points, and the contact is lost at most LOSSES_MAX
times. The impact of a first contact may exceed these limits with every control law. The limits are
then larger (see measure_impacts). After an additional impact, the force has to settle and to stay
at the set-point.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tomlkit

from forceaxis import _core, objects, toml
from forceaxis._core import InputError
from forceaxis.axis import bus_times
from forceaxis.design import changes, experiment_file, friction
from forceaxis.design.cases import (
    ContactCase,
    ContactRun,
    GainCut,
    NamedCase,
    SimulatedContact,
    read_run,
    simulated_contact,
    unstable,
    why,
)
from forceaxis.design.changes import Design
from forceaxis.design.experiment_file import ExperimentText, FirmwareValue, Impulse, Write
from forceaxis.design.new import first_gain, highest_gain
from forceaxis.design.outcome import ContactLoss
from forceaxis.errors import ParameterError
from forceaxis.linear import loops
from forceaxis.linear import system as linear
from forceaxis.linear.bank import Bank
from forceaxis.results import to_json

Job = tuple[str, list[str]]  # one simulated run: (experiment, texts NAME=VALUE)
Plant = dict[str, float]  # {parameter: value in SI units} of a plant; empty for the nominal plant
LossChoice = tuple[int, int]  # contact_loss_cap in DAC codes, contact_loss_dwell in ms
Contact = tuple[ContactCase | NamedCase, Plant, int]  # one contact: case, plant, latency in ticks

# Force set-points as shares of the range of the measured force: 12, 30 and 60 counts of 255.
SETPOINTS = (12 / 255, 30 / 255, 60 / 255)
STALL_FORCE_SHARE = 0.25  # largest force set-point as a share of the largest force of the drive
RAMP_S = 0.2  # rise time in s of the largest force set-point
STRIKE_S = 0.5 / 150  # impulse of an impact in N s per newton of the largest set-point
APPROACH_M_PER_S = 0.02  # largest approach speed in m/s if no experiment gives a speed
# Force at the end of the sensor's delay after a contact, as a share of the least force set-point.
BLIND_SHARE = 0.3
# Smallest force set-point, as a multiple of the weight along the axis and of the rms noise.
# With a smaller force set-point, weight or noise alone ends a contact.
WEIGHT_FACTOR, NOISE_FACTOR = 1.2, 8.0
# Below this rate of the sensor in Hz, the text about a failed contact names the sensor.
SLOW_SENSOR_HZ = 200.0
WINDOW_S = 0.5  # length in s of the window of the verdict
# Shortest and longest time in s from the first contact to the window of the verdict.
SETTLE_S = (1.5, 10.0)
# Largest permitted force ripple in 8-bit counts, peak to peak: RIPPLE_COUNT or a larger value.
# The larger value of the ripple is one count plus NOISE_RIPPLE x the rms noise of the sensor.
# A force law amplifies this noise a little.
RIPPLE_COUNT, NOISE_RIPPLE = 3.0, 9.0
# FLICKER_LOSSES: further permitted contact losses if contact_force < FLICKER_NOISE x rms noise.
# While the force passes `contact_force` slowly, the noise alone then causes contact losses.
FLICKER_LOSSES, FLICKER_NOISE = 3, 8.0
LEAST_COUNT = 4  # smallest force set-point in 8-bit counts: twice the default of `contact_force`
# Firmware settings that the simulated contacts take from the experiment of the design.
KEPT = (
    "position_gain", "velocity_gain", "approach_velocity_max", "contact_force", "force_sign",
    "rated_force", "position_age_max", "force_age_max", "drive_on_ticks_max", "output_bias",
    "brake_engage_ticks",
)  # fmt: skip
# Factors by which the impulse of a simulated impact is multiplied in a series of impacts.
STRIKE_FACTORS = (1.0, 1.6, 2.4, 4.0, 5.6, 8.0, 11.0, 16.0)
DWELLS_MS = (300, 100, 600)  # values of `contact_loss_dwell` in ms, in the order of simulation
# FRICTION_SHARES: shares of the largest friction that the axis overcomes after a contact loss.
# MOST_FRICTION_SHARE: share of this friction at approach speed, if FRICTION_SHARES do not suffice.
FRICTION_SHARES, MOST_FRICTION_SHARE = (0.5, 1.0), 2.0
# Factor of one reduction of the gain, and largest number of reductions of the gain.
BACKOFF, BACKOFFS = 0.9, 20
REPEATED_MAX = 6  # number of unstable contacts that are simulated first at the next gain
# Largest permitted force error, beside the static error of the law, divided by the set-point.
# A force error of HALF_COUNT is always permitted.
ERROR_MAX = 0.02
HALF_COUNT = 0.6  # largest error of the measured force at rest, in 8-bit counts
PEAK_MAX = 1.3  # largest permitted peak force as a multiple of the force set-point
LOSSES_MAX = 1  # permitted number of contact losses after a first contact
# Shares of the approach speed, in the order in which they are simulated.
SPEED_SHARES = (1.0, 0.5, 0.25, 0.1)
SATURATED_MAX_S = 0.02  # longest permitted time in s with the DAC code at an end of the DAC range
# With this share of the designed gain, the control law has no influence on an impact.
WEAK_GAIN_SHARE = 0.25


class ContactBench:
    """A model with an ADC of `bits` bits, with which contacts are simulated.

    `own`: an experiment of the user that is simulated too. `firmware`: firmware settings that
    replace those of the experiment. `forces_N`: force set-points in N. If `forces_N` is empty, the
    ranges of sensor and drive determine the set-points.
    """

    def __init__(
        self, design: Design, bits: int, own: Path | None = None,
        firmware: Mapping[str, float | str] | None = None, forces_N: Sequence[float] = (),
    ) -> None:  # fmt: skip
        self.design, self.own, self._bits = design, own, bits
        self.forces_N = tuple(sorted(set(forces_N)))
        self.peak_max = PEAK_MAX
        # Permitted contact losses of a first contact, besides those that the impact causes.
        self.losses_max = LOSSES_MAX
        # Contact losses and peak force in N that the impact alone causes.
        self.impacts: dict[ContactCase, tuple[int, float]] = {}
        own_bits = design.facts.required_reading.bits
        self.change = (
            changes.Change(firmware={"adc_bits": bits})
            if bits == own_bits
            else changes.resolution(design, bits)
        )
        self.model = design.changed_model(self.change)
        self.overrides = design.overrides | dict(self.change.overrides)
        self.settle_s = SETTLE_S[0]
        # static error of a law without integral action; see wait_for()
        self.static_error = math.inf
        self.facts = linear.facts(self.model, self.overrides)
        self.count_N = abs(self.facts.required_reading.per_count)
        self._given = experiment_file.firmware_table(design.experiment)
        self._asked = dict(firmware or {})
        self._given |= self._asked
        self._check()
        self.settings = self._settings(bits)
        self.cases = self._cases()
        self._files: dict[tuple[ContactCase | Path, Bank, tuple[int, ...]], Path] = {}
        text = friction.named(Path(self.model))
        self._run_model = self.design.file("rubbing.toml", text) if text else self.model
        self.frictions = friction.ranges(self._run_model, self.overrides)

    def at(self, share: float) -> "ContactBench":
        """Returns a bench with the same contacts, at `share` times the approach speed of this
        bench."""
        scale = abs(self.facts.required_encoder.scale)
        count = max(1, round(share * self.cases[0].speed_m_per_s * scale))
        # The new bench must not use the files of this bench, which have the same names.
        self._files = {}
        return ContactBench(
            self.design, self._bits, self.own, self._asked | {"approach_velocity_max": count},
            self.forces_N,
        )  # fmt: skip

    def wait_for(
        self, bank: Bank, fS_Hz: float | None = None, static_error: float = math.inf
    ) -> None:
        """Lengthens the simulated time of the contacts if the integral action of a filter bank is
        slow. For a law without integral action, `fS_Hz` is its bandwidth, and `static_error` is its
        static error as a share of the set-point, which the verdict of a contact permits. The call
        has no effect on files that were already written."""
        self.static_error = static_error
        low, high = SETTLE_S
        if bank.integral_rad_per_s:
            self.settle_s = min(max(low, round(6 / bank.integral_rad_per_s, 1)), high)
        elif fS_Hz:  # four time constants of an integrating plant
            self.settle_s = min(max(low, round(4 / (2 * math.pi * fS_Hz), 1)), high)

    def _check(self) -> None:
        """Raises InputError if the model lacks a force sensor, a contact or an encoder."""
        signal = self.facts.required_reading.signal
        if self.facts.signals.get(signal) != "N":
            raise InputError(
                f"{self.design.model}: adc: expected a force on channel 0, got the signal {signal}"
            )
        if not self.facts.contacts:
            raise InputError(
                f"{self.design.model}: contact: expected a model with a contact on which the "
                "force law can press, got none; add a [[contact]]"
            )
        if self.facts.encoder is None:
            raise InputError(
                f"{self.design.model}: encoder: expected a model with an [encoder], because the "
                "approach needs a measured position, got a model without an encoder; add an "
                "[encoder]"
            )

    def _settings(self, bits: int) -> dict[str, float | str]:
        """Returns those firmware settings that are equal for all simulated contacts. These are all
        settings except the force set-point, the approach speed and the filter bank."""
        zero = self.change.firmware.get("force_zero_code")
        if zero is None:
            zero = self.design.zero_code
        kept = {name: self._given[name] for name in KEPT if name in self._given}
        if "position_gain" not in kept:
            kept["position_gain"] = self._position_gain()
        counts = min(256 - zero / 2 ** (bits - 8), 255.0)
        top = min(SETPOINTS[-1] * counts * self.count_N, STALL_FORCE_SHARE * self._stall_N())
        self.setpoints_N = [
            max(round(s / SETPOINTS[-1] * top / self.count_N), LEAST_COUNT) * self.count_N
            for s in SETPOINTS
        ]
        largest_N = max(self.setpoints_N)
        least_N = min(self.least_N(), largest_N)
        self.setpoints_N = [max(force_N, least_N) for force_N in self.setpoints_N]
        if self.forces_N:
            self._check_forces(counts)
            self.setpoints_N = list(self.forces_N)
        largest_N = max(self.setpoints_N)
        given_N = 1e-3 * self._number("rated_force") if "rated_force" in kept else 0.0
        self.rated_N = max(largest_N, given_N)
        return (
            self._ages()
            | kept
            | {
                "adc_bits": bits,
                "force_zero_code": zero,
                "force_scale": max(1, round(1e6 * self.count_N)),
                "rated_force": max(1, round(1e3 * self.rated_N)),
                "force_slope": round(1000 * largest_N / self.rated_N / RAMP_S),
                "bump_decay_shift": 0,
                "modes_of_operation": 4,
            }
        )

    def least_N(self) -> float:
        """Returns the smallest force in N that a contact can hold against weight and noise."""
        noise_N = self._noise_count * self.count_N
        return max(WEIGHT_FACTOR * self.design.weight_N, NOISE_FACTOR * noise_N)

    @property
    def _noise_count(self) -> float:
        """Returns the rms noise of the force sensor in 8-bit counts."""
        return self.design.noise_codes(8) or 0.0

    def _ripple_max_count(self) -> float:
        """Returns the largest permitted force ripple in 8-bit counts, peak to peak."""
        return max(RIPPLE_COUNT, math.ceil(1.0 + NOISE_RIPPLE * self._noise_count))

    def remedy(self, contact: SimulatedContact, bank: Bank) -> str:
        """Returns a text about the most likely reason why the force of a simulated contact with a
        filter bank does not settle, and what to change."""
        sampling, least_N = self.facts.required_reading.sampling, min(self.setpoints_N)
        limits = {missed.limit for missed in contact.missed}
        if contact.fault in ("force_old", "position_old"):
            return (
                "the firmware ends the contact because of the age of a value; raise "
                f"{contact.fault.replace('_old', '_age_max')} of the experiment, or use a sensor "
                "or bus with shorter periods"
            )
        noise_N = self._noise_count * self.count_N
        weight_N = self.design.weight_N
        if self._given.get("output_bias") and weight_N < self._stall_N():
            weight_N = 0.0  # the output holds it
        for small_N, what in (
            (WEIGHT_FACTOR * weight_N, f"the weight of {weight_N:.3g} N along the axis"),
            (NOISE_FACTOR * noise_N, f"the noise of {noise_N:.3g} N of the measured force"),
        ):
            if least_N < small_N:
                return (
                    f"the smallest test force of {least_N:.3g} N is too small against {what}: give "
                    "larger forces, or reduce it"
                )
        if self.is_held(contact, bank):
            friction_N = max(one.most_N for one in self.frictions)
            force_N, codes = self._pushes(contact, bank)
            enough_N = force_N * self.press_speed_code(0.0) / codes
            return (
                f"dry friction of {friction_N:.3g} N holds the axis out of contact, where the law "
                f"presses with its gain alone: give forces from {enough_N:.3g} N, or reduce the "
                "friction"
            )
        if self.is_dead(contact, bank):
            dead_N = self.facts.dead_zone(bank.gain_at_rest())
            return (
                f"with this gain each force error below {dead_N:.3g} N rounds to no command, apart "
                "from the integral: lower the speed of the drive at full command, use an output of "
                "more bits or larger forces"
            )
        if sampling is not None and sampling.rate_hz < SLOW_SENSOR_HZ:
            delay_s = sampling.delay_s()
            return (
                f"the sensor of {sampling.rate_hz:g} samples/s shows the force up to "
                f"{1e3 * delay_s:.3g} ms late, which allows a crossover of about "
                f"{1 / (4 * math.pi * delay_s):.2g} Hz: use a faster sensor, a slower approach or "
                "a softer workpiece"
            )
        if limits & {"peak_force_max_N", "contact_losses_max", "contact_losses"}:
            return "use a softer sensor, a softer pad or a slower approach"
        return "use a smaller set of plants or other forces"

    def is_dead(self, contact: SimulatedContact, bank: Bank) -> bool:
        """Returns True if a contact fails only because of a force error that the dead zone of a
        filter bank permits. With a smaller gain, the dead zone is larger."""
        held = [m.bound for m in contact.missed if m.limit == "held_force_error_max_N"]
        dead_N = self.facts.dead_zone(bank.gain_at_rest())
        return len(held) == len(contact.missed) > 0 and min(held) < dead_N

    def _pushes(self, contact: SimulatedContact, bank: Bank) -> tuple[float, float]:
        """Returns the set-point of a contact in N, and the DAC codes with which a filter bank
        presses before the axis is in contact, where its integral does not act."""
        force_N = next(
            (case.setpoint_N for case in self.cases if case.name == contact.case),
            max(self.setpoints_N),
        )
        return force_N, float(bank.gain_at_rest() * force_N / self.count_N)

    def is_held(self, contact: SimulatedContact, bank: Bank) -> bool:
        """Returns True if a contact that is lost again and again fails because friction holds the
        axis out of contact. A smaller gain presses less."""
        lost = any(missed.limit == "contact_losses" for missed in contact.missed)
        if not lost or not self.frictions:
            return False
        _, codes = self._pushes(contact, bank)
        return 0.0 < codes < self.press_speed_code(0.0)

    def _check_forces(self, counts: float) -> None:
        """Raises InputError for a requested force that the sensor cannot measure or that the drive
        cannot produce."""
        for most_N, what in (
            (min(counts, 255.0) * self.count_N, "the end of the range of the force sensor"),
            (self._stall_N(), "the largest force of the drive"),
        ):
            if self.forces_N[-1] > most_N:
                raise ParameterError(
                    "forces_N",
                    f"{self.forces_N[-1]:.4g} N: expected at most {most_N:.4g} N, {what}",
                )
        if self.forces_N[0] < self.count_N:
            raise ParameterError(
                "forces_N", f"{self.forces_N[0]:.4g} N: expected at least {self.count_N:.4g} N, "
                "one 8-bit count of the measured force",
            )  # fmt: skip

    def _position_gain(self) -> float:
        """Returns the position gain in DAC codes per encoder count. As for a new axis, it is a
        sixth of the highest stable gain out of contact."""
        loop = loops.force_loop(self.model, overrides=self.overrides, output="encoder", free=True)
        return first_gain(highest_gain(loop, self.facts.volts_per_code))

    def _stall_N(self) -> float:
        """Returns the largest static force of the drive in N, or infinity if the model has no
        limits of the drive."""
        table, drive = self.design.tables.drive, self.facts.required_drive.values
        if "k_force" in drive:
            limits = self.design.value(table.peak_current), self.design.value(table.rated_current)
            return min((i for i in limits if i), default=math.inf) * drive["k_force"]
        supply_V, R = self.design.value(table.supply_limit), self.design.value(table.R)
        r_trans = drive.get("r_trans")
        if not supply_V or not R or not r_trans:
            return math.inf
        return float(supply_V / R * drive["k_torque"] / r_trans)

    def _speed(self) -> float:
        """Returns the approach speed in m/s from the request for the design, or from the
        experiment. Without such a speed, it is the smaller of 20 mm/s and the default of
        `approach_velocity_max`."""
        scale = abs(self.facts.required_encoder.scale)
        default = objects.BY_NAME["approach_velocity_max"].default
        name = "approach_velocity_max"
        if name not in self._given:
            return float(min(default / scale, APPROACH_M_PER_S, self._blind_m_per_s()))
        return self._number(name) / scale

    def _number(self, name: str) -> float:
        """Returns the value of a firmware setting of the request or of the experiment, in the unit
        of the object."""
        if name in self._asked:
            return float(self._asked[name])
        return float(experiment_file.firmware_values(self.design.experiment)[name])

    def _ages(self) -> dict[str, float | str]:
        """Returns those objects for the age of positions and forces whose default is too short for
        bus and sensor of the model."""
        sampling, bus = self.facts.required_reading.sampling, self.facts.bus
        period, latency = (sampling.period_s, sampling.latency_s) if sampling else (0.0, 0.0)
        ticks = bus_times.ages(
            bus.cycle_ticks if bus.cycle_ticks > 1 else None,
            period * _core.TICKS_PER_SECOND, latency * _core.TICKS_PER_SECOND,
        )  # fmt: skip
        return {name: float(value) for name, value in ticks.items() if name in KEPT}

    def _blind_m_per_s(self) -> float:
        """Returns the approach speed in m/s at which the axis presses with the least set-point only
        after the delay of the sensor. At a larger speed, a contact exceeds the set-point before the
        firmware reads its force."""
        sampling = self.facts.required_reading.sampling
        if sampling is None:
            return math.inf
        plant = linear.linearise(
            self.model, outputs=("encoder", self.facts.required_reading.signal),
            overrides=self.overrides,
        )  # fmt: skip
        place, force = plant.at([0.02j * math.pi]).ravel()
        compliance = abs(place / force) / abs(self.facts.required_encoder.scale)
        return float(BLIND_SHARE * min(self.setpoints_N) * compliance / sampling.delay_s())

    def _cases(self) -> list[ContactCase]:
        speed, strike = self._speed(), STRIKE_S * max(self.setpoints_N)
        lower = self.setpoints_N[:-1] or self.setpoints_N
        return [
            *(ContactCase(force_N, speed) for force_N in self.setpoints_N),
            ContactCase(lower[-1], speed / 2),
            *(ContactCase(force_N, speed, strike) for force_N in lower),
        ]

    @property
    def shown(self) -> ContactCase:
        """Returns the first contact that a plot shows, at full approach speed and the middle force
        set-point."""
        return self.cases[len(self.setpoints_N[:-1]) // 2]

    @property
    def largest(self) -> ContactCase:
        """Returns the first contact with the largest force set-point."""
        return self.cases[len(self.setpoints_N) - 1]

    def measure_impacts(
        self, bank: Bank, latencies: Sequence[int] = (0, 1), threads: int = 1,
        cases: Sequence[ContactCase] = (), members: Sequence[Plant] = (),
    ) -> None:  # fmt: skip
        """Simulates the impact of each first contact with a small gain.

        The resulting contact losses and peak forces are stored. They enlarge the limits of the
        verdicts. `cases`: first contacts that are simulated instead of those of this bench.
        `members`: plants besides the nominal one.
        """
        weak = replace(bank, force_gain=WEAK_GAIN_SHARE * bank.force_gain).quantised()
        cases = cases or [case for case in self.cases if not case.strike_N_s]
        loss = {"contact_loss_cap": self.press_speed_code(cases[0].speed_m_per_s)}
        plants: list[Plant] = [{}, *friction.members(self.frictions), *members]
        jobs = [
            (c, self.job(c, weak, m, t, loss)) for c in cases for t in latencies for m in plants
        ]
        self.impacts, self._files = {}, {}
        for (case, _), one in zip(jobs, run([job for _, job in jobs], threads), strict=True):
            losses, peak_N = self.impacts.get(case, (0, 0.0))
            losses = max(losses, one.metrics.contact_losses_run)
            self.impacts[case] = (losses, max(peak_N, one.metrics.peak_force_N))
        self._files = {}  # existing files contain other limits of the verdict

    def losses_permitted(self, case: ContactCase) -> int | None:
        """Returns the largest number of contact losses that the verdict of a contact permits. None
        means no limit."""
        if case.strike_N_s:
            return None
        contact_count = float(self.settings.get("contact_force", objects.default("contact_force")))
        flickers = FLICKER_LOSSES if contact_count < FLICKER_NOISE * self._noise_count else 0
        return self.impacts.get(case, (0, 0.0))[0] + self.losses_max + flickers

    def limits(self, case: ContactCase, bank: Bank) -> dict[str, float]:
        """Returns the limits of a simulated contact as keys of the table [verdict]."""
        found: dict[str, float] = {}
        share = 0.0 if bank.integral_rad_per_s else self.static_error
        if share < 1:
            error_N = max((ERROR_MAX + share) * case.setpoint_N, HALF_COUNT * self.count_N)
            found["held_force_error_max_N"] = float(f"{error_N:.4g}")
        losses_max = self.losses_permitted(case)
        if losses_max is None:
            return found
        peak_N = self.peak_max * max(case.setpoint_N, self.impacts.get(case, (0, 0.0))[1])
        return found | {
            "peak_force_max_N": float(f"{peak_N:.4g}"),
            "contact_losses_max": losses_max,
            "saturated_max_s": SATURATED_MAX_S,
        }

    def extreme(self) -> list[ContactCase]:
        """Returns the two contacts in which the plant visits most modes. These are the first
        contact with the largest set-point, and the impact at the largest force."""
        return [max(self.cases, key=lambda c: c.setpoint_N), self.cases[-1]]

    def struck(self) -> tuple[str, float]:
        """Returns (body that an impact strikes, sign of the impulse). The body is the workpiece. If
        the workpiece is the ground, it is the body that presses on the ground."""
        near, far = self.facts.contacts[0].between
        return (far, 1.0) if far in self.facts.points else (near, -1.0)

    def gap_m(self) -> float:
        """Returns the distance in m between the two surfaces of the contact at the start of a run.
        It follows from the positions of the bodies and from the gap of the contact."""
        plant = _core.Plant(str(self.design.model), dict(self.design.overrides))
        return max(0.0, -float(plant.signal(f"{self.facts.contacts[0].name}.deflection")))

    def touch_s(self, case: ContactCase) -> float:
        """Returns the latest time of the first contact in s: the expected time plus a fifth."""
        return 0.1 + 1.2 * self.gap_m() / case.speed_m_per_s

    def text(
        self, case: ContactCase, bank: Bank, loss: Mapping[str, int] | None = None,
        model: str | None = None,
    ) -> str:  # fmt: skip
        """Returns the text of the experiment of a simulated contact. Its arguments have the same
        meaning as the arguments of experiment()."""
        return experiment_file.text_of(self.experiment(case, bank, loss, model))

    def experiment(
        self, case: ContactCase, bank: Bank, loss: Mapping[str, int] | None = None,
        model: str | None = None,
    ) -> ExperimentText:  # fmt: skip
        """Returns the experiment of a simulated contact. `loss`: {"contact_loss_cap": code, ...}.
        `model`: path of the model relative to the folder of the experiment. Without it, the path is
        absolute.
        """
        begin = self.touch_s(case) + self.settle_s
        wait = self.settle_s + 1.0 if case.strike_N_s else 0.0
        law = self._law_keys(bank, loss or {})
        at: list[Write] = [
            {"time_s": time_s, "firmware": {"controlword": word}}
            for time_s, word in ((0.01, 6), (0.02, 7), (0.03, 15))
        ]
        if case.strike_N_s:
            body, sign = self.struck()
            hit = Impulse(body=body, N_s=sign * case.strike_N_s)
            at.append({"time_s": round(begin, 3), "impulse": hit})
        text: ExperimentText = {
            "title": f"{self.design.model.stem}: {case.name}",
            "model": str(model or self._run_model),
            "duration_s": round(begin + wait + WINDOW_S, 3),
            "set": dict(self.overrides),
            "firmware": {**self.settings, **self.loads(case), **law},
            "at": at,
            "verdict": {
                "window_s": WINDOW_S,
                "contact_held": True,
                "force_ripple_max_count": self._ripple_max_count(),
                **self.limits(case, bank),
            },
        }
        if not self.overrides:
            del text["set"]
        return text

    def _law_keys(self, bank: Bank, loss: Mapping[str, int]) -> dict[str, FirmwareValue]:
        """Returns those keys of [firmware] that select a filter bank and the force sensor of this
        bench."""
        sensor = {n: self.settings[n] for n in ("adc_bits", "force_zero_code", "force_scale")}
        return {
            **sensor,
            **{name: loss[name] for name in experiment_file.LOSS if name in loss},
            "force_bank": experiment_file.BANK,
            f"bank_{experiment_file.BANK}": to_json(bank.keys()),
        }

    def with_bank(
        self, experiment: Path, bank: Bank, loss: Mapping[str, int], model: str | None = None
    ) -> str:
        """Returns the text of an experiment with a filter bank. The comments of the experiment are
        kept. `model`: path of the model relative to the folder of the text. Without it, the text
        names the model of this bench."""
        text = experiment_file.document(experiment)
        text["model"] = str(model or self.model)
        if self.overrides:
            text.setdefault("set", tomlkit.table()).update(self.overrides)
        text.setdefault("firmware", tomlkit.table()).update(self._law_keys(bank, loss))
        text.pop("expect", None)  # the expected results belong to the previous law
        return tomlkit.dumps(text)

    def loads(self, case: ContactCase) -> dict[str, float | str]:
        """Returns the firmware settings that differ between the contacts: force set-point and
        approach speed."""
        return {
            "target_force": round(1000 * case.setpoint_N / self.rated_N),
            "approach_velocity_max": self.approach_count_per_s(case),
        }

    def approach_count_per_s(self, case: ContactCase) -> int:
        """Returns the approach speed of a contact in encoder counts per second."""
        scale = abs(self.facts.required_encoder.scale)
        return max(1, round(case.speed_m_per_s * scale))

    def file(self, case: ContactCase, bank: Bank) -> Path:
        """Returns the path of the experiment file of a contact with a filter bank."""
        key = (case, bank, ())
        if key not in self._files:
            name = f"case_{len(self._files)}.toml"
            text = toml.write_text(self.experiment(case, bank))
            self._files[key] = self.design.file(name, text)
        return self._files[key]

    def job(
        self, case: ContactCase, bank: Bank, member: Plant, latency: int,
        loss: Mapping[str, int] | None = None,
    ) -> Job:  # fmt: skip
        """Returns the run of one contact on the plant `member`, with a latency in ticks. `loss`:
        values of the firmware objects for the time after a contact loss."""
        firmware = {"latency_ticks": latency} | dict(loss or {})
        texts = linear.override_texts(member)
        return str(self.file(case, bank)), [
            *texts, *(f"firmware.{n}={v}" for n, v in firmware.items())
        ]  # fmt: skip

    def own_job(
        self, own: Path, bank: Bank, latency: int, loss: Mapping[str, int] | None = None
    ) -> Job:
        """Returns the run of the user's own experiment with a filter bank and a latency
        in ticks."""
        key = (own, bank, tuple((loss or {}).values()))
        if key not in self._files:
            text = self.with_bank(own, bank, loss or {})
            self._files[key] = self.design.file(f"case_{len(self._files)}.toml", text)
        return str(self._files[key]), [f"firmware.latency_ticks={latency}"]

    def press_speed_code(self, speed_m_per_s: float, share: float = 1.0) -> int:
        """Returns the DAC code that moves the axis out of contact at a given speed. The axis moves
        against the largest friction multiplied by `share`. With a smaller code, friction may keep
        the axis at standstill."""
        body = self.facts.required_drive.body
        ends = [f"{end}.force" for one in self.frictions for end in one.between if end != "ground"]
        inputs = ("drive.command", *dict.fromkeys(ends))
        plant = linear.linearise(
            self.model, inputs, (f"{body}.velocity",), overrides=self.overrides, free=True
        )
        answer = dict(zip(inputs, plant.at([0.02j * math.pi]).ravel(), strict=True))
        speed = abs(answer["drive.command"]) * self.facts.volts_per_code
        if not speed:
            return 2048
        for one in self.frictions:
            near, far = (answer.get(f"{end}.force", 0.0) for end in one.between)
            speed_m_per_s += share * one.most_N * abs(near - far)
        return min(2048, max(1, round(speed_m_per_s / float(speed))))


def run(
    jobs: Sequence[Job], threads: int, experiments: _core.Experiments | None = None
) -> list[ContactRun]:
    """Simulates runs, and returns their results in the order of `jobs`.

    `experiments` keeps parsed experiment files for later calls with the same files. Raises
    SimulationError for the first run that fails.
    """
    shared = experiments or _core.Experiments()
    outcomes = _core.run_many(jobs, threads, None, True, None, shared)
    for outcome in outcomes:
        if "error" in outcome:
            raise _core.SimulationError(outcome["error"])
    return [read_run(outcome) for outcome in outcomes]


def simulate(
    bench: ContactBench, bank: Bank, members: Sequence[Plant], latencies: Sequence[int] = (0, 1),
    loss: Mapping[str, int] | None = None, threads: int = 1, law: str = "design",
) -> list[SimulatedContact]:  # fmt: skip
    """Simulates all contacts of a bench with a filter bank, on each plant of `members` and with
    each latency. The user's own experiment is simulated on the nominal plant only."""
    every = contacts_of(bench, members, latencies)
    return simulate_contacts(bench, bank, every, loss, threads, law)


def contacts_of(
    bench: ContactBench, members: Sequence[Plant], latencies: Sequence[int]
) -> list[Contact]:
    """Returns all contacts of a bench on each plant of `members` and with each latency, and the
    user's own experiment on the nominal plant."""
    every: list[Contact] = [
        (case, member, latency)
        for case in bench.cases for member in members for latency in latencies
    ]  # fmt: skip
    if bench.own is not None:
        every += [(NamedCase(bench.own.stem), {}, t) for t in latencies]
    return every


def simulate_contacts(
    bench: ContactBench, bank: Bank, contacts: Sequence[Contact],
    loss: Mapping[str, int] | None = None, threads: int = 1, law: str = "design",
    experiments: _core.Experiments | None = None,
) -> list[SimulatedContact]:  # fmt: skip
    """Simulates some contacts of a bench with a filter bank. `experiments`: as in run()."""
    jobs, most = [], []
    for case, member, latency in contacts:
        if isinstance(case, ContactCase):
            jobs.append(bench.job(case, bank, member, latency, loss))
            most.append(bench.losses_permitted(case))
        else:
            assert bench.own is not None
            jobs.append(bench.own_job(bench.own, bank, latency, loss))
            most.append(None)
    runs = run(jobs, threads, experiments)
    return [
        simulated_contact(law, case.name, member, latency, one, losses_max)
        for (case, member, latency), one, losses_max in zip(contacts, runs, most, strict=True)
    ]


def choose_loss(
    bench: ContactBench, bank: Bank, latencies: Sequence[int] = (0, 1), threads: int = 1
) -> ContactLoss:
    """Returns the limits after a contact loss with which the control law tolerates the largest
    impacts of a series. The limits are a cap in DAC codes and a dwell time in ms."""
    slow = (bench.press_speed_code(bench.cases[0].speed_m_per_s / 4, s) for s in FRICTION_SHARES)
    caps = dict.fromkeys((0, *slow, 2048))
    plants = friction.members(bench.frictions) or [{}]
    choices = [(cap, dwell) for dwell in DWELLS_MS for cap in caps]
    struck = [c for c in bench.cases if c.strike_N_s]
    contacts = list(itertools.product(struck, latencies, plants))
    # with dry friction, a cap of 0 DAC codes is not chosen
    able = [c for c in choices if c[0] or not bench.frictions]
    shared = _core.Experiments()
    stable: dict[tuple[LossChoice, int, float], bool] = {}  # (choice, contact, factor)

    def simulated(wanted: Iterable[tuple[LossChoice, int, float]]) -> bool:
        """Returns True if all these impacts are stable."""
        keys = list(wanted)
        new = [key for key in keys if key not in stable]
        jobs = []
        for (cap, dwell), i, factor in new:
            case, latency, plant = contacts[i]
            harder = replace(case, strike_N_s=factor * case.strike_N_s)
            loss = {"contact_loss_cap": cap, "contact_loss_dwell": dwell}
            jobs.append(bench.job(harder, bank, plant, latency, loss))
        for key, one in zip(new, run(jobs, threads, shared), strict=True):
            stable[key] = one.verdict == "stable"
        return all(stable[key] for key in keys)

    every = range(len(contacts))
    # The best choice is one with which all contacts of the series are stable.
    # The hardest impact is simulated first, because it rejects most choices.
    simulated((choice, i, STRIKE_FACTORS[-1]) for choice in able for i in every)
    best = next(
        (
            choice for choice in able
            if all(stable[choice, i, STRIKE_FACTORS[-1]] for i in every)
            and simulated(itertools.product((choice,), every, STRIKE_FACTORS))
        ),
        None,
    )  # fmt: skip
    # {choice: largest factor that each contact tolerates}
    tolerated = {choice: [0.0] * len(contacts) for choice in choices}
    ranked = choices if best is None else {choices[0]: None, best: None}
    going = list(itertools.product(ranked, every))
    for factor in STRIKE_FACTORS:
        simulated((choice, i, factor) for choice, i in going)
        for choice, i in going:
            if stable[choice, i, factor]:
                tolerated[choice][i] = factor
        # A choice with which one contact fails is worse than a choice with which none fails.
        # For the default choice, only the smallest factor is simulated.
        whole = [choice for choice in ranked if min(tolerated[choice]) == factor]
        able = [choice for choice in able if choice in whole] or able
        needed = {*able, *(choice for choice in choices[:1] if choice in whole)}
        going = [(c, i) for c, i in going if c in needed and tolerated[c][i] == factor]
    # If several results are equal, the first one is chosen.
    best = best or max(able, key=lambda c: (min(tolerated[c]), sum(tolerated[c])))
    strike = struck[0].strike_N_s
    return ContactLoss(
        contact_loss_cap=best[0],
        contact_loss_dwell=best[1],
        strike_N_s=min(tolerated[best]) * strike,
        strike_default_N_s=min(tolerated[choices[0]]) * strike,
        strike_hardest_N_s=STRIKE_FACTORS[-1] * strike,
    )


def losses(bench: ContactBench, speed_m_per_s: float) -> tuple[dict[str, int], ...]:
    """Returns values of the firmware objects for the time after a contact loss, in the order of
    their simulation.

    Without friction, the defaults come first, and a motion towards the workpiece at approach speed
    comes second. With friction, slower motions come first, and one against twice the friction comes
    after that at approach speed, because what an output_bias leaves of a weight adds to it. The
    defaults (a cap of 0 DAC codes) then come last, because friction may keep the axis at
    standstill.
    """
    on = {"contact_loss_cap": bench.press_speed_code(speed_m_per_s)}
    slow = [
        {"contact_loss_cap": bench.press_speed_code(speed_m_per_s / 4, share)}
        for share in FRICTION_SHARES
    ]
    most = {"contact_loss_cap": bench.press_speed_code(speed_m_per_s, MOST_FRICTION_SHARE)}
    return (*slow, on, most, {}) if bench.frictions else ({}, on)


@dataclass(frozen=True)
class SafeDesign:
    """A filter bank with which every simulated contact is stable. `loss`: limits after a contact
    loss. `cuts`: larger gains that were rejected."""

    bank: Bank
    loss: ContactLoss
    contacts: list[SimulatedContact]
    cuts: list[GainCut]


def _members_of(contacts: Sequence[Contact]) -> list[Plant]:
    """Returns the plants of some contacts, except the nominal one, each once."""
    found: list[Plant] = []
    for _, member, _ in contacts:
        if member and member not in found:
            found.append(member)
    return found


@dataclass(frozen=True)
class _Attempt:
    """Simulated contacts with one gain, the unstable ones of these contacts (`again`), and the
    result of losses() with which the fewest are not stable."""

    rows: list[SimulatedContact]
    again: list[Contact]
    loss: Mapping[str, int]


def _attempt(
    bench: ContactBench, tried: Bank, parts: Sequence[Sequence[Contact]], threads: int
) -> _Attempt:
    """Simulates contacts with a gain, with all results of losses(). The contacts after a part with
    an unstable one are not simulated."""
    best: _Attempt | None = None
    for loss in losses(bench, bench.cases[0].speed_m_per_s):
        for contacts in filter(None, parts):
            rows = simulate_contacts(bench, tried, contacts, loss, threads)
            again = [c for c, row in zip(contacts, rows, strict=True) if not row.is_stable]
            if again:
                break
        if best is None or len(again) < len(best.again):
            best = _Attempt(rows, again, loss)
        if not again:
            break
    assert best is not None  # losses() is not empty
    return best


def safe(
    bench: ContactBench, bank: Bank, members: Sequence[Plant], latencies: Sequence[int] = (0, 1),
    threads: int = 1, progress: Callable[[str], None] | None = None, least: float = 0.0,
) -> SafeDesign:  # fmt: skip
    """Returns the filter bank with the largest gain at which every simulated contact is stable.

    The gain is reduced in steps of a tenth. Each gain is tried with all results of losses(), and
    first with contacts that were unstable at the gain before. If one of these is unstable again,
    the other contacts are not simulated. least: smallest gain that is tried, as a share of the
    first gain. Raises InputError if no gain makes every case stable. Also raises it if the approach
    does not reach the workpiece, because a lower gain then does not help.
    """
    bench.measure_impacts(bank, latencies, threads)
    cuts: list[GainCut] = []
    every = contacts_of(bench, members, latencies)
    before: list[Contact] = []  # contacts that were unstable at the previous, larger gain
    for steps in range(BACKOFFS + 1):
        if steps and BACKOFF**steps < least:
            break
        gain = bank.force_gain * BACKOFF**steps
        tried = replace(bank, force_gain=gain).quantised()
        if progress:
            progress("simulating contact" + (f", gain {tried.force_gain:.3g}" if steps else ""))
        one = _attempt(bench, tried, (before, every), threads)
        if one.again and not steps:
            # A plant of the set may rebound more often than the nominal plant.
            plain = bench.impacts
            bench.measure_impacts(bank, latencies, threads, members=_members_of(one.again))
            if bench.impacts != plain:
                one = _attempt(bench, tried, (before, every), threads)
        if bad := unstable(one.rows):
            refused, before = bad[0], one.again[:REPEATED_MAX]
            cuts.append(
                GainCut(tried.force_gain, len(bad), len(one.rows), refused.case, why(refused))
            )
            _expect_contact(bench, bad)
            _expect_live(bench, tried, bank, refused)
            continue
        loss = choose_loss(bench, tried, latencies, threads)
        chosen = one.rows
        given = {name: objects.default(name) for name in loss.objects} | dict(one.loss)
        # The user's experiment may have other limits than the defaults.
        if loss.objects != given or bench.own is not None:
            chosen = simulate(bench, tried, members, latencies, loss.objects, threads)
        # choose_loss() does not simulate all plants. A contact may be unstable on another plant.
        if unstable(chosen):
            loss = replace(
                loss,
                contact_loss_cap=one.loss.get("contact_loss_cap", 0),
                contact_loss_dwell=DWELLS_MS[0],
                strike_N_s=loss.strike_default_N_s,
            )
            chosen = one.rows
        return SafeDesign(tried, loss, chosen, cuts)
    raise _unsettled(bench, tried, bank, refused)


def _unsettled(
    bench: ContactBench, tried: Bank, bank: Bank, contact: SimulatedContact
) -> InputError:
    """Returns the error for a contact whose force does not settle with the last tried gain. `bank`:
    the filter bank with the designed gain."""
    share = tried.force_gain / bank.force_gain
    return InputError(
        f"simulation: expected a contact force that settles, but the force in the simulated case "
        f"{contact.case} does not settle even at the gain {tried.force_gain:.3g}, which is "
        f"{share:.2g} times the designed gain ({why(contact)}); {bench.remedy(contact, tried)}"
    )


def _expect_live(bench: ContactBench, tried: Bank, bank: Bank, contact: SimulatedContact) -> None:
    """Raises InputError if a contact fails because of the dead zone of a gain, or because friction
    holds the axis: both are worse at each smaller gain. The other arguments are the same as for
    _unsettled()."""
    if bench.is_dead(contact, tried) or bench.is_held(contact, tried):
        raise _unsettled(bench, tried, bank, contact)


def _expect_contact(bench: ContactBench, bad: Sequence[SimulatedContact]) -> None:
    """Raises InputError if the approach does not reach the workpiece. No gain of the force law
    changes this. `bad`: the contacts that are not stable."""
    never = [row for row in bad if row.verdict == "never_in_contact" and row.fault == "none"]
    if not never:
        return
    gain = float(bench.settings["position_gain"])
    raise InputError(
        f"simulation: expected an approach that reaches the workpiece, but {never[0].case} never "
        f"touches the workpiece at a distance of {1e3 * bench.gap_m():.3g} mm. The force law is "
        f"not the cause: either the position gain {gain:.4g} is too small against flexure, gravity "
        "or dry friction, or the approach is too slow; raise [firmware] position_gain or the "
        "approach speed, or start nearer to the workpiece"
    )
