"""Reads an incident from the black box of an axis, writes the incident to a file, and reads
incident files.

An incident file is one JSON document. It contains the file version, the state of the axis, its
parameters, the recorded samples, and the CRC-32 that the axis has computed from these samples.
"""

import dataclasses
import datetime
import json
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Recording, Refused
from forceaxis.axis.values import object_names
from forceaxis.bus.client import from_raw
from forceaxis.objects import BY_NAME, OBJECTS, OBJECTS_HASH, STATUS_STATES
from forceaxis.recordings.source import Source, array_source
from forceaxis.results import from_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Samples = NDArray[np.float64]

VERSION = 1
#: signals that the black box records in each tick (firmware/app/incident.c)
SIGNALS = (
    "position", "profile_position", "force_raw", "force_demand", "dac_code", "statusword",
    "limit_reason", "digital_inputs",
)  # fmt: skip
STRUCT_FORMATS = {"u8": "B", "u16": "H", "i16": "h", "i32": "i"}
INCIDENT_STATES = ("incident", "incident_kept")
# Longest time in s until the axis has completed the recording of an incident and its CRC.
COMPLETE_TIMEOUT_S = 5.0
FULL_SCALE_BITS = 8  # number of bits of an ADC whose codes are force counts
NEAR_MS = 100  # time in ms before and after the error that the second column of the plot shows


@dataclass(frozen=True)
class ForceParameters:
    """Parameters of the axis that concern the measured force. Forces are in 8-bit counts.
    `force_scale` is in uN per count, `rated_force` in mN. `force_max` is 0 if there is no limit."""

    adc_bits: int
    force_zero_code: int
    force_sign: int
    force_tare: float
    force_scale: int
    force_max: float
    rated_force: int
    contact_force: float

    @property
    def count_N(self) -> float:
        """Returns the force in N of one 8-bit count."""
        return self.force_scale * 1e-6


@dataclass(frozen=True, kw_only=True)
class IncidentAbout:
    """Data about an error, in addition to the recorded samples. `parameters`: {object: raw value}
    at the time when the incident was read from the axis."""

    where: str
    fetched: str  #: date and time at which the incident was read from the axis, by ISO 8601
    fault: str
    error_code: str
    tick: int
    later: int  #: number of further errors after this one
    kept: bool  #: True if the incident is older than the last restart of the axis
    table: str  #: hash of the object table of the axis
    parameters: dict[str, int]
    archived: bool = False  #: True if a power cut occurred after the incident


@dataclass(frozen=True)
class Incident(IncidentAbout):
    """The recording of an error, and the state of the axis."""

    recording: Recording

    @property
    def force(self) -> ForceParameters:
        """The parameters that concern the measured force."""
        names = object_names(ForceParameters)
        values = {name: from_raw(name, self.parameters[name]) for name in names}
        return from_json(ForceParameters, values, self.where)

    def column(self, name: str) -> NDArray[np.int64]:
        """Returns the raw samples of a signal."""
        return self.recording.raw[:, self.recording.signals.index(name)]

    @property
    def time_ms(self) -> Samples:
        """Returns the time of each sample in ms from the tick of the error."""
        return self.recording.time_s * 1e3

    @property
    def force_N(self) -> Samples:
        """Returns the measured force in N for each sample. Zero code, sign and tare are taken into
        account."""
        p = self.force
        scale = 2.0 ** (FULL_SCALE_BITS - p.adc_bits)
        counts = (self.column("force_raw") - p.force_zero_code) * scale * p.force_sign
        return np.asarray((counts - p.force_tare) * p.force_scale * 1e-6)

    @property
    def travel(self) -> Samples:
        """Returns the position of each sample in encoder counts, relative to the position at the
        error. An overflow of the encoder count causes no step."""
        steps = np.diff(self.column("position"))
        way = np.concatenate([[0], np.cumsum((steps + 2**31) % 2**32 - 2**31)])
        return np.asarray(way - way[self.recording.trigger_sample])


def has_one(axis: Axis) -> bool:
    """Returns True if the black box of an axis contains an incident."""
    return axis.read("blackbox_state") in INCIDENT_STATES


@dataclass(frozen=True)
class BlackBoxObjects:
    """State of the black box of an axis. The objects are valid with and without a fault."""

    blackbox_state: str
    fault: str


@dataclass(frozen=True)
class ArchiveObjects:
    """The object that shows whether the axis has saved an incident before a power cut. The object
    is valid with and without a present fault."""

    incident_stored: str
    fault: str


@dataclass(frozen=True)
class IncidentObjects:
    """Objects about the incident in the black box: fault, CANopen error code, tick, number of
    further errors, and CRC-32 of the samples."""

    incident_fault: str
    incident_error_code: str | int
    incident_tick: int
    incident_later: int
    incident_crc: int


def wait(axis: Axis, seconds: float) -> None:
    """Waits until the black box contains an incident. Raises NoAnswer after `seconds` by the clock
    of the axis."""
    axis.wait_for(
        BlackBoxObjects, lambda s: s.blackbox_state in INCIDENT_STATES, "an incident", seconds
    )


def _load(axis: Axis) -> bool:
    """Lets the axis load an incident that it has saved before a power cut. Returns True if there is
    such an incident."""
    found = axis.wait_for(
        ArchiveObjects, lambda s: s.incident_stored != "checking", "its archive", 5.0
    )
    if found.incident_stored != "stored":
        return False
    axis.set(incident_command="load")
    wait(axis, COMPLETE_TIMEOUT_S)
    return True


# Objects about the last restart of the board and about faults of the board.
BOARD_OBJECTS = (
    *("reset_cause", "board_state", "tick_deviation"),
    *(f"core_fault_{word}" for word in ("pc", "lr", "cfsr", "hfsr", "bfar")),
)


def fetch(axis: Axis) -> Incident:
    """Reads the incident of an axis that this program owns. If the black box contains no incident,
    reads the incident that was saved before a power cut. Raises Refused if there is no incident,
    and NoAnswer."""
    if axis.read("blackbox_state") == "completing":
        wait(axis, COMPLETE_TIMEOUT_S)
    state = axis.text("blackbox_state")
    archived = state in ("off", "recording") and _load(axis)
    if archived:
        state = "incident_kept"
    if state not in INCIDENT_STATES:
        why = {
            "off": "its black box is off (blackbox_option)",
            "recorder": "a recording uses its memory; write 0 to recorder_arm",
        }.get(state, "nothing has happened since its black box started to record")
        raise Refused(f"{axis.link.where}: expected an incident, {why}")
    about = axis.record(IncidentObjects)
    axis.link.fetch(SIGNALS)
    recording = axis.link.recording(COMPLETE_TIMEOUT_S)
    if zlib.crc32(packed(recording)) != about.incident_crc:
        raise NoAnswer(
            f"{axis.link.where}: expected samples with a correct CRC; read the incident again"
        )
    parameters = axis.link.read(
        [o.name for o in OBJECTS if o.kind == "parameter" and o.access == "rw" and o.stored]
        + ["modes_of_operation", "force_setpoint", *BOARD_OBJECTS]
    )
    return Incident(
        recording=recording,
        where=axis.link.where,
        fetched=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        fault=about.incident_fault,
        error_code=str(about.incident_error_code),
        tick=about.incident_tick,
        later=about.incident_later,
        kept=state == "incident_kept",
        archived=archived,
        table=OBJECTS_HASH,
        parameters=parameters,
    )


def clear(axis: Axis) -> None:
    """Deletes the incident in the black box, so that the black box records again."""
    axis.set(incident_command="clear")


def packed(recording: Recording) -> bytes:
    """Returns the samples of an incident as bytes, in the format in which the axis stores them."""
    row = struct.Struct("<" + "".join(STRUCT_FORMATS[BY_NAME[n].type] for n in recording.signals))
    return b"".join(row.pack(*map(int, sample)) for sample in recording.raw)


def write(incident: Incident, folder: Path, figure: "Figure") -> None:
    """Writes incident.json and incident.png to `folder`, which is created if necessary. Writes
    either both files or no file. Raises OSError."""
    recording = incident.recording
    known = {
        f.name: getattr(incident, f.name)
        for f in dataclasses.fields(incident)
        if f.name != "recording"
    }
    samples = {
        "trigger_sample": recording.trigger_sample,
        "crc": zlib.crc32(packed(recording)),
        **{name: recording.raw[:, i].tolist() for i, name in enumerate(recording.signals)},
    }
    with paths.replacing(folder, "incident.json", "incident.png") as (text, picture):
        text.write_text(
            json.dumps({"forceaxis_incident": VERSION, **known, "samples": samples}) + "\n"
        )
        figure.savefig(picture, format="png", dpi=120)


def is_incident(path: str | Path) -> bool:
    """Returns True if a file begins like an incident file."""
    try:
        with open(path, "rb") as file:
            return file.read(32).startswith(b'{"forceaxis_incident"')
    except OSError:
        return False


def load(path: Path) -> Incident:
    """Reads an incident file. Raises InputError, OSError."""
    expected = "a file with an incident, which `read_incident` has written"
    remedy = "read the incident from the axis again"
    held = files.read_json(path, expected, remedy)
    version, samples = held.pop("forceaxis_incident", None), held.pop("samples", None)
    if not isinstance(samples, dict):
        files.refuse(path, expected, "no samples", remedy)
    trigger, crc = samples.pop("trigger_sample", None), samples.pop("crc", None)
    with files.parsing(path, expected, remedy):
        about = from_json(IncidentAbout, held)
        raw = np.array([from_json(list[int], column) for column in samples.values()]).T
        if raw.ndim != 2 or type(trigger) is not int or not 0 <= trigger < len(raw):
            raise ValueError(f"samples in the shape {raw.shape}, the fault at {trigger!r}")
        if missing := set(SIGNALS) - set(samples):
            raise ValueError(f"no samples of {', '.join(sorted(missing))}")
        recording = Recording(tuple(samples), raw.astype(np.int64), 1, trigger)
        incident = Incident(recording, **vars(about))
        is_right = zlib.crc32(packed(incident.recording)) == crc
        # this call checks that the file has the parameters of the measured force
        _ = incident.force_N
    if version != VERSION:
        raise InputError(
            f"{path}: expected an incident file of version {VERSION}, got version {version}"
        )
    if not is_right:
        raise InputError(
            f"{path}: expected samples with a correct CRC, got a damaged file; read the incident "
            "from the axis again"
        )
    return incident


def is_enabled(statusword: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Returns for each tick True if the statusword shows the state "operation enabled"."""
    state = next(s for s in STATUS_STATES if s.text == "operation enabled")
    return np.asarray((statusword & state.mask) == state.value)


def source_of(incident: Incident, path: Path) -> Source:
    """Returns the signals of an incident as a source from which a recording can be imported. The
    signals are force and demanded force in N, travel in encoder counts, whether the drive is
    enabled, and the raw samples. `path`: the incident file."""
    demand_N = incident.column("force_demand") * incident.force.rated_force * 1e-6
    raw = {name: incident.column(name) for name in incident.recording.signals}
    table = {
        "time_s": incident.recording.time_s,
        "force_N": incident.force_N,
        "force_demand_N": demand_N,
        "travel_count": incident.travel,
        "enabled": is_enabled(incident.column("statusword")).astype(np.int64),
        **raw,
    }
    return array_source(path, "incident", table)


def missing(incident: Incident) -> list[str]:
    """Returns the names of the quantities that are needed to replay the incident, in addition to
    its samples."""
    enabled = is_enabled(incident.column("statusword")[: incident.recording.trigger_sample])
    lacks = ["the targets and controlwords that were written", "current_raw", "sensor_valid"]
    if len(enabled) and enabled[0]:
        lacks.append(
            "the state at its first sample of force law (force_integral, sections, bump_bias), "
            "trajectory, shapers and supervision"
        )
    return lacks


def figure(incident: Incident, counts_per_mm: float | None = None) -> "Figure":
    """Returns the plot of an incident over the time in ms from the error. It shows the force in N
    with `force_max`, the travel in mm or encoder counts, and the DAC code.

    The first column of the plot shows the whole recording. The second column shows only NEAR_MS
    before and after the error.
    """
    import matplotlib.pyplot as plt

    from forceaxis.drawing import FAINT, GOT, INK, THIN, WANTED, legend, style

    time_ms = incident.time_ms
    unit, scale = ("mm", counts_per_mm) if counts_per_mm else ("encoder counts", 1)
    way = incident.travel / scale
    demand = way + (incident.column("profile_position") - incident.column("position")) / scale
    wanted = incident.column("force_demand") * incident.force.rated_force * 1e-6
    bound = incident.force.force_max * incident.force.count_N
    columns = (
        ("force, N", ((incident.force_N, INK), (wanted, WANTED)), bound),
        (f"way, {unit}", ((way, INK), (demand, WANTED)), 0),
        ("DAC code", ((incident.column("dac_code"), INK),), 0),
    )
    made, rows = plt.subplots(3, 2, sharex="col", figsize=(9, 5.5), layout="constrained")
    for pair, (label, lines, most) in zip(rows, columns, strict=True):
        for ax, inside in zip(pair, (time_ms >= time_ms[0], abs(time_ms) <= NEAR_MS), strict=True):
            style(ax)
            for values, color in lines:
                ax.plot(time_ms[inside], values[inside], color=color, **THIN)
            ax.axvline(0, color=GOT, linewidth=0.8)
            if most:
                ax.axhline(most, color=FAINT, linewidth=0.8, linestyle="--")
        pair[0].set_ylabel(label, fontsize=8)
    for ax in rows[-1]:
        ax.set_xlabel("time from the error, ms", fontsize=8)
    rows[0, 0].set_title(
        f"{incident.where}: {words(incident)}", fontsize=9, loc="left", color=INK, parse_math=False
    )
    keys = [
        plt.Line2D([], [], color=INK, label="measured"),
        plt.Line2D([], [], color=WANTED, label="demanded"),
        plt.Line2D([], [], color=GOT, label="the error"),
    ]
    if bound:
        keys.append(plt.Line2D([], [], color=FAINT, linestyle="--", label="force_max"))
    legend(made, handles=keys, loc="outside lower center", ncols=len(keys))
    plt.close(made)
    return made


def words(incident: Incident) -> str:
    """Returns the name of the fault of an incident, or the error code if the incident has no
    fault."""
    named = incident.fault if incident.fault != "none" else incident.error_code
    return named.replace("_", " ")
