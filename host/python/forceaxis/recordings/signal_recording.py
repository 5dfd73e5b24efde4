"""Recordings of signals: their types, and the file that contains a recording.

A file is an NPZ archive (a ZIP of NumPy arrays) NAME.npz with

    recording.toml      the header, a TOML text
    <signal>.npy        values of a signal in the SI unit of the header, float64 (n,)
    time_<clock>.npy    times of the samples in s, float64 (n,), for all signals with this
                        `clock`

The header has `format`, `title`, and a table [source] about the file that was imported. It has one
table [[signal]] for each signal, with the fields of SignalHeader.

    recording = read("touch.npz")
    force = recording["force"]
    force.time_s, force.values          # NumPy arrays; the unit of the values is force.unit
"""

import dataclasses
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forceaxis import files, paths, toml
from forceaxis._core import InputError
from forceaxis.results import JsonObject, from_json, to_json

Floats: TypeAlias = NDArray[np.float64]

FORMAT = 1  # version of the file format
HEADER = "recording.toml"
# Largest distance of a time stamp from equally spaced times, relative to their period.
EVEN_SHARE = 0.25
SUFFIX = ".npz"

#: {name of a signal with a fixed meaning: its unit}.
#: A signal whose name ends in _command is what the machine's controller sent to the drive.
#: A signal whose name ends in _setpoint is what the machine's controller had to reach.
#: A signal with another name is kept without a meaning for other commands.
UNITS = {
    "force": "N",
    "position": "m",
    "speed": "m/s",
    "current": "A",
    "torque": "N m",
    "code": "count",  # code of the DAC of the model, -2048 to 2047 at 12 bits
    "enabled": "1",  # value 1 while the drive is enabled, 0 while it is disabled
    "voltage_command": "V",
    "speed_command": "m/s",
    "force_command": "N",
    "force_setpoint": "N",
    "position_setpoint": "m",
}

#: Signals that can drive a plant instead of the firmware, in order of preference.
COMMANDS = ("code", "voltage_command", "speed_command", "force_command")
#: Signals that can be the input of a run.
INPUTS = (*COMMANDS, "force_setpoint")


@dataclass(frozen=True)
class SignalFinding:
    """A finding about one interval of one signal, such as a gap or a spike."""

    kind: str  #: kind of the finding: "gap", "spike", "jump", "saturation" or "constant"
    from_s: float  #: time of the first sample of the stretch
    to_s: float  #: time of the last sample of the stretch
    samples: int  #: number of samples in the stretch; for a gap, of missing samples
    text: str  #: the finding as one sentence


@dataclass(frozen=True)
class SignalHeader:
    """The data of one signal in the header of a recording, without its samples.

    values = sign * factor * (value in the source) + offset, in `unit`. If a filter or a bus delays
    a signal, its value was true `delay_s` before its time.
    """

    name: str
    unit: str  #: SI unit of `values`, or "1"
    column: str  #: name of the column in the source
    source_unit: str  #: unit of the column in the source
    factor: float  #: size of the source unit in `unit`, > 0
    sign: int  #: sign of `values` relative to the source, 1 or -1
    rate_hz: float  #: rate of equally spaced samples in Hz, or median rate of others
    delay_s: float = 0.0
    clock: str = "0"  #: name of the time base
    findings: tuple[SignalFinding, ...] = ()
    offset: float = field(default=0.0, kw_only=True)  #: what was added to the values, in `unit`

    @property
    def header(self) -> "SignalHeader":
        """Returns the header of the signal alone, without the samples of a RecordedSignal."""
        names = [f.name for f in dataclasses.fields(SignalHeader)]
        return SignalHeader(**{name: getattr(self, name) for name in names})


@dataclass(frozen=True)
class RecordedSignal(SignalHeader):
    """One signal of a recording, with its samples."""

    #: (n,) ascending times of the source in s
    time_s: Floats = field(default_factory=lambda: np.empty(0), repr=False, compare=False)
    #: (n,) values in `unit`
    values: Floats = field(default_factory=lambda: np.empty(0), repr=False, compare=False)

    @property
    def true_time_s(self) -> Floats:
        """Returns the times in s at which the values were true, as an array (n,). They are the time
        stamps without the delay of the signal."""
        return self.time_s - self.delay_s


@dataclass(frozen=True)
class RecordingSource:
    """The file from which a recording was imported."""

    file: str  #: file name without the folder
    kind: str  #: kind of the file, such as "CSV" or "MCAP"
    sha256: str
    bytes: int
    #: time in the source that is 0 in the recording: 0, or a whole number for times of the day
    origin_s: float = 0.0
    #: columns of the source that are not in the recording
    not_imported: tuple[str, ...] = ()


@dataclass(frozen=True)
class SignalRecording:
    """Several signals over time that were recorded together in one recording."""

    title: str
    source: RecordingSource
    signals: tuple[RecordedSignal, ...]

    def __getitem__(self, name: str) -> RecordedSignal:
        """Returns the signal with the name `name`. Raises KeyError."""
        for signal in self.signals:
            if signal.name == name:
                return signal
        raise KeyError(name)

    def __contains__(self, name: str) -> bool:
        return any(signal.name == name for signal in self.signals)

    def __iter__(self) -> Iterator[RecordedSignal]:
        return iter(self.signals)

    @property
    def names(self) -> tuple[str, ...]:
        """Returns the names of all signals."""
        return tuple(signal.name for signal in self.signals)

    def sampled(self, name: str, at_s: Floats) -> Floats:
        """Returns the values of a signal at the true times `at_s` (n,) in s. They are interpolated
        between its samples. Before the first and after the last sample, the value of this sample is
        used. Raises KeyError."""
        signal = self[name]
        return np.asarray(np.interp(at_s, signal.true_time_s, signal.values))

    def held(self, name: str, at_s: Floats) -> Floats:
        """Returns the values of a signal at the true times `at_s` (n,) in s, as a converter holds
        them: each is the value of the last sample at or before this time. Because of rounding, a
        sample may also be slightly later, by EVEN_SHARE of the period of the signal or of the
        smallest step of `at_s`, whichever is smaller. Raises KeyError."""
        signal = self[name]
        late_s = 0.0
        if len(signal.time_s) > 1 and len(at_s) > 1:
            period_s, step_s = np.median(np.diff(signal.time_s)), np.min(np.abs(np.diff(at_s)))
            late_s = EVEN_SHARE * float(min(period_s, step_s))
        last = np.searchsorted(signal.true_time_s, at_s + late_s, side="right") - 1
        return np.asarray(signal.values[np.clip(last, 0, None)])

    def even(self, step_s: float) -> "SignalRecording":
        """Returns the recording for a simulation with steps of `step_s`. Equally spaced times
        replace the time stamps of each signal, if no stamp differs from them by more than
        EVEN_SHARE of a step or of the period of the signal. Files that round their times have such
        stamps."""
        signals = (
            replace(s, time_s=even_times(s.time_s, EVEN_SHARE * step_s)) for s in self.signals
        )
        return replace(self, signals=tuple(signals))


def even_times(time_s: Floats, within_s: float = np.inf) -> Floats:
    """Returns the equally spaced times that fit ascending time stamps best. Samples may be missing
    between them. Returns the stamps unchanged if one of them is farther from its time than
    `within_s` or EVEN_SHARE of the period."""
    found = numbers_of(time_s)
    if found is None:
        return time_s
    number, period = found
    centre, middle = number - number.mean(), float(time_s.mean())
    even = middle + period * centre
    off = float(np.max(np.abs(even - time_s)))
    is_even = off <= min(within_s, EVEN_SHARE * period) and bool(np.all(np.diff(even) > 0))
    return np.asarray(even) if is_even else time_s


def numbers_of(time_s: Floats) -> tuple[Floats, float] | None:
    """Returns (numbers, period in s) of the equally spaced times that fit ascending time stamps
    best. `numbers` (n,): whole numbers from 0, with steps above 1 where samples are missing.
    Returns None if no equally spaced times fit the stamps."""
    steps = np.diff(time_s)
    if len(steps) < 2 or not np.all(steps > 0):
        return None
    number = np.append(0.0, np.cumsum(np.round(steps / np.median(steps))))
    # The median of rounded steps gives a wrong count in a long gap. The first fit corrects it.
    for _ in range(2):
        centre, middle = number - number.mean(), float(time_s.mean())
        if not np.any(centre):
            return None
        period = float(centre @ (time_s - middle) / (centre @ centre))
        if not period > 0:
            return None
        begin = middle + period * centre[0]
        number = np.round((time_s - begin) / period)
    return number - number[0], period


def with_suffix(path: Path) -> Path:
    """Returns the path of the file of a recording. The suffix of recordings is added to `path` if
    it is missing."""
    return path if path.suffix == SUFFIX else path.with_name(path.name + SUFFIX)


def _table(values: Mapping[str, Any]) -> str:
    return "".join(f"{key} = {toml.value_text(value)}\n" for key, value in values.items())


def _header(recording: SignalRecording) -> str:
    parts = [
        f"format = {FORMAT}\ntitle = {toml.value_text(recording.title)}\n\n[source]\n",
        _table(to_json(recording.source)),
    ]
    for signal in recording.signals:
        plain = to_json(replace(signal.header, findings=()))
        del plain["findings"]
        parts += ["\n[[signal]]\n", _table(plain)]
        for finding in signal.findings:
            parts += ["\n[[signal.findings]]\n", _table(to_json(finding))]
    return "".join(parts)


def write(recording: SignalRecording, path: Path) -> Path:
    """Writes a recording to `path`, and returns the path of the file. The suffix is added if it is
    missing. The file is written completely or not at all. Raises OSError. Raises ValueError if
    signals with the same clock have different times."""
    path = with_suffix(path)
    arrays: dict[str, Floats] = {}
    for signal in recording.signals:
        time = f"time_{signal.clock}"
        if not np.array_equal(arrays.setdefault(time, signal.time_s), signal.time_s):
            raise ValueError(f"{signal.name}: expected the times of the clock {signal.clock}")
        arrays[signal.name] = signal.values
    with (
        paths.replacing(path.parent, path.name) as (file,),
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        # The archive has a fixed date, so that the files of equal recordings have equal bytes.
        archive.writestr(zipfile.ZipInfo(HEADER), _header(recording), zipfile.ZIP_DEFLATED)
        for name, values in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy")
            info.compress_type, info.file_size = zipfile.ZIP_DEFLATED, values.nbytes
            with archive.open(info, "w") as part:
                np.lib.format.write_array(part, np.asarray(values, dtype=np.float64))
    return path


def is_recording(path: Path | str) -> bool:
    """Returns True if a file is a ZIP archive with the header of a recording."""
    try:
        with zipfile.ZipFile(path) as archive:
            return HEADER in archive.namelist()
    except (OSError, zipfile.BadZipFile, NotImplementedError):
        return False


def source_file(path: Path) -> str | None:
    """Returns the name of the file from which a recording was imported, or None if a file is no
    recording."""
    if not is_recording(path):
        return None
    try:
        with zipfile.ZipFile(path) as archive:
            source = toml.read_text(archive.read(HEADER).decode()).get("source")
    except (OSError, zipfile.BadZipFile, UnicodeDecodeError, InputError):
        return None
    return str(source.get("file")) if isinstance(source, dict) else None


def read(path: Path | str) -> SignalRecording:
    """Returns the recording in a file. Raises InputError that names the file and what was
    expected."""
    file = Path(path)
    where = paths.display(file)
    wrong = "a recording that `import_recording` has written"
    if not file.exists():
        raise InputError(f"{where}: expected a readable file, got none")
    with files.parsing(file, wrong, "import the data again"), zipfile.ZipFile(file) as archive:
        files.expect_unpacked(file, sum(info.file_size for info in archive.infolist()))
        header = toml.read_text(archive.read(HEADER).decode())
        if header.get("format") != FORMAT:
            files.refuse(
                file, f"{wrong} in format {FORMAT}", f"format {header.get('format')}",
                "import the data again",
            )  # fmt: skip
        tables = header.get("signal")
        if not isinstance(tables, list) or not all(isinstance(t, dict) for t in tables):
            raise ValueError("no tables [[signal]]")
        times: dict[str, NDArray[np.generic]] = {}
        signals = tuple(
            _signal(archive, times, table, f"{where}: signal {number}")
            for number, table in enumerate(tables)
        )
    source = from_json(RecordingSource, header.get("source", {}), f"{where}: source")
    return SignalRecording(str(header.get("title", "")), source, signals)


def _signal(
    archive: zipfile.ZipFile, times: dict[str, NDArray[np.generic]], table: JsonObject, where: str
) -> RecordedSignal:
    """Returns a signal with its samples. `times`: the times that were already read, of each
    clock."""
    clock = str(table["clock"])
    if clock not in times:
        times[clock] = files.array_of(archive, f"time_{clock}.npy")
    given = [times[clock], files.array_of(archive, f"{table['name']}.npy")]
    if any(array.dtype.kind not in "fiub" for array in given):
        raise ValueError(f"{table['name']}: arrays of another kind than numbers")
    time_s, values = (np.asarray(array, dtype=np.float64) for array in given)
    is_right = time_s.ndim == 1 and time_s.shape == values.shape and len(time_s) > 0
    if not is_right or not np.isfinite(time_s).all() or not np.all(np.diff(time_s) > 0):
        raise ValueError(
            f"{table['name']}: expected a value at each of its ascending times, got {time_s.shape} "
            f"times and {values.shape} values"
        )
    header = from_json(SignalHeader, table, where)
    return RecordedSignal(**vars(header), time_s=time_s, values=values)
