"""Bandwidths and margins of many force loops of a set of plants. They are computed in C++, in a
fraction of a millisecond for each plant.

`over.figures` computes the same values as eigenvalue problems, which miss no crossing and need 3 to
40 ms. The C++ evaluation (sim/linear/law_grid.hpp) starts from a grid of frequencies that is dense
near resonances. It then searches for the roots and peaks between the points of the grid. `over`
finds the worst plants of a set with this evaluation, and computes the result from eigenvalues.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from forceaxis import _core
from forceaxis.linear.bank import TICK_S, Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import Member, PlantSet
from forceaxis.linear.stability import Loop
from forceaxis.linear.system import find_model
from forceaxis.linear.working import working

DELAYS = {"zoh": 0, "zoh+1": 1}  # {timing: delay in ticks}
DAMPING_MIN = 0.05  # smallest pole damping of a filter section that C++ can evaluate
# {name of a bandwidth or margin: True if its largest value is the worst value}
FIGURES = {
    "fS_Hz": False,
    "fT_Hz": False,
    "Ms": True,
    "gain_margin": False,
    "phase_margin_deg": False,
}


@dataclass(frozen=True)
class Figures:
    """Bandwidths and margins of one force loop at one gain. For an unstable loop, only the field
    `stable` has a meaning. The other fields are then None or False."""

    stable: bool
    # Bandwidth of the sensitivity function S in Hz.
    # fS is None if |S| stays below -3 dB, and 0 if |S| is above -3 dB at frequency 0.
    fS_Hz: float | None = None
    # Bandwidth of the closed loop T in Hz.
    # fT is None if |T| stays above -3 dB, and 0 if |T| is never above -3 dB.
    fT_Hz: float | None = None
    Ms: float | None = None  # largest |S| for frequencies up to half the tick rate
    # Factor by which the gain can rise until a pole reaches the stability boundary.
    # The gain margin is None if no crossing is known up to the factor `known_to`.
    gain_margin: float | None = None
    # The phase margin with the smallest magnitude, in degrees. None if |L| is nowhere 1.
    phase_margin_deg: float | None = None
    sag: bool = False  # True if |T| is below -3 dB at a frequency below the bandwidth fS
    # Gain factor above which rounding errors hide crossings of the stability boundary.
    # The factor is None if rounding errors hide no crossing.
    known_to: float | None = None

    def badness(self, name: str) -> float:
        """Returns a number for the bandwidth or margin `name` that is larger for a worse value. For
        an unstable loop, this number is infinite."""
        if not self.stable:
            return math.inf
        value = getattr(self, name)
        if value is None:
            return -math.inf
        if name == "phase_margin_deg":
            return float(-abs(value))
        return float(value if FIGURES[name] else -value)


def law_shape(bank: Bank) -> _core.LawShape:
    """Returns a filter bank with the gain 1 as an argument for the functions in C++."""
    sections = [(s[0], s[1], s[2], s[3], s[4]) for s in bank.sections]
    return _core.LawShape(bank.integral_rad_per_s, sections)


def law_grid(
    model: _core.ModelFile, plants: PlantSet, members: Sequence[Member], timings: Sequence[str],
    density: float = 1.0, threads: int = 1, all_phases: bool = False,
) -> _core.LawGrid:  # fmt: skip
    """Returns the frequency responses of some plants of a set on grids of frequencies, see
    _core.LawGrid."""
    path = str(find_model(plants.model))
    keys = []
    for member in members:
        overrides = {**plants.overrides, **member.values}
        keys.append((overrides, working(path, overrides, member.modes).modes))
    return _core.LawGrid(
        model, keys, [DELAYS[timing] for timing in timings], density, TICK_S, threads, all_phases
    )


class Responses:
    """Frequency responses of the plants of a set on full grids of frequencies; see _core.LawGrid.
    The response of each plant is computed only once, because this takes longer than the evaluation
    of a law.

    plants: the set of plants. timings: names of DELAYS. all_phases: True for the responses with
    every analysed phase of the samples, if the phase of the sensor is not known. Otherwise, only
    the oldest and the newest readings are used.
    """

    def __init__(self, plants: PlantSet, timings: Sequence[str], all_phases: bool = False) -> None:
        self.plants, self.timings, self._all = plants, tuple(timings), all_phases
        self._model = _core.ModelFile(find_model(plants.model))
        self._grids: dict[Hashable, _core.LawGrid] = {}
        self._loops: dict[Hashable, Loop] = {}
        self._rows: dict[Hashable, list[list[float]]] = {}

    def loop(self, member: Member, timing: str, spec: LoopSpec) -> Loop:
        """Returns the force loop around one plant with the delay `timing`. Filter banks that differ
        only in their gain share a loop, so its gain limit is computed only once. A gain that is
        stored in this loop has no meaning."""
        if spec.bank is None:
            return self.plants.loop(member, timing, spec)
        unit = replace(spec, bank=replace(spec.bank, force_gain=1.0))
        key = member.key, timing, repr(unit)
        if key not in self._loops:
            self._loops[key] = self.plants.loop(member, timing, unit)
        return self._loops[key]

    def of(self, member: Member) -> _core.LawGrid:
        """Returns the frequency responses of one plant. They are empty if the command does not act
        on the force."""
        key = member.key
        if key not in self._grids:
            self._grids[key] = law_grid(
                self._model, self.plants, [member], self.timings, all_phases=self._all
            )
        return self._grids[key]

    def precise(
        self, member: Member, law: _core.LawShape, key: tuple[Hashable, float]
    ) -> list[list[float]]:
        """Returns the row of _core.LawGrid.precise() with each delay for one plant. `key`: (what
        defines the law, its gain in DAC codes per 8-bit count). All delays are computed together,
        so that the search with another delay takes the same rows."""
        whole = member.key, key
        if whole not in self._rows:
            self._rows[whole] = self.of(member).precise(law, [key[1]])[0].tolist()
        return self._rows[whole]

    @property
    def is_exact(self) -> bool:
        """True if bandwidths and margins are exact. This is so if the loop has one code in the
        period after which its ticks repeat. Otherwise, they are computed with a mean age of the
        readings."""
        return self.of(self.plants.nominal()[0]).exact

    @property
    def is_free(self) -> bool:
        """True if the phase between the samples of the sensor and the ticks is not known."""
        return self.of(self.plants.nominal()[0]).free

    @cached_property
    def in_all_phases(self) -> "Responses":
        """Frequency responses of the same plants, with one set of responses for each analysed phase
        of the samples."""
        return Responses(self.plants, self.timings, True)


@dataclass(frozen=True)
class PreciseLoops:
    """The force loops of a set of plants with one law and gain.

    responses: frequency responses of the plants. bank: the law. gain: gain in V/N, or None for the
    gain of the bank. timings: names of DELAYS, which must all be in `responses`.
    """

    responses: Responses
    bank: Bank
    gain: float | None
    timings: tuple[str, ...]

    @staticmethod
    def of(
        responses: Responses, timings: Sequence[str], spec: LoopSpec, gain: float | None,
        force_gain: float | None,
    ) -> "PreciseLoops | None":  # fmt: skip
        """Returns the loops, or None if the functions in C++ do not support loops of this kind. For
        the gain, see `over.worst`."""
        known = (
            spec.law in ("p", "pi", "bank") and spec.output == "reading" and not spec.free
            and spec.tick_s == TICK_S and not set(spec.parameters) - {"integral_rad_per_s"}
            and not (spec.bank and spec.bank.velocity_gain)
            and set(timings) <= set(DELAYS) and not _has_narrow_section(spec.bank)
        )  # fmt: skip
        if not known:
            return None
        bank = spec.bank or Bank(1.0, spec.parameters.get("integral_rad_per_s", 0.0))
        if gain is None and force_gain is not None:
            bank = Bank(force_gain, bank.integral_rad_per_s, 0.0, bank.sections)
        return PreciseLoops(responses, bank, gain, tuple(timings))

    def figures(self, members: Sequence[Member]) -> list[list[Figures | None]]:
        """Returns the bandwidths and margins of each plant with each delay of `timings`. The entry
        of a loop is None if the command does not act on the force, or if the loop is not known to
        be stable."""
        law, shape = law_shape(self.bank), repr(replace(self.bank, force_gain=1.0))
        delays = [self.responses.timings.index(timing) for timing in self.timings]
        found: list[list[Figures | None]] = []
        for member in members:
            grid = self.responses.of(member)
            if not grid.kept:
                found.append([None] * len(self.timings))
                continue
            gain = self.bank.force_gain
            if self.gain is not None:
                gain = self.gain / grid.count_per_code(0)
            rows = self.responses.precise(member, law, (shape, gain))
            found.append([_figures(rows[delay]) for delay in delays])
        return found


def _has_narrow_section(bank: Bank | None) -> bool:
    """Returns True if a section of a filter bank has an unstable pole, or a pole with less damping
    than DAMPING_MIN. The grids of frequencies are dense only near the roots of the plants. So a
    narrow peak of the law could lie between two points of a grid."""
    for *_, a1, a2 in bank.sections if bank else ():
        z = np.roots([1.0, a1, a2]).astype(complex)
        s = np.log(z[z != 0])
        if np.any(np.abs(z) >= 1) or np.any((s.imag != 0) & (-s.real < DAMPING_MIN * np.abs(s))):
            return True
    return False


def _figures(row: Sequence[float]) -> Figures | None:
    fS, fT, Ms, gain_margin, phase_margin, sag = row
    if math.isnan(fS):
        return None
    return Figures(
        True, _finite(fS), _finite(fT), Ms, _finite(gain_margin),
        _finite(math.degrees(phase_margin)), bool(sag),
    )  # fmt: skip


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
