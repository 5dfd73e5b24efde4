"""`forceaxis bench --link`: rate of the lock-step and raw rate of its transport.

The raw rate is that of a message exchange between two plain C programs
(tests/bench/link_pingpong_*.c) on the same transport. It is measured in the same run, in turns with
the lock-step of plant_node and axis_node on sim/experiments/contact.toml. All processes run on one
CPU. For six axes, one process contains six plants and one contains six firmwares. The result is the
median of the turns.
"""

import json
import os
import secrets
import statistics
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from forceaxis import _core, paths
from forceaxis.experiments import link

KINDS = ("lcm", "socketcan")
CAN = link.LinkOptions.can
EXPERIMENT = paths.EXPERIMENTS / "contact.toml"
ROUND_TRIPS = 20_000
AXES = 6
TIME_LIMIT_S = 120
LEAST_SHARE, LEAST_REAL_TIME = 0.6, 1.0


def _pinned() -> None:
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def _start(*command: object) -> Any:
    return subprocess.Popen(
        [str(c) for c in command], stdout=subprocess.PIPE, text=True, preexec_fn=_pinned
    )


def raw_rate(kind: str, where: str) -> float:
    """Message exchanges per second between the two plain programs."""
    name = "link_pingpong_" + ("lcm" if kind == "lcm" else "can")
    program = paths.SIM.parent / "build" / "release" / "tests" / "bench" / name
    if not program.is_file():
        raise link.LinkError(f"{paths.display(program)}: not found; tools/setup --tests builds it")
    pong = _start(program, "pong", where)
    try:
        pong.stdout.readline()
        ping = _start(program, "ping", where, ROUND_TRIPS)
        text = ping.communicate(timeout=TIME_LIMIT_S)[0]
        if ping.returncode:
            raise link.LinkError(f"{name}: the ping-pong failed")
        return float(text)
    finally:
        pong.kill()
        pong.communicate()


def lock_step(kind: str, axes: int) -> dict[str, Any]:
    """The reports of plant_node and axis_node about one run."""
    run_id = secrets.randbelow(2**53)
    common = [EXPERIMENT, "--axes", axes, "--link", kind, "--run-id", run_id]
    axis = _start(link.program("axis_node"), *common)
    try:
        axis.stdout.readline()
        plant = _start(link.program("plant_node"), *common)
        text = plant.communicate(timeout=TIME_LIMIT_S)[0]
        answer = axis.communicate(timeout=TIME_LIMIT_S)[0]
    finally:
        axis.kill()
        axis.communicate()
    if plant.returncode or axis.returncode:
        raise link.LinkError(f"lock-step over {kind}: a node failed")
    reports = [json.loads(t.splitlines()[-1]) for t in (text, answer)]
    hashes = [[a["trace_hash"] for a in r["axes"]] for r in reports]
    if hashes[0] != hashes[1]:
        raise link.LinkError(f"lock-step over {kind}: the two sides' hashes differ")
    return reports[0]


def measure(kind: str, turns: int) -> dict[str, Any]:
    """One row: raw rate and lock-step rate of a transport on this machine."""
    raw: list[float]
    one: list[float]
    six: list[float]
    rates: Any
    raw, one, six, repeated = [], [], [], 0
    for _ in range(turns):
        where = _core.lcm_url_of(secrets.randbelow(2**53)) if kind == "lcm" else CAN
        raw.append(raw_rate(kind, where))
        for rates, axes in ((one, 1), (six, AXES)):
            report = lock_step(kind, axes)
            rates.append(report["ticks_per_s"])
            repeated += report["statistics"]["repeated"]
    rates = {n: statistics.median(r) for n, r in (("raw", raw), ("one", one), ("six", six))}
    return {
        "link": kind,
        "raw_per_s": rates["raw"],
        "ticks_per_s": rates["one"],
        "share": rates["one"] / rates["raw"],
        "real_time": rates["one"] / _core.TICKS_PER_SECOND,
        "six_axes_ticks_per_s": rates["six"],
        "six_axes_real_time": rates["six"] / _core.TICKS_PER_SECOND,
        "repeated": repeated,
        "turns": turns,
    }


def run(turns: int = 5) -> list[dict[str, Any]]:
    """Rows of all transports; CAN runs under tools/vcan."""
    rows = [measure("lcm", turns)]
    command = [link.program("vcan"), sys.executable, "-m", "forceaxis.bench.link", str(turns)]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode:
        raise link.LinkError("bench over socketcan failed; its reason stands above")
    return [*rows, json.loads(done.stdout)]


def describe(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Lines for a terminal."""
    return [
        f"{r['link']:12} {r['ticks_per_s']:,.0f} ticks/s ({r['real_time']:.1f} x real time), "
        f"{r['share']:.0%} of a raw ping-pong's {r['raw_per_s']:,.0f}/s; six axes "
        f"{r['six_axes_ticks_per_s']:,.0f} ticks/s ({r['six_axes_real_time']:.1f} x); "
        f"{r['repeated']} records repeated"
        for r in rows
    ]


def check(rows: Sequence[dict[str, Any]]) -> list[tuple[str, bool]]:
    """The required figures: [(text, whether it is reached)]."""
    checks = []
    for r in rows:
        share, six = r["share"], r["six_axes_real_time"]
        checks.append(
            (
                f"{r['link']}: lock-step / ping-pong >= {LEAST_SHARE}: {share:.3g}",
                share >= LEAST_SHARE,
            )
        )
        checks.append(
            (f"{r['link']}: six axes / real time >= {LEAST_REAL_TIME}: {six:.3g}",
             six >= LEAST_REAL_TIME)
        )  # fmt: skip
    return checks


if __name__ == "__main__":
    try:
        print(json.dumps(measure("socketcan", int(sys.argv[1]))))
    except link.LinkError as error:
        sys.exit(f"forceaxis: {error}")
