"""A force loop over a bus: the loop lifted over one cycle.

The firmware computes its law in every tick, but only the code of the first tick of a cycle leaves
for the drive, which holds it. From that code to the law's output in the first tick of the next
cycle, the loop is a system with one input, one output and the period of the cycle. So limits and
margins are those of any sampled loop, and exact. The loop is cut at the code: S, T and the margins
are those of a disturbance of the code that is constant over a cycle.
"""

from dataclasses import dataclass

import numpy as np

from forceaxis.linear.equations import Matrix, StateSpace
from forceaxis.linear.plant_facts import BusFacts


@dataclass(frozen=True)
class TickPlant:
    """The plant and the law of one tick.

    A, B: of the plant, sampled with the tick, from the voltage. force: row of the law's force (with
    its derivative, if the law has one). shown: row of the controlled signal. position: row of the
    encoder's position. stiffness, damping: of a law of motion, as gains of position and velocity.
    inner: gain of the inner damping in V s/m. law: filter between error and gain. tick_s: in s.
    late: ticks of latency of the firmware. late_motion: ticks by which a law of motion has its
    position and velocity late.
    """

    A: Matrix
    B: Matrix
    force: Matrix
    shown: Matrix
    position: Matrix
    stiffness: float
    damping: float
    inner: float
    law: StateSpace
    tick_s: float
    late: int
    late_motion: int


@dataclass(frozen=True)
class Lifted:
    """The loop over one cycle: A, B from the code (in V), C to the law's output and the controlled
    signal at the start of the cycle. enters, direct: how a set-point that is constant over a cycle
    acts on the states and on the law's output."""

    A: Matrix
    B: Matrix
    C: Matrix
    enters: Matrix
    direct: Matrix


def lift(plant: TickPlant, bus: BusFacts) -> Lifted:
    """Returns the loop of a plant and a law over a bus, lifted over one cycle."""
    cycle = bus.cycle_ticks
    n, laws = len(plant.A), len(plant.law[0])
    frames = -((-bus.delay_ticks_out) // cycle)
    counts = 1 - ((-1 - plant.late_motion - bus.delay_ticks_in) // cycle)
    size = n + frames + counts + laws + 1
    # Each quantity is a row over the states at the start of the cycle, the code and the set-point.
    rows = np.eye(size + 2, dtype=np.longdouble)
    x, code, setpoint = rows[:n], rows[size : size + 1], rows[size + 1 :]
    sent = np.vstack([code, rows[n : n + frames]])
    measured = np.vstack([plant.position @ x, rows[n + frames : n + frames + counts]])
    law = rows[size - 1 - laws : size - 1]
    output = rows[size - 1 : size]  # of the law in the last tick of the cycle before

    def held(tick: int) -> Matrix:
        """Returns the position that the firmware has in a tick of this cycle."""
        at = -((tick - bus.delay_ticks_in) // cycle)
        return measured[at : at + 1]

    def velocity(tick: int) -> Matrix:
        """Returns the mean velocity between the last two positions that the firmware has."""
        return (held(tick) - held(tick - cycle)) / (cycle * plant.tick_s)

    A, B, C, D = plant.law
    shown, acting = plant.shown @ x, output
    for tick in range(cycle):
        seen = tick - plant.late_motion
        error = plant.force @ x - setpoint
        if plant.stiffness:
            error = error + plant.stiffness * held(seen)
        if plant.damping:
            error = error + plant.damping * velocity(seen)
        output = C @ law + D @ error
        if tick == 0 and not plant.late:
            acting = output
        law = A @ law + B @ error
        at = -((tick - bus.delay_ticks_out) // cycle)
        x = plant.A @ x + plant.B @ sent[at : at + 1]
    after = np.vstack([x, sent[:frames], measured[:counts], law, output])
    result, column = after[:, :size], after[:, size : size + 1]
    if plant.inner:
        result = result - plant.inner * column @ velocity(-plant.late)[:, :size]
    return Lifted(
        result,
        column,
        np.vstack([acting, shown])[:, :size],
        after[:, size + 1 :],
        acting[:, size + 1 :],
    )
