"""Contact of an axis with a bank in force: simulated on the fitted plant, and recorded.

`simulated` is what a bank has to pass before it is written; a `Touching` analyzer records the
touch-downs of the axis while the bank is verified, and `predicted` gives those of the fitted plant.
"""

import math
import os
from typing import NamedTuple

import numpy as np
import tomlkit

from forceaxis import _core, paths
from forceaxis.axis.axis import Axis, trigger_on
from forceaxis.axis.link import TICKS_PER_S, NoAnswer, Refused
from forceaxis.axis.sim import SimLink
from forceaxis.commission.analyzer import Analyzer, Order
from forceaxis.commission.refusal import Refusal
from forceaxis.design import files
from forceaxis.design import simulate as simulation
from forceaxis.design.changes import Design
from forceaxis.design.grid import hf_most
from forceaxis.linear import plant_set
from forceaxis.linear.bank import HF_CODES_MAX, Bank
from forceaxis.linear.plant_set import PlantSet
from forceaxis.results import to_json

MEMBERS, SEED = 6, 1988  # of the set, chosen at random
BEFORE_S, AFTER_S = 0.1, 2.0  # of a recorded touch-down, at most
# An axis leaves the contact in short steps, then by a long one: shares of the travel.
SHORT, LONG, STEPS = 0.25, 0.75, 40
COLUMNS = ("time_s", "force_N", "predicted_N")
# What a touch-down depends on besides the bank, as the axis has it.
SET = (
    "rated_force", "force_slope", "approach_velocity_max", "contact_force",
    "position_gain", "velocity_gain", "contact_loss_cap", "contact_loss_dwell", "bump_decay_shift",
    "latency_ticks",
)  # fmt: skip


def bank_of(keys):
    """The Bank of an experiment's keys, or of a design's summary."""
    gain = keys.get("force_gain", keys.get("gain"))
    sections = tuple(map(tuple, keys.get("sections", ())))
    return Bank(gain, keys.get("integral_rad_per_s", 0.0), keys.get("velocity_gain", 0.0), sections)


def fitted_set(tuning):
    """What was designed for: the PlantSet about the fitted values."""
    fitted = tuning.result("fit")
    ranges = plant_set.ranges_of(tuning.model, tuple(fitted["over"]), fitted["values"])
    modes = tuning.result("design").get("modes") or ({},)
    together = tuple(fitted.get("together") or ({},))
    return PlantSet(str(tuning.model), fitted["values"], ranges, tuple(modes), together)


def firmware_of(tuning):
    """What the axis is to be simulated with."""
    held = tuning.axis.get("position_gain", "velocity_gain", "approach_velocity_max",
                           "contact_force")  # fmt: skip
    held |= tuning.result("check")["settings"]
    return {name: held[name] for name in simulation.KEPT if name in held}


def _bench(tuning, plant, designed, bank):
    bench = simulation.ContactBench(plant, designed["adc_bits"], firmware=firmware_of(tuning))
    bench.wait_for(bank)
    bench.rated_N = max(tuning.order.forces)
    bench.settings["rated_force"] = round(1e3 * bench.rated_N)
    return bench


def simulated(tuning):
    """Rows of simulate.row, each with its "kind": contact at each force, strikes at all but the
    largest, then contact on random members of the set. Raises Refusal: hf_gain, simulated_KIND."""
    designed = tuning.result("design")
    bank, loss = bank_of(designed["bank"]), designed["contact_loss"] or {}
    loss = {name: loss[name] for name in files.LOSS if name in loss}
    if bank.hf_gain() > (most := hf_most(designed["adc_bits"])):
        raise Refusal(
            "hf_gain", f"expected at most {most:g} DAC codes per 8-bit count at high frequency, "
            f"{HF_CODES_MAX} per code of the ADC, got {bank.hf_gain():.3g}"
        )  # fmt: skip
    members = [member.values for member in fitted_set(tuning).random(MEMBERS, SEED)]
    with Design(str(tuning.model), tuning.result("fit")["values"]) as plant:
        bench = _bench(tuning, plant, designed, bank)
        speed, strike = bench.cases[0].speed_m_per_s, simulation.STRIKE_S * bench.rated_N
        plain = [simulation.ContactCase(force, speed) for force in tuning.order.forces]
        bench.measure_impacts(bank, cases=plain)
        cases = [("contact", case, {}) for case in plain]
        for force in sorted(tuning.order.forces)[:-1]:  # as a design is struck
            cases.append(("strike", simulation.ContactCase(force, speed, strike), {}))
        cases += [("set", case, member) for member in members for case in plain]
        jobs = [bench.job(case, bank, member, 0, loss) for _, case, member in cases]
        try:
            done = simulation.run(jobs, os.cpu_count() or 1)
        except _core.SimulationError as error:
            raise Refusal("simulation", f"expected a run, {error}") from None
    rows = []
    for (kind, case, member), one in zip(cases, done, strict=True):
        most = bench.losses_permitted(case)
        row = simulation.simulated_contact("design", case.name, member, 0, one, most)
        rows.append((kind, row))
    for kind, row in rows:
        if row.is_stable:
            continue
        where = "".join(f", {name} = {value:.4g}" for name, value in row.member.items())
        raise Refusal(
            f"simulated_{kind}", f"expected {row.case}{where} to settle, it does not "
            f"({simulation.why(row)}): ask for less by --ms, or a smaller set by --over"
        )  # fmt: skip
    return [{"kind": kind} | to_json(row) for kind, row in rows]


class Touched(NamedTuple):
    """A recorded touch-down."""

    time_s: np.ndarray  #: from the first reading above contact_force on
    force_N: np.ndarray
    force_asked_N: float
    order: Order  #: of the analyzer
    settings: dict  #: {object of SET: engineering value} that it happened with


class Touching(Analyzer):
    """An Analyzer whose contact begins apart and is recorded: `touched`, of the last one."""

    touched = None

    def touch_down(self, force_N):
        """Touches down and presses until the reading stands, without measuring."""
        self.press(force_N)

    def press(self, force_N):
        self.asked_N = force_N
        self._leave()
        before = round(BEFORE_S * TICKS_PER_S)
        self.axis.arm(
            ("force",), before + round(AFTER_S * TICKS_PER_S), pretrigger=before,
            **trigger_on("force", self.known["contact_force"]),
        )  # fmt: skip
        return super().press(force_N)

    def _leave(self):
        """Moves back by at most the travel from where nothing presses any more."""
        axis, travel = self.axis, self.order.travel
        axis.enable("profile position")
        for _ in range(STEPS):
            if axis.read("force") < self.known["contact_force"] / 2:
                axis.move(axis.read("position") - round(LONG * travel))
                return
            axis.move(axis.read("position") - round(SHORT * travel))
        raise Refusal("contact", f"expected no force after {STEPS} moves back, {axis.about()}")

    def _touch(self):
        settings = self.axis.get(*SET)
        super()._touch()
        held = self.axis.link.recording(AFTER_S + 10.0)
        force_N = held.values("force") * self.newton
        self.touched = Touched(held.time_s, force_N, self.asked_N, self.order, settings)


def name(force_N):
    """Of the file of a touch-down, without its suffix."""
    return f"touch-down-{force_N:g}N"


def write(tuning, touched):
    """A file of the folder with a Touched and what is predicted() of it; its peaks, N."""
    expected = predicted(tuning, touched)
    columns = np.column_stack([touched.time_s, touched.force_N, expected])
    with paths.replacing(tuning.folder, f"{name(touched.force_asked_N)}.csv") as (file,):
        np.savetxt(file, columns, "%.6g", ",", header=",".join(COLUMNS), comments="")
    peak = float(expected.max())
    return {
        "peak_N": float(touched.force_N.max()),
        "peak_predicted_N": peak if math.isfinite(peak) else None,
    }


def predicted(tuning, touched):
    """The reading, N, at the times of a Touched: of the fitted plant with firmware, bank and
    the same settings; NaN where that does not come to stand."""
    designed = tuning.result("design")
    bank, held = bank_of(designed["bank"]), touched.settings
    with Design(str(tuning.model), tuning.result("fit")["values"]) as plant:
        bench = _bench(tuning, plant, designed, bank)
        text = tomlkit.parse(bench.text(bench.cases[0], bank))
        del text["at"]
        text["firmware"] |= held
        file = plant.file("touch_down.toml", tomlkit.dumps(text))
        with Axis(SimLink(file)) as axis:
            same = Touching(axis, touched.order)
            try:
                for _ in range(2):  # the second one from as far away as the axis
                    same.touch_down(touched.force_asked_N)
            except (Refusal, Refused, NoAnswer):  # of that plant
                return np.full(len(touched.time_s), np.nan)
    return np.interp(touched.time_s, same.touched.time_s, same.touched.force_N)
