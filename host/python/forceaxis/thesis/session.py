"""A whole session of the thesis through the gateway: boot, gains, a move of 36,000 counts (3.13),
contact at k_f = 5 and f_d = 30 (3.14), a strike on the workpiece (3.16), recorder, plot.

`run` needs a running gateway; `whole` also starts plant, firmware and gateway.
"""

import contextlib
import ctypes
import json
import signal
import subprocess
import tempfile
from pathlib import Path

from forceaxis import paths
from forceaxis.bus.client import NoAnswer, Refused
from forceaxis.bus.gateway import Session, seconds, trigger_on
from forceaxis.experiments import link
from forceaxis.experiments import run as runs

EXPERIMENT = paths.EXPERIMENTS / "session.toml"
TRAVEL = 36_000  # counts
WANTED = 30.0  # counts of an 8-bit reading; the thesis's law settles some counts below it
RECORDED = ["force", "dac_code"]
GAINS = {
    "position_gain": 4.0,
    "velocity_gain": 20.0,
    "force_gain": 5.0,
    # The thesis's controller has no bumpless transfer.
    "bump_decay_shift": 0,
}


def run(url=None, axis=1, strike_within_s=20.0):
    """Runs the session: ({name: observed value}, states, recording)."""
    with Session(axis, url, wait_s=20) as session:
        found = {"software": session.read("object_table_hash")}
        session.write_all(GAINS)
        session.home()
        session.enable("profile position", trajectory_velocity=60_000)
        there = session.move(TRAVEL)
        found["position_after_move_cnt"] = there.position_cnt
        session.enable("force counts", force_setpoint=WANTED)
        session.wait_contact(WANTED)
        found["force_held_cnt"] = session.read("force")
        found["position_in_contact_cnt"] = session.read("position_actual")
        # The strike is not synchronised: the recorder's trigger waits for it.
        held = session.capture(
            RECORDED,
            samples=1800,
            pretrigger=300,
            timeout_s=strike_within_s,
            **trigger_on("force", WANTED + 1),
        )
        after = session.wait_contact(WANTED)
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


def plot(states, held, path):
    """Move and contact as published, the strike as recorded."""
    import matplotlib.pyplot as plt

    from forceaxis.drawing import INK, THIN

    states, times = seconds(states)
    figure, rows = plt.subplots(4, 1, figsize=(7, 8), layout="constrained")
    rows[0].plot(times, [s.position_cnt for s in states], color=INK)
    rows[0].set_ylabel("position (count)")
    rows[1].plot(times, [s.force_cnt_q8 / 256 for s in states], color=INK)
    rows[1].set_ylabel("force (count)")
    rows[1].set_xlabel("time of the session (s)")
    struck = [(tick - held.ticks()[held.trigger_sample]) / 1.5 for tick in held.ticks()]
    rows[2].plot(struck, held.values("force"), color=INK, **THIN)
    rows[2].set_ylabel("force (count)")
    rows[3].plot(struck, held.values("dac_code"), color=INK, **THIN)
    rows[3].set_ylabel("code")
    rows[3].set_xlabel("time from the strike, recorded at 1500 Hz (ms)")
    with paths.replacing(path.parent, path.name) as (new,):
        figure.savefig(new, format="png", dpi=120)
    plt.close(figure)


@contextlib.contextmanager
def machine(
    folder,
    duration_s=None,
    programs=("axis_node", "plant_node", "gateway"),
    journal=None,
    endless=False,
):
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
                if "ready" not in process.stdout.readline():
                    process.wait(5)
                    raise link.LinkError(f"{name}: {_text(outputs[name]) or 'ended at once'}")
            yield running
        except (NoAnswer, Refused) as error:
            # The programs' own output explains the failure.
            reports = [f"{name}: {_text(file)}" for name, file in outputs.items() if _text(file)]
            reports += [f"{n} ended with {p.returncode}" for n, p in running.items() if p.poll()]
            raise link.LinkError("; ".join([str(error), *reports])) from error


def _end_with_us():
    """In a child: requests SIGTERM when its parent ends in any way."""
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


def _report(name, process):
    """The report of a finished program. Raises link.LinkError unless its run succeeded."""
    out, _ = process.communicate(timeout=60)
    if process.returncode != 0 or not out.strip():
        raise link.LinkError(f"{name}: expected a run to its end, status {process.returncode}")
    return json.loads(out.splitlines()[-1])


def _text(file):
    file.seek(0)
    return " ".join(file.read().split())


def _stop(process):
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def whole(folder):
    """The whole session, files below `folder`: {name: observed value}."""
    # Results of an earlier session stay until this one has finished.
    with paths.replacing(folder, "axis.journal") as (journal,):
        journal.unlink(missing_ok=True)
        with machine(folder, journal=journal) as running:
            found, states, held = run()
            running["gateway"].terminate()
            found["gateway_status"] = running["gateway"].wait(10)
            reports = {n: _report(n, running[n]) for n in ("plant_node", "axis_node")}
    plot(states, held, Path(folder) / "session.png")
    done, journal = runs.replay(folder / "axis.journal")
    found |= {
        "trace_hash": {n: r["axes"][0]["trace_hash"] for n, r in reports.items()},
        "replayed_hash": done.summary["trace_hash"],
        "journal": journal,
        "plant_overruns": reports["plant_node"]["overruns"],
        "fault": reports["axis_node"]["axes"][0]["fault"],
    }
    return found


def describe(found):
    """The observed values for a terminal."""
    return "\n".join(
        (
            f"moved to     {found['position_after_move_cnt']} count",
            f"contact      held {found['force_held_cnt']:.2f} count",
            f"strike       peak {found['peak_force_cnt']:.2f} count, then "
            f"{found['force_after_cnt']:.2f} count again",
            f"recorded     {found['samples']} samples, {found['samples_missing']} missing",
            f"watched      {found['states']} states, {found['messages_lost']} messages lost",
            f"trace hash   {found['replayed_hash']}, of plant, firmware and replay",
            f"files        {found['folder']}",
        )
    )
