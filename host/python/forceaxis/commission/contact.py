"""First contacts of an axis with an active filter bank. The contacts are simulated with the fitted
plant, and recorded on the axis.

The filter bank is written to the axis only if the contacts that simulated() computes pass. While
the filter bank is verified on the axis, an analyzer of the class Touching records the first
contacts. predicted() computes the same contacts with the fitted plant.
"""

import math
import os
from dataclasses import dataclass

import numpy as np
import tomlkit

from forceaxis import _core, paths
from forceaxis.axis.axis import Axis, trigger_on
from forceaxis.axis.link import TICKS_PER_S, NoAnswer, Refused
from forceaxis.axis.sim import SimLink
from forceaxis.commission import known
from forceaxis.commission.analyzer import Analyzer
from forceaxis.commission.level import MeasuringOrder, Samples
from forceaxis.commission.refusal import Refusal
from forceaxis.commission.tune_folder import TOUCH_DOWN_COLUMNS, TuningFolder
from forceaxis.commission.tune_results import (
    Checked,
    ContactOfKind,
    Designed,
    Fitted,
    Settings,
    TouchDownPeaks,
    Values,
)
from forceaxis.design import simulate as simulation
from forceaxis.design.cases import ContactCase, simulated_contact, why
from forceaxis.design.changes import Design
from forceaxis.design.grid import hf_most
from forceaxis.linear import plant_set
from forceaxis.linear.bank import HF_CODES_MAX, Bank
from forceaxis.linear.plant_set import PlantSet

# Number of plants that are drawn at random from the set of plants, and seed of the random numbers.
MEMBER_COUNT, MEMBER_SEED = 6, 1988
# Limits of a first contact with plants that the design did not simulate.
# LOSSES_MAX: permitted contact losses, besides those by the impact; the design permits 1.
# PEAK_MAX: permitted peak force divided by the set-point; the design permits 1.3.
LOSSES_MAX, PEAK_MAX = 3, 1.5
BEFORE_S, AFTER_S = 0.1, 2.0  # longest time in s that is recorded before and after a first contact
# To leave the contact, the axis makes short moves, and then one move over the whole travel.
SHORT_MOVE, LONG_MOVE, MOVES_MAX = 0.25, 0.75, 40
# Objects of the axis on which a first contact depends, in addition to the filter bank.
TOUCH_DOWN_OBJECTS = (
    "rated_force", "force_slope", "approach_velocity_max", "contact_force",
    "position_gain", "velocity_gain", "contact_loss_cap", "contact_loss_dwell", "bump_decay_shift",
    "latency_ticks", "output_bias",
)  # fmt: skip


@dataclass(frozen=True)
class FittedAxis:
    """The data from which contacts of an axis with the designed filter bank are predicted."""

    tuning: TuningFolder
    checked: Checked
    fitted: Fitted
    designed: Designed

    @property
    def plants(self) -> PlantSet:
        """Returns the set of plants of the design, with the fitted values as nominal values."""
        model, fitted = self.tuning.model, self.fitted
        ranges = plant_set.ranges_of(model, fitted.over, fitted.values)
        modes, together = tuple(self.designed.modes) or ({},), fitted.together or ({},)
        return PlantSet(str(model), fitted.values, ranges, modes, together)

    def plant(self) -> Design:
        """Returns the fitted plant, for use in a `with` statement."""
        return Design(str(self.tuning.model), self.fitted.values)

    @property
    def _approach(self) -> Settings:
        """Returns the approach speed of the design, which may be slower than the approach speed of
        check()."""
        name = "approach_velocity_max"
        return {name: self.designed.objects[name]} if name in self.designed.objects else {}

    def bench(self, plant: Design, bank: Bank) -> simulation.ContactBench:
        """Returns the simulation of contacts of a plant, with the firmware settings of the axis."""
        bench = simulation.ContactBench(
            plant, self.designed.adc_bits,
            firmware=firmware_of(self.tuning, self.checked, self.fitted.values) | self._approach,
        )  # fmt: skip
        worst = self.designed.worst
        bench.wait_for(bank, worst.fS_Hz, worst.static_error)
        bench.rated_N = max(self.tuning.order.forces)
        bench.settings["rated_force"] = round(1e3 * bench.rated_N)
        return bench


def firmware_of(tuning: TuningFolder, checked: Checked, values: Values | None) -> Settings:
    """Returns the settings of the firmware for a simulation of the axis with the fitted `values`,
    as {object: engineering value}. The simulated axis holds its weight as the real axis does: the
    measured `output_bias` holds a weight that differs from the fitted weight."""
    held = tuning.axis.get("position_gain", "velocity_gain", "approach_velocity_max",
                           "contact_force", "output_bias")  # fmt: skip
    held |= checked.settings
    if weight := known.weight(tuning.model, values).codes:
        held["output_bias"] = round(weight)
    return {name: held[name] for name in simulation.KEPT if name in held}


def simulated(fitted_axis: FittedAxis) -> tuple[ContactOfKind, ...]:
    """Simulates contacts with the fitted plant: one contact at each force, and an impact at each
    force except the largest. Also simulates contacts with plants that are drawn at random from the
    set of plants.

    Each element of the result states the kind of its contact. Raises a Refusal with the name
    `hf_gain` or `simulated_KIND`.
    """
    designed, forces = fitted_axis.designed, fitted_axis.tuning.order.forces
    bank = designed.bank.bank
    loss = designed.contact_loss.objects if designed.contact_loss else {}
    if bank.hf_gain() > (most := hf_most(designed.adc_bits)):
        raise Refusal(
            "hf_gain", f"expected a force law with a gain at high frequency of at most {most:g} "
            f"DAC codes per 8-bit count ({HF_CODES_MAX} DAC codes per ADC code), got "
            f"{bank.hf_gain():.3g}"
        )  # fmt: skip
    members = [member.values for member in fitted_axis.plants.random(MEMBER_COUNT, MEMBER_SEED)]
    with fitted_axis.plant() as plant:
        bench = fitted_axis.bench(plant, bank)
        speed, strike = bench.cases[0].speed_m_per_s, simulation.STRIKE_S * bench.rated_N
        plain = [ContactCase(force, speed) for force in forces]
        bench.measure_impacts(bank, cases=plain, members=members)
        bench.losses_max, bench.peak_max = LOSSES_MAX, PEAK_MAX
        cases: list[tuple[str, ContactCase, Values]] = []
        cases += [("contact", case, {}) for case in plain]
        # The impacts have the same force set-points as in `forceaxis design`.
        for force in sorted(forces)[:-1]:
            cases.append(("strike", ContactCase(force, speed, strike), {}))
        cases += [("set", case, member) for member in members for case in plain]
        jobs = [bench.job(case, bank, member, 0, loss) for _, case, member in cases]
        try:
            done = simulation.run(jobs, os.cpu_count() or 1)
        except _core.SimulationError as error:
            raise Refusal(
                "simulation", f"expected a simulated contact without an error, got: {error}"
            ) from None
    found = []
    for (kind, case, member), one in zip(cases, done, strict=True):
        losses_max = bench.losses_permitted(case)
        row = simulated_contact("design", case.name, member, 0, one, losses_max)
        found.append(ContactOfKind(**vars(row), kind=kind))
        if not row.is_stable:
            where = "".join(f", {name} = {value:.4g}" for name, value in member.items())
            raise Refusal(
                f"simulated_{kind}",
                f"expected a force that settles in the simulated case {case.name}{where}, but "
                f"the force does not settle ({why(row)}); design with a smaller limit of the "
                "maximum sensitivity Ms, or for a smaller set of plants"
            )  # fmt: skip
    return tuple(found)


@dataclass(frozen=True)
class TouchDown:
    """The measured force during a first contact, and the settings of the axis on which this force
    depends."""

    time_s: Samples  #: time in s; 0 is the first sample whose force is above `contact_force`
    force_N: Samples
    force_asked_N: float
    order: MeasuringOrder  #: the request with which the Analyzer pressed on the workpiece
    settings: Settings  #: values of the objects TOUCH_DOWN_OBJECTS at the contact


class Touching(Analyzer):
    """An Analyzer that first moves out of contact, then presses and records the first contact.
    `touch` is the recording of the latest first contact."""

    touch: TouchDown
    asked_N: float

    def touch_down(self, force_N: float) -> None:
        """Makes a first contact and presses until the measured force has settled. Does not measure
        a frequency response."""
        self.press(force_N)

    def press(self, force_N: float) -> float:
        """Moves the axis out of contact, then presses in the same way as Analyzer.press(), and
        records the first contact."""
        self.asked_N = force_N
        self._leave()
        before = round(BEFORE_S * TICKS_PER_S)
        self.axis.arm(
            ("force",), before + round(AFTER_S * TICKS_PER_S), pretrigger=before,
            **trigger_on("force", self.objects.contact_force),
        )  # fmt: skip
        return super().press(force_N)

    def _leave(self) -> None:
        """Moves the axis back until it is out of contact. The distance of each move is at most the
        permitted travel and the distance to the workpiece. With a soft workpiece, the permitted
        travel may be larger than this distance."""
        axis, order = self.axis, self.order
        travel = min(max(order.travel, order.squeeze), order.gap or math.inf)
        self.set(position_window=self.window())
        axis.enable("profile position")
        for _ in range(MOVES_MAX):
            if axis.number("force") < self.objects.contact_force / 2:
                axis.move(axis.integer("position") - round(LONG_MOVE * travel))
                return
            axis.move(axis.integer("position") - round(SHORT_MOVE * travel))
        raise Refusal(
            "contact",
            f"expected no contact force after {MOVES_MAX} moves away from the workpiece, got: "
            f"{axis.about()}",
        )

    def _touch(self) -> None:
        settings = self.axis.get(*TOUCH_DOWN_OBJECTS)
        super()._touch()
        held = self.axis.link.recording(AFTER_S + 10.0)
        force_N = held.floats("force") * self.newton
        self.touch = TouchDown(held.time_s, force_N, self.asked_N, self.order, settings)


def name(force_N: float) -> str:
    """Returns the file name, without suffix, of a first contact with a force."""
    return f"touch-down-{force_N:g}N"


def write(fitted_axis: FittedAxis, touch: TouchDown) -> TouchDownPeaks:
    """Writes the recorded force of a first contact and its predicted force to a file in the folder.
    Returns both peak forces."""
    expected = predicted(fitted_axis, touch)
    columns = np.column_stack([touch.time_s, touch.force_N, expected])
    folder, file_name = fitted_axis.tuning.folder, f"{name(touch.force_asked_N)}.csv"
    with paths.replacing(folder, file_name) as (file,):
        header = ",".join(TOUCH_DOWN_COLUMNS)
        np.savetxt(file, columns, "%.6g", ",", header=header, comments="")
    peak = float(expected.max())
    predicted_N = peak if math.isfinite(peak) else None
    return TouchDownPeaks(peak_N=float(touch.force_N.max()), peak_predicted_N=predicted_N)


def predicted(fitted_axis: FittedAxis, touch: TouchDown) -> Samples:
    """Returns the predicted measured force in N at the times of a TouchDown.

    The prediction simulates the fitted plant together with the firmware, the filter bank and the
    settings of the axis. All values are NaN if the simulated force does not settle.
    """
    bank = fitted_axis.designed.bank.bank
    with fitted_axis.plant() as plant:
        bench = fitted_axis.bench(plant, bank)
        text = tomlkit.parse(bench.text(bench.cases[0], bank))
        del text["at"]
        text["firmware"] |= touch.settings
        file = plant.file("touch_down.toml", tomlkit.dumps(text))
        with Axis(SimLink(file)) as axis:
            same = Touching(axis, touch.order)
            try:
                # The contact is simulated twice.
                # The second contact starts at the distance from which the axis has approached.
                for _ in range(2):
                    same.touch_down(touch.force_asked_N)
            # This exception means that the simulated force does not settle.
            except (Refusal, Refused, NoAnswer):
                return np.full(len(touch.time_s), np.nan)
    return np.interp(touch.time_s, same.touch.time_s, same.touch.force_N)
