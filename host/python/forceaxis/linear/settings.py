"""The plant of a model or an experiment, and the force loop that the firmware of an experiment
closes. The analysis uses the experiment's model, its table [set], and the initial values of its
table [firmware] as the firmware stores them: control law, filter bank, gain, latency. Values that
the experiment writes later, in its tables [[at]], are ignored."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from forceaxis import _core, objects, paths, toml
from forceaxis.linear import bank as banks
from forceaxis.linear import system as linear
from forceaxis.linear.plant_facts import Overrides, PlantFacts

Firmware = Mapping[str, float]  # initial values of firmware objects in an experiment

MODES_OF_OPERATION = objects.BY_NAME["modes_of_operation"]
NATIVE_MODES = objects.BY_NAME["mode"].enum
NATIVE_FORCE = 3  # value of the object `mode` that selects the force law
# Control law for each value of `modes_of_operation` that selects a mode with force control.
FORCE_MODES = {4: "p", 10: "p", -1: "p", -6: "stiffness", -7: "damping", -8: "impedance"}


@dataclass(frozen=True)
class ExperimentInputs:
    """The initial conditions of an experiment: path of the model, {parameter of the model: SI
    value}, and {firmware object: initial value}."""

    model: str
    parameters: dict[str, float]
    firmware: Firmware


def read_inputs(path: str, texts: Sequence[str]) -> ExperimentInputs:
    """Returns path of the model, parameter values and firmware values of an experiment. `path`: the
    experiment file. Texts NAME=VALUE replace values of the file. Raises InputError."""
    own = _core.inputs(path, texts)
    parameters = {name: given["value"] for name, given in own["parameters"].items()}
    return ExperimentInputs(str(own["model"]), parameters, own["firmware"])


@dataclass(frozen=True, kw_only=True)
class FirmwareLaw:
    """The control law of the firmware. law: a key of `loops.LAWS`. bank: the filter bank, or None.
    force_gain: gain of a law without filter bank in DAC codes per 8-bit count, or None. parameters:
    parameters of the laws stiffness, damping and impedance in SI units. late_motion: as in
    LoopSpec."""

    law: str = "p"
    bank: banks.Bank | None = None
    force_gain: float | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    late_motion: bool = False

    @property
    def firmware_gain(self) -> float | None:
        """The active gain of the firmware in DAC codes per 8-bit count. It is None for a model, or
        if no gain is given."""
        return self.bank.force_gain if self.bank else self.force_gain


@dataclass(frozen=True)
class ModelSettings(FirmwareLaw):
    """The plant of a force loop. If the plant comes from an experiment, the settings also have the
    control law of its firmware."""

    model: str
    overrides: dict[str, float | str]  # {parameter: SI value, or text with a unit}
    experiment: str | None = None
    timing: str = "zoh"
    texts: tuple[str, ...] = ()  # overrides of the experiment as texts NAME=VALUE


def find(text: str | Path) -> Path:
    """Returns the path of a model or experiment, from a path or from a file name without suffix. If
    a model and an experiment have the same name, returns the path of the model."""
    if Path(text).suffix != ".toml" and Path(text).parent == Path():
        for folder in (paths.MODELS, paths.EXPERIMENTS):
            if (folder / f"{text}.toml").exists():
                return folder / f"{text}.toml"
    return linear.find_model(text)


def is_experiment(table: Container[str]) -> bool:
    """Returns True if `table`, the content of a file, belongs to an experiment: a file that names a
    model and a run."""
    return "model" in table and "duration_s" in table


def of(text: str | Path, overrides: Overrides | None = None, plant: bool = False) -> ModelSettings:
    """Returns the ModelSettings of a model or experiment. `text`: its path, or its file name
    without suffix. `overrides`: {parameter: value}, for an experiment also firmware.NAME. `plant`:
    True if only the plant is needed. Raises InputError for a wrong file or value. Unless `plant` is
    True, also raises it for an experiment without a force law."""
    given = dict(overrides or {})
    path = find(text)
    if path.resolve() == (paths.EXPERIMENTS / "tables.toml").resolve():
        raise _core.InputError(
            f"{path}: expected a model or an experiment, got the file that lists the tables of "
            "the thesis; choose another file"
        )
    table = toml.read(path)
    if not is_experiment(table):
        return ModelSettings(str(path), given)
    texts = linear.override_texts(given)
    own = read_inputs(str(path), texts)
    model, firmware = own.model, own.firmware
    named: dict[str, float | str] = {
        n: own.parameters[n] for n in table.get("set", {}) | given if n in own.parameters
    }
    if plant:
        return ModelSettings(model, named, str(path), texts=tuple(texts))
    law, bank = _law(path, firmware), _bank(path, firmware)
    return ModelSettings(
        model, named, str(path), law="bank" if bank and law == "p" else law, bank=bank,
        force_gain=firmware.get("force_gain") or None,
        timing="zoh+1" if firmware.get("latency_ticks") == 1 else "zoh",
        parameters=_parameters(path, law, firmware, linear.facts(model, named)), texts=tuple(texts),
        late_motion=True,
    )  # fmt: skip


def _law(path: Path, firmware: Firmware) -> str:
    """Returns the control law of the mode of operation with which the firmware starts."""
    drive = int(firmware.get("modes_of_operation", 0))
    if drive in FORCE_MODES:
        return FORCE_MODES[drive]
    native = int(firmware.get("mode", 0))
    if drive == 0 and native == NATIVE_FORCE:
        return "p"
    name = dict(MODES_OF_OPERATION.values)[drive] if drive else NATIVE_MODES[native]
    raise _core.InputError(
        f"{path}: firmware: expected an experiment whose mode of operation controls the force, "
        f"got the mode {name}; give another experiment, or give only the model of this experiment"
    )


def _bank(path: Path, firmware: Firmware) -> banks.Bank | None:
    """Returns the filter bank that the experiment selects, or None."""
    try:
        return banks.of_settings(firmware)
    except KeyError:
        number = int(firmware["force_bank"])
        raise _core.InputError(
            f"{path}: firmware: expected the values of the filter bank bank_{number}, because "
            f"force_bank is {number}"
        ) from None


def _parameters(path: Path, law: str, firmware: Firmware, known: PlantFacts) -> dict[str, float]:
    """Returns the parameters of the control laws stiffness, damping and impedance in SI units."""
    if law not in ("stiffness", "damping", "impedance"):
        return {}
    if known.reading is None or known.encoder is None:
        raise _core.InputError(
            f"{path}: model: expected a model with an ADC on channel 0 and an encoder, because "
            f"the law {law} needs both"
        )
    scale = abs(known.required_reading.per_count * known.required_encoder.scale)
    found = {}
    if law != "damping":
        found["stiffness_N_per_m"] = firmware.get("stiffness", 0.0) * scale
    if law != "stiffness":
        found["damping_Ns_per_m"] = firmware.get("damping", 0.0) * scale * linear.TICK_S
    return found
