"""`forceaxis bench`: speed of the simulator and of other tools, on the same task in the same
run.

The work is a force loop of 2 s at 1500 Hz around one plant, recording contact force, two
positions, motor current and ADC code at every tick. Its plants: one rigid mass on a workpiece in
stable contact (A: one touch-down) and in a limit cycle (B: 46 touch-downs, 335 switchings), 6
states each, and sim/models/full_axis.toml, 14 states in stable contact (full). The law is the
scenario's own in integers, or the firmware's fw_tick ("forceaxis+firmware").

real_time_factor is 2.0 s over the CPU seconds of one thread for one run, models read and modes
built before. Tools take turns of some runs each (a single run of 0.1 ms would mostly meet caches
filled by the tool before it); the best run counts. force_error_N is the largest difference
from an independent integration in extended precision at any tick. Peers and that reference are
built in a checkout only (tests/bench): odeint is dopri5 at 1e-4 with located events, mujoco RK4
with one step a tick (four in full, where one is unstable) and no events, scipy RK45 at 1e-4 with
terminal events, cases A and B only.

With linear_analysis also frequency responses, critical gains and the table of `forceaxis advise`.
"""

import ctypes
import importlib.util
import os
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from forceaxis import _core, paths
from forceaxis.bench import scipy_peer
from forceaxis.thesis import tables

# Force in N, ADC codes, CPU seconds, number of events (None: unknown) of one run.
TimedRun = tuple[NDArray[np.float64], NDArray[np.integer[Any]], float, int | None]
Runner = Callable[[], TimedRun | None]
Row = dict[str, Any]  # of the output in JSON

TOOLS = ("forceaxis", "forceaxis+firmware", "odeint", "mujoco", "scipy")
TICKS = 3000
SPAN_S = TICKS / _core.TICKS_PER_SECOND
SETPOINT_B = 100
TURN_S = 0.01


@dataclass(frozen=True)
class Case:
    """A plant and its law: gain in DAC codes per ADC count, set-point in N."""

    experiment: str
    signals: tuple[str, str, str]  # contact force, robot's body, workpiece's body
    gain: int
    setpoint_N: int


AXIS = ("tip.force", "robot", "workpiece")
CASES = {
    "A": Case("axis_contact_a.toml", AXIS, 4, 59),
    "B": Case("axis_contact_b.toml", AXIS, 15, SETPOINT_B),
    "full": Case("full_axis.toml", ("pad.force", "rotor", "workpiece"), 4, 59),
}
# {name: (gains in DAC codes per ADC count, set-points in N)}: 64 x 64 runs, including both ends.
SWEEPS = {"calm": ((2.0, 6.0), (20.0, 120.0)), "wide": ((1.0, 16.0), (10.0, 130.0))}
SIDE = 64


class Peers:
    """The shared library of tests/bench, which exists only if it was built in a checkout."""

    def __init__(self) -> None:
        path = paths.SIM.parent / "build" / "release" / "tests" / "bench" / "bench_peers.so"
        self.missing: dict[str, str] = {}
        self._call: Any = None
        try:
            self._call = ctypes.CDLL(str(path)).bench_peer
            self._call.restype = ctypes.c_long
        except OSError:
            where = f"{paths.display(path)} not found; in a checkout tools/setup --tests builds it"
            self.missing = dict.fromkeys(("odeint", "mujoco", "reference"), where)
        if self._call and self.run("mujoco", CASES["A"], False, 0) is None:
            self.missing["mujoco"] = "not built in: its wheel was not in .venv at the last build"
        if importlib.util.find_spec("scipy") is None:
            self.missing["scipy"] = "not installed"

    def run(self, tool: str, case: Case, full: bool, ticks: int = TICKS) -> TimedRun | None:
        """(force, counts, CPU seconds, events or None) of one run; None if the tool fails."""
        values = np.zeros((4, TICKS + 1))
        counts = np.zeros(TICKS + 1, np.int32)
        seconds = ctypes.c_double()
        doubles, ints = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int)
        events = self._call(
            tool.encode(), int(full), case.gain, case.setpoint_N, ticks,
            *(row.ctypes.data_as(doubles) for row in values), counts.ctypes.data_as(ints),
            ctypes.byref(seconds),
        )  # fmt: skip
        if events == -2:
            return None
        return values[0], counts, seconds.value, None if events < 0 else events


def runners(name: str, tools: Iterable[str], peers: Peers) -> dict[str, Runner]:
    """{tool: function of one run} of a case. The preparation is done before, so that only the run
    is timed."""
    case, full = CASES[name], name == "full"
    own = _core.BenchCase(paths.EXPERIMENTS / case.experiment, *case.signals)

    def ours(firmware: bool) -> TimedRun:
        done = own.run(case.gain, case.setpoint_N, firmware)
        return done["force"], done["count"], done["seconds"], done["events"]

    every: dict[str, Runner] = {
        "forceaxis": lambda: ours(False),
        "forceaxis+firmware": lambda: ours(True),
        "odeint": lambda: peers.run("odeint", case, full),
        "mujoco": lambda: peers.run("mujoco", case, full),
        "scipy": lambda: scipy_peer.run(case.gain, case.setpoint_N, TICKS),
    }
    if full:
        del every["scipy"]  # its equations exist only for the cases A and B
    return {t: every[t] for t in tools if t in every and t not in peers.missing}


def turn(tool: str, once: Runner, last: dict[str, Any]) -> list[float]:
    """CPU seconds of successive runs during TURN_S."""
    times: list[float] = []
    while sum(times) < TURN_S:
        last[tool] = once()
        if last[tool] is None:
            raise RuntimeError(f"{tool} failed; its reason stands above")
        times.append(last[tool][2])
    return times


def cases(
    names: Iterable[str], tools: Sequence[str], repeat: int, progress: Callable[[], None]
) -> tuple[list[Row], dict[str, str]]:
    """Rows of results, one for each case and tool, and {tool: reason why it is missing}."""
    peers = Peers()
    rows = []
    for name in names:
        run = runners(name, tools, peers)
        reference = None
        if "reference" not in peers.missing:
            reference = peers.run("reference", CASES[name], name == "full")
        seconds: dict[str, list[float]] = {tool: [] for tool in run}
        last: dict[str, Any] = {}
        for _ in range(repeat):
            # tools take turns, so that all run under the same conditions
            for tool, once in run.items():
                seconds[tool] += turn(tool, once, last)
            progress()
        for tool, times in seconds.items():
            force, counts, _, events = last[tool]
            row = {"case": name, "tool": tool, "real_time_factor": SPAN_S / min(times)}
            row["force_error_N"] = float(abs(force - reference[0]).max()) if reference else None
            row["codes_differ"] = int((counts != reference[1]).sum()) if reference else None
            row["events"] = events
            row["tick_ns"] = 1e9 * min(times) / TICKS
            row["spread"] = float(np.median(times)) / min(times) - 1  # median over best
            row["runs"] = len(times)
            rows.append(row)
    asked = {t: why for t, why in peers.missing.items() if t in tools or t == "reference"}
    return rows, asked


def sweeps(repeat: int, progress: Callable[[], None]) -> list[Row]:
    """Number of runs per second on one and on two threads: sweeps of 4096 runs, and the 55 cells of
    the thesis."""
    own = _core.BenchCase(paths.EXPERIMENTS / CASES["A"].experiment, *AXIS)
    cells = tables.load()
    jobs = [cells.job(c) for c in cells.cells]

    def cells_once(threads: int) -> tuple[float, float]:
        wall, cpu = time.perf_counter(), time.process_time()
        _core.run_many(jobs, threads)
        return time.perf_counter() - wall, time.process_time() - cpu

    def sweep_once(name: str, threads: int) -> tuple[float, float]:
        done = own.sweep(*SWEEPS[name], SIDE, threads)
        return done["wall_s"], done["cpu_s"]

    work: dict[str, tuple[int, Any]] = {
        n: (SIDE * SIDE, lambda threads, n=n: sweep_once(n, threads)) for n in SWEEPS
    }
    work["cells"] = (len(jobs), cells_once)
    rows = []
    for name, (runs, once) in work.items():
        times: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
        for _ in range(repeat):
            for threads, taken in times.items():
                taken.append(once(threads))
            progress()
        one, two = (min(wall for wall, _ in times[n]) for n in (1, 2))
        rows.append(
            {
                "sweep": name,
                "runs": runs,
                "runs_per_s_core": runs / min(cpu for _, cpu in times[1]),
                "runs_per_s": runs / one,
                "runs_per_s_two_threads": runs / two,
                "two_thread_ratio": one / two,
                "two_thread_cpu": min(c for _, c in times[2]) / min(c for _, c in times[1]),
            }
        )
    return rows


def scaling(repeat: int, gains: Sequence[int] = range(2, 26)) -> dict[str, Any]:
    """CPU time of case B at several gains as a function of its events: seconds = a + b events."""
    own = _core.BenchCase(paths.EXPERIMENTS / CASES["B"].experiment, *AXIS)
    best: dict[int, float]
    events: dict[int, int]
    best, events = {}, {}
    for _ in range(max(repeat, 3)):
        for gain in gains:
            for _ in range(5):
                done = own.run(gain, SETPOINT_B)
                best[gain] = min(best.get(gain, np.inf), done["seconds"])
            events[gain] = done["events"]
    x = np.array([events[g] for g in gains], float)
    y = np.array([best[g] for g in gains])
    b, a = np.polyfit(x, y, 1)
    off = y - (a + b * x)
    return {
        "events_least": int(x.min()),
        "events_most": int(x.max()),
        "run_us": 1e6 * a,
        "event_us": 1e6 * b,
        "r_squared": float(1 - (off**2).sum() / ((y - y.mean()) ** 2).sum()),
        "worst_deviation": float(abs(off / (a + b * x)).max()),
        "points": [[int(e), 1e6 * t] for e, t in zip(x, y, strict=True)],
    }


RESPONSE_MODEL, RESPONSE_POINTS, RESPONSE_MOST_S = "full_axis", 10_000, 0.020
ADVICE_MODELS, ADVICE_MOST_S = ("laboratory", "full_axis"), 1.0


def best(repeat: int, once: Callable[..., object]) -> float:
    """Wall time in s of the fastest of `repeat` calls."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        once()
        times.append(time.perf_counter() - start)
    return min(times)


def halved_limit(sampled: Any) -> float:
    """The critical gain of a sampled control.StateSpace with an error of 1e-9: steps of 5 % from
    1e-4 on, then halving."""
    import control

    def stable(gain: float) -> np.bool:
        return np.all(np.abs(control.feedback(gain * sampled, 1).poles()) < 1)

    low = 1e-4
    while stable(1.05 * low):
        low *= 1.05
    high = 1.05 * low
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def linear_analysis(repeat: int, progress: Callable[[], None]) -> list[Row]:
    """Times of a frequency response, a critical gain and the advice table, with forceaxis and with
    python-control.

    Both take the same matrices. A response is of 10,000 frequencies, from the matrices on (our
    Hessenberg form is not kept from call to call). A critical gain of ours is that with all
    crossings; the other is a halving on control.feedback's poles (stability_margins falls back to a
    grid for these loops and misses it).
    """
    from forceaxis import linear
    from forceaxis.design import advise
    from forceaxis.linear import loops

    frequency = np.geomspace(0.1, 1000.0, RESPONSE_POINTS)
    system = linear.linearise(RESPONSE_MODEL)
    theirs = system.state_space()

    def ours() -> Any:
        return replace(system).response(frequency)

    def peer() -> Any:
        return theirs(2j * np.pi * frequency)

    rows = [
        {
            "work": f"{RESPONSE_POINTS} frequencies of {RESPONSE_MODEL}",
            "states": len(system.A),
            "seconds": best(repeat, ours),
            "control_seconds": best(min(repeat, 3), peer),
            "difference": float(np.max(np.abs(ours() / peer() - 1))),
        }
    ]
    progress()
    for model in ADVICE_MODELS:
        loop = loops.force_loop(model)
        sampled = loop.open.state_space()
        limit: Any
        margin, limit = halved_limit(sampled), loop.limit().gain
        rows.append(
            {
                "work": f"critical gain of {model}",
                "states": len(loop.open.A),
                "seconds": best(repeat, lambda loop=loop: replace(loop).limit()),
                "control_seconds": best(
                    min(repeat, 3), lambda sampled=sampled: halved_limit(sampled)
                ),
                "difference": abs(float(margin) / limit - 1),
            }
        )
        order = advise.AdviceOrder(model, runs="none")
        table = advise.advise(order).rows
        taken = best(min(repeat, 3), lambda order=order: advise.advise(order))
        rows.append(
            {
                "work": f"advice table of {model}, {len(table)} rows",
                "states": len(loop.open.A),
                "seconds": taken,
                "control_seconds": None,
                "difference": None,
            }
        )
        progress()
    return rows


def run(
    names: Collection[str],
    tools: Sequence[str],
    repeat: int,
    with_sweeps: bool,
    with_linear: bool = False,
) -> dict[str, Any]:
    """The complete benchmark; returns the content of `--json`."""
    console = Console(stderr=True)
    sweep_repeat = min(repeat, 5)
    steps = len(names) * repeat + (with_sweeps and (len(SWEEPS) + 1) * sweep_repeat)
    steps += with_linear and 1 + len(ADVICE_MODELS)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task("bench", total=steps)
        rows, missing = cases(names, tools, repeat, lambda: bar.advance(task))
        result: dict[str, Any] = {"results": rows, "missing": missing, "load": os.getloadavg()[0]}
        if with_sweeps:
            result["sweeps"] = sweeps(sweep_repeat, lambda: bar.advance(task))
            result["scaling"] = scaling(repeat)
        if with_linear:
            result["linear"] = linear_analysis(repeat, lambda: bar.advance(task))
    return result


def describe(result: dict[str, Any]) -> str:
    """The result for a terminal."""
    lines = ["case  tool                x real time   us/tick   spread   force error   events"]
    for r in result["results"]:
        error = "unknown" if r["force_error_N"] is None else f"{r['force_error_N']:.1e} N"
        events = "" if r["events"] is None else r["events"]
        lines.append(
            f"{r['case']:4}  {r['tool']:18} {r['real_time_factor']:12,.0f} "
            f"{r['tick_ns'] / 1e3:9.3f} {r['spread']:8.0%}   {error:>11} {events:>8}"
        )
    for r in result.get("sweeps", []):
        lines.append(
            f"{r['sweep']:12} {r['runs']} runs: {r['runs_per_s_core']:,.0f} runs/s per core, "
            f"{r['runs_per_s_two_threads']:,.0f} runs/s on two threads "
            f"({r['two_thread_ratio']:.2f} x one; CPU time {r['two_thread_cpu']:.2f} x)"
        )
    if s := result.get("scaling"):
        lines.append(
            f"{'scaling':12} {s['events_least']} to {s['events_most']} events: "
            f"{s['run_us']:.0f} us + {s['event_us']:.2f} us per event, R^2 {s['r_squared']:.4f}, "
            f"worst {s['worst_deviation']:.0%} off the line"
        )
    for r in result.get("linear", []):
        text = f"{r['work']}: {1e3 * r['seconds']:.3g} ms"
        if r["control_seconds"]:
            text += (
                f", python-control {1e3 * r['control_seconds']:.3g} ms, "
                f"{r['control_seconds'] / r['seconds']:.1f} times as long; they differ by "
                f"{r['difference']:.1e}"
            )
        lines.append(f"{'linear':12} {text}")
    lines += [f"{'missing':12} {tool}: {why}" for tool, why in result["missing"].items()]
    if result["load"] > 0.5:
        lines.append(f"{'load':12} {result['load']:.1f}: the machine was not idle")
    return "\n".join(lines)


def check(result: dict[str, Any]) -> list[tuple[str, bool]]:
    """The required figures: [(text, whether it is reached)]; a missing figure is not reached."""
    row = {(r["case"], r["tool"]): r for r in result["results"]}
    checks: list[tuple[str, bool]] = []

    def want(text: str, figure: float | None, least: Any = None, most: float | None = None) -> None:
        held = figure is not None and (figure >= least if most is None else figure <= most)
        text += f" >= {least}" if most is None else f" <= {most}"
        checks.append((f"{text}: {'missing' if figure is None else f'{figure:.3g}'}", held))

    def figure(case: str, tool: str, key: str = "real_time_factor") -> Any:
        return row.get((case, tool), {}).get(key)

    def ratio(a: float | None, b: float | None) -> float | None:
        return a / b if a and b else None

    for case, least in (("A", 2), ("B", 1.4)):
        plant = figure(case, "forceaxis")
        firmware = figure(case, "forceaxis+firmware")
        want(f"{case}: plant / odeint", ratio(plant, figure(case, "odeint")), least)
        want(f"{case}: firmware / plant", ratio(firmware, plant), 0.5)
    want("A: plant / mujoco", ratio(figure("A", "forceaxis"), figure("A", "mujoco")), 40)
    for case, most in (("A", 1e-9), ("B", 1e-8)):
        for tool in TOOLS[:2]:
            error = figure(case, tool, "force_error_N")
            want(f"{case}: force error of {tool}, N", error, most=most)
    per_tick = [figure(c, "forceaxis", "tick_ns") for c in ("full", "A")]
    want("tick of full / tick of A", ratio(*per_tick), most=4)
    for r in result.get("sweeps", []):
        want(f"{r['sweep']}: two threads / one", r["two_thread_ratio"], 1.8)
    for r in result.get("linear", []):
        if "frequencies" in r["work"]:
            want(f"{r['work']}, s", r["seconds"], most=RESPONSE_MOST_S)
            want(f"{r['work']}, difference from python-control", r["difference"], most=1e-6)
        elif "advice" in r["work"]:
            want(f"{r['work']}, s", r["seconds"], most=ADVICE_MOST_S)
    if "scaling" in result:
        want("cost is linear in events, R^2", result["scaling"]["r_squared"], 0.98)
    return checks
