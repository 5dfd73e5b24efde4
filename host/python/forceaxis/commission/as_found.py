"""Saves the objects of an axis to a file before a run, and restores the objects after the run.

    with restoring(AxisFolder(axis, "out/tuned", say)):

The file is written before the first object of the axis is changed. If the run is killed or loses
its connection, the file remains. The next run in the same folder then begins by writing the saved
values to the axis.
"""

import contextlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.axis import actions, parameter_set
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.bus.state_names import enum
from forceaxis.commission.refusal import ORPHANED
from forceaxis.objects import BY_NAME
from forceaxis.results import from_json, to_json

if TYPE_CHECKING:
    from forceaxis.results import Convertible

T = TypeVar("T", bound="Convertible")
RawValues = dict[str, int]  # {name of the object: its raw value}
Say = Callable[[str], None]  # function that shows one text line about an action on the axis

# Raw value of the object `command_source` while the axis has no owner.
NO_OWNER = BY_NAME["command_source"].enum.index("canopen")
RECORDER_OBJECTS = tuple(
    n for n, o in BY_NAME.items() if n.startswith("recorder_") and o.access == "rw"
)
# Objects that are not parameters but that a measurement writes.
# Other clients may have written these objects before the measurement.
MEASUREMENT_OBJECTS = (
    "modes_of_operation",
    "target_force",
    *RECORDER_OBJECTS,
    *(
        name for name, known in BY_NAME.items()
        if name.startswith("excitation_") and known.access == "rw" and name != "excitation_run"
    ),
)  # fmt: skip


@dataclass(frozen=True)
class FolderFile(Generic[T]):
    """Describes a JSON file in a folder: its name, the type of its content, and a text that tells
    the user what to do if the file is damaged or missing."""

    name: str
    kind: type[T]
    remedy: str = "delete this file, so that `tune` repeats the step"

    def read(self, folder: Path) -> T | None:
        """Returns the content of the JSON file. Returns None if the file does not exist or contains
        the JSON value null. Raises InputError for a damaged file."""
        file = folder / self.name
        if not file.exists():
            return None
        with files.parsing(file, "a JSON file that a tuning has written", self.remedy):
            table = files.json_of(file.read_text(encoding="utf-8"))
        try:
            return None if table is None else from_json(self.kind, table, str(file))
        except InputError as error:
            raise InputError(f"{error}; {self.remedy}") from None

    def required(self, folder: Path) -> T:
        """Returns the content of a file that must exist. Raises InputError for a missing or damaged
        file."""
        content = self.read(folder)
        if content is None:
            raise InputError(
                f"{folder / self.name}: expected a file of an earlier run, but this file is "
                f"missing; {self.remedy}"
            )
        return content

    def write(self, folder: Path, content: T) -> None:
        """Writes the complete content of the JSON file."""
        text = json.dumps(to_json(content), indent=2, allow_nan=False)
        with paths.replacing(folder, self.name) as (file,):
            file.write_text(text + "\n", encoding="utf-8")


@dataclass(frozen=True)
class AxisState:
    """Saved objects of an axis before a run. `axis`: raw values of the objects that identify the
    axis. `values`: raw values of the objects that the run may change."""

    axis: RawValues
    values: RawValues


FOUND = FolderFile(
    "found.json", AxisState,
    "switch the axis off and on, which restores the values that a killed run had changed, then "
    "delete that file",
)  # fmt: skip


LEFT_TO_NEXT_RUN = f"the next run restores the previous values of the axis from {FOUND.name}"


def say_nothing(text: str) -> None:
    """Ignores a text line. Used by callers that do not show actions on the axis."""


class AxisFolder:
    """A folder with JSON files about one axis, which this program owns and which is disabled.
    say(text) shows an action on the axis.

    `coasted` is True if a killed run left the axis enabled. Such an axis may have come to rest at
    another position.
    """

    def __init__(self, axis: Axis, folder: str | Path, say: Say = say_nothing) -> None:
        self.axis, self.folder, self.say = axis, Path(folder), say
        self.coasted = False


def read(axis: Axis) -> RawValues:
    """Reads the parameters of the axis and the MEASUREMENT_OBJECTS. Returns {object: raw value}.
    The consumer heartbeats are not included, because the connection sets these objects. Raises
    Refused, NoAnswer."""
    set_up = axis.link.read([name for name in MEASUREMENT_OBJECTS if axis.link.reaches(name)])
    found = parameter_set.read(axis) | set_up
    return {n: raw for n, raw in found.items() if not n.startswith("consumer_heartbeat_")}


@contextlib.contextmanager
def restoring(folder: AxisFolder) -> Iterator[None]:
    """Context that restores the values of the axis at the end of the block, also after an
    exception.

    The restored values are those at the beginning of the block. If replace_saved() was called, its
    values are restored instead. No value is written if the axis does not answer or has another
    owner. Raises InputError if the file in the folder belongs to another axis.
    """
    _recover(folder)
    new = not folder.folder.exists()
    FOUND.write(folder.folder, AxisState(_identity(folder.axis), read(folder.axis)))
    try:
        yield
    finally:
        try:
            put_back(folder)
        except NoAnswer:
            folder.say(f"the axis does not answer: {LEFT_TO_NEXT_RUN}")
        except Refused as error:
            folder.say(f"{error}: {LEFT_TO_NEXT_RUN}")
        else:
            (folder.folder / FOUND.name).unlink()
            if new and not any(folder.folder.iterdir()):
                folder.folder.rmdir()


def replace_saved(folder: AxisFolder, values: RawValues) -> None:
    """Replaces the raw values that restoring() writes to the axis at the end of the
    `with` block."""
    held = FOUND.required(folder.folder)
    FOUND.write(folder.folder, AxisState(held.axis, held.values | values))


def put_back(folder: AxisFolder) -> int:
    """Disables the axis and restores the saved values (file FOUND). Writes only objects whose
    values differ. Returns the number of written objects. Raises Refused, NoAnswer."""
    axis, held = folder.axis, FOUND.required(folder.folder).values
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
    held, axis = FOUND.read(folder.folder), folder.axis
    if held is None:
        return
    known = _identity(axis)
    if any(held.axis.get(name, value) != value for name, value in known.items()):
        raise InputError(
            f"{folder.folder / FOUND.name}: expected a folder with values of the axis {known}, got "
            f"a folder with values of the axis {held.axis} that a killed run left; give another "
            "folder"
        )
    (raw,) = axis.link.read(["fault"]).values()
    fault = enum("fault", raw)
    if fault in ORPHANED:
        axis.reset_fault()
        axis.link.wait(0.05)
        folder.say(f"the previous run was killed: the fault {fault} that it left is reset")
        # A fault has disabled the axis, but the axis may still move without power.
        actions.wait_to_stand(axis)
        folder.coasted = True
    count = put_back(folder)
    if count:
        folder.say(f"the previous run was killed: {count} objects have their earlier values again")
