"""Random plants from generated TOML, each stepped by forceaxis and by hybrid_reference.py.

python tests/plant/random_models.py [--count 500] [--seed 1000] [--processes 2]

prints a line for each; exit status 1 if one differs. Both are run by one integer law until a
converted value lies within 1e-9 LSB of a code's edge, where rounding decides.
"""

import argparse
import collections
import multiprocessing
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from forceaxis import _core

sys.path.insert(0, str(Path(__file__).parent))
from hybrid_reference import Reference

TICKS = 80
EDGE_LSB = 1e-9


class Writer:
    """TOML of one model; draws what it needs."""

    def __init__(self, rng):
        self.rng = rng
        self.parts = []
        self.elements = collections.Counter()
        self.mass = {"ground": np.inf}

    def log(self, low, high):
        return float(low * (high / low) ** self.rng.random())

    def between(self, low, high):
        return float(self.rng.uniform(low, high))

    def chance(self, p):
        return bool(self.rng.random() < p)

    def pick(self, names):
        return names[self.rng.integers(len(names))]

    def pair(self):
        a, b = self.rng.choice(list(self.mass), 2, replace=False)
        return str(a), str(b)

    def reduced(self, a, b):
        return 1 / (1 / self.mass[a] + 1 / self.mass[b])

    def table(self, kind, **entries):
        def value(v):
            if isinstance(v, str):
                return f'"{v}"'
            if isinstance(v, (list, tuple)):
                return "[" + ", ".join(value(e) for e in v) + "]"
            return repr(v)

        head = f"[{kind}]" if kind in ("drive", "encoder", "dac") else f"[[{kind}]]"
        lines = [head] + [f"{k} = {value(v)}" for k, v in entries.items()]
        self.parts.append("\n".join(lines))
        self.elements[kind] += 1

    def rising(self, count, reach):
        """Breaks about 0, apart from each other and from 0."""
        while True:
            at = sorted(self.between(-reach, reach) for _ in range(count))
            if min(np.diff([*at, np.inf])) > reach / 20 and min(map(abs, at)) > reach / 20:
                return at


def random_model(seed, more=False, modal=False):
    """(TOML text, writer) of 3 to 12 bodies. Lengths are about 1 mm, rates below some 3e3 rad/s.

    more: also tables, solids and drives with current loops. modal: also structures given by their
    modes, and contacts with hysteresis.
    """
    w = Writer(np.random.default_rng(seed))
    count = int(w.rng.integers(3, 13))
    for i in range(count):
        mass = w.log(0.5, 40)
        weight = {"mass": mass}
        if more and w.chance(0.5):
            weight = {"mass": mass / 4, "inertia": [mass / 2 * 4e-6, mass / 4 * 1e-4],
                      "r_trans": [0.002, 0.01]}  # fmt: skip
        w.table("body", name=f"b{i}", **weight, position=w.between(-1e-3, 1e-3),
                velocity=w.between(-0.1, 0.1) if w.chance(0.8) else 0.0)  # fmt: skip
        w.mass[f"b{i}"] = mass

    def link(kind, a, b, rate, zeta):
        k = w.reduced(a, b) * rate**2
        return {"name": f"{kind}{w.elements[kind]}", "between": [a, b], "stiffness": k,
                "damping": 2 * zeta * w.reduced(a, b) * rate if w.chance(0.8) else 0.0}  # fmt: skip

    # A tree of springs to ground.
    names = ["ground"]
    for i in range(count):
        s = link("spring", f"b{i}", w.pick(names), w.log(30, 500), w.log(0.005, 0.1))
        if w.chance(0.3):
            segments = int(w.rng.integers(2, 5))
            s["stiffness"] = [s["stiffness"] * w.log(0.3, 3) for _ in range(segments)]
            s["breaks"] = w.rising(segments - 1, 1e-3)
            if w.chance(0.4):
                s["loads"] = [b * s["stiffness"][0] for b in s.pop("breaks")]
        w.table("spring", **s)
        names.append(f"b{i}")
    if modal:
        add_structures(w, names, link)
    for _ in range(w.rng.integers(1, 4)):
        w.table("contact", **link("contact", *w.pair(), w.log(200, 1500), w.log(0.01, 0.2)),
                gap=w.between(-2e-4, 1e-3))  # fmt: skip
    for _ in range(w.rng.integers(0, 3)):
        w.table("backlash", **link("backlash", *w.pair(), w.log(200, 1200), w.log(0.01, 0.2)),
                width=w.log(1e-4, 2e-3))  # fmt: skip
    for _ in range(w.rng.integers(0, 3)):
        s = link("stop", *w.pair(), w.log(200, 1500), w.log(0.01, 0.2))
        side = w.rng.integers(3)
        if side != 0:
            s["low"] = w.between(-1.5e-3, -3e-4)
        if side != 1:
            s["high"] = w.between(3e-4, 1.5e-3)
        w.table("stop", **s)
    for _ in range(w.rng.integers(0, 3)):
        a, b = w.pair()
        m = w.reduced(a, b)
        if w.chance(0.5):
            w.table("damper", name=f"damper{w.elements['damper']}", between=[a, b],
                    damping=m * w.log(1, 50))  # fmt: skip
        else:
            segments = int(w.rng.integers(2, 5))
            w.table("damper", name=f"damper{w.elements['damper']}", between=[a, b],
                    damping=[m * w.log(1, 100) for _ in range(segments)],
                    breaks=w.rising(segments - 1, 0.1))  # fmt: skip
    tied = {name: name for name in w.mass}  # by frictions: they must not form a loop

    def root(name):
        while tied[name] != name:
            name = tied[name]
        return name

    for _ in range(w.rng.integers(1, 4)):
        a, b = w.pair()
        if root(a) == root(b):
            continue
        tied[root(a)] = root(b)
        coulomb = w.reduced(a, b) * w.log(0.5, 20)
        s = {"name": f"friction{w.elements['friction']}", "between": [a, b], "coulomb": coulomb}
        if w.chance(0.6):
            s["stiction"] = coulomb * w.between(1.05, 1.8)
        w.table("friction", **s)
    for i in range(w.rng.integers(0, 3)):
        s = {"name": f"gravity{i}", "body": f"b{i}", "acceleration": w.between(-10, 10)}
        if w.chance(0.5):
            points = int(w.rng.integers(2, 5))
            s["acceleration"] = [w.between(-10, 10) for _ in range(points)]
            s["positions"] = w.rising(points, 1.5e-3)
        w.table("gravity", **s)
    if modal:
        add_hysteresis(w, link)
    if more:
        add_tables(w, count, link)
    signals = add_drive(w, count, MORE_KINDS if more else KINDS)
    axis = w.pick([n for n in w.mass if n[0] == "p"]) if modal else f"b{w.rng.integers(count)}"
    w.table("encoder", body=axis, scale=w.log(1e5, 1e6))
    if w.chance(0.3):
        bodies = w.rng.choice(count, 2, replace=False)
        w.parts.pop()
        w.table("encoder", body=f"b{bodies[0]}", reference=f"b{bodies[1]}", scale=w.log(1e5, 1e6))
    add_adcs(w, signals, more)
    if w.chance(0.3):
        w.table("dac", bits=int(w.rng.integers(10, 15)), range=w.pick([5.0, 10.0]),
                offset=w.between(-0.05, 0.05))  # fmt: skip
    return "\n".join(w.parts) + "\n", w


def add_structures(w, names, link):
    """Adds structures with a port that is tied to one of the points `names`."""
    for i in range(w.rng.integers(1, 3)):
        ports = [f"p{i}{k}" for k in range(w.rng.integers(1, 4))]
        w.table("structure", name=f"structure{i}", ports=ports)
        size, rates = w.log(0.5, 40), np.zeros(len(ports))
        for k in range(len(ports) + w.rng.integers(0, 3)):
            rigid = k == 0 and w.chance(0.5)
            mode = {"frequency": 0 if rigid else w.log(5, 200), "modal_mass": size * w.log(0.3, 3),
                    "shape": [w.between(-1, 1) for _ in ports]}  # fmt: skip
            if not rigid:
                mode["damping_ratio"] = w.log(0.002, 0.1)
            w.table("structure.mode", **mode)
            rates += np.square(mode["shape"]) / mode["modal_mass"]
        w.mass |= dict(zip(ports, map(float, 1 / rates), strict=True))
        tie = link("spring", ports[0], w.pick(names), w.log(30, 500), w.log(0.005, 0.1))
        w.table("spring", **tie)


def add_hysteresis(w, link):
    for i in range(w.rng.integers(1, 3)):
        s = link("contact", *w.pair(), w.log(200, 1500), 0.0)
        del s["damping"]
        s |= {"name": f"jenkins{i}", "gap": w.between(-2e-4, 5e-4),
              "hysteresis_stiffness": s["stiffness"] * w.log(0.3, 5),
              "hysteresis_force": s["stiffness"] * w.log(1e-6, 1e-4)}  # fmt: skip
        w.table("contact", **s)


KINDS = ["dc_motor", "dc_motor", "first_order", "perfect"]
MORE_KINDS = ["torque", "velocity", "stepper"]


def add_drive(w, count, kinds=KINDS):
    """Returns signals that an ADC may read, with their sizes."""
    body = f"b{w.rng.integers(count)}"
    drive = {"body": body}
    if w.chance(0.4):
        drive["reaction"] = w.pick([n for n in w.mass if n not in (body, "ground")])
    kind = w.pick(kinds)
    m = w.reduced(body, drive.get("reaction", "ground"))
    strength = m * w.log(5, 60)  # N at full command
    signals = [(f"{body}.acceleration", 20.0), (f"{body}.velocity", 0.2)]
    for name in ("contact0.spring_force", "contact0.force", "spring0.force"):
        signals.append((name, strength))
    signals.append(("spring0.spring_force_rate", 300 * strength))
    if kind == "dc_motor":
        r = 0.004 * w.log(1, 3)
        i = strength * r / 0.5  # A at full strength
        resistance = w.log(1, 6)
        k_amp = w.log(5, 20)
        k_current = w.between(0.2, 1.0) * 10 / max(i, 1.0)
        inductance = (resistance + k_amp * k_current) / w.log(300, 1500)
        drive |= {"k_preamp_cmd": w.between(1, 4), "k_preamp_fdbk": w.between(1, 4),
                  "a_preamp_fdbk": w.log(300, 1000), "k_tach": w.log(0.005, 0.04),
                  "k_torque": 0.5, "k_back_emf": w.log(0.05, 0.5), "L": inductance,
                  "R": resistance, "r_trans": r, "k_current": k_current,
                  "k_amp": k_amp}  # fmt: skip
        if w.chance(0.3):
            drive["b_m"] = m * r**2 * w.log(0.5, 10)
        if w.chance(0.6):
            drive["preamp_limit"] = w.between(2, 12)
        if w.chance(0.6):
            drive["current_feedback_limit"] = k_current * i * w.between(0.2, 1)
        if w.chance(0.7):
            drive |= {"amp_break": w.between(0.3, 3), "k_amp_outer": k_amp * w.between(0.2, 0.7)}
        if w.chance(0.7):
            drive["supply_limit"] = resistance * i * w.between(0.5, 3)
        signals += [("drive.current", i), ("drive.current_command", 10.0)]
    elif kind in ("torque", "velocity"):
        signals += add_motor(w, kind, drive, m, strength)
    elif kind == "stepper":
        step = w.log(1e-5, 2e-4)
        drive |= {"velocity_per_volt": w.log(3e-4, 3e-3), "holding_force": strength,
                  "full_step": step, "segments": w.pick([4, 8, 16])}  # fmt: skip
        if w.chance(0.6):
            drive["damping"] = m * w.log(5, 100)
        signals.append(("drive.load_angle", 4 * step))
    elif kind == "first_order":
        drive |= {"k_act": m * w.log(10, 100), "a_act": w.log(50, 500)}
        drive["velocity_per_volt"] = strength / 10 / drive["k_act"]
    else:
        drive["force_per_volt"] = strength / 10
    if kind in ("first_order", "perfect") and w.chance(0.6):
        drive["force_limit"] = strength * w.between(0.3, 0.9)
    w.table("drive", type=kind, **drive)
    return signals


def add_tables(w, count, link):
    """Adds elements that are tables, and standard linear solids."""
    for i in range(1):
        a, b = w.pair()
        period = w.log(3e-4, 3e-3)
        size = w.reduced(a, b) * w.log(2, 40)
        s = {"name": f"cogging{i}", "between": [a, b], "period": period, "from": -2e-3, "to": 2e-3}
        if w.chance(0.5):
            s |= {"force": size, "segments": int(w.rng.integers(4, 17))}
        else:
            s["force"] = [size * w.between(-1, 1) for _ in range(w.rng.integers(2, 9))]
        w.table("cogging", **s, position=w.between(-1e-3, 1e-3))
    for i in range(w.rng.integers(1, 3)):
        points = int(w.rng.integers(2, 6))
        body = f"b{w.rng.integers(count)}"
        at = np.sort(w.rng.uniform(0, TICKS / 1500, points)) + np.arange(points) * 1e-5
        w.table("external", name=f"external{i}", body=body, times=[float(t) for t in at],
                forces=[w.mass[body] * w.between(-20, 20) for _ in range(points)])  # fmt: skip
    for kind in ("contact", "contact", "spring"):
        s = link(kind, *w.pair(), w.log(200, 800), w.log(0.01, 0.2))
        s["name"] = f"solid{w.elements['solid']}"
        w.elements["solid"] += 1
        del s["damping"]
        s |= {
            "maxwell_stiffness": s["stiffness"] * w.log(0.3, 5),
            "maxwell_time": w.log(1e-3, 3e-2),
        }
        if kind == "contact":
            s["gap"] = w.between(-2e-4, 5e-4)
        w.table(kind, **s)
    for i in range(2):
        s = link("contact", *w.pair(), w.log(200, 1500), w.log(0.01, 0.2))
        segments = int(w.rng.integers(2, 5))
        s["stiffness"] = [s["stiffness"] * w.log(0.3, 3) for _ in range(segments)]
        s["breaks"] = [w.log(1e-5, 1e-4) * (k + 1) for k in range(segments - 1)]
        s["breaks"] = sorted(s["breaks"])
        w.table("contact", **s | {"name": f"hard{i}"}, gap=w.between(-2e-4, 5e-4))


def add_motor(w, kind, drive, m, strength):
    """Adds the keys of a torque or velocity drive; returns its signals with their sizes."""
    constant = w.log(10, 500)
    i = strength / constant
    drive["current_bandwidth"] = w.log(300, 4000)
    if w.chance(0.5):
        drive["k_force"] = constant
    else:
        drive |= {"r_trans": 0.002, "k_torque": 0.002 * constant}
    if w.chance(0.7):
        drive["peak_current"] = i * w.between(0.3, 1)
        if w.chance(0.7):
            drive |= {"rated_current": drive["peak_current"] * w.between(0.2, 0.8),
                      "peak_time": w.log(0.002, 0.02)}  # fmt: skip
    if kind == "torque":
        drive["current_per_volt"] = i / 10
        if w.chance(0.5):
            drive["damping"] = m * w.log(5, 100)
    else:
        drive |= {"k_velocity": m * w.log(20, 300), "integral_time": w.log(0.005, 0.1)}
        drive["velocity_per_volt"] = strength / 10 / drive["k_velocity"]
    return [("drive.current", i), ("drive.target_current", i)]


def add_adcs(w, signals, more):
    for channel in range(int(w.rng.integers(1, 3))):
        signal, size = w.pick(signals)
        bits = int(w.rng.integers(8, 13))
        s = {"channel": channel, "signal": signal, "per_count": 3 * size / 2**bits,
             "bits": bits, "zero_code": 2 ** (bits - 1)}  # fmt: skip
        if w.chance(0.3):
            s["sensor_limit"] = size * w.between(0.2, 1)
        if w.chance(0.4):
            s["filter"] = w.log(100, 2000)
        if w.chance(0.3):
            s["conditioning_limit"] = size * w.between(0.2, 1)
        if more and w.chance(0.5):
            s |= {"creep": w.between(-0.1, 0.1), "creep_time": w.log(0.01, 1)}
        if more and w.chance(0.5):
            s |= {"drift": size * w.between(-0.5, 0.5), "drift_time": w.log(0.01, 1)}
        w.table("adc", **s)


class Law:
    """Some integer law of the codes with a set-point that jumps; also impulses and coasting."""

    def __init__(self, seed, bits):
        rng = np.random.default_rng([seed, 1])
        self.top = 2 ** (bits - 1) - 1
        self.bits = bits
        self.force_gain = int(rng.integers(0, 16 * 256))
        self.zero = int(rng.integers(-64, 64))
        self.place_gain = int(rng.integers(0, 3 * 256))
        self.rate_gain = int(rng.integers(0, 2 * 256))
        self.period = int(rng.integers(17, 60))
        self.jump = int(rng.integers(0, self.top + 1))
        self.impulse_at = int(rng.integers(10, TICKS)) if rng.random() < 0.4 else -1
        self.impulse = float(rng.uniform(-0.1, 0.1))
        self.coast = range(0)
        if rng.random() < 0.25:
            at = int(rng.integers(20, TICKS - 20))
            self.coast = range(at, at + 20)
        self.last = None

    def __call__(self, tick, encoder, adc0, zero_code):
        last = encoder if self.last is None else self.last
        self.last = encoder
        aim = self.jump if tick // self.period % 2 else -self.jump // 2
        u = self.force_gain * (self.zero - (adc0 - zero_code)) - self.place_gain * encoder // 8
        u = (u - self.rate_gain * (encoder - last) + 128 >> 8) + aim
        return min(max(u, -self.top - 1), self.top)


@dataclass
class Outcome:
    seed: int
    bodies: int
    ticks: int = 0
    error: float = 0.0  # largest difference of a signal in units of its own size
    where: str = ""
    events: int = 0
    energy: float = 0.0  # residual per energy turned over
    at_edge: int = -1  # tick where the comparison ended at an edge
    failure: str = ""
    changes: collections.Counter = field(default_factory=collections.Counter)  # by element

    def agrees(self):
        return not self.failure and self.error <= 1e-7 and self.energy <= 1e-9

    def __str__(self):
        end = f", at an edge in tick {self.at_edge}" if self.at_edge >= 0 else ""
        return (
            f"seed {self.seed}: {self.bodies} bodies, {self.events} events, {self.ticks} ticks"
            f"{end}, differs by {self.error:.1e} ({self.where}), energy {self.energy:.1e}"
            + (f"; {self.failure}" if self.failure else "")
        )


def compare(seed, ticks=TICKS, more=False, modal=False):
    text, w = random_model(seed, more, modal)
    out = Outcome(seed, w.elements["body"])
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / f"model{seed}.toml"
        file.write_text(text)
        plant = _core.Plant(file, audit=True)
        reference = Reference(file)
    law = Law(seed, reference.model.get("dac", {}).get("bits", 12))
    zero = next((a["zero_code"] for a in reference.adcs if a["channel"] == 0), 0)
    names = plant.signal_names
    ours, theirs = [], []
    for tick in range(ticks + 1):
        *codes, margin = reference.codes()
        if margin < EDGE_LSB:
            out.at_edge = tick
            break
        if tuple(codes) != plant.codes():
            out.failure = (
                f"codes {plant.codes()} for {tuple(codes)} in tick {tick}, "
                f"{margin:.1e} LSB from an edge"
            )
            break
        if tick > 0:
            values = reference.signals()
            ours.append(plant.signals())
            theirs.append([values[n] for n in names])
        if tick == ticks:
            break
        if tick == law.impulse_at:
            struck = "p00" if modal else "b0"
            plant.apply_impulse(struck, law.impulse)
            reference.impulse(struck, law.impulse)
        code = law(tick, codes[0], codes[1], zero)
        enable = tick not in law.coast
        plant.step(code, enable)
        reference.step(code, enable)
        out.ticks = tick + 1
    out.events = len(reference.changes)
    out.changes = collections.Counter(
        name.rstrip("0123456789") for _, name, _, _ in reference.changes
    )
    if ours:
        ours, theirs = np.array(ours), np.array(theirs)
        size = np.abs(theirs).max(axis=0)
        # A signal that is nothing but rounding beside others of its kind has no size of its own.
        kind = [n.rsplit(".", 1)[1] for n in names]
        largest = {k: max(s for s, j in zip(size, kind, strict=True) if j == k) for k in kind}
        size = np.maximum(size, [1e-6 * largest[k] for k in kind])
        errors = np.abs(ours - theirs).max(axis=0) / np.where(size > 0, size, 1.0)
        out.error, out.where = float(errors.max()), names[int(errors.argmax())]
    energy = plant.energy()
    turned = energy.initial_J + sum(energy.dissipated_J.values()) + abs(energy.supplied_J)
    out.energy = abs(energy.residual_J) / turned
    return out


def compare_safely(seed, more=False, modal=False):
    try:
        return compare(seed, more=more, modal=modal)
    except Exception as error:
        return Outcome(seed, 0, failure=f"{type(error).__name__}: {error}")


def compare_many(seeds, processes):
    with multiprocessing.get_context("fork").Pool(processes) as pool:
        yield from pool.imap(compare_safely, seeds)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1000, help="of the first model")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    wrong = 0
    for outcome in compare_many(
        range(options.seed, options.seed + options.count), options.processes
    ):
        wrong += not outcome.agrees()
        print(outcome if outcome.agrees() else f"DIFFERS {outcome}", flush=True)
    print(f"{options.count} models, {wrong} differ")
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
