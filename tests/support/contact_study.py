"""Machines that are drawn at random, touch a workpiece, and are identified from their recordings by
`forceaxis identify contact`; docs/studies/contact_study.md has the results.

    python tests/support/contact_study.py 40    # machines that are nearly their model, a row each
"""

import json
import math
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # waiting threads cost more than they do

import numpy as np
from forceaxis import _core
from forceaxis.commission import (
    contact_check,
    contact_error,
    contact_fit,
    contact_sampler,
    contact_search,
)
from forceaxis.commission.contact_fit import REJECTED_BELOW, ContactOrder
from forceaxis.commission.contact_likelihood import ContactProblem
from forceaxis.commission.contact_sampler import Drawn
from forceaxis.recordings import signal_recording
from forceaxis.recordings.signal_recording import (
    RecordedSignal,
    RecordingSource,
    SignalRecording,
)
from hidden_machine import DAC_VOLTS_PER_CODE, TICK_S, Machine, Sensors, Touch, touch

RANGE_N = 102.4  # of the force sensor, in each direction
# Speed in m/s and force in N of the touch-downs that are recorded, and of those that are predicted.
RECORDED = ((0.02, 30.0), (0.04, 40.0), (0.06, 60.0))
UNSEEN = tuple((0.015 + 0.006 * i, 20.0 + 7.0 * ((3 * i) % 10)) for i in range(10))
BAND = 39  # predictions whose smallest and largest value are a band of 95 %
# {parameter of the model: (field of Machine, unit, deviation of the logarithm in the data sheet)}
PARAMETERS = {
    "m_w": ("m_w", "kg", 0.5),
    "k_w": ("k_w", "N/m", 0.5),
    "b_w": ("b_w", "N s/m", 0.7),
    "f_c": ("f_c", "N", 0.7),
    "lag": ("lag_rad_s", "rad/s", 0.5),
    "k_s": ("k_s", "N/m", 0.2),
    "b_s": ("b_s", "N s/m", 0.7),
    "b_r": ("b_r", "N s/m", 0.3),
    "m_r": ("m_r", "kg", 0.05),
    "k_act": ("k_act", "N s/m", 0.2),
    "a_act": ("a_act", "rad/s", 0.2),
    "velocity_per_volt": ("speed_per_volt", "m/s/V", 0.1),
}
FITTED = ("m_w", "k_w", "b_w", "f_c", "lag")
NEARLY = (*FITTED, "k_s")  # for a machine that is nearly its model
# Structures that the model does not have: changes of the machine, and the element that explains it.
LACKING = {
    "stiffening contact": {"k_core": 3e5, "core_gap": 6e-5},
    "hysteresis": {"b_s": 0.0, "slip_stiffness": 6e4, "slip_force": 4.0},
    "sensor lag": {"lag_rad_s": 1500.0},
    "backlash": {"rotor": 6.0, "play": 2e-5},
    "friction": {"f_c": 5.0},
}


def sensors(bits, noise=0.06, offset=0.0):
    """Returns converters with a number of bits for the force."""
    return Sensors(2 * RANGE_N / 2**bits, bits, noise, 1e6, offset)


def model_text(machine, read, noise=0.0):
    """Returns the model of a data sheet, with the elements that the machine has."""
    table = [
        f'{name} = {{ value = {getattr(machine, field)!r}, unit = "{unit}", source = "sheet" }}'
        for name, (field, unit, _) in PARAMETERS.items()
        if getattr(machine, field)
    ]
    friction = """[[friction]]
name = "guide_friction"
between = ["stage", "ground"]
coulomb = "f_c"
"""
    return f"""title = "Stage with a force sensor"
[parameters]
{chr(10).join(table)}
[[body]]
name = "stage"
mass = "m_r"
position = "-2 mm"
[[body]]
name = "workpiece"
mass = "m_w"
[[damper]]
name = "guide"
between = ["stage", "ground"]
damping = "b_r"
{friction if machine.f_c else ""}[[spring]]
name = "support"
between = ["workpiece", "ground"]
stiffness = "k_w"
damping = "b_w"
[[contact]]
name = "sensor"
between = ["stage", "workpiece"]
stiffness = "k_s"
{'damping = "b_s"' if machine.b_s else ""}
[drive]
type = "first_order"
body = "stage"
k_act = "k_act"
a_act = "a_act"
velocity_per_volt = "velocity_per_volt"
[encoder]
body = "stage"
scale = {read.scale!r}
[[adc]]
channel = 0
signal = "sensor.spring_force"
per_count = {read.per_count!r}
zero_code = {1 << (read.bits - 1)}
bits = {read.bits}
{f"noise = {noise!r}" if noise else ""}
{'filter = "lag"' if machine.lag_rad_s else ""}
[dac]
range = "10 V"
"""


def recording(one):
    """Returns a touch-down as a recording."""
    signals = [
        ("code", "count", one.codes),
        ("force", "N", one.force_N),
        ("position", "m", one.position_m),
    ]
    return SignalRecording(
        "touch-down",
        RecordingSource("touch.csv", "CSV", "0", 1),
        tuple(
            RecordedSignal(
                name, unit, name, unit, 1.0, 1, 1 / TICK_S, time_s=one.time_s,
                values=np.asarray(values, dtype=float),
            )
            for name, unit, values in signals
        ),
    )  # fmt: skip


def drawn(seed):
    """Returns a machine, its converters (8 or 12 bits), and the gain of its law."""
    rng = np.random.default_rng([34, seed])

    def between(low, high):
        return math.exp(rng.uniform(math.log(low), math.log(high)))

    machine = Machine(
        m_w=between(1.0, 6.0), k_w=between(2e5, 8e5), b_w=between(40.0, 160.0),
        f_c=between(2.0, 8.0), lag_rad_s=between(900.0, 2400.0),
    )  # fmt: skip
    read = sensors(12 if seed % 2 else 8, between(0.03, 0.12), 0.3 * float(rng.standard_normal()))
    return machine, read, 0.03 * between(0.5, 1.3)


def sheet_of(machine, names, seed):
    """Returns the data sheet of a machine, in which the parameters `names` are wrong."""
    rng = np.random.default_rng([35, seed])
    changed = {}
    for name in names:
        field, _, spread = PARAMETERS[name]
        changed[field] = getattr(machine, field) * math.exp(spread * rng.standard_normal())
    return machine.but(**changed)


def touched(machine, read, seed, gain, contacts=RECORDED):
    """Returns the touch-downs of a machine."""
    return [
        touch(machine, read, [seed, i], speed=speed, force=force, gain=gain, ticks=ticks_of(speed))
        for i, (speed, force) in enumerate(contacts)
    ]


def order_of(folder, sheet, read, touches, names=FITTED, noise=0.0):
    """Writes model and recordings into a folder, and returns the order to identify `names`."""
    folder.mkdir(parents=True, exist_ok=True)
    model = folder / "model.toml"
    model.write_text(model_text(sheet, read, noise))
    files = [
        signal_recording.write(recording(one), folder / f"touch_{i}")
        for i, one in enumerate(touches, 1)
    ]
    given = tuple(
        f"{name}={getattr(sheet, PARAMETERS[name][0])!r}+-{100 * PARAMETERS[name][2]}%"
        for name in names
    )
    return ContactOrder(str(model), files, names, given, seed=1, threads=2)


def identified(seed, folder):
    """Identifies the machine with this seed, and returns what was found beside the truth."""
    machine, read, gain = drawn(seed)
    order = order_of(
        Path(folder), sheet_of(machine, FITTED, seed), read, touched(machine, read, seed, gain)
    )
    found = contact_fit.identify(order).result
    row = {"seed": seed, "bits": read.bits, "p": found.p_value, "parameters": {}}
    row["r_hat"] = found.convergence and found.convergence.r_hat
    row["simulations"] = found.convergence and found.convergence.evaluations
    for name, one in found.parameters.items():
        truth = getattr(machine, PARAMETERS[name][0])
        row["parameters"][name] = {
            "truth": truth, "value": one.value, "interval": one.interval, "told": one.told,
            "inside": bool(one.interval[0] <= truth <= one.interval[1]),
            "narrowed": one.deviation / one.prior_deviation,
        }  # fmt: skip
    return row, found, machine, read, gain


def predicted(order, values, read, contact, seed):
    """Returns the force in N of a touch-down that the project's plant predicts, with the law of
    hidden_machine.touch. `contact`: speed, force and gain."""
    speed, force, gain = contact
    text = Path(order.model).read_text().replace("[dac]", f"noise = {read.noise!r}\n[dac]")
    noisy = Path(order.model).with_name("noisy.toml")
    noisy.write_text(text)
    plant = _core.Plant(str(noisy), dict(values), seed=seed)
    limit, zero = speed / Machine.speed_per_volt, 1 << (read.bits - 1)
    forces = []
    for _ in range(ticks_of(min(speed, gain * force * Machine.speed_per_volt))):
        forces.append((plant.codes()[1] - zero) * read.per_count)
        volts = min(max(gain * (force - forces[-1]), -limit), limit)
        plant.step(round(volts / DAC_VOLTS_PER_CODE))
    return np.array(forces)


def ticks_of(speed):
    """Returns the length of a touch-down in ticks."""
    return 250 + int(3.3 / speed)


def figures(force_N):
    """Returns peak in N and settling time in s of a recorded touch-down: from the first force until
    the force stays within 5 % of its last value."""
    end = float(np.mean(force_N[-30:]))
    first = int(np.argmax(force_N > 0.1 * end))
    outside = np.flatnonzero(np.abs(force_N - end) > 0.05 * end)
    return float(np.max(force_N)), float((outside[-1] + 1 - first) * TICK_S)


def foreseen(seed, folder):
    """Identifies a machine and predicts ten contacts that it has not recorded, with other speeds,
    forces and gains. Returns for each (error of the peak, error of the settling time, whether the
    bands of 95 % hold both)."""
    _, found, machine, read, gain = identified(seed, folder)
    order = ContactOrder(str(Path(folder) / "model.toml"), (), FITTED)
    read = Sensors(read.per_count, read.bits, read.noise, read.scale, 0.0)  # tared
    draws = found.posterior.draws(BAND, seed)
    rows = []
    for i, (speed, force) in enumerate(UNSEEN):
        own = gain * (0.6 + 0.08 * i)
        ticks = ticks_of(min(speed, own * force * Machine.speed_per_volt))
        unseen = touch(
            machine, read, [seed, 50 + i], speed=speed, force=force, gain=own, ticks=ticks
        )
        true = figures(unseen.force_N)
        every = np.array(
            [
                figures(predicted(order, values, read, (speed, force, own), 100 * i + n))
                for n, values in enumerate(draws)
            ]
        )
        middle = np.median(every, axis=0)
        low, high = every.min(axis=0), every.max(axis=0)
        rows.append((
            abs(middle[0] / true[0] - 1), abs(middle[1] / true[1] - 1),
            bool(low[0] <= true[0] <= high[0]), bool(low[1] <= true[1] <= high[1]),
        ))  # fmt: skip
    return rows


def lacking_order(name, seed, folder):
    """Returns the order to identify a machine with an element that its model lacks."""
    rng = np.random.default_rng([37, seed])
    change = {
        field: value * math.exp(0.3 * rng.standard_normal()) if value else value
        for field, value in LACKING[name].items()
    }
    plain = Machine(b_w=80.0).but(**({"b_s": 60.0}))
    machine = plain.but(**change)
    read = sensors(12 if seed % 2 else 8)
    names = ("m_w", "k_w", "b_w", "k_s", "b_r")
    return order_of(
        Path(folder), sheet_of(plain, names, seed), read, touched(machine, read, seed, 0.03), names
    )


def lacking(name, seed, folder):
    """Identifies a machine with an element that its model lacks, by an exact model. Returns whether
    it is rejected, the p value, and the names of the elements that explain it, the best first."""
    order = replace(lacking_order(name, seed, folder), model_error={})
    found = contact_fit.identify(order).result
    return found.rejected, found.p_value, [one.name for one in found.elements]


def stiffening(seed, folder):
    """Identifies a machine whose contact stiffens, with a model that has two stiffnesses, all three
    constants of the contact wrong. Returns what was found, and the true secant stiffness in N/m at
    the largest recorded force."""
    rng = np.random.default_rng([39, seed])
    core, gap, *errors = (
        value * math.exp(0.3 * rng.standard_normal()) for value in (3e5, 6e-5, 2e5, 4e5, 6e-5)
    )
    machine, read = Machine(b_w=80.0, k_core=core, core_gap=gap), sensors(12 if seed % 2 else 8)
    order = order_of(Path(folder), machine, read, touched(machine, read, seed, 0.03), ("k_w",))
    model = Path(order.model)
    rows = '[parameters]\nk_2 = { value = 4e5, unit = "N/m", source = "sheet" }\n'
    rows += 'd_2 = { value = 6e-5, unit = "m", source = "sheet" }'
    text = model.read_text().replace("[parameters]", rows)
    curve = 'stiffness = ["k_s", "k_2"]\nbreaks = ["d_2"]'
    model.write_text(text.replace('stiffness = "k_s"', curve))
    names = ("k_s", "k_2", "d_2")
    given = [f"{name}={value!r}+-50%" for name, value in zip(names, errors, strict=True)]
    found = contact_fit.identify(
        ContactOrder(order.model, order.recordings, names, given, seed=1, threads=2)
    ).result
    force_N = found.secants[0].force_N
    overlap = min(force_N / machine.k_s, (force_N + core * gap) / (machine.k_s + core))
    return found, force_N / overlap


def rank(seed, folder):
    """Draws a plant of the project and the zero of its force from the prior, simulates its
    touch-downs by the project's own stepper, and returns p value and the rank of each true
    parameter among 99 samples of its posterior."""
    rng = np.random.default_rng([38, seed])
    sheet, read = Machine(b_w=80.0, f_c=4.0, lag_rad_s=1500.0), sensors(12 if seed % 2 else 8)
    true = {
        name: getattr(sheet, PARAMETERS[name][0])
        * math.exp(PARAMETERS[name][2] * rng.standard_normal())
        for name in FITTED
    }
    zero_N = read.per_count * rng.standard_normal()
    # A converter of 16 bits has the noise; that of the machine then adds the zero and rounds.
    fine = sensors(16)
    order = order_of(Path(folder), sheet, fine, [], noise=read.noise)
    touches = []
    for i, (speed, force) in enumerate(RECORDED):
        plant = _core.Plant(order.model, true, seed=1000 * seed + i)
        limit = speed / Machine.speed_per_volt
        codes, forces, places = [], [], []
        for _ in range(ticks_of(speed)):
            encoder, code, _ = plant.codes()
            read_N = (code - (1 << 15)) * fine.per_count + zero_N
            forces.append(math.floor(read_N / read.per_count + 0.5) * read.per_count)
            places.append(encoder / read.scale)
            volts = min(max(0.03 * (force - forces[-1]), -limit), limit)
            codes.append(round(volts / DAC_VOLTS_PER_CODE))
            plant.step(codes[-1])
        touches.append(Touch(np.array(codes), np.array(forces), np.array(places), np.array(forces)))
    found = contact_fit.identify(order_of(Path(folder), sheet, read, touches)).result
    if found.posterior is None:
        return found.p_value, None
    chosen = found.posterior.table[np.linspace(0, len(found.posterior.table) - 1, 99).astype(int)]
    return found.p_value, {
        name: int(np.sum(chosen[:, i] < true[name])) for i, name in enumerate(found.posterior.names)
    }


def nearly(seed):
    """Returns a machine as drawn() does, and the same machine a little beside its model: gains of
    the drive, friction law and contact law are not those that the model can have."""
    machine, read, gain = drawn(seed)
    rng = np.random.default_rng([41, seed])

    def off(deviation):
        return 1 + deviation * float(rng.standard_normal())

    beside = machine.but(
        speed_per_volt=machine.speed_per_volt * off(0.01), k_act=machine.k_act * off(0.02),
        a_act=machine.a_act * off(0.05), stribeck=0.2 * float(rng.random()), power=off(0.005),
    )  # fmt: skip
    return machine, beside, read, gain


def nearly_identified(seed, folder, is_sampled):
    """Identifies a machine beside its model with the default error of the model, and the machine of
    the model with an exact model. Returns p values, the numbers of the drive that were fitted and
    those of the sheet, both divided by the true ones, and, for mass and stiffness of the workpiece,
    whether the interval of 95 % holds the truth, and how much wider it is than that of the machine
    of the model. `is_sampled`: True for intervals of the sampler, and False for those of the normal
    distribution at the most likely plant."""
    machine, beside, read, gain = nearly(seed)
    sheet, logs = sheet_of(machine, NEARLY, seed), []
    row = {"seed": seed, "bits": read.bits}
    for number, one in enumerate((beside, machine)):
        order = order_of(
            Path(folder) / str(number), sheet, read, touched(one, read, seed, gain), NEARLY
        )
        data, _ = contact_fit.read_recordings(order)
        problem = ContactProblem(order.model, data, contact_fit.prior_of(order), {}, 2)
        point, cost = contact_search.search(problem, 1)
        if number == 0:
            row["p_exact"] = contact_check.check(problem, point).p
            is_rejected = row["p_exact"] < REJECTED_BELOW
            if is_rejected:
                problem, point, _ = contact_error.with_drive(problem, point, cost, 1)
            found = contact_error.searched(problem, point, is_rejected, 1)
            problem, point = found.same, found.point
            row["p"] = contact_check.check(found.own, point).p
            sizes = contact_error.sizes_of(problem, point)
            drive = [name for name in problem.names if name not in NEARLY]
            row["drive"] = {
                name: (math.exp(point[problem.names.index(name)]) / getattr(beside, field),
                       getattr(machine, field) / getattr(beside, field))
                for name, (field, _, _) in PARAMETERS.items() if name in drive
            }  # fmt: skip
            row["errors"] = {kind: (size.share, size.size) for kind, size in sizes.items()}
        covariance = contact_search.covariance(problem, point)
        if is_sampled:
            sampled = contact_sampler.sample(problem, Drawn(point, covariance), 1)
            logs.append(np.quantile(sampled.points[:, :2], (0.025, 0.975), axis=0))
        else:
            logs.append(point[:2] + 1.96 * np.sqrt(np.diag(covariance))[:2] * [[-1], [1]])
    truth = np.log([machine.m_w, machine.k_w])
    row["inside"] = [bool(x) for x in (logs[0][0] <= truth) & (truth <= logs[0][1])]
    row["wider"] = (np.ptp(logs[0], axis=0) / np.ptp(logs[1], axis=0)).tolist()
    row["off"] = (logs[0].mean(axis=0) - truth).tolist()
    return row


if __name__ == "__main__":
    for seed in range(int(sys.argv[1])):
        with tempfile.TemporaryDirectory() as folder:
            row = nearly_identified(seed, folder, is_sampled="sampled" in sys.argv)
            print(json.dumps(row), flush=True)
