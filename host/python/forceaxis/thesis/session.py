"""A complete laboratory session of the thesis, operated through the gateway.

The session sets the gains of an axis, moves 36,000 counts (thesis section 3.13), makes contact at
k_f = 5 and f_d = 30 (3.14), records an impact on the workpiece (3.16) and draws a plot.

`run` needs a running gateway. `run_with_programs` also starts the programs of plant, firmware and
gateway.
"""

import contextlib
import ctypes
import functools
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING

from forceaxis import _core, paths
from forceaxis.axis.axis import trigger_on
from forceaxis.axis.session import Session, seconds
from forceaxis.bus.capture_assembly import Assembly
from forceaxis.bus.client import NoAnswer, Refused
from forceaxis.bus.messages import axis_state_t
from forceaxis.experiments import link
from forceaxis.experiments import run as runs
from forceaxis.experiments.inputs import read_inputs
from forceaxis.experiments.node_reports import read_axis_report, read_plant_report
from forceaxis.experiments.run_result import JournalFacts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Function that is called with the name of a step of the session when this step begins.
Report = Callable[[str], None]

EXPERIMENT = paths.EXPERIMENTS / "session.toml"
TRAVEL_COUNTS = 36_000  # travel of the axis in the first move of the session, in encoder counts
# Force set-point in 8-bit counts. With the P law of the thesis, the force settles below it.
SETPOINT = 30.0
RECORDED = ["force", "dac_code"]
GAINS = {
    "position_gain": 4.0,
    "velocity_gain": 20.0,
    "force_gain": 5.0,
    # `bump_decay_shift` = 0 means no bumpless transfer, as in the controller of the thesis.
    "bump_decay_shift": 0,
}


@dataclass(frozen=True)
class ObservedSession:
    """Values that a client of the gateway observes in a laboratory session. Forces are in 8-bit
    counts."""

    software: int  # value of the object `object_table_hash`
    position_after_move_cnt: int  # position of the axis in encoder counts after the move
    force_held_cnt: float
    position_in_contact_cnt: int  # position in encoder counts while the axis is in contact
    force_after_cnt: float  # measured force after the impact, in 8-bit counts
    samples: int  # number of samples that the recorder stored
    samples_missing: int
    peak_force_cnt: float  # largest force in the recording, in 8-bit counts
    states: int  # number of state messages that the client received
    messages_lost: int


@dataclass(frozen=True)
class NodeHashes:
    """The trace hashes of a session: one from the firmware's program, one from the plant's
    program."""

    plant_node: str
    axis_node: str


@dataclass(frozen=True)
class SessionResult(ObservedSession):
    """Result of a laboratory session: the observed values, the results of its programs, and the
    result of the replay of its journal."""

    gateway_status: int  # exit status of the gateway
    trace_hash: NodeHashes
    replayed_hash: str
    journal: JournalFacts
    # number of ticks that the program of the plant computed too late for real time
    plant_overruns: int
    fault: str
    folder: str  # folder to which the session wrote its files


@dataclass(frozen=True)
class Scales:
    """Sizes of one encoder count, one force count and one DAC code in the model of the session, in
    physical units."""

    mm_per_count: float  # travel in mm per encoder count
    N_per_count: float  # measured force in N per 8-bit count
    V_per_code: float  # command voltage in V per DAC code


def run(
    url: str | None = None,
    axis: int = 1,
    strike_within_s: float = 20.0,
    report: Report = lambda step: None,
) -> tuple[ObservedSession, list[axis_state_t], Assembly]:
    """Runs a laboratory session, and returns (observed values, states, recording). `report`:
    function that is called with the name of each step when the step begins."""
    report("connecting")
    with Session(axis, url, wait_s=20) as session:
        software = int(session.read("object_table_hash"))
        session.write_all(GAINS)
        report("homing")
        session.home()
        report(f"moving {TRAVEL_COUNTS * scales().mm_per_count:.4g} mm")
        session.enable("profile position", trajectory_velocity=60_000)
        moved = session.move(TRAVEL_COUNTS)
        report(f"pressing with {SETPOINT * scales().N_per_count:.4g} N")
        session.enable("force counts", force_setpoint=SETPOINT)
        session.wait_contact(SETPOINT)
        force_held = float(session.read("force"))
        position_in_contact = int(session.read("position_actual"))
        report("waiting for the strike")
        # The time of the impact is not known in advance, so the recorder waits for its trigger.
        recording = session.capture(
            RECORDED,
            samples=1800,
            pretrigger=300,
            timeout_s=strike_within_s,
            **trigger_on("force", SETPOINT + 1),
        )
        after = session.wait_contact(SETPOINT)
        states = session.states
        lost = sum(g.lost for g in session.gaps.values())
    observed = ObservedSession(
        software=software,
        position_after_move_cnt=moved.position_cnt,
        force_held_cnt=force_held,
        position_in_contact_cnt=position_in_contact,
        force_after_cnt=after.force_cnt_q8 / 256,
        samples=recording.total,
        samples_missing=recording.missing,
        peak_force_cnt=float(recording.values("force").max()),
        states=len(states),
        messages_lost=lost,
    )
    return observed, states, recording


@functools.cache
def scales() -> Scales:
    """Returns the sizes of encoder counts, force counts and DAC codes in the model of the
    session."""
    converters = read_inputs(EXPERIMENT).converters
    return Scales(
        mm_per_count=converters["encoder"].per_code * 1e3,
        N_per_count=converters["adc0"].per_8_bit_count,
        V_per_code=converters["dac"].per_12_bit_code,
    )


def figure(states: Sequence[axis_state_t], recording: Assembly) -> "Figure":
    """Returns a plot of the session. It shows position and force in the received states, and force
    and command in the recording of the impact."""
    import matplotlib.pyplot as plt
    import numpy as np

    from forceaxis.drawing import INK, THIN, WANTED, finish, style

    states, times = seconds(states)
    ticks = recording.ticks()
    ms_per_tick = 1e3 / _core.TICKS_PER_SECOND
    struck = [(tick - ticks[recording.trigger_sample]) * ms_per_tick for tick in ticks]
    position = np.array([s.position_cnt for s in states]) * scales().mm_per_count
    force = np.array([s.force_cnt_q8 / 256 for s in states]) * scales().N_per_count
    struck_force = np.asarray(recording.values("force")) * scales().N_per_count
    command = np.asarray(recording.values("dac_code")) * scales().V_per_code
    session, strike = "time of the session, s", "time from the strike, recorded at 1500 Hz, ms"
    drawn, axes = plt.subplots(4, 1, figsize=(7.2, 7.6))
    for ax, x, values, label, below in zip(
        axes,
        (times, times, struck, struck),
        (position, force, struck_force, command),
        ("position\nmm", "force\nN", "force\nN", "command\nV"),
        ("", session, "", strike),
        strict=True,
    ):
        style(ax)
        ax.plot(x, values, color=INK, **THIN)
        ax.set(xlabel=below, ylabel=label)
        ax.margins(x=0)
    for ax in axes[1:3]:
        setpoint_N = SETPOINT * scales().N_per_count
        ax.axhline(setpoint_N, color=WANTED, linestyle="--", linewidth=0.8)
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
    """Context manager that runs the programs of plant, firmware and gateway in real time. They use
    the CAN interfaces vcan0 and vcan1. Yields {name of a program: its process}.

    journal: file of the journal, by default folder/axis.journal. endless: True if the programs run
    until they are ended. After an error, raises link.LinkError with the output of the programs.
    """
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
        # The watchdog time is long, because a guest kernel pauses at times on a busy computer.
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
            reports = [f"{name}: {_text(file)}" for name, file in outputs.items() if _text(file)]
            reports += [f"{n} ended with {p.returncode}" for n, p in running.items() if p.poll()]
            raise link.LinkError("; ".join([str(error), *reports])) from error


def _end_with_us() -> None:
    """Asks the kernel to send SIGTERM to this process when its parent process ends. Call this
    function in a new process."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # 1 means PR_SET_PDEATHSIG


def _output(name: str, process: subprocess.Popen[str]) -> str:
    """Returns the output of a finished program. Raises link.LinkError if the program has failed."""
    out, _ = process.communicate(timeout=60)
    if process.returncode != 0 or not out.strip():
        raise link.LinkError(f"{name}: expected exit status 0, got {process.returncode}")
    return out


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


def run_with_programs(folder: Path, report: Report = lambda step: None) -> SessionResult:
    """Starts the programs of plant, firmware and gateway, runs the session, and replays its
    journal. Writes all files below `folder`, or no file after an error. `report`: as in run()."""
    from forceaxis import drawing

    with tempfile.TemporaryDirectory() as scratch:
        journal = Path(scratch) / "axis.journal"
        report("starting plant, firmware and gateway")
        with machine(folder, journal=journal) as running:
            observed, states, recording = run(report=report)
            report("ending the programs")
            running["gateway"].terminate()
            gateway_status = running["gateway"].wait(10)
            plant = read_plant_report(_output("plant_node", running["plant_node"]))
            axis = read_axis_report(_output("axis_node", running["axis_node"]))
        names = ("axis.journal", "session.png", "session.svg")
        with paths.replacing(folder, *names) as (kept, png, svg):
            shutil.copyfile(journal, kept)
            drawn = figure(states, recording)
            drawing.save(drawn, png, "png")
            drawing.save(drawn, svg, "svg")
    report("replaying the journal")
    replayed = runs.replay(folder / "axis.journal").result
    assert replayed.replay is not None
    return SessionResult(
        **vars(observed),
        gateway_status=gateway_status,
        trace_hash=NodeHashes(*plant.trace_hashes, *axis.trace_hashes),
        replayed_hash=replayed.trace_hash,
        journal=replayed.replay,
        plant_overruns=plant.overruns,
        fault=axis.faults[0],
        folder=paths.display(folder),
    )
