"""Limits of random force loops against the eigenvalues of loops stepped from event to event.

`limit_study.py COUNT [SEED [FIRST]]` draws loops, prints every wrong answer as a line of JSON, and
then the table of results. It then compares the answers to a tenth as many loops, 500 at most, under
each kernel of OpenBLAS. Each loop belongs to its seed and number alone, so any of them can be
computed again: `limit_study.py --only NUMBER [SEED]`. `--rows COUNT SEED` prints every answer.

A loop has a drive of one of five kinds with values of a data sheet, none or a bus of 2, 4 or 8 ms,
a force sensor of 0.25 to 4.5 kHz with a known or an unknown phase, a sinc filter or none, and the
law P, PI or a bank. Nothing of forceaxis.linear steps the loop: the plant's matrices (those that
the simulator integrates) move by SciPy's matrix exponential from sample to tick to sample, with
filter, history, law, bus and latency as the firmware and the drive have them. A sinc filter is
computed as the data sheets define it, by integrators and differences.
"""

import json
import math
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # waiting threads cost more than they do

import kernels
import numpy as np
from forceaxis.design import data_sheet, new
from forceaxis.errors import ParameterError
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.stability import Limit
from forceaxis.linear.system import linearise
from scipy import linalg, optimize

Array = np.ndarray[Any, Any]

TICK_S = 1 / 1500
KINDS = ("amplifier", "velocity", "torque", "stepper", "linear")
LAWS = ("p", "pi", "bank")
CYCLES = (3, 6, 12)  # ticks of a bus of 2, 4 and 8 ms
RATES_HZ = (250, 300, 375, 500, 600, 750, 900, 1000, 1200, 1500, 2000, 2500, 3000, 4500)
PERIOD_MAX = 36  # ticks after which a drawn loop repeats
ERROR_MAX, FREE_ERROR_MAX = 1e-6, 1e-4
KERNEL_LOOPS_MAX, KERNEL_ERROR_MAX = 500, 1e-9
# Distance from 1 of a largest eigenvalue that does not decide, near a limit, and at any other
# gain: rounding moves two equal eigenvalues by the root of its own size.
MARGINAL, WIDE_MARGINAL = 1e-9, 1e-7
SWEPT = 4  # number of phases, those with the largest eigenvalues, whose lower gains are swept
SWEEP = np.geomspace(1e-4, 0.999, 100)  # of a limit: the gains below it that must be stable
WIDE = np.geomspace(1e-12, 1e12, 193)  # V/N, of loops without a limit


@dataclass(frozen=True)
class Drawn:
    """A drawn loop: text of its model, its law, and what the stepped loop has to know."""

    kind: str
    text: str
    law: str
    timing: str
    integral_rad_per_s: float = 0.0
    sections: tuple[tuple[float, ...], ...] = ()
    cycle: int = 1
    out: int = 0
    every: Fraction | None = None  # ticks from sample to sample, None for a sample in each tick
    phase: Fraction | None = None  # ticks, None if it is not known
    latency: Fraction = Fraction(0)  # ticks
    order: int = 0  # of the sinc filter

    @property
    def free(self) -> bool:
        """True if the phase between samples and ticks is not known."""
        return self.every is not None and self.phase is None

    @property
    def spec(self) -> LoopSpec:
        """The loop as forceaxis describes it."""
        if self.law == "bank":
            bank = Bank(1.0, self.integral_rad_per_s, 0.0, self.sections)
            return LoopSpec("bank", self.timing, bank=bank)
        given = {"integral_rad_per_s": self.integral_rad_per_s} if self.law == "pi" else {}
        return LoopSpec(self.law, self.timing, parameters=given)

    @property
    def label(self) -> str:
        """Kind, bus, sensor and law as one word each."""
        sensor = "tick" if self.every is None else "free" if self.free else "phase"
        sensor += f"+sinc{self.order}" if self.order else ""
        return f"{self.kind} bus{self.cycle} {sensor} {self.law} {self.timing}"


def _sheet(rng: random.Random, kind: str) -> str:
    """Returns the text of a model whose values lie within a factor of those of a data sheet."""
    left = {"approach_mm", "sensor_bits", "guide_coulomb_n", "backlash_mm", "sensor_noise_n"}
    left |= {"sensor_rate_hz", "sensor_latency_ms", "sensor_filter", "bus_cycle_ms", "output_bits"}
    left |= {"drive", "motor", "cogging_n", "inclination_deg"}
    drive = rng.choice(("velocity", "torque")) if kind == "linear" else kind
    wide = rng.choice((1.5, 4.0, 12.0))
    while True:
        given = {"drive": drive, "sensor_bits": "16"}
        if kind == "linear":
            given["motor"] = "linear"
        for one in data_sheet.FIELDS:
            if one.name in left or one.choices or one.instead_of or one.word == "none":
                continue
            if one.needs and one.needs not in given:
                continue
            axis = {"motor": "rotary"} | given
            if any(axis[name] not in choices for name, choices in one.only.items()):
                continue
            if one.default is None and rng.random() < 0.5:
                given[one.name] = repr(10 ** rng.uniform(4.5, 8))  # a stiffness
            elif not callable(one.default) and one.default and rng.random() < 0.5:
                value = float(one.default) * wide ** rng.uniform(-1, 1)
                given[one.name] = repr(min(max(value, one.low), one.high))
        try:
            values, sources = data_sheet.collect(given)
            return new.render("model.toml", "drawn", new.derive(values), sources)
        except ParameterError:
            continue


def _section(rng: random.Random) -> tuple[float, ...]:
    """Returns a random lead, lag, notch or peak, by the bilinear transformation."""
    zero, pole = (2 * math.pi * 10 ** rng.uniform(0.3, 2.7) for _ in range(2))
    shapes = [(zero, rng.uniform(0.1, 1.2)), (pole, rng.uniform(0.3, 1.2))]
    rows = []
    for w, damping in shapes:
        k = 2 / TICK_S / w
        rows.append((k * k + 2 * damping * k + 1, 2 - 2 * k * k, k * k - 2 * damping * k + 1))
    (b0, b1, b2), (a0, a1, a2) = rows
    return tuple(round(c / a0 * 2**26) / 2**26 for c in (b0, b1, b2, a1, a2))


def draw(seed: int, number: int) -> Drawn:
    """Returns the loop of a number."""
    rng = random.Random(f"{seed}/{number}")
    kind, law = rng.choice(KINDS), rng.choice(LAWS)
    text = _sheet(rng, kind)
    given: dict[str, Any] = {}
    if law == "pi" or (law == "bank" and rng.random() < 0.7):
        given["integral_rad_per_s"] = 10 ** rng.uniform(-0.5, 2.3)
    if law == "bank":
        given["sections"] = tuple(_section(rng) for _ in range(rng.randint(1, 2)))
        share = given.get("integral_rad_per_s", 0.0) * TICK_S
        given["integral_rad_per_s"] = round(share * 2**26) / 2**26 / TICK_S
    if rng.random() < 0.5:
        cycle = rng.choice(CYCLES)
        out = rng.choice((0, cycle, rng.randint(0, 2 * cycle)))
        keys = f"cycle_ticks = {cycle}\ndelay_ticks_out = {out}\ndelay_ticks_in = 1\n"
        text = text.replace("[drive]\n", f"[drive]\n{keys}", 1)
        given |= {"cycle": cycle, "out": out}
    if rng.random() < 0.6:
        cycle = given.get("cycle", 1)
        rates = [r for r in RATES_HZ if math.lcm(Fraction(1500, r).numerator, cycle) <= PERIOD_MAX]
        rate = rng.choice(rates)
        every = Fraction(1500, rate)
        latency = Fraction(rng.randint(0, 40), 10)
        order = rng.choice((0, 0, 3, 4, 5))
        keys = f"sample_rate = {rate}\nlatency = {float(latency) * TICK_S!r}\n"
        keys += f'converter_filter = "sinc{order}"\n' if order else ""
        given |= {"every": every, "latency": latency, "order": order}
        if rng.random() < 0.5:
            phase = every * rng.randint(0, 19) / 20
            keys += f"sample_phase = {float(phase) * TICK_S!r}\n"
            given["phase"] = phase
        text = text.replace("[[adc]]\nchannel = 0\n", f"[[adc]]\nchannel = 0\n{keys}", 1)
    return Drawn(kind, text, law, rng.choice(("zoh", "zoh", "zoh+1")), **given)


@dataclass
class Stepped:
    """A loop that goes from event to event for many gains at once. Each quantity is a row over the
    state at the start of a period, with the gains in front."""

    drawn: Drawn
    plant: tuple[Array, Array, Array]  # A, B, C of the plant in continuous time
    phase: Fraction | None
    moves: dict[Fraction, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        (A, B, C), order = self.plant, self.drawn.order
        n = len(A)
        # Plant, its command, and the integrals of the force since the last sample, time in ticks.
        self.block = np.zeros((n + 1 + order, n + 1 + order))
        self.block[:n, :n], self.block[:n, n] = A * TICK_S, B[:, 0] * TICK_S
        if order:
            self.block[n + 1, :n] = C[0]
            self.block[range(n + 2, n + 1 + order), range(n + 1, n + order)] = 1.0
        self.n = n

    def _move(self, rows: Array, ticks: Fraction) -> Array:
        if ticks not in self.moves:
            self.moves[ticks] = linalg.expm(self.block * float(ticks))
        return self.moves[ticks] @ rows

    def _responses(self) -> list[Array]:
        """What the integrals of an interval add to the sample at its end, to the next one, and so
        on: N integrators that go on for ever, and N differences of what they show."""
        order, every = self.drawn.order, float(self.drawn.every or 0)
        on = [[every ** (i - j) / math.factorial(i - j) if i >= j else 0.0
               for j in range(order)] for i in range(order)]  # fmt: skip
        shown = [np.linalg.matrix_power(np.array(on), i)[-1] for i in range(order)]
        return [
            sum((-1) ** m * math.comb(order, m) * shown[i - m] for m in range(i + 1)) / every**order
            for i in range(order)
        ]

    def period(self, gains: Array) -> Array:
        """Returns the matrices over a period, (gains, size, size)."""
        d = self.drawn
        cycle, every = d.cycle, d.every
        ticks = math.lcm(every.numerator, cycle) if every else cycle
        late = math.ceil(d.latency / every) + 2 if every else 0
        counts = {
            "plant": self.n, "integrals": d.order, "due": max(d.order - 1, 0), "samples": late,
            "sent": -(-d.out // cycle) + 1, "integral": int(d.integral_rad_per_s > 0),
            "sections": 2 * len(d.sections),
            "output": 1,
        }  # fmt: skip
        size = sum(counts.values())
        unit = np.broadcast_to(np.eye(size), (len(gains), size, size))
        parts, at = {}, 0
        for name, count in counts.items():
            parts[name], at = unit[:, at : at + count].copy(), at + count
        zero = np.zeros((len(gains), 1, size))
        x = np.concatenate([parts["plant"], zero, parts["integrals"]], axis=1)
        row = {name: [part[:, i] for i in range(part.shape[1])] for name, part in parts.items()}
        due, samples, sent = row["due"], row["samples"], row["sent"]  # the newest last
        taken, now = 0, Fraction(0)
        answers = self._responses()
        C = self.plant[2][0]

        def sample() -> None:
            nonlocal due, taken
            if d.order:
                held = x[:, self.n + 1 :]
                adds = [np.einsum("i,gis->gs", h, held) for h in answers]
                waiting = [*due, 0.0 * adds[0]]
                samples.append(waiting[0] + adds[0])
                due = [w + a for w, a in zip(waiting[1:], adds[1:], strict=True)]
                x[:, self.n + 1 :] = 0.0
            else:
                samples.append(np.einsum("i,gis->gs", C, x[:, : self.n]))
            taken += 1

        def instant() -> Fraction:
            assert every is not None and self.phase is not None
            return self.phase + taken * every

        integral, memory, output = row["integral"], row["sections"], row["output"][0]
        for tick in range(ticks):
            while every and instant() <= tick:
                x, now = self._move(x, instant() - now), instant()
                sample()
            x, now = self._move(x, tick - now), Fraction(tick)
            if every:
                assert self.phase is not None
                newest = math.floor((tick - d.latency - self.phase) / every)
                signal = -samples[late + newest]
            else:
                signal = -np.einsum("i,gis->gs", C, x[:, : self.n])
            kept = []
            for i, (b0, b1, b2, a1, a2) in enumerate(d.sections):
                one, two = memory[2 * i : 2 * i + 2]
                inner = signal - a1 * one - a2 * two
                signal = b0 * inner + b1 * one + b2 * two
                kept += [inner, one]
            memory = kept
            integral = [row + d.integral_rad_per_s * TICK_S * signal for row in integral]
            before, output = output, sum(integral, signal)
            if tick % cycle == 0:
                code = before if d.timing == "zoh+1" else output
                sent.append(gains[:, None] * code)
            acting = sent[len(sent) - 1 - (tick // cycle - (tick - d.out) // cycle)]
            x[:, self.n] = acting
        while every and instant() < ticks:
            x, now = self._move(x, instant() - now), instant()
            sample()
        x = self._move(x, ticks - now)
        rows = [*np.moveaxis(x[:, : self.n], 1, 0), *np.moveaxis(x[:, self.n + 1 :], 1, 0), *due]
        rows += samples[len(samples) - late :] if late else []
        rows += [*sent[len(sent) - counts["sent"] :], *integral, *memory, output]
        return np.stack(rows, axis=1)

    def outermost(self, gains: Array) -> Array:
        """Returns the eigenvalue of the largest magnitude at each gain."""
        poles = np.linalg.eigvals(self.period(np.atleast_1d(gains)))
        best: Array = poles[np.arange(len(poles)), np.argmax(np.abs(poles), axis=1)]
        return best

    def radius(self, gains: Array) -> Array:
        """Returns the magnitude of the largest eigenvalue at each gain."""
        return np.abs(self.outermost(gains))

    def sharp_radius(self, gain: float) -> float:
        """Returns the magnitude of the largest eigenvalue at a gain. The quotient of the left and
        right eigenvector in extended precision takes away what rounding does to an eigenvalue that
        others are close to."""
        return self._sharp(gain)[0]

    def surely_unstable(self, gain: float) -> bool:
        """Returns True if no rounding of the matrix can explain that an eigenvalue lies outside of
        the unit circle. At small gains the eigenvalues of several integrals lie close together."""
        radius, rounding = self._sharp(gain)
        return radius - 1 > rounding

    def _sharp(self, gain: float) -> tuple[float, float]:
        """Returns sharp_radius() and how far rounding of each entry moves it, to first
        order."""
        matrix = self.period(np.array([gain]))[0]
        poles, left, right = linalg.eig(matrix, left=True, right=True)
        best, wide = int(np.argmax(np.abs(poles))), matrix.astype(np.longdouble)
        y, x = (side[:, best].astype(np.clongdouble) for side in (left.conj(), right))
        rounding = len(matrix) * 2.0**-53 * float(abs(y) @ abs(wide) @ abs(x) / abs(y @ x))
        return float(abs((y @ (wide @ x)) / (y @ x))), rounding


def phases(drawn: Drawn) -> list[Fraction | None]:
    """Returns the phases to try: that of the loop, or five between any two at which the order of
    ticks and arrivals changes."""
    if drawn.every is None or drawn.phase is not None:
        return [drawn.phase]
    step = Fraction(1, drawn.every.denominator)
    shares = (Fraction(0), Fraction(1, 100_000), step / 4, step / 2, 3 * step / 4)
    starts = [i * step - drawn.latency for i in range(int(drawn.every / step))]
    return [(start + share) % drawn.every for start in starts for share in shares]


@dataclass(frozen=True)
class Found:
    """The answer about a loop: `wrong` says what is false of it, or is empty."""

    number: int
    label: str
    gain: float | None
    reason: str
    error: float  # of the limit, relative; 0 without a limit
    wrong: str = ""
    true: float | None = None  # limit of the stepped loop, V/N, if it has one


def judged(stepped: list[Stepped], limit: Limit, error_max: float) -> tuple[float, str, Any]:
    """Returns the relative error of a limit, what is false of the limit, and the true limit."""
    if limit.gain:
        return _judged_limit(stepped, limit, error_max)
    tables = np.array([one.radius(WIDE) for one in stepped]).max(axis=0)
    stable, unstable = tables < 1 - WIDE_MARGINAL, tables > 1 + WIDE_MARGINAL
    first = int(np.argmax(stable | unstable)) if np.any(stable | unstable) else 0
    ends = np.flatnonzero(unstable)
    if limit.gain == 0:
        below = [one.surely_unstable(gain) for gain in WIDE[:first] for one in stepped]
        if stable[first] and not any(below):
            return 0.0, "false zero", _edge(stepped, float(WIDE[first]))
        return 0.0, "", 0.0
    if not stable[first]:
        return 0.0, "false none: unstable at small gains", 0.0
    after = ends[ends > first]
    if len(after):
        true = _edge(stepped, float(WIDE[after[0] - 1]))
        # Where rounding decides indeed, the stepped loop does not know either.
        return 0.0, "false none", true
    return 0.0, "", None


def _judged_limit(stepped: list[Stepped], limit: Limit, error_max: float) -> tuple[float, str, Any]:
    gain = limit.gain
    assert gain
    near = gain * np.array([1 - error_max, 1.0, 1 + error_max])
    around = np.array([one.radius(near) for one in stepped])
    worst = np.argsort(-around[:, 1])[:SWEPT]
    below = np.array([stepped[i].radius(gain * SWEEP) for i in worst])
    if np.any(below > 1 + MARGINAL):
        at = int(np.argmax(below.max(axis=0) > 1 + MARGINAL))
        return 0.0, f"unstable at {gain * SWEEP[at]:.6g}", None
    if not np.any(below[:, -1] < 1):
        return 0.0, "not stable below the limit", None
    errors = [_apart(one, gain, row, error_max) for one, row in zip(stepped, around, strict=True)]
    first = int(np.argmin(errors))
    error = float(errors[first])
    if error > error_max and len(stepped) > 1:
        error = _between(stepped[first], gain, error_max)
    if not abs(error) <= error_max:
        return error, "false limit", gain * (1 + error)
    pole = stepped[first].outermost(gain * np.array([1 + errors[first] + 1e-9]))[0]
    every_tick, cycle = stepped[first].drawn.every, stepped[first].drawn.cycle
    ticks = math.lcm(every_tick.numerator, cycle) if every_tick else cycle
    hz = abs(np.angle(pole)) / (2 * math.pi * ticks * TICK_S)
    # Of several phases with nearly the same limit each has a frequency of its own.
    share = 1e-3 if len(stepped) == 1 else 0.05
    if abs((limit.frequency_hz or 0.0) - hz) > share * hz + 1e-6:
        return error, f"at {hz:.6g} Hz", gain
    return error, "", gain


def _apart(one: Stepped, gain: float, around: Array, step: float) -> float:
    """Returns how far the gain at which the largest eigenvalue is 1 lies above a gain, as a share
    of the gain. `around`: largest eigenvalues at the gain and one step of it below and above."""
    slope = float(around[2] - around[0]) / (2 * step)
    apart = (1 - float(around[1])) / slope if slope > 0 else math.inf
    if 1e-9 < abs(apart) < math.inf:
        apart = (1 - one.sharp_radius(gain)) / slope
    if abs(apart) <= step:
        return apart
    # Another eigenvalue may be the largest one at the limit itself.
    gains = gain * np.geomspace(0.9, 1.2, 61)
    outside = np.flatnonzero(one.radius(gains) > 1)
    if not len(outside) or not outside[0]:
        return apart
    low, high = gains[outside[0] - 1], gains[outside[0]]
    for _ in range(35):
        middle = (low + high) / 2
        low, high = (middle, high) if one.sharp_radius(middle) < 1 else (low, middle)
    return float(low / gain - 1)


def _between(near: Stepped, gain: float, step: float) -> float:
    """Returns _apart() at the lowest phase about one of the phases that were tried."""
    every = near.drawn.every
    assert every is not None and near.phase is not None
    width = Fraction(1, 4 * every.denominator)

    def at(share: float) -> float:
        phase = (near.phase + Fraction(share).limit_denominator(10**6) * width) % every
        one = Stepped(near.drawn, near.plant, phase)
        around = one.radius(gain * np.array([1 - step, 1.0, 1 + step]))
        return min(_apart(one, gain, around, step), 1.0)  # infinity has no parabola

    found = optimize.minimize_scalar(at, bounds=(-1.0, 1.0), method="bounded")
    return float(found.fun)


def _edge(stepped: list[Stepped], stable: float) -> float | None:
    """Returns the first gain above a stable one at which the stepped loop is unstable."""
    low = stable
    while low < 1e13:
        gains = low * np.geomspace(1, 10, 60)
        table = np.array([one.radius(gains) for one in stepped]).max(axis=0)
        bad = np.flatnonzero(table > 1)
        if len(bad):
            low, high = gains[max(bad[0] - 1, 0)], gains[bad[0]]
            for _ in range(45):
                middle = math.sqrt(low * high)
                inside = max(one.radius(np.array([middle]))[0] for one in stepped) <= 1
                low, high = (middle, high) if inside else (low, middle)
            return float(low)
        low = gains[-1]
    return None


def study(seed: int, number: int, folder: Path) -> Found:
    """Draws a loop, asks for its limit, and judges the answer."""
    drawn = draw(seed, number)
    file = folder / "model.toml"
    file.write_text(drawn.text)
    loop = drawn.spec.around(file)
    limit = loop.limit()
    plant = linearise(file)
    assert not plant.D.any()
    stepped = [Stepped(drawn, (plant.A, plant.B, plant.C), phase) for phase in phases(drawn)]
    error, wrong, true = judged(stepped, limit, FREE_ERROR_MAX if drawn.free else ERROR_MAX)
    return Found(number, drawn.label, limit.gain, limit.reason, error, wrong, true)


def run(count: int, seed: int, first: int = 0) -> list[Found]:
    """Studies some loops."""
    with tempfile.TemporaryDirectory() as scratch:
        return [study(seed, number, Path(scratch)) for number in range(first, first + count)]


def main(arguments: list[str]) -> int:
    """Runs the study. Returns 1 if any answer is wrong."""
    if arguments[0] == "--only":
        number, seed = int(arguments[1]), int(arguments[2]) if len(arguments) > 2 else 1
        (found,) = run(1, seed, number)
        print(draw(seed, number), found)
        return int(bool(found.wrong))
    if arguments[0] == "--rows":
        for found in run(int(arguments[1]), int(arguments[2])):
            print(json.dumps(vars(found)))
        return 0
    count, seed, begin = (int(text) for text in [*arguments, *("1", "0")[len(arguments) - 1 :]])
    start, kinds, wrongs = time.monotonic(), Counter[str](), 0
    worst = {False: 0.0, True: 0.0}
    answers = Counter[str]()
    for number in range(begin, begin + count):
        (found,) = run(1, seed, number)
        kinds.update(found.label.split())
        answers["limit" if found.gain else "0" if found.gain == 0 else "none"] += 1
        if number % 500 == 499:
            done = f"to {number}: {worst[False]:.2g}, {worst[True]:.2g}"
            print(f"{done}, {time.monotonic() - start:.0f} s", file=sys.stderr)
        free = " free" in found.label
        if found.wrong:
            wrongs += 1
            print(json.dumps(vars(found)), flush=True)
        else:
            worst[free] = max(worst[free], abs(found.error))
    print(f"{count} loops, {wrongs} wrong, answers {dict(answers)}")
    print(f"largest error {worst[False]:.2g}, of unknown phase {worst[True]:.2g}")
    print(f"{time.monotonic() - start:.0f} s; {dict(kinds)}", flush=True)
    apart = under_kernels(min(count // 10, KERNEL_LOOPS_MAX), seed)
    return int(wrongs > 0 or not apart <= KERNEL_ERROR_MAX)


def under_kernels(count: int, seed: int) -> float:
    """Returns the largest relative difference of limits between the kernels of OpenBLAS, infinite
    if an answer is wrong or of another kind."""
    rows = {}
    for kernel in kernels.executed():
        done = subprocess.run(
            [sys.executable, __file__, "--rows", str(count), str(seed)], text=True, check=True,
            env=kernels.environment(kernel), stdout=subprocess.PIPE,
        )  # fmt: skip
        rows[kernel] = [json.loads(line) for line in done.stdout.splitlines()]
    apart = 0.0
    first = next(iter(rows.values()))
    for kernel, own in rows.items():
        for a, b in zip(first, own, strict=True):
            same = not b["wrong"] and (a["gain"] is None) == (b["gain"] is None)
            share = abs(b["gain"] - a["gain"]) / (a["gain"] or 1) if same and a["gain"] else 0.0
            if not same or share > KERNEL_ERROR_MAX or bool(a["gain"]) != bool(b["gain"]):
                print(kernel, a, b, flush=True)
                share = math.inf
            apart = max(apart, share)
    print(f"{count} loops under {', '.join(rows)}: limits apart by {apart:.2g}")
    return apart


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
