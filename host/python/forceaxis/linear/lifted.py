"""Lifted model of a force loop whose ticks differ from each other: a linear time-invariant system
over the period after which the sequence of ticks repeats.

The firmware computes its law in every tick. Over a bus, only the code of the first tick of a bus
cycle is sent to the drive, and the drive holds this code. A force sensor with a clock of its own
gives samples at its own instants. The firmware uses the newest sample that has arrived. The filter
of the sensor's converter weights the force of the last periods of the samples.

The ticks repeat after the common period of bus cycles and samples. From the codes of a period to
the outputs of the law that become the next codes, the loop is a linear system. Its sampling time is
this period. So limits and margins are exact, and are those of any sampled loop. The loop is cut at
the codes: S, T and the margins belong to a disturbance of the codes, which is constant over each
bus cycle.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

import numpy as np

from forceaxis.linear.equations import Matrix, StateSpace
from forceaxis.linear.plant_facts import BusFacts

# Delay in ticks by which a sample arrives just too late for a tick.
# The simulator regards an instant within 1e-6 of a tick as this tick.
MISSED_BY = Fraction(1, 100_000)


@dataclass(frozen=True)
class Samples:
    """The times, in ticks, at which a force sensor takes its samples. `every`: time from one sample
    to the next. `phase`: time from tick 0 to a sample, at least 0 and below `every`. `latency`:
    time from a sample to its arrival. sinc_order: order of the converter's filter, 0 without a
    filter."""

    every: Fraction
    phase: Fraction
    latency: Fraction
    sinc_order: int = 0

    @property
    def period_ticks(self) -> int:
        """Number of ticks after which the sample times repeat relative to the ticks."""
        return self.every.numerator

    def instant(self, sample: int) -> Fraction:
        """Returns the time of a sample in ticks. Sample 0 is the first sample at or after tick
        0."""
        return self.phase + sample * self.every

    def newest(self, tick: int) -> int:
        """Returns the number of the newest sample that has arrived at the tick `tick`."""
        unit, every, arrives = self._whole
        return (unit * tick - arrives) // every

    @cached_property
    def _whole(self) -> tuple[int, int, int]:
        """Returns (number of units in a tick, `every`, arrival of sample 0), the last two in this
        unit. All are whole numbers, because arithmetic with fractions takes most of the time of a
        lifted model."""
        arrives = self.phase + self.latency
        unit = math.lcm(self.every.denominator, arrives.denominator)
        return unit, int(unit * self.every), int(unit * arrives)

    def phases(self, cycle_ticks: int) -> "Iterator[Samples]":
        """Yields sample times with other phases relative to the ticks. Samples and bus cycles can
        follow each other in several orders. There are three phases for each order: with the oldest
        readings, with readings of middle age, and with the newest readings."""
        share = Fraction(math.gcd(self.every.numerator, cycle_ticks * self.every.denominator))
        for order in range(int(share)):
            for late in (MISSED_BY, self._step / 2, Fraction(0)):
                yield self._arriving(order, late)

    def within(self, order: int, share: float) -> "Samples":
        """Returns the sample times with another phase. `order`: number of the order in which
        samples and bus cycles follow each other. `share`: position of the phase within this order,
        from 0 for the oldest readings to 1 for the newest readings."""
        late = Fraction(share).limit_denominator(10**4) * self._step
        return self._arriving(order, max(late, MISSED_BY))

    @property
    def _step(self) -> Fraction:
        """Interval in ticks between two phases at which the order of samples and ticks changes."""
        return Fraction(1, self.every.denominator)

    def _arriving(self, order: int, late: Fraction) -> "Samples":
        """Returns the sample times with another phase. `order`: number of the order in which
        samples and ticks follow each other. `late`: distance in ticks from the first phase with
        this order."""
        arrives = (order * self._step + late - self.latency) % self.every
        return replace(self, phase=arrives)


class Within(NamedTuple):
    """The signal of a sensor at an instant between two ticks, or moments of this signal, as a
    linear function. `rows`: coefficients of the states of the plant at the tick. `direct`:
    coefficients of the voltage that acts from this tick on."""

    rows: Matrix
    direct: Matrix


@dataclass(frozen=True)
class TickPlant:
    """Linear model of the plant and of the control law over one tick.

    A, B: matrices of the plant from the voltage, sampled with the tick. force: row of the measured
    force. With a sensor of the force's derivative, the row includes this part of the law. within:
    function that returns the measured force at a share of a tick, above 0.

    moments: function that returns the moments 1, 2, .. of the measured force. The arguments are a
    share of a tick from the start of the tick on, and the number of moments. The moments are about
    the end of this share (sim/hybrid/sinc_filter.hpp).

    derivative_s: derivative time of a law with the difference of two readings. shown: row of the
    controlled signal. position: row of the encoder's position. stiffness, damping: gains of
    position and velocity of a law of motion. inner: gain of the inner damping in V s/m. law: filter
    between error and gain. tick_s: duration of a tick in s. late: latency of the firmware in ticks.
    late_motion: age in ticks of position and velocity in a law of motion.
    """

    A: Matrix
    B: Matrix
    force: Matrix
    within: Callable[[Fraction], Within]
    moments: Callable[[Fraction, int], Within]
    derivative_s: float
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
    """Linear model of the force loop over one period, cut at the DAC codes. The inputs of A, B, C,
    D are the codes in V. The outputs are those outputs of the law that become codes, and the
    controlled signal at the start of the period. enters, direct: effects of a set-point that is
    constant over a period. `enters` is the effect on the states, and `direct` is the effect on the
    outputs of the law."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    enters: Matrix
    direct: Matrix


def lift(plant: TickPlant, bus: BusFacts, samples: Samples | None = None) -> Lifted:
    """Returns the force loop of a plant and a control law over a bus as one linear system over the
    period after which its ticks repeat. `samples`: sample times of the force sensor, or None for
    one sample in each tick."""
    return _Period(plant, bus, samples).lifted()


def spline_pieces(order: int) -> list[list[Fraction]]:
    """Returns the polynomial pieces of the B-spline of order `order`. Each row has the coefficients
    of one piece, with the lowest power first. The variable runs from 0 to 1 within the piece."""
    pieces = [[Fraction(1)]]
    for n in range(2, order + 1):
        grown = []
        for i in range(n):
            own = pieces[i] if i < n - 1 else [Fraction(0)] * (n - 1)
            before = pieces[i - 1] if i > 0 else [Fraction(0)] * (n - 1)
            # Recursion of B-splines over the order n, with x from 0 to 1:
            # piece i = ((i + x) own + (n - i - x) before) / (n - 1)
            flat = [i * a + (n - i) * b for a, b in zip(own, before, strict=True)] + [Fraction(0)]
            steep = [Fraction(0), *(a - b for a, b in zip(own, before, strict=True))]
            grown.append([(a + b) / (n - 1) for a, b in zip(flat, steep, strict=True)])
        pieces = grown
    return pieces


def _rounded(value: Fraction) -> np.longdouble:
    return np.longdouble(value.numerator) / np.longdouble(value.denominator)


class _SincFilter:
    """The sinc filter of a converter over one period of the loop. Its quantities are rows of
    coefficients, like those of _Period. `chain`: moments of the present sampling interval about the
    present tick. `due`: contributions of past intervals to the next samples. The contribution to
    the nearest sample is the first one."""

    def __init__(self, order: int, every: Fraction, rows: Matrix) -> None:
        self.chain, self.due = rows[:order], list(rows[order:])
        # Weights of the moments of an interval: one row for each sample that the interval affects.
        # Row 0 belongs to the sample at the end of the interval, row 1 to the next sample.
        self.weights = np.array([
            [_rounded(c * math.factorial(j) / every ** (j + 1)) for j, c in enumerate(piece)]
            for piece in spline_pieces(order)
        ])  # fmt: skip

    @staticmethod
    def states(order: int) -> int:
        """Returns the number of states of a sinc filter of the order `order`."""
        return 2 * order - 1

    @property
    def rows(self) -> list[Matrix]:
        """Returns the states of the filter at the present tick as rows of coefficients."""
        return [self.chain, *(row[None] for row in self.due)]

    def moved(self, share: Fraction, moments: Matrix) -> Matrix:
        """Returns the moments of the present sampling interval about a later instant of the tick.
        `share`: time from the tick to this instant, in ticks. `moments`: moments of the force over
        this time."""
        return self._about(float(share)) @ self.chain + moments

    def sample(self, share: Fraction, moments: Matrix) -> Matrix:
        """Returns the sample that the filter gives at an instant of the tick, and begins the next
        sampling interval."""
        shares = self.weights @ self.moved(share, moments)
        value = self.due[0] + shares[0]
        self.due = [row + more for row, more in zip([*self.due[1:], 0], shares[1:], strict=True)]
        # at the instant of the sample, the moments of the next interval are 0
        self.chain = -self._about(-float(share)) @ moments
        return np.asarray(value[None])

    def _about(self, later: float) -> Matrix:
        """Returns a matrix that converts moments about one instant to moments about another
        instant, which is `later` ticks later."""
        order = len(self.chain)
        return np.array([
            [
                np.longdouble(later) ** (i - j) / math.factorial(i - j) if i >= j else 0
                for j in range(order)
            ]
            for i in range(order)
        ], np.longdouble)  # fmt: skip


class _Period:
    """The signals of a force loop in the ticks of one period. Each signal is a row of coefficients,
    which multiply the states at the start of the period, the codes of the period, and the
    set-point."""

    def __init__(self, plant: TickPlant, bus: BusFacts, samples: Samples | None) -> None:
        self.plant, self.bus, self.samples = plant, bus, samples
        self.ticks = math.lcm(bus.cycle_ticks, samples.period_ticks if samples else 1)
        self.codes = self.ticks // bus.cycle_ticks
        laws = len(plant.law[0])
        order = samples.sinc_order if samples else 0
        counts = 1 - ((-1 - plant.late_motion - bus.delay_ticks_in) // bus.cycle_ticks)
        sizes = [
            len(plant.A),
            # DAC codes that were sent but have not reached the drive yet
            -((-bus.delay_ticks_out) // bus.cycle_ticks),
            counts,
            -samples.newest(0) if samples else 0,
            _SincFilter.states(order) if order else 0,
            laws,
            1,  # state for the output of the law in the last tick, as a row of coefficients
            1 if plant.derivative_s else 0,  # reading of the last tick
        ]
        self.size = sum(sizes)
        self.rows = np.eye(self.size + self.codes + 1, dtype=np.longdouble)
        ends = np.cumsum(sizes)
        parts = [self.rows[end - size : end] for size, end in zip(sizes, ends, strict=True)]
        self.x, sent, counted, taken, kept, self.law, self.output, self.reading_before = parts
        self.filter = _SincFilter(order, samples.every, kept) if samples and order else None
        # Rows of coefficients that give codes, positions and samples.
        # The newest code and the newest position come first.
        self.sent = [sent[i : i + 1] for i in range(len(sent))]
        self.counts = [counted[i : i + 1] for i in range(counts)]
        self.taken = {i - len(taken): taken[i : i + 1] for i in range(len(taken))}
        self.next_sample = 0
        self._expect()

    def lifted(self) -> Lifted:
        """Returns the linear model of the force loop over one period."""
        acting, shown = [], self.plant.shown @ self.x
        kept = [len(self.sent), len(self.counts), len(self.taken)]
        for tick in range(self.ticks):
            if tick % self.bus.cycle_ticks == 0:
                self.counts.insert(0, self.plant.position @ self.x)
            before = self.output
            self._compute(tick)
            if tick % self.bus.cycle_ticks == 0:
                acting.append(before if self.plant.late else self.output)
                self.sent.insert(0, self._code(tick))
            self._move(tick)
        turn = self._samples_in_a_period()
        taken = [self.taken[i + turn] for i in range(-kept[2], 0)]
        after = np.vstack([
            self.x, *self.sent[: kept[0]], *self.counts[: kept[1]], *taken,
            *(self.filter.rows if self.filter else ()), self.law, self.output, self.reading_before,
        ])  # fmt: skip
        out = np.vstack([*acting, shown])
        n, end = self.size, self.size + self.codes
        return Lifted(
            after[:, :n], after[:, n:end], out[:, :n], out[:, n:end], after[:, end:], out[:-1, end:]
        )

    def _samples_in_a_period(self) -> int:
        return int(self.ticks / self.samples.every) if self.samples else 0

    def _compute(self, tick: int) -> None:
        """Computes the output and the states of the control law in one tick."""
        plant = self.plant
        reading = self._reading(tick)
        error = reading - self.rows[-1:]
        if plant.derivative_s:
            error = error + plant.derivative_s / plant.tick_s * (reading - self.reading_before)
            self.reading_before = reading
        seen = tick - plant.late_motion
        if plant.stiffness:
            error = error + plant.stiffness * self._held(seen, tick)
        if plant.damping:
            error = error + plant.damping * self._velocity(seen, tick)
        A, B, C, D = plant.law
        self.output = C @ self.law + D @ error
        self.law = A @ self.law + B @ error

    def _reading(self, tick: int) -> Matrix:
        if self.samples is None:
            return self.plant.force @ self.x
        if self.next_tick == tick and not self.next_share:
            if self.filter:
                none = np.zeros_like(self.filter.chain)
                self._take(self.filter.sample(Fraction(0), none))
            else:
                self._take(self.plant.force @ self.x)
        return self.taken[self.samples.newest(tick)]

    def _take(self, value: Matrix) -> None:
        self.taken[self.next_sample] = value
        self.next_sample += 1
        self._expect()

    def _expect(self) -> None:
        """Computes the tick before the next sample, and the time from this tick to the sample as a
        share of a tick.
        """
        instant = self.samples.instant(self.next_sample) if self.samples else Fraction(0)
        self.next_tick = math.floor(instant)
        self.next_share = instant - self.next_tick

    def _code(self, tick: int) -> Matrix:
        """Returns the DAC code of the bus cycle that begins at the tick `tick`."""
        at = self.size + tick // self.bus.cycle_ticks
        code = self.rows[at : at + 1]
        if self.plant.inner:
            code = code - self.plant.inner * self._velocity(tick - self.plant.late, tick)
        return code

    def _move(self, tick: int) -> None:
        """Computes the motion of the plant up to the next tick. Takes the samples of the force
        between the two ticks."""
        cycle = self.bus.cycle_ticks
        sent = self.sent[tick // cycle - (tick - self.bus.delay_ticks_out) // cycle]
        while self.samples and self.next_tick == tick:
            share = self.next_share
            if self.filter:
                self._take(self.filter.sample(share, self._moments(share, sent)))
            else:
                within = self.plant.within(share)
                self._take(within.rows @ self.x + within.direct @ sent)
        if self.filter:
            whole = Fraction(1)
            self.filter.chain = self.filter.moved(whole, self._moments(whole, sent))
        # Codes of later cycles and the set-point do not act on the plant in this tick.
        known = self.size + tick // cycle + 1
        moved = np.zeros_like(self.x)
        moved[:, :known] = self.plant.A @ self.x[:, :known] + self.plant.B * sent[:, :known]
        self.x = moved

    def _moments(self, share: Fraction, sent: Matrix) -> Matrix:
        """Returns the moments of the force over the first part of a tick. `share`: length of this
        part in ticks."""
        assert self.filter
        moments = self.plant.moments(share, len(self.filter.chain))
        return np.asarray(moments.rows @ self.x + moments.direct @ sent)

    def _held(self, tick: int, now: int) -> Matrix:
        """Returns the newest position that the firmware has received at the tick `tick`. `now`: the
        present tick."""
        cycle = self.bus.cycle_ticks
        return self.counts[now // cycle - (tick - self.bus.delay_ticks_in) // cycle]

    def _velocity(self, tick: int, now: int) -> Matrix:
        """Returns the mean velocity between the last two positions that the firmware has."""
        cycle = self.bus.cycle_ticks
        moved = self._held(tick, now) - self._held(tick - cycle, now)
        return moved / (cycle * self.plant.tick_s)
