"""The part of the measured responses that the fitted model of a tuning does not explain, and the
Ms of a force law with this part.

If no model of the fit explains a measured response, the response itself still shows what the axis
does. The quotient r of measured and fitted response then multiplies the loops of all plants of the
set. With the complementary sensitivity function T of a plant, its sensitivity function becomes

    S / (1 + T (r - 1)).

The quotient has a standard error e, so that |1 + T (r - 1)| may be smaller by |T| e. The loop of a
stable plant stays stable while the quotient changes continuously from 1 to r, if 1 + s T (r - 1) is
0 at no frequency for any s from 0 to 1 (Nyquist).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from forceaxis.commission.joint_fit import JointFit, Response, Samples
from forceaxis.linear import over
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import Member, PlantSet

# AVERAGING_WIDTH: width of the mean of a quotient of responses, in logarithms of frequencies.
# SCATTER_MAX: largest mean of the squared deviations from the averaged quotient, in variances.
AVERAGING_WIDTH, SCATTER_MAX = 0.04, 2.0
RANDOM_PLANTS = 12  # number of random plants of the set, in addition to nominal and corner plants
CORNERS_MAX = 16  # largest number of corner plants
SEED = 1988
# Smallest distance from 0 of 1 + s T (r - 1) for a loop that is regarded as stable.
DISTANCE_MIN = 0.2
# Ms of a plant that may be unstable, if Ms has no bound. JSON requires a finite number.
UNSTABLE_MS = 1e3


@dataclass(frozen=True)
class Unexplained:
    """The part of a measured response that the fitted model does not explain. `real` and `imag`:
    quotient of measured and fitted response at the frequencies `frequency_hz`. `error`: standard
    error of this quotient."""

    frequency_hz: tuple[float, ...]
    real: tuple[float, ...]
    imag: tuple[float, ...]
    error: tuple[float, ...]

    def quotient(self, hz: Samples) -> Response:
        """Returns the quotient at other frequencies in Hz. It is 1 outside the measured band."""
        at, known = np.log(hz), np.log(self.frequency_hz)
        real, imag = (
            np.interp(at, known, part, left=outside, right=outside)
            for part, outside in ((self.real, 1.0), (self.imag, 0.0))
        )
        result: Response = real + 1j * imag
        return result

    def largest(self, S: Response) -> Samples:
        """Returns the largest |S| at each frequency with the quotient of this response. `S`:
        sensitivity function of a plant of the set at the frequencies. The value is UNSTABLE_MS
        where the loop may become unstable."""
        T, quotient = 1 - S, np.array(self.real) + 1j * np.array(self.imag)
        change, error = T * (quotient - 1), abs(T) * np.array(self.error)
        share = np.clip(-change.real / np.maximum(abs(change) ** 2, 1e-30), 0, 1)
        sure = abs(1 + share * change) - error > DISTANCE_MIN
        less = np.maximum(abs(1 + change) - error, 1e-9)
        result: Samples = np.where(sure, abs(S) / less, UNSTABLE_MS)
        return result


def of_fit(found: JointFit, names: Sequence[str]) -> dict[str, Unexplained]:
    """Returns what the model does not explain of each response in contact. `names`: name of each
    response of the fit."""
    problem, rows = found.problem, {}
    predictions = problem.predictions(found.at)
    for name, m, h in zip(names, problem.measured, predictions, strict=False):
        if m.free:
            continue
        own, variance = m.response / h, m.variance / abs(h) ** 2
        near = (abs(np.log(m.frequency_hz[:, None] / m.frequency_hz)) < AVERAGING_WIDTH) / variance
        mean = near @ own / near.sum(1)
        # Near a narrow mode, the quotient changes from line to line. A mean would hide this change.
        scatter = near @ abs(own) ** 2 - near.sum(1) * abs(mean) ** 2
        alike = scatter < SCATTER_MAX * (near > 0).sum(1)
        quotient = np.where(alike, mean, own)
        spread = np.sqrt(np.where(alike, 1 / near.sum(1), variance))
        rows[name] = Unexplained(
            tuple(m.frequency_hz.tolist()), tuple(quotient.real.tolist()),
            tuple(quotient.imag.tolist()), tuple(spread.tolist()),
        )  # fmt: skip
    return rows


def largest_ms(
    plants: PlantSet, bank: Bank, timings: Sequence[str], responses: Mapping[str, Unexplained]
) -> dict[str, float]:
    """Returns {delay of the loop: largest |S|} over a set of plants, with the quotients of all
    responses. `bank`: the force law. `timings`: names of the delays in loops.TIMINGS."""
    corners = plants.corners()
    if len(corners) > CORNERS_MAX:
        chosen = np.random.default_rng(SEED).choice(len(corners), CORNERS_MAX, replace=False)
        corners = [corners[i] for i in chosen]
    members: list[Member] = [*plants.nominal(), *corners]
    members += plants.random(RANDOM_PLANTS, SEED) if plants.ranges else []
    found = dict.fromkeys(timings, 0.0)
    for timing in timings:
        for member in members:
            loop = plants.loop(member, timing, LoopSpec("bank", bank=bank))
            gain = over.gain_at(loop, None, None)
            for one in responses.values():
                S = loop.sensitivity_at(gain, np.array(one.frequency_hz))
                found[timing] = max(found[timing], float(one.largest(S).max()))
    return found
