"""Converts filter banks of the firmware to JSON and back."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # SciPy is not loaded at run time, because `forceaxis --help` does not need SciPy
    from forceaxis.linear.bank import Bank


@dataclass(frozen=True)
class BankFigures:
    """A filter bank in JSON. `force_gain` and `hf_gain` (gain at high frequency) are in DAC codes
    per 8-bit count. `velocity_gain` is in DAC codes per count/tick.

    Each second-order section is (b0, b1, b2, a1, a2).
    """

    force_gain: float
    integral_rad_per_s: float
    sections: tuple[tuple[float, ...], ...]
    velocity_gain: float
    hf_gain: float

    @property
    def bank(self) -> "Bank":
        """Returns the filter bank in the form that the loop analysis and the firmware
        settings use."""
        from forceaxis.linear.bank import Bank

        return Bank(self.force_gain, self.integral_rad_per_s, self.velocity_gain, self.sections)


def bank_figures(bank: "Bank") -> BankFigures:
    """Returns the gains and coefficients of a filter bank for JSON."""
    return BankFigures(
        force_gain=bank.force_gain,
        integral_rad_per_s=bank.integral_rad_per_s,
        sections=tuple(tuple(section) for section in bank.sections),
        velocity_gain=bank.velocity_gain,
        hf_gain=bank.hf_gain(),
    )
