"""NumPy formulas for the figures of force laws on a grid of frequencies: the oracle of
sim/linear/law_grid.hpp. They were the product before the evaluation was written in C++."""

import math

import numpy as np
from forceaxis.design.grid import GainLimit, GridPlace
from forceaxis.linear.bank import TICK_S
from forceaxis.linear.precise import DELAYS

HALF_POWER = 0.5  # |S|^2 at -3 dB
GAIN_SHARE = 0.97  # share of the largest gain at which the bandwidth is evaluated
PERIOD_RAMPS = 30.0  # period of the trapezoidal force set-point as a multiple of the ramp time
HARMONICS = 256  # number of harmonics by which the periodic set-point is represented
POINTS = 2048  # number of instants per period at which the force is computed
OVERSHOOT_MAX = 0.055  # largest permitted overshoot as a share of the force set-point
# Largest undershoot as pairs (start in ramp times, share of the force set-point).
SHORT_MAX = ((1.25, 0.02), (1.6, 0.025))


def _warped(hz):
    return 2 / TICK_S * math.tan(math.pi * hz * TICK_S)


def _sections(numbers):
    values = [float(value) for value in np.exp(numbers)]
    return [
        (values[i], values[i + 1], values[i + 2], values[i + 3]) for i in range(1, len(values), 4)
    ]


def response(numbers, grid):
    """Returns the frequency response of a control law with the gain 1 at the points of `grid`.
    `numbers` are the logarithms of the parameters of the law's structure."""
    if not len(numbers):
        return np.ones_like(grid.plant)
    law = 1 + math.exp(numbers[0]) * grid.integral
    w, square = grid.warped, grid.warped_squared
    for zero_hz, zero_damping, pole_hz, pole_damping in _sections(numbers):
        wz, wp = _warped(zero_hz), _warped(pole_hz)
        upper = (wp / wz) ** 2 * ((wz * wz - square) + (2j * zero_damping * wz) * w)
        law *= upper / ((wp * wp - square) + (2j * pole_damping * wp) * w)
    return law


class Grid:
    """Responses of plants, taken from a LawGrid, and NumPy formulas for the figures of a law."""

    def __init__(self, grid):
        self.timings, self.members = tuple(grid.timings), grid.members
        rows = [
            (grid.core.frequency_hz(i), grid.core.response(i)) for i in range(len(grid.members))
        ]
        longest = max(len(hz) for hz, _ in rows)
        # A row with fewer frequencies is extended by copies of the last frequency.
        self.frequency_hz = np.array([np.pad(f, (0, longest - len(f)), "edge") for f, _ in rows])
        self.plant = np.array([np.pad(p, (0, longest - len(p)), "edge") for _, p in rows])
        angle = 2 * np.pi * self.frequency_hz * TICK_S
        self.z = np.exp(1j * angle)
        self.warped = 2 / TICK_S * np.tan(np.minimum(angle / 2, np.pi / 2 - 1e-9))
        self.warped_squared = self.warped**2
        self.integral = TICK_S / (1 - 1 / self.z)  # of 1 rad/s
        self.lag = [self.z ** -DELAYS[t] for t in self.timings]
        self.log_f = np.log(self.frequency_hz)

    def loops(self, law):
        """Returns (L, |L|^2) for each delay of the loop with the gain 1. `law` (m, n) is the
        frequency response of the control law with the gain 1."""
        whole = self.plant * law
        squared = whole.real**2 + whole.imag**2
        return [((whole * lag), squared) for lag in self.lag]

    def largest_gain(self, law, hf_gain, bounds):
        """Returns the largest gain at which the loops of all plants keep the bounds, and the bound
        that limits this gain. `hf_gain` is the gain of the law at high frequency if the gain of the
        law is 1."""
        best = GainLimit(bounds.hf_gain / hf_gain, "hf", None)
        for t, (L, q) in enumerate(self.loops(law)):
            for name, found in self._ends(L, q, bounds, t):
                gain, at = found
                if gain < best.gain:
                    place = GridPlace(at[0], t, float(self.frequency_hz[at]))
                    best = GainLimit(gain, name, place)
        return best

    def _ends(self, L, q, bounds, t):
        a = L.real
        ahead = np.maximum(-a, 0.0)
        share = 1 - 1 / bounds.ms[t] ** 2
        yield "ms", _first_root(ahead, share * q, share)
        # Crossings of the negative real axis; the real part at each crossing is interpolated.
        im = L.imag
        left, right = im[:, :-1], im[:, 1:]
        rows, columns = np.nonzero((left * right < 0) & (a[:, :-1] < 0) & (a[:, 1:] < 0))
        if len(rows):
            i, j = im[rows, columns], im[rows, columns + 1]
            real = a[rows, columns] + (a[rows, columns + 1] - a[rows, columns]) * i / (i - j)
            k = int(np.argmin(real))
            yield "gm", (1 / (-real[k] * bounds.gain_margin), (int(rows[k]), int(columns[k])))
        k = int(np.argmax(ahead[:, -1]))
        if ahead[k, -1] > 0:
            yield "gm", (1 / (ahead[k, -1] * bounds.gain_margin), (k, -1))
        if bounds.phase_margin_deg:
            size = np.sqrt(q)
            close = np.where(
                ahead > math.cos(math.radians(bounds.phase_margin_deg)) * size, size, 0.0
            )
            at = _highest(close)
            if close[at] > 0:
                yield "pm", (1 / close[at], at)

    def bandwidths(self, law, gain):
        """Returns the bandwidths (fS, fT) in Hz, each as an array with one row per delay of the
        loop and one column per plant.

        These are the first frequencies at which |S| rises above -3 dB and |T| falls below -3 dB. A
        frequency is 0 if |S| or |T| is beyond -3 dB at the lowest frequency of the grid.
        """
        first, falls = [], []
        for L, q in self.loops(law):
            apart = 1 + 2 * gain * L.real + gain**2 * q  # |1 + g L|^2
            first.append(self._where(1 / (HALF_POWER * apart)))
            falls.append(self._where(HALF_POWER * apart / (gain**2 * q)))
        return np.array(first), np.array(falls)

    def last_falls(self, law, gain):
        """Returns the highest frequencies in Hz at which |T| falls below -3 dB, as an array with
        one row per delay of the loop and one column per plant."""
        found = []
        for L, q in self.loops(law):
            level = gain**2 * q / (HALF_POWER * (1 + 2 * gain * L.real + gain**2 * q))
            above = level[:, ::-1] >= 1
            i = level.shape[1] - 1 - np.argmax(above, axis=1)
            j = np.minimum(i + 1, level.shape[1] - 1)
            found.append(np.where(above.any(axis=1), self._between(level, i, j), 0.0))
        return np.array(found)

    def _where(self, level):
        """Returns the first frequency of each row at which `level` exceeds 1."""
        past = level >= 1
        j = np.where(past.any(axis=1), np.argmax(past, axis=1), level.shape[1] - 1)
        found = np.where(j == 0, 0.0, self._between(level, np.maximum(j - 1, 0), j))
        return np.where(past.any(axis=1), found, self.frequency_hz[:, -1])

    def _between(self, level, i, j):
        rows = np.arange(len(level))
        low, high = np.log(level[rows, i]), np.log(level[rows, j])
        span = np.where(high == low, 1.0, high - low)
        share = np.clip(-low / span, 0, 1)
        step = self.log_f[rows, j] - self.log_f[rows, i]
        return np.asarray(np.exp(self.log_f[rows, i] + share * step))

    def peaks(self, law, gain):
        """Returns (largest |S|, largest |T|) on the grid, each as an array with one row per delay
        of the loop and one column per plant."""
        s, t = [], []
        for L, q in self.loops(law):
            apart = 1 + 2 * gain * L.real + gain**2 * q
            s.append(1 / np.sqrt(apart.min(axis=1)))
            t.append(np.sqrt((gain**2 * q / apart).max(axis=1)))
        return np.array(s), np.array(t)

    def margins(self, law, gain):
        """Returns (gain margin, phase margin in degrees), each as the smallest value over all
        plants and all delays of the loop. A margin is None if no plant has this margin."""
        factor, phase = math.inf, math.inf
        for L, q in self.loops(law):
            value = gain * L
            im, re = value.imag, value.real
            rows, columns = np.nonzero((im[:, :-1] * im[:, 1:] < 0) & (re[:, :-1] < 0))
            i, j = im[rows, columns], im[rows, columns + 1]
            at = re[rows, columns] + (re[rows, columns + 1] - re[rows, columns]) * i / (i - j)
            at = np.concatenate([at, re[:, -1]])
            at = at[(at < 0) & (at > -1)]
            factor = min(factor, np.min(-1 / at, initial=math.inf))
            size = np.log(gain**2 * q)
            rows, columns = np.nonzero(size[:, :-1] * size[:, 1:] < 0)
            i, j = size[rows, columns], size[rows, columns + 1]
            share = i / (i - j)
            turned = -value  # the angle of -value is the phase margin
            near = turned[rows, columns] * (1 - share) + turned[rows, columns + 1] * share
            phase = min(phase, np.min(np.abs(np.angle(near)), initial=math.inf))
        return (
            float(factor) if math.isfinite(factor) else None,
            math.degrees(phase) if math.isfinite(phase) else None,
        )


def _highest(values):
    row, column = np.unravel_index(int(np.argmax(values)), values.shape)
    return int(row), int(column)


def _first_root(ahead, share_q, constant):
    """Returns (gain, index of the grid point) for the smallest gain g > 0 that fulfils the equation
    constant - 2 g ahead + g^2 q' = 0 at a point of the grid. `share_q` is q' times `constant`."""
    root = ahead**2 - share_q
    real = (root >= 0) & (ahead > 0)
    if not real.any():
        return math.inf, (0, 0)
    value = np.where(real, ahead + np.sqrt(np.maximum(root, 0)), 0.0)
    at = _highest(value)
    return constant / value[at], at


class Ramp:
    """A ramp of the force set-point, and the plants that respond to the ramp. `loops`: force loops
    with the law p around the plants. `delays`: latencies in ticks. `ramp_s`: rise time in s."""

    def __init__(self, loops, delays, ramp_s):
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

    def excess(self, law):
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


def hf_gain(numbers, bank, grid):
    """The gain at high frequency of a law: as the firmware computes it, or the largest magnitude
    without the integral."""
    if not len(numbers):
        return 1.0
    law = response(numbers, grid) / (1 + math.exp(numbers[0]) * grid.integral)
    return max(bank.hf_gain(), float(np.abs(law).max()))


def evaluate(numbers, bank, grid, bounds, ramp):
    """(bandwidth in Hz, largest gain) of a law, as Grid.evaluate of the product has them. bank: the
    law with the gain 1."""
    law = response(numbers, grid)
    gain = grid.largest_gain(law, hf_gain(numbers, bank, grid), bounds).gain
    first, falls = grid.bandwidths(law, GAIN_SHARE * gain)
    value = float(first.min())
    if len(numbers):
        value = min(value, float(falls.min()))
        if ramp:
            value /= 1 + 30 * ramp.excess(gain * response(numbers, ramp))
    return value, gain


def delays(grid):
    """The delays of a grid in ticks."""
    return [DELAYS[timing] for timing in grid.timings]
