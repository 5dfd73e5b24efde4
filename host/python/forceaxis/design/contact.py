"""Computes the response of a linear contact to a force set-point that rises as a ramp.

With an integral action that is slower than the loop, the force settles slowly; with a faster one,
the force overshoots. The bandwidth does not show these two effects. The set-point is a periodic
trapezoid, so that the response is a sum of harmonics.
"""

from collections.abc import Sequence

import numpy as np

from forceaxis.design.grid import Response
from forceaxis.linear.bank import TICK_S
from forceaxis.linear.stability import Loop

PERIOD_RAMPS = 30.0  # period of the trapezoidal force set-point as a multiple of the ramp time
HARMONICS = 256  # number of harmonics by which the periodic set-point is represented
POINTS = 2048  # number of instants per period at which the force is computed
OVERSHOOT_MAX = 0.055  # largest permitted overshoot as a share of the force set-point
# Largest undershoot as pairs (start in ramp times, share of the force set-point).
SHORT_MAX = ((1.25, 0.02), (1.6, 0.025))


class Ramp:
    """A ramp of the force set-point, and the plants that respond to the ramp. `loops`: force loops
    with the law p around the plants. `delays`: latencies in ticks. `ramp_s`: rise time in s."""

    def __init__(self, loops: Sequence[Loop], delays: Sequence[int], ramp_s: float) -> None:
        period = PERIOD_RAMPS * ramp_s
        k = np.arange(1, 2 * HARMONICS, 2)
        k = k[k / period < 0.49 / TICK_S]
        hz = k / period
        share = np.arange(POINTS) / POINTS * PERIOD_RAMPS  # of time in ramps
        shape = np.clip(share, 0, 1) - np.clip(share - PERIOD_RAMPS / 2, 0, 1) - 0.5
        self._harmonics = k
        self._setpoint = np.fft.rfft(shape)[k]
        rows = [loop.open.response(hz) / loop.codes_per_gain for loop in loops]
        self.plant = np.array(rows)
        angle = np.broadcast_to(2 * np.pi * hz * TICK_S, self.plant.shape)
        self.z = np.exp(1j * angle)
        self.warped = 2 / TICK_S * np.tan(angle / 2)
        self.warped_squared = self.warped**2
        self.integral = TICK_S / (1 - 1 / self.z)
        self._lag = [self.z**-delay for delay in delays]
        self._from = np.flatnonzero(share > SHORT_MAX[0][0])[0]
        held = share[self._from : POINTS // 2]
        self._short = np.where(held < SHORT_MAX[1][0], SHORT_MAX[0][1], SHORT_MAX[1][1])

    def excess(self, law: Response) -> float:
        """Returns the largest excess of the force over the permitted band about the set-point, as a
        share of the set-point; 0 if the force stays within the band.

        `law` is the frequency response of the control law including its gain, at the points z.
        """
        worst = 0.0
        for lag in self._lag:
            L = self.plant * law * lag
            spectrum = np.zeros((len(L), POINTS // 2 + 1), complex)
            spectrum[:, self._harmonics] = self._setpoint * L / (1 + L)
            value = np.fft.irfft(spectrum, axis=1)[:, : POINTS // 2] - 0.5
            short = -value[:, self._from :] - self._short
            worst = max(worst, value.max() - OVERSHOOT_MAX, short.max())
        return float(worst)
