"""The benchmark of connections between plant and firmware. It measures the rate of the lock-step in
ticks per second, and the message rate of the transport without plant and firmware.

For the message rate of the transport alone, two short C programs (tests/bench/link_pingpong_*.c)
exchange messages over the same transport. In the same run of the benchmark, plant_node and
axis_node simulate sim/experiments/contact.toml in lock-step. Both measurements alternate. All
processes run on one CPU. For six axes, one process contains six plants, and the other process
contains the firmware of six axes. The result is the median of the turns.
"""

import contextlib
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from forceaxis import _core, paths
from forceaxis.bench.requirement import Requirement, at_least
from forceaxis.experiments import link
from forceaxis.experiments.node_reports import PlantReport, read_axis_report, read_plant_report
from forceaxis.results import from_json, to_json

CAN = link.LinkOptions.can
EXPERIMENT = paths.EXPERIMENTS / "contact.toml"
ROUND_TRIPS = 20_000
AXES = 6
TIME_LIMIT_S = 120
SHARE_OF_RAW_MIN, REAL_TIME_MIN = 0.6, 1.0


@dataclass(frozen=True)
class LinkRates:
    """Tick rates of plant and firmware in lock-step over one transport, and the message rate of
    this transport alone."""

    link: str  # transport: "lcm" or "socketcan"
    raw_per_s: float  # message exchanges per second between two programs without firmware and plant
    ticks_per_s: float  # ticks per second of the lock-step with one axis
    # ticks_per_s divided by raw_per_s: rate of the lock-step relative to the transport alone
    share: float
    real_time: float  # simulated time divided by elapsed time, for the lock-step with one axis
    six_axes_ticks_per_s: float
    six_axes_real_time: float
    repeated: int  # number of messages that had to be sent again, in all measurements together
    turns: int


def _pin_to_one_cpu() -> None:
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


@contextlib.contextmanager
def _running(*command: str | Path) -> Iterator[subprocess.Popen[str]]:
    """Context manager that starts a program on one CPU and waits for the first line of its output.
    At the end of the context, the program is ended."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, preexec_fn=_pin_to_one_cpu
    )
    try:
        assert process.stdout is not None
        process.stdout.readline()
        yield process
    finally:
        process.kill()
        process.communicate()


def _output(*command: str | Path) -> str | None:
    """Runs a program on one CPU and returns its output. Returns None if the program fails."""
    done = subprocess.run(
        command,
        stdout=subprocess.PIPE,
        text=True,
        timeout=TIME_LIMIT_S,
        preexec_fn=_pin_to_one_cpu,
        check=False,
    )
    return None if done.returncode else done.stdout


def raw_rate(kind: str, where: str) -> float:
    """Returns the message exchanges per second between two programs without firmware and plant.
    Raises link.LinkError."""
    name = "link_pingpong_" + ("lcm" if kind == "lcm" else "can")
    program = paths.ROOT / "build" / "release" / "tests" / "bench" / name
    if not program.is_file():
        raise link.LinkError(
            f"{paths.display(program)}: expected this program, got no such file; `tools/setup "
            "--tests` builds the program"
        )
    with _running(program, "pong", where):
        text = _output(program, "ping", where, str(ROUND_TRIPS))
    if text is None:
        raise link.LinkError(f"{name}: the exchange of messages failed")
    return float(text)


def lock_step(kind: str, axes: int) -> PlantReport:
    """Runs plant and firmware in lock-step, and returns the report of plant_node. Raises
    link.LinkError."""
    run_id = str(link.new_run_id())
    common = [str(EXPERIMENT), "--axes", str(axes), "--link", kind, "--run-id", run_id]
    with _running(link.program("axis_node"), *common) as axis:
        plant_text = _output(link.program("plant_node"), *common)
        axis_text, _ = axis.communicate(timeout=TIME_LIMIT_S)
    if plant_text is None or axis.returncode:
        raise link.LinkError(
            f"lock-step over {kind}: expected exit status 0 of plant_node and axis_node, but one "
            "of these programs failed"
        )
    report = read_plant_report(plant_text)
    if report.trace_hashes != read_axis_report(axis_text).trace_hashes:
        raise link.LinkError(
            f"lock-step over {kind}: expected equal trace hashes of plant and firmware, got "
            "different hashes"
        )
    return report


def measure(kind: str, turns: int) -> LinkRates:
    """Measures the message rate of a transport alone and the tick rates of the lock-step. Each rate
    is the median of `turns` measurements."""
    raw, one, six = [], [], []
    for _ in range(turns):
        where = _core.lcm_url_of(link.new_run_id()) if kind == "lcm" else CAN
        raw.append(raw_rate(kind, where))
        one.append(lock_step(kind, 1))
        six.append(lock_step(kind, AXES))
    raw_per_s = statistics.median(raw)
    one_per_s = statistics.median(report.ticks_per_s for report in one)
    six_per_s = statistics.median(report.ticks_per_s for report in six)
    return LinkRates(
        link=kind,
        raw_per_s=raw_per_s,
        ticks_per_s=one_per_s,
        share=one_per_s / raw_per_s,
        real_time=one_per_s / _core.TICKS_PER_SECOND,
        six_axes_ticks_per_s=six_per_s,
        six_axes_real_time=six_per_s / _core.TICKS_PER_SECOND,
        repeated=sum(report.repeated for report in one + six),
        turns=turns,
    )


def run(turns: int = 5) -> list[LinkRates]:
    """Returns the measured rates of LCM and of CAN. CAN is measured on a virtual CAN bus
    (tools/vcan). Raises link.LinkError."""
    lcm = measure("lcm", turns)
    command = [link.program("vcan"), sys.executable, "-m", "forceaxis.bench.link", str(turns)]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode:
        raise link.LinkError("bench over socketcan failed for the reason printed above")
    return [lcm, from_json(LinkRates, json.loads(done.stdout))]


def check(rates: Sequence[LinkRates]) -> list[Requirement]:
    """Returns the requirements on the message rate and on the tick rate of each transport."""
    return [
        requirement
        for r in rates
        for requirement in (
            at_least(f"{r.link}: lock-step / ping-pong", r.share, SHARE_OF_RAW_MIN),
            at_least(f"{r.link}: six axes / real time", r.six_axes_real_time, REAL_TIME_MIN),
        )
    ]


if __name__ == "__main__":
    try:
        print(json.dumps(to_json(measure("socketcan", int(sys.argv[1])))))
    except link.LinkError as error:
        sys.exit(f"forceaxis: {error}")
