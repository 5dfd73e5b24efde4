"""An axis as a design, which is a model with parameter values. The module also has the changes of
the model that `advise` compares."""

import contextlib
import functools
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import tomlkit

from forceaxis import _core, paths, toml
from forceaxis._core import InputError
from forceaxis.design import experiment_file, model_file
from forceaxis.design.experiment_file import ExperimentText
from forceaxis.design.model_file import Given, TableEdit
from forceaxis.linear import loops, settings, working
from forceaxis.linear import system as linear
from forceaxis.linear.bank import COEFFICIENT_MAX, Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_facts import Overrides
from forceaxis.linear.stability import Loop

FACTOR = 2.0  # factor by which `advise` multiplies and divides a parameter
# Stiffness in N/m of a soft and of a hard grip pad of the thesis, and their damping (5.1, 5.1.2).
# SENSOR_MASS is the mass in kg of the sensor of the thesis (Fig 4.26).
SOFT_PAD, HARD_PAD, PAD_DAMPING, SENSOR_MASS = 25000.0, 120000.0, 30.0, 0.14
# damping ratio of a workpiece with the damper of thesis section 5.2 in its support
WORKPIECE_ZETA = 0.11
NO_PAD = 1e7  # stiffness in N/m of a contact without a grip pad (Fig 4.24)
# table [verdict] for an experiment without a verdict; the values are those of contact.toml
VERDICT: dict[str, float | bool] = {
    "window_s": 1.0,
    "contact_held": True,
    "force_ripple_max_count": 10.0,
}
KIND_OF_UNIT = {"N/m": "stiffness", "kg": "mass", "N s/m": "damping", "N m s/rad": "damping"}


@dataclass(frozen=True)
class Change:
    """One change of a design. A field that has its default value changes nothing."""

    name: str = ""
    # Kind of the change: stiffness, mass, damping, grip, sampling, converter, amplifier or control.
    kind: str = ""
    # changed parameters: {parameter: SI value}
    overrides: Mapping[str, float] = field(default_factory=dict)
    edits: tuple[TableEdit, ...] = ()  # changes of the model file
    # Control law and delay of the loop. None selects the law p with the delay of the design.
    spec: LoopSpec | None = None
    # changed states of the model's elements: {element: state}
    states: Mapping[str, str] = field(default_factory=dict)
    # {firmware object: value} with the settings that a simulation of this change needs
    firmware: Mapping[str, int] = field(default_factory=dict)
    simulated: bool = True  # False if `advise --simulate` does not simulate this change
    in_firmware: bool = True  # False if firmware and simulator do not support this change
    thesis: str = ""  # section of the thesis that proposes this change


NO_CHANGE = Change()


class Design:
    """A model with parameter values, and the experiment that simulates this model.

    text: model or experiment, as a path or a name. overrides: {parameter: value}. These values take
    precedence over the table [set] of the experiment. timing: one of loops.TIMINGS. None selects
    the timing of the experiment. states: {element: state} in which the plant is linearised. All
    other elements have the states of `linear.working`. A Design is a context manager, because
    changed models are files in a temporary folder.
    """

    def __init__(
        self,
        text: str | Path,
        overrides: Overrides | None = None,
        timing: str | None = None,
        states: working.States | None = None,
    ) -> None:
        self.states = dict(states or {})
        given = settings.of(text, overrides, plant=True)
        self.model = Path(given.model).resolve()
        self.experiment = Path(given.experiment) if given.experiment else self._own_experiment()
        firmware = experiment_file.firmware_values(self.experiment)
        self.timing = timing or ("zoh+1" if firmware.get("latency_ticks") == 1 else "zoh")
        self.present_gain = firmware.get("force_gain")
        self.facts = linear.facts(self.model, given.overrides)
        used = self.facts.parameters
        self.overrides: dict[str, float | str] = {
            name: used[name].value if name in used else value
            for name, value in given.overrides.items()
        }
        self.tables = model_file.read(self.model)
        self._stack = contextlib.ExitStack()
        self._folder: Path | None = None
        self._files: dict[str, Path] = {}
        self._runs: dict[Path, Path] = {}

    def _own_experiment(self) -> Path | None:
        """Returns the experiment of the project that has the name of the model and runs the model.
        Returns None if there is no such experiment."""
        path = paths.EXPERIMENTS / f"{self.model.stem}.toml"
        model = toml.read(path).get("model") if path.exists() else None
        return path if model and (path.parent / model).resolve() == self.model else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        self._stack.close()

    def require_force_sensor(self) -> None:
        """Raises InputError if the model has no element [[adc]] on channel 0 that measures
        a force."""
        if self.facts.reading is None:
            raise InputError(
                f"{self.model}: adc: expected a model with an [[adc]] on channel 0 that reads a "
                "force, got none"
            )

    def value(self, given: Given | None) -> float | None:
        """Returns the value in SI units of an entry of the model file: a number, a quantity or the
        name of a parameter. Returns None if there is no entry or the parameter is unknown."""
        return working.number(given, self.facts.parameters)

    def noise_codes(self, bits: int) -> float | None:
        """Returns the rms noise of the measured force in codes of an ADC with `bits` bits. Returns
        None if the model states no noise."""
        noise_N = self.value(self.tables.force_adc.noise)
        per_code = abs(self.facts.required_reading.per_count) * 2.0 ** (8 - bits)
        return noise_N / per_code if noise_N else None

    @functools.cached_property
    def weight_N(self) -> float:
        """Returns the magnitude in N of the weight of all bodies along their axis."""
        total = 0.0
        for element in toml.read(self.model).get("gravity", []):
            body = self.tables.body(element["body"])
            mass = self.value(body.mass) if body else None
            total += (self.value(element["acceleration"]) or 0.0) * (mass or 0.0)
        return abs(total)

    @property
    def zero_code(self) -> int:
        """Returns the ADC code that the firmware receives at the force 0. Of a code with more than
        16 bits, the firmware receives the upper 16 bits."""
        adc = self.tables.force_adc
        code = int(self.value(adc.zero_code) or 0)
        return code >> (adc.bits - self.facts.required_reading.bits)

    def file(self, name: str, text: str) -> Path:
        """Writes a text to a temporary file and returns the path of the file. The file is deleted
        when the design is closed."""
        if self._folder is None:
            self._folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
        path = self._folder / name
        path.write_text(text, encoding="utf-8")
        return path

    def changed_model(self, change: Change) -> Path:
        """Returns the path of a model file that contains a change of the design."""
        if not change.edits:
            return self.model
        if change.name not in self._files:
            text = model_file.edited(self.model, change.edits)
            self._files[change.name] = self.file(f"model_{len(self._files)}.toml", text)
        return self._files[change.name]

    def loop(self, change: Change = NO_CHANGE) -> Loop:
        """Returns the force loop of the design with a change."""
        return (change.spec or LoopSpec(timing=self.timing)).around(
            self.changed_model(change),
            self.overrides | dict(change.overrides),
            self.states | dict(change.states),
        )

    def working(self) -> working.Working:
        """Returns the working point {element: state} at which the unchanged plant is linearised."""
        return working.working(self.model, self.overrides, self.states)

    def job(self, change: Change = NO_CHANGE, **sets: float) -> tuple[str, list[str]]:
        """Returns (experiment, list of texts NAME=VALUE) for a simulation of a changed design with
        the firmware. `sets`: {firmware object: value} for this simulation."""
        model = self.changed_model(change)
        if model not in self._runs:
            self._runs[model] = self.run_file(model)
        firmware = {"latency_ticks": int(self.timing == "zoh+1"), **change.firmware, **sets}
        texts = [f"{n}={v!r}" for n, v in (self.overrides | dict(change.overrides)).items()]
        return str(self._runs[model]), texts + [f"firmware.{n}={v!r}" for n, v in firmware.items()]

    def run_file(self, model: Path) -> Path:
        """Returns the path of an experiment that runs `model`. This is the experiment of the design
        if that experiment runs `model` and has a verdict; otherwise the function writes a new file.
        """
        text = (
            experiment_file.document(self.experiment) if self.experiment else self._first_contact()
        )
        if self.experiment and model == self.model and "verdict" in text:
            return self.experiment
        text["model"] = str(model)
        if "verdict" not in text:
            text["verdict"] = VERDICT
            text["duration_s"] = max(text["duration_s"], 4.0)
        return self.file(f"run_{len(self._runs)}.toml", tomlkit.dumps(text))

    def _first_contact(self) -> ExperimentText:
        """Returns the text of a first-contact experiment for a model that has no experiment."""
        return {
            "title": f"Contact of {self.model.stem}",
            "model": "",
            "duration_s": 6.0,
            "firmware": {
                "mode": "force",
                "adc_bits": self.facts.required_reading.bits,
                "force_zero_code": self.zero_code,
                "force_gain": 1.0,
                "force_setpoint": 30.0,
                "bump_decay_shift": 0,
            },
            "verdict": VERDICT,
        }


def roles(tables: model_file.ModelFile) -> dict[str, str]:
    """Returns {parameter: purpose of the parameter in the model}, such as {"k_rf": "arm
    stiffness"}."""
    uses = [(body.mass, f"{body.name} mass") for body in tables.bodies]
    for link in (*tables.springs, *tables.dampers, *tables.contacts):
        uses.append((link.stiffness, f"{link.name} stiffness"))
        uses.append((link.damping, f"{link.name} damping"))
    found: dict[str, str] = {}
    for given, use in (*uses, (tables.drive.b_m, "motor damping")):
        if isinstance(given, str):
            found[given] = f"{found[given]}, {use}" if given in found else use
    return found


def scaled(design: Design, factor: float) -> list[Change]:
    """Returns the changes in which one stiffness, mass or damping of the model is multiplied or
    divided by `factor`."""
    known = roles(design.tables)
    changes = []
    for name, (value, unit) in design.facts.parameters.items():
        if name not in known or unit not in KIND_OF_UNIT or value == 0:
            continue
        for sign, new in (("x", value * factor), ("/", value / factor)):
            text = f"{known[name]} {name} {sign} {factor:g}"
            changes.append(Change(text, KIND_OF_UNIT[unit], {name: new}))
    return changes


def pads(design: Design) -> list[Change]:
    """Returns the changes that insert, exchange or remove a grip pad between sensor and workpiece
    (thesis section 5.1)."""
    tables = design.tables
    contact = tables.contact
    if contact is None or design.value(contact.stiffness) is None:
        return []
    sensor = design.facts.required_reading.signal.rpartition(".")[0]
    if sensor == contact.name:
        names = {body.name for body in tables.bodies}
        names |= {link.name for link in (*tables.springs, *tables.dampers)}
        if tables.body(contact.between[0]) is None or {"sensor_mass", "pad"} & names:
            return []
    elif sensor not in [spring.name for spring in tables.springs]:
        return []
    rows = [
        (f"grip pad of {SOFT_PAD:,.0f} N/m", SOFT_PAD, "5.1"),
        (f"grip pad of {HARD_PAD:,.0f} N/m", HARD_PAD, "5.1.2"),
    ]
    if sensor != contact.name:
        rows.append(("no grip pad (10 MN/m)", NO_PAD, ""))
    return [
        Change(text, "grip", *_with_pad(tables, contact, stiffness, sensor), thesis=thesis)
        for text, stiffness, thesis in rows
    ]


def _with_pad(
    tables: model_file.ModelFile, contact: model_file.ModelLink, stiffness: float, sensor: str
) -> tuple[dict[str, float], tuple[TableEdit, ...]]:
    """Returns (parameters, edits of the model file) that give the contact the stiffness of a grip
    pad.

    If the contact is the force sensor itself, the sensor becomes a spring, and an additional body
    between sensor and pad gets the mass of the sensor.
    """
    values = {"stiffness": stiffness, "damping": PAD_DAMPING}
    names = contact.stiffness, contact.damping
    if sensor != contact.name:
        if isinstance(names[0], str) and isinstance(names[1], str):
            return {names[0]: stiffness, names[1]: PAD_DAMPING}, ()
        return {}, (TableEdit("contact", contact.name, values),)
    near, far = contact.between
    body = tables.body(near)
    motion = {"position": body.position, "velocity": body.velocity} if body else {}
    spring = {"stiffness": contact.stiffness, "damping": contact.damping}
    ends = ["sensor_mass", far]
    pad = "grip_pad" if contact.name == "pad" else "pad"
    return {}, (
        TableEdit("body", "sensor_mass", {"mass": SENSOR_MASS, **_present(motion)}),
        TableEdit("spring", sensor, {"between": [near, "sensor_mass"], **_present(spring)}),
        TableEdit("contact", contact.name, {**values, "name": pad, "between": ends}),
    )


def _present(values: Mapping[str, Given | None]) -> dict[str, Given]:
    """Returns the entries of `values` whose value is not None."""
    return {key: value for key, value in values.items() if value is not None}


def workpiece_damping(design: Design) -> list[Change]:
    """Returns the change in which a damper gives the support of the workpiece the damping ratio
    WORKPIECE_ZETA (thesis section 5.2). Returns no change if the workpiece has no support."""
    support, mass = design.tables.support, design.facts.masses_kg.get(design.tables.workpiece or "")
    if support is None or mass is None:
        return []
    stiffness, given = design.value(support.stiffness), design.value(support.damping or 0.0)
    if stiffness is None or given is None:
        return []
    damping = float(f"{2 * WORKPIECE_ZETA * math.sqrt(stiffness * mass):.3g}")
    label = f"workpiece damping {given:g} -> {damping:g} N s/m (zeta {WORKPIECE_ZETA:g})"
    if isinstance(support.damping, str):
        return [Change(label, "damping", {support.damping: damping}, thesis="5.2")]
    edit = TableEdit("spring", support.name, {"damping": damping})
    return [Change(label, "damping", edits=(edit,), thesis="5.2")]


def together(one: Change, other: Change) -> Change:
    """Returns one change that combines two changes of different tables of the model."""
    return Change(
        "both improvements: soft pad, damped workpiece", "grip",
        {**one.overrides, **other.overrides}, one.edits + other.edits, thesis="5.1, 5.2",
    )  # fmt: skip


def sampling(design: Design) -> list[Change]:
    """Returns the changes of the sampling rate, of the zero-order hold and of the latency. The loop
    of a drive on a bus, or with a converter that has a clock of its own, has to run once in each
    tick of 1/1500 s. For such a loop, only the latency changes."""
    rate_hz = _core.TICKS_PER_SECOND
    rows = []
    reading, bus = design.facts.required_reading, design.facts.bus
    in_ticks = not bus.is_immediate or reading.sampling is not None
    if design.timing != "continuous" and not in_ticks:
        for text, factor in (("x 2", 2), ("/ 2", 0.5)):
            rows.append(
                Change(
                    f"sample rate {text} ({rate_hz * factor:g} Hz)", "sampling",
                    spec=LoopSpec(timing=design.timing, tick_s=1 / (rate_hz * factor)),
                    in_firmware=False,
                )
            )  # fmt: skip
    names = {
        "continuous": "neither hold nor delay (continuous)",
        "zoh": "hold alone, no tick of delay" if design.timing == "zoh+1" else "hold of one tick",
        "zoh+1": "one tick more of delay" if design.timing == "zoh" else "hold and a tick of delay",
    }
    for timing in loops.TIMINGS:
        if timing != design.timing and not (in_ticks and timing == "continuous"):
            is_sampled = timing != "continuous"
            rows.append(
                Change(
                    names[timing], "sampling", spec=LoopSpec(timing=timing),
                    firmware={"latency_ticks": int(timing == "zoh+1")} if is_sampled else {},
                    in_firmware=is_sampled,
                )
            )  # fmt: skip
    return rows


def converter(design: Design, bits: int = 12) -> list[Change]:
    """Returns the change to an ADC with more bits and the same range (thesis section 6.2.1).

    Returns no change if the ADC already has `bits` bits. The linear critical gain does not depend
    on the number of bits.
    """
    return [resolution(design, bits)] if design.facts.required_reading.bits < bits else []


def resolution(design: Design, bits: int) -> Change:
    """Returns the change to an ADC of `bits` bits with the same range."""
    factor = 2 ** (bits - design.facts.required_reading.bits)
    overrides: dict[str, float] = {}
    edits = []
    for adc in design.tables.adcs:
        values: dict[str, float] = {"bits": bits}
        scales = (("per_count", adc.per_count, 1 / factor), ("zero_code", adc.zero_code, factor))
        for key, given, scale in scales:
            new = (design.value(given) or 0.0) * scale
            if isinstance(given, str):
                overrides[given] = new
            else:
                values[key] = new if key == "per_count" else int(new)
        edits.append(TableEdit("adc", adc.channel, values))
    zero = int((design.value(design.tables.force_adc.zero_code) or 0) * factor)
    return Change(
        f"ADC of {bits} bits", "converter", overrides, tuple(edits),
        firmware={"adc_bits": bits, "force_zero_code": zero}, thesis="6.2.1",
    )  # fmt: skip


def amplifier(design: Design) -> list[Change]:
    """Returns the change to the second linear range of the amplifier (Fig 4.3). Returns no change
    if the amplifier of the model has only one linear range."""
    drive = design.tables.drive
    gain, inner = design.value(drive.k_amp_outer), design.value(drive.k_amp)
    if drive.type != "dc_motor" or gain is None or inner is None:
        return []
    return [
        Change(
            f"amplifier on its outer slope ({inner:g} -> {gain:g} V/V)", "amplifier",
            states={"drive.amplifier": "high outer"}, simulated=False,
        )
    ]  # fmt: skip


def control(design: Design, frequency_hz: float | None) -> list[Change]:
    """Returns the changes to other control laws (thesis section 6.2.1). Most of these laws are
    filter banks. One law uses a velocity sensor, for which the firmware has no input.

    The laws add phase lead at `frequency_hz`, where the present loop becomes unstable.
    """
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
        banked(design, text, Bank(1.0, sections=(section,)), "6.2.1")
        for text, section in laws
        if max(map(abs, section)) <= COEFFICIENT_MAX
    ]
    reading = design.facts.required_reading
    sensor = reading.signal.rpartition(".")[0]
    if f"{sensor}.spring_force_rate" in design.facts.signals and reading.sampling is None:
        spec = LoopSpec("derivative", design.timing, parameters={"derivative_s": derivative})
        text = f"derivative from a velocity-sensing sensor, T_d {derivative * 1e3:.3g} ms"
        rows.append(Change(text, "control", spec=spec, in_firmware=False, thesis="6.2.1"))
    return rows


def lead_section(zero_hz: float, pole_hz: float) -> tuple[float, ...]:
    """Returns the lead filter (1 + s / w_z) / (1 + s / w_p) as a second-order section of a filter
    bank, by the bilinear transformation."""
    (az, bz), (ap, bp) = (
        (1 + 1 / (math.pi * hz * linear.TICK_S), 1 - 1 / (math.pi * hz * linear.TICK_S))
        for hz in (zero_hz, pole_hz)
    )
    return (az / ap, bz / ap, 0.0, bp / ap, 0.0)


def banked(design: Design, text: str, bank: Bank, thesis: str = "") -> Change:
    """Returns the change from the present control law to a filter bank of the firmware. `text` is
    the name of the change."""
    spec = LoopSpec("bank", design.timing, bank=bank)
    return Change(text, "control", spec=spec, simulated=False, thesis=thesis)


def changes(design: Design, frequency_hz: float | None, factor: float = FACTOR) -> list[Change]:
    """Returns all changes that are possible for the design."""
    pad, damping = pads(design), workpiece_damping(design)
    return [
        *pad,
        *damping,
        *(together(a, b) for a in pad[:1] for b in damping),
        *scaled(design, factor),
        *sampling(design),
        *converter(design),
        *amplifier(design),
        *control(design, frequency_hz),
    ]
