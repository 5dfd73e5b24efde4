"""A whole session of the thesis through the gateway: boot, gains, a move of 36,000 counts (3.13),
contact at k_f = 5 and f_d = 30 (3.14), a strike on the workpiece (3.16), recorder, plot.

`run` needs a running gateway; `whole` also starts plant, firmware and gateway.
"""

import contextlib
import ctypes
import functools
import json
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from forceaxis import _core, paths
from forceaxis.axis.axis import trigger_on
from forceaxis.axis.session import Session, seconds
from forceaxis.bus.capture_assembly import Assembly
from forceaxis.bus.client import NoAnswer, Refused
from forceaxis.bus.messages import axis_state_t
from forceaxis.experiments import link
from forceaxis.experiments import run as runs
from forceaxis.results import to_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Report = Callable[[str], None]  # called with the name of each step

EXPERIMENT = paths.EXPERIMENTS / "session.toml"
TRAVEL_COUNTS = 36_000  # of the encoder
SETPOINT = 30.0  # counts of an 8-bit reading; the thesis's law settles some counts below it
RECORDED = ["force", "dac_code"]
GAINS = {
    "position_gain": 4.0,
    "velocity_gain": 20.0,
    "force_gain": 5.0,
    # The thesis's controller has no bumpless transfer.
    "bump_decay_shift": 0,
}


def run(
    url: str | None = None,
    axis: int = 1,
    strike_within_s: float = 20.0,
    report: Report = lambda step: None,
) -> tuple[dict[str, Any], list[axis_state_t], Assembly]:
    """Runs the session: ({name: observed value}, states, recording). report: called with the name
    of each step as it begins."""
    report("connecting")
    with Session(axis, url, wait_s=20) as session:
        found = {"software": session.read("object_table_hash")}
        session.write_all(GAINS)
        report("homing")
        session.home()
        report(f"moving {TRAVEL_COUNTS * scales()['mm']:.4g} mm")
        session.enable("profile position", trajectory_velocity=60_000)
        there = session.move(TRAVEL_COUNTS)
        found["position_after_move_cnt"] = there.position_cnt
        report(f"pressing with {SETPOINT * scales()['N']:.4g} N")
        session.enable("force counts", force_setpoint=SETPOINT)
        session.wait_contact(SETPOINT)
        found["force_held_cnt"] = session.read("force")
        found["position_in_contact_cnt"] = session.read("position_actual")
        report("waiting for the strike")
        # The strike is not synchronised: the recorder's trigger waits for it.
        held = session.capture(
            RECORDED,
            samples=1800,
            pretrigger=300,
            timeout_s=strike_within_s,
            **trigger_on("force", SETPOINT + 1),
        )
        after = session.wait_contact(SETPOINT)
        found["force_after_cnt"] = after.force_cnt_q8 / 256
        states = session.states
        gaps = sum(g.lost for g in session.gaps.values())
    found |= {
        "samples": held.total,
        "samples_missing": held.missing,
        "peak_force_cnt": float(held.values("force").max()),
        "states": len(states),
        "messages_lost": gaps,
    }
    return found, states, held


@functools.cache
def scales() -> dict[str, float]:
    """mm of an encoder count, N of a count of the force reading at 8 bits, V of a DAC code."""
    known = _core.inputs(str(EXPERIMENT), [])["converters"]
    reading = known["adc0"]
    return {
        "mm": known["encoder"]["per_code"] * 1e3,
        "N": reading["per_code"] * 2 ** (reading["bits"] - 8),
        "V": known["dac"]["per_code"],
    }


def figure(states: Sequence[axis_state_t], held: Assembly) -> "Figure":
    """Move and contact as published, the strike as recorded."""
    import matplotlib.pyplot as plt
    import numpy as np

    from forceaxis.drawing import INK, THIN, WANTED, finish, style

    states, times = seconds(states)
    struck = [(tick - held.ticks()[held.trigger_sample]) / 1.5 for tick in held.ticks()]
    position = [s.position_cnt for s in states]
    force = [s.force_cnt_q8 / 256 for s in states]
    session, strike = "time of the session, s", "time from the strike, recorded at 1500 Hz, ms"
    drawn, axes = plt.subplots(4, 1, figsize=(7.2, 7.6))
    for ax, x, values, name, unit, below in zip(
        axes,
        (times, times, struck, struck),
        (position, force, held.values("force"), held.values("dac_code")),
        ("position", "force", "force", "command"),
        ("mm", "N", "N", "V"),
        (None, session, None, strike),
        strict=True,
    ):
        style(ax)
        ax.plot(x, np.asarray(values) * scales()[unit], color=INK, **THIN)
        if unit == "N":
            ax.axhline(SETPOINT * scales()["N"], color=WANTED, linestyle="--", linewidth=0.8)
        ax.set_ylabel(f"{name}\n{unit}")
        ax.set_xlabel(below or "")
        ax.margins(x=0)
    finish(drawn, axes[0], "Session through the gateway: a move, contact, a strike")
    return drawn


@contextlib.contextmanager
def machine(
    folder: Path,
    duration_s: float | None = None,
    programs: Sequence[str] = ("axis_node", "plant_node", "gateway"),
    journal: Path | None = None,
    endless: bool = False,
) -> Iterator[dict[str, subprocess.Popen[str]]]:
    """Plant, firmware and gateway on vcan0 and vcan1, in real time: {name: process}. The journal
    is folder/axis.journal by default. endless: until they are ended."""
    common = [str(EXPERIMENT), "--link", "socketcan", "--start-timeout", "20"]
    if duration_s:
        common += ["--set", f"experiment.duration_s={duration_s}"]
    if endless:
        common.append("--endless")
    commands = {
        "axis_node": [
            *common,
            "--can",
            "vcan0",
            "--journal",
            str(journal or folder / "axis.journal"),
        ],
        "plant_node": [*common, "--pace", "real"],
        # A guest on a busy machine stalls now and then: longer time-outs bridge that.
        "gateway": ["--axes", "1", "--modbus-port", "0", "--watch-ms", "1000"],
    }
    commands = {name: commands[name] for name in programs}
    running, outputs = {}, {}
    with contextlib.ExitStack() as stack:
        try:
            for name, words in commands.items():
                outputs[name] = stack.enter_context(tempfile.TemporaryFile("w+"))
                running[name] = process = subprocess.Popen(
                    [link.program(name), *words],
                    stdout=subprocess.PIPE,
                    stderr=outputs[name],
                    text=True,
                    preexec_fn=_end_with_us,
                )
                stack.callback(_stop, process)
                if process.stdout is None or "ready" not in process.stdout.readline():
                    process.wait(5)
                    raise link.LinkError(f"{name}: {_text(outputs[name]) or 'ended at once'}")
            yield running
        except (NoAnswer, Refused) as error:
            # The programs' own output explains the failure.
            reports = [f"{name}: {_text(file)}" for name, file in outputs.items() if _text(file)]
            reports += [f"{n} ended with {p.returncode}" for n, p in running.items() if p.poll()]
            raise link.LinkError("; ".join([str(error), *reports])) from error


def _end_with_us() -> None:
    """In a child: requests SIGTERM when its parent ends in any way."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


def _report(name: str, process: subprocess.Popen[str]) -> dict[str, Any]:
    """The report of a finished program. Raises link.LinkError unless its run succeeded."""
    out, _ = process.communicate(timeout=60)
    if process.returncode != 0 or not out.strip():
        raise link.LinkError(f"{name}: expected a run to its end, status {process.returncode}")
    report: dict[str, Any] = json.loads(out.splitlines()[-1])
    return report


def _text(file: IO[str]) -> str:
    file.seek(0)
    return " ".join(file.read().split())


def _stop(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def whole(folder: Path | str, report: Report = lambda step: None) -> dict[str, Any]:
    """The whole session, files below `folder`, all or none: {name: observed value}. report: as of
    `run`."""
    from forceaxis import drawing

    folder = Path(folder)
    with tempfile.TemporaryDirectory() as scratch:
        journal = Path(scratch) / "axis.journal"
        report("starting plant, firmware and gateway")
        with machine(folder, journal=journal) as running:
            found, states, held = run(report=report)
            report("ending the programs")
            running["gateway"].terminate()
            found["gateway_status"] = running["gateway"].wait(10)
            reports = {n: _report(n, running[n]) for n in ("plant_node", "axis_node")}
        names = ("axis.journal", "session.png", "session.svg")
        with paths.replacing(folder, *names) as (kept, png, svg):
            shutil.copyfile(journal, kept)
            drawn = figure(states, held)
            drawing.save(drawn, png, "png")
            drawing.save(drawn, svg, "svg")
    report("replaying the journal")
    done = runs.replay(folder / "axis.journal")
    replayed = to_json(done.result.replay)
    del replayed["same"]
    found |= {
        "trace_hash": {n: r["axes"][0]["trace_hash"] for n, r in reports.items()},
        "replayed_hash": done.result.trace_hash,
        "journal": replayed,
        "plant_overruns": reports["plant_node"]["overruns"],
        "fault": reports["axis_node"]["axes"][0]["fault"],
    }
    return found


def describe(found: dict[str, Any]) -> str:
    """The observed values for a terminal."""

    def force(name: str) -> str:
        count = found[name]
        return f"{count * scales()['N']:.4g} N ({count:.2f} counts of force)"

    travel = found["position_after_move_cnt"]
    return "\n".join(
        (
            f"moved to     {travel * scales()['mm']:.5g} mm ({travel} encoder counts)",
            f"contact      held {force('force_held_cnt')}",
            f"strike       peak {force('peak_force_cnt')}, then {force('force_after_cnt')} again",
            f"recorded     {found['samples']} samples, {found['samples_missing']} missing",
            f"watched      {found['states']} states, {found['messages_lost']} messages lost",
            f"trace hash   {found['replayed_hash']}, of plant, firmware and replay",
            f"files        {found['folder']}",
        )
    )
