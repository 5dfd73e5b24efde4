"""Access to a simulated axis. The firmware and the plant of an experiment run in this process, in
simulated time."""

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from forceaxis import _core
from forceaxis.axis.link import (
    COMMAND_SOURCES,
    FORCE_SCALE_TOLERANCE,
    REASONS,
    TICKS_PER_S,
    RawSamples,
    RecorderLink,
    Refused,
    reason,
    unsigned,
)
from forceaxis.axis.parameter_file import engineering
from forceaxis.bus.state_names import enum
from forceaxis.objects import BY_NAME, OBJECTS

if TYPE_CHECKING:
    from forceaxis._core import ConverterTable

# Number of ticks between two writes of the watchdog.
# 75 ticks are 50 ms, and the watchdog time is 500 ms.
FEED_TICKS = 75
WATCHDOG = BY_NAME["watchdog"].number
SAVES = frozenset({"store_all", "store_parameters"})  # commands that save all parameters
# The parameters that an axis can store. A change of another one clears the date of its
# configuration, so this date says nothing of its own.
STORED = [o.name for o in OBJECTS if o.stored and not o.name.startswith("configuration_")]


class SimLink(RecorderLink):
    """The simulated axis of an experiment. Until a client acquires the axis, the commands in the
    tables [[at]] of the experiment control the axis. If the experiment has no such tables, the axis
    stays disabled.

    store: file of the parameter store, created if it does not exist. The axis begins with what it
    has stored. If it has stored nothing, it begins with the values in [firmware] of the experiment.
    An override replaces both. Raises InputError.
    """

    source = COMMAND_SOURCES.index("lcm")

    def __init__(
        self, experiment: str | Path, overrides: Sequence[str] = (), store: str | Path = ""
    ) -> None:
        given = {text.split("=")[0] for text in overrides}
        still = [] if "firmware.mode" in given else ["firmware.mode=disabled"]
        self.axis = _core.LiveAxis(str(experiment), [*overrides, *still], str(store))
        self.where = f"the simulated axis of {experiment}"
        self.store = store  # file of the parameter store of the axis; "" means no file
        self._owned = False
        # in this tick, the firmware reads the sensors of the plant for the first time
        self.axis.step(1)
        converters = _core.inputs(str(experiment), list(overrides))["converters"]
        # Raw values that the axis has at its next power-up, and those that a save is writing.
        self._at_power_up = self.read(STORED)
        self._saving: dict[str, int] | None = None
        self.warning = self._scale_warning(converters.get("adc0"))
        if encoder := converters.get("encoder"):
            self.counts_per_metre = 1 / abs(encoder["per_code"])

    def _scale_warning(self, reading: "ConverterTable | None") -> str | None:
        """Returns a warning of one line if `force_scale` of the axis differs from the scale of the
        force sensor in the model. Returns None if they agree."""
        if reading is None:
            return None
        has = self.read_one("force_scale") * 1e-6
        sensor = abs(reading["per_code"]) * 2 ** (reading["bits"] - 8)
        if abs(has / sensor - 1) < FORCE_SCALE_TOLERANCE:
            return None
        where = f"{self.where} with the store {self.store}" if self.store else self.where
        return (
            f"{where}: expected force_scale {sensor:.6g} N/count as its model's sensor has, "
            f"got {has:.6g}: its newtons are wrong by a factor of {sensor / has:.3g}; give "
            f"[firmware] force_scale = {round(sensor * 1e6)}, and store it if the axis has another "
            "stored value"
        )

    def read(self, names: Iterable[str]) -> dict[str, int]:
        found = {}
        for name in names:
            try:
                found[name] = unsigned(name, self.axis.read(BY_NAME[name].number))
            except KeyError as error:
                raise Refused(f"{name}: {REASONS[int(error.args[0])]}") from None
        return found

    def _end_save(self) -> None:
        """Takes the values of the last save as those of the next power-up if it has succeeded."""
        if self._saving is not None:
            state = enum("store_state", self.read_one("store_state"))
            if state == "saved":
                self._at_power_up = self._saving
            if state != "saving":
                self._saving = None

    def forgets(self) -> dict[str, float]:
        self._end_save()
        now = self.read(STORED)
        return {
            name: engineering(BY_NAME[name], raw)
            for name, raw in self._at_power_up.items()
            if now[name] != raw
        }

    def text(self, index: int) -> str | None:
        return {0x1008: "simulator", 0x100A: _core.FIRMWARE_VERSION}.get(index)

    def write(self, values: Mapping[str, int]) -> None:
        for name, raw in values.items():
            if name in SAVES:
                self._end_save()
            error = self.axis.write(BY_NAME[name].number, raw)
            if error:
                raise Refused(f"{name}: {reason(name, error)}")
            if name in SAVES:
                self._saving = self.read(STORED)
            self.axis.step(1)  # a written value takes effect in the next tick, as with a real bus

    def acquire(self) -> None:
        self.axis.end_schedule()  # after acquire(), only the owner commands the axis
        self.write({"command_source": self.source})
        self._owned = True

    def release(self) -> None:
        self.write({"command_source": 0})
        self._owned = False

    def wait(self, seconds: float) -> None:
        ticks = max(1, round(seconds * TICKS_PER_S))
        while ticks > 0:
            self.axis.step(min(ticks, FEED_TICKS))
            ticks -= FEED_TICKS
            if self._owned:
                self.axis.write(WATCHDOG, self.axis.read(WATCHDOG))

    def _samples(self, signals: Sequence[str]) -> RawSamples:
        count = self.read_one("recorder_count")
        raw = self.axis.samples(0, count, len(signals)).astype(np.int64)
        for i, name in enumerate(signals):
            if BY_NAME[name].type == "u32":
                raw[:, i] %= 2**32
        return raw

    def close(self) -> None:
        """Deletes the simulated axis. This closes the file of its parameter store, unless the
        caller still has a reference to the object `axis`."""
        self._owned = False
        # The attribute `axis` is missing if the connection was already closed.
        with contextlib.suppress(AttributeError):
            del self.axis
