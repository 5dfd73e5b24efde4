"""The session of test_tune_killed.py on real CAN, in one guest: run under tools/vcan with a folder
to write to and a seed. `forceaxis tune` is killed once in each of its steps, at a random moment,
and begun again.
"""

import json
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from forceaxis.axis.axis import Axis
from forceaxis.axis.can import CanLink
from forceaxis.commission import as_found
from forceaxis.commission.tune import STEPS
from forceaxis.design import data_sheet, new
from forceaxis.experiments import link

FORCEAXIS = Path(sys.executable).parent / "forceaxis"
SHEET = {"sensor_bits": 12, "sensor_noise_n": 0.3, "workpiece_stiffness_n_per_m": 4e5,
         "workpiece_mass_kg": 4}  # fmt: skip
TRUTH = ("k_w=5e5", "m_w=5")  # of the hidden axis
# Of the user; its approach is faster than `tune` lets it be.
SETTINGS = {"position_gain": 4.0, "velocity_gain": 20.0, "approach_velocity_max": 2000}
# Within which a step is killed, s: less than it takes.
WITHIN = {"check": 0.8, "free": 8.0, "measure": 12.0, "fit": 1.0, "design": 4.0, "simulate": 0.3,
          "write": 0.3, "verify": 12.0, "store": 0.3}  # fmt: skip
TRIES = 4
STEP_S = 600.0


class Tool:
    """`forceaxis tune` as a process, and the lines that it has printed."""

    def __init__(self, folder, *more):
        self.lines, self.folder, self.since = [], folder, time.time()
        self.process = subprocess.Popen(
            [FORCEAXIS, "tune", "--can", "vcan0", "--node", "1", "--model",
             folder / "press/model.toml", "--force", "30,100", "--over", "k_w=30%,m_w=30%",
             "--force-max", "200", "--averages", "4", "--out", folder / "tuned", *more],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        self.reader = threading.Thread(target=self._read)
        self.reader.start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    def has_begun(self, step):
        """Whether the step before has ended, or the axis was taken over for the first step."""
        if step == STEPS[0]:
            found = self.folder / "tuned/found.json"
            return found.exists() and found.stat().st_mtime > self.since
        before = STEPS[STEPS.index(step) - 1]
        return any(line.startswith(f"{before}: ") for line in self.lines)

    def end(self, number=None):
        if number is not None:
            self.process.send_signal(number)
        status = self.process.wait(STEP_S)
        self.reader.join()
        return status


def killed(step, folder, axis, within):
    """What a kill in a step leaves: the axis, the folder."""
    done = folder / f"tuned/{step}.json"
    done.unlink(missing_ok=True)
    tool, end = Tool(folder), time.monotonic() + STEP_S
    while not tool.has_begun(step):
        if tool.process.poll() is not None or time.monotonic() > end:
            raise RuntimeError(f"{step}: {tool.lines}")
        time.sleep(0.005)
    time.sleep(random.uniform(0, within))
    status = tool.end(signal.SIGKILL)
    since = axis.read("tick_count")
    enabled = axis.read("drive_state") == "operation_enabled"
    while axis.read("drive_state") == "operation_enabled":
        time.sleep(0.005)
    seconds = (axis.read("tick_count") - since) / 1500
    names = ("fault", "force_bank", "bank_state_1", "drive_state")
    broken = []
    for file in (folder / "tuned").glob("*.json"):
        try:
            json.loads(file.read_text())
        except ValueError:
            broken.append(file.name)
    return {
        "status": status, "in_step": not done.exists(), "enabled": enabled, "seconds": seconds,
        "broken": broken, "lines": tool.lines, **axis.get(*names),
    }  # fmt: skip


def main():
    folder, seed = Path(sys.argv[1]), int(sys.argv[2])
    random.seed(seed)
    new.write(folder / "press", *data_sheet.collect({k: str(v) for k, v in SHEET.items()}))
    common = [folder / "press/contact.toml", "--link", "socketcan", "--endless", "--pace", "real"]
    common += [word for text in TRUTH for word in ("--set", text)]
    node = ["--can", "vcan0", "--store", folder / "store.bin", "--set", "firmware.mode=disabled"]
    running = []
    try:
        for name, words in (("axis_node", node), ("plant_node", [])):
            out = (folder / f"{name}.txt").open("w")
            running.append(
                subprocess.Popen([link.program(name), *common, *words], stdout=out, stderr=out)
            )
            time.sleep(2)
        with Axis(CanLink("vcan0", 1)) as axis:
            axis.set(**SETTINGS)
        axis = Axis(CanLink("vcan0", 1))  # that only reads
        found = {"seed": seed, "before": as_found.read(axis), "killed": {}}
        for step in STEPS:
            within = WITHIN[step]
            for tries in range(1, TRIES + 1):
                one = killed(step, folder, axis, within)
                found["killed"][step] = one | {"tries": tries}
                if found["killed"][step]["in_step"]:
                    break
                within /= 2
            print(step, found["killed"][step], file=sys.stderr, flush=True)
        tool = Tool(folder, "--json")
        found["status"], found["lines"] = tool.end(), tool.lines
        names = ("drive_state", "fault", "force_bank", "bank_state_1", "certificate_state_1")
        found["is"] = axis.get(*names, "command_source", "consumer_heartbeat_1", *SETTINGS)
        found["after"] = as_found.read(axis)
        designed = json.loads((folder / "tuned/design.json").read_text())["result"]
        found["law"] = list(designed["objects"])
        axis.close()
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.wait(10)
    (folder / "killed.json").write_text(json.dumps(found))


if __name__ == "__main__":
    main()
