"""Root loci of force loops, and arrays of poles and zeros."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from forceaxis.errors import ParameterError
from forceaxis.linear.equations import Numbers, Roots
from forceaxis.linear.limits import AnalysedLoop
from forceaxis.linear.request import LoopRequest, varied
from forceaxis.linear.stability import Crossing, Limit, Loop
from forceaxis.linear.system import System
from forceaxis.results import json_field


@dataclass(frozen=True)
class Array:
    """Poles and zeros of one transfer function in 1/s."""

    label: str
    poles: Roots
    zeros: Roots


def pairs(roots: Iterable[complex]) -> list[list[float] | None]:
    """Returns complex roots as [real part, imaginary part] for JSON. A root at infinity is None."""
    return [[float(s.real), float(s.imag)] if np.isfinite(s) else None for s in roots]


def array(system: System, label: str = "") -> Array:
    """Returns the poles and zeros in 1/s of a System with one input and one output."""
    poles, zeros = system.poles_s(), system.zeros_s()
    return Array(label, poles[np.isfinite(poles)], zeros[np.isfinite(zeros)])


@dataclass(frozen=True)
class LocusTable:
    """A root locus for the JSON output. `branches`, `poles` (of the open loop) and `zeros` are
    roots in 1/s as [real part, imaginary part], or None for a root at infinity. Each branch has one
    root for each of `gains`, which are in `unit`. For the other fields, see stability.Limit."""

    label: str
    unit: str
    gains: Numbers
    branches: list[list[list[float] | None]]
    poles: list[list[float] | None]
    zeros: list[list[float] | None]
    critical_gain: float | None
    frequency_hz: float | None
    reason: str | None
    known_to: float | None
    crossings: list[Crossing]


@dataclass(frozen=True, kw_only=True)
class LocusResult:
    """Root loci of one force loop, one root locus for each choice of parameter values."""

    loop: AnalysedLoop = json_field(inline=True)
    loci: list[LocusTable]


@dataclass(frozen=True)
class Locus:
    """A root locus: the closed-loop poles as a function of the gain (`branches`, an array (gains,
    poles) in 1/s), and the gains at which a pole crosses the stability boundary."""

    label: str
    gains: Numbers
    branches: Roots
    ends: Array  # poles and zeros of the open loop in 1/s
    crossings: list[Crossing]  # all gains at which a closed-loop pole is on the stability boundary
    limit: Limit
    unit: str  # unit of the gain k
    codes: float | None  # value of the object force_gain, in DAC codes per 8-bit count, for k = 1
    span_hz: float
    at_gain: Roots  # closed-loop poles in 1/s at the gain that the plot marks

    def table(self) -> LocusTable:
        """Returns the root locus as a LocusTable for the JSON output."""
        return LocusTable(
            label=self.label,
            unit=self.unit,
            gains=self.gains,
            branches=[pairs(branch) for branch in self.branches.T],
            poles=pairs(self.ends.poles),
            zeros=pairs(self.ends.zeros),
            critical_gain=self.limit.gain,
            frequency_hz=self.limit.frequency_hz,
            reason=self.limit.reason or None,
            known_to=self.limit.known_to,
            crossings=self.crossings,
        )


def span_of(ends: Array, critical_hz: float | None) -> float:
    """Returns the half-width in Hz of a plot that shows the poles and zeros of the structure.

    The plot contains the crossing of the stability boundary, and all lightly damped poles and zeros
    up to three times the frequency of this crossing. Lightly damped means a damping ratio below
    0.3. The electrical poles of the motor are outside of the plot, as in 4.3.
    """
    roots = np.concatenate([ends.poles, ends.zeros])
    light = roots[(np.abs(roots.real) < 0.3 * np.abs(roots)) & (np.abs(roots) > 0)]
    natural = np.abs(light) / (2 * np.pi)
    if critical_hz:
        return float(1.35 * max([critical_hz, *natural[natural < 3 * critical_hz]]))
    natural = natural if len(natural) else np.abs(roots) / (2 * np.pi)
    return 1.35 * float(natural.max(initial=1.0))


# A pole at z = 0 is -infinity in 1/s. The decorator suppresses the warning of NumPy about it.
@np.errstate(divide="ignore", invalid="ignore")
def locus(
    loop: Loop, label: str = "", span_hz: float | None = None, gain: float | None = None
) -> Locus:
    """Returns the root locus of a `stability.Loop`. The steps of the gain are small inside a plot
    of the half-width `span_hz`, which is by default the result of span_of().

    gain: gain in the unit of the loop at which the closed-loop poles are marked.
    """
    if span_hz is not None and not (np.isfinite(span_hz) and span_hz > 0):
        raise ParameterError("span_hz", f"expected a number > 0, got {span_hz:g}")
    ends = array(loop.open, label)
    limit, crossings = loop.limit(), loop.crossings()
    span = span_hz or span_of(ends, limit.frequency_hz)
    # A branch of the root locus crosses the edge of the plot at the gain 1 / |L|.
    # Gains far above the gain at which a branch crosses the edge of the plot are not drawn.
    edge = 2 * np.pi * span
    side = np.linspace(0, 1, 24)
    around = np.concatenate(
        [edge * (0.5 + 1j * side), edge * (-1 + 1j * side), edge * (-1 + 1.5 * side + 1j)]
    )
    at = around if loop.open.dt is None else np.exp(around * loop.open.dt)
    with np.errstate(divide="ignore"):
        needed = 1 / np.abs(loop.open.at(at))
    high = 1.5 * float(np.sort(needed[np.isfinite(needed)])[-3])
    shown = [c.gain for c in crossings if c.frequency_hz is not None and c.frequency_hz < span]
    high = max([high, 3 * (limit.gain or 0), *(1.2 * k for k in shown if k < 1e6 * high)])
    low = 1e-5 * min([high, *shown])
    gains = np.concatenate([[0.0], np.geomspace(low, high, 150), shown])
    gains = np.unique(gains[gains <= high])
    # In each pass, gains are added where a pole moves far from one gain to the next.
    for _ in range(6):
        branches = loop.locus(gains)
        inside = np.abs(branches) < 1.6 * edge
        moved = np.abs(np.diff(branches, axis=0))
        far = (moved > edge / 120) & (inside[1:] | inside[:-1])
        rough = np.flatnonzero(far.any(axis=1))
        if not len(rough) or len(gains) > 1500:
            break
        middle = (gains[rough] + gains[rough + 1]) / 2
        gains = np.sort(np.concatenate([gains, middle]))
    branches = loop.locus(gains)
    marked = loop.closed_poles(gain) if gain is not None else np.zeros(0, complex)
    return Locus(
        label, gains, branches, ends, crossings, limit, loop.unit, loop.codes_per_gain, span, marked
    )


def loci(
    found: Sequence[Loop],
    labels: Sequence[str],
    span_hz: float | None = None,
    gains: Sequence[float | None] | None = None,
) -> list[Locus]:
    """Returns a root locus for each force loop. All root loci have the same half-width `span_hz`,
    by default the largest half-width that one of the loops needs."""
    if span_hz is None:
        span_hz = max(span_of(array(loop.open), loop.limit().frequency_hz) for loop in found)
    gains = gains or [None] * len(found)
    return [
        locus(loop, label, span_hz, gain)
        for loop, label, gain in zip(found, labels, gains, strict=True)
    ]


def loci_of(
    request: LoopRequest, vary: Sequence[str] = (), span_hz: float | None = None
) -> tuple[list[Locus], LocusResult]:
    """Returns (root loci, result). There is one root locus for each combination of the values in
    the texts `vary`, which have the form NAME=VALUE,VALUE. `span_hz`: as in loci()."""
    runs = varied(request.overrides, vary)
    found = [replace(request, overrides=values).loop() for _, values in runs]
    gains = [request.gain_of(loop) for loop in found]
    every = loci(found, [label for label, _ in runs], span_hz, gains)
    return every, LocusResult(loop=AnalysedLoop.of(found[-1]), loci=[one.table() for one in every])
