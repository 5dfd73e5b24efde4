"""Design advice: what limits the bandwidth of a force loop, and what each change of the axis buys.

For the explicit force law (p) around a model, its present design and one change at a time:

* critical gain, V/N and DAC codes per 8-bit count: `loops.Loop.limit`.
* loop gain: critical gain times the loop's gain at 0 Hz, without unit. The steady-state error at
  the limit is 1 / (1 + loop gain) of the step.
* loop gain at the present crossover: the same at the frequency that the present design crosses
  over at. A softer sensor, pad or workpiece raises the critical gain because it lowers the gain of
  the plant (5.1.3). At 0 Hz that does not show in these models, where a voltage stalls the drive at
  a force however soft the contact is; here it does.
* crossover: the lowest frequency at which |L| is 1 with the gain at the critical gain over
  GAIN_MARGIN, what a designer would set. It stands for the closed loop's bandwidth, and rows are
  ranked by it. None if that gain leaves |L| below 1 at 0 Hz.

The limiting mode is the one whose poles cross: the branch of the root locus that is on the
boundary at the critical gain, followed back to gain 0. If that branch starts at the rigid body or
the drive, it is the lowest noncolocated mode below LAG times the crossing, whose lag turns it
(6.1.3); if there is none, the lag of drive and sampling alone limits.

What is linear here is simulated by `simulated_limit`: firmware, quantisation, loss of contact.
"""

import contextlib
import math
import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tomlkit

from forceaxis import _core, paths, toml
from forceaxis._core import InputError
from forceaxis.linear import loops, modes
from forceaxis.linear import system as linear

GAIN_MARGIN = 2.0
LAG = 3.0  # noncolocated modes up to this many times the crossing turn the rigid body's roots
FACTOR = 2.0

# The thesis's two improvements (5.1.2, 5.2) and its sensor (Fig 4.26), SI.
SOFT_PAD, HARD_PAD, PAD_DAMPING, SENSOR_MASS = 25000.0, 120000.0, 30.0, 0.14
WORKPIECE_ZETA = 0.11
NO_PAD = 1e7  # Fig 4.24

# What counts as stable where the experiment does not say: as in contact.toml.
VERDICT = {"window_s": 1.0, "contact_held": True, "force_ripple_max_count": 10.0}

KINDS = {"N/m": "stiffness", "kg": "mass", "N s/m": "damping", "N m s/rad": "damping"}
HIGHEST_GAIN = loops.FIRMWARE_HIGHEST


@dataclass(frozen=True)
class Change:
    """One change of the design; what is empty stays as it is."""

    name: str
    kind: str  # stiffness, mass, damping, grip, sampling, converter, amplifier, control
    overrides: dict = field(default_factory=dict)  # model parameters
    edit: object = None  # a function that changes the parsed model file in place
    loop: dict = field(default_factory=dict)  # arguments of loops.force_loop
    firmware: dict = field(default_factory=dict)  # objects that the simulation needs
    simulated: bool = True  # whether the firmware and the simulator can run it
    thesis: str = ""  # where the thesis proposes it


class Design:
    """A model under its parameter values, with the experiment that simulates it.

    text: MODEL or EXPERIMENT as on the command line; `overrides` win over an experiment's [set].
    Use as a context: changed models are files in a folder that ends with it.
    """

    def __init__(self, text, overrides=None, timing=None):
        path = find(text)
        table = toml.read(path)
        if path.resolve() == (paths.EXPERIMENTS / "tables.toml").resolve():
            raise InputError(f"{path}: expected a model or an experiment, got the list of tables")
        self.experiment = path if "model" in table else None
        self.overrides = dict(overrides or {})
        if self.experiment:
            self.model = (path.parent / table["model"]).resolve()
            values = _core.inputs(str(path), linear.override_texts(self.overrides))["parameters"]
            named = table.get("set", {}) | self.overrides
            self.overrides = {name: values[name]["value"] for name in named}
        else:
            self.model = path.resolve()
            own = paths.EXPERIMENTS / f"{path.stem}.toml"
            named = toml.read(own).get("model") if own.exists() else None
            if named and (own.parent / named).resolve() == self.model:
                self.experiment = own
        settings = _core.inputs(str(self.experiment))["firmware"] if self.experiment else {}
        self.timing = timing or ("zoh+1" if settings.get("latency_ticks") == 1 else "zoh")
        self.present_gain = settings.get("force_gain")
        self.facts = linear.facts(self.model, self.overrides)
        self.overrides = {name: self.facts["parameters"][name][0] for name in self.overrides}
        self.table = toml.read(self.model)
        self._stack = contextlib.ExitStack()
        self._folder = None
        self._files = {}
        self._runs = {}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stack.close()

    def file(self, name, text):
        """A file with this text, for as long as the design is open."""
        if self._folder is None:
            self._folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
        path = self._folder / name
        path.write_text(text, encoding="utf-8")
        return path

    def changed_model(self, change):
        """The model's path under a change."""
        if change.edit is None:
            return self.model
        if change.name not in self._files:
            document = tomlkit.parse(self.model.read_text(encoding="utf-8-sig"))
            if "parameters_file" in document:
                document["parameters_file"] = str(
                    (self.model.parent / document["parameters_file"]).resolve()
                )
            change.edit(document)
            name = f"model_{len(self._files)}.toml"
            self._files[change.name] = self.file(name, tomlkit.dumps(document))
        return self._files[change.name]

    def loop(self, change=None):
        """The force loop, changed or not."""
        change = change or Change("", "")
        arguments = {"law": "p", "timing": self.timing} | change.loop
        overrides = self.overrides | change.overrides
        return loops.force_loop(self.changed_model(change), overrides=overrides, **arguments)

    def job(self, change=None, **sets):
        """(experiment, overrides) of a run with the firmware; sets: firmware objects."""
        change = change or Change("", "")
        model = self.changed_model(change)
        if model not in self._runs:
            self._runs[model] = self.run_file(model)
        experiment = self._runs[model]
        firmware = {"latency_ticks": 1 if self.timing == "zoh+1" else 0} | change.firmware | sets
        texts = [f"{n}={v!r}" for n, v in (self.overrides | change.overrides).items()]
        return str(experiment), texts + [f"firmware.{n}={v!r}" for n, v in firmware.items()]

    def run_file(self, model):
        """The experiment's file for a model: as it is, or with that model and a verdict."""
        if self.experiment is None:
            text = self.generated()
        else:
            text = tomlkit.parse(self.experiment.read_text(encoding="utf-8-sig"))
            if model == self.model and "verdict" in text:
                return self.experiment
        text["model"] = str(model)
        if "verdict" not in text:
            text["verdict"] = VERDICT
            text["duration_s"] = max(text["duration_s"], 4.0)
        return self.file(f"run_{len(self._runs)}.toml", tomlkit.dumps(text))

    def generated(self):
        """A first contact for a model without an experiment: that of contact.toml."""
        reading = next(a for a in self.table["adc"] if a["channel"] == 0)
        return {
            "title": f"Contact of {self.model.stem}",
            "model": "",
            "duration_s": 6.0,
            "firmware": {
                "mode": "force",
                "adc_bits": reading.get("bits", 8),
                "force_zero_code": reading.get("zero_code", 0),
                "force_gain": 1.0,
                "force_setpoint": 30.0,
                "bump_decay_shift": 0,
            },
            "verdict": VERDICT,
        }


def find(text):
    """The path of a model or experiment given as a path or as a stem; a model's goes first."""
    if Path(text).suffix != ".toml" and Path(text).parent == Path():
        for folder in (paths.MODELS, paths.EXPERIMENTS):
            if (folder / f"{text}.toml").exists():
                return folder / f"{text}.toml"
    return linear.find_model(text)


# --- what can be changed -------------------------------------------------------------------------


def roles(table):
    """{parameter: what it is}: "arm stiffness", "tip mass"."""
    found = {}
    for kind in ("body", "spring", "damper", "contact"):
        for element in table.get(kind, ()):
            for key in ("mass", "stiffness", "damping"):
                if isinstance(element.get(key), str):
                    found.setdefault(element[key], []).append(f"{element['name']} {key}")
    if isinstance(table.get("drive", {}).get("b_m"), str):
        found.setdefault(table["drive"]["b_m"], []).append("motor damping")
    return {name: ", ".join(uses) for name, uses in found.items()}


def scaled(design, factor):
    """Every stiffness, mass and damping that the model uses, times and over `factor`."""
    known = roles(design.table)
    changes = []
    for name, (value, unit) in design.facts["parameters"].items():
        if name not in known or unit not in KINDS or value == 0:
            continue
        for sign, new in (("x", value * factor), ("/", value / factor)):
            text = f"{known[name]} {name} {sign} {factor:g}"
            changes.append(Change(text, KINDS[unit], {name: new}))
    return changes


def contact_of(table):
    """The one contact that a force loop presses, or None."""
    contacts = table.get("contact", [])
    return contacts[0] if len(contacts) == 1 else None


def value_of(design, given):
    """A number of the model file: itself, or its parameter's value. None if it is neither."""
    if isinstance(given, str) and given[:1].isidentifier():
        return design.facts["parameters"].get(given, (None,))[0]
    if isinstance(given, str):
        return _core.quantity(given)
    return given if isinstance(given, int | float) else None


def pads(design):
    """Grip pads between sensor and workpiece (5.1): put in, exchanged, taken out."""
    contact = contact_of(design.table)
    reading = design.facts["reading"]
    if contact is None or value_of(design, contact.get("stiffness")) is None:
        return []
    sensor = reading["signal"].rpartition(".")[0]
    bodies = [b["name"] for b in design.table["body"]]

    def pad(stiffness):
        def edit(document):
            (old,) = document["contact"]
            if sensor == old["name"]:  # the sensor is where they touch: give it its mass
                near, far = old["between"]
                body = next(b for b in document["body"] if b["name"] == near)
                mass = {"name": "sensor_mass", "mass": SENSOR_MASS}
                mass |= {k: body[k] for k in ("position", "velocity") if k in body}
                document["body"].append(mass)
                spring = {"name": sensor, "between": [near, "sensor_mass"]}
                spring |= {k: old[k] for k in ("stiffness", "damping") if k in old}
                document.setdefault("spring", tomlkit.aot()).append(spring)
                old["name"], old["between"] = "pad", ["sensor_mass", far]
            old["stiffness"], old["damping"] = stiffness, PAD_DAMPING

        names = [contact.get(key) for key in ("stiffness", "damping")]
        if sensor != contact["name"] and all(isinstance(name, str) for name in names):
            return {"overrides": dict(zip(names, (stiffness, PAD_DAMPING), strict=True))}
        return {"edit": edit}

    if sensor == contact["name"]:
        names = [e["name"] for kind in ("spring", "damper") for e in design.table.get(kind, ())]
        if contact["between"][0] not in bodies or {"sensor_mass", "pad"} & {*bodies, *names}:
            return []
        rows = [(SOFT_PAD, "add", "5.1"), (HARD_PAD, "add", "5.1.2")]
    elif any(s["name"] == sensor for s in design.table.get("spring", ())):
        rows = [
            (SOFT_PAD, "exchange", "5.1"),
            (HARD_PAD, "exchange", "5.1.2"),
            (NO_PAD, "none", ""),
        ]
    else:
        return []
    return [
        Change(
            "no grip pad (10 MN/m)" if how == "none" else f"grip pad of {stiffness:,.0f} N/m",
            "grip", **pad(stiffness), thesis=thesis,
        )
        for stiffness, how, thesis in rows
    ]  # fmt: skip


def workpiece_damping(design):
    """The damper of 5.2: the workpiece's support at a damping ratio of WORKPIECE_ZETA."""
    contact = contact_of(design.table)
    if contact is None:
        return []
    workpiece = contact["between"][1]
    supports = [s for s in design.table.get("spring", ()) if workpiece in s["between"]]
    if workpiece not in design.facts["masses_kg"] or len(supports) != 1:
        return []
    stiffness = value_of(design, supports[0].get("stiffness"))
    if stiffness is None:
        return []
    mass = design.facts["masses_kg"][workpiece]
    damping = float(f"{2 * WORKPIECE_ZETA * math.sqrt(stiffness * mass):.3g}")
    old, name = supports[0].get("damping", 0.0), supports[0]["name"]
    given = value_of(design, old)
    if given is None:
        return []

    def edit(document):
        next(s for s in document["spring"] if s["name"] == name)["damping"] = damping

    label = f"workpiece damping {given:g} -> {damping:g} N s/m (zeta {WORKPIECE_ZETA:g})"
    if isinstance(old, str):
        return [Change(label, "damping", {old: damping}, thesis="5.2")]
    return [Change(label, "damping", edit=edit, thesis="5.2")]


def together(one, other):
    """Both changes at once: each edits other places of the model."""

    def edit(document):
        for change in (one, other):
            if change.edit is not None:
                change.edit(document)

    return Change(
        "both improvements: soft pad, damped workpiece", "grip", one.overrides | other.overrides,
        edit if one.edit or other.edit else None, thesis="5.1, 5.2",
    )  # fmt: skip


def sampling(design):
    """Sample rate, hold and delay."""
    rate = _core.TICKS_PER_SECOND
    rows = []
    if design.timing != "continuous":
        for text, factor in (("x 2", 2), ("/ 2", 0.5)):
            rows.append(
                Change(
                    f"sample rate {text} ({rate * factor:g} Hz)", "sampling",
                    loop={"tick_s": 1 / (rate * factor)}, simulated=False,
                )
            )  # fmt: skip
    names = {
        "continuous": "neither hold nor delay (continuous)",
        "zoh": "hold alone, no tick of delay" if design.timing == "zoh+1" else "hold of one tick",
        "zoh+1": "one tick more of delay" if design.timing == "zoh" else "hold and a tick of delay",
    }
    for timing in loops.TIMINGS:
        if timing != design.timing:
            firmware = {"latency_ticks": int(timing == "zoh+1")}
            rows.append(
                Change(
                    names[timing], "sampling", loop={"timing": timing},
                    firmware=firmware if timing != "continuous" else {},
                    simulated=timing != "continuous",
                )
            )  # fmt: skip
    return rows


def converter(design, bits=12):
    """A finer ADC with the same range (6.2.1). The linear limit does not see it."""
    if design.facts["reading"]["bits"] >= bits:
        return []
    shift = 2 ** (bits - design.facts["reading"]["bits"])
    overrides, literal, zero = {}, {}, 0
    for adc in design.table["adc"]:
        for key in ("per_count", "zero_code"):
            old = adc.get(key, 0)
            new = value_of(design, old) * (1 / shift if key == "per_count" else shift)
            if isinstance(old, str):
                overrides[old] = new
            else:
                literal[adc["channel"], key] = new if key == "per_count" else int(new)
            if key == "zero_code" and adc["channel"] == 0:
                zero = int(new)

    def edit(document):
        for adc in document["adc"]:
            adc["bits"] = bits
            for (channel, key), value in literal.items():
                if channel == adc["channel"]:
                    adc[key] = value

    return [
        Change(
            f"ADC of {bits} bits", "converter", overrides, edit,
            firmware={"adc_bits": bits, "force_zero_code": zero}, thesis="6.2.1",
        )
    ]  # fmt: skip


def amplifier(design):
    """The other slope of the amplifier (Fig 4.3)."""
    drive = design.table.get("drive", {})
    gain = value_of(design, drive.get("k_amp_outer"))
    if drive.get("type") != "dc_motor" or gain is None:
        return []
    inner = value_of(design, drive["k_amp"])
    return [
        Change(
            f"amplifier on its outer slope ({inner:g} -> {gain:g} V/V)", "amplifier",
            loop={"modes": {"drive.amplifier": "high outer"}}, simulated=False,
        )
    ]  # fmt: skip


def control(frequency_hz, sensor_rate):
    """Other laws (6.2.1), placed at the frequency at which the present loop turns unstable."""
    if not frequency_hz:
        return []
    span = 4.0
    derivative = 1 / (2 * math.pi * frequency_hz)
    rows = [
        Change(
            f"lead filter, {frequency_hz:.3g} to {span * frequency_hz:.3g} Hz", "control",
            loop={"law": "lead", "lead_zero_hz": frequency_hz, "lead_pole_hz": span * frequency_hz},
            simulated=False, thesis="6.2.1",
        ),
        Change(
            f"derivative by differences, T_d {derivative * 1e3:.3g} ms", "control",
            loop={"law": "pd", "derivative_s": derivative}, simulated=False, thesis="6.2.1",
        ),
    ]  # fmt: skip
    if sensor_rate:
        rows.append(
            Change(
                f"derivative from a velocity-sensing sensor, T_d {derivative * 1e3:.3g} ms",
                "control", loop={"law": "derivative", "derivative_s": derivative}, simulated=False,
                thesis="6.2.1",
            )
        )  # fmt: skip
    return rows


def changes(design, frequency_hz, factor=FACTOR):
    """All changes that the design allows."""
    rate = design.facts["reading"]["signal"].rpartition(".")[0] + ".spring_force_rate"
    pad, damping = pads(design), workpiece_damping(design)
    return [
        *pad,
        *damping,
        *(together(a, b) for a in pad[:1] for b in damping),
        *scaled(design, factor),
        *sampling(design),
        *converter(design),
        *amplifier(design),
        *control(frequency_hz, rate in design.facts["signals"]),
    ]


# --- what it buys --------------------------------------------------------------------------------


def performance(loop, reference_hz=None):
    """Of a loops.Loop: critical_gain, frequency_hz, firmware_gain, loop_gain, loop_gain_at,
    crossover_hz.

    loop_gain_at is that at reference_hz, by default the loop's own crossover. critical_gain None:
    stable at every gain; then there is no crossover either.
    """
    limit = loop.limit()
    zero = abs(loop.open.at(0.0 if loop.dt is None else 1.0))
    found = {
        "critical_gain": limit.gain,
        "frequency_hz": limit.frequency_hz,
        "firmware_gain": None,
        "loop_gain": None,
        "loop_gain_at": None,
        "crossover_hz": None,
    }
    if limit.gain:
        if loop.codes_per_gain is not None:
            found["firmware_gain"] = loop.firmware_gain(limit.gain)
        if np.isfinite(zero):
            found["loop_gain"] = float(zero * limit.gain)
        gain = limit.gain / GAIN_MARGIN
        if not np.isfinite(zero) or zero * gain > 1:
            crossovers = loop.margins(gain).crossovers
            found["crossover_hz"] = float(crossovers[0][0]) if crossovers else None
        reference_hz = reference_hz or found["crossover_hz"]
        if reference_hz:
            found["loop_gain_at"] = float(abs(loop.open.response(reference_hz)) * limit.gain)
    return found


def ratios(new, old):
    """What a change multiplies each number by; None where one of the two is none."""
    return {
        name: new[name] / old[name] if new[name] and old[name] else None
        for name in ("critical_gain", "loop_gain", "loop_gain_at", "crossover_hz")
    }


def strain(model, overrides, shape):
    """The element that holds most of a mode's elastic energy, or None."""
    signals = linear.facts(model, overrides)["signals"]
    elements = [n.removesuffix(".deflection") for n in signals if n.endswith(".deflection")]
    if not elements:
        return None
    outputs = [f"{e}.{q}" for e in elements for q in ("spring_force", "deflection")]
    body = next(iter(shape))
    system = linear.linearise(
        model, (f"{body}.force",), tuple(outputs), overrides=overrides, drive=False
    )
    x = np.array([shape.get(s.removesuffix(".position"), 0.0) if s.endswith(".position") else 0.0
                  for s in system.states])  # fmt: skip
    values = (system.C @ x).reshape(-1, 2)
    return elements[int(np.argmax(values[:, 0] * values[:, 1]))]


def limiting_mode(design, loop):
    """The mode that limits the gain, as the module's head defines it: a dictionary, or None.

    {"name", "element", "body", "frequency_hz", "damping_ratio", "label", "against_below", "how"};
    without a mode name is "none" and how says what limits instead. None if nothing limits.
    """
    limit = loop.limit()
    if not limit.gain or limit.frequency_hz is None:
        return None
    known = modes.modes(design.model, overrides=design.overrides)
    start = branch_start(loop, limit)
    crossing = flexible = None
    for mode in known["modes"]:
        pole = mode["driven"]
        if pole is None or mode["reference"]:
            continue
        here = complex(pole["real"], pole["imag"])
        if abs(start - here) < 0.02 * abs(here):
            crossing = mode
    if crossing is None:
        high = LAG * limit.frequency_hz
        flexible = next(
            (m for m in known["modes"]
             if m["label"] == "noncolocated" and m["frequency_hz"] < high), None
        )  # fmt: skip
    mode = crossing or flexible
    if mode is None:
        return {
            "name": "none",
            "how": "no mode: the lag of drive and sampling turns the rigid body",
        }
    body = max(mode["shape"], key=lambda b: abs(mode["shape"][b]))
    element = strain(design.model, design.overrides, mode["shape"])
    return {
        "name": f"{element} ({body})" if element else body,
        "element": element,
        "body": body,
        **{
            k: mode[k] for k in ("frequency_hz", "damping_ratio", "label", "against_below", "shape")
        },
        "how": "its poles cross" if crossing else "its lag turns the rigid body's poles",
    }


def next_crossing(loop):
    """{gain, frequency_hz} of the next pole that leaves above the limit, or None: what would limit
    if the first were cured."""
    limit = loop.limit()
    above = [c for c in limit.crossings if limit.gain and c.gain > limit.gain and c.direction > 0]
    return {"gain": above[0].gain, "frequency_hz": above[0].frequency_hz} if above else None


@np.errstate(divide="ignore", invalid="ignore")  # a branch from z = 0 starts at -infinity
def branch_start(loop, limit):
    """The open-loop pole, 1/s, from which the branch on the boundary at the limit starts."""
    gains = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 40) * limit.gain])
    branches = loop.locus(gains)
    target = 2j * math.pi * limit.frequency_hz
    return branches[0, int(np.nanargmin(np.abs(branches[-1] - target)))]


def rank(row):
    """Sorting key: no limit first, then by crossover, then by loop gain."""
    if row["critical_gain"] is None:
        return (-math.inf, 0.0)
    return (-(row["crossover_hz"] or 0.0), -(row["loop_gain"] or 0.0))


def advise(text, overrides=None, timing=None, factor=FACTOR, runs="present", threads=None):
    """The advice as `forceaxis advise --json` prints it.

    text: MODEL or EXPERIMENT; overrides {parameter: value}; timing: one of loops.TIMINGS, by
    default that of the experiment's firmware, else zoh. runs: what is simulated with the firmware:
    "none", "present" (the present design and the finer ADC, which linear analysis does not see) or
    "all" that the firmware can run. Raises InputError.
    """
    if not (math.isfinite(factor) and factor > 1):
        raise InputError(f"--factor: expected a number above 1, got {factor:g}")
    with Design(text, overrides, timing) as design:
        if design.facts["reading"] is None:
            raise InputError(
                f"{design.model}: adc: expected an ADC on channel 0 that reads a force, there is "
                "none"
            )
        loop = design.loop()
        base = performance(loop)
        made = changes(design, base["frequency_hz"], factor)
        rows = []
        for change in made:
            new = performance(design.loop(change), base["crossover_hz"])
            row = {"change": change.name, "kind": change.kind, "thesis": change.thesis or None}
            rows.append((row | new | {"ratio": ratios(new, base)}, change))
        rows.sort(key=lambda r: rank(r[0]))
        result = {
            "model": paths.display(design.model),
            "experiment": paths.display(design.experiment) if design.experiment else None,
            "title": design.facts["title"],
            "timing": design.timing,
            "unit": loop.unit,
            "gain_margin": GAIN_MARGIN,
            "factor": factor,
            "limiting_mode": limiting_mode(design, loop),
            "present": base,
            "next_crossing": next_crossing(loop),
            "reference_hz": base["crossover_hz"],
            "present_gain": design.present_gain,
            "rows": [row for row, _ in rows],
        }
        if runs != "none" and design.timing != "continuous":
            base["simulated"] = simulated_limit(design, None, base, threads)
            quiet = (base["simulated"]["stable_gain"] or 0) / GAIN_MARGIN
            for row, change in rows:
                wanted = change.simulated and (runs == "all" or change.kind == "converter")
                row["simulated"] = (
                    simulated_limit(design, change, row, threads, quiet) if wanted else None
                )
        return result


def simulated_limit(design, change, linear_figures, threads=None, quiet_gain=None):
    """Largest firmware gain up to which the verdict of the runs is stable.

    Of a row of gains up to 1.3 times the linear limit, the smallest stable one and the next that is
    not (smaller ones are passed over: so slow an approach does not settle in time); two finer rows
    between narrow it to a percent. Contact and limit cycle exist side by side below the linear
    limit, so the result holds for the experiment's own approach. Returns {"stable_gain" (None: no
    run is stable), "unstable_gain" (None: stable up to the end of the row), "of_limit", "runs",
    "ripple_count": force ripple, 8-bit counts, at quiet_gain or half the stable gain}.
    """
    limit = linear_figures["firmware_gain"]
    top = min(1.3 * limit if limit else HIGHEST_GAIN, HIGHEST_GAIN)
    shared = _core.Experiments()
    runs = 0

    def run(gains):
        nonlocal runs
        runs += len(gains)
        jobs = [design.job(change, force_gain=float(g)) for g in gains]
        outcomes = _core.run_many(jobs, threads or os.cpu_count() or 1, None, True, None, shared)
        for outcome in outcomes:
            if "error" in outcome:
                raise _core.SimulationError(outcome["error"])
        return outcomes

    def stable(gains):
        return [outcome["verdict"] == "stable" for outcome in run(gains)]

    gains = top * np.geomspace(0.01, 1.0, 20)
    verdicts = stable(gains)
    if True not in verdicts:
        return dict.fromkeys(("stable_gain", "unstable_gain", "of_limit", "ripple_count")) | {
            "runs": runs
        }
    start = verdicts.index(True)
    if False not in verdicts[start:]:
        low, high = gains[-1], None
    else:
        first = verdicts.index(False, start)
        low, high = gains[first - 1], gains[first]
        for _ in range(2):
            edges = np.linspace(low, high, 8)
            first = [*stable(edges[1:-1]), False].index(False)
            low, high = edges[first], edges[first + 1]
    (quiet,) = run([quiet_gain or low / GAIN_MARGIN])
    return {
        "stable_gain": float(low),
        "unstable_gain": None if high is None else float(high),
        "of_limit": float(low / limit) if limit else None,
        "runs": runs,
        "ripple_count": float(quiet["metrics"]["force_ripple_count"]),
    }


def describe(result):
    """The advice for a terminal."""

    def number(value, digits=3):
        return "-" if value is None else f"{value:.{digits}g}"

    def columns(row):
        ratio = row.get("ratio") or dict.fromkeys(
            ("critical_gain", "loop_gain_at", "crossover_hz"), 1
        )
        none = row["critical_gain"] is None
        return [
            "no limit" if none else f"{row['critical_gain']:.4f}",
            number(row["firmware_gain"]),
            number(ratio["critical_gain"]),
            number(row["frequency_hz"]),
            number(ratio["loop_gain_at"]),
            number(row["crossover_hz"]),
            number(ratio["crossover_hz"]),
            *simulated(row),
        ]

    def simulated(row):
        if not with_runs:
            return []
        found = row.get("simulated")
        if found is None:
            return ["", ""]
        if found["stable_gain"] is None:
            return ["none", ""]
        more = "> " if found["unstable_gain"] is None else ""
        return [f"{more}{found['stable_gain']:.3g}", number(found["ripple_count"])]

    rows, mode, base = result["rows"], result["limiting_mode"], result["present"]
    with_runs = "simulated" in base
    lines = [f"model        {result['title']}", f"timing       {result['timing']}"]
    if mode:
        what = mode["how"]
        if mode["name"] != "none":
            what = (
                f"{mode['name']}, {mode['label']}, {mode['frequency_hz']:.3g} Hz undamped: {what}"
            )
        lines.append(f"limited by   {what}")
    if base["critical_gain"] is None:
        lines.append("limit        none, stable at every gain")
    elif base["critical_gain"]:
        own = f" (k_f {base['firmware_gain']:.4g})" if base["firmware_gain"] else ""
        lines.append(
            f"limit        {base['critical_gain']:.4g} {result['unit']}{own} at "
            f"{base['frequency_hz']:.3g} Hz"
        )
    else:
        lines.append("limit        0, unstable at any small gain")
    if result["next_crossing"]:
        following = result["next_crossing"]
        lines.append(
            f"next         {following['gain']:.4g} {result['unit']}, another pole leaves at "
            f"{following['frequency_hz']:.3g} Hz"
        )
    if result["present_gain"] is not None:
        lines.append(f"force_gain   {result['present_gain']:g} in {result['experiment']}")
    if with_runs and base["simulated"]["of_limit"]:
        found = base["simulated"]
        lines.append(
            f"simulated    stable up to k_f {found['stable_gain']:.4g}, {found['of_limit']:.2f} of "
            f"the linear limit, with the firmware and loss of contact ({found['runs']} runs)"
        )
    head = ["V/N" if result["unit"] == "V/N" else result["unit"], "k_f", "x", "at Hz"]
    hz = number(result["reference_hz"])
    head += [f"x at {hz} Hz", "crossover Hz", "x", *(["run k_f", "ripple"] if with_runs else [])]
    table = [["", *head], ["present design", *columns(base)]]
    for row in rows:
        name = row["change"] + (f" [{row['thesis']}]" if row["thesis"] else "")
        table.append([name, *columns(row)])
    wide = [max(len(r[i]) for r in table) for i in range(len(head) + 1)]
    for r in table:
        cells = [r[0].ljust(wide[0]), *(c.rjust(w) for c, w in zip(r[1:], wide[1:], strict=True))]
        lines.append("  ".join(cells).rstrip())
    lines.append(
        f"k_f: DAC codes per 8-bit count; x: against the present design; x at {hz} Hz: loop gain "
        f"there at the limit; crossover: |L| = 1 with the gain at the limit / "
        f"{result['gain_margin']:g}"
        + ("; run k_f: simulated; ripple: its counts at half the present one" if with_runs else "")
    )
    return "\n".join(lines)
