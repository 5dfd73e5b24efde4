"""Measures the speed of this simulator and of other simulators. All tools have the same task and
are measured in the same run of the benchmark.

The task is a force loop of 2 s at 1500 Hz around one plant. Contact force, two positions, motor
current and ADC code are recorded at every tick. In case A, a rigid mass is pressed on a workpiece
in stable contact, with one touch-down. Case B is the same plant in a limit cycle, with 46
touch-downs and 335 switching events. The plant of both cases has 6 states. Case "full" is the model
sim/models/full_axis.toml, with 14 states, in stable contact. The control law is an integer formula.
For the tool "forceaxis+firmware", it is the function fw_tick of the firmware.

real_time_factor is 2.0 s divided by the CPU time in s that one thread needs for one run. The times
for reading models and computing modes are not included. The tools are measured in turns. In each
turn, a tool repeats its run several times, and the fastest run counts. A single run of 0.1 ms would
be slow, because the caches still contain data of the previous tool. times_forceaxis compares the
tools. In each repetition, it is the ratio of the fastest runs of two consecutive turns. The median
of these ratios counts, because the clock of a shared processor changes by a third from second to
second. force_error_N is the largest difference of the contact force, at any tick, from a reference.
The reference is an independent integration in extended precision. The other simulators and the
reference exist only in a checkout (tests/bench). odeint uses dopri5 with the tolerance 1e-4 and
locates events. mujoco uses RK4 without events, with one step for each tick. In the case "full",
mujoco needs four steps for each tick to be stable. scipy uses RK45 with the tolerance 1e-4 and
terminal events, and has only the cases A and B.

On request, the benchmark also measures the times of sweeps, frequency responses, critical gains and
the table of the advice on a loop.
"""

import ctypes
import functools
import importlib.util
import itertools
import math
import os
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from forceaxis import _core, paths, progress
from forceaxis.bench import scipy_peer
from forceaxis.bench.requirement import Requirement, at_least, at_most
from forceaxis.bench.scipy_peer import TimedRun
from forceaxis.results import json_field
from forceaxis.thesis import tables

if TYPE_CHECKING:
    import control

    from forceaxis.linear.stability import Limit, Loop

Runner = Callable[[], TimedRun | None]
Advance = Callable[[], None]  # function that advances the progress bar of the benchmark by one step

OWN_TOOLS = ("forceaxis", "forceaxis+firmware")
TOOLS = (*OWN_TOOLS, "odeint", "mujoco", "scipy")
TICKS = 3000
SPAN_S = TICKS / _core.TICKS_PER_SECOND
SETPOINT_B_N = 100
TURN_S = 0.01  # CPU time in s of one turn, in which one tool repeats its run
RESPONSE_MODEL, RESPONSE_POINTS = "full_axis", 10_000
ADVICE_MODELS = ("laboratory", "full_axis")


@dataclass(frozen=True)
class Case:
    """One case of the benchmark: an experiment, and the gain and the force set-point of its force
    loop."""

    experiment: str
    # names of three signals: contact force, position of the robot, position of the workpiece
    signals: tuple[str, str, str]
    gain: int  # gain in DAC codes per ADC code
    setpoint_N: int

    def plant(self) -> _core.BenchCase:
        """Returns the simulated plant of the benchmark case, which is an object of the compiled
        module _core."""
        return _core.BenchCase(paths.EXPERIMENTS / self.experiment, *self.signals)


@dataclass(frozen=True)
class CaseSpeed:
    """Speed and accuracy of one tool in one case of the benchmark."""

    case: str
    tool: str
    real_time_factor: float  # simulated time divided by the CPU time of one thread
    # largest difference of the contact force from the reference; None if there is no reference
    force_error_N: float | None
    codes_differ: int | None  # number of ticks in which the ADC code differs from the reference
    events: int | None  # number of switching events; None if the tool does not count events
    tick_ns: float  # CPU time of one tick in ns
    spread: float  # spread of the CPU times: median CPU time divided by the smallest one, minus 1
    runs: int
    # CPU time of the tool divided by the CPU time of forceaxis, as the median over the repetitions.
    # `times_forceaxis` is None if forceaxis was not measured.
    times_forceaxis: float | None


@dataclass(frozen=True)
class SweepSpeed:
    """Speed of a sweep of many runs on one thread and on two threads."""

    sweep: str
    runs: int
    runs_per_s_core: float  # number of runs per second of CPU time
    runs_per_s: float
    runs_per_s_two_threads: float
    # elapsed time with one thread, divided by elapsed time with two threads
    two_thread_ratio: float
    # CPU time of the sweep with two threads, divided by its CPU time with one thread
    two_thread_cpu: float


@dataclass(frozen=True)
class EventCost:
    """Straight line that gives the CPU time of a run as a function of its number of switching
    events."""

    events_least: int
    events_most: int
    run_us: float  # CPU time in us of a run without switching events
    event_us: float  # additional CPU time in us for each switching event
    r_squared: float
    worst_deviation: float  # largest relative deviation of a CPU time from the straight line
    points: list[tuple[int, float]]  # (number of events, CPU time in us) of each run


@dataclass(frozen=True)
class AnalysisSpeed:
    """CPU time of one computation of the linear analysis, with forceaxis and python-control."""

    work: str
    states: int  # number of states of the linear system
    seconds: float
    # CPU time of python-control in s; None if python-control cannot compute this result
    control_seconds: float | None
    # relative difference between the results of forceaxis and python-control
    difference: float | None


@dataclass(frozen=True)
class BenchResult:
    """The result of the whole benchmark."""

    results: list[CaseSpeed]
    missing: dict[str, str]  # {name of a tool: reason why this tool was not measured}
    load: float  # load average of the computer over the last minute
    sweeps: list[SweepSpeed] | None = json_field(omit_none=True)
    scaling: EventCost | None = json_field(omit_none=True)
    linear: list[AnalysisSpeed] | None = json_field(omit_none=True)
    checks: list[Requirement] | None = json_field(omit_none=True)


# {(case, other tool): required ratio of CPU times}. The ratios were measured on two shared cores.
# A required ratio of CPU times is 90 % of the lowest ratio in three runs of `--check`.
# The limit for the time of the advice is 110 % of the highest value in three runs.
LEAST_RATIOS = {
    ("A", "odeint"): 1.77,
    ("B", "odeint"): 1.13,
    ("full", "odeint"): 1.24,
    ("A", "mujoco"): 48,
}
RESPONSE_LEAST, ADVICE_MOST = 22, 30

AXIS_SIGNALS = ("tip.force", "robot", "workpiece")
CASES = {
    "A": Case("axis_contact_a.toml", AXIS_SIGNALS, 4, 59),
    "B": Case("axis_contact_b.toml", AXIS_SIGNALS, 15, SETPOINT_B_N),
    "full": Case("full_axis.toml", ("pad.force", "rotor", "workpiece"), 4, 59),
}
# Sweeps of 64 x 64 runs: {name: (range of the gain, range of the set-point)}.
# The gain is in DAC codes per ADC code, the set-point is in N.
SWEEPS = {"calm": ((2.0, 6.0), (20.0, 120.0)), "wide": ((1.0, 16.0), (10.0, 130.0))}
SWEEP_SIDE = 64  # number of gains in a sweep; a sweep has the same number of set-points


class Peers:
    """The shared library of tests/bench, which contains the other simulators. It exists only in a
    checkout in which it was built."""

    def __init__(self) -> None:
        path = paths.ROOT / "build" / "release" / "tests" / "bench" / "bench_peers.so"
        self.missing: dict[str, str] = {}
        self._library: ctypes.CDLL | None = None
        try:
            library = ctypes.CDLL(str(path))
            library.bench_peer.restype = library.bench_growth.restype = ctypes.c_long
            self._library = library
        except OSError:
            where = f"{paths.display(path)} not found; in a checkout tools/setup --tests builds it"
            self.missing = dict.fromkeys(("odeint", "mujoco", "reference"), where)
        if self._library is not None and self.run("mujoco", CASES["A"], False, 0) is None:
            self.missing["mujoco"] = "not built: its wheel was not in .venv at the last build"
        if importlib.util.find_spec("scipy") is None:
            self.missing["scipy"] = "not installed"

    def run(self, tool: str, case: Case, full: bool, ticks: int = TICKS) -> TimedRun | None:
        """Simulates a benchmark case once with another simulator. Returns None if the simulator
        fails.

        tool: "odeint", "mujoco" or "reference". full: True for the case "full".
        """
        assert self._library is not None
        arguments = (tool.encode(), int(full), case.gain, case.setpoint_N, ticks)
        return self._timed(self._library.bench_peer, arguments)

    def grow(self, plant: str, size: float, gain: int, setpoint_N: int) -> TimedRun:
        """Simulates a plant of forceaxis.bench.growth once with odeint. `plant`: "chain" or
        "rattle". `size`: number of bodies of the chain, or frequency of the oscillator in Hz."""
        assert self._library is not None
        arguments = (plant.encode(), ctypes.c_double(size), gain, setpoint_N, TICKS)
        done = self._timed(self._library.bench_growth, arguments)
        if done is None:
            raise RuntimeError(f"odeint failed with {plant} {size} for the reason printed above")
        return done

    def _timed(self, function: Callable[..., int], arguments: Iterable[object]) -> TimedRun | None:
        """Calls a function of the shared library and measures its CPU time. The parameters of the
        function are `arguments`, followed by the arrays for the result."""
        values = np.zeros((4, TICKS + 1))
        codes = np.zeros(TICKS + 1, np.int32)
        seconds = ctypes.c_double()
        doubles, ints = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int)
        events = function(
            *arguments, *(row.ctypes.data_as(doubles) for row in values),
            codes.ctypes.data_as(ints), ctypes.byref(seconds),
        )  # fmt: skip
        if events == -2:
            return None
        return TimedRun(values[0], codes, seconds.value, None if events < 0 else events)


def own_run(plant: _core.BenchCase, gain: int, setpoint_N: int, firmware: bool = False) -> TimedRun:
    """Simulates a benchmark case once with forceaxis. `firmware`: True if the firmware computes the
    control law."""
    done = plant.run(gain, setpoint_N, firmware)
    return TimedRun(done["force"], done["count"], done["seconds"], done["events"])


def runners(name: str, tools: Iterable[str], peers: Peers) -> dict[str, Runner]:
    """Returns {tool: function that simulates a benchmark case once}. The models are read here, so
    that only the simulation is measured later."""
    case, full = CASES[name], name == "full"
    own = functools.partial(own_run, case.plant(), case.gain, case.setpoint_N)
    every: dict[str, Runner] = {
        "forceaxis": own,
        "forceaxis+firmware": functools.partial(own, firmware=True),
        "odeint": lambda: peers.run("odeint", case, full),
        "mujoco": lambda: peers.run("mujoco", case, full),
    }
    if not full:  # The equations of motion for SciPy exist only for the benchmark cases A and B.
        every["scipy"] = lambda: scipy_peer.run(case.gain, case.setpoint_N, TICKS)
    return {t: every[t] for t in tools if t in every and t not in peers.missing}


def turn(tool: str, once: Runner) -> tuple[list[float], TimedRun]:
    """Repeats the run of a tool for TURN_S seconds. Returns the CPU time of each run in s, and the
    result of the last run."""
    times: list[float] = []
    while True:
        last = once()
        if last is None:
            raise RuntimeError(f"{tool} failed for the reason printed above")
        times.append(last.seconds)
        if sum(times) >= TURN_S:
            return times, last


def cases(
    names: Iterable[str], tools: Sequence[str], repeat: int, advance: Advance
) -> tuple[list[CaseSpeed], dict[str, str]]:
    """Returns the speed of each tool in each case of the benchmark. Also returns {tool: reason why
    this tool was not measured}."""
    peers = Peers()
    rows = []
    for name in names:
        tool_runs = runners(name, tools, peers)
        reference = None
        if "reference" not in peers.missing:
            reference = peers.run("reference", CASES[name], name == "full")
        # {tool: CPU times of its runs}, with one list of CPU times for each repetition
        seconds: dict[str, list[list[float]]] = {tool: [] for tool in tool_runs}
        last: dict[str, TimedRun] = {}
        for _ in range(repeat):
            # The tools are measured in turns, so that all have the same conditions.
            for tool, once in tool_runs.items():
                times, last[tool] = turn(tool, once)
                seconds[tool].append(times)
            advance()
        rows += [
            case_speed(name, tool, seconds[tool], seconds.get("forceaxis"), last[tool], reference)
            for tool in tool_runs
        ]
    missing = {t: why for t, why in peers.missing.items() if t in tools or t == "reference"}
    return rows, missing


def case_speed(
    case: str,
    tool: str,
    turns: Sequence[Sequence[float]],
    own_turns: Sequence[Sequence[float]] | None,
    last: TimedRun,
    reference: TimedRun | None,
) -> CaseSpeed:
    """Returns the speed and the accuracy of one tool in one benchmark case.

    turns: a list for each turn, with the CPU time in s of each run. own_turns: the same for
    forceaxis, or None if forceaxis is not measured. last: the last run of the tool.
    """
    seconds = [s for times in turns for s in times]
    error_N = codes_differ = None
    if reference:
        error_N = float(abs(last.force_N - reference.force_N).max())
        codes_differ = int((last.codes != reference.codes).sum())
    return CaseSpeed(
        case=case,
        tool=tool,
        real_time_factor=SPAN_S / min(seconds),
        force_error_N=error_N,
        codes_differ=codes_differ,
        events=last.events,
        tick_ns=1e9 * min(seconds) / TICKS,
        spread=float(np.median(seconds)) / min(seconds) - 1,
        runs=len(seconds),
        times_forceaxis=paired_ratio(turns, own_turns) if own_turns else None,
    )


def paired_ratio(turns: Sequence[Sequence[float]], other: Sequence[Sequence[float]]) -> float:
    """Returns the ratio of the CPU times of two tools. The fastest runs of both tools in one
    repetition give one ratio, and the result is the median over the repetitions."""
    ratios = [min(a) / min(b) for a, b in zip(turns, other, strict=True)]
    return float(np.median(ratios))


def sweeps(repeat: int, advance: Advance) -> list[SweepSpeed]:
    """Returns the speed of two sweeps with 4096 runs each, and the speed of the 55 runs for a table
    in the thesis."""
    plant = CASES["A"].plant()
    known = tables.load()
    jobs = [known.job(c) for c in known.cells]

    def cells_once(threads: int) -> tuple[float, float]:
        wall, cpu = time.perf_counter(), time.process_time()
        _core.run_many(jobs, threads)
        return time.perf_counter() - wall, time.process_time() - cpu

    def sweep_once(name: str, threads: int) -> tuple[float, float]:
        done = plant.sweep(*SWEEPS[name], SWEEP_SIDE, threads)
        return done["wall_s"], done["cpu_s"]

    # {name of a sweep: (number of runs, function that does all runs of the sweep)}.
    # The function for the runs of a sweep has the number of threads as its argument.
    # The function for the runs of a sweep returns elapsed time and CPU time of the sweep in s.
    work: dict[str, tuple[int, Callable[[int], tuple[float, float]]]] = {
        name: (SWEEP_SIDE**2, functools.partial(sweep_once, name)) for name in SWEEPS
    }
    work["cells"] = (len(jobs), cells_once)
    rows = []
    for name, (runs, once) in work.items():
        times: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
        for _ in range(repeat):
            for threads, taken in times.items():
                taken.append(once(threads))
            advance()
        (wall_one, cpu_one), (wall_two, cpu_two) = (np.min(times[n], axis=0) for n in times)
        rows.append(
            SweepSpeed(
                sweep=name,
                runs=runs,
                runs_per_s_core=float(runs / cpu_one),
                runs_per_s=float(runs / wall_one),
                runs_per_s_two_threads=float(runs / wall_two),
                two_thread_ratio=float(wall_one / wall_two),
                two_thread_cpu=float(cpu_two / cpu_one),
            )
        )
    return rows


def event_cost(repeat: int, gains: Sequence[int] = range(2, 26)) -> EventCost:
    """Runs case B with several gains and fits a straight line to the CPU times: seconds = a + b
    events. `events` is the number of switching events in a run."""
    plant = CASES["B"].plant()
    seconds: dict[int, list[float]] = {gain: [] for gain in gains}
    for _ in range(max(repeat, 3)):
        for gain, times in seconds.items():
            times += [own_run(plant, gain, SETPOINT_B_N).seconds for _ in range(5)]
    x = np.array([own_run(plant, gain, SETPOINT_B_N).events for gain in gains], float)
    y = np.array([min(times) for times in seconds.values()])
    b, a = np.polyfit(x, y, 1)
    off = y - (a + b * x)
    return EventCost(
        events_least=int(x.min()),
        events_most=int(x.max()),
        run_us=float(1e6 * a),
        event_us=float(1e6 * b),
        r_squared=float(1 - (off**2).sum() / ((y - y.mean()) ** 2).sum()),
        worst_deviation=float(abs(off / (a + b * x)).max()),
        points=[(int(e), float(1e6 * t)) for e, t in zip(x, y, strict=True)],
    )


def fastest(repeat: int, *works: Callable[[], Any]) -> list[tuple[float, Any]]:
    """Calls several functions in turns, each `repeat` times. The result has a pair for each
    function: CPU time in s of its fastest call, and result of its last call."""
    found: list[tuple[float, Any]] = [(math.inf, None)] * len(works)
    for _ in range(repeat):
        for i, work in enumerate(works):
            start = time.process_time()
            result = work()
            found[i] = (min(found[i][0], time.process_time() - start), result)
    return found


def critical_gain_by_bisection(sampled: "control.StateSpace") -> float:
    """Returns the critical gain of a sampled system, computed with python-control to a relative
    error of 1e-9.

    The gain is increased in steps of 5 % from 1e-4 on; then the interval is bisected.
    """
    import control

    def stable(gain: float) -> bool:
        return bool(np.all(np.abs(control.feedback(gain * sampled, 1).poles()) < 1))

    low = 1e-4
    while stable(1.05 * low):
        low *= 1.05
    high = 1.05 * low
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def fresh_limit(loop: "Loop") -> "Limit":
    """Returns the critical gain of a loop, computed without stored results of earlier
    computations."""
    return replace(loop).limit()


def linear_analysis(repeat: int, advance: Advance) -> list[AnalysisSpeed]:
    """Measures the CPU times of a frequency response, of a critical gain, and of the table that
    advises changes of a force loop. The first two are also measured with python-control.

    Both tools use the same matrices. The frequency response has 10,000 frequencies, and its time
    includes the transformation of the matrices to Hessenberg form. forceaxis computes the critical
    gain together with all other gains at which a pole crosses the stability boundary. With
    python-control, the critical gain is found by bisection, with the poles of control.feedback.
    control.stability_margins is not used, because it uses a frequency grid for these loops and does
    not find the critical gain.
    """
    from forceaxis import linear
    from forceaxis.design import advise
    from forceaxis.linear import loops

    repeat = min(repeat, 3)
    frequency = np.geomspace(0.1, 1000.0, RESPONSE_POINTS)
    system = linear.linearise(RESPONSE_MODEL)
    theirs = system.state_space()
    # replace() returns a copy of the system without stored results of earlier computations.
    (seconds, response), (control_seconds, peer) = fastest(
        repeat,
        lambda: replace(system).response(frequency),
        lambda: theirs(2j * np.pi * frequency),
    )
    rows = [
        AnalysisSpeed(
            work=f"{RESPONSE_POINTS} frequencies of {RESPONSE_MODEL}",
            states=len(system.A),
            seconds=seconds,
            control_seconds=control_seconds,
            difference=float(np.max(np.abs(response / peer - 1))),
        )
    ]
    advance()
    for model in ADVICE_MODELS:
        loop = loops.force_loop(model)
        states = len(loop.open.A)
        (seconds, limit), (control_seconds, gain), (advice_seconds, advice) = fastest(
            repeat,
            functools.partial(fresh_limit, loop),
            functools.partial(critical_gain_by_bisection, loop.open.state_space()),
            functools.partial(advise.advise, advise.AdviceOrder(model, runs="none")),
        )
        assert limit.gain is not None
        work, difference = f"critical gain of {model}", abs(gain / limit.gain - 1)
        rows.append(AnalysisSpeed(work, states, seconds, control_seconds, difference))
        work = f"advice table of {model}, {len(advice.rows)} rows"
        rows.append(AnalysisSpeed(work, states, advice_seconds, None, None))
        advance()
    return rows


def run(
    names: Collection[str],
    tools: Sequence[str],
    repeat: int,
    with_sweeps: bool,
    with_linear: bool = False,
) -> BenchResult:
    """Runs the benchmark for some cases and tools. The measured speeds are not compared with the
    required speeds here."""
    sweep_repeat = min(repeat, 5)
    steps = len(names) * repeat + (with_sweeps and (len(SWEEPS) + 1) * sweep_repeat)
    steps += with_linear and 1 + len(ADVICE_MODELS)
    with progress.bar("bench", steps) as show:
        done = itertools.count(1)

        def advance() -> None:
            show(next(done), steps)

        rows, missing = cases(names, tools, repeat, advance)
        return BenchResult(
            results=rows,
            missing=missing,
            load=os.getloadavg()[0],
            sweeps=sweeps(sweep_repeat, advance) if with_sweeps else None,
            scaling=event_cost(repeat) if with_sweeps else None,
            linear=linear_analysis(repeat, advance) if with_linear else None,
        )


def check(result: BenchResult) -> list[Requirement]:
    """Compares the measured values of the benchmark with its requirements. Returns the
    requirements.

    All required speeds are ratios of CPU times that one run of the benchmark has measured. A
    quantity that was not measured does not meet its requirement. MuJoCo has a requirement only if
    it is installed.
    """
    row = {(r.case, r.tool): r for r in result.results}

    def times(case: str, tool: str) -> float | None:
        found = row.get((case, tool))
        return found.times_forceaxis if found else None

    def speed(case: str) -> float | None:
        found = row.get((case, "forceaxis"))
        return found.real_time_factor if found else None

    checks = [
        at_least(f"{case}: plant / {peer}", times(case, peer), least)
        for (case, peer), least in LEAST_RATIOS.items()
        if peer != "mujoco" or peer not in result.missing
    ]
    for case, most_N in (("A", 1e-9), ("B", 1e-8)):
        firmware = times(case, "forceaxis+firmware")
        checks.append(at_most(f"{case}: CPU time with firmware / plant", firmware, 2))
        for tool in OWN_TOOLS:
            found = row.get((case, tool))
            error_N = found.force_error_N if found else None
            checks.append(at_most(f"{case}: force error of {tool}, N", error_N, most_N))
    full_per_a = ratio(speed("A"), speed("full"))
    checks.append(at_most("tick of full / tick of A", full_per_a, 4))
    for r in result.sweeps or ():
        checks.append(at_most(f"{r.sweep}: CPU time of two threads / one", r.two_thread_cpu, 1.1))
    checks += linear_checks(result.linear or ())
    if result.scaling:
        r_squared = result.scaling.r_squared
        checks.append(at_least("cost is linear in events, R^2", r_squared, 0.98))
    return checks


def ratio(a: float | None, b: float | None) -> float | None:
    """Returns a / b, or None if one of them was not measured."""
    return a / b if a and b else None


def linear_checks(rows: Iterable[AnalysisSpeed]) -> list[Requirement]:
    """Returns the requirements on the CPU times of the linear analysis. The time for the table that
    advises changes of a loop is compared with the time that python-control needs for one critical
    gain of the same model."""
    checks = []
    # CPU time of python-control for the last computation that it was able to do
    control_seconds: float | None = None
    for a in rows:
        if a.control_seconds is None:
            quantity = f"{a.work} / python-control's critical gain"
            checks.append(at_most(quantity, ratio(a.seconds, control_seconds), ADVICE_MOST))
            continue
        control_seconds = a.control_seconds
        quantity = f"{a.work}, difference from python-control"
        if "frequencies" in a.work:
            speedup = ratio(control_seconds, a.seconds)
            checks.append(
                at_least(f"{a.work}: python-control / forceaxis", speedup, RESPONSE_LEAST)
            )
            checks.append(at_most(quantity, a.difference, 1e-6))
        else:
            checks.append(at_most(quantity, a.difference, 1e-8))
    return checks
