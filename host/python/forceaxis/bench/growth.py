"""Measures how CPU time and peak memory of forceaxis and odeint grow with the number of states, of
switching events, or of runs.

States: the plant is a chain of bodies between springs. The motor of the benchmark drives it, and it
is pressed on a wall for 2 s. Events: the plant is an oscillator that hits a stop in each period and
has dry friction. It is simulated for 2 s, and its frequency determines the number of switching
events. forceaxis counts six events in each period, and odeint counts four. The reason is a friction
that stops and slides again at the same instant: forceaxis counts two events, odeint one. With its
tolerance of 1e-4, odeint loses the phase of the oscillator within 2 s at 100 Hz and above, and
misses a few of 10,000 events. With a tolerance of 1e-12, its forces are equal to those of
forceaxis. Runs: a sweep of case A over gain and set-point, with 0.15 s in each run. All points are
measured, none is extrapolated.

Each point is measured in its own process. The CPU time of a run is the smallest value of several
runs. The CPU time of a sweep with forceaxis includes reading the files, the firmware, the verdicts
and the table of results. With odeint, a sweep consists only of the plant and an integer formula as
control law, and no results are stored. The memory is the increase of the peak of resident memory
(VmHWM of Linux) since the start of the work. For odeint, 5 MiB of it are the shared library, which
also contains MuJoCo. getrusage() is not used, because the ru_maxrss of a new process begins with
the value of its parent process.
"""

import itertools
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from forceaxis import _core, paths, progress
from forceaxis.bench import bench
from forceaxis.bench.scipy_peer import TimedRun
from forceaxis.results import from_json, to_json

TOOLS = ("forceaxis", "odeint")
RUN_TICKS = 225  # number of ticks in each run of the sweep; the first contact is at tick 190
# force loop of the chain: gain in DAC codes per ADC code, force set-point in N
GAIN, SETPOINT_N = 4, 59
# gain and set-point that keep the motion of the robot small, so that the motor reaches no limit
RATTLE_GAIN, RATTLE_SETPOINT_N = 1, 0
# First lines of the tables of the drive, and of the tables that follow them, in a model file.
DRIVE_KEYS = ("[drive]", "[[adc]]\nchannel = 1")


@dataclass(frozen=True)
class GrowthPlan:
    """The sizes of the tasks for which CPU time and memory are measured."""

    # Numbers of bodies of the chain. A chain of n bodies has 2 n + 2 states.
    bodies: Sequence[int] = (2, 5, 11, 20, 29)
    # frequencies of the oscillator in Hz; 0 means that it is at rest
    frequencies_Hz: Sequence[float] = (0, 1, 10, 100, 780)
    # numbers of runs of the sweep, which are powers of 10
    runs: Sequence[int] = (1, 10, 100, 1000, 10_000, 100_000)


@dataclass(frozen=True)
class GrowthPoint:
    """CPU time and memory of one tool for one size of a task."""

    growth: str  # quantity that defines the size of the task: "states", "events" or "runs"
    tool: str
    # number of states, number of switching events that forceaxis counts, or number of runs
    size: int
    # number of switching events in a run, as the measured tool counts them; None for a sweep
    events: int | None
    cpu_s: float  # CPU time of the run or of the whole sweep in s
    unit_us: float  # CPU time of one tick in us; for a sweep, CPU time of one run in us
    start_MiB: float  # peak of the resident memory in MiB, before the task is done
    added_MiB: float  # increase of the memory peak in MiB while the task is done


@dataclass(frozen=True)
class Growth:
    """CPU time and peak memory as functions of the number of states, events and runs."""

    points: list[GrowthPoint]
    missing: dict[str, str]  # {name of a tool: reason why this tool was not measured}
    load: float  # load average of the computer over the last minute

    def of(self, growth: str, tool: str) -> list[GrowthPoint]:
        """Returns the measured points of one tool in their order. `growth`: "states", "events" or
        "runs"."""
        return [p for p in self.points if (p.growth, p.tool) == (growth, tool)]


@dataclass(frozen=True)
class Job:
    """The task of one process: it measures one tool with one size of a task."""

    growth: str
    tool: str
    amount: float  # size of the task: number of bodies, frequency in Hz, or number of runs
    repeat: int


def drive() -> str:
    """Returns the tables for motor and encoder from the model file of benchmark case A. Names of
    parameters are replaced by their values."""
    text = (paths.SIM / "models" / "axis_contact.toml").read_text()
    values = dict(re.findall(r"^(\w+) = \{ value = ([^,]+),", text, re.MULTILINE))
    first, end = (text.index(key) for key in DRIVE_KEYS)
    table = text[first : text.index("[[adc]]")] + text[end:]
    return re.sub(r'= "(\w+)"', lambda m: f"= {values.get(m[1], repr(m[1]))}", table)


def chain_model(bodies: int) -> str:
    """Returns the text of a model file with a chain of bodies, but without the drive."""
    names = ["robot", *(f"body{i}" for i in range(2, bodies)), "workpiece"]
    tables = [f'[[body]]\nname = "{name}"\nmass = {132.4 / bodies!r}' for name in names]
    tables += [
        f'[[spring]]\nname = "spring{i}"\nbetween = ["{a}", "{b}"]\n'
        f"stiffness = {1e6 * bodies}\ndamping = {500.0 * bodies}"
        for i, (a, b) in enumerate(itertools.pairwise(names))
    ]
    tables.append(
        '[[contact]]\nname = "tip"\nbetween = ["workpiece", "ground"]\n'
        "stiffness = 110100\ndamping = 16.5\ngap = -0.0005"
    )
    return "\n".join([*tables, adc(2.0)])


def rattle_model(frequency_Hz: float) -> str:
    """Returns the text of a model file with the oscillator, its stop and its friction, but without
    the drive. If the frequency is 0, the oscillator is at rest."""
    stiffness = float((2 * np.pi * (frequency_Hz or 1)) ** 2)
    return (
        '[[body]]\nname = "robot"\nmass = 132.4\n'
        f'[[body]]\nname = "workpiece"\nmass = 1\nposition = {-0.001 if frequency_Hz else 0}\n'
        '[[spring]]\nname = "spring"\nbetween = ["workpiece", "ground"]\n'
        f"stiffness = {stiffness!r}\n"
        '[[contact]]\nname = "tip"\nbetween = ["workpiece", "ground"]\n'
        f"stiffness = {stiffness!r}\ngap = 0.0005\n"
        '[[friction]]\nname = "rub"\nbetween = ["workpiece", "ground"]\n'
        f"coulomb = {1e-8 * stiffness!r}\n" + adc(1e-5 * stiffness)
    )


def adc(per_count_N: float) -> str:
    """Returns two tables of a model file as text: the damper in the guide of the robot, and the ADC
    channel of the contact force."""
    return (
        '[[damper]]\nname = "guide"\nbetween = ["robot", "ground"]\ndamping = 500\n'
        f'[[adc]]\nchannel = 0\nsignal = "tip.force"\nper_count = {per_count_N!r}\n'
        "zero_code = 128\n"
    )


def experiment(model: Path, duration_s: float) -> str:
    """Returns the text of an experiment file with the force law of benchmark case A."""
    return (
        f'title = "Growth"\nshows = "Growth"\nmodel = "{model}"\nduration_s = {duration_s}\n'
        '[firmware]\nmode = "force"\nforce_zero_code = 128\nforce_gain = 4.0\n'
        "force_setpoint = 29.5\nlatency_ticks = 0\nbump_decay_shift = 0\n"
    )


def own_plant(text: str, folder: Path) -> _core.BenchCase:
    """Returns the simulated plant of a model. `text`: the model without the drive, which this
    function adds. The files of the plant are written to `folder`."""
    model = folder / "model.toml"
    model.write_text(f'title = "Growth"\nshows = "Growth"\n{text}{drive()}')
    file = folder / "experiment.toml"
    file.write_text(experiment(model, bench.SPAN_S))
    return _core.BenchCase(file, *bench.AXIS_SIGNALS)


def one_run(job: Job, folder: Path) -> TimedRun:
    """Simulates the plant of a job for 2 s, as many times as the job states. Returns the fastest
    run."""
    chain = job.growth == "states"
    gain, setpoint_N = (GAIN, SETPOINT_N) if chain else (RATTLE_GAIN, RATTLE_SETPOINT_N)
    if job.tool == "forceaxis":
        text = chain_model(int(job.amount)) if chain else rattle_model(job.amount)
        plant = own_plant(text, folder)
        runs = [bench.own_run(plant, gain, setpoint_N) for _ in range(job.repeat)]
    else:
        peers = bench.Peers()
        name = "chain" if chain else "rattle"
        runs = [peers.grow(name, job.amount, gain, setpoint_N) for _ in range(job.repeat)]
    return min(runs, key=lambda run: run.seconds)


def sweep_s(job: Job, folder: Path) -> float:
    """Runs the sweep of a job once. Returns the CPU time of the sweep in s."""
    digits = len(str(int(job.amount))) - 1
    gains = np.linspace(2, 6, 10 ** (digits - digits // 2)).tolist()
    setpoints = np.linspace(40, 120, 10 ** (digits // 2)).tolist()
    if job.tool == "odeint":
        peers = bench.Peers()
        a = bench.CASES["A"]
        seconds = 0.0
        for gain in gains:
            for setpoint_N in setpoints:
                case = bench.Case(a.experiment, a.signals, round(gain), round(setpoint_N))
                run = peers.run("odeint", case, False, RUN_TICKS)
                assert run is not None
                seconds += run.seconds
        return seconds
    from forceaxis.experiments import sweep

    file = folder / "experiment.toml"
    duration_s = RUN_TICKS / _core.TICKS_PER_SECOND
    file.write_text(experiment(paths.SIM / "models" / "axis_contact.toml", duration_s))
    # force set-points in counts; one count is 2 N
    counts = [setpoint_N / 2 for setpoint_N in setpoints]
    grid = {"firmware.force_gain": gains, "firmware.force_setpoint": counts}
    start = time.process_time()
    done = sweep.sweep(sweep.SweepRequest(file, grid), threads=1)
    seconds = time.process_time() - start
    assert done.result.counts.points == job.amount and not done.result.failures
    return seconds


def peak_MiB() -> float:
    """Returns the peak of the resident memory of this process."""
    status = Path("/proc/self/status").read_text()
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    assert found
    return int(found[1]) / 1024


def point(job: Job) -> GrowthPoint:
    """Does a job in this process. It must be the first job of the process, because the peak of the
    memory would include earlier jobs."""
    start_MiB = peak_MiB()
    events: int | None = None
    with tempfile.TemporaryDirectory(prefix="forceaxis_growth_") as folder:
        if job.growth == "runs":
            size, cpu_s = int(job.amount), sweep_s(job, Path(folder))
            units = size
        else:
            run = one_run(job, Path(folder))
            assert run.events is not None
            cpu_s, events, units = run.seconds, run.events, bench.TICKS
            size = 2 * int(job.amount) + 2 if job.growth == "states" else events
    return GrowthPoint(
        growth=job.growth,
        tool=job.tool,
        size=size,
        events=events,
        cpu_s=cpu_s,
        unit_us=1e6 * cpu_s / units,
        start_MiB=start_MiB,
        added_MiB=peak_MiB() - start_MiB,
    )


def in_process(job: Job) -> GrowthPoint:
    """Does a job in a new process."""
    words = [sys.executable, "-m", "forceaxis.bench.growth", json.dumps(asdict(job))]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{job} failed: {done.stderr.strip()}")
    return from_json(GrowthPoint, json.loads(done.stdout))


def run(plan: GrowthPlan, repeat: int) -> Growth:
    """Measures all tools with all sizes of a plan, each in its own process. The tools are measured
    in turns."""
    missing = {t: why for t, why in bench.Peers().missing.items() if t in TOOLS}
    amounts = {"states": plan.bodies, "events": plan.frequencies_Hz, "runs": plan.runs}
    jobs = [
        Job(growth, tool, amount, repeat)
        for growth, all_amounts in amounts.items()
        for amount in all_amounts
        for tool in TOOLS
        if tool not in missing
    ]
    points: list[GrowthPoint] = []
    with progress.bar("bench", len(jobs)) as show:
        for i, job in enumerate(jobs):
            found = in_process(job)
            if job.growth == "events" and job.tool == "odeint":
                found = replace(found, size=points[-1].size)
            points.append(found)
            show(i + 1, len(jobs))
    return Growth(points, missing, os.getloadavg()[0])


def write(growth: Growth, out: Path) -> None:
    """Writes growth.json and growth.png to a folder."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "growth.json").write_text(json.dumps(to_json(growth)) + "\n")
    draw(growth, out / "growth.png")


def draw(growth: Growth, file: Path) -> None:
    """Draws plots of the CPU time and of the memory over the size of the task, and writes them to a
    file."""
    import matplotlib.pyplot as plt

    from forceaxis import drawing

    figure, axes = plt.subplots(2, 3, figsize=(9, 5), layout="constrained")
    names = {"states": "States", "events": "Switching events in 2 s", "runs": "Runs of a sweep"}
    for (name, label), (cost, memory) in zip(names.items(), axes.T, strict=True):
        for ax in (cost, memory):
            drawing.style(ax)
        for tool in TOOLS:
            points = growth.of(name, tool)
            sizes = [p.size for p in points]
            cost.plot(sizes, [p.unit_us for p in points], "o-", label=tool, markersize=3)
            memory.plot(sizes, [p.added_MiB for p in points], "o-", label=tool, markersize=3)
        for ax in (cost, memory):
            ax.set_xlabel(label)
            if name != "states":
                ax.set_xscale("symlog", linthresh=1)
            if name == "runs" or (name == "events" and ax is cost):
                ax.set_yscale("log")
        cost.set_ylabel("CPU time of a run, us" if name == "runs" else "CPU time of a tick, us")
        memory.set_ylabel("Added peak memory, MiB")
    drawing.legend(axes[0, 0])
    figure.savefig(file, dpi=drawing.DPI)
    plt.close(figure)


if __name__ == "__main__":
    print(json.dumps(asdict(point(Job(**json.loads(sys.argv[1]))))))
