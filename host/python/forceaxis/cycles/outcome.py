"""Outcome of the press cycle of one part. Error rates and proposed bounds are computed from such
outcomes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from forceaxis.cycles.program import Element, is_within

if TYPE_CHECKING:
    from forceaxis import _core

GOOD, BAD, ABORTED = "good", "bad", "aborted"
BY_PROGRAM = "by_program"
IDLE = "idle"  # state of an axis on which no cycle was started
# Verdicts of an evaluation element that has found a value in the curve.
# Only the verdicts on a value depend on the bounds of an evaluation element.
MEASURED = ("good", "below", "above")


@dataclass(frozen=True, slots=True)
class PartOutcome:
    """Outcome of the press cycle of one part. If the simulation has failed, only the field `error`
    is set."""

    # result of the cycle: good, bad, aborted, or the reason why there is no verdict
    state: str = ""
    outcome: str = ""  # text that says how the press cycle ended
    failed_phase: str = ""
    verdicts: Sequence[str] = ()  # verdict on each evaluation element of the cycle program
    values: Sequence[float] = ()  # value of each evaluation element in SI units
    error: str = ""

    @property
    def is_judged(self) -> bool:
        """True if the part has the verdict good or bad. It has neither if the cycle was aborted or
        has no result."""
        return self.state in (GOOD, BAD)

    @property
    def is_within_limits(self) -> bool:
        """True if the cycle ended as its program intends, and not at a limit or by a stop."""
        return self.outcome == BY_PROGRAM

    def is_good_by(self, elements: Sequence[Element], moved: Sequence[int]) -> bool:
        """Returns True if the part would be good with the bounds of `elements`. `moved`: indices of
        the evaluation elements whose bounds differ from the bounds of the simulation."""
        return (
            self.is_judged
            and self.is_within_limits
            and all(
                (verdict in MEASURED and is_within(elements[i], self.values[i]))
                if i in moved
                else verdict == GOOD
                for i, verdict in enumerate(self.verdicts)
            )
        )


def outcome_of(result: "_core.RunOutcome") -> PartOutcome:
    """Converts a result of _core.run_many to the outcome of a part."""
    if "error" in result:
        return PartOutcome(error=result["error"])
    cycle = result["cycle"]
    if cycle is None:
        return PartOutcome(error="expected an experiment with a cycle, got one without")
    return PartOutcome(
        state=cycle.state,
        outcome=cycle.outcome,
        failed_phase=cycle.failed_phase,
        verdicts=[figure.verdict for figure in cycle.figures],
        values=[figure.value for figure in cycle.figures],
    )
