"""A design that can be changed: a model with its parameter values, and the changes for `advise`."""

import contextlib
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Self

import tomlkit

from forceaxis import _core, paths, toml
from forceaxis._core import InputError
from forceaxis.linear import loops, settings, working
from forceaxis.linear import system as linear
from forceaxis.linear.bank import COEFFICIENT_MAX, Bank
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.stability import Loop

FACTOR = 2.0

Table = Mapping[str, Any]  # the parsed tables of a model file
Edit = Callable[[Any], None]  # changes the parsed tables of a model file in place


# The two improvements of the thesis (5.1.2, 5.2) and its sensor (Fig 4.26), in SI units.
SOFT_PAD, HARD_PAD, PAD_DAMPING, SENSOR_MASS = 25000.0, 120000.0, 30.0, 0.14


WORKPIECE_ZETA = 0.11


NO_PAD = 1e7  # Fig 4.24


# The [verdict] for an experiment without one: that of contact.toml.
VERDICT = {"window_s": 1.0, "contact_held": True, "force_ripple_max_count": 10.0}


KINDS = {"N/m": "stiffness", "kg": "mass", "N s/m": "damping", "N m s/rad": "damping"}


@dataclass(frozen=True)
class Change:
    """One change of the design; an empty field changes nothing."""

    name: str
    kind: str  # stiffness, mass, damping, grip, sampling, converter, amplifier, control
    overrides: dict[str, float] = field(default_factory=dict)  # model parameters
    edit: Edit | None = None  # a function that changes the parsed model file in place
    loop: dict[str, Any] = field(default_factory=dict)  # fields of loops.LoopSpec
    states: dict[str, str] = field(default_factory=dict)  # {element: state}
    firmware: dict[str, int] = field(default_factory=dict)  # objects that the simulation needs
    simulated: bool = True  # False: not run by `advise --simulate`
    in_firmware: bool = True  # False: firmware and simulator do not support it
    thesis: str = ""  # section of the thesis that proposes it


class ModelBody(NamedTuple):
    """Name and position, as the model file gives it, of a body."""

    name: str
    position: float | str


def read_bodies(table: Mapping[str, Any]) -> list[ModelBody]:
    """The bodies of a model file."""
    return [ModelBody(body["name"], body.get("position", 0.0)) for body in table["body"]]


def read_firmware(experiment: Path | None) -> dict[str, Any]:
    """The firmware settings of an experiment as _core.inputs gives them; empty without one."""
    return dict(_core.inputs(str(experiment))["firmware"]) if experiment else {}


class Design:
    """A model with its parameter values, and the experiment that simulates it.

    text: MODEL or EXPERIMENT as on the command line; `overrides` take precedence over an
    experiment's [set]. states: {element: state} in which the plant is linearised; all other
    elements have the states of `linear.working`. Use as a context: changed models are files in a
    temporary folder.
    """

    def __init__(
        self,
        text: str | Path,
        overrides: Overrides | None = None,
        timing: str | None = None,
        states: working.States | None = None,
    ) -> None:
        self.states = dict(states or {})
        path = settings.find(text)
        table = toml.read(path)
        if path.resolve() == (paths.EXPERIMENTS / "tables.toml").resolve():
            raise InputError(f"{path}: expected a model or an experiment, got the list of tables")
        self.experiment = path if "model" in table else None
        self.overrides: dict[str, Any] = dict(overrides or {})  # __init__ ends with SI values
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
        firmware = read_firmware(self.experiment)
        self.timing = timing or ("zoh+1" if firmware.get("latency_ticks") == 1 else "zoh")
        self.present_gain = firmware.get("force_gain")
        self.facts = linear.facts(self.model, self.overrides)
        used = self.facts.parameters
        self.overrides = {n: used[n][0] if n in used else v for n, v in self.overrides.items()}
        self.table = toml.read(self.model)
        self._stack = contextlib.ExitStack()
        self._folder: Path | None = None
        self._files: dict[str, Path] = {}
        self._runs: dict[Path, Path] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def file(self, name: str, text: str) -> Path:
        """Writes a file with this text, which exists until the design is closed."""
        if self._folder is None:
            self._folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
        path = self._folder / name
        path.write_text(text, encoding="utf-8")
        return path

    def changed_model(self, change: Change) -> Path:
        """The path of the changed model."""
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

    def loop(self, change: Change | None = None) -> Loop:
        """The force loop, with a change or without one."""
        change = change or Change("", "")
        spec = loops.LoopSpec(**{"timing": self.timing} | change.loop)
        overrides = self.overrides | change.overrides
        states = self.states | change.states
        return spec.around(self.changed_model(change), overrides, states)

    def working(self) -> working.Working:
        """The working.Working mode of the unchanged plant."""
        return working.working(self.model, self.overrides, self.states)

    def job(self, change: Change | None = None, **sets: float) -> tuple[str, list[str]]:
        """(experiment, overrides) of a run with the firmware; sets: firmware objects."""
        change = change or Change("", "")
        model = self.changed_model(change)
        if model not in self._runs:
            self._runs[model] = self.run_file(model)
        experiment = self._runs[model]
        firmware = {"latency_ticks": 1 if self.timing == "zoh+1" else 0} | change.firmware | sets
        texts = [f"{n}={v!r}" for n, v in (self.overrides | change.overrides).items()]
        return str(experiment), texts + [f"firmware.{n}={v!r}" for n, v in firmware.items()]

    def run_file(self, model: Path) -> Path:
        """The path of an experiment for a model: the given file, or a file with that model and a
        verdict."""
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

    def generated(self) -> dict[str, Any]:
        """The text of a first contact for a model without an experiment, as in contact.toml."""
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


def roles(table: Table) -> dict[str, str]:
    """{parameter: its role}: "arm stiffness", "tip mass"."""
    found: dict[str, list[str]] = {}
    for kind in ("body", "spring", "damper", "contact"):
        for element in table.get(kind, ()):
            for key in ("mass", "stiffness", "damping"):
                if isinstance(element.get(key), str):
                    found.setdefault(element[key], []).append(f"{element['name']} {key}")
    if isinstance(table.get("drive", {}).get("b_m"), str):
        found.setdefault(table["drive"]["b_m"], []).append("motor damping")
    return {name: ", ".join(uses) for name, uses in found.items()}


def scaled(design: Design, factor: float) -> list[Change]:
    """Changes: each stiffness, mass and damping of the model multiplied and divided by `factor`."""
    known = roles(design.table)
    changes = []
    for name, (value, unit) in design.facts.parameters.items():
        if name not in known or unit not in KINDS or value == 0:
            continue
        for sign, new in (("x", value * factor), ("/", value / factor)):
            text = f"{known[name]} {name} {sign} {factor:g}"
            changes.append(Change(text, KINDS[unit], {name: new}))
    return changes


def contact_of(table: Table) -> dict[str, Any] | None:
    """The only contact of a model, on which the force loop presses; None if there is not exactly
    one."""
    contacts = table.get("contact", [])
    return contacts[0] if len(contacts) == 1 else None


def value_of(design: Design, given: float | str | None) -> float | None:
    """The value of a number or parameter in the model file; None for another type."""
    if isinstance(given, str) and given[:1].isidentifier():
        return design.facts.parameters.get(given, (None,))[0]
    if isinstance(given, str):
        return _core.quantity(given)
    return given if isinstance(given, int | float) else None


def pads(design: Design) -> list[Change]:
    """Changes: grip pads between sensor and workpiece (5.1) inserted, exchanged or removed."""
    contact = contact_of(design.table)
    if contact is None or value_of(design, contact.get("stiffness")) is None:
        return []
    sensor = design.facts.required_reading.signal.rpartition(".")[0]
    bodies = [b["name"] for b in design.table["body"]]

    def pad(stiffness: float) -> dict[str, Any]:
        def edit(document: Any) -> None:
            (old,) = document["contact"]
            # the contact itself is the sensor, so an additional body gets its mass
            if sensor == old["name"]:
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


def workpiece_damping(design: Design) -> list[Change]:
    """Change: the damper of 5.2, which gives the workpiece's support the damping ratio
    WORKPIECE_ZETA."""
    contact = contact_of(design.table)
    if contact is None:
        return []
    workpiece = contact["between"][1]
    supports = [s for s in design.table.get("spring", ()) if workpiece in s["between"]]
    if workpiece not in design.facts.masses_kg or len(supports) != 1:
        return []
    stiffness = value_of(design, supports[0].get("stiffness"))
    if stiffness is None:
        return []
    mass = design.facts.masses_kg[workpiece]
    damping = float(f"{2 * WORKPIECE_ZETA * math.sqrt(stiffness * mass):.3g}")
    old, name = supports[0].get("damping", 0.0), supports[0]["name"]
    given = value_of(design, old)
    if given is None:
        return []

    def edit(document: Any) -> None:
        next(s for s in document["spring"] if s["name"] == name)["damping"] = damping

    label = f"workpiece damping {given:g} -> {damping:g} N s/m (zeta {WORKPIECE_ZETA:g})"
    if isinstance(old, str):
        return [Change(label, "damping", {old: damping}, thesis="5.2")]
    return [Change(label, "damping", edit=edit, thesis="5.2")]


def together(one: Change, other: Change) -> Change:
    """A change that contains two changes; they edit different places of the model."""

    def edit(document: Any) -> None:
        for change in (one, other):
            if change.edit is not None:
                change.edit(document)

    return Change(
        "both improvements: soft pad, damped workpiece", "grip", one.overrides | other.overrides,
        edit if one.edit or other.edit else None, thesis="5.1, 5.2",
    )  # fmt: skip


def sampling(design: Design) -> list[Change]:
    """Changes of sample rate, hold and delay."""
    rate = _core.TICKS_PER_SECOND
    rows = []
    if design.timing != "continuous":
        for text, factor in (("x 2", 2), ("/ 2", 0.5)):
            rows.append(
                Change(
                    f"sample rate {text} ({rate * factor:g} Hz)", "sampling",
                    loop={"tick_s": 1 / (rate * factor)}, in_firmware=False,
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
                    in_firmware=timing != "continuous",
                )
            )  # fmt: skip
    return rows


def converter(design: Design, bits: int = 12) -> list[Change]:
    """Change: an ADC with more bits and the same range (6.2.1). The linear limit does not depend on
    it."""
    return [resolution(design, bits)] if design.facts.required_reading.bits < bits else []


def resolution(design: Design, bits: int) -> Change:
    """The design with an ADC of `bits` bits and the same range."""
    shift = 2 ** (bits - design.facts.required_reading.bits)
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

    def edit(document: Any) -> None:
        for adc in document["adc"]:
            adc["bits"] = bits
            for (channel, key), value in literal.items():
                if channel == adc["channel"]:
                    adc[key] = value

    return Change(
        f"ADC of {bits} bits", "converter", overrides, edit,
        firmware={"adc_bits": bits, "force_zero_code": zero}, thesis="6.2.1",
    )  # fmt: skip


def amplifier(design: Design) -> list[Change]:
    """Change: the other linear range of the amplifier (Fig 4.3)."""
    drive = design.table.get("drive", {})
    gain = value_of(design, drive.get("k_amp_outer"))
    if drive.get("type") != "dc_motor" or gain is None:
        return []
    inner = value_of(design, drive["k_amp"])
    return [
        Change(
            f"amplifier on its outer slope ({inner:g} -> {gain:g} V/V)", "amplifier",
            states={"drive.amplifier": "high outer"}, simulated=False,
        )
    ]  # fmt: skip


def control(frequency_hz: float | None, sensor_rate: bool) -> list[Change]:
    """Changes to other laws (6.2.1), placed at the frequency at which the present loop becomes
    unstable: laws of a firmware bank, and the derivative of a sensor for which the firmware has no
    input."""
    if not frequency_hz:
        return []
    span = 4.0
    derivative = 1 / (2 * math.pi * frequency_hz)
    share = derivative / linear.TICK_S
    laws = [
        (
            f"lead filter, {frequency_hz:.3g} to {span * frequency_hz:.3g} Hz",
            lead_section(frequency_hz, span * frequency_hz),
        ),
        (
            f"derivative by differences, T_d {derivative * 1e3:.3g} ms",
            (1 + share, -share, 0.0, 0.0, 0.0),
        ),
    ]
    rows = [
        banked(text, Bank(1.0, sections=(section,)), thesis="6.2.1")
        for text, section in laws
        if max(map(abs, section)) <= COEFFICIENT_MAX
    ]
    if sensor_rate:
        rows.append(
            Change(
                f"derivative from a velocity-sensing sensor, T_d {derivative * 1e3:.3g} ms",
                "control", loop={"law": "derivative", "parameters": {"derivative_s": derivative}},
                in_firmware=False, thesis="6.2.1",
            )
        )  # fmt: skip
    return rows


def lead_section(zero_hz: float, pole_hz: float) -> tuple[float, ...]:
    """(1 + s / w_z) / (1 + s / w_p), transformed bilinearly, as a second-order section of a
    bank."""
    (az, bz), (ap, bp) = (
        (1 + 1 / (math.pi * hz * linear.TICK_S), 1 - 1 / (math.pi * hz * linear.TICK_S))
        for hz in (zero_hz, pole_hz)
    )
    return (az / ap, bz / ap, 0.0, bp / ap, 0.0)


def banked(text: str, bank: Bank, thesis: str = "") -> Change:
    """The change from the present law to a bank of the firmware."""
    return Change(
        text, "control", loop={"law": "bank", "bank": bank}, simulated=False, thesis=thesis
    )


def changes(design: Design, frequency_hz: float | None, factor: float = FACTOR) -> list[Change]:
    """All changes that are possible for the design."""
    rate = design.facts.required_reading.signal.rpartition(".")[0] + ".spring_force_rate"
    pad, damping = pads(design), workpiece_damping(design)
    return [
        *pad,
        *damping,
        *(together(a, b) for a in pad[:1] for b in damping),
        *scaled(design, factor),
        *sampling(design),
        *converter(design),
        *amplifier(design),
        *control(frequency_hz, rate in design.facts.signals),
    ]
