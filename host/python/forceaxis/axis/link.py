"""Access to the objects of one axis. This module defines the interface that all kinds of
connections have in common, and their error texts.

A connection transfers raw values of named objects. Its waiting times are measured by the clock of
the axis. From acquire() to release(), the connection owns the axis and writes to its watchdog. If
the program ends, the watchdog disables the axis. Each kind of connection is a module of this
package: sim, gateway, can, modbus.
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
# Names of the clients that can own an axis.
# The index of a name is the raw value of the object command_source.
COMMAND_SOURCES = BY_NAME["command_source"].enum
# Largest relative difference between `force_scale` of the axis and the scale of the sensor.
# A larger difference of the force scales causes a warning.
FORCE_SCALE_TOLERANCE = 0.1
# CANopen indices of the texts device name, hardware version and firmware version.
DEVICE_NAME_INDEX, HARDWARE_INDEX, VERSION_INDEX = 0x1008, 0x1009, 0x100A


# {error code FW_ERROR_ of the firmware: text for the user}
REASONS = {refusal.error: refusal.text for refusal in REFUSALS.values()}
NOT_NOW = REFUSALS["state"].error


def reason(what: str, error: int) -> str | None:
    """Returns a text for the user about an access that the axis has refused, or None for an unknown
    error code. `what`: name of the refused access, such as the name of an object. `error`: error
    code of the firmware."""
    text = REASONS.get(error)
    return f"{text}{state_needed(what)}" if error == NOT_NOW else text


RawSamples = NDArray[np.int64]


@dataclass(frozen=True)
class Recording:
    """A recording that the recorder of the axis has made. It has one column of raw values for each
    signal. Two consecutive samples are `decimation` ticks apart."""

    signals: tuple[str, ...]
    #: Raw values as int64, with one row for each sample and one column for each signal.
    #: Raw values of unsigned objects are >= 0.
    raw: RawSamples = field(repr=False)
    decimation: int = 1
    trigger_sample: int = 0  # index of the sample at the trigger, or of the first sample after it

    def values(self, name: str) -> NDArray[np.int64 | np.float64]:
        """Returns one signal of the recording in engineering units, with one value for each sample.
        The values are integers if the scale of the object is 1."""
        known = BY_NAME[name]
        column = self.raw[:, self.signals.index(name)]
        return column if known.scale == 1 else column.astype(float) * known.scale

    def floats(self, name: str) -> NDArray[np.float64]:
        """Returns one signal of the recording in engineering units, always as floating-point
        numbers."""
        return self.values(name).astype(float)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Returns the time of each sample in s from the trigger."""
        samples = np.arange(len(self.raw)) - self.trigger_sample
        return np.asarray(samples * (self.decimation / TICKS_PER_S))


class Link(abc.ABC):
    """A connection to one axis. Several threads may use the connection at the same time. `where` is
    the name of the axis in messages, such as "axis 1 at the gateway".

    `source` is the raw value of the object command_source while this connection owns the axis.
    `warning` is a warning of one line for the user, or None. `counts_per_metre` is the number of
    encoder counts per metre, or None if no model states it.
    """

    where: str
    source: int
    warning: str | None = None
    counts_per_metre: float | None = None
    # From acquire() to release(), this thread writes the watchdog or sends the heartbeat.
    # `_keeper` is None while the axis is not acquired.
    _keeper: Keeper | None = None

    def use_model(self, model: str | Path) -> None:
        """Sets the size of one encoder count from the encoder in a model file. Raises InputError if
        the model has no encoder."""
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
        """Returns True if this connection can access an object. Modbus can access only objects that
        have a register."""
        return True

    def manages(self, name: str) -> bool:
        """Returns True if the gateway sets this parameter for its own use, for example for process
        data."""
        return False

    def forgets(self) -> dict[str, float]:
        """Returns the parameters whose present values end with this connection although the axis
        may store them: {name: engineering value that they get}. Only a simulated axis, which is
        powered up by each connection, has such parameters."""
        return {}

    def text(self, index: int) -> str | None:
        """Returns the text that the axis has at a CANopen index, such as the device name (1008h) or
        the firmware version (100Ah). Returns None if the connection transmits no texts."""
        return None

    def cycle_curve(self) -> bytes | None:
        """Returns the points of the curve of the last cycle (object cycle_curve_data). Returns None
        if this connection transmits no domains. In this case, a client writes the object
        cycle_curve_first to see points of the curve in the objects cycle_data. Raises Refused,
        NoAnswer."""
        return None

    def download_update(self, data: bytes, written: Callable[[int], None]) -> None:
        """Writes an update of the firmware to the object program_data. `written` is a function that
        is called repeatedly with the number of bytes that were transferred. Raises Refused,
        NoAnswer."""
        raise Refused(f"{self.where}: an update needs a connection over CAN or Modbus")

    @abc.abstractmethod
    def write(self, values: Mapping[str, int]) -> None:
        """Writes {object: raw value} in order and stops at the first value that the axis refuses.
        Raises Refused, NoAnswer."""

    def start(self) -> None:
        """Brings the node of the axis into the NMT state operational. A stopped node has disabled
        its drive, and the drive stays disabled until its owner enables it. Raises Refused,
        NoAnswer."""
        raise Refused(
            f"{self.where}: expected a connection over CAN or to a gateway, because NMT, which "
            "stops and starts nodes, is a service of CANopen"
        )

    def disturbance(self) -> str | None:
        """Returns a sentence about another client that would interrupt the reading of a recording
        or of a curve, because it uses the same channel. Returns None if there is no such client."""
        return None

    @abc.abstractmethod
    def acquire(self) -> None:
        """Acquires the axis. Raises Refused if another client owns the axis."""

    @abc.abstractmethod
    def release(self) -> None:
        """Releases the axis, which must already be disabled."""

    def wait(self, seconds: float) -> None:
        """Waits for `seconds` by the clock of the axis."""
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
        """Starts a recording of up to 8 objects. `settings` has raw values of objects of the
        recorder, whose names have no prefix: length, decimation, pretrigger, trigger_source,
        trigger_edge, trigger_level."""

    @abc.abstractmethod
    def fetch(self, signals: Sequence[str]) -> None:
        """Loads the incident that the black box of the axis has stored into the recorder. The next
        reading of the recorder returns the incident. `signals`: names of the signals that the black
        box has recorded. Raises Refused if the axis has no incident."""

    @abc.abstractmethod
    def recording(self, timeout_s: float) -> Recording:
        """Waits for the end of the recording that arm() has started, for at most `timeout_s` by the
        clock of the axis, and returns the recording. Then makes the recorder idle, so that the
        black box records again. This is not possible if another client owns the axis. Raises
        NoAnswer."""

    @abc.abstractmethod
    def close(self) -> None:
        """Ends the connection without disabling the axis; see Axis.close()."""

    @contextlib.contextmanager
    def unfed(self, names: Iterable[str]) -> Iterator[None]:
        """Context manager for a write to the objects `names`. If these include the watchdog, no
        WatchdogKeeper writes the watchdog meanwhile."""
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
        """Reads the samples from the recorder after the end of a recording. Returns raw values as
        int64, with one row for each sample and one column for each signal. Raises NoAnswer."""

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
        # If another client owns the axis meanwhile, the axis refuses this write.
        # The samples of the recording are valid nevertheless.
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
    """Returns the number by which the recorder selects a signal. This number is the CANopen index
    of the object times 256, plus its sub-index."""
    known = BY_NAME[name]
    return known.index << 8 | known.sub


def unsigned(name: str, raw: int) -> int:
    """Converts a raw value of an unsigned object that was received as a signed 32-bit integer.
    Returns the value of a signed object unchanged."""
    return raw + 2**32 if raw < 0 and BY_NAME[name].type == "u32" else raw


def _recorder_writes(signals: Sequence[str], settings: Mapping[str, int]) -> dict[str, int]:
    """Returns the raw values that must be written to the objects of the recorder, while it is
    stopped, before a recording starts."""
    channels = [_address(name) for name in signals] + [0] * (8 - len(signals))
    defaults = {"decimation": 1, "pretrigger": 0, "length": 0, "trigger_edge": 0}
    return {
        **{f"recorder_signal_{i + 1}": value for i, value in enumerate(channels)},
        **{f"recorder_{name}": value for name, value in {**defaults, **settings}.items()},
    }
