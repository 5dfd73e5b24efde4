"""The exception Refusal, which states why a step of the commissioning ended without a result."""

from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer
from forceaxis.linear.bank import BankKeys

# Faults that occur if the owner of the axis does not write in time.
ORPHANED = ("heartbeat_lost", "source_lost")
REMEDY_AFTER_KILL = (
    "a tool that was killed leaves what it had changed: to restore the earlier values, run the "
    "same `tune` or `measure` with its folder again, or switch the axis off and on"
)


class Refusal(Exception):
    """Exception: a step of the commissioning ended without a result.

    `name` is one word by which programs can recognise the reason. `text` is one line that states
    the finding, the expectation and the remedy. `lines` is TOML text to add to the model, and
    `model` is the text of the model with these lines in their places; both may be empty.
    """

    def __init__(self, name: str, text: str, lines: str = "", model: str = "") -> None:
        super().__init__(f"{name}: {text}")
        self.name, self.text, self.lines, self.model = name, text, lines, model


class DesignAgain(Refusal):
    """A refusal of a law whose Ms on the axis is larger than predicted. A law that is designed for
    the smaller limit `ms` may pass. `why` is a sentence for the user."""

    def __init__(self, name: str, text: str, why: str, ms: float) -> None:
        super().__init__(name, text)
        self.why, self.ms = why, ms


class MeasureAgain(Refusal):
    """A refusal that goes away if the responses are measured again, with the band `band_hz` in Hz,
    with `averages` realisations, or with the force law `law`. None, 0: as before. `why` is a
    sentence for the user."""

    def __init__(
        self, name: str, text: str, why: str, *, band_hz: tuple[float, float] | None = None,
        averages: int = 0, law: BankKeys | None = None,
    ) -> None:  # fmt: skip
        super().__init__(name, text)
        self.why, self.band_hz, self.averages, self.law = why, band_hz, averages, law


def of_link(axis: Axis, error: Exception) -> Refusal:
    """Converts an exception of a step to a Refusal. The state of the axis determines the name of
    the Refusal: no_answer, ownership, the name of a fault, or refused.

    If the exception already is a Refusal, and the axis is owned and has no fault, it is returned
    unchanged.
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
            "ownership", f"expected this program to keep control of the axis, but {about}: {text}"
        )
    if fault != "none":
        return Refusal(fault, f"expected an axis without a fault, got {fault}: {text}")
    return error if isinstance(error, Refusal) else Refusal("refused", text)
