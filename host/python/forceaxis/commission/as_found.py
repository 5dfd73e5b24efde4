"""What a run finds on an axis, kept in a file of its folder until the axis has it again.

    with kept(AxisFolder(axis, "out/tuned", say)):

The file is there before anything is changed. That of a run that was killed, or that lost the axis,
is still there: the next run in that folder writes its values to the axis first.
"""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from forceaxis._core import InputError
from forceaxis.axis import actions, params
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.bus.state_names import BY_NAME, enum
from forceaxis.commission import tune_files
from forceaxis.commission.refusal import ORPHANED
from forceaxis.commission.tune_files import AxisState

T = TypeVar("T")
RawValues = dict[str, int]  # {object: raw value}
Say = Callable[[str], None]  # takes a line on what is done to the axis

FILE = tune_files.FOUND
NO_OWNER = BY_NAME["command_source"].enum.index("canopen")  # source of an axis without an owner
RECORDER_OBJECTS = tuple(
    n for n, o in BY_NAME.items() if n.startswith("recorder_") and o.access == "rw"
)
# Besides the parameters: what a measurement sets and other clients may have set before.
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
    """A Say that leaves the line out."""


class AxisFolder:
    """JSON files about an owned, disabled Axis. say(text): a line for what is done to it. coasted:
    a run that was killed has left the axis enabled, which has come to rest somewhere else."""

    def __init__(self, axis: Axis, folder: str | Path, say: Say = say_nothing) -> None:
        self.axis, self.folder, self.say = axis, Path(folder), say
        self.coasted = False

    def read(self, name: str, kind: type[T]) -> T | None:
        """A file as an instance of `kind`; None where there is no such file. Raises InputError for
        a damaged file."""
        return tune_files.read(self.folder / name, kind)

    def write(self, name: str, value: Any) -> None:
        """Replaces a file as a whole. value: a result or what JSON can hold."""
        tune_files.write(self.folder, name, value)

    def found(self) -> AxisState:
        """What the axis has at the end of the block. Raises InputError."""
        held = self.read(FILE, AxisState)
        if held is None:
            raise InputError(f"{self.folder / FILE}: expected that file during a run, it is gone")
        return held


def read(axis: Axis) -> RawValues:
    """{object: raw value} of the parameters and SET_UP, without the consumer heartbeats, which the
    link manages. Raises Refused, NoAnswer."""
    set_up = axis.link.read([name for name in SET_UP if axis.link.reaches(name)])
    found = params.read(axis) | set_up
    return {n: raw for n, raw in found.items() if not n.startswith("consumer_heartbeat_")}


@contextlib.contextmanager
def kept(folder: AxisFolder) -> Iterator[None]:
    """Writes what the axis had at the beginning of the block to it at its end, whatever ends it,
    unless the axis is silent or another client's; expect() changes those values. Raises InputError
    where the folder's file is of another axis."""
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
    """Replaces raw values that the axis has at the end of the block."""
    held = folder.found()
    folder.write(FILE, AxisState(held.axis, held.values | values))


def put_back(folder: AxisFolder) -> int:
    """Disables the axis and writes every object that differs from the file: their number. Raises
    Refused, NoAnswer."""
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
    params.write(axis, changes, now)
    return len(changes)


def _identity(axis: Axis) -> RawValues:
    names = ("node_id", "serial_number")
    return axis.link.read([name for name in names if axis.link.reaches(name)])


def _recover(folder: AxisFolder) -> None:
    """Takes an axis over from a run that was killed in this folder."""
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
        actions.wait_to_stand(axis)  # disabled by the fault, it may still coast
        folder.coasted = True
    count = put_back(folder)
    if count:
        folder.say(f"the run before was killed: {count} objects are as they were before it")
