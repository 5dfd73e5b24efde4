"""Access to the objects of one axis: the interface that all connections have in common, and the
errors of the connections.

A connection transfers raw values of named objects, in the axis' own time. From acquire() to
release() it owns the axis and writes to its watchdog, which disables the axis if the program ends.
Each kind of connection is a module of this package: sim, gateway, can, modbus.
"""

import abc
import contextlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.bus.client import NoAnswer, Refused
from forceaxis.bus.keeper import Keeper, WatchdogKeeper
from forceaxis.bus.state_names import enum
from forceaxis.linear import plant_facts
from forceaxis.objects import BY_NAME, REFUSALS, state_needed

__all__ = ["Link", "NoAnswer", "RecorderLink", "Recording", "Refused", "unsigned"]

TICKS_PER_S: int = _core.TICKS_PER_SECOND
POLL_PERIOD_S = 0.02  # time in s between two reads while a program waits for a new value
# Names of the owners of an axis, indexed by the raw value of the object command_source.
COMMAND_SOURCES = BY_NAME["command_source"].enum
# Largest relative difference between the calibrated `force_scale` and that of the sensor.
FORCE_SCALE_TOLERANCE = 0.1
# CANopen indices of two texts: name of the device, version of the firmware of the device.
DEVICE_NAME_INDEX, HARDWARE_INDEX, VERSION_INDEX = 0x1008, 0x1009, 0x100A


# Text for the user for each error code FW_ERROR_ of the firmware.
REASONS = {refusal.error: refusal.text for refusal in REFUSALS.values()}
NOT_NOW = REFUSALS["state"].error


def reason(what: str, error: int) -> str | None:
    """Returns the text for an error code of the firmware, or None for another code. `what`: what
    the axis has refused, such as the name of an object."""
    text = REASONS.get(error)
    return f"{text}{state_needed(what)}" if error == NOT_NOW else text


RawSamples = NDArray[np.int64]


@dataclass(frozen=True)
class Recording:
    """Recording of signals from the recorder of the axis: raw values in the shape (samples,
    signals). The samples are `decimation` ticks apart."""

    signals: tuple[str, ...]
    #: Raw values of the signals, shape (n, len(signals)), as int64. Values of unsigned objects are
    #: >= 0.
    raw: RawSamples = field(repr=False)
    decimation: int = 1
    trigger_sample: int = 0  # index of the first sample at or after the trigger

    def values(self, name: str) -> NDArray[np.int64 | np.float64]:
        """Returns one signal of the recording in engineering units as an array (n,). The array
        contains integers if the scale of the object is 1."""
        known = BY_NAME[name]
        column = self.raw[:, self.signals.index(name)]
        return column if known.scale == 1 else column.astype(float) * known.scale

    def floats(self, name: str) -> NDArray[np.float64]:
        """Returns the array of values() as floating-point numbers."""
        return self.values(name).astype(float)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Returns the times of the samples in s from the trigger as an array (n,)."""
        samples = np.arange(len(self.raw)) - self.trigger_sample
        return np.asarray(samples * (self.decimation / TICKS_PER_S))


class Link(abc.ABC):
    """A connection to one axis. `where` is the name of the axis in messages, such as "axis 1 at the
    gateway". Several threads may use a connection.

    `source` is the raw command_source of its writes. `warning` is one line for the user, or None.
    `counts_per_metre` is the scale of the encoder if a model gives it.
    """

    where: str
    source: int
    warning: str | None = None
    counts_per_metre: float | None = None
    # Thread that keeps the axis acquired, from acquire() to release().
    _keeper: Keeper | None = None

    def use_model(self, model: str | Path) -> None:
        """Takes the size of an encoder count from the encoder of a model (a path). Raises
        InputError if the model has no encoder."""
        encoder = plant_facts.read(str(model)).encoder
        if encoder is None:
            raise InputError(
                f"{model}: expected a model with an [encoder], got a model without an encoder; "
                "choose another model"
            )
        self.counts_per_metre = abs(encoder.scale)

    @abc.abstractmethod
    def read(self, names: Iterable[str]) -> dict[str, int]:
        """Returns the raw values of the objects `names`, with the names of the objects as keys.
        Raises Refused, NoAnswer."""

    def read_one(self, name: str) -> int:
        """Returns the raw value of one object. Raises Refused, NoAnswer."""
        return self.read([name])[name]

    def reaches(self, name: str) -> bool:
        """Returns True if this connection can access an object. Over Modbus, only objects with a
        register can be accessed."""
        return True

    def manages(self, name: str) -> bool:
        """Returns True if the gateway sets this parameter for its own use, for example for process
        data."""
        return False

    def text(self, index: int) -> str | None:
        """Returns a CANopen text of the axis: name of the device (1008h) or version of the firmware
        (100Ah). Returns None if the connection transmits no texts."""
        return None

    def cycle_curve(self) -> bytes | None:
        """Returns the points of the curve of the last cycle (object cycle_curve_data). Returns None
        if this connection transmits no domains; then cycle_curve_first shows points in cycle_data.
        Raises Refused, NoAnswer."""
        return None

    def download_update(self, data: bytes, written: Callable[[int], None]) -> None:
        """Writes an update of the firmware (object program_data). `written` is called with the
        number of bytes that the axis has. Raises Refused, NoAnswer."""
        raise Refused(f"{self.where}: an update needs a connection over CAN or Modbus")

    @abc.abstractmethod
    def write(self, values: Mapping[str, int]) -> None:
        """Writes {object: raw value} in order and stops at the first value that the axis refuses.
        Raises Refused, NoAnswer."""

    def start(self) -> None:
        """Brings the node of the axis into the NMT state operational. A node that was stopped has
        disabled its drive. The drive stays disabled until its owner enables it. Raises Refused,
        NoAnswer."""
        raise Refused(
            f"{self.where}: expected a connection over CAN or to a gateway, because NMT, which "
            "stops and starts nodes, is a service of CANopen"
        )

    def disturbance(self) -> str | None:
        """Returns a sentence about another client that uses the channel over which recordings and
        curves are read and would interrupt them, or None."""
        return None

    @abc.abstractmethod
    def acquire(self) -> None:
        """Acquires the axis. Raises Refused if another client owns the axis."""

    @abc.abstractmethod
    def release(self) -> None:
        """Releases the axis, which must already be disabled."""

    def wait(self, seconds: float) -> None:
        """Waits for `seconds` in the time of the axis."""
        time.sleep(seconds)

    def polls(self, seconds: float) -> Iterator[float]:
        """Yields, every POLL_PERIOD_S seconds, the time in s since the start of the call, until
        `seconds` have passed. All times are measured by the clock of the axis."""
        passed = 0.0
        while passed < seconds:
            yield passed
            self.wait(POLL_PERIOD_S)
            passed += POLL_PERIOD_S

    @abc.abstractmethod
    def arm(self, signals: Sequence[str], settings: Mapping[str, int]) -> None:
        """Starts a recording of up to 8 objects. `settings` is {recorder object without its prefix:
        raw value}, where the names are length, decimation, pretrigger, trigger_source,
        trigger_edge, trigger_level."""

    @abc.abstractmethod
    def fetch(self, signals: Sequence[str]) -> None:
        """Loads an incident of the black box into the recorder of the axis. The black box has
        recorded `signals`. The next reading of the recorder returns the incident. Raises Refused
        without an incident."""

    @abc.abstractmethod
    def recording(self, timeout_s: float) -> Recording:
        """Waits for the armed recording, at most `timeout_s` of the axis' time, and returns the
        recording. Afterwards the recorder is idle, so that the black box records again, unless
        another source owns the axis. Raises NoAnswer."""

    @abc.abstractmethod
    def close(self) -> None:
        """Ends the connection without disabling the axis; see Axis.close()."""

    @contextlib.contextmanager
    def unfed(self, names: Iterable[str]) -> Iterator[None]:
        """Context manager during which no WatchdogKeeper writes the watchdog, if the watchdog is
        among the objects `names`."""
        keeper = self._keeper
        if isinstance(keeper, WatchdogKeeper) and {"watchdog", "0x2302"}.intersection(names):
            with keeper.unchanged:
                yield
        else:
            yield

    def _end_keeper(self) -> None:
        if self._keeper:
            self._keeper.close()
            self._keeper = None


class RecorderLink(Link):
    """A connection that reads the recorder of the axis through objects of the axis."""

    # Signals and decimation (in ticks) of the latest armed recording.
    _armed: tuple[tuple[str, ...], int] | None = None

    @abc.abstractmethod
    def _samples(self, signals: Sequence[str]) -> RawSamples:
        """Reads the samples from the recorder after the end of a recording. Returns an array (n,
        len(signals)) as int64. Raises NoAnswer."""

    def arm(self, signals: Sequence[str], settings: Mapping[str, int]) -> None:
        self.write({"recorder_arm": 0})
        self.write(_recorder_writes(signals, settings))
        self.write({"recorder_arm": 1})
        self._armed = tuple(signals), settings.get("decimation", 1)

    def fetch(self, signals: Sequence[str]) -> None:
        self.write({"incident_command": 1})
        self._armed = tuple(signals), 1

    def recording(self, timeout_s: float) -> Recording:
        self._wait_recorded(timeout_s)
        if self._armed is None:
            raise Refused(
                f"{self.where}: expected a recording that was armed, got none; start a recording "
                "first"
            )
        signals, decimation = self._armed
        trigger = self.read_one("recorder_trigger_index")
        raw = self._samples(signals)
        # Another source may own the axis since; the samples are here all the same.
        with contextlib.suppress(Refused):
            self.write({"recorder_arm": 0})
        return Recording(signals, raw, decimation, trigger)

    def _wait_recorded(self, timeout_s: float) -> None:
        passed = 0.0
        while True:
            state = enum("recorder_state", self.read_one("recorder_state"))
            if state == "done":
                return
            if state == "idle":
                raise Refused(f"{self.where}: the recording was stopped")
            if passed >= timeout_s:
                raise NoAnswer(
                    f"{self.where}: expected a recording within {timeout_s:g} s, but the recorder "
                    f"is {state}"
                    + ("; the trigger condition has not occurred" if state == "armed" else "")
                )
            self.wait(POLL_PERIOD_S)
            passed += POLL_PERIOD_S


def _address(name: str) -> int:
    """Returns the number by which the recorder selects a signal: CANopen index times 256 plus
    sub-index of the object."""
    known = BY_NAME[name]
    return known.index << 8 | known.sub


def unsigned(name: str, raw: int) -> int:
    """Returns the unsigned value of a raw value that was received as a signed 32-bit word."""
    return raw + 2**32 if raw < 0 and BY_NAME[name].type == "u32" else raw


def _recorder_writes(signals: Sequence[str], settings: Mapping[str, int]) -> dict[str, int]:
    """Returns the raw values that must be written to the objects of the stopped recorder before a
    recording starts."""
    channels = [_address(name) for name in signals] + [0] * (8 - len(signals))
    defaults = {"decimation": 1, "pretrigger": 0, "length": 0, "trigger_edge": 0}
    return {
        **{f"recorder_signal_{i + 1}": value for i, value in enumerate(channels)},
        **{f"recorder_{name}": value for name, value in {**defaults, **settings}.items()},
    }
