"""Contents of a plant model: bodies, signals, parameters, contacts, drive, sensor and encoder."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from forceaxis import _core

T = TypeVar("T")
# Value of a property of a drive, a sensor or an encoder.
FactValue = str | float | dict[str, float]
# parameter values in SI units, or texts with a unit
Overrides = Mapping[str, float | str]


class ParameterFacts(NamedTuple):
    """A parameter of a model: the value in SI units, and the name of the SI unit."""

    value: float
    unit: str


@dataclass(frozen=True)
class ContactFacts:
    """A contact of a model: the name of the contact, and the two bodies (or "ground") that touch
    each other."""

    name: str
    between: tuple[str, str]


@dataclass(frozen=True)
class DriveFacts:
    """The drive of a model: type of the drive, body that the drive moves, reaction body ("ground"
    for none), and parameters of the drive in SI units."""

    type: str
    body: str
    reaction: str
    values: dict[str, float]


@dataclass(frozen=True)
class SensorFacts:
    """The force sensor that the firmware reads: measured signal, size of one 8-bit count in the
    unit of the signal (`per_count`, for an ADC of any resolution), and resolution of the ADC in
    bits."""

    signal: str
    per_count: float
    bits: int


@dataclass(frozen=True)
class EncoderFacts:
    """The encoder of a model: the body whose position is measured, the reference body, and the
    number of counts per metre (or per rad) with their sign."""

    body: str
    reference: str
    scale: float


@dataclass(frozen=True)
class PlantFacts:
    """Bodies, signals, parameters and devices of one model with given parameter values.

    `path` is the model's file. `masses_kg` has every body, `signals` the unit of every signal,
    `switches` the states of every element that has several ("sensor": ("apart", "pressed",
    "overlap")). `drive`, `reading` and `encoder` are None if the model has none; `required_drive`
    and so on then raise InputError. `volts_per_code` is the drive command of one DAC code in V.
    """

    path: str
    title: str
    masses_kg: dict[str, float]
    signals: dict[str, str]
    parameters: dict[str, ParameterFacts]
    contacts: tuple[ContactFacts, ...]
    switches: dict[str, tuple[str, ...]]
    drive: DriveFacts | None
    reading: SensorFacts | None
    encoder: EncoderFacts | None
    volts_per_code: float

    @property
    def required_drive(self) -> DriveFacts:
        """The drive of the model. Raises InputError if the model has no drive."""
        if self.drive is None:
            raise _core.InputError(
                f"{self.path}: expected a model with a [drive], got a model without a drive; "
                "choose another model"
            )
        return self.drive

    @property
    def required_reading(self) -> SensorFacts:
        """The sensor of the model. Raises InputError if the model has no sensor."""
        if self.reading is None:
            raise _core.InputError(
                f"{self.path}: expected a model with an [[adc]] of channel 0, got none; choose "
                "another model"
            )
        return self.reading

    @property
    def required_encoder(self) -> EncoderFacts:
        """The encoder of the model. Raises InputError if the model has no encoder."""
        if self.encoder is None:
            raise _core.InputError(
                f"{self.path}: expected a model with an [encoder], got a model without an "
                "encoder; choose another model"
            )
        return self.encoder


def _optional(kind: Callable[..., T], table: Mapping[str, FactValue] | None) -> T | None:
    return kind(**table) if table else None


def read(path: str, overrides: Overrides | None = None) -> PlantFacts:
    """Returns the contents of the model file at `path`. Raises `_core.InputError` if the file is
    not a model."""
    table = _core.facts(path, dict(overrides or {}))
    return PlantFacts(
        path=path,
        title=table["title"],
        masses_kg=table["masses_kg"],
        signals=table["signals"],
        parameters={name: ParameterFacts(*given) for name, given in table["parameters"].items()},
        contacts=tuple(ContactFacts(**contact) for contact in table["contacts"]),
        switches=table["switches"],
        drive=_optional(DriveFacts, table["drive"]),
        reading=_optional(SensorFacts, table["reading"]),
        encoder=_optional(EncoderFacts, table["encoder"]),
        volts_per_code=table["volts_per_code"],
    )
