"""What a run finds on an axis, kept in a file of its folder until the axis has it again.

    with kept(Folder(axis, "out/tuned", say)):

The file is there before anything is changed. That of a run that was killed, or that lost the axis,
is still there: the next run in that folder writes its values to the axis first.
"""

import contextlib
import json
from pathlib import Path

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.axis import actions, params
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.bus.state_names import BY_NAME, enum
from forceaxis.commission import tune_files
from forceaxis.commission.refusal import ORPHANED

FILE = "found.json"
NOBODY = BY_NAME["command_source"].enum.index("canopen")  # the source of an axis without an owner
RECORDER = tuple(n for n, o in BY_NAME.items() if n.startswith("recorder_") and o.access == "rw")
# Besides the parameters: what a measurement sets and other clients may have set before.
SET_UP = (
    "modes_of_operation",
    "target_force",
    *RECORDER,
    *(
        name for name, known in BY_NAME.items()
        if name.startswith("excitation_") and known.access == "rw" and name != "excitation_run"
    ),
)  # fmt: skip


class Folder:
    """JSON files about an owned, disabled Axis. say(text): a line for what is done to it. coasted:
    a run that was killed has left the axis enabled, which has come to rest somewhere else."""

    def __init__(self, axis, folder, say=lambda text: None):
        self.axis, self.folder, self.say = axis, Path(folder), say
        self.coasted = False

    def read(self, name):
        """A file's value, or None. Raises InputError for one that is damaged."""
        return tune_files.read(self.folder / name)

    def write(self, name, value):
        """Replaces a file, whole."""
        with paths.replacing(self.folder, name) as (file,):
            file.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read(axis):
    """{object: raw value} of the parameters and SET_UP, without the consumer heartbeats, which the
    link manages. Raises Refused, NoAnswer."""
    set_up = axis.link.read([name for name in SET_UP if axis.link.reaches(name)])
    found = params.read(axis) | set_up
    return {n: raw for n, raw in found.items() if not n.startswith("consumer_heartbeat_")}


@contextlib.contextmanager
def kept(folder):
    """Writes what the axis had at the beginning of the block to it at its end, whatever ends it,
    unless the axis is silent or another client's; expect() changes those values. Raises InputError
    where the folder's file is of another axis."""
    _recover(folder)
    new = not folder.folder.exists()
    folder.write(FILE, {"axis": _identity(folder.axis), "values": read(folder.axis)})
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


def expect(folder, values):
    """Replaces raw values that the axis has at the end of the block."""
    held = folder.read(FILE)
    folder.write(FILE, held | {"values": held["values"] | values})


def put_back(folder):
    """Disables the axis and writes every object that differs from the file: their number. Raises
    Refused, NoAnswer."""
    axis, held = folder.axis, folder.read(FILE)["values"]
    source = axis.link.read(["command_source"])["command_source"]
    if source not in (axis.link.source, NOBODY):
        raise Refused(f"{axis.link.where} is owned by {enum('command_source', source)}")
    if source != axis.link.source:
        axis.acquire()
    axis.off()
    now = read(axis)
    changes = {n: raw for n, raw in held.items() if n in now and now[n] != raw}
    if not changes.keys().isdisjoint(RECORDER):
        axis.link.write({"recorder_arm": 0})
    params.write(axis, changes, now)
    return len(changes)


def _identity(axis):
    names = ("node_id", "serial_number")
    return axis.link.read([name for name in names if axis.link.reaches(name)])


def _recover(folder):
    """Takes an axis over from a run that was killed in this folder."""
    held, axis = folder.read(FILE), folder.axis
    if held is None:
        return
    known = _identity(axis)
    if any(held["axis"].get(name, value) != value for name, value in known.items()):
        raise InputError(
            f"{folder.folder / FILE}: expected what this axis had, {known}, it is of "
            f"{held['axis']}, on which a run was killed; give another --out"
        )
    fault = enum("fault", axis.link.read(["fault"])["fault"])
    if fault in ORPHANED:
        axis.reset_fault()
        axis.link.wait(0.05)
        folder.say(f"the run before was killed: its fault {fault} is reset")
        actions.wait_to_stand(axis)  # disabled by the fault, it may still coast
        folder.coasted = True
    count = put_back(folder)
    if count:
        folder.say(f"the run before was killed: {count} objects are as they were before it")
