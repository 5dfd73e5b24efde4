"""Axes drawn from the ranges of `forceaxis new`, and judged by what a tool never sees: their true
parameters.

Run as a process of its own, `drawn_axes.py SEED FOLDER [friction]` draws an axis, writes its data
sheet's model into FOLDER/known, prints the address at which the axis answers as over a bus, and,
once it is asked to judge, what became of the axis that a tool has tuned. `Hidden` is the tool's
side.
"""

import json
import math
import shutil
import sys
import time
from multiprocessing.connection import Client, Listener
from pathlib import Path

import numpy as np
from forceaxis import _core, linear, objects
from forceaxis.axis.sim import SimLink
from forceaxis.design import data_sheet, experiment_file, new, sets, simulate
from forceaxis.design.changes import Design
from forceaxis.linear import over as margins
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import PlantSet, ranges_of

OVER = ("k_w=30%,m_w=30%",)
PRESS = {
    "torque_constant_n_m_per_a": 0.5, "resistance_ohm": 4.5, "inductance_h": 0.0158,
    "rotor_inertia_kg_m2": 0.0013, "motor_peak_current_a": 30, "supply_v": 60,
    "lead_mm_per_rev": 25, "moving_mass_kg": 50, "full_scale_speed_m_per_s": 0.4,
    "sensor_full_scale_n": 300, "sensor_stiffness_n_per_m": 4e5, "sensor_noise_n": 0.1,
    "workpiece_stiffness_n_per_m": 4e5, "workpiece_mass_kg": 6, "workpiece_damping_ratio": 0.005,
}  # fmt: skip


# Of the firmware: as an axis is delivered.
DELIVERED = (
    "firmware.mode=disabled",
    *(f"firmware.{name}={objects.default(name):.0f}"
      for name in ("position_gain", "force_scale", "rated_force")),
)  # fmt: skip


def collected(sheet):
    """(values of the data sheet, their sources)."""
    return data_sheet.collect({name: str(value) for name, value in sheet.items()})


def values(sheet):
    return collected(sheet)[0]


def written(folder, sheet):
    new.write(folder, *collected(sheet))
    return folder


def press(folder):
    return written(folder, PRESS)


def draw(seed):
    """(data sheet, {parameter: true value over that of the data sheet})."""
    rng = np.random.default_rng([1988, seed])

    def between(low, high):
        return float(math.exp(rng.uniform(math.log(low), math.log(high))))

    lead, moving, full = between(10, 40), between(10, 100), between(150, 500)
    r = lead / 1e3 / (2 * math.pi)
    stiffness = full / (between(0.25, 1) * 1e-3)
    speed, torque = between(0.1, 0.4), between(0.1, 0.8)
    sheet = {
        "torque_constant_n_m_per_a": torque,
        "resistance_ohm": between(0.5, 4),
        "inductance_h": between(2e-3, 1.5e-2),
        "rotor_inertia_kg_m2": between(0.3, 1.5) * moving * r * r,
        "motor_peak_current_a": between(3, 8) * full * r / torque / 0.9,
        "lead_mm_per_rev": lead,
        "moving_mass_kg": moving,
        "guide_damping_n_s_per_m": between(2, 8) * moving,
        "full_scale_speed_m_per_s": speed,
        "velocity_loop_hz": between(20, 60),
        "sensor_full_scale_n": full,
        "sensor_stiffness_n_per_m": stiffness,
        "sensor_damping_n_s_per_m": stiffness * between(5e-5, 5e-4),
        "sensor_noise_n": between(0.5, 1) * full / 2048,
        "encoder_counts_per_rev": round(between(4000, 16000)),
        "workpiece_stiffness_n_per_m": stiffness * between(0.3, 3),
        "workpiece_mass_kg": between(1, 10),
        "workpiece_damping_ratio": between(0.01, 0.05),
    }
    least = 1.2 * sheet["motor_peak_current_a"] * sheet["resistance_ohm"]
    sheet["supply_v"] = max(48.0, 2 * torque * speed / r, least)
    off = {
        "k_w": between(1 / 3, 3), "m_w": between(1 / 3, 3), "b_w": between(1 / 3, 3),
        "k_s": between(0.85, 1.18), "b_s": between(0.5, 2), "b_axis": between(0.5, 2),
        "m_axis": between(0.96, 1.04), "k_torque": between(0.95, 1.05),
        "k_preamp_fdbk": between(0.95, 1.05), "k_preamp_cmd": between(0.97, 1.03),
        "a_preamp_fdbk": between(0.95, 1.05),
    }  # fmt: skip
    return sheet, off


# Of the force that the motor has at its peak: dry friction of guide and gear. Under the workpiece
# in newtons.
RUBS, TABLE_N = (5e-4, 5e-3), (2.0, 25.0)
PLACES = {
    "seals": ("load", "ground"),
    "gear": ("motor", "ground"),
    "table": ("workpiece", "ground"),
}
TRANSMISSION_N_PER_M = (2e7, 2e8)  # a screw between motor and load


def rubbed(seed):
    """(data sheet, truth over it, {friction of PLACES: newtons}) of an axis with a screw, whose
    friction the sheet does not tell."""
    rng = np.random.default_rng([1988, seed, 28])
    sheet, off = draw(seed)
    r = sheet["lead_mm_per_rev"] / 1e3 / (2 * math.pi)
    peak = 0.9 * sheet["torque_constant_n_m_per_a"] * sheet["motor_peak_current_a"] / r

    def between(low, high):
        return float(math.exp(rng.uniform(math.log(low), math.log(high))))

    sheet["transmission_stiffness_n_per_m"] = between(*TRANSMISSION_N_PER_M)
    off["m_motor"] = off["m_load"] = off.pop("m_axis")
    found = {name: between(*(share * peak for share in RUBS)) for name in ("seals", "gear")}
    return sheet, off, found | {"table": between(*TABLE_N)}


def with_friction(model, found):
    """The model's text with frictions, {name of PLACES: newtons}."""
    rows = [
        f'[[friction]]\nname = "{name}"\nbetween = {list(PLACES[name])}\ncoulomb = {newton!r}\n'
        for name, newton in found.items()
    ]
    return model.read_text().replace("[drive]", "\n".join([*rows, "[drive]"]), 1)


class Hidden(SimLink):
    """The link to an axis that another process has drawn."""

    def __init__(self, address):
        self.axis = self._remote = Remote(address)
        self.where, self._owned, self._armed = "the hidden axis", False, None
        self._at_power_up, self._saving = {}, None
        self.axis.step(1)

    def processor_s(self):
        """Seconds of the processor that the other process has taken."""
        return self._remote.call("processor_s")

    def judge(self, folder, forces, *more):
        """The row of judged(), also after close(), by which the tool has let the axis go; the last
        request."""
        row = self._remote.call("judge", str(folder), forces, *more)
        self._remote.close()
        return row


class Remote:
    """_core.LiveAxis of another process, without what only a test may read."""

    def __init__(self, address):
        self._connection = Client(address, "AF_UNIX")

    def call(self, name, *given):
        self._connection.send((name, given))
        error, answer = self._connection.recv()
        if error:
            raise error
        return answer

    def close(self):
        self._connection.close()

    def step(self, ticks):
        return self.call("step", ticks)

    def read(self, number):
        return self.call("read", number)

    def write(self, number, raw):
        return self.call("write", number, raw)

    def end_schedule(self):
        return self.call("end_schedule")

    def samples(self, first, count, channels):
        return self.call("samples", first, count, channels)


def truth_of(model, off):
    known = linear.facts(model).parameters
    return {name: known[name][0] * factor for name, factor in off.items()}


def asked_of(sheet):
    """(forces, force_max) in N that an axis of this data sheet is tuned for."""
    full = sheet["sensor_full_scale_n"]
    return (30.0, min(150.0, full / 3)), min(0.9 * full, 300.0)


def given(truth):
    return [f"{name}={value!r}" for name, value in truth.items()]


def bounds(model, extremes):
    """Largest true force and way of an axis."""
    scale = abs(linear.facts(model).required_encoder.scale)
    ends = [extremes[f"position_{end}_cnt"] for end in ("min", "max")]
    return {"force_max_N": extremes["force_N"], "travel_mm": [1e3 * end / scale for end in ends]}


def judged(model, truth, folder, forces, moving=None):
    """What the law that a tuning in `folder` designed does on the true axis."""
    if not (folder / "design.json").exists():
        return {}
    designed = json.loads((folder / "design.json").read_text())["result"]
    held = designed["bank"]
    sections = tuple(map(tuple, held["sections"]))
    bank = Bank(held["force_gain"], held["integral_rad_per_s"], held["velocity_gain"], sections)
    modes = tuple(designed["modes"]) if moving is None else moving
    plants = PlantSet(str(model), truth, ranges_of(model, OVER, truth), modes)
    worst = margins.worst(plants, ("zoh",), LoopSpec("bank", bank=bank))
    rows = contacts(model, truth, forces, bank, designed)
    return {
        "Ms": worst.Ms,
        "fS_true_Hz": worst.fS_Hz,
        "stable": worst.stable and not simulate.unstable(rows),
        "static_error_percent": [one.static_error_percent for one in rows],
    }


def kept_by(axis):
    """What an axis has of the settings of simulated contacts, where no tuning writes them."""
    known = [objects.BY_NAME[name] for name in simulate.KEPT]
    return {one.name: axis.read(one.number) * one.scale for one in known}


def contacts(model, truth, forces, bank, designed, axis=None):
    """Rows of simulate: the true plant's contacts at the forces. axis: has the settings that the
    tuning did not write."""
    with Design(str(model), truth) as plant:
        scale = abs(plant.facts.required_encoder.scale)
        written = (kept_by(axis) if axis else {}) | designed["objects"]
        speed = written["approach_velocity_max"] / scale
        kept = {name: written[name] for name in simulate.KEPT if name in written}
        bench = simulate.ContactBench(plant, designed["adc_bits"], firmware=kept)
        bench.wait_for(bank, designed["worst"]["fS_Hz"])
        bench.rated_N = max(forces)
        bench.settings["rated_force"] = round(1e3 * bench.rated_N)
        # The slope is in per mille of the rated force. With the slope for a rated force of 100 N,
        # a force of 1.8 N was not reached within the run.
        bench.settings["force_slope"] = round(1000 / simulate.RAMP_S)
        kept = designed["contact_loss"]
        loss = {name: kept[name] for name in experiment_file.LOSS if name in kept}
        cases = [simulate.ContactCase(force, speed) for force in forces]
        bench.measure_impacts(bank, cases=cases)  # which no law can avoid
        done = simulate.run([bench.job(case, bank, {}, 0, loss) for case in cases], 1)
        return [
            simulate.simulated_contact("design", case.name, {}, 0, outcome)
            for case, outcome in zip(cases, done, strict=True)
        ]


def serve(seed, folder, friction=False):
    sheet, off, rubs = rubbed(seed) if friction else (*draw(seed), {})
    model = written(folder / "known", sheet) / "model.toml"
    truth, hidden, moving = truth_of(model, off), model.parent, None
    if friction:
        hidden = folder / "true"
        shutil.copytree(model.parent, hidden)
        (hidden / "model.toml").write_text(with_friction(model, rubs))
        model = hidden / "model.toml"
        moving = sets.slopes(model, truth)  # sliding, and stuck where a path is left
    axis = _core.LiveAxis(
        str(hidden / "contact.toml"), [*given(truth), *DELIVERED],
        str(folder / "store.bin"),
    )  # fmt: skip

    def judge(out, forces):
        row = {"off": off, "rubs": rubs, "axis_s": axis.ticks / 1500}
        row |= bounds(model, axis.extremes)
        return row | judged(model, truth, Path(out), forces, moving)

    answer(axis, folder, {"asked": asked_of(sheet)}, judge)


def answer(axis, folder, told, judge):
    """Lets another process have the axis over a socket until that closes it. Prints `told` and the
    address. judge(FOLDER, FORCES, ...): the row of a tuning."""
    axis.step(1)
    axis.reset_extremes()  # what the first inputs found
    own = {"judge": judge, "processor_s": time.process_time}
    with Listener(str(folder / "axis"), "AF_UNIX") as listener:
        print(json.dumps({"address": listener.address} | told), flush=True)
        with listener.accept() as connection:
            while True:
                try:
                    name, arguments = connection.recv()
                except EOFError:
                    break
                try:
                    done = own.get(name) or getattr(axis, name)
                    connection.send((None, done(*arguments)))
                except Exception as error:  # which the tool is to see as its own axis'
                    connection.send((error, None))


if __name__ == "__main__":
    serve(int(sys.argv[1]), Path(sys.argv[2]), "friction" in sys.argv[3:])
