"""Contents of a plant model: its bodies, signals, parameters, contacts, drive, sensor and
encoder."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from forceaxis import _core

# {parameter: value in SI units, or text with a unit}
Overrides = Mapping[str, float | str]


class ParameterFacts(NamedTuple):
    """A parameter of a model: the value in SI units, and the name of the SI unit."""

    value: float
    unit: str


@dataclass(frozen=True)
class StructureFacts:
    """A flexible structure of a model, given by n modes of vibration at its p ports. It has a name,
    the names of the ports, and the n modal masses in kg. `shapes`: displacements of the ports in
    each mode, an array (n, p)."""

    name: str
    ports: tuple[str, ...]
    modal_masses_kg: tuple[float, ...]
    shapes: tuple[tuple[float, ...], ...]

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the modal coordinates, in the order of the modes: "arm.1" and so on."""
        return tuple(f"{self.name}.{i + 1}" for i in range(len(self.shapes)))

    @property
    def apparent_kg(self) -> float:
        """Mass in kg of the first mode of vibration, at the port that this mode moves most."""
        most = max(map(abs, self.shapes[0]))
        return self.modal_masses_kg[0] / most**2 if most > 0 else 0.0


@dataclass(frozen=True)
class ContactFacts:
    """A contact of a model: the name of the contact, and the two bodies (or "ground") that touch
    each other."""

    name: str
    between: tuple[str, str]


class BusFacts(NamedTuple):
    """The timing of the bus between firmware and drive, in ticks of 1/1500 s: period of the frames,
    delay from the firmware to the drive, and delay from the encoder to the firmware."""

    cycle_ticks: int
    delay_ticks_out: int
    delay_ticks_in: int

    @property
    def is_immediate(self) -> bool:
        """True if the bus has one frame in each direction in every tick, and no frame is late."""
        return self == (1, 0, 0)

    def label(self) -> str:
        """Description of the bus for a user, such as "cycle 3 ticks, 3 out, 2 in"."""
        return (
            f"cycle {self.cycle_ticks} ticks, {self.delay_ticks_out} out, {self.delay_ticks_in} in"
        )


@dataclass(frozen=True)
class DriveFacts:
    """The drive of a model: type of the drive, body that the drive moves, reaction body ("ground"
    if there is none), parameters of the drive in SI units, and the bus to the drive."""

    type: str
    body: str
    reaction: str
    values: dict[str, float]
    bus: BusFacts

    @property
    def loop_text(self) -> str | None:
        """Text for a user with the gains of the velocity loop. It is None if the drive is not of
        the type velocity. If the model file states only a bandwidth, the gains are computed from
        it."""
        if self.type != "velocity":
            return None
        text = f"k_velocity {self.values['k_velocity']:.5g} N s/m"
        if time := self.values.get("integral_time"):
            text += f", integral_time {time:.5g} s"
        return text


class SamplingFacts(NamedTuple):
    """The sampling of a converter that has its own clock: their rate in Hz, time in s from tick 0
    to the first sample (None: not known), time in s from a sample to the firmware, and order of the
    converter's sinc filter (0: no filter)."""

    rate_hz: float
    phase_s: float | None
    latency_s: float
    sinc_order: int = 0

    def ages_s(self) -> tuple[float, float]:
        """Returns two times in s: the mean age of a reading, without the delay of the filter, and
        the width of the range of ages. The newest reading is as old as the latency. The oldest
        reading is older by one sampling period. If the clock of the sensor drifts, all ages between
        these two are equally frequent."""
        return self.latency_s + 0.5 / self.rate_hz, 1 / self.rate_hz

    @property
    def period_s(self) -> float:
        """Returns the time between two samples in s."""
        return 1 / self.rate_hz

    def delay_s(self) -> float:
        """Returns the largest time in s from a change of the signal to a reading that shows it: the
        mean delay of the filter, the latency and one period of the samples."""
        return self.latency_s + (1 + self.sinc_order / 2) / self.rate_hz

    def label(self) -> str:
        """Description of the samples for a user, such as "1000 Hz, sinc3, 2 ms late, any
        phase"."""
        text = f"{self.rate_hz:g} Hz, "
        text += f"sinc{self.sinc_order}, " if self.sinc_order else ""
        text += f"{1e3 * self.latency_s:g} ms late"
        return (
            f"{text}, any phase"
            if self.phase_s is None
            else f"{text}, phase {1e3 * self.phase_s:g} ms"
        )


@dataclass(frozen=True)
class SensorFacts:
    """The force sensor that the firmware reads. It has the measured signal, the size `per_count`
    of one 8-bit count in the unit of the signal (for an ADC of any resolution), and the resolution
    in bits of the codes that the firmware receives. Its samples are None if there is one in each
    tick without latency."""

    signal: str
    per_count: float
    bits: int
    sampling: SamplingFacts | None = None


@dataclass(frozen=True)
class EncoderFacts:
    """The encoder of a model: the body whose position is measured, the reference body, and the
    number of counts per metre (or per rad) with its sign."""

    body: str
    reference: str
    scale: float


@dataclass(frozen=True)
class PlantFacts:
    """Contents of one model with given parameter values: its bodies, signals, parameters and
    devices.

    `path`: path of the model file. `masses_kg`: mass of each body. `structures`: structures that
    the model gives by their modes of vibration. `signals`: {signal: unit}. `switches`: {element:
    its states} of each element with several states, such as {"sensor": ("apart", "pressed",
    "overlap")}.

    `drive`, `reading` and `encoder` are None if the model has no such device. `required_drive`,
    `required_reading` and `required_encoder` then raise InputError. `volts_per_code`: drive command
    of one DAC code in V. `volts_per_step`: drive command of one step of the DAC in V, which is
    smaller if the DAC has more than 12 bits.
    """

    path: str
    title: str
    masses_kg: dict[str, float]
    structures: tuple[StructureFacts, ...]
    signals: dict[str, str]
    parameters: dict[str, ParameterFacts]
    contacts: tuple[ContactFacts, ...]
    switches: dict[str, tuple[str, ...]]
    drive: DriveFacts | None
    reading: SensorFacts | None
    encoder: EncoderFacts | None
    volts_per_code: float
    volts_per_step: float

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points that elements may connect: the bodies and the ports of all
        structures."""
        return (*self.masses_kg, *(port for s in self.structures for port in s.ports))

    @property
    def coordinates_kg(self) -> dict[str, float]:
        """Masses in kg of the coordinates of the motion: the bodies and the modes of all
        structures."""
        modes = (
            pair
            for s in self.structures
            for pair in zip(s.coordinates, s.modal_masses_kg, strict=True)
        )
        return self.masses_kg | dict(modes)

    def dead_zone(self, force_gain: float) -> float:
        """Returns the force error, in the unit of ADC 0, below which a law outputs 0 because of
        rounding. The integral of the law is ignored. `force_gain`: gain of the law at rest in DAC
        codes per 8-bit count."""
        if not force_gain:
            return math.inf
        step = self.volts_per_step / self.volts_per_code
        return abs(0.5 * step / force_gain * self.required_reading.per_count)

    def dead_law(self, force_gain: float, setpoint: float) -> str | None:
        """Returns the reason why a law cannot reach a set-point: its dead zone is as large as the
        set-point. Returns None if the law can reach it. `force_gain` and the unit of `setpoint` are
        as in dead_zone()."""
        dead = self.dead_zone(force_gain)
        if dead < setpoint:
            return None
        unit = self.signals.get(self.required_reading.signal, "N")
        errors = (
            "every force error" if math.isinf(dead) else f"each force error below {dead:.4g} {unit}"
        )
        return (
            f"expected a force law whose dead zone is smaller than the set-point of {setpoint:.4g} "
            f"{unit}, got a gain of {force_gain:.4g} codes per 8-bit count, with which {errors} "
            "rounds to no command, apart from the integral; lower the speed of the drive at full "
            "command, or use an output of more bits or a larger set-point"
        )

    def displacements(self) -> np.ndarray:
        """Returns the displacements of p points for a unit of each of c coordinates, as an array
        (p, c)."""
        bodies = len(self.masses_kg)
        found = np.zeros((len(self.points), len(self.coordinates_kg)))
        found[:bodies, :bodies] = np.eye(bodies)
        row = column = bodies
        for structure in self.structures:
            shapes = np.array(structure.shapes)
            found[row : row + shapes.shape[1], column : column + shapes.shape[0]] = shapes.T
            row, column = row + shapes.shape[1], column + shapes.shape[0]
        return found

    def moving_kg(self, still: str | None = None) -> float:
        """Returns the mass in kg of all bodies and structures except the point `still`. The mass of
        a structure is the mass of its first mode at the port that this mode moves most."""
        bodies = sum(kg for body, kg in self.masses_kg.items() if body != still)
        return bodies + sum(s.apparent_kg for s in self.structures if still not in s.ports)

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
    def bus(self) -> BusFacts:
        """The bus to the drive. For a model without a drive, this is a bus without delay."""
        return self.drive.bus if self.drive else BusFacts(1, 0, 0)

    def expect_fresh_reading(self, purpose: str) -> None:
        """Raises InputError unless each sample of the force sensor reaches the firmware in its own
        tick. The error text names `purpose`, what the caller wants to do."""
        if self.reading and self.reading.sampling:
            raise _core.InputError(
                f"{self.path}: adc.sample_rate: expected an ADC that samples at each tick and "
                f"without latency for {purpose}, got "
                f"{self.reading.sampling.label()}; remove sample_rate, sample_phase, latency and "
                "converter_filter for this computation, and check its result with "
                "`run_experiment` of the complete model"
            )

    def expect_no_bus(self, purpose: str) -> None:
        """Raises InputError if the bus to the drive has a cycle or a delay. Also raises it in the
        cases of expect_fresh_reading(). The error text names `purpose`, what the caller wants to
        do."""
        self.expect_fresh_reading(purpose)
        if not self.bus.is_immediate:
            raise _core.InputError(
                f"{self.path}: drive.cycle_ticks: expected a bus cycle of 1 tick without delays "
                f"for {purpose}, got {self.bus.label()}; remove the keys of the bus "
                "for this computation, and check its result with `critical_gain` and "
                "`run_experiment` of the complete model"
            )

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


def _drive(table: "_core.DriveTable") -> DriveFacts:
    return DriveFacts(
        table["type"], table["body"], table["reaction"], table["values"], BusFacts(*table["bus"])
    )


def _sensor(table: "_core.ReadingTable") -> SensorFacts:
    sampling = table["sampling"] and SamplingFacts(*table["sampling"])
    return SensorFacts(table["signal"], table["per_count"], table["bits"], sampling)


def _structure(table: "_core.StructureTable") -> StructureFacts:
    shapes = tuple(map(tuple, table["shapes"]))
    return StructureFacts(table["name"], table["ports"], tuple(table["modal_masses_kg"]), shapes)


def read(path: str, overrides: Overrides | None = None) -> PlantFacts:
    """Returns the contents of the model file at `path`. Raises `_core.InputError` if the file is
    not a model."""
    table = _core.facts(path, dict(overrides or {}))
    return PlantFacts(
        path=path,
        title=table["title"],
        masses_kg=table["masses_kg"],
        structures=tuple(map(_structure, table["structures"])),
        signals=table["signals"],
        parameters={name: ParameterFacts(*given) for name, given in table["parameters"].items()},
        contacts=tuple(ContactFacts(**contact) for contact in table["contacts"]),
        switches=table["switches"],
        drive=table["drive"] and _drive(table["drive"]),
        reading=table["reading"] and _sensor(table["reading"]),
        encoder=table["encoder"] and EncoderFacts(**table["encoder"]),
        volts_per_code=table["volts_per_code"],
        volts_per_step=table["volts_per_step"],
    )
