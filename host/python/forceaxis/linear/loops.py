"""Force loops: control laws around a plant. The class `stability.Loop` analyses force loops.

A law is u = k e - K_v v in volts. The error e is the set-point minus the feedback, in newtons:

    p           k (f_d - f)                             Fig 1.3
    pi          k (1 + w_i / s) (f_d - f)               1.1.3
    pd          k (f_d - f - T_d f')                    1.1.3
    lead        k (1 + s / w_z) / (1 + s / w_p) (f_d - f)   6.2.1
    derivative  k (f_d - f - T_d f'), f' from a velocity-sensing force sensor   6.2.1
    stiffness   k (K_fs (x_d - x) - f)                  Fig 1.5
    damping     k (K_fd (v_d - v) - f)                  Fig 1.6
    impedance   k (K_fs (x_d - x) + K_fd (v_d - v) + f_d - f)   Fig 1.7
    bank        k (integral and sections) (f_d - f), the firmware's general law, see `bank`

f is the signal of ADC 0. x and v are position and velocity of the encoder, which are those of the
drive's body relative to its reaction body. K_v is the optional inner damping of Figs 1.3 and 1.5.

With zoh and zoh+1, the law runs once per tick. The integral is then a sum that includes the present
error. As in the firmware, v and the f' of law pd are backward differences. Law lead is transformed
bilinearly, and law derivative samples its sensor. A code is output in the tick of its measurement
(zoh), or one tick later (zoh+1, firmware.latency_ticks = 1).
"""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np

from forceaxis import _core
from forceaxis.errors import ParameterError
from forceaxis.linear.bank import GAIN_STEP, Bank, series
from forceaxis.linear.equations import Matrix, StateSpace
from forceaxis.linear.lifted import Samples, TickPlant, Within, lift
from forceaxis.linear.periodic import FreeLoop, PeriodicLoop
from forceaxis.linear.plant_facts import BusFacts, Overrides, PlantFacts, SamplingFacts
from forceaxis.linear.stability import Loop
from forceaxis.linear.system import TICK_S, System, facts, find_model, linearise
from forceaxis.linear.working import States, cut_by, working

TIMINGS = ("continuous", "zoh", "zoh+1")
# Names of the parameters of each control law. Only the parameter for inner damping is optional.
LAWS: dict[str, tuple[str, ...]] = {
    "p": (),
    "pi": ("integral_rad_per_s",),
    "pd": ("derivative_s",),
    "lead": ("lead_zero_hz", "lead_pole_hz"),
    "derivative": ("derivative_s",),
    "stiffness": ("stiffness_N_per_m",),
    "damping": ("damping_Ns_per_m",),
    "impedance": ("stiffness_N_per_m", "damping_Ns_per_m"),
    "bank": (),
}
MOTION_LAWS = (
    "stiffness",
    "damping",
    "impedance",
)  # control laws that feed back position or velocity in addition to the force
VELOCITY_GAIN = "velocity_gain_Vs_per_m"
# Largest number of ticks after which the samples of a force sensor and the bus cycles repeat.
PERIOD_TICKS_MAX = 150
# Largest `force_gain` of the firmware, in DAC codes per 8-bit count.
FIRMWARE_HIGHEST = 65535 * GAIN_STEP
_NO_MATRIX = np.zeros((0, 0))
_NO_SYSTEM = System(_NO_MATRIX, _NO_MATRIX, _NO_MATRIX, _NO_MATRIX, (), (), ())


@dataclass(frozen=True)
class LoopSpec:
    """A force loop without its plant: control law, delay of the loop, and controlled signal.

    law: a name of LAWS. timing: delay of the loop, a name of TIMINGS. output: signal that is
    controlled instead of the force. "reading" is the input of ADC 0. free: True if contacts are
    open. parameters: {name in LAWS[law]: value in SI units}. Laws with inner damping also have
    velocity_gain_Vs_per_m (V s/m).

    bank: the filter bank of law "bank", or a filter before a law of motion. The gain of the loop
    replaces the gain of the bank. late_motion: True if a law of motion gets x and v of the previous
    tick, as in the drive's modes of motion. tick_s: sampling period of zoh and zoh+1 in s.
    """

    law: str = "p"
    timing: str = "zoh"
    output: str = "reading"
    free: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)
    bank: Bank | None = None
    late_motion: bool = False
    tick_s: float = TICK_S

    @property
    def is_continuous(self) -> bool:
        """True if the control law acts in continuous time, without sampling."""
        return self.timing == "continuous"

    def around(
        self, model: str | Path, overrides: Overrides | None = None, modes: States | None = None
    ) -> Loop:
        """Returns the force loop around a model. For the arguments `model`, `overrides` and
        `modes`, see `linear.linearise`.

        Raises InputError if the model lacks something that the law needs, and ParameterError for a
        wrong field of this specification.
        """
        _check(self)
        known = facts(model, overrides)
        if self.is_continuous or self.tick_s != TICK_S:
            known.expect_no_bus("a loop that does not run once in a tick")
        sampling = _sampling(self, known)
        where = str(find_model(model))
        mode = working(where, overrides, modes, self.free)
        site = _Site(known, where, overrides, mode.modes)
        signal, unit = _controlled(known, where, self.law, self.output)
        inner = _inner_damping(self, known, where)
        per_count = known.required_reading.per_count if self.output == "reading" else None
        own = Loop(
            model=where,
            law=self.law,
            timing=self.timing,
            whole=_NO_SYSTEM,
            signal=signal,
            unit=f"V/({unit})" if "/" in unit or " " in unit else f"V/{unit}",
            codes_per_gain=None if per_count is None else abs(per_count) / known.volts_per_code,
            parameters=dict(self.parameters),
            bank=self.bank,
            working=mode,
        )
        if known.bus.is_immediate and sampling is None:
            return replace(own, whole=_with_law(self, _plant(self, site, signal, unit, inner)))
        return _lifted(self, site, inner, own)


def force_loop(
    model: str | Path,
    law: str = "p",
    timing: str = "zoh",
    overrides: Overrides | None = None,
    modes: States | None = None,
    output: str = "reading",
    free: bool = False,
    **parameters: float | None,
) -> Loop:
    """Returns the force loop of a control law around a model. For force loops with a filter bank or
    another sampling period, see LoopSpec.

    model: a path, or the file name without suffix in sim/models. overrides: {parameter of the
    model: value}. modes: {element: state}. free: True if contacts are open. law, timing, output: as
    in LoopSpec. parameters: those parameters that the law needs, of integral_rad_per_s (1/s),
    derivative_s (s), lead_zero_hz and lead_pole_hz (Hz), stiffness_N_per_m and damping_Ns_per_m.
    Also velocity_gain_Vs_per_m. None means that a parameter is not given.

    Raises InputError for a model, signal or state that does not exist, and ParameterError for a
    law, timing or parameter that is wrong or missing.
    """
    given = {name: float(value) for name, value in parameters.items() if value is not None}
    return LoopSpec(law, timing, output, free, given).around(model, overrides, modes)


def _first_order(a: float, b: float, c: float, d: float) -> StateSpace:
    """Returns the state space of a system with one state. a, b, c, d: entries of its matrices,
    which are 1 x 1."""
    A, B, C, D = (np.array([[float(value)]]) for value in (a, b, c, d))
    return A, B, C, D


def _compensator(law: str, p: Mapping[str, float], dt: float | None) -> StateSpace:
    """Returns the dynamic part of a control law as a state space. It is the integral of law pi, or
    the filter of law lead."""
    if law == "pi":
        w = p["integral_rad_per_s"]
        return _first_order(0, 1, w, 1) if dt is None else _first_order(1, w * dt, 1, 1 + w * dt)
    wz, wp = (2 * math.pi * p[name] for name in ("lead_zero_hz", "lead_pole_hz"))
    if dt is None:
        return _first_order(-wp, wp, 1 - wp / wz, wp / wz)
    # Bilinear transformation: s = 2/T (z - 1)/(z + 1).
    (az, bz), (ap, bp) = ((1 + 2 / (dt * w), 1 - 2 / (dt * w)) for w in (wz, wp))
    return _first_order(-bp / ap, 1, (bz - az * bp / ap) / ap, az / ap)


def _check(spec: LoopSpec) -> None:
    """Raises ParameterError if two fields of the force loop `spec` contradict each other."""
    law, bank = spec.law, spec.bank
    if law == "bank" and bank is None:
        raise ParameterError(
            "law",
            "expected an experiment that selects a bank together with law bank; choose another "
            "law or another experiment",
        )
    if bank is not None and law not in ("bank", *MOTION_LAWS):
        raise ParameterError(
            "law", f"expected law bank or a law of motion for an experiment with a bank, got {law}"
        )
    if bank is not None and spec.is_continuous:
        raise ParameterError(
            "timing",
            "expected zoh or zoh+1 together with law bank, because the firmware computes a "
            "bank once per tick",
        )
    if law not in LAWS:
        raise ParameterError("law", f"expected one of {', '.join(LAWS)}, got {law}")
    if spec.timing not in TIMINGS:
        raise ParameterError("timing", f"expected one of {', '.join(TIMINGS)}, got {spec.timing}")
    inner = () if law in ("damping", "impedance") else (VELOCITY_GAIN,)
    for name, value in spec.parameters.items():
        if name not in (*LAWS[law], *inner):
            raise ParameterError(
                name,
                f"expected this parameter only with another law, because law {law} does not use it",
            )
        _check_number(name, value)
    for name in LAWS[law]:
        if name not in spec.parameters:
            raise ParameterError(
                name, f"expected a value of this parameter, because law {law} uses this parameter"
            )


def _check_number(name: str, value: float) -> None:
    """Raises ParameterError if a parameter of a control law is not finite or has the wrong sign."""
    may_be_0 = name in (VELOCITY_GAIN, "stiffness_N_per_m", "damping_Ns_per_m")
    if not (math.isfinite(value) and (value >= 0 if may_be_0 else value > 0)):
        wanted = ">= 0" if may_be_0 else "> 0"
        raise ParameterError(name, f"expected a number {wanted}, got {value:g}")


class _Site(NamedTuple):
    """The plant around which a force loop is closed: contents and file of the model, overrides of
    its parameters, and states of its elements."""

    known: PlantFacts
    where: str
    overrides: Overrides | None
    states: dict[str, str]


class _Plant(NamedTuple):
    """A plant whose outputs are the signals that a control law can feed back. These are the force
    f, its time derivative, the position x and the velocity v."""

    A: Matrix
    B: Matrix
    f: Matrix
    rate: Matrix
    x: Matrix
    v: Matrix
    direct: Matrix  # direct path from the command to f, which is part of the matrix D
    rate_direct: Matrix
    states: tuple[str, ...]


def _controlled(known: PlantFacts, where: str, law: str, output: str) -> tuple[str, str]:
    """Returns (name, unit) of the signal that a force loop controls. Raises InputError if the model
    has no such signal."""
    if known.drive is None:
        raise _core.InputError(
            f"{where}: drive: expected a model with a [drive], got a model without a drive; "
            "choose another model"
        )
    if output == "reading" and known.reading is None:
        raise no_reading(where)
    signal = known.required_reading.signal if output == "reading" else output
    unit = known.signals.get(signal, "count")
    if unit != "N" and law in MOTION_LAWS:
        raise ParameterError(
            "output",
            f"expected a force as output with law {law}, got {signal} in {unit}; choose another "
            "output",
        )
    return signal, unit


def _encoder_scale(known: PlantFacts, where: str) -> float:
    """Returns the number of encoder counts per metre of the model."""
    if known.encoder is None:
        raise _core.InputError(
            f"{where}: encoder: expected a model with an [encoder], because the loop has a "
            "velocity gain, got a model without an encoder"
        )
    return known.required_encoder.scale


def _force_rate(known: PlantFacts, signal: str, unit: str) -> str:
    """Returns the name of the signal that is the time derivative of the force `signal`. It is the
    force of a spring or contact."""
    rate = signal.rpartition(".")[0] + ".spring_force_rate"
    if unit != "N" or rate not in known.signals:
        raise ParameterError(
            "output",
            "expected the force of a spring or contact as output with law derivative, got "
            f"{signal}",
        )
    return rate


def _inner_damping(spec: LoopSpec, known: PlantFacts, where: str) -> float:
    """Returns the velocity gain K_v in V s/m: the velocity gain of the control law, or of its
    filter bank."""
    if spec.bank is not None and spec.bank.velocity_gain:
        scale = _encoder_scale(known, where)
        return spec.bank.velocity_gain * known.volts_per_code * scale * TICK_S
    return spec.parameters.get(VELOCITY_GAIN, 0.0)


def _plant(spec: LoopSpec, site: _Site, signal: str, unit: str, inner: float) -> _Plant:
    """Returns the plant with inner damping, and with the signals that the control law feeds back as
    outputs. The plant is sampled as `timing` of `spec` requires."""
    law, moves = spec.law, bool(spec.law in MOTION_LAWS or inner)
    names = [spec.output]
    if law == "derivative":
        names.append(_force_rate(site.known, signal, unit))
    system = _feedback(spec, site, signal, moves, names)
    if spec.is_continuous:
        plant = _continuous(system, law, site.where)
    else:
        plant = _sampled(system, law, spec.timing, spec.tick_s, moves)
    if inner:
        plant = plant._replace(A=plant.A - inner * plant.B @ plant.v)
        if law == "pd" and spec.is_continuous:
            plant = plant._replace(rate=plant.f @ plant.A)
    if spec.late_motion and law in MOTION_LAWS and not spec.is_continuous:
        plant = _late_motion(plant)
    return plant


def _lifted(spec: LoopSpec, site: _Site, inner: float, own: Loop) -> Loop:
    """Returns a force loop over the bus of the model, or with the sampling of the model's force
    sensor. The loop is a linear system over the period after which its ticks repeat. `own`: the
    loop in which this system is still missing."""
    known, timing = site.known, spec.timing
    sampling = _sampling(spec, known)
    if not known.bus.is_immediate:
        timing += f", {known.bus.label()}"
    if sampling:
        timing += f", force at {sampling.label()}"
    plant = _tick_plant(spec, site, inner, own)

    def of(samples: Samples | None) -> Loop:
        return _of_one_period(plant, known.bus, samples, replace(own, timing=timing), spec)

    phases = _samples(spec, known.path, sampling, known.bus.cycle_ticks)
    each = [of(samples) for samples in phases]
    first = phases[0]
    if len(each) == 1 or first is None:
        return each[0]
    given = {f.name: getattr(each[0], f.name) for f in fields(Loop)}
    between = lambda order, share: of(first.within(order, share))  # noqa: E731
    return FreeLoop(**given, each=tuple(each), between=between)


def _sampling(spec: LoopSpec, known: PlantFacts) -> SamplingFacts | None:
    """Returns the sampling of the controlled signal, or None if this signal has a new value in each
    tick."""
    converted = spec.output in ("reading", "adc0")
    return known.reading.sampling if known.reading and converted else None


def _samples(
    spec: LoopSpec, path: str, sampling: SamplingFacts | None, cycle_ticks: int
) -> list[Samples | None]:
    """Returns the sample times of the force sensor for all phases between samples and ticks that
    have to be analysed. `sampling`: None for a sample in each tick. Raises InputError if the sample
    times do not repeat within PERIOD_TICKS_MAX ticks."""
    if sampling is None:
        return [None]
    if spec.law == "derivative":
        raise _core.InputError(
            f"{path}: adc.sample_rate: expected an ADC that samples at each tick, because the law "
            f"`derivative` needs a sample at each tick, got {sampling.label()}; choose the law `pd`"
        )
    every = Fraction(1 / TICK_S).limit_denominator() / Fraction(sampling.rate_hz)
    if math.lcm(every.numerator, cycle_ticks) > PERIOD_TICKS_MAX:
        raise _core.InputError(
            f"{path}: adc.sample_rate: expected a sampling rate at which the instants of "
            f"sampling, relative to the bus cycles, repeat after at most {PERIOD_TICKS_MAX} ticks "
            f"of 1/1500 s, got {sampling.rate_hz:g} Hz; give the nearest such rate, and check the "
            "result with `run_experiment` at the rate of the sensor"
        )
    latency = Fraction(sampling.latency_s / TICK_S).limit_denominator(10**6)
    if sampling.phase_s is None:
        free = Samples(every, Fraction(0), latency, sampling.sinc_order)
        return list(free.phases(cycle_ticks))
    phase = Fraction(sampling.phase_s / TICK_S).limit_denominator(10**6) % every
    return [Samples(every, phase, latency, sampling.sinc_order)]


def _tick_plant(spec: LoopSpec, site: _Site, inner: float, own: Loop) -> TickPlant:
    """Returns the linear model of the plant and of the control law over one tick."""
    law, given = spec.law, spec.parameters
    names = [spec.output]
    if law == "derivative":
        names.append(_force_rate(site.known, own.signal, site.known.signals.get(own.signal, "")))
    moves = bool(law in MOTION_LAWS or inner)
    system = _feedback(spec, site, own.signal, moves, names)
    plant = _sampled(system, "p", "zoh", spec.tick_s, False)

    @functools.cache
    def within(share: Fraction) -> Within:
        part = system.sampled(0, float(share) * spec.tick_s, extended=True)
        row = np.zeros((1, len(plant.A)), np.longdouble)
        row[:, : len(part.A)] = part.C[:1] @ part.A
        return Within(row, part.C[:1] @ part.B + part.D[:1])

    @functools.cache
    def moments(share: Fraction, count: int) -> Within:
        part = _integrated(system, count, spec.tick_s)
        part = part.sampled(0, float(share) * spec.tick_s, extended=True)
        n = len(system.A)
        rows = np.zeros((count, len(plant.A)), np.longdouble)
        rows[:, :n] = part.A[n:, :n]
        return Within(rows, part.B[n:])

    front: StateSpace = _gain()
    if law in ("pi", "lead"):
        front = _compensator(law, given, spec.tick_s)
    if spec.bank is not None:
        front = spec.bank.compensator()
    derivative_s = given.get("derivative_s", 0.0)
    return TickPlant(
        plant.A,
        plant.B,
        plant.f + derivative_s * plant.rate if law == "derivative" else plant.f,
        within,
        moments,
        derivative_s if law == "pd" else 0.0,
        plant.f,
        plant.x,
        given.get("stiffness_N_per_m", 0.0),
        given.get("damping_Ns_per_m", 0.0),
        inner,
        front,
        spec.tick_s,
        int(spec.timing == "zoh+1"),
        int(spec.late_motion and law in MOTION_LAWS),
    )


def _integrated(system: System, count: int, tick_s: float) -> System:
    """Returns a continuous system with `count` additional states. These are the integral of the
    first output, the integral of this integral, and so on, with the tick as the unit of time."""
    n = len(system.A)
    A, B = np.zeros((n + count, n + count)), np.zeros((n + count, 1))
    A[:n, :n], B[:n] = system.A, system.B
    A[n, :n], B[n] = system.C[0] / tick_s, system.D[0] / tick_s
    for k in range(n + 1, n + count):
        A[k, k - 1] = 1 / tick_s
    C = np.hstack([system.C, np.zeros((len(system.C), count))])
    states = (*system.states, *(f"integral {k}" for k in range(1, count + 1)))
    return replace(system, A=A, B=B, C=C, states=states)


def _of_one_period(
    plant: TickPlant, bus: BusFacts, samples: Samples | None, own: Loop, spec: LoopSpec
) -> Loop:
    """Returns the loop `own`, completed by its linear system over the period after which its ticks
    repeat."""
    loop = lift(plant, bus, samples)
    codes = loop.B.shape[1]
    states = tuple(f"state {i}" for i in range(len(loop.A)))
    inputs = tuple(f"code {i}" for i in range(codes)) if codes > 1 else ("code",)
    outputs = tuple(f"feedback {i}" for i in range(codes)) if codes > 1 else ("feedback",)
    whole = System(
        loop.A, loop.B, loop.C, loop.D, states, inputs, (*outputs, spec.output),
        codes * bus.cycle_ticks * spec.tick_s,
    )  # fmt: skip
    given = {f.name: getattr(own, f.name) for f in fields(Loop)}
    given |= {"whole": whole, "entry": (loop.enters, loop.direct)}
    return Loop(**given) if codes == 1 else PeriodicLoop(**given)


def _gain() -> StateSpace:
    """Returns the state space of a law without states."""
    return np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))


def _feedback(spec: LoopSpec, site: _Site, signal: str, moves: bool, names: list[str]) -> System:
    """Returns the plant as a System with four outputs: force f, time derivative of the force f',
    position x and velocity v.

    names: name of the output, and of its time derivative if the law needs it.
    """
    known, where = site.known, site.where

    def read(outputs: tuple[str, ...], states: States = site.states) -> System:
        return linearise(
            where, outputs=outputs, overrides=site.overrides, modes=states, free=spec.free
        )

    measured = known.encoder
    bodies = (
        (measured.body, measured.reference)
        if measured
        else (known.required_drive.body, known.required_drive.reaction)
    )
    wanted = list(names)
    if moves:
        for body in bodies:
            if body != "ground":
                wanted += [f"{body}.position", f"{body}.velocity"]
    plant = read(tuple(wanted))
    if not plant.select(outputs=names[:1]).has_path():
        cut = cut_by(
            where, site.overrides, site.states, lambda m: read((spec.output,), m).has_path()
        )
        raise _core.InputError(
            f"{where}: output: expected a signal path from drive.command to {signal}, got none in "
            f"this mode{cut or '; choose another output or another mode of the elements'}"
        )

    def row(matrix: Matrix, name: str) -> Matrix:
        found: Matrix = matrix[[plant.outputs.index(name)]]
        return found

    def relative(matrix: Matrix, quantity: str) -> Matrix:
        zero = np.zeros_like(matrix[:1])
        values = [
            row(matrix, f"{body}.{quantity}") if body != "ground" else zero for body in bodies
        ]
        return values[0] - values[1]

    def rows(matrix: Matrix) -> Matrix:
        zero = np.zeros_like(matrix[:1])
        rate = row(matrix, names[1]) if len(names) > 1 else zero
        x, v = (relative(matrix, q) if moves else zero for q in ("position", "velocity"))
        return np.vstack([matrix[:1], rate, x, v])

    return replace(plant, C=rows(plant.C), D=rows(plant.D), outputs=("f", "f'", "x", "v"))


def _continuous(system: System, law: str, where: str) -> _Plant:
    """Returns the plant for a control law in continuous time, as a _Plant."""
    A, B, C, D = system.A, system.B, system.C, system.D
    f, rate, x, v = (C[[i]] for i in range(4))
    direct, rate_direct = D[:1], D[1:2]
    if law == "pd":
        if direct[0, 0]:
            raise _core.InputError(
                f"{where}: output: expected a signal that does not jump when the drive command "
                "jumps, because the law `pd` uses the derivative of this signal; choose another "
                "timing or output"
            )
        rate, rate_direct = f @ A, f @ B
    return _Plant(A, B, f, rate, x, v, direct, rate_direct, system.states)


def _sampled(system: System, law: str, timing: str, tick_s: float, moves: bool) -> _Plant:
    """Returns the plant for a control law that is computed once per tick, as a _Plant. The velocity
    and, for law pd, the time derivative of the force are backward differences."""
    system = system.sampled(0, tick_s, extended=True)
    A, B, C, D = system.A, system.B, system.C, system.D
    states = system.states
    # The ADC converts immediately before the new DAC code acts.
    # A direct path from the DAC code to the measured force therefore acts one tick later.
    if D.any():
        n = len(A)
        A = np.block([[A, np.zeros((n, 1))], [np.zeros((1, n + 1))]])
        B = np.vstack([B, np.ones((1, 1))])
        C, D = np.hstack([C, D]), np.zeros_like(D)
        states += ("code before",)
    system = replace(system, A=A, B=B, C=C, D=D, states=states)
    if timing == "zoh+1":
        system = system.delayed()
    A, B, C, states = system.A, system.B, system.C, system.states
    f, rate, x, v = (C[[i]] for i in range(4))
    if moves:
        A, B, (f, rate, x, before) = _with_last(A, B, [f, rate, x], x)
        v = (x - before) / tick_s
        states += ("x before",)
    if law == "pd":
        A, B, (f, rate, x, v, before) = _with_last(A, B, [f, rate, x, v], f)
        rate = (f - before) / tick_s
        states += ("f before",)
    none = np.zeros((1, 1))
    return _Plant(A, B, f, rate, x, v, none, none, states)


def _late_motion(plant: _Plant) -> _Plant:
    """Returns the plant with the position x and velocity v of the previous tick, as a _Plant."""
    A, B, (f, rate, v, x) = _with_last(plant.A, plant.B, [plant.f, plant.rate, plant.v], plant.x)
    A, B, (f, rate, x, v) = _with_last(A, B, [f, rate, x], v)
    states = (*plant.states, "x late", "v late")
    return plant._replace(A=A, B=B, f=f, rate=rate, x=x, v=v, states=states)


def _with_law(spec: LoopSpec, plant: _Plant) -> System:
    """Returns the control law and the plant in series. The input of the result is the error. The
    outputs are the feedback of the law and the controlled signal."""
    law, given = spec.law, spec.parameters
    dt = None if spec.is_continuous else spec.tick_s
    fed, fed_direct = plant.f.copy(), plant.direct.copy()
    if law in ("pd", "derivative"):
        derivative_s = given["derivative_s"]
        fed = fed + derivative_s * plant.rate
        fed_direct = plant.direct + derivative_s * plant.rate_direct
    if law in ("stiffness", "impedance"):
        fed = fed + given["stiffness_N_per_m"] * plant.x
    if law in ("damping", "impedance"):
        fed = fed + given["damping_Ns_per_m"] * plant.v
    states = plant.states
    space = (plant.A, plant.B, np.vstack([fed, plant.f]), np.vstack([fed_direct, plant.direct]))
    if law in ("pi", "lead"):
        space = series(_compensator(law, given, dt), space)
        states = (law, *states)
    if spec.bank is not None:
        front = spec.bank.compensator()
        space = series(front, space)
        states = (*(f"law {i}" for i in range(len(front[0]))), *states)
    return System(*space, states, ("error",), ("feedback", spec.output), dt)


def no_reading(where: str) -> _core.InputError:
    """Returns the InputError for a model without an ADC on channel 0."""
    return _core.InputError(
        f"{where}: adc: expected a model with an ADC on channel 0, got none; choose another output"
    )


def _with_last(
    A: Matrix, B: Matrix, rows: list[Matrix], kept: Matrix
) -> tuple[Matrix, Matrix, list[Matrix]]:
    """Adds a state to a sampled system. The new state is the last sample of the output whose row is
    `kept`. Returns (A, B, rows, new row). `rows` are the rows of all given outputs for the larger
    system. The new row outputs the added state."""
    n = len(A)
    A = np.block([[A, np.zeros((n, 1))], [kept, np.zeros((1, 1))]])
    B = np.vstack([B, np.zeros((1, B.shape[1]))])
    last = np.zeros((1, n + 1))
    last[0, n] = 1.0
    return A, B, [*(np.hstack([row, np.zeros((1, 1))]) for row in rows), last]
