"""What a tuning finds on an axis, kept in a file of its folder until the axis has it again.

The file of a run that was killed, or that lost the axis, is still there: the next run writes its
values to the axis first.
"""

import contextlib

from forceaxis.axis import params
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.bus.state_names import BY_NAME, enum
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


def read(axis):
    """{object: raw value} of the parameters and SET_UP, without the consumer heartbeats, which the
    link manages. Raises Refused, NoAnswer."""
    set_up = axis.link.read([name for name in SET_UP if axis.link.reaches(name)])
    found = params.read(axis) | set_up
    return {n: raw for n, raw in found.items() if not n.startswith("consumer_heartbeat_")}


@contextlib.contextmanager
def kept(tuning):
    """Writes what the axis had at the beginning of the block to it at its end, whatever ends it,
    unless the axis is silent or another client's; expect() changes those values."""
    _recover(tuning)
    tuning.write(FILE, read(tuning.axis))
    try:
        yield
    finally:
        try:
            put_back(tuning)
        except NoAnswer:
            tuning.say(f"the axis does not answer: the next run puts back what it had ({FILE})")
        except Refused as error:
            tuning.say(f"{error}: the next run puts back what it had ({FILE})")
        else:
            (tuning.folder / FILE).unlink()


def expect(tuning, values):
    """Replaces raw values that the axis has at the end of the block."""
    tuning.write(FILE, tuning.read(FILE) | values)


def put_back(tuning):
    """Disables the axis and writes every object that differs from the file: their number. Raises
    Refused, NoAnswer."""
    axis, held = tuning.axis, tuning.read(FILE)
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


def _recover(tuning):
    """Takes an axis over from a run that was killed in this folder."""
    if tuning.read(FILE) is None:
        return
    fault = enum("fault", tuning.axis.link.read(["fault"])["fault"])
    if fault in ORPHANED:
        tuning.axis.reset_fault()
        tuning.axis.link.wait(0.05)
        tuning.say(f"the run before was killed: its fault {fault} is reset")
    count = put_back(tuning)
    if count:
        tuning.say(f"the run before was killed: {count} objects are as they were before it")
