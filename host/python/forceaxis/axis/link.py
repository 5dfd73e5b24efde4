"""Access to the objects of one axis: the common interface of all connections, and their errors.

A connection transfers raw values of named objects, in the axis' own time. From acquire() to
release() it owns the axis and writes to its watchdog, which disables the axis if the program ends.
Each kind of connection is a module of this package: sim, gateway, can, modbus.
"""

import abc
import contextlib
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core
from forceaxis._core import InputError
from forceaxis.bus.client import NoAnswer, Refused
from forceaxis.bus.keeper import Keeper, WatchdogKeeper
from forceaxis.bus.state_names import BY_NAME
from forceaxis.linear import plant_facts

__all__ = ["Link", "Live", "NoAnswer", "RecorderLink", "Recording", "Refused", "unsigned"]

TICKS_PER_S: int = _core.TICKS_PER_SECOND
SCALE_WITHIN = 0.1  # relative difference from a sensor's force_scale that a calibration may have
# CANopen indices of texts: name of the device, version of its firmware
NAME, SOFTWARE = 0x1008, 0x100A


# {FW_ERROR_ code of the firmware: text}.
REASONS = {
    -1: "there is no such object",
    -2: "it cannot be written",
    -3: "it cannot be read",
    -4: "outside its range or at odds with another object",
    -5: "not in this state of the axis",
    -6: "there is no finished recording",
    -7: "another source owns the axis",
    -8: "the store is at work",
    -9: "it cannot be mapped, or conflicts with another entry",
    -10: "there is no memory for parameters",
}


RawSamples = NDArray[np.int64]


@dataclass(frozen=True)
class Recording:
    """Content of the recorder: raw values (samples, signals), each `decimation` ticks apart."""

    signals: tuple[str, ...]
    raw: RawSamples = field(repr=False)  #: (n, len(signals)) int64; a u32 is not negative
    decimation: int = 1
    trigger_sample: int = 0  #: index of the first sample at or after the trigger

    def values(self, name: str) -> NDArray[Any]:
        """A signal in engineering units, (n,)."""
        known = BY_NAME[name]
        column = self.raw[:, self.signals.index(name)]
        return column if known.scale == 1 else column * known.scale

    @property
    def time_s(self) -> NDArray[np.float64]:
        """(n,) time in s from the trigger."""
        samples = np.arange(len(self.raw)) - self.trigger_sample
        return np.asarray(samples * (self.decimation / TICKS_PER_S))


class Link(abc.ABC):
    """A connection to one axis; `where` is its name in messages ("axis 1 at the gateway"). Several
    threads may use it.

    `source` is the raw command_source of its writes. `warning` is one line for the user, or None.
    `counts_per_metre` is the scale of the encoder if a model gives it.
    """

    where: str
    source: int
    warning: str | None = None
    counts_per_metre: float | None = None
    _keeper: Keeper | None = None  # from acquire() to release()

    def use_model(self, model: str | Path) -> None:
        """Sets the encoder's scale from a model (a path). Raises InputError if the model has
        none."""
        encoder = plant_facts.read(str(model)).encoder
        if encoder is None:
            raise InputError(f"{model}: expected a model with an [encoder], it has none")
        self.counts_per_metre = abs(encoder.scale)

    @abc.abstractmethod
    def read(self, names: Iterable[str]) -> dict[str, int]:
        """{name: raw value} of objects. Raises Refused, NoAnswer."""

    def reaches(self, name: str) -> bool:
        """Whether this connection can access an object; over Modbus it needs a register."""
        return True

    def manages(self, name: str) -> bool:
        """Whether the gateway sets a parameter for its own use, for example for process data."""
        return False

    def text(self, index: int) -> str | None:
        """A CANopen text: name of the device (1008h) or version of its firmware (100Ah); None if
        the connection does not carry texts."""
        return None

    @abc.abstractmethod
    def write(self, values: Mapping[str, int]) -> None:
        """Writes {name: raw value} in order and stops at the first refused value. Raises Refused,
        NoAnswer."""

    @abc.abstractmethod
    def acquire(self) -> None:
        """Acquires the axis. Raises Refused if another client owns it."""

    @abc.abstractmethod
    def release(self) -> None:
        """Releases the axis, which must be disabled before."""

    def wait(self, seconds: float) -> None:
        """Waits for `seconds` of the axis' own time."""
        time.sleep(seconds)

    @abc.abstractmethod
    def arm(self, signals: Sequence[str], settings: Mapping[str, int]) -> None:
        """Starts a recording of up to 8 objects. settings: {recorder object without its prefix:
        raw value}, length, decimation, pretrigger, trigger_source, _edge, _level."""

    @abc.abstractmethod
    def fetch(self, signals: Sequence[str]) -> None:
        """Loads the incident of the black box, which has these signals, into the recorder for the
        next reading. Raises Refused if there is no incident."""

    @abc.abstractmethod
    def recording(self, timeout_s: float) -> Recording:
        """Waits up to timeout_s of the axis' time for the armed recording and returns it. The
        recorder is then idle, so the black box records again. Raises NoAnswer."""

    @abc.abstractmethod
    def close(self) -> None:
        """Ends the connection. Does not disable the axis: see Axis.close()."""

    def unfed(self, values: Mapping[str, int]) -> AbstractContextManager[Any]:
        """Context in which a WatchdogKeeper does not overwrite a watchdog that is among the
        values."""
        keeper = self._keeper
        if isinstance(keeper, WatchdogKeeper) and {"watchdog", "0x2302"} & values.keys():
            unchanged: AbstractContextManager[Any] = keeper.unchanged
            return unchanged
        return contextlib.nullcontext()

    def _end_keeper(self) -> None:
        if self._keeper:
            self._keeper.close()
            self._keeper = None


class Live(Protocol):
    """The part of axis.Axis that operations use."""

    link: Link

    def get(self, *names: str) -> dict[str, Any]:
        """{name: engineering value or text of an enumeration}."""

    def read(self, name: str) -> Any:
        """The value of one object."""

    def set(self, **values: Any) -> None:
        """Writes engineering values or texts of enumerations."""

    def put_back(self, **values: Any) -> None:
        """Writes values that the axis had before."""

    def wait_for(
        self,
        holds: Callable[[dict[str, Any]], Any],
        names: Sequence[str],
        what: str,
        timeout_s: float = 5.0,
    ) -> dict[str, Any]:
        """Reads names until holds({name: value}) is True."""

    def about(self) -> str:
        """The state of the axis as text."""

    def enable(self, mode: str | int, **parameters: Any) -> None:
        """Enables the axis in a mode of operation."""

    def off(self) -> None:
        """Disables the axis and waits."""

    def move(self, position: int | str, timeout_s: float = 20.0) -> dict[str, Any]:
        """Moves to a position in user units of the axis."""


class RecorderLink(Link):
    """A connection that accesses the recorder of the axis by its objects."""

    _armed: tuple[tuple[str, ...], int] | None = None  # signals, decimation

    @abc.abstractmethod
    def _samples(self, signals: Sequence[str]) -> RawSamples:
        """(n, len(signals)) int64: content of the recorder after a recording. Raises NoAnswer."""

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
            raise Refused(f"{self.where}: expected a recording that was armed, there is none")
        signals, decimation = self._armed
        trigger = self.read(["recorder_trigger_index"])["recorder_trigger_index"]
        raw = self._samples(signals)
        self.write({"recorder_arm": 0})
        return Recording(signals, raw, decimation, trigger)

    def _wait_recorded(self, timeout_s: float, poll_s: float = 0.02) -> None:
        passed = 0.0
        while True:
            raw = self.read(["recorder_state"])["recorder_state"]
            state = BY_NAME["recorder_state"].enum[raw]
            if state == "done":
                return
            if state == "idle":
                raise Refused(f"{self.where}: the recording was stopped")
            if passed >= timeout_s:
                raise NoAnswer(
                    f"{self.where}: expected a recording within {timeout_s:g} s, its recorder is "
                    f"{state}" + ("; its trigger has not fired" if state == "armed" else "")
                )
            self.wait(poll_s)
            passed += poll_s


def _address(name: str) -> int:
    """CANopen index times 256 plus sub-index, the form in which the recorder's channels are set."""
    known = BY_NAME[name]
    return known.index << 8 | known.sub


def unsigned(name: str, raw: int) -> int:
    """The unsigned value of a raw value that was received as a signed 32-bit word."""
    return raw + 2**32 if raw < 0 and BY_NAME[name].type == "u32" else raw


def _recorder_writes(signals: Sequence[str], settings: Mapping[str, int]) -> dict[str, int]:
    """{object: raw value} to write to the stopped recorder before it is armed."""
    channels = [_address(name) for name in signals] + [0] * (8 - len(signals))
    defaults = {"decimation": 1, "pretrigger": 0, "length": 0, "trigger_edge": 0}
    return {
        **{f"recorder_signal_{i + 1}": value for i, value in enumerate(channels)},
        **{f"recorder_{name}": value for name, value in {**defaults, **settings}.items()},
    }
