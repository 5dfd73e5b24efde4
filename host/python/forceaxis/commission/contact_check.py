"""Tests whether a fitted model explains recorded touch-downs.

The residuals of each signal are averaged in blocks of several lengths. If the residuals are only
noise, the sum of squares of the blocks has a chi-square distribution. If the noise was estimated
from samples before the touch, it has an F distribution. An error of the model lasts for many
samples. Long blocks therefore show it even if the single residuals are small. The smallest
probability of all tests is multiplied by the number of tests (Bonferroni). A correct model is
therefore rejected at most as often as the p value states.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from forceaxis.commission.contact_data import Floats
from forceaxis.commission.contact_likelihood import ContactProblem, Joined

BLOCKS = (1, 4, 16)  # numbers of samples in a block


@dataclass(frozen=True)
class StretchCheck:
    """The test of one signal in one touch-down. `p`: probability of residuals that are at least as
    large, if the model is correct. The worst block of residuals is the one that is farthest from
    the model. `worst_s`: time of this block in s after the start of the touch-down.
    `worst_deviations`: its distance from the model in standard deviations."""

    touch: str
    signal: str
    p: float
    rms_deviations: float
    worst_s: float
    worst_deviations: float


@dataclass(frozen=True)
class ModelCheck:
    """The test of a model. `p`: probability that any signal has residuals that are at least as
    large, if the model is correct. `stretches`: the tests of each signal in each touch-down, sorted
    with the worst first."""

    p: float
    stretches: tuple[StretchCheck, ...]


def _tail(blocks: Floats, fitted: float, free: int) -> float:
    """Returns the probability that the sum of squares of the block means is at least as large as
    observed. `fitted`: number of parameters that were fitted to the blocks. `free`: number of
    samples from which the noise was computed."""
    degrees = max(len(blocks) - fitted, 1.0)
    total = float(np.sum(blocks**2))
    if free > 0:
        return float(special.fdtrc(degrees, free, total / degrees))
    return float(special.chdtrc(degrees, total))


def blocks_of(residuals: Floats, spread: Floats, length: int) -> Floats:
    """Returns the mean residual of each block, in standard deviations. In each mean, the residuals
    are weighted by their accuracy. `length`: number of samples of a block."""
    ends = np.arange(0, len(residuals), length)
    sums = np.add.reduceat(residuals / spread, ends)
    return np.asarray(sums / np.sqrt(np.add.reduceat(spread**-2, ends)))


def check(problem: ContactProblem, point: Floats) -> ModelCheck:
    """Tests whether the most likely plant of the posterior explains the touch-downs."""
    every_residual = problem.whitened(problem.predict(point[None]))[0]
    stretches, found = [], []
    cut = len(problem.force.values)
    signals = {
        "force": (problem.force, every_residual[:cut]),
        "position": (problem.position, every_residual[cut:]),
    }
    used = len(problem.force.values) + len(problem.position.values)
    for signal, (joined, residuals) in signals.items():
        if not joined.parts:
            continue
        every: dict[int, list[Floats]] = {length: [] for length in BLOCKS}
        free = sum(joined.free)
        for (touch, begin, end), count in zip(joined.parts, joined.free, strict=True):
            share = problem.size * (end - begin) / used
            own = {
                length: blocks_of(residuals[begin:end], joined.spread[begin:end], length)
                for length in BLOCKS
            }
            for length, blocks in own.items():
                every[length].append(blocks)
            tails = [_tail(b, share, count) for b in own.values()]
            stretches.append(
                _stretch(problem, signal, joined, touch, own, min(1.0, min(tails) * len(BLOCKS)))
            )
        share = problem.size * len(residuals) / used
        found += [_tail(np.concatenate(b), share, free) for b in every.values()]
    return ModelCheck(
        min(1.0, min(found) * len(found)), tuple(sorted(stretches, key=lambda one: one.p))
    )


def _stretch(
    problem: ContactProblem,
    signal: str,
    joined: Joined,
    touch: int,
    blocks: dict[int, Floats],
    p: float,
) -> StretchCheck:
    length, worst = max(
        ((length, int(np.argmax(np.abs(b)))) for length, b in blocks.items()),
        key=lambda one: abs(blocks[one[0]][one[1]]),
    )
    data = problem.data.touches[touch]
    samples = data.force if signal == "force" else data.position
    assert samples is not None
    at = samples.at[min(worst * length + length // 2, len(samples.at) - 1)]
    return StretchCheck(
        data.name, signal, p, float(np.sqrt(np.mean(blocks[1] ** 2))),
        float(at / problem.data.rate_hz), float(abs(blocks[length][worst])),
    )  # fmt: skip
