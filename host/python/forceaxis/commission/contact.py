"""Contact of an axis with a bank in force: simulated on the fitted plant, and recorded.

`simulated` is what a bank has to pass before it is written; a `Touching` analyzer records the
touch-downs of the axis while the bank is verified, and `predicted` gives those of the fitted plant.
"""

import math
import os
from dataclasses import dataclass, replace

import numpy as np
import tomlkit

from forceaxis import _core, paths
from forceaxis.axis.axis import Axis, trigger_on
from forceaxis.axis.link import TICKS_PER_S, NoAnswer, Refused
from forceaxis.axis.sim import SimLink
from forceaxis.commission.analyzer import Analyzer
from forceaxis.commission.level import MeasuringOrder, Samples
from forceaxis.commission.refusal import Refusal
from forceaxis.commission.tune_files import TOUCH_DOWN_COLUMNS
from forceaxis.commission.tune_folder import TuningFolder
from forceaxis.commission.tune_results import (
    Checked,
    ContactRow,
    Designed,
    Fitted,
    Settings,
    TouchDownPeaks,
    Values,
)
from forceaxis.design import files
from forceaxis.design import simulate as simulation
from forceaxis.design.changes import Design
from forceaxis.design.grid import hf_most
from forceaxis.linear import plant_set
from forceaxis.linear.bank import HF_CODES_MAX, Bank
from forceaxis.linear.plant_set import PlantSet
from forceaxis.results import from_json, to_json

MEMBER_COUNT, MEMBER_SEED = 6, 1988  # of the set, chosen at random
BEFORE_S, AFTER_S = 0.1, 2.0  # of a recorded touch-down, at most
# An axis leaves the contact in short moves, then by a long one: over the travel.
SHORT_MOVE, LONG_MOVE, MOVES_MAX = 0.25, 0.75, 40
# What a touch-down depends on besides the bank, as the axis has it.
TOUCH_DOWN_OBJECTS = (
    "rated_force", "force_slope", "approach_velocity_max", "contact_force",
    "position_gain", "velocity_gain", "contact_loss_cap", "contact_loss_dwell", "bump_decay_shift",
    "latency_ticks",
)  # fmt: skip


@dataclass(frozen=True)
class FittedAxis:
    """What an axis with the designed bank is predicted from."""

    tuning: TuningFolder
    checked: Checked
    fitted: Fitted
    designed: Designed

    @property
    def plants(self) -> PlantSet:
        """What was designed for: the set about the fitted values."""
        model, fitted = self.tuning.model, self.fitted
        ranges = plant_set.ranges_of(model, fitted.over, fitted.values)
        modes, together = self.designed.modes or ({},), fitted.together or ({},)
        return PlantSet(str(model), fitted.values, ranges, modes, together)

    def plant(self) -> Design:
        """The fitted plant, for a `with`."""
        return Design(str(self.tuning.model), self.fitted.values)

    def bench(self, plant: Design, bank: Bank) -> simulation.ContactBench:
        """The bench of a plant with the axis' own firmware settings."""
        bench = simulation.ContactBench(
            plant, self.designed.adc_bits, firmware=firmware_of(self.tuning, self.checked)
        )
        bench.wait_for(bank)
        bench.rated_N = max(self.tuning.order.forces)
        bench.settings["rated_force"] = round(1e3 * bench.rated_N)
        return bench


def firmware_of(tuning: TuningFolder, checked: Checked) -> Settings:
    """What the axis is to be simulated with."""
    held = tuning.axis.get("position_gain", "velocity_gain", "approach_velocity_max",
                           "contact_force")  # fmt: skip
    held |= checked.settings
    return {name: held[name] for name in simulation.KEPT if name in held}


def simulated(fitted_axis: FittedAxis) -> tuple[ContactRow, ...]:
    """Simulated contacts, each with its kind: contact at each force, strikes at all but the
    largest, then contact on random members of the set. Raises Refusal: hf_gain, simulated_KIND."""
    designed, forces = fitted_axis.designed, fitted_axis.tuning.order.forces
    bank, given = designed.bank.bank, designed.contact_loss or {}
    loss = {name: int(given[name]) for name in files.LOSS if name in given}
    if bank.hf_gain() > (most := hf_most(designed.adc_bits)):
        raise Refusal(
            "hf_gain", f"expected at most {most:g} DAC codes per 8-bit count at high frequency, "
            f"{HF_CODES_MAX} per code of the ADC, got {bank.hf_gain():.3g}"
        )  # fmt: skip
    members = [member.values for member in fitted_axis.plants.random(MEMBER_COUNT, MEMBER_SEED)]
    with fitted_axis.plant() as plant:
        bench = fitted_axis.bench(plant, bank)
        speed, strike = bench.cases[0].speed_m_per_s, simulation.STRIKE_S * bench.rated_N
        plain = [simulation.ContactCase(force, speed) for force in forces]
        bench.measure_impacts(bank, cases=plain)
        cases: list[tuple[str, simulation.ContactCase, Values]] = []
        cases += [("contact", case, {}) for case in plain]
        for force in sorted(forces)[:-1]:  # as a design is struck
            cases.append(("strike", simulation.ContactCase(force, speed, strike), {}))
        cases += [("set", case, member) for member in members for case in plain]
        jobs = [bench.job(case, bank, member, 0, loss) for _, case, member in cases]
        try:
            done = simulation.run(jobs, os.cpu_count() or 1)
        except _core.SimulationError as error:
            raise Refusal("simulation", f"expected a run, {error}") from None
    found = []
    for (kind, case, member), one in zip(cases, done, strict=True):
        losses_max = bench.losses_permitted(case)
        row = simulation.simulated_contact("design", case.name, member, 0, one, losses_max)
        found.append(replace(from_json(ContactRow, to_json(row)), kind=kind))
        if not row.is_stable:
            where = "".join(f", {name} = {value:.4g}" for name, value in member.items())
            raise Refusal(
                f"simulated_{kind}", f"expected {case.name}{where} to settle, it does not "
                f"({simulation.why(row)}): ask for less by a smaller ms, or for a smaller set"
            )  # fmt: skip
    return tuple(found)


@dataclass(frozen=True)
class TouchDown:
    """A recorded touch-down."""

    time_s: Samples  #: from the first reading above contact_force on
    force_N: Samples
    force_asked_N: float
    order: MeasuringOrder  #: of the analyzer
    settings: Settings  #: {object of TOUCH_DOWN_OBJECTS: engineering value} then


class Touching(Analyzer):
    """An Analyzer whose contact begins apart and is recorded: `touch`, of the last contact."""

    touch: TouchDown
    asked_N: float

    def touch_down(self, force_N: float) -> None:
        """Touches down and presses until the reading settles, without measuring."""
        self.press(force_N)

    def press(self, force_N: float) -> float:
        """As Analyzer.press(), from apart, recorded."""
        self.asked_N = force_N
        self._leave()
        before = round(BEFORE_S * TICKS_PER_S)
        self.axis.arm(
            ("force",), before + round(AFTER_S * TICKS_PER_S), pretrigger=before,
            **trigger_on("force", self.known["contact_force"]),
        )  # fmt: skip
        return super().press(force_N)

    def _leave(self) -> None:
        """Moves back by at most the travel from where nothing presses any more."""
        axis, travel = self.axis, self.order.travel
        axis.enable("profile position")
        for _ in range(MOVES_MAX):
            if axis.read("force") < self.known["contact_force"] / 2:
                axis.move(axis.read("position") - round(LONG_MOVE * travel))
                return
            axis.move(axis.read("position") - round(SHORT_MOVE * travel))
        raise Refusal("contact", f"expected no force after {MOVES_MAX} moves back, {axis.about()}")

    def _touch(self) -> None:
        settings = self.axis.get(*TOUCH_DOWN_OBJECTS)
        super()._touch()
        held = self.axis.link.recording(AFTER_S + 10.0)
        force_N = held.values("force") * self.newton
        self.touch = TouchDown(held.time_s, force_N, self.asked_N, self.order, settings)


def name(force_N: float) -> str:
    """Of the file of a touch-down, without its suffix."""
    return f"touch-down-{force_N:g}N"


def write(fitted_axis: FittedAxis, touch: TouchDown) -> TouchDownPeaks:
    """A file of the folder with a TouchDown and what is predicted() of it; its peaks."""
    expected = predicted(fitted_axis, touch)
    columns = np.column_stack([touch.time_s, touch.force_N, expected])
    folder, file_name = fitted_axis.tuning.folder, f"{name(touch.force_asked_N)}.csv"
    with paths.replacing(folder, file_name) as (file,):
        header = ",".join(TOUCH_DOWN_COLUMNS)
        np.savetxt(file, columns, "%.6g", ",", header=header, comments="")
    peak = float(expected.max())
    return TouchDownPeaks(float(touch.force_N.max()), peak if math.isfinite(peak) else None)


def predicted(fitted_axis: FittedAxis, touch: TouchDown) -> Samples:
    """The reading, N, at the times of a TouchDown: of the fitted plant with firmware, bank and
    the same settings; NaN where that does not settle."""
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
                for _ in range(2):  # the second one from as far away as the axis
                    same.touch_down(touch.force_asked_N)
            except (Refusal, Refused, NoAnswer):  # of that plant
                return np.full(len(touch.time_s), np.nan)
    return np.interp(touch.time_s, same.touch.time_s, same.touch.force_N)
