"""The benchmark with SciPy: solve_ivp in each tick with terminal events and fixed regions between
them.

The equations are written again here, independent of the simulator; only for the cases A and B.
"""

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

State = NDArray[np.float64]
# A function of time and state with the attributes of an event of solve_ivp, and the region that is
# entered at the event, as (element, region).
Guard = tuple[Any, tuple[str, int | str]]

STEP_S = 1 / 1500
TOLERANCE = 1e-4  # the tolerance of odeint; RK45 uses the same pair of formulas
R = 0.004043
K_S, B_S = 110100.0, 16.5


class _Plant:
    """x = i, vf, xr, vr, xw, vw; regions: current feedback, amplifier, contact."""

    def __init__(self) -> None:
        self.volts = 0.0
        self.feedback, self.amplifier, self.contact = 0, 0, "apart"

    def push(self, x: State) -> float:
        return K_S * (x[2] - x[4]) + B_S * (x[3] - x[5])

    def force(self, x: State) -> float:
        return self.push(x) if self.contact == "pressed" else 0.0

    def error(self, x: State) -> float:
        return 3.9 * self.volts - x[1] - (10.0 * self.feedback if self.feedback else x[0] / 3)

    def rate(self, _t: float, x: State) -> tuple[float, ...]:
        i, vf, _xr, vr, xw, vw = x = x.tolist()
        e, side = self.error(x), self.amplifier
        vm = 15 * e if side == 0 else 30.0 * side if abs(side) == 2 else 7.5 * (e + 2 * side)
        f = self.force(x)
        return (
            (vm - 4.5 * i - 0.5 / R * vr) / 0.0158,
            942 * (4.2 * 0.039 / R * vr - vf),
            vr,
            (0.5 / R * i - 500 * vr - f) / 132.4,
            vw,
            (f - 412700 * xw - 8.25 * vw) / 6.6,
        )

    def enter(self, x: State) -> None:
        """Updates the regions for the state x after a step of the command."""
        self.feedback = int(x[0] > 30) - int(x[0] < -30)
        e = self.error(x)
        self.amplifier = sum((e > 2, e > 6)) - sum((e < -2, e < -6))

    def guards(self) -> list[Guard]:
        """[(function that falls through 0 at the end of the region, region that is entered
        then)]."""
        list_: list[Guard]
        side, list_ = self.amplifier, []
        if side > -2:
            low = {-1: -6, 0: -2, 1: 2, 2: 6}[side]
            list_.append((lambda t, x: self.error(x) - low, ("amplifier", side - 1)))
        if side < 2:
            high = {-2: -6, -1: -2, 0: 2, 1: 6}[side]
            list_.append((lambda t, x: high - self.error(x), ("amplifier", side + 1)))
        if self.feedback == 0:
            list_.append((lambda t, x: 30 - x[0], ("feedback", 1)))
            list_.append((lambda t, x: 30 + x[0], ("feedback", -1)))
        else:
            sign = self.feedback
            list_.append((lambda t, x: sign * x[0] - 30, ("feedback", 0)))
        if self.contact == "pressed":
            list_.append((lambda t, x: self.push(x), ("contact", "let go")))
        else:
            sign = 1 if self.contact == "overlap" else -1
            list_.append((lambda t, x: sign * (x[2] - x[4]), ("contact", "met")))
            if self.contact == "overlap":
                list_.append((lambda t, x: -self.push(x), ("contact", "pressed")))
        for function, _ in list_:
            function.terminal, function.direction = True, -1
        return list_

    def cross(self, element: str, into: int | str, x: State) -> None:
        if into == "let go":
            into = "overlap" if x[2] > x[4] else "apart"
        elif into == "met":
            falling = self.contact == "overlap"
            into = "apart" if falling else "pressed" if self.push(x) > 0 else "overlap"
        setattr(self, element, into)


def run(
    gain: int, setpoint_N: int, ticks: int
) -> tuple[NDArray[np.float64], NDArray[np.integer[Any]], float, int]:
    """One run: (force, ADC counts, CPU seconds, crossings) at ticks 0..ticks."""
    from scipy.integrate import solve_ivp

    plant, x, crossings = _Plant(), np.array([0, 0, -0.005, 0, 0, 0]), 0
    force, counts = [], []
    start = time.thread_time()
    for k in range(ticks + 1):
        f = plant.force(x)
        n = min(max(math.floor(f / 2 + 0.5), -128), 127)
        force.append(f)
        counts.append(n)
        if k == ticks:
            break
        code = min(max((gain * (setpoint_N - 2 * n) + 1) >> 1, -2048), 2047)
        plant.volts = code * (20 / 4096)
        plant.enter(x)
        remaining = STEP_S
        while remaining > 1e-15:
            guards = plant.guards()
            done = solve_ivp(
                plant.rate, (0, remaining), x, method="RK45", rtol=TOLERANCE, atol=TOLERANCE,
                first_step=remaining, events=[function for function, _ in guards],
            )  # fmt: skip
            x = done.y[:, -1]
            remaining -= done.t[-1]
            for (_, (element, into)), times in zip(guards, done.t_events, strict=True):
                if done.status == 1 and len(times):
                    plant.cross(element, into, x)
                    crossings += 1
    return np.array(force), np.array(counts), time.thread_time() - start, crossings
