"""Saves the objects of an axis to a file before a run and restores them to the axis after it.

    with kept(AxisFolder(axis, "out/tuned", say)):

The file is written before the first object is changed. If the run is killed or loses its
connection, the file remains. The next run in the same folder then first writes the saved values to
the axis.
"""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from forceaxis._core import InputError
from forceaxis.axis import actions, parameter_set
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.bus.state_names import BY_NAME, enum
from forceaxis.commission import tune_files
from forceaxis.commission.refusal import ORPHANED
from forceaxis.commission.tune_files import AxisState

T = TypeVar("T")
RawValues = dict[str, int]  # {object: raw value}
Say = Callable[[str], None]  # receives a line of text about an action on the axis

FILE = tune_files.FOUND
# value of command_source while the axis has no owner
NO_OWNER = BY_NAME["command_source"].enum.index("canopen")
RECORDER_OBJECTS = tuple(
    n for n, o in BY_NAME.items() if n.startswith("recorder_") and o.access == "rw"
)
# Objects besides the parameters: a measurement writes them, and other clients may have written
# them before.
SET_UP = (
    "modes_of_operation",
    "target_force",
    *RECORDER_OBJECTS,
    *(
        name for name, known in BY_NAME.items()
        if name.startswith("excitation_") and known.access == "rw" and name != "excitation_run"
    ),
)  # fmt: skip


def say_nothing(text: str) -> None:
    """Discards the line of text."""


class AxisFolder:
    """JSON files of a folder about an owned, disabled Axis. say(text): reports an action on the
    axis. coasted: a killed run left the axis enabled, so the axis has come to rest at another
    position."""

    def __init__(self, axis: Axis, folder: str | Path, say: Say = say_nothing) -> None:
        self.axis, self.folder, self.say = axis, Path(folder), say
        self.coasted = False

    def read(self, name: str, kind: type[T]) -> T | None:
        """Reads a file as an instance of `kind`; returns None if the file does not exist. Raises
        InputError for a damaged file."""
        return tune_files.read(self.folder / name, kind)

    def write(self, name: str, value: Any) -> None:
        """Replaces a complete file. value: a result or a value that JSON can represent."""
        tune_files.write(self.folder, name, value)

    def found(self) -> AxisState:
        """The values that the block restores at its end. Raises InputError."""
        held = self.read(FILE, AxisState)
        if held is None:
            raise InputError(f"{self.folder / FILE}: expected that file during a run, it is gone")
        return held


def read(axis: Axis) -> RawValues:
    """{object: raw value} of the parameters and SET_UP, without the consumer heartbeats, which the
    connection manages. Raises Refused, NoAnswer."""
    set_up = axis.link.read([name for name in SET_UP if axis.link.reaches(name)])
    found = parameter_set.read(axis) | set_up
    return {n: raw for n, raw in found.items() if not n.startswith("consumer_heartbeat_")}


@contextlib.contextmanager
def kept(folder: AxisFolder) -> Iterator[None]:
    """Restores at the end of the block, also after an exception, the values that the axis had at
    its beginning. Nothing is written if the axis does not answer or has another owner. expect()
    changes the values to restore. Raises InputError if the file in the folder belongs to another
    axis."""
    _recover(folder)
    new = not folder.folder.exists()
    folder.write(FILE, AxisState(_identity(folder.axis), read(folder.axis)))
    try:
        yield
    finally:
        try:
            put_back(folder)
        except NoAnswer:
            folder.say(f"the axis does not answer: the next run puts back what it had ({FILE})")
        except Refused as error:
            folder.say(f"{error}: the next run puts back what it had ({FILE})")
        else:
            (folder.folder / FILE).unlink()
            if new and not any(folder.folder.iterdir()):
                folder.folder.rmdir()


def expect(folder: AxisFolder, values: RawValues) -> None:
    """Replaces raw values that the block restores at its end."""
    held = folder.found()
    folder.write(FILE, AxisState(held.axis, held.values | values))


def put_back(folder: AxisFolder) -> int:
    """Disables the axis and writes every object whose value differs from the file; returns the
    number of written objects. Raises Refused, NoAnswer."""
    axis, held = folder.axis, folder.found().values
    (source,) = axis.link.read(["command_source"]).values()
    if source not in (axis.link.source, NO_OWNER):
        raise Refused(f"{axis.link.where} is owned by {enum('command_source', source)}")
    if source != axis.link.source:
        axis.acquire()
    axis.off()
    now = read(axis)
    changes = {n: raw for n, raw in held.items() if n in now and now[n] != raw}
    if not changes.keys().isdisjoint(RECORDER_OBJECTS):
        axis.link.write({"recorder_arm": 0})
    parameter_set.write(axis, changes, now)
    return len(changes)


def _identity(axis: Axis) -> RawValues:
    names = ("node_id", "serial_number")
    return axis.link.read([name for name in names if axis.link.reaches(name)])


def _recover(folder: AxisFolder) -> None:
    """Restores the values of an axis if an earlier run in this folder was killed."""
    held, axis = folder.read(FILE, AxisState), folder.axis
    if held is None:
        return
    known = _identity(axis)
    if any(held.axis.get(name, value) != value for name, value in known.items()):
        raise InputError(
            f"{folder.folder / FILE}: expected what this axis had, {known}, it is of "
            f"{held.axis}, on which a run was killed; give another folder"
        )
    (raw,) = axis.link.read(["fault"]).values()
    fault = enum("fault", raw)
    if fault in ORPHANED:
        axis.reset_fault()
        axis.link.wait(0.05)
        folder.say(f"the run before was killed: its fault {fault} is reset")
        # the fault has disabled the axis, but the axis may still coast
        actions.wait_to_stand(axis)
        folder.coasted = True
    count = put_back(folder)
    if count:
        folder.say(f"the run before was killed: {count} objects are as they were before it")
