"""Why a step of commissioning ended without a result."""

from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer

# Faults of an axis whose owner is silent.
ORPHANED = ("heartbeat_lost", "source_lost")
LEFT = (
    "a tool that was killed leaves what it had changed: the same `tune` or `measure` with its "
    "folder puts that back, so does switching the axis off and on"
)


class Refusal(Exception):
    """A step's refusal; `name` is one word for programs, the text says what was found, what was
    expected and what to do, in one line; lines: what to add to the model, "" for nothing."""

    def __init__(self, name: str, text: str, lines: str = "") -> None:
        super().__init__(f"{name}: {text}")
        self.name, self.text, self.lines = name, text, lines


def of_link(axis: Axis, error: Exception) -> Refusal:
    """The Refusal that an error in a step is, by the state that the axis is in: no_answer,
    ownership, the name of a fault, or refused. A Refusal of an axis that is owned and has no fault
    is itself."""
    try:
        owner, fault = axis.get("command_source", "fault").values()
        (source,) = axis.link.read(["command_source"]).values()
    except NoAnswer:
        return Refusal("no_answer", str(error))
    text = error.text if isinstance(error, Refusal) else str(error)
    if source != axis.link.source or fault in ORPHANED:
        about = f"it belongs to {owner}, fault {fault}"
        return Refusal("ownership", f"expected to own the axis all the time, {about}: {text}")
    if fault != "none":
        return Refusal(fault, f"expected no fault: {text}")
    return error if isinstance(error, Refusal) else Refusal("refused", text)
