"""What carries the objects of one axis, and the errors of all that do.

A link knows raw values of named objects and the axis' own time. It owns the axis from acquire() to
release(): meanwhile it feeds the watchdog, also while it waits, and a tool that dies lets the axis
be disabled by that watchdog. Each kind is a module beside this one: sim, gateway, can, modbus.
"""

import abc
from dataclasses import dataclass, field

import numpy as np

from forceaxis.bus.state_names import BY_NAME

TICKS_PER_S = 1500


class Refused(Exception):
    """The axis, or what carries its objects, refused: the text gives the reason, `code` the SDO
    abort code, 0 without one."""

    def __init__(self, text, code=0):
        super().__init__(text)
        self.code = code


class NoAnswer(TimeoutError):
    """The axis did not answer, or what was awaited did not happen in time."""


@dataclass(frozen=True)
class Recording:
    """What the recorder held: raw values (samples, signals), each `decimation` ticks apart."""

    signals: tuple[str, ...]
    raw: np.ndarray = field(repr=False)  #: (n, len(signals)) int64; a u32 is not negative
    decimation: int = 1
    trigger_sample: int = 0  #: index of the first sample at or after the trigger

    def values(self, name):
        """A signal in engineering units, (n,)."""
        known = BY_NAME[name]
        column = self.raw[:, self.signals.index(name)]
        return column if known.scale == 1 else column * known.scale

    @property
    def time_s(self):
        """(n,) s from the trigger on."""
        samples = np.arange(len(self.raw)) - self.trigger_sample
        return samples * (self.decimation / TICKS_PER_S)


class Link(abc.ABC):
    """One axis; `where` names it in messages ("axis 1 at the gateway")."""

    where: str

    @abc.abstractmethod
    def read(self, names):
        """{name: raw value} of objects. Raises Refused, NoAnswer."""

    @abc.abstractmethod
    def write(self, values):
        """Writes {name: raw value} in order; the first that is refused ends it. Raises Refused,
        NoAnswer."""

    @abc.abstractmethod
    def acquire(self):
        """Owns the axis from now on. Raises Refused where another client does."""

    @abc.abstractmethod
    def release(self):
        """The axis is nobody's again; it has to be disabled before."""

    @abc.abstractmethod
    def wait(self, seconds):
        """Lets so much of the axis' own time pass."""

    @abc.abstractmethod
    def arm(self, signals, settings):
        """Starts a recording of up to 8 objects. settings: {recorder object without its prefix:
        raw value}, length, decimation, pretrigger, trigger_source, _edge, _level."""

    @abc.abstractmethod
    def recording(self, timeout_s):
        """Waits for the armed recording, of the axis' time: a Recording. Raises NoAnswer."""

    @abc.abstractmethod
    def close(self):
        """Ends the connection. Does not disable: see Axis.close()."""


def address(name):
    """CANopen index times 256 plus sub-index, as the recorder's channels want it."""
    known = BY_NAME[name]
    return known.index << 8 | known.sub


def unsigned(name, raw):
    """A raw value that came as a signed 32-bit word."""
    return raw + 2**32 if raw < 0 and BY_NAME[name].type == "u32" else raw


def recorder_writes(signals, settings):
    """{object: raw value} to be written while the recorder is stopped, before it is armed."""
    channels = [address(name) for name in signals] + [0] * (8 - len(signals))
    defaults = {"decimation": 1, "pretrigger": 0, "length": 0, "trigger_edge": 0}
    return {
        **{f"recorder_signal_{i + 1}": value for i, value in enumerate(channels)},
        **{f"recorder_{name}": value for name, value in (defaults | settings).items()},
    }
