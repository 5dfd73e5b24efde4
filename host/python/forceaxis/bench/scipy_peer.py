"""The benchmark case in Python with SciPy. It calls solve_ivp once for each tick. At a terminal
event, solve_ivp stops, and the equations of motion change.

This module contains the equations of the cases A and B again, independent of the simulator.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from forceaxis._core import TICKS_PER_SECOND

State = NDArray[np.float64]

STEP_S = 1 / TICKS_PER_SECOND
# error tolerance of the integration with RK45; odeint has the same tolerance and formulas
TOLERANCE = 1e-4
R_M_PER_RAD = 0.004043  # travel of the robot per angle of the motor, in m/rad
# stiffness in N/m and damping in N s/m of the force sensor
K_S_N_PER_M, B_S_NS_PER_M = 110100.0, 16.5


class TimedRun(NamedTuple):
    """Result and CPU time of one run of a benchmark case."""

    force_N: NDArray[np.float64]  # contact force in N at each tick
    codes: NDArray[np.int32]  # ADC code of the contact force at each tick
    seconds: float  # CPU time of the run in s
    events: int | None  # number of switching events in the run; None if it is unknown


@dataclass(frozen=True)
class Guard:
    """An event for solve_ivp: the value of `function` falls below 0. At the event, the nonlinear
    element `element` enters the linear region `region`."""

    terminal: ClassVar = True
    direction: ClassVar = -1
    function: Callable[[State], float]
    element: str
    region: int | str

    def __call__(self, _t: float, x: State) -> float:
        return self.function(x)


class _Plant:
    """The simulated plant of the benchmark cases A and B.

    The state x has six elements: motor current in A, filtered tachometer voltage in V, position and
    velocity of the robot, position and velocity of the workpiece. Positions are in m, velocities in
    m/s. Three elements are nonlinear. The current feedback and the amplifier are in one of their
    linear regions. The contact is "apart", "pressed", or "overlap" (the bodies overlap without a
    force).
    """

    def __init__(self) -> None:
        self.volts = 0.0
        self.feedback, self.amplifier, self.contact = 0, 0, "apart"

    def push(self, x: State) -> float:
        force_N: float = K_S_N_PER_M * (x[2] - x[4]) + B_S_NS_PER_M * (x[3] - x[5])
        return force_N

    def force(self, x: State) -> float:
        return self.push(x) if self.contact == "pressed" else 0.0

    def error(self, x: State) -> float:
        feedback = 10.0 * self.feedback if self.feedback else x[0] / 3
        error: float = 3.9 * self.volts - x[1] - feedback
        return error

    def rate(self, _t: float, x: State) -> tuple[float, ...]:
        i, vf, _xr, vr, xw, vw = x = x.tolist()
        e, side = self.error(x), self.amplifier
        vm = 15 * e if side == 0 else 30.0 * side if abs(side) == 2 else 7.5 * (e + 2 * side)
        f = self.force(x)
        return (
            (vm - 4.5 * i - 0.5 / R_M_PER_RAD * vr) / 0.0158,
            942 * (4.2 * 0.039 / R_M_PER_RAD * vr - vf),
            vr,
            (0.5 / R_M_PER_RAD * i - 500 * vr - f) / 132.4,
            vw,
            (f - 412700 * xw - 8.25 * vw) / 6.6,
        )

    def enter(self, x: State) -> None:
        """Sets the linear regions of the current feedback and of the amplifier after a change of
        the command. x: state of the plant."""
        self.feedback = int(x[0] > 30) - int(x[0] < -30)
        e = self.error(x)
        self.amplifier = sum((e > 2, e > 6)) - sum((e < -2, e < -6))

    def guards(self) -> list[Guard]:
        """Returns the events at which a nonlinear element leaves its present region."""
        guards = []
        side = self.amplifier
        if side > -2:
            low = {-1: -6, 0: -2, 1: 2, 2: 6}[side]
            guards.append(Guard(lambda x: self.error(x) - low, "amplifier", side - 1))
        if side < 2:
            high = {-2: -6, -1: -2, 0: 2, 1: 6}[side]
            guards.append(Guard(lambda x: high - self.error(x), "amplifier", side + 1))
        if self.feedback == 0:
            guards.append(Guard(lambda x: 30 - x[0], "feedback", 1))
            guards.append(Guard(lambda x: 30 + x[0], "feedback", -1))
        else:
            sign = self.feedback
            guards.append(Guard(lambda x: sign * x[0] - 30, "feedback", 0))
        if self.contact == "pressed":
            guards.append(Guard(self.push, "contact", "let go"))
        else:
            out = 1 if self.contact == "overlap" else -1
            guards.append(Guard(lambda x: out * (x[2] - x[4]), "contact", "met"))
            if self.contact == "overlap":
                guards.append(Guard(lambda x: -self.push(x), "contact", "pressed"))
        return guards

    def cross(self, element: str, into: int | str, x: State) -> None:
        """Sets the linear region of a nonlinear element after an event. x: state of the plant at
        this event."""
        if into == "let go":
            into = "overlap" if x[2] > x[4] else "apart"
        elif into == "met":
            falling = self.contact == "overlap"
            into = "apart" if falling else "pressed" if self.push(x) > 0 else "overlap"
        setattr(self, element, into)


def run(gain: int, setpoint_N: int, ticks: int) -> TimedRun:
    """Simulates plant and force loop for a number of ticks. The gain is in DAC codes per ADC
    code."""
    from scipy.integrate import solve_ivp

    plant, x, crossings = _Plant(), np.array([0, 0, -0.005, 0, 0, 0]), 0
    force, codes = [], []
    start = time.thread_time()
    for k in range(ticks + 1):
        f = plant.force(x)
        n = min(max(math.floor(f / 2 + 0.5), -128), 127)
        force.append(f)
        codes.append(n)
        if k == ticks:
            break
        dac_code = min(max((gain * (setpoint_N - 2 * n) + 1) >> 1, -2048), 2047)
        plant.volts = dac_code * (20 / 4096)
        plant.enter(x)
        remaining = STEP_S
        while remaining > 1e-15:
            guards = plant.guards()
            done = solve_ivp(
                plant.rate, (0, remaining), x, method="RK45", rtol=TOLERANCE, atol=TOLERANCE,
                first_step=remaining, events=guards,
            )  # fmt: skip
            x = done.y[:, -1]
            remaining -= done.t[-1]
            for guard, times in zip(guards, done.t_events, strict=True):
                if done.status == 1 and len(times):
                    plant.cross(guard.element, guard.region, x)
                    crossings += 1
    seconds = time.thread_time() - start
    return TimedRun(np.array(force), np.array(codes, np.int32), seconds, crossings)
