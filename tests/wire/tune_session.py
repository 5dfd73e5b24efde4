"""The session of test_tune_killed.py on real CAN, in one guest: run under tools/vcan with a folder
to write to, a seed and the steps of `forceaxis tune` in which it is killed, each once, at a random
moment, and begun again.
"""

import json
import multiprocessing
import os
import random
import subprocess
import sys
import time
from multiprocessing import forkserver
from pathlib import Path

from forceaxis.__main__ import main as main_of_program
from forceaxis.axis.axis import Axis
from forceaxis.axis.can import CanLink
from forceaxis.commission import as_found
from forceaxis.commission.tune import STEPS
from forceaxis.design import data_sheet, new
from forceaxis.experiments import link
from steps import Steps

FORKED = multiprocessing.get_context("forkserver")
LOADED = ["__main__", "can", "canopen", "forceaxis.cli.tune", "forceaxis.pages.tuning"]
SHEET = {"sensor_bits": 12, "sensor_noise_n": 0.15, "workpiece_stiffness_n_per_m": 4e5,
         "workpiece_mass_kg": 4, "approach_mm": 2}  # fmt: skip
TRUTH = ("k_w=5e5",)  # of the hidden axis
# Of the user; its approach is faster than `tune` lets it be.
SETTINGS = {"position_gain": 4.0, "velocity_gain": 20.0, "approach_velocity_max": 2000}
# Within which a step is killed, s: less than it takes.
WITHIN = {"check": 0.8, "free": 8.0, "measure": 10.0, "fit": 0.8, "design": 4.0, "simulate": 0.06,
          "write": 0.06, "verify": 10.0, "store": 0.3}  # fmt: skip
TRIES = 4
STEP_S = 600.0


class Tool:
    """`forceaxis tune` as a process, forked from one that has loaded its modules: in a guest that
    takes seconds. Its output is in a file."""

    def __init__(self, folder, *more):
        self.folder, self.since = folder, time.time()
        self.printed = folder / "printed.txt"
        words = ["tune", "--on", "vcan0:1", "--model", folder / "press/model.toml",
                 "--force", "30,100", "--over", "k_w=30%", "--force-max", "200",
                 "--averages", "4", "--out", folder / "tuned", *more]  # fmt: skip
        self.process = FORKED.Process(target=forceaxis, args=(self.printed, *map(str, words)))
        self.process.start()

    def has_begun(self, step):
        """Whether the axis was taken over and the step before has ended."""
        tuned = self.folder / "tuned"
        found, before = tuned / "found.json", STEPS.index(step) - 1
        taken_over = found.exists() and found.stat().st_mtime > self.since
        return taken_over and (before < 0 or (tuned / f"{STEPS[before]}.json").exists())

    def end(self):
        """Its exit status, minus the signal's number, and its lines."""
        self.process.join(STEP_S)
        return self.process.exitcode, self.printed.read_text().splitlines()


def forceaxis(printed, *words):
    """The program, in this process."""
    out = os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for descriptor in (1, 2):
        os.dup2(out, descriptor)
    sys.argv = ["forceaxis", *words]
    main_of_program()


def killed(step, folder, axis, within):
    """What a kill in a step leaves: the axis, the folder."""
    done = folder / f"tuned/{step}.json"
    done.unlink(missing_ok=True)
    tool, end = Tool(folder), time.monotonic() + STEP_S
    while not tool.has_begun(step):
        if not tool.process.is_alive() or time.monotonic() > end:
            raise RuntimeError(f"{step}: {tool.end()}")
        time.sleep(0.005)
    time.sleep(random.uniform(0, within))
    tool.process.kill()
    status, lines = tool.end()
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
        "broken": broken, "lines": lines, **axis.get(*names),
    }  # fmt: skip


def killed_in_step(step, folder, axis):
    """The kill that came in the step and not after it, and the number of tries."""
    for tries in range(1, TRIES + 1):
        one = killed(step, folder, axis, WITHIN[step] / 2 ** (tries - 1)) | {"tries": tries}
        if one["in_step"]:
            break
    return one


def main(folder, seed, kills, steps):
    random.seed(seed)
    new.write(folder / "press", *data_sheet.collect({k: str(v) for k, v in SHEET.items()}))
    common = [folder / "press/contact.toml", "--link", "socketcan", "--endless", "--pace", "real"]
    common += [word for text in TRUTH for word in ("--set", text)]
    node = ["--can", "vcan0", "--store", folder / "store.bin", "--set", "firmware.mode=disabled"]
    running = []
    FORKED.set_forkserver_preload(LOADED)
    forkserver.ensure_running()
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
        steps["seed"], steps["before"] = seed, as_found.read(axis)
        for step in kills:
            steps(f"killed {step}", killed_in_step, step, folder, axis)
        steps["status"], steps["lines"] = Tool(folder, "--json").end()
        names = ("drive_state", "fault", "force_bank", "bank_state_1", "certificate_state_1")
        steps["is"] = axis.get(*names, "command_source", "consumer_heartbeat_1", *SETTINGS)
        steps["after"] = as_found.read(axis)
        designed = json.loads((folder / "tuned/design.json").read_text())["result"]
        steps["law"] = list(designed["objects"])
        axis.close()
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.wait(10)


if __name__ == "__main__":
    with Steps(sys.argv[1]) as found:
        main(Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3:], found)
