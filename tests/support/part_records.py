"""Records of simulated parts, as an axis with the same parts gives them."""

from forceaxis.cycles.part import figure_of
from forceaxis.cycles.record import PartRecord


def recorded(done, wanted, count=599, **given):
    """Records of the simulated parts."""
    made = []
    for number, one in enumerate(done.good.outcomes[:count], 1):
        elements = [
            figure_of(e, verdict, value)
            for e, verdict, value in zip(
                done.program.elements, one.verdicts, one.values, strict=True
            )
        ]
        about = {
            "state": one.state,
            "outcome": one.outcome,
            "program_crc": f"{wanted.program.crc:08X}",
        }
        made.append(PartRecord(number, 1, **{**about, "elements": elements, **given}))
    return made
