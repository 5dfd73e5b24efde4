"""Class Refusal: the reason why a step of commissioning ended without a result."""

from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer

# Faults that occur if the owner of the axis does not write in time.
ORPHANED = ("heartbeat_lost", "source_lost")
REMEDY_AFTER_KILL = (
    "a tool that was killed leaves what it had changed: to restore the earlier values, run the "
    "same `tune` or `measure` with its folder again, or switch the axis off and on"
)


class Refusal(Exception):
    """Exception of a step that ended without a result.

    `name` is one word for programs. `text` states in one line what was found, what was expected
    and what to do. `lines` is TOML to add to the model, or "".
    """

    def __init__(self, name: str, text: str, lines: str = "") -> None:
        super().__init__(f"{name}: {text}")
        self.name, self.text, self.lines = name, text, lines


def of_link(axis: Axis, error: Exception) -> Refusal:
    """Converts an error of a step to a Refusal according to the state of the axis: no_answer,
    ownership, the name of a fault, or refused.

    A Refusal is returned unchanged if the axis is owned and has no fault.
    """
    try:
        owner, fault = axis.text("command_source"), axis.text("fault")
        (source,) = axis.link.read(["command_source"]).values()
    except NoAnswer:
        return Refusal("no_answer", str(error))
    text = error.text if isinstance(error, Refusal) else str(error)
    if source != axis.link.source or fault in ORPHANED:
        about = f"the owner is {owner} and the fault is {fault}"
        return Refusal(
            "ownership", f"expected this program to stay the owner of the axis, but {about}: {text}"
        )
    if fault != "none":
        return Refusal(fault, f"expected an axis without a fault, got {fault}: {text}")
    return error if isinstance(error, Refusal) else Refusal("refused", text)
